//! `ripstop picture`: rendered pictures and animations of canopy and flow, as PNG.

mod animation;
mod export;
mod flow;
mod legend;
mod raster;
mod slice;
#[cfg(test)]
mod tests;
mod view;

use std::path::PathBuf;

use case::StageKind;
use clap::Args;
use coupling::error::RunError;
use mesh::Point;
use mesh::vtk::read::Piece;
use terminal::Console;

use self::animation::Choice;
pub use self::export::{AnimationArgs, export_animation};
use self::flow::Flow;
use self::legend::{Legend, Range};
use self::raster::Raster;
use self::view::{Body, View, at_points, draw as draw_body};
use crate::colour::{INK, WARM};
use crate::pixels::Image;
use crate::sheet::{Anchor, Sheet};
use crate::snapshots::{Kind, RunSnapshots, Structure};

/// Reason why drawing in memory cannot fail.
const IN_MEMORY: &str = "drawing in memory with an embedded font does not fail";
/// View direction of the canopy pictures: azimuth and elevation, degrees.
const EYE: [f64; 2] = [28.0, -14.0];
/// Times of figure 4 of the paper relative to the last one (0.2, 0.4 and 0.8 s of 1.5 s).
const STRIP: [f64; 3] = [0.2 / 1.5, 0.4 / 1.5, 0.8 / 1.5];

/// Cell fields that may colour the fabric: name, title, and the unit of the title in that of the field.
const FABRIC: [(&str, &str, f64); 2] =
    [("pressure_jump_pa", "pressure jump, Pa", 1.0), ("stress_1_pa", "major stress, MPa", 1e-6)];

/// Arguments of `ripstop picture`.
#[derive(Args)]
pub struct PictureArgs {
    /// Results folder of a run
    run: PathBuf,
    /// Stage to draw [default: the last one with snapshots of the canopy]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Time in the stage, in seconds; draws the nearest snapshot [default: the last]
    #[arg(long, value_name = "SECONDS", value_parser = time)]
    time: Option<f64>,
    /// Folder of the pictures [default: RUN/pictures]; with --animate also a file that ends in .png
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Width of the pictures, in pixels [default: 1000; 800 with --animate]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(200..=3000))]
    width: Option<u32>,
    /// Draw one animated PNG, animation.png, of all stages (or of --stage): the canopy next to the flow
    #[arg(long, conflicts_with = "time")]
    animate: bool,
    /// Frames per second of the animation
    #[arg(long, value_name = "N", requires = "animate", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=60))]
    fps: u16,
    /// Maximum number of frames of the animation; more snapshots are thinned, coupled stages half as much as others
    #[arg(long, value_name = "N", requires = "animate", default_value_t = 48, value_parser = clap::value_parser!(u16).range(2..=1000))]
    frames: u16,
    /// Draw the flow in the diagonal plane y = x instead of the plane y = 0
    #[arg(long)]
    diagonal: bool,
}

fn time(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|t| t.is_finite()).ok_or_else(|| "expected a time in seconds".into())
}

/// Draws `canopy.png`, `flow.png` and `pre-inflation.png`, as far as the run has snapshots for them; with `--animate` an
/// animation instead.
///
/// # Errors
/// Results cannot be read, or pictures cannot be written.
pub fn picture(args: &PictureArgs, console: &Console) -> Result<(), RunError> {
    let results = RunSnapshots::open(&args.run)?;
    if args.animate {
        return animation(args, &results, console);
    }
    let width = args.width.unwrap_or(1000);
    let stage = results.stage(args.stage.as_deref())?;
    let name = &results.scene.stages[stage].name;
    let out = args.out.clone().unwrap_or_else(|| args.run.join("pictures"));
    std::fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let save = |image: Image, file: &str, what: String| -> Result<(), RunError> {
        let path = out.join(file);
        image.save(&path)?;
        console.result(&format!("{}: {what}", path.display()));
        Ok(())
    };

    let structure = results.structure(stage, args.time)?;
    if let Some((time, canopy, lines)) = &structure {
        let image = canopy_picture(canopy, lines.as_ref(), &caption(name, *time), width);
        save(image, "canopy.png", format!("canopy in stage `{name}` at t = {time} s"))?;
    }
    match flow_at(&results, stage, args.time, args.diagonal, width)? {
        Some((time, image)) => save(image, "flow.png", format!("flow in stage `{name}` at t = {time} s"))?,
        None if structure.is_none() => {
            return Err(RunError::Input(format!(
                "stage `{name}` has no snapshots to draw: run it with `ripstop run` and \
                 output.surface_every_windows or output.volume_every_windows above 0"
            )));
        }
        None => console.line(&format!("no flow.png: stage `{name}` has no snapshots of the flow (output.volume_every_windows writes them)")),
    }

    let inflation = results.scene.stages.iter().position(|s| s.kind == StageKind::PreInflation);
    if let Some(stage) = inflation
        && let Some(last) = results.structure(stage, None)?
    {
        let times = STRIP.into_iter().map(|share| Some(share * last.0));
        let mut shapes = times
            .map(|time| results.structure(stage, time))
            .filter_map(Result::transpose)
            .collect::<Result<Vec<_>, _>>()?;
        shapes.push(last);
        // A stage with few snapshots has the same one nearest to two of the times.
        shapes.dedup_by(|a, b| a.0 == b.0);
        let image = strip(&shapes, width);
        save(image, "pre-inflation.png", "shapes of the canopy during pre-inflation".into())?;
    }
    Ok(())
}

