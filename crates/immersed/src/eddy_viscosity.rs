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
//! The step is explicit. Its limit has the rate of [`Flow::largest_eddy_rate`].

use std::ops::Range;

use crate::flow::Flow;
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
struct Lengths {
    /// Distance of the centres on both sides of face i, 1/m.
    distance: Vec<f64>,
    /// Width of cell i - 1: from the cell below the grid to the one above it, 1/m.
    width: Vec<f64>,
    /// Width of cell i to the power of two thirds.
    filter: Vec<f64>,
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
    fn width(&self, i: isize) -> f64 {
        self.width[(i + 1) as usize]
    }
}

/// The eddy viscosity of a flow.
#[derive(Clone, Debug)]
pub(crate) struct EddyViscosity {
    model: SubgridModel,
    /// Kinematic eddy viscosity at the centres of cells, m2/s, with one layer of ghosts filled.
    values: Vec<f64>,
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
        for (c, [low, high]) in friction.segments() {
            if high - low == grid.strides[c] {
                self.values[low] = 0.0;
            } else {
                for at in [low, high] {
                    self.values[at] = 0.0;
                    self.values[at - grid.strides[c]] = 0.0;
                }
            }
        }
    }

    /// Fills the ghosts: the value of the next cell at open ends.
    fn fill_ghosts(&mut self, grid: &Grid, slabs: &Slabs) {
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
    fn largest_rate(&self, grid: &Grid, planes: Range<usize>) -> f64 {
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

/// The stress of an eddy viscosity and its divergence.
struct Stress<'a> {
    grid: &'a Grid,
    u: &'a Velocity,
    viscosity: &'a [f64],
    lengths: &'a [Lengths; 3],
    /// Cells along z whose rates are wanted.
    planes: Range<isize>,
}

/// Adds `factor` times a row of stresses.
#[inline(always)]
fn add(rates: &mut [f64], start: usize, factor: f64, row: &[f64]) {
    for (rate, stress) in rates[start..start + row.len()].iter_mut().zip(row) {
        *rate += factor * stress;
    }
}

impl Stress<'_> {
    /// Cells along y or z whose rates are wanted.
    fn cells(&self, d: usize) -> Range<isize> {
        if d == 2 { self.planes.clone() } else { 0..self.grid.cells()[d] as isize }
    }

    /// Position of the first cell of a row: index `m` along `d`, `o` along the other of y and z.
    fn start(&self, d: usize, m: isize, o: isize) -> usize {
        self.grid.at(if d == 1 { [0, m, o] } else { [0, o, m] })
    }

    /// Normal stress of the component along x.
    fn normal_along_x(&self, row: &mut [f64], rates: &mut [f64]) {
        let nx = self.grid.cells()[0];
        let (row, width) = (&mut row[..nx + 1], &self.lengths[0].width[..nx + 1]);
        let distance = &self.lengths[0].distance[..nx];
        for z in self.planes.clone() {
            for y in self.cells(1) {
                let start = self.grid.at([0, y, z]);
                let u = &self.u[0][start - 1..][..nx + 2];
                let viscosity = &self.viscosity[start - 1..][..nx + 1];
                for (i, stress) in row.iter_mut().enumerate() {
                    *stress = 2.0 * viscosity[i] * ((u[i + 1] - u[i]) * width[i]);
                }
                for ((rate, t), inverse) in
                    rates[start..start + nx].iter_mut().zip(row.windows(2)).zip(distance)
                {
                    *rate += (t[1] - t[0]) * inverse;
                }
            }
        }
    }

    /// Normal stress of the component along `d`, y or z.
    fn normal_across_x(&self, d: usize, row: &mut [f64], rates: &mut [f64]) {
        let (nx, s) = (self.grid.cells()[0], self.grid.strides[d]);
        let lengths = &self.lengths[d];
        let row = &mut row[..nx];
        let faces = self.cells(d);
        for o in self.cells(3 - d) {
            for m in faces.start - 1..faces.end {
                let start = self.start(d, m, o);
                let (u, above) = (&self.u[d][start..][..nx], &self.u[d][start + s..][..nx]);
                let viscosity = &self.viscosity[start..][..nx];
                let width = lengths.width(m);
                for (i, stress) in row.iter_mut().enumerate() {
                    *stress = 2.0 * viscosity[i] * ((above[i] - u[i]) * width);
                }
                if m >= faces.start {
                    add(rates, start, lengths.distance[m as usize], row);
                }
                if m + 1 < faces.end {
                    add(rates, start + s, -lengths.distance[(m + 1) as usize], row);
                }
            }
        }
    }

    /// Shear stress on the edges between the faces of x and of `d`, y or z; `rates`: of these components.
    fn shear_along_x(&self, d: usize, row: &mut [f64], [of_x, of_d]: [&mut Vec<f64>; 2]) {
        let (nx, s) = (self.grid.cells()[0], self.grid.strides[d]);
        let [x, lengths] = [&self.lengths[0], &self.lengths[d]];
        let (row, distance, width) = (&mut row[..nx + 1], &x.distance[..nx + 1], &x.width[1..][..nx]);
        let cells = self.cells(d);
        for o in self.cells(3 - d) {
            for m in cells.start..=cells.end {
                let start = self.start(d, m, o);
                let (u, below) = (&self.u[0][start..][..nx + 1], &self.u[0][start - s..][..nx + 1]);
                let v = &self.u[d][start - 1..][..nx + 2];
                let [a, b] = [start, start - s].map(|at| &self.viscosity[at - 1..][..nx + 2]);
                let inverse = lengths.distance[m as usize];
                for (i, stress) in row.iter_mut().enumerate() {
                    let viscosity = 0.25 * ((a[i] + a[i + 1]) + (b[i] + b[i + 1]));
                    *stress = viscosity * ((u[i] - below[i]) * inverse + (v[i + 1] - v[i]) * distance[i]);
                }
                if m < cells.end {
                    add(of_x, start, -lengths.width(m), &row[..nx]);
                    let rates = of_d[start..start + nx].iter_mut();
                    for ((rate, t), inverse) in rates.zip(row.windows(2)).zip(width) {
                        *rate += (t[1] - t[0]) * inverse;
                    }
                }
                if m > cells.start {
                    add(of_x, start - s, lengths.width(m - 1), &row[..nx]);
                }
            }
        }
    }

    /// Shear stress on the edges between the faces of y and of z; `rates`: of these components.
    fn shear_across_x(&self, row: &mut [f64], [of_y, of_z]: [&mut Vec<f64>; 2]) {
        let [_, sy, sz] = self.grid.strides;
        let [_, y, z] = &self.lengths;
        let row = &mut row[..self.grid.cells()[0]];
        let (rows, planes) = (self.cells(1), self.planes.clone());
        for k in planes.start..=planes.end {
            for j in rows.start..=rows.end {
                let start = self.grid.at([0, j, k]);
                let n = row.len();
                let (v, v_below) = (&self.u[1][start..][..n], &self.u[1][start - sz..][..n]);
                let (w, w_below) = (&self.u[2][start..][..n], &self.u[2][start - sy..][..n]);
                let [a, b, c, e] = [0, sy, sz, sy + sz].map(|shift| &self.viscosity[start - shift..][..n]);
                let [along_z, along_y] = [z.distance[k as usize], y.distance[j as usize]];
                for (i, stress) in row.iter_mut().enumerate() {
                    let viscosity = 0.25 * ((a[i] + b[i]) + (c[i] + e[i]));
                    *stress = viscosity * ((v[i] - v_below[i]) * along_z + (w[i] - w_below[i]) * along_y);
                }
                if j < rows.end && k < planes.end {
                    add(of_y, start, -z.width(k), row);
                    add(of_z, start, -y.width(j), row);
                }
                if j < rows.end && k > planes.start {
                    add(of_y, start - sz, z.width(k - 1), row);
                }
                if j > rows.start && k < planes.end {
                    add(of_z, start - sy, y.width(j - 1), row);
                }
            }
        }
    }
}

