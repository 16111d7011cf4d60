//! The loop over the coupling iterations of one window.

use case::{Coupling, LoadShape, Scheme};
use channel::{Stats, Window, flow_stats};

use super::load_shape::{FlowLoads, shape_load};
use super::{Accelerator, Criterion, Predictor, Relaxation, Unknowns};
use crate::descent::DescentModel;
use crate::error::{Place, RunError};
use crate::partners::{Answer, LoadOverWindow, Partners};

/// A window that ends its iterations above the tolerance but below this measure
/// is accepted and counted as not converged; above it the run ends.
pub const ACCEPTABLE: f64 = 0.1;

/// Iterations without progress after which an acceptable window is accepted: it
/// has come to the noise of the solvers' own tolerances.
const PATIENCE: usize = 6;

/// Whether the last [`PATIENCE`] measures are all acceptable and no better than
/// the best one before them.
fn stalled(history: &[f64]) -> bool {
    let Some(split) = history.len().checked_sub(PATIENCE).filter(|&s| s > 0) else { return false };
    let best = |m: &[f64]| m.iter().copied().fold(f64::INFINITY, f64::min);
    let recent = &history[split..];
    recent.iter().all(|&m| m <= ACCEPTABLE) && best(recent) > 0.9 * best(&history[..split])
}

/// Values on the interface at the end of the last accepted window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct InterfaceState {
    /// Displacement of the canopy from the unstressed shape, `[nodes][3]`, m.
    pub displacement: Vec<f64>,
    /// Load of the flow, `[faces][LOAD_WIDTH]`, Pa; `None` before the first flow step.
    pub load: Option<Vec<f64>>,
    /// The same one window earlier.
    #[serde(default)]
    pub load_before: Option<Vec<f64>>,
    /// Vertical velocity of the frame, m/s, positive up.
    pub velocity: f64,
    /// Mean vertical acceleration of the frame over the window, m/s2.
    pub acceleration: f64,
}

/// What happened in a window.
#[derive(Clone, Debug, Default)]
pub struct WindowReport {
    /// Coupling iterations.
    pub iterations: u32,
    /// Measure of the last iteration ([`Criterion::measure`]); `None` where
    /// nothing is iterated.
    pub residual: Option<f64>,
    /// Measures of all iterations.
    pub residuals: Vec<f64>,
    /// The tolerance was met (always so without iteration).
    pub converged: bool,
    /// Force of the air on the canopy at the end of the window, N.
    pub force: [f64; 3],
    /// Last statistics of structure, flow, mesh.
    pub stats: [Stats; 3],
    /// Seconds that structure, flow, mesh computed, over all iterations.
    pub busy_s: [f64; 3],
    /// Seconds from question to answer, likewise.
    pub wall_s: [f64; 3],
}

impl WindowReport {
    pub(crate) fn add(&mut self, role: case::Role, answer: Answer) {
        let at = role as usize;
        self.stats[at] = answer.stats;
        self.busy_s[at] += answer.stats.busy_s;
        self.wall_s[at] += answer.wall_s;
        if role == case::Role::Flow {
            self.force.copy_from_slice(&answer.stats.values[flow_stats::FORCE..flow_stats::FORCE + 3]);
        }
    }
}

/// Couples structure, mesh, flow and descent, window by window.
///
/// * **staggered**, the paper's sequence: the structure's substeps under the
///   load of the last flow step, then mesh, flow at the velocity known so far,
///   descent. Once each.
/// * **implicit**, Gauss-Seidel: mesh and flow at the iterate, structure under
///   the flow's answer, descent under the flow's force; repeated until the
///   iterate and the answer agree.
///
/// Where no load is known at the start (no flow-only stage came before), the
/// first flow answer of the first window stands for it.
pub struct WindowLoop {
    stage: String,
    scheme: Scheme,
    load_shape: LoadShape,
    max_iterations: u32,
    keep_going: bool,
    unknowns: Unknowns,
    criterion: Criterion,
    accelerator: Box<dyn Accelerator>,
    predictor: Predictor,
    descent: Option<DescentModel>,
    state: InterfaceState,
    x: Vec<f64>,
    x_tilde: Vec<f64>,
    next: Vec<f64>,
    start: Vec<f64>,
    displacement: Vec<f64>,
    load_end: Vec<f64>,
    felt: [Vec<f64>; 2],
}

