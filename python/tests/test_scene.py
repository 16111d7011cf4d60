"""Scenes: keys, text, check, runs and sweeps."""

import os
import signal
import subprocess
import sys
import unittest
import warnings
from unittest import mock

import numpy as np
from common import PACKAGE, ROOT, SQUARE, file, needs_program, scratch

from ripstop import ResultsError, RipstopError, RunError, Scene, SceneError, program

SMALL = """\
# Head
name = "small"

[fabric]
poisson_ratio = 0.3   # of nylon

[flow.grid]
layers = 5

[[stage]]
name = "fill"
window_s = 0.1

[[stage]]
name = "fall"
window_s = 0.2
"""


class Keys(unittest.TestCase):
    def setUp(self):
        self.scene = Scene(SMALL)

    def test_get(self):
        for key, value in [
            ("name", "small"),
            ("fabric.poisson_ratio", 0.3),
            ("fabric", {"poisson_ratio": 0.3}),
            ("stage.fall.window_s", 0.2),
            ("stage.0.window_s", 0.1),
            ("stage[1].name", "fall"),
        ]:
            self.assertEqual(self.scene[key], value)
            # Plain types, which json and numpy accept.
            self.assertIs(type(self.scene[key]), type(value), key)
        self.assertEqual(self.scene.stages, ["fill", "fall"])
        self.assertEqual(self.scene.keys()[:4], ["name", "fabric.poisson_ratio", "flow.grid.layers", "stage.fill.name"])
        self.assertTrue("flow.grid.layers" in self.scene and "flow.grid.none" not in self.scene)
        self.assertEqual(self.scene.get("flow.grid.none", 7), 7)

    def test_wrong_keys_name_what_there_is(self):
        for key, message in [
            ("fabric.poison_ratio", "no `poison_ratio` in \\[fabric\\]; did you mean `poisson_ratio`"),
            ("stage.fal.window_s", "no `fal` in `stage`; did you mean `fall`.*it has: fill, fall"),
            ("stage.2.window_s", "no `2` in `stage`"),
            ("name.x", "`name` is a value, not a table"),
            ("fabric..x", "is no key"),
        ]:
            with self.subTest(key), self.assertRaisesRegex(SceneError, message):
                self.scene[key]
        for key, message in [
            ("stage.dive.window_s", "no `dive` in `stage`"),
            ("stage.window_s", "write stage.NAME.KEY with one of the names fill, fall"),
            ("name.x", "`name` is a value"),
        ]:
            with self.subTest(key), self.assertRaisesRegex(SceneError, message):
                self.scene[key] = 1
        with self.assertRaisesRegex(SceneError, "None is no value of a scene"):
            self.scene["fabric.poisson_ratio"] = None
        with self.assertRaisesRegex(SceneError, "no `none` in"):
            del self.scene["fabric.none"]
        self.assertFalse(self.scene.changed)

    def test_set_keeps_comments_and_creates_tables(self):
        self.scene["fabric.poisson_ratio"] = np.float64(0.4)
        self.scene["title"] = "new"
        self.scene["flow.gust.velocity_m_s"] = np.array([1.0, 0.0, 0.0])
        self.scene["stage.fall.window_s"] = 0.3
        text = self.scene.text
        for line in ["# Head", "poisson_ratio = 0.4   # of nylon", "velocity_m_s = [1.0, 0.0, 0.0]"]:
            self.assertIn(line + "\n", text)
        again = Scene(text)
        self.assertEqual(again["title"], "new")
        self.assertEqual(again["flow"], {"grid": {"layers": 5}, "gust": {"velocity_m_s": [1.0, 0.0, 0.0]}})
        self.assertEqual([again["stage.fill.window_s"], again["stage.fall.window_s"]], [0.1, 0.3])
        self.assertTrue(self.scene.changed)

    def test_delete(self):
        del self.scene["flow.grid"]
        del self.scene["stage.fill"]
        self.assertEqual(self.scene.stages, ["fall"])
        self.assertNotIn("layers", self.scene.text)

    def test_copy_is_independent(self):
        other = self.scene.copy()
        other["name"] = "other"
        self.assertEqual(self.scene["name"], "small")
        self.assertTrue(other.changed and not self.scene.changed)

    def test_every_key_of_every_case_can_be_set_and_deleted(self):
        """The text is what a plain dictionary would hold: nothing else changes."""
        count = 0
        for path in sorted((ROOT / "cases").glob("*/scene.toml")):
            original = Scene.read(path)
            for key in original.keys():
                if key.endswith(".name"):
                    continue
                scene = original.copy()
                scene[key] = 42.5
                expected = {k: original[k] for k in original.keys()} | {key: 42.5}
                again = Scene(scene.text)
                self.assertEqual({k: again[k] for k in again.keys()}, expected, f"{path} {key}")
                del scene[key]
                self.assertNotIn(key, Scene(scene.text).keys())
                count += 1
        self.assertGreater(count, 300)


