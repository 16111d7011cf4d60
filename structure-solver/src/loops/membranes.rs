//! Constant-strain membrane elements of one material, with the loads on their faces.

use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place, principal_stresses};
use crate::culprit::principal;
use crate::elements::load;
use crate::elements::mass::{self, MassMatrix};
use crate::elements::membrane::{self, Deformation};
use crate::materials::step::{self, StepStart};
use crate::materials::{Material, Regime};
use crate::model::{Model, Triangle};
use crate::vec3::{Mat3, Vec3, add, add_block, at, scale, sub};

struct Membrane {
    stencil: Stencil<3>,
    face: u32,
    gradient: [f64; 4],
    /// Reference area times thickness, m3.
    volume: f64,
    start: StepStart,
}

/// Membrane elements of one material, with the loads on their faces.
pub struct Membranes<M> {
    elements: Vec<Membrane>,
    n_own: usize,
    material: M,
    density: f64,
}

impl<M: Material> Membranes<M> {
    /// Of all triangles of `model`: thickness in m, density in kg/m3.
    pub fn new(model: &Model, material: M, thickness: f64, density: f64) -> Self {
        let of = |t: &Triangle| Membrane {
            stencil: Stencil::new(t.nodes),
            face: t.face,
            gradient: t.reference.gradient,
            volume: t.reference.area * thickness,
            start: StepStart::new(&material, [0.0; 3]),
        };
        let elements = model.triangles.iter().map(of).collect();
        Self { elements, n_own: model.n_own_triangles, material, density }
    }

    fn forces_with<'e, const TRACTION: bool, const BLEND: bool>(
        &self,
        elements: impl Iterator<Item = &'e Membrane>,
        place: Place<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        for e in elements {
            let p = e.stencil.gather(place.at);
            let d = membrane::deformation(&e.gradient, &p);
            let s = if BLEND {
                step::stress(&self.material, &e.start, e.deformation(place.end).strain, place.weight)
            } else {
                self.material.stress(d.strain)
            };
            let r = membrane::force(&e.gradient, &d, &s, e.volume);
            let f = face_force::<TRACTION>(e, load, &p);
            e.stencil.scatter(&r.map(|r| sub(r, f)), out);
        }
    }

    fn tangent_with<'e, const TRACTION: bool, const BLEND: bool>(
        &self,
        elements: impl Iterator<Item = &'e Membrane>,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        for e in elements {
            let p = e.stencil.gather(place.at);
            let d = membrane::deformation(&e.gradient, &p);
            let end = if BLEND { e.deformation(place.end) } else { d };
            let (s, c) = if BLEND {
                step::tangent(&self.material, &e.start, end.strain, place.weight)
            } else {
                self.material.tangent(d.strain)
            };
            let r = membrane::force(&e.gradient, &d, &s, e.volume);
            let f = face_force::<TRACTION>(e, load, &p);
            e.stencil.scatter(&r.map(|r| sub(r, f)), out);
            let mut k = if BLEND {
                membrane::stiffness_between(&e.gradient, &d, &end, &s, &c, e.volume * factor)
            } else {
                membrane::stiffness(&e.gradient, &d, &s, &c, e.volume * factor)
            };
            let face = e.face as usize;
            let by_column = load::pressure_tangent(-factor * load.pressure[face], &p);
            let by_traction = if TRACTION {
                load::traction_tangent(scale(-factor, at(load.traction, face)), &p)
            } else {
                [[[0.0; 3]; 3]; 3]
            };
            for (n, row) in k.iter_mut().enumerate() {
                for m in 0..3 {
                    add_block(&mut row[m], &by_column[m]);
                    if TRACTION {
                        add_block(&mut row[m], &by_traction[m]);
                    }
                }
                // Row by row: what is just made is still in registers.
                e.stencil.add_row(n, row, blocks);
            }
        }
    }
}

impl<M: Material> Membranes<M> {
    fn forces_of<'e>(
        &self,
        elements: impl Iterator<Item = &'e Membrane>,
        place: Place<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        match (load.traction.is_empty(), place.weight == 1.0) {
            (true, true) => self.forces_with::<false, false>(elements, place, load, out),
            (true, false) => self.forces_with::<false, true>(elements, place, load, out),
            (false, true) => self.forces_with::<true, false>(elements, place, load, out),
            (false, false) => self.forces_with::<true, true>(elements, place, load, out),
        }
    }

    fn tangent_of<'e>(
        &self,
        elements: impl Iterator<Item = &'e Membrane>,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        match (load.traction.is_empty(), place.weight == 1.0) {
            (true, true) => self.tangent_with::<false, false>(elements, place, load, factor, out, blocks),
            (true, false) => self.tangent_with::<false, true>(elements, place, load, factor, out, blocks),
            (false, true) => self.tangent_with::<true, false>(elements, place, load, factor, out, blocks),
            (false, false) => self.tangent_with::<true, true>(elements, place, load, factor, out, blocks),
        }
    }
}

impl Membrane {
    /// Deformation with the nodes at `x` (m).
    #[inline(always)]
    fn deformation(&self, x: &[f64]) -> Deformation {
        membrane::deformation(&self.gradient, &self.stencil.gather(x))
    }
}

#[inline(always)]
fn face_force<const TRACTION: bool>(e: &Membrane, load: FaceLoad<'_>, p: &[Vec3; 3]) -> Vec3 {
    let face = e.face as usize;
    let f = load::pressure_force(load.pressure[face], p);
    if TRACTION { add(f, load::traction_force(at(load.traction, face), p)) } else { f }
}

impl<M: Material> ElementLoop for Membranes<M> {
    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            let d = e.deformation(x);
            e.start = StepStart::new(&self.material, d.strain);
        }
    }

    fn forces(&self, place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.forces_of(self.elements.iter(), place, load, out);
    }

    fn forces_near(&self, active: &[bool], place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.forces_of(self.elements.iter().filter(|e| e.stencil.touches(active)), place, load, out);
    }

    fn tangent(
        &self,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        self.tangent_of(self.elements.iter(), place, load, factor, out, blocks);
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
        self.tangent_of(near, place, load, factor, out, blocks);
    }

    fn external(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        for e in &self.elements {
            let p = e.stencil.gather(x);
            let f = if load.traction.is_empty() {
                face_force::<false>(e, load, &p)
            } else {
                face_force::<true>(e, load, &p)
            };
            e.stencil.scatter(&[f; 3], out);
        }
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let one = |e: &Membrane| {
            let d = e.deformation(x);
            let s = self.material.stress(d.strain);
            e.volume * self.material.energy(&s, &d.strain)
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        self.elements.iter().map(|e| (e.stencil.nodes.to_vec(), self.density * e.volume)).collect()
    }

    fn mass_shares(&self, _element: usize, kind: MassMatrix) -> Vec<f64> {
        mass::shares::<3>(kind).as_flattened().to_vec()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }

    fn stresses(&self, x: &[f64]) -> Vec<([f64; 2], Regime)> {
        let one = |e: &Membrane| {
            let d = e.deformation(x);
            (principal_stresses(&self.material.stress(d.strain)), self.material.regime(d.strain))
        };
        self.elements.iter().map(one).collect()
    }

    fn strains(&self, x: &[f64]) -> Vec<[f64; 2]> {
        let one = |e: &Membrane| principal(e.deformation(x).strain);
        self.elements.iter().map(one).collect()
    }
}
