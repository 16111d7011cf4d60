//! The canopy as a triangulated surface.

use std::ops::Range;

use channel::LOAD_WIDTH;
use immersed::free_edges::free_edges;
use mesh::StructureMesh;
use nalgebra::Vector3;

use super::forces::LoadedFace;

/// Least area vector of a face, in units of its unfolded area, that a load refers to.
const LEAST_OPENING: f64 = 0.25;

/// Faces of the canopy as triangles. A face of four nodes is four triangles around the mean of its corners, as in the contract.
#[derive(Clone, Debug)]
pub struct CanopySurface {
    faces: Vec<[u32; 4]>,
    n_nodes: usize,
    /// Nodes of each triangle; those from the number of canopy nodes on are means of faces.
    pub triangles: Vec<[u32; 3]>,
    /// Face of each triangle.
    pub face_of: Vec<u32>,
    /// Nodes of the edges that belong to one face only.
    pub free_edges: Vec<[u32; 2]>,
    /// Faces of four nodes.
    quads: Vec<u32>,
}

impl CanopySurface {
    /// Of the canopy of a structure.
    pub fn new(structure: &StructureMesh) -> Self {
        let mut surface = Self {
            faces: structure.faces.clone(),
            n_nodes: structure.n_canopy,
            triangles: Vec::new(),
            face_of: Vec::new(),
            free_edges: Vec::new(),
            quads: Vec::new(),
        };
        for (f, &[a, b, c, d]) in structure.faces.iter().enumerate() {
            if c == d {
                surface.triangles.push([a, b, c]);
            } else {
                let middle = (surface.n_nodes + surface.quads.len()) as u32;
                surface.quads.push(f as u32);
                surface.triangles.extend([[a, b, middle], [b, c, middle], [c, d, middle], [d, a, middle]]);
            }
            surface.face_of.resize(surface.triangles.len(), f as u32);
        }
        surface.free_edges = free_edges(&surface.triangles);
        surface
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.faces.len()
    }

    fn corners<'a>(&self, face: u32, values: &'a [Vector3<f64>]) -> impl Iterator<Item = &'a Vector3<f64>> {
        let [a, b, c, d] = self.faces[face as usize];
        let count = if c == d { 3 } else { 4 };
        [a, b, c, d].into_iter().take(count).map(|n| &values[n as usize])
    }

    fn mean(&self, face: u32, values: &[Vector3<f64>]) -> Vector3<f64> {
        let (sum, count) =
            self.corners(face, values).fold((Vector3::zeros(), 0.0), |(sum, n), x| (sum + x, n + 1.0));
        sum / count
    }

    /// Positions of the triangles' nodes from those of the canopy's, less `origin`.
    pub fn vertices(&self, nodes: &[Vector3<f64>], origin: Vector3<f64>) -> Vec<Vector3<f64>> {
        let middles = self.quads.iter().map(|f| self.mean(*f, nodes));
        nodes.iter().copied().chain(middles).map(|x| x - origin).collect()
    }

    /// Mean of the nodes of each face.
    pub fn means(&self, nodes: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        (0..self.faces.len() as u32).map(|f| self.mean(f, nodes)).collect()
    }

    /// Area vector of a face, m2: half the cross product of its diagonals.
    fn area(&self, face: usize, nodes: &[Vector3<f64>]) -> Vector3<f64> {
        let [a, b, c, d] = self.faces[face].map(|n| nodes[n as usize]);
        if self.faces[face][2] == self.faces[face][3] {
            0.5 * (b - a).cross(&(c - a))
        } else {
            0.5 * (c - a).cross(&(d - b))
        }
    }

    /// Middle, area vector (m2) and force (N) of each face.
    pub fn loaded_faces(&self, nodes: &[Vector3<f64>], forces: &[Vector3<f64>]) -> Vec<LoadedFace> {
        let middles = self.means(nodes).into_iter().zip(forces).enumerate();
        middles.map(|(f, (middle, force))| (middle, self.area(f, nodes), *force)).collect()
    }

    /// Area of a face as its triangles have it, m2.
    fn unfolded_area(&self, face: usize, nodes: &[Vector3<f64>]) -> f64 {
        let [a, b, c, d] = self.faces[face].map(|n| nodes[n as usize]);
        let of = |x: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>| 0.5 * (y - x).cross(&(z - x)).norm();
        if self.faces[face][2] == self.faces[face][3] {
            return of(a, b, c);
        }
        let middle = 0.25 * (a + b + c + d);
        of(a, b, middle) + of(b, c, middle) + of(c, d, middle) + of(d, a, middle)
    }

    /// Pressure jump and traction, Pa, of some faces from the forces on all, N; `load` is `[faces][LOAD_WIDTH]`. A face that is folded in two has
    /// an area vector near zero: below [`LEAST_OPENING`] of its unfolded area the load is that on this share of the area.
    pub fn loads(
        &self,
        faces: Range<usize>,
        nodes: &[Vector3<f64>],
        forces: &[Vector3<f64>],
        load: &mut [f64],
    ) {
        for (f, row) in faces.zip(load.chunks_exact_mut(LOAD_WIDTH)) {
            let force = forces[f];
            let area = self.area(f, nodes);
            let size = area.norm().max(LEAST_OPENING * self.unfolded_area(f, nodes));
            if size <= 0.0 {
                row.fill(0.0);
                continue;
            }
            row[0] = force.dot(&area) / (size * size);
            let traction =
                (force - area * (force.dot(&area) / area.norm_squared().max(f64::MIN_POSITIVE))) / size;
            row[1..].copy_from_slice(traction.as_slice());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Load and area give back the force, on a bent face of four nodes and on a triangle.
    #[test]
    fn loads_have_the_forces() {
        let nodes: Vec<_> =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [1.2, 0.9, 0.0], [0.0, 1.0, 0.3]].map(Vector3::from).into();
        let structure = StructureMesh {
            faces: vec![[0, 1, 2, 3], [0, 1, 2, 2]],
            n_canopy: 4,
            ..StructureMesh::default()
        };
        let surface = CanopySurface::new(&structure);
        assert_eq!((surface.triangles.len(), surface.face_of.clone()), (5, vec![0, 0, 0, 0, 1]));
        assert_eq!(surface.free_edges, [[2, 3], [3, 0], [2, 0]]);
        assert_eq!(surface.vertices(&nodes, Vector3::zeros()).len(), 5);
        let forces = vec![Vector3::new(1.0, -2.0, 5.0), Vector3::new(0.3, 0.0, -1.0)];
        let mut load = vec![0.0; 8];
        surface.loads(0..2, &nodes, &forces, &mut load);
        for f in 0..2 {
            let area = surface.area(f, &nodes);
            let row = &load[4 * f..4 * f + 4];
            let back = area * row[0] + Vector3::new(row[1], row[2], row[3]) * area.norm();
            assert!((back - forces[f]).norm() < 1e-12, "{back}");
        }
    }
}
