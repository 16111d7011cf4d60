//! Where the time went: by program, and by the named parts of each.

use results::timings::StageTimings;
use serde_json::Value;
use terminal::clock;

use super::bars::Bars;
use super::data::Run;
use super::document::{Block, Section, Table};
use super::facts;

/// Where the time went.
pub(super) fn section(run: &Run) -> Section {
    let parts = ["structure", "flow", "mesh", "coupler", "waiting", "launch, saving and pictures"];
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
    let mut head: Vec<String> = vec!["stage".into(), "wall".into()];
    head.extend(parts.map(str::to_owned));
    head.push("a window".into());
    Section {
        id: "time".into(),
        title: "Where the time went".into(),
        lead: "Wall seconds of each program; waiting is the channel, and other work on the cores.".into(),
        blocks: [
            Block::Bars(Bars {
                id: "time".into(),
                title: "Wall seconds of each program in each stage".into(),
                label: "wall time",
                unit: "s",
                note: "Each bar is a stage, cut into shares of its wall time.".into(),
                parts: parts.to_vec(),
                rows,
                upright: false,
            }),
            Block::Table(Table { head, rows: table }),
        ]
        .into_iter()
        .chain(parts_of_programs(run))
        .collect(),
    }
}

/// A table for each stage whose summary says what the parts of its programs took.
fn parts_of_programs(run: &Run) -> Vec<Block> {
    let stages = run.summary.as_ref().and_then(|s| s.get("timings")).and_then(Value::as_array);
    let stages = stages.into_iter().flatten();
    let read = stages.filter_map(|s| serde_json::from_value::<StageTimings>(s.clone()).ok());
    read.filter(|timings| timings.programs.iter().any(|p| !p.parts.is_empty()))
        .flat_map(|timings| [Block::Text(lead(&timings.stage)), Block::Table(table(&timings))])
        .collect()
}

fn lead(stage: &str) -> String {
    format!(
        "Stage {stage}, by parts: as they lie in each other, on the first rank of each program, since the stage was begun or \
         resumed. Those of the coupler include waiting for the programs."
    )
}

fn table(timings: &StageTimings) -> Table {
    let head = ["program", "part", "calls", "wall time", "share of the program", "a call"];
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
    Table { head: head.map(String::from).to_vec(), rows }
}
