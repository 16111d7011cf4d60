//! The immersed flow as the rest of the system sees it.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Instant as Clock;

use case::{FlowDevice, Role, Scene, StageKind, StageTimes, Turbulence, Wind};
use channel::{Announcement, Fault, Input, LOAD_WIDTH, Participant, Stats, Window, flow_stats, surface_hash};
use comm::Comm;
use immersed::constraints::FluxConstraints;
use immersed::device::Device;
use immersed::eddy_viscosity::SubgridModel;
use immersed::flow::{Flow, FlowState, Settings};
use immersed::grid::Grid;
use immersed::momentum::{Momentum, laminar_upwind_share};
use immersed::placement::{Placement, bounds, lets_out};
use immersed::slabs::{Ranks, share};
use mesh::StructureMesh;
use nalgebra::Vector3;

use super::canopy::CanopySurface;
use super::cut::Cut;
use super::force_along::MeanForceAlong;
use super::forces::{CanopyForces, LoadedFace};
use super::moving_grid::MovingGrid;
use super::ranks::FlowRanks;
use super::snapshot::{Place, Snapshots};
use super::state::{Kinematics, Saved};
use super::step::{AroundCanopy, OpenWindow, Solution, Start};
use super::wind_by_height::{Climb, WindByHeight};
use crate::face_permeability::FacePermeability;
use crate::handover;

/// Residual of the constraints relative to that without pressure jumps, in units of `flow.solver.residual_drop`.
const TOLERANCE_OF_DROP: f64 = 1e-2;
/// The same in units of the coupling tolerance.
const TOLERANCE_OF_COUPLING: f64 = 0.05;
/// Pressure jump below which the resistance of cloth is taken as constant, in units of rho U^2.
const LINEAR_CLOTH: f64 = 1e-4;

/// The flow-solver around an immersed canopy.
pub struct ImmersedParticipant {
    surface: CanopySurface,
    /// Faces whose load this rank returns.
    faces: Range<usize>,
    structure: StructureMesh,
    flow: Flow,
    /// Whether the upwind share follows from the cell Reynolds number of each window: in laminar flow without a share of the scene.
    share_by_resolution: bool,
    grid: MovingGrid,
    /// Whether the canopy moves in this stage.
    moving: bool,
    /// Wind at all heights: at the frame's origin at the start, with gusts.
    wind: Wind,
    /// What it has more at each height.
    by_height: Option<WindByHeight>,
    cloth: FacePermeability,
    sound: f64,
    /// Accepted positions of the canopy in the falling frame, m, and velocities, m/s.
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    /// Accepted velocity of the frame, m/s.
    frame: Vector3<f64>,
    /// Cut and prediction of the last accepted step, and the vertices of the surface in the grid at its end.
    last: Option<(Cut, AroundCanopy)>,
    /// Flow from which the first window after a start from a fitted grid begins, until it is accepted. The state of that grid does not have the velocity of the
    /// frame: the window sets it to that at its end.
    handed_over: Option<FlowState>,
    /// Pressure jumps there, Pa.
    last_jumps: Vec<f64>,
    /// Mean force of the air along the fabric until the last accepted window.
    along: MeanForceAlong,
    /// Friction on the canopy in the last accepted window, N.
    last_friction: Vector3<f64>,
    vertices: Vec<Vector3<f64>>,
    open: Option<OpenWindow>,
    /// Input of the last solution: positions, and the velocity of the frame.
    trial: Option<(Vec<Vector3<f64>>, Vector3<f64>)>,
    /// Its forces on the faces, where there is a table of them.
    loaded: Vec<LoadedFace>,
    /// `forces.csv`, where the scene asks for it, and the ranks that write it.
    forces: Option<CanopyForces>,
    ranks: Rc<FlowRanks>,
    failure: Option<Fault>,
    snapshots: Snapshots,
    time: f64,
}

/// What a stage starts from.
struct Begin {
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    frame: Vector3<f64>,
}

