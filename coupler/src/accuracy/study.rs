//! From a scene to the members of its study.

use std::path::Path;

use case::{Canopy, Quantity, Scene, Solve};

use super::dials::{Dial, Kind, Setting};
use super::fly::key_of;
use super::quantities;
use crate::error::RunError;

/// A dial with its values in the study.
#[derive(Clone, Debug)]
pub struct Turned {
    /// The dial.
    pub dial: Dial,
    /// Values, coarse to fine where they have an order.
    pub values: Vec<Setting>,
    /// Where it stands while others are turned.
    pub base: Setting,
    /// Finer than all.
    pub check: Option<Setting>,
}

/// A run of the study.
#[derive(Clone, Debug)]
pub struct Member {
    /// What differs from the base point.
    pub label: String,
    /// A setting for each dial.
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

/// Members that belong together: one dial turned, or several.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name of the dial, or `sweep`.
    pub name: String,
    /// What it turns.
    pub dials: Vec<usize>,
    /// Its members with what errors fall with (`None` for words).
    pub members: Vec<(usize, Option<f64>)>,
    /// The member that is finer than all.
    pub check: Option<(usize, f64)>,
    /// Order that the method promises.
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
    /// Dials.
    pub dials: Vec<Turned>,
    /// Lines through the base point, then the sweep.
    pub lines: Vec<Line>,
    /// All members; the first is the base point.
    pub members: Vec<Member>,
}

/// Name of the line of the sweep.
pub const SWEEP: &str = "sweep";

/// What of a study is asked for.
#[derive(Clone, Debug, Default)]
pub struct Choice {
    /// Only these dials.
    pub dials: Vec<String>,
    /// With the members that test the stated uncertainty.
    pub check: bool,
}

impl Study {
    /// From a scene file.
    ///
    /// # Errors
    /// Whatever is wrong with the scene or its `[accuracy]`, with place and remedy.
    pub fn new(file: &Path, choice: &Choice) -> Result<Self, RunError> {
        let mut scene = case::load(file).map_err(|e| RunError::Input(e.to_string()))?;
        absolute(&mut scene)?;
        let wish = scene.accuracy.take().unwrap_or_default();
        let stage = match &wish.stage {
            None => scene.stages.len().saturating_sub(1),
            Some(name) => scene.stages.iter().position(|s| &s.name == name).ok_or_else(|| {
                let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
                RunError::Input(format!(
                    "accuracy.stage: the scene has no stage `{name}`; it has: {}",
                    names.join(", ")
                ))
            })?,
        };
        // Later stages would cost and tell nothing.
        scene.stages.truncate(stage + 1);
        let quantities =
            if wish.quantities.is_empty() { quantities::defaults(&scene, stage) } else { wish.quantities };
        if quantities.is_empty() {
            return Err(RunError::Input(
                "this scene has no quantity of its own: name some with [[accuracy.quantity]]".into(),
            ));
        }
        quantities.iter().try_for_each(|q| quantities::check(q, &scene, stage))?;
        if let Some((i, q)) =
            quantities.iter().enumerate().find(|(i, q)| quantities[..*i].iter().any(|o| o.name == q.name))
        {
            return Err(RunError::Input(format!(
                "accuracy.quantity[{i}]: two quantities are named `{}`",
                q.name
            )));
        }
        let own = !wish.dials.is_empty();
        let wishes = if own { wish.dials } else { defaults(&scene, stage) };
        let mut dials = Vec::new();
        for w in &wishes {
            if dials.iter().any(|d: &Turned| d.dial.name == w.name) {
                return Err(RunError::Input(format!("accuracy.dial: `{}` is named twice", w.name)));
            }
            dials.push(turned(w, &scene, stage)?);
        }
        let sweep = if own { wish.sweep } else { default_sweep(&dials) };
        let mut study = Self {
            name: scene.name.clone(),
            title: if scene.title.is_empty() { scene.name.clone() } else { scene.title.clone() },
            stage,
            quantities,
            dials,
            lines: Vec::new(),
            members: Vec::new(),
        };
        let base: Vec<Setting> = study.dials.iter().map(|d| d.base.clone()).collect();
        study.member(&scene, "base".into(), base.clone(), false)?;
        for at in 0..study.dials.len() {
            study.line(&scene, &base, at, choice)?;
        }
        let wants = |name: &str| choice.dials.is_empty() || choice.dials.iter().any(|d| d == name);
        if !sweep.is_empty() && wants(SWEEP) {
            study.sweep(&scene, &base, &sweep, &wish.sweep_check, choice)?;
        }
        if let Some(unknown) = choice.dials.iter().find(|d| !study.lines.iter().any(|l| &l.name == *d)) {
            let have: Vec<&str> = study.dials.iter().map(|d| d.dial.name.as_str()).collect();
            return Err(RunError::Input(format!(
                "--dials: the study has no dial `{unknown}`; it has: {}{}",
                have.join(", "),
                if sweep.is_empty() { "" } else { ", sweep" }
            )));
        }
        Ok(study)
    }

