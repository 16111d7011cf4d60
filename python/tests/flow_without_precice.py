"""The flow of python/examples/precice_stagnation_flow.py as a solver program of Ripstop without preCICE. Its responses equal
those through the bridge in every digit."""

import sys
from pathlib import Path

import precice_stand_in

PYTHON = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PYTHON), str(PYTHON / "examples")]
sys.modules["precice"] = precice_stand_in  # imported by the example, not used here

import numpy as np  # noqa: E402
import ripstop  # noqa: E402
from precice_stagnation_flow import Air  # noqa: E402


class Direct(ripstop.Participant):
    role = "flow"

    def __init__(self, run):
        case = run.case(grid=True)
        self.air = Air(case)
        self.faces, self.canopy_nodes = np.array(case["structure"]["faces"]), case["structure"]["n_canopy"]
        self.nodes = np.array(case["grid"]["canopy_nodes"])
        self.moving = case["scene"]["stage"][run.stage]["kind"] == "coupled"
        self.grid_nodes = len(case["grid"]["coords"]) if self.moving else 0

    def grid_rows(self):
        return self.nodes if self.moving else np.arange(0)

    def advance(self, window, canopy, grid, output):
        self.trial = grid[:, :3] - self.air.start if self.moving else np.zeros_like(self.air.start)
        output[:] = self.air.load(window.dt, self.trial, np.array(window.frame_velocity))
        x = self.air.start + self.trial
        force = self.air.surface.forces(x, output).sum(axis=0)
        return dict(zip(("force_x", "force_y", "force_z"), force))

    def accept(self, window):
        self.air.before = self.trial

    def save(self, folder):
        ripstop.save_state(folder, "flow", nothing=np.zeros(1))


ripstop.main(Direct)
