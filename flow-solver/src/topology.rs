//! The part of a grid that one rank works on.
//!
//! Cells are numbered locally: owned ones first, then one layer of ghosts. Faces
//! are numbered flat: between two cells first, then the outer boundary, then the
//! canopy. A wall of zero thickness is one face with two sides.

use std::collections::HashMap;

use comm::Numbering;
use mesh::{FaceNodes, FaceTable, FlowGrid, Patch, clean_face};

use crate::face_permeability::FacePermeability;
use crate::geometry::vec3::Vec3;
use crate::periodic::{self, Shift, opposite};
use crate::physics::Permeability;
use crate::stencil::Neighbourhoods;

/// Cells from the canopy or a wall in which the convective flux stays upwind. The velocity is singular at a rim: with central
/// fluxes up to the plate, the drag of the square plate at Re 200 on 31 360 cells is 1.410 instead of 1.524; with 1, 2, 3, 5
/// upwind cells it is 1.461, 1.512, 1.520, 1.524.
const WALL_CELLS: usize = 3;

/// In [`Topology::region`]: air enters or leaves.
pub const OPEN_REGION: u16 = u16::MAX;

/// How one side of a boundary face acts on its cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// Local face.
    pub face: u32,
    /// Local (owned) cell.
    pub cell: u32,
    /// +1 where the face's area vector points out of the cell, else -1.
    pub sign: f64,
    /// Local canopy face, or `u32::MAX` on the outer boundary.
    pub canopy: u32,
}

/// Patch of a face of the outer boundary that belongs to no named patch.
pub const NO_PATCH: u16 = u16::MAX;

/// Sides of one open boundary condition.
#[derive(Clone, Debug)]
pub struct OpenSides {
    /// The condition, see [`crate::physics::open_boundary`].
    pub patch: Patch,
    /// At least one.
    pub sides: Vec<Side>,
}

/// A permeable canopy face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PorousFace {
    /// Local face; its area vector points from inside to outside.
    pub face: u32,
    /// Local cell inside; one of the two cells is owned.
    pub inside: u32,
    /// Local cell outside.
    pub outside: u32,
    /// Its resistance.
    pub cloth: Permeability,
}

/// Cells, faces and nodes of one rank.
#[derive(Clone, Debug, Default)]
pub struct Topology {
    /// Owned and ghost cells.
    pub numbering: Numbering,
    /// Number of owned cells.
    pub n_owned: usize,
    /// Global number of each local node.
    pub node_global: Vec<u64>,
    /// Local nodes of each owned cell, in VTK order.
    pub cell_nodes: Vec<[u32; 8]>,
    /// Local nodes of each face; a triangle repeats its last node.
    pub face_nodes: Vec<[u32; 4]>,
    /// Number in the whole grid of each face: between cells, boundary, canopy, periodic patches. Both copies of a periodic face have one number.
    pub face_global: Vec<u32>,
    /// First and second cell of each face between cells: the first
    /// `cells.len()` faces. At least one of them is owned.
    pub cells: Vec<[u32; 2]>,
    /// Ghosts that are images of cells in a periodic domain, and by how much they are moved, m.
    pub images: Vec<(u32, Vec3)>,
    /// Translations of the periodic domain, m.
    pub periods: Vec<Vec3>,
    /// Faces between owned cells: the first ones of all.
    pub n_inside: usize,
    /// Whether the fluxes of each local cell stay upwind: near the canopy or a wall, and at the outer boundary but for planes of symmetry, where
    /// one-sided gradients feed energy to a central flux.
    pub upwind: Vec<bool>,
    /// Region of each local cell that no air enters or leaves, from 0; [`OPEN_REGION`] in all others.
    pub region: Vec<u16>,
    /// Regions of the whole grid that no air enters or leaves.
    pub n_closed_regions: usize,
    /// Patch of each local face of the outer boundary, the first of which is face `cells.len()`, as
    /// [`FlowGrid::boundary_patch`]; [`NO_PATCH`] without a name.
    pub boundary_patch: Vec<u16>,
    /// Walls where nothing rubs: slip, inviscid canopy.
    pub slip: Vec<Side>,
    /// Sides in planes of symmetry, sorted by cell.
    pub symmetry: Vec<Side>,
    /// Sides where air sticks to the wall.
    pub no_slip: Vec<Side>,
    /// Sides that air passes, by their condition, in the order of [`Patch`].
    pub open: Vec<OpenSides>,
    /// Canopy faces: owned ones (owner: the rank of the inside cell, of the only cell where there is one), then those
    /// of which only the outside cell is owned here.
    pub canopy: Numbering,
    /// Face of each local canopy face.
    pub canopy_face: Vec<u32>,
    /// Every canopy face has a cell on one side only; the pressure on the other is
    /// [`Settings::ambient_pressure`](crate::Settings::ambient_pressure).
    pub one_sided: bool,
    /// Canopy faces that let air through, where at least one side is owned; their sides
    /// are listed as walls too. Empty where the canopy is airtight.
    pub porous_faces: Vec<PorousFace>,
    /// Neighbours of owned cells.
    pub adjacency: Adjacency,
    /// Cells that gradients are taken over, where these are not the neighbours.
    pub wide: Option<Adjacency>,
}

