//! Nonlinear GMRES: the best combination of the last corrections.
//!
//! Washio and Oosterlee (1997). On a linear problem it is GMRES preconditioned
//! from the right by whatever made the corrections; on a nonlinear one every
//! residual it uses is a true residual, so no product with a Jacobian is needed.

use comm::Comm;

/// Corrections after which a problem counts as hard: from then on more of them are kept.
const HARD: usize = 12;
/// Maximum number of stored corrections. An impulsive start in a duct that fabric closes took 301 iterations
/// with 5, 83 with 10.
const MOST: usize = 20;

/// Differences of states and residuals of the last corrections.
#[derive(Clone, Debug)]
pub struct NonlinearGmres {
    /// Corrections kept of an easy problem.
    depth: usize,
    /// Corrections of the present problem.
    taken: usize,
    n: usize,
    used: usize,
    next: usize,
    /// `[kept][n]`, single precision.
    states: Vec<Vec<f32>>,
    residuals: Vec<Vec<f32>>,
    last_state: Vec<f64>,
    last_residual: Vec<f32>,
    open: bool,
    /// Products of the residual differences, `[MOST][MOST]`, summed over the ranks.
    products: Vec<f64>,
    gram: Vec<f64>,
}

impl NonlinearGmres {
    /// Combines up to `depth` corrections of vectors of length `n`, in hard problems up to 20.
    pub fn new(depth: usize, n: usize) -> Self {
        let depth = depth.min(MOST);
        Self {
            depth,
            taken: 0,
            n,
            used: 0,
            next: 0,
            states: vec![vec![0.0; n]; depth],
            residuals: vec![vec![0.0; n]; depth],
            last_state: vec![0.0; n],
            last_residual: vec![0.0; if depth > 0 { n } else { 0 }],
            open: false,
            products: vec![0.0; MOST * MOST],
            gram: vec![0.0; MOST * (MOST + 1)],
        }
    }

    /// Removes all corrections.
    pub fn clear(&mut self) {
        self.states.truncate(self.depth);
        self.residuals.truncate(self.depth);
        self.taken = 0;
        self.used = 0;
        self.next = 0;
        self.open = false;
    }

    /// The last state that [`NonlinearGmres::combine`] took in.
    pub fn last(&self) -> &[f64] {
        &self.last_state
    }

    /// Discards the start of the last correction, but keeps the differences: for a
    /// new problem with nearly the same Jacobian.
    pub fn pause(&mut self) {
        self.open = false;
        self.taken = 0;
    }

    /// Takes in the state `q` with its (weighted) residual `r`, then moves both to
    /// the combination with the smallest residual. Collective.
    pub fn combine(&mut self, comm: &Comm, q: &mut [f64], r: &mut [f64]) {
        let _part = timing::part("nonlinear GMRES");
        if self.depth == 0 {
            self.last_state.copy_from_slice(q);
            return;
        }
        self.taken += 1;
        let full = self.used == self.states.len();
        if self.open && full && self.taken > HARD && self.used < MOST {
            self.next = self.used;
            self.states.push(vec![0.0; self.n]);
            self.residuals.push(vec![0.0; self.n]);
        }
        let new = self.open.then_some(self.next);
        if self.open {
            let states = self.states[self.next].iter_mut().zip(&*q).zip(&self.last_state);
            states.for_each(|((s, q), last)| *s = (q - last) as f32);
            let residuals = self.residuals[self.next].iter_mut().zip(&*r).zip(&self.last_residual);
            residuals.for_each(|((t, r), last)| *t = (r - f64::from(*last)) as f32);
            self.next = (self.next + 1) % self.states.len();
            self.used = (self.used + 1).min(self.states.len());
        }
        self.last_state.copy_from_slice(q);
        for (l, r) in self.last_residual.iter_mut().zip(&*r) {
            *l = *r as f32;
        }
        self.open = true;
        let m = self.used;
        if m == 0 {
            return;
        }
        // Only the products with what is new are to be computed.
        let mut sums = [0.0; 64];
        let (with_new, with_r) = sums[..2 * m].split_at_mut(m);
        add_products(&self.residuals[..m], new, r, with_new, with_r);
        comm.sum_slice(&mut sums[..2 * m]);
        if let Some(new) = new {
            for a in 0..m {
                self.products[a * MOST + new] = sums[a];
                self.products[new * MOST + a] = sums[a];
            }
        }
        let gram = &mut self.gram[..m * (m + 1)];
        for a in 0..m {
            gram[a * (m + 1)..][..=a].copy_from_slice(&self.products[a * MOST..][..=a]);
            gram[a * (m + 1) + m] = sums[m + a];
        }
        let mut alpha = [0.0; 32];
        solve_spd(gram, m, &mut alpha);
        add_combination(q, &self.states[..m], &alpha);
        add_combination(r, &self.residuals[..m], &alpha);
    }
}

