//! From a matrix to its prolongation and coarse matrix.

use super::aggregate::{NONE, aggregate};
use super::galerkin::{CoarseRows, galerkin};
use super::prolongation::Prolongation;
use super::{AmgParams, MODES, spectrum};
use crate::BlockCsr;
use crate::block::Real;
use crate::ghost_rows::{GhostRows, starts};

/// The next coarser problem.
pub(super) struct Step {
    pub a: BlockCsr<MODES>,
    /// Rigid motions in terms of the coarse unknowns.
    pub modes: Vec<[[f64; MODES]; MODES]>,
}

/// Aggregates the nodes of `a`, builds the tentative prolongation that reproduces
/// `modes`, smooths it by one step of damped Jacobi, and projects. Collective.
pub(super) fn coarsen<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    inverse: &[[[f64; F]; F]],
    modes: &[[[f64; MODES]; F]],
    params: &AmgParams,
) -> (Step, Prolongation<F, f64>) {
    let comm = a.halo().comm();
    let ghosts = GhostRows::new(a.halo());
    let aggregates = aggregate(a, params.strength);
    let first = starts(&comm.all_gather_u64(aggregates.count as u64));
    let (tentative, coarse_modes) = tentative(&aggregates.of_node, aggregates.count, modes);

    // Tentative rows of local nodes, ghosts included: coarse number (-1: none), block.
    let width = 1 + F * MODES;
    let mut rows = vec![-1.0; a.halo().n_local() * width];
    for (i, t) in tentative.iter().enumerate() {
        if aggregates.of_node[i] != NONE {
            let row = &mut rows[i * width..(i + 1) * width];
            row[0] = (first[comm.rank()] + u64::from(aggregates.of_node[i])) as f64;
            row[1..].copy_from_slice(t.as_flattened());
        }
    }
    drop(tentative);
    a.halo().exchange(&mut rows, width);

    let omega = 4.0 / (3.0 * spectrum::largest(a, inverse, ghosts.first[comm.rank()]));
    let p = smooth(a, inverse, &rows, omega);
    drop(rows);
    let (a, p) = galerkin(a, &ghosts, p, aggregates.count, &first);
    (Step { a, modes: coarse_modes }, p)
}

/// Orthonormalises the modes of each aggregate (Gram-Schmidt, twice): the tentative block
/// of each node and the triangular factor, which holds the modes of the coarse node.
/// Modes that an aggregate cannot distinguish (a lone node has no rotation) become zero.
#[allow(clippy::type_complexity)]
fn tentative<const F: usize>(
    of_node: &[u32],
    count: usize,
    modes: &[[[f64; MODES]; F]],
) -> (Vec<[[f64; MODES]; F]>, Vec<[[f64; MODES]; MODES]>) {
    let mut start = vec![0usize; count + 1];
    for &g in of_node.iter().filter(|&&g| g != NONE) {
        start[g as usize + 1] += 1;
    }
    (0..count).for_each(|g| start[g + 1] += start[g]);
    let mut members = vec![0u32; start[count]];
    let mut at = start.clone();
    for (i, &g) in of_node.iter().enumerate().filter(|(_, g)| **g != NONE) {
        members[at[g as usize]] = i as u32;
        at[g as usize] += 1;
    }

    let mut q = modes.to_vec();
    let mut r = vec![[[0.0; MODES]; MODES]; count];
    for g in 0..count {
        let nodes = &members[start[g]..start[g + 1]];
        let dot = |q: &[[[f64; MODES]; F]], m: usize, k: usize| -> f64 {
            nodes.iter().map(|&i| q[i as usize].iter().map(|row| row[m] * row[k]).sum::<f64>()).sum()
        };
        for m in 0..MODES {
            let before = dot(&q, m, m).sqrt();
            for _ in 0..2 {
                for k in 0..m {
                    let c = dot(&q, k, m);
                    r[g][k][m] += c;
                    for &i in nodes {
                        q[i as usize].iter_mut().for_each(|row| row[m] -= c * row[k]);
                    }
                }
            }
            let norm = dot(&q, m, m).sqrt();
            let independent = norm > 1e-9 * before && norm > 0.0;
            let scale = if independent { 1.0 / norm } else { 0.0 };
            r[g][m][m] = if independent { norm } else { 0.0 };
            for &i in nodes {
                q[i as usize].iter_mut().for_each(|row| row[m] *= scale);
            }
        }
    }
    (q, r)
}

