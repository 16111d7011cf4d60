//! The element loops: kernels applied to every element of a rank.
//!
//! A loop is written for concrete materials and laws, so the compiler sees
//! straight arithmetic; which loops there are is chosen once, at construction.

mod air;
mod bent;
mod contact;
mod damping;
mod quads;
mod reefing;
mod stencil;

pub use air::{Cylinder, LineDrag};
pub use bent::BentFaces;
pub use contact::Contact;
pub use damping::{CableDamping, MembraneDamping};
pub use quads::Quads;
pub use reefing::{ReefingLine, Schedule};

use crate::culprit::principal;
use crate::elements::mass::{self, MassMatrix};
use crate::elements::membrane::Deformation;
use crate::elements::{cable, load, membrane};
use crate::materials::step::{self, StepStart};
use crate::materials::{Material, Regime};
use crate::model::{CableElement, Model, Triangle};
use crate::vec3::{Mat3, Vec3, add, add_block, at, scale, sub};
use stencil::Stencil;

/// Loads on the interface faces at one instant.
#[derive(Clone, Copy, Debug)]
pub struct FaceLoad<'a> {
    /// Pressure jump, inside minus outside, Pa, one for each face.
    pub pressure: &'a [f64],
    /// Traction, Pa, shape `[faces][3]`; empty where there is none.
    pub traction: &'a [f64],
}

/// The configuration in which forces balance.
///
/// Geometry and loads are taken at positions `at`. Strains are those at `end`, or,
/// with a `weight` below one, `weight E(end) + (1 - weight) E(start)` with the
/// strains of the step's start ([`ElementLoop::anchor`]): the work of averaged
/// strains over a step equals the change of a quadratic energy (Simo and Tarnow
/// 1992; Kuhl and Crisfield 1999), where strains at averaged positions can create
/// energy without bound.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Positions that turn stresses into forces, m.
    pub at: &'a [f64],
    /// Positions at the end of the step, m.
    pub end: &'a [f64],
    /// Weight of the strains at `end`.
    pub weight: f64,
}

impl<'a> Place<'a> {
    /// Forces of positions `x` alone.
    pub fn only(x: &'a [f64]) -> Self {
        Self { at: x, end: x, weight: 1.0 }
    }
}

/// Slot of a block in a row that another rank owns: not assembled here.
pub const ELSEWHERE: u32 = u32::MAX;

/// The elements of one kind on a rank. Flat arrays have shape `[n_local][3]`;
/// rows of ghosts receive partial sums that nobody reads.
pub trait ElementLoop {
    /// Keeps the strains at positions `x` (m) as those of a step's start.
    fn anchor(&mut self, x: &[f64]);

    /// Whether forces depend on the rate of strains: then [`ElementLoop::anchor`] and
    /// [`ElementLoop::set_step`] precede every step.
    fn depends_on_rate(&self) -> bool {
        false
    }

    /// Length of the next step, s; infinite where rates do not count.
    fn set_step(&mut self, _dt: f64) {}

    /// Whether forces depend on time: then [`ElementLoop::set_time`] precedes every step.
    fn depends_on_time(&self) -> bool {
        false
    }

    /// Time at the end of the next step, s since the start of the stage; infinite for a shape
    /// at rest.
    fn set_time(&mut self, _t: f64) {}

    /// Whether forces depend on the air: then [`ElementLoop::set_air`] precedes every window.
    fn feels_air(&self) -> bool {
        false
    }

    /// Velocity of the undisturbed air in the falling frame, m/s.
    fn set_air(&mut self, _velocity: Vec3) {}

    /// Force of that air (N) on the elements counted on this rank in the last step, which
    /// ended at positions `x` (m).
    fn air_force(&self, _x: &[f64]) -> Vec3 {
        [0.0; 3]
    }

    /// Whether forces act between nodes that no element joins: then [`ElementLoop::find_pairs`]
    /// precedes every step.
    fn finds_pairs(&self) -> bool {
        false
    }

    /// Finds what is near what at positions `x` (m).
    fn find_pairs(&mut self, _x: &[f64]) {}

    /// What later steps depend on beside positions and velocities: pairs that were found.
    fn memory(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Takes up what [`ElementLoop::memory`] gave.
    ///
    /// # Errors
    /// What in it does not fit; nothing is taken up then.
    fn recall(&mut self, memory: &[f64]) -> Result<(), String> {
        if memory.is_empty() { Ok(()) } else { Err("elements that keep nothing have kept something".into()) }
    }

    /// Energy (J) that elements counted on this rank took out of the motion in the
    /// step from positions `before`, where they were anchored, to `after` (m).
    fn dissipation(&self, _before: &[f64], _after: &[f64]) -> f64 {
        0.0
    }

    /// Adds internal minus external forces (N) to `out`.
    fn forces(&self, place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]);

