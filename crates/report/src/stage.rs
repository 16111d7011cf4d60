//! The sections of a stage: its curves and statistics, from the history and the snapshots.

use case::{Role, WatchedForce};
use figures::plot;
use results::forced_oscillation::{Derivatives, ForcedOscillation};
use results::long_term::METHOD;
use results::pendulum::PendulumSwing;
use results::settled::QUANTITIES;
use terminal::counted;

use super::bars::Bars;
use super::chart::{Chart, Series, digits};
use super::data::{Columns, Run, StageData};
use super::document::{Block, Section, Table, coupled};
use super::frames::{Measure, StageFrames};
use super::panels::{MOTION, SOLVERS, charts};
use super::{facts, opening_loads, origin, payload};

/// Windows of a settled mean.
const MIN_WINDOWS: usize = 40;

/// Whether the equations of the stage give the speed of the frame.
fn falls(run: &Run, kind: case::StageKind) -> bool {
    run.scene().descent.is_some() && (coupled(kind) || kind == case::StageKind::Trajectory)
}

/// The section of a stage.
pub(super) fn section(run: &Run, stage: &StageData, frames: Option<&StageFrames>) -> Section {
    let described = run.stage(stage);
    let name = &described.name;
    let id = anchor(name);
    let mut found = charts(MOTION, &stage.columns, &id);
    if !falls(run, described.kind) {
        // The scene prescribes the speed.
        found.retain(|c| c.title != "Descent speed");
    }
    let watched = run.scene().watched_force(described.kind);
    for chart in found.iter_mut().filter(|_| watched != WatchedForce::Canopy) {
        let along = match chart.title.as_str() {
            "Drag" => "its drag direction",
            "Side force" => "x and y",
            _ => continue,
        };
        chart.note = format!("Force of the air on {} along {along}.", watched.name());
    }
    refer(run, stage, &mut found);
    found.extend(payload::charts(stage, &id));
    found.extend(points(&stage.points, &id));
    if let Some(frames) = frames {
        found.extend(from_snapshots(&frames.measures, &id));
    }
    let mut blocks = vec![Block::Charts(found), Block::Table(table(stage))];
    if described.kind.roles().contains(&Role::Flow)
        && let Some(table) = long_term_table(stage)
    {
        blocks.push(Block::Text(format!("Settled means. Method: {METHOD}. The main period is the peak of the periodogram, given if it carries at \
             least a quarter of the variance.")));
        blocks.push(Block::Table(table));
    }
    for (text, table) in [
        (opening_loads::OPENING, opening_loads::table(run, stage)),
        (WAKE, wake_table(stage, described.kind)),
        (OSCILLATION, oscillation_table(run, stage)),
    ] {
        blocks.extend(table.into_iter().flat_map(|table| [Block::Text(text.into()), Block::Table(table)]));
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

/// Adds published values and the weight, and leaves out what exceeds the scale of the rest.
fn refer(run: &Run, stage: &StageData, found: &mut [Chart]) {
    let described = run.stage(stage);
    for chart in found {
        match chart.title.as_str() {
            "Descent speed" => {
                let published = plot::published(run.scene()).iter();
                let published =
                    published.filter(|_| coupled(described.kind) && facts::not_comparable(stage).is_none());
                chart.references = published.map(|(v, n)| (*v, format!("{n} {v}"))).collect();
            }
            "Drag" => {
                chart.references =
                    facts::weight(run).map(|w| (w, format!("weight {}", digits(w)))).into_iter().collect();
                omit_transient(chart);
            }
            _ => omit_transient(chart),
        }
    }
}

/// Iterations and quality measures of the solvers in the main stage.
pub(super) fn solvers(run: &Run, stage: &StageData) -> Section {
    let name = &run.stage(stage).name;
    let found = charts(SOLVERS, &stage.columns, &format!("solvers-{}", anchor(name)));
    let blocks = if found.is_empty() { Vec::new() } else { vec![Block::Charts(found)] };
    Section {
        id: "solvers".into(),
        title: "Solver statistics".into(),
        lead: format!("Iterations and quality measures of the programs in each window of stage {name}."),
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

/// Omits the first 5 % of the curves if its range is more than five times that of the rest, so that the rest
/// stays readable. The caption says so.
pub(super) fn omit_transient(chart: &mut Chart) {
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
        chart.note += " The first 5 % of the stage is omitted: its values exceed this scale.";
    }
}

/// Curves of the quantities measured on the snapshots.
/// A chart for each direction in which a point of `[[output.point]]` moves.
fn points(columns: &Columns, id: &str) -> Vec<Chart> {
    let Some(time) = columns.get("time_s") else { return Vec::new() };
    let along = |axis: &str| -> Option<Chart> {
        let end = format!("_{axis}_m");
        let moves = |name: &str| columns.get(name).is_some_and(|v| v.iter().any(|x| x.abs() > 1e-9));
        let names: Vec<&str> =
            columns.starting("").into_iter().filter(|n| n.ends_with(&end) && moves(n)).collect();
        let series = names.iter().filter_map(|name| {
            let values = time.iter().copied().zip(columns.get(name)?.iter().copied()).collect();
            Some(Series { label: name.trim_end_matches(&end).into(), points: values })
        });
        (!names.is_empty()).then(|| Chart {
            id: format!("{id}-points-{axis}"),
            title: format!("Displacement of points along {axis}"),
            unit: "m",
            note: "Nodes of the canopy nearest to the points of the scene, from their places in the unstressed shape."
                .into(),
            series: series.collect(),
            ..Chart::default()
        })
    };
    ["x", "y", "z"].into_iter().filter_map(along).collect()
}

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
            series.push(curve("sum of all vents", &|m| m.vents.iter().sum()));
        }
        let note = "Area of the openings in the fabric other than the skirt.";
        found.push(chart("Vent area", "m2", note, series));
    }
    if first.mouth > 0.0 {
        let note =
            "Area enclosed by the skirt (the lower edge of the fabric), projected onto the horizontal plane.";
        found.push(chart("Mouth area", "m2", note, vec![curve("mouth", &|m| m.mouth)]));
    }
    if first.tensions.is_some() {
        let of = |k: usize| move |m: &Measure| m.tensions.map_or(f64::NAN, |t| t[k]);
        let series = vec![curve("minimum", &of(0)), curve("mean", &of(1)), curve("maximum", &of(2))];
        found.push(chart(
            "Tension of suspension lines",
            "N",
            "Minimum, mean and maximum over all suspension lines.",
            series,
        ));
    }
    if measures.iter().any(|m| m.states.iter().sum::<f64>() > 0.0) {
        let of = |k: usize| move |m: &Measure| 100.0 * m.states[k];
        let series = vec![curve("slack", &of(0)), curve("wrinkled", &of(1)), curve("taut", &of(2))];
        let note = "Share of the fabric area that is slack (no tension), wrinkled (uniaxial tension) or taut (biaxial).";
        found.push(chart("State of the fabric", "%", note, series));
    }
    found.retain(|c| !c.is_empty());
    found
}

