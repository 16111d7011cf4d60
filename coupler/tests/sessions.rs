//! Whole runs of the real `ripstop` with fake programs over the real channel.
//!
//! This file is also those programs: started with `--session` it serves as the
//! participant that `--fake ROLE` names, with simple arithmetic as physics.

#[path = "../../tests/src/harness.rs"]
mod harness;
#[path = "../../tests/src/load.rs"]
mod load;

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output, Stdio};
use std::time::Duration;

use case::Role;
use channel::{
    Announcement, Fault, Input, LOAD_WIDTH, Participant, ServeOptions, Stats, Window, flow_stats,
    structure_stats,
};
use load::{Available, Limit};

/// The failure of a fake program: `--trouble` on its command line.
#[derive(Clone, Copy, PartialEq)]
enum Trouble {
    None,
    Fault,
    Exit,
    Kill,
    Hang,
    Nan,
    /// No failure: its own surface mesh.
    Coarse,
}

/// Window of the failure.
const TROUBLE_WINDOW: u64 = 2;

/// Each node is a mass on a spring; the air is a pressure that falls with speed.
struct Fake {
    role: Role,
    trouble: Trouble,
    canopy: mesh::StructureMesh,
    accepted: Vec<f64>,
    trial: Vec<f64>,
    grid: Vec<f64>,
}

impl Participant for Fake {
    fn announce(&self) -> Announcement {
        Announcement {
            role: self.role.name().into(),
            program: "fake".into(),
            version: "0".into(),
            canopy_nodes: self.canopy.n_canopy as u64,
            canopy_faces: self.canopy.faces.len() as u64,
            surface_hash: channel::surface_hash(&self.canopy.faces),
            grid_nodes: if self.role == Role::Structure { 0 } else { self.canopy.n_canopy as u64 },
            output_width: [3, LOAD_WIDTH as u64, 6][self.role as usize],
            effects: {
                let own = (self.trouble == Trouble::Coarse).then_some(channel::OWN_SURFACE);
                ["fabric.wrinkling", "lines"].into_iter().chain(own).map(String::from).collect()
            },
        }
    }

    fn output_rows(&self) -> Vec<u64> {
        let rows = if self.role == Role::Flow { self.canopy.faces.len() } else { self.canopy.n_canopy };
        (0..rows as u64).collect()
    }

    fn grid_rows(&self) -> Vec<u64> {
        if self.role == Role::Flow { (0..self.canopy.n_canopy as u64).collect() } else { Vec::new() }
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let mut stats = Stats::default();
        if w.index == TROUBLE_WINDOW {
            match self.trouble {
                Trouble::None | Trouble::Coarse => {}
                Trouble::Fault => return Err(Fault::new("cell 17 is inverted: take a smaller window_s")),
                Trouble::Exit => {
                    eprintln!("fake: the licence has expired");
                    std::process::exit(3);
                }
                Trouble::Kill => {
                    let _ = Command::new("kill").args(["-9", &std::process::id().to_string()]).status();
                }
                Trouble::Hang => std::thread::sleep(Duration::from_secs(1000)),
                Trouble::Nan => output.fill(f64::NAN),
            }
            if self.trouble == Trouble::Nan {
                return Ok(stats);
            }
        }
        match self.role {
            Role::Structure => {
                // Overdamped: each node moves by 10 % of the distance to equilibrium under the mean load.
                let faces = self.canopy.faces.len() as f64;
                let load: f64 =
                    input.canopy.chunks_exact(8).map(|f| 0.5 * (f[0] + f[4])).sum::<f64>() / faces;
                for (at, out) in output.iter_mut().enumerate() {
                    let target = if at % 3 == 2 { 0.01 * load } else { 0.0 };
                    *out = self.accepted[at] + 0.1 * (target - self.accepted[at]);
                }
                stats.values[structure_stats::VERTICAL_LOAD] = load;
                stats.values[structure_stats::PROJECTED_AREA] = 4.0;
                stats.values[structure_stats::STRAIN_ENERGY] = 1.0;
                stats.values[structure_stats::KINETIC_ENERGY] = 1.0;
            }
            Role::Mesh => {
                for (row, moved) in output.chunks_exact_mut(6).zip(input.canopy.chunks_exact(3)) {
                    row[..3].copy_from_slice(moved);
                    row[3..].fill(0.0);
                }
            }
            Role::Flow => {
                let moved = if input.grid.is_empty() {
                    0.0
                } else {
                    (0..self.canopy.n_canopy).map(|i| input.grid.row(i)[2]).sum::<f64>()
                        / self.canopy.n_canopy as f64
                };
                // The pressure decreases with the motion of the canopy: strong added damping.
                let speed = -w.frame_velocity[2];
                let jump = 0.6125 * speed * speed - 200.0 * (moved - self.grid[0]);
                output.chunks_exact_mut(LOAD_WIDTH).for_each(|f| f.copy_from_slice(&[jump, 0.0, 0.0, 0.0]));
                stats.values[flow_stats::FORCE + 2] = 4.0 * jump;
                self.grid[1] = moved;
            }
        }
        if self.role != Role::Flow {
            self.trial.copy_from_slice(output);
        }
        Ok(stats)
    }

