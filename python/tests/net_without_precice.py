"""The net of python/examples as a solver program of Ripstop without preCICE, with what the bridge to preCICE reports: loads at
the end of the window throughout, no force on the payload. Its responses equal those through the bridge in every digit."""

import sys
from pathlib import Path

import precice_stand_in

PYTHON = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PYTHON), str(PYTHON / "examples")]
sys.modules["precice"] = precice_stand_in  # imported by the example, not used here

import ripstop  # noqa: E402
from mass_spring import MassSpring  # noqa: E402
from precice_mass_spring import Net  # noqa: E402


class Direct(MassSpring):
    effects = ("fabric.wrinkling", "lines")

    def advance(self, window, canopy, grid, output):
        Net.solve(self, window.dt, lambda x, t: self.push(x, canopy[:, 1])[0])
        output[:] = self.trial[0][: self.canopy_nodes]

    def accept(self, window):
        Net.complete(self, window.dt)


ripstop.main(Direct)
