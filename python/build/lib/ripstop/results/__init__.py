"""Results of a run: tables with units (pandas), snapshots (numpy, meshio, pyvista), saved
states, summary and settled means.

    from ripstop.results import Run

    run = Run("runs/square-drop")
    history = run.stage("descent").history
    print(run.status, history["drag_n"].mean(), history.attrs["units"]["drag_n"])

Runs that are incomplete, running or interrupted are readable: `Run.complete` and
`Run.status` say so. Every error is a `ripstop.ResultsError` with file, line, cause and
remedy.
"""

import functools
import json
from pathlib import Path

from .. import program
from ..errors import ResultsError, need
from .state import State, last_state
from .tables import read_sweep, read_table
from .units import unit_of
from .vtu import Snapshot, read_series, read_snapshot

__all__ = ["ResultsError", "Run", "Snapshot", "Stage", "State", "read_snapshot", "read_sweep", "read_table", "unit_of"]

# A run without the lock and without a summary of its own.
_KILLED = "killed, or running on another machine,"


class Run:
    """The results in a folder that `ripstop run` wrote (`--out`). Nothing is stored between
    calls except the scene: a running run can be read again and again.

    Raises `ResultsError` where the folder does not exist or is no run."""

    def __init__(self, folder):
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise ResultsError(
                self.folder, "there is no such folder", "name the folder of results that `ripstop run` printed"
            )
        if not (self.folder / "scene.toml").is_file():
            if (self.folder / "sweep.csv").is_file():
                raise ResultsError(
                    self.folder,
                    "this is the folder of a sweep, which contains several runs",
                    "use ripstop.results.read_sweep for its table, or name the folder of one run in it",
                )
            raise ResultsError(
                self.folder,
                "this is no folder of results: scene.toml is missing",
                "name the folder of results that `ripstop run` printed (not the folder of a stage)",
            )

    def __repr__(self):
        return f"<Run {self.folder}: {self.status}>"

    @functools.cached_property
    def scene(self):
        """The scene as it ran, a `ripstop.Scene`."""
        from ..scene import Scene

        return Scene.read(self.folder / "scene.toml")

    @property
    def summary(self):
        """`summary.json` as a dictionary (docs/reference/results.md). `ripstop` writes it at the
        start of a run, and at the end of each stage."""
        summary = self._summary()
        if summary is None:
            raise ResultsError(
                self.folder / "summary.json",
                f"there is no summary: the run is {self.status}",
                "wait for its end, or resume it with `ripstop run --resume`; histories and snapshots are readable now",
            )
        return summary

    def _summary(self):
        path = self.folder / "summary.json"
        try:
            return json.loads(path.read_text())
        except FileNotFoundError:
            return None
        except json.JSONDecodeError as error:
            raise ResultsError(
                path,
                f"the summary is incomplete or no JSON ({error.msg}): the disk was full, or the file was edited",
                "resume the run, which writes it again",
                line=error.lineno,
            ) from None

    @property
    def running(self):
        """Whether a `ripstop run` on this machine writes to the folder now."""
        try:
            import fcntl

            with open(self.folder / ".lock", "rb") as file:
                # Free again when the file is closed.
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except (ImportError, OSError):
            # A copy without the lock, another system, a file system without locks.
            return False
        return False

    @property
    def complete(self):
        """Whether all stages that the run was to have are complete."""
        return self.status == "complete"

    @property
    def status(self):
        """One of "complete", "running", "stopped as asked in stage `...`" (`--stop-after-windows`),
        "killed, or running on another machine, in stage `...`" without its summary, or the
        error that ended the run."""
        if self.running:
            return "running"
        summary = self._summary()
        stages = self.stages
        if summary is None or summary["ended"] == "running":
            return f"{_KILLED} in stage `{stages[-1]}`" if stages else f"{_KILLED} before its first window"
        for found in summary["stages"]:
            # The summary of an earlier run in this folder: the last one was killed before it wrote its own.
            if found["name"] in stages and found["windows"] != self._windows(found["name"]):
                return f"{_KILLED} in stage `{found['name']}`"
        if summary["ended"] != "complete":
            return summary["ended"]
        stopped = [s for s in summary["stages"] if s["ended"] == "stopped as asked"]
        return f"stopped as asked in stage `{stopped[0]['name']}`" if stopped else "complete"

    def _windows(self, stage):
        with open(self.folder / stage / "history.csv", "rb") as file:
            return sum(line.endswith(b"\n") for line in file) - 1

    @property
    def stages(self):
        """Names of the stages with a history, in the order of the scene."""
        return [n for n in self.scene.stages if (self.folder / n / "history.csv").is_file()]

    def stage(self, name):
        """The `Stage` of this name. Raises `ResultsError` where it has no history."""
        if name not in self.stages:
            in_scene = name in self.scene.stages
            raise ResultsError(
                self.folder / name,
                "this stage has not begun" if in_scene else f"the scene has no stage `{name}`",
                f"stages with results: {', '.join(self.stages) or 'none'}",
            )
        return Stage(self, name)

    def __getitem__(self, name):
        return self.stage(name)

    def statistics(self):
        """What `ripstop statistics --json` prints: a list with a dictionary for each stage with
        a flow (`stage`, `windows`, `settled`, `wake`, ...). Needs the program `ripstop`;
        raises `ResultsError` where it refuses the results."""
        code, text, errors = program.output("statistics", self.folder, "--json")
        if code != 0:
            raise ResultsError(
                self.folder, f"`ripstop statistics` failed with exit code {code}: {errors.strip()}", "see this message"
            )
        return json.loads(text)

    def settled(self):
        """Settled means of all stages: a `pandas.DataFrame` indexed by stage and quantity, with
        the fields of SettledMean in docs/reference/results.md (`mean`, `interval_95`,
        `no_interval`, `stationary`, ...; NaN or None where there is no value) and `unit`.
        Stages with fewer than 40 windows have none. Needs the program `ripstop`."""
        pandas = need("pandas", "ripstop.results")
        rows = [{"stage": s["stage"], **mean} for s in self.statistics() for mean in s["settled"]]
        columns = ["stage", "quantity", "mean", "interval_95", "unit"]
        table = pandas.DataFrame(rows, columns=columns if not rows else None)
        table["unit"] = [unit_of(name) for name in table["quantity"]]
        return table.set_index(["stage", "quantity"])


