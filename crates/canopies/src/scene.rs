//! Commented scenes of canopy types.

use std::f64::consts::PI;
use std::fmt::Write as _;

use crate::{CanopyType, nominal_area};

/// Sizes of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSizes {
    /// Nominal diameter D0, m.
    pub nominal_diameter_m: f64,
    /// Mass of the payload, kg. `None`: such that it descends at 6 m/s with the usual drag coefficient of the type.
    pub payload_mass_kg: Option<f64>,
    /// Speed of the air, m/s: at which the canopy begins to open, or of the wind tunnel.
    pub speed_m_s: f64,
    /// What the scene computes.
    pub experiment: Experiment,
}

/// What a scene computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// The canopy opens from its gathered, line-stretched state and descends with its payload.
    Opening,
    /// The payload's point is held in a steady wind: settled drag of the open canopy.
    WindTunnel,
}

/// Density of the air at sea level, kg/m3.
const DENSITY: f64 = 1.225;
/// Descent speed of the default payload, m/s.
const DESCENT_SPEED: f64 = 6.0;
/// Nominal diameter of Table 2 of the paper, whose fabric has 139.87 m2, m.
const ATPS_DIAMETER: f64 = 13.345;

/// Text of a scene (TOML) with a canopy of type `t`.
pub fn scene(t: CanopyType, sizes: &SceneSizes) -> String {
    let d = sizes.nominal_diameter_m;
    let v = sizes.speed_m_s;
    let opens = sizes.experiment == Experiment::Opening;
    let mut text = head(t, sizes) + &canopy(t, d) + &fabric(t, d, opens) + &tapes(t);
    text += &flow(t, d, (!opens).then_some(v));
    if opens {
        text += &descent(t, sizes);
        text += &opening(t, d, v);
    } else {
        text += &wind_tunnel(t, d, v);
    }
    text
}

fn descent(t: CanopyType, sizes: &SceneSizes) -> String {
    let area = nominal_area(sizes.nominal_diameter_m);
    let payload = sizes
        .payload_mass_kg
        .unwrap_or_else(|| 0.5 * DENSITY * DESCENT_SPEED.powi(2) * t.usual_drag_coefficient() * area / 9.81);
    format!(
        "[descent]\n\
         payload_mass_kg = {payload}\n\
         initial_speed_m_s = {speed}\n\
         reference_area_m2 = {area}   # nominal area S0 = pi D0^2 / 4\n\n",
        payload = digits(payload),
        speed = digits(sizes.speed_m_s),
        area = digits(area),
    )
}

/// Four significant digits.
fn digits(x: f64) -> String {
    let decimals = if x == 0.0 { 1 } else { (3 - x.abs().log10().floor() as i32).max(1) as usize };
    let text = format!("{x:.decimals$}");
    let short = text.trim_end_matches('0');
    if short.ends_with('.') { format!("{short}0") } else { short.to_owned() }
}

fn head(t: CanopyType, sizes: &SceneSizes) -> String {
    let name = t.name();
    let [d, v] = [sizes.nominal_diameter_m, sizes.speed_m_s].map(digits);
    let what = match sizes.experiment {
        Experiment::Opening => "opens",
        Experiment::WindTunnel => "in a wind tunnel",
    };
    let mut text = format!("# {}: {}.\n", t.name(), t.description());
    if let Some(h) = t.handbook() {
        let [low, high] = h.drag_coefficient;
        let _ = write!(
            text,
            "# Handbook (Knacke, quoted from memory): drag coefficient on S0 {low:.2} to {high:.2}"
        );
        if let Some(c) = h.opening_force_coefficient {
            let _ = write!(text, ", opening force coefficient {c}");
        }
        if let Some(n) = h.filling_constant {
            let _ = write!(text, ", filling constant {n}");
        }
        text.push_str(".\n");
    }
    text.push_str("# Proportions and materials are usual ones: change them to those of your drawing.\n");
    let _ = write!(
        text,
        "\nname = \"{name}\"\ntitle = \"Canopy of type {name} with a nominal diameter of {d} m {what} at {v} m/s\"\n\n"
    );
    text
}

