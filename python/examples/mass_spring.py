"""A mass-spring canopy instead of the structure-solver.

    ripstop run cases/square-drop/scene.toml --structure "python3 python/examples/mass_spring.py"

The fabric is a net: a spring along each edge of a face and along both its diagonals,
which pull and never push. With edges of stiffness 3/4 E t and diagonals of 3/8 E t a
square net stretches like an isotropic sheet of Poisson's ratio 1/3. Lines are springs
too, masses lie in the nodes, and time advances in explicit (symplectic Euler) steps, as
many in a window as are stable.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # found without installation
import ripstop  # noqa: E402


def springs_of(mesh, fabric, lines):
    """Ends `[springs][2]`, rest lengths (m), stiffnesses (N/m), masses of the nodes (kg). Lines come last."""
    x, faces = np.array(mesh["coords"]), np.array(mesh["faces"])
    corners = np.where(faces[:, 2] == faces[:, 3], 3, 4)
    area = 0.5 * np.linalg.norm(np.cross(x[faces[:, 2]] - x[faces[:, 0]], x[faces[:, 3]] - x[faces[:, 1]]), axis=1)
    sheet = fabric["youngs_modulus_pa"] * fabric["thickness_m"]
    ends, stiffness = [], []
    # An edge is shared by two faces and has half its stiffness from each.
    for i, j, share in [(0, 1, 3 / 8), (1, 2, 3 / 8), (2, 3, 3 / 8), (3, 0, 3 / 8), (0, 2, 3 / 4), (1, 3, 3 / 4)]:
        pair = faces[:, [i, j]]
        real = (pair[:, 0] != pair[:, 1]) & ((corners == 4) | (share < 0.5))
        length2 = np.sum((x[pair[:, 1]] - x[pair[:, 0]]) ** 2, axis=1)
        ends.append(np.sort(pair[real], axis=1))
        stiffness.append(share * sheet * area[real] / length2[real])
    ends, where = np.unique(np.concatenate(ends), axis=0, return_inverse=True)
    stiffness = np.bincount(where.ravel(), np.concatenate(stiffness))
    rest = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    mass = np.zeros(len(x))
    for k in range(4):
        weigh = np.where(k < corners, area / corners, 0.0) * fabric["thickness_m"] * fabric["density_kg_m3"]
        np.add.at(mass, faces[:, k], weigh)
    if mesh["cables"]:
        cables = np.array([c["nodes"] for c in mesh["cables"]])
        length = np.array([c["rest_length"] for c in mesh["cables"]])
        ends, rest = np.concatenate([ends, cables]), np.concatenate([rest, length])
        stiffness = np.concatenate([stiffness, lines["youngs_modulus_pa"] * lines["area_m2"] / length])
        for k in range(2):
            np.add.at(mass, cables[:, k], 0.5 * lines["density_kg_m3"] * lines["area_m2"] * length)
    return ends, rest, stiffness, mass


class MassSpring(ripstop.Participant):
    role = "structure"
    program = "mass-spring"
    version = "1"
    effects = ("fabric.wrinkling", "lines", "resume", "descent.equation", "descent.motion")

    def __init__(self, run):
        if run.ranks != 1:
            raise ripstop.Fault(f"mass-spring is one process, {run.ranks} were asked for: use --ranks structure=1")
        case = run.case()
        scene, mesh = case["scene"], case["structure"]
        self.stage = scene["stage"][run.stage]
        # Draws the end velocity of coupled windows to the motion that the flow sees.
        implicit = self.stage["kind"] == "coupled" and scene["coupling"]["scheme"] == "implicit"
        average = scene["coupling"]["velocity_average"]
        self.average = (0.5 if average is None else average) if implicit else 0.0
        self.rest_shape, self.faces = np.array(mesh["coords"]), np.array(mesh["faces"])
        self.canopy_nodes = mesh["n_canopy"]
        self.corners = np.where(self.faces[:, 2] == self.faces[:, 3], 3, 4)
        self.ends, self.rest, self.stiffness, mass = springs_of(mesh, scene["fabric"], scene["lines"])
        self.lines, n = len(mesh["cables"]), len(mass)
        for node, kilograms in mesh["point_masses"]:
            mass[node] += kilograms
        # Nodes that are held have no inverse mass along the held directions.
        self.mass, self.per_mass = mass, np.repeat(1 / mass[:, None], 3, axis=1)
        for node, held in mesh["fixed"]:
            self.per_mass[node, held] = 0.0
        self.moving = np.where(self.per_mass > 0.0, mass[:, None], 0.0)
        # Gershgorin: the square of the highest frequency is at most twice the stiffness around a node by its mass.
        around = sum(np.bincount(self.ends[:, k], self.stiffness, n) for k in range(2))
        free = self.per_mass.any(axis=1)
        self.stable = 0.7 * 2 / np.sqrt(np.max(2 * around[free] / mass[free]))
        self.u, self.v = np.zeros((n, 3)), np.zeros((n, 3))
        file = run.state(case, "structure")
        if file is not None:
            state = ripstop.load_state(file)
            self.u, self.v = state["u"], state["v"]
        self.trial = None

    def scatter(self, nodes, forces):
        """Sums forces `[..][3]` at nodes."""
        columns = [np.bincount(nodes, forces[:, i], len(self.mass)) for i in range(3)]
        return np.stack(columns, axis=1)

    def pull(self, x):
        """Forces of the springs on the nodes (N), their tensions (N)."""
        along = x[self.ends[:, 1]] - x[self.ends[:, 0]]
        length = np.linalg.norm(along, axis=1)
        tension = self.stiffness * np.maximum(length - self.rest, 0.0)
        force = along * (tension / length)[:, None]
        return self.scatter(self.ends[:, 0], force) - self.scatter(self.ends[:, 1], force), tension

    def push(self, x, load):
        """Forces of a load `[faces][4]` (Pa) on the nodes and on the faces (N), area vectors (m2)."""
        a, b, c, d = (x[self.faces[:, k]] for k in range(4))
        area = 0.5 * np.cross(c - a, d - b)
        force = load[:, :1] * area + load[:, 1:] * np.linalg.norm(area, axis=1)[:, None]
        part = force / self.corners[:, None]
        return sum(self.scatter(self.faces[self.corners > k, k], part[self.corners > k]) for k in range(4)), force, area

    @np.errstate(all="ignore")  # numbers are looked at below
    def advance(self, window, canopy, grid, output):
        steps = max(window.substeps, int(np.ceil(window.dt / self.stable)))
        dt = window.dt / steps
        keep = 1 / (1 + dt * self.stage["mass_damping_per_s"])
        u, v, work, impulse = self.u.copy(), self.v.copy(), 0.0, np.zeros(3)
        for step in range(steps):
            x = self.rest_shape + u
            s = (step + 0.5) / steps
            outside, *_ = self.push(x, (1 - s) * canopy[:, 0] + s * canopy[:, 1])
            v = keep * (v + dt * self.per_mass * (outside + self.pull(x)[0]))
            u += dt * v
            work += dt * np.sum(outside * v)
            impulse += dt * outside.sum(axis=0)
        if not np.isfinite(u).all():
            raise ripstop.Fault(f"the net diverged in window {window.index} (t = {window.time} s)")
        x = self.rest_shape + u
        tension, (_, force, area) = self.pull(x)[1], self.push(x, canopy[:, 1])
        self.trial = u, v
        # What the lines pass on to the payload: the impulse of the air that neither moves the net nor is damped.
        damped = self.stage["mass_damping_per_s"] * (u - self.u)
        kept = np.sum(self.moving * (v - self.v + damped), axis=0)
        output[:] = u[: self.canopy_nodes]
        return {
            "kinetic_energy": 0.5 * np.sum(self.mass[:, None] * v**2),
            "strain_energy": 0.5 * np.sum(tension**2 / self.stiffness),
            "load_work": work,
            "vertical_load": force[:, 2].sum(),
            "projected_area": abs(area[:, 2].sum()),
            "support_force": (impulse - kept) / window.dt,
            "momentum": np.sum(self.moving * v, axis=0),
            "max_line_tension": tension[len(tension) - self.lines :].max(initial=0.0),
        }

    def accept(self, window):
        u, v = self.trial
        v += self.average * ((u - self.u) / window.dt - v)
        self.u, self.v = u, v

    def save(self, folder):
        ripstop.save_state(folder, "structure", u=self.u, v=self.v)
        ripstop.write_shape(folder, (self.rest_shape + self.u)[: self.canopy_nodes])


if __name__ == "__main__":
    ripstop.main(MassSpring)
