//! Inverse Jacobians of the coupling residual, from columns of steps and changes of the residual.

use std::collections::VecDeque;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::quasi_newton_options::QuasiNewtonOptions;
use super::relaxation::Relaxation;
use crate::schemes::least_squares::{Columns, NormalEquations, axpy, dot};

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
    /// Inner products of its residual with itself and with those of all older columns, newest first; fewer after a
    /// restart.
    #[serde(skip)]
    products: Vec<f64>,
}

/// All columns at once, newest first (IQN-ILS; Degroote, Bathe, Vierendeels 2009), with columns of past windows
/// and the QR filter of Haelterman et al. (2016). As each new column is the first one, orthogonal factors would be
/// computed from the beginning at each step: for a hundred columns twenty thousand operations a number of the residual
/// instead of five hundred.
#[derive(Default, Serialize, Deserialize)]
pub struct LeastSquaresJacobian {
    columns: VecDeque<Column>,
    window: u64,
}

impl LeastSquaresJacobian {
    /// Computes the inner products that are not known.
    fn complete_products(&mut self) {
        for k in 0..self.columns.len() {
            let known = self.columns[k].products.len();
            let new: Vec<f64> = (self.columns.range(k + known..))
                .map(|older| dot(&self.columns[k].residual, &older.residual))
                .collect();
            self.columns[k].products.extend(new);
        }
    }

    /// Keeps the newest columns.
    fn truncate(&mut self, count: usize) {
        self.columns.truncate(count);
        for (k, column) in self.columns.iter_mut().enumerate() {
            column.products.truncate(count - k);
        }
    }

    /// Keeps the columns of a window and later ones.
    fn keep_from(&mut self, window: u64) {
        self.truncate(self.columns.iter().take_while(|c| c.window >= window).count());
    }

    fn remove(&mut self, index: usize) {
        self.columns.remove(index);
        for (k, column) in self.columns.iter_mut().enumerate().take(index) {
            column.products.remove(index - k);
        }
    }

    /// Factors of the normal equations, newest column first; columns that add no new direction are removed.
    fn factorise(&mut self, filter: f64) -> NormalEquations {
        self.complete_products();
        let mut factors = NormalEquations::default();
        let mut index = 0;
        while index < self.columns.len() {
            let products: Vec<f64> =
                self.columns.range(..=index).enumerate().map(|(k, c)| c.products[index - k]).collect();
            if factors.push(&products, filter) {
                index += 1;
            } else {
                self.remove(index);
            }
        }
        factors
    }
}

impl Jacobian for LeastSquaresJacobian {
    const NAME: &'static str = "IQN-ILS";

    fn end_window(&mut self, options: &QuasiNewtonOptions) {
        self.window += 1;
        self.keep_from(self.window.saturating_sub(u64::from(options.reused_windows)));
    }

    fn add_column(&mut self, residual: Vec<f64>, step: Vec<f64>, options: &QuasiNewtonOptions) {
        self.columns.push_front(Column { residual, step, window: self.window, products: Vec::new() });
        self.truncate(options.max_columns.min(self.columns.len()));
    }

    fn apply(
        &mut self,
        residual: &[f64],
        rest: &dyn Relaxation,
        options: &QuasiNewtonOptions,
        step: &mut [f64],
    ) {
        let factors = self.factorise(options.filter);
        let mut left = residual.to_vec();
        let mut c = vec![0.0; self.columns.len()];
        // The second time removes what the inner products have lost.
        for _ in 0..2 {
            let mut part: Vec<f64> =
                self.columns.iter().map(|column| -dot(&column.residual, &left)).collect();
            factors.solve(&mut part);
            for ((c, part), column) in c.iter_mut().zip(&part).zip(&self.columns) {
                *c += part;
                axpy(*part, &column.residual, &mut left);
            }
        }
        rest.apply(&left, step);
        c.iter().zip(&self.columns).for_each(|(c, column)| axpy(*c, &column.step, step));
    }

