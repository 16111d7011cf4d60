//! Adds the values of the library to the document of a scene.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::sync::LazyLock;

use schemars::Schema;
use serde_json::{Value, json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{FabricMaterial, LineMaterial, RiserMaterial, TapeMaterial};

/// Keys that the library gives, as TOML, by section and name of the material.
static TEXTS: LazyLock<BTreeMap<(&'static str, &'static str), String>> = LazyLock::new(|| {
    let mut all = BTreeMap::new();
    for material in FabricMaterial::ALL {
        let mut text = String::from("wrinkling = true\n");
        for value in material.entry().values {
            let _ = writeln!(text, "{} = {:e}", value.key, value.value);
        }
        all.insert(("fabric", material.name()), text);
    }
    for material in LineMaterial::ALL {
        let lines = material.entry().values.iter().map(|v| format!("{} = {:e}\n", v.key, v.value)).collect();
        all.insert(("lines", material.name()), lines);
    }
    for material in RiserMaterial::all() {
        let risers = material.values().iter().map(|(key, v)| format!("{key} = {v:e}\n")).collect();
        all.insert(("risers", material.name()), risers);
    }
    for material in TapeMaterial::ALL {
        let tapes = material.entry().values.iter().map(|v| format!("{} = {:e}\n", v.key, v.value)).collect();
        all.insert(("tapes", material.name()), tapes);
    }
    all
});

/// Keys of `[fabric]` that the whole fabric shares, so that no group of a mesh file has them.
const SHARED: [&str; 1] = ["wrinkling"];

/// Adds to each section with a `material` the keys that it leaves out. Their place is that of the material's name. A permeability is
/// added only where the scene has a flow; without one no air passes.
pub(crate) fn fill(document: &mut DeTable<'_>) {
    let has_flow = document.contains_key("flow");
    for section in ["fabric", "lines", "risers"] {
        if let Some(table) = table_of(document, section) {
            fill_table(table, section, |key| has_flow || key != "permeability");
        }
    }
    let groups = table_of(document, "canopy").and_then(|canopy| canopy.get_mut("fabric"));
    if let Some(DeValue::Array(groups)) = groups.map(Spanned::get_mut) {
        for group in groups.iter_mut() {
            if let DeValue::Table(table) = group.get_mut() {
                fill_table(table, "fabric", |key| {
                    (has_flow || key != "permeability") && !SHARED.contains(&key)
                });
            }
        }
    }
    if let Some(tapes) = table_of(document, "tapes") {
        for (_, place) in tapes.iter_mut() {
            if let DeValue::Table(table) = place.get_mut() {
                fill_table(table, "tapes", |_| true);
            }
        }
    }
}

fn table_of<'a, 'i>(table: &'a mut DeTable<'i>, key: &str) -> Option<&'a mut DeTable<'i>> {
    match table.get_mut(key)?.get_mut() {
        DeValue::Table(inner) => Some(inner),
        _ => None,
    }
}

/// Adds to `table` the keys that it leaves out, its `material` gives as one of `section`, and `may_have` accepts.
fn fill_table(table: &mut DeTable<'_>, section: &str, may_have: impl Fn(&str) -> bool) {
    let Some(material) = table.get("material") else { return };
    let place = material.span();
    let Some(text) = material.get_ref().as_str().and_then(|name| text(section, name)) else { return };
    let Ok(given) = DeTable::parse(text) else { return };
    for (key, value) in given.into_inner() {
        let name: &str = key.get_ref();
        if !table.contains_key(name) && may_have(name) {
            table.insert(Spanned::new(place.clone(), key.into_inner()), placed(value, &place));
        }
    }
}

fn text(section: &str, name: &str) -> Option<&'static str> {
    TEXTS.iter().find(|((s, n), _)| *s == section && *n == name).map(|(_, text)| text.as_str())
}

/// The value with all its parts at `place`.
fn placed<'i>(value: Spanned<DeValue<'i>>, place: &Range<usize>) -> Spanned<DeValue<'i>> {
    let value = match value.into_inner() {
        DeValue::Table(inner) => {
            let at = |key| Spanned::new(place.clone(), key);
            DeValue::Table(inner.into_iter().map(|(k, v)| (at(k.into_inner()), placed(v, place))).collect())
        }
        other => other,
    };
    Spanned::new(place.clone(), value)
}

/// The schema of a table whose required keys may be given by its material: they are required where it has none.
pub(crate) fn required_without_material(schema: &mut Schema) {
    if let Some(required) = schema.remove("required") {
        // No material gives the distance between tapes.
        let (kept, required): (Vec<Value>, Vec<Value>) =
            required.as_array().cloned().unwrap_or_default().into_iter().partition(|key| key == "spacing_m");
        if !kept.is_empty() {
            schema.insert("required".into(), Value::Array(kept));
        }
        schema.insert("if".into(), json!({ "not": { "required": ["material"] } }));
        schema.insert("then".into(), json!({ "required": required }));
    }
}

/// Keys that a table of `schema` needs unless it has a `material`.
pub(crate) fn needed(schema: &Value) -> impl Iterator<Item = &str> {
    schema.pointer("/then/required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
}
