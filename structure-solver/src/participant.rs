//! The structure as a participant of the coupled run.

use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

use case::{Integration, Role, Scene, Solve, StageKind, StageTimes};
use channel::{
    Announcement, Fault, Input, Participant, Stats, Window, structure_stats as stat, surface_hash,
};
use comm::Comm;
use mesh::StructureMesh;
use mesh::geometry::{Point, Vec3};

use crate::dynamics::{Dynamics, LoadPath, StepFailure, WindowInfo};
use crate::energy::{self, EnergyBalance, EnergyCreated, WindowEnergy};
use crate::equilibrium::{EquilibriumParams, PseudoStep};
use crate::explicit::Explicit;
use crate::linear::LinearCost;
use crate::loops::FaceLoad;
use crate::measures::{Diagnostics, Measures};
use crate::newton::State;
use crate::payload::{self, Log, Payload};
use crate::reactions;
use crate::snapshot::Pictures;
use crate::state_file;
use crate::stream::AirAlongFall;
use crate::velocity_average::VelocityAverage;
use crate::warm_start;

/// Effects of a scene that this program implements.
const EFFECTS: [&str; 42] = [
    channel::RESUME,
    channel::FLAT_SHAPES,
    channel::SUPPORT_FORCE,
    channel::FRAME_MOTION,
    channel::STAGE_WIND,
    channel::GUST_SHAPE,
    channel::GUST_TURBULENCE,
    channel::PERTURBATION,
    channel::STAGE_ALTITUDE,
    channel::WIND_BY_HEIGHT,
    channel::LAYERED_TURBULENCE,
    channel::PAYLOAD_ATTITUDE,
    channel::REACTIONS,
    "fabric.wrinkling",
    "fabric.orthotropic",
    "fabric.law",
    "fabric.prestress_pa",
    "fabric.bending_stiffness_n_m",
    "point_mass",
    "stage.stiffness_damping_s",
    "stage.motion",
    "stage.motion.rotation",
    "stage.force",
    "lines",
    "lines.tension_only",
    "lines.hysteresis",
    "fabric.hysteresis",
    "fabric.retardation_time_s",
    "risers",
    "canopy.cable",
    "canopy.fabric",
    "tapes",
    "structure.spectral_radius",
    "structure.integration",
    "fabric_gravity",
    "stage.mass_damping_per_s",
    "lines.drag",
    "descent.body",
    "reefing",
    "fabric.contact",
    "fabric.contact.friction",
    "coupling.adaptive",
];

/// Numbers of a face in the input: pressure jump and traction, at start and end.
const WIDTH: usize = 8;

/// Time between lines about a static solution.
const TELL: Duration = Duration::from_secs(2);

/// One rank of the structure-solver.
pub struct StructureSolver {
    scene: Scene,
    mesh: Rc<StructureMesh>,
    dynamics: Dynamics,
    gauge: Diagnostics,
    pictures: Pictures,
    /// Load at the start and at the end of the window.
    pressure: [Vec<f64>; 2],
    traction: [Vec<f64>; 2],
    /// Acceleration of gravity, m/s2, where the scene asks for it on the fabric.
    gravity: Option<f64>,
    /// Mass of fabric, lines and points without the payload, kg.
    hung_mass: f64,
    /// The motion starts here: accelerations follow from the first load.
    from_rest: bool,
    /// Keeps the end velocity of windows near what the flow sees, where the scene
    /// couples implicitly.
    average: Option<VelocityAverage>,
    /// Window of the last `advance` that had an answer, and its length, s.
    computed: Option<(u64, f64)>,
    /// Why the last `advance` had no answer.
    stuck: Option<Fault>,
    /// What the last `advance` measured.
    measures: Measures,
    /// What the last `advance` cost.
    info: WindowInfo,
    /// Energy balance of the stage, and of the last `advance`.
    energy: EnergyBalance,
    window_energy: WindowEnergy,
    /// What the rigid payload does, on rank 0 of a stage in which it is free.
    log: Option<Log>,
    /// The reactions, on rank 0 of a scene that asks for them.
    reactions: Option<reactions::Log>,
    /// Where the stage looks for the shape at rest: its tolerance.
    rest: Option<f64>,
    /// The undisturbed air, which lines and a free payload meet.
    air: AirAlongFall,
}

