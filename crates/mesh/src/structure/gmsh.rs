//! Canopies from Gmsh files: format 4.1, ASCII.
//!
//! All triangles and quadrilaterals are fabric, their normal out of the canopy.
//! What else there is, physical groups say by their names: curves in `lines`,
//! `risers` or `reinforcements` are cables (rest length: their length in the
//! file; each curve is one line); anything in `fixed`, `fixed-x`, `fixed-y` or
//! `fixed-z` holds its nodes; a point in `payload` carries the payload and is fixed.
//! A scene may speak of the nodes of any physical group by its name.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use std::str::FromStr;

use crate::quality::{norm, sub};
use crate::{Cable, CableKind, MeshError, StructureMesh, Vec3};

/// A dimension and a tag: how Gmsh names entities and physical groups.
type Tag = (u32, i64);

/// What a file holds, by its own tags.
#[derive(Default)]
struct Parts {
    /// Names of physical groups.
    names: HashMap<Tag, String>,
    /// Physical groups of entities.
    groups: HashMap<Tag, Vec<i64>>,
    nodes: BTreeMap<u64, Vec3>,
    /// Entity and nodes of each element, in the file's order.
    elements: Vec<(Tag, Vec<u64>)>,
}

/// Words of a file with their line, for messages.
struct Words<'a> {
    path: &'a Path,
    rest: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        let words = text.lines().enumerate().flat_map(|(l, line)| {
            // A quoted name is one word.
            let (plain, name) = match line.split_once('"') {
                Some((plain, name)) => (plain, Some(name.trim_end().trim_end_matches('"'))),
                None => (line, None),
            };
            plain.split_whitespace().chain(name).map(move |w| (l + 1, w))
        });
        let words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a> = Box::new(words);
        Words { path, rest: words.peekable(), line: 0 }
    }

    fn error(&self, reason: impl std::fmt::Display) -> MeshError {
        MeshError::File { path: self.path.into(), reason: format!("line {}: {reason}", self.line) }
    }

    fn word(&mut self, what: &str) -> Result<&'a str, MeshError> {
        match self.rest.next() {
            Some((line, word)) => {
                self.line = line;
                Ok(word)
            }
            None => Err(self.error(format!("the file ends where {what} should be"))),
        }
    }

    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, MeshError> {
        let word = self.word(what)?;
        word.parse().map_err(|_| self.error(format!("\"{word}\" is not {what}")))
    }

    fn end(&mut self, section: &str) -> Result<(), MeshError> {
        let word = self.word("the end of a section")?;
        if word.strip_prefix("$End") == section.strip_prefix('$') {
            return Ok(());
        }
        Err(self.error(format!("\"{word}\" where the section {section} should end")))
    }
}

/// Reads a structure mesh; `payload_mass` in kg if the payload falls.
pub(super) fn gmsh(path: &Path, payload_mass: Option<f64>) -> Result<StructureMesh, MeshError> {
    let text = std::fs::read_to_string(path).map_err(|source| MeshError::Io { path: path.into(), source })?;
    let parts = parse(path, &text)?;
    build(path, &parts, payload_mass)
}

fn parse(path: &Path, text: &str) -> Result<Parts, MeshError> {
    let mut w = Words::new(path, text);
    let mut parts = Parts::default();
    let mut format = false;
    while w.rest.peek().is_some() {
        let section = w.word("a section")?;
        match section {
            "$MeshFormat" => {
                let version = w.word("the format version")?;
                let binary: u32 = w.number("the file type")?;
                let _size: u32 = w.number("the data size")?;
                if version != "4.1" || binary != 0 {
                    return Err(
                        w.error("not Gmsh format 4.1 ASCII: write it with `gmsh -format msh41 -bin 0`")
                    );
                }
                format = true;
                w.end(section)?;
            }
            _ if !format => {
                return Err(w.error(format!("\"{section}\" is not the start of a Gmsh file ($MeshFormat)")));
            }
            "$PhysicalNames" => {
                for _ in 0..w.number::<usize>("a number of names")? {
                    let tag = (w.number("a dimension")?, w.number("a physical tag")?);
                    let name = w.word("a name")?.to_string();
                    parts.names.insert(tag, name);
                }
                w.end(section)?;
            }
            "$Entities" => {
                entities(&mut w, &mut parts)?;
                w.end(section)?;
            }
            "$Nodes" => {
                nodes(&mut w, &mut parts)?;
                w.end(section)?;
            }
            "$Elements" => {
                elements(&mut w, &mut parts)?;
                w.end(section)?;
            }
            _ => {
                // Of no concern here.
                while w.end(section).is_err() {
                    if w.rest.peek().is_none() {
                        return Err(w.error(format!("the section {section} does not end")));
                    }
                }
            }
        }
    }
    Ok(parts)
}

