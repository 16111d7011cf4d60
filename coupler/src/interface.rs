//! The canopy between structure and flow: shape, masses, work of loads.

use case::Scene;
use channel::LOAD_WIDTH;
use mesh::{CableKind, StructureMesh, Vec3};

use crate::error::RunError;

/// The interface as the coupler knows it, built from the scene as every program does.
pub struct CanopyInterface {
    /// Unstressed positions of the interface nodes, m.
    pub coords: Vec<Vec3>,
    /// Interface faces.
    pub faces: Vec<[u32; 4]>,
    /// Panel of each interface node (the last of its faces), for messages.
    pub panels: Vec<u32>,
    /// Masses of fabric and lines, kg.
    pub masses: Masses,
    /// Sizes of the structure mesh, for reports.
    pub sizes: Sizes,
}

/// Masses of the parts of the parachute, kg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Masses {
    /// Fabric.
    pub fabric: f64,
    /// Lines, risers and reinforcements.
    pub cables: f64,
    /// Point masses, without the payload.
    pub points: f64,
}

impl Masses {
    /// All that hangs on the payload.
    pub fn hung(&self) -> f64 {
        self.fabric + self.cables + self.points
    }
}

/// Sizes of the structure mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// All nodes.
    pub nodes: usize,
    /// Membrane triangles.
    pub triangles: usize,
    /// Cable elements.
    pub cables: usize,
    /// Fabric area, m2.
    pub fabric_area: f64,
}

impl CanopyInterface {
    /// From a scene.
    ///
    /// # Errors
    /// [`RunError::Input`] if its parameters make no canopy.
    pub fn new(scene: &Scene) -> Result<Self, RunError> {
        let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
        let masses = masses(scene, &mesh);
        let sizes = Sizes {
            nodes: mesh.coords.len(),
            triangles: mesh.triangles.len(),
            cables: mesh.cables.len(),
            fabric_area: mesh.fabric_area(|_| true),
        };
        let mut coords = mesh.coords;
        coords.truncate(mesh.n_canopy);
        let mut panels = vec![0; coords.len()];
        for (face, &panel) in mesh.faces.iter().zip(&mesh.face_panel) {
            face.iter().for_each(|&a| panels[a as usize] = panel);
        }
        Ok(Self { coords, faces: mesh.faces, panels, masses, sizes })
    }

    /// Interface nodes.
    pub fn nodes(&self) -> usize {
        self.coords.len()
    }

    /// Vertical force (N) of `load` (`[faces][LOAD_WIDTH]`, Pa) on the shape with `displacement` (`[nodes][3]`, m).
    pub fn vertical_force(&self, load: &[f64], displacement: &[f64]) -> f64 {
        let position = |node: u32| -> Vec3 {
            let n = node as usize;
            std::array::from_fn(|i| self.coords[n][i] + displacement[3 * n + i])
        };
        let faces = self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH));
        faces.map(|(face, load)| face_force(&face.map(position), load)[2]).sum()
    }

    /// Work (J) that `load` (`[faces][LOAD_WIDTH]`, Pa, on the shape at the end)
    /// does on the motion from displacement `start` to `end` (`[nodes][3]`, m).
    /// A face's force is shared equally by its corners.
    pub fn work(&self, load: &[f64], start: &[f64], end: &[f64]) -> f64 {
        let moved = |node: u32, i: usize| {
            let at = 3 * node as usize + i;
            end[at] - start[at]
        };
        let position = |node: u32| -> Vec3 {
            std::array::from_fn(|i| self.coords[node as usize][i] + end[3 * node as usize + i])
        };
        self.faces
            .iter()
            .zip(load.chunks_exact(LOAD_WIDTH))
            .map(|(face, load)| {
                let force = face_force(&face.map(position), load);
                let corners = if face[2] == face[3] { 3 } else { 4 };
                (0..3)
                    .map(|i| {
                        let mean = face[..corners].iter().map(|&n| moved(n, i)).sum::<f64>() / corners as f64;
                        force[i] * mean
                    })
                    .sum::<f64>()
            })
            .sum()
    }

    /// Mean pressure jump (Pa) of `load` (`[faces][LOAD_WIDTH]`, Pa) over the canopy displaced by
    /// `displacement` (`[nodes][3]`, m), weighted by area; `None` where there is no area.
    pub fn mean_pressure(&self, load: &[f64], displacement: &[f64]) -> Option<f64> {
        let position = |node: u32| -> Vec3 {
            let n = node as usize;
            std::array::from_fn(|i| self.coords[n][i] + displacement[3 * n + i])
        };
        let (mut force, mut area) = (0.0, 0.0);
        for (face, load) in self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH)) {
            let size = area_vector(&face.map(position)).iter().map(|a| a * a).sum::<f64>().sqrt();
            force += load[0] * size;
            area += size;
        }
        (area > 0.0).then(|| force / area)
    }
}

