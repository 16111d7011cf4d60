//! Positions in space from which a sewn canopy starts: placed, joined at the seams, and relaxed until no triangle is stretched.
//!
//! A triangle with the flat shape X and the positions x has the deformation gradient F (3 by 2). Its distance from the deformations without stretch, whose
//! singular values are at most 1, is $`\sum_i \max(0, \sigma_i - 1)^2`$ (Frobenius norm, squared). That set is convex, and with it the energy
//! ```math
//! E(x) = \tfrac12 \sum_t A_t \sum_i \max(0, \sigma_{t,i} - 1)^2
//! ```
//! whose gradient is Lipschitz: the accelerated gradient method (Beck and Teboulle, SIAM J. Imaging Sci. 2 (2009), with restart after O'Donoghue and Candès 2015) finds
//! a minimum from any start. The minimum is zero, because cloth may be slack. The method aims at singular values that are smaller by [`MARGIN`], so that it
//! ends with all of them at most 1.

use std::f64::consts::TAU;

use case::pattern::PanelStart;

use super::error::PatternError;
use super::outline::Flat;
use crate::geometry::{Point, Vec3, at};

/// Slack at which the relaxation aims.
const MARGIN: f64 = 1e-3;

/// Stretch that rounding of the positions alone makes.
const ROUNDOFF: f64 = 1e-9;

/// Most iterations: the method reduces the energy with the square of their number, and waves over a hundred elements take about a thousand.
const MOST_ITERATIONS: usize = 4000;

/// Largest stretch of the start, less 1. Textiles break at strains of 0.15 to 0.3 and work at 0.01 to 0.05: a start beyond the lower end of that has
/// the tension of a loaded canopy.
pub(super) const MOST_STRETCH: f64 = 0.01;

/// A triangle for the relaxation.
pub(super) struct Piece {
    pub nodes: [u32; 3],
    /// Gradients of the shape functions of its nodes in the flat shape, 1/m.
    gradient: [Flat; 3],
    area: f64,
}

impl Piece {
    /// Of a counter-clockwise flat triangle, m.
    pub fn new(nodes: [u32; 3], flat: [Flat; 3]) -> Self {
        let [a, b, c] = flat;
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let of = |p: Flat, q: Flat| [(p[1] - q[1]) / twice, (q[0] - p[0]) / twice];
        Self { nodes, gradient: [of(b, c), of(c, a), of(a, b)], area: 0.5 * twice }
    }

    /// Columns of the deformation gradient.
    fn deformation(&self, x: &[Point]) -> [Vec3; 2] {
        let mut f = [Vec3::zeros(); 2];
        for (n, g) in self.nodes.iter().zip(self.gradient) {
            let x = at(x, *n);
            (0..2).for_each(|i| f[i] += x * g[i]);
        }
        f
    }

    /// Principal stretches, the larger one first, and the direction of the larger one in the flat shape.
    pub fn stretches(&self, x: &[Point]) -> ([f64; 2], Flat) {
        principal(self.deformation(x))
    }
}

/// Singular values of a matrix of two columns, the larger one first, with its right vector.
fn principal(f: [Vec3; 2]) -> ([f64; 2], Flat) {
    let (a, b, c) = (f[0].dot(&f[0]), f[1].dot(&f[1]), f[0].dot(&f[1]));
    let (mean, half) = (0.5 * (a + b), 0.5 * (a - b));
    let radius = half.hypot(c);
    let angle = 0.5 * c.atan2(half);
    let large = mean + radius;
    // The product of both is the squared area ratio: no difference of two close numbers.
    let small = f[0].cross(&f[1]).norm_squared() / large.max(f64::MIN_POSITIVE);
    ([large.sqrt(), small.max(0.0).sqrt()], [angle.cos(), angle.sin()])
}

/// Difference of a deformation gradient from the nearest one whose singular values are at most `most`.
fn excess(f: [Vec3; 2], most: f64) -> Option<[Vec3; 2]> {
    let (stretches, [cos, sin]) = principal(f);
    if stretches[0] <= most {
        return None;
    }
    let mut out = [Vec3::zeros(); 2];
    for (s, v) in stretches.into_iter().zip([[cos, sin], [-sin, cos]]).filter(|(s, _)| *s > most) {
        // Left vector times singular value is F v.
        let left = (f[0] * v[0] + f[1] * v[1]) * ((s - most) / s);
        (0..2).for_each(|i| out[i] += left * v[i]);
    }
    Some(out)
}

/// The relaxed positions, the iterations, and the largest stretch with the piece that has it.
pub(super) struct Relaxed {
    pub coords: Vec<Point>,
    pub iterations: usize,
    pub stretch: f64,
    pub piece: usize,
}

