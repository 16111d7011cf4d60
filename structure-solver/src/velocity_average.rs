//! Agreement of the structure's velocity with the one that the flow sees.

use case::{Scene, Scheme, StageKind};

/// Draws the velocity at the end of a coupled window towards the wall velocity
/// of the flow.
///
/// The flow knows the canopy at the ends of windows only and takes its velocity
/// as the BDF2 difference of these positions,
/// $w = (3 x^{n+1} - 4 x^n + x^{n-1}) / (2 \Delta t)$. Several substeps in a window
/// end with a velocity $v$ of their own, and where the fabric is much lighter than
/// the air it moves, nothing holds the two together: $v - w$ alternates from window
/// to window, undamped. With $v \leftarrow (1 - \chi) v + \chi w$ it dies out. Both
/// are second-order approximations of the same velocity, so no order is lost.
///
/// Linear analysis (one mode, ten substeps, added mass 7 to 136 times the fabric's,
/// the coupler's mean load): the alternating modes shrink by 0.52 a window with
/// $\chi$ = 1/2 and by 0.98 without; the largest amplification of any mode is
/// 1.001 (wave length 0.7 m, without any damping by the flow).
#[derive(Clone, Debug)]
pub struct VelocityAverage {
    weight: f64,
    /// Displacement one window before the last accepted one.
    before: Vec<f64>,
}

impl VelocityAverage {
    /// As the scene couples: only implicit windows have a converged velocity.
    pub fn of(scene: &Scene, stage: usize) -> Option<Self> {
        let coupled = scene.stages[stage].kind == StageKind::Coupled;
        let weight = scene.coupling.velocity_average;
        (coupled && scene.coupling.scheme == Scheme::Implicit && weight > 0.0)
            .then(|| Self { weight, before: Vec::new() })
    }

    /// Changes `v`, the velocity at the end of a window of length `dt` from
    /// displacement `u0` to `u1`. The first window has no past and is left alone.
    pub fn apply(&mut self, dt: f64, u0: &[f64], u1: &[f64], v: &mut [f64]) {
        if self.before.len() == u0.len() {
            for (i, v) in v.iter_mut().enumerate() {
                let w = (3.0 * u1[i] - 4.0 * u0[i] + self.before[i]) / (2.0 * dt);
                *v += self.weight * (w - *v);
            }
        }
        self.before.clear();
        self.before.extend_from_slice(u0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_consistent_velocity_is_kept_and_an_error_shrinks() {
        let mut average = VelocityAverage { weight: 0.5, before: Vec::new() };
        let dt = 0.1;
        // x = t + 2 t^2: BDF2 is exact for it.
        let x = |t: f64| [t + 2.0 * t * t];
        let mut v = [1.0 + 4.0 * 0.1];
        average.apply(dt, &x(0.0), &x(0.1), &mut v);
        assert_eq!(v, [1.4], "no past yet");
        let mut v = [1.8];
        average.apply(dt, &x(0.1), &x(0.2), &mut v);
        assert!((v[0] - 1.8).abs() < 1e-14);
        let mut v = [2.2 + 0.6];
        average.apply(dt, &x(0.2), &x(0.3), &mut v);
        assert!((v[0] - (2.2 + 0.3)).abs() < 1e-14);
    }
}