class Files(unittest.TestCase):
    def test_faulty_files(self):
        with self.assertRaisesRegex(SceneError, r"bad.toml:2:\d+: not TOML"):
            Scene.read(file("bad.toml", 'name = "x"\nvalue = \n'))
        with self.assertRaisesRegex(SceneError, r"none.toml: the scene cannot be read \(No such file"):
            Scene.read(scratch() / "none.toml")
        with self.assertRaisesRegex(SceneError, "not UTF-8"):
            Scene.read(file("bytes.toml", b"\xff\xfe"))

    def test_paths_become_absolute_in_another_folder(self):
        scene = Scene.read(ROOT / "cases/pattern-conical/scene.toml")
        self.assertFalse(os.path.isabs(scene["canopy.file"]))
        path = scene.write(scratch() / "elsewhere/scene.toml")
        found = Scene.read(path)["canopy.file"]
        self.assertTrue(os.path.isabs(found) and os.path.isfile(found), found)
        self.assertFalse(os.path.isabs(scene["canopy.file"]))
        same = scene.copy()
        same.path = path
        self.assertEqual(Scene.read(same.write(path.with_name("b.toml")))["canopy.file"], scene["canopy.file"])

    def test_program_is_found_or_named(self):
        with mock.patch.dict(os.environ, {"RIPSTOP": "/none/ripstop"}):
            with self.assertRaisesRegex(RipstopError, "RIPSTOP names `/none/ripstop`"):
                program.find()
        # The variable comes before PATH, PATH before the checkout.
        found = file("bin/ripstop", "#!/bin/sh\n")
        found.chmod(0o755)
        with mock.patch.dict(os.environ, {"RIPSTOP": "/none/ripstop", "PATH": str(found.parent)}):
            self.assertRaises(RipstopError, program.find)
            del os.environ["RIPSTOP"]
            self.assertEqual(program.find(), str(found))
        with mock.patch.dict(os.environ, {"RIPSTOP": str(found)}):
            self.assertEqual(program.find(), str(found))

    def test_options(self):
        words = program.options(
            {
                "stop_after_windows": 2,
                "resume": True,
                "quiet": False,
                "out": None,
                "ranks": {"flow": 2, "mesh": 1},
                "set": ["a=1", "b=2"],
            }
        )
        self.assertEqual(" ".join(words), "--stop-after-windows 2 --resume --ranks flow=2,mesh=1 --set a=1 --set b=2")


