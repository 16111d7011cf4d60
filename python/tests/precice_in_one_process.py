"""The bridge to preCICE with the net or the flow of python/examples behind a stand-in for preCICE, in one process: a solver
program of Ripstop. Its options are those of `python -m ripstop.precice`; `--solver` is the kind of load."""

import sys
import threading
from pathlib import Path

import precice_stand_in

PYTHON = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(PYTHON), str(PYTHON / "examples")]
sys.modules["precice"] = precice_stand_in

import numpy as np  # noqa: E402
import precice_mass_spring  # noqa: E402
import precice_stagnation_flow  # noqa: E402
from ripstop.precice import __main__ as command, bridge  # noqa: E402


class Thread:
    """In place of `ripstop.precice.solver.Solver`: the solver in a thread."""

    def __init__(self, load, run, config, state, folder):
        folder.mkdir(parents=True)
        self.save_folder = folder
        if ROLE == "flow":
            couple, solver = precice_stagnation_flow.couple, precice_stagnation_flow.Air(run.case(grid=True))
            if state:
                solver.before = np.load(state / precice_stagnation_flow.STATE) - solver.start
        else:
            couple, solver = precice_mass_spring.couple, precice_mass_spring.Net(run.stage, str(run.scene), str(run.out))
            if state:
                with np.load(state / precice_mass_spring.STATE) as kept:
                    solver.u, solver.v = kept["u"], kept["v"]
        self.thread = threading.Thread(target=couple, args=(solver, str(config), load, folder), daemon=True)
        self.thread.start()

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


ROLE = sys.argv[1]
bridge.Solver, bridge.Remote = Thread, Local
command.main()
