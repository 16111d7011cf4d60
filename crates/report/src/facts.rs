//! The key figures at the top of the report.

use case::{Role, StageKind, WatchedForce};
use coupling::descent::DescentModel;
use coupling::interface::CanopyInterface;
use figures::plot;
use results::strength::SafetyFactor;
use terminal::{clock, counted};

use super::chart::digits;
use super::data::{Columns, Run, StageData, number};
use super::document::Card;
use super::opening_loads;

/// Total weight of parachute and payload, N; `None` without descent.
pub(super) fn weight(run: &Run) -> Option<f64> {
    let interface = CanopyInterface::new(run.scene()).ok()?;
    DescentModel::of(run.scene(), &interface).map(|m| m.mass_kg * m.gravity_m_s2)
}

/// Simulated time and completed windows of a stage, in words.
pub(super) fn progress(run: &Run, stage: &StageData) -> String {
    let planned = run.stage(stage).windows();
    let done = stage.columns.rows() as u64;
    let time = digits(stage.columns.last("time_s").unwrap_or(0.0));
    let ended = super::data::text(stage.summary.as_ref(), "ended");
    if done >= planned || ended == "complete" {
        format!("{time} s in {}", counted(done, "window"))
    } else if ended.is_empty() || ended == "failed" {
        format!("{time} s, ended after {done} of {}", counted(planned, "window"))
    } else {
        format!("{time} s in {done} of {}: {ended}", counted(planned, "window"))
    }
}

/// Wall time of a stage, s: from its summary, else the sum over its windows.
pub(super) fn wall(stage: &StageData) -> f64 {
    number(stage.summary.as_ref(), "wall_s").unwrap_or_else(|| stage.columns.sum("window_wall_s"))
}

/// Key figures of the main stage.
pub(super) fn cards(run: &Run, warnings: usize) -> Vec<Card> {
    let columns = &run.main().columns;
    let found = [
        descent_speed(run),
        drag(run),
        projected_area(columns),
        line_tension(columns),
        opening_loads::card(run),
        safety_factor(run),
        coupling_effort(columns),
        Some(wall_time(run)),
    ];
    let mut cards: Vec<Card> = found.into_iter().flatten().collect();
    cards.push(Card {
        label: "Warnings".into(),
        value: warnings.to_string(),
        notes: vec![if warnings == 0 { "none".into() } else { "listed below".into() }],
        warn: warnings > 0,
    });
    cards
}

fn card(label: &str, value: String, notes: Vec<String>) -> Card {
    Card { label: label.into(), value, notes, warn: false }
}

/// A mean with what it covers and how sure it is.
struct Quoted {
    mean: f64,
    /// The mean, with its interval if it has one.
    value: String,
    notes: Vec<String>,
}

impl Quoted {
    /// The settled mean of a column, else the mean of the last half of its windows.
    fn of(columns: &Columns, name: &str) -> Option<Self> {
        let settled = columns.settled(name);
        if let Some((s, value)) = settled.as_ref().and_then(|s| Some((s, s.mean_and_interval()?))) {
            let (from, to) = (digits(s.from_s), digits(s.to_s));
            let note = format!("settled mean from {from} to {to} s, 95 % interval of {} batches", s.batches);
            return Some(Self { mean: s.mean, value, notes: vec![note] });
        }
        let (mean, deviation) = columns.late(name)?;
        let windows = columns.rows() - columns.rows() / 2;
        let why = match settled {
            Some(s) => s.no_interval.unwrap_or_else(|| "not known why".into()),
            None if columns.rows() < 40 => "fewer than 40 windows".into(),
            None => "constant".into(),
        };
        let notes = vec![
            format!(
                "mean of the last half, {}, standard deviation {}",
                counted(windows as u64, "window"),
                digits(deviation)
            ),
            format!("no interval: {why}"),
        ];
        Some(Self { mean, value: digits(mean), notes })
    }
}

/// Late mean of the descent speed in a coupled stage with descent, compared with published values.
fn descent_speed(run: &Run) -> Option<Card> {
    let stage = run.main();
    if run.stage(stage).kind != StageKind::Coupled || run.scene().descent.is_none() {
        return None;
    }
    let quoted = Quoted::of(&stage.columns, "descent_speed_m_s")?;
    let last = stage.columns.last("descent_speed_m_s").unwrap_or(f64::NAN);
    let (mean, value) = (quoted.mean, format!("{} m/s", quoted.value));
    let mut notes = quoted.notes;
    notes.push(format!("{} m/s at the end", digits(last)));
    let published = plot::published(run.scene());
    match not_comparable(stage) {
        Some(why) if !published.is_empty() => {
            notes.push(format!("not compared with published values: {why}"))
        }
        _ => notes.extend(
            published.iter().map(|(v, name)| format!("{name} {v}: {:+.1} %", 100.0 * (mean - v) / v)),
        ),
    }
    Some(card("Descent speed", value, notes))
}

