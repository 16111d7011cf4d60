//! Stress of an eddy viscosity, and its divergence ([`crate::eddy_viscosity`] has the equation).
//!
//! A normal stress lies at the centre of a cell, a shear stress on the edge between four cells; each is the flux between two volumes of one component.

use std::ops::Range;

use crate::eddy_viscosity::Lengths;
use crate::grid::{Grid, Velocity};

/// The stress of an eddy viscosity and its divergence.
pub(crate) struct Stress<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) u: &'a Velocity,
    pub(crate) viscosity: &'a [f64],
    pub(crate) lengths: &'a [Lengths; 3],
    /// Cells along z whose rates are wanted.
    pub(crate) planes: Range<isize>,
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
    pub(crate) fn normal_along_x(&self, row: &mut [f64], rates: &mut [f64]) {
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
    pub(crate) fn normal_across_x(&self, d: usize, row: &mut [f64], rates: &mut [f64]) {
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
    pub(crate) fn shear_along_x(&self, d: usize, row: &mut [f64], [of_x, of_d]: [&mut Vec<f64>; 2]) {
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
    pub(crate) fn shear_across_x(&self, row: &mut [f64], [of_y, of_z]: [&mut Vec<f64>; 2]) {
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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::axis::Axis;
    use crate::eddy_viscosity::{EddyViscosity, SubgridModel};
    use crate::grid::Ends;
    use crate::projection::cells_of;
    use crate::slabs::Slabs;

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
        grid.fill_ghosts(&mut u, &far.into(), &slabs);
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
