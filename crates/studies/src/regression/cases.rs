//! A regression case: a folder with a scene, settings and a reference.

use std::path::{Path, PathBuf};

use coupling::error::RunError;
use results::recording::stage_file;
use serde::Deserialize;

/// File with the settings of a case.
const SETTINGS: &str = "regression.toml";
/// Folder of the reference of a case: a recording without the moving grid.
const REFERENCE: &str = "reference";

/// Valid tolerances.
pub(super) const SHARE: std::ops::Range<f64> = 0.0..1.0;

/// Settings of a case, from its `regression.toml`; a case without the file has the defaults.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    /// The scene, relative to the folder of the case.
    pub(super) scene: PathBuf,
    /// Changed keys of the scene, `KEY=VALUE` as for `--set`.
    pub(super) set: Vec<String>,
    /// Windows of each stage; all where absent.
    pub(super) stop_after_windows: Option<u64>,
    /// Largest relative difference; the scale is the largest value of the field.
    pub(super) tolerance: f64,
    /// Share by which iteration counts may differ, rounded up. Counts are reported, not judged, where absent.
    pub(super) iteration_tolerance: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            scene: "scene.toml".into(),
            set: Vec::new(),
            stop_after_windows: None,
            tolerance: 1e-9,
            iteration_tolerance: None,
        }
    }
}

impl Settings {
    fn read(file: &Path) -> Result<Self, RunError> {
        if !file.is_file() {
            return Ok(Self::default());
        }
        let text = std::fs::read_to_string(file).map_err(RunError::file("read", file))?;
        let wrong = |why: String| RunError::Input(format!("{}: {why}", file.display()));
        let settings: Self = toml::from_str(&text).map_err(|e| wrong(e.to_string().trim_end().to_owned()))?;
        let shares =
            [("tolerance", Some(settings.tolerance)), ("iteration_tolerance", settings.iteration_tolerance)];
        for (key, value) in shares.into_iter().filter_map(|(key, value)| Some((key, value?))) {
            if !SHARE.contains(&value) {
                return Err(wrong(format!(
                    "{key} = {value} must be a number from 0 (bitwise identical) to less than 1"
                )));
            }
        }
        if settings.stop_after_windows == Some(0) {
            return Err(wrong("stop_after_windows = 0 leaves nothing to compare; write 1 or more".into()));
        }
        Ok(settings)
    }
}

/// A case.
#[derive(Debug)]
pub(super) struct Case {
    /// Name of its folder.
    pub(super) name: String,
    folder: PathBuf,
    pub(super) settings: Settings,
}

impl Case {
    fn read(folder: &Path) -> Result<Self, RunError> {
        let name = folder.canonicalize().map_err(RunError::file("read", folder))?;
        let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { name, folder: folder.into(), settings: Settings::read(&folder.join(SETTINGS))? })
    }

    pub(super) fn scene(&self) -> PathBuf {
        self.folder.join(&self.settings.scene)
    }

    pub(super) fn reference(&self) -> PathBuf {
        self.folder.join(REFERENCE)
    }

    pub(super) fn has_reference(&self) -> bool {
        self.reference().join("scene.toml").is_file()
    }

    /// Replaces the reference by the exchanges of a recording, and notes their `origin`.
    pub(super) fn keep(&self, recording: &Path, stages: &[String], origin: &str) -> Result<(), RunError> {
        let (new, old) = (self.folder.join("reference.new"), self.reference());
        remove(&new)?;
        let copy = |from: &Path, to: &Path| {
            std::fs::create_dir_all(to.parent().unwrap_or(to)).map_err(RunError::file("create", to))?;
            std::fs::copy(from, to).map(drop).map_err(RunError::file("write", to))
        };
        copy(&recording.join("scene.toml"), &new.join("scene.toml"))?;
        for stage in stages {
            let from = stage_file(recording, stage);
            if from.is_file() {
                copy(&from, &stage_file(&new, stage))?;
            }
        }
        let file = new.join("origin.toml");
        std::fs::write(&file, origin).map_err(RunError::file("write", &file))?;
        remove(&old)?;
        std::fs::rename(&new, &old).map_err(RunError::file("replace", &old))
    }
}

