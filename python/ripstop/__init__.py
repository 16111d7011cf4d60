"""Solver programs of Ripstop in Python: see README.md next to this package."""

from .contract import STATISTICS, Fault, Window
from .participant import Participant, Run, load_state, save_state, write_shape
from .serve import main, serve

__all__ = [
    "STATISTICS",
    "Fault",
    "Participant",
    "Run",
    "Window",
    "load_state",
    "main",
    "save_state",
    "serve",
    "write_shape",
]
