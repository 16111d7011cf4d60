//! Stiffness-proportional damping: stresses proportional to the rate of the elastic
//! ones.
//!
//! Over a step from strain $E_0$ to $E_1$ the stress is
//! $S_v = \frac{\beta}{\Delta t}(S(E_1)-S(E_0))$. For small motions about a taut state
//! that is Rayleigh's $\beta K v$; being made of strains it sees no rigid motion. The
//! work over the step, $S_v:(E_1-E_0)$, is never negative, because each law is the
//! gradient of a convex energy. The rate is that of the middle of the step: second
//! order with the midpoint family, first order in $\beta\Delta t$ with Newmark.
//!
//! Loops of their own: a scene without this damping does not run them.

use super::axial::{self, Axial};
use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place};
use crate::elements::cable::{self, CableLaw};
use crate::elements::membrane;
use crate::materials::{Material, Stress};
use crate::model::{CableElement, Model, Triangle};
use crate::vec3::{Mat3, Vec3};

struct Sheet {
    stencil: Stencil<3>,
    gradient: [f64; 4],
    volume: f64,
    start: Stress,
}

/// Damping of membrane elements of one material.
pub struct MembraneDamping<M> {
    elements: Vec<Sheet>,
    n_own: usize,
    material: M,
    time: f64,
    /// Time over the step, 1.
    rate: f64,
}

impl<M: Material> MembraneDamping<M> {
    /// Of all triangles of `model`: thickness in m, damping time in s.
    pub fn new(model: &Model, material: M, thickness: f64, time: f64) -> Self {
        let of = |t: &Triangle| Sheet {
            stencil: Stencil::new(t.nodes),
            gradient: t.reference.gradient,
            volume: t.reference.area * thickness,
            start: [0.0; 3],
        };
        let elements = model.triangles.iter().map(of).collect();
        Self { elements, n_own: model.n_own_triangles, material, time, rate: 0.0 }
    }

    fn stress(&self, e: &Sheet, end: Stress) -> Stress {
        std::array::from_fn(|i| self.rate * (end[i] - e.start[i]))
    }
}

impl Sheet {
    fn deformation(&self, x: &[f64]) -> membrane::Deformation {
        membrane::deformation(&self.gradient, &self.stencil.gather(x))
    }
}

impl<M: Material> ElementLoop for MembraneDamping<M> {
    fn depends_on_rate(&self) -> bool {
        true
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = self.time / dt;
    }

    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            e.start = self.material.stress(e.deformation(x).strain);
        }
    }

    fn forces(&self, place: Place<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        for e in &self.elements {
            let s = self.stress(e, self.material.stress(e.deformation(place.end).strain));
            let r = membrane::force(&e.gradient, &e.deformation(place.at), &s, e.volume);
            e.stencil.scatter(&r, out);
        }
    }

    fn tangent(
        &self,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        self.forces(place, load, out);
        let by = self.rate / place.weight;
        for e in &self.elements {
            let (d, end) = (e.deformation(place.at), e.deformation(place.end));
            let (s, c) = self.material.tangent(end.strain);
            let (s, c) = (self.stress(e, s), c.map(|row| row.map(|c| by * c)));
            let k = membrane::stiffness_between(&e.gradient, &d, &end, &s, &c, e.volume * factor);
            e.stencil.add_blocks(&k, blocks);
        }
    }

    fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        let one = |e: &Sheet| {
            let (from, to) = (e.deformation(before).strain, e.deformation(after).strain);
            let s = self.stress(e, self.material.stress(to));
            e.volume * (0..3).map(|i| s[i] * (to[i] - from[i])).sum::<f64>()
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }
}

struct Strand {
    stencil: Stencil<2>,
    rest_length: f64,
    start: f64,
}

/// Damping of cable elements of one law.
pub struct CableDamping<L> {
    elements: Vec<Strand>,
    n_own: usize,
    law: L,
    /// Strain at rest length: pre-stress over the modulus.
    offset: f64,
    area: f64,
    time: f64,
    rate: f64,
}

impl<L: CableLaw> CableDamping<L> {
    /// Of all cables of `model`: cross-section in m2, Green strain at rest length,
    /// damping time in s.
    pub fn new(model: &Model, law: L, area: f64, offset: f64, time: f64) -> Self {
        let of = |c: &CableElement| Strand {
            stencil: Stencil::new(c.nodes),
            rest_length: c.rest_length,
            start: 0.0,
        };
        let elements = model.cables.iter().map(of).collect();
        Self { elements, n_own: model.n_own_cables, law, offset, area, time, rate: 0.0 }
    }

