//! A flow grid from a Gmsh file.
//!
//! The canopy is a named surface inside the volume: its nodes are shared by the cells
//! on both sides, which is how [`FlowGrid`] says that a wall has no thickness, so its
//! faces need only be found, not split. With [`GridFile::one_sided`] it is a surface of the
//! boundary. Canopy nodes come first, in the canopy's order.

use std::collections::{BTreeSet, HashMap};

use case::{Condition, GridFile};

use super::file_error::GridFileError;
use super::sizes::GridSizes;
use crate::geometry::{Point, Vec3, distinct};
use crate::msh::{ElementShape, Msh};
use crate::quality;
use crate::{FaceTable, FlowGrid, Graph, MeshError, StructureMesh, clean_face};

/// Canopy nodes may be off by this share of the canopy's size: a file has few digits.
const NEAR: f64 = 1e-5;

/// The grid of `file` around the canopy at `positions`.
///
/// # Errors
/// The file cannot be read; [`MeshError::GridFile`] where its content is invalid.
pub(super) fn from_file(
    file: &GridFile,
    canopy: &StructureMesh,
    positions: &[Point],
) -> Result<FlowGrid, MeshError> {
    let msh = Msh::read(&file.path)?;
    Reader { file, msh }.grid(canopy, positions).map_err(|e| match e {
        Trouble::File(source) => MeshError::GridFile { path: file.path.clone(), source: Box::new(source) },
        Trouble::Mesh(e) => e,
    })
}

/// What is wrong with a canopy face.
const NOT_TWO_CELLS: &str = "is not between two cells; if a given pressure without fluid is on its other side, set \
     flow.grid_file.one_sided = { ambient_pressure_pa = ... }";
const NOT_ONE_CELL: &str = "does not have a cell on one side only, as flow.grid_file.one_sided asks for; remove that key \
     where fluid is on both sides";

/// Cells and nodes of `file`, whatever shape the canopy has.
///
/// # Errors
/// The file cannot be read, or has no volume elements.
pub(super) fn sizes(file: &GridFile) -> Result<GridSizes, MeshError> {
    let msh = Msh::read(&file.path)?;
    let volumes = || msh.blocks.iter().filter(|b| b.shape.is_volume());
    let nodes: BTreeSet<u64> = volumes().flat_map(|b| b.nodes.iter().copied()).collect();
    match volumes().map(|b| b.elements().count() as u64).sum() {
        0 => {
            let source = Box::new(GridFileError::NoVolume);
            Err(MeshError::GridFile { path: file.path.clone(), source })
        }
        cells => Ok(GridSizes { cells, nodes: nodes.len() as u64 }),
    }
}

enum Trouble {
    File(GridFileError),
    Mesh(MeshError),
}

impl From<GridFileError> for Trouble {
    fn from(e: GridFileError) -> Self {
        Trouble::File(e)
    }
}

struct Reader<'a> {
    file: &'a GridFile,
    msh: Msh,
}

/// The surface elements of the file, by what the scene says of their groups.
#[derive(Default)]
struct Surfaces<'a> {
    /// Place of the group in the scene's list of patches, and the nodes.
    patches: Vec<(usize, &'a [u64])>,
    membrane: Vec<&'a [u64]>,
    /// Name of a group that the scene says nothing of, and the nodes.
    others: Vec<(&'a str, &'a [u64])>,
}

/// Grid nodes of an element of the file: `None` where one of them belongs to no cell.
fn numbered(number: &HashMap<u64, u32>, nodes: &[u64]) -> Option<[u32; 4]> {
    let at = |k: usize| nodes.get(k).or(nodes.last()).and_then(|n| number.get(n)).copied();
    Some([at(0)?, at(1)?, at(2)?, at(3)?])
}

