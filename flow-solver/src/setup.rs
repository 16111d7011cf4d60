//! From a scene to this rank's part of its flow grid.

use std::path::{Path, PathBuf};

use case::{Flow, FlowMethod, Role, Scene, Scheme, StageTimes, Wind};
use channel::Fault;
use comm::Comm;
use mesh::{FaceTable, FlowGrid, Graph, QualityReport, StructureMesh};

use crate::face_permeability::FacePermeability;
use crate::geometry::vec3::Vec3;
use crate::physics::{Air, VELOCITY_DIFFUSION};
use crate::shear::WindShear;
use crate::solver::{CouplingIterations, Method, Settings};
use crate::steady::March;
use crate::surface_force::Watched;
use crate::topology::Topology;

/// Flow settings of one stage of a scene.
pub struct Setup {
    /// The scene.
    pub scene: Scene,
    /// Its flow.
    pub flow: Flow,
    /// The canopy.
    pub structure: StructureMesh,
    /// The whole flow grid at the start.
    pub grid: FlowGrid,
    /// Its faces.
    pub faces: FaceTable,
    /// Folder of the stage's results.
    pub folder: PathBuf,
    /// State of an earlier stage to start from.
    pub source: Option<PathBuf>,
    /// State of an earlier stage with an immersed canopy, to start from instead.
    pub handover: Option<PathBuf>,
    /// It is a state of this stage: the run restarts within the stage.
    pub resumed: bool,
    /// Length of the stage's windows, s.
    pub window_s: f64,
    /// Patches of the grid that bodies move in the stage.
    pub moved_patches: Vec<String>,
    /// Tolerances and the undisturbed air.
    pub settings: Settings,
    /// Its velocity over the time of the stage.
    pub wind: Wind,
    /// Its velocity by height.
    pub shear: Option<WindShear>,
    /// Marches to a steady state.
    pub march: Option<March>,
    /// The force that the stage reports, and that a march watches.
    pub watched: Watched,
}

/// How far the residual must fall in a repeated solve, in units of the coupling tolerance: the flow stops at a tenth of the drop of
/// what a coupling iteration brought. With 10 the ATPS at 1e-4 takes 5.2 iterations a window.
const DROP_OF_TOLERANCE: f64 = 10.0;

/// Residual that suffices for the coupling, over that at the start of the step, in units of the coupling tolerance. In the ATPS
/// descent 0.034, 0.05, 0.1 and 0.2 take 436, 437, 446 and 491 coupling iterations.
const SUFFICIENT_FOR_TOLERANCE: f64 = 0.05;
/// The same in units of `flow.solver.residual_drop` at most: a scene whose coupling amplifies errors of the flow asks for a small drop.
const SUFFICIENT_FOR_DROP: f64 = 0.025;

/// What the coupling iterations of a stage need, if it has any.
fn coupling_iterations(scene: &Scene, flow: &Flow, stage: usize) -> Option<CouplingIterations> {
    let iterates =
        scene.stages[stage].kind == case::StageKind::Coupled && scene.coupling.scheme == Scheme::Implicit;
    let (tolerance, drop) = (scene.coupling.tolerance, flow.solver.residual_drop);
    iterates.then(|| CouplingIterations {
        drop: drop.min(DROP_OF_TOLERANCE * tolerance),
        sufficient: (SUFFICIENT_FOR_TOLERANCE * tolerance).min(SUFFICIENT_FOR_DROP * drop),
    })
}

/// Air that the flow of a scene is made of.
fn air(flow: &Flow) -> Air {
    Air::new(flow.density_kg_m3, flow.temperature_k)
}

/// Free-stream speed relative to the canopy at the start of a stage, m/s.
///
/// # Errors
/// A supersonic free stream, or a fixed canopy in a free stream without velocity.
fn speed_at_start(
    scene: &Scene,
    stage: usize,
    flow: &Flow,
    wind: &Wind,
    sheared: bool,
) -> Result<f64, Fault> {
    let stream = Vec3::from(wind.steady()) - Vec3::from(scene.resolved().initial_velocity_m_s);
    let speed = stream.norm();
    let air = air(flow);
    let sound = (air.gas_constant * air.temperature).sqrt();
    if speed >= sound {
        return Err(Fault::new(format!(
            "the free-stream speed relative to the canopy is {speed:.1} m/s, above the speed of sound ({sound:.1} m/s); \
             flow-solver supports subsonic flow only; lower wind_m_s or initial_speed_m_s"
        )));
    }
    let still = speed == 0.0 && !scene.has_stage_wind() && !sheared && !flow.is_driven();
    if still && scene.stages[stage].kind == case::StageKind::FlowOnly {
        return Err(Fault::new(format!(
            "stage {stage} runs the flow around a fixed canopy, but the free stream has no velocity: \
             set descent.initial_speed_m_s, flow.wind_m_s, the velocity of an inlet, [[flow.inlet]], or flow.body_force_n_m3"
        )));
    }
    Ok(speed)
}

