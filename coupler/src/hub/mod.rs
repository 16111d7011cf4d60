//! The real programs behind the channel, watched over while they work.

mod failure;
mod partners;
mod structure;
mod watch;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use case::Role;
use channel::{Arrivals, Hub, HubError, HubOptions, Interface, RoleOptions, Stats, Window};
use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::{SolverResponse, Usage};
use coupling::transfer::OwnSurface;
use terminal::Console;

use self::watch::Watch;
use crate::launch::{Program, Supervisor};

/// Time limit for programs to end after the request to end.
const FAREWELL: Duration = Duration::from_secs(10);

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
    // Dropped in this order: the hub informs the programs that the run has failed
    // and waits a moment; the supervisor ends those that do not listen.
    hub: Hub,
    supervisor: Supervisor,
    stop: &'a AtomicBool,
    /// Where windows come to their ends before all ends: what ends all at once.
    now: Option<Arc<AtomicBool>>,
    announced: bool,
    console: Console,
    place: Location,
    /// Panel of each canopy node.
    panels: Vec<u32>,
    /// `[grid nodes][6]`; empty where nobody watches.
    grid: Vec<f64>,
    /// How long programs may take to end.
    farewell: Duration,
    /// Where the structure's surface is not the canopy.
    own: Option<OwnSurface>,
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
        let place = Location { stage: options.stage.0.to_owned(), window: None };
        let hub = Hub::create(hub_options(&options, interface))
            .map_err(|e| RunError::Channel { place: place.clone(), message: e.to_string() })?;
        let programs = options.programs.into_iter().map(|(program, _)| program);
        let (attached, started): (Vec<Program>, Vec<Program>) =
            programs.partition(|program| options.attached.contains(&program.role));
        call_for(&attached, console);
        let supervisor = Supervisor::start(started, options.session, console)?;
        let mut all = Self {
            hub,
            supervisor,
            stop,
            now: None,
            announced: false,
            console: console.clone(),
            place,
            panels: interface.panels.clone(),
            grid: Vec::new(),
            farewell: options.deadline.map_or(FAREWELL, |d| d.min(FAREWELL)),
            own: None,
        };
        all.await_participants(!attached.is_empty())?;
        all.own = all.own_surface(&options.folder, interface, console)?;
        if options.watch_grid {
            let nodes = all.hub.announcement(Role::Mesh).map_or(0, |a| a.grid_nodes);
            all.grid = vec![0.0; 6 * nodes as usize];
        }
        Ok(all)
    }

    /// Waits until all ranks have joined; `by_hand`: says who has, for those that a person starts.
    fn await_participants(&mut self, by_hand: bool) -> Result<(), RunError> {
        let mut announced = 0;
        self.ask(|hub, watch| {
            hub.await_participants(&mut |arrivals| {
                if by_hand && arrivals.arrived.len() > announced {
                    announced = arrivals.arrived.len();
                    watch.console.line(&arrived(arrivals));
                }
                watch.look()?;
                watch.count()
            })
        })
    }

    /// From now on a signal to end lets windows come to their ends: whoever asks for them looks
    /// at it in between. When `now` becomes true all ends at once.
    pub fn finish_windows(&mut self, now: Arc<AtomicBool>) {
        self.now = Some(now);
    }

    /// Whether the program of `role` supports restart within a stage.
    pub fn resumes(&self, role: Role) -> bool {
        let announced = self.hub.announcement(role);
        announced.is_none_or(|a| a.effects.iter().any(|e| e == channel::RESUME))
    }

    /// Ends the session in good order; what the programs have used by role.
    ///
    /// # Errors
    /// A program that fails at the very end.
    pub fn finish(self, console: &Console) -> Result<Vec<(Role, Usage)>, RunError> {
        let Self { hub, mut supervisor, stop, now, mut announced, place, farewell, .. } = self;
        let used = supervisor.usage();
        let mut watch = Watch {
            supervisor: &mut supervisor,
            stop,
            now: now.as_deref(),
            announced: &mut announced,
            console,
            failure: None,
        };
        // Programs may be gone before the hub has seen all goodbyes: that is no failure.
        let stopped = hub.stop(&mut || match watch.look() {
            Err(_) if watch.failure.is_some() => Ok(()),
            other => other,
        });
        stopped.map_err(|e| RunError::Channel { place, message: e.to_string() })?;
        for bad in supervisor.finish(farewell) {
            console.warning(&format!("{} did not end well after its work: {}", bad.name, bad.how));
        }
        Ok(used)
    }

    /// A request to the hub, with the programs watched and the cause of every error.
    fn ask<T>(
        &mut self,
        question: impl FnOnce(&mut Hub, &mut Watch<'_>) -> Result<T, HubError>,
    ) -> Result<T, RunError> {
        let mut watch = Watch {
            supervisor: &mut self.supervisor,
            stop: self.stop,
            now: self.now.as_deref(),
            announced: &mut self.announced,
            console: &self.console,
            failure: None,
        };
        let answer = question(&mut self.hub, &mut watch);
        let failure = watch.failure.take();
        answer.map_err(|error| self.explain(error, failure))
    }

    fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
        each: &mut dyn FnMut(&[u64], &[f64]),
    ) -> Result<SolverResponse, RunError> {
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
        Ok(SolverResponse { stats, wall_s: start.elapsed().as_secs_f64() })
    }
}

/// What the hub needs to know of the programs and of their exchange.
fn hub_options(options: &SessionOptions<'_>, interface: &CanopyInterface) -> HubOptions {
    let roles = options.programs.iter().map(|(program, ranks)| RoleOptions {
        role: program.role,
        ranks: *ranks as usize,
        // Whoever sits at a debugger takes the time that it takes.
        deadline: options.deadline.filter(|_| !options.attached.contains(&program.role)),
        effects: options.effects.iter().filter(|(r, _)| *r == program.role).map(|(_, e)| e.clone()).collect(),
    });
    HubOptions {
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
    }
}

/// Prints the commands of the programs to start.
fn call_for(attached: &[Program], console: &Console) {
    for program in attached {
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
}

/// Who has arrived and who has not, in a line.
fn arrived(arrivals: &Arrivals) -> String {
    let list = |who: Vec<String>| if who.is_empty() { "nobody".into() } else { who.join(", ") };
    let here =
        arrivals.arrived.iter().map(|(w, program)| format!("{} rank {} ({program})", w.role.name(), w.rank));
    let missing = arrivals.missing.iter().map(|w| format!("{} rank {}", w.role.name(), w.rank));
    format!("arrived: {}; missing: {}", list(here.collect()), list(missing.collect()))
}
