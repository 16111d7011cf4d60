"""Scenes: read, change, write, check, run, sweep."""

import difflib
import json
import os
import re
import tempfile
import warnings
from pathlib import Path

from . import program
from .errors import RunError, SceneError, need

# Keys whose values are paths relative to the folder of the scene.
_PATHS = ("canopy.file", "flow.grid_file.path")
# First words of a file that `Scene.run` and `Scene.sweep` may write again.
_MARK = "# Written by ripstop.Scene from "


class Check:
    """What `ripstop check` says about a scene without errors: `text`, and `findings`, a list
    of dictionaries with `severity` ("note" or "warning"), `check`, `key`, `place`, `figure`,
    `range` and `remedy`."""

    def __init__(self, text, findings):
        self.text, self.findings = text, findings

    def __str__(self):
        return self.text

    @property
    def warnings(self):
        """The findings that are warnings."""
        return [f for f in self.findings if f["severity"] == "warning"]


class Scene:
    """A scene: the TOML file that `ripstop run` runs. Comments and order stay as they are.

    Keys are dotted, as for `--set`: `scene["descent.payload_mass_kg"]`. Tables in an array
    have their name or number: `scene["stage.descent.duration_s"]`, `scene["stage.2.duration_s"]`.
    Values are plain Python values; a table is a copy. Only keys that the file names have
    a value here: docs/reference/scene.md has the defaults of the others.

    Setting a key creates missing tables. `check` reports unknown keys and wrong values.
    """

    def __init__(self, text, path=None):
        tomlkit = need("tomlkit", "ripstop.Scene")
        self.path = None if path is None else Path(path)
        self._original = text
        try:
            self._document = tomlkit.parse(text)
        except tomlkit.exceptions.ParseError as error:
            raise SceneError(f"{path or 'the scene'}:{error.line}:{error.col}: not TOML: {error}") from None
        except tomlkit.exceptions.TOMLKitError as error:
            raise SceneError(f"{path or 'the scene'}: not TOML: {error}") from None

    @classmethod
    def read(cls, path):
        """The scene in a file. Raises `SceneError`: no such file, or no TOML."""
        try:
            return cls(Path(path).read_text(encoding="utf-8"), path)
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or "not UTF-8"
            raise SceneError(f"{path}: the scene cannot be read ({why}): check the path") from None

    def copy(self):
        """A copy that can be changed on its own."""
        scene = Scene(self.text, self.path)
        scene._original = self._original
        return scene

    def __repr__(self):
        return f"<Scene {self.get('name', 'without a name')} of {self.path or 'text'}>"

    @property
    def text(self):
        """The scene as TOML."""
        return self._document.as_string()

    @property
    def changed(self):
        """Whether the scene differs from the file that was read."""
        return self.text != self._original

    @property
    def stages(self):
        """Names of the stages, in order."""
        return [str(s.get("name", i)) for i, s in enumerate(self._document.get("stage", []))]

    def __getitem__(self, key):
        value = self._document
        parts = _parts(key)
        for at, part in enumerate(parts):
            value = self._inner(value, part, key, parts[:at])
        return value.unwrap() if hasattr(value, "unwrap") else value

    def get(self, key, default=None):
        """The value of a key, or `default` where the file does not name it."""
        return self[key] if key in self else default

    def __contains__(self, key):
        try:
            self[key]
        except SceneError:
            return False
        return True

    def keys(self):
        """All dotted keys of the file, with tables of arrays by name or number."""
        return list(_leaves("", self._document.unwrap()))

    def __iter__(self):
        return iter(self.keys())

    def __setitem__(self, key, value):
        tomlkit = need("tomlkit", "ripstop.Scene")
        parts = _parts(key)
        table = self._document
        for at, part in enumerate(parts[:-1]):
            if isinstance(table, list):
                table = self._inner(table, part, key, parts[:at])
            else:
                if part not in table:
                    if not at and part == "stage":
                        raise SceneError(f"`{key}`: the scene has no stages")
                    table[part] = tomlkit.table(is_super_table=False)
                table = table[part]
            if not isinstance(table, (dict, list)):
                raise SceneError(f"`{key}`: `{'.'.join(parts[: at + 1])}` is a value, not a table")
        if isinstance(table, list):
            names = ", ".join(_names(table))
            raise SceneError(f"`{key}`: write {'.'.join(parts[:-1])}.NAME.KEY with one of the names {names}")
        before = self.text
        try:
            new = tomlkit.item(_plain(value))
        except (TypeError, ValueError) as error:
            raise SceneError(f"`{key}`: {value!r} is no value of a scene ({error})") from None
        table[parts[-1]] = new
        if tomlkit.parse(self.text).unwrap() != self._document.unwrap():
            self._document = tomlkit.parse(before)
            raise SceneError(f"`{key}` = {value!r} cannot be written into this file: edit the file")

    def __delitem__(self, key):
        self[key]
        *path, last = _parts(key)
        table = self._document
        for at, part in enumerate(path):
            table = self._inner(table, part, key, path[:at])
        if isinstance(table, list):
            del table[_position(table, last)]
        else:
            del table[last]

    def _inner(self, table, part, key, above):
        """Value `part` of a table or of an array of tables."""
        place = ".".join(above)
        if isinstance(table, dict):
            if part in table:
                return table[part]
            names, what = [str(k) for k in table], f"[{place}]" if place else "the scene"
        elif isinstance(table, list) and (not table or isinstance(table[0], dict)):
            position = _position(table, part)
            if position is not None:
                return table[position]
            names, what = _names(table), f"`{place}`"
        else:
            raise SceneError(f"`{key}`: `{place}` is a value, not a table")
        near = difflib.get_close_matches(part, names, 1)
        hint = f"did you mean `{near[0]}`? " if near else ""
        raise SceneError(
            f"`{key}`: {self.path or 'the scene'} has no `{part}` in {what}; {hint}"
            f"it has: {', '.join(names) or 'nothing'}. "
            "Keys that the file does not name have the defaults of docs/reference/scene.md"
        )

    def write(self, path):
        """Writes the scene. In another folder, the files that it names (a pattern, a grid)
        get absolute paths. Returns the path. Raises `SceneError`."""
        path = Path(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self._text_for(path), encoding="utf-8")
        except OSError as error:
            raise SceneError(f"{path}: the scene cannot be written ({error.strerror})") from None
        return path

    def _text_for(self, path):
        """The text for a file in another folder."""
        if self.path is None or self.path.resolve().parent == path.resolve().parent:
            return self.text
        scene = self.copy()
        for key in _PATHS:
            if isinstance(scene.get(key), str):
                scene[key] = os.path.abspath(self.path.parent / scene[key])
        return scene.text

    def check(self, **options):
        """What `ripstop check` finds, a `Check`. Options as in `run`. Raises `SceneError` with
        the message and exit code of the program where the scene cannot run."""
        with tempfile.TemporaryDirectory(prefix="ripstop-") as folder:
            file = self.path
            if self.path is None or self.changed:
                file = self.write(Path(folder, "scene.toml"))
            words = ("check", file, *program.options(options))
            code, found, errors = program.output(*words, "--json")
            text = program.output(*words)[1] if code == 0 else ""
            if file != self.path:
                name = f"{self.path} (changed)" if self.path else "scene"
                found, text, errors = (t.replace(str(file), name) for t in (found, text, errors))
        findings = json.loads(found) if found.strip() else []
        if code != 0:
            wrong = [f for f in findings if f["severity"] == "error"]
            lines = [
                f"{f['place']}: {f['key']}: {f['figure']} [{f['check']}]\n  range: {f['range']}\n  remedy: {f['remedy']}"
                for f in wrong
            ]
            raise SceneError(
                "\n".join(lines) or errors.strip() or f"`ripstop check` failed with exit code {code}", code
            )
        return Check(text, findings)

    def run(self, out=None, resume=False, ranks=None, quiet=False, **options):
        """Runs the scene with `ripstop run` and returns its `ripstop.results.Run`.

        `out` is the folder of results (default: the scene's `output.folder`, or runs/NAME).
        `ranks` is a dictionary such as `{"flow": 4}`. Other options have the names of
        `ripstop run --help`: `stop_after_windows=2`, `accept_unconverged=True`. A scene that was
        changed is written next to the results, as OUT.toml. The output of the program
        appears on the terminal, except with `quiet`. Ctrl-C saves the current window.

        Raises `RunError` with exit code and last lines, `SceneError` where OUT.toml is a file
        of another origin."""
        from .results import Run

        out = Path(out or self.get("output.folder") or Path("runs", self._name()))
        command = [program.find(), "run", str(self._file(out)), "--out", str(out)]
        command += program.options({"resume": resume, "ranks": ranks, "quiet": quiet, **options})
        code, lines = program.stream(command, quiet)
        if code != 0:
            raise RunError(command, code, lines, out)
        return Run(out)

    def sweep(self, vary, out=None, together=False, jobs=None, quiet=False, **options):
        """Runs the scene with varied values by `ripstop sweep` and returns its table, as
        `ripstop.results.read_sweep`.

        `vary` is a dictionary of keys to lists of values, or to text such as "4..6:3" (three
        values in equal steps). All combinations run, or with `together` one run for each
        position in the lists. `out` is the folder of the runs (default: runs/sweep-NAME). An
        interrupted sweep resumes; complete runs are kept. `table=True` collects what there is.

        Runs that fail are rows whose `ended` is not "complete", and a warning. Raises
        `RunError`, with what was collected in `table`."""
        from .results import ResultsError, read_sweep

        out = Path(out or Path("runs", f"sweep-{self._name()}"))
        command = [program.find(), "sweep", str(self._file(out)), "--out", str(out)]
        for key, values in vary.items():
            text = values if isinstance(values, str) else ",".join(_word(v) for v in values)
            command += ["--vary", f"{key}={text}"]
        command += program.options({"together": together, "jobs": jobs, **options})
        code, lines = program.stream(command, quiet)
        if code != 0:
            try:
                table = read_sweep(out)
            except ResultsError:
                table = None
            raise RunError(command, code, lines, out, table)
        table = read_sweep(out)
        failed = table[table["ended"] != "complete"]
        if len(failed):
            warnings.warn(
                f"{len(failed)} of {len(table)} runs of {out} are not complete; the first one, {failed.index[0]}: "
                f"{failed['ended'].iloc[0]}",
                stacklevel=2,
            )
        return table

    def _name(self):
        name = self.get("name")
        if not name:
            raise SceneError(
                f"{self.path or 'the scene'} has no `name`: set scene['name'], or name a folder with `out`"
            )
        return name

    def _file(self, out):
        """The file to run: the one that was read, or a copy next to the results."""
        if self.path is not None and not self.changed:
            return self.path
        file = out.with_name(out.name + ".toml")
        try:
            mine = not file.exists() or file.read_text(encoding="utf-8").startswith(_MARK)
        except (OSError, UnicodeDecodeError):
            mine = False
        if not mine:
            raise SceneError(f"{file} exists and is not a copy of a changed scene: name another folder with `out`")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{_MARK}{self.path or 'text'}\n{self._text_for(file)}", encoding="utf-8")
        return file


def _parts(key):
    """Parts of a dotted key; `stage[2].x` is `stage.2.x`."""
    parts = re.sub(r"\[(\d+)\]", r".\1", key).split(".") if isinstance(key, str) else [""]
    if not all(parts):
        raise SceneError(f"`{key}` is no key: write a dotted key, such as fabric.poisson_ratio")
    return parts


def _names(tables):
    """Names of the tables of an array, or their numbers."""
    return [str(t.get("name", i)) for i, t in enumerate(tables)]


def _position(tables, part):
    """Position of a table in an array, by its name or number; None without it."""
    for at, table in enumerate(tables):
        if table.get("name") == part:
            return at
    return int(part) if part.isdecimal() and int(part) < len(tables) else None


def _leaves(path, value):
    """Dotted keys of all values below `path`."""
    if isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        inner = zip(_names(value), value, strict=True)
    else:
        yield path
        return
    for key, below in inner:
        yield from _leaves(f"{path}.{key}" if path else str(key), below)


def _plain(value):
    """A value without numpy's types."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value


def _word(value):
    """A value as `--vary` reads it: words without quotes, all else as TOML."""
    value = _plain(value)
    if isinstance(value, str):
        return value
    return need("tomlkit", "ripstop.Scene").item(value).as_string()
