//! Influence matrix of a canopy that is folded.
//!
//! Potential flow around a surface has a kinetic energy: with the areas $`a`$ of the groups, $`S = a^{1/2} A a^{-1/2}`$ is symmetric and positive
//! definite but for errors of the discretisation. Where faces lie on each other, at a distance below their size, the velocities that rings induce at
//! centres of faces have nothing in common with their means, and eigenvalues of $`S`$ become negative: an added mass below zero, with which no
//! iteration converges. Their size is kept, their sign is not; an added mass that exceeds the air around the canopy is bounded.

use faer::{Mat, Side};
use nalgebra::DMatrix;

/// Least eigenvalue times the root of the canopy's area. A square plate has 1.84 (12 faces across).
const LEAST: f64 = 0.4;

/// Area of a group that scales its row and column, relative to that of the canopy, at least: collapsed faces have none.
const LEAST_SHARE: f64 = 1e-9;

/// `influence` (1/m) between groups of these `areas` (m2); where its symmetric part is not positive definite, one that is symmetric and definite.
pub(super) fn definite(influence: DMatrix<f64>, areas: &[f64]) -> DMatrix<f64> {
    let n = areas.len();
    let total: f64 = areas.iter().sum();
    let root: Vec<f64> = areas.iter().map(|a| a.max(LEAST_SHARE * total).sqrt()).collect();
    if !influence.iter().chain(&root).all(|v| v.is_finite()) || total <= 0.0 {
        return influence;
    }
    let scaled = |i: usize, j: usize| influence[(i, j)] * root[i] / root[j];
    let symmetric = |i: usize, j: usize| 0.5 * (scaled(i, j) + scaled(j, i));
    let least = LEAST / total.sqrt();
    // The bound is not sharp: single precision decides.
    let shifted = |i: usize, j: usize| symmetric(i, j) - if i == j { least } else { 0.0 };
    if Mat::from_fn(n, n, |i, j| if i < j { 0.0 } else { shifted(i, j) as f32 }).llt(Side::Lower).is_ok() {
        return influence;
    }
    let symmetric = Mat::from_fn(n, n, symmetric);
    let Ok(modes) = symmetric.self_adjoint_eigen(Side::Lower) else { return influence };
    let (vectors, values) = (modes.U(), modes.S());
    let weighted = Mat::from_fn(n, n, |i, k| vectors[(i, k)] * values[k].abs().max(least));
    let product = weighted * vectors.transpose();
    DMatrix::from_fn(n, n, |i, j| product[(i, j)] * root[j] / root[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schemes::surrogate::vortex_lattice::VortexLattice;
    use crate::schemes::test_support::plate;

    fn eigenvalues(influence: &DMatrix<f64>, areas: &[f64]) -> Vec<f64> {
        let n = areas.len();
        let scaled = |i: usize, j: usize| influence[(i, j)] * (areas[i] / areas[j]).sqrt();
        let symmetric = Mat::from_fn(n, n, |i, j| 0.5 * (scaled(i, j) + scaled(j, i)));
        symmetric.self_adjoint_eigenvalues(Side::Lower).expect("finite")
    }

    /// The matrix of a plate stays bitwise the same. Folded in two, with a tenth of a face between halves that do not lie face on face, it would have an
    /// eigenvalue of -9 / m; the lattice has none below the bound.
    #[test]
    fn folded_plate_has_a_definite_matrix() {
        let n = 12;
        let (flat, faces) = plate(n);
        let lattice = VortexLattice::new(&flat, &faces, usize::MAX, 0.0).expect("a plate");
        let areas = lattice.groups.areas(&lattice.areas);
        assert_eq!(definite(lattice.influence.clone(), &areas), lattice.influence);
        let lowest = eigenvalues(&lattice.influence, &areas)[0];
        println!("lowest eigenvalue of a square plate of side 1: {lowest:.3}");
        assert!(lowest > 3.0 * LEAST, "{lowest}");
        let fold = 0.5 + 0.3 / n as f64;
        let gap = 0.1 / n as f64;
        let folded: Vec<mesh::Point> = flat
            .iter()
            .map(|x| if x[0] > fold { [2.0 * fold - x[0], x[1] + 0.4 / n as f64, gap] } else { *x })
            .collect();
        let lattice = VortexLattice::new(&folded, &faces, usize::MAX, 0.0).expect("a folded plate");
        let areas = lattice.groups.areas(&lattice.areas);
        let values = eigenvalues(&lattice.influence, &areas);
        let least = LEAST / areas.iter().sum::<f64>().sqrt();
        assert!(values[0] > 0.999 * least, "{}", values[0]);
    }

    /// A collapsed face gives a finite matrix, and one that is not finite is not touched.
    #[test]
    fn faces_without_area_and_matrices_without_numbers_end_nothing() {
        let mut influence = DMatrix::from_fn(3, 3, |i, j| if i == j { 1.0 } else { -0.9 });
        let found = definite(influence.clone(), &[1.0, 0.0, 1.0]);
        assert!(found.iter().all(|v| v.is_finite()) && found != influence);
        influence[(0, 1)] = f64::NAN;
        assert!(definite(influence, &[1.0, 0.0, 1.0])[(0, 1)].is_nan());
    }
}
