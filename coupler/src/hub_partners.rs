//! The real programs behind the channel, watched over while they work.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use case::Role;
use channel::{
    Abort, Arrivals, Hub, HubError, HubOptions, Interface, LOAD_WIDTH, OWN_SURFACE, RoleOptions, Stats, Who,
    Window, flow_stats, mesh_stats, structure_stats,
};
use coupling::error::{Place, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::{Answer, LoadOverWindow, Partners, Usage};
use coupling::structure_energy::EnergyCreated;
use coupling::transfer::{OwnSurface, surface_file};
use terminal::Console;

use crate::launch::{Casualty, Program, Supervisor};

/// How long a dead rank's launcher may take to say what happened.
const FATE: Duration = Duration::from_millis(1500);
/// How long programs may take to end after they were told to.
const FAREWELL: Duration = Duration::from_secs(10);

/// What a program announces that starts a window again with another length.
const VARIES: &str = "coupling.adaptive";

/// What a session is made of.
pub struct SessionOptions<'a> {
    /// Name of the session.
    pub session: &'a str,
    /// Name and number of the stage.
    pub stage: (&'a str, usize),
    /// Programs with their ranks.
    pub programs: Vec<(Program, u32)>,
    /// Effects that each role must implement.
    pub effects: Vec<(Role, String)>,
    /// Longest time for one answer.
    pub deadline: Option<Duration>,
    /// Roles whose programs somebody else starts.
    pub attached: Vec<Role>,
    /// Keeps the mesh's grid for [`Partners::grid`].
    pub watch_grid: bool,
    /// Folder of the stage.
    pub folder: PathBuf,
}

/// The solver programs of a stage, running.
pub struct HubPartners<'a> {
    // Dropped in this order: the hub tells the programs that the run has failed
    // and waits a moment; the supervisor ends those that do not listen.
    hub: Hub,
    supervisor: Supervisor,
    stop: &'a AtomicBool,
    /// Where windows come to their ends before all ends: what ends all at once.
    now: Option<Arc<AtomicBool>>,
    told: bool,
    console: Console,
    place: Place,
    /// Panel of each canopy node.
    panels: Vec<u32>,
    /// `[grid nodes][6]`; empty where nobody watches.
    grid: Vec<f64>,
    /// How long programs may take to end.
    farewell: Duration,
    /// Where the structure's surface is not the canopy.
    own: Option<OwnSurface>,
}

/// Looks after the programs while the hub waits.
struct Watch<'a> {
    supervisor: &'a mut Supervisor,
    stop: &'a AtomicBool,
    now: Option<&'a AtomicBool>,
    told: &'a mut bool,
    console: &'a Console,
    casualty: Option<Casualty>,
}

impl Watch<'_> {
    fn look(&mut self) -> Result<(), Abort> {
        if self.stop.load(Ordering::Relaxed) {
            if self.now.is_none_or(|now| now.load(Ordering::Relaxed)) {
                return Err(Abort::new("interrupted"));
            }
            if !std::mem::replace(self.told, true) {
                self.console
                    .line("interrupted: this window is finished and saved; once more ends all at once");
            }
        }
        self.casualty = self.supervisor.casualty();
        self.told_by_casualty()
    }

    /// Whether ranks have ended before they joined.
    fn count(&mut self) -> Result<(), Abort> {
        self.casualty = self.supervisor.deserted();
        self.told_by_casualty()
    }

    fn told_by_casualty(&self) -> Result<(), Abort> {
        match &self.casualty {
            Some(casualty) => Err(Abort::new(&casualty.how)),
            None => Ok(()),
        }
    }
}

