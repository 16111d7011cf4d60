//! The solver programs of a session as partners of the coupling, with process supervision.

mod failure;
mod partners;
mod structure;
mod watch;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use case::Role;
use channel::{Arrivals, Hub, HubError, HubOptions, Interface, RoleOptions, Stats, Window, flow_stats};
use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::{SolverResponse, Usage};
use coupling::transfer::OwnSurface;
use terminal::Console;

use self::watch::Watch;
use crate::launch::{Program, Supervisor};

/// Time limit for programs to end after the request to end.
const END_WAIT: Duration = Duration::from_secs(10);

/// Definition of a session.
pub struct SessionOptions<'a> {
    /// Name of the session.
    pub session: &'a str,
    /// Name and number of the stage.
    pub stage: (&'a str, usize),
    /// Programs with their ranks.
    pub programs: Vec<(Program, u32)>,
    /// Effects that each role must implement.
    pub effects: Vec<(Role, String)>,
    /// Time limit for one reply.
    pub deadline: Option<Duration>,
    /// Roles whose programs the user starts.
    pub attached: Vec<Role>,
    /// Stores the moving grid for [`Partners::grid`](coupling::partners::Partners::grid).
    pub watch_grid: bool,
    /// Folder of the stage.
    pub folder: PathBuf,
}

/// The solver programs of a stage, running.
pub struct HubPartners<'a> {
    // Drop order: the hub notifies the programs of the failure and waits briefly;
    // the supervisor ends those that are still running.
    hub: Hub,
    supervisor: Supervisor,
    stop: &'a AtomicBool,
    /// Ends the session immediately; set where `stop` completes the current window first.
    now: Option<Arc<AtomicBool>>,
    interrupt_reported: bool,
    console: Console,
    place: Location,
    /// Panel of each canopy node.
    panels: Vec<u32>,
    /// `[grid nodes][6]`: position, m, and velocity, m/s; empty unless `watch_grid`.
    grid: Vec<f64>,
    /// Displacement of the canopy for a flow that moves it through its grid, `[nodes][3]`, m.
    displacement: Vec<f64>,
    /// Whether a mesh-mover runs.
    has_mesh: bool,
    /// Time limit for programs to end.
    end_wait: Duration,
    /// Transfer to the surface of a structure that does not use the canopy mesh.
    own: Option<OwnSurface>,
}

