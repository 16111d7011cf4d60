//! A solver program with a fault at a defined moment, for the fault matrix.
//!
//! `faulty ROLE FAULT MOMENT RANK <arguments of the coupler>` is the real solver of the
//! role under MPI, whose participant is wrapped: the rank triggers the fault at the moment. With the moment `always` each answer
//! of each rank is wrong: what `ripstop conform` must name.

use std::path::Path;
use std::time::Duration;

use case::Role;
use channel::{Announcement, Fault, Input, Participant, ProgramArgs, Stats, Window};
use comm::Comm;
use flow_solver::setup::Setup;
use mesh_mover::participant::MeshMover;
use ripstop_tests::Signal;
use structure_solver::participant::StructureSolver;

/// Window (from 0) of the fault; earlier windows are accepted.
const WINDOW: u64 = 2;

#[derive(Clone)]
struct Plan {
    fault: String,
    moment: String,
    rank: usize,
}

/// Whether this rank still has to trigger the fault.
struct Harm {
    plan: Plan,
    armed: bool,
}

impl Harm {
    /// Triggers the fault if this is its moment. Returns whether the caller has to corrupt the response.
    fn at(&mut self, moment: &str) -> Result<bool, Fault> {
        if !self.armed || self.plan.moment != moment {
            return Ok(false);
        }
        self.armed = false;
        // The harness measures the time from here.
        eprintln!("faulty: {} now {}", self.plan.fault, std::process::id());
        if let Ok(note) = std::env::var("FAULTY_NOTE") {
            std::fs::write(note, std::process::id().to_string()).expect("a note can be written");
        }
        let signal = |signal| ripstop_tests::signal(std::process::id(), signal);
        match self.plan.fault.as_str() {
            "kill" => signal(Signal::KILL),
            "stop" => signal(Signal::STOP),
            "term" => signal(Signal::TERM),
            "exit0" => std::process::exit(0),
            "exit1" => std::process::exit(1),
            "panic" => panic!("harm was asked for"),
            "stall" => std::thread::sleep(Duration::from_secs(3600)),
            "late" => std::thread::sleep(Duration::from_secs(1)),
            "nan" => return Ok(true),
            "twice" => twice(),
            other => return Err(Fault::new(format!("there is no fault `{other}`"))),
        }
        // A signal to oneself may take a moment.
        if matches!(self.plan.fault.as_str(), "kill" | "term") {
            std::thread::sleep(Duration::from_secs(3600));
        }
        Ok(false)
    }
}

/// Starts a duplicate of this rank outside MPI and records its exit status.
fn twice() {
    let me = std::env::current_exe().expect("a path");
    let mut words: Vec<_> = std::env::args_os().skip(1).collect();
    words[1] = "second".into();
    let mut second = std::process::Command::new(me);
    second.args(words);
    for (name, _) in std::env::vars() {
        if name.starts_with("OMPI_") || name.starts_with("PMIX_") || name.starts_with("ORTE_") {
            second.env_remove(name);
        }
    }
    let output = second.output().expect("a second one starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && text.contains("started twice"), "the second one: {text}");
    eprintln!("faulty: the second one was refused");
}

struct Saboteur<'a> {
    inner: &'a mut dyn Participant,
    harm: std::cell::RefCell<Harm>,
}

impl Saboteur<'_> {
    fn harm(&self, moment: &str) -> Result<bool, Fault> {
        self.harm.borrow_mut().at(moment)
    }
}

impl Participant for Saboteur<'_> {
    fn announce(&self) -> Announcement {
        self.inner.announce()
    }

    fn output_rows(&self) -> Vec<u64> {
        // Between joining the session and the announcement. (A panic is the only error here.)
        let _ = self.harm("handshake");
        self.inner.output_rows()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.inner.grid_rows()
    }

    fn waited_s(&self) -> f64 {
        self.inner.waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let due = w.index == WINDOW;
        let mut spoil = due && self.harm("window")?;
        let mut stats = self.inner.advance(w, input, output)?;
        spoil |= due && w.iteration > 0 && self.harm("iteration")?;
        if spoil {
            // A rank of the flow may have no canopy face.
            let middle = output.len() / 2;
            *output.get_mut(middle).unwrap_or(&mut stats.values[0]) = f64::NAN;
        }
        Ok(stats)
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        self.inner.accept(w)
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        if self.harm("save")? {
            return Err(Fault::new("a number to be saved is NaN"));
        }
        self.inner.save(folder)
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        self.inner.snapshot(time, folder)
    }
}

/// A participant whose answers are all wrong in the same way.
struct Wrong<'a> {
    inner: &'a mut dyn Participant,
    fault: String,
    root: bool,
    /// The accepted answer of the window before, and the present one.
    before: Option<Vec<f64>>,
    now: Vec<f64>,
}

impl Wrong<'_> {
    /// Columns of the pressure in the input of a structure: at the start and at the end of the window.
    const PRESSURES: [usize; 2] = [0, 4];

    /// The input as the fault has it.
    fn input(&self, canopy: &[f64]) -> Vec<f64> {
        let mut load = canopy.to_vec();
        let structure = self.inner.announce().role == "structure";
        let faces = load.len() / 8;
        let wrong = |face: usize| match self.fault.as_str() {
            "reversed" => true,
            "normal" => face == faces / 2,
            _ => false,
        };
        if structure {
            for (_, row) in load.chunks_exact_mut(8).enumerate().filter(|(face, _)| wrong(*face)) {
                Self::PRESSURES.iter().for_each(|k| row[*k] = -row[*k]);
            }
        }
        load
    }

    /// Spoils an answer.
    fn spoil(&mut self, output: &mut [f64]) {
        let announced = self.inner.announce();
        let width = announced.output_width as usize;
        let flow = announced.role == "flow";
        self.now = output.to_vec();
        match self.fault.as_str() {
            "late" => output.copy_from_slice(self.before.get_or_insert_with(|| self.now.clone())),
            "thousand" if flow => output.iter_mut().for_each(|p| *p *= 1e-3),
            "thousand" => {
                output.chunks_exact_mut(width).flat_map(|row| &mut row[..3]).for_each(|x| *x *= 1e3)
            }
            "still" => output.chunks_exact_mut(width).flat_map(|row| &mut row[3..]).for_each(|v| *v = 0.0),
            "reversed" if flow => output.iter_mut().for_each(|p| *p = -*p),
            "normal" if flow && self.root => {
                let row = output.len() / width / 2 * width;
                output[row] = -output[row];
            }
            _ => {}
        }
    }
}

