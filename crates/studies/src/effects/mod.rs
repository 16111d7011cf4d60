//! Measured influence and cost of effects: runs with and without each effect.

mod bench;

use std::fmt::Write as _;
use std::path::Path;

use case::{Role, Scene};
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use effects::estimate::{Amount, Assessment, Scope, percent};
use effects::fall::QUANTITIES;
use effects::numbers::Numbers;
use effects::report::change;
use effects::table::{Entry, TABLE};
use terminal::{Console, counted};

pub use self::bench::Runner;
use self::bench::{Bench, Outcome};

/// Default number of windows.
const WINDOWS: u64 = 20;
/// Factors of the tolerances in the runs that determine the noise.
const TIGHTER: [f64; 2] = [0.5, 0.7];

/// Work of the measured windows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Computing time of structure, flow and mesh, s (slowest rank of each).
    pub busy_s: [f64; 3],
    /// Coupling iterations, or windows of uncoupled stages.
    pub iterations: u64,
    /// Newton iterations or explicit steps of the structure.
    pub structure_steps: u64,
    /// Nonlinear iterations of the flow.
    pub flow_iterations: u64,
    /// Windows.
    pub windows: u64,
}

impl Work {
    fn seconds(&self) -> f64 {
        self.busy_s.iter().sum()
    }

    /// The work with the smaller times of both, since other load only increases them.
    fn least(self, other: Self) -> Self {
        let busy_s = std::array::from_fn(|p| self.busy_s[p].min(other.busy_s[p]));
        Self { busy_s, ..other }
    }
}

/// Number and length of the runs.
#[derive(Clone, Debug)]
pub struct Runs {
    /// Windows of each run; `None`: the whole stage, at most 20.
    pub windows: Option<u64>,
    /// Runs of each variant; the smallest times count.
    pub repeat: u64,
    /// Keys of the effects to measure; all if empty.
    pub only: Vec<String>,
}

/// Measurement of an effect.
pub struct Row {
    /// Row of the table of effects.
    pub entry: &'static Entry,
    /// Whether the scene has it.
    pub on: bool,
    /// A-priori estimate.
    pub assessment: Assessment,
    /// Relative changes of the results by the effect, and the work with and without it; or the reason of a failure.
    pub measured: Result<([Option<f64>; 3], [Work; 2]), String>,
}

/// The measurements of a scene.
pub struct Measurements {
    /// Name of the measured stage.
    pub stage: String,
    /// Windows of each run.
    pub windows: u64,
    /// Time of these windows, s.
    pub time_s: f64,
    /// Results of the unmodified scene.
    pub answer: [Option<f64>; 3],
    /// Noise of the results, relative: twice the change by tighter tolerances.
    pub noise: [Option<f64>; 3],
    /// Work of two runs of the unmodified scene.
    pub itself: [Work; 2],
    /// The effects.
    pub rows: Vec<Row>,
}

