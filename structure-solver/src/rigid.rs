//! A rigid body in time: kicks by forces, drifts without them.
//!
//! A step is half a kick, a drift, half a kick (velocity Verlet). The drift turns the body
//! exactly about one principal axis after the other, symmetrically (Dullweber, Leimkuhler and
//! McLachlan, J. Chem. Phys. 107, 1997, 5840): second order, time-reversible, symplectic. It
//! keeps the angular momentum to rounding, and the energy within the square of the step
//! without drift.

use serde::{Deserialize, Serialize};

use mesh::geometry::Vec3;

/// Mass and inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBody {
    /// Mass, kg.
    pub mass: f64,
    /// Principal moments of inertia, kg m2.
    pub inertia: Vec3,
}

/// Vectors in files are three numbers.
mod point {
    use mesh::geometry::Vec3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(v: &Vec3, to: S) -> Result<S::Ok, S::Error> {
        <[f64; 3]>::from(*v).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec3, D::Error> {
        <[f64; 3]>::deserialize(from).map(Vec3::from)
    }
}

/// Where a body is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyState {
    /// Displacement of the centre of mass from its start, m.
    #[serde(with = "point")]
    pub x: Vec3,
    /// Velocity, m/s.
    #[serde(with = "point")]
    pub v: Vec3,
    /// Turn from the body's axes to those of the frame, a unit quaternion (scalar first).
    pub q: [f64; 4],
    /// Angular momentum in the body's axes, kg m2/s.
    #[serde(with = "point")]
    pub spin: Vec3,
    /// Force (N) and torque (N m) in the frame's axes at this state.
    #[serde(with = "point")]
    pub force: Vec3,
    /// Torque about the centre of mass, N m.
    #[serde(with = "point")]
    pub torque: Vec3,
    /// Force and torque are known.
    pub known: bool,
}

impl BodyState {
    /// Not turned, not displaced.
    pub fn start(body: &RigidBody, velocity: Vec3, spin_rate: Vec3) -> Self {
        Self {
            x: Vec3::zeros(),
            v: velocity,
            q: [1.0, 0.0, 0.0, 0.0],
            spin: body.inertia.component_mul(&spin_rate),
            force: Vec3::zeros(),
            torque: Vec3::zeros(),
            known: false,
        }
    }

    /// Turned by a rotation vector (axis times angle, rad).
    pub fn turned_by(self, rotation: Vec3) -> Self {
        let angle = rotation.norm();
        // sin(a/2)/a, also where the angle vanishes.
        let share = if angle > 0.0 { (0.5 * angle).sin() / angle } else { 0.5 };
        let v = rotation * share;
        Self { q: [(0.5 * angle).cos(), v[0], v[1], v[2]], ..self }
    }

    /// A vector of the body's axes in the frame's.
    #[inline]
    pub fn turn(&self, a: Vec3) -> Vec3 {
        let [w, x, y, z] = self.q;
        let u = Vec3::new(x, y, z);
        let t = u.cross(&a) * 2.0;
        a + t * w + u.cross(&t)
    }

    /// A vector of the frame's axes in the body's.
    #[inline]
    pub fn turn_back(&self, a: Vec3) -> Vec3 {
        let [w, x, y, z] = self.q;
        Self { q: [w, -x, -y, -z], ..*self }.turn(a)
    }

    /// Angle between the body's third axis and the vertical, rad.
    pub fn tilt(&self) -> f64 {
        self.turn(Vec3::z())[2].clamp(-1.0, 1.0).acos()
    }
}

impl RigidBody {
    /// Angular velocity in the body's axes, rad/s.
    pub fn rate(&self, s: &BodyState) -> Vec3 {
        s.spin.component_div(&self.inertia)
    }

    /// Velocity of a point of the body at `arm` (m, in its axes) from the centre of mass, m/s.
    pub fn velocity_of(&self, s: &BodyState, arm: Vec3) -> Vec3 {
        s.v + s.turn(self.rate(s).cross(&arm))
    }

    /// Kinetic energy, J.
    pub fn kinetic(&self, s: &BodyState) -> f64 {
        0.5 * self.mass * s.v.dot(&s.v) + 0.5 * s.spin.dot(&self.rate(s))
    }

    /// Velocities after `h` seconds of the state's force, torque and the acceleration of free
    /// fall `gravity` (m/s2).
    pub fn kick(&self, s: &mut BodyState, gravity: Vec3, h: f64) {
        s.v += (gravity + s.force * (1.0 / self.mass)) * h;
        s.spin += s.turn_back(s.torque) * h;
    }

    /// Configuration after `h` seconds without force.
    pub fn drift(&self, s: &mut BodyState, h: f64) {
        s.x += s.v * h;
        for (axis, share) in [(0, 0.5), (1, 0.5), (2, 1.0), (1, 0.5), (0, 0.5)] {
            self.spin_about(s, axis, share * h);
        }
        let size = s.q.iter().map(|q| q * q).sum::<f64>().sqrt();
        s.q.iter_mut().for_each(|q| *q /= size);
    }

