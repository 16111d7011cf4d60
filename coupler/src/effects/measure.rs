//! What an effect costs: a short run with it beside the same run without it.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use case::{Role, Scene};

use super::table::TABLE;
use crate::error::RunError;
use crate::history;
use crate::launch::Console;
use crate::replay::copy_states;
use crate::run::{Prepared, RunOptions, prepare, run};

/// Work of the measured windows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Seconds in which structure, flow and mesh computed (the slowest rank of each).
    pub busy_s: [f64; 3],
    /// Coupling iterations, or windows where nothing is coupled.
    pub iterations: u64,
    /// Newton or explicit steps of the structure.
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

    /// The same work with the least seconds of both: what else the machine did only adds.
    fn least(self, other: Self) -> Self {
        let busy_s = std::array::from_fn(|p| self.busy_s[p].min(other.busy_s[p]));
        Self { busy_s, ..other }
    }
}

/// How much is flown.
#[derive(Clone, Copy, Debug)]
pub struct Runs {
    /// Windows of each run.
    pub windows: u64,
    /// Pairs of runs, with and without in turn.
    pub repeat: u64,
}

/// Costs of the effects of a scene, as a table for people: for each that is on a run
/// without it, for each that is off and has defaults a run with it, in `stage` (default: the
/// last one), in turn with the scene itself; of all runs of a pair the least seconds count.
/// The first row tells how far two runs of the scene itself lie apart.
/// Stages before are flown once, or taken from `earlier`, the results of a run.
///
/// # Errors
/// Trouble with the scene itself; a variant that fails is told in its row.
pub fn measure(
    options: &RunOptions,
    runs: Runs,
    earlier: Option<&Path>,
    stop: &AtomicBool,
    console: &Console,
) -> Result<String, RunError> {
    let Prepared { scene, .. } = prepare(options)?;
    let stage = match &options.stage {
        Some(name) => scene.stages.iter().position(|s| &s.name == name).unwrap_or(0),
        None => scene.stages.len().saturating_sub(1),
    };
    let bench = Bench::new(&scene, stage, runs.windows, stop)?;
    bench.prepare(earlier, console)?;
    let own = scene.stages[stage].kind.roles();
    let mut text = format!(
        "stage `{}`, {} windows, least of {} runs: seconds that the programs computed, with over without\n  {:<42} {:>6} {:>10} {:>6} {:>6} {:>11} {:>10} {:>10}\n",
        scene.stages[stage].name,
        runs.windows,
        runs.repeat,
        "effect",
        "all",
        "structure",
        "flow",
        "mesh",
        "iterations",
        "steps",
        "flow iter."
    );
    // The first run also warms caches and files: it does not count.
    bench.fly("plain", &scene)?;
    let pair = bench.pair(&scene, &scene, runs.repeat)?;
    let _ = writeln!(text, "{}", row("(the scene beside itself)", &pair));
    for e in TABLE {
        let on = (e.on)(&scene);
        let Some(change) = (if on { e.without } else { e.with }) else { continue };
        if !e.programs.iter().any(|p| own.iter().any(|r| r.program() == *p)) {
            continue;
        }
        let mut variant = scene.clone();
        change(&mut variant);
        console.line(&format!("measuring {} ({})", e.key, if on { "on" } else { "off" }));
        match bench.pair(&scene, &variant, runs.repeat) {
            Ok([plain, other]) => {
                let pair = if on { [plain, other] } else { [other, plain] };
                let key = format!("{}{}", e.key, if on { " (on)" } else { "" });
                let _ = writeln!(text, "{}", row(&key, &pair));
            }
            Err(RunError::Interrupted(place)) => return Err(RunError::Interrupted(place)),
            Err(error) => {
                let first = error.to_string();
                let _ =
                    writeln!(text, "  {:<42} not measured: {}", e.key, first.lines().next().unwrap_or(""));
            }
        }
    }
    text.push_str("ratios are of an effect that is on to the scene without it; of one that is off, of the scene with it to itself");
    Ok(text)
}

