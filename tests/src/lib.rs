//! Cross-program tests of Ripstop: see `tests/tests/`.
//!
//! This library runs the programs and reads their results.

pub mod browser;
pub mod equations;
pub mod harness;
pub mod imports;
pub mod load;
pub mod prose;
pub mod skip;
pub mod spoil;
pub mod tiny;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

pub use rustix::process::Signal;

/// Header of a scene: a square sheet of 2 m with given cells across, lines and further keys of the fabric.
#[macro_export]
macro_rules! sheet {
    ($name:literal, $cells:literal, $lines:literal, $fabric:literal) => {
        concat!(
            "name = \"",
            $name,
            "\"\n[canopy]\nkind = \"square\"\nwidth_m = 2.0\ncells_across = ",
            $cells,
            "\nline_count = ",
            $lines,
            "\nline_length_m = 2.4\n[fabric]\nyoungs_modulus_pa = 2e8\npoisson_ratio = 0.3\nthickness_m = 3.048e-5\n\
             density_kg_m3 = 1223.5093\n",
            $fabric,
            "[lines]\nyoungs_modulus_pa = 5.3420e8\narea_m2 = 3.11e-6\ndensity_kg_m3 = 1223.50932\n"
        )
    };
}

/// Root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests lie in the repository").to_path_buf()
}

/// Path of a program of this build.
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test has a path");
    let folder = test.parent().and_then(Path::parent).expect("target/<profile>/deps/<test>");
    let path = folder.join(name);
    assert!(path.exists(), "{} is missing: build it with scripts/setup", path.display());
    path
}

/// Path of a scene of the repository.
pub fn scene(case: &str) -> PathBuf {
    root().join("cases").join(case).join("scene.toml")
}

/// Writes a scene with replaced text to `folder`.
pub fn changed_scene(case: &str, folder: &Path, changes: &[(&str, &str)]) -> PathBuf {
    let mut text = std::fs::read_to_string(scene(case)).expect("the scene can be read");
    for (from, to) in changes {
        assert!(text.contains(from), "scene {case} no longer contains {from:?}");
        text = text.replacen(from, to, 1);
    }
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).expect("the scene can be written");
    file
}

/// A `ripstop run` of `scene` into `out`. One rank of each program unless the scene or the options name ranks: two tests at the same
/// time with two ranks of flow and mesh (the defaults of a scene) take 1.4 times as long on two cores.
pub fn ripstop_run(scene: &Path, out: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command.arg("run").arg(scene).arg("--out").arg(out);
    let text = std::fs::read_to_string(scene).unwrap_or_default();
    if !options.contains(&"--ranks") && !text.contains("[ranks]") && !text.contains("ranks.") {
        command.args(["--ranks", "flow=1,mesh=1"]);
    }
    // Last, so that a caller may add the value of the last option.
    command.args(options);
    command
}

/// Runs a command to its end and asserts success.
pub fn succeed(mut command: Command) -> Output {
    let output = command.output().expect("the program starts");
    assert!(
        output.status.success(),
        "{command:?} ended with {}\n{}\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// Starts a command in the background with captured output.
pub fn start(mut command: Command) -> Child {
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

/// A table with named columns.
pub struct History {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl History {
    /// Reads `<out>/<stage>/history.csv`.
    pub fn read(out: &Path, stage: &str) -> Self {
        Self::read_file(&out.join(stage).join("history.csv"))
    }

    /// Reads a file of comma-separated values with a header.
    pub fn read_file(file: &Path) -> Self {
        let text = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let mut lines = text.lines().map(|l| l.split(',').map(str::to_owned).collect::<Vec<_>>());
        let names = lines.next().expect("a header");
        let rows: Vec<_> = lines.collect();
        assert!(rows.iter().all(|r| r.len() == names.len()), "ragged rows in {}", file.display());
        Self { names, rows }
    }

    /// Number of windows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether no window was finished.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// A column as numbers.
    pub fn column(&self, name: &str) -> Vec<f64> {
        let i = self.names.iter().position(|n| n == name);
        let i = i.unwrap_or_else(|| panic!("no column {name} among {:?}", self.names));
        self.rows.iter().map(|r| r[i].parse().unwrap_or_else(|_| panic!("{name}: {}", r[i]))).collect()
    }

    /// All columns except wall times, for bitwise comparison.
    pub fn without_wall_times(&self) -> Vec<Vec<&str>> {
        let wall = self.names.iter().position(|n| n.ends_with("wall_s")).expect("wall times stand last");
        std::iter::once(&self.names)
            .chain(&self.rows)
            .map(|r| r[..wall].iter().map(String::as_str).collect())
            .collect()
    }
}

/// Sends a signal to a process of a test; no effect if it has ended.
pub fn signal(pid: u32, signal: Signal) {
    let pid = i32::try_from(pid).ok().and_then(rustix::process::Pid::from_raw);
    let _ = rustix::process::kill_process(pid.expect("a process"), signal);
}

/// Processes of the project with `mark` on their command line.
pub fn processes_naming(mark: &str) -> Vec<(u32, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|n| n.parse::<u32>().ok()) else { continue };
        let Ok(line) = std::fs::read(entry.path().join("cmdline")) else { continue };
        let line = String::from_utf8_lossy(&line).replace('\0', " ");
        if pid != std::process::id() && line.contains(mark) {
            found.push((pid, line));
        }
    }
    found
}

/// Files in shared memory of one session: of the stage `stage` of a run of the scene `name` by the process `coupler`.
pub fn session_memory(name: &str, coupler: u32, stage: usize) -> Vec<PathBuf> {
    let session = format!("{name}-{coupler}-{stage}");
    let mut files = channel::session_files(&session).expect("a valid name");
    files.extend(Some(Path::new("/dev/shm").join(format!("ripstop-mpi-{session}"))).filter(|p| p.exists()));
    files
}
