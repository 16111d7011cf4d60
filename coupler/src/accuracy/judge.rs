//! From values and costs to errors, orders, uncertainties and the Pareto front.
//!
//! The answer that errors of members are against is the exact one where a quantity has it. Else
//! it is the base point's value plus what each dial would still change if it were turned without end,
//! $\phi=\phi_b+\sum_d(\phi_{d,0}-\phi_b)$; dials that the sweep turns count once, with the sweep. Its
//! uncertainty is the root of the sum of the squares of those of the limits.
//!
//! Errors of different signs cancel by chance: a coarse member may hit the answer. What a member is
//! judged by is therefore the sum of what each dial alone is off at its setting, taken as if nothing
//! cancelled, or its distance from the answer where that is more.

use super::convergence::{Convergence, converge};
use super::cost::{Cost, spread};
use super::fly::Record;
use super::study::{Line, SWEEP, Study};

/// A value, or why there is none.
pub type Value = Result<f64, String>;

/// What cost is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Measure {
    /// Wall seconds.
    #[default]
    Wall,
    /// Processor seconds of all programs; MPI waits by spinning.
    Cpu,
    /// Counts, weighted to seconds of a core: what a busy machine does not disturb.
    Work,
}

impl Measure {
    /// For axes.
    pub fn label(self) -> &'static str {
        match self {
            Self::Wall => "wall time, s",
            Self::Cpu => "processor time, s",
            Self::Work => "work (counts as seconds of a core), s",
        }
    }

    /// Of a run.
    pub fn of(self, cost: &Cost) -> f64 {
        match self {
            Self::Wall => cost.wall_s,
            Self::Cpu => cost.cpu_s,
            Self::Work => cost.counts().work(),
        }
    }
}

/// The answer of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Its value.
    pub value: f64,
    /// Half width of its band.
    pub uncertainty: f64,
    /// What errors are shares of.
    pub scale: f64,
    /// The scene names it.
    pub exact: bool,
}

/// Errors are the same up to this factor.
const SAME: f64 = 1.05;
/// A member that is as accurate as the base at more than this share of its cost leaves it next to the front.
const NEXT_TO: f64 = 0.9;

/// A line of members, judged for one quantity.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Its convergence; `None` for words or without values.
    pub convergence: Option<Convergence>,
    /// For each member of the line: error against the line's own limit (for words: against the
    /// base), and half its band, as shares of the scale.
    pub errors: Vec<Option<(f64, f64)>>,
    /// For the member that is finer than all: its distance from the finest of the line and the band
    /// stated there, as shares.
    pub check: Option<(f64, f64)>,
}

/// A member, judged.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Middle and half range of its cost.
    pub cost: (f64, f64),
    /// Middle and half range of its cost over that of the base of the same round.
    pub ratio: (f64, f64),
    /// Values of the quantities.
    pub values: Vec<Option<f64>>,
    /// Errors as shares.
    pub errors: Vec<Option<f64>>,
    /// The largest of them with the uncertainty of that quantity's answer.
    pub worst: Option<(f64, f64)>,
    /// Why there are no values, or not all.
    pub gap: Option<String>,
}

/// All that a study came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What cost is.
    pub measure: Measure,
    /// Answers of the quantities.
    pub answers: Vec<Option<Answer>>,
    /// Lines by quantity: `[line][quantity]`.
    pub lines: Vec<Vec<Judged>>,
    /// Members.
    pub members: Vec<Standing>,
    /// Members that none beats in cost and error at once, the cheapest first.
    pub front: Vec<usize>,
}

