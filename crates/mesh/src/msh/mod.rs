//! Gmsh files, format 4.1, ASCII and binary: their entities, by the tags of the file.

mod source;
mod write;

use std::collections::HashMap;
use std::path::Path;

use crate::{MeshError, Point};
use source::Source;
pub use write::write_msh;

/// A dimension and a tag: how Gmsh names entities and physical groups.
pub(crate) type Tag = (u32, i64);

/// Elements of one entity and type.
pub(crate) struct Block {
    pub entity: Tag,
    /// Shape of its elements.
    pub shape: ElementShape,
    /// Tag of each element.
    pub tags: Vec<u64>,
    /// Nodes of all elements, one after the other.
    pub nodes: Vec<u64>,
}

impl Block {
    /// Tag and nodes of each element.
    pub fn elements(&self) -> impl Iterator<Item = (u64, &[u64])> {
        self.tags.iter().copied().zip(self.nodes.chunks_exact(self.shape.size()))
    }
}

/// Shapes of first-order elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ElementShape {
    Line,
    Triangle,
    Quadrilateral,
    Tetrahedron,
    Hexahedron,
    Prism,
    Pyramid,
    Point,
}

impl ElementShape {
    /// Gmsh's number, name, number of nodes.
    const TABLE: [(ElementShape, i32, &'static str, usize); 8] = [
        (ElementShape::Line, 1, "line", 2),
        (ElementShape::Triangle, 2, "triangle", 3),
        (ElementShape::Quadrilateral, 3, "quadrilateral", 4),
        (ElementShape::Tetrahedron, 4, "tetrahedron", 4),
        (ElementShape::Hexahedron, 5, "hexahedron", 8),
        (ElementShape::Prism, 6, "prism", 6),
        (ElementShape::Pyramid, 7, "pyramid", 5),
        (ElementShape::Point, 15, "point", 1),
    ];

    fn entry(self) -> &'static (ElementShape, i32, &'static str, usize) {
        Self::TABLE.iter().find(|e| e.0 == self).expect("the table is complete")
    }

    pub fn size(self) -> usize {
        self.entry().3
    }

    pub fn name(self) -> &'static str {
        self.entry().2
    }

    pub fn number(self) -> i32 {
        self.entry().1
    }

    pub fn is_volume(self) -> bool {
        matches!(
            self,
            ElementShape::Tetrahedron
                | ElementShape::Hexahedron
                | ElementShape::Prism
                | ElementShape::Pyramid
        )
    }
}

/// Content of a Gmsh file.
#[derive(Default)]
pub(crate) struct Msh {
    /// Names of physical groups.
    pub names: HashMap<Tag, String>,
    /// Physical groups of entities.
    pub groups: HashMap<Tag, Vec<i64>>,
    pub nodes: HashMap<u64, Point>,
    /// In the file's order.
    pub blocks: Vec<Block>,
}

impl Msh {
    /// Reads a file.
    ///
    /// # Errors
    /// An input error, or invalid content with its location.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let bytes = std::fs::read(path).map_err(|source| MeshError::Io { path: path.into(), source })?;
        parse(&mut Source::new(path, &bytes))
    }

    /// Names of the physical groups of an entity.
    pub fn names_of(&self, entity: Tag) -> impl Iterator<Item = &str> {
        let groups = self.groups.get(&entity).map_or(&[][..], Vec::as_slice);
        groups.iter().filter_map(move |&g| self.names.get(&(entity.0, g))).map(String::as_str)
    }

    /// Names of all physical groups of a dimension, in alphabetical order.
    pub fn names_in(&self, dimension: u32) -> Vec<String> {
        let mut list: Vec<String> =
            self.names.iter().filter(|(t, _)| t.0 == dimension).map(|(_, n)| n.clone()).collect();
        list.sort();
        list
    }
}

