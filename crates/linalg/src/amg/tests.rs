//! The parts of multigrid against dense algebra on a chain of nodes.

use std::rc::Rc;

use comm::Halo;

use super::aggregate::{NONE, aggregate};
use super::prolongation::Prolongation;
use super::*;
use crate::block::invert;

type Dense = Vec<Vec<f64>>;

const BLOCK: [[f64; 3]; 3] = [[1.0, 0.3, 0.0], [0.3, 1.5, 0.1], [0.0, 0.1, 0.8]];

/// Second differences times [`BLOCK`], the diagonal `2 + varied i`: `D^-1 A` of the chain with
/// `varied = 0` has the eigenvalues `1 - cos(k pi / (n + 1))`, three times each.
fn chain(n: usize, varied: f64) -> BlockCsr<3> {
    let lists: Vec<Vec<u32>> = (0..n)
        .map(|i| [i.wrapping_sub(1), i + 1].into_iter().filter(|&j| j < n).map(|j| j as u32).collect())
        .collect();
    let mut a = BlockCsr::<3>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
    for i in 0..n {
        for s in a.row(i) {
            let factor = if a.cols()[s] as usize == i { 2.0 + varied * i as f64 } else { -1.0 };
            a.values[s] = BLOCK.map(|row| row.map(|v| factor * v));
        }
    }
    a
}

fn helix(n: usize) -> Vec<[f64; 3]> {
    (0..n).map(|i| i as f64).map(|i| [0.4 * i, (0.9 * i).cos(), 1.0 + (1.1 * i).sin()]).collect()
}

fn dense<const B: usize>(a: &BlockCsr<B>) -> Dense {
    let mut full = vec![vec![0.0; a.n_rows() * B]; a.n_rows() * B];
    for i in 0..a.n_rows() {
        for s in a.row(i) {
            for (r, row) in a.values[s].iter().enumerate() {
                let j = a.cols()[s] as usize * B;
                full[i * B + r][j..j + B].copy_from_slice(row);
            }
        }
    }
    full
}

fn dense_prolongation(p: &Prolongation<3, f64>, n_coarse: usize) -> Dense {
    let mut full = vec![vec![0.0; n_coarse * MODES]; (p.row_ptr.len() - 1) * 3];
    for i in 0..p.row_ptr.len() - 1 {
        for s in p.row_ptr[i]..p.row_ptr[i + 1] {
            for (r, row) in p.values[s].iter().enumerate() {
                let j = p.cols[s] as usize * MODES;
                full[i * 3 + r][j..j + MODES].copy_from_slice(row);
            }
        }
    }
    full
}

fn product(a: &Dense, b: &Dense) -> Dense {
    a.iter()
        .map(|row| (0..b[0].len()).map(|c| row.iter().zip(b).map(|(x, b)| x * b[c]).sum()).collect())
        .collect()
}

fn transposed(a: &Dense) -> Dense {
    (0..a[0].len()).map(|c| a.iter().map(|row| row[c]).collect()).collect()
}

fn times(a: &Dense, x: &[f64]) -> Vec<f64> {
    a.iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
}

/// Gauss-Jordan elimination; the matrices here are positive definite or triangular by blocks.
fn solved(a: &Dense, b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut a: Dense = a.iter().zip(b).map(|(row, &b)| [&row[..], &[b]].concat()).collect();
    for k in 0..n {
        let pivot: Vec<f64> = a[k].iter().map(|v| v / a[k][k]).collect();
        for (i, row) in a.iter_mut().enumerate() {
            let f = if i == k { continue } else { row[k] };
            row.iter_mut().zip(&pivot).for_each(|(v, p)| *v -= f * p);
        }
        a[k] = pivot;
    }
    a.iter().map(|row| row[n]).collect()
}

fn assert_close(found: &Dense, wanted: &Dense, bound: f64) {
    assert_eq!((found.len(), found[0].len()), (wanted.len(), wanted[0].len()));
    for (f, w) in found.iter().flatten().zip(wanted.iter().flatten()) {
        assert!((f - w).abs() < bound, "{f} {w}");
    }
}

fn inverses(a: &BlockCsr<3>) -> Vec<[[f64; 3]; 3]> {
    (0..a.n_rows()).map(|i| invert(&a.values[a.diagonal_slot(i)]).unwrap()).collect()
}

/// Lanczos ends with the exact value when the chain has fewer distinct eigenvalues than steps;
/// the estimate is five per cent above it.
#[test]
fn the_largest_eigenvalue_of_a_chain() {
    for n in [3, 9] {
        let a = chain(n, 0.0);
        let want = 1.05 * (1.0 + (std::f64::consts::PI / (n + 1) as f64).cos());
        let found = spectrum::largest(&a, &inverses(&a), 0);
        assert!((found - want).abs() < 1e-10, "{n}: {found} {want}");
    }
}

