//! Tests of `ripstop conform` whether replies can be those of a canopy, of air or of a grid.
//!
//! They need the recording and the scene only. A reply changes with the input of its own window (a program that is one window late does not), it resembles
//! the recorded one, and it responds to a small change of the input as its physics must: a pressure moves fabric along the normal and does
//! positive work on each face, air resists the acceleration of a canopy, a grid follows it.

use case::{Role, Solve};
use channel::{LOAD_WIDTH, Window, flow_stats as of_flow, structure_stats as of_structure};
use coupling::error::RunError;
use coupling::partners::Partners;
use mesh::geometry::Vec3;

use super::compared::{Deviation, deviation, groups_without_common_nodes, minus, norm};
use super::{ConformanceSuite, Recorded, Request, Verdict, at_iteration, relative_difference};

/// Change of a load for responses, as a share of the mean pressure jump, and at least, Pa.
const PRESSURE_SHARE: f64 = 0.05;
/// See [`PRESSURE_SHARE`].
const LEAST_PRESSURE: f64 = 0.1;
/// Change of the velocity of the frame, as a share of it, and at least, m/s.
const SPEED_SHARE: f64 = 0.02;
/// See [`SPEED_SHARE`].
const LEAST_SPEED: f64 = 0.01;
/// Largest deviation of a response from one that is linear, as a share of it: half. Fabric that becomes slack and an impulse of the air are not linear, and a
/// wrong sign deviates by twice the response.
const NONLINEAR: f64 = 0.5;
/// Fabric moves at most so many times as far as free fabric of its mass under the same pressure: nodes at an edge move a few times as far with a consistent mass.
const FREE_FABRIC: f64 = 10.0;
/// Work of a pressure on its face below which the face moves against it, as a share of the median work.
const AGAINST: f64 = -0.05;

/// Largest difference of a statistic from the same quantity of the reply, as a share. The project's programs agree to 6e-9; the rest is room for a program that
/// sums its load on a surface of its own.
const STATISTIC: f64 = 0.02;

/// Replies to a request and to changes of it by -1, 1 and 2 units.
struct Responses {
    base: Vec<f64>,
    /// Changes of the reply for a change of the input by -1, 1 and 2 units.
    changes: [Vec<f64>; 3],
}

impl Responses {
    /// Share of the response by which opposite changes are not opposite, and twice the change not twice the response.
    fn nonlinearity(&self) -> [f64; 2] {
        let [back, once, twice] = &self.changes;
        let size = norm(once);
        let sum: Vec<f64> = once.iter().zip(back).map(|(a, b)| a + b).collect();
        let rest: Vec<f64> = twice.iter().zip(once).map(|(a, b)| a - 2.0 * b).collect();
        [norm(&sum) / size, 0.5 * norm(&rest) / size]
    }

    /// The verdict on linearity after `text`.
    fn judge(&self, text: String) -> Verdict {
        if norm(&self.changes[1]) == 0.0 {
            return Verdict::Failed("a small change of the input changes nothing".into());
        }
        let [opposite, double] = self.nonlinearity();
        let text = format!(
            "{text}; opposite changes to {opposite:.1e}, twice the change to {double:.1e} of the response"
        );
        if opposite < NONLINEAR && double < NONLINEAR {
            Verdict::Passed(text)
        } else {
            Verdict::Failed(format!("{text}: it must be linear for small changes (to {NONLINEAR})"))
        }
    }
}

