"""Errors of the bridge to preCICE. Each is a `Fault`: it becomes the one error of the run."""

from ..contract import Fault


class PreciceMissing(Fault):
    """The module `precice` cannot be imported."""

    def __init__(self, cause):
        super().__init__(
            f"preCICE cannot be imported ({cause}): install the library preCICE 3 "
            "(https://precice.org/installation-overview.html), then its Python bindings with "
            "`pip install pyprecice` into the Python that runs `ripstop.precice`"
        )


class PreciceError(Fault):
    """preCICE reported an error or ended its process."""


class ConfigError(Fault):
    """A `precice-config.xml` with which windows of Ripstop cannot be coupled."""


class CouplingError(Fault):
    """preCICE and Ripstop disagree about a window."""


class SolverEnded(Fault):
    """The external solver ended before the stage did."""
