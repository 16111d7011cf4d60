//! What the flow writes down as it runs. Nothing here costs anything where it is absent.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Flow;
use crate::check::{Check, plain_name};

/// A point whose values are written after every window, to `probes.csv` in the stage's
/// folder: gauge pressure, velocity relative to the falling frame, temperature, each
/// from the cell around the point with that cell's gradient.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Begins the names of its columns.
    pub name: String,
    /// Where it is in the falling frame, m.
    pub position_m: [f64; 3],
}

/// Mean and fluctuation (root of the mean square) of pressure and velocity in each
/// cell, weighted by time; on a moving grid along with the cell. Written with the
/// snapshots of the flow and saved with its state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Statistics {
    /// When they begin, s from the start of the stage.
    pub start_s: f64,
    /// Continues the statistics of the stage before (or of an interrupted run). Off:
    /// each stage gathers its own.
    pub across_stages: bool,
}

/// Force and moment of the air on the canopy after every window, in `forces.csv` in the
/// stage's folder, and on the no-slip walls of the outer boundary, if there are some.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Forces {
    /// Point about which moments are taken, in the falling frame, m.
    pub moment_point_m: [f64; 3],
    /// Direction of the drag, of any length.
    pub drag_direction: [f64; 3],
}

impl Default for Forces {
    fn default() -> Self {
        Self { moment_point_m: [0.0; 3], drag_direction: [0.0, 0.0, 1.0] }
    }
}

/// A plane cut through the flow, as a ParaView series named after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Slice {
    /// Name of the series.
    pub name: String,
    /// A point of the plane, in the falling frame, m.
    pub point_m: [f64; 3],
    /// Its normal, of any length.
    pub normal: [f64; 3],
    /// Windows between two cuts.
    pub every_windows: u32,
}

/// Pressure on both sides of the canopy, as the ParaView series `canopy_air.pvd`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfacePressure {
    /// Windows between two pictures.
    pub every_windows: u32,
}

/// Series that the programs write themselves.
const WRITTEN: [&str; 6] = ["flow", "canopy", "lines", "canopy_air", "history", "state"];

/// Refuses invalid and repeated names, and invalid positions and directions.
pub(super) fn check(f: &Flow, c: &mut Check) {
    for (k, p) in f.probes.iter().enumerate() {
        let taken = f.probes[..k].iter().any(|q| q.name == p.name);
        name(format!("flow.probe[{k}].name"), &p.name, taken, c);
        c.finite(&format!("flow.probe[{k}].position_m"), &p.position_m, "the position", "three in m");
    }
    for (k, s) in f.slices.iter().enumerate() {
        let taken = f.slices[..k].iter().map(|s| s.name.as_str()).chain(WRITTEN).any(|n| n == s.name);
        name(format!("flow.slice[{k}].name"), &s.name, taken, c);
        direction(format!("flow.slice[{k}].normal"), s.normal, c);
        c.finite(&format!("flow.slice[{k}].point_m"), &s.point_m, "the point", "three in m");
        c.count(&format!("flow.slice[{k}].every_windows"), s.every_windows, 1..=u32::MAX, "windows");
    }
    if let Some(s) = &f.surface_pressure {
        c.count("flow.surface_pressure.every_windows", s.every_windows, 1..=u32::MAX, "windows");
    }
    if let Some(s) = &f.statistics {
        c.range("flow.statistics.start_s", s.start_s, 0.0..=1e6, "in s");
    }
    if let Some(s) = &f.forces {
        direction("flow.forces.drag_direction".into(), s.drag_direction, c);
        c.finite("flow.forces.moment_point_m", &s.moment_point_m, "the point", "three in m");
    }
}

fn name(path: String, name: &str, taken: bool, c: &mut Check) {
    if taken || !plain_name(name) {
        c.refuse(
            &path,
            format!("`{path}` is \"{name}\""),
            "use letters, digits, `-`, `_` and `.`, and each name once",
        );
    }
}

fn direction(path: String, v: [f64; 3], c: &mut Check) {
    if !v.iter().all(|x| x.is_finite()) || v == [0.0; 3] {
        c.refuse(&path, format!("`{path}` has no direction"), "name a vector, as [0, 0, 1]");
    }
}
