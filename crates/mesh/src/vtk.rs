//! Pictures for ParaView: `.vtu` and `.vtr` files (XML, LZ4, base64) and `.pvd` time series.
//!
//! Every file is written aside and renamed, so a reader never sees half of one.

pub mod read;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use vtkio::model::{
    Attribute, Attributes, ByteOrder, CellType, Cells, Coordinates, DataSet, ElementType, Extent, IOBuffer,
    RectilinearGridPiece, UnstructuredGridPiece, Version, VertexNumbers, Vtk,
};

use vtkio::xml::Compressor;

use crate::msh::ElementShape;
use crate::{MeshError, Point};

/// Values of a named field, one for each point or cell.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a> {
    /// Scalars.
    F64(&'a [f64]),
    /// Scalars in single precision.
    F32(&'a [f32]),
    /// Whole numbers, such as ranks.
    U32(&'a [u32]),
    /// Vectors.
    Vector(&'a [Point]),
    /// Vectors in single precision.
    Vector32(&'a [[f32; 3]]),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Values::F64(v) => v.len(),
            Values::F32(v) => v.len(),
            Values::U32(v) => v.len(),
            Values::Vector(v) => v.len(),
            Values::Vector32(v) => v.len(),
        }
    }
}

/// A field with its name, unit included (`pressure_pa`).
pub type Field<'a> = (&'a str, Values<'a>);

fn attributes(fields: &[Field], expected: usize, what: &'static str) -> Result<Vec<Attribute>, MeshError> {
    fields
        .iter()
        .map(|&(name, values)| {
            if values.len() != expected {
                return Err(MeshError::Count { what, found: values.len(), expected });
            }
            let (vector, data): (bool, IOBuffer) = match values {
                Values::F64(v) => (false, v.to_vec().into()),
                Values::F32(v) => (false, v.to_vec().into()),
                Values::U32(v) => (false, v.to_vec().into()),
                Values::Vector(v) => (true, v.as_flattened().to_vec().into()),
                Values::Vector32(v) => (true, v.as_flattened().to_vec().into()),
            };
            let elem = if vector {
                ElementType::Vectors
            } else {
                ElementType::Scalars { num_comp: 1, lookup_table: None }
            };
            Ok(Attribute::DataArray(vtkio::model::DataArray { name: name.into(), elem, data }))
        })
        .collect()
}

/// Writes `bytes` to a temporary file next to `path`, then renames it.
pub(crate) fn write_aside(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), String>,
) -> Result<(), MeshError> {
    let io = |source| MeshError::Io { path: path.to_path_buf(), source };
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(io)?;
    }
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let aside = path.with_file_name(name);
    let file = fs::File::create(&aside).map_err(io)?;
    let mut writer = std::io::BufWriter::new(file);
    write(&mut writer).map_err(|reason| MeshError::File { path: path.to_path_buf(), reason })?;
    writer.flush().map_err(io)?;
    drop(writer);
    fs::rename(&aside, path).map_err(io)
}

fn write(
    path: &Path,
    points: &[Point],
    cells: Cells,
    point_data: &[Field],
    cell_data: &[Field],
) -> Result<(), MeshError> {
    let topology = match &cells.cell_verts {
        VertexNumbers::XML { connectivity, offsets } => {
            [size_of_val(&connectivity[..]), size_of_val(&offsets[..])]
        }
        VertexNumbers::Legacy { .. } => [0; 2],
    };
    // Kinds of cells take a byte each.
    let [connectivity, offsets] = topology;
    let arrays = [size_of_val(points), connectivity, offsets, cells.types.len()];
    let compressor = compressor(&arrays, &[point_data, cell_data]);
    let data = Attributes {
        point: attributes(point_data, points.len(), "values of a point field")?,
        cell: attributes(cell_data, cells.types.len(), "values of a cell field")?,
    };
    let piece = UnstructuredGridPiece { points: points.as_flattened().to_vec().into(), cells, data };
    write_file(path, DataSet::inline(piece), compressor)
}

fn write_file(path: &Path, data: DataSet, compressor: Compressor) -> Result<(), MeshError> {
    let file = Vtk {
        version: Version::new_xml(1, 0),
        title: String::new(),
        byte_order: ByteOrder::LittleEndian,
        file_path: None,
        data,
    };
    write_aside(path, |out| {
        let xml = file.try_into_xml_format(compressor, FAST).map_err(|e| e.to_string())?;
        xml.write(out).map_err(|e| e.to_string())
    })
}

