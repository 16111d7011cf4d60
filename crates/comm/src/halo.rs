//! Exchange of ghost values with neighbouring partitions.
//!
//! This module talks to the C interface of MPI, because requests must outlive
//! the call that starts them so that interior work can overlap the transfer.
//! Each use of `unsafe` is argued where it stands.

use std::cell::RefCell;

use mpi::ffi;
use mpi::traits::*;

use crate::{Comm, Numbering};

/// A number that a halo can carry.
pub trait Scalar: Equivalence + Copy + Default + std::ops::AddAssign + 'static {
    #[doc(hidden)]
    fn buffers(halo: &Halo) -> &RefCell<Buffers<Self>>;
}

impl Scalar for f64 {
    fn buffers(halo: &Halo) -> &RefCell<Buffers<f64>> {
        &halo.f64
    }
}

impl Scalar for f32 {
    fn buffers(halo: &Halo) -> &RefCell<Buffers<f32>> {
        &halo.f32
    }
}

#[doc(hidden)]
#[derive(Default)]
pub struct Buffers<T> {
    send: Vec<T>,
    recv: Vec<T>,
}

/// The ghost values of one [`Numbering`] and where they come from.
///
/// # Examples
///
/// On one rank nothing is exchanged; the same code runs on any number of ranks.
///
/// ```
/// use comm::{Comm, Halo, Numbering};
///
/// let comm = Comm::solo();
/// // This rank owns all of the entities; a ghost would be given with the rank that owns it.
/// let numbering = Numbering::new(vec![0, 1, 2], Vec::new());
/// let halo = Halo::new(&comm, &numbering);
/// assert_eq!((halo.n_owned(), halo.n_local()), (3, 3));
///
/// let mut values = vec![1.0, 2.0, 3.0];
/// halo.exchange(&mut values, 1);
/// let sum = comm.sum(values[..halo.n_owned()].iter().sum());
/// assert_eq!(sum, 6.0);
/// ```
pub struct Halo {
    comm: Comm,
    n_owned: usize,
    n_local: usize,
    /// Neighbour and the owned entities it reads, with offsets into `send_index`.
    send: Vec<(i32, std::ops::Range<usize>)>,
    send_index: Vec<u32>,
    /// Neighbour and the contiguous range of local ghosts it owns.
    recv: Vec<(i32, std::ops::Range<usize>)>,
    requests: RefCell<Vec<ffi::MPI_Request>>,
    f64: RefCell<Buffers<f64>>,
    f32: RefCell<Buffers<f32>>,
}

impl Halo {
    /// Agrees with the neighbours on what to exchange. Collective.
    pub fn new(comm: &Comm, numbering: &Numbering) -> Self {
        let n_owned = numbering.n_owned;
        let mut wanted = vec![Vec::new(); comm.size()];
        let mut recv: Vec<(i32, std::ops::Range<usize>)> = Vec::new();
        for (k, &owner) in numbering.ghost_owner.iter().enumerate() {
            let local = n_owned + k;
            wanted[owner as usize].push(numbering.global[local]);
            match recv.last_mut() {
                Some((r, range)) if *r == owner as i32 => range.end = local + 1,
                _ => recv.push((owner as i32, local..local + 1)),
            }
        }
        let asked = comm.all_to_all_var(&wanted);
        let mut send = Vec::new();
        let mut send_index = Vec::new();
        for (rank, list) in asked.iter().enumerate().filter(|(_, l)| !l.is_empty()) {
            let start = send_index.len();
            for &g in list {
                let local = numbering.local(g).filter(|&i| i < n_owned);
                let local = local.expect("a neighbour asked for an entity that is not owned here");
                send_index.push(local as u32);
            }
            send.push((rank as i32, start..send_index.len()));
        }
        Self {
            comm: comm.clone(),
            n_owned,
            n_local: numbering.n_local(),
            send,
            send_index,
            recv,
            requests: RefCell::default(),
            f64: RefCell::default(),
            f32: RefCell::default(),
        }
    }

    /// A halo without neighbours, for one rank.
    pub fn solo(n: usize) -> Self {
        Self::new(&Comm::solo(), &Numbering::new((0..n as u64).collect(), Vec::new()))
    }

    /// Number of owned entities.
    pub fn n_owned(&self) -> usize {
        self.n_owned
    }

    /// Owned and ghost entities together.
    pub fn n_local(&self) -> usize {
        self.n_local
    }

    /// The ranks that share this halo.
    pub fn comm(&self) -> &Comm {
        &self.comm
    }

    /// Values sent in one exchange of width 1, for reports of traffic.
    pub fn n_sent(&self) -> usize {
        self.send_index.len()
    }

    /// Refreshes the ghosts of `x` (shape `[n_local][width]`, row-major).
    pub fn exchange<T: Scalar>(&self, x: &mut [T], width: usize) {
        self.overlap(x, width, |_| ());
    }

