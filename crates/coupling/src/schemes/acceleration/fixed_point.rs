//! Relaxed fixed-point iteration: with a constant factor, and Aitken's.

use case::Coupling;

use super::accelerator::{Accelerator, FromCoupling};
use super::relaxation::Relaxation;
use crate::error::RunError;
use crate::schemes::codec::{pack, unpack};

/// `x + omega (x_tilde - x)`.
pub struct Constant {
    omega: f64,
}

impl FromCoupling for Constant {
    fn from_coupling(coupling: &Coupling, _unknowns: usize, _rest: Box<dyn Relaxation>) -> Self {
        Self { omega: coupling.relaxation }
    }

    fn describe(coupling: &Coupling) -> String {
        format!("relaxation {}", coupling.relaxation)
    }
}

impl Accelerator for Constant {
    fn begin_window(&mut self) {}

    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
        relax(self.omega, x, x_tilde, next);
    }

    fn end_window(&mut self, _x: &[f64], _x_tilde: &[f64]) {}

    fn save_state(&self) -> Vec<u8> {
        Vec::new()
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        unpack::<()>(saved)
    }

    fn reset(&mut self) {}
}

/// Aitken's dynamic relaxation (Irons and Tuck 1969; Kuettler and Wall 2008):
/// $`\omega_{k+1} = -\omega_k\, r_k \cdot (r_{k+1}-r_k) / |r_{k+1}-r_k|^2`$.
pub struct Aitken {
    first: f64,
    omega: f64,
    residual: Vec<f64>,
    iteration: u32,
}

impl Aitken {
    /// With the factor of the first iteration, which also bounds the first
    /// factor of each later window.
    pub fn new(first: f64) -> Self {
        Self { first, omega: first, residual: Vec::new(), iteration: 0 }
    }

    /// The factor for the residual of this iterate.
    pub(crate) fn factor(&mut self, x: &[f64], x_tilde: &[f64]) -> f64 {
        if self.iteration > 0 {
            let (mut along, mut square) = (0.0, 0.0);
            for ((old, x), x_tilde) in self.residual.iter().zip(x).zip(x_tilde) {
                let difference = (x_tilde - x) - old;
                along += old * difference;
                square += difference * difference;
            }
            if square > 0.0 {
                // One secant is not reliable: bounded in sign and size.
                self.omega = (-self.omega * along / square).clamp(1e-3 * self.first, 1.0);
            }
        }
        self.residual.clear();
        self.residual.extend(x.iter().zip(x_tilde).map(|(x, t)| t - x));
        self.iteration += 1;
        self.omega
    }
}

impl FromCoupling for Aitken {
    fn from_coupling(coupling: &Coupling, _unknowns: usize, _rest: Box<dyn Relaxation>) -> Self {
        Self::new(coupling.relaxation)
    }

    fn describe(coupling: &Coupling) -> String {
        format!("Aitken's relaxation from {}", coupling.relaxation)
    }
}

impl Accelerator for Aitken {
    fn begin_window(&mut self) {
        self.omega = self.omega.min(self.first);
        self.iteration = 0;
    }

    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
        let omega = self.factor(x, x_tilde);
        relax(omega, x, x_tilde, next);
    }

    fn end_window(&mut self, _x: &[f64], _x_tilde: &[f64]) {}

    fn save_state(&self) -> Vec<u8> {
        pack(&self.omega)
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        self.omega = unpack(saved)?;
        Ok(())
    }

    fn reset(&mut self) {
        self.omega = self.first;
    }
}

/// `next = x + omega (x_tilde - x)`.
pub(crate) fn relax(omega: f64, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
    for ((next, x), x_tilde) in next.iter_mut().zip(x).zip(x_tilde) {
        *next = x + omega * (x_tilde - x);
    }
}
