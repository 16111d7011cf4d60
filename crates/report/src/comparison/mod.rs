//! The comparison of two or more runs: curves on common axes, means with their differences, scenes, costs, warnings.

mod means;
mod scenes;

use std::path::{Path, PathBuf};

use coupling::error::RunError;
use terminal::clock;

use super::chart::{Chart, Series, digits};
use super::data::{Run, StageData, text};
use super::document::{Block, Card, Document, Section, Table, coupled, shortened};
use super::panels::{COUPLING, MOTION, Panel};
use super::{facts, origin, stage};

/// A run with the stage that is compared.
pub(super) struct Compared {
    /// Name that distinguishes it: the end of its path.
    pub(super) label: String,
    pub(super) run: Run,
    /// Index among the stages of the run.
    stage: usize,
}

impl Compared {
    /// The stage that is compared.
    pub(super) fn stage(&self) -> &StageData {
        &self.run.stages[self.stage]
    }
}

/// The comparison of the runs in `folders`. The first one is what the others are compared with.
///
/// # Errors
/// A folder without a run, or a damaged file.
pub(super) fn document(folders: &[PathBuf]) -> Result<Document, RunError> {
    let runs = open(folders)?;
    let names: Vec<&str> = runs.iter().map(|r| r.label.as_str()).collect();
    let (first, others) = names.split_first().expect("at least two runs");
    let missing: Vec<String> =
        runs.iter().flat_map(|r| r.run.missing.iter().map(|text| format!("{}: {text}", r.label))).collect();
    let mut sections = vec![
        Section {
            id: "means".into(),
            title: "Means".into(),
            lead: "Mean of each quantity, over what, and how sure; differences are those to the first run."
                .into(),
            blocks: means::blocks(&runs),
        },
        curves(&runs),
        Section {
            id: "scenes".into(),
            title: "Scenes".into(),
            lead: "Keys whose values differ, with defaults.".into(),
            blocks: vec![scenes::block(&runs)],
        },
        Section {
            id: "cost".into(),
            title: "Programs and wall time".into(),
            lead: "What ran, where, and for how long.".into(),
            blocks: vec![Block::Table(cost(&runs))],
        },
        warnings(&runs),
    ];
    if !missing.is_empty() {
        sections.push(Section {
            id: "missing".into(),
            title: "Missing data".into(),
            lead: "Data that the runs did not write, and the key of the scene that writes them.".into(),
            blocks: vec![Block::List(missing.clone())],
        });
    }
    sections.retain(|s| !s.blocks.is_empty());
    Ok(Document {
        title: format!("{first} and {}", others.join(", ")),
        status: format!("Comparison of {} runs. {}", runs.len(), stages(&runs)),
        cards: runs.iter().map(card).collect(),
        sections,
        missing,
    })
}

fn open(folders: &[PathBuf]) -> Result<Vec<Compared>, RunError> {
    let labels = labels(folders);
    let mut runs: Vec<Compared> = Vec::new();
    for (folder, label) in folders.iter().zip(labels) {
        let run = Run::open(folder)?;
        let main = run.main().index;
        let position = |wanted: &str| run.stages.iter().position(|s| run.stage(s).name == wanted);
        let own = run.stages.iter().position(|s| s.index == main).unwrap_or(0);
        let stage = match runs.first() {
            Some(first) => position(&first.run.stage(first.stage()).name).unwrap_or(own),
            None => own,
        };
        runs.push(Compared { label, run, stage });
    }
    Ok(runs)
}

/// The shortest ends of the paths that distinguish the folders; equal folders are numbered.
fn labels(folders: &[PathBuf]) -> Vec<String> {
    let full: Vec<PathBuf> = folders.iter().map(|f| f.canonicalize().unwrap_or_else(|_| f.clone())).collect();
    let end = |path: &Path, parts: usize| {
        let all: Vec<_> = path.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
        all[all.len().saturating_sub(parts)..].join("/")
    };
    let longest = full.iter().map(|f| f.components().count()).max().unwrap_or(1);
    let unique = |parts: &usize| {
        let mut ends: Vec<String> = full.iter().map(|f| end(f, *parts)).collect();
        ends.sort();
        ends.windows(2).all(|pair| pair[0] != pair[1])
    };
    let parts = (1..=longest).find(unique);
    let numbered = |(i, f): (usize, &PathBuf)| format!("{} ({})", end(f, 1), i + 1);
    match parts {
        Some(parts) => full.iter().map(|f| end(f, parts)).collect(),
        None => full.iter().enumerate().map(numbered).collect(),
    }
}

/// The stages that are compared, in words.
fn stages(runs: &[Compared]) -> String {
    let name = |r: &Compared| r.run.stage(r.stage()).name.clone();
    let first = name(&runs[0]);
    if runs.iter().all(|r| name(r) == first) {
        return format!("Stage {first} of each.");
    }
    let all: Vec<String> = runs.iter().map(|r| format!("{} of {}", name(r), r.label)).collect();
    format!("No stage has the same name in all: {}.", all.join(", "))
}

