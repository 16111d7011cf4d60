//! The mesh-mover as a participant of a coupled run.

use std::path::{Path, PathBuf};
use std::time::Instant;

use case::{OuterBoundary, Role, Scene};
use channel::{Announcement, Fault, Input, Participant, Stats, Window, mesh_stats};
use comm::Comm;
use mesh::{FaceTable, FlowGrid, Patch, Point, StructureMesh};

use crate::allocator::release_free_memory;
use crate::bodies::Bodies;
use crate::local::LocalGrid;
use crate::motion::{
    Builder, GridTransition, Limits, Motion, MotionError, MotionResult, NewGrid, Positions, Regridder,
};
use crate::mover::Mover;
use crate::rigid_motion::RigidMotion;
use crate::state::State;
use crate::velocity::{first_order, second_order, weights};
use crate::warm_start;

/// Numbers in a row of the output: position (m), velocity (m/s).
const WIDTH: usize = 6;

/// One rank of the mesh-mover.
pub struct MeshMover {
    motion: Motion,
    /// Unstressed positions of the canopy, flat, m.
    unstressed: Vec<f64>,
    bodies: Bodies,
    /// Panel of each canopy node, for messages.
    panels: Vec<u32>,
    surface: Surface,
    /// Positions at the end of the last accepted window and of the one before, and the length of the last.
    now: Positions,
    before: Option<Positions>,
    dt: f64,
    /// The last response, until it is accepted.
    trial: Positions,
    /// Whether the grid may turn with the canopy.
    turns: bool,
    /// How far it turns with the accepted canopy.
    turned: RigidMotion,
    /// The accepted positions in the frame that turns with the accepted canopy.
    turned_now: Positions,
    /// The window that is computed, its length, and how far the grid turns in all its solves.
    turning: Option<(u64, f64, RigidMotion)>,
    answered: Option<(Window, MotionResult)>,
    /// Whether the start grid differs from the scene's.
    new_start: bool,
    /// Why the last window failed.
    failure: Option<Fault>,
}

struct Surface {
    faces: u64,
    hash: u64,
}

/// Inputs of a mesh-mover before its rank's part is extracted.
pub struct Setup<'a> {
    /// The start grid, with the bodies ([`Bodies::add_to`]).
    pub grid: &'a FlowGrid,
    /// The canopy: unstressed coordinates, interface faces, panels.
    pub structure: &'a StructureMesh,
    /// Rank of each grid node.
    pub owner: &'a [u32],
    /// Method of motion of the interior.
    pub mover: Box<dyn Mover>,
    /// Requirements on the moved grid.
    pub limits: Limits,
    /// State to continue from; `None`: the start grid at rest.
    pub state: Option<State>,
    /// Boundary condition on the outer boundary.
    pub outer: OuterBoundary,
    /// Builds new grids; `None`: none are built.
    pub regridder: Option<Regridder>,
    /// Rigid bodies that move as prescribed.
    pub bodies: Bodies,
}

impl MeshMover {
    /// The mover of a stage of a scene: builds the start grid around the shape that the last uncoupled stage left,
    /// and loads the state of an earlier stage. Collective.
    ///
    /// # Errors
    /// No grid, more ranks than cells, unreadable files, an invalid start grid.
    pub fn new(scene: &Scene, stage: usize, out: &Path, comm: &Comm) -> Result<Self, Fault> {
        Self::from_state(scene, stage, out, None, comm)
    }

