//! What a saved state holds and how a run continues from it.

use super::*;
use crate::remembered::{Memory, Shape};

impl<G: Gas<N>, V: Viscosity, const N: usize> Solver<G, V, N> {
    /// What else the state holds. Collective.
    pub fn extras(&self) -> Extras {
        let gather = |t: &SpalartAllmaras| {
            let cells = self.comm().sum(self.topology.n_owned as f64) as usize;
            [0, 1].map(|k| {
                state::gather(
                    self.comm(),
                    self.topology.numbering.owned(),
                    &t.past[k][..self.topology.n_owned],
                    cells,
                )
            })
        };
        Extras { height: self.shear.as_ref().map(|s| s.height), turbulence: self.turbulence().map(gather) }
    }

    /// What this rank remembers beside its share of the state.
    pub fn memory(&self) -> Memory {
        Memory {
            ties: self.through.iter().map(|t| t.past).collect(),
            merged: self.correction.merged(),
            walls: self.turbulence().map(SpalartAllmaras::walls),
            probes: Vec::new(),
        }
    }

    /// What a memory of this part of the grid must fit.
    pub fn shape(&self) -> Shape {
        Shape {
            cells: self.topology.n_owned,
            faces: self.metrics.faces.len(),
            flows: self.through.len(),
            nodes: self.topology.node_global.len(),
        }
    }

    /// Takes up a [`Solver::memory`] that fits [`Solver::shape`], after the state. Collective.
    ///
    /// # Errors
    /// On every rank, what does not fit on one of them.
    pub fn recall(&mut self, memory: Memory) -> Result<(), String> {
        let merged = u64::from(memory.merged.is_some());
        if self.comm().all_gather_u64(merged).iter().any(|m| *m != merged) {
            return Err("not all ranks have merged cells".into());
        }
        if let Some(merged) = memory.merged {
            self.correction.recall(merged, &self.topology.adjacency, &self.halo)?;
        }
        self.restore_ties(&memory.ties);
        if let (Some(turbulence), Some(walls)) = (&mut self.turbulence, memory.walls) {
            turbulence.recall(walls);
        }
        Ok(())
    }

    /// Continues with what else a saved state held.
    pub fn restore_extras(&mut self, extras: &Extras) {
        if let (Some(shear), Some(height)) = (&mut self.shear, extras.height) {
            shear.restore(height);
        }
        if let (Some(turbulence), Some(saved)) = (&mut self.turbulence, &extras.turbulence) {
            for (past, saved) in turbulence.past.iter_mut().zip(saved) {
                for (x, &g) in past.iter_mut().zip(&self.topology.numbering.global) {
                    *x = [saved[g as usize]];
                }
            }
            turbulence.value.copy_from_slice(&turbulence.past[0]);
        }
    }

    /// Continues from two saved instants. Collective.
    pub fn restore(
        &mut self,
        past: [Instant<N>; 2],
        last_dt: f64,
        first_order_steps: u32,
    ) -> Result<(), FlowError> {
        let moving = self.settings.moving;
        self.past = past;
        self.last_dt = last_dt;
        self.first_order_steps = first_order_steps;
        for k in [1, 0] {
            self.nodes.copy_from_slice(&self.past[k].nodes);
            self.metrics.update(&self.topology, &self.halo, &self.nodes);
            self.past[k].volume = if moving { self.metrics.volume.clone() } else { Vec::new() };
        }
        self.check_volumes()?;
        self.least_squares.update(&self.topology, &self.metrics);
        let [now, before] = &mut self.past;
        if moving {
            self.swept.resize(self.topology.face_nodes.len(), 0.0);
            self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
            Metrics::swept(&self.topology, &before.nodes, &now.nodes, &mut self.swept_before);
            self.swept.fill(0.0);
        } else {
            // What the grid did before it came to rest is no longer told apart.
            (now.nodes, before.nodes) = (Vec::new(), Vec::new());
        }
        self.q.copy_from_slice(&self.past[0].q);
        self.through.fill(FaceFlow::default());
        self.ties_are_new = true;
        if let Some(turbulence) = &self.turbulence {
            turbulence.eddy(&self.densities(), &mut self.eddy);
        }
        Ok(())
    }

    /// Continues with what pressure added to the mean momentum through the faces at the
    /// last two instants. Without this it starts from nothing.
    pub fn restore_ties(&mut self, ties: &[[f32; 2]]) {
        for (t, past) in self.through.iter_mut().zip(ties) {
            t.past = *past;
        }
        self.ties_are_new = false;
    }
}
