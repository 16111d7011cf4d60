//! Scenes that are right are read; scenes that are wrong say where and why.

use std::path::Path;

use case::{Canopy, Scene, SceneError, StageKind};

const ATPS: &str = include_str!("../../../cases/atps-descent/scene.toml");

fn read(text: &str) -> Result<Scene, SceneError> {
    case::parse(Path::new("scene.toml"), text)
}

/// The message for the ATPS scene with `from` replaced by `to`.
fn refused(from: &str, to: &str) -> String {
    assert!(ATPS.contains(from), "the scene no longer contains {from:?}");
    read(&ATPS.replacen(from, to, 1)).expect_err("this scene should be refused").to_string()
}

#[test]
fn every_case_in_the_repository_is_valid() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases");
    let mut seen = 0;
    let hard = std::fs::read_dir(cases.join("hard")).unwrap();
    for entry in std::fs::read_dir(cases).unwrap().chain(hard) {
        let file = entry.unwrap().path().join("scene.toml");
        if file.exists() {
            let scene = case::load(&file).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(Some(scene.name.as_str()), file.parent().unwrap().file_name().unwrap().to_str());
            seen += 1;
        }
    }
    assert!(seen >= 10);
}

#[test]
fn defaults_are_table_2_of_the_paper() {
    let scene = read(ATPS).unwrap();
    let Canopy::Atps(a) = &scene.canopy else { panic!("an ATPS scene") };
    assert_eq!((a.top_width_m, a.suspension_line_length_m), (6.43128, 6.40080));
    assert_eq!(scene.stages[2].kind, StageKind::Coupled);
    assert_eq!(scene.source_stage(2, case::Role::Flow), Some(1));
    assert_eq!(scene.source_stage(2, case::Role::Structure), Some(0));
    assert_eq!(scene.source_stage(2, case::Role::Mesh), None);
}

#[test]
fn a_misspelt_key_names_its_place_and_the_nearest_key() {
    let text = refused("thickness_m", "thicknes_m");
    assert!(text.contains("scene.toml:19:1: unknown key `thicknes_m` in [fabric]"), "{text}");
    assert!(text.contains("did you mean `thickness_m`?"), "{text}");
    assert!(!text.contains("missing key"), "{text}");
    assert!(text.contains("^^^^^^^^^^"), "{text}");
}

#[test]
fn a_static_stage_takes_no_time_and_all_others_do() {
    let times = "duration_s = 1.5\nwindow_s = 5e-3\n";
    let text = refused(times, "window_s = 5e-3\n");
    let line = 1 + ATPS.lines().position(|l| l == "[[stage]]").expect("a stage");
    assert!(text.contains("has no `duration_s`") && text.contains(&format!("scene.toml:{line}:")), "{text}");
    let text = refused(times, "solve = \"static\"\nduration_s = 1.0\n");
    assert!(text.contains("takes no time"), "{text}");
    let text = refused("kind = \"flow-only\"\n", "kind = \"flow-only\"\nsolve = \"static\"\n");
    assert!(text.contains("no static solution"), "{text}");
    let scene = read(&ATPS.replacen(times, "solve = \"static\"\n", 1)).unwrap();
    assert_eq!(scene.stages[0].solve, case::Solve::Static);
}

#[test]
fn a_neo_hookean_film_is_incompressible_isotropic_and_without_prestress() {
    let law = "law = \"neo-hookean\"\n";
    let text = refused("poisson_ratio = 0.3", &format!("{law}poisson_ratio = 0.3"));
    assert!(text.contains("`fabric.poisson_ratio` is 0.3") && text.contains("keeps its volume"), "{text}");
    let text = refused("poisson_ratio = 0.3", &format!("{law}prestress_pa = 1e3\npoisson_ratio = 0.5"));
    assert!(text.contains("prestress is that of a linear law"), "{text}");
    let warp = "poisson_ratio = 0.5\northotropic = { youngs_modulus_2_pa = 1e6, shear_modulus_pa = 1e6 }";
    let text = refused("poisson_ratio = 0.3", &format!("{law}{warp}"));
    assert!(text.contains("no warp"), "{text}");
    let scene = read(&ATPS.replacen("poisson_ratio = 0.3", &format!("{law}poisson_ratio = 0.5"), 1)).unwrap();
    assert_eq!(scene.fabric.law, case::Law::NeoHookean);
}

#[test]
fn a_missing_key_is_named_with_its_meaning() {
    let text = refused("thickness_m = 3.048e-5\n", "");
    assert!(text.contains("missing key `thickness_m` in [fabric]"), "{text}");
    assert!(text.contains("Thickness, m."), "{text}");
}

#[test]
fn keys_of_the_tagged_canopy_are_checked_too() {
    let text = refused("cells_along_vent = 10", "cells_along_vents = 10");
    assert!(text.contains("unknown key `cells_along_vents` in [canopy]"), "{text}");
    assert!(text.contains("did you mean `cells_along_vent`?"), "{text}");
    let text = refused("kind = \"atps\"", "kind = \"apts\"");
    assert!(text.contains("did you mean \"atps\"?"), "{text}");
}

