//! Evaluation of a study: errors, orders, uncertainties and Pareto fronts from values and costs.

use super::answer::{Answer, Estimate, Values, answer, estimate, limit, unassessed};
use super::convergence::Convergence;
use super::cost::{Cost, spread};
use super::front::front;
use super::runs::Record;
use super::study::{Line, Study};

/// A value, or the reason why it is missing.
pub type Value = Result<f64, String>;

/// Measure of cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Measure {
    /// Wall time
    #[default]
    Wall,
    /// Processor time of all programs, including the busy waiting of MPI
    Cpu,
    /// Weighted counts in seconds of one core, independent of the load of the machine
    Work,
}

impl Measure {
    /// Label of an axis.
    pub fn label(self) -> &'static str {
        match self {
            Self::Wall => "wall time, s",
            Self::Cpu => "processor time, s",
            Self::Work => "work (weighted counts), s",
        }
    }

    /// Cost of a run, s.
    pub fn of(self, cost: &Cost) -> f64 {
        match self {
            Self::Wall => cost.wall_s,
            Self::Cpu => cost.cpu_s,
            Self::Work => cost.counts().work(),
        }
    }
}

/// Relative difference up to which errors count as equal to that of the base.
const SAME: f64 = 0.05;
/// Maximum relative cost of a sample that is reported as cheaper than the base.
const CHEAPER: f64 = 0.9;
/// Round-off, relative to the scale.
const ROUND_OFF: f64 = 1e-9;

/// Whether a distance is within an uncertainty, up to round-off.
pub fn within(far: f64, band: f64) -> bool {
    far <= band + ROUND_OFF
}

/// Evaluation of a line for one quantity.
#[derive(Clone, Debug)]
pub struct Judged {
    /// Convergence; `None` for choices, or without an estimate.
    pub convergence: Option<Convergence>,
    /// For each sample: error relative to the limit of the line (for choices: change from the base) and its uncertainty,
    /// relative to the scale.
    pub errors: Vec<Option<(f64, f64)>>,
    /// For the check sample: distance from the finest sample of the line, and the uncertainty of that, relative to the
    /// scale.
    pub check: Option<(f64, f64)>,
    /// Reason why there is no estimate.
    pub unassessed: Option<String>,
}

/// The largest error of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Largest {
    /// Index of the quantity.
    pub quantity: usize,
    /// Error and uncertainty of this quantity.
    pub estimate: Estimate,
}

/// Evaluation of a sample.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Median and half range of the cost, s.
    pub cost: (f64, f64),
    /// Median and half range of the cost relative to the base of the same round.
    pub ratio: (f64, f64),
    /// Values of the quantities.
    pub values: Vec<Option<f64>>,
    /// Distances from the extrapolated values, relative to their scales.
    pub distances: Vec<Option<f64>>,
    /// Errors and uncertainties.
    pub estimates: Vec<Option<Estimate>>,
    /// Largest error; `None` if an error is unknown.
    pub largest: Option<Largest>,
    /// Reason of a failure.
    pub gap: Option<String>,
}

/// Results of a study.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Measure of cost.
    pub measure: Measure,
    /// Extrapolated values; `None` if not assessed.
    pub answers: Vec<Option<Answer>>,
    /// Evaluation of the lines: `[line][quantity]`.
    pub lines: Vec<Vec<Judged>>,
    /// Samples.
    pub samples: Vec<Standing>,
    /// Pareto front of cost and largest error, by increasing cost.
    pub front: Vec<usize>,
    /// Pareto front of each quantity.
    pub fronts: Vec<Vec<usize>>,
}

/// Evaluates a study from the values, `[sample][quantity]`, and the records.
pub fn judge(study: &Study, values: &[Vec<Value>], records: &[Record], measure: Measure) -> Outcome {
    let value = |sample: usize, q: usize| values[sample][q].as_ref().ok().copied();
    let quantities = 0..study.quantities.len();
    let answers: Vec<Option<Answer>> =
        quantities.clone().map(|q| answer(study, q, &|m| value(m, q))).collect();
    let lines = study
        .lines
        .iter()
        .map(|line| {
            let scale = |q: usize| answers[q].map_or(f64::NAN, |a| a.scale);
            quantities.clone().map(|q| judged(line, &|m| value(m, q), scale(q))).collect()
        })
        .collect();
    let base: Vec<f64> = records[0].runs.iter().map(|c| measure.of(c)).collect();
    let samples: Vec<Standing> = (0..study.samples.len())
        .map(|m| standing(study, m, values, &records[m], &answers, (measure, &base)))
        .collect();
    let known = |m: usize, e: Option<Estimate>| (study.reference != Some(m)).then_some(e).flatten();
    let points = |of: &dyn Fn(&Standing) -> Option<Estimate>| -> Vec<Option<(f64, Estimate)>> {
        samples.iter().enumerate().map(|(m, s)| Some((s.cost.0, known(m, of(s))?))).collect()
    };
    let front_all = front(&points(&|s| Some(s.largest?.estimate)));
    let fronts = quantities.map(|q| front(&points(&|s| s.estimates[q]))).collect();
    Outcome { measure, answers, lines, front: front_all, fronts, samples }
}