impl<'a> HubPartners<'a> {
    /// Opens the session, starts the programs and waits until all have arrived.
    ///
    /// # Errors
    /// A program that cannot be started, dies, does not arrive, or does not fit.
    pub fn start(
        options: SessionOptions<'_>,
        interface: &CanopyInterface,
        stop: &'a AtomicBool,
        console: &Console,
    ) -> Result<Self, RunError> {
        let place = Place { stage: options.stage.0.to_owned(), window: None };
        let roles = options.programs.iter().map(|(program, ranks)| RoleOptions {
            role: program.role,
            ranks: *ranks as usize,
            // Whoever sits at a debugger takes the time that it takes.
            deadline: options.deadline.filter(|_| !options.attached.contains(&program.role)),
            effects: options
                .effects
                .iter()
                .filter(|(r, _)| *r == program.role)
                .map(|(_, e)| e.clone())
                .collect(),
        });
        let hub = Hub::create(HubOptions {
            session: options.session.to_owned(),
            roles: roles.collect(),
            stage: options.stage.1,
            interface: Some(Interface {
                nodes: interface.nodes() as u64,
                faces: interface.faces.len() as u64,
                surface_hash: channel::surface_hash(&interface.faces),
            }),
            arrival_deadline: options.deadline.filter(|_| options.attached.is_empty()),
            watch_grid: options.watch_grid,
        })
        .map_err(|e| RunError::Channel { place: place.clone(), message: e.to_string() })?;
        let (attached, started): (Vec<Program>, Vec<Program>) = options
            .programs
            .into_iter()
            .map(|(program, _)| program)
            .partition(|program| options.attached.contains(&program.role));
        for program in &attached {
            console.line(&format!(
                "waiting for {}; start it with\n  {}",
                program.role.program(),
                program.shell_line()
            ));
        }
        if !attached.is_empty() {
            console.line(
                "(in any order, in other terminals; `gdb --args` goes into the place of `mpirun -n 1`, `valgrind` \
                 behind `mpirun -n N`; there is no deadline for these programs)",
            );
        }
        let supervisor = Supervisor::start(started, options.session, console)?;
        let farewell = options.deadline.map_or(FAREWELL, |d| d.min(FAREWELL));
        let mut all = Self {
            hub,
            supervisor,
            stop,
            now: None,
            told: false,
            console: console.clone(),
            place,
            panels: interface.panels.clone(),
            grid: Vec::new(),
            farewell,
            own: None,
        };
        let mut told = 0;
        all.ask(|hub, watch| {
            hub.await_participants(&mut |arrivals| {
                if !attached.is_empty() && arrivals.arrived.len() > told {
                    told = arrivals.arrived.len();
                    console.line(&arrived(arrivals));
                }
                watch.look()?;
                watch.count()
            })
        })?;
        all.own = all.own_surface(&options.folder, interface, console)?;
        if options.watch_grid {
            let nodes = all.hub.announcement(Role::Mesh).map_or(0, |a| a.grid_nodes);
            all.grid = vec![0.0; 6 * nodes as usize];
        }
        Ok(all)
    }

    /// From now on a signal to end lets windows come to their ends: whoever asks for them looks
    /// at it in between. When `now` becomes true all ends at once.
    pub fn finish_windows(&mut self, now: Arc<AtomicBool>) {
        self.now = Some(now);
    }

    /// Whether the program of `role` can go on in the middle of a stage.
    pub fn resumes(&self, role: Role) -> bool {
        let announced = self.hub.announcement(role);
        announced.is_none_or(|a| a.effects.iter().any(|e| e == channel::RESUME))
    }

    /// The surface of a structure that has its own.
    fn own_surface(
        &self,
        folder: &Path,
        interface: &CanopyInterface,
        console: &Console,
    ) -> Result<Option<OwnSurface>, RunError> {
        let said = self.hub.announcement(Role::Structure);
        let Some(said) = said.filter(|a| a.effects.iter().any(|e| e == OWN_SURFACE)) else { return Ok(None) };
        let refuse = |message| RunError::Channel { place: self.place.clone(), message };
        let file = surface_file(folder);
        let text = std::fs::read_to_string(&file).map_err(|e| e.to_string());
        let own = text.and_then(|text| OwnSurface::parse(&text, interface));
        let bad = |why| refuse(format!("the structure's own surface, {}: {why}", file.display()));
        let own = own.map_err(bad)?;
        let [nodes, faces] = own.sizes();
        if (nodes as u64, faces as u64) != (said.canopy_nodes, said.canopy_faces) {
            return Err(refuse(format!(
                "{} announces a surface of {} nodes and {} faces, its file has {nodes} and {faces}",
                said.program, said.canopy_nodes, said.canopy_faces
            )));
        }
        console.line(&format!(
            "{} has a surface of its own: {nodes} nodes and {faces} faces beside the canopy's {} and {}",
            said.program,
            interface.nodes(),
            interface.faces.len()
        ));
        Ok(Some(own))
    }

