//! `docs/reference/scene.md`: every key of a scene.
//!
//! Keys, types, defaults and texts come from the schema, ranges from the validation, effects from their table. An example
//! of each key is a line of a scene in `examples`, which are read and validated.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use case::Scene;
use serde_json::Value;

use super::markdown::{anchor, compare_or_write, head, inline, number, root, table};
use super::schema::{Key, Schema, Section, described, join};
use super::units::unit;

/// Keys and the entries (name, description) that have them.
type NamesByKeys = (Vec<String>, Vec<(String, String)>);

const INTRODUCTION: &str = "\
A scene is a TOML file. Each section below is a table of the file. A table that is absent is an effect that is off, or has \
its defaults; a key that is unknown is refused with the nearest known one. `ripstop schema` prints the JSON schema of this \
page for editors, `ripstop check SCENE` validates a scene.

- **Value**: type, unit (the name of a key ends in it: `_pa`, `_m_s`) and, behind \"default\", the value of an absent key. \
A number without a unit is a count, a share or a coefficient.
- **Range**: what validation accepts; `(0, 1]` excludes 0 and includes 1. A dash: any value of the type, within the rules \
in the text.
- **Example**: a line of a scene that is valid.
- Vectors have the components x, y, z; z points upwards.";

/// Order of the tables on the page; tables in them follow.
const ORDER: &[&str] = &[
    "",
    "canopy",
    "fabric",
    "lines",
    "risers",
    "tapes",
    "structure",
    "flow",
    "mesh",
    "coupling",
    "descent",
    "fabric_gravity",
    "reefing",
    "point_mass",
    "stage",
    "output",
    "ranks",
    "programs",
    "accuracy",
];

/// Effects whose keys are not the path of a table or key, and where they are set.
const EFFECTS_ELSEWHERE: &[(&str, &str)] = &[
    ("stage.prescribed", "stage.kind"),
    ("flow.viscosity.turbulence.spalart-allmaras", "flow.viscosity.turbulence"),
    ("flow.viscosity.turbulence.des", "flow.viscosity.turbulence"),
];

/// A scene of the folder `examples`.
struct Example {
    text: String,
    scene: Scene,
}

fn examples() -> Vec<Example> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference/examples");
    let mut files: Vec<_> =
        std::fs::read_dir(folder).expect("examples").map(|e| e.expect("a file").path()).collect();
    files.sort();
    // Mesh files are named from the folder of the case that has them.
    let beside_meshes = root().join("cases/plate-gmsh/example.toml");
    let read = |file: &Path| {
        let text = std::fs::read_to_string(file).expect("text");
        let scene = case::parse(&beside_meshes, &text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let former = case::renamed(&text).into_iter().filter(|r| !r.superseded);
        assert_eq!(former.collect::<Vec<_>>(), [], "{}", file.display());
        Example { text, scene }
    };
    files.iter().map(|f| read(f)).collect()
}

/// Path of a key without the kind of its table.
fn plain(path: &str) -> String {
    let mut plain = String::new();
    let mut depth = 0;
    for c in path.chars() {
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            c if depth == 0 => plain.push(c),
            _ => {}
        }
    }
    plain
}

/// The path with the kind of the canopy, as the schema has it.
fn with_kind(path: &str, kind: &str) -> String {
    let plain = plain(path);
    match plain.strip_prefix("canopy.") {
        Some(key) => format!("canopy({kind}).{key}"),
        None => plain,
    }
}

fn kind_of(scene: &Scene) -> String {
    let canopy = serde_json::to_value(&scene.canopy).expect("JSON");
    canopy["kind"].as_str().expect("a kind").to_owned()
}

/// First line of each key and table in the examples, by path.
fn lines(examples: &[Example]) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for example in examples {
        let kind = kind_of(&example.scene);
        let mut section = String::new();
        for line in example.text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')) {
            let path = if line.starts_with('[') {
                section = line.trim_matches(['[', ']']).to_owned();
                section.clone()
            } else {
                join(&section, line.split(" = ").next().expect("a key"))
            };
            found.entry(with_kind(&path, &kind)).or_insert_with(|| line.to_owned());
        }
    }
    found
}

