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
        let array = grid.at([-(GHOSTS as isize), -(GHOSTS as isize), planes.start]);
        let length = planes.len() * grid.strides[2];
        for (c, rates) in rates.iter_mut().enumerate() {
            rates[array..array + length].fill(0.0);
            // The ghosts at the ends, which no rank computes, are saved.
            let ghosts = GHOSTS * grid.strides[2];
            let top = rates.len() - ghosts;
            rates[..ghosts].fill(0.0);
            rates[top..].fill(0.0);
            for d in 0..3 {
                let line = Line::new(grid, c, d);
                let pass = Pass { grid, momentum: self, c, d, frame: frame[d], line, planes: planes.clone() };
                match (d, c) {
                    (0, 0) => pass.along_x::<true>(u, rates),
                    (0, _) => pass.along_x::<false>(u, rates),
                    (_, 0) => pass.across_x::<true>(u, rates),
                    _ => pass.across_x::<false>(u, rates),
                }
            }
        }
    }
}

/// The fluxes of component c along d.
struct Pass<'a> {
    grid: &'a Grid,
    momentum: &'a Momentum,
    c: usize,
    d: usize,
    frame: f64,
    line: Line,
    /// Cells along z.
    planes: Range<isize>,
}

impl Pass<'_> {
    /// Velocity through the flux above value m, limited so that no momentum enters through an outflow: that of the velocity along the axis passes the middle
    /// of the last cell.
    #[inline(always)]
    fn limited(&self, v: f64, m: isize) -> f64 {
        let first = if self.c == self.d { 0 } else { -1 };
        match self.grid.ends[self.d] {
            Ends::Open([End::Outflow, _]) if m == first => v.min(0.0),
            Ends::Open([_, End::Outflow]) if m + 1 == self.grid.axes[self.d].len() as isize => v.max(0.0),
            _ => v,
        }
    }

    /// Fluxes along x. `OWN`: c is x.
    fn along_x<const OWN: bool>(&self, u: &Velocity, rates: &mut [f64]) {
        let [nx, ny, _] = self.grid.cells();
        let share = self.momentum.upwind_share / 12.0;
        let mut f = vec![0.0; nx + 1];
        let k: Vec<f64> = self.line.distance.iter().map(|d| self.momentum.viscosity * d).collect();
        for z in self.planes.clone() {
            for y in 0..ny as isize {
                let start = self.grid.at([0, y, z]);
                let own = &u[self.c][start - 2..start + nx + 2];
                if OWN {
                    for (m, f) in f.iter_mut().enumerate() {
                        let w = [own[m], own[m + 1], own[m + 2], own[m + 3]];
                        *f = flux(w, 0.5 * (w[1] + w[2]) - self.frame, share, k[m]);
                    }
                    if let Ends::Open(_) = self.grid.ends[0] {
                        for m in [1, nx] {
                            let w = [own[m], own[m + 1], own[m + 2], own[m + 3]];
                            let v = 0.5 * (w[1] + w[2]) - self.frame;
                            f[m] = flux(w, self.limited(v, m as isize - 1), share, k[m]);
                        }
                    }
                } else {
                    let [low, high] = shares(self.grid, self.c, [0, y as usize, z as usize][self.c]);
                    let back = self.grid.strides[self.c];
                    let above = &u[0][start..=start + nx];
                    let below = &u[0][start - back..=start - back + nx];
                    for (m, f) in f.iter_mut().enumerate() {
                        let w = [own[m], own[m + 1], own[m + 2], own[m + 3]];
                        *f = flux(w, low * below[m] + high * above[m] - self.frame, share, k[m]);
                    }
                    if let Ends::Open(_) = self.grid.ends[0] {
                        for m in [0, nx] {
                            let w = [own[m], own[m + 1], own[m + 2], own[m + 3]];
                            let v = low * below[m] + high * above[m] - self.frame;
                            f[m] = flux(w, self.limited(v, m as isize - 1), share, k[m]);
                        }
                    }
                }
                for ((rate, f), width) in
                    rates[start..start + nx].iter_mut().zip(f.windows(2)).zip(&self.line.width)
                {
                    *rate -= (f[1] - f[0]) * width;
                }
            }
        }
    }

    /// Fluxes along y or z, a row of x at a time. `OWN`: c is x.
    fn across_x<const OWN: bool>(&self, u: &Velocity, rates: &mut [f64]) {
        let n = self.grid.cells();
        let (nx, d, s) = (n[0], self.d, self.grid.strides[self.d]);
        let other = 3 - d;
        let share = self.momentum.upwind_share / 12.0;
        let weights: Vec<[f64; 2]> = (0..nx).map(|i| shares(self.grid, 0, i)).collect();
        let (mut before, mut f) = (vec![0.0; nx], vec![0.0; nx]);
        let cells = |axis: usize| if axis == 2 { self.planes.clone() } else { 0..n[axis] as isize };
        for o in cells(other) {
            let along = cells(d);
            for m in along.start - 1..along.end {
                let mut cell = [0; 3];
                (cell[d], cell[other]) = (m, o);
                let start = self.grid.at(cell);
                let k = self.momentum.viscosity * self.line.distance[(m + 1) as usize];
                let row = |shift: usize| &u[self.c][start + shift * s - s..][..nx];
                let rows = [row(0), row(1), row(2), row(3)];
                let through = &u[d];
                if OWN {
                    let above = &through[start + s..][..nx];
                    let below = &through[start + s - 1..][..nx];
                    for i in 0..nx {
                        let w = [rows[0][i], rows[1][i], rows[2][i], rows[3][i]];
                        let v = weights[i][0] * below[i] + weights[i][1] * above[i] - self.frame;
                        f[i] = flux(w, self.limited(v, m), share, k);
                    }
                } else if self.c == d {
                    for i in 0..nx {
                        let w = [rows[0][i], rows[1][i], rows[2][i], rows[3][i]];
                        let v = 0.5 * (w[1] + w[2]) - self.frame;
                        f[i] = flux(w, self.limited(v, m), share, k);
                    }
                } else {
                    let back = self.grid.strides[self.c];
                    let [low, high] = shares(self.grid, self.c, cell[self.c] as usize);
                    let above = &through[start + s..][..nx];
                    let below = &through[start + s - back..][..nx];
                    for i in 0..nx {
                        let w = [rows[0][i], rows[1][i], rows[2][i], rows[3][i]];
                        f[i] =
                            flux(w, self.limited(low * below[i] + high * above[i] - self.frame, m), share, k);
                    }
                }
                if m >= along.start {
                    let width = self.line.width[m as usize];
                    for ((rate, f), before) in rates[start..start + nx].iter_mut().zip(&f).zip(&before) {
                        *rate -= (f - before) * width;
                    }
                }
                std::mem::swap(&mut before, &mut f);
            }
        }
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
