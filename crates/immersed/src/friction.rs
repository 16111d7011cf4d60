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
//! The wall stress of a step acts on the velocity that convection, the stress between the other values and the pressure would give. With the stiffness
//! $`z = \Delta t\, \tfrac{\nu}{h} \sum_j \tfrac{1}{\delta_j}`$ of a value, the weighted mean W of the velocities of its walls at the start (0) and the end (1) of the step, the velocity $`\hat u`$
//! after convection, and the rate g of pressure and pressure jumps in the step before ([`WallRates`]),
//! ```math
//! s_0 = u^n - W_0, \qquad \Delta = \hat u + \Delta t\, g - u^n - (W_1 - W_0), \qquad
//! \bar s = \frac{(1 + z/2)\, s_0 + (1 + z)/2\; \Delta}{1 + z + z^2/2}
//! ```
//! is the mean slip: of second order in the step, and for any z the slip $`s_0 + \Delta - z \bar s`$ at its end decays (Padé approximant (0, 2), L-stable). The distance may
//! vanish, and the limit of the step is that of the air without walls. The side j takes
//! $`\Delta t\, \tfrac{\nu}{h \delta_j} (\bar s + \bar W - \bar w_j)`$ from the velocity; its force on the surface is $`\rho h^3 / \Delta t`$ times that: what the air loses in the step, to round-off.
//!
//! Without the rate g friction would hold back what the pressure has not yet moved, an error of first order in the step. A value that was not next to the surface in the step before has none, and neither has the first step, whose
//! pressure is an impulse.

use std::ops::Range;

use nalgebra::Vector3;

use crate::cut_faces::{Crossing, OutsideCore, Rasteriser};
use crate::grid::{Grid, Velocity};
use crate::wall_rates::{WallRates, WallValue};

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
    /// Velocity of the surface at the start and the end of a step, m/s.
    velocity: [f64; 2],
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
                velocity: [0.0; 2],
                force: 0.0,
            });
        }
    }

    /// Sets the velocities of the nodes, m/s, the same over the next step.
    pub fn set_velocities(&mut self, faces: &[[u32; 3]], velocities: &[Vector3<f64>]) {
        self.set_velocities_over(faces, [velocities; 2]);
    }

    /// Sets the velocities of the nodes at the start and the end of the next step, m/s.
    pub fn set_velocities_over(&mut self, faces: &[[u32; 3]], velocities: [&[Vector3<f64>]; 2]) {
        for side in &mut self.sides {
            let nodes = faces[side.triangle as usize];
            side.velocity = velocities.map(|velocities| {
                let of_node =
                    |i: usize| side.shares[i] * velocities[nodes[i] as usize][side.component as usize];
                of_node(0) + of_node(1) + of_node(2)
            });
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

    /// Component and position of each value next to the surface, ascending.
    pub(crate) fn values(&self) -> impl Iterator<Item = WallValue> + '_ {
        self.sides
            .chunk_by(|a, b| (a.component, a.at) == (b.component, b.at))
            .map(|s| (s[0].component, s[0].at as u32))
    }

    /// Adds the wall stress over a step to the predicted velocity at the positions `own`; the forces of others are zero.
    pub(crate) fn apply(&mut self, step: &WallStep<'_>, own: &Range<usize>, predicted: &mut Velocity) {
        let factor = step.viscosity * step.dt / self.spacing;
        let force = step.density * self.spacing.powi(3) / step.dt;
        let values = self.sides.chunk_by_mut(|a, b| (a.component, a.at) == (b.component, b.at));
        for (sides, start) in values.zip(step.start) {
            let (component, at) = (sides[0].component, sides[0].at);
            if !own.contains(&at) {
                sides.iter_mut().for_each(|s| s.force = 0.0);
                continue;
            }
            let u = &mut predicted[usize::from(component)][at];
            let change = *u + step.dt * step.rates.of((component, at as u32)) - start;
            *u -= lose(sides, factor, *start, change, force);
        }
    }

    /// Component and position of its value, distance, and velocities of each side.
    pub(crate) fn sides(&self) -> impl Iterator<Item = ((u8, usize), f64, [f64; 2])> + '_ {
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

/// A step as the wall stress needs it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WallStep<'a> {
    /// Density, kg/m3, kinematic viscosity, m2/s, and length of the step, s.
    pub(crate) density: f64,
    pub(crate) viscosity: f64,
    pub(crate) dt: f64,
    /// Velocity of each of [`Friction::values`] at the start of the step, m/s.
    pub(crate) start: &'a [f64],
    pub(crate) rates: &'a WallRates,
}

/// What the sides of one value take of its velocity, m/s; they get their forces, `force` (kg/s) times that. `factor`: $`\Delta t\, \nu / h`$; `start`: velocity at the start of the step,
/// `change`: what it would change in the step without them.
fn lose(sides: &mut [WallSide], factor: f64, start: f64, change: f64, force: f64) -> f64 {
    let z = sides.iter().map(|s| factor / s.distance).sum::<f64>();
    if z == 0.0 {
        sides.iter_mut().for_each(|side| side.force = 0.0);
        return 0.0;
    }
    let mean = |of: fn(&WallSide) -> f64| sides.iter().map(|s| factor / s.distance * of(s)).sum::<f64>() / z;
    let [first, last] = [mean(|s| s.velocity[0]), mean(|s| s.velocity[1])];
    let (slip, change) = (start - first, change - (last - first));
    let slip = ((1.0 + 0.5 * z) * slip + 0.5 * (1.0 + z) * change) / (1.0 + z + 0.5 * z * z);
    let mut lost = 0.0;
    for i in 0..sides.len() {
        let own = sides[i];
        // The slip at this side without the difference of large numbers that it is where the distance vanishes.
        let middle = |s: &WallSide| 0.5 * (s.velocity[0] + s.velocity[1]);
        let others = sides.iter().map(|s| factor / s.distance * (middle(s) - middle(&own))).sum::<f64>() / z;
        let change = factor / own.distance * (slip + others);
        sides[i].force = force * change;
        lost += change;
    }
    lost
}
