//! Leftovers of killed runs do not affect the next run; concurrent runs are independent; insufficient shared memory is
//! reported before the run.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ripstop_tests::load::Limit;
use ripstop_tests::skip::skipped;
use ripstop_tests::tiny::{Base, RANKS, WINDOWS};
use ripstop_tests::{
    History, Signal, processes_naming, program, ripstop_run, session_memory, signal, start, succeed,
};
use rustix::fs::Mode;
use rustix::process::umask;

/// Serialises the tests, because they inspect the shared memory of the machine.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn descent(base: &Base, out: &Path) -> Command {
    let options = ["--stage", "descent", "--ranks", RANKS, "--quiet"];
    ripstop_run(&base.scene, out, &options)
}

/// Files of a run of the process `pid` in shared memory.
fn left_of(pid: u32) -> Vec<PathBuf> {
    session_memory("square-drop", pid, 2)
}

fn same_as_unharmed(base: &Base, out: &Path) {
    let (here, there) = (History::read(out, "descent"), History::read(&base.out(), "descent"));
    assert_eq!(here.without_wall_times(), there.without_wall_times());
}

/// Kills a run with all its ranks `times` times, each time at a different moment, and starts the next one at once.
fn kill_all(times: u32) {
    let _alone = alone();
    let base = Base::new();
    let out = base.folder.path().join("killed");
    base.copy(&out);
    let mark = out.display().to_string();
    let mut pids = Vec::new();
    let began = Instant::now();
    for i in 0..times {
        let mut run = start(descent(&base, &out));
        pids.push(run.id());
        // Moments from launch to the windows: evenly distributed in quasi-random order.
        std::thread::sleep(Duration::from_millis(u64::from(i * 37 % 100) * 15));
        for (pid, _) in processes_naming(&mark) {
            signal(pid, Signal::KILL);
        }
        let status = run.wait().expect("it can be waited for");
        assert!(!status.success() || History::read(&out, "descent").len() == WINDOWS, "{i}: {status}");
    }
    let took = began.elapsed().as_secs_f64();
    let left = pids.iter().filter(|&&pid| !left_of(pid).is_empty()).count();
    // Ranks whose launcher was killed during start-up end by themselves.
    let pause = Duration::from_millis(50);
    let gone = Limit::new(Duration::from_secs(5)).until(pause, || processes_naming(&mark).is_empty());
    assert!(gone.is_ok(), "left: {:?}: {gone:?}", processes_naming(&mark));
    succeed(descent(&base, &out));
    same_as_unharmed(&base, &out);
    for pid in pids {
        assert!(left_of(pid).is_empty(), "left of {pid}: {:?}", left_of(pid));
    }
    println!(
        "{times} runs killed in {took:.0} s; {left} had left something when the next began; none at the end"
    );
}

#[test]
fn next_run_succeeds_after_all_processes_are_killed() {
    kill_all(20);
}

#[test]
#[ignore = "nightly: 6 minutes: LEFTOVERS runs (300 by default)"]
fn next_run_succeeds_after_hundreds_of_kills() {
    kill_all(std::env::var("LEFTOVERS").ok().and_then(|n| n.parse().ok()).unwrap_or(300));
}

#[test]
fn concurrent_runs_of_a_scene_are_independent() {
    let _alone = alone();
    let base = Base::new();
    let outs = ["one", "two"].map(|name| base.folder.path().join(name));
    outs.iter().for_each(|out| base.copy(out));
    let runs = outs.each_ref().map(|out| start(descent(&base, out)));
    // A third one into the folder of the first is refused.
    let begun = || outs[0].join("descent/logs").exists();
    Limit::new(Duration::from_secs(120))
        .until(Duration::from_millis(5), begun)
        .expect("the first run begins");
    let third = descent(&base, &outs[0]).output().expect("it starts");
    let text = String::from_utf8_lossy(&third.stderr);
    assert_eq!(third.status.code(), Some(2), "{text}");
    assert!(text.contains("another run writes to") && text.contains("--out"), "{text}");
    for (run, out) in runs.into_iter().zip(&outs) {
        let output = run.wait_with_output().expect("it ends");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        same_as_unharmed(&base, out);
    }
}

/// During a run, other users can neither read its files nor add files.
#[test]
fn shared_memory_is_inaccessible_to_other_users() {
    let _alone = alone();
    let base = Base::new();
    let out = base.folder.path().join("watched");
    base.copy(&out);
    let mut command = descent(&base, &out);
    command.args(["--set", "stage.descent.duration_s=100"]);
    // The run inherits the least restrictive umask.
    let mask = umask(Mode::empty());
    let mut run = start(command);
    umask(mask);
    let begun = || out.join("descent/history.csv").exists();
    Limit::new(Duration::from_secs(120)).until(Duration::from_millis(5), begun).expect("the run begins");
    // A long run that stands still while it is inspected: it neither ends nor removes a file.
    let mark = out.display().to_string();
    for (pid, _) in processes_naming(&mark) {
        signal(pid, Signal::STOP);
    }
    assert!(run.try_wait().expect("it can be waited for").is_none(), "the run ended before it was inspected");
    let left = left_of(run.id());
    let mut looked = 0;
    let mut open = Vec::new();
    for path in &left {
        let meta = fs::symlink_metadata(path).expect("there");
        looked += 1;
        if meta.mode() & 0o077 != 0 {
            open.push(format!("{} {:o}", path.display(), meta.permissions().mode()));
        }
    }
    let base_folder = fs::symlink_metadata(format!("/dev/shm/ripstop-{}", meta_user(&out))).expect("there");
    assert_eq!(base_folder.mode() & 0o077, 0, "the folder of all sessions");
    assert!(looked > 20, "only {looked} files");
    assert!(open.is_empty(), "open to others: {open:?}");

    refused_to_another_user(&left);
    for (pid, _) in processes_naming(&mark) {
        signal(pid, Signal::KILL);
    }
    let _ = run.wait();
    let _ = Limit::new(Duration::from_secs(8))
        .until(Duration::from_millis(50), || processes_naming(&mark).is_empty());
}

