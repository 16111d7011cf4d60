//! Canopy snapshots of a stage: the quantities measured on each, and the frames of the animation.

use coupling::error::RunError;
use figures::snapshots::Kind;
use mesh::Point;
use mesh::vtk::read::Piece;

use super::data::{Run, StageData};
use super::openings::{area, area_vector, skirt_and_vents};
use super::payload::{Payload, Pose};
use super::shape::Shape;

/// Maximum number of snapshots read per stage.
const MAX_READ: usize = 200;

/// The fields that colour the fabric.
pub(super) const FIELDS: [Field; 3] = [
    Field {
        column: "stress_1_pa",
        label: "major stress",
        unit: "MPa",
        factor: 1e-6,
        note: "Major principal stress of the fabric.",
    },
    Field {
        column: "pressure_jump_pa",
        label: "pressure jump",
        unit: "Pa",
        factor: 1.0,
        note: "Pressure inside minus pressure outside the canopy.",
    },
    Field {
        column: "wrinkling_state",
        label: "wrinkling state",
        unit: "",
        factor: 1.0,
        note: "Slack: no tension. Wrinkled: uniaxial tension. Taut: biaxial tension.",
    },
];

/// A field of the canopy's snapshots.
pub(super) struct Field {
    /// Name in the snapshot files.
    pub(super) column: &'static str,
    /// Name shown in the page.
    pub(super) label: &'static str,
    /// Unit shown in the page.
    pub(super) unit: &'static str,
    /// Factor from the unit of the file to the unit shown.
    pub(super) factor: f64,
    /// Definition, in one sentence.
    pub(super) note: &'static str,
}

impl Field {
    /// Whether its values are categories (slack, wrinkled, taut) instead of a quantity.
    pub(super) fn states(&self) -> bool {
        self.unit.is_empty()
    }
}

/// A frame of the animation.
pub(super) struct Frame {
    pub(super) time: f64,
    /// Nodes of canopy and lines, m.
    pub(super) points: Vec<Point>,
    /// Values of each triangle; empty if the snapshot does not contain the field.
    pub(super) fields: [Vec<f64>; 3],
    /// The payload; `None` where its place is not known.
    pub(super) payload: Option<Pose>,
}

/// Quantities measured on a snapshot.
#[derive(Clone, Debug, Default)]
pub(super) struct Measure {
    pub(super) time: f64,
    /// Areas of the vents, m2.
    pub(super) vents: Vec<f64>,
    /// Horizontal area that the skirt encloses, m2.
    pub(super) mouth: f64,
    /// Area shares of slack, wrinkled and taut fabric; zeros if the snapshot does not contain the states.
    pub(super) states: [f64; 3],
    /// Smallest, mean and largest tension of the suspension lines, N.
    pub(super) tensions: Option<[f64; 3]>,
    /// Kind and maximum tension, N, of each line.
    pub(super) lines: Vec<(u8, f64)>,
}

/// The canopy in a stage.
pub(super) struct StageFrames {
    pub(super) stage: String,
    pub(super) shape: Shape,
    /// Frames of the animation, in order of time.
    pub(super) frames: Vec<Frame>,
    /// Measured quantities of all snapshots read.
    pub(super) measures: Vec<Measure>,
    /// Number of snapshots of the stage.
    pub(super) written: usize,
}

/// At most `most` (at least 2) evenly spaced indices below `count`, including the first and the last.
pub(super) fn evenly(count: usize, most: usize) -> Vec<usize> {
    let most = most.max(2);
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|i| (i * (count - 1) + (most - 1) / 2) / (most - 1)).collect()
}

/// Number of canopy snapshots of a stage that are read.
pub(super) fn count(run: &Run, stage: &StageData) -> Result<usize, RunError> {
    Ok(run.results.times(stage.index, Kind::Canopy)?.map_or(0, |t| t.all().len().min(MAX_READ)))
}

/// Size of a frame as written by [`super::pack`], bytes before compression.
pub(super) fn frame_bytes(shape: &Shape) -> usize {
    6 * shape.nodes + FIELDS.len() * shape.triangles.len()
}

/// The topology of a stage's snapshots.
pub(super) fn first_shape(run: &Run, stage: &StageData) -> Result<Option<Shape>, RunError> {
    let found = run.results.structure(stage.index, Some(0.0))?;
    Ok(found.map(|(_, canopy, lines)| Shape::of(&canopy, lines.as_ref())))
}

