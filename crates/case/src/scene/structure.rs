//! `[structure]`: time integration and solvers of the structure.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// Time integration and solvers of the structure.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Structure {
    /// Spectral radius at infinite frequency of the generalized-alpha method,
    /// 0 to 1: the share that a step leaves of the highest frequencies. Absent: 1, no damping.
    pub spectral_radius: Option<f64>,
    /// Newton stops when the residual falls below this share of the applied load.
    pub newton_tolerance: f64,
    /// Newton steps before a time step is cut.
    pub newton_max_steps: u32,
    /// Relative tolerance of GMRES within a Newton step.
    pub gmres_tolerance: f64,
    /// How often a time step may be halved before the run ends.
    pub max_step_cuts: u32,
    /// A static stage ends when the residual force is below this share of
    /// the load.
    pub static_tolerance: f64,
    /// Distribution of the mass of elements over their nodes.
    pub mass: Mass,
    /// Elements of the fabric.
    pub membrane: Membrane,
    /// Time integration; explicit steps always lump the mass.
    pub integration: Integration,
    /// Share of the largest stable step that explicit integration takes.
    pub explicit_safety: f64,
}

impl Structure {
    /// Spectral radius at infinite frequency of the generalized-alpha method: the scene's choice,
    /// or the default.
    pub fn spectral_radius(&self) -> f64 {
        self.spectral_radius.unwrap_or(SPECTRAL_RADIUS)
    }
}

impl Default for Structure {
    fn default() -> Self {
        Self {
            spectral_radius: None,
            newton_tolerance: 1e-5,
            newton_max_steps: 25,
            gmres_tolerance: 1e-3,
            max_step_cuts: 10,
            static_tolerance: 1e-8,
            mass: Mass::Consistent,
            membrane: Membrane::Triangle,
            integration: Integration::default(),
            explicit_safety: EXPLICIT_SAFETY,
        }
    }
}

/// Elements of the fabric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Membrane {
    /// Two triangles of constant strain for each quadrilateral, as in the paper.
    #[default]
    Triangle,
    /// One bilinear element for each quadrilateral.
    Quadrilateral,
}

/// Distribution of the mass of elements over their nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mass {
    /// From the shape functions, as in the paper.
    #[default]
    Consistent,
    /// Shared out to the nodes.
    Lumped,
}

/// Time integration of the structure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Integration {
    /// Implicit steps with stresses of averaged strains, which create no energy
    /// (`spectral_radius` sets the numerical damping): a substep is one step, with equations to
    /// solve.
    #[default]
    GeneralizedAlpha,
    /// The same as `generalized-alpha`.
    Implicit,
    /// Newmark with gamma 1/2 and beta 1/4, as in the paper. It can create energy without bound
    /// where fabric and lines change between slack and taut.
    Newmark,
    /// Central differences on a lumped mass: each substep is divided into as many steps
    /// as stability asks for, with nothing to solve.
    Explicit,
}

/// Share of the largest stable step that explicit integration takes by default.
const EXPLICIT_SAFETY: f64 = 0.5;
/// Spectral radius of the generalized-alpha method by default: the energy-momentum method
/// (Simo and Tarnow 1992), the only one of the family of which it is proven that no step
/// creates energy, whatever the states that fabric and lines pass through.
const SPECTRAL_RADIUS: f64 = 1.0;

/// Refuses tolerances and counts that no solver meets, and damping that the integration has not.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let s = &scene.structure;
    if let Some(r) = s.spectral_radius {
        c.range(
            "structure.spectral_radius",
            r,
            0.0..=1.0,
            "1 keeps all frequencies, 0 damps the highest at once",
        );
    }
    let undamped = match s.integration {
        Integration::Explicit => Some("explicit time integration"),
        Integration::Newmark => Some("Newmark's method with gamma 1/2 and beta 1/4"),
        Integration::GeneralizedAlpha | Integration::Implicit => None,
    };
    if let Some(name) = undamped.filter(|_| s.spectral_radius.is_some()) {
        c.refuse(
            "structure.spectral_radius",
            format!("{name} has no numerical damping to set"),
            "leave this key out, or set structure.integration = \"generalized-alpha\"",
        );
    }
    c.positive("structure.static_tolerance", s.static_tolerance, 0.1, "a share of the load");
    c.positive("structure.newton_tolerance", s.newton_tolerance, 0.1, "a share of the load");
    c.positive("structure.gmres_tolerance", s.gmres_tolerance, 0.5, "a relative residual");
    c.count("structure.newton_max_steps", s.newton_max_steps, 1..=1000, "Newton steps");
    c.count("structure.max_step_cuts", s.max_step_cuts, 0..=30, "halvings of a time step");
    c.positive("structure.explicit_safety", s.explicit_safety, 1.0, "a share of the largest stable step");
}