    /// As [`MeshMover::new`], within the stage: continues from the state that [`Participant::save`] wrote to
    /// `folder`. Collective.
    ///
    /// # Errors
    /// Errors of the start of the stage, and a state that does not match.
    pub fn resumed(
        scene: &Scene,
        stage: usize,
        out: &Path,
        folder: &Path,
        comm: &Comm,
    ) -> Result<Self, Fault> {
        let mut this = Self::from_state(scene, stage, out, Some(folder), comm)?;
        match warm_start::load(comm, folder)? {
            Some(saved) => {
                let file = channel::warm_start_file(folder, Role::Mesh, comm.rank(), comm.size());
                let unfit = |reason: String| archive::Error::content(&file, reason);
                warm_start::agree(comm, this.motion.restore_state(saved).map_err(unfit))?;
            }
            None if comm.is_root() => {
                println!(
                    "the saved state is of another number of ranks: continuing to the solvers' tolerance"
                );
            }
            None => {}
        }
        Ok(this)
    }

    /// The mover at the start of the stage, or with the state in the folder `resumed`.
    fn from_state(
        scene: &Scene,
        stage: usize,
        out: &Path,
        resumed: Option<&Path>,
        comm: &Comm,
    ) -> Result<Self, Fault> {
        let structure = mesh::structure_mesh(scene).map_err(Fault::new)?;
        let grid = start_grid(scene, stage, out, &structure)?;
        let owner = owners(&grid, comm.size())?;
        let mover = crate::movers::mover(&scene.mesh);
        let limits = Limits::from(&scene.mesh);
        let regridder = regridder(scene, &structure, &grid);
        let mut bodies = Bodies::new(&scene.stages[stage].body_motions, &grid)?;
        let grid = bodies.add_to(grid);
        let load = |path: PathBuf| State::load(&path, grid.coords.len()).map_err(Fault::new);
        let earlier =
            scene.source_state(out, stage, Role::Mesh).filter(|_| resumed.is_none() || !bodies.is_empty());
        let earlier = earlier.map(load).transpose()?;
        // Bodies start where the earlier stage left them, also in a run that resumes within the stage.
        let start = earlier.as_ref().map_or(grid.coords.as_flattened(), |s| &s.now);
        bodies.set_start(&interface_positions(&grid, start));
        let state = match resumed {
            Some(folder) => Some(load(case::state_file(folder, Role::Mesh))?),
            None => earlier,
        };
        let outer = scene.mesh.outer_boundary;
        let setup = Setup {
            structure: &structure,
            grid: &grid,
            owner: &owner,
            mover,
            limits,
            state,
            outer,
            regridder,
            bodies,
        };
        Self::on_grid(setup, comm)
    }

    /// The mover of a given grid. Collective.
    ///
    /// # Errors
    /// An invalid start grid, or a canopy that the grid does not contain.
    pub fn on_grid(setup: Setup<'_>, comm: &Comm) -> Result<Self, Fault> {
        let Setup { grid, structure, owner, mover, limits, state, outer, regridder, bodies } = setup;
        let canopy_nodes = grid.canopy_nodes.len() - bodies.len();
        if canopy_nodes != structure.n_canopy {
            return Err(Fault::new(format!(
                "the flow grid contains {canopy_nodes} canopy nodes, the structure mesh has {}: give both programs the same scene",
                structure.n_canopy
            )));
        }
        let unstressed: Vec<f64> = structure.coords[..structure.n_canopy].as_flattened().to_vec();
        let mut panels = vec![0; structure.n_canopy];
        for (face, &panel) in structure.faces.iter().zip(&structure.face_panel) {
            face.iter().for_each(|&a| panels[a as usize] = panel);
        }
        let local = LocalGrid::with_outer(grid, owner, outer, comm);
        let positions = |global: &[Point]| Positions {
            grid: local.gather(global),
            canopy: interface_positions(grid, global.as_flattened()),
        };
        let of = |flat: &[f64]| (!flat.is_empty()).then(|| positions(flat.as_chunks::<3>().0));
        let state = state.unwrap_or_default();
        let start = of(&state.start).unwrap_or_else(|| positions(&grid.coords));
        let now = of(&state.now).unwrap_or_else(|| start.clone());
        let before = of(&state.before);
        let reference = of(&state.reference).unwrap_or_else(|| start.clone());
        let [step, steps] = state.transition;
        let transition = of(&state.offset).map(|offset| GridTransition { offset: offset.grid, step, steps });
        // Any other condition than the far field's holds at a place.
        let turns = bodies.is_empty()
            && outer == OuterBoundary::Fixed
            && grid.boundary.iter().all(|(patch, _)| *patch == Patch::FarField);
        let turned = if turns { RigidMotion::of(&start.canopy, &now.canopy) } else { RigidMotion::REST };
        let motion = Motion::new(local, start, reference, mover, limits).map_err(Fault::new)?;
        let motion = motion.with_regrid(regridder, transition);
        Ok(Self {
            turns,
            turned,
            turned_now: Positions { grid: Vec::new(), canopy: Vec::new() },
            turning: None,
            motion,
            unstressed,
            bodies,
            panels,
            surface: Surface {
                faces: structure.faces.len() as u64,
                hash: channel::surface_hash(&structure.faces),
            },
            trial: now.clone(),
            now,
            before,
            dt: state.dt,
            answered: None,
            new_start: !state.start.is_empty(),
            failure: None,
        })
    }

