//! `ripstop picture --animate`: canopy and flow side by side over the time of a run, as an animated PNG.

use case::StageKind;
use coupling::error::RunError;
use mesh::Point;
use mesh::vtk::read::Piece;
use results::history;

use super::flow::{self, Flow, Look, Window};
use super::legend::{Legend, Range};
use super::raster::Raster;
use super::view::{Body, View, at_points, bounds};
use super::{EYE, FABRIC, IN_MEMORY, all_points, displacement, draw_body};
use crate::animated_png;
use crate::colour::{INK, PAPER, WARM};
use crate::pixels::{Image, Samples};
use crate::sheet::{Anchor, Sheet};
use crate::snapshots::{Kind, RunSnapshots};

/// What an animation shows.
pub(super) struct Choice<'a> {
    /// One stage, or all.
    pub(super) stage: Option<&'a str>,
    /// Pixels.
    pub(super) width: u32,
    /// Most frames.
    pub(super) frames: usize,
    /// Frames a second.
    pub(super) fps: u16,
    pub(super) diagonal: bool,
}

/// One frame before it is drawn.
struct Frame {
    stage: usize,
    /// Time in the stage, s.
    time: f64,
    canopy: Piece,
    lines: Option<Piece>,
    cut: Flow,
    /// Descent speed, m/s, and the distance fallen since the release, m.
    fall: Option<[f64; 2]>,
    /// Whether the cut has a flow, and whether the canopy falls in it.
    flow: bool,
    falls: bool,
}

/// Bytes of the animation, and its number of frames.
///
/// # Errors
/// Results without snapshots of the canopy, or that cannot be read.
pub(super) fn animate(results: &RunSnapshots, choice: &Choice<'_>) -> Result<(Vec<u8>, usize), RunError> {
    let frames = frames(results, choice)?;
    let images = draw(results, &frames, choice);
    Ok((animated_png::encode(&images, choice.fps), images.len()))
}

/// Stage and time of each frame: the times of the canopy, or of the flow where the canopy is at rest. Where there are
/// more than the animation is to have, a stage gets its share, a coupled stage twice that, thinned evenly.
fn moments(results: &RunSnapshots, choice: &Choice<'_>) -> Result<Vec<(usize, f64)>, RunError> {
    let stages = match choice.stage {
        Some(name) => vec![results.stage(Some(name))?],
        None => (0..results.scene.stages.len()).collect(),
    };
    let mut all = Vec::new();
    for stage in stages {
        let times = match results.times(stage, Kind::Canopy)? {
            Some(times) => Some(times),
            None => results.times(stage, Kind::Flow)?,
        };
        let Some(times) = times else { continue };
        let times: Vec<f64> = times.all().iter().map(|snapshot| snapshot.time).collect();
        all.push((stage, times));
    }
    let share = |stage: usize| if falls(results, stage) { 2 } else { 1 };
    let shares = all.iter().map(|(stage, _)| share(*stage)).sum::<usize>().max(1);
    let total: usize = all.iter().map(|(_, times)| times.len()).sum();
    let thinned = all.iter().flat_map(|(stage, times)| {
        let n = times.len();
        let most = if total <= choice.frames { n } else { choice.frames * share(*stage) / shares };
        let most = most.clamp(1, n);
        // The last snapshot always, the first where there are two.
        (0..most).map(move |k| (*stage, times[n - 1 - (most - 1 - k) * (n - 1) / (most - 1).max(1)]))
    });
    Ok(thinned.collect())
}

/// Whether the canopy falls in a stage.
fn falls(results: &RunSnapshots, stage: usize) -> bool {
    results.scene.stages[stage].kind == StageKind::Coupled
}

fn frames(results: &RunSnapshots, choice: &Choice<'_>) -> Result<Vec<Frame>, RunError> {
    let mut shapes = Vec::new();
    for (stage, time) in moments(results, choice)? {
        let structure = match results.structure(stage, Some(time))? {
            Some(found) => Some(found),
            None => results.last_before(stage)?,
        };
        // A flow around no canopy that was written is left out.
        let Some((_, canopy, lines)) = structure else { continue };
        shapes.push((stage, time, canopy, lines));
    }
    if shapes.is_empty() {
        return Err(results.none("canopy.pvd", "surface_every_windows"));
    }
    let window = window(shapes.iter().map(|(.., canopy, _)| canopy));
    let speeds = Falls::read(results, shapes.iter().map(|(stage, ..)| *stage));
    let frame = |(stage, time, canopy, lines): (usize, f64, Piece, Option<Piece>)| {
        let flow = results.times(stage, Kind::Flow)?;
        let cut = match &flow {
            Some(times) => {
                let files = &times.nearest(Some(time)).files;
                Flow::read(results, files, Some(canopy.clone()), choice.diagonal, Some(window))?
            }
            None => Flow::none(&canopy, choice.diagonal, window),
        };
        let (fall, falls, flow) = (speeds.at(stage, time), falls(results, stage), flow.is_some());
        Ok(Frame { stage, time, canopy, lines, cut, fall, flow, falls })
    };
    shapes.into_iter().map(frame).collect()
}

