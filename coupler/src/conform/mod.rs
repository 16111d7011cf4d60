//! `ripstop conform`: does a program keep the contract?
//!
//! The program runs alone. It receives requests from a recording, and requests that no
//! run sends (zero and extreme input). Each test starts the program in a new session.
//! The module `physics` asks whether the answers can be those of a canopy, of air or of a grid.

mod compared;
mod physics;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;
use channel::{LOAD_WIDTH, STATS, Window};
use coupling::error::RunError;
use coupling::partners::{LoadOverWindow, Partners};
use results::recording::{Event, Reader};
use terminal::Console;

use crate::hub::HubPartners;
use crate::replay::{ProgramOptions, ProgramSession, halves};

/// The program to test, and the tolerance of its repeatability.
#[derive(clap::Args)]
pub struct ConformArgs {
    /// Role that the program plays: structure, flow or mesh
    #[arg(value_parser = crate::arguments::role)]
    role: Role,
    /// Folder that `ripstop run --record` wrote: the scene and the requests to send
    recording: PathBuf,
    /// The program [default: the project's own]
    #[arg(long, value_name = "COMMAND", default_value = "")]
    command: String,
    /// Ranks of the program [default: as recorded]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    ranks: Option<u32>,
    /// Stage [default: the last one in which the program participated]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Relative tolerance of two replies to the same request (scale: the largest value). A program that
    /// warm-starts from its previous solution needs its own solver tolerance here
    #[arg(long, value_name = "RATIO", default_value_t = 1e-3, value_parser = crate::arguments::ratio)]
    tolerance: f64,
    /// Run this test and the two that all require; may be repeated [default: all tests]
    #[arg(long, value_name = "NAME", value_parser = test_name)]
    only: Vec<String>,
    /// Time limit for one reply, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = crate::arguments::seconds)]
    deadline: f64,
}

/// The name of a test.
fn test_name(name: &str) -> Result<String, String> {
    let names: Vec<&str> = TESTS.iter().map(|(name, _)| *name).collect();
    if names.contains(&name) {
        return Ok(name.into());
    }
    Err(format!("there is no test of this name; the tests are {}", names.join(", ")))
}

/// Result of a conformance test.
#[derive(Clone, Debug, PartialEq)]
enum Verdict {
    Passed(String),
    Failed(String),
    Skipped(String),
}

/// Input of a program for one window.
#[derive(Clone)]
enum Request {
    /// Load at the start and at the end of the window, each `[faces][LOAD_WIDTH]`.
    Structure([Vec<f64>; 2]),
    /// Displacement of the canopy, `[nodes][3]`, m.
    Mesh(Vec<f64>),
    /// Displacement for the recorded mesh-mover. `None`: the grid is at rest.
    Flow(Option<Vec<f64>>),
}

impl Request {
    fn send(&self, partners: &mut HubPartners<'_>, w: &Window, size: usize) -> Result<Vec<f64>, RunError> {
        self.answer(partners, w, size).map(|(reply, _)| reply)
    }

    /// The reply with its statistics.
    fn answer(
        &self,
        partners: &mut HubPartners<'_>,
        w: &Window,
        size: usize,
    ) -> Result<(Vec<f64>, [f64; STATS]), RunError> {
        let mut reply = vec![0.0; size];
        let response = match self {
            Self::Structure([start, end]) => {
                partners.structure(w, LoadOverWindow { start, end }, &mut reply)?
            }
            Self::Mesh(displacement) => {
                let response = partners.mesh(w, displacement)?;
                reply = partners.grid().unwrap_or(&[]).to_vec();
                response
            }
            Self::Flow(displacement) => {
                if let Some(displacement) = displacement {
                    partners.mesh(w, displacement)?;
                }
                partners.flow(w, &mut reply)?
            }
        };
        Ok((reply, response.stats.values))
    }

