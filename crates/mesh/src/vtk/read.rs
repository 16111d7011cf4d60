//! Snapshots read back: what [`super::write_surface`], [`super::write_volume`], [`super::write_rectilinear`] and
//! [`super::Series`] wrote.

use std::path::{Path, PathBuf};

use vtkio::model::{
    Attribute, Attributes, CellType, Coordinates, DataSet, IOBuffer, Piece as Loadable, PieceData,
    RectilinearGridPiece, UnstructuredGridPiece, Vtk,
};

use super::Series;
use crate::{MeshError, Point};

/// The files of one time of a series, one for each rank.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Time, s.
    pub time: f64,
    /// The `.vtu` or `.vtr` files.
    pub files: Vec<PathBuf>,
}

/// The snapshots that the `.pvd` file `path` lists, in its order.
///
/// # Errors
/// A file that is missing or cannot be read.
pub fn snapshots(path: &Path) -> Result<Vec<Snapshot>, MeshError> {
    std::fs::metadata(path).map_err(|source| MeshError::Io { path: path.into(), source })?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut found: Vec<Snapshot> = Vec::new();
    for (time, _, file) in Series::resume(path, f64::INFINITY).sets {
        let file = folder.join(file.replace("&quot;", "\"").replace("&lt;", "<").replace("&amp;", "&"));
        match found.last_mut() {
            Some(last) if last.time == time => last.files.push(file),
            _ => found.push(Snapshot { time, files: vec![file] }),
        }
    }
    Ok(found)
}

/// Type of the numbers of a field in its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// Double precision, and all types that are not listed here.
    F64,
    /// Single precision.
    F32,
    /// Whole numbers.
    U32,
}

impl Number {
    fn of(data: &IOBuffer) -> Self {
        match data {
            IOBuffer::F32(_) => Number::F32,
            IOBuffer::U32(_) => Number::U32,
            _ => Number::F64,
        }
    }
}

/// A field of a [`Piece`].
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name, unit included.
    pub name: String,
    /// Numbers in each row.
    pub width: usize,
    /// Type of the numbers in the file; `values` holds each of them exactly.
    pub number: Number,
    /// `[rows][width]`.
    pub values: Vec<f64>,
}

/// Points, cells and fields of one `.vtu` or `.vtr` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Piece {
    /// Positions, m.
    pub points: Vec<Point>,
    nodes: Vec<u32>,
    ends: Vec<usize>,
    kinds: Vec<CellType>,
    /// Fields of the cells.
    pub cell_fields: Vec<Column>,
    /// Fields of the points.
    pub point_fields: Vec<Column>,
}

