//! `ripstop picture`: the canopy and the flow around it, as PNG.

pub mod canvas;
mod colour;
mod raster;
pub mod results;
mod slice;
mod text;
mod view;

use std::path::PathBuf;

use case::StageKind;
use clap::Args;
use coupling::error::RunError;
use mesh::Vec3;
use mesh::vtk::read::Piece;
use terminal::Console;
use tiny_skia::{PathBuilder, Pixmap, Rect, Stroke, Transform};

use self::colour::{COOL, INK, Legend, PAPER, Range, WARM};
use self::raster::{Place, Raster};
use self::results::{Kind, Results, Structure, field};
use self::slice::{Patch, Plane};
use self::view::{Body, View, at_points, bounds};

/// Where the eye of the canopy pictures stands: azimuth and elevation, degrees.
const EYE: [f64; 2] = [28.0, -14.0];
/// Times of the paper's figure 4 before that of the last shape, as shares of it (0.2, 0.4 and 0.8 of 1.5 s).
const STRIP: [f64; 3] = [0.2 / 1.5, 0.4 / 1.5, 0.8 / 1.5];

/// What to draw.
#[derive(Args)]
pub struct PictureArgs {
    /// Folder of the results of a run
    run: PathBuf,
    /// Stage to draw [default: the last one with snapshots of the canopy]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Time in the stage, in seconds; the nearest snapshot is drawn [default: the last]
    #[arg(long, value_name = "SECONDS", value_parser = time)]
    time: Option<f64>,
    /// Folder of the pictures [default: RUN/pictures]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Width of the pictures, in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(200..=3000))]
    width: u32,
    /// Cut the flow from corner to corner (plane y = x) instead of across (plane y = 0)
    #[arg(long)]
    diagonal: bool,
}

fn time(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|t| t.is_finite()).ok_or_else(|| "a time in seconds".into())
}

/// Draws `canopy.png`, `flow.png` and `pre-inflation.png`, whichever the run has
/// snapshots for.
///
/// # Errors
/// Results that cannot be read, pictures that cannot be written.
pub fn picture(args: &PictureArgs, console: &Console) -> Result<(), RunError> {
    let results = Results::open(&args.run)?;
    let stage = results.stage(args.stage.as_deref())?;
    let name = &results.scene.stages[stage].name;
    let out = args.out.clone().unwrap_or_else(|| args.run.join("pictures"));
    std::fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let save = |pixmap: Pixmap, file: &str, what: String| -> Result<(), RunError> {
        let path = out.join(file);
        let error = |e: String| RunError::File {
            action: "write",
            path: path.clone(),
            source: std::io::Error::other(e),
        };
        let bytes = png(&pixmap).map_err(|e| error(e.to_string()))?;
        std::fs::write(&path, bytes).map_err(|e| error(e.to_string()))?;
        console.line(&format!("{}: {what}", path.display()));
        Ok(())
    };

    let structure = results.structure(stage, args.time)?;
    if let Some((time, canopy, lines)) = &structure {
        let pixmap = canopy_picture(canopy, lines.as_ref(), &caption(name, *time), args.width);
        save(pixmap, "canopy.png", format!("the canopy, stage `{name}`, {time} s"))?;
    }
    match flow_at(&results, stage, args.time, args.diagonal, args.width)? {
        Some((time, pixmap)) => save(pixmap, "flow.png", format!("the flow, stage `{name}`, {time} s"))?,
        None if structure.is_none() => {
            return Err(RunError::Input(format!(
                "stage `{name}` has no snapshots to draw: run it with `ripstop run` and \
                 output.surface_every_windows or output.volume_every_windows above 0"
            )));
        }
        None => console.line(&format!("no flow.png: stage `{name}` wrote no snapshots of a flow")),
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
        let pixmap = strip(&shapes, args.width);
        save(pixmap, "pre-inflation.png", "how the canopy inflates".into())?;
    }
    Ok(())
}

/// The flow of a stage in the snapshot nearest to `time` (s), in a vertical cut; `None` where the stage
/// wrote none.
fn flow_at(
    results: &Results,
    stage: usize,
    time: Option<f64>,
    diagonal: bool,
    width: u32,
) -> Result<Option<(f64, Pixmap)>, RunError> {
    let Some(times) = results.times(stage, Kind::Flow)? else { return Ok(None) };
    let snapshot = times.nearest(time);
    // The canopy as it was when the flow was written, or at rest, in its last shape before.
    let canopy = match results.structure(stage, Some(snapshot.time))? {
        Some(now) => Some(now),
        None => results.last_before(stage)?,
    };
    let flow = Flow::read(results, &snapshot.files, canopy.map(|(_, canopy, _)| canopy), diagonal)?;
    let name = &results.scene.stages[stage].name;
    Ok(Some((snapshot.time, flow.picture(&caption(name, snapshot.time), width))))
}

