//! Message passing between the ranks of one program.
//!
//! This is the only crate that names `mpi`. It offers three ideas:
//!
//! * [`Comm`]: the ranks of one program, reductions and set-up exchanges;
//! * [`Halo`]: the values that neighbouring partitions share, refreshed with
//!   non-blocking `MPI_Isend`/`MPI_Irecv` (paper, section 1.3);
//! * [`Numbering`]: which global entities a rank owns and which it only reads.
//!
//! A [`Comm::solo`] is a one-rank world without MPI, so libraries and their
//! tests run in any process; the code that uses it is the same code.
//!
//! A collective call keeps a core busy until every rank has arrived. Wait for
//! work on the channel (which sleeps), never in a collective.

mod halo;
mod numbering;
mod time_slice;
mod world;

pub use halo::{Halo, Scalar};
pub use numbering::Numbering;
pub use world::{Comm, CommError, mpirun_env};
