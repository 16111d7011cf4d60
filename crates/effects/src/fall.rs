//! A quasi-steady fall of one degree of freedom: how the answer of a scene responds to a change.
//!
//! The canopy is a drag area $`A`$, the air that moves with it an added mass $`m_a`$, and all that falls a
//! mass $`m`$. With the descent speed $`v`$, the vertical wind $`w_z`$ and the speed of the air past the canopy
//! $`u = v + w_z`$ (with the wind across it $`|w| = \sqrt{u^2 + w_x^2 + w_y^2}`$)
//!
//! ```math
//! (m + m_a)\, \dot u = m g - \tfrac12 \rho A |w| u + m\, \dot w_z .
//! ```
//!
//! At a fixed speed a change of the drag area changes the drag in proportion. In a steady descent the drag
//! stays the weight and the speed changes with $`A^{-1/2}`$ (Knacke, Parachute Recovery Systems Design Manual,
//! 1992, section 4.2). A scene lies between: its mean over the second half of its last stage is
//! what is compared.

use case::{Role, StageKind};

use super::numbers::Numbers;
use super::wind::Wind;

/// Descent speed, drag of the canopy and force in the lines at the payload.
pub const QUANTITIES: [&str; 3] = ["speed", "drag", "tension"];

/// Drag coefficient on the fabric area of a solid textile canopy: 0.6 to 0.85
/// (Knacke 1992, table 5-1).
const NOMINAL_DRAG: f64 = 0.8;
/// Projected over fabric area of an inflated canopy: a diameter of 0.65 to 0.8 (Knacke 1992, table 5-1).
const PROJECTED: f64 = 0.5;
/// Added mass over $`\rho R^3`$ of an inflated canopy of projected radius $`R`$: the disc's 8/3
/// (Lamb, Hydrodynamics, 1932, section 102) and a hemisphere of enclosed air.
const ADDED_MASS: f64 = 8.0 / 3.0 + 2.0 / 3.0 * std::f64::consts::PI;
/// Steps of the fall.
const STEPS: u32 = 2000;

/// What an effect changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Influence {
    /// Relative change of the canopy's drag area at a fixed speed.
    pub canopy: f64,
    /// Drag area of lines and payload relative to the canopy's.
    pub below_canopy: f64,
    /// Share of the force on `below_canopy` that passes through the lines.
    pub through_lines: f64,
    /// Mass that weighs on the canopy and no longer at the payload, in shares of the falling mass.
    pub on_canopy: f64,
    /// Further relative change of the force in the lines.
    pub lines: f64,
}

impl Influence {
    /// Of a change of the canopy's drag area alone.
    pub fn of_canopy(canopy: f64) -> Self {
        Self { canopy, ..Self::default() }
    }

    /// All that is estimated multiplied (masses are known); a canopy keeps some drag.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            canopy: (factor * self.canopy).max(-0.95),
            below_canopy: (factor * self.below_canopy).max(-0.9),
            through_lines: self.through_lines,
            on_canopy: self.on_canopy,
            lines: factor * self.lines,
        }
    }
}

/// How the last stage moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// A mass falls: the speed responds.
    Falls,
    /// The speed of the air is given.
    Given,
    /// Pressure is given, no air moves.
    NoAir,
}

/// The quasi-steady fall of a scene.
#[derive(Clone, Debug)]
pub struct Fall {
    /// How the stage moves.
    pub motion: Motion,
    /// Whether the stage has a structure, whose lines carry the canopy's load.
    pub tension: bool,
    /// Density of the air, kg/m3.
    pub density: f64,
    /// Drag area of the canopy, m2.
    pub drag_area: f64,
    /// Projected area of the canopy, m2.
    pub projected_area: f64,
    /// Mass of the air that moves with the canopy, kg.
    pub added_mass: f64,
    /// Mass that falls, kg.
    pub mass: f64,
    /// Acceleration of gravity, m/s2.
    pub gravity: f64,
    /// Descent speed at the start, m/s.
    pub speed: f64,
    /// Pressure jump of a stage without air, Pa.
    pub pressure: f64,
    /// The wind.
    pub wind: Wind,
    /// Time of the fall before the stage, s.
    pub before: f64,
    /// Time of the stage whose second half counts, s.
    pub time: f64,
}

