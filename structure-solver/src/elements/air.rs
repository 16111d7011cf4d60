//! Drag of the air on lines: each segment a cylinder in cross flow.
//!
//! ```math
//! \frac{F}{L} = \tfrac12\rho d\,\bigl(C\,|w_n|\,w_n + \pi C_f\,|w_t|\,w_t\bigr)
//! ```
//!
//! with $`w_n`$, $`w_t`$ the parts of the relative air velocity across and along the segment
//! (cross-flow principle: Hoerner, Fluid-Dynamic Drag, 1965, chapter 3). The velocity of a
//! segment is the mean of its ends' over the step. The air is that of the far field, at the height of the segment's middle
//! ([`Stream`]).
//!
//! The tangent holds the derivative by velocities, which is large in short steps; that by the
//! turn of the segment is left out, being smaller than the lines' stiffness by the ratio of
//! drag to tension, times the drag's own smallness. So is that by the height, smaller by the change of the wind over the
//! segment's stretch.

use super::{Kernel, Load, Step};
use crate::stream::Stream;
use mesh::geometry::{Mat3, Vec3};

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
        let f = across * (self.across * across.norm());
        (f + along * (self.along * along.norm())) * length
    }

    /// Derivative of [`Cylinder::force`] by the velocity, N s/m.
    #[inline(always)]
    pub fn by_velocity(&self, d: Vec3, w: Vec3) -> Mat3 {
        let Parts { length, direction, across, along } = Parts::new(d, w);
        let size = across.norm();
        let (a, b) = (length * self.across, 2.0 * length * self.along * along.norm());
        let inverse = if size > 0.0 { 1.0 / size } else { 0.0 };
        Mat3::from_fn(|i, j| {
            let turn = direction[i] * direction[j];
            let unit = if i == j { 1.0 } else { 0.0 };
            a * (size * (unit - turn) + across[i] * across[j] * inverse) + b * turn
        })
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
        let length = d.norm();
        let direction = if length > 0.0 { d * (1.0 / length) } else { Vec3::zeros() };
        let along = direction * w.dot(&direction);
        Self { length, direction, across: w - along, along }
    }
}

/// A segment: where its ends were at the start of the step, m.
#[derive(Clone, Copy, Debug, Default)]
pub struct Strand {
    start: [Vec3; 2],
}

/// Drag on segments of lines.
pub struct LineDrag {
    cylinder: Cylinder,
    /// The air in the falling frame.
    air: Stream,
    /// One over the step, 1/s.
    rate: f64,
}

impl LineDrag {
    /// In air that moves with the frame.
    pub fn new(cylinder: Cylinder) -> Self {
        Self { cylinder, air: Stream::default(), rate: 0.0 }
    }

    /// Vector along a segment at `x`, and the air's velocity past it.
    #[inline(always)]
    fn stream(&self, e: &Strand, x: &[Vec3; 2], [a, b]: &[Vec3; 2]) -> (Vec3, Vec3) {
        let moved = *a - e.start[0] + (*b - e.start[1]);
        // Rate zero stands for air alone: a step without length.
        let own = if self.rate > 0.0 { moved * (0.5 * self.rate) } else { Vec3::zeros() };
        (x[1] - x[0], self.air.at(0.5 * (x[0].z + x[1].z)) - own)
    }
}

impl Kernel<2> for LineDrag {
    type Element = Strand;
    type Batch = ();
    const RATE: bool = true;
    const AIR: bool = true;

    fn set_air(&mut self, air: &Stream) {
        self.air = air.clone();
    }

    fn air_force(&self, e: &Strand, x: &[Vec3; 2]) -> Vec3 {
        let (d, w) = self.stream(e, x, x);
        self.cylinder.force(d, w)
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = 1.0 / dt;
    }

    fn anchor(&self, e: &mut Strand, x: &[Vec3; 2]) {
        e.start = *x;
    }

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Strand,
        step: &Step<2>,
        _load: &Load,
    ) -> [Vec3; 2] {
        let (d, w) = self.stream(e, &step.at, &step.end);
        [self.cylinder.force(d, w) * (-0.5); 2]
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Strand,
        step: &Step<2>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; 2], [[Mat3; 2]; 2]) {
        let by = 0.25 * factor * self.rate / step.weight;
        let (d, w) = self.stream(e, &step.at, &step.end);
        let k = self.cylinder.by_velocity(d, w).map(|row| row * by);
        (self.force::<TRACTION, BLEND>(e, step, load), [[k; 2]; 2])
    }

    /// Of the motion in the frame: air that drives the lines gives a negative one.
    fn dissipation(&self, e: &Strand, before: &[Vec3; 2], after: &[Vec3; 2]) -> f64 {
        let (d, w) = self.stream(e, after, after);
        let moved = after[0] - before[0] + (after[1] - before[1]);
        -0.5 * self.cylinder.force(d, w).dot(&moved)
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
        let f = cylinder.force(Vec3::new(0.0, 0.0, length), Vec3::new(speed, 0.0, 0.0));
        assert!((f[0] / full - 1.0).abs() < 1e-14 && f[1] == 0.0 && f[2] == 0.0, "{f:?}");
        let angle = std::f64::consts::FRAC_PI_6;
        let smooth = Cylinder::new(rho, width, c, 0.0);
        let f = smooth.force(Vec3::new(angle.cos(), 0.0, angle.sin()) * length, Vec3::new(speed, 0.0, 0.0));
        assert!((f.norm() / full - 0.25).abs() < 1e-14, "{f:?}");
        assert!((f[0] * angle.cos() + f[2] * angle.sin()).abs() < 1e-14 * full);
        let f = cylinder.force(Vec3::new(length, 0.0, 0.0), Vec3::new(speed, 0.0, 0.0));
        let skin = 0.5 * rho * cf * std::f64::consts::PI * width * length * speed * speed;
        assert!((f[0] / skin - 1.0).abs() < 1e-14, "{f:?}");
    }

    #[test]
    fn the_derivative_by_velocity() {
        let c = Cylinder::new(1.2, 0.5, 1.1, 0.3);
        let (d, w) = (Vec3::new(0.3, 1.2, -0.7), Vec3::new(2.0, -1.0, 0.5));
        let k = c.by_velocity(d, w);
        for j in 0..3 {
            let h = 1e-6;
            let shifted = |s: f64| c.force(d, Vec3::from_fn(|i, _| w[i] + if i == j { s } else { 0.0 }));
            let (up, down) = (shifted(h), shifted(-h));
            for i in 0..3 {
                let slope = (up[i] - down[i]) / (2.0 * h);
                assert!((slope - k[(i, j)]).abs() < 1e-8, "{i} {j}: {slope} {}", k[(i, j)]);
            }
        }
        assert_eq!(c.by_velocity(d, Vec3::zeros()), Mat3::zeros());
    }
}