    /// The request with all input values times `factor`. `None` for the flow, whose only input is the grid.
    fn scaled(&self, factor: f64) -> Option<Self> {
        let times = |v: &Vec<f64>| v.iter().map(|x| factor * x).collect::<Vec<f64>>();
        match self {
            Self::Structure(load) => Some(Self::Structure([times(&load[0]), times(&load[1])])),
            Self::Mesh(displacement) => Some(Self::Mesh(times(displacement))),
            Self::Flow(_) => None,
        }
    }
}

/// A window of a recording.
struct Recorded {
    /// The window at its first request.
    window: Window,
    /// The first request.
    first: Request,
    /// The last one, whose answer was accepted.
    last: Request,
    /// The window at that request.
    accepted: Window,
    /// The accepted answer, where it is recorded.
    reply: Option<Vec<f64>>,
}

/// The first two windows of a recording.
struct Script {
    windows: Vec<Recorded>,
    /// Values of a reply.
    size: usize,
}

impl Script {
    fn of(session: &ProgramSession) -> Result<Self, RunError> {
        let mut reader = Reader::open(&session.file)?;
        let canopy = &session.prepared.interface;
        let size = match session.role {
            Role::Structure => 3 * canopy.nodes(),
            Role::Flow => LOAD_WIDTH * canopy.faces.len(),
            Role::Mesh => 6 * reader.header().grid_nodes as usize,
        };
        let mut windows = Vec::new();
        let mut requests: Vec<(Window, Request, Option<Vec<f64>>)> = Vec::new();
        let mut moved = None;
        while let Some(event) = reader.next_event()? {
            let w = Window::from(event.at());
            match (event, session.role) {
                (Event::Structure { load, displacement, .. }, Role::Structure) => {
                    requests.push((w, Request::Structure(halves(&load)), Some(displacement)));
                }
                (Event::Mesh { displacement, grid, .. }, Role::Mesh) => {
                    requests.push((w, Request::Mesh(displacement), grid));
                }
                (Event::Mesh { displacement, .. }, Role::Flow) => moved = Some(displacement),
                (Event::Flow { load, .. }, Role::Flow) => {
                    requests.push((w, Request::Flow(moved.clone()), Some(load)));
                }
                (Event::Accept { .. }, _) if !requests.is_empty() => {
                    let (first, last) = (requests[0].clone(), requests[requests.len() - 1].clone());
                    requests.clear();
                    windows.push(Recorded {
                        window: Window { iteration: 0, ..first.0 },
                        first: first.1,
                        last: last.1,
                        accepted: Window { iteration: 0, ..last.0 },
                        reply: last.2,
                    });
                    if windows.len() == 2 {
                        return Ok(Self { windows, size });
                    }
                }
                _ => {}
            }
        }
        Err(RunError::Input(format!(
            "{} has {} complete windows with the {}; a conformance test needs 2: record a longer run",
            session.file.display(),
            windows.len(),
            session.role.name()
        )))
    }
}

/// The window at a later coupling iteration.
fn at_iteration(w: &Window, iteration: u64) -> Window {
    Window { iteration, ..*w }
}

/// Relative difference of two replies in the maximum norm. The scale is the largest value of the first, or of the
/// second where the first is 0 throughout.
fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let difference = a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
    let scale = if largest(a) > 0.0 { largest(a) } else { largest(b) };
    if difference == 0.0 { 0.0 } else { difference / scale }
}

fn finite(reply: &[f64]) -> Result<(), String> {
    match reply.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(format!("value {i} of the reply is {}", reply[i])),
    }
}

