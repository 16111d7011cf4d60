//! Shapes of gusts: values, joints, periods, largest speeds and refusals.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use case::{Gust, GustShape, Scene, StageTimes, Wind, jumps};

const BASE: &str = "name = \"gusty\"\n\
    [canopy]\nkind = \"square\"\nwidth_m = 2.0\ncells_across = 8\nline_count = 8\nline_length_m = 2.4\n\
    [fabric]\nyoungs_modulus_pa = 1e7\npoisson_ratio = 0.3\nthickness_m = 3e-5\ndensity_kg_m3 = 1200.0\n\
    [lines]\nyoungs_modulus_pa = 5e8\narea_m2 = 3e-6\ndensity_kg_m3 = 1200.0\n[flow]\n";
const DEVELOP: &str = "[[stage]]\nname = \"flow\"\nkind = \"flow-only\"\nduration_s = 0.2\nwindow_s = 0.02\n";

fn stage(name: &str, duration: f64, gust: &str) -> String {
    format!(
        "[[stage]]\nname = \"{name}\"\nkind = \"coupled\"\nduration_s = {duration}\nwindow_s = 0.005\n\
         [stage.gust]\nvelocity_m_s = [0, 0, 2]\n{gust}"
    )
}

fn try_read(stages: &[String]) -> Result<Scene, String> {
    let text = format!("{BASE}{DEVELOP}{}", stages.concat());
    case::parse(Path::new("scene.toml"), &text).map_err(|e| e.to_string())
}

fn read(stages: &[String]) -> Scene {
    try_read(stages).unwrap_or_else(|e| panic!("{e}"))
}

fn gust(keys: &str) -> Gust {
    let scene = read(&[stage("fall", 0.1, keys)]);
    scene.gust(1).expect("a gust").0.clone()
}

const PULSE: &str = "start_s = 0.1\nduration_s = 0.4\n";
const TRAIN: &str = "start_s = 0.1\nduration_s = 0.4\nperiod_s = 0.5\ncycles = 3\n";
const RAMP: &str = "shape = \"ramp\"\nstart_s = 0.1\nduration_s = 0.4\n";
const SINE: &str = "shape = \"sine\"\nstart_s = 0.1\nperiod_s = 0.4\ncycles = 2\n";
const TABLE: &str =
    "shape = \"table\"\nstart_s = 0.1\ntime_s = [0.0, 0.2, 0.3, 0.4]\nfactor = [0.0, 1.0, -1.5, 0.0]\n";

const DRYDEN: &str = "shape = \"dryden\"\nstart_s = 0.1\nduration_s = 0.4\nlength_m = [5.0, 5.0, 20.0]\nspeed_m_s = 5.0\nseed = 4\n";

fn values(keys: &str, of: &[(f64, f64)]) {
    let gust = gust(keys);
    for (t, factor) in of {
        let value = gust.factor_at(*t);
        assert!((value - factor).abs() < 1e-12, "{keys}{t} s: {value} instead of {factor}");
        assert_eq!(gust.at(*t), [0.0, 0.0, 2.0].map(|v| value * v));
    }
}

#[test]
fn shapes_have_the_values_of_their_formulas() {
    let eighth = 0.5 * (1.0 - 0.5f64.sqrt());
    values(PULSE, &[(0.0, 0.0), (0.15, eighth), (0.2, 0.5), (0.3, 1.0), (0.4, 0.5), (0.6, 0.0), (9.0, 0.0)]);
    // Pulses start at 0.1, 0.6 and 1.1 s; 0.1 s between them is calm.
    values(TRAIN, &[(0.3, 1.0), (0.55, 0.0), (0.7, 0.5), (0.8, 1.0), (1.3, 1.0), (1.4, 0.5), (1.8, 0.0)]);
    values(RAMP, &[(0.05, 0.0), (0.2, eighth), (0.3, 0.5), (0.4, 1.0 - eighth), (0.5, 1.0), (1e5, 1.0)]);
    values(SINE, &[(0.0, 0.0), (0.2, 1.0), (0.15, 0.5f64.sqrt()), (0.4, -1.0), (0.8, -1.0), (0.95, 0.0)]);
    values(
        TABLE,
        &[(0.0, 0.0), (0.2, 0.5), (0.3, 1.0), (0.35, -0.25), (0.4, -1.5), (0.45, -0.75), (0.7, 0.0)],
    );
    // Constant beyond the table, and in each period after its last time.
    values(
        "shape = \"table\"\ntime_s = [0.1, 0.2]\nfactor = [3.0, 4.0]\n",
        &[(-5.0, 3.0), (0.15, 3.5), (7.0, 4.0)],
    );
    let repeated = TABLE.to_owned() + "period_s = 0.6\n";
    values(&repeated, &[(0.0, 0.0), (0.2, 0.5), (0.65, 0.0), (0.8, 0.5), (1.0, -1.5), (6.2, 0.5)]);
}