/// A picture's bytes with the time of its snapshot, s.
pub type Png = (f64, Vec<u8>);

fn encoded(time: f64, pixmap: &Pixmap) -> Result<Png, RunError> {
    png(pixmap).map(|bytes| (time, bytes)).map_err(|e| RunError::Input(format!("a picture: {e}")))
}

/// [`flow_at`] as the bytes of a PNG file.
pub fn flow_png(
    results: &Results,
    stage: usize,
    time: Option<f64>,
    diagonal: bool,
    width: u32,
) -> Result<Option<Png>, RunError> {
    let found = flow_at(results, stage, time, diagonal, width)?;
    found.map(|(time, pixmap)| encoded(time, &pixmap)).transpose()
}

/// The last canopy of a stage as the bytes of a PNG file; `None` where the stage wrote none.
pub fn canopy_png(results: &Results, stage: usize, width: u32) -> Result<Option<Png>, RunError> {
    let Some((time, canopy, lines)) = results.structure(stage, None)? else { return Ok(None) };
    let name = &results.scene.stages[stage].name;
    encoded(time, &canopy_picture(&canopy, lines.as_ref(), &caption(name, time), width)).map(Some)
}

fn caption(stage: &str, time: f64) -> String {
    // Times are sums of steps: no more digits than they mean.
    format!("{}, {} s", stage.replace('_', " "), (time * 1e4).round() / 1e4)
}

/// The file's bytes, without transparency; a third of what tiny-skia's own make.
fn png(pixmap: &Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixmap.width(), pixmap.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Best);
    encoder.set_adaptive_filter(png::AdaptiveFilterType::Adaptive);
    let rgb: Vec<u8> = pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&rgb)?;
    writer.finish()?;
    Ok(bytes)
}

/// Finished pixels; widths are at least 200, so there are some.
fn pixels(raster: &Raster) -> Pixmap {
    raster.finish().expect("a picture has pixels")
}

/// What colours the fabric: the first of pressure jump and major stress that
/// varies, or the displacement. The values are the points'.
fn fabric(canopy: &Piece) -> (Legend, Vec<f64>) {
    let legend = |title: &str, values: &[f64]| Legend {
        title: title.into(),
        scale: WARM,
        range: Range::of(values.iter().copied(), 0.01),
    };
    for (name, title, unit) in
        [("pressure_jump_pa", "pressure jump, Pa", 1.0), ("stress_1_pa", "major stress, MPa", 1e-6)]
    {
        let Some(column) = canopy.cell_field(name).filter(|c| c.width == 1) else { continue };
        let (mut values, _) = at_points(canopy, &column.values);
        values.iter_mut().for_each(|v| *v *= unit);
        let (low, high) =
            column.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
        if high - low > 1e-6 * high.abs().max(low.abs()) {
            return (legend(title, &values), values);
        }
    }
    let moved: Vec<f64> = match canopy.point_field("displacement_m") {
        Some(u) => {
            u.values.as_chunks::<3>().0.iter().map(|u| u.iter().map(|x| x * x).sum::<f64>().sqrt()).collect()
        }
        None => vec![0.0; canopy.points.len()],
    };
    (legend("displacement, m", &moved), moved)
}

fn all_points(canopy: &Piece, lines: Option<&Piece>) -> Vec<Vec3> {
    // Of the lines, only the points that a line holds.
    let ends = lines
        .into_iter()
        .flat_map(|l| (0..l.n_cells()).flat_map(|c| l.cell(c)).map(|&i| l.points[i as usize]));
    let mut points: Vec<Vec3> = canopy.points.iter().copied().chain(ends).collect();
    if let Some((top, size)) = lines.and_then(|l| view::payload_place(canopy, l)) {
        points.extend((0..8).map(|corner| view::payload_corner(top, size, corner)));
    }
    points
}

