//! Geometry of the grid for the residual, in flat arrays.

use comm::Halo;
use mesh::lanes::{LANES, Lanes, Real, columns, rows};
use nalgebra::Vector3;

use super::face::{self, FaceShape};
use super::vec3::Vec3;
use crate::topology::{Side, Topology};

/// One face, as read by the flux loop: three quarters of a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct FaceMetric {
    /// Area vector from the first cell to the second (or outwards), m2.
    pub area: Vec3,
    /// Volume swept by the moving face in unit time, along `area`, m3/s.
    pub grid_flux: f64,
    /// From the centre of the first cell to the centre of area of a face between two
    /// cells, m. Single precision: values on the face are off by 1e-7 of a cell's change.
    offset: [f32; 3],
    /// Distance of the two cell centres (cell centre and face) along the normal, m.
    spacing: f32,
}

impl FaceMetric {
    /// Length of the area vector, m2.
    #[inline(always)]
    pub fn magnitude(&self) -> f64 {
        self.area.norm()
    }

    /// Distance of the two cell centres (on the outer boundary: of cell centre and face)
    /// along the normal, m. On a wall of zero thickness see [`Metrics::height`].
    #[inline(always)]
    pub fn spacing(&self) -> f64 {
        f64::from(self.spacing)
    }

    /// From the centre of the first cell to the centre of a face between two cells, m.
    #[inline(always)]
    pub fn offset(&self) -> Vec3 {
        self.offset.map(f64::from).into()
    }

    /// All of it in double precision.
    #[inline(always)]
    pub fn geometry(&self) -> FaceGeometry<f64> {
        let Self { area, grid_flux, .. } = *self;
        FaceGeometry { area, grid_flux, spacing: self.spacing(), offset: self.offset() }
    }
}

/// A face, or each face of a batch; see [`FaceMetric`].
#[derive(Clone, Copy, Debug)]
pub struct FaceGeometry<T: Real> {
    /// Area vector from the first cell to the second, m2.
    pub area: Vector3<T>,
    /// Volume swept by the moving face in unit time, along `area`, m3/s.
    pub grid_flux: T,
    /// Distance of the two cell centres along the normal, m.
    pub spacing: T,
    /// From the centre of the first cell to the centre of area of the face, m.
    pub offset: Vector3<T>,
}

impl FaceGeometry<Lanes> {
    /// Each of these faces.
    #[inline(always)]
    pub fn batch(faces: [&FaceMetric; LANES]) -> Self {
        let [a, b, c, d] = faces;
        let double = |f: &FaceMetric| [f.offset[0], f.offset[1], f.offset[2], f.spacing].map(f64::from);
        let area = columns([&a.area, &b.area, &c.area, &d.area].map(|area| area.as_ref()));
        let [x, y, z, spacing] = columns([&double(a), &double(b), &double(c), &double(d)]);
        Self {
            area: area.into(),
            grid_flux: Lanes::from_arr([a.grid_flux, b.grid_flux, c.grid_flux, d.grid_flux]),
            spacing,
            offset: Vector3::new(x, y, z),
        }
    }
}

/// Cube root of a volume, m: single precision, then one Newton step to double. The
/// library's root took a twentieth of a coupled step.
fn cube_root(v: f64) -> f64 {
    let x = f64::from((v as f32).cbrt());
    if x > 0.0 { x - (x - v / (x * x)) / 3.0 } else { v.cbrt() }
}

/// The vector of each lane.
#[inline(always)]
fn vectors(v: Vector3<Lanes>) -> [Vec3; LANES] {
    let (x, y, z) = (v.x.into_arr(), v.y.into_arr(), v.z.into_arr());
    let one = |l: usize| Vec3::new(x[l], y[l], z[l]);
    [one(0), one(1), one(2), one(3)]
}

/// Whether a face is a triangle, which repeats its last node.
#[inline(always)]
fn is_triangle(nodes: &[u32; 4]) -> bool {
    nodes[2] == nodes[3]
}

/// Those of the cells `at` among their centres or shifts `x`.
#[inline(always)]
fn at_lanes(x: &[[f64; 3]], at: &[usize; LANES]) -> Vector3<Lanes> {
    rows(x, at).into()
}

