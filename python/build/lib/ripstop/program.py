"""Runs the program `ripstop` for `ripstop.Scene` and `ripstop.results`."""

import collections
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

from .errors import RipstopError

# Lines of error output that a `RunError` contains.
LAST_LINES = 20


def find():
    """Path of the program `ripstop`: the variable RIPSTOP, the one on PATH, or that of the
    source checkout that contains this package. Raises `RipstopError` without one."""
    named = os.environ.get("RIPSTOP")
    built = Path(__file__).resolve().parents[2] / "target/release/ripstop"
    for candidate in [named] if named else ["ripstop", str(built)]:
        found = shutil.which(candidate)
        if found:
            return found
    where = f"the variable RIPSTOP names `{named}`" if named else f"it is neither on PATH nor at {built}"
    raise RipstopError(
        f"the program `ripstop` cannot be started: {where}. Build it with `cargo build --release`, "
        "and put its folder on PATH or its path into the variable RIPSTOP"
    )


def options(words):
    """Arguments of the command line from keyword arguments: `stop_after_windows=2` becomes
    `--stop-after-windows 2`, True a flag, False and None nothing, a list one option for each
    element, a dictionary `--ranks flow=2,mesh=1`."""
    arguments = []
    for name, value in words.items():
        option = "--" + name.strip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            arguments.append(option)
        elif isinstance(value, dict):
            arguments += [option, ",".join(f"{k}={v}" for k, v in value.items())]
        else:
            for each in value if isinstance(value, (list, tuple)) else [value]:
                arguments += [option, str(each)]
    return arguments


def output(*words):
    """Exit code, output and error output of a command that prints its result."""
    done = subprocess.run([find(), *map(str, words)], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def stream(command, quiet):
    """Runs `command`, passes its output to `sys.stdout` and `sys.stderr` (errors only, if
    quiet), and returns its exit code and the last lines of its error output.

    Ctrl-C interrupts the program once: it completes its window and saves. Then
    KeyboardInterrupt continues."""
    last = collections.deque(maxlen=LAST_LINES)
    # A group of its own: the terminal would send a second signal, which ends a run without saving.
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )

    def pass_on(pipe, target, kept):
        for line in pipe:
            if kept is not None:
                kept.append(line.rstrip("\n"))
            if target is not None:
                target.write(line)
                target.flush()

    pipes = [(child.stdout, None if quiet else sys.stdout, None), (child.stderr, None if quiet else sys.stderr, last)]
    threads = [threading.Thread(target=pass_on, args=pipe, daemon=True) for pipe in pipes]
    for thread in threads:
        thread.start()
    interrupted = None
    while True:
        try:
            child.wait()
            break
        except KeyboardInterrupt as error:
            interrupted = error
            child.send_signal(signal.SIGINT)
    for thread in threads:
        thread.join()
    child.stdout.close()
    child.stderr.close()
    if interrupted is not None:
        raise interrupted
    return child.returncode, list(last)
