//! The samples of a study, from the scene and its section `[accuracy]`.

use std::path::Path;

use case::{Quantity, Scene};
use coupling::error::RunError;

use crate::key::key_of;

use super::parameter::{Kind, Parameter, Setting};
use super::quantities;
use super::varied::{default_sweep, defaults, varied_parameter};

/// A parameter with its values in the study.
#[derive(Clone, Debug)]
pub struct VariedParameter {
    /// The parameter.
    pub parameter: Parameter,
    /// Values, from coarse to fine if ordered.
    pub values: Vec<Setting>,
    /// Value while other parameters are varied.
    pub base: Setting,
    /// Value of the check sample, finer than `values`.
    pub check: Option<Setting>,
}

/// A run of the study.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Difference from the base.
    pub label: String,
    /// Setting of each parameter.
    pub settings: Vec<Setting>,
    /// Scene.
    pub scene: Scene,
    /// Scene as TOML.
    pub text: String,
    /// Name of the folder: hash of `text`.
    pub key: String,
    /// Whether it only tests estimates.
    pub check: bool,
    /// Estimated cost relative to the base.
    pub ratio: f64,
}

/// A refinement line: samples along one parameter, or along several parameters varied together.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name of the parameter, or `sweep`.
    pub name: String,
    /// Indices of the varied parameters.
    pub parameters: Vec<usize>,
    /// Samples with their size (see [`Parameter::size`]); `None` for choices.
    pub samples: Vec<(usize, Option<f64>)>,
    /// Check sample and its size, finer than `samples`.
    pub check: Option<(usize, f64)>,
    /// Formal order of the method.
    pub promised: f64,
}

/// A study.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name of the scene.
    pub name: String,
    /// Title of the scene.
    pub title: String,
    /// Index of the stage of the quantities.
    pub stage: usize,
    /// Quantities.
    pub quantities: Vec<Quantity>,
    /// Parameters.
    pub parameters: Vec<VariedParameter>,
    /// Refinement lines through the base, then the sweep.
    pub lines: Vec<Line>,
    /// All samples; the first is the base.
    pub samples: Vec<Sample>,
    /// Reference sample: all parameters finer than in any other sample.
    pub reference: Option<usize>,
    /// Warnings about the scene file.
    pub warnings: Vec<String>,
}

/// Name of the line of the sweep.
pub const SWEEP: &str = "sweep";

/// Parts of the study to run.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Parameters; all if empty.
    pub parameters: Vec<String>,
    /// With check samples.
    pub check: bool,
    /// With the reference sample.
    pub verify: bool,
}

impl VariedParameter {
    /// A value finer than all: `check`, else twice the largest fineness or a tenth of the smallest tolerance. `None`
    /// for choices.
    fn finer_value(&self) -> Option<Setting> {
        if self.check.is_some() {
            return self.check.clone();
        }
        let finest = self.values.iter().chain([&self.base]).filter_map(|v| match v {
            Setting::Number(x) => Some(*x),
            Setting::Choice(_) => None,
        });
        match self.parameter.kind {
            Kind::Fineness => finest.reduce(f64::max).map(|x| Setting::Number(2.0 * x)),
            Kind::Size => finest.reduce(f64::min).map(|x| Setting::Number(0.1 * x)),
            Kind::Choice => None,
        }
    }
}

impl Study {
    /// Reads the study of a scene file.
    ///
    /// # Errors
    /// Invalid scene or section `[accuracy]`, with place and remedy.
    pub fn new(file: &Path, choice: &Choice) -> Result<Self, RunError> {
        let mut scene = case::load(file).map_err(|e| RunError::Input(e.to_string()))?;
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let warnings = case::renamed(&text).iter().map(|r| format!("{}:{r}", file.display())).collect();
        absolute(&mut scene)?;
        let section = scene.accuracy.take().unwrap_or_default();
        let stage = stage_of(&scene, section.stage.as_deref())?;
        // Later stages do not affect the quantities.
        scene.stages.truncate(stage + 1);
        let quantities = checked_quantities(section.quantities, &scene, stage)?;
        let named = section.parameters;
        let own = !named.is_empty();
        let requested = if own { named } else { defaults(&scene, stage) };
        let parameters = checked_parameters(&requested, &scene, stage)?;
        let sweep = if own { section.sweep } else { default_sweep(&parameters) };
        let mut study = Self {
            name: scene.name.clone(),
            title: scene.heading().to_owned(),
            stage,
            quantities,
            parameters,
            lines: Vec::new(),
            samples: Vec::new(),
            reference: None,
            warnings,
        };
        study.fill(&scene, (&sweep, &section.sweep_check), choice)?;
        Ok(study)
    }

