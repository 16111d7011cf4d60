//! A distributed direct solver: subdomains eliminated apart, their borders together.

use std::cell::RefCell;
use std::rc::Rc;

use comm::Halo;

use crate::block::Real;
use crate::direct::BlockLu;
use crate::ghost_rows::starts;
use crate::{BlockCsr, FactorError, Preconditioner};

/// A direct factor across ranks, stored in precision `T`.
///
/// Each rank eliminates its interior nodes; the Schur complements of the border nodes
/// (those that couple to another rank) are gathered and factorised on every rank. It is
/// exact, so GMRES needs one or two iterations at any rank count. Meant for surface meshes
/// on few ranks: the border system, which is the same work on all ranks, has some
/// `2 sqrt(n_nodes)` nodes for each cut. With more ranks or solid meshes [`crate::SchwarzLu`]
/// does less work for more iterations.
pub struct SchurLu<const B: usize = 3, T: Real = f64> {
    halo: Rc<Halo>,
    interior: BlockLu<B, T>,
    /// Slots of `a` among owned rows, in the order of the interior plan.
    slots: Vec<usize>,
    values: Vec<[[f64; B]; B]>,
    /// Slots of `a` between a border node and a ghost, with the place of the block in this
    /// rank's part of the border matrix.
    couplings: Vec<(usize, usize)>,
    /// For each border node its row's length and where the columns of the own border start.
    rows: Vec<(usize, usize)>,
    border: BlockLu<B, f64>,
    /// First border node of this rank among all.
    first: usize,
    buffers: RefCell<Buffers>,
}

#[derive(Default)]
struct Buffers {
    x: Vec<f64>,
    part: Vec<f64>,
}

impl<const B: usize, T: Real> SchurLu<B, T> {
    /// Plans and does the first factorisation. Collective.
    pub fn new(a: &BlockCsr<B>) -> Result<Self, FactorError> {
        let mut this = Self::plan(a);
        this.refactor(a)?;
        Ok(this)
    }

    /// Plans the factorisation of matrices with the pattern of `a`, whose values are not
    /// read: call [`SchurLu::refactor`] before the first use. Collective.
    pub fn plan(a: &BlockCsr<B>) -> Self {
        let halo = a.halo().clone();
        let comm = halo.comm();
        let (n, n_local) = (halo.n_owned(), halo.n_local());

        // Border nodes: they read a ghost, or another rank reads them.
        let mut mark = vec![0.0; n_local];
        mark[n..].fill(1.0);
        halo.accumulate(&mut mark, 1);
        for (i, mark) in mark[..n].iter_mut().enumerate() {
            if a.cols()[a.row(i)].iter().any(|&j| j as usize >= n) {
                *mark = 1.0;
            }
        }
        let kept: Vec<u32> = (0..n as u32).filter(|&i| mark[i as usize] > 0.0).collect();
        let counts = comm.all_gather_u64(kept.len() as u64);
        let first = starts(&counts)[comm.rank()];
        let mut id = vec![0.0; n_local];
        kept.iter().enumerate().for_each(|(k, &i)| id[i as usize] = (first + k as u64) as f64);
        halo.exchange(&mut id, 1);

        let mut row_ptr = vec![0];
        let (mut cols, mut slots) = (Vec::new(), Vec::new());
        for i in 0..n {
            for s in a.row(i).filter(|&s| (a.cols()[s] as usize) < n) {
                cols.push(a.cols()[s]);
                slots.push(s);
            }
            row_ptr.push(cols.len());
        }
        let interior = BlockLu::keeping(&row_ptr, &cols, &kept);

        // Rows of the border matrix: the own border is dense, others couple sparsely.
        let own = first..first + kept.len() as u64;
        let (mut lengths, mut columns) = (Vec::new(), Vec::new());
        let (mut rows, mut couplings) = (Vec::new(), Vec::new());
        for &i in &kept {
            let ghosts = a.row(i as usize).filter(|&s| a.cols()[s] as usize >= n);
            let mut far: Vec<(u64, usize)> = ghosts.map(|s| (id[a.cols()[s] as usize] as u64, s)).collect();
            far.sort_unstable();
            let start = columns.len();
            let before = far.partition_point(|f| f.0 < first);
            columns.extend(far[..before].iter().map(|f| f.0));
            columns.extend(own.clone());
            columns.extend(far[before..].iter().map(|f| f.0));
            for (k, f) in far.iter().enumerate() {
                let shift = if k < before { 0 } else { kept.len() };
                couplings.push((f.1, start + k + shift));
            }
            lengths.push((columns.len() - start) as u64);
            rows.push((start + before, columns.len()));
        }
        let lengths = comm.all_gather_var(&lengths);
        let columns: Vec<u32> = comm.all_gather_var(&columns).iter().map(|&c| c as u32).collect();
        let mut row_ptr: Vec<usize> = starts(&lengths).iter().map(|&s| s as usize).collect();
        row_ptr.push(columns.len());
        let border = BlockLu::new(&row_ptr, &columns);
        let buffers = Buffers { x: vec![0.0; n * B], part: Vec::new() };
        Self {
            halo: halo.clone(),
            interior,
            slots,
            values: Vec::new(),
            couplings,
            rows,
            border,
            first: first as usize,
            buffers: RefCell::new(buffers),
        }
    }

    /// Factorises the present values of `a`, which has the pattern of the planned matrix.
    /// Collective: when one rank fails, all return an error.
    pub fn refactor(&mut self, a: &BlockCsr<B>) -> Result<(), FactorError> {
        let comm = self.halo.comm();
        self.values.clear();
        self.values.extend(self.slots.iter().map(|&s| a.values[s]));
        let result = self.interior.factor(&self.values);
        if !comm.all(result.is_ok()) {
            return result.and(Err(FactorError::OtherRank));
        }
        let schur = self.interior.schur();
        let n = self.rows.len() * B;
        let mut part = vec![[[0.0; B]; B]; self.rows.last().map_or(0, |r| r.1)];
        for (i, &(start, _)) in self.rows.iter().enumerate() {
            for j in 0..self.rows.len() {
                let block = &mut part[start + j];
                for r in 0..B {
                    for c in 0..B {
                        block[r][c] = schur[(j * B + c) * n + i * B + r].to_f64() / self.interior.scale();
                    }
                }
            }
        }
        for &(slot, at) in &self.couplings {
            part[at] = a.values[slot];
        }
        let all = comm.all_gather_var(part.as_flattened().as_flattened());
        // The same matrix on every rank: all succeed or all fail.
        self.border.factor(all.as_chunks::<B>().0.as_chunks::<B>().0).map_err(|_| FactorError::Border)
    }

    /// Bytes of the factors on this rank.
    pub fn bytes(&self) -> usize {
        self.interior.bytes() + self.border.bytes()
    }

    /// Multiplications, each with an addition, that a factorisation on this rank needs.
    pub fn flops(&self) -> u64 {
        self.interior.flops() + self.border.flops()
    }
}

impl<const B: usize, T: Real> Preconditioner for SchurLu<B, T> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let Buffers { x, part } = &mut *self.buffers.borrow_mut();
        let n = x.len();
        x.copy_from_slice(&r[..n]);
        self.interior.solve_around(x, |kept, unit| {
            part.clear();
            part.extend(kept.iter().map(|v| v.to_f64() / unit));
            let mut all = self.halo.comm().all_gather_var(part);
            self.border.solve(&mut all);
            for (k, v) in kept.iter_mut().zip(&all[self.first * B..]) {
                *k = T::from_f64(*v * unit / self.interior.scale());
            }
        });
        z[..n].copy_from_slice(x);
    }
}
