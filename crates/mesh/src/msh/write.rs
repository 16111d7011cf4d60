//! A flow grid as a Gmsh file.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use super::ElementShape;
use crate::vtk::{volume_shape, write_aside};
use crate::{FlowGrid, MeshError, clean_face};

/// Numbers as text or as bytes.
struct Sink<'a> {
    out: &'a mut dyn Write,
    binary: bool,
}

impl Sink<'_> {
    fn int(&mut self, x: i32) -> std::io::Result<()> {
        if self.binary { self.out.write_all(&x.to_le_bytes()) } else { write!(self.out, "{x} ") }
    }
    fn size(&mut self, x: usize) -> std::io::Result<()> {
        if self.binary { self.out.write_all(&(x as u64).to_le_bytes()) } else { write!(self.out, "{x} ") }
    }
    fn real(&mut self, x: f64) -> std::io::Result<()> {
        if self.binary { self.out.write_all(&x.to_le_bytes()) } else { write!(self.out, "{x:?} ") }
    }
    fn line(&mut self) -> std::io::Result<()> {
        if self.binary { Ok(()) } else { writeln!(self.out) }
    }
    /// The end of a section of data.
    fn end(&mut self, section: &str) -> std::io::Result<()> {
        let line = if self.binary { "\n" } else { "" };
        self.text(&format!("{line}$End{section}\n"))
    }
    fn text(&mut self, x: &str) -> std::io::Result<()> {
        self.out.write_all(x.as_bytes())
    }
}

/// Elements of one entity and shape, each a list of nodes (from 0).
struct Run {
    dimension: i32,
    entity: i32,
    shape: ElementShape,
    elements: Vec<Vec<u32>>,
}

/// Nodes of the shape that a collapsed hexahedron is, in Gmsh's order.
fn cell(nodes: &[u32; 8]) -> (ElementShape, Vec<u32>) {
    let (shape, n) = volume_shape(nodes);
    // VTK's wedge turns its triangles the other way.
    if shape == ElementShape::Prism { (shape, vec![n[0], n[2], n[1], n[3], n[5], n[4]]) } else { (shape, n) }
}

fn face(nodes: [u32; 4]) -> (ElementShape, Vec<u32>) {
    match clean_face(nodes) {
        Some([a, b, c, d]) if c == d => (ElementShape::Triangle, vec![a, b, c]),
        Some(n) => (ElementShape::Quadrilateral, n.to_vec()),
        None => (ElementShape::Quadrilateral, nodes.to_vec()),
    }
}

/// Adds elements in their order: a new run wherever the shape changes.
fn runs(
    list: &mut Vec<Run>,
    dimension: i32,
    entity: i32,
    elements: impl Iterator<Item = (ElementShape, Vec<u32>)>,
) {
    let first = list.len();
    for (shape, nodes) in elements {
        if list.len() == first || list[list.len() - 1].shape != shape {
            list.push(Run { dimension, entity, shape, elements: Vec::new() });
        }
        list.last_mut().expect("pushed above").elements.push(nodes);
    }
}

/// Writes `grid` as Gmsh 4.1, without cells the canopy alone. The canopy becomes the physical group `membrane`;
/// `name` gives the group of each face of [`FlowGrid::boundary`], by its number.
/// Nodes keep their order (tags from 1), and so do cells.
///
/// # Errors
/// The file cannot be written.
pub fn write_msh(
    path: &Path,
    grid: &FlowGrid,
    membrane: &str,
    name: impl Fn(usize) -> String,
    binary: bool,
) -> Result<(), MeshError> {
    let mut patches: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    (0..grid.boundary.len()).for_each(|k| patches.entry(name(k)).or_default().push(k));
    let mut all = Vec::new();
    let mut groups = Vec::new();
    if !grid.cells.is_empty() {
        groups.push((3, 1, "air".to_owned()));
        runs(&mut all, 3, 1, grid.cells.iter().map(cell));
    }
    if !grid.canopy_faces.is_empty() {
        groups.push((2, 1, membrane.to_owned()));
        runs(&mut all, 2, 1, grid.canopy_faces.iter().map(|f| face(*f)));
    }
    for (k, (name, faces)) in patches.into_iter().enumerate() {
        let entity = k as i32 + 2;
        groups.push((2, entity, name));
        runs(&mut all, 2, entity, faces.iter().map(|&f| face(grid.boundary[f].1)));
    }
    write_aside(path, |out| put(&mut Sink { out, binary }, grid, &groups, &all).map_err(|e| e.to_string()))
}