/// $`P = (I - \omega D^{-1} A)\,T`$ for the owned rows.
fn smooth<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    inverse: &[[[f64; F]; F]],
    tentative: &[f64],
    omega: f64,
) -> CoarseRows<F> {
    let width = 1 + F * MODES;
    let row_of = |j: usize| {
        let row = &tentative[j * width..(j + 1) * width];
        let block = row[1..].as_chunks::<MODES>().0.first_chunk::<F>();
        block.filter(|_| row[0] >= 0.0).map(|block| (row[0] as u64, block))
    };
    let mut p = CoarseRows::default();
    let mut sums: Vec<(u64, [[f64; MODES]; F])> = Vec::new();
    for i in 0..a.n_rows() {
        sums.clear();
        // A node without aggregate is held: no coarse correction.
        if let Some((own, t)) = row_of(i) {
            sums.push((own, [[0.0; MODES]; F]));
            for s in a.row(i) {
                let Some((coarse, t)) = row_of(a.cols()[s] as usize) else { continue };
                let at = sums.iter().position(|s| s.0 == coarse).unwrap_or_else(|| {
                    sums.push((coarse, [[0.0; MODES]; F]));
                    sums.len() - 1
                });
                for (sum, a) in sums[at].1.iter_mut().zip(&a.values[s]) {
                    let mut row = *sum;
                    for (a, t) in a.iter().zip(t) {
                        let a = a.to_f64();
                        (0..MODES).for_each(|m| row[m] += a * t[m]);
                    }
                    *sum = row;
                }
            }
            for (coarse, sum) in &mut sums {
                let mut block = [[0.0; MODES]; F];
                for r in 0..F {
                    for c in 0..F {
                        for m in 0..MODES {
                            block[r][m] -= omega * inverse[i][r][c] * sum[c][m];
                        }
                    }
                    if *coarse == own {
                        (0..MODES).for_each(|m| block[r][m] += t[r][m]);
                    }
                }
                p.cols.push(*coarse);
                p.values.push(block);
            }
        }
        p.row_ptr.push(p.cols.len());
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In each aggregate the columns are orthonormal or zero, and times the triangular factor they give the modes back;
    /// a node by itself has no rotation.
    #[test]
    fn the_tentative_prolongation_is_orthonormal() {
        let of_node = [0, 1, 0, NONE, 1, 0, 2];
        let modes: Vec<[[f64; MODES]; 3]> = (0..of_node.len())
            .map(|i| {
                let [x, y, z] = [0.3, 0.7, 1.1].map(|w| (w * (i * i + 1) as f64).sin());
                [[1.0, 0.0, 0.0, 0.0, z, -y], [0.0, 1.0, 0.0, -z, 0.0, x], [0.0, 0.0, 1.0, y, -x, 0.0]]
            })
            .collect();
        let (q, r) = tentative(&of_node, 3, &modes);
        let mut lengths = [[0.0; MODES]; 3];
        for g in 0..3 {
            let nodes = || (0..of_node.len()).filter(|&i| of_node[i] == g as u32);
            for m in 0..MODES {
                for k in 0..=m {
                    let sum: f64 = nodes().flat_map(|i| q[i].map(|row| row[m] * row[k])).sum();
                    if k == m {
                        lengths[g][m] = sum;
                    } else {
                        assert!(sum.abs() < 1e-13, "aggregate {g}: {m} {k} {sum}");
                    }
                }
            }
            for i in nodes() {
                for c in 0..3 {
                    for m in 0..MODES {
                        let back: f64 = (0..MODES).map(|k| q[i][c][k] * r[g][k][m]).sum();
                        assert!((back - modes[i][c][m]).abs() < 1e-13, "node {i}: {back}");
                    }
                }
            }
        }
        // Three nodes know all motions, two all but the turn about their line, one only translations.
        for (lengths, known) in lengths.iter().zip([6.0, 5.0, 3.0]) {
            assert!(lengths.iter().all(|l| *l == 0.0 || (l - 1.0).abs() < 1e-13), "{lengths:?}");
            assert!((lengths.iter().sum::<f64>() - known).abs() < 1e-12, "{lengths:?}");
        }
    }
}
