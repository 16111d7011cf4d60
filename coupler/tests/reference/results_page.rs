//! `docs/reference/results.md`: files, columns and fields of a folder of results.

use std::collections::BTreeSet;

use case::StageKind;
use results::alternation::Alternation;
use results::columns::{self, Column};
use results::files::{self, ResultFile};
use results::finding::{Finding, Severity};
use results::forced_oscillation::{Derivatives, ForcedOscillation};
use results::history;
use results::opening::{Opening, OpeningReference};
use results::pendulum::PendulumSwing;
use results::rank_advice::RankAdvice;
use results::recording::compare::FIELDS;
use results::settled::SettledMean;
use results::strength::SafetyFactor;
use results::summary::{RunSummary, StageSummary};
use results::timings::{ProgramTimings, StageTimings};
use results::wake::{Sample, Wake};
use serde_json::Value;

use super::markdown::{anchor, compare_or_write, head, inline, root, table};
use super::source::{members, read};
use super::units::unit;

const INTRODUCTION: &str = "\
`ripstop run` writes a folder of results (`--out`, `output.folder`, or `runs/<scene name>`). Braces stand for names: \
`{stage}` is a stage of the scene, `{role}` is `structure`, `flow` or `mesh`, `{number}`, `{window}` and `{rank}` are \
numbers from 0. Files with the end `.bin` are for restarts only; their format may change between versions.

All values are in SI units. The name of a column or field ends in its unit (`_n`, `_m_s`); a name without one is a count, a \
share or a coefficient. Tables are CSV: a line of names, then a row for each window, numbers with a decimal point, an \
empty cell where there is no value.";

/// Structs of `summary.json` with the files that hold them; the first one is the whole file.
const STRUCTS: &[(&str, &str)] = &[
    ("RunSummary", "crates/results/src/summary.rs"),
    ("StageSummary", "crates/results/src/summary.rs"),
    ("Wake", "crates/results/src/wake.rs"),
    ("PendulumSwing", "crates/results/src/pendulum.rs"),
    ("Alternation", "crates/results/src/alternation.rs"),
    ("ForcedOscillation", "crates/results/src/forced_oscillation.rs"),
    ("Derivatives", "crates/results/src/forced_oscillation.rs"),
    ("Opening", "crates/results/src/opening.rs"),
    ("RankAdvice", "crates/results/src/rank_advice.rs"),
    ("SettledMean", "crates/results/src/settled.rs"),
    ("SafetyFactor", "crates/results/src/strength.rs"),
    ("Convergence", "crates/coupling/src/convergence.rs"),
    ("UnconvergedCount", "crates/coupling/src/convergence.rs"),
    ("Finding", "crates/results/src/finding.rs"),
    ("Machine", "crates/results/src/machine.rs"),
    ("StageTimings", "crates/results/src/timings.rs"),
    ("ProgramTimings", "crates/results/src/timings.rs"),
    ("Part", "crates/timing/src/lib.rs"),
];

/// A column in tables: name, unit, meaning.
fn cells(name: &str, meaning: &str) -> Vec<String> {
    vec![format!("`{name}`"), unit(name).unwrap_or("").into(), inline(meaning)]
}

fn files_table(all: &[ResultFile]) -> String {
    let row = |f: &ResultFile| {
        vec![format!("`{}`", f.path), f.writer.into(), inline(f.when), f.content.replace('|', "\\|")]
    };
    table(&["file", "written by", "when", "content"], &all.iter().map(row).collect::<Vec<_>>())
}

fn columns_table(all: &[Column]) -> String {
    let rows: Vec<_> = all.iter().map(|c| cells(c.name, c.meaning)).collect();
    table(&["column", "unit", "meaning"], &rows)
}

fn history_table() -> String {
    let kinds = [
        (StageKind::PreInflation, "pre-inflation"),
        (StageKind::FlowOnly, "flow-only"),
        (StageKind::Prescribed, "prescribed"),
        (StageKind::Coupled, "coupled"),
    ];
    let rows: Vec<_> = columns::HISTORY
        .iter()
        .map(|c| {
            let of = kinds.iter().filter(|(kind, _)| history::names(*kind).contains(&c.name));
            let of: Vec<&str> = of.map(|(_, name)| *name).collect();
            let of = if of.len() == kinds.len() { "all".into() } else { of.join(", ") };
            [cells(c.name, c.meaning), vec![of]].concat()
        })
        .collect();
    table(&["column", "unit", "meaning", "kinds of stage"], &rows)
}

fn differences_table() -> String {
    let mut rows = vec![cells("window", "Number of the window, from 0.")];
    rows.extend(FIELDS.iter().map(|f| {
        let text = format!("Largest difference of the field \"{}\" in the window over its scale.", f.name);
        cells(&f.name.replace(' ', "_"), &text)
    }));
    table(&["column", "unit", "meaning"], &rows)
}

