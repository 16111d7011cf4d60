//! Wall time by program, and by the timed parts of each program.

use results::rank_advice;
use results::summary::StageSummary;
use results::timings::StageTimings;
use serde_json::Value;
use terminal::clock;

use super::bars::Bars;
use super::data::Run;
use super::document::{Block, Section, Table};
use super::facts;

/// Wall time of the programs in each stage.
pub(super) fn section(run: &Run) -> Section {
    let parts = ["structure", "flow", "mesh", "coupler", "waiting", "launch and output"];
    let columns = ["structure_wall_s", "flow_wall_s", "mesh_wall_s", "coupler_wall_s", "waiting_wall_s"];
    let mut rows = Vec::new();
    let mut table = Vec::new();
    for stage in &run.stages {
        let mut values: Vec<f64> = columns.iter().map(|c| stage.columns.sum(c)).collect();
        values.push((facts::wall(stage) - stage.columns.sum("window_wall_s")).max(0.0));
        let total: f64 = values.iter().sum();
        let mut row = vec![run.stage(stage).name.clone(), clock(total)];
        row.extend(values.iter().map(|v| format!("{:.0} %", 100.0 * v / total.max(f64::MIN_POSITIVE))));
        let rows_done = stage.columns.rows().max(1) as f64;
        row.push(format!("{:.3} s", total / rows_done));
        table.push(row);
        rows.push((run.stage(stage).name.clone(), values));
    }
    let mut head: Vec<String> = vec!["stage".into(), "wall time".into()];
    head.extend(parts.map(str::to_owned));
    head.push("per window".into());
    Section {
        id: "time".into(),
        title: "Wall time".into(),
        lead: "Wall time of each program. In waiting time no program computes: messages, and other load on the cores."
            .into(),
        blocks: [
            Block::Bars(Bars {
                id: "time".into(),
                title: "Wall time of each program in each stage, %".into(),
                label: "wall time",
                unit: "s",
                note: "Each bar is one stage, divided into shares of its wall time.".into(),
                parts: parts.to_vec(),
                rows,
                upright: false,
            }),
            Block::Table(Table {
                caption: "Wall time of each stage, shares of the programs, and wall time per window.".into(),
                head,
                rows: table,
            }),
        ]
        .into_iter()
        .chain(ranks(run))
        .chain(parts_of_programs(run))
        .collect(),
    }
}

/// Which program the others wait for, and what other ranks would change.
fn ranks(run: &Run) -> Option<Block> {
    let summary = run.summary.as_ref()?;
    let launched: [u32; 3] = serde_json::from_value(summary.get("ranks")?.clone()).ok()?;
    let stages = summary.get("stages")?.as_array()?.iter();
    let stages = stages.filter_map(|s| serde_json::from_value::<StageSummary>(s.clone()).ok());
    let lines: Vec<_> = stages.filter_map(|s| rank_advice::line(&s, launched)).collect();
    (!lines.is_empty()).then_some(Block::List(lines))
}

/// A table for each stage whose summary contains timings.
fn parts_of_programs(run: &Run) -> Vec<Block> {
    let stages = run.summary.as_ref().and_then(|s| s.get("timings")).and_then(Value::as_array);
    let stages = stages.into_iter().flatten();
    let read = stages.filter_map(|s| serde_json::from_value::<StageTimings>(s.clone()).ok());
    read.filter(|timings| timings.programs.iter().any(|p| !p.parts.is_empty()))
        .map(|timings| Block::Table(table(&timings)))
        .collect()
}

fn caption(stage: &str) -> String {
    format!(
        "Stage {stage}: wall time of the nested timed parts on rank 0 of each program, since the start or last restart of \
         the stage. The parts of the coupler include waiting for the programs."
    )
}

fn table(timings: &StageTimings) -> Table {
    let head = ["program", "part", "calls", "wall time", "share of the program", "per call"];
    let mut rows = Vec::new();
    for program in &timings.programs {
        for (at, row) in program.rows().enumerate() {
            rows.push(vec![
                if at == 0 { program.program.clone() } else { String::new() },
                format!("{}{}", "\u{2003}".repeat(row.depth - 1), row.name),
                row.calls.to_string(),
                format!("{:.3} s", row.seconds),
                format!("{:.1} %", 100.0 * row.share),
                format!("{:.3} ms", 1e3 * row.seconds / row.calls.max(1) as f64),
            ]);
        }
    }
    Table { caption: caption(&timings.stage), head: head.map(String::from).to_vec(), rows }
}
