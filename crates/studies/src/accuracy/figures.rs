//! The figures of a study.

use std::path::Path;

use coupling::error::RunError;
use results::summary::STAGE_PARTS;

use super::answer::Estimate;
use super::chart::{Axis, Bar, COLOURS, Figure, GREY, INK, Mark, Panel, Series, short};
use super::fly::Record;
use super::judge::Outcome;
use super::study::{SWEEP, Study};

/// Errors below this share are not shown on logarithmic axes.
const LEAST: f64 = 1e-9;
const ERROR: &str = "error, percent";
const FRONT: [f32; 3] = [0.75, 0.10, 0.10];

/// A drawn figure: name of its files, words above it, its SVG text.
pub struct Drawn {
    /// `<name>.svg`, `<name>.png`.
    pub name: &'static str,
    /// What it shows.
    pub words: &'static str,
    /// The SVG.
    pub svg: String,
}

/// Draws all figures into `out`.
///
/// # Errors
/// Trouble with the files.
pub fn draw(
    out: &Path,
    study: &Study,
    outcome: &Outcome,
    records: &[Record],
) -> Result<Vec<Drawn>, RunError> {
    let all = [
        (
            "cost",
            "Largest error of each sample over all quantities against its cost, with the uncertainty of the quantity \
             that has it. The red line is the Pareto front: a sample joins it only if it is better than all cheaper ones by \
             more than the uncertainty. The ring is the base.",
            Figure::Panels(vec![members_panel(study, outcome)]),
        ),
        (
            "fronts",
            "Error of each quantity alone against cost, with its own uncertainty and its own Pareto front.",
            Figure::Panels(quantity_panels(study, outcome)),
        ),
        (
            "values",
            "Value of each sample against its cost. Shaded: the extrapolated answer with its uncertainty.",
            Figure::Panels(value_panels(study, outcome)),
        ),
        (
            "parameters",
            "Each parameter alone: its own error, against its own limit, over the cost of the whole run.",
            Figure::Panels(dial_panels(study, outcome, false)),
        ),
        (
            "orders",
            "Own error against the parameter, with the fitted order. Finer values are on the left.",
            Figure::Panels(dial_panels(study, outcome, true)),
        ),
        (
            "time",
            "Where the time goes along the front: wall seconds by stage and program.",
            Figure::Bars("s".into(), bars(study, outcome, records)),
        ),
    ];
    all.into_iter()
        .map(|(name, words, figure)| Ok(Drawn { name, words, svg: figure.save(out, name)? }))
        .collect()
}

fn percent(share: f64) -> f64 {
    100.0 * share.max(LEAST)
}

fn plain(name: &str, colour: [f32; 3], points: Vec<([f64; 2], f64)>) -> Series {
    Series { name: name.into(), colour, points, mark: Mark::Dot, line: 0.0, notes: Vec::new() }
}

/// Axes around all points of the series.
fn panel(
    title: &str,
    x: (&str, bool),
    y: (&str, bool),
    series: Vec<Series>,
    band: Option<[f64; 2]>,
) -> Panel {
    let points = || series.iter().flat_map(|s| &s.points);
    let across = Axis::around(x.0, x.1, points().map(|p| p.0[0]));
    let extra = band.into_iter().flatten();
    let up = Axis::around(y.0, y.1, points().map(|p| p.0[1]).chain(extra));
    Panel { title: title.into(), x: across, y: up, series, band }
}

type Errors<'a> = &'a dyn Fn(usize) -> Option<Estimate>;

