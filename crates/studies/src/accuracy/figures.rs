//! The figures of a study.

use std::path::Path;

use coupling::error::RunError;
use figures::chart::{Axis, Bar, Bars, Figure, Mark, Panel, Panels, Part, Series, Svg, WIDTH, short};
use figures::colour::{Colour, GREY, INK, pale, series};
use results::summary::STAGE_PARTS;

use super::answer::Estimate;
use super::judge::Outcome;
use super::runs::Record;
use super::study::{SWEEP, Study};

/// Smallest relative error on logarithmic axes.
const MIN_ERROR: f64 = 1e-9;
const ERROR: &str = "error, %";
/// Size of a panel in a row of two, and of a single panel: width and height, pixels.
const PANEL: [f64; 2] = [0.5 * WIDTH, 340.0];
const WIDE: [f64; 2] = [WIDTH, 440.0];

/// A figure with its file name and caption.
pub struct Drawn {
    /// `<name>.svg`, `<name>.png`.
    pub name: &'static str,
    /// Caption.
    pub words: &'static str,
    /// The SVG.
    pub svg: Svg,
}

/// Draws all figures into `out`.
///
/// # Errors
/// A file cannot be written.
pub fn draw(
    out: &Path,
    study: &Study,
    outcome: &Outcome,
    records: &[Record],
) -> Result<Vec<Drawn>, RunError> {
    let all = [
        (
            "cost",
            "Largest error of each sample over all quantities, %, against its cost, s, with the uncertainty of that \
             quantity. Dark line: Pareto front; a sample is on it if its error is smaller than that of every cheaper \
             sample on it by more than the uncertainty. Ring: base.",
            panels(vec![samples_panel(study, outcome)]),
        ),
        (
            "fronts",
            "Error of each quantity, %, against cost, s, with its uncertainty and Pareto front.",
            panels(quantity_panels(study, outcome)),
        ),
        (
            "values",
            "Value of each sample, in the unit of the quantity, against its cost, s. Shaded: extrapolated value with its \
             uncertainty.",
            panels(value_panels(study, outcome)),
        ),
        (
            "parameters",
            "Error of each parameter alone relative to its own limit, %, against the cost of the run, s.",
            panels(parameter_panels(study, outcome, false)),
        ),
        (
            "orders",
            "Error of each parameter alone, %, against its size, with the fitted order. Finer values are on the left.",
            panels(parameter_panels(study, outcome, true)),
        ),
        (
            "time",
            "Wall time of the samples on the Pareto front by stage and program, s.",
            Figure::Bars(Bars {
                label: "wall time, s".into(),
                unit: "s".into(),
                rows: bars(study, outcome, records),
                shares: false,
            }),
        ),
    ];
    all.into_iter()
        .map(|(name, words, figure)| Ok(Drawn { name, words, svg: figure.save(out, name)? }))
        .collect()
}

/// Panels in rows of two; a single panel has the full width.
fn panels(panels: Vec<Panel>) -> Figure {
    let size = if panels.len() == 1 { WIDE } else { PANEL };
    Figure::Panels(Panels { panels, columns: 2, size })
}

fn percent(share: f64) -> f64 {
    100.0 * share.max(MIN_ERROR)
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
    let across = Axis::around(x.0, x.1, points().map(|p| p[0]));
    let extra = band.into_iter().flatten();
    let up = Axis::around(y.0, y.1, points().map(|p| p[1]).chain(extra));
    Panel { title: title.into(), x: across, y: up, series, band, references: Vec::new() }
}

type Errors<'a> = &'a dyn Fn(usize) -> Option<Estimate>;

/// A series of points with error bars (half widths).
fn banded(name: &str, colour: Colour, points: Vec<([f64; 2], f64)>) -> Series {
    let (points, bands) = points.into_iter().unzip();
    Series { bands, ..Series::dots(name, colour, points) }
}

/// The ring of the base sample.
fn base(point: Option<[f64; 2]>) -> Series {
    Series { mark: Mark::Ring, ..Series::dots("base", INK, point.into_iter().collect()) }
}

/// Errors of the samples against cost with a Pareto front.
fn error_panel(study: &Study, outcome: &Outcome, title: &str, front: &[usize], error: Errors<'_>) -> Panel {
    let at = |m: usize| {
        let e = error(m)?;
        Some(([outcome.samples[m].cost.0, percent(e.error)], 100.0 * e.band))
    };
    let mut all = Vec::new();
    for (i, line) in study.lines.iter().enumerate() {
        let points = line.samples.iter().map(|m| m.0).filter_map(at).collect();
        all.push(banded(&line.name, series(i), points));
    }
    let points = front.iter().filter_map(|&m| at(m)).map(|p| p.0).collect();
    let notes = front.iter().enumerate().map(|(i, &m)| (i, study.samples[m].label.clone())).collect();
    all.push(Series { line: 1.4, notes, ..Series::curve("Pareto front", INK, points) });
    all.push(base(at(0).map(|p| p.0)));
    panel(title, (outcome.measure.label(), true), (ERROR, true), all, None)
}

fn samples_panel(study: &Study, outcome: &Outcome) -> Panel {
    let error = |m: usize| outcome.samples[m].largest.map(|l| l.estimate);
    error_panel(study, outcome, "largest error over all quantities", &outcome.front, &error)
}

fn quantity_panels(study: &Study, outcome: &Outcome) -> Vec<Panel> {
    let one = |(q, quantity): (usize, &case::Quantity)| {
        let error = |m: usize| outcome.samples[m].estimates[q];
        error_panel(study, outcome, &quantity.name, &outcome.fronts[q], &error)
    };
    study.quantities.iter().enumerate().map(one).collect()
}

