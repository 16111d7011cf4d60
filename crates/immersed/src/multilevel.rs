//! Preconditioner of the system of the pressure jumps.
//!
//! The matrix S takes the jumps over a surface to the fluxes that they cause: an operator of order 1, for a jump over a patch of n rows moves
//! the air around the rim of the patch. With the diagonal alone, jumps over the whole surface converge as slowly as it has cells across. Sums over groups
//! of neighbouring rows add what they need (Bramble, Pasciak and Xu, Math. Comput. 55, 1990),
//! ```math
//! P^{-1} = D^{-1} + s \sum_l A_l\, E_l^{-1} A_l^T ,
//! ```
//! with the rows of a block of $`2^l`$ cells in each direction as a column of $`A_l`$, and E an estimate of the diagonal of $`A_l^T S A_l`$: the leak of the rows, and
//! their own responses over $`\sqrt n`$. The share s makes up for what levels have in common and for the steps at the rims of the blocks, which smooth jumps do not
//! have.

use crate::constraints::FluxConstraints;
use crate::grid::Grid;

/// Levels at most.
const MAX_LEVELS: u32 = 8;
/// Bits of the position along an axis.
const BITS: u32 = 16;
/// Share s. Iterations in all of ten windows of a square canopy on 50 cells across, forty of one with a gathered skirt of 4 m on cells of 0.3 m, and forty-odd of
/// one that opens from its cut: 1598, 1265, 3612 without groups; 1065, 1240, 2527 with 0.05; 982, 1352, 2816 with 0.1; 1087 with 0.3 (first case).
const SHARE: f64 = 0.05;

/// Groups of the rows of constraints.
#[derive(Clone, Debug, Default)]
pub(crate) struct Multilevel {
    /// Rows along a curve on which those of a block follow each other, and their places on it.
    order: Vec<(u64, u32)>,
    /// Groups of all levels: end on the curve, and factor of their sum.
    groups: Vec<(u32, f64)>,
    /// End of each level in `groups`.
    levels: Vec<usize>,
    /// Residuals and their corrections along the curve.
    residuals: Vec<f64>,
    corrections: Vec<f64>,
}

impl Multilevel {
    /// Sets the groups of `rows` with the `diagonal` of the system, of which `leak` is what passes through the cloth.
    pub(crate) fn set(&mut self, rows: &FluxConstraints, grid: &Grid, leak: &[f64], diagonal: &[f64]) {
        let layout = grid.layout();
        let place = |row: usize| {
            let (_, at) = rows.faces[rows.offsets[row]];
            morton(layout.cell(at).map(|i| i.max(0) as u64))
        };
        self.order.clear();
        self.order.extend((0..rows.len()).map(|row| (place(row), row as u32)));
        self.order.sort_unstable();
        self.groups.clear();
        self.levels.clear();
        for level in 1..=MAX_LEVELS {
            let first = self.groups.len();
            for group in self.order.chunk_by(|(a, _), (b, _)| a >> (3 * level) == b >> (3 * level)) {
                let of = |values: &[f64]| group.iter().map(|(_, row)| values[*row as usize]).sum::<f64>();
                let (leak, diagonal) = (of(leak), of(diagonal));
                let estimate = leak + (diagonal - leak) / (group.len() as f64).sqrt();
                let end = self.groups.len().checked_sub(1).filter(|last| *last >= first);
                let end = end.map_or(0, |last| self.groups[last].0) + group.len() as u32;
                self.groups.push((end, SHARE / estimate));
            }
            self.levels.push(self.groups.len());
            if self.groups.len() - first <= 1 {
                break;
            }
        }
    }

    /// $`P^{-1} r`$ to `z`.
    pub(crate) fn apply(&mut self, diagonal: &[f64], r: &[f64], z: &mut [f64]) {
        self.residuals.clear();
        self.residuals.extend(self.order.iter().map(|(_, row)| r[*row as usize]));
        self.corrections.clear();
        self.corrections.resize(r.len(), 0.0);
        let mut first = 0;
        for &end_of_level in &self.levels {
            let mut start = 0;
            for &(end, factor) in &self.groups[first..end_of_level] {
                let rows = start..end as usize;
                let correction = factor * self.residuals[rows.clone()].iter().sum::<f64>();
                self.corrections[rows].iter_mut().for_each(|c| *c += correction);
                start = end as usize;
            }
            first = end_of_level;
        }
        for ((_, row), correction) in self.order.iter().zip(&self.corrections) {
            let row = *row as usize;
            z[row] = r[row] / diagonal[row] + correction;
        }
    }
}

/// The bits of three positions in turn.
fn morton(position: [u64; 3]) -> u64 {
    let spread = |x: u64| (0..BITS).fold(0, |code, bit| code | (x >> bit & 1) << (3 * bit));
    spread(position[0]) | spread(position[1]) << 1 | spread(position[2]) << 2
}