/// The part of the cut that is shown: a canopy width around all shapes.
fn window<'a>(canopies: impl Iterator<Item = &'a Piece>) -> Window {
    let [low, high] = bounds(canopies.flat_map(|c| c.points.iter().copied()));
    let size = (high[0] - low[0]).max(high[1] - low[1]);
    let middle = 0.5 * (low[0] + high[0]);
    [[middle - 1.1 * size, low[2] - 0.55 * size], [middle + 1.1 * size, high[2] + 0.8 * size]]
}

/// Descent speeds over time, by stage.
struct Falls(Vec<(usize, Vec<[f64; 3]>)>);

impl Falls {
    /// Reads the histories that have a descent speed; a history that is missing or has none is no error.
    fn read(results: &RunSnapshots, stages: impl Iterator<Item = usize>) -> Self {
        let mut all: Vec<(usize, Vec<[f64; 3]>)> = Vec::new();
        let mut fallen = 0.0;
        for stage in stages {
            if all.iter().any(|(s, _)| *s == stage) {
                continue;
            }
            let Ok(columns) = history::read(&results.stage_folder(stage).join("history.csv")) else {
                continue;
            };
            let column = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| values);
            let (Some(times), Some(speeds)) = (column("time_s"), column("descent_speed_m_s")) else {
                continue;
            };
            let moves = if falls(results, stage) { 1.0 } else { 0.0 };
            let mut last: Option<[f64; 2]> = None;
            let rows =
                times.iter().zip(speeds).filter(|(t, v)| t.is_finite() && v.is_finite()).map(|(&t, &v)| {
                    let [t0, v0] = last.unwrap_or([0.0, v]);
                    fallen += moves * 0.5 * (v0 + v) * (t - t0);
                    last = Some([t, v]);
                    [t, v, fallen]
                });
            let rows: Vec<_> = rows.collect();
            all.push((stage, rows));
        }
        Self(all)
    }

    /// Speed and distance fallen at the window that ends nearest to `time`.
    fn at(&self, stage: usize, time: f64) -> Option<[f64; 2]> {
        let (_, rows) = self.0.iter().find(|(s, _)| *s == stage)?;
        let nearest = rows.iter().min_by(|a, b| (a[0] - time).abs().total_cmp(&(b[0] - time).abs()))?;
        Some([nearest[1], nearest[2]])
    }
}

/// The colours of the fabric in all frames, and the values at the points of each: the first field that all have and
/// that varies.
fn fabric(frames: &[Frame]) -> (Legend, Vec<Vec<f64>>) {
    let varies = |values: &[Vec<f64>]| {
        let all = || values.iter().flatten().copied();
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        high - low > 1e-6 * high.abs().max(low.abs())
    };
    let fields = FABRIC.iter().filter_map(|&(name, title, unit)| {
        let values = frames.iter().map(|f| {
            let column = f.canopy.cell_field(name).filter(|c| c.width == 1)?;
            let (mut values, _) = at_points(&f.canopy, &column.values);
            values.iter_mut().for_each(|v| *v *= unit);
            Some(values)
        });
        Some((title, values.collect::<Option<Vec<_>>>()?))
    });
    let (title, values) = fields
        .into_iter()
        .find(|(_, values)| varies(values))
        .unwrap_or_else(|| ("displacement, m", frames.iter().map(|f| displacement(&f.canopy)).collect()));
    let range = Range::of(values.iter().flatten().copied(), 0.01);
    // Cables alone have no colour.
    let coloured = frames.iter().any(|f| f.canopy.n_cells() > 0);
    let title = if coloured { title } else { "" };
    (Legend { title: title.into(), scale: WARM, range: Range { low: range.low.min(0.0), ..range } }, values)
}

/// Draws all frames in one scale of lengths, colours and speeds.
fn draw(results: &RunSnapshots, frames: &[Frame], choice: &Choice<'_>) -> Vec<Image> {
    let (legend, values) = fabric(frames);
    let layout = Layout::new(frames, choice.width, legend);
    frames.iter().zip(&values).map(|(frame, values)| layout.image(results, frame, values)).collect()
}