/// Maximum tension of each suspension line in the last snapshot.
fn line_bars(frames: &StageFrames, id: &str) -> Option<Bars> {
    let last = frames.measures.last()?;
    let of = |kind: u8| last.lines.iter().filter(move |l| l.0 == kind).map(|l| l.1).collect::<Vec<f64>>();
    let (lines, risers) = (of(0), of(1));
    if lines.is_empty() || lines.len() > 64 {
        return None;
    }
    let mut note =
        format!("Maximum tension of each suspension line at t = {:.3} s, by line number.", last.time);
    if !risers.is_empty() {
        let list: Vec<String> = risers.iter().map(|t| digits(*t)).collect();
        note += &format!(" Risers: {} N.", list.join(", "));
    }
    let rows = lines.iter().enumerate().map(|(i, t)| ((i + 1).to_string(), vec![*t])).collect();
    Some(Bars {
        id: format!("{id}-lines"),
        title: "Tension of suspension lines in the last snapshot, N".into(),
        label: "tension",
        unit: "N",
        note,
        parts: vec!["line"],
        rows,
        upright: true,
    })
}

/// Settled means with confidence intervals, and main oscillations.
fn long_term_table(stage: &StageData) -> Option<Table> {
    let row = |(name, label, unit): (&str, &str, &str)| {
        let found = stage.columns.settled(name)?;
        let given = |value: Option<f64>| value.map_or("-".into(), digits);
        let interval = match (found.interval_95, found.no_interval) {
            (Some(half_width), _) => format!("± {}", digits(half_width)),
            (None, why) => why.map_or("-".into(), |why| format!("none: {why}")),
        };
        let stationary = found.stationary.map_or("not known", |yes| if yes { "yes" } else { "no" });
        let share = found.swing_share.map_or("-".into(), |share| format!("{:.0} %", 100.0 * share));
        let cells = [
            digits(found.from_s),
            digits(found.mean),
            interval,
            found.batches.to_string(),
            stationary.into(),
            given(found.drift),
            given(found.swing_amplitude),
            given(found.swing_period_s),
            share,
        ];
        Some([format!("{label}, {unit}")].into_iter().chain(cells).collect())
    };
    let rows: Vec<Vec<String>> = QUANTITIES.into_iter().filter_map(row).collect();
    let head = [
        "",
        "from t, s",
        "mean",
        "95 % interval",
        "batches",
        "stationary",
        "drift",
        "swing amplitude",
        "main period, s",
        "share of the variance",
    ];
    let caption = "Settled mean, confidence interval and main oscillation; units in the first column.".into();
    (!rows.is_empty()).then(|| Table { caption, head: head.map(str::to_owned).to_vec(), rows })
}