/// Errors of the samples against cost with a Pareto front; with names where `named`.
fn error_panel(
    study: &Study,
    outcome: &Outcome,
    (title, named): (&str, bool),
    front: &[usize],
    error: Errors<'_>,
) -> Panel {
    let at = |m: usize| {
        let e = error(m)?;
        Some(([outcome.members[m].cost.0, percent(e.error)], 100.0 * e.band))
    };
    let name = |text: &str| if named { text.to_owned() } else { String::new() };
    let mut series = Vec::new();
    for (i, line) in study.lines.iter().enumerate() {
        let points = line.members.iter().map(|m| m.0).filter_map(at).collect();
        series.push(plain(&name(&line.name), COLOURS[i % COLOURS.len()], points));
    }
    let points: Vec<_> = front.iter().filter_map(|&m| at(m)).map(|p| (p.0, 0.0)).collect();
    let notes = front.iter().enumerate().map(|(i, &m)| (i, study.members[m].label.clone())).collect();
    let name_front = name("Pareto front");
    series.push(Series { name: name_front, colour: FRONT, points, mark: Mark::None, line: 1.6, notes });
    let base = at(0).into_iter().map(|p| (p.0, 0.0)).collect();
    series.push(Series { mark: Mark::Ring, ..plain(&name("base"), INK, base) });
    panel(title, (outcome.measure.label(), true), (ERROR, true), series, None)
}

fn members_panel(study: &Study, outcome: &Outcome) -> Panel {
    let error = |m: usize| outcome.members[m].largest.map(|l| l.estimate);
    error_panel(study, outcome, ("largest error of all quantities", true), &outcome.front, &error)
}

fn quantity_panels(study: &Study, outcome: &Outcome) -> Vec<Panel> {
    let one = |(q, quantity): (usize, &case::Quantity)| {
        let error = |m: usize| outcome.members[m].estimates[q];
        error_panel(study, outcome, (&quantity.name, q == 0), &outcome.fronts[q], &error)
    };
    study.quantities.iter().enumerate().map(one).collect()
}

fn value_panels(study: &Study, outcome: &Outcome) -> Vec<Panel> {
    let one = |(q, quantity): (usize, &case::Quantity)| {
        let mut series = Vec::new();
        let at = |m: usize| {
            let s = &outcome.members[m];
            s.values[q].map(|v| ([s.cost.0, v], 0.0))
        };
        for (i, line) in study.lines.iter().enumerate() {
            let points = line
                .members
                .iter()
                .enumerate()
                .filter_map(|(k, m)| {
                    // The band of the line itself.
                    let band = outcome.lines[i][q].errors[k].map_or(0.0, |e| e.1)
                        * outcome.answers[q].map_or(0.0, |a| a.scale);
                    let band = if line.name == SWEEP { band } else { 0.0 };
                    at(m.0).map(|p| (p.0, band))
                })
                .collect();
            series.push(plain(if q == 0 { &line.name } else { "" }, COLOURS[i % COLOURS.len()], points));
        }
        series.push(Series { mark: Mark::Ring, ..plain("", INK, at(0).into_iter().collect()) });
        let band = outcome.answers[q].map(|a| [a.value - a.uncertainty, a.value + a.uncertainty]);
        panel(&quantity.name, (outcome.measure.label(), true), (&quantity.name, false), series, band)
    };
    study.quantities.iter().enumerate().map(one).collect()
}

/// For each line: own errors over the cost, or over the parameter with the fits.
fn dial_panels(study: &Study, outcome: &Outcome, over_dial: bool) -> Vec<Panel> {
    let mut panels = Vec::new();
    for (i, line) in study.lines.iter().enumerate() {
        if over_dial && line.members.iter().any(|m| m.1.is_none()) {
            continue;
        }
        let mut series = Vec::new();
        for (q, quantity) in study.quantities.iter().enumerate() {
            let judged = &outcome.lines[i][q];
            let colour = COLOURS[q % COLOURS.len()];
            let points: Vec<_> = line
                .members
                .iter()
                .zip(&judged.errors)
                .filter_map(|(&(m, size), e)| {
                    let (error, _) = (*e)?;
                    let x = if over_dial { size? } else { outcome.members[m].cost.0 };
                    (error > LEAST).then(|| ([x, percent(error)], 0.0))
                })
                .collect();
            let notes = if over_dial || points.is_empty() {
                Vec::new()
            } else if q == 0 {
                let shown =
                    line.members.iter().zip(&judged.errors).filter(|(_, e)| e.is_some_and(|e| e.0 > LEAST));
                shown.enumerate().map(|(k, ((m, _), _))| (k, setting(study, line, *m))).collect()
            } else {
                Vec::new()
            };
            let joined = if over_dial { 0.0 } else { 1.0 };
            let name = if panels.is_empty() { &quantity.name } else { "" };
            series.push(Series { line: joined, notes, ..plain(name, colour, points) });
            if let Some(fit) =
                over_dial.then(|| fitted(line, judged, outcome.answers[q].map_or(1.0, |a| a.scale))).flatten()
            {
                series.push(Series { colour, ..fit });
            }
        }
        let x = if over_dial { format!("{} (size)", line.name) } else { outcome.measure.label().into() };
        panels.push(panel(&line.name, (&x, true), (ERROR, true), series, None));
    }
    panels
}

