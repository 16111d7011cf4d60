"""The saved state of a stage."""

import datetime
import struct
from pathlib import Path

import numpy as np

from ..contract import fnv
from ..errors import ResultsError, need

# First eight bytes of an archive of `ripstop`, then its version (docs/reference/saved-states.md).
_HEAD = struct.Struct("<8sIQQ")


class State:
    """A checkpoint: the folder `state` of a stage, or `state.old` where that is incomplete.

    Archives of the programs of Ripstop are for restarts only, and their form may change
    between versions: `files` describes them. Readable are the shape of the canopy
    (`canopy`) and states that a Python program wrote with `ripstop.save_state` (`arrays`).
    """

    def __init__(self, folder, history=None):
        self.folder = Path(folder)
        self._history = history

    def __repr__(self):
        return f"<State at {self.time_s} s in {self.folder}>"

    @property
    def time_s(self):
        """Time of the checkpoint since the start of the stage, s."""
        path = self.folder / "time.toml"
        tomlkit = need("tomlkit", "ripstop.results")
        try:
            return float(tomlkit.parse(path.read_text())["time_s"])
        except FileNotFoundError:
            raise ResultsError(path, "there is no such file", "resume the run: it skips an incomplete state") from None
        except (tomlkit.exceptions.TOMLKitError, TypeError, ValueError) as error:
            raise ResultsError(path, f"it contains no time ({error})", "resume the run from an earlier state") from None

    @property
    def windows(self):
        """Accepted windows at the checkpoint: rows of `history.csv` up to its time."""
        return int((self._history()["time_s"] <= self.time_s * (1 + 1e-9)).sum())

    @property
    def saved(self):
        """Local date and time at which the checkpoint was complete, a `datetime`."""
        return datetime.datetime.fromtimestamp((self.folder / "seal.bin").stat().st_mtime)

    @property
    def files(self):
        """Files by name: `bytes`, and of an archive of Ripstop its `kind` and `version`; of
        others, such as those of a Python program, both are None."""
        found = {}
        for path in sorted(self.folder.iterdir()):
            with open(path, "rb") as file:
                head = file.read(_HEAD.size)
            kind, version = None, None
            if len(head) == _HEAD.size:
                name, number, length, _ = _HEAD.unpack(head)
                name = name.rstrip(b"\0")
                if _HEAD.size + length == path.stat().st_size and name.isalnum():
                    kind, version = name.decode(), number
            found[path.name] = {"bytes": path.stat().st_size, "kind": kind, "version": version}
        return found

    def canopy(self):
        """Positions of the canopy nodes `[nodes][3]`, m, in the falling frame. Raises
        `ResultsError`: no such file (a stage without the structure), or a damaged one."""
        path = self.folder / "canopy.bin"
        try:
            return _shape(path.read_bytes())
        except FileNotFoundError:
            raise ResultsError(
                path, "there is no shape: the stage runs without the structure", "read the state of another stage"
            ) from None
        except ValueError as error:
            raise ResultsError(path, f"the shape is damaged ({error})", "repeat the stage") from None

    def arrays(self, role):
        """Arrays by name that a Python program of this role ("structure", "flow" or "mesh")
        saved with `ripstop.save_state`. Raises `ResultsError`: a file of another form."""
        path = self.folder / f"{role}.bin"
        try:
            with np.load(path, allow_pickle=False) as state:
                return dict(state)
        except FileNotFoundError:
            have = ", ".join(sorted(p.name for p in self.folder.glob("*.bin")))
            raise ResultsError(path, f"there is no such state; the folder has: {have}", "name another role") from None
        except (OSError, ValueError) as error:
            raise ResultsError(
                path,
                f"it is no state of a Python program ({error})",
                "use canopy() and the snapshots: states of Ripstop's own programs are for restarts only",
            ) from None


def last_state(stage_folder, history):
    """The complete checkpoint that a restart uses, or None."""
    for name in ("state", "state.old"):
        folder = Path(stage_folder) / name
        if (folder / "seal.bin").is_file():
            return State(folder, history)
    return None


def _shape(data):
    """Positions in the bytes of `canopy.bin` (docs/reference/contract.md)."""
    if not data.startswith(b"ripshape"):
        raise ValueError("it does not begin with `ripshape`")
    at, numbers = 8, []
    for _ in range(4):
        form, size, skip = {251: ("<H", 2, 1), 252: ("<I", 4, 1), 253: ("<Q", 8, 1)}.get(
            data[at] if at < len(data) else 0, ("<B", 1, 0)
        )
        if len(data) < at + skip + size:
            raise ValueError("it ends within its head")
        numbers.append(struct.unpack_from(form, data, at + skip)[0])
        at += skip + size
    version, count, checksum, again = numbers
    if version != 1:
        raise ValueError(f"version {version}, expected 1")
    body = data[at:]
    if count != again or len(body) != 24 * count:
        raise ValueError(f"{len(body)} bytes of positions for {count} nodes")
    if fnv(body) != checksum:
        raise ValueError("its checksum differs")
    return np.frombuffer(body, "<f8").reshape(-1, 3).copy()
