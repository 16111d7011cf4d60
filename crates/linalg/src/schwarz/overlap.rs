//! The matrix rows of a rank's ghosts, fetched from their owners.

use std::collections::HashMap;
use std::rc::Rc;

use comm::Halo;

use crate::BlockCsr;

/// One layer of overlap: which rows go where, and the pattern they add here.
pub(super) struct Overlap<const B: usize> {
    halo: Rc<Halo>,
    /// Rows to send to each rank.
    asked: Vec<Vec<u32>>,
    /// Block of the received stream (all ranks, in rank order) behind each entry of the
    /// ghost rows, and its local column.
    source: Vec<u32>,
    cols: Vec<u32>,
    row_ptr: Vec<usize>,
}

impl<const B: usize> Overlap<B> {
    /// Agrees on the rows to exchange. Collective.
    pub fn new(a: &BlockCsr<B>) -> Self {
        let halo = a.halo().clone();
        let comm = halo.comm();
        let (n_owned, n_local) = (halo.n_owned(), halo.n_local());
        let counts = comm.all_gather_u64(n_owned as u64);
        let first: Vec<u64> = counts.iter().scan(0, |at, n| Some(std::mem::replace(at, *at + n))).collect();
        let here = first[comm.rank()];
        // Global ids travel as f64, which is exact to 2^53.
        let mut id = vec![0.0; n_local];
        for (i, id) in id[..n_owned].iter_mut().enumerate() {
            *id = (here + i as u64) as f64;
        }
        halo.exchange(&mut id, 1);
        let id: Vec<u64> = id.iter().map(|&x| x as u64).collect();

        let mut wanted = vec![Vec::new(); comm.size()];
        for &g in &id[n_owned..] {
            let owner = first.partition_point(|&f| f <= g) - 1;
            wanted[owner].push((g - first[owner]) as u32);
        }
        // Ghosts are ordered by owner, so the received rows come in the order of ghosts.
        let asked = comm.all_to_all_var(&wanted);
        let patterns: Vec<Vec<u64>> = asked
            .iter()
            .map(|rows| {
                let mut flat = Vec::new();
                for &i in rows {
                    let row = a.row(i as usize);
                    flat.push(row.len() as u64);
                    flat.extend(a.cols()[row].iter().map(|&j| id[j as usize]));
                }
                flat
            })
            .collect();
        let received: Vec<u64> = comm.all_to_all_var(&patterns).concat();

        let local: HashMap<u64, u32> = id.iter().enumerate().map(|(i, &g)| (g, i as u32)).collect();
        let (mut source, mut cols, mut row_ptr) = (Vec::new(), Vec::new(), vec![0]);
        let mut at = 0;
        let mut block = 0u32;
        let mut row = Vec::new();
        while at < received.len() {
            let n = received[at] as usize;
            row.clear();
            for g in &received[at + 1..at + 1 + n] {
                row.extend(local.get(g).map(|&j| (j, block)));
                block += 1;
            }
            row.sort_unstable();
            cols.extend(row.iter().map(|r| r.0));
            source.extend(row.iter().map(|r| r.1));
            row_ptr.push(cols.len());
            at += 1 + n;
        }
        assert_eq!(row_ptr.len() - 1, n_local - n_owned, "one row for each ghost");
        Self { halo, asked, source, cols, row_ptr }
    }

    pub fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Whether no rank of the program has ghosts. (Every rank must agree, because
    /// gathering is collective.)
    pub fn is_empty(&self) -> bool {
        self.halo.comm().size() == 1
    }

    /// Pattern of the owned rows followed by the ghost rows.
    pub fn pattern(&self, a: &BlockCsr<B>) -> (Vec<usize>, Vec<u32>) {
        let mut row_ptr = a.row_ptr().to_vec();
        let owned = a.cols().len();
        row_ptr.extend(self.row_ptr[1..].iter().map(|&p| owned + p));
        let mut cols = a.cols().to_vec();
        cols.extend_from_slice(&self.cols);
        (row_ptr, cols)
    }

    /// Values in the order of [`Overlap::pattern`]. Collective.
    pub fn gather(&self, a: &BlockCsr<B>, values: &mut Vec<[[f64; B]; B]>) {
        let send: Vec<Vec<f64>> = self
            .asked
            .iter()
            .map(|rows| {
                let blocks = rows.iter().flat_map(|&i| &a.values[a.row(i as usize)]);
                blocks.flatten().flatten().copied().collect()
            })
            .collect();
        let received = self.halo.comm().all_to_all_var(&send).concat();
        values.clear();
        values.extend_from_slice(&a.values);
        let blocks = received.as_chunks::<B>().0.as_chunks::<B>().0;
        values.extend(self.source.iter().map(|&s| blocks[s as usize]));
    }
}