class Commands(unittest.TestCase):
    def setUp(self):
        needs_program()
        self.scene = Scene.read(SQUARE)
        # Two programs of one rank at a time fit on two cores.
        self.scene["ranks"] = {"flow": 1, "mesh": 1}

    def test_check(self):
        found = self.scene.check()
        self.assertIn("canopy: 169 interface nodes", found.text)
        [warning] = found.warnings
        self.assertEqual(warning["check"], "descent.drag-coefficient")
        self.assertTrue(warning["range"].startswith("0.3 to 1.1") and "initial_speed_m_s" in warning["remedy"])

    def test_check_of_a_changed_scene_refuses(self):
        self.scene["descent.payload_mas_kg"] = 1.0
        with self.assertRaisesRegex(
            SceneError, r"scene.toml \(changed\):\d+:1: unknown key `payload_mas_kg`"
        ) as caught:
            self.scene.check()
        self.assertEqual(caught.exception.code, 2)
        del self.scene["descent.payload_mas_kg"]
        self.scene["fabric.youngs_modulus_pa"] = 400.0
        with self.assertRaisesRegex(SceneError, r"Green strain of about 1080.*\n.*range: .*\n.*remedy: ") as caught:
            self.scene.check()
        self.assertEqual(caught.exception.code, 2)

    def test_refused_run(self):
        self.scene["descent.payload_mas_kg"] = 1.0
        with self.assertRaisesRegex(RunError, "refused its input with exit code 2\n.*payload_mas_kg") as caught:
            self.scene.run(scratch() / "refused", quiet=True)
        self.assertEqual(caught.exception.code, 2)
        self.assertIn("--quiet", caught.exception.command)

    def test_changed_scene_does_not_replace_a_file_of_another_origin(self):
        path = file("mine.toml", SMALL)
        self.scene["title"] = "changed"
        with self.assertRaisesRegex(SceneError, "mine.toml exists"):
            self.scene.run(scratch() / "mine")
        self.assertEqual(path.read_text(), SMALL)

    def test_failed_run_has_last_lines_and_keeps_results(self):
        from ripstop.results import Run

        # A canopy that moves too fast for the flow grid.
        self.scene["stage.pre-inflation.duration_s"] = 0.2
        out = scratch() / "failed"
        with self.assertRaises(RunError) as caught:
            self.scene.run(out, quiet=True)
        self.assertEqual(caught.exception.code, 1)
        self.assertTrue(any("too distorted" in line for line in caught.exception.lines))
        self.assertIn("too distorted", str(caught.exception))
        run = Run(out)
        self.assertFalse(run.complete)
        self.assertIn("too distorted", run.status)
        self.assertEqual(run.stages, ["pre-inflation"])
        with self.assertRaisesRegex(ResultsError, "this stage has not begun"):
            run.stage("descent")

    def test_interrupted_run_is_saved_and_resumes(self):
        from ripstop.results import Run

        out = scratch() / "interrupted"
        code = (
            # A shell that starts the tests in the background has SIGINT ignored.
            "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            f"sys.path.insert(0, {str(PACKAGE)!r})\nfrom ripstop import Scene\n"
            f"try:\n    Scene.read({str(SQUARE)!r}).run({str(out)!r})\n"
            "except KeyboardInterrupt:\n    sys.exit(77)"
        )
        child = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
        for line in child.stderr:
            if line.startswith("[pre-inflation] "):
                child.send_signal(signal.SIGINT)
                break
        rest = child.stderr.read()
        child.stderr.close()
        self.assertEqual(child.wait(), 77, rest)
        run = Run(out)
        self.assertFalse(run.complete)
        self.assertRegex(run.status, "^interrupted in stage `pre-inflation`")
        before = run.stage("pre-inflation").history
        done = len(before)
        self.assertTrue(0 < done < 200, done)
        self.assertEqual(run.stage("pre-inflation").state.windows, done)
        run = self.scene.run(out, resume=True, quiet=True)
        self.assertTrue(run.complete, run.status)
        after = run.stage("pre-inflation").history
        self.assertEqual(len(after), 200)
        # The first windows are those of the first part, with their wall times: they did not run again.
        self.assertTrue(after.iloc[:done].equals(before))

    def test_sweep(self):
        self.scene["stage.descent.duration_s"] = 0.01
        out = scratch() / "sweep"
        vary = {"descent.payload_mass_kg": [4.0, np.float64(6.0)]}
        table = self.scene.sweep(vary, out=out, jobs=1, quiet=True)
        self.assertEqual(list(table["descent.payload_mass_kg"]), [4.0, 6.0])
        self.assertEqual(set(table["ended"]), {"complete"})
        speed = table["descent_speed_m_s"]
        self.assertLess(speed.iloc[0], speed.iloc[1])
        self.assertEqual(table.attrs["units"]["descent_speed_m_s"], "m/s")
        # Complete runs are kept.
        before = (out / table.index[0] / "summary.json").stat().st_mtime_ns
        again = self.scene.sweep(vary, out=out, quiet=True)
        self.assertEqual(list(again["descent_speed_m_s"]), list(speed))
        self.assertEqual((out / table.index[0] / "summary.json").stat().st_mtime_ns, before)

    def test_sweep_warns_of_runs_that_fail(self):
        self.scene["stage.descent.duration_s"] = 0.01
        vary = {"stage.pre-inflation.duration_s": [0.2, 1.0]}
        with self.assertWarnsRegex(UserWarning, "1 of 2 runs .* not complete; .*too distorted"):
            table = self.scene.sweep(vary, out=scratch() / "failing", quiet=True)
        self.assertIn("too distorted", table["ended"].iloc[0])
        self.assertEqual(table["ended"].iloc[1], "complete")
        # Without a complete run it is an error that has the table.
        vary = {"stage.pre-inflation.duration_s": [0.2]}
        with self.assertRaisesRegex(RunError, "no run of the sweep is complete") as caught:
            self.scene.sweep(vary, out=scratch() / "failing", quiet=True)
        self.assertIn("too distorted", caught.exception.table["ended"].iloc[0])
        with self.assertRaises(RunError) as caught, warnings.catch_warnings():
            warnings.simplefilter("error")
            self.scene.sweep({"fabric.wrinklin": [True]}, out=scratch() / "unknown", quiet=True)
        self.assertEqual((caught.exception.code, caught.exception.table), (2, None))


if __name__ == "__main__":
    unittest.main()
