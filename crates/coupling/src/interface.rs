//! The interface between structure and flow: geometry of the canopy, masses, work of loads.

use std::collections::BTreeSet;

use case::{Scene, TapePlace};
use channel::LOAD_WIDTH;
use mesh::{CableKind, StructureMesh};

use crate::error::RunError;
use crate::geometry::{Vec3, at, centre, face_force, quad_area_vector};

/// The interface as the coupler knows it; every program builds the same one from the scene.
///
/// # Examples
///
/// ```
/// # use std::path::Path;
/// use coupling::interface::CanopyInterface;
///
/// let scene = case::load(Path::new("../../cases/square-drop/scene.toml"))?;
/// let canopy = CanopyInterface::new(&scene)?;
/// assert_eq!(canopy.nodes(), 13 * 13);
/// // 4 m2 of fabric of 30.48 um and 1223.5 kg/m3.
/// assert!((canopy.masses.fabric - 4.0 * 3.048e-5 * 1223.5093).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CanopyInterface {
    /// Unstressed positions of the interface nodes, m.
    pub coords: Vec<mesh::Point>,
    /// Interface faces.
    pub faces: Vec<[u32; 4]>,
    /// Panel of each interface node (the last of its faces), for messages.
    pub panels: Vec<u32>,
    /// Position of the payload, m, where it is one node at rest in the frame.
    pub payload: Option<mesh::Point>,
    /// Masses of fabric and lines, kg.
    pub masses: Masses,
    /// Sizes of the structure mesh, for reports.
    pub sizes: Sizes,
}

/// Masses of the parts of the parachute, kg.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Masses {
    /// Fabric.
    pub fabric: f64,
    /// Lines, risers, reinforcements and tapes.
    pub cables: f64,
    /// Of them the suspension lines.
    pub lines: f64,
    /// Of them the risers.
    pub risers: f64,
    /// Of them the line elements of `canopy.reinforcements` or of a mesh file.
    pub reinforcements: f64,
    /// Of them the tapes, in the order of [`TapePlace::ALL`].
    pub tapes: [f64; 4],
    /// Point masses, without the payload.
    pub points: f64,
}

impl Masses {
    /// Mass of everything suspended above the payload, kg.
    pub fn suspended(&self) -> f64 {
        self.fabric + self.cables + self.points
    }

    /// Mass of all tapes, kg.
    pub fn all_tapes(&self) -> f64 {
        self.tapes.iter().sum()
    }

    /// The parts that have a mass, in words and kg.
    pub fn parts(&self) -> Vec<(String, f64)> {
        let mut parts = vec![("fabric".to_owned(), self.fabric), ("lines".to_owned(), self.lines)];
        parts.push(("risers".into(), self.risers));
        parts.push(("reinforcements".into(), self.reinforcements));
        let tapes = TapePlace::ALL.into_iter().zip(self.tapes);
        parts.extend(tapes.map(|(place, mass)| (format!("tapes.{}", place.name()), mass)));
        parts.push(("point masses".into(), self.points));
        parts.retain(|(_, mass)| *mass > 0.0);
        parts
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
    /// Risers.
    pub risers: usize,
    /// Fabric area, m2.
    pub fabric_area: f64,
}

impl CanopyInterface {
    /// From a scene.
    ///
    /// # Errors
    /// [`RunError::Input`] if the parameters do not define a canopy.
    pub fn new(scene: &Scene) -> Result<Self, RunError> {
        let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
        let masses = masses(scene, &mesh);
        let risers = mesh.cables.iter().filter(|c| c.kind == CableKind::Riser).map(|c| c.line);
        let sizes = Sizes {
            nodes: mesh.coords.len(),
            triangles: mesh.triangles.len(),
            cables: mesh.cables.len(),
            risers: risers.collect::<BTreeSet<_>>().len(),
            fabric_area: mesh.fabric_area(|_| true),
        };
        let payload = payload(scene, &mesh);
        let mut coords = mesh.coords;
        coords.truncate(mesh.n_canopy);
        let mut panels = vec![0; coords.len()];
        for (face, &panel) in mesh.faces.iter().zip(&mesh.face_panel) {
            face.iter().for_each(|&a| panels[a as usize] = panel);
        }
        Ok(Self { coords, faces: mesh.faces, panels, payload, masses, sizes })
    }

