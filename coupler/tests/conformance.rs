//! `ripstop conform` against a correct program and against defective ones: each fails its tests.
//!
//! This file is also the source of those programs: started with `--session` it serves as a structure
//! with the defect that `--flaw` names.

#[path = "../../tests/src/harness.rs"]
mod harness;
#[path = "../../tests/src/load.rs"]
mod load;

use std::path::Path;
use std::process::{Command, ExitCode};

use case::Role;
use channel::{Announcement, Fault, Input, Participant, ServeOptions, Stats, Window, structure_stats};
use load::Available;

/// A structure of independent overdamped nodes.
struct Nodes {
    flaw: String,
    canopy: mesh::StructureMesh,
    accepted: Vec<f64>,
    trial: Vec<f64>,
    stale: Vec<f64>,
}

impl Participant for Nodes {
    fn announce(&self) -> Announcement {
        let extra = u64::from(self.flaw == "wrong-size");
        Announcement {
            role: "structure".into(),
            program: "nodes".into(),
            version: "0".into(),
            canopy_nodes: self.canopy.n_canopy as u64 + extra,
            canopy_faces: self.canopy.faces.len() as u64,
            surface_hash: channel::surface_hash(&self.canopy.faces),
            grid_nodes: 0,
            output_width: 3,
            effects: ["fabric.wrinkling", "lines", channel::RESUME].map(String::from).to_vec(),
        }
    }

    fn output_rows(&self) -> Vec<u64> {
        (0..self.canopy.n_canopy as u64).collect()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let faces = self.canopy.faces.len() as f64;
        let load: f64 = input.canopy.chunks_exact(8).map(|f| 0.5 * (f[0] + f[4])).sum::<f64>() / faces;
        match self.flaw.as_str() {
            "hang" => std::thread::sleep(std::time::Duration::from_secs(1000)),
            "panic" => panic!("index out of bounds"),
            "extreme" if load.abs() > 1e6 => std::process::exit(9),
            _ => {}
        }
        let from = if self.flaw == "no-rollback" { &self.trial } else { &self.accepted };
        let mut next = from.clone();
        let load = if self.flaw == "substeps" { load * (w.substeps as f64).sin() } else { load };
        for _ in 0..w.substeps {
            for (at, x) in next.iter_mut().enumerate() {
                let target = if at % 3 == 2 { 0.01 * load } else { 0.0 };
                // Implicit Euler: first order in the substep.
                let h = w.dt / w.substeps as f64 * 20.0;
                *x = (*x + h * target) / (1.0 + h);
            }
        }
        output.copy_from_slice(&next);
        self.trial = next;
        if self.flaw == "nan" {
            output[7] = f64::NAN;
        }
        if self.flaw == "stale" {
            if self.stale.is_empty() {
                self.stale = output.to_vec();
            }
            output.copy_from_slice(&self.stale);
        }
        let mut stats = Stats::default();
        // The projection of the faces does not change while they move upwards.
        let end = input.canopy.chunks_exact(8).map(|f| f[4]).sum::<f64>() / faces;
        stats.values[structure_stats::VERTICAL_LOAD] = end * self.canopy.fabric_area(|_| true);
        stats.values[structure_stats::STRAIN_ENERGY] = 1.0;
        Ok(stats)
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        self.accepted.copy_from_slice(&self.trial);
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let kept: Vec<f64> =
            if self.flaw == "no-restore" { vec![0.0; self.accepted.len()] } else { self.accepted.clone() };
        let text = serde_json::to_string(&kept).map_err(Fault::new)?;
        std::fs::write(case::state_file(folder, Role::Structure), text).map_err(Fault::new)
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

fn serve(words: &[String]) -> Result<(), String> {
    let value = |key: &str| {
        let at = words.iter().position(|w| w == key).ok_or(format!("no {key}"))?;
        words.get(at + 1).cloned().ok_or(format!("no value of {key}"))
    };
    let scene = case::load(Path::new(&value("--scene")?)).map_err(|e| e.to_string())?;
    let stage: usize = value("--stage")?.parse().map_err(|e| format!("{e}"))?;
    let canopy = mesh::structure_mesh(&scene).map_err(|e| e.to_string())?;
    let within = value("--resume").ok().filter(|_| value("--flaw").is_ok_and(|f| f != "no-resume"));
    let within = within.map(|folder| case::state_file(Path::new(&folder), Role::Structure));
    let source = scene.source_state(Path::new(&value("--out")?), stage, Role::Structure);
    let accepted = match within.or(source) {
        None => vec![0.0; 3 * canopy.n_canopy],
        Some(file) => {
            let text = std::fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
            serde_json::from_str(&text).map_err(|e| e.to_string())?
        }
    };
    let mut nodes =
        Nodes { flaw: value("--flaw")?, canopy, trial: accepted.clone(), accepted, stale: Vec::new() };
    let options = ServeOptions {
        session: value("--session")?,
        role: Role::Structure,
        rank: 0,
        ranks: 1,
        stage,
        deadline: None,
        exit_when_orphaned: true,
    };
    channel::serve(&mut nodes, &options).map(|_| ()).map_err(|e| e.to_string())
}

const SCENE: &str = r#"
name = "two-stages"
[canopy]
kind = "square"
width_m = 2.0
cells_across = 4
line_count = 8
line_length_m = 2.4
[fabric]
youngs_modulus_pa = 2e8
poisson_ratio = 0.3
thickness_m = 3.048e-5
density_kg_m3 = 1223.5093
wrinkling = true
[lines]
youngs_modulus_pa = 5.3420e8
area_m2 = 3.11e-6
density_kg_m3 = 1223.50932
[[stage]]
name = "first"
kind = "pre-inflation"
pressure_pa = 10.0
duration_s = 0.03
window_s = 1e-2
substeps = 4
[[stage]]
name = "second"
kind = "pre-inflation"
pressure_pa = 30.0
duration_s = 0.03
window_s = 1e-2
substeps = 4
"#;

fn ripstop(words: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_ripstop")).args(words).output().expect("ripstop starts");
    let text = [output.stdout, output.stderr].map(|b| String::from_utf8_lossy(&b).into_owned()).concat();
    (output.status.code().unwrap_or(-1), text)
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().collect();
    if words.iter().any(|w| w == "--session") {
        return match serve(&words) {
            Ok(()) => ExitCode::SUCCESS,
            Err(message) => {
                eprintln!("{message}");
                ExitCode::FAILURE
            }
        };
    }
    harness::run(&[
        ("each_flaw_fails_its_tests", &each_flaw_fails_its_tests),
        ("unresponsive_program_fails_at_the_deadline", &unresponsive_program_fails_at_the_deadline),
    ])
}

/// Command of this file's program with a flaw.
fn command(flaw: &str) -> String {
    let me = std::env::current_exe().expect("this program");
    format!("'{}' --flaw {flaw}", me.display())
}

/// A recording of the correct program, in a folder of its own.
fn record() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, SCENE).expect("a scene");
    let (out, recording) = (folder.path().join("out"), folder.path().join("recording"));
    let [scene, out, recording] = [&scene, &out, &recording].map(|p| p.to_str().expect("UTF-8"));
    let (code, text) =
        ripstop(&["run", scene, "--out", out, "--record", recording, "--structure", &command("none")]);
    assert_eq!(code, 0, "{text}");
    let recording = recording.to_owned();
    (folder, recording)
}