/// Gores of a canopy of the nominal diameter d (m): about 3.3 a metre, as the 28 of the C-9 (8.53 m); an even number that its risers divide.
fn gores(t: CanopyType, d: f64) -> u32 {
    let step = t.risers().map_or(2, |r| r.count);
    let gores = step * (3.3 * d / f64::from(step)).round() as u32;
    gores.clamp(12, 120)
}

/// Confluence points and risers of a type that has them.
fn canopy_risers(t: CanopyType, d: f64) -> String {
    let Some(r) = t.risers() else { return String::new() };
    let mut text = "\n[canopy.risers]\n".to_owned();
    text += &key("count", r.count, &format!("as the {}", r.of));
    text += &key(
        "length_m",
        digits(r.length * d),
        "from the confluence point of a group of lines to the payload",
    );
    text + &key("spread_m", digits(r.spread * d), "between opposite attachments at the payload")
}

/// The section of risers.
fn risers(t: CanopyType) -> String {
    let Some(_) = t.risers() else { return String::new() };
    let mut text = "[risers]\n".to_owned();
    text += &key("material", "\"pia-w1100-type13\"", "nylon webbing of 7000 lb");
    text + "\n"
}

/// A key with its value and a comment.
fn key(name: &str, value: impl std::fmt::Display, comment: &str) -> String {
    format!("{:<28} # {comment}\n", format!("{name} = {value}"))
}

fn canopy(t: CanopyType, d: f64) -> String {
    let gored = |profile: &str, vent: f64, lines: f64, cells: u32, more: &str| {
        let mut text = "[canopy]\nkind = \"gored\"\n".to_owned();
        text += &format!("profile = \"{profile}\"\n");
        text +=
            &key("nominal_diameter_m", digits(d), "D0: circle with the area of all gores, openings included");
        text += &key("gores", gores(t, d), "and as many lines");
        text += &key("vent_diameter_m", digits(vent * d), "crown vent");
        text += &key("cells_per_gore", 2, "quadrilaterals across a gore");
        text += &key("cells_along", cells, "and along it");
        text += &key("line_length_m", digits(lines * d), "from the skirt to the confluence point");
        text += "segments_per_line = 2\n";
        let (keys, sections) = if more.starts_with('\n') { ("", more) } else { (more, "") };
        format!("{text}{keys}{}{sections}\n", canopy_risers(t, d))
    };
    let section = |length: f64, angle: f64, gap: bool| {
        let gap = if gap { "gap = true\n" } else { "" };
        format!("\n[[canopy.section]]\nlength = {}\nangle_deg = {}\n{gap}", digits(length), digits(angle))
    };
    match t {
        CanopyType::FlatCircular => gored("flat", 0.1, 1.0, 10, ""),
        CanopyType::Conical => gored("conical", 0.1, 1.0, 10, "cone_angle_deg = 20.0\n"),
        CanopyType::Hemispherical => gored("hemispherical", 0.1, 1.0, 12, ""),
        CanopyType::ExtendedSkirt => {
            let sections = section(0.45, 0.0, false) + &section(0.1, 90.0, false);
            gored("sections", 0.1, 0.95, 11, &sections)
        }
        CanopyType::Annular => gored("flat", 0.4, 1.25, 7, ""),
        CanopyType::Ringslot => gored("flat", 0.1, 1.0, 10, ""),
        CanopyType::Ribbon => gored("conical", 0.1, 1.0, 10, "cone_angle_deg = 20.0\n"),
        CanopyType::Ringsail => {
            let sections: String =
                [7.5, 22.5, 37.5, 52.5].iter().map(|angle| section(1.0, *angle, false)).collect();
            gored("sections", 0.1, 1.15, 12, &sections)
        }
        CanopyType::DiskGapBand => {
            let sections =
                section(0.326, 0.0, false) + &section(0.0432, 90.0, true) + &section(0.1216, 90.0, false);
            gored("sections", 0.0702, 1.7, 11, &sections)
        }
        CanopyType::Cross => cross(d),
        CanopyType::Square => {
            let mut text = "[canopy]\nkind = \"square\"\n".to_owned();
            text += &key("width_m", digits(nominal_area(d).sqrt()), "of the sheet");
            text += "cells_across = 16\n";
            text += &key("line_count", 16, "spread along the rim");
            text += &key("line_length_m", digits(1.1 * d), "from the rim to the confluence point");
            text + "segments_per_line = 2\n\n"
        }
        CanopyType::Atps => atps(d / ATPS_DIAMETER),
    }
}

