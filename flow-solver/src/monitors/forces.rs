//! Forces and moments, split by their cause, and their coefficients.

use std::path::Path;

use channel::Fault;

use super::table::Table;
use crate::geometry::vec3::Vec3;
use crate::loads::Loads;
use crate::physics::Gas;
use crate::setup::Setup;
use crate::solver::Solver;
use crate::surface_force::{self, Coefficients, ForceSum, Surfaces};

/// Columns of a sum: two forces, a moment, the drag.
const VECTORS: [(&str, &str); 3] = [("pressure_force", "n"), ("shear_force", "n"), ("moment", "n_m")];
/// Further columns of an entry of `[[flow.forces.coefficients]]`.
const OF_AN_ENTRY: [&str; 8] = ["side_n", "lift_n", "cd", "cs", "cl", "cm_roll", "cm_pitch", "cm_yaw"];

/// An entry of `[[flow.forces.coefficients]]`.
struct Entry {
    scene: case::ForceCoefficients,
    surfaces: Surfaces,
    coefficients: Coefficients,
}

/// The table `forces.csv`.
pub struct Forces {
    point: Vec3,
    /// Unit vector.
    drag: Vec3,
    /// Whether there is a canopy.
    canopy: bool,
    /// Whether the outer boundary has no-slip walls.
    walls: bool,
    entries: Vec<Entry>,
    /// Density of the undisturbed air, kg/m3.
    density: f64,
    table: Table,
}

/// Names of the columns of a sum of forces on `on`.
pub(crate) fn sum_columns(on: &str) -> Vec<String> {
    let vectors =
        VECTORS.iter().flat_map(|(what, unit)| ["x", "y", "z"].map(|d| format!("{on}_{what}_{d}_{unit}")));
    vectors.chain([format!("{on}_drag_n")]).collect()
}

/// Names of the columns of an entry of `[[flow.forces.coefficients]]`.
pub(crate) fn coefficient_columns(entry: &str) -> Vec<String> {
    let further = OF_AN_ENTRY.iter().map(|c| format!("{entry}_{c}"));
    sum_columns(entry).into_iter().chain(further).collect()
}

impl Forces {
    /// About the points of `f`, which is of the scene of `setup`. Collective.
    ///
    /// # Errors
    /// Drag and lift of an entry are parallel.
    pub fn new<G: Gas<N>, const N: usize>(
        f: &case::Forces,
        setup: &Setup,
        solver: &Solver<G, N>,
    ) -> Result<Self, Fault> {
        let own = solver.topology.no_slip.iter().any(|s| s.canopy == u32::MAX);
        let (canopy, walls) = (!setup.grid.canopy_faces.is_empty(), !solver.comm().all(!own));
        let entry = |e: &case::ForceCoefficients| {
            let coefficients = surface_force::entry_coefficients(e, f)?;
            let surfaces = Surfaces::new(e, &setup.flow, &setup.grid.patch_names);
            Ok(Entry { scene: e.clone(), surfaces, coefficients })
        };
        let entries = f.coefficients.iter().map(entry).collect::<Result<Vec<_>, Fault>>()?;
        let mut columns: Vec<String> = [("canopy", canopy), ("wall", walls)]
            .iter()
            .filter(|set| set.1)
            .flat_map(|set| sum_columns(set.0))
            .collect();
        for e in &entries {
            columns.extend(coefficient_columns(&e.scene.name));
        }
        let drag = Vec3::from(f.drag_direction);
        Ok(Self {
            point: f.moment_point_m.into(),
            drag: drag * (1.0 / drag.norm()),
            canopy,
            walls,
            entries,
            density: setup.flow.density_kg_m3,
            table: Table::new("forces.csv", &columns),
        })
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
        let mut sums = Vec::new();
        if self.canopy {
            sums.push(surface_force::canopy(solver, loads, self.point));
        }
        if self.walls {
            sums.push(surface_force::no_slip_walls(solver, self.point));
        }
        let own = sums.len();
        sums.extend(self.entries.iter().map(|e| e.surfaces.force(solver, loads, e.coefficients.point)));
        surface_force::summed(solver, &mut sums);
        let mut row = Vec::new();
        for sum in &sums[..own] {
            put(&mut row, sum);
            row.push(self.drag.dot(&(sum[0] + sum[1])));
        }
        let speed = (solver.scheme.wind - solver.scheme.frame).norm();
        for (sum, e) in sums[own..].iter().zip(&self.entries) {
            put(&mut row, sum);
            row.extend(e.coefficients.row(sum, e.scene.force_scale(self.density, speed)));
        }
        self.table.row(solver.comm(), folder, time, &row)
    }
}

/// Adds the components of a sum to a row.
pub(crate) fn put(row: &mut Vec<f64>, sum: &ForceSum) {
    row.extend(sum.iter().flat_map(|v| v.iter().copied()));
}
