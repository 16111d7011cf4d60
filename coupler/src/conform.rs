//! `ripstop conform`: does a program keep the contract?
//!
//! The program is driven alone, by questions from a recording and by some that no run
//! asks. Each point of the battery is a session of its own where the one before may
//! have left the program in a bad state.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;
use channel::{LOAD_WIDTH, Window};
use coupling::error::RunError;
use coupling::partners::{LoadOverWindow, Partners};
use results::recording::{Event, Reader};
use terminal::Console;

use crate::hub::HubPartners;
use crate::replay::{ProgramSession, Trial, halves};

/// Which program, and how closely it must repeat itself.
#[derive(clap::Args)]
pub struct ConformArgs {
    /// Role that the program plays: structure, flow or mesh
    #[arg(value_parser = crate::arguments::role)]
    role: Role,
    /// Folder that `ripstop run --record` wrote: the scene, and questions to ask
    recording: PathBuf,
    /// The program [default: the project's own]
    #[arg(long, value_name = "COMMAND", default_value = "")]
    command: String,
    /// Ranks of the program [default: as recorded]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    ranks: Option<u32>,
    /// Stage [default: the last one in which the program took part]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// How far two answers to one question may lie apart, as a share of the largest number: the
    /// program's own tolerance, where it starts from its last answer
    #[arg(long, value_name = "SHARE", default_value_t = 1e-3, value_parser = crate::arguments::share)]
    tolerance: f64,
    /// Longest time for one answer, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = crate::arguments::seconds)]
    deadline: f64,
}

/// What became of a point of the battery.
#[derive(Clone, Debug, PartialEq)]
enum Verdict {
    Passed(String),
    Failed(String),
    Skipped(String),
}

/// A question to a program.
#[derive(Clone)]
enum Question {
    /// Load at the start and at the end, each `[faces][LOAD_WIDTH]`.
    Structure([Vec<f64>; 2]),
    /// Displacement.
    Mesh(Vec<f64>),
    /// Displacement that the stand-in for the mesh is given, where the grid moves.
    Flow(Option<Vec<f64>>),
}

impl Question {
    fn ask(&self, partners: &mut HubPartners<'_>, w: &Window, size: usize) -> Result<Vec<f64>, RunError> {
        let mut answer = vec![0.0; size];
        match self {
            Self::Structure([start, end]) => {
                partners.structure(w, LoadOverWindow { start, end }, &mut answer)?;
            }
            Self::Mesh(displacement) => {
                partners.mesh(w, displacement)?;
                answer = partners.grid().unwrap_or(&[]).to_vec();
            }
            Self::Flow(displacement) => {
                if let Some(displacement) = displacement {
                    partners.mesh(w, displacement)?;
                }
                partners.flow(w, &mut answer)?;
            }
        }
        Ok(answer)
    }

    /// The same with all numbers of the input times `factor`; the flow has none of its own.
    fn scaled(&self, factor: f64) -> Option<Self> {
        let times = |v: &Vec<f64>| v.iter().map(|x| factor * x).collect::<Vec<f64>>();
        match self {
            Self::Structure(load) => Some(Self::Structure([times(&load[0]), times(&load[1])])),
            Self::Mesh(displacement) => Some(Self::Mesh(times(displacement))),
            Self::Flow(_) => None,
        }
    }
}

/// Two windows of a recording: what was asked first and last in each.
struct Script {
    windows: Vec<(Window, Question, Question)>,
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
        let mut asked: Vec<(Window, Question)> = Vec::new();
        let mut moved = None;
        while let Some(event) = reader.next_event()? {
            let w = Window::from(event.at());
            match (event, session.role) {
                (Event::Structure { load, .. }, Role::Structure) => {
                    asked.push((w, Question::Structure(halves(&load))));
                }
                (Event::Mesh { displacement, .. }, Role::Mesh) => {
                    asked.push((w, Question::Mesh(displacement)))
                }
                (Event::Mesh { displacement, .. }, Role::Flow) => moved = Some(displacement),
                (Event::Flow { .. }, Role::Flow) => asked.push((w, Question::Flow(moved.clone()))),
                (Event::Accept { .. }, _) if !asked.is_empty() => {
                    let (first, last) = (asked[0].clone(), asked[asked.len() - 1].clone());
                    windows.push((Window { iteration: 0, ..first.0 }, first.1, last.1));
                    asked.clear();
                    if windows.len() == 2 {
                        return Ok(Self { windows, size });
                    }
                }
                _ => {}
            }
        }
        Err(RunError::Input(format!(
            "{} has {} whole windows with the {}; two are needed",
            session.file.display(),
            windows.len(),
            session.role.name()
        )))
    }
}

