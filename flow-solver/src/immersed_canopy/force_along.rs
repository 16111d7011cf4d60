//! The force that the air exerts along the fabric at the steps of the grid, as a mean over time.
//!
//! The pressure at a step of the cut faces has a part along the fabric ([`FaceTransfer::add_forces_along`]), which the air loses. In viscous flow it is
//! friction: steps shield the values behind them, so that friction is too small by what they take. As a load of the same window it would give light
//! cloth the inertia of the air in those steps. Its mean T over the last share of a passage of the air acts instead:
//! ```math
//! T \leftarrow T + (1 - e^{-\Delta t / \tau})\,(T_{new} - T), \qquad \tau = c\, L / U,
//! ```
//! known before a window begins and the same in all its solutions. What the air loses and what the faces receive are equal in the mean; faster
//! motions of the fabric along itself meet no air. On slip, and where cells do not resolve the friction, the force is an error of the grid and does not
//! act on the fabric (`docs/decisions/0058-force-along-immersed-fabric.md`).
//!
//! [`FaceTransfer::add_forces_along`]: immersed::face_transfer::FaceTransfer::add_forces_along

use nalgebra::Vector3;

/// Time over which the force is averaged, in passages L / U of the air along the canopy.
const TIME_OF_MEAN: f64 = 0.1;
/// Largest share of a new force. Fabric whose air along the surface has r times its own mass is stable up to 2 / (1 + r).
const MAX_SHARE: f64 = 0.2;

/// Mean force along each face, N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeanForceAlong(pub Vec<Vector3<f64>>);

impl MeanForceAlong {
    /// No force on any of the `faces`.
    pub fn zero(faces: usize) -> Self {
        Self(vec![Vector3::zeros(); faces])
    }

    /// Adds the mean to the forces on the faces, N.
    pub fn add_to(&self, forces: &mut [Vector3<f64>]) {
        forces.iter_mut().zip(&self.0).for_each(|(sum, f)| *sum += f);
    }

    /// Takes the forces `new` (N) of an accepted window of `dt` s into the mean; `passage`: time in which the air passes the canopy, s.
    pub fn update(&mut self, new: &[Vector3<f64>], dt: f64, passage: f64) {
        let share = (1.0 - (-dt / (TIME_OF_MEAN * passage)).exp()).min(MAX_SHARE);
        self.0.iter_mut().zip(new).for_each(|(mean, new)| *mean += (new - *mean) * share);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant force is reached, 63 % of it after the time of the mean; still air (an endless passage) changes nothing.
    #[test]
    fn mean_follows_within_a_share_of_a_passage() {
        let force = [Vector3::new(1.0, -2.0, 0.5)];
        let after = |passages: f64, dt: f64| {
            let mut mean = MeanForceAlong::zero(1);
            let steps = (2.0 * passages / dt).round() as usize;
            (0..steps).for_each(|_| mean.update(&force, dt, 2.0));
            mean.0[0].x
        };
        for dt in [0.01, 0.04] {
            assert!((after(TIME_OF_MEAN, dt) - (1.0 - f64::exp(-1.0))).abs() < 1e-12, "{dt}");
            assert!((after(5.0, dt) - 1.0).abs() < 1e-8, "{dt}");
        }
        let mut mean = MeanForceAlong(force.to_vec());
        mean.update(&[Vector3::zeros()], 0.1, f64::INFINITY);
        assert_eq!(mean.0, force);
        // A long window takes a fifth.
        mean.update(&[Vector3::zeros()], 10.0, 1.0);
        assert!((mean.0[0].x - 0.8).abs() < 1e-15);
    }
}
