//! Interface quasi-Newton with an inverse-Jacobian least-squares model
//! (IQN-ILS; Degroote, Bathe, Vierendeels 2009), with columns of past windows
//! and the QR filter of Haelterman et al. (2016).
//!
//! From pairs of iterates it learns how the residual $r = \tilde x - x$ answers
//! to a step: columns $\delta r_j$ and $\delta x_j$. The next step removes what
//! the columns span, and relaxes the rest:
//!
//! $$ c = -\operatorname*{argmin}_c \|\,\delta R\,c - r\|, \qquad
//!    x \leftarrow x + \delta X\,c + \Omega\,(r + \delta R\,c). $$
//!
//! With $\Omega = I$ this is the method as published. A canopy is far lighter
//! than the air it moves at *every* wave length the mesh resolves, so the
//! unspanned part is amplified by a full step; a [`Relaxation`] that knows the
//! added mass keeps the iteration contracting there too.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::accelerate::{Accelerator, Aitken, relax};
use super::least_squares::{Columns, axpy, norm};
use super::memory::{pack, unpack};
use super::relaxation::Relaxation;
use crate::error::RunError;

/// Settings of [`IqnIls`].
#[derive(Clone, Copy, Debug)]
pub struct IqnOptions {
    /// First factor of the Aitken relaxation that poor columns fall back to.
    pub relaxation: f64,
    /// Windows whose columns are kept besides the present one's.
    pub reused_windows: u32,
    /// A column is dropped when less than this share of it is new compared with
    /// the more recent ones.
    pub filter: f64,
    /// Differences of residuals below this share of the window's largest residual
    /// are noise of the solvers' own tolerances and teach nothing.
    pub noise: f64,
    /// Columns at most.
    pub max_columns: usize,
    /// A step longer than this many residuals is not believed: for added mass a
    /// true step is shorter than the residual.
    pub max_step: f64,
}

impl Default for IqnOptions {
    fn default() -> Self {
        Self { relaxation: 0.1, reused_windows: 8, filter: 1e-2, noise: 0.0, max_columns: 100, max_step: 3.0 }
    }
}

#[derive(Serialize, Deserialize)]
struct Column {
    residual: Vec<f64>,
    step: Vec<f64>,
    window: u64,
}

/// The quasi-Newton accelerator.
pub struct IqnIls {
    options: IqnOptions,
    columns: VecDeque<Column>,
    window: u64,
    previous: Option<(Vec<f64>, Vec<f64>)>,
    best: f64,
    largest: f64,
    fallback: Aitken,
    rest: Box<dyn Relaxation>,
}

impl IqnIls {
    /// For vectors of `unknowns` numbers; `rest` relaxes what no column spans.
    pub fn new(unknowns: usize, options: IqnOptions, rest: Box<dyn Relaxation>) -> Self {
        let options = IqnOptions { max_columns: options.max_columns.min(unknowns.max(1)), ..options };
        Self {
            options,
            columns: VecDeque::new(),
            window: 0,
            previous: None,
            best: f64::INFINITY,
            largest: 0.0,
            fallback: Aitken::new(options.relaxation),
            rest,
        }
    }

    /// Columns at hand.
    pub fn columns(&self) -> usize {
        self.columns.len()
    }

    /// Adds the column of the last step to `x`, whose residual is `r`.
    fn learn(&mut self, x: &[f64], r: &[f64]) {
        if let Some((old_x, old_r)) = self.previous.take() {
            let residual: Vec<f64> = r.iter().zip(&old_r).map(|(a, b)| a - b).collect();
            let step: Vec<f64> = x.iter().zip(&old_x).map(|(a, b)| a - b).collect();
            self.largest = self.largest.max(norm(&old_r));
            if norm(&residual) > self.options.noise * self.largest && norm(&step) > 0.0 {
                self.columns.push_front(Column { residual, step, window: self.window });
            }
        }
        self.columns.truncate(self.options.max_columns);
        self.previous = Some((x.to_vec(), r.to_vec()));
    }

    fn forget_past_windows(&mut self) {
        let now = self.window;
        self.columns.retain(|c| c.window == now);
    }

    /// Factors of the residual columns, newest first; columns that add nothing are dropped.
    fn factorise(&mut self) -> Columns {
        let mut factors = Columns::default();
        let filter = self.options.filter;
        self.columns.retain(|column| factors.push(&column.residual, filter));
        factors
    }

    /// The quasi-Newton step for `residual` into `step`; `false` when the
    /// columns explain nothing or the step cannot be believed.
    fn newton_step(&mut self, residual: &[f64], step: &mut [f64]) -> bool {
        let factors = self.factorise();
        let mut rest = residual.to_vec();
        let c = factors.remove(&mut rest);
        self.rest.apply(&rest, step);
        for (c, column) in c.iter().zip(&self.columns) {
            axpy(*c, &column.step, step);
        }
        let length = norm(step);
        length.is_finite() && length <= self.options.max_step * norm(residual)
    }
}

impl Accelerator for IqnIls {
    fn reshape(&mut self, lattice: &super::Lattice) {
        self.rest.reshape(lattice);
    }

    fn begin_window(&mut self) {
        self.previous = None;
        self.best = f64::INFINITY;
        self.largest = 0.0;
        self.fallback.begin_window();
    }

    fn next(&mut self, x: &[f64], x_tilde: &[f64], next: &mut [f64]) {
        let residual: Vec<f64> = x.iter().zip(x_tilde).map(|(x, t)| t - x).collect();
        let length = norm(&residual);
        self.learn(x, &residual);
        let omega = self.fallback.factor(x, x_tilde);
        // Columns of past windows that make the residual grow describe another
        // canopy than today's.
        if length > 2.0 * self.best {
            self.forget_past_windows();
        }
        self.best = self.best.min(length);
        let mut step = vec![0.0; x.len()];
        let mut good = self.newton_step(&residual, &mut step);
        if !good {
            self.forget_past_windows();
            good = self.newton_step(&residual, &mut step);
        }
        if good {
            for ((next, x), step) in next.iter_mut().zip(x).zip(&step) {
                *next = x + step;
            }
        } else {
            relax(omega, x, x_tilde, next);
        }
    }

    fn end_window(&mut self, x: &[f64], x_tilde: &[f64]) {
        let residual: Vec<f64> = x.iter().zip(x_tilde).map(|(x, t)| t - x).collect();
        self.learn(x, &residual);
        self.window += 1;
        let oldest = self.window.saturating_sub(u64::from(self.options.reused_windows));
        self.columns.retain(|c| c.window >= oldest);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(&self.columns, self.window, self.fallback.memory()))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let fallback: Vec<u8>;
        (self.columns, self.window, fallback) = unpack(memory)?;
        self.fallback.recall(&fallback)?;
        Ok(())
    }

    fn forget(&mut self) {
        self.columns.clear();
        self.fallback.forget();
    }
}