fn standing(
    study: &Study,
    m: usize,
    values: &[Vec<Value>],
    record: &Record,
    answers: &[Option<Answer>],
    (measure, base): (Measure, &[f64]),
) -> Standing {
    let own: Vec<Option<f64>> = values[m].iter().map(|v| v.as_ref().ok().copied()).collect();
    let distances =
        own.iter().zip(answers).map(|(v, a)| Some(((*v)? - (*a)?.value).abs() / (*a)?.scale)).collect();
    let gap = record.failure.clone().or_else(|| values[m].iter().find_map(|v| v.as_ref().err().cloned()));
    let of = |(q, a): (usize, &Option<Answer>)| {
        let value = |m: usize| values[m][q].as_ref().ok().copied();
        estimate(study, m, a.as_ref()?, &value).filter(|_| gap.is_none())
    };
    let estimates: Vec<Option<Estimate>> = answers.iter().enumerate().map(of).collect();
    let runs = &record.runs;
    Standing {
        cost: spread(runs.iter().map(|c| measure.of(c))),
        ratio: spread(runs.iter().zip(base).map(|(c, b)| measure.of(c) / b)),
        values: own,
        distances,
        largest: largest(&estimates),
        estimates,
        gap,
    }
}

/// Largest error over the quantities, with the uncertainty of that quantity.
fn largest(estimates: &[Option<Estimate>]) -> Option<Largest> {
    let all = estimates.iter().copied().collect::<Option<Vec<_>>>()?;
    let at = |(quantity, estimate)| Largest { quantity, estimate };
    all.into_iter().enumerate().map(at).max_by(|a, b| a.estimate.error.total_cmp(&b.estimate.error))
}

fn judged(line: &Line, value: Values<'_>, scale: f64) -> Judged {
    let unassessed = unassessed(line, value);
    let nothing = vec![None; line.samples.len()];
    if unassessed.is_some() || !scale.is_finite() {
        return Judged { convergence: None, errors: nothing, check: None, unassessed };
    }
    let Some(c) = limit(line, value) else {
        // Choices: change of each from the base, which is sample 0.
        let change = |m: usize| Some(((value(m)? - value(0)?).abs() / scale, 0.0));
        let errors = line.samples.iter().map(|&(m, _)| change(m)).collect();
        return Judged { convergence: None, errors, check: None, unassessed };
    };
    let mut bands = c.uncertainty.iter();
    let mut finest: Option<(f64, f64, f64)> = None;
    let errors = line
        .samples
        .iter()
        .map(|&(m, size)| {
            let (size, v) = (size?, value(m)?);
            let band = *bands.next()?;
            if finest.is_none_or(|f| size < f.0) {
                finest = Some((size, v, band));
            }
            Some(((v - c.limit).abs() / scale, band / scale))
        })
        .collect();
    let check = line.check.and_then(|(m, _)| {
        let (_, v, band) = finest?;
        Some(((value(m)? - v).abs() / scale, band / scale))
    });
    Judged { convergence: Some(c), errors, check, unassessed }
}

impl Outcome {
    /// Reason why quantity `q` is not assessed, for each parameter.
    pub fn why_not(&self, study: &Study, q: usize) -> String {
        let lines = study.lines.iter().zip(&self.lines);
        let reasons: Vec<String> = lines
            .filter_map(|(line, judged)| {
                Some(format!("`{}`: {}", line.name, judged[q].unassessed.as_deref()?))
            })
            .collect();
        if reasons.is_empty() { "no parameter is varied".into() } else { reasons.join("; ") }
    }

    /// Bound of the true errors of a sample: the largest sum of error and uncertainty over the quantities, with the index
    /// of its quantity.
    pub fn bound(&self, sample: usize) -> Option<(usize, f64)> {
        let all = self.samples[sample].estimates.iter().map(|e| e.map(Estimate::bound));
        let all = all.collect::<Option<Vec<_>>>()?;
        all.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Whether `sample` is as accurate as the base for quantity `q`: its error is at most 5 % larger, and its value differs
    /// from that of the base by at most 5 % of the error of the base. This holds for any exact value within the
    /// uncertainty.
    pub fn as_accurate(&self, sample: usize, q: usize) -> bool {
        let (own, base) = (&self.samples[sample], &self.samples[0]);
        let both = || {
            let scale = self.answers[q]?.scale;
            let apart = (own.values[q]? - base.values[q]?).abs() / scale;
            Some((own.estimates[q]?.error, base.estimates[q]?.error, apart))
        };
        both().is_some_and(|(e, b, apart)| e <= (1.0 + SAME) * b && apart <= SAME * b)
    }

    /// The cheapest sample that is as accurate as the base in all `quantities`, and its cost relative to the base; `None`
    /// if none costs less than [`CHEAPER`].
    pub fn cheaper(&self, quantities: &[usize]) -> Option<(usize, f64)> {
        let share = |m: usize| self.samples[m].cost.0 / self.samples[0].cost.0;
        (1..self.samples.len())
            .filter(|&m| share(m) < CHEAPER && quantities.iter().all(|&q| self.as_accurate(m, q)))
            .map(|m| (m, share(m)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Number of check samples within the stated uncertainty, and number of check samples.
    pub fn held(&self) -> (usize, usize) {
        let all = || self.lines.iter().flatten().filter_map(|j| j.check);
        (all().filter(|(far, band)| within(*far, *band)).count(), all().count())
    }
}

#[cfg(test)]
#[path = "judge_tests.rs"]
pub(super) mod tests;
