"""What an import needs: solver programs no pandas, results no iceoryx2."""

import subprocess
import sys
import unittest

from common import PACKAGE

BLOCK = """
import sys
sys.path.insert(0, {package!r})

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ImportError(f"{{name}} is blocked")

sys.meta_path.insert(0, Blocker())
"""


def python(blocked, code):
    """Runs `code` where the modules `blocked` cannot be imported; its output, then its errors."""
    head = BLOCK.format(package=str(PACKAGE), blocked=blocked)
    done = subprocess.run([sys.executable, "-c", head + code], capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


HEAVY = ("pandas", "meshio", "tomlkit", "lz4")


class Imports(unittest.TestCase):
    def test_participants_need_no_pandas(self):
        names = "STATISTICS, Fault, Participant, Run, Window, load_state, save_state, write_shape"
        code = f"from ripstop import {names}\nimport ripstop\nprint(sorted(STATISTICS), Run is ripstop.participant.Run)"
        self.assertEqual(python(HEAVY, code), "['flow', 'mesh', 'structure'] True\n")

    def test_main_and_serve_are_functions(self):
        try:
            import iceoryx2  # noqa: F401
        except ImportError:
            self.skipTest("iceoryx2 is not installed")
        for order in ("main, serve", "serve, main"):
            code = (
                f"from ripstop import {order}\nimport ripstop\nprint(callable(ripstop.main), callable(ripstop.serve))"
            )
            self.assertEqual(python(HEAVY, code), "True True\n")

    def test_results_need_no_iceoryx2(self):
        code = "import ripstop.results\nimport ripstop\nprint(ripstop.results.Run, ripstop.Scene)"
        expected = "<class 'ripstop.results.Run'> <class 'ripstop.scene.Scene'>\n"
        self.assertEqual(python(("iceoryx2",), code), expected)

    def test_import_of_the_package_imports_nothing_else(self):
        code = (
            "import ripstop, sys\nprint({m.partition('.')[0] for m in sys.modules} & {'numpy', 'pandas', 'iceoryx2'})"
        )
        self.assertEqual(python((), code), "set()\n")

    def test_missing_modules_name_the_command(self):
        for code, module in [
            ("from ripstop import Scene\nScene('')", "tomlkit"),
            ("from ripstop.results import read_table\nread_table('x')", "pandas"),
        ]:
            text = python(HEAVY, code)
            self.assertIn(f"needs {module}, which cannot be imported", text)
            self.assertIn("run `pip install ./python`", text)

    def test_all_names_exist_and_unknown_ones_do_not(self):
        code = "import ripstop\nprint(all(n in dir(ripstop) for n in ripstop.__all__), hasattr(ripstop, 'nothing'))"
        self.assertEqual(python((), code), "True False\n")


if __name__ == "__main__":
    unittest.main()