/// A pulse has the digits that it had before there were other shapes.
#[test]
fn a_pulse_is_the_former_gust_to_the_bit() {
    let pulse = gust(PULSE);
    assert_eq!(pulse.shape, GustShape::OneMinusCosine);
    for k in -50..=150 {
        let t = 0.0071 * f64::from(k);
        let phase = (t - 0.1) / 0.4;
        let share = if (0.0..=1.0).contains(&phase) { 0.5 * (1.0 - (TAU * phase).cos()) } else { 0.0 };
        assert_eq!(pulse.at(t), [0.0, 0.0, 2.0].map(|v| share * v), "{t}");
    }
}

/// No step exceeds the largest slope: at the start, between periods, at knots and at the end.
#[test]
fn shapes_are_continuous_at_their_joints() {
    let repeated = TABLE.to_owned() + "period_s = 0.4\ncycles = 4\n";
    for (keys, slope) in [
        (PULSE, PI / 0.4),
        (TRAIN, PI / 0.4),
        (RAMP, 0.5 * PI / 0.4),
        (SINE, TAU / 0.4),
        (TABLE, 25.0),
        (repeated.as_str(), 25.0),
        (DRYDEN, 0.5 * PI / 0.4),
    ] {
        let gust = gust(keys);
        let step = 1e-5;
        for k in 0..250_000 {
            let t = step * f64::from(k);
            let change = (gust.factor_at(t + step) - gust.factor_at(t)).abs();
            assert!(change <= slope * step * (1.0 + 1e-6) + 1e-12, "{keys}{t}: {change}");
        }
    }
}

/// The list of stages that a periodic wind was before: the same far field at and between the changes of stage.
#[test]
fn stages_of_one_pulse_are_one_periodic_stage() {
    let list: Vec<String> = (0..4).map(|k| stage(&format!("fall-{k}"), 0.1, "duration_s = 0.1\n")).collect();
    let (list, whole) = (read(&list), read(&[stage("fall", 0.4, "duration_s = 0.1\nperiod_s = 0.1\n")]));
    let (times, one) = (StageTimes::planned(&list), StageTimes::planned(&whole));
    assert!(jumps(&list, &times).is_empty() && jumps(&whole, &one).is_empty());
    let periodic = whole.wind(1, &one);
    for (stage, from) in [(1, 0.0), (2, 0.1), (3, 0.2), (4, 0.3)] {
        let pulse = list.wind(stage, &times);
        for k in -20..=100 {
            let t = 1e-3 * f64::from(k);
            let (a, b) = (pulse.at(t)[2], periodic.at(from + t)[2]);
            assert!((a - b).abs() < 1e-12, "stage {stage}, {t} s: {a} and {b}");
        }
    }
}

#[test]
fn the_largest_speed_is_found_in_all_shapes() {
    let fastest = |keys: &str, duration: f64| {
        let air = Wind::uniform([1.0, 0.0, 0.0]).with_gust(gust(keys), 0.0);
        air.fastest(duration, [0.0, 0.0, -4.0])[1]
    };
    let speed = |factor: f64| (1.0 + (2.0 * factor + 4.0).powi(2)).sqrt();
    assert_eq!(fastest(TRAIN, 2.0), speed(1.0));
    assert_eq!(fastest(SINE, 2.0), speed(1.0));
    assert_eq!(fastest(RAMP, 2.0), speed(1.0));
    assert!((fastest(TABLE, 2.0) - speed(1.0)).abs() < 1e-12);
    // Periods of 1 ms in 100 s, and those that begin long before the stage.
    assert!((fastest("shape = \"sine\"\nperiod_s = 1e-3\n", 100.0) - speed(1.0)).abs() < 1e-9);
    let late = Wind::uniform([1.0, 0.0, 0.0]).with_gust(gust("shape = \"sine\"\nperiod_s = 0.4\n"), 1e3);
    assert!((late.fastest(0.4, [0.0, 0.0, -4.0])[1] - speed(1.0)).abs() < 1e-9);
    // Against the rise: the largest value of the table is the negative one.
    assert_eq!(gust(TABLE).largest_speed(), 3.0);
    let up = Wind::uniform([0.0; 3]).with_gust(gust(TABLE), 0.0).fastest(2.0, [0.0, 0.0, 4.0])[1];
    assert!((up - 7.0).abs() < 1e-12, "{up}");
}

