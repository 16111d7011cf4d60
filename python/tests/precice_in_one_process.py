"""The bridge to preCICE with the net of python/examples behind a stand-in for preCICE, in one process: a solver program
of Ripstop. Its options are those of `python -m ripstop.precice`."""

import sys
import threading
from pathlib import Path

import precice_stand_in

PYTHON = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PYTHON), str(PYTHON / "examples")]
sys.modules["precice"] = precice_stand_in

import numpy as np  # noqa: E402
import precice_mass_spring as example  # noqa: E402
from ripstop.precice import __main__ as command, bridge  # noqa: E402


class Thread:
    """In place of `ripstop.precice.solver.Solver`: the net in a thread."""

    def __init__(self, options, run, config, state, folder):
        folder.mkdir(parents=True)
        self.save_folder, self.thread = folder, threading.Thread(target=self.couple, daemon=True)
        self.net = example.Net(run.stage, str(run.scene), str(run.out))
        if state:
            with np.load(state / example.STATE) as kept:
                self.net.u, self.net.v = kept["u"], kept["v"]
        self.config, self.load = str(config), options
        self.thread.start()

    def couple(self):
        example.couple(self.net, self.config, self.load)
        np.savez(self.save_folder / example.STATE, u=self.net.u, v=self.net.v)

    copy = bridge.Solver.copy

    def observe(self):
        """The stand-in limits its waits."""

    def wait(self):
        self.thread.join()

    def end(self):
        """The thread ends with the process."""


class Local(precice_stand_in.Participant):
    """In place of `ripstop.precice.worker.Remote`."""

    def __init__(self, name, config, observe):
        super().__init__(name, str(config), 0, 1)

    def kill(self):
        """Ends with the process."""


bridge.Solver, bridge.Remote = Thread, Local
command.main()
