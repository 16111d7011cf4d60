//! Forces and moments about a point, split by their cause.

use std::path::Path;

use channel::Fault;

use super::table::Table;
use crate::geometry::vec3::{Vec3, add, cross, dot, norm, scale, sub};
use crate::loads::Loads;
use crate::physics::{Gas, Viscosity};
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
    let moment = cross(arm, add(pressure, shear));
    for (s, v) in sum.iter_mut().zip([pressure, shear, moment]) {
        *s = add(*s, v);
    }
}

impl Forces {
    /// About the point of `f`. Collective.
    pub fn new<G: Gas<N>, V: Viscosity, const N: usize>(f: &case::Forces, solver: &Solver<G, V, N>) -> Self {
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
        Self {
            point: f.moment_point_m,
            drag: scale(1.0 / norm(f.drag_direction), f.drag_direction),
            walls,
            table: Table::new("forces.csv", &columns),
        }
    }

    /// A row of `forces.csv`; `loads` are those of the accepted state. Collective.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn record<G: Gas<N>, V: Viscosity, const N: usize>(
        &mut self,
        solver: &Solver<G, V, N>,
        loads: &Loads,
        time: f64,
        folder: &Path,
    ) -> Result<(), Fault> {
        let (on, t) = (solver.domain(), &solver.topology);
        let mut sums: [Sum; 2] = [[[0.0; 3]; 3]; 2];
        for (load, &face) in loads.faces[..t.canopy.n_owned].iter().zip(&t.canopy_face) {
            let f = &solver.metrics.faces[face as usize];
            let shear = scale(f.magnitude(), [load[1], load[2], load[3]]);
            put(&mut sums[0], scale(load[0], f.area), shear, sub(solver.metrics.border(face), self.point));
        }
        if self.walls {
            for side in t.no_slip.iter().filter(|s| s.canopy == u32::MAX) {
                let f = &solver.metrics.faces[side.face as usize];
                let p = solver.spatial.wall_pressure(&on, &solver.q, &solver.gradient, side);
                let shear = if V::ACTIVE {
                    scale(f.magnitude(), solver.spatial.wall_traction(&on, &solver.scheme, &solver.q, side))
                } else {
                    [0.0; 3]
                };
                put(
                    &mut sums[1],
                    scale(side.sign * p, f.area),
                    shear,
                    sub(solver.metrics.border(side.face), self.point),
                );
            }
        }
        let used = &mut sums[..1 + usize::from(self.walls)];
        solver.comm().sum_slice(used.as_flattened_mut().as_flattened_mut());
        let mut row = Vec::with_capacity(20);
        for sum in used.iter() {
            row.extend_from_slice(sum.as_flattened());
            row.push(dot(self.drag, add(sum[0], sum[1])));
        }
        self.table.row(solver.comm(), folder, time, &row)
    }
}