    /// Adds the base, the refinement lines, the sweep and the reference.
    fn fill(
        &mut self,
        scene: &Scene,
        (sweep, sweep_check): (&[String], &[f64]),
        choice: &Choice,
    ) -> Result<(), RunError> {
        let base: Vec<Setting> = self.parameters.iter().map(|d| d.base.clone()).collect();
        self.sample(scene, "base".into(), base.clone(), false)?;
        for at in 0..self.parameters.len() {
            self.line(scene, &base, at, choice)?;
        }
        let wants = |name: &str| choice.parameters.is_empty() || choice.parameters.iter().any(|d| d == name);
        if !sweep.is_empty() && wants(SWEEP) {
            self.sweep(scene, &base, sweep, sweep_check, choice)?;
        }
        if let Some(unknown) = choice.parameters.iter().find(|d| !self.lines.iter().any(|l| &l.name == *d)) {
            let have: Vec<&str> = self.parameters.iter().map(|d| d.parameter.name.as_str()).collect();
            return Err(RunError::Input(format!(
                "--parameters: the study has no parameter `{unknown}`; it has: {}{}",
                have.join(", "),
                if sweep.is_empty() { "" } else { ", sweep" }
            )));
        }
        if choice.verify {
            self.verify(scene, &base, choice)?;
        }
        Ok(())
    }

    /// Adds the reference: each numeric parameter of the study finer than its finest value, the others as in the base.
    fn verify(&mut self, scene: &Scene, base: &[Setting], choice: &Choice) -> Result<(), RunError> {
        let mut settings = base.to_vec();
        for (to, d) in settings.iter_mut().zip(&self.parameters) {
            let varied = choice.parameters.is_empty() || choice.parameters.contains(&d.parameter.name);
            if varied && let Some(finer) = d.finer_value() {
                *to = finer;
            }
        }
        let at = self.sample(scene, "reference".into(), settings, true)?;
        if !self.samples[at].check {
            return Err(RunError::Input(format!(
                "--verify: no parameter of the study can be refined beyond sample `{}`. Add a parameter with `values`, or a \
                 finer `check`",
                self.samples[at].label
            )));
        }
        self.reference = Some(at);
        Ok(())
    }

    fn line(&mut self, scene: &Scene, base: &[Setting], at: usize, choice: &Choice) -> Result<(), RunError> {
        let d = self.parameters[at].clone();
        if !choice.parameters.is_empty() && !choice.parameters.contains(&d.parameter.name) {
            return Ok(());
        }
        let mut line = Line {
            name: d.parameter.name.clone(),
            parameters: vec![at],
            samples: Vec::new(),
            check: None,
            promised: d.parameter.promised,
        };
        let moved = |value: &Setting| {
            let mut settings = base.to_vec();
            settings[at] = value.clone();
            (format!("{} {value}", d.parameter.name), settings)
        };
        for value in &d.values {
            let (label, settings) = moved(value);
            let sample = self.sample(scene, label, settings, false)?;
            // Values that round to the same scene are one sample.
            if !line.samples.iter().any(|m| m.0 == sample) {
                line.samples.push((sample, d.parameter.size(value)));
            }
        }
        if let Some(value) = d.check.as_ref().filter(|_| choice.check) {
            let (label, settings) = moved(value);
            if let Some(size) = d.parameter.size(value) {
                line.check = Some((self.sample(scene, label, settings, true)?, size));
            }
        }
        self.lines.push(line);
        Ok(())
    }

