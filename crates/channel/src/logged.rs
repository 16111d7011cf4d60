//! The log of a solver program: what it computes, each request with `debug`, totals at its end.
//!
//! Lines go to standard output of the first rank, which the coupler writes to `{stage}/logs/{role}.log`. Warnings and errors
//! are for the user, and go to standard error.

use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use case::Role;
use log::{Level, LevelFilter, debug, info};

use crate::message::{flow_stats, mesh_stats, structure_stats};
use crate::reported_place::{at_text, reported_place};
use crate::{Announcement, Fault, Input, Participant, ServeError, ServeOptions, Stats, Window};

/// Environment variable with the level of the log: `error`, `warn`, `info` (where it is unset), `debug`, or a list of
/// `module=level` as for `env_logger`.
pub const LOG_VARIABLE: &str = "RIPSTOP_LOG";

/// Starts the log of a program, whose lines have the seconds since this call. Ranks but the first write warnings and errors
/// only. No effect where the program has a logger.
pub fn start_log(rank: usize) {
    let start = Instant::now();
    let mut builder = env_logger::Builder::new();
    builder.filter_level(LevelFilter::Info).parse_env(LOG_VARIABLE);
    if rank > 0 {
        builder.filter_level(LevelFilter::Warn);
    }
    builder.target(env_logger::Target::Stdout).format(move |line, record| {
        let level = record.level().as_str().to_lowercase();
        writeln!(line, "{:10.3} s {level:5} {}", start.elapsed().as_secs_f64(), record.args())
    });
    let _ = builder.try_init();
}

/// Whether a line of a program's output is one of its log below a warning: no explanation of a failure.
pub fn is_log_line(line: &str) -> bool {
    let mut words = line.split_whitespace();
    let seconds = words.next().is_some_and(|word| word.parse::<f64>().is_ok());
    seconds && words.next() == Some("s") && matches!(words.next(), Some("info" | "debug" | "trace"))
}

/// A participant whose requests are logged.
pub(crate) struct Logged<'p> {
    participant: &'p mut dyn Participant,
    role: Role,
    solves: u64,
    windows: u64,
    computing_s: f64,
}

impl<'p> Logged<'p> {
    pub fn new(participant: &'p mut dyn Participant, at: &ServeOptions) -> Self {
        start_log(at.rank);
        info!("process {} of session {}, {} ranks", std::process::id(), at.session, at.ranks);
        participant.description().iter().for_each(|line| info!("{line}"));
        Self { participant, role: at.role, solves: 0, windows: 0, computing_s: 0.0 }
    }

    /// Logs the totals of a completed stage.
    pub fn end<T>(&self, end: Result<T, ServeError>) -> Result<T, ServeError> {
        let Self { solves, windows, computing_s, .. } = self;
        if end.is_ok() {
            info!("end: {solves} solves in {windows} accepted windows, {computing_s:.3} s of computing");
        }
        end
    }
}

impl Participant for Logged<'_> {
    fn announce(&self) -> Announcement {
        self.participant.announce()
    }

    fn output_rows(&self) -> Vec<u64> {
        self.participant.output_rows()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.participant.grid_rows()
    }

    fn waited_s(&self) -> f64 {
        self.participant.waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let start = Instant::now();
        let result = self.participant.advance(w, input, output);
        let seconds = start.elapsed().as_secs_f64();
        self.solves += 1;
        self.computing_s += seconds;
        // Numbers are put into words only where they are read.
        if log::log_enabled!(Level::Debug) {
            let what = match &result {
                Ok(stats) => effort(self.role, &stats.values),
                Err(fault) => format!("failed: {fault}"),
            };
            debug!(
                "window {}, solve {}, t {:.6} s: {what}; {seconds:.4} s",
                w.index,
                w.iteration,
                w.time + w.dt
            );
        }
        result
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        self.windows += 1;
        debug!("window {} accepted", w.index);
        self.participant.accept(w)
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        debug!("state saved in {}", folder.display());
        self.participant.save(folder)
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        debug!("snapshot of t {time:.6} s in {}", folder.display());
        self.participant.snapshot(time, folder)
    }
}

/// What a solve took and reached, in words.
fn effort(role: Role, values: &[f64]) -> String {
    let residual = |reached: usize, target: usize| match values[target] {
        0.0 => format!("residual {:.2e}", values[reached]),
        target => format!("residual {:.2e} of {target:.2e} allowed", values[reached]),
    };
    match role {
        Role::Structure => {
            use structure_stats as at;
            format!(
                "{} Newton steps, {} GMRES iterations, {} factorisations, {} steps cut, {}",
                values[at::NEWTON_STEPS],
                values[at::GMRES_ITERATIONS],
                values[at::FACTORISATIONS],
                values[at::STEP_CUTS],
                residual(at::RESIDUAL, at::RESIDUAL_TARGET)
            )
        }
        Role::Flow => {
            use flow_stats as at;
            let cell = match values[at::CELL_ERROR_TARGET] {
                0.0 => String::new(),
                target => {
                    let place = at_text(reported_place(values, at::CELL_ERROR_AT));
                    format!(", error of a cell {:.2e} of {target:.2e} allowed{place}", values[at::CELL_ERROR])
                }
            };
            format!(
                "{} pseudo-time iterations, {} linear iterations, Courant number {:.2}, Mach number {:.4}{}, residual before {:.2e}, {}{cell}",
                values[at::ITERATIONS],
                values[at::LINEAR_ITERATIONS],
                values[at::MAX_COURANT],
                values[at::MAX_MACH],
                at_text(reported_place(values, at::MAX_MACH_AT)),
                values[at::RESIDUAL_START],
                residual(at::RESIDUAL_END, at::RESIDUAL_TARGET)
            )
        }
        Role::Mesh => {
            use mesh_stats as at;
            format!(
                "{} iterations in {} increments, smallest scaled Jacobian {:.4} in cell {}, {}",
                values[at::ITERATIONS],
                values[at::INCREMENTS],
                values[at::MIN_QUALITY],
                values[at::WORST_CELL],
                residual(at::RESIDUAL, at::RESIDUAL_TARGET)
            )
        }
    }
}
