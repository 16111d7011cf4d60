//! Small dense least squares over a few long columns.

/// $`QR`$ factors of columns that arrive one by one.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Columns {
    q: Vec<Vec<f64>>,
    r: Vec<Vec<f64>>,
}

impl Columns {
    /// Adds a column, unless its part orthogonal to the columns before is at most the fraction `filter` of it
    /// (Haelterman et al. 2016, QR2). Returns whether it was added.
    pub fn push(&mut self, column: &[f64], filter: f64) -> bool {
        let mut v = column.to_vec();
        let length = norm(&v);
        let mut coefficients = vec![0.0; self.q.len() + 1];
        // Twice is enough (Giraud et al. 2005): orthogonal to round-off.
        for _ in 0..2 {
            for (basis, coefficient) in self.q.iter().zip(&mut coefficients) {
                let along = dot(basis, &v);
                *coefficient += along;
                axpy(-along, basis, &mut v);
            }
        }
        let rest = norm(&v);
        if rest <= filter * length {
            return false;
        }
        coefficients[self.q.len()] = rest;
        v.iter_mut().for_each(|v| *v /= rest);
        self.q.push(v);
        self.r.push(coefficients);
        true
    }

    /// Coefficients of the columns whose combination is closest to `-residual`; the part that they do not span stays
    /// in `residual`.
    pub fn remove(&self, residual: &mut [f64]) -> Vec<f64> {
        let mut c: Vec<f64> = Vec::with_capacity(self.q.len());
        for basis in &self.q {
            let along = dot(basis, residual);
            axpy(-along, basis, residual);
            c.push(-along);
        }
        for j in (0..c.len()).rev() {
            c[j] /= self.r[j][j];
            for i in 0..j {
                c[i] -= self.r[j][i] * c[j];
            }
        }
        c
    }
}

/// Cholesky factor of the inner products of columns that arrive one by one. It has the digits of the products, so that
/// a solution is as accurate as one of [`Columns`] after a second one for the rest (Björck 1987, corrected seminormal
/// equations).
#[derive(Default)]
pub(crate) struct NormalEquations {
    /// Rows of the lower triangle.
    rows: Vec<Vec<f64>>,
}

impl NormalEquations {
    /// Adds a column with these inner products with the columns before and, last, with itself, unless its part
    /// orthogonal to the columns before is at most the fraction `filter` of it. Returns whether it was added.
    pub fn push(&mut self, products: &[f64], filter: f64) -> bool {
        let Some((square, products)) = products.split_last() else { return false };
        let mut row = Vec::with_capacity(products.len() + 1);
        for (before, product) in self.rows.iter().zip(products) {
            let known = dot(&before[..row.len()], &row);
            row.push((product - known) / before[row.len()]);
        }
        let rest = square - dot(&row, &row);
        // NaN adds none either.
        if rest.is_nan() || rest <= filter * filter * square {
            return false;
        }
        row.push(rest.sqrt());
        self.rows.push(row);
        true
    }

    /// Replaces the right-hand sides by the solution.
    pub fn solve(&self, b: &mut [f64]) {
        for (i, row) in self.rows.iter().enumerate() {
            b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            b[i] /= row[i];
            let (before, now) = b.split_at_mut(i);
            axpy(-now[0], &row[..i], before);
        }
    }
}

/// Eight partial sums in parallel: a single one would serialise the additions.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

pub(crate) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn axpy(factor: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += factor * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removes_the_part_in_the_span_of_the_columns() {
        let mut columns = Columns::default();
        assert!(columns.push(&[1.0, 1.0, 0.0], 1e-2));
        assert!(columns.push(&[1.0, -1.0, 0.0], 1e-2));
        assert!(!columns.push(&[3.0, -1.0, 1e-3], 1e-2), "nearly spanned");
        let mut residual = [2.0, 4.0, 5.0];
        let c = columns.remove(&mut residual);
        assert!((c[0] + 3.0).abs() < 1e-14 && (c[1] - 1.0).abs() < 1e-14, "{c:?}");
        assert!(residual[0].abs() < 1e-14 && residual[1].abs() < 1e-14 && residual[2] == 5.0);
    }
}