/// Type of a field in JSON.
fn json_type(rust: &str) -> String {
    if let Some(inner) = rust.strip_prefix("Option<").and_then(|t| t.strip_suffix('>')) {
        return format!("{} or null", json_type(inner));
    }
    if let Some(inner) = rust.strip_prefix("Vec<").and_then(|t| t.strip_suffix('>')) {
        return format!("array of {}", json_type(inner));
    }
    if let Some((inner, n)) =
        rust.strip_prefix('[').and_then(|t| t.strip_suffix(']')).and_then(|t| t.split_once("; "))
    {
        return format!("array of {n} ({})", json_type(inner));
    }
    let name = rust.rsplit("::").next().expect("a name");
    match name {
        "String" | "str" => "string".into(),
        "f64" => "number".into(),
        "u8" | "u32" | "u64" | "usize" => "integer".into(),
        "bool" => "boolean".into(),
        "StageKind" => "`stage.kind`".into(),
        "Severity" => "`note`, `warning` or `error`".into(),
        _ if rust.starts_with("&'static ") => json_type(&rust["&'static ".len()..]),
        _ => {
            assert!(STRUCTS.iter().any(|(s, _)| *s == name), "{rust}");
            format!("[{name}](#{})", anchor(name))
        }
    }
}

fn fields_of(name: &str, path: &str) -> Vec<[String; 3]> {
    let all = members(&read(path), &format!("pub struct {name}"));
    let kept = all.into_iter().filter(|m| !m.attributes.contains("serde(skip)"));
    kept.map(|m| [m.name, json_type(&m.of), m.text]).collect()
}

fn fields_table(name: &str, path: &str) -> String {
    let row = |[name, of, text]: &[String; 3]| {
        vec![format!("`{name}`"), of.clone(), unit(name).unwrap_or("").into(), inline(text)]
    };
    let rows: Vec<Vec<String>> = fields_of(name, path).iter().map(row).collect();
    table(&["field", "type", "unit", "meaning"], &rows)
}

fn summary_tables() -> String {
    let mut text = String::new();
    for (name, path) in STRUCTS {
        text += &format!("\n### {name}\n\n{}", fields_table(name, path));
    }
    text
}

fn page() -> String {
    let mut text = head("Results", INTRODUCTION);
    let mut add = |heading: &str, body: String| text += &format!("\n## {heading}\n\n{body}");
    add("Files of a run", files_table(files::RUN));
    let folders = files::STATE_FOLDERS.iter().map(|(path, content)| format!("- `{path}`: {content}\n"));
    add(
        "Folders of checkpoints",
        format!("Next to `{{stage}}/state`, with the same files:\n\n{}", folders.collect::<String>()),
    );
    add(
        "Files of a recording",
        format!(
            "`ripstop run --record DIR` writes these, and copies of the files in `{{stage}}/state`.\n\n{}",
            files_table(files::RECORDING)
        ),
    );
    add("Files of other commands", files_table(files::OTHER));
    add(
        "Columns of `history.csv`",
        format!(
            "A row for each accepted window. All columns before `{}` are the same, byte for byte, in a repeated run.\n\n{}",
            history::FIRST_WALL_COLUMN,
            history_table()
        ),
    );
    add("Columns of `iterations.csv`", columns_table(columns::ITERATIONS));
    add(
        "Columns of `forces.csv`",
        format!(
            "`{{on}}` is `canopy` where there is one; a set with `wall` follows where the outer boundary has no-slip walls, then one set for \
             each entry of `[[flow.forces.coefficients]]` with its name.\n\n{}\n\
             After its set, each entry has further columns:\n\n{}",
            columns_table(columns::FORCES),
            columns_table(columns::FORCE_COEFFICIENTS)
        ),
    );
    add("Columns of `points.csv`", format!("One set for each point.\n\n{}", columns_table(columns::POINTS)));
    add("Columns of `probes.csv`", format!("One set for each probe.\n\n{}", columns_table(columns::PROBES)));
    add(
        "Columns of `reactions.csv`",
        format!(
            "One set for each group. Only components that are held or prescribed count; a group without any in a stage has zeros there.\n\n{}",
            columns_table(columns::REACTIONS)
        ),
    );
    add("Columns of `payload.csv`", columns_table(columns::PAYLOAD));
    add("Columns of `{stage}-difference.csv`", differences_table());
    add("Fields of `progress.json`", fields_table("StageProgress", "crates/results/src/progress.rs"));
    add("Fields of `summary.json`", format!("The file is one object `RunSummary`.\n{}", summary_tables()));
    text
}

#[test]
fn page_of_results_is_generated_from_the_code() {
    compare_or_write("results.md", &page());
}

