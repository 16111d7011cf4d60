//! Canopies from Gmsh files: format 4.1.
//!
//! All triangles and quadrilaterals are fabric, their normal out of the canopy; in a
//! file that also holds a flow grid, those of the physical group `canopy`.
//! Names of physical groups mark everything else: curves in `lines`,
//! `risers` or `reinforcements` are cables (rest length: their length in the
//! file; each curve is one line), and so are curves in a group that a scene gives a section by `[[canopy.cable]]`; surfaces in a group of
//! `[[canopy.fabric]]` have its cloth; anything in `fixed`, `fixed-x`, `fixed-y` or
//! `fixed-z` holds its nodes; a point in `payload` carries the payload and is fixed.
//! A scene may speak of the nodes of any physical group by its name.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use case::{CablePart, GmshCanopy};

use crate::geometry::at;
use crate::msh::{Block, ElementShape, Msh, Tag};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// The physical group that is the fabric of a file which also holds a flow grid.
const CANOPY: &str = "canopy";

/// Reads a structure mesh; `payload_mass` in kg if the payload falls. Without `fabric`, a structure of cables: its canopy nodes are
/// those of cables but for the payload.
pub(super) fn gmsh(
    canopy: &GmshCanopy,
    fabric: bool,
    payload_mass: Option<f64>,
) -> Result<StructureMesh, MeshError> {
    let path = &canopy.file;
    let bad = |reason: String| MeshError::File { path: path.clone(), reason };
    let parts = Msh::read(path)?;
    let mut builder = Builder::new(&parts, canopy);
    builder.add_fabric();
    match (fabric, builder.mesh.faces.len()) {
        (true, 0) => {
            return Err(bad("has no fabric: no triangles or quadrilaterals (in the physical group \"canopy\" if the file also has a flow grid); \
                 a scene of cables alone has no [fabric]".into()));
        }
        (false, faces) if faces > 0 => {
            return Err(bad(format!(
                "has fabric, {faces} faces, and the scene has no [fabric]: add it, or remove the surfaces for cables alone"
            )));
        }
        (false, _) => builder.add_canopy_of_cables(),
        _ => {}
    }
    if builder.mesh.n_canopy == 0 {
        return Err(bad("has no fabric and no cables: put curves into a physical group \"lines\", \"risers\" or \"reinforcements\", or one of [[canopy.cable]]".into()));
    }
    builder.add_named(payload_mass);
    if let Some(missing) = builder.group_without_curves() {
        let have = parts.names_in(1);
        return Err(bad(format!(
            "has no curves in the physical group \"{missing}\", which [[canopy.cable]] names; its groups of curves are: {}",
            if have.is_empty() { "none".into() } else { have.join(", ") }
        )));
    }
    if let Some(missing) = builder.group_without_surfaces() {
        let have = parts.names_in(2);
        return Err(bad(format!(
            "has no fabric in the physical group \"{missing}\", which [[canopy.fabric]] names; its groups of surfaces are: {}",
            if have.is_empty() { "none".into() } else { have.join(", ") }
        )));
    }
    builder.name_sets();
    judge(&builder.mesh).map_err(bad)?;
    Ok(builder.mesh)
}

/// A structure mesh while elements of a file are added to it.
struct Builder<'a> {
    parts: &'a Msh,
    /// With the groups of curves and surfaces that have a section or a cloth of their own.
    canopy: &'a GmshCanopy,
    /// The file also holds a flow grid, whose outer surfaces are no fabric.
    with_grid: bool,
    mesh: StructureMesh,
    /// Node of each of the file's tags.
    number: HashMap<u64, u32>,
}

impl<'a> Builder<'a> {
    fn new(parts: &'a Msh, canopy: &'a GmshCanopy) -> Self {
        let with_grid = parts.blocks.iter().any(|b| b.shape.is_volume());
        Self { parts, canopy, with_grid, mesh: StructureMesh::default(), number: HashMap::new() }
    }

    fn is_fabric(&self, b: &Block) -> bool {
        let flat = matches!(b.shape, ElementShape::Triangle | ElementShape::Quadrilateral);
        flat && (!self.with_grid || self.parts.names_of(b.entity).any(|n| n == CANOPY))
    }

    /// Entity and nodes of the elements of the blocks that `pick` picks.
    fn elements(&self, pick: impl Fn(&Block) -> bool) -> Vec<(Tag, &'a [u64])> {
        let blocks = self.parts.blocks.iter().filter(|b| pick(b));
        blocks.flat_map(|b| b.elements().map(move |(_, nodes)| (b.entity, nodes))).collect()
    }