/// A cross of W / L = 0.3: S0 = 2 L W - W^2 = 0.51 L^2.
fn cross(d: f64) -> String {
    let length = (nominal_area(d) / 0.51).sqrt();
    let mut text = "[canopy]\nkind = \"cross\"\n".to_owned();
    text += &key("panel_width_m", digits(0.3 * length), "W");
    text += &key("panel_length_m", digits(length), "L: S0 = 2 L W - W^2");
    text += &key("cells_across", 6, "quadrilaterals across a panel");
    text += &key("cells_along_arm", 8, "and along an arm");
    text += "lines_per_arm = 6\n";
    text += &key("line_length_m", digits(1.15 * length), "from the end of an arm to the confluence point");
    text + "segments_per_line = 2\n\n"
}

/// Table 2 of the paper times `scale`.
fn atps(scale: f64) -> String {
    let mut text = "[canopy]\nkind = \"atps\"\n".to_owned();
    for (name, length) in [
        ("top_width_m", 6.43128),
        ("bottom_edge_width_m", 6.09600),
        ("arm_length_m", 3.93192),
        ("stitching_height_m", 0.73152),
        ("suspension_line_length_m", 6.40080),
        ("riser_length_m", 1.21920),
    ] {
        let _ = writeln!(text, "{name} = {}", digits(scale * length));
    }
    text + "cells_across = 10\ncells_along_vent = 6\ncells_along_stitching = 2\n\n"
}

fn fabric(t: CanopyType, d: f64, folds: bool) -> String {
    let mut text = "[fabric]\n".to_owned();
    let material = "\"pia-c7020-type1\"";
    text += &key("material", material, "nylon rip-stop of 37 g/m2 (docs/reference/materials.md)");
    if let Some(porosity) = t.geometric_porosity() {
        text += "\n[fabric.permeability]\n";
        text += &key(
            "geometric_porosity",
            porosity,
            "slots that no grid resolves, as a cloth with their pressure loss",
        );
    }
    if folds {
        text += &format!("\n[fabric.contact]\n{}", key("distance_m", digits(0.0024 * d), "layers keep it"));
    }
    text += "\n[lines]\n";
    text + &key("material", "\"pia-c5040-type3\"", "nylon cord of 550 lb") + "\n" + &risers(t)
}

fn tapes(t: CanopyType) -> String {
    let tape = |place: &str, what: &str| {
        format!(
            "[tapes.{place}]{:pad$} # {what}\nmaterial = \"pia-t5038-type3-inch\"\n\n",
            "",
            pad = 20 - place.len()
        )
    };
    match t {
        CanopyType::Square => tape("hem", "along the rim"),
        CanopyType::Cross => tape("hem", "along the outline"),
        CanopyType::Atps => {
            tape("hem", "ends of the arms")
                + &tape("seams", "edges of the top, stitching")
                + &tape("vents", "edges of the slits")
        }
        _ => {
            tape("hem", "skirt band")
                + &tape("seams", "radials, over the vent")
                + &tape("vents", "bands at the vent and at gaps")
        }
    }
}