    /// Ends the session in good order; what the programs have used by role.
    ///
    /// # Errors
    /// A program that fails at the very end.
    pub fn finish(self, console: &Console) -> Result<Vec<(Role, Usage)>, RunError> {
        let Self { hub, mut supervisor, stop, now, mut told, place, farewell, .. } = self;
        let used = supervisor.usage();
        let mut watch = Watch {
            supervisor: &mut supervisor,
            stop,
            now: now.as_deref(),
            told: &mut told,
            console,
            casualty: None,
        };
        // Programs may be gone before the hub has seen all goodbyes: that is no casualty.
        let stopped = hub.stop(&mut || match watch.look() {
            Err(_) if watch.casualty.is_some() => Ok(()),
            other => other,
        });
        stopped.map_err(|e| RunError::Channel { place, message: e.to_string() })?;
        for bad in supervisor.finish(farewell) {
            console.warning(&format!("{} did not end well after its work: {}", bad.name, bad.how));
        }
        Ok(used)
    }

    /// A question to the hub, with the programs watched and every error told in full.
    fn ask<T>(
        &mut self,
        question: impl FnOnce(&mut Hub, &mut Watch<'_>) -> Result<T, HubError>,
    ) -> Result<T, RunError> {
        let mut watch = Watch {
            supervisor: &mut self.supervisor,
            stop: self.stop,
            now: self.now.as_deref(),
            told: &mut self.told,
            console: &self.console,
            casualty: None,
        };
        let answer = question(&mut self.hub, &mut watch);
        let casualty = watch.casualty.take();
        answer.map_err(|error| self.explain(error, casualty))
    }

    fn explain(&mut self, error: HubError, casualty: Option<Casualty>) -> RunError {
        let place = self.place.clone();
        // The signal may also have cut a system call short: that is no error of its own.
        let at_once = self.now.as_ref().is_none_or(|now| now.load(Ordering::Relaxed));
        if self.stop.load(Ordering::Relaxed) && at_once {
            return RunError::Interrupted(place);
        }
        // The launcher knows best who was first: it ends the other ranks itself.
        let died = |casualty: Casualty, rank: Option<u64>| RunError::Died {
            role: casualty.role,
            program: casualty.name,
            rank: casualty.rank.or(rank),
            how: casualty.how,
            place: place.clone(),
            tail: casualty.tail,
        };
        match error {
            HubError::Aborted(_) => match casualty {
                Some(casualty) => died(casualty, None),
                None => RunError::Interrupted(place),
            },
            HubError::Fault { who: Who { role, rank }, fault, .. } => RunError::Fault {
                role,
                program: self.supervisor.name(role),
                rank: Some(rank as u64),
                place,
                message: fault.message,
            },
            HubError::Died { who: Who { role, rank }, .. } => {
                let casualty = self.supervisor.fate(role, FATE).unwrap_or_else(|| Casualty {
                    role,
                    name: self.supervisor.name(role),
                    rank: None,
                    how: "killed or crashed".into(),
                    tail: String::new(),
                });
                died(casualty, Some(rank as u64))
            }
            HubError::Deadline { who, seconds, state, .. } => RunError::Stalled {
                role: who.role,
                program: format!("{} rank {}", self.supervisor.name(who.role), who.rank),
                seconds,
                state,
                place,
            },
            other => RunError::Channel { place, message: other.to_string() },
        }
    }

    /// Asks the structure, on its own surface where it has one.
    fn structure_on(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
        own: Option<&mut OwnSurface>,
    ) -> Result<Answer, RunError> {
        let Some(own) = own else { return self.ask_structure(w, [load.start, load.end], displacement) };
        own.load(load);
        let (loads, answer) = own.exchange();
        let answer = self.ask_structure(w, loads, answer)?;
        own.motion(displacement);
        Ok(answer)
    }

    fn ask_structure(
        &mut self,
        w: &Window,
        [start, end]: [&[f64]; 2],
        displacement: &mut [f64],
    ) -> Result<Answer, RunError> {
        let mut fill = |input: &mut [f64]| {
            let faces = start.chunks_exact(LOAD_WIDTH).zip(end.chunks_exact(LOAD_WIDTH));
            for (row, (start, end)) in input.chunks_exact_mut(2 * LOAD_WIDTH).zip(faces) {
                row[..LOAD_WIDTH].copy_from_slice(start);
                row[LOAD_WIDTH..].copy_from_slice(end);
            }
        };
        let mut keep = |rows: &[u64], data: &[f64]| scatter(rows, data, 3, displacement);
        self.advance(Role::Structure, w, &mut fill, &mut keep)
    }

    fn no_answer(&self, role: Role, what: &str, remedies: &str) -> RunError {
        let program = self.supervisor.name(role);
        let said =
            self.supervisor.last_line(role).map_or_else(String::new, |line| format!("; it wrote `{line}`"));
        let message = format!(
            "{what}{said}. Remedies: shorter windows (window_s, coupling.adaptive.halvings), {remedies}"
        );
        RunError::NoAnswer { role, program, place: self.place.clone(), message, saved: None }
    }

    fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
        each: &mut dyn FnMut(&[u64], &[f64]),
    ) -> Result<Answer, RunError> {
        self.place.window = Some((w.index, w.iteration));
        self.supervisor.asked(role);
        let start = Instant::now();
        let stats = self.ask(|hub, watch| {
            hub.advance(role, w, fill)?;
            hub.collect(role, each, &mut || watch.look())
        })?;
        // Values are the same on each rank; the slowest rank decides the time.
        let busy_s = stats.iter().fold(0.0, |most: f64, s| most.max(s.busy_s));
        let stats = Stats { busy_s, ..stats.first().copied().unwrap_or_default() };
        Ok(Answer { stats, wall_s: start.elapsed().as_secs_f64() })
    }
}