/// Numbers of a vector that stay in the cache while all columns are combined with them.
const BLOCK: usize = 1024;

/// Adds the inner products of each of the `columns` with the one numbered `new` and with `-r`, block by block, so that each passes memory once.
fn add_products(
    columns: &[Vec<f32>],
    new: Option<usize>,
    r: &[f64],
    with_new: &mut [f64],
    with_r: &mut [f64],
) {
    for (k, r) in r.chunks(BLOCK).enumerate() {
        let block = k * BLOCK..k * BLOCK + r.len();
        for (a, column) in columns.iter().enumerate() {
            let column = &column[block.clone()];
            if let Some(new) = new {
                with_new[a] += dot(column, &columns[new][block.clone()]);
            }
            with_r[a] -= dot_mixed(column, r);
        }
    }
}

/// `x += sum of alpha[a] * columns[a]`, block by block, so that `x` passes memory once.
fn add_combination(x: &mut [f64], columns: &[Vec<f32>], alpha: &[f64; 32]) {
    for (k, x) in x.chunks_mut(BLOCK).enumerate() {
        for (column, &w) in columns.iter().zip(alpha) {
            if w != 0.0 {
                for (x, c) in x.iter_mut().zip(&column[k * BLOCK..]) {
                    *x += w * f64::from(*c);
                }
            }
        }
    }
}

