//! Bilinear membrane elements of one material, with the loads on their faces.

use std::collections::HashMap;

use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place, principal_stresses};
use crate::culprit::principal;
use crate::elements::mass::MassMatrix;
use crate::elements::membrane::Deformation;
use crate::elements::quad::{self, Gradient, POINTS};
use crate::materials::step::{self, StepStart};
use crate::materials::{Material, Moduli, Regime, Stress};
use crate::model::{Model, Quad};
use crate::vec3::{Mat3, Vec3, add_block, at, scale, sub};

struct Membrane {
    stencil: Stencil<4>,
    face: u32,
    gradient: [Gradient; POINTS],
    /// Reference area times thickness of each point, m3.
    volume: [f64; POINTS],
    start: [StepStart; POINTS],
}

/// The bilinear elements of a rank.
pub struct Quads<M> {
    elements: Vec<Membrane>,
    /// Triangles of each face, in the order of [`Model::triangles`].
    triangles: Vec<u32>,
    references: Vec<quad::Reference>,
    n_own: usize,
    material: M,
    thickness: f64,
    density: f64,
    /// Damping time, s, and over the step, 1.
    time: f64,
    rate: f64,
}

impl<M: Material> Quads<M> {
    /// Of all quadrilaterals of `model`: thickness in m, density in kg/m3, damping
    /// time in s (0: none; see [`super::MembraneDamping`]).
    pub fn new(model: &Model, material: M, thickness: f64, density: f64, time: f64) -> Self {
        let of = |q: &Quad| Membrane {
            stencil: Stencil::new(q.nodes),
            face: q.face,
            gradient: q.reference.gradient,
            volume: q.reference.area.map(|a| a * thickness),
            // A prestressed law stores energy where nothing is strained yet.
            start: [StepStart::new(&material, [0.0; 3]); POINTS],
        };
        let element: HashMap<u32, u32> =
            model.quads.iter().enumerate().map(|(k, q)| (q.face, k as u32)).collect();
        // A triangle that touches this rank has its whole face here.
        let triangles = model.triangles.iter().map(|t| element[&t.face]).collect();
        Self {
            elements: model.quads.iter().map(of).collect(),
            triangles,
            references: model.quads.iter().map(|q| q.reference).collect(),
            n_own: model.n_own_quads,
            material,
            thickness,
            density,
            time,
            rate: 0.0,
        }
    }

    /// Stress of a point in a step, damping included.
    #[inline(always)]
    fn stress(&self, start: &StepStart, end: &Deformation, weight: f64) -> Stress {
        let mut s = step::stress(&self.material, start, end.strain, weight);
        if self.rate > 0.0 {
            let (from, to) = (self.material.stress(start.strain()), self.material.stress(end.strain));
            (0..3).for_each(|i| s[i] += self.rate * (to[i] - from[i]));
        }
        s
    }

    /// As [`Quads::stress`], with its derivative by the strain at the end over `weight`.
    #[inline(always)]
    fn tangent_of(&self, start: &StepStart, end: &Deformation, weight: f64) -> (Stress, Moduli) {
        let (mut s, mut c) = step::tangent(&self.material, start, end.strain, weight);
        if self.rate > 0.0 {
            let from = self.material.stress(start.strain());
            let (to, k) = self.material.tangent(end.strain);
            for i in 0..3 {
                s[i] += self.rate * (to[i] - from[i]);
                (0..3).for_each(|j| c[i][j] += self.rate / weight * k[i][j]);
            }
        }
        (s, c)
    }

    fn external_of(&self, e: &Membrane, load: FaceLoad<'_>, x: &[Vec3; 4]) -> [Vec3; 4] {
        let face = e.face as usize;
        let mut f = quad::pressure_force(load.pressure[face], x);
        if !load.traction.is_empty() {
            let t = quad::traction_force(at(load.traction, face), x);
            (0..4).for_each(|n| f[n] = crate::vec3::add(f[n], t[n]));
        }
        f
    }

