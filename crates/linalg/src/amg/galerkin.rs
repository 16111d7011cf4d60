//! The coarse matrix $P^T A P$, rows distributed like the coarse nodes.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use comm::{Halo, Numbering};

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
    let here = first[comm.rank()];
    let n = a.n_rows();

    // Prolongation rows of the ghosts, behind those of the owned nodes.
    let lists = ghosts.fetch_u64(|i, list| {
        let row = p.row_ptr[i]..p.row_ptr[i + 1];
        list.push(row.len() as u64);
        list.extend_from_slice(&p.cols[row]);
    });
    let blocks = ghosts.fetch_f64(|i, list| {
        list.extend(p.values[p.row_ptr[i]..p.row_ptr[i + 1]].iter().flatten().flatten());
    });
    // Coarse nodes get temporary local indices: owned ones first.
    let mut global: Vec<u64> = (here..here + count as u64).collect();
    let mut index: HashMap<u64, u32> = HashMap::new();
    let mut local = |g: u64| {
        if (here..here + count as u64).contains(&g) {
            return (g - here) as u32;
        }
        *index.entry(g).or_insert_with(|| {
            global.push(g);
            global.len() as u32 - 1
        })
    };
    let mut row_ptr = p.row_ptr.clone();
    let mut cols: Vec<u32> = p.cols.iter().map(|&g| local(g)).collect();
    let mut at = 0;
    while at < lists.len() {
        let k = lists[at] as usize;
        cols.extend(lists[at + 1..at + 1 + k].iter().map(|&g| local(g)));
        row_ptr.push(cols.len());
        at += k + 1;
    }
    let fetched = blocks.as_chunks::<MODES>().0.as_chunks::<F>().0;
    let row_values = |j: usize| {
        let row = row_ptr[j]..row_ptr[j + 1];
        let owned = p.values.len();
        if j < n { &p.values[row] } else { &fetched[row.start - owned..row.end - owned] }
    };

    let mut sums = Accumulator { rows: vec![Vec::new(); global.len()], blocks: Vec::new() };
    let mut place = vec![u32::MAX; global.len()];
    let mut ap: Vec<(u32, [[f64; MODES]; F])> = Vec::new();
    for i in 0..n {
        let own = row_ptr[i]..row_ptr[i + 1];
        if own.is_empty() {
            continue;
        }
        ap.clear();
        for s in a.row(i) {
            let j = a.cols()[s] as usize;
            let block = &a.values[s];
            for (&col, pj) in cols[row_ptr[j]..row_ptr[j + 1]].iter().zip(row_values(j)) {
                let at = &mut place[col as usize];
                if *at == u32::MAX {
                    *at = ap.len() as u32;
                    ap.push((col, [[0.0; MODES]; F]));
                }
                let sum = &mut ap[*at as usize].1;
                for r in 0..F {
                    for c in 0..F {
                        for m in 0..MODES {
                            sum[r][m] = block[r][c].to_f64().fused(pj[c][m], sum[r][m]);
                        }
                    }
                }
            }
        }
        for (&row, pi) in cols[own.clone()].iter().zip(&p.values[own]) {
            for (col, product) in &ap {
                let sum = sums.block(row as usize, *col);
                for f in 0..F {
                    for m in 0..MODES {
                        for k in 0..MODES {
                            sum[m][k] = pi[f][m].fused(product[f][k], sum[m][k]);
                        }
                    }
                }
            }
        }
        ap.iter().for_each(|(col, _)| place[*col as usize] = u32::MAX);
    }

    // Rows that belong to other ranks travel to their owners.
    let mut ids = vec![Vec::new(); comm.size()];
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); comm.size()];
    for row in count..global.len() {
        let to = owner(first, global[row]);
        for &(col, at) in &sums.rows[row] {
            ids[to].extend([global[row], global[col as usize]]);
            values[to].extend(sums.blocks[at as usize].as_flattened());
        }
    }
    let ids = comm.all_to_all_var(&ids).concat();
    let values = comm.all_to_all_var(&values).concat();
    let mut local = |g: u64| {
        if (here..here + count as u64).contains(&g) {
            return (g - here) as u32;
        }
        *index.entry(g).or_insert_with(|| {
            global.push(g);
            global.len() as u32 - 1
        })
    };
    let incoming = values.as_chunks::<MODES>().0.as_chunks::<MODES>().0;
    for (pair, block) in ids.as_chunks::<2>().0.iter().zip(incoming) {
        let col = local(pair[1]);
        let sum = sums.block((pair[0] - here) as usize, col);
        for m in 0..MODES {
            (0..MODES).for_each(|k| sum[m][k] += block[m][k]);
        }
    }
    sums.rows.truncate(count);
    cols.truncate(p.cols.len());
    finish(a, p, sums, &cols, &global, count, first)
}

/// Numbers the coarse nodes for good and makes the matrix and the prolongation.
fn finish<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    p: CoarseRows<F>,
    mut sums: Accumulator,
    p_cols: &[u32],
    global: &[u64],
    count: usize,
    first: &[u64],
) -> (BlockCsr<MODES>, Prolongation<F, f64>) {
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
