//! Momentum and energy of the whole falling system: payload, fabric and lines, relative to the ground.
//!
//! With $`m`$, $`\mathbf v`$, $`h`$ mass, velocity and height of the frame, $`\mathbf p`$ the momentum of fabric and lines
//! relative to it, $`K`$ their kinetic energy in it and $`U`$ their strain energy,
//!
//! ```math
//! \mathbf P = m \mathbf v + \mathbf p, \qquad
//! E = \tfrac12 m v^2 + \mathbf v \cdot \mathbf p + K + U + m g h + g\!\int\! p_z\,dt .
//! ```
//!
//! In a window the air changes $`\mathbf P`$ by $`(\bar{\mathbf F} + \mathbf D + m \mathbf g)\,T`$, and $`E`$ by its work
//! on the fabric in the frame, by its work on the frame, $`\bar{\mathbf v} \cdot \bar{\mathbf F} T`$, and by the work of
//! the payload's drag. Where the structure's equations exclude weight and inertia of the frame for fabric and lines, they
//! also exclude the work $`(\mathbf g - \dot{\mathbf v}) \cdot \mathbf p`$; it is added here. What holds a payload
//! sideways, in a frame that moves vertically, does no work.
//!
//! The structure reports $`\mathbf p`$ and the mean force on the payload ([`crate::descent`]). The impulse of the air that
//! these imply, $`\bar{\mathbf S} T + \Delta \mathbf p`$, is compared with the impulse of the flow's load in the axes in
//! which the frame moves: the difference grows if the structure reports a wrong force. The residual of the energy balance is the energy that the structure's time
//! integration, its damping and the coupling add or remove.

use serde::{Deserialize, Serialize};

use crate::descent::{DescentModel, Weight};
use crate::geometry::Vec3;

/// Largest accepted difference between the impulse that the structure reports and that of the air, relative to the
/// latter: both are means of one load over a window, once from its ends, once along the structure's steps.
pub const IMPULSE_SHARE: f64 = 0.05;
/// Share of the impulse of the weight below which a difference is no warning: the air on a gathered canopy in free fall has almost no impulse.
const WEIGHT_SHARE: f64 = 0.01;
/// Windows before impulses are compared.
const MIN_WINDOWS: u64 = 20;

/// Terms of one window.
#[derive(Clone, Copy, Debug, Default)]
pub struct WindowTerms {
    /// Length, s.
    pub dt: f64,
    /// Velocity of the frame at start and end, m/s.
    pub velocity: [Vec3; 2],
    /// Force of the air on canopy and lines at start and end, N.
    pub air: [Vec3; 2],
    /// Mean drag of a payload that is a point over the window, N.
    pub drag: Vec3,
    /// Mean force of the system on the frame ($`\bar{\mathbf S}`$), N.
    pub support: Vec3,
    /// Momentum of fabric and lines in the frame at the end, N s.
    pub momentum: Vec3,
    /// Work of the air on the canopy in the frame, J.
    pub work: f64,
    /// Work of prescribed motions in the frame, J.
    pub prescribed_work: f64,
    /// Kinetic and strain energy of the structure at the end, J.
    pub energy: [f64; 2],
}

/// Sums over a stage. Energies are relative to the end of its first window, where they are known first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SystemBalance {
    windows: u64,
    /// Height of the frame, m.
    height_m: f64,
    /// Momentum of fabric and lines in the frame, N s, and the integral of its vertical part over time, kg m.
    momentum: [f64; 3],
    moment: f64,
    /// Impulse of the air that the structure's report does not account for, in the axes in which the frame moves, N s.
    missing: [f64; 3],
    /// Sum of the absolute impulses of the air in these axes, N s.
    pub impulse: f64,
    /// Impulse of the weight so far, N s.
    weight_impulse: f64,
    /// Energy at the start, and the work since of what is not air, J.
    supplied_j: f64,
    /// Energy now, J.
    pub energy_j: f64,
    /// Work of the air, J.
    pub air_work_j: f64,
    /// Sum of the absolute works of the air, J.
    pub exchanged_j: f64,
    reported: bool,
}

