//! The matrix rows of a rank's ghosts, fetched from their owners.

use std::collections::HashMap;
use std::rc::Rc;

use comm::Halo;

use crate::BlockCsr;
use crate::ghost_rows::GhostRows;

/// One layer of overlap: the rows it fetches and the pattern they add here.
pub(super) struct Overlap<const B: usize> {
    halo: Rc<Halo>,
    rows: GhostRows,
    /// Fetched block behind each entry of the ghost rows, and its local column.
    source: Vec<u32>,
    cols: Vec<u32>,
    row_ptr: Vec<usize>,
}

impl<const B: usize> Overlap<B> {
    /// Agrees on the rows to exchange. Collective.
    pub fn new(a: &BlockCsr<B>) -> Self {
        let halo = a.halo().clone();
        let rows = GhostRows::new(&halo);
        let fetched = rows.fetch_u64(|i, list| {
            let row = a.row(i);
            list.push(row.len() as u64);
            list.extend(a.cols()[row].iter().map(|&j| rows.id[j as usize]));
        });
        let local: HashMap<u64, u32> = rows.id.iter().enumerate().map(|(i, &g)| (g, i as u32)).collect();
        let (mut source, mut cols, mut row_ptr) = (Vec::new(), Vec::new(), vec![0]);
        let mut at = 0;
        let mut block = 0u32;
        let mut row = Vec::new();
        while at < fetched.len() {
            let n = fetched[at] as usize;
            row.clear();
            for g in &fetched[at + 1..at + 1 + n] {
                row.extend(local.get(g).map(|&j| (j, block)));
                block += 1;
            }
            row.sort_unstable();
            cols.extend(row.iter().map(|r| r.0));
            source.extend(row.iter().map(|r| r.1));
            row_ptr.push(cols.len());
            at += 1 + n;
        }
        assert_eq!(row_ptr.len() - 1, halo.n_local() - halo.n_owned(), "one row for each ghost");
        Self { halo, rows, source, cols, row_ptr }
    }

    pub fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Whether there is nothing to fetch anywhere. (Every rank must agree, because
    /// fetching is collective.)
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
        let fetched = self.rows.fetch_f64(|i, list| {
            list.extend(a.values[a.row(i)].iter().flatten().flatten());
        });
        let blocks = fetched.as_chunks::<B>().0.as_chunks::<B>().0;
        values.clear();
        values.extend_from_slice(&a.values);
        values.extend(self.source.iter().map(|&s| blocks[s as usize]));
    }
}
