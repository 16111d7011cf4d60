//! Structure meshes from the parameters of a scene.

mod atps;
mod cross;
mod flat;
mod fullness;
mod gmsh;
mod gored;
mod hung_mass;
mod node_sets;
mod panel;
mod pattern;
mod payload;
mod refusals;
mod skirt;
mod suspension;
#[cfg(test)]
mod tape_tests;
mod tapes;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use atps::AtpsLayout;
pub(crate) use flat::layout as flat_layout;
pub use pattern::PatternError;
pub(crate) use refusals::{even, positive, refuse};

use case::{Canopy, Scene};

use crate::geometry::{Point, Vec3, at};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// Fabric, lines and payload of a scene, unstressed.
///
/// # Errors
/// [`MeshError::Parameter`] if the parameters make no canopy, and what is wrong
/// with a mesh file.
pub fn structure_mesh(scene: &Scene) -> Result<StructureMesh, MeshError> {
    let payload = suspension::Payload::of(scene);
    let payload_mass = payload.mass;
    let mut mesh = match &scene.canopy {
        Canopy::Atps(a) => atps::atps(a, payload_mass),
        Canopy::Square(f) => flat::flat(f, flat::Outline::Square, payload_mass),
        Canopy::Circular(f) => flat::flat(f, flat::Outline::Circle, payload_mass),
        Canopy::Gored(g) => gored::gored(g, &payload),
        Canopy::Cross(x) => cross::cross(x, &payload),
        Canopy::AirBag(b) => flat::air_bag(b),
        Canopy::Gmsh(g) => gmsh::gmsh(g, scene.has_fabric(), payload_mass),
        Canopy::Pattern(p) => pattern::pattern(p, scene.tapes.as_ref(), &payload),
        Canopy::Panel(p) => panel::panel(p),
        Canopy::None => Ok(StructureMesh::default()),
    }?;
    if let Some(tapes) = &scene.tapes {
        mesh.add_tapes(&scene.canopy, tapes)?;
    }
    if mesh.cables.iter().any(|c| c.section(scene).is_none()) {
        return Err(refuse("lines", "absent", "the canopy has cables: add [lines] with their material"));
    }
    if let Some(body) = scene.payload_body() {
        mesh.attach_payload(body)?;
    }
    mesh.name_sets();
    for (k, p) in scene.point_masses.iter().enumerate() {
        let nodes = mesh.nodes_of(&format!("point_mass[{k}]"), p.nodes.as_deref(), p.at_m)?;
        mesh.point_masses.extend(nodes.into_iter().map(|n| (n, p.mass_kg)));
    }
    Ok(mesh)
}