/// Turbulence grows from nothing along half a cosine, has the digits of the wind in all programs, and its largest speed is that of its values: at
/// 8 times in a period of 0.25 s, which holds 99 % of the variance.
#[test]
fn turbulence_grows_and_stays() {
    let scene = read(&[stage("fall", 0.2, DRYDEN), stage("on", 40.0, &format!("clock = \"run\"\n{DRYDEN}"))]);
    let (times, gust) = (StageTimes::planned(&scene), gust(DRYDEN));
    assert_eq!(gust.at(0.1), [0.0; 3]);
    let (half, full) = (gust.at(0.3)[2], gust.at(0.300_000_1)[2]);
    assert!(half != 0.0 && (half - full).abs() < 1e-5 && gust.at(0.05) == [0.0; 3]);
    for (stage, origin) in [(1, 0.0), (2, 0.4)] {
        let air = scene.wind(stage, &times);
        for k in 1..=100 {
            let t = 0.002 * f64::from(k);
            assert_eq!(air.at(t), gust.at(origin + t), "stage {stage}, {t} s");
        }
    }
    let air = scene.wind(2, &times);
    let speed = |t: f64| air.at(t)[2].abs();
    let true_most = (0..400_000).map(|k| speed(1e-4 * f64::from(k))).fold(0.0, f64::max);
    let [steady, most] = air.fastest(40.0, [0.0; 3]);
    println!("largest speed {most:.4} m/s, true {true_most:.4}, 4 rms {}", gust.largest_speed());
    assert_eq!((steady, gust.largest_speed()), (0.0, 8.0));
    // A value between two of 8 in the period of omega is at most (pi/8)^2/2 = 8 % of its cosine higher; of those that are faster, 10 % of the rms, all.
    assert!(most <= true_most && most > 0.9 * true_most - 0.2, "{most} {true_most}");
}

/// Half of 340.29 m/s is 170.1 m/s: the factor of a table counts.
#[test]
fn speeds_of_a_table_are_bounded_by_the_mach_number() {
    let fast = |factor: f64| {
        let keys = format!("shape = \"table\"\ntime_s = [0.0, 0.05]\nfactor = [0.0, -{factor}]\n");
        try_read(&[stage("fall", 0.1, &keys)]).map(|_| ())
    };
    assert!(fast(85.0).is_ok());
    assert!(fast(85.2).unwrap_err().contains("Mach 0.50"));
}

#[test]
fn times_of_action_have_their_shape() {
    assert_eq!(gust(PULSE).acts(), [0.1, 0.5]);
    assert_eq!(gust(RAMP).acts(), [0.1, f64::INFINITY]);
    assert_eq!(gust(TRAIN).acts(), [0.1, 1.5]);
    assert_eq!(gust(SINE).acts(), [0.1, 0.9]);
    assert_eq!(gust("shape = \"sine\"\nperiod_s = 1\n").acts(), [0.0, f64::INFINITY]);
    let stays = "shape = \"table\"\ntime_s = [0.1, 0.2]\nfactor = [3.0, 4.0]\n";
    assert_eq!(gust(stays).acts(), [f64::NEG_INFINITY, f64::INFINITY]);
    let periods = [PULSE, TRAIN, RAMP, SINE, TABLE].map(|keys| gust(keys).shortest_period());
    assert_eq!(periods, [None, Some(0.4), None, Some(0.4), None]);
    assert_eq!(gust(DRYDEN).acts(), [0.1, f64::INFINITY]);
    // Components without turbulence have no period: 20 m of z at 5 m/s.
    let period = gust(DRYDEN).shortest_period().expect("a period");
    assert!((period - TAU * 20.0 / (100.0 * 5.0)).abs() < 1e-12, "{period}");
    assert!(gust(DRYDEN).is_general());
    assert_eq!(
        [PULSE, TRAIN, RAMP, SINE, TABLE].map(|k| gust(k).is_general()),
        [false, true, true, true, true]
    );
}

