//! The snapshots of a run: shapes of canopy and lines, fields of the flow.

use std::path::{Path, PathBuf};

use case::Scene;
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

    /// Index of the stage `name`, else of the last stage with snapshots of the canopy.
    pub fn stage(&self, name: Option<&str>) -> Result<usize, RunError> {
        let stages = &self.scene.stages;
        if let Some(name) = name {
            return stages.iter().position(|s| s.name == name).ok_or_else(|| {
                let names: Vec<_> = stages.iter().map(|s| format!("`{}`", s.name)).collect();
                RunError::Input(format!(
                    "there is no stage `{name}`. The stages of the scene are {}",
                    names.join(", ")
                ))
            });
        }
        for stage in (0..stages.len()).rev() {
            if self.times(stage, Kind::Canopy)?.is_some() {
                return Ok(stage);
            }
        }
        Err(self.none("canopy.pvd", "surface_every_windows"))
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
