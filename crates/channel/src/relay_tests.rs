//! Ranks on other hosts, simulated by threads that report another memory.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Barrier, Mutex};
use std::thread;

use case::Role::{self, Flow, Mesh, Structure};

use super::common::*;

use crate::serve::serve_from;
use crate::{Hub, HubError, HubOptions, Peers};

type Queue = VecDeque<Vec<f64>>;

/// Messages between the ranks of one program, by sender and receiver.
#[derive(Default)]
struct MessageBoard {
    messages: Mutex<HashMap<(usize, usize), Queue>>,
    numbers: Mutex<HashMap<usize, u64>>,
}

/// One program; `hosts[rank]` is the host of a rank.
fn spawn_on(session: &str, role: Role, hosts: &[u64], trouble: Trouble) -> Vec<Served> {
    let ranks = hosts.len();
    let (board, barrier) = (Arc::new(MessageBoard::default()), Arc::new(Barrier::new(ranks)));
    let start = |(rank, &host): (usize, &u64)| {
        let (at, board, barrier) = (at(session, role, rank, ranks), board.clone(), barrier.clone());
        let last = rank + 1 == ranks;
        thread::spawn(move || {
            let gather = |x: u64| {
                barrier.wait();
                board.numbers.lock().expect("sound").insert(rank, x);
                barrier.wait();
                let all = board.numbers.lock().expect("sound");
                (0..ranks).map(|r| all[&r]).collect()
            };
            let send = |to: usize, x: &[f64]| {
                board.messages.lock().expect("sound").entry((rank, to)).or_default().push_back(x.to_vec());
            };
            let poll =
                |from: usize| board.messages.lock().expect("sound").get_mut(&(from, rank))?.pop_front();
            let peers = Peers { gather: &gather, send: &send, poll: &poll };
            let mut fake = Fake::new(role, rank, ranks).with(if last { trouble } else { Trouble::None });
            serve_from(host, &mut fake, &at, &peers)
        })
    };
    hosts.iter().enumerate().map(start).collect()
}

/// Opens a session, then starts the programs. The session must exist first: otherwise the first rank to see it would
/// be placed on the coupler's host, against the intention of the test.
fn session_of(options: HubOptions, start: impl FnOnce() -> Vec<Served>) -> (Hub, Vec<Served>) {
    let mut hub = Hub::create(options).expect("a session");
    let threads = start();
    let mut time_limit = time_limit();
    hub.await_participants(&mut |_| time_limit()).expect("a handshake");
    (hub, threads)
}

/// All responses that the coupler receives in two windows of three iterations.
fn run_windows(hub: &mut Hub, roles: &[Role]) -> Result<Vec<Vec<f64>>, HubError> {
    let mut responses = Vec::new();
    for index in 4..6 {
        for iteration in 0..3 {
            let w = window(index, iteration);
            for &role in roles {
                hub.advance(role, &w, &mut |x| x.fill(index as f64 + 0.5 * iteration as f64))?;
                match role {
                    Mesh => drop(hub.collect(Mesh, &mut |_, _| {}, &mut time_limit())?),
                    role => responses.push(gather(hub, role)?),
                }
            }
        }
        for (role, busy_s) in hub.accept(&window(index, 2), &mut time_limit())? {
            assert!(busy_s >= ACCEPTANCE.as_secs_f64(), "{role:?}: {busy_s}");
        }
    }
    Ok(responses)
}

#[test]
fn ranks_on_other_hosts_give_the_same_responses() {
    let ranks = [(Structure, 3), (Mesh, 2), (Flow, 4)];
    let roles = ranks.map(|r| r.0);
    let run_on = |hosts: [&[u64]; 3]| {
        let session = name("hosts");
        let spawn = |i: usize| spawn_on(&session, roles[i], hosts[i], Trouble::None);
        let (mut hub, threads) = session_of(options(&session, &ranks), || (0..3).flat_map(spawn).collect());
        let responses = run_windows(&mut hub, &roles).expect("windows");
        let folder = tempfile::tempdir().expect("a folder");
        hub.save(folder.path(), &mut time_limit()).expect("saved");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 9, "each rank has saved");
        hub.stop(&mut time_limit()).expect("stopped");
        for thread in threads {
            assert_eq!(thread.join().expect("no panic").expect("a good end").windows, 2);
        }
        assert_eq!(leftovers(&session), Vec::<String>::new());
        responses
    };
    let near = run_on([&[1, 1, 1], &[1, 1], &[1, 1, 1, 1]]);
    // Two hosts; and three, with two proxies that share three ranks.
    assert_eq!(near, run_on([&[1, 2, 2], &[1, 2], &[1, 2, 2, 2]]));
    assert_eq!(near, run_on([&[1, 3, 1], &[1, 2], &[1, 2, 1, 3]]));
}

#[test]
fn fault_on_another_host_is_reported_with_its_rank() {
    for (trouble, expected) in [
        (Trouble::Fault(1), "injected fault"),
        (Trouble::Panic(1), "injected panic"),
        (Trouble::Nan(1), "component 1 of output row 31 is NaN"),
    ] {
        let session = name("far-fault");
        let ranks = [(Structure, 2)];
        let start = || spawn_on(&session, Structure, &[1, 2], trouble);
        let (mut hub, threads) = session_of(options(&session, &ranks), start);
        let error = run_windows(&mut hub, &[Structure]).expect_err(expected).to_string();
        assert!(error.contains("structure-solver (rank 1)") && error.contains(expected), "{error}");
        drop(hub);
        threads.into_iter().for_each(|t| assert!(t.join().expect("no panic").is_err()));
    }
}
