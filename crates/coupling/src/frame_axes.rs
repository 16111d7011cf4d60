//! Axes in which the frame moves.

use std::ops::Range;

/// Axes in which the frame accelerates: its velocity there is unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameAxes {
    /// It moves with a constant velocity.
    #[default]
    None,
    /// Upwards and downwards.
    Vertical,
    /// All three.
    All,
}

impl FrameAxes {
    /// Components of a vector in these axes.
    pub fn range(self) -> Range<usize> {
        match self {
            Self::None => 0..0,
            Self::Vertical => 2..3,
            Self::All => 0..3,
        }
    }

    /// Components of the force on the canopy that a response contains: the vertical one at least.
    pub(crate) fn of_forces(self) -> Range<usize> {
        if self == Self::None { 2..3 } else { self.range() }
    }

    /// Number of axes.
    pub fn len(self) -> usize {
        self.range().len()
    }

    /// Whether there are none.
    pub fn is_empty(self) -> bool {
        self == Self::None
    }
}
