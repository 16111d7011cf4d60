//! The ranks of one program, with the reductions and exchanges they need.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Instant;

use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;

use crate::time_slice;

/// A failure to set up message passing.
#[derive(Debug, thiserror::Error)]
pub enum CommError {
    /// `MPI_Init` failed or was called before.
    #[error("MPI could not be initialised (was it initialised before in this process?)")]
    Init,
    /// The launcher promised another number of ranks than MPI reports.
    #[error(
        "`--ranks` is {expected} but MPI reports {found} ranks: \
         is `mpirun` of the MPI library that the program was built with first on the PATH?"
    )]
    WrongLauncher {
        /// Rank count on the command line.
        expected: usize,
        /// Size of the MPI world.
        found: usize,
    },
}

/// Tag of [`Comm::send`].
const LETTER: i32 = 77;
/// Tag of [`Comm::shift`].
const SHIFT: i32 = 78;

struct World {
    world: SimpleCommunicator,
    /// Seconds spent in reductions and in waiting for exchanges.
    waited: Cell<f64>,
    // Dropped last: `MPI_Finalize` runs when the last `Comm` goes.
    _universe: Universe,
}

/// The ranks of one program. Cheap to clone.
#[derive(Clone)]
pub struct Comm {
    mpi: Option<Rc<World>>,
    rank: usize,
    size: usize,
}

impl std::fmt::Debug for Comm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "rank {} of {}", self.rank, self.size)
    }
}

impl Comm {
    /// Initialises MPI. `expected` is the rank count that the launcher passed:
    /// a wrong `mpirun` silently starts many one-rank worlds, which this catches.
    /// Of several ranks each gets short time slices, because they wait for each other.
    pub fn init(expected: Option<usize>) -> Result<Self, CommError> {
        let universe = mpi::initialize().ok_or(CommError::Init)?;
        let world = universe.world();
        let (rank, size) = (world.rank() as usize, world.size() as usize);
        if let Some(expected) = expected.filter(|&n| n != size) {
            return Err(CommError::WrongLauncher { expected, found: size });
        }
        if size > 1 {
            time_slice::shorten();
        }
        let world = World { world, waited: Cell::new(0.0), _universe: universe };
        Ok(Self { mpi: Some(Rc::new(world)), rank, size })
    }

    /// A world of one rank that needs no MPI.
    pub fn solo() -> Self {
        Self { mpi: None, rank: 0, size: 1 }
    }

    /// This rank, counted from 0.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Number of ranks.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Whether this is rank 0.
    pub fn is_root(&self) -> bool {
        self.rank == 0
    }

    pub(crate) fn world(&self) -> Option<&SimpleCommunicator> {
        self.mpi.as_ref().map(|w| &w.world)
    }

    /// Seconds that this rank has spent in reductions and in exchanges with other
    /// ranks, waiting for them included, since the start.
    pub fn waited_s(&self) -> f64 {
        self.mpi.as_ref().map_or(0.0, |w| w.waited.get())
    }

    pub(crate) fn count(&self, since: Instant) {
        if let Some(w) = &self.mpi {
            w.waited.set(w.waited.get() + since.elapsed().as_secs_f64());
        }
    }

    fn reduce<T: Equivalence + Copy>(&self, values: &mut [T], op: SystemOperation) {
        if self.size == 1 {
            return;
        }
        if let Some(world) = self.world() {
            let start = Instant::now();
            // Dot products and norms are the common case and must not allocate.
            let n = values.len();
            match values.first().copied() {
                None => {}
                Some(first) if n <= 64 => {
                    let mut send = [first; 64];
                    send[..n].copy_from_slice(values);
                    world.all_reduce_into(&send[..n], values, op);
                }
                Some(_) => {
                    let send = values.to_vec();
                    world.all_reduce_into(&send[..], values, op);
                }
            }
            self.count(start);
        }
    }

    /// Sum over ranks. The order of summation is fixed for a given rank count.
    pub fn sum(&self, x: f64) -> f64 {
        let mut v = [x];
        self.reduce(&mut v, SystemOperation::sum());
        v[0]
    }