/// Writes the animation.
fn animation(args: &PictureArgs, results: &RunSnapshots, console: &Console) -> Result<(), RunError> {
    let choice = Choice {
        stage: args.stage.as_deref(),
        width: args.width.unwrap_or(800),
        frames: usize::from(args.frames),
        fps: args.fps,
        diagonal: args.diagonal,
    };
    let (bytes, frames) = animation::animate(results, &choice)?;
    let out = args.out.clone().unwrap_or_else(|| args.run.join("pictures"));
    let path = if out.extension().is_some_and(|e| e == "png") { out } else { out.join("animation.png") };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    folder.map_or(Ok(()), |f| std::fs::create_dir_all(f).map_err(RunError::file("create", f)))?;
    std::fs::write(&path, &bytes).map_err(RunError::file("write", &path))?;
    let kilobytes = bytes.len() / 1000;
    console.result(&format!("{}: {frames} frames, {} per second, {kilobytes} kB", path.display(), args.fps));
    Ok(())
}

/// Slice of the flow of a stage in the snapshot nearest to `time` (s); `None` without snapshots.
fn flow_at(
    results: &RunSnapshots,
    stage: usize,
    time: Option<f64>,
    diagonal: bool,
    width: u32,
) -> Result<Option<(f64, Image)>, RunError> {
    let Some(times) = results.times(stage, Kind::Flow)? else { return Ok(None) };
    let snapshot = times.nearest(time);
    // The canopy as it was when the flow was written, or at rest, in its last shape before.
    let canopy = match results.structure(stage, Some(snapshot.time))? {
        Some(now) => Some(now),
        None => results.last_before(stage)?,
    };
    let flow = Flow::read(results, &snapshot.files, canopy.map(|(_, canopy, _)| canopy), diagonal, None)?;
    let name = &results.scene.stages[stage].name;
    Ok(Some((snapshot.time, flow.picture(&caption(name, snapshot.time), width))))
}

/// PNG data of a picture and the time of its snapshot, s.
pub type Png = (f64, Vec<u8>);

/// Picture of the flow at `time` (s) as the bytes of a PNG file.
pub fn flow_png(
    results: &RunSnapshots,
    stage: usize,
    time: Option<f64>,
    diagonal: bool,
    width: u32,
) -> Result<Option<Png>, RunError> {
    let found = flow_at(results, stage, time, diagonal, width)?;
    Ok(found.map(|(time, image)| (time, image.png())))
}

/// The last canopy of a stage as the bytes of a PNG file; `None` without snapshots.
pub fn canopy_png(results: &RunSnapshots, stage: usize, width: u32) -> Result<Option<Png>, RunError> {
    let Some((time, canopy, lines)) = results.structure(stage, None)? else { return Ok(None) };
    let name = &results.scene.stages[stage].name;
    Ok(Some((time, canopy_picture(&canopy, lines.as_ref(), &caption(name, time), width).png())))
}

fn caption(stage: &str, time: f64) -> String {
    // Times are sums of steps: no more digits than they mean.
    format!("{}, {} s", stage.replace('_', " "), (time * 1e4).round() / 1e4)
}

