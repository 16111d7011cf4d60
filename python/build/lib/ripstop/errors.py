"""Errors of `ripstop.results` and `ripstop.Scene`."""

import importlib


class RipstopError(Exception):
    """An error with its place, its cause and its remedy in the message."""


class ResultsError(RipstopError):
    """Results that cannot be read. `path` is the file or folder, `line` the line in it
    (from 1) or None."""

    def __init__(self, path, what, remedy, line=None):
        self.path, self.line = path, line
        place = f"{path}:{line}" if line else f"{path}"
        super().__init__(f"{place}: {what}; {remedy}")


class SceneError(RipstopError):
    """A scene that is invalid, or a key that it does not have. `code` is the exit code of
    `ripstop` where the program refused the scene, else None."""

    def __init__(self, message, code=None):
        self.code = code
        super().__init__(message)


class RunError(RipstopError):
    """`ripstop` failed. `code` is its exit code (docs/reference/command-line.md), `command`
    the list of its words, `lines` the last lines of its error output, `folder` the
    results, which are kept, and `table` what a sweep collected (else None)."""

    def __init__(self, command, code, lines, folder, table=None):
        self.command, self.code, self.lines, self.folder, self.table = command, code, lines, folder, table
        meaning = {1: "failed", 2: "refused its input", 3: "found a difference", 130: "was interrupted"}
        what = meaning.get(code, "was ended by a signal" if code < 0 else "failed")
        last = "\n".join(lines) or "(no error output; see ripstop.log in the folder of results)"
        kept = "" if code == 2 else f"; results so far: {folder}"
        super().__init__(f"`ripstop {command[1]}` {what} with exit code {code}{kept}\n{last}")


def need(module, user, install="pip install ./python"):
    """The imported `module`, which `user` needs."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"{user} needs {module.partition('.')[0]}, which cannot be imported ({error}): "
            f"run `{install}` in a checkout of Ripstop"
        ) from error