/// Creates the participant of `stage`; `resume`: folder of a state within the stage.
///
/// # Errors
/// More ranks than the grid has slabs, a saved state that does not fit.
pub fn participant(
    scene: &Scene,
    stage: usize,
    out: &Path,
    resume: Option<&Path>,
    comm: &Comm,
) -> Result<ImmersedParticipant, Fault> {
    let structure = mesh::structure_mesh(scene).map_err(Fault::new)?;
    let surface = CanopySurface::new(&structure);
    let begin = Begin::of(scene, stage, out, &structure)?;
    let ranks = Rc::new(FlowRanks(comm.clone()));
    let mut participant = ImmersedParticipant::new(scene, stage, out, (structure, surface), begin, ranks)?;
    let state = |folder: &Path| case::state_file(folder, Role::Flow);
    match (resume, scene.source_stage(stage, Role::Flow)) {
        (Some(folder), _) => participant.restore(&state(folder), true)?,
        (None, Some(source)) if !scene.is_immersed(&scene.stages[source]) => {
            participant.start_from_fitted(scene, source, out)?;
        }
        (None, Some(source)) => {
            let file = state(&case::state_folder(out, scene, source));
            participant.restore(&file, !moved_since(scene, stage))?;
        }
        (None, None) => {}
    }
    if resume.is_some() {
        participant.snapshots = Snapshots::resume(&case::stage_folder(out, scene, stage));
    }
    participant.report_grid(&case::stage_folder(out, scene, stage))?;
    Ok(participant)
}

/// Whether a stage without flow has moved the canopy since the last stage with one.
fn moved_since(scene: &Scene, stage: usize) -> bool {
    scene.source_stage(stage, Role::Structure) > scene.source_stage(stage, Role::Flow)
}

impl Begin {
    /// The shape that the structure's last stage left, at rest in the frame of the start.
    fn of(scene: &Scene, stage: usize, out: &Path, structure: &StructureMesh) -> Result<Self, Fault> {
        let n = structure.n_canopy;
        let shape: Option<PathBuf> = scene
            .source_stage(stage, Role::Structure)
            .map(|s| case::canopy_file(&case::state_folder(out, scene, s)));
        let positions = match shape {
            Some(file) => mesh::load_shape(&file, n).map_err(Fault::new)?,
            None => structure.coords[..n].to_vec(),
        };
        let frame = scene.resolved().initial_velocity_m_s.into();
        Ok(Self {
            positions: positions.into_iter().map(Vector3::from).collect(),
            velocities: vec![Vector3::zeros(); n],
            frame,
        })
    }
}

/// Difference of the wind in the middle of the canopy from that at all heights, m/s.
fn excess(by_height: Option<&WindByHeight>, canopy: &[Vector3<f64>]) -> Vector3<f64> {
    let Some(shear) = by_height else { return Vector3::zeros() };
    let [low, high] = bounds(canopy);
    shear.excess(0.5 * (low.z + high.z))
}

/// The sizes that a scene asks for.
fn placement(g: &case::Immersed) -> Placement {
    Placement {
        spacing: g.spacing_m,
        room: g.room,
        wake: g.wake,
        far_field: g.far_field,
        far_wake: g.far_wake,
        growth: g.growth,
    }
}

/// Whether the air is viscous and has no model of turbulence.
fn is_laminar(air: &case::Flow) -> bool {
    air.viscosity.as_ref().is_some_and(|v| v.turbulence.is_none() && v.dynamic_viscosity_pa_s > 0.0)
}

/// The model of unresolved turbulence that a scene asks for.
fn subgrid_model(air: &case::Flow) -> Result<Option<SubgridModel>, Fault> {
    match air.viscosity.as_ref().and_then(|v| v.turbulence) {
        None => Ok(None),
        Some(Turbulence::Smagorinsky) => Ok(Some(SubgridModel::Smagorinsky)),
        Some(Turbulence::Wale) => Ok(Some(SubgridModel::Wale)),
        Some(Turbulence::SpalartAllmaras | Turbulence::Des97 | Turbulence::Ddes) => {
            Err(Fault::new("the immersed flow has the turbulence models smagorinsky and wale only"))
        }
    }
}

