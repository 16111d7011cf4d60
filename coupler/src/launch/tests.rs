//! Supervision of small programs that fail, hang and ignore SIGTERM.

use std::ffi::OsString;
use std::path::Path;
use std::time::Duration;

use super::*;

#[path = "../../../tests/src/load.rs"]
mod load;

use case::Role;
use load::Limit;
use terminal::Console;

/// A child writes the file: a descriptor that is open for writing here would be inherited by programs that other tests start at
/// the same time, and starting the script would fail with "text file busy".
fn script(folder: &Path, name: &str, text: &str) -> OsString {
    let file = folder.join(name);
    let write = "printf '#!/bin/sh\n%s\n' \"$1\" > \"$0\" && chmod 755 \"$0\"";
    let written = std::process::Command::new("sh").args(["-c", write]).arg(&file).arg(text).status();
    assert!(written.unwrap().success());
    file.into_os_string()
}

fn program(folder: &Path, role: Role, words: Vec<OsString>) -> Program {
    let log = folder.join("logs").join(format!("{}.log", role.name()));
    Program { role, name: role.program().into(), words, environment: Vec::new(), log, continues: false }
}

fn alive(process: &str) -> bool {
    super::process::read_stat(process.trim().parse().unwrap()).is_some()
}

fn wait_for(condition: impl FnMut() -> bool) {
    let waited = Limit::new(Duration::from_secs(10)).until(Duration::from_millis(10), condition);
    waited.unwrap_or_else(|report| panic!("time limit: {report}"));
}

#[test]
fn failure_is_reported_with_its_cause_and_other_programs_end() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let note = dir.join("sleeper");
    let dies =
        script(dir, "dies", "echo '     0.010 s info  a grid'; echo 'grid file is damaged' >&2; exit 3");
    let sleeps = script(dir, "sleeps", &format!("echo $$ > {}; exec sleep 100", note.display()));
    let programs = vec![program(dir, Role::Structure, vec![sleeps]), program(dir, Role::Flow, vec![dies])];
    let mut supervisor = Supervisor::start(programs, "t1", &Console::new(true)).unwrap();
    let mut failure = None;
    wait_for(|| {
        failure = supervisor.failure();
        failure.is_some()
    });
    let failure = failure.unwrap();
    assert_eq!((failure.role, failure.how.as_str()), (Role::Flow, "exit code 3"));
    assert_eq!(failure.tail, "grid file is damaged");
    wait_for(|| std::fs::read_to_string(&note).is_ok_and(|t| t.ends_with('\n')));
    let sleeper = std::fs::read_to_string(&note).unwrap();
    assert!(alive(&sleeper));
    let limit = Limit::new(Duration::from_secs(2));
    drop(supervisor);
    limit.demand("the sleeper ends after SIGTERM");
    assert!(!alive(&sleeper));
    let log = std::fs::read_to_string(dir.join("logs/flow.log")).unwrap();
    assert!(log.starts_with("$ ") && log.contains("grid file is damaged"), "{log}");
    assert!(log.contains(" info  a grid"), "{log}");
}

#[test]
fn tail_contains_output_since_the_last_request() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let (go, end) = (dir.join("go"), dir.join("end"));
    let wait = |file: &std::path::Path| format!("while [ ! -e {} ]; do sleep 0.02; done", file.display());
    let text = format!("echo early >&2; {}; echo late >&2; {}; exit 4", wait(&go), wait(&end));
    let programs = vec![program(dir, Role::Flow, vec![script(dir, "speaks", &text)])];
    let mut supervisor = Supervisor::start(programs, "t7", &Console::new(true)).unwrap();
    wait_for(|| supervisor.last_line(Role::Flow).is_some());
    assert_eq!(supervisor.last_line(Role::Flow).as_deref(), Some("early"));
    supervisor.mark_request(Role::Flow);
    assert_eq!(supervisor.last_line(Role::Flow), None);
    std::fs::write(&go, "").unwrap();
    wait_for(|| supervisor.last_line(Role::Flow).is_some());
    assert_eq!(supervisor.last_line(Role::Flow).as_deref(), Some("late"));
    std::fs::write(&end, "").unwrap();
    let mut failure = None;
    wait_for(|| {
        failure = supervisor.failure();
        failure.is_some()
    });
    assert_eq!(failure.unwrap().tail, "late");
}

