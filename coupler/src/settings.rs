//! `--set KEY=VALUE`: a scene with some of its values changed on the command line.

use std::path::{Path, PathBuf};

use case::set_value;
use case::{Override, Scene};
use coupling::error::RunError;
use toml::{Table, Value};

/// A value of the scene that the command line changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Dotted key, such as `fabric.poisson_ratio`; `stage.NAME.KEY` in a stage.
    key: String,
    /// Its new value.
    value: Value,
    /// As the user wrote it.
    text: String,
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::str::FromStr for Setting {
    type Err = String;

    /// Parses the value as TOML; text that is not a TOML value is a string: `fabric.wrinkling=false`,
    /// `coupling.scheme=staggered`, `output={volume_every_windows=0}`.
    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let help = "write KEY=VALUE with a dotted key of the scene, such as fabric.poisson_ratio=0.4 or \
                    stage.descent.duration_s=2";
        let (key, value) = text.split_once('=').ok_or(help)?;
        let (key, value) = (key.trim(), value.trim());
        if value.is_empty() || key.split('.').any(str::is_empty) {
            return Err(help.into());
        }
        let read = format!("value = {value}").parse::<Table>().ok().and_then(|mut t| t.remove("value"));
        let value = read.unwrap_or_else(|| Value::String(value.into()));
        Ok(Self { key: key.into(), value, text: text.into() })
    }
}

impl Setting {
    /// The path of the value in the scene `table`, with stages by number as in the file.
    fn location(&self, table: &Table) -> Override {
        let option = format!("--set {self}");
        let Some((name, rest)) = self.key.strip_prefix("stage.").and_then(|k| k.split_once('.')) else {
            return Override { path: self.key.clone(), option };
        };
        let stages = table.get("stage").and_then(Value::as_array);
        let named = |s: &Value| s.get("name").and_then(Value::as_str) == Some(name);
        let number = stages.and_then(|all| all.iter().position(named)).unwrap_or_default();
        Override { path: format!("stage[{number}].{rest}"), option }
    }

    fn apply(&self, table: &mut Table) -> Result<(), RunError> {
        let parts: Vec<&str> = self.key.split('.').collect();
        let wrong = |why: String| RunError::Input(format!("--set {self}: {why}"));
        match &parts[..] {
            ["stage", name, path @ .., key] => {
                let stages = table.get_mut("stage").and_then(Value::as_array_mut);
                let stages: Vec<&mut Table> =
                    stages.into_iter().flatten().filter_map(Value::as_table_mut).collect();
                let names: Vec<String> =
                    stages.iter().filter_map(|s| Some(s.get("name")?.as_str()?.to_owned())).collect();
                let stage = stages.into_iter().find(|s| s.get("name").and_then(Value::as_str) == Some(name));
                let stage = stage.ok_or_else(|| {
                    wrong(format!("the scene has no stage `{name}`; it has: {}", names.join(", ")))
                })?;
                set_value(stage, path, key, self.value.clone()).map_err(|e| wrong(e.to_string()))
            }
            ["stage", ..] => Err(wrong("write stage.NAME.KEY with the name of a stage".into())),
            [path @ .., key] => {
                set_value(table, path, key, self.value.clone()).map_err(|e| wrong(e.to_string()))
            }
            [] => Ok(()),
        }
    }
}

/// The scene of `file` with `settings` applied, and its text, in which paths of files are absolute.
///
/// # Errors
/// [`RunError::Input`]: the scene is invalid without or with the settings.
pub fn changed(file: &Path, settings: &[Setting]) -> Result<(Scene, String), RunError> {
    let input = |e: &dyn std::fmt::Display| RunError::Input(e.to_string());
    // Errors of the file itself are reported with their lines.
    case::load(file).map_err(|e| input(&e))?;
    let text = std::fs::read_to_string(file).map_err(RunError::file("read", file))?;
    let mut table: Table = text.parse().map_err(|e| input(&e))?;
    for setting in settings {
        setting.apply(&mut table)?;
    }
    let overrides: Vec<Override> = settings.iter().map(|s| s.location(&table)).collect();
    let all: Vec<&str> = overrides.iter().map(|o| o.option.as_str()).collect();
    let write = |table: &Table| toml::to_string(table).map_err(|e| input(&e));
    let scene = case::parse_overridden(file, &text, &write(&table)?, &overrides).map_err(|e| input(&e))?;
    let path = |path: &PathBuf| {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
        Value::String(path.to_string_lossy().into_owned())
    };
    if let Some(file) = scene.canopy.file() {
        set_value(&mut table, &["canopy"], "file", path(file))?;
    }
    if let Some(g) = scene.grid_file() {
        set_value(&mut table, &["flow", "grid_file"], "path", path(&g.path))?;
    }
    let text = format!("# {} with {}\n\n{}", file.display(), all.join(" "), write(&table)?);
    Ok((scene, text))
}