impl SystemBalance {
    /// Adds a window of the system of `model`.
    pub fn add_window(&mut self, model: &DescentModel, w: &WindowTerms) {
        let [v0, v1] = w.velocity;
        let (mean, g) = (0.5 * (v0 + v1), model.gravity_m_s2);
        let (air, before) = (0.5 * (w.air[0] + w.air[1]), Vec3::from(self.momentum));
        let missing = (air - w.support) * w.dt - (w.momentum - before);
        let axes = model.axes.range();
        axes.clone().for_each(|i| self.missing[i] += missing[i]);
        self.impulse += air.as_slice()[axes].iter().map(|f| f * f).sum::<f64>().sqrt() * w.dt;
        self.weight_impulse += model.mass_kg * g * w.dt;
        let p = 0.5 * (before + w.momentum);
        self.momentum = w.momentum.into();
        if self.windows > 0 {
            self.height_m += mean[2] * w.dt;
            self.moment += p[2] * w.dt;
            let mut work = w.work + mean.dot(&(air + w.drag)) * w.dt;
            if model.weight == Weight::Frame {
                work += p.dot(&(Vec3::new(0.0, 0.0, g * w.dt) + v1 - v0));
            }
            self.air_work_j += work;
            self.supplied_j += w.prescribed_work;
            self.exchanged_j += w.work.abs() + (mean.dot(&air) * w.dt).abs();
        }
        let (m, [kinetic, strain]) = (model.mass_kg, w.energy);
        let moving = 0.5 * m * v1.norm_squared() + v1.dot(&w.momentum) + kinetic;
        self.energy_j = moving + strain + g * (m * self.height_m + self.moment);
        if self.windows == 0 {
            self.supplied_j = self.energy_j;
        }
        self.windows += 1;
    }

    /// Size of the impulse of the air that the structure's report does not account for, N s.
    pub fn missing_impulse(&self) -> f64 {
        Vec3::from(self.missing).norm()
    }

    /// Energy created (positive) or dissipated (negative) so far, J.
    pub fn created_j(&self) -> f64 {
        if self.windows == 0 { 0.0 } else { self.energy_j - self.supplied_j - self.air_work_j }
    }

    /// [`SystemBalance::created_j`] relative to the work exchanged; zero before any work.
    pub fn share(&self) -> f64 {
        if self.exchanged_j > 0.0 { self.created_j() / self.exchanged_j } else { 0.0 }
    }

    /// A warning, once, when the reported and the applied impulse differ by more than [`IMPULSE_SHARE`] and by more than 1 % of the impulse of the weight.
    pub fn warning(&mut self) -> Option<String> {
        let bound = (IMPULSE_SHARE * self.impulse).max(WEIGHT_SHARE * self.weight_impulse);
        let missing = self.missing_impulse();
        let off = missing > bound;
        if self.reported || self.windows < MIN_WINDOWS || !off {
            return None;
        }
        self.reported = true;
        Some(format!(
            "the reported force on the payload and momentum of the structure do not account for {:.3e} N s of the air's impulse \
             of {:.3e} N s ({:.0} %, limit {:.0} %), so the descent follows a force that is inconsistent with the load. Check \
             SUPPORT_FORCE and MOMENTUM of the structure (ripstop replay --structure), or use a shorter window_s if the \
             load varies much within a window",
            missing,
            self.impulse,
            100.0 * missing / self.impulse,
            100.0 * IMPULSE_SHARE
        ))
    }
}

#[cfg(test)]
mod tests {
    use case::DescentEquation;

    use super::*;
    use crate::frame_axes::FrameAxes;

    const GRAVITY: f64 = 9.80665;
    const PAYLOAD: f64 = 5.0;
    const FABRIC: f64 = 0.5;
    const DRAG: f64 = 3.0;
    const DT: f64 = 0.02;