    fn sweep(
        &mut self,
        scene: &Scene,
        base: &[Setting],
        names: &[String],
        check: &[f64],
        choice: &Choice,
    ) -> Result<(), RunError> {
        let refuse = |why: String| Err(RunError::Input(format!("accuracy.sweep: {why}")));
        let mut found = Vec::new();
        for name in names {
            match self.parameters.iter().position(|d| &d.parameter.name == name) {
                Some(at) => found.push(at),
                None => return refuse(format!("`{name}` is not one of the parameters of the study")),
            }
        }
        let levels = self.parameters[found[0]].values.len();
        if let Some(&odd) = found.iter().find(|&&at| self.parameters[at].values.len() != levels) {
            return refuse(format!(
                "`{}` has {} values and `{}` has {levels}: parameters that are varied together need the same number of \
                 values",
                self.parameters[odd].parameter.name,
                self.parameters[odd].values.len(),
                self.parameters[found[0]].parameter.name
            ));
        }
        if !check.is_empty() && check.len() != found.len() {
            return refuse(format!(
                "sweep_check has {} numbers, but the sweep has {} parameters",
                check.len(),
                found.len()
            ));
        }
        let promised =
            found.iter().map(|&at| self.parameters[at].parameter.promised).fold(f64::MAX, f64::min);
        let mut line = Line {
            name: SWEEP.into(),
            parameters: found.clone(),
            samples: Vec::new(),
            check: None,
            promised,
        };
        for level in 0..levels {
            let mut settings = base.to_vec();
            found.iter().for_each(|&at| settings[at] = self.parameters[at].values[level].clone());
            let first = &self.parameters[found[0]];
            let size = first.parameter.size(&first.values[level]);
            let sample = self.sample(scene, format!("sweep {}", first.values[level]), settings, false)?;
            if !line.samples.iter().any(|m| m.0 == sample) {
                line.samples.push((sample, size));
            }
        }
        if choice.check && !check.is_empty() {
            let mut settings = base.to_vec();
            found.iter().zip(check).for_each(|(&at, &x)| settings[at] = Setting::Number(x));
            let size = self.parameters[found[0]].parameter.size(&Setting::Number(check[0])).unwrap_or(0.0);
            line.check = Some((self.sample(scene, format!("sweep {}", check[0]), settings, true)?, size));
        }
        self.lines.push(line);
        Ok(())
    }

    /// Adds a sample, or finds the one with the same scene.
    fn sample(
        &mut self,
        scene: &Scene,
        label: String,
        settings: Vec<Setting>,
        check: bool,
    ) -> Result<usize, RunError> {
        let mut made = scene.clone();
        for (d, to) in self.parameters.iter().zip(&settings) {
            made = d.parameter.set_in(&made, self.stage, to).map_err(|e| {
                RunError::Input(format!("accuracy: sample `{label}` is not a valid scene: {e}"))
            })?;
        }
        // Without snapshots, whose cost is not studied.
        made.output.surface_every_windows = 0;
        made.output.volume_every_windows = 0;
        made.output.folder = None;
        let text = toml::to_string(&made)
            .map_err(|e| RunError::Input(format!("the scene cannot be written as TOML: {e}")))?;
        let key = key_of(&text);
        let made = case::parse(Path::new("scene.toml"), &text)
            .map_err(|e| RunError::Input(format!("accuracy: sample `{label}` is not a valid scene: {e}")))?;
        if let Some(same) = self.samples.iter().position(|m| m.key == key) {
            return Ok(same);
        }
        let ratio = self.ratio(&settings);
        self.samples.push(Sample { label, settings, scene: made, text, key, check, ratio });
        Ok(self.samples.len() - 1)
    }

    /// Estimated cost relative to the base, as a product of powers of the parameters: number of cells and time steps,
    /// and a small power of each tolerance.
    fn ratio(&self, settings: &[Setting]) -> f64 {
        let power = |name: &str| match name {
            "grid" => 3.3,
            "structure-grid" => 2.0,
            "flow-grid" => 1.2,
            "window" => 0.9,
            "substeps" => 0.2,
            _ => 0.15,
        };
        let one = |(d, to): (&VariedParameter, &Setting)| {
            let (Some(size), Some(base)) = (d.parameter.size(to), d.parameter.size(&d.base)) else {
                return 1.0;
            };
            (base / size).powf(power(&d.parameter.name))
        };
        self.parameters.iter().zip(settings).map(one).product()
    }
}

/// Index of the stage `name`, else of the last stage.
fn stage_of(scene: &Scene, name: Option<&str>) -> Result<usize, RunError> {
    let Some(name) = name else { return Ok(scene.stages.len().saturating_sub(1)) };
    scene.stages.iter().position(|s| s.name == name).ok_or_else(|| {
        let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
        RunError::Input(format!(
            "accuracy.stage: the scene has no stage `{name}`; it has: {}",
            names.join(", ")
        ))
    })
}

/// The named quantities, else the default ones. Refuses quantities that the scene does not have, and duplicate names.
fn checked_quantities(named: Vec<Quantity>, scene: &Scene, stage: usize) -> Result<Vec<Quantity>, RunError> {
    let quantities = if named.is_empty() { quantities::defaults(scene, stage) } else { named };
    if quantities.is_empty() {
        return Err(RunError::Input(
            "no default quantity fits this scene: add quantities with [[accuracy.quantity]]".into(),
        ));
    }
    quantities.iter().try_for_each(|q| quantities::check(q, scene, stage))?;
    for (i, q) in quantities.iter().enumerate() {
        if quantities[..i].iter().any(|o| o.name == q.name) {
            let name = &q.name;
            return Err(RunError::Input(format!(
                "accuracy.quantity[{i}]: two quantities are named `{name}`"
            )));
        }
    }
    Ok(quantities)
}

