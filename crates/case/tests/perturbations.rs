//! `[stage.perturbation]`: the pulse of wind, its defaults, its seeds, and refusals.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use case::{Scene, StageTimes, jumps};

const BASE: &str = "name = \"wake\"\n\
    [canopy]\nkind = \"square\"\nwidth_m = 2.0\ncells_across = 8\nline_count = 8\nline_length_m = 2.4\n\
    [fabric]\nyoungs_modulus_pa = 1e7\npoisson_ratio = 0.3\nthickness_m = 3e-5\ndensity_kg_m3 = 1200.0\n\
    [lines]\nyoungs_modulus_pa = 5e8\narea_m2 = 3e-6\ndensity_kg_m3 = 1200.0\n";
const DESCENT: &str = "[descent]\npayload_mass_kg = 5.0\ninitial_speed_m_s = 4.0\nreference_area_m2 = 4.0\n";
const FLOW: &str = "[flow]\nwind_m_s = [3.0, 0.0, 0.0]\n";
const STAGE: &str = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 2.0\nwindow_s = 0.02\n";
const LATER: &str = "[[stage]]\nname = \"fall\"\nkind = \"coupled\"\nduration_s = 1.0\nwindow_s = 0.005\n";

fn try_read(parts: &[&str]) -> Result<Scene, String> {
    case::parse(Path::new("scene.toml"), &parts.concat()).map_err(|e| e.to_string())
}

