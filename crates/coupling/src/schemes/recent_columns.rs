//! Least squares over columns of which the newest is the first: orthogonal factors would be computed from the beginning
//! with each new column, inner products are kept.

use std::collections::VecDeque;

use super::least_squares::{NormalEquations, axpy, dot};

/// A column that keeps its inner products.
pub(crate) trait RecentColumn {
    /// Its numbers.
    fn values(&self) -> &[f64];

    /// Inner products with itself and with all older columns, newest first; fewer after a restart.
    fn products(&self) -> &[f64];

    /// The same, to be changed.
    fn products_mut(&mut self) -> &mut Vec<f64>;
}

/// Keeps the newest `most` columns.
pub(crate) fn truncate<C: RecentColumn>(columns: &mut VecDeque<C>, most: usize) {
    columns.truncate(most);
    let count = columns.len();
    for (k, column) in columns.iter_mut().enumerate() {
        column.products_mut().truncate(count - k);
    }
}

/// Factors of the normal equations, newest column first. Columns whose part orthogonal to newer ones is at most their
/// `filter` are removed (Haelterman et al. 2016).
pub(crate) fn factorise<C: RecentColumn>(
    columns: &mut VecDeque<C>,
    filter: impl Fn(&C) -> f64,
) -> NormalEquations {
    complete_products(columns);
    let mut factors = NormalEquations::default();
    let mut index = 0;
    while index < columns.len() {
        let products: Vec<f64> =
            columns.range(..=index).enumerate().map(|(k, c)| c.products()[index - k]).collect();
        if factors.push(&products, filter(&columns[index])) {
            index += 1;
        } else {
            remove(columns, index);
        }
    }
    factors
}

/// Coefficients of the columns whose combination is closest to `-residual`; the part that they do not span stays in
/// `residual`. `factors`: those of [`factorise`].
pub(crate) fn remove_span<C: RecentColumn>(
    columns: &VecDeque<C>,
    factors: &NormalEquations,
    residual: &mut [f64],
) -> Vec<f64> {
    let mut c = vec![0.0; columns.len()];
    // The second time removes what the inner products have lost (Björck 1987, corrected seminormal equations).
    for _ in 0..2 {
        let mut part: Vec<f64> = columns.iter().map(|column| -dot(column.values(), residual)).collect();
        factors.solve(&mut part);
        for ((c, part), column) in c.iter_mut().zip(&part).zip(columns) {
            *c += part;
            axpy(*part, column.values(), residual);
        }
    }
    c
}

/// Computes the inner products that are not known.
fn complete_products<C: RecentColumn>(columns: &mut VecDeque<C>) {
    for k in 0..columns.len() {
        let known = columns[k].products().len();
        let new: Vec<f64> =
            columns.range(k + known..).map(|older| dot(columns[k].values(), older.values())).collect();
        columns[k].products_mut().extend(new);
    }
}

fn remove<C: RecentColumn>(columns: &mut VecDeque<C>, index: usize) {
    columns.remove(index);
    for (k, column) in columns.iter_mut().enumerate().take(index) {
        column.products_mut().remove(index - k);
    }
}
