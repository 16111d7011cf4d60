//! Who is whose neighbour: the faces of a volume grid.

use crate::periodic::{self, PeriodicFaces};
use crate::{FlowGrid, HEX_FACES, MeshError, Patch, quality};

/// A quadrilateral face in its cycle; a triangle repeats its last node.
pub type FaceNodes = [u32; 4];

/// Faces of a [`FlowGrid`]. Faces collapsed to an edge or a point are left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaceTable {
    /// Nodes, owner, neighbour. The right-hand normal points from owner to
    /// neighbour; the owner has the lower number; sorted by owner.
    pub interior: Vec<(FaceNodes, u32, u32)>,
    /// Cells of each canopy face.
    pub canopy: Vec<CanopyCells>,
    /// Condition, nodes (normal out of the domain) and cell, in the order of
    /// [`FlowGrid::boundary`].
    pub boundary: Vec<(Patch, FaceNodes, u32)>,
    /// Faces of the periodic patches, which lie between two cells.
    pub periodic: PeriodicFaces,
}

/// Cells of a canopy face, whose normal ([`FlowGrid::canopy_faces`]) points from inside to outside. With
/// [`FlowGrid::one_sided`] there is one of them, else both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanopyCells {
    /// Cell inside.
    pub inside: Option<u32>,
    /// Cell outside.
    pub outside: Option<u32>,
}

impl CanopyCells {
    /// Both cells; `None` where there is one.
    pub fn both(self) -> Option<(u32, u32)> {
        self.inside.zip(self.outside)
    }

    /// The cells, with +1 where the normal points out of the cell, else -1.
    pub fn sides(self) -> impl Iterator<Item = (u32, f64)> {
        [(self.inside, 1.0), (self.outside, -1.0)].into_iter().filter_map(|(cell, sign)| Some((cell?, sign)))
    }

    /// The cell inside; where there is none, the one outside. The rank of this cell owns the face.
    pub fn first(self) -> Option<u32> {
        self.inside.or(self.outside)
    }
}

/// The face without repeated neighbours in its cycle, triangles closed by
/// repeating the last node. `None` if fewer than three nodes are left.
pub fn clean_face(face: FaceNodes) -> Option<FaceNodes> {
    let mut out = [0; 4];
    let mut n = 0;
    for i in 0..4 {
        if face[i] != face[(i + 3) % 4] {
            out[n] = face[i];
            n += 1;
        }
    }
    match n {
        4 if out[0] != out[2] && out[1] != out[3] => Some(out),
        3 => Some([out[0], out[1], out[2], out[2]]),
        _ => None,
    }
}

/// The four nodes of a face of a cell, oriented out of the cell.
pub fn cell_face(cell: &[u32; 8], side: usize) -> Option<FaceNodes> {
    clean_face(HEX_FACES[side].map(|i| cell[i]))
}

/// A face in whatever cycle.
pub(crate) fn key(mut face: FaceNodes) -> FaceNodes {
    // A triangle counts its repeated node once: the free place takes the largest number.
    if face[2] == face[3] {
        face[3] = u32::MAX;
    }
    face.sort_unstable();
    face
}

/// Node after `node` in the cycle of a clean face.
fn after(face: FaceNodes, node: u32) -> u32 {
    let n = if face[2] == face[3] { 3 } else { 4 };
    let i = face.iter().position(|&f| f == node).unwrap_or(0);
    face[(i + 1) % n]
}

fn same_turn(a: FaceNodes, b: FaceNodes) -> bool {
    let start = key(a)[0];
    after(a, start) == after(b, start)
}

/// Neighbour of a face of a cell.
const OPEN: u32 = u32::MAX;
const NONE: u32 = u32::MAX - 1;
const TAKEN: u32 = u32::MAX - 2;

/// The sides of all cells (slot: six times the cell, and its side), by their smallest node.
struct Sides<'a> {
    cells: &'a [[u32; 8]],
    /// First of the list's rows of each node.
    start: Vec<u32>,
    /// The two next larger nodes of a side, which decide nearly every comparison, and its slot.
    list: Vec<(u32, u32, u32)>,
}

impl<'a> Sides<'a> {
    fn new(grid: &'a FlowGrid) -> Self {
        let cells = &grid.cells[..];
        let slots = cells.len() * 6;
        let face = |slot: usize| cell_face(&cells[slot / 6], slot % 6);
        let mut start = vec![0u32; grid.coords.len() + 1];
        for slot in 0..slots {
            if let Some(f) = face(slot) {
                start[key(f)[0] as usize + 1] += 1;
            }
        }
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut fill = start.clone();
        let mut list = vec![(0u32, 0u32, 0u32); *start.last().unwrap_or(&0) as usize];
        for slot in 0..slots {
            if let Some(f) = face(slot) {
                let [least, second, third, _] = key(f);
                let at = &mut fill[least as usize];
                list[*at as usize] = (second, third, slot as u32);
                *at += 1;
            }
        }
        Self { cells, start, list }
    }