    fn add(&mut self, tag: u64) -> u32 {
        *self.number.entry(tag).or_insert_with(|| self.mesh.push_node(self.parts.nodes[&tag]))
    }

    /// Canopy nodes in the order of the tags, then faces and triangles in the order of the file.
    fn add_fabric(&mut self) {
        let fabric = self.elements(|b| self.is_fabric(b));
        let canopy: BTreeSet<u64> = fabric.iter().flat_map(|(_, nodes)| nodes.iter().copied()).collect();
        for tag in canopy {
            self.add(tag);
        }
        self.mesh.n_canopy = self.mesh.coords.len();
        let mut panels: Vec<Tag> = Vec::new();
        for (entity, nodes) in fabric {
            let panel = place_in(&mut panels, entity);
            let cloth = self.cloth_of(entity);
            if !self.canopy.fabrics.is_empty() {
                self.mesh.face_fabric.push(cloth);
            }
            let nodes: Vec<u32> = nodes.iter().map(|&tag| self.add(tag)).collect();
            let mesh = &mut self.mesh;
            if let [a, b, c] = nodes[..] {
                mesh.triangles.push([a, b, c]);
                mesh.triangle_face.push(mesh.faces.len() as u32);
                mesh.faces.push([a, b, c, c]);
                mesh.face_panel.push(panel);
            } else {
                let [a, b, c, d] = [nodes[0], nodes[1], nodes[2], nodes[3]];
                let diagonal = |p: u32, q: u32| (at(&mesh.coords, p) - at(&mesh.coords, q)).norm();
                let straight = diagonal(a, c) <= diagonal(b, d);
                mesh.push_quad([a, b, c, d], panel, straight);
            }
        }
    }

    /// Nodes of cables in the order of their tags, but for the payload.
    fn add_canopy_of_cables(&mut self) {
        let parts = self.parts;
        let is_payload =
            |b: &Block| b.shape == ElementShape::Point && parts.names_of(b.entity).any(|n| n == "payload");
        let payload = self.elements(is_payload);
        let payload: BTreeSet<u64> = payload.iter().flat_map(|(_, nodes)| nodes.iter().copied()).collect();
        let curves = self
            .structure()
            .into_iter()
            .filter(|(entity, nodes)| nodes.len() == 2 && !self.cables_of(*entity).is_empty());
        let nodes: BTreeSet<u64> = curves.flat_map(|(_, nodes)| nodes.iter().copied()).collect();
        for tag in nodes.difference(&payload) {
            self.add(*tag);
        }
        self.mesh.n_canopy = self.mesh.coords.len();
    }

    /// Place of the group of `[[canopy.fabric]]` that a surface is in.
    fn cloth_of(&self, entity: Tag) -> Option<u16> {
        let named = |name: &str| self.canopy.fabrics.iter().position(|g| g.group == name);
        self.parts.names_of(entity).find_map(named).map(|k| k as u16)
    }

    /// Cables, held nodes and the payload: what physical groups say by their names.
    fn add_named(&mut self, payload_mass: Option<f64>) {
        let mut lines: Vec<(Tag, CableKind)> = Vec::new();
        let mut fixed: BTreeMap<u32, [bool; 3]> = BTreeMap::new();
        let parts = self.parts;
        for (entity, nodes) in self.structure() {
            if let [a, b] = nodes {
                for cable in self.cables_of(entity) {
                    let line = place_in(&mut lines, (entity, cable.kind));
                    self.add_cable([*a, *b], line, cable);
                }
            }
            for name in parts.names_of(entity) {
                let Some(held) = held(name) else { continue };
                for &tag in nodes {
                    let node = self.add(tag);
                    let own = fixed.entry(node).or_default();
                    (0..3).for_each(|i| own[i] |= held[i]);
                    if name == "payload" && nodes.len() == 1 {
                        self.mesh.point_masses.extend(payload_mass.map(|mass| (node, mass)));
                    }
                }
            }
        }
        self.mesh.fixed = fixed.into_iter().collect();
    }

    /// Cables along a curve: one where one of its groups has a section of its own, else one for each group that names a kind.
    fn cables_of(&self, entity: Tag) -> Vec<CurveCable> {
        let groups = &self.canopy.cables;
        let named = |name: &str| groups.iter().position(|g| g.group == name);
        if let Some(k) = self.parts.names_of(entity).find_map(named) {
            let g = &groups[k];
            return vec![CurveCable {
                kind: part_kind(g.part),
                group: Some(k as u16),
                factor: g.rest_length_factor,
            }];
        }
        let of_kind = |kind| CurveCable { kind, group: None, factor: 1.0 };
        self.parts.names_of(entity).filter_map(cable_kind).map(of_kind).collect()
    }