fn entities(w: &mut Words, parts: &mut Parts) -> Result<(), MeshError> {
    let counts: [usize; 4] = {
        let mut counts = [0; 4];
        for c in &mut counts {
            *c = w.number("a number of entities")?;
        }
        counts
    };
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag: i64 = w.number("an entity's tag")?;
            // A point, or the corners of a bounding box.
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                w.number::<f64>("a coordinate")?;
            }
            let mut groups = Vec::new();
            for _ in 0..w.number::<usize>("a number of physical tags")? {
                groups.push(w.number("a physical tag")?);
            }
            if dimension > 0 {
                for _ in 0..w.number::<usize>("a number of bounding entities")? {
                    w.number::<i64>("a bounding entity")?;
                }
            }
            parts.groups.insert((dimension as u32, tag), groups);
        }
    }
    Ok(())
}

fn nodes(w: &mut Words, parts: &mut Parts) -> Result<(), MeshError> {
    let blocks: usize = w.number("a number of blocks")?;
    for what in ["a number of nodes", "the least node tag", "the largest node tag"] {
        w.number::<u64>(what)?;
    }
    for _ in 0..blocks {
        let dimension: usize = w.number("a dimension")?;
        w.number::<i64>("an entity's tag")?;
        let parametric: u32 = w.number("a flag")?;
        let count: usize = w.number("a number of nodes")?;
        let mut tags = Vec::new();
        for _ in 0..count {
            tags.push(w.number::<u64>("a node tag")?);
        }
        for tag in tags {
            let mut x: Vec3 = [0.0; 3];
            for v in &mut x {
                *v = w.number("a coordinate")?;
                if !v.is_finite() {
                    return Err(w.error(format!("node {tag} has a coordinate that is not a number")));
                }
            }
            for _ in 0..if parametric == 1 { dimension } else { 0 } {
                w.number::<f64>("a parameter")?;
            }
            parts.nodes.insert(tag, x);
        }
    }
    Ok(())
}

fn elements(w: &mut Words, parts: &mut Parts) -> Result<(), MeshError> {
    let blocks: usize = w.number("a number of blocks")?;
    for what in ["a number of elements", "the least element tag", "the largest element tag"] {
        w.number::<u64>(what)?;
    }
    for _ in 0..blocks {
        let entity: Tag = (w.number("a dimension")?, w.number("an entity's tag")?);
        let kind: u32 = w.number("an element type")?;
        let count: usize = w.number("a number of elements")?;
        let size = match kind {
            15 => 1,
            1 => 2,
            2 => 3,
            3 => 4,
            _ => {
                return Err(w.error(format!(
                    "element type {kind}: only points, straight lines, 3-node triangles and \
                     4-node quadrilaterals are read"
                )));
            }
        };
        for _ in 0..count {
            w.number::<u64>("an element tag")?;
            let mut nodes = Vec::new();
            for _ in 0..size {
                let node: u64 = w.number("a node tag")?;
                if !parts.nodes.contains_key(&node) {
                    return Err(w.error(format!("node {node} is not in the file")));
                }
                nodes.push(node);
            }
            parts.elements.push((entity, nodes));
        }
    }
    Ok(())
}

