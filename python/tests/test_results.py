"""Results of a run: one short run, and copies of it that are cut or changed."""

import json
import os
import unittest

import numpy as np
from common import copy_of_run, file, needs_program, scratch, square_run, square_scene

from ripstop import ResultsError, Scene, save_state, write_shape
from ripstop.results import Run, State


class Short(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.run_ = square_run()
        cls.stage = cls.run_.stage("descent")

    def test_run(self):
        self.assertTrue(self.run_.complete)
        self.assertEqual(self.run_.status, "complete")
        self.assertEqual(self.run_.stages, ["pre-inflation", "developed-flow", "descent"])
        self.assertEqual(self.run_.summary["scene"], "square-drop")
        self.assertEqual(self.run_.scene["descent.payload_mass_kg"], 5.5)
        self.assertEqual(self.stage.summary["windows"], 20)
        self.assertEqual(self.run_["descent"].name, "descent")

    def test_changed_scene_lies_next_to_the_results(self):
        self.assertEqual(Scene.read(scratch() / "square.toml").keys(), square_scene().keys())

    def test_history(self):
        history = self.stage.history
        self.assertEqual(list(history.index), list(range(20)))
        with open(self.stage.folder / "history.csv") as table:
            names = table.readline().strip().split(",")
        self.assertEqual(["window", *history.columns], names)
        self.assertTrue(all(np.issubdtype(t, np.number) for t in history.dtypes))
        self.assertAlmostEqual(history["time_s"].iloc[-1], 0.1)
        self.assertTrue(history["frame_x_m"].isna().all())
        self.assertEqual(self.stage.units["max_membrane_force_n_m"], "N/m")
        # The figures of the summary.
        self.assertAlmostEqual(history["drag_n"].iloc[-1], self.stage.summary["drag_n"], places=6)
        self.assertAlmostEqual(history["drag_n"].iloc[10:].mean(), self.stage.summary["mean_drag_n"], places=6)
        self.assertEqual(history["coupling_iterations"].sum(), self.stage.summary["iterations"])

    def test_other_tables(self):
        iterations = self.stage.iterations
        self.assertEqual(iterations.index.names, ["window", "iteration"])
        self.assertEqual(len(iterations), self.stage.history["coupling_iterations"].sum())
        last = iterations["coupling_residual"].groupby("window").last()
        # Printed to four digits.
        np.testing.assert_allclose(last, self.stage.history["coupling_residual"], rtol=1e-3)
        self.assertEqual(self.stage.tables, ["forces", "history", "iterations", "points", "probes"])
        np.testing.assert_allclose(self.stage.forces["canopy_drag_n"], self.stage.history["drag_n"], rtol=1e-3)
        self.assertEqual(self.stage.forces.attrs["units"]["canopy_moment_x_n_m"], "N m")
        self.assertEqual(list(self.stage.points), ["time_s", "apex_x_m", "apex_y_m", "apex_z_m"])
        self.assertEqual(len(self.stage.probes), 20)
        with self.assertRaisesRegex(ResultsError, r"payload.csv: the stage has no such table.*forces, history"):
            self.stage.payload

    def test_canopy(self):
        self.assertEqual(self.stage.series, ["canopy", "flow", "lines"])
        np.testing.assert_allclose(self.stage.snapshot_times(), [0.025, 0.05, 0.075, 0.1])
        canopy = self.stage.canopy()
        self.assertEqual(canopy.time_s, 0.1)
        self.assertEqual((canopy.points.shape, canopy.cells["triangle"].shape), ((169, 3), (288, 3)))
        self.assertEqual(canopy.units["displacement_m"], "m")
        # The projected area of the triangles that face upwards is that of the history.
        a, b, c = canopy.points[canopy.cells["triangle"].T]
        area = 0.5 * np.cross(b - a, c - a)[:, 2]
        self.assertAlmostEqual(area.clip(0).sum(), self.stage.history["projected_area_m2"].iloc[-1], places=6)
        # The pressure on them is its vertical load.
        load = (area * canopy.cell_data["pressure_jump_pa"]).sum()
        self.assertAlmostEqual(load / self.stage.history["vertical_load_n"].iloc[-1], 1, places=6)
        # The point at the apex moves as points.csv has it.
        start = canopy.points - canopy.point_data["displacement_m"]
        apex = np.abs(start).sum(axis=1).argmin()
        row = self.stage.points.iloc[-1]
        np.testing.assert_allclose(
            canopy.point_data["displacement_m"][apex], [row[f"apex_{x}_m"] for x in "xyz"], rtol=1e-6, atol=1e-9
        )

    def test_numbers_and_times_of_snapshots(self):
        self.assertEqual(self.stage.canopy(0).time_s, 0.025)
        self.assertEqual(self.stage.canopy(time=0.06).time_s, 0.05)
        self.assertEqual(self.stage.canopy(-2).time_s, 0.075)
        with self.assertRaisesRegex(ResultsError, r"there is no snapshot 4.*it has 4: 0 to 3"):
            self.stage.canopy(4)
        with self.assertRaisesRegex(ResultsError, r"slice.pvd: the stage has no such snapshots.*canopy, flow, lines"):
            self.stage.snapshot("slice")

    def test_lines(self):
        lines = self.stage.lines()
        self.assertEqual(lines.cells["line"].shape, (24, 2))
        tension = lines.cell_data["tension_n"].max()
        self.assertAlmostEqual(tension, self.stage.history["max_line_tension_n"].iloc[-1], places=6)

    def test_flow_of_two_ranks_is_joined(self):
        flow = self.stage.flow()
        self.assertEqual((flow.pieces, flow.cells["hexahedron"].shape), (2, (7776, 8)))
        pressure = flow.cell_data["pressure_pa"]
        row = self.stage.history.iloc[-1]
        self.assertAlmostEqual(pressure.max(), row["flow_max_pressure_pa"], places=3)
        self.assertAlmostEqual(pressure.min(), row["flow_min_pressure_pa"], places=3)
        mesh = flow.meshio()
        self.assertEqual(len(mesh.cell_data["velocity_frame_m_s"][0]), 7776)

    def test_state(self):
        state = self.stage.state
        self.assertEqual((state.time_s, state.windows), (0.1, 20))
        # The state is that of the last snapshot.
        np.testing.assert_allclose(state.canopy(), self.stage.canopy().points, rtol=0, atol=1e-12)
        self.assertEqual(state.files["structure.bin"]["kind"], "ripstruc")
        self.assertEqual(state.files["seal.bin"]["kind"], "ripseal")
        self.assertIsNone(state.files["time.toml"]["kind"])
        with self.assertRaisesRegex(ResultsError, r"flow.bin: it is no state of a Python program"):
            state.arrays("flow")
        with self.assertRaisesRegex(ResultsError, r"canopy.bin: there is no shape"):
            self.run_["developed-flow"].state.canopy()

    def test_statistics(self):
        found = {s["stage"]: s for s in self.run_.statistics()}
        self.assertEqual(found["descent"]["windows"], 20)
        # Computed from the figures of the table, which are rounded.
        self.assertAlmostEqual(
            found["descent"]["wake"]["side_force_rms_n"], self.stage.summary["wake"]["side_force_rms_n"], places=7
        )
        # Fewer than 40 windows.
        self.assertEqual(len(self.stage.settled()), 0)


class Incomplete(unittest.TestCase):
    def test_cut_history_without_a_summary(self):
        run = copy_of_run("cut")
        os.remove(run.folder / "summary.json")
        path = run.folder / "descent/history.csv"
        data = path.read_bytes()
        path.write_bytes(data[: data.rindex(b"\n", 0, -1) - 20])
        self.assertEqual(len(run["descent"].history), 18)
        self.assertFalse(run.complete)
        self.assertRegex(run.status, "^killed.* in stage `descent`")
        with self.assertRaisesRegex(ResultsError, "summary.json: there is no summary: the run is killed"):
            run.summary

    def test_summary_of_an_earlier_run(self):
        run = copy_of_run("stale")
        path = run.folder / "descent/history.csv"
        path.write_text("\n".join(path.read_text().split("\n")[:4]) + "\n")
        self.assertRegex(run.status, "^killed.* in stage `descent`")

    def test_stopped_and_ended_early(self):
        run = copy_of_run("stopped")
        summary = run.summary
        # What a run that was killed in its last stage leaves.
        (run.folder / "summary.json").write_text(json.dumps({**summary, "ended": "running"}))
        self.assertFalse(run.complete)
        self.assertRegex(run.status, "^killed.* in stage `descent`")
        summary["stages"][2]["ended"] = "stopped as asked"
        (run.folder / "summary.json").write_text(json.dumps(summary))
        self.assertEqual((run.complete, run.status), (False, "stopped as asked in stage `descent`"))
        summary["ended"] = "disk full"
        (run.folder / "summary.json").write_text(json.dumps(summary))
        self.assertEqual((run.complete, run.status), (False, "disk full"))
        (run.folder / "summary.json").write_text('{\n"scene": ')
        with self.assertRaisesRegex(ResultsError, "summary.json:2: the summary is incomplete"):
            run.summary

    def test_running(self):
        import fcntl

        run = copy_of_run("running")
        self.assertFalse(run.running)
        with open(run.folder / ".lock", "rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.assertEqual((run.running, run.status, run.complete), (True, "running", False))
        self.assertTrue(run.complete)
        # A look at the lock leaves it free.
        with open(run.folder / ".lock", "rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def test_state_without_seal_is_skipped(self):
        run = copy_of_run("seal")
        folder = run.folder / "descent"
        os.remove(folder / "state/seal.bin")
        self.assertIsNone(run["descent"].state)
        os.rename(folder / "state", folder / "state.old")
        file("seal/descent/state.old/seal.bin", b"")
        self.assertEqual(run["descent"].state.folder.name, "state.old")

    def test_settled_means_of_a_long_history(self):
        """A history by hand, steady from the start: its mean is known."""
        run = copy_of_run("settled")
        history = run["descent"].history
        noise = np.random.default_rng(1).normal(size=400)
        path = run.folder / "descent/history.csv"
        table = history.iloc[np.zeros(400, int)].reset_index(drop=True)
        table["time_s"] = 0.005 * np.arange(1, 401)
        table["drag_n"] = 50 + noise
        table.to_csv(path, index_label="window")
        found = run["descent"].settled()
        drag = found.loc["drag_n"]
        self.assertAlmostEqual(drag["mean"], 50, delta=0.3)
        self.assertEqual(drag["unit"], "N")


class Folders(unittest.TestCase):
    def test_folders_that_are_no_run(self):
        with self.assertRaisesRegex(ResultsError, "there is no such folder"):
            Run(scratch() / "none")
        with self.assertRaisesRegex(ResultsError, "scene.toml is missing"):
            Run(file("empty/x", "").parent)
        with self.assertRaisesRegex(ResultsError, "folder of a sweep"):
            Run(file("a-sweep/sweep.csv", "").parent)

    def test_unknown_stage(self):
        run = Run(file("made/scene.toml", '[[stage]]\nname = "fill"\n[[stage]]\nname = "fall"\n').parent)
        file("made/fill/history.csv", "window,time_s\n0,0.1\n")
        self.assertEqual(run.stages, ["fill"])
        with self.assertRaisesRegex(ResultsError, "fall: this stage has not begun; stages with results: fill"):
            run["fall"]
        with self.assertRaisesRegex(ResultsError, "the scene has no stage `dive`"):
            run["dive"]

    def test_statistics_of_a_damaged_run_has_the_message_of_the_program(self):
        needs_program()
        run = Run(file("damaged/scene.toml", "x = 1\n").parent)
        with self.assertRaisesRegex(ResultsError, r"`ripstop statistics` failed with exit code \d"):
            run.statistics()


class States(unittest.TestCase):
    def test_state_of_a_python_program(self):
        folder = file("python/x", "").parent
        save_state(folder, "structure", position=np.arange(3.0))
        positions = np.arange(900.0).reshape(300, 3)
        write_shape(folder, positions)
        state = State(folder)
        self.assertEqual(list(state.arrays("structure")["position"]), [0, 1, 2])
        np.testing.assert_array_equal(state.canopy(), positions)
        with self.assertRaisesRegex(ResultsError, "flow.bin: there is no such state; the folder has: canopy.bin"):
            state.arrays("flow")

    def test_damaged_shapes(self):
        folder = file("shape/x", "").parent
        write_shape(folder, np.arange(900.0).reshape(300, 3))
        data = (folder / "canopy.bin").read_bytes()
        for changed, message in [
            (b"x" + data[1:], "does not begin with"),
            (data[:12], "ends within its head"),
            (data[:-8], "bytes of positions for 300 nodes"),
            (data[:-1] + b"\x00", "checksum differs"),
            (data[:8] + b"\x02" + data[9:], "version 2"),
        ]:
            file("shape/canopy.bin", changed)
            with self.subTest(message), self.assertRaisesRegex(ResultsError, f"canopy.bin: .*{message}"):
                State(folder).canopy()


if __name__ == "__main__":
    unittest.main()