impl Reader<'_> {
    fn grid(&self, canopy: &StructureMesh, positions: &[Point]) -> Result<FlowGrid, Trouble> {
        self.check_names(canopy)?;
        let conditions: Vec<(&String, &Condition)> = self.file.patches.iter().collect();
        let surfaces = self.surfaces(&conditions, !canopy.faces.is_empty());
        let patch_names = conditions.iter().map(|(name, _)| (*name).clone()).collect();
        let one_sided = self.file.one_sided.is_some();
        let mut grid = FlowGrid { patch_names, one_sided, ..FlowGrid::default() };
        let mut number = self.canopy_nodes(&mut grid, canopy, positions, &surfaces.membrane)?;
        let elements = self.cells(&mut grid, &mut number);
        check_cells(&grid, &elements)?;
        for (k, nodes) in &surfaces.patches {
            let (name, condition) = conditions[*k];
            let face = numbered(&number, nodes).ok_or_else(|| GridFileError::Misplaced {
                name: name.clone(),
                place: self.middle(nodes),
                what: "is not a face of any cell",
            })?;
            grid.boundary.push((*condition, face));
            // The scene has at most 65 535 patches.
            grid.boundary_patch.push(*k as u16);
        }
        let place =
            |name: &String| conditions.iter().position(|(n, _)| *n == name).map_or(u16::MAX, |k| k as u16);
        grid.periodic = self.file.periodic.iter().map(|[a, b]| [place(a), place(b)]).collect();
        self.canopy_faces(&mut grid, canopy, &surfaces.membrane, &number)?;
        let table = FaceTable::new(&grid).map_err(|e| match e {
            MeshError::OpenFace { nodes, cell } => {
                let open = key(nodes);
                let named = surfaces.others.iter().find(|(_, n)| numbered(&number, n).map(key) == Some(open));
                Trouble::File(match named {
                    Some((name, _)) => GridFileError::NoCondition { name: (*name).into() },
                    None => GridFileError::NoGroup { element: elements[cell].1, place: middle(&grid, nodes) },
                })
            }
            MeshError::UnmatchedFace { kind, nodes, index } => {
                let place = middle(&grid, nodes);
                let (name, what) = if kind == "canopy" {
                    (&self.file.membrane, if one_sided { NOT_ONE_CELL } else { NOT_TWO_CELLS })
                } else {
                    let name = conditions[surfaces.patches[index].0].0;
                    (name, "is not on the outer boundary of the volume, or occurs twice")
                };
                GridFileError::Misplaced { name: name.clone(), place, what }.into()
            }
            e => Trouble::Mesh(e),
        })?;
        connected(&grid, &table, &elements)?;
        orthogonal(&grid, &table, &elements)?;
        Ok(grid)
    }

    /// The surface elements by their groups; without a canopy no group is the membrane.
    fn surfaces(&self, conditions: &[(&String, &Condition)], canopy: bool) -> Surfaces<'_> {
        let mut surfaces = Surfaces::default();
        let flat = |s| matches!(s, ElementShape::Triangle | ElementShape::Quadrilateral);
        for block in self.msh.blocks.iter().filter(|b| flat(b.shape)) {
            let names: Vec<&str> = self.msh.names_of(block.entity).collect();
            let patch = conditions.iter().position(|(n, _)| names.contains(&n.as_str()));
            for (_, nodes) in block.elements() {
                if canopy && names.contains(&self.file.membrane.as_str()) {
                    surfaces.membrane.push(nodes);
                } else if let Some(k) = patch {
                    surfaces.patches.push((k, nodes));
                } else if let Some(name) = names.first() {
                    surfaces.others.push((name, nodes));
                }
            }
        }
        surfaces
    }

    fn check_names(&self, canopy: &StructureMesh) -> Result<(), GridFileError> {
        let groups = self.msh.names_in(2);
        let wanted = self.file.patches.keys().map(|n| (n, "flow.grid_file.patches"));
        let membrane = Some((&self.file.membrane, "flow.grid_file.membrane"));
        let membrane = membrane.filter(|_| !canopy.faces.is_empty());
        for (name, key) in wanted.chain(membrane) {
            if !groups.contains(name) {
                return Err(GridFileError::NoSuchGroup { name: name.clone(), key, groups });
            }
        }
        Ok(())
    }

    fn middle(&self, nodes: &[u64]) -> Point {
        mean(nodes.iter().filter_map(|n| self.msh.nodes.get(n)))
    }

    /// Puts the canopy's nodes first: number of each of the file's nodes among them.
    fn canopy_nodes(
        &self,
        grid: &mut FlowGrid,
        canopy: &StructureMesh,
        positions: &[Point],
        membrane: &[&[u64]],
    ) -> Result<HashMap<u64, u32>, GridFileError> {
        let tags: BTreeSet<u64> = membrane.iter().flat_map(|n| n.iter().copied()).collect();
        // In order along x: what is near lies within a window of it.
        let mut sorted: Vec<(f64, u64)> = tags.iter().map(|t| (self.msh.nodes[t][0], *t)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let middle = Vec3::from(mean(positions));
        let size = positions.iter().map(|x| (Vec3::from(*x) - middle).norm()).fold(0.0, f64::max);
        let near = NEAR * size;
        let mut number = HashMap::new();
        for (node, &x) in positions.iter().enumerate() {
            let from = sorted.partition_point(|s| s.0 < x[0] - near);
            let window = sorted[from..].iter().take_while(|s| s.0 <= x[0] + near);
            let distance = |t: u64| (Vec3::from(self.msh.nodes[&t]) - Vec3::from(x)).norm();
            let free = window.filter(|(_, t)| !number.contains_key(t));
            let best = free.map(|(_, t)| (distance(*t), *t)).min_by(|a, b| a.0.total_cmp(&b.0));
            match best {
                Some((d, tag)) if d <= near => {
                    number.insert(tag, node as u32);
                }
                _ => {
                    let distance = tags.iter().map(|t| distance(*t)).fold(f64::INFINITY, f64::min);
                    let membrane = self.file.membrane.clone();
                    return Err(GridFileError::NoNode { node, place: x, distance, membrane });
                }
            }
        }
        // The canopy's own digits, so that both programs have the same shape.
        grid.coords = positions.to_vec();
        grid.canopy_nodes = (0..canopy.n_canopy as u32).collect();
        Ok(number)
    }

    /// Adds the cells and their nodes in the order of the file (nodes by their tags):
    /// shape and tag of each cell.
    fn cells(&self, grid: &mut FlowGrid, number: &mut HashMap<u64, u32>) -> Vec<(ElementShape, u64)> {
        let volumes = || self.msh.blocks.iter().filter(|b| b.shape.is_volume());
        let used: BTreeSet<u64> = volumes().flat_map(|b| b.nodes.iter().copied()).collect();
        for tag in used {
            number.entry(tag).or_insert_with(|| {
                grid.coords.push(self.msh.nodes[&tag]);
                grid.coords.len() as u32 - 1
            });
        }
        let mut elements = Vec::new();
        for block in volumes() {
            for (tag, nodes) in block.elements() {
                let n = |k: usize| number[&nodes[k]];
                grid.cells.push(match block.shape {
                    ElementShape::Hexahedron => std::array::from_fn(n),
                    ElementShape::Prism => [0, 1, 2, 2, 3, 4, 5, 5].map(n),
                    ElementShape::Pyramid => [0, 1, 2, 3, 4, 4, 4, 4].map(n),
                    _ => [0, 1, 2, 2, 3, 3, 3, 3].map(n),
                });
                elements.push((block.shape, tag));
            }
        }
        elements
    }

    fn canopy_faces(
        &self,
        grid: &mut FlowGrid,
        canopy: &StructureMesh,
        membrane: &[&[u64]],
        number: &HashMap<u64, u32>,
    ) -> Result<(), GridFileError> {
        let own: BTreeSet<[u32; 4]> = canopy.faces.iter().map(|f| key(*f)).collect();
        let found: BTreeSet<[u32; 4]> =
            membrane.iter().filter_map(|n| numbered(number, n)).map(key).collect();
        if own != found {
            return Err(GridFileError::OtherFaces {
                membrane: self.file.membrane.clone(),
                found: membrane.len(),
                common: own.intersection(&found).count(),
                expected: canopy.faces.len(),
            });
        }
        grid.canopy_faces = canopy.faces.clone();
        Ok(())
    }
}

