//! The snapshots of a stage's canopy: what is measured on each, and which go into the page.

use coupling::error::RunError;
use figures::snapshots::Kind;
use mesh::Point;
use mesh::vtk::read::Piece;

use super::data::{Run, StageData};
use super::openings::{area, area_vector, skirt_and_vents};
use super::shape::Shape;

/// Most snapshots of a stage that are read: enough for a smooth curve.
const MOST_READ: usize = 200;

/// Names, texts and units of the fields that colour the fabric.
pub(super) const FIELDS: [Field; 3] = [
    Field {
        column: "stress_1_pa",
        label: "major stress",
        unit: "MPa",
        factor: 1e-6,
        note: "The larger principal stress of the fabric: where it would tear first.",
    },
    Field {
        column: "pressure_jump_pa",
        label: "pressure jump",
        unit: "Pa",
        factor: 1.0,
        note: "Pressure inside less pressure outside: what holds the canopy open.",
    },
    Field {
        column: "wrinkling_state",
        label: "wrinkling state",
        unit: "",
        factor: 1.0,
        note: "Taut fabric is pulled in two directions, wrinkled fabric in one, slack fabric in none.",
    },
];

/// A field of the canopy's snapshots.
pub(super) struct Field {
    /// Its name in the files.
    pub(super) column: &'static str,
    /// Its name for people.
    pub(super) label: &'static str,
    /// Unit that is shown.
    pub(super) unit: &'static str,
    /// From the file's unit to that one.
    pub(super) factor: f64,
    /// What it says, in a sentence.
    pub(super) note: &'static str,
}

impl Field {
    /// Whether its values are names (slack, wrinkled, taut) and no quantity.
    pub(super) fn states(&self) -> bool {
        self.unit.is_empty()
    }
}

/// A snapshot as the page shows it.
pub(super) struct Frame {
    pub(super) time: f64,
    /// Canopy and lines, m.
    pub(super) points: Vec<Point>,
    /// Of each triangle; empty where the snapshot has no such field.
    pub(super) fields: [Vec<f64>; 3],
}

/// What was measured on a snapshot.
#[derive(Clone, Debug, Default)]
pub(super) struct Measure {
    pub(super) time: f64,
    /// Areas of the vents, m2.
    pub(super) vents: Vec<f64>,
    /// Horizontal area that the skirt encloses, m2.
    pub(super) mouth: f64,
    /// Shares of the fabric that are slack, wrinkled, taut; zeros where unknown.
    pub(super) states: [f64; 3],
    /// Smallest, mean and largest tension of the suspension lines, N.
    pub(super) tensions: Option<[f64; 3]>,
    /// Largest tension of each line with its kind, N.
    pub(super) lines: Vec<(u8, f64)>,
}

/// The canopy in a stage.
pub(super) struct StageFrames {
    pub(super) stage: String,
    pub(super) shape: Shape,
    /// In the order of time; those that go into the page.
    pub(super) frames: Vec<Frame>,
    /// Of every snapshot that was read.
    pub(super) measures: Vec<Measure>,
    /// Snapshots that the stage wrote.
    pub(super) written: usize,
}

/// `most` of `count` things, evenly, the first and the last among them.
pub(super) fn evenly(count: usize, most: usize) -> Vec<usize> {
    let most = most.max(2);
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|i| (i * (count - 1) + (most - 1) / 2) / (most - 1)).collect()
}

/// Snapshots of the canopy in a stage; `None` if it wrote none.
pub(super) fn count(run: &Run, stage: &StageData) -> Result<usize, RunError> {
    Ok(run.results.times(stage.index, Kind::Canopy)?.map_or(0, |t| t.all().len().min(MOST_READ)))
}

/// Bytes of a frame in the page, before compression, as [`super::pack`] writes it.
pub(super) fn frame_bytes(shape: &Shape) -> usize {
    6 * shape.nodes + FIELDS.len() * shape.triangles.len()
}

/// The topology of a stage's snapshots.
pub(super) fn first_shape(run: &Run, stage: &StageData) -> Result<Option<Shape>, RunError> {
    let found = run.results.structure(stage.index, Some(0.0))?;
    Ok(found.map(|(_, canopy, lines)| Shape::of(&canopy, lines.as_ref())))
}

/// Reads a stage; of what is read, `most` frames are kept.
pub(super) fn read(run: &Run, stage: &StageData, most: usize) -> Result<Option<StageFrames>, RunError> {
    let Some(times) = run.results.times(stage.index, Kind::Canopy)? else { return Ok(None) };
    let all = times.all();
    let chosen = evenly(all.len(), MOST_READ);
    let kept = evenly(chosen.len(), most);
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
                "the snapshots of stage `{}` have different meshes: were they written by one run?",
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
            found.frames.push(Frame { time, points, fields });
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

/// Shares of the area that are in each state.
fn shares(points: &[Point], shape: &Shape, states: &[f64]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (triangle, &state) in shape.triangles.iter().zip(states) {
        sums[(state as usize).min(2)] += area(points, triangle);
    }
    let total: f64 = sums.iter().sum();
    if total > 0.0 { sums.map(|s| s / total) } else { sums }
}

/// Smallest, mean and largest of the suspension lines; the largest of each line with its kind.
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
