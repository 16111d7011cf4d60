//! Algebraic models of the eddies that cells do not resolve: an eddy viscosity from the velocity gradient.
//!
//! ```math
//! \frac{\partial u_c}{\partial t} = \dots + \sum_d \frac{\partial \tau_{cd}}{\partial x_d}, \qquad
//! \tau_{cd} = \nu_t \left(\frac{\partial u_c}{\partial x_d} + \frac{\partial u_d}{\partial x_c}\right), \qquad
//! \nu_t = (C \Delta)^2\, r(\nabla u), \qquad \Delta = (h_x h_y h_z)^{1/3}
//! ```
//! with the rate $`r`$ of Smagorinsky (1963) or of WALE (Nicoud and Ducros 1999). It is added to the molecular stress of [`crate::momentum`],
//! whose Laplacian form is the full one where the viscosity is constant and the divergence zero.
//!
//! **Places.** $`\nu_t`$ lies at the centres of cells. A normal component of the gradient there is the difference of two faces. A shear component is a difference on an edge;
//! $`S{:}S`$ and $`S^d{:}S^d`$ are means over four corners of the cell, of whose edges each is used once. (The mean of the differences of four edges misses half of the gradient of
//! waves of four cells.) A normal stress lies at the centre, a shear stress on the edge, with the mean $`\nu_t`$ of its four
//! cells; each is the flux between two volumes of one component, so that momentum is conserved, and $`\tau_{cd} = \tau_{dc}`$ is one number. The work of the stress is
//! $`-\nu_t`$ times a sum of squares: it takes energy everywhere.
//!
//! **Fabric.** The velocity jumps across the surface, and a difference across it is no strain. A cell that uses such a difference has $`\nu_t = 0`$. The four cells of an edge
//! use its two differences, so that no eddy stress acts through the surface, without another rule; the stress of the wall is that of [`crate::friction`].
//!
//! The step is explicit. Its limit has the rate of [`crate::flow::Flow::largest_eddy_rate`].

use std::ops::Range;

use crate::eddy_stress::Stress;
use crate::friction::Friction;
use crate::grid::{Ends, Grid, Velocity};
use crate::projection::cells_of;
use crate::slabs::Slabs;

/// Velocity gradient, 1/s: derivative of component c along d at `[c][d]`.
pub type Gradient = [[f64; 3]; 3];

/// Constant of Smagorinsky, as in the flow on a fitted grid.
const SMAGORINSKY: f64 = 0.17;
/// Constant of WALE for isotropic turbulence (the paper: 0.55 to 0.60), as in the flow on a fitted grid.
const WALE: f64 = 0.55;

/// Model of the eddies that cells do not resolve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SubgridModel {
    /// Smagorinsky (1963): $`r = |S| = \sqrt{2 S{:}S}`$, $`C = 0.17`$.
    Smagorinsky,
    /// WALE (Nicoud and Ducros 1999): $`r = (S^d{:}S^d)^{3/2} / ((S{:}S)^{5/2} + (S^d{:}S^d)^{5/4})`$ with $`S^d`$ the traceless symmetric part of the squared
    /// gradient, $`C = 0.55`$. Zero in pure shear; in rigid rotation it is not.
    Wale,
}

impl SubgridModel {
    /// Its number in the kernels of a device, and its constant.
    pub(crate) fn numbered(self) -> (usize, f64) {
        match self {
            Self::Smagorinsky => (0, SMAGORINSKY),
            Self::Wale => (1, WALE),
        }
    }

    /// Kinematic eddy viscosity over the square of the filter width, $`C^2 r`$, 1/s.
    pub fn rate(self, g: &Gradient) -> f64 {
        match self {
            Self::Smagorinsky => Smagorinsky::rate(Smagorinsky::invariants(g)),
            Self::Wale => Wale::rate(Wale::invariants(g)),
        }
    }
}

/// A model by the squares of its tensors, which are averaged over a cell. Loops over cells are compiled for each.
trait Law {
    /// $`S{:}S`$ and, where the model has it, $`S^d{:}S^d`$.
    fn invariants(g: &Gradient) -> [f64; 2];
    /// $`C^2 r`$, 1/s.
    fn rate(invariants: [f64; 2]) -> f64;
}

struct Smagorinsky;
struct Wale;

