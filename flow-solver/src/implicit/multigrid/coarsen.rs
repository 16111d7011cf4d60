//! From cells to larger cells: matching, coarse couplings, transfers.

use comm::{Comm, Halo, Numbering};
use serde::{Deserialize, Serialize};

use super::Matrix;
use crate::geometry::vec3::Vec3;
use crate::topology::Adjacency;

/// Pairings between two levels: each halves the number of cells.
const PAIRINGS: usize = 3;

/// Entry whose two cells are merged.
const INSIDE: u16 = u16::MAX;

/// Coarse cells and where the fine ones went.
#[derive(Debug)]
pub(super) struct Coarse {
    /// Neighbours of the owned coarse cells.
    pub rows: Adjacency,
    /// Coarse cell of each owned fine cell.
    parent: Vec<u32>,
    /// Entry of each fine entry in the row of its coarse cell, or [`INSIDE`].
    target: Vec<u16>,
    /// Distance of the fine cells over that of the coarse ones, of each fine entry, in
    /// shares of 255.
    ratio: Vec<u8>,
    /// Exchange of coarse ghosts.
    pub halo: Halo,
    /// Number of the first owned coarse cell among all ranks, and number and owner of ghosts.
    offset: u64,
    ghosts: Vec<(u64, u32)>,
}

/// A level's coarse cells as numbers: what a [`Coarse`] is made of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MergedLevel {
    /// `start`, `cell`, `upper` and `ghost` of the coarse rows.
    rows: [Vec<u32>; 4],
    parent: Vec<u32>,
    target: Vec<u16>,
    ratio: Vec<u8>,
    offset: u64,
    ghosts: Vec<(u64, u32)>,
}

impl MergedLevel {
    /// Number of its owned cells.
    pub fn cells(&self) -> u64 {
        (self.rows[0].len() as u64).saturating_sub(1)
    }

    /// Checks that it is a coarse level of the rows `fine` of a rank; `starts`: first cells of the level
    /// on all ranks, and one more for the end. All indices from a file are checked.
    pub fn check(&self, fine: [&[u32]; 2], rank: usize, starts: &[u64]) -> Result<(), &'static str> {
        let [fine_start, fine_cell] = fine;
        let [start, cell, upper, ghost] = &self.rows;
        let (n, fine_cells) = (self.cells() as usize, fine_start.len() - 1);
        let ascends = |s: &[u32]| s.first() == Some(&0) && s.is_sorted();
        if !ascends(start) || *start.last().unwrap_or(&0) as usize != cell.len() {
            return Err("row offsets of a multigrid level are not ascending");
        }
        let inside = |i: usize| start[i] <= upper[i] && upper[i] <= ghost[i] && ghost[i] <= start[i + 1];
        if upper.len() != n || ghost.len() != n || !(0..n).all(inside) {
            return Err("row ranges of a multigrid level are inconsistent");
        }
        if self.offset != starts[rank] || n as u64 != starts[rank + 1] - starts[rank] {
            return Err("coarse cells are not numbered consecutively across the ranks");
        }
        let elsewhere = |&(number, owner): &(u64, u32)| {
            let owner = owner as usize;
            owner != rank && owner + 1 < starts.len() && (starts[owner]..starts[owner + 1]).contains(&number)
        };
        if !self.ghosts.iter().all(elsewhere) {
            return Err("a ghost of a multigrid level is not owned by another rank");
        }
        let mut ghosts: Vec<u64> = self.ghosts.iter().map(|g| g.0).collect();
        ghosts.sort_unstable();
        ghosts.dedup();
        if !cell.iter().all(|&c| (c as usize) < n + ghosts.len()) {
            return Err("a neighbour of a coarse cell does not exist");
        }
        let mut empty = vec![true; n];
        if self.parent.len() != fine_cells || self.parent.iter().any(|&p| p as usize >= n) {
            return Err("a fine cell has no coarse cell");
        }
        self.parent.iter().for_each(|&p| empty[p as usize] = false);
        if empty.contains(&true) {
            return Err("a coarse cell has no fine cells");
        }
        let entries = fine_cell.len();
        if self.target.len() != entries || self.ratio.len() != entries {
            return Err("the coupling table does not match the fine level");
        }
        for (i, &p) in self.parent.iter().enumerate() {
            let row = fine_start[i] as usize..fine_start[i + 1] as usize;
            let places = start[p as usize + 1] - start[p as usize];
            if self.target[row].iter().any(|&t| t != INSIDE && u32::from(t) >= places) {
                return Err("a fine coupling has no coarse coupling");
            }
        }
        Ok(())
    }

    /// Start of the rows and their cells.
    pub fn rows(&self) -> [&[u32]; 2] {
        [&self.rows[0], &self.rows[1]]
    }
}

