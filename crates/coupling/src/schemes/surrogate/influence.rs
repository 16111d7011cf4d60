//! Influence matrix of a vortex lattice, made symmetric and positive definite.
//!
//! Potential flow around a surface has a kinetic energy $`\tfrac12 \rho\,\Gamma^T D A \Gamma`$ with the areas $`D`$ of the groups. So
//! $`S = D^{1/2} A D^{-1/2}`$ is symmetric and positive definite but for errors of the discretisation: velocities at points instead of means over
//! faces. The lattice has its symmetric part, which needs a third of the operations of a general matrix, and an inverse of half the bytes.
//!
//! Where faces lie on each other, at a distance below their size, the velocities that rings induce at centres of faces have nothing in common with
//! their means, and eigenvalues of $`S`$ become negative: an added mass below zero, with which no iteration converges. Their size is kept, their
//! sign is not; an added mass that exceeds the air around the canopy is bounded.

use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, Side};
use nalgebra::{DMatrix, DVector};

use super::inverse::Inverse;

/// Least eigenvalue times the root of the canopy's area. A square plate has 1.84 (12 faces across).
const LEAST: f64 = 0.4;

/// Area of a group that scales its row and column, relative to that of the canopy, at least: collapsed faces have none.
const LEAST_SHARE: f64 = 1e-9;

/// Corrections of a solution with the inverse in single precision: each takes off five digits of its error.
const CORRECTIONS: usize = 3;

/// Normal velocities at groups of faces per strength of the rings around them: $`A = D^{-1/2} S D^{1/2}`$, 1/m.
#[derive(Clone)]
pub struct Influence {
    /// $`S`$, 1/m.
    symmetric: Mat<f64>,
    /// $`D^{1/2}`$, m.
    roots: Vec<f64>,
    /// $`A^{-1}`$; `None` for a singular matrix.
    inverse: Option<Inverse>,
}

impl Influence {
    /// Symmetric part of the influence between groups of these `areas` (m2); a definite one where it is not. `rows`: normal velocity at group i per
    /// strength of ring j, `[groups][groups]`, 1/m.
    pub(super) fn new(rows: &[f64], areas: &[f64]) -> Self {
        let n = areas.len();
        let total: f64 = areas.iter().sum();
        let roots: Vec<f64> =
            areas.iter().map(|a| a.max(LEAST_SHARE * total).sqrt().max(f64::MIN_POSITIVE)).collect();
        let entry = |i: usize, j: usize| {
            0.5 * (rows[i * n + j] * (roots[i] / roots[j]) + rows[j * n + i] * (roots[j] / roots[i]))
        };
        let mut symmetric = Mat::from_fn(n, n, entry);
        let least = LEAST / total.sqrt();
        let mut inverse = inverse(&symmetric, 0.0, &roots);
        let known = inverse.as_ref().is_some_and(|x| least * x.largest_row_sum() < 1.0);
        let finite = total > 0.0 && rows.iter().chain(&roots).all(|v| v.is_finite());
        if !known && finite && make_definite(&mut symmetric, least) {
            inverse = self::inverse(&symmetric, 0.0, &roots);
        }
        Self { symmetric, roots, inverse }
    }

    /// Groups.
    pub fn len(&self) -> usize {
        self.roots.len()
    }

    /// Whether there are no groups.
    pub fn is_empty(&self) -> bool {
        self.roots.is_empty()
    }

    /// $`A^{-1}`$ in single precision; `None` for a singular matrix.
    pub fn inverse(&self) -> Option<&Inverse> {
        self.inverse.as_ref()
    }

    /// $`(A + g I)^{-1}`$ in single precision; `None` for a singular matrix.
    pub fn shifted_inverse(&self, g: f64) -> Option<Inverse> {
        inverse(&self.symmetric, g, &self.roots)
    }

    /// $`A x`$.
    pub fn apply(&self, x: &DVector<f64>) -> DVector<f64> {
        let scaled = DVector::from_fn(x.len(), |i, _| x[i] * self.roots[i]);
        let product = self.scaled_product(&scaled);
        DVector::from_fn(x.len(), |i, _| product[i] / self.roots[i])
    }

    /// $`A^{-T} b`$ in double precision, by corrections of solutions in single precision; `None` for a singular matrix.
    pub fn solve_transpose(&self, b: &DVector<f64>) -> Option<DVector<f64>> {
        let (n, inverse) = (b.len(), self.inverse.as_ref()?);
        // A^T = D^(1/2) S D^(-1/2).
        let right = DVector::from_fn(n, |i, _| b[i] / self.roots[i]);
        let mut y = DVector::zeros(n);
        for _ in 0..=CORRECTIONS {
            let rest = &right - self.scaled_product(&y);
            y += DVector::from_vec(inverse.apply_symmetric(rest.as_slice()));
        }
        Some(DVector::from_fn(n, |i, _| y[i] * self.roots[i]))
    }

    /// $`S x`$.
    fn scaled_product(&self, x: &DVector<f64>) -> DVector<f64> {
        let mut y = DVector::zeros(x.len());
        for (j, x) in x.iter().enumerate() {
            let column = self.symmetric.col(j).try_as_col_major();
            let column = column.map_or(&[][..], |c| c.as_slice());
            crate::schemes::least_squares::axpy(*x, column, y.as_mut_slice());
        }
        y
    }

    /// $`A`$.
    pub fn matrix(&self) -> DMatrix<f64> {
        let n = self.len();
        DMatrix::from_fn(n, n, |i, j| self.symmetric[(i, j)] * self.roots[j] / self.roots[i])
    }
}

