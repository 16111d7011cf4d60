//! Winds, gusts and motions across the boundaries of stages.

use std::path::Path;

use case::{Scene, StageTimes, jumps};

const BASE: &str = "name = \"windy\"\n\
    [canopy]\nkind = \"square\"\nwidth_m = 2.0\ncells_across = 8\nline_count = 8\nline_length_m = 2.4\n\
    [fabric]\nyoungs_modulus_pa = 1e7\npoisson_ratio = 0.3\nthickness_m = 3e-5\ndensity_kg_m3 = 1200.0\n\
    [lines]\nyoungs_modulus_pa = 5e8\narea_m2 = 3e-6\ndensity_kg_m3 = 1200.0\n\
    [descent]\npayload_mass_kg = 5.0\ninitial_speed_m_s = 4.0\nreference_area_m2 = 4.0\n";
/// 0.3 s of inflation, 0.2 s of flow, 0.1 s and 0.1 s of descent.
const FLOW: &str = "[flow]\nwind_m_s = [1.0, 0.0, 0.0]\n";
const INFLATE: &str = "[[stage]]\nname = \"inflation\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nduration_s = 0.3\nwindow_s = 0.01\n";
const DEVELOP: &str = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.2\nwindow_s = 0.02\n";
const FALL: &str = "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = 0.1\nwindow_s = 0.005\n";
const ON: &str = "[[stage]]\nname = \"on\"\nkind = \"coupled\"\nduration_s = 0.1\nwindow_s = 0.005\n";

fn try_read(parts: &[&str]) -> Result<Scene, String> {
    case::parse(Path::new("scene.toml"), &format!("{BASE}{}", parts.concat())).map_err(|e| e.to_string())
}

fn read(parts: &[&str]) -> Scene {
    try_read(parts).unwrap_or_else(|e| panic!("{e}"))
}

fn gust(clock: &str) -> String {
    let clock = if clock.is_empty() { String::new() } else { format!("clock = \"{clock}\"\n") };
    format!("[flow.gust]\nvelocity_m_s = [0, 0, 2]\nstart_s = 0.05\nduration_s = 0.1\n{clock}")
}

/// Wind along z at `t` of each of the stages.
fn up(scene: &Scene, stage: usize, t: f64) -> f64 {
    scene.wind(stage, &StageTimes::planned(scene)).at(t)[2]
}

#[test]
fn a_gust_of_the_scene_counts_from_the_release_through_all_later_stages() {
    let scene = read(&[FLOW, &gust(""), INFLATE, DEVELOP, FALL, ON]);
    assert_eq!(scene.release_stage(), 2);
    // None before the release; its peak is the boundary between the two coupled stages.
    for t in [0.0, 0.05, 0.1, 0.2] {
        assert_eq!((up(&scene, 0, t), up(&scene, 1, t)), (0.0, 0.0), "{t}");
    }
    assert!((up(&scene, 2, 0.075) - 1.0).abs() < 1e-12 && (up(&scene, 2, 0.1) - 2.0).abs() < 1e-12);
    assert!((up(&scene, 3, 0.025) - 1.0).abs() < 1e-12 && up(&scene, 3, 0.06) == 0.0);
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
    // Before its start a stage has the wind of the one before.
    assert!((up(&scene, 3, -0.01) - up(&scene, 2, 0.09)).abs() < 1e-12);
    assert_eq!(up(&scene, 3, 0.0), up(&scene, 2, 0.1));
}

#[test]
fn the_clock_of_the_run_passes_through_every_boundary_without_a_jump() {
    // From 0.45 to 0.55 s of the run: the release at 0.5 s is its peak.
    let text = gust("run").replace("0.05", "0.45");
    let scene = read(&[FLOW, &text, INFLATE, DEVELOP, FALL, ON]);
    assert!((up(&scene, 1, 0.175) - 1.0).abs() < 1e-12 && (up(&scene, 2, 1e-9) - 2.0).abs() < 1e-12);
    let mut last = up(&scene, 1, 0.0);
    let slope = std::f64::consts::PI * 2.0 / 0.1;
    for (stage, end) in [(1, 0.2), (2, 0.1), (3, 0.1)] {
        for k in 0..=1000 {
            let now = up(&scene, stage, end * f64::from(k) / 1000.0);
            assert!((now - last).abs() <= slope * end / 1000.0 + 1e-12, "stage {stage}, step {k}");
            last = now;
        }
    }
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
}