/// A later question of a window.
fn again(w: &Window, iteration: u64) -> Window {
    Window { iteration, ..*w }
}

/// Largest difference of two answers over the largest number of the first, or of the second where the first is 0
/// throughout.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let difference = a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs()));
    let scale = if largest(a) > 0.0 { largest(a) } else { largest(b) };
    if difference == 0.0 { 0.0 } else { difference / scale }
}

fn finite(answer: &[f64]) -> Result<(), String> {
    match answer.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(format!("number {i} of the answer is {}", answer[i])),
    }
}

/// Drives the program through the battery; whether it passed all, and the table.
///
/// # Errors
/// A recording that does not serve, an interrupt. What the program does is a verdict.
pub fn conform(args: &ConformArgs, stop: &AtomicBool, console: &Console) -> Result<(bool, String), RunError> {
    let trial = Trial {
        role: args.role,
        command: &args.command,
        ranks: args.ranks,
        stage: args.stage.as_deref(),
        out: None,
        deadline: Duration::from_secs_f64(args.deadline),
    };
    let session = ProgramSession::new(&args.recording, &trial)?;
    let script = Script::of(&session)?;
    let battery = Battery { session, script, tolerance: args.tolerance, stop, console };
    let mut text = format!("{} in stage `{}`", args.role.name(), battery.session.stage);
    let mut passed = true;
    let mut silent = None;
    for (name, point) in POINTS {
        let verdict = match silent {
            // Further points would say the same again, or cost the deadline again.
            Some(at) => Verdict::Skipped(format!("no valid reply to start from after `{at}`")),
            None => match point(&battery) {
                Err(error @ RunError::Interrupted(_)) => return Err(error),
                Err(error) => {
                    if matches!(error, RunError::Stalled { .. }) {
                        silent = Some(name);
                    }
                    Verdict::Failed(error.to_string())
                }
                Ok(verdict) => verdict,
            },
        };
        if BASIC.contains(&name) && matches!(verdict, Verdict::Failed(_)) {
            silent = Some(name);
        }
        let (mark, why) = match &verdict {
            Verdict::Passed(why) => ("passed ", why),
            Verdict::Failed(why) => ("FAILED ", why),
            Verdict::Skipped(why) => ("skipped", why),
        };
        passed &= !matches!(verdict, Verdict::Failed(_));
        text.push_str(&format!("\n  {mark}  {name:<16} {why}"));
    }
    Ok((passed, text))
}

type Point = fn(&Battery<'_>) -> Result<Verdict, RunError>;

/// Points without which the others mean nothing.
const BASIC: [&str; 2] = ["handshake", "answers"];

const POINTS: [(&str, Point); 11] = [
    ("handshake", |b| b.handshake()),
    ("answers", |b| b.answers()),
    ("repeats", |b| b.repeats()),
    ("rolls back", |b| b.rolls_back()),
    ("restart within a stage", |b| b.continues()),
    ("shorter window", |b| b.shorter()),
    ("substeps", |b| b.substeps()),
    ("restores", |b| b.restores()),
    ("resumes", |b| b.resumes()),
    ("zero input", |b| b.zero()),
    ("absurd input", |b| b.absurd()),
];

struct Battery<'a> {
    session: ProgramSession,
    script: Script,
    tolerance: f64,
    stop: &'a AtomicBool,
    console: &'a Console,
}