fn parse(w: &mut Source) -> Result<Msh, MeshError> {
    let mut msh = Msh::default();
    let mut format = false;
    while !w.at_end() {
        let section = w.word("a section")?.to_owned();
        match section.as_str() {
            "$MeshFormat" => {
                let version = w.word("the format version")?.to_owned();
                let binary: u32 = w.number("the file type")?;
                let size: u32 = w.number("the data size")?;
                if version != "4.1" || binary > 1 || size != 8 {
                    return Err(
                        w.error("the file is not in Gmsh format 4.1; convert it with `gmsh -format msh41`")
                    );
                }
                if binary == 1 {
                    w.turn_binary()?;
                }
                format = true;
            }
            _ if !format => {
                return Err(w.error(format!("\"{section}\" is not the start of a Gmsh file ($MeshFormat)")));
            }
            "$PhysicalNames" => {
                // Text in binary files too.
                for _ in 0..w.number::<usize>("a number of names")? {
                    let tag = (w.number("a dimension")?, w.number("a physical tag")?);
                    let name = w.word("a name")?.to_owned();
                    msh.names.insert(tag, name);
                }
            }
            "$Entities" => {
                w.start_data();
                entities(w, &mut msh)?;
            }
            "$Nodes" => {
                w.start_data();
                nodes(w, &mut msh)?;
            }
            "$Elements" => {
                w.start_data();
                elements(w, &mut msh)?;
            }
            "$PartitionedEntities" => {
                return Err(w.error("the mesh is partitioned; save it without partitions"));
            }
            // Of no concern here.
            _ => {
                w.skip(&section)?;
                continue;
            }
        }
        w.end(&section)?;
    }
    Ok(msh)
}

fn entities(w: &mut Source, msh: &mut Msh) -> Result<(), MeshError> {
    let mut counts = [0; 4];
    for c in &mut counts {
        *c = w.size("a number of entities")?;
    }
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let tag = w.int("an entity's tag")?;
            // A point, or the corners of a bounding box.
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                w.real("a coordinate")?;
            }
            let mut groups = Vec::new();
            for _ in 0..w.size("a number of physical tags")? {
                groups.push(w.int("a physical tag")?);
            }
            if dimension > 0 {
                for _ in 0..w.size("a number of bounding entities")? {
                    w.int("a bounding entity")?;
                }
            }
            msh.groups.insert((dimension as u32, tag), groups);
        }
    }
    Ok(())
}

fn nodes(w: &mut Source, msh: &mut Msh) -> Result<(), MeshError> {
    let blocks = w.size("a number of blocks")?;
    for what in ["a number of nodes", "the least node tag", "the largest node tag"] {
        w.size(what)?;
    }
    for _ in 0..blocks {
        let dimension = w.int("a dimension")?;
        w.int("an entity's tag")?;
        let parametric = w.int("a flag")?;
        let count = w.size("a number of nodes")?;
        let mut tags = Vec::new();
        for _ in 0..count {
            tags.push(w.size("a node tag")?);
        }
        for tag in tags {
            let mut x: Point = [0.0; 3];
            for v in &mut x {
                *v = w.real("a coordinate")?;
                if !v.is_finite() {
                    return Err(w.error(format!("node {tag} has a coordinate that is not a number")));
                }
            }
            for _ in 0..if parametric == 1 { dimension } else { 0 } {
                w.real("a parameter")?;
            }
            msh.nodes.insert(tag, x);
        }
    }
    Ok(())
}

fn elements(w: &mut Source, msh: &mut Msh) -> Result<(), MeshError> {
    let blocks = w.size("a number of blocks")?;
    for what in ["a number of elements", "the least element tag", "the largest element tag"] {
        w.size(what)?;
    }
    for _ in 0..blocks {
        let entity: Tag = (w.int("a dimension")? as u32, w.int("an entity's tag")?);
        let kind = w.int("an element type")?;
        let Some(&(shape, ..)) = ElementShape::TABLE.iter().find(|e| i64::from(e.1) == kind) else {
            return Err(w.error(format!(
                "element type {kind}: only first-order points, lines, triangles, quadrilaterals, \
                 tetrahedra, hexahedra, prisms and pyramids are read; set Mesh.ElementOrder = 1"
            )));
        };
        let count = w.size("a number of elements")?;
        let mut block = Block { entity, shape, tags: Vec::new(), nodes: Vec::new() };
        for _ in 0..count {
            block.tags.push(w.size("an element tag")?);
            for _ in 0..shape.size() {
                let node = w.size("a node tag")?;
                if !msh.nodes.contains_key(&node) {
                    return Err(w.error(format!("node {node} is not in the file")));
                }
                block.nodes.push(node);
            }
        }
        msh.blocks.push(block);
    }
    Ok(())
}