    /// As [`Halo::exchange`], doing `work` while the values travel. `work` sees
    /// `x` with its owned values; its ghosts are the old ones.
    pub fn overlap<T: Scalar, R>(&self, x: &mut [T], width: usize, work: impl FnOnce(&[T]) -> R) -> R {
        assert_eq!(x.len(), self.n_local * width, "one row for each local entity");
        if self.send.is_empty() && self.recv.is_empty() {
            return work(x);
        }
        let mut buffers = T::buffers(self).borrow_mut();
        let Buffers { send, recv } = &mut *buffers;
        send.clear();
        for &i in &self.send_index {
            send.extend_from_slice(&x[i as usize * width..(i as usize + 1) * width]);
        }
        let n_ghost = self.n_local - self.n_owned;
        recv.resize(n_ghost * width, T::default());
        if let Some((owned, ghosts)) = self.to_itself(width) {
            recv[ghosts].copy_from_slice(&send[owned]);
        }
        self.start(send, recv, width, false);
        let result = work(x);
        self.wait();
        x[self.n_owned * width..].copy_from_slice(recv);
        result
    }

    /// Adds the ghost rows of `x` to the rows of their owners, and clears the
    /// ghosts here: the transpose of [`Halo::exchange`].
    pub fn accumulate<T: Scalar>(&self, x: &mut [T], width: usize) {
        assert_eq!(x.len(), self.n_local * width, "one row for each local entity");
        if self.send.is_empty() && self.recv.is_empty() {
            return;
        }
        let mut buffers = T::buffers(self).borrow_mut();
        let Buffers { send, recv } = &mut *buffers;
        // The roles of the two buffers swap: ghosts go out, owned sums come in.
        recv.clear();
        recv.extend_from_slice(&x[self.n_owned * width..]);
        send.resize(self.send_index.len() * width, T::default());
        if let Some((owned, ghosts)) = self.to_itself(width) {
            send[owned].copy_from_slice(&recv[ghosts]);
        }
        self.start(recv, send, width, true);
        self.wait();
        for (k, &i) in self.send_index.iter().enumerate() {
            for c in 0..width {
                x[i as usize * width + c] += send[k * width + c];
            }
        }
        x[self.n_owned * width..].fill(T::default());
    }

    /// Places of the values that this rank has images of itself: among the sent ones and among the ghosts.
    fn to_itself(&self, width: usize) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
        let me = self.comm.rank() as i32;
        let (_, owned) = self.send.iter().find(|(rank, _)| *rank == me)?;
        let (_, ghosts) = self.recv.iter().find(|(rank, _)| *rank == me)?;
        let ghosts = (ghosts.start - self.n_owned) * width..(ghosts.end - self.n_owned) * width;
        Some((owned.start * width..owned.end * width, ghosts))
    }

    fn start<T: Scalar>(&self, out: &[T], into: &mut [T], width: usize, transpose: bool) {
        let Some(world) = self.comm.world() else {
            return;
        };
        let start = std::time::Instant::now();
        let mut requests = self.requests.borrow_mut();
        requests.clear();
        let ghost =
            |r: &std::ops::Range<usize>| (r.start - self.n_owned) * width..(r.end - self.n_owned) * width;
        let owned = |r: &std::ops::Range<usize>| r.start * width..r.end * width;
        let me = self.comm.rank() as i32;
        let sent = self.send.iter().filter(|(q, _)| *q != me).map(|(q, r)| (*q, owned(r))).collect();
        let received = self.recv.iter().filter(|(q, _)| *q != me).map(|(q, r)| (*q, ghost(r))).collect();
        let (from, to): (Vec<_>, Vec<_>) = if transpose { (sent, received) } else { (received, sent) };
        const TAG: i32 = 71;
        let datatype = T::equivalent_datatype();
        for (rank, range) in from {
            let part = &mut into[range];
            // SAFETY: the buffer is borrowed from a `RefCell` that the caller holds
            // until `wait` has completed every request; ranges do not overlap.
            unsafe {
                let mut request = ffi::RSMPI_REQUEST_NULL;
                ffi::MPI_Irecv(
                    part.as_mut_ptr().cast(),
                    part.len() as i32,
                    datatype.as_raw(),
                    rank,
                    TAG,
                    world.as_raw(),
                    &mut request,
                );
                requests.push(request);
            }
        }
        for (rank, range) in to {
            let part = &out[range];
            // SAFETY: as above; MPI only reads the send buffer.
            unsafe {
                let mut request = ffi::RSMPI_REQUEST_NULL;
                ffi::MPI_Isend(
                    part.as_ptr().cast(),
                    part.len() as i32,
                    datatype.as_raw(),
                    rank,
                    TAG,
                    world.as_raw(),
                    &mut request,
                );
                requests.push(request);
            }
        }
        drop(requests);
        self.comm.count(start);
    }

    fn wait(&self) {
        let start = std::time::Instant::now();
        let mut requests = self.requests.borrow_mut();
        if requests.is_empty() {
            return;
        }
        // SAFETY: the requests were made by `start` and are completed once.
        unsafe {
            ffi::MPI_Waitall(requests.len() as i32, requests.as_mut_ptr(), ffi::RSMPI_STATUSES_IGNORE);
        }
        requests.clear();
        self.comm.count(start);
    }
}

impl std::fmt::Debug for Halo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "halo of {} owned and {} ghosts, {} neighbours",
            self.n_owned,
            self.n_local - self.n_owned,
            self.recv.len()
        )
    }
}
