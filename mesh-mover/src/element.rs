//! The pseudo-solid on one cell: a pure function from corner positions to a matrix.
//!
//! Hexahedra with trilinear shape functions at 2x2x2 Gauss points. Repeated nodes collapse a hexahedron into a prism,
//! pyramid or tetrahedron; the Gauss points lie inside, so the collapsed edge is never evaluated. Full integration
//! excludes hourglass modes; the dilatation is replaced by its mean over the cell (Hughes' B-bar), so that nearly
//! incompressible settings do not lock.

use mesh::geometry::Vec3;

/// Stiffness of one cell: `[3 * node + component]` squared, symmetric.
pub type CellMatrix = [[f64; 24]; 24];

/// Coordinate of the Gauss points in the parent cube, 1/sqrt(3).
const G: f64 = 0.577_350_269_189_625_8;

/// Corners of the parent cube in VTK order.
const CORNERS: [[f64; 3]; 8] = [
    [-1., -1., -1.],
    [1., -1., -1.],
    [1., 1., -1.],
    [-1., 1., -1.],
    [-1., -1., 1.],
    [1., -1., 1.],
    [1., 1., 1.],
    [-1., 1., 1.],
];

/// `PARENT[g][a][i]`: derivative of shape function `a` along parent axis `i` at
/// Gauss point `g`.
static PARENT: [[[f64; 3]; 8]; 8] = parent_gradients();

const fn parent_gradients() -> [[[f64; 3]; 8]; 8] {
    let mut all = [[[0.0; 3]; 8]; 8];
    let mut g = 0;
    while g < 8 {
        let mut a = 0;
        while a < 8 {
            let c = CORNERS[a];
            let f = [
                1.0 + c[0] * CORNERS[g][0] * G,
                1.0 + c[1] * CORNERS[g][1] * G,
                1.0 + c[2] * CORNERS[g][2] * G,
            ];
            all[g][a] = [0.125 * c[0] * f[1] * f[2], 0.125 * c[1] * f[0] * f[2], 0.125 * c[2] * f[0] * f[1]];
            a += 1;
        }
        g += 1;
    }
    all
}

/// A cell that is inverted at a Gauss point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inverted {
    /// Determinant of the Jacobian there, m3.
    pub determinant: f64,
}

/// Stiffness matrix of a cell with corners `coords` (m, VTK order, nodes may repeat).
///
/// Paper, equation 8, with the stiffening of Stein, Tezduyar and Benney (J.
/// Appl. Mech. 70, 2003, equation 9): the integral
/// $`\int B^T D B \, (\det J / J_0)^{-\chi} \det J \, d\xi`$ makes small cells
/// stiffer by the power `chi` of their volume; `chi = 0` is plain elasticity.
/// The factor $`J_0^{\chi}`$ is part of `lambda` and `mu` (Lame constants).
///
/// # Errors
/// [`Inverted`] when the Jacobian is not positive (or NaN) at a Gauss point.
pub fn stiffness(coords: &[Vec3; 8], lambda: f64, mu: f64, chi: f64) -> Result<CellMatrix, Inverted> {
    let mut grads = [[Vec3::zeros(); 8]; 8];
    let mut weights = [0.0; 8];
    let mut mean = [Vec3::zeros(); 8];
    let mut total = 0.0;
    for g in 0..8 {
        let det = gradients(coords, &PARENT[g], &mut grads[g]);
        if det.is_nan() || det <= 0.0 {
            return Err(Inverted { determinant: det });
        }
        let w = det.powf(1.0 - chi);
        weights[g] = w;
        total += w;
        for a in 0..8 {
            mean[a] += grads[g][a] * w;
        }
    }
    for m in &mut mean {
        *m /= total;
    }

    let mut k = [[0.0; 24]; 24];
    let bulk = (lambda + 2.0 / 3.0 * mu) * total;
    for a in 0..8 {
        for b in a..8 {
            let mut block = [[0.0; 3]; 3];
            for g in 0..8 {
                let (p, q) = (grads[g][a], grads[g][b]);
                let w = weights[g] * mu;
                let dot = w * p.dot(&q);
                for i in 0..3 {
                    block[i][i] += dot;
                    for j in 0..3 {
                        block[i][j] += w * (q[i] * p[j] - 2.0 / 3.0 * p[i] * q[j]);
                    }
                }
            }
            for i in 0..3 {
                for j in 0..3 {
                    let v = block[i][j] + bulk * mean[a][i] * mean[b][j];
                    k[3 * a + i][3 * b + j] = v;
                    k[3 * b + j][3 * a + i] = v;
                }
            }
        }
    }
    Ok(k)
}