impl<'a> HubPartners<'a> {
    /// Opens the session, starts the programs and waits until all ranks have joined.
    ///
    /// # Errors
    /// A program cannot be started, ends early, does not join, or does not match the scene.
    pub fn start(
        options: SessionOptions<'_>,
        interface: &CanopyInterface,
        stop: &'a AtomicBool,
        console: &Console,
    ) -> Result<Self, RunError> {
        let place = Location { stage: options.stage.0.to_owned(), window: None };
        let hub = Hub::create(hub_options(&options, interface))
            .map_err(|e| RunError::Channel { place: place.clone(), message: e.to_string() })?;
        let has_mesh = options.programs.iter().any(|(program, _)| program.role == Role::Mesh);
        let programs = options.programs.into_iter().map(|(program, _)| program);
        let (attached, started): (Vec<Program>, Vec<Program>) =
            programs.partition(|program| options.attached.contains(&program.role));
        print_start_commands(&attached, console);
        let supervisor = Supervisor::start(started, options.session, console)?;
        let mut all = Self {
            hub,
            supervisor,
            stop,
            now: None,
            interrupt_reported: false,
            console: console.clone(),
            place,
            panels: interface.panels.clone(),
            grid: Vec::new(),
            displacement: vec![0.0; 3 * interface.nodes()],
            has_mesh,
            end_wait: options.deadline.map_or(END_WAIT, |d| d.min(END_WAIT)),
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

    /// Waits until all ranks have joined. `attached`: prints the joined and missing ranks as they change.
    fn await_participants(&mut self, attached: bool) -> Result<(), RunError> {
        let mut joined = 0;
        self.request(|hub, watch| {
            hub.await_participants(&mut |arrivals| {
                if attached && arrivals.arrived.len() > joined {
                    joined = arrivals.arrived.len();
                    watch.console.line(&arrived(arrivals));
                }
                watch.check()?;
                watch.check_ranks()
            })
        })
    }

    /// From now on `stop` does not interrupt a window: the caller checks it between windows. The session ends
    /// immediately when `now` becomes true.
    pub fn complete_windows_on_stop(&mut self, now: Arc<AtomicBool>) {
        self.now = Some(now);
    }

    /// Name and version that the program of `role` announced.
    pub fn announced(&self, role: Role) -> Option<String> {
        self.hub.announcement(role).map(|a| format!("{} {}", a.program, a.version))
    }

    /// Whether the program of `role` supports restart within a stage.
    pub fn resumes(&self, role: Role) -> bool {
        let announced = self.hub.announcement(role);
        announced.is_none_or(|a| a.effects.iter().any(|e| e == channel::RESUME))
    }

    /// Whether the program of `role` accepts windows of another length than the one before.
    pub fn varies_windows(&self, role: Role) -> bool {
        let announced = self.hub.announcement(role);
        announced.is_none_or(|a| a.effects.iter().any(|e| e == partners::VARIABLE_WINDOWS))
    }

    /// Ends the session normally; returns processor time and memory of the programs by role.
    ///
    /// # Errors
    /// The programs do not confirm the end of the session.
    pub fn finish(self, console: &Console) -> Result<Vec<(Role, Usage)>, RunError> {
        let Self { hub, mut supervisor, stop, now, mut interrupt_reported, place, end_wait, .. } = self;
        let used = supervisor.usage();
        let mut watch = Watch {
            supervisor: &mut supervisor,
            stop,
            now: now.as_deref(),
            interrupt_reported: &mut interrupt_reported,
            console,
            failure: None,
        };
        // Programs may end before the hub has received all confirmations: that is not a failure.
        let stopped = hub.stop(&mut || match watch.check() {
            Err(_) if watch.failure.is_some() => Ok(()),
            other => other,
        });
        stopped.map_err(|e| RunError::Channel { place, message: e.to_string() })?;
        for failed in supervisor.finish(end_wait) {
            console
                .warning(&format!("{} did not exit normally after the stage: {}", failed.name, failed.how));
        }
        Ok(used)
    }

    /// Sends a request to the hub, supervises the programs meanwhile, and adds the cause to errors.
    fn request<T>(
        &mut self,
        request: impl FnOnce(&mut Hub, &mut Watch<'_>) -> Result<T, HubError>,
    ) -> Result<T, RunError> {
        let mut watch = Watch {
            supervisor: &mut self.supervisor,
            stop: self.stop,
            now: self.now.as_deref(),
            interrupt_reported: &mut self.interrupt_reported,
            console: &self.console,
            failure: None,
        };
        let response = request(&mut self.hub, &mut watch);
        let failure = watch.failure.take();
        response.map_err(|error| self.run_error(error, failure))
    }

    fn advance(
        &mut self,
        role: Role,
        w: &Window,
        fill: &mut dyn FnMut(&mut [f64]),
        each: &mut dyn FnMut(&[u64], &[f64]),
    ) -> Result<SolverResponse, RunError> {
        self.place.window = Some((w.index, w.iteration));
        self.supervisor.mark_request(role);
        let start = Instant::now();
        let stats = self.request(|hub, watch| {
            hub.advance(role, w, fill)?;
            hub.collect(role, each, &mut || watch.check())
        })?;
        Ok(SolverResponse { stats: of_program(&stats), wall_s: start.elapsed().as_secs_f64() })
    }
}

/// Statistics of a program from those of its ranks. Values are the same on each rank, but for the time of waiting, whose mean
/// counts; the slowest rank decides the time of the program.
fn of_program(ranks: &[Stats]) -> Stats {
    let mut of_all = ranks.first().copied().unwrap_or_default();
    of_all.busy_s = ranks.iter().fold(0.0, |most: f64, s| most.max(s.busy_s));
    // At the same index for all roles.
    let waited_s = ranks.iter().map(|s| s.values[flow_stats::WAITED_S]).sum::<f64>();
    of_all.values[flow_stats::WAITED_S] = waited_s / ranks.len().max(1) as f64;
    of_all
}

#[cfg(test)]
#[test]
fn statistics_of_a_program_have_the_slowest_time_and_the_mean_of_waiting() {
    let rank = |busy_s: f64, waited_s: f64| {
        let mut stats = Stats { busy_s, ..Stats::default() };
        stats.values[flow_stats::ITERATIONS] = 7.0;
        stats.values[flow_stats::WAITED_S] = waited_s;
        stats
    };
    let all = of_program(&[rank(2.0, 0.25), rank(2.5, 0.75)]);
    assert_eq!(
        (all.busy_s, all.values[flow_stats::WAITED_S], all.values[flow_stats::ITERATIONS]),
        (2.5, 0.5, 7.0)
    );
    assert_eq!(
        [channel::structure_stats::WAITED_S, channel::mesh_stats::WAITED_S],
        [flow_stats::WAITED_S; 2]
    );
    assert_eq!(of_program(&[]), Stats::default());
}

/// Options of the hub for these programs and the interface.
fn hub_options(options: &SessionOptions<'_>, interface: &CanopyInterface) -> HubOptions {
    let roles = options.programs.iter().map(|(program, ranks)| RoleOptions {
        role: program.role,
        ranks: *ranks as usize,
        // No deadline for programs that may run under a debugger.
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
fn print_start_commands(attached: &[Program], console: &Console) {
    for program in attached {
        console.line(&format!(
            "waiting for {}; start it with\n  {}",
            program.role.program(),
            program.shell_line()
        ));
    }
    if !attached.is_empty() {
        console.line(
            "(in any order, in other terminals; for a debugger replace `mpirun -n 1` by `gdb --args`, or insert `valgrind` \
             after `mpirun -n N`; these programs have no deadline)",
        );
    }
}

/// A line with the joined and the missing ranks.
fn arrived(arrivals: &Arrivals) -> String {
    let list = |who: Vec<String>| if who.is_empty() { "none".into() } else { who.join(", ") };
    let here =
        arrivals.arrived.iter().map(|(w, program)| format!("{} rank {} ({program})", w.role.name(), w.rank));
    let missing = arrivals.missing.iter().map(|w| format!("{} rank {}", w.role.name(), w.rank));
    format!("joined: {}; missing: {}", list(here.collect()), list(missing.collect()))
}