    /// The side `slot`, out of its cell; `None` where it is collapsed.
    fn face(&self, slot: usize) -> Option<FaceNodes> {
        cell_face(&self.cells[slot / 6], slot % 6)
    }

    /// The same of a slot that is in the list.
    fn listed(&self, slot: u32) -> FaceNodes {
        self.face(slot as usize).expect("a listed face is clean")
    }

    /// Slots of the sides with the nodes of `f`.
    fn around(&self, f: FaceNodes) -> impl Iterator<Item = u32> + '_ {
        let f = key(f);
        let node = f[0] as usize;
        let rows = match self.start.get(node..node + 2) {
            Some(ends) => &self.list[ends[0] as usize..ends[1] as usize],
            None => &[],
        };
        let alike = move |s: u32| self.face(s as usize).map(key) == Some(f);
        rows.iter().filter(move |e| e.0 == f[1] && e.1 == f[2] && alike(e.2)).map(|e| e.2)
    }

    /// The slot on the other side of each slot, [`OPEN`] without one, [`NONE`] where it is collapsed.
    fn partners(&self) -> Result<Vec<u32>, MeshError> {
        let crowd = |f: FaceNodes| MeshError::NonManifoldFace {
            nodes: f,
            cells: self.around(f).map(|s| s as usize / 6).collect(),
        };
        let mut partner = vec![NONE; self.cells.len() * 6];
        for (slot, partner) in partner.iter_mut().enumerate() {
            let Some(f) = self.face(slot) else { continue };
            let mut others = self.around(f).filter(|&s| s as usize != slot);
            *partner = match (others.next(), others.next()) {
                (None, _) => OPEN,
                (Some(other), None) => other,
                _ => return Err(crowd(f)),
            };
            if *partner != OPEN && same_turn(f, self.listed(*partner)) {
                return Err(crowd(f));
            }
        }
        Ok(partner)
    }
}

impl FaceTable {
    /// Finds all faces in linear time.
    ///
    /// # Errors
    /// A face that is open without a condition or shared by too many cells, a
    /// canopy or boundary face that no cell has, a canopy face with another number of cells than
    /// [`FlowGrid::one_sided`] says, a cell without positive volume.
    pub fn new(grid: &FlowGrid) -> Result<Self, MeshError> {
        quality::check_volumes(grid)?;
        let sides = Sides::new(grid);
        let mut partner = sides.partners()?;
        let mut table = FaceTable::default();
        table.take_canopy(grid, &sides, &mut partner)?;
        table.take_boundary(grid, &sides, &mut partner)?;
        table.take_interior(&sides, &partner)?;
        table.periodic = periodic::paired(grid, &table.boundary)?;
        Ok(table)
    }

    fn take_canopy(&mut self, grid: &FlowGrid, sides: &Sides, partner: &mut [u32]) -> Result<(), MeshError> {
        for (index, &nodes) in grid.canopy_faces.iter().enumerate() {
            let loose = MeshError::UnmatchedFace { kind: "canopy", index, nodes };
            let Some(f) = clean_face(nodes) else { return Err(loose) };
            let Some(first) = sides.around(f).next() else { return Err(loose) };
            let second = match (partner[first as usize], grid.one_sided) {
                (OPEN, true) => None,
                (second, false) if second < TAKEN => Some(second),
                _ => return Err(loose),
            };
            let (a, b) = (Some(first / 6), second.map(|s| s / 6));
            let (inside, outside) = if same_turn(sides.listed(first), f) { (a, b) } else { (b, a) };
            self.canopy.push(CanopyCells { inside, outside });
            for slot in [Some(first), second].into_iter().flatten() {
                partner[slot as usize] = TAKEN;
            }
        }
        Ok(())
    }

    fn take_boundary(
        &mut self,
        grid: &FlowGrid,
        sides: &Sides,
        partner: &mut [u32],
    ) -> Result<(), MeshError> {
        for (index, &(patch, nodes)) in grid.boundary.iter().enumerate() {
            let loose = MeshError::UnmatchedFace { kind: "boundary", index, nodes };
            let Some(f) = clean_face(nodes) else { return Err(loose) };
            let Some(slot) = sides.around(f).next().filter(|&s| partner[s as usize] == OPEN) else {
                return Err(loose);
            };
            self.boundary.push((patch, sides.listed(slot), slot / 6));
            partner[slot as usize] = TAKEN;
        }
        Ok(())
    }

