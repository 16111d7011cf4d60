"""Reads the CSV tables of a run with pandas."""

import csv
import io
from pathlib import Path

from ..errors import ResultsError, need
from .units import units_of

# Columns of text in `sweep.csv`.
TEXT = ("run", "ended", "wake")


def complete_lines(path):
    """Text of a table without a partial last line, which a program is writing or was
    writing when it was killed. Raises `ResultsError`."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise ResultsError(
            path, "there is no such table: the run does not write it, or not yet", "look at the files of the folder"
        ) from None
    except OSError as error:
        raise ResultsError(path, f"the table cannot be read ({error.strerror})", "check its permissions") from error
    text = data[: data.rfind(b"\n") + 1].decode(errors="replace")
    if not text:
        raise ResultsError(
            path,
            "the table has no complete line: the stage has just started, or the disk was full",
            "wait for the first window, or repeat the run",
            line=1,
        )
    return text


def read_table(path, index=(), text_columns=()):
    """A table as a `pandas.DataFrame`: numbers, empty cells NaN, units in `attrs["units"]`.

    `index` names the columns of the index, which must exist. A partial last line is
    ignored. Raises `ResultsError` with the line where a row is too short or too long, or
    a cell is no number."""
    pandas = need("pandas", "ripstop.results")
    text = complete_lines(path)
    rows = csv.reader(io.StringIO(text))
    header = next(rows)
    missing = [name for name in index if name not in header]
    if missing:
        raise ResultsError(
            path,
            f"the table has no column `{missing[0]}`; it has: {', '.join(header)}",
            "read a table that `ripstop run` wrote",
            line=1,
        )
    columns = [[] for _ in header]
    for row in rows:
        if len(row) != len(header):
            raise ResultsError(
                path,
                f"the row has {len(row)} cells, the header {len(header)}: the file was edited or is damaged",
                "repeat the run, or resume it from its last checkpoint",
                line=rows.line_num,
            )
        for column, cell in zip(columns, row, strict=True):
            column.append(cell)
    data = {}
    for name, cells in zip(header, columns, strict=True):
        data[name] = cells if name in text_columns else _numbers(pandas, path, name, cells)
    table = pandas.DataFrame(data)
    if index:
        table = table.set_index(list(index))
    table.attrs["units"] = units_of(table.columns)
    return table


def _numbers(pandas, path, name, cells):
    """A column of numbers: integers where all cells are, else floating-point numbers."""
    try:
        return pandas.Series([int(cell) for cell in cells], dtype="int64")
    except (ValueError, OverflowError):
        pass
    try:
        return pandas.Series([float(cell) if cell else float("nan") for cell in cells], dtype="float64")
    except ValueError:
        row, cell = next((i, c) for i, c in enumerate(cells) if c and not _is_number(c))
        raise ResultsError(
            path,
            f"the cell of column `{name}` is `{cell}`, which is no number: the file was edited or is damaged",
            "repeat the run, or resume it from its last checkpoint",
            line=row + 2,
        ) from None


def _is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read_sweep(folder):
    """The table of a sweep (`sweep.csv` in its folder) as a `pandas.DataFrame` with a row
    for each run, indexed by the name of its folder. Varied keys are columns with the
    values as numbers where all are; `ended` is "complete" or a reason; quantities are
    means, with half widths of their 95 % intervals in `<quantity>_interval_95` (NaN where
    a mean is not settled). Units are in `attrs["units"]`. Raises `ResultsError`."""
    path = Path(folder) / "sweep.csv"
    if not path.is_file():
        raise ResultsError(
            path,
            "there is no table of a sweep",
            "run `ripstop sweep`, or `ripstop sweep --table` for an incomplete one",
        )
    pandas = need("pandas", "ripstop.results")
    text = complete_lines(path)
    header = next(csv.reader(io.StringIO(text)))
    # A varied key may have words or vectors as values.
    keys = [name for name in header if "." in name]
    table = read_table(path, ("run",), (*TEXT, *keys))
    units = table.attrs["units"]
    for key in keys:
        try:
            table[key] = pandas.to_numeric(table[key])
        except ValueError:
            pass
    table.attrs["units"] = units
    return table