    /// The moving grid.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Accepted positions.
    pub fn positions(&self) -> &Positions {
        &self.now
    }

    /// Why the last window failed, if it did.
    pub fn failure(&self) -> Option<&Fault> {
        self.failure.as_ref()
    }

    /// Moves the trial grid to the trial canopy: in the frame that turns with it.
    fn follow(&mut self, w: &Window) -> Result<MotionResult, MotionError> {
        let turn = match self.turning {
            Some((index, dt, turn)) if (index, dt) == (w.index, w.dt) => turn,
            _ => self.turn_of(&self.trial.canopy),
        };
        self.turning = Some((w.index, w.dt, turn));
        if turn.is_rest() && self.turned.is_rest() {
            return self.motion.follow(&self.now, &mut self.trial);
        }
        let Positions { grid, canopy } = &mut self.turned_now;
        grid.clone_from(&self.now.grid);
        canopy.clone_from(&self.now.canopy);
        for x in [grid, canopy] {
            self.turned.to_turned_frame(x);
        }
        turn.to_turned_frame(&mut self.trial.canopy);
        let moved = self.motion.follow(&self.turned_now, &mut self.trial);
        turn.to_places(&mut self.trial.grid);
        moved
    }

    /// Ends the window in the frame that turned with the canopy. The next one starts in that of the accepted canopy, as a resumed run does.
    fn accept_motion(&mut self, moved: &MotionResult) -> Option<Result<NewGrid, String>> {
        let turn = self.turning.take().map_or(RigidMotion::REST, |(_, _, turn)| turn);
        let new_grid = if turn.is_rest() {
            self.motion.accept(&self.now, &moved.shape)
        } else {
            let Positions { grid, canopy } = &mut self.turned_now;
            grid.clone_from(&self.now.grid);
            canopy.clone_from(&self.now.canopy);
            for x in [grid, canopy] {
                turn.to_turned_frame(x);
            }
            self.motion.accept(&self.turned_now, &moved.shape)
        };
        self.turned = self.turn_of(&self.now.canopy);
        new_grid
    }

    /// How far the grid turns with a canopy.
    fn turn_of(&self, canopy: &[f64]) -> RigidMotion {
        if self.turns { RigidMotion::of(&self.motion.start().canopy, canopy) } else { RigidMotion::REST }
    }

    /// Where a point that the motion names is.
    fn place(&self, at: &Point) -> Point {
        self.turning.map_or(*at, |(_, _, turn)| turn.place(at))
    }