    fn add_all(&self, e: &Membrane, place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        let (x, end) = (e.stencil.gather(place.at), e.stencil.gather(place.end));
        let mut r = [[0.0; 3]; 4];
        for k in 0..POINTS {
            let h = &e.gradient[k];
            let s = self.stress(&e.start[k], &quad::deformation(h, &end), place.weight);
            quad::add_force(h, &quad::deformation(h, &x), &s, e.volume[k], &mut r);
        }
        let f = self.external_of(e, load, &x);
        e.stencil.scatter(&std::array::from_fn(|n| sub(r[n], f[n])), out);
    }

    fn add_tangent(
        &self,
        e: &Membrane,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        self.add_all(e, place, load, out);
        let (x, end) = (e.stencil.gather(place.at), e.stencil.gather(place.end));
        let face = e.face as usize;
        let mut k = quad::pressure_tangent(-factor * load.pressure[face], &x);
        if !load.traction.is_empty() {
            let t = quad::traction_tangent(scale(-factor, at(load.traction, face)), &x);
            for (row, t) in k.iter_mut().flatten().zip(t.iter().flatten()) {
                add_block(row, t);
            }
        }
        for p in 0..POINTS {
            let h = &e.gradient[p];
            let (d, end) = (quad::deformation(h, &x), quad::deformation(h, &end));
            let (s, c) = self.tangent_of(&e.start[p], &end, place.weight);
            quad::add_stiffness(h, &d, &end, &s, &c, e.volume[p] * factor, &mut k);
        }
        e.stencil.add_blocks(&k, blocks);
    }
}

impl Membrane {
    fn strains(&self, x: &[f64]) -> [[f64; 3]; POINTS] {
        let x = self.stencil.gather(x);
        self.gradient.map(|h| quad::deformation(&h, &x).strain)
    }

    fn mean_strain(&self, x: &[f64]) -> [f64; 3] {
        let strains = self.strains(x);
        std::array::from_fn(|i| 0.25 * strains.iter().map(|e| e[i]).sum::<f64>())
    }
}