    fn accept(&mut self, _w: &Window) -> Result<(), Fault> {
        self.accepted.copy_from_slice(&self.trial);
        self.grid[0] = self.grid[1];
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let path = case::state_file(folder, self.role);
        std::fs::write(&path, format!("{:?}", self.accepted.first())).map_err(Fault::new)
    }

    fn snapshot(&mut self, _time: f64, folder: &Path) -> Result<(), Fault> {
        std::fs::write(folder.join(format!("{}.pvd", self.role.name())), "").map_err(Fault::new)
    }
}

/// Replaces the canopy mesh by 3 x 3 nodes across the square, and writes it for the coupler.
fn coarsen(canopy: &mut mesh::StructureMesh, folder: &Path) -> Result<(), String> {
    let nodes = &canopy.coords[..canopy.n_canopy];
    let most = |i: usize| nodes.iter().fold(0.0f64, |m, x| m.max(x[i].abs()));
    let (half, level) = ([most(0), most(1)], nodes[0][2]);
    let at = |k: usize, i: usize| half[i] * (k as f64 - 1.0);
    canopy.coords = (0..9).map(|n| [at(n % 3, 0), at(n / 3, 1), level]).collect();
    canopy.n_canopy = 9;
    canopy.faces = [0u32, 1, 3, 4].map(|n| [n, n + 1, n + 4, n + 3]).to_vec();
    let text = serde_json::json!({ "nodes": canopy.coords, "faces": canopy.faces }).to_string();
    std::fs::write(folder.join("structure-surface.json"), text).map_err(|e| e.to_string())
}

fn serve_fake(words: &[String]) -> Result<(), String> {
    let value = |key: &str| {
        let at = words.iter().position(|w| w == key).ok_or(format!("no {key}"))?;
        words.get(at + 1).cloned().ok_or(format!("no value of {key}"))
    };
    let role = Role::ALL.into_iter().find(|r| Ok(r.name()) == value("--fake").as_deref()).ok_or("role")?;
    let trouble = match value("--trouble").as_deref() {
        Ok("fault") => Trouble::Fault,
        Ok("exit") => Trouble::Exit,
        Ok("kill") => Trouble::Kill,
        Ok("hang") => Trouble::Hang,
        Ok("nan") => Trouble::Nan,
        Ok("coarse") => Trouble::Coarse,
        _ => Trouble::None,
    };
    if value("--trouble").as_deref() == Ok("start") {
        return Err("the grid file is damaged".into());
    }
    let scene = case::load(Path::new(&value("--scene")?)).map_err(|e| e.to_string())?;
    let mut canopy = mesh::structure_mesh(&scene).map_err(|e| e.to_string())?;
    if trouble == Trouble::Coarse {
        let stage: usize = value("--stage")?.parse().map_err(|e| format!("{e}"))?;
        let folder = case::stage_folder(Path::new(&value("--out")?), &scene, stage);
        coarsen(&mut canopy, &folder)?;
    }
    let width = [3, LOAD_WIDTH, 6][role as usize];
    let n = canopy.n_canopy.max(canopy.faces.len()) * width;
    let n = if role == Role::Flow { n } else { canopy.n_canopy * width };
    let mut fake =
        Fake { role, trouble, canopy, accepted: vec![0.0; n], trial: vec![0.0; n], grid: vec![0.0; 2] };
    let options = ServeOptions {
        session: value("--session")?,
        role,
        rank: 0,
        ranks: 1,
        stage: value("--stage")?.parse().map_err(|e| format!("{e}"))?,
        deadline: None,
        exit_when_orphaned: true,
    };
    channel::serve(&mut fake, &options).map(|_| ()).map_err(|e| e.to_string())
}

/// A run of `ripstop` in a folder of its own.
struct TestRun {
    folder: tempfile::TempDir,
}