impl Piece {
    /// Reads a `.vtu` file, or a `.vtr` file as the hexahedra of its cells.
    ///
    /// # Errors
    /// A file that is missing, no unstructured or rectilinear grid, or contradicts itself.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let wrong = |reason: String| MeshError::File { path: path.into(), reason };
        std::fs::metadata(path).map_err(|source| MeshError::Io { path: path.into(), source })?;
        let (mut piece, data) = match Vtk::import(path).map_err(|e| wrong(e.to_string()))?.data {
            DataSet::UnstructuredGrid { pieces, .. } => Self::unstructured(only(pieces, path)?),
            DataSet::RectilinearGrid { pieces, .. } => Self::rectilinear(only(pieces, path)?),
            _ => return Err(wrong("the file has no unstructured and no rectilinear grid".into())),
        }
        .map_err(wrong)?;
        piece.cell_fields = columns(data.cell, piece.n_cells()).map_err(wrong)?;
        piece.point_fields = columns(data.point, piece.points.len()).map_err(wrong)?;
        Ok(piece)
    }

    fn unstructured(piece: UnstructuredGridPiece) -> Result<(Self, Attributes), String> {
        let points = piece.points.cast_into::<f64>().ok_or(NO_NUMBERS)?.as_chunks::<3>().0.to_vec();
        let kinds = piece.cells.types;
        let (connectivity, offsets) = piece.cells.cell_verts.into_xml();
        let ends: Vec<usize> = offsets.iter().map(|&o| o as usize).collect();
        let sound = ends.len() == kinds.len()
            && ends.is_sorted()
            && ends.last().copied().unwrap_or(0) == connectivity.len()
            && connectivity.iter().all(|&n| n < points.len() as u64);
        if !sound {
            return Err("a cell refers to a point that does not exist".into());
        }
        let nodes = connectivity.iter().map(|&n| n as u32).collect();
        Ok((Self { nodes, points, ends, kinds, ..Self::default() }, piece.data))
    }

    fn rectilinear(piece: RectilinearGridPiece) -> Result<(Self, Attributes), String> {
        let numbers = |axis: IOBuffer| axis.cast_into::<f64>().ok_or(NO_NUMBERS);
        let Coordinates { x, y, z } = piece.coords;
        let [x, y, z] = [numbers(x)?, numbers(y)?, numbers(z)?];
        let extent = piece.extent.into_ranges().map(|range| range.count());
        if extent != [x.len(), y.len(), z.len()] || extent.contains(&0) {
            return Err("an axis has other coordinates than the extent of the grid".into());
        }
        let [nx, ny, nz] = extent.map(|faces| faces - 1);
        let mut points = Vec::with_capacity(x.len() * y.len() * z.len());
        for z in &z {
            for y in &y {
                points.extend(x.iter().map(|x| [*x, *y, *z]));
            }
        }
        let mut nodes = Vec::with_capacity(8 * nx * ny * nz);
        let node = |i: usize, j: usize, k: usize| ((k * (ny + 1) + j) * (nx + 1) + i) as u32;
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    for k in [k, k + 1] {
                        nodes.extend([
                            node(i, j, k),
                            node(i + 1, j, k),
                            node(i + 1, j + 1, k),
                            node(i, j + 1, k),
                        ]);
                    }
                }
            }
        }
        let count = nx * ny * nz;
        let ends = (1..=count).map(|cell| 8 * cell).collect();
        let kinds = vec![CellType::Hexahedron; count];
        Ok((Self { points, nodes, ends, kinds, ..Self::default() }, piece.data))
    }

    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.kinds.len()
    }

    /// Nodes of a cell, in VTK's order.
    pub fn cell(&self, cell: usize) -> &[u32] {
        let from = if cell == 0 { 0 } else { self.ends[cell - 1] };
        &self.nodes[from..self.ends[cell]]
    }

    /// Type of a cell as VTK numbers it, such as 5 for a triangle.
    pub fn vtk_type(&self, cell: usize) -> u8 {
        self.kinds[cell] as u8
    }

    /// The edges of a cell, as pairs of nodes.
    pub fn edges(&self, cell: usize) -> impl Iterator<Item = [u32; 2]> {
        let nodes = self.cell(cell);
        let table: &[[usize; 2]] = match self.kinds[cell] {
            CellType::Tetra => &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]],
            CellType::Pyramid => &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]],
            CellType::Wedge => &[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]],
            CellType::Hexahedron => &[
                [0, 1],
                [1, 2],
                [2, 3],
                [3, 0],
                [4, 5],
                [5, 6],
                [6, 7],
                [7, 4],
                [0, 4],
                [1, 5],
                [2, 6],
                [3, 7],
            ],
            CellType::Line => &[[0, 1]],
            CellType::Triangle => &[[0, 1], [1, 2], [2, 0]],
            _ => &[[0, 1], [1, 2], [2, 3], [3, 0]],
        };
        table.iter().filter_map(move |&[a, b]| Some([*nodes.get(a)?, *nodes.get(b)?])).filter(|[a, b]| a != b)
    }

    /// The cells' field of this name.
    pub fn cell_field(&self, name: &str) -> Option<&Column> {
        self.cell_fields.iter().find(|c| c.name == name)
    }

    /// The points' field of this name.
    pub fn point_field(&self, name: &str) -> Option<&Column> {
        self.point_fields.iter().find(|c| c.name == name)
    }
}

