//! Checks of discontinuities between stages: wind, motion, force, start of the flow.

use case::{Clock, Jump, Role, Scene, StageTimes, jumps};

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Note, Warning};
use super::table::{Check, When};

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "stages.wind",
        what: "the wind is continuous between stages",
        estimate: "size of w(start of the stage) - w(end of the last stage with the flow), by the winds, gusts and clocks \
                   of the scene and the planned durations",
        range: "warning above 0.1 % of the free-stream speed",
        source: "a change of 0.1 % is 0.2 % of the dynamic pressure; a jump V accelerates all of the air by V / dt within the \
                 first window of length dt, so that the canopy carries a load of its added mass times V / dt",
        severity: Warning,
        remedy: "set a transition time with ramp_s in [stage.wind]; let a gust end within its stage, or define it as \
                 [flow.gust]",
        when: When::Before(wind),
    },
    Check {
        id: "stages.motion",
        what: "prescribed motions start without displacement, and their velocity is continuous between stages, also that of \
               rigid bodies",
        estimate: "displacement at the start of the stage; velocity at its start minus velocity at the end of \
                   the previous stage",
        range: "warning above round-off, 1e-9 m and 1e-9 m/s; of bodies above 0.1 % of their largest speed",
        source: "a jump of the velocity V of a wall is a pressure of rho V c in the first window, with the speed of \
                 sound c",
        severity: Warning,
        remedy: "begin and end the table with intervals in which the velocity grows from zero and falls to zero",
        when: When::Before(motion),
    },
    Check {
        id: "stages.force",
        what: "nodal forces are continuous between stages",
        estimate: "force in the stage minus force in the previous stage, on each node",
        range: "warning where they differ and the structure moves in time; a note where they are in sum below 1 % of the \
                dynamic force on the nominal area",
        source: "a suddenly applied force gives twice the static deflection of an undamped structure",
        severity: Warning,
        remedy: "give both stages the same [[stage.force]]",
        when: When::Before(force),
    },
    Check {
        id: "stages.gust",
        what: "a gust acts during a stage with flow; the gust of a stage acts during that stage",
        estimate: "start and end of the gust on its clock, compared with the planned durations of the stages",
        range: "warning if the gust overlaps no stage with flow, or a gust of a stage does not overlap that stage",
        source: "the scene defines a gust that has no effect",
        severity: Warning,
        remedy: "compare start_s, clock and the durations of the stages",
        when: When::Before(gust),
    },
    Check {
        id: "stages.gust-period",
        what: "windows resolve the period of a gust that repeats, or of turbulence",
        estimate: "period of the gust over window_s, in stages with flow that the gust overlaps; of a train of pulses the \
                   duration of a pulse, of turbulence (also of [flow.shear.turbulence] in a fall at the initial speed) the period below \
                   which lies 1 % of the variance across the passage",
        range: "warning below 20 windows in a period; otherwise a note",
        source: "the second-order time differences change the frequency omega of a response by (omega dt)^2 / 3, 3.3 % at 20 \
                 windows in a period",
        severity: Warning,
        remedy: "shorten window_s of the stage",
        when: When::Before(gust_period),
    },
    Check {
        id: "stages.start",
        what: "the flow is developed before the canopy moves in it",
        estimate: "speed of the canopy relative to the air at the start of the first stage with flow, if that stage is \
                   coupled or prescribed",
        range: "a note",
        source: "an impulsive start: the added mass acts within the first window",
        severity: Note,
        remedy: "",
        when: When::Before(start),
    },
];

/// The jumps of `keys` at the start of the stages to run.
fn jumps_of(facts: &Facts<'_>, keys: &[&str]) -> Vec<Judged> {
    let all = jumps(facts.scene, &StageTimes::planned(facts.scene));
    let judged = |jump: &Jump| {
        let key = format!("stage[{}].{}", jump.stage, jump.key);
        Judged::new(Warning, key, jump.to_string()).remedy(jump.remedy.clone())
    };
    all.iter().filter(|j| j.stage >= facts.first && keys.contains(&j.key)).map(judged).collect()
}

fn wind(facts: &Facts<'_>) -> Vec<Judged> {
    jumps_of(facts, &["wind", "gust"])
}

