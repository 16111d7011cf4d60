//! Inverse Jacobians of the coupling residual, from columns of steps and changes of the residual.

use std::collections::VecDeque;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::quasi_newton_options::QuasiNewtonOptions;
use super::relaxation::Relaxation;
use crate::schemes::least_squares::{Columns, axpy};

/// An inverse Jacobian as a value: its columns are all it knows.
pub trait Jacobian: Default + Serialize + DeserializeOwned + 'static {
    /// Name of the method.
    const NAME: &'static str;

    /// A new window begins.
    fn begin_window(&mut self, options: &QuasiNewtonOptions) {
        let _ = options;
    }

    /// The window is accepted.
    fn end_window(&mut self, options: &QuasiNewtonOptions) {
        let _ = options;
    }

    /// Adds a column: the residual changed by `residual` over `step`.
    fn learn(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions);

    /// The step that removes what the columns span of `residual`, and relaxes by `rest` what none does.
    fn apply(
        &mut self,
        residual: &[f64],
        rest: &dyn Relaxation,
        options: &QuasiNewtonOptions,
        step: &mut [f64],
    );

    /// Drops the columns of past windows.
    fn forget_past_windows(&mut self);

    /// Drops all columns.
    fn forget(&mut self);
}

/// A change of the residual over a step.
#[derive(Serialize, Deserialize)]
struct Column {
    residual: Vec<f64>,
    step: Vec<f64>,
    window: u64,
}

/// All columns at once, newest first (IQN-ILS; Degroote, Bathe, Vierendeels 2009), with columns of past windows
/// and the QR filter of Haelterman et al. (2016).
#[derive(Default, Serialize, Deserialize)]
pub struct LeastSquaresJacobian {
    columns: VecDeque<Column>,
    window: u64,
}

impl Jacobian for LeastSquaresJacobian {
    const NAME: &'static str = "IQN-ILS";

    fn end_window(&mut self, options: &QuasiNewtonOptions) {
        self.window += 1;
        let oldest = self.window.saturating_sub(u64::from(options.reused_windows));
        self.columns.retain(|c| c.window >= oldest);
    }

    fn learn(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions) {
        self.columns.push_front(Column { residual, step, window: self.window });
        self.columns.truncate(options.max_columns);
    }

    fn apply(
        &mut self,
        residual: &[f64],
        rest: &dyn Relaxation,
        options: &QuasiNewtonOptions,
        step: &mut [f64],
    ) {
        // Factors of the residual columns, newest first; columns that add nothing are dropped.
        let mut factors = Columns::default();
        self.columns.retain(|column| factors.push(&column.residual, options.filter));
        let mut left = residual.to_vec();
        let c = factors.remove(&mut left);
        rest.apply(&left, step);
        c.iter().zip(&self.columns).for_each(|(c, column)| axpy(*c, &column.step, step));
    }

    fn forget_past_windows(&mut self) {
        let now = self.window;
        self.columns.retain(|c| c.window == now);
    }

    fn forget(&mut self) {
        self.columns.clear();
    }
}

/// Columns of one window.
#[derive(Default, Serialize, Deserialize)]
struct Secants {
    columns: Columns,
    steps: Vec<Vec<f64>>,
}

/// Multi-vector (IQN-IMVJ; Lindner, Mehl, Scheufele, Uekermann 2015): the inverse Jacobian of a window corrects that of
/// the window before so that it fits the window's own secants and changes as little as possible otherwise,
///
/// $$ J_k = J_{k-1} + (\delta X_k - J_{k-1}\,\delta R_k)\,\delta R_k^+ , $$
///
/// so $J_k r = \delta X_k \delta R_k^+ r + J_{k-1}(r - \delta R_k\delta R_k^+ r)$: what the newest
/// window's columns span is theirs, the rest is handed on to the windows before, and what none
/// spans to a [`Relaxation`]. That needs no matrix of the interface's size. Memory is limited by
/// forgetting the oldest window (the restart RS-SLIDE of Scheufele and Mehl 2017). Other than in
/// IQN-ILS, columns of past windows never compete with newer ones, so none has to be filtered out.
#[derive(Serialize, Deserialize)]
pub struct MultiVectorJacobian {
    /// Newest first; the first one is the present window's.
    windows: VecDeque<Secants>,
}

impl Default for MultiVectorJacobian {
    fn default() -> Self {
        Self { windows: VecDeque::from([Secants::default()]) }
    }
}

impl Jacobian for MultiVectorJacobian {
    const NAME: &'static str = "IQN-IMVJ";

    fn begin_window(&mut self, options: &QuasiNewtonOptions) {
        if !self.windows[0].steps.is_empty() {
            self.windows.push_front(Secants::default());
        }
        self.windows.truncate(options.reused_windows as usize + 1);
    }

    fn learn(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions) {
        let now = &mut self.windows[0];
        if now.columns.push(&residual, options.filter) {
            now.steps.push(step);
        }
    }

    fn apply(
        &mut self,
        residual: &[f64],
        rest: &dyn Relaxation,
        _options: &QuasiNewtonOptions,
        step: &mut [f64],
    ) {
        let mut left = residual.to_vec();
        let parts: Vec<Vec<f64>> = self.windows.iter().map(|w| w.columns.remove(&mut left)).collect();
        rest.apply(&left, step);
        for (c, window) in parts.iter().zip(&self.windows) {
            c.iter().zip(&window.steps).for_each(|(c, s)| axpy(*c, s, step));
        }
    }

    fn forget_past_windows(&mut self) {
        self.windows.truncate(1);
    }

    fn forget(&mut self) {
        *self = Self::default();
    }
}