/// Vanek, Mandel, Brezina: `P R = (I - omega D^-1 A) modes` with `omega = 4 / (3 lambda)`, since the
/// tentative prolongation times the coarse modes gives the modes back; the coarse matrix is `P^T A P`.
#[test]
fn the_prolongation_is_the_smoothed_modes() {
    let n = 9;
    let a = chain(n, 0.0);
    let modes = rigid_modes(&a, &helix(n));
    let (Step { a: coarse, modes: coarse_modes }, p) =
        coarsen(&a, &inverses(&a), &modes, &AmgParams::default());
    assert_eq!(coarse.n_rows(), 3, "three aggregates");
    let p = dense_prolongation(&p, coarse.n_rows());
    let full = dense(&a);
    let mut projected = product(&transposed(&p), &product(&full, &p));
    let coarse = dense(&coarse);
    for (c, column) in transposed(&p).iter().enumerate() {
        // Two nodes do not know the rotation about the line between them; any diagonal will do.
        if column.iter().all(|&v| v == 0.0) {
            assert!(coarse[c][c] > 0.1);
            projected[c][c] = coarse[c][c];
        }
    }
    assert_close(&projected, &coarse, 1e-13);

    let flat: Dense = modes.iter().flatten().map(|row| row.to_vec()).collect();
    let coarse_flat: Dense = coarse_modes.iter().flatten().map(|row| row.to_vec()).collect();
    let omega = 4.0 / (3.0 * 1.05 * (1.0 + (std::f64::consts::PI / (n + 1) as f64).cos()));
    let mut wanted = flat.clone();
    for (m, mode) in transposed(&flat).iter().enumerate() {
        let residual = times(&full, mode);
        for i in 0..n {
            let correction =
                solved(&BLOCK.map(|r| r.map(|v| 2.0 * v).to_vec()).to_vec(), &residual[3 * i..3 * i + 3]);
            (0..3).for_each(|r| wanted[3 * i + r][m] -= omega * correction[r]);
        }
    }
    assert_close(&product(&p, &coarse_flat), &wanted, 1e-10);
}

/// A V-cycle of two levels: block Gauss-Seidel forward, the exact coarse correction, backward.
#[test]
fn a_cycle_of_two_levels_is_its_dense_formula() {
    let n = 9;
    let a = chain(n, 0.1);
    let coords = helix(n);
    let (Step { a: coarse, .. }, p) =
        coarsen(&a, &inverses(&a), &rigid_modes(&a, &coords), &AmgParams::default());
    let p = dense_prolongation(&p, coarse.n_rows());
    let full = dense(&a);
    let part = |keep: fn(usize, usize) -> bool| -> Dense {
        let entry = |i: usize, j: usize| if keep(i / 3, j / 3) { full[i][j] } else { 0.0 };
        (0..3 * n).map(|i| (0..3 * n).map(|j| entry(i, j)).collect()).collect()
    };
    let r: Vec<f64> = (0..3 * n).map(|i| 40.0 * (0.7 * i as f64).sin()).collect();
    let rest = |x: &[f64]| -> Vec<f64> { r.iter().zip(times(&full, x)).map(|(r, ax)| r - ax).collect() };
    let add = |x: &mut [f64], y: Vec<f64>| x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
    let mut x = solved(&part(|i, j| j <= i), &r);
    let correction = solved(&dense(&coarse), &times(&transposed(&p), &rest(&x)));
    add(&mut x, times(&p, &correction));
    let last = solved(&part(|i, j| j >= i), &rest(&x));
    add(&mut x, last);

    let amg = Amg::<f64>::new(&a, &coords, AmgParams::default()).unwrap();
    let mut z = vec![0.0; 3 * n];
    amg.apply(&r, &mut z);
    assert_close(&vec![z], &vec![x], 1e-11);
}

/// A coupling is strong above `strength` times the geometric mean of the diagonals.
#[test]
fn strong_couplings_are_those_above_their_share() {
    for (share, together) in [(0.99, false), (1.01, true)] {
        let lists = [vec![1], vec![0]];
        let mut a = BlockCsr::<1>::from_adjacency(Rc::new(Halo::solo(2)), &lists);
        let coupling = -0.08 * share * f64::sqrt(3.0 * 12.0);
        a.values = vec![[[3.0]], [[coupling]], [[coupling]], [[12.0]]];
        let of_node = aggregate(&a, 0.08).of_node;
        assert!(of_node.iter().all(|&g| g != NONE));
        assert_eq!(of_node[0] == of_node[1], together, "{share}");
    }
}

/// Translations, and rotations `e_k x (x - mean) / extent`.
#[test]
fn rigid_modes_turn_about_the_mean() {
    let n = 5;
    let coords = helix(n);
    let mean = [0, 1, 2].map(|c| coords.iter().map(|x| x[c]).sum::<f64>() / n as f64);
    let arm = |i: usize| [0, 1, 2].map(|c| coords[i][c] - mean[c]);
    let extent = (0..n).flat_map(arm).map(f64::abs).fold(0.0, f64::max);
    for (i, modes) in rigid_modes(&chain(n, 0.0), &coords).iter().enumerate() {
        let [x, y, z] = arm(i).map(|v| v / extent);
        let wanted = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        for r in 0..3 {
            for k in 0..3 {
                assert_eq!(modes[r][k], f64::from(u8::from(r == k)));
                assert!((modes[r][3 + k] - wanted[k][r]).abs() < 1e-15);
            }
        }
    }
}