/// Who has arrived and who has not, in a line.
fn arrived(arrivals: &Arrivals) -> String {
    let list = |who: Vec<String>| if who.is_empty() { "nobody".into() } else { who.join(", ") };
    let here =
        arrivals.arrived.iter().map(|(w, program)| format!("{} rank {} ({program})", w.role.name(), w.rank));
    let missing = arrivals.missing.iter().map(|w| format!("{} rank {}", w.role.name(), w.rank));
    format!("arrived: {}; missing: {}", list(here.collect()), list(missing.collect()))
}

/// Puts rows of `width` numbers at their places in `all`.
fn scatter(rows: &[u64], data: &[f64], width: usize, all: &mut [f64]) {
    for (row, values) in rows.iter().zip(data.chunks_exact(width)) {
        all[*row as usize * width..][..width].copy_from_slice(values);
    }
}

/// What a grid that cannot follow says: cell, quality, canopy region.
fn stuck(values: &[f64; channel::STATS], panels: &[u32]) -> String {
    let cell = match values[mesh_stats::WORST_CELL] {
        cell if cell >= 0.0 => {
            format!(
                "cell {cell} has scaled Jacobian {:.3e} in the best attempt",
                values[mesh_stats::MIN_QUALITY]
            )
        }
        _ => "its solver found no answer".into(),
    };
    let region = match values[mesh_stats::NEAREST_NODE] {
        node if node >= 0.0 => {
            let panel = panels.get(node as usize).map(|p| format!(" (panel {p})")).unwrap_or_default();
            format!("; nearest canopy node {node}{panel}")
        }
        _ => String::new(),
    };
    format!(
        "{cell}{region}; the log of the mesh-mover says more. Remedies: a start grid around a shape nearer to \
         this one, mesh.regrid, shorter windows, a lower mesh.min_quality"
    )
}

