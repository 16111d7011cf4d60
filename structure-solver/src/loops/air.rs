//! Drag of the air on lines: each segment a cylinder in cross flow.
//!
//! $$\frac{F}{L} = \tfrac12\rho d\,\bigl(C\,|w_n|\,w_n + \pi C_f\,|w_t|\,w_t\bigr)$$
//! with $w_n$, $w_t$ the parts of the relative air velocity across and along the segment
//! (cross-flow principle: Hoerner, Fluid-Dynamic Drag, 1965, chapter 3). The velocity of a
//! segment is the mean of its ends' over the step. The air is that of the far field.
//!
//! The tangent holds the derivative by velocities, which is large in short steps; that by the
//! turn of the segment is left out, being smaller than the lines' stiffness by the ratio of
//! drag to tension, times the drag's own smallness.

use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place};
use crate::model::{CableElement, Model};
use crate::vec3::{Mat3, Vec3, add, dot, norm, scale, sub};

/// A cylinder in a stream of the air.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    /// `1/2 rho d C`, kg/m2.
    pub across: f64,
    /// `1/2 rho pi d C_f`, kg/m2.
    pub along: f64,
}

impl Cylinder {
    /// Density (kg/m3), diameter (m), coefficients across and of friction along.
    pub fn new(density: f64, diameter: f64, coefficient: f64, friction: f64) -> Self {
        let half = 0.5 * density * diameter;
        Self { across: half * coefficient, along: half * std::f64::consts::PI * friction }
    }

    /// Force (N) on a segment along `d` (m) in air of velocity `w` relative to it (m/s).
    #[inline(always)]
    pub fn force(&self, d: Vec3, w: Vec3) -> Vec3 {
        let Parts { length, across, along, .. } = Parts::new(d, w);
        let f = scale(self.across * norm(across), across);
        scale(length, add(f, scale(self.along * norm(along), along)))
    }

    /// Derivative of [`Cylinder::force`] by the velocity, N s/m.
    #[inline(always)]
    pub fn by_velocity(&self, d: Vec3, w: Vec3) -> Mat3 {
        let Parts { length, direction, across, along } = Parts::new(d, w);
        let size = norm(across);
        let (a, b) = (length * self.across, 2.0 * length * self.along * norm(along));
        let inverse = if size > 0.0 { 1.0 / size } else { 0.0 };
        let mut k = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                let turn = direction[i] * direction[j];
                let unit = if i == j { 1.0 } else { 0.0 };
                k[i][j] = a * (size * (unit - turn) + across[i] * across[j] * inverse) + b * turn;
            }
        }
        k
    }
}

/// A velocity split along a segment.
struct Parts {
    length: f64,
    direction: Vec3,
    across: Vec3,
    along: Vec3,
}

impl Parts {
    #[inline(always)]
    fn new(d: Vec3, w: Vec3) -> Self {
        let length = norm(d);
        let direction = if length > 0.0 { scale(1.0 / length, d) } else { [0.0; 3] };
        let along = scale(dot(w, direction), direction);
        Self { length, direction, across: sub(w, along), along }
    }
}

struct Strand {
    stencil: Stencil<2>,
    start: [Vec3; 2],
}

/// Drag on all cables of a rank.
pub struct LineDrag {
    elements: Vec<Strand>,
    n_own: usize,
    cylinder: Cylinder,
    /// Velocity of the air in the falling frame, m/s.
    air: Vec3,
    /// One over the step, 1/s.
    rate: f64,
}

impl LineDrag {
    /// On the cables of `model` that stand free in the air.
    pub fn new(model: &Model, cylinder: Cylinder) -> Self {
        let free = |c: &&CableElement| c.kind != mesh::CableKind::Reinforcement;
        let of = |c: &CableElement| Strand { stencil: Stencil::new(c.nodes), start: [[0.0; 3]; 2] };
        let elements = model.cables.iter().filter(free).map(of).collect();
        let n_own = model.cables[..model.n_own_cables].iter().filter(free).count();
        Self { elements, n_own, cylinder, air: [0.0; 3], rate: 0.0 }
    }

