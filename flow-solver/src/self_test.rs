//! A small moving case that must give the same forces on any number of ranks.

use std::path::Path;

use case::{InletValues, MovingWall, OutletValues, TimeFactor};
use channel::Fault;
use comm::Comm;
use mesh::{FaceTable, FlowGrid, Patch, plate_grid};

use crate::boundary_values::BoundaryValues;
use crate::face_permeability::FacePermeability;
use crate::geometry::vec3::Vec3;
use crate::loads::Loads;
use crate::permeable::Permeability;
use crate::physics::{Air, EddyViscosity, Isothermal, Laminar, Turbulent, Viscosity, WallTreatment};
use crate::residual::Spatial;
use crate::setup::partitioned;
use crate::solver::{Method, Settings, Solver, Step};
use crate::state;
use crate::topology::Topology;
use crate::turbulence::{SpalartAllmaras, ddes};

/// A plate in a viscous stream on a grid that heaves and twists, airtight, permeable, with
/// detached eddies, with data on patches or between periodic sides, as `effect` names it: the force after each of four steps. The state after
/// the second step is written to `file`, or,
/// where `file` exists, the run starts from it. Collective.
///
/// # Errors
/// Whatever the solver reports.
#[doc(hidden)]
pub fn self_test(comm: &Comm, file: &Path, effect: &str) -> Result<Vec<Vec3>, Fault> {
    let viscosity = 0.02;
    match effect {
        "turbulent" => run(
            comm,
            file,
            Turbulent { viscosity, eddies: EddyViscosity::TransportInput, wall: WallTreatment::Automatic },
            None,
            PLAIN,
        ),
        "permeable" => run(comm, file, Laminar { viscosity }, Some(Permeability::new(5.0, 1.0)), PLAIN),
        "patches" => run(comm, file, Laminar { viscosity }, None, PATCHES),
        "periodic" => run(comm, file, Laminar { viscosity }, None, PERIODIC),
        _ => run(comm, file, Laminar { viscosity }, None, PLAIN),
    }
}

/// Conditions on low and high x, y and z.
const PLAIN: [Patch; 6] =
    [Patch::Slip, Patch::Slip, Patch::FarField, Patch::FarField, Patch::FarField, Patch::Outlet];
/// The same with periodic sides.
const PERIODIC: [Patch; 6] =
    [Patch::Periodic, Patch::Periodic, Patch::Periodic, Patch::Periodic, Patch::FarField, Patch::Outlet];
/// The same with patches that [`data`] is for.
const PATCHES: [Patch; 6] =
    [Patch::Slip, Patch::Slip, Patch::Wall, Patch::Inlet, Patch::Inlet, Patch::Outlet];

/// A flow rate, a velocity, a pressure and a sliding wall, each over the time, where the patches are [`PATCHES`].
fn data(
    patches: [Patch; 6],
    grid: &FlowGrid,
    faces: &FaceTable,
    topology: &Topology,
) -> Result<Option<BoundaryValues>, Fault> {
    if patches != PATCHES {
        return Ok(None);
    }
    let factor = |formula: &str| Some(TimeFactor { formula: Some(formula.into()), ..TimeFactor::default() });
    let inlets = [
        InletValues {
            patch: "back".into(),
            flow_rate_m3_s: Some(6.0),
            profile: Some("2 - x^2/3".into()),
            factor: factor("1 + t"),
            ..InletValues::default()
        },
        InletValues { patch: "bottom".into(), velocity_m_s: Some([0.5, 0.0, 4.0]), ..InletValues::default() },
    ];
    let outlets = [OutletValues { patch: "top".into(), pressure_pa: 3.0, factor: factor("exp(-t)") }];
    let wall = MovingWall { patch: "front".into(), ..MovingWall::default() };
    let walls = [MovingWall { velocity_m_s: Some([0.0, 0.0, 2.0]), factor: factor("cos(t)"), ..wall }];
    BoundaryValues::new(&inlets, &outlets, &walls, grid, faces, topology).map_err(Fault::new)
}

fn settings() -> Settings {
    Settings {
        air: Air::new(1.225, 288.15),
        wind: Vec3::new(0.5, 0.0, 4.0),
        residual_drop: 1e-11,
        coupling: None,
        max_iterations: 80,
        method: Method::PressureCorrection { depth: 8 },
        reference_speed: 0.4,
        velocity_diffusion: crate::physics::VELOCITY_DIFFUSION,
        ambient_pressure: 0.0,
        moving: true,
    }
}

fn run<V: Viscosity>(
    comm: &Comm,
    file: &Path,
    viscosity: V,
    cloth: Option<Permeability>,
    patches: [Patch; 6],
) -> Result<Vec<Vec3>, Fault> {
    let (lo, hi) = (Vec3::new(-1.5, -1.5, -1.0), Vec3::new(1.5, 1.5, 2.0));
    let grid = plate_grid([12, 12, 12], lo.into(), hi.into(), patches, 4, [4..8, 3..9]);
    let faces = FaceTable::new(&grid).map_err(Fault::new)?;
    let topology = partitioned(&grid, &faces, comm, true, &FacePermeability::uniform(cloth))?;
    let start: Vec<Vec3> = topology.node_global.iter().map(|&n| grid.coords[n as usize].into()).collect();
    let settings = settings();
    let air = settings.air;
    let (gas, viscosity) = (Isothermal::new(air), viscosity.into());
    let spatial = Spatial { gas, viscosity, chi: 1.0 / 3.0, limiter: None, upwind_share: 0.0 };
    let mut solver = Solver::new(comm, topology, start.clone(), spatial, settings).map_err(Fault::new)?;
    if viscosity.transported() {
        let model = SpalartAllmaras::new(&solver.topology, 2e-3, air.density, ddes);
        solver.set_turbulence(model);
    }
    if let Some(values) = data(patches, &grid, &faces, &solver.topology)? {
        solver.set_boundary_values(values).map_err(Fault::new)?;
    }
    let mut loads = Loads::new(&solver);
    let totals = (grid.cells.len(), grid.coords.len());
    let resumed = file.exists();
    if resumed {
        let saved = state::load(file, &solver.topology, totals)?;
        solver.restore_extras(&saved.extras);
        solver.restore(saved.previous, saved.last_dt, saved.first_order_steps).map_err(Fault::new)?;
        solver.restore_rhie_chow(&saved.rhie_chow_fluxes);
    }
    let dt = 0.02;
    let mut forces = Vec::new();
    for k in if resumed { 2..4 } else { 0..4 } {
        let at = |t: f64, x: &Vec3| {
            let bump = (1.0 - (x[0] / 1.5).powi(2)) * (1.0 - (x[1] / 1.5).powi(2));
            x + Vec3::new(0.05 * bump * t.sin(), 0.0, 0.2 * bump * (2.0 * t).sin())
        };
        let t = f64::from(k + 1) * dt * 5.0;
        for (i, x0) in start.iter().enumerate() {
            let (now, before) = (at(t, x0), at(t - 5.0 * dt, x0));
            solver.nodes[i] = now;
            solver.node_velocity[i] = (now - before) / dt;
        }
        solver.set_boundary_time(t);
        let step = Step { dt, frame: Vec3::new(0.0, 0.1, -0.5), repeat: false, moved: true };
        solver.advance(&step).map_err(Fault::new)?;
        forces.push(loads.compute(&solver).force);
        solver.accept(dt, true);
        if k == 1 {
            solver.save(file, totals)?;
        }
    }
    Ok(forces)
}
