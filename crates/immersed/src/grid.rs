//! Rectilinear grid and the layout of its staggered arrays.
//!
//! Component c of the velocity lies on the lower face of its cell along c (marker and cell, Harlow and Welch 1965). All arrays have
//! the same shape with [`GHOSTS`] layers around the cells, x fastest, so that a neighbour along d is a constant stride away.

use std::ops::Range;

use nalgebra::Vector3;

use crate::axis::Axis;
use crate::far_field::FarField;
use crate::slabs::Slabs;

/// Layers of cells around the grid that boundary conditions fill.
pub const GHOSTS: usize = 2;

/// What holds at one end of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The far field's velocity.
    Inflow,
    /// The far field's velocity across, no gradient along of what differs from the far field.
    Slip,
    /// Pressure zero, no gradient of what differs from the far field.
    Outflow,
}

/// Both ends of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// The ends are one.
    Periodic,
    /// The low and the high end.
    Open([End; 2]),
}

/// Rectilinear grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Cells along x, y, z.
    pub axes: [Axis; 3],
    /// Conditions at the ends of x, y, z.
    pub ends: [Ends; 3],
    /// Distance of neighbours along an axis in an array.
    pub strides: [usize; 3],
}

/// Where cells are in an array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Cell at the first position.
    first: [isize; 3],
    /// Distance of neighbours along an axis.
    pub(crate) strides: [usize; 3],
}

impl Layout {
    /// Position of a cell.
    #[inline(always)]
    pub(crate) fn at(&self, cell: [isize; 3]) -> usize {
        (0..3).map(|d| (cell[d] - self.first[d]) as usize * self.strides[d]).sum()
    }

    /// Cell at a position.
    pub(crate) fn cell(&self, at: usize) -> [isize; 3] {
        let [_, y, z] = self.strides;
        let of = |d: usize, index: usize| self.first[d] + index as isize;
        [of(0, at % y), of(1, at % z / y), of(2, at / z)]
    }

    /// Of arrays for the faces of a box of cells alone, and their length.
    pub(crate) fn of_box(cells: &[Range<usize>; 3]) -> (Self, usize) {
        let [x, y, z] = [0, 1, 2].map(|d| cells[d].len() + 1);
        let first = [0, 1, 2].map(|d| cells[d].start as isize);
        (Self { first, strides: [1, x, x * y] }, x * y * z)
    }
}

/// Three staggered components.
pub type Velocity = [Vec<f64>; 3];

impl Grid {
    /// Grid of the product of `axes`.
    pub fn new(axes: [Axis; 3], ends: [Ends; 3]) -> Self {
        let [nx, ny] = [0, 1].map(|d| axes[d].len() + 2 * GHOSTS);
        Self { axes, ends, strides: [1, nx, nx * ny] }
    }

