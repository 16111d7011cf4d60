//! Groups of strongly coupled nodes.

use crate::BlockCsr;
use crate::block::Real;

/// Aggregate of each owned node, or [`NONE`] for nodes that couple to nothing.
pub(super) struct Aggregates {
    pub of_node: Vec<u32>,
    pub count: usize,
}

/// No aggregate.
pub(super) const NONE: u32 = u32::MAX;

/// Greedy aggregation in three passes (Vanek et al. 1996): neighbourhoods that are free
/// as a whole; nodes that touch one of those; what is left over.
pub(super) fn aggregate<const F: usize, S: Real>(a: &BlockCsr<F, S>, strength: f64) -> Aggregates {
    let n = a.n_rows();
    let norm2 = |s: usize| a.values[s].iter().flatten().map(|v| v.to_f64() * v.to_f64()).sum::<f64>();
    let diagonal: Vec<f64> = (0..n).map(|i| norm2(a.diagonal_slot(i)).sqrt()).collect();
    let limit = strength * strength;
    // Strong couplings within the rank, as (neighbour, squared norm relative to limit).
    let strong = |i: usize| {
        let di = diagonal[i];
        let diagonal = &diagonal;
        a.row(i).filter_map(move |s| {
            let j = a.cols()[s] as usize;
            let w = if j < n && j != i { norm2(s) } else { 0.0 };
            (w > 0.0 && w > limit * di * diagonal[j]).then_some((j, w))
        })
    };
    let isolated = |i: usize| {
        let d = a.diagonal_slot(i);
        a.row(i).all(|s| s == d || norm2(s) == 0.0)
    };

    let mut of_node: Vec<u32> = (0..n).map(|i| if isolated(i) { NONE - 1 } else { NONE }).collect();
    let free = NONE;
    let done = NONE - 1;
    let mut count = 0u32;
    for i in 0..n {
        if of_node[i] == free && strong(i).all(|(j, _)| of_node[j] == free) && strong(i).next().is_some() {
            of_node[i] = count;
            strong(i).for_each(|(j, _)| of_node[j] = count);
            count += 1;
        }
    }
    let first_pass = of_node.clone();
    for i in 0..n {
        if of_node[i] == free {
            let best = strong(i)
                .filter(|&(j, _)| first_pass[j] < done)
                .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            if let Some((j, _)) = best {
                of_node[i] = first_pass[j];
            }
        }
    }
    for i in 0..n {
        if of_node[i] == free {
            of_node[i] = count;
            for (j, _) in strong(i) {
                if of_node[j] == free {
                    of_node[j] = count;
                }
            }
            count += 1;
        }
    }
    for a in &mut of_node {
        if *a == done {
            *a = NONE;
        }
    }
    Aggregates { of_node, count: count as usize }
}
