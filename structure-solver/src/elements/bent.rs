//! Faces of four nodes that two triangles approximate: load and mass are the mean of both ways to cut them.
//!
//! The flow's wall on such a face encloses the mean of the volumes under both pairs of triangles, so the load on it is the
//! mean of both pairs' loads ([`load::bend_force`]). The mass must be shared in the same way: on a flat sheet whose diagonals
//! alternate, each node would else have 4/3 or 2/3 of the mass that belongs to its load, and a uniform pressure would
//! shake it at the length of its faces.

use super::mass::{self, MassMatrix};
use super::{Kernel, Load, Step, load};
use mesh::geometry::{Mat3, Vec3};
use mesh::lanes::{LANES, Lanes};
use nalgebra::Vector3;

/// The two triangles of a face, and those of the other cut.
const CUTS: [[[usize; 3]; 2]; 2] = [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]];

/// A split face.
pub struct Face {
    /// Mass, kg.
    mass: f64,
    /// Shares of the face in the triangles of [`CUTS`], unstressed.
    shares: [[f64; 2]; 2],
}

/// What the triangles of split faces lack in load and mass to the mean of both cuts. It adds no mass and no strain energy.
pub struct BentFace;

impl BentFace {
    /// Of the unstressed corners `x` (m) and the mass per area (kg/m2).
    pub fn element(x: &[Vec3; 4], mass_per_area: f64) -> Face {
        let areas = CUTS.map(|cut| cut.map(|t| load::area_vector(&t.map(|n| x[n])).norm()));
        let shares = areas.map(|[a, b]| if a + b > 0.0 { [a / (a + b), b / (a + b)] } else { [0.5; 2] });
        Face { mass: mass_per_area * areas[0].iter().sum::<f64>(), shares }
    }
}

impl Kernel<4> for BentFace {
    type Element = Face;
    type Batch = ();
    const LOADED: bool = true;

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        _e: &Face,
        step: &Step<4>,
        load: &Load,
    ) -> [Vec3; 4] {
        load::bend_force(-load.pressure, &step.at)
    }

    fn batch(&self, _e: [&Face; LANES]) -> Option<()> {
        Some(())
    }

    #[inline(always)]
    fn forces<const TRACTION: bool>(
        &self,
        _batch: &(),
        x: &[Vector3<Lanes>; 4],
        load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; 4]> {
        Some(load::bend_force(-load.pressure, x))
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Face,
        step: &Step<4>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; 4], [[Mat3; 4]; 4]) {
        let k = load::bend_tangent(-factor * load.pressure, &step.at);
        (self.force::<TRACTION, BLEND>(e, step, load), k)
    }

    #[inline(always)]
    fn external<const TRACTION: bool>(&self, _e: &Face, x: &[Vec3; 4], load: &Load) -> [Vec3; 4] {
        load::bend_force(load.pressure, x)
    }

    #[inline(always)]
    fn externals<const TRACTION: bool>(
        &self,
        _batch: &(),
        x: &[Vector3<Lanes>; 4],
        load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; 4]> {
        Some(load::bend_force(load.pressure, x))
    }

    fn mass(&self, e: &Face) -> Option<f64> {
        Some(e.mass)
    }

    /// Half of the other cut's shares less half of the elements' own: their sum is zero.
    fn mass_shares(&self, e: &Face, kind: MassMatrix) -> [[f64; 4]; 4] {
        let mut all = [[0.0; 4]; 4];
        let triangle = mass::shares::<3>(kind);
        for ((cut, shares), half) in CUTS.iter().zip(e.shares).zip([-0.5, 0.5]) {
            for (nodes, share) in cut.iter().zip(shares) {
                for (i, &n) in nodes.iter().enumerate() {
                    for (j, &m) in nodes.iter().enumerate() {
                        all[n][m] += half * share * triangle[i][j];
                    }
                }
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use comm::Comm;
    use mesh::StructureMesh;

    use super::*;
    use crate::flat::at;
    use crate::loops::{Configuration, ElementLoop, Elements, FaceLoad};
    use crate::materials::{Elastic, TensionField};
    use crate::model::Model;
    use crate::system::System;

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
        let mut loops: Vec<Box<dyn ElementLoop>> =
            vec![Box::new(Elements::triangles(&model, Elastic(material), 0.1, 2.0))];
        if bent {
            loops.push(Box::new(Elements::bent_faces(&model, 0.1, 2.0)));
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
            system.forces(Configuration::only(&x), load, &mut f);
            f
        };
        let h = 1e-6;
        let (up, down) = (force(h), force(-h));
        let mut kd = vec![0.0; n];
        system.tangent(Configuration::only(&x), load, 1.0, 0.0, &mut kd);
        linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
        for i in 0..n {
            let difference = (up[i] - down[i]) / (2.0 * h);
            assert!((difference - kd[i]).abs() < 1e-8, "{i}: {difference} {}", kd[i]);
        }
    }

    /// A flat square sheet with alternating diagonals: each node has the mass that belongs to its load, so that a uniform
    /// pressure moves all alike; total and, of the consistent matrix, a rigid motion's energy stay.
    #[test]
    fn a_uniform_pressure_moves_a_flat_sheet_as_one() {
        let mut mesh = StructureMesh { n_canopy: 16, ..Default::default() };
        mesh.coords = (0..16).map(|i| [f64::from(i % 4), f64::from(i / 4), 0.0]).collect();
        for j in 0..3 {
            for i in 0..3 {
                let a = i + 4 * j;
                let face = [a, a + 1, a + 5, a + 4];
                let cut = CUTS[((i + j) % 2) as usize];
                mesh.triangles.extend(cut.map(|t| t.map(|n| face[n])));
                mesh.triangle_face.extend([mesh.faces.len() as u32; 2]);
                mesh.faces.push(face);
                mesh.face_panel.push(0);
            }
        }
        for kind in [MassMatrix::Consistent, MassMatrix::Lumped] {
            for bent in [false, true] {
                let model = Model::new(&Comm::solo(), &mesh, &[0; 16]).expect("a good mesh");
                let law = TensionField::new(7.0, 0.3);
                let mut loops: Vec<Box<dyn ElementLoop>> =
                    vec![Box::new(Elements::triangles(&model, Elastic(law), 0.1, 2.0))];
                if bent {
                    loops.push(Box::new(Elements::bent_faces(&model, 0.1, 2.0)));
                }
                let system = System::new(model, loops, kind);
                let x = system.model.reference.clone();
                let mut force = vec![0.0; 48];
                system.external(&x, FaceLoad { pressure: &[0.2; 9], traction: &[] }, &mut force);
                // 0.2 Pa on 0.2 kg/m2.
                let mut inertia = vec![0.0; 48];
                system.add_mass_product(&[0.0, 0.0, 1.0].repeat(16), &mut inertia);
                let off = force.iter().zip(&inertia).fold(0.0f64, |m, (f, i)| m.max((f - i).abs()));
                assert!(off < 1e-15, "{kind:?} {bent}: {off}");
                assert!((system.total_mass() - 1.8).abs() < 1e-14);
                let middle = system.lumped_mass(5) / 0.2;
                assert!((middle - if bent { 1.0 } else { 4.0 / 3.0 }).abs() < 1e-14, "{middle}");
            }
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
            let more: Vec3 = Vec3::from_fn(|c, _| b[c] - a[c]);
            let m = at(x, i).cross(&more);
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