/// Measures the effects of stage `stage` of a scene: a run without each active effect, and a run with each inactive
/// effect that has default settings. Earlier stages also run with the changed effect if it acts in them, unless their
/// states come from `earlier`, the results of a run.
///
/// # Errors
/// The unmodified scene fails. The failure of a variant is reported in its row.
pub fn measurements(
    (scene, interface, stage): (&Scene, &CanopyInterface, usize),
    runs: &Runs,
    earlier: Option<&Path>,
    runner: &dyn Runner,
    console: &Console,
) -> Result<Measurements, RunError> {
    if let Some(unknown) = runs.only.iter().find(|k| !TABLE.iter().any(|e| e.key == *k)) {
        return Err(RunError::Input(format!(
            "--only {unknown}: there is no such effect. `ripstop effects` lists all effects"
        )));
    }
    let length = &scene.stages[stage];
    let all = if length.window_s > 0.0 { length.windows() } else { 1 };
    let count = runs.windows.unwrap_or(WINDOWS).min(all);
    let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
    let n = Numbers::new(scene, interface, &mesh);
    let scope = Scope::new(&n, stage, Some(count));
    let bench = Bench::new(scene, stage, count, earlier, runner)?;
    console.line(&format!("running the unmodified scene to stage `{}`", length.name));
    bench.prepare("plain", scene)?;
    let plain = bench.run("plain", "plain", scene)?;
    let again = bench.run("plain", "plain", scene)?;
    let noise = noise(&bench, scene, &plain, console)?;
    let mut measured = Measurements {
        stage: length.name.clone(),
        windows: count,
        time_s: scope.fall.time,
        answer: plain.answer,
        noise,
        itself: [again.work, plain.work],
        rows: Vec::new(),
    };
    let own = length.kind.roles();
    for entry in TABLE.iter().filter(|e| runs.only.is_empty() || runs.only.iter().any(|k| k == e.key)) {
        let on = (entry.on)(scene);
        let acts = bench.acts_before(entry.programs)
            || entry.programs.contains(&"coupler")
            || entry.programs.iter().any(|p| own.iter().any(|r| r.program() == *p));
        let Some(change) = (if on { entry.without } else { entry.with }).filter(|_| acts) else { continue };
        console.line(&format!("measuring {} ({})", entry.key, if on { "on" } else { "off" }));
        let mut variant = scene.clone();
        change(&mut variant);
        let outcome = match variant_of(&bench, entry, (scene, &plain), &variant, runs.repeat) {
            Err(RunError::Interrupted(place)) => return Err(RunError::Interrupted(place)),
            Err(error) => Err(error.to_string().lines().next().unwrap_or_default().to_owned()),
            Ok([base, other]) => {
                let [with, without] = if on { [plain, other] } else { [other, plain] };
                let work = if on { [base.work, other.work] } else { [other.work, base.work] };
                Ok((changes(&with, &without), work))
            }
        };
        measured.rows.push(Row { entry, on, assessment: (entry.assess)(&scope), measured: outcome });
    }
    Ok(measured)
}

/// Runs of a variant, interleaved with runs of the scene if repeated; the smallest times of each.
fn variant_of(
    bench: &Bench<'_>,
    entry: &Entry,
    (scene, plain): (&Scene, &Outcome),
    variant: &Scene,
    repeat: u64,
) -> Result<[Outcome; 2], RunError> {
    let before = bench.acts_before(entry.programs);
    if before {
        bench.prepare("variant", variant)?;
    }
    let states = if before { "variant" } else { "plain" };
    let mut least = [*plain, bench.run("variant", states, variant)?];
    for _ in 1..repeat {
        let new = [bench.run("plain", "plain", scene)?, bench.run("variant", states, variant)?];
        for (old, new) in least.iter_mut().zip(new) {
            old.work = old.work.least(new.work);
        }
    }
    Ok(least)
}

/// Noise of the results: twice the largest relative change by tighter tolerances. An error proportional to the tolerance
/// is twice the change from halving it; chaotic behaviour also shows as change.
fn noise(
    bench: &Bench<'_>,
    scene: &Scene,
    plain: &Outcome,
    console: &Console,
) -> Result<[Option<f64>; 3], RunError> {
    let mut noise = plain.answer.map(|a| a.map(|_| 0.0));
    for factor in TIGHTER {
        console.line(&format!("measuring the noise: all tolerances multiplied by {factor}"));
        let mut tight = scene.clone();
        tighten(&mut tight, factor);
        bench.prepare("tight", &tight)?;
        let other = bench.run("tight", "tight", &tight)?;
        for (n, c) in noise.iter_mut().zip(changes(&other, plain)) {
            if let (Some(n), Some(c)) = (n, c) {
                *n = f64::max(*n, 2.0 * c.abs());
            }
        }
    }
    Ok(noise)
}

/// Multiplies all iteration tolerances by `factor`.
fn tighten(scene: &mut Scene, factor: f64) {
    scene.coupling.tolerance *= factor;
    scene.structure.newton_tolerance *= factor;
    scene.structure.gmres_tolerance *= factor;
    scene.mesh.tolerance *= factor;
    if let Some(flow) = &mut scene.flow {
        flow.solver.residual_drop *= factor;
    }
}

/// Relative changes of the results by the effect.
fn changes(with: &Outcome, without: &Outcome) -> [Option<f64>; 3] {
    std::array::from_fn(|q| {
        let (with, without) = (with.answer[q]?, without.answer[q]?);
        let ratio = with / without;
        (ratio.is_finite() && without.abs() > f64::MIN_POSITIVE).then_some(ratio - 1.0)
    })
}

