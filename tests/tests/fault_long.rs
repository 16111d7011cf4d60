//! Long runs: constant memory and number of open files of each process, and bitwise reproducible windows.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ripstop_tests::{History, changed_scene, processes_naming, ripstop_run, start};

/// A canopy in equilibrium, in a descent of `windows` windows of some milliseconds of work each.
fn scene(folder: &Path, windows: u32) -> PathBuf {
    let long = format!("duration_s = {}\nmass_damping_per_s = 10.0\n", f64::from(windows) * 2e-3);
    changed_scene(
        "square-drop",
        folder,
        &[
            ("duration_s = 0.1\nwindow_s = 5e-3", &format!("{long}window_s = 2e-3")),
            ("substeps = 10", "substeps = 2"),
            // The list of snapshots needs about 0.6 kB each.
            ("[coupling]\n", "[output]\nsurface_every_windows = 0\nvolume_every_windows = 0\n[coupling]\n"),
            ("thickness_m = 3.048e-5", "thickness_m = 3.048e-4"),
            ("cells_across = 12", "cells_across = 4"),
            ("line_count = 24", "line_count = 8"),
            ("layers_inside = 5", "layers_inside = 2"),
            ("layers_outside = 10", "layers_outside = 4"),
            ("first_layer_m = 0.1", "first_layer_m = 0.2"),
            ("duration_s = 1.0", "duration_s = 2.0"),
            ("duration_s = 0.2", "duration_s = 0.08"),
        ],
    )
}

/// Memory (kB) and number of open files of a process.
#[derive(Clone, Copy, Debug)]
struct Held {
    memory: u64,
    files: usize,
}

fn held(pid: u32) -> Option<Held> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    let memory = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(Held { memory, files: fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count() })
}

/// Maximum memory and minimum number of open files of each process over several samples: files that are open
/// temporarily, as for saving a state, are no leak.
type Seen = BTreeMap<u32, (String, Held)>;

fn look(mark: &str, seen: &mut Seen) {
    for (pid, line) in processes_naming(mark) {
        let Some(now) = held(pid) else { continue };
        let name = line.split(' ').next().unwrap_or_default().rsplit('/').next().unwrap_or_default();
        let (_, most) = seen.entry(pid).or_insert_with(|| (name.to_owned(), now));
        *most = Held { memory: most.memory.max(now.memory), files: most.files.min(now.files) };
    }
}

/// Runs the scene. Returns memory and open files of its processes in the second and in the last tenth of the run.
fn run_to_end(scene: &Path, out: &Path, windows: u32) -> [Seen; 2] {
    let options = ["--quiet", "--ranks", "structure=1,mesh=1,flow=1"];
    let mut run = start(ripstop_run(scene, out, &options));
    let history = out.join("descent/history.csv");
    let mut seen = [Seen::new(), Seen::new()];
    while run.try_wait().expect("it can be waited for").is_none() {
        std::thread::sleep(Duration::from_millis(20));
        let rows = fs::read_to_string(&history).map_or(0, |t| t.lines().count().saturating_sub(1)) as u32;
        match 10 * rows / windows {
            1 => look(&out.display().to_string(), &mut seen[0]),
            9 => look(&out.display().to_string(), &mut seen[1]),
            _ => {}
        }
    }
    let output = run.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    seen
}

fn stays_the_same(windows: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(folder.path(), windows);
    let outs = ["one", "two"].map(|name| folder.path().join(name));
    for out in &outs {
        let [early, late] = run_to_end(&scene, out, windows);
        // The coupler, three launchers and a rank each.
        assert_eq!(early.len(), 7, "not all were seen: {early:?}");
        for (pid, (name, before)) in &early {
            let Some((_, after)) = late.get(pid) else { panic!("{name} was not seen at the end") };
            println!("{name}: {before:?}, at the end {after:?}");
            assert_eq!(before.files, after.files, "{name} leaks open files");
            // Pages touched for the first time, and 16 bytes per window for the summary.
            let more = after.memory.saturating_sub(before.memory);
            assert!(more <= 256 + u64::from(windows) / 32, "{name}: {more} kB more: {before:?} {after:?}");
        }
    }
    let [one, two] = outs.map(|out| History::read(&out, "descent"));
    assert_eq!(one.len(), windows as usize);
    assert!(one.without_wall_times() == two.without_wall_times(), "other numbers when flown again");
}

#[test]
fn memory_and_files_are_constant_over_a_thousand_windows() {
    stays_the_same(1000);
}

#[test]
#[ignore = "nightly: 4 minutes: ten thousand windows, twice"]
fn memory_and_files_are_constant_over_ten_thousand_windows() {
    stays_the_same(10_000);
}
