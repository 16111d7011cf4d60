//! Friction of viscous air on a surface: no slip.
//!
//! The viscous flux of component c between neighbouring values $`u_m`$ and $`u_{m+1}`$ along axis d, a width h apart, is $`\nu\,(u_{m+1} - u_m) / h`$.
//! Where the surface crosses the segment between them, at the distances $`\delta_m + \delta_{m+1} = h`$, there is no such flux but the stress of
//! the wall on each side, with the velocity w of the surface at the crossing:
//! ```math
//! \tau_m / \rho = \nu\, (w - u_m) / \delta_m, \qquad \tau_{m+1} / \rho = \nu\, (w - u_{m+1}) / \delta_{m+1}.
//! ```
//! The volume of a value has the face $`h^2`$ towards d. The sum over d, with d = c, is the Laplacian form of the viscous force for a wall at any angle:
//! the projected area along d is $`|n_d|`$ times that of the surface, and the distance along d the normal one over $`|n_d|`$. Of several layers
//! that cross one segment the lowest acts on the lower value and the highest on the upper one.
//!
//! The wall stress is implicit in the predicted velocity,
//! ```math
//! u^\ast = \hat u + \Delta t\, \tfrac{\nu}{h} \sum_j \frac{w_j - u^\ast}{\delta_j}
//! \;\Rightarrow\;
//! u^\ast = \Big(\hat u + \Delta t\, \tfrac{\nu}{h} \sum_j \tfrac{w_j}{\delta_j}\Big) \Big/ \Big(1 + \Delta t\, \tfrac{\nu}{h} \sum_j \tfrac1{\delta_j}\Big),
//! ```
//! a division for each value, so that the distance may vanish and the limit of the step is that of the air without walls. The force on the surface is
//! $`\rho\, \nu\, h^2 (u^\ast - w) / \delta`$: what the air loses in the step, to round-off. Nothing of it enters a later step but by the velocity.

use std::ops::Range;

use nalgebra::Vector3;

use crate::cut_faces::{Crossing, OutsideCore, Rasteriser};
use crate::grid::{Grid, Velocity};

/// Least distance between a value and the surface, in cells; it keeps the quotient finite.
const LEAST_DISTANCE: f64 = 1e-12;

/// One side of a crossing: a value and the surface next to it.
#[derive(Clone, Copy, Debug)]
struct WallSide {
    component: u8,
    /// Position of the value in its array.
    at: usize,
    triangle: u32,
    /// Shares of the triangle's nodes.
    shares: [f64; 3],
    /// Distance from the value to the surface along the axis, m.
    distance: f64,
    /// Velocity of the surface, m/s.
    velocity: f64,
    /// Force of the air on the surface in the last step, N.
    force: f64,
}

/// Two neighbours whose viscous flux the surface interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Segment {
    component: u8,
    /// Positions of the lower and the upper value.
    at: [usize; 2],
}

/// Friction of the air on a surface.
#[derive(Clone, Debug, Default)]
pub struct Friction {
    segments: Vec<Segment>,
    /// Sides, those of one value one after the other.
    sides: Vec<WallSide>,
    /// Width of a cell, m.
    spacing: f64,
}

impl Friction {
    /// For the triangles `faces` of nodes at `positions` (m, in the frame of the grid).
    ///
    /// # Errors
    /// A node is not at least three cells inside the core.
    pub fn new(grid: &Grid, positions: &[Vector3<f64>], faces: &[[u32; 3]]) -> Result<Self, OutsideCore> {
        let mut friction = Self { spacing: grid.axes[0].spacing, ..Self::default() };
        let raster = Rasteriser::new(grid, positions, faces)?;
        for component in 0..3 {
            for axis in 0..3 {
                let mut crossings = raster.of_component(component, axis);
                // Those of a segment one after the other, the highest first.
                crossings.sort_by(|a, b| a.cell.cmp(&b.cell).then(a.to_upper.total_cmp(&b.to_upper)));
                for layers in crossings.chunk_by(|a, b| a.cell == b.cell) {
                    friction.push(grid, component, axis, layers);
                }
            }
        }
        friction.sides.sort_by_key(|s| (s.component, s.at));
        Ok(friction)
    }

    /// Adds the crossings of one segment, the highest first.
    fn push(&mut self, grid: &Grid, component: usize, axis: usize, layers: &[Crossing]) {
        let [Some(highest), Some(lowest)] = [layers.first(), layers.last()] else { return };
        let upper = grid.at(highest.cell.map(|i| i as isize));
        let at = [upper - grid.strides[axis], upper];
        let component = component as u8;
        self.segments.push(Segment { component, at });
        for (at, c, cells) in [(at[0], lowest, 1.0 - lowest.to_upper), (at[1], highest, highest.to_upper)] {
            self.sides.push(WallSide {
                component,
                at,
                triangle: c.triangle as u32,
                shares: c.shares,
                distance: cells.max(LEAST_DISTANCE) * self.spacing,
                velocity: 0.0,
                force: 0.0,
            });
        }
    }

