//! Friction of a pair in contact: a spring that slips.
//!
//! Each side keeps the point at which the pair sticks. The tangential part $`e`$ of the distance of these points is elastic, with
//! the stiffness $`k`$ of the contact and the energy $`\tfrac12 k\,|e|^2`$; where its force would exceed $`\mu N`$ the points
//! slip until it equals it (Coulomb's law, return mapping; Wriggers, Computational Contact Mechanics, 2006, sections 5.2 and 10.5).
//!
//! A spring with a slider needs no velocity to be regularised with: it holds at rest, and a step of any length and either kind takes the same law.
//! The stiffness is that of the contact, so that the stable step is the same; the pair sticks within $`\mu`$ times its
//! penetration. **Energy:** with the points held, the force is the gradient of the energy; slip shortens $`e`$
//! at fixed positions and only takes energy.
//!
//! With the weights $`c_i`$ of the closest points and $`c^0_i`$ of the sticking points ($`e = \sum (c^0_i - c_i)\,x_i`$, with
//! $`d\,n = \sum c_i\,x_i`$) the force on node $`i`$ is $`-k\,(c^0_i (e + d\,n) - c_i\,d\,n)`$: the sum and the moment of all four vanish.

use super::touch::Touch;
use crate::flat::{Block, add_block, at};
use mesh::geometry::{Mat3, Vec3};

/// Where a pair sticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stick {
    /// Weights of the four nodes at the sticking points.
    pub(super) weights: [f64; 4],
    /// Length of the elastic displacement at the last step, m.
    pub(super) elastic: f64,
}

/// Numbers of a saved [`Stick`].
pub(super) const NUMBERS: usize = 6;

/// As numbers; the first says whether there is one.
pub(super) fn row(stick: Option<Stick>) -> [f64; NUMBERS] {
    stick.map_or([0.0; NUMBERS], |s| {
        let [a, b, c, d] = s.weights;
        [1.0, a, b, c, d, s.elastic]
    })
}

/// What [`row`] gave; `None` where the numbers are none of a pair.
pub(super) fn of_row(r: [f64; NUMBERS]) -> Option<Option<Stick>> {
    match r[0] {
        0.0 => Some(None),
        1.0 if r[5] >= 0.0 => Some(Some(Stick { weights: [r[1], r[2], r[3], r[4]], elastic: r[5] })),
        _ => None,
    }
}

/// A displacement cut to a length.
pub(super) fn limited(elastic: Vec3, length: f64) -> Vec3 {
    let size = elastic.norm();
    if size > length { elastic * (length / size) } else { elastic }
}

/// A pair after slip.
struct Slide {
    /// Weights of its sticking points.
    weights: [f64; 4],
    /// Elastic displacement that is left, m.
    elastic: Vec3,
    /// Slip, m.
    slip: f64,
}

impl Touch {
    /// Tangential distance of the sticking points of a pair, m.
    fn elastic(&self, stick: &Stick, x: &[f64]) -> Vec3 {
        let part = |i: usize| at(x, self.nodes[i] as usize) * (stick.weights[i] - self.weights[i]);
        part(0) + part(1) + part(2) + part(3)
    }

    /// Slips as far as the coefficient of friction asks for; `None` where nothing sticks yet.
    fn slide(&self, friction: f64, x: &[f64]) -> Option<Slide> {
        let stick = self.stick?;
        let elastic = self.elastic(&stick, x);
        let (size, limit) = (elastic.norm(), friction * self.gap * self.fade);
        let share = if size > limit { limit / size } else { 1.0 };
        let moved = |i: usize| self.weights[i] + share * (stick.weights[i] - self.weights[i]);
        Some(Slide { weights: [0, 1, 2, 3].map(moved), elastic: elastic * share, slip: size * (1.0 - share) })
    }

    /// Ends a step at `x` (m): where the pair sticks then, and the energy that slip took at a stiffness (N/m), J. That is the mean
    /// force of the step over the slip.
    pub(super) fn after_step(&self, friction: f64, stiffness: f64, x: &[f64]) -> (Option<Stick>, f64) {
        let before = self.stick.map_or(0.0, |s| s.elastic);
        if self.gap <= 0.0 {
            return (None, 0.5 * stiffness * before * before);
        }
        match self.slide(friction, x) {
            Some(Slide { weights, elastic, slip }) => {
                let elastic = elastic.norm();
                (Some(Stick { weights, elastic }), 0.5 * stiffness * (before + elastic) * slip)
            }
            None => (Some(Stick { weights: self.weights, elastic: 0.0 }), 0.0),
        }
    }

    /// Adds internal forces of friction (N) to the rows that `add` leads to.
    #[inline]
    pub(super) fn add_friction(
        &self,
        friction: f64,
        stiffness: f64,
        x: &[f64],
        mut add: impl FnMut(u32, Vec3),
    ) {
        let Some(slide) = self.slide(friction, x) else { return };
        let normal = self.normal * self.distance;
        let whole = slide.elastic + normal;
        for i in 0..4 {
            add(self.nodes[i], (whole * slide.weights[i] - normal * self.weights[i]) * stiffness);
        }
    }

    /// Adds the blocks of the nodes with themselves: the spring along the surface, as much softer as it has slipped.
    pub(super) fn add_friction_blocks(
        &self,
        friction: f64,
        stiffness: f64,
        x: &[f64],
        mut block: impl FnMut(u32) -> Option<usize>,
        blocks: &mut [Block],
    ) {
        let Some(slide) = self.slide(friction, x) else { return };
        let elastic = slide.elastic.norm();
        let share = if slide.slip > 0.0 { elastic / (elastic + slide.slip) } else { 1.0 };
        let k = (Mat3::identity() - self.normal * self.normal.transpose()) * (stiffness * share);
        for (node, w) in self.nodes.iter().zip(self.weights) {
            if let Some(b) = block(*node) {
                add_block(&mut blocks[b], &(k * (w * w)));
            }
        }
    }

    /// Elastic energy of friction at a stiffness (N/m), J.
    pub(super) fn friction_energy(&self, friction: f64, stiffness: f64, x: &[f64]) -> f64 {
        self.slide(friction, x).map_or(0.0, |s| 0.5 * stiffness * s.elastic.norm_squared())
    }
}