/// The scene of `file` with settings as text, `KEY=VALUE`; paths of files are absolute, as in the scene that a run keeps.
///
/// # Errors
/// [`RunError::Input`]: a text that is no setting, an invalid scene.
pub fn scene_with(file: &Path, settings: &[String]) -> Result<Scene, RunError> {
    let parsed = settings.iter().map(|text| text.parse::<Setting>());
    let settings: Vec<Setting> = parsed.collect::<Result<_, _>>().map_err(RunError::Input)?;
    let (_, text) = changed(file, &settings)?;
    case::parse(file, &text).map_err(|e| RunError::Input(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(name).join("scene.toml")
    }

    fn settings(words: &[&str]) -> Vec<Setting> {
        words.iter().map(|w| w.parse().expect("a setting")).collect()
    }

    #[test]
    fn settings_override_values_of_scene_and_stages() {
        let words = [
            "fabric.poisson_ratio=0.4",
            "fabric.wrinkling=false",
            "coupling.scheme=staggered",
            "coupling.staggered.predictor=1",
            "stage.descent.duration_s=2",
            "canopy.stitched_end = \"top\"",
        ];
        let (scene, text) = changed(&case("atps-descent"), &settings(&words)).expect("a scene");
        assert_eq!(scene.fabric.poisson_ratio, 0.4);
        assert!(!scene.fabric.wrinkling);
        assert_eq!(scene.coupling.scheme, case::Scheme::Staggered);
        assert_eq!(scene.coupling.staggered.predictor, 1);
        assert_eq!(scene.stages[2].duration_s, 2.0);
        assert!(
            matches!(scene.canopy, case::Canopy::Atps(ref a) if a.stitched_end == case::StitchedEnd::Top)
        );
        let again = case::parse(Path::new("/x/scene.toml"), &text).expect("its text is a scene");
        assert_eq!(toml::to_string(&again).expect("text"), toml::to_string(&scene).expect("text"));
        assert!(text.starts_with("# ") && text.contains("with --set fabric.poisson_ratio=0.4 "), "{text}");
    }

    #[test]
    fn paths_of_files_become_absolute() {
        let (scene, text) = changed(&case("plate-gmsh"), &settings(&["title=x"])).expect("a scene");
        let again = case::parse(Path::new("/elsewhere/scene.toml"), &text).expect("its text is a scene");
        assert_eq!(toml::to_string(&again).expect("text"), toml::to_string(&scene).expect("text"));
        assert_eq!(again.title, "x");
    }

    #[test]
    fn errors_name_the_setting() {
        let message =
            |word: &str| changed(&case("atps-descent"), &settings(&[word])).expect_err("refused").to_string();
        for (word, part) in [
            (
                "fabric.poison_ratio=0.4",
                "scene.toml: --set fabric.poison_ratio=0.4: unknown key `poison_ratio`",
            ),
            (
                "fabric.poisson_ratio=0.7",
                "scene.toml: --set fabric.poisson_ratio=0.7: `fabric.poisson_ratio`",
            ),
            (
                "stage.descent.window_s=abc",
                "--set stage.descent.window_s=abc: `stage[2].window_s` is a string",
            ),
            ("fabric.poisson_ratio.x=0.7", "`poisson_ratio` is no table"),
            (
                "stage.landing.duration_s=2",
                "no stage `landing`; it has: pre-inflation, developed-flow, descent",
            ),
            ("stage.duration_s=2", "stage.NAME.KEY"),
        ] {
            assert!(message(word).contains(part), "{word}: {}", message(word));
        }
        for word in ["fabric", "fabric.=1", "fabric.x=", "=1"] {
            assert!(word.parse::<Setting>().is_err_and(|e| e.contains("KEY=VALUE")), "{word}");
        }
    }
}
