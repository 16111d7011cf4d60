//! From a scene to the samples of its study.

use std::path::Path;

use case::{Canopy, Quantity, Scene};
use coupling::error::RunError;

use super::parameter::{Kind, Parameter, Setting};
use super::quantities;
use super::runs::key_of;
use super::varied::{default_sweep, defaults, turned};

/// A parameter with its values in the study.
#[derive(Clone, Debug)]
pub struct VariedParameter {
    /// The parameter.
    pub parameter: Parameter,
    /// Values, coarse to fine where they have an order.
    pub values: Vec<Setting>,
    /// Its value while others are varied.
    pub base: Setting,
    /// Finer than all.
    pub check: Option<Setting>,
}

/// A run of the study.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What differs from the base point.
    pub label: String,
    /// A setting for each parameter.
    pub settings: Vec<Setting>,
    /// Its scene.
    pub scene: Scene,
    /// Its scene as text.
    pub text: String,
    /// Name of its folder, from its text.
    pub key: String,
    /// Used for no estimate.
    pub check: bool,
    /// Cost against the base, guessed.
    pub ratio: f64,
}

/// Samples that belong together: one parameter varied, or several.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name of the parameter, or `sweep`.
    pub name: String,
    /// Which parameters it varies.
    pub parameters: Vec<usize>,
    /// Its samples with what errors fall with (`None` for words).
    pub samples: Vec<(usize, Option<f64>)>,
    /// The sample that is finer than all.
    pub check: Option<(usize, f64)>,
    /// Formal order of the method.
    pub promised: f64,
}

/// A study.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name of the scene.
    pub name: String,
    /// Its title.
    pub title: String,
    /// Stage of the quantities.
    pub stage: usize,
    /// Quantities.
    pub quantities: Vec<Quantity>,
    /// Parameters.
    pub parameters: Vec<VariedParameter>,
    /// Lines through the base point, then the sweep.
    pub lines: Vec<Line>,
    /// All samples; the first is the base.
    pub samples: Vec<Sample>,
    /// The sample that verifies the others: all parameters finer than in any of them.
    pub reference: Option<usize>,
    /// What the user should know of the scene's section.
    pub warnings: Vec<String>,
}

/// Name of the line of the sweep.
pub const SWEEP: &str = "sweep";

/// What of a study is asked for.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Only these parameters.
    pub parameters: Vec<String>,
    /// With the samples that test the stated uncertainty.
    pub check: bool,
    /// With the sample that verifies the others.
    pub verify: bool,
}

