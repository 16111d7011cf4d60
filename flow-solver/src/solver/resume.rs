//! What a saved state holds and how a run continues from it.

use std::path::Path;

use channel::Fault;
use serde::{Deserialize, Serialize};

use super::*;
use crate::implicit::MergedCells;
use crate::state::{self, Extras, Share};
use crate::turbulence::WallWarmStart;

/// What the solver of a rank keeps beside its share of the state, so that a run which is resumed on the same ranks
/// computes the same digits.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WarmStart {
    /// What pressure added to the mean momentum through local faces, newest first.
    pub ties: Vec<[f32; 2]>,
    /// Coarse cells of the pressure equation; none before they are merged.
    pub merged: Option<MergedCells>,
    /// Of transported turbulence.
    pub walls: Option<WallWarmStart>,
}

impl WarmStart {
    /// Whether it is of this part of the grid, and of numbers only.
    pub(crate) fn check(&self, part: &Topology) -> Result<(), &'static str> {
        if self.ties.len() != part.face_nodes.len() {
            return Err("it is of another part of the grid");
        }
        if !self.ties.as_flattened().iter().all(|x| x.is_finite()) {
            return Err("what passed the faces is not finite");
        }
        self.walls.as_ref().map_or(Ok(()), |walls| walls.check(part.n_owned, part.node_global.len()))
    }
}

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Writes the last two accepted instants. `totals`: cells and nodes of the whole grid. Collective.
    ///
    /// # Errors
    /// Trouble with the file, on every rank.
    pub fn save(&self, file: &Path, totals: (usize, usize)) -> Result<(), Fault> {
        let ties: Vec<[f64; 2]> = self.through.iter().map(|t| t.past.map(f64::from)).collect();
        let share = Share {
            topology: &self.topology,
            q: [0, 1].map(|k| &self.past[k].q[..]),
            nodes: [0, 1].map(|k| self.past_nodes(k)),
            last_dt: self.last_dt,
            first_order_steps: self.first_order_steps,
            ties: &ties,
            extras: &self.extras(),
        };
        state::save(file, self.comm(), &share, totals)
    }

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

    /// What this rank keeps beside its share of the state.
    pub fn warm_start(&self) -> WarmStart {
        WarmStart {
            ties: self.through.iter().map(|t| t.past).collect(),
            merged: self.correction.merged(),
            walls: self.turbulence().map(SpalartAllmaras::walls),
        }
    }

    /// Continues with a [`Solver::warm_start`] of the same part of the grid, after the state. Collective.
    ///
    /// # Errors
    /// On every rank, what does not fit on one of them.
    pub fn restore_warm_start(&mut self, warm: WarmStart) -> Result<(), String> {
        let merged = u64::from(warm.merged.is_some());
        if self.comm().all_gather_u64(merged).iter().any(|m| *m != merged) {
            return Err("not all ranks have merged cells".into());
        }
        if let Some(merged) = warm.merged {
            self.correction.restore_state(merged, &self.topology.adjacency, &self.halo)?;
        }
        self.restore_ties(&warm.ties);
        if let (Some(turbulence), Some(walls)) = (&mut self.turbulence, warm.walls) {
            turbulence.restore_state(walls);
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
            // The motion of the grid before it came to rest is not distinguished any more.
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