    fn read_canopy(&mut self, displacement: &[f64]) -> Result<(), Fault> {
        let expected = self.unstressed.len();
        if displacement.len() != expected {
            return Err(Fault::new(format!(
                "canopy displacement of {} numbers received, {expected} expected ({} nodes x 3)",
                displacement.len(),
                expected / 3
            )));
        }
        if let Some(i) = displacement.iter().position(|v| !v.is_finite()) {
            return Err(Fault::new(format!(
                "canopy node {} (panel {}) has a displacement of {} m along {}: \
                 the structure or the coupling has diverged",
                i / 3,
                self.panels[i / 3],
                displacement[i],
                ["x", "y", "z"][i % 3]
            )));
        }
        for ((c, x), d) in self.trial.canopy.iter_mut().zip(&self.unstressed).zip(displacement) {
            *c = x + d;
        }
        Ok(())
    }

    /// The response where the grid motion failed: the last accepted grid, and the worst cell. The run can then be
    /// saved before it ends.
    fn failed_response(&self, error: &MotionError, output: &mut [f64], clock: Instant) -> Stats {
        for (row, x) in output.as_chunks_mut::<WIDTH>().0.iter_mut().zip(self.now.grid.as_chunks::<3>().0) {
            *row = [x[0], x[1], x[2], 0.0, 0.0, 0.0];
        }
        let mut stats = Stats::default();
        let v = &mut stats.values;
        v[mesh_stats::STUCK] = 1.0;
        v[mesh_stats::INCREMENTS] = f64::from(self.motion.limits().max_increments);
        v[mesh_stats::NEW_GRIDS] = f64::from(self.motion.new_grids());
        match error {
            MotionError::Tangled { shape, .. } | MotionError::BadStart { shape, .. } => {
                v[mesh_stats::WORST_CELL] = f64::from(shape.cell);
                v[mesh_stats::MIN_QUALITY] = shape.quality;
                v[mesh_stats::MIN_VOLUME_RATIO] = shape.volume_ratio;
                v[mesh_stats::NEAREST_NODE] =
                    self.nearest(&self.place(&shape.at)).map_or(-1.0, |(k, _)| k as f64);
            }
            MotionError::Mover(crate::mover::MoverError::Inverted { cell, at, .. }) => {
                v[mesh_stats::WORST_CELL] = f64::from(*cell);
                v[mesh_stats::NEAREST_NODE] = self.nearest(&self.place(at)).map_or(-1.0, |(k, _)| k as f64);
            }
            MotionError::Mover(_) => {
                v[mesh_stats::WORST_CELL] = -1.0;
                v[mesh_stats::NEAREST_NODE] = -1.0;
            }
        }
        for value in v.iter_mut().filter(|value| !value.is_finite()) {
            *value = -1.0;
        }
        stats.busy_s = clock.elapsed().as_secs_f64();
        stats
    }

    /// The canopy node nearest to a point, and its distance, m.
    fn nearest(&self, at: &Point) -> Option<(usize, f64)> {
        nearest(self.trial.canopy[..self.unstressed.len()].as_chunks::<3>().0, at)
    }

    /// A motion error with its location on the canopy.
    fn explain(&self, error: &MotionError, w: &Window) -> Fault {
        let at = match error {
            MotionError::Tangled { shape, .. } | MotionError::BadStart { shape, .. } => shape.at,
            MotionError::Mover(crate::mover::MoverError::Inverted { at, .. }) => *at,
            MotionError::Mover(_) => return Fault::new(format!("grid motion, window {}: {error}", w.index)),
        };
        let nearest = match self.nearest(&self.place(&at)) {
            Some((k, d)) => {
                format!("; nearest canopy node {k} (panel {}), {d:.4} m away", self.panels[k])
            }
            None => String::new(),
        };
        if !self.bodies.is_empty() {
            return Fault::new(format!(
                "grid motion, window {}, iteration {}: {error}{nearest}; rigid bodies move in this stage: reduce \
                 [[stage.body_motion]], move the outer patches along with the body, or try mesh.outer_boundary = \
                 \"sliding\"",
                w.index, w.iteration
            ));
        }
        Fault::new(format!(
            "grid motion, window {}, iteration {}: {error}{nearest}; shorter windows, or a start grid \
             around a shape closer to this one, may help",
            w.index, w.iteration
        ))
    }