/// Judges a study from the values (`[member][quantity]`, or why there is none) and the records.
pub fn judge(study: &Study, values: &[Vec<Value>], records: &[Record], measure: Measure) -> Outcome {
    let value = |member: usize, q: usize| values[member][q].as_ref().ok().copied();
    let answers: Vec<Option<Answer>> =
        (0..study.quantities.len()).map(|q| answer(study, q, &|m| value(m, q))).collect();
    let lines = study
        .lines
        .iter()
        .map(|line| {
            (0..study.quantities.len())
                .map(|q| {
                    let scale = answers[q].map_or(f64::NAN, |a| a.scale);
                    judged(line, &|m| value(m, q), scale)
                })
                .collect()
        })
        .collect();
    let base: Vec<f64> = records[0].runs.iter().map(|c| measure.of(c)).collect();
    let members: Vec<Standing> = (0..study.members.len())
        .map(|m| {
            let runs = &records[m].runs;
            let own: Vec<Option<f64>> = (0..study.quantities.len()).map(|q| value(m, q)).collect();
            let errors: Vec<Option<f64>> = own
                .iter()
                .zip(&answers)
                .map(|(v, a)| Some(((*v)? - (*a)?.value).abs() / (*a)?.scale))
                .collect();
            let worst = (0..study.quantities.len())
                .map(|q| {
                    let a = answers[q]?;
                    let apart = errors[q]?;
                    let summed = if a.exact { 0.0 } else { summed(study, m, &|m| value(m, q)) / a.scale };
                    Some((apart.max(summed), a.uncertainty / a.scale))
                })
                .collect::<Option<Vec<_>>>()
                .and_then(|all| all.into_iter().max_by(|a, b| (a.0 + a.1).total_cmp(&(b.0 + b.1))));
            let gap = records[m]
                .failure
                .clone()
                .or_else(|| values[m].iter().find_map(|v| v.as_ref().err().cloned()));
            Standing {
                cost: spread(runs.iter().map(|c| measure.of(c))),
                ratio: spread(runs.iter().zip(&base).map(|(c, b)| measure.of(c) / b)),
                values: own,
                errors,
                worst: worst.filter(|_| gap.is_none()),
                gap,
            }
        })
        .collect();
    let front = front(&members);
    Outcome { measure, answers, lines, members, front }
}

fn judged(line: &Line, value: &dyn Fn(usize) -> Option<f64>, scale: f64) -> Judged {
    let sound: Vec<(f64, f64)> =
        line.members.iter().filter_map(|&(m, size)| Some((size?, value(m)?))).collect();
    let convergence = converge(&sound, line.promised);
    let Some(c) = &convergence else {
        // Words: what each changes against the base, which is member 0.
        let base = value(0);
        let errors =
            line.members.iter().map(|&(m, _)| Some(((value(m)? - base?).abs() / scale, 0.0))).collect();
        return Judged { convergence: None, errors, check: None };
    };
    let mut bands = c.uncertainty.iter();
    let errors = line
        .members
        .iter()
        .map(|&(m, size)| {
            size?;
            let v = value(m)?;
            Some(((v - c.limit).abs() / scale, bands.next()? / scale))
        })
        .collect();
    let finest =
        sound.iter().zip(&c.uncertainty).min_by(|a, b| a.0.0.total_cmp(&b.0.0)).map(|((_, v), u)| (*v, *u));
    let check = line.check.and_then(|(m, _)| {
        let (v, u) = finest?;
        Some(((value(m)? - v).abs() / scale, u / scale))
    });
    Judged { convergence, errors, check }
}

fn answer(study: &Study, q: usize, value: &dyn Fn(usize) -> Option<f64>) -> Option<Answer> {
    let quantity = &study.quantities[q];
    let with = |value: f64, uncertainty: f64, exact: bool| {
        let scale = quantity.scale.unwrap_or(value.abs());
        // An answer of 0 has no shares: the errors are then as they are.
        Answer { value, uncertainty, scale: if scale > 0.0 { scale } else { 1.0 }, exact }
    };
    if let Some(exact) = quantity.exact {
        return Some(with(exact, 0.0, true));
    }
    let sweep = study.lines.iter().find(|l| l.name == SWEEP);
    let Some(base) = value(0) else {
        // Without a base point the sweep stands alone.
        let c = limit(sweep?, value)?;
        return Some(with(c.limit, c.limit_uncertainty, false));
    };
    let (mut sum, mut square) = (base, 0.0);
    for line in study.lines.iter().filter(|l| counts_once(study, l, sweep)) {
        let Some(c) = limit(line, value) else { continue };
        // Where there is no order the finest stands for the limit.
        sum += c.limit - base;
        square += c.limit_uncertainty * c.limit_uncertainty;
    }
    Some(with(sum, square.sqrt(), false))
}

