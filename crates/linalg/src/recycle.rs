//! Initial guesses from past solutions of the same matrix.

use comm::Comm;

use crate::Operator;
use crate::vector::dot;

/// The best guess in the span of past solutions (Fischer, CMAME 163, 1998).
///
/// For a fixed symmetric positive definite matrix the guess $x = \sum_i c_i v_i$ that
/// minimises the energy norm of the error solves the small system
/// $v_i^T A v_j\, c_j = v_i^T b$. The span is that of the latest solution and of the
/// increments between the `depth` solutions before it; stored increments rather than
/// solutions keep the small system well conditioned when solutions change slowly, and a
/// sliding window (no restart) keeps the guess equally good in every solve.
///
/// Memory: `2 (depth + 1)` owned vectors, allocated as solutions arrive.
pub struct Projection {
    comm: Comm,
    depth: usize,
    /// Vector 0 is the latest solution, the others are increments.
    v: Vec<Vec<f64>>,
    av: Vec<Vec<f64>>,
    /// Energies `v_i . A v_j`.
    gram: Vec<Vec<f64>>,
    /// Increment that the next solution replaces.
    oldest: usize,
    product: Vec<f64>,
    sums: Vec<f64>,
}

/// A direction whose energy is reduced below this share by the ones before it adds
/// rounding noise rather than information.
const DEPENDENT: f64 = 1e-11;

impl Projection {
    /// Keeps the latest solution and up to `depth` increments.
    pub fn new(comm: &Comm, depth: usize) -> Self {
        Self {
            comm: comm.clone(),
            depth,
            v: Vec::new(),
            av: Vec::new(),
            gram: vec![vec![0.0; depth + 1]; depth + 1],
            oldest: 1,
            product: Vec::new(),
            sums: vec![0.0; 2 * depth + 2],
        }
    }

    /// Forgets all solutions: call it when the matrix changes.
    pub fn clear(&mut self) {
        self.v.clear();
        self.av.clear();
        self.oldest = 1;
    }

    /// Vectors in the span.
    pub fn len(&self) -> usize {
        self.v.len()
    }

    /// Whether there is no past solution.
    pub fn is_empty(&self) -> bool {
        self.v.is_empty()
    }

    /// Writes the best guess for right-hand side `b` to the owned part of `x`
    /// (left as it is when there is no past solution). Collective.
    pub fn guess(&mut self, b: &[f64], x: &mut [f64]) {
        let k = self.v.len();
        let Some(n) = self.v.first().map(Vec::len) else {
            return;
        };
        for (s, v) in self.sums.iter_mut().zip(&self.v) {
            *s = dot(v, &b[..n]);
        }
        self.comm.sum_slice(&mut self.sums[..k]);
        let c = solve_dropping(&self.gram, &self.sums[..k]);
        let x = &mut x[..n];
        x.fill(0.0);
        for (v, &c) in self.v.iter().zip(&c).filter(|(_, c)| **c != 0.0) {
            for (x, v) in x.iter_mut().zip(v) {
                *x += c * v;
            }
        }
    }

    /// Takes up a solution `x` (`n_local` numbers). One product with `op`. Collective.
    pub fn update(&mut self, op: &dyn Operator, x: &mut [f64]) {
        let n = op.n_owned();
        self.product.resize(n, 0.0);
        op.apply(x, &mut self.product);
        let x = &x[..n];
        let mut changed = 0;
        if self.v.is_empty() {
            self.v.push(x.to_vec());
            self.av.push(self.product.clone());
        } else if self.depth == 0 {
            self.v[0].copy_from_slice(x);
            self.av[0].copy_from_slice(&self.product);
        } else {
            if self.v.len() <= self.depth {
                changed = self.v.len();
                self.v.push(vec![0.0; n]);
                self.av.push(vec![0.0; n]);
            } else {
                changed = self.oldest;
                self.oldest = self.oldest % self.depth + 1;
            }
            for (vectors, new) in [(&mut self.v, x), (&mut self.av, &self.product[..])] {
                let (latest, increments) = vectors.split_at_mut(1);
                for ((d, old), &new) in increments[changed - 1].iter_mut().zip(&mut latest[0]).zip(new) {
                    *d = new - *old;
                    *old = new;
                }
            }
        }
        let k = self.v.len();
        for j in 0..k {
            self.sums[j] = dot(&self.v[0], &self.av[j]);
            self.sums[k + j] = dot(&self.v[changed], &self.av[j]);
        }
        self.comm.sum_slice(&mut self.sums[..2 * k]);
        for j in 0..k {
            for (i, s) in [(0, self.sums[j]), (changed, self.sums[k + j])] {
                self.gram[i][j] = s;
                self.gram[j][i] = s;
            }
        }
    }
}

