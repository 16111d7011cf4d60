"""A flow model of one equation in place of the flow-solver.

    ripstop run cases/square-drop/scene.toml --flow "python3 python/examples/stagnation_flow.py"

The air inside an inflated canopy is at rest relative to it, and the air outside is sucked along, so the
pressure jump is nearly the same on the whole canopy:

    jump = 1/2 rho c |u| u,    u = (w - v_face) . n,

with the density rho, a pressure coefficient c, the velocity w of the air relative to the frame of the payload
and the velocity v_face of each face in that frame. n is the unit normal of the face. Near the rim n is
horizontal, so w enters by its component along the axis alone: u = w . e_z - v_face . n.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # found without installation
import ripstop  # noqa: E402

DENSITY = 1.225  # kg/m3
COEFFICIENT = 1.5  # pressure jump over dynamic pressure


class StagnationFlow(ripstop.Participant):
    role = "flow"
    program = "stagnation-flow"
    version = "1"
    effects = ("resume", "coupling.adaptive")

    def __init__(self, run):
        case = run.case(grid=True)
        mesh, grid, scene = case["structure"], case["grid"], case["scene"]
        self.faces, self.canopy_nodes = np.array(mesh["faces"]), mesh["n_canopy"]
        self.wind = np.array(scene["flow"]["wind_m_s"])
        # Where the nodes of the canopy are in the flow grid, and where they are at the start.
        self.nodes = np.array(grid["canopy_nodes"])
        self.start = np.array(grid["coords"])[self.nodes]
        # In a stage without a mesh-mover the canopy is held still, and no grid is read.
        self.moving = scene["stage"][run.stage]["kind"] == "coupled"
        self.grid_nodes = len(grid["coords"]) if self.moving else 0
        # Several ranks share the faces.
        self.rows = np.array_split(np.arange(len(self.faces)), run.ranks)[run.rank]

    def output_rows(self):
        return self.rows

    def grid_rows(self):
        return self.nodes if self.moving else np.arange(0)

    def advance(self, window, canopy, grid, output):
        x, v = (grid[:, :3], grid[:, 3:]) if self.moving else (self.start, np.zeros_like(self.start))
        # The frame falls with the payload: the air comes from below.
        air = self.wind - np.array(window.frame_velocity)
        a, b, c, d = (x[self.faces[:, k]] for k in range(4))
        area = 0.5 * np.cross(c - a, d - b)
        normal = area / np.linalg.norm(area, axis=1)[:, None]
        own = np.mean(v[self.faces], axis=1)
        u = air[2] - np.sum(own * normal, axis=1)
        jump = 0.5 * DENSITY * COEFFICIENT * np.abs(u) * u
        output[:, 0], output[:, 1:] = jump[self.rows], 0.0  # no friction
        force = jump @ area
        return {"force_x": force[0], "force_y": force[1], "force_z": force[2]}

    def accept(self, window):
        """There is no state: the pressure follows from the present motion alone."""

    def save(self, folder):
        if self.rows[0] == 0:
            ripstop.save_state(folder, "flow", nothing=np.zeros(1))


if __name__ == "__main__":
    ripstop.main(StagnationFlow)
