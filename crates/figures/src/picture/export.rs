//! `ripstop export animation`: the canopy of a stage over time, as a GIF or a sequence of PNG files.

use std::fs::File;
use std::io::{BufWriter, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use coupling::error::RunError;
use mesh::Point;
use mesh::vtk::read::{Piece, Snapshot};
use terminal::{Console, counted};

use super::legend::{Legend, Range};
use super::raster::Raster;
use super::view::{Body, View, at_points, draw as draw_body};
use super::{EYE, FABRIC, IN_MEMORY, all_points, displacement};
use crate::colour::{INK, WARM};
use crate::gif_file::GifFile;
use crate::pixels::Image;
use crate::sheet::{Anchor, Sheet};
use crate::snapshots::{Interval, Kind, RunSnapshots, Structure};

/// Time between lines of progress.
const PROGRESS: Duration = Duration::from_secs(5);
/// Frames whose colours make the palette of a GIF, at most.
const PALETTE_FRAMES: usize = 12;
/// Values of a snapshot that decide on the range of the colours, at most.
const SAMPLES: usize = 400;
/// Height of a picture over its width.
const ASPECT: f64 = 0.95;

/// Format of an animation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// One animated GIF
    Gif,
    /// A folder of numbered PNG files, for programs that make videos
    Png,
}

/// Arguments of `ripstop export animation`.
#[derive(Args)]
pub struct AnimationArgs {
    /// Results folder of a run; it may be running or interrupted
    run: PathBuf,
    /// Stage to draw [default: the last one with snapshots of the canopy]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Format
    #[arg(long, value_enum, default_value_t = Format::Gif)]
    format: Format,
    /// Direction of view: side, front, top, bottom, or azimuth and elevation of the eye in degrees, such as 30,-20
    #[arg(long, value_name = "VIEW", default_value = "side", allow_hyphen_values = true, value_parser = eye)]
    view: Eye,
    /// Field that colours the fabric; of a vector its length [default: pressure jump, major stress or displacement,
    /// the first that varies]
    #[arg(long, value_name = "NAME")]
    field: Option<String>,
    #[command(flatten)]
    interval: Interval,
    /// Frames per second; a GIF keeps them to hundredths of a second a frame
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=50))]
    fps: u16,
    /// Width and height of a frame, in pixels, such as 1280x720; of a width alone the height follows
    #[arg(long, value_name = "WIDTH[xHEIGHT]", default_value = "800", value_parser = size)]
    size: Size,
    /// The GIF file, or the folder of PNG files [default: RUN/export/STAGE-canopy.gif, RUN/export/STAGE-canopy]
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// Azimuth (from x towards y) and elevation of the eye, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Eye([f64; 2]);

fn eye(text: &str) -> Result<Eye, String> {
    let named = match text {
        "side" => Some(EYE),
        "front" => Some([0.0, 0.0]),
        "top" => Some([0.0, 90.0]),
        "bottom" => Some([0.0, -90.0]),
        _ => text.split_once(',').and_then(|(a, e)| Some([a.trim().parse().ok()?, e.trim().parse().ok()?])),
    };
    named.filter(|[a, e]| a.abs() <= 360.0 && e.abs() <= 90.0).map(Eye).ok_or_else(|| {
        "expected side, front, top, bottom, or azimuth and elevation in degrees (at most 360 and 90), such as 30,-20"
            .into()
    })
}

/// Width and height, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Size([u32; 2]);

fn size(text: &str) -> Result<Size, String> {
    let numbers = match text.split_once('x') {
        Some((width, height)) => width.parse().ok().zip(height.parse().ok()),
        None => text.parse().ok().map(|w: u32| (w, (ASPECT * f64::from(w)) as u32)),
    };
    let fits = |n: &u32| (100..=3000).contains(n);
    numbers
        .filter(|(w, h)| fits(w) && fits(h))
        .map(|(w, h)| Size([w, h]))
        .ok_or_else(|| "expected pixels from 100 to 3000, such as 800 or 1280x720".into())
}