impl TestRun {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/square-drop/scene.toml");
        let text = std::fs::read_to_string(scene).expect("the scene");
        let text = text
            .replace("cells_across = 12", "cells_across = 4")
            .replace("line_count = 24", "line_count = 8");
        std::fs::write(folder.path().join("scene.toml"), text).expect("a copy of the scene");
        Self { folder }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    fn command(&self, troubled: Option<(Role, &str)>, more: &[&str]) -> Command {
        let me = std::env::current_exe().expect("this program");
        let mut command = Command::new(env!("CARGO_BIN_EXE_ripstop"));
        command.arg("run").arg(self.folder.path().join("scene.toml")).arg("--out").arg(self.out());
        command.args(["--ranks", "structure=1,flow=1,mesh=1"]);
        for role in Role::ALL {
            let trouble = troubled.filter(|(r, _)| *r == role).map_or("none", |(_, t)| t);
            command.arg(format!("--{}", role.name()));
            command.arg(format!("{} --fake {} --trouble {trouble}", me.display(), role.name()));
        }
        command.args(more).stdin(Stdio::null());
        command
    }

    /// Exit code, standard error, and the processor time that was available.
    fn run(&self, troubled: Option<(Role, &str)>, more: &[&str]) -> (i32, String, Duration) {
        let available = Available::new();
        let Output { status, stdout, stderr } =
            self.command(troubled, more).output().expect("ripstop starts");
        let text = [stderr, stdout].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        (status.code().unwrap_or(-1), text, available.elapsed())
    }

    /// History of a stage without its wall times.
    fn history(&self, stage: &str) -> String {
        let path = self.out().join(stage).join("history.csv");
        let text = std::fs::read_to_string(&path).expect("a history");
        let names: Vec<&str> = text.lines().next().expect("names").split(',').collect();
        let keep = names.iter().position(|n| *n == "structure_wall_s").expect("wall times");
        text.lines().map(|l| l.split(',').take(keep).collect::<Vec<_>>().join(",") + "\n").collect()
    }

    /// Remaining processes of this run.
    fn left_behind(&self) -> Vec<String> {
        let mark = self.folder.path().to_string_lossy().into_owned();
        let mut left = Vec::new();
        for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
            if let Ok(line) = std::fs::read(entry.path().join("cmdline"))
                && String::from_utf8_lossy(&line).contains(&mark)
            {
                left.push(entry.path().display().to_string());
            }
        }
        left
    }
}

/// Names in shared memory that belong to ripstop.
fn shared_memory() -> BTreeSet<String> {
    let names = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten();
    let ours = |n: &String| n.starts_with("ripstop-mpi-") || n.starts_with("rs");
    names.map(|e| e.file_name().to_string_lossy().into_owned()).filter(ours).collect()
}

fn require(condition: bool, what: &str, text: &str) {
    assert!(condition, "{what}\n--- output ---\n{text}");
}

fn runs_are_complete_and_bitwise_repeatable() {
    let (a, b) = (TestRun::new(), TestRun::new());
    let (code, text, _) = a.run(None, &[]);
    require(code == 0, "a complete run ends with 0", &text);
    for expected in ["stage `descent`", "descent speed", "results:", "waiting"] {
        require(text.contains(expected), expected, &text);
    }
    let rows = a.history("descent").lines().count();
    require(rows == 21, "20 windows and a header", &a.history("descent"));
    for file in ["summary.json", "scene.toml", "descent/descent.svg", "descent/logs/flow.log"] {
        require(a.out().join(file).is_file(), file, &text);
    }
    for file in ["structure.bin", "flow.bin", "mesh.bin", "coupler.bin"] {
        require(a.out().join("descent/state").join(file).is_file(), file, &text);
    }
    let (code, text, _) = b.run(None, &["--quiet"]);
    require(code == 0 && text.is_empty(), "a quiet run prints nothing", &text);
    for stage in ["pre-inflation", "developed-flow", "descent"] {
        assert_eq!(a.history(stage), b.history(stage), "stage {stage} repeats byte for byte");
    }
    // A later stage alone, from the states of the first run.
    let whole = a.history("descent");
    let (code, text, _) = a.run(None, &["--stage", "descent"]);
    require(code == 0, "the last stage alone", &text);
    assert_eq!(a.history("descent"), whole);
}

