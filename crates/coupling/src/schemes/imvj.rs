//! Multi-vector interface quasi-Newton (IQN-IMVJ; Lindner, Mehl, Scheufele, Uekermann 2015).
//!
//! The inverse Jacobian of a window corrects that of the window before so that it fits the
//! window's own secants and changes as little as possible otherwise,
//!
//! $$ J_k = J_{k-1} + (\delta X_k - J_{k-1}\,\delta R_k)\,\delta R_k^+ , $$
//!
//! so $J_k r = \delta X_k \delta R_k^+ r + J_{k-1}(r - \delta R_k\delta R_k^+ r)$: what the newest
//! window's columns span is theirs, the rest is handed on to the windows before, and what none
//! spans to a [`Relaxation`]. That needs no matrix of the interface's size. Memory is limited by
//! forgetting the oldest window (the restart RS-SLIDE of Scheufele and Mehl 2017). Other than in
//! IQN-ILS, columns of past windows never compete with newer ones, so none has to be filtered out.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::accelerate::{Accelerator, Aitken, relax};
use super::iqn::IqnOptions;
use super::least_squares::{Columns, axpy, norm};
use super::memory::{pack, unpack};
use super::relaxation::Relaxation;
use crate::error::RunError;

#[derive(Default, Serialize, Deserialize)]
struct Secants {
    columns: Columns,
    steps: Vec<Vec<f64>>,
}

/// The multi-vector quasi-Newton accelerator.
pub struct IqnImvj {
    options: IqnOptions,
    /// Newest first; the first one is the present window's.
    windows: VecDeque<Secants>,
    previous: Option<(Vec<f64>, Vec<f64>)>,
    largest: f64,
    best: f64,
    fallback: Aitken,
    rest: Box<dyn Relaxation>,
}

impl IqnImvj {
    /// `rest` relaxes what no column spans.
    pub fn new(options: IqnOptions, rest: Box<dyn Relaxation>) -> Self {
        Self {
            options,
            windows: VecDeque::from([Secants::default()]),
            previous: None,
            largest: 0.0,
            best: f64::INFINITY,
            fallback: Aitken::new(options.relaxation),
            rest,
        }
    }

    fn learn(&mut self, x: &[f64], r: &[f64]) {
        if let Some((old_x, old_r)) = self.previous.take() {
            let residual: Vec<f64> = r.iter().zip(&old_r).map(|(a, b)| a - b).collect();
            let step: Vec<f64> = x.iter().zip(&old_x).map(|(a, b)| a - b).collect();
            self.largest = self.largest.max(norm(&old_r));
            if norm(&residual) > self.options.noise * self.largest && norm(&step) > 0.0 {
                let now = &mut self.windows[0];
                if now.columns.push(&residual, self.options.filter) {
                    now.steps.push(step);
                }
            }
        }
        self.previous = Some((x.to_vec(), r.to_vec()));
    }

    fn newton_step(&self, residual: &[f64], step: &mut [f64]) -> bool {
        let mut left = residual.to_vec();
        let parts: Vec<Vec<f64>> = self.windows.iter().map(|w| w.columns.remove(&mut left)).collect();
        self.rest.apply(&left, step);
        for (c, window) in parts.iter().zip(&self.windows) {
            c.iter().zip(&window.steps).for_each(|(c, s)| axpy(*c, s, step));
        }
        let length = norm(step);
        length.is_finite() && length <= self.options.max_step * norm(residual)
    }
}

impl Accelerator for IqnImvj {
    fn reshape(&mut self, lattice: &super::Lattice) {
        self.rest.reshape(lattice);
    }

    fn begin_window(&mut self) {
        self.previous = None;
        self.largest = 0.0;
        self.best = f64::INFINITY;
        self.fallback.begin_window();
        if !self.windows[0].steps.is_empty() {
            self.windows.push_front(Secants::default());
        }
        self.windows.truncate(self.options.reused_windows as usize + 1);
    }

    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
        let residual: Vec<f64> = x.iter().zip(x_tilde).map(|(x, t)| t - x).collect();
        let length = norm(&residual);
        self.learn(x, &residual);
        let omega = self.fallback.factor(x, x_tilde);
        if length > 2.0 * self.best {
            self.windows.truncate(1);
        }
        self.best = self.best.min(length);
        let mut step = vec![0.0; x.len()];
        let mut good = self.newton_step(&residual, &mut step);
        if !good {
            self.windows.truncate(1);
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
        self.learn(x, &residual);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(&self.windows, self.fallback.memory()))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let fallback: Vec<u8>;
        (self.windows, fallback) = unpack(memory)?;
        self.fallback.recall(&fallback)?;
        Ok(())
    }

    fn forget(&mut self) {
        self.windows = VecDeque::from([Secants::default()]);
        self.fallback.forget();
    }
}