/// Reads the snapshots of a stage and keeps at most `most` frames.
pub(super) fn read(run: &Run, stage: &StageData, most: usize) -> Result<Option<StageFrames>, RunError> {
    let Some(times) = run.results.times(stage.index, Kind::Canopy)? else { return Ok(None) };
    let all = times.all();
    let chosen = evenly(all.len(), MAX_READ);
    let kept = evenly(chosen.len(), most);
    let payload = Payload::of(run, stage);
    let mut out: Option<StageFrames> = None;
    let mut openings: Option<(Vec<u32>, Vec<Vec<u32>>)> = None;
    for (at, &snapshot) in chosen.iter().enumerate() {
        let Some((time, canopy, lines)) = run.results.structure(stage.index, Some(all[snapshot].time))?
        else {
            continue;
        };
        let found = out.get_or_insert_with(|| StageFrames {
            stage: run.stage(stage).name.clone(),
            shape: Shape::of(&canopy, lines.as_ref()),
            frames: Vec::new(),
            measures: Vec::new(),
            written: all.len(),
        });
        let shape = &found.shape;
        let points = lines.as_ref().map_or(&canopy.points, |l| &l.points);
        if points.len() != shape.nodes || canopy.n_cells() != shape.cell.last().map_or(0, |c| c + 1) {
            return Err(RunError::Input(format!(
                "the snapshots of stage `{}` have different meshes, so they are not from one run. Run the \
                 scene again in an empty folder",
                found.stage
            )));
        }
        let (skirt, vents) = openings.get_or_insert_with(|| match skirt_and_vents(points, &shape.loops) {
            Some((skirt, vents)) => (skirt.to_vec(), vents.into_iter().map(<[u32]>::to_vec).collect()),
            None => (Vec::new(), Vec::new()),
        });
        let fields = FIELDS.map(|f| field(&canopy, shape, &f));
        let (tensions, of_lines) = tensions(shape, lines.as_ref());
        found.measures.push(Measure {
            time,
            vents: vents.iter().map(|v| area(points, v)).collect(),
            mouth: area_vector(points, skirt)[2].abs(),
            states: shares(points, shape, &fields[2]),
            tensions,
            lines: of_lines,
        });
        if kept.binary_search(&at).is_ok() {
            let points = points.clone();
            found.frames.push(Frame { time, points, fields, payload: payload.at(time) });
        }
    }
    Ok(out)
}

fn field(canopy: &Piece, shape: &Shape, field: &Field) -> Vec<f64> {
    match canopy.cell_field(field.column).filter(|c| c.width == 1) {
        Some(column) => shape.cell.iter().map(|&c| field.factor * column.values[c]).collect(),
        None => Vec::new(),
    }
}

/// Area share of each wrinkling state.
fn shares(points: &[Point], shape: &Shape, states: &[f64]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (triangle, &state) in shape.triangles.iter().zip(states) {
        sums[(state as usize).min(2)] += area(points, triangle);
    }
    let total: f64 = sums.iter().sum();
    if total > 0.0 { sums.map(|s| s / total) } else { sums }
}

/// Minimum, mean and maximum tension of the suspension lines, N; kind and maximum tension of each line.
fn tensions(shape: &Shape, lines: Option<&Piece>) -> (Option<[f64; 3]>, Vec<(u8, f64)>) {
    let Some(column) = lines.and_then(|l| l.cell_field("tension_n")) else { return (None, Vec::new()) };
    let mut of_line = std::collections::BTreeMap::new();
    for ((&kind, &line), &tension) in shape.kind.iter().zip(&shape.line).zip(&column.values) {
        let largest = of_line.entry((kind, line)).or_insert(tension);
        *largest = tension.max(*largest);
    }
    let all: Vec<(u8, f64)> = of_line.into_iter().map(|((kind, _), t)| (kind, t)).collect();
    let own: Vec<f64> = all.iter().filter(|(kind, _)| *kind == 0).map(|(_, t)| *t).collect();
    if own.is_empty() {
        return (None, all);
    }
    let mean = own.iter().sum::<f64>() / own.len() as f64;
    let low = own.iter().copied().fold(f64::MAX, f64::min);
    let high = own.iter().copied().fold(f64::MIN, f64::max);
    (Some([low, mean, high]), all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_both_ends() {
        assert_eq!(evenly(4, 9), [0, 1, 2, 3]);
        assert_eq!(evenly(0, 9), [0usize; 0]);
        for (count, most) in [(250, 60), (7, 2), (11, 10), (3, 1)] {
            let chosen = evenly(count, most);
            assert_eq!((chosen[0], chosen[chosen.len() - 1], chosen.len()), (0, count - 1, most.max(2)));
            assert!(chosen.windows(2).all(|w| w[1] > w[0]), "{chosen:?}");
        }
    }
}