    /// Vector along a segment at `x`, and the air's velocity past it.
    #[inline(always)]
    fn stream(&self, e: &Strand, x: &[f64], end: &[f64]) -> (Vec3, Vec3) {
        let [a, b] = e.stencil.gather(end);
        let moved = add(sub(a, e.start[0]), sub(b, e.start[1]));
        // Rate zero stands for air alone: a step without length.
        let own = if self.rate > 0.0 { scale(0.5 * self.rate, moved) } else { [0.0; 3] };
        (e.stencil.between(x), sub(self.air, own))
    }
}

impl ElementLoop for LineDrag {
    fn depends_on_rate(&self) -> bool {
        true
    }

    fn feels_air(&self) -> bool {
        true
    }

    fn set_air(&mut self, velocity: Vec3) {
        self.air = velocity;
    }

    fn air_force(&self, x: &[f64]) -> Vec3 {
        self.elements[..self.n_own].iter().fold([0.0; 3], |sum, e| {
            let (d, w) = self.stream(e, x, x);
            add(sum, self.cylinder.force(d, w))
        })
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = 1.0 / dt;
    }

    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            e.start = e.stencil.gather(x);
        }
    }

    fn forces(&self, place: Place<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        for e in &self.elements {
            let (d, w) = self.stream(e, place.at, place.end);
            let half = scale(-0.5, self.cylinder.force(d, w));
            e.stencil.scatter(&[half; 2], out);
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
        let by = 0.25 * factor * self.rate / place.weight;
        for e in &self.elements {
            let (d, w) = self.stream(e, place.at, place.end);
            let k = self.cylinder.by_velocity(d, w).map(|row| scale(by, row));
            e.stencil.add_blocks(&[[k; 2]; 2], blocks);
        }
    }

    /// Of the motion in the frame: air that drives the lines gives a negative one.
    fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        let one = |e: &Strand| {
            let (d, w) = self.stream(e, after, after);
            let ([a1, b1], [a0, b0]) = (e.stencil.gather(after), e.stencil.gather(before));
            -0.5 * dot(self.cylinder.force(d, w), add(sub(a1, a0), sub(b1, b0)))
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Across: the drag of a cylinder, 1/2 rho C d L U^2. Inclined by 30 degrees to the
    /// stream: sin^2 of it, perpendicular to the cylinder. Along: friction alone.
    #[test]
    fn the_drag_of_a_cylinder() {
        let (rho, width, length, speed, c, cf) = (1.225, 0.02, 3.0, 7.0, 1.1, 0.004);
        let cylinder = Cylinder::new(rho, width, c, cf);
        let full = 0.5 * rho * c * width * length * speed * speed;
        let f = cylinder.force([0.0, 0.0, length], [speed, 0.0, 0.0]);
        assert!((f[0] / full - 1.0).abs() < 1e-14 && f[1] == 0.0 && f[2] == 0.0, "{f:?}");
        let angle = std::f64::consts::FRAC_PI_6;
        let smooth = Cylinder::new(rho, width, c, 0.0);
        let f = smooth.force(scale(length, [angle.cos(), 0.0, angle.sin()]), [speed, 0.0, 0.0]);
        assert!((norm(f) / full - 0.25).abs() < 1e-14, "{f:?}");
        assert!((f[0] * angle.cos() + f[2] * angle.sin()).abs() < 1e-14 * full);
        let f = cylinder.force([length, 0.0, 0.0], [speed, 0.0, 0.0]);
        let skin = 0.5 * rho * cf * std::f64::consts::PI * width * length * speed * speed;
        assert!((f[0] / skin - 1.0).abs() < 1e-14, "{f:?}");
    }

    #[test]
    fn the_derivative_by_velocity() {
        let c = Cylinder::new(1.2, 0.5, 1.1, 0.3);
        let (d, w) = ([0.3, 1.2, -0.7], [2.0, -1.0, 0.5]);
        let k = c.by_velocity(d, w);
        for j in 0..3 {
            let h = 1e-6;
            let shifted = |s: f64| c.force(d, std::array::from_fn(|i| w[i] + if i == j { s } else { 0.0 }));
            let (up, down) = (shifted(h), shifted(-h));
            for i in 0..3 {
                let slope = (up[i] - down[i]) / (2.0 * h);
                assert!((slope - k[i][j]).abs() < 1e-8, "{i} {j}: {slope} {}", k[i][j]);
            }
        }
        assert_eq!(c.by_velocity(d, [0.0; 3]), [[0.0; 3]; 3]);
    }
}