impl Flow {
    /// Sets the model of the eddies that cells do not resolve; `None`: laminar flow, which costs nothing.
    pub fn set_subgrid_model(&mut self, model: Option<SubgridModel>) {
        self.eddies = model.map(|model| EddyViscosity::new(&self.grid, model));
    }

    /// The model of [`Self::set_subgrid_model`].
    pub fn subgrid_model(&self) -> Option<SubgridModel> {
        self.eddies.as_ref().map(|eddies| eddies.model)
    }

    /// Largest $`4 \nu_t \sum_d h_d^{-2}`$ of the velocity as it is, 1/s: what the eddy viscosity adds to the rate that limits the step, as
    /// $`12 \nu / h^2`$ of the molecular one. Zero without a model. `friction`: of the surface as it is. On several ranks collective.
    pub fn largest_eddy_rate(&mut self, friction: Option<&Friction>) -> f64 {
        let Self { grid, velocity, slabs, eddies, .. } = self;
        let Some(eddies) = eddies else { return 0.0 };
        eddies.update(grid, velocity, slabs, friction);
        let mut largest = [eddies.largest_rate(grid, slabs.own())];
        slabs.ranks().largest(&mut largest);
        largest[0]
    }

    /// Kinematic eddy viscosity of the cells at the last prediction, m2/s, x fastest; none without a model. On several ranks of the own cells.
    pub fn eddy_viscosities(&self) -> Vec<f64> {
        let Some(eddies) = &self.eddies else { return Vec::new() };
        let [x, y, _] = self.grid.all_cells();
        let cells = [x, y, self.slabs.own()];
        cells_of(&cells).map(|cell| eddies.values[self.grid.at(cell.map(|i| i as isize))]).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::axis::Axis;

    /// Periodic along all axes, with cells whose width changes by a factor of two.
    fn stretched(n: usize) -> Grid {
        let axis = |shift: f64| {
            let at = |i: usize| {
                let x = TAU * i as f64 / n as f64;
                x + 0.3 * (x + shift).sin()
            };
            let faces: Vec<f64> = (0..=n).map(at).collect();
            let widths = faces.windows(2).map(|f| f[1] - f[0]).collect();
            Axis { faces, widths, core: 0..n, spacing: TAU / n as f64 }
        };
        Grid::new([axis(0.0), axis(1.0), axis(2.5)], [Ends::Periodic; 3])
    }

    /// Calls `of` with the position in an array and the indices of all cells, also of the first layer of ghosts.
    fn for_all(grid: &Grid, mut of: impl FnMut(usize, [isize; 3])) {
        let [nx, ny, nz] = grid.cells().map(|n| n as isize);
        for (k, j, i) in
            (-1..=nz).flat_map(|k| (-1..=ny).flat_map(move |j| (-1..=nx).map(move |i| (k, j, i))))
        {
            of(grid.at([i, j, k]), [i, j, k]);
        }
    }

    /// Coordinate along d of face or centre `i`, beyond the ends by a period.
    fn coordinate(grid: &Grid, d: usize, i: isize, face: bool) -> f64 {
        let n = grid.cells()[d] as isize;
        let (inside, period) = (i.rem_euclid(n), i.div_euclid(n));
        let axis = &grid.axes[d];
        let x = if face { axis.faces[inside as usize] } else { axis.centre(inside as usize) };
        x + TAU * period as f64
    }

    /// Wave number, phase and amplitude of each component, and of the eddy viscosity around 1.
    const WAVES: [([f64; 3], f64, f64); 3] =
        [([1.0, 1.0, 0.0], 0.3, 1.0), ([0.0, 1.0, 1.0], 1.1, -0.7), ([1.0, -1.0, 1.0], 0.4, 0.8)];
    const EDDIES: ([f64; 3], f64, f64) = ([1.0, 0.0, 1.0], 0.8, 0.4);

    fn phase((k, shift, _): ([f64; 3], f64, f64), x: [f64; 3]) -> f64 {
        k[0] * x[0] + k[1] * x[1] + k[2] * x[2] + shift
    }

    /// Divergence of the stress of [`WAVES`] and [`EDDIES`] for component `c`, from the derivatives of both.
    fn exact(c: usize, x: [f64; 3]) -> f64 {
        let first = |c: usize, d: usize| WAVES[c].2 * WAVES[c].0[d] * phase(WAVES[c], x).cos();
        let second = |c: usize, d: usize, e: usize| {
            -WAVES[c].2 * WAVES[c].0[d] * WAVES[c].0[e] * phase(WAVES[c], x).sin()
        };
        let (k, _, amplitude) = EDDIES;
        let (sine, cosine) = phase(EDDIES, x).sin_cos();
        let of_axis = |d: usize| {
            amplitude * k[d] * cosine * (first(c, d) + first(d, c))
                + (1.0 + amplitude * sine) * (second(c, d, d) + second(d, c, d))
        };
        of_axis(0) + of_axis(1) + of_axis(2)
    }

    /// Root mean square and largest error of the divergence of a stress with variable viscosity on `n` stretched cells along each axis.
    fn errors(n: usize) -> [f64; 2] {
        let grid = stretched(n);
        let mut u = grid.uniform(nalgebra::Vector3::zeros());
        let mut rates = u.clone();
        let mut eddies = EddyViscosity::new(&grid, SubgridModel::Wale);
        let point = |cell: [isize; 3], c: usize| [0, 1, 2].map(|d| coordinate(&grid, d, cell[d], c == d));
        for_all(&grid, |at, cell| {
            for c in 0..3 {
                u[c][at] = WAVES[c].2 * phase(WAVES[c], point(cell, c)).sin();
            }
            eddies.values[at] = 1.0 + EDDIES.2 * phase(EDDIES, point(cell, 3)).sin();
        });
        eddies.add_rates(&grid, &u, 0..n, &mut rates);
        let (mut square, mut largest) = (0.0, 0.0f64);
        for cell in cells_of(&grid.all_cells()) {
            let cell = cell.map(|i| i as isize);
            for (c, rates) in rates.iter().enumerate() {
                let error = rates[grid.at(cell)] - exact(c, point(cell, c));
                square += error * error;
                largest = largest.max(error.abs());
            }
        }
        [(square / (3 * n * n * n) as f64).sqrt(), largest]
    }

    #[test]
    fn stress_of_variable_viscosity_is_of_second_order_on_stretched_cells() {
        let found = [16, 32, 64].map(errors);
        for norm in 0..2 {
            let orders = [0, 1].map(|i| (found[i][norm] / found[i + 1][norm]).log2());
            println!("errors {:?}, orders {orders:?}", found.map(|f| f[norm]));
            assert!((1.9..2.1).contains(&orders[1]), "{norm}: {orders:?}");
        }
        assert!(found[2][0] < 6e-3, "{found:?}");
    }

    /// Of any velocity and any eddy viscosity: momentum is conserved to round-off, and energy is taken. A uniform velocity has no stress at all.
    #[test]
    fn stress_conserves_momentum_and_takes_energy() {
        let n = 12;
        let grid = stretched(n);
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut eddies = EddyViscosity::new(&grid, SubgridModel::Smagorinsky);
        let slabs = Slabs::new(std::rc::Rc::new(crate::slabs::Alone), &grid).expect("one rank");
        let far = nalgebra::Vector3::new(2.0, -1.0, 3.0);
        let mut u = grid.uniform(far);
        let mut rates = grid.uniform(nalgebra::Vector3::zeros());
        eddies.values.iter_mut().for_each(|v| *v = noise());
        eddies.fill_ghosts(&grid, &slabs);
        eddies.add_rates(&grid, &u, 0..n, &mut rates);
        assert!(rates.iter().flatten().all(|r| *r == 0.0));
        u.iter_mut().flatten().for_each(|u| *u = noise() - 0.5);
        grid.fill_ghosts(&mut u, far, &slabs);
        eddies.add_rates(&grid, &u, 0..n, &mut rates);
        let mut work = 0.0;
        for c in 0..3 {
            let (mut momentum, mut size) = (0.0, 0.0);
            for cell in cells_of(&grid.all_cells()) {
                let length = |d: usize| {
                    if c == d { grid.centre_distance(d, cell[d]) } else { grid.axes[d].widths[cell[d]] }
                };
                let at = grid.at(cell.map(|i| i as isize));
                let force = rates[c][at] * length(0) * length(1) * length(2);
                momentum += force;
                size += force.abs();
                work += force * u[c][at];
            }
            assert!(momentum.abs() < 1e-14 * size && size > 1.0, "{c}: {momentum:e} of {size}");
        }
        assert!(work < -1.0, "{work}");
    }
}