fn put(w: &mut Sink, grid: &FlowGrid, groups: &[(i32, i32, String)], all: &[Run]) -> std::io::Result<()> {
    w.text(&format!("$MeshFormat\n4.1 {} 8\n", i32::from(w.binary)))?;
    if w.binary {
        w.int(1)?;
        w.text("\n")?;
    }
    w.text(&format!("$EndMeshFormat\n$PhysicalNames\n{}\n", groups.len()))?;
    for (dimension, tag, name) in groups {
        w.text(&format!("{dimension} {tag} \"{name}\"\n"))?;
    }
    w.text("$EndPhysicalNames\n$Entities\n")?;
    put_entities(w, grid, groups)?;
    w.end("Entities")?;
    w.text("$Nodes\n")?;
    put_nodes(w, grid)?;
    w.end("Nodes")?;
    w.text("$Elements\n")?;
    put_elements(w, all)?;
    w.end("Elements")
}

fn put_entities(w: &mut Sink, grid: &FlowGrid, groups: &[(i32, i32, String)]) -> std::io::Result<()> {
    let of = |dimension: i32| groups.iter().filter(|g| g.0 == dimension).count();
    for n in [0, 0, of(2), of(3)] {
        w.size(n)?;
    }
    w.line()?;
    let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for x in &grid.coords {
        for d in 0..3 {
            (lo[d], hi[d]) = (lo[d].min(x[d]), hi[d].max(x[d]));
        }
    }
    // Surfaces first, then the volume that they bound.
    for (dimension, tag, _) in groups.iter().filter(|g| g.0 == 2).chain(groups.iter().filter(|g| g.0 == 3)) {
        w.int(*tag)?;
        for x in lo.into_iter().chain(hi) {
            w.real(x)?;
        }
        w.size(1)?;
        w.int(*tag)?;
        if *dimension == 2 {
            w.size(0)?;
        } else {
            w.size(of(2))?;
            for g in groups.iter().filter(|g| g.0 == 2) {
                w.int(g.1)?;
            }
        }
        w.line()?;
    }
    Ok(())
}

fn put_nodes(w: &mut Sink, grid: &FlowGrid) -> std::io::Result<()> {
    let n = grid.coords.len();
    for x in [1, n, 1, n] {
        w.size(x)?;
    }
    w.line()?;
    let dimension = if grid.cells.is_empty() { 2 } else { 3 };
    for x in [dimension, 1, 0] {
        w.int(x)?;
    }
    w.size(n)?;
    w.line()?;
    for tag in 1..=n {
        w.size(tag)?;
        w.line()?;
    }
    for x in &grid.coords {
        for v in x {
            w.real(*v)?;
        }
        w.line()?;
    }
    Ok(())
}

fn put_elements(w: &mut Sink, all: &[Run]) -> std::io::Result<()> {
    let count = all.iter().map(|r| r.elements.len()).sum();
    for x in [all.len(), count, 1, count] {
        w.size(x)?;
    }
    w.line()?;
    let mut tag = 0;
    for run in all {
        for x in [run.dimension, run.entity, run.shape.number()] {
            w.int(x)?;
        }
        w.size(run.elements.len())?;
        w.line()?;
        for nodes in &run.elements {
            tag += 1;
            w.size(tag)?;
            for &n in nodes {
                w.size(n as usize + 1)?;
            }
            w.line()?;
        }
    }
    Ok(())
}
