//! Where a key of a scene stands in its text, and which key stands at a place.

use std::ops::Range;
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::line_and_column;
use crate::renamed::current_key;

/// Line and column, both from 1, of the value at a dotted path in the text of a scene, or of the nearest table
/// above it; `None` where the text has neither, or is not TOML.
pub fn place_of(text: &str, path: &str) -> Option<(usize, usize)> {
    let document = DeTable::parse(text).ok()?;
    let at = span_of(&document, path)?.start;
    Some(line_and_column(text, at))
}

/// The text of a scene that lies in `folder`, with absolute paths of the files that it names: a copy of it in another
/// folder is the same scene. All else stays as written.
pub fn with_absolute_paths(text: &str, folder: &Path) -> String {
    let Ok(document) = DeTable::parse(text) else { return text.to_owned() };
    let mut paths: Vec<(Range<usize>, String)> = ["canopy.file", "flow.grid_file.path"]
        .into_iter()
        .filter_map(|key| {
            let span = span_of(&document, key)?;
            // Without the key the span is that of a table.
            let value: toml::Table = format!("value = {}", text.get(span.clone())?).parse().ok()?;
            let path = folder.join(value.get("value")?.as_str()?);
            let path = std::path::absolute(&path).unwrap_or(path);
            Some((span, toml::Value::String(path.to_string_lossy().into_owned()).to_string()))
        })
        .collect();
    paths.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    let mut text = text.to_owned();
    paths.into_iter().for_each(|(span, path)| text.replace_range(span, &path));
    text
}

/// Bytes of the value at a dotted path (`fabric.thickness_m`, `stage[1].window_s`),
/// or of the nearest table above it.
pub(crate) fn span_of(document: &Spanned<DeTable<'_>>, path: &str) -> Option<Range<usize>> {
    let mut table = document.get_ref();
    let mut span = None;
    let mut value: Option<&Spanned<DeValue<'_>>>;
    let mut section = String::new();
    for part in path.split('.') {
        let (name, index) = match part.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (part, None),
        };
        let is = |written: &str| written == name || current_key(&section, written) == name;
        let Some((key, found)) = table.iter().find(|(k, _)| is(k.get_ref())) else { break };
        section = if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") };
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

/// Path, with current names, of the innermost key or value that begins at or around the bytes `at`.
pub(crate) fn path_at(table: &DeTable<'_>, at: &Range<usize>, above: &str) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let name = current_key(above, key.get_ref());
        let path = if above.is_empty() { name.to_string() } else { format!("{above}.{name}") };
        let inner = value_path(value, at, &path);
        inner.or_else(|| covers(&key.span(), at).then_some(path))
    })
}

fn value_path(value: &Spanned<DeValue<'_>>, at: &Range<usize>, path: &str) -> Option<String> {
    let inner = match value.get_ref() {
        DeValue::Table(table) => path_at(table, at, path),
        DeValue::Array(items) => {
            items.iter().enumerate().find_map(|(i, item)| value_path(item, at, &format!("{path}[{i}]")))
        }
        _ => None,
    };
    inner.or_else(|| covers(&value.span(), at).then(|| path.to_owned()))
}

fn covers(span: &Range<usize>, at: &Range<usize>) -> bool {
    span.start <= at.start && at.start < span.end.max(span.start + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_of_a_scene_name_the_same_files() {
        let text = "[canopy] # a mesh\nfile = 'a \"b\".msh'\n[flow.grid_file]\nmembrane = \"path\"\npath   = \"../c.msh\" # d\n";
        let copy = with_absolute_paths(text, Path::new("/x/y"));
        assert!(
            copy.contains("[canopy] # a mesh") && copy.contains("path   = \"/x/y/../c.msh\" # d"),
            "{copy}"
        );
        let value: toml::Table = copy.parse().expect("TOML");
        assert_eq!(value["canopy"]["file"].as_str(), Some("/x/y/a \"b\".msh"));
        assert_eq!(with_absolute_paths(&copy, Path::new("/z")), copy);
        let without = "[canopy]\nkind = \"none\"\n[flow.grid_file]\nmembrane = \"e\"\n";
        assert_eq!(with_absolute_paths(without, Path::new("/z")), without);
    }
}