    /// Elastic stress and its derivative for the vector `d` between the ends.
    fn elastic(&self, e: &Strand, d: Vec3) -> (f64, f64) {
        self.law.stress(cable::strain(d, e.rest_length) + self.offset)
    }

    /// Each element in a step.
    #[inline(always)]
    fn axial<'a>(&'a self, place: Place<'a>) -> impl Iterator<Item = (&'a Stencil<2>, Axial)> {
        self.elements.iter().map(move |e| {
            let (d, end) = (e.stencil.between(place.at), e.stencil.between(place.end));
            let (s, y) = self.elastic(e, end);
            let (s, y) = (self.rate * (s - e.start), self.rate / place.weight * y);
            (&e.stencil, Axial { d, end, rest_length: e.rest_length, s, y })
        })
    }
}

impl<L: CableLaw> ElementLoop for CableDamping<L> {
    fn depends_on_rate(&self) -> bool {
        true
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = self.time / dt;
    }

    fn anchor(&mut self, x: &[f64]) {
        let (law, offset) = (self.law, self.offset);
        for e in &mut self.elements {
            e.start = law.stress(cable::strain(e.stencil.between(x), e.rest_length) + offset).0;
        }
    }

    fn forces(&self, place: Place<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        axial::add_forces(self.axial(place), self.area, out);
    }

    fn tangent(
        &self,
        place: Place<'_>,
        _load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        axial::add_tangent(self.axial(place), self.area, factor, out, blocks);
    }

    fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        let one = |e: &Strand| {
            let [from, to] = [before, after].map(|x| cable::strain(e.stencil.between(x), e.rest_length));
            let s = self.rate * (self.elastic(e, e.stencil.between(after)).0 - e.start);
            self.area * e.rest_length * s * (to - from)
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }
}

#[cfg(test)]
mod tests {
    use comm::Comm;
    use mesh::{Cable, CableKind, StructureMesh};

    use super::*;
    use crate::dynamics::{Dynamics, DynamicsParams, LoadPath};
    use crate::elements::cable::{TensionOnly, TwoWay};
    use crate::elements::mass::MassMatrix;
    use crate::loops::{Cables, Membranes};
    use crate::materials::TensionField;
    use crate::newton::NewtonParams;
    use crate::scheme::Scheme;
    use crate::system::System;