fn canopy_picture(canopy: &Piece, lines: Option<&Piece>, caption: &str, width: u32) -> Pixmap {
    let w = f64::from(width);
    let mut raster = Raster::new(width, (0.95 * w) as u32, PAPER);
    let [_, h] = raster.size();
    let view = View::fit(&all_points(canopy, lines), EYE, [0.04 * w, 0.03 * w], [0.92 * w, h - 0.06 * w]);
    let (legend, values) = fabric(canopy);
    view::draw(&mut raster, &view, &Body { canopy, lines, values: &values }, &legend, (0.0016 * w).max(0.7));
    let mut pixmap = pixels(&raster);
    let (w, h) = (w as f32, h as f32);
    legend.draw(&mut pixmap, [0.04 * w, h - 0.075 * w], [0.3 * w, 0.018 * w], 0.016 * w);
    let size = 0.016 * w;
    let left = 0.96 * w - text::width(caption, size);
    text::write(&mut pixmap, caption, [left, h - 0.045 * w], size, INK);
    pixmap
}

fn strip(shapes: &[Structure], width: u32) -> Pixmap {
    let w = f64::from(width);
    let n = shapes.len().max(1) as f64;
    let mut raster = Raster::new(width, (0.46 * w) as u32, PAPER);
    let [_, h] = raster.size();
    let frame = w / n;
    let points: Vec<Vec3> = shapes.iter().flat_map(|(_, c, l)| all_points(c, l.as_ref())).collect();
    let coloured: Vec<_> = shapes.iter().map(|(_, canopy, _)| fabric(canopy)).collect();
    let Some((first, _)) = coloured.last() else { return pixels(&raster) };
    // One scale for all: that of the last shape.
    let legend = first.clone();
    for (i, ((_, canopy, lines), (_, values))) in shapes.iter().zip(&coloured).enumerate() {
        let corner = [(i as f64 + 0.05) * frame, 0.035 * w];
        let view = View::fit(&points, EYE, corner, [0.9 * frame, h - 0.135 * w]);
        let body = Body { canopy, lines: lines.as_ref(), values };
        view::draw(&mut raster, &view, &body, &legend, (0.001 * w).max(0.6));
    }
    let mut pixmap = pixels(&raster);
    let (w, h, size) = (w as f32, h as f32, 0.015 * w as f32);
    for (i, (time, ..)) in shapes.iter().enumerate() {
        let label = format!("{time:.2} s");
        let middle = (i as f32 + 0.5) * frame as f32;
        text::write(&mut pixmap, &label, [middle - 0.5 * text::width(&label, size), 0.03 * w], size, INK);
    }
    legend.draw(&mut pixmap, [0.35 * w, h - 0.05 * w], [0.3 * w, 0.016 * w], size);
    pixmap
}

/// The cut through a flow, and the part of it that is shown.
struct Flow {
    patches: Vec<Patch>,
    canopy: Vec<[[f64; 2]; 2]>,
    /// Lower left and upper right corner, m.
    window: [[f64; 2]; 2],
}

impl Flow {
    fn read(
        results: &Results,
        files: &[PathBuf],
        canopy: Option<Piece>,
        diagonal: bool,
    ) -> Result<Self, RunError> {
        let pieces = files.iter().map(|f| results.piece(f)).collect::<Result<Vec<_>, _>>()?;
        // A few canopy widths around the canopy, or everything where there is none.
        let around = match &canopy {
            Some(canopy) => bounds(canopy.points.iter().copied()),
            None => bounds(pieces.iter().flat_map(|p| p.points.iter().copied())),
        };
        let [low, high] = around;
        let size = (high[0] - low[0]).max(high[1] - low[1]);
        let plane = Plane::new(diagonal, size);
        let mut patches = Vec::new();
        for (piece, file) in pieces.iter().zip(files) {
            let velocity = field(piece, "velocity_frame_m_s", 3, file)?;
            patches.extend(plane.patches(piece, &velocity.values));
        }
        let middle = plane.flat([0, 1, 2].map(|c| 0.5 * (low[c] + high[c])));
        let window = if canopy.is_some() {
            [
                [middle[0] - 1.75 * size, low[2] - 0.95 * size],
                [middle[0] + 1.75 * size, high[2] + 1.25 * size],
            ]
        } else {
            let ends = patches.iter().flat_map(|p| &p.outline).map(|p| [p[0], 0.0, p[1]]);
            bounds(ends).map(|p| [p[0], p[2]])
        };
        let canopy = canopy.map(|c| plane.lines(&c)).unwrap_or_default();
        // A large cell may cover a corner of the window and have none of its own in it.
        patches.retain(|patch| {
            let [low, high] = bounds(patch.outline.iter().map(|p| [p[0], 0.0, p[1]]));
            low[0] < window[1][0] && high[0] > window[0][0] && low[2] < window[1][1] && high[2] > window[0][1]
        });
        if patches.is_empty() {
            return Err(RunError::Input(
                "the cut meets no cell of the flow: try it without --diagonal".into(),
            ));
        }
        Ok(Self { patches, canopy, window })
    }

