"""Snapshots: VTK XML files of unstructured and rectilinear grids and their time series (`.pvd`)."""

import base64
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import ResultsError, need
from .units import units_of

_NUMBERS = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}
# Names of VTK's cell types, as meshio has them.
CELLS = {
    1: "vertex",
    3: "line",
    5: "triangle",
    7: "polygon",
    8: "pixel",
    9: "quad",
    10: "tetra",
    11: "voxel",
    12: "hexahedron",
    13: "wedge",
    14: "pyramid",
}


class Snapshot:
    """Points, cells and fields at one time.

    - `time_s`: time since the start of the stage, s.
    - `points`: `[points][3]`, m, in the falling frame.
    - `connectivity`, `offsets`, `types`: cells as in VTK. The nodes of cell `c` are
      `connectivity[offsets[c]:offsets[c + 1]]`; `types` are numbers of VTK.
    - `point_data`, `cell_data`: arrays by name, with a row for each point or cell.
    - `units`: unit by name of a field.
    - `pieces`: number of files that were joined. Points on the boundary of two pieces
      occur in both.
    """

    def __init__(self, time_s, points, connectivity, offsets, types, point_data, cell_data, pieces=1):
        self.time_s, self.points, self.pieces = time_s, points, pieces
        self.connectivity, self.offsets, self.types = connectivity, offsets, types
        self.point_data, self.cell_data = point_data, cell_data
        self.units = units_of([*point_data, *cell_data])

    def __repr__(self):
        fields = ", ".join([*self.point_data, *self.cell_data])
        return f"<Snapshot at {self.time_s} s: {len(self.points)} points, {len(self.types)} cells; {fields}>"

    @property
    def cells(self):
        """Node numbers `[cells][nodes]` by type of cell, such as "triangle". `cell_rows` has
        the rows of `cell_data` in the same order. Polygons are "polygon5" for five nodes."""
        return {name: self.connectivity[self.offsets[rows][:, None] + np.arange(n)] for name, n, rows in self._kinds()}

    @property
    def cell_rows(self):
        """Rows of `cell_data` by type of cell, in the order of `cells`."""
        return {name: rows for name, _, rows in self._kinds()}

    def _kinds(self):
        """Name, nodes of a cell, and rows of each kind of cell."""
        sizes = np.diff(self.offsets)
        for kind in np.unique(self.types):
            name = CELLS.get(int(kind), f"vtk{kind}")
            for size in np.unique(sizes[self.types == kind]):
                rows = np.flatnonzero((self.types == kind) & (sizes == size))
                yield (f"{name}{size}" if name == "polygon" else name), int(size), rows

    def meshio(self):
        """The snapshot as a `meshio.Mesh`, with a block for each type of cell: it writes
        many other formats."""
        meshio = need("meshio", "Snapshot.meshio")
        cells = [("polygon" if n.startswith("polygon") else n, c) for n, c in self.cells.items()]
        rows = self.cell_rows.values()
        cell_data = {name: [field[r] for r in rows] for name, field in self.cell_data.items()}
        return meshio.Mesh(self.points, cells, point_data=dict(self.point_data), cell_data=cell_data)

    def pyvista(self):
        """The snapshot as a `pyvista.UnstructuredGrid` (`pip install pyvista`)."""
        pyvista = need("pyvista", "Snapshot.pyvista", "pip install './python[pyvista]'")
        counts = np.diff(self.offsets)
        cells = np.insert(self.connectivity, self.offsets[:-1], counts)
        grid = pyvista.UnstructuredGrid(cells, self.types, self.points)
        for target, fields in ((grid.point_data, self.point_data), (grid.cell_data, self.cell_data)):
            for name, field in fields.items():
                target[name] = field
        return grid


def read_series(path):
    """Times and files of a `.pvd`: a list of `(time_s, [files])` by time, with all pieces of
    a time. Raises `ResultsError`."""
    path = Path(path)
    root = _parse(path, "Collection")
    times = {}
    for entry in root.iter("DataSet"):
        try:
            time, file = float(entry.attrib["timestep"]), entry.attrib["file"]
        except (KeyError, ValueError):
            raise ResultsError(
                path, "an entry has no time or no file", "repeat the run, or resume it from its last checkpoint"
            ) from None
        files = times.setdefault(time, [])
        if path.parent / file not in files:
            files.append(path.parent / file)
    return sorted(times.items())