/// Ranges by path, from the examples and from the same scenes with other numbers: a range that differs depends on them.
fn ranges(examples: &[Example]) -> BTreeMap<String, String> {
    let mut found: BTreeMap<String, Vec<(String, String)>> = BTreeMap::new();
    for example in examples {
        let mut value = serde_json::to_value(&example.scene).expect("JSON");
        shrink(&mut value);
        let other: Scene = serde_json::from_value(value).expect("the same scene with other numbers");
        let kind = kind_of(&example.scene);
        for a in [&example.scene, &other].into_iter().flat_map(case::allowed_ranges) {
            let all = found.entry(with_kind(&a.path, &kind)).or_default();
            let entry = (interval(a.range, a.includes_smallest), a.why);
            if !all.contains(&entry) {
                all.push(entry);
            }
        }
    }
    let text = |all: Vec<(String, String)>| {
        let whys: BTreeSet<&str> = all.iter().map(|(_, why)| why.as_str()).collect();
        let whys = inline(&whys.into_iter().collect::<Vec<_>>().join("; "));
        let same = all.iter().all(|(range, _)| *range == all[0].0);
        if same { format!("{}: {whys}", all[0].0) } else { format!("depends on other keys: {whys}") }
    };
    found.into_iter().map(|(path, all)| (path, text(all))).collect()
}

/// Makes all numbers that are not whole smaller.
fn shrink(value: &mut Value) {
    match value {
        Value::Number(n) if n.is_f64() => *value = Value::from(0.9 * n.as_f64().expect("a number")),
        Value::Array(all) => all.iter_mut().for_each(shrink),
        Value::Object(all) => all.values_mut().for_each(shrink),
        _ => {}
    }
}

fn interval([low, high]: [f64; 2], includes_low: bool) -> String {
    if high == f64::from(u32::MAX) {
        return format!("{} or more", number(low));
    }
    format!("{}{}, {}]", if includes_low { '[' } else { '(' }, number(low), number(high))
}

/// Type of a value.
fn kind(schema: &Schema, value: &Value) -> String {
    let inner = schema.inner(value);
    let one = match &inner["type"] {
        Value::String(one) => one.as_str(),
        Value::Array(all) => all.iter().filter_map(Value::as_str).find(|t| *t != "null").unwrap_or("value"),
        _ => "value",
    };
    if schema.listed(value).is_some() {
        return "list of tables".into();
    }
    if schema.is_table(value) {
        return "table".into();
    }
    if !names(inner).is_empty() {
        return "name, see below".into();
    }
    match (one, inner.get("items")) {
        ("array", Some(items)) => {
            let items = kind(schema, items);
            let items = if items.starts_with("array") { items } else { format!("{items}s") };
            match (&inner["minItems"], &inner["maxItems"]) {
                (Value::Number(least), Value::Number(most)) if least == most => {
                    format!("array of {least} {items}")
                }
                _ if items.starts_with("array") => {
                    format!("array of {}", items.replacen("array", "arrays", 1))
                }
                _ => format!("array of {items}"),
            }
        }
        _ => one.to_owned(),
    }
}

/// Names that a value may have, with what each means.
fn names(inner: &Value) -> Vec<(String, String)> {
    let several = inner["enum"].as_array().into_iter().flatten().map(|v| (v, String::new()));
    let one_of = inner["oneOf"].as_array().into_iter().flatten();
    let described = one_of.flat_map(|v| {
        let several = v["enum"].as_array().into_iter().flatten();
        v.get("const").into_iter().chain(several).map(|c| (c, described(v)))
    });
    let all = several.chain(described).filter_map(|(v, text)| Some((v.as_str()?.to_owned(), text)));
    all.collect()
}

fn default_of(schema: &Schema, key: &Key) -> String {
    match &key.schema["default"] {
        _ if key.required => "required".into(),
        _ if key.needed => "required without `material`".into(),
        Value::Array(_) if schema.listed(&key.schema).is_some() => "default: none".into(),
        Value::Object(_) => "default: that of each key".into(),
        Value::Null => "default: absent".into(),
        Value::Number(n) if n.is_f64() => format!("default `{}`", number(n.as_f64().expect("a number"))),
        value => format!("default `{value}`"),
    }
}

/// The effects of the table by the path that sets them.
fn effects() -> BTreeMap<String, Vec<&'static str>> {
    let mut all: BTreeMap<String, Vec<&'static str>> = BTreeMap::new();
    for entry in effects::table::TABLE {
        let elsewhere = EFFECTS_ELSEWHERE.iter().find(|(key, _)| *key == entry.key);
        let path = elsewhere.map_or(entry.key, |(_, path)| path);
        all.entry(path.to_owned()).or_default().push(entry.key);
    }
    all
}

