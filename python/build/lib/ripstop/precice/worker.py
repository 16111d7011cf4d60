"""preCICE in a process of its own.

A call of preCICE waits for the other participant without limit and without releasing Python. In a process of its own
it can wait while the bridge observes the coupler and the solver. The process ends with the bridge, however that ends.
"""

import ctypes
import multiprocessing
import os
import signal
import time

from .errors import PreciceError, PreciceMissing

# Seconds between two looks at the solver while preCICE waits.
LOOK_S = 0.2

# Looks at the solver after preCICE failed.
LOOKS = 5

# From <sys/prctl.h>: the signal that a process receives when its parent ends.
PR_SET_PDEATHSIG = 1


# Beginnings of the variables by which a process started by `mpirun` knows its rank.
MPI_RANK = ("OMPI_COMM_", "OMPI_MCA_ess", "OMPI_MCA_orte", "OMPI_UNIVERSE", "PMIX_", "PMI_")


def no_rank(variables):
    """Variables without the rank of this process: a child that uses MPI is not that rank."""
    return {name: value for name, value in variables.items() if not name.startswith(MPI_RANK)}


def end_with_parent(how):
    """Asks the kernel to send the signal `how` to this process when its parent ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, how, 0, 0, 0)


def serve(pipe, parent, name, config):
    """Carries out calls that come through `pipe` on a `precice.Participant`."""
    end_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the coupler decides what an interrupt means
    if os.getppid() != parent:
        return
    for variable in set(os.environ) - set(no_rank(os.environ)):
        del os.environ[variable]  # the Python bindings start MPI
    try:
        import precice
    except ImportError as error:
        pipe.send(("missing", str(error)))
        return
    try:
        participant = precice.Participant(name, config, 0, 1)
        pipe.send(("done", None))
        while True:
            method, arguments = pipe.recv()
            pipe.send(("done", getattr(participant, method)(*arguments)))
            if method == "finalize":
                return
    except EOFError:
        return
    except Exception as error:
        pipe.send(("failed", str(error) or type(error).__name__))


class Remote:
    """A `precice.Participant` in another process: the methods are those of preCICE.

    `observe` is called while preCICE waits; what it raises ends the call."""

    def __init__(self, name, config, observe=lambda: None):
        context = multiprocessing.get_context("spawn")
        self._observe = observe
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=serve, args=(there, os.getpid(), name, str(config)), daemon=True)
        self._process.start()
        there.close()
        self._result("the start")

    def __getattr__(self, method):
        if method.startswith("_"):
            raise AttributeError(method)

        def call(*arguments):
            try:
                self._pipe.send((method, arguments))
            except OSError as error:
                raise PreciceError(f"the process of preCICE ended before `{method}`: see the log of this program") from error
            return self._result(f"`{method}`")

        return call

    def _result(self, what):
        try:
            while not self._pipe.poll(LOOK_S):
                self._observe()
            kind, value = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join(5.0)
            code = self._process.exitcode
            raise PreciceError(
                f"the process of preCICE ended in {what} with code {code}: see the log of this program"
            ) from None
        if kind == "missing":
            raise PreciceMissing(value)
        if kind == "failed":
            for _ in range(LOOKS):  # the end of the solver explains a lost connection
                self._observe()
                time.sleep(LOOK_S)
            raise PreciceError(f"preCICE failed in {what}: {value}")
        return value

    def kill(self):
        """Ends the process without a word to preCICE."""
        self._process.kill()
        self._process.join()
