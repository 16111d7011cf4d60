//! Every check before a run on both sides of each end of its range: the level and the figure that it gives.
//!
//! `check_ranges.txt` is the table, with figures worked out by hand.

use std::collections::BTreeSet;
use std::path::Path;

use checks::facts::{Facts, Machine};
use checks::{Finding, Inspection, Severity, When, all};
use coupling::interface::CanopyInterface;

mod changes;

const TABLE: &str = include_str!("check_ranges.txt");

/// A row of the table.
struct Edge {
    check: &'static str,
    changes: Vec<&'static str>,
    /// `none`, `note`, `warning` or `error`: the worst that the check says.
    level: &'static str,
    /// Part of a figure of that level.
    figure: &'static str,
}

fn edges() -> Vec<Edge> {
    let rows = TABLE.lines().filter(|l| !l.is_empty() && !l.starts_with('#'));
    rows.map(|line| {
        let parts: Vec<&str> = line.split(" | ").collect();
        let [check, changes, level, figure] = parts[..] else { panic!("four columns: {line}") };
        let absent = |text: &'static str| if text == "-" { "" } else { text };
        let changes = absent(changes).split("; ").filter(|c| !c.is_empty()).collect();
        Edge { check, changes, level, figure: absent(figure) }
    })
    .collect()
}

/// The inspection of `square-drop` on one rank of each program and a large machine, with `changes`, and with rest
/// lengths of the lines times `rest`.
fn inspect(changes: &[&str], rest: f64) -> Result<Inspection, String> {
    let mut machine = Machine { cores: 64, memory: Some(1e12), disk: Some(1e13), hosts: false };
    let mut name = "square-drop";
    let mut settings = vec![("ranks", "{structure=1,flow=1,mesh=1}")];
    let mut former_names = Vec::new();
    for change in changes {
        match change.split_once('=').expect("KEY=VALUE") {
            ("case", value) => name = value,
            ("machine.cores", value) => machine.cores = value.parse().expect("a number"),
            ("machine.memory", value) => machine.memory = Some(value.parse().expect("bytes")),
            ("machine.disk", value) => machine.disk = Some(value.parse().expect("bytes")),
            ("former.names", key) => former_names = checks::names::former("", &[format!("{key}=1")]),
            ("machine.hosts", value) => machine.hosts = value == "true",
            pair => settings.push(pair),
        }
    }
    let scene = changes::changed(name, &settings)?;
    let interface = CanopyInterface::new(&scene).map_err(|e| e.to_string())?;
    let mut facts = Facts::new(&scene, &interface, machine, 0).map_err(|e| e.to_string())?;
    facts.former_names = former_names;
    facts.mesh.cables.iter_mut().for_each(|c| c.rest_length *= rest);
    Ok(Inspection::new(&facts, |_| String::new()))
}

/// What the check says, if it is not the level with the figure.
fn missed(e: &Edge, rest: f64) -> Option<String> {
    let Edge { check, changes, level, figure } = e;
    let all = match inspect(changes, rest) {
        Ok(all) => all,
        Err(why) => return Some(format!("{check} of {changes:?}: {why}")),
    };
    let found: Vec<_> = all.findings.iter().filter(|f| f.check == *check).collect();
    let worst = found.iter().map(|f| f.severity).max().map_or("none", Severity::name);
    let of_worst = |f: &&&Finding| f.severity.name() == worst;
    let said = figure.is_empty()
        || found
            .iter()
            .filter(of_worst)
            .any(|f| format!("{}: {}; {}", f.key, f.figure, f.remedy).contains(figure));
    let lines: Vec<String> = found.iter().map(|f| f.line()).collect();
    let wrong = worst != *level || !said;
    wrong.then(|| format!("{check} of {changes:?}: not {level}, {figure:?}, but {worst}, {lines:#?}"))
}

