//! Periodic patches: pairs of them that are the same but for a translation.

use std::collections::HashMap;

use crate::faces::{FaceNodes, key};
use crate::geometry::{Point, Vec3, at, distinct};
use crate::{FlowGrid, MeshError, Patch};

/// Translations that a grid has at most: one for each direction of space.
const MAX_PERIODS: usize = 3;

/// Nodes of a pair may be off by this share of the shortest edge of its faces. Both copies of a face have areas of their own, so that mass is
/// conserved to this share.
const NEAR: f64 = 1e-6;

/// Faces of periodic patches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PeriodicFaces {
    /// Translations from the first to the second patch of the pairs, m; pairs with the same one share it.
    pub periods: Vec<Point>,
    /// All faces.
    pub faces: Vec<PeriodicFace>,
}

/// A face of the first patch of a pair and the same face of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodicFace {
    /// Place of the translation among [`PeriodicFaces::periods`].
    pub period: usize,
    /// Cells at the first and at the second patch. The translation moves the face of the first to that of the second.
    pub cells: [u32; 2],
    /// Nodes of the two faces. Both normals point along the normal of the first patch out of the domain: from the first cell to the second.
    pub nodes: [FaceNodes; 2],
}

/// The faces of all pairs of `grid`, of which `boundary` lists condition, nodes and cell.
///
/// # Errors
/// [`MeshError::Periodic`].
pub(crate) fn paired(
    grid: &FlowGrid,
    boundary: &[(Patch, FaceNodes, u32)],
) -> Result<PeriodicFaces, MeshError> {
    let mut all = PeriodicFaces::default();
    for &patches in &grid.periodic {
        let pair = Pair { grid, boundary, patches };
        let fail = |reason| MeshError::Periodic { patches: patches.map(|p| pair.name(p)), reason };
        pair.add(&mut all).map_err(fail)?;
    }
    let listed = grid.periodic.as_flattened();
    let alone = (0..boundary.len()).find(|&k| {
        boundary[k].0 == Patch::Periodic && !grid.boundary_patch.get(k).is_some_and(|p| listed.contains(p))
    });
    match alone {
        None => Ok(all),
        Some(k) => {
            let name = grid.patch_name(k).unwrap_or("without a name").to_string();
            let reason = format!("face {k} of the boundary is in no pair");
            Err(MeshError::Periodic { patches: [name, String::new()], reason })
        }
    }
}

/// Two patches that are to be the same but for a translation.
struct Pair<'a> {
    grid: &'a FlowGrid,
    boundary: &'a [(Patch, FaceNodes, u32)],
    patches: [u16; 2],
}

impl Pair<'_> {
    fn name(&self, patch: u16) -> String {
        self.grid.patch_names.get(usize::from(patch)).cloned().unwrap_or_default()
    }

    /// Faces of a patch, as their places on the boundary.
    fn faces_of(&self, patch: u16) -> Vec<usize> {
        (0..self.boundary.len()).filter(|&k| self.grid.boundary_patch.get(k) == Some(&patch)).collect()
    }

    /// Nodes of faces, each once.
    fn nodes_of(&self, faces: &[usize]) -> Vec<u32> {
        let mut nodes: Vec<u32> = faces.iter().flat_map(|&k| self.boundary[k].1).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    fn at(&self, node: u32) -> Vec3 {
        at(&self.grid.coords, node)
    }

    fn mean(&self, nodes: &[u32]) -> Vec3 {
        nodes.iter().map(|&n| self.at(n)).sum::<Vec3>() / nodes.len().max(1) as f64
    }

    fn shortest_edge(&self, faces: &[usize]) -> f64 {
        let edges = faces.iter().flat_map(|&k| {
            let nodes = distinct(&self.boundary[k].1).to_vec();
            (0..nodes.len()).map(move |i| [nodes[i], nodes[(i + 1) % nodes.len()]]).collect::<Vec<_>>()
        });
        edges.map(|[a, b]| (self.at(a) - self.at(b)).norm()).fold(f64::INFINITY, f64::min)
    }

    fn add(&self, all: &mut PeriodicFaces) -> Result<(), String> {
        let faces = self.patches.map(|p| self.faces_of(p));
        let [a, b] = [&faces[0], &faces[1]];
        if a.is_empty() || a.len() != b.len() {
            return Err(format!(
                "they have {} and {} faces; mesh one as a copy of the other (Gmsh: Periodic Surface)",
                a.len(),
                b.len()
            ));
        }
        let nodes = [self.nodes_of(a), self.nodes_of(b)];
        let touching = nodes.iter().flatten().find(|n| self.grid.canopy_nodes.contains(n));
        if let Some(&n) = touching {
            return Err(format!("the canopy touches them at {}; put cells between", place(self.at(n))));
        }
        let period = self.mean(&nodes[1]) - self.mean(&nodes[0]);
        let near = NEAR * self.shortest_edge(a);
        let partner = self.partners(&nodes, period, near)?;
        let second: HashMap<FaceNodes, usize> = b.iter().map(|&k| (key(self.boundary[k].1), k)).collect();
        let index = self.number_of(period, near, all)?;
        for &k in a {
            let (_, first, cell) = self.boundary[k];
            let moved = first.map(|n| partner[&n]);
            let Some(&other) = second.get(&key(moved)) else {
                let middle = self.mean(distinct(&first));
                return Err(format!(
                    "the face at {} of the first is none of the second; mesh one as a copy of the other (Gmsh: Periodic Surface)",
                    place(middle)
                ));
            };
            let cells = [cell, self.boundary[other].2];
            all.faces.push(PeriodicFace { period: index, cells, nodes: [first, moved] });
        }
        Ok(())
    }

    /// The node of the second patch at the translated place of each node of the first.
    fn partners(&self, nodes: &[Vec<u32>; 2], period: Vec3, near: f64) -> Result<HashMap<u32, u32>, String> {
        // Boxes as wide as the tolerance, with their neighbours, hold all that is near.
        let bin = |x: Vec3| -> [i64; 3] { (x / (2.0 * near)).map(|v| v.floor() as i64).into() };
        let mut bins: HashMap<[i64; 3], u32> = HashMap::new();
        for &n in &nodes[1] {
            bins.insert(bin(self.at(n)), n);
        }
        let find = |x: Vec3| {
            let [i, j, k] = bin(x);
            let around = (0..27).map(|m| [i + m % 3 - 1, j + m / 3 % 3 - 1, k + m / 9 - 1]);
            around.filter_map(|b| bins.get(&b)).copied().find(|&n| (self.at(n) - x).norm() <= near)
        };
        let of = |&n: &u32| {
            let x = self.at(n) + period;
            find(x).map(|m| (n, m)).ok_or_else(|| {
                format!(
                    "the node at {} of the first has no partner at {}; the second must be the first, translated by {} m, node by node \
                     (a rotation is not supported)",
                    place(self.at(n)), place(x), place(period)
                )
            })
        };
        nodes[0].iter().map(of).collect()
    }

    /// Number of a translation among all, which may be new.
    fn number_of(&self, period: Vec3, near: f64, all: &mut PeriodicFaces) -> Result<usize, String> {
        if period.norm() <= near {
            return Err("they lie at the same place".into());
        }
        if let Some(known) = all.periods.iter().position(|p| (Vec3::from(*p) - period).norm() <= near) {
            return Ok(known);
        }
        if all.periods.len() == MAX_PERIODS {
            return Err(format!("{} is a fourth translation; a grid has at most three", place(period)));
        }
        all.periods.push(period.into());
        Ok(all.periods.len() - 1)
    }
}

