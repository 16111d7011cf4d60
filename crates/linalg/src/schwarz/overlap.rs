//! The matrix rows around those of a rank, fetched from their owners.

use std::rc::Rc;

use comm::{Halo, Numbering};

use crate::BlockCsr;
use crate::ghost_rows::{GhostRows, owner};

/// Layers of overlap with other ranks: the rows that it fetches and the pattern they add here.
pub(crate) struct Overlap<const B: usize> {
    /// Owned rows and, as ghosts, those of the layers.
    halo: Rc<Halo>,
    rows: GhostRows,
    /// Pattern of the owned rows followed by the ghost rows.
    row_ptr: Vec<usize>,
    cols: Vec<u32>,
    /// Fetched block behind each entry of the ghost rows.
    source: Vec<u32>,
}

impl<const B: usize> Overlap<B> {
    /// Agrees on the rows to exchange: `layers` of neighbours of the owned rows, at least one. Collective.
    pub fn new(a: &BlockCsr<B>, layers: usize) -> Self {
        let near = GhostRows::new(a.halo());
        let columns = |i: usize| a.cols()[a.row(i)].iter().map(|&j| near.id[j as usize]);
        let (owned, ghosts) = near.id.split_at(a.n_rows());
        let mut ghosts = ghosts.to_vec();
        let (mut numbering, mut halo) = widened(a, &near, owned, &ghosts);
        for _ in 1..layers {
            let further = GhostRows::new(&halo).fetch_u64(|i, list| list.extend(columns(i)));
            ghosts.extend(further.into_iter().filter(|&g| numbering.local(g).is_none()));
            (numbering, halo) = widened(a, &near, owned, &ghosts);
        }
        let rows = GhostRows::new(&halo);
        let fetched = rows.fetch_u64(|i, list| {
            list.push(a.row(i).len() as u64);
            list.extend(columns(i));
        });
        let here = |g: u64| numbering.local(g).map(|j| j as u32);
        let (mut row_ptr, mut cols) = (a.row_ptr().to_vec(), Vec::with_capacity(a.cols().len()));
        cols.extend((0..a.n_rows()).flat_map(columns).map(|g| here(g).expect("a neighbour of an owned row")));
        let (mut source, mut block, mut rest) = (Vec::new(), 0u32, &fetched[..]);
        while let Some((&n, after)) = rest.split_first() {
            let (row, after) = after.split_at(n as usize);
            let known = (block..).zip(row).filter_map(|(block, &g)| Some((here(g)?, block)));
            for (j, block) in known {
                cols.push(j);
                source.push(block);
            }
            row_ptr.push(cols.len());
            (block, rest) = (block + n as u32, after);
        }
        assert_eq!(row_ptr.len() - 1, halo.n_local(), "one row for each ghost");
        Self { halo, rows, row_ptr, cols, source }
    }

    pub fn halo(&self) -> &Halo {
        &self.halo
    }

    /// Numbers of the local rows over all ranks, contiguous by rank.
    pub fn ids(&self) -> &[u64] {
        &self.rows.id
    }

    /// Whether there is nothing to fetch anywhere. (Every rank must agree, because
    /// fetching is collective.)
    pub fn is_empty(&self) -> bool {
        self.halo.comm().size() == 1
    }

    /// Row pointers and columns of the owned rows followed by the ghost rows; columns in no order.
    pub fn pattern(&self) -> (&[usize], &[u32]) {
        (&self.row_ptr, &self.cols)
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

/// Halo of the rows of `a`, numbered `owned` contiguously by rank, with the `ghosts` of these numbers. Collective.
fn widened<const B: usize>(
    a: &BlockCsr<B>,
    near: &GhostRows,
    owned: &[u64],
    ghosts: &[u64],
) -> (Numbering, Rc<Halo>) {
    let owners = ghosts.iter().map(|&g| (g, owner(&near.first, g) as u32)).collect();
    let numbering = Numbering::new(owned.to_vec(), owners);
    let halo = Rc::new(Halo::new(a.halo().comm(), &numbering));
    (numbering, halo)
}