    /// What is left lies between two cells.
    fn take_interior(&mut self, sides: &Sides, partner: &[u32]) -> Result<(), MeshError> {
        for (slot, &other) in (0u32..).zip(partner) {
            match other {
                NONE | TAKEN => {}
                OPEN => {
                    return Err(MeshError::OpenFace { nodes: sides.listed(slot), cell: slot as usize / 6 });
                }
                _ if other > slot => self.interior.push((sides.listed(slot), slot / 6, other / 6)),
                _ => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxShape, box_grid, box_grid_of};

    fn counts(shape: BoxShape) -> (usize, usize, usize) {
        let grid = box_grid_of(shape, [3, 4, 5], [0.0; 3], [1.0, 2.0, 3.0], [Patch::Wall; 6]);
        let table = FaceTable::new(&grid).unwrap();
        let volume: f64 = (0..grid.cells.len()).map(|c| quality::cell_volume(&grid, c)).sum();
        assert!((volume - 6.0).abs() < 1e-12, "{shape:?} fills {volume}");
        (grid.cells.len(), table.interior.len(), table.boundary.len())
    }

    #[test]
    fn face_tables_of_all_cell_types_are_closed() {
        let sides = 2 * (12 + 15 + 20);
        // Each interior face lies between two cells: faces = (cell faces - boundary) / 2.
        assert_eq!(counts(BoxShape::Hexahedra), (60, (6 * 60 - sides) / 2, sides));
        let prism_sides = sides + 2 * 12;
        assert_eq!(counts(BoxShape::Prisms), (120, (5 * 120 - prism_sides) / 2, prism_sides));
        assert_eq!(counts(BoxShape::Pyramids), (360, (5 * 360 - sides) / 2, sides));
        assert_eq!(counts(BoxShape::Tetrahedra), (360, (4 * 360 - 2 * sides) / 2, 2 * sides));
    }

    #[test]
    fn plate_face_separates_two_cells() {
        let grid = crate::plate_grid([4, 4, 4], [0.0; 3], [1.0; 3], [Patch::FarField; 6], 2, [1..3, 1..3]);
        let table = FaceTable::new(&grid).unwrap();
        assert_eq!(table.canopy.len(), 4);
        for (inside, outside) in table.canopy.iter().map(|c| c.both().expect("two cells")) {
            let z = |c: u32| quality::cell_centre(&grid, c as usize)[2];
            assert!(z(inside) < 0.5 && z(outside) > 0.5);
        }
        // The plate took 4 of the interior faces away.
        let free = box_grid([4, 4, 4], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
        assert_eq!(FaceTable::new(&free).unwrap().interior.len(), table.interior.len() + 4);
    }

    /// The cell is inside where the normal points out of it; a grid with another number of cells than it says is refused.
    #[test]
    fn canopy_face_of_one_cell_has_it_on_the_side_of_its_normal() {
        let of = |up| crate::floor_grid([3, 2, 2], [0.0; 3], [1.0; 3], [Patch::Wall; 6], up);
        for up in [false, true] {
            let table = FaceTable::new(&of(up)).unwrap();
            assert_eq!(table.canopy.len(), 6);
            assert_eq!(table.boundary.len(), 6 + 2 * (4 + 6));
            for (k, cells) in table.canopy.iter().enumerate() {
                let own = Some(k as u32);
                let (inside, outside) = if up { (None, own) } else { (own, None) };
                assert_eq!(*cells, CanopyCells { inside, outside });
            }
        }
        let plate = crate::plate_grid([4; 3], [0.0; 3], [1.0; 3], [Patch::FarField; 6], 2, [1..3, 1..3]);
        for wrong in [FlowGrid { one_sided: false, ..of(true) }, FlowGrid { one_sided: true, ..plate }] {
            assert!(matches!(
                FaceTable::new(&wrong),
                Err(MeshError::UnmatchedFace { kind: "canopy", index: 0, .. })
            ));
        }
    }

    #[test]
    fn missing_boundary_condition_is_reported() {
        let mut grid = box_grid([2, 2, 2], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        grid.boundary.pop();
        assert!(matches!(FaceTable::new(&grid), Err(MeshError::OpenFace { cell: 7, .. })));
    }

    #[test]
    fn inverted_cell_is_reported() {
        let mut grid = box_grid([2, 2, 2], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        grid.cells[3].swap(0, 4);
        grid.cells[3].swap(1, 5);
        grid.cells[3].swap(2, 6);
        grid.cells[3].swap(3, 7);
        assert!(matches!(FaceTable::new(&grid), Err(MeshError::NegativeVolume { cell: 3, .. })));
    }
}