class Stage:
    """Results of one stage of a `Run`."""

    def __init__(self, run, name):
        self.run, self.name = run, name
        self.folder = run.folder / name

    def __repr__(self):
        return f"<Stage {self.name} of {self.run.folder}>"

    @property
    def summary(self):
        """The fields of StageSummary in docs/reference/results.md, a dictionary. Raises
        `ResultsError` before the end of the run."""
        found = [s for s in self.run.summary["stages"] if s["name"] == self.name]
        if not found:
            raise ResultsError(
                self.run.folder / "summary.json",
                f"it does not contain stage `{self.name}`: the last command did not run it",
                "read the history of the stage",
            )
        return found[0]

    @property
    def history(self):
        """`history.csv`: a `pandas.DataFrame` indexed by window (from 0), all columns as in the
        file, empty cells NaN; units by column in `attrs["units"]`, or `Stage.units`."""
        return self.table("history", ("window",))

    @property
    def units(self):
        """Units of the columns of `history`, such as "m/s"; "" for counts and coefficients."""
        return self.history.attrs["units"]

    @property
    def iterations(self):
        """`iterations.csv`: the coupling residual, indexed by window and iteration. Coupled stages."""
        return self.table("iterations", ("window", "iteration"))

    @property
    def forces(self):
        """`forces.csv`: forces, moments and coefficients, indexed by window. With `[flow.forces]`."""
        return self.table("forces")

    @property
    def points(self):
        """`points.csv`: displacement (m) of each `[[output.point]]`, indexed by window."""
        return self.table("points")

    @property
    def reactions(self):
        """`reactions.csv`: force (N) and moment (N m) that hold each `[[output.reaction]]`, indexed
        by window."""
        return self.table("reactions")

    @property
    def probes(self):
        """`probes.csv`: values of the air at each `[[flow.probe]]`, indexed by window."""
        return self.table("probes")

    @property
    def payload(self):
        """`payload.csv`: motion of the payload, indexed by window. With `[descent.body]`."""
        return self.table("payload")

    @property
    def tables(self):
        """Names of the tables that the stage has."""
        return sorted(p.stem for p in self.folder.glob("*.csv"))

    def table(self, name, index=()):
        """The table `<name>.csv` as a `pandas.DataFrame`, indexed by `index`, or by the number
        of its row, which is that of the window. Raises `ResultsError` without it."""
        path = self.folder / f"{name}.csv"
        if not path.is_file():
            raise ResultsError(
                path,
                "the stage has no such table: its kind or the scene does not ask for it",
                f"tables of this stage: {', '.join(self.tables)}; see docs/reference/results.md",
            )
        table = read_table(path, index)
        if not index:
            table.index.name = "window"
        return table

    @property
    def series(self):
        """Names of the time series of snapshots, such as "canopy", "flow", "lines", "canopy_air"
        and the names of slices."""
        return sorted(p.stem for p in self.folder.glob("*.pvd"))

    def snapshot_times(self, series="canopy"):
        """Times of the snapshots, s from the start of the stage, a list."""
        return [time for time, _ in self._entries(series)]

    def _entries(self, series):
        path = self.folder / f"{series}.pvd"
        if not path.is_file():
            raise ResultsError(
                path,
                "the stage has no such snapshots",
                f"it has: {', '.join(self.series) or 'none'}; output.surface_every_windows and "
                "output.volume_every_windows of the scene choose them",
            )
        return read_series(path)

    def snapshot(self, series, number=-1, time=None):
        """Snapshot `number` of a series (from 0; -1 is the last), or the one nearest to `time`
        (s), with all pieces joined. Returns a `Snapshot`; raises `ResultsError`."""
        entries = self._entries(series)
        if not entries:
            raise ResultsError(self.folder / f"{series}.pvd", "there is no snapshot yet", "wait for the first one")
        if time is not None:
            number = min(range(len(entries)), key=lambda i: abs(entries[i][0] - time))
        try:
            time, files = entries[number]
        except IndexError:
            raise ResultsError(
                self.folder / f"{series}.pvd",
                f"there is no snapshot {number}",
                f"it has {len(entries)}: 0 to {len(entries) - 1}, or -1 for the last",
            ) from None
        return read_snapshot(files, time)

    def canopy(self, number=-1, time=None):
        """Canopy: displacement and velocity of nodes, stresses, strains and pressure jump of
        triangles, a `Snapshot`."""
        return self.snapshot("canopy", number, time)

    def lines(self, number=-1, time=None):
        """Lines: tension (N), number and kind, a `Snapshot`."""
        return self.snapshot("lines", number, time)

    def flow(self, number=-1, time=None):
        """Flow in all cells, the parts of all ranks joined, a `Snapshot`."""
        return self.snapshot("flow", number, time)

    @property
    def state(self):
        """The last complete checkpoint, a `State`, or None without one."""
        return last_state(self.folder, lambda: self.history)

    def settled(self):
        """Settled means of the stage, as `Run.settled`, indexed by quantity."""
        table = self.run.settled()
        found = table[table.index.get_level_values("stage") == self.name]
        return found.droplevel("stage")
