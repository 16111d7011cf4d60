"""The net of mass_spring.py as a participant of preCICE, behind the bridge `ripstop.precice`.

    python -m ripstop.precice structure --write-config SCENE --config 'precice-{stage}.xml'
    ripstop run SCENE --structure "python -m ripstop.precice structure --config 'precice-{stage}.xml'
        --effects fabric.wrinkling,lines --solver 'python python/examples/precice_mass_spring.py'"

It shows what an adapter does: it holds a checkpoint, repeats a window when preCICE asks for it, and reads the load within
the window as preCICE interpolates it. It knows nothing of the coupling scheme. What depends on Ripstop is the scene, from
which it takes its net, and the folders in which it keeps its state from one stage to the next.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import precice

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]  # found without installation
import ripstop  # noqa: E402
from mass_spring import MassSpring  # noqa: E402
from ripstop.precice.surface import Surface  # noqa: E402

STATE = "net.npz"


class Net(MassSpring):
    """The net of one stage: the state of the last complete time window, and that of the present one."""

    def __init__(self, stage, scene, out):
        words = ["--scene", scene, "--stage", str(stage), "--session", "-", "--out", out, "--ranks", "1"]
        self.run = ripstop.Run(words)
        self.run.state = lambda case, role: None  # its state is in a file of its own
        super().__init__(self.run)

    def solve(self, dt, forces):
        """Computes a time step of `dt` seconds; `forces(x, t)` on the nodes (N) of the shape `x`, `t` seconds into it."""
        steps = max(self.stage["substeps"], int(np.ceil(dt / self.stable)))
        h = dt / steps
        keep = 1 / (1 + h * self.stage["mass_damping_per_s"])
        u, v = self.u.copy(), self.v.copy()
        for step in range(steps):
            x = self.rest_shape + u
            v = keep * (v + h * self.per_mass * (forces(x, (step + 0.5) / steps * dt) + self.pull(x)[0]))
            u += h * v
        self.trial = u, v

    def complete(self, dt):
        """The present time step is final."""
        u, v = self.trial
        v += self.average * ((u - self.u) / dt - v)
        self.u, self.v = u, v


def couple(net, config, load, save=""):
    """Couples the net in one stage. Writes its state into the folder `save`, if there is one."""

    def keep():
        if save:
            np.savez(Path(save) / STATE, u=net.u, v=net.v)

    canopy = net.rest_shape[: net.canopy_nodes]
    participant = precice.Participant("Solid", config, 0, 1)
    nodes = participant.set_mesh_vertices("Solid-Nodes", canopy)
    if load == "pressure":
        faces = participant.set_mesh_vertices("Solid-Faces", Surface(net.faces, net.canopy_nodes).centres(canopy))

    def forces(x, t):
        if load == "pressure":
            pressure = participant.read_data("Solid-Faces", "Pressure", faces, t)
            traction = participant.read_data("Solid-Faces", "Traction", faces, t)
            return net.push(x, np.hstack([pressure[:, None], traction]))[0]
        out = np.zeros_like(x)
        out[: net.canopy_nodes] = participant.read_data("Solid-Nodes", "Force", nodes, t)
        return out

    participant.initialize()
    while participant.is_coupling_ongoing():
        if participant.requires_writing_checkpoint():
            checkpoint = net.u.copy(), net.v.copy()
            keep()  # a run may be saved between windows
        dt = participant.get_max_time_step_size()
        net.solve(dt, forces)
        participant.write_data("Solid-Nodes", "Displacement", nodes, net.trial[0][: net.canopy_nodes])
        participant.advance(dt)
        net.complete(dt)
        if participant.requires_reading_checkpoint():
            net.u, net.v = checkpoint
    participant.finalize()
    keep()


def main():
    """Couples one stage; the bridge names it by its variables."""
    parser = argparse.ArgumentParser(description="A net of masses and springs behind preCICE.")
    variables = {name: os.environ.get(f"RIPSTOP_{name.upper()}") for name in ("scene", "stage", "out", "precice_config")}
    for name, value in variables.items():
        parser.add_argument(f"--{name.replace('_', '-')}", default=value, required=value is None)
    parser.add_argument("--load", choices=("pressure", "force"), default="pressure", help="as that of the bridge")
    options = parser.parse_args()
    net = Net(options.stage, options.scene, options.out)
    state, save = (os.environ.get(f"RIPSTOP_{name}") for name in ("STATE", "SAVE"))
    if state:
        with np.load(Path(state) / STATE) as kept:
            net.u, net.v = kept["u"], kept["v"]
    couple(net, options.precice_config, options.load, save)


if __name__ == "__main__":
    main()
