//! Round trip of a window between two threads: 56 000 x 3 numbers to the participant and back, all of them written
//! and read on both sides; for comparison a Unix socket that copies the same amount, and an empty exchange.
//!
//! `cargo bench -p channel --bench round_trip`

#[path = "../tests/common/mod.rs"]
mod common;

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Instant;

use case::Role;
use channel::{Announcement, Fault, HubOptions, Input, Participant, Stats, Window, serve};
use common::*;

const NODES: usize = 56_000;
const ROUNDS: usize = 400;

/// Returns the displacements doubled. It acts as a mesh recorded by the coupler, so that input and output both have a
/// row for each node.
struct Echo {
    nodes: usize,
}

impl Participant for Echo {
    fn announce(&self) -> Announcement {
        let n = self.nodes as u64;
        Announcement {
            canopy_nodes: n,
            grid_nodes: n.div_ceil(2),
            ..Fake::new(Role::Mesh, 0, 1).announcement
        }
    }
    fn output_rows(&self) -> Vec<u64> {
        (0..self.nodes.div_ceil(2) as u64).collect()
    }
    fn advance(&mut self, _: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        output.iter_mut().zip(input.canopy).for_each(|(out, x)| *out = 2.0 * x);
        Ok(Stats::default())
    }
    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        Ok(())
    }
    fn save(&mut self, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

/// Sum in eight lanes: a chain of additions would cost more than the transport.
fn sum_of(values: impl Iterator<Item = f64>) -> f64 {
    let mut lanes = [0.0; 8];
    values.enumerate().for_each(|(i, x)| lanes[i % 8] += x);
    lanes.iter().sum()
}

fn report(name: &str, mut micros: Vec<f64>) {
    micros.sort_by(f64::total_cmp);
    println!("{name:<44} min {:>7.0} us   median {:>7.0} us", micros[0], micros[micros.len() / 2]);
}

fn channel(nodes: usize) -> Vec<f64> {
    let session = name("bench");
    let at = at(&session, Role::Mesh, 0, 1);
    let served = std::thread::spawn(move || serve(&mut Echo { nodes }, &at));
    let mut hub =
        open(HubOptions { watch_grid: true, ..options(&session, &[(Role::Mesh, 1)]) }).expect("a handshake");
    let (mut sum, mut micros) = (0.0, Vec::new());
    for k in 0..ROUNDS {
        let start = Instant::now();
        hub.advance(Role::Mesh, &window(0, k as u64), &mut |x| x.fill(k as f64)).expect("sent");
        let mut read = |_: &[u64], data: &[f64]| sum += sum_of(data.iter().copied());
        hub.collect(Role::Mesh, &mut read, &mut || Ok(())).expect("an answer");
        micros.push(start.elapsed().as_secs_f64() * 1e6);
    }
    assert_eq!(sum, 2.0 * (ROUNDS * (ROUNDS - 1) / 2 * nodes * 3) as f64);
    hub.stop(&mut || Ok(())).expect("stopped");
    served.join().expect("no panic").expect("a good end");
    micros
}

fn socket(numbers: usize) -> Vec<f64> {
    let (mut here, mut there) = UnixStream::pair().expect("sockets");
    let echo = std::thread::spawn(move || {
        let mut bytes = vec![0; numbers * 8];
        while there.read_exact(&mut bytes).is_ok() {
            for word in bytes.chunks_exact_mut(8) {
                let x = f64::from_le_bytes(word.try_into().expect("eight"));
                word.copy_from_slice(&(2.0 * x).to_le_bytes());
            }
            there.write_all(&bytes).expect("sent");
        }
    });
    let (mut bytes, mut sum, mut micros) = (vec![0; numbers * 8], 0.0, Vec::new());
    for k in 0..ROUNDS {
        let start = Instant::now();
        bytes.chunks_exact_mut(8).for_each(|word| word.copy_from_slice(&(k as f64).to_le_bytes()));
        here.write_all(&bytes).expect("sent");
        here.read_exact(&mut bytes).expect("received");
        sum += sum_of(bytes.chunks_exact(8).map(|w| f64::from_le_bytes(w.try_into().expect("eight"))));
        micros.push(start.elapsed().as_secs_f64() * 1e6);
    }
    assert_eq!(sum, 2.0 * (ROUNDS * (ROUNDS - 1) / 2 * numbers) as f64);
    drop(here);
    echo.join().expect("no panic");
    micros
}

/// The grid link: the mesh writes `GRID` rows of six, the flow reads some of them in place.
struct Connection {
    role: Role,
}

const GRID: usize = 500_000;

impl Participant for Connection {
    fn announce(&self) -> Announcement {
        Announcement { grid_nodes: GRID as u64, ..Fake::new(self.role, 0, 1).announcement }
    }
    fn output_rows(&self) -> Vec<u64> {
        (0..if self.role == Role::Mesh { GRID } else { FACES } as u64).collect()
    }
    fn grid_rows(&self) -> Vec<u64> {
        if self.role == Role::Flow { (0..GRID as u64).collect() } else { Vec::new() }
    }
    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        match self.role {
            Role::Mesh => output.fill(w.iteration as f64),
            _ => output.fill(input.grid.row(GRID - 1)[5]),
        }
        Ok(Stats::default())
    }
    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        Ok(())
    }
    fn save(&mut self, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

/// Times of the mesh (writing the grid) and of the flow (reading it).
fn grid_link() -> [Vec<f64>; 2] {
    let session = name("link");
    let roles = [(Role::Mesh, 1), (Role::Flow, 1)];
    let serve_one = |(role, _): (Role, usize)| {
        let at = at(&session, role, 0, 1);
        std::thread::spawn(move || serve(&mut Connection { role }, &at))
    };
    let served = roles.map(serve_one);
    let mut hub = open(options(&session, &roles)).expect("a handshake");
    let mut micros = [Vec::new(), Vec::new()];
    for k in 0..100 {
        for (i, (role, _)) in roles.into_iter().enumerate() {
            let start = Instant::now();
            hub.advance(role, &window(0, k), &mut |x| x.fill(0.0)).expect("sent");
            let mut read = |_: &[u64], data: &[f64]| assert!(data.iter().all(|&x| x == k as f64));
            hub.collect(role, &mut read, &mut || Ok(())).expect("an answer");
            micros[i].push(start.elapsed().as_secs_f64() * 1e6);
        }
    }
    hub.stop(&mut || Ok(())).expect("stopped");
    served.into_iter().for_each(|s| assert!(s.join().expect("no panic").is_ok()));
    micros
}

fn main() {
    println!("{ROUNDS} round trips, {NODES} x 3 doubles each way (1.3 MB)");
    report("channel, checked for NaN on both sides", channel(NODES));
    report("Unix socket, unchecked", socket(NODES * 3));
    report("channel, 6 doubles", channel(2));
    report("Unix socket, 6 doubles", socket(6));
    let [mesh, flow] = grid_link();
    println!("grid link, {GRID} nodes x 6 doubles (24 MB)");
    report("mesh writes all, checked for NaN", mesh);
    report("flow is requested and reads in place", flow);
}
