//! The converged answer of a quantity, and the error of a sample against it.
//!
//! The answer is the exact one where a quantity has it. Else it is the base sample's value plus the
//! extrapolated change of each parameter, $\phi=\phi_b+\sum_d(\phi_{d,0}-\phi_b)$; parameters of the sweep count once,
//! with the sweep. Its uncertainty is the root of the sum of the squares of those of the limits.
//!
//! Errors of different signs cancel by chance: a coarse sample may hit the answer. The error of a sample is
//! therefore the sum of the errors of its parameters, each alone, as if nothing cancelled, or its
//! distance from the answer where that is more.

use super::convergence::{Behaviour, Convergence, converge, sizes};
use super::study::{Line, SWEEP, Study};

/// Value of a sample; `None` where it has none.
pub type Values<'a> = &'a dyn Fn(usize) -> Option<f64>;

/// The converged answer of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Its value.
    pub value: f64,
    /// Half width of its band.
    pub uncertainty: f64,
    /// Reference value of relative errors.
    pub scale: f64,
    /// The scene names it.
    pub exact: bool,
}

/// An error and the half width of its band, both relative to the scale of the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Estimated error.
    pub error: f64,
    /// Half width of the band about it.
    pub band: f64,
}

impl Estimate {
    /// What the true error is promised not to exceed.
    pub fn bound(self) -> f64 {
        self.error + self.band
    }
}

/// The answer of quantity `q`; `None` where no parameter of the study is assessed, or where it does not
/// converge with one of them.
pub fn answer(study: &Study, q: usize, value: Values<'_>) -> Option<Answer> {
    let quantity = &study.quantities[q];
    let with = |value: f64, uncertainty: f64, exact: bool| {
        let scale = quantity.scale.unwrap_or(value.abs());
        // An answer of 0 has no relative error: the errors are then absolute.
        Answer { value, uncertainty, scale: if scale > 0.0 { scale } else { 1.0 }, exact }
    };
    if let Some(exact) = quantity.exact {
        return Some(with(exact, 0.0, true));
    }
    let base = value(0)?;
    if study.lines.iter().any(|l| diverges(l, value)) {
        return None;
    }
    let sweep = study.lines.iter().find(|l| l.name == SWEEP && limit(l, value).is_some());
    let (mut sum, mut square, mut assessed) = (base, 0.0, false);
    for line in study.lines.iter().filter(|l| counts_once(study, l, sweep)) {
        let Some(c) = limit(line, value) else { continue };
        sum += c.limit - base;
        square += c.limit_uncertainty * c.limit_uncertainty;
        assessed = true;
    }
    assessed.then(|| with(sum, square.sqrt(), false))
}

/// The error of `sample` against `answer`; `None` where it has no value, or stands at a value of a
/// parameter that is not assessed.
pub fn estimate(study: &Study, sample: usize, answer: &Answer, value: Values<'_>) -> Option<Estimate> {
    let apart = (value(sample)? - answer.value).abs();
    let error = if answer.exact { apart } else { apart.max(summed(study, sample, value)?) };
    Some(Estimate { error: error / answer.scale, band: answer.uncertainty / answer.scale })
}

/// Values of the samples of a line with their sizes.
fn sound(line: &Line, value: Values<'_>) -> Vec<(f64, f64)> {
    line.samples.iter().filter_map(|&(m, size)| Some((size?, value(m)?))).collect()
}

/// Convergence of the samples of a line.
pub fn limit(line: &Line, value: Values<'_>) -> Option<Convergence> {
    converge(&sound(line, value), line.promised)
}

fn diverges(line: &Line, value: Values<'_>) -> bool {
    limit(line, value).is_some_and(|c| c.behaviour == Behaviour::Diverging)
}

/// Why a line says nothing of a quantity; `None` where it does.
pub fn unassessed(line: &Line, value: Values<'_>) -> Option<String> {
    if diverges(line, value) {
        return Some(
            "its changes grow as the value is refined: take finer values, a longer stage or a later `from_s`, or leave the \
             quantity out (the peak of an impulsive start and a singular point have no limit)"
                .into(),
        );
    }
    let numeric = line.samples.iter().any(|m| m.1.is_some());
    let have = if numeric {
        sizes(&sound(line, value))
    } else {
        line.samples.iter().filter(|m| value(m.0).is_some()).count()
    };
    let all = line.samples.len();
    (have < 2).then(|| match all {
        0 | 1 => "a single value: two or more are needed".into(),
        _ => format!("{have} of {all} samples have a value: two or more are needed"),
    })
}

/// Whether the error of a line counts beside those of the others: of the sweep in the first place.
fn counts_once(study: &Study, line: &Line, sweep: Option<&Line>) -> bool {
    if line.name == SWEEP {
        return sweep.is_some();
    }
    let swept = |at: &usize| sweep.is_some_and(|w| w.parameters.contains(at));
    !line.parameters.iter().any(swept) && !covered(study, &line.name)
}

/// Sum of the errors of the parameters at the settings of a sample, each alone, as if no error cancelled
/// another.
fn summed(study: &Study, sample: usize, value: Values<'_>) -> Option<f64> {
    let settings = &study.samples[sample].settings;
    let mut sum = 0.0;
    for line in study.lines.iter().filter(|l| l.name != SWEEP && !covered(study, &l.name)) {
        let Some(&parameter) = line.parameters.first() else { continue };
        let at_base = study.samples[0].settings[parameter] == settings[parameter];
        let same = |m: &usize| study.samples[*m].settings[parameter] == settings[parameter];
        let numeric = line.samples.iter().any(|m| m.1.is_some());
        let Some(against) = (if numeric { limit(line, value).map(|c| c.limit) } else { value(0) }) else {
            // Not assessed: reported as such at the base, unknown elsewhere.
            if at_base {
                continue;
            } else {
                return None;
            };
        };
        // A setting that the line does not have is finer than the base (the check of the sweep).
        let on = line.samples.iter().map(|m| m.0).chain(line.check.map(|c| c.0));
        let at = if at_base { 0 } else { on.into_iter().find(same).unwrap_or(0) };
        sum += (value(at)? - against).abs();
    }
    Some(sum)
}

/// `grid` varies what `structure-grid` and `flow-grid` vary.
pub fn covered(study: &Study, name: &str) -> bool {
    matches!(name, "structure-grid" | "flow-grid") && study.lines.iter().any(|l| l.name == "grid")
}
