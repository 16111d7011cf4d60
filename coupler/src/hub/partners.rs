//! [`Partners`] of a coupling scheme, implemented by the programs of a session.

use std::path::Path;
use std::time::Instant;

use case::Role;
use channel::{HubError, LOAD_WIDTH, Stats, Window, flow_stats, mesh_stats, structure_stats};
use coupling::error::RunError;
use coupling::partners::{AcceptCost, LoadOverWindow, Partners, SolverResponse, Usage};
use coupling::structure_energy::EnergyCreated;

use super::HubPartners;
use super::failure::grid_motion_failure;

/// Effect of a program that can retry a window with another length.
pub(super) const VARIABLE_WINDOWS: &str = "coupling.adaptive";

/// Copies rows of `width` values to their indices in `all`.
pub(super) fn scatter(rows: &[u64], data: &[f64], width: usize, all: &mut [f64]) {
    for (row, values) in rows.iter().zip(data.chunks_exact(width)) {
        all[*row as usize * width..][..width].copy_from_slice(values);
    }
}

/// Response of the mesh where none runs: the canopy moves through the grid, whose cells do not change.
fn resting_grid() -> SolverResponse {
    let mut stats = Stats::default();
    stats.values[mesh_stats::MIN_QUALITY] = 1.0;
    stats.values[mesh_stats::MIN_VOLUME_RATIO] = 1.0;
    stats.values[mesh_stats::WORST_CELL] = -1.0;
    SolverResponse { stats, wall_s: 0.0 }
}

impl Partners for HubPartners<'_> {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError> {
        let _part = timing::part("structure");
        let mut own = self.own.take();
        let response = self.structure_on_surface(w, load, displacement, own.as_mut());
        self.own = own;
        let response = response?;
        if response.stats.values[structure_stats::RESIDUAL] >= 0.0 {
            return match EnergyCreated::check(&response.stats.values, w.time + w.dt) {
                Some(energy) => Err(RunError::Energy { place: self.place.clone(), energy, saved: None }),
                None => Ok(response),
            };
        }
        let cuts = response.stats.values[structure_stats::STEP_CUTS];
        let what = format!("a time step did not converge after {cuts} halvings");
        Err(self.solve_failed(Role::Structure, &what, "smaller steps (stage.substeps), more damping"))
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError> {
        if !self.has_mesh {
            self.displacement.copy_from_slice(displacement);
            return Ok(resting_grid());
        }
        let _part = timing::part("mesh");
        let mut fill = |input: &mut [f64]| input.copy_from_slice(displacement);
        let mut grid = std::mem::take(&mut self.grid);
        let mut keep = |rows: &[u64], data: &[f64]| {
            if !grid.is_empty() {
                scatter(rows, data, 6, &mut grid);
            }
        };
        let response = self.advance(Role::Mesh, w, &mut fill, &mut keep);
        self.grid = grid;
        let response = response?;
        if response.stats.values[mesh_stats::STUCK] == 0.0 {
            return Ok(response);
        }
        let message = grid_motion_failure(&response.stats.values, &self.panels);
        Err(RunError::GridMotionFailed { place: self.place.clone(), message, saved: None })
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError> {
        let _part = timing::part("flow");
        let mut keep = |rows: &[u64], data: &[f64]| scatter(rows, data, LOAD_WIDTH, load);
        let displacement = std::mem::take(&mut self.displacement);
        // Without the effect `canopy.motion` the flow has no input.
        let mut fill = |input: &mut [f64]| input.copy_from_slice(&displacement[..input.len()]);
        let response = self.advance(Role::Flow, w, &mut fill, &mut keep);
        self.displacement = displacement;
        let response = response?;
        let values = &response.stats.values;
        let what = match values[flow_stats::NO_ANSWER] {
            0.0 => return Ok(response),
            1.0 => format!(
                "the nonlinear iterations diverged: residual {:.3e} after {} iterations, initially {:.3e}",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START]
            ),
            2.0 => "its state became unphysical".into(),
            4.0 => format!(
                "the time step did not converge: residual {:.3e} N after {} iterations, initially {:.3e} N, tolerance {:.3e} N",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START],
                values[flow_stats::RESIDUAL_TARGET]
            ),
            _ => "a cell of the moved grid has a volume that is not positive".into(),
        };
        Err(self.solve_failed(Role::Flow, &what, "more flow.solver.max_iterations, a larger first_layer_m"))
    }

    fn fixed_windows(&self) -> Vec<String> {
        let fixed = |role: &Role| {
            let a = self.hub.announcement(*role)?;
            (!self.varies_windows(*role)).then(|| format!("{} ({})", role.program(), a.program))
        };
        Role::ALL.iter().filter_map(fixed).collect()
    }

    fn without_support_force(&self) -> Option<String> {
        let a = self.hub.announcement(Role::Structure)?;
        let balanced = a.effects.iter().any(|e| e == channel::SUPPORT_FORCE);
        (!balanced).then(|| format!("{} ({})", Role::Structure.program(), a.program))
    }

    fn accept(&mut self, w: &Window) -> Result<AcceptCost, RunError> {
        let _part = timing::part("accept");
        let start = Instant::now();
        let worked = self.request(|hub, watch| {
            // In short windows the hub never waits long enough to call the check itself.
            watch.check().map_err(HubError::Aborted)?;
            hub.accept(w, &mut || watch.check())
        })?;
        if let Some(own) = &mut self.own {
            own.accept();
        }
        let mut busy_s = [0.0; 3];
        worked.into_iter().for_each(|(role, seconds)| busy_s[role as usize] = seconds);
        Ok(AcceptCost { busy_s, wall_s: start.elapsed().as_secs_f64() })
    }

    fn save(&mut self, folder: &Path) -> Result<(), RunError> {
        let _part = timing::part("save");
        self.request(|hub, watch| hub.save(folder, &mut || watch.check()))
    }

    fn snapshot(&mut self, role: Role, time: f64, folder: &Path) -> Result<(), RunError> {
        let _part = timing::part("snapshot");
        self.request(|hub, watch| hub.snapshot(&[role], time, folder, &mut || watch.check()))
    }

    fn cannot_resume(&self) -> Vec<String> {
        let missing = Role::ALL.into_iter().filter(|r| !self.resumes(*r));
        missing.map(|r| self.supervisor.name(r)).collect()
    }

    fn used(&self) -> Vec<(Role, Usage)> {
        self.supervisor.usage()
    }

    fn grid(&self) -> Option<&[f64]> {
        (!self.grid.is_empty()).then_some(&self.grid)
    }
}