def read_snapshot(files, time_s=float("nan")):
    """The pieces `files` of one time as one `Snapshot`. Fields that not all pieces have are
    an error. Raises `ResultsError`."""
    pieces = [piece for file in files for piece in _pieces(Path(file))]
    if len(pieces) == 1:
        return Snapshot(time_s, *pieces[0])
    points, connectivity, offsets, types, point_data, cell_data = zip(*pieces, strict=True)
    first_point = np.cumsum([0, *map(len, points[:-1])])
    first_node = np.cumsum([0, *map(len, connectivity[:-1])])
    joined_offsets = [o[:-1] + n for o, n in zip(offsets, first_node, strict=True)]
    end = np.array([sum(map(len, connectivity))])
    return Snapshot(
        time_s,
        np.concatenate(points),
        np.concatenate([c + p for c, p in zip(connectivity, first_point, strict=True)]),
        np.concatenate([*joined_offsets, end]),
        np.concatenate(types),
        _joined(files, point_data),
        _joined(files, cell_data),
        len(pieces),
    )


def _joined(files, fields):
    """Fields of all pieces, one after the other."""
    for file, piece in zip(files, fields, strict=False):
        if set(piece) != set(fields[0]):
            odd = ", ".join(sorted(set(piece) ^ set(fields[0])))
            raise ResultsError(file, f"the pieces of this snapshot differ in the fields {odd}", "repeat the run")
    return {name: np.concatenate([piece[name] for piece in fields]) for name in fields[0]}


def _parse(path, *kinds):
    """Root of a VTK XML file of one of these kinds."""
    try:
        root = ElementTree.parse(path).getroot()
    except FileNotFoundError:
        raise ResultsError(
            path,
            "there is no such file: the run does not write it, or not yet, or it was not copied",
            "set output.surface_every_windows or output.volume_every_windows in the scene, and copy the whole folder",
        ) from None
    except OSError as error:
        raise ResultsError(path, f"the file cannot be read ({error.strerror})", "check its permissions") from error
    except ElementTree.ParseError as error:
        raise ResultsError(
            path,
            f"the file is incomplete or no XML ({error.msg if hasattr(error, 'msg') else error}): "
            "it is being written, or the disk was full",
            "read it again, or repeat the run",
            line=error.position[0],
        ) from None
    if root.get("type") not in kinds:
        raise ResultsError(
            path, f"the file is of type {root.get('type')}, not {' or '.join(kinds)}", "name a file of a run"
        )
    return root


def _pieces(path):
    """Points, connectivity, offsets, types, point data and cell data of each piece of a file."""
    root = _parse(path, "UnstructuredGrid", "RectilinearGrid")
    order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    arrays = _Arrays(path, order, root.get("header_type", "UInt32"), root.get("compressor", ""))
    geometry = _unstructured if root.get("type") == "UnstructuredGrid" else _rectilinear
    for piece in root.iter("Piece"):
        points, connectivity, offsets, types = geometry(path, piece, arrays)
        fields = []
        for kind, count in (("PointData", len(points)), ("CellData", len(types))):
            read = {a.get("Name"): arrays.read(a) for a in piece.findall(f"{kind}/DataArray")}
            for name, field in read.items():
                if len(field) != count:
                    raise ResultsError(
                        path, f"field `{name}` has {len(field)} rows, expected {count}", "repeat the run"
                    )
            fields.append(read)
        yield (points, connectivity, offsets, types, *fields)


def _unstructured(path, piece, arrays):
    """Points, connectivity, offsets and types of a piece."""
    n_points, n_cells = int(piece.attrib["NumberOfPoints"]), int(piece.attrib["NumberOfCells"])
    cells = {a.get("Name"): arrays.read(a) for a in piece.findall("Cells/DataArray")}
    points = piece.find("Points/DataArray")
    if points is None or not {"connectivity", "offsets", "types"} <= set(cells):
        raise ResultsError(path, "a piece has no points or no cells", "repeat the run")
    points, ends = arrays.read(points).astype(np.float64), cells["offsets"].astype(np.int64)
    nodes = len(cells["connectivity"])
    if (
        len(points) != n_points
        or not len(ends) == len(cells["types"]) == n_cells
        or nodes != (ends[-1] if n_cells else 0)
    ):
        raise ResultsError(path, "a piece has other numbers of points or cells than it states", "repeat the run")
    return (
        points,
        cells["connectivity"].astype(np.int64),
        np.concatenate([[0], ends]),
        cells["types"].astype(np.uint8),
    )