fn swing() -> PendulumSwing {
    PendulumSwing {
        mean_tilt_deg: [0.0; 2],
        principal_rms_deg: [1.0; 2],
        azimuth_deg: 0.0,
        axis_ratio: 1.0,
        turn_rate_deg_s: 0.0,
        growth: 1.0,
        period_s: None,
    }
}

fn oscillation() -> ForcedOscillation {
    ForcedOscillation {
        entry: "cup".into(),
        mean_angle_deg: 0.0,
        amplitude_deg: 1.0,
        period_s: 1.0,
        periods: 1,
        speed_m_s: 1.0,
        reduced_frequency: 1.0,
        derivatives: vec![Derivatives {
            coefficient: "moment".into(),
            mean: 0.0,
            static_per_rad: 1.0,
            static_interval_95: None,
            damping_per_rad: 1.0,
            damping_interval_95: None,
            explained: 1.0,
        }],
        method: String::new(),
    }
}

/// A summary in which every list has an entry.
fn summary() -> RunSummary {
    let scene = case::load(&root().join("cases/square-drop/scene.toml")).expect("a scene");
    let mut stage = StageSummary::new(&scene.stages[0]);
    stage.wake_samples.push(Sample { time_s: 1.0, drag_n: 1.0, diameters: 1.0, ..Sample::default() });
    let time: Vec<f64> = (1..100).map(f64::from).collect();
    let drag = time.iter().map(|t| t.sin()).collect();
    stage.wake = Wake::of(&stage.wake_samples).map(|w| Wake { pendulum_swing: Some(swing()), ..w });
    stage.alternating_load = Some(Alternation { rms_n: 1.0, share: 0.01, correlation: -0.9 });
    stage.forced_oscillation = Some(oscillation());
    let (area, force) = ("projected_area_m2".into(), "riser_force_n".into());
    let opens: Vec<(String, Vec<f64>)> = vec![
        ("time_s".into(), vec![1.0, 2.0, 3.0]),
        ("stream_speed_m_s".into(), vec![1.0, 2.0, 3.0]),
        (area, vec![1.0, 2.0, 3.0]),
        (force, vec![1.0, 2.0, 3.0]),
    ];
    let air = OpeningReference { density_kg_m3: 1.0, nominal_area_m2: 1.0, mass_kg: None };
    stage.opening = Opening::of_history(&opens, &air);
    stage.settled = SettledMean::all(&[("time_s".into(), time), ("drag_n".into(), drag)]);
    stage.safety_factors = vec![SafetyFactor {
        part: "lines".into(),
        load: 1.0,
        strength: 2.0,
        unit: "N".into(),
        time_s: 1.0,
        factor: 2.0,
        factor_99: None,
        required: None,
    }];
    stage.rank_advice = Some(RankAdvice { ranks: [1, 2, 1], wall_ratio: [0.6, 0.7] });
    let part = timing::Part { path: vec!["advance".into()], calls: 1, seconds: 1.0 };
    RunSummary {
        scene: scene.name.clone(),
        ended: "complete".into(),
        exit_code: Some(0),
        version: "0",
        commit: "unknown".into(),
        started_utc: String::new(),
        command: vec!["ripstop".into()],
        machine: results::machine::Machine::here(),
        contract: 1,
        inspection: vec![Finding {
            severity: Severity::Warning,
            check: String::new(),
            key: String::new(),
            place: String::new(),
            figure: String::new(),
            range: String::new(),
            remedy: String::new(),
        }],
        warnings: vec!["a warning".into()],
        wall_s: 1.0,
        ranks: [1; 3],
        stages: vec![stage],
        timings: vec![StageTimings {
            stage: "descent".into(),
            programs: vec![ProgramTimings { program: "coupler".into(), parts: vec![part] }],
        }],
    }
}

/// Compares the fields of `value` with those of the struct `name`, and those of the structs in it.
fn check_fields(value: &Value, name: &str, seen: &mut BTreeSet<String>) {
    let (_, path) = STRUCTS.iter().find(|(s, _)| *s == name).expect("a struct of the page");
    seen.insert(name.to_owned());
    let fields = fields_of(name, path);
    let written: BTreeSet<&str> = value.as_object().expect("an object").keys().map(String::as_str).collect();
    assert_eq!(written, fields.iter().map(|f| f[0].as_str()).collect(), "{name}");
    for [field, of, text] in &fields {
        assert!(!text.is_empty(), "{name}.{field}");
        let inner = of.split('[').nth(1).and_then(|rest| rest.split(']').next());
        if let Some(inner) = inner {
            let value = &value[field];
            check_fields(value.as_array().map_or(value, |all| &all[0]), inner, seen);
        }
    }
}

#[test]
fn fields_of_a_summary_are_those_of_the_page() {
    let mut seen = BTreeSet::new();
    check_fields(&serde_json::to_value(summary()).expect("JSON"), "RunSummary", &mut seen);
    assert_eq!(seen, STRUCTS.iter().map(|(name, _)| (*name).to_owned()).collect());
}
