//! `forces.csv` of an immersed canopy.

use std::path::{Path, PathBuf};

use case::{ForceCoefficients, Scene};
use channel::Fault;
use comm::Comm;
use nalgebra::Vector3;

use crate::monitors::{Table, coefficient_columns, put, sum_columns};
use crate::surface_force::{Coefficients, ForceSum, entry_coefficients};

/// The table of forces on the canopy, and on it as an entry of `[[flow.forces.coefficients]]`.
pub struct CanopyForces {
    point: Vector3<f64>,
    /// Unit vector.
    drag: Vector3<f64>,
    entries: Vec<(ForceCoefficients, Coefficients)>,
    density: f64,
    table: Table,
    folder: PathBuf,
}

/// A face of the canopy: its middle (m), its area vector (m2) and the force of the air on it (N).
pub type LoadedFace = (Vector3<f64>, Vector3<f64>, Vector3<f64>);

impl CanopyForces {
    /// As `scene` says, with the table in `folder`; `None` where it has no `[flow.forces]`.
    ///
    /// # Errors
    /// Drag and lift of an entry are parallel.
    pub fn new(scene: &Scene, folder: &Path) -> Result<Option<Self>, Fault> {
        let Some((flow, forces)) = scene.flow.as_ref().and_then(|f| Some((f, f.forces.as_ref()?))) else {
            return Ok(None);
        };
        let entry = |e: &ForceCoefficients| Ok((e.clone(), entry_coefficients(e, forces)?));
        let entries = forces.coefficients.iter().map(entry).collect::<Result<Vec<_>, Fault>>()?;
        let mut columns = sum_columns(case::CANOPY);
        columns.extend(entries.iter().flat_map(|(e, _)| coefficient_columns(&e.name)));
        Ok(Some(Self {
            point: forces.moment_point_m.into(),
            drag: Vector3::from(forces.drag_direction).normalize(),
            entries,
            density: flow.density_kg_m3,
            table: Table::new("forces.csv", &columns),
            folder: folder.to_owned(),
        }))
    }

    /// Adds a row for the window that ends at `time` (s), in air of `speed` (m/s) relative to the frame. Collective.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn record(&mut self, comm: &Comm, time: f64, speed: f64, faces: &[LoadedFace]) -> Result<(), Fault> {
        let own = sum(faces, self.point);
        let mut row = Vec::new();
        put(&mut row, &own);
        row.push(self.drag.dot(&(own[0] + own[1])));
        for (entry, coefficients) in &self.entries {
            let sum = sum(faces, coefficients.point);
            put(&mut row, &sum);
            row.extend(coefficients.row(&sum, entry.force_scale(self.density, speed)));
        }
        self.table.row(comm, &self.folder, time, &row)
    }
}

/// Force by pressure, normal to the faces, the rest, and the moment of both about `point`.
fn sum(faces: &[LoadedFace], point: Vector3<f64>) -> ForceSum {
    let mut sum = ForceSum::default();
    for (middle, area, force) in faces {
        let square = area.norm_squared();
        let pressure = if square > 0.0 { area * (force.dot(area) / square) } else { Vector3::zeros() };
        sum[0] += pressure;
        sum[1] += force - pressure;
        sum[2] += (middle - point).cross(force);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two faces by hand: 3 N along the normal z of the first, 2 N across that of the second.
    #[test]
    fn forces_are_split_along_the_normal_and_have_their_moment() {
        let v = Vector3::new;
        let faces = [
            (v(1.0, 0.0, 0.0), v(0.0, 0.0, 0.5), v(0.0, 0.0, 3.0)),
            (v(0.0, 2.0, 1.0), v(0.0, 0.0, -0.5), v(2.0, 0.0, 0.0)),
        ];
        let [pressure, shear, moment] = sum(&faces, v(0.0, 0.0, 0.5));
        assert_eq!((pressure, shear), (v(0.0, 0.0, 3.0), v(2.0, 0.0, 0.0)));
        // (1, 0, -0.5) x (0, 0, 3) + (0, 2, 0.5) x (2, 0, 0).
        assert_eq!(moment, v(0.0, -3.0, 0.0) + v(0.0, 1.0, -4.0));
    }
}