    /// As [`ElementLoop::forces`], and adds `factor` times their derivative to
    /// the blocks of the system matrix. The derivative is by `at`, with `end`
    /// moving in proportion (`factor` is their common weight).
    fn tangent(
        &self,
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    );

    /// As [`ElementLoop::forces`] for the elements that touch an `active` node, shape
    /// `[n_local]`: right in the rows of active nodes, of no meaning in others.
    fn forces_near(&self, _active: &[bool], place: Place<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.forces(place, load, out);
    }

    /// As [`ElementLoop::tangent`] for the elements that touch an `active` node, shape
    /// `[n_local]`: right in the rows of active nodes, of no meaning in others.
    fn tangent_near(
        &self,
        _active: &[bool],
        place: Place<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        self.tangent(place, load, factor, out, blocks);
    }

    /// Adds external forces alone (N) to `out`.
    fn external(&self, _x: &[f64], _load: FaceLoad<'_>, _out: &mut [f64]) {}

    /// Strain energy of the elements counted on this rank, J.
    fn energy(&self, _x: &[f64]) -> f64 {
        0.0
    }

    /// Masses of the elements with their local nodes, kg; none where others have the mass, and the
    /// matrix their blocks.
    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        Vec::new()
    }

    /// Shares of the mass of element `element` (of [`ElementLoop::masses`]) in the
    /// blocks between its nodes, row by row.
    fn mass_shares(&self, _element: usize, _kind: MassMatrix) -> Vec<f64> {
        Vec::new()
    }

    /// Finds where the blocks of the elements lie in the system matrix.
    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32);

    /// Principal stresses (Pa, first the larger) and state of membrane elements, by
    /// element. A bilinear element says it for each of the two triangles of its face.
    fn stresses(&self, _x: &[f64]) -> Vec<([f64; 2], Regime)> {
        Vec::new()
    }

    /// Principal Green strains of membrane elements, the larger first; as
    /// [`ElementLoop::stresses`].
    fn strains(&self, _x: &[f64]) -> Vec<[f64; 2]> {
        Vec::new()
    }

    /// Tensions (N) of cable elements.
    fn tensions(&self, _x: &[f64]) -> Vec<f64> {
        Vec::new()
    }
}

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
            start: StepStart::default(),
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
            for row in &mut k {
                for m in 0..3 {
                    add_block(&mut row[m], &by_column[m]);
                    if TRACTION {
                        add_block(&mut row[m], &by_traction[m]);
                    }
                }
            }
            e.stencil.add_blocks(&k, blocks);
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
            let s = self.material.stress(d.strain);
            let (mean, radius) = (0.5 * (s[0] + s[1]), (0.5 * (s[0] - s[1])).hypot(s[2]));
            ([mean + radius, mean - radius], self.material.regime(d.strain))
        };
        self.elements.iter().map(one).collect()
    }

    fn strains(&self, x: &[f64]) -> Vec<[f64; 2]> {
        let one = |e: &Membrane| principal(e.deformation(x).strain);
        self.elements.iter().map(one).collect()
    }
}

struct Line {
    stencil: Stencil<2>,
    rest_length: f64,
    /// Strain at the start of the step.
    start: f64,
}

impl Line {
    /// Vectors between the ends at the point of balance and at the end of the step.
    #[inline(always)]
    fn between(&self, place: Place<'_>) -> [Vec3; 2] {
        [place.at, place.end].map(|x| self.stencil.between(x))
    }
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

impl<L: cable::CableLaw> Cables<L> {
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

    #[inline(always)]
    fn strain(&self, e: &Line, d: Vec3) -> f64 {
        cable::strain(d, e.rest_length) + self.offset
    }
}

impl<L: cable::CableLaw> ElementLoop for Cables<L> {
    fn anchor(&mut self, x: &[f64]) {
        let offset = self.offset;
        for e in &mut self.elements {
            e.start = cable::strain(e.stencil.between(x), e.rest_length) + offset;
        }
    }

    fn forces(&self, place: Place<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        for e in &self.elements {
            let [d, end] = e.between(place);
            let (s, _) = cable::step(&self.law, e.start, self.strain(e, end), place.weight);
            let f = cable::force(s, d, e.rest_length, self.area);
            e.stencil.scatter_pull(f, out);
        }
    }

    fn tangent(
        &self,
        place: Place<'_>,
        _load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        for e in &self.elements {
            let [d, end] = e.between(place);
            let (s, y) = cable::step(&self.law, e.start, self.strain(e, end), place.weight);
            let f = cable::force(s, d, e.rest_length, self.area);
            let k = cable::stiffness(s, y, d, end, e.rest_length, self.area);
            e.stencil.scatter_pull(f, out);
            e.stencil.add_spring(&k, factor, blocks);
        }
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
