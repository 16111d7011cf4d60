"""Solver programs of Ripstop that hand their work to a participant of preCICE."""

import shutil
from pathlib import Path

import numpy as np

from ..contract import Fault, Window
from ..participant import Participant, load_state, save_state, write_shape
from . import config
from .config import FACES, NODES
from .errors import CouplingError
from .exchange import Exchange, Field
from .solver import SAVE, STATE, Solver, packed, unpack
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
        self.effects = tuple(options.effects)
        self.solver = self.remote = self.last = None
        scene = run.case()["scene"]
        if self.role == "flow" and scene["flow"]["immersed"]:
            raise Fault(f"{self.program} needs a mesh-mover, which scenes with [flow.immersed] have not: remove that table")
        case = run.case(grid=self.role == "flow")
        mesh = case["structure"]
        self.stage = scene["stage"][run.stage]
        self.faces, self.canopy_nodes = np.array(mesh["faces"]), mesh["n_canopy"]
        self.surface = Surface(self.faces, self.canopy_nodes)
        self.coords = np.array(mesh["coords"])[: self.canopy_nodes]
        self.kind = options.load
        file = Path(config.path_of(options.config, self.stage["name"])).resolve()
        self.fixed_frame = options.fixed_frame
        config.check(file, self.role, self.kind, scene, self.fixed_frame)
        self.linear = config.degree(scene, self.role) == 1
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
            work = (run.out / self.stage["name"]).resolve()
            state = self.unpack(work / STATE)
            for left in config.connection_folders(file):
                shutil.rmtree(left, ignore_errors=True)  # of a run that was killed: preCICE would refuse to start
            self.solver = Solver(options.solver, run, file, state, work / SAVE)
        self.remote = Remote(config.NAME, file, self.observe)
        positions = {NODES: self.reference, FACES: self.surface.centres(self.reference)}
        fields = config.fields(self.role, self.kind, self.fixed_frame)
        writes, reads = ([Field(*of) for of in some] for some in fields)
        used = {f.mesh for f in writes + reads}
        meshes = {name: at for name, at in positions.items() if name in used}
        triangles = {NODES: self.surface.triangles()} if NODES in used else {}
        self.exchange = Exchange(self.remote, meshes, writes, reads, triangles, self.linear, options.repeat_tolerance)

    def unpack(self, folder):
        """Writes the files that the solver saved in an earlier stage below `folder`; None in the first stage."""
        if not self.state:
            return None
        files = load_state(self.state).get("solver")
        if files is None:
            raise Fault(
                f"{self.state} has no files of the solver behind preCICE: it must write what it needs to continue into the "
                "folder that its variable RIPSTOP_SAVE names, at each checkpoint and at its end"
            )
        unpack(files, folder)
        return folder

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

    def accept(self, window):
        self.exchange.accept(window)
        self.last = Window.from_buffer_copy(window)

    def save(self, folder):
        """Writes the bridge's state and what the solver saved."""
        files = {}
        if not self.finish() and self.last:
            self.exchange.complete(self.last)
        if self.solver and any(self.solver.save_folder.iterdir()):
            files["solver"] = packed(self.solver.save_folder)
        self.write(folder, files)

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
            if run.resume:
                self.before, self.length = state["before"], float(state["length"])
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
        if not self.linear:
            data[0] = data[1] if np.array_equal(canopy[:, 0], canopy[:, 1]) else data[0]  # forces depend on the shape
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
        super().accept(window)
        self.before, self.length = self.u, window.dt
        self.u, self.velocity = self.trial

    def write(self, folder, files):
        save_state(folder, "structure", u=self.u, velocity=self.velocity, before=self.before, length=self.length, **files)
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
        self.begin = self.trial = None  # data at the start and at the end of the window
        state = load_state(self.state) if self.state else {}
        if "positions" in state:
            velocity = state["frame_velocity"]
            self.begin = {"Displacement": state["positions"] - self.reference, "FrameVelocity": velocity}

    def grid_rows(self):
        return self.nodes if self.moving else np.arange(0)

    def advance(self, window, canopy, grid, output):
        x = grid[:, :3] if self.moving else self.reference
        velocity = np.tile(self.frame_velocity(window), (self.canopy_nodes, 1))
        self.trial = {"Displacement": x - self.reference, "FrameVelocity": velocity}
        self.begin = self.begin or self.trial | {"Displacement": np.zeros_like(self.reference)}
        response = self.exchange.solve(window, self.begin, self.trial)
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

    def frame_velocity(self, window):
        """Velocity of the frame, `[3]`, m/s. A velocity other than zero is refused where the solver does not read it."""
        velocity = np.array(window.frame_velocity)
        if self.fixed_frame and velocity.any():
            speed = np.linalg.norm(velocity)
            raise CouplingError(
                f"the frame of the scene moves with {speed:.3g} m/s in window {window.index}, but with --fixed-frame the solver "
                "behind preCICE does not read its velocity: choose a scene whose payload does not move, or a solver that reads "
                f"`{config.FRAME_VELOCITY}`, and write the configuration without --fixed-frame"
            )
        return velocity

    def accept(self, window):
        super().accept(window)
        self.begin = self.trial

    def write(self, folder, files):
        if self.begin:
            files["positions"] = self.reference + self.begin["Displacement"]
            files["frame_velocity"] = self.begin["FrameVelocity"]
        save_state(folder, "flow", **files)


ROLES = {"structure": StructureBridge, "flow": FlowBridge}
