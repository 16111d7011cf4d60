//! Ranks on other hosts, played by threads that claim to see another memory.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Barrier, Mutex};
use std::thread;

use case::Role::{self, Flow, Mesh, Structure};

use super::common::*;

use crate::serve::serve_from;
use crate::{Hub, HubError, HubOptions, Peers};

type Letters = VecDeque<Vec<f64>>;

/// Messages between the ranks of one program, from and to.
#[derive(Default)]
struct Post {
    letters: Mutex<HashMap<(usize, usize), Letters>>,
    numbers: Mutex<HashMap<usize, u64>>,
}

/// One program; `hosts[rank]` is where its ranks run.
fn spawn_on(session: &str, role: Role, hosts: &[u64], trouble: Trouble) -> Vec<Served> {
    let ranks = hosts.len();
    let (post, barrier) = (Arc::new(Post::default()), Arc::new(Barrier::new(ranks)));
    let start = |(rank, &host): (usize, &u64)| {
        let (at, post, barrier) = (at(session, role, rank, ranks), post.clone(), barrier.clone());
        let last = rank + 1 == ranks;
        thread::spawn(move || {
            let gather = |x: u64| {
                barrier.wait();
                post.numbers.lock().expect("sound").insert(rank, x);
                barrier.wait();
                let all = post.numbers.lock().expect("sound");
                (0..ranks).map(|r| all[&r]).collect()
            };
            let send = |to: usize, x: &[f64]| {
                post.letters.lock().expect("sound").entry((rank, to)).or_default().push_back(x.to_vec());
            };
            let poll = |from: usize| post.letters.lock().expect("sound").get_mut(&(from, rank))?.pop_front();
            let peers = Peers { gather: &gather, send: &send, poll: &poll };
            let mut fake = Fake::new(role, rank, ranks).with(if last { trouble } else { Trouble::None });
            serve_from(host, &mut fake, &at, &peers)
        })
    };
    hosts.iter().enumerate().map(start).collect()
}

/// A session, and the programs that join it. It is there before they look for it: whichever rank saw it first would else
/// be on the coupler's host, whatever the test means.
fn session_of(options: HubOptions, start: impl FnOnce() -> Vec<Served>) -> (Hub, Vec<Served>) {
    let mut hub = Hub::create(options).expect("a session");
    let threads = start();
    let mut patience = patience();
    hub.await_participants(&mut |_| patience()).expect("a handshake");
    (hub, threads)
}

/// All that the coupler sees in two windows of three iterations.
fn fly(hub: &mut Hub, roles: &[Role]) -> Result<Vec<Vec<f64>>, HubError> {
    let mut seen = Vec::new();
    for index in 4..6 {
        for iteration in 0..3 {
            let w = window(index, iteration);
            for &role in roles {
                hub.advance(role, &w, &mut |x| x.fill(index as f64 + 0.5 * iteration as f64))?;
                match role {
                    Mesh => drop(hub.collect(Mesh, &mut |_, _| {}, &mut patience())?),
                    role => seen.push(gather(hub, role)?),
                }
            }
        }
        hub.accept(&window(index, 2), &mut patience())?;
    }
    Ok(seen)
}

#[test]
fn ranks_on_other_hosts_answer_as_if_they_were_here() {
    let ranks = [(Structure, 3), (Mesh, 2), (Flow, 4)];
    let roles = ranks.map(|r| r.0);
    let flown = |hosts: [&[u64]; 3]| {
        let session = name("hosts");
        let spawn = |i: usize| spawn_on(&session, roles[i], hosts[i], Trouble::None);
        let (mut hub, threads) = session_of(options(&session, &ranks), || (0..3).flat_map(spawn).collect());
        let seen = fly(&mut hub, &roles).expect("windows");
        let folder = tempfile::tempdir().expect("a folder");
        hub.save(folder.path(), &mut patience()).expect("saved");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 9, "each rank has saved");
        hub.stop(&mut patience()).expect("stopped");
        for thread in threads {
            assert_eq!(thread.join().expect("no panic").expect("a good end").windows, 2);
        }
        assert_eq!(leftovers(&session), Vec::<String>::new());
        seen
    };
    let near = flown([&[1, 1, 1], &[1, 1], &[1, 1, 1, 1]]);
    // Two hosts; and three, with two keepers that share three ranks.
    assert_eq!(near, flown([&[1, 2, 2], &[1, 2], &[1, 2, 2, 2]]));
    assert_eq!(near, flown([&[1, 3, 1], &[1, 2], &[1, 2, 1, 3]]));
}

#[test]
fn a_fault_on_another_host_is_told_with_its_rank() {
    for (trouble, says) in [
        (Trouble::Fault(1), "the fake has had enough"),
        (Trouble::Panic(1), "the fake panics"),
        (Trouble::Nan(1), "component 1 of output row 31 is NaN"),
    ] {
        let session = name("far-fault");
        let ranks = [(Structure, 2)];
        let start = || spawn_on(&session, Structure, &[1, 2], trouble);
        let (mut hub, threads) = session_of(options(&session, &ranks), start);
        let error = fly(&mut hub, &[Structure]).expect_err(says).to_string();
        assert!(error.contains("structure-solver (rank 1)") && error.contains(says), "{error}");
        drop(hub);
        threads.into_iter().for_each(|t| assert!(t.join().expect("no panic").is_err()));
    }
}
