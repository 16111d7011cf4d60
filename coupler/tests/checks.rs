//! The table of checks, its page, and the inspection of scenes.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use checks::document::markdown;
use checks::facts::{Facts, Machine};
use checks::{Check, Inspection, Severity, When, all};
use coupling::interface::CanopyInterface;

/// Scenes of the repository with their warnings on a large machine. Each is right: the ATPS has the paper's soft
/// modulus (Green strain 0.16, 0.22 at 20.4 Pa); `square-drop` and the hard cases made from it start at 4 m/s, below
/// the 5.3 m/s at which a drag coefficient of 0.75 carries them; 8 cells across are coarse; `long-window` and
/// `low-mach` have 5 and 4 substeps in a period of the fabric on its lines.
const CASES: &[(&str, &[&str])] = &[
    ("air-bag/scene.toml", &[]),
    ("atps-174kg/scene.toml", &["fabric.strain"]),
    ("atps-descent/finer-flow.toml", &["fabric.strain"]),
    ("atps-descent/five-seconds.toml", &["fabric.strain"]),
    ("atps-descent/scene.toml", &["fabric.strain"]),
    ("atps-descent/tapes.toml", &["fabric.strain"]),
    ("atps-gathered/scene.toml", &["fabric.strain"]),
    ("atps-inflation/scene.toml", &["fabric.strain", "flow.cells-across", "stage.damping"]),
    ("atps-opening/scene.toml", &["descent.drag-coefficient", "fabric.strain"]),
    ("atps-paper-scale/descent.toml", &["fabric.strain"]),
    ("atps-paper-scale/scene.toml", &["fabric.strain"]),
    ("atps-uniform-pressure/scene.toml", &["fabric.strain"]),
    ("flat-circular-opening/scene.toml", &["fabric.strain"]),
    ("hard/cavity/scene.toml", &[]),
    ("hanging-rope/scene.toml", &[]),
    ("hard/channel/scene.toml", &[]),
    ("hard/closed-box/scene.toml", &[]),
    ("hard/closed-vents/scene.toml", &["fabric.strain", "flow.cells-across"]),
    ("hard/full-pressure/scene.toml", &["descent.drag-coefficient"]),
    ("hard/gust/scene.toml", &["descent.drag-coefficient"]),
    ("hard/half-slack/scene.toml", &[]),
    ("hard/heavy-payload/scene.toml", &["descent.drag-coefficient"]),
    ("hard/leaflet/scene.toml", &[]),
    ("hard/light-payload/scene.toml", &["descent.drag-coefficient"]),
    ("hard/long-descent/scene.toml", &["fabric.strain", "flow.cells-across"]),
    ("hard/long-window/scene.toml", &["descent.drag-coefficient", "stage.line-mode"]),
    ("hard/low-mach/scene.toml", &["descent.drag-coefficient", "descent.steady-speed", "stage.line-mode"]),
    ("hard/membrane-box/scene.toml", &[]),
    ("hard/snapping-lines/scene.toml", &["descent.drag-coefficient", "stages.motion"]),
    ("hard/thin-cells/scene.toml", &[]),
    ("pattern-conical/scene.toml", &[]),
    ("plate-gmsh/scene.toml", &[]),
    ("square-drop/scene.toml", &["descent.drag-coefficient"]),
    ("validation/compliant-disk/scene.toml", &[]),
    ("validation/disk-gap-band/scene.toml", &[]),
    ("validation/flexible-cavity/scene.toml", &[]),
    ("validation/inverted-flag/scene.toml", &[]),
    ("validation/rigid-cup/oscillation.toml", &["flow.cells-across"]),
    ("validation/rigid-cup/scene.toml", &["flow.cells-across"]),
    ("validation/ring-in-fluid/scene.toml", &["stages.force"]),
    ("validation/t-10/scene.toml", &[]),
    ("validation/t-10/stability.toml", &[]),
    ("validation/tube-pulse/scene.toml", &[]),
];

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/checks.md");
const BEGIN: &str = "<!-- made from crates/checks/src: begin -->\n";
const END: &str = "<!-- made from crates/checks/src: end -->\n";

/// After a change: `RIPSTOP_WRITE_DOCS=1 cargo test --release -p coupler --test checks the_page`.
#[test]
fn the_page_is_the_table() {
    let text = std::fs::read_to_string(DOCUMENT).expect("docs/reference/checks.md");
    let (head, rest) = text.split_once(BEGIN).expect("the begin of the table");
    let (old, tail) = rest.split_once(END).expect("the end of the table");
    let new = format!("\n{}\n", markdown());
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        std::fs::write(DOCUMENT, format!("{head}{BEGIN}{new}{END}{tail}")).expect("written");
    } else {
        assert!(old == new, "docs/reference/checks.md differs from the table: see the comment of this test");
    }
}