fn flow(t: CanopyType, d: f64, wind: Option<f64>) -> String {
    // A gap is to have two cells.
    let spacing = match t {
        CanopyType::DiskGapBand => 0.0216 * d,
        // Half as wide as its nominal diameter.
        CanopyType::Atps => 0.02 * d,
        _ => d / 30.0,
    };
    let mut text = "[structure]\nintegration = \"explicit\"\n\n[flow]\n".to_owned();
    text += &key("density_kg_m3", DENSITY, "sea level; inviscid without [flow.viscosity]");
    if let Some(v) = wind {
        text += &key("wind_m_s", format!("[0.0, 0.0, {}]", digits(v)), "from below");
    }
    text += "\n[flow.immersed]              # the canopy moves through a Cartesian grid\n";
    text +=
        &key("spacing_m", digits(spacing), "cells around the canopy: the answer depends on it, refine it");
    text += "\n[coupling]\ntolerance = 5e-3             # of the change over a window\n";
    if wind.is_none() {
        text += "acceleration = \"iqn-ils\"     # one structure solve for each flow solve; \"ibqn-ls\" for longer windows\n";
    }
    text += "\n";
    text += "[output]\nsurface_every_windows = 25\nvolume_every_windows = 0\n\n";
    text
}

/// Length of the skirt, or of the ring of line attachments, m.
fn skirt(t: CanopyType, d: f64) -> f64 {
    match t {
        CanopyType::FlatCircular | CanopyType::Annular | CanopyType::Ringslot => PI * d,
        CanopyType::Conical | CanopyType::Ribbon => 3.04 * d,
        CanopyType::Hemispherical => 2.22 * d,
        CanopyType::ExtendedSkirt => 2.65 * d,
        CanopyType::Ringsail => 2.79 * d,
        CanopyType::DiskGapBand => 2.27 * d,
        CanopyType::Cross => 4.0 * (0.3 + 0.5) * 1.24 * d,
        CanopyType::Square => 3.54 * d,
        CanopyType::Atps => 4.0 * 6.096 / ATPS_DIAMETER * d,
    }
}

/// A window of the coupled stages, s: an eighth of the time in which the air passes a cell of the opening canopy.
fn window(d: f64, v: f64) -> f64 {
    one_digit(0.12 * d / 30.0 / v)
}

/// A window of the flow alone in a stage of `duration` s: four coupled windows, or five where four do not divide the stage.
fn slow_window(duration: f64, window: f64) -> f64 {
    let count = duration / (4.0 * window);
    if (count - count.round()).abs() < 1e-9 * count { 4.0 * window } else { 5.0 * window }
}

/// Mass of fabric, tapes and lines over the nominal area, kg/m2: the 5 kg of a flat circular canopy of 8.53 m.
const AREAL_MASS: f64 = 0.09;
/// Damping of the structure while it is gathered, 1/s.
const DAMPING: f64 = 5.0;
/// Force that stretches the lines, as a share of dynamic pressure times nominal area: half of what the check `stages.force` accepts as small.
const STRETCH: f64 = 0.005;

/// Force on each node (N) that stretches the lines of a gathered canopy, and the time (s) in which its line is drawn in and it rises.
fn gather(t: CanopyType, d: f64, v: f64) -> (f64, f64) {
    let force = STRETCH * 0.5 * DENSITY * v * v * nominal_area(d);
    let nodes = match t {
        CanopyType::Cross => 7 * 7 + 4 * 7 * 8,
        CanopyType::Square => 17 * 17,
        CanopyType::Atps => 11 * 11 + 4 * 10 * 8,
        _ => gores(t, d) * 2 * 12,
    };
    // The speed at which damping balances the force, and twice the way that lines have from a cone to the axis.
    let speed = force / (DAMPING * AREAL_MASS * nominal_area(d));
    // Whole windows.
    let time = (10.0 * (1.5 + 0.3 * d / speed)).ceil() / 10.0;
    (force / f64::from(nodes), time.clamp(2.0, 10.0))
}