/// Solves the symmetric system stored as lower triangle and right-hand side in
/// rows of `m + 1`; directions that add nothing new get no weight.
fn solve_spd(a: &mut [f64], m: usize, x: &mut [f64; 32]) {
    let w = m + 1;
    let scale: [f64; 32] = std::array::from_fn(|i| if i < m { a[i * w + i].max(1e-300).sqrt() } else { 1.0 });
    for i in 0..m {
        for j in 0..=i {
            a[i * w + j] /= scale[i] * scale[j];
        }
        a[i * w + m] /= scale[i];
    }
    let mut dead = [false; 32];
    for i in 0..m {
        for j in 0..i {
            if dead[j] {
                continue;
            }
            let mut s = a[i * w + j];
            for k in 0..j {
                if !dead[k] {
                    s -= a[i * w + k] * a[j * w + k];
                }
            }
            a[i * w + j] = s / a[j * w + j];
        }
        let mut s = a[i * w + i];
        for k in 0..i {
            if !dead[k] {
                s -= a[i * w + k] * a[i * w + k];
            }
        }
        // Secants are stored in single precision: what is left below this is noise.
        dead[i] = s < 1e-9;
        a[i * w + i] = if dead[i] { 1.0 } else { s.sqrt() };
    }
    for i in 0..m {
        x[i] = 0.0;
        if !dead[i] {
            let s: f64 = (0..i).filter(|&k| !dead[k]).map(|k| a[i * w + k] * x[k]).sum();
            x[i] = (a[i * w + m] - s) / a[i * w + i];
        }
    }
    for i in (0..m).rev() {
        if !dead[i] {
            let s: f64 = (i + 1..m).filter(|&k| !dead[k]).map(|k| a[k * w + i] * x[k]).sum();
            x[i] = (x[i] - s) / a[i * w + i];
        }
    }
    for i in 0..m {
        x[i] /= scale[i];
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut lanes = [0.0f64; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = ca.remainder().iter().zip(cb.remainder()).map(|(a, b)| f64::from(a * b)).sum();
    for (a, b) in ca.zip(cb) {
        for l in 0..8 {
            lanes[l] += f64::from(a[l]) * f64::from(b[l]);
        }
    }
    lanes.iter().sum::<f64>() + rest
}

fn dot_mixed(a: &[f32], b: &[f64]) -> f64 {
    let mut lanes = [0.0f64; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = ca.remainder().iter().zip(cb.remainder()).map(|(a, b)| f64::from(*a) * b).sum();
    for (a, b) in ca.zip(cb) {
        for l in 0..8 {
            lanes[l] += f64::from(a[l]) * b[l];
        }
    }
    lanes.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a linear system with an identity "preconditioner" it must be GMRES:
    /// the residual is zero after as many corrections as there are unknowns.
    #[test]
    fn linear_problem_converges_in_n_steps() {
        let a = [[4.0, 1.0, 0.0], [-1.0, 3.0, 0.5], [0.3, 0.2, 2.0]];
        let b = [1.0, -2.0, 0.5];
        let residual = |q: &[f64]| -> Vec<f64> {
            (0..3).map(|i| (0..3).map(|j| a[i][j] * q[j]).sum::<f64>() - b[i]).collect()
        };
        let comm = Comm::solo();
        let mut nonlinear_gmres = NonlinearGmres::new(4, 3);
        let mut q = vec![0.0; 3];
        for _ in 0..4 {
            let mut r = residual(&q);
            nonlinear_gmres.combine(&comm, &mut q, &mut r);
            for i in 0..3 {
                q[i] -= 0.3 * r[i];
            }
        }
        let mut r = residual(&q);
        nonlinear_gmres.combine(&comm, &mut q, &mut r);
        let end = residual(&q).iter().map(|x| x.abs()).fold(0.0, f64::max);
        assert!(end < 1e-6, "{end}");
    }

    /// Eight lanes and what is left over.
    #[test]
    fn inner_products_are_exact_for_any_length() {
        for n in [0, 1, 7, 8, 9, 16, 29] {
            let a: Vec<f32> = (0..n).map(|i| 1.0 + i as f32).collect();
            let b: Vec<f32> = (0..n).map(|i| 2.0 - 0.5 * i as f32).collect();
            let exact: f64 = (0..n).map(f64::from).map(|i| (1.0 + i) * (2.0 - 0.5 * i)).sum();
            assert_eq!(dot(&a, &b), exact, "{n}");
            assert_eq!(dot_mixed(&a, &b.iter().map(|b| f64::from(*b)).collect::<Vec<_>>()), exact, "{n}");
        }
    }

    /// More than one block, the last one incomplete.
    #[test]
    fn products_of_columns_are_those_of_whole_vectors() {
        let n = 2 * BLOCK as i32 + 37;
        let column = |a: i32| -> Vec<f32> { (0..n).map(|i| ((i * (a + 3)) % 17 - 8) as f32).collect() };
        let columns = [column(0), column(1), column(2)];
        let r: Vec<f64> = (0..n).map(|i| f64::from((7 * i) % 13 - 6)).collect();
        let (mut with_new, mut with_r) = ([0.0; 3], [0.0; 3]);
        add_products(&columns, Some(1), &r, &mut with_new, &mut with_r);
        // Sums of integers are exact.
        for a in 0..3 {
            assert_eq!(
                (with_new[a], with_r[a]),
                (dot(&columns[a], &columns[1]), -dot_mixed(&columns[a], &r))
            );
        }
    }

    /// What it leaves is the smallest residual that the kept corrections can make: orthogonal to each difference
    /// of residuals. State and residual stay those of one linear problem.
    #[test]
    fn residual_is_orthogonal_to_all_differences() {
        let n = 40;
        let (comm, mut seed) = (Comm::solo(), 1u64);
        let mut noise = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let a: Vec<f64> = (0..n * n).map(|k| noise() + if k % (n + 1) == 0 { 12.0 } else { 0.0 }).collect();
        let b: Vec<f64> = (0..n).map(|_| noise()).collect();
        let residual = |q: &[f64]| -> Vec<f64> {
            (0..n).map(|i| (0..n).map(|j| a[i * n + j] * q[j]).sum::<f64>() - b[i]).collect()
        };
        let mut nonlinear_gmres = NonlinearGmres::new(5, n);
        let mut q = vec![0.0; n];
        for step in 0..18 {
            let mut r = residual(&q);
            nonlinear_gmres.combine(&comm, &mut q, &mut r);
            let size = r.iter().map(|x| x * x).sum::<f64>().sqrt();
            let exact = residual(&q);
            let off = r.iter().zip(&exact).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            assert!(off < 1e-5 * size.max(1e-3), "step {step}: {off} of {size}");
            assert_eq!(nonlinear_gmres.used, step.min(if step < HARD { 5 } else { 5 + step + 1 - HARD }));
            for kept in &nonlinear_gmres.residuals[..nonlinear_gmres.used] {
                let length = dot(kept, kept).sqrt();
                let along = dot_mixed(kept, &r) / length;
                assert!(along.abs() < 1e-4 * size, "step {step}: {along} of {size}");
            }
            // Crude corrections that differ from each other.
            for i in 0..n {
                q[i] -= (0.05 + 0.02 * noise()) * r[i];
            }
        }
    }

    /// A symmetric system with its solution, in which one direction is twice the same and gets no weight of its own.
    #[test]
    fn small_systems_are_solved_and_dependent_columns_filtered() {
        let rows =
            [[4.0, 1.0, -0.5, 0.3], [1.0, 3.0, 0.8, -0.2], [-0.5, 0.8, 50.0, 2.0], [0.3, -0.2, 2.0, 0.4]];
        let exact = [1.5, -2.0, 0.25, 3.0];
        let m = 4;
        let mut a = vec![0.0; m * (m + 1)];
        for i in 0..m {
            a[i * (m + 1)..][..=i].copy_from_slice(&rows[i][..=i]);
            a[i * (m + 1) + m] = (0..m).map(|j| rows[i][j] * exact[j]).sum();
        }
        let mut x = [0.0; 32];
        solve_spd(&mut a, m, &mut x);
        (0..m).for_each(|i| assert!((x[i] - exact[i]).abs() < 1e-12, "{x:?}"));
        // Columns u, v, 2 u + v of which the third says nothing new: the first two have the answer.
        let (u, v, b) = ([1.0, 2.0, 0.5], [0.3, -1.0, 2.0], [2.0, 1.0, -1.0]);
        let w: [f64; 3] = std::array::from_fn(|k| 2.0 * u[k] + v[k]);
        let z = [0.1, 0.9, 0.4];
        let columns = [u, v, w, z];
        let product = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        let mut a = vec![0.0; m * (m + 1)];
        for i in 0..m {
            (0..=i).for_each(|j| a[i * (m + 1) + j] = product(&columns[i], &columns[j]));
            a[i * (m + 1) + m] = product(&columns[i], &b);
        }
        solve_spd(&mut a, m, &mut x);
        assert_eq!(x[2], 0.0);
        for k in 0..3 {
            let sum: f64 = (0..m).map(|i| x[i] * columns[i][k]).sum();
            assert!((sum - b[k]).abs() < 1e-10, "{x:?}");
        }
    }
}