/// A structure with 9 nodes instead of the scene's canopy mesh. All motion is uniform here, so the
/// histories agree.
fn structure_with_its_own_surface_gives_the_same_histories() {
    let (plain, own) = (TestRun::new(), TestRun::new());
    // Iterates differ by round-off and converge to the tolerance, which is far below that of the comparison.
    let tight = ["--set", "coupling.tolerance=1e-8"];
    let (code, text, _) = plain.run(None, &tight);
    require(code == 0, "a complete run", &text);
    let (code, text, _) = own.run(Some((Role::Structure, "coarse")), &tight);
    require(code == 0, "a complete run", &text);
    require(text.contains("9 nodes and 4 faces; the canopy has"), "the coupler reports the surface", &text);
    require(
        text.contains("fixed window length"),
        "the fake programs do not retry a window with another length",
        &text,
    );
    let (a, b) = (plain.history("descent"), own.history("descent"));
    let names: Vec<&str> = a.lines().next().expect("names").split(',').collect();
    for name in ["descent_speed_m_s", "drag_n", "interface_work_j"] {
        let at = names.iter().position(|n| *n == name).expect("a column");
        for (a, b) in a.lines().zip(b.lines()).skip(1) {
            let value = |l: &str| l.split(',').nth(at).expect("a cell").parse::<f64>().expect("a number");
            let (a, b) = (value(a), value(b));
            assert!((a - b).abs() <= 1e-6 * a.abs().max(1e-3), "{name}: {a} {b}");
        }
    }
}

fn each_failure_names_its_cause() {
    let cases = [
        (Role::Mesh, "fault", vec!["mesh", "rank 0", "window 2", "cell 17 is inverted"]),
        (Role::Flow, "exit", vec!["flow", "window 2", "licence has expired"]),
        (Role::Structure, "kill", vec!["structure", "window 2"]),
        (Role::Flow, "nan", vec!["flow", "window 2", "NaN"]),
    ];
    for (role, trouble, words) in cases {
        let run = TestRun::new();
        // The structure runs in the first stage already, the flow in the second.
        let (code, text, took) = run.run(Some((role, trouble)), &[]);
        require(code == 1, &format!("{trouble} ends with 1"), &text);
        for word in words {
            require(text.contains(word), &format!("{trouble}: the message holds `{word}`"), &text);
        }
        require(text.matches("error: ").count() == 1, "one message", &text);
        require(took < Duration::from_secs(25), &format!("{trouble} took {took:?}"), &text);
        require(run.out().join("summary.json").is_file(), "results so far are kept", &text);
        assert_eq!(run.left_behind(), Vec::<String>::new(), "{trouble}");
    }
}

fn error_output_of_a_failed_start_is_reported() {
    let run = TestRun::new();
    let (code, text, took) = run.run(Some((Role::Structure, "start")), &[]);
    require(code == 1 && text.contains("the grid file is damaged"), "last words", &text);
    require(text.contains("before its first window"), "place", &text);
    require(took < Duration::from_secs(8), &format!("took {took:?}"), &text);
}

fn unresponsive_program_fails_at_the_deadline() {
    let run = TestRun::new();
    // The first reply includes the start of the program.
    let deadline = load::deadline_s(3);
    let (code, text, took) = run.run(Some((Role::Structure, "hang")), &["--deadline", &deadline.to_string()]);
    require(code == 1 && text.contains(&format!("did not respond for {deadline} s")), "deadline", &text);
    require(took < Duration::from_secs(deadline + 5 + 3), &format!("took {took:?}"), &text);
    assert_eq!(run.left_behind(), Vec::<String>::new());
}

fn second_interrupt_ends_all_processes_within_five_seconds() {
    let run = TestRun::new();
    let child = run.command(Some((Role::Structure, "hang")), &[]).stderr(Stdio::piped()).spawn();
    let mut child = child.expect("ripstop starts");
    let history = run.out().join("pre-inflation/history.csv");
    let limit = Limit::new(Duration::from_secs(30));
    let second = || std::fs::read_to_string(&history).is_ok_and(|t| t.lines().count() == 3);
    limit.until(Duration::from_millis(20), second).expect("the run comes to window 2");
    let id = child.id().to_string();
    let interrupt = || Command::new("kill").args(["-INT", &id]).status().expect("kill");
    // The first interrupt waits for the end of the window, which never comes here.
    interrupt();
    let confirmed = std::cell::Cell::new(false);
    let words = child.stderr.take().expect("piped");
    let (sender, lines) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        BufReader::new(words).lines().map_while(Result::ok).all(|line| sender.send(line).is_ok())
    });
    let interrupt_confirmed = || {
        confirmed.set(confirmed.get() || lines.try_iter().any(|line| line.contains("interrupted")));
        confirmed.get()
    };
    let pause = Duration::from_millis(20);
    Limit::new(Duration::from_secs(5)).until(pause, interrupt_confirmed).expect("the interrupt is confirmed");
    interrupt();
    let limit = Limit::new(Duration::from_secs(5));
    limit.until(pause, || child.try_wait().is_ok_and(|s| s.is_some())).expect("the end within five seconds");
    let status = child.wait().expect("an end");
    assert_eq!(status.code(), Some(130));
    assert_eq!(run.left_behind(), Vec::<String>::new());
}

