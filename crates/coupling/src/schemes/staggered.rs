//! Staggered schemes: each program once in a window.

use case::{DescentEquation, LoadShape};

use super::extrapolate::Past;
use super::load_shape::shape_load;
use super::memory::{pack, unpack};
use super::sequence::{End, Sequence, Visit};
use super::{InterfaceState, Unknowns};
use crate::error::RunError;
use crate::partners::LoadOverWindow;

/// The structure's substeps under a load extrapolated with order $k$, then mesh, flow and
/// descent. $k = 0$ is the paper's sequence, of first order in time; from $k = 1$ on it is of
/// second order (load and the frame's velocity are then known to second order).
pub struct StructureFirst {
    order: usize,
    unknowns: Unknowns,
    loads: Past,
    velocities: Past,
    ahead: Vec<f64>,
}

impl StructureFirst {
    /// With this order of extrapolation.
    pub fn new(order: usize, unknowns: Unknowns, state: &InterfaceState) -> Self {
        let mut velocities = Past::default();
        velocities.push(&[state.velocity], 1.0);
        // A load known from an earlier stage belongs to windows of another length.
        Self { order, unknowns, loads: Past::default(), velocities, ahead: Vec::new() }
    }
}

impl Sequence for StructureFirst {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, _visit: &mut Visit<'_>, _x: &mut Vec<f64>) -> Result<(), RunError> {
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, _x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        let mut velocity = [visit.state.velocity];
        self.velocities.extrapolate(self.order, visit.window.dt, &mut velocity);
        visit.fall(velocity[0]);
        let start = visit.start_load()?;
        self.ahead.clone_from(&start);
        self.loads.extrapolate(self.order, visit.window.dt, &mut self.ahead);
        visit.structure_under(LoadOverWindow { start: &start, end: &self.ahead })?;
        let displacement = std::mem::take(&mut visit.end.displacement);
        let answer = visit.flow_around(&displacement);
        visit.end.displacement = displacement;
        answer?;
        visit.descend();
        self.unknowns.pack(&visit.end.displacement, visit.end.velocity, x_tilde);
        Ok(())
    }

    fn accept(&mut self, end: &End, _x: &[f64], _answer: &[f64], dt: f64) {
        self.loads.push(&end.load, dt);
        self.velocities.push(&[end.velocity], dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(&self.loads, &self.velocities))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        (self.loads, self.velocities) = unpack(memory)?;
        Ok(())
    }
}

/// Flow and descent on unknowns extrapolated with order $k$, then the structure under the flow's
/// answer (Piperno's generalised serial staggered scheme). Order in time $k + 1$, at most two.
pub struct FlowFirst {
    order: usize,
    load: LoadShape,
    unknowns: Unknowns,
    motions: Past,
    felt: [Vec<f64>; 2],
}

impl FlowFirst {
    /// With this order of extrapolation and shape of the load over the substeps.
    pub fn new(order: usize, load: LoadShape, unknowns: Unknowns, state: &InterfaceState) -> Self {
        let mut motions = Past::default();
        motions.push(&packed(&unknowns, state), 1.0);
        Self { order, load, unknowns, motions, felt: Default::default() }
    }
}

impl Sequence for FlowFirst {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        self.motions.extrapolate(self.order, visit.window.dt, x);
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        visit.fall(self.unknowns.velocity(x, visit.state.velocity));
        visit.flow_around(self.unknowns.displacement(x))?;
        structure_under_flow(visit, self.load, &mut self.felt)?;
        visit.descend();
        self.unknowns.pack(&visit.end.displacement, visit.end.velocity, x_tilde);
        Ok(())
    }

    fn accept(&mut self, _end: &End, _x: &[f64], answer: &[f64], dt: f64) {
        self.motions.push(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.motions)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.motions = unpack(memory)?;
        Ok(())
    }
}

/// Improved serial staggered (Lesoinne and Farhat 1998): the flow's windows end at the middles
/// of the structure's. The canopy is extrapolated there with order $k$; the flow's answer is the
/// load of the structure's whole window, whose middle it is. Second order in time for $k \ge 1$.
///
/// The state that the flow starts from stands half a window before the structure's: nothing
/// where the flow is developed or at rest.
pub struct HalfStep {
    order: usize,
    unknowns: Unknowns,
    motions: Past,
    load: Vec<f64>,
}

impl HalfStep {
    /// With this order of extrapolation.
    pub fn new(order: usize, unknowns: Unknowns, state: &InterfaceState) -> Self {
        let mut motions = Past::default();
        motions.push(&packed(&unknowns, state), 1.0);
        Self { order, unknowns, motions, load: Vec::new() }
    }
}

impl Sequence for HalfStep {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        self.motions.extrapolate(self.order, 0.5 * visit.window.dt, x);
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        visit.fall(self.unknowns.velocity(x, visit.state.velocity));
        let mut half = *visit.window;
        half.time -= 0.5 * half.dt;
        visit.flow_in(&half, self.unknowns.displacement(x))?;
        visit.state.load.get_or_insert_with(|| visit.end.load.clone());
        self.load.clone_from(&visit.end.load);
        if visit.descent.is_some_and(|d| d.equation == DescentEquation::QuasiSteady) {
            // The frame's mean acceleration over the structure's window follows from the same force.
            visit.descend();
            visit.window.frame_acceleration[2] =
                (visit.end.velocity - visit.state.velocity) / visit.window.dt;
            visit.structure_under(LoadOverWindow { start: &self.load, end: &self.load })?;
        } else {
            // It follows from the structure, whose own share of it is small: that of the window before.
            visit.window.frame_acceleration[2] = visit.state.acceleration;
            visit.structure_under(LoadOverWindow { start: &self.load, end: &self.load })?;
            visit.descend();
        }
        self.unknowns.pack(&visit.end.displacement, visit.end.velocity, x_tilde);
        Ok(())
    }

    fn accept(&mut self, _end: &End, _x: &[f64], answer: &[f64], dt: f64) {
        self.motions.push(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.motions)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.motions = unpack(memory)?;
        Ok(())
    }
}

/// The structure under the flow's answer, with a load shape over the substeps; an unknown load
/// at the start is that at the end.
pub(super) fn structure_under_flow(
    visit: &mut Visit<'_>,
    shape: LoadShape,
    felt: &mut [Vec<f64>; 2],
) -> Result<(), RunError> {
    visit.state.load.get_or_insert_with(|| visit.end.load.clone());
    let [felt_start, felt_end] = felt;
    felt_start.resize(visit.end.load.len(), 0.0);
    felt_end.resize(visit.end.load.len(), 0.0);
    shape_load(shape, visit.loads(&visit.end.load), felt_start, felt_end);
    visit.structure_under(LoadOverWindow { start: felt_start, end: felt_end })
}

/// The unknowns of a state.
pub(super) fn packed(unknowns: &Unknowns, state: &InterfaceState) -> Vec<f64> {
    let mut x = vec![0.0; unknowns.len()];
    unknowns.pack(&state.displacement, state.velocity, &mut x);
    if let Some(load) = &state.load {
        unknowns.pack_load(load, &mut x);
    }
    x
}