/// Moves `coords` (m) until no piece is stretched.
pub(super) fn relax(pieces: &[Piece], coords: Vec<Point>) -> Relaxed {
    let mut inverse = vec![0.0; coords.len()];
    for p in pieces {
        for (n, g) in p.nodes.iter().zip(p.gradient) {
            // Three nodes share a piece: the Hessian is at most three times its diagonal.
            inverse[*n as usize] += 3.0 * p.area * (g[0] * g[0] + g[1] * g[1]);
        }
    }
    inverse.iter_mut().for_each(|d| *d = 1.0 / d.max(f64::MIN_POSITIVE));
    let mut x = coords;
    let (mut y, mut weight, mut before) = (x.clone(), 1.0_f64, f64::INFINITY);
    let mut gradient = vec![Vec3::zeros(); x.len()];
    for iteration in 0..MOST_ITERATIONS {
        let (stretch, piece) = worst(pieces, &x);
        if stretch <= 1.0 + ROUNDOFF {
            return Relaxed { coords: x, iterations: iteration, stretch, piece };
        }
        let energy = gradient_of(pieces, &y, &mut gradient);
        if energy > before {
            // Momentum that leads upwards is dropped.
            (y, weight, before) = (x.clone(), 1.0, f64::INFINITY);
            continue;
        }
        before = energy;
        let next: Vec<Point> = y
            .iter()
            .zip(&gradient)
            .zip(&inverse)
            .map(|((y, g), d)| (Vec3::from(*y) - g * *d).into())
            .collect();
        let heavier = 0.5 * (1.0 + (1.0 + 4.0 * weight * weight).sqrt());
        let share = (weight - 1.0) / heavier;
        y = next.iter().zip(&x).map(|(b, a)| std::array::from_fn(|i| b[i] + share * (b[i] - a[i]))).collect();
        (x, weight) = (next, heavier);
    }
    let (stretch, piece) = worst(pieces, &x);
    Relaxed { coords: x, iterations: MOST_ITERATIONS, stretch, piece }
}

/// Largest principal stretch and its piece.
fn worst(pieces: &[Piece], x: &[Point]) -> (f64, usize) {
    let all = pieces.iter().enumerate().map(|(k, p)| (p.stretches(x).0[0], k));
    all.fold((0.0, 0), |most, next| if next.0 > most.0 { next } else { most })
}

/// The energy of stretch at `x` (m3 for a unit stiffness), and its gradient.
fn gradient_of(pieces: &[Piece], x: &[Point], gradient: &mut [Vec3]) -> f64 {
    gradient.fill(Vec3::zeros());
    let mut energy = 0.0;
    for p in pieces {
        let Some(e) = excess(p.deformation(x), 1.0 - MARGIN) else { continue };
        energy += 0.5 * p.area * (e[0].norm_squared() + e[1].norm_squared());
        for (n, g) in p.nodes.iter().zip(p.gradient) {
            gradient[*n as usize] += (e[0] * g[0] + e[1] * g[1]) * p.area;
        }
    }
    energy
}

/// Where a panel starts, checked.
pub(super) enum Placement {
    /// In a plane: origin and axes.
    Plane([Vec3; 3]),
    /// Around the z axis: points of the meridian (m) and the length along it at each.
    Meridian(Vec<Flat>, Vec<f64>),
}

impl Placement {
    pub fn new(panel: &str, start: &PanelStart) -> Result<Self, PatternError> {
        let wrong = |reason: &str| {
            Err(PatternError::Panel { panel: panel.into(), reason: format!("start: {reason}") })
        };
        if !start.turn_deg.is_finite() {
            return wrong("turn_deg must be an angle in degrees");
        }
        match (&start.meridian_m, start.origin_m, start.x_axis, start.y_axis) {
            (Some(meridian), None, None, None) => Self::meridian(panel, meridian),
            (None, Some(origin), Some(x), Some(y)) => {
                let [origin, x, y] = [origin, x, y].map(Vec3::from);
                let size = x.norm() * y.norm();
                if !(size.is_finite() && size > 0.0 && origin.norm().is_finite()) {
                    return wrong("origin_m, x_axis and y_axis must be finite, and the axes have a length");
                }
                if x.dot(&y).abs() > 1e-3 * size {
                    return wrong("x_axis and y_axis must be normal to each other");
                }
                Ok(Self::Plane([origin, x / x.norm(), y / y.norm()]))
            }
            _ => wrong("give either meridian_m, or origin_m, x_axis and y_axis"),
        }
    }

