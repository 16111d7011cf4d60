//! What ran, where, and what it warned of.

use case::Role;
use coupling::interface::CanopyInterface;
use effects::TABLE;
use results::finding::Finding;

use super::data::{Run, number, text};
use super::document::{Block, Section, Table};
use super::facts::progress;

/// Scene, machine, versions, command, stages.
pub(super) fn section(run: &Run) -> Section {
    let scene = run.scene();
    let summary = run.summary.as_ref();
    let mut rows = Vec::new();
    let mut row = |name: &str, value: String| {
        if !value.is_empty() {
            rows.push(vec![name.to_owned(), value]);
        }
    };
    row("scene", scene.name.clone());
    row("began (UTC)", text(summary, "started_utc").into());
    if let Some(words) = summary.and_then(|s| s.get("command")).and_then(|c| c.as_array()) {
        let words: Vec<&str> = words.iter().filter_map(|w| w.as_str()).collect();
        // Where the program lay is nobody's business; what was asked of it is.
        let program = words.first().map(|p| p.rsplit('/').next().unwrap_or(p));
        row(
            "command",
            program.into_iter().chain(words.iter().skip(1).copied()).collect::<Vec<_>>().join(" "),
        );
    }
    let version = text(summary, "version");
    if !version.is_empty() {
        let contract = number(summary, "contract").map(|c| format!(", contract {c:.0}")).unwrap_or_default();
        row("version", format!("ripstop {version}{contract}"));
    }
    let machine = summary.and_then(|s| s.get("machine"));
    if machine.is_some() {
        let memory = number(machine, "memory_gib").unwrap_or(0.0);
        let threads = number(machine, "threads").unwrap_or(0.0);
        row(
            "machine",
            format!(
                "{}, {threads:.0} threads, {memory} GiB, {}",
                text(machine, "processor"),
                text(machine, "system")
            ),
        );
    }
    let ranks = summary.and_then(|s| s.get("ranks")).and_then(|r| r.as_array());
    let ranks: Vec<String> = Role::ALL
        .iter()
        .enumerate()
        .map(|(i, role)| {
            let told = ranks.and_then(|r| r.get(i)).and_then(serde_json::Value::as_u64);
            format!("{} {}", role.name(), told.unwrap_or(u64::from(scene.ranks.of(*role))))
        })
        .collect();
    row("ranks", ranks.join(", "));
    if let Ok(interface) = CanopyInterface::new(scene) {
        row(
            "structure",
            format!(
                "{} triangles; fabric {:.2} kg, lines {:.2} kg",
                interface.sizes.triangles, interface.masses.fabric, interface.masses.cables
            ),
        );
    }
    let on: Vec<&str> = TABLE.iter().filter(|e| (e.on)(scene)).map(|e| e.key).collect();
    row("effects", if on.is_empty() { "none".into() } else { on.join(", ") });
    for stage in &run.stages {
        let described = run.stage(stage);
        row(
            &format!("stage {}", described.name),
            format!("{}, {}", kind(described.kind), progress(run, stage)),
        );
    }
    let mut blocks = vec![Block::Table(Table { head: Vec::new(), rows })];
    if let Ok(text) = std::fs::read_to_string(run.folder.join("scene.toml")) {
        blocks.push(Block::Code { title: "The scene".into(), text });
    }
    Section {
        id: "what-ran".into(),
        title: "What ran".into(),
        lead: "Enough to run it again.".into(),
        blocks,
    }
}

/// A kind of stage in words.
pub(super) fn kind(kind: case::StageKind) -> &'static str {
    match kind {
        case::StageKind::PreInflation => "structure alone under a constant pressure",
        case::StageKind::FlowOnly => "flow alone around the canopy at rest",
        case::StageKind::Coupled => "structure, flow and descent together",
        case::StageKind::Prescribed => "flow around a canopy with prescribed motion",
    }
}

/// Warnings of the inspection, of the coupler and of the programs, windows that did not converge, windows that were rejected.
pub(super) fn warnings(run: &Run) -> Vec<String> {
    let mut found = Vec::new();
    let ended = text(run.summary.as_ref(), "ended");
    if !ended.is_empty() && ended != "complete" {
        found.push(format!("the run ended early: {ended}"));
    }
    let inspection = run.summary.as_ref().and_then(|s| s.get("inspection")).cloned().unwrap_or_default();
    // A summary of an earlier version has none.
    let inspected: Vec<Finding> = serde_json::from_value(inspection).unwrap_or_default();
    found.extend(inspected.iter().map(|f| format!("before the run, {}; {}", f.line(), f.remedy)));
    let told = run.summary.as_ref().and_then(|s| s.get("warnings")).and_then(|w| w.as_array());
    match told {
        Some(list) => found.extend(list.iter().filter_map(|w| w.as_str()).map(str::to_owned)),
        // A summary without them, or none: the history knows at least these.
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
        for start in ["rejected", "retries", "mesh_regrid"] {
            for column in stage.columns.starting(start) {
                let sum = stage.columns.sum(column);
                if sum > 0.0 {
                    found.push(format!("stage `{name}`: {sum:.0} in column `{column}` of its history"));
                }
            }
        }
        for role in Role::ALL {
            let log = run.folder.join(name).join("logs").join(format!("{}.log", role.name()));
            let lines = std::fs::read_to_string(log).unwrap_or_default();
            let said = lines.lines().filter(|l| l.to_lowercase().contains("warning"));
            found.extend(said.take(20).map(|l| format!("stage `{name}`, {}: {}", role.name(), l.trim())));
        }
    }
    found
}