/// LZ4 has no levels; vtkio takes 0 for no compression.
const FAST: u32 = 1;
/// Bytes that vtkio compresses at a time.
const BLOCK: usize = 32_768;

/// LZ4, for a snapshot stops the solvers and zlib would take ten times longer to save little more; nothing
/// where an array fills its blocks exactly: vtkio then adds an empty block, which VTK takes for a full one. `arrays`: bytes of those besides `fields`.
fn compressor(arrays: &[usize], fields: &[&[Field]]) -> Compressor {
    let field = |values: &Values| match values {
        Values::F64(v) => size_of_val(*v),
        Values::F32(v) => size_of_val(*v),
        Values::U32(v) => size_of_val(*v),
        Values::Vector(v) => size_of_val(*v),
        Values::Vector32(v) => size_of_val(*v),
    };
    let fields = fields.iter().flat_map(|f| f.iter()).map(|(_, values)| field(values));
    if arrays.iter().copied().chain(fields).any(|bytes: usize| bytes.is_multiple_of(BLOCK)) {
        Compressor::None
    } else {
        Compressor::LZ4
    }
}

/// Writes a surface or line set as `.vtu`: polygons of 2 (line), 3 or 4 nodes. A
/// quadrilateral that repeats its last node is a triangle.
///
/// # Errors
/// Field lengths that do not fit, or the file cannot be written.
pub fn write_surface<P: AsRef<[u32]>>(
    path: &Path,
    points: &[Point],
    polygons: &[P],
    point_data: &[Field],
    cell_data: &[Field],
) -> Result<(), MeshError> {
    let shapes = polygons.iter().map(|p| match *p.as_ref() {
        [a, b] => (CellType::Line, vec![a, b]),
        [a, b, c] => (CellType::Triangle, vec![a, b, c]),
        [a, b, c, d] if c == d => (CellType::Triangle, vec![a, b, c]),
        [a, b, c, d] => (CellType::Quad, vec![a, b, c, d]),
        ref other => (CellType::Polygon, other.to_vec()),
    });
    write(path, points, collect(shapes), point_data, cell_data)
}

/// Writes a volume grid as `.vtu`, collapsed hexahedra as the VTK cell that they are.
///
/// # Errors
/// Field lengths that do not fit, or the file cannot be written.
pub fn write_volume(
    path: &Path,
    points: &[Point],
    cells: &[[u32; 8]],
    point_data: &[Field],
    cell_data: &[Field],
) -> Result<(), MeshError> {
    write(path, points, collect(cells.iter().map(volume_cell)), point_data, cell_data)
}

/// Writes a rectilinear grid as `.vtr`, which needs no nodes and cells: coordinates of the faces of its cells along x, y and z, ascending, m, and
/// fields of the cells, x fastest.
///
/// # Errors
/// Field lengths that do not fit, an axis without cells, or the file cannot be written.
pub fn write_rectilinear(path: &Path, faces: [&[f64]; 3], cell_data: &[Field]) -> Result<(), MeshError> {
    if let Some(axis) = faces.iter().find(|axis| axis.len() < 2) {
        return Err(MeshError::Count { what: "faces along an axis", found: axis.len(), expected: 2 });
    }
    let cells = faces.iter().map(|axis| axis.len() - 1).product();
    let compressor = compressor(&faces.map(size_of_val), &[cell_data]);
    let [x, y, z] = faces.map(|axis| IOBuffer::from(axis.to_vec()));
    let piece = RectilinearGridPiece {
        extent: Extent::Ranges(faces.map(|axis| 0..=axis.len() as i32 - 1)),
        coords: Coordinates { x, y, z },
        data: Attributes { point: Vec::new(), cell: attributes(cell_data, cells, "values of a cell field")? },
    };
    write_file(path, DataSet::inline(piece), compressor)
}

fn collect(shapes: impl Iterator<Item = (CellType, Vec<u32>)>) -> Cells {
    let (mut connectivity, mut offsets, mut types) = (Vec::new(), Vec::new(), Vec::new());
    for (kind, nodes) in shapes {
        connectivity.extend(nodes.iter().map(|&n| u64::from(n)));
        offsets.push(connectivity.len() as u64);
        types.push(kind);
    }
    Cells { cell_verts: VertexNumbers::XML { connectivity, offsets }, types }
}

