//! Sense and contradictions of winds, gusts and the clocks of stages.

use crate::validate::Check;
use crate::{Clock, Flow, GAS_CONSTANT, Gust, HEAT_RATIO, Scene, Solve, Stage};

/// Refuses what no stage could do.
pub(crate) fn winds(scene: &Scene, c: &mut Check) {
    if let Some(flow) = &scene.flow {
        if let Some(g) = &flow.gust {
            gust(g, "flow.gust", c);
        }
        mach(scene, flow, c);
    }
    for (k, stage) in scene.stages.iter().enumerate() {
        let at = |key: &str| format!("stage[{k}].{key}");
        own(scene, stage, &at, c);
        for (m, _) in stage.motions.iter().enumerate().filter(|(_, m)| {
            stage.solve == Solve::Static && m.clock.is_some_and(|clock| clock != Clock::Stage)
        }) {
            c.refuse(
                &at(&format!("motion[{m}].clock")),
                format!("stage \"{}\" is static: no clock runs in it", stage.name),
                "remove `clock`: the stage ends at the last displacement",
            );
        }
    }
}

fn gust(g: &Gust, path: &str, c: &mut Check) {
    c.positive(&format!("{path}.duration_s"), g.duration_s, 1e6, "a time in s");
    c.range(&format!("{path}.start_s"), g.start_s, 0.0, 1e6, true, "in s");
    if !g.velocity_m_s.iter().all(|v| v.is_finite()) {
        c.refuse(&format!("{path}.velocity_m_s"), "a velocity is not a number", "three numbers in m/s");
    }
}

/// Wind and gust of one stage.
fn own(scene: &Scene, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let Some(flow) = &scene.flow else {
        for (key, _) in
            [("wind", stage.wind.is_some()), ("gust", stage.gust.is_some())].iter().filter(|k| k.1)
        {
            c.refuse(&at(key), "the wind needs air, but the scene has none", "add a [flow] section");
        }
        return;
    };
    if let Some(w) = &stage.wind {
        c.range(&at("wind.ramp_s"), w.ramp_s, 0.0, 1e6, true, "in s");
        if !w.velocity_m_s.iter().all(|v| v.is_finite()) {
            c.refuse(&at("wind.velocity_m_s"), "a velocity is not a number", "three numbers in m/s");
        }
        if flow.shear.is_some() {
            c.refuse(
                &at("wind"),
                "a stage has one wind for all heights, but the wind changes with height",
                "remove [flow.shear]; or remove [stage.wind] and give the stage its wind by height in [flow.shear], a change \
                 in time as a gust, which adds the same to the wind at all heights",
            );
        }
        if w.ramp_s > 0.0 && !stage.in_time() {
            c.refuse(
                &at("wind.ramp_s"),
                format!("stage \"{}\" takes no time in which the wind could change", stage.name),
                "remove `ramp_s`, or give the stage a duration instead",
            );
        } else if stage.in_time() && w.ramp_s > stage.duration_s {
            c.refuse(
                &at("wind.ramp_s"),
                format!(
                    "the wind changes over {} s, but the stage ends after {} s",
                    w.ramp_s, stage.duration_s
                ),
                "a change of wind ends within its stage",
            );
        }
    }
    if let Some(g) = &stage.gust {
        gust(g, &at("gust"), c);
    }
    let common = flow.gust.as_ref().is_some_and(|g| g.clock == Some(Clock::Stage));
    if !stage.in_time() && (stage.gust.is_some() || (common && stage.steady.is_some())) {
        c.refuse(
            &at(if stage.gust.is_some() { "gust" } else { "steady" }),
            "a gust changes in time",
            "remove the gust, let it count from the release, or give the stage a duration",
        );
    }
}

/// Speeds that the flow is not made for.
fn mach(scene: &Scene, flow: &Flow, c: &mut Check) {
    let length = |v: &[f64; 3]| v.iter().map(|w| w * w).sum::<f64>().sqrt();
    let sound = (HEAT_RATIO * GAS_CONSTANT * flow.temperature_k).sqrt();
    let fall = scene.descent.as_ref().map_or(0.0, |d| d.initial_speed_m_s);
    let most = |stage: usize| {
        let steady = scene.stages[stage].wind.as_ref().map_or(flow.wind_m_s, |w| w.velocity_m_s);
        length(&steady) + scene.gust(stage).map_or(0.0, |(g, _)| length(&g.velocity_m_s))
    };
    let speed = fall + (0..scene.stages.len()).map(most).fold(0.0, f64::max);
    if speed > 0.5 * sound {
        c.refuse(
            "descent.initial_speed_m_s",
            format!("the stream is {speed} m/s, Mach {:.2}", speed / sound),
            "the flow-solver is made for Mach numbers below 0.5",
        );
    }
}