    /// Positions and velocities of the owned nodes at the end of a window of `dt` s.
    fn write_rows(&self, dt: f64, output: &mut [f64]) {
        let earlier = self.before.as_ref().zip(weights(dt / self.dt));
        let n = self.motion.grid.nodes.n_owned;
        assert_eq!(output.len(), WIDTH * n, "one row for each owned node");
        let rows = output.as_chunks_mut::<WIDTH>().0.iter_mut();
        let rows = rows.zip(self.trial.grid.as_chunks::<3>().0).zip(self.now.grid.as_chunks::<3>().0);
        let scale = 1.0 / dt;
        match earlier {
            Some((before, weights)) => {
                for (((row, x), x1), x2) in rows.zip(before.grid.as_chunks::<3>().0) {
                    for i in 0..3 {
                        row[i] = x[i];
                        row[3 + i] = second_order(weights, x[i], x1[i], x2[i], scale);
                    }
                }
            }
            None => {
                for ((row, x), x1) in rows {
                    for i in 0..3 {
                        row[i] = x[i];
                        row[3 + i] = first_order(x[i], x1[i], scale);
                    }
                }
            }
        }
    }

    /// A field on all nodes of the grid in global order, on every rank. Collective.
    fn gather(&self, field: &[f64]) -> Vec<f64> {
        let nodes = &self.motion.grid.nodes;
        let comm = self.motion.grid.comm();
        let ids = comm.all_gather_var(nodes.owned());
        let rows = comm.all_gather_var(&field[..3 * nodes.n_owned]);
        let mut all = vec![0.0; 3 * self.motion.grid.n_global];
        for (&g, row) in ids.iter().zip(rows.as_chunks::<3>().0) {
            all[3 * g as usize..][..3].copy_from_slice(row);
        }
        all
    }
}

impl Participant for MeshMover {
    fn announce(&self) -> Announcement {
        Announcement {
            role: Role::Mesh.name().into(),
            program: "mesh-mover".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            canopy_nodes: self.panels.len() as u64,
            canopy_faces: self.surface.faces,
            surface_hash: self.surface.hash,
            grid_nodes: self.motion.grid.n_global as u64,
            output_width: WIDTH as u64,
            effects: [channel::RESUME, "coupling.adaptive", channel::BODY_MOTION, channel::PERIODIC]
                .map(String::from)
                .to_vec(),
        }
    }

    fn description(&self) -> Vec<String> {
        let grid = &self.motion.grid;
        let turning = if self.turns { ", turns with the canopy" } else { "" };
        vec![format!(
            "grid of {} nodes on this rank, {} of them on the canopy or bodies{turning}; {:?}",
            self.now.grid.len() / 3,
            grid.canopy.len(),
            self.motion.limits()
        )]
    }

    fn output_rows(&self) -> Vec<u64> {
        self.motion.grid.nodes.owned().to_vec()
    }

