"""Solver programs of Ripstop in Python: see README.md beside this package."""

from .contract import STATISTICS, Fault, Window
from .participant import Participant, Run, write_shape
from .serve import main, serve

__all__ = ["STATISTICS", "Fault", "Participant", "Run", "Window", "main", "serve", "write_shape"]