/// Pressure that moves a free canopy, Pa: the weight per area of fabric, and the prescribed pressures of the stages up to `stage`.
fn largest_pressure(scene: &Scene, stage: usize, structure: &StructureMesh) -> f64 {
    let area = structure.fabric_area(|_| true).max(f64::MIN_POSITIVE);
    let areal_mass = scene.fabric.thickness_m * scene.fabric.density_kg_m3;
    let weight =
        scene.descent.as_ref().map_or(0.0, |d| (d.payload_mass_kg / area + areal_mass) * d.gravity_m_s2);
    let prescribed = scene.stages[..=stage].iter().filter_map(|s| s.pressure_pa);
    prescribed.fold(weight, |most, p| most.max(p.abs()))
}

/// Share of the speeds that a flow can reach later, where its stream is slower at the start.
const LATER: f64 = 0.2;

/// Speed scale of the flow in a stage, m/s; it has no absolute floor, so that the answer does not depend on units. The speed of the free
/// stream relative to the canopy at the start (`speed`), at least a fifth of the largest of
/// - that speed at any later time of the stage, with its gust;
/// - prescribed motions of the canopy;
/// - the wind at any height, where it changes with height;
/// - where the canopy moves freely, the speed $`\sqrt{2 p / \rho}`$ whose dynamic pressure is [`largest_pressure`].
///
/// 0 where none of these moves the air: then the data of patches do, or nothing ([`Solver::set_speed_scale`](crate::Solver::set_speed_scale)).
fn speed_scale(scene: &Scene, stage: usize, structure: &StructureMesh, wind: &Wind, speed: f64) -> f64 {
    let plan = &scene.stages[stage];
    let resolved = scene.resolved();
    let air = resolved.canopy_air;
    let [_, blown] = wind.fastest(plan.duration_s, resolved.initial_velocity_m_s);
    let moved = plan.motions.iter().flat_map(|m| {
        let steps = m.time_s.windows(2).zip(m.displacement_m.windows(2));
        steps.map(|(t, d)| (Vec3::from(d[1]) - Vec3::from(d[0])).norm() / (t[1] - t[0]))
    });
    let loaded = match plan.kind {
        case::StageKind::Coupled => {
            (2.0 * largest_pressure(scene, stage, structure) / air.density_kg_m3).sqrt()
        }
        _ => 0.0,
    };
    let turned = mesh::canopy_speed(scene, plan, &structure.coords[..structure.n_canopy]);
    let later = moved.fold(blown.max(loaded).max(turned), f64::max);
    speed.max(LATER * later)
}

/// Largest wind of a shear over the height of a grid, m/s.
fn largest_wind(shear: &WindShear, grid: &FlowGrid) -> f64 {
    grid.coords.iter().map(|x| (shear.base() + shear.excess(x[2])).norm()).fold(0.0, f64::max)
}