/// Draws the animation.
///
/// # Errors
/// The run has no snapshots of the canopy, or no such field; snapshots that cannot be read; files that cannot be written.
pub fn export_animation(args: &AnimationArgs, console: &Console) -> Result<(), RunError> {
    let run = RunSnapshots::open(&args.run)?;
    let (stage, times) = run.series(args.stage.as_deref(), Kind::Canopy)?;
    let snapshots = args.interval.choose(&times)?;
    let name = &run.scene.stages[stage].name;
    let file = match args.format {
        Format::Gif => format!("{name}-canopy.gif"),
        Format::Png => format!("{name}-canopy"),
    };
    let out = args.out.clone().unwrap_or_else(|| args.run.join("export").join(file));
    may_be_replaced(&out, args.format)?;
    console.line(&format!("stage `{name}`: {} of the canopy", counted(snapshots.len() as u64, "snapshot")));
    let frames = Frames::measure(&run, stage, &snapshots, args)?;
    match args.format {
        Format::Gif => gif(&frames, &out, args.fps, console),
        Format::Png => png(&frames, &out, console),
    }
}

/// Refuses to replace what no animation is.
fn may_be_replaced(out: &Path, format: Format) -> Result<(), RunError> {
    let wrong = match format {
        Format::Gif => {
            let mut begin = [0; 4];
            let read = File::open(out).and_then(|mut f| f.read_exact(&mut begin));
            out.exists() && !(read.is_ok() && &begin == b"GIF8")
        }
        Format::Png => out.exists() && !out.is_dir(),
    };
    let what = if format == Format::Gif { "GIF file" } else { "folder" };
    if wrong {
        return Err(RunError::Input(format!(
            "{} exists and is no {what}: it is not replaced. Name another with --out, or remove it",
            out.display()
        )));
    }
    Ok(())
}

/// The frames of an animation, and what they have in common. Snapshots are read when they are drawn, so that the memory
/// does not grow with their number.
struct Frames<'a> {
    run: &'a RunSnapshots,
    stage: usize,
    snapshots: &'a [Snapshot],
    field: Option<&'a str>,
    size: [u32; 2],
    view: View,
    legend: Legend,
    /// Decimal places of the times.
    places: usize,
}

impl<'a> Frames<'a> {
    /// Reads all snapshots for the extent of the canopy and of the values.
    fn measure(
        run: &'a RunSnapshots,
        stage: usize,
        snapshots: &'a [Snapshot],
        args: &'a AnimationArgs,
    ) -> Result<Self, RunError> {
        let mut outline = Vec::new();
        let mut fields = candidates(args.field.as_deref());
        for snapshot in snapshots {
            let (_, canopy, lines) = structure(run, stage, snapshot)?;
            outline.extend(extreme_points(&all_points(&canopy, lines.as_ref())));
            for field in &mut fields {
                field.sample(&canopy);
            }
            if let (Some(name), false) = (&args.field, fields[0].everywhere) {
                return Err(unknown_field(name, &canopy));
            }
        }
        let varies = |f: &Candidate| f.everywhere && f.varies();
        let last = fields.len() - 1;
        let chosen = fields.iter().position(varies).unwrap_or(last);
        let field = fields.swap_remove(chosen);
        let Size([width, height]) = args.size;
        let (w, h) = (f64::from(width), f64::from(height));
        let text = text_size(w);
        let corner = [2.0 * text, 2.6 * text];
        let view = View::fit(&outline, args.view.0, corner, [w - 4.0 * text, (h - 7.2 * text).max(0.3 * h)]);
        let range = Range::of(field.samples.iter().copied(), 0.01);
        // Values of one sign begin at zero.
        let range = if range.low > 0.0 { Range { low: 0.0, ..range } } else { range };
        Ok(Self {
            run,
            stage,
            snapshots,
            field: field.name,
            size: [width, height],
            view,
            legend: Legend { title: field.title, scale: WARM, range },
            places: places(snapshots),
        })
    }

    fn len(&self) -> usize {
        self.snapshots.len()
    }

