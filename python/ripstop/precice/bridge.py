"""Solver programs of Ripstop that hand their work to a participant of preCICE."""

from pathlib import Path

import numpy as np

from ..contract import Fault
from ..participant import Participant, load_state, save_state, write_shape
from . import config
from .config import FACES, NODES
from .exchange import Exchange, Field
from .solver import FILES, Solver
from .surface import Surface
from .worker import Remote


# Effects for which the bridge estimates the force on the payload.
PAYLOAD = {"descent.equation", "descent.motion"}


def moving_mass(case, surface):
    """Masses that move with the canopy's nodes along each axis, `[nodes][3]`, kg: fabric, half of each line that ends there,
    and masses at points. 0 where a node is held."""
    scene, mesh, nodes = case["scene"], case["structure"], surface.nodes
    fabric, lines = scene["fabric"], scene["lines"]
    x = np.array(mesh["coords"])
    part = np.linalg.norm(surface.areas(x), axis=1) / surface.corners * fabric["thickness_m"] * fabric["density_kg_m3"]
    mass = np.zeros(len(x))
    for k in range(4):
        np.add.at(mass, surface.faces[surface.corners > k, k], part[surface.corners > k])
    for cable in mesh["cables"]:
        mass[cable["nodes"]] += 0.5 * lines["density_kg_m3"] * lines["area_m2"] * cable["rest_length"]
    for node, kilograms in mesh["point_masses"]:
        mass[node] += kilograms
    moving = np.repeat(mass[:, None], 3, axis=1)
    for node, held in mesh["fixed"]:
        moving[node, held] = 0.0
    return moving[:nodes]


class Bridge(Participant):
    """What both roles share. `options` are those of the command line."""

    version = "1"
    program = "precice-bridge"

    def __init__(self, run, options):
        if run.ranks != 1:
            raise Fault(f"{self.program} is one process, {run.ranks} were asked for: use --ranks {self.role}=1")
        if run.resume is not None:
            raise Fault(f"{self.program} cannot resume within a stage: start the stage from its beginning")
        self.effects = tuple(options.effects)
        self.solver = self.remote = None
        case = run.case(grid=self.role == "flow")
        scene, mesh = case["scene"], case["structure"]
        self.stage = scene["stage"][run.stage]
        self.faces, self.canopy_nodes = np.array(mesh["faces"]), mesh["n_canopy"]
        self.surface = Surface(self.faces, self.canopy_nodes)
        self.coords = np.array(mesh["coords"])[: self.canopy_nodes]
        self.kind = options.load
        file = Path(config.path_of(options.config, self.stage["name"])).resolve()
        config.check(file, self.role, self.kind, scene)
        self.state = run.state(case, self.role)
        self.prepare(case, run)
        try:
            self.connect(run, options, file)
        except BaseException:
            self.close()
            raise

    def connect(self, run, options, file):
        """Starts the solver, and preCICE with the meshes."""
        if options.solver:
            state = Path(self.state).parent / FILES if self.state else None
            if state and not state.is_dir():
                raise Fault(
                    f"{state} does not exist: the solver behind preCICE was ended before it could save its state, because "
                    "an earlier stage ended before its `duration_s`; remove `settled_energy_ratio` or shorten the stage"
                )
            folder = (run.out / self.stage["name"] / FILES).resolve()
            self.solver = Solver(options.solver, run, file, state and state.resolve(), folder)
        self.remote = Remote(config.NAME, file, self.observe)
        positions = {NODES: self.reference, FACES: self.surface.centres(self.reference)}
        writes, reads = ([Field(*f) for f in fields] for fields in config.fields(self.role, self.kind))
        used = {f.mesh for f in writes + reads}
        meshes = {name: at for name, at in positions.items() if name in used}
        triangles = {NODES: self.surface.triangles()} if NODES in used else {}
        self.exchange = Exchange(self.remote, meshes, writes, reads, triangles, options.repeat_tolerance)

    def observe(self):
        """Called while preCICE waits."""
        if self.solver:
            self.solver.observe()

    def finish(self):
        """Ends preCICE and the solver, if the last window was accepted; whether it was."""
        if self.remote and not self.exchange.ongoing():
            self.remote.finalize()
            self.remote = None
            if self.solver:
                self.solver.wait()
        return self.remote is None

    def save(self, folder):
        """Writes the bridge's state; at the end of the stage also what the solver saved."""
        if self.finish() and self.solver:
            self.solver.copy(folder)
        self.write(folder)

    def close(self):
        """Ends what still runs."""
        if self.remote:
            self.remote.kill()
            self.remote = None
        if self.solver:
            self.solver.end()


