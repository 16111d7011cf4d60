//! Implicit schemes: what one iteration of a window is.

use case::LoadShape;

use super::memory::{pack, unpack};
use super::sequence::{End, Sequence, Visit};
use super::staggered::{packed, structure_under_flow};
use super::{InterfaceState, Predictor, Unknowns, shape_load};
use crate::error::RunError;
use crate::partners::LoadOverWindow;

/// Gauss-Seidel: mesh and flow at the iterate, structure under the flow's answer, descent under
/// the flow's force. The unknowns are displacement and descent speed.
pub struct GaussSeidel {
    load: LoadShape,
    unknowns: Unknowns,
    predictor: Predictor,
    felt: [Vec<f64>; 2],
}

impl GaussSeidel {
    /// With this shape of the load over the substeps.
    pub fn new(load: LoadShape, unknowns: Unknowns, state: &InterfaceState) -> Self {
        Self { load, unknowns, predictor: started(&unknowns, state), felt: Default::default() }
    }
}

impl Sequence for GaussSeidel {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        self.predictor.predict(visit.window.dt, x);
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
        self.predictor.accept(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.predictor)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.predictor = unpack(memory)?;
        Ok(())
    }
}

/// Jacobi: flow at the displacement of the iterate, structure under its load, neither knowing the
/// other's answer. The unknowns are displacement, descent speed and load.
pub struct Jacobi {
    load: LoadShape,
    unknowns: Unknowns,
    predictor: Predictor,
    iterate: Vec<f64>,
    felt: [Vec<f64>; 2],
}

impl Jacobi {
    /// With this shape of the load over the substeps; `unknowns` hold loads.
    pub fn new(load: LoadShape, unknowns: Unknowns, state: &InterfaceState) -> Self {
        let predictor = if state.load.is_some() { started(&unknowns, state) } else { Predictor::new(2) };
        let faces = vec![0.0; unknowns.loads()];
        Self { load, unknowns, predictor, iterate: faces.clone(), felt: [faces.clone(), faces] }
    }
}

impl Sequence for Jacobi {
    fn iterates(&self) -> bool {
        true
    }

    fn predict(&mut self, visit: &mut Visit<'_>, x: &mut Vec<f64>) -> Result<(), RunError> {
        self.predictor.predict(visit.window.dt, x);
        Ok(())
    }

    fn visit(&mut self, visit: &mut Visit<'_>, x: &[f64], x_tilde: &mut [f64]) -> Result<(), RunError> {
        visit.fall(self.unknowns.velocity(x, visit.state.velocity));
        let known = visit.state.load.is_some();
        visit.flow_around(self.unknowns.displacement(x))?;
        if known {
            self.unknowns.load(x, &mut self.iterate);
        } else {
            // Nothing was known to iterate from: this once the structure follows the flow.
            self.iterate.clone_from(&visit.end.load);
        }
        visit.state.load.get_or_insert_with(|| visit.end.load.clone());
        let [felt_start, felt_end] = &mut self.felt;
        let loads = visit.loads(&self.iterate);
        shape_load(self.load, loads, felt_start, felt_end);
        visit.structure_under(LoadOverWindow { start: felt_start, end: felt_end })?;
        visit.descend();
        self.unknowns.pack(&visit.end.displacement, visit.end.velocity, x_tilde);
        self.unknowns.pack_load(&visit.end.load, x_tilde);
        Ok(())
    }

    fn accept(&mut self, _end: &End, _x: &[f64], answer: &[f64], dt: f64) {
        self.predictor.accept(answer, dt);
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.predictor)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.predictor = unpack(memory)?;
        Ok(())
    }
}

fn started(unknowns: &Unknowns, state: &InterfaceState) -> Predictor {
    let mut predictor = Predictor::new(2);
    predictor.accept(&packed(unknowns, state), 1.0);
    predictor
}
