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
    /// The order of the programs in a staggered window, and what they know in advance.
    pub staggered: Staggered,
    /// The order of structure and flow in the iterations of an implicit window.
    pub order: CouplingOrder,
    /// Load over the substeps of a window.
    pub load: LoadShape,
    /// An implicit window is converged when interface displacement and descent
    /// speed change by less than this, relative to their change over the window.
    pub tolerance: f64,
    /// Coupling iterations at most in a window.
    pub max_iterations: u32,
    /// Relaxation of the first iteration, of all with `constant`, and of the load with
    /// `staggered.sequence = "relaxed-load"`.
    pub relaxation: f64,
    /// Acceleration of the iterations.
    pub acceleration: Acceleration,
    /// Past windows whose secants quasi-Newton reuses.
    pub reused_windows: u32,
    /// Most faces that the dense model of the air's inertia holds one by one. A canopy of more acts in that many
    /// groups of neighbours.
    pub model_faces: u32,
    /// Share of the mean velocity over an implicit window in the structure's velocity
    /// at its end, along the fabric's normal, 0 to 1: holds light fabric to the motion that
    /// the flow sees. Absent: 0.5 where the air weighs far more than the fabric, none
    /// where it weighs less.
    pub velocity_average: Option<f64>,
    /// What happens to a window that has no answer.
    pub adaptive: AdaptiveWindow,
}

impl Default for Coupling {
    fn default() -> Self {
        Self {
            scheme: Scheme::Implicit,
            staggered: Staggered::default(),
            order: CouplingOrder::GaussSeidel,
            load: LoadShape::Mean,
            tolerance: 1e-3,
            max_iterations: 30,
            relaxation: 0.1,
            acceleration: Acceleration::IbqnLs,
            reused_windows: 8,
            model_faces: 4000,
            velocity_average: None,
            adaptive: AdaptiveWindow::default(),
        }
    }
}

/// The sequence of the programs in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Each program once: the paper's sequence, with pressures of the last flow step, or
    /// what `coupling.staggered` makes of it.
    Staggered,
    /// Each window is iterated until structure, flow and descent agree.
    Implicit,
}

/// Load on the structure over the substeps of one window.
///
/// Substeps between two looks at the flow decide the stability of even a fully
/// converged window: see `coupling::schemes`, module `load_shape`.
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
    /// Interface quasi-Newton, multi-vector: each window's secants correct what the windows
    /// before have learnt.
    IqnImvj,
    /// Interface block quasi-Newton: between two calls of the flow the structure is solved
    /// against the flow's added mass and secants, so that few windows ask the flow more than
    /// four times. Above 4000 canopy faces, and in Jacobi order, as iqn-ils.
    IbqnLs,
}

/// How an implicit window visits structure and flow in an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CouplingOrder {
    /// The structure answers the load of the same iteration: fewer iterations.
    #[default]
    GaussSeidel,
    /// Structure and flow answer each other's last iterate; the load is one of the coupled unknowns.
    Jacobi,
}

/// What a staggered window knows in advance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Staggered {
    /// Which program is first, on extrapolated values.
    pub sequence: StaggeredSequence,
    /// Order of the extrapolation from past windows, 0 (the last value) to 2.
    pub predictor: u32,
}

/// Which program is first in a staggered window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StaggeredSequence {
    /// The structure under the extrapolated load, then the flow around its answer. With
    /// predictor 0 the paper's sequence.
    #[default]
    StructureFirst,
    /// The flow around the extrapolated canopy, then the structure under its answer, with
    /// `coupling.load` over the substeps.
    FlowFirst,
    /// The flow lives half a window off, at the middles of the structure's windows, around the
    /// canopy extrapolated there; its answer is the constant load of the structure's window
    /// (Lesoinne and Farhat 1998, improved serial staggered). Wants predictor 1 or 2.
    HalfStep,
    /// The structure under the extrapolated load with the air's added mass (potential flow around the
    /// canopy) implicit, then the flow around its answer: stands for light fabric at one call
    /// of the flow in a window. Wants predictor 1.
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

/// What happens to a window that has no answer: it does not converge, or a program cannot compute it.
///
/// All programs start again from their last accepted state with half the window; after some windows
/// that go well, windows are doubled again, never beyond `window_s`. Costs nothing where every
/// window has an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptiveWindow {
    /// Whether windows adapt; otherwise such a window ends the run.
    pub enabled: bool,
    /// Halvings of `window_s` at most, 0 to 20.
    #[schemars(range(max = 20))]
    pub halvings: u32,
    /// Windows that must go well before the next one is twice as long.
    #[schemars(range(min = 1))]
    pub grow_after: u32,
}

impl Default for AdaptiveWindow {
    fn default() -> Self {
        Self { enabled: true, halvings: 5, grow_after: 4 }
    }
}

/// Refuses tolerances, counts and shares that no window meets.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let k = &scene.coupling;
    c.positive("coupling.tolerance", k.tolerance, 0.5, "a relative change");
    c.count("coupling.max_iterations", k.max_iterations, 1..=10_000, "coupling iterations");
    c.positive("coupling.relaxation", k.relaxation, 1.0, "a relaxation factor");
    c.count("coupling.model_faces", k.model_faces, 1..=20_000, "faces of a dense matrix");
    c.count("coupling.staggered.predictor", k.staggered.predictor, 0..=MOST_PREDICTOR, "an order");
    if k.staggered.sequence == StaggeredSequence::RelaxedLoad {
        let why = "an order: a relaxed load extrapolated with order 2 is unstable";
        c.count("coupling.staggered.predictor", k.staggered.predictor, 0..=1, why);
    }
    c.count("coupling.adaptive.halvings", k.adaptive.halvings, 0..=20, "halvings of window_s");
    c.count("coupling.adaptive.grow_after", k.adaptive.grow_after, 1..=10_000, "windows that go well");
    if let Some(share) = k.velocity_average {
        c.range("coupling.velocity_average", share, 0.0..=1.0, "0 is none");
    }
}
