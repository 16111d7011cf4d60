"""Snapshots, on small files by hand."""

import base64
import struct
import unittest
import zlib

import lz4.block
import numpy as np
from common import file, scratch

from ripstop import ResultsError
from ripstop.results import read_snapshot
from ripstop.results.vtu import read_series

# Two triangles, a quadrilateral, a tetrahedron and two polygons, in mixed order.
POINTS = np.arange(21.0).reshape(7, 3)
CELLS = [[0, 1, 2], [0, 1, 2, 3], [1, 2, 3], [0, 1, 2, 3, 4], [2, 3, 4, 5, 6, 0], [3, 4, 5, 6]]
TYPES = [5, 9, 5, 7, 7, 10]


def text_of(array, form, compressor="", block=48):
    """An array as text of a DataArray."""
    if form == "ascii":
        return " ".join(map(repr, array.ravel().tolist()))
    data = array.tobytes()
    if not compressor:
        return base64.b64encode(struct.pack("<Q", len(data)) + data).decode()
    blocks = [data[i : i + block] for i in range(0, len(data), block)]
    pack = zlib.compress if compressor == "zlib" else lambda b: lz4.block.compress(b, store_size=False)
    stored = [pack(b) for b in blocks]
    last = len(blocks[-1]) if blocks and len(blocks[-1]) < block else 0
    head = struct.pack(f"<{3 + len(stored)}Q", len(stored), block, last, *map(len, stored))
    return (base64.b64encode(head) + base64.b64encode(b"".join(stored))).decode()


def vtu(name, form="binary", compressor="", field=None, points=POINTS):
    """A file by hand."""
    numbers = {"f8": "Float64", "i8": "Int64", "u1": "UInt8", "f4": "Float32"}

    def array(label, values, width=1):
        kind = numbers[values.dtype.str[1:]]
        return (
            f'<DataArray type="{kind}" Name="{label}" NumberOfComponents="{width}" format="{form}">'
            f"{text_of(values, form, compressor)}</DataArray>"
        )

    connectivity = np.array([n for cell in CELLS for n in cell])
    offsets = np.cumsum([len(c) for c in CELLS])
    field = np.arange(6.0) if field is None else field
    mark = {"zlib": "vtkZLibDataCompressor", "lz4": "vtkLZ4DataCompressor"}.get(compressor, "")
    mark = f'compressor="{mark}"' if mark else ""
    return file(
        name,
        f'<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt64" {mark}><UnstructuredGrid>'
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="6">'
        f"<PointData>{array('displacement_m', points, 3)}</PointData>"
        f"<CellData>{array('pressure_pa', field)}</CellData><Points>{array('Points', points, 3)}</Points><Cells>"
        f"{array('connectivity', connectivity)}{array('offsets', offsets)}{array('types', np.array(TYPES, 'u1'))}"
        "</Cells></Piece></UnstructuredGrid></VTKFile>",
    )


# Letters of the head of an array of one block.
HEAD = 44


def with_head(text, position, value):
    """The text of a file whose array `pressure_pa` has another number in its head."""
    at = text.index(">", text.index('Name="pressure_pa"')) + 1
    head = bytearray(base64.b64decode(text[at : at + HEAD]))
    struct.pack_into("<Q", head, 8 * position, value)
    return text[:at] + base64.b64encode(head).decode() + text[at + HEAD :]


