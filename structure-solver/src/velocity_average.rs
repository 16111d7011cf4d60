//! Agreement of the structure's velocity with the one that the flow sees.

use case::{Scene, Scheme, StageKind};

/// Draws the velocity at the end of a coupled window towards the mean velocity
/// over the window.
///
/// The flow knows the canopy at the ends of windows only. Several substeps end a
/// window with a velocity $v$ of their own, and where the fabric is much lighter than
/// the air it moves, nothing holds it to the motion that the flow sees: $v$ alternates
/// from window to window, undamped. With
/// $v \leftarrow (1 - \chi) v + \chi (x^{n+1} - x^n) / \Delta t$ this dies out.
///
/// Linear analysis (one mode, ten substeps, the coupler's mean load, added mass 0 to 64
/// times the fabric's, frequency of the dry fabric times window 0.01 to 10): no mode
/// grows for $\chi$ = 1/2, and alternating modes shrink to half in a window. The
/// second-order difference in place of the mean velocity would feed stiff modes that
/// the air does not hold (in the plane of the fabric, lines): up to 1.05 a window.
///
/// The price is a first-order error in the inertia of the *fabric* (up to a third of
/// its mass), which is small beside the air's where this is needed. Choose 0 for heavy
/// structures.
#[derive(Clone, Copy, Debug)]
pub struct VelocityAverage {
    weight: f64,
}

impl VelocityAverage {
    /// As the scene couples: only implicit windows have a converged velocity.
    pub fn of(scene: &Scene, stage: usize) -> Option<Self> {
        let coupled = scene.stages[stage].kind == StageKind::Coupled;
        let weight = scene.coupling.velocity_average;
        (coupled && scene.coupling.scheme == Scheme::Implicit && weight > 0.0).then_some(Self { weight })
    }

    /// Changes `v`, the velocity at the end of a window of length `dt` from
    /// displacement `u0` to `u1`.
    pub fn apply(&self, dt: f64, u0: &[f64], u1: &[f64], v: &mut [f64]) {
        for ((v, u1), u0) in v.iter_mut().zip(u1).zip(u0) {
            *v += self.weight * ((u1 - u0) / dt - *v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_motion_is_kept_and_an_alternation_is_halved() {
        let average = VelocityAverage { weight: 0.5 };
        let mut v = [2.0, 3.0];
        average.apply(0.1, &[1.0, 0.0], &[1.2, 0.1], &mut v);
        assert!((v[0] - 2.0).abs() < 1e-14);
        assert!((v[1] - 2.0).abs() < 1e-14);
    }
}
