//! Sessions of real processes: deaths, remaining files, sleep.
//!
//! The processes are this test program again, started to run only the "test" `as_child`, which does nothing without
//! its environment variable.

mod common;

use std::os::unix::fs::MetadataExt;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use case::Role::{self, Flow, Mesh, Structure};
use channel::{Hub, HubError, RankId};
use common::*;
use rustix::process::{Pid, Signal, kill_process};

const CHILD_ARGUMENTS: &str = "RIPSTOP_TEST_CHILD";

/// Action of a child process.
#[test]
fn as_child() {
    let Ok(line) = std::env::var(CHILD_ARGUMENTS) else { return };
    let words: Vec<&str> = line.split(' ').collect();
    let number = |i: usize| words[i].parse::<usize>().expect("a number");
    let session = words[0];
    let code = if words[1] == "coupler" {
        let mut hub = open(options(session, &[(Structure, number(2)), (Flow, 1)])).expect("a handshake");
        println!("ready");
        let mut k = 0;
        loop {
            for role in [Structure, Flow] {
                hub.advance(role, &window(0, k), &mut |x| x.fill(1.0)).expect("sent");
                hub.collect(role, &mut |_, _| {}, &mut || Ok(())).expect("an answer");
            }
            k += 1;
        }
    } else if words[1] == "builder" {
        let line = format!("x --scene s --stage 0 --session {session} --out o --ranks 1");
        let args = channel::ProgramArgs::from_words(line.split(' ')).expect("fine");
        args.watch_coupler();
        println!("watching");
        sleep(Duration::from_secs(3600));
        0
    } else {
        let role = Role::ALL.into_iter().find(|r| r.name() == words[1]).expect("a role");
        let trouble = match words[4] {
            "stall" => Trouble::Stall(number(5) as u32),
            "exit" => Trouble::Exit(number(5) as u32),
            _ => Trouble::None,
        };
        let mut at = at(session, role, number(2), number(3));
        at.exit_when_orphaned = true;
        let mut fake = Fake::new(role, number(2), number(3)).with(trouble);
        match channel::serve(&mut fake, &at) {
            Ok(_) => 0,
            Err(e) => {
                eprintln!("{e}");
                1
            }
        }
    };
    std::process::exit(code);
}

/// A process that is killed at the end of the test in any case.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Process {
    fn start(line: &str) -> Self {
        let program = std::env::current_exe().expect("this program");
        let child = Command::new(program)
            .args(["as_child", "--exact", "--nocapture"])
            .env(CHILD_ARGUMENTS, line)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        Self(child.expect("a process"))
    }

    fn participant(session: &str, role: Role, rank: usize, ranks: usize, trouble: &str) -> Self {
        Self::start(&format!("{session} {} {rank} {ranks} {trouble}", role.name()))
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).expect("a child that has not been waited for");
    }

    /// Stops it with SIGSTOP, and waits until it has stopped.
    fn freeze(&self) {
        self.signal(Signal::STOP);
        while self.stat()[0] != "T" {
            sleep(Duration::from_millis(1));
        }
    }

    /// Fields of `/proc/PID/stat` from the state on.
    fn stat(&self) -> Vec<String> {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id())).expect("it lives");
        stat.rsplit(')').next().expect("a name").split_whitespace().map(String::from).collect()
    }

    /// Waits until it has printed a line that contains `words`.
    fn expected(&mut self, words: &str) {
        let mut out = std::io::BufReader::new(self.0.stdout.take().expect("piped"));
        let reported =
            std::io::BufRead::lines(&mut out).map_while(Result::ok).any(|line| line.contains(words));
        assert!(reported, "it ended without saying {words:?}");
        // A pipe without a reader would end it.
        self.0.stdout = Some(out.into_inner());
    }

    /// Exit code and what it wrote to standard error.
    fn end(&mut self, limit: Duration) -> (Option<i32>, String) {
        let limit = Limit::new(limit);
        let status = loop {
            if let Some(status) = self.0.try_wait().expect("a child") {
                break status;
            }
            limit.demand("still there");
            sleep(Duration::from_millis(10));
        };
        let mut text = String::new();
        let errors = self.0.stderr.take().expect("piped");
        std::io::Read::read_to_string(&mut { errors }, &mut text).expect("text");
        (status.code(), text)
    }

    /// Processor time used so far, ticks of 10 ms.
    fn ticks(&self) -> u64 {
        let stat = self.stat();
        stat[11].parse::<u64>().expect("utime") + stat[12].parse::<u64>().expect("stime")
    }
}

const SECONDS: Duration = Duration::from_secs(5);

fn request(hub: &mut Hub, k: u64) -> Result<Vec<f64>, HubError> {
    hub.advance(Structure, &window(0, k), &mut |x| x.fill(1.0))?;
    gather(hub, Structure)
}

