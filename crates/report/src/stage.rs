//! What came of a stage: its curves, with what was measured on its snapshots.

use figures::plot;

use super::bars::Bars;
use super::chart::{Chart, Series, digits};
use super::data::{Run, StageData};
use super::document::{Block, Section, Table, coupled};
use super::frames::{Measure, StageFrames};
use super::panels::{MOTION, SOLVERS, charts};
use super::swings::{Swings, swings};
use super::{facts, origin};

/// The section of a stage.
pub(super) fn section(run: &Run, stage: &StageData, frames: Option<&StageFrames>) -> Section {
    let described = run.stage(stage);
    let name = &described.name;
    let id = anchor(name);
    let mut found = charts(MOTION, &stage.columns, &id);
    let falls = coupled(described.kind) && run.scene().descent.is_some();
    if !falls {
        // The speed is given, not found.
        found.retain(|c| c.title != "Descent speed");
    }
    for chart in &mut found {
        match chart.title.as_str() {
            "Descent speed" => {
                let published = plot::published(run.scene());
                chart.references = published.iter().map(|(v, n)| (*v, format!("{n} {v}"))).collect();
            }
            "Drag" => {
                chart.references =
                    facts::weight(run).map(|w| (w, format!("weight {}", digits(w)))).into_iter().collect();
                settle(chart);
            }
            _ => settle(chart),
        }
    }
    if let Some(frames) = frames {
        found.extend(from_snapshots(&frames.measures, &id));
    }
    let mut blocks = vec![Block::Charts(found), Block::Table(table(stage))];
    if coupled(described.kind)
        && let Some(table) = settled(stage)
    {
        blocks.push(Block::Text(SETTLED.into()));
        blocks.push(Block::Table(table));
    }
    if let Some(bars) = frames.and_then(|f| line_bars(f, &id)) {
        blocks.push(Block::Bars(bars));
    }
    Section {
        id,
        title: format!("Stage {name}"),
        lead: format!("{}: {}.", capital(origin::kind(described.kind)), facts::progress(run, stage)),
        blocks,
    }
}

