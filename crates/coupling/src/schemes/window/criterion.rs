//! Convergence criterion of a window.

use std::ops::Range;

/// One field of the vector of unknowns.
#[derive(Clone, Debug)]
pub struct Field {
    /// Its range in the vector.
    pub range: Range<usize>,
    /// Change over a window (2-norm, in the vector's units) below which the change itself is no longer the scale, so
    /// that a canopy at rest does not require a residual of round-off. Proportional to the length of the window.
    pub floor: f64,
    /// Change of the field by the scale of the load; the larger of both is the floor.
    pub load: LoadFloor,
}

impl Field {
    /// With a floor proportional to the length of the window.
    pub fn new(range: Range<usize>, floor: f64) -> Self {
        Self { range, floor, load: LoadFloor::default() }
    }

    /// The floor for windows `factor` times as long as the planned ones.
    fn floor(&self, factor: f64) -> f64 {
        (factor * self.floor).max(self.load.at(factor)).max(f64::MIN_POSITIVE)
    }
}

/// Change of a field by the scale of the load within a window (2-norm, in the vector's units).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadFloor {
    /// By inertia alone: proportional to the square of the window's length.
    pub inertial: f64,
    /// Upper bound for any window.
    pub most: f64,
}

impl LoadFloor {
    /// For windows `factor` times as long as the planned ones.
    pub fn at(&self, factor: f64) -> f64 {
        (factor * factor * self.inertial).min(self.most)
    }
}

/// A window is converged when for every field
/// $`\|\tilde x - x\| \le \epsilon \max(\|\tilde x - x^n\|, \text{floor})`$.
#[derive(Clone, Debug)]
pub struct Criterion {
    /// Fields of the vector.
    pub fields: Vec<Field>,
    /// $`\epsilon`$.
    pub tolerance: f64,
    /// Length of the windows relative to the planned one.
    length: f64,
}

impl Criterion {
    /// With floors for windows of the planned length.
    pub fn new(fields: Vec<Field>, tolerance: f64) -> Self {
        Self { fields, tolerance, length: 1.0 }
    }

    /// For windows `factor` times as long as those before.
    pub fn rescale(&mut self, factor: f64) {
        self.length *= factor;
    }

    /// Largest ratio over the fields of the residual to the change over the window. NaN where a value is not finite.
    pub fn relative_residual(&self, x: &[f64], x_tilde: &[f64], x_start: &[f64]) -> f64 {
        self.fields.iter().fold(0.0, |worst: f64, field| {
            let (mut residual, mut change) = (0.0, 0.0);
            for i in field.range.clone() {
                residual += (x_tilde[i] - x[i]) * (x_tilde[i] - x[i]);
                change += (x_tilde[i] - x_start[i]) * (x_tilde[i] - x_start[i]);
            }
            let ratio = residual.sqrt() / change.sqrt().max(field.floor(self.length));
            if ratio.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(ratio) }
        })
    }

    /// Whether a relative residual is within the tolerance.
    pub fn met(&self, residual: f64) -> bool {
        residual <= self.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn criterion() -> Criterion {
        Criterion::new(vec![Field::new(0..2, 0.1), Field::new(2..3, 0.1)], 1e-3)
    }

    #[test]
    fn each_field_has_its_own_scale() {
        // Field 0 moves by 10, field 1 by 1: the residual of 2e-3 affects field 1 only.
        let m = criterion().relative_residual(&[10.0, 0.0, 1.0], &[10.0, 2e-3, 1.0], &[0.0; 3]);
        assert!((m - 2e-4).abs() < 1e-9 && criterion().met(m));
        let m = criterion().relative_residual(&[10.0, 0.0, 1.0], &[10.0, 0.0, 1.002], &[0.0; 3]);
        assert!((m - 2e-3 / 1.002).abs() < 1e-9 && !criterion().met(m));
    }

    #[test]
    fn floor_is_the_scale_at_rest() {
        let m = criterion().relative_residual(&[1.0, 1.0, 0.0], &[1.0, 1.0 + 1e-5, 0.0], &[1.0, 1.0, 0.0]);
        assert!((m - 1e-4).abs() < 1e-10);
    }

    #[test]
    fn nan_is_never_converged() {
        let m = criterion().relative_residual(&[0.0; 3], &[f64::NAN, 0.0, 0.0], &[0.0; 3]);
        assert!(m.is_nan() && !criterion().met(m));
    }
}
