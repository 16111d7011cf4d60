"""Runs notebooks without Jupyter: their code cells, one after the other, in one namespace.

    python3 python/tests/run_notebook.py docs/tutorials/notebooks/*.ipynb

Each runs in a temporary folder that looks like the repository, so that it writes nothing
into it. Cells with the tag `plot` need matplotlib and are skipped without it, with a
message. Ends with code 1 at the first cell that fails, with its number and line."""

import importlib.util
import json
import os
import sys
import tempfile
import time
import traceback
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def run(path):
    """Runs the notebook; returns whether all cells succeeded."""
    with open(path, encoding="utf-8") as file:
        cells = [c for c in json.load(file)["cells"] if c["cell_type"] == "code"]
    has_plots = importlib.util.find_spec("matplotlib") is not None
    start, namespace, skipped, home = time.monotonic(), {"__name__": "__main__"}, 0, os.getcwd()
    with tempfile.TemporaryDirectory(prefix="ripstop-notebook-") as folder:
        os.symlink(ROOT / "cases", Path(folder, "cases"))
        place = Path(folder, "docs/tutorials/notebooks")
        place.mkdir(parents=True)
        os.chdir(place)
        try:
            for number, cell in enumerate(cells, 1):
                if "plot" in cell.get("metadata", {}).get("tags", ()) and not has_plots:
                    skipped += 1
                    continue
                name = f"{path}, code cell {number}"
                try:
                    exec(compile("".join(cell["source"]), name, "exec"), namespace)
                except BaseException:
                    traceback.print_exc()
                    print(f"{name} failed", file=sys.stderr)
                    return False
        finally:
            os.chdir(home)
    without = f", {skipped} plots skipped: matplotlib is not installed" if skipped else ""
    print(f"{path}: {len(cells)} cells, {time.monotonic() - start:.1f} s{without}")
    return True


def main(paths):
    # A plot must not open a window.
    os.environ["MPLBACKEND"] = "Agg"
    sys.path.insert(0, str(ROOT / "python"))
    if not paths:
        sys.exit("name the notebooks to run")
    return 0 if all([run(os.path.abspath(path)) for path in paths]) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