/// Neighbours of the owned cells, in compressed rows.
#[derive(Clone, Debug, Default)]
pub struct Adjacency {
    /// Row `i` is `start[i]..start[i + 1]`.
    pub start: Vec<u32>,
    /// Neighbour cell of each entry; rows are sorted.
    pub cell: Vec<u32>,
    /// First entry of each row whose cell is larger than the row.
    pub upper: Vec<u32>,
    /// First entry of each row whose cell is a ghost.
    pub ghost: Vec<u32>,
    /// Entries of each face between cells: in the row of its first and of its
    /// second cell. A ghost's row does not exist: one entry past the end.
    pub slot: Vec<[u32; 2]>,
}

impl Adjacency {
    /// Of the cells that faces between `cells` join.
    pub fn new(n_owned: usize, cells: &[[u32; 2]]) -> Self {
        let mut rows: Vec<Vec<(u32, u32, usize)>> = vec![Vec::new(); n_owned];
        for (f, &[i, j]) in cells.iter().enumerate() {
            for (a, b, side) in [(i, j, 0), (j, i, 1)] {
                if (a as usize) < n_owned {
                    rows[a as usize].push((b, f as u32, side));
                }
            }
        }
        let mut adjacency =
            Self { start: vec![0], slot: vec![[u32::MAX; 2]; cells.len()], ..Self::default() };
        for (i, row) in rows.iter_mut().enumerate() {
            row.sort_unstable();
            for &(j, f, side) in row.iter() {
                adjacency.slot[f as usize][side] = adjacency.cell.len() as u32;
                adjacency.cell.push(j);
            }
            let at = adjacency.start[i];
            let count = |p: &dyn Fn(u32) -> bool| row.iter().filter(|&&(j, ..)| p(j)).count() as u32;
            adjacency.upper.push(at + count(&|j| j < i as u32));
            adjacency.ghost.push(at + count(&|j| j < n_owned as u32));
            adjacency.start.push(adjacency.cell.len() as u32);
        }
        let past = adjacency.cell.len() as u32;
        adjacency.slot.iter_mut().flatten().filter(|s| **s == u32::MAX).for_each(|s| *s = past);
        adjacency
    }
}

impl Topology {
    /// What `rank` works on, where `part[cell]` is the owner of each cell.
    /// `order` lists all cells in the order in which owned ones are numbered.
    /// `viscous` makes the canopy a no-slip wall.
    pub fn new(
        grid: &FlowGrid,
        faces: &FaceTable,
        part: &[u32],
        order: &[u32],
        rank: u32,
        viscous: bool,
    ) -> Self {
        Self::with_cloth(grid, faces, part, order, rank, viscous, &FacePermeability::default())
    }

