//! Pictures of small synthetic results.

use std::path::Path;

use clap::Parser;
use mesh::vtk::{Series, Values, write_surface, write_volume};
use mesh::{BoxShape, Patch as Side, box_grid_of};

use super::*;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: PictureArgs,
}

fn args(run: &Path, more: &[&str]) -> PictureArgs {
    let run = run.display().to_string();
    Line::parse_from(["picture", &run, "--width", "300"].iter().chain(more)).args
}

fn draw(run: &Path, more: &[&str]) -> Result<(), RunError> {
    picture(&args(run, more), &Console::new(true))
}

fn decode(run: &Path, name: &str) -> Image {
    crate::pixels::decode(&std::fs::read(run.join("pictures").join(name)).unwrap())
}

/// Copies a picture to the folder `RIPSTOP_KEEP`, if set.
fn keep(run: &Path, name: &str) {
    if let Some(folder) = std::env::var_os("RIPSTOP_KEEP") {
        std::fs::copy(run.join("pictures").join(name), Path::new(&folder).join(name)).unwrap();
    }
}

fn light(image: &Image, x: u32, y: u32) -> u32 {
    let [red, green, blue] = image.pixel(x, y).map(u32::from);
    2 * red + 7 * green + blue
}

fn colours(image: &Image) -> usize {
    let mut all = image.rgb.as_chunks::<3>().0.to_vec();
    all.sort_unstable();
    all.dedup();
    all.len()
}

/// A run without snapshots.
fn run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
    std::fs::copy(scene, folder.path().join("scene.toml")).unwrap();
    folder
}

/// A flat canopy of 4 m at height 0 with two lines; its pressure increases with x.
fn canopy(stage: &Path, times: &[f64], jump: f64) {
    let n = 4;
    let points: Vec<Point> =
        (0..=n).flat_map(|j| (0..=n).map(move |i| [f64::from(i) - 2.0, f64::from(j) - 2.0, 0.0])).collect();
    let corner = |i: i32, j: i32| (j * (n + 1) + i) as u32;
    let quads: Vec<[u32; 4]> = (0..n)
        .flat_map(|j| {
            (0..n).map(move |i| [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)])
        })
        .collect();
    let pressure: Vec<f64> = (0..n * n).map(|c| 10.0 + jump * f64::from(c % n)).collect();
    let moved: Vec<Point> = points.iter().map(|p| [0.0, 0.0, p[1]]).collect();
    let mut with_payload = points.clone();
    with_payload.push([0.0, 0.0, -4.0]);
    let payload = points.len() as u32;
    let (mut surface, mut lines) =
        (Series::new(stage.join("canopy.pvd")), Series::new(stage.join("lines.pvd")));
    for (i, &time) in times.iter().enumerate() {
        let [file, line] = ["canopy", "lines"].map(|kind| format!("{kind}_{i}.vtu"));
        let cell = [("pressure_jump_pa", Values::F64(&pressure))];
        let point = [("displacement_m", Values::Vector(&moved))];
        write_surface(&stage.join(&file), &points, &quads, &point, &cell).unwrap();
        write_surface(&stage.join(&line), &with_payload, &[[0, payload], [24, payload]], &[], &[]).unwrap();
        surface.push(time, &[file]).unwrap();
        lines.push(time, &[line]).unwrap();
    }
}

/// Two halves of a box around the canopy, from two ranks; the speed increases with z from 0.
fn flow(stage: &Path, field: &str) {
    let mut files = Vec::new();
    for (rank, shape) in [BoxShape::Hexahedra, BoxShape::Tetrahedra].into_iter().enumerate() {
        let left = -16.0 + 16.0 * rank as f64;
        let grid =
            box_grid_of(shape, [6, 6, 12], [left, -8.0, -12.0], [left + 16.0, 8.0, 12.0], [Side::Wall; 6]);
        let speed: Vec<[f32; 3]> = grid
            .cells
            .iter()
            .map(|c| c.iter().map(|&n| grid.coords[n as usize][2] as f32 / 8.0).sum::<f32>())
            .map(|z| [0.0, 0.0, z + 12.0])
            .collect();
        files.push(format!("flow/flow_00000_{rank}.vtu"));
        let path = stage.join(&files[rank]);
        write_volume(&path, &grid.coords, &grid.cells, &[], &[(field, Values::Vector32(&speed))]).unwrap();
    }
    Series::new(stage.join("flow.pvd")).push(0.1, &files).unwrap();
}