    fn drop_past_windows(&mut self) {
        self.keep_from(self.window);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schemes::codec::{pack, unpack};

    const NUMBERS: usize = 300;

    /// Relaxes by nothing, so that steps are those of the columns.
    struct None;

    impl Relaxation for None {
        fn apply(&self, _residual: &[f64], step: &mut [f64]) {
            step.fill(0.0);
        }
    }

    fn options() -> QuasiNewtonOptions {
        let coupling = case::Coupling { reused_windows: 3, ..Default::default() };
        QuasiNewtonOptions { max_columns: 14, ..QuasiNewtonOptions::for_unknowns(&coupling, NUMBERS) }
    }

    /// Columns of which the later ones differ from earlier ones by less and less, over six orders of magnitude.
    fn column(k: usize) -> Vec<f64> {
        let wave = |k: usize, i: usize| ((k * k + 3) as f64 * 0.37 * i as f64).sin();
        let near = 10f64.powi(-((k % 5) as i32)) * 0.9;
        (0..NUMBERS).map(|i| 10f64.powi(-((k % 7) as i32)) * (wave(k / 9, i) + near * wave(k, i))).collect()
    }

    /// The columns that the filter keeps and the part of `residual` that they do not span, by orthogonal factors.
    fn by_orthogonal_factors(columns: &[usize], filter: f64, residual: &[f64]) -> (Vec<usize>, Vec<f64>) {
        let mut factors = Columns::default();
        let kept = columns.iter().copied().filter(|&k| factors.push(&column(k), filter)).collect();
        let mut left = residual.to_vec();
        factors.remove(&mut left);
        (kept, left)
    }

    /// Columns of several windows, the oldest dropped, some filtered: what is kept and the step are those of orthogonal
    /// factors, also after a restart, which changes no digit.
    #[test]
    fn normal_equations_have_the_step_of_orthogonal_factors() {
        let options = options();
        let mut jacobian = LeastSquaresJacobian::default();
        let residual: Vec<f64> = (0..NUMBERS).map(|i| (0.11 * i as f64).cos() + column(3)[i]).collect();
        let mut kept: Vec<(u64, usize)> = Vec::new();
        let mut filtered = 0;
        for k in 0..40 {
            // The step is the residual itself: the sum over the columns is the part that they span.
            jacobian.add_column(column(k), column(k), &options);
            kept.insert(0, (k as u64 / 4, k));
            kept.truncate(options.max_columns);
            let numbers: Vec<usize> = kept.iter().map(|(_, k)| *k).collect();
            let (expected, left) = by_orthogonal_factors(&numbers, options.filter, &residual);
            filtered += numbers.len() - expected.len();
            kept.retain(|(_, k)| expected.contains(k));
            if k % 7 == 5 {
                let mut again: LeastSquaresJacobian = unpack(&pack(&jacobian)).expect("its state");
                let (mut one, mut other) = (vec![0.0; NUMBERS], vec![0.0; NUMBERS]);
                jacobian.apply(&residual, &None, &options, &mut one);
                again.apply(&residual, &None, &options, &mut other);
                assert_eq!(one, other);
                jacobian = again;
            }
            let mut step = vec![0.0; NUMBERS];
            jacobian.apply(&residual, &None, &options, &mut step);
            let columns: Vec<Vec<f64>> = kept.iter().map(|(_, k)| column(*k)).collect();
            assert_eq!(
                jacobian.columns.iter().map(|c| &c.residual).collect::<Vec<_>>(),
                columns.iter().collect::<Vec<_>>(),
                "{k}"
            );
            for ((step, left), r) in step.iter().zip(&left).zip(&residual) {
                assert!((step + r - left).abs() < 1e-11, "{k}: {} {left}", step + r);
            }
            if k % 4 == 3 {
                jacobian.end_window(&options);
                kept.retain(|(window, _)| window + 3 > k as u64 / 4);
            }
        }
        assert!(filtered > 3, "{filtered} columns were filtered out");
    }

    /// Each column differs from the one before by little more than the filter allows: inner products alone lose digits.
    #[test]
    fn nearly_parallel_columns_lose_no_digits() {
        let options = QuasiNewtonOptions { max_columns: 60, ..options() };
        let mut jacobian = LeastSquaresJacobian::default();
        let mut factors = Columns::default();
        let noise = |k: usize, i: usize| ((k * k + 3) as f64 * 0.37 * i as f64).sin();
        let mut columns = vec![(0..NUMBERS).map(|i| noise(0, i)).collect::<Vec<f64>>()];
        for k in 1..60 {
            columns.push((0..NUMBERS).map(|i| columns[k - 1][i] + 0.03 * noise(k, i)).collect());
        }
        for column in &columns {
            jacobian.add_column(column.clone(), column.clone(), &options);
        }
        let kept = columns.iter().rev().filter(|column| factors.push(column, options.filter)).count();
        let residual: Vec<f64> =
            (0..NUMBERS).map(|i| (0.11 * i as f64).cos() + columns[3][i] - columns[40][i]).collect();
        let mut left = residual.clone();
        factors.remove(&mut left);
        let mut step = vec![0.0; NUMBERS];
        jacobian.apply(&residual, &None, &options, &mut step);
        let error =
            step.iter().zip(&left).zip(&residual).fold(0.0f64, |e, ((s, l), r)| e.max((s + r - l).abs()));
        println!("{kept} columns, {error:.1e}");
        assert_eq!(jacobian.columns.len(), kept);
        assert!(error < 1e-13, "{error}");
    }
}
