//! Dry friction in a material: a slider in parallel with the elastic law.
//!
//! Strands that rub on each other are a slider in parallel with an elastic element (a Jenkin element: Iwan, J. Appl. Mech. 33, 1966,
//! 893-900), whose limit grows with the elastic stress, as dry friction does. For the elastic stress $`S_e`$ of modulus $`Y_e`$ at the strain $`E`$
//! - the slider sticks with the stiffness $`k Y_e`$, $`\dot S_f = k Y_e \dot E`$, while $`|S_f| \le \mu |S_e|`$,
//! - and slips at this limit. Slack material has none.
//!
//! With $`Y_e = Y / (1 + \mu)`$ a material that is loaded for the first time has the modulus $`Y`$; unloaded, it follows
//! $`(1-\mu) Y_e E`$. A slow cycle from zero to $`E_0`$ and back takes the share
//! ```math
//! \psi = \frac{2 \mu (k-\mu)}{(1+\mu)(k+\mu)}
//! ```
//! of the work of loading, whatever $`E_0`$ and the rate. The slider is integrated from the start of a step to its end by
//! the closest point (backward Euler): the work that it does not store, $`S_1 \Delta E - \Delta (S^2) / (2 k Y_e)`$, is never negative. With implicit
//! steps that is first order in time, too much by the share of a step in the time of loading.

/// Stiffness of the slider that sticks over the elastic one, `k`.
const STICK: f64 = 2.0;

/// Strain of a slider before its first step: no material has it.
const NEVER: f64 = f64::MAX;

/// Limit over elastic stress, $`\mu`$, of a material that loses the share `loss` of the work of loading: the smaller solution of $`\psi(\mu)`$ = `loss`, which
/// has one up to [`case::MOST_HYSTERESIS`].
pub fn friction(loss: f64) -> f64 {
    let b = 2.0 * STICK - loss * (1.0 + STICK);
    let a = loss + 2.0;
    (b - (b * b - 4.0 * a * loss * STICK).sqrt()) / (2.0 * a)
}

/// State of a slider at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slider {
    /// Strain of the material.
    pub strain: f64,
    /// Stress of the slider.
    pub stress: f64,
}

/// A slider as internal variables.
pub fn variables(slider: Option<Slider>) -> [f64; 2] {
    slider.map_or([NEVER, 0.0], |s| [s.strain, s.stress])
}

/// The slider of internal variables.
pub fn of_variables([strain, stress]: [f64; 2]) -> Option<Slider> {
    (strain != NEVER).then_some(Slider { strain, stress })
}

/// Law of sliders.
#[derive(Clone, Copy, Debug)]
pub struct Friction {
    /// Limit over elastic stress.
    limit: f64,
    /// Stiffness of a slider that sticks.
    stiffness: f64,
    /// Weight of the stress at the end of a step in its work: 1 of implicit steps, whose forces have this stress; 1/2 of central differences.
    end_weight: f64,
}

impl Friction {
    /// With a limit of `limit` times the elastic stress, of a material of the elastic `modulus`.
    pub fn new(limit: f64, modulus: f64) -> Self {
        Self { limit, stiffness: STICK * modulus, end_weight: 1.0 }
    }

    /// For central differences: the work of a step is that of the mean of the stresses at its ends.
    pub fn explicit(self) -> Self {
        Self { end_weight: 0.5, ..self }
    }

    /// Limit over elastic stress.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Stiffness of a slider that sticks.
    pub fn stiffness(&self) -> f64 {
        self.stiffness
    }

    /// Stress of a slider at the strain `e`, where the elastic stress and its derivative are `elastic`, and its derivative. `from`: its state at the start of
    /// the step; `None` before the first step: as after the first loading.
    #[inline(always)]
    pub fn slide(&self, from: Option<Slider>, e: f64, elastic: (f64, f64)) -> (f64, f64) {
        let (elastic, modulus) = elastic;
        let Some(from) = from else { return (self.limit * elastic, self.stiffness) };
        let limit = self.limit * elastic.abs();
        let stuck = from.stress + self.stiffness * (e - from.strain);
        if stuck.abs() <= limit {
            (stuck, self.stiffness)
        } else {
            (limit.copysign(stuck), self.limit * modulus * elastic.signum() * stuck.signum())
        }
    }

    /// Energy of a slider of stress `s` for each volume.
    #[inline(always)]
    pub fn stored(&self, s: f64) -> f64 {
        0.5 * s * s / self.stiffness
    }

    /// Energy for each volume that a slider took on its way to the state `to`.
    pub fn taken(&self, from: Option<Slider>, to: Slider) -> f64 {
        from.map_or(0.0, |from| {
            let mean = self.end_weight * to.stress + (1.0 - self.end_weight) * from.stress;
            mean * (to.strain - from.strain) - (self.stored(to.stress) - self.stored(from.stress))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_loss_there_is_no_friction() {
        assert_eq!(friction(0.0), 0.0);
        assert!((friction(case::MOST_HYSTERESIS) - 0.5).abs() < 1e-14);
    }

    #[test]
    fn variables_are_the_state() {
        for slider in [None, Some(Slider { strain: 0.3, stress: -2.0 })] {
            assert_eq!(of_variables(variables(slider)), slider);
        }
    }
}