/// The GPU of this process.
#[cfg(feature = "gpu")]
fn gpu() -> Result<Rc<dyn Device>, Fault> {
    gpu::open().map_err(|e| Fault::new(format!("flow.immersed.device = \"gpu\": {e}")))
}

/// The GPU of this process: this build has none.
#[cfg(not(feature = "gpu"))]
fn gpu() -> Result<Rc<dyn Device>, Fault> {
    Err(Fault::new(
        "flow.immersed.device = \"gpu\": this flow-solver was built without it; cargo build --release --locked --features flow-solver/gpu",
    ))
}

/// Tolerance of the solves of a stage: what coupling iterations bring needs a smaller one.
fn tolerance(scene: &Scene, air: &case::Flow, kind: StageKind) -> f64 {
    let drop = TOLERANCE_OF_DROP * air.solver.residual_drop;
    match kind {
        StageKind::Coupled => drop.min(TOLERANCE_OF_COUPLING * scene.coupling.tolerance),
        _ => drop,
    }
}

/// Of a flow that is solved to `tolerance`.
fn settings(air: &case::Flow, tolerance: f64) -> Settings {
    let density = air.density_kg_m3;
    let viscosity = air.viscosity.as_ref().map_or(0.0, |v| v.dynamic_viscosity_pa_s / density);
    let momentum = Momentum { upwind_share: air.upwind_share(), viscosity };
    Settings { density, far: Vector3::zeros(), momentum, tolerance }
}

/// Undisturbed flow on `grid`, solved to `tolerance`, on the ranks or the GPU that the scene asks for.
fn undisturbed(grid: Grid, air: &case::Flow, tolerance: f64, ranks: Rc<FlowRanks>) -> Result<Flow, Fault> {
    let mut flow = Flow::on_ranks(grid, settings(air, tolerance), ranks).map_err(Fault::new)?;
    flow.set_subgrid_model(subgrid_model(air)?);
    if air.immersed.as_ref().is_some_and(|g| g.device == FlowDevice::Gpu) {
        flow.set_device(Some(gpu()?)).map_err(Fault::new)?;
    }
    Ok(flow)
}

impl ImmersedParticipant {
    fn new(
        scene: &Scene,
        stage: usize,
        out: &Path,
        (structure, surface): (StructureMesh, CanopySurface),
        begin: Begin,
        ranks: Rc<FlowRanks>,
    ) -> Result<Self, Fault> {
        let missing = || Fault::new("the scene has no [flow.immersed]");
        let air = scene.flow.as_ref().ok_or_else(missing)?;
        let sizes = placement(air.immersed.as_ref().ok_or_else(missing)?);
        let wind = scene.wind(stage, &StageTimes::completed(scene, out, stage));
        let by_height = WindByHeight::of_scene(air);
        let wind = match &by_height {
            Some(shear) => wind.with_steady(shear.base().into()),
            None => wind,
        };
        let kind = scene.stages[stage].kind;
        let tolerance = tolerance(scene, air, kind);
        let stream = Vector3::from(wind.at(0.0)) + excess(by_height.as_ref(), &begin.positions) - begin.frame;
        let (grid, cells) = MovingGrid::around(sizes, &begin.positions, stream).map_err(Fault::new)?;
        let cloth = FacePermeability::of_scene(scene, &structure, air.density_kg_m3);
        let mut flow = undisturbed(cells, air, tolerance, ranks.clone())?;
        if let Some(shear) = &by_height {
            let far = |z: f64| shear.excess(grid.origin.z + z);
            flow.set_far_by_height(far, far);
            flow.start_undisturbed();
        }
        Ok(Self {
            share_by_resolution: is_laminar(air) && air.convection.upwind_share.is_none(),
            flow,
            faces: share(surface.len(), ranks.rank(), ranks.size()),
            along: MeanForceAlong::zero(surface.len()),
            surface,
            structure,
            grid,
            moving: kind != StageKind::FlowOnly,
            wind,
            by_height,
            cloth,
            sound: air.sound_speed(),
            positions: begin.positions,
            velocities: begin.velocities,
            frame: begin.frame,
            last: None,
            handed_over: None,
            last_jumps: Vec::new(),
            last_friction: Vector3::zeros(),
            vertices: Vec::new(),
            open: None,
            trial: None,
            loaded: Vec::new(),
            forces: CanopyForces::new(scene, &case::stage_folder(out, scene, stage))?,
            ranks,
            failure: None,
            snapshots: Snapshots::default(),
            time: 0.0,
        })
    }