/// Four of the points `x`.
#[inline(always)]
fn gather(x: &[Vec3], [a, b, c, d]: [u32; LANES]) -> Vector3<Lanes> {
    let point = |n: u32| -> &[f64; 3] { x[n as usize].as_ref() };
    columns([point(a), point(b), point(c), point(d)]).into()
}

/// Corners of the faces with the nodes `nodes` at `x`.
#[inline(always)]
fn corners(nodes: &[[u32; 4]; LANES], x: &[Vec3]) -> [Vector3<Lanes>; 4] {
    let [a, b, c, d] = nodes;
    let corner = |k: usize| gather(x, [a[k], b[k], c[k], d[k]]);
    [corner(0), corner(1), corner(2), corner(3)]
}

/// The shape of each face of a batch.
#[inline(always)]
fn shapes(nodes: &[[u32; 4]; LANES], x: &[Vec3]) -> FaceShape<Lanes> {
    if !nodes.iter().any(is_triangle) {
        return face::shape_of_quadrilateral(&corners(nodes, x));
    }
    let [a, b, c, d] = nodes.each_ref().map(|n| shape(n, x));
    let each = |of: fn(&FaceShape) -> &Vec3| columns([&a, &b, &c, &d].map(|s| of(s).as_ref())).into();
    FaceShape { area: each(|s| &s.area), middle: each(|s| &s.middle), centre: each(|s| &s.centre) }
}

/// The shape of the face with the nodes `nodes` at `x`.
#[inline(always)]
fn shape(nodes: &[u32; 4], x: &[Vec3]) -> FaceShape {
    face::shape(&nodes.map(|n| x[n as usize]), is_triangle(nodes))
}

/// What a face adds to the volume (m3) of a cell on the side `sign`, and to that times the distance of the cell's centre of volume from `r` (m4): the divergence
/// theorem, by the triangles about the middle of the face, on each of which x - middle is normal to dA.
#[inline(always)]
fn volume_and_moment<T: Real>(shape: &FaceShape<T>, sign: f64, r: Vector3<T>) -> (T, Vector3<T>) {
    let v = (shape.middle - r).dot(&shape.area) * T::splat(sign) / T::splat(3.0);
    (v, (shape.centre - r) * (T::splat(0.75) * v))
}

/// Distance along the normal of a face of two centres `d` apart; a skewed pair of cells keeps a positive one.
#[inline(always)]
fn spacing<T: Real>(d: &Vector3<T>, area: &Vector3<T>) -> T {
    let along = d.dot(area) / area.dot(area).simd_sqrt();
    let least = T::splat(0.2) * d.dot(d).simd_sqrt();
    along.select(along.simd_gt(least), least)
}

/// Faces, volumes and centres at one time level.
#[derive(Clone, Debug, Default)]
pub struct Metrics {
    /// All local faces in the order of [`Topology::face_nodes`].
    pub faces: Vec<FaceMetric>,
    /// Centres of area of the faces that are not between two cells, m.
    border: Vec<Vec3>,
    /// Volume of each local cell, m3.
    pub volume: Vec<f64>,
    /// Cube root of the volume, m.
    pub size: Vec<f64>,
    /// Centre of volume of each local cell, m; numbers that travel to the ghosts. See [`Metrics::centre`].
    pub centre: Vec<[f64; 3]>,
    /// Of each local cell, by how much the centre of volume lies from the mean of its corners, m; empty where the grid does not move.
    shift: Vec<[f64; 3]>,
}

impl Metrics {
    /// Computes areas, volumes and centres for node positions `x` (grid fluxes
    /// are left at zero). Collective: centres of ghosts come from their owners.
    pub fn new(topology: &Topology, halo: &Halo, x: &[Vec3]) -> Self {
        let n = topology.n_local();
        let mut metrics = Self {
            faces: vec![FaceMetric::default(); topology.face_nodes.len()],
            border: vec![Vec3::zeros(); topology.face_nodes.len() - topology.cells.len()],
            volume: vec![0.0; n],
            size: vec![0.0; n],
            centre: vec![[0.0; 3]; n],
            shift: Vec::new(),
        };
        metrics.update(topology, halo, x);
        metrics.shift = Vec::new();
        metrics
    }