    fn picture(&self, caption: &str, width: u32) -> Pixmap {
        let w = f64::from(width);
        let [low, high] = self.window;
        let scale = w / (high[0] - low[0]).max(1e-9);
        let field_height = (scale * (high[1] - low[1])).clamp(0.2 * w, 2.0 * w).round();
        let mut raster = Raster::new(width, (field_height + 0.085 * w) as u32, PAPER);
        let place = |p: [f64; 2]| -> Place { [scale * (p[0] - low[0]), scale * (high[1] - p[1]), 0.0] };
        let fastest = Range::of(self.patches.iter().map(|p| p.speed), 0.002).high;
        let legend = Legend {
            title: "speed relative to the canopy, m/s".into(),
            scale: COOL,
            range: Range { low: 0.0, high: fastest.max(1e-9) },
        };
        for patch in &self.patches {
            let corners: Vec<Place> = patch.outline.iter().map(|&p| place(p)).collect();
            raster.polygon(&corners, legend.colour(patch.speed));
        }
        let pen = (0.004 * w).max(1.5);
        for wider in [true, false] {
            let (colour, pen) = if wider { (PAPER, 1.9 * pen) } else { (INK, pen) };
            for line in &self.canopy {
                raster.line(line.map(place), pen, colour);
            }
        }
        let mut pixmap = pixels(&raster);
        self.arrows(&mut pixmap, place, w as f32, legend.range.high);
        let (w, h) = (w as f32, field_height as f32);
        if let Some(rest) = Rect::from_xywh(0.0, h, w, 0.085 * w) {
            pixmap.fill_rect(rest, &text::paint(PAPER), Transform::identity(), None);
        }
        let size = 0.016 * w;
        legend.draw(&mut pixmap, [0.03 * w, h + 0.032 * w], [0.42 * w, 0.018 * w], size);
        let left = 0.97 * w - text::width(caption, size);
        text::write(&mut pixmap, caption, [left, h + 0.05 * w], size, INK);
        pixmap
    }

    /// The velocity in the plane, on a lattice: as long as the spacing at `fastest`.
    fn arrows(&self, pixmap: &mut Pixmap, place: impl Fn([f64; 2]) -> Place, w: f32, fastest: f64) {
        let [low, high] = self.window;
        let columns = 36;
        let spacing = (high[0] - low[0]) / f64::from(columns);
        let rows = ((high[1] - low[1]) / spacing) as usize;
        let mut pen = PathBuilder::new();
        for i in 0..columns as usize * rows {
            let (row, column) = (i / columns as usize, i % columns as usize);
            let at = [low[0] + (column as f64 + 0.5) * spacing, low[1] + (row as f64 + 0.5) * spacing];
            let Some(patch) = self.patches.iter().find(|p| p.contains(at)) else { continue };
            let v = patch.velocity.map(|v| 0.85 * spacing * v / fastest.max(1e-9));
            let length = v[0].hypot(v[1]);
            if length < 0.06 * spacing {
                continue;
            }
            let tail = place([at[0] - 0.5 * v[0], at[1] - 0.5 * v[1]]).map(|x| x as f32);
            let tip = place([at[0] + 0.5 * v[0], at[1] + 0.5 * v[1]]).map(|x| x as f32);
            let along = [tip[0] - tail[0], tip[1] - tail[1]];
            let wing = |side: f32| {
                [
                    tip[0] - 0.3 * along[0] - side * 0.18 * along[1],
                    tip[1] - 0.3 * along[1] + side * 0.18 * along[0],
                ]
            };
            pen.move_to(tail[0], tail[1]);
            pen.line_to(tip[0], tip[1]);
            let (left, right) = (wing(1.0), wing(-1.0));
            pen.move_to(left[0], left[1]);
            pen.line_to(tip[0], tip[1]);
            pen.line_to(right[0], right[1]);
        }
        let Some(path) = pen.finish() else { return };
        let mut paint = text::paint(PAPER);
        paint.set_color_rgba8(255, 255, 255, 190);
        let stroke = Stroke { width: (0.0011 * w).max(0.8), ..Stroke::default() };
        pixmap.stroke_path(&path, &paint, &stroke, Transform::identity(), None);
    }
}

#[cfg(test)]
mod tests;