impl Partners for HubPartners<'_> {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<Answer, RunError> {
        let mut own = self.own.take();
        let answer = self.structure_on(w, load, displacement, own.as_mut());
        self.own = own;
        let answer = answer?;
        if answer.stats.values[structure_stats::RESIDUAL] >= 0.0 {
            return match EnergyCreated::check(&answer.stats.values, w.time + w.dt) {
                Some(energy) => Err(RunError::Energy { place: self.place.clone(), energy, saved: None }),
                None => Ok(answer),
            };
        }
        let cuts = answer.stats.values[structure_stats::STEP_CUTS];
        let what = format!("a time step has no solution, also after {cuts} halvings");
        Err(self.no_answer(Role::Structure, &what, "smaller steps (stage.substeps), more damping"))
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<Answer, RunError> {
        let mut fill = |input: &mut [f64]| input.copy_from_slice(displacement);
        let mut grid = std::mem::take(&mut self.grid);
        let mut keep = |rows: &[u64], data: &[f64]| {
            if !grid.is_empty() {
                scatter(rows, data, 6, &mut grid);
            }
        };
        let answer = self.advance(Role::Mesh, w, &mut fill, &mut keep);
        self.grid = grid;
        let answer = answer?;
        if answer.stats.values[mesh_stats::STUCK] == 0.0 {
            return Ok(answer);
        }
        let message = stuck(&answer.stats.values, &self.panels);
        Err(RunError::Stuck { place: self.place.clone(), message, saved: None })
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<Answer, RunError> {
        let mut keep = |rows: &[u64], data: &[f64]| scatter(rows, data, LOAD_WIDTH, load);
        let answer = self.advance(Role::Flow, w, &mut |_| {}, &mut keep)?;
        let values = &answer.stats.values;
        let what = match values[flow_stats::NO_ANSWER] {
            0.0 => return Ok(answer),
            1.0 => format!(
                "its iterations diverged: residual {:.3e} after {} iterations from {:.3e}",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START]
            ),
            2.0 => "its state left what is physical".into(),
            4.0 => format!(
                "its time step is not solved: residual {:.3e} N after {} iterations from {:.3e} N, {:.3e} N is asked",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START],
                values[flow_stats::RESIDUAL_TARGET]
            ),
            _ => "a cell of the moved grid has no volume".into(),
        };
        Err(self.no_answer(Role::Flow, &what, "more flow.solver.max_iterations, a larger first_layer_m"))
    }

    fn fixed_windows(&self) -> Vec<String> {
        let fixed = |role: &Role| {
            let a = self.hub.announcement(*role)?;
            let varies = a.effects.iter().any(|e| e == VARIES);
            (!varies).then(|| format!("{} ({})", role.program(), a.program))
        };
        Role::ALL.iter().filter_map(fixed).collect()
    }

    fn without_support_force(&self) -> Option<String> {
        let a = self.hub.announcement(Role::Structure)?;
        let balanced = a.effects.iter().any(|e| e == channel::SUPPORT_FORCE);
        (!balanced).then(|| format!("{} ({})", Role::Structure.program(), a.program))
    }

    fn accept(&mut self, w: &Window) -> Result<(), RunError> {
        self.ask(|hub, watch| {
            // Short windows never wait long enough for the hub to look by itself.
            watch.look().map_err(HubError::Aborted)?;
            hub.accept(w, &mut || watch.look())
        })?;
        if let Some(own) = &mut self.own {
            own.accept();
        }
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), RunError> {
        self.ask(|hub, watch| hub.save(folder, &mut || watch.look()))
    }

    fn snapshot(&mut self, role: Role, time: f64, folder: &Path) -> Result<(), RunError> {
        self.ask(|hub, watch| hub.snapshot(&[role], time, folder, &mut || watch.look()))
    }

    fn cannot_resume(&self) -> Vec<String> {
        let missing = Role::ALL.into_iter().filter(|r| !self.resumes(*r));
        missing.map(|r| self.supervisor.name(r)).collect()
    }

    fn used(&self) -> Vec<(Role, Usage)> {
        self.supervisor.usage()
    }

    fn grid(&self) -> Option<&[f64]> {
        (!self.grid.is_empty()).then_some(&self.grid)
    }
}