    fn patch() -> StructureMesh {
        StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.1, 0.0], [0.2, 1.3, 0.1], [1.1, 1.2, 0.3]],
            n_canopy: 4,
            faces: vec![[0, 1, 3, 2]],
            face_panel: vec![0],
            triangles: vec![[0, 1, 2], [1, 3, 2]],
            triangle_face: vec![0, 0],
            cables: vec![Cable { nodes: [0, 3], rest_length: 1.5, kind: CableKind::SuspensionLine, line: 0 }],
            fixed: vec![(0, [true; 3])],
            ..Default::default()
        }
    }

    fn system(mesh: &StructureMesh, time: f64) -> System {
        let model = Model::new(&Comm::solo(), mesh, &vec![0; mesh.coords.len()]).expect("a good mesh");
        let law = TensionField::new(7.0, 0.3);
        let line = TensionOnly { youngs_modulus: 5.0 };
        let loops: Vec<Box<dyn ElementLoop>> = vec![
            Box::new(Membranes::new(&model, law, 0.1, 1.0)),
            Box::new(Cables::new(&model, line, 0.2, 1.0)),
            Box::new(MembraneDamping::new(&model, law, 0.1, time)),
            Box::new(CableDamping::new(&model, line, 0.2, 0.0, time)),
        ];
        System::new(model, loops, MassMatrix::Consistent)
    }

    fn shaken(x: &[f64], size: f64, a: f64) -> Vec<f64> {
        x.iter().enumerate().map(|(i, x)| 1.05 * x + size * (i as f64 * a).sin()).collect()
    }

    /// The whole matrix against central differences along a direction, at the middle
    /// (as the midpoint family) and at the end (as Newmark).
    #[test]
    fn tangent_is_the_derivative() {
        let mesh = patch();
        let mut system = system(&mesh, 0.4);
        let x0 = shaken(&system.model.reference, 0.05, 2.1);
        let x1 = shaken(&x0, 0.08, 1.3);
        let load = FaceLoad { pressure: &[0.3], traction: &[] };
        let d: Vec<f64> = (0..12).map(|i| if i < 3 { 0.0 } else { (i as f64 * 0.9).sin() }).collect();
        for weight in [0.5, 0.6, 1.0] {
            system.set_step(0.2);
            system.anchor(&x0);
            let positions = |s: f64| -> [Vec<f64>; 2] {
                let end: Vec<f64> = x1.iter().zip(&d).map(|(x, d)| x + s * d).collect();
                [x0.iter().zip(&end).map(|(a, b)| (1.0 - weight) * a + weight * b).collect(), end]
            };
            let force = |s: f64| {
                let [at, end] = &positions(s);
                let mut f = vec![0.0; 12];
                system.forces(Place { at, end, weight }, load, &mut f);
                f
            };
            let h = 1e-6;
            let (up, down) = (force(h), force(-h));
            let [at, end] = &positions(0.0);
            let mut g = vec![0.0; 12];
            system.tangent(Place { at, end, weight }, load, weight, 0.0, &mut g);
            assert_eq!(g, {
                let mut f = vec![0.0; 12];
                system.forces(Place { at, end, weight }, load, &mut f);
                f
            });
            let mut kd = vec![0.0; 12];
            linalg::Operator::apply(&system.matrix, &mut d.clone(), &mut kd);
            for i in 3..12 {
                let difference = (up[i] - down[i]) / (2.0 * h);
                assert!((difference - kd[i]).abs() < 1e-7, "{weight} {i}: {difference} {}", kd[i]);
            }
        }
    }

    /// A step takes energy out whatever happens in it, and a turn of the whole takes
    /// none.
    #[test]
    fn strains_are_damped_and_rigid_motion_is_not() {
        let mesh = patch();
        let mut system = system(&mesh, 0.4);
        system.set_step(0.2);
        for k in 0..50 {
            let x0 = shaken(&system.model.reference, 0.3, 2.1 + f64::from(k));
            let x1 = shaken(&system.model.reference, 0.3, 1.3 + f64::from(k));
            system.anchor(&x0);
            assert!(system.dissipation(&x0, &x1) >= 0.0);
        }
        let x0 = shaken(&system.model.reference, 0.1, 2.1);
        let turned: Vec<f64> = x0.chunks(3).flat_map(|p| [p[2] + 1.0, p[1], -p[0]]).collect();
        system.anchor(&x0);
        assert!(system.dissipation(&x0, &turned).abs() < 1e-14);
    }

    /// A mass on a spring: the amplitude falls by exp(-beta w^2 t / 2). Midpoint
    /// steps of w dt = 0.02 lose (w dt)^2 / 12 of the frequency and of the decay.
    #[test]
    fn a_spring_loses_the_amplitude_of_its_damping_time() {
        let mesh = StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.0, 0.0]],
            cables: vec![Cable { nodes: [0, 1], rest_length: 1.0, kind: CableKind::Riser, line: 0 }],
            point_masses: vec![(1, 1.0)],
            fixed: vec![(0, [true; 3]), (1, [false, true, true])],
            ..Default::default()
        };
        let model = Model::new(&Comm::solo(), &mesh, &[0, 0]).expect("a good mesh");
        let (y, area, beta) = (4.0, 1.0, 0.05);
        let law = TwoWay { youngs_modulus: y };
        let loops: Vec<Box<dyn ElementLoop>> = vec![
            Box::new(Cables::new(&model, law, area, 1e-12)),
            Box::new(CableDamping::new(&model, law, area, 0.0, beta)),
        ];
        let w = (y * area / 1.0f64).sqrt();
        let mut d = Dynamics::new(
            System::new(model, loops, MassMatrix::Consistent),
            DynamicsParams {
                scheme: Scheme::generalized_alpha(1.0),
                damping: 0.0,
                newton: NewtonParams { tolerance: 1e-10, smallest_correction: 1e-16, max_steps: 20 },
                linear_tolerance: 1e-12,
                max_cuts: 0,
            },
        );
        d.accepted.u[3] = 1e-4;
        d.balance_start(FaceLoad { pressure: &[], traction: &[] }, [0.0; 3]).expect("a mass");
        let dt = 0.02 / w;
        let steps = (10.0 * 2.0 * std::f64::consts::PI / 0.02) as u64;
        let load = LoadPath { pressure: [&[]; 2], traction: [&[]; 2] };
        let mut peak = 0.0f64;
        for k in 0..steps {
            d.window(dt, 1, load, [0.0; 3], false).expect("a step");
            d.accept();
            if k >= steps - (2.0 * std::f64::consts::PI / 0.02) as u64 {
                peak = peak.max(d.accepted.u[3] * (0.5 * beta * w * w * dt * (k + 1) as f64).exp());
            }
        }
        assert!((peak / 1e-4 - 1.0).abs() < 2e-3, "{peak}");
    }
}