    /// Exact motion of the part of the kinetic energy about one axis.
    fn spin_about(&self, s: &mut BodyState, axis: usize, h: f64) {
        let angle = h * s.spin[axis] / self.inertia[axis];
        let (sin, cos) = angle.sin_cos();
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        // The momentum stays in space: in the body it turns back.
        let (a, b) = (s.spin[j], s.spin[k]);
        s.spin[j] = cos * a + sin * b;
        s.spin[k] = cos * b - sin * a;
        let (sin, cos) = (0.5 * angle).sin_cos();
        let [w, x, y, z] = s.q;
        let mut own = Vec3::zeros();
        own[axis] = sin;
        let v = Vec3::new(x, y, z);
        let turned = v * cos + own * w + v.cross(&own);
        s.q = [w * cos - v.dot(&own), turned[0], turned[1], turned[2]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn by 0.5 rad about (2, 1, 2)/3 by Rodrigues' formula, one by a right angle, and none.
    #[test]
    fn a_rotation_vector_turns_about_its_axis() {
        let body = RigidBody { mass: 1.0, inertia: Vec3::repeat(1.0) };
        let start = BodyState::start(&body, Vec3::zeros(), Vec3::zeros());
        let (axis, a) = (Vec3::new(2.0, 1.0, 2.0) / 3.0, Vec3::new(0.3, -0.7, 0.2));
        let (sin, cos) = 0.5f64.sin_cos();
        let exact = a * cos + axis.cross(&a) * sin + axis * (axis.dot(&a) * (1.0 - cos));
        assert!((start.turned_by(axis * 0.5).turn(a) - exact).norm() < 1e-15);
        let quarter = start.turned_by(Vec3::z() * std::f64::consts::FRAC_PI_2);
        assert!((quarter.turn(Vec3::x()) - Vec3::y()).norm() < 1e-15);
        assert_eq!(start.turned_by(Vec3::zeros()), start);
    }

    /// A top without torque, spun about its middle axis, which is unstable: it tumbles.
    #[test]
    fn a_free_top_keeps_momentum_and_energy() {
        let body = RigidBody { mass: 2.0, inertia: Vec3::new(1.0, 2.0, 3.0) };
        let run = |h: f64, steps: usize| {
            let mut s = BodyState::start(&body, Vec3::new(0.3, 0.0, -0.1), Vec3::new(0.02, 2.0, 0.01));
            let (spin, energy) = (s.turn(s.spin), body.kinetic(&s));
            let (mut lost, mut turned) = (0.0f64, 0.0f64);
            for _ in 0..steps {
                body.kick(&mut s, Vec3::zeros(), 0.5 * h);
                body.drift(&mut s, h);
                body.kick(&mut s, Vec3::zeros(), 0.5 * h);
                assert!((s.turn(s.spin) - spin).norm() < 1e-11 * spin.norm());
                lost = lost.max((body.kinetic(&s) / energy - 1.0).abs());
                turned = turned.max(s.tilt());
            }
            assert!(turned > 3.0, "it tumbles: {turned}");
            (lost, s)
        };
        let (a, (b, last)) = (run(0.02, 10_000).0, run(0.01, 20_000));
        println!("energy of the free top: within {a:.2e} at h = 0.02 s, {b:.2e} at 0.01 s");
        assert!(a < 2e-3 && (a / b - 4.0).abs() < 0.4, "{a} {b}: the square of the step, no drift");
        assert!((last.x[0] - 0.3 * 200.0).abs() < 1e-9);
    }

    /// A symmetric top precesses at L / I_1.
    #[test]
    fn a_symmetric_top_precesses() {
        let body = RigidBody { mass: 1.0, inertia: Vec3::new(2.0, 2.0, 1.0) };
        let mut s = BodyState::start(&body, Vec3::zeros(), Vec3::new(0.5, 0.0, 4.0));
        let momentum = s.turn(s.spin);
        let h = 1e-3;
        let period = 2.0 * std::f64::consts::PI * 2.0 / momentum.norm();
        let steps = (period / h).round() as usize;
        let axis = s.turn(Vec3::new(0.0, 0.0, 1.0));
        for _ in 0..steps {
            body.drift(&mut s, period / steps as f64);
        }
        // The figure axis is back after one turn about the momentum.
        assert!(
            (s.turn(Vec3::new(0.0, 0.0, 1.0)) - axis).norm() < 1e-5,
            "{:?}",
            s.turn(Vec3::new(0.0, 0.0, 1.0))
        );
    }

    /// A compound pendulum: the body held at a pivot by a stiff spring is that of the
    /// structure's tests; here the torque of gravity about the pivot acts on the body alone.
    #[test]
    fn a_rigid_pendulum_has_its_frequency() {
        // About the pivot: inertia 5, m g d = 3, small swings.
        let body = RigidBody { mass: 1.0, inertia: Vec3::new(5.0, 6.0, 4.0) };
        let moment = 3.0;
        let mut s = BodyState::start(&body, Vec3::zeros(), Vec3::new(1e-3, 0.0, 0.0));
        let h = 1e-2;
        let torque = |s: &BodyState| {
            // Weight hangs below: the torque turns the third axis back up.
            let up = s.turn(Vec3::new(0.0, 0.0, 1.0));
            up.cross(&Vec3::z()) * moment
        };
        s.torque = torque(&s);
        let (mut crossings, mut last, mut t) = (Vec::new(), s.spin[0], 0.0);
        while crossings.len() < 21 {
            body.kick(&mut s, Vec3::zeros(), 0.5 * h);
            body.drift(&mut s, h);
            s.torque = torque(&s);
            body.kick(&mut s, Vec3::zeros(), 0.5 * h);
            t += h;
            if s.spin[0] * last < 0.0 {
                crossings.push(t - h * s.spin[0] / (s.spin[0] - last));
            }
            last = s.spin[0];
        }
        let half = (crossings[20] - crossings[0]) / 20.0;
        let exact = std::f64::consts::PI * (5.0f64 / 3.0).sqrt();
        // Verlet runs (w h)^2 / 24 fast: 2.5e-6.
        assert!((half / exact - 1.0).abs() < 5e-6, "{half} {exact}");
    }
}
