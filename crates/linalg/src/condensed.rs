//! Direct factors across ranks: each rank eliminates its inner rows, all solve for the interface between them.

use std::cell::RefCell;

use crate::block::Real;
use crate::direct::{BlockLu, Part, largest};
use crate::schwarz::overlap::Overlap;
use crate::{BlockCsr, FactorError, Preconditioner};

/// Sparse LU factor of a distributed matrix by substructuring (static condensation), stored in precision `T`.
///
/// The interface $`\Gamma`$ are rows that couple to a row of a rank of a higher number. Without them the rows $`I`$ of different ranks do not couple,
/// and each rank eliminates its own:
///
/// ```math
/// S = \sum_\text{ranks} \left( A_{\Gamma\Gamma} - A_{\Gamma I} A_{II}^{-1} A_{I\Gamma} \right)
/// ```
///
/// (Smith, Bjorstad and Gropp, Domain Decomposition, 1996, chapter 4). Every rank factorises $`S`$, which is sparse: the rows next to one rank
/// couple. So this is a direct solver on any number of ranks, where [`crate::SchwarzLu`] needs iterations; an application sums one vector of the
/// interface over the ranks. That pays as long as $`S`$ is small.
pub struct CondensedLu<const B: usize = 3, T: Real = f32> {
    overlap: Overlap<B>,
    values: Vec<[[f64; B]; B]>,
    /// Rows of the overlap: first those that this rank eliminates, then those of the interface next to it.
    rows: Vec<u32>,
    n_inner: usize,
    inner: BlockLu<B, T>,
    interface: Interface<B, T>,
    /// A vector in the order of `rows`.
    x: RefCell<Vec<f64>>,
}

/// The rows that couple ranks, the same on all of them.
struct Interface<const B: usize, T: Real> {
    part: Part,
    /// Numbers in the interface of the rows next to each rank.
    next_to: Vec<Vec<u32>>,
    /// Where the pairs of these rows, row by row, lie among the values.
    slots: Vec<Vec<usize>>,
    values: Vec<[[f64; B]; B]>,
    lu: BlockLu<B, T>,
    x: RefCell<Vec<f64>>,
}

impl<const B: usize, T: Real> CondensedLu<B, T> {
    /// Plans the factorisation of matrices with the pattern of `a`; call [`CondensedLu::refactor`] before the first use. `None` where the interface
    /// takes more multiplications than the inner rows of any rank. Collective.
    pub fn plan(a: &BlockCsr<B>) -> Option<Self> {
        Self::planned(a, Part::Whole)
    }

    /// As [`CondensedLu::plan`], of half the sum of the matrix and its transpose. Collective.
    pub fn plan_symmetric(a: &BlockCsr<B>) -> Option<Self> {
        Self::planned(a, Part::Symmetric)
    }

    fn planned(a: &BlockCsr<B>, part: Part) -> Option<Self> {
        let overlap = Overlap::new(a, 1);
        let comm = overlap.halo().comm();
        let (n_owned, ids) = (a.n_rows(), overlap.ids());
        let (row_ptr, cols) = overlap.pattern();
        let beyond = comm.all_gather_u64(n_owned as u64)[..=comm.rank()].iter().sum::<u64>();
        let mut shared = vec![0.0; ids.len()];
        for (i, shared) in shared[..n_owned].iter_mut().enumerate() {
            let couples = cols[row_ptr[i]..row_ptr[i + 1]].iter().any(|&j| ids[j as usize] >= beyond);
            *shared = f64::from(u8::from(couples));
        }
        overlap.halo().exchange(&mut shared, 1);
        let shared: Vec<bool> = shared.iter().map(|s| *s > 0.0).collect();
        let mut rows: Vec<u32> = (0..n_owned as u32).filter(|&i| !shared[i as usize]).collect();
        let n_inner = rows.len();
        rows.extend((0..ids.len() as u32).filter(|&i| shared[i as usize]));
        let here: Vec<u64> = rows[n_inner..].iter().map(|&i| ids[i as usize]).collect();
        // Entries between rows of the interface count where their row is owned.
        let counts = |i: u32, j: u32| (i as usize) < n_owned || !shared[j as usize];
        let inner = BlockLu::condensed(row_ptr, cols, &rows, here.len(), counts, part);
        let owned: Vec<u64> =
            ids[..n_owned].iter().zip(&shared).filter(|(_, s)| **s).map(|(g, _)| *g).collect();
        let interface = Interface::plan(&comm.all_gather_var(&owned), &here, comm, part);
        let most = comm.max(inner.flops() as f64);
        let worth = interface.lu.flops() as f64 <= most;
        let x = RefCell::new(vec![0.0; rows.len() * B]);
        worth.then_some(Self { overlap, values: Vec::new(), rows, n_inner, inner, interface, x })
    }

    /// Factorises the present values of `a`, which has the pattern of the planned matrix.
    /// Collective: when one rank fails, all return an error.
    pub fn refactor(&mut self, a: &BlockCsr<B>) -> Result<(), FactorError> {
        let comm = a.halo().comm();
        self.overlap.gather(a, &mut self.values);
        let largest = comm.max(largest(a.values.as_flattened().as_flattened()));
        let result = self.inner.factor_scaled(&self.values, largest).map_err(|e| match e {
            FactorError::Singular { row } => FactorError::Singular { row: self.rows[row] as usize },
            other => other,
        });
        if !comm.all(result.is_ok()) {
            return result.and(Err(FactorError::OtherRank));
        }
        self.interface.refactor(&self.inner, comm).map_err(|e| self.here(comm.rank(), e))
    }