    /// Name and node of each point of `[[output.point]]`: the interface node nearest to it in the unstressed shape.
    pub fn points(&self, scene: &Scene) -> Vec<(String, usize)> {
        let nearest = |at: [f64; 3]| {
            let distance = |x: &mesh::Point| (0..3).map(|i| (x[i] - at[i]).powi(2)).sum::<f64>();
            let nodes = self.coords.iter().map(distance).enumerate();
            nodes.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(node, _)| node)
        };
        scene.output.points.iter().map(|p| (p.name.clone(), nearest(p.at_m))).collect()
    }

    /// Interface nodes.
    pub fn nodes(&self) -> usize {
        self.coords.len()
    }

    /// Force (N) of `load` (`[faces][LOAD_WIDTH]`, Pa) on the shape with `displacement` (`[nodes][3]`, m).
    pub fn force(&self, load: &[f64], displacement: &[f64]) -> Vec3 {
        let faces = self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH));
        faces.map(|(face, load)| face_force(&quad_area_vector(self.corners(face, displacement)), load)).sum()
    }

    /// Moment (N m) of that force about the origin of the frame, each face's at its centre.
    pub fn moment(&self, load: &[f64], displacement: &[f64]) -> Vec3 {
        let faces = self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH));
        let moment = |(face, load): (&[u32; 4], &[f64])| {
            let corners = self.corners(face, displacement);
            centre(&corners).cross(&face_force(&quad_area_vector(corners), load))
        };
        faces.map(moment).sum()
    }

    /// Work (J) that `load` (`[faces][LOAD_WIDTH]`, Pa) does while the canopy moves straight from displacement `start`
    /// to `end` (`[nodes][3]`, m): pressure times the volume that the flow's wall sweeps (`wall_shares`); traction
    /// on the area at the end, shared equally by the corners.
    pub fn work(&self, load: &[f64], start: &[f64], end: &[f64]) -> f64 {
        self.works(load, start, end).sum()
    }

    /// The same of each face.
    pub fn works<'a>(
        &'a self,
        load: &'a [f64],
        start: &'a [f64],
        end: &'a [f64],
    ) -> impl Iterator<Item = f64> + 'a {
        let work = move |(face, load): (&[u32; 4], &[f64])| {
            let [from, to] = [start, end].map(|d| self.corners(face, d));
            let moved: [Vec3; 4] = std::array::from_fn(|n| to[n] - from[n]);
            let middle = std::array::from_fn(|n| 0.5 * (from[n] + to[n]));
            // The area is quadratic in time: Simpson's rule is exact.
            let rate =
                |x: &[Vec3; 4]| -> f64 { wall_shares(x).iter().zip(&moved).map(|(a, d)| a.dot(d)).sum() };
            let swept = (rate(&from) + 4.0 * rate(&middle) + rate(&to)) / 6.0;
            let corners = if face[2] == face[3] { 3 } else { 4 };
            let mean = moved[1..corners].iter().fold(moved[0], |sum, d| sum + d) / corners as f64;
            let area = quad_area_vector(to);
            load[0] * swept + area.norm() * Vec3::new(load[1], load[2], load[3]).dot(&mean)
        };
        self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH)).map(work)
    }

    /// Mean pressure jump (Pa) of `load` (`[faces][LOAD_WIDTH]`, Pa) over the canopy displaced by
    /// `displacement` (`[nodes][3]`, m), weighted by area; `None` where there is no area.
    pub fn mean_pressure(&self, load: &[f64], displacement: &[f64]) -> Option<f64> {
        let (mut force, mut area) = (0.0, 0.0);
        for (face, load) in self.faces.iter().zip(load.chunks_exact(LOAD_WIDTH)) {
            let size = quad_area_vector(self.corners(face, displacement)).norm();
            force += load[0] * size;
            area += size;
        }
        (area > 0.0).then(|| force / area)
    }

    /// Area (m2) of the shape with `displacement` (`[nodes][3]`, m).
    pub fn area(&self, displacement: &[f64]) -> f64 {
        self.faces.iter().map(|face| quad_area_vector(self.corners(face, displacement)).norm()).sum()
    }

    /// Area (m2) of the shape with `displacement` (`[nodes][3]`, m) projected on a horizontal plane: of the faces that look upwards.
    pub fn projected_area(&self, displacement: &[f64]) -> f64 {
        self.faces.iter().map(|face| quad_area_vector(self.corners(face, displacement))[2].max(0.0)).sum()
    }

    /// Angle (rad) between the vertical and the line from the payload to the centroid, by area, of the shape with `displacement`
    /// (`[nodes][3]`, m). `None` without a payload at rest in the frame.
    pub fn pendulum_angle(&self, displacement: &[f64]) -> Option<f64> {
        self.pendulum_axis(displacement).map(|axis| axis[0].hypot(axis[1]).atan2(axis[2]))
    }

    /// Components of that angle along x and y (rad): a vector as long as the angle, along the horizontal part of the line from the payload
    /// to the centroid.
    pub fn pendulum_components(&self, displacement: &[f64]) -> Option<[f64; 2]> {
        let [x, y, z]: [f64; 3] = self.pendulum_axis(displacement)?.into();
        let across = x.hypot(y);
        Some(if across > 0.0 { [x, y].map(|c| c / across * across.atan2(z)) } else { [0.0; 2] })
    }

    /// From the payload to the centroid of the shape, m.
    fn pendulum_axis(&self, displacement: &[f64]) -> Option<Vec3> {
        let payload = Vec3::from(self.payload?);
        let (mut sum, mut area) = (Vec3::zeros(), 0.0);
        for face in &self.faces {
            let corners = self.corners(face, displacement);
            let size = quad_area_vector(corners).norm();
            sum += size * centre(&corners);
            area += size;
        }
        (area > 0.0).then(|| sum / area - payload)
    }

    /// Corners of a face of the canopy with `displacement` (`[nodes][3]`), m.
    fn corners(&self, face: &[u32; 4], displacement: &[f64]) -> [Vec3; 4] {
        face.map(|n| Vec3::from(self.coords[n as usize]) + at(displacement, n))
    }
}