fn links(effects: &[&str]) -> String {
    let link = |key: &&str| format!("[`{key}`](effects.md#{})", anchor(key));
    let word = if effects.len() == 1 { "Effect" } else { "Effects" };
    format!("{word}: {}.", effects.iter().map(link).collect::<Vec<_>>().join(", "))
}

/// What joins the page.
struct Sources {
    schema: Schema,
    lines: BTreeMap<String, String>,
    ranges: BTreeMap<String, String>,
    effects: BTreeMap<String, Vec<&'static str>>,
}

impl Sources {
    fn new() -> Self {
        let examples = examples();
        Self {
            schema: Schema::of_code(),
            lines: lines(&examples),
            ranges: ranges(&examples),
            effects: effects(),
        }
    }

    fn page(&self) -> String {
        let sections = self.schema.sections();
        let place = |s: &Section| {
            let first = s.path.split(['.', '(']).next().expect("a word");
            ORDER.iter().position(|o| *o == first).unwrap_or_else(|| panic!("`{first}` is missing in ORDER"))
        };
        let mut ordered: Vec<&Section> = sections.iter().collect();
        ordered.sort_by_key(|s| place(s));
        let mut text = head("Keys of a scene", INTRODUCTION);
        ordered.iter().for_each(|s| self.section(s, &mut text));
        text
    }

    fn section(&self, s: &Section, text: &mut String) {
        *text += &format!("\n{}\n", heading(s));
        for part in s.text.iter().filter(|t| !t.is_empty()) {
            *text += &format!("\n{}\n", part.trim().replace("[`", "`").replace("`]", "`"));
        }
        if let Some(effects) = self.effects.get(&plain(&s.path)).filter(|_| !s.path.is_empty()) {
            *text += &format!("\n{}\n", links(effects));
        }
        if s.keys.is_empty() && !s.path.is_empty() && !self.has_kinds(s) {
            let what = if s.path == "flow.grid_file.patches" {
                "Each key is the name of a physical group; each value is a condition:\n\n".to_owned()
                    + &self.conditions()
            } else {
                "The table has no keys: its header switches the effect on.\n".into()
            };
            *text += &format!("\n{what}\nExample: `{}`\n", self.line(&s.path));
        }
        if !s.keys.is_empty() {
            let rows: Vec<Vec<String>> = s.keys.iter().map(|k| self.row(s, k)).collect();
            *text += &format!("\n{}", table(&["key", "value", "range", "meaning", "example"], &rows));
        }
        for (keys, all) in self.names_by_keys(s) {
            *text += &format!("\nValues of {}:\n\n{}", keys.join(", "), listed(&all));
        }
    }

    /// Names that keys may have, with the keys that have the same.
    fn names_by_keys(&self, s: &Section) -> Vec<NamesByKeys> {
        let mut found: Vec<NamesByKeys> = Vec::new();
        for key in &s.keys {
            let (name, all) = (format!("`{}`", key.name), names(self.schema.inner(&key.schema)));
            match found.iter_mut().find(|(_, known)| *known == all) {
                Some((keys, _)) => keys.push(name),
                None if !all.is_empty() => found.push((vec![name], all)),
                None => {}
            }
        }
        found
    }

    /// Whether the keys of the table depend on its kind.
    fn has_kinds(&self, s: &Section) -> bool {
        s.path == "canopy"
    }

    fn conditions(&self) -> String {
        let all = self.schema.sections();
        let sides = all.iter().find(|s| s.path == "flow.box.sides").expect("conditions of a box");
        listed(&names(self.schema.inner(&sides.keys[0].schema)))
    }

    fn line(&self, path: &str) -> &str {
        self.lines.get(path).map_or_else(|| panic!("no scene in `examples` has `{path}`"), String::as_str)
    }

