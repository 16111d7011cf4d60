//! Convection and viscous stress of the staggered velocity.
//!
//! The rate of change of component c is the sum of the fluxes through the faces of its volume,
//! ```math
//! F = v_d\, u_f - \nu\, \partial u / \partial x_d, \qquad
//! u_f = \tfrac{1}{12}\left(-u_{i-1} + 7 u_i + 7 u_{i+1} - u_{i+2}\right)
//!     + \tfrac{s}{12}\,\mathrm{sgn}(v_d) \left(u_{i+2} - 3 u_{i+1} + 3 u_i - u_{i-1}\right)
//! ```
//! with $`v_d`$ the mean over the face of the velocity relative to the grid, which conserves mass in the volume. The upwind share $`s`$ is 0
//! for central differences of fourth order and 1 for upwind ones of third order.
//!
//! **Outflow.** Where air returns through an outflow it brings no momentum of the coordinates: it is that of the far field at rest. Carrying that of the last cell inwards, the flow has no
//! bound: a wake that returns accelerates itself (a disk whose outflow lies 1.5 diameters behind it: seven times the speed of the stream).

use std::ops::Range;

use nalgebra::Vector3;

use crate::grid::{End, Ends, GHOSTS, Grid, Velocity};

/// Constants of the momentum equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Momentum {
    /// Share of upwind differences, 0 to 1.
    pub upwind_share: f64,
    /// Kinematic viscosity, m2/s.
    pub viscosity: f64,
}

/// Largest cell Reynolds number of central differences in laminar flow, and that from which differences are upwind.
const RESOLVED: f64 = 100.0;
const UNRESOLVED: f64 = 1000.0;

/// Upwind share in laminar flow with the largest cell Reynolds number `cell_reynolds`, $`|u| h / \nu`$: 0 up to 100, 1 from 1000 on, linear in its logarithm
/// between. A central flux takes no energy from waves that the cells cannot resolve and viscosity does not damp: the flow around a plate at
/// Re 1e5, on 8 cells across, is not finite after 24 diameters of stream (`docs/records/verification.md`).
pub fn laminar_upwind_share(cell_reynolds: f64) -> f64 {
    ((cell_reynolds / RESOLVED).ln() / (UNRESOLVED / RESOLVED).ln()).clamp(0.0, 1.0)
}

/// Flux through a face between the second and third of four values; `v`: velocity through it, `share`: upwind share over 12,
/// `k`: viscosity over the distance of the middle values.
#[inline(always)]
fn flux(u: [f64; 4], v: f64, share: f64, k: f64) -> f64 {
    let [a, b, c, d] = u;
    let central = (7.0 * (b + c) - (a + d)) * (1.0 / 12.0);
    v * central + (share * v.abs()) * ((d - a) - 3.0 * (c - b)) - k * (c - b)
}

/// Weights of a volume of component `c` along c at index `i`: shares of the lower and the upper cell.
pub(crate) fn shares(grid: &Grid, c: usize, i: usize) -> [f64; 2] {
    let w = &grid.axes[c].widths;
    let (below, above) = match (i, grid.ends[c]) {
        (0, Ends::Periodic) => (w[w.len() - 1], w[0]),
        (0, _) => (w[0], w[0]),
        (i, Ends::Periodic) if i == w.len() => (w[i - 1], w[0]),
        (i, _) if i == w.len() => (w[i - 1], w[i - 1]),
        (i, _) => (w[i - 1], w[i]),
    };
    [below / (below + above), above / (below + above)]
}

/// Geometry of the fluxes of component c along d, by index along d from -1 for fluxes and 0 for volumes.
pub(crate) struct Line {
    /// Inverse distance of the two values next to a flux; entry m + 1 belongs to the flux above value m.
    pub(crate) distance: Vec<f64>,
    /// Inverse width of a volume.
    pub(crate) width: Vec<f64>,
}

impl Line {
    pub(crate) fn new(grid: &Grid, c: usize, d: usize) -> Self {
        let n = grid.axes[d].len();
        let widths = &grid.axes[d].widths;
        let centre = |i: usize| 1.0 / grid.centre_distance(d, i);
        if c == d {
            let first = match grid.ends[d] {
                Ends::Periodic => widths[n - 1],
                Ends::Open(_) => widths[0],
            };
            Self {
                distance: std::iter::once(&first).chain(widths).map(|w| 1.0 / w).collect(),
                width: (0..n).map(centre).collect(),
            }
        } else {
            Self { distance: (0..=n).map(centre).collect(), width: widths.iter().map(|w| 1.0 / w).collect() }
        }
    }
}