impl Fall {
    /// Of stage `stage` of the scene of `n`, of which `windows` windows are run (all where `None`).
    pub fn new(n: &Numbers<'_>, stage: usize, windows: Option<u64>) -> Self {
        let scene = n.scene;
        let s = &scene.stages[stage];
        let falls = s.kind == StageKind::Coupled && n.falling_mass > 0.0;
        let radius = (PROJECTED * n.fabric_area / std::f64::consts::PI).sqrt();
        let before =
            scene.stages[..stage].iter().filter(|s| s.kind == StageKind::Coupled).map(|s| s.duration_s);
        let time = windows.map_or(s.duration_s, |w| (w as f64 * s.window_s).min(s.duration_s));
        Self {
            motion: match s.kind {
                StageKind::PreInflation | StageKind::Trajectory => Motion::NoAir,
                _ if falls => Motion::Falls,
                _ => Motion::Given,
            },
            tension: s.kind.roles().contains(&Role::Structure) && scene.has_cables(),
            density: n.density,
            drag_area: drag_area(n),
            projected_area: PROJECTED * n.fabric_area,
            added_mass: ADDED_MASS * n.density * radius.powi(3),
            mass: n.falling_mass,
            gravity: n.gravity,
            speed: scene.resolved().initial_speed_m_s,
            pressure: s.pressure_pa.map_or(n.pressure, f64::abs),
            wind: Wind::of(scene, stage),
            before: if falls { before.sum() } else { 0.0 },
            time,
        }
    }

    /// Time in which a change of speed fades by a factor of e, s: $`(m + m_a) v / (2 m g)`$.
    pub fn response_time(&self) -> f64 {
        let steady = (2.0 * self.mass * self.gravity / (self.density * self.drag_area)).sqrt();
        (self.mass + self.added_mass) * steady / (2.0 * self.mass * self.gravity)
    }

    /// Share of the steady change of speed that a change of the drag area has made in the mean over the second half of
    /// the stage: that of $`1 - e^{-t/\tau}`$.
    pub fn speed_response(&self) -> f64 {
        let tau = self.response_time();
        let (from, to) = (self.before + 0.5 * self.time, self.before + self.time);
        if self.motion != Motion::Falls || to <= from {
            return 0.0;
        }
        1.0 - tau / (to - from) * ((-from / tau).exp() - (-to / tau).exp())
    }

    /// Descent speed (m/s), drag of the canopy (N) and force in the lines at the payload (N), as means over
    /// the second half of the stage; `None`: the stage has no such quantity.
    pub fn answer(&self, influence: &Influence, wind: &Wind) -> [Option<f64>; 3] {
        let tension = |canopy: f64, below_canopy: f64, weight: f64| {
            (canopy + influence.through_lines * below_canopy - weight) * (1.0 + influence.lines)
        };
        if self.motion == Motion::NoAir {
            let load = self.pressure * self.projected_area * (1.0 + influence.canopy);
            let weight = influence.on_canopy * self.mass * self.gravity;
            return [None, Some(load), self.tension.then(|| tension(load, 0.0, weight))];
        }
        let means = self.means(influence, wind);
        let lines = tension(means.canopy, means.below_canopy, influence.on_canopy * means.weight);
        [
            (self.motion == Motion::Falls).then_some(means.speed),
            Some(means.canopy),
            self.tension.then_some(lines),
        ]
    }

    fn means(&self, influence: &Influence, wind: &Wind) -> Means {
        let end = self.before + self.time;
        let h = end / f64::from(STEPS);
        let half = |area: f64| 0.5 * self.density * area;
        let canopy = half(self.drag_area * (1.0 + influence.canopy));
        let below_canopy = half(self.drag_area * influence.below_canopy);
        let (mut fallen, mut now) = (0.0, wind.at(-self.before, 0.0));
        let mut u = self.speed + now[2];
        let mut means = Means::default();
        let mut count = 0.0;
        for k in 1..=STEPS {
            let next = wind.at(h * f64::from(k) - self.before, fallen);
            let rate = (next[2] - now[2]) / h.max(f64::MIN_POSITIVE);
            let size = (u * u + next[0] * next[0] + next[1] * next[1]).sqrt();
            let old = u - now[2];
            u = match self.motion {
                // Implicit in the drag: stable for any step.
                Motion::Falls => {
                    let inertia = self.mass + self.added_mass;
                    (inertia * u + h * self.mass * (self.gravity + rate))
                        / (inertia + h * (canopy + below_canopy) * size)
                }
                _ => self.speed + next[2],
            };
            let v = u - next[2];
            fallen += h * v;
            now = next;
            if h * f64::from(k) < self.before + 0.5 * self.time {
                continue;
            }
            let below_canopy_drag = below_canopy * size * u;
            let fall = if h > 0.0 { (v - old) / h } else { 0.0 };
            let force = match self.motion {
                Motion::Falls => self.mass * (self.gravity - fall) - below_canopy_drag,
                _ => canopy * size * u + self.added_mass * rate,
            };
            means.add(v, force, below_canopy_drag, self.mass * (self.gravity - fall));
            count += 1.0;
        }
        means.over(count)
    }
}

