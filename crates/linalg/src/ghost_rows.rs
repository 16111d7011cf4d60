//! Rows of the neighbours: what the owners of this rank's ghosts know about them.

use std::rc::Rc;

use comm::Halo;

/// Fetches, for every ghost, a list that its owner holds. For set-up.
pub(crate) struct GhostRows {
    halo: Rc<Halo>,
    /// Owned rows that each rank reads.
    asked: Vec<Vec<u32>>,
    /// Number of the first owned row of each rank, in a numbering contiguous by rank.
    pub first: Vec<u64>,
    /// That number for each local row.
    pub id: Vec<u64>,
}

impl GhostRows {
    /// Agrees with the neighbours on the rows. Collective.
    pub fn new(halo: &Rc<Halo>) -> Self {
        let comm = halo.comm();
        let (n_owned, n_local) = (halo.n_owned(), halo.n_local());
        let first = starts(&comm.all_gather_u64(n_owned as u64));
        // Numbers travel as f64, which is exact to 2^53.
        let mut id = vec![0.0; n_local];
        for (i, id) in id[..n_owned].iter_mut().enumerate() {
            *id = (first[comm.rank()] + i as u64) as f64;
        }
        halo.exchange(&mut id, 1);
        let id: Vec<u64> = id.iter().map(|&x| x as u64).collect();
        let mut wanted = vec![Vec::new(); comm.size()];
        for &g in &id[n_owned..] {
            let owner = owner(&first, g);
            wanted[owner].push((g - first[owner]) as u32);
        }
        let asked = comm.all_to_all_var(&wanted);
        Self { halo: halo.clone(), asked, first, id }
    }

    /// The lists that `row` writes for the ghosts, one after the other in the order of
    /// the ghosts (which are sorted by owner). Collective.
    pub fn fetch_u64(&self, row: impl Fn(usize, &mut Vec<u64>)) -> Vec<u64> {
        self.halo.comm().all_to_all_var(&self.collect(row)).concat()
    }

    /// As [`GhostRows::fetch_u64`].
    pub fn fetch_f64(&self, row: impl Fn(usize, &mut Vec<f64>)) -> Vec<f64> {
        self.halo.comm().all_to_all_var(&self.collect(row)).concat()
    }

    fn collect<T>(&self, row: impl Fn(usize, &mut Vec<T>)) -> Vec<Vec<T>> {
        let list = |rows: &Vec<u32>| {
            let mut list = Vec::new();
            for &i in rows {
                row(i as usize, &mut list);
            }
            list
        };
        self.asked.iter().map(list).collect()
    }
}

/// Running totals, starting at zero.
pub(crate) fn starts(counts: &[u64]) -> Vec<u64> {
    counts.iter().scan(0, |at, n| Some(std::mem::replace(at, *at + n))).collect()
}

/// The rank whose range holds `id`: the last one that starts at or before it (ranks
/// without rows start where the next one does).
pub(crate) fn owner(first: &[u64], id: u64) -> usize {
    first.partition_point(|&f| f <= id) - 1
}
