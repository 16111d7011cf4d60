//! The text of `ripstop watch`.

use case::StageKind;
use coupling::error::RunError;
use results::columns::HISTORY;
use results::run_state::RunState;
use terminal::plot::{number, plot};
use terminal::{clock, counted};

use super::view::View;

/// Fewest and most columns of the text.
const WIDTH: [usize; 2] = [40, 160];
/// Fewest and most lines of a curve.
const HEIGHT: [usize; 2] = [4, 12];
/// Lines of a curve without a terminal.
const DEFAULT: usize = 6;
/// Lines of a plot next to those of its curve: name, axis, and the empty line before.
const AROUND: usize = 3;

/// State, progress, last values and plots, at most `columns` wide; the plots share what is left of the `lines` of a terminal,
/// on which those that do not fit are left out.
///
/// # Errors
/// No history has a column of a name in `chosen`.
pub(super) fn page(
    view: &View<'_>,
    chosen: &[String],
    columns: usize,
    lines: Option<usize>,
) -> Result<String, RunError> {
    let columns = columns.clamp(WIDTH[0], WIDTH[1]);
    let mut text = vec![head(view)];
    text.extend(place(view));
    text.push(bar(view, columns));
    text.extend(values(view));
    text.extend(warnings(view));
    let mut text: Vec<String> = text.iter().map(|line| cut(line, columns)).collect();
    let mut names = names(view, chosen)?;
    let mut rows = DEFAULT;
    if let Some(lines) = lines {
        let room = lines.saturating_sub(text.len() + 1);
        names.truncate(room / (HEIGHT[0] + AROUND));
        rows = (room / names.len().max(1)).saturating_sub(AROUND).clamp(HEIGHT[0], HEIGHT[1]);
    }
    let time = view.rows.column("time_s").unwrap_or_default();
    for name in names {
        let Some(values) = view.rows.column(name) else { continue };
        let points: Vec<(f64, f64)> = time.iter().copied().zip(values.iter().copied()).collect();
        let curve = plot(&points, "s", columns, rows);
        if !curve.is_empty() {
            text.extend([String::new(), name.to_owned()]);
            text.extend(curve);
        }
    }
    Ok(text.join("\n"))
}

/// Name and state of the run, and the stage.
fn head(view: &View<'_>) -> String {
    let state = match &view.status.state {
        RunState::Running => "running".to_owned(),
        RunState::Complete => match view.summary("wall_s") {
            Some(wall_s) => format!("complete in {}", clock(wall_s)),
            None => "complete".into(),
        },
        RunState::Interrupted(_) => "interrupted".into(),
        RunState::Failed(_) => "failed".into(),
        RunState::Killed => "killed".into(),
    };
    let (stage, stages) = (&view.stage.name, view.scene.stages.len());
    format!("{}: {state} | stage {} of {stages}: {stage}", view.scene.name, view.number)
}

/// Window, time, window length and ETA.
fn place(view: &View<'_>) -> Option<String> {
    if view.rows.rows() == 0 {
        let starts = view.status.state == RunState::Running;
        return starts.then(|| "starting: no window is completed yet".into());
    }
    let mut parts = vec![format!("window {}/{}", view.done(), view.stage.windows())];
    if let Some(time) = view.rows.last("time_s") {
        let duration = view.stage.duration_s;
        let end = if duration > 0.0 { format!("/{duration:.4}") } else { String::new() };
        parts.push(format!("t {time:.4}{end} s"));
    }
    if let Some(dt) = view.rows.last("window_s").or(view.progress.map(|p| p.window_s)).filter(|dt| *dt > 0.0)
    {
        parts.push(format!("dt {dt:.3e} s"));
    }
    if let Some(progress) = view.progress {
        parts.push(format!("wall {}", clock(progress.wall_s)));
        let eta = progress.eta_s.filter(|_| !view.status.ended());
        parts.extend(eta.map(|eta_s| format!("ETA {}", clock(eta_s))));
    }
    Some(parts.join(" | "))
}