#[derive(Default)]
struct Means {
    speed: f64,
    canopy: f64,
    below_canopy: f64,
    /// Of all that falls in the falling frame, N.
    weight: f64,
}

impl Means {
    fn add(&mut self, speed: f64, canopy: f64, below_canopy: f64, weight: f64) {
        self.speed += speed;
        self.canopy += canopy;
        self.below_canopy += below_canopy;
        self.weight += weight;
    }

    fn over(self, count: f64) -> Self {
        let c = f64::max(count, 1.0);
        Self {
            speed: self.speed / c,
            canopy: self.canopy / c,
            below_canopy: self.below_canopy / c,
            weight: self.weight / c,
        }
    }
}

/// Drag area of the canopy, m2: what balances the weight at the initial speed where that is the coefficient
/// of a parachute on the scene's grid (0.3 to 1.5 on the fabric area), or else the nominal coefficient.
fn drag_area(n: &Numbers<'_>) -> f64 {
    let balance = n.falling_mass * n.gravity / n.dynamic_pressure;
    let coefficient = balance / n.fabric_area;
    if (0.3..=1.5).contains(&coefficient) { balance } else { NOMINAL_DRAG * n.fabric_area }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fall(time: f64) -> Fall {
        let (density, mass, gravity, speed) = (1.2, 10.0, 9.81, 5.0);
        Fall {
            motion: Motion::Falls,
            tension: true,
            density,
            drag_area: 2.0 * mass * gravity / (density * speed * speed),
            projected_area: 4.0,
            added_mass: 5.0,
            mass,
            gravity,
            speed,
            pressure: 0.0,
            wind: Wind::default(),
            before: 0.0,
            time,
        }
    }

    fn change(fall: &Fall, influence: &Influence, wind: &Wind) -> [f64; 3] {
        let (with, without) = (fall.answer(influence, wind), fall.answer(&Influence::default(), &fall.wind));
        std::array::from_fn(|i| with[i].unwrap() / without[i].unwrap() - 1.0)
    }

    /// In a steady descent the drag is the weight and the speed goes with the drag area to the -1/2.
    #[test]
    fn a_long_fall_is_steady() {
        let long = fall(60.0);
        let [speed, drag, tension] = change(&long, &Influence::of_canopy(0.1), &long.wind);
        assert!((speed - (1.1f64.powf(-0.5) - 1.0)).abs() < 1e-6, "{speed}");
        assert!(drag.abs() < 1e-6 && tension.abs() < 1e-6, "{drag} {tension}");
        // A payload with drag of its own relieves the canopy by its share.
        let payload = Influence { below_canopy: 0.1, ..Influence::default() };
        let [speed, drag, _] = change(&long, &payload, &long.wind);
        assert!((speed - (1.1f64.powf(-0.5) - 1.0)).abs() < 1e-6 && (drag + 0.1 / 1.1).abs() < 1e-6);
    }

    /// At once the drag changes with its area, and the speed not yet.
    #[test]
    fn a_short_fall_is_at_a_fixed_speed() {
        let short = fall(1e-4);
        let [speed, drag, tension] = change(&short, &Influence::of_canopy(0.1), &short.wind);
        // The frame shares the force with the air that it takes along.
        let share = 10.0 / 15.0;
        assert!(speed.abs() < 1e-4, "{speed}");
        assert!((drag - 0.1 * share).abs() < 1e-4 && (tension - drag).abs() < 1e-9, "{drag} {tension}");
    }

    /// Half way, the linearised response: y = y_oo (1 - exp(-t / tau)).
    #[test]
    fn a_change_of_speed_grows_with_the_response_time() {
        let tau = fall(1.0).response_time();
        assert!((tau - 15.0 * 5.0 / (2.0 * 10.0 * 9.81)).abs() < 1e-9);
        let some = fall(2.0 * tau);
        let small = 1e-4;
        let [speed, ..] = change(&some, &Influence::of_canopy(small), &some.wind);
        // Mean of 1 - exp(-s) over s from 1 to 2.
        let response = 1.0 - ((-1.0f64).exp() - (-2.0f64).exp());
        assert!((speed / (-0.5 * small) / response - 1.0).abs() < 2e-3, "{speed}");
    }

    /// A steady updraught from the start is a change of frame: the descent is slower by it.
    #[test]
    fn an_updraught_slows_the_descent() {
        let long = fall(60.0);
        let up = Wind::uniform([0.0, 0.0, 1.0]);
        let [speed, drag, _] = change(&long, &Influence::default(), &up);
        assert!((speed + 0.2).abs() < 1e-6 && drag.abs() < 1e-6, "{speed} {drag}");
    }
}