impl StructureSolver {
    /// The structure of `scene` in stage `stage`, continuing from the state that an
    /// earlier stage left below `out`. Collective.
    pub fn new(comm: &Comm, scene: &Scene, stage: usize, out: &Path) -> Result<Self, Fault> {
        Self::at_start(comm, scene, stage, out, false)
    }

    /// As [`StructureSolver::new`], in the middle of the stage: what [`Participant::save`] wrote to
    /// `state` is continued from. Collective.
    ///
    /// # Errors
    /// As for the start of the stage, and a state that does not fit.
    pub fn resumed(
        comm: &Comm,
        scene: &Scene,
        stage: usize,
        out: &Path,
        state: &Path,
    ) -> Result<Self, Fault> {
        let mut this = Self::at_start(comm, scene, stage, out, true)?;
        this.resume(state, stage, out)?;
        Ok(this)
    }

    fn at_start(comm: &Comm, scene: &Scene, stage: usize, out: &Path, resumed: bool) -> Result<Self, Fault> {
        if stage >= scene.stages.len() {
            let n = scene.stages.len();
            return Err(Fault::new(format!("the scene has {n} stages, so stage {stage} does not exist")));
        }
        let mesh = Rc::new(mesh::structure_mesh(scene).map_err(Fault::new)?);
        crate::assemble::check_held(scene, stage, &mesh).map_err(Fault::new)?;
        let mut dynamics = crate::assemble::dynamics(comm, scene, stage, &mesh).map_err(Fault::new)?;
        let source = scene.source_state(out, stage, Role::Structure);
        if let Some(path) = &source {
            dynamics.accepted =
                state_file::load(&dynamics.system.model, mesh.coords.len(), path).map_err(Fault::new)?;
        }
        let times = StageTimes::completed(scene, out, stage);
        crate::assemble::nodal(&mut dynamics, scene, stage, &times, &mesh).map_err(Fault::new)?;
        reactions::watch(&mut dynamics, scene, &mesh).map_err(Fault::new)?;
        start_payload(&mut dynamics, scene, stage, &mesh, source.as_deref())?;
        let s = &scene.structure;
        if s.integration == Integration::Explicit && scene.stages[stage].solve == Solve::Dynamic {
            dynamics.integrate_explicitly(s.explicit_safety).map_err(Fault::new)?;
        }
        let (mut log, mut reactions) = (None, None);
        if comm.is_root() && !resumed {
            log = create_log(&dynamics, scene, stage, out)?;
            reactions = open_reactions(scene, stage, out, false)?;
        }
        let gauge = Diagnostics::new(&dynamics.system, &mesh, scene);
        let gravity = scene.resolved().gravity_m_s2;
        let hung_mass = dynamics.system.total_mass() - mesh.payload_point_mass(scene);
        let n = mesh.faces.len();
        Ok(Self {
            scene: scene.clone(),
            hung_mass,
            dynamics,
            gauge,
            pictures: Pictures::default(),
            pressure: [vec![0.0; n], vec![0.0; n]],
            traction: [Vec::new(), Vec::new()],
            gravity: scene.fabric_gravity.as_ref().map(|_| gravity),
            from_rest: source.is_none(),
            average: VelocityAverage::of(scene, stage, &mesh),
            computed: None,
            stuck: None,
            log,
            reactions,
            measures: Measures::default(),
            info: WindowInfo::default(),
            energy: EnergyBalance::default(),
            window_energy: WindowEnergy::default(),
            rest: (scene.stages[stage].solve == Solve::Static).then_some(scene.structure.static_tolerance),
            air: AirAlongFall::new(scene, stage, &times, source.as_ref().and_then(|p| p.parent()))?,
            mesh,
        })
    }

