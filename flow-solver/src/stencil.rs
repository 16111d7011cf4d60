//! Which cells a gradient is taken over.
//!
//! Over its neighbours a cell of six faces has an average of differences in each direction. A
//! cell of four or five has hardly more neighbours than a gradient has unknowns: a few
//! neighbours count for much, values on its faces extrapolate, and a stable scheme must shorten
//! such gradients, which makes it one of first order. The neighbours' neighbours mend
//! that. They are reached through faces, so nothing is seen through a wall of zero thickness.

use comm::Numbering;
use mesh::{FaceTable, FlowGrid};

use crate::periodic::{Shift, opposite};
use crate::topology::Adjacency;

/// Neighbourhoods of the cells of a whole grid.
pub(crate) struct Neighbourhoods {
    start: Vec<u32>,
    /// Cells, and by how much their images are moved.
    cell: Vec<(u32, Shift)>,
    /// Whether the neighbours' neighbours belong to it.
    wide: Vec<bool>,
}

impl Neighbourhoods {
    /// `None` where all cells make do with their neighbours.
    pub fn new(grid: &FlowGrid, faces: &FaceTable) -> Option<Self> {
        let wide: Vec<bool> = grid.cells.iter().map(|c| distinct(c) <= 6).collect();
        if !wide.contains(&true) {
            return None;
        }
        let mut start = vec![0u32; grid.cells.len() + 1];
        let still = Shift::default();
        let inside = || faces.interior.iter().flat_map(|&(_, i, j)| [(i, (j, still)), (j, (i, still))]);
        let across = || {
            faces.periodic.faces.iter().flat_map(|f| [0, 1].map(|side| (f.cells[side], opposite(f, side))))
        };
        let pairs = || inside().chain(across());
        pairs().for_each(|(i, _)| start[i as usize + 1] += 1);
        for c in 0..grid.cells.len() {
            start[c + 1] += start[c];
        }
        let (mut next, mut cell) = (start.clone(), vec![(0, still); pairs().count()]);
        for (i, j) in pairs() {
            cell[next[i as usize] as usize] = j;
            next[i as usize] += 1;
        }
        Some(Self { start, cell, wide })
    }

    fn neighbours(&self, c: u32) -> &[(u32, Shift)] {
        &self.cell[self.start[c as usize] as usize..self.start[c as usize + 1] as usize]
    }

    /// Calls `visit` with the neighbourhood of each of `cells`, in their order.
    pub fn of_all(&self, cells: &[u64], mut visit: impl FnMut(&[(u32, Shift)])) {
        let mut row = Vec::new();
        for &c in cells {
            let c = c as u32;
            row.clear();
            row.extend_from_slice(self.neighbours(c));
            if self.wide[c as usize] {
                for &(j, moved) in self.neighbours(c) {
                    let further = self.neighbours(j).iter().map(|&(k, shift)| (k, shift + moved));
                    row.extend(further.filter(|&k| k != (c, Shift::default())));
                }
                row.sort_unstable();
                row.dedup();
            }
            visit(&row);
        }
    }

    /// The neighbourhoods of owned cells in local numbers.
    pub fn rows(&self, numbering: &Numbering) -> Adjacency {
        let mut rows = Adjacency { start: vec![0], ..Adjacency::default() };
        let mut local = Vec::new();
        self.of_all(numbering.owned(), |row| {
            local.clear();
            local.extend(row.iter().map(|&(j, shift)| {
                numbering
                    .local_image(u64::from(j), shift.number())
                    .expect("ghosts were taken from the same neighbourhoods") as u32
            }));
            local.sort_unstable();
            let owned = local.partition_point(|&j| (j as usize) < numbering.n_owned);
            rows.ghost.push((rows.cell.len() + owned) as u32);
            rows.cell.extend_from_slice(&local);
            rows.start.push(rows.cell.len() as u32);
        });
        rows
    }
}

/// Number of different nodes: eight in a hexahedron, six in a prism.
fn distinct(cell: &[u32; 8]) -> usize {
    (0..8).filter(|&a| !cell[..a].contains(&cell[a])).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::{BoxShape, Patch, box_grid_of};

    #[test]
    fn tetrahedra_have_an_extended_stencil() {
        let grid = |shape| box_grid_of(shape, [4; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let hexahedra = grid(BoxShape::Hexahedra);
        assert!(Neighbourhoods::new(&hexahedra, &FaceTable::new(&hexahedra).unwrap()).is_none());
        let tetrahedra = grid(BoxShape::Tetrahedra);
        let faces = FaceTable::new(&tetrahedra).unwrap();
        let all = Neighbourhoods::new(&tetrahedra, &faces).unwrap();
        let n = tetrahedra.cells.len() as u64;
        let rows = all.rows(&Numbering::new((0..n).collect(), Vec::new()));
        let most = rows.start.windows(2).map(|w| w[1] - w[0]).max().unwrap();
        let least = rows.start.windows(2).map(|w| w[1] - w[0]).min().unwrap();
        assert!(most == 16 || most == 14, "4 neighbours with 3 more each, some of them shared: {most}");
        assert!(least >= 4, "{least} cells do not span a gradient");
        for i in 0..n as usize {
            let row = &rows.cell[rows.start[i] as usize..rows.start[i + 1] as usize];
            assert!(!row.contains(&(i as u32)) && row.is_sorted());
        }
    }
}