#[test]
fn magnitudes_are_checked_with_their_units() {
    for (from, to, wanted) in [
        ("thickness_m = 3.048e-5", "thickness_m = 1e-320", "allowed: 1e-60 and more"),
        ("thickness_m = 3.048e-5", "thickness_m = -3.048e-5", "`fabric.thickness_m` is -0.00003048"),
        ("thickness_m = 3.048e-5", "thickness_m = 3.048", "is the value in metres?"),
        ("thickness_m = 3.048e-5", "thickness_m = nan", "`fabric.thickness_m` is NaN"),
        ("poisson_ratio = 0.3 ", "poisson_ratio = 0.6 ", "an isotropic solid has at most 0.5"),
        ("window_s = 2e-2", "window_s = 20.0", "a window is not longer than its stage"),
        ("initial_speed_m_s = 4.8768", "initial_speed_m_s = 400", "Mach"),
        ("cells_across = 18 ", "cells_across = 17 ", "odd"),
    ] {
        let text = refused(from, to);
        assert!(text.contains(wanted), "{to}: {text}");
        assert!(text.starts_with("scene.toml:"), "{text}");
    }
}

/// Plane stress divides by 1 - nu^2, not by 1 - 2 nu: an incompressible film such as rubber is regular.
#[test]
fn an_incompressible_film_is_allowed() {
    let scene = read(&ATPS.replacen("poisson_ratio = 0.3 ", "poisson_ratio = 0.5 ", 1)).unwrap();
    assert_eq!(scene.fabric.poisson_ratio, 0.5);
    assert!(refused("poisson_ratio = 0.3 ", "poisson_ratio = 0.5001 ").contains("at most 0.5"));
    assert!(refused("poisson_ratio = 0.3 ", "poisson_ratio = -1.0 ").contains("above -1 to 0.5"));
}

#[test]
fn effects_of_the_flow_are_checked_for_sense_and_contradictions() {
    const FLOW: &str = "[flow]                       # still air at sea level, inviscid, isothermal\n";
    const WINDY: &str = "[flow]\nwind_m_s = [3.0, 0.0, 0.0]\n";
    const STEADY: &str = "duration_s = 2.0\nwindow_s = 2e-2\n";
    let with = |flow: &str, stage: &str| ATPS.replacen(FLOW, flow, 1).replacen(STEADY, stage, 1);
    let shear = |rest: &str| format!("[flow.shear]\nstart_height_m = 50\nprofile = {rest}\n");
    let turbulent = |t: &str| format!("[flow.viscosity]\nturbulence = \"{t}\"\n");
    let windy = |rest: &str| format!("{WINDY}{}", shear(rest));
    let cloth = |keys: &str| format!("[fabric.permeability]\n{keys}\n{FLOW}");
    let march = "[stage.steady]\n";
    let immersed = |t: &str| format!("{}[flow.immersed]\nspacing_m = 0.3\n", turbulent(t));
    for (flow, stage) in [
        (immersed("wale"), STEADY),
        (immersed("smagorinsky\"\nwall_treatment = \"resolved"), STEADY),
        (windy("\"power\""), STEADY),
        (shear("\"table\"\nheight_m = [0, 9]\ntable_m_s = [[0, 0, 0], [1, 0, 0]]"), STEADY),
        (turbulent("ddes"), STEADY),
        (turbulent("spalart-allmaras"), march),
        (format!("{}wall_treatment = \"automatic\"\n", turbulent("wale")), STEADY),
        (cloth("cloth = \"mil-c7020-type3\""), march),
        (cloth("viscous_pa_s_m = inf"), STEADY),
    ] {
        let text = with(&flow, stage);
        read(&text).unwrap_or_else(|e| panic!("{flow}: {e}"));
    }
    for (flow, stage, wanted) in [
        (cloth(""), STEADY, "has no permeability"),
        (cloth("cloth = \"mil-c44378\"\nviscous_pa_s_m = 3"), STEADY, "two kinds of"),
        (cloth("viscous_pa_s_m = -3"), STEADY, "`viscous_pa_s_m` is -3"),
        (cloth("viscous_pa_s_m = 0"), STEADY, "without resistance"),
        (cloth("cloth = \"mil-c44387\""), STEADY, "did you mean"),
        (shear("\"log\""), STEADY, "a wind that is zero"),
        (windy("\"table\""), STEADY, "both give the wind"),
        (shear("\"table\""), STEADY, "0 heights and 0 winds"),
        (windy("\"power\"\nexponent = 3"), STEADY, "0.1 to 0.3 is usual"),
        (windy("\"power\""), march, "another wind at every height"),
        (turbulent("wale"), march, "never steady"),
        (immersed("ddes"), STEADY, "has the turbulence models smagorinsky and wale only"),
        (immersed("des97"), STEADY, "smagorinsky and wale only"),
        (immersed("spalart-allmaras"), STEADY, "smagorinsky and wale only"),
        (
            immersed("wale\"\nwall_treatment = \"automatic"),
            STEADY,
            "the immersed flow has no law of the wall",
        ),
        ("[flow.viscosity]\nwall_treatment = \"resolved\"\n".to_owned(), STEADY, "has no law of the wall"),
        (
            "[flow.gust]\nvelocity_m_s = [1, 0, 0]\nduration_s = 1\nclock = \"stage\"\n".to_owned(),
            march,
            "a gust changes in time",
        ),
        (FLOW.to_owned(), "window_s = 0.1\n[stage.steady]\n", "takes no time"),
        (FLOW.to_owned(), "[stage.steady]\nresidual_drop = 0\nforce_change = 0\n", "ends the march"),
    ] {
        let text = with(&flow, stage);
        let message = read(&text).expect_err(&flow).to_string();
        assert!(message.contains(wanted), "{flow}: {message}");
    }
    let text = refused("substeps = 10\n", "substeps = 10\nsteady = {}\n");
    assert!(text.contains("only a stage of kind \"flow-only\""), "{text}");
}