fn build(path: &Path, parts: &Parts, payload_mass: Option<f64>) -> Result<StructureMesh, MeshError> {
    let bad = |reason: String| MeshError::File { path: path.into(), reason };
    let names_of = |entity: &Tag| {
        let groups = parts.groups.get(entity).map_or(&[][..], Vec::as_slice);
        groups.iter().filter_map(|&g| parts.names.get(&(entity.0, g))).map(String::as_str).collect::<Vec<_>>()
    };
    let fabric = || parts.elements.iter().filter(|(_, nodes)| nodes.len() >= 3);
    // Canopy nodes first, each kind in the order of the tags.
    let canopy: BTreeSet<u64> = fabric().flat_map(|(_, nodes)| nodes.iter().copied()).collect();
    if canopy.is_empty() {
        return Err(bad("holds no triangle or quadrilateral, so there is no fabric".into()));
    }
    let mut mesh = StructureMesh::default();
    let mut number: HashMap<u64, u32> = HashMap::new();
    let mut add = |mesh: &mut StructureMesh, tag: u64| {
        *number.entry(tag).or_insert_with(|| mesh.push_node(parts.nodes[&tag]))
    };
    canopy.iter().for_each(|&tag| {
        add(&mut mesh, tag);
    });
    mesh.n_canopy = mesh.coords.len();

    let mut panels: Vec<Tag> = Vec::new();
    for (entity, nodes) in fabric() {
        let panel = panels.iter().position(|p| p == entity).unwrap_or_else(|| {
            panels.push(*entity);
            panels.len() - 1
        });
        let nodes: Vec<u32> = nodes.iter().map(|&tag| add(&mut mesh, tag)).collect();
        if let [a, b, c] = nodes[..] {
            mesh.triangles.push([a, b, c]);
            mesh.triangle_face.push(mesh.faces.len() as u32);
            mesh.faces.push([a, b, c, c]);
            mesh.face_panel.push(panel as u32);
        } else {
            let [a, b, c, d] = [nodes[0], nodes[1], nodes[2], nodes[3]];
            let diagonal = |p: u32, q: u32| norm(sub(mesh.coords[p as usize], mesh.coords[q as usize]));
            let straight = diagonal(a, c) <= diagonal(b, d);
            mesh.push_quad([a, b, c, d], panel as u32, straight);
        }
    }

    let mut lines: Vec<(Tag, CableKind)> = Vec::new();
    let mut fixed: BTreeMap<u32, [bool; 3]> = BTreeMap::new();
    for (entity, nodes) in &parts.elements {
        for name in names_of(entity) {
            let kind = match name {
                "lines" => Some(CableKind::SuspensionLine),
                "risers" => Some(CableKind::Riser),
                "reinforcements" => Some(CableKind::Reinforcement),
                _ => None,
            };
            if let (Some(kind), [a, b]) = (kind, &nodes[..]) {
                let line = lines.iter().position(|l| *l == (*entity, kind)).unwrap_or_else(|| {
                    lines.push((*entity, kind));
                    lines.len() - 1
                }) as u32;
                let nodes = [add(&mut mesh, *a), add(&mut mesh, *b)];
                let [p, q] = nodes.map(|n| mesh.coords[n as usize]);
                mesh.cables.push(Cable { nodes, rest_length: norm(sub(p, q)), kind, line });
            }
            let held = match name {
                "fixed" | "payload" => [true; 3],
                "fixed-x" => [true, false, false],
                "fixed-y" => [false, true, false],
                "fixed-z" => [false, false, true],
                _ => continue,
            };
            for &tag in nodes {
                let node = add(&mut mesh, tag);
                let own = fixed.entry(node).or_default();
                (0..3).for_each(|i| own[i] |= held[i]);
                if name == "payload" && nodes.len() == 1 {
                    mesh.point_masses.extend(payload_mass.map(|mass| (node, mass)));
                }
            }
        }
    }
    mesh.fixed = fixed.into_iter().collect();
    let mut sets: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
    for (entity, nodes) in &parts.elements {
        for name in names_of(entity) {
            sets.entry(name).or_default().extend(nodes.iter().filter_map(|tag| number.get(tag)));
        }
    }
    mesh.node_sets =
        sets.into_iter().map(|(name, nodes)| (name.into(), nodes.into_iter().collect())).collect();
    if mesh.fixed.is_empty() {
        return Err(bad("fixes no node: put points or curves into a physical group named \"fixed\"".into()));
    }
    let flat = mesh.triangles.iter().position(|t| {
        let [a, b, c] = t.map(|n| mesh.coords[n as usize]);
        let (u, v) = (sub(b, a), sub(c, a));
        norm(crate::quality::cross(u, v)) <= 1e-12 * (norm(u) * norm(v)).max(f64::MIN_POSITIVE)
    });
    if let Some(t) = flat {
        let at = mesh.coords[mesh.triangles[t][0] as usize];
        return Err(bad(format!("a fabric element at {at:?} has no area")));
    }
    if let Some(c) = mesh.cables.iter().find(|c| c.rest_length <= 0.0) {
        let at = mesh.coords[c.nodes[0] as usize];
        return Err(bad(format!("a cable element at {at:?} has no length")));
    }
    let loose: BTreeSet<u32> = mesh.cables.iter().flat_map(|c| c.nodes).collect();
    let n_canopy = mesh.n_canopy as u32;
    if let Some(&(node, _)) = mesh.fixed.iter().find(|(n, _)| *n >= n_canopy && !loose.contains(n)) {
        let at = mesh.coords[node as usize];
        return Err(bad(format!("the fixed node at {at:?} belongs to no fabric and no cable")));
    }
    Ok(mesh)
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("canopy.msh");
        std::fs::write(&path, text).unwrap();
        gmsh(&path, Some(5.0))
    }

    #[test]
    fn everything_is_found() {
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
    fn what_is_wrong_is_told_with_its_line() {
        let reason = |from: &str, to: &str| match read(&FILE.replacen(from, to, 1)) {
            Err(MeshError::File { reason, .. }) => reason,
            other => panic!("{other:?}"),
        };
        assert!(reason("4.1 0 8", "2.2 0 8").contains("4.1 ASCII"));
        assert!(reason("1 1 2 5 4", "1 1 2 8 4").contains("line 42: node 8"));
        assert!(reason("2 1 3 1", "2 1 16 1").contains("element type 16"));
        assert!(reason("1 0 -3\n$End", "1 zero -3\n$End").contains("\"zero\" is not a coordinate"));
        assert!(reason("0 1 0\n1 1 0", "0 1 0\n0.5 0 0").contains("no area"));
        assert!(reason("$EndElements\n", "").contains("the file ends"));
        assert!(matches!(gmsh(Path::new("/none.msh"), None), Err(MeshError::Io { .. })));
    }
}