    fn row(&self, s: &Section, key: &Key) -> Vec<String> {
        let path = join(&s.path, &key.name);
        let is_table = self.schema.is_table(&key.schema) || self.schema.listed(&key.schema).is_some();
        let mut value = kind(&self.schema, &key.schema);
        if let Some(unit) = unit(&key.name).filter(|_| !is_table) {
            value += &format!(", {unit}");
        }
        value += &format!("; {}", default_of(&self.schema, key));
        let mut meaning = inline(&described(&key.schema));
        if is_table {
            meaning += &format!(" See [`{}`](#{}).", plain(&path), anchor(&plain(&path)));
        } else if let Some(effects) = self.effects.get(&plain(&path)) {
            meaning += &format!(" {}", links(effects));
        }
        if key.name == "kind" && s.path.starts_with("canopy") {
            meaning = "Selects this kind of canopy.".into();
            value = "name; required".into();
        }
        let range = self.ranges.get(&path).cloned().unwrap_or_else(|| "-".into());
        let example = format!("`{}`", self.line(&path).replace('|', "\\|"));
        vec![format!("`{}`", key.name), value, range, meaning, example]
    }
}

fn listed(names: &[(String, String)]) -> String {
    names
        .iter()
        .map(|(name, text)| format!("- `\"{name}\"`: {}\n", inline(text).replace("\\|", "|")))
        .collect()
}

/// Path of a section on the page: a table within a kind of canopy has no kind.
fn on_page(path: &str) -> String {
    if path.contains(").") { plain(path) } else { path.to_owned() }
}

fn heading(s: &Section) -> String {
    let path = on_page(&s.path);
    match path.split_once('(') {
        None if path.is_empty() => "## Top level".into(),
        None if path != s.path => format!("### `[[{path}]]`"),
        None if s.is_list => format!("## `[[{path}]]`"),
        None => format!("## `[{path}]`"),
        Some((_, kind)) => format!("### `kind = \"{}\"`", kind.trim_end_matches(')')),
    }
}

#[test]
fn page_of_scene_keys_is_generated_from_the_code() {
    compare_or_write("scene.md", &Sources::new().page());
}

/// Keys of the page, read from its headings and tables.
fn keys_of_page(text: &str) -> Vec<String> {
    let (mut section, mut keys) = (String::new(), Vec::new());
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            section = if heading == "Top level" {
                String::new()
            } else {
                heading.trim_matches(['`', '[', ']']).into()
            };
        } else if let Some(table) = line.strip_prefix("### `[[") {
            section = table.trim_end_matches(['`', ']']).into();
        } else if let Some(kind) = line.strip_prefix("### `kind = ") {
            section = format!("canopy({})", kind.trim_matches(['`', '"']));
        } else if let Some((key, _)) = line.strip_prefix("| `").and_then(|rest| rest.split_once('`')) {
            keys.push(join(&section, key));
        }
    }
    keys
}

#[test]
fn page_has_every_key_of_the_committed_schema_once_and_none_else() {
    let mut keys = keys_of_page(&Sources::new().page());
    keys.sort();
    let sections = Schema::committed().sections();
    let mut all: Vec<String> =
        sections.iter().flat_map(|s| s.keys.iter().map(|k| join(&on_page(&s.path), &k.name))).collect();
    all.sort();
    assert!(all.len() > 250, "{} keys", all.len());
    assert_eq!(keys, all);
}

#[test]
fn every_effect_and_every_range_belongs_to_a_key() {
    let sources = Sources::new();
    let sections = sources.schema.sections();
    let keys: BTreeSet<String> =
        sections.iter().flat_map(|s| s.keys.iter().map(|k| join(&s.path, &k.name))).collect();
    for path in sources.ranges.keys() {
        assert!(keys.contains(path), "range of `{path}`");
    }
    assert!(sources.ranges.len() > 100, "{} ranges", sources.ranges.len());
    let plain: BTreeSet<String> = keys.iter().map(|k| plain(k)).collect();
    for (path, effects) in &sources.effects {
        assert!(plain.contains(path), "{effects:?}: `{path}`");
    }
}

#[test]
fn ranges_that_depend_on_other_keys_are_recognised() {
    let ranges = Sources::new().ranges;
    assert_eq!(ranges["coupling.tolerance"], "(0, 0.5]: a relative change");
    assert!(ranges["stage.substeps"].starts_with("[1, 100000]"), "{}", ranges["stage.substeps"]);
    for path in
        ["stage.window_s", "lines.prestress_pa", "mesh.regrid.quality_threshold", "flow.box.first_layer_m"]
    {
        assert!(ranges[path].starts_with("depends on other keys"), "{path}: {}", ranges[path]);
    }
}