    /// As [`Metrics::new`], in place.
    pub fn update(&mut self, topology: &Topology, halo: &Halo, x: &[Vec3]) {
        self.start_from_inside(topology, halo, x);
        let mut shift = std::mem::take(&mut self.shift);
        shift.resize(topology.n_local(), [0.0; 3]);
        self.add_faces(topology, halo, x, &mut shift);
        self.shift_centres(&shift);
        self.measure_spacings(topology, &shift);
        self.shift = shift;
    }

    /// Puts the centres to points inside the cells, near which sums lose no digits. Collective.
    fn start_from_inside(&mut self, topology: &Topology, halo: &Halo, x: &[Vec3]) {
        for (r, corners) in self.centre.iter_mut().zip(&topology.cell_nodes) {
            let sum = corners.iter().fold(Vec3::zeros(), |s, &n| s + x[n as usize]);
            *r = (sum * 0.125).into();
        }
        // Ghosts as their owners have them: what is rounded to single precision must not
        // depend on the ranks.
        halo.exchange(self.centre.as_flattened_mut(), 3);
        for (ghost, moved) in &topology.images {
            let centre = &mut self.centre[*ghost as usize];
            *centre = (Vec3::from(*centre) + moved).into();
        }
    }

    /// Areas of the faces and volumes of the cells, and by how much (m) the centres of volume lie from the points
    /// that the centres are at, of all local cells. Collective.
    fn add_faces(&mut self, topology: &Topology, halo: &Halo, x: &[Vec3], moment: &mut [[f64; 3]]) {
        let n_owned = topology.n_owned;
        self.volume.fill(0.0);
        moment.fill([0.0; 3]);
        let (volume, centre) = (&mut self.volume, &self.centre);
        let mut add = |cell: usize, (v, m): (f64, Vec3)| {
            if cell < n_owned {
                volume[cell] += v;
                moment[cell] = (Vec3::from(moment[cell]) + m).into();
            }
        };
        let between = topology.cells.len();
        let (batches, rest) = topology.cells.as_chunks::<LANES>();
        let (nodes, nodes_of_rest) = topology.face_nodes[..between].as_chunks::<LANES>();
        let (faces, faces_of_rest) = self.faces[..between].as_chunks_mut::<LANES>();
        for ((faces, cells), nodes) in faces.iter_mut().zip(batches).zip(nodes) {
            let shape = shapes(nodes, x);
            let [i, j] = [0, 1].map(|side| cells.map(|c| c[side] as usize));
            let (ri, rj) = (at_lanes(centre, &i), at_lanes(centre, &j));
            let (vi, mi) = volume_and_moment(&shape, 1.0, ri);
            let (vj, mj) = volume_and_moment(&shape, -1.0, rj);
            // From a point near the centre, which is not known yet.
            let (area, offset) = (vectors(shape.area), vectors(shape.centre - ri));
            let (vi, mi, vj, mj) = (vi.into_arr(), vectors(mi), vj.into_arr(), vectors(mj));
            for (l, f) in faces.iter_mut().enumerate() {
                (f.area, f.offset) = (area[l], offset[l].map(|x| x as f32).into());
                add(i[l], (vi[l], mi[l]));
                add(j[l], (vj[l], mj[l]));
            }
        }
        for ((f, &[i, j]), nodes) in faces_of_rest.iter_mut().zip(rest).zip(nodes_of_rest) {
            let shape = shape(nodes, x);
            let [ri, rj] = [i, j].map(|c| Vec3::from(centre[c as usize]));
            (f.area, f.offset) = (shape.area, (shape.centre - ri).map(|x| x as f32).into());
            add(i as usize, volume_and_moment(&shape, 1.0, ri));
            add(j as usize, volume_and_moment(&shape, -1.0, rj));
        }
        for side in topology.sides() {
            let shape = shape(&topology.face_nodes[side.face as usize], x);
            self.faces[side.face as usize].area = shape.area;
            self.border[side.face as usize - between] = shape.centre;
            let cell = side.cell as usize;
            add(cell, volume_and_moment(&shape, side.sign, centre[cell].into()));
        }
        for (m, &v) in moment[..n_owned].iter_mut().zip(&*volume) {
            *m = if v > 0.0 { (Vec3::from(*m) * (1.0 / v)).into() } else { [0.0; 3] };
        }
        halo.exchange(moment.as_flattened_mut(), 3);
        halo.exchange(volume, 1);
    }