    /// Takes up the state in `folder`. The start of the stage, which prescribed motions count from, stays
    /// what it was. Collective.
    fn resume(&mut self, folder: &Path, stage: usize, out: &Path) -> Result<(), Fault> {
        let comm = self.dynamics.system.comm().clone();
        let path = case::state_file(folder, Role::Structure);
        let model = &self.dynamics.system.model;
        let body = self.dynamics.accepted.body;
        self.dynamics.accepted =
            state_file::load(model, self.mesh.coords.len(), &path).map_err(Fault::new)?;
        self.dynamics.accepted.body = body;
        let stage_folder = case::stage_folder(out, &self.scene, stage);
        if self.dynamics.payload().is_some() {
            self.dynamics.accepted.body = payload::load(folder).map_err(Fault::new)?.or(body);
            if comm.is_root() {
                let bad = |e| Fault::new(format!("payload.csv in {}: {e}", stage_folder.display()));
                self.log = Some(Log::resume(&stage_folder).map_err(bad)?);
            }
        }
        if !warm_start::restore_state(&mut self.dynamics, folder)? && comm.is_root() {
            let exact = "the saved state is of another number of ranks: the restart is exact to the tolerance of the solvers";
            let history = "but for contact and hysteresis, which start without their history";
            let lost = self.dynamics.system.has_history();
            println!("{exact}{}", if lost { format!(", {history}") } else { String::new() });
        }
        if comm.is_root() {
            self.reactions = open_reactions(&self.scene, stage, out, true)?;
        }
        self.energy = EnergyBalance::load(folder)?.unwrap_or_default();
        self.air.load(folder)?;
        self.pictures = Pictures::resume(&stage_folder);
        self.from_rest = false;
        Ok(())
    }

    /// The mesh of the whole structure.
    pub fn mesh(&self) -> &StructureMesh {
        &self.mesh
    }

    /// Costs of the linear solver since the start.
    pub fn linear_cost(&self) -> LinearCost {
        self.dynamics.linear.cost
    }

    /// Rounds of nonlinear elimination and the seconds in their solves.
    pub fn eliminations(&self) -> (u64, f64) {
        (self.dynamics.newton.eliminations(), self.dynamics.newton.elimination_s)
    }

    /// What explicit steps keep, where the scene takes them.
    pub fn explicit(&self) -> Option<&Explicit> {
        self.dynamics.explicit()
    }

    /// Seconds in element loops since the start.
    pub fn assembly_s(&self) -> f64 {
        self.dynamics.newton.assembly_s
    }

    /// Why the last `advance` had no answer, if so.
    pub fn stuck(&self) -> Option<&Fault> {
        self.stuck.as_ref()
    }

    /// What the last `advance` measured.
    pub fn measures(&self) -> Measures {
        self.measures
    }

    /// What the last `advance` cost, and what damping took in it.
    pub fn info(&self) -> WindowInfo {
        self.info
    }

    /// Where time integration creates energy in the last `advance` beyond what may be, at the time
    /// `time` (s).
    pub fn energy_created(&self, time: f64) -> Option<EnergyCreated> {
        EnergyCreated::check(&self.window_energy, &self.measures, time, self.scene.structure.integration)
    }

    /// Takes the load of a window from the input.
    fn read_load(&mut self, canopy: &[f64]) -> Result<(), Fault> {
        let faces = self.mesh.faces.len();
        if canopy.len() != WIDTH * faces {
            return Err(Fault::new(format!(
                "the load has {} numbers, but {faces} faces need {}: pressure jump and traction at start and end",
                canopy.len(),
                WIDTH * faces
            )));
        }
        if let Some(i) = channel::first_not_finite(canopy) {
            return Err(Fault::new(format!(
                "the load on canopy face {} is {}: the flow or the coupling has diverged",
                i / WIDTH,
                canopy[i]
            )));
        }
        let rows = canopy.as_chunks::<WIDTH>().0;
        let sheared = rows.iter().any(|r| (1..4).any(|c| r[c] != 0.0 || r[c + 4] != 0.0));
        for half in 0..2 {
            let at = 4 * half;
            for (p, row) in self.pressure[half].iter_mut().zip(rows) {
                *p = row[at];
            }
            // Without shear the kernels without traction run.
            let traction = &mut self.traction[half];
            traction.clear();
            if sheared {
                traction.extend(rows.iter().flat_map(|row| &row[at + 1..at + 4]));
            }
        }
        Ok(())
    }