#[test]
fn wrong_types_and_names_say_what_is_allowed() {
    let text = refused("thickness_m = 3.048e-5", "thickness_m = \"thin\"");
    assert!(text.contains("`fabric.thickness_m` is a string, not a number"), "{text}");
    let text = refused("kind = \"coupled\"", "kind = \"couple\"");
    assert!(text.contains("did you mean \"coupled\"?"), "{text}");
    let text = refused("[descent]", "[descend]");
    assert!(text.contains("did you mean `descent`?"), "{text}");
    let text = refused("name = \"atps-descent\"", "name = \"../up\"");
    assert!(text.contains("becomes the name of a folder"), "{text}");
}

#[test]
fn a_relaxed_load_takes_no_unstable_extrapolation() {
    let scene = |predictor: u32| {
        let staggered = format!("staggered = {{ sequence = \"relaxed-load\", predictor = {predictor} }}");
        read(&ATPS.replacen("[coupling]\n", &format!("[coupling]\nscheme = \"staggered\"\n{staggered}\n"), 1))
    };
    let named = scene(1).expect("a scene").coupling.staggered.sequence;
    assert_eq!(named, case::StaggeredSequence::RelaxedLoad);
    let text = scene(2).expect_err("unstable").to_string();
    assert!(
        text.contains("`coupling.staggered.predictor` is 2") && text.contains("allowed: 0 to 1"),
        "{text}"
    );
}

#[test]
fn sections_that_need_each_other() {
    let text = refused("pressure_pa = 14.5672\n", "");
    assert!(text.contains("inflates, but with no pressure"), "{text}");
    let text = refused("kind = \"pre-inflation\"\npressure_pa = 14.5672", "kind = \"flow-only\"");
    assert!(text.contains("closed slits"), "{text}");
    let text = read("name = 1").unwrap_err().to_string();
    assert!(text.contains("missing key `canopy`"), "{text}");
    let text = read("name = ").unwrap_err().to_string();
    assert!(text.contains("not TOML"), "{text}");
}

