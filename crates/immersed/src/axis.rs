//! One direction of a rectilinear grid: an even core between cells that grow towards the far field.

use std::ops::Range;

/// Cells along one coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Coordinates of the faces, ascending; one more than cells, m.
    pub faces: Vec<f64>,
    /// Width of each cell, m.
    pub widths: Vec<f64>,
    /// Cells of the even core.
    pub core: Range<usize>,
    /// Width of the cells of the core, m.
    pub spacing: f64,
}

impl Axis {
    /// `count` equal cells from `start` to `end`, all of them core.
    pub fn even(start: f64, end: f64, count: usize) -> Self {
        let spacing = (end - start) / count as f64;
        let faces = (0..=count).map(|i| start + spacing * i as f64).collect();
        Self { faces, widths: vec![spacing; count], core: 0..count, spacing }
    }

    /// An even core that covers `core` with cells of width `spacing`, and flanks that reach to the distances `flanks` (m) below and above it:
    /// each cell is at most `growth` times wider than its inner neighbour. The number of core cells is a multiple of `multiple`.
    pub fn stretched(core: [f64; 2], spacing: f64, flanks: [f64; 2], growth: f64, multiple: usize) -> Self {
        let cells =
            (((core[1] - core[0]) / spacing - 1e-9).ceil().max(1.0) as usize).next_multiple_of(multiple);
        let start = 0.5 * (core[0] + core[1] - spacing * cells as f64);
        let [low, high] = flanks.map(|reach| flank(spacing, reach, growth));
        let mut widths: Vec<f64> = low.iter().rev().copied().collect();
        let first = widths.len();
        widths.extend(std::iter::repeat_n(spacing, cells));
        widths.extend(&high);
        let mut at = start - low.iter().sum::<f64>();
        let mut faces = vec![at];
        for (i, width) in widths.iter().enumerate() {
            at = if (first..=first + cells).contains(&(i + 1)) {
                start + spacing * (i + 1 - first) as f64
            } else {
                at + width
            };
            faces.push(at);
        }
        Self { faces, widths, core: first..first + cells, spacing }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.widths.len()
    }

    /// Whether there are no cells.
    pub fn is_empty(&self) -> bool {
        self.widths.is_empty()
    }

    /// Centre of cell `i`, m.
    pub fn centre(&self, i: usize) -> f64 {
        0.5 * (self.faces[i] + self.faces[i + 1])
    }
}

/// Widths of the cells of a flank, from inside to outside, that add up to `reach`.
fn flank(spacing: f64, reach: f64, growth: f64) -> Vec<f64> {
    if reach < 0.5 * spacing {
        return Vec::new();
    }
    let sum = |ratio: f64, n: usize| (1..=n).map(|i| spacing * ratio.powi(i as i32)).sum::<f64>();
    let count = (1..).find(|&n| sum(growth, n) >= reach).unwrap_or(1);
    // The ratio at which so many cells reach just so far; cells do not become smaller than those of the core by more than the last fraction.
    let (mut least, mut most) = (0.5, growth);
    for _ in 0..80 {
        let middle = 0.5 * (least + most);
        if sum(middle, count) < reach { least = middle } else { most = middle }
    }
    (1..=count).map(|i| spacing * most.powi(i as i32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretched_axis_reaches_its_ends_with_bounded_growth() {
        let axis = Axis::stretched([-1.0, 1.0], 0.1, [5.0, 10.0], 1.15, 4);
        let (first, last) = (axis.faces[0], *axis.faces.last().expect("faces"));
        assert!((first + 1.0 + 5.0).abs() < 1e-9 && (last - 11.0).abs() < 1e-9, "{first} {last}");
        assert_eq!((axis.core.len(), axis.faces.len()), (20, axis.len() + 1));
        for pair in axis.widths.windows(2) {
            let ratio = pair[1] / pair[0];
            assert!((1.0 / 1.15 - 1e-9..=1.15 + 1e-9).contains(&ratio), "{ratio}");
        }
        for (i, width) in axis.widths.iter().enumerate() {
            assert!((axis.faces[i + 1] - axis.faces[i] - width).abs() < 1e-12, "{i}");
        }
    }
}