    /// Draws a frame.
    fn image(&self, frame: usize) -> Result<Image, RunError> {
        let (time, canopy, lines) = structure(self.run, self.stage, &self.snapshots[frame])?;
        let [w, h] = self.size.map(f64::from);
        let values = values(&canopy, self.field).unwrap_or_else(|| vec![0.0; canopy.points.len()]);
        let scaled: Vec<f64> = values.iter().map(|v| v * unit(self.field)).collect();
        let mut raster = Raster::new(self.size[0], self.size[1]);
        let body = Body { canopy: &canopy, lines: lines.as_ref(), values: &scaled };
        draw_body(&mut raster, &self.view, &body, &self.legend, (0.0018 * w).max(0.7));
        let mut samples = raster.finish();
        let area = samples.area();
        let (sheet, text) = (Sheet(&area), text_size(w));
        let stage = self.run.scene.stages[self.stage].name.replace('_', " ");
        let label = format!("t = {time:.*} s", self.places);
        let bar = [0.4 * w, 0.9 * text];
        self.legend
            .draw(&sheet, [2.0 * text, h - 2.6 * text], bar, text)
            .and_then(|()| sheet.text(&stage, [2.0 * text, 1.4 * text], 1.15 * text, Anchor::Left, INK))
            .and_then(|()| sheet.text(&label, [w - 2.0 * text, 1.4 * text], 1.15 * text, Anchor::Right, INK))
            .expect(IN_MEMORY);
        drop(area);
        Ok(samples.average())
    }
}

/// Em of the text, pixels.
fn text_size(width: f64) -> f64 {
    (0.02 * width).max(9.0)
}

/// Canopy and lines of a snapshot.
fn structure(run: &RunSnapshots, stage: usize, snapshot: &Snapshot) -> Result<Structure, RunError> {
    let found = run.structure(stage, Some(snapshot.time))?;
    found.ok_or_else(|| run.none("canopy.pvd", "surface_every_windows"))
}

/// Factor from the unit of a field to that of its title.
fn unit(field: Option<&str>) -> f64 {
    FABRIC.iter().find(|(name, ..)| Some(*name) == field).map_or(1.0, |(.., unit)| *unit)
}

/// Values of a field at the points, a vector by its length; `None`: the displacement.
fn values(canopy: &Piece, field: Option<&str>) -> Option<Vec<f64>> {
    let Some(name) = field else { return Some(displacement(canopy)) };
    let lengths = |values: &[f64], width: usize| -> Vec<f64> {
        if width == 1 {
            return values.to_vec();
        }
        values.chunks_exact(width).map(|v| v.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
    };
    if let Some(column) = canopy.point_field(name) {
        return Some(lengths(&column.values, column.width));
    }
    let column = canopy.cell_field(name)?;
    Some(at_points(canopy, &lengths(&column.values, column.width)).0)
}

/// A field that may colour the fabric.
struct Candidate<'a> {
    /// `None`: the displacement.
    name: Option<&'a str>,
    title: String,
    /// Whether all snapshots so far have it.
    everywhere: bool,
    /// Values of all snapshots, thinned; with the smallest and the largest one of each.
    samples: Vec<f64>,
}

/// The field that was asked for, or those of which the first that varies is taken.
fn candidates(field: Option<&str>) -> Vec<Candidate<'_>> {
    let new =
        |name, title: &str| Candidate { name, title: title.into(), everywhere: true, samples: Vec::new() };
    let title = |name: &str| FABRIC.iter().find(|(n, ..)| *n == name).map_or(name.to_owned(), |f| f.1.into());
    match field {
        Some(name) => vec![new(Some(name), &title(name))],
        None => FABRIC
            .iter()
            .map(|(name, title, _)| new(Some(name), title))
            .chain([new(None, "displacement, m")])
            .collect(),
    }
}

impl Candidate<'_> {
    fn sample(&mut self, canopy: &Piece) {
        let Some(mut found) = values(canopy, self.name) else {
            self.everywhere = false;
            return;
        };
        found.sort_unstable_by(f64::total_cmp);
        let step = found.len().div_ceil(SAMPLES).max(1);
        let some = found.iter().step_by(step).chain(found.last());
        self.samples.extend(some.map(|v| v * unit(self.name)));
    }

    fn varies(&self) -> bool {
        let all = || self.samples.iter().copied();
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        high - low > 1e-6 * high.abs().max(low.abs())
    }
}

