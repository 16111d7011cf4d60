//! The constraints of a surface on a device.

use super::Address;
use super::queue::{Buffer, Queue};
use super::tables::Packed;
use crate::constraints::FluxConstraints;
use crate::grid::Grid;
use crate::poisson::Box3;

/// Indices of several arrays in one buffer.
#[derive(Debug, Default)]
pub(crate) struct Indices(Vec<u32>);

impl Indices {
    pub(crate) fn push(&mut self, values: impl IntoIterator<Item = usize>) -> usize {
        let start = self.0.len();
        self.0.extend(values.into_iter().map(|i| i as u32));
        start
    }

    pub(crate) fn upload(&self, queue: &Queue) -> Buffer {
        queue.indices(&self.0)
    }
}

/// First entries of runs of equal keys in sorted entries, and the number of entries.
pub(crate) fn offsets<T, K: PartialEq>(entries: &[T], key: impl Fn(&T) -> K) -> Vec<usize> {
    let mut found = vec![0];
    for run in entries.chunk_by(|a, b| key(a) == key(b)) {
        found.push(found[found.len() - 1] + run.len());
    }
    found
}

/// The rows of constraints, the faces that they cut, and the cells next to these.
#[derive(Debug)]
pub(crate) struct DeviceRows {
    /// Of which rows these are.
    offsets: Vec<usize>,
    faces: Vec<(u8, usize)>,
    weights: Vec<f64>,
    pub(crate) cells: Box3,
    pub(crate) faces_cut: usize,
    pub(crate) cells_cut: usize,
    indices: Buffer,
    numbers: Buffer,
    /// Places of the arrays in `indices`: first entries of rows; face, component, position, pressures of the grid and of the box, upper and lower, of each entry.
    of_rows: [usize; 8],
    /// Component and position of each face; its first entry, and the row of each.
    of_faces: [usize; 4],
    /// Place of each cell in the box, its first face, and the face of each.
    of_cells: [usize; 3],
    /// Places in `numbers`: weight and inverse distance of each entry, weight of each entry of faces, area of each face of cells.
    of_numbers: [usize; 4],
    /// Jump, flux, largest speed and leak of each row.
    vectors: Buffer,
    impulse: Buffer,
    rows: usize,
}

/// Where the faces of constraints are.
struct Geometry<'a> {
    grid: &'a Grid,
    rows: &'a FluxConstraints,
}

impl Geometry<'_> {
    /// Cells above and below a face.
    fn upper(&self, (_, at): (u8, usize)) -> [usize; 3] {
        self.grid.layout().cell(at).map(|i| i as usize)
    }

    fn lower(&self, face: (u8, usize)) -> [usize; 3] {
        let mut cell = self.upper(face);
        cell[face.0 as usize] -= 1;
        cell
    }

    /// Place of a cell among those of the grid, and of the box.
    fn in_grid(&self, cell: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.cells();
        (cell[2] * ny + cell[1]) * nx + cell[0]
    }

    fn in_box(&self, cell: [usize; 3]) -> usize {
        let cells = &self.rows.cells;
        let [x, y, z] = [0, 1, 2].map(|d| cell[d] - cells[d].start);
        (z * cells[1].len() + y) * cells[0].len() + x
    }

    /// Inverse distance of the centres across a face, 1/m.
    fn inverse(&self, face: (u8, usize)) -> f64 {
        let c = face.0 as usize;
        1.0 / self.grid.centre_distance(c, self.upper(face)[c])
    }

    /// Area of a face of this component of a cell, m2.
    fn area(&self, c: u8, cell: [usize; 3]) -> f64 {
        (0..3).filter(|d| *d != c as usize).map(|d| self.grid.axes[d].widths[cell[d]]).product()
    }
}

/// The faces that the rows cut, each once, and the cells next to them.
struct CutLists {
    faces: Vec<(u8, usize)>,
    /// Face of each entry.
    face_of: Vec<usize>,
    /// Entries by their face, and the first of each face.
    order: Vec<usize>,
    of_face: Vec<usize>,
    /// Cell in the box, face, and what its velocity takes into the cell, m2; and the first of each cell.
    sides: Vec<(usize, usize, f64)>,
    of_cell: Vec<usize>,
}

