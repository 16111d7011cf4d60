//! Smoothing of the flow grid's free nodes.

use super::topology::Blocks;
use crate::FlowGrid;

pub(super) fn smooth(_blocks: &Blocks, _grid: &mut FlowGrid) {}