#[inline(always)]
fn strain_squared(g: &Gradient) -> f64 {
    let shear = |c: usize, d: usize| (g[c][d] + g[d][c]) * (g[c][d] + g[d][c]);
    g[0][0] * g[0][0]
        + g[1][1] * g[1][1]
        + g[2][2] * g[2][2]
        + 0.5 * (shear(0, 1) + shear(1, 2) + shear(0, 2))
}

impl Law for Smagorinsky {
    #[inline(always)]
    fn invariants(g: &Gradient) -> [f64; 2] {
        [strain_squared(g), 0.0]
    }

    #[inline(always)]
    fn rate([s2, _]: [f64; 2]) -> f64 {
        SMAGORINSKY * SMAGORINSKY * (2.0 * s2).sqrt()
    }
}

impl Law for Wale {
    #[inline(always)]
    fn invariants(g: &Gradient) -> [f64; 2] {
        let square = |c: usize, d: usize| g[c][0] * g[0][d] + g[c][1] * g[1][d] + g[c][2] * g[2][d];
        let [a, b, c] = [square(0, 0), square(1, 1), square(2, 2)];
        let third = (a + b + c) / 3.0;
        let (a, b, c) = (a - third, b - third, c - third);
        let shear = |c: usize, d: usize| {
            let sum = square(c, d) + square(d, c);
            sum * sum
        };
        let d2 = a * a + b * b + c * c + 0.5 * (shear(0, 1) + shear(1, 2) + shear(0, 2));
        [strain_squared(g), d2]
    }

    #[inline(always)]
    fn rate([s2, d2]: [f64; 2]) -> f64 {
        // Where nothing turns or stretches both are zero.
        let bottom = s2 * s2 * s2.sqrt() + d2 * d2.sqrt().sqrt() + f64::MIN_POSITIVE;
        WALE * WALE * (d2 * d2.sqrt() / bottom)
    }
}

/// Inverse lengths along one axis.
#[derive(Clone, Debug)]
pub(crate) struct Lengths {
    /// Distance of the centres on both sides of face i, 1/m.
    pub(crate) distance: Vec<f64>,
    /// Width of cell i - 1: from the cell below the grid to the one above it, 1/m.
    pub(crate) width: Vec<f64>,
    /// Width of cell i to the power of two thirds.
    pub(crate) filter: Vec<f64>,
}

impl Lengths {
    fn new(grid: &Grid, d: usize) -> Self {
        let w = &grid.axes[d].widths;
        let n = w.len();
        let [below, above] = match grid.ends[d] {
            Ends::Periodic => [w[n - 1], w[0]],
            Ends::Open(_) => [w[0], w[n - 1]],
        };
        let widths = std::iter::once(&below).chain(w).chain(std::iter::once(&above));
        Self {
            distance: (0..=n).map(|i| 1.0 / grid.centre_distance(d, i)).collect(),
            width: widths.map(|w| 1.0 / w).collect(),
            filter: w.iter().map(|w| w.powf(2.0 / 3.0)).collect(),
        }
    }

    /// At cell `i` of the grid.
    fn of_cell(&self, i: usize) -> CellLengths {
        CellLengths { distance: [self.distance[i], self.distance[i + 1]], width: self.width[i + 1] }
    }

    /// Inverse width of cell `i`, which may be -1 or one above the grid.
    pub(crate) fn width(&self, i: isize) -> f64 {
        self.width[(i + 1) as usize]
    }
}

/// Positions of the cells that use a difference across the surface.
pub(crate) fn crossed_cells(strides: [usize; 3], friction: &Friction) -> impl Iterator<Item = usize> + '_ {
    friction.segments().flat_map(move |(c, [low, high])| {
        let along = high - low == strides[c];
        let shift = if along { 0 } else { strides[c] };
        let own = if along { [low, low] } else { [low, high] };
        own.into_iter().flat_map(move |at| [at, at - shift])
    })
}

/// The eddy viscosity of a flow.
#[derive(Clone, Debug)]
pub(crate) struct EddyViscosity {
    model: SubgridModel,
    /// Kinematic eddy viscosity at the centres of cells, m2/s, with one layer of ghosts filled.
    pub(crate) values: Vec<f64>,
    lengths: [Lengths; 3],
    /// Invariants of a row of cells, sums over [`CORNERS`].
    invariants: [Vec<f64>; 2],
    /// Stresses of a row.
    row: Vec<f64>,
}