    /// Numbers of cells along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        [0, 1, 2].map(|d| self.axes[d].len())
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.cells().iter().product()
    }

    /// Length of an array with its ghosts.
    pub fn array_len(&self) -> usize {
        self.cells().iter().map(|n| n + 2 * GHOSTS).product()
    }

    /// Position in an array of the cell `cell`, whose indices may be as small as -[`GHOSTS`].
    #[inline(always)]
    pub fn at(&self, cell: [isize; 3]) -> usize {
        let g = GHOSTS as isize;
        (0..3).map(|d| (cell[d] + g) as usize * self.strides[d]).sum()
    }

    /// Layout of the arrays with ghosts.
    pub(crate) fn layout(&self) -> Layout {
        Layout { first: [-(GHOSTS as isize); 3], strides: self.strides }
    }

    /// A velocity that is the same everywhere.
    pub fn uniform(&self, velocity: Vector3<f64>) -> Velocity {
        [0, 1, 2].map(|c| vec![velocity[c]; self.array_len()])
    }

    /// Faces of component `c` along c whose velocity is solved for: all but those that the far field sets.
    pub fn unknown_faces(&self, c: usize) -> Range<usize> {
        let n = self.axes[c].len();
        match self.ends[c] {
            Ends::Periodic => 0..n,
            Ends::Open([low, high]) => {
                usize::from(low != End::Outflow)..n + usize::from(high == End::Outflow)
            }
        }
    }

    /// Distance of the centres of the cells below and above face `i` along `d`, m; at an open end half a cell, to the boundary.
    pub fn centre_distance(&self, d: usize, i: usize) -> f64 {
        let w = &self.axes[d].widths;
        match (i, self.ends[d]) {
            (0, Ends::Periodic) => 0.5 * (w[0] + w[w.len() - 1]),
            (0, _) => 0.5 * w[0],
            (i, Ends::Periodic) if i == w.len() => 0.5 * (w[0] + w[i - 1]),
            (i, _) if i == w.len() => 0.5 * w[i - 1],
            (i, _) => 0.5 * (w[i - 1] + w[i]),
        }
    }

    /// Coordinate along `d` of component `c` in cell `i`, m.
    pub fn coordinate(&self, c: usize, d: usize, i: usize) -> f64 {
        if c == d { self.axes[d].faces[i] } else { self.axes[d].centre(i) }
    }

    /// All cells.
    pub fn all_cells(&self) -> [Range<usize>; 3] {
        [0, 1, 2].map(|d| 0..self.axes[d].len())
    }

    /// Sets the velocity through an outflow to that of the face before it, in the planes along z that `slabs` sets.
    pub fn copy_to_outflow(&self, u: &mut Velocity, slabs: &Slabs) {
        let own = slabs.own();
        for (c, u) in u.iter_mut().enumerate() {
            let Ends::Open(ends) = self.ends[c] else { continue };
            let [a, b] = [(c + 1) % 3, (c + 2) % 3];
            for (end, (face, inner)) in
                ends.iter().zip([(0, 1), (self.axes[c].len(), self.axes[c].len() - 1)])
            {
                if *end != End::Outflow || (c == 2 && !slabs.ends()[usize::from(face > 0)]) {
                    continue;
                }
                let cells = |axis: usize| if axis == 2 { own.clone() } else { 0..self.axes[axis].len() };
                for q in cells(b) {
                    for p in cells(a) {
                        let at = |i: usize| {
                            let mut cell = [0; 3];
                            (cell[a], cell[b], cell[c]) = (p as isize, q as isize, i as isize);
                            self.at(cell)
                        };
                        u[at(face)] = u[at(inner)];
                    }
                }
            }
        }
    }

    /// Fills the ghosts of `u` and the faces that the `far` field sets, in the planes along z that `slabs` sets.
    pub fn fill_ghosts(&self, u: &mut Velocity, far: &FarField, slabs: &Slabs) {
        let planes = slabs.set_planes();
        for (c, values) in u.iter_mut().enumerate() {
            for d in 0..2 {
                self.fill_ends(values, [c, d], far, [true; 2], &planes);
            }
            self.fill_ends(values, [c, 2], far, slabs.ends(), &planes);
        }
    }

    /// Fills those of the two `ends` of axis `d` for component `c`, within `planes` along z.
    fn fill_ends(
        &self,
        u: &mut [f64],
        [c, d]: [usize; 2],
        far: &FarField,
        ends: [bool; 2],
        planes: &Range<isize>,
    ) {
        let (n, s) = (self.axes[d].len() as isize, self.strides[d]);
        // The inner loop is along the axis with the smaller stride.
        let [a, b] = [[1, 2], [0, 2], [0, 1]][d];
        let g = GHOSTS as isize;
        let extent = |axis: usize| match axis {
            2 => (planes.start + g) as usize..(planes.end + g) as usize,
            _ => 0..self.axes[axis].len() + 2 * GHOSTS,
        };
        for q in extent(b) {
            for p in extent(a) {
                let base = p * self.strides[a] + q * self.strides[b];
                let at = |i: isize| base + (i + g) as usize * s;
                // Along z unless `d` is.
                let plane = q as isize - g;
                let far = |i: isize| far.at(c, if d == 2 { i } else { plane });
                match self.ends[d] {
                    Ends::Periodic => {
                        for layer in 1..=GHOSTS as isize {
                            u[at(-layer)] = u[at(n - layer)];
                            u[at(n + layer - 1)] = u[at(layer - 1)];
                        }
                    }
                    Ends::Open([low, high]) => {
                        if ends[0] {
                            fill_low(u, at, low, far, c == d);
                        }
                        if ends[1] {
                            fill_high(u, at, high, far, c == d, n);
                        }
                    }
                }
            }
        }
    }
}

/// Fills the low end of a line, in whose cell i the far field has the velocity `far(i)`. The boundary is face 0 of a normal component (`normal`), else
/// between cells -1 and 0.
#[inline(always)]
fn fill_low(u: &mut [f64], at: impl Fn(isize) -> usize, end: End, far: impl Fn(isize) -> f64, normal: bool) {
    let own = if normal { 0 } else { -1 };
    if normal && end != End::Outflow {
        u[at(0)] = far(0);
    }
    let copy = |u: &[f64], to: isize, from: isize| u[at(from)] + (far(to) - far(from));
    for layer in 1..=GHOSTS as isize {
        u[at(-layer)] = match end {
            End::Inflow => far(-layer),
            End::Slip if normal => (far(-layer) + far(layer)) - u[at(layer)],
            End::Slip => copy(u, -layer, layer - 1),
            End::Outflow => copy(u, -layer, own + 1),
        };
    }
}

/// Fills the high end of a line of `n` cells.
#[inline(always)]
fn fill_high(
    u: &mut [f64],
    at: impl Fn(isize) -> usize,
    end: End,
    far: impl Fn(isize) -> f64,
    normal: bool,
    n: isize,
) {
    if normal && end != End::Outflow {
        u[at(n)] = far(n);
    }
    let copy = |u: &[f64], to: isize, from: isize| u[at(from)] + (far(to) - far(from));
    for layer in isize::from(normal)..GHOSTS as isize {
        u[at(n + layer)] = match end {
            End::Inflow => far(n + layer),
            End::Slip if normal => (far(n + layer) + far(n - layer)) - u[at(n - layer)],
            End::Slip => copy(u, n + layer, n - layer - 1),
            End::Outflow if normal => copy(u, n + layer, n),
            End::Outflow => copy(u, n + layer, n - 1),
        };
    }
}