impl VariedParameter {
    /// A value beyond the finest: its `check`, else twice as fine as the finest value, a tenth of the smallest
    /// tolerance. `None` for words.
    fn beyond(&self) -> Option<Setting> {
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
    /// From a scene file.
    ///
    /// # Errors
    /// Whatever is wrong with the scene or its `[accuracy]`, with place and remedy.
    pub fn new(file: &Path, choice: &Choice) -> Result<Self, RunError> {
        let mut scene = case::load(file).map_err(|e| RunError::Input(e.to_string()))?;
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let warnings = case::renamed(&text).iter().map(|r| format!("{}:{r}", file.display())).collect();
        absolute(&mut scene)?;
        let wish = scene.accuracy.take().unwrap_or_default();
        let stage = stage_of(&scene, wish.stage.as_deref())?;
        // Later stages do not affect the quantities.
        scene.stages.truncate(stage + 1);
        let quantities = checked_quantities(wish.quantities, &scene, stage)?;
        let named = wish.parameters;
        let own = !named.is_empty();
        let wishes = if own { named } else { defaults(&scene, stage) };
        let parameters = checked_parameters(&wishes, &scene, stage)?;
        let sweep = if own { wish.sweep } else { default_sweep(&parameters) };
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
        study.fill(&scene, (&sweep, &wish.sweep_check), choice)?;
        Ok(study)
    }

    /// Adds the base sample, the lines through it, the sweep and what verifies them.
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

    /// Adds the sample that verifies the others: each parameter of the study with numbers beyond its finest
    /// value, the others as in the base.
    fn verify(&mut self, scene: &Scene, base: &[Setting], choice: &Choice) -> Result<(), RunError> {
        let mut settings = base.to_vec();
        for (to, d) in settings.iter_mut().zip(&self.parameters) {
            let varied = choice.parameters.is_empty() || choice.parameters.contains(&d.parameter.name);
            if varied && let Some(finer) = d.beyond() {
                *to = finer;
            }
        }
        let at = self.sample(scene, "reference".into(), settings, true)?;
        if !self.samples[at].check {
            return Err(RunError::Input(format!(
                "--verify: the study varies no number beyond `{}`: add a parameter with `values`, or a finer `check`",
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
                None => return refuse(format!("`{name}` is none of the parameters of the study")),
            }
        }
        let levels = self.parameters[found[0]].values.len();
        if let Some(&odd) = found.iter().find(|&&at| self.parameters[at].values.len() != levels) {
            return refuse(format!(
                "`{}` has {} values and `{}` {levels}: parameters that are varied together need equally many",
                self.parameters[odd].parameter.name,
                self.parameters[odd].values.len(),
                self.parameters[found[0]].parameter.name
            ));
        }
        if !check.is_empty() && check.len() != found.len() {
            return refuse(format!("sweep_check has {} numbers for {} parameters", check.len(), found.len()));
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
            made = d.parameter.turn(&made, self.stage, to).map_err(|e| {
                RunError::Input(format!("accuracy: sample `{label}` is not a valid scene: {e}"))
            })?;
        }
        // Snapshots are not part of the cost.
        made.output.surface_every_windows = 0;
        made.output.volume_every_windows = 0;
        made.output.folder = None;
        let text = toml::to_string(&made)
            .map_err(|e| RunError::Input(format!("the scene cannot be written down again: {e}")))?;
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

    /// Cost against the base point, guessed from the settings: cells in space and time, a seventh of a
    /// power of a tolerance.
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

/// The stage of this name, or the last one.
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

/// The named quantities, or those that fit the scene; each is possible, and no name stands twice.
fn checked_quantities(named: Vec<Quantity>, scene: &Scene, stage: usize) -> Result<Vec<Quantity>, RunError> {
    let quantities = if named.is_empty() { quantities::defaults(scene, stage) } else { named };
    if quantities.is_empty() {
        return Err(RunError::Input(
            "no default quantity fits this scene: name some with [[accuracy.quantity]]".into(),
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

/// The parameters with their values; no name stands twice.
fn checked_parameters(
    wishes: &[case::Parameter],
    scene: &Scene,
    stage: usize,
) -> Result<Vec<VariedParameter>, RunError> {
    let mut parameters = Vec::new();
    for w in wishes {
        if parameters.iter().any(|d: &VariedParameter| d.parameter.name == w.name) {
            return Err(RunError::Input(format!("accuracy.parameter: `{}` is named twice", w.name)));
        }
        parameters.push(turned(w, scene, stage)?);
    }
    Ok(parameters)
}

/// Files that it names lie where the scene of the user lies.
fn absolute(scene: &mut Scene) -> Result<(), RunError> {
    let files = [
        scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).map(|g| &mut g.path),
        if let Canopy::Gmsh(g) = &mut scene.canopy { Some(&mut g.file) } else { None },
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
    fn any_scene_has_a_study() {
        for case in ["square-drop", "air-bag", "atps-descent", "hard/membrane-box", "atps-paper-scale"] {
            let s = study(case, "").unwrap();
            assert!(!s.quantities.is_empty() && s.samples.len() > 4, "{case}");
            let keys: std::collections::BTreeSet<_> = s.samples.iter().map(|m| &m.key).collect();
            assert_eq!(keys.len(), s.samples.len(), "a sample twice");
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
    fn a_named_study() {
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
    fn bad_studies_are_refused() {
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
            .contains("none of the parameters")
        );
    }
}
