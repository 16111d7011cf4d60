"""The runner of notebooks, and the form of those of the tutorials."""

import json
import subprocess
import sys
import unittest

from common import PACKAGE, ROOT, file

NOTEBOOKS = sorted((ROOT / "docs/tutorials/notebooks").glob("*.ipynb"))


def run(*sources):
    """Runs a notebook with these code cells."""
    cells = [{"cell_type": "code", "metadata": {}, "source": s.splitlines(True)} for s in sources]
    path = file("n/made.ipynb", json.dumps({"cells": [{"cell_type": "markdown", "source": ["# x"]}, *cells]}))
    runner = PACKAGE / "tests/run_notebook.py"
    return subprocess.run([sys.executable, runner, path], capture_output=True, text=True, check=False)


class Runner(unittest.TestCase):
    def test_cells_share_a_namespace_and_a_folder_with_the_cases(self):
        done = run("a = 1\nb = 2", "import os\nprint(a + b, os.path.isdir('../../../cases/square-drop'))")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertTrue(done.stdout.startswith("3 True\n"), done.stdout)

    def test_failed_cell_is_named(self):
        done = run("a = 1", "b = 2\nassert a == b")
        self.assertEqual(done.returncode, 1)
        self.assertIn("made.ipynb, code cell 2 failed", done.stderr)
        self.assertIn('code cell 2", line 2', done.stderr)
        self.assertEqual(run("import sys; sys.exit(0)").returncode, 1)


class Tutorials(unittest.TestCase):
    def test_notebooks_are_valid_and_store_no_output(self):
        self.assertEqual(len(NOTEBOOKS), 3)
        for path in NOTEBOOKS:
            notebook = json.loads(path.read_text(encoding="utf-8"))
            self.assertEqual((notebook["nbformat"], notebook["nbformat_minor"]), (4, 5), path)
            ids = [c["id"] for c in notebook["cells"]]
            self.assertEqual(len(ids), len(set(ids)))
            for cell in notebook["cells"]:
                self.assertNotIn("\t", "".join(cell["source"]))
                if cell["cell_type"] == "code":
                    self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None), path)


if __name__ == "__main__":
    unittest.main()