/// Cells as the matching sees them: owned ones only.
struct Graph {
    start: Vec<u32>,
    /// Neighbour and coupling.
    entry: Vec<(u32, f32)>,
    centre: Vec<Vec3>,
    volume: Vec<f64>,
}

impl Graph {
    /// Partner of each cell: its strongest free neighbour; a cell that finds none
    /// joins the pair of its strongest neighbour. Returns the group of each cell
    /// and the number of groups.
    fn pairs(&self) -> (Vec<u32>, usize) {
        const FREE: u32 = u32::MAX;
        let n = self.centre.len();
        let mut group = vec![FREE; n];
        let mut count = 0;
        let row = |i: usize| &self.entry[self.start[i] as usize..self.start[i + 1] as usize];
        for i in 0..n {
            if group[i] != FREE {
                continue;
            }
            let (mut free, mut any) = ((FREE, 0.0f32), (FREE, 0.0f32));
            for &(j, k) in row(i) {
                if group[j as usize] == FREE && k > free.1 {
                    free = (j, k);
                }
                if k > any.1 {
                    any = (j, k);
                }
            }
            // A weak partner spoils the coarse cell's shape.
            if free.0 != FREE && free.1 > 0.25 * any.1 {
                group[free.0 as usize] = count;
            } else if any.0 != FREE && group[any.0 as usize] != FREE {
                group[i] = group[any.0 as usize];
                continue;
            }
            group[i] = count;
            count += 1;
        }
        (group, count as usize)
    }

    /// The graph of the groups.
    fn merged(&self, group: &[u32], count: usize) -> Self {
        let mut centre = vec![Vec3::zeros(); count];
        let mut volume = vec![0.0; count];
        for (i, &g) in group.iter().enumerate() {
            centre[g as usize] += self.centre[i] * self.volume[i];
            volume[g as usize] += self.volume[i];
        }
        for (c, v) in centre.iter_mut().zip(&volume) {
            *c *= 1.0 / v;
        }
        let (first, member) = members(group, count);
        let (mut start, mut entry) = (vec![0], Vec::with_capacity(self.entry.len() / 2));
        let mut row: Vec<(u32, f32)> = Vec::new();
        for g in 0..count {
            row.clear();
            for &i in &member[first[g] as usize..first[g + 1] as usize] {
                let i = i as usize;
                for &(j, k) in &self.entry[self.start[i] as usize..self.start[i + 1] as usize] {
                    let h = group[j as usize];
                    if h as usize != g {
                        let fine = (self.centre[j as usize] - self.centre[i]).norm();
                        row.push((h, k * ratio(fine, centre[g], centre[h as usize])));
                    }
                }
            }
            row.sort_by_key(|r| r.0);
            for same in row.chunk_by(|a, b| a.0 == b.0) {
                entry.push((same[0].0, same.iter().map(|e| e.1).sum()));
            }
            start.push(entry.len() as u32);
        }
        Self { start, entry, centre, volume }
    }
}

/// How much weaker a coupling over the distance of `a` and `b` is than over `fine`.
/// Never below one half: a larger ratio does not converge with constant transfers. Merging along a line
/// only would make the coarse correction too large otherwise.
fn ratio(fine: f64, a: Vec3, b: Vec3) -> f32 {
    let coarse = (a - b).norm();
    if coarse > fine { (fine / coarse).max(0.5) as f32 } else { 1.0 }
}

/// Members of each group in compressed rows.
fn members(group: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0u32; count + 1];
    group.iter().for_each(|&g| first[g as usize + 1] += 1);
    for g in 0..count {
        first[g + 1] += first[g];
    }
    let (mut next, mut member) = (first.clone(), vec![0; group.len()]);
    for (i, &g) in group.iter().enumerate() {
        member[next[g as usize] as usize] = i as u32;
        next[g as usize] += 1;
    }
    (first, member)
}

