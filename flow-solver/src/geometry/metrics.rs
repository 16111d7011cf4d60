//! Flat arrays of everything that a residual needs to know of the grid.

use comm::Halo;

use super::face;
use super::vec3::{Vec3, add, dot, norm, scale, sub};
use crate::topology::Topology;

/// One face, as read by the flux loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct FaceMetric {
    /// Area vector from the first cell to the second (or outwards), m2.
    pub area: Vec3,
    /// Centre of area, m.
    pub centre: Vec3,
    /// Length of `area`, m2.
    pub magnitude: f64,
    /// Distance of the two cell centres (cell centre and face) along the normal, m.
    pub spacing: f64,
    /// Volume swept by the moving face in unit time, along `area`, m3/s.
    pub grid_flux: f64,
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
        let reference = &mut self.centre;
        for (c, r) in reference[..n_owned].iter_mut().enumerate() {
            *r = inside(c);
        }
        self.volume.fill(0.0);
        let mut moment = vec![[0.0; 3]; n_owned];
        let gather = |nodes: &[u32; 4]| nodes.map(|n| x[n as usize]);
        let mut middles = vec![[0.0; 3]; topology.face_nodes.len()];
        for ((f, m), nodes) in self.faces.iter_mut().zip(&mut middles).zip(&topology.face_nodes) {
            let shape = face::shape(&gather(nodes), nodes[2] == nodes[3]);
            f.area = shape.area;
            f.centre = shape.centre;
            f.magnitude = norm(shape.area);
            *m = shape.middle;
        }
        let (volume, faces) = (&mut self.volume, &self.faces);
        topology.for_each_side(|face, cell, sign| {
            if cell < n_owned {
                let f = &faces[face];
                let r = reference[cell];
                // Divergence theorem; on each triangle about the middle, x - middle is normal to dA.
                let v = sign * dot(sub(middles[face], r), f.area) / 3.0;
                volume[cell] += v;
                moment[cell] = add(moment[cell], scale(0.75 * v, sub(f.centre, r)));
            }
        });
        for c in 0..n_owned {
            let v = self.volume[c];
            let shift = if v > 0.0 { scale(1.0 / v, moment[c]) } else { [0.0; 3] };
            self.centre[c] = add(self.centre[c], shift);
        }
        halo.exchange(self.centre.as_flattened_mut(), 3);
        halo.exchange(&mut self.volume, 1);
        for (s, v) in self.size.iter_mut().zip(&self.volume) {
            *s = cube_root(*v);
        }
        for (k, f) in self.faces[..topology.cells.len()].iter_mut().enumerate() {
            let [i, j] = topology.cells[k];
            let d = sub(self.centre[j as usize], self.centre[i as usize]);
            // A skewed pair of cells keeps a positive spacing.
            f.spacing = (dot(d, f.area) / f.magnitude).max(0.2 * norm(d));
        }
        for side in topology.sides() {
            let f = &mut self.faces[side.face as usize];
            let d = sub(f.centre, self.centre[side.cell as usize]);
            f.spacing = (side.sign * dot(d, f.area) / f.magnitude).max(0.2 * norm(d));
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
