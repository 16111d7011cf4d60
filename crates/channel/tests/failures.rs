//! Failures are reported to all sides, with the failing rank.

mod common;

use std::time::Duration;

use case::Role::{self, Flow, Mesh, Structure};
use channel::{Abort, Hub, HubError, HubOptions, Interface, RankId, ServeError};
use common::*;

/// Two ranks of the structure, the second with an injected error; returns the errors of both sides.
fn trouble(trouble: Trouble) -> (HubError, Vec<ServeError>) {
    let roles = [(Structure, 2), (Flow, 1)];
    let session = name("trouble");
    let threads = vec![
        spawn(&session, Fake::new(Structure, 0, 2)),
        spawn(&session, Fake::new(Structure, 1, 2).with(trouble)),
        spawn(&session, Fake::new(Flow, 0, 1)),
    ];
    let mut hub = open(options(&session, &roles)).expect("a handshake");
    for iteration in 0.. {
        let w = window(7, iteration);
        hub.advance(Structure, &w, &mut |x| x.fill(1.0)).expect("sent");
        if let Err(e) = gather(&mut hub, Structure) {
            drop(hub);
            let ends = threads.into_iter().map(|t| t.join().expect("no panic").expect_err("a failure"));
            let ends = ends.collect();
            channel::cleanup(&session).expect("all have ended");
            assert!(leftovers(&session).is_empty());
            return (e, ends);
        }
        hub.advance(Flow, &w, &mut |_| {}).expect("sent");
        gather(&mut hub, Flow).expect("an answer");
    }
    unreachable!("a fault comes")
}

fn check_trouble(kind: Trouble, iteration: u32, words: &[&str]) {
    let (error, ends) = trouble(kind);
    let HubError::Fault { who, during, .. } = &error else { panic!("{error}") };
    assert_eq!(*who, RankId { role: Structure, rank: 1 });
    assert!(during.contains(&format!("window 7 iteration {iteration} ")), "{during}");
    for word in words {
        assert!(error.to_string().contains(word), "{error} lacks {word}");
    }
    assert!(matches!(&ends[1], ServeError::Fault { .. }), "{}", ends[1]);
    for end in [&ends[0], &ends[2]] {
        let ServeError::Aborted { message, .. } = end else { panic!("{end}") };
        assert_eq!(*message, error.to_string(), "all participants receive the same message");
    }
}

#[test]
fn fault_names_rank_and_window() {
    check_trouble(Trouble::Fault(2), 2, &["structure-solver (rank 1)", "injected fault"]);
}

#[test]
fn panic_is_reported_as_a_fault() {
    check_trouble(Trouble::Panic(0), 0, &["panic: injected panic"]);
}

#[test]
fn nan_is_detected_before_it_is_sent() {
    // Rank 1 of 2 has the odd rows, highest first: its second row is 31.
    check_trouble(Trouble::Nan(1), 1, &["component 1 of output row 31 is NaN"]);
    check_trouble(Trouble::Unwritten(0), 0, &["component 0 of output row 33 is NaN"]);
}

/// Starts `fakes` in a session that will reject them.
fn refusal(options: HubOptions, fakes: Vec<Fake>) -> String {
    let session = options.session.clone();
    let threads: Vec<_> = fakes.into_iter().map(|fake| spawn(&session, fake)).collect();
    let error = open(options).err().expect("refused");
    let HubError::Refused { message } = &error else { panic!("{error}") };
    for thread in threads {
        let end = thread.join().expect("no panic").expect_err("refused");
        let ServeError::Refused { message: received } = &end else { panic!("{end}") };
        assert_eq!(received, message);
    }
    channel::cleanup(&session).expect("all have ended");
    assert!(leftovers(&session).is_empty());
    error.to_string()
}