/// Nodal values that colour the fabric, with their legend: pressure jump, major stress or displacement, the first that
/// varies.
fn fabric(canopy: &Piece) -> (Legend, Vec<f64>) {
    // Cables alone have no colour.
    let coloured = canopy.n_cells() > 0;
    let legend = |title: &str, values: &[f64]| Legend {
        title: if coloured { title.into() } else { String::new() },
        scale: WARM,
        range: Range::of(values.iter().copied(), 0.01),
    };
    for (name, title, unit) in FABRIC {
        let Some(column) = canopy.cell_field(name).filter(|c| c.width == 1) else { continue };
        let (mut values, _) = at_points(canopy, &column.values);
        values.iter_mut().for_each(|v| *v *= unit);
        let (low, high) =
            column.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
        if high - low > 1e-6 * high.abs().max(low.abs()) {
            return (legend(title, &values), values);
        }
    }
    let moved = displacement(canopy);
    (legend("displacement, m", &moved), moved)
}

/// Length of the displacement of each point, m; zeros where the snapshot has none.
fn displacement(canopy: &Piece) -> Vec<f64> {
    match canopy.point_field("displacement_m") {
        Some(u) => {
            u.values.as_chunks::<3>().0.iter().map(|u| u.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
        }
        None => vec![0.0; canopy.points.len()],
    }
}

fn all_points(canopy: &Piece, lines: Option<&Piece>) -> Vec<Point> {
    // Of the lines, only the points that a line holds.
    let ends = lines
        .into_iter()
        .flat_map(|l| (0..l.n_cells()).flat_map(|c| l.cell(c)).map(|&i| l.points[i as usize]));
    let mut points: Vec<Point> = canopy.points.iter().copied().chain(ends).collect();
    if let Some((top, size)) = lines.and_then(|l| view::payload_place(canopy, l)) {
        points.extend((0..8).map(|corner| view::payload_corner(top, size, corner)));
    }
    points
}

/// A canopy with its lines from the side, `width` pixels wide.
fn canopy_picture(canopy: &Piece, lines: Option<&Piece>, caption: &str, width: u32) -> Image {
    let w = f64::from(width);
    let mut raster = Raster::new(width, (0.95 * w) as u32);
    let [_, h] = raster.size();
    let view = View::fit(&all_points(canopy, lines), EYE, [0.04 * w, 0.03 * w], [0.92 * w, h - 0.06 * w]);
    let (legend, values) = fabric(canopy);
    draw_body(&mut raster, &view, &Body { canopy, lines, values: &values }, &legend, (0.0016 * w).max(0.7));
    let mut samples = raster.finish();
    let area = samples.area();
    let (sheet, text) = (Sheet(&area), 0.02 * w);
    legend
        .draw(&sheet, [0.04 * w, h - 0.075 * w], [0.3 * w, 0.018 * w], text)
        .and_then(|()| sheet.text(caption, [0.96 * w, h - 0.05 * w], text, Anchor::Right, INK))
        .expect(IN_MEMORY);
    drop(area);
    samples.average()
}

/// Shapes in a row with their times, with common scales of colours and lengths.
fn strip(shapes: &[Structure], width: u32) -> Image {
    let w = f64::from(width);
    let n = shapes.len().max(1) as f64;
    let mut raster = Raster::new(width, (0.46 * w) as u32);
    let [_, h] = raster.size();
    let frame = w / n;
    let points: Vec<Point> = shapes.iter().flat_map(|(_, c, l)| all_points(c, l.as_ref())).collect();
    let coloured: Vec<_> = shapes.iter().map(|(_, canopy, _)| fabric(canopy)).collect();
    let Some((first, _)) = coloured.last() else { return raster.finish().average() };
    // One scale for all: that of the last shape.
    let legend = first.clone();
    for (i, ((_, canopy, lines), (_, values))) in shapes.iter().zip(&coloured).enumerate() {
        let corner = [(i as f64 + 0.05) * frame, 0.035 * w];
        let view = View::fit(&points, EYE, corner, [0.9 * frame, h - 0.135 * w]);
        let body = Body { canopy, lines: lines.as_ref(), values };
        draw_body(&mut raster, &view, &body, &legend, (0.001 * w).max(0.6));
    }
    let mut samples = raster.finish();
    let area = samples.area();
    let (sheet, text) = (Sheet(&area), 0.019 * w);
    let labels = shapes.iter().enumerate().try_for_each(|(i, (time, ..))| {
        let middle = (i as f64 + 0.5) * frame;
        sheet.text(&format!("{time:.2} s"), [middle, 0.023 * w], text, Anchor::Middle, INK)
    });
    labels
        .and_then(|()| legend.draw(&sheet, [0.35 * w, h - 0.05 * w], [0.3 * w, 0.016 * w], text))
        .expect(IN_MEMORY);
    drop(area);
    samples.average()
}