#[test]
fn the_schema_kept_for_editors_is_the_one_of_the_types() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/scene.schema.json");
    let text = serde_json::to_string_pretty(&case::schema()).unwrap() + "\n";
    if std::env::var_os("RIPSTOP_WRITE").is_some() {
        std::fs::write(&file, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(kept == text, "run `RIPSTOP_WRITE=1 cargo test -p case` to write cases/scene.schema.json anew");
}

#[test]
fn a_mesh_file_that_does_not_exist_is_refused() {
    let start = ATPS.find("[canopy]").unwrap();
    let end = ATPS.find("[fabric]").unwrap();
    let text = [&ATPS[..start], "[canopy]\nkind = \"gmsh\"\nfile = \"no.msh\"\n", &ATPS[end..]].concat();
    let message = read(&text).expect_err("there is no such file").to_string();
    assert!(message.contains("no.msh does not exist"), "{message}");
    assert!(message.contains("no flow grid"), "{message}");
}

#[test]
fn what_the_flow_writes_is_read_and_checked() {
    let with = |more: &str| read(&ATPS.replacen("[coupling]", &[more, "\n[coupling]"].concat(), 1));
    let probe = "[[flow.probe]]\nname = \"wake\"\nposition_m = [0, 0, 5.0]\n";
    let all = [
        probe,
        "[flow.statistics]\nstart_s = 0.5\n[flow.forces]\nmoment_point_m = [0.0, 0.0, -10.0]\n",
        "[[flow.slice]]\nname = \"middle\"\npoint_m = [0, 0, 0]\nnormal = [0, 1, 0]\nevery_windows = 10\n",
        "[flow.surface_pressure]\nevery_windows = 5\n",
    ];
    let flow = with(&all.concat()).unwrap().flow.unwrap();
    assert_eq!((flow.probes[0].name.as_str(), flow.probes[0].position_m[2]), ("wake", 5.0));
    assert_eq!(flow.statistics.unwrap(), case::Statistics { start_s: 0.5, across_stages: false });
    assert_eq!(flow.forces.unwrap().drag_direction, [0.0, 0.0, 1.0]);
    assert_eq!((flow.slices[0].every_windows, flow.surface_pressure.unwrap().every_windows), (10, 5));
    for (text, wanted) in [
        ([probe, probe].concat(), "flow.probe[1].name"),
        (all[2].replace("[0, 1, 0]", "[0, 0, 0]"), "no direction"),
        (all[2].replace("\"middle\"", "\"flow\""), "flow.slice[0].name"),
        (all[3].replace('5', "0"), "every_windows"),
        (all[0].replace("position_m", "position"), "did you mean `position_m`?"),
        ("[flow.grid_file]\npath = \"no.msh\"\n[flow.grid_file.patches]\n".into(), "no.msh does not exist"),
        ("[flow.grid_file]\npath = \"x\"\n[flow.grid_file.patches]\nend = \"slipp\"\n".into(), "slip"),
    ] {
        let message = with(&text).expect_err(&text).to_string();
        assert!(message.contains(wanted), "{text}: {message}");
    }
}

#[test]
fn a_panel_needs_its_box_and_a_box_its_panel() {
    let panel = include_str!("../../../cases/hard/membrane-box/scene.toml");
    let refused = |from: &str, to: &str| {
        assert!(panel.contains(from), "the scene no longer contains {from:?}");
        read(&panel.replacen(from, to, 1)).expect_err("this scene should be refused").to_string()
    };
    assert!(refused("layers_above = 8", "layers_above = 8\nfirst_layer_m = 0.2").contains("equal layers"));
    assert!(refused("layers_above = 8", "layers_above = 8\nahead_m = 0.5").contains("cells_ahead"));
    assert!(refused("prestress_pa = 730.0", "prestress_pa = 7300.0").contains("half the modulus"));
    let text = refused("prestress_pa = 730.0", "bending_stiffness_n_m = 0.0");
    assert!(text.contains("fabric.bending_stiffness_n_m") && text.contains("nylon cloth"), "{text}");
    assert!(refused("cells = [12, 12]", "cells = [12, 0]").contains("canopy.cells[1]"));
    assert!(refused("top = \"outlet\"", "top = \"hole\"").contains("hole"));
    let closed = panel.replace("\"outlet\"", "\"inlet\"");
    let message = read(&closed).expect_err("no air leaves").to_string();
    assert!(message.contains("flow.box.sides") && message.contains("lets it leave"), "{message}");
    assert!(read(&closed.replacen("\"inlet\"", "\"far-field\"", 1)).is_ok());
    let start = panel.find("[flow.box]").unwrap();
    let end = panel.find("[flow.solver]").unwrap();
    let text = read(&[&panel[..start], &panel[end..]].concat()).unwrap_err().to_string();
    assert!(text.contains("add [flow.box]"), "{text}");
    let text = read(&ATPS.replacen("[flow.grid]", &[&panel[start..end], "[flow.grid]"].concat(), 1));
    let text = text.unwrap_err().to_string();
    assert!(text.contains("a box fits around a panel only"), "{text}");
}

/// An editor that checks against the schema must answer a misspelt key wherever this crate does: every table is
/// closed, except where the keys are the user's own.
#[test]
fn every_table_of_the_schema_is_closed() {
    fn open_tables(schema: &serde_json::Value, at: &str, found: &mut Vec<String>) {
        if let Some(map) = schema.as_object() {
            let is_table =
                map.get("type").and_then(|t| t.as_str()) == Some("object") || map.contains_key("properties");
            // In a list of names, such as `properties`, a key is no keyword of the schema.
            let is_names = at.ends_with("/properties") || at.ends_with("/$defs");
            if is_table
                && !is_names
                && map.get("additionalProperties") != Some(&serde_json::Value::Bool(false))
            {
                found.push(at.to_owned());
            }
            map.iter().for_each(|(key, inner)| open_tables(inner, &format!("{at}/{key}"), found));
        } else if let Some(list) = schema.as_array() {
            list.iter().enumerate().for_each(|(i, inner)| open_tables(inner, &format!("{at}/{i}"), found));
        }
    }
    let mut found = Vec::new();
    open_tables(&case::schema(), "", &mut found);
    // The groups of a grid file have the names that its author gave them.
    assert_eq!(found, ["/$defs/GridFile/properties/patches"]);
    let text = refused("[canopy]", "programs.strukture = \"x\"\n[canopy]");
    assert!(text.contains("unknown key `strukture`") && text.contains("did you mean `structure`?"), "{text}");
}

/// The small canopy with both flow methods: stages after the pre-inflation, each a kind and its `flow_method`.
fn both_methods(stages: &[(&str, &str)]) -> Result<case::Scene, String> {
    let text = include_str!("../../../cases/square-drop/scene.toml");
    let before = text.find("[[stage]]\nname = \"developed-flow\"").expect("a stage");
    let mut text = text[..before].replace("[flow.grid]", "[flow.immersed]\nspacing_m = 0.15\n\n[flow.grid]");
    for (k, (kind, method)) in stages.iter().enumerate() {
        let method = if method.is_empty() { String::new() } else { format!("flow_method = \"{method}\"\n") };
        text += &format!(
            "[[stage]]\nname = \"s{k}\"\nkind = \"{kind}\"\n{method}duration_s = 0.1\nwindow_s = 5e-3\n"
        );
        if *kind == "prescribed" {
            text += "[[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0, 1]\ndisplacement_m = [[0, 0, 0], [0, 0, 1]]\n";
        }
    }
    read(&text).map_err(|e| e.to_string())
}

#[test]
fn stages_choose_their_flow_method() {
    use case::{Discretisation, Role};
    let stages = [
        ("flow-only", ""),
        ("coupled", "immersed"),
        ("coupled", "fitted"),
        ("coupled", "fitted"),
        ("coupled", ""),
    ];
    let scene = both_methods(&stages).unwrap_or_else(|e| panic!("{e}"));
    let roles = |k: usize| scene.roles(&scene.stages[k]).to_vec();
    assert_eq!(roles(1), [Role::Flow]);
    assert_eq!([roles(2), roles(5)], [[Role::Structure, Role::Flow]; 2]);
    assert_eq!([roles(3), roles(4)], [[Role::Structure, Role::Flow, Role::Mesh]; 2]);
    // Structure and flow start where they ended; the fitted grid is new around the shape that the immersed stage left.
    let source = |role| [2, 3, 4, 5].map(|k| scene.source_stage(k, role));
    assert_eq!(source(Role::Structure), [0, 2, 3, 4].map(Some));
    assert_eq!(source(Role::Flow), [1, 2, 3, 4].map(Some));
    assert_eq!(source(Role::Mesh), [None, None, Some(3), Some(4)]);
    let shape = |k| scene.grid_shape(Path::new("out"), k).expect("a shape");
    assert_eq!(shape(2), Path::new("out/pre-inflation/state/canopy.bin"));
    assert_eq!([shape(3), shape(4)], [0; 2].map(|_| Path::new("out/s1/state/canopy.bin").to_owned()));

    // A program sees the method of its stage; roles of all stages stay.
    for k in 0..6 {
        let view = scene.for_stage(k);
        assert_eq!(view.flow.as_ref().is_some_and(case::Flow::is_immersed), ![3, 4].contains(&k), "{k}");
        for (a, b) in view.stages.iter().zip(&scene.stages) {
            assert_eq!((view.roles(a), a.flow_method), (scene.roles(b), Some(scene.discretisation(b))));
        }
        assert_eq!(view.source_stage(5, Role::Mesh), Some(4));
    }
    let views = scene.views(0);
    assert_eq!(views.len(), 2);
    let of = |k: usize| views.iter().filter(|v| v.is_of_view(&v.stages[k])).count();
    assert_eq!([0, 1, 2, 3, 4, 5].map(of), [2, 1, 1, 1, 1, 1]);
    assert_eq!((scene.views(5).len(), scene.stages[5].flow_method), (1, None));
    assert_eq!(scene.views(5)[0].stages[5].flow_method, Some(Discretisation::Immersed));

    // Without the choice nothing changes: the mover continues across stages.
    let fitted = read(include_str!("../../../cases/square-drop/scene.toml")).unwrap();
    assert!(!fitted.is_immersed(&fitted.stages[2]) && fitted.views(0).len() == 1);
}

/// A fitted grid after an immersed stage that leaves the canopy still is new too, around the shape that the structure has then.
#[test]
fn fitted_grid_after_an_immersed_flow_has_the_shape_of_the_structure() {
    let scene = both_methods(&[("coupled", "fitted"), ("flow-only", ""), ("coupled", "fitted")])
        .unwrap_or_else(|e| panic!("{e}"));
    let shape = scene.grid_shape(Path::new("out"), 3);
    assert_eq!(shape.as_deref(), Some(Path::new("out/s0/state/canopy.bin")));
    assert_eq!(scene.source_stage(3, case::Role::Mesh), None);
}

#[test]
fn flow_methods_that_cannot_follow_each_other_are_refused() {
    let text = include_str!("../../../cases/square-drop/scene.toml");
    let descent = "kind = \"coupled\"\n";
    let with = |method: &str| text.replace(descent, &format!("{descent}flow_method = \"{method}\"\n"));
    let error = read(&with("immersed")).expect_err("no section").to_string();
    assert!(error.contains("flow_method") && error.contains("add [flow.immersed] with spacing_m"), "{error}");
    read(&with("fitted")).unwrap_or_else(|e| panic!("{e}"));
    assert!(read(&with("both")).is_err());
    for (first, second) in [("immersed", "fitted"), ("fitted", "immersed")] {
        let error = both_methods(&[("prescribed", first), ("flow-only", second)]).expect_err("no structure");
        assert!(error.contains("use the same `flow_method`"), "{error}");
    }
    both_methods(&[("prescribed", "fitted"), ("flow-only", "fitted")]).unwrap_or_else(|e| panic!("{e}"));

    // Vents that an immersed stage has opened.
    let atps = include_str!("../../../cases/atps-opening/scene.toml");
    let later = |method: &str| {
        let stage = "[[stage]]\nname = \"descent\"\nkind = \"coupled\"\nduration_s = 0.2\nwindow_s = 5e-3\n";
        format!("{atps}\n{stage}flow_method = \"{method}\"\n")
    };
    read(&later("fitted")).unwrap_or_else(|e| panic!("{e}"));
    let closed = later("fitted").replacen("kind = \"coupled\"", "kind = \"flow-only\"", 1);
    let error = read(&closed).expect_err("closed vents").to_string();
    assert!(error.contains("no flow grid fits them"), "{error}");
}

/// A canopy of gores in an immersed flow; `canopy`: more keys of its table.
fn gored(canopy: &str) -> Result<Scene, String> {
    immersed("gored", canopy)
}

/// A canopy of a kind in an immersed flow.
fn immersed(kind: &str, canopy: &str) -> Result<Scene, String> {
    let text = include_str!("../../../cases/square-drop/scene.toml");
    let (from, to) = (text.find("[canopy]").expect("a canopy"), text.find("[fabric]").expect("fabric"));
    let stage = text.find("[[stage]]\nname = \"developed-flow\"").expect("a stage");
    let canopy = format!("[canopy]\nkind = \"{kind}\"\n{canopy}\n");
    let text = text[..from].to_owned() + &canopy + &text[to..stage] + &text[stage..];
    read(&text.replace("[flow.grid]", "[flow.immersed]\nspacing_m = 0.15\n\n[flow.grid]"))
        .map_err(|e| e.to_string())
}

#[test]
fn sections_of_gores_are_checked() {
    let sizes = "nominal_diameter_m = 8.0\nline_length_m = 7.0\ncells_along = 8\ngores = 24\nprofile = \"sections\"\n";
    let section = |more: &str| format!("[[canopy.section]]\nlength = 1.0\n{more}\n");
    let disk_and_band = section("") + &section("angle_deg = 90.0");
    let scene = gored(&(sizes.to_owned() + &disk_and_band)).unwrap_or_else(|e| panic!("{e}"));
    let case::Canopy::Gored(g) = &scene.canopy else { panic!("gores") };
    assert_eq!(
        g.sections.iter().map(|s| (s.angle_deg, s.gap)).collect::<Vec<_>>(),
        [(0.0, false), (90.0, false)]
    );
    let gap = section("gap = true");
    for (sections, message) in [
        (String::new(), "has no [[canopy.section]]"),
        (section("angle_deg = 90.0"), "canopy.section[0].angle_deg"),
        (section("") + &gap, "a gap is the first or the last section"),
        (section("") + &gap + &section(""), "no radial tapes hold the parts together"),
        (section("").repeat(9), "8 cells along a gore for 9 sections"),
        (section("length_m = 2.0"), "length_m"),
    ] {
        let error = gored(&(sizes.to_owned() + &sections)).expect_err(message);
        assert!(error.contains(message), "{message}: {error}");
    }
    let taped =
        section("") + &gap + &section("") + "[tapes.seams]\naxial_stiffness_n = 1e4\nmass_kg_m = 0.01\n";
    gored(&(sizes.to_owned() + &taped)).unwrap_or_else(|e| panic!("{e}"));
    let flat = sizes.replace("profile = \"sections\"\n", "");
    let error = gored(&(flat + &disk_and_band)).expect_err("a flat canopy with sections");
    assert!(error.contains("belongs to profile = \"sections\""), "{error}");
}

/// A canopy that was inflated reefed by about the dynamic pressure does not open from a gathered skirt, nor does one without a cut line.
#[test]
fn gathered_openings_differ_from_reefed_ones() {
    let text = include_str!("../../../cases/flat-circular-opening/scene.toml");
    let scene = |text: &str| read(text).unwrap_or_else(|e| panic!("{e}"));
    let opens = |text: &str| scene(text).opens_gathered();
    assert!(opens(text));
    assert!(!opens(&text.replace("pressure_pa = 0.01 ", "pressure_pa = 800.0 ")));
    assert!(!opens(&text.replace("release_stage = \"opening\"\nrelease_s = 0.0\n", "")));
    // The confluence point held in a wind: an opening at infinite mass.
    let (start, end) =
        (text.find("[descent]").expect("a descent"), text.find("[[reefing]]").expect("a reefing line"));
    let held = text[..start].to_owned() + &text[end..];
    assert!(!opens(&held));
    assert!(opens(&held.replace("[flow]\n", "[flow]\nwind_m_s = [0.0, 0.0, 40.0]\n")));
}

#[test]
fn crosses_are_checked() {
    // Each key once: `change` replaces its line.
    let cross = |change: &str| {
        let keys = [
            "panel_width_m = 2.0",
            "panel_length_m = 6.0",
            "cells_across = 4",
            "cells_along_arm = 5",
            "lines_per_arm = 3",
            "line_length_m = 7.0",
        ];
        let key = change.split(' ').next().unwrap_or_default();
        let kept = keys.iter().filter(|k| !k.starts_with(&format!("{key} "))).map(|k| format!("{k}\n"));
        immersed("cross", &(kept.collect::<String>() + change))
    };
    cross("").unwrap_or_else(|e| panic!("{e}"));
    for (change, message) in [
        ("panel_length_m = 1.5", "is not longer than wide"),
        ("cells_across = 5", "`canopy.cells_across` is 5, which is odd"),
        ("lines_per_arm = 6", "do not fit on the 5 nodes"),
        ("line_length_m = 3.0", "make them longer than 3.162 m"),
    ] {
        let error = cross(change).expect_err(change);
        assert!(error.contains(message), "{change}: {error}");
    }
}

#[test]
fn gores_are_checked() {
    let sizes = "nominal_diameter_m = 8.0\nline_length_m = 7.0\ncells_along = 8\n";
    let scene = gored(&format!("{sizes}gores = 24")).unwrap_or_else(|e| panic!("{e}"));
    let case::Canopy::Gored(g) = &scene.canopy else { panic!("gores") };
    assert_eq!((g.profile, g.cells_per_gore, g.vent_diameter()), (case::GoreProfile::Flat, 2, 0.8));
    for (more, message) in [
        ("gores = 23", "`canopy.gores` is 23, which is odd"),
        ("gores = 24\ncone_angle_deg = 20.0", "belongs to profile = \"conical\""),
        ("gores = 24\nprofile = \"conical\"", "a conical canopy has no `cone_angle_deg`"),
        ("gores = 24\nvent_diameter_m = 7.9", "canopy.vent_diameter_m"),
        ("gores = 24\ncells_per_gore = 3", "`canopy.cells_per_gore` is 3, which is odd"),
    ] {
        let error = gored(&(sizes.to_owned() + more)).expect_err(more);
        assert!(error.contains(message), "{more}: {error}");
    }
}

/// Risers of gores and crosses: their number divides the lines, they have a section, and one place of their lower ends.
#[test]
fn risers_of_canopies_are_checked() {
    const SECTION: &str = "[risers]\naxial_stiffness_n = 1e5\nmass_kg_m = 0.05\n";
    let sizes = "nominal_diameter_m = 8.0\nline_length_m = 7.0\ncells_along = 8\ngores = 24\n";
    let risers = |keys: &str| format!("{sizes}[canopy.risers]\n{keys}\n");
    let four = risers("count = 4\nlength_m = 0.9");
    let scene = gored(&(four.clone() + SECTION)).unwrap_or_else(|e| panic!("{e}"));
    let r = scene.canopy.risers().expect("risers");
    assert_eq!((r.count, r.length_m, r.spread_m), (4, 0.9, 0.0));
    for (text, message) in [
        (risers("count = 5\nlength_m = 0.9") + SECTION, "24 lines cannot be shared by 5 risers"),
        (
            risers("count = 5\nlength_m = 0.9") + SECTION,
            "use a number that divides the lines: 1, 2, 3, 4, 6, 8, 12",
        ),
        (risers("count = 0\nlength_m = 0.9") + SECTION, "`canopy.risers.count` is 0"),
        (risers("count = 4\nlength_m = 7.5") + SECTION, "risers of 7.5 m are as long as the lines (7 m)"),
        (risers("count = 4\nlength_m = 0.9\nspread_m = 9.0") + SECTION, "`canopy.risers.spread_m` is 9"),
        (risers("count = 1\nlength_m = 0.9\nspread_m = 0.3") + SECTION, "one riser has no attachment points"),
        (risers("count = 4") + SECTION, "length_m"),
        (four, "the scene has 4 risers but no [risers]"),
        (sizes.to_owned() + SECTION, "all lines run to one point"),
    ] {
        let error = gored(&text).expect_err(message);
        assert!(error.contains(message), "{message}: {error}");
    }
    let cross = "panel_width_m = 2.0\npanel_length_m = 6.0\ncells_across = 4\ncells_along_arm = 5\nlines_per_arm = 3\nline_length_m = 7.0\n";
    let error = immersed("cross", &format!("{cross}[canopy.risers]\ncount = 5\nlength_m = 0.9\n{SECTION}"));
    assert!(error.expect_err("five").contains("12 lines cannot be shared by 5 risers"));
}

/// The attachments of a body are the only place of the lower ends of the risers.
#[test]
fn risers_end_at_the_attachments_of_a_body() {
    let text = include_str!("../../../coupler/tests/reference/examples/gored.toml");
    let spread = read(text).unwrap_or_else(|e| panic!("{e}")).canopy.risers().expect("risers").spread_m;
    assert!(spread > 0.0);
    let body =
        "[descent.body]\ninertia_kg_m2 = [3.0, 3.0, 4.0]\nattachments_m = [[0.0, 0.0, 0.4]]\n\n[[stage]]";
    let error = read(&text.replacen("[[stage]]", body, 1)).expect_err("two places").to_string();
    assert!(error.contains("both place the lower ends of the risers"), "{error}");
}

/// Fullness is a share of cloth, and one number on an edge that two sections share.
#[test]
fn fullness_of_sails_is_checked() {
    let sizes = "nominal_diameter_m = 8.0\nline_length_m = 7.0\ncells_along = 8\ngores = 24\nprofile = \"sections\"\n";
    let seams = "[tapes.seams]\nmaterial = \"pia-t5038-type3-inch\"\n";
    let section = |more: &str| format!("[[canopy.section]]\nlength = 1.0\n{more}\n");
    let sails = |middle: &str| {
        sizes.to_owned() + &section("lower_fullness = 0.03") + &section(middle) + &section("") + seams
    };
    let two = section("lower_fullness = 0.03") + &section("upper_fullness = 0.03\nlower_fullness = 0.1");
    let scene = gored(&(sizes.to_owned() + &two)).unwrap_or_else(|e| panic!("{e}"));
    let case::Canopy::Gored(g) = &scene.canopy else { panic!("gores") };
    assert_eq!(g.sections.iter().map(|s| s.lower_fullness).collect::<Vec<_>>(), [0.03, 0.1]);
    gored(&sails("gap = true")).unwrap_or_else(|e| panic!("{e}"));
    let slot = gored(&sails("crescent_slot = true")).unwrap_or_else(|e| panic!("{e}"));
    let case::Canopy::Gored(g) = &slot.canopy else { panic!("gores") };
    assert!(g.has_crescent_slots());
    let loose = gored(&sails("crescent_slot = true").replace(seams, "")).expect_err("no radials");
    assert!(loose.contains("gaps or slots, and no radial tapes"), "{loose}");
    let first = sizes.to_owned() + &section("crescent_slot = true") + &section("") + seams;
    assert!(gored(&first).expect_err("the vent").contains("no cloth on both sides"));
    for (middle, message) in [
        (
            "upper_fullness = 0.05",
            "sections 0 and 1 share an edge, and have a fullness of 0.03 and 0.05 there",
        ),
        ("upper_fullness = 0.03\nlower_fullness = 5.0", "`canopy.section[1].lower_fullness` is 5"),
        ("gap = true\nupper_fullness = 0.03", "section 1 is a gap, and has a fullness of 0.03"),
        (
            "crescent_slot = true\nupper_fullness = 0.03",
            "sections 0 and 1 both have a fullness of 0.03 at the slot",
        ),
        ("crescent_slot = true\ngap = true", "section 1 has no cloth on both sides of its upper edge"),
    ] {
        let error = gored(&sails(middle)).expect_err(message);
        assert!(error.contains(message), "{message}: {error}");
    }
}

#[test]
fn altitude_gives_the_air_that_the_scene_leaves_out() {
    let of = |flow: &str| {
        read(&ATPS.replacen("[flow.grid]", &format!("{flow}\n[flow.grid]"), 1)).unwrap().flow.unwrap()
    };
    let high = of("altitude_m = 5_000.0");
    assert!((high.density_kg_m3 - 0.736116).abs() < 1e-5, "{}", high.density_kg_m3);
    assert!((high.temperature_k - 255.65).abs() < 1e-9);
    let given = of("altitude_m = 5000\ndensity_kg_m3 = 0.8\nviscosity = {}");
    assert_eq!((given.density_kg_m3, given.temperature_k), (0.8, high.temperature_k));
    assert!((given.viscosity.unwrap().dynamic_viscosity_pa_s - 1.6281e-5).abs() < 1e-9);
    let laminar = of("altitude_m = 5000\nviscosity = { dynamic_viscosity_pa_s = 0.1 }");
    assert_eq!(laminar.viscosity.unwrap().dynamic_viscosity_pa_s, 0.1);
    let ground = of("altitude_m = 0");
    assert!((ground.density_kg_m3 - 1.225).abs() < 1e-6);
    let text = refused("[flow.grid]", "altitude_m = 3e4\n[flow.grid]");
    assert!(text.contains("`flow.altitude_m`") && text.contains("20000"), "{text}");
}

#[test]
fn frame_that_drifts_is_checked() {
    let drift = "initial_drift_m_s = [3.0, 0.0]\n";
    let text = refused("payload_mass_kg", &format!("{drift}payload_mass_kg"));
    assert!(text.contains("moves vertically") && text.contains("three-dimensional"), "{text}");
    let free = format!("{drift}motion = \"three-dimensional\"\npayload_mass_kg");
    let scene = read(&ATPS.replacen("payload_mass_kg", &free, 1)).unwrap();
    assert!(scene.frame_drifts());
    assert_eq!(scene.resolved().initial_velocity_m_s, [3.0, 0.0, -4.8768]);
    let body = |more: &str| {
        format!(
            "[fabric_gravity]\n[descent.body]\ninertia_kg_m2 = [5.0, 5.0, 3.0]\nattachments_m = [[0.0, 0.0, 0.2]]\n{more}\n[[stage]]"
        )
    };
    let scene = read(&ATPS.replacen("[[stage]]", &body(""), 1)).unwrap();
    assert!(scene.frame_drifts(), "a body is free");
    let text = refused("[[stage]]", &body("initial_velocity_m_s = [0.1, 0.0, 0.0]"));
    assert!(text.contains("follows the payload") && text.contains("motion = \"vertical\""), "{text}");
    assert!(!scene.has_landed([0.0, 0.0, -1e6]));
    let released = ATPS.replacen("payload_mass_kg", "release_height_m = 50.0\npayload_mass_kg", 1);
    let scene = read(&released).unwrap();
    // The flow stage before the release takes 2 s at 4.8768 m/s.
    let shear = |start: f64| {
        let shear =
            format!("shear = {{ start_height_m = {start}, profile = \"linear\", slope_per_m = 0.01 }}");
        released.replacen("[flow.grid]", &format!("wind_m_s = [2.0, 0.0, 0.0]\n{shear}\n[flow.grid]"), 1)
    };
    assert!(read(&shear(59.7536)).is_ok());
    let text = read(&shear(50.0)).unwrap_err().to_string();
    assert!(text.contains("that of 40.246 m"), "{text}");
    assert!(scene.has_landed([9.0, 0.0, -50.0]) && !scene.has_landed([9.0, 0.0, -49.9]));
}
