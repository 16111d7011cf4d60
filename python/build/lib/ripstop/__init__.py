"""Ripstop in Python: solver programs (`Participant`, `main`), results of runs
(`ripstop.results`) and scenes (`ripstop.Scene`). See README.md next to this package.

Each name is imported at its first use: results and scenes need no iceoryx2, and solver
programs no pandas."""

import importlib

# Public names by module.
_NAMES = {
    "contract": ("STATISTICS", "Fault", "Window"),
    "participant": ("Participant", "Run", "load_state", "save_state", "write_shape"),
    "server": ("main", "serve"),
    "errors": ("ResultsError", "RipstopError", "RunError", "SceneError"),
    "scene": ("Scene",),
}
_MODULE = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted([*_MODULE, "results"])


def __getattr__(name):
    if name == "results":
        return importlib.import_module(".results", __name__)
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULE[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted({*globals(), *__all__})
