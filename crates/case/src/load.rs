//! From a TOML file to a scene that programs may rely on.

use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Problem, SceneError};
use crate::{Canopy, Scene, schema, validate};

/// Reads and validates a scene file.
pub fn load(file: &Path) -> Result<Scene, SceneError> {
    let text = std::fs::read_to_string(file).map_err(|e| {
        SceneError::plain(
            file,
            format!("the scene cannot be read: {e}"),
            "name a scene file, such as cases/atps-descent/scene.toml",
        )
    })?;
    parse(file, &text)
}

/// Parses and validates the text of a scene; `file` is for messages.
pub fn parse(file: &Path, text: &str) -> Result<Scene, SceneError> {
    let error = |problems| SceneError::new(file, text, problems);
    let document = DeTable::parse(text).map_err(|e| {
        error(vec![Problem::new(
            e.span(),
            format!("not TOML: {}", e.message().trim_end()),
            "see https://toml.io for the syntax",
        )])
    })?;
    let problems = schema::check(&document);
    if !problems.is_empty() {
        return Err(error(problems));
    }
    let mut scene: Scene = toml::from_str(text).map_err(|e| {
        error(vec![Problem::new(
            e.span(),
            e.message().trim_end(),
            "`ripstop schema` prints what a scene may contain",
        )])
    })?;
    if let (Canopy::Gmsh(g), Some(folder)) = (&mut scene.canopy, file.parent()) {
        g.file = folder.join(&g.file);
    }
    if let (Some(g), Some(folder)) = (scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()), file.parent()) {
        g.path = folder.join(&g.path);
    }
    let problems = validate::problems(&scene)
        .into_iter()
        .map(|p| Problem::new(span_of(&document, &p.path), p.what, p.help))
        .collect::<Vec<_>>();
    if problems.is_empty() { Ok(scene) } else { Err(error(problems)) }
}

/// Line and column, both from 1, of the value at a dotted path in the text of a scene, or of the nearest table
/// above it; `None` where the text has neither, or is not TOML.
pub fn place_of(text: &str, path: &str) -> Option<(usize, usize)> {
    let document = DeTable::parse(text).ok()?;
    let at = span_of(&document, path)?.start;
    Some(crate::error::line_and_column(text, at))
}

/// Bytes of the value at a dotted path (`fabric.thickness_m`, `stage[1].window_s`),
/// or of the nearest table above it.
pub(crate) fn span_of(document: &Spanned<DeTable<'_>>, path: &str) -> Option<std::ops::Range<usize>> {
    let mut table = document.get_ref();
    let mut span = None;
    let mut value: Option<&Spanned<DeValue<'_>>>;
    for part in path.split('.') {
        let (name, index) = match part.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (part, None),
        };
        let Some((key, found)) = table.iter().find(|(k, _)| k.get_ref().as_ref() == name) else { break };
        span = Some(if found.get_ref().is_table() { key.span() } else { found.span() });
        value = Some(found);
        if let Some(i) = index {
            value = found.get_ref().as_array().and_then(|a| a.get(i));
            span = value.map(Spanned::span).or(span);
        }
        match value.and_then(|v| v.get_ref().as_table()) {
            Some(inner) => table = inner,
            None => break,
        }
    }
    span
}