const WAKE: &str = "Wake. The statistics cover the last half of the windows, as the means do. The side force is horizontal; its main period and \
    Strouhal number are those along its axis of largest variance, and the Strouhal number is given for at least four \
    periods. U is the speed of the undisturbed air relative to the frame, D the diameter of a circle of the projected area.";

/// Side force, pendulum angle, Strouhal number, and what of the wake they cover.
fn wake_table(stage: &StageData, kind: case::StageKind) -> Option<Table> {
    let wake = stage.columns.wake()?;
    let percent = |share: f64| format!("{} %", digits(100.0 * share));
    let given = |value: Option<f64>, text: fn(f64) -> String| value.map_or("-".into(), text);
    let counted =
        if wake.periods_measured { "of the side force" } else { "of a disk (Strouhal number 0.135)" };
    let mut rows = vec![
        ("diameters of stream in the stage, U/D".to_owned(), digits(wake.stream_diameters)),
        ("the same in the last half".into(), digits(wake.mean_stream_diameters)),
        ("rms side force, N".into(), digits(wake.side_force_rms_n)),
        ("the same over the mean drag".into(), percent(wake.side_force_share)),
        ("rms pendulum angle, deg".into(), given(wake.pendulum_rms_deg, digits)),
        ("largest pendulum angle, deg".into(), given(wake.pendulum_largest_deg, digits)),
        ("Strouhal number of the side force".into(), given(wake.strouhal, digits)),
        ("its share of the variance".into(), given(wake.strouhal_share, |s| format!("{:.0} %", 100.0 * s))),
        (format!("periods {counted}"), digits(wake.periods)),
    ];
    rows.extend(wake.pendulum_swing.iter().flat_map(swing_rows));
    rows.extend(wake.verdict().map(|v| (format!("warning {}", v.check), v.figure)));
    let alternation = stage.columns.alternation().filter(|a| coupled(kind) && a.is_large());
    rows.extend(alternation.map(|a| ("warning coupling.alternating-load".into(), a.line())));
    let rows = rows.into_iter().map(|(name, value)| vec![name, value]).collect();
    Some(Table { caption: "Wake of the canopy; units in the first column.".into(), head: Vec::new(), rows })
}