    /// Sets the velocities of the nodes, m/s.
    pub fn set_velocities(&mut self, faces: &[[u32; 3]], velocities: &[Vector3<f64>]) {
        for side in &mut self.sides {
            let nodes = faces[side.triangle as usize];
            let of_node = |i: usize| side.shares[i] * velocities[nodes[i] as usize][side.component as usize];
            side.velocity = of_node(0) + of_node(1) + of_node(2);
        }
    }

    /// Component and positions of the two neighbours of each segment that the surface crosses.
    pub(crate) fn segments(&self) -> impl Iterator<Item = (usize, [usize; 2])> {
        self.segments.iter().map(|s| (s.component as usize, s.at))
    }

    /// Takes the viscous fluxes between values on different sides of the surface out of the rates (m/s2) of values at the positions `own`;
    /// `viscosity`: kinematic, m2/s.
    pub(crate) fn interrupt_fluxes(
        &self,
        viscosity: f64,
        u: &Velocity,
        own: &Range<usize>,
        rates: &mut Velocity,
    ) {
        let factor = viscosity / (self.spacing * self.spacing);
        for Segment { component, at: [low, high] } in &self.segments {
            let (u, rates) = (&u[*component as usize], &mut rates[*component as usize]);
            let flux = factor * (u[*high] - u[*low]);
            if own.contains(low) {
                rates[*low] -= flux;
            }
            if own.contains(high) {
                rates[*high] += flux;
            }
        }
    }

    /// Adds the wall stress over a step of `dt` s to the predicted velocity at the positions `own`; the forces of others are zero.
    pub(crate) fn apply(
        &mut self,
        density: f64,
        viscosity: f64,
        dt: f64,
        own: &Range<usize>,
        predicted: &mut Velocity,
    ) {
        let factor = viscosity * dt / self.spacing;
        let mass = density * self.spacing.powi(3);
        for sides in self.sides.chunk_by_mut(|a, b| (a.component, a.at) == (b.component, b.at)) {
            if !own.contains(&sides[0].at) {
                sides.iter_mut().for_each(|s| s.force = 0.0);
                continue;
            }
            let weight = 1.0 + sides.iter().map(|s| factor / s.distance).sum::<f64>();
            let u = &mut predicted[sides[0].component as usize][sides[0].at];
            let mut lost = 0.0;
            for i in 0..sides.len() {
                let own = sides[i];
                // The slip u* - w without the difference of large numbers that it is where the distance vanishes.
                let others =
                    sides.iter().map(|s| factor / s.distance * (s.velocity - own.velocity)).sum::<f64>();
                let change = factor / own.distance * (*u - own.velocity + others) / weight;
                sides[i].force = mass / dt * change;
                lost += change;
            }
            *u -= lost;
        }
    }

    /// Component and position of its value, distance and velocity of each side.
    pub(crate) fn sides(&self) -> impl Iterator<Item = ((u8, usize), f64, f64)> + '_ {
        self.sides.iter().map(|s| ((s.component, s.at), s.distance, s.velocity))
    }

    /// Whether segments and sides are those of `other`, whatever their velocities and forces.
    pub(crate) fn is_at_the_place_of(&self, other: &Self) -> bool {
        let place = |s: &WallSide| (s.component, s.at, s.distance);
        self.spacing == other.spacing
            && self.segments == other.segments
            && self.sides.iter().map(place).eq(other.sides.iter().map(place))
    }

    /// Width of a cell, m.
    pub(crate) fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Sets the force of each side in the last step, N.
    pub(crate) fn set_forces(&mut self, forces: &[f64]) {
        self.sides.iter_mut().zip(forces).for_each(|(side, force)| side.force = *force);
    }

    /// Adds the forces of the air on the nodes in the last step, N: those of this rank.
    pub fn add_node_forces(&self, faces: &[[u32; 3]], forces: &mut [Vector3<f64>]) {
        for side in &self.sides {
            for (node, share) in faces[side.triangle as usize].iter().zip(&side.shares) {
                forces[*node as usize][side.component as usize] += share * side.force;
            }
        }
    }

    /// Adds the forces of the air in the last step, N, to those on faces, three numbers for each: those of this rank. `face_of` is the face of
    /// each triangle.
    pub fn add_face_forces(&self, face_of: &[u32], forces: &mut [f64]) {
        for side in &self.sides {
            forces[3 * face_of[side.triangle as usize] as usize + side.component as usize] += side.force;
        }
    }

    /// Number of segments that the surface crosses.
    pub fn len(&self) -> usize {
        self.segments.len()
    }

    /// Whether the surface crosses no segment.
    pub fn is_empty(&self) -> bool {
        self.segments.is_empty()
    }
}