    fn is_root(&self) -> bool {
        self.flow.slabs().ranks().rank() == 0
    }

    /// Writes the sizes of the grid to `grid.txt` in the stage's folder.
    fn report_grid(&self, folder: &Path) -> Result<(), Fault> {
        if !self.is_root() {
            return Ok(());
        }
        let grid = &self.flow.grid;
        let [x, y, z] = grid.cells();
        let nodes = (x + 1) * (y + 1) * (z + 1);
        let spacing = grid.axes[0].spacing;
        let text = format!(
            "{} cells (Cartesian, {x} x {y} x {z}; even ones of {spacing} m around the immersed canopy), {nodes} nodes\n",
            grid.count()
        );
        let file = folder.join("grid.txt");
        std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(&file, text))
            .map_err(|e| Fault::new(format!("cannot write {}: {e}", file.display())))
    }

    /// Starts from the flow that stage `source` left on its fitted grid.
    fn start_from_fitted(&mut self, scene: &Scene, source: usize, out: &Path) -> Result<(), Fault> {
        let wind = self.wind.at(0.0).into();
        handover::start_immersed(&mut self.flow, (self.grid.origin, wind), (scene, source, out))?;
        self.handed_over = Some(self.flow.state());
        Ok(())
    }

    /// Continues from the state in `file`; `with_canopy`: from its canopy too.
    fn restore(&mut self, file: &Path, with_canopy: bool) -> Result<(), Fault> {
        let unfit = |what: String| {
            Fault::new(format!("flow state: {}", archive::Error::content(file, format!("it {what}"))))
        };
        let vertices = self.surface.vertices(&self.positions, Vector3::zeros()).len();
        let (grid, state, motion) =
            Saved::load(file)?.parts(self.structure.n_canopy, vertices).map_err(unfit)?;
        let ranks = self.flow.slabs().ranks().clone();
        let mut flow = Flow::on_ranks(grid, self.flow.settings, ranks).map_err(Fault::new)?;
        flow.set_subgrid_model(self.flow.subgrid_model());
        let device = self.flow.device();
        self.flow.set_device(None).map_err(Fault::new)?;
        flow.set_device(device).map_err(Fault::new)?;
        flow.restore(state).ok_or_else(|| unfit("is of another grid".into()))?;
        self.flow = flow;
        let Kinematics { origin, home, new_grids, .. } = motion;
        if motion.along.len() != self.surface.len() {
            return Err(unfit(format!(
                "has {} faces, this canopy {}",
                motion.along.len(),
                self.surface.len()
            )));
        }
        self.along = MeanForceAlong(motion.along);
        self.grid = MovingGrid { placement: self.grid.placement, origin, home, new_grids };
        self.frame = motion.frame;
        if let (Some(shear), Some(height)) = (&mut self.by_height, motion.height) {
            shear.height = height;
        }
        if with_canopy {
            (self.positions, self.velocities) = (motion.positions, motion.velocities);
        }
        if !motion.vertices.is_empty() {
            let cut = Cut::new(&self.flow, &self.surface, &motion.vertices);
            let cut = cut.map_err(|e| unfit(format!("does not fit: {e}")))?;
            self.last_jumps = self.flow.jumps().to_vec();
            if self.last_jumps.len() != cut.faces.rows.len() {
                return Err(unfit("has pressure jumps of another canopy".into()));
            }
            self.last = Some((cut, AroundCanopy::default()));
            self.vertices = motion.vertices;
        }
        Ok(())
    }

    /// Mean wind over the window, m/s.
    fn mean_wind(&self, w: &Window) -> Vector3<f64> {
        0.5 * (Vector3::from(self.wind.at(w.time)) + Vector3::from(self.wind.at(w.time + w.dt)))
    }

    /// Velocity of the frame relative to the mean wind over the window, m/s, if it has the velocity `end` at its end.
    fn mean_frame(&self, w: &Window, end: Vector3<f64>) -> Vector3<f64> {
        0.5 * (self.frame + end) - self.mean_wind(w)
    }

    /// Difference of the wind at the canopy from that of the frame's origin at the start, m/s.
    fn excess(&self) -> Vector3<f64> {
        excess(self.by_height.as_ref(), &self.positions)
    }

    /// The velocity at which the grid starts its window relative to the wind at all heights and to that at the canopy, m/s, after it was moved to the canopy: a
    /// new one is made where the canopy leaves the even cells, or air would enter through an outflow because the local wind has changed its direction.
    fn move_grid(&mut self, w: &Window) -> Result<[Vector3<f64>; 2], Fault> {
        let relative = self.frame - Vector3::from(self.wind.at(w.time));
        let local = relative - self.excess();
        let start = self.start(relative);
        let expected = super::step::predicted(&start, w.dt, self.grid.placement.spacing);
        let all: Vec<_> = self.positions.iter().chain(&expected).copied().collect();
        let turned = self.by_height.is_some() && !lets_out(&self.flow.grid, -local);
        if turned || !self.grid.contains(&self.flow.grid, &all) {
            let far = self.by_height.as_ref().map(|shear| |z: f64| shear.excess(z));
            let far = far.as_ref().map(|far| far as &dyn Fn(f64) -> Vector3<f64>);
            self.grid.follow(&mut self.flow, &all, -local, far).map_err(Fault::new)?;
            (self.last, self.last_jumps, self.vertices) = (None, Vec::new(), Vec::new());
            if self.is_root() {
                let [x, y, z] = self.flow.grid.cells();
                println!(
                    "window {} (t = {:.4} s): new grid of {x} x {y} x {z} cells around the canopy",
                    w.index, w.time
                );
            }
        }
        Ok([relative, local])
    }

    /// What a window starts from, without the way of its grid.
    fn start(&self, relative: Vector3<f64>) -> Start<'_> {
        Start {
            positions: &self.positions,
            velocities: &self.velocities,
            origin: self.grid.origin,
            frame: relative,
            climb: None,
        }
    }

    /// Opens a window: moves the grid, cuts it, and connects cuts and faces.
    fn open(&mut self, w: &Window) -> Result<(), Fault> {
        if self.handed_over.is_some() {
            self.frame = w.frame_velocity.into();
        }
        let wrong = |e| {
            Fault::new(format!("window {} (t = {:.4} s): {e}; raise flow.immersed.room", w.index, w.time))
        };
        let [relative, local] = self.move_grid(w)?;
        let drift =
            if self.moving { self.grid.drift(&self.positions, local.norm()) } else { Vector3::zeros() };
        if self.share_by_resolution {
            let speed = self.flow.largest_speed(relative + drift);
            let momentum = &mut self.flow.settings.momentum;
            momentum.upwind_share =
                laminar_upwind_share(speed * self.grid.placement.spacing / momentum.viscosity);
        }
        let at = (w.index, w.dt);
        let motion = [relative + drift, drift];
        // Over the window the grid moves with the mean wind, as `accept` has it.
        let climb = self.by_height.clone().map(|wind| Climb {
            wind,
            origin: self.grid.origin.z,
            velocity: motion[0].z + self.mean_wind(w).z,
        });
        let start = Start {
            positions: &self.positions,
            velocities: &self.velocities,
            origin: self.grid.origin,
            frame: relative,
            climb,
        };
        let mut open = OpenWindow::new(&mut self.flow, &self.surface, &start, at, motion, self.last.as_ref())
            .map_err(wrong)?;
        if !self.moving {
            open.solve_once();
        }
        let jumps = match &self.last {
            Some((last, _)) => open.cuts[0].faces.transfer(&last.faces, &self.last_jumps),
            None => Vec::new(),
        };
        let floor = LINEAR_CLOTH * self.flow.settings.density * local.norm_squared();
        open.set_cloth(&self.cloth, &jumps, floor.max(f64::MIN_POSITIVE));
        open.start_from(&mut self.flow, jumps);
        self.open = Some(open);
        Ok(())
    }

    /// Takes the force along the fabric at the end of an accepted window of `dt` s, in air that meets the grid at `velocity` (m/s), into its mean.
    fn update_force_along(&mut self, dt: f64, velocity: Vector3<f64>) {
        let viscosity = self.flow.settings.momentum.viscosity;
        let Some((cut, _)) = self.last.as_ref().filter(|_| viscosity > 0.0) else { return };
        let mut forces = vec![Vector3::zeros(); self.surface.len()];
        cut.transfer.add_forces_along(&self.last_jumps, &mut forces);
        let cell = velocity.norm() * self.grid.placement.spacing / viscosity;
        let resolved = 1.0 - laminar_upwind_share(cell);
        forces.iter_mut().for_each(|f| *f *= resolved);
        let [low, high] = bounds(&self.positions);
        self.along.update(&forces, dt, (high - low).amax() / velocity.norm());
    }

    /// What the air lost in the last accepted window, N: by pressure at all cut faces, in all directions, and by friction.
    pub fn losses_of_air(&self) -> [Vector3<f64>; 2] {
        let of_rows = |rows: &FluxConstraints| -> Vector3<f64> {
            self.last_jumps.iter().enumerate().map(|(r, jump)| rows.weight_by_axis(r) * *jump).sum()
        };
        [self.last.iter().map(|(cut, _)| of_rows(&cut.faces.rows)).sum(), self.last_friction]
    }

    /// Mean force of the air along the fabric, N: a part of the load in the next window.
    pub fn mean_force_along(&self) -> Vector3<f64> {
        self.along.0.iter().sum()
    }

    /// In the first window after a start from a fitted grid: solves the window once and opens it again with the result, so that the velocity becomes one
    /// without divergence around the moving canopy. The change acts on no canopy.
    fn start_up(&mut self, w: &Window, face_velocities: &[Vector3<f64>]) -> Result<(), Fault> {
        if let Some(mut open) = self.open.take_if(|_| self.handed_over.is_some()) {
            open.solve(&mut self.flow, face_velocities);
            self.last = open.accept(&mut self.flow);
            self.last_jumps = self.flow.jumps().to_vec();
            self.open(w)?;
        }
        Ok(())
    }

    /// Before the first window after a start from a fitted grid is opened once more: returns to the flow of that start.
    fn return_to_start(&mut self) {
        if let Some(state) = self.handed_over.clone()
            && self.flow.restore(state).is_some()
        {
            (self.last, self.last_jumps) = (None, Vec::new());
        }
    }

    /// Share of upwind differences in the window that is solved.
    pub fn upwind_share(&self) -> f64 {
        self.flow.settings.momentum.upwind_share
    }

    fn stats(&self, open: &OpenWindow, solution: &Solution) -> [f64; channel::STATS] {
        let mut values = [0.0; channel::STATS];
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for (x, f) in self.surface.means(&open.nodes).iter().zip(&solution.forces) {
            force += f;
            moment += x.cross(f);
        }
        values[flow_stats::FORCE..][..3].copy_from_slice(force.as_slice());
        values[flow_stats::MOMENT..][..3].copy_from_slice(moment.as_slice());
        let tolerance = self.flow.settings.tolerance;
        values[flow_stats::RESIDUAL_START] = 1.0;
        values[flow_stats::RESIDUAL_END] = solution.residual;
        values[flow_stats::RESIDUAL_TARGET] = tolerance;
        values[flow_stats::UNCONVERGED] = f64::from(u8::from(solution.residual > tolerance));
        values[flow_stats::ITERATIONS] = open.cuts.len() as f64;
        values[flow_stats::LINEAR_ITERATIONS] = solution.iterations as f64;
        values[flow_stats::MAX_COURANT] = open.courant;
        values[flow_stats::MASS_DEFECT] = self.flow.settings.density * solution.leakage;
        let [low, high] = open.jumps.as_ref().map_or([0.0; 2], |jumps| {
            jumps.jump.iter().fold([0.0f64; 2], |[low, high], p| [low.min(*p), high.max(*p)])
        });
        (values[flow_stats::MIN_PRESSURE], values[flow_stats::MAX_PRESSURE]) = (low, high);
        values[flow_stats::MAX_MACH] = open.speed / self.sound;
        values
    }
}