impl EddyViscosity {
    pub(crate) fn new(grid: &Grid, model: SubgridModel) -> Self {
        Self {
            model,
            values: vec![0.0; grid.array_len()],
            lengths: [0, 1, 2].map(|d| Lengths::new(grid, d)),
            invariants: [0, 1].map(|_| vec![0.0; grid.cells()[0]]),
            row: vec![0.0; grid.cells()[0] + 1],
        }
    }

    /// Finds the eddy viscosity of `u`, whose ghosts are filled, in the own cells and those next to them. On several ranks collective.
    pub(crate) fn update(&mut self, grid: &Grid, u: &Velocity, slabs: &Slabs, friction: Option<&Friction>) {
        match self.model {
            SubgridModel::Smagorinsky => self.set_cells::<Smagorinsky>(grid, u, slabs.own()),
            SubgridModel::Wale => self.set_cells::<Wale>(grid, u, slabs.own()),
        }
        if let Some(friction) = friction {
            self.clear_crossed(grid, friction);
        }
        self.fill_ghosts(grid, slabs);
    }

    /// Sets the cells in `planes` along z.
    fn set_cells<L: Law>(&mut self, grid: &Grid, u: &Velocity, planes: Range<usize>) {
        let [nx, ny, _] = grid.cells();
        let [x, y, z] = &self.lengths;
        for k in planes {
            for j in 0..ny {
                let start = grid.at([0, j as isize, k as isize]);
                let row = CellRow { u, strides: grid.strides, start, x, y: y.of_cell(j), z: z.of_cell(k) };
                let filter = y.filter[j] * z.filter[k];
                row.set::<L>(filter, &mut self.invariants, &mut self.values[start..start + nx]);
            }
        }
    }

    /// Sets the cells to zero that use a difference across the surface.
    fn clear_crossed(&mut self, grid: &Grid, friction: &Friction) {
        crossed_cells(grid.strides, friction).for_each(|at| self.values[at] = 0.0);
    }

    /// Its model.
    pub(crate) fn model(&self) -> SubgridModel {
        self.model
    }

    pub(crate) fn lengths(&self, d: usize) -> &Lengths {
        &self.lengths[d]
    }

    /// Fills the ghosts: the value of the next cell at open ends.
    pub(crate) fn fill_ghosts(&mut self, grid: &Grid, slabs: &Slabs) {
        let own = slabs.positions(slabs.own().start as isize..slabs.own().end as isize);
        let [_, sy, sz] = grid.strides;
        let [nx, ny, nz] = grid.cells();
        let copy = |values: &mut [f64], d: usize, first: usize, n: usize, s: usize, ends: [bool; 2]| {
            let [below, above] = match grid.ends[d] {
                Ends::Periodic => [first + (n - 1) * s, first],
                Ends::Open(_) => [first, first + (n - 1) * s],
            };
            if ends[0] {
                values[first - s] = values[below];
            }
            if ends[1] {
                values[first + n * s] = values[above];
            }
        };
        let values = &mut self.values;
        let first = grid.at([0, 0, 0]) % sz;
        for plane in own.step_by(sz) {
            for j in 0..ny {
                copy(values, 0, plane + first + j * sy, nx, 1, [true; 2]);
            }
            for i in 0..nx + 2 {
                copy(values, 1, plane + first - 1 + i, ny, sy, [true; 2]);
            }
        }
        slabs.exchange_layers(values, 1);
        let lowest = grid.at([-1, -1, 0]);
        for start in (0..ny + 2).map(|j| lowest + j * sy) {
            for i in 0..nx + 2 {
                copy(values, 2, start + i, nz, sz, slabs.ends());
            }
        }
    }

    /// Adds the divergence of the stress in the cells `planes` along z to `rates`, m/s2.
    pub(crate) fn add_rates(
        &mut self,
        grid: &Grid,
        u: &Velocity,
        planes: Range<usize>,
        rates: &mut Velocity,
    ) {
        let stress = Stress {
            grid,
            u,
            viscosity: &self.values,
            lengths: &self.lengths,
            planes: planes.start as isize..planes.end as isize,
        };
        let row = &mut self.row;
        stress.normal_along_x(row, &mut rates[0]);
        let [of_x, of_y, of_z] = rates;
        stress.normal_across_x(1, row, of_y);
        stress.normal_across_x(2, row, of_z);
        stress.shear_along_x(1, row, [of_x, of_y]);
        stress.shear_along_x(2, row, [of_x, of_z]);
        stress.shear_across_x(row, [of_y, of_z]);
    }