impl Participant for Wrong<'_> {
    fn announce(&self) -> Announcement {
        self.inner.announce()
    }

    fn output_rows(&self) -> Vec<u64> {
        self.inner.output_rows()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.inner.grid_rows()
    }

    fn waited_s(&self) -> f64 {
        self.inner.waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let canopy = self.input(input.canopy);
        let stats = self.inner.advance(w, &Input { canopy: &canopy, grid: input.grid }, output)?;
        self.spoil(output);
        Ok(stats)
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        self.before = Some(self.now.clone());
        self.inner.accept(w)
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        self.inner.save(folder)
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        self.inner.snapshot(time, folder)
    }
}

fn main() {
    let mut words: Vec<_> = std::env::args_os().collect();
    let own: Vec<String> = words.drain(1..5).map(|w| w.to_string_lossy().into_owned()).collect();
    let role = Role::ALL.into_iter().find(|r| r.name() == own[0]).expect("a role");
    let rank = own[3].parse().expect("a rank");
    let plan = Plan { fault: own[1].clone(), moment: own[2].clone(), rank };
    let args = match ProgramArgs::from_words(words) {
        Ok(args) => args,
        Err(message) => {
            eprintln!("{message}");
            std::process::exit(2);
        }
    };
    args.watch_coupler();
    if plan.fault == "second" {
        // Duplicate of the rank that is already in the session.
        let at = args.serve_options(role, plan.rank);
        let end = channel::serve(&mut Empty, &at);
        eprintln!("{}", end.expect_err("a second one is refused"));
        std::process::exit(1);
    }
    if let Err(message) = work(role, &plan, &args) {
        eprintln!("faulty {}: {message}", role.name());
        std::process::exit(1);
    }
}

/// Runs the solver of `role` with its fault.
fn work(role: Role, plan: &Plan, args: &ProgramArgs) -> Result<(), String> {
    let mine = std::env::var("OMPI_COMM_WORLD_RANK").is_ok_and(|r| r == plan.rank.to_string());
    let mine = mine && std::env::var_os("FAULTY_OFF").is_none();
    let mut harm = Harm { plan: plan.clone(), armed: mine };
    harm.at("start").map_err(|e| e.message)?;
    let comm = Comm::init(Some(args.ranks as usize)).map_err(|e| e.to_string())?;
    let at = args.serve_options(role, comm.rank());
    let scene = case::load(&args.scene).map_err(|e| e.to_string())?;
    let (gather, send, poll) =
        (|x| comm.all_gather_u64(x), |to, x: &[f64]| comm.send(to, x), |from| comm.poll(from));
    let peers = channel::Peers { gather: &gather, send: &send, poll: &poll };
    let served = |inner: &mut dyn Participant| {
        let (fault, root) = (plan.fault.clone(), comm.is_root());
        let mut wrong = Wrong { inner, fault, root, before: None, now: Vec::new() };
        let inner = if plan.moment == "always" { &mut wrong as &mut dyn Participant } else { wrong.inner };
        let mut saboteur = Saboteur { inner, harm: harm.into() };
        let end = channel::serve_across(&mut saboteur, &at, &peers).map_err(|e| e.to_string());
        end.map(|_| saboteur.harm.into_inner())
    };
    let end = match role {
        Role::Structure => match &args.resume {
            None => StructureSolver::new(&comm, &scene, args.stage, &args.out),
            Some(state) => StructureSolver::resumed(&comm, &scene, args.stage, &args.out, state),
        }
        .map_err(|e| e.message)
        .and_then(|mut p| served(&mut p)),
        Role::Mesh => match &args.resume {
            None => MeshMover::new(&scene, args.stage, &args.out, &comm),
            Some(state) => MeshMover::resumed(&scene, args.stage, &args.out, state, &comm),
        }
        .map_err(|e| e.message)
        .and_then(|mut p| served(&mut p)),
        Role::Flow => Setup::new(scene, args.stage, &args.out)
            .map(|setup| match &args.resume {
                None => setup,
                Some(state) => setup.resume(state),
            })
            .and_then(|setup| flow_solver::participant(&setup, &comm))
            .map_err(|e| e.message)
            .and_then(|mut p| served(p.as_mut())),
    };
    // Like the programs: MPI is finalised only after success.
    match end {
        Ok(mut harm) => harm.at("end").map(|_| ()).map_err(|e| e.message),
        Err(message) => {
            std::mem::forget(comm);
            Err(message)
        }
    }
}

/// A participant that receives no requests.
struct Empty;

impl Participant for Empty {
    fn announce(&self) -> Announcement {
        unreachable!("it is refused before")
    }

    fn output_rows(&self) -> Vec<u64> {
        Vec::new()
    }

    fn advance(&mut self, _: &Window, _: &Input<'_>, _: &mut [f64]) -> Result<Stats, Fault> {
        Err(Fault::new("not asked"))
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        Ok(())
    }

    fn save(&mut self, _: &Path) -> Result<(), Fault> {
        Ok(())
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}
