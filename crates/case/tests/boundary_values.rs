//! What `[[flow.inlet]]`, `[[flow.outlet]]` and `[[flow.moving_wall]]` accept and refuse.

use std::path::Path;

use case::{Scene, TimeFactor};

const PANEL: &str = include_str!("../../../cases/hard/channel/scene.toml");

/// The channel with an inlet on the left, walls below and above, viscosity and `more`.
fn read(more: &str) -> Result<Scene, String> {
    let mut text = PANEL.to_owned();
    for (from, to) in [
        ("left = \"outlet\"", "left = \"inlet\""),
        ("bottom = \"slip\"", "bottom = \"wall\""),
        ("top = \"slip\"", "top = \"wall\""),
        ("[flow.solver]", &format!("[flow.viscosity]\n{more}\n[flow.solver]")),
    ] {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    case::parse(Path::new("scene.toml"), &text).map_err(|e| e.to_string())
}

const INLET: &str = "[[flow.inlet]]\npatch = \"left\"\n";
const WALL: &str = "[[flow.moving_wall]]\npatch = \"top\"\n";
const OUTLET: &str = "[[flow.outlet]]\npatch = \"right\"\npressure_pa = 10\n";

#[test]
fn data_of_patches_are_read() {
    let table = "y_m = [-0.25, 0, 0.25]\nz_m = [0, 0.5]\nvalue = [[0, 0], [1, 2], [0, 0]]\n";
    let text = format!(
        "{INLET}flow_rate_m3_s = 2\nfactor = {{ time_s = [0, 2], value = [0, 1] }}\n[flow.inlet.profile_table]\n{table}\
         {OUTLET}factor = {{ formula = \"exp(-t)\" }}\n{WALL}velocity_m_s = [1, 0.5, 0]\n\
         [[flow.moving_wall]]\npatch = \"bottom\"\nrotation = {{ axis = [0, 0, -1], point_m = [1, 0, 0], angular_velocity_rad_s = 3 }}\n"
    );
    let flow = read(&text).unwrap_or_else(|e| panic!("{e}")).flow.expect("a flow");
    assert!(flow.has_boundary_values());
    let profile = flow.inlets[0].compiled_profile().expect("a table");
    // Bilinear inside, constant beyond the ends.
    for (x, value) in [
        ([9.0, 0.125, 0.25], 0.75),
        ([0.0, 0.0, 0.5], 2.0),
        ([0.0, -0.0625, 0.0], 0.75),
        ([0.0, 0.0, 7.0], 2.0),
        ([0.0, -3.0, 0.2], 0.0),
    ] {
        assert!((profile.at(x) - value).abs() < 1e-15, "{x:?}: {} {value}", profile.at(x));
    }
    let factor = |f: Option<&TimeFactor>, t: f64| TimeFactor::compiled(f).expect("a factor").at(t);
    let of_inlet = flow.inlets[0].factor.as_ref();
    assert_eq!([-1.0, 0.5, 2.0, 9.0].map(|t| factor(of_inlet, t)), [0.0, 0.25, 1.0, 1.0]);
    assert_eq!(factor(flow.outlets[0].factor.as_ref(), 1.0), (-1.0f64).exp());
    assert_eq!(factor(None, 1.0), 1.0);
}

#[test]
fn data_that_a_patch_cannot_have_are_refused_with_key_and_remedy() {
    let inlet = |more: &str| format!("{INLET}velocity_m_s = [1, 0, 0]\n{more}");
    let rotation = |axis: &str| {
        format!("{WALL}rotation = {{ axis = {axis}, point_m = [0, 0, 0], angular_velocity_rad_s = 1 }}\n")
    };
    for (text, wanted) in [
        (inlet("").replace("left", "lefft"), ["no patch \"lefft\"", "name one of: left, right, front"]),
        (
            inlet("").replace("left", "right"),
            ["condition \"outlet\", but this table is for \"inlet\"", "give the patch"],
        ),
        (inlet("").repeat(2), ["has two of these tables", "keep one"]),
        (OUTLET.replace("right", "left"), ["condition \"inlet\"", "\"outlet\""]),
        (inlet("flow_rate_m3_s = 1\n"), ["a velocity and a flow rate", "keep `velocity_m_s` or"]),
        (INLET.into(), ["neither a velocity nor a flow rate", "add `velocity_m_s`"]),
        (inlet("profile = \"1 - r^2\"\n"), ["unknown name `r`", "write a formula"]),
        (
            inlet("profile = \"y\"\nprofile_table = { y_m = [0], value = [[1]] }\n"),
            ["two profiles", "keep `profile`"],
        ),
        (inlet("profile_table = { value = [[1]] }\n"), ["0 coordinates", "give one or two"]),
        (inlet("profile_table = { y_m = [0, 1], value = [[1, 2]] }\n"), ["not 2 rows of 1", "give a row"]),
        (
            inlet("profile_table = { y_m = [1, 1], value = [[1], [2]] }\n"),
            ["do not increase", "increasing order"],
        ),
        (inlet("factor = {}\n"), ["the factor is empty", "give `formula`"]),
        (
            inlet("factor = { formula = \"t\", time_s = [0], value = [1] }\n"),
            ["a formula and a table", "give `formula`"],
        ),
        (inlet("factor = { formula = \"x\" }\n"), ["unknown name `x` (known: t", "write a formula"]),
        (
            inlet("factor = { time_s = [0, 1], value = [1] }\n"),
            ["2 times, but 1 values", "one value for each"],
        ),
        (
            inlet("factor = { time_s = [1, 0], value = [1, 1] }\n"),
            ["times do not increase", "increasing order"],
        ),
        (
            inlet("[flow.gust]\nvelocity_m_s = [1, 0, 0]\nduration_s = 1\n"),
            ["accelerates all of the air", "remove the gust"],
        ),
        (OUTLET.replace("10", "-1e6"), ["pressure_pa", "allowed"]),
        (format!("{WALL}velocity_m_s = [1, 0, 0.1]\n"), ["0.1 m/s normal to the wall", "component 2"]),
        (WALL.into(), ["neither a velocity nor a rotation", "add `velocity_m_s`"]),
        (rotation("[0, 0, 1]") + "velocity_m_s = [1, 0, 0]\n", ["slides and rotates", "keep"]),
        (rotation("[0, 1, 1]"), ["axis is not normal to this plane wall", "other than 2"]),
        (rotation("[0, 0, 0]"), ["no direction", "[0, 0, 1]"]),
    ] {
        let message = read(&text).expect_err(&text);
        assert!(wanted.iter().all(|w| message.contains(w)), "{text}: {message}");
        assert!(message.contains("scene.toml:"), "no place: {message}");
    }
}

#[test]
fn moving_wall_of_an_inviscid_flow_is_refused() {
    let inviscid = PANEL.replacen("top = \"slip\"", "top = \"wall\"", 1);
    let inviscid =
        inviscid.replacen("[flow.solver]", &format!("{WALL}velocity_m_s = [1, 0, 0]\n[flow.solver]"), 1);
    let message = case::parse(Path::new("scene.toml"), &inviscid).expect_err("no friction").to_string();
    assert!(
        message.contains("the flow is inviscid") && message.contains("add [flow.viscosity]"),
        "{message}"
    );
}

/// A generated grid has no names; a stage that marches to a steady state has no time.
#[test]
fn data_need_named_patches_and_factors_need_time() {
    let drop = include_str!("../../../cases/square-drop/scene.toml");
    let text = drop.replacen("[flow.grid]", &format!("{INLET}velocity_m_s = [1, 0, 0]\n[flow.grid]"), 1);
    assert_ne!(text, drop);
    let message = case::parse(Path::new("scene.toml"), &text).expect_err("no names").to_string();
    assert!(message.contains("no named patches") && message.contains("[flow.grid_file]"), "{message}");
    let steady = "[[stage]]\nname = \"steady\"\nkind = \"flow-only\"\n[stage.steady]\n";
    let factor = "velocity_m_s = [1, 0, 0]\nfactor = { formula = \"1 + t\" }\n";
    let (head, _) = PANEL.split_once("[[stage]]").expect("stages");
    let text = head.replacen("left = \"outlet\"", "left = \"inlet\"", 1);
    let text = text.replacen("[flow.solver]", &format!("{INLET}{factor}[flow.solver]"), 1) + steady;
    let message = case::parse(Path::new("scene.toml"), &text).expect_err("no time").to_string();
    assert!(
        message.contains("marches to a steady state") && message.contains("remove the factor"),
        "{message}"
    );
}