#[test]
fn run_gives_three_pictures() {
    let run = run();
    let run = run.path();
    canopy(&run.join("pre-inflation"), &[0.2, 0.4, 1.5], 0.0);
    canopy(&run.join("descent"), &[0.1, 0.2], 5.0);
    flow(&run.join("descent"), "velocity_frame_m_s");
    for more in [&[][..], &["--diagonal", "--time", "0.1"]] {
        draw(run, more).unwrap();
        for name in ["canopy.png", "flow.png", "pre-inflation.png"] {
            let image = decode(run, name);
            assert_eq!(image.width, 300);
            assert!(colours(&image) > 20, "{name}: {} colours", colours(&image));
            keep(run, name);
        }
        // Faster, so lighter, upwards; on both ranks' sides; from one paper edge to the other.
        let flow = decode(run, "flow.png");
        for x in [2, 40, 260, 297] {
            let rows: Vec<u32> = (0..180).rev().step_by(30).map(|y| light(&flow, x, y)).collect();
            assert!(rows.windows(2).all(|w| w[1] >= w[0]), "column {x}: {rows:?}");
            assert!(rows.last().unwrap() > &(rows[0] + 300), "column {x}: {rows:?}");
        }
    }
    // The canopy's cut is ink in the middle; its fabric covers the axis.
    let flow = decode(run, "flow.png");
    let ink = (0..flow.height).filter(|&y| light(&flow, 150, y) < 500).count();
    assert!(ink >= 1, "no canopy in the slice");
    // Where one stage has no flow, the canopy is drawn all the same.
    std::fs::remove_file(run.join("pictures/flow.png")).unwrap();
    draw(run, &["--stage", "pre-inflation"]).unwrap();
    assert!(!run.join("pictures/flow.png").exists());
    // A constant pressure does not colour the fabric: the displacement does.
    assert!(colours(&decode(run, "canopy.png")) > 20);
}

#[test]
fn animation_shows_all_stages_or_one() {
    let run = run();
    let run = run.path();
    canopy(&run.join("pre-inflation"), &[0.2, 0.4, 1.5], 0.0);
    canopy(&run.join("descent"), &[0.1, 0.2], 5.0);
    flow(&run.join("descent"), "velocity_frame_m_s");
    let history = "window,time_s,descent_speed_m_s\n0,0.1,4.0\n1,0.2,4.5\n";
    std::fs::write(run.join("descent/history.csv"), history).unwrap();
    let frames = |path: &Path| {
        let bytes = std::fs::read(path).unwrap();
        let reader = png::Decoder::new(&bytes[..]).read_info().unwrap();
        (reader.info().animation_control.unwrap().num_frames, reader.info().width)
    };
    draw(run, &["--animate"]).unwrap();
    keep(run, "animation.png");
    assert_eq!(frames(&run.join("pictures/animation.png")), (5, 300));
    let file = run.join("some/where/fall.png");
    draw(run, &["--animate", "--stage", "descent", "--out", &file.display().to_string()]).unwrap();
    assert_eq!(frames(&file), (2, 300));
    draw(run, &["--animate", "--frames", "3", "--out", &file.display().to_string()]).unwrap();
    assert_eq!(frames(&file), (3, 300));
    // A run of the structure alone has the canopy alone.
    draw(run, &["--animate", "--stage", "pre-inflation", "--out", &file.display().to_string()]).unwrap();
    assert_eq!(frames(&file), (3, 300));
    assert_eq!(draw(run, &["--animate", "--stage", "landing"]).unwrap_err().exit_code(), 2);
    let error = draw(run, &["--animate", "--stage", "developed-flow"]).unwrap_err();
    assert!(error.to_string().contains("surface_every_windows"), "{error}");
}

#[derive(Parser)]
struct ExportLine {
    #[command(flatten)]
    args: AnimationArgs,
}

fn export(run: &Path, more: &[&str]) -> Result<(), RunError> {
    let run = run.display().to_string();
    let args = ExportLine::parse_from(["animation", &run, "--size", "200"].iter().chain(more)).args;
    export_animation(&args, &Console::new(true))
}

