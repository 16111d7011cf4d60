//! The extrapolated value of a quantity, and the error of a sample relative to it.
//!
//! The extrapolated value is the exact value if the scene gives one. Otherwise it is the value of the base plus the
//! extrapolated change of each parameter, $`\phi=\phi_b+\sum_d(\phi_{d,0}-\phi_b)`$. The parameters of the sweep count
//! once, with the sweep. The uncertainty is the root of the sum of squares of the uncertainties of the limits.
//!
//! Errors of different sign can cancel by chance, so that a coarse sample matches the extrapolated value. The error of
//! a sample is therefore the sum of the error magnitudes of its parameters, or its distance from the extrapolated value
//! if that is larger.

use super::convergence::{Behaviour, Convergence, converge, sizes};
use super::study::{Line, SWEEP, Study};

/// Value of each sample; `None` if it failed.
pub type Values<'a> = &'a dyn Fn(usize) -> Option<f64>;

/// Extrapolated value of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Value, in the unit of the quantity.
    pub value: f64,
    /// Uncertainty (half width), in the same unit.
    pub uncertainty: f64,
    /// Reference value of relative errors.
    pub scale: f64,
    /// Whether the scene gives the exact value.
    pub exact: bool,
}

/// An estimated error and its uncertainty, relative to the scale of the extrapolated value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Estimated error.
    pub error: f64,
    /// Uncertainty (half width).
    pub band: f64,
}

impl Estimate {
    /// Bound of the true error.
    pub fn bound(self) -> f64 {
        self.error + self.band
    }
}

/// Extrapolated value of quantity `q`; `None` if no parameter can be assessed or the quantity diverges with one.
pub fn answer(study: &Study, q: usize, value: Values<'_>) -> Option<Answer> {
    let quantity = &study.quantities[q];
    let with = |value: f64, uncertainty: f64, exact: bool| {
        let scale = quantity.scale.unwrap_or(value.abs());
        // Errors are absolute if the extrapolated value is 0.
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

/// Error of `sample` relative to `answer`; `None` if the sample failed or has a setting that cannot be assessed.
pub fn estimate(study: &Study, sample: usize, answer: &Answer, value: Values<'_>) -> Option<Estimate> {
    let distance = (value(sample)? - answer.value).abs();
    let error = if answer.exact { distance } else { distance.max(summed(study, sample, value)?) };
    Some(Estimate { error: error / answer.scale, band: answer.uncertainty / answer.scale })
}

/// Size and value of the successful samples of a line.
fn successful(line: &Line, value: Values<'_>) -> Vec<(f64, f64)> {
    line.samples.iter().filter_map(|&(m, size)| Some((size?, value(m)?))).collect()
}

/// Convergence of the samples of a line.
pub fn limit(line: &Line, value: Values<'_>) -> Option<Convergence> {
    converge(&successful(line, value), line.promised)
}

fn diverges(line: &Line, value: Values<'_>) -> bool {
    limit(line, value).is_some_and(|c| c.behaviour == Behaviour::Diverging)
}

/// Reason why a line gives no estimate for a quantity; `None` if it gives one.
pub fn unassessed(line: &Line, value: Values<'_>) -> Option<String> {
    if diverges(line, value) {
        return Some(
            "its changes grow with refinement. Use finer values, a longer stage or a later `from_s`, or remove the quantity \
             (the peak of an impulsive start and a singular point have no limit)"
                .into(),
        );
    }
    let numeric = line.samples.iter().any(|m| m.1.is_some());
    let have = if numeric {
        sizes(&successful(line, value))
    } else {
        line.samples.iter().filter(|m| value(m.0).is_some()).count()
    };
    let all = line.samples.len();
    (have < 2).then(|| match all {
        0 | 1 => "a single value; at least two are needed".into(),
        _ => format!("{have} of {all} samples have a value; at least two are needed"),
    })
}

/// Whether the change of a line is added: the sweep replaces the lines of its parameters.
fn counts_once(study: &Study, line: &Line, sweep: Option<&Line>) -> bool {
    if line.name == SWEEP {
        return sweep.is_some();
    }
    let swept = |at: &usize| sweep.is_some_and(|w| w.parameters.contains(at));
    !line.parameters.iter().any(swept) && !covered(study, &line.name)
}

/// Sum of the error magnitudes of the parameters at the settings of a sample.
fn summed(study: &Study, sample: usize, value: Values<'_>) -> Option<f64> {
    let settings = &study.samples[sample].settings;
    let mut sum = 0.0;
    for line in study.lines.iter().filter(|l| l.name != SWEEP && !covered(study, &l.name)) {
        let Some(&parameter) = line.parameters.first() else { continue };
        let at_base = study.samples[0].settings[parameter] == settings[parameter];
        let same = |m: &usize| study.samples[*m].settings[parameter] == settings[parameter];
        let numeric = line.samples.iter().any(|m| m.1.is_some());
        let Some(against) = (if numeric { limit(line, value).map(|c| c.limit) } else { value(0) }) else {
            // Not assessed: listed separately for the base, unknown for other samples.
            if at_base {
                continue;
            } else {
                return None;
            };
        };
        // A setting outside the line belongs to the check sample of the sweep, which is finer than the base.
        let on = line.samples.iter().map(|m| m.0).chain(line.check.map(|c| c.0));
        let at = if at_base { 0 } else { on.into_iter().find(same).unwrap_or(0) };
        sum += (value(at)? - against).abs();
    }
    Some(sum)
}

/// Whether `name` is part of another line: `grid` varies both `structure-grid` and `flow-grid`.
pub fn covered(study: &Study, name: &str) -> bool {
    matches!(name, "structure-grid" | "flow-grid") && study.lines.iter().any(|l| l.name == "grid")
}