/// How the solvers went in the main stage.
pub(super) fn solvers(run: &Run, stage: &StageData) -> Section {
    let name = &run.stage(stage).name;
    let found = charts(SOLVERS, &stage.columns, &format!("solvers-{}", anchor(name)));
    let blocks = if found.is_empty() { Vec::new() } else { vec![Block::Charts(found)] };
    Section {
        id: "solvers".into(),
        title: "How the solvers went".into(),
        lead: format!("Effort and health of the programs in stage {name}."),
        blocks,
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// A name as an anchor.
pub(super) fn anchor(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    format!("stage-{}", name.chars().map(plain).collect::<String>())
}

/// Leaves out a violent start that would flatten the rest of a curve: the first twentieth, where it spans
/// more than five times what follows. The chart says so.
fn settle(chart: &mut Chart) {
    let span = |points: &[(f64, f64)]| {
        let finite = points.iter().map(|p| p.1).filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    let cut = |s: &Series| s.points.len() / 20;
    let violent = chart.series.iter().any(|s| {
        let rest = span(&s.points[cut(s)..]);
        s.points.len() >= 40 && rest > 0.0 && span(&s.points) > 5.0 * rest
    });
    if violent {
        for series in &mut chart.series {
            let from = cut(series);
            series.points.drain(..from);
        }
        chart.note += " (The first twentieth, which is far off this scale, is left out.)";
    }
}

/// Curves of what was measured on the snapshots.
fn from_snapshots(measures: &[Measure], id: &str) -> Vec<Chart> {
    let curve = |label: &str, of: &dyn Fn(&Measure) -> f64| Series {
        label: label.into(),
        points: measures.iter().map(|m| (m.time, of(m))).collect(),
    };
    let chart = |name: &str, unit, note: &str, series| Chart {
        id: format!("{id}-{}", name.to_lowercase().replace(' ', "-")),
        title: name.into(),
        unit,
        note: note.into(),
        series,
        ..Chart::default()
    };
    let mut found = Vec::new();
    let Some(first) = measures.first() else { return found };
    let vents = first.vents.len();
    if vents > 0 {
        let mut series: Vec<Series> = Vec::new();
        if vents <= 5 {
            series.extend((0..vents).map(|v| curve(&format!("vent {}", v + 1), &|m| m.vents[v])));
        } else {
            series.push(curve("all vents", &|m| m.vents.iter().sum()));
        }
        let note = "Area of each opening in the fabric other than the skirt: what lets air out.";
        found.push(chart("Vent area", "m2", note, series));
    }
    if first.mouth > 0.0 {
        let note = "Horizontal area that the skirt, the lower edge of the fabric, encloses.";
        found.push(chart("Mouth area", "m2", note, vec![curve("mouth", &|m| m.mouth)]));
    }
    if first.tensions.is_some() {
        let of = |k: usize| move |m: &Measure| m.tensions.map_or(f64::NAN, |t| t[k]);
        let series = vec![curve("least", &of(0)), curve("mean", &of(1)), curve("largest", &of(2))];
        found.push(chart(
            "Tension of suspension lines",
            "N",
            "Least, mean and largest over all lines.",
            series,
        ));
    }
    if measures.iter().any(|m| m.states.iter().sum::<f64>() > 0.0) {
        let of = |k: usize| move |m: &Measure| 100.0 * m.states[k];
        let series = vec![curve("slack", &of(0)), curve("wrinkled", &of(1)), curve("taut", &of(2))];
        let note = "Share of the fabric that is pulled in no direction, in one, in two.";
        found.push(chart("State of the fabric", "%", note, series));
    }
    found.retain(|c| !c.is_empty());
    found
}

/// The largest tension of each line in the last snapshot.
fn line_bars(frames: &StageFrames, id: &str) -> Option<Bars> {
    let last = frames.measures.last()?;
    let of = |kind: u8| last.lines.iter().filter(move |l| l.0 == kind).map(|l| l.1).collect::<Vec<f64>>();
    let (lines, risers) = (of(0), of(1));
    if lines.is_empty() || lines.len() > 64 {
        return None;
    }
    let mut note = format!("Tension of each suspension line at {:.3} s, by its number.", last.time);
    if !risers.is_empty() {
        let list: Vec<String> = risers.iter().map(|t| digits(*t)).collect();
        note += &format!(" Risers, which join several lines: {} N.", list.join(", "));
    }
    let rows = lines.iter().enumerate().map(|(i, t)| ((i + 1).to_string(), vec![*t])).collect();
    Some(Bars {
        id: format!("{id}-lines"),
        title: "Tension of each line at the end, N".into(),
        label: "tension",
        unit: "N",
        note,
        parts: vec!["line"],
        rows,
        upright: true,
    })
}

/// Column, name, unit of what a stage comes to.
const MAIN: [(&str, &str, &str); 8] = [
    ("descent_speed_m_s", "descent speed", "m/s"),
    ("drag_n", "drag", "N"),
    ("cd", "drag coefficient", "1"),
    ("projected_area_m2", "projected area", "m2"),
    ("volume_m3", "volume", "m3"),
    ("riser_force_n", "force in the risers", "N"),
    ("max_line_tension_n", "largest line tension", "N"),
    ("structure_strain_energy_j", "elastic energy", "J"),
];

const SETTLED: &str = "What it settles to. The start is left out as far as the marginal standard error of the rest falls \
    (half of the stage at most). The period is the peak of the periodogram, if it has a quarter of the variance. The \
    interval of 95 % comes from the means of batches of whole periods: four at least, which must not follow one another.";

/// Means with intervals, and periods.
fn settled(stage: &StageData) -> Option<Table> {
    let row = |(name, label, unit): (&str, &str, &str)| {
        let Swings { from, mean, margin, period } = swings(&stage.columns.series(name))?;
        let (interval, batches) =
            margin.map_or(("-".into(), "-".into()), |(m, n)| (format!("± {}", digits(m)), n.to_string()));
        let (period, share) = period
            .map_or(("-".into(), "-".into()), |(p, share)| (digits(p), format!("{:.0} %", 100.0 * share)));
        Some(vec![format!("{label}, {unit}"), digits(from), digits(mean), interval, batches, period, share])
    };
    let rows: Vec<Vec<String>> = MAIN.into_iter().filter_map(row).collect();
    let head =
        ["", "from, s", "mean", "95 % interval", "batches", "main period, s", "its share of the variance"];
    (!rows.is_empty()).then(|| Table { head: head.map(str::to_owned).to_vec(), rows })
}

/// Start, end, extremes and late mean of the main columns.
fn table(stage: &StageData) -> Table {
    let mut rows = Vec::new();
    for (name, label, unit) in MAIN {
        let Some(values) = stage.columns.get(name) else { continue };
        let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let Some((mean, deviation)) = stage.columns.late(name) else { continue };
        let low = finite.iter().copied().fold(f64::MAX, f64::min);
        let high = finite.iter().copied().fold(f64::MIN, f64::max);
        let ends = [finite[0], finite[finite.len() - 1], low, high, mean, deviation];
        let mut row = vec![format!("{label}, {unit}")];
        row.extend(ends.map(digits));
        rows.push(row);
    }
    let head = ["", "start", "end", "least", "largest", "mean of the last half", "its standard deviation"];
    Table { head: head.map(str::to_owned).to_vec(), rows }
}