    /// Largest $`4 \nu_t \sum_d h_d^{-2}`$ of the cells `planes` along z, 1/s.
    pub(crate) fn largest_rate(&self, grid: &Grid, planes: Range<usize>) -> f64 {
        let [x, y, _] = grid.all_cells();
        let rate = |cell: [usize; 3]| {
            let square = |d: usize| self.lengths[d].width(cell[d] as isize).powi(2);
            4.0 * self.values[grid.at(cell.map(|i| i as isize))] * (square(0) + square(1) + square(2))
        };
        cells_of(&[x, y, planes]).map(rate).fold(0.0, f64::max)
    }
}

/// Inverse lengths at a cell: distances of the centres across its lower and its upper face, and its width.
#[derive(Clone, Copy)]
struct CellLengths {
    distance: [f64; 2],
    width: f64,
}

/// A row of cells along x, the first at `start`.
struct CellRow<'a> {
    u: &'a Velocity,
    strides: [usize; 3],
    start: usize,
    x: &'a Lengths,
    y: CellLengths,
    z: CellLengths,
}

/// Corners of a cell of which each pair of axes has all four edges: lower or upper faces of x, y, z.
const CORNERS: [[usize; 3]; 4] = [[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]];

impl CellRow<'_> {
    /// Adds the invariants at one corner of the cells, lower (0) or upper (1) along each axis.
    // One loop without branches over slices of one length, whose results alias nothing: it is compiled to vector instructions.
    #[inline(never)]
    fn add_corner<L: Law>(&self, corner: [usize; 3], strain: &mut [f64], squared: &mut [f64]) {
        let n = strain.len();
        let squared = &mut squared[..n];
        let upper =
            |c: usize, d: usize| self.start + corner[c] * self.strides[c] + corner[d] * self.strides[d];
        let pair = |c: usize, d: usize| {
            let at = upper(c, d);
            [&self.u[c][at - self.strides[d]..][..n], &self.u[c][at..][..n]]
        };
        let stretch =
            |c: usize| [&self.u[c][self.start..][..n], &self.u[c][self.start + self.strides[c]..][..n]];
        let (u_x, u_y, u_z) = (stretch(0), pair(0, 1), pair(0, 2));
        let (v_x, v_y, v_z) = (pair(1, 0), stretch(1), pair(1, 2));
        let (w_x, w_y, w_z) = (pair(2, 0), pair(2, 1), stretch(2));
        let (width, along_x) = (&self.x.width[1..][..n], &self.x.distance[corner[0]..][..n]);
        let [along_y, along_z] = [self.y.distance[corner[1]], self.z.distance[corner[2]]];
        for i in 0..n {
            let of = |[low, high]: [&[f64]; 2], inverse: f64| (high[i] - low[i]) * inverse;
            let g = [
                [of(u_x, width[i]), of(u_y, along_y), of(u_z, along_z)],
                [of(v_x, along_x[i]), of(v_y, self.y.width), of(v_z, along_z)],
                [of(w_x, along_x[i]), of(w_y, along_y), of(w_z, self.z.width)],
            ];
            let [s2, d2] = L::invariants(&g);
            strain[i] += s2;
            squared[i] += d2;
        }
    }

    /// Sets the cells `out` to the eddy viscosity of the mean of the invariants at [`CORNERS`]; `filter`: square of the filter width without
    /// its factor of x.
    fn set<L: Law>(&self, filter: f64, [strain, squared]: &mut [Vec<f64>; 2], out: &mut [f64]) {
        strain.fill(0.0);
        squared.fill(0.0);
        for corner in CORNERS {
            self.add_corner::<L>(corner, strain, squared);
        }
        let invariants = strain.iter().zip(squared.iter());
        for ((out, (s2, d2)), of_x) in out.iter_mut().zip(invariants).zip(&self.x.filter) {
            *out = filter * of_x * L::rate([0.25 * s2, 0.25 * d2]);
        }
    }
}
