//! Saving a state, and restarting from one.

use std::path::Path;

use channel::Fault;
use serde::{Deserialize, Serialize};

use super::*;
use crate::implicit::MergedCells;
use crate::state::{self, Extras, RankState};
use crate::turbulence::WallDistances;

/// Warm-start data of the solver on one rank: with it, a run resumed on the same number of ranks is bitwise
/// identical to an uninterrupted one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WarmStart {
    /// Rhie-Chow (momentum interpolation) flux of local faces at two time levels, newest first, kg/(m2 s).
    pub rhie_chow_fluxes: Vec<[f32; 2]>,
    /// Coarse cells of the pressure equation; none before they are merged.
    pub merged: Option<MergedCells>,
    /// Of transported turbulence.
    pub walls: Option<WallDistances>,
    /// Whether the last step needed few solves.
    pub few_solves_before: bool,
}

impl WarmStart {
    /// Whether it is of this part of the grid, and of numbers only.
    pub(crate) fn check(&self, part: &Topology) -> Result<(), &'static str> {
        if self.rhie_chow_fluxes.len() != part.face_nodes.len() {
            return Err("it is of another part of the grid; use the same scene and number of ranks");
        }
        if !self.rhie_chow_fluxes.as_flattened().iter().all(|x| x.is_finite()) {
            return Err("its Rhie-Chow fluxes are not finite numbers");
        }
        self.walls.as_ref().map_or(Ok(()), |walls| walls.check(part.n_owned, part.node_global.len()))
    }
}

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Writes the last two accepted time levels. `totals`: cells and nodes of the whole grid. Collective.
    ///
    /// # Errors
    /// The file cannot be written; returned on every rank.
    pub fn save(&self, file: &Path, totals: (usize, usize)) -> Result<(), Fault> {
        let rhie_chow_fluxes: Vec<[f64; 2]> =
            self.face_flux.iter().map(|t| t.previous.map(f64::from)).collect();
        let share = RankState {
            topology: &self.topology,
            q: [0, 1].map(|k| &self.previous[k].q[..]),
            nodes: [0, 1].map(|k| self.previous_nodes(k)),
            last_dt: self.last_dt,
            first_order_steps: self.first_order_steps,
            rhie_chow_fluxes: &rhie_chow_fluxes,
            extras: &self.extras(),
        };
        state::save(file, self.comm(), &share, totals)
    }

    /// Returns the data of optional effects in the state. Collective.
    pub fn extras(&self) -> Extras {
        let gather = |t: &SpalartAllmaras| {
            let cells = self.comm().sum(self.topology.n_owned as f64) as usize;
            [0, 1].map(|k| {
                state::gather(
                    self.comm(),
                    self.topology.numbering.owned(),
                    &t.previous[k][..self.topology.n_owned],
                    cells,
                )
            })
        };
        Extras { height: self.shear.as_ref().map(|s| s.height), turbulence: self.turbulence().map(gather) }
    }

    /// Returns the warm-start data of this rank.
    pub fn warm_start(&self) -> WarmStart {
        WarmStart {
            rhie_chow_fluxes: self.face_flux.iter().map(|t| t.previous).collect(),
            merged: self.correction.merged(),
            walls: self.turbulence().map(SpalartAllmaras::walls),
            few_solves_before: self.few_solves_before,
        }
    }

    /// Continues with a [`Solver::warm_start`] of the same part of the grid, after the state. Collective.
    ///
    /// # Errors
    /// On every rank, if the data of any rank does not fit.
    pub fn restore_warm_start(&mut self, warm: WarmStart) -> Result<(), String> {
        let merged = u64::from(warm.merged.is_some());
        if self.comm().all_gather_u64(merged).iter().any(|m| *m != merged) {
            return Err("some ranks have no coarse cells of the pressure multigrid".into());
        }
        if let Some(merged) = warm.merged {
            self.correction.restore_state(merged, &self.topology.adjacency, &self.halo)?;
        }
        self.restore_rhie_chow(&warm.rhie_chow_fluxes);
        self.few_solves_before = warm.few_solves_before;
        if let (Some(turbulence), Some(walls)) = (&mut self.turbulence, warm.walls) {
            turbulence.restore_state(walls);
        }
        Ok(())
    }

    /// Restores the data of optional effects from a saved state.
    pub fn restore_extras(&mut self, extras: &Extras) {
        if let (Some(shear), Some(height)) = (&mut self.shear, extras.height) {
            shear.restore(height);
        }
        if let (Some(turbulence), Some(saved)) = (&mut self.turbulence, &extras.turbulence) {
            for (previous, saved) in turbulence.previous.iter_mut().zip(saved) {
                for (x, &g) in previous.iter_mut().zip(&self.topology.numbering.global) {
                    *x = [saved[g as usize]];
                }
            }
            turbulence.value.copy_from_slice(&turbulence.previous[0]);
        }
    }

    /// Restores two saved time levels. Collective.
    pub fn restore(
        &mut self,
        previous: [TimeLevel<N>; 2],
        last_dt: f64,
        first_order_steps: u32,
    ) -> Result<(), FlowError> {
        let moving = self.settings.moving;
        self.previous = previous;
        self.last_dt = last_dt;
        self.first_order_steps = first_order_steps;
        for k in [1, 0] {
            self.nodes.copy_from_slice(&self.previous[k].nodes);
            self.metrics.update(&self.topology, &self.halo, &self.nodes);
            self.previous[k].volume = if moving { self.metrics.volume.clone() } else { Vec::new() };
        }
        self.check_volumes()?;
        self.least_squares.update(&self.topology, &self.metrics);
        let [now, before] = &mut self.previous;
        if moving {
            self.swept.resize(self.topology.face_nodes.len(), 0.0);
            self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
            Metrics::swept(&self.topology, &before.nodes, &now.nodes, &mut self.swept_before);
            self.swept.fill(0.0);
        } else {
            // A fixed grid needs no node positions of earlier time levels.
            (now.nodes, before.nodes) = (Vec::new(), Vec::new());
        }
        self.q.copy_from_slice(&self.previous[0].q);
        self.face_flux.fill(FaceFlux::default());
        self.rhie_chow_is_reset = true;
        if let Some(turbulence) = &self.turbulence {
            turbulence.eddy(&self.densities(), &mut self.eddy, &mut self.working);
        }
        Ok(())
    }

    /// Replaces the unknowns of local cells at both accepted time levels by `q`; grid and step stay.
    pub fn restart_with(&mut self, q: &[[f64; N]]) {
        for level in &mut self.previous {
            level.q.copy_from_slice(q);
        }
    }

    /// Restores the Rhie-Chow fluxes of the last two time levels, kg/(m2 s). Without this call they start from zero.
    pub fn restore_rhie_chow(&mut self, rhie_chow_fluxes: &[[f32; 2]]) {
        for (t, previous) in self.face_flux.iter_mut().zip(rhie_chow_fluxes) {
            t.previous = *previous;
        }
        self.rhie_chow_is_reset = false;
    }
}