    /// Sums each entry over ranks, in place.
    pub fn sum_slice(&self, x: &mut [f64]) {
        self.reduce(x, SystemOperation::sum());
    }

    /// Sums each integer entry over ranks, in place.
    pub fn sum_u64(&self, x: &mut [u64]) {
        self.reduce(x, SystemOperation::sum());
    }

    /// Maximum over ranks. A NaN on any rank is not guaranteed to survive:
    /// check with [`Comm::all`] first where it matters.
    pub fn max(&self, x: f64) -> f64 {
        let mut v = [x];
        self.reduce(&mut v, SystemOperation::max());
        v[0]
    }

    /// Maximum of each entry over ranks, in place.
    pub fn max_slice(&self, x: &mut [f64]) {
        self.reduce(x, SystemOperation::max());
    }

    /// The largest value over ranks with its place: `place` of the first rank that has it. Zeros where all are NaN.
    pub fn max_with_place(&self, x: f64, place: [f64; 3]) -> (f64, [f64; 3]) {
        let largest = self.max(x);
        let first = self.min(if x == largest { self.rank as f64 } else { self.size as f64 });
        let mut found = if first == self.rank as f64 { place } else { [0.0; 3] };
        self.sum_slice(&mut found);
        (largest, found)
    }

    /// Minimum over ranks.
    pub fn min(&self, x: f64) -> f64 {
        let mut v = [x];
        self.reduce(&mut v, SystemOperation::min());
        v[0]
    }

    /// Maximum of an integer over ranks.
    pub fn max_u64(&self, x: u64) -> u64 {
        let mut v = [x];
        self.reduce(&mut v, SystemOperation::max());
        v[0]
    }

    /// Whether `x` holds on every rank.
    pub fn all(&self, x: bool) -> bool {
        self.max_u64(u64::from(!x)) == 0
    }

    /// Waits for every rank. Spins: for short waits only.
    pub fn barrier(&self) {
        if let Some(world) = self.world() {
            world.barrier();
        }
    }

    /// One value of each rank, in rank order.
    pub fn all_gather_u64(&self, x: u64) -> Vec<u64> {
        let mut all = vec![0; self.size];
        match self.world() {
            Some(world) => world.all_gather_into(&x, &mut all[..]),
            None => all[0] = x,
        }
        all
    }

    /// The concatenation of every rank's `x` in rank order, on every rank.
    pub fn all_gather_var<T: Equivalence + Copy + Default>(&self, x: &[T]) -> Vec<T> {
        let Some(world) = self.world() else {
            return x.to_vec();
        };
        let counts: Vec<i32> = self.all_gather_u64(x.len() as u64).iter().map(|&n| n as i32).collect();
        let displs = offsets(&counts);
        let mut all = vec![T::default(); counts.iter().sum::<i32>() as usize];
        let mut part = PartitionMut::new(&mut all[..], counts, displs);
        world.all_gather_varcount_into(x, &mut part);
        all
    }

    /// Sends `to[r]` to rank `r` and returns what each rank sent here. For set-up.
    pub fn all_to_all_var<T: Equivalence + Copy + Default>(&self, to: &[Vec<T>]) -> Vec<Vec<T>> {
        assert_eq!(to.len(), self.size, "one list for each rank");
        let Some(world) = self.world() else {
            return to.to_vec();
        };
        let send_counts: Vec<i32> = to.iter().map(|v| v.len() as i32).collect();
        let mut recv_counts = vec![0i32; self.size];
        world.all_to_all_into(&send_counts[..], &mut recv_counts[..]);
        let flat: Vec<T> = to.iter().flatten().copied().collect();
        let send = Partition::new(&flat[..], &send_counts[..], offsets(&send_counts));
        let mut buffer = vec![T::default(); recv_counts.iter().sum::<i32>() as usize];
        {
            let displs = offsets(&recv_counts);
            let mut recv = PartitionMut::new(&mut buffer[..], &recv_counts[..], displs);
            world.all_to_all_varcount_into(&send, &mut recv);
        }
        let mut rest = &buffer[..];
        recv_counts
            .iter()
            .map(|&n| {
                let (head, tail) = rest.split_at(n as usize);
                rest = tail;
                head.to_vec()
            })
            .collect()
    }