/// Share of the stage that is completed.
fn bar(view: &View<'_>, columns: usize) -> String {
    let share = (view.done() as f64 / view.stage.windows().max(1) as f64).min(1.0);
    let room = columns - 6;
    let full = (share * room as f64) as usize;
    format!("{}{} {:>3.0} %", "━".repeat(full), "─".repeat(room - full), 100.0 * share)
}

/// The last values that a reader looks at first.
fn values(view: &View<'_>) -> Option<String> {
    let last = |name: &str| view.rows.last(name);
    let mut parts = Vec::new();
    let descends = matches!(view.stage.kind, StageKind::Coupled | StageKind::Trajectory);
    if let Some(speed) = last("descent_speed_m_s").filter(|_| descends) {
        parts.push(format!("descent {speed:.3} m/s"));
    }
    parts.extend(last("drag_n").map(|drag| format!("drag {} N", number(drag, 0.01 * drag.abs()))));
    if let Some(iterations) = last("coupling_iterations") {
        parts.push(counted(iterations as u64, "iteration"));
    }
    parts.extend(last("coupling_residual").map(|residual| format!("residual {residual:.1e}")));
    if last("coupling_converged") == Some(0.0) {
        parts.push("not converged".into());
    }
    if let Some(rejected) = last("rejected_attempts").filter(|n| *n > 0.0) {
        parts.push(format!("rejected {rejected:.0} x"));
    }
    if parts.is_empty() && cables_alone(view) {
        parts
            .extend(last("max_line_tension_n").map(|tension| format!("largest line tension {tension:.1} N")));
    } else if parts.is_empty() {
        parts.extend(last("projected_area_m2").map(|area| format!("projected area {area:.3} m2")));
        parts.extend(last("vertical_load_n").map(|load| format!("load {load:.1} N")));
    }
    (!parts.is_empty()).then(|| parts.join(" | "))
}

/// Whether the structure has no area at all: no fabric.
fn cables_alone(view: &View<'_>) -> bool {
    view.rows.last("projected_area_m2") == Some(0.0) && view.rows.last("vertical_load_n") == Some(0.0)
}

/// Number of warnings, the last one, and why the run ended.
fn warnings(view: &View<'_>) -> Vec<String> {
    let (count, last) = view.warnings;
    let warned = last.map(|text| format!("{}, the last: {text}", counted(count as u64, "warning")));
    let ended = match &view.status.state {
        RunState::Interrupted(how) | RunState::Failed(how) => {
            Some(how.lines().next().unwrap_or_default().to_owned())
        }
        RunState::Killed => Some("its process ended without writing a summary".into()),
        RunState::Running | RunState::Complete => None,
    };
    warned.into_iter().chain(ended).collect()
}

/// The columns to plot.
fn names<'a>(view: &'a View<'_>, chosen: &'a [String]) -> Result<Vec<&'a str>, RunError> {
    let known: Vec<&str> = view.rows.names().collect();
    let defined = |name: &str| known.contains(&name) || HISTORY.iter().any(|column| column.name == name);
    if let Some(wrong) = chosen.iter().find(|name| !defined(name)) {
        return Err(RunError::Input(format!(
            "no history has a column `{wrong}`: see docs/reference/results.md. Columns of stage `{}`: {}",
            view.stage.name,
            known.join(", ")
        )));
    }
    if !chosen.is_empty() {
        // A stage need not have all columns.
        return Ok(chosen.iter().map(String::as_str).filter(|name| known.contains(name)).collect());
    }
    let wanted: &[&str] = match view.stage.kind {
        StageKind::PreInflation if cables_alone(view) => &["max_line_tension_n"],
        StageKind::PreInflation => &["projected_area_m2"],
        StageKind::FlowOnly | StageKind::Prescribed => &["drag_n"],
        StageKind::Coupled => &["descent_speed_m_s", "drag_n"],
        StageKind::Trajectory => &["descent_speed_m_s", "frame_z_m"],
    };
    Ok(wanted.iter().copied().filter(|name| known.contains(name)).collect())
}

/// At most `columns` letters of a line.
fn cut(line: &str, columns: usize) -> String {
    if line.chars().count() <= columns {
        return line.to_owned();
    }
    line.chars().take(columns - 1).chain(['…']).collect()
}
