//! Cable elements of one law.

use super::axial::{self, Axial};
use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place};
use crate::elements::cable::{self, CableLaw};
use crate::elements::mass::{self, MassMatrix};
use crate::model::{CableElement, Model};
use crate::vec3::Mat3;

struct Line {
    stencil: Stencil<2>,
    rest_length: f64,
    /// Strain at the start of the step.
    start: f64,
}

/// Cable elements of one law.
pub struct Cables<L> {
    elements: Vec<Line>,
    n_own: usize,
    law: L,
    /// Green strain at rest length that makes the pre-stress.
    offset: f64,
    area: f64,
    density: f64,
}

impl<L: CableLaw> Cables<L> {
    /// Of all cables of `model`: cross-section in m2, density in kg/m3.
    pub fn new(model: &Model, law: L, area: f64, density: f64) -> Self {
        let of = |c: &CableElement| Line {
            stencil: Stencil::new(c.nodes),
            rest_length: c.rest_length,
            start: 0.0,
        };
        let elements = model.cables.iter().map(of).collect();
        Self { elements, n_own: model.n_own_cables, law, offset: 0.0, area, density }
    }

    /// With a Green strain at rest length: the pre-stress over the modulus. It adds to
    /// the strain, so that energies and steps know of it too.
    pub fn with_strain_at_rest(self, offset: f64) -> Self {
        Self { offset, ..self }
    }

    /// Each element in a step.
    #[inline(always)]
    fn axial<'a>(&'a self, place: Place<'a>) -> impl Iterator<Item = (&'a Stencil<2>, Axial)> {
        self.elements.iter().map(move |e| {
            let (d, end) = (e.stencil.between(place.at), e.stencil.between(place.end));
            let strain = cable::strain(end, e.rest_length) + self.offset;
            let (s, y) = cable::step(&self.law, e.start, strain, place.weight);
            (&e.stencil, Axial { d, end, rest_length: e.rest_length, s, y })
        })
    }
}

impl<L: CableLaw> ElementLoop for Cables<L> {
    fn anchor(&mut self, x: &[f64]) {
        let offset = self.offset;
        for e in &mut self.elements {
            e.start = cable::strain(e.stencil.between(x), e.rest_length) + offset;
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

    fn energy(&self, x: &[f64]) -> f64 {
        let one = |e: &Line| {
            let p = e.stencil.gather(x);
            cable::energy(&self.law, &p, e.rest_length, self.offset, self.area)
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        let mass = |e: &Line| self.density * self.area * e.rest_length;
        self.elements.iter().map(|e| (e.stencil.nodes.to_vec(), mass(e))).collect()
    }

    fn mass_shares(&self, _element: usize, kind: MassMatrix) -> Vec<f64> {
        mass::shares::<2>(kind).as_flattened().to_vec()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }

    fn tensions(&self, x: &[f64]) -> Vec<f64> {
        let one = |e: &Line| {
            let p = e.stencil.gather(x);
            cable::tension(&self.law, &p, e.rest_length, self.offset, self.area)
        };
        self.elements.iter().map(one).collect()
    }
}
