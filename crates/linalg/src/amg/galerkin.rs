//! The coarse matrix $`P^T A P`$, rows distributed like the coarse nodes.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use comm::{Comm, Halo, Numbering};

use super::MODES;
use super::prolongation::Prolongation;
use crate::BlockCsr;
use crate::block::Real;
use crate::ghost_rows::{GhostRows, owner};

/// Block rows with global coarse columns.
pub(super) struct CoarseRows<const F: usize> {
    pub row_ptr: Vec<usize>,
    pub cols: Vec<u64>,
    pub values: Vec<[[f64; MODES]; F]>,
}

impl<const F: usize> Default for CoarseRows<F> {
    fn default() -> Self {
        Self { row_ptr: vec![0], cols: Vec::new(), values: Vec::new() }
    }
}

type Block = [[f64; MODES]; MODES];

/// Coarse matrix rows under construction: sorted columns with places in `blocks`.
struct Accumulator {
    rows: Vec<Vec<(u32, u32)>>,
    blocks: Vec<Block>,
}

impl Accumulator {
    fn block(&mut self, row: usize, col: u32) -> &mut Block {
        let list = &mut self.rows[row];
        let place = match list.binary_search_by_key(&col, |e| e.0) {
            Ok(k) => list[k].1,
            Err(k) => {
                let place = self.blocks.len() as u32;
                list.insert(k, (col, place));
                self.blocks.push([[0.0; MODES]; MODES]);
                place
            }
        };
        &mut self.blocks[place as usize]
    }
}

/// Projects `a` with the owned rows `p` of the prolongation; this rank owns the coarse
/// nodes `first[rank]..` (`count` of them). Collective.
pub(super) fn galerkin<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    ghosts: &GhostRows,
    p: CoarseRows<F>,
    count: usize,
    first: &[u64],
) -> (BlockCsr<MODES>, Prolongation<F, f64>) {
    let comm = a.halo().comm();
    let mut coarse = CoarseNodes::new(first[comm.rank()], count);
    let rows = LocalRows::new(ghosts, &p, &mut coarse);
    let mut sums = triple_product(a, &p, &rows, coarse.global.len());
    exchange_rows(comm, first, &mut coarse, &mut sums);
    sums.rows.truncate(count);
    let mut cols = rows.cols;
    cols.truncate(p.cols.len());
    finish(a, p, sums, &cols, &coarse.global, first)
}

/// Coarse nodes in the order in which this rank meets them: owned ones first.
struct CoarseNodes {
    /// First owned node, and how many.
    here: u64,
    count: usize,
    /// Global index of each node.
    global: Vec<u64>,
    /// Local index of the others.
    index: HashMap<u64, u32>,
}

impl CoarseNodes {
    fn new(here: u64, count: usize) -> Self {
        Self { here, count, global: (here..here + count as u64).collect(), index: HashMap::new() }
    }

    /// Temporary local index of a global node.
    fn local(&mut self, g: u64) -> u32 {
        if (self.here..self.here + self.count as u64).contains(&g) {
            return (g - self.here) as u32;
        }
        *self.index.entry(g).or_insert_with(|| {
            self.global.push(g);
            self.global.len() as u32 - 1
        })
    }
}

/// Rows of the prolongation of owned nodes and, behind them, of ghosts.
struct LocalRows<const F: usize> {
    row_ptr: Vec<usize>,
    /// Local coarse nodes.
    cols: Vec<u32>,
    /// Values of the ghosts' rows, flat.
    fetched: Vec<f64>,
}

impl<const F: usize> LocalRows<F> {
    /// Fetches the rows of the ghosts. Collective.
    fn new(ghosts: &GhostRows, p: &CoarseRows<F>, coarse: &mut CoarseNodes) -> Self {
        let lists = ghosts.fetch_u64(|i, list| {
            let row = p.row_ptr[i]..p.row_ptr[i + 1];
            list.push(row.len() as u64);
            list.extend_from_slice(&p.cols[row]);
        });
        let fetched = ghosts.fetch_f64(|i, list| {
            list.extend(p.values[p.row_ptr[i]..p.row_ptr[i + 1]].iter().flatten().flatten());
        });
        let mut row_ptr = p.row_ptr.clone();
        let mut cols: Vec<u32> = p.cols.iter().map(|&g| coarse.local(g)).collect();
        let mut at = 0;
        while at < lists.len() {
            let k = lists[at] as usize;
            cols.extend(lists[at + 1..at + 1 + k].iter().map(|&g| coarse.local(g)));
            row_ptr.push(cols.len());
            at += k + 1;
        }
        Self { row_ptr, cols, fetched }
    }

    /// Coarse nodes and blocks of the row of local node `j`; `p` holds those of owned nodes.
    fn row<'a>(&'a self, p: &'a CoarseRows<F>, j: usize) -> (&'a [u32], &'a [[[f64; MODES]; F]]) {
        let row = self.row_ptr[j]..self.row_ptr[j + 1];
        let owned = p.values.len();
        let values = if row.start < owned || row.is_empty() {
            &p.values[row.start.min(owned)..row.end.min(owned)]
        } else {
            &self.fetched.as_chunks::<MODES>().0.as_chunks::<F>().0[row.start - owned..row.end - owned]
        };
        (&self.cols[row], values)
    }
}

