//! The programs as partners of a coupling scheme.

use std::path::Path;

use case::Role;
use channel::{HubError, LOAD_WIDTH, Window, flow_stats, mesh_stats, structure_stats};
use coupling::error::RunError;
use coupling::partners::{LoadOverWindow, Partners, SolverResponse, Usage};
use coupling::structure_energy::EnergyCreated;

use super::HubPartners;
use super::failure::stuck;

/// What a program announces that starts a window again with another length.
const VARIES: &str = "coupling.adaptive";

/// Puts rows of `width` numbers at their places in `all`.
pub(super) fn scatter(rows: &[u64], data: &[f64], width: usize, all: &mut [f64]) {
    for (row, values) in rows.iter().zip(data.chunks_exact(width)) {
        all[*row as usize * width..][..width].copy_from_slice(values);
    }
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
        let answer = self.structure_on(w, load, displacement, own.as_mut());
        self.own = own;
        let answer = answer?;
        if answer.stats.values[structure_stats::RESIDUAL] >= 0.0 {
            return match EnergyCreated::check(&answer.stats.values, w.time + w.dt) {
                Some(energy) => Err(RunError::Energy { place: self.place.clone(), energy, saved: None }),
                None => Ok(answer),
            };
        }
        let cuts = answer.stats.values[structure_stats::STEP_CUTS];
        let what = format!("a time step has no solution, also after {cuts} halvings");
        Err(self.no_answer(Role::Structure, &what, "smaller steps (stage.substeps), more damping"))
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError> {
        let _part = timing::part("mesh");
        let mut fill = |input: &mut [f64]| input.copy_from_slice(displacement);
        let mut grid = std::mem::take(&mut self.grid);
        let mut keep = |rows: &[u64], data: &[f64]| {
            if !grid.is_empty() {
                scatter(rows, data, 6, &mut grid);
            }
        };
        let answer = self.advance(Role::Mesh, w, &mut fill, &mut keep);
        self.grid = grid;
        let answer = answer?;
        if answer.stats.values[mesh_stats::STUCK] == 0.0 {
            return Ok(answer);
        }
        let message = stuck(&answer.stats.values, &self.panels);
        Err(RunError::GridMotionFailed { place: self.place.clone(), message, saved: None })
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError> {
        let _part = timing::part("flow");
        let mut keep = |rows: &[u64], data: &[f64]| scatter(rows, data, LOAD_WIDTH, load);
        let answer = self.advance(Role::Flow, w, &mut |_| {}, &mut keep)?;
        let values = &answer.stats.values;
        let what = match values[flow_stats::NO_ANSWER] {
            0.0 => return Ok(answer),
            1.0 => format!(
                "its iterations diverged: residual {:.3e} after {} iterations from {:.3e}",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START]
            ),
            2.0 => "its state left what is physical".into(),
            4.0 => format!(
                "its time step is not solved: residual {:.3e} N after {} iterations from {:.3e} N, {:.3e} N is asked",
                values[flow_stats::RESIDUAL_END],
                values[flow_stats::ITERATIONS],
                values[flow_stats::RESIDUAL_START],
                values[flow_stats::RESIDUAL_TARGET]
            ),
            _ => "a cell of the moved grid has no volume".into(),
        };
        Err(self.no_answer(Role::Flow, &what, "more flow.solver.max_iterations, a larger first_layer_m"))
    }

    fn fixed_windows(&self) -> Vec<String> {
        let fixed = |role: &Role| {
            let a = self.hub.announcement(*role)?;
            let varies = a.effects.iter().any(|e| e == VARIES);
            (!varies).then(|| format!("{} ({})", role.program(), a.program))
        };
        Role::ALL.iter().filter_map(fixed).collect()
    }

    fn without_support_force(&self) -> Option<String> {
        let a = self.hub.announcement(Role::Structure)?;
        let balanced = a.effects.iter().any(|e| e == channel::SUPPORT_FORCE);
        (!balanced).then(|| format!("{} ({})", Role::Structure.program(), a.program))
    }

    fn accept(&mut self, w: &Window) -> Result<(), RunError> {
        let _part = timing::part("accept");
        self.ask(|hub, watch| {
            // Short windows never wait long enough for the hub to look by itself.
            watch.look().map_err(HubError::Aborted)?;
            hub.accept(w, &mut || watch.look())
        })?;
        if let Some(own) = &mut self.own {
            own.accept();
        }
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), RunError> {
        let _part = timing::part("save");
        self.ask(|hub, watch| hub.save(folder, &mut || watch.look()))
    }

    fn snapshot(&mut self, role: Role, time: f64, folder: &Path) -> Result<(), RunError> {
        let _part = timing::part("snapshot");
        self.ask(|hub, watch| hub.snapshot(&[role], time, folder, &mut || watch.look()))
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
