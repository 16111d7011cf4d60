//! Ranks on several hosts, emulated on this machine by `scripts/several-hosts`.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use ripstop_tests::load::{Limit, asleep};
use ripstop_tests::skip::skipped;
use ripstop_tests::{
    History, Signal, changed_scene, processes_naming, program, ripstop_run, root, signal, start, succeed,
};

const RANKS: [&str; 2] = ["--ranks", "structure=2,mesh=2,flow=3"];

/// A `ripstop run` on as many hosts as `mpirun` names; `None` (with a message) if hosts cannot be emulated.
fn on_hosts(scene: &Path, out: &Path, options: &[&str], mpirun: &[&str]) -> Option<Command> {
    let script = root().join("scripts/several-hosts");
    let n = if mpirun.iter().any(|option| option.contains("far2")) { "3" } else { "2" };
    let tried = Command::new(&script).args([n, "true"]).output().expect("a shell");
    if !tried.status.success() {
        let why = String::from_utf8_lossy(&tried.stderr);
        skipped(&format!("no network namespaces here (they need root): {}", why.trim()));
        return None;
    }
    let mut command = Command::new(script);
    command.arg(n).arg(program("ripstop")).arg("run").arg(scene).arg("--out").arg(out).args(options);
    command.args(RANKS);
    mpirun.iter().for_each(|option| {
        command.args(["--mpirun", option]);
    });
    Some(command)
}

/// Ranks of all three programs on other hosts than the coupler, each program on other ones: bitwise identical results.
#[test]
fn results_do_not_depend_on_hosts_bitwise() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), &[]);
    let (one, two) = (folder.path().join("one"), folder.path().join("several"));
    let few = ["--stop-after-windows", "2"];
    let mpirun = [
        "structure=--host near:8,far2:8 --map-by node",
        "mesh=--host near:8,far:8 --map-by node",
        "flow=--host near:8,far:8,far2:8 --map-by node",
    ];
    let Some(run) = on_hosts(&scene, &two, &few, &mpirun) else { return };
    succeed(run);
    succeed(ripstop_run(&scene, &one, &[&few[..], &RANKS[..]].concat()));
    for stage in ["pre-inflation", "developed-flow", "descent"] {
        let (a, b) = (History::read(&two, stage), History::read(&one, stage));
        assert_eq!(a.without_wall_times(), b.without_wall_times(), "{stage}");
    }
    for (role, far) in [("structure", [1].as_slice()), ("mesh", &[1]), ("flow", &[1, 2])] {
        let log = std::fs::read_to_string(two.join(format!("descent/logs/{role}.log"))).expect("a log");
        for rank in far {
            let says = format!("rank {rank} of ");
            let line = log
                .lines()
                .find(|l| l.starts_with(&says) && l.ends_with("rank 0 represents it in the session"));
            assert!(line.is_some(), "{role}: {log}");
        }
    }
}

/// The batch script places ranks on the nodes of the Slurm allocation, the first of each program on the first node, where
/// it runs itself.
#[test]
fn slurm_script_distributes_the_ranks() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let script = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, format!("#!/bin/sh\n{text}\n")).expect("written");
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).expect("permitted");
        file
    };
    script("scontrol", "[ \"$*\" = \"show hostnames n[07-08]\" ] && printf 'n07\\nn08\\n'");
    // Prints the commands instead of running them.
    let check = script("check", &format!("shift; exec '{}' check \"$@\"", program("ripstop").display()));
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").expect("a PATH"));
    let output = Command::new(root().join("docs/how-to/slurm.sh"))
        .arg(root().join("cases/square-drop/scene.toml"))
        .envs([("PATH", path.as_str()), ("SLURM_JOB_NODELIST", "n[07-08]"), ("SLURM_JOB_ID", "12")])
        .env("SLURM_SUBMIT_DIR", folder.path())
        .env("RIPSTOP", check)
        .output()
        .expect("it starts");
    let text =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{text}");
    for (command, program) in [
        ("mpirun -n 4 --host n07:4 -x ", "structure-solver"),
        ("mpirun -n 8 --host n07:4,n08:4 -x ", "mesh-mover"),
        ("mpirun -n 48 --host n07:24,n08:24 -x ", "flow-solver"),
    ] {
        assert!(text.lines().any(|l| l.contains(command) && l.contains(program)), "{command}: {text}");
    }
}

/// Standard error of a run that has ended.
fn errors_of(run: &mut std::process::Child) -> String {
    let mut text = String::new();
    std::io::Read::read_to_string(&mut run.stderr.take().expect("captured"), &mut text).expect("text");
    text
}

/// A rank on another host sleeps while the others work, and its failure ends the run.
#[test]
fn remote_rank_sleeps_and_its_failure_ends_the_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = changed_scene("square-drop", folder.path(), &[("duration_s = 0.1\n", "duration_s = 50.0\n")]);
    let out = folder.path().join("out");
    let near_and_far = ["--host near:8,far:8 --map-by node"];
    let Some(run) = on_hosts(&scene, &out, &["--quiet"], &near_and_far) else { return };
    let mut run = start(run);
    let limit = Limit::new(Duration::from_secs(400));
    let history = out.join("descent/history.csv");
    while !std::fs::read_to_string(&history).is_ok_and(|t| t.lines().count() > 2) {
        limit.demand("the run did not reach the descent");
        if let Some(status) = run.try_wait().expect("it can be waited for") {
            panic!("the run ended before the descent with {status}: {}", errors_of(&mut run));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let mark = out.display().to_string();
    let ranks = |name: &str| -> Vec<u32> {
        let is = |line: &str| line.split(' ').next().is_some_and(|word| word.ends_with(name));
        processes_naming(&mark).into_iter().filter(|(_, line)| is(line)).map(|(pid, _)| pid).collect()
    };
    let far = |pid: &u32| {
        let device = |pid: &str| {
            std::fs::metadata(format!("/proc/{pid}/root/dev/shm")).map(|m| {
                use std::os::unix::fs::MetadataExt;
                m.dev()
            })
        };
        let coupler = ranks("ripstop");
        device(&pid.to_string()).ok() != device(&coupler[0].to_string()).ok()
    };
    let elsewhere: Vec<u32> =
        [ranks("flow-solver"), ranks("mesh-mover")].concat().into_iter().filter(far).collect();
    assert_eq!(elsewhere.len(), 2, "one rank of each");
    // With the structure stopped, all other programs wait for it.
    let stopped = ranks("structure-solver");
    stopped.iter().for_each(|&pid| signal(pid, Signal::STOP));
    // A thousand polls per second of the MPI queues.
    asleep(&elsewhere, 0.05, Duration::from_secs(30));
    stopped.iter().for_each(|&pid| signal(pid, Signal::CONT));

    let killed = elsewhere[0];
    signal(killed, Signal::KILL);
    let limit = Limit::new(Duration::from_secs(30));
    let status = loop {
        if let Some(status) = run.try_wait().expect("it can be waited for") {
            break status;
        }
        limit.demand("the run continues");
        std::thread::sleep(Duration::from_millis(20));
    };
    let text = errors_of(&mut run);
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(text.contains("flow"), "{text}");
    assert!(!text.contains("left on host far"), "{text}");
    assert!(processes_naming(&mark).is_empty(), "{:?}", processes_naming(&mark));
}
