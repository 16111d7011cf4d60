//! Elements of one kernel on a rank: gathering, scattering and assembly, once for all kernels.

use super::stencil::Stencil;
use super::{Configuration, ElementLoop, FaceLoad, nominal_stress, principal_stresses, stress_direction};
use crate::elements::mass::MassMatrix;
use crate::elements::{Kernel, Load, Sheet, Step};
use crate::failure_site::principal;
use crate::flat::{Block, at};
use crate::materials::Regime;
use crate::stream::Stream;
use mesh::geometry::Vec3;

struct Element<D, const N: usize> {
    stencil: Stencil<N>,
    face: u32,
    data: D,
}

/// Elements of one kernel.
pub struct Elements<K: Kernel<N>, const N: usize> {
    kernel: K,
    elements: Vec<Element<K::Element, N>>,
    n_own: usize,
    /// Elements whose states are reported, one for each row; all in their order where `None`.
    rows: Option<Vec<u32>>,
    /// Places of cable elements among the cables of the model.
    cables: Vec<u32>,
    /// Places among the triangles of the model of the rows that are reported.
    sheets: Vec<u32>,
    /// Internal variables at the accepted state, element by element.
    accepted: Vec<f64>,
    /// Energy that internal variables took since it was asked for, J.
    dissipated: f64,
}

/// An element of the mesh: its local nodes, the face that loads it, and what its kernel keeps.
pub(super) type Part<D, const N: usize> = ([u32; N], u32, D);

impl<K: Kernel<N>, const N: usize> Elements<K, N> {
    /// Of `parts`, the first `n_own` of which are counted on this rank.
    pub(super) fn new(
        kernel: K,
        parts: impl Iterator<Item = Part<K::Element, N>>,
        n_own: usize,
        rows: Option<Vec<u32>>,
    ) -> Self {
        let elements =
            parts.map(|(nodes, face, data)| Element { stencil: Stencil::new(nodes), face, data }).collect();
        let (cables, sheets, accepted) = (Vec::new(), Vec::new(), Vec::new());
        let mut all = Self { kernel, elements, n_own, rows, cables, sheets, accepted, dissipated: 0.0 };
        all.keep();
        all
    }

    /// With the places of its elements among the cables of the model.
    pub(super) fn with_cables(self, cables: Vec<u32>) -> Self {
        Self { cables, ..self }
    }

    /// With the places of the rows that are reported among the triangles of the model.
    pub(super) fn with_sheets(self, sheets: Vec<u32>) -> Self {
        Self { sheets, ..self }
    }

    fn set_histories(&mut self, all: &[f64]) {
        let rows = all.chunks_exact(K::VARIABLES.max(1));
        self.elements.iter_mut().zip(rows).for_each(|(e, row)| self.kernel.set_history(&mut e.data, row));
    }

    /// All elements, or those that touch an `active` node. Asked element by element, so that both are one compiled loop.
    fn chosen<'e>(&'e self, active: Option<&'e [bool]>) -> impl Iterator<Item = &'e Element<K::Element, N>> {
        self.elements.iter().filter(move |e| active.is_none_or(|active| e.stencil.touches(active)))
    }

    fn forces_with<const TRACTION: bool, const BLEND: bool>(
        &self,
        active: Option<&[bool]>,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        for e in self.chosen(active) {
            let (step, load) = (e.step::<BLEND>(configuration), e.load::<K, TRACTION>(load));
            e.stencil.scatter(&self.kernel.force::<TRACTION, BLEND>(&e.data, &step, &load), out);
        }
    }

    fn tangent_with<const TRACTION: bool, const BLEND: bool>(
        &self,
        active: Option<&[bool]>,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        for e in self.chosen(active) {
            let (step, load) = (e.step::<BLEND>(configuration), e.load::<K, TRACTION>(load));
            let (force, k) = self.kernel.tangent::<TRACTION, BLEND>(&e.data, &step, &load, factor);
            e.stencil.scatter(&force, out);
            e.stencil.add_blocks(&k, blocks);
        }
    }