    fn model(weight: Weight) -> DescentModel {
        DescentModel {
            mass_kg: PAYLOAD + FABRIC,
            payload_kg: PAYLOAD,
            equation: DescentEquation::Momentum,
            weight,
            axes: FrameAxes::All,
            gravity_m_s2: GRAVITY,
            reference_area_m2: 1.0,
            reference_speed_m_s: 4.0,
            air_density_kg_m3: 1.225,
            payload_drag: None,
            drag_in_structure: false,
            support_known: true,
        }
    }

    /// Payload and fabric with constant accelerations: -2 m/s2 of the frame from -6 m/s, 3 m/s2 of the fabric
    /// relative to it from 0.4 m/s, and the same times 0.5 and -0.25 sideways. The force of the air follows from the momentum
    /// of both, that of the line from the fabric's, and the strain energy is the work of the line. All are quadratic in time,
    /// so sums over windows are exact.
    fn exact(weight: Weight, windows: u32, support: f64) -> SystemBalance {
        let all = PAYLOAD + FABRIC;
        let [a, b] = [-2.0, 3.0].map(|z| Vec3::new(0.5, -0.25, 1.0) * z);
        let up = Vec3::new(0.0, 0.0, GRAVITY);
        let drag = Vec3::new(0.4, 0.0, DRAG);
        // Where fabric has no weight in the structure, its force on the line is that of the frame on the whole mass.
        let (line, air) = match weight {
            Weight::Frame => ((a + up) * all - drag, (a + up) * all - drag + b * FABRIC),
            _ => {
                let line = (a + up) * PAYLOAD - drag;
                (line, line + (a + b + up) * FABRIC)
            }
        };
        let start = Vec3::new(0.1, 0.2, 0.4);
        let slide = |t: f64| start * t + b * (0.5 * t * t);
        let mut balance = SystemBalance { momentum: (start * FABRIC).into(), ..SystemBalance::default() };
        for i in 0..windows {
            let (t0, t1) = (f64::from(i) * DT, f64::from(i + 1) * DT);
            let u = start + b * t1;
            let v = |t: f64| Vec3::new(1.0, 0.5, -6.0) + a * t;
            let terms = WindowTerms {
                dt: DT,
                velocity: [v(t0), v(t1)],
                air: [air; 2],
                drag,
                support: (air - b * FABRIC) * support,
                momentum: u * FABRIC,
                work: air.dot(&(slide(t1) - slide(t0))),
                prescribed_work: 0.0,
                energy: [0.5 * FABRIC * u.norm_squared(), line.dot(&slide(t1))],
            };
            balance.add_window(&model(weight), &terms);
        }
        balance
    }

    /// A structure that reports no force: a warning where the air carries 2 % of the weight, none where it carries 0.5 %.
    #[test]
    fn impulses_far_below_that_of_the_weight_are_no_warning() {
        let weight = (PAYLOAD + FABRIC) * GRAVITY;
        let warns = |share: f64| {
            let mut balance = SystemBalance::default();
            for _ in 0..30 {
                let air = [Vec3::new(0.0, 0.0, share * weight); 2];
                let terms = WindowTerms { dt: DT, air, ..WindowTerms::default() };
                balance.add_window(&model(Weight::Frame), &terms);
            }
            balance.warning().is_some()
        };
        assert!(warns(0.02) && !warns(0.005));
    }