/// Pairs the owned cells of a level several times: the coarse cell of each, and the graph of the coarse cells.
fn merge(rows: &Adjacency, matrix: &Matrix, centre: &[[f64; 3]], volume: &[f64]) -> (Vec<u32>, Graph) {
    let n = matrix.own.len();
    let (mut start, mut entry) = (vec![0], Vec::new());
    for i in 0..n {
        let row = rows.start[i] as usize..rows.ghost[i] as usize;
        entry.extend(row.map(|k| (rows.cell[k], matrix.off[k])));
        start.push(entry.len() as u32);
    }
    let centre = centre[..n].iter().map(|x| Vec3::from(*x)).collect();
    let mut graph = Graph { start, entry, centre, volume: volume[..n].to_vec() };
    let mut parent: Vec<u32> = (0..n as u32).collect();
    for _ in 0..PAIRINGS {
        let (group, count) = graph.pairs();
        parent.iter_mut().for_each(|p| *p = group[*p as usize]);
        graph = graph.merged(&group, count);
    }
    (parent, graph)
}

/// Numbers of a level's coarse cells.
struct Numbered {
    numbering: Numbering,
    /// Local coarse cell of each local fine cell.
    coarse_of: Vec<u32>,
    /// Number of the first owned coarse cell among all ranks, and number and owner of ghosts.
    offset: u64,
    ghosts: Vec<(u64, u32)>,
}

/// Numbers the coarse cells, those that ghosts belong to included; `halo` and `parent` are those of the fine cells. Collective.
fn number(halo: &Halo, parent: &[u32], n_coarse: usize) -> Numbered {
    let comm = halo.comm();
    let sizes = comm.all_gather_u64(n_coarse as u64);
    let offset: u64 = sizes[..comm.rank()].iter().sum();
    let mut number = vec![0.0; halo.n_local()];
    for (x, &p) in number.iter_mut().zip(parent) {
        *x = (offset + u64::from(p)) as f64;
    }
    halo.exchange(&mut number, 1);
    let ends: Vec<u64> = sizes
        .iter()
        .scan(0, |end, s| {
            *end += s;
            Some(*end)
        })
        .collect();
    // Images of owned cells belong to owned coarse cells: positions, which differ, enter the finest level alone.
    let ghosts: Vec<(u64, u32)> = number[parent.len()..]
        .iter()
        .map(|&g| (g as u64, ends.partition_point(|&e| e <= g as u64) as u32))
        .filter(|&(_, owner)| owner as usize != comm.rank())
        .collect();
    let numbering = Numbering::new((offset..offset + n_coarse as u64).collect(), ghosts.clone());
    let coarse_of: Vec<u32> = number
        .iter()
        .map(|&g| numbering.local(g as u64).expect("every number was entered above") as u32)
        .collect();
    Numbered { numbering, coarse_of, offset, ghosts }
}

/// Rows of the coarse cells, and the entry of each fine entry in them.
fn coarse_rows(
    rows: &Adjacency,
    parent: &[u32],
    coarse_of: &[u32],
    n_coarse: usize,
) -> (Adjacency, Vec<u16>) {
    let (first, member) = members(parent, n_coarse);
    let mut coarse = Adjacency { start: vec![0], ..Adjacency::default() };
    let mut target = vec![INSIDE; rows.cell.len()];
    let mut row: Vec<u32> = Vec::new();
    for c in 0..n_coarse {
        row.clear();
        let entries = member[first[c] as usize..first[c + 1] as usize]
            .iter()
            .flat_map(|&i| rows.start[i as usize] as usize..rows.start[i as usize + 1] as usize);
        row.extend(entries.clone().map(|k| coarse_of[rows.cell[k] as usize]).filter(|&d| d as usize != c));
        row.sort_unstable();
        row.dedup();
        let at = coarse.cell.len();
        for k in entries {
            if let Ok(place) = row.binary_search(&coarse_of[rows.cell[k] as usize]) {
                target[k] = place as u16;
            }
        }
        coarse.cell.extend_from_slice(&row);
        coarse.upper.push((at + row.partition_point(|&d| (d as usize) < c)) as u32);
        coarse.ghost.push((at + row.partition_point(|&d| (d as usize) < n_coarse)) as u32);
        coarse.start.push(coarse.cell.len() as u32);
    }
    (coarse, target)
}

/// Distances of the fine cells over those of their coarse cells, of each fine entry, in shares of 255; centres of
/// the local fine and coarse cells.
fn ratios(rows: &Adjacency, [fine, coarse]: [&[[f64; 3]]; 2], coarse_of: &[u32]) -> Vec<u8> {
    let mut ratios = vec![0; rows.cell.len()];
    let at = |centre: &[[f64; 3]], i: usize| Vec3::from(centre[i]);
    for i in 0..rows.start.len() - 1 {
        for k in rows.start[i] as usize..rows.start[i + 1] as usize {
            let j = rows.cell[k] as usize;
            let distance = (at(fine, j) - at(fine, i)).norm();
            let r = ratio(distance, at(coarse, coarse_of[i] as usize), at(coarse, coarse_of[j] as usize));
            ratios[k] = (255.0 * r).round() as u8;
        }
    }
    ratios
}