fn volume_cell(cell: &[u32; 8]) -> (CellType, Vec<u32>) {
    let (shape, nodes) = volume_shape(cell);
    let kind = match shape {
        ElementShape::Pyramid => CellType::Pyramid,
        ElementShape::Tetrahedron => CellType::Tetra,
        ElementShape::Prism => CellType::Wedge,
        _ => CellType::Hexahedron,
    };
    (kind, nodes)
}

/// Shape and nodes (in VTK's order) of a hexahedron with repeated nodes: a prism if one pair of
/// opposite edges of one of its faces is collapsed, wherever that is. What is no
/// VTK cell stays a hexahedron with repeated nodes, which ParaView draws.
pub(crate) fn volume_shape(cell: &[u32; 8]) -> (ElementShape, Vec<u32>) {
    let [a, b, c, d, e, f, g, h] = *cell;
    let distinct = (0..8).filter(|&i| !cell[..i].contains(&cell[i])).count();
    if distinct == 8 {
        return (ElementShape::Hexahedron, cell.to_vec());
    }
    if distinct == 5 && e == f && f == g && g == h {
        return (ElementShape::Pyramid, vec![a, b, c, d, e]);
    }
    if distinct == 4 && c == d && e == f && f == g && g == h {
        return (ElementShape::Tetrahedron, vec![a, b, c, e]);
    }
    if distinct == 6 {
        // Two faces of the hexahedron have become triangles and one an edge: turn
        // the cell until the collapsed edges are 2-3 and 6-7.
        const TURNS: [[usize; 8]; 12] = [
            [0, 1, 2, 3, 4, 5, 6, 7],
            [1, 2, 3, 0, 5, 6, 7, 4],
            [2, 3, 0, 1, 6, 7, 4, 5],
            [3, 0, 1, 2, 7, 4, 5, 6],
            [0, 4, 5, 1, 3, 7, 6, 2],
            [4, 5, 1, 0, 7, 6, 2, 3],
            [5, 1, 0, 4, 6, 2, 3, 7],
            [1, 0, 4, 5, 2, 3, 7, 6],
            [0, 3, 7, 4, 1, 2, 6, 5],
            [3, 7, 4, 0, 2, 6, 5, 1],
            [7, 4, 0, 3, 6, 5, 1, 2],
            [4, 0, 3, 7, 5, 1, 2, 6],
        ];
        for turn in TURNS {
            let t = turn.map(|i| cell[i]);
            if t[2] == t[3] && t[6] == t[7] {
                // VTK's wedge has its first triangle's normal pointing outwards.
                return (ElementShape::Prism, vec![t[0], t[2], t[1], t[4], t[6], t[5]]);
            }
        }
    }
    (ElementShape::Hexahedron, cell.to_vec())
}

/// A ParaView time series: `<name>.pvd`, rewritten whole with every snapshot.
#[derive(Clone, Debug)]
pub struct Series {
    path: PathBuf,
    sets: Vec<(f64, usize, String)>,
}

