//! A step of the flow on another device than this processor, such as a GPU.
//!
//! All arrays of a step stay on the device; what the surface prescribes goes there and what it feels comes back. Conjugate gradients run here, on one number for each row,
//! and apply the matrix there. The arrays of the host follow by [`Flow::gather`](crate::flow::Flow::gather), as on several ranks.
//!
//! [`Device`] names what is needed; the kernels are [`KERNELS`]. Nothing here links a library of a GPU.

mod arguments;
mod eddies;
mod flow;
mod queue;
mod rows;
mod steps;
mod surface;
mod tables;

use std::fmt::Debug;

pub(crate) use steps::DeviceFlow;

/// Source of the kernels in the common part of C and CUDA C++.
pub const KERNELS: &str = include_str!("kernels.cu");

/// Names of the kernels in [`KERNELS`].
pub const KERNEL_NAMES: [&str; 23] = [
    "rates",
    "extrapolate",
    "edges",
    "interrupt",
    "wall",
    "wall_rates",
    "ghosts",
    "outflow",
    "divergence",
    "along_z",
    "gradient",
    "impulses",
    "spread",
    "sources",
    "responses",
    "fluxes",
    "largest",
    "reduce",
    "viscosities",
    "clear_crossed",
    "viscosity_ghosts",
    "stresses",
    "largest_viscosity",
];

/// Address of memory on a device.
pub type Address = u64;

/// What a device could not do, in its own words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {what}")]
pub struct DeviceError {
    /// The device.
    pub device: String,
    /// What failed.
    pub what: String,
}

/// Why a flow cannot be computed on a device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoDevice {
    /// More ranks than one.
    #[error("a device computes the flow of one rank, and there are {0}; set ranks.flow = 1")]
    Ranks(usize),
    /// A failure of the device.
    #[error(transparent)]
    Failed(#[from] DeviceError),
}

/// A matrix product C = A B of column-major matrices, once or for several at constant distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Product {
    /// Rows and columns of C, and the length of the sums.
    pub size: [usize; 3],
    /// Whether A and B are stored as their transposes.
    pub transposed: [bool; 2],
    /// Addresses of A, B and C.
    pub at: [Address; 3],
    /// Distance of the columns as they are stored, in numbers.
    pub columns: [usize; 3],
    /// Distance of one matrix from the next, in numbers; 0: it is the same in all products.
    pub next: [usize; 3],
    /// Number of products.
    pub count: usize,
}

/// Memory and kernels of a device. Calls take effect in their order; [`Device::download`] waits for all before it.
pub trait Device: Debug {
    /// Its name for people.
    fn name(&self) -> String;

    /// Allocates this many words of 8 bytes, which are zero.
    ///
    /// # Errors
    /// No memory.
    fn allocate(&self, words: usize) -> Result<Address, DeviceError>;

    /// Frees what was allocated.
    fn free(&self, address: Address, words: usize);

    /// Copies numbers to the device.
    ///
    /// # Errors
    /// A failure of the device, also of an earlier call.
    fn upload(&self, to: Address, values: &[f64]) -> Result<(), DeviceError>;

    /// Copies indices to the device.
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn upload_indices(&self, to: Address, values: &[u32]) -> Result<(), DeviceError>;

    /// Copies numbers from the device.
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn download(&self, from: Address, values: &mut [f64]) -> Result<(), DeviceError>;

    /// Copies words on the device.
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn copy(&self, from: Address, to: Address, words: usize) -> Result<(), DeviceError>;

    /// Sets words to zero.
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn clear(&self, at: Address, words: usize) -> Result<(), DeviceError>;

    /// Runs a kernel of [`KERNEL_NAMES`]; `arguments` are the words of its structure in [`KERNELS`].
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn launch(&self, kernel: &'static str, threads: usize, arguments: &[u64]) -> Result<(), DeviceError>;

    /// Computes matrix products.
    ///
    /// # Errors
    /// As [`Self::upload`].
    fn multiply(&self, product: &Product) -> Result<(), DeviceError>;
}