    fn waited_s(&self) -> f64 {
        self.motion.grid.comm().waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let _part = timing::part("advance");
        let clock = Instant::now();
        (self.answered, self.failure) = (None, None);
        if !(w.dt.is_finite() && w.dt > 0.0) {
            return Err(Fault::new(format!("window {} has a length of {} s", w.index, w.dt)));
        }
        self.read_canopy(input.canopy)?;
        self.bodies.positions(w.time + w.dt, &mut self.trial.canopy)?;
        let moved = self.follow(w);
        // The canopy's nodes are exact bitwise, also in a grid that turned there and back.
        if self.turning.is_some_and(|(_, _, turn)| !turn.is_rest()) {
            self.read_canopy(input.canopy)?;
            let grid = self.trial.grid.as_chunks_mut::<3>().0;
            for &(local, k) in &self.motion.grid.canopy {
                grid[local as usize] = self.trial.canopy.as_chunks::<3>().0[k as usize];
            }
        }
        let moved = match moved {
            Ok(moved) => moved,
            Err(error) => {
                let fault = self.explain(&error, w);
                let stats = self.failed_response(&error, output, clock);
                if self.motion.grid.comm().is_root() {
                    eprintln!("mesh-mover: {fault}");
                }
                self.failure = Some(fault);
                return Ok(stats);
            }
        };
        self.write_rows(w.dt, output);
        self.answered = Some((*w, moved));
        let mut stats = Stats::default();
        let v = &mut stats.values;
        v[mesh_stats::MIN_QUALITY] = moved.shape.quality;
        v[mesh_stats::ITERATIONS] = moved.effort.iterations as f64;
        v[mesh_stats::INCREMENTS] = f64::from(moved.increments);
        v[mesh_stats::RESIDUAL] = moved.effort.error;
        v[mesh_stats::RESIDUAL_TARGET] = moved.effort.accepted;
        v[mesh_stats::MIN_VOLUME_RATIO] = moved.shape.volume_ratio;
        v[mesh_stats::WORST_CELL] = f64::from(moved.shape.cell);
        v[mesh_stats::NEW_GRIDS] = f64::from(self.motion.new_grids());
        stats.busy_s = clock.elapsed().as_secs_f64();
        Ok(stats)
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        let _part = timing::part("accept");
        let Some((_, moved)) = self.answered.take().filter(|(a, _)| a.index == w.index) else {
            return Err(Fault::new(format!("window {} was accepted before it was computed", w.index)));
        };
        let before = self.before.get_or_insert_with(|| self.now.clone());
        std::mem::swap(before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.trial);
        self.dt = w.dt;
        let new_grid = self.accept_motion(&moved);
        self.new_start |= self.motion.new_grids() > 0;
        if let Some(new_grid) = new_grid.filter(|_| self.motion.grid.comm().is_root()) {
            match new_grid {
                Ok(n) => println!(
                    "window {}: new grid around the canopy, smallest scaled Jacobian {:.3} instead of {:.3}, {}",
                    w.index,
                    n.to,
                    n.from,
                    match n.windows {
                        0 => "replaced at once".to_owned(),
                        n => format!("transition over {n} windows"),
                    }
                ),
                Err(why) => println!("window {}: no new grid: {why}", w.index),
            }
        }
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("save");
        let now = self.gather(&self.now.grid);
        let before = self.before.as_ref().map(|b| self.gather(&b.grid)).unwrap_or_default();
        let rebased = !self.motion.is_start_reference();
        let reference = if rebased { self.gather(&self.motion.reference().grid) } else { Vec::new() };
        let start = if self.new_start || self.motion.new_grids() > 0 {
            self.gather(&self.motion.start().grid)
        } else {
            Vec::new()
        };
        let (offset, transition) = match self.motion.transition() {
            Some(transition) => (self.gather(&transition.offset), [transition.step, transition.steps]),
            None => (Vec::new(), [0; 2]),
        };
        if self.motion.grid.comm().is_root() {
            let state = State { now, before, dt: self.dt, reference, start, offset, transition };
            state.save(&case::state_file(folder, Role::Mesh)).map_err(Fault::new)?;
        }
        warm_start::save(&self.motion.save_state(), self.motion.grid.comm(), folder).map_err(Fault::new)?;
        // Copies of the whole grid and their encoded form are freed.
        release_free_memory();
        Ok(())
    }

    fn snapshot(&mut self, _time: f64, _folder: &Path) -> Result<(), Fault> {
        // The flow-solver writes the grid with its fields.
        Ok(())
    }
}

/// Positions of the interface nodes of `grid` among those of all nodes, flat, m.
fn interface_positions(grid: &FlowGrid, all: &[f64]) -> Vec<f64> {
    let all = all.as_chunks::<3>().0;
    grid.canopy_nodes.iter().flat_map(|&a| all[a as usize]).collect()
}