class StructureBridge(Bridge):
    """A structure behind preCICE: writes loads, reads the displacement of the canopy."""

    role = "structure"

    def prepare(self, case, run):
        """Displacements at the ends of the last two windows, and what the force on the payload needs."""
        self.reference = self.coords
        self.u = self.before = self.velocity = np.zeros_like(self.coords)
        self.trial = None
        self.length = 0.0  # of the last window, s
        if self.state:
            state = load_state(self.state)
            self.u = self.before = state["u"]
            self.velocity = state["velocity"]
        self.payload = bool(PAYLOAD.intersection(self.effects))
        if self.payload and case["scene"]["fabric_gravity"]:
            raise Fault(
                f"{self.program} estimates the force on the payload without the weight of the fabric: remove "
                f"[fabric_gravity] from the scene, or {' and '.join(sorted(PAYLOAD))} from --effects"
            )
        self.mass = moving_mass(case, self.surface)

    def advance(self, window, canopy, grid, output):
        # Forces need a shape, which must be the same in each iteration: that expected from the last two windows.
        step = window.dt / self.length if self.length else 0.0
        expected = self.coords + self.u + step * (self.u - self.before)
        data = [self.written(x, canopy[:, k]) for k, x in ((0, self.coords + self.u), (1, expected))]
        if np.array_equal(canopy[:, 0], canopy[:, 1]):
            data[0] = data[1]  # constant in the window
        u = self.exchange.solve(window, *data)["Displacement"]
        output[:] = u
        self.trial = u, (u - self.u) / window.dt
        return self.statistics(window, canopy)

    def statistics(self, window, canopy):
        """What follows from loads and displacements."""
        u, velocity = self.trial
        shapes = self.coords + self.u, self.coords + u
        forces = [self.surface.nodal(self.surface.forces(x, canopy[:, k])) for k, x in enumerate(shapes)]
        out = {
            "vertical_load": forces[1][:, 2].sum(),
            "projected_area": abs(self.surface.areas(shapes[1])[:, 2].sum()),
            "load_work": 0.5 * np.sum((forces[0] + forces[1]) * (u - self.u)),
        }
        if self.payload:
            damping = self.stage["mass_damping_per_s"] * velocity
            kept = np.sum(self.mass * ((velocity - self.velocity) / window.dt + damping), axis=0)
            out["support_force"] = 0.5 * (forces[0] + forces[1]).sum(axis=0) - kept
            out["momentum"] = np.sum(self.mass * velocity, axis=0)
        return out

    def written(self, x, load):
        """Data for preCICE of a load on the shape `x`."""
        if self.kind == "force":
            return {"Force": self.surface.nodal(self.surface.forces(x, load))}
        return {"Pressure": load[:, 0].copy(), "Traction": load[:, 1:].copy()}

    def accept(self, window):
        self.exchange.accept(window)
        self.before, self.length = self.u, window.dt
        self.u, self.velocity = self.trial

    def write(self, folder):
        save_state(folder, "structure", u=self.u, velocity=self.velocity)
        write_shape(folder, self.coords + self.u)


class FlowBridge(Bridge):
    """A flow behind preCICE: writes the displacement of the canopy since the start of the stage, reads the load."""

    role = "flow"

    def prepare(self, case, run):
        """Nodes of the canopy in the flow grid."""
        grid = case["grid"]
        self.nodes = np.array(grid["canopy_nodes"])
        self.reference = np.array(grid["coords"])[self.nodes]
        self.moving = self.stage["kind"] in ("coupled", "prescribed")
        self.grid_nodes = len(grid["coords"]) if self.moving else 0

    def grid_rows(self):
        return self.nodes if self.moving else np.arange(0)

    def advance(self, window, canopy, grid, output):
        x = grid[:, :3] if self.moving else self.reference
        velocity = np.tile(np.array(window.frame_velocity), (self.canopy_nodes, 1))
        end = {"Displacement": x - self.reference, "FrameVelocity": velocity}
        start = {name: np.zeros_like(values) for name, values in end.items()}
        response = self.exchange.solve(window, start, end)
        if self.kind == "force":
            load = self.surface.load(x, response["Force"])
        else:
            load = np.hstack([response["Pressure"][:, None], response["Traction"]])
        output[:] = load
        forces = self.surface.forces(x, load)
        moments = np.cross(self.surface.centres(x), forces)
        return {
            f"{name}_{axis}": total[k]
            for name, total in (("force", forces.sum(axis=0)), ("moment", moments.sum(axis=0)))
            for k, axis in enumerate("xyz")
        }

    def accept(self, window):
        self.exchange.accept(window)

    def write(self, folder):
        save_state(folder, "flow", nothing=np.zeros(1))


ROLES = {"structure": StructureBridge, "flow": FlowBridge}