#[test]
fn every_check_is_described_in_full_and_once() {
    let checks: Vec<&Check> = all().collect();
    for (i, c) in checks.iter().enumerate() {
        assert!(checks[..i].iter().all(|o| o.id != c.id), "{} twice", c.id);
        assert!(c.id.split('.').count() == 2 && c.id == c.id.to_lowercase(), "{}", c.id);
        let mut parts = vec![c.what, c.estimate, c.range, c.source];
        if c.severity > Severity::Note {
            parts.push(c.remedy);
        }
        for part in parts {
            assert!(part.len() > 3 && !part.ends_with('.') && !part.contains('|'), "{}: {part:?}", c.id);
        }
        if let When::During(programs) = c.when {
            assert!(!programs.is_empty(), "{}", c.id);
        }
    }
}

/// A machine on which nothing is short.
const LARGE: Machine = Machine { cores: 64, memory: Some(1e12), disk: Some(1e13), hosts: false };

fn case_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(name)
}

/// The inspection of a scene's text for each of its flow methods; `file` lies where its mesh files are.
fn inspect(file: &Path, text: &str, machine: Machine) -> Inspection {
    let scene = case::parse(file, text).unwrap_or_else(|e| panic!("{e}"));
    let interface = CanopyInterface::new(&scene).unwrap_or_else(|e| panic!("{e}"));
    let mut found = Inspection { findings: Vec::new() };
    for view in scene.views(0) {
        let facts = Facts::new(&view, &interface, machine, 0).unwrap_or_else(|e| panic!("{e}"));
        found.findings.extend(Inspection::new(&facts, |_| String::new()).findings);
    }
    for f in &found.findings {
        let row = all().find(|c| c.id == f.check).expect("a row");
        assert!(f.severity <= row.severity, "{f:?} is worse than its row says");
    }
    found
}

/// `square-drop` with replacements.
fn square_drop(changes: &[(&str, &str)], machine: Machine) -> Inspection {
    let file = case_file("square-drop/scene.toml");
    let mut text = std::fs::read_to_string(&file).expect("the scene");
    for (from, to) in changes {
        assert!(text.contains(from), "the scene no longer contains {from:?}");
        text = text.replacen(from, to, 1);
    }
    inspect(&file, &text, machine)
}

/// Errors and warnings as `error fabric.thickness`, each once.
fn found(inspection: &Inspection) -> BTreeSet<String> {
    let above = inspection.above_notes();
    above.iter().map(|f| format!("{} {}", f.severity.name(), f.check)).collect()
}

