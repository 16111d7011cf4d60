//! Initial guesses by projection on past solutions (warm start).

use comm::Comm;

/// A basis of past solutions, orthonormal in the energy norm of one fixed matrix A (P. F. Fischer, Comput. Methods
/// Appl. Mech. Engrg. 163, 1998).
///
/// The guess for a right-hand side b is its Galerkin solution in the basis, $`\sum_i (v_i \cdot b)\, v_i`$: a linear
/// function of b alone, so the same motion gets the same guess, and no motion gets zero. Extrapolations of past
/// solutions in time are in their span.
///
/// Vectors are stored in `f32`: the iterations correct the error of the guess.
pub struct SolutionProjection {
    /// The basis, followed by vectors allocated for later ones: no allocation during the solves.
    basis: Vec<Vec<f32>>,
    /// Motion of the canopy of each basis vector.
    canopies: Vec<Vec<f64>>,
    /// Number of basis vectors.
    known: usize,
    /// Coefficient of each basis vector in the latest solution.
    shares: Vec<f64>,
}

/// Largest number of basis vectors: reading them costs about as much as a product with the matrix. Twice as many
/// saved no iteration in a coupled ATPS descent (about 13 in the 11 to 17 solves of a window, most of them in the
/// first five).
const CAPACITY: usize = 24;

impl SolutionProjection {
    /// An empty basis for vectors of `n` numbers and motions of `n_canopy` numbers.
    pub fn new(n: usize, n_canopy: usize) -> Self {
        Self {
            basis: vec![vec![0.0; n]; CAPACITY],
            canopies: vec![vec![0.0; n_canopy]; CAPACITY],
            known: 0,
            shares: Vec::with_capacity(CAPACITY + 1),
        }
    }

    /// Basis, and the motion of the canopy of each vector.
    pub fn save_state(&self) -> (Vec<Vec<f32>>, Vec<Vec<f64>>) {
        (self.basis[..self.known].to_vec(), self.canopies[..self.known].to_vec())
    }

    /// Restores a [`SolutionProjection::save_state`] of the same matrix, into an empty basis.
    ///
    /// # Errors
    /// Data that do not match; the basis is unchanged then.
    pub fn restore_state(&mut self, basis: &[Vec<f32>], canopies: &[Vec<f64>]) -> Result<(), String> {
        let (n, n_canopy) = (self.basis[0].len(), self.canopies[0].len());
        let fits = basis.iter().all(|v| v.len() == n) && canopies.iter().all(|k| k.len() == n_canopy);
        if basis.len() > CAPACITY || basis.len() != canopies.len() || !fits {
            return Err("its past solutions belong to another grid or canopy".into());
        }
        self.known = basis.len();
        self.basis.iter_mut().zip(basis).for_each(|(v, kept)| v.copy_from_slice(kept));
        self.canopies.iter_mut().zip(canopies).for_each(|(k, kept)| k.copy_from_slice(kept));
        Ok(())
    }

    /// Sets `x` to the guess for `b` (owned parts), and subtracts from `canopy`, the motion that causes `b`, the part
    /// in the span of the basis. Collective.
    pub fn guess(&mut self, comm: &Comm, b: &[f64], x: &mut [f64], canopy: &mut [f64]) {
        let mut c = [0.0; CAPACITY];
        let c = &mut c[..self.known];
        for (c, v) in c.iter_mut().zip(&self.basis) {
            *c = dot(v, b);
        }
        comm.sum_slice(c);
        x.fill(0.0);
        for ((c, v), known) in c.iter().zip(&self.basis).zip(&self.canopies) {
            axpy(*c, v, x);
            canopy.iter_mut().zip(known).for_each(|(d, k)| *d -= c * k);
        }
        self.shares.clear();
        self.shares.extend_from_slice(c);
    }

    /// Adds the correction `d` to the last guess to the basis; `ad` is A d, `canopy` its motion of the canopy. Both
    /// `d` and `canopy` are overwritten. Collective.
    pub fn add_solution(&mut self, comm: &Comm, d: &mut [f64], ad: &[f64], canopy: &mut [f64]) {
        let m = self.known;
        let mut c = [0.0; CAPACITY + 1];
        for (c, v) in c[..m].iter_mut().zip(&self.basis) {
            *c = dot(v, ad);
        }
        c[m] = d.iter().zip(ad).map(|(a, b)| a * b).sum();
        comm.sum_slice(&mut c[..=m]);
        let energy = c[m];
        let rest = energy - c[..m].iter().map(|c| c * c).sum::<f64>();
        for (s, c) in self.shares.iter_mut().zip(&c[..m]) {
            *s += c;
        }
        // Below this fraction of its energy the new direction is round-off of `f32`.
        if rest.is_nan() || rest <= 1e-10 * energy {
            return;
        }
        for ((c, v), known) in c[..m].iter().zip(&self.basis).zip(&self.canopies) {
            axpy(-c, v, d);
            canopy.iter_mut().zip(known).for_each(|(d, k)| *d -= c * k);
        }
        if m == CAPACITY {
            self.merge();
        }
        let norm = rest.sqrt();
        let at = self.known;
        self.basis[at].iter_mut().zip(&*d).for_each(|(v, d)| *v = (d / norm) as f32);
        self.canopies[at].iter_mut().zip(&*canopy).for_each(|(known, k)| *known = k / norm);
        self.shares.push(norm);
        self.known += 1;
    }

