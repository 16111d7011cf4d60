//! The element that a failure is about.

use std::fmt;

use crate::elements::membrane;
use crate::flat::at;
use crate::model::Model;

/// An element of the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// A membrane element of constant strain, by its number.
    Triangle(u64),
    /// A bilinear membrane element, by the number of its face.
    Quadrilateral(u64),
    /// A cable element, by its number.
    Cable(u64),
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Triangle(n) => write!(f, "triangle {n}"),
            Self::Quadrilateral(n) => write!(f, "quadrilateral {n}"),
            Self::Cable(n) => write!(f, "cable {n}"),
        }
    }
}

/// The most strained element at a node, for messages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FailureSite {
    /// The element.
    pub element: Element,
    /// Its largest principal Green strain; infinite where positions are not finite.
    pub strain: f64,
}

impl fmt::Display for FailureSite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "in {} (strained by {:.2e})", self.element, self.strain)
    }
}

/// The most strained element at node `node` (global) with the nodes at `x` (m). `None`
/// for a node without elements. Collective; all ranks find the same.
pub(crate) fn at_node(model: &Model, node: u64, x: &[f64]) -> Option<FailureSite> {
    let local = model.numbering.local(node).filter(|&i| i < model.n_owned());
    let mut worst: Option<FailureSite> = None;
    if let Some(i) = local.map(|i| i as u32) {
        let mut see = |element: Element, strain: f64| {
            let strain = if strain.is_finite() { strain } else { f64::INFINITY };
            if worst.is_none_or(|w| strain > w.strain) {
                worst = Some(FailureSite { element, strain });
            }
        };
        for t in model.triangles.iter().filter(|t| t.nodes.contains(&i)) {
            let p = t.nodes.map(|n| at(x, n as usize));
            let element = if model.quads.is_empty() {
                Element::Triangle(t.global.into())
            } else {
                Element::Quadrilateral(t.face.into())
            };
            see(element, principal(membrane::deformation(&t.reference.gradient, &p).strain)[0]);
        }
        for c in model.cables.iter().filter(|c| c.nodes.contains(&i)) {
            let l = (at(x, c.nodes[1] as usize) - at(x, c.nodes[0] as usize)).norm() / c.rest_length;
            see(Element::Cable(c.global.into()), 0.5 * (l * l - 1.0));
        }
    }
    // Only the owner knows it; the others say 0.
    let code = worst.map_or(0, |w| match w.element {
        Element::Triangle(n) => 3 * n + 1,
        Element::Quadrilateral(n) => 3 * n + 2,
        Element::Cable(n) => 3 * n + 3,
    });
    let code = model.comm.max_u64(code).checked_sub(1)?;
    let strain = model.comm.max(worst.map_or(f64::NEG_INFINITY, |w| w.strain));
    let element = [Element::Triangle, Element::Quadrilateral, Element::Cable][(code % 3) as usize](code / 3);
    Some(FailureSite { element, strain })
}

/// Principal values of a strain in Voigt order (E11, E22, 2 E12), the larger first.
pub(crate) fn principal(e: [f64; 3]) -> [f64; 2] {
    let (mean, radius) = (0.5 * (e[0] + e[1]), (0.25 * ((e[0] - e[1]).powi(2) + e[2].powi(2))).sqrt());
    [mean + radius, mean - radius]
}
