//! Which elements of a model are made with which kernel.

use std::collections::HashMap;

use super::Elements;
use crate::elements::air::{self, Cylinder, LineDrag};
use crate::elements::bending::Bending;
use crate::elements::bent::BentFace;
use crate::elements::cable::{AxialStress, Cable, CableLaw};
use crate::elements::hysteresis::Hysteresis;
use crate::elements::membrane::Triangle;
use crate::elements::quad::Quad;
use crate::elements::reefing::{Reefing, Schedule};
use crate::flat::at;
use crate::materials::StepLaw;
use crate::model::{CableElement, Model};
use mesh::geometry::Vec3;

/// A two-node element has no face.
const NO_FACE: u32 = u32::MAX;

fn between(model: &Model, [a, b]: [u32; 2]) -> Vec3 {
    at(&model.reference, b as usize) - at(&model.reference, a as usize)
}

impl<L: StepLaw> Elements<Triangle<L>, 3> {
    /// All triangles of `model`: thickness in m, density in kg/m3.
    pub fn triangles(model: &Model, law: L, thickness: f64, density: f64) -> Self {
        Self::triangles_of(model, |_| true, law, thickness, density)
    }

    /// The triangles of `model` whose cloth is of the `chosen` groups.
    pub fn triangles_of(
        model: &Model,
        chosen: impl Fn(Option<u16>) -> bool,
        law: L,
        thickness: f64,
        density: f64,
    ) -> Self {
        let kernel = Triangle::new(law, density);
        let (mut sheets, mut parts) = (Vec::new(), Vec::new());
        for (row, t) in model.triangles.iter().enumerate().filter(|(_, t)| chosen(t.fabric)) {
            sheets.push(row as u32);
            parts.push((t.nodes, t.face, kernel.element(&t.reference, thickness)));
        }
        let n_own = sheets.partition_point(|row| (*row as usize) < model.n_own_triangles);
        Self::new(kernel, parts.into_iter(), n_own, None).with_sheets(sheets)
    }
}

impl<L: StepLaw> Elements<Quad<L>, 4> {
    /// All quadrilaterals of `model`: thickness in m, density in kg/m3. Their states are reported
    /// for the triangles of each face, in the order of [`Model::triangles`].
    pub fn quads(model: &Model, law: L, thickness: f64, density: f64) -> Self {
        Self::quads_of(model, |_| true, law, thickness, density)
    }

    /// As [`Elements::quads`], of those whose cloth is of the `chosen` groups.
    pub fn quads_of(
        model: &Model,
        chosen: impl Fn(Option<u16>) -> bool,
        law: L,
        thickness: f64,
        density: f64,
    ) -> Self {
        let kernel = Quad::new(law, thickness, density);
        let (own, ghosts) = model.quads.split_at(model.n_own_quads);
        let n_own = own.iter().filter(|q| chosen(q.fabric)).count();
        let all = own.iter().chain(ghosts).filter(|q| chosen(q.fabric));
        let element: HashMap<u32, u32> = all.clone().enumerate().map(|(k, q)| (q.face, k as u32)).collect();
        // A triangle that touches this rank has its whole face here.
        let reported = model.triangles.iter().enumerate().filter(|(_, t)| chosen(t.fabric));
        let (sheets, rows) = reported.map(|(row, t)| (row as u32, element[&t.face])).unzip();
        let parts: Vec<_> = all.map(|q| (q.nodes, q.face, kernel.element(q.reference))).collect();
        Self::new(kernel, parts.into_iter(), n_own, Some(rows)).with_sheets(sheets)
    }
}

impl Elements<BentFace, 4> {
    /// All split faces of `model`: thickness in m, density in kg/m3.
    pub fn bent_faces(model: &Model, thickness: f64, density: f64) -> Self {
        Self::bent_faces_of(model, |_| true, thickness, density)
    }