/// Each refusal of turbulence names the key, its place and what to do.
#[test]
fn turbulence_without_a_size_is_refused() {
    for (keys, parts) in [
        (
            "shape = \"dryden\"\nduration_s = 1\nspeed_m_s = 5\n",
            [
                "scene.toml:",
                "\"dryden\" has no `length_m`",
                "set length_m: the length scales of the x, y and z components, m",
            ],
        ),
        (
            "shape = \"dryden\"\nduration_s = 1\nlength_m = [9, 9, 9]\n",
            ["scene.toml:", "\"dryden\" has no `speed_m_s`", "set speed_m_s: the speed at which the frame"],
        ),
        (
            "shape = \"dryden\"\nspeed_m_s = 5\nlength_m = [9, 9, 9]\n",
            ["scene.toml:", "\"dryden\" has no `duration_s`", "set duration_s"],
        ),
        (
            "shape = \"dryden\"\nduration_s = 1\nspeed_m_s = 5\nlength_m = [9, 0, 9]\n",
            ["scene.toml:", "is 0", "a length in m"],
        ),
        (
            "shape = \"dryden\"\nduration_s = 1\nspeed_m_s = -5\nlength_m = [9, 9, 9]\n",
            ["scene.toml:", "is -5", "a speed in m/s"],
        ),
        (
            "shape = \"dryden\"\nduration_s = 1\nspeed_m_s = 5\nlength_m = [9, 9, 9]\nperiod_s = 3\n",
            [
                "scene.toml:",
                "\"dryden\" does not use `period_s`",
                "\"one-minus-cosine\", \"sine\" or \"table\"",
            ],
        ),
        ("duration_s = 1\nseed = 3\n", ["scene.toml:", "does not use `seed`", "set shape = \"dryden\""]),
        (
            "duration_s = 1\npassage = \"x\"\n",
            ["scene.toml:", "does not use `passage`", "set shape = \"dryden\""],
        ),
    ] {
        let text = try_read(&[stage("fall", 0.1, keys)]).map(|_| ()).unwrap_err();
        for part in parts {
            assert!(text.contains(part), "{keys}{part}: {text}");
        }
    }
}

#[test]
fn turbulence_of_negative_size_is_refused() {
    let text = format!("{BASE}{DEVELOP}{}", stage("fall", 0.1, DRYDEN));
    let text = text.replace("velocity_m_s = [0, 0, 2]", "velocity_m_s = [0, -1, 2]");
    let error = case::parse(Path::new("scene.toml"), &text).map(|_| ()).unwrap_err().to_string();
    for part in ["scene.toml:", "component y is -1 m/s", "zero or more"] {
        assert!(error.contains(part), "{part}: {error}");
    }
}

/// Each refusal names the key, its place and what to do.
#[test]
fn gusts_that_are_no_function_of_time_are_refused() {
    for (keys, parts) in [
        ("", ["scene.toml:", "\"one-minus-cosine\" has no `duration_s`", "set duration_s"]),
        ("shape = \"sine\"\n", ["scene.toml:", "\"sine\" has no `period_s`", "set period_s"]),
        (
            "shape = \"sine\"\nperiod_s = 1\nduration_s = 1\n",
            ["scene.toml:", "does not use", "remove duration_s"],
        ),
        (
            "shape = \"ramp\"\nduration_s = 1\nperiod_s = 1\n",
            ["scene.toml:", "does not use", "remove period_s"],
        ),
        (
            "duration_s = 0.1\ncycles = 3\n",
            ["scene.toml:", "without `period_s`", "set period_s, or remove cycles"],
        ),
        ("duration_s = 0.1\nperiod_s = 1\ncycles = 0\n", ["scene.toml:", "is 0", "allowed: 1"]),
        ("duration_s = 2\nperiod_s = 1\n", ["scene.toml:", "a pulse lasts 2 s", "to duration_s or more"]),
        (
            "duration_s = 2\ntime_s = [0.0]\nfactor = [1.0]\n",
            ["scene.toml:", "does not use", "shape = \"table\""],
        ),
        ("shape = \"table\"\n", ["scene.toml:", "\"table\" has no `time_s`", "set time_s"]),
        (
            "shape = \"table\"\ntime_s = [0, 1]\nfactor = [0.0]\n",
            ["scene.toml:", "2 values of `time_s` and 1 of `factor`", "as many"],
        ),
        (
            "shape = \"table\"\ntime_s = [0.0, 0.5, 0.5]\nfactor = [0.0, 1.0, 2.0]\n",
            ["`time_s[2]` is 0.5 s, after 0.5 s", "time_s = [0.0, 0.5, 0.5]", "strictly increasing"],
        ),
        (
            "shape = \"table\"\ntime_s = [0.0, 0.5]\nfactor = [0.0, 1.0]\nperiod_s = 0.5\n",
            ["scene.toml:", "jumps from 1 to 0", "the same factor"],
        ),
        (
            "shape = \"table\"\ntime_s = [0.0, 0.5]\nfactor = [1.0, 1.0]\nperiod_s = 0.4\n",
            ["scene.toml:", "from 0 to 0.5 s, but a period from 0 to 0.4 s", "or more"],
        ),
        (
            "shape = \"table\"\ntime_s = [0.0, inf]\nfactor = [1.0, 1.0]\n",
            ["scene.toml:", "not a number", "in s"],
        ),
    ] {
        let text = try_read(&[stage("fall", 0.1, keys)]).map(|_| ()).unwrap_err();
        for part in parts {
            assert!(text.contains(part), "{keys}{part}: {text}");
        }
    }
}
