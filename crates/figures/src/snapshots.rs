//! The snapshots of a run: shapes of canopy and lines, fields of the flow.

use std::path::{Path, PathBuf};

use case::Scene;
use clap::Args;
use coupling::error::RunError;
use mesh::vtk::read::{Column, Piece, Snapshot, snapshots};

/// Time (s), canopy, and lines (if any) of a snapshot.
pub type Structure = (f64, Piece, Option<Piece>);

/// The snapshots of a run.
pub struct RunSnapshots {
    folder: PathBuf,
    /// Scene of the run.
    pub scene: Scene,
}

/// Kind of snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Fabric (structure).
    Canopy,
    /// Suspension lines and payload (structure).
    Lines,
    /// Grid and fields (flow).
    Flow,
}

impl Kind {
    fn series(self) -> &'static str {
        match self {
            Kind::Canopy => "canopy.pvd",
            Kind::Lines => "lines.pvd",
            Kind::Flow => "flow.pvd",
        }
    }

    /// Key of the scene that writes them.
    fn key(self) -> &'static str {
        match self {
            Kind::Canopy | Kind::Lines => "output.surface_every_windows",
            Kind::Flow => "output.volume_every_windows",
        }
    }

    /// Name in texts, such as `snapshots of the canopy`.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Canopy => "the canopy",
            Kind::Lines => "the lines",
            Kind::Flow => "the flow",
        }
    }
}

/// Which of the snapshots of a stage are taken.
#[derive(Args, Clone, Copy, Debug)]
pub struct Interval {
    /// First time in the stage, in seconds [default: that of the first snapshot]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub from: Option<f64>,
    /// Last time in the stage, in seconds [default: that of the last snapshot]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub to: Option<f64>,
    /// Take every N-th snapshot of that interval, beginning with the first
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|t| t.is_finite()).ok_or_else(|| "expected a time in seconds".into())
}

impl Interval {
    /// The snapshots within the interval. Times are sums of steps: an end that a snapshot misses by its rounding
    /// includes it.
    ///
    /// # Errors
    /// No snapshot lies within the interval.
    pub fn choose(&self, times: &Times) -> Result<Vec<Snapshot>, RunError> {
        let near = |t: f64| 1e-9 * t.abs().max(1e-3);
        let within = |t: f64| {
            self.from.is_none_or(|from| t >= from - near(from)) && self.to.is_none_or(|to| t <= to + near(to))
        };
        let inside = times.0.iter().filter(|s| within(s.time));
        let found: Vec<_> = inside.step_by(self.every as usize).cloned().collect();
        if found.is_empty() {
            let [first, last] = [times.0.first(), times.0.last()].map(|s| s.map_or(0.0, |s| s.time));
            return Err(RunError::Input(format!(
                "no snapshot lies between --from and --to: the {} snapshots of the stage are from {first} s to \
                 {last} s",
                times.0.len()
            )));
        }
        Ok(found)
    }
}

/// Snapshots of one kind in a stage; never empty.
#[derive(Clone)]
pub struct Times(Vec<Snapshot>);

impl Times {
    /// All snapshots, in order of time.
    pub fn all(&self) -> &[Snapshot] {
        &self.0
    }

    /// The snapshot nearest to `time` (s), else the last.
    pub fn nearest(&self, time: Option<f64>) -> &Snapshot {
        let key = |s: &&Snapshot| time.map_or(-s.time, |t| (s.time - t).abs());
        let found = self.0.iter().min_by(|a, b| key(a).total_cmp(&key(b)));
        found.expect("a list of snapshots is never empty")
    }
}

fn input(error: impl std::fmt::Display) -> RunError {
    RunError::Input(error.to_string())
}

impl RunSnapshots {
    /// Opens the results folder of a run.
    ///
    /// # Errors
    /// The folder or its scene is missing or invalid.
    pub fn open(folder: &Path) -> Result<Self, RunError> {
        let scene = folder.join("scene.toml");
        if !folder.is_dir() {
            return Err(RunError::Input(format!(
                "there is no folder {}. Give the results folder of a run, such as runs/atps-descent, written by \
                 `ripstop run`",
                folder.display()
            )));
        }
        if !scene.is_file() {
            return Err(RunError::Input(format!(
                "{} is not a results folder: {} is missing. Give a folder written by `ripstop run`",
                folder.display(),
                scene.display()
            )));
        }
        Ok(Self { folder: folder.into(), scene: case::load(&scene).map_err(input)? })
    }

    /// Folder of the results of a stage.
    pub fn stage_folder(&self, stage: usize) -> PathBuf {
        case::stage_folder(&self.folder, &self.scene, stage)
    }