#[test]
fn processes_run_a_session_privately_and_sleep_while_waiting() {
    let session = name("process");
    let roles = [(Structure, 2), (Mesh, 2), (Flow, 2)];
    let mut processes = Vec::new();
    for (role, n) in roles {
        for rank in 0..n {
            processes.push(Process::participant(&session, role, rank, n, "none"));
        }
    }
    let mut hub = open(options(&session, &roles)).expect("a handshake");
    for k in 0..3 {
        for (role, _) in roles {
            hub.advance(role, &window(0, k), &mut |x| x.fill(1.0)).expect("sent");
            if role == Mesh {
                hub.collect(role, &mut |_, _| {}, &mut time_limit()).expect("an answer");
            } else {
                gather(&mut hub, role).expect("an answer");
            }
        }
    }

    // Readable by the owner alone.
    let mut paths = channel::session_files(&session).expect("a name");
    assert!(paths.len() > 20, "{paths:?}");
    while let Some(path) = paths.pop() {
        let found = std::fs::symlink_metadata(&path).expect("there");
        assert_eq!(found.mode() & 0o077, 0, "{} has mode {:o}", path.display(), found.mode());
        if found.file_type().is_dir() {
            break; // Files below a private folder are private.
        }
    }

    // All ranks and programs wait now, as long as a process that does not sleep would need to use a second.
    let before: Vec<u64> = processes.iter().map(Process::ticks).collect();
    let _ = Limit::new(Duration::from_secs(1)).until(Duration::from_millis(50), || false);
    let after: Vec<u64> = processes.iter().map(Process::ticks).collect();
    for (before, after) in before.iter().zip(&after) {
        // One tick is 1 % of the second: five polls of the coupler a second need far less.
        assert!(after - before <= 1, "{before:?} {after:?}");
    }

    let worked = hub.accept(&window(0, 2), &mut time_limit()).expect("accepted");
    assert_eq!(worked.iter().map(|(role, _)| *role).collect::<Vec<_>>(), roles.map(|r| r.0));
    assert!(worked.iter().all(|(_, busy_s)| *busy_s >= ACCEPTANCE.as_secs_f64()), "{worked:?}");
    hub.stop(&mut time_limit()).expect("stopped");
    for process in &mut processes {
        assert_eq!(process.end(SECONDS), (Some(0), String::new()));
    }
    assert_eq!(leftovers(&session), Vec::<String>::new());
}

#[test]
fn killed_participant_is_named_and_all_others_end() {
    for (how, trouble) in [("kill", "none"), ("exit", "exit 2")] {
        let session = name("killed");
        let mut processes = [
            Process::participant(&session, Structure, 0, 2, "none"),
            Process::participant(&session, Structure, 1, 2, trouble),
            Process::participant(&session, Flow, 0, 1, "none"),
        ];
        let mut hub = open(options(&session, &[(Structure, 2), (Flow, 1)])).expect("a handshake");
        request(&mut hub, 0).expect("an answer");
        request(&mut hub, 1).expect("an answer");
        if how == "kill" {
            processes[1].freeze();
            hub.advance(Structure, &window(0, 2), &mut |x| x.fill(1.0)).expect("sent");
            processes[1].signal(Signal::KILL);
        } else {
            hub.advance(Structure, &window(0, 2), &mut |x| x.fill(1.0)).expect("sent");
        }
        let limit = Limit::new(Duration::from_secs(1));
        let error = gather(&mut hub, Structure).expect_err("it died");
        limit.demand("its death was noticed late");
        let HubError::Died { who, during } = &error else { panic!("{error}") };
        assert_eq!(*who, RankId { role: Structure, rank: 1 });
        assert!(during.contains("window 0 iteration 2"), "{during}");
        drop(hub);
        for other in [0, 2] {
            let (code, text) = processes[other].end(SECONDS);
            assert_eq!(code, Some(1));
            assert!(text.contains("structure-solver (rank 1) died in window 0 iteration 2"), "{text}");
        }
        processes[1].end(SECONDS);
        channel::cleanup(&session).expect("all have ended");
        assert_eq!(leftovers(&session), Vec::<String>::new());
    }
}

#[test]
fn participant_that_dies_during_the_arrival_of_others_is_named() {
    let session = name("early");
    let mut hub = Hub::create(options(&session, &[(Structure, 1), (Flow, 1)])).expect("open");
    let process = Process::participant(&session, Structure, 0, 1, "none");
    let mut time_limit = time_limit();
    let error = hub.await_participants(&mut |arrivals| {
        if let [(who, program)] = &arrivals.arrived[..] {
            assert_eq!((who.role, program.as_str()), (Structure, "fake-structure 0.0.1"));
            process.signal(Signal::KILL);
        }
        time_limit()
    });
    let HubError::Died { who, .. } = error.expect_err("it died") else { panic!("another error") };
    assert_eq!(who, RankId { role: Structure, rank: 0 });
}

