"""Tables and units, on small files by hand and on the reference of the columns."""

import math
import re
import unittest

from common import ROOT, file

from ripstop import ResultsError
from ripstop.results import read_sweep, read_table, unit_of

HEADER = "window,time_s,drag_n,cd,coupling_iterations\n"


class Tables(unittest.TestCase):
    def test_numbers_empty_cells_and_units(self):
        table = read_table(file("t/history.csv", HEADER + "0,5e-3,1.5e1,,4\n1,1e-2,-inf,,3\n"), ("window",))
        self.assertEqual(table.index.name, "window")
        self.assertEqual(list(table.index), [0, 1])
        self.assertEqual(list(table["time_s"]), [0.005, 0.01])
        self.assertEqual(list(table["drag_n"]), [15.0, -math.inf])
        self.assertTrue(table["cd"].isna().all())
        self.assertEqual(str(table["coupling_iterations"].dtype), "int64")
        self.assertEqual(table.attrs["units"], {"time_s": "s", "drag_n": "N", "cd": "", "coupling_iterations": ""})

    def test_partial_last_line_is_ignored(self):
        # The cut line has the right number of cells, but its last number lacks digits.
        table = read_table(file("t/history.csv", HEADER + "0,5e-3,15,,4\n1,1e-2,16,,1"), ("window",))
        self.assertEqual(list(table.index), [0])
        self.assertEqual(len(read_table(file("t/history.csv", HEADER), ("window",))), 0)

    def test_empty_file_names_its_cause(self):
        with self.assertRaisesRegex(ResultsError, r"history.csv:1: the table has no complete line.*wait"):
            read_table(file("t/history.csv", HEADER[:10]))

    def test_damaged_rows_name_their_line(self):
        for row, message in [
            ("1,1e-2,16\n", r"history.csv:3: the row has 3 cells, the header 5"),
            ("1,1e-2,16,,4,7\n", r"history.csv:3: the row has 6 cells, the header 5"),
            ("1,1e-2,1x6,,4\n", r"history.csv:3: the cell of column `drag_n` is `1x6`"),
        ]:
            path = file("t/history.csv", HEADER + "0,5e-3,15,,4\n" + row + "2,2e-2,15,,4\n")
            with self.subTest(row), self.assertRaisesRegex(ResultsError, message) as caught:
                read_table(path, ("window",))
            self.assertEqual((caught.exception.path, caught.exception.line), (path, 3))

    def test_missing_column_and_file(self):
        path = file("t/history.csv", "time_s,drag_n\n0,1\n")
        with self.assertRaisesRegex(ResultsError, r"has no column `window`; it has: time_s, drag_n"):
            read_table(path, ("window",))
        with self.assertRaisesRegex(ResultsError, r"none.csv: there is no such table"):
            read_table(path.with_name("none.csv"))

    def test_sweep_keeps_words_and_vectors_as_text(self):
        text = (
            "run,descent.payload_mass_kg,coupling.scheme,flow.wind_m_s,ended,time_s,wake,drag_n,drag_n_interval_95\n"
            'a,4,implicit,"[1, 0, 0]",complete,0.1,,46.5,0.5\n'
            'b,6,staggered,"[0, 1, 0]","failed, why",0,wake.periods,,\n'
        )
        table = read_sweep(file("s/sweep.csv", text).parent)
        self.assertEqual(list(table.index), ["a", "b"])
        self.assertEqual(list(table["descent.payload_mass_kg"]), [4, 6])
        self.assertEqual(list(table["coupling.scheme"]), ["implicit", "staggered"])
        self.assertEqual(table["flow.wind_m_s"]["b"], "[0, 1, 0]")
        self.assertEqual(table["ended"]["b"], "failed, why")
        self.assertEqual(table["drag_n"]["a"], 46.5)
        self.assertTrue(math.isnan(table["drag_n"]["b"]))
        units = table.attrs["units"]
        self.assertEqual(
            [units[n] for n in ("descent.payload_mass_kg", "drag_n_interval_95", "ended")], ["kg", "N", ""]
        )
        with self.assertRaisesRegex(ResultsError, "no table of a sweep"):
            read_sweep(file("none/x.csv", "").parent)


class Units(unittest.TestCase):
    def test_units_are_those_of_the_reference(self):
        """Every table of columns in docs/reference/results.md that has units."""
        found = {}
        tables = False
        for line in (ROOT / "docs/reference/results.md").read_text(encoding="utf-8").splitlines():
            if line.startswith("#"):
                tables = line.startswith("## Columns of")
            row = re.match(r"\| `([^`]+)` \| ([^|]*)\|", line)
            if tables and row:
                found[row[1]] = row[2].strip()
        self.assertGreater(len(found), 120)
        wrong = {name: (unit_of(name), unit) for name, unit in found.items() if unit_of(name) != unit}
        self.assertEqual(wrong, {})

    def test_units_of_fields_of_snapshots(self):
        for name, unit in [
            ("velocity_ground_m_s", "m/s"),
            ("q_criterion_1_s2", "1/s²"),
            ("vorticity_1_s", "1/s"),
            ("stress_1_pa", "Pa"),
            ("strain_1", ""),
            ("s", ""),
            ("mach", ""),
        ]:
            self.assertEqual(unit_of(name), unit, name)


if __name__ == "__main__":
    unittest.main()