    /// As [`Topology::new`], with a canopy of permeability `cloth`: where air passes any face, each rank has both cells of its canopy faces.
    pub fn with_cloth(
        grid: &FlowGrid,
        faces: &FaceTable,
        part: &[u32],
        order: &[u32],
        rank: u32,
        viscous: bool,
        cloth: &FacePermeability,
    ) -> Self {
        let wide = Neighbourhoods::new(grid, faces);
        let numbering = numbered(faces, Owners { part, rank }, order, cloth.is_any(), wide.as_ref());
        let periods = periodic::periods(&faces.periodic);
        let images = images(&numbering, &periods);
        let mut parts = Builder {
            grid,
            faces,
            of: Owners { part, rank },
            node_local: HashMap::new(),
            t: Self {
                n_owned: numbering.n_owned,
                one_sided: grid.one_sided,
                numbering,
                images,
                periods,
                ..Self::default()
            },
        };
        parts.add_cells();
        parts.add_interior();
        parts.add_boundary();
        parts.add_canopy(viscous, cloth);
        let mut t = parts.t;
        t.adjacency = Adjacency::new(t.n_owned, &t.cells);
        let upwind = upwind_cells(grid.cells.len(), faces);
        t.upwind = t.numbering.global.iter().map(|&c| upwind[c as usize]).collect();
        let (region, n_closed_regions) = closed_regions(grid.cells.len(), faces, cloth);
        t.region = t.numbering.global.iter().map(|&c| region[c as usize]).collect();
        t.n_closed_regions = n_closed_regions;
        t.wide = wide.map(|w| w.rows(&t.numbering));
        t
    }

    /// Owned and ghost cells together.
    pub fn n_local(&self) -> usize {
        self.numbering.n_local()
    }

    /// Cells that the gradient of each owned cell is taken over (of the adjacency only
    /// `start`, `cell` and `ghost`).
    pub fn stencil(&self) -> &Adjacency {
        self.wide.as_ref().unwrap_or(&self.adjacency)
    }

    /// All sides that air passes.
    pub fn open_sides(&self) -> impl Iterator<Item = &Side> {
        self.open.iter().flat_map(|o| &o.sides)
    }

    /// The open sides of the condition `patch`.
    pub fn sides_of(&self, patch: Patch) -> impl Iterator<Item = &Side> + Clone {
        self.open.iter().filter(move |o| o.patch == patch).flat_map(|o| &o.sides)
    }

    /// Named patch of a side of the outer boundary; `None` on the canopy and without a name.
    pub fn patch_of(&self, side: &Side) -> Option<u16> {
        let place = (side.face as usize).checked_sub(self.cells.len())?;
        self.boundary_patch.get(place).copied().filter(|p| *p != NO_PATCH)
    }

    /// All sides of boundary and canopy faces.
    pub fn sides(&self) -> impl Iterator<Item = &Side> {
        self.slip.iter().chain(&self.symmetry).chain(&self.no_slip).chain(self.open_sides())
    }

    /// Calls `visit(face, cell, sign)` for each side of each face; `sign` is +1
    /// where the area vector points out of the cell.
    pub fn for_each_side(&self, mut visit: impl FnMut(usize, usize, f64)) {
        for (f, &[i, j]) in self.cells.iter().enumerate() {
            visit(f, i as usize, 1.0);
            visit(f, j as usize, -1.0);
        }
        for s in self.sides() {
            visit(s.face as usize, s.cell as usize, s.sign);
        }
    }
}

/// Pairs of cells of the whole grid with a face between them, periodic ones included.
fn neighbours(faces: &FaceTable) -> impl Iterator<Item = (u32, u32)> {
    let inside = faces.interior.iter().map(|&(_, i, j)| (i, j));
    inside.chain(faces.periodic.faces.iter().map(|f| (f.cells[0], f.cells[1])))
}

