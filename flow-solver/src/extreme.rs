//! The largest of the values of all cells, and where it is.

use comm::Comm;

/// Largest value of the cells of a rank, at least 0, and its cell.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extreme {
    value: f64,
    cell: usize,
}

impl Extreme {
    /// Takes `value` of `cell` if it is larger.
    pub fn compare(&mut self, value: f64, cell: usize) {
        if value > self.value {
            *self = Self { value, cell };
        }
    }

    /// The largest value of all ranks and the centre of its cell, m. Collective.
    pub fn over_ranks(self, comm: &Comm, centres: &[[f64; 3]]) -> (f64, [f64; 3]) {
        comm.max_with_place(self.value, centres.get(self.cell).copied().unwrap_or_default())
    }
}
