//! File with the shape of the canopy: its layout is part of the contract, because external structure solvers write it as well.

use serde::{Deserialize, Serialize};

use crate::codec::compact;
use crate::hash::fnv1a_of_numbers;

/// First bytes of a file.
pub const MAGIC: [u8; 8] = *b"ripshape";
/// Version of the layout.
pub const VERSION: u32 = 1;

/// Content of a file.
#[derive(Serialize, Deserialize)]
pub struct Shape {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`VERSION`].
    pub version: u32,
    /// Number of canopy nodes.
    pub count: u64,
    /// [`fnv1a_of_numbers`] of the positions.
    pub checksum: u64,
    /// Positions of the canopy nodes, m, in the order of the interface.
    pub positions: Vec<[f64; 3]>,
}

/// The bytes of a file with the positions of the canopy nodes, m, in the order of the interface.
pub fn encode(positions: &[[f64; 3]]) -> Vec<u8> {
    compact::encode(&Shape {
        magic: MAGIC,
        version: VERSION,
        count: positions.len() as u64,
        checksum: fnv1a_of_numbers(positions.as_flattened()),
        positions: positions.to_vec(),
    })
}