/// Speed of air that the force on it has moved across the grid, $`\sqrt{2 f L / \rho}`$, m/s.
fn forced_speed(flow: &Flow, grid: &FlowGrid) -> f64 {
    let extent = |c: usize| {
        let along = grid.coords.iter().map(|x| x[c]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    let length = [0, 1, 2].map(extent).into_iter().fold(0.0, f64::max);
    (2.0 * flow.body_force() * length / flow.density_kg_m3).sqrt()
}

/// How the steps of a stage are solved; `wind` is that of its start, `speed` the [`speed_scale`] of the stage, m/s.
fn settings(scene: &Scene, stage: usize, flow: &Flow, wind: Vec3, speed: f64) -> Settings {
    let plan = &scene.stages[stage];
    let moving = plan.kind != case::StageKind::FlowOnly;
    Settings {
        air: air(flow),
        wind,
        residual_drop: flow.solver.residual_drop,
        coupling: coupling_iterations(scene, flow, stage),
        max_iterations: flow.solver.iterations() as usize,
        method: match flow.solver.method {
            // Long steps of a march to a steady state need more stored corrections.
            FlowMethod::Gmres if plan.steady.is_some() => Method::PressureCorrection { depth: 10 },
            // Coupling iterations reuse the differences of earlier ones.
            FlowMethod::Gmres => Method::PressureCorrection { depth: if moving { 5 } else { 4 } },
            FlowMethod::LuSgs => Method::LuSgs { courant: 1e3 },
        },
        reference_speed: 0.1 * speed,
        velocity_diffusion: VELOCITY_DIFFUSION,
        ambient_pressure: scene.ambient_pressure(),
        moving,
    }
}

/// The canopy, and the whole grid that is fitted to it at the start of `stage`.
///
/// # Errors
/// An unreadable shape, or no grid around it.
pub fn start_grid(scene: &Scene, stage: usize, out: &Path) -> Result<(StructureMesh, FlowGrid), Fault> {
    let structure = mesh::structure_mesh(scene).map_err(Fault::new)?;
    let positions = match scene.grid_shape(out, stage) {
        Some(file) => mesh::load_shape(&file, structure.n_canopy).map_err(Fault::new)?,
        None => structure.coords[..structure.n_canopy].to_vec(),
    };
    let grid = mesh::flow_grid(scene, &structure, &positions).map_err(Fault::new)?;
    Ok((structure, grid))
}

impl Setup {
    /// Builds the grid of `stage`. The same on every rank.
    ///
    /// # Errors
    /// A scene without a flow, and what the mesh crate finds wrong.
    pub fn new(scene: Scene, stage: usize, out: &Path) -> Result<Self, Fault> {
        let flow = scene.flow.as_ref().ok_or_else(|| {
            Fault::new(format!(
                "scene `{}` has a stage that runs the flow, but no section [flow]; add one",
                scene.name
            ))
        })?;
        let (structure, grid) = start_grid(&scene, stage, out)?;
        let faces = FaceTable::new(&grid).map_err(Fault::new)?;
        let shear = flow.shear.as_ref().map(|s| WindShear::of_scene(s, flow.wind_m_s.into()));
        let wind = scene.wind(stage, &StageTimes::completed(&scene, out, stage));
        let wind = match &shear {
            None => wind,
            Some(shear) => wind.with_steady(shear.base().into()),
        };
        if shear.is_some() && faces.periodic.periods.iter().any(|p| p[2].abs() > 1e-6 * Vec3::from(*p).norm())
        {
            return Err(Fault::new(
                "the wind of [flow.shear] changes with height, but periodic patches lie above each other: \
                 remove [flow.shear] or choose another condition for them",
            ));
        }
        let speed = speed_at_start(&scene, stage, flow, &wind, shear.is_some())?;
        let sheared = shear.as_ref().map_or(0.0, |s| largest_wind(s, &grid));
        let plan = &scene.stages[stage];
        let scale = speed_scale(&scene, stage, &structure, &wind, speed);
        let driven = forced_speed(flow, &grid).max(mesh::body_speed(plan, &grid));
        let scale = scale.max(LATER * sheared.max(driven));
        let march = plan.steady.as_ref().map(|s| March {
            residual_drop: s.residual_drop,
            force_change: s.force_change,
            max_steps: s.max_steps as usize,
            max_courant: s.max_courant,
        });
        let watched = Watched::of(&scene, plan.kind, &grid.patch_names);
        let state = scene.source_state(out, stage, Role::Flow);
        let before = scene.source_stage(stage, Role::Flow);
        let immersed = before.is_some_and(|s| scene.is_immersed(&scene.stages[s]));
        let (source, handover) = if immersed { (None, state) } else { (state, None) };
        Ok(Self {
            source,
            handover,
            folder: case::stage_folder(out, &scene, stage),
            window_s: plan.window_s,
            moved_patches: plan.body_motions.iter().flat_map(|m| m.patches.clone()).collect(),
            settings: settings(&scene, stage, flow, wind.at(0.0).into(), scale),
            flow: flow.clone(),
            structure,
            grid,
            faces,
            resumed: false,
            wind,
            shear,
            march,
            watched,
            scene,
        })
    }

    /// Restarts within the stage from the state that the flow saved in `folder`.
    pub fn resume(self, folder: &Path) -> Self {
        Self { source: Some(case::state_file(folder, Role::Flow)), handover: None, resumed: true, ..self }
    }

    /// Writes what the grid is like to `grid.txt` in the stage's folder.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn report_grid(&self) -> Result<(), Fault> {
        let file = self.folder.join("grid.txt");
        std::fs::create_dir_all(&self.folder)
            .and_then(|()| std::fs::write(&file, QualityReport::new(&self.grid, &self.faces).to_string()))
            .map_err(|e| Fault::new(format!("cannot write {}: {e}", file.display())))
    }

    /// Partitions the grid and takes this rank's part of it.
    ///
    /// # Errors
    /// More ranks than cells.
    pub fn topology(&self, comm: &Comm, viscous: bool) -> Result<Topology, Fault> {
        let cloth = FacePermeability::of_scene(&self.scene, &self.structure, self.flow.density_kg_m3);
        partitioned(&self.grid, &self.faces, comm, viscous, &cloth)
    }
}

/// This rank's part of `grid`, split by METIS, its cells ordered for the cache, with a canopy
/// of permeability `cloth`.
///
/// # Errors
/// More ranks than cells.
pub fn partitioned(
    grid: &FlowGrid,
    faces: &FaceTable,
    comm: &Comm,
    viscous: bool,
    cloth: &FacePermeability,
) -> Result<Topology, Fault> {
    let cells = grid.cells.len();
    let graph = Graph::of_cells(cells, faces);
    let part = match comm.size() {
        1 => vec![0; cells],
        n => graph.partition(n, None).map_err(Fault::new)?,
    };
    let order = graph.cuthill_mckee();
    Ok(Topology::with_cloth(grid, faces, &part, &order, comm.rank() as u32, viscous, cloth))
}