const OSCILLATION: &str = "Stability derivatives. Each coefficient is fitted by least squares to C0 + C_a (a - mean) + C_q (da/dt) l/(2V) in each whole period \
    but the first; the intervals are those of the scatter between periods. Normal and axial force are in axes that turn with the body, the moment is about the axis of \
    the rotation. The damping derivative is the sum of those by rate of rotation and by rate of the angle of attack.";

/// Stability derivatives of a stage whose body oscillates.
fn oscillation_table(run: &Run, stage: &StageData) -> Option<Table> {
    let folder = case::stage_folder(&run.folder, run.scene(), stage.index);
    let found = ForcedOscillation::of(run.scene(), stage.index, &folder)?;
    let value = |v: f64, interval: Option<f64>| match interval {
        Some(i) => format!("{} ± {}", digits(v), digits(i)),
        None => format!("({})", digits(v)),
    };
    let row = |d: &Derivatives| {
        vec![
            d.coefficient.clone(),
            digits(d.mean),
            value(d.static_per_rad, d.static_interval_95),
            value(d.damping_per_rad, d.damping_interval_95),
            format!("{:.0} %", 100.0 * d.explained),
        ]
    };
    let caption = format!(
        "Stability derivatives of \"{}\" by forced oscillation: {} ± {} deg in {} s, reduced frequency {}, {} whole periods. Intervals of 95 %; in brackets: fewer than three periods, or serially correlated ones.",
        found.entry,
        digits(found.mean_angle_deg),
        digits(found.amplitude_deg),
        digits(found.period_s),
        digits(found.reduced_frequency),
        found.periods
    );
    let head = [
        "coefficient",
        "at the mean angle",
        "static derivative, 1/rad",
        "damping derivative, over l/(2V)",
        "explained variance",
    ];
    let rows = found.derivatives.iter().map(row).collect();
    Some(Table { caption, head: head.map(str::to_owned).to_vec(), rows })
}

/// Swing of the canopy about its payload, in the table of the wake.
fn swing_rows(swing: &PendulumSwing) -> [(String, String); 6] {
    let pair = |[a, b]: [f64; 2]| format!("{}, {}", digits(a), digits(b));
    [
        ("mean tilt along x and y, deg".into(), pair(swing.mean_tilt_deg)),
        ("rms swing about it along both principal axes, deg".into(), pair(swing.principal_rms_deg)),
        ("ratio of both (0: in a plane, 1: a cone)".into(), digits(swing.axis_ratio)),
        (
            "mean rate of turn (positive: right-handed about the upward vertical), deg/s".into(),
            digits(swing.turn_rate_deg_s),
        ),
        ("main period of the swing, s".into(), swing.period_s.map_or("-".into(), digits)),
        ("rms swing of the last quarter over that of the quarter before".into(), digits(swing.growth)),
    ]
}

/// Initial and final values, extremes and late means.
fn table(stage: &StageData) -> Table {
    let mut rows = Vec::new();
    for (name, label, unit) in QUANTITIES {
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
    let head =
        ["", "start", "end", "minimum", "maximum", "mean of the last half", "standard deviation there"];
    let windows = stage.columns.rows();
    let sure = if windows < MIN_WINDOWS {
        "The means have no confidence interval: a settled mean needs 40 windows."
    } else {
        "How sure a mean is states the table of the settled means, where there is one."
    };
    let caption = format!(
        "Values at the {} of the stage; units in the first column. {sure}",
        counted(windows as u64, "accepted window")
    );
    Table { caption, head: head.map(str::to_owned).to_vec(), rows }
}
