//! The same checks on 1, 2, 3 and 5 ranks: this test starts itself under `mpirun`.

#[path = "../../../tests/src/harness.rs"]
mod harness;

use std::process::{Command, ExitCode};

use comm::{Comm, Halo, Numbering};

const N: u64 = 23;
const MARK: &str = "RIPSTOP_COMM_TEST_RANKS";

fn main() -> ExitCode {
    if let Ok(ranks) = std::env::var(MARK) {
        checks(&Comm::init(Some(ranks.parse().expect("a number"))).expect("MPI starts"));
        return ExitCode::SUCCESS;
    }
    harness::run(&[
        ("comm_without_mpi", &|| checks(&Comm::solo())),
        ("comm_on_1_rank", &|| on("1")),
        ("comm_on_2_ranks", &|| on("2")),
        ("comm_on_3_ranks", &|| on("3")),
        ("comm_on_5_ranks", &|| on("5")),
    ])
}

fn on(ranks: &str) {
    let program = std::env::current_exe().expect("this test has a path");
    let mut run = Command::new("mpirun");
    let status = comm::mpirun_env(&mut run).args(["-n", ranks]).arg(&program).env(MARK, ranks).status();
    assert!(status.as_ref().is_ok_and(|s| s.success()), "{ranks} ranks: {status:?}");
}

/// A ring of `N` entities dealt out in blocks; each rank reads one neighbour on
/// either side.
fn ring(comm: &Comm) -> Numbering {
    let (rank, size) = (comm.rank() as u64, comm.size() as u64);
    let owner = |g: u64| (0..size).find(|r| g < N * (r + 1) / size).expect("dealt out") as u32;
    let owned: Vec<u64> = (N * rank / size..N * (rank + 1) / size).collect();
    let ghosts = owned
        .iter()
        .flat_map(|g| [(g + 1) % N, (g + N - 1) % N])
        .filter(|&g| owner(g) as u64 != rank)
        .map(|g| (g, owner(g)))
        .collect();
    Numbering::new(owned, ghosts)
}

fn checks(comm: &Comm) {
    halo_exchanges_and_accumulates(comm);
    letters_arrive_in_order(comm);
    reductions(comm);
    set_up_exchanges(comm);
    exchanges_of_slabs(comm);
    comm.barrier();
}

fn halo_exchanges_and_accumulates(comm: &Comm) {
    let numbering = ring(comm);
    let halo = Halo::new(comm, &numbering);

    // Exchange brings every ghost the value of its owner.
    let value = |g: u64, c: usize| (g * 10) as f64 + c as f64;
    let mut x = vec![f64::NAN; halo.n_local() * 3];
    for i in 0..halo.n_owned() {
        (0..3).for_each(|c| x[i * 3 + c] = value(numbering.global[i], c));
    }
    let inner = halo.overlap(&mut x, 3, |x| x[..halo.n_owned() * 3].iter().sum::<f64>());
    assert!(inner.is_finite());
    for i in 0..halo.n_local() {
        (0..3).for_each(|c| assert_eq!(x[i * 3 + c], value(numbering.global[i], c)));
    }

    // Accumulate is its transpose: each entity has two neighbours that add 1.
    let mut y = vec![0f32; halo.n_local()];
    for i in 0..halo.n_owned() {
        let g = numbering.global[i];
        for other in [(g + 1) % N, (g + N - 1) % N] {
            y[numbering.local(other).expect("a neighbour is known")] += 1.0;
        }
    }
    halo.accumulate(&mut y, 1);
    assert!(y[..halo.n_owned()].iter().all(|&v| v == 2.0));
    assert!(y[halo.n_owned()..].iter().all(|&v| v == 0.0));
}

