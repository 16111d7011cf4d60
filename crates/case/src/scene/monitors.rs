//! What the flow writes down as it runs. Nothing here costs anything where it is absent.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{Check, plain_name};
use crate::{BoxSides, Condition, Flow, Scene, StageKind};

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
    /// Forces, moments and coefficients of chosen surfaces.
    pub coefficients: Vec<ForceCoefficients>,
    /// The force that history, progress and summary of stages of kind `flow-only`, or without a canopy, show as the drag and that
    /// `stage.steady.force_change` watches: the name of an entry of `[[flow.forces.coefficients]]`, `canopy`, or `wall`
    /// (all no-slip walls). Absent: `canopy`; in a scene without a canopy the first entry, or `wall` without one.
    pub watch: Option<String>,
}

/// A force that a stage watches and reports as its drag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WatchedForce<'a> {
    /// That on the canopy; the drag is its vertical component.
    Canopy,
    /// That on all no-slip walls of the outer boundary; the drag is along `flow.forces.drag_direction`.
    Walls,
    /// That of an entry of `[[flow.forces.coefficients]]`.
    Entry(&'a ForceCoefficients),
}

impl WatchedForce<'_> {
    /// Name in `flow.forces.watch` and of its columns in `forces.csv`.
    pub fn name(&self) -> &str {
        match self {
            Self::Canopy => CANOPY,
            Self::Walls => WALL,
            Self::Entry(entry) => &entry.name,
        }
    }
}

impl Default for Forces {
    fn default() -> Self {
        Self {
            moment_point_m: [0.0; 3],
            drag_direction: [0.0, 0.0, 1.0],
            coefficients: Vec::new(),
            watch: None,
        }
    }
}

/// Force, moment and coefficients of the air on chosen surfaces together, as columns of `forces.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceCoefficients {
    /// Begins the names of its columns.
    pub name: String,
    /// The surfaces: `canopy`, physical groups of `[flow.grid_file.patches]`, sides of `[flow.box]`; walls and
    /// slip walls only. A group named `canopy` takes precedence over the canopy.
    pub patches: Vec<String>,
    /// Direction of the drag, of any length. Absent: `flow.forces.drag_direction`.
    pub drag_direction: Option<[f64; 3]>,
    /// Direction of the lift, of any length; its component normal to the drag is used. The side force is along lift x
    /// drag. Absent: z, or x where the drag is along z.
    pub lift_direction: Option<[f64; 3]>,
    /// Point about which moments are taken, in the falling frame, m. Absent: `flow.forces.moment_point_m`.
    pub moment_point_m: Option<[f64; 3]>,
    /// Reference area, m2.
    pub reference_area_m2: f64,
    /// Reference length of the moment coefficients, m.
    pub reference_length_m: f64,
    /// Reference speed, m/s. Absent: the speed of the undisturbed air relative to the frame at the end of each window.
    pub reference_speed_m_s: Option<f64>,
}

/// Name of the canopy among the surfaces of `[[flow.forces.coefficients]]` and `[[stage.body_motion]]`.
pub const CANOPY: &str = "canopy";
/// Name of all no-slip walls of the outer boundary.
const WALL: &str = "wall";
/// Sets of columns that `forces.csv` has on its own.
const OWN_FORCES: [&str; 2] = [CANOPY, WALL];
/// Largest sine of the angle between two directions that count as parallel.
const PARALLEL: f64 = 1e-6;

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    v.map(|x| x / norm(v))
}

impl ForceCoefficients {
    /// Unit vectors along drag, side force (lift x drag) and lift; `None` where drag and lift are parallel. `forces`
    /// contains this entry.
    pub fn axes(&self, forces: &Forces) -> Option<[[f64; 3]; 3]> {
        let drag = unit(self.drag_direction.unwrap_or(forces.drag_direction));
        let upright = norm(cross([0.0, 0.0, 1.0], drag)) < PARALLEL;
        let default = if upright { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let side = cross(unit(self.lift_direction.unwrap_or(default)), drag);
        // A NaN is no direction either.
        (norm(side) >= PARALLEL).then(|| (drag, unit(side))).map(|(d, s)| [d, s, cross(d, s)])
    }

    /// Point about which moments are taken, m. `forces` contains this entry.
    pub fn moment_point(&self, forces: &Forces) -> [f64; 3] {
        self.moment_point_m.unwrap_or(forces.moment_point_m)
    }

    /// Force that makes a coefficient of 1, N, in air of density `density`, kg/m3, and speed `speed`, m/s, where the
    /// entry prescribes none; `None` where it is zero.
    pub fn force_scale(&self, density: f64, speed: f64) -> Option<f64> {
        let speed = self.reference_speed_m_s.unwrap_or(speed);
        let scale = 0.5 * density * speed * speed * self.reference_area_m2;
        scale.is_normal().then_some(scale)
    }

    /// Whether the canopy is one of the surfaces of `flow`.
    pub fn has_canopy(&self, flow: &Flow) -> bool {
        !flow.patches().iter().any(|p| p.0 == CANOPY) && self.patches.iter().any(|p| p == CANOPY)
    }
}

impl Scene {
    /// The force that a stage of this kind watches and reports as its drag.
    pub fn watched_force(&self, kind: StageKind) -> WatchedForce<'_> {
        let forces = self.flow.as_ref().and_then(|f| f.forces.as_ref());
        let entries = forces.map_or(&[][..], |f| &f.coefficients);
        let default = || match entries.first() {
            _ if self.has_canopy() => WatchedForce::Canopy,
            Some(entry) => WatchedForce::Entry(entry),
            None => WatchedForce::Walls,
        };
        match forces.and_then(|f| f.watch.as_deref()) {
            _ if kind != StageKind::FlowOnly && self.has_canopy() => WatchedForce::Canopy,
            None => default(),
            Some(WALL) => WatchedForce::Walls,
            Some(name) => entries.iter().find(|e| e.name == name).map_or_else(default, WatchedForce::Entry),
        }
    }

