"""The external solver, where the bridge starts it (`--solver`)."""

import io
import os
import shlex
import shutil
import signal
import subprocess
import time
import zipfile

import numpy as np

from .errors import SolverEnded
from .worker import end_with_parent, no_rank

# Longest wait for the end of the solver after the last window, s.
END_S = 60.0

# Seconds between SIGTERM and SIGKILL, and between the good end of the solver and that of preCICE here.
GRACE_S = 5.0

# Where the output of the solver is.
LOG = ": see the log of this program"

# Folders of a stage: what the solver starts from, and what it saves.
STATE, SAVE = "precice-state", "precice-save"


def packed(folder):
    """The files below `folder` as an array of bytes (a zip archive), which a saved state contains."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w") as archive:
        for path in sorted(folder.rglob("*")):
            archive.write(path, path.relative_to(folder))
    return np.frombuffer(memory.getvalue(), dtype=np.uint8)


def unpack(files, folder):
    """Writes what `packed` returned below `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    with zipfile.ZipFile(io.BytesIO(files.tobytes())) as archive:
        archive.extractall(folder)


class Solver:
    """A child process. Its variables: RIPSTOP_SCENE, RIPSTOP_STAGE (number), RIPSTOP_OUT, RIPSTOP_PRECICE_CONFIG,
    RIPSTOP_STATE (folder with what it saved earlier; empty in the first stage), RIPSTOP_SAVE (folder for what it needs to
    continue, written at each checkpoint and at its end)."""

    def __init__(self, command, run, config, state, folder):
        self.command, self.save_folder, self.ended = command, folder, None
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
        """Refuses to wait for a solver that has ended. After the last window it may end before preCICE returns here."""
        code = self.child.poll()
        if code is None:
            return
        self.ended = self.ended or time.monotonic()
        if code != 0 or time.monotonic() - self.ended > GRACE_S:
            # OpenFOAM, for one, only warns of an adapter that it does not find.
            alone = " (without its adapter a solver computes and ends by itself: was it loaded?)" if code == 0 else ""
            raise SolverEnded(f"the solver `{self.command}` ended with code {code} before the stage did{alone}{LOG}")

    def wait(self):
        """Waits for the end of the solver after the last window."""
        try:
            code = self.child.wait(END_S)
        except subprocess.TimeoutExpired:
            self.end()
            where = f"the solver `{self.command}` did not end within {END_S:.0f} s after the last window"
            raise SolverEnded(f"{where}{LOG}") from None
        if code != 0:
            raise SolverEnded(f"the solver `{self.command}` ended with code {code} after the last window{LOG}")

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