#[test]
fn program_that_ignores_sigterm_is_killed_with_its_children() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let note = dir.join("ranks");
    // Like mpirun: a launcher whose ranks are in groups and sessions of their own.
    let stubborn = script(
        dir,
        "stubborn",
        &format!(
            "trap '' TERM; setsid sh -c \"trap '' TERM; echo \\$\\$ > {}; while :; do sleep 1; done\" & \
             while :; do sleep 1; done",
            note.display()
        ),
    );
    let mut supervisor =
        Supervisor::start(vec![program(dir, Role::Mesh, vec![stubborn])], "t2", &Console::new(true)).unwrap();
    wait_for(|| std::fs::read_to_string(&note).is_ok_and(|t| t.ends_with('\n')));
    let rank = std::fs::read_to_string(&note).unwrap();
    assert!(supervisor.failure().is_none() && alive(&rank));
    let limit = Limit::new(Duration::from_secs(5));
    supervisor.end();
    limit.demand("the rank is killed");
    assert!(!alive(&rank));
}

#[test]
fn orphaned_ranks_are_found_by_session_name() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let note = dir.join("rank");
    let rank = script(dir, "rank.sh", &format!("echo $$ > {}; while :; do sleep 1; done", note.display()));
    let rank = rank.to_string_lossy();
    let launcher = script(dir, "launcher", &format!("setsid {rank} --session t3-orphan & wait"));
    let mut supervisor =
        Supervisor::start(vec![program(dir, Role::Flow, vec![launcher])], "t3-orphan", &Console::new(true))
            .unwrap();
    wait_for(|| std::fs::read_to_string(&note).is_ok_and(|t| t.ends_with('\n')));
    let orphan = std::fs::read_to_string(&note).unwrap();
    super::process::signal(supervisor.first_process(), rustix::process::Signal::KILL);
    let mut failure = None;
    wait_for(|| {
        failure = supervisor.failure();
        failure.is_some()
    });
    assert!(failure.unwrap().how.starts_with("signal 9"));
    assert!(alive(&orphan));
    supervisor.end();
    assert!(!alive(&orphan));
}

#[test]
fn normal_exit_is_no_failure_and_late_exit_is() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let good = script(dir, "good", "exit 0");
    let supervisor =
        Supervisor::start(vec![program(dir, Role::Flow, vec![good])], "t4", &Console::new(true)).unwrap();
    assert_eq!(supervisor.finish(load::deadline(Duration::from_secs(5))), []);
    let late = script(dir, "late", "exec sleep 100");
    let supervisor =
        Supervisor::start(vec![program(dir, Role::Flow, vec![late])], "t5", &Console::new(true)).unwrap();
    let bad = supervisor.finish(Duration::from_millis(100));
    assert_eq!(bad[0].how, "still running");
}

#[test]
fn missing_program_gives_its_path_and_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let missing = program(folder.path(), Role::Flow, vec!["/nowhere/flow".into()]);
    let Err(error) = Supervisor::start(vec![missing], "t6", &Console::new(true)) else { panic!("started") };
    assert_eq!(error.exit_code(), 2);
    let text = error.to_string();
    assert!(text.contains("/nowhere/flow") && text.contains("check the path"), "{text}");
}

#[test]
fn programs_ask_for_large_pages_unless_the_user_set_the_allocator() {
    let set = command::environment(None);
    let asked = set.iter().find(|(name, _)| *name == "GLIBC_TUNABLES").map(|(_, value)| value.to_str());
    let own = std::env::var_os("GLIBC_TUNABLES");
    assert_eq!(asked, own.is_none().then_some(Some("glibc.malloc.hugetlb=1")));
}
