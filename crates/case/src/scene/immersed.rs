//! `[flow.immersed]`: a Cartesian grid through which the canopy moves.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Flow, Role, StageKind, Turbulence, WallTreatment};
use crate::Scene;
use crate::check::Check;

/// A Cartesian grid through which the canopy moves, instead of one that is fitted to it: fabric may fold, touch itself and close its vents, and no
/// mesh-mover runs. The air is incompressible. It slides along the fabric without `[flow.viscosity]`, and does not slip with it; of the turbulence models it has
/// `smagorinsky` and `wale`, without a law of the wall. The even cells around the canopy follow it; when it comes near their end, a new grid is made around it.
/// Stages with `flow_method = "fitted"` keep the fitted grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Immersed {
    /// Width of the even cells around the canopy, m. Between 1/20 and 1/50 of the canopy's width; its rim is known to half a cell.
    pub spacing_m: f64,
    /// Even cells on all sides of the canopy, in largest extents of the canopy: room to move.
    #[serde(default = "room")]
    pub room: f64,
    /// Even cells downstream of that, in the same unit.
    #[serde(default = "wake")]
    pub wake: f64,
    /// From there to the far field, upstream and to the sides, in the same unit.
    #[serde(default = "far_field")]
    pub far_field: f64,
    /// The same, downstream.
    #[serde(default = "far_wake")]
    pub far_wake: f64,
    /// Largest ratio of the widths of neighbouring cells outside of the even ones.
    #[serde(default = "growth")]
    pub growth: f64,
    /// What computes the steps of the flow: `cpu`, the ranks of the flow-solver, or `gpu`, a GPU of NVIDIA with one rank. Results agree to round-off. A flow-solver
    /// that was built without the feature `gpu` refuses it.
    #[serde(default)]
    pub device: FlowDevice,
}

/// What computes the steps of an immersed flow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FlowDevice {
    /// The ranks of the flow-solver.
    #[default]
    Cpu,
    /// A GPU.
    Gpu,
}

fn room() -> f64 {
    0.1
}
fn wake() -> f64 {
    0.5
}
fn far_field() -> f64 {
    4.0
}
fn far_wake() -> f64 {
    8.0
}
fn growth() -> f64 {
    1.2
}

impl Scene {
    /// Whether a GPU computes the steps of the immersed flow.
    pub fn flow_on_gpu(&self) -> bool {
        self.flow.as_ref().and_then(|f| f.immersed.as_ref()).is_some_and(|g| g.device == FlowDevice::Gpu)
    }
}

/// Refuses sizes that make no grid, and effects that this method does not have.
pub(super) fn check(scene: &Scene, c: &mut Check) {
    let Some(flow) = &scene.flow else { return };
    let Some(g) = &flow.immersed else { return };
    c.positive("flow.immersed.spacing_m", g.spacing_m, 100.0, "a length in metres");
    c.range("flow.immersed.room", g.room, 0.0..=5.0, "in largest extents of the canopy");
    c.range("flow.immersed.wake", g.wake, 0.0..=50.0, "in largest extents of the canopy");
    c.range("flow.immersed.far_field", g.far_field, 0.5..=100.0, "in largest extents of the canopy");
    c.range("flow.immersed.far_wake", g.far_wake, 0.5..=100.0, "in largest extents of the canopy");
    c.range("flow.immersed.growth", g.growth, 1.01..=1.5, "a ratio");
    if scene.flow_on_gpu() && scene.ranks.of(Role::Flow) > 1 {
        c.refuse(
            "flow.immersed.device",
            format!("a GPU computes the flow of one rank, and ranks.flow is {}", scene.ranks.of(Role::Flow)),
            "set ranks.flow to 1, or device to \"cpu\"",
        );
    }
    const REMEDY: &str = "remove it, or [flow.immersed]";
    turbulence(flow, c);
    shear(scene, flow, c);
    let refused = [
        (flow.grid_file.is_some(), "flow.grid_file", "an immersed canopy has no fitted grid"),
        (flow.box_grid.is_some(), "flow.box", "an immersed canopy has no fitted grid"),
        (flow.energy.is_some(), "flow.energy", "the immersed flow is incompressible"),
        (flow.limiter.is_some(), "flow.limiter", "the immersed flow has no gradients to limit"),
        (flow.body_force() > 0.0, "flow.body_force_n_m3", "the immersed flow has no force on the air"),
        (!flow.probes.is_empty(), "flow.probe", "the immersed flow has no probes"),
        (
            !flow.slices.is_empty(),
            "flow.slice",
            "the immersed flow writes no slices; snapshots have all cells",
        ),
        (flow.statistics.is_some(), "flow.statistics", "the immersed flow gathers no statistics"),
        (
            flow.surface_pressure.is_some(),
            "flow.surface_pressure",
            "the immersed flow knows the pressure jump only",
        ),
        (!scene.has_canopy(), "flow.immersed", "the scene has no canopy"),
    ];
    for (given, key, why) in refused {
        if given {
            c.refuse(key, why, if key == "flow.immersed" { "remove it" } else { REMEDY });
        }
    }
    for (k, stage) in scene.stages.iter().enumerate() {
        if stage.steady.is_some() && stage.kind == StageKind::FlowOnly {
            c.refuse(
                &format!("stage[{k}].steady"),
                "the immersed flow has no march to a steady state",
                REMEDY,
            );
        }
    }
}

/// Refuses a wind by height that an incompressible flow cannot have, or that another method does not hand over.
fn shear(scene: &Scene, flow: &Flow, c: &mut Check) {
    let Some(s) = &flow.shear else { return };
    let vertical = |wind: &[f64; 3]| wind[2] != s.table_m_s.first().map_or(0.0, |first| first[2]);
    if s.table_m_s.iter().any(vertical) || flow.wind_m_s[2] != 0.0 {
        c.refuse(
            "flow.shear",
            "the vertical wind changes with height, but the immersed flow is incompressible",
            "give all heights the same vertical wind in a table, or remove it; a vertical wind in time is a gust",
        );
    }
    let flows = || scene.stages.iter().enumerate().filter(|(_, s)| s.kind.roles().contains(&Role::Flow));
    let fitted = flows().find(|(_, stage)| !scene.is_immersed(stage));
    if let Some((k, _)) = fitted.filter(|_| flows().any(|(_, stage)| scene.is_immersed(stage))) {
        c.refuse(
            &format!("stage[{k}].flow_method"),
            "a flow is not handed over between a fitted and an immersed grid in a wind that changes with height",
            "use one method in all stages, or remove [flow.shear]",
        );
    }
}

/// Refuses turbulence models and friction that this method does not have.
fn turbulence(flow: &Flow, c: &mut Check) {
    let Some(v) = &flow.viscosity else { return };
    if let Some(Turbulence::SpalartAllmaras | Turbulence::Des97 | Turbulence::Ddes) = v.turbulence {
        c.refuse(
            "flow.viscosity.turbulence",
            "the immersed flow has the turbulence models smagorinsky and wale only",
            "use \"wale\", or remove [flow.immersed]",
        );
    }
    if v.wall_treatment == Some(WallTreatment::Automatic) {
        c.refuse(
            "flow.viscosity.wall_treatment",
            "the immersed flow has no law of the wall",
            "remove it, or [flow.immersed]",
        );
    }
}
