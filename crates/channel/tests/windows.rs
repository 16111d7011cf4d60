//! A complete session with test participants in threads.

mod common;

use case::Role::{self, Flow, Mesh, Structure};
use common::*;

/// Two windows with iterations; returns all responses that the coupler received.
fn run_windows(roles: &[(Role, usize)]) -> Vec<Vec<f64>> {
    let session = name("run");
    let threads = spawn_all(&session, roles);
    let mut hub = open(options(&session, roles)).expect("a handshake");
    assert_eq!((hub.interface().nodes, hub.interface().faces), (NODES as u64, FACES as u64));
    assert_eq!(hub.announcement(roles[0].0).expect("announced").version, "0.0.1");
    let mut responses = Vec::new();
    for index in 4..6 {
        for iteration in 0..3 {
            let w = window(index, iteration);
            let load = |x: &mut [f64]| x.fill(index as f64 + 0.5 * iteration as f64);
            for &(role, _) in roles {
                hub.advance(role, &w, &mut { load }).expect("sent");
                if role != Mesh {
                    responses.push(gather(&mut hub, role).expect("an answer"));
                } else {
                    let mut rows = 0;
                    let mut count = |r: &[u64], data: &[f64]| {
                        rows += r.len();
                        assert!(data.is_empty(), "the grid does not pass through the coupler");
                    };
                    hub.collect(role, &mut count, &mut time_limit()).expect("an answer");
                    assert_eq!(rows, GRID);
                }
            }
        }
        hub.accept(&window(index, 2), &mut time_limit()).expect("accepted");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let deep = folder.path().join("a/b");
    hub.save(&deep, &mut time_limit()).expect("saved");
    hub.snapshot(&[roles[0].0], 1.5, &deep, &mut time_limit()).expect("pictured");
    let files = std::fs::read_dir(&deep).expect("made").count();
    assert_eq!(files, roles.iter().map(|r| r.1).sum::<usize>() + roles[0].1);
    hub.stop(&mut time_limit()).expect("stopped");
    for thread in threads {
        let end = thread.join().expect("no panic").expect("a good end");
        assert_eq!(end.windows, 2);
    }
    assert_eq!(leftovers(&session), Vec::<String>::new());
    responses
}

#[test]
fn responses_do_not_depend_on_the_rank_count() {
    // Flow outputs depend on which grid nodes a rank reads: one rank of it.
    let one = run_windows(&[(Structure, 1), (Mesh, 1), (Flow, 1)]);
    let many = run_windows(&[(Structure, 3), (Mesh, 2), (Flow, 1)]);
    assert_eq!(one.len(), 12);
    assert_eq!(one, many);
    assert!(one.iter().flatten().all(|x| x.is_finite()));
    // Restarted from the accepted state in each iteration, continued between windows.
    let w = window(5, 0);
    let accepted = mean(&[4.0 + 0.5 * 2.0]) + window(4, 2).time;
    assert_eq!(one[6][0], accepted + 5.0 + w.time);
}

#[test]
fn flow_reads_the_grid_of_the_same_iteration_in_place() {
    let roles = [(Mesh, 3), (Flow, 2)];
    let session = name("grid");
    let threads = spawn_all(&session, &roles);
    let mut hub = open(options(&session, &roles)).expect("a handshake");
    for iteration in 0..4 {
        let w = window(0, iteration);
        let displacement = 0.25 * iteration as f64;
        // The flow is requested first: it waits for the mesh by itself.
        hub.advance(Flow, &w, &mut |x| assert!(x.is_empty())).expect("sent");
        hub.advance(Mesh, &w, &mut |x| x.fill(displacement)).expect("sent");
        let loads = gather(&mut hub, Flow).expect("an answer");
        hub.collect(Mesh, &mut |_, _| {}, &mut time_limit()).expect("an answer");
        for rank in 0..2 {
            let read: Vec<f64> = (0..GRID as u64)
                .filter(|row| row % 2 == rank as u64 || row % 5 == 0)
                .flat_map(|row| (0..6).map(move |c| (row, c)))
                .map(|(row, c)| grid_value(row, c, displacement, &w))
                .collect();
            for face in rows(Flow, rank, 2) {
                let found = loads[face as usize * 4];
                let expected = face as f64 + 1e-3 * mean(&read);
                assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
            }
        }
    }
    // An iteration without a flow solve leaves no stale grid.
    for iteration in [4, 5, 6, 7] {
        hub.advance(Mesh, &window(0, iteration), &mut |x| x.fill(9.0)).expect("sent");
        hub.collect(Mesh, &mut |_, _| {}, &mut time_limit()).expect("an answer");
    }
    hub.advance(Flow, &window(0, 7), &mut |_| {}).expect("sent");
    let loads = gather(&mut hub, Flow).expect("an answer");
    assert!(loads[0] > 1e-3 * 7e5, "read iteration 7");
    hub.accept(&window(0, 7), &mut time_limit()).expect("accepted");
    hub.stop(&mut time_limit()).expect("stopped");
    threads.into_iter().for_each(|t| assert_eq!(t.join().expect("no panic").expect("a good end").windows, 1));
}

/// Memory of earlier messages is used again: a number that is not written is found in any window, never the one of an earlier window.
#[test]
fn number_that_is_not_written_is_found_in_memory_used_again() {
    let roles = [(Structure, 1)];
    let session = name("unwritten");
    let threads = spawn_all(&session, &roles);
    let mut hub = open(options(&session, &roles)).expect("a handshake");
    for iteration in 0..12 {
        hub.advance(Structure, &window(0, iteration), &mut |x| x.fill(1.0)).expect("sent");
        hub.collect(Structure, &mut |_, _| {}, &mut time_limit()).expect("an answer");
    }
    let all_but_one = &mut |x: &mut [f64]| {
        let last = x.len() - 1;
        x[..last].fill(1.0);
    };
    let error =
        hub.advance(Structure, &window(0, 12), all_but_one).expect_err("a number is missing").to_string();
    assert!(error.contains("is NaN") && error.contains("was not written"), "{error}");
    drop(hub);
    threads
        .into_iter()
        .for_each(|t| assert!(t.join().expect("no panic").is_err(), "the end is reported to it"));
}

#[test]
fn coupler_can_watch_the_grid() {
    let roles = [(Mesh, 2)];
    let session = name("watch");
    let threads = spawn_all(&session, &roles);
    let mut hub =
        open(channel::HubOptions { watch_grid: true, ..options(&session, &roles) }).expect("a handshake");
    let w = window(0, 0);
    hub.advance(Mesh, &w, &mut |x| x.fill(2.0)).expect("sent");
    let grid = gather(&mut hub, Mesh).expect("an answer");
    for row in 0..GRID {
        assert_eq!(grid[row * 6 + 3], grid_value(row as u64, 3, mean(&[2.0]), &w));
    }
    hub.stop(&mut time_limit()).expect("stopped");
    end_well(threads);
}

#[test]
fn concurrent_sessions_are_isolated() {
    let roles = [(Structure, 2)];
    let sessions = [name("left"), name("right")];
    let threads: Vec<_> = sessions.iter().flat_map(|s| spawn_all(s, &roles)).collect();
    let mut hubs: Vec<_> = sessions.iter().map(|s| open(options(s, &roles)).expect("a handshake")).collect();
    for (i, hub) in hubs.iter_mut().enumerate() {
        hub.advance(Structure, &window(0, 0), &mut |x| x.fill(100.0 * i as f64)).expect("sent");
    }
    for (i, hub) in hubs.iter_mut().enumerate() {
        assert_eq!(gather(hub, Structure).expect("an answer")[0], 100.0 * i as f64);
    }
    // A third session cannot use the same name.
    let again = channel::Hub::create(options(&sessions[0], &roles)).err().expect("refused");
    assert!(matches!(again, channel::HubError::SessionInUse { .. }), "{again}");
    assert!(channel::cleanup(&sessions[0]).is_err(), "a live session is not removed");
    channel::cleanup_stale().expect("nothing to do");
    for (i, hub) in hubs.iter_mut().enumerate() {
        hub.advance(Structure, &window(0, 1), &mut |x| x.fill(1.0 + i as f64)).expect("still there");
        assert_eq!(gather(hub, Structure).expect("an answer")[0], 1.0 + i as f64);
    }
    hubs.into_iter().for_each(|hub| hub.stop(&mut time_limit()).expect("stopped"));
    end_well(threads);
    sessions.iter().for_each(|s| assert!(leftovers(s).is_empty()));
}