fn unknown_field(name: &str, canopy: &Piece) -> RunError {
    let names: Vec<&str> =
        canopy.point_fields.iter().chain(&canopy.cell_fields).map(|c| c.name.as_str()).collect();
    RunError::Input(format!(
        "--field: a snapshot of the canopy has no field `{name}`. It has {}",
        names.join(", ")
    ))
}

/// Points that no other lies beyond, in 26 directions: enough to fit a view around all.
fn extreme_points(points: &[Point]) -> Vec<Point> {
    let directions = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|c| f64::from(c) - 1.0));
    directions
        .filter_map(|d| {
            let along = |p: &Point| (0..3).map(|c| d[c] * p[c]).sum::<f64>();
            points.iter().max_by(|a, b| along(a).total_cmp(&along(b))).copied()
        })
        .collect()
}

/// Decimal places that the times need, at most 6.
fn places(snapshots: &[Snapshot]) -> usize {
    let exact = |places: &usize| {
        let scale = 10_f64.powi(*places as i32);
        snapshots.iter().all(|s| ((s.time * scale).round() / scale - s.time).abs() < 1e-7)
    };
    (1..6).find(exact).unwrap_or(6)
}

/// Calls `each` with each frame, and reports the progress.
fn draw(
    frames: &Frames<'_>,
    console: &Console,
    mut each: impl FnMut(usize, Image) -> Result<(), RunError>,
) -> Result<(), RunError> {
    let mut shown = Instant::now();
    for k in 0..frames.len() {
        each(k, frames.image(k)?)?;
        if shown.elapsed() > PROGRESS {
            console.line(&format!("{} of {} frames", k + 1, frames.len()));
            shown = Instant::now();
        }
    }
    Ok(())
}

fn gif(frames: &Frames<'_>, path: &Path, fps: u16, console: &Console) -> Result<(), RunError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    folder.map_or(Ok(()), |f| std::fs::create_dir_all(f).map_err(RunError::file("create", f)))?;
    let n = frames.len();
    let some = n.min(PALETTE_FRAMES);
    let some = (0..some).map(|k| frames.image(k * (n - 1) / (some - 1).max(1)));
    let some = some.collect::<Result<Vec<_>, _>>()?;
    let failed = |error: gif::EncodingError| RunError::file("write", path)(std::io::Error::other(error));
    // The file appears under its name once it is complete.
    let mut unfinished = path.as_os_str().to_os_string();
    unfinished.push(".part");
    let unfinished = PathBuf::from(unfinished);
    let out = File::create(&unfinished).map_err(RunError::file("write", &unfinished))?;
    let written = GifFile::new(BufWriter::new(out), &some, fps).map_err(failed).and_then(|mut file| {
        draw(frames, console, |_, image| file.add(&image).map_err(failed))?;
        file.finish().map_err(failed)
    });
    written.inspect_err(|_| drop(std::fs::remove_file(&unfinished)))?;
    std::fs::rename(&unfinished, path).map_err(RunError::file("write", path))?;
    let kilobytes = std::fs::metadata(path).map_or(0, |m| m.len()).div_ceil(1000);
    let count = counted(n as u64, "frame");
    console.line(&format!("{}: {count}, {fps} per second, {kilobytes} kB", path.display()));
    Ok(())
}

/// Name of a frame of a sequence.
fn frame_name(k: usize) -> String {
    format!("frame_{k:05}.png")
}

fn png(frames: &Frames<'_>, folder: &Path, console: &Console) -> Result<(), RunError> {
    std::fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    draw(frames, console, |k, image| image.save(&folder.join(frame_name(k))))?;
    // Frames of a longer sequence before.
    let rest = (frames.len()..).map(|k| folder.join(frame_name(k))).take_while(|path| path.is_file());
    for path in rest {
        std::fs::remove_file(&path).map_err(RunError::file("remove", &path))?;
    }
    let count = counted(frames.len() as u64, "frame");
    console.line(&format!(
        "{}: {count}, {} to {}",
        folder.display(),
        frame_name(0),
        frame_name(frames.len() - 1)
    ));
    Ok(())
}