    fn line(&mut self, scene: &Scene, base: &[Setting], at: usize, choice: &Choice) -> Result<(), RunError> {
        let d = self.dials[at].clone();
        if !choice.dials.is_empty() && !choice.dials.contains(&d.dial.name) {
            return Ok(());
        }
        let mut line = Line {
            name: d.dial.name.clone(),
            dials: vec![at],
            members: Vec::new(),
            check: None,
            promised: d.dial.promised,
        };
        let moved = |value: &Setting| {
            let mut settings = base.to_vec();
            settings[at] = value.clone();
            (format!("{} {value}", d.dial.name), settings)
        };
        for value in &d.values {
            let (label, settings) = moved(value);
            let member = self.member(scene, label, settings, false)?;
            line.members.push((member, d.dial.size(value)));
        }
        if let Some(value) = d.check.as_ref().filter(|_| choice.check) {
            let (label, settings) = moved(value);
            if let Some(size) = d.dial.size(value) {
                line.check = Some((self.member(scene, label, settings, true)?, size));
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
            match self.dials.iter().position(|d| &d.dial.name == name) {
                Some(at) => found.push(at),
                None => return refuse(format!("`{name}` is none of the dials of the study")),
            }
        }
        let levels = self.dials[found[0]].values.len();
        if let Some(&odd) = found.iter().find(|&&at| self.dials[at].values.len() != levels) {
            return refuse(format!(
                "`{}` has {} values and `{}` {levels}: dials that are turned together need equally many",
                self.dials[odd].dial.name,
                self.dials[odd].values.len(),
                self.dials[found[0]].dial.name
            ));
        }
        if !check.is_empty() && check.len() != found.len() {
            return refuse(format!("sweep_check has {} numbers for {} dials", check.len(), found.len()));
        }
        let promised = found.iter().map(|&at| self.dials[at].dial.promised).fold(f64::MAX, f64::min);
        let mut line =
            Line { name: SWEEP.into(), dials: found.clone(), members: Vec::new(), check: None, promised };
        for level in 0..levels {
            let mut settings = base.to_vec();
            found.iter().for_each(|&at| settings[at] = self.dials[at].values[level].clone());
            let first = &self.dials[found[0]];
            let size = first.dial.size(&first.values[level]);
            let member = self.member(scene, format!("sweep {}", first.values[level]), settings, false)?;
            line.members.push((member, size));
        }
        if choice.check && !check.is_empty() {
            let mut settings = base.to_vec();
            found.iter().zip(check).for_each(|(&at, &x)| settings[at] = Setting::Number(x));
            let size = self.dials[found[0]].dial.size(&Setting::Number(check[0])).unwrap_or(0.0);
            line.check = Some((self.member(scene, format!("sweep {}", check[0]), settings, true)?, size));
        }
        self.lines.push(line);
        Ok(())
    }

    /// Adds a member, or finds the one with the same scene.
    fn member(
        &mut self,
        scene: &Scene,
        label: String,
        settings: Vec<Setting>,
        check: bool,
    ) -> Result<usize, RunError> {
        let mut made = scene.clone();
        for (d, to) in self.dials.iter().zip(&settings) {
            made = d
                .dial
                .turn(&made, self.stage, to)
                .map_err(|e| RunError::Input(format!("accuracy: member `{label}` is no scene: {e}")))?;
        }
        // Pictures are not what is paid for.
        made.output.surface_every_windows = 0;
        made.output.volume_every_windows = 0;
        made.output.folder = None;
        let text = toml::to_string(&made)
            .map_err(|e| RunError::Input(format!("the scene cannot be written down again: {e}")))?;
        let key = key_of(&text);
        let made = case::parse(Path::new("scene.toml"), &text)
            .map_err(|e| RunError::Input(format!("accuracy: member `{label}` is no scene: {e}")))?;
        if let Some(same) = self.members.iter().position(|m| m.key == key) {
            return Ok(same);
        }
        let ratio = self.ratio(&settings);
        self.members.push(Member { label, settings, scene: made, text, key, check, ratio });
        Ok(self.members.len() - 1)
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
        let one = |(d, to): (&Turned, &Setting)| {
            let (Some(size), Some(base)) = (d.dial.size(to), d.dial.size(&d.base)) else { return 1.0 };
            (base / size).powf(power(&d.dial.name))
        };
        self.dials.iter().zip(settings).map(one).product()
    }
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

fn turned(w: &case::Dial, scene: &Scene, stage: usize) -> Result<Turned, RunError> {
    let refuse = |why: String| RunError::Input(format!("accuracy.dial `{}`: {why}", w.name));
    let words = w.values.is_empty() && !w.choices.is_empty();
    let mut dial = Dial::find(&w.name, scene, stage, words)?;
    if w.values.is_empty() && w.choices.is_empty() {
        return Err(refuse("it has neither `values` nor `choices`".into()));
    }
    if !w.values.is_empty() && !w.choices.is_empty() {
        return Err(refuse("it has both `values` and `choices`".into()));
    }
    if let Some(order) = w.order {
        if !(order > 0.0 && order <= 8.0) {
            return Err(refuse(format!("`order` is {order}: above 0 and at most 8")));
        }
        dial.promised = order;
    }
    if let Some(bad) = w.values.iter().chain(&w.check).chain(&w.base).find(|v| !(**v > 0.0 && v.is_finite()))
    {
        return Err(refuse(format!("the value {bad} is not above 0")));
    }
    let mut numbers = w.values.clone();
    // Coarse first.
    numbers.sort_by(f64::total_cmp);
    if dial.kind == Kind::Size {
        numbers.reverse();
    }
    let finest = numbers.last().copied();
    if let (Some(check), Some(finest)) = (w.check, finest) {
        let finer = if dial.kind == Kind::Fineness { check > finest } else { check < finest };
        if !finer {
            return Err(refuse(format!("`check` is {check}: it must be finer than all values ({finest})")));
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
        _ => dial.own(scene),
    };
    let base = base.ok_or_else(|| refuse("the scene has no value of its own: name a `base`".into()))?;
    Ok(Turned { dial, values, base, check: w.check.map(Setting::Number) })
}

/// Dials for a scene that names none.
fn defaults(scene: &Scene, stage: usize) -> Vec<case::Dial> {
    let mut all = Vec::new();
    let mut numbers = |name: &str, values: &[f64], check: Option<f64>| {
        if Dial::fits(name, scene, stage) {
            all.push(case::Dial {
                name: name.into(),
                values: values.to_vec(),
                check,
                ..case::Dial::default()
            });
        }
    };
    let thirds = [0.5, 2.0 / 3.0, 5.0 / 6.0, 1.0];
    if Dial::fits("grid", scene, stage) {
        numbers("grid", &thirds, Some(1.5));
    } else {
        numbers("structure-grid", &thirds, Some(1.5));
        numbers("flow-grid", &thirds, Some(1.5));
    }
    // A history of the structure alone has its windows for output only.
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

/// What is turned together where a scene does not say: space and time.
fn default_sweep(dials: &[Turned]) -> Vec<String> {
    let have = |name: &str| dials.iter().find(|d| d.dial.name == name);
    match (have("grid").or(have("structure-grid")), have("window")) {
        (Some(a), Some(b)) if a.values.len() == b.values.len() => {
            vec![a.dial.name.clone(), b.dial.name.clone()]
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(case: &str, section: &str) -> Result<Study, RunError> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(case).join("scene.toml");
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("scene.toml");
        std::fs::write(&copy, std::fs::read_to_string(file).unwrap() + section).unwrap();
        Study::new(&copy, &Choice { check: true, ..Choice::default() })
    }

    #[test]
    fn any_scene_has_a_study() {
        for case in ["square-drop", "air-bag", "atps-descent", "hard/membrane-box", "atps-paper-scale"] {
            let s = study(case, "").unwrap();
            assert!(!s.quantities.is_empty() && s.members.len() > 4, "{case}");
            let keys: std::collections::BTreeSet<_> = s.members.iter().map(|m| &m.key).collect();
            assert_eq!(keys.len(), s.members.len(), "a member twice");
            assert!(s.members.iter().all(|m| m.ratio > 0.0 && m.scene.accuracy.is_none()));
            for l in &s.lines {
                let base = l.members.iter().filter(|(m, _)| *m == 0).count();
                assert!(
                    base <= 1 && l.members.iter().all(|(m, _)| !s.members[*m].check),
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
             [[accuracy.dial]]\nname = \"grid\"\nvalues = [0.67, 0.5]\nbase = 0.5\ncheck = 1.0\n\
             [[accuracy.dial]]\nname = \"window\"\nvalues = [0.5, 1.0]\n\
             [[accuracy.dial]]\nname = \"scheme\"\nchoices = [\"default\", \"implicit:aitken\"]\n",
        )
        .unwrap();
        let names: Vec<&str> = s.lines.iter().map(|l| l.name.as_str()).collect();
        assert_eq!(names, ["grid", "window", "scheme", "sweep"]);
        assert_eq!(s.lines[0].members.iter().map(|m| m.1.unwrap()).collect::<Vec<_>>(), [2.0, 1.0 / 0.67]);
        assert_eq!(s.members[s.lines[0].check.unwrap().0].label, "grid 1");
        // The base, grid .67, grid 1 (check), window .5, aitken, the sweep's check: its levels are
        // window .5 and grid .67.
        assert_eq!(s.members.len(), 6, "{:?}", s.members.iter().map(|m| &m.label).collect::<Vec<_>>());
    }

    #[test]
    fn bad_studies_are_refused() {
        let why = |section: &str| study("square-drop", section).unwrap_err().to_string();
        assert!(why("[accuracy]\nstage = \"x\"\n").contains("developed-flow"));
        assert!(why("[[accuracy.dial]]\nname = \"grid\"\n").contains("neither"));
        assert!(why("[[accuracy.dial]]\nname = \"grid\"\nvalues = [-1.0]\n").contains("above 0"));
        assert!(why("[[accuracy.dial]]\nname = \"grid\"\nvalues = [1.0]\ncheck = 0.5\n").contains("finer"));
        assert!(why("[[accuracy.quantity]]\nname = \"a\"\nof = \"weight\"\n").contains("weight"));
        assert!(
            why("[accuracy]\nsweep = [\"grid\"]\n[[accuracy.dial]]\nname = \"window\"\nvalues = [1.0]\n")
                .contains("none of the dials")
        );
    }
}
