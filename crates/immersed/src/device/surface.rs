//! What a surface does in the prediction of a step, on a device.

use super::Address;
use super::queue::{Buffer, Queue};
use super::rows::{Indices, offsets};
use crate::free_edges::EdgeFluxes;
use crate::friction::Friction;
use crate::grid::Grid;

/// Values that a list of entries changes, each by its own.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) count: usize,
    indices: Buffer,
    /// Places in the indices: components and positions of the values, first entries, and further arrays of the entries.
    at: Vec<usize>,
}

impl Targets {
    /// Of sorted entries with component and position of their value, and `arrays` of numbers of each entry.
    fn new<T>(
        queue: &Queue,
        entries: &[T],
        key: impl Fn(&T) -> (u8, usize),
        arrays: &[&dyn Fn(&T) -> usize],
    ) -> Self {
        let offsets = offsets(entries, &key);
        let count = offsets.len() - 1;
        let mut indices = Indices::default();
        let keys: Vec<_> = offsets[..count].iter().map(|e| key(&entries[*e])).collect();
        let mut at =
            vec![indices.push(keys.iter().map(|k| k.0 as usize)), indices.push(keys.iter().map(|k| k.1))];
        at.push(indices.push(offsets.iter().copied()));
        at.extend(arrays.iter().map(|of| indices.push(entries.iter().map(of))));
        Self { count, indices: indices.upload(queue), at }
    }

    /// Components (0), positions (1), first entries (2), or a further array.
    pub(crate) fn array(&self, i: usize) -> Address {
        self.indices.index_at(self.at[i])
    }
}

/// Fluxes near free edges: component, axis and upper value of each, and what it lacks of its upwind share.
#[derive(Debug)]
pub(crate) struct DeviceEdges {
    /// Of which edges and upwind share these are.
    of: (EdgeFluxes, f64),
    pub(crate) targets: Targets,
    pub(crate) factors: Buffer,
}

impl DeviceEdges {
    pub(crate) fn new(queue: &Queue, grid: &Grid, edges: &EdgeFluxes, upwind_share: f64) -> Self {
        // Each flux leaves its lower value and enters the upper one.
        let mut entries = Vec::with_capacity(2 * edges.len());
        for (component, axis, upper, share) in edges.fluxes() {
            let missing = share - upwind_share;
            if missing > 0.0 {
                let factor = missing / 12.0 / grid.axes[0].spacing;
                entries.push((component, upper - grid.strides[axis as usize], axis, upper, -factor));
                entries.push((component, upper, axis, upper, factor));
            }
        }
        entries.sort_by_key(|e| (e.0, e.1, e.2, e.3));
        let targets =
            Targets::new(queue, &entries, |e| (e.0, e.1), &[&|e| e.0 as usize, &|e| e.2 as usize, &|e| e.3]);
        let factors: Vec<f64> = entries.iter().map(|e| e.4).collect();
        Self { of: (edges.clone(), upwind_share), targets, factors: queue.numbers(&factors) }
    }

    /// Whether these are `edges` with this upwind share elsewhere.
    pub(crate) fn are(&self, edges: &EdgeFluxes, upwind_share: f64) -> bool {
        self.of.1 == upwind_share && self.of.0 == *edges
    }
}

/// Friction: values and the neighbours from which the surface separates them, and its sides.
#[derive(Debug)]
pub(crate) struct DeviceFriction {
    /// Of which friction this is.
    of: Friction,
    pub(crate) interrupted: Targets,
    pub(crate) walls: Targets,
    /// Distance, velocities at the start and the end of the step, and force of each side.
    sides: Buffer,
    count: usize,
    /// Rate by the pressure in the step before, and velocity with friction, of each value.
    values: Buffer,
}

impl DeviceFriction {
    pub(crate) fn new(queue: &Queue, friction: &Friction) -> Self {
        let mut entries: Vec<(u8, usize, usize)> = Vec::with_capacity(2 * friction.len());
        for (c, [low, high]) in friction.segments() {
            entries.extend([(c as u8, low, high), (c as u8, high, low)]);
        }
        entries.sort_unstable();
        let sides: Vec<_> = friction.sides().collect();
        let distances: Vec<f64> = sides.iter().map(|s| s.1).collect();
        let buffer = queue.buffer(4 * sides.len());
        queue.upload(buffer.at(0), &distances);
        let walls = Targets::new(queue, &sides, |s| s.0, &[]);
        let friction = Self {
            of: friction.clone(),
            interrupted: Targets::new(queue, &entries, |e| (e.0, e.1), &[&|e| e.2]),
            values: queue.buffer(2 * walls.count),
            walls,
            count: sides.len(),
            sides: buffer,
        };
        friction.set_velocities(queue, &friction.of);
        friction
    }

    /// Whether this is that friction, with other velocities perhaps.
    pub(crate) fn is(&self, friction: &Friction) -> bool {
        self.of.is_at_the_place_of(friction)
    }

    /// Takes the velocities of the sides.
    pub(crate) fn set_velocities(&self, queue: &Queue, friction: &Friction) {
        for i in 0..2 {
            let velocities: Vec<f64> = friction.sides().map(|s| s.2[i]).collect();
            queue.upload(self.sides(1 + i), &velocities);
        }
    }

    /// Distances (0), velocities at the start (1) and the end (2), or forces (3) of the sides.
    pub(crate) fn sides(&self, which: usize) -> Address {
        self.sides.at(which * self.count)
    }

    /// Rates by the pressure in the step before (0), or velocities with friction (1), of the values.
    pub(crate) fn values(&self, which: usize) -> Address {
        self.values.at(which * self.walls.count)
    }

    /// Number of sides.
    pub(crate) fn len(&self) -> usize {
        self.count
    }
}
