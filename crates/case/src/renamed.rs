//! Former names of keys and values of a scene: still accepted, with a warning.
//!
//! A former name stands in two places: in [`KEYS`] or [`VALUES`], from which the check of the schema, `--set` and the
//! warning know it, and as a `serde(alias)` of its field or variant.

use std::fmt;

use toml::de::{DeTable, DeValue};

use crate::error::line_and_column;

/// Former keys: dotted path of the section without indices, former key, current key.
const KEYS: &[[&str; 3]] = &[
    ["accuracy", "dial", "parameter"],
    ["accuracy.quantity", "take", "statistic"],
    ["coupling", "load", "load_interpolation"],
    ["coupling", "model_faces", "added_mass_max_panels"],
    ["mesh", "outer", "outer_boundary"],
    ["mesh.regrid", "below", "quality_threshold"],
];

/// Keys that are still read and have their former meaning, in whose place another section stands: dotted path of the section,
/// key, section that replaces it.
const SUPERSEDED: &[[&str; 3]] =
    &[["canopy", "reinforcements", "tapes"], ["canopy", "reinforcement_spacing_cells", "tapes.grid"]];

/// Former values: dotted path of the key without indices, former value, current value.
const VALUES: &[[&str; 3]] = &[
    ["coupling.staggered.sequence", "flow-first", "conventional-serial"],
    ["coupling.staggered.sequence", "half-step", "improved-serial"],
];

/// A former name in a scene. It is displayed as the text of a warning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Renamed {
    /// Line and column in the text, both from 1.
    pub place: (usize, usize),
    /// Current dotted key, without indices.
    pub key: String,
    /// What is written, such as ``key `coupling.load` ``.
    pub old: String,
    /// Its current name, such as `coupling.load_interpolation`, or `"improved-serial"`.
    pub new: String,
    /// It keeps its meaning, and another section replaces it.
    pub superseded: bool,
}

impl Renamed {
    /// What is written and what it is now, in a sentence without full stop.
    pub fn sentence(&self) -> String {
        if self.superseded {
            format!("{} is replaced by [{}]", self.old, self.new)
        } else {
            format!("{} is now `{}`", self.old, self.new)
        }
    }
}

/// The section that replaces the key at `path` (dotted, indices are ignored), which is still read.
pub fn replacement(path: &str) -> Option<&'static str> {
    let (section, key) = path.rsplit_once('.')?;
    current(SUPERSEDED, &without_indices(section), key)
}

impl fmt::Display for Renamed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (line, column) = self.place;
        let what = if self.superseded { "key" } else { "name" };
        write!(f, "{line}:{column}: {}; the former {what} is still accepted", self.sentence())
    }
}

/// The former names in the text of a scene, in the order of the text; none where the text is not TOML.
pub fn renamed(text: &str) -> Vec<Renamed> {
    let Ok(document) = DeTable::parse(text) else { return Vec::new() };
    let mut found = Vec::new();
    in_table(text, document.get_ref(), "", &mut found);
    found.sort_by_key(|r| r.place);
    found
}

fn in_table(text: &str, table: &DeTable<'_>, section: &str, found: &mut Vec<Renamed>) {
    for (key, value) in table {
        let name: &str = key.get_ref();
        let path = join(section, current_key(section, name));
        let place = |byte: usize| line_and_column(text, byte);
        let at = key.span().start;
        if current(KEYS, section, name).is_some() {
            let old = format!("key `{}`", join(section, name));
            let (key, new, superseded) = (path.clone(), path.clone(), false);
            found.push(Renamed { place: place(at), key, old, new, superseded });
        }
        if let Some(new) = current(SUPERSEDED, section, name) {
            let (key, old) = (path.clone(), format!("key `{path}`"));
            found.push(Renamed { place: place(at), key, old, new: new.into(), superseded: true });
        }
        match value.get_ref() {
            DeValue::Table(inner) => in_table(text, inner, &path, found),
            DeValue::Array(items) => {
                let tables = items.iter().filter_map(|i| i.get_ref().as_table());
                tables.for_each(|inner| in_table(text, inner, &path, found));
            }
            DeValue::String(word) => {
                if let Some(new) = current(VALUES, &path, word) {
                    let old = format!("value `{path} = \"{word}\"`");
                    let new = format!("\"{new}\"");
                    let (place, key) = (place(value.span().start), path.clone());
                    found.push(Renamed { place, key, old, new, superseded: false });
                }
            }
            _ => {}
        }
    }
}

fn join(section: &str, key: &str) -> String {
    if section.is_empty() { key.to_owned() } else { format!("{section}.{key}") }
}

fn current(table: &'static [[&'static str; 3]], path: &str, old: &str) -> Option<&'static str> {
    table.iter().find(|[at, name, _]| *at == path && *name == old).map(|row| row[2])
}

/// The current name of `key` in a section (dotted path, indices are ignored); the key itself where it has no other.
pub(crate) fn current_key<'a>(section: &str, key: &'a str) -> &'a str {
    current(KEYS, &without_indices(section), key).unwrap_or(key)
}

/// The current name of the former `value` of the key at `path` (dotted, indices are ignored).
pub fn current_value(path: &str, value: &str) -> Option<&'static str> {
    current(VALUES, &without_indices(path), value)
}

/// A dotted path of a scene with the current names of its keys; indices stay.
pub fn current_path(path: &str) -> String {
    path.split('.').fold(String::new(), |section, part| {
        let (name, index) = part.split_at(part.find('[').unwrap_or(part.len()));
        join(&section, current_key(&section, name)) + index
    })
}