/// Letters come in order, and only to whom they are sent.
fn letters_arrive_in_order(comm: &Comm) {
    let (rank, size) = (comm.rank(), comm.size());
    let (next, last) = ((rank + 1) % size, (rank + size - 1) % size);
    if size > 1 {
        let letters: [Vec<f64>; 3] = [vec![rank as f64; 3], vec![], vec![f64::NEG_INFINITY; 20_000]];
        let wait = |from| loop {
            if let Some(letter) = comm.poll(from) {
                break letter;
            }
            std::thread::yield_now();
        };
        // Long ones may wait for their receiver: in turn.
        for sender in 0..size {
            if sender == rank {
                letters.iter().for_each(|letter| comm.send(next, letter));
            } else if sender == last {
                assert_eq!(wait(last), [last as f64; 3]);
                assert_eq!(wait(last), [0.0; 0]);
                assert_eq!(wait(last), letters[2]);
            }
        }
        comm.barrier();
        assert_eq!(comm.poll(last), None);
    }
}

/// Reductions, short (on the stack) and long.
fn reductions(comm: &Comm) {
    let (rank, size) = (comm.rank(), comm.size());
    let total = (size * (size + 1) / 2) as f64;
    assert_eq!(comm.sum((rank + 1) as f64), total);
    for n in [1, 64, 65, 1000] {
        let mut v = vec![(rank + 1) as f64; n];
        comm.sum_slice(&mut v);
        assert!(v.iter().all(|&s| s == total));
    }
    assert_eq!(comm.max(rank as f64), (size - 1) as f64);
    assert_eq!(comm.min(rank as f64), 0.0);
    assert!(comm.all(true));
    assert!(!comm.all(rank != size - 1));
}

fn set_up_exchanges(comm: &Comm) {
    let (rank, size) = (comm.rank(), comm.size());
    let all = comm.all_gather_var(&vec![rank as u64; rank + 1]);
    let wanted: Vec<u64> = (0..size).flat_map(|r| vec![r as u64; r + 1]).collect();
    assert_eq!(all, wanted);
    let sent: Vec<Vec<u64>> = (0..size).map(|to| vec![(rank * 100 + to) as u64; to]).collect();
    for (from, got) in comm.all_to_all_var(&sent).iter().enumerate() {
        assert_eq!(*got, vec![(from * 100 + rank) as u64; rank]);
    }
}

/// Numbers to the ranks next to this one, to all, and a vector that each rank completes.
fn exchanges_of_slabs(comm: &Comm) {
    let (rank, size) = (comm.rank(), comm.size());
    // Long ones do not fit into a buffer of the library: no rank may wait for another in a circle.
    for n in [3, 20_000] {
        for up in [true, false] {
            let mut received = vec![-1.0; n];
            comm.shift(up, &vec![rank as f64; n], &mut received);
            let from = if up { rank.checked_sub(1) } else { Some(rank + 1).filter(|r| *r < size) };
            assert!(received.iter().all(|x| *x == from.map_or(-1.0, |r| r as f64)), "{up} {received:?}");
        }
    }
    let sent: Vec<i32> = (0..size as i32).map(|to| to + 1).collect();
    let send: Vec<f64> = (0..size).flat_map(|to| vec![(rank * 100 + to) as f64; to + 1]).collect();
    let mut received = vec![-1.0; size * (rank + 1)];
    comm.all_to_all_into(&send, &sent, &mut received, &vec![rank as i32 + 1; size]);
    let wanted: Vec<f64> = (0..size).flat_map(|from| vec![(from * 100 + rank) as f64; rank + 1]).collect();
    assert_eq!(received, wanted);

    let ends: Vec<usize> = (0..size).map(|r| (r + 1) * (r + 2) / 2).collect();
    let mut all = vec![-1.0; ends[size - 1]];
    all[ends[rank] - rank - 1..ends[rank]].fill(rank as f64);
    comm.all_gather_in_place(&mut all, &ends);
    let wanted: Vec<f64> = (0..size).flat_map(|r| vec![r as f64; r + 1]).collect();
    assert_eq!(all, wanted);

    let mut largest = [rank as f64, -(rank as f64)];
    comm.max_slice(&mut largest);
    assert_eq!(largest, [(size - 1) as f64, 0.0]);
}