fn card(compared: &Compared) -> Card {
    let run = &compared.run;
    let stage = compared.stage();
    Card {
        label: compared.label.clone(),
        value: run.state_word().into(),
        notes: vec![facts::progress(run, stage), format!("wall time {}", clock(wall(run)))],
        warn: !run.is_complete(),
    }
}

/// Wall time of all stages, s.
fn wall(run: &Run) -> f64 {
    run.stages.iter().map(facts::wall).sum()
}

/// A chart for each column that any of the runs has.
fn curves(runs: &[Compared]) -> Section {
    let both = runs.iter().all(|r| coupled(r.run.stage(r.stage()).kind));
    let panels = MOTION.iter().chain(COUPLING.iter().filter(|_| both));
    let mut charts: Vec<Chart> = panels.flat_map(|panel| of_panel(panel, runs)).collect();
    charts.iter_mut().filter(|c| !c.logarithmic).for_each(stage::omit_transient);
    Section {
        id: "curves".into(),
        title: "Curves".into(),
        lead: "The same quantity of all runs, over the time since the start of the stage.".into(),
        blocks: if charts.is_empty() { Vec::new() } else { vec![Block::Charts(charts)] },
    }
}

fn of_panel(panel: &Panel, runs: &[Compared]) -> Vec<Chart> {
    let chart = |(column, label): &(&str, &str)| {
        let several = panel.columns.len() > 1 && !panel.title.eq_ignore_ascii_case(label);
        let title = if several { format!("{}: {label}", panel.title) } else { panel.title.to_owned() };
        let series =
            |r: &Compared| Series { label: r.label.clone(), points: r.stage().columns.series(column) };
        let series: Vec<Series> = runs.iter().map(series).collect();
        let zero = series.iter().flat_map(|s| &s.points).all(|p| p.1 == 0.0 || !p.1.is_finite());
        let chart = Chart {
            id: format!("curve-{column}"),
            title,
            unit: panel.unit,
            note: panel.note.into(),
            series,
            logarithmic: panel.logarithmic,
            ..Chart::default()
        };
        (!zero && !chart.is_empty()).then_some(chart)
    };
    panel.columns.iter().filter_map(chart).collect()
}

/// State, size, cost and provenance of each run.
fn cost(runs: &[Compared]) -> Table {
    let row = |name: &str, value: &dyn Fn(&Compared) -> String| {
        [name.to_owned()].into_iter().chain(runs.iter().map(value)).collect::<Vec<String>>()
    };
    let given = |text: String| if text.is_empty() { "not known".into() } else { text };
    let of_summary = |r: &Compared, key: &str| given(text(r.run.summary.as_ref(), key).to_owned());
    let iterations = |r: &Compared| {
        let values = r.stage().columns.get("coupling_iterations").unwrap_or_default();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        if values.is_empty() {
            "-".into()
        } else {
            format!("{}, over {} windows", digits(mean), values.len())
        }
    };
    let per_window = |r: &Compared| {
        let windows = r.stage().columns.rows().max(1) as f64;
        format!("{} s", digits(facts::wall(r.stage()) / windows))
    };
    let rows = vec![
        row("scene", &|r| r.run.scene().name.clone()),
        row("ended", &|r| r.run.state_word().into()),
        row("stage", &|r| facts::progress(&r.run, r.stage())),
        row("wall time of all stages", &|r| clock(wall(&r.run))),
        row("wall time of the stage", &|r| clock(facts::wall(r.stage()))),
        row("the same per window", &per_window),
        row("mean of the coupling iterations per window", &iterations),
        row("ranks", &|r| origin::ranks(&r.run)),
        row("commit of the programs", &|r| of_summary(r, "commit")),
        row("version", &|r| given(origin::version(r.run.summary.as_ref()))),
        row("machine", &|r| given(origin::machine(r.run.summary.as_ref()))),
        row("started (UTC)", &|r| of_summary(r, "started_utc")),
        row("command", &|r| given(origin::command(r.run.summary.as_ref()))),
    ];
    Table { caption: "Programs, machine and wall time of each run.".into(), head: head(runs, ""), rows }
}

/// A head with a column for each run.
fn head(runs: &[Compared], first: &str) -> Vec<String> {
    [first.to_owned()].into_iter().chain(runs.iter().map(|r| r.label.clone())).collect()
}

fn warnings(runs: &[Compared]) -> Section {
    let of = |r: &Compared| {
        let all = origin::warnings(&r.run);
        let lines: Vec<String> = shortened(&all).iter().map(|text| format!("{}: {text}", r.label)).collect();
        if lines.is_empty() { vec![format!("{}: no warnings", r.label)] } else { lines }
    };
    Section {
        id: "warnings".into(),
        title: "Warnings".into(),
        lead: "Warnings of each run.".into(),
        blocks: vec![Block::List(runs.iter().flat_map(of).collect())],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_the_shortest_ends_that_differ() {
        let of = |paths: &[&str]| labels(&paths.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["/none/a", "/none/b"]), ["a", "b"]);
        assert_eq!(of(&["/none/a/run", "/none/b/run"]), ["a/run", "b/run"]);
        assert_eq!(of(&["/none/run", "/none/run"]), ["run (1)", "run (2)"]);
    }
}
