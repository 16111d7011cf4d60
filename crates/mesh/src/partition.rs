//! Shares of a mesh for the ranks of a program, and cache-friendly orders.

use crate::{FaceTable, MeshError, StructureMesh};

/// An undirected graph without self-loops, neighbours in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Graph {
    /// Neighbours of `v` are `neighbours[start[v]..start[v + 1]]`.
    pub start: Vec<u32>,
    /// Neighbours of all vertices, one vertex after the other.
    pub neighbours: Vec<u32>,
}

impl Graph {
    /// From undirected pairs; repeated pairs and loops are dropped.
    pub fn from_pairs(vertices: usize, pairs: impl Iterator<Item = [u32; 2]> + Clone) -> Self {
        let pairs = pairs.filter(|[a, b]| a != b);
        let mut start = vec![0u32; vertices + 1];
        for [a, b] in pairs.clone() {
            start[a as usize + 1] += 1;
            start[b as usize + 1] += 1;
        }
        for v in 0..vertices {
            start[v + 1] += start[v];
        }
        let mut fill = start.clone();
        let mut all = vec![0u32; start[vertices] as usize];
        for [a, b] in pairs {
            for (from, to) in [(a, b), (b, a)] {
                all[fill[from as usize] as usize] = to;
                fill[from as usize] += 1;
            }
        }
        let mut graph = Graph { start: vec![0; vertices + 1], neighbours: Vec::with_capacity(all.len()) };
        for v in 0..vertices {
            let row = &mut all[start[v] as usize..start[v + 1] as usize];
            row.sort_unstable();
            for i in 0..row.len() {
                if i == 0 || row[i] != row[i - 1] {
                    graph.neighbours.push(row[i]);
                }
            }
            graph.start[v + 1] = graph.neighbours.len() as u32;
        }
        graph
    }

    /// Cells joined by faces; the two sides of the canopy too, since a canopy
    /// face's load needs both.
    pub fn of_cells(cells: usize, faces: &FaceTable) -> Self {
        let interior = faces.interior.iter().map(|&(_, a, b)| [a, b]);
        let canopy = faces.canopy.iter().filter_map(|c| c.both()).map(|(a, b)| [a, b]);
        Self::from_pairs(cells, interior.chain(canopy))
    }

    /// Nodes joined by elements (each with all nodes of its own).
    pub fn of_nodes<'a, E: AsRef<[u32]> + 'a>(
        nodes: usize,
        elements: impl Iterator<Item = &'a E> + Clone,
    ) -> Self {
        let pairs = elements.flat_map(|e| {
            let e = e.as_ref();
            (0..e.len()).flat_map(move |i| (0..i).map(move |j| [e[i], e[j]]))
        });
        Self::from_pairs(nodes, pairs)
    }