/// Force (N) of pressure jump and traction on a face: area vector is half the
/// cross product of the diagonals (exact for triangles that repeat a node).
fn face_force(corners: &[Vec3; 4], load: &[f64]) -> Vec3 {
    let area = area_vector(corners);
    let size = area.iter().map(|a| a * a).sum::<f64>().sqrt();
    std::array::from_fn(|i| load[0] * area[i] + load[1 + i] * size)
}

/// Area vector (m2) of a face.
fn area_vector(corners: &[Vec3; 4]) -> Vec3 {
    let d1: Vec3 = std::array::from_fn(|i| corners[2][i] - corners[0][i]);
    let d2: Vec3 = std::array::from_fn(|i| corners[3][i] - corners[1][i]);
    [
        0.5 * (d1[1] * d2[2] - d1[2] * d2[1]),
        0.5 * (d1[2] * d2[0] - d1[0] * d2[2]),
        0.5 * (d1[0] * d2[1] - d1[1] * d2[0]),
    ]
}

fn masses(scene: &Scene, mesh: &StructureMesh) -> Masses {
    let fabric = mesh.fabric_area(|_| true) * scene.fabric.thickness_m * scene.fabric.density_kg_m3;
    let cables = scene.lines.as_ref().map_or(0.0, |lines| {
        let kinds = [CableKind::SuspensionLine, CableKind::Riser, CableKind::Reinforcement];
        let length: f64 = kinds.into_iter().map(|k| mesh.cable_length(k)).sum();
        length * lines.area_m2 * lines.density_kg_m3
    });
    Masses { fabric, cables, points: mesh.hung_point_masses(scene) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> CanopyInterface {
        CanopyInterface {
            coords: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
            faces: vec![[0, 1, 2, 3]],
            panels: vec![0; 4],
            masses: Masses { fabric: 0.0, cables: 0.0, points: 0.0 },
            sizes: Sizes { nodes: 4, triangles: 2, cables: 0, fabric_area: 4.0 },
        }
    }

    #[test]
    fn work_is_force_times_motion() {
        let still = [0.0; 12];
        let mut up = still;
        (0..4).for_each(|n| up[3 * n + 2] = 0.5);
        // 10 Pa on 4 m2 over 0.5 m, along the normal; shear of 3 Pa along x does none.
        assert!((square().work(&[10.0, 3.0, 0.0, 0.0], &still, &up) - 20.0).abs() < 1e-12);
        let mut along = still;
        (0..4).for_each(|n| along[3 * n] = 0.5);
        assert!((square().work(&[10.0, 3.0, 0.0, 0.0], &still, &along) - 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_triangle_repeats_its_last_node() {
        let mut one = square();
        one.faces = vec![[0, 1, 2, 2]];
        let still = [0.0; 12];
        let mut up = still;
        (0..3).for_each(|n| up[3 * n + 2] = 0.3);
        assert!((one.work(&[10.0, 0.0, 0.0, 0.0], &still, &up) - 10.0 * 2.0 * 0.3).abs() < 1e-12);
    }

    #[test]
    fn masses_of_the_paper() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/atps-descent/scene.toml");
        let canopy = CanopyInterface::new(&case::load(&file).unwrap()).unwrap();
        // DESIGN.md section 6: fabric 5.216 kg, cables 0.701 kg.
        assert!((canopy.masses.fabric - 5.216).abs() < 5e-4, "{:?}", canopy.masses);
        assert!((canopy.masses.cables - 0.701).abs() < 5e-4, "{:?}", canopy.masses);
    }
}
