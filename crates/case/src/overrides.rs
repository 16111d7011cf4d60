//! Scenes with values from the command line: problems cite the user's file, or the option.

use std::path::Path;

use toml::de::DeTable;

use crate::error::{Problem, SceneError};
use crate::place::{path_at, span_of};
use crate::renamed::{current_key, former_keys};
use crate::{Scene, parse};

/// A value that an option of the command line replaces or adds.
#[derive(Clone, Debug, PartialEq)]
pub struct Override {
    /// Dotted path in the scene with current names, such as `fabric.thickness_m` or `stage[2].window_s`.
    pub path: String,
    /// The option as the user wrote it, such as `--set fabric.thickness_m=1e-4`.
    pub option: String,
}

/// A part of a dotted path of a scene that is no table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotATable(String);

impl std::fmt::Display for NotATable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}` is no table", self.0)
    }
}

impl std::error::Error for NotATable {}

/// Sets `key` in the table at `path` of a scene, which is created where it is missing. A former name of a key sets the
/// current key; the value replaces that of former names.
///
/// # Errors
/// A part of the path that is no table.
pub fn set_value(
    table: &mut toml::Table,
    path: &[&str],
    key: &str,
    value: toml::Value,
) -> Result<(), NotATable> {
    let mut at = table;
    for part in path {
        let inner = at.entry(*part).or_insert_with(|| toml::Value::Table(toml::Table::new()));
        at = inner.as_table_mut().ok_or_else(|| NotATable((*part).into()))?;
    }
    let section = path.join(".");
    let key = current_key(&section, key);
    former_keys(&section, key).for_each(|former| drop(at.remove(former)));
    at.insert(key.into(), value);
    Ok(())
}

/// Parses `text`, which is `original` (the content of `file`) with `overrides` applied.
///
/// # Errors
/// Problems at an overridden value name its option; all others name their line in `original`.
pub fn parse_overridden(
    file: &Path,
    original: &str,
    text: &str,
    overrides: &[Override],
) -> Result<Scene, SceneError> {
    parse(file, text).map_err(|error| {
        let problems = error.problems.into_iter().map(|p| relocate(p, original, text, overrides)).collect();
        SceneError::new(file, original, problems)
    })
}

/// The same problem with its place in `original`, or with the option that caused it.
fn relocate(problem: Problem, original: &str, text: &str, overrides: &[Override]) -> Problem {
    let Some(at) = problem.at.clone() else { return problem };
    let path = DeTable::parse(text).ok().and_then(|document| path_at(document.get_ref(), &at, ""));
    let Some(path) = path else { return Problem { at: None, ..problem } };
    let concerns = |o: &&Override| {
        let below = |long: &str, short: &str| {
            long.strip_prefix(short).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        };
        below(&path, &o.path) || below(&o.path, &path)
    };
    match overrides.iter().find(concerns) {
        Some(o) => Problem { at: None, what: format!("{}: {}", o.option, problem.what), ..problem },
        None => {
            let at = DeTable::parse(original).ok().and_then(|document| span_of(&document, &path));
            let options: Vec<&str> = overrides.iter().map(|o| o.option.as_str()).collect();
            let help = format!(
                "{} (the file alone is valid: {} is in conflict)",
                problem.help,
                options.join(" or ")
            );
            Problem { at, help, ..problem }
        }
    }
}
