//! When a window is converged.

use std::ops::Range;

/// One field of the vector of unknowns.
#[derive(Clone, Debug)]
pub struct Field {
    /// Where it lies in the vector.
    pub range: Range<usize>,
    /// Change over a window (2-norm, in the vector's units) below which the
    /// change itself is no longer the measure, so that a canopy at rest does
    /// not ask for round-off.
    pub floor: f64,
}

/// A window is converged when for every field
/// $\|\tilde x - x\| \le \epsilon \max(\|\tilde x - x^n\|, \text{floor})$.
#[derive(Clone, Debug)]
pub struct Criterion {
    /// Fields of the vector.
    pub fields: Vec<Field>,
    /// $\epsilon$.
    pub tolerance: f64,
}

impl Criterion {
    /// For windows of another length: what moves past the canopy in a window goes with its length.
    pub fn rescale(&mut self, factor: f64) {
        self.fields.iter_mut().for_each(|field| field.floor *= factor);
    }

    /// Largest ratio over the fields of the residual to the change over the
    /// window. NaN when any number is not finite.
    pub fn measure(&self, x: &[f64], x_tilde: &[f64], x_start: &[f64]) -> f64 {
        self.fields.iter().fold(0.0, |worst: f64, field| {
            let (mut residual, mut change) = (0.0, 0.0);
            for i in field.range.clone() {
                residual += (x_tilde[i] - x[i]) * (x_tilde[i] - x[i]);
                change += (x_tilde[i] - x_start[i]) * (x_tilde[i] - x_start[i]);
            }
            let ratio = residual.sqrt() / change.sqrt().max(field.floor).max(f64::MIN_POSITIVE);
            if ratio.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(ratio) }
        })
    }

    /// Whether a measure is within the tolerance.
    pub fn met(&self, measure: f64) -> bool {
        measure <= self.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn criterion() -> Criterion {
        Criterion {
            fields: vec![Field { range: 0..2, floor: 0.1 }, Field { range: 2..3, floor: 0.1 }],
            tolerance: 1e-3,
        }
    }

    #[test]
    fn each_field_has_its_own_scale() {
        // Field 0 moved by 10, field 1 by 1: the residual of 2e-3 counts in field 1 only.
        let m = criterion().measure(&[10.0, 0.0, 1.0], &[10.0, 2e-3, 1.0], &[0.0; 3]);
        assert!((m - 2e-4).abs() < 1e-9 && criterion().met(m));
        let m = criterion().measure(&[10.0, 0.0, 1.0], &[10.0, 0.0, 1.002], &[0.0; 3]);
        assert!((m - 2e-3 / 1.002).abs() < 1e-9 && !criterion().met(m));
    }

    #[test]
    fn at_rest_the_floor_measures() {
        let m = criterion().measure(&[1.0, 1.0, 0.0], &[1.0, 1.0 + 1e-5, 0.0], &[1.0, 1.0, 0.0]);
        assert!((m - 1e-4).abs() < 1e-10);
    }

    #[test]
    fn never_converged_on_nan() {
        let m = criterion().measure(&[0.0; 3], &[f64::NAN, 0.0, 0.0], &[0.0; 3]);
        assert!(m.is_nan() && !criterion().met(m));
    }
}