/// A stage that ended early: the clock goes by what it took, not by what was planned.
#[test]
fn clocks_follow_the_times_that_stages_took() {
    let text = gust("run").replace("0.05", "0.45");
    let scene = read(&[FLOW, &text, INFLATE, DEVELOP, FALL]);
    let out = std::env::temp_dir().join(format!("ripstop-winds-{}", std::process::id()));
    let state = case::state_folder(&out, &scene, 1);
    std::fs::create_dir_all(&state).unwrap();
    let planned = StageTimes::completed(&scene, &out, 2);
    assert_eq!(planned, StageTimes::planned(&scene));
    let took = 0.1 + 0.06;
    case::save_time(&state, took).unwrap();
    let times = StageTimes::completed(&scene, &out, 2);
    assert_eq!((times.of(1), times.start(2)), (took, 0.3 + took));
    // A stage's own state says nothing about its start.
    assert_eq!(StageTimes::completed(&scene, &out, 1), planned);
    std::fs::remove_dir_all(&out).unwrap();
    let (a, b) = (scene.wind(2, &times), scene.wind(2, &planned));
    assert!((a.at(0.09)[2] - b.at(0.05)[2]).abs() < 1e-12, "0.04 s later");
    assert!((a.at(0.04)[2] - 2.0).abs() < 1e-12, "the peak is at 0.5 s of the run");
    assert_eq!(a.start().unwrap().0, scene.wind(1, &times).at(took));
}

#[test]
fn the_gust_of_a_stage_acts_in_that_stage_alone() {
    let own = "[stage.gust]\nvelocity_m_s = [0, 0, 2]\nstart_s = 0.02\nduration_s = 0.04\n";
    let scene = read(&[FLOW, INFLATE, DEVELOP, FALL, own, ON]);
    assert!((up(&scene, 2, 0.04) - 2.0).abs() < 1e-12);
    for (stage, end) in [(0, 0.3), (1, 0.2), (3, 0.1)] {
        (0..=100).for_each(|k| assert_eq!(up(&scene, stage, end * f64::from(k) / 100.0), 0.0));
    }
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
    // It takes the place of that of the scene.
    let scene = read(&[FLOW, &gust(""), INFLATE, DEVELOP, FALL, own, ON]);
    assert!((up(&scene, 2, 0.04) - 2.0).abs() < 1e-12 && up(&scene, 2, 0.08) == 0.0);
}