impl Coarse {
    /// What it is made of.
    pub fn merged(&self) -> MergedLevel {
        let rows = &self.rows;
        MergedLevel {
            rows: [rows.start.clone(), rows.cell.clone(), rows.upper.clone(), rows.ghost.clone()],
            parent: self.parent.clone(),
            target: self.target.clone(),
            ratio: self.ratio.clone(),
            offset: self.offset,
            ghosts: self.ghosts.clone(),
        }
    }

    /// From what it is made of, with the number of local coarse cells. Collective.
    pub fn of_merged(merged: MergedLevel, comm: &Comm) -> (Self, usize) {
        let MergedLevel { rows: [start, cell, upper, ghost], parent, target, ratio, offset, ghosts } = merged;
        let n = start.len() as u64 - 1;
        let numbering = Numbering::new((offset..offset + n).collect(), ghosts.clone());
        let rows = Adjacency { start, cell, upper, ghost, slot: Vec::new() };
        let halo = Halo::new(comm, &numbering);
        (Self { rows, parent, target, ratio, halo, offset, ghosts }, numbering.n_local())
    }

    /// Merges the owned cells of a level. `centre` and `volume` of its local cells
    /// become those of the coarse local cells. Also returns how many these are. Collective.
    pub fn new(
        rows: &Adjacency,
        halo: &Halo,
        matrix: &Matrix,
        centre: &mut Vec<[f64; 3]>,
        volume: &mut Vec<f64>,
    ) -> (Self, usize) {
        let (parent, graph) = merge(rows, matrix, centre, volume);
        let Numbered { numbering, coarse_of, offset, ghosts } = number(halo, &parent, graph.centre.len());
        let (coarse_rows, target) = coarse_rows(rows, &parent, &coarse_of, graph.centre.len());

        let mut middle: Vec<[f64; 3]> = graph.centre.iter().map(|x| (*x).into()).collect();
        middle.resize(numbering.n_local(), [0.0; 3]);
        let fine_centre = std::mem::replace(centre, middle);
        let mut size = graph.volume;
        size.resize(numbering.n_local(), 0.0);
        *volume = size;
        // Ghost centres of the coarse level are needed for the ratios.
        let exchange = Halo::new(halo.comm(), &numbering);
        exchange.exchange(centre.as_flattened_mut(), 3);
        exchange.exchange(volume, 1);
        let ratio = ratios(rows, [&fine_centre, centre], &coarse_of);
        let coarse = Self { rows: coarse_rows, parent, target, ratio, halo: exchange, offset, ghosts };
        (coarse, numbering.n_local())
    }

    /// Coarse matrix from the fine one.
    pub fn collect(&self, rows: &Adjacency, fine: &Matrix, coarse: &mut Matrix) {
        coarse.own.fill(0.0);
        coarse.off.fill(0.0);
        for (i, &p) in self.parent.iter().enumerate() {
            coarse.own[p as usize] += fine.own[i];
            let at = self.rows.start[p as usize] as usize;
            let row = rows.start[i] as usize..rows.start[i + 1] as usize;
            for ((k, r), &t) in
                fine.off[row.clone()].iter().zip(&self.ratio[row.clone()]).zip(&self.target[row])
            {
                if t != INSIDE {
                    coarse.off[at + t as usize] += k * f32::from(*r) * (1.0 / 255.0);
                }
            }
        }
        coarse.complete(&self.rows);
    }

    /// Sums what a forward sweep from zero, which gave `x` (with ghosts), has left:
    /// the residual is the upper triangle's and the ghosts' part of the product.
    pub fn restrict(&self, rows: &Adjacency, fine: &Matrix, x: &[f32], b: &mut [f32]) {
        b.fill(0.0);
        for (i, &p) in self.parent.iter().enumerate() {
            let row = rows.upper[i] as usize..rows.start[i + 1] as usize;
            let mut s = 0.0;
            for (k, &j) in fine.off[row.clone()].iter().zip(&rows.cell[row]) {
                s += k * x[j as usize];
            }
            b[p as usize] += s;
        }
    }

    /// Adds the coarse correction to `x`.
    pub fn prolong(&self, coarse: &[f32], x: &mut [f32]) {
        for (x, &p) in x.iter_mut().zip(&self.parent) {
            *x += coarse[p as usize];
        }
    }
}