#[test]
fn mismatches_are_rejected_naming_both_sides() {
    type Change = fn(&mut Fake);
    let cases: [(Change, &[&str]); 7] = [
        (
            |f| f.announcement.canopy_nodes = 36,
            &["35 nodes", "36 nodes", "structure-solver (rank 0)", "flow-solver (rank 0)"],
        ),
        (|f| f.announcement.surface_hash = 5, &["canopies differ", "hash 0000000000000005"]),
        (
            |f| f.announcement.grid_nodes = 100,
            &["flow grids differ", "101", "100", "flow-solver (rank 0)", "mesh-mover (rank 0)"],
        ),
        (|f| f.announcement.output_width = 3, &["output width 3", "expects 4", "docs/reference/contract.md"]),
        (|f| f.announcement.role = "mesh".into(), &["role mesh", "expects flow"]),
        (|f| f.announcement.effects.clear(), &["`fabric.wrinkling`", "fake-flow 0.0.1", "none"]),
        (|f| f.announcement.canopy_faces = 1, &["canopies differ", "1 faces"]),
    ];
    for (change, words) in cases {
        let session = name("misfit");
        let mut options = options(&session, &[(Structure, 1), (Flow, 1), (Mesh, 1)]);
        options.roles[1].effects = vec!["fabric.wrinkling".into()];
        let mut fakes: Vec<Fake> = [Structure, Flow, Mesh].map(|role| Fake::new(role, 0, 1)).into();
        change(&mut fakes[1]);
        let message = refusal(options, fakes);
        for word in words {
            assert!(message.contains(word), "{message} lacks {word}");
        }
    }
}

#[test]
fn scene_of_the_coupler_is_checked_too() {
    let known = Interface { nodes: 35, faces: 24, surface_hash: 1 };
    let session = name("known");
    let with = HubOptions { interface: Some(known), ..options(&session, &[(Structure, 1)]) };
    let message = refusal(with, vec![Fake::new(Structure, 0, 1)]);
    assert!(message.contains("the coupler (from the scene)"), "{message}");

    let session = name("stage");
    let other = HubOptions { stage: 3, ..options(&session, &[(Structure, 1)]) };
    let message = refusal(other, vec![Fake::new(Structure, 0, 1)]);
    assert!(message.contains("stage 0") && message.contains("expects 3"), "{message}");
}

#[test]
fn rank_counts_must_agree() {
    let session = name("ranks");
    // The coupler expects one rank, the program was started with two.
    let mut hub = Hub::create(options(&session, &[(Structure, 1)])).expect("open");
    let second = spawn(&session, Fake::new(Structure, 1, 2)).join().expect("no panic");
    let end = second.expect_err("refused").to_string();
    assert!(end.contains("1 ranks") && end.contains("rank 1 of 2"), "{end}");
    let first = spawn(&session, Fake::new(Structure, 0, 2));
    let mut time_limit = time_limit();
    let error = hub.await_participants(&mut |_| time_limit()).expect_err("refused").to_string();
    assert!(error.contains("rank count 2") && error.contains("expects 1"), "{error}");
    drop(hub);
    assert!(first.join().expect("no panic").is_err());
}

#[test]
fn layout_must_cover_each_row_once() {
    // Two ranks that both claim the rows of rank 0 of 2.
    struct Twin(Fake);
    impl channel::Participant for Twin {
        fn announce(&self) -> channel::Announcement {
            self.0.announce()
        }
        fn output_rows(&self) -> Vec<u64> {
            rows(Structure, 0, 2)
        }
        fn advance(
            &mut self,
            w: &channel::Window,
            input: &channel::Input<'_>,
            output: &mut [f64],
        ) -> Result<channel::Stats, channel::Fault> {
            self.0.advance(w, input, output)
        }
        fn accept(&mut self, w: &channel::Window) -> Result<(), channel::Fault> {
            self.0.accept(w)
        }
        fn save(&mut self, folder: &std::path::Path) -> Result<(), channel::Fault> {
            self.0.save(folder)
        }
        fn snapshot(&mut self, time: f64, folder: &std::path::Path) -> Result<(), channel::Fault> {
            self.0.snapshot(time, folder)
        }
    }
    let session = name("twins");
    let threads: Vec<_> = (0..2)
        .map(|rank| {
            let at = at(&session, Structure, rank, 2);
            std::thread::spawn(move || channel::serve(&mut Twin(Fake::new(Structure, rank, 2)), &at))
        })
        .collect();
    let error = open(options(&session, &[(Structure, 2)])).err().expect("refused").to_string();
    assert!(error.contains("output row 34 is on rank 1 and on rank 0"), "{error}");
    threads.into_iter().for_each(|t| assert!(t.join().expect("no panic").is_err()));
}

#[test]
fn second_start_of_a_program_is_rejected_without_side_effects() {
    let session = name("twice");
    let first = spawn(&session, Fake::new(Structure, 0, 1));
    let mut hub = open(options(&session, &[(Structure, 1)])).expect("a handshake");
    let second = spawn(&session, Fake::new(Structure, 0, 1)).join().expect("no panic").expect_err("refused");
    assert!(second.to_string().contains("started twice"), "{second}");
    hub.advance(Structure, &window(0, 0), &mut |x| x.fill(1.0)).expect("sent");
    gather(&mut hub, Structure).expect("an answer");
    hub.stop(&mut time_limit()).expect("stopped");
    assert!(first.join().expect("no panic").is_ok());
}