    /// Unit vector along the drag of [`Scene::watched_force`].
    pub fn watched_direction(&self, kind: StageKind) -> [f64; 3] {
        let up = [0.0, 0.0, 1.0];
        let common = self.flow.as_ref().and_then(|f| f.forces.as_ref()).map_or(up, |f| f.drag_direction);
        match self.watched_force(kind) {
            WatchedForce::Canopy => up,
            WatchedForce::Walls => unit(common),
            WatchedForce::Entry(entry) => unit(entry.drag_direction.unwrap_or(common)),
        }
    }
}

impl Flow {
    /// Named patches of the outer boundary with their conditions, in the order of the grid's: the groups of
    /// `[flow.grid_file.patches]`, or the sides of `[flow.box]`.
    pub fn patches(&self) -> Vec<(&str, Condition)> {
        match (&self.grid_file, &self.box_grid) {
            (Some(file), _) => file.patches.iter().map(|(name, c)| (name.as_str(), *c)).collect(),
            (None, Some(b)) => BoxSides::NAMES.into_iter().zip(b.sides.in_order()).collect(),
            (None, None) => Vec::new(),
        }
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
pub(super) fn check(f: &Flow, canopy: bool, c: &mut Check) {
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
        (0..s.coefficients.len()).for_each(|k| coefficients(f, canopy, k, c));
        let own = &OWN_FORCES[usize::from(!canopy)..];
        let names: Vec<&str> =
            s.coefficients.iter().map(|e| e.name.as_str()).chain(own.iter().copied()).collect();
        if let Some(name) = s.watch.as_deref().filter(|n| !names.contains(n)) {
            c.refuse(
                "flow.forces.watch",
                format!("no entry of [[flow.forces.coefficients]] has the name \"{name}\""),
                format!("name one of: {}", names.join(", ")),
            );
        }
    }
}

/// Entry `k` of `[[flow.forces.coefficients]]` of a scene with or without a canopy.
fn coefficients(flow: &Flow, canopy: bool, k: usize, c: &mut Check) {
    let Some(forces) = &flow.forces else { return };
    let (entry, at) = (&forces.coefficients[k], |key: &str| format!("flow.forces.coefficients[{k}].{key}"));
    let earlier = forces.coefficients[..k].iter().map(|e| e.name.as_str());
    name(at("name"), &entry.name, earlier.chain(OWN_FORCES).any(|n| n == entry.name), c);
    surfaces(flow, canopy, (entry, &at("patches")), c);
    for (key, v) in [("drag_direction", entry.drag_direction), ("lift_direction", entry.lift_direction)] {
        if let Some(v) = v {
            direction(at(key), v, c);
        }
    }
    if entry.axes(forces).is_none() {
        c.refuse(
            &at("lift_direction"),
            format!("drag and lift of \"{}\" have no two different directions", entry.name),
            "name a lift direction across the drag, as [0, 0, 1] for a drag along x",
        );
    }
    if let Some(point) = entry.moment_point_m {
        c.finite(&at("moment_point_m"), &point, "the point", "three in m");
    }
    c.positive(&at("reference_area_m2"), entry.reference_area_m2, 1e6, "an area in m2");
    c.positive(&at("reference_length_m"), entry.reference_length_m, 1e4, "a length in metres");
    if let Some(speed) = entry.reference_speed_m_s {
        c.positive(&at("reference_speed_m_s"), speed, 1e4, "a speed in m/s");
    }
}

/// Refuses surfaces that the grid does not have, and those that air passes.
fn surfaces(flow: &Flow, canopy: bool, (entry, at): (&ForceCoefficients, &str), c: &mut Check) {
    let patches = flow.patches();
    let solid = |condition| matches!(condition, Condition::Wall | Condition::Slip | Condition::Symmetry);
    let mut walls: Vec<&str> = patches.iter().filter(|p| solid(p.1)).map(|p| p.0).collect();
    if canopy && !walls.contains(&CANOPY) {
        walls.push(CANOPY);
    }
    let remedy = || format!("name surfaces among: {}", walls.join(", "));
    if entry.patches.is_empty() {
        c.refuse(at, format!("\"{}\" sums the forces on no surface", entry.name), remedy());
    }
    for (k, patch) in entry.patches.iter().enumerate() {
        let what = match patches.iter().find(|p| p.0 == patch) {
            Some((_, condition)) if !solid(*condition) => {
                format!("air passes the patch \"{patch}\": it has no force")
            }
            None if patch != CANOPY || !canopy => format!("the flow grid has no patch \"{patch}\""),
            _ if entry.patches[..k].contains(patch) => format!("the patch \"{patch}\" occurs twice"),
            _ => continue,
        };
        c.refuse(&format!("{at}[{k}]"), what, remedy());
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