    /// Snapshots of a stage; `None` without any.
    pub fn times(&self, stage: usize, kind: Kind) -> Result<Option<Times>, RunError> {
        let path = self.stage_folder(stage).join(kind.series());
        if !path.is_file() {
            return Ok(None);
        }
        let list = snapshots(&path).map_err(input)?;
        Ok((!list.is_empty()).then_some(Times(list)))
    }

    /// Index of the stage `name`.
    fn named(&self, name: &str) -> Result<usize, RunError> {
        let stages = &self.scene.stages;
        stages.iter().position(|s| s.name == name).ok_or_else(|| {
            let names: Vec<_> = stages.iter().map(|s| format!("`{}`", s.name)).collect();
            RunError::Input(format!(
                "there is no stage `{name}`. The stages of the scene are {}",
                names.join(", ")
            ))
        })
    }

    /// Index of the stage `name`, else of the last stage with snapshots of the canopy.
    pub fn stage(&self, name: Option<&str>) -> Result<usize, RunError> {
        if let Some(name) = name {
            return self.named(name);
        }
        for stage in (0..self.scene.stages.len()).rev() {
            if self.times(stage, Kind::Canopy)?.is_some() {
                return Ok(stage);
            }
        }
        Err(self.none("canopy.pvd", "surface_every_windows"))
    }

    /// The snapshots of one kind in the stage `name`, else in the last stage that has some, and the index of the stage.
    ///
    /// # Errors
    /// There are none, with the key of the scene that writes them.
    pub fn series(&self, name: Option<&str>, kind: Kind) -> Result<(usize, Times), RunError> {
        let stages = &self.scene.stages;
        let chosen = name.map(|name| self.named(name)).transpose()?;
        let mut others = Vec::new();
        for stage in (0..stages.len()).rev() {
            match self.times(stage, kind)? {
                Some(times) if chosen.is_none_or(|chosen| chosen == stage) => return Ok((stage, times)),
                Some(_) => others.insert(0, format!("`{}`", stages[stage].name)),
                None => {}
            }
        }
        let place = chosen.map_or_else(String::new, |stage| format!("stage `{}` of ", stages[stage].name));
        let remedy = if others.is_empty() {
            format!("Run the scene with {} above 0 (4 writes every fourth window)", kind.key())
        } else {
            format!("Stages that have some: {}", others.join(", "))
        };
        Err(RunError::Input(format!(
            "{place}{} has no snapshots of {}: {} is missing or empty. {remedy}",
            self.folder.display(),
            kind.name(),
            kind.series()
        )))
    }

    /// The error of missing snapshots.
    pub fn none(&self, series: &str, key: &str) -> RunError {
        if !self.scene.has_canopy() {
            return RunError::Input(format!(
                "{}: pictures show a canopy and the flow around it, but the scene has none. Open flow.pvd in the folder of a stage with ParaView",
                self.folder.display()
            ));
        }
        RunError::Input(format!(
            "{} contains no snapshots to draw: {series} is missing. Run the scene again with `ripstop run` and \
             output.{key} above 0 (4 writes every fourth window)",
            self.folder.display()
        ))
    }

    /// Reads one file of a snapshot.
    pub fn piece(&self, file: &Path) -> Result<Piece, RunError> {
        Piece::read(file).map_err(|e| RunError::Input(format!("{e}. Run the scene again with `ripstop run`")))
    }

    /// Canopy and lines of the snapshot nearest to `time` (s), else of the last.
    pub fn structure(&self, stage: usize, time: Option<f64>) -> Result<Option<Structure>, RunError> {
        let Some(times) = self.times(stage, Kind::Canopy)? else { return Ok(None) };
        let snapshot = times.nearest(time);
        let [file] = &snapshot.files[..] else {
            return Err(RunError::Input("a snapshot of the canopy has several files, but one is expected. Run the scene again with `ripstop run`".into()));
        };
        let canopy = self.piece(file)?;
        let lines = match self.times(stage, Kind::Lines)? {
            Some(lines) => {
                let lines = lines.nearest(Some(snapshot.time));
                (lines.time == snapshot.time).then(|| self.piece(&lines.files[0])).transpose()?
            }
            None => None,
        };
        Ok(Some((snapshot.time, canopy, lines)))
    }

    /// Last shape of the canopy in the stages before `stage`.
    pub fn last_before(&self, stage: usize) -> Result<Option<Structure>, RunError> {
        for earlier in (0..stage).rev() {
            if let Some(found) = self.structure(earlier, None)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }
}

/// A required cell field with `width` components.
pub fn field<'a>(piece: &'a Piece, name: &str, width: usize, file: &Path) -> Result<&'a Column, RunError> {
    piece.cell_field(name).filter(|c| c.width == width).ok_or_else(|| {
        RunError::Input(format!(
            "{} has no cell field `{name}` with {width} components. Run the scene again with this version",
            file.display()
        ))
    })
}