    /// Replaces the older half by its linear combination in the latest solution, which keeps the basis orthonormal
    /// and that solution in its span.
    fn merge(&mut self) {
        let old = CAPACITY / 2;
        let norm = self.shares[..old].iter().map(|s| s * s).sum::<f64>().sqrt();
        let kept = usize::from(norm > 0.0);
        if kept > 0 {
            let shares = &self.shares[..old];
            let (first, rest) = self.basis.split_first_mut().expect("a capacity above zero");
            let scale = (shares[0] / norm) as f32;
            first.iter_mut().for_each(|v| *v *= scale);
            for (v, s) in rest.iter().zip(&shares[1..]) {
                let s = (s / norm) as f32;
                first.iter_mut().zip(v).for_each(|(a, b)| *a += s * b);
            }
            let (sum, rest) = self.canopies.split_first_mut().expect("as many as vectors");
            sum.iter_mut().for_each(|k| *k *= shares[0] / norm);
            for (k, s) in rest.iter().zip(&shares[1..]) {
                sum.iter_mut().zip(k).for_each(|(a, b)| *a += s / norm * b);
            }
            self.shares[0] = norm;
        }
        self.basis[kept..].rotate_left(old - kept);
        self.canopies[kept..].rotate_left(old - kept);
        self.shares.drain(kept..old);
        self.known -= old - kept;
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.basis.iter().map(|v| 4 * v.len()).sum::<usize>()
            + self.canopies.iter().map(|k| 8 * k.len()).sum::<usize>()
    }
}

fn dot(v: &[f32], b: &[f64]) -> f64 {
    const L: usize = 8;
    let (vs, vr) = v.as_chunks::<L>();
    let (bs, br) = b.as_chunks::<L>();
    let mut acc = [0.0; L];
    for (v, b) in vs.iter().zip(bs) {
        for l in 0..L {
            acc[l] += f64::from(v[l]) * b[l];
        }
    }
    acc.iter().sum::<f64>() + vr.iter().zip(br).map(|(v, b)| f64::from(*v) * b).sum::<f64>()
}

fn axpy(c: f64, v: &[f32], x: &mut [f64]) {
    for (x, v) in x.iter_mut().zip(v) {
        *x += c * f64::from(*v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diagonal matrix, motions in a space of 8 dimensions.
    #[test]
    fn guess_is_accurate_after_all_motions_were_added() {
        let comm = Comm::solo();
        let n = 50;
        let a: Vec<f64> = (0..n).map(|i| 1.0 + i as f64).collect();
        let wave = |k: usize, i: usize| ((k + 1) as f64 * 0.37 * i as f64).sin();
        let mut warm_start_basis = SolutionProjection::new(n, n);
        let (mut x, mut first, mut late) = (vec![0.0; n], 0.0f64, 0.0f64);
        for step in 0..100 {
            let b: Vec<f64> = (0..n)
                .map(|i| (0..8).map(|k| wave(k, i) * (0.3 * step as f64 + k as f64).sin()).sum())
                .collect();
            let mut displacement = b.clone();
            warm_start_basis.guess(&comm, &b, &mut x, &mut displacement);
            let exact: Vec<f64> = b.iter().zip(&a).map(|(b, a)| b / a).collect();
            let mut d: Vec<f64> = exact.iter().zip(&x).map(|(e, x)| e - x).collect();
            let max_error = d.iter().map(|v| v * v).sum::<f64>().sqrt();
            let size = exact.iter().map(|v| v * v).sum::<f64>().sqrt();
            if step == 0 {
                first = max_error / size;
            } else if step >= 8 {
                late = late.max(max_error / size);
            }
            let ad: Vec<f64> = d.iter().zip(&a).map(|(d, a)| d * a).collect();
            warm_start_basis.add_solution(&comm, &mut d, &ad, &mut displacement);
            assert!(warm_start_basis.known <= CAPACITY);
        }
        assert_eq!(first, 1.0);
        assert!(late < 1e-5, "all motions are known after 8 steps: {late}");
        warm_start_basis.guess(&comm, &vec![0.0; n], &mut x, &mut []);
        assert!(x.iter().all(|&v| v == 0.0));
    }

    #[test]
    fn merge_keeps_the_latest_solution_in_the_span() {
        let comm = Comm::solo();
        let n = 200;
        let mut warm_start_basis = SolutionProjection::new(n, n);
        let mut x = vec![0.0; n];
        // Unit matrix; each step adds one new direction to all earlier ones.
        let b = |step: usize| -> Vec<f64> {
            (0..n).map(|i| (0..=step).map(|k| ((7 * k + 3) as f64 * (i + 1) as f64).sin()).sum()).collect()
        };
        for step in 0..60 {
            let b = b(step);
            let mut displacement = b.clone();
            warm_start_basis.guess(&comm, &b, &mut x, &mut displacement);
            let mut d: Vec<f64> = b.iter().zip(&x).map(|(b, x)| b - x).collect();
            let ad = d.clone();
            warm_start_basis.add_solution(&comm, &mut d, &ad, &mut displacement);
            let mut displacement = b.clone();
            warm_start_basis.guess(&comm, &b, &mut x, &mut displacement);
            // With the unit matrix the motion of the canopy equals the guess.
            let max_difference =
                b.iter().zip(&x).zip(&displacement).map(|((b, x), p)| (b - x - p).abs()).fold(0.0, f64::max);
            assert!(max_difference < 1e-4, "step {step}: {max_difference}");
            let max_error: f64 = b.iter().zip(&x).map(|(b, x)| (b - x).abs()).fold(0.0, f64::max);
            assert!(max_error < 1e-4, "step {step}: {max_error}");
        }
    }
}