class Snapshots(unittest.TestCase):
    def test_all_encodings_give_the_same(self):
        for form, compressor in [("ascii", ""), ("binary", ""), ("binary", "zlib"), ("binary", "lz4")]:
            with self.subTest(form + compressor):
                found = read_snapshot([vtu("v/a.vtu", form, compressor)], 0.5)
                self.assertEqual(found.time_s, 0.5)
                np.testing.assert_array_equal(found.points, POINTS)
                np.testing.assert_array_equal(found.cell_data["pressure_pa"], np.arange(6.0))
                np.testing.assert_array_equal(found.point_data["displacement_m"], POINTS)
                self.assertEqual(found.cells["triangle"].tolist(), [CELLS[0], CELLS[2]])
                self.assertEqual(found.cell_rows["triangle"].tolist(), [0, 2])
                self.assertEqual(found.cells["quad"].tolist(), [CELLS[1]])
                self.assertEqual(found.cells["tetra"].tolist(), [CELLS[5]])
                self.assertEqual(found.cells["polygon5"].tolist(), [CELLS[3]])
                self.assertEqual(found.cells["polygon6"].tolist(), [CELLS[4]])
                self.assertEqual(found.units, {"displacement_m": "m", "pressure_pa": "Pa"})

    def test_last_block_of_full_size(self):
        # 48 bytes are one whole block.
        found = read_snapshot([vtu("v/full.vtu", "binary", "lz4")])
        self.assertEqual(found.cell_data["pressure_pa"].tolist(), [0, 1, 2, 3, 4, 5])

    def test_pieces_are_joined(self):
        files = [vtu("v/0.vtu"), vtu("v/1.vtu", field=np.arange(6.0) + 10, points=POINTS + 100)]
        found = read_snapshot(files)
        self.assertEqual((found.pieces, len(found.points), len(found.types)), (2, 14, 12))
        self.assertEqual(found.cells["triangle"][2].tolist(), [7, 8, 9])
        self.assertEqual(found.cells["polygon6"].tolist(), [CELLS[4], [n + 7 for n in CELLS[4]]])
        self.assertEqual(found.cell_data["pressure_pa"].tolist(), [0, 1, 2, 3, 4, 5, 10, 11, 12, 13, 14, 15])
        np.testing.assert_array_equal(found.points[found.cells["triangle"][2]], POINTS[:3] + 100)

    def test_rectilinear_grid_has_its_hexahedra(self):
        x, y, z = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0]), np.array([-1.0, 0.0, 1.0])
        array = lambda values, name="": (  # noqa: E731
            f'<DataArray type="Float64" Name="{name}" format="binary">{text_of(values, "binary", "lz4")}</DataArray>'
        )
        text = (
            '<VTKFile type="RectilinearGrid" byte_order="LittleEndian" header_type="UInt64" '
            'compressor="vtkLZ4DataCompressor"><RectilinearGrid WholeExtent="0 2 0 1 0 2"><Piece Extent="0 2 0 1 0 2">'
            f'<CellData>{array(np.arange(4.0), "pressure_pa")}</CellData>'
            f"<Coordinates>{array(x)}{array(y)}{array(z)}</Coordinates></Piece></RectilinearGrid></VTKFile>"
        )
        found = read_snapshot([file("v/a.vtr", text)])
        self.assertEqual(found.cells["hexahedron"].shape, (4, 8))
        corners = found.points[found.cells["hexahedron"]]
        # Corners as VTK numbers those of a hexahedron, cells with x fastest.
        self.assertEqual(
            corners[3].tolist(),
            [[1, 0, 0], [3, 0, 0], [3, 2, 0], [1, 2, 0], [1, 0, 1], [3, 0, 1], [3, 2, 1], [1, 2, 1]],
        )
        self.assertEqual(corners[0, 6].tolist(), [1, 2, 0])
        self.assertEqual(found.cell_data["pressure_pa"].tolist(), [0, 1, 2, 3])
        with self.assertRaisesRegex(ResultsError, "other coordinates than the extent"):
            read_snapshot([file("v/b.vtr", text.replace('Piece Extent="0 2', 'Piece Extent="0 3'))])

    def test_meshio_has_blocks_with_their_data(self):
        mesh = read_snapshot([vtu("v/a.vtu", "binary", "lz4")]).meshio()
        self.assertEqual([b.type for b in mesh.cells], ["triangle", "polygon", "polygon", "quad", "tetra"])
        self.assertEqual([d.tolist() for d in mesh.cell_data["pressure_pa"]], [[0, 2], [3], [4], [1], [5]])

    def test_damaged_files_are_named(self):
        whole = vtu("v/a.vtu", "binary", "lz4").read_text()
        at = whole.index(">", whole.index('Name="pressure_pa"')) + 1
        before, after = whole[:at], whole[at:]
        for text, message in [
            (whole[:500], r"v/cut.vtu:1: the file is incomplete or no XML"),
            (whole.replace('NumberOfCells="6"', 'NumberOfCells="7"'), r"other numbers of points or cells"),
            (vtu("v/four.vtu", field=np.arange(4.0)).read_text(), r"`pressure_pa` has 4 rows, expected 6"),
            (whole.replace("vtkLZ4", "vtkLZMA"), r"compression vtkLZMADataCompressor"),
            (whole.replace("UnstructuredGrid", "PolyData"), r"is of type PolyData"),
            (whole.replace('format="binary"', 'format="appended"'), r"arrays in the form `appended`"),
            # Of one array: the number of blocks, the size of a block, its stored size, a byte of the block itself.
            (with_head(whole, 0, 2), r"`pressure_pa` is damaged \(its head names 2 blocks"),
            (with_head(whole, 1, 56), r"`pressure_pa` is damaged \(a block of 48 bytes instead of 56"),
            (with_head(whole, 3, 99), r"`pressure_pa` is damaged"),
            (before + after[:HEAD] + "/////" + after[HEAD + 5 :], r"`pressure_pa` is damaged"),
        ]:
            self.assertNotEqual(text, whole)
            with self.subTest(message), self.assertRaisesRegex(ResultsError, message):
                read_snapshot([file("v/cut.vtu", text)])
        with self.assertRaisesRegex(ResultsError, r"none.vtu: there is no such file"):
            read_snapshot([scratch() / "none.vtu"])

    def test_series_joins_parts_of_a_time_and_sorts(self):
        entry = '<DataSet timestep="{}" part="{}" file="flow/{}.vtu"/>'
        entries = [entry.format(*e) for e in [(0.2, 0, "c"), (0.1, 0, "a"), (0.1, 1, "b"), (0.1, 1, "b")]]
        text = f'<VTKFile type="Collection"><Collection>{"".join(entries)}</Collection></VTKFile>'
        path = file("v/flow.pvd", text)
        folder = path.parent / "flow"
        self.assertEqual(read_series(path), [(0.1, [folder / "a.vtu", folder / "b.vtu"]), (0.2, [folder / "c.vtu"])])
        with self.assertRaisesRegex(ResultsError, "an entry has no time"):
            read_series(file("v/flow.pvd", text.replace('timestep="0.2"', 'timestep="x"')))


if __name__ == "__main__":
    unittest.main()