fn place(x: Vec3) -> String {
    format!("({:.6}, {:.6}, {:.6})", x[0], x[1], x[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxShape, FaceTable, box_grid_of};

    const SIDES: [Patch; 6] =
        [Patch::Periodic, Patch::Periodic, Patch::Wall, Patch::Wall, Patch::Periodic, Patch::Periodic];

    fn grid(shape: BoxShape) -> FlowGrid {
        box_grid_of(shape, [3, 2, 4], [0.5, 0.0, -1.0], [2.0, 1.0, 3.0], SIDES)
    }

    fn reason(grid: &FlowGrid) -> String {
        match FaceTable::new(grid) {
            Err(e @ MeshError::Periodic { .. }) => e.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn opposite_sides_of_a_box_are_paired_face_by_face() {
        for (shape, across) in [
            (BoxShape::Hexahedra, 1),
            (BoxShape::Prisms, 1),
            (BoxShape::Pyramids, 1),
            (BoxShape::Tetrahedra, 2),
        ] {
            let grid = grid(shape);
            let table = FaceTable::new(&grid).unwrap();
            let [x, z] = [table.periodic.periods[0], table.periodic.periods[1]].map(Vec3::from);
            assert!((x - Vec3::new(1.5, 0.0, 0.0)).norm() + (z - Vec3::new(0.0, 0.0, 4.0)).norm() < 1e-14);
            let prisms = if shape == BoxShape::Prisms { 2 } else { across };
            assert_eq!(table.periodic.faces.len(), across * 2 * 4 + prisms * 3 * 2, "{shape:?}");
            for f in &table.periodic.faces {
                let period = Vec3::from(table.periodic.periods[f.period]);
                for (a, b) in f.nodes[0].iter().zip(&f.nodes[1]) {
                    assert!((at(&grid.coords, *a) + period - at(&grid.coords, *b)).norm() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn patches_that_are_no_pair_are_refused() {
        let mut moved = grid(BoxShape::Hexahedra);
        moved.coords[4][1] += 0.05;
        assert!(reason(&moved).contains("has no partner at"), "{}", reason(&moved));
        let mut alone = grid(BoxShape::Hexahedra);
        alone.periodic.pop();
        assert!(reason(&alone).contains("is in no pair"), "{}", reason(&alone));
        let mut unlike = grid(BoxShape::Hexahedra);
        unlike.periodic[0][1] = 2;
        assert!(reason(&unlike).contains("they have 8 and 12 faces"), "{}", reason(&unlike));
        let mut canopy = grid(BoxShape::Hexahedra);
        canopy.canopy_nodes.push(0);
        assert!(reason(&canopy).contains("the canopy touches"), "{}", reason(&canopy));
    }
}