/// What all frames have in common; lengths in pixels.
struct Layout {
    width: f64,
    /// Width of the left panel: the canopy.
    left: f64,
    /// Height of the panels, and of the header above them.
    height: f64,
    head: f64,
    /// Em of the text.
    text: f64,
    view: View,
    legend: Legend,
    /// Part of the cut that is shown, m, and the speed at the end of its colour bar, m/s. `None`: no frame has a flow.
    cut: Option<(Window, f64)>,
}

impl Layout {
    fn new(frames: &[Frame], width: u32, legend: Legend) -> Self {
        let w = f64::from(width);
        let text = (0.0185 * w).max(8.0);
        let fastest = frames.iter().filter(|f| f.flow).map(|f| f.cut.fastest()).reduce(f64::max);
        let cut = fastest.map(|fastest| (window(frames.iter().map(|f| &f.canopy)), fastest));
        let left = if cut.is_some() { (0.42 * w).round() } else { w };
        let height = match cut {
            Some(([low, high], _)) => {
                ((w - left) * (high[1] - low[1]) / (high[0] - low[0])).round() + flow::BELOW * text
            }
            None => 0.95 * w,
        };
        let points: Vec<Point> =
            frames.iter().flat_map(|f| all_points(&f.canopy, f.lines.as_ref())).collect();
        let view = View::fit(&points, EYE, [text, 0.5 * text], [left - 2.0 * text, height - 5.5 * text]);
        Self { width: w, left, height, head: (2.6 * text).round(), text, view, legend, cut }
    }

    /// One frame: the header, the canopy, the cut.
    fn image(&self, results: &RunSnapshots, frame: &Frame, values: &[f64]) -> Image {
        let mut image = self.header(results, frame);
        let head = self.head as u32;
        image.paste(&self.canopy(frame, values), (0, head));
        if let Some((window, fastest)) = self.cut {
            image.paste(&self.section(frame, window, fastest), (self.left as u32, head));
        }
        image
    }

    /// Stage, speed and time on an empty picture.
    fn header(&self, results: &RunSnapshots, frame: &Frame) -> Image {
        let mut samples = Samples::new([self.width, self.head + self.height].map(|s| s as u32), PAPER);
        let area = samples.area();
        let sheet = Sheet(&area);
        let stage = results.scene.stages[frame.stage].name.replace('_', " ");
        let what = if frame.falls { "descent speed" } else { "canopy held in a stream of" };
        let speed = frame.fall.map(|[v, _]| format!(": {what} {v:.2} m/s")).unwrap_or_default();
        let time = format!("t = {:.2} s", frame.time);
        let (text, margin, middle) = (1.15 * self.text, 1.5 * self.text, 0.5 * self.head);
        sheet
            .text(&format!("{stage}{speed}"), [margin, middle], text, Anchor::Left, INK)
            .and_then(|()| sheet.text(&time, [self.width - margin, middle], text, Anchor::Right, INK))
            .expect(IN_MEMORY);
        drop(area);
        samples.average()
    }

    fn canopy(&self, frame: &Frame, values: &[f64]) -> Image {
        let mut raster = Raster::new(self.left as u32, self.height as u32);
        let body = Body { canopy: &frame.canopy, lines: frame.lines.as_ref(), values };
        draw_body(&mut raster, &self.view, &body, &self.legend, (0.0022 * self.left).max(0.7));
        let mut samples = raster.finish();
        let (corner, size) =
            ([1.5 * self.text, self.height - 2.55 * self.text], [0.62 * self.left, 0.9 * self.text]);
        self.legend.draw(&Sheet(&samples.area()), corner, size, self.text).expect(IN_MEMORY);
        samples.average()
    }

    fn section(&self, frame: &Frame, [low, high]: Window, fastest: f64) -> Image {
        let fallen = frame.fall.map_or(0.0, |[_, fallen]| fallen);
        // Heights above the origin at the release: they rise past a canopy that falls.
        let step = match high[1] - low[1] {
            span if span > 40.0 => 10.0,
            span if span > 12.0 => 2.0,
            _ => 1.0,
        };
        let [first, last] = [((low[1] - fallen) / step).ceil(), ((high[1] - fallen) / step).floor()];
        let marks =
            (first as i64..=last as i64).map(|k| k as f64 * step).map(|z| (z + fallen, format!("{z}")));
        let marks: Vec<(f64, String)> = marks.filter(|_| frame.falls).collect();
        let caption = if frame.flow { "" } else { "no flow in this stage" };
        let width = (self.width - self.left) as u32;
        frame.cut.draw(&Look { caption, width, text: self.text, fastest, arrows: 20, marks: &marks })
    }
}
