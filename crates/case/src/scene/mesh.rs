//! `[mesh]`: how the grid follows the canopy.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// Grid motion.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MeshMotion {
    /// Method that extends the motion of the canopy into the grid.
    pub mover: MoverKind,
    /// Exponent of the stiffening by the Jacobian (Stein, Tezduyar, Benney 2003).
    pub stiffening_exponent: f64,
    /// Poisson's ratio of the pseudo-solid.
    pub poisson_ratio: f64,
    /// Accepted error of interior nodes: of the position of one in shares of the longest cell edge around
    /// it, of two of them in shares of the edge between. Only smoothness is at stake.
    pub tolerance: f64,
    /// Smallest scaled Jacobian that is accepted, above 0.
    pub min_quality: f64,
    /// Maximum number of sub-increments in a window.
    pub max_increments: u32,
    /// Motion of the nodes of the outer boundary.
    #[serde(alias = "outer")]
    pub outer_boundary: OuterBoundary,
    /// Regridding where the quality of the moved grid falls.
    pub regrid: Regrid,
}

impl Default for MeshMotion {
    fn default() -> Self {
        Self {
            mover: MoverKind::Elastic,
            stiffening_exponent: 1.0,
            poisson_ratio: 0.3,
            tolerance: 3e-3,
            min_quality: 1e-3,
            max_increments: 8,
            outer_boundary: OuterBoundary::Fixed,
            regrid: Regrid::default(),
        }
    }
}

/// Method that extends the motion of the canopy into the grid. All but the first exist for comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MoverKind {
    /// Linear elasticity, stiffer where cells are small or badly shaped.
    #[default]
    Elastic,
    /// Linear elasticity of uniform stiffness.
    PlainElastic,
    /// Laplace's equation for each component, with the stiffening exponent.
    Laplacian,
    /// Radial basis functions of Wendland on selected boundary nodes.
    RadialBasis,
    /// Weights by the distance to each boundary node.
    InverseDistance,
}

/// Motion of the nodes of the outer boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OuterBoundary {
    /// At rest.
    #[default]
    Fixed,
    /// Free in the plane of their faces and along the edge between two planes; fixed where three planes meet and
    /// where faces form no plane. Walls stay at rest, unless a
    /// `[[stage.body_motion]]` moves them: nodes slide along them.
    Sliding,
}

/// When a new grid takes the place of the moved one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Regrid {
    /// A new grid is built around the canopy where the smallest scaled Jacobian is below this; 0: none is built.
    /// Absent: half of the grid's own when it was built, and none for a grid file or moving rigid bodies.
    #[serde(alias = "below")]
    pub quality_threshold: Option<f64>,
    /// Longest way of a node to its place in the new grid in one window, in shares of the
    /// shortest cell edge around it: the flow follows the grid there as it follows any motion.
    pub step: f64,
}

impl Default for Regrid {
    fn default() -> Self {
        Self { quality_threshold: None, step: 0.25 }
    }
}

/// Refuses invalid pseudo-solids, and bounds that no grid can meet.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let m = &scene.mesh;
    c.range("mesh.stiffening_exponent", m.stiffening_exponent, 0.0..=4.0, "0 is none, 1 to 2 is usual");
    c.range("mesh.poisson_ratio", m.poisson_ratio, -0.9..=0.45, "of the pseudo-solid");
    c.positive("mesh.tolerance", m.tolerance, 0.5, "shares of the shortest edge around a node");
    c.range("mesh.min_quality", m.min_quality, 0.0..=0.9, "a scaled Jacobian");
    c.count("mesh.max_increments", m.max_increments, 1..=10_000, "sub-increments");
    if let Some(threshold) = m.regrid.quality_threshold.filter(|t| *t != 0.0) {
        let why = "a scaled Jacobian above mesh.min_quality, or 0 for no new grids";
        c.above("mesh.regrid.quality_threshold", threshold, m.min_quality..=0.9, why);
    }
    c.positive("mesh.regrid.step", m.regrid.step, 1.0, "a share of the shortest edge around a node");
    if m.outer_boundary == OuterBoundary::Sliding
        && !matches!(m.mover, MoverKind::Elastic | MoverKind::PlainElastic)
    {
        c.refuse(
            "mesh.outer_boundary",
            "`mesh.outer_boundary` is \"sliding\" with a mover that cannot slide nodes in a plane",
            "allowed: with the movers elastic and plain-elastic; others need outer_boundary = \"fixed\"",
        );
    }
}
