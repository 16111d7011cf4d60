"""Inverse-distance interpolation instead of the mesh-mover.

    ripstop run cases/square-drop/scene.toml --mesh "python3 python/examples/inverse_distance.py"

Each node of the grid between canopy and outer boundary moves by the mean of their
displacements, weighted by (L/r)^3 + (L/r)^5 with its distance r to their nodes; the
outer boundary stands still. The weights are those of the start grid and are kept, one
for each pair of a free node and a canopy node: for small grids. Every process moves its
own share of the nodes.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # found without installation
import ripstop  # noqa: E402

# Faces of a hexahedron, seen from outside.
SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


def volumes(x, cells):
    """Volumes of hexahedra, also such that repeat nodes (m3)."""
    total = np.zeros(len(cells))
    for side in SIDES:
        a, b, c, d = (x[cells[:, k]] for k in side)
        total += np.sum((a + b + c + d) / 4 * np.cross(c - a, d - b), axis=1) / 6
    return total


def weights(free, fixed, length):
    """Unscaled weights `[free][fixed]`."""
    r2 = np.sum(free**2, axis=1)[:, None] + np.sum(fixed**2, axis=1) - 2 * free @ fixed.T
    s = length**2 / np.maximum(r2, 1e-12 * length**2)
    return s**1.5 + s**2.5


class InverseDistance(ripstop.Participant):
    role = "mesh"
    program = "inverse-distance"
    version = "1"
    effects = ("resume",)

    def __init__(self, run):
        case = run.case(grid=True)
        mesh, grid = case["structure"], case["grid"]
        self.start = np.array(grid["coords"])
        self.cells = np.array(grid["cells"])
        self.faces, self.canopy_nodes = np.array(mesh["faces"]), mesh["n_canopy"]
        self.grid_nodes = len(self.start)
        self.on_canopy = np.array(grid["canopy_nodes"])
        self.unstressed = np.array(mesh["coords"])[: self.canopy_nodes]
        outer = np.unique([node for _, face in grid["boundary"] for node in face])
        still = np.setdiff1d(outer, self.on_canopy)
        free = np.setdiff1d(np.arange(self.grid_nodes), np.concatenate([self.on_canopy, outer]))
        # All processes know the whole grid; each answers for its share.
        self.rows = np.array_split(np.arange(self.grid_nodes), run.ranks)[run.rank]
        x = self.start
        length = np.max(np.linalg.norm(x[still] - x[self.on_canopy[0]], axis=1), initial=0.0) / 5
        self.weight = np.zeros((self.grid_nodes, self.canopy_nodes))
        for some in np.array_split(free, max(1, len(free) // 1000)):
            near = weights(x[some], x[self.on_canopy], length)
            far = weights(x[some], x[still], length).sum(axis=1)
            self.weight[some] = near / (near.sum(axis=1) + far)[:, None]
        self.weight[self.on_canopy, np.arange(self.canopy_nodes)] = 1.0
        self.volumes = volumes(x, self.cells)
        self.now, self.before, self.dt = x, None, 0.0
        file = run.state(case, "mesh")
        if file is not None:
            state = ripstop.load_state(file)
            self.now, self.before, self.dt = state["now"], state["before"], float(state["dt"])
        self.trial = None

    def output_rows(self):
        return self.rows

    def advance(self, window, canopy, grid, output):
        moved = self.unstressed + canopy - self.start[self.on_canopy]
        x = self.start + self.weight @ moved
        ratio = volumes(x, self.cells) / self.volumes
        worst = int(np.argmin(ratio))
        if ratio[worst] <= 0:
            raise ripstop.Fault(
                f"cell {worst} is turned inside out in window {window.index} (its volume is {ratio[worst]:.3g} of "
                "that at the start): shorter windows or the project's own mesh-mover may help"
            )
        if self.before is not None and self.dt == window.dt:
            velocity = (1.5 * x - 2 * self.now + 0.5 * self.before) / window.dt
        else:
            velocity = (x - self.now) / window.dt
        output[:, :3], output[:, 3:] = x[self.rows], velocity[self.rows]
        self.trial = x
        return {"min_volume_ratio": ratio[worst], "worst_cell": worst}

    def accept(self, window):
        self.before, self.now, self.dt = self.now, self.trial, window.dt

    def save(self, folder):
        before = self.now if self.before is None else self.before
        dt = 0.0 if self.before is None else self.dt
        if self.rows[0] == 0:  # the first process writes for all
            ripstop.save_state(folder, "mesh", now=self.now, before=before, dt=dt)


if __name__ == "__main__":
    ripstop.main(InverseDistance)