/// Removes a folder, if there is one.
pub(super) fn remove(folder: &Path) -> Result<(), RunError> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(RunError::file("remove", folder)(e)),
        _ => Ok(()),
    }
}

/// The cases in `folder`, by name: its sub-folders with a scene or settings, or the folder itself.
///
/// # Errors
/// [`RunError::Input`]: there is no case, none of a name in `only`, or wrong settings.
pub(super) fn cases(folder: &Path, only: &[String]) -> Result<Vec<Case>, RunError> {
    let is_case = |f: &Path| f.join("scene.toml").is_file() || f.join(SETTINGS).is_file();
    let mut folders = vec![folder.to_path_buf()];
    if !is_case(folder) {
        let entries = std::fs::read_dir(folder).map_err(RunError::file("read", folder))?;
        folders = entries.filter_map(|e| Some(e.ok()?.path())).filter(|f| is_case(f)).collect();
        folders.sort();
    }
    if folders.is_empty() {
        return Err(RunError::Input(format!(
            "{} has no regression case: a case is a folder in it with `scene.toml`, or with `regression.toml` that names a scene",
            folder.display()
        )));
    }
    let all: Vec<Case> = folders.iter().map(|f| Case::read(f)).collect::<Result<_, _>>()?;
    if let Some(unknown) = only.iter().find(|name| !all.iter().any(|c| c.name == **name)) {
        let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
        return Err(RunError::Input(format!(
            "{} has no case `{unknown}`; cases: {}",
            folder.display(),
            names.join(", ")
        )));
    }
    Ok(all.into_iter().filter(|c| only.is_empty() || only.contains(&c.name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(file: PathBuf, text: &str) {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }

    #[test]
    fn cases_are_sub_folders_or_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let refused = |only: &[String]| cases(root, only).unwrap_err().to_string();
        assert!(refused(&[]).contains("no regression case"));
        write(root.join("b/scene.toml"), "");
        write(
            root.join("a/regression.toml"),
            "scene = \"../b/scene.toml\"\nset = [\"x=1\"]\ntolerance = 1e-6\n",
        );
        write(root.join("notes/readme.md"), "");
        let all = cases(root, &[]).unwrap();
        assert_eq!(all.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!((all[0].settings.tolerance, all[0].settings.set[0].as_str()), (1e-6, "x=1"));
        assert_eq!(all[0].scene(), root.join("a/../b/scene.toml"));
        assert_eq!(all[1].settings, Settings::default());
        assert_eq!(cases(&root.join("b"), &[]).unwrap()[0].name, "b");
        assert_eq!(cases(root, &["b".into()]).unwrap().len(), 1);
        assert!(refused(&["c".into()]).contains("no case `c`; cases: a, b"));
    }

    #[test]
    fn wrong_settings_are_refused_with_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a/regression.toml");
        for (text, says) in [
            ("tolerance = 1.5", "tolerance = 1.5 must be"),
            ("tolerance = nan", "tolerance = NaN must be"),
            ("iteration_tolerance = -0.1", "iteration_tolerance = -0.1 must be"),
            ("stop_after_windows = 0", "leaves nothing to compare"),
            ("tolerence = 1e-6", "tolerence"),
            ("set = 3", "line 1"),
        ] {
            write(file.clone(), text);
            let error = cases(folder.path(), &[]).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains("regression.toml"), "{text}: {error}");
        }
    }

    #[test]
    fn a_new_reference_replaces_all_of_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        write(root.join("case/scene.toml"), "");
        write(root.join("case/reference/former/exchange.rec"), "old");
        write(root.join("recording/scene.toml"), "scene");
        write(root.join("recording/descent/exchange.rec"), "new");
        write(root.join("recording/descent/state/flow.bin"), "large");
        let case = &cases(&root.join("case"), &[]).unwrap()[0];
        assert!(!case.has_reference());
        let stages = ["descent".to_owned(), "trajectory".to_owned()];
        case.keep(&root.join("recording"), &stages, "version = \"1\"\n").unwrap();
        assert!(case.has_reference());
        let reference = case.reference();
        assert_eq!(std::fs::read_to_string(stage_file(&reference, "descent")).unwrap(), "new");
        assert!(reference.join("origin.toml").is_file() && !reference.join("former").exists());
        assert!(!reference.join("descent/state").exists() && !root.join("case/reference.new").exists());
    }
}