/// Builds new grids around the canopy of `structure`; they have the cells of `grid`. `None` where the scene excludes
/// them.
pub fn regridder(scene: &Scene, structure: &StructureMesh, grid: &FlowGrid) -> Option<Regridder> {
    let when = scene.mesh.regrid;
    let automatic = || {
        let file = scene.flow.as_ref().is_some_and(|f| f.grid_file.is_some());
        !file && !scene.stages.iter().flat_map(|s| &s.body_motions).any(|m| scene.moves_patches(m))
    };
    if !when.quality_threshold.map_or_else(automatic, |t| t > 0.0) {
        return None;
    }
    let (scene, structure) = (scene.clone(), structure.clone());
    let blocks = |grid: &FlowGrid| {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        (grid.coords.len(), &grid.cells, &grid.canopy_nodes).hash(&mut hasher);
        hasher.finish()
    };
    let old = blocks(grid);
    let build: Builder = Box::new(move |canopy| {
        let new = mesh::flow_grid(&scene, &structure, canopy).map_err(|e| e.to_string())?;
        let fits = |(&a, x): (&u32, &Point)| new.coords[a as usize] == *x;
        if blocks(&new) != old || !new.canopy_nodes.iter().zip(canopy).all(fits) {
            return Err("a new grid of this scene would have different cells".into());
        }
        Ok(new.coords)
    });
    Some(Regridder::new(when, build))
}

/// The start grid of a stage, the same on every rank and in the flow-solver.
///
/// # Errors
/// An unreadable shape, or no grid around it.
pub fn start_grid(
    scene: &Scene,
    stage: usize,
    out: &Path,
    structure: &StructureMesh,
) -> Result<FlowGrid, Fault> {
    let positions = match scene.grid_shape(out, stage) {
        Some(path) => mesh::load_shape(&path, structure.n_canopy).map_err(Fault::new)?,
        None => structure.coords[..structure.n_canopy].to_vec(),
    };
    mesh::flow_grid(scene, structure, &positions).map_err(Fault::new)
}

/// Rank of each grid node: METIS partition of the cells, nodes by majority.
///
/// # Errors
/// More ranks than cells.
pub fn owners(grid: &FlowGrid, ranks: usize) -> Result<Vec<u32>, Fault> {
    if ranks == 1 {
        return Ok(vec![0; grid.coords.len()]);
    }
    let faces = FaceTable::new(grid).map_err(Fault::new)?;
    let parts = mesh::partition_cells(grid.cells.len(), &faces, ranks).map_err(Fault::new)?;
    Ok(mesh::node_parts(grid.coords.len(), &grid.cells, &parts))
}

impl From<&case::MeshMotion> for Limits {
    fn from(m: &case::MeshMotion) -> Self {
        Self { min_quality: m.min_quality, max_increments: m.max_increments, repair: true }
    }
}

/// The point nearest to `at`, and its distance.
fn nearest(points: &[Point], at: &Point) -> Option<(usize, f64)> {
    let distance2 = |p: &Point| (0..3).map(|i| (p[i] - at[i]).powi(2)).sum::<f64>();
    let distances = points.iter().map(distance2).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, d)| (k, d.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_point_and_distance_are_found() {
        let points = [[1.0, 2.0, 2.0], [4.0, 6.0, -3.0], [-4.0, -6.0, 3.0]];
        assert_eq!(nearest(&points, &[1.0, 2.0, -3.0]), Some((0, 5.0)));
        assert_eq!(nearest(&points, &[4.0, 9.0, -7.0]), Some((1, 5.0)));
        assert_eq!(nearest(&points, &[-4.0, -9.0, 7.0]), Some((2, 5.0)));
        assert_eq!(nearest(&[], &[0.0; 3]), None);
    }
}