/// Ratios of the first over the second.
fn row(key: &str, [with, without]: &[Work; 2]) -> String {
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

/// A temporary place where variants of a scene fly.
struct Bench<'a> {
    folder: PathBuf,
    scene: &'a Scene,
    stage: usize,
    windows: u64,
    stop: &'a AtomicBool,
}

impl<'a> Bench<'a> {
    fn new(scene: &'a Scene, stage: usize, windows: u64, stop: &'a AtomicBool) -> Result<Self, RunError> {
        let folder = std::env::temp_dir().join(format!("ripstop-effects-{}", std::process::id()));
        fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        Ok(Self { folder, scene, stage, windows, stop })
    }

    fn states(&self) -> PathBuf {
        self.folder.join("before")
    }

    /// States of the stages before.
    fn prepare(&self, earlier: Option<&Path>, console: &Console) -> Result<(), RunError> {
        let target = self.states();
        if let Some(from) = earlier {
            return copy_states(self.scene, self.stage, from, &target);
        }
        if self.stage == 0 {
            return Ok(());
        }
        let mut first = self.scene.clone();
        first.stages.truncate(self.stage);
        console.line("flying the stages before the measured one");
        let file = self.write("before", &first)?;
        run(&RunOptions { scene: file, out: Some(target), ..RunOptions::default() }, self.stop, console)?;
        Ok(())
    }

    fn write(&self, name: &str, scene: &Scene) -> Result<PathBuf, RunError> {
        let file = self.folder.join(format!("{name}.toml"));
        let mut scene = scene.clone();
        // Files that it names lie where the scene of the user lies.
        let files = [
            scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).map(|g| &mut g.path),
            if let case::Canopy::Gmsh(g) = &mut scene.canopy { Some(&mut g.file) } else { None },
        ];
        for path in files.into_iter().flatten() {
            *path = std::path::absolute(&*path).map_err(RunError::file("resolve", &*path))?;
        }
        let text = toml::to_string(&scene)
            .map_err(|e| RunError::Input(format!("the scene cannot be written down again: {e}")))?;
        fs::write(&file, text).map_err(RunError::file("write", &file))?;
        Ok(file)
    }

    /// Both in turn, so many times each.
    fn pair(&self, plain: &Scene, variant: &Scene, repeat: u64) -> Result<[Work; 2], RunError> {
        let mut least: Option<[Work; 2]> = None;
        for _ in 0..repeat {
            let new = [self.fly("plain", plain)?, self.fly("variant", variant)?];
            least = Some(match least {
                None => new,
                Some([a, b]) => [a.least(new[0]), b.least(new[1])],
            });
        }
        Ok(least.unwrap_or_default())
    }

    fn fly(&self, name: &str, scene: &Scene) -> Result<Work, RunError> {
        let mut quiet = scene.clone();
        quiet.output.surface_every_windows = 0;
        quiet.output.volume_every_windows = 0;
        let file = self.write(name, &quiet)?;
        let out = self.folder.join(name);
        copy_states(scene, self.stage, &self.states(), &out)?;
        let options = RunOptions {
            scene: file,
            out: Some(out.clone()),
            stage: Some(scene.stages[self.stage].name.clone()),
            stop_after_windows: Some(self.windows),
            keep_going: true,
            ..RunOptions::default()
        };
        let (summary, _) = run(&options, self.stop, &Console::new(true))?;
        let columns = history::read(&out.join(&scene.stages[self.stage].name).join("history.csv"))?;
        let sum = |name: &str| {
            let column = columns.iter().find(|(n, _)| n == name);
            column.map_or(0, |(_, v)| v.iter().filter(|x| x.is_finite()).sum::<f64>() as u64)
        };
        let s = summary.stages.last();
        Ok(Work {
            busy_s: s.map_or([0.0; 3], |s| [s.structure_busy_s, s.flow_busy_s, s.mesh_busy_s]),
            iterations: s.map_or(0, |s| s.iterations),
            structure_steps: sum("structure_newton_steps"),
            flow_iterations: sum("flow_iterations"),
            windows: s.map_or(0, |s| s.windows),
        })
    }
}

impl Drop for Bench<'_> {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}
