//! Elimination order, supernodes and assembly maps of a multifrontal factorisation,
//! worked out once for a pattern of block rows.

use faer::perm::PermRef;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};

/// A dense front: the rows that one supernode eliminates and those it updates.
pub(super) struct Front {
    /// First eliminated block row, in elimination order.
    pub start: usize,
    /// Eliminated block rows.
    pub n_pivot: usize,
    /// Updated block rows, in elimination order, ascending.
    pub pattern: Vec<u32>,
    /// Matrix entries that enter here: slot, block row and block column in the front.
    pub entries: Vec<[u32; 3]>,
    /// Where the rows of `pattern` lie in the front that receives the update.
    pub to_parent: Vec<Run>,
    pub children: Vec<u32>,
}

/// Block rows `from..from + len` of an update go to `to..to + len` of the parent's front,
/// all of them either pivots there or not.
pub(super) struct Run {
    pub from: usize,
    pub to: usize,
    pub len: usize,
}

/// The plan of a factorisation.
pub(super) struct Symbolic {
    /// Block row that is eliminated at each position.
    pub order: Vec<u32>,
    /// Fronts, children before parents.
    pub fronts: Vec<Front>,
}

/// Adjacent supernodes merge if the share of zeros that this adds is below the bound
/// for their common size in block rows: small fronts cost more in overhead than in zeros.
const RELAX: &[(usize, f64)] = &[(4, 0.9), (8, 0.5), (24, 0.15), (usize::MAX, 0.05)];

impl Symbolic {
    /// Analyses the pattern of block rows (`row_ptr`, `cols`), taken as symmetric:
    /// an entry whose transpose is missing is allowed, its transpose counts as zero.
    /// The last `n_kept` rows are not eliminated: they are the pivots of the last front.
    pub fn new(row_ptr: &[usize], cols: &[u32], n_kept: usize) -> Self {
        let n = row_ptr.len() - 1;
        if n == 0 {
            return Self { order: Vec::new(), fronts: Vec::new() };
        }
        let n_eliminated = n - n_kept;
        let plan = if n_kept == 0 {
            supernodal_plan(row_ptr, cols, SymmetricOrdering::Amd)
        } else {
            let order = leading_order(row_ptr, cols, n_eliminated);
            let mut position = vec![0; n];
            order.iter().enumerate().for_each(|(k, &i)| position[i] = k);
            supernodal_plan(
                row_ptr,
                cols,
                SymmetricOrdering::Custom(PermRef::new_checked(&order, &position, n)),
            )
        };
        let (order, position) = plan.perm().expect("an ordering was asked for").arrays();
        let SymbolicCholeskyRaw::Supernodal(plan) = plan.raw() else {
            unreachable!("a supernodal plan was forced");
        };

        let mut front_of = vec![0u32; n];
        let mut fronts: Vec<Front> = Vec::with_capacity(plan.n_supernodes());
        for s in 0..plan.n_supernodes() {
            let (start, end) = (plan.supernode_begin()[s], plan.supernode_end()[s]);
            if start >= n_eliminated {
                break;
            }
            let pivots = start..end.min(n_eliminated);
            front_of[pivots.clone()].fill(s as u32);
            let below = plan.supernode(s).pattern().iter().map(|&i| i as u32);
            let pattern = (pivots.end as u32..end as u32).chain(below).collect();
            fronts.push(Front::new(start, pivots.len(), pattern));
        }
        if n_kept > 0 {
            front_of[n_eliminated..].fill(fronts.len() as u32);
            fronts.push(Front::new(n_eliminated, n_kept, Vec::new()));
        }
        link_to_parents(&mut fronts, &front_of);
        for i in 0..n {
            for slot in row_ptr[i]..row_ptr[i + 1] {
                let (r, c) = (position[i] as u32, position[cols[slot] as usize] as u32);
                let front = &mut fronts[front_of[r.min(c) as usize] as usize];
                let entry = [slot as u32, front.locate(r), front.locate(c)];
                front.entries.push(entry);
            }
        }
        Self { order: order.iter().map(|&i| i as u32).collect(), fronts }
    }
}