    fn stats(&self, busy: f64, info: &WindowInfo, m: &Measures, before: LinearCost, assembly: f64) -> Stats {
        let cost = self.dynamics.linear.cost;
        let mut stats = Stats { busy_s: busy, ..Stats::default() };
        let v = &mut stats.values;
        v[stat::KINETIC_ENERGY] = m.kinetic;
        v[stat::STRAIN_ENERGY] = m.strain;
        v[stat::LOAD_WORK] = info.load_work;
        v[stat::PRESCRIBED_WORK] = info.works.prescribed();
        v[stat::NEWTON_STEPS] = info.newton_steps as f64;
        v[stat::GMRES_ITERATIONS] = (cost.iterations - before.iterations) as f64;
        v[stat::FACTORISATIONS] = (cost.factorisations - before.factorisations) as f64;
        v[stat::VERTICAL_LOAD] = m.vertical_load;
        v[stat::PROJECTED_AREA] = m.projected_area;
        v[stat::MAX_LINE_TENSION] = m.max_line_tension;
        v[stat::MAX_MEMBRANE_FORCE] = m.max_membrane_force;
        v[stat::MEMBRANE_FORCE_99] = m.membrane_force_99;
        v[stat::MEMBRANE_FORCE_OVER_STRENGTH] = m.max_force_over_strength;
        v[stat::MEMBRANE_FORCE_OVER_STRENGTH_99] = m.force_over_strength_99;
        v[stat::MAX_HEM_TAPE_TENSION..][..m.max_tape_tensions.len()].copy_from_slice(&m.max_tape_tensions);
        v[stat::RESIDUAL] = info.residual;
        v[stat::RESIDUAL_TARGET] = info.target;
        v[stat::UNCONVERGED] = info.unconverged as f64;
        v[stat::STEP_CUTS] = info.cuts as f64;
        v[stat::RISER_FORCE] = m.riser_force;
        v[stat::VOLUME] = m.volume;
        v[stat::SUPPORT_FORCE..][..3].copy_from_slice(m.support_force.as_slice());
        v[stat::MOMENTUM..][..3].copy_from_slice(m.momentum.as_slice());
        // Seconds differ between ranks; the slowest counts.
        let comm = self.dynamics.system.comm();
        v[stat::ASSEMBLY_S] = comm.max(self.assembly_s() - assembly);
        let linear = cost.factorisation_s - before.factorisation_s + cost.solve_s - before.solve_s;
        v[stat::LINEAR_S] = comm.max(linear);
        v[stat::AIR_FORCE..][..3].copy_from_slice(self.air_force().as_slice());
        self.window_energy.report(v);
        stats
    }
}

impl Participant for StructureSolver {
    fn announce(&self) -> Announcement {
        Announcement {
            role: Role::Structure.name().into(),
            program: env!("CARGO_PKG_NAME").into(),
            version: env!("CARGO_PKG_VERSION").into(),
            canopy_nodes: self.mesh.n_canopy as u64,
            canopy_faces: self.mesh.faces.len() as u64,
            surface_hash: surface_hash(&self.mesh.faces),
            grid_nodes: 0,
            output_width: 3,
            effects: EFFECTS.map(String::from).to_vec(),
        }
    }

    fn description(&self) -> Vec<String> {
        let mesh = &self.mesh;
        let model = &self.dynamics.system.model;
        let method = match self.rest {
            Some(tolerance) => format!("equilibrium to a residual of {tolerance:.1e} of the load"),
            None => format!("time integration {:?}", self.scene.structure.integration),
        };
        vec![
            format!(
                "structure of {} nodes, {} faces, {} membrane elements, {} cable elements, {:.6} kg; {} nodes on this rank",
                mesh.coords.len(),
                mesh.faces.len(),
                mesh.triangles.len(),
                mesh.cables.len(),
                self.dynamics.system.total_mass(),
                model.n_owned()
            ),
            format!("{method}; starts {}", if self.from_rest { "at rest" } else { "from a saved state" }),
        ]
    }

    fn output_rows(&self) -> Vec<u64> {
        let canopy = |g: &&u64| **g < self.mesh.n_canopy as u64;
        self.dynamics.system.model.numbering.owned().iter().filter(canopy).copied().collect()
    }