fn each_flaw_fails_its_tests() {
    let (_folder, recording) = record();
    // The tests that each flaw fails.
    let flaws: [(&str, &[&str]); 10] = [
        ("none", &[]),
        ("no-rollback", &["repeatability", "rollback"]),
        (
            "stale",
            &["next window", "stage restart", "resume", "own input", "recorded reply", "response", "faces"],
        ),
        ("no-restore", &["stage restart", "resume"]),
        ("no-resume", &["resume"]),
        ("substeps", &["substeps", "recorded reply", "response", "faces"]),
        ("extreme", &["extreme input"]),
        ("nan", &["finite reply"]),
        ("panic", &["finite reply"]),
        ("wrong-size", &["handshake"]),
    ];
    for (flaw, fails) in flaws {
        let (code, text) = ripstop(&[
            "conform",
            "structure",
            &recording,
            "--command",
            &command(flaw),
            "--tolerance",
            "1e-9",
        ]);
        let failed: Vec<&str> = text
            .lines()
            .filter_map(|l| l.trim_start().strip_prefix("FAILED"))
            .map(|l| l.trim_start().split("  ").next().unwrap_or_default().trim())
            .collect();
        assert_eq!(failed, fails, "flaw {flaw}:\n{text}");
        assert_eq!(code, if fails.is_empty() { 0 } else { 3 }, "flaw {flaw}:\n{text}");
    }
}

fn unresponsive_program_fails_at_the_deadline() {
    let (_folder, recording) = record();
    // The first reply includes the start of the program.
    let deadline = load::deadline_s(1);
    let available = Available::new();
    let seconds = deadline.to_string();
    let (code, text) =
        ripstop(&["conform", "structure", &recording, "--command", &command("hang"), "--deadline", &seconds]);
    assert!(code == 3 && text.contains(&format!("did not respond for {deadline} s")), "{text}");
    assert!(available.elapsed().as_secs() < deadline + 59, "took {:?}", available.elapsed());
}