    fn forces_of(
        &self,
        active: Option<&[bool]>,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        match (K::LOADED && !load.traction.is_empty(), K::RATE || configuration.weight != 1.0) {
            (false, false) => self.forces_with::<false, false>(active, configuration, load, out),
            (false, true) => self.forces_with::<false, true>(active, configuration, load, out),
            (true, false) => self.forces_with::<true, false>(active, configuration, load, out),
            (true, true) => self.forces_with::<true, true>(active, configuration, load, out),
        }
    }

    fn tangent_of(
        &self,
        active: Option<&[bool]>,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        match (K::LOADED && !load.traction.is_empty(), K::RATE || configuration.weight != 1.0) {
            (false, false) => {
                self.tangent_with::<false, false>(active, configuration, load, factor, out, blocks)
            }
            (false, true) => {
                self.tangent_with::<false, true>(active, configuration, load, factor, out, blocks)
            }
            (true, false) => {
                self.tangent_with::<true, false>(active, configuration, load, factor, out, blocks)
            }
            (true, true) => self.tangent_with::<true, true>(active, configuration, load, factor, out, blocks),
        }
    }

    /// Sum over the elements counted on this rank.
    fn sum(&self, one: impl Fn(&Element<K::Element, N>) -> f64) -> f64 {
        self.elements[..self.n_own].iter().map(one).sum()
    }

    /// States of membrane elements, row by row.
    fn sheets<T>(&self, x: &[f64], of: impl Fn(Sheet) -> T) -> Vec<T> {
        self.rows_of(|e| self.kernel.sheet(&e.data, &e.stencil.gather(x)).map(&of))
    }

    /// What `one` says of the elements whose states are reported, row by row.
    fn rows_of<T>(&self, one: impl Fn(&Element<K::Element, N>) -> Option<T>) -> Vec<T> {
        match &self.rows {
            Some(rows) => rows.iter().filter_map(|&k| one(&self.elements[k as usize])).collect(),
            None => self.elements.iter().filter_map(one).collect(),
        }
    }
}

impl<D, const N: usize> Element<D, N> {
    #[inline(always)]
    fn step<const BLEND: bool>(&self, configuration: Configuration<'_>) -> Step<N> {
        let at = self.stencil.gather(configuration.at);
        if BLEND {
            Step { at, end: self.stencil.gather(configuration.end), weight: configuration.weight }
        } else {
            Step::only(at)
        }
    }

    #[inline(always)]
    fn load<K: Kernel<N>, const TRACTION: bool>(&self, load: FaceLoad<'_>) -> Load {
        if !K::LOADED {
            return Load::ZERO;
        }
        let face = self.face as usize;
        let traction = if TRACTION { at(load.traction, face) } else { Vec3::zeros() };
        Load { pressure: load.pressure[face], traction }
    }
}

