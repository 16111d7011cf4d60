//! Reports of complete and incomplete runs.

use std::path::Path;

use coupling::error::RunError;
use mesh::vtk::{Series, Values, write_surface};

use super::chart::{Chart, Series as Curve, digits};
use super::data::Run;
use super::{document, html, markdown};

const SCENE: &str = include_str!("../../../cases/square-drop/scene.toml");

/// A results folder with these histories (stage, text).
fn folder(histories: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    for (stage, text) in histories {
        std::fs::create_dir_all(folder.path().join(stage)).unwrap();
        std::fs::write(folder.path().join(stage).join("history.csv"), text).unwrap();
    }
    folder
}

const STRUCTURE: &str = "window,time_s,projected_area_m2,riser_force_n,structure_wall_s,window_wall_s\n\
                         0,0.005,3.1,40,0.1,0.2\n1,0.01,3.2,41,0.1,0.2\n2,0.015,3.3,42,0.1,0.2\n";
const FALL: &str = "window,time_s,descent_speed_m_s,drag_n,coupling_iterations,coupling_residual,coupling_converged\n\
                    0,0.005,4.01,50,5,1e-3,1\n1,0.01,4.02,51,7,6e-3,0\n2,0.015,4.0";

fn page(folder: &Path) -> String {
    html::page(&document::document(&Run::open(folder).unwrap(), 1_000_000).unwrap(), None)
}

fn refusal(folder: &Path) -> String {
    match Run::open(folder) {
        Err(RunError::Input(message)) => message,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("the folder was accepted"),
    }
}

#[test]
fn folder_without_a_run_is_refused_with_the_reason() {
    let empty = tempfile::tempdir().unwrap();
    assert!(refusal(&empty.path().join("nowhere")).contains("there is no folder"));
    assert!(refusal(empty.path()).contains("scene.toml is missing"));
    assert!(refusal(folder(&[]).path()).contains("no window of any stage"));
    assert!(refusal(folder(&[("descent", "window,time_s\n")]).path()).contains("no window of any stage"));
    let damaged = folder(&[("descent", "window,time_s\n0,0.1\n1\n2,0.3\n")]);
    assert!(refusal(damaged.path()).contains("line 3"));
    let bad = folder(&[("pre-inflation", STRUCTURE)]);
    std::fs::write(bad.path().join("summary.json"), "{").unwrap();
    assert!(refusal(bad.path()).contains("summary.json is damaged"));
}

#[test]
fn wall_time_has_the_advice_on_ranks() {
    let run = folder(&[("descent", FALL)]);
    let scene = case::load(&run.path().join("scene.toml")).unwrap();
    let mut stage = results::summary::StageSummary::new(scene.stages.last().unwrap());
    (stage.wall_s, stage.flow_busy_s) = (20.0, 15.0);
    stage.rank_advice =
        Some(results::rank_advice::RankAdvice { ranks: [1, 2, 1], wall_ratio: [0.625, 0.79] });
    let summary = serde_json::json!({ "ended": "complete", "ranks": [1, 1, 1], "stages": [stage] });
    std::fs::write(run.path().join("summary.json"), summary.to_string()).unwrap();
    let page = page(run.path());
    let text = "descent: ranks: the others wait for the flow-solver in 75 % of the wall time; --ranks flow=2 would take 0.62 to 0.79";
    assert!(page.contains(text), "{page}");
}

#[test]
fn page_of_one_stage_names_the_missing_data() {
    let run = folder(&[("pre-inflation", STRUCTURE)]);
    let page = page(run.path());
    assert!(page.contains("Projected area") && page.contains("Riser force"));
    // No chart without its column, and no viewer without shapes.
    assert!(!page.contains("Descent speed</h") && !page.contains("id=\"canopy\""));
    for missing in
        ["summary.json is missing", "surface_every_windows = 4", "stage `descent`: no window was completed"]
    {
        assert!(page.contains(missing), "{missing}");
    }
}

