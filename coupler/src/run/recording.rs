//! A stage with optional recording and comparison of its messages.

use std::sync::atomic::Ordering;

use case::Role;
use coupling::error::RunError;
use coupling::partners::Partners;
use coupling::schemes::InterfaceState;
use results::recording::compare::Comparison;
use results::recording::{Baseline, Header, Reader, Recorder, Writer, stage_file};
use results::summary::StageSummary;

use super::options::{RecordOptions, RunOptions};
use crate::hub::HubPartners;
use crate::stages::StageContext;

/// Runs a stage with `partners` from `state`, which is updated to its end; records and compares it according to
/// `options`. Also returns the interrupt, if the stage was interrupted between two windows.
pub(super) fn exchange<'a>(
    context: &StageContext<'_>,
    options: &RunOptions,
    partners: HubPartners<'a>,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(HubPartners<'a>, Option<RunError>), RunError> {
    let grid_nodes = partners.grid().map_or(0, |g| g.len() as u64 / 6);
    let mut exchange = Exchange { context, options, grid_nodes, state, summary, interrupted: None };
    let partners = exchange.compared(partners)?;
    if let Some(record) = &options.record {
        results::state::copy_states(context.scene, context.stage + 1, context.out, &record.folder)?;
    }
    Ok((partners, exchange.interrupted))
}

/// A stage with its recording and comparison.
struct Exchange<'a> {
    context: &'a StageContext<'a>,
    options: &'a RunOptions,
    /// Nodes of the moving grid; 0 if it is neither recorded nor compared.
    grid_nodes: u64,
    state: &'a mut InterfaceState,
    summary: &'a mut StageSummary,
    /// The interrupt, if the stage was interrupted between two windows.
    interrupted: Option<RunError>,
}

impl Exchange<'_> {
    /// Runs the stage and compares it with the baseline, if there is one.
    fn compared<'a>(&mut self, partners: HubPartners<'a>) -> Result<HubPartners<'a>, RunError> {
        let (context, name) = (self.context, &self.context.scene.stages[self.context.stage].name);
        let baseline = self.options.baseline.as_ref().map(|b| (b, stage_file(&b.folder, name)));
        // A stage that the baseline does not have is not compared.
        let Some((baseline, file)) = baseline.filter(|b| b.1.is_file()) else {
            return self.recorded(partners);
        };
        let mut reader = Reader::open(&file)?;
        if let Some(p) = context.resumed {
            reader.skip_windows(p.windows)?;
        }
        let mut comparison = Comparison::new(baseline.tolerance).judging_counts(baseline.iteration_tolerance);
        let compared = Baseline::new(partners, reader, &mut comparison, baseline.stop, context.console);
        let ended = self.recorded(compared).map(Baseline::into_partners);
        context.console.line(&format!("stage `{name}` compared with its baseline: {}", comparison.report()));
        figures::plot::differences(context.out, name, &comparison)?;
        self.summary.deviates = !comparison.same();
        ended
    }

    /// Runs the stage and records it if requested.
    fn recorded<P: Partners>(&mut self, mut partners: P) -> Result<P, RunError> {
        let Some(record) = &self.options.record else {
            self.run(&mut partners)?;
            return Ok(partners);
        };
        let writer = writer(self.context, record, self.grid_nodes)?;
        let mut recorder = Recorder::new(partners, writer, !record.without_grid);
        self.run(&mut recorder)?;
        let (partners, cost) = recorder.into_partners()?;
        let name = &self.context.scene.stages[self.context.stage].name;
        self.context.console.line(&format!("stage `{name}`: {cost}"));
        Ok(partners)
    }

    fn run(&mut self, partners: &mut dyn Partners) -> Result<(), RunError> {
        let now = || self.options.now.as_ref().is_some_and(|now| now.load(Ordering::Relaxed));
        match self.context.run(partners, self.state.clone(), self.summary) {
            Ok(end) => *self.state = end,
            // All programs are at the end of a window: the session ends normally.
            Err(stop @ RunError::Interrupted(_)) if !now() => self.interrupted = Some(stop),
            Err(other) => return Err(other),
        }
        Ok(())
    }
}

/// Opens the recording of a stage.
fn writer(context: &StageContext<'_>, record: &RecordOptions, grid_nodes: u64) -> Result<Writer, RunError> {
    let (scene, stage) = (context.scene, context.stage);
    let interface = context.interface;
    let name = scene.stages[stage].name.clone();
    let header = Header {
        contract: channel::CONTRACT_VERSION,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: scene.name.clone(),
        stage: (name.clone(), stage as u64),
        canopy: (interface.nodes() as u64, interface.faces.len() as u64),
        surface_hash: channel::surface_hash(&interface.faces),
        grid_nodes: if record.without_grid { 0 } else { grid_nodes },
        ranks: Role::ALL.map(|role| scene.ranks.of(role)),
    };
    let file = stage_file(&record.folder, &name);
    match context.resumed {
        None => Ok(Writer::create(&file, &header)?),
        Some(_) if !file.is_file() => Err(RunError::Input(format!(
            "{} does not exist, and a recording cannot start within a stage: name the recording folder of the earlier \
             run, or omit --record",
            file.display()
        ))),
        Some(p) => Ok(Writer::resume(&file, p.windows)?),
    }
}