/// The parameters with their values. Refuses duplicate names.
fn checked_parameters(
    requested: &[case::Parameter],
    scene: &Scene,
    stage: usize,
) -> Result<Vec<VariedParameter>, RunError> {
    let mut parameters = Vec::new();
    for w in requested {
        if parameters.iter().any(|d: &VariedParameter| d.parameter.name == w.name) {
            return Err(RunError::Input(format!("accuracy.parameter: `{}` is named twice", w.name)));
        }
        parameters.push(varied_parameter(w, scene, stage)?);
    }
    Ok(parameters)
}

/// Makes the paths of files named in the scene absolute, because samples run in other folders.
fn absolute(scene: &mut Scene) -> Result<(), RunError> {
    let files = [
        scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).map(|g| &mut g.path),
        scene.canopy.file_mut(),
    ];
    for path in files.into_iter().flatten() {
        *path = std::path::absolute(&*path).map_err(RunError::file("resolve", &*path))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(case: &str, section: &str) -> Result<Study, RunError> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases").join(case).join("scene.toml");
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("scene.toml");
        std::fs::write(&copy, std::fs::read_to_string(file).unwrap() + section).unwrap();
        Study::new(&copy, &Choice { check: true, ..Choice::default() })
    }

    #[test]
    fn every_case_has_a_default_study() {
        for case in ["square-drop", "air-bag", "atps-descent", "hard/membrane-box", "atps-paper-scale"] {
            let s = study(case, "").unwrap();
            assert!(!s.quantities.is_empty() && s.samples.len() > 4, "{case}");
            let keys: std::collections::BTreeSet<_> = s.samples.iter().map(|m| &m.key).collect();
            assert_eq!(keys.len(), s.samples.len(), "duplicate samples");
            assert!(s.samples.iter().all(|m| m.ratio > 0.0 && m.scene.accuracy.is_none()));
            for l in &s.lines {
                let base = l.samples.iter().filter(|(m, _)| *m == 0).count();
                assert!(
                    base <= 1 && l.samples.iter().all(|(m, _)| !s.samples[*m].check),
                    "{case} {}",
                    l.name
                );
            }
        }
    }

    #[test]
    fn named_parameters_quantities_and_sweep_give_the_expected_samples() {
        let s = study(
            "square-drop",
            "[accuracy]\nsweep = [\"grid\", \"window\"]\nsweep_check = [1.0, 2.0]\n\
             [[accuracy.quantity]]\nname = \"speed\"\nof = \"descent-speed\"\n\
             [[accuracy.parameter]]\nname = \"grid\"\nvalues = [0.67, 0.5]\nbase = 0.5\ncheck = 1.0\n\
             [[accuracy.parameter]]\nname = \"window\"\nvalues = [0.5, 1.0]\n\
             [[accuracy.parameter]]\nname = \"scheme\"\nchoices = [\"default\", \"implicit:aitken\"]\n",
        )
        .unwrap();
        let names: Vec<&str> = s.lines.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(names, ["grid", "window", "scheme", "sweep"]);
        assert_eq!(s.lines[0].samples.iter().map(|m| m.1.unwrap()).collect::<Vec<_>>(), [2.0, 1.0 / 0.67]);
        assert_eq!(s.samples[s.lines[0].check.unwrap().0].label, "grid 1");
        // The base, grid .67, grid 1 (check), window .5, aitken, the sweep's check: its levels are
        // window .5 and grid .67.
        assert_eq!(s.samples.len(), 6, "{:?}", s.samples.iter().map(|m| &m.label).collect::<Vec<_>>());
    }

    #[test]
    fn invalid_studies_are_refused_with_the_reason() {
        let why = |section: &str| study("square-drop", section).unwrap_err().to_string();
        assert!(why("[accuracy]\nstage = \"x\"\n").contains("developed-flow"));
        assert!(why("[[accuracy.parameter]]\nname = \"grid\"\n").contains("neither"));
        assert!(why("[[accuracy.parameter]]\nname = \"grid\"\nvalues = [-1.0]\n").contains("above 0"));
        assert!(
            why("[[accuracy.parameter]]\nname = \"grid\"\nvalues = [1.0]\ncheck = 0.5\n").contains("finer")
        );
        assert!(why("[[accuracy.quantity]]\nname = \"a\"\nof = \"weight\"\n").contains("weight"));
        assert!(
            why(
                "[accuracy]\nsweep = [\"grid\"]\n[[accuracy.parameter]]\nname = \"window\"\nvalues = [1.0]\n"
            )
            .contains("not one of the parameters")
        );
    }
}