/// Ghosts that are images, and by how much they are moved, m.
fn images(numbering: &Numbering, periods: &[Vec3]) -> Vec<(u32, Vec3)> {
    let moved = numbering.image.iter().zip(numbering.n_owned as u32..).filter(|(image, _)| **image != 0);
    moved.map(|(&image, ghost)| (ghost, Shift::of_number(image).translation(periods))).collect()
}

/// Cells of the whole grid whose fluxes stay upwind: at the outer boundary but for planes of symmetry, and within [`WALL_CELLS`] of the canopy or a wall,
/// counted over faces.
fn upwind_cells(cells: usize, faces: &FaceTable) -> Vec<bool> {
    let mut near = vec![false; cells];
    let walls = faces.boundary.iter().filter(|(patch, ..)| *patch == Patch::Wall).map(|&(_, _, c)| c);
    let canopy = faces.canopy.iter().flat_map(|c| c.sides()).map(|(cell, _)| cell);
    walls.chain(canopy).for_each(|c| near[c as usize] = true);
    for _ in 1..WALL_CELLS {
        let before = near.clone();
        for (i, j) in neighbours(faces) {
            let touched = before[i as usize] || before[j as usize];
            near[i as usize] |= touched;
            near[j as usize] |= touched;
        }
    }
    let outer =
        faces.boundary.iter().filter(|(patch, ..)| !matches!(patch, Patch::Symmetry | Patch::Periodic));
    outer.for_each(|&(_, _, c)| near[c as usize] = true);
    near
}

/// Regions of cells of the whole grid that no air enters or leaves, and their number; air passes faces of the canopy by `cloth`.
fn closed_regions(cells: usize, faces: &FaceTable, cloth: &FacePermeability) -> (Vec<u16>, usize) {
    let mut root: Vec<u32> = (0..cells as u32).collect();
    fn find(root: &mut [u32], mut c: u32) -> u32 {
        while root[c as usize] != c {
            root[c as usize] = root[root[c as usize] as usize];
            c = root[c as usize];
        }
        c
    }
    let through =
        faces.canopy.iter().enumerate().filter(|(k, _)| cloth.at(*k).is_some()).filter_map(|(_, c)| c.both());
    for (i, j) in neighbours(faces).chain(through) {
        let (a, b) = (find(&mut root, i), find(&mut root, j));
        root[a.max(b) as usize] = a.min(b);
    }
    let mut number: HashMap<u32, u16> = HashMap::new();
    for &(patch, _, c) in &faces.boundary {
        if !matches!(patch, Patch::Wall | Patch::Slip | Patch::Symmetry | Patch::Periodic) {
            number.insert(find(&mut root, c), OPEN_REGION);
        }
    }
    let mut closed = 0;
    let region = (0..cells as u32).map(|c| {
        *number.entry(find(&mut root, c)).or_insert_with(|| {
            closed += 1;
            // More are not counted: their mass is what the pressure equation makes it.
            u16::try_from(closed - 1).unwrap_or(OPEN_REGION)
        })
    });
    (region.collect(), closed.min(OPEN_REGION as usize))
}

/// Owners of the cells of the whole grid, as one rank sees them.
#[derive(Clone, Copy)]
struct Owners<'a> {
    part: &'a [u32],
    rank: u32,
}

impl Owners<'_> {
    fn is_mine(&self, cell: u32) -> bool {
        self.part[cell as usize] == self.rank
    }

    /// Cell and owner of that of two cells which is another rank's, where the other is mine.
    fn ghost(&self, i: u32, j: u32) -> Option<(u64, u32)> {
        let (pi, pj) = (self.part[i as usize], self.part[j as usize]);
        if pi != pj && pi == self.rank {
            Some((u64::from(j), pj))
        } else if pi != pj && pj == self.rank {
            Some((u64::from(i), pi))
        } else {
            None
        }
    }
}

