//! `[coupling]`: how the fields are coupled in a window.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// Coupling of the fields.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Coupling {
    /// The sequence of the programs in a window.
    pub scheme: Scheme,
    /// Order of the programs in a staggered window, and the extrapolation of their input.
    pub staggered: Staggered,
    /// The order of structure and flow in the iterations of an implicit window.
    pub order: CouplingOrder,
    /// Load over the substeps of a window. Absent: `mean`; with `[flow.immersed]` `constant`, whose load is the mean over the window already.
    #[serde(alias = "load")]
    pub load_interpolation: Option<LoadShape>,
    /// An implicit window is converged when interface displacement and descent
    /// speed change by less than this, relative to their change over the window.
    pub tolerance: f64,
    /// Maximum number of coupling iterations in a window.
    pub max_iterations: u32,
    /// Relaxation of the first iteration, of all with `constant`, and of the load with
    /// `staggered.sequence = "relaxed-load"`.
    pub relaxation: f64,
    /// Acceleration of the iterations.
    pub acceleration: Acceleration,
    /// Windows before the current one whose columns quasi-Newton reuses.
    pub reused_windows: u32,
    /// Most panels of the added-mass surrogate, a dense matrix with one row for each canopy face. The faces of a
    /// canopy with more are agglomerated to that many groups of neighbours.
    #[serde(alias = "model_faces")]
    pub added_mass_max_panels: u32,
    /// Share of the mean velocity over an implicit window in the structure's velocity
    /// at its end, along the fabric's normal, 0 to 1: holds light fabric to the motion that
    /// the flow sees. Absent: 0.5 where the air weighs far more than the fabric (a tenth of
    /// that where the flow is immersed), none where it weighs less.
    pub velocity_average: Option<f64>,
    /// Retries of a rejected window with a shorter one.
    pub adaptive: AdaptiveWindow,
}

impl Default for Coupling {
    fn default() -> Self {
        Self {
            scheme: Scheme::Implicit,
            staggered: Staggered::default(),
            order: CouplingOrder::GaussSeidel,
            load_interpolation: None,
            tolerance: 1e-3,
            max_iterations: 30,
            relaxation: 0.1,
            acceleration: Acceleration::IbqnLs,
            reused_windows: 8,
            added_mass_max_panels: 4000,
            velocity_average: None,
            adaptive: AdaptiveWindow::default(),
        }
    }
}

/// The sequence of the programs in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Each program once: the paper's sequence with the pressure of the last flow step, or the one of
    /// `coupling.staggered`.
    Staggered,
    /// Structure, flow and descent are iterated to convergence in each window.
    Implicit,
}

impl Scene {
    /// Load over the substeps of a window: the scene's, or that of its flow.
    pub fn load_shape(&self) -> LoadShape {
        let immersed = self.flow.as_ref().is_some_and(crate::Flow::is_immersed);
        let of_flow = if immersed { LoadShape::Constant } else { LoadShape::Mean };
        self.coupling.load_interpolation.unwrap_or(of_flow)
    }
}

impl Coupling {
    /// Load over the substeps of a window where the flow reports that at its end.
    pub fn load_shape(&self) -> LoadShape {
        self.load_interpolation.unwrap_or(LoadShape::Mean)
    }
}

/// Load on the structure over the substeps of one window.
///
/// It decides the stability of even a fully converged window with several substeps: see `coupling::schemes`, module
/// `load_shape`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LoadShape {
    /// A second-order mean of the last three pressures throughout, which also
    /// damps a pressure that alternates from window to window: the stable one for
    /// light fabric.
    Mean,
    /// The window's last pressure throughout.
    Constant,
    /// From the pressure at the start to the one at the end: for heavy canopies
    /// or one substep.
    Linear,
}

/// Acceleration of implicit coupling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Acceleration {
    /// Fixed relaxation.
    Constant,
    /// Aitken's dynamic relaxation.
    Aitken,
    /// Interface quasi-Newton, inverse least squares. For structures that cost more than the flow.
    IqnIls,
    /// Interface quasi-Newton, multi-vector: the columns of each window update the Jacobian of the windows before.
    IqnImvj,
    /// Interface block quasi-Newton: between two flow solves the structure is solved with the added-mass surrogate of
    /// the flow and its columns, so that few windows need more than four flow solves. Same as `iqn-ils` in Jacobi
    /// order.
    IbqnLs,
}

/// Order of structure and flow in an iteration of an implicit window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CouplingOrder {
    /// Structure and flow are solved one after the other, each with the latest result of the other: fewer iterations.
    #[default]
    GaussSeidel,
    /// Structure and flow are solved at the same time, each with the other's previous iterate; the load is one of the
    /// coupled unknowns.
    Jacobi,
}