impl StructureMesh {
    /// Adds a quadrilateral face and its two triangles. `straight` cuts from the
    /// first to the third node.
    fn push_quad(&mut self, quad: [u32; 4], panel: u32, straight: bool) {
        let face = self.faces.len() as u32;
        let [a, b, c, d] = quad;
        self.faces.push(quad);
        self.face_panel.push(panel);
        let cut = if straight { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        self.triangles.extend(cut);
        self.triangle_face.extend([face; 2]);
    }

    /// Adds a line of `segments` cable elements with new nodes on its chord.
    fn push_line(&mut self, ends: [u32; 2], rest_length: f64, segments: usize, kind: CableKind, line: u32) {
        let [a, b] = ends.map(|n| self.coords[n as usize]);
        let mut from = ends[0];
        for s in 1..=segments {
            let to = if s == segments {
                ends[1]
            } else {
                let t = s as f64 / segments as f64;
                self.push_node(std::array::from_fn(|i| a[i] + t * (b[i] - a[i])))
            };
            let rest_length = rest_length / segments as f64;
            self.cables.push(Cable { nodes: [from, to], rest_length, kind, line, share: 1.0, group: None });
            from = to;
        }
    }

    fn push_node(&mut self, x: Point) -> u32 {
        self.coords.push(x);
        (self.coords.len() - 1) as u32
    }

    /// Unstressed shape of a triangle, m: its flat shape in the plane z = 0, where the mesh has one, else the positions of its nodes.
    pub fn reference_triangle(&self, triangle: usize) -> [Vec3; 3] {
        match self.flat.get(triangle) {
            Some(flat) => flat.map(|x| Vec3::new(x[0], x[1], 0.0)),
            None => self.triangles[triangle].map(|n| at(&self.coords, n)),
        }
    }

    /// Unstressed shape of a face, m; as [`StructureMesh::reference_triangle`], a triangle repeats its last corner.
    pub fn reference_face(&self, face: usize) -> [Vec3; 4] {
        if self.flat.is_empty() {
            return self.faces[face].map(|n| at(&self.coords, n));
        }
        // Faces of flat shapes are triangles, in one order with them.
        let [a, b, c] = self.reference_triangle(face);
        [a, b, c, c]
    }

    /// Principal stretches of a triangle at the positions of the mesh, the larger one first: 1 and 1 where these are its unstressed shape.
    pub fn starting_stretches(&self, triangle: usize) -> [f64; 2] {
        match self.flat.get(triangle) {
            Some(flat) => pattern::stretches(self.triangles[triangle], *flat, &self.coords),
            None => [1.0; 2],
        }
    }

    /// Least quality of an unstressed triangle, $`4 \sqrt{3} A / \sum l^2`$: 1 where it is equilateral, 0 without area.
    pub fn least_quality(&self) -> f64 {
        let of = |t: usize| {
            let [a, b, c] = self.reference_triangle(t);
            let squares = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
            2.0 * 3_f64.sqrt() * (b - a).cross(&(c - a)).norm() / squares
        };
        (0..self.triangles.len()).map(of).fold(1.0, f64::min)
    }

    /// Area of the fabric, m2, of the panels that `panel` picks.
    pub fn fabric_area(&self, panel: impl Fn(u32) -> bool) -> f64 {
        let picked = self.triangle_face.iter().enumerate();
        picked
            .filter(|(_, face)| panel(self.face_panel[**face as usize]))
            .map(|(t, _)| {
                let [a, b, c] = self.reference_triangle(t);
                // Half of the length, not the length of the half: digits of earlier builds.
                0.5 * (b - a).cross(&(c - a)).norm()
            })
            .sum()
    }

    /// Group of a face among those of `[[canopy.fabric]]`; `None` where it is `[fabric]`.
    pub fn fabric_group(&self, face: usize) -> Option<u16> {
        self.face_fabric.get(face).copied().flatten()
    }

    /// Mean mass of the fabric for each area, kg/m2.
    pub fn mean_areal_mass(&self, scene: &Scene) -> f64 {
        if self.face_fabric.iter().all(Option::is_none) {
            return scene.fabric.thickness_m * scene.fabric.density_kg_m3;
        }
        self.fabric_mass(scene) / self.fabric_area(|_| true)
    }

    /// Mass of the fabric, kg: each face with the thickness and density of its cloth.
    pub fn fabric_mass(&self, scene: &Scene) -> f64 {
        let areal = |group: Option<u16>| {
            let f = scene.fabric_of(group);
            (f.thickness_m, f.density_kg_m3)
        };
        if self.face_fabric.iter().all(Option::is_none) {
            let (thickness, density) = areal(None);
            return self.fabric_area(|_| true) * thickness * density;
        }
        let of = |(t, face): (usize, &u32)| {
            let [a, b, c] = self.reference_triangle(t);
            let (thickness, density) = areal(self.fabric_group(*face as usize));
            0.5 * (b - a).cross(&(c - a)).norm() * thickness * density
        };
        self.triangle_face.iter().enumerate().map(of).sum()
    }

    /// Unstretched length of the lines or tapes of a kind with the section of that kind, m.
    pub fn cable_length(&self, kind: CableKind) -> f64 {
        self.cables
            .iter()
            .filter(|c| c.kind == kind && c.group.is_none())
            .map(|c| c.share * c.rest_length)
            .sum()
    }

    /// Mass of the cables of a kind whose section is that of their group, kg.
    pub fn group_mass(&self, kind: CableKind, scene: &Scene) -> f64 {
        let cables = self.cables.iter().filter(|c| c.kind == kind && c.group.is_some());
        cables.filter_map(|c| Some(c.section(scene)?.mass_kg_m * c.share * c.rest_length)).sum()
    }

    /// Axial stiffness times length of all tapes (N m): over twice the area of the fabric, the stiffness of a grid that
    /// is as stiff (N/m).
    pub fn tape_stiffness(&self, scene: &case::Scene) -> f64 {
        let tape = |c: &&Cable| matches!(c.kind, CableKind::Tape(_));
        let of = |c: &Cable| Some(c.section(scene)?.axial_stiffness_n * c.share * c.rest_length);
        self.cables.iter().filter(tape).filter_map(of).sum()
    }
}
