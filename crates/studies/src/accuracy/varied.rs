//! Parameters of a study: those of the scene, or default ones.

use case::{Scene, Solve};
use coupling::error::RunError;

use super::parameter::{Kind, Parameter, Setting};
use super::study::VariedParameter;

/// A parameter of the section `[accuracy]`, with checked values.
///
/// # Errors
/// Invalid values, or a parameter that the scene does not have.
pub fn varied_parameter(
    w: &case::Parameter,
    scene: &Scene,
    stage: usize,
) -> Result<VariedParameter, RunError> {
    let refuse = |why: String| RunError::Input(format!("accuracy.parameter `{}`: {why}", w.name));
    let words = w.values.is_empty() && !w.choices.is_empty();
    let mut parameter = Parameter::find(&w.name, scene, stage, words)?;
    if w.values.is_empty() && w.choices.is_empty() {
        return Err(refuse("neither `values` nor `choices` is given; give one of them".into()));
    }
    if !w.values.is_empty() && !w.choices.is_empty() {
        return Err(refuse("both `values` and `choices` are given; give one of them".into()));
    }
    if let Some(order) = w.order {
        if !(order > 0.0 && order <= 8.0) {
            return Err(refuse(format!("`order` is {order}, but must be above 0 and at most 8")));
        }
        parameter.promised = order;
    }
    if let Some(bad) = w.values.iter().chain(&w.check).chain(&w.base).find(|v| !(**v > 0.0 && v.is_finite()))
    {
        return Err(refuse(format!("the value {bad} is not above 0 and finite")));
    }
    let mut numbers = w.values.clone();
    // Coarse first.
    numbers.sort_by(f64::total_cmp);
    if parameter.kind == Kind::Size {
        numbers.reverse();
    }
    let finest = numbers.last().copied();
    if let (Some(check), Some(finest)) = (w.check, finest) {
        let finer = if parameter.kind == Kind::Fineness { check > finest } else { check < finest };
        if !finer {
            return Err(refuse(format!("`check` is {check}, but must be finer than all values ({finest})")));
        }
    }
    let values: Vec<Setting> = if words {
        w.choices.iter().cloned().map(Setting::Choice).collect()
    } else {
        numbers.into_iter().map(Setting::Number).collect()
    };
    let base = match (&w.base, &w.base_choice) {
        (Some(x), _) => Some(Setting::Number(*x)),
        (_, Some(word)) => Some(Setting::Choice(word.clone())),
        _ => parameter.own(scene),
    };
    let base = base.ok_or_else(|| refuse("the scene does not set this value: give a `base`".into()))?;
    Ok(VariedParameter { parameter, values, base, check: w.check.map(Setting::Number) })
}

/// Default parameters of a scene.
pub fn defaults(scene: &Scene, stage: usize) -> Vec<case::Parameter> {
    let mut all = Vec::new();
    let mut numbers = |name: &str, values: &[f64], check: Option<f64>| {
        if Parameter::fits(name, scene, stage) {
            all.push(case::Parameter {
                name: name.into(),
                values: values.to_vec(),
                check,
                ..case::Parameter::default()
            });
        }
    };
    let thirds = [0.5, 2.0 / 3.0, 5.0 / 6.0, 1.0];
    if Parameter::fits("grid", scene, stage) {
        numbers("grid", &thirds, Some(1.5));
    } else {
        numbers("structure-grid", &thirds, Some(1.5));
        numbers("flow-grid", &thirds, Some(1.5));
    }
    // Without coupling, the windows of the structure only set the output interval.
    if scene.stages[stage].kind == case::StageKind::PreInflation {
        numbers("substeps", &[0.5, 0.75, 1.0, 1.5], Some(2.5));
    } else {
        numbers("window", &thirds, Some(2.0));
        numbers("substeps", &[0.5, 1.0, 2.0], None);
    }
    let around = |x: f64| [10.0 * x, x, 0.1 * x];
    numbers("coupling-tolerance", &around(scene.coupling.tolerance).map(|x| x.min(0.1)), None);
    if let Some(f) = &scene.flow {
        numbers("flow-drop", &around(f.solver.residual_drop).map(|x| x.min(0.5)), None);
    }
    numbers("newton-tolerance", &around(scene.structure.newton_tolerance).map(|x| x.min(0.05)), None);
    numbers("gmres-tolerance", &around(scene.structure.gmres_tolerance).map(|x| x.min(0.3)), None);
    let any_static = scene.stages.iter().any(|s| s.solve == Solve::Static);
    if any_static {
        numbers("static-tolerance", &around(scene.structure.static_tolerance), None);
    }
    numbers("mover-tolerance", &around(scene.mesh.tolerance), None);
    for d in &mut all {
        d.values.dedup();
    }
    all
}

/// Default sweep: space and time together.
pub fn default_sweep(parameters: &[VariedParameter]) -> Vec<String> {
    let have = |name: &str| parameters.iter().find(|d| d.parameter.name == name);
    match (have("grid").or(have("structure-grid")), have("window")) {
        (Some(a), Some(b)) if a.values.len() == b.values.len() => {
            vec![a.parameter.name.clone(), b.parameter.name.clone()]
        }
        _ => Vec::new(),
    }
}