fn killed_coupler_leaves_no_processes() {
    let run = TestRun::new();
    let child = run.command(Some((Role::Structure, "hang")), &[]).stderr(Stdio::null()).spawn();
    let mut child = child.expect("ripstop starts");
    let history = run.out().join("pre-inflation/history.csv");
    let limit = Limit::new(Duration::from_secs(30));
    let second = || std::fs::read_to_string(&history).is_ok_and(|t| t.lines().count() == 3);
    limit.until(Duration::from_millis(20), second).expect("the run comes to window 2");
    child.kill().expect("kill -9");
    child.wait().expect("an end");
    let limit = Limit::new(Duration::from_secs(6));
    let ended = limit.until(Duration::from_millis(50), || run.left_behind().is_empty());
    assert!(ended.is_ok(), "still there: {:?}: {ended:?}", run.left_behind());
}

fn invalid_input_starts_no_program() {
    let run = TestRun::new();
    let scene = run.folder.path().join("scene.toml");
    let good = std::fs::read_to_string(&scene).expect("the scene");
    let cases = [
        (good.replace("thickness_m = 3.048e-5", "thickness_m = -1.0"), "thickness_m", vec![]),
        (good.replace("poisson_ratio", "poison_ratio"), "poison_ratio", vec![]),
        (good.clone(), "no stage `descend`", vec!["--stage", "descend"]),
        (good.clone(), "ranks for the structure", vec!["--ranks", "structure=9999"]),
        (good.clone(), "/nowhere/flow", vec!["--flow", "/nowhere/flow"]),
        (good.clone(), "unclosed quote", vec!["--mesh", "python3 'x"]),
        (good, "run that stage first", vec!["--stage", "descent"]),
    ];
    for (text, expected, more) in cases {
        std::fs::write(&scene, text).expect("a scene");
        let mut command = Command::new(env!("CARGO_BIN_EXE_ripstop"));
        command.arg("run").arg(&scene).arg("--out").arg(run.out());
        let me = std::env::current_exe().expect("this program");
        for role in Role::ALL {
            let key = format!("--{}", role.name());
            if !more.contains(&key.as_str()) {
                command.arg(key).arg(format!("{} --fake {}", me.display(), role.name()));
            }
        }
        let output = command.args(&more).output().expect("ripstop starts");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        require(output.status.code() == Some(2), &format!("{expected}: code 2"), &text);
        require(text.contains(expected), expected, &text);
        require(!run.out().join("pre-inflation").exists(), "no program was started", &text);
    }
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().collect();
    if words.iter().any(|w| w == "--session") {
        return match serve_fake(&words) {
            Ok(()) => ExitCode::SUCCESS,
            Err(message) => {
                eprintln!("{message}");
                ExitCode::FAILURE
            }
        };
    }
    let before = shared_memory();
    let code = harness::run(&[
        ("runs_are_complete_and_bitwise_repeatable", &runs_are_complete_and_bitwise_repeatable),
        (
            "structure_with_its_own_surface_gives_the_same_histories",
            &structure_with_its_own_surface_gives_the_same_histories,
        ),
        ("each_failure_names_its_cause", &each_failure_names_its_cause),
        ("error_output_of_a_failed_start_is_reported", &error_output_of_a_failed_start_is_reported),
        ("unresponsive_program_fails_at_the_deadline", &unresponsive_program_fails_at_the_deadline),
        (
            "second_interrupt_ends_all_processes_within_five_seconds",
            &second_interrupt_ends_all_processes_within_five_seconds,
        ),
        ("killed_coupler_leaves_no_processes", &killed_coupler_leaves_no_processes),
        ("invalid_input_starts_no_program", &invalid_input_starts_no_program),
    ]);
    // The next run on this machine removes the folder of the killed coupler.
    let after: Vec<String> = shared_memory().difference(&before).cloned().collect();
    if !after.is_empty() {
        println!("{} files left in shared memory", after.len());
    }
    code
}
