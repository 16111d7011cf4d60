"""Interface of a solver program: `Participant`, and its arguments, `Run`."""

import argparse
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np

from .contract import Fault, shape_bytes


class Participant:
    """A solver program: subclass it and give it to `ripstop.main`.

    A window is `advance`, once or more, always from the state of the last accepted
    window, then `accept`. Raise `Fault` (or anything else) to end the run: the
    coupler prints its message. docs/reference/participants.md: shapes, signs and statistics.
    """

    role = ""  # "structure", "flow" or "mesh"
    program = ""  # name for messages; the class's if empty
    version = "0"
    effects = ()  # keys of the scene whose physics this program has, see docs/reference/contract.md
    canopy_nodes = 0
    faces = ()  # of the canopy, [faces][4] node numbers in the order of the scene's mesh
    grid_nodes = 0  # of the whole flow grid, for mesh and flow on a moving grid

    def output_rows(self):
        """Rows of this rank's output: canopy nodes (structure), canopy faces (flow),
        grid nodes (mesh). All of them, if not overridden."""
        rows = {"structure": self.canopy_nodes, "flow": len(self.faces), "mesh": self.grid_nodes}
        return np.arange(rows[self.role])

    def grid_rows(self):
        """Grid nodes that this rank reads (flow on a moving grid)."""
        return np.arange(0)

    def advance(self, window, canopy, grid, output):
        """Computes `window` and fills `output`, an array in shared memory.

        `canopy` (read-only, valid during the call) is by role: structure
        `[faces][2][4]`, pressure jump and traction (Pa) at start and end of the window;
        mesh `[nodes][3]`, displacement from the unstressed shape (m); flow: empty.
        `grid` is `[grid_rows][6]`, position (m) and velocity (m/s), for the flow.
        `output` has a row for each of `output_rows`: displacement (structure), pressure
        jump and traction (flow), position and velocity (mesh). Returns statistics by
        their names in `ripstop.STATISTICS[role]`, or None."""
        raise NotImplementedError

    def accept(self, window):
        """The last `advance` is final: later windows start from it."""
        raise NotImplementedError

    def save(self, folder):
        """Writes the accepted state below `folder` (exists): a later stage, or run,
        starts from it. A structure writes the canopy too: `write_shape`.

        A program that has the effect "resume" restarts from it within a stage
        too: it starts from the file that `Run.state` names."""

    def snapshot(self, time, folder):
        """Adds pictures of the accepted state to `folder`."""


class Run:
    """The arguments that the coupler passes, and what follows from them."""

    def __init__(self, words=None):
        parser = argparse.ArgumentParser(
            description="A solver program of Ripstop, started by `ripstop run` or by hand together with `ripstop attach`."
        )
        parser.add_argument("--scene", required=True, type=Path, metavar="PATH", help="scene file")
        parser.add_argument("--stage", required=True, type=int, metavar="N", help="stage, from 0")
        parser.add_argument("--session", required=True, metavar="NAME", help="session of the coupler")
        parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
        parser.add_argument("--ranks", required=True, type=int, metavar="N", help="processes of this program")
        parser.add_argument("--resume", type=Path, metavar="DIR", help="state in the middle of the stage")
        parser.add_argument("--deadline-s", type=float, metavar="S", help="longest silence of the coupler")
        parser.parse_args(words, namespace=self)
        # Each process is a rank; whoever started them numbers them.
        names = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID")
        self.rank = int(next((os.environ[n] for n in names if n in os.environ), 0))

    def state(self, case, role):
        """File of the state to start from, or None: where a run is resumed (`--resume`)
        the one in the middle of this stage, else that of an earlier stage, as `case`
        (from `Run.case`) has it."""
        if self.resume is not None:
            return self.resume / f"{role}.bin"
        return case["states"].get(role)

    def case(self, grid=False, settings=()):
        """What `ripstop mesh` says of this stage: `scene` (with defaults), `structure`
        (the mesh), `states` (files to start from, by role) and, if asked for, `grid`.
        `settings`: values that replace those of the scene, each `KEY=VALUE`."""
        built = Path(__file__).resolve().parents[2] / "target/release/ripstop"
        ripstop = os.environ.get("RIPSTOP") or shutil.which("ripstop") or str(built)
        words = [ripstop, "mesh", str(self.scene), "--stage", str(self.stage), "--out", str(self.out)]
        words += [word for setting in settings for word in ("--set", setting)]
        try:
            done = subprocess.run(words + ["--grid"] * grid, capture_output=True, text=True, check=False)
        except FileNotFoundError as error:
            raise Fault(f"`{ripstop}` does not exist: name the program `ripstop` in the variable RIPSTOP") from error
        if done.returncode != 0:
            raise Fault(f"`{' '.join(words)}` failed: {done.stderr.strip()}")
        return json.loads(done.stdout)


def save_state(folder, role, **arrays):
    """Writes arrays as the state of `role` below `folder`."""
    with open(Path(folder, f"{role}.bin"), "wb") as file:
        np.savez(file, **arrays)


def load_state(path):
    """Arrays by their names, as `save_state` wrote them."""
    try:
        with np.load(path) as state:
            return dict(state)
    except (OSError, ValueError) as error:
        why = f" ({error})" if isinstance(error, OSError) else ""
        raise Fault(
            f"{path} is not a state of this program{why}: run the earlier stage with this program too"
        ) from error


def write_shape(folder, positions):
    """Writes the canopy's positions `[nodes][3]` (m, falling frame) below `folder`: the
    flow grid of later stages is built around them."""
    Path(folder, "canopy.bin").write_bytes(shape_bytes(positions))