/// Solves `G c = s` for a positive semidefinite `G` by Cholesky factorisation with
/// diagonal pivoting of the scaled matrix; dependent directions get `c = 0`.
fn solve_dropping(gram: &[Vec<f64>], s: &[f64]) -> Vec<f64> {
    let k = s.len();
    let scale: Vec<f64> =
        (0..k).map(|i| if gram[i][i] > 0.0 { 1.0 / gram[i][i].sqrt() } else { 0.0 }).collect();
    let mut l = vec![vec![0.0; k]; k];
    let mut rest: Vec<f64> = scale.iter().map(|&s| f64::from(u8::from(s > 0.0))).collect();
    let mut order = Vec::new();
    let mut y = Vec::new();
    while let Some(p) = (0..k)
        .filter(|i| !order.contains(i) && rest[*i] > DEPENDENT)
        .max_by(|&a, &b| rest[a].total_cmp(&rest[b]))
    {
        let m = order.len();
        let d = rest[p].sqrt();
        for i in 0..k {
            let mut g = gram[i][p] * scale[i] * scale[p];
            for c in 0..m {
                g -= l[i][c] * l[p][c];
            }
            l[i][m] = g / d;
            rest[i] -= l[i][m] * l[i][m];
        }
        let known: f64 = (0..m).map(|c| l[p][c] * y[c]).sum();
        y.push((s[p] * scale[p] - known) / d);
        order.push(p);
    }
    let mut c = vec![0.0; k];
    for m in (0..order.len()).rev() {
        let known: f64 = (m + 1..order.len()).map(|j| l[order[j]][m] * c[order[j]]).sum();
        c[order[m]] = (y[m] - known) / l[order[m]][m];
    }
    for (c, scale) in c.iter_mut().zip(&scale) {
        *c *= scale;
    }
    c
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::{BlockCsr, BlockJacobi, Cg, KrylovParams};
    use comm::Halo;

    fn line(n: usize) -> BlockCsr<1> {
        let lists: Vec<Vec<u32>> =
            (0..n as u32).map(|i| [i.saturating_sub(1), (i + 1).min(n as u32 - 1)].to_vec()).collect();
        let mut a = BlockCsr::<1>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
        for i in 0..n {
            for s in a.row(i) {
                a.values[s] = [[if a.cols()[s] as usize == i { 2.01 } else { -1.0 }]];
            }
        }
        a
    }

    /// A right-hand side in the span of old ones is answered by the guess alone.
    #[test]
    fn a_combination_of_past_loads_needs_no_iteration() {
        let n = 80;
        let a = line(n);
        let pre: BlockJacobi<1> = BlockJacobi::new(&a).unwrap();
        let comm = Comm::solo();
        let mut cg = Cg::new(&comm);
        let mut projection = Projection::new(&comm, 4);
        let tight = KrylovParams { rel_tol: 1e-12, ..Default::default() };
        let load = |k: f64| -> Vec<f64> { (0..n).map(|i| (k * i as f64 / 9.0).sin()).collect() };
        for k in 1..=3 {
            let mut x = vec![0.0; n];
            cg.solve(&a, &pre, &load(f64::from(k)), &mut x, tight).unwrap();
            projection.update(&a, &mut x);
        }
        let b: Vec<f64> =
            load(1.0).iter().zip(load(2.0)).zip(load(3.0)).map(|((a, b), c)| a - 2.0 * b + 0.3 * c).collect();
        let mut x = vec![7.0; n];
        projection.guess(&b, &mut x);
        let loose = KrylovParams { rel_tol: 1e-8, ..Default::default() };
        assert_eq!(cg.solve(&a, &pre, &b, &mut x, loose).unwrap().iterations, 0);
    }

    /// A smoothly moving load: the warm start saves most iterations and keeps doing so
    /// long after the window has filled.
    #[test]
    fn a_moving_load_is_followed() {
        let n = 200;
        let a = line(n);
        let pre: BlockJacobi<1> = BlockJacobi::new(&a).unwrap();
        let comm = Comm::solo();
        let mut cg = Cg::new(&comm);
        let mut projection = Projection::new(&comm, 6);
        let params = KrylovParams { rel_tol: 1e-6, ..Default::default() };
        let mut x = vec![0.0; n];
        let (mut cold, mut late) = (0, 0);
        for step in 0..40 {
            let centre = 60.0 + 0.5 * f64::from(step);
            let b: Vec<f64> = (0..n).map(|i| (-((i as f64 - centre) / 20.0).powi(2)).exp()).collect();
            projection.guess(&b, &mut x);
            let info = cg.solve(&a, &pre, &b, &mut x, params).unwrap();
            projection.update(&a, &mut x);
            match step {
                0 => cold = info.iterations,
                20.. => late = late.max(info.iterations),
                _ => {}
            }
        }
        assert!(cold > 60 && late * 3 < cold, "cold {cold}, late {late}");
    }

    /// The guess leaves a residual orthogonal to the whole span: the latest solution and the increments before it,
    /// also after the window has moved on and where an increment says nothing new.
    #[test]
    fn the_residual_of_a_guess_is_orthogonal_to_the_span() {
        let (n, depth) = (30, 3);
        let a = line(n);
        let mut projection = Projection::new(&Comm::solo(), depth);
        let vector =
            |k: usize| -> Vec<f64> { (0..n).map(|i| ((i * i + 7 * i * k + k) as f64).sin()).collect() };
        let b = vector(50);
        let mut solutions: Vec<Vec<f64>> = Vec::new();
        for k in 0..9 {
            // The fifth is the one before it once more.
            let mut x = if k == 4 { solutions[3].clone() } else { vector(k) };
            projection.update(&a, &mut x);
            solutions.push(x);
            assert_eq!(projection.len(), solutions.len().min(depth + 1));
            let mut guess = vec![7.0; n];
            projection.guess(&b, &mut guess);
            let mut image = vec![0.0; n];
            a.apply(&mut guess, &mut image);
            let rest: Vec<f64> = b.iter().zip(&image).map(|(b, i)| b - i).collect();
            for old in solutions.iter().rev().take(depth + 1) {
                let along = dot(old, &rest) / (dot(old, old) * dot(&b, &b)).sqrt();
                assert!(along.abs() < 1e-9, "solution {k}: {along}");
            }
        }
    }

    /// A system of full rank, and one whose third direction is a copy: it gets nothing, and the others the answer.
    #[test]
    fn small_systems_are_solved_and_copies_dropped() {
        let gram = [[4.0, 1.0, -0.5], [1.0, 9.0, 0.8], [-0.5, 0.8, 0.25]].map(|r| r.to_vec());
        let exact = [1.5, -2.0, 4.0];
        let s: Vec<f64> = gram.iter().map(|row| row.iter().zip(exact).map(|(g, x)| g * x).sum()).collect();
        let c = solve_dropping(&gram, &s);
        assert!(c.iter().zip(exact).all(|(c, x)| (c - x).abs() < 1e-12), "{c:?}");
        let copied = [[4.0, 1.0, 2.0], [1.0, 9.0, 0.5], [2.0, 0.5, 1.0]].map(|r| r.to_vec());
        let s: Vec<f64> = copied.iter().map(|row| row[0] * 1.5 - row[1] * 2.0).collect();
        let c = solve_dropping(&copied, &s);
        assert!((c[0] + 0.5 * c[2] - 1.5).abs() < 1e-12 && (c[1] + 2.0).abs() < 1e-12, "{c:?}");
        assert!(c.contains(&0.0));
    }
}