/// $`P^T A P`$ of the owned rows of `a`, on `n_coarse` local coarse nodes.
fn triple_product<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    p: &CoarseRows<F>,
    rows: &LocalRows<F>,
    n_coarse: usize,
) -> Accumulator {
    let mut sums = Accumulator { rows: vec![Vec::new(); n_coarse], blocks: Vec::new() };
    let mut place = vec![u32::MAX; n_coarse];
    let mut ap: Vec<(u32, [[f64; MODES]; F])> = Vec::new();
    for i in 0..a.n_rows() {
        let (own, own_values) = rows.row(p, i);
        if own.is_empty() {
            continue;
        }
        ap.clear();
        for s in a.row(i) {
            let j = a.cols()[s] as usize;
            let block = a.values[s].map(|row| row.map(S::to_f64));
            let (cols, values) = rows.row(p, j);
            for (&col, pj) in cols.iter().zip(values) {
                let at = &mut place[col as usize];
                if *at == u32::MAX {
                    *at = ap.len() as u32;
                    ap.push((col, [[0.0; MODES]; F]));
                }
                add_product(&mut ap[*at as usize].1, &block, pj);
            }
        }
        for (&row, pi) in own.iter().zip(own_values) {
            for (col, product) in &ap {
                add_transposed_product(sums.block(row as usize, *col), pi, product);
            }
        }
        ap.iter().for_each(|(col, _)| place[*col as usize] = u32::MAX);
    }

    sums
}

/// `sum += a b`, row by row, which stay in registers.
#[inline(always)]
fn add_product<const F: usize>(sum: &mut [[f64; MODES]; F], a: &[[f64; F]; F], b: &[[f64; MODES]; F]) {
    for (sum, a) in sum.iter_mut().zip(a) {
        let mut row = *sum;
        for (a, b) in a.iter().zip(b) {
            for m in 0..MODES {
                row[m] = a.fused(b[m], row[m]);
            }
        }
        *sum = row;
    }
}

/// `sum += a^T b`, also in vectors.
#[inline(always)]
fn add_transposed_product<const F: usize>(sum: &mut Block, a: &[[f64; MODES]; F], b: &[[f64; MODES]; F]) {
    for (m, sum) in sum.iter_mut().enumerate() {
        let mut row = *sum;
        for (a, b) in a.iter().zip(b) {
            for k in 0..MODES {
                row[k] = a[m].fused(b[k], row[k]);
            }
        }
        *sum = row;
    }
}

/// Rows that belong to other ranks travel to their owners, who add them. Collective.
fn exchange_rows(comm: &Comm, first: &[u64], coarse: &mut CoarseNodes, sums: &mut Accumulator) {
    let mut ids = vec![Vec::new(); comm.size()];
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); comm.size()];
    let global = &coarse.global;
    for row in coarse.count..global.len() {
        let to = owner(first, global[row]);
        for &(col, at) in &sums.rows[row] {
            ids[to].extend([global[row], global[col as usize]]);
            values[to].extend(sums.blocks[at as usize].as_flattened());
        }
    }
    let ids = comm.all_to_all_var(&ids).concat();
    let values = comm.all_to_all_var(&values).concat();
    let incoming = values.as_chunks::<MODES>().0.as_chunks::<MODES>().0;
    for (pair, block) in ids.as_chunks::<2>().0.iter().zip(incoming) {
        let col = coarse.local(pair[1]);
        let sum = sums.block((pair[0] - coarse.here) as usize, col);
        for m in 0..MODES {
            (0..MODES).for_each(|k| sum[m][k] += block[m][k]);
        }
    }
}

/// Numbers the coarse nodes for good and makes the matrix and the prolongation.
fn finish<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    p: CoarseRows<F>,
    mut sums: Accumulator,
    p_cols: &[u32],
    global: &[u64],
    first: &[u64],
) -> (BlockCsr<MODES>, Prolongation<F, f64>) {
    let count = sums.rows.len();
    let used = sums.rows.iter().flatten().map(|e| e.0).chain(p_cols.iter().copied());
    let ghosts: BTreeSet<u64> = used.filter(|&c| c as usize >= count).map(|c| global[c as usize]).collect();
    let ghosts = ghosts.into_iter().map(|g| (g, owner(first, g) as u32)).collect();
    let numbering = Numbering::new(global[..count].to_vec(), ghosts);
    let halo = Rc::new(Halo::new(a.halo().comm(), &numbering));
    let local = |c: u32| {
        let known = numbering.local(global[c as usize]);
        known.expect("every used coarse node is numbered") as u32
    };

    let mut row_ptr = vec![0];
    let mut entries: Vec<(u32, u32)> = Vec::new();
    for row in &sums.rows {
        let start = entries.len();
        entries.extend(row.iter().map(|&(c, at)| (local(c), at)));
        entries[start..].sort_unstable();
        row_ptr.push(entries.len());
    }
    sums.rows = Vec::new();
    let mut coarse = BlockCsr::new(halo.clone(), row_ptr, entries.iter().map(|e| e.0).collect());
    // In place: two copies of a large matrix would be the most memory that a set-up takes.
    for k in 0..entries.len() {
        let mut from = entries[k].1 as usize;
        while from < k {
            // What was there has been swapped on.
            from = entries[from].1 as usize;
        }
        sums.blocks.swap(k, from);
    }
    sums.blocks.truncate(entries.len());
    coarse.values = sums.blocks;
    // A mode that its aggregate does not have left an empty row: any diagonal will do.
    for i in 0..count {
        let s = coarse.diagonal_slot(i);
        let largest = (0..MODES).map(|m| coarse.values[s][m][m]).fold(0.0, f64::max);
        for m in 0..MODES {
            if coarse.values[s][m][m] <= 1e-14 * largest {
                coarse.values[s][m][m] = if largest > 0.0 { largest } else { 1.0 };
            }
        }
    }
    let p = Prolongation {
        coarse: halo,
        row_ptr: p.row_ptr,
        cols: p_cols.iter().map(|&c| local(c)).collect(),
        values: p.values,
    };
    (coarse, p)
}