/// Sequence and predictor of a staggered window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Staggered {
    /// Order of the programs; the first one uses extrapolated values.
    pub sequence: StaggeredSequence,
    /// Order of the extrapolation from previous windows, 0 (the last value) to 2.
    pub predictor: u32,
}

/// Order of the programs in a staggered window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StaggeredSequence {
    /// The structure under the extrapolated load, then the flow around the displaced canopy. With predictor 0 the
    /// paper's sequence.
    #[default]
    StructureFirst,
    /// Conventional serial staggered (Farhat and Lesoinne 2000): the flow around the extrapolated canopy, then the
    /// structure under its load, with `coupling.load_interpolation` over the substeps.
    #[serde(alias = "flow-first")]
    ConventionalSerial,
    /// Improved serial staggered (Lesoinne and Farhat 1998): the flow is offset by half a window, at the middle of the
    /// structure's window, around the canopy extrapolated there; its load is constant over the structure's
    /// window. Use predictor 1 or 2.
    #[serde(alias = "half-step")]
    ImprovedSerial,
    /// The structure under the extrapolated load, with the added mass of the air (potential flow around the canopy)
    /// implicit, then the flow around the displaced canopy: stable for light fabric at one flow solve in a window.
    /// Use predictor 1.
    AddedMass,
    /// The structure under an extrapolated load, then the flow around it; the share `coupling.relaxation` of the
    /// flow's load corrects the extrapolation (Dettmer and Peric 2013), at one flow solve in a window. One linear mode
    /// is stable for any added mass at a share below 0.4 / (1 + added mass / mass). Second order in time with
    /// predictor 1; the error grows as 1 / share, so that fabric far lighter than the air needs an implicit scheme.
    /// Predictor 2 is unstable and refused.
    RelaxedLoad,
}

/// Highest order of extrapolation in a staggered window.
pub const MOST_PREDICTOR: u32 = 2;

/// Adaptive windows. A window is rejected where it does not converge, or where a program cannot compute it.
///
/// All programs restore the state at the start of a rejected window and retry with half the window; after
/// `grow_after` accepted windows the window is doubled, up to `window_s`. Costs nothing where every window is
/// accepted.
///
/// Windows also become shorter where the coupling creates energy: half as long where it exceeds `energy_limit`, and
/// longer again, by trial, where it is below a quarter of that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptiveWindow {
    /// Whether windows adapt; otherwise a rejected window ends the run.
    pub enabled: bool,
    /// Maximum number of halvings of `window_s`, 0 to 20.
    #[schemars(range(max = 20))]
    pub halvings: u32,
    /// Accepted windows before the next one is twice as long.
    #[schemars(range(min = 1))]
    pub grow_after: u32,
    /// Energy that an implicit coupling may create, relative to the work of the air on the canopy over the last 20
    /// windows (or its mean over the stage, where that is larger), before windows are halved; 0: no limit.
    pub energy_limit: f64,
}

impl Default for AdaptiveWindow {
    fn default() -> Self {
        Self { enabled: true, halvings: 5, grow_after: 4, energy_limit: 0.1 }
    }
}

/// Refuses tolerances, counts and shares that no window meets.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let k = &scene.coupling;
    c.positive("coupling.tolerance", k.tolerance, 0.5, "a relative change");
    c.count("coupling.max_iterations", k.max_iterations, 1..=10_000, "coupling iterations");
    c.positive("coupling.relaxation", k.relaxation, 1.0, "a relaxation factor");
    c.count("coupling.added_mass_max_panels", k.added_mass_max_panels, 1..=20_000, "rows of a dense matrix");
    c.count("coupling.staggered.predictor", k.staggered.predictor, 0..=MOST_PREDICTOR, "an order");
    if k.staggered.sequence == StaggeredSequence::RelaxedLoad {
        let why = "an order: a relaxed load extrapolated with order 2 is unstable";
        c.count("coupling.staggered.predictor", k.staggered.predictor, 0..=1, why);
    }
    c.count("coupling.adaptive.halvings", k.adaptive.halvings, 0..=20, "halvings of window_s");
    c.count("coupling.adaptive.grow_after", k.adaptive.grow_after, 1..=10_000, "accepted windows");
    c.range("coupling.adaptive.energy_limit", k.adaptive.energy_limit, 0.0..=1.0, "0 is no limit");
    if let Some(share) = k.velocity_average {
        c.range("coupling.velocity_average", share, 0.0..=1.0, "0 is none");
    }
}