/// Everything that earlier versions passed without a word.
#[test]
#[expect(clippy::too_many_lines, reason = "a table of changes to a scene")]
fn what_cannot_be_right_or_is_far_from_any_parachute_is_said() {
    let small = Machine { cores: 2, ..LARGE };
    let mut wrong = Vec::new();
    for (change, machine, wanted, figure) in [
        (
            ("youngs_modulus_pa = 2e8 ", "youngs_modulus_pa = 200 "),
            LARGE,
            "error fabric.strain",
            "Green strain of about 2159",
        ),
        (("3.048e-5", "0.05"), LARGE, "error fabric.thickness", "50.0 mm thick"),
        (("3.048e-5", "0.05"), LARGE, "warning descent.drag-coefficient", "a coefficient of 62.5"),
        (("1223.5093\n", "0.045\n"), LARGE, "error fabric.density", "0.0450 kg/m3"),
        (("1223.5093\n", "0.045\n"), LARGE, "error fabric.areal-density", "1.37e-6 kg/m2"),
        (("first_layer_m = 0.1", "first_layer_m = 2.0"), LARGE, "error flow.grid", "must be below a quarter"),
        (("first_layer_m = 0.1", "first_layer_m = 0.3"), LARGE, "warning flow.first-layer", "0.300 m thick"),
        (
            ("[descent]", "[ranks]\nflow = 1000\n\n[descent]"),
            small,
            "warning ranks.cores",
            "1000 ranks, this machine 2 cores",
        ),
        (("[descent]", "[ranks]\nflow = 1000\n\n[descent]"), small, "warning ranks.cells", "on 1000 ranks"),
        (("[descent]", "[ranks]\nflow = 90000\n\n[descent]"), small, "error ranks.cells", "on 90000 ranks"),
        (
            ("duration_s = 0.1\n", "duration_s = 0.098\n"),
            LARGE,
            "warning stage.windows",
            "runs 20 and ends at 0.100 s",
        ),
        (
            ("duration_s = 0.1\nwindow_s = 5e-3", "duration_s = 1.0\nwindow_s = 0.2"),
            LARGE,
            "warning stage.canopy-mode",
            "in a period",
        ),
        (
            ("initial_speed_m_s = 4.0", "initial_speed_m_s = 0.0"),
            LARGE,
            "error descent.initial-speed",
            "the air is at rest too",
        ),
        (
            ("initial_speed_m_s = 4.0", "initial_speed_m_s = 30.0"),
            LARGE,
            "warning descent.initial-speed",
            "times the steady speed",
        ),
        (
            ("cells_across = 12\nline_count = 24", "cells_across = 6\nline_count = 24"),
            LARGE,
            "warning flow.cells-across",
            "about 6 cells",
        ),
        (
            ("payload_mass_kg = 5.0", "payload_mass_kg = 5000.0"),
            LARGE,
            "warning descent.steady-speed",
            "descend at about 163 m/s",
        ),
        (
            ("pressure_pa = 12.0", "pressure_pa = -12.0"),
            LARGE,
            "error descent.pressure",
            "inside minus outside",
        ),
        (
            ("line_length_m = 2.4", "line_length_m = 24.0"),
            LARGE,
            "warning lines.length",
            "lines and risers of 24.0 m",
        ),
        (("area_m2 = 3.11e-6", "area_m2 = 3.11e-3"), LARGE, "warning lines.linear-density", "3805 g/m"),
        (
            ("youngs_modulus_pa = 5.3420e8", "youngs_modulus_pa = 5.3420e5"),
            LARGE,
            "error lines.stretch",
            "stretches 24 lines",
        ),
        (
            ("[coupling]", "[coupling]\nscheme = \"staggered\""),
            LARGE,
            "warning fabric.mass-ratio",
            "of the added mass of the air",
        ),
        (
            ("[descent]", "[fabric.contact]\ndistance_m = 0.01\n\n[descent]"),
            LARGE,
            "warning flow.method",
            "canopy with fabric.contact",
        ),
        (
            ("residual_drop = 1e-3\n", "residual_drop = 1e-3\n\n[flow.viscosity]\n"),
            LARGE,
            "warning flow.boundary-layer",
            "boundary layer is about",
        ),
        (
            ("layers_inside = 5", "far_field_widths = 2.0\nlayers_inside = 5"),
            LARGE,
            "warning flow.outer-boundary",
            "2.00 widths",
        ),
        (
            ("[descent]", "[output]\nvolume_every_windows = 1\n\n[descent]"),
            Machine { disk: Some(1e6), ..LARGE },
            "error machine.disk",
            "0.00100 GB are free",
        ),
        (
            ("width_m = 2.0", "width_m = 2.0 "),
            Machine { memory: Some(5e7), ..LARGE },
            "error machine.memory",
            "the machine has 0.0500 GB",
        ),
        (
            ("duration_s = 0.1\n", "duration_s = 90000.0\n"),
            LARGE,
            "warning machine.wall-time",
            "to a factor of three",
        ),
    ] {
        let inspection = square_drop(&[change], machine);
        let id = wanted.split(' ').nth(1).expect("an id");
        let said = inspection.above_notes().into_iter().any(|f| f.check == id && f.figure.contains(figure));
        if !said || !found(&inspection).contains(wanted) {
            wrong.push(format!("{change:?}: no {wanted}, {figure:?} in {:#?}", inspection.above_notes()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// All scenes of the repository run: no errors, and these warnings alone.
/// A fitted grid around a canopy with contact is warned of, unless the canopy opens in an immersed stage before.
#[test]
fn fitted_grid_after_an_immersed_opening_is_no_warning() {
    let contact = ("[descent]", "[fabric.contact]\ndistance_m = 0.01\n\n[descent]");
    let both = ("[flow.grid]", "[flow.immersed]\nspacing_m = 0.1\n\n[flow.grid]");
    let descent = "kind = \"coupled\"\nduration_s = 0.1\nwindow_s = 5e-3\n";
    let opening = format!("{descent}[[stage]]\nname = \"fitted\"\nflow_method = \"fitted\"\n{descent}");
    let fitted = format!("flow_method = \"fitted\"\n{descent}");
    for (stage, warned) in [(&opening, false), (&fitted, true)] {
        let inspection = square_drop(&[contact, both, (descent, stage)], LARGE);
        let lines = found(&inspection);
        assert_eq!(lines.contains("warning flow.method"), warned, "{lines:?}");
    }
}

#[test]
fn scenes_of_the_repository_have_no_errors_and_these_warnings() {
    for (name, warnings) in CASES {
        let file = case_file(name);
        let text = std::fs::read_to_string(&file).expect("the scene");
        let inspection = inspect(&file, &text, LARGE);
        let wanted: BTreeSet<String> = warnings.iter().map(|w| format!("warning {w}")).collect();
        assert_eq!(found(&inspection), wanted, "{name}: {:#?}", inspection.above_notes());
    }
}

/// Every scene below `cases` stands in [`CASES`].
#[test]
fn every_scene_of_the_repository_is_listed() {
    let mut folders = vec![case_file("")];
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).expect("a folder").flatten().map(|e| e.path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "toml") {
                let name = path.strip_prefix(case_file("")).expect("below").to_string_lossy().into_owned();
                assert!(CASES.iter().any(|(n, _)| *n == name), "{name} is not listed");
            }
        }
    }
}