/// Area vectors (m2) by which the corners of a face carry a pressure on the flow's wall: four triangles around the
/// mean of the corners, each distributing one third of its area vector to its corners, the mean's part to all four;
/// one triangle where a node is repeated.
fn wall_shares(x: &[Vec3; 4]) -> [Vec3; 4] {
    if x[2] == x[3] {
        let third = quad_area_vector(*x) / 3.0;
        return [third, third, third, Vec3::zeros()];
    }
    let mean = 0.25 * x[1..].iter().fold(x[0], |sum, x| sum + x);
    let mut shares = [Vec3::zeros(); 4];
    for k in 0..4 {
        let next = (k + 1) % 4;
        let third = quad_area_vector([x[k], x[next], mean, mean]) / 3.0;
        for (n, share) in shares.iter_mut().enumerate() {
            let part = if n == k || n == next { 1.25 } else { 0.25 };
            *share += part * third;
        }
    }
    shares
}

/// Position of the payload: of the only node off the canopy that is held in all directions, or the mean of such nodes that are its attachments.
fn payload(scene: &Scene, mesh: &StructureMesh) -> Option<mesh::Point> {
    if scene.payload_body().is_some() && !scene.frame_drifts() {
        return None;
    }
    let held = mesh.fixed.iter().filter(|(n, c)| *n as usize >= mesh.n_canopy && *c == [true; 3]);
    let held: Vec<u32> = held.map(|(n, _)| *n).collect();
    if held.len() > 1 && mesh.node_sets.get("payload") != Some(&held) {
        return None;
    }
    let sum = held.iter().map(|&n| Vec3::from(mesh.coords[n as usize])).reduce(|sum, x| sum + x)?;
    Some((sum / held.len() as f64).into())
}

