//! Relaxation of displacement and load together, for Jacobi order.

use channel::LOAD_WIDTH;

use super::added_mass::{AddedMassRelaxation, MassProperties};
use super::relaxation::Relaxation;
use crate::geometry::{at, distinct};
use crate::schemes::unknowns::Unknowns;

/// Newton's step for a model of both programs: the structure responds to a pressure $`\delta p`$ with
/// $`S\,\delta p`$ along the normals, the flow a displacement $`\delta x`$ with $`-S^{-1}G\,\delta x`$,
/// $`G`$ as in [`AddedMassRelaxation`]. With the residuals $`r_x`$, $`r_p`$ of both,
///
/// ```math
/// (I + G)\,\delta x = r_x + S\,r_p, \qquad \delta p = S^{-1}(\delta x - r_x).
/// ```
///
/// The load is scaled by [`Unknowns::with_loads`], so that $`S`$ is of order one.
pub struct JacobiRelaxation {
    model: AddedMassRelaxation,
    unknowns: Unknowns,
    /// Displacement of a node per scaled pressure on its faces.
    response: f64,
}

impl JacobiRelaxation {
    /// With the model for the displacement alone and the `unknowns` with loads; `dt` is the length of a window,
    /// `masses` those of the model.
    pub fn new(model: AddedMassRelaxation, unknowns: Unknowns, masses: &MassProperties, dt: f64) -> Self {
        let moved = masses.response * dt * dt / masses.fabric_kg_m2;
        Self { model, unknowns, response: moved / unknowns.load_scale() }
    }
}

impl Relaxation for JacobiRelaxation {
    fn apply(&self, residual: &[f64], step: &mut [f64]) {
        let split = residual.len() - self.unknowns.loads();
        let (r_x, r_p) = residual.split_at(split);
        let mut combined_residual = r_x.to_vec();
        let faces = self.model.faces().iter().zip(self.model.face_normals());
        for ((face, normal), load) in faces.clone().zip(r_p.chunks_exact(LOAD_WIDTH)) {
            for &node in distinct(face) {
                let share = self.response / self.model.faces_at(node);
                (0..3).for_each(|i| combined_residual[3 * node as usize + i] += share * load[0] * normal[i]);
            }
        }
        let (step_x, step_p) = step.split_at_mut(split);
        self.model.apply(&combined_residual, step_x);
        step_p.copy_from_slice(r_p);
        for ((face, normal), load) in faces.zip(step_p.chunks_exact_mut(LOAD_WIDTH)) {
            let nodes = distinct(face);
            let moved: f64 = nodes.iter().map(|&n| at(step_x, n).dot(normal) - at(r_x, n).dot(normal)).sum();
            load[0] = moved / nodes.len() as f64 / self.response;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_axes::FrameAxes;
    use crate::schemes::surrogate::vortex_lattice::{Air, VortexLattice};
    use crate::schemes::test_support::plate;

    /// The two equations of [`JacobiRelaxation`] for a uniform pressure: the structure responds with `response dt^2 /
    /// mass` along the normals, z.
    #[test]
    fn step_solves_both_equations() {
        let (positions, faces) = plate(4);
        let (dt, scale) = (5e-3, 2e-4);
        let masses = MassProperties {
            fabric_kg_m2: 0.0373,
            air: Air::incompressible(1.2),
            response: 0.275,
            difference: 1.5,
            falling_kg: 0.0,
        };
        let plain = Unknowns::new(positions.len(), dt, FrameAxes::None);
        let unknowns = plain.with_loads(LOAD_WIDTH * faces.len(), scale);
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let model = AddedMassRelaxation::new(unknowns, &faces, &masses, &lattice).expect("a plate");
        let r_x: Vec<f64> = (0..3 * positions.len()).map(|i| (1.7 * i as f64).sin()).collect();
        let pressure = 30.0;
        let response = 0.275 * dt * dt / 0.0373;
        // Tractions are not changed.
        let r_p: Vec<f64> = faces.iter().flat_map(|_| [pressure * scale, 0.1, 0.2, 0.3]).collect();

        let mut combined_residual = r_x.clone();
        combined_residual.iter_mut().skip(2).step_by(3).for_each(|z| *z += response * pressure);
        let mut expected = vec![0.0; r_x.len()];
        model.apply(&combined_residual, &mut expected);

        let mut step = vec![0.0; unknowns.len()];
        JacobiRelaxation::new(model, unknowns, &masses, dt).apply(&[&r_x[..], &r_p].concat(), &mut step);
        assert!(step.iter().zip(&expected).all(|(s, w)| (s - w).abs() < 1e-12));
        for (face, load) in faces.iter().zip(step[r_x.len()..].chunks_exact(LOAD_WIDTH)) {
            let z = |n: u32| 3 * n as usize + 2;
            let moved = face.iter().map(|&n| expected[z(n)] - r_x[z(n)]).sum::<f64>() / 4.0;
            assert!((load[0] / scale - moved / response).abs() < 1e-9 * (moved / response).abs().max(1.0));
            assert_eq!(load[1..], [0.1, 0.2, 0.3]);
        }
    }
}