    /// As [`Comm::all_to_all_var`] without allocation: `send` holds `sent[r]` numbers for each rank r in turn, `receive` gets `received[r]` from
    /// each.
    pub fn all_to_all_into(&self, send: &[f64], sent: &[i32], receive: &mut [f64], received: &[i32]) {
        let Some(world) = self.world() else {
            receive.copy_from_slice(send);
            return;
        };
        let start = Instant::now();
        let send = Partition::new(send, sent, offsets(sent));
        let mut receive = PartitionMut::new(receive, received, offsets(received));
        world.all_to_all_varcount_into(&send, &mut receive);
        self.count(start);
    }

    /// Completes `x` on every rank: rank r has set `x[ends[r - 1]..ends[r]]`, from 0 for the first.
    pub fn all_gather_in_place(&self, x: &mut [f64], ends: &[usize]) {
        let Some(world) = self.world() else { return };
        let start = Instant::now();
        let first = |rank: usize| if rank == 0 { 0 } else { ends[rank - 1] };
        let own = x[first(self.rank)..ends[self.rank]].to_vec();
        let counts: Vec<i32> = (0..self.size).map(|r| (ends[r] - first(r)) as i32).collect();
        let displacements: Vec<i32> = (0..self.size).map(|r| first(r) as i32).collect();
        let mut all = PartitionMut::new(x, counts, displacements);
        world.all_gather_varcount_into(&own[..], &mut all);
        self.count(start);
    }

    /// Sends numbers to the next rank (`up`) or to the one before, and receives those of the rank on the other side. The last rank in this direction
    /// sends nothing, the first receives nothing.
    pub fn shift(&self, up: bool, send: &[f64], receive: &mut [f64]) {
        let Some(world) = self.world() else { return };
        let start = Instant::now();
        let (above, below) = (self.rank.checked_add(1).filter(|r| *r < self.size), self.rank.checked_sub(1));
        let (to, from) = if up { (above, below) } else { (below, above) };
        let process = |rank: usize| world.process_at_rank(rank as i32);
        mpi::request::scope(|scope| {
            let sent = to.map(|r| process(r).immediate_send_with_tag(scope, send, SHIFT));
            if let Some(r) = from {
                process(r).receive_into_with_tag(receive, SHIFT);
            }
            if let Some(request) = sent {
                request.wait();
            }
        });
        self.count(start);
    }

    /// Sends numbers to one rank, apart from all other messages. May wait (and then
    /// spins) until that rank receives them.
    pub fn send(&self, to: usize, numbers: &[f64]) {
        if let Some(world) = self.world() {
            world.process_at_rank(to as i32).send_with_tag(numbers, LETTER);
        }
    }

    /// The next message that `from` sent with [`Comm::send`], if it has come. Does not wait.
    pub fn poll(&self, from: usize) -> Option<Vec<f64>> {
        let sender = self.world()?.process_at_rank(from as i32);
        let (message, status) = sender.immediate_matched_probe_with_tag(LETTER)?;
        let mut numbers = vec![0.0; status.count(f64::equivalent_datatype()) as usize];
        message.matched_receive_into(&mut numbers[..]);
        Some(numbers)
    }

    /// Ends every rank of the program at once. For faults that one rank alone
    /// has seen while others may wait for it in a collective.
    pub fn abort(&self, code: i32) -> ! {
        match self.world() {
            Some(world) => world.abort(code),
            None => std::process::exit(code),
        }
    }
}

fn offsets(counts: &[i32]) -> Vec<i32> {
    counts
        .iter()
        .scan(0, |at, &n| {
            let start = *at;
            *at += n;
            Some(start)
        })
        .collect()
}

/// Sets the environment that several small MPI programs need to share few cores:
/// no binding, more ranks than cores, and ranks that yield while they wait. Root
/// is allowed only where the user is root.
pub fn mpirun_env(command: &mut std::process::Command) -> &mut std::process::Command {
    use std::os::unix::fs::MetadataExt;
    if std::fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0) {
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    }
    command
        .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
        .env("OMPI_MCA_hwloc_base_binding_policy", "none")
        .env("OMPI_MCA_mpi_yield_when_idle", "1")
}
