//! Encoding of canopy shapes and fields in the page: 16 bits per coordinate and 8 bits per value, as differences
//! in time, deflated, in base64. `viewer/unpack.js` decodes them.

use std::io::Write;

use base64::Engine;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use mesh::Point;
use serde_json::{Value, json};

use super::frames::{FIELDS, Field, Frame, StageFrames};
use super::payload::Pose;
use super::shape::Shape;

/// Encoded shapes and fields of the canopy.
pub(super) struct Packed {
    /// Sizes, ranges and names.
    pub(super) header: Value,
    /// Encoded data.
    pub(super) data: String,
    /// Caption: number of shapes, size and resolution.
    pub(super) note: String,
}

/// Share of the values outside the colour scale at either end, so that outliers do not set its range.
const CUT: f64 = 0.005;

/// Lengths of the sides of a payload without a size, relative to the largest extent of the view.
const SYMBOL: f64 = 0.03;

/// Encodes the stages that have the mesh of the last stage. `payload_m`: lengths of the sides of the payload, if it is a body.
pub(super) fn pack(stages: &[StageFrames], payload_m: Option<[f64; 3]>) -> Option<Packed> {
    let shape = &stages.last()?.shape;
    let stages: Vec<&StageFrames> =
        stages.iter().filter(|s| s.shape == *shape && !s.frames.is_empty()).collect();
    // Half of the diagonal of a body, which may turn.
    let reach = payload_m.map_or(0.0, |s| 0.5 * s.iter().map(|side| side * side).sum::<f64>().sqrt());
    let (origin, extent) = bounds(&stages, reach);
    let mut bytes = Vec::new();
    let mut index = |n: u32| bytes.extend(n.to_le_bytes());
    shape.triangles.iter().flatten().for_each(|&n| index(n));
    shape.hem.iter().flatten().for_each(|&n| index(n));
    shape.cables.iter().flatten().for_each(|&n| index(n));
    let mut described = Vec::new();
    for stage in &stages {
        let ranges: Vec<[f64; 2]> = (0..FIELDS.len()).map(|k| range(&stage.frames, k)).collect();
        let mut before: Option<(Vec<u16>, Vec<Vec<u8>>)> = None;
        for frame in &stage.frames {
            let positions = positions(frame, origin, extent);
            let fields: Vec<Vec<u8>> =
                (0..FIELDS.len()).map(|k| values(frame, shape, k, ranges[k])).collect();
            let earlier = |i: usize| before.as_ref().map_or(0, |b| b.0[i]);
            let change: Vec<u16> =
                positions.iter().enumerate().map(|(i, p)| p.wrapping_sub(earlier(i))).collect();
            bytes.extend(change.iter().map(|c| *c as u8));
            bytes.extend(change.iter().map(|c| (*c >> 8) as u8));
            for (k, field) in fields.iter().enumerate() {
                let earlier = |i: usize| before.as_ref().map_or(0, |b| b.1[k][i]);
                bytes.extend(field.iter().enumerate().map(|(i, v)| v.wrapping_sub(earlier(i))));
            }
            before = Some((positions, fields));
        }
        let times: Vec<f64> = stage.frames.iter().map(|f| (f.time * 1e6).round() / 1e6).collect();
        let poses: Option<Vec<[f64; 7]>> =
            stage.frames.iter().map(|f| f.payload.map(Pose::numbers)).collect();
        described.push(json!({ "name": stage.stage, "times": times, "ranges": ranges, "payload": poses }));
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    let deflated = encoder.write_all(&bytes).and_then(|()| encoder.finish()).ok()?;
    let largest = extent.iter().copied().fold(0.0, f64::max);
    let size = payload_m.unwrap_or([SYMBOL * largest; 3]);
    let header = json!({
        "payload": { "size": size },
        "nodes": shape.nodes, "triangles": shape.triangles.len(), "hem": shape.hem.len(),
        "cables": shape.cables.len(), "origin": origin, "extent": extent, "fields": fields(), "stages": described,
    });
    let counts: Vec<String> = stages
        .iter()
        .map(|s| format!("{} of {} shapes of stage {}", s.frames.len(), s.written, s.stage))
        .collect();
    let data = base64::engine::general_purpose::STANDARD.encode(deflated);
    let note = format!(
        "{}; {:.1} MB ({:.1} MB compressed). Positions have a resolution of {:.1} mm, fields of 1/255 of the colour \
         scale, which spans the 0.5 to 99.5 percentiles of each stage.",
        counts.join(", "),
        bytes.len() as f64 / 1e6,
        data.len() as f64 / 1e6,
        largest / 65535.0 * 1e3
    );
    Some(Packed { header, data, note })
}

/// Names and units of the fields.
fn fields() -> Vec<Value> {
    let field = |f: &Field| {
        let kind = if f.states() { "states" } else { "scale" };
        json!({ "label": f.label, "unit": f.unit, "kind": kind, "note": f.note })
    };
    FIELDS.iter().map(field).collect()
}

/// Corner and extent of all shapes, with `reach` (m) around the payload.
fn bounds(stages: &[&StageFrames], reach: f64) -> (Point, Point) {
    let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
    let mut include = |p: &Point, around: f64| {
        for c in 0..3 {
            low[c] = low[c].min(p[c] - around);
            high[c] = high[c].max(p[c] + around);
        }
    };
    for frame in stages.iter().flat_map(|s| &s.frames) {
        frame.points.iter().for_each(|p| include(p, 0.0));
        frame.payload.iter().for_each(|payload| include(&payload.place(), reach));
    }
    // A flat sheet has no extent in one direction.
    (low, [0, 1, 2].map(|c| (high[c] - low[c]).max(1e-9)))
}

fn positions(frame: &Frame, origin: Point, extent: Point) -> Vec<u16> {
    let place = |p: &Point| [0, 1, 2].map(|c| ((p[c] - origin[c]) / extent[c] * 65535.0).round() as u16);
    frame.points.iter().flat_map(place).collect()
}

/// Range of the colour scale of a field in a stage.
fn range(frames: &[Frame], field: usize) -> [f64; 2] {
    let mut all: Vec<f64> =
        frames.iter().flat_map(|f| &f.fields[field]).copied().filter(|v| v.is_finite()).collect();
    if all.is_empty() {
        return [0.0, 1.0];
    }
    let last = all.len() - 1;
    let mut at = |share: f64| {
        let i = (share * last as f64) as usize;
        *all.select_nth_unstable_by(i, f64::total_cmp).1
    };
    let (low, high) = (at(CUT), at(1.0 - CUT));
    if high - low > 1e-9 * high.abs().max(low.abs()) { [low, high] } else { [low - 0.5, low + 0.5] }
}

fn values(frame: &Frame, shape: &Shape, field: usize, [low, high]: [f64; 2]) -> Vec<u8> {
    let values = &frame.fields[field];
    if values.is_empty() {
        return vec![0; shape.triangles.len()];
    }
    // The conversion maps NaN to 0.
    let level = |v: &f64| {
        if FIELDS[field].states() { *v as u8 } else { ((v - low) / (high - low) * 255.0).round() as u8 }
    };
    values.iter().map(level).collect()
}
