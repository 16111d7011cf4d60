//! Flat arrays of everything that a residual needs to know of the grid.

use comm::Halo;

use super::face::{self, FaceShape};
use super::vec3::{Vec3, add, dot, norm, scale, sub};
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
        norm(self.area)
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
        self.offset.map(f64::from)
    }
}

/// Cube root of a volume, m: single precision, then one Newton step to double. The
/// library's root took a twentieth of a coupled step.
fn cube_root(v: f64) -> f64 {
    let x = f64::from((v as f32).cbrt());
    if x > 0.0 { x - (x - v / (x * x)) / 3.0 } else { v.cbrt() }
}

/// Faces, volumes and centres at one instant.
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
    /// Centre of volume of each local cell, m.
    pub centre: Vec<Vec3>,
}

impl Metrics {
    /// Computes areas, volumes and centres for node positions `x` (grid fluxes
    /// are left at zero). Collective: centres of ghosts come from their owners.
    pub fn new(topology: &Topology, halo: &Halo, x: &[Vec3]) -> Self {
        let n = topology.n_local();
        let mut metrics = Self {
            faces: vec![FaceMetric::default(); topology.face_nodes.len()],
            border: vec![[0.0; 3]; topology.face_nodes.len() - topology.cells.len()],
            volume: vec![0.0; n],
            size: vec![0.0; n],
            centre: vec![[0.0; 3]; n],
        };
        metrics.update(topology, halo, x);
        metrics
    }

    /// As [`Metrics::new`], in place.
    pub fn update(&mut self, topology: &Topology, halo: &Halo, x: &[Vec3]) {
        let n_owned = topology.n_owned;
        // A point inside each cell, near which sums lose no digits.
        let inside = |c: usize| {
            let corners = &topology.cell_nodes[c];
            scale(0.125, corners.iter().fold([0.0; 3], |s, &n| add(s, x[n as usize])))
        };
        for (c, r) in self.centre[..n_owned].iter_mut().enumerate() {
            *r = inside(c);
        }
        // Ghosts as their owners have them: what is rounded to single precision must not
        // depend on the ranks.
        halo.exchange(self.centre.as_flattened_mut(), 3);
        self.volume.fill(0.0);
        let mut moment = vec![[0.0; 3]; topology.n_local()];
        let shape_of = |f: usize| {
            let nodes = topology.face_nodes[f];
            face::shape(&nodes.map(|n| x[n as usize]), nodes[2] == nodes[3])
        };
        let (volume, centre) = (&mut self.volume, &mut self.centre);
        let mut add_side = |cell: u32, sign: f64, shape: &FaceShape, centre: &[Vec3]| {
            let c = cell as usize;
            if c < n_owned {
                let r = centre[c];
                // Divergence theorem; on each triangle about the middle, x - middle is normal to dA.
                let v = sign * dot(sub(shape.middle, r), shape.area) / 3.0;
                volume[c] += v;
                moment[c] = add(moment[c], scale(0.75 * v, sub(shape.centre, r)));
            }
        };
        let between = topology.cells.len();
        for (k, &[i, j]) in topology.cells.iter().enumerate() {
            let shape = shape_of(k);
            let f = &mut self.faces[k];
            f.area = shape.area;
            // From a point near the centre, which is not known yet.
            f.offset = sub(shape.centre, centre[i as usize]).map(|x| x as f32);
            add_side(i, 1.0, &shape, centre);
            add_side(j, -1.0, &shape, centre);
        }
        for side in topology.sides() {
            let shape = shape_of(side.face as usize);
            self.faces[side.face as usize].area = shape.area;
            self.border[side.face as usize - between] = shape.centre;
            add_side(side.cell, side.sign, &shape, centre);
        }
        for c in 0..n_owned {
            let v = volume[c];
            moment[c] = if v > 0.0 { scale(1.0 / v, moment[c]) } else { [0.0; 3] };
        }
        halo.exchange(moment.as_flattened_mut(), 3);
        halo.exchange(volume, 1);
        for (c, shift) in centre.iter_mut().zip(&moment) {
            *c = add(*c, *shift);
        }
        for (s, v) in self.size.iter_mut().zip(&*volume) {
            *s = cube_root(*v);
        }
        for (k, f) in self.faces[..between].iter_mut().enumerate() {
            let [i, j] = topology.cells[k].map(|c| c as usize);
            f.offset = sub(f.offset(), moment[i]).map(|x| x as f32);
            let d = sub(centre[j], centre[i]);
            // A skewed pair of cells keeps a positive spacing.
            f.spacing = (dot(d, f.area) / f.magnitude()).max(0.2 * norm(d)) as f32;
        }
        for side in topology.sides() {
            self.faces[side.face as usize].spacing = self.height(side) as f32;
        }
    }

    /// Distance of the centre of a side's cell from the plane of its face, m. A wall of
    /// zero thickness has another on its other side.
    #[inline]
    pub fn height(&self, side: &Side) -> f64 {
        let area = self.faces[side.face as usize].area;
        let d = sub(self.border(side.face), self.centre[side.cell as usize]);
        (side.sign * dot(d, area) / norm(area)).max(0.2 * norm(d))
    }

    /// Centre of area of a face that is not between two cells, m.
    #[inline(always)]
    pub fn border(&self, face: u32) -> Vec3 {
        self.border[face as usize + self.border.len() - self.faces.len()]
    }

    /// Centre of area of any face, m.
    pub fn face_centre(&self, topology: &Topology, face: usize) -> Vec3 {
        match topology.cells.get(face) {
            Some(&[i, _]) => add(self.centre[i as usize], self.faces[face].offset()),
            None => self.border(face as u32),
        }
    }

    /// Volume swept by each face between node positions `old` and `new`, m3.
    pub fn swept(topology: &Topology, old: &[Vec3], new: &[Vec3], swept: &mut [f64]) {
        for (s, nodes) in swept.iter_mut().zip(&topology.face_nodes) {
            let (o, n) = (nodes.map(|n| old[n as usize]), nodes.map(|n| new[n as usize]));
            *s = face::swept_volume(&o, &n, nodes[2] == nodes[3]);
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