/// Where the members of a line go for a quantity.
fn limit(line: &Line, value: &dyn Fn(usize) -> Option<f64>) -> Option<Convergence> {
    let sound: Vec<(f64, f64)> =
        line.members.iter().filter_map(|&(m, size)| Some((size?, value(m)?))).collect();
    converge(&sound, line.promised)
}

/// Whether the error of a line is one of its own beside those of the others: of `with` in the first
/// place.
fn counts_once(study: &Study, line: &Line, with: Option<&Line>) -> bool {
    if with.is_some_and(|w| w.name == line.name) {
        return true;
    }
    let turned = |at: &usize| with.is_some_and(|w| w.dials.contains(at));
    line.name != SWEEP && !line.dials.iter().any(turned) && !covered(study, &line.name)
}

/// What the dials are off at the settings of a member, each alone, as if no error cancelled another.
fn summed(study: &Study, member: usize, value: &dyn Fn(usize) -> Option<f64>) -> f64 {
    let settings = &study.members[member].settings;
    let mut sum = 0.0;
    for line in study.lines.iter().filter(|l| l.name != SWEEP && !covered(study, &l.name)) {
        let Some(&dial) = line.dials.first() else { continue };
        let same = |m: &usize| study.members[*m].settings[dial] == settings[dial];
        // A setting that the line does not have is finer than the base (the sweep's check).
        let on = line.members.iter().map(|m| m.0).chain(line.check.map(|c| c.0));
        let at = if study.members[0].settings[dial] == settings[dial] {
            0
        } else {
            on.into_iter().find(same).unwrap_or(0)
        };
        // Words are off by what they change against the base.
        let against = limit(line, value).map(|c| c.limit).or(value(0));
        if let (Some(v), Some(l)) = (value(at), against) {
            sum += (v - l).abs();
        }
    }
    sum
}

/// `grid` turns what `structure-grid` and `flow-grid` turn.
fn covered(study: &Study, name: &str) -> bool {
    matches!(name, "structure-grid" | "flow-grid") && study.lines.iter().any(|l| l.name == "grid")
}

/// Members that none beats in cost and error at once, by cost.
fn front(members: &[Standing]) -> Vec<usize> {
    let sound =
        |m: &Standing| m.worst.map(|w| (m.cost.0, w.0 + w.1)).filter(|(c, e)| c.is_finite() && e.is_finite());
    let mut order: Vec<usize> = (0..members.len()).filter(|&i| sound(&members[i]).is_some()).collect();
    let key = |i: usize| sound(&members[i]).unwrap_or((f64::MAX, f64::MAX));
    order.sort_by(|&a, &b| key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)));
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = key(i).1 < least;
        least = least.min(key(i).1);
        better
    });
    order
}

impl Outcome {
    /// Error and uncertainty of a member together, as a share.
    pub fn bound(&self, member: usize) -> Option<f64> {
        self.members[member].worst.map(|(e, u)| e + u)
    }