fn value_panels(study: &Study, outcome: &Outcome) -> Vec<Panel> {
    let one = |(q, quantity): (usize, &case::Quantity)| {
        let mut all = Vec::new();
        let at = |m: usize| {
            let s = &outcome.samples[m];
            s.values[q].map(|v| [s.cost.0, v])
        };
        let scale = outcome.answers[q].map_or(0.0, |a| a.scale);
        for (i, line) in study.lines.iter().enumerate() {
            let point = |(k, m): (usize, &(usize, Option<f64>))| {
                // Uncertainty of the line itself.
                let band = outcome.lines[i][q].errors[k].map_or(0.0, |e| e.1) * scale;
                at(m.0).map(|p| (p, if line.name == SWEEP { band } else { 0.0 }))
            };
            let points = line.samples.iter().enumerate().filter_map(point).collect();
            all.push(banded(&line.name, series(i), points));
        }
        all.push(base(at(0)));
        let band = outcome.answers[q].map(|a| [a.value - a.uncertainty, a.value + a.uncertainty]);
        panel(&quantity.name, (outcome.measure.label(), true), (&quantity.name, false), all, band)
    };
    study.quantities.iter().enumerate().map(one).collect()
}

/// For each line: its errors against the cost, or against the parameter with the fits.
fn parameter_panels(study: &Study, outcome: &Outcome, over_parameter: bool) -> Vec<Panel> {
    let mut panels = Vec::new();
    for (i, line) in study.lines.iter().enumerate() {
        if over_parameter && line.samples.iter().any(|m| m.1.is_none()) {
            continue;
        }
        let mut all = Vec::new();
        for (q, quantity) in study.quantities.iter().enumerate() {
            let judged = &outcome.lines[i][q];
            let shown = || {
                let samples = line.samples.iter().zip(&judged.errors);
                samples.filter_map(|(m, e)| e.map(|e| (*m, e.0))).filter(|(_, error)| *error > MIN_ERROR)
            };
            let place = |((m, size), error): ((usize, Option<f64>), f64)| {
                let x = if over_parameter { size? } else { outcome.samples[m].cost.0 };
                Some([x, percent(error)])
            };
            let points = shown().filter_map(place).collect();
            let mut own = Series::dots(&quantity.name, series(q), points);
            if !over_parameter {
                own.line = 1.0;
                if q == 0 {
                    own.notes =
                        shown().enumerate().map(|(k, ((m, _), _))| (k, setting(study, line, m))).collect();
                }
            }
            all.push(own);
            if over_parameter {
                let scale = outcome.answers[q].map_or(1.0, |a| a.scale);
                all.extend(fitted(line, judged, scale, series(q)));
            }
        }
        let x = if over_parameter { format!("{} (size)", line.name) } else { outcome.measure.label().into() };
        panels.push(panel(&line.name, (&x, true), (ERROR, true), all, None));
    }
    panels
}

fn setting(study: &Study, line: &super::study::Line, sample: usize) -> String {
    line.parameters.first().map_or_else(String::new, |&d| study.samples[sample].settings[d].to_string())
}

/// The fitted power law with its order.
fn fitted(
    line: &super::study::Line,
    judged: &super::judge::Judged,
    scale: f64,
    colour: Colour,
) -> Option<Series> {
    let c = judged.convergence.as_ref()?;
    let order = c.order?;
    let sizes = line.samples.iter().filter_map(|m| m.1);
    let (low, high) = sizes.fold((f64::MAX, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
    let at = |h: f64| [h, percent((c.slope * h.powf(order)).abs() / scale)];
    let points = (0..=12).map(|i| at(low * (high / low).powf(f64::from(i) / 12.0))).collect();
    let notes = vec![(6, format!("order {}", short(order)))];
    Some(Series { line: 1.0, notes, ..Series::curve("", colour, points) })
}

/// Samples on the front, and the base.
fn bars(study: &Study, outcome: &Outcome, records: &[Record]) -> Vec<Bar> {
    let mut shown: Vec<usize> = outcome.front.clone();
    if !shown.contains(&0) {
        shown.push(0);
    }
    let mut bars = Vec::new();
    for m in shown {
        let Some(cost) = records[m].runs.first() else { continue };
        let mut parts = Vec::new();
        let mut add = |name: String, colour, value| parts.push(Part { name, colour, value });
        for (s, stage) in cost.stages.iter().enumerate() {
            for (p, (_, part)) in STAGE_PARTS.iter().enumerate() {
                // One hue for a program, paler for earlier stages.
                let white = 0.62 * (cost.stages.len() - 1 - s) as f64 / cost.stages.len().max(2) as f64;
                add(format!("{} {part}", stage.name), pale(series(p), white), stage.parts_s[p]);
            }
        }
        let whole: f64 = cost.stages.iter().flat_map(|s| &s.parts_s).sum();
        add("launch".into(), pale(GREY, 0.6), (cost.wall_s - whole).max(0.0));
        let name = if m == 0 {
            format!("{} (base)", study.samples[m].label)
        } else {
            study.samples[m].label.clone()
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
    fn synthetic_study_has_six_figures() {
        let (study, values, records) = made();
        let outcome = judge(&study, &values, &records, Measure::Work);
        let folder = tempfile::tempdir().unwrap();
        let drawn = draw(folder.path(), &study, &outcome, &records).unwrap();
        assert_eq!(drawn.len(), 6);
        let text = |name: &str| drawn.iter().find(|d| d.name == name).unwrap().svg.file();
        assert!(text("cost").contains("Pareto front") && text("orders").contains("order 2"));
        assert!(text("time").contains("descent flow"));
        for d in &drawn {
            let svg = d.svg.file();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", d.name);
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
