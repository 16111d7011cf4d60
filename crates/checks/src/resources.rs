//! Checks of what a run needs of its machine: ranks, memory, wall time.
//!
//! Costs per cell and element are those of docs/records/benchmarks.md on one core of the machines it names; they
//! hold to a factor of three.

use case::{Acceleration, FlowDevice, Integration, Role, Scheme, Solve, Stage, StageKind};
use terminal::clock;

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::table::{Check, When};

/// Bytes of the flow-solver for each cell of a moving grid.
const FLOW_BYTES: f64 = 1400.0;
/// The same around an immersed canopy.
const IMMERSED_BYTES: f64 = 250.0;
/// Bytes of the mesh-mover for each cell, at most.
const MESH_BYTES: f64 = 2900.0;
/// Bytes of the structure-solver for each element, implicit steps.
const STRUCTURE_BYTES: f64 = 1600.0;
/// Bytes of a rank before it holds anything.
const RANK_BYTES: f64 = 6e7;
/// Dense matrices of the coupler's added-mass model.
const DENSE: f64 = 4.0;
/// Seconds of a flow solve and of a grid motion for each cell.
const FLOW_S: f64 = 2e-6;
/// Seconds of a step around an immersed canopy for each cell.
const IMMERSED_S: f64 = 1e-7;
/// The same on a GPU, with the time to cut a moving surface: a fifth to a fortieth was measured.
const GPU_S: f64 = 1e-8;
const MESH_S: f64 = 1.5e-6;
/// Seconds of an explicit and of an implicit structural step for each element.
const EXPLICIT_S: f64 = 4.4e-8;
const IMPLICIT_S: f64 = 3.4e-6;
/// Newton steps of a static solution, and the share of an implicit step that one takes.
const STATIC_STEPS: f64 = 200.0 / 3.4;
/// Flow solves and structural responses in a coupled window of block quasi-Newton.
const BLOCK_SOLVES: [f64; 2] = [2.5, 20.0];
/// The same of the other accelerations.
const PLAIN_SOLVES: [f64; 2] = [8.0, 8.0];
/// Seconds of the added-mass model in a window for each pair of faces.
const PAIR_S: f64 = 5e-8;
/// Windows of a steady march.
const STEADY_STEPS: f64 = 100.0;

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "ranks.cores",
        what: "a program has no more ranks than the machine has cores",
        estimate: "largest number of ranks of a program; programs take turns, so that their ranks share the cores",
        range: "warning above the hardware threads that this process may use, unless --mpirun places ranks elsewhere",
        source: "MPI waits by spinning: two ranks on one core slow each other by far more than a factor of two",
        severity: Warning,
        remedy: "lower the ranks, in the scene under [ranks] or by --ranks flow=N; see docs/how-to/run-on-a-cluster.md for several hosts",
        when: When::Before(cores),
    },
    Check {
        id: "ranks.cells",
        what: "each rank has cells enough",
        estimate: "cells a rank of flow and mesh",
        range: "warning below 216 cells a rank; error where ranks exceed cells",
        source: "a cube of n cells has 6 n^2/3 neighbours on other ranks: as many as its own cells at 216",
        severity: Error,
        remedy: "lower the ranks, in the scene under [ranks] or by --ranks flow=N",
        when: When::Before(cells_a_rank),
    },
    Check {
        id: "machine.memory",
        what: "the run fits into the main memory",
        estimate: "1.4 kB a cell (flow), 2.9 kB a cell (mesh), 1.6 kB an element (structure), 60 MB a rank, and four dense \
                   matrices of coupling.added_mass_max_panels in the coupler",
        range: "warning where the estimate exceeds 80 % of the memory; error where half of it exceeds all",
        source: "measured in docs/records/benchmarks.md; right to a factor of two",
        severity: Error,
        remedy: "use fewer cells or layers, or ranks on several hosts (docs/how-to/run-on-a-cluster.md)",
        when: When::Before(memory),
    },
    Check {
        id: "machine.wall-time",
        what: "how long the run takes",
        estimate: "windows x (2.5 flow solves of 2 us a cell, grid motion of 1.5 us a cell, 20 structural responses of \
                   0.044 us an element and explicit step or 3.4 us an element and implicit step; 8 of both with another \
                   coupling.acceleration than ibqn-ls), over ranks on the cores",
        range: "warning above 7 days",
        source: "measured in docs/records/benchmarks.md; right to a factor of three",
        severity: Warning,
        remedy: "lengthen window_s, use fewer cells or more cores; a run can be ended and resumed (docs/how-to/restart-a-run.md)",
        when: When::Before(wall_time),
    },
];

