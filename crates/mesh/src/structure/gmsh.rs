//! Canopies from Gmsh files: format 4.1.
//!
//! All triangles and quadrilaterals are fabric, their normal out of the canopy; in a
//! file that also holds a flow grid, those of the physical group `canopy`.
//! Names of physical groups mark everything else: curves in `lines`,
//! `risers` or `reinforcements` are cables (rest length: their length in the
//! file; each curve is one line), and so are curves in a group that a scene gives a section by `[[canopy.cable]]`; anything in `fixed`, `fixed-x`, `fixed-y` or
//! `fixed-z` holds its nodes; a point in `payload` carries the payload and is fixed.
//! A scene may speak of the nodes of any physical group by its name.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use case::{CableGroup, CablePart, GmshCanopy};

use crate::geometry::at;
use crate::msh::{Block, ElementShape, Msh, Tag};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// The physical group that is the fabric of a file which also holds a flow grid.
const CANOPY: &str = "canopy";

/// Reads a structure mesh; `payload_mass` in kg if the payload falls.
pub(super) fn gmsh(canopy: &GmshCanopy, payload_mass: Option<f64>) -> Result<StructureMesh, MeshError> {
    let path = &canopy.file;
    let bad = |reason: String| MeshError::File { path: path.clone(), reason };
    let parts = Msh::read(path)?;
    let mut builder = Builder::new(&parts, &canopy.cables);
    builder.add_fabric();
    if builder.mesh.n_canopy == 0 {
        return Err(bad("has no fabric: no triangles or quadrilaterals (in the physical group \"canopy\" if the file also has a flow grid)".into()));
    }
    builder.add_named(payload_mass);
    if let Some(missing) = builder.group_without_curves() {
        let have = parts.names_in(1);
        return Err(bad(format!(
            "has no curves in the physical group \"{missing}\", which [[canopy.cable]] names; its groups of curves are: {}",
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
    /// Groups with a section of their own.
    groups: &'a [CableGroup],
    /// The file also holds a flow grid, whose outer surfaces are no fabric.
    with_grid: bool,
    mesh: StructureMesh,
    /// Node of each of the file's tags.
    number: HashMap<u64, u32>,
}

impl<'a> Builder<'a> {
    fn new(parts: &'a Msh, groups: &'a [CableGroup]) -> Self {
        let with_grid = parts.blocks.iter().any(|b| b.shape.is_volume());
        Self { parts, groups, with_grid, mesh: StructureMesh::default(), number: HashMap::new() }
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
        let named = |name: &str| self.groups.iter().position(|g| g.group == name);
        if let Some(k) = self.parts.names_of(entity).find_map(named) {
            let g = &self.groups[k];
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
        (0..self.groups.len()).find(|k| !used(*k)).map(|k| self.groups[k].group.as_str())
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
mod tests {
    use super::*;

    /// Two quadrilaterals' worth of fabric, one of them cut, a line and a payload.
    const FILE: &str = r#"$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
0 7 "payload"
1 2 "lines"
1 3 "fixed-z"
$EndPhysicalNames
$Entities
1 2 1 0
1 1 0 -3 1 7
4 0 0 0 0 1 0 1 3 0
5 1 0 -3 1 0 0 1 2 2 1 -2
1 0 0 0 2 1 0 0 0
$EndEntities
$Comment
anything at all
$EndComment
$Nodes
2 7 1 9
2 1 0 6
1
2
3
4
5
6
0 0 0
1 0 0
2 0 0
0 1 0
1 1 0
2 1 0
0 1 0 1
9
1 0 -3
$EndNodes
$Elements
5 6 1 6
2 1 3 1
1 1 2 5 4
2 1 2 2
2 2 3 6
3 2 6 5
1 4 1 1
4 4 1
1 5 1 1
5 2 9
0 1 15 1
6 9
$EndElements
"#;

    fn read(text: &str) -> Result<StructureMesh, MeshError> {
        read_with(text, Vec::new())
    }

    fn read_with(text: &str, cables: Vec<CableGroup>) -> Result<StructureMesh, MeshError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("canopy.msh");
        std::fs::write(&file, text).unwrap();
        gmsh(&GmshCanopy { file, cables }, Some(5.0))
    }

    /// A group by another name is a cable where the scene gives it a section, shorter than in the file by its factor; a name without curves is refused.
    #[test]
    fn groups_with_sections_are_cables() {
        let text = FILE.replace("\"lines\"", "\"kevlar\"");
        // Without its section the group is no cable, so that nothing holds the payload.
        assert!(read(&text).unwrap_err().to_string().contains("belongs to no fabric and no cable"));
        let group = |name: &str| CableGroup {
            group: name.into(),
            part: CablePart::Riser,
            axial_stiffness_n: 2e3,
            mass_kg_m: 0.01,
            rest_length_factor: 0.5,
            pretension_n: 0.0,
            tension_only: true,
            retardation_time_s: 0.0,
        };
        let mesh = read_with(&text, vec![group("kevlar")]).unwrap();
        let c = mesh.cables[0];
        assert_eq!((c.kind, c.rest_length, c.group), (CableKind::Riser, 1.5, Some(0)));
        // The scene's word counts more than the name of the group, and each curve is one cable.
        let mesh = read_with(FILE, vec![group("lines")]).unwrap();
        assert_eq!((mesh.cables.len(), mesh.cables[0].kind), (1, CableKind::Riser));
        let error = read_with(FILE, vec![group("kevlar")]).unwrap_err().to_string();
        assert!(error.contains("\"kevlar\"") && error.contains("fixed-z, lines"), "{error}");
    }

    #[test]
    fn gmsh_canopy_is_read_completely() {
        let mesh = read(FILE).unwrap();
        assert_eq!((mesh.n_canopy, mesh.coords.len()), (6, 7));
        assert_eq!(mesh.faces, [[0, 1, 4, 3], [1, 2, 5, 5], [1, 5, 4, 4]]);
        assert_eq!(mesh.triangles.len(), 4);
        assert!((mesh.fabric_area(|_| true) - 2.0).abs() < 1e-14);
        assert_eq!(mesh.cables.len(), 1);
        assert_eq!((mesh.cables[0].nodes, mesh.cables[0].rest_length), ([1, 6], 3.0));
        assert_eq!(mesh.point_masses, [(6, 5.0)]);
        assert_eq!((&mesh.node_sets["fixed-z"], &mesh.node_sets["payload"]), (&vec![0, 3], &vec![6]));
        assert_eq!(mesh.fixed, [(0, [false, false, true]), (3, [false, false, true]), (6, [true; 3])]);
    }

    #[test]
    fn errors_report_the_line() {
        let reason = |from: &str, to: &str| match read(&FILE.replacen(from, to, 1)) {
            Err(MeshError::File { reason, .. }) => reason,
            other => panic!("{other:?}"),
        };
        assert!(reason("4.1 0 8", "2.2 0 8").contains("format 4.1"));
        assert!(reason("1 1 2 5 4", "1 1 2 8 4").contains("line 42: node 8"));
        assert!(reason("2 1 3 1", "2 1 16 1").contains("element type 16"));
        assert!(reason("1 0 -3\n$End", "1 zero -3\n$End").contains("\"zero\" is not a coordinate"));
        assert!(reason("0 1 0\n1 1 0", "0 1 0\n0.5 0 0").contains("no area"));
        assert!(reason("$EndElements\n", "").contains("the file ends"));
        assert!(matches!(
            gmsh(&GmshCanopy { file: "/none.msh".into(), cables: Vec::new() }, None),
            Err(MeshError::Io { .. })
        ));
    }
}