fn setting(study: &Study, line: &super::study::Line, member: usize) -> String {
    line.dials.first().map_or_else(String::new, |&d| study.members[member].settings[d].to_string())
}

fn fitted(line: &super::study::Line, judged: &super::judge::Judged, scale: f64) -> Option<Series> {
    let c = judged.convergence.as_ref()?;
    let order = c.order?;
    let sizes = line.members.iter().filter_map(|m| m.1);
    let (low, high) = sizes.fold((f64::MAX, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
    let at = |h: f64| ([h, percent((c.slope * h.powf(order)).abs() / scale)], 0.0);
    let points: Vec<_> = (0..=12).map(|i| at(low * (high / low).powf(f64::from(i) / 12.0))).collect();
    let notes = vec![(6, format!("order {}", short(order)))];
    Some(Series { name: String::new(), colour: GREY, points, mark: Mark::None, line: 1.0, notes })
}

/// Along the front, with the base point.
fn bars(study: &Study, outcome: &Outcome, records: &[Record]) -> Vec<Bar> {
    let mut shown: Vec<usize> = outcome.front.clone();
    if !shown.contains(&0) {
        shown.push(0);
    }
    let mut bars = Vec::new();
    for m in shown {
        let Some(cost) = records[m].runs.first() else { continue };
        let mut parts = Vec::new();
        for (s, stage) in cost.stages.iter().enumerate() {
            for (p, (_, part)) in STAGE_PARTS.iter().enumerate() {
                // One hue for a program, paler for earlier stages.
                let pale = 0.62 * (cost.stages.len() - 1 - s) as f32 / cost.stages.len().max(2) as f32;
                let colour = COLOURS[p].map(|c| c + pale * (1.0 - c));
                parts.push((format!("{} {part}", stage.name), colour, stage.parts_s[p]));
            }
        }
        let whole: f64 = parts.iter().map(|p| p.2).sum();
        parts.push(("starting".into(), [0.8, 0.8, 0.8], (cost.wall_s - whole).max(0.0)));
        let name = if m == 0 {
            format!("{} (base)", study.members[m].label)
        } else {
            study.members[m].label.clone()
        };
        bars.push(Bar { label: name.replace("base (base)", "base"), parts });
    }
    bars
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn six_figures_of_a_made_up_study() {
        let (study, values, records) = made();
        let outcome = judge(&study, &values, &records, Measure::Work);
        let folder = tempfile::tempdir().unwrap();
        let drawn = draw(folder.path(), &study, &outcome, &records).unwrap();
        assert_eq!(drawn.len(), 6);
        let text = |name: &str| &drawn.iter().find(|d| d.name == name).unwrap().svg;
        assert!(text("cost").contains("Pareto front") && text("orders").contains("order 2"));
        assert!(text("time").contains("descent flow"));
        for d in &drawn {
            assert!(!d.svg.contains("NaN") && !d.svg.contains("inf"), "{}", d.name);
            if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
                std::fs::copy(
                    folder.path().join(format!("{}.png", d.name)),
                    Path::new(&keep).join(format!("{}.png", d.name)),
                )
                .unwrap();
            }
        }
    }
}