impl Row {
    /// Whether estimate and measurement of each quantity agree; `None` if one is unknown.
    pub fn agrees(&self, noise: &[Option<f64>; 3]) -> [Option<bool>; 3] {
        let (Ok((changes, _)), Some(e)) = (&self.measured, self.assessment.estimate()) else {
            return [None; 3];
        };
        std::array::from_fn(|q| Some(e.changes[q]?.agrees(changes[q]?, noise[q].unwrap_or(0.0), e.signed)))
    }
}

impl Measurements {
    /// The measurements as text tables.
    pub fn text(&self) -> String {
        let mut text = format!(
            "measured: stage `{}`, {}; means over {} to {} s; noise: twice the change by tighter tolerances\n",
            self.stage,
            counted(self.windows, "window"),
            0.5 * self.time_s,
            self.time_s
        );
        for ((name, unit), (answer, noise)) in
            QUANTITIES.iter().zip(["m/s", "N", "N"]).zip(self.answer.iter().zip(&self.noise))
        {
            if let (Some(answer), Some(noise)) = (answer, noise) {
                let _ = writeln!(text, "  {name} {answer:.5} {unit}, noise {}", percent(*noise));
            }
        }
        let _ = writeln!(
            text,
            "relative change of the quantities by each effect\n  {:<42} {:<8} {:<28} {:>10} {:>10}  agree",
            "effect", "quantity", "estimate (range)", "measured", "noise"
        );
        let (mut good, mut all) = (0, 0);
        for row in &self.rows {
            self.changes_of(row, &mut text);
            for agrees in row.agrees(&self.noise).into_iter().flatten() {
                all += 1;
                good += u32::from(agrees);
            }
        }
        let _ = writeln!(text, "{good} of {all} estimates agree with the measurement");
        self.costs(&mut text);
        text
    }

    fn changes_of(&self, row: &Row, text: &mut String) {
        let key = format!("{}{}", row.entry.key, if row.on { " (on)" } else { "" });
        let (changes, agrees) = match &row.measured {
            Ok((changes, _)) => (changes, row.agrees(&self.noise)),
            Err(why) => {
                let _ = writeln!(text, "  {key:<42} not measured: {why}");
                return;
            }
        };
        let estimate = row.assessment.estimate();
        for (q, name) in QUANTITIES.iter().enumerate() {
            let Some(measured) = changes[q] else { continue };
            let noise = self.noise[q].unwrap_or(0.0);
            let of = |a: &Amount| change(a, estimate.is_some_and(|e| e.signed));
            let expected =
                estimate.and_then(|e| e.changes[q]).map_or("not assessed".into(), |a: Amount| of(&a));
            let verdict = match agrees[q] {
                None => "-",
                Some(true) if measured.abs() <= noise => "yes (below the noise)",
                Some(true) => "yes",
                Some(false) => "NO",
            };
            let _ = writeln!(
                text,
                "  {key:<42} {name:<8} {expected:<28} {:>8.2} % {:>8.2} %  {verdict}",
                100.0 * measured,
                100.0 * noise
            );
        }
    }

    fn costs(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "cost of each effect: ratio with / without of the computing time of the programs and of counts\n  {:<42} {:>6} {:>10} {:>6} {:>6} {:>11} {:>10} {:>10}",
            "effect", "all", "structure", "flow", "mesh", "iterations", "steps", "flow iter."
        );
        let _ = writeln!(text, "{}", costs_of("(repeated run of the scene)", &self.itself));
        for row in &self.rows {
            if let Ok((_, work)) = &row.measured {
                let key = format!("{}{}", row.entry.key, if row.on { " (on)" } else { "" });
                let _ = writeln!(text, "{}", costs_of(&key, work));
            }
        }
    }
}

/// A table row of ratios with / without.
fn costs_of(key: &str, [with, without]: &[Work; 2]) -> String {
    let ratio = |of: &dyn Fn(&Work) -> f64| {
        let (with, without) = (of(with), of(without));
        if without > 0.0 { format!("{:.2}", with / without) } else { "-".into() }
    };
    let share = |role: Role| ratio(&|w: &Work| w.busy_s[role as usize]);
    format!(
        "  {key:<42} {:>6} {:>10} {:>6} {:>6} {:>11} {:>10} {:>10}",
        ratio(&Work::seconds),
        share(Role::Structure),
        share(Role::Flow),
        share(Role::Mesh),
        ratio(&|w| w.iterations as f64),
        ratio(&|w| w.structure_steps as f64),
        ratio(&|w| w.flow_iterations as f64)
    )
}
