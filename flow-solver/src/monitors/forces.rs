//! Forces and moments about a point, split by their cause.

use std::path::Path;

use channel::Fault;

use super::table::Table;
use crate::geometry::vec3::Vec3;
use crate::loads::Loads;
use crate::physics::Gas;
use crate::solver::Solver;

/// Force by pressure, force by shear, moment of both.
type Sum = [Vec3; 3];

/// The table `forces.csv`.
pub struct Forces {
    point: Vec3,
    /// Unit vector.
    drag: Vec3,
    /// Whether the outer boundary has no-slip walls.
    walls: bool,
    table: Table,
}

fn put(sum: &mut Sum, pressure: Vec3, shear: Vec3, arm: Vec3) {
    sum[0] += pressure;
    sum[1] += shear;
    sum[2] += arm.cross(&(pressure + shear));
}

impl Forces {
    /// About the point of `f`. Collective.
    pub fn new<G: Gas<N>, const N: usize>(f: &case::Forces, solver: &Solver<G, N>) -> Self {
        let own = solver.topology.no_slip.iter().any(|s| s.canopy == u32::MAX);
        let walls = !solver.comm().all(!own);
        let columns: Vec<String> = ["canopy", "wall"][..1 + usize::from(walls)]
            .iter()
            .flat_map(|on| {
                let vector =
                    |what: &str, unit: &str| ["x", "y", "z"].map(|d| format!("{on}_{what}_{d}_{unit}"));
                let parts =
                    [vector("pressure_force", "n"), vector("shear_force", "n"), vector("moment", "n_m")];
                parts.into_iter().flatten().chain([format!("{on}_drag_n")]).collect::<Vec<_>>()
            })
            .collect();
        let drag = Vec3::from(f.drag_direction);
        Self {
            point: f.moment_point_m.into(),
            drag: drag * (1.0 / drag.norm()),
            walls,
            table: Table::new("forces.csv", &columns),
        }
    }

    /// A row of `forces.csv`; `loads` are those of the accepted state. Collective.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn record<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        loads: &Loads,
        time: f64,
        folder: &Path,
    ) -> Result<(), Fault> {
        let (on, t) = (solver.domain(), &solver.topology);
        let mut sums: [Sum; 2] = [[Vec3::zeros(); 3]; 2];
        for (load, &face) in loads.faces[..t.canopy.n_owned].iter().zip(&t.canopy_face) {
            let f = &solver.metrics.faces[face as usize];
            let shear = Vec3::new(load[1], load[2], load[3]) * f.magnitude();
            put(&mut sums[0], f.area * load[0], shear, solver.metrics.border(face) - self.point);
        }
        if self.walls {
            for side in t.no_slip.iter().filter(|s| s.canopy == u32::MAX) {
                let f = &solver.metrics.faces[side.face as usize];
                let p = solver.spatial.wall_pressure(&on, &solver.q, &solver.gradient, side);
                let shear = if solver.spatial.viscosity.is_active() {
                    solver.spatial.wall_traction(&on, &solver.scheme, &solver.q, side) * f.magnitude()
                } else {
                    Vec3::zeros()
                };
                let arm = solver.metrics.border(side.face) - self.point;
                put(&mut sums[1], f.area * (side.sign * p), shear, arm);
            }
        }
        let used = &sums[..1 + usize::from(self.walls)];
        let mut numbers: Vec<f64> = used.as_flattened().iter().flatten().copied().collect();
        solver.comm().sum_slice(&mut numbers);
        let mut row = Vec::with_capacity(20);
        for sum in numbers.chunks_exact(9) {
            row.extend_from_slice(sum);
            let force = Vec3::from_column_slice(&sum[..3]) + Vec3::from_column_slice(&sum[3..6]);
            row.push(self.drag.dot(&force));
        }
        self.table.row(solver.comm(), folder, time, &row)
    }
}