# Corners of a cell of a rectilinear grid in the order of VTK's hexahedra.
_CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def _rectilinear(path, piece, arrays):
    """The cells of a piece as hexahedra: points, connectivity, offsets and types."""
    axes = [arrays.read(a).astype(np.float64) for a in piece.findall("Coordinates/DataArray")]
    extent = [int(n) for n in piece.attrib["Extent"].split()]
    faces = [last - first + 1 for first, last in zip(extent[::2], extent[1::2], strict=True)]
    if [len(axis) for axis in axes] != faces or min(faces, default=0) < 1:
        raise ResultsError(path, "an axis has other coordinates than the extent of the grid", "repeat the run")
    x, y, z = axes
    nx, ny, nz = (n - 1 for n in faces)
    points = np.empty((nz + 1, ny + 1, nx + 1, 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], z[:, None, None]
    number = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
    nodes = np.stack([number[k : nz + k, j : ny + j, i : nx + i].ravel() for i, j, k in _CORNERS], axis=1)
    count = len(nodes)
    return points.reshape(-1, 3), nodes.ravel(), 8 * np.arange(count + 1), np.full(count, 12, dtype=np.uint8)


class _Arrays:
    """Decodes the arrays of a file."""

    def __init__(self, path, order, header, compressor):
        self.path, self.order, self.compressor = path, order, compressor
        self.header = np.dtype(order + _NUMBERS.get(header, "u4"))

    def read(self, element):
        """A numpy array `[rows]`, or `[rows][components]` for more than one component."""
        kind, form = element.get("type"), element.get("format")
        if kind not in _NUMBERS:
            raise self.unreadable(f"numbers of type {kind}")
        dtype = np.dtype(self.order + _NUMBERS[kind])
        text = "".join((element.text or "").split()) if form == "binary" else element.text or ""
        try:
            if form == "ascii":
                array = np.array(text.split(), dtype=dtype)
            elif form == "binary":
                array = np.frombuffer(self.bytes(text), dtype=dtype)
            else:
                raise self.unreadable(f"arrays in the form `{form}`")
            width = int(element.get("NumberOfComponents", "1"))
            # As machines have it, not as the file has it.
            array = array.astype(dtype.newbyteorder("="))
            return array.reshape(-1, width) if width > 1 else array
        except (ValueError, IndexError, zlib.error) as error:
            raise ResultsError(
                self.path, f"the array `{element.get('Name')}` is damaged ({error})", "repeat the run"
            ) from error

    def unreadable(self, what):
        return ResultsError(self.path, f"it has {what}, which this package does not read", "open it with pyvista")

    def bytes(self, text):
        """Bytes of an array in base64 with its head."""
        if not text:
            return b""
        size = self.header.itemsize
        if not self.compressor:
            data = base64.b64decode(text[: _base64_length(size)])
            head = int(np.frombuffer(data[:size], self.header)[0])
            whole = base64.b64decode(text)[size:]
            if len(whole) != head:
                # The head may be encoded alone.
                whole = base64.b64decode(text[_base64_length(size) :])
            if len(whole) != head:
                raise ValueError(f"{len(whole)} bytes instead of {head}")
            return whole
        first = np.frombuffer(base64.b64decode(text[: _base64_length(size)])[:size], self.header)
        count = int(first[0])
        length = _base64_length(size * (3 + count))
        head = np.frombuffer(base64.b64decode(text[:length])[: size * (3 + count)], self.header).astype(np.int64)
        if len(head) != 3 + count:
            raise ValueError(f"its head names {count} blocks")
        whole, last, stored = int(head[1]), int(head[2]), head[3:]
        data, at, blocks = base64.b64decode(text[length:]), 0, []
        for number, nbytes in enumerate(stored):
            expected = last if number == count - 1 and last else whole
            block = self.decompressed(data[at : at + nbytes], expected)
            if len(block) != expected:
                raise ValueError(f"a block of {len(block)} bytes instead of {expected}")
            blocks.append(block)
            at += nbytes
        if at != len(data):
            raise ValueError(f"{len(data)} bytes instead of {at}")
        return b"".join(blocks)

    def decompressed(self, block, size):
        if self.compressor == "vtkZLibDataCompressor":
            return zlib.decompress(block)
        if self.compressor == "vtkLZ4DataCompressor":
            lz4 = need("lz4.block", "ripstop.results")
            try:
                return lz4.decompress(block, uncompressed_size=size)
            except lz4.LZ4BlockError as error:
                raise ValueError(error) from error
        raise self.unreadable(f"the compression {self.compressor}")


def _base64_length(count):
    """Letters of base64 for `count` bytes."""
    return 4 * ((count + 2) // 3)
