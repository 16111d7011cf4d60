//! Topology of the canopy snapshots: triangles, edges, lines and openings.

use std::collections::HashMap;

use mesh::vtk::read::Piece;

/// Topology of the snapshots of a run.
#[derive(Clone, PartialEq)]
pub(super) struct Shape {
    /// Number of nodes of canopy and lines.
    pub(super) nodes: usize,
    /// Triangles of the fabric; polygons are split into triangles.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Cell of the snapshot that contains each triangle.
    pub(super) cell: Vec<usize>,
    /// Boundary edges of the fabric, with the orientation of their triangle.
    pub(super) hem: Vec<[u32; 2]>,
    /// Elements of lines, risers, reinforcements and tapes.
    pub(super) cables: Vec<[u32; 2]>,
    /// Kind of each cable: 0 suspension line, 1 riser, 2 reinforcement, 3 to 6 tapes.
    pub(super) kind: Vec<u8>,
    /// Line number of each cable element.
    pub(super) line: Vec<u32>,
    /// Closed polygons of nodes around the openings, including the skirt.
    pub(super) loops: Vec<Vec<u32>>,
}

impl Shape {
    /// Topology of a snapshot.
    pub(super) fn of(canopy: &Piece, lines: Option<&Piece>) -> Self {
        let mut triangles = Vec::new();
        let mut cell = Vec::new();
        for c in 0..canopy.n_cells() {
            if let [first, rest @ ..] = canopy.cell(c) {
                for pair in rest.windows(2) {
                    triangles.push([*first, pair[0], pair[1]]);
                    cell.push(c);
                }
            }
        }
        let column = |name: &str| {
            let found = lines.and_then(|l| l.cell_field(name));
            found.map(|c| c.values.clone()).unwrap_or_default()
        };
        let cables: Vec<[u32; 2]> = lines
            .iter()
            .flat_map(|l| (0..l.n_cells()).filter_map(|c| <[u32; 2]>::try_from(l.cell(c)).ok()))
            .collect();
        let padded = |name: &str| {
            let mut values = column(name);
            values.resize(cables.len(), 0.0);
            values
        };
        let hem = hem(&triangles);
        Self {
            nodes: lines.map_or(canopy.points.len(), |l| l.points.len()),
            loops: loops(&hem),
            kind: padded("kind").iter().map(|k| *k as u8).collect(),
            line: padded("line").iter().map(|k| *k as u32).collect(),
            triangles,
            cell,
            hem,
            cables,
        }
    }
}

/// Directed edges that belong to one triangle only.
fn hem(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    let edges = || triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    for [a, b] in edges() {
        *count.entry([a.min(b), a.max(b)]).or_default() += 1;
    }
    edges().filter(|&[a, b]| count[&[a.min(b), a.max(b)]] == 1).collect()
}

/// The boundary edges as closed polygons. A node shared by two openings occurs twice.
fn loops(hem: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut next: HashMap<u32, Vec<u32>> = HashMap::new();
    for &[a, b] in hem {
        next.entry(a).or_default().push(b);
    }
    let mut found = Vec::new();
    for &[start, _] in hem {
        let mut row = Vec::new();
        let mut at = start;
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            row.push(at);
            at = to;
            if at == start {
                break;
            }
        }
        if row.len() > 2 && at == start {
            found.push(row);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheet_with_a_hole_has_two_boundary_loops() {
        // A 3 x 3 lattice of squares without the middle one.
        let node = |i: u32, j: u32| 4 * j + i;
        let mut triangles = Vec::new();
        for j in 0..3 {
            for i in 0..3 {
                if (i, j) != (1, 1) {
                    let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        let hem = hem(&triangles);
        let mut sizes: Vec<usize> = loops(&hem).iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!((hem.len(), sizes), (16, vec![4, 12]));
    }
}
