//! Which effects a scene turns on, by their keys.

use case::{Integration, Role, Scene, Turbulence};

/// One effect: its scene key, the program that must implement it, and whether
/// the scene asks for it.
pub struct Effect {
    /// Dotted key in the scene.
    pub key: &'static str,
    /// The program that simulates it.
    pub role: Role,
    /// Asked for.
    pub on: bool,
    /// One line for people.
    pub what: &'static str,
}

/// All effects that can be on or off.
pub fn effects(scene: &Scene) -> Vec<Effect> {
    let effect = |key, role, on, what| Effect { key, role, on, what };
    let flow = scene.flow.as_ref();
    let viscosity = flow.and_then(|f| f.viscosity.as_ref());
    let turbulence = viscosity.and_then(|v| v.turbulence);
    vec![
        effect("fabric.wrinkling", Role::Structure, scene.fabric.wrinkling, "fabric carries no compression"),
        effect(
            "fabric.orthotropic",
            Role::Structure,
            scene.fabric.orthotropic.is_some(),
            "different stiffness along warp and weft",
        ),
        effect("lines", Role::Structure, scene.has_cables(), "suspension lines and risers"),
        effect(
            "fabric_gravity",
            Role::Structure,
            scene.fabric_gravity.is_some(),
            "weight and inertia of the fabric in the falling frame",
        ),
        effect("point_mass", Role::Structure, !scene.point_masses.is_empty(), "masses on nodes"),
        effect(
            "stage.stiffness_damping_s",
            Role::Structure,
            scene.stages.iter().any(|s| s.stiffness_damping_s > 0.0),
            "stresses by the rate of strains",
        ),
        effect(
            "structure.integration",
            Role::Structure,
            scene.structure.integration == Integration::Explicit,
            "explicit time integration of the structure",
        ),
        effect(
            "stage.motion",
            Role::Structure,
            scene.stages.iter().any(|s| !s.motions.is_empty()),
            "prescribed motions of nodes",
        ),
        effect(
            "stage.force",
            Role::Structure,
            scene.stages.iter().any(|s| !s.forces.is_empty()),
            "forces on nodes",
        ),
        effect("flow.viscosity", Role::Flow, viscosity.is_some(), "laminar viscosity, no slip on the canopy"),
        effect(
            "flow.viscosity.turbulence",
            Role::Flow,
            turbulence.is_some(),
            "model of the unresolved turbulence",
        ),
        effect(
            "flow.viscosity.turbulence.spalart-allmaras",
            Role::Flow,
            turbulence == Some(Turbulence::SpalartAllmaras),
            "all turbulence by one transported eddy viscosity",
        ),
        effect(
            "flow.viscosity.turbulence.des",
            Role::Flow,
            matches!(turbulence, Some(Turbulence::Des97 | Turbulence::Ddes)),
            "turbulence modelled at walls, resolved away from them",
        ),
        effect(
            "fabric.permeability",
            Role::Flow,
            scene.fabric.permeability.is_some(),
            "air passes the fabric",
        ),
        effect("flow.shear", Role::Flow, flow.is_some_and(|f| f.shear.is_some()), "wind by height"),
        effect(
            "stage.steady",
            Role::Flow,
            scene.stages.iter().any(|s| s.steady.is_some()),
            "march to a steady flow",
        ),
        effect("flow.gust", Role::Flow, flow.is_some_and(|f| f.gust.is_some()), "gust"),
        effect("flow.energy", Role::Flow, flow.is_some_and(|f| f.energy.is_some()), "energy equation"),
        effect("flow.limiter", Role::Flow, flow.is_some_and(|f| f.limiter.is_some()), "gradient limiter"),
    ]
}
