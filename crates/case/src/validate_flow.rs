//! Sense and contradictions of the flow's effects.

use crate::scene::*;
use crate::validate::Check;
use crate::{Permeability, Shear, ShearProfile, Steady};

/// Refuses what no flow could do.
pub(crate) fn flow_effects(scene: &Scene, c: &mut Check) {
    if let Some(p) = &scene.fabric.permeability {
        permeability(p, scene, c);
    }
    if let Some(flow) = &scene.flow {
        if let Some(s) = &flow.shear {
            shear(s, flow, c);
        }
        for (k, stage) in scene.stages.iter().enumerate() {
            if let Some(s) = &stage.steady {
                steady(s, &format!("stage[{k}].steady"), stage, scene, flow, c);
            }
        }
    }
}

fn permeability(p: &Permeability, scene: &Scene, c: &mut Check) {
    let at = "fabric.permeability";
    let given = p.viscous_pa_s_m.is_some() || p.inertial_pa_s2_m2.is_some();
    if given == p.cloth.is_some() {
        c.refuse(
            at,
            format!("the fabric has {} permeability", if given { "two kinds of" } else { "no" }),
            "give either `cloth` or `viscous_pa_s_m` and `inertial_pa_s2_m2`",
        );
    }
    let (a, b) = p.coefficients();
    for (key, value) in [("viscous_pa_s_m", a), ("inertial_pa_s2_m2", b)] {
        // Infinity is an airtight fabric.
        if value.is_nan() || value < 0.0 {
            c.refuse(&format!("{at}.{key}"), format!("`{key}` is {value}"), "0 or more");
        }
    }
    if given && a == 0.0 && b == 0.0 {
        c.refuse(at, "a fabric without resistance is no fabric", "one coefficient must be above 0");
    }
    if scene.flow.is_none() {
        c.refuse(
            at,
            "air passes the fabric, but the scene has no flow",
            "remove it, or add a [flow] section: a pre-inflation knows its pressure without air",
        );
    }
}

fn shear(s: &Shear, flow: &Flow, c: &mut Check) {
    let at = |key: &str| format!("flow.shear.{key}");
    c.range(&at("start_height_m"), s.start_height_m, 0.0, 1e5, true, "above ground, m");
    c.positive(&at("reference_height_m"), s.reference_height_m, 1e5, "above ground, m");
    let calm = flow.wind_m_s == [0.0; 3];
    let table = s.profile == ShearProfile::Table;
    if calm != table {
        c.refuse(
            &at("profile"),
            if calm {
                "the profile scales a wind that is zero"
            } else {
                "table and `wind_m_s` both give the wind"
            },
            if calm { "set flow.wind_m_s, the wind at `reference_height_m`" } else { "remove flow.wind_m_s" },
        );
    }
    match s.profile {
        ShearProfile::Power => {
            c.range(&at("exponent"), s.exponent, 0.0, 2.0, true, "0.1 to 0.3 is usual");
        }
        ShearProfile::Log => {
            c.positive(&at("roughness_m"), s.roughness_m, 0.5 * s.reference_height_m, "a length in metres");
        }
        ShearProfile::Linear => c.range(&at("slope_per_m"), s.slope_per_m, -10.0, 10.0, true, "in 1/m"),
        ShearProfile::Table => {}
    }
    let ascending = s.height_m.windows(2).all(|w| w[0] < w[1]);
    let finite = s.height_m.iter().chain(s.table_m_s.iter().flatten()).all(|v| v.is_finite());
    if table && (s.height_m.len() < 2 || s.height_m.len() != s.table_m_s.len() || !ascending || !finite) {
        c.refuse(
            &at("height_m"),
            format!("the table has {} heights and {} winds", s.height_m.len(), s.table_m_s.len()),
            "list at least two ascending heights and as many winds",
        );
    }
    let rows = s.height_m.len() + s.table_m_s.len();
    if !table && rows > 0 {
        c.refuse(&at("height_m"), "a table is given, but the profile is a law", "set profile = \"table\"");
    }
}

fn steady(s: &Steady, at: &str, stage: &Stage, scene: &Scene, flow: &Flow, c: &mut Check) {
    if stage.kind != StageKind::FlowOnly {
        c.refuse(
            at,
            format!("stage \"{}\" moves in time", stage.name),
            "only a stage of kind \"flow-only\" can be steady",
        );
    }
    c.range(&format!("{at}.residual_drop"), s.residual_drop, 0.0, 0.5, true, "a factor; 0 never stops");
    c.range(
        &format!("{at}.force_change"),
        s.force_change,
        0.0,
        0.5,
        true,
        "a share of the force; 0 never stops",
    );
    if s.residual_drop == 0.0 && s.force_change == 0.0 {
        c.refuse(at, "neither the residual nor the force ends the march", "set one of them above 0");
    }
    c.count(&format!("{at}.max_steps"), s.max_steps, 1, 1_000_000, "steps");
    c.range(&format!("{at}.max_courant"), s.max_courant, 1.0, 1e9, true, "a Courant number");
    let falls = scene.descent.as_ref().is_some_and(|d| d.initial_speed_m_s != 0.0);
    if flow.shear.is_some() && falls {
        c.refuse(
            at,
            "a frame that falls through sheared wind meets another wind at every height",
            "remove [flow.shear], or give the stage a duration instead",
        );
    }
    if let Some(t) = flow.viscosity.as_ref().and_then(|v| v.turbulence)
        && t != Turbulence::SpalartAllmaras
    {
        c.refuse(
            at,
            "resolved eddies are never steady",
            "use turbulence = \"spalart-allmaras\", or give the stage a duration instead",
        );
    }
}