fn perturbed(keys: &str) -> Scene {
    let all = [BASE, DESCENT, FLOW, STAGE, "[stage.perturbation]\n", keys, LATER];
    try_read(&all).unwrap_or_else(|e| panic!("{e}"))
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The wind of stage 0 without its steady part, m/s.
fn pulse(scene: &Scene, t: f64) -> [f64; 3] {
    let w = scene.wind(0, &StageTimes::planned(scene)).at(t);
    [w[0] - 3.0, w[1], w[2]]
}

/// A stream of 5 m/s along (3, 0, 4) and a reference area of 4 m2, by hand: 0.5 m/s over sqrt(16 / pi) / 5 s.
#[test]
fn default_is_a_tenth_of_the_stream_across_it_while_it_passes_the_canopy() {
    let scene = perturbed("");
    let duration = (16.0 / PI).sqrt() / 5.0;
    let found = scene.perturbation(0).expect("a pulse");
    assert!((found.duration_s.expect("a time") / duration - 1.0).abs() < 1e-14);
    assert!((found.largest_speed() - 0.5).abs() < 1e-14);
    for k in 1..=100 {
        let t = duration * f64::from(k) / 80.0;
        let v = pulse(&scene, t);
        let expected = if t < duration { 0.25 * (1.0 - (TAU * t / duration).cos()) } else { 0.0 };
        assert!((length(v) - expected).abs() < 1e-12, "{t}: {v:?}");
        assert!((3.0 * v[0] + 4.0 * v[2]).abs() < 1e-12, "along the stream: {v:?}");
    }
    // Nothing of it in the next stage, and no jump between them.
    let next = scene.wind(1, &StageTimes::planned(&scene));
    (0..=100).for_each(|k| assert_eq!(next.at(0.01 * f64::from(k)), [3.0, 0.0, 0.0]));
    assert!(jumps(&scene, &StageTimes::planned(&scene)).is_empty());
}

#[test]
fn given_values_are_taken_and_a_gust_is_added() {
    let scene = perturbed(
        "speed_share = 0.2\nstart_s = 0.5\nduration_s = 0.4\nazimuth_deg = 90\n[stage.gust]\n\
         velocity_m_s = [0, 0, 2]\nstart_s = 0.7\nduration_s = 1.0\n",
    );
    // The y axis is 90 degrees from x about a stream in the plane of x and z; the peak is 1 m/s.
    for (t, y) in [(0.5, 0.0), (0.6, 0.5), (0.7, 1.0), (0.8, 0.5), (0.9, 0.0), (1.5, 0.0)] {
        assert!((pulse(&scene, t)[1] - y).abs() < 1e-12 && pulse(&scene, t)[0].abs() < 1e-12, "{t}");
    }
    assert!((pulse(&scene, 1.2)[2] - 2.0).abs() < 1e-12);
    let [calm, fastest] = scene.wind(0, &StageTimes::planned(&scene)).fastest(0.8, [0.0, 0.0, -4.0]);
    assert!(calm < fastest && fastest > 26f64.sqrt() - 1e-9, "{calm} {fastest}");
}

#[test]
fn seeds_give_different_reproducible_directions() {
    let of = |seed: u32| {
        perturbed(&format!("seed = {seed}\n"))
            .perturbation(0)
            .expect("a pulse")
            .velocity_m_s
            .map(f64::to_bits)
    };
    assert_eq!(of(7), of(7));
    assert_eq!(of(1), perturbed("").perturbation(0).expect("a pulse").velocity_m_s.map(f64::to_bits));
    assert!(of(7) != of(8) && of(1) != of(2));
}

#[test]
fn a_wind_without_the_key_is_bitwise_as_before() {
    let scene = try_read(&[BASE, DESCENT, FLOW, STAGE, LATER]).expect("a scene");
    assert!(!scene.has_stage_wind() && scene.perturbation(0).is_none());
    assert_eq!(scene.wind(0, &StageTimes::planned(&scene)), case::Wind::uniform([3.0, 0.0, 0.0]));
}

#[test]
fn what_cannot_work_is_refused_with_value_and_remedy() {
    const TABLE: &str = "[stage.perturbation]\n";
    let inflate = "[[stage]]\nname = \"in\"\nkind = \"pre-inflation\"\npressure_pa = 12.0\nduration_s = 1\nwindow_s = 0.01\n";
    let with = |keys: &'static str| vec![BASE, DESCENT, FLOW, STAGE, TABLE, keys];
    let cases: Vec<(Vec<&str>, &[&str])> = vec![
        (with("speed_share = 0\n"), &["speed_share` is 0", "to 0.5"]),
        (with("speed_share = 0.6\n"), &["speed_share", "[stage.gust]"]),
        (with("start_s = -1\n"), &["perturbation.start_s"]),
        (with("duration_s = 0\n"), &["perturbation.duration_s"]),
        (with("duration_s = 0.07\n"), &["fewer than four windows of 0.02 s"]),
        (with("start_s = 1.8\n"), &["0.4514 s from 1.8 s on", "ends after 2 s"]),
        (with("seed = 3\nazimuth_deg = 10\n"), &["keep `seed` or `azimuth_deg`"]),
        (with("azimuth_deg = 400\n"), &["perturbation.azimuth_deg"]),
        (with("seed = -1\n"), &["seed"]),
        (with("sed = 1\n"), &["did you mean `seed`?"]),
        (vec![BASE, DESCENT, FLOW, inflate, TABLE], &["no flow in time", "kind \"flow-only\""]),
        (vec![BASE, "[flow]\n", STAGE, TABLE], &["has no velocity", "[stage.gust]"]),
        (vec![BASE, FLOW, STAGE, TABLE], &["without [descent]", "set duration_s"]),
    ];
    for (parts, wanted) in cases {
        let text = try_read(&parts).expect_err(&parts.concat());
        wanted.iter().for_each(|w| assert!(text.contains(w), "{w}: {text}"));
    }
    // A time of its own needs no reference area.
    assert!(try_read(&[BASE, FLOW, STAGE, TABLE, "duration_s = 0.5\n"]).is_ok());
}

/// In a box the sides have known normals: a pulse along a wall is allowed, one through it is refused.
#[test]
fn walls_and_mirror_planes_across_the_pulse_are_refused() {
    let panel = |sides: &str, azimuth: f64| {
        try_read(&[
            "name = \"duct\"\n[canopy]\nkind = \"panel\"\nsize_m = [0.5, 0.5]\ncells = [4, 4]\n\
             [fabric]\nyoungs_modulus_pa = 1e6\npoisson_ratio = 0.3\nthickness_m = 1e-3\ndensity_kg_m3 = 1000.0\n\
             [flow]\nwind_m_s = [2, 0, 0]\n\
             [flow.box]\nbelow_m = 0.5\nabove_m = 0.5\nlayers_below = 5\nlayers_above = 5\nbehind_m = 1.0\ncells_behind = 8\n\
             [flow.box.sides]\nleft = \"far-field\"\nright = \"outlet\"\n",
            sides,
            STAGE,
            &format!("[stage.perturbation]\nduration_s = 0.3\nazimuth_deg = {azimuth}\n"),
        ])
    };
    // Across a stream along x the azimuth counts from y: 0 is y, 90 is z.
    let (slip, mirror) =
        ("bottom = \"slip\"\ntop = \"slip\"\n", "front = \"symmetry\"\nback = \"far-field\"\n");
    let open = "front = \"far-field\"\nback = \"far-field\"\n";
    let free = "bottom = \"far-field\"\ntop = \"far-field\"\n";
    assert!(panel(&[slip, open].concat(), 0.0).is_ok());
    let text = panel(&[slip, open].concat(), 90.0).expect_err("through the wall");
    assert!(text.contains("\"bottom\" (\"slip\")"), "{text}");
    let text = panel(&[free, mirror].concat(), 0.0).expect_err("half a model");
    assert!(text.contains("\"front\" (\"symmetry\")"), "{text}");
}