impl Momentum {
    /// Rates of change of `u` (m/s2) without pressure, on a grid that moves with the velocity `frame` (m/s). The ghosts of `u` are filled.
    /// Rates at faces that the far field sets have no meaning. `planes`: cells along z for which the rates are wanted.
    pub fn rates(
        &self,
        grid: &Grid,
        u: &Velocity,
        frame: Vector3<f64>,
        planes: Range<usize>,
        rates: &mut Velocity,
    ) {
        let planes = planes.start as isize..planes.end as isize;
        for (c, rates) in rates.iter_mut().enumerate() {
            // The ghosts at the ends, which no rank computes, are saved.
            let ghosts = GHOSTS * grid.strides[2];
            let top = rates.len() - ghosts;
            rates[..ghosts].fill(0.0);
            rates[top..].fill(0.0);
            let fluxes = [0, 1, 2].map(|d| Fluxes::new(self, grid, [c, d], frame[d]));
            sum_fluxes(&fluxes, u, planes.clone(), rates);
        }
    }
}

/// Sets the `rates` of one component in `planes` along z, plane by plane, so that what one direction reads is still near when the next one needs it.
fn sum_fluxes([x, y, z]: &[Fluxes<'_>; 3], u: &Velocity, planes: Range<isize>, rates: &mut [f64]) {
    let grid = x.grid;
    let [nx, ny, _] = grid.cells();
    let (mut along, mut row) = (vec![0.0; nx + 1], vec![0.0; nx]);
    // Fluxes below the row, and below all rows of the plane.
    let (mut below_y, mut below_z) = (vec![0.0; nx], vec![0.0; nx * ny]);
    for (j, below) in below_z.chunks_exact_mut(nx).enumerate() {
        z.across_x(u, [j as isize, planes.start - 1], below);
    }
    for k in planes {
        let first = grid.at([-(GHOSTS as isize), -(GHOSTS as isize), k]);
        let rates = &mut rates[first..first + grid.strides[2]];
        y.across_x(u, [-1, k], &mut below_y);
        for (j, rates) in rates.chunks_exact_mut(grid.strides[1]).enumerate() {
            let Some(j) = j.checked_sub(GHOSTS).filter(|j| *j < ny) else {
                rates.fill(0.0);
                continue;
            };
            let (low, rates) = rates.split_at_mut(GHOSTS);
            let (rates, high) = rates.split_at_mut(nx);
            low.fill(0.0);
            high.fill(0.0);
            x.along_x(u, [j as isize, k], &mut along);
            for ((rate, f), width) in rates.iter_mut().zip(along.windows(2)).zip(&x.line.width) {
                *rate = -((f[1] - f[0]) * width);
            }
            y.across_x(u, [j as isize, k], &mut row);
            subtract(rates, &row, &mut below_y, y.line.width[j]);
            z.across_x(u, [j as isize, k], &mut row);
            subtract(rates, &row, &mut below_z[j * nx..][..nx], z.line.width[k as usize]);
        }
    }
}

/// Subtracts what leaves a row of volumes through its faces `above` less those `below`, which become those above.
fn subtract(rates: &mut [f64], above: &[f64], below: &mut [f64], width: f64) {
    for ((rate, above), below) in rates.iter_mut().zip(above).zip(below) {
        *rate -= (above - *below) * width;
        *below = *above;
    }
}

/// The fluxes of component c along d.
struct Fluxes<'a> {
    grid: &'a Grid,
    c: usize,
    d: usize,
    /// Velocity of the grid along d, m/s.
    frame: f64,
    /// Upwind share over 12.
    share: f64,
    line: Line,
    /// Viscosity over the distance of the two values next to a flux, m/s; entries as of [`Line::distance`].
    viscosity: Vec<f64>,
    /// Shares of the lower and the upper cell in a volume of component c, by index along c.
    shares: [Vec<f64>; 2],
}

impl<'a> Fluxes<'a> {
    fn new(momentum: &Momentum, grid: &'a Grid, [c, d]: [usize; 2], frame: f64) -> Self {
        let line = Line::new(grid, c, d);
        let viscosity = line.distance.iter().map(|d| momentum.viscosity * d).collect();
        let shares = [0, 1].map(|side| (0..grid.axes[c].len()).map(|i| shares(grid, c, i)[side]).collect());
        Self { grid, c, d, frame, share: momentum.upwind_share / 12.0, line, viscosity, shares }
    }

    /// Fluxes along x in the row `[j, k]` of y and z: the one above value -1 first.
    fn along_x(&self, u: &Velocity, [j, k]: [isize; 2], f: &mut [f64]) {
        let n = f.len();
        let start = self.grid.at([0, j, k]);
        let rows = [0, 1, 2, 3].map(|shift| &u[self.c][start - GHOSTS + shift..][..n]);
        if self.c == 0 {
            self.set_along_x(f, rows, |m| 0.5 * (rows[1][m] + rows[2][m]) - self.frame);
        } else {
            let i = if self.c == 1 { j } else { k } as usize;
            let [low, high] = [self.shares[0][i], self.shares[1][i]];
            let [below, above] = [self.grid.strides[self.c], 0].map(|back| &u[0][start - back..][..n]);
            self.set_along_x(f, rows, |m| low * below[m] + high * above[m] - self.frame);
        }
    }