fn masses(scene: &Scene, mesh: &StructureMesh) -> Masses {
    let fabric = mesh.fabric_mass(scene);
    let of = |kind: CableKind| {
        kind.section(scene).map_or(0.0, |s| mesh.cable_length(kind) * s.mass_kg_m)
            + mesh.group_mass(kind, scene)
    };
    let tapes = TapePlace::ALL.map(|place| of(CableKind::Tape(place)));
    let [lines, risers, reinforcements] =
        [CableKind::SuspensionLine, CableKind::Riser, CableKind::Reinforcement].map(of);
    // One product for all kinds with the section of the lines: digits of earlier builds.
    let with_lines = scene.lines.as_ref().map_or(0.0, |l| {
        let risers = (CableKind::Riser, scene.risers.is_none());
        let kinds = [(CableKind::SuspensionLine, true), risers, (CableKind::Reinforcement, true)];
        let length: f64 = kinds.into_iter().filter(|k| k.1).map(|k| mesh.cable_length(k.0)).sum();
        length * l.area_m2 * l.density_kg_m3
    });
    let own_risers = match scene.risers {
        Some(_) => risers,
        None => mesh.group_mass(CableKind::Riser, scene),
    };
    let groups: f64 = [CableKind::SuspensionLine, CableKind::Reinforcement]
        .map(|kind| mesh.group_mass(kind, scene))
        .iter()
        .sum();
    let cables = with_lines + own_risers + groups + tapes.iter().sum::<f64>();
    Masses { fabric, cables, lines, risers, reinforcements, tapes, points: mesh.hung_point_masses(scene) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> CanopyInterface {
        CanopyInterface {
            coords: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
            faces: vec![[0, 1, 2, 3]],
            panels: vec![0; 4],
            payload: Some([1.0, 1.0, -2.0]),
            masses: Masses::default(),
            sizes: Sizes { nodes: 4, triangles: 2, cables: 0, risers: 0, fabric_area: 4.0 },
        }
    }

    #[test]
    fn work_is_force_times_displacement() {
        let still = [0.0; 12];
        let mut up = still;
        (0..4).for_each(|n| up[3 * n + 2] = 0.5);
        // 10 Pa on 4 m2 over 0.5 m, along the normal; shear of 3 Pa along x does none.
        assert!((square().work(&[10.0, 3.0, 0.0, 0.0], &still, &up) - 20.0).abs() < 1e-12);
        let mut along = still;
        (0..4).for_each(|n| along[3 * n] = 0.5);
        assert!((square().work(&[10.0, 3.0, 0.0, 0.0], &still, &along) - 6.0).abs() < 1e-12);
    }

    /// By hand: the centre of a square of 2 m, 2 m above the payload, moved by 1 m along x, then tilted about y by 30 degrees.
    #[test]
    fn pendulum_angle_and_projected_area_follow_the_shape() {
        let still = [0.0; 12];
        assert_eq!((square().pendulum_angle(&still), square().projected_area(&still)), (Some(0.0), 4.0));
        let mut aside = still;
        (0..4).for_each(|n| aside[3 * n] = 1.0);
        let angle = square().pendulum_angle(&aside).expect("a payload");
        assert!((angle - 0.5f64.atan()).abs() < 1e-14, "{angle}");
        let mut diagonal = still;
        (0..4).for_each(|n| (diagonal[3 * n], diagonal[3 * n + 1]) = (0.6, -0.8));
        let [x, y] = square().pendulum_components(&diagonal).expect("a payload");
        assert!(
            (x - 0.6 * 0.5f64.atan()).abs() < 1e-14 && (y + 0.8 * 0.5f64.atan()).abs() < 1e-14,
            "{x} {y}"
        );
        assert_eq!(square().pendulum_components(&still), Some([0.0; 2]));
        let (sin, cos) = (std::f64::consts::PI / 6.0).sin_cos();
        let mut tilted = still;
        for n in [1, 2] {
            (tilted[3 * n], tilted[3 * n + 2]) = (2.0 * cos - 2.0, 2.0 * sin);
        }
        assert!((square().projected_area(&tilted) - 4.0 * cos).abs() < 1e-14);
        // The centroid moves to (cos, 1, sin).
        let angle = square().pendulum_angle(&tilted).expect("a payload");
        assert!((angle - ((1.0 - cos) / (2.0 + sin)).atan()).abs() < 1e-14, "{angle}");
        assert_eq!(CanopyInterface { payload: None, ..square() }.pendulum_angle(&still), None);
    }

    #[test]
    fn triangle_is_a_face_with_a_repeated_node() {
        let mut one = square();
        one.faces = vec![[0, 1, 2, 2]];
        let still = [0.0; 12];
        let mut up = still;
        (0..3).for_each(|n| up[3 * n + 2] = 0.3);
        assert!((one.work(&[10.0, 0.0, 0.0, 0.0], &still, &up) - 10.0 * 2.0 * 0.3).abs() < 1e-12);
    }

    /// A flat square that becomes a saddle of height h: the mean of the four corners lies h/2 lower, and the swept
    /// volume does not depend on the diagonal of the structure's triangles.
    #[test]
    fn bent_face_sweeps_the_volume_of_four_triangles() {
        let pressure = [10.0, 0.0, 0.0, 0.0];
        let still = [0.0; 12];
        for diagonal in [[0, 2], [1, 3]] {
            let mut bent = still;
            diagonal.iter().for_each(|&n| bent[3 * n + 2] = 0.3);
            // Mean height 0.15 m over 4 m2.
            let work = square().work(&pressure, &still, &bent);
            assert!((work - 10.0 * 4.0 * 0.15).abs() < 1e-12, "{work}");
        }
        // One corner alone: a quarter of its height, not a third or a sixth as with two triangles.
        let mut bent = still;
        bent[2] = 0.3;
        let work = square().work(&pressure, &still, &bent);
        assert!((work - 10.0 * 4.0 * 0.075).abs() < 1e-12, "{work}");
    }

    /// Over a large motion the work is the pressure times the change of a closed volume, here a pyramid under a bent
    /// face.
    #[test]
    fn work_of_a_large_motion_is_pressure_times_volume_change() {
        let wave = |i: usize, a: f64| 0.4 * (i as f64 * a).sin();
        let [from, to] = [0.7, 1.9].map(|a| (0..12).map(|i| wave(i, a)).collect::<Vec<f64>>());
        // Volume between the four-triangle wall and two triangles over the same corners.
        let mut closed = square();
        closed.faces = vec![[0, 1, 2, 3], [0, 2, 1, 1], [0, 3, 2, 2]];
        let load = [7.0, 0.0, 0.0, 0.0].repeat(3);
        let volume = |d: &[f64]| {
            let x = closed.corners(&[0, 1, 2, 3], d);
            let [u, v, w] = [1, 2, 3].map(|n| x[n] - x[0]);
            u.dot(&v.cross(&w)) / 12.0
        };
        let work = closed.work(&load, &from, &to);
        let exact = 7.0 * (volume(&to) - volume(&from));
        assert!((work - exact).abs() < 1e-13 && exact.abs() > 0.05, "{work} {exact}");
    }

    #[test]
    fn masses_match_the_paper() {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let canopy = CanopyInterface::new(&case::load(&file).unwrap()).unwrap();
        // Paper: fabric 5.216 kg, cables 0.701 kg.
        assert!((canopy.masses.fabric - 5.216).abs() < 5e-4, "{:?}", canopy.masses);
        assert!((canopy.masses.cables - 0.701).abs() < 5e-4, "{:?}", canopy.masses);
        // Of them 28 lines of 6.4008 m and 4 risers of 1.2192 m.
        let lines = 28.0 * 6.4008 * 3.11e-6 * 1223.50932;
        assert!((canopy.masses.lines - lines).abs() < 1e-12, "{:?}", canopy.masses);
        let parts: f64 = canopy.masses.parts().iter().map(|p| p.1).sum();
        assert!((parts - canopy.masses.suspended()).abs() < 1e-14 * parts, "{parts}");
    }

    /// Tapes and risers of their own count with their own mass: 1 g/m of hem (24.384 m), 2 g/m of risers (4.8768 m), and
    /// 139.874 m2 of fabric with 4 g/m each 0.5 m both ways.
    #[test]
    fn masses_of_tapes_and_risers() {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let mut scene = case::load(&file).expect("a scene");
        let plain = CanopyInterface::new(&scene).expect("a canopy").masses;
        let hem = case::Tape { axial_stiffness_n: 1e3, mass_kg_m: 1e-3, ..case::Tape::default() };
        let grid = case::TapeGrid {
            axial_stiffness_n: 1e3,
            mass_kg_m: 4e-3,
            spacing_m: 0.5,
            ..case::TapeGrid::default()
        };
        scene.tapes = Some(case::Tapes { hem: Some(hem), grid: Some(grid), ..case::Tapes::default() });
        scene.risers = Some(case::Risers { axial_stiffness_n: 1e4, mass_kg_m: 2e-3, ..Default::default() });
        let masses = CanopyInterface::new(&scene).expect("a canopy").masses;
        let grid_kg = 2.0 * 139.874 / 0.5 * 4e-3;
        assert!((masses.tapes[0] - 0.024384).abs() < 1e-12, "{masses:?}");
        assert!((masses.tapes[3] - grid_kg).abs() < 1e-5 * grid_kg, "{masses:?}");
        assert!((masses.risers - 4.8768 * 2e-3).abs() < 1e-12, "{masses:?}");
        let sum = plain.lines + masses.risers + masses.all_tapes();
        assert!((masses.cables - sum).abs() < 1e-14 * sum, "{masses:?}");
    }

    /// Four risers with attachments 0.3 m apart: the payload is on the axis, below the canopy by less than lines and risers, and every part of the suspended mass is counted once:
    /// 24 lines of 7 m, 4 risers of 0.76 m.
    #[test]
    fn payload_of_several_attachments_is_their_mean() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../coupler/tests/reference/examples/gored.toml");
        let canopy = CanopyInterface::new(&case::load(&file).expect("a scene")).expect("a canopy");
        let [x, y, z] = canopy.payload.expect("a payload at rest in the frame");
        assert!(x.hypot(y) < 1e-12 && (-7.76..-6.0).contains(&z), "{:?}", canopy.payload);
        let angle = canopy.pendulum_angle(&vec![0.0; 3 * canopy.coords.len()]).expect("an angle");
        assert!(angle < 1e-12, "{angle}");
        let m = &canopy.masses;
        assert_eq!(canopy.sizes.risers, 4);
        assert!((m.risers - 4.0 * 0.76 * 0.05).abs() < 1e-12, "{m:?}");
        assert!((m.lines - 24.0 * 7.0 * 3.11e-6 * 1223.50932).abs() < 1e-12, "{m:?}");
        let parts: f64 = m.parts().iter().map(|p| p.1).sum();
        assert!((parts - m.suspended()).abs() < 1e-13 * parts && m.points == 0.0, "{m:?}");
    }
}
