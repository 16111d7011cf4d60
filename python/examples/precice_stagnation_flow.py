"""The flow of stagnation_flow.py as a participant of preCICE, behind the bridge `ripstop.precice`.

    python -m ripstop.precice flow --write-config SCENE --config 'precice-{stage}.xml'
    ripstop run SCENE --flow "python -m ripstop.precice flow --config 'precice-{stage}.xml'
        --solver 'python python/examples/precice_stagnation_flow.py'"

It reads the displacement of the canopy since the start of the stage and the velocity of the falling frame, and writes
pressure jump and traction on the faces. The velocity of the faces follows from the displacement at the end of the last
time window, which is its checkpoint.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import precice

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]  # found without installation
import ripstop  # noqa: E402
from ripstop.precice.surface import Surface  # noqa: E402
from stagnation_flow import COEFFICIENT, DENSITY  # noqa: E402

# Positions of the canopy at the end of the last time window, m.
STATE = "canopy.npy"


class Air:
    """The flow around a canopy: the displacement of its nodes at the end of the last time window is all its state."""

    def __init__(self, case):
        mesh, grid = case["structure"], case["grid"]
        self.surface = Surface(mesh["faces"], mesh["n_canopy"])
        self.start = np.array(grid["coords"])[np.array(grid["canopy_nodes"])]
        self.wind = np.array(case["scene"]["flow"]["wind_m_s"])
        self.before = np.zeros_like(self.start)

    def load(self, dt, displacement, frame_velocity):
        """Pressure jump and traction on the faces, `[faces][4]`, Pa."""
        area = self.surface.areas(self.start + displacement)
        normal = area / np.linalg.norm(area, axis=1)[:, None]
        velocity = self.surface.centres((displacement - self.before) / dt)
        u = (self.wind - frame_velocity)[2] - np.sum(velocity * normal, axis=1)
        load = np.zeros((len(area), 4))
        load[:, 0] = 0.5 * DENSITY * COEFFICIENT * np.abs(u) * u
        return load


def couple(air, config, load, save=""):
    """Couples the flow in one stage. Writes its state into the folder `save`, if there is one."""

    def keep():
        if save:
            np.save(Path(save) / STATE, air.start + air.before)

    participant = precice.Participant("Fluid", config, 0, 1)
    nodes = participant.set_mesh_vertices("Fluid-Nodes", air.start)
    faces = participant.set_mesh_vertices("Fluid-Faces", air.surface.centres(air.start))
    participant.initialize()
    while participant.is_coupling_ongoing():
        if participant.requires_writing_checkpoint():
            checkpoint = air.before
            keep()  # a run may be saved between windows
        dt = participant.get_max_time_step_size()
        displacement = participant.read_data("Fluid-Nodes", "Displacement", nodes, dt)
        frame_velocity = participant.read_data("Fluid-Nodes", "FrameVelocity", nodes, dt)[0]
        values = air.load(dt, displacement, frame_velocity)
        if load == "pressure":
            participant.write_data("Fluid-Faces", "Pressure", faces, values[:, 0])
            participant.write_data("Fluid-Faces", "Traction", faces, values[:, 1:])
        else:
            forces = air.surface.forces(air.start + displacement, values)
            participant.write_data("Fluid-Faces", "Force", faces, forces)
        participant.advance(dt)
        air.before = displacement
        if participant.requires_reading_checkpoint():
            air.before = checkpoint
    participant.finalize()
    keep()


def main():
    """Couples one stage; the bridge names it by its variables."""
    parser = argparse.ArgumentParser(description="A flow model of one equation behind preCICE.")
    variables = {name: os.environ.get(f"RIPSTOP_{name.upper()}") for name in ("scene", "stage", "out", "precice_config")}
    for name, value in variables.items():
        parser.add_argument(f"--{name.replace('_', '-')}", default=value, required=value is None)
    parser.add_argument("--load", choices=("pressure", "force"), default="pressure", help="as that of the bridge")
    options = parser.parse_args()
    words = ["--scene", options.scene, "--stage", options.stage, "--session", "-", "--out", options.out, "--ranks", "1"]
    air = Air(ripstop.Run(words).case(grid=True))
    if os.environ.get("RIPSTOP_STATE"):
        air.before = np.load(Path(os.environ["RIPSTOP_STATE"]) / STATE) - air.start
    couple(air, options.precice_config, options.load, os.environ.get("RIPSTOP_SAVE"))


if __name__ == "__main__":
    main()
