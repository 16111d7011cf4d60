//! Scene, machine, versions and command of the run, and its warnings.

use case::Role;
use coupling::interface::CanopyInterface;
use effects::TABLE;
use results::finding::Finding;
use results::run_state::RunState;
use serde_json::Value;

use super::data::{Run, number, text};
use super::document::{Block, Section, Table};
use super::facts::progress;

/// Scene, machine, versions, command, stages.
pub(super) fn section(run: &Run) -> Section {
    let scene = run.scene();
    let summary = run.summary.as_ref();
    let mut rows = vec![("scene".to_owned(), scene.name.clone())];
    rows.push(("started (UTC)".into(), text(summary, "started_utc").into()));
    rows.push(("command".into(), command(summary)));
    rows.push(("version".into(), version(summary)));
    rows.push(("commit of the programs".into(), text(summary, "commit").into()));
    rows.push(("machine".into(), machine(summary)));
    rows.push(("ranks".into(), ranks(run)));
    if let (Ok(interface), true) = (CanopyInterface::new(scene), scene.has_canopy()) {
        let (sizes, masses) = (&interface.sizes, &interface.masses);
        let parts = masses.parts().into_iter().map(|(name, mass)| format!("{name} {mass:.3} kg"));
        let parts: Vec<String> = parts.collect();
        let value = format!("{} triangles; {}", sizes.triangles, parts.join(", "));
        rows.push(("structure".into(), value));
    }
    let on: Vec<&str> = TABLE.iter().filter(|e| (e.on)(scene)).map(|e| e.key).collect();
    rows.push(("effects".into(), if on.is_empty() { "none".into() } else { on.join(", ") }));
    for stage in &run.stages {
        let described = run.stage(stage);
        let value = format!("{}, {}", kind(described.kind), progress(run, stage));
        rows.push((format!("stage {}", described.name), value));
    }
    let known = rows.into_iter().filter(|(_, value)| !value.is_empty());
    let rows = known.map(|(name, value)| vec![name, value]).collect();
    let mut blocks =
        vec![Block::Table(Table { caption: "Configuration of the run.".into(), head: Vec::new(), rows })];
    if let Ok(text) = std::fs::read_to_string(run.folder.join("scene.toml")) {
        blocks.push(Block::Code { title: "Scene file".into(), text });
    }
    Section {
        id: "configuration".into(),
        title: "Configuration".into(),
        lead: "Scene, command, version and machine: what is needed to reproduce the run.".into(),
        blocks,
    }
}

/// The command of the run; empty if the summary does not contain it.
pub(super) fn command(summary: Option<&Value>) -> String {
    let words = summary.and_then(|s| s.get("command")).and_then(Value::as_array);
    let words: Vec<&str> = words.into_iter().flatten().filter_map(Value::as_str).collect();
    // The folder of the program is omitted: it does not affect the results.
    let program = words.first().map(|p| p.rsplit('/').next().unwrap_or(p));
    program.into_iter().chain(words.iter().skip(1).copied()).collect::<Vec<_>>().join(" ")
}

pub(super) fn version(summary: Option<&Value>) -> String {
    let version = text(summary, "version");
    if version.is_empty() {
        return String::new();
    }
    let contract = number(summary, "contract").map(|c| format!(", contract {c:.0}")).unwrap_or_default();
    format!("ripstop {version}{contract}")
}

pub(super) fn machine(summary: Option<&Value>) -> String {
    let machine = summary.and_then(|s| s.get("machine"));
    if machine.is_none() {
        return String::new();
    }
    let memory = number(machine, "memory_gib").unwrap_or(0.0);
    let threads = number(machine, "threads").unwrap_or(0.0);
    let (processor, system) = (text(machine, "processor"), text(machine, "system"));
    format!("{processor}, {threads:.0} threads, {memory} GiB, {system}")
}

/// Ranks of each program: from the summary, else from the scene.
pub(super) fn ranks(run: &Run) -> String {
    let ran = run.summary.as_ref().and_then(|s| s.get("ranks")).and_then(Value::as_array);
    let one = |(i, role): (usize, &Role)| {
        let ran = ran.and_then(|r| r.get(i)).and_then(Value::as_u64);
        format!("{} {}", role.name(), ran.unwrap_or(u64::from(run.scene().ranks.of(*role))))
    };
    Role::ALL.iter().enumerate().map(one).collect::<Vec<_>>().join(", ")
}

/// Description of a kind of stage.
pub(super) fn kind(kind: case::StageKind) -> &'static str {
    match kind {
        case::StageKind::PreInflation => "structure alone under a constant pressure",
        case::StageKind::FlowOnly => "flow alone on a fixed grid",
        case::StageKind::Coupled => "coupled structure, flow and descent",
        case::StageKind::Trajectory => "trajectory of a point mass under weight, drag and lift",
        case::StageKind::Prescribed => "flow around a canopy or bodies with prescribed motion",
    }
}

/// Warnings of the inspection, the coupler and the programs; windows that did not converge or were rejected.
pub(super) fn warnings(run: &Run) -> Vec<String> {
    let mut found = Vec::new();
    if let RunState::Interrupted(how) | RunState::Failed(how) = &run.state {
        found.push(format!("the run ended early: {how}"));
    }
    let inspection = run.summary.as_ref().and_then(|s| s.get("inspection")).cloned().unwrap_or_default();
    // Summaries of earlier versions have no inspection.
    let inspected: Vec<Finding> = serde_json::from_value(inspection).unwrap_or_default();
    found.extend(inspected.iter().map(|f| format!("before the run, {}; {}", f.line(), f.remedy)));
    let recorded = run.summary.as_ref().and_then(|s| s.get("warnings")).and_then(Value::as_array);
    match recorded {
        Some(list) => found.extend(list.iter().filter_map(|w| w.as_str()).map(str::to_owned)),
        // Without warnings in a summary, the history still shows windows that did not converge.
        None => {
            for stage in &run.stages {
                let name = &run.stage(stage).name;
                for (window, converged) in
                    stage.columns.get("coupling_converged").unwrap_or_default().iter().enumerate()
                {
                    if *converged == 0.0 {
                        found.push(format!("window {window} of stage `{name}` did not converge"));
                    }
                }
            }
        }
    }
    for stage in &run.stages {
        let name = &run.stage(stage).name;
        let of_summary = |key: &str| stage.summary.as_ref().and_then(|s| s.get(key)).and_then(Value::as_f64);
        if let Some(changes) = of_summary("length_changes").filter(|n| *n > 0.0) {
            found.push(format!(
                "stage `{name}`: {changes:.0} changes of the longest window allowed, because the coupling created energy or did so no longer; \
                 shortest window {:.2e} s",
                of_summary("shortest_window_s").unwrap_or(f64::NAN)
            ));
        }
        for start in ["rejected", "retries", "mesh_regrid"] {
            for column in stage.columns.starting(start) {
                let sum = stage.columns.sum(column);
                if sum > 0.0 {
                    found.push(format!("stage `{name}`: column `{column}` of history.csv sums to {sum:.0}"));
                }
            }
        }
        for role in Role::ALL {
            let log = run.folder.join(name).join("logs").join(format!("{}.log", role.name()));
            let lines = std::fs::read_to_string(log).unwrap_or_default();
            let logged = lines.lines().filter(|l| l.to_lowercase().contains("warning"));
            found.extend(logged.take(20).map(|l| format!("stage `{name}`, {}: {}", role.name(), l.trim())));
        }
    }
    found
}