    /// The split faces of `model` whose cloth is of the `chosen` groups.
    pub fn bent_faces_of(
        model: &Model,
        chosen: impl Fn(Option<u16>) -> bool,
        thickness: f64,
        density: f64,
    ) -> Self {
        let of = |f: &crate::model::SplitFace| {
            let x = f.nodes.map(|n| at(&model.reference, n as usize));
            (f.nodes, f.face, BentFace::element(&x, thickness * density))
        };
        // No energy is counted.
        Self::new(BentFace, model.split_faces.iter().filter(|f| chosen(f.fabric)).map(of), 0, None)
    }
}

impl Elements<Bending, 6> {
    /// Bending of all patches of `model`, of a stiffness in N m.
    pub fn bending(model: &Model, stiffness: f64) -> Self {
        let kernel = Bending::new(stiffness);
        let parts: Vec<_> =
            model.patches.iter().map(|p| (p.nodes, NO_FACE, kernel.element(&p.reference))).collect();
        Self::new(kernel, parts.into_iter(), model.n_own_patches, None)
    }
}

impl<S: AxialStress> Elements<Cable<S>, 2> {
    /// All cables of `model`: cross-section in m2, density in kg/m3.
    pub fn cables(model: &Model, stress: S, area: f64, density: f64) -> Self {
        Self::cables_of(model, |_| true, stress, area, density)
    }

    /// The cables of `model` of some kinds. Each has the cross-section `area` (m2) times its share, and `density` (kg/m3).
    pub fn cables_of(
        model: &Model,
        chosen: impl Fn(&CableElement) -> bool,
        stress: S,
        area: f64,
        density: f64,
    ) -> Self {
        let kernel = Cable { stress, density };
        let (mut rows, mut parts) = (Vec::new(), Vec::new());
        for (row, c) in model.cables.iter().enumerate().filter(|(_, c)| chosen(c)) {
            let element = kernel.element(c.rest_length, c.share * area, between(model, c.nodes));
            rows.push(row as u32);
            parts.push((c.nodes, NO_FACE, element));
        }
        let n_own = rows.partition_point(|row| (*row as usize) < model.n_own_cables);
        Self::new(kernel, parts.into_iter(), n_own, None).with_cables(rows)
    }
}

impl<L: CableLaw> Elements<Hysteresis<L>, 2> {
    /// Sliders of the cables of `model` of some kinds, as [`Elements::cables_of`]; massless.
    pub fn sliders(
        model: &Model,
        chosen: impl Fn(&CableElement) -> bool,
        kernel: Hysteresis<L>,
        area: f64,
    ) -> Self {
        let (mut rows, mut parts) = (Vec::new(), Vec::new());
        for (row, c) in model.cables.iter().enumerate().filter(|(_, c)| chosen(c)) {
            rows.push(row as u32);
            parts.push((c.nodes, NO_FACE, kernel.element(c.rest_length, c.share * area)));
        }
        let n_own = rows.partition_point(|row| (*row as usize) < model.n_own_cables);
        Self::new(kernel, parts.into_iter(), n_own, None).with_cables(rows)
    }
}

impl Elements<Cable<Reefing>, 2> {
    /// The segments of one reefing line of cross-section `area` (m2) through the ties of `model`;
    /// `skirt` is their length in the whole unstressed structure, m.
    pub fn reefing(model: &Model, youngs_modulus: f64, area: f64, schedule: Schedule, skirt: f64) -> Self {
        // Massless, but with blocks in the matrix.
        let kernel = Cable { stress: Reefing::new(youngs_modulus, schedule, skirt), density: 0.0 };
        let of = |t: &[u32; 2]| {
            let d = between(model, *t);
            (*t, NO_FACE, kernel.element(d.norm() / skirt, area, d))
        };
        let parts: Vec<_> = model.ties.iter().map(of).collect();
        Self::new(kernel, parts.into_iter(), model.n_own_ties, None)
    }
}

impl Elements<LineDrag, 2> {
    /// The cables of `model` that stand free in the air.
    pub fn line_drag(model: &Model, cylinder: Cylinder) -> Self {
        let free = |c: &&CableElement| c.kind.is_free();
        let of = |c: &CableElement| (c.nodes, NO_FACE, air::Strand::default());
        let n_own = model.cables[..model.n_own_cables].iter().filter(free).count();
        Self::new(LineDrag::new(cylinder), model.cables.iter().filter(free).map(of), n_own, None)
    }
}
