//! Microseconds of a reduction and of an exchange between ranks that do nothing else:
//! `mpirun -n RANKS target/release/examples/latency [COUNT]`, after `cargo build --release -p comm --example latency`.

use std::time::Instant;

use comm::{Comm, Halo, Numbering};

/// Values that each rank sends to the one before it.
const VALUES: usize = 100;

fn main() {
    let comm = Comm::init(None).expect("MPI starts");
    let (rank, size) = (comm.rank(), comm.size());
    let of = |rank: usize| (0..VALUES).map(move |i| (rank * VALUES + i) as u64);
    let next = (rank + 1) % size;
    let ghosts = if size == 1 { Vec::new() } else { of(next).map(|g| (g, next as u32)).collect() };
    let halo = Halo::new(&comm, &Numbering::new(of(rank).collect(), ghosts));
    let mut x = vec![1.0; halo.n_local()];
    let count = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(20_000);
    let micros = |call: &mut dyn FnMut()| {
        comm.barrier();
        let start = Instant::now();
        (0..count).for_each(|_| call());
        start.elapsed().as_secs_f64() * 1e6 / f64::from(count)
    };
    let reduction = micros(&mut || {
        comm.sum(1.0);
    });
    let exchange = micros(&mut || halo.exchange(&mut x, 1));
    if comm.is_root() {
        println!("{size} ranks: reduction {reduction:.2} us, exchange {exchange:.2} us");
    }
}
