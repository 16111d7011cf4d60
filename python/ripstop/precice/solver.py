"""The external solver, where the bridge starts it (`--solver`)."""

import os
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path

from .errors import SolverEnded
from .worker import end_with_parent, no_rank

# Longest wait for the end of the solver after the last window, s.
END_S = 60.0

# Seconds between SIGTERM and SIGKILL.
GRACE_S = 5.0

# Name of the folder below a saved state that has the files of the solver.
FILES = "precice-solver"


class Solver:
    """A child process. Its variables: RIPSTOP_SCENE, RIPSTOP_STAGE (number), RIPSTOP_OUT, RIPSTOP_PRECICE_CONFIG,
    RIPSTOP_STATE (folder of what it wrote in the last stage of its role; empty in the first), RIPSTOP_SAVE (empty folder for
    what it needs in the next one)."""

    def __init__(self, command, run, config, state, folder):
        self.command, self.save_folder = command, folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        names = {
            "SCENE": run.scene,
            "STAGE": run.stage,
            "OUT": run.out,
            "PRECICE_CONFIG": config,
            "STATE": state or "",
            "SAVE": folder,
        }
        variables = {f"RIPSTOP_{name}": str(value) for name, value in names.items()}
        try:
            self.child = subprocess.Popen(
                shlex.split(command),
                env=no_rank(os.environ) | variables,
                stdin=subprocess.DEVNULL,
                preexec_fn=lambda: end_with_parent(signal.SIGTERM),
            )
        except OSError as error:
            raise SolverEnded(f"the solver `{command}` cannot be started: {error}") from error

    def observe(self):
        """Refuses to wait for a solver that has ended."""
        code = self.child.poll()
        if code is not None:
            raise SolverEnded(f"the solver `{self.command}` ended with code {code} before the stage did: see the log of this program")

    def wait(self):
        """Waits for the end of the solver after the last window."""
        try:
            code = self.child.wait(END_S)
        except subprocess.TimeoutExpired:
            self.end()
            raise SolverEnded(f"the solver `{self.command}` did not end within {END_S:.0f} s after the last window") from None
        if code != 0:
            raise SolverEnded(f"the solver `{self.command}` ended with code {code} after the last window: see the log of this program")

    def copy(self, folder):
        """Copies what the solver saved below the saved state `folder`."""
        shutil.copytree(self.save_folder, Path(folder) / FILES, dirs_exist_ok=True)

    def end(self):
        """Ends the solver if it still runs."""
        if self.child.poll() is None:
            self.child.terminate()
            limit = time.monotonic() + GRACE_S
            while self.child.poll() is None and time.monotonic() < limit:
                time.sleep(0.05)
            if self.child.poll() is None:
                self.child.kill()
                self.child.wait()