/// Tries to read, change and remove the files `left` of a run as another user, if permitted.
fn refused_to_another_user(left: &[PathBuf]) {
    let root = rustix::process::geteuid().is_root();
    if root && Command::new("setpriv").arg("--version").output().is_ok_and(|o| o.status.success()) {
        let nobody = |line: &str| {
            let words = ["--reuid=65534", "--regid=65534", "--clear-groups", "sh", "-c", line];
            Command::new("setpriv").args(words).output().expect("it starts")
        };
        assert!(nobody("ls /dev/shm").status.success(), "another user sees the names");
        for path in left {
            let p = path.display();
            for line in [
                format!("cat {p} > /dev/null"),
                format!("ls {p}/."),
                format!("test -e {p} && echo x >> {p}"),
                format!("echo x > {p}/x"),
                format!("test -e {p} && rm -rf {p}"),
            ] {
                // `rm` of files of another user fails in a folder with the sticky bit.
                assert!(!nobody(&line).status.success(), "another user could: {line}");
            }
        }
        let key = left.iter().find(|p| p.is_dir()).expect("the session's folder");
        for line in [format!("cat {}/session.json", key.display()), format!("ls {}", key.display())] {
            assert!(!nobody(&line).status.success(), "another user could: {line}");
        }
    } else {
        eprintln!("not tried as another user: that needs root and setpriv");
    }
}

fn meta_user(path: &Path) -> u32 {
    fs::metadata(path).expect("there").uid()
}

/// With a `/dev/shm` of `size`, in a separate namespace; `None` (with a message) if not permitted.
fn with_memory_of(size: &str, command: &Command) -> Option<std::process::Output> {
    let line = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && exec \"$@\"");
    let tried = Command::new("unshare").args(["-m", "sh", "-c", &line, "sh", "true"]).output();
    if !tried.as_ref().is_ok_and(|o| o.status.success()) {
        skipped("no mount namespaces here (they need root)");
        return None;
    }
    let mut inside = Command::new("unshare");
    inside.args(["-m", "sh", "-c", &line, "sh"]).arg(command.get_program()).args(command.get_args());
    Some(inside.output().expect("it starts"))
}

#[test]
fn insufficient_shared_memory_is_reported_before_the_run() {
    let base = Base::new();
    let out = base.folder.path().join("full");
    base.copy(&out);
    let Some(output) = with_memory_of("16m", &descent(&base, &out)) else { return };
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("stage `descent` needs ") && text.contains("MB in /dev/shm"), "{text}");
    assert!(text.contains("16 MB") || text.contains("17 MB"), "what is free: {text}");
    assert!(!out.join("descent").exists(), "something was begun");

    // `check` reports the size; slightly more is sufficient.
    let mut check = Command::new(program("ripstop"));
    check.arg("check").arg(&base.scene).args(["--ranks", RANKS]);
    let text = String::from_utf8(succeed(check).stdout).expect("text");
    let line = text.lines().find(|l| l.starts_with("shared memory: at most ")).expect("a line");
    let needed: u64 = line.split(' ').nth(4).and_then(|n| n.parse().ok()).expect("a number");
    assert!((20..200).contains(&needed), "{line}");
    let size = format!("{}k", (needed + 1) * 1000);
    let output = with_memory_of(&size, &descent(&base, &out)).expect("as before");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    same_as_unharmed(&base, &out);
}

/// Twice as many busy loops as cores do not change the results.
fn load_changes_nothing(ranks: &str) {
    struct Loop(std::process::Child);
    impl Drop for Loop {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }
    let _alone = alone();
    let base = Base::on(ranks);
    let out = base.folder.path().join("loaded");
    base.copy(&out);
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let busy = || Loop(Command::new("sh").args(["-c", "while :; do :; done"]).spawn().expect("a shell"));
    let loops: Vec<Loop> = (0..2 * cores).map(|_| busy()).collect();
    let began = Instant::now();
    succeed(ripstop_run(&base.scene, &out, &["--stage", "descent", "--ranks", ranks, "--quiet"]));
    println!("{ranks}: {:.0} s beside {} busy loops", began.elapsed().as_secs_f64(), loops.len());
    drop(loops);
    same_as_unharmed(&base, &out);
}

#[test]
fn results_do_not_depend_on_machine_load() {
    load_changes_nothing("structure=1,mesh=1,flow=1");
}

/// Ranks of OpenMPI wait actively: on a loaded machine each of the thousands of messages of a window takes several time
/// slices of the scheduler.
#[test]
#[ignore = "nightly: 5 minutes: nine ranks that wait for each other beside four busy loops on two cores"]
fn results_of_many_ranks_do_not_depend_on_machine_load() {
    load_changes_nothing(RANKS);
}