    /// An error of the interface, which names one of its rows, on this rank: its owner names it too.
    fn here(&self, rank: usize, error: FactorError) -> FactorError {
        let FactorError::Singular { row } = error else { return error };
        let place = self.interface.next_to[rank].iter().position(|&i| i as usize == row);
        let local = place.map(|k| self.rows[self.n_inner + k] as usize);
        let owned = local.filter(|&i| i < self.overlap.halo().n_owned());
        owned.map_or(FactorError::OtherRank, |row| FactorError::Singular { row })
    }

    /// Bytes of the factors on this rank.
    pub fn bytes(&self) -> usize {
        self.inner.bytes() + self.interface.lu.bytes()
    }

    /// Multiplications, each with an addition, that a factorisation on this rank needs.
    pub fn flops(&self) -> u64 {
        self.inner.flops() + self.interface.lu.flops()
    }
}

impl<const B: usize, T: Real> Interface<B, T> {
    /// Of the rows `all`, which ascend; `here` are those next to this rank. Collective.
    fn plan(all: &[u64], here: &[u64], comm: &comm::Comm, part: Part) -> Self {
        let place = |g: &u64| all.binary_search(g).expect("a row of the interface") as u32;
        let mine: Vec<u32> = here.iter().map(place).collect();
        let counts = comm.all_gather_u64(mine.len() as u64);
        let gathered = comm.all_gather_var(&mine);
        let mut rest = &gathered[..];
        let mut next_to = Vec::new();
        for n in counts {
            let (list, after) = rest.split_at(n as usize);
            next_to.push(list.to_vec());
            rest = after;
        }
        let mut lists: Vec<Vec<u32>> = (0..all.len() as u32).map(|i| vec![i]).collect();
        for list in &next_to {
            for &i in list {
                let row = &mut lists[i as usize];
                row.extend_from_slice(list);
                row.sort_unstable();
                row.dedup();
            }
        }
        let mut row_ptr = vec![0];
        row_ptr.extend(lists.iter().scan(0, |end, list| {
            *end += list.len();
            Some(*end)
        }));
        let slot =
            |i: u32, j: u32| row_ptr[i as usize] + lists[i as usize].binary_search(&j).expect("a pair");
        let pairs =
            |list: &Vec<u32>| list.iter().flat_map(|&i| list.iter().map(move |&j| slot(i, j))).collect();
        let slots = next_to.iter().map(pairs).collect();
        let cols = lists.concat();
        let rows: Vec<u32> = (0..all.len() as u32).collect();
        let lu = BlockLu::of_rows(&row_ptr, &cols, &rows, part);
        let (values, x) = (vec![[[0.0; B]; B]; cols.len()], RefCell::new(vec![0.0; all.len() * B]));
        Self { part, next_to, slots, values, lu, x }
    }

    /// Adds up what elimination left on each rank and factorises it. Collective.
    fn refactor(&mut self, inner: &BlockLu<B, T>, comm: &comm::Comm) -> Result<(), FactorError> {
        let (n, left) = inner.schur_complement();
        // Columns from their first block to the diagonal one, of a matrix that is not symmetric to the last one.
        let rows = |column: usize| if self.part == Part::Symmetric { column / B * B + B } else { n };
        let mine: Vec<f64> =
            (0..n).flat_map(|c| left[c * n..][..rows(c)].iter().map(|v| v.to_f64())).collect();
        let all = comm.all_gather_var(&mine);
        self.values.fill([[0.0; B]; B]);
        let mut at = all.iter();
        for slots in &self.slots {
            let n = slots.len().isqrt();
            for (j, c) in (0..n).flat_map(|j| (0..B).map(move |c| (j, c))) {
                let last = if self.part == Part::Symmetric { j + 1 } else { n };
                for (i, r) in (0..last).flat_map(|i| (0..B).map(move |r| (i, r))) {
                    let v = *at.next().expect("as many as were sent");
                    if self.part == Part::Whole {
                        self.values[slots[i * n + j]][r][c] += v;
                    } else if i < j || r <= c {
                        // The upper triangle alone is meant.
                        self.values[slots[i * n + j]][r][c] += v;
                        if i < j || r < c {
                            self.values[slots[j * n + i]][c][r] += v;
                        }
                    }
                }
            }
        }
        let unscale = 1.0 / inner.scale();
        self.values.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|v| *v *= unscale);
        self.lu.factor(&self.values)
    }

    /// `x`, what elimination left of the right side next to this rank, becomes the solution there. Collective.
    fn solve(&self, x: &mut [f64], comm: &comm::Comm) {
        let mut all = self.x.borrow_mut();
        all.fill(0.0);
        let x = x.as_chunks_mut::<B>().0;
        let next = &self.next_to[comm.rank()];
        for (&i, x) in next.iter().zip(&*x) {
            all.as_chunks_mut::<B>().0[i as usize] = *x;
        }
        comm.sum_slice(&mut all);
        self.lu.solve(&mut all);
        for (&i, x) in next.iter().zip(x) {
            *x = all.as_chunks::<B>().0[i as usize];
        }
    }
}

impl<const B: usize, T: Real> Preconditioner for CondensedLu<B, T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let n_owned = self.overlap.halo().n_owned();
        let (r, z) = (&r.as_chunks::<B>().0[..n_owned], &mut z.as_chunks_mut::<B>().0[..n_owned]);
        let x = &mut *self.x.borrow_mut();
        for (x, &i) in x.as_chunks_mut::<B>().0.iter_mut().zip(&self.rows) {
            // Each row of the interface counts on the rank that owns it.
            *x = r.get(i as usize).copied().unwrap_or([0.0; B]);
        }
        self.inner.solve_around(x, |left| self.interface.solve(left, self.overlap.halo().comm()));
        for (x, &i) in x.as_chunks::<B>().0.iter().zip(&self.rows) {
            if let Some(z) = z.get_mut(i as usize) {
                *z = *x;
            }
        }
    }
}