    #[test]
    fn exact_motion_creates_no_energy_and_accounts_for_all_impulse() {
        for weight in [Weight::Frame, Weight::Structure] {
            let balance = exact(weight, 30, 1.0);
            let (created, work) = (balance.created_j(), balance.exchanged_j);
            assert!(work > 10.0 && created.abs() < 1e-12 * work, "{weight:?}: {created} of {work} J");
            let (missing, impulse) = (balance.missing_impulse(), balance.impulse);
            assert!(impulse > 10.0 && missing < 1e-12 * impulse, "{weight:?}: {missing} of {impulse} N s");
            // 29 windows in which the energy is known, at the mean velocities of frame and fabric over them.
            let side = Vec3::new(0.5, -0.25, 1.0);
            let (a, b, up) = (side * -2.0, side * 3.0, Vec3::new(0.0, 0.0, GRAVITY));
            let drag = Vec3::new(0.4, 0.0, DRAG);
            let own = if weight == Weight::Frame { b * FABRIC } else { (a + b + up) * FABRIC };
            let mass = if weight == Weight::Frame { PAYLOAD + FABRIC } else { PAYLOAD };
            let air = (a + up) * mass - drag + own;
            let frame = Vec3::new(1.0, 0.5, -6.0) + a * (15.5 * DT);
            let fabric = Vec3::new(0.1, 0.2, 0.4) + b * (15.5 * DT);
            let time = 29.0 * DT;
            let supplied = time * (air.dot(&(frame + fabric)) + drag.dot(&frame));
            let added = if weight == Weight::Frame { time * FABRIC * fabric.dot(&(up + a)) } else { 0.0 };
            assert!((balance.air_work_j / (supplied + added) - 1.0).abs() < 1e-12, "{weight:?}");
            assert!((impulse / (30.0 * DT * air.norm()) - 1.0).abs() < 1e-12, "{weight:?}");
        }
    }

    #[test]
    fn created_energy_is_relative_to_the_exchanged_work() {
        let mut balance = exact(Weight::Structure, 30, 1.0);
        balance.energy_j += 0.1 * balance.exchanged_j;
        assert!((balance.share() - 0.1).abs() < 1e-9, "{}", balance.share());
        assert_eq!(SystemBalance::default().share(), 0.0);
    }

    /// Energy that a winch in the frame adds is not created, from the second window on.
    #[test]
    fn work_of_prescribed_motions_is_not_created() {
        let mut balance = SystemBalance::default();
        let rest = model(Weight::Structure);
        for i in 0..5 {
            let energy = [0.0, 3.0 * f64::from(i)];
            let terms = WindowTerms { dt: DT, prescribed_work: 3.0, energy, ..WindowTerms::default() };
            balance.add_window(&rest, &terms);
        }
        assert_eq!((balance.energy_j, balance.created_j()), (12.0, 0.0));
    }

    #[test]
    fn missing_impulse_is_reported_once() {
        let off = |share: f64, windows: u32| exact(Weight::Frame, windows, share).warning();
        // 5.5 % of the support are 5.3 % of the air's impulse, 4.5 % are 4.3 %.
        let text = off(0.945, 20).expect("beyond the bound");
        assert!(text.contains("(5 %, limit 5 %)"), "{text}");
        assert!(off(0.955, 40).is_none() && off(0.945, 19).is_none() && off(1.06, 20).is_some());
        let mut balance = exact(Weight::Frame, 20, 0.9);
        assert!(balance.warning().is_some() && balance.warning().is_none());
    }

    /// A force that is missing in an axis in which the frame does not move is no fault.
    #[test]
    fn impulse_in_axes_of_a_guide_is_not_compared() {
        let held = DescentModel { axes: FrameAxes::Vertical, ..model(Weight::Structure) };
        let mut balance = SystemBalance::default();
        let air = [Vec3::new(50.0, 0.0, 20.0); 2];
        let terms = WindowTerms { dt: DT, air, support: Vec3::new(0.0, 0.0, 20.0), ..WindowTerms::default() };
        balance.add_window(&held, &terms);
        assert_eq!((balance.missing_impulse(), balance.impulse), (0.0, 20.0 * DT));
        balance.add_window(&model(Weight::Structure), &terms);
        assert!((balance.missing_impulse() - 50.0 * DT).abs() < 1e-12);
    }

    /// The mean of a load over a window is that of its ends.
    #[test]
    fn impulse_of_a_linear_load_is_exact() {
        let mut balance = SystemBalance::default();
        let [low, mean, high] = [10.0, 20.0, 30.0].map(|z| Vec3::new(0.0, 0.0, z));
        let terms = WindowTerms { dt: DT, air: [low, high], support: mean, ..WindowTerms::default() };
        balance.add_window(&model(Weight::Structure), &terms);
        assert!(balance.missing_impulse() < 1e-15 && (balance.impulse - 20.0 * DT).abs() < 1e-15);
    }
}