    fn add_cable(&mut self, tags: [u64; 2], line: u32, cable: CurveCable) {
        let nodes = tags.map(|tag| self.add(tag));
        let [p, q] = nodes.map(|n| at(&self.mesh.coords, n));
        let rest_length = (p - q).norm() * cable.factor;
        self.mesh.cables.push(Cable {
            nodes,
            rest_length,
            kind: cable.kind,
            line,
            share: 1.0,
            group: cable.group,
        });
    }

    /// A group that the scene names and that has no curve.
    fn group_without_curves(&self) -> Option<&'a str> {
        let used = |k: usize| self.mesh.cables.iter().any(|c| c.group == Some(k as u16));
        let groups = &self.canopy.cables;
        (0..groups.len()).find(|k| !used(*k)).map(|k| groups[k].group.as_str())
    }

    /// A group of fabric that the scene names and that has no surface.
    fn group_without_surfaces(&self) -> Option<&'a str> {
        let groups = &self.canopy.fabrics;
        let used = |k: usize| self.mesh.face_fabric.contains(&Some(k as u16));
        (0..groups.len()).find(|k| !used(*k)).map(|k| groups[k].group.as_str())
    }

    /// Elements but for volumes and their outer surfaces, which belong to the air.
    fn structure(&self) -> Vec<(Tag, &'a [u64])> {
        self.elements(|b| b.entity.0 < 2 || self.is_fabric(b))
    }

    fn name_sets(&mut self) {
        let mut sets: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
        for (entity, nodes) in self.structure() {
            for name in self.parts.names_of(entity) {
                sets.entry(name).or_default().extend(nodes.iter().filter_map(|tag| self.number.get(tag)));
            }
        }
        self.mesh.node_sets =
            sets.into_iter().map(|(name, nodes)| (name.into(), nodes.into_iter().collect())).collect();
    }
}

/// Place of `item` in `list`, at whose end it is put where it is new.
fn place_in<T: PartialEq>(list: &mut Vec<T>, item: T) -> u32 {
    let place = list.iter().position(|i| *i == item).unwrap_or_else(|| {
        list.push(item);
        list.len() - 1
    });
    place as u32
}

/// A cable along a curve.
struct CurveCable {
    kind: CableKind,
    group: Option<u16>,
    /// Unstretched length over the length in the file.
    factor: f64,
}

fn part_kind(part: CablePart) -> CableKind {
    match part {
        CablePart::Line => CableKind::SuspensionLine,
        CablePart::Riser => CableKind::Riser,
        CablePart::Reinforcement => CableKind::Reinforcement,
    }
}

fn cable_kind(group: &str) -> Option<CableKind> {
    match group {
        "lines" => Some(CableKind::SuspensionLine),
        "risers" => Some(CableKind::Riser),
        "reinforcements" => Some(CableKind::Reinforcement),
        _ => None,
    }
}

/// Components that a group holds.
fn held(group: &str) -> Option<[bool; 3]> {
    match group {
        "fixed" | "payload" => Some([true; 3]),
        "fixed-x" => Some([true, false, false]),
        "fixed-y" => Some([false, true, false]),
        "fixed-z" => Some([false, false, true]),
        _ => None,
    }
}

/// Says what makes `mesh` no structure.
fn judge(mesh: &StructureMesh) -> Result<(), String> {
    if mesh.fixed.is_empty() {
        return Err("fixes no node: put points or curves into a physical group named \"fixed\"".into());
    }
    let flat = mesh.triangles.iter().position(|t| {
        let [a, b, c] = t.map(|n| at(&mesh.coords, n));
        let (u, v) = (b - a, c - a);
        u.cross(&v).norm() <= 1e-12 * (u.norm() * v.norm()).max(f64::MIN_POSITIVE)
    });
    if let Some(t) = flat {
        let at = mesh.coords[mesh.triangles[t][0] as usize];
        return Err(format!("a fabric element at {at:?} has no area"));
    }
    if let Some(c) = mesh.cables.iter().find(|c| c.rest_length <= 0.0) {
        let at = mesh.coords[c.nodes[0] as usize];
        return Err(format!("a cable element at {at:?} has no length"));
    }
    let loose: BTreeSet<u32> = mesh.cables.iter().flat_map(|c| c.nodes).collect();
    let n_canopy = mesh.n_canopy as u32;
    if let Some(&(node, _)) = mesh.fixed.iter().find(|(n, _)| *n >= n_canopy && !loose.contains(n)) {
        let at = mesh.coords[node as usize];
        return Err(format!("the fixed node at {at:?} belongs to no fabric and no cable"));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