#[test]
fn both_sides_of_each_end_of_a_range_have_their_level_and_figure() {
    let wrong: Vec<String> = edges().iter().filter_map(|e| missed(e, 1.0)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Lines of a canopy that does not fall, shorter than as cut by a share e: Green strain e to first order, bound 0.1 %.
#[test]
fn taut_lines_of_a_held_canopy_are_judged_by_their_strain() {
    for (rest, level, figure) in
        [(1.0 / 1.00098, "note", "elongation 0.0980 %"), (1.0 / 1.00102, "warning", "elongation 0.102 %")]
    {
        let edge = Edge { check: "lines.initial-tension", changes: vec!["descent="], level, figure };
        assert_eq!(missed(&edge, rest), None);
    }
}

/// No check without rows: one at its worst level, and one at a lower one.
#[test]
fn every_check_before_a_run_is_in_the_table() {
    for check in all().filter(|c| matches!(c.when, When::Before(_))) {
        let levels: BTreeSet<&str> =
            edges().iter().filter(|e| e.check == check.id).map(|e| e.level).collect();
        assert!(levels.contains(check.severity.name()), "{}: {levels:?}", check.id);
        assert!(check.severity == Severity::Note || levels.len() > 1, "{}: {levels:?}", check.id);
    }
    for e in edges() {
        assert!(all().any(|c| c.id == e.check), "{} is no check", e.check);
    }
}

/// Checks during a run with a test that sees each at work, by file.
const DURING: &[(&str, &str, &str)] = &[
    (
        "structure.newton",
        "structure-solver/tests/program.rs",
        "an_absurd_pressure_is_reported_with_place_and_time",
    ),
    (
        "structure.convergence",
        "crates/coupling/src/convergence.rs",
        "ten_times_the_target_is_an_error_unless_accepted",
    ),
    ("flow.convergence", "tests/tests/unconverged.rs", "unconverged_flow_is_an_error_unless_accepted"),
    (
        "flow.turbulence-convergence",
        "crates/coupling/src/convergence.rs",
        "ten_times_the_target_is_an_error_unless_accepted",
    ),
    ("flow.cells", "crates/coupling/src/convergence.rs", "unconverged_cells_are_reported_with_their_place"),
    (
        "flow.steady",
        "flow-solver/tests/verification/convergence.rs",
        "steady_march_does_not_end_on_an_unconverged_step",
    ),
    ("mesh.convergence", "mesh-mover/tests/motion.rs", "jump_over_several_layers_is_divided_into_increments"),
    (
        "structure.energy",
        "crates/coupling/src/structure_energy.rs",
        "energy_beyond_the_limit_is_an_error_with_values",
    ),
    ("mesh.quality", "tests/tests/grid_stuck.rs", "last_valid_state_is_saved_and_resumed"),
    (
        "flow.impossible",
        "crates/coupling/src/flow_bounds.rs",
        "measured_flows_pass_and_unphysical_flows_fail",
    ),
    (
        "flow.local-mach",
        "crates/coupling/src/local_mach.rs",
        "local_mach_number_warns_once_and_is_limited_to_one",
    ),
    (
        "flow.leakage",
        "crates/coupling/src/leakage.rs",
        "leakage_is_relative_to_stream_and_fabric_and_warns_once",
    ),
    (
        "coupling.alternating-load",
        "crates/results/src/alternation.rs",
        "load_that_alternates_is_reported_with_its_amplitude",
    ),
    (
        "opening.vibrating-force",
        "crates/results/src/opening.rs",
        "vibration_of_the_risers_is_no_opening_load",
    ),
    ("wake.symmetric", "crates/results/src/wake.rs", "symmetric_wake_is_reported_with_its_side_force"),
    ("wake.periods", "crates/results/src/wake.rs", "mean_over_too_few_periods_is_reported_with_their_number"),
    ("flow.unloaded-canopy", "crates/results/src/summary.rs", "canopy_without_a_load_is_warned_of"),
    ("strength.safety-factor", "crates/results/src/strength.rs", "load_above_the_strength_is_reported"),
    (
        "stages.release-pressure",
        "crates/coupling/src/release.rs",
        "release_pressures_are_compared_where_a_flow_was_developed",
    ),
    (
        "stages.at-rest",
        "coupler/src/stages/pre_inflation.rs",
        "kinetic_energy_before_a_flow_stage_gives_a_warning",
    ),
    (
        "coupling.convergence",
        "crates/coupling/src/schemes/tests.rs",
        "unrelaxed_iteration_diverges_with_an_error",
    ),
    (
        "coupling.interface-energy",
        "crates/coupling/src/energy.rs",
        "delayed_force_creates_energy_and_is_reported_once",
    ),
    (
        "descent.downward",
        "crates/coupling/src/descent_limits.rs",
        "downward_acceleration_beyond_the_forces_is_rejected",
    ),
    (
        "descent.upward",
        "crates/coupling/src/descent_limits.rs",
        "upward_acceleration_beyond_the_line_force_is_rejected",
    ),
    ("descent.impulse", "crates/coupling/src/balance.rs", "missing_impulse_is_reported_once"),
];

#[test]
fn every_check_during_a_run_has_a_test() {
    for check in all().filter(|c| matches!(c.when, When::During(_))) {
        let (_, file, test) =
            DURING.iter().find(|(id, ..)| *id == check.id).unwrap_or_else(|| panic!("{} has none", check.id));
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file);
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(text.contains(&format!("fn {test}()")), "{}: {file} has no {test}", check.id);
    }
}