#[test]
fn jumps_are_named_with_their_size_stages_and_remedy() {
    let named = |parts: &[&str]| {
        let scene = read(parts);
        let all = jumps(&scene, &StageTimes::planned(&scene));
        assert_eq!(all.len(), 1, "{all:?}");
        (all[0].stage, all[0].size, all[0].unit, format!("{}; {}", all[0], all[0].remedy))
    };
    // A gust that its stage cuts off: (1 - cos(2 pi 0.6)) m/s are left.
    let own = "[stage.gust]\nvelocity_m_s = [0, 0, 2]\nstart_s = 0.04\nduration_s = 0.1\n";
    let (stage, size, unit, text) = named(&[FLOW, INFLATE, DEVELOP, FALL, own, ON]);
    let left = 1.0 - (std::f64::consts::TAU * 0.6).cos();
    assert!(stage == 3 && unit == "m/s" && (size - left).abs() < 1e-9, "{text}");
    for part in ["`fall`", "`on`", "a jump of 1.809 m/s", "[flow.gust]"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // What every gust did once: from the start of each stage, cut off at its end.
    let (stage, size, _, _) =
        named(&[FLOW, &gust("stage"), INFLATE, DEVELOP.replace("0.2", "0.1").as_str(), FALL]);
    assert!(stage == 2 && (size - 2.0).abs() < 1e-9);
    // Another steady wind, at once and over a time.
    let wind = "[stage.wind]\nvelocity_m_s = [4, 0, 4]\n";
    let (stage, size, _, text) = named(&[FLOW, INFLATE, DEVELOP, FALL, wind]);
    assert!(stage == 2 && (size - 5.0).abs() < 1e-12 && text.contains("ramp_s"), "{text}");
    let scene = read(&[FLOW, INFLATE, DEVELOP, FALL, wind, "ramp_s = 0.1\n"]);
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
    let air = scene.wind(2, &StageTimes::planned(&scene));
    assert_eq!((air.at(0.0), air.at(0.1), air.at(9.0)), ([1.0, 0.0, 0.0], [4.0, 0.0, 4.0], [4.0, 0.0, 4.0]));
    assert!((air.at(0.05)[0] - 2.5).abs() < 1e-12 && (air.at(0.05)[2] - 2.0).abs() < 1e-12);
}

#[test]
fn a_steady_march_has_the_wind_of_its_instant() {
    let steady = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\n[stage.steady]\n";
    let scene = read(&[FLOW, &gust(""), INFLATE, steady, FALL]);
    assert_eq!(up(&scene, 1, 1.0), 0.0, "a window of a stage without time has a length");
    assert!((up(&scene, 2, 0.1) - 2.0).abs() < 1e-12);
    assert!(try_read(&[FLOW, &gust("stage"), steady]).unwrap_err().contains("a gust changes in time"));
    let own = "[stage.gust]\nvelocity_m_s = [0, 0, 2]\nduration_s = 0.04\n";
    assert!(try_read(&[FLOW, INFLATE, steady, own]).unwrap_err().contains("a gust changes in time"));
}

#[test]
fn contradictions_are_refused() {
    let shear = "[flow.shear]\nstart_height_m = 50\nprofile = \"power\"\n";
    let wind = "[stage.wind]\nvelocity_m_s = [4, 0, 0]\n";
    for (parts, part) in [
        (vec![FLOW, shear, INFLATE, DEVELOP, wind], "one wind for all heights"),
        (vec![INFLATE, wind], "the wind needs air"),
        (vec![FLOW, INFLATE, DEVELOP, wind, "ramp_s = 0.3\n"], "but the stage ends after 0.2 s"),
        (vec![FLOW, INFLATE, DEVELOP, wind, "ramp_s = -1\n"], "`stage[1].wind.ramp_s` is -1"),
        (vec![FLOW, INFLATE, DEVELOP, "[stage.wind]\nvelocity_m_s = [200, 0, 0]\n"], "Mach 0.6"),
        (
            vec![FLOW, INFLATE, DEVELOP, "[stage.gust]\nvelocity_m_s = [1, 0, 0]\nduration_s = 0\n"],
            "duration_s",
        ),
    ] {
        let text = try_read(&parts).map(|_| ()).unwrap_err();
        assert!(text.contains(part), "{part}: {text}");
    }
}

/// A table of a run's clock continues over stages; one that starts at speed is named.
#[test]
fn motions_have_clocks_too() {
    let table = |clock: &str| {
        format!(
            "[[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0.2, 0.25, 0.35]\n\
             displacement_m = [[0, 0, 0], [0, 0, 0.1], [0, 0, 0.5]]\n{clock}"
        )
    };
    let run = table("clock = \"run\"\n");
    let stage = |name: &str| {
        DEVELOP
            .replace("flow\"\nkind", &format!("{name}\"\nkind"))
            .replace("flow-only", "prescribed")
            .replace("0.2\n", "0.1\n")
    };
    let (one, two) = (stage("one"), stage("two"));
    let scene = read(&[FLOW, DEVELOP, &one, &run, &two, &run]);
    let times = StageTimes::planned(&scene);
    let at = |k: usize, t: f64| {
        scene.stages[k].motions[0].in_stage(&scene, k, &times).expect("a motion").at(t).displacement[2]
    };
    // 0.3 m at the end of the first, 0.2 m more in the second, which starts from there.
    assert!((at(1, 0.05) - 0.1).abs() < 1e-12 && (at(1, 0.1) - 0.3).abs() < 1e-12);
    assert!(
        at(2, 0.0).abs() < 1e-12 && (at(2, 0.05) - 0.2).abs() < 1e-12 && (at(2, 0.1) - 0.2).abs() < 1e-12
    );
    // It starts at 2 m/s; the boundary between its stages is no jump.
    let all = jumps(&scene, &times);
    assert_eq!(all.len(), 1, "{all:?}");
    assert!(all[0].stage == 1 && (all[0].size - 2.0).abs() < 1e-9 && all[0].unit == "m/s", "{}", all[0]);
    // Stopped at 4 m/s by a stage that holds the canopy.
    let scene = read(&[FLOW, DEVELOP, &one, &run, DEVELOP.replace("flow\"\nkind", "held\"\nkind").as_str()]);
    let all = jumps(&scene, &StageTimes::planned(&scene));
    assert!(all.len() == 2 && all[1].stage == 2 && (all[1].size - 4.0).abs() < 1e-9, "{all:?}");
}

#[test]
fn forces_that_change_between_stages_are_named() {
    let force = "[[stage.force]]\nnodes = \"rim\"\nforce_n = [0, 0, 3]\n";
    let scene = read(&[FLOW, INFLATE, DEVELOP, FALL, force]);
    let all = jumps(&scene, &StageTimes::planned(&scene));
    assert!(all.len() == 1 && all[0].stage == 2 && all[0].size == 3.0 && all[0].unit == "N", "{all:?}");
    let scene = read(&[FLOW, INFLATE, force, DEVELOP, FALL, force]);
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
}

#[test]
fn a_flow_that_starts_around_a_moving_canopy_is_impulsive() {
    let speeds = |parts: &[&str]| {
        let scene = read(parts);
        scene.impulsive_starts(&StageTimes::planned(&scene))
    };
    assert_eq!(speeds(&[FLOW, INFLATE, DEVELOP, FALL]), []);
    assert_eq!(speeds(&[FLOW, INFLATE, FALL, ON]), [(1, 17f64.sqrt())]);
}

/// Time differences reach back over the start of a stage: the air there is that of the stage before, at its own time,
/// and a steady wind in place of another holds there too.
#[test]
fn before_its_start_a_stage_has_the_air_of_the_stage_before() {
    // From 0.42 to 0.52 s of the run: it rises before the release at 0.5 s and falls after it.
    let scene = read(&[FLOW, &gust("run").replace("0.05", "0.42"), INFLATE, DEVELOP, FALL]);
    let air = scene.wind(2, &StageTimes::planned(&scene));
    let at = |run: f64| 1.0 - (std::f64::consts::TAU * (run - 0.42) / 0.1).cos();
    for t in [-0.07, -0.03, -0.01, 0.01] {
        assert!((air.at(t)[2] - at(0.5 + t)).abs() < 1e-12, "{t}: {:?}", air.at(t));
    }
    let other = air.with_steady([7.0, 0.0, 1.0]);
    for t in [-0.03, 0.01] {
        assert!(other.at(t)[0] == 7.0 && (other.at(t)[2] - 1.0 - at(0.5 + t)).abs() < 1e-12, "{t}");
    }
}

/// Half a cosine, from the wind that the stage before ended with.
#[test]
fn a_ramp_is_half_a_cosine_from_the_wind_before() {
    let wind = |v: &str| format!("[stage.wind]\nvelocity_m_s = {v}\nramp_s = 0.08\n");
    let scene = read(&[FLOW, INFLATE, DEVELOP, FALL, &wind("[4.0, 0.0, 0.0]"), ON, &wind("[0.0, 2.0, 0.0]")]);
    let times = StageTimes::planned(&scene);
    // A quarter of the time: (1 - cos 45 degrees) / 2 = 0.146447 of the change.
    let (first, second) = (scene.wind(2, &times).at(0.02), scene.wind(3, &times).at(0.02));
    assert!((first[0] - 1.439340).abs() < 1e-6, "{first:?}");
    assert!((second[0] - 3.414214).abs() < 1e-6 && (second[1] - 0.292893).abs() < 1e-6, "{second:?}");
    // 4 m/s of descent beside 1, then 4 m/s: the largest speeds past the canopy.
    assert_eq!(scene.wind(2, &times).fastest(0.1, [0.0, 0.0, -4.0]), [32f64.sqrt(); 2]);
    assert_eq!(scene.wind(3, &times).fastest(0.1, [0.0, 0.0, -4.0]), [32f64.sqrt(); 2]);
    assert_eq!(scene.wind(2, &times).released(), [1.0, 0.0, 0.0]);
}

/// A gust within the stage counts with its peak however short it is; one before the stage or after it does not.
#[test]
fn the_largest_speed_has_the_gusts_of_its_stage() {
    let own = |start: f64| {
        format!("[stage.gust]\nvelocity_m_s = [0, 0, 2]\nstart_s = {start}\nduration_s = 0.001\n")
    };
    let fastest = |start: f64| {
        let scene = read(&[FLOW, INFLATE, DEVELOP, FALL, &own(start)]);
        scene.wind(2, &StageTimes::planned(&scene)).fastest(0.1, [0.0, 0.0, -4.0])
    };
    assert_eq!(fastest(0.0123), [17f64.sqrt(), 37f64.sqrt()]);
    assert_eq!(fastest(0.2), [17f64.sqrt(); 2]);
}

/// Whole windows, at least one; nothing where no time passes.
#[test]
fn planned_times_are_whole_windows() {
    let times = |inflate: &str| StageTimes::planned(&read(&[FLOW, inflate, DEVELOP]));
    assert_eq!(times(&INFLATE.replace("0.3\n", "0.304\n")).of(0), 30.0 * 0.01);
    assert_eq!(times(&INFLATE.replace("0.3\n", "0.014\n")).of(0), 0.01);
    let still =
        "[[stage]]\nname = \"inflation\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nsolve = \"static\"\n";
    assert_eq!((times(still).of(0), times(still).start(1)), (0.0, 0.0));
}

/// Stages before the release have negative times: a gust that begins later than they last does not blow in them.
#[test]
fn the_clock_of_the_release_is_negative_before_it() {
    let scene = read(&[FLOW, &gust("").replace("0.05", "0.25"), INFLATE, DEVELOP, FALL]);
    (0..=20).for_each(|k| assert_eq!(up(&scene, 1, 0.01 * f64::from(k)), 0.0));
    assert!(!scene.wind(1, &StageTimes::planned(&scene)).gusts(0.2));
}

/// A stage without time has the wind of its instant, whatever the length of its window.
#[test]
fn a_gust_at_the_instant_of_a_steady_march_is_held() {
    let steady = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\n[stage.steady]\n";
    let text = gust("run").replace("0.05", "0.275");
    let scene = read(&[FLOW, &text, INFLATE, steady, FALL]);
    // The march stands at 0.3 s of the run, a quarter of the gust.
    for t in [-0.01, 0.0, 0.02, 1.0] {
        assert!((up(&scene, 1, t) - 1.0).abs() < 1e-12, "{t}: {}", up(&scene, 1, t));
    }
}

/// A table that ends with its stage ends with the velocity of its last interval.
#[test]
fn a_motion_that_ends_at_speed_with_its_stage_is_named() {
    let moved = DEVELOP.replace("flow\"\nkind", "moved\"\nkind").replace("flow-only", "prescribed");
    let table = "[[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0.0, 0.1, 0.2]\n\
                 displacement_m = [[0, 0, 0], [0, 0, 0], [0, 0, 0.3]]\n";
    let held = DEVELOP.replace("flow\"\nkind", "held\"\nkind");
    let scene = read(&[FLOW, DEVELOP, &moved, table, &held]);
    let all = jumps(&scene, &StageTimes::planned(&scene));
    assert!(all.len() == 1 && all[0].stage == 2 && (all[0].size - 3.0).abs() < 1e-6, "{all:?}");
    // The same where a table without motion follows.
    let rest = "[[stage.motion]]\nnodes = \"canopy\"\ntime_s = [0.0, 0.2]\n\
                displacement_m = [[0, 0, 0], [0, 0, 0]]\n";
    let still = moved.replace("\"moved\"", "\"still\"");
    let scene = read(&[FLOW, DEVELOP, &moved, table, &still, rest]);
    let all = jumps(&scene, &StageTimes::planned(&scene));
    assert!(all.len() == 1 && all[0].stage == 2 && (all[0].size - 3.0).abs() < 1e-6, "{all:?}");
}

/// In still air a jump is compared with 0.1 m/s; a stream beyond half the speed of sound is refused, gusts included.
#[test]
fn small_jumps_and_fast_gusts_have_their_bounds() {
    let still = BASE.split_once("[descent]").expect("a descent").0;
    let count = |x: &str| {
        let wind = format!("[stage.wind]\nvelocity_m_s = [{x}, 0, 0]\n");
        let text = format!("{still}[flow]\n{DEVELOP}{FALL}{wind}");
        let scene = case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
        jumps(&scene, &StageTimes::planned(&scene)).len()
    };
    assert_eq!((count("0.99e-4"), count("1.01e-4")), (0, 1));
    // Half of 340.29 m/s is 170.1 m/s: 4 of descent, 1 of wind, 165 of the gust.
    let fast = |z: &str| {
        let own = format!("[stage.gust]\nvelocity_m_s = [0, 0, {z}]\nduration_s = 0.05\n");
        try_read(&[FLOW, INFLATE, DEVELOP, FALL, &own]).map(|_| ())
    };
    assert!(fast("165.0").is_ok() && fast("165.3").unwrap_err().contains("Mach 0.50"));
}
