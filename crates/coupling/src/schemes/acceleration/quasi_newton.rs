//! Interface quasi-Newton iteration with an inverse Jacobian of the residual.
//!
//! Pairs of iterates give the change of the residual $`r = \tilde x - x`$ over a step: columns $`\delta r_j`$ and
//! $`\delta x_j`$. The next step removes the part of the residual that the columns span, and relaxes the rest:
//!
//! ```math
//! c = -\arg\min_c \|\,\delta R\,c - r\|, \qquad
//! x \leftarrow x + \delta X\,c + \Omega\,(r + \delta R\,c).
//! ```
//!
//! With $`\Omega = I`$ this is the method as published. A canopy is far lighter than the air it moves at *every* wave
//! length that the mesh resolves, so a full step amplifies the unspanned part; a [`Relaxation`] by the added mass
//! makes the iteration contract there as well.
//!
//! The [`Jacobian`] selects the columns: this is the only difference between IQN-ILS and IQN-IMVJ.

use case::Coupling;

use super::accelerator::{Accelerator, FromCoupling};
use super::fixed_point::{Aitken, relax};
use super::jacobian::Jacobian;
use super::quasi_newton_options::QuasiNewtonOptions;
use super::relaxation::Relaxation;
use crate::error::RunError;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::least_squares::norm;
use crate::schemes::surrogate::orientation::Orientation;
use crate::schemes::surrogate::vortex_lattice::VortexLattice;

/// The quasi-Newton accelerator.
pub struct QuasiNewton<J> {
    options: QuasiNewtonOptions,
    jacobian: J,
    /// Previous iterate and its residual.
    previous: Option<(Vec<f64>, Vec<f64>)>,
    best: f64,
    largest: f64,
    fallback: Aitken,
    rest: Box<dyn Relaxation>,
}

impl<J: Jacobian> FromCoupling for QuasiNewton<J> {
    fn from_coupling(coupling: &Coupling, unknowns: usize, rest: Box<dyn Relaxation>) -> Self {
        let options = QuasiNewtonOptions::for_unknowns(coupling, unknowns);
        Self {
            options,
            jacobian: J::default(),
            previous: None,
            best: f64::INFINITY,
            largest: 0.0,
            fallback: Aitken::new(options.relaxation),
            rest,
        }
    }

    fn describe(coupling: &Coupling) -> String {
        format!("{} with columns of {} earlier windows", J::NAME, coupling.reused_windows)
    }
}

impl<J: Jacobian> QuasiNewton<J> {
    /// Adds the column of the last step to `x`, whose residual is `r`.
    fn add_column(&mut self, x: &[f64], r: &[f64]) {
        if let Some((old_x, old_r)) = self.previous.take() {
            let residual: Vec<f64> = r.iter().zip(&old_r).map(|(a, b)| a - b).collect();
            let step: Vec<f64> = x.iter().zip(&old_x).map(|(a, b)| a - b).collect();
            self.largest = self.largest.max(norm(&old_r));
            if norm(&residual) > self.options.noise * self.largest && norm(&step) > 0.0 {
                self.jacobian.add_column(residual, step, &self.options);
            }
        }
        self.previous = Some((x.to_vec(), r.to_vec()));
    }

    /// The quasi-Newton step for `residual` into `step`; `false` where it is too long or not finite.
    fn newton_step(&mut self, residual: &[f64], step: &mut [f64]) -> bool {
        self.jacobian.apply(residual, self.rest.as_ref(), &self.options, step);
        let length = norm(step);
        length.is_finite() && length <= self.options.max_step * norm(residual)
    }
}

impl<J: Jacobian> Accelerator for QuasiNewton<J> {
    fn reshape(&mut self, lattice: &VortexLattice) {
        self.rest.reshape(lattice);
    }

    fn turn(&mut self, orientation: &Orientation) {
        self.rest.turn(orientation);
    }

    fn stiffen(&mut self, volume_stiffness: f64, dt: f64) {
        self.rest.stiffen(volume_stiffness, dt);
    }

    fn begin_window(&mut self) {
        self.previous = None;
        self.best = f64::INFINITY;
        self.largest = 0.0;
        self.fallback.begin_window();
        self.jacobian.begin_window(&self.options);
    }

    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
        let residual: Vec<f64> = x.iter().zip(x_tilde).map(|(x, t)| t - x).collect();
        let length = norm(&residual);
        self.add_column(x, &residual);
        let omega = self.fallback.factor(x, x_tilde);
        // A growing residual shows that columns of past windows no longer describe the present canopy.
        if length > 2.0 * self.best {
            self.jacobian.drop_past_windows();
        }
        self.best = self.best.min(length);
        let mut step = vec![0.0; x.len()];
        let mut good = self.newton_step(&residual, &mut step);
        if !good {
            self.jacobian.drop_past_windows();
            good = self.newton_step(&residual, &mut step);
        }
        if good {
            next.iter_mut().zip(x).zip(&step).for_each(|((next, x), step)| *next = x + step);
        } else {
            relax(omega, x, x_tilde, next);
        }
    }

    fn end_window(&mut self, x: &[f64], x_tilde: &[f64]) {
        let residual: Vec<f64> = x.iter().zip(x_tilde).map(|(x, t)| t - x).collect();
        self.add_column(x, &residual);
        self.jacobian.end_window(&self.options);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(&self.jacobian, self.fallback.save_state()))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let fallback: Vec<u8>;
        (self.jacobian, fallback) = unpack(saved)?;
        self.fallback.restore_state(&fallback)
    }

    fn reset(&mut self) {
        self.jacobian.reset();
        self.fallback.reset();
    }
}