fn motion(facts: &Facts<'_>) -> Vec<Judged> {
    jumps_of(facts, &["motion", "body_motion"])
}

fn force(facts: &Facts<'_>) -> Vec<Judged> {
    let mut found = jumps_of(facts, &["force"]);
    if largest_force(facts) < SMALL_FORCE * facts.numbers.peak_pressure() * facts.nominal_area() {
        found.iter_mut().for_each(|j| j.severity = Note);
    }
    found
}

/// Share of the dynamic force on the canopy below which a jump of nodal forces is a note.
const SMALL_FORCE: f64 = 0.01;

/// Sum of the sizes of all nodal forces of a stage, the largest of the stages, N.
fn largest_force(facts: &Facts<'_>) -> f64 {
    let size = |force: &case::Force| {
        let nodes = facts.mesh.nodes_of("force", force.nodes.as_deref(), force.at_m).map_or(0, |n| n.len());
        nodes as f64 * force.force_n.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    let of_stage = |stage: &case::Stage| stage.forces.iter().map(size).sum::<f64>();
    facts.scene.stages.iter().map(of_stage).fold(0.0, f64::max)
}

fn gust(facts: &Facts<'_>) -> Vec<Judged> {
    let (scene, times) = (facts.scene, StageTimes::planned(facts.scene));
    let flows = |k: &usize| scene.stages[*k].kind.roles().contains(&Role::Flow);
    let own = |k: &usize| scene.stages[*k].gust.is_some();
    let met = |k: &usize| scene.wind(*k, &times).gusts(times.of(*k));
    let mut found = Vec::new();
    for k in (0..scene.stages.len()).filter(own).filter(|k| !flows(k) || !met(k)) {
        found.push(Judged::new(Warning, format!("stage[{k}].gust"), gust_times(scene, &times, &[k])));
    }
    let common: Vec<usize> = (0..scene.stages.len()).filter(flows).filter(|k| !own(k)).collect();
    if scene.flow.as_ref().is_some_and(|f| f.gust.is_some()) && !common.iter().any(met) {
        found.push(Judged::new(Warning, "flow.gust", gust_times(scene, &times, &common)));
    }
    found
}

/// Windows in the period of a gust below which the response of the flow is not resolved.
const WINDOWS_PER_PERIOD: f64 = 20.0;

fn gust_period(facts: &Facts<'_>) -> Vec<Judged> {
    let (scene, times) = (facts.scene, StageTimes::planned(facts.scene));
    let mut found = Vec::new();
    for (k, stage) in facts.stages().filter(|(_, s)| s.kind.roles().contains(&Role::Flow) && s.in_time()) {
        let gust = scene.gust(k).filter(|_| scene.wind(k, &times).gusts(times.of(k)));
        let turbulent = gust.is_some_and(|(gust, _)| gust.shape == case::GustShape::Dryden);
        let gust = gust.and_then(|(gust, _)| gust.shortest_period()).map(|p| (p, "the gust's", turbulent));
        let fall = scene.resolved().initial_velocity_m_s[2].abs();
        let layered = scene.shear().and_then(|s| s.turbulence.as_ref()?.shortest_period(fall));
        let layered = layered.map(|p| (p, "the fall's", true));
        for (period, whose, turbulent) in gust.into_iter().chain(layered) {
            let windows = period / stage.window_s;
            let severity = if windows < WINDOWS_PER_PERIOD { Warning } else { Note };
            let meaning =
                if turbulent { ", below which lies 1 % of the variance of the turbulence" } else { "" };
            let figure = format!(
                "stage `{}` has {} windows in {whose} period of {} s{meaning}",
                stage.name,
                digits(windows),
                digits(period)
            );
            let longest = digits(period / WINDOWS_PER_PERIOD);
            let remedy = format!("set window_s of the stage to {longest} s or less");
            found.push(Judged::new(severity, format!("stage[{k}].window_s"), figure).remedy(remedy));
        }
    }
    found
}

/// The times of a gust that overlaps none of `stages`, and the times of these stages.
fn gust_times(scene: &Scene, times: &StageTimes, stages: &[usize]) -> String {
    let what = "the gust overlaps no stage with flow";
    let first = stages.first().and_then(|k| Some((*k, scene.gust(*k)?)));
    let (Some((first, (gust, clock))), Some(last)) = (first, stages.last()) else { return what.into() };
    let at = |k: usize| times.clock(scene, k, clock);
    let [begin, end] = gust.acts();
    let name = match clock {
        Clock::Stage => "of the stage",
        Clock::Release => "from the release",
        Clock::Run => "of the run",
    };
    format!(
        "{what}: it acts from {} to {} s {name}, `{}` begins at {} s and `{}` ends at {} s",
        digits(begin),
        digits(end),
        scene.stages[first].name,
        digits(at(first)),
        scene.stages[*last].name,
        digits(at(*last) + times.of(*last))
    )
}

fn start(facts: &Facts<'_>) -> Vec<Judged> {
    let starts = facts.scene.impulsive_starts(&StageTimes::planned(facts.scene));
    let judged = |(stage, speed): (usize, f64)| {
        let figure = format!(
            "stage \"{}\" is the first with flow: the canopy starts impulsively in air at rest at \
             {} m/s (a preceding stage of kind \"flow-only\" develops the flow)",
            facts.scene.stages[stage].name,
            digits(speed)
        );
        Judged::new(Note, format!("stage[{stage}].kind"), figure)
    };
    starts.into_iter().filter(|(stage, _)| *stage >= facts.first).map(judged).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::facts::Machine;
    use super::*;
    use coupling::interface::CanopyInterface;

    /// Findings of `judge` in `square-drop` with a change.
    fn found(judge: fn(&Facts<'_>) -> Vec<Judged>, change: impl Fn(&mut case::Scene)) -> Vec<String> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
        let mut scene = case::load(&file).expect("a scene of the repository");
        change(&mut scene);
        let interface = CanopyInterface::new(&scene).expect("a canopy");
        let machine = Machine { cores: 4, memory: None, disk: None, hosts: false };
        let facts = Facts::new(&scene, &interface, machine, 0).expect("facts");
        judge(&facts).into_iter().map(|j| format!("{}: {}", j.key, j.figure)).collect()
    }

    #[test]
    fn gust_outside_all_flow_stages_gives_a_warning() {
        let late = |start_s: f64| {
            found(gust, |s| {
                let flow = s.flow.as_mut().expect("a flow");
                flow.gust = Some(case::Gust::pulse([1.0; 3], start_s, 0.05));
            })
        };
        // The descent takes 0.1 s from the release.
        assert!(late(0.09).is_empty() && found(gust, |_| {}).is_empty());
        assert_eq!(
            late(0.11),
            [
                "flow.gust: the gust overlaps no stage with flow: it acts from 0.110 to 0.160 s from the release, \
             `developed-flow` begins at -0.200 s and `descent` ends at 0.100 s"
            ]
        );
        // The gust of a stage with flow, and of a stage without.
        let own = |stage: usize, start_s: f64| {
            found(gust, |s| {
                s.stages[stage].gust = Some(case::Gust::pulse([1.0; 3], start_s, 0.05));
            })
        };
        assert!(own(1, 0.19).is_empty());
        assert_eq!(
            own(1, 0.21),
            [
                "stage[1].gust: the gust overlaps no stage with flow: it acts from 0.210 to 0.260 s of the stage, \
             `developed-flow` begins at 0 s and `developed-flow` ends at 0.200 s"
            ]
        );
        assert!(own(0, 0.0)[0].starts_with("stage[0].gust: the gust overlaps no stage with flow"));
    }

    #[test]
    fn truncated_gust_and_impulsive_start_are_reported() {
        let cut = |s: &mut case::Scene| {
            s.stages[1].gust = Some(case::Gust::pulse([0.0, 0.0, 2.0], 0.15, 0.1));
        };
        let text = found(wind, cut).join("; ");
        assert!(text.starts_with("stage[2].gust: the wind changes"), "{text}");
        assert!(text.contains("a jump of 2.000 m/s"), "{text}");
        assert!(found(wind, |_| {}).is_empty() && found(start, |_| {}).is_empty());
        let text = found(start, |s| drop(s.stages.remove(1))).join("; ");
        assert!(text.contains("stage[1].kind") && text.contains("\"descent\" is the first"), "{text}");
    }
}
