//! Images of cells in a periodic domain.
//!
//! A face of a periodic patch lies between its cell and an image of the cell at the other patch. Images are ghosts: their
//! values come from the owner of the cell, which may be the same rank, and their centres are moved by whole periods. A face
//! of a pair of patches exists twice, at both patches, each time for its own cell.

use mesh::{PeriodicFace, PeriodicFaces};

use crate::geometry::vec3::Vec3;

/// Base of the number of a [`Shift`]: from -2 to 2 periods, as far as neighbours' neighbours lie.
const BASE: i32 = 5;

/// By how many periods an image is moved, for each of the grid's translations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Shift([i8; 3]);

impl Shift {
    /// By `periods` along the translation `k`.
    pub fn along(k: usize, periods: i8) -> Self {
        let mut shift = Self::default();
        shift.0[k] = periods;
        shift
    }

    /// Number of the image, see [`comm::Numbering::image`].
    pub fn number(self) -> u32 {
        self.0.iter().rev().fold(0, |n, &s| n * BASE + i32::from(s).rem_euclid(BASE)) as u32
    }

    /// The shift with this number.
    pub fn of_number(number: u32) -> Self {
        let digit = |k: u32| number as i32 / BASE.pow(k) % BASE;
        Self([0, 1, 2].map(|k| if digit(k) > BASE / 2 { digit(k) - BASE } else { digit(k) } as i8))
    }

    /// Translation of the image, m.
    pub fn translation(self, periods: &[Vec3]) -> Vec3 {
        self.0.iter().zip(periods).map(|(&s, period)| period * f64::from(s)).sum()
    }
}

impl std::ops::Add for Shift {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

/// The image of the cell on the other side of a face of a pair, seen from its cell at `side` (0: at the first patch).
pub(crate) fn opposite(face: &PeriodicFace, side: usize) -> (u32, Shift) {
    (face.cells[1 - side], Shift::along(face.period, if side == 0 { -1 } else { 1 }))
}

/// Translations of a grid, m.
pub(crate) fn periods(faces: &PeriodicFaces) -> Vec<Vec3> {
    faces.periods.iter().map(|p| Vec3::from(*p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_name_each_shift_once() {
        let mut numbers = Vec::new();
        for i in -2..=2 {
            for j in -2..=2 {
                for k in -2..=2 {
                    let shift = Shift([i, j, k]);
                    assert_eq!(Shift::of_number(shift.number()), shift);
                    numbers.push(shift.number());
                }
            }
        }
        numbers.sort_unstable();
        assert_eq!(numbers, (0..125).collect::<Vec<_>>());
        assert_eq!(Shift::default().number(), 0);
    }
}