/// Owned cells in their order, and the ghosts that faces, porous faces and gradients need.
fn numbered(
    faces: &FaceTable,
    of: Owners<'_>,
    order: &[u32],
    cloth: bool,
    wide: Option<&Neighbourhoods>,
) -> Numbering {
    let owned: Vec<u64> = order.iter().filter(|&&c| of.is_mine(c)).map(|&c| u64::from(c)).collect();
    let image = |(cell, shift): (u32, Shift)| (u64::from(cell), of.part[cell as usize], shift.number());
    let plain = |(cell, owner): (u64, u32)| (cell, owner, 0);
    let mut ghosts: Vec<(u64, u32, u32)> =
        faces.interior.iter().filter_map(|&(_, i, j)| of.ghost(i, j)).map(plain).collect();
    for face in &faces.periodic.faces {
        let mine = [0, 1].into_iter().filter(|&side| of.is_mine(face.cells[side]));
        ghosts.extend(mine.map(|side| image(opposite(face, side))));
    }
    if cloth {
        let pairs = faces.canopy.iter().filter_map(|c| c.both());
        ghosts.extend(pairs.filter_map(|(i, o)| of.ghost(i, o)).map(plain));
    }
    if let Some(wide) = wide {
        wide.of_all(&owned, |row| {
            let foreign = row.iter().filter(|&&(j, shift)| shift != Shift::default() || !of.is_mine(j));
            ghosts.extend(foreign.map(|&j| image(j)));
        });
    }
    Numbering::with_images(owned, ghosts)
}

/// A topology whose cells are numbered, as its faces are added: between cells, boundary, canopy.
struct Builder<'a> {
    grid: &'a FlowGrid,
    faces: &'a FaceTable,
    of: Owners<'a>,
    node_local: HashMap<u32, u32>,
    t: Topology,
}