#[test]
fn waits_are_bounded() {
    // No coupler.
    let session = name("alone");
    let mut at = at(&session, Flow, 0, 1);
    at.deadline = Some(deadline(Duration::from_millis(150)));
    let end = spawn_at(at.clone(), Fake::new(Flow, 0, 1)).join().expect("no panic").expect_err("alone");
    assert!(matches!(end, ServeError::NoCoupler { .. }), "{end}");

    // No participant.
    let mut lonely = options(&session, &[(Flow, 1), (Mesh, 2)]);
    lonely.arrival_deadline = Some(deadline(Duration::from_millis(250)));
    let mut calls = 0;
    let mut hub = Hub::create(lonely.clone()).expect("open");
    let error = hub.await_participants(&mut |arrivals| {
        calls += 1;
        assert_eq!((arrivals.arrived.len(), arrivals.missing.len()), (0, 3));
        Ok(())
    });
    assert!(matches!(error, Err(HubError::Deadline { who: RankId { role: Flow, rank: 0 }, .. })));
    assert!(calls >= 3, "{calls} calls");
    drop(hub);

    // The caller aborts.
    let mut hub = Hub::create(lonely).expect("open again");
    let error = hub.await_participants(&mut |_| Err(Abort::new("Ctrl-C"))).expect_err("aborted");
    assert_eq!(error.to_string(), "Ctrl-C");
    drop(hub);

    // A coupler that sends nothing.
    let served = spawn_at(at, Fake::new(Flow, 0, 1));
    let hub = open(options(&session, &[(Flow, 1)])).expect("a handshake");
    let end = served.join().expect("no panic").expect_err("silence");
    assert!(matches!(end, ServeError::Deadline { .. }), "{end}");
    drop(hub);
    assert!(leftovers(&session).is_empty());
}

#[test]
fn stalled_participant_exceeds_its_deadline_while_the_caller_is_polled() {
    let session = name("stall");
    let roles = [(Structure, 2)];
    let mut options = options(&session, &roles);
    let answer_limit = deadline(Duration::from_millis(400));
    options.roles[0].deadline = Some(answer_limit);
    let good = spawn(&session, Fake::new(Structure, 0, 2));
    let _never = spawn(&session, Fake::new(Structure, 1, 2).with(Trouble::Stall(1)));
    let mut hub = open(options).expect("a handshake");
    hub.advance(Structure, &window(0, 0), &mut |x| x.fill(1.0)).expect("sent");
    gather(&mut hub, Structure).expect("an answer");
    hub.advance(Structure, &window(0, 1), &mut |x| x.fill(1.0)).expect("sent");
    let limit = Limit::new(answer_limit + Duration::from_millis(1600));
    let (available, mut last, mut gap) = (Available::new(), Duration::ZERO, Duration::ZERO);
    let mut on_wait = || {
        gap = gap.max(available.elapsed() - last);
        last = available.elapsed();
        Ok(())
    };
    let error = hub.collect(Structure, &mut |_, _| {}, &mut on_wait).expect_err("a deadline");
    let HubError::Deadline { who: RankId { role: Structure, rank: 1 }, during, .. } = &error else {
        panic!("{error}")
    };
    assert!(during.contains("window 0 iteration 1"), "{during}");
    limit.demand("the deadline was met late");
    // The documented limit is 50 ms.
    assert!(gap < Duration::from_millis(200), "{gap:?} between two calls");
    drop(hub);
    assert!(good.join().expect("no panic").is_err());
}