impl Participant for ImmersedParticipant {
    fn announce(&self) -> Announcement {
        let mut effects = vec![
            channel::RESUME,
            "flow",
            "flow.immersed",
            "flow.gust",
            "flow.shear",
            "flow.viscosity",
            "flow.viscosity.turbulence",
            channel::STAGE_WIND,
            channel::GUST_SHAPE,
            channel::GUST_TURBULENCE,
            channel::PERTURBATION,
            channel::STAGE_ALTITUDE,
            channel::LAYERED_TURBULENCE,
            "fabric.permeability",
            "canopy.fabric.permeability",
            "coupling.adaptive",
        ];
        if self.moving {
            effects.push(channel::CANOPY_MOTION);
        }
        Announcement {
            role: Role::Flow.name().into(),
            program: env!("CARGO_PKG_NAME").into(),
            version: env!("CARGO_PKG_VERSION").into(),
            canopy_nodes: self.structure.n_canopy as u64,
            canopy_faces: self.structure.faces.len() as u64,
            surface_hash: surface_hash(&self.structure.faces),
            grid_nodes: 0,
            output_width: LOAD_WIDTH as u64,
            effects: effects.into_iter().map(String::from).collect(),
        }
    }

    fn description(&self) -> Vec<String> {
        let grid = &self.flow.grid;
        let [x, y, z] = grid.cells();
        let device =
            self.flow.device().map_or_else(String::new, |device| format!(" on a GPU, {},", device.name()));
        vec![format!(
            "Cartesian grid of {} cells ({x} x {y} x {z}){device} with {} immersed faces, {} of them on this rank; projection to {:.1e}",
            grid.count(),
            self.surface.len(),
            self.faces.len(),
            self.flow.settings.tolerance
        )]
    }