impl Builder<'_> {
    /// Local numbers of nodes, which are given to new ones.
    fn nodes<const K: usize>(&mut self, nodes: [u32; K]) -> [u32; K] {
        let list = &mut self.t.node_global;
        nodes.map(|n| {
            *self.node_local.entry(n).or_insert_with(|| {
                list.push(u64::from(n));
                list.len() as u32 - 1
            })
        })
    }

    fn local(&self, cell: u32) -> Option<u32> {
        self.t.numbering.local(u64::from(cell)).map(|c| c as u32)
    }

    /// Adds a face of global nodes; returns its local number.
    fn add_face(&mut self, nodes: [u32; 4], global: usize) -> u32 {
        let nodes = self.nodes(nodes);
        self.t.face_nodes.push(nodes);
        self.t.face_global.push(global as u32);
        self.t.face_nodes.len() as u32 - 1
    }

    fn add_cells(&mut self) {
        for k in 0..self.t.n_owned {
            let cell = self.t.numbering.global[k];
            let nodes = self.nodes(self.grid.cells[cell as usize]);
            self.t.cell_nodes.push(nodes);
        }
    }

    fn add_interior(&mut self) {
        let mut interior: Vec<(usize, FaceNodes, u32, u32)> = Vec::new();
        for (f, &(nodes, i, j)) in self.faces.interior.iter().enumerate() {
            if let (true, Some(a), Some(b)) =
                (self.of.is_mine(i) || self.of.is_mine(j), self.local(i), self.local(j))
            {
                interior.push((f, nodes, a, b));
            }
        }
        self.add_periodic(&mut interior);
        // Those that need no ghost first; near in memory what is near in space.
        let n_owned = self.t.n_owned;
        let ghostly = |f: &(usize, FaceNodes, u32, u32)| f.2.max(f.3) as usize >= n_owned;
        interior.sort_by_key(|f| (ghostly(f), f.2.min(f.3), f.2.max(f.3)));
        self.t.n_inside = interior.partition_point(|f| !ghostly(f));
        for (f, nodes, a, b) in interior {
            self.add_face(nodes, f);
            self.t.cells.push([a, b]);
        }
    }

    /// Lists the faces of periodic patches at owned cells, with their first and second cell, one of them an image.
    fn add_periodic(&self, list: &mut Vec<(usize, FaceNodes, u32, u32)>) {
        let faces = self.faces;
        let before = faces.interior.len() + faces.boundary.len() + faces.canopy.len();
        for (k, face) in faces.periodic.faces.iter().enumerate() {
            for side in [0, 1] {
                if !self.of.is_mine(face.cells[side]) {
                    continue;
                }
                let (cell, shift) = opposite(face, side);
                let image = self.t.numbering.local_image(u64::from(cell), shift.number());
                let mut pair =
                    [self.local(face.cells[side]), image.map(|c| c as u32)].map(|c| c.expect("numbered"));
                if side == 1 {
                    pair.reverse();
                }
                list.push((before + k, face.nodes[side], pair[0], pair[1]));
            }
        }
    }

    fn add_boundary(&mut self) {
        let faces = self.faces;
        for (f, &(patch, nodes, c)) in faces.boundary.iter().enumerate() {
            if !self.of.is_mine(c) || patch == Patch::Periodic {
                continue;
            }
            let face = self.add_face(nodes, faces.interior.len() + f);
            let side = Side { face, cell: self.local(c).expect("owned"), sign: 1.0, canopy: u32::MAX };
            let t = &mut self.t;
            t.boundary_patch.push(self.grid.boundary_patch.get(f).copied().unwrap_or(NO_PATCH));
            match patch {
                Patch::Wall => t.no_slip.push(side),
                Patch::Slip => t.slip.push(side),
                // Its faces lie between cells.
                Patch::Periodic => {}
                Patch::Symmetry => t.symmetry.push(side),
                open => match t.open.iter_mut().find(|o| o.patch == open) {
                    Some(of_patch) => of_patch.sides.push(side),
                    None => t.open.push(OpenSides { patch: open, sides: vec![side] }),
                },
            }
        }
        self.t.open.sort_by_key(|o| o.patch);
        self.t.symmetry.sort_by_key(|side| side.cell);
    }

    fn add_canopy(&mut self, viscous: bool, cloth: &FacePermeability) {
        let faces = self.faces;
        let (mut mine, mut theirs) = (Vec::new(), Vec::new());
        for (k, cells) in faces.canopy.iter().enumerate() {
            let Some(first) = cells.first() else { continue };
            if self.of.is_mine(first) {
                mine.push(k as u64);
            } else if cells.outside.is_some_and(|outside| self.of.is_mine(outside)) {
                theirs.push((k as u64, self.of.part[first as usize]));
            }
        }
        let before = faces.interior.len() + faces.boundary.len();
        let canopy = Numbering::new(mine, theirs);
        for (k, &g) in canopy.global.iter().enumerate() {
            let cells = faces.canopy[g as usize];
            let nodes =
                clean_face(self.grid.canopy_faces[g as usize]).expect("the face table has checked it");
            let face = self.add_face(nodes, before + g as usize);
            self.t.canopy_face.push(face);
            let both = cells.both().and_then(|(i, o)| self.local(i).zip(self.local(o)));
            if let Some((cloth, (inside, outside))) = cloth.at(g as usize).zip(both) {
                self.t.porous_faces.push(PorousFace { face, inside, outside, cloth });
            }
            for (cell, sign) in cells.sides() {
                if self.of.is_mine(cell) {
                    let side = Side { face, cell: self.local(cell).expect("owned"), sign, canopy: k as u32 };
                    if viscous { self.t.no_slip.push(side) } else { self.t.slip.push(side) }
                }
            }
        }
        self.t.canopy = canopy;
    }
}