/// Stages of an opening from a gathered skirt.
fn opening(t: CanopyType, d: f64, v: f64) -> String {
    let (force, gathering) = gather(t, d, v);
    let filling = t.handbook().and_then(|h| h.filling_constant).unwrap_or(8.0) * d / v;
    let stream = one_digit(1.5 * d / v);
    format!(
        "[[reefing]]
length_m = {reefing}             # 15 % of the ring of line attachments
draw_in_s = 1.0              # the line gathers the skirt in the first stage
release_stage = \"opening\"
release_s = 0.0              # cut at the start of the opening; later: a reefed phase

[[stage]]
name = \"gather\"
kind = \"pre-inflation\"       # structure alone
pressure_pa = {pressure}        # the line, not the pressure, shapes the canopy
duration_s = {gathering}
window_s = 5e-3
substeps = 20
mass_damping_per_s = {DAMPING:.1}

[[stage.force]]              # stretches the lines
nodes = \"canopy\"
force_n = [0.0, 0.0, {force}]

[[stage]]
name = \"stream\"
kind = \"flow-only\"           # the air flows around the gathered canopy
duration_s = {stream}
window_s = {slow}

[[stage]]
name = \"opening\"
kind = \"coupled\"
duration_s = {opening}             # the handbook's filling time and a fifth more
window_s = {window}
substeps = 10

[[stage]]
name = \"descent\"
kind = \"coupled\"
duration_s = {descent}            # first swings; a settled mean takes 100 s
window_s = {descent_window}
substeps = 20
",
        reefing = digits(0.15 * skirt(t, d)),
        pressure = plain(4e-5 * 0.5 * DENSITY * v * v),
        gathering = digits(gathering),
        force = digits(force),
        stream = digits(stream),
        slow = plain(slow_window(stream, window(d, v))),
        opening = digits((1.2 * filling).ceil()),
        window = plain(window(d, v)),
        descent = digits(one_digit(12.0 * d / DESCENT_SPEED)),
        descent_window = plain(window(d, DESCENT_SPEED)),
    )
}

/// Stages of a wind tunnel: the payload's point held in a steady wind until the wake has settled.
fn wind_tunnel(t: CanopyType, d: f64, v: f64) -> String {
    // The free edges of a cross have no equilibrium under a uniform pressure.
    let solve = match t {
        CanopyType::Cross => "duration_s = 2.0\nwindow_s = 5e-3\nsubsteps = 20\nmass_damping_per_s = 10.0\n",
        _ => "solve = \"static\"\n",
    };
    format!(
        "[[stage]]
name = \"pre-inflation\"
kind = \"pre-inflation\"       # structure alone, at rest under the dynamic pressure
pressure_pa = {pressure}
{solve}
[[stage]]
name = \"developed-flow\"
kind = \"flow-only\"
duration_s = {develop}
window_s = {window}

[[stage]]
name = \"wind-tunnel\"
kind = \"coupled\"
duration_s = {duration}            # 40 times the time in which the air passes the open canopy
window_s = {window}
substeps = 20

[stage.perturbation]         # the wake leaves its symmetric state
seed = 1
duration_s = {push}
",
        push = digits(0.65 * d / v),
        pressure = digits(0.5 * DENSITY * v * v),
        develop = digits(one_digit(3.0 * d / v)),
        duration = digits((40.0 * 0.65 * d / v).ceil()),
        window = plain(2.0 * window(d, v)),
    )
}

/// The nearest of 1, 2 and 5 times a power of ten at or below x.
fn one_digit(x: f64) -> f64 {
    let power = 10_f64.powf(x.log10().floor());
    let lead = x / power;
    power
        * if lead >= 5.0 {
            5.0
        } else if lead >= 2.0 {
            2.0
        } else {
            1.0
        }
}