    fn output_rows(&self) -> Vec<u64> {
        (self.faces.start as u64..self.faces.end as u64).collect()
    }

    fn waited_s(&self) -> f64 {
        self.ranks.0.waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let _part = timing::part("advance");
        let clock = Clock::now();
        self.failure = None;
        let opens = self.open.as_ref().is_none_or(|o| (o.index, o.dt) != (w.index, w.dt));
        if opens {
            if let Some(mut open) = self.open.take() {
                open.reject(&mut self.flow);
            }
            self.return_to_start();
            self.open(w)?;
        }
        let end: Vector3<f64> = w.frame_velocity.into();
        let frame = self.mean_frame(w, end);
        let positions: Vec<Vector3<f64>> = if input.canopy.is_empty() {
            self.positions.clone()
        } else {
            let moved = self.structure.coords.iter().zip(input.canopy.chunks_exact(3));
            moved.map(|(x, d)| Vector3::from(*x) + Vector3::from_column_slice(d)).collect()
        };
        let moved = positions.iter().zip(&self.positions);
        let velocities: Vec<_> = moved.map(|(end, start)| (end - start) / w.dt + frame).collect();
        let velocities = self.surface.means(&velocities);
        if opens {
            self.start_up(w, &velocities)?;
        }
        let mut open = self.open.take().expect("just opened");
        let mut solution = open.solve(&mut self.flow, &velocities);
        self.along.add_to(&mut solution.forces);
        self.surface.loads(self.faces.clone(), &open.nodes, &solution.forces, output);
        if let Some(error) = self.flow.device_failure() {
            return Err(Fault::new(format!("window {} (t = {:.4} s): {error}", w.index, w.time)));
        }
        let mut values = self.stats(&open, &solution);
        let forces = solution.forces.iter().flatten();
        if !forces.chain(&values).all(|x| x.is_finite()) {
            open.reject(&mut self.flow);
            let words = format!(
                "window {} (t = {:.4} s): flow: the immersed flow diverged; shorten window_s, set flow.convection.upwind_share = 1, or \
                 raise flow.immersed.spacing_m",
                w.index, w.time
            );
            if self.is_root() {
                eprintln!("flow-solver: {words}");
            }
            self.failure = Some(Fault::new(words));
            output.fill(0.0);
            values = [0.0; channel::STATS];
            values[flow_stats::NO_ANSWER] = 1.0;
            (values[flow_stats::RESIDUAL_START], values[flow_stats::RESIDUAL_END]) = (1.0, -1.0);
        } else {
            if self.forces.is_some() {
                self.loaded = self.surface.loaded_faces(&open.nodes, &solution.forces);
            }
            self.trial = Some((positions, end));
            self.open = Some(open);
        }
        Ok(Stats { busy_s: clock.elapsed().as_secs_f64(), values })
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        let _part = timing::part("accept");
        let none = || Fault::new(format!("window {} was accepted before it was solved", w.index));
        let (Some(open), Some((positions, end))) = (self.open.take(), self.trial.take()) else {
            return Err(self.failure.take().unwrap_or_else(none));
        };
        if open.index != w.index {
            return Err(none());
        }
        let frame = self.mean_frame(w, end);
        self.vertices = self.surface.vertices(&open.nodes, self.grid.origin + open.drift * open.dt);
        // The grid moves at a velocity that was fixed before that of the frame.
        self.grid.origin += (open.velocity - frame) * open.dt;
        if let Some(shear) = &mut self.by_height {
            shear.height += 0.5 * (self.frame.z + end.z) * open.dt;
        }
        for ((v, x), start) in self.velocities.iter_mut().zip(&positions).zip(&self.positions) {
            *v = (x - start) / open.dt;
        }
        (self.positions, self.frame) = (positions, end);
        let (dt, velocity) = (open.dt, open.velocity - self.excess());
        self.last_friction = open.friction();
        self.last = open.accept(&mut self.flow);
        if let Some(error) = self.flow.device_failure() {
            return Err(Fault::new(format!("window {} (t = {:.4} s): {error}", w.index, w.time)));
        }
        self.last_jumps = self.flow.jumps().to_vec();
        self.update_force_along(dt, velocity);
        self.handed_over = None;
        self.time = w.time + w.dt;
        if let Some(forces) = &mut self.forces {
            let speed = (Vector3::from(self.wind.at(self.time)) - end).norm();
            forces.record(&self.ranks.0, self.time, speed, &self.loaded)?;
        }
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("save");
        let motion = Kinematics {
            positions: self.positions.clone(),
            velocities: self.velocities.clone(),
            vertices: self.vertices.clone(),
            along: self.along.0.clone(),
            origin: self.grid.origin,
            home: self.grid.home,
            new_grids: self.grid.new_grids,
            frame: self.frame,
            height: self.by_height.as_ref().map(|shear| shear.height),
        };
        self.flow.gather();
        if !self.is_root() {
            return Ok(());
        }
        // The encoded state takes their place.
        self.flow.release_arrays();
        Saved::new(&self.flow, self.last_jumps.clone(), &motion).save(&case::state_file(folder, Role::Flow))
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("snapshot");
        self.flow.gather();
        let place = Place {
            origin: self.grid.origin,
            wind: self.wind.at(self.time).into(),
            frame: self.frame,
            sound: self.sound,
        };
        self.flow.release_arrays();
        self.snapshots.write(&self.flow, &place, time, folder)
    }
}