#[test]
fn killed_run_is_reported_up_to_its_last_complete_row() {
    let run = folder(&[("descent", FALL)]);
    let opened = Run::open(run.path()).unwrap();
    assert_eq!(opened.main().columns.rows(), 2);
    let page = page(run.path());
    for part in
        ["it is incomplete", "window 1 of stage `descent` did not converge", "ended after 2 of 20 windows"]
    {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn page_loads_nothing_and_is_well_formed() {
    let run = folder(&[("pre-inflation", STRUCTURE), ("descent", FALL)]);
    shapes(&run.path().join("pre-inflation"));
    let page = page(run.path());
    let opens = |tag: &str| page.matches(&format!("<{tag}")).count();
    assert_eq!(opens("table"), opens("caption"), "every table has a caption");
    assert!(!page.contains("<caption></caption>") && !page.contains("<figcaption></figcaption>"));
    for tag in ["section", "figure", "table", "caption", "svg", "div", "script", "ul"] {
        assert_eq!(opens(tag), page.matches(&format!("</{tag}>")).count(), "{tag}");
    }
    assert!(page.contains("id=\"canopy-data\"") && page.contains("The licence of three.js"));
    // Addresses are data URLs or anchors of the page.
    for found in page.split("src=\"").skip(1).chain(page.split("href=\"").skip(1)) {
        assert!(found.starts_with("data:") || found.starts_with('#'), "{}", &found[..40.min(found.len())]);
    }
    assert!(page.contains("Vent area") && page.contains("State of the fabric"));
    if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
        std::fs::write(Path::new(&keep).join("report.html"), &page).unwrap();
    }
}

/// 24 lines of 300 N: 240 N at most in the descent and 200 N before it. A factor below the required one is marked.
#[test]
fn smallest_safety_factor_is_that_of_all_stages() {
    let history = |most: f64| {
        format!("window,time_s,max_line_tension_n\n0,0.005,{}\n1,0.01,{most}\n2,0.015,90\n", 0.5 * most)
    };
    let run = folder(&[("pre-inflation", &history(200.0)), ("descent", &history(240.0))]);
    assert!(!page(run.path()).contains("Smallest safety factor"));
    let with = |keys: &str| {
        std::fs::write(run.path().join("scene.toml"), SCENE.replace("[lines]", &format!("[lines]\n{keys}")))
            .unwrap();
        page(run.path())
    };
    let text =
        "safety factor of lines 1.25: largest tension 240.0 N at 0.0100 s, strength 300.0 N, stage descent";
    assert!(with("strength_n = 300.0").contains(text));
    let below = with("strength_n = 300.0\nsafety_factor = 2.0");
    assert!(below.contains("safety factor of lines 1.25, below the required 2: largest tension 240.0 N"));
}

/// The descent of the paper over `rows` windows of 0.5 s with side forces of amplitude `side` (N), 0.5 diameters of stream a second.
fn atps(side: f64, rows: u32) -> String {
    let folder = tempfile::tempdir().unwrap();
    let scene = include_str!("../../../cases/atps-descent/scene.toml")
        .replace("duration_s = 1.0", "duration_s = 1000.0");
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let mut text = String::from(
        "window,time_s,descent_speed_m_s,drag_n,force_x_n,force_y_n,pendulum_angle_deg,stream_diameters\n",
    );
    for i in 1..=rows {
        let t = f64::from(i) * 0.5;
        let swing = (0.5 * t).sin();
        text += &format!(
            "{i},{t},{},1050,{},0,{},{}\n",
            4.7 + 0.1 * swing,
            side * swing,
            2.0 * swing.abs(),
            0.5 * t
        );
    }
    std::fs::create_dir_all(folder.path().join("descent")).unwrap();
    std::fs::write(folder.path().join("descent").join("history.csv"), text).unwrap();
    page(folder.path())
}

#[test]
fn published_values_stand_next_to_means_of_a_developed_wake_only() {
    let developed = atps(300.0, 800);
    for part in ["paper 4.69392: +", "Strouhal number of the side force", "0.159", "Pendulum angle"] {
        assert!(developed.contains(part), "{part}");
    }
    assert!(!developed.contains("not compared with published values"));
    let short = atps(300.0, 20);
    let symmetric = atps(9.0, 800);
    for (page, why) in
        [(&short, "a confidence interval needs 4"), (&symmetric, "the wake is still symmetric")]
    {
        assert!(page.contains("not compared with published values") && page.contains(why), "{why}");
        assert!(!page.contains("4.69392"), "{why}");
    }
    assert!(symmetric.contains("warning wake.symmetric") && short.contains("warning wake.periods"));
    // One verdict for a stage.
    assert!(!atps(9.0, 20).contains("wake.symmetric"));
}

/// Two shapes of a sheet with a square hole of 1 m2, then of 2 m x 1 m.
fn shapes(folder: &Path) {
    let mut series = Series::new(folder.join("canopy.pvd"));
    for (i, wide) in [1.0, 2.0].into_iter().enumerate() {
        let x = [-3.0, 0.0, wide, 5.0];
        let y = [-3.0, 0.0, 1.0, 4.0];
        let points: Vec<[f64; 3]> = (0..16).map(|n| [x[n % 4], y[n / 4], 0.0]).collect();
        let squares = (0..9u32).filter(|s| *s != 4).map(|s| 4 * (s / 3) + s % 3);
        let triangles: Vec<[u32; 3]> = squares.flat_map(|a| [[a, a + 1, a + 5], [a, a + 5, a + 4]]).collect();
        let stress: Vec<f64> = (0..16).map(|t| f64::from(t) * 1e5).collect();
        let states: Vec<u32> = (0..16).map(|t| t % 3).collect();
        let name = format!("canopy_{i}.vtu");
        let fields = [("stress_1_pa", Values::F64(&stress)), ("wrinkling_state", Values::U32(&states))];
        write_surface(&folder.join(&name), &points, &triangles, &[], &fields).unwrap();
        series.push(0.01 * i as f64, &[&name]).unwrap();
    }
}

#[test]
fn canopy_is_measured_and_encoded_correctly() {
    let run = folder(&[("pre-inflation", STRUCTURE)]);
    shapes(&run.path().join("pre-inflation"));
    let opened = Run::open(run.path()).unwrap();
    let frames = super::frames::read(&opened, opened.main(), 9).unwrap().unwrap();
    let vents: Vec<f64> = frames.measures.iter().flat_map(|m| m.vents.clone()).collect();
    assert!(
        vents.len() == 2 && (vents[0] - 1.0).abs() < 1e-12 && (vents[1] - 2.0).abs() < 1e-12,
        "{vents:?}"
    );
    assert!((frames.measures[0].mouth - 8.0 * 7.0).abs() < 1e-9);
    assert!((frames.measures[0].states.iter().sum::<f64>() - 1.0).abs() < 1e-12);

    // Decoded as by the viewer.
    let packed = super::pack::pack(&[frames], None).unwrap();
    use base64::Engine;
    use std::io::Read;
    let deflated = base64::engine::general_purpose::STANDARD.decode(&packed.data).unwrap();
    let mut bytes = Vec::new();
    flate2::read::ZlibDecoder::new(&deflated[..]).read_to_end(&mut bytes).unwrap();
    let number = |key: &str| packed.header[key].as_u64().unwrap() as usize;
    let (nodes, triangles) = (number("nodes"), number("triangles"));
    assert_eq!((nodes, triangles, number("hem"), number("cables")), (16, 16, 16, 0));
    let topology = 4 * (3 * triangles + 2 * number("hem"));
    let frame = 6 * nodes + 3 * triangles;
    assert_eq!(bytes.len(), topology + 2 * frame);
    // x coordinate of node 2: 1 m, then 2 m, in the range -3 to 5.
    let mut place = 0u16;
    for (at, expected) in [(topology, 1.0), (topology + frame, 2.0)] {
        let i = 3 * 2;
        place = place.wrapping_add(u16::from(bytes[at + i]) | u16::from(bytes[at + 3 * nodes + i]) << 8);
        let x = -3.0 + 8.0 * f64::from(place) / 65535.0;
        assert!((x - expected).abs() < 8.0 / 65535.0, "{x}");
    }
}

/// A run of the small descent with `rows` windows of `speed(t)`, and its scene with `change` made.
fn descent(rows: u32, [old, new]: [&str; 2], speed: impl Fn(f64) -> f64) -> tempfile::TempDir {
    let run = folder(&[]);
    assert!(SCENE.contains(old));
    std::fs::write(run.path().join("scene.toml"), SCENE.replace(old, new)).unwrap();
    let mut text = String::from("window,time_s,descent_speed_m_s,drag_n,window_wall_s\n");
    for i in 1..=rows {
        let t = 0.1 * f64::from(i);
        text += &format!("{i},{t},{},{},0.5\n", speed(t), 50.0 + (3.0 * t).sin());
    }
    std::fs::create_dir_all(run.path().join("descent")).unwrap();
    std::fs::write(run.path().join("descent").join("history.csv"), text).unwrap();
    run
}

/// Speeds 0.5 m/s apart with the same small swing, and drags that are the same.
#[test]
fn comparison_has_names_differences_intervals_and_differing_keys() {
    let swing = |t: f64| 0.1 * (3.0 * t).sin();
    let same = ["payload_mass_kg = 5.0"; 2];
    let first = descent(800, same, |t| 4.0 + swing(t));
    let second = descent(800, [same[0], "payload_mass_kg = 6.5"], |t| 4.5 + swing(t));
    let folders = [&first, &second].map(|f| f.path().to_owned());
    let document = super::comparison::document(&folders).unwrap();
    let page = html::page(&document, None);
    let names = folders.each_ref().map(|f| f.file_name().unwrap().to_string_lossy().into_owned());
    for part in [
        names[0].as_str(),
        names[1].as_str(),
        "descent.payload_mass_kg</th><td>5.0</td><td>6.5",
        "(+12.50 %); the intervals do not overlap",
        "(+0.00 %); the intervals overlap",
        "Drag, N",
        "0.5000 s",
        "no warnings",
    ] {
        assert!(page.contains(part), "{part}");
    }
    // Each chart has a curve of each run.
    let curves = page.matches(&format!("data-label=\"{}\"", names[1])).count();
    assert!(curves >= 2 && curves == page.matches(&format!("data-label=\"{}\"", names[0])).count());
    for found in page.split("src=\"").skip(1).chain(page.split("href=\"").skip(1)) {
        assert!(found.starts_with("data:") || found.starts_with('#'), "{}", &found[..40.min(found.len())]);
    }
    let out = first.path().join("comparison.md");
    markdown::write(&document, &out).unwrap();
    assert!(std::fs::read_to_string(&out).unwrap().contains("the intervals do not overlap"));
}

/// 20 windows have no settled mean: the difference is not judged.
#[test]
fn comparison_of_short_runs_judges_nothing() {
    let same = ["payload_mass_kg = 5.0"; 2];
    let [a, b] = [4.0, 5.0].map(|v| descent(20, same, move |t| v + 0.1 * t));
    let page = html::page(&super::comparison::document(&[a.path().into(), b.path().into()]).unwrap(), None);
    assert!(
        page.contains("no interval)") && page.contains("fewer than 40 windows") && !page.contains("overlap<")
    );
    assert!(page.contains("All scenes have the same values."));
}

#[test]
fn page_of_a_running_run_reloads_itself_and_the_last_one_does_not() {
    let run = folder(&[("descent", FALL)]);
    let document = document::document(&Run::open(run.path()).unwrap(), 1_000_000).unwrap();
    assert!(html::page(&document, Some(7)).contains("<body data-reload=\"7\">"));
    assert!(
        !html::page(&document, None).contains("data-reload=")
            && !page(run.path()).contains("http-equiv=\"refresh")
    );
    let _lock = results::lock::lock(run.path()).unwrap();
    assert!(page(run.path()).contains("The run continues"));
}

/// The 3-D view is the first section, before the key figures, and has the payload at the end of the lines.
#[test]
fn view_is_first_and_has_the_payload() {
    let run = folder(&[("pre-inflation", STRUCTURE)]);
    shapes(&run.path().join("pre-inflation"));
    let page = page(run.path());
    let at = |part: &str| page.find(part).unwrap_or_else(|| panic!("{part}"));
    assert!(at("<section id=\"canopy-section\">") < at("<div class=\"cards\">"));
    assert!(at("<div class=\"cards\">") < at("<section id=\"stage-pre-inflation\">"));
    assert!(
        page.contains("\"payload\":{\"size\":[") && page.contains("\"payload\":[[0.0,0.0,-"),
        "{}",
        &page[at("canopy-data")..][..400]
    );
}

/// A payload that moves as a body, in a frame that drifts.
#[test]
fn motion_of_the_payload_and_trajectory_have_charts() {
    let history = "window,time_s,descent_speed_m_s,frame_x_m,frame_y_m,frame_z_m\n\
                   0,0.005,4,0.1,0.2,-0.4\n1,0.01,4,0.3,0.1,-0.8\n2,0.015,4,0.2,0.3,-1.2\n";
    let run = folder(&[("descent", history)]);
    let motion = "time_s,x_m,tilt_rad,rate_z_rad_s\n0.005,0.1,0.5,1\n0.01,0.2,0.6,2\n0.015,0.1,0.7,3\n";
    std::fs::write(run.path().join("descent").join("payload.csv"), motion).unwrap();
    let page = page(run.path());
    for part in [
        "Tilt of the payload, deg",
        "between 28.65 and 40.11 deg",
        "Angular velocity of the payload, deg/s",
        "Position of the payload in the frame, m",
        "Trajectory from above: y, m",
        "Trajectory from the side: height, m",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("Velocity of the payload in the frame"), "a chart without its columns");
}

#[test]
fn markdown_links_only_existing_pictures() {
    let run = folder(&[("pre-inflation", STRUCTURE)]);
    shapes(&run.path().join("pre-inflation"));
    let out = run.path().join("report.md");
    markdown::write(&document::document(&Run::open(run.path()).unwrap(), 1000).unwrap(), &out).unwrap();
    let text = std::fs::read_to_string(&out).unwrap();
    let pictures: Vec<&str> = text.split("](").skip(1).map(|t| t.split(')').next().unwrap()).collect();
    assert!(pictures.len() > 3, "{text}");
    for picture in pictures {
        assert!(run.path().join(picture).is_file(), "{picture}");
    }
    assert!(text.contains("| scene | square-drop |"), "{text}");
}

#[test]
fn charts_accept_values_that_are_not_finite() {
    let curve = |points: &[(f64, f64)]| Chart {
        title: "x".into(),
        series: vec![Curve { label: "a < b".into(), points: points.to_vec() }],
        ..Chart::default()
    };
    assert!(curve(&[(0.0, 1.0), (1.0, f64::NAN)]).is_empty());
    for logarithmic in [false, true] {
        let mut chart = curve(&[(0.0, 1e-9), (0.5, f64::NAN), (1.0, 0.0), (2.0, 1e-9), (3.0, f64::INFINITY)]);
        chart.logarithmic = logarithmic;
        for svg in [chart.element(), chart.file()] {
            assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("a < b"), "{svg}");
        }
    }
    // A curve of ten thousand points is thinned and keeps its end points.
    let many: Vec<(f64, f64)> = (0..10_000).map(|i| (f64::from(i), f64::from(i))).collect();
    let svg = curve(&many).element();
    let kept = svg.split("data-points=\"").nth(1).unwrap().split('"').next().unwrap();
    let kept: Vec<&str> = kept.split(';').collect();
    assert!(kept.len() <= 700 && kept[0] == "0,0" && kept[kept.len() - 1] == "9999,9999", "{}", kept.len());
    let texts = [(4.69392, "4.694"), (0.0123456, "0.01235"), (1045.2, "1045"), (2.5e7, "2.50e7"), (0.0, "0")];
    for (value, text) in texts {
        assert_eq!(digits(value), text);
    }
}

#[test]
fn style_sheet_defines_every_chart_colour() {
    use figures::colour::{BAND, GREY, GRID, INK, SERIES};
    let of = |c: figures::colour::Colour| format!("[fill=\"#{:02X}{:02X}{:02X}\"]", c.0, c.1, c.2);
    for colour in SERIES.into_iter().chain([INK, GREY, GRID, BAND]) {
        assert!(super::chart::STYLE.contains(&of(colour)), "{}", of(colour));
    }
}
