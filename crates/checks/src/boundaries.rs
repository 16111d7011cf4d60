//! Checks of what one stage hands over to the next: wind, motion, force, the start of the flow.

use case::{Clock, Jump, Role, Scene, StageTimes, jumps};

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Note, Warning};
use super::table::{Check, When};

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "stages.wind",
        what: "the wind does not change at once between two stages",
        estimate: "size of w(start of the stage) - w(end of the last stage with the flow), by the winds, gusts and clocks \
                   of the scene and the planned durations",
        range: "warning above 0.1 % of the speed of the stream",
        source: "such a change is 0.2 % of the dynamic pressure; a jump V accelerates all of the air by V / dt within the \
                 first window of length dt, so that the canopy meets its added mass times V / dt",
        severity: Warning,
        remedy: "give the change a time by ramp_s in [stage.wind]; let a gust end within its stage, or write it as \
                 [flow.gust]",
        when: When::Before(wind),
    },
    Check {
        id: "stages.motion",
        what: "prescribed motions neither start displaced nor change their velocity at once between two stages",
        estimate: "displacement at the start of the stage; size of the velocity at its start less that at the end of \
                   the stage before",
        range: "warning above round-off, 1e-9 m and 1e-9 m/s",
        source: "a jump of the velocity V of a wall is a pressure of rho V c in the first window, with the speed of \
                 sound c",
        severity: Warning,
        remedy: "begin and end the table with intervals in which the velocity grows from zero and falls to zero",
        when: When::Before(motion),
    },
    Check {
        id: "stages.force",
        what: "forces on nodes do not change at once between two stages",
        estimate: "size of the force in the stage less that in the stage before, on each node",
        range: "warning where they differ and the structure moves in time",
        source: "a force that appears at once doubles the deflection of an undamped structure",
        severity: Warning,
        remedy: "give both stages the same [[stage.force]]",
        when: When::Before(force),
    },
    Check {
        id: "stages.gust",
        what: "a gust meets a stage with the flow, and that of a stage its stage",
        estimate: "start_s and duration_s on the gust's clock, against the planned durations of the stages",
        range: "warning where no stage with the flow, or not the stage that gives the gust, has a time within it",
        source: "the scene asks for a gust that never blows",
        severity: Warning,
        remedy: "compare start_s, clock and the durations of the stages",
        when: When::Before(gust),
    },
    Check {
        id: "stages.start",
        what: "the flow is developed before the canopy moves in it",
        estimate: "speed of the canopy through the air at the start of the first stage with the flow, where that is \
                   coupled or prescribed",
        range: "a note",
        source: "an impulsive start: the added mass acts within the first window",
        severity: Note,
        remedy: "",
        when: When::Before(start),
    },
];

/// The jumps of `keys` at the starts of the stages that run.
fn of(facts: &Facts<'_>, keys: &[&str]) -> Vec<Judged> {
    let all = jumps(facts.scene, &StageTimes::planned(facts.scene));
    let judged = |jump: &Jump| {
        let key = format!("stage[{}].{}", jump.stage, jump.key);
        Judged::new(Warning, key, jump.to_string()).remedy(jump.remedy.clone())
    };
    all.iter().filter(|j| j.stage >= facts.first && keys.contains(&j.key)).map(judged).collect()
}

fn wind(facts: &Facts<'_>) -> Vec<Judged> {
    of(facts, &["wind", "gust"])
}

fn motion(facts: &Facts<'_>) -> Vec<Judged> {
    of(facts, &["motion"])
}

fn force(facts: &Facts<'_>) -> Vec<Judged> {
    of(facts, &["force"])
}

