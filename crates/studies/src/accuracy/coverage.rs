//! Sources of error without an estimate: parameters that are not varied, or with too few samples.

use case::{Canopy, Role, Scene, Solve};
use effects::table::TABLE;

use super::answer::covered;
use super::judge::Outcome;
use super::parameter::{self, Parameter};
use super::study::{SWEEP, Study};

/// A source of error without an estimate.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct NotAssessed {
    /// Parameter, or another source of error.
    pub name: String,
    /// Why there is no estimate.
    pub why: String,
}

const NOT_VARIED: &str = "not varied in this study";

/// All sources of error without an estimate.
pub fn not_assessed(study: &Study, outcome: &Outcome) -> Vec<NotAssessed> {
    let scene = &study.samples[0].scene;
    let mut all = Vec::new();
    let mut add = |name: &str, why: &str| all.push(NotAssessed { name: name.into(), why: why.into() });
    for (name, why) in too_few(study, outcome) {
        add(&name, &why);
    }
    let varied = |name: &str| study.lines.iter().any(|l| l.name == name);
    for name in parameter::names() {
        let both = ["structure-grid", "flow-grid"];
        let within = both.contains(&name) && varied("grid");
        if name != "grid" && !within && !varied(name) && available(name, scene, study.stage) {
            add(name, NOT_VARIED);
        }
    }
    from_files(scene, &mut add);
    let earlier: Vec<&str> = scene.stages[..study.stage]
        .iter()
        .filter(|s| s.solve != Solve::Static && s.steady.is_none())
        .map(|s| s.name.as_str())
        .collect();
    if !earlier.is_empty() {
        add(&format!("windows and substeps of earlier stages ({})", earlier.join(", ")), NOT_VARIED);
    }
    if scene.flow.is_some()
        && !study.parameters.iter().any(|d| d.parameter.name.starts_with("flow.grid.far_field"))
    {
        add("distance of the far field", NOT_VARIED);
    }
    if !study.lines.iter().any(|l| TABLE.iter().any(|e| e.key == l.name)) {
        add("physical models (`ripstop effects` ranks them)", NOT_VARIED);
    }
    all
}

fn available(name: &str, scene: &Scene, stage: usize) -> bool {
    Parameter::fits(name, scene, stage) || Parameter::find(name, scene, stage, true).is_ok()
}

/// Parameters without an estimate for some quantity, with the reason and the quantities.
fn too_few(study: &Study, outcome: &Outcome) -> Vec<(String, String)> {
    let mut all = Vec::new();
    let lines = study.lines.iter().zip(&outcome.lines);
    for (line, judged) in lines.filter(|(l, _)| l.name != SWEEP && !covered(study, &l.name)) {
        let lacking: Vec<(&str, &str)> = study
            .quantities
            .iter()
            .zip(judged)
            .filter_map(|(q, j)| Some((q.name.as_str(), j.unassessed.as_deref()?)))
            .collect();
        let Some((_, why)) = lacking.first() else { continue };
        let of = if lacking.len() == study.quantities.len() {
            String::new()
        } else {
            format!(" (for {})", lacking.iter().map(|l| l.0).collect::<Vec<_>>().join("; "))
        };
        all.push((line.name.clone(), format!("{why}{of}")));
    }
    all
}

/// Meshes from files cannot be refined.
fn from_files(scene: &Scene, add: &mut impl FnMut(&str, &str)) {
    if matches!(scene.canopy, Canopy::Gmsh(_)) {
        add("mesh of the canopy", "it is read from a file; repeat the study with a finer file");
    }
    let runs = scene.stages.iter().any(|s| s.kind.roles().contains(&Role::Flow));
    if runs && scene.grid_file().is_some() {
        add("flow grid", "it is read from a file; repeat the study with a finer file");
    }
}

/// The names in one line; `None` if all errors are assessed.
pub fn line(all: &[NotAssessed]) -> Option<String> {
    let names: Vec<&str> = all.iter().map(|n| n.name.as_str()).collect();
    (!names.is_empty()).then(|| format!("not assessed: {}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn exactly_the_parameters_without_estimate_are_listed() {
        let (study, mut values, mut records) = made();
        let names = |o: &Outcome| not_assessed(&study, o).into_iter().map(|n| n.name).collect::<Vec<_>>();
        let outcome = judge(&study, &values, &records, Measure::Work);
        let all = names(&outcome);
        for name in
            ["substeps", "coupling-tolerance", "flow-drop", "newton-tolerance", "distance of the far field"]
        {
            assert!(all.iter().any(|n| n == name), "{name}: {all:?}");
        }
        for name in ["grid", "structure-grid", "flow-grid", "window", "scheme", "static-tolerance"] {
            assert!(!all.iter().any(|n| n == name), "{name}: {all:?}");
        }
        assert!(all.iter().any(|n| n.contains("earlier stages (pre-inflation, developed-flow)")), "{all:?}");
        for m in 1..study.samples.len() {
            values[m][0] = Err("no result".into());
            records[m].failure = Some("diverged".into());
        }
        let all = names(&judge(&study, &values, &records, Measure::Work));
        assert!(["grid", "window", "scheme"].iter().all(|name| all.iter().any(|n| n == name)), "{all:?}");
    }
}