    /// Nodes of a structure joined by triangles and cables.
    pub fn of_structure(mesh: &StructureMesh) -> Self {
        let triangles = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        Self::from_pairs(mesh.coords.len(), triangles.chain(mesh.cables.iter().map(|c| c.nodes)))
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbours of a vertex.
    pub fn of(&self, v: usize) -> &[u32] {
        &self.neighbours[self.start[v] as usize..self.start[v + 1] as usize]
    }

    /// Reverse Cuthill-McKee order: the list of old numbers in their new order.
    pub fn cuthill_mckee(&self) -> Vec<u32> {
        let n = self.len();
        let degree = |v: u32| self.of(v as usize).len();
        let mut by_degree: Vec<u32> = (0..n as u32).collect();
        by_degree.sort_by_key(|&v| degree(v));
        let mut seen = vec![false; n];
        let mut order: Vec<u32> = Vec::with_capacity(n);
        let mut next = Vec::new();
        let (mut searched, mut search) = (vec![0; n], 0);
        for &seed in &by_degree {
            if seen[seed as usize] {
                continue;
            }
            let from = order.len();
            order.push(self.far_end(seed, &mut searched, &mut search));
            seen[order[from] as usize] = true;
            let mut head = from;
            while head < order.len() {
                next.clear();
                next.extend(self.of(order[head] as usize).iter().copied().filter(|&w| !seen[w as usize]));
                next.sort_by_key(|&w| degree(w));
                for &w in &next {
                    seen[w as usize] = true;
                    order.push(w);
                }
                head += 1;
            }
        }
        order.reverse();
        order
    }

    /// A vertex far from `seed` in its component (two breadth-first searches);
    /// `seen` marks the searches by number, `search` is the last one used.
    fn far_end(&self, seed: u32, seen: &mut [u32], search: &mut u32) -> u32 {
        let mut end = seed;
        for _ in 0..2 {
            *search += 1;
            let mut queue = vec![end];
            seen[end as usize] = *search;
            let mut head = 0;
            while head < queue.len() {
                for &w in self.of(queue[head] as usize) {
                    if seen[w as usize] != *search {
                        seen[w as usize] = *search;
                        queue.push(w);
                    }
                }
                head += 1;
            }
            end = *queue.last().expect("starts with one vertex");
        }
        end
    }

    /// Part of each vertex, 0 to `parts - 1`, none of them empty: METIS k-way,
    /// the same on every call. Where METIS leaves a part empty or fails (tiny
    /// graphs), contiguous shares of the Cuthill-McKee order instead.
    ///
    /// # Errors
    /// [`MeshError::TooManyParts`].
    pub fn partition(&self, parts: usize, weights: Option<&[i32]>) -> Result<Vec<u32>, MeshError> {
        let n = self.len();
        if parts == 0 || parts > n {
            return Err(MeshError::TooManyParts { parts, elements: n });
        }
        if parts == 1 {
            return Ok(vec![0; n]);
        }
        let complete = |part: &[u32]| {
            let mut used = vec![false; parts];
            part.iter().for_each(|&p| used[p as usize] = true);
            used.iter().all(|&u| u)
        };
        match self.metis(parts, weights).filter(|p| complete(p)) {
            Some(part) => Ok(part),
            None => {
                let mut part = vec![0; n];
                for (place, v) in self.cuthill_mckee().into_iter().enumerate() {
                    part[v as usize] = (place * parts / n) as u32;
                }
                Ok(part)
            }
        }
    }

    fn metis(&self, parts: usize, weights: Option<&[i32]>) -> Option<Vec<u32>> {
        // METIS seeds and draws from the C library's one global generator: two
        // threads at once would disturb each other's numbers.
        static ONE_AT_A_TIME: std::sync::Mutex<()> = std::sync::Mutex::new(());
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let start: Vec<i32> = self.start.iter().map(|&s| s as i32).collect();
        let neighbours: Vec<i32> = self.neighbours.iter().map(|&s| s as i32).collect();
        let graph = metis::Graph::new(1, parts as i32, &start, &neighbours).ok()?;
        let graph = graph.set_option(metis::option::Seed(1));
        let graph = match weights {
            Some(w) => graph.set_vwgt(w),
            None => graph,
        };
        let mut part = vec![0; self.len()];
        graph.part_kway(&mut part).ok()?;
        Some(part.into_iter().map(|p| p as u32).collect())
    }
}

/// Part of each cell of a volume grid.
///
/// # Errors
/// [`MeshError::TooManyParts`].
pub fn partition_cells(cells: usize, faces: &FaceTable, parts: usize) -> Result<Vec<u32>, MeshError> {
    Graph::of_cells(cells, faces).partition(parts, None)
}

/// Part of each node of a structure, weighted by the elements around it.
///
/// # Errors
/// [`MeshError::TooManyParts`] if there are fewer elements than parts.
pub fn partition_structure(mesh: &StructureMesh, parts: usize) -> Result<Vec<u32>, MeshError> {
    let elements = mesh.triangles.len() + mesh.cables.len();
    if parts > elements {
        return Err(MeshError::TooManyParts { parts, elements });
    }
    let mut weights = vec![1i32; mesh.coords.len()];
    let nodes = mesh.triangles.iter().flatten().chain(mesh.cables.iter().flat_map(|c| &c.nodes));
    nodes.for_each(|&n| weights[n as usize] += 1);
    Graph::of_structure(mesh).partition(parts, Some(&weights))
}

/// Owner of each node, from the parts of its cells: the part that most of them
/// have, the lower one on a tie.
pub fn node_parts(nodes: usize, cells: &[[u32; 8]], cell_parts: &[u32]) -> Vec<u32> {
    let mut votes: Vec<Vec<(u32, u32)>> = vec![Vec::new(); nodes];
    for (cell, &part) in cells.iter().zip(cell_parts) {
        for (i, &n) in cell.iter().enumerate() {
            if cell[..i].contains(&n) {
                continue;
            }
            let list = &mut votes[n as usize];
            match list.iter_mut().find(|v| v.0 == part) {
                Some(v) => v.1 += 1,
                None => list.push((part, 1)),
            }
        }
    }
    let winner =
        |v: Vec<(u32, u32)>| v.into_iter().max_by_key(|&(p, c)| (c, u32::MAX - p)).map_or(0, |v| v.0);
    votes.into_iter().map(winner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Patch, box_grid};

    fn bandwidth(graph: &Graph, order: &[u32]) -> usize {
        let mut place = vec![0usize; order.len()];
        order.iter().enumerate().for_each(|(i, &v)| place[v as usize] = i);
        (0..graph.len())
            .flat_map(|v| graph.of(v).iter().map(move |&w| (v, w as usize)))
            .map(|(v, w)| place[v].abs_diff(place[w]))
            .max()
            .unwrap_or(0)
    }

    #[test]
    fn partitions_are_balanced_and_deterministic() {
        let grid = box_grid([10, 9, 8], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let faces = FaceTable::new(&grid).unwrap();
        for parts in [1, 2, 3, 5, 16] {
            let part = partition_cells(720, &faces, parts).unwrap();
            assert_eq!(part, partition_cells(720, &faces, parts).unwrap());
            for p in 0..parts {
                let share = part.iter().filter(|&&q| q as usize == p).count() * parts;
                // METIS k-way promises 3 %; whole cells of small parts round up.
                assert!((600..=840).contains(&share), "part {p} of {parts}: {share}");
            }
            // Far fewer cut faces than if cells were dealt out.
            let cut = faces.interior.iter().filter(|f| part[f.1 as usize] != part[f.2 as usize]).count();
            assert!(parts > 1 || cut == 0);
            assert!(cut < 2 * 90 * parts, "{cut} faces cut for {parts} parts");
        }
    }

    #[test]
    fn more_parts_than_elements_are_rejected() {
        let grid = box_grid([2, 2, 1], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let faces = FaceTable::new(&grid).unwrap();
        assert!(matches!(
            partition_cells(4, &faces, 5),
            Err(MeshError::TooManyParts { parts: 5, elements: 4 })
        ));
        let mut all = partition_cells(4, &faces, 4).unwrap();
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3]);
    }

    #[test]
    fn cuthill_mckee_reduces_the_bandwidth_of_a_shuffled_chain() {
        // A path numbered by steps of 7 modulo 100, and a second component.
        let pairs = (0..99).map(|i| [i * 7 % 100, (i + 1) * 7 % 100]).chain([[100, 101]]);
        let graph = Graph::from_pairs(102, pairs);
        let order = graph.cuthill_mckee();
        assert_eq!(bandwidth(&graph, &order), 1);
        let mut sorted = order;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..102));
    }

    #[test]
    fn nodes_belong_to_a_part_of_their_cells() {
        let grid = box_grid([4, 1, 1], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let owners = node_parts(grid.coords.len(), &grid.cells, &[0, 0, 1, 1]);
        assert_eq!(&owners[..5], &[0, 0, 0, 1, 1]);
    }

    #[test]
    fn every_structure_node_has_an_owner() {
        let scene = crate::structure::tests::scene(case::Canopy::Atps(case::Atps::default()));
        let mesh = crate::structure_mesh(&scene).unwrap();
        let part = partition_structure(&mesh, 3).unwrap();
        for p in 0..3 {
            let share = 3 * part.iter().filter(|&&q| q == p).count();
            assert!(share.abs_diff(part.len()) < part.len() / 10);
        }
    }
}