#[test]
fn stopped_process_exceeds_its_deadline() {
    let session = name("sigstop");
    let process = Process::participant(&session, Structure, 0, 1, "none");
    let mut options = options(&session, &[(Structure, 1)]);
    options.roles[0].deadline = Some(deadline(Duration::from_millis(500)));
    let mut hub = open(options).expect("a handshake");
    request(&mut hub, 0).expect("an answer");
    process.freeze();
    let error = request(&mut hub, 1).expect_err("a deadline");
    assert!(matches!(error, HubError::Deadline { .. }), "{error}");
    drop(hub);
    drop(process);
    channel::cleanup(&session).expect("all have ended");
    assert_eq!(leftovers(&session), Vec::<String>::new());
}

#[test]
fn killed_coupler_is_noticed_by_ranks_that_wait_compute_or_start() {
    let session = name("orphans");
    let mut coupler = Process::start(&format!("{session} coupler 2"));
    let mut waiting = Process::participant(&session, Structure, 0, 2, "none");
    let mut computing = Process::participant(&session, Structure, 1, 2, "stall 3");
    let mut idle = Process::participant(&session, Flow, 0, 1, "none");
    coupler.expected("ready");
    let mut building = Process::start(&format!("{session} builder"));
    building.expected("watching");
    computing.expected("stalled");
    coupler.signal(Signal::KILL);
    coupler.end(SECONDS);
    let limit = Limit::new(Duration::from_secs(1));
    // A new run of the same name waits until the orphans have ended.
    let next = {
        let session = session.clone();
        std::thread::spawn(move || Hub::create(options(&session, &[(Structure, 1)])).map(drop))
    };
    for process in [&mut waiting, &mut idle] {
        let (code, text) = process.end(SECONDS);
        assert_eq!(code, Some(1));
        assert!(
            text.contains("the coupler of session") && text.contains("died in window 0 iteration"),
            "{text}"
        );
    }
    limit.demand("the coupler's death was noticed late");
    for process in [&mut computing, &mut building] {
        let (code, text) = process.end(SECONDS);
        assert_eq!(code, Some(70), "{text}");
        assert!(text.contains("during its computation"), "{text}");
    }
    next.join().expect("no panic").expect("it may begin");

    let again = spawn(&session, Fake::new(Structure, 0, 1));
    let mut hub = open(options(&session, &[(Structure, 1)])).expect("a handshake");
    request(&mut hub, 0).expect("an answer");
    hub.stop(&mut time_limit()).expect("stopped");
    assert!(again.join().expect("no panic").is_ok());
    assert_eq!(leftovers(&session), Vec::<String>::new());
}

#[test]
fn sessions_killed_repeatedly_are_cleaned_up() {
    let session = name("killed-at-once");
    for round in 0..6 {
        let mut processes = vec![Process::start(&format!("{session} coupler 1"))];
        processes.push(Process::participant(&session, Structure, 0, 1, "none"));
        processes.push(Process::participant(&session, Flow, 0, 1, "none"));
        // Also during the handshake.
        sleep(Duration::from_millis(5 + 40 * round));
        processes.iter().for_each(|p| p.signal(Signal::KILL));
        processes.iter_mut().for_each(|p| drop(p.end(SECONDS)));
    }
    // On a busy machine none of them may have reached the session: one more that certainly has.
    let mut coupler = Process::start(&format!("{session} coupler 1"));
    let mut others = [Structure, Flow].map(|role| Process::participant(&session, role, 0, 1, "none"));
    coupler.expected("ready");
    // Checked while it lives: after its death any other session that opens during this test may clean it up.
    assert!(!leftovers(&session).is_empty(), "a session without files");
    [&coupler, &others[0], &others[1]].into_iter().for_each(|p| p.signal(Signal::KILL));
    coupler.end(SECONDS);
    others.iter_mut().for_each(|p| drop(p.end(SECONDS)));
    // An unrelated live session is not touched by the cleanup.
    let other = name("bystander");
    let served = spawn(&other, Fake::new(Structure, 0, 1));
    let mut hub = open(options(&other, &[(Structure, 1)])).expect("a handshake");
    channel::cleanup_stale().expect("swept");
    assert_eq!(leftovers(&session), Vec::<String>::new());
    request(&mut hub, 0).expect("still there");
    hub.stop(&mut time_limit()).expect("stopped");
    assert!(served.join().expect("no panic").is_ok());
}