    fn waited_s(&self) -> f64 {
        self.dynamics.system.comm().waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let _part = timing::part("advance");
        let start = Instant::now();
        let (before, assembly) = (self.linear_cost(), self.assembly_s());
        self.read_load(input.canopy)?;
        let body = match self.gravity {
            Some(g) => {
                let a = w.frame_acceleration;
                [-a[0], -a[1], -g - a[2]]
            }
            None => [0.0; 3],
        };
        self.set_air(w);
        self.start_energy_balance(w);
        let info = match self.rest {
            Some(tolerance) => self.find_rest(tolerance, body)?,
            None => match self.step_in_time(w, body)? {
                Ok(info) => info,
                Err(failure) => return Ok(self.no_answer(w, &failure, output, start)),
            },
        };
        (self.computed, self.stuck) = (Some((w.index, w.dt)), None);
        let last = FaceLoad { pressure: &self.pressure[1], traction: &self.traction[1] };
        let mut m = self.gauge.measure(&self.dynamics.system, &self.dynamics.current, last);
        m.momentum = self.dynamics.momentum();
        m.support_force = match self.rest {
            Some(_) => Vec3::z() * m.riser_force,
            None => self.mean_support_force(w.dt, body.into(), &info),
        };
        self.measures = m;
        self.info = info;
        if self.rest.is_none() {
            let energy = m.kinetic + m.strain + payload_energy(&self.dynamics, &self.dynamics.current);
            self.window_energy = self.energy.window(energy, &info.works);
        }
        // Owned nodes ascend, and the canopy's come first.
        output.copy_from_slice(&self.dynamics.current.u[..output.len()]);
        Ok(self.stats(start.elapsed().as_secs_f64(), &info, &m, before, assembly))
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        let _part = timing::part("accept");
        if self.computed.is_none_or(|(index, _)| index != w.index) {
            let none = || Fault::new(format!("window {} was accepted before it was solved", w.index));
            return Err(self.stuck.take().unwrap_or_else(none));
        }
        let mut averaged = 0.0;
        if let Some(average) = &mut self.average {
            let Dynamics { accepted, current, system, .. } = &mut self.dynamics;
            average.apply(w.dt, system, accepted, current);
            averaged = self.gauge.kinetic(system, current) - self.measures.kinetic;
        }
        if self.rest.is_none() {
            self.energy.accept(&self.window_energy, averaged);
        }
        self.dynamics.accept();
        self.air.accept(w);
        self.from_rest = false;
        let written = match (&mut self.log, self.dynamics.payload(), &self.dynamics.accepted.body) {
            (Some(log), Some(p), Some(s)) => log.push(w.time + w.dt, p, s),
            _ => Ok(()),
        };
        written.map_err(|e| Fault::new(format!("payload.csv: {e}")))?;
        // The window of a static stage has no duration.
        let time = if self.rest.is_some() { w.time } else { w.time + w.dt };
        let written = self.reactions.as_mut().map(|log| log.push(time, self.dynamics.mean_reactions()));
        written.transpose().map_err(|e| Fault::new(format!("reactions.csv: {e}")))?;
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("save");
        let model = &self.dynamics.system.model;
        let nodes = self.mesh.coords.len();
        let state = &self.dynamics.accepted;
        state_file::save(model, state, nodes, &case::state_file(folder, Role::Structure))
            .map_err(Fault::new)?;
        if let Some(body) = &state.body {
            payload::save(&model.comm, body, folder).map_err(Fault::new)?;
        }
        agree(&model.comm, warm_start::save(&self.dynamics, folder).map_err(Fault::new))?;
        let common = || self.energy.save(folder).and_then(|()| self.air.save(folder));
        agree(&model.comm, if model.comm.is_root() { common() } else { Ok(()) })?;
        let u = state_file::gather(
            &model.comm,
            model.numbering.owned(),
            &state.u[..3 * model.n_owned()],
            3,
            nodes,
        );
        let result = if model.comm.is_root() {
            let shape: Vec<_> = self.mesh.coords[..self.mesh.n_canopy]
                .iter()
                .zip(u.as_chunks::<3>().0)
                .map(|(x, u)| Point::from(Vec3::from(*x) + Vec3::from(*u)))
                .collect();
            mesh::save_shape(&case::canopy_file(folder), &shape).map_err(Fault::new)
        } else {
            Ok(())
        };
        agree(&model.comm, result)
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("snapshot");
        let d = &self.dynamics;
        let load = FaceLoad { pressure: &self.pressure[1], traction: &self.traction[1] };
        let result = self.pictures.add(&d.system, &self.mesh, &d.accepted, load, time, folder);
        agree(d.system.comm(), result.map_err(Fault::new))
    }
}