/// Why the means of a stage are not set next to a steady value; `None` where they may be.
pub(super) fn not_comparable(stage: &StageData) -> Option<String> {
    let Some(wake) = stage.columns.wake() else {
        return Some("the history does not state what its means cover".into());
    };
    wake.verdict()
        .map(|verdict| verdict.figure)
        .or_else(|| stage.columns.settled("descent_speed_m_s")?.no_interval)
}

fn drag(run: &Run) -> Option<Card> {
    let stage = run.main();
    let Quoted { value, mut notes, .. } = Quoted::of(&stage.columns, "drag_n")?;
    if let Some(weight) = weight(run) {
        notes.push(format!("weight {} N", digits(weight)));
    }
    let kind = run.stage(stage).kind;
    let watched = run.scene().watched_force(kind);
    if watched != WatchedForce::Canopy {
        return Some(card(&format!("Drag of {}", watched.name()), format!("{value} N"), notes));
    }
    if kind != StageKind::Coupled {
        let speed = stage.columns.last("descent_speed_m_s").unwrap_or(f64::NAN);
        notes.push(format!("at {} m/s", digits(speed)));
    }
    Some(card("Drag", format!("{value} N"), notes))
}

fn projected_area(columns: &Columns) -> Option<Card> {
    let Quoted { value, mut notes, .. } = Quoted::of(columns, "projected_area_m2")?;
    let values = columns.get("projected_area_m2").unwrap_or_default();
    let late = &values[values.len() / 2..];
    let (low, high) = late.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    notes.push(format!("between {} and {} in the last half", digits(low), digits(high)));
    Some(card("Projected area", format!("{value} m2"), notes))
}

fn line_tension(columns: &Columns) -> Option<Card> {
    let most = columns.max("max_line_tension_n").filter(|t| *t > 0.0)?;
    let risers = columns.max("riser_force_n").map(|f| format!("riser force at most {} N", digits(f)));
    Some(card("Maximum line tension", format!("{} N", digits(most)), risers.into_iter().collect()))
}

/// The smallest safety factor of all stages; `None` where the scene has no strength.
fn safety_factor(run: &Run) -> Option<Card> {
    let risers = CanopyInterface::new(run.scene()).ok()?.sizes.risers;
    let of_stage = |stage| {
        let (stage, name): (&StageData, _) = (stage, &run.stage(stage).name);
        stage.columns.safety_factors(run.scene(), risers).into_iter().map(move |f| (name.clone(), f))
    };
    let all = run.stages.iter().flat_map(of_stage);
    let parts = SafetyFactor::smallest(all);
    let least = &parts.first()?.1;
    let mut notes: Vec<String> =
        parts.iter().map(|(stage, f)| format!("{}, stage {stage}", f.line())).collect();
    notes.push("at the ends of windows".into());
    let warn = parts.iter().any(|(_, f)| f.factor < f.required.unwrap_or(1.0));
    Some(Card { warn, ..card("Smallest safety factor", format!("{:.2}", least.factor), notes) })
}

/// Mean flow solves per window, and the interface energy error.
fn coupling_effort(columns: &Columns) -> Option<Card> {
    let solves = columns.get("coupling_iterations")?;
    let most = columns.max("coupling_iterations").unwrap_or(0.0);
    let above = columns.get("coupling_converged").map_or(0, |v| v.iter().filter(|x| **x == 0.0).count());
    let all = counted(solves.len() as u64, "window");
    let mut notes =
        vec![format!("flow solves per window, mean over all {all} of the stage, at most {most:.0}")];
    if above > 0 {
        notes.push(format!("{} not converged", counted(above as u64, "window")));
    }
    if let Some(share) = columns.last("interface_energy_error_share") {
        notes.push(format!("interface energy error {:+.1} % of the work", 100.0 * share));
    }
    let mean = solves.iter().sum::<f64>() / solves.len().max(1) as f64;
    Some(card("Coupling iterations", digits(mean), notes))
}

fn wall_time(run: &Run) -> Card {
    let stage = run.main();
    let total: f64 = run.stages.iter().map(wall).sum();
    let ranks: u32 = Role::ALL.iter().map(|r| run.scene().ranks.of(*r)).sum();
    let simulated = stage.columns.last("time_s").unwrap_or(0.0);
    let mut notes = vec![];
    if simulated > 0.0 {
        let cost = digits(wall(stage) / simulated);
        notes.push(format!("{cost} s per simulated second of stage {}", run.stage(stage).name));
    }
    notes.push(match launched_ranks(run) {
        Some(ranks) => format!("{ranks} ranks"),
        None => format!("{ranks} ranks in the scene"),
    });
    card("Wall time", clock(total), notes)
}

/// Number of ranks that the summary reports.
fn launched_ranks(run: &Run) -> Option<u64> {
    Some(run.summary.as_ref()?.get("ranks")?.as_array()?.iter().filter_map(serde_json::Value::as_u64).sum())
}