fn mean<'a>(points: impl IntoIterator<Item = &'a Point>) -> Point {
    let (sum, n) = points.into_iter().fold((Vec3::zeros(), 0.0), |(s, n), x| (s + Vec3::from(*x), n + 1.0));
    (sum * (1.0 / f64::max(n, 1.0))).into()
}

fn middle(grid: &FlowGrid, nodes: [u32; 4]) -> Point {
    mean(distinct(&nodes).iter().map(|&n| &grid.coords[n as usize]))
}

/// A face in whatever cycle.
fn key(face: [u32; 4]) -> [u32; 4] {
    let mut f = clean_face(face).unwrap_or(face);
    if f[2] == f[3] {
        f[3] = u32::MAX;
    }
    f.sort_unstable();
    f
}

/// Errs where there is no cell, and on the first that is inside out.
fn check_cells(grid: &FlowGrid, elements: &[(ElementShape, u64)]) -> Result<(), GridFileError> {
    if grid.cells.is_empty() {
        return Err(GridFileError::NoVolume);
    }
    for (cell, &(shape, element)) in elements.iter().enumerate() {
        let volume = quality::cell_volume(grid, cell);
        if volume.is_nan() || volume <= 0.0 {
            let (shape, place) = (shape.name(), quality::cell_centre(grid, cell));
            return Err(GridFileError::Inverted { shape, element, cell, place, volume });
        }
    }
    Ok(())
}