fn inverse(symmetric: &Mat<f64>, g: f64, roots: &[f64]) -> Option<Inverse> {
    Inverse::new(&factor(symmetric, g)?.inverse(), roots)
}

/// Cholesky factor of $`S + g I`$ in single precision; `None` where it is not definite.
fn factor(symmetric: &Mat<f64>, g: f64) -> Option<Llt<f32>> {
    let n = symmetric.nrows();
    let shifted = Mat::from_fn(n, n, |i, j| (symmetric[(i, j)] + if i == j { g } else { 0.0 }) as f32);
    shifted.llt(Side::Lower).ok()
}

/// Replaces the eigenvalues below `least` by their size, `least` at least. Whether there were any.
fn make_definite(symmetric: &mut Mat<f64>, least: f64) -> bool {
    if factor(symmetric, -least).is_some() {
        return false;
    }
    let Ok(modes) = symmetric.self_adjoint_eigen(Side::Lower) else { return false };
    let (vectors, values, n) = (modes.U(), modes.S(), symmetric.nrows());
    let weighted = Mat::from_fn(n, n, |i, k| vectors[(i, k)] * values[k].abs().max(least));
    *symmetric = weighted * vectors.transpose();
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schemes::surrogate::vortex_lattice::VortexLattice;
    use crate::schemes::test_support::plate;

    fn lowest(influence: &Influence) -> f64 {
        influence.symmetric.self_adjoint_eigenvalues(Side::Lower).expect("finite")[0]
    }

    /// A plate's matrix is not changed but for its symmetric part. Folded in two, with a tenth of a face between halves that do not lie face on face, it
    /// would have an eigenvalue of -9 / m; the lattice has none below the bound.
    #[test]
    fn folded_plate_has_a_definite_matrix() {
        let n = 12;
        let (flat, faces) = plate(n);
        let lattice = VortexLattice::new(&flat, &faces, usize::MAX, 0.0).expect("a plate");
        let lowest_of_plate = lowest(&lattice.influence);
        println!("lowest eigenvalue of a square plate of side 1: {lowest_of_plate:.3}");
        assert!(lowest_of_plate > 3.0 * LEAST, "{lowest_of_plate}");
        let before = lattice.influence.symmetric.clone();
        let mut after = before.clone();
        assert!(!make_definite(&mut after, LEAST));
        assert_eq!(before, after);
        let fold = 0.5 + 0.3 / n as f64;
        let gap = 0.1 / n as f64;
        let folded: Vec<mesh::Point> = flat
            .iter()
            .map(|x| if x[0] > fold { [2.0 * fold - x[0], x[1] + 0.4 / n as f64, gap] } else { *x })
            .collect();
        let lattice = VortexLattice::new(&folded, &faces, usize::MAX, 0.0).expect("a folded plate");
        let areas = lattice.groups.areas(&lattice.areas);
        let least = LEAST / areas.iter().sum::<f64>().sqrt();
        assert!(lowest(&lattice.influence) > 0.999 * least, "{}", lowest(&lattice.influence));
        assert!(lattice.influence.inverse().is_some());
    }

    /// A collapsed face gives a finite matrix, and one that is not finite is not touched.
    #[test]
    fn faces_without_area_and_matrices_without_numbers_end_nothing() {
        let mut rows: Vec<f64> = (0..9).map(|k| if k % 4 == 0 { 1.0 } else { -0.9 }).collect();
        let found = Influence::new(&rows, &[1.0, 0.0, 1.0]);
        assert!(found.matrix().iter().all(|v| v.is_finite()));
        assert!(lowest(&found) > 0.0 && found.inverse().is_some());
        rows[1] = f64::NAN;
        let found = Influence::new(&rows, &[1.0, 0.0, 1.0]);
        assert!(found.matrix()[(0, 1)].is_nan());
        assert!(found.inverse().is_none());
    }

    /// Products and solutions of an asymmetric `A` with areas of a factor of nine, from its dense matrix.
    #[test]
    fn products_and_solutions_are_those_of_the_matrix() {
        let n = 37;
        let areas: Vec<f64> = (0..n).map(|i| 0.1 + 0.8 * (1.3 * i as f64).sin().powi(2)).collect();
        let rows: Vec<f64> = (0..n * n)
            .map(|k| {
                let (i, j) = (k / n, k % n);
                if i == j { 20.0 } else { 0.4 * ((i + j) as f64).sin() * areas[j] }
            })
            .collect();
        let influence = Influence::new(&rows, &areas);
        let matrix = influence.matrix();
        // The symmetric part in the product weighted by areas.
        let weighted = DMatrix::from_fn(n, n, |i, j| areas[i] * matrix[(i, j)]);
        assert!((&weighted - weighted.transpose()).amax() < 1e-14 * weighted.amax());
        assert!((matrix[(3, 5)] / rows[3 * n + 5] - 1.0).abs() < 1e-12, "it was symmetric before");
        let x = DVector::from_fn(n, |i, _| (i as f64).cos());
        assert!((influence.apply(&x) - &matrix * &x).amax() < 1e-12);
        let solved = influence.solve_transpose(&(matrix.transpose() * &x)).expect("a regular matrix");
        assert!((&solved - &x).amax() < 1e-12, "{}", (&solved - &x).amax());
        for g in [0.0, 7.0] {
            let inverse = influence.shifted_inverse(g).expect("a regular matrix");
            let b = &matrix * &x + &x * g;
            let found = DVector::from_vec(inverse.apply(b.as_slice()));
            assert!((&found - &x).amax() < 1e-5 * x.amax(), "{g}: {}", (&found - &x).amax());
        }
    }
}
