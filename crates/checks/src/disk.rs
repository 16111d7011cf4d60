//! Check of the disk that the results of a run take.
//!
//! Bytes were measured on runs of `cases/square-drop` and `studies/atps-descent/coarse.toml`; the sum holds to 20 % for a
//! run of its planned windows.

use case::{Role, Stage, StageKind};

use super::facts::Facts;
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::resources::{gigabytes, immersed, windows};
use super::table::{Check, When};

/// Bytes of a flow snapshot for each cell, on a fitted and on a Cartesian grid; further ones with an eddy viscosity and with `[flow.statistics]`.
const VOLUME: f64 = 138.0;
const IMMERSED_VOLUME: f64 = 114.0;
const EDDY: f64 = 5.3;
const STATISTICS: f64 = 43.0;
/// Bytes of a canopy snapshot for each element; further ones for the shear of a viscous flow.
const ELEMENT: f64 = 137.0;
const SHEAR: f64 = 12.0;
/// Bytes of a snapshot of the lines for each node and each cable element.
const LINE_NODE: f64 = 32.0;
const LINE: f64 = 33.0;
/// Bytes of a saved state: of the flow for each cell, on a fitted and on a Cartesian grid, of the grid motion for each node of
/// the grid, of the structure for each of its nodes, and of the coupler for each node of the canopy.
const FLOW_STATE: f64 = 220.0;
const IMMERSED_STATE: f64 = 60.0;
const MESH_STATE: f64 = 170.0;
const STRUCTURE_STATE: f64 = 250.0;
const COUPLER_STATE: f64 = 2400.0;
/// Bytes of a file besides its values, and of the tables for each window.
const FILE: f64 = 1100.0;
const ROW: f64 = 700.0;
/// Above this size of the results there is a warning, bytes.
const MUCH: f64 = 5e10;

/// The rows.
pub const CHECKS: &[Check] = &[Check {
    id: "machine.disk",
    what: "the results fit onto the disk",
    estimate: "flow snapshots of 138 bytes a cell (114 around an immersed canopy), canopy snapshots of 137 an element, line snapshots of 32 a node; a saved state \
               for each stage of 220 a cell (60 around an immersed canopy), 170 a node of a moving grid, 250 a node of the \
               structure and 2.4 kB a node of the canopy; two more of the largest state while a checkpoint is written",
    range: "warning where the estimate exceeds 80 % of the free space, or 50 GB; error where half of it exceeds all",
    source: "measured on runs of cases/square-drop and studies/atps-descent/coarse.toml; right to 20 % for a run of its planned \
             windows",
    severity: Error,
    remedy: "raise output.volume_every_windows or output.surface_every_windows (0: no snapshots), or name another folder \
             with --out",
    when: When::Before(disk),
}];

/// Snapshots of a stage: every `n` windows and at its end.
fn snapshots(n: u32, s: &Stage) -> f64 {
    if n == 0 { 0.0 } else { (windows(s) / f64::from(n)).ceil() }
}

/// Bytes of the snapshots of a stage.
fn of_snapshots(f: &Facts<'_>, s: &Stage) -> f64 {
    let output = &f.scene.output;
    let flow = f.scene.flow.as_ref();
    let mut bytes = 0.0;
    if s.kind.roles().contains(&Role::Structure) {
        let shear = if flow.is_some_and(|flow| flow.viscosity.is_some()) { SHEAR } else { 0.0 };
        let mesh = &f.mesh;
        let canopy = (ELEMENT + shear) * mesh.triangles.len() as f64 + FILE;
        let lines = LINE_NODE * mesh.coords.len() as f64 + LINE * mesh.cables.len() as f64 + FILE;
        let lines = if mesh.cables.is_empty() { 0.0 } else { lines };
        bytes += snapshots(output.surface_every_windows, s) * (canopy + lines);
    }
    if let Some(flow) = flow.filter(|_| s.kind.roles().contains(&Role::Flow)) {
        let turbulent = flow.viscosity.as_ref().is_some_and(|v| v.turbulence.is_some());
        let eddy = if turbulent { EDDY } else { 0.0 };
        let statistics = if flow.statistics.is_some() { STATISTICS } else { 0.0 };
        let plain = if immersed(f) { IMMERSED_VOLUME } else { VOLUME };
        let cell = plain + eddy + statistics;
        bytes += snapshots(output.volume_every_windows, s) * (cell * f.cells() + FILE);
    }
    bytes
}

/// Bytes of a saved state of a stage.
fn of_state(f: &Facts<'_>, s: &Stage) -> f64 {
    let of = |role: &Role| match role {
        Role::Structure => STRUCTURE_STATE * f.mesh.coords.len() as f64,
        Role::Flow if immersed(f) => IMMERSED_STATE * f.cells(),
        Role::Flow => FLOW_STATE * f.cells(),
        Role::Mesh => MESH_STATE * f.grid_nodes(),
    };
    let coupler = if s.kind == StageKind::Coupled { COUPLER_STATE * f.mesh.n_canopy as f64 } else { 0.0 };
    f.scene.roles(s).iter().map(of).sum::<f64>() + coupler
}

fn disk(f: &Facts<'_>) -> Vec<Judged> {
    let sum = |of: fn(&Facts<'_>, &Stage) -> f64| f.stages().map(|(_, s)| of(f, s)).sum::<f64>();
    let (snapshots, states) = (sum(of_snapshots), sum(of_state));
    let tables: f64 = f.stages().map(|(_, s)| ROW * windows(s)).sum();
    let largest = f.stages().map(|(_, s)| of_state(f, s)).fold(0.0, f64::max);
    let all = snapshots + states + tables;
    let most = all + 2.0 * largest;
    let severity = match f.machine.disk {
        Some(free) if 0.5 * most > free => Error,
        Some(free) if most > 0.8 * free => Warning,
        _ if most > MUCH => Warning,
        _ => Note,
    };
    let free = f.machine.disk.map_or_else(|| "an unknown amount".into(), gigabytes);
    let figure = format!(
        "about {} of results: snapshots {}, saved states {}; at most {} during the run, {free} are free",
        gigabytes(all),
        gigabytes(snapshots),
        gigabytes(states),
        gigabytes(most)
    );
    vec![Judged::new(severity, "output", figure)]
}