impl CutLists {
    fn new(at: &Geometry<'_>) -> Self {
        let entries = &at.rows.faces;
        let mut order: Vec<usize> = (0..entries.len()).collect();
        order.sort_by_key(|e| (entries[*e], *e));
        let of_face = offsets(&order, |e| entries[*e]);
        let faces: Vec<_> = of_face[..of_face.len() - 1].iter().map(|e| entries[order[*e]]).collect();
        let mut face_of = vec![0; order.len()];
        for (f, run) in of_face.windows(2).enumerate() {
            order[run[0]..run[1]].iter().for_each(|e| face_of[*e] = f);
        }
        // What leaves a cell through its lower face enters it.
        let mut sides = Vec::with_capacity(2 * faces.len());
        for (f, face) in faces.iter().enumerate() {
            let [upper, lower] = [at.upper(*face), at.lower(*face)];
            sides.push((at.in_box(upper), f, at.area(face.0, upper)));
            sides.push((at.in_box(lower), f, -at.area(face.0, lower)));
        }
        sides.sort_by_key(|(cell, f, _)| (*cell, *f));
        let of_cell = offsets(&sides, |(cell, ..)| *cell);
        Self { faces, face_of, order, of_face, sides, of_cell }
    }
}

impl DeviceRows {
    pub(crate) fn new(queue: &Queue, grid: &Grid, rows: &FluxConstraints) -> Self {
        let at = Geometry { grid, rows };
        let cut = CutLists::new(&at);
        let mut indices = Indices::default();
        let all = || rows.faces.iter().copied();
        let of_rows = [
            indices.push(rows.offsets.iter().copied()),
            indices.push(cut.face_of),
            indices.push(all().map(|(c, _)| c as usize)),
            indices.push(all().map(|(_, at)| at)),
            indices.push(all().map(|face| at.in_grid(at.upper(face)))),
            indices.push(all().map(|face| at.in_grid(at.lower(face)))),
            indices.push(all().map(|face| at.in_box(at.upper(face)))),
            indices.push(all().map(|face| at.in_box(at.lower(face)))),
        ];
        let entries_of = |r: usize| rows.offsets[r + 1] - rows.offsets[r];
        let row_of: Vec<usize> =
            (0..rows.len()).flat_map(|r| std::iter::repeat_n(r, entries_of(r))).collect();
        let of_faces = [
            indices.push(cut.faces.iter().map(|(c, _)| *c as usize)),
            indices.push(cut.faces.iter().map(|(_, at)| *at)),
            indices.push(cut.of_face.iter().copied()),
            indices.push(cut.order.iter().map(|e| row_of[*e])),
        ];
        let cells_cut = cut.of_cell.len() - 1;
        let of_cells = [
            indices.push(cut.of_cell[..cells_cut].iter().map(|s| cut.sides[*s].0)),
            indices.push(cut.of_cell.iter().copied()),
            indices.push(cut.sides.iter().map(|s| s.1)),
        ];
        let mut numbers = Packed::default();
        let of_numbers = [
            numbers.push(rows.weights.iter().copied()),
            numbers.push(all().map(|face| at.inverse(face))),
            numbers.push(cut.order.iter().map(|e| rows.weights[*e])),
            numbers.push(cut.sides.iter().map(|s| s.2)),
        ];
        Self {
            offsets: rows.offsets.clone(),
            faces: rows.faces.clone(),
            weights: rows.weights.clone(),
            cells: rows.cells.clone(),
            faces_cut: cut.faces.len(),
            cells_cut,
            indices: indices.upload(queue),
            numbers: queue.numbers(numbers.values()),
            of_rows,
            of_faces,
            of_cells,
            of_numbers,
            vectors: queue.buffer(4 * rows.len()),
            impulse: queue.buffer(cut.faces.len()),
            rows: rows.len(),
        }
    }

    /// Whether these are `rows`, whose targets and permeability do not matter.
    pub(crate) fn are(&self, rows: &FluxConstraints) -> bool {
        self.offsets == rows.offsets
            && self.faces == rows.faces
            && self.weights == rows.weights
            && self.cells == rows.cells
    }

    pub(crate) fn of_rows(&self, array: usize) -> Address {
        self.indices.index_at(self.of_rows[array])
    }

    pub(crate) fn of_faces(&self, array: usize) -> Address {
        self.indices.index_at(self.of_faces[array])
    }

    pub(crate) fn of_cells(&self, array: usize) -> Address {
        self.indices.index_at(self.of_cells[array])
    }

    pub(crate) fn number(&self, array: usize) -> Address {
        self.numbers.at(self.of_numbers[array])
    }

    /// Jump (0), flux (1), largest speed (2) or leak (3) of the rows.
    pub(crate) fn vector(&self, which: usize) -> Address {
        self.vectors.at(which * self.rows)
    }

    pub(crate) fn impulse(&self) -> Address {
        self.impulse.at(0)
    }

    pub(crate) fn len(&self) -> usize {
        self.rows
    }
}
