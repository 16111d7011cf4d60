//! The rigid part of the canopy's motion, which the whole grid follows.
//!
//! Linear elasticity is not invariant under rotation: a canopy that swings by 35 degrees about its payload flattens the cells around it (scaled
//! Jacobian 0.02 instead of 0.4), although its shape changes little. So the grid turns and shifts with the canopy, its outer boundary
//! included, and the pseudo-solid follows the rest of the motion, in the frame that turns with the canopy.
//!
//! The rotation is that of least squares between two shapes (Kabsch, Acta Cryst. A32, 1976). Up to [`STILL`] the frame does not turn, beyond it by
//! the excess, continuously: most canopies never get there, and far cells move less.

use mesh::Point;
use nalgebra::{Matrix3, Rotation3, SVD, Vector3};

/// Rotation of the canopy up to which the frame does not turn, rad.
pub const STILL: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// A rotation and a translation: $`x = R (x' - c') + c`$ with the place $`x'`$ in the frame that turns with the canopy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidMotion {
    /// `None`: at rest.
    turned: Option<Turned>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Turned {
    rotation: Matrix3<f64>,
    /// Centre of rotation in the turned frame, and where it is now, m.
    from: Vector3<f64>,
    to: Vector3<f64>,
}

impl RigidMotion {
    /// The frame at rest.
    pub const REST: Self = Self { turned: None };

    /// Of the canopy at `now` (flat, m) with the shape `start` in the frame at rest.
    pub fn of(start: &[f64], now: &[f64]) -> Self {
        let (start, now) = (start.as_chunks::<3>().0, now.as_chunks::<3>().0);
        let mean = |points: &[Point]| {
            points.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / points.len().max(1) as f64
        };
        let (from, to) = (mean(start), mean(now));
        let pairs = start.iter().zip(now).map(|(a, b)| (Vector3::from(*a) - from, Vector3::from(*b) - to));
        let moment: Matrix3<f64> = pairs.map(|(a, b)| b * a.transpose()).sum();
        let svd = SVD::new(moment, true, true);
        let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Self::REST };
        // The smallest singular value changes its sign, so that the result is no reflection.
        let mut sign = Matrix3::identity();
        sign[(2, 2)] = (u * v).determinant().signum();
        let rotation = Rotation3::from_matrix_unchecked(u * sign * v);
        let Some((axis, angle)) = rotation.axis_angle().filter(|(_, angle)| *angle > STILL) else {
            return Self::REST;
        };
        let share = 1.0 - STILL / angle;
        let rotation = Rotation3::from_axis_angle(&axis, share * angle).into_inner();
        Self { turned: Some(Turned { rotation, from, to: from + (to - from) * share }) }
    }

    /// Whether the frame is at rest.
    pub fn is_rest(&self) -> bool {
        self.turned.is_none()
    }

    /// Where the point `x` of the turned frame is, m.
    #[inline]
    pub fn place(&self, x: &Point) -> Point {
        match &self.turned {
            None => *x,
            Some(t) => (t.rotation * (Vector3::from(*x) - t.from) + t.to).into(),
        }
    }

    /// The point of the turned frame that is at `x`, m.
    #[inline]
    pub fn point_at(&self, x: &Point) -> Point {
        match &self.turned {
            None => *x,
            Some(t) => (t.rotation.tr_mul(&(Vector3::from(*x) - t.to)) + t.from).into(),
        }
    }

    /// [`Self::point_at`] of all points `x`, flat, in place.
    pub fn to_turned_frame(&self, x: &mut [f64]) {
        if !self.is_rest() {
            x.as_chunks_mut::<3>().0.iter_mut().for_each(|x| *x = self.point_at(x));
        }
    }

    /// [`Self::place`] of all points `x`, flat, in place.
    pub fn to_places(&self, x: &mut [f64]) {
        if !self.is_rest() {
            x.as_chunks_mut::<3>().0.iter_mut().for_each(|x| *x = self.place(x));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canopy() -> Vec<f64> {
        (0..50)
            .flat_map(|k| {
                let t = f64::from(k);
                [3.0 * (0.7 * t).cos(), 2.5 * (1.3 * t).sin(), 10.0 + (0.31 * t).cos()]
            })
            .collect()
    }

    fn turned(points: &[f64], angle: f64) -> (Vec<f64>, Rotation3<f64>) {
        let rotation =
            Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(Vector3::new(1.0, 2.0, 0.3)), angle);
        let shift = Vector3::new(4.0, -2.0, 1.0);
        let moved = points
            .as_chunks::<3>()
            .0
            .iter()
            .flat_map(|x| <[f64; 3]>::from(rotation * Vector3::from(*x) + shift));
        (moved.collect(), rotation)
    }

    #[test]
    fn rotation_is_that_of_the_canopy_less_the_angle_at_rest() {
        let start = canopy();
        for degrees in [6.0f64, 35.0, 120.0] {
            let (now, _) = turned(&start, degrees.to_radians());
            let motion = RigidMotion::of(&start, &now);
            let found = motion.turned.expect("it turns").rotation;
            let angle = Rotation3::from_matrix_unchecked(found).angle();
            assert!((angle - (degrees.to_radians() - STILL)).abs() < 1e-12, "{degrees}: {angle}");
            // What is left is a rotation by the angle at rest about the centre, and its share of the shift.
            let mut back = now.clone();
            motion.to_turned_frame(&mut back);
            let (rest, _) = (RigidMotion::of(&start, &back), ());
            assert!(rest.is_rest() || rest.turned.expect("turned").rotation.trace() > 3.0 - 1e-12);
            motion.to_places(&mut back);
            let error = back.iter().zip(&now).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-13, "{error:e}");
        }
    }

    #[test]
    fn frame_is_at_rest_for_small_rotations_and_continuous() {
        let start = canopy();
        let (now, _) = turned(&start, 0.99 * STILL);
        assert!(RigidMotion::of(&start, &now).is_rest());
        let (now, _) = turned(&start, STILL + 1e-9);
        let motion = RigidMotion::of(&start, &now);
        let point = [30.0, -20.0, 5.0];
        let moved = (Vector3::from(motion.place(&point)) - Vector3::from(point)).norm();
        assert!(moved < 1e-6, "{moved:e}");
        // A mirror image is no rotation.
        let mirrored: Vec<f64> =
            start.iter().enumerate().map(|(i, x)| if i % 3 == 0 { -x } else { *x }).collect();
        let motion = RigidMotion::of(&start, &mirrored);
        assert!(motion.turned.is_none_or(|t| (t.rotation.determinant() - 1.0).abs() < 1e-12));
    }
}
