//! Pressure on the faces of four nodes that two triangles approximate: what it lacks to that on the flow's wall.

use super::{ELSEWHERE, ElementLoop, FaceLoad, Place};
use crate::elements::load;
use crate::elements::mass::MassMatrix;
use crate::model::{Model, SplitFace};
use crate::vec3::{Mat3, Vec3, add_at, add_block, at, scale};

/// The further forces of [`load::bend_force`] on all split faces; they have neither mass nor strain energy.
pub struct BentFaces {
    faces: Vec<(SplitFace, [[u32; 4]; 4])>,
}

impl BentFaces {
    /// Of all split faces of `model`.
    pub fn new(model: &Model) -> Self {
        Self { faces: model.split_faces.iter().map(|&f| (f, [[ELSEWHERE; 4]; 4])).collect() }
    }

    /// Adds `factor` times the further forces on the faces that touch a node for which `active` is true.
    fn add(&self, active: impl Fn(u32) -> bool, factor: f64, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        for (f, _) in self.faces.iter().filter(|(f, _)| f.nodes.iter().any(|&n| active(n))) {
            let force = load::bend_force(factor * load.pressure[f.face as usize], &corners(f, x));
            f.nodes.iter().zip(force).for_each(|(&n, f)| add_at(out, n as usize, f));
        }
    }
}

#[inline(always)]
fn corners(face: &SplitFace, x: &[f64]) -> [Vec3; 4] {
    face.nodes.map(|n| at(x, n as usize))
}

impl ElementLoop for BentFaces {
    fn anchor(&mut self, _x: &[f64]) {}

    fn forces(&self, place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.add(|_| true, -1.0, place.at, load, out);
    }

    fn tangent(
        &self,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        for (f, slots) in &self.faces {
            let (p, x) = (load.pressure[f.face as usize], corners(f, place.at));
            let force = load::bend_force(p, &x);
            f.nodes.iter().zip(force).for_each(|(&n, f)| add_at(out, n as usize, scale(-1.0, f)));
            let k = load::bend_tangent(-factor * p, &x);
            for n in (0..4).filter(|&n| slots[n][n] != ELSEWHERE) {
                (0..4).for_each(|m| add_block(&mut blocks[slots[n][m] as usize], &k[n][m]));
            }
        }
    }

    fn forces_near(&self, active: &[bool], place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.add(|n| active[n as usize], -1.0, place.at, load, out);
    }

    fn external(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        self.add(|_| true, 1.0, x, load, out);
    }

    fn energy(&self, _x: &[f64]) -> f64 {
        0.0
    }

    /// Without mass, but the matrix gets the blocks between all corners.
    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        self.faces.iter().map(|(f, _)| (f.nodes.to_vec(), 0.0)).collect()
    }

    fn mass_shares(&self, _element: usize, _kind: MassMatrix) -> Vec<f64> {
        vec![0.0; 16]
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        for (f, slots) in &mut self.faces {
            *slots = f.nodes.map(|n| f.nodes.map(|m| slot(n, m)));
        }
    }
}

#[cfg(test)]
mod tests {
    use comm::Comm;
    use mesh::StructureMesh;

    use super::*;
    use crate::loops::Membranes;
    use crate::materials::TensionField;
    use crate::system::System;
    use crate::vec3::cross;

    /// Two bent faces, cut along different diagonals, and a triangle.
    fn system(material: TensionField, bent: bool) -> System {
        let mesh = StructureMesh {
            coords: vec![
                [0.0; 3],
                [1.0, 0.1, 0.0],
                [1.2, 1.3, 0.1],
                [0.1, 1.2, 0.3],
                [2.1, 0.2, 0.4],
                [2.0, 1.1, -0.3],
                [1.0, 2.0, 0.2],
            ],
            n_canopy: 7,
            faces: vec![[0, 1, 2, 3], [1, 4, 5, 2], [3, 2, 6, 6]],
            face_panel: vec![0; 3],
            triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 5, 2], [3, 2, 6]],
            triangle_face: vec![0, 0, 1, 1, 2],
            ..Default::default()
        };
        let model = Model::new(&Comm::solo(), &mesh, &[0; 7]).expect("a good mesh");
        assert_eq!(
            model.split_faces.iter().map(|f| f.nodes).collect::<Vec<_>>(),
            [[0, 1, 2, 3], [4, 5, 2, 1]]
        );
        let mut loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(Membranes::new(&model, material, 0.1, 2.0))];
        if bent {
            loops.push(Box::new(BentFaces::new(&model)));
        }
        System::new(model, loops, MassMatrix::Consistent)
    }

    const PRESSURE: [f64; 3] = [0.3, -0.2, 0.4];

    fn wave(i: usize, a: f64) -> f64 {
        (i as f64 * a).sin()
    }

    #[test]
    fn the_matrix_is_the_derivative_of_the_forces() {
        let mut system = system(TensionField::new(7.0, 0.3), true);
        let n = system.model.reference.len();
        let x: Vec<f64> = (0..n).map(|i| 1.1 * system.model.reference[i] + 0.05 * wave(i, 2.1)).collect();
        let d: Vec<f64> = (0..n).map(|i| wave(i, 0.9)).collect();
        let load = FaceLoad { pressure: &PRESSURE, traction: &[] };
        let force = |s: f64| {
            let x: Vec<f64> = x.iter().zip(&d).map(|(x, d)| x + s * d).collect();
            let mut f = vec![0.0; n];
            system.forces(Place::only(&x), load, &mut f);
            f
        };
        let h = 1e-6;
        let (up, down) = (force(h), force(-h));
        let mut kd = vec![0.0; n];
        system.tangent(Place::only(&x), load, 1.0, 0.0, &mut kd);
        linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
        for i in 0..n {
            let difference = (up[i] - down[i]) / (2.0 * h);
            assert!((difference - kd[i]).abs() < 1e-8, "{i}: {difference} {}", kd[i]);
        }
    }

    /// Each face's own pressure counts, and force and moment stay those of its two triangles.
    #[test]
    fn force_and_moment_are_those_of_the_triangles() {
        let [plain, bent] = [false, true].map(|b| system(TensionField::new(7.0, 0.3), b));
        let x = &plain.model.reference;
        let loads = [&plain, &bent].map(|s| {
            let mut f = vec![0.0; x.len()];
            s.external(x, FaceLoad { pressure: &PRESSURE, traction: &[] }, &mut f);
            f
        });
        let (mut force, mut moment, mut work) = ([0.0; 3], [0.0; 3], [0.0; 2]);
        for i in 0..x.len() / 3 {
            let [a, b] = [0, 1].map(|k| at(&loads[k], i));
            let more: Vec3 = std::array::from_fn(|c| b[c] - a[c]);
            let m = cross(at(x, i), more);
            for c in 0..3 {
                force[c] += more[c];
                moment[c] += m[c];
                let moved = wave(3 * i + c, 1.3);
                work[0] += a[c] * moved;
                work[1] += b[c] * moved;
            }
        }
        assert!(force.iter().chain(&moment).all(|v| v.abs() < 1e-15), "{force:?} {moment:?}");
        assert!((work[1] - work[0]).abs() > 1e-3, "{work:?}");
    }
}