    /// The cheapest member that is as accurate as the base point, to within a twentieth of its error, and
    /// the share of its cost that it takes; `None` where there is none, or without values.
    pub fn beaten_by(&self) -> Option<(usize, f64)> {
        let own = self.bound(0)?;
        let share = |m: usize| self.members[m].cost.0 / self.members[0].cost.0;
        (1..self.members.len())
            .filter(|&m| self.bound(m).is_some_and(|b| b <= SAME * own) && share(m) < NEXT_TO)
            .map(|m| (m, share(m)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Of the members beyond the finest: how many are within the band that was stated, of how many.
    pub fn held(&self) -> (usize, usize) {
        let all = || self.lines.iter().flatten().filter_map(|j| j.check);
        // Equal to round-off is within any band.
        (all().filter(|(far, band)| *far <= band + 1e-9).count(), all().count())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::path::Path;

    use super::super::convergence::Behaviour;
    use super::super::cost::{Counts, StageCost};
    use super::super::study::Choice;
    use super::*;

    type Values = Vec<Vec<Value>>;

    /// A study of `square-drop` with values by formula: 10 + 0.4 h^2 + 0.1 t, `h` of the grid, `t` of
    /// the window; cost 1/(h^3 t).
    pub fn made() -> (Study, Values, Vec<Record>) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/square-drop/scene.toml");
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("scene.toml");
        let text = std::fs::read_to_string(file).unwrap()
            + "[accuracy]\nsweep = [\"grid\", \"window\"]\nsweep_check = [4.0, 4.0]\n\
               [[accuracy.quantity]]\nname = \"speed\"\nof = \"descent-speed\"\n\
               [[accuracy.dial]]\nname = \"grid\"\nvalues = [0.5, 1.0, 2.0]\ncheck = 4.0\n\
               [[accuracy.dial]]\nname = \"window\"\nvalues = [0.5, 1.0, 2.0]\n\
               [[accuracy.dial]]\nname = \"scheme\"\nchoices = [\"default\", \"implicit:aitken\"]\n";
        std::fs::write(&copy, text).unwrap();
        let study = Study::new(&copy, &Choice { check: true, ..Choice::default() }).unwrap();
        let (mut values, mut records) = (Vec::new(), Vec::new());
        for m in &study.members {
            let size = |i: usize| study.dials[i].dial.size(&m.settings[i]).unwrap();
            let (h, t) = (size(0), size(1));
            values.push(vec![Ok(10.0 + 0.4 * h * h + 0.1 * t)]);
            let counts = Counts { cell_updates: 1e6 / (h * h * h * t), ..Counts::default() };
            let stage = StageCost {
                name: "descent".into(),
                counts,
                parts_s: [1.0, 3.0, 0.5, 0.1, 0.2],
                ..StageCost::default()
            };
            let wall_s = 1.0 / (h * h * h * t);
            records.push(Record {
                runs: vec![Cost { wall_s, cpu_s: 2.0 * wall_s, peak_bytes: 1e8, stages: vec![stage] }],
                ..Record::default()
            });
        }
        (study, values, records)
    }

    #[test]
    fn the_answer_orders_front_and_bands_of_a_made_up_study() {
        let (study, values, records) = made();
        let o = judge(&study, &values, &records, Measure::Work);
        let a = o.answers[0].unwrap();
        assert!((a.value - 10.0).abs() <= a.uncertainty && a.uncertainty < 0.2, "{a:?}");
        let grid = o.lines[0][0].convergence.as_ref().unwrap();
        assert!((grid.order.unwrap() - 2.0).abs() < 1e-3);
        let window = o.lines[1][0].convergence.as_ref().unwrap();
        assert!((window.order.unwrap() - 1.0).abs() < 1e-3);
        // Words change nothing here.
        assert!(o.lines[2][0].errors.iter().all(|e| e.unwrap().0 < 1e-12));
        let (held, all) = o.held();
        assert_eq!((held, all), (2, 2), "{:?}", o.lines);
        // The front falls, and the finest of the sweep ends it but for the check members.
        let bounds: Vec<f64> = o.front.iter().map(|&m| o.bound(m).unwrap()).collect();
        assert!(bounds.windows(2).all(|w| w[1] < w[0]) && bounds.len() >= 3, "{bounds:?}");
        for (m, s) in o.members.iter().enumerate() {
            let dominated = o
                .front
                .iter()
                .any(|&f| o.members[f].cost.0 <= s.cost.0 && o.bound(f).unwrap() <= o.bound(m).unwrap());
            assert!(dominated, "member {m} is neither on the front nor behind it");
        }
    }

    #[test]
    fn a_gap_stays_a_gap() {
        let (study, mut values, mut records) = made();
        let lost = study.lines[0].members[0].0;
        values[lost][0] = Err("no result".into());
        records[lost].failure = Some("diverged".into());
        let o = judge(&study, &values, &records, Measure::Wall);
        assert_eq!(o.members[lost].gap.as_deref(), Some("diverged"));
        assert!(o.members[lost].worst.is_none() && !o.front.contains(&lost));
        assert!(o.lines[0][0].errors[0].is_none() && o.lines[0][0].errors[1].is_some());
        assert_eq!(o.lines[0][0].convergence.as_ref().unwrap().behaviour, Behaviour::TooFew);
    }
}