fn gust(facts: &Facts<'_>) -> Vec<Judged> {
    let (scene, times) = (facts.scene, StageTimes::planned(facts.scene));
    let flows = |k: &usize| scene.stages[*k].kind.roles().contains(&Role::Flow);
    let own = |k: &usize| scene.stages[*k].gust.is_some();
    let met = |k: &usize| scene.wind(*k, &times).gusts(times.of(*k));
    let mut found = Vec::new();
    for k in (0..scene.stages.len()).filter(own).filter(|k| !flows(k) || !met(k)) {
        found.push(Judged::new(Warning, format!("stage[{k}].gust"), blows_past(scene, &times, &[k])));
    }
    let common: Vec<usize> = (0..scene.stages.len()).filter(flows).filter(|k| !own(k)).collect();
    if scene.flow.as_ref().is_some_and(|f| f.gust.is_some()) && !common.iter().any(met) {
        found.push(Judged::new(Warning, "flow.gust", blows_past(scene, &times, &common)));
    }
    found
}

/// When a gust blows that none of `stages` meets, and when these run.
fn blows_past(scene: &Scene, times: &StageTimes, stages: &[usize]) -> String {
    let what = "the gust meets no stage with the flow";
    let first = stages.first().and_then(|k| Some((*k, scene.gust(*k)?)));
    let (Some((first, (gust, clock))), Some(last)) = (first, stages.last()) else { return what.into() };
    let at = |k: usize| times.clock(scene, k, clock);
    let name = match clock {
        Clock::Stage => "of the stage",
        Clock::Release => "from the release",
        Clock::Run => "of the run",
    };
    format!(
        "{what}: it blows from {} to {} s {name}, `{}` begins at {} s and `{}` ends at {} s",
        digits(gust.start_s),
        digits(gust.start_s + gust.duration_s),
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
            "stage \"{}\" is the first with the flow: from its first window on the canopy moves through air at rest at \
             {} m/s (a stage of kind \"flow-only\" before it develops the flow)",
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

    /// What `judge` finds in the small descent with a change.
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
    fn a_gust_that_no_stage_meets_is_named() {
        let late = |start_s: f64| {
            found(gust, |s| {
                let flow = s.flow.as_mut().expect("a flow");
                flow.gust =
                    Some(case::Gust { velocity_m_s: [1.0; 3], start_s, duration_s: 0.05, clock: None });
            })
        };
        // The descent takes 0.1 s from the release.
        assert!(late(0.09).is_empty() && found(gust, |_| {}).is_empty());
        assert_eq!(
            late(0.11),
            [
                "flow.gust: the gust meets no stage with the flow: it blows from 0.110 to 0.160 s from the release, \
             `developed-flow` begins at -0.200 s and `descent` ends at 0.100 s"
            ]
        );
        // That of a stage, and of one without the flow.
        let own = |stage: usize, start_s: f64| {
            found(gust, |s| {
                let gust = case::Gust { velocity_m_s: [1.0; 3], start_s, duration_s: 0.05, clock: None };
                s.stages[stage].gust = Some(gust);
            })
        };
        assert!(own(1, 0.19).is_empty());
        assert_eq!(
            own(1, 0.21),
            [
                "stage[1].gust: the gust meets no stage with the flow: it blows from 0.210 to 0.260 s of the stage, \
             `developed-flow` begins at 0 s and `developed-flow` ends at 0.200 s"
            ]
        );
        assert!(own(0, 0.0)[0].starts_with("stage[0].gust: the gust meets no stage with the flow"));
    }

    #[test]
    fn a_cut_gust_and_an_impulsive_start_are_named() {
        let cut = |s: &mut case::Scene| {
            let gust =
                case::Gust { velocity_m_s: [0.0, 0.0, 2.0], start_s: 0.15, duration_s: 0.1, clock: None };
            s.stages[1].gust = Some(gust);
        };
        let text = found(wind, cut).join("; ");
        assert!(text.starts_with("stage[2].gust: the wind changes"), "{text}");
        assert!(text.contains("a jump of 2.000 m/s"), "{text}");
        assert!(found(wind, |_| {}).is_empty() && found(start, |_| {}).is_empty());
        let text = found(start, |s| drop(s.stages.remove(1))).join("; ");
        assert!(text.contains("stage[1].kind") && text.contains("\"descent\" is the first"), "{text}");
    }
}