#[test]
fn exported_animation_is_a_gif_or_numbered_files() {
    let run = run();
    let run = run.path();
    canopy(&run.join("descent"), &[0.1, 0.2, 0.3], 5.0);
    export(run, &[]).unwrap();
    let file = run.join("export/descent-canopy.gif");
    let bytes = std::fs::read(&file).unwrap();
    let mut decoder = gif::DecodeOptions::new().read_info(&bytes[..]).unwrap();
    assert_eq!((decoder.width(), decoder.height()), (200, 190));
    // The times differ, and nothing else.
    let mut sizes = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        sizes.push((frame.width, frame.height));
    }
    assert_eq!((sizes.len(), sizes[0]), (3, (200, 190)));
    assert!(sizes[1..].iter().all(|&(w, h)| w < 40 && h < 20), "{sizes:?}");
    export(run, &[]).unwrap();
    assert!(std::fs::read(&file).unwrap() == bytes, "the same snapshots, the same bytes");

    let png = ["--format", "png", "--view", "top", "--field", "displacement_m"];
    export(run, &png).unwrap();
    let folder = run.join("export/descent-canopy");
    let names = || std::fs::read_dir(&folder).unwrap().count();
    assert_eq!(names(), 3);
    let image = crate::pixels::decode(&std::fs::read(folder.join("frame_00002.png")).unwrap());
    // From above, a square: as far from the middle along x as along y; its displacement grows along y, away from the middle.
    assert!(colours(&image) > 20);
    std::fs::write(folder.join("notes.txt"), "kept").unwrap();
    export(run, &[&png[..], &["--every", "2"]].concat()).unwrap();
    assert_eq!(names(), 3, "two frames and the notes");
}

#[test]
fn what_cannot_be_animated_is_named() {
    let run = run();
    let run = run.path();
    let says = |more: &[&str], words: &[&str]| {
        let error = export(run, more).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{error}");
        for word in words {
            assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
        }
    };
    says(&[], &["canopy.pvd", "output.surface_every_windows"]);
    canopy(&run.join("descent"), &[0.1, 0.2], 5.0);
    says(&["--field", "mach"], &["`mach`", "displacement_m"]);
    says(&["--to", "0.05"], &["from 0.1 s to 0.2 s"]);
    let scene = run.join("scene.toml").display().to_string();
    says(&["--out", &scene], &["scene.toml", "not replaced"]);
    says(&["--out", &scene, "--format", "png"], &["scene.toml", "not replaced"]);
    for wrong in [["--view", "30"], ["--view", "0,100"], ["--size", "50"], ["--size", "800x"], ["--fps", "0"]]
    {
        let line = [&["animation", "run"], &wrong[..]].concat();
        assert!(ExportLine::try_parse_from(line).is_err(), "{wrong:?}");
    }
}

#[test]
fn flow_around_a_canopy_at_rest_is_drawn() {
    let run = run();
    let run = run.path();
    canopy(&run.join("pre-inflation"), &[1.5], 0.0);
    flow(&run.join("developed-flow"), "velocity_frame_m_s");
    draw(run, &["--stage", "developed-flow"]).unwrap();
    assert!(colours(&decode(run, "flow.png")) > 20);
    assert!(!run.join("pictures/canopy.png").exists());
}

#[test]
fn missing_results_are_named() {
    let run = run();
    let run = run.path();
    let says = |run: &Path, more: &[&str], words: &[&str]| {
        let error = draw(run, more).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{error}");
        for word in words {
            assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
        }
    };
    says(&run.join("nowhere"), &[], &["nowhere", "ripstop run"]);
    let empty = tempfile::tempdir().unwrap();
    says(empty.path(), &[], &["scene.toml", "ripstop run"]);
    says(run, &[], &["canopy.pvd", "surface_every_windows", "ripstop run"]);
    says(run, &["--stage", "landing"], &["`landing`", "`descent`"]);
    says(run, &["--stage", "descent"], &["`descent`", "ripstop run"]);
    canopy(&run.join("descent"), &[0.1], 5.0);
    flow(&run.join("descent"), "velocity");
    says(run, &[], &["velocity_frame_m_s", "flow_00000_0.vtu"]);
    std::fs::remove_file(run.join("descent/canopy_0.vtu")).unwrap();
    says(run, &[], &["canopy_0.vtu", "ripstop run"]);
}
