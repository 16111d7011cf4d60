//! Adds the values of the library to the document of a scene.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::sync::LazyLock;

use schemars::Schema;
use serde_json::{Value, json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{FabricMaterial, LineMaterial};

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
        let risers = material.riser_values().iter().map(|(key, v)| format!("{key} = {v:e}\n")).collect();
        all.insert(("risers", material.name()), risers);
    }
    all
});

/// Adds to each section with a `material` the keys that it leaves out. Their place is that of the material's name. A permeability is
/// added only where the scene has a flow; without one no air passes.
pub(crate) fn fill(document: &mut DeTable<'_>) {
    let has_flow = document.contains_key("flow");
    for section in ["fabric", "lines", "risers"] {
        let Some(table) = document.get_mut(section) else { continue };
        let DeValue::Table(table) = table.get_mut() else { continue };
        let Some(material) = table.get("material") else { continue };
        let place = material.span();
        let Some(text) = material.get_ref().as_str().and_then(|name| text(section, name)) else { continue };
        let Ok(given) = DeTable::parse(text) else { continue };
        for (key, value) in given.into_inner() {
            let name: &str = key.get_ref();
            if !table.contains_key(name) && (has_flow || name != "permeability") {
                table.insert(Spanned::new(place.clone(), key.into_inner()), placed(value, &place));
            }
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
        schema.insert("if".into(), json!({ "not": { "required": ["material"] } }));
        schema.insert("then".into(), json!({ "required": required }));
    }
}

/// Keys that a table of `schema` needs unless it has a `material`.
pub(crate) fn needed(schema: &Value) -> impl Iterator<Item = &str> {
    schema.pointer("/then/required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
}
