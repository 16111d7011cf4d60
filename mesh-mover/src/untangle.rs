//! Local optimisation of bad cells: the last method before an error.

use crate::local::LocalGrid;

/// Largest number of sweeps over all bad cells.
const SWEEPS: usize = 20;

/// Share of bad cells beyond which the tangle is not local, and sweeps after which the rest is left for smaller increments or the error.
const LOST: f64 = 0.5;
/// See [`LOST`].
const SWEEPS_WHEN_LOST: usize = 2;

/// Moves the free nodes of cells whose scaled Jacobian is below `target`, one node at a time, to maximise the quality
/// of the worst cell around each by a pattern search. `x`: local positions, flat. Collective.
///
/// Ranks take turns, so that two owners of one cell never move nodes at the same time.
pub fn untangle(grid: &LocalGrid, x: &mut [f64], target: f64) {
    let comm = grid.comm();
    let all = 0..grid.cells.len();
    let mut free = vec![0.0; 3 * grid.free_node.len()];
    let mut patch = Patch::around(grid, all.filter(|&c| grid.quality(c, x) < target));
    for sweep in 0..SWEEPS {
        let bad: Vec<u32> =
            patch.cells.iter().copied().filter(|&c| grid.quality(c as usize, x) < target).collect();
        if comm.all(bad.is_empty()) {
            return;
        }
        let mut counts = [bad.len() as f64, grid.cells.len() as f64];
        comm.sum_slice(&mut counts);
        if sweep >= SWEEPS_WHEN_LOST && counts[0] > LOST * counts[1] {
            return;
        }
        if sweep > 0 {
            // The quality of neighbours may have decreased.
            patch = Patch::around(grid, bad.iter().map(|&c| c as usize));
        }
        for turn in 0..comm.size() {
            if turn == comm.rank() {
                for (k, &a) in patch.nodes.iter().enumerate() {
                    improve(a, patch.around_node(k), grid, x);
                }
            }
            for (f, &a) in free.as_chunks_mut::<3>().0.iter_mut().zip(&grid.free_node) {
                f.copy_from_slice(&x[3 * a as usize..][..3]);
            }
            grid.free_halo.exchange(&mut free, 3);
            for (f, &a) in free.as_chunks::<3>().0.iter().zip(&grid.free_node) {
                x[3 * a as usize..][..3].copy_from_slice(f);
            }
        }
    }
}

/// The movable nodes of some cells, and all cells around them.
struct Patch {
    /// Owned free nodes, ascending.
    nodes: Vec<u32>,
    /// First of each node's cells in `around`, and the end.
    first: Vec<u32>,
    around: Vec<u32>,
    /// Cells around any of the nodes, ascending.
    cells: Vec<u32>,
}