/// Fill-reducing order (AMD) of the first `n` rows, in which the others, that follow, couple to each other: so they count as what stays.
fn leading_order(row_ptr: &[usize], cols: &[u32], n: usize) -> Vec<usize> {
    let all = row_ptr.len() - 1;
    let (mut start, mut columns) = (row_ptr[..=n].to_vec(), cols[..row_ptr[n]].to_vec());
    for _ in n..all {
        columns.extend(n as u32..all as u32);
        start.push(columns.len());
    }
    let plan = supernodal_plan(&start, &columns, SymmetricOrdering::Amd);
    let order = plan.perm().expect("an ordering was asked for").arrays().0;
    order.iter().copied().filter(|&i| i < n).chain(n..all).collect()
}

/// Supernodes of the pattern in a fill-reducing order.
fn supernodal_plan(
    row_ptr: &[usize],
    cols: &[u32],
    ordering: SymmetricOrdering<'_, usize>,
) -> SymbolicCholesky<usize> {
    let n = row_ptr.len() - 1;
    let (col_ptr, row_idx) = upper_triangle(row_ptr, cols);
    let a = SymbolicSparseColMatRef::new_checked(n, n, &col_ptr, None, &row_idx);
    let params = CholeskySymbolicParams {
        // Below zero, so that a diagonal matrix (no flops at all) has supernodes too.
        supernodal_flop_ratio_threshold: SupernodalThreshold(-1.0),
        supernodal_params: SymbolicSupernodalParams { relax: Some(RELAX) },
        ..Default::default()
    };
    factorize_symbolic_cholesky(a, faer::Side::Upper, ordering, params)
        .expect("indices fit and memory suffices")
}

/// Assigns each front the parent that receives its update, and where the rows go there;
/// `front_of` is the front that eliminates each row.
fn link_to_parents(fronts: &mut [Front], front_of: &[u32]) {
    for s in 0..fronts.len() {
        let parent = fronts[s].pattern.first().map(|&first| front_of[first as usize] as usize);
        if let Some(p) = parent {
            let mut runs: Vec<Run> = Vec::new();
            for (from, &i) in fronts[s].pattern.iter().enumerate() {
                let to = fronts[p].locate(i) as usize;
                match runs.last_mut() {
                    Some(r) if r.to + r.len == to && to != fronts[p].n_pivot => r.len += 1,
                    _ => runs.push(Run { from, to, len: 1 }),
                }
            }
            fronts[s].to_parent = runs;
            fronts[p].children.push(s as u32);
        }
    }
}

impl Front {
    fn new(start: usize, n_pivot: usize, pattern: Vec<u32>) -> Self {
        Self { start, n_pivot, pattern, entries: Vec::new(), to_parent: Vec::new(), children: Vec::new() }
    }

    /// Position in the front of a row given in elimination order.
    fn locate(&self, row: u32) -> u32 {
        let row = row as usize;
        if row < self.start + self.n_pivot {
            return (row - self.start) as u32;
        }
        let at = self.pattern.binary_search(&(row as u32)).expect("a front holds the rows it couples to");
        (self.n_pivot + at) as u32
    }
}

/// Upper triangle of the symmetrised pattern by columns, row indices ascending.
fn upper_triangle(row_ptr: &[usize], cols: &[u32]) -> (Vec<usize>, Vec<usize>) {
    let n = row_ptr.len() - 1;
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); n];
    for i in 0..n {
        for &j in &cols[row_ptr[i]..row_ptr[i + 1]] {
            let j = j as usize;
            columns[i.max(j)].push(i.min(j));
        }
    }
    let mut col_ptr = vec![0];
    let mut row_idx = Vec::with_capacity(cols.len());
    for column in &mut columns {
        column.sort_unstable();
        column.dedup();
        row_idx.extend_from_slice(column);
        col_ptr.push(row_idx.len());
    }
    (col_ptr, row_idx)
}
