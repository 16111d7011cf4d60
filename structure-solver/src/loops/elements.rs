//! Elements of one kernel on a rank: gathering, scattering and assembly, once for all kernels.

use super::stencil::Stencil;
use super::{Configuration, ElementLoop, FaceLoad, SheetState};
use crate::elements::mass::MassMatrix;
use crate::elements::{Kernel, Load, Step};
use crate::flat::{Block, at};
use crate::stream::Stream;
use mesh::geometry::Vec3;
use mesh::lanes::{LANES, Lanes, gather, lanes};
use nalgebra::Vector3;

struct Element<D, const N: usize> {
    stencil: Stencil<N>,
    face: u32,
    data: D,
}

/// Elements that are computed together.
struct Batch<D, const N: usize> {
    nodes: [[u32; LANES]; N],
    faces: [u32; LANES],
    data: D,
}

/// Elements of one kernel.
pub struct Elements<K: Kernel<N>, const N: usize> {
    kernel: K,
    elements: Vec<Element<K::Element, N>>,
    /// The first elements again, where the kernel takes several together.
    batches: Vec<Batch<K::Batch, N>>,
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
        let batches = Vec::new();
        let mut all =
            Self { kernel, elements, batches, n_own, rows, cables, sheets, accepted, dissipated: 0.0 };
        all.batches = all.batched().unwrap_or_default();
        all.keep();
        all
    }

    /// Batches of the elements from the first on; `None` where the kernel takes each alone.
    fn batched(&self) -> Option<Vec<Batch<K::Batch, N>>> {
        let (groups, _) = self.elements.as_chunks::<LANES>();
        let one = |group: &[Element<K::Element, N>; LANES]| {
            let nodes = std::array::from_fn(|n| std::array::from_fn(|l| group[l].stencil.nodes[n]));
            let data = self.kernel.batch(group.each_ref().map(|e| &e.data))?;
            Some(Batch { nodes, faces: group.each_ref().map(|e| e.face), data })
        };
        groups.iter().map(one).collect()
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

    /// As [`Elements::forces_with`] of all elements, several together where the kernel takes them, with nodes at `x` (m).
    fn forces_at<const TRACTION: bool>(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        let (rows, _) = x.as_chunks::<3>();
        let (sums, _) = out.as_chunks_mut::<3>();
        for b in &self.batches {
            let f = self.kernel.forces::<TRACTION>(&b.data, &b.gather(rows), &b.load::<K, TRACTION>(load));
            if let Some(f) = f {
                b.scatter(&f, sums);
            }
        }
        for e in &self.elements[LANES * self.batches.len()..] {
            let (step, load) = (Step::only(e.stencil.gather(x)), e.load::<K, TRACTION>(load));
            e.stencil.scatter(&self.kernel.force::<TRACTION, false>(&e.data, &step, &load), out);
        }
    }

    /// As [`Elements::forces_at`], external forces alone.
    fn external_at<const TRACTION: bool>(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        let (rows, _) = x.as_chunks::<3>();
        let (sums, _) = out.as_chunks_mut::<3>();
        for b in &self.batches {
            let f = self.kernel.externals::<TRACTION>(&b.data, &b.gather(rows), &b.load::<K, TRACTION>(load));
            if let Some(f) = f {
                b.scatter(&f, sums);
            }
        }
        for e in &self.elements[LANES * self.batches.len()..] {
            let (x, load) = (e.stencil.gather(x), e.load::<K, TRACTION>(load));
            e.stencil.scatter(&self.kernel.external::<TRACTION>(&e.data, &x, &load), out);
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
            (false, false) if active.is_none() => self.forces_at::<false>(configuration.at, load, out),
            (true, false) if active.is_none() => self.forces_at::<true>(configuration.at, load, out),
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
}

impl<D, const N: usize> Batch<D, N> {
    #[inline(always)]
    fn load<K: Kernel<N>, const TRACTION: bool>(&self, load: FaceLoad<'_>) -> Load<Lanes> {
        let zero = Load { pressure: Lanes::ZERO, traction: Vector3::repeat(Lanes::ZERO) };
        if !K::LOADED {
            return zero;
        }
        let pressure = lanes(|l| load.pressure[self.faces[l] as usize]);
        if TRACTION {
            Load { pressure, traction: gather(load.traction.as_chunks().0, &self.faces) }
        } else {
            Load { pressure, ..zero }
        }
    }

    /// Values of the nodes. Loops, because closures over arrays are not inlined here.
    #[inline(always)]
    fn gather(&self, rows: &[[f64; 3]]) -> [Vector3<Lanes>; N] {
        let mut x = [Vector3::repeat(Lanes::ZERO); N];
        for n in 0..N {
            x[n] = gather(rows, &self.nodes[n]);
        }
        x
    }

    /// Adds a force of each node, element after element.
    #[inline(always)]
    fn scatter(&self, f: &[Vector3<Lanes>; N], sums: &mut [[f64; 3]]) {
        let mut lanes = [[[0.0; LANES]; 3]; N];
        for n in 0..N {
            lanes[n] = [f[n][0].into_arr(), f[n][1].into_arr(), f[n][2].into_arr()];
        }
        for l in 0..LANES {
            for n in 0..N {
                let sum = &mut sums[self.nodes[n][l] as usize];
                for c in 0..3 {
                    sum[c] += lanes[n][c][l];
                }
            }
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
        check_histories(saved, self.elements.len(), K::VARIABLES)?;
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
        match (K::LOADED, load.traction.is_empty()) {
            (false, _) => {}
            (true, true) => self.external_at::<false>(x, load, out),
            (true, false) => self.external_at::<true>(x, load, out),
        }
    }

    fn energy(&self, x: &[f64]) -> f64 {
        self.sum(|e| self.kernel.energy(&e.data, &e.stencil.gather(x)))
    }

    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        let mut masses = Vec::new();
        for e in &self.elements {
            if let Some(mass) = self.kernel.mass(&e.data) {
                masses.push((e.stencil.nodes.to_vec(), mass));
            }
        }
        masses
    }

    fn mass_shares(&self, element: usize, kind: MassMatrix) -> Vec<f64> {
        self.kernel.mass_shares(&self.elements[element].data, kind).as_flattened().to_vec()
    }

    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.assign_slots(slot));
    }

    fn sheet_states(&self, x: &[f64]) -> Vec<SheetState> {
        let mut states = Vec::new();
        for row in 0..self.rows.as_ref().map_or(self.elements.len(), Vec::len) {
            let e = &self.elements[self.rows.as_ref().map_or(row, |rows| rows[row] as usize)];
            let x = e.stencil.gather(x);
            let sheet = self.kernel.sheet(&e.data, &x);
            if let (Some(sheet), Some(gradient)) = (sheet, self.kernel.tangents(&e.data, &x)) {
                states.push(SheetState { sheet, gradient });
            }
        }
        states
    }

    fn sheets(&self) -> &[u32] {
        &self.sheets
    }

    fn cables(&self) -> &[u32] {
        &self.cables
    }

    fn tensions(&self, x: &[f64]) -> Vec<f64> {
        let mut tensions = Vec::new();
        for e in &self.elements {
            tensions.extend(self.kernel.tension(&e.data, &e.stencil.gather(x)));
        }
        tensions
    }
}