impl WindowLoop {
    /// From `state`, on an interface of `faces` faces. `keep_going` accepts
    /// windows that do not converge as long as they are finite.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        stage: &str,
        coupling: &Coupling,
        unknowns: Unknowns,
        criterion: Criterion,
        faces: usize,
        descent: Option<DescentModel>,
        state: InterfaceState,
        rest: Box<dyn Relaxation>,
        keep_going: bool,
    ) -> Self {
        let n = unknowns.len();
        let mut start = vec![0.0; n];
        unknowns.pack(&state.displacement, state.velocity, &mut start);
        let mut predictor = Predictor::new(2);
        predictor.accept(&start);
        Self {
            stage: stage.to_owned(),
            scheme: coupling.scheme,
            load_shape: coupling.load,
            max_iterations: coupling.max_iterations.max(1),
            keep_going,
            criterion,
            accelerator: super::accelerator(coupling, n, rest),
            predictor,
            descent,
            x: start.clone(),
            x_tilde: start.clone(),
            next: start.clone(),
            start,
            displacement: state.displacement.clone(),
            load_end: vec![0.0; faces * channel::LOAD_WIDTH],
            felt: [vec![0.0; faces * channel::LOAD_WIDTH], vec![0.0; faces * channel::LOAD_WIDTH]],
            state,
            unknowns,
        }
    }

    /// Values at the end of the last accepted window.
    pub fn state(&self) -> &InterfaceState {
        &self.state
    }

    /// Computes and accepts the window that `window` opens (index, time, dt,
    /// substeps are given; frame motion and iteration are filled here).
    pub fn run(&mut self, partners: &mut dyn Partners, window: Window) -> Result<WindowReport, RunError> {
        match self.scheme {
            Scheme::Staggered => self.staggered(partners, window),
            Scheme::Implicit => self.implicit(partners, window),
        }
    }

    fn staggered(&mut self, partners: &mut dyn Partners, mut w: Window) -> Result<WindowReport, RunError> {
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        w.frame_velocity = [0.0, 0.0, self.state.velocity];
        w.frame_acceleration = [0.0, 0.0, self.state.acceleration];
        // A copy: the state stays whole where the window fails.
        let load = match self.state.load.clone() {
            Some(load) => load,
            None => {
                let mut load = vec![0.0; self.load_end.len()];
                report.add(case::Role::Mesh, partners.mesh(&w, &self.state.displacement)?);
                report.add(case::Role::Flow, partners.flow(&w, &mut load)?);
                w.iteration += 1;
                load
            }
        };
        let known = LoadOverWindow { start: &load, end: &load };
        report.add(case::Role::Structure, partners.structure(&w, known, &mut self.displacement)?);
        self.finite("structure", &w, &self.displacement)?;
        report.add(case::Role::Mesh, partners.mesh(&w, &self.displacement)?);
        report.add(case::Role::Flow, partners.flow(&w, &mut self.load_end)?);
        self.finite("flow", &w, &self.load_end)?;
        let velocity = self.descend(&report, w.dt);
        self.state.load = Some(load);
        self.accept(partners, &w, velocity)?;
        Ok(report)
    }

    fn implicit(&mut self, partners: &mut dyn Partners, mut w: Window) -> Result<WindowReport, RunError> {
        let mut report = WindowReport::default();
        let mut history = Vec::with_capacity(self.max_iterations as usize);
        self.accelerator.begin_window();
        self.predictor.predict(&mut self.x);
        loop {
            let velocity = self.unknowns.velocity(&self.x, self.state.velocity);
            w.frame_velocity = [0.0, 0.0, velocity];
            w.frame_acceleration = [0.0, 0.0, (velocity - self.state.velocity) / w.dt];
            report.add(case::Role::Mesh, partners.mesh(&w, self.unknowns.displacement(&self.x))?);
            report.add(case::Role::Flow, partners.flow(&w, &mut self.load_end)?);
            self.finite("flow", &w, &self.load_end)?;
            let start = &*self.state.load.get_or_insert_with(|| self.load_end.clone());
            let before = self.state.load_before.as_ref().unwrap_or(start);
            let flow = FlowLoads { before, start, end: &self.load_end };
            let [felt_start, felt_end] = &mut self.felt;
            shape_load(self.load_shape, flow, felt_start, felt_end);
            let load = LoadOverWindow { start: felt_start, end: felt_end };
            report.add(case::Role::Structure, partners.structure(&w, load, &mut self.displacement)?);
            self.finite("structure", &w, &self.displacement)?;
            let velocity = self.descend(&report, w.dt);
            self.unknowns.pack(&self.displacement, velocity, &mut self.x_tilde);

            let measure = self.criterion.measure(&self.x, &self.x_tilde, &self.start);
            history.push(measure);
            report.iterations += 1;
            report.residual = Some(measure);
            report.converged = self.criterion.met(measure);
            if report.converged || report.iterations == self.max_iterations || stalled(&history) {
                if !report.converged && measure > ACCEPTABLE && !self.keep_going {
                    return Err(self.diverged(&w, &history));
                }
                report.residuals = history;
                self.accelerator.end_window(&self.x, &self.x_tilde);
                self.accept(partners, &w, velocity)?;
                return Ok(report);
            }
            self.accelerator.next(&self.x, &self.x_tilde, &mut self.next);
            std::mem::swap(&mut self.x, &mut self.next);
            self.finite("acceleration", &w, &self.x)?;
            w.iteration += 1;
        }
    }

    fn descend(&self, report: &WindowReport, dt: f64) -> f64 {
        match &self.descent {
            Some(model) => model.step(self.state.velocity, report.force[2], dt),
            None => self.state.velocity,
        }
    }

    fn accept(&mut self, partners: &mut dyn Partners, w: &Window, velocity: f64) -> Result<(), RunError> {
        partners.accept(w)?;
        self.state.acceleration = (velocity - self.state.velocity) / w.dt;
        self.state.velocity = velocity;
        self.state.displacement.copy_from_slice(&self.displacement);
        std::mem::swap(&mut self.state.load, &mut self.state.load_before);
        let load = self.state.load.get_or_insert_default();
        load.clear();
        load.extend_from_slice(&self.load_end);
        self.unknowns.pack(&self.displacement, velocity, &mut self.start);
        self.predictor.accept(&self.start);
        Ok(())
    }

    fn place(&self, w: &Window) -> Place {
        Place { stage: self.stage.clone(), window: Some((w.index, w.iteration)) }
    }

    fn finite(&self, who: &str, w: &Window, values: &[f64]) -> Result<(), RunError> {
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(at) => Err(RunError::Coupling {
                place: self.place(w),
                message: format!("the answer of the {who} holds {} at position {at}", values[at]),
            }),
        }
    }

    fn diverged(&self, w: &Window, history: &[f64]) -> RunError {
        let shown: Vec<String> = history.iter().map(|m| format!("{m:.1e}")).collect();
        RunError::Coupling {
            place: self.place(w),
            message: format!(
                "interface and descent still change by {:.1e} of their change over the window after {} \
                 iterations (tolerance {:.1e}; a window is given up above {ACCEPTABLE}). Residuals: {}. \
                 Remedies: acceleration \"iqn-ils\", a smaller relaxation, more iterations, a shorter window_s, \
                 a tighter flow.solver.residual_drop",
                history.last().copied().unwrap_or(f64::NAN),
                history.len(),
                self.criterion.tolerance,
                shown.join(" ")
            ),
        }
    }
}