impl Battery<'_> {
    fn run<T>(&self, play: impl FnOnce(&mut HubPartners<'_>) -> Result<T, RunError>) -> Result<T, RunError> {
        self.session.run(self.stop, self.console, play)
    }

    fn ask(&self, p: &mut HubPartners<'_>, q: &Question, w: &Window) -> Result<Vec<f64>, RunError> {
        q.ask(p, w, self.script.size)
    }

    /// `a` and `b` answer one question.
    fn close(&self, a: &[f64], b: &[f64], what: &str) -> Verdict {
        let d = apart(a, b);
        let text = format!("{what}: {d:.1e} apart (tolerance {:.0e})", self.tolerance);
        if d <= self.tolerance { Verdict::Passed(text) } else { Verdict::Failed(text) }
    }

    fn handshake(&self) -> Result<Verdict, RunError> {
        self.run(|_| Ok(()))?;
        Ok(Verdict::Passed("joins, fits the canopy, has the scene's effects, ends on request".into()))
    }

    fn answers(&self) -> Result<Verdict, RunError> {
        let (w, first, _) = &self.script.windows[0];
        let answer = self.run(|p| self.ask(p, first, w))?;
        Ok(match finite(&answer) {
            Ok(()) => Verdict::Passed(format!("{} finite numbers for window {}", answer.len(), w.index)),
            Err(why) => Verdict::Failed(why),
        })
    }

    fn repeats(&self) -> Result<Verdict, RunError> {
        let (w, first, _) = &self.script.windows[0];
        let [a, b] = self.run(|p| Ok([self.ask(p, first, w)?, self.ask(p, first, &again(w, 1))?]))?;
        Ok(self.close(&a, &b, "the same question twice"))
    }

    fn rolls_back(&self) -> Result<Verdict, RunError> {
        let (w, first, last) = &self.script.windows[0];
        let other = first.scaled(1.5).unwrap_or_else(|| last.clone());
        // The flow's answer to its own question is all that a grid at rest lets one ask.
        if matches!(other, Question::Flow(None)) {
            return Ok(Verdict::Skipped("on a grid at rest all questions of a window are one".into()));
        }
        let [a, b] = self.run(|p| {
            let a = self.ask(p, first, w)?;
            for i in 1..4 {
                self.ask(p, &other, &again(w, i))?;
            }
            Ok([a, self.ask(p, first, &again(w, 4))?])
        })?;
        Ok(self.close(&a, &b, "a question after three others"))
    }

    fn continues(&self) -> Result<Verdict, RunError> {
        let [(w0, _, last0), (w1, first1, _)] = &self.script.windows[..] else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let [a, b] = self.run(|p| {
            let a = self.ask(p, last0, w0)?;
            p.accept(w0)?;
            let b = self.ask(p, first1, w1)?;
            p.accept(w1)?;
            Ok([a, b])
        })?;
        Ok(match finite(&b) {
            Err(why) => Verdict::Failed(why),
            Ok(()) if a == b && self.session.role != Role::Flow => {
                Verdict::Failed("the second window's answer is the first one's to the bit: stale".into())
            }
            Ok(()) => Verdict::Passed("accepts a window and computes the next".into()),
        })
    }

    /// A rejected window that is retried with half its length gives the results of a program that was asked so
    /// at once.
    fn shorter(&self) -> Result<Verdict, RunError> {
        let (w, first, _) = &self.script.windows[0];
        let half = Window { dt: 0.5 * w.dt, ..*w };
        let varies = self.run(|p| Ok(p.fixed_windows().is_empty()))?;
        if !varies {
            return Ok(Verdict::Skipped(
                "it does not announce `coupling.adaptive`: windows are of one length".into(),
            ));
        }
        let a = self.run(|p| self.ask(p, first, &half))?;
        let b = self.run(|p| {
            self.ask(p, first, w)?;
            self.ask(p, first, &again(&half, 1))
        })?;
        Ok(self.close(&a, &b, "half a window, at once and after a whole one"))
    }

    fn substeps(&self) -> Result<Verdict, RunError> {
        if self.session.role != Role::Structure {
            return Ok(Verdict::Skipped("of the structure only".into()));
        }
        let (w, first, _) = &self.script.windows[0];
        let n = w.substeps.max(1);
        let answers = self.run(|p| {
            [n, 2 * n, 4 * n]
                .into_iter()
                .enumerate()
                .map(|(i, substeps)| self.ask(p, first, &Window { substeps, ..again(w, i as u64) }))
                .collect::<Result<Vec<_>, _>>()
        })?;
        let [coarse, fine] = [apart(&answers[2], &answers[0]), apart(&answers[2], &answers[1])];
        let text = format!("{n} and {} substeps: {coarse:.1e} and {fine:.1e} from {}", 2 * n, 4 * n);
        // More substeps must not lead away. Where they do not resolve the shortest waves yet (a canopy that is let go), the
        // differences need not fall, but nor do they grow.
        Ok(if fine <= (2.0 * coarse).max(self.tolerance) {
            Verdict::Passed(text)
        } else {
            Verdict::Failed(text)
        })
    }

    fn restores(&self) -> Result<Verdict, RunError> {
        let scene = &self.session.prepared.scene;
        let role = self.session.role;
        let Some(source) = scene.source_state(&self.session.out, self.session.number(), role) else {
            return Ok(Verdict::Skipped("no stage before this one leaves it a state".into()));
        };
        let [(w0, _, last0), (w1, first1, _)] = &self.script.windows[..] else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let folder = self.session.out.join("saved");
        std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        let a = self.run(|p| {
            self.ask(p, last0, w0)?;
            p.accept(w0)?;
            p.save(&folder)?;
            self.ask(p, first1, w1)
        })?;
        let saved = case::state_file(&folder, role);
        if !saved.is_file() {
            return Ok(Verdict::Failed(format!("it wrote no {}", saved.display())));
        }
        let before = source.with_extension("before");
        let swap = |from: &std::path::Path, to: &std::path::Path| {
            std::fs::rename(from, to).map_err(RunError::file("rename", from))
        };
        if source.is_file() {
            swap(&source, &before)?;
        }
        swap(&saved, &source)?;
        let b = self.run(|p| self.ask(p, first1, w1));
        if before.is_file() {
            swap(&before, &source)?;
        }
        Ok(self.close(&a, &b?, "a window from a saved state"))
    }

    fn resumes(&self) -> Result<Verdict, RunError> {
        let role = self.session.role;
        let [(w0, _, last0), (w1, first1, _)] = &self.script.windows[..] else {
            return Ok(Verdict::Skipped("one window only".into()));
        };
        let folder = self.session.out.join("within");
        std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        let (can, a) = self.run(|p| {
            self.ask(p, last0, w0)?;
            p.accept(w0)?;
            p.save(&folder)?;
            Ok((p.resumes(role), self.ask(p, first1, w1)?))
        })?;
        if !can {
            return Ok(Verdict::Skipped("it does not announce `resume`: its runs cannot be resumed".into()));
        }
        let b = self.session.run_from(Some(&folder), self.stop, self.console, |p| self.ask(p, first1, w1))?;
        Ok(match self.close(&a, &b, "a window after --resume") {
            Verdict::Passed(_) if a == b => {
                Verdict::Passed("a window after --resume: the same digits".into())
            }
            other => other,
        })
    }

    fn zero(&self) -> Result<Verdict, RunError> {
        let (w, first, _) = &self.script.windows[0];
        let Some(zero) = first.scaled(0.0) else {
            return Ok(Verdict::Skipped("the flow has no input but the grid".into()));
        };
        let answer = self.run(|p| self.ask(p, &zero, w))?;
        Ok(match finite(&answer) {
            Ok(()) => Verdict::Passed("finite numbers".into()),
            Err(why) => Verdict::Failed(why),
        })
    }

    fn absurd(&self) -> Result<Verdict, RunError> {
        let (w, first, _) = &self.script.windows[0];
        let Some(absurd) = first.scaled(1e9) else {
            return Ok(Verdict::Skipped("the flow has no input but the grid".into()));
        };
        match self.run(|p| self.ask(p, &absurd, w)) {
            Ok(answer) => Ok(match finite(&answer) {
                Ok(()) => Verdict::Passed("a finite answer to a billion times the input".into()),
                Err(why) => Verdict::Failed(why),
            }),
            // A mesh that cannot follow says so in its answer.
            Err(
                RunError::Fault { message, .. }
                | RunError::GridMotionFailed { message, .. }
                | RunError::SolveFailed { message, .. },
            ) => {
                let short: String = message.chars().take(90).collect();
                Ok(Verdict::Passed(format!("an error in words: {short}")))
            }
            Err(other) => Err(other),
        }
    }
}