    fn meridian(panel: &str, points: &[Flat]) -> Result<Self, PatternError> {
        let wrong = |reason: &str| {
            Err(PatternError::Panel { panel: panel.into(), reason: format!("start.meridian_m: {reason}") })
        };
        let sane = |p: &Flat| p.iter().all(|x| x.is_finite()) && p[0] >= 0.0;
        if points.len() < 2 || !points.iter().all(sane) {
            return wrong(
                "give at least two points [distance from the axis, height] in m, with distances of 0 and more",
            );
        }
        let steps: Vec<f64> =
            points.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).collect();
        if steps.iter().any(|l| *l <= 0.0) {
            return wrong("two neighbouring points are in one place; remove one");
        }
        // Normals that point inwards on the whole belong to a meridian that runs downwards. Heights count from far below.
        let low = points.iter().map(|p| p[1] - p[0]).fold(f64::INFINITY, f64::min);
        let out = |p: &[Flat]| {
            let [a, b] = [p[0], p[1]];
            0.5 * (a[0] + b[0]) * (b[1] - a[1]) - (0.5 * (a[1] + b[1]) - low) * (b[0] - a[0])
        };
        if points.windows(2).map(out).sum::<f64>() <= 0.0 {
            return wrong(
                "it runs from the crown down; list its points from below to the crown, and draw y upwards",
            );
        }
        let mut lengths = vec![0.0];
        for step in steps {
            lengths.push(lengths[lengths.len() - 1] + step);
        }
        Ok(Self::Meridian(points.to_vec(), lengths))
    }

    /// Position (m) of a point of the drawing (m, as seen from outside, whose x is `mirror` times that of the drawing), turned by `turn` (rad).
    pub fn position(&self, x: Flat, mirror: f64, turn: f64) -> Point {
        match self {
            Self::Plane([origin, e1, e2]) => {
                let p = origin + e1 * (mirror * x[0]) + e2 * x[1];
                let (sin, cos) = turn.sin_cos();
                [cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z]
            }
            Self::Meridian(points, lengths) => {
                let last = points.len() - 2;
                let k = lengths.partition_point(|l| *l <= x[1]).saturating_sub(1).min(last);
                let t = (x[1] - lengths[k]) / (lengths[k + 1] - lengths[k]);
                let [r, z] = [0, 1].map(|i| points[k][i] + t * (points[k + 1][i] - points[k][i]));
                let r = r.max(0.0);
                // On the axis every angle is the same place.
                let angle =
                    if r > 1e-9 * lengths[last + 1] { (x[0] / r).clamp(-0.5 * TAU, 0.5 * TAU) } else { 0.0 };
                let (sin, cos) = (turn + angle).sin_cos();
                [r * cos, r * sin, z]
            }
        }
    }
}

/// Turn of a copy, rad.
pub(super) fn turn(start: &PanelStart, copy: usize, copies: u32) -> f64 {
    start.turn_deg.to_radians() + TAU * copy as f64 / f64::from(copies)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The gradient is the derivative of the energy, which no position on a line between two exceeds its chord of: it is convex.
    #[test]
    fn gradient_is_the_derivative_of_a_convex_energy() {
        let pieces = [
            Piece::new([0, 1, 2], [[0.0, 0.0], [1.0, 0.1], [0.2, 0.9]]),
            Piece::new([1, 3, 2], [[0.0, 0.0], [0.8, 0.0], [0.3, 0.7]]),
        ];
        let x: Vec<Point> = vec![[0.0; 3], [1.3, 0.0, 0.2], [0.1, 1.2, -0.3], [1.1, 1.0, 0.9]];
        let wave = |i: usize| (1.3 * i as f64).sin();
        let moved = |s: f64| -> Vec<Point> {
            x.iter().enumerate().map(|(n, x)| std::array::from_fn(|c| x[c] + s * wave(3 * n + c))).collect()
        };
        let mut gradient = vec![Vec3::zeros(); 4];
        let mut unused = gradient.clone();
        let mut energy = |s: f64| gradient_of(&pieces, &moved(s), &mut unused);
        let h = 1e-5;
        let difference = (energy(h) - energy(-h)) / (2.0 * h);
        let middle = energy(0.0);
        let chord = 0.5 * (energy(1.0) + energy(-1.0));
        gradient_of(&pieces, &x, &mut gradient);
        let slope: f64 = (0..12).map(|i| gradient[i / 3][i % 3] * wave(i)).sum();
        assert!(middle > 0.0 && (slope / difference - 1.0).abs() < 1e-8, "{slope} {difference}");
        assert!(middle <= chord, "{middle} {chord}");
    }
}