#[test]
fn coupler_cannot_violate_the_order_of_calls() {
    let session = name("order");
    let roles = [(Structure, 1), (Flow, 1)];
    let run = |steps: &dyn Fn(&mut Hub) -> Result<(), HubError>| {
        let threads = spawn_all(&session, &roles);
        let mut hub = open(options(&session, &roles)).expect("a handshake");
        let error = steps(&mut hub).expect_err("refused");
        assert!(matches!(error, HubError::Misuse(_)), "{error}");
        drop(hub);
        for thread in threads {
            let end = thread.join().expect("no panic").expect_err("aborted");
            assert!(matches!(end, ServeError::Aborted { .. }), "{end}");
        }
        channel::cleanup(&session).expect("all have ended");
        error.to_string()
    };
    let request =
        |hub: &mut Hub, role: Role, i: u64, k: u64| hub.advance(role, &window(i, k), &mut |x| x.fill(1.0));

    let message = run(&|hub| hub.collect(Structure, &mut |_, _| {}, &mut time_limit()).map(drop));
    assert!(message.contains("structure-solver was collected without a request"), "{message}");
    let message = run(&|hub| request(hub, Structure, 0, 0).and_then(|()| request(hub, Structure, 0, 1)));
    assert!(message.contains("while it works on window 0 iteration 0"), "{message}");
    let message = run(&|hub| hub.accept(&window(0, 0), &mut time_limit()).map(|_| ()));
    assert!(message.contains("no program computed it"), "{message}");
    let message = run(&|hub| {
        request(hub, Structure, 0, 0)?;
        gather(hub, Structure)?;
        request(hub, Structure, 1, 0)
    });
    assert!(message.contains("before window 0 was accepted"), "{message}");
    let message = run(&|hub| request(hub, Mesh, 0, 0));
    assert!(message.contains("has no mesh-mover"), "{message}");
    let message = run(&|hub| hub.advance(Structure, &window(2, 0), &mut |x| x[..9].fill(0.0)));
    assert!(message.contains("component 1 of row 1 of the input of structure-solver"), "{message}");
    assert!(message.contains("window 2 iteration 0"), "{message}");
}

#[test]
fn decreasing_iterations_are_rejected() {
    let session = name("back");
    let threads = spawn_all(&session, &[(Flow, 1)]);
    let mut hub = open(options(&session, &[(Flow, 1)])).expect("a handshake");
    hub.advance(Flow, &window(3, 2), &mut |_| {}).expect("sent");
    gather(&mut hub, Flow).expect("an answer");
    hub.advance(Flow, &window(3, 2), &mut |_| {}).expect("sent");
    let error = gather(&mut hub, Flow).expect_err("refused").to_string();
    assert!(error.contains("window 3 iteration 2 after window 3 iteration 2"), "{error}");
    drop(hub);
    let end = threads.into_iter().next().expect("one").join().expect("no panic").expect_err("refused");
    assert!(matches!(end, ServeError::Contract { .. }), "{end}");
}

#[test]
fn program_that_cannot_start_reports_its_fault() {
    let session = name("report");
    let mut hub = Hub::create(options(&session, &[(Mesh, 1)])).expect("open");
    let at = at(&session, Mesh, 0, 1);
    let thread = std::thread::spawn(move || channel::report(&at, &channel::Fault::new("cell 7 is inverted")));
    let mut time_limit = time_limit();
    let error = hub.await_participants(&mut |_| time_limit()).expect_err("a fault").to_string();
    assert!(error.contains("mesh-mover (rank 0)") && error.contains("cell 7 is inverted"), "{error}");
    thread.join().expect("no panic");
    drop(hub);
    assert!(leftovers(&session).is_empty());
    channel::report(&common::at(&session, Mesh, 0, 1), &channel::Fault::new("nobody listens"));
}

#[test]
fn signals_do_not_interrupt_a_wait() {
    extern "C" fn nothing(_: libc::c_int) {}
    // SAFETY: a handler that does nothing, for a signal without other users; without SA_RESTART, so that it
    // interrupts system calls.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = nothing as extern "C" fn(libc::c_int) as usize;
        assert_eq!(libc::sigaction(libc::SIGUSR1, &raw const action, std::ptr::null_mut()), 0);
    }
    let session = name("signals");
    let mut options = options(&session, &[(Structure, 1)]);
    options.roles[0].deadline = Some(deadline(Duration::from_millis(400)));
    let _never = spawn(&session, Fake::new(Structure, 0, 1).with(Trouble::Stall(0)));
    let mut hub = open(options).expect("a handshake");
    hub.advance(Structure, &window(0, 0), &mut |x| x.fill(1.0)).expect("sent");
    // SAFETY: no arguments.
    let waiting = unsafe { libc::pthread_self() };
    let nudge = std::thread::spawn(move || {
        for _ in 0..30 {
            std::thread::sleep(Duration::from_millis(7));
            // SAFETY: the thread waits for this one to end.
            unsafe { libc::pthread_kill(waiting, libc::SIGUSR1) };
        }
    });
    let error = gather(&mut hub, Structure).expect_err("a deadline");
    nudge.join().expect("no panic");
    assert!(matches!(error, HubError::Deadline { .. }), "{error}");
}