impl Series {
    /// A new series at `path` (`.pvd`); nothing is written yet.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), sets: Vec::new() }
    }

    /// A series that continues the one at `path`, keeping its snapshots before
    /// `time` (s); a new one if there is no such file.
    pub fn resume(path: impl Into<PathBuf>, time: f64) -> Self {
        let mut series = Self::new(path);
        let text = fs::read_to_string(&series.path).unwrap_or_default();
        for line in text.lines() {
            let value = |key: &str| {
                let from = line.find(&format!("{key}=\""))? + key.len() + 2;
                line[from..].split('"').next()
            };
            let Some((t, part, file)) =
                value("timestep").zip(value("part")).zip(value("file")).map(|((t, p), f)| (t, p, f))
            else {
                continue;
            };
            if let (Ok(t), Ok(part)) = (t.parse::<f64>(), part.parse())
                && t < time
            {
                series.sets.push((t, part, file.into()));
            }
        }
        series
    }

    /// Times that it lists.
    pub fn times(&self) -> usize {
        self.sets.iter().filter(|s| s.1 == 0).count()
    }

    /// Lists the files of one time (s), one for each rank, given relative to the
    /// series' own folder, and rewrites the `.pvd`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push<S: AsRef<str>>(&mut self, time: f64, files: &[S]) -> Result<(), MeshError> {
        let parts = files.iter().enumerate().map(|(part, f)| (time, part, f.as_ref().to_string()));
        self.sets.extend(parts);
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>\n",
        );
        for (time, part, file) in &self.sets {
            let file = file.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
            text +=
                &format!("    <DataSet timestep=\"{time}\" group=\"\" part=\"{part}\" file=\"{file}\"/>\n");
        }
        text += "  </Collection>\n</VTKFile>\n";
        write_aside(&self.path, |out| out.write_all(text.as_bytes()).map_err(|e| e.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxShape, Patch, box_grid_of};

    fn read(path: &Path) -> UnstructuredGridPiece {
        let DataSet::UnstructuredGrid { pieces, .. } = Vtk::import(path).unwrap().data else {
            panic!("not an unstructured grid")
        };
        pieces.into_iter().next().unwrap().into_loaded_piece_data(None).unwrap()
    }

    #[test]
    fn volume_round_trip_keeps_types_and_fields() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/flow.vtu");
        for (shape, kind, nodes) in [
            (BoxShape::Hexahedra, CellType::Hexahedron, 8),
            (BoxShape::Prisms, CellType::Wedge, 6),
            (BoxShape::Pyramids, CellType::Pyramid, 5),
            (BoxShape::Tetrahedra, CellType::Tetra, 4),
        ] {
            let grid = box_grid_of(shape, [2; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
            let pressure: Vec<f64> = (0..grid.cells.len()).map(|c| c as f64).collect();
            let velocity: Vec<[f32; 3]> = grid.coords.iter().map(|x| x.map(|v| v as f32)).collect();
            let point = [("velocity_m_s", Values::Vector32(&velocity))];
            write_volume(
                &path,
                &grid.coords,
                &grid.cells,
                &point,
                &[("pressure_pa", Values::F64(&pressure))],
            )
            .unwrap();
            let piece = read(&path);
            assert!(piece.cells.types.iter().all(|&t| t == kind), "{shape:?}");
            assert_eq!(piece.points.cast_into::<f64>().unwrap(), grid.coords.as_flattened());
            let (connectivity, offsets) = piece.cells.cell_verts.into_xml();
            assert_eq!(connectivity.len(), nodes * grid.cells.len());
            assert_eq!(offsets[1], 2 * nodes as u64);
            let Attribute::DataArray(p) = &piece.data.cell[0] else { panic!("not an array") };
            assert_eq!((p.name.as_str(), p.data.cast_into::<f64>().unwrap()), ("pressure_pa", pressure));
        }
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "leftovers");
    }

    #[test]
    fn rectilinear_grid_is_read_as_its_hexahedra() {
        let folder = tempfile::tempdir().unwrap();
        let (rectilinear, volume) = (folder.path().join("flow.vtr"), folder.path().join("flow.vtu"));
        // Enough cells for several blocks of an array, and a number of values that fills blocks to the byte.
        for n in [[3, 2, 2], [40, 20, 15], [32, 16, 8]] {
            let faces = n.map(|n| (0..=n).map(|i| 0.1 * f64::from(i * i)).collect::<Vec<_>>());
            let mut nodes = Vec::new();
            for z in &faces[2] {
                for y in &faces[1] {
                    nodes.extend(faces[0].iter().map(|x| [*x, *y, *z]));
                }
            }
            let node = |i: i32, j: i32, k: i32| ((k * (n[1] + 1) + j) * (n[0] + 1) + i) as u32;
            let mut cells = Vec::new();
            for at in 0..n[0] * n[1] * n[2] {
                let [i, j, k] = [at % n[0], at / n[0] % n[1], at / (n[0] * n[1])];
                let ring =
                    |k: i32| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
                let ([a, b, c, d], [e, f, g, h]) = (ring(k), ring(k + 1));
                cells.push([a, b, c, d, e, f, g, h]);
            }
            let pressure: Vec<f32> = (0..cells.len()).map(|i| (i as f32 * 0.3).sin()).collect();
            let velocity: Vec<[f32; 3]> = pressure.iter().map(|p| [*p, 2.0 * p, 1.0]).collect();
            let fields =
                [("pressure_pa", Values::F32(&pressure)), ("velocity_m_s", Values::Vector32(&velocity))];
            let axes = faces.each_ref().map(|axis| &axis[..]);
            write_rectilinear(&rectilinear, axes, &fields).unwrap();
            write_volume(&volume, &nodes, &cells, &[], &fields).unwrap();
            let [found, expected] = [&rectilinear, &volume].map(|path| read::Piece::read(path).unwrap());
            assert_eq!(found, expected, "{n:?}");
            assert_eq!(found.vtk_type(0), 12);
        }
        let wrong = write_rectilinear(&rectilinear, [&[0.0, 1.0][..]; 3], &[("x", Values::F64(&[1.0, 2.0]))]);
        assert!(matches!(wrong, Err(MeshError::Count { found: 2, expected: 1, .. })));
        let wrong = write_rectilinear(&rectilinear, [&[0.0, 1.0], &[0.0], &[0.0, 1.0]], &[]);
        assert!(matches!(wrong, Err(MeshError::Count { found: 1, expected: 2, .. })));
    }

    #[test]
    fn hexahedron_with_a_collapsed_edge_is_a_wedge() {
        // The unit cube squeezed along one edge in x: nodes 0-1 and 4-5.
        let (kind, nodes) = volume_cell(&[0, 0, 2, 3, 4, 4, 6, 7]);
        assert_eq!((kind, nodes.len()), (CellType::Wedge, 6));
        let (kind, nodes) = volume_cell(&[0, 1, 2, 3, 0, 5, 6, 3]);
        assert_eq!((kind, nodes.len()), (CellType::Wedge, 6));
    }

    #[test]
    fn files_are_compressed_except_arrays_of_whole_blocks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lines.vtu");
        // 4096 values of 8 bytes are one block to the byte, and 4096 points are three.
        for (count, packed) in [(4090, true), (4095, false), (4096, false), (4097, true)] {
            let points: Vec<Point> = (0..count + 1).map(|i| [f64::from(i), 0.5, -1.0]).collect();
            let lines: Vec<[u32; 2]> = (0..count as u32).map(|i| [i, i + 1]).collect();
            let values: Vec<f64> = (0..count).map(|i| (f64::from(i) * 0.3).sin()).collect();
            write_surface(&path, &points, &lines, &[], &[("v", Values::F64(&values))]).unwrap();
            let text = fs::read_to_string(&path).unwrap();
            assert_eq!(text.contains("vtkLZ4DataCompressor"), packed, "{count}");
            let piece = super::read::Piece::read(&path).unwrap();
            assert_eq!(piece.points, points);
            assert_eq!(piece.cell_field("v").unwrap().values, values);
        }
    }

    #[test]
    fn surfaces_are_written_and_wrong_field_lengths_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("canopy.vtu");
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        write_surface(&path, &points, &[vec![0, 1, 2, 3], vec![0, 1, 2, 2], vec![0, 1]], &[], &[]).unwrap();
        assert_eq!(read(&path).cells.types, [CellType::Quad, CellType::Triangle, CellType::Line]);
        let wrong = write_surface(&path, &points, &[[0, 1, 2, 3]], &[("x", Values::F64(&[1.0]))], &[]);
        assert!(matches!(wrong, Err(MeshError::Count { found: 1, expected: 4, .. })));
    }

    #[test]
    fn series_are_extended_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flow.pvd");
        let mut series = Series::new(&path);
        series.push(0.0, &["flow/0_0.vtu", "flow/0_1.vtu"]).unwrap();
        series.push(0.1, &["flow/1_0.vtu", "flow/1_1.vtu"]).unwrap();
        series.push(0.2, &["flow/2_0.vtu"]).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text.matches("<DataSet").count(), 5);
        assert!(text.contains("timestep=\"0.1\" group=\"\" part=\"1\" file=\"flow/1_1.vtu\""));
        let mut again = Series::resume(&path, 0.15);
        again.push(0.15, &["flow/x.vtu"]).unwrap();
        assert_eq!(again.sets.len(), 5);
        assert_eq!(fs::read_to_string(&path).unwrap().matches("<DataSet").count(), 5);
    }
}