/// `first` and up to four more.
fn list(numbers: &[usize]) -> String {
    let shown: Vec<String> = numbers.iter().take(5).map(ToString::to_string).collect();
    let more = numbers.len().saturating_sub(5);
    shown.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

impl ConformanceSuite<'_> {
    fn role(&self) -> Role {
        self.session.role
    }

    /// A window whose frame is faster by `change` (m/s) at its end.
    fn faster(w: &Window, change: f64) -> Window {
        let mut faster = *w;
        faster.frame_velocity[2] += change;
        faster.frame_acceleration[2] += change / w.dt;
        faster
    }

    /// A reply depends on the input of its own window.
    pub(super) fn own_input(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let (other, window) = match first {
            Request::Structure(_) => (first.loaded(self.pressure(first), |_| true), at_iteration(w, 1)),
            Request::Mesh(_) => (first.moved(2, self.way()), at_iteration(w, 1)),
            Request::Flow(_) => (first.clone(), Self::faster(&at_iteration(w, 1), self.speed(w))),
        };
        let [a, b, again] = self.run(|p| {
            Ok([
                self.send(p, first, w)?,
                self.send(p, &other, &window)?,
                self.send(p, first, &at_iteration(w, 2))?,
            ])
        })?;
        if a.is_empty() {
            return Ok(Verdict::Skipped("the program has no reply to compare".into()));
        }
        let (change, noise) = (relative_difference(&a, &b), relative_difference(&a, &again));
        Ok(if change > 10.0 * noise {
            Verdict::Passed(format!(
                "a change of the input changes the reply by {change:.1e} (repeated: {noise:.1e})"
            ))
        } else {
            let unread = match first {
                Request::Flow(_) => {
                    ", or the program does not read the velocity of the frame, which alone was changed"
                }
                _ => "",
            };
            Verdict::Failed(format!(
                "the reply does not depend on the input of its window (change {change:.1e}, repeated {noise:.1e}): it follows an earlier \
                 input, one window late{unread}"
            ))
        })
    }

    /// Replies resemble the recorded ones.
    pub(super) fn recorded_reply(&self) -> Result<Verdict, RunError> {
        let [first, second] = &self.script.windows[..] else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let (Some(a), Some(b)) = (&first.reply, &second.reply) else {
            return Ok(Verdict::Skipped("the recording contains no reply of this program".into()));
        };
        let found = self.run(|p| {
            let one = self.send(p, &first.last, &first.accepted)?;
            p.accept(&first.accepted)?;
            Ok([one, self.send(p, &second.last, &second.accepted)?])
        })?;
        let [found, recorded] = [[&found[0], &found[1]], [a, b]].map(|pair| pair.map(|v| self.compared(v)));
        if recorded[0].is_empty() {
            return Ok(Verdict::Skipped("the program has no reply to compare".into()));
        }
        let values = self.role() == Role::Flow;
        let width = if values { LOAD_WIDTH } else { 3 };
        let deviation = deviation([&found[0], &found[1]], [&recorded[0], &recorded[1]], values, width);
        let difference = norm(&minus(&found[1], &recorded[1])) / norm(&recorded[1]).max(f64::MIN_POSITIVE);
        Ok(match deviation {
            None => Verdict::Passed(format!("differs from the recorded one by {difference:.1e} in window 1")),
            Some(deviation) => Verdict::Failed(self.name(&deviation)),
        })
    }

    /// What a deviation says.
    fn name(&self, deviation: &Deviation) -> String {
        let role = self.role();
        match deviation {
            Deviation::Scale(ratio) => {
                let thousand = (ratio.log10().abs() - 3.0).abs() < 0.1;
                let cause = match (role, thousand, *ratio > 1.0) {
                    (Role::Flow, true, false) => ": kilopascals instead of pascals",
                    (Role::Flow, ..) => ": another unit of pressure, or a factor",
                    (_, true, true) => ": millimetres instead of metres",
                    (_, true, false) => ": kilometres instead of metres",
                    _ => ": another unit of length, or a factor",
                };
                format!("the reply is {ratio:.3e} times the recorded one{cause}")
            }
            Deviation::Reversed(cosine) if role == Role::Flow => format!(
                "the load is the opposite of the recorded one (cosine {cosine:.2}): the pressure jump is inside minus outside"
            ),
            Deviation::Reversed(cosine) => format!(
                "the canopy moves opposite to the recorded motion (cosine {cosine:.2}): a wrong sign of load or displacement; or the recording is of \
                 another model, whose oscillation differs"
            ),
            Deviation::Late => "the reply of window 1 is that of window 0: it is one window late".into(),
            Deviation::Rows(faces) => format!(
                "the load on face {} is the opposite of the recorded one, where other faces agree: a wrong normal",
                list(faces)
            ),
        }
    }

    /// The part of a reply that is compared: positions of a grid without their velocities.
    fn compared(&self, reply: &[f64]) -> Vec<f64> {
        match self.role() {
            Role::Mesh => reply.chunks_exact(6).flat_map(|row| &row[..3]).copied().collect(),
            _ => reply.to_vec(),
        }
    }

    /// Statistics agree with the fields of the same reply: resultant and moment of a load, load and area of a shape.
    pub(super) fn statistics(&self) -> Result<Verdict, RunError> {
        let Recorded { accepted: w, last, .. } = &self.script.windows[0];
        let (reply, stats) = self.run(|p| last.answer(p, w, self.script.size))?;
        let canopy = &self.session.prepared.interface;
        let mut compared: Vec<(&str, Vec3, Vec3, f64)> = Vec::new();
        match (last, self.shape(last)) {
            (Request::Structure([_, end]), _) => {
                let pressure: Vec<f64> =
                    end.chunks_exact(LOAD_WIDTH).flat_map(|row| [row[0], 0.0, 0.0, 0.0]).collect();
                let up = |z: f64| Vec3::z() * z;
                let load = canopy.force(&pressure, &reply)[2];
                let area = canopy.projected_area(&reply);
                compared.push((
                    "VERTICAL_LOAD",
                    up(stats[of_structure::VERTICAL_LOAD]),
                    up(load),
                    load.abs(),
                ));
                compared.push(("PROJECTED_AREA", up(stats[of_structure::PROJECTED_AREA]), up(area), area));
            }
            (Request::Flow(Some(_)), Some(shape)) if !canopy.faces.is_empty() => {
                let vector = |at: usize| Vec3::from_column_slice(&stats[at..at + 3]);
                let (force, moment) = (canopy.force(&reply, &shape), canopy.moment(&reply, &shape));
                let size = force.norm();
                compared.push(("FORCE", vector(of_flow::FORCE), force, size));
                compared.push(("MOMENT", vector(of_flow::MOMENT), moment, size * 1e3 * self.way()));
            }
            _ => {
                return Ok(Verdict::Skipped(
                    "applies to structures, and to flows around a canopy that moves".into(),
                ));
            }
        }
        let reported: Vec<_> = compared.into_iter().filter(|(_, stated, ..)| stated.norm() > 0.0).collect();
        let text = |(name, stated, found, size): &(&str, Vec3, Vec3, f64)| {
            let share = (stated - found).norm() / size;
            (share, format!("{name} differs from that of the reply by {share:.1e}"))
        };
        let texts: Vec<(f64, String)> = reported.iter().map(text).collect();
        let all = texts.iter().map(|(_, text)| text.as_str()).collect::<Vec<_>>().join(", ");
        Ok(match texts.iter().find(|(share, _)| share.is_nan() || *share > STATISTIC) {
            _ if texts.is_empty() => Verdict::Skipped("the program reports none of them".into()),
            None => Verdict::Passed(all),
            Some((_, text)) => Verdict::Failed(format!(
                "{text} (at most {STATISTIC}): its sign, unit or frame, or the load of other faces"
            )),
        })
    }

    /// The response to a small change of the input.
    pub(super) fn response(&self) -> Result<Verdict, RunError> {
        match self.role() {
            Role::Structure => self.response_to_pressure(),
            Role::Mesh => self.response_to_translation(),
            Role::Flow => self.response_to_acceleration(),
        }
    }

    /// Replies of the first window to its first request and to changes of it by -1, 1 and 2 units.
    fn responses(&self, change: impl Fn(f64) -> (Request, Window)) -> Result<Responses, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        self.run(|p| {
            let base = self.send(p, first, w)?;
            let mut changes = [Vec::new(), Vec::new(), Vec::new()];
            for (k, units) in [-1.0, 1.0, 2.0].into_iter().enumerate() {
                let (request, window) = change(units);
                let window = Window { iteration: 1 + k as u64, ..window };
                changes[k] = minus(&self.send(p, &request, &window)?, &base);
            }
            Ok(Responses { base, changes })
        })
    }

    /// A uniform pressure does positive work, and moves fabric as far as its mass allows.
    fn response_to_pressure(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let canopy = &self.session.prepared.interface;
        let pressure = self.pressure(first);
        let found = self.responses(|units| (first.loaded(units * pressure, |_| true), *w))?;
        let [_, once, _] = &found.changes;
        let moved: Vec<f64> = found.base.iter().zip(once).map(|(a, b)| a + b).collect();
        let load: Vec<f64> = canopy.faces.iter().flat_map(|_| [pressure, 0.0, 0.0, 0.0]).collect();
        let work = canopy.work(&load, &found.base, &moved);
        let rms = norm(once) / (canopy.nodes() as f64).sqrt();
        if norm(once) > 0.0 && work <= 0.0 {
            return Ok(Verdict::Failed(format!(
                "{pressure:.3} Pa more inside do a work of {work:.2e} J: fabric moves against the pressure (pressure jump inside minus outside, \
                 normals outwards)"
            )));
        }
        let text = format!("{pressure:.3} Pa more inside move the canopy by {rms:.2e} m rms");
        let stage = &self.session.prepared.scene.stages[self.session.number()];
        if stage.solve == Solve::Static {
            return Ok(found.judge(text));
        }
        let areal = canopy.masses.fabric / canopy.area(&vec![0.0; found.base.len()]);
        let free = 0.5 * pressure / areal * w.dt * w.dt;
        if rms > FREE_FABRIC * free {
            return Ok(Verdict::Failed(format!(
                "{text}, {:.0} times as far as free fabric of its mass: another unit of length, or a wrong mass",
                rms / free
            )));
        }
        Ok(found.judge(format!("{text}, {:.2} of free fabric", rms / free)))
    }

    /// A pressure on single faces does positive work on each of them.
    pub(super) fn faces(&self) -> Result<Verdict, RunError> {
        if self.role() != Role::Structure {
            return Ok(Verdict::Skipped("applies to the structure only".into()));
        }
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let canopy = &self.session.prepared.interface;
        let pressure = self.pressure(first);
        let groups = groups_without_common_nodes(&canopy.faces, canopy.nodes());
        let mut works = vec![0.0; canopy.faces.len()];
        self.run(|p| {
            let base = self.send(p, first, w)?;
            for (k, group) in groups.iter().enumerate() {
                let request = first.loaded(pressure, |face| group.binary_search(&face).is_ok());
                let moved = self.send(p, &request, &at_iteration(w, 1 + k as u64))?;
                let load = load_on(group, pressure, canopy.faces.len());
                for (face, work) in canopy.works(&load, &base, &moved).enumerate() {
                    works[face] += work;
                }
            }
            Ok(())
        })?;
        let mut sizes: Vec<f64> = works.iter().map(|w| w.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let median = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
        let against: Vec<usize> = (0..works.len()).filter(|f| works[*f] < AGAINST * median).collect();
        Ok(if median == 0.0 {
            Verdict::Failed("a pressure on a face moves nothing".into())
        } else if against.is_empty() {
            Verdict::Passed(format!("a pressure on each of {} faces moves it along its normal", works.len()))
        } else {
            Verdict::Failed(format!(
                "face {} moves against a pressure on it: a wrong normal, or the load of another face",
                list(&against)
            ))
        })
    }

    /// Air resists an acceleration of the canopy.
    fn response_to_acceleration(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let canopy = &self.session.prepared.interface;
        if canopy.faces.is_empty() {
            return Ok(Verdict::Skipped("there is no canopy".into()));
        }
        let change = self.speed(w);
        let found = self.responses(|units| (first.clone(), Self::faster(w, units * change)))?;
        let Some(shape) = self.shape(first) else {
            return Ok(Verdict::Skipped("the recording has no shape of the canopy".into()));
        };
        let force = canopy.force(&found.changes[1], &shape)[2];
        let text = format!(
            "{change:.3} m/s more upwards within the window change the vertical force by {force:.3e} N"
        );
        if norm(&found.changes[1]) > 0.0 && force >= 0.0 {
            return Ok(Verdict::Failed(format!(
                "{text}: air must resist (the pressure jump is inside minus outside, normals outwards)"
            )));
        }
        Ok(found.judge(text))
    }

    /// A grid follows a canopy that is translated, with the velocity of its change of place.
    fn response_to_translation(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let way = self.way();
        let mut text = String::new();
        for axis in 0..3 {
            let found = self.responses(|units| (first.moved(axis, units * way), *w))?;
            let [_, once, _] = &found.changes;
            if once.is_empty() {
                return Ok(Verdict::Skipped("the recording contains no grid".into()));
            }
            let along = |from: usize| once.iter().skip(from).step_by(6).copied();
            let (most, least) = (along(axis).fold(0.0, f64::max), along(axis).fold(0.0, f64::min));
            let name = ["x", "y", "z"][axis];
            if (most / way - 1.0).abs() > 0.01 || least < -0.5 * way {
                return Ok(Verdict::Failed(format!(
                    "a canopy that moves by {way:.2e} m along {name} moves nodes of the grid by {least:.2e} to {most:.2e} m: those on the \
                     canopy follow it, others move less"
                )));
            }
            let velocity = (0..3).flat_map(|c| along(c).zip(along(3 + c)));
            let worst = velocity.map(|(x, v)| (x - v * w.dt).abs()).fold(0.0, f64::max);
            if worst > 0.01 * way {
                return Ok(Verdict::Failed(format!(
                    "positions and velocities do not agree: with {way:.2e} m more along {name} the change of the velocity times the window \
                     differs from that of the position by {worst:.2e} m"
                )));
            }
            if let Verdict::Failed(why) = found.judge(format!("translation along {name}")) {
                return Ok(Verdict::Failed(why));
            }
            text = format!(
                "the grid follows a canopy that is translated by {way:.2e} m; velocities agree to {:.1e}",
                worst / way
            );
        }
        Ok(Verdict::Passed(text))
    }

    /// Pressure of a test, Pa.
    fn pressure(&self, request: &Request) -> f64 {
        let Request::Structure([_, end]) = request else { return LEAST_PRESSURE };
        let faces = end.len() / LOAD_WIDTH;
        let mean = end.iter().step_by(LOAD_WIDTH).map(|p| p.abs()).sum::<f64>() / faces.max(1) as f64;
        (PRESSURE_SHARE * mean).max(LEAST_PRESSURE)
    }

    /// Change of the velocity of the frame of a test, m/s.
    fn speed(&self, w: &Window) -> f64 {
        (SPEED_SHARE * norm(&w.frame_velocity)).max(LEAST_SPEED)
    }

    /// Way of a test, m: a thousandth of the extent of the canopy.
    fn way(&self) -> f64 {
        let coords = &self.session.prepared.interface.coords;
        let extent = |i: usize| {
            let [low, high] =
                coords.iter().fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(x[i]), b.max(x[i])]);
            high - low
        };
        1e-3 * (0..3).map(extent).fold(0.0, f64::max)
    }

    /// Displacement of the canopy of a flow, m: of the request, else as the last stage with the structure left it.
    fn shape(&self, request: &Request) -> Option<Vec<f64>> {
        if let Request::Flow(Some(displacement)) = request {
            return Some(displacement.clone());
        }
        let (session, canopy) = (&self.session, &self.session.prepared.interface);
        let scene = &session.prepared.scene;
        let state = scene.source_state(&session.out, session.number(), Role::Structure)?;
        let shape = mesh::load_shape(&case::canopy_file(state.parent()?), canopy.nodes()).ok()?;
        let displaced = shape.iter().zip(&canopy.coords);
        Some(displaced.flat_map(|(x, reference)| [0, 1, 2].map(|i| x[i] - reference[i])).collect())
    }
}

/// A pressure (Pa) on the faces of `group`.
fn load_on(group: &[usize], pressure: f64, faces: usize) -> Vec<f64> {
    let mut load = vec![0.0; LOAD_WIDTH * faces];
    group.iter().for_each(|face| load[LOAD_WIDTH * face] = pressure);
    load
}

impl Request {
    /// With `pressure` (Pa) more on the faces that `which` selects, throughout the window.
    fn loaded(&self, pressure: f64, which: impl Fn(usize) -> bool) -> Self {
        let more = |load: &Vec<f64>| {
            let mut load = load.clone();
            for (face, row) in load.chunks_exact_mut(LOAD_WIDTH).enumerate() {
                if which(face) {
                    row[0] += pressure;
                }
            }
            load
        };
        match self {
            Self::Structure([start, end]) => Self::Structure([more(start), more(end)]),
            other => other.clone(),
        }
    }

    /// With the canopy moved by `way` (m) along `axis`.
    fn moved(&self, axis: usize, way: f64) -> Self {
        match self {
            Self::Mesh(displacement) => {
                let mut moved = displacement.clone();
                moved.iter_mut().skip(axis).step_by(3).for_each(|d| *d += way);
                Self::Mesh(moved)
            }
            other => other.clone(),
        }
    }
}