/// Matrix of Laplace's equation on a cell, with unit conductivity and the stiffening of [`stiffness`].
///
/// # Errors
/// As [`stiffness`].
pub fn conductance(coords: &[Vec3; 8], chi: f64) -> Result<[[f64; 8]; 8], Inverted> {
    let mut k = [[0.0; 8]; 8];
    for parent in &PARENT {
        let mut grads = [Vec3::zeros(); 8];
        let det = gradients(coords, parent, &mut grads);
        if det.is_nan() || det <= 0.0 {
            return Err(Inverted { determinant: det });
        }
        let w = det.powf(1.0 - chi);
        for a in 0..8 {
            (0..8).for_each(|b| k[a][b] += w * grads[a].dot(&grads[b]));
        }
    }
    Ok(k)
}

/// Gradients of the shape functions in space; returns the determinant of the Jacobian.
fn gradients(coords: &[Vec3; 8], parent: &[[f64; 3]; 8], out: &mut [Vec3; 8]) -> f64 {
    // Rows of the Jacobian, $J_{rc} = \sum_a \partial N_a / \partial \xi_r \, x_{ac}$.
    let mut j = [Vec3::zeros(); 3];
    for (x, n) in coords.iter().zip(parent) {
        for r in 0..3 {
            j[r] += x * n[r];
        }
    }
    let c0 = j[1].cross(&j[2]);
    let c1 = j[2].cross(&j[0]);
    let c2 = j[0].cross(&j[1]);
    let det = j[0].dot(&c0);
    let inv = 1.0 / det;
    for (o, n) in out.iter_mut().zip(parent) {
        *o = (c0 * n[0] + c1 * n[1] + c2 * n[2]) * inv;
    }
    det
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, SymmetricEigen};

    fn cube() -> [Vec3; 8] {
        CORNERS.map(|c| Vec3::from(c) * 0.5)
    }

    /// Distorted and stretched cells, and the collapsed ones, by corner index.
    fn shapes() -> Vec<(&'static str, [Vec3; 8], [usize; 8])> {
        let all = [0, 1, 2, 3, 4, 5, 6, 7];
        let mut skew = cube();
        for (a, p) in skew.iter_mut().enumerate() {
            let s = a as f64;
            *p += Vec3::new(0.12 * (3.1 * s).sin(), 0.12 * (1.7 * s).cos(), 0.1 * (2.3 * s).sin());
        }
        let mut sliver = skew;
        sliver.iter_mut().for_each(|p| p[2] *= 0.01);
        let prism = [0, 1, 2, 2, 4, 5, 6, 6];
        let pyramid = [0, 1, 2, 3, 4, 4, 4, 4];
        let tetrahedron = [0, 1, 2, 2, 4, 4, 4, 4];
        let pick = |m: [usize; 8]| m.map(|a| skew[a]);
        vec![
            ("cube", cube(), all),
            ("skew", skew, all),
            ("sliver 100:1", sliver, all),
            ("prism", pick(prism), prism),
            ("pyramid", pick(pyramid), pyramid),
            ("tetrahedron", pick(tetrahedron), tetrahedron),
        ]
    }

    /// The cell matrix with repeated nodes summed, on distinct nodes.
    fn condensed(k: &CellMatrix, nodes: [usize; 8]) -> DMatrix<f64> {
        let mut distinct: Vec<usize> = nodes.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let at = |a: usize| distinct.iter().position(|&n| n == nodes[a]).unwrap();
        let mut m = DMatrix::zeros(3 * distinct.len(), 3 * distinct.len());
        for a in 0..24 {
            for b in 0..24 {
                m[(3 * at(a / 3) + a % 3, 3 * at(b / 3) + b % 3)] += k[a][b];
            }
        }
        m
    }

    #[test]
    fn matrix_is_symmetric_with_six_rigid_modes() {
        for chi in [0.0, 1.0, 2.0] {
            for (name, x, nodes) in shapes() {
                let k = stiffness(&x, 1.2, 0.8, chi).unwrap();
                for a in 0..24 {
                    for b in 0..24 {
                        assert_eq!(k[a][b], k[b][a], "{name}");
                    }
                }
                let mut e: Vec<f64> =
                    SymmetricEigen::new(condensed(&k, nodes)).eigenvalues.iter().copied().collect();
                e.sort_by(f64::total_cmp);
                let largest = e[e.len() - 1];
                // Round-off of the eigenvalues is about 24 * 1e-16 of the largest.
                assert!(e[..6].iter().all(|v| v.abs() < 1e-13 * largest), "{name} chi {chi}: {e:?}");
                // The softest elastic mode of the sliver is its twist (thickness cubed), the stiffest its compression
                // (1/thickness): (1/100)^4, far above round-off.
                assert!(e[6] > 1e-9 * largest, "{name} chi {chi}: {e:?}");
            }
        }
    }

    #[test]
    fn infinitesimal_rotation_has_no_energy() {
        for (name, x, _) in shapes() {
            let k = stiffness(&x, 1.2, 0.8, 1.0).unwrap();
            let w = Vec3::new(0.3, -0.7, 0.5);
            let u: Vec<f64> = x.iter().flat_map(|p| <[f64; 3]>::from(w.cross(p))).collect();
            let scale = k.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
            for row in &k {
                let f: f64 = row.iter().zip(&u).map(|(a, b)| a * b).sum();
                assert!(f.abs() < 1e-13 * scale, "{name}: {f}");
            }
        }
    }

    #[test]
    fn energy_of_uniform_strain_is_exact() {
        // Without stiffening the energy of a linear field is that of the solid.
        let (lambda, mu) = (1.2, 0.8);
        let a = [[0.1, 0.3, -0.2], [0.05, -0.2, 0.4], [0.0, 0.1, 0.3]].map(Vec3::from);
        for (name, x, _) in shapes() {
            let k = stiffness(&x, lambda, mu, 0.0).unwrap();
            let u: Vec<f64> = x.iter().flat_map(|p| a.map(|row| row.dot(p))).collect();
            let energy: f64 =
                (0..24).map(|i| u[i] * (0..24).map(|j| k[i][j] * u[j]).sum::<f64>()).sum::<f64>() * 0.5;
            let mut density = 0.0;
            let trace = a[0][0] + a[1][1] + a[2][2];
            for i in 0..3 {
                for j in 0..3 {
                    density += mu * (0.5 * (a[i][j] + a[j][i])).powi(2);
                }
            }
            density += 0.5 * lambda * trace * trace;
            let exact = density * mesh::quality::volume(&x);
            assert!((energy / exact - 1.0).abs() < 1e-12, "{name}: {energy} {exact}");
        }
    }

    #[test]
    fn small_cells_are_stiffer_by_the_power_chi() {
        let half = cube().map(|p| p * 0.5);
        for chi in [0.0, 0.5, 1.0, 2.0] {
            let (k1, k2) =
                (stiffness(&cube(), 1.0, 1.0, chi).unwrap(), stiffness(&half, 1.0, 1.0, chi).unwrap());
            // K scales with the length h, and with (h^3)^-chi by the stiffening.
            let ratio = k2[0][0] / k1[0][0];
            assert!((ratio - 0.5f64.powf(1.0 - 3.0 * chi)).abs() < 1e-12 * ratio, "{chi}: {ratio}");
        }
    }

    /// `chi` is the exponent of the cell's volume; without it the energy of a linear field is exact.
    #[test]
    fn conductance_is_exact_for_linear_fields_and_scales_with_chi() {
        for (name, x, _) in shapes() {
            let k = conductance(&x, 0.0).unwrap();
            let slope = Vec3::new(0.3, -0.7, 0.5);
            let u = x.map(|p| slope.dot(&p));
            let energy: f64 = (0..8).map(|a| u[a] * dot8(&k[a], &u)).sum();
            let exact = slope.dot(&slope) * mesh::quality::volume(&x);
            assert!((energy / exact - 1.0).abs() < 1e-12, "{name}: {energy} {exact}");
        }
        let half = cube().map(|p| p * 0.5);
        for chi in [0.5, 1.0, 2.0] {
            let (k1, k2) = (conductance(&cube(), chi).unwrap(), conductance(&half, chi).unwrap());
            let ratio = k2[0][0] / k1[0][0];
            assert!((ratio - 0.5f64.powf(1.0 - 3.0 * chi)).abs() < 1e-12 * ratio, "{chi}: {ratio}");
        }
    }

    fn dot8(a: &[f64; 8], b: &[f64; 8]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn inverted_cell_is_an_error() {
        let mut x = cube();
        x.swap(0, 6);
        assert!(stiffness(&x, 1.0, 1.0, 1.0).is_err());
        x[0][0] = f64::NAN;
        assert!(stiffness(&x, 1.0, 1.0, 1.0).is_err());
    }
}