/// Kinetic energy of a rigid payload without its nodes, J.
fn payload_energy(dynamics: &Dynamics, state: &State) -> f64 {
    dynamics.payload().zip(state.body.as_ref()).map_or(0.0, |(p, s)| p.own_kinetic(s))
}

impl StructureSolver {
    /// Measures the energy at the start of a stage that moves in time. Collective.
    fn start_energy_balance(&mut self, w: &Window) {
        if self.rest.is_some() || self.energy.started() {
            return;
        }
        let d = &mut self.dynamics;
        d.system.set_time(w.time);
        let first = FaceLoad { pressure: &self.pressure[0], traction: &self.traction[0] };
        let m = self.gauge.measure(&d.system, &d.accepted, first);
        let energy = m.kinetic + m.strain + payload_energy(d, &d.accepted);
        self.energy.start(energy, energy::floor(&d.system));
    }

    /// Passes the undisturbed air in the falling frame to the elements with air loads.
    fn set_air(&mut self, w: &Window) {
        let dynamics = &mut self.dynamics;
        if !(dynamics.system.feels_air() || dynamics.payload.is_some()) {
            return;
        }
        let air = self.air.at_end(w);
        dynamics.system.set_air(&air);
        if let Some(p) = &mut dynamics.payload {
            p.air = air;
        }
    }

    /// Mean force on the payload over the window, N, its own weight excluded: see [`crate::support`].
    fn mean_support_force(&self, dt: f64, body: Vec3, info: &WindowInfo) -> Vec3 {
        let held = || self.dynamics.mean_support_force(dt, info) + body * self.hung_mass;
        self.dynamics.mean_payload_force(dt, body).unwrap_or_else(held)
    }

    /// Force of the air on lines and a free payload in the last substep, N.
    fn air_force(&self) -> Vec3 {
        let d = &self.dynamics;
        let payload = match (d.payload(), &d.current.body) {
            (Some(p), Some(s)) => p.drag(s),
            _ => Vec3::zeros(),
        };
        if !d.system.feels_air() {
            return payload;
        }
        let x: Vec<f64> = d.system.model.reference.iter().zip(&d.current.u).map(|(x, u)| x + u).collect();
        let mut lines: [f64; 3] = d.system.air_force(&x).into();
        d.system.comm().sum_slice(&mut lines);
        payload + Vec3::from(lines)
    }

    /// The answer where there is none: the shape that was accepted last. The coupler may ask for a
    /// shorter window, or save and end the run.
    fn no_answer(&mut self, w: &Window, why: &StepFailure, output: &mut [f64], start: Instant) -> Stats {
        self.computed = None;
        let fault = Fault::new(format!("window {} (t = {:.6} s): {why}", w.index, w.time));
        if self.dynamics.system.comm().is_root() {
            eprintln!("structure-solver: {fault}");
        }
        self.stuck = Some(fault);
        output.copy_from_slice(&self.dynamics.accepted.u[..output.len()]);
        let mut stats = Stats { busy_s: start.elapsed().as_secs_f64(), ..Stats::default() };
        stats.values[stat::RESIDUAL] = -1.0;
        stats.values[stat::STEP_CUTS] = f64::from(why.cuts);
        stats
    }

    /// Computes a window in time into the current state.
    fn step_in_time(&mut self, w: &Window, body: [f64; 3]) -> Result<Result<WindowInfo, StepFailure>, Fault> {
        let _part = timing::part("time steps");
        let load = LoadPath {
            pressure: [&self.pressure[0], &self.pressure[1]],
            traction: [&self.traction[0], &self.traction[1]],
        };
        if self.from_rest {
            let first = FaceLoad { pressure: load.pressure[0], traction: load.traction[0] };
            self.dynamics.balance_start(first, body).map_err(Fault::new)?;
        }
        self.dynamics.time = w.time;
        let iterated = self.computed == Some((w.index, w.dt));
        Ok(self.dynamics.window(w.dt, w.substeps.max(1), load, body, iterated))
    }