/// Angle between the normal of a face and the line of the two cell centres, degrees, from which a face counts as non-orthogonal, and the
/// share of such faces that is refused. In a cavity of tetrahedra or pyramids five times flatter than wide no face is beyond it and a step takes 30
/// iterations; ten times flatter, over a tenth is, and steps take over 100 or stall.
const STEEP: f64 = 78.0;
const STEEP_SHARE: f64 = 0.1;

/// Refuses grids whose cells are so flat that the flow could not be solved on them.
fn orthogonal(
    grid: &FlowGrid,
    faces: &FaceTable,
    elements: &[(ElementShape, u64)],
) -> Result<(), GridFileError> {
    let angles = crate::quality_report::non_orthogonality(grid, faces);
    let steep = angles.iter().filter(|(angle, _)| *angle > STEEP).count();
    let share = steep as f64 / angles.len().max(1) as f64;
    match angles.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((worst, cell)) if share > STEEP_SHARE => {
            let place = mean(grid.cells[cell as usize].iter().map(|&v| &grid.coords[v as usize]));
            let element = elements[cell as usize].1;
            Err(GridFileError::NonOrthogonal {
                share,
                allowed: STEEP_SHARE,
                limit: STEEP,
                worst,
                element,
                place,
            })
        }
        _ => Ok(()),
    }
}

/// Errs where the volume falls apart; the two sides of a canopy count as neighbours.
fn connected(
    grid: &FlowGrid,
    table: &FaceTable,
    elements: &[(ElementShape, u64)],
) -> Result<(), GridFileError> {
    let graph = Graph::of_cells(grid.cells.len(), table);
    let mut part = vec![0usize; graph.len()];
    let (mut parts, mut second) = (0, None);
    let mut queue = Vec::new();
    for seed in 0..graph.len() {
        if part[seed] != 0 {
            continue;
        }
        parts += 1;
        if parts == 2 {
            second = Some(seed);
        }
        part[seed] = parts;
        queue.push(seed as u32);
        while let Some(c) = queue.pop() {
            for &n in graph.of(c as usize) {
                if part[n as usize] == 0 {
                    part[n as usize] = parts;
                    queue.push(n);
                }
            }
        }
    }
    match second {
        None => Ok(()),
        Some(cell) => {
            let place = quality::cell_centre(grid, cell);
            Err(GridFileError::Unconnected { parts, element: elements[cell].1, place })
        }
    }
}