/// Roles of the stages that run.
fn roles(f: &Facts<'_>) -> impl Iterator<Item = Role> {
    Role::ALL.into_iter().filter(|r| f.stages().any(|(_, s)| f.scene.roles(s).contains(r)))
}

fn cores(f: &Facts<'_>) -> Vec<Judged> {
    let most = roles(f).map(|r| (f.scene.ranks.of(r), r)).max_by_key(|(n, _)| *n);
    let Some((ranks, role)) = most else { return Vec::new() };
    let many = ranks as usize > f.machine.cores && !f.machine.hosts;
    let figure = format!("the {} has {ranks} ranks, this machine {} cores", role.program(), f.machine.cores);
    vec![Judged::new(if many { Warning } else { Note }, format!("ranks.{}", role.name()), figure)]
}

fn cells_a_rank(f: &Facts<'_>) -> Vec<Judged> {
    let cells = f.cells();
    if cells == 0.0 {
        return Vec::new();
    }
    let mut found = Vec::new();
    for role in roles(f).filter(|r| *r != Role::Structure) {
        let ranks = f64::from(f.scene.ranks.of(role));
        let severity = match (ranks > cells, ranks > 1.0 && cells / ranks < 216.0) {
            (true, _) => Error,
            (false, true) => Warning,
            _ => Note,
        };
        let figure = format!(
            "the {} has {} cells on {ranks} ranks, {} a rank",
            role.program(),
            cells,
            digits(cells / ranks)
        );
        found.push(Judged::new(severity, format!("ranks.{}", role.name()), figure));
    }
    found
}

fn elements(f: &Facts<'_>) -> f64 {
    (f.mesh.triangles.len() + f.mesh.cables.len()) as f64
}

/// Faces or groups of them that the coupler's added-mass model holds; 0 without it.
fn model_faces(f: &Facts<'_>) -> f64 {
    let c = &f.scene.coupling;
    let model = match c.scheme {
        Scheme::Implicit => c.acceleration == Acceleration::IbqnLs,
        Scheme::Staggered => c.staggered.sequence == case::StaggeredSequence::AddedMass,
    };
    if model && f.has(StageKind::Coupled) {
        (f.mesh.faces.len() as f64).min(f64::from(c.added_mass_max_panels))
    } else {
        0.0
    }
}

/// Whether the canopy moves through a Cartesian grid.
pub(super) fn immersed(f: &Facts<'_>) -> bool {
    f.scene.flow.as_ref().is_some_and(case::Flow::is_immersed)
}

/// Bytes of all programs in the largest stage.
fn bytes(f: &Facts<'_>) -> f64 {
    let of = |role: Role| {
        let held = match role {
            Role::Structure => STRUCTURE_BYTES * elements(f),
            Role::Flow if immersed(f) => IMMERSED_BYTES * f.cells(),
            Role::Flow => FLOW_BYTES * f.cells(),
            Role::Mesh => MESH_BYTES * f.cells(),
        };
        held + RANK_BYTES * f64::from(f.scene.ranks.of(role))
    };
    let most =
        f.stages().map(|(_, s)| f.scene.roles(s).iter().map(|r| of(*r)).sum::<f64>()).fold(0.0, f64::max);
    most + RANK_BYTES + DENSE * 8.0 * model_faces(f).powi(2)
}