    /// Sets fluxes along x of four `rows` of values with the velocity `v` through each.
    #[inline(always)]
    fn set_along_x(&self, f: &mut [f64], rows: [&[f64]; 4], v: impl Fn(usize) -> f64) {
        let n = f.len();
        let viscosity = &self.viscosity[..n];
        set_row(f, rows, self.share, |m| viscosity[m], &v);
        for m in [0, 1, n - 1] {
            let v = match self.limit(m as isize - 1) {
                Limit::None => continue,
                Limit::Upwards => v(m).max(0.0),
                Limit::Downwards => v(m).min(0.0),
            };
            f[m] = flux(rows.map(|row| row[m]), v, self.share, viscosity[m]);
        }
    }

    /// Fluxes along y or z above the row `[j, k]` of y and z.
    fn across_x(&self, u: &Velocity, [j, k]: [isize; 2], f: &mut [f64]) {
        let (n, s) = (f.len(), self.grid.strides[self.d]);
        let start = self.grid.at([0, j, k]);
        let cell = [0, j, k];
        let m = cell[self.d];
        let viscosity = self.viscosity[(m + 1) as usize];
        let rows = [0, 1, 2, 3].map(|shift| &u[self.c][start + shift * s - s..][..n]);
        if self.c == self.d {
            self.set_across_x(f, rows, m, viscosity, |i| 0.5 * (rows[1][i] + rows[2][i]) - self.frame);
            return;
        }
        let [below, above] = [self.grid.strides[self.c], 0].map(|back| &u[self.d][start + s - back..][..n]);
        if self.c == 0 {
            let [low, high] = [0, 1].map(|side| &self.shares[side][..n]);
            let v = |i: usize| low[i] * below[i] + high[i] * above[i] - self.frame;
            self.set_across_x(f, rows, m, viscosity, v);
        } else {
            let at = cell[self.c] as usize;
            let [low, high] = [0, 1].map(|side| self.shares[side][at]);
            let v = |i: usize| low * below[i] + high * above[i] - self.frame;
            self.set_across_x(f, rows, m, viscosity, v);
        }
    }

    /// Sets fluxes across x above values `m` of four `rows`, with the velocity `v` through each.
    #[inline(always)]
    fn set_across_x(
        &self,
        f: &mut [f64],
        rows: [&[f64]; 4],
        m: isize,
        viscosity: f64,
        v: impl Fn(usize) -> f64,
    ) {
        match self.limit(m) {
            Limit::None => set_row(f, rows, self.share, |_| viscosity, v),
            Limit::Upwards => set_row(f, rows, self.share, |_| viscosity, |i| v(i).max(0.0)),
            Limit::Downwards => set_row(f, rows, self.share, |_| viscosity, |i| v(i).min(0.0)),
        }
    }

    /// What limits the velocity through the flux above value m, so that no momentum enters through an outflow: that of the velocity along the axis passes the
    /// middle of the last cell.
    #[inline(always)]
    fn limit(&self, m: isize) -> Limit {
        let first = if self.c == self.d { 0 } else { -1 };
        match self.grid.ends[self.d] {
            Ends::Open([End::Outflow, _]) if m == first => Limit::Downwards,
            Ends::Open([_, End::Outflow]) if m + 1 == self.grid.axes[self.d].len() as isize => Limit::Upwards,
            _ => Limit::None,
        }
    }
}

/// Where a velocity through a flux may point.
enum Limit {
    None,
    Upwards,
    Downwards,
}

/// Sets a row of fluxes of four rows of values with the velocity `v` through each; `viscosity` over the distance of the middle values.
#[inline(always)]
fn set_row(
    f: &mut [f64],
    [a, b, c, d]: [&[f64]; 4],
    share: f64,
    viscosity: impl Fn(usize) -> f64,
    v: impl Fn(usize) -> f64,
) {
    let n = f.len();
    let [a, b, c, d] = [&a[..n], &b[..n], &c[..n], &d[..n]];
    for i in 0..n {
        f[i] = flux([a[i], b[i], c[i], d[i]], v(i), share, viscosity(i));
    }
}

/// The layers that the fluxes need.
const _: () = assert!(GHOSTS == 2);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laminar_flow_is_upwind_where_cells_do_not_resolve_it() {
        for (cell_reynolds, share) in [(0.0, 0.0), (100.0, 0.0), (1000.0, 1.0), (2.5e4, 1.0)] {
            assert_eq!(laminar_upwind_share(cell_reynolds), share, "{cell_reynolds}");
        }
        assert!((laminar_upwind_share(10f64.powf(2.5)) - 0.5).abs() < 1e-12);
    }
}