/// Runs all conformance tests: whether the program passed, and the table of results.
///
/// # Errors
/// A recording that cannot be used, or an interrupt. Failures of the program are verdicts, not errors.
pub fn conform(args: &ConformArgs, stop: &AtomicBool, console: &Console) -> Result<(bool, String), RunError> {
    let options = ProgramOptions {
        role: args.role,
        command: &args.command,
        ranks: args.ranks,
        stage: args.stage.as_deref(),
        out: None,
        deadline: Duration::from_secs_f64(args.deadline),
    };
    let session = ProgramSession::new(&args.recording, &options)?;
    let script = Script::of(&session)?;
    let suite = ConformanceSuite { session, script, tolerance: args.tolerance, stop, console };
    let command = if args.command.is_empty() { String::new() } else { format!(" ({})", args.command) };
    let mut text = format!("{}{command} in stage `{}`", args.role.name(), suite.session.stage);
    let mut passed = true;
    let (mut unusable, mut unrepeatable) = (None, None);
    let wanted = |name: &str| args.only.is_empty() || args.only.iter().any(|n| n == name);
    for (name, test) in TESTS.into_iter().filter(|(name, _)| wanted(name) || BASIC.contains(name)) {
        let verdict = match (unusable, unrepeatable) {
            // Further tests would repeat this failure, or wait for the deadline again.
            (Some(at), _) => Verdict::Skipped(format!("requires a valid reply; `{at}` failed")),
            (_, Some(at)) if DIFFERENCES.contains(&name) => {
                Verdict::Skipped(format!("compares replies in one window; `{at}` failed"))
            }
            _ => match test(&suite) {
                Err(error @ RunError::Interrupted(_)) => return Err(error),
                Err(error) => {
                    if matches!(error, RunError::Stalled { .. }) {
                        unusable = Some(name);
                    }
                    Verdict::Failed(error.to_string())
                }
                Ok(verdict) => verdict,
            },
        };
        if matches!(verdict, Verdict::Failed(_)) {
            unusable = unusable.or(BASIC.contains(&name).then_some(name));
            unrepeatable = unrepeatable.or(REPEATABLE.contains(&name).then_some(name));
        }
        let (mark, why) = match &verdict {
            Verdict::Passed(why) => ("passed ", why),
            Verdict::Failed(why) => ("FAILED ", why),
            Verdict::Skipped(why) => ("skipped", why),
        };
        passed &= !matches!(verdict, Verdict::Failed(_));
        text.push_str(&format!("\n  {mark}  {name:<15} {why}"));
    }
    Ok((passed, text))
}

type Test = fn(&ConformanceSuite<'_>) -> Result<Verdict, RunError>;

/// Tests that all others require.
const BASIC: [&str; 2] = ["handshake", "finite reply"];
/// Tests that those by differences of replies require.
const REPEATABLE: [&str; 2] = ["repeatability", "rollback"];
/// Tests by differences of replies in one window.
const DIFFERENCES: [&str; 3] = ["own input", "response", "faces"];

const TESTS: [(&str, Test); 16] = [
    ("handshake", |s| s.handshake()),
    ("finite reply", |s| s.finite_reply()),
    ("repeatability", |s| s.repeatability()),
    ("rollback", |s| s.rollback()),
    ("next window", |s| s.next_window()),
    ("shorter window", |s| s.shorter_window()),
    ("substeps", |s| s.substeps()),
    ("stage restart", |s| s.stage_restart()),
    ("resume", |s| s.resume()),
    ("zero input", |s| s.zero_input()),
    ("extreme input", |s| s.extreme_input()),
    ("own input", |s| s.own_input()),
    ("recorded reply", |s| s.recorded_reply()),
    ("response", |s| s.response()),
    ("faces", |s| s.faces()),
    ("statistics", |s| s.statistics()),
];

struct ConformanceSuite<'a> {
    session: ProgramSession,
    script: Script,
    tolerance: f64,
    stop: &'a AtomicBool,
    console: &'a Console,
}

