//! Inverse Jacobians of the coupling residual, from columns of steps and changes of the residual.

use std::collections::VecDeque;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::quasi_newton_options::QuasiNewtonOptions;
use super::relaxation::Relaxation;
use crate::schemes::least_squares::{Columns, axpy};

/// An inverse Jacobian as plain data, determined by its columns.
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
    fn add_column(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions);

    /// The step that removes the part of `residual` that the columns span, and relaxes the rest by `rest`.
    fn apply(
        &mut self,
        residual: &[f64],
        rest: &dyn Relaxation,
        options: &QuasiNewtonOptions,
        step: &mut [f64],
    );

    /// Drops the columns of past windows.
    fn drop_past_windows(&mut self);

    /// Drops all columns.
    fn reset(&mut self);
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

    fn add_column(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions) {
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
        // QR factors of the residual columns, newest first; columns that add no new direction are filtered out.
        let mut factors = Columns::default();
        self.columns.retain(|column| factors.push(&column.residual, options.filter));
        let mut left = residual.to_vec();
        let c = factors.remove(&mut left);
        rest.apply(&left, step);
        c.iter().zip(&self.columns).for_each(|(c, column)| axpy(*c, &column.step, step));
    }

    fn drop_past_windows(&mut self) {
        let now = self.window;
        self.columns.retain(|c| c.window == now);
    }

    fn reset(&mut self) {
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
/// ```math
/// J_k = J_{k-1} + (\delta X_k - J_{k-1}\,\delta R_k)\,\delta R_k^+ ,
/// ```
///
/// so $`J_k r = \delta X_k \delta R_k^+ r + J_{k-1}(r - \delta R_k\delta R_k^+ r)`$: the columns of the newest window
/// remove the part that they span, the remainder is passed to the windows before, and the part that none spans to a
/// [`Relaxation`]. No matrix of the size of the interface is needed. Memory is bounded by dropping the oldest window
/// (the restart RS-SLIDE of Scheufele and Mehl 2017). Unlike in IQN-ILS, columns of past windows never compete with
/// newer ones, so none is filtered out.
#[derive(Serialize, Deserialize)]
pub struct MultiVectorJacobian {
    /// Newest first; the first one belongs to the present window.
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

    fn add_column(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions) {
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

    fn drop_past_windows(&mut self) {
        self.windows.truncate(1);
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