pub(super) fn gigabytes(bytes: f64) -> String {
    format!("{} GB", digits(bytes / 1e9))
}

fn memory(f: &Facts<'_>) -> Vec<Judged> {
    let needed = bytes(f);
    let severity = match f.machine.memory.filter(|_| !f.machine.hosts) {
        Some(all) if 0.5 * needed > all => Error,
        Some(all) if needed > 0.8 * all => Warning,
        _ => Note,
    };
    let all = f.machine.memory.map_or_else(|| "an unknown amount".into(), gigabytes);
    let figure = format!("about {} of memory, the machine has {all}", gigabytes(needed));
    vec![Judged::new(severity, "", figure)]
}

/// Windows of a stage.
pub(super) fn windows(s: &Stage) -> f64 {
    if s.solve == Solve::Static {
        1.0
    } else if s.steady.is_some() {
        STEADY_STEPS
    } else {
        s.windows() as f64
    }
}

/// Seconds of one structural response to a window.
fn response(f: &Facts<'_>, s: &Stage) -> f64 {
    let n = &f.numbers;
    let per_element = if s.solve == Solve::Static {
        IMPLICIT_S * STATIC_STEPS
    } else if f.scene.structure.integration == Integration::Explicit {
        let fabric = &f.scene.fabric;
        let wave = (fabric.youngs_modulus_pa / fabric.density_kg_m3).sqrt();
        let crossing = |c: &mesh::Cable| Some(c.section(f.scene)?.wave_speed() / c.rest_length);
        let crossings = f.mesh.cables.iter().filter_map(crossing).fold(wave / n.cell, f64::max);
        // A step is a share of 2 over the highest frequency, about 2 of these crossings; rates of strains shorten it.
        let tau = f.scene.retardation_time_s() + s.stiffness_damping_s;
        let steps = crossings * (tau * crossings + (tau * crossings).hypot(1.0));
        EXPLICIT_S * (s.window_s * steps / f.scene.structure.explicit_safety).max(f64::from(s.substeps))
    } else {
        IMPLICIT_S * f64::from(s.substeps)
    };
    per_element * elements(f)
}

/// Seconds of a stage.
fn seconds(f: &Facts<'_>, s: &Stage) -> f64 {
    let share = |r: Role| {
        f64::from(f.scene.ranks.of(r)).min(if f.machine.hosts {
            f64::INFINITY
        } else {
            f.machine.cores as f64
        })
    };
    let grid = f.scene.flow.as_ref().and_then(|flow| flow.immersed.as_ref());
    let flow = match grid.map(|g| g.device) {
        Some(FlowDevice::Cpu) => IMMERSED_S * f.cells(),
        Some(FlowDevice::Gpu) => GPU_S * f.cells(),
        None => FLOW_S * f.cells() / share(Role::Flow),
    };
    let mesh = if immersed(f) { 0.0 } else { MESH_S * f.cells() / share(Role::Mesh) };
    let structure = response(f, s) / share(Role::Structure);
    let window = match s.kind {
        StageKind::PreInflation => structure,
        StageKind::FlowOnly => flow,
        StageKind::Trajectory => 0.0,
        StageKind::Prescribed => flow + mesh,
        StageKind::Coupled => match f.scene.coupling.scheme {
            Scheme::Implicit => {
                let surrogate = f.scene.coupling.acceleration == Acceleration::IbqnLs;
                let [flows, responses] = if surrogate { BLOCK_SOLVES } else { PLAIN_SOLVES };
                flows * flow + mesh + responses * structure + PAIR_S * model_faces(f).powi(2)
            }
            Scheme::Staggered => flow + mesh + structure,
        },
    };
    windows(s) * window
}

fn wall_time(f: &Facts<'_>) -> Vec<Judged> {
    let all: f64 = f.stages().map(|(_, s)| seconds(f, s)).sum();
    let severity = if all > 7.0 * 86_400.0 { Warning } else { Note };
    let figure = format!("about {} on this machine, to a factor of three", clock(all));
    vec![Judged::new(severity, "", figure)]
}