impl Patch {
    fn around(grid: &LocalGrid, cells: impl Iterator<Item = usize>) -> Self {
        let mut nodes: Vec<u32> =
            cells.flat_map(|c| grid.cells[c]).filter(|&a| grid.is_owned_and_movable(a)).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        if !nodes.is_empty() {
            for (c, cell) in grid.cells.iter().enumerate() {
                pairs.extend(
                    cell.iter().filter_map(|a| nodes.binary_search(a).ok()).map(|k| (k as u32, c as u32)),
                );
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let first = (0..=nodes.len()).map(|k| pairs.partition_point(|p| (p.0 as usize) < k) as u32).collect();
        let mut cells: Vec<u32> = pairs.iter().map(|p| p.1).collect();
        let around = cells.clone();
        cells.sort_unstable();
        cells.dedup();
        Self { nodes, first, around, cells }
    }

    fn around_node(&self, k: usize) -> &[u32] {
        &self.around[self.first[k] as usize..self.first[k + 1] as usize]
    }
}

/// Pattern search along the axes and towards the mean of the neighbours.
fn improve(a: u32, cells: &[u32], grid: &LocalGrid, x: &mut [f64]) {
    let at = 3 * a as usize;
    let worst = |x: &[f64]| cells.iter().map(|&c| grid.quality(c as usize, x)).fold(f64::INFINITY, f64::min);
    let mut mean = [0.0; 3];
    let mut n = 0.0;
    let mut radius = 0.0f64;
    for &c in cells {
        for &b in &grid.cells[c as usize] {
            let d: f64 = (0..3).map(|i| (x[3 * b as usize + i] - x[at + i]).powi(2)).sum();
            radius = radius.max(d.sqrt());
            (0..3).for_each(|i| mean[i] += x[3 * b as usize + i]);
            n += 1.0;
        }
    }
    let mut best = worst(x);
    let mut step = 0.25 * radius;
    while step > 1e-3 * radius {
        let here = [x[at], x[at + 1], x[at + 2]];
        let inwards: Vec<f64> = (0..3).map(|i| mean[i] / n - here[i]).collect();
        let length = inwards.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-300);
        let mut found = None;
        let towards = [inwards[0] / length, inwards[1] / length, inwards[2] / length];
        let axes = (0..6).map(|k| {
            let mut d = [0.0; 3];
            d[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
            d
        });
        for d in axes.chain([towards]) {
            (0..3).for_each(|i| x[at + i] = here[i] + step * d[i]);
            let q = worst(x);
            if q > best {
                best = q;
                found = Some([x[at], x[at + 1], x[at + 2]]);
            }
        }
        x[at..at + 3].copy_from_slice(&found.unwrap_or(here));
        if found.is_none() {
            step *= 0.5;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use comm::Comm;

    #[test]
    fn displaced_nodes_return_to_valid_cells() {
        let grid = crate::example_grid::plate_in_box(6, 0.1, 0.8, true);
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
        let mut x = local.gather(&grid.coords);
        let fixed = x.clone();
        // Several nodes, by more than a cell.
        let mut pushed = 0;
        for &a in local.free_node.iter().step_by(37) {
            x[3 * a as usize] += 0.4;
            pushed += 1;
        }
        assert!(pushed >= 4 && local.worst(&x).unwrap().1 < 0.0);
        untangle(&local, &mut x, 0.1);
        let (cell, q) = local.worst(&x).unwrap();
        assert!(q >= 0.1, "cell {cell}: {q}");
        for a in 0..local.n_local() {
            if !local.is_owned_and_movable(a as u32) {
                assert_eq!(x[3 * a..3 * a + 3], fixed[3 * a..3 * a + 3]);
            }
        }
    }

    /// A node at the centre of eight cubes that is displaced by one step of the search, along an axis or towards the
    /// mean of its neighbours, is restored to round-off; displaced in any other way, to the last step.
    #[test]
    fn node_displaced_by_one_step_is_restored_at_once() {
        let grid = crate::example_grid::plate_in_box(4, 0.0, 1.0, false);
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
        let start = local.gather(&grid.coords);
        // Away from the plate, in cubes of half the unit.
        let centre = [-0.5, 0.5, 0.5];
        let near = |a: &u32| (0..3).all(|i| (start[3 * *a as usize + i] - centre[i]).abs() < 1e-12);
        let a = local.free_node.iter().copied().find(near).expect("a free node");
        let cells: Vec<u32> =
            (0..local.cells.len() as u32).filter(|&c| local.cells[c as usize].contains(&a)).collect();
        assert_eq!(cells.len(), 8);
        let put_back = |d: [f64; 3]| {
            let mut x = start.clone();
            (0..3).for_each(|i| x[3 * a as usize + i] += 0.5 * d[i]);
            improve(a, &cells, &local, &mut x);
            let max_error = x.iter().zip(&start).map(|(x, s)| (x - s).abs()).fold(0.0, f64::max);
            (max_error, local.worst(&x).unwrap().1)
        };
        // A quarter of the distance to the farthest corner: 15 a^2 - 2 a - 3 = 0.
        let along = (2.0 + 184.0f64.sqrt()) / 30.0;
        // Half as far is the second step: 63 a^2 - 2 a - 3 = 0.
        let half = (2.0 + 760.0f64.sqrt()) / 126.0;
        for (i, off) in (0..6).flat_map(|i| [(i, along), (i, half)]) {
            let mut d = [0.0; 3];
            d[i / 2] = if i % 2 == 0 { off } else { -off };
            let (max_error, quality) = put_back(d);
            assert!(max_error < 1e-12 && quality > 1.0 - 1e-12, "{d:?}: {max_error} {quality}");
        }
        for i in 0..8 {
            let d = [0, 1, 2].map(|k| if i >> k & 1 == 0 { 1.0 / 3.0 } else { -1.0 / 3.0 });
            let (max_error, quality) = put_back(d);
            assert!(max_error < 1e-12 && quality > 1.0 - 1e-12, "{d:?}: {max_error} {quality}");
        }
        let (max_error, quality) = put_back([0.4, -0.1, 0.23]);
        assert!(max_error < 2e-3 && quality > 0.995, "{max_error} {quality}");
    }
}