impl<K: Kernel<N>, const N: usize> ElementLoop for Elements<K, N> {
    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            self.kernel.anchor(&mut e.data, &e.stencil.gather(x));
        }
    }

    fn depends_on_rate(&self) -> bool {
        K::RATE
    }

    fn set_step(&mut self, dt: f64) {
        self.kernel.set_step(dt);
    }

    fn retardation_time(&self) -> f64 {
        self.kernel.retardation_time()
    }

    fn depends_on_time(&self) -> bool {
        K::TIMED
    }

    fn set_time(&mut self, t: f64) {
        self.kernel.set_time(t);
    }

    fn feels_air(&self) -> bool {
        K::AIR
    }

    fn set_air(&mut self, air: &Stream) {
        self.kernel.set_air(air);
    }

    fn air_force(&self, x: &[f64]) -> Vec3 {
        let one = |e: &Element<K::Element, N>| self.kernel.air_force(&e.data, &e.stencil.gather(x));
        self.elements[..self.n_own].iter().filter(|_| K::AIR).fold(Vec3::zeros(), |sum, e| sum + one(e))
    }

    fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        if !K::RATE {
            return 0.0;
        }
        self.sum(|e| self.kernel.dissipation(&e.data, &e.stencil.gather(before), &e.stencil.gather(after)))
    }

    fn has_history(&self) -> bool {
        K::VARIABLES > 0
    }

    fn advance_history(&mut self, x: &[f64]) {
        if K::VARIABLES == 0 {
            return;
        }
        for (k, e) in self.elements.iter_mut().enumerate() {
            let taken = self.kernel.advance_history(&mut e.data, &e.stencil.gather(x));
            self.dissipated += if k < self.n_own { taken } else { 0.0 };
        }
    }

    fn has_dissipation(&self) -> bool {
        K::VARIABLES > 0
    }

    fn dissipated(&mut self) -> f64 {
        std::mem::take(&mut self.dissipated)
    }

    fn keep(&mut self) {
        self.accepted.resize(K::VARIABLES * self.elements.len(), 0.0);
        let rows = self.accepted.chunks_exact_mut(K::VARIABLES.max(1));
        self.elements.iter().zip(rows).for_each(|(e, row)| self.kernel.history(&e.data, row));
    }

    fn rewind(&mut self) {
        let accepted = std::mem::take(&mut self.accepted);
        self.set_histories(&accepted);
        self.accepted = accepted;
    }

    fn save_state(&self) -> Vec<f64> {
        self.accepted.clone()
    }

    fn restore_state(&mut self, saved: &[f64]) -> Result<(), String> {
        if !(saved.is_empty() || saved.len() == K::VARIABLES * self.elements.len()) {
            let [found, variables] = [saved.len(), K::VARIABLES];
            let elements = self.elements.len();
            return Err(format!(
                "{found} internal variables are not those of {elements} elements with {variables} each"
            ));
        }
        if !saved.iter().all(|v| v.is_finite()) {
            return Err("internal variables are not finite".into());
        }
        if !saved.is_empty() {
            self.accepted = saved.to_vec();
            self.set_histories(saved);
        }
        Ok(())
    }

    fn forces(&self, configuration: Configuration<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        self.forces_of(None, configuration, load, out);
    }

    fn tangent(
        &self,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        self.tangent_of(None, configuration, load, factor, out, blocks);
    }

    fn forces_near(
        &self,
        active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        self.forces_of(Some(active), configuration, load, out);
    }

    fn tangent_near(
        &self,
        active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        self.tangent_of(Some(active), configuration, load, factor, out, blocks);
    }

    fn external(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        for e in self.elements.iter().filter(|_| K::LOADED) {
            let p = e.stencil.gather(x);
            let f = if load.traction.is_empty() {
                self.kernel.external::<false>(&e.data, &p, &e.load::<K, false>(load))
            } else {
                self.kernel.external::<true>(&e.data, &p, &e.load::<K, true>(load))
            };
            e.stencil.scatter(&f, out);
        }
    }

    fn energy(&self, x: &[f64]) -> f64 {
        self.sum(|e| self.kernel.energy(&e.data, &e.stencil.gather(x)))
    }

    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        let one = |e: &Element<K::Element, N>| Some((e.stencil.nodes.to_vec(), self.kernel.mass(&e.data)?));
        self.elements.iter().filter_map(one).collect()
    }

    fn mass_shares(&self, element: usize, kind: MassMatrix) -> Vec<f64> {
        self.kernel.mass_shares(&self.elements[element].data, kind).as_flattened().to_vec()
    }

    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.assign_slots(slot));
    }

    fn stresses(&self, x: &[f64]) -> Vec<([f64; 2], Regime)> {
        self.sheets(x, |s| (principal_stresses(&s.stress), s.regime))
    }

    fn nominal_stresses(&self, x: &[f64]) -> Vec<f64> {
        self.sheets(x, |s| nominal_stress(&s))
    }

    fn strains(&self, x: &[f64]) -> Vec<[f64; 2]> {
        self.sheets(x, |s| principal(s.strain))
    }

    fn stress_directions(&self, x: &[f64]) -> Vec<Vec3> {
        self.rows_of(|e| {
            let x = e.stencil.gather(x);
            let sheet = self.kernel.sheet(&e.data, &x)?;
            Some(stress_direction(&sheet.stress, self.kernel.tangents(&e.data, &x)?))
        })
    }

    fn sheets(&self) -> &[u32] {
        &self.sheets
    }

    fn cables(&self) -> &[u32] {
        &self.cables
    }

    fn tensions(&self, x: &[f64]) -> Vec<f64> {
        self.elements.iter().filter_map(|e| self.kernel.tension(&e.data, &e.stencil.gather(x))).collect()
    }
}