/// The former names of a current key of a section.
pub(crate) fn former_keys(section: &str, key: &str) -> impl Iterator<Item = &'static str> {
    KEYS.iter().filter(move |[at, _, new]| *at == section && *new == key).map(|row| row[1])
}

fn without_indices(path: &str) -> String {
    path.split('.').map(|part| part.split('[').next().unwrap_or(part)).collect::<Vec<_>>().join(".")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{Scene, parse};

    const SCENE: &str = include_str!("../../../cases/square-drop/scene.toml");

    /// The scene with `lines` in `section`, which it lacks otherwise.
    fn scene(section: &str, lines: &str) -> (String, Scene) {
        let mut table: toml::Table = SCENE.parse().expect("a scene");
        let added: toml::Table = lines.parse().expect("TOML");
        let mut at = &mut table;
        for part in section.split('.') {
            let inner = at.entry(part).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            at = inner.as_table_mut().expect("a table");
        }
        at.extend(added);
        let text = toml::to_string(&table).expect("text");
        let scene = parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
        (text, scene)
    }

    /// Section, former line, current line: one for each row of the tables.
    const ROWS: &[[&str; 3]] = &[
        [
            "accuracy",
            "dial = [{ name = \"window\", values = [1, 2, 4] }]",
            "parameter = [{ name = \"window\", values = [1, 2, 4] }]",
        ],
        [
            "accuracy",
            "quantity = [{ name = \"v\", of = \"descent-speed\", take = \"rms\" }]",
            "quantity = [{ name = \"v\", of = \"descent-speed\", statistic = \"rms\" }]",
        ],
        ["coupling", "load = \"linear\"", "load_interpolation = \"linear\""],
        ["coupling", "model_faces = 77", "added_mass_max_panels = 77"],
        ["mesh", "outer = \"sliding\"", "outer_boundary = \"sliding\""],
        ["mesh.regrid", "below = 0.4", "quality_threshold = 0.4"],
        [
            "coupling",
            "staggered = { sequence = \"flow-first\" }",
            "staggered = { sequence = \"conventional-serial\" }",
        ],
        [
            "coupling",
            "staggered = { sequence = \"half-step\", predictor = 1 }",
            "staggered = { sequence = \"improved-serial\", predictor = 1 }",
        ],
    ];

    #[test]
    fn former_names_mean_the_current_ones_and_warn() {
        assert_eq!(ROWS.len(), KEYS.len() + VALUES.len(), "a row for each former name");
        for [section, old, new] in ROWS {
            let (old_text, old_scene) = scene(section, old);
            let (new_text, new_scene) = scene(section, new);
            let text = |s: &Scene| toml::to_string(s).expect("text");
            assert_eq!(text(&old_scene), text(&new_scene), "{old}");
            assert_ne!(text(&new_scene), text(&parse(Path::new("s"), SCENE).expect("a scene")), "{new}");
            assert_eq!(renamed(&new_text), [], "{new}");
            let [warning] = &renamed(&old_text)[..] else { panic!("{old}: {:?}", renamed(&old_text)) };
            let name = warning.new.rsplit('.').next().expect("a name");
            assert!(new.contains(name) && !old.contains(name), "{warning}");
            let line = old_text.lines().nth(warning.place.0 - 1).expect("the line");
            let written = warning.old.trim_end_matches('`').rsplit(['.', ' ']).next().expect("a word");
            assert!(line.contains(written), "{warning}: {line}");
        }
    }

    #[test]
    fn former_and_current_key_together_are_refused() {
        let text =
            SCENE.replace("[coupling]", "[coupling]\nload = \"mean\"\nload_interpolation = \"linear\"");
        assert_ne!(text, SCENE);
        let error = parse(Path::new("scene.toml"), &text).expect_err("refused").to_string();
        assert!(error.contains("`load` in [coupling] is the former name of `load_interpolation`"), "{error}");
    }

    #[test]
    fn superseded_keys_keep_their_meaning_and_warn() {
        let text = "[canopy]\nkind = \"atps\"\nreinforcements = true\nreinforcement_spacing_cells = 5\n";
        let warnings: Vec<String> = renamed(text).iter().map(ToString::to_string).collect();
        assert_eq!(
            warnings,
            [
                "3:1: key `canopy.reinforcements` is replaced by [tapes]; the former key is still accepted",
                "4:1: key `canopy.reinforcement_spacing_cells` is replaced by [tapes.grid]; the former key is still accepted",
            ]
        );
        assert_eq!(replacement("canopy.reinforcements"), Some("tapes"));
        assert_eq!(replacement("canopy.cells_across"), None);
        assert_eq!(current_path("canopy.reinforcements"), "canopy.reinforcements");
    }

    #[test]
    fn paths_with_indices_have_current_names() {
        assert_eq!(current_key("accuracy.quantity[3]", "take"), "statistic");
        assert_eq!(current_key("coupling", "tolerance"), "tolerance");
        assert_eq!(current_path("accuracy.dial[0].values"), "accuracy.parameter[0].values");
        assert_eq!(current_path("coupling.load"), "coupling.load_interpolation");
        assert_eq!(current_path("stage[1].window_s"), "stage[1].window_s");
        assert_eq!(current_value("coupling.staggered.sequence", "half-step"), Some("improved-serial"));
        assert_eq!(former_keys("coupling", "load_interpolation").collect::<Vec<_>>(), ["load"]);
    }
}