impl ConformanceSuite<'_> {
    fn run<T>(&self, play: impl FnOnce(&mut HubPartners<'_>) -> Result<T, RunError>) -> Result<T, RunError> {
        self.session.run(self.stop, self.console, play)
    }

    fn send(&self, p: &mut HubPartners<'_>, r: &Request, w: &Window) -> Result<Vec<f64>, RunError> {
        r.send(p, w, self.script.size)
    }

    /// Compares two replies to the same request.
    fn compare(&self, a: &[f64], b: &[f64], what: &str) -> Verdict {
        let d = relative_difference(a, b);
        let text = format!("{what}: relative difference {d:.1e} (tolerance {:.0e})", self.tolerance);
        if d <= self.tolerance { Verdict::Passed(text) } else { Verdict::Failed(text) }
    }

    fn handshake(&self) -> Result<Verdict, RunError> {
        self.run(|_| Ok(()))?;
        Ok(Verdict::Passed("joins, matches the canopy, supports the scene's effects, ends on request".into()))
    }

    fn finite_reply(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let reply = self.run(|p| self.send(p, first, w))?;
        Ok(match finite(&reply) {
            Ok(()) => Verdict::Passed(format!("{} finite values for window {}", reply.len(), w.index)),
            Err(why) => Verdict::Failed(why),
        })
    }

    fn repeatability(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let [a, b] =
            self.run(|p| Ok([self.send(p, first, w)?, self.send(p, first, &at_iteration(w, 1))?]))?;
        Ok(self.compare(&a, &b, "the same request twice"))
    }

    fn rollback(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, last, .. } = &self.script.windows[0];
        let other = first.scaled(1.5).unwrap_or_else(|| last.clone());
        // On a grid at rest the flow has no other input.
        if matches!(other, Request::Flow(None)) {
            return Ok(Verdict::Skipped("on a grid at rest all requests of a window are identical".into()));
        }
        let [a, b] = self.run(|p| {
            let a = self.send(p, first, w)?;
            for i in 1..4 {
                self.send(p, &other, &at_iteration(w, i))?;
            }
            Ok([a, self.send(p, first, &at_iteration(w, 4))?])
        })?;
        Ok(self.compare(&a, &b, "a request after three others in the window"))
    }

    fn next_window(&self) -> Result<Verdict, RunError> {
        let [Recorded { window: w0, last: last0, .. }, Recorded { window: w1, first: first1, .. }] =
            &self.script.windows[..]
        else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let [a, b] = self.run(|p| {
            let a = self.send(p, last0, w0)?;
            p.accept(w0)?;
            let b = self.send(p, first1, w1)?;
            p.accept(w1)?;
            Ok([a, b])
        })?;
        Ok(match finite(&b) {
            Err(why) => Verdict::Failed(why),
            Ok(()) if a == b && self.session.role != Role::Flow => Verdict::Failed(
                "the reply for the second window is bitwise identical to that for the first: stale data"
                    .into(),
            ),
            Ok(()) => Verdict::Passed("accepts a window and computes the next".into()),
        })
    }

    /// A rejected window that is retried with half its length gives the result of a first request with that length.
    fn shorter_window(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let half = Window { dt: 0.5 * w.dt, ..*w };
        let role = self.session.role;
        let varies = self.run(|p| Ok(p.varies_windows(role)))?;
        if !varies {
            return Ok(Verdict::Skipped(
                "the program does not announce `coupling.adaptive`: its windows have a fixed length".into(),
            ));
        }
        let a = self.run(|p| self.send(p, first, &half))?;
        let b = self.run(|p| {
            self.send(p, first, w)?;
            self.send(p, first, &at_iteration(&half, 1))
        })?;
        Ok(self.compare(&a, &b, "half a window, as the first request and after a full one"))
    }

    fn substeps(&self) -> Result<Verdict, RunError> {
        if self.session.role != Role::Structure {
            return Ok(Verdict::Skipped("applies to the structure only".into()));
        }
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let n = w.substeps.max(1);
        let replies = self.run(|p| {
            [n, 2 * n, 4 * n]
                .into_iter()
                .enumerate()
                .map(|(i, substeps)| self.send(p, first, &Window { substeps, ..at_iteration(w, i as u64) }))
                .collect::<Result<Vec<_>, _>>()
        })?;
        let [coarse, fine] =
            [relative_difference(&replies[2], &replies[0]), relative_difference(&replies[2], &replies[1])];
        let text = format!(
            "{n} and {} substeps: relative difference {coarse:.1e} and {fine:.1e} from {} substeps",
            2 * n,
            4 * n
        );
        // Refinement must not diverge. Where substeps do not resolve the shortest waves (a canopy that is released), the
        // difference need not decrease, but it must not grow.
        Ok(if fine <= (2.0 * coarse).max(self.tolerance) {
            Verdict::Passed(text)
        } else {
            Verdict::Failed(text)
        })
    }

    fn stage_restart(&self) -> Result<Verdict, RunError> {
        let scene = &self.session.prepared.scene;
        let role = self.session.role;
        let Some(source) = scene.source_state(&self.session.out, self.session.number(), role) else {
            return Ok(Verdict::Skipped("no earlier stage saves a state for this program".into()));
        };
        let stages = &scene.stages;
        let before = scene.source_stage(self.session.number(), Role::Flow);
        let method = |stage: usize| scene.discretisation(&stages[stage]);
        if role == Role::Flow && before.is_some_and(|b| method(b) != method(self.session.number())) {
            return Ok(Verdict::Skipped("the stage starts from a flow of the other method".into()));
        }
        let [Recorded { window: w0, last: last0, .. }, Recorded { window: w1, first: first1, .. }] =
            &self.script.windows[..]
        else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let folder = self.session.out.join("saved");
        std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        let a = self.run(|p| {
            self.send(p, last0, w0)?;
            p.accept(w0)?;
            p.save(&folder)?;
            self.send(p, first1, w1)
        })?;
        let saved = case::state_file(&folder, role);
        if !saved.is_file() {
            return Ok(Verdict::Failed(format!("the program did not write {}", saved.display())));
        }
        let before = source.with_extension("before");
        let swap = |from: &std::path::Path, to: &std::path::Path| {
            std::fs::rename(from, to).map_err(RunError::file("rename", from))
        };
        if source.is_file() {
            swap(&source, &before)?;
        }
        swap(&saved, &source)?;
        let b = self.run(|p| self.send(p, first1, w1));
        if before.is_file() {
            swap(&before, &source)?;
        }
        Ok(self.compare(&a, &b?, "a window from a saved state"))
    }

    fn resume(&self) -> Result<Verdict, RunError> {
        let role = self.session.role;
        let [Recorded { window: w0, last: last0, .. }, Recorded { window: w1, first: first1, .. }] =
            &self.script.windows[..]
        else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let folder = self.session.out.join("within");
        std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        let (can, a) = self.run(|p| {
            self.send(p, last0, w0)?;
            p.accept(w0)?;
            p.save(&folder)?;
            Ok((p.resumes(role), self.send(p, first1, w1)?))
        })?;
        if !can {
            return Ok(Verdict::Skipped(
                "the program does not announce `resume`: a run cannot be resumed within a stage".into(),
            ));
        }
        let b =
            self.session.run_from(Some(&folder), self.stop, self.console, |p| self.send(p, first1, w1))?;
        Ok(match self.compare(&a, &b, "a window after --resume") {
            Verdict::Passed(_) if a == b => {
                Verdict::Passed("a window after --resume: bitwise identical".into())
            }
            other => other,
        })
    }

    fn zero_input(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let Some(zero) = first.scaled(0.0) else {
            return Ok(Verdict::Skipped("the only input of the flow is the grid".into()));
        };
        let reply = self.run(|p| self.send(p, &zero, w))?;
        Ok(match finite(&reply) {
            Ok(()) => Verdict::Passed("finite values".into()),
            Err(why) => Verdict::Failed(why),
        })
    }

    fn extreme_input(&self) -> Result<Verdict, RunError> {
        let Recorded { window: w, first, .. } = &self.script.windows[0];
        let Some(extreme) = first.scaled(1e9) else {
            return Ok(Verdict::Skipped("the only input of the flow is the grid".into()));
        };
        match self.run(|p| self.send(p, &extreme, w)) {
            Ok(reply) => Ok(match finite(&reply) {
                Ok(()) => Verdict::Passed("a finite reply to 1e9 times the input".into()),
                Err(why) => Verdict::Failed(why),
            }),
            // A reported failure is a valid response to such input.
            Err(
                RunError::Fault { message, .. }
                | RunError::GridMotionFailed { message, .. }
                | RunError::SolveFailed { message, .. },
            ) => {
                let short: String = message.chars().take(90).collect();
                Ok(Verdict::Passed(format!("a reported error: {short}")))
            }
            Err(other) => Err(other),
        }
    }
}