/// What is wrong with an array of texts.
const NO_NUMBERS: &str = "an array has values that are not numbers";

/// The only piece of a file.
fn only<P: PieceData>(pieces: Vec<Loadable<P>>, path: &Path) -> Result<P, MeshError> {
    let wrong = |reason: String| MeshError::File { path: path.into(), reason };
    let [piece] = <[_; 1]>::try_from(pieces).map_err(|p| wrong(format!("{} pieces, not 1", p.len())))?;
    piece.into_loaded_piece_data(Some(path)).map_err(|e| wrong(e.to_string()))
}

/// The fields of `attributes` with this number of rows.
fn columns(attributes: Vec<Attribute>, rows: usize) -> Result<Vec<Column>, String> {
    let mut columns = Vec::new();
    for attribute in attributes {
        let Attribute::DataArray(array) = attribute else { continue };
        let number = Number::of(&array.data);
        let values = array.data.cast_into::<f64>().ok_or(NO_NUMBERS)?;
        // A structure of cables has no cells of fabric.
        if rows == 0 && values.is_empty() {
            continue;
        }
        if rows == 0 || values.len() % rows != 0 {
            return Err(format!("`{}` has {} values for {rows} rows", array.name, values.len()));
        }
        columns.push(Column { name: array.name, width: values.len() / rows, number, values });
    }
    Ok(columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vtk::{Values, write_surface, write_volume};
    use crate::{BoxShape, Patch, box_grid_of};

    #[test]
    fn snapshot_round_trip_is_exact() {
        let folder = tempfile::tempdir().unwrap();
        let mut series = Series::new(folder.path().join("flow.pvd"));
        // Euler: the distinct edges of a lattice of n^3 hexahedra are 3 n (n+1)^2.
        let grid = box_grid_of(BoxShape::Hexahedra, [2; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let speed: Vec<[f32; 3]> = (0..grid.cells.len()).map(|c| [c as f32, 0.0, 0.5]).collect();
        let file = folder.path().join("flow/a & b.vtu");
        write_volume(&file, &grid.coords, &grid.cells, &[], &[("v", Values::Vector32(&speed))]).unwrap();
        series.push(0.5, &["flow/a & b.vtu", "flow/c.vtu"]).unwrap();
        series.push(1.0, &["flow/d.vtu"]).unwrap();

        let list = snapshots(&folder.path().join("flow.pvd")).unwrap();
        assert_eq!((list.len(), list[0].files.len(), list[1].time), (2, 2, 1.0));
        let piece = Piece::read(&list[0].files[0]).unwrap();
        assert_eq!(piece.points, grid.coords);
        assert_eq!(piece.cell(7), grid.cells[7]);
        let v = piece.cell_field("v").unwrap();
        assert_eq!((v.width, v.number, &v.values[21..24]), (3, Number::F32, &[7.0, 0.0, 0.5][..]));
        assert_eq!(piece.vtk_type(7), 12);
        let mut edges: Vec<[u32; 2]> =
            (0..8).flat_map(|c| piece.edges(c)).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        assert_eq!(edges.len(), 54);
        assert!(piece.point_field("v").is_none());
    }

    #[test]
    fn missing_or_truncated_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("canopy.vtu");
        assert!(matches!(Piece::read(&path), Err(MeshError::Io { .. })));
        assert!(matches!(snapshots(&path), Err(MeshError::Io { .. })));
        write_surface(&path, &[[0.0; 3], [1.0; 3]], &[[0, 1]], &[], &[]).unwrap();
        assert_eq!(Piece::read(&path).unwrap().edges(0).count(), 1);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, &text[..text.len() / 2]).unwrap();
        assert!(matches!(Piece::read(&path), Err(MeshError::File { .. })));
    }
}