    /// Centres of volume, and the sizes of the cells.
    fn shift_centres(&mut self, shift: &[[f64; 3]]) {
        for (c, shift) in self.centre.iter_mut().zip(shift) {
            *c = (Vec3::from(*c) + Vec3::from(*shift)).into();
        }
        for (s, v) in self.size.iter_mut().zip(&self.volume) {
            *s = cube_root(*v);
        }
    }

    /// What the faces know of the centres, which have been shifted.
    fn measure_spacings(&mut self, topology: &Topology, shift: &[[f64; 3]]) {
        let centre = &self.centre;
        let (batches, rest) = topology.cells.as_chunks::<LANES>();
        let (faces, faces_of_rest) = self.faces[..topology.cells.len()].as_chunks_mut::<LANES>();
        for (faces, cells) in faces.iter_mut().zip(batches) {
            let [i, j] = [0, 1].map(|side| cells.map(|c| c[side] as usize));
            let FaceGeometry { area, offset, .. } = FaceGeometry::batch(faces.each_ref());
            let offset = vectors(offset - at_lanes(shift, &i));
            let spacing = spacing(&(at_lanes(centre, &j) - at_lanes(centre, &i)), &area).into_arr();
            for (l, f) in faces.iter_mut().enumerate() {
                (f.offset, f.spacing) = (offset[l].map(|x| x as f32).into(), spacing[l] as f32);
            }
        }
        for (f, cells) in faces_of_rest.iter_mut().zip(rest) {
            let [i, j] = cells.map(|c| c as usize);
            f.offset = (f.offset() - Vec3::from(shift[i])).map(|x| x as f32).into();
            f.spacing = spacing(&(Vec3::from(centre[j]) - Vec3::from(centre[i])), &f.area) as f32;
        }
        for side in topology.sides() {
            self.faces[side.face as usize].spacing = self.height(side) as f32;
        }
    }

    /// Centre of volume of a local cell, m.
    #[inline(always)]
    pub fn centre(&self, cell: usize) -> Vec3 {
        self.centre[cell].into()
    }

    /// Distance of the centre of a side's cell from the plane of its face, m. A wall of
    /// zero thickness has another on its other side.
    #[inline]
    pub fn height(&self, side: &Side) -> f64 {
        let area = self.faces[side.face as usize].area;
        let d = self.border(side.face) - self.centre(side.cell as usize);
        (side.sign * d.dot(&area) / area.norm()).max(0.2 * d.norm())
    }

    /// Centre of area of a face that is not between two cells, m.
    #[inline(always)]
    pub fn border(&self, face: u32) -> Vec3 {
        self.border[face as usize + self.border.len() - self.faces.len()]
    }

    /// Centre of area of any face, m.
    pub fn face_centre(&self, topology: &Topology, face: usize) -> Vec3 {
        match topology.cells.get(face) {
            Some(&[i, _]) => self.centre(i as usize) + self.faces[face].offset(),
            None => self.border(face as u32),
        }
    }

    /// Volume swept by each face between node positions `old` and `new`, m3.
    pub fn swept(topology: &Topology, old: &[Vec3], new: &[Vec3], swept: &mut [f64]) {
        let one = |nodes: &[u32; 4]| {
            let (o, n) = (nodes.map(|n| old[n as usize]), nodes.map(|n| new[n as usize]));
            face::swept_volume(&o, &n, is_triangle(nodes))
        };
        let (batches, rest) = topology.face_nodes.as_chunks::<LANES>();
        let (swept, swept_of_rest) = swept.as_chunks_mut::<LANES>();
        for (s, nodes) in swept.iter_mut().zip(batches) {
            *s = if nodes.iter().any(is_triangle) {
                nodes.each_ref().map(one)
            } else {
                face::swept_by_quadrilateral(&corners(nodes, old), &corners(nodes, new)).into_arr()
            };
        }
        for (s, nodes) in swept_of_rest.iter_mut().zip(rest) {
            *s = one(nodes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_roots() {
        for v in [1e-12, 3.7e-5, 1.0, 8.0, 123.456, 7e9] {
            assert!((cube_root(v) / v.cbrt() - 1.0).abs() < 1e-13, "{v}");
        }
        assert!(cube_root(-8.0) == -2.0 && cube_root(0.0) == 0.0 && cube_root(f64::NAN).is_nan());
        // Beyond single precision the library's own.
        assert!((cube_root(1e-60) / 1e-20 - 1.0).abs() < 1e-13);
    }
}