impl<M: Material> ElementLoop for Quads<M> {
    fn depends_on_rate(&self) -> bool {
        self.time > 0.0
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = self.time / dt;
    }

    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            let strains = e.strains(x);
            (0..POINTS).for_each(|k| e.start[k] = StepStart::new(&self.material, strains[k]));
        }
    }

    fn forces(&self, place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.elements.iter().for_each(|e| self.add_all(e, place, load, out));
    }

    fn tangent(
        &self,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        self.elements.iter().for_each(|e| self.add_tangent(e, place, load, factor, out, blocks));
    }

    fn tangent_near(
        &self,
        active: &[bool],
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        let near = self.elements.iter().filter(|e| e.stencil.touches(active));
        near.for_each(|e| self.add_tangent(e, place, load, factor, out, blocks));
    }

    fn external(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        for e in &self.elements {
            e.stencil.scatter(&self.external_of(e, load, &e.stencil.gather(x)), out);
        }
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let one = |e: &Membrane| {
            let strains = e.strains(x);
            let point = |k: usize| {
                let (s, e3) = (self.material.stress(strains[k]), strains[k]);
                e.volume[k] * self.material.energy(&s, &e3)
            };
            (0..POINTS).map(point).sum::<f64>()
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        let one = |e: &Membrane| {
            let (from, to) = (e.strains(before), e.strains(after));
            let point = |k: usize| {
                let (s, t) = (self.material.stress(from[k]), self.material.stress(to[k]));
                let work: f64 = (0..3).map(|i| (t[i] - s[i]) * (to[k][i] - from[k][i])).sum();
                self.rate * e.volume[k] * work
            };
            (0..POINTS).map(point).sum::<f64>()
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        let factor = self.density * self.thickness;
        self.elements.iter().map(|e| (e.stencil.nodes.to_vec(), factor)).collect()
    }

    fn mass_shares(&self, element: usize, kind: MassMatrix) -> Vec<f64> {
        self.references[element].shares(kind).as_flattened().to_vec()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }

    /// Of the mean strain of the points.
    fn stresses(&self, x: &[f64]) -> Vec<([f64; 2], Regime)> {
        let one = |&k: &u32| {
            let mean = self.elements[k as usize].mean_strain(x);
            (principal_stresses(&self.material.stress(mean)), self.material.regime(mean))
        };
        self.triangles.iter().map(one).collect()
    }

    fn strains(&self, x: &[f64]) -> Vec<[f64; 2]> {
        self.triangles.iter().map(|&k| principal(self.elements[k as usize].mean_strain(x))).collect()
    }
}

#[cfg(test)]
mod tests {
    use comm::Comm;

    use super::*;
    use crate::materials::TensionField;
    use crate::model::Surface;
    use crate::system::System;

    /// A quadrilateral and a triangle of fabric: the whole matrix, with pressure,
    /// traction and damping, against central differences along a direction.
    #[test]
    fn the_matrix_is_the_derivative_of_the_forces() {
        let mesh = mesh::StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.1, 0.0], [1.2, 1.3, 0.1], [0.1, 1.2, 0.3], [2.0, 0.5, 0.2]],
            n_canopy: 5,
            faces: vec![[0, 1, 2, 3], [1, 4, 2, 2]],
            face_panel: vec![0, 0],
            triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]],
            triangle_face: vec![0, 0, 1],
            fixed: vec![(0, [true; 3])],
            ..Default::default()
        };
        let surface = Surface { quadrilaterals: true, warp: None };
        let model = Model::with(&Comm::solo(), &mesh, &[0; 5], surface).expect("a good mesh");
        let quads = Quads::new(&model, TensionField::new(7.0, 0.3), 0.1, 2.0, 0.3);
        let mut system = System::new(model, vec![Box::new(quads)], MassMatrix::Consistent);
        let area = 0.1 * 2.0 * mesh.fabric_area(|_| true);
        // The warped surface is a little larger than its two flat triangles.
        assert!((system.total_mass() / area - 1.0).abs() < 0.01, "{} {area}", system.total_mass());
        let n = 15;
        let wave = |i: usize, a: f64| (i as f64 * a).sin();
        let x0: Vec<f64> = (0..n).map(|i| 1.05 * system.model.reference[i] + 0.05 * wave(i, 2.1)).collect();
        let x1: Vec<f64> = (0..n).map(|i| x0[i] + 0.08 * wave(i, 1.3)).collect();
        let d: Vec<f64> = (0..n).map(|i| if i < 3 { 0.0 } else { wave(i, 0.9) }).collect();
        let traction = [0.1, -0.2, 0.3, 0.2, 0.1, -0.1];
        let load = FaceLoad { pressure: &[0.3, 0.2], traction: &traction };
        for weight in [0.5, 1.0] {
            system.set_step(0.2);
            system.anchor(&x0);
            let force = |s: f64| {
                let end: Vec<f64> = (0..n).map(|i| x1[i] + s * d[i]).collect();
                let at: Vec<f64> = (0..n).map(|i| (1.0 - weight) * x0[i] + weight * end[i]).collect();
                let mut f = vec![0.0; n];
                system.forces(Place { at: &at, end: &end, weight }, load, &mut f);
                f
            };
            let h = 1e-6;
            let (up, down) = (force(h), force(-h));
            let at: Vec<f64> = (0..n).map(|i| (1.0 - weight) * x0[i] + weight * x1[i]).collect();
            let mut kd = vec![0.0; n];
            system.tangent(Place { at: &at, end: &x1, weight }, load, weight, 0.0, &mut kd);
            linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
            for i in 3..n {
                let difference = (up[i] - down[i]) / (2.0 * h);
                assert!((difference - kd[i]).abs() < 1e-7, "{weight} {i}: {difference} {}", kd[i]);
            }
            assert!(system.dissipation(&x0, &x1) > 0.0);
        }
    }
}