/// A number such as 1e-3.
fn plain(x: f64) -> String {
    let text = format!("{x:.0e}");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(d: f64, experiment: Experiment) -> SceneSizes {
        SceneSizes { nominal_diameter_m: d, payload_mass_kg: None, speed_m_s: 20.0, experiment }
    }

    /// Every type at every size is a valid scene without a fitted grid, its canopy is meshed, its fabric has the nominal area less the openings, and the reefing line
    /// has 15 % of the ring of line attachments.
    #[test]
    fn scenes_of_all_types_are_valid() {
        for (t, d) in CanopyType::ALL.into_iter().flat_map(|t| [0.6, 8.53, 40.0].map(|d| (t, d))) {
            let text = scene(t, &sizes(d, Experiment::Opening));
            let tunnel = scene(t, &sizes(d, Experiment::WindTunnel));
            case::parse(std::path::Path::new("tunnel.toml"), &tunnel)
                .unwrap_or_else(|e| panic!("{t:?} {d}: {e}\n{tunnel}"));
            let parsed = case::parse(std::path::Path::new("scene.toml"), &text)
                .unwrap_or_else(|e| panic!("{t:?} {d}: {e}\n{text}"));
            let mesh = mesh::structure_mesh(&parsed).unwrap_or_else(|e| panic!("{t:?} {d}: {e}\n{text}"));
            let share = mesh.fabric_area(|_| true) / nominal_area(d);
            let openings = match t {
                CanopyType::Annular => 0.16,
                CanopyType::DiskGapBand => 0.13,
                CanopyType::Cross | CanopyType::Square | CanopyType::Atps => 0.0,
                _ => 0.01,
            };
            assert!((share + openings - 1.0).abs() < 0.012, "{t:?} {d}: {share}");
            let ring = mesh.skirt();
            let around: f64 = (0..ring.len())
                .map(|k| {
                    let [a, b] = [ring[k], ring[(k + 1) % ring.len()]].map(|n| mesh.coords[n as usize]);
                    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
                })
                .sum();
            let risers = t.risers().map(|r| (r.count, r.length * d));
            let built = parsed.canopy.risers().map(|r| (r.count, r.length_m));
            let near = |(a, b): ((u32, f64), (u32, f64))| a.0 == b.0 && (a.1 / b.1 - 1.0).abs() < 1e-3;
            assert!(risers.is_some() == built.is_some() && risers.zip(built).is_none_or(near), "{t:?} {d}");
            let reefing = parsed.reefing[0].length_m / around;
            assert!((reefing / 0.15 - 1.0).abs() < 0.06, "{t:?} {d}: {reefing} of {around}");
        }
    }

    #[test]
    fn stages_have_whole_windows() {
        for t in CanopyType::ALL {
            for d in [0.6, 1.5, 3.7, 8.53, 10.668, 19.5, 40.0] {
                for v in [6.7, 20.0, 40.0] {
                    for experiment in [Experiment::Opening, Experiment::WindTunnel] {
                        let text = scene(t, &SceneSizes { speed_m_s: v, ..sizes(d, experiment) });
                        let scene = case::parse(std::path::Path::new("scene.toml"), &text).expect("a scene");
                        for stage in scene.stages.iter().filter(|s| s.window_s > 0.0) {
                            let windows = stage.duration_s / stage.window_s;
                            let rest = (windows - windows.round()).abs();
                            assert!(rest < 1e-3, "{t:?} of {d} m at {v} m/s: {} has {windows}", stage.name);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [8.53, 57.146_1, 0.004_444_4, 123.0, 1234.56].map(digits),
            ["8.53", "57.15", "0.004444", "123.0", "1234.6"]
        );
        assert_eq!([0.0017, 0.0049, 3.4].map(one_digit).map(plain), ["1e-3", "2e-3", "2e0"]);
    }
}