/// Checks that `saved` are the internal variables of `elements` elements with `variables` each, or none.
fn check_histories(saved: &[f64], elements: usize, variables: usize) -> Result<(), String> {
    if !(saved.is_empty() || saved.len() == variables * elements) {
        let found = saved.len();
        return Err(format!(
            "{found} internal variables are not those of {elements} elements with {variables} each"
        ));
    }
    if !saved.iter().all(|v| v.is_finite()) {
        return Err("internal variables are not finite".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use comm::Comm;
    use mesh::StructureMesh;

    use super::*;
    use crate::materials::{
        Elastic, Material, NeoHookean, NeoHookeanTensionField, OrthotropicTensionField, Prestressed,
        StVenantKirchhoff, TensionField, Viscous,
    };
    use crate::model::Model;

    /// A strip of bent faces, cut along alternate diagonals, and a last triangle: no multiple of a batch.
    fn model() -> Model {
        let n = 7;
        let (mut mesh, nodes) = (StructureMesh::default(), 2 * (n + 1) + 1);
        mesh.coords =
            (0..nodes).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.1 * f64::from(i % 3)]).collect();
        mesh.n_canopy = nodes as usize;
        for k in 0..n {
            let face = [2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1];
            let cut = if k % 2 == 0 { [[0, 1, 2], [0, 2, 3]] } else { [[1, 2, 3], [1, 3, 0]] };
            mesh.triangles.extend(cut.map(|t: [usize; 3]| t.map(|c| face[c])));
            mesh.triangle_face.extend([k; 2]);
            mesh.faces.push(face);
        }
        mesh.faces.push([2 * n, 2 * n + 2, 2 * n + 1, 2 * n + 1]);
        mesh.triangles.push([2 * n, 2 * n + 2, 2 * n + 1]);
        mesh.triangle_face.push(n);
        mesh.face_panel = vec![0; mesh.faces.len()];
        Model::new(&Comm::solo(), &mesh, &vec![0; nodes as usize]).expect("a good mesh")
    }

    /// Forces, and external forces alone, of triangles and of bent faces with nodes at `x`.
    fn forces_of(all: [&dyn ElementLoop; 2], x: &[f64], load: FaceLoad<'_>) -> Vec<Vec<f64>> {
        let mut found = Vec::new();
        for elements in all {
            let mut out = [vec![0.0; x.len()], vec![0.0; x.len()]];
            elements.forces(Configuration::only(x), load, &mut out[0]);
            elements.external(x, load, &mut out[1]);
            found.extend(out);
        }
        found
    }

    fn same_digits(law: impl Material + Copy) {
        let model = model();
        let rest = &model.reference;
        let noise = |i: usize, by: f64| by * (i as f64 * 12.9898).sin();
        let moved = |[a, b]: [f64; 2], by: f64| -> Vec<f64> {
            let stretch = [a, b, 1.0];
            rest.iter().enumerate().map(|(i, x)| x * stretch[i % 3] + noise(i, by)).collect()
        };
        // At rest both principal strains are zero; then taut, wrinkled, slack, and each triangle for itself.
        let shapes = [
            rest.clone(),
            moved([1.2, 1.1], 0.0),
            moved([1.2, 0.7], 0.0),
            moved([0.8, 0.7], 0.0),
            moved([1.0; 2], 0.3),
        ];
        let pressure: Vec<f64> = (0..model.n_faces).map(|i| noise(i, 2.0)).collect();
        let traction: Vec<f64> = (0..3 * model.n_faces).map(|i| noise(i, 0.7)).collect();
        let triangles = || Elements::triangles(&model, Elastic(law), 0.1, 2.0);
        let bent_faces = || Elements::bent_faces(&model, 0.1, 2.0);
        let (mut triangle, mut bent_face) = (triangles(), bent_faces());
        assert_eq!([triangle.batches.len(), bent_face.batches.len()], [3, 1]);
        (triangle.batches, bent_face.batches) = (Vec::new(), Vec::new());
        for x in &shapes {
            for traction in [&[][..], &traction] {
                let load = FaceLoad { pressure: &pressure, traction };
                let together = forces_of([&triangles(), &bent_faces()], x, load);
                assert_eq!(together, forces_of([&triangle, &bent_face], x, load));
                assert!(together.iter().all(|f| f.iter().any(|f| *f != 0.0)));
                assert!(together.iter().flatten().all(|f| f.is_finite()));
            }
        }
    }

    #[test]
    fn batches_have_the_digits_of_single_elements() {
        let field = TensionField::new(7.0, 0.3);
        let orthotropic = OrthotropicTensionField::new(7.0, 4.0, 0.3, 2.0);
        same_digits(field);
        same_digits(orthotropic);
        same_digits(Prestressed::new(field, 0.4));
        same_digits(Prestressed::new(orthotropic, 0.4));
        same_digits(StVenantKirchhoff::orthotropic(7.0, 4.0, 0.3, 2.0));
        same_digits(NeoHookean::new(7.0));
        same_digits(NeoHookeanTensionField::new(7.0));
    }

    /// A stress that depends on the start of the step is not computed from the strain alone.
    #[test]
    fn laws_with_a_start_have_no_batches() {
        let elements =
            Elements::triangles(&model(), Viscous::new(TensionField::new(7.0, 0.3), 0.4), 0.1, 2.0);
        assert!(elements.batches.is_empty());
    }
}
