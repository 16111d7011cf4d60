//! A flow on another grid.

use nalgebra::Vector3;

use crate::device::NoDevice;
use crate::flow::Flow;
use crate::grid::Grid;
use crate::slabs::TooManyRanks;

/// Positions of the values of one component of a grid along one axis among those of another.
struct Interpolation(Vec<Option<(isize, f64)>>);

impl Interpolation {
    fn new(from: &Grid, to: &Grid, c: usize, d: usize, origin: f64) -> Self {
        let count = |grid: &Grid| grid.axes[d].len() + usize::from(c == d);
        let old: Vec<f64> = (0..count(from)).map(|i| from.coordinate(c, d, i)).collect();
        let of = |i: usize| {
            let x = to.coordinate(c, d, i) + origin;
            let above = old.partition_point(|o| *o <= x);
            match above {
                0 => None,
                // At the last point, or half a cell beyond it.
                n if n == old.len() => (x <= old[n - 1] + 1e-9).then_some((n as isize - 2, 1.0)),
                n => Some((n as isize - 1, (x - old[n - 1]) / (old[n] - old[n - 1]))),
            }
        };
        Self((0..count(to)).map(of).collect())
    }
}

/// Value of a component at a point of another grid; `None` outside of this one.
fn interpolated(grid: &Grid, u: &[f64], lines: &[Interpolation; 3], cell: [usize; 3]) -> Option<f64> {
    let [x, y, z] = [lines[0].0[cell[0]]?, lines[1].0[cell[1]]?, lines[2].0[cell[2]]?];
    let mut sum = 0.0;
    for corner in 0..8isize {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let share = |(_, s): (isize, f64), upper: isize| if upper == 1 { s } else { 1.0 - s };
        let weight = share(x, i) * share(y, j) * share(z, k);
        if weight != 0.0 {
            sum += weight * u[grid.at([x.0 + i, y.0 + j, z.0 + k])];
        }
    }
    Some(sum)
}

/// No flow on another grid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoNewGrid {
    /// A grid too small for the ranks.
    #[error(transparent)]
    Ranks(#[from] TooManyRanks),
    /// A device that cannot hold it.
    #[error(transparent)]
    Device(#[from] NoDevice),
}

impl Flow {
    /// The same flow on another grid, whose origin lies at `origin` (m) in the coordinates of this one: interpolated linearly, the far field's velocity
    /// where this grid ends, `far` at each height in the new grid if it is not the same everywhere. The next step removes what divergence that leaves; it is of first order in time.
    ///
    /// # Errors
    /// A grid with too few cells for the ranks, or too many for a device.
    pub fn on_grid(
        &mut self,
        grid: Grid,
        origin: Vector3<f64>,
        far: Option<&dyn Fn(f64) -> Vector3<f64>>,
    ) -> Result<Self, NoNewGrid> {
        self.gather();
        self.release_arrays();
        let mut flow = Self::on_ranks(grid, self.settings, self.slabs().ranks().clone())?;
        let device = self.device();
        self.device = None;
        flow.set_subgrid_model(self.subgrid_model());
        if let Some(far) = far {
            flow.set_far_by_height(far, far);
        }
        for c in 0..3 {
            let lines = [0, 1, 2].map(|d| Interpolation::new(&self.grid, &flow.grid, c, d, origin[d]));
            let extent = |d: usize| flow.grid.axes[d].len() + usize::from(c == d);
            for k in 0..extent(2) {
                for j in 0..extent(1) {
                    for i in 0..extent(0) {
                        let value = interpolated(&self.grid, &self.velocity[c], &lines, [i, j, k]);
                        let at = flow.grid.at([i, j, k].map(|i| i as isize));
                        flow.velocity[c][at] = value.unwrap_or(flow.far_field.at(c, k as isize));
                    }
                }
            }
        }
        flow.fill_ghosts();
        flow.set_device(device)?;
        Ok(flow)
    }
}