    /// Finds the shape at rest under the load at the end of the window, and reports
    /// how it goes.
    fn find_rest(&mut self, tolerance: f64, body: [f64; 3]) -> Result<WindowInfo, Fault> {
        let _part = timing::part("equilibrium");
        let load = FaceLoad { pressure: &self.pressure[1], traction: &self.traction[1] };
        let mut info = WindowInfo::default();
        let root = self.dynamics.system.comm().is_root();
        let mut told = Instant::now();
        let mut tell = |s: &PseudoStep| {
            info.newton_steps += u64::from(s.newton_steps);
            info.cuts += u64::from(s.repeats);
            info.residual = s.residual;
            if root && (s.balanced.is_some() || told.elapsed() >= TELL) {
                told = Instant::now();
                eprintln!(
                    "static: step {}, residual {:.1e} of the load, moved {:.1e} m, {} Newton steps so far",
                    s.number, s.residual, s.moved, info.newton_steps
                );
            }
        };
        let params = EquilibriumParams { tolerance, ..EquilibriumParams::default() };
        self.dynamics.equilibrium(load, body, params, &mut tell).map_err(Fault::new)?;
        self.dynamics.reactions_at_rest(load, body);
        info.target = tolerance;
        info.unconverged = u64::from(info.residual > tolerance);
        Ok(info)
    }

    /// The scene that is run.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

/// The file of the reactions in the folder of a stage, where the scene asks for any.
fn open_reactions(
    scene: &Scene,
    stage: usize,
    out: &Path,
    resumed: bool,
) -> Result<Option<reactions::Log>, Fault> {
    if scene.output.reactions.is_empty() {
        return Ok(None);
    }
    let folder = case::stage_folder(out, scene, stage);
    let bad = |e| Fault::new(format!("reactions.csv in {}: {e}", folder.display()));
    reactions::Log::open(&folder, scene, resumed).map(Some).map_err(bad)
}

/// Puts a rigid payload onto its nodes where it is free in `stage`, whose first state is that of the file `source`. Collective.
fn start_payload(
    dynamics: &mut Dynamics,
    scene: &Scene,
    stage: usize,
    mesh: &StructureMesh,
    source: Option<&Path>,
) -> Result<(), Fault> {
    let free = scene.stages[stage].kind == StageKind::Coupled;
    if let Some((payload, start)) = Payload::new(scene, mesh, dynamics).filter(|_| free) {
        let folder = source.and_then(Path::parent);
        let earlier = folder.map(payload::load).transpose().map_err(Fault::new)?.flatten();
        dynamics.carry(payload, earlier.unwrap_or(start));
        if earlier.is_none() {
            release(dynamics, scene, stage, source.is_some())?;
        }
    }
    Ok(())
}

/// The file of a free payload's motion in the folder of a stage, where there is such a payload.
fn create_log(dynamics: &Dynamics, scene: &Scene, stage: usize, out: &Path) -> Result<Option<Log>, Fault> {
    if dynamics.payload().is_none() {
        return Ok(None);
    }
    let folder = case::stage_folder(out, scene, stage);
    let bad = |e| Fault::new(format!("payload.csv in {}: {e}", folder.display()));
    Log::create(&folder).map(Some).map_err(bad)
}

/// Places a payload that becomes free in `stage`; `held`: the structure moved before. Collective.
fn release(dynamics: &mut Dynamics, scene: &Scene, stage: usize, held: bool) -> Result<(), Fault> {
    if held {
        dynamics.start_payload_where_held().map_err(|off| {
            Fault::new(format!(
                "the attachments of the payload were not moved as a rigid body before its release in stage `{}`: one is {off:.3e} m from its \
                 place. Likely cause: a [[stage.motion]] that moves some of them. Remedy: move the node set `payload`, or turn the payload by \
                 descent.body.initial_rotation_deg",
                scene.stages[stage].name
            ))
        })?;
    }
    if scene.payload_body().is_some_and(case::PayloadBody::is_released_turned) {
        dynamics.place_payload();
    }
    Ok(())
}

/// A fault on one rank becomes a fault on every rank.
fn agree(comm: &Comm, result: Result<(), Fault>) -> Result<(), Fault> {
    let all = comm.all(result.is_ok());
    match result {
        Ok(()) if !all => Err(Fault::new("another rank could not write its results")),
        other => other,
    }
}
