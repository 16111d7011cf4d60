//! Keys in which the scenes of the compared runs differ.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::Compared;
use crate::document::{Block, Table};

/// Most letters of a value.
const VALUE: usize = 80;

/// The table of differing keys, or a sentence.
pub(super) fn block(runs: &[Compared]) -> Block {
    let scenes: Vec<BTreeMap<String, String>> = runs.iter().map(|r| keys(r.run.scene())).collect();
    let rows = differing(&scenes);
    if rows.is_empty() {
        return Block::Text("All scenes have the same values.".into());
    }
    Block::Table(Table {
        caption: "Keys of the scenes whose values differ. A dash: the scene has no such key.".into(),
        head: super::head(runs, "key"),
        rows,
    })
}

fn keys(scene: &case::Scene) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    collect("", &serde_json::to_value(scene).unwrap_or_default(), &mut found);
    found
}

/// The values of all keys, such as `fabric.poisson_ratio` or `stage.descent.window_s`.
fn collect(at: &str, value: &Value, found: &mut BTreeMap<String, String>) {
    let below = |name: &str| if at.is_empty() { name.to_owned() } else { format!("{at}.{name}") };
    match value {
        // A missing key equals a key without value.
        Value::Null => {}
        Value::Object(map) => map.iter().for_each(|(name, value)| collect(&below(name), value, found)),
        Value::Array(list) if list.first().is_some_and(Value::is_object) => {
            for (i, entry) in list.iter().enumerate() {
                let name = entry.get("name").and_then(Value::as_str);
                collect(&below(&name.map_or_else(|| i.to_string(), str::to_owned)), entry, found);
            }
        }
        other => {
            let mut text = other.as_str().map_or_else(|| other.to_string(), str::to_owned);
            if text.chars().count() > VALUE {
                text = text.chars().take(VALUE).chain(['…']).collect();
            }
            found.insert(at.to_owned(), text);
        }
    }
}

/// Key and value in each scene, of those whose values are not all the same.
fn differing(scenes: &[BTreeMap<String, String>]) -> Vec<Vec<String>> {
    let all: BTreeSet<&String> = scenes.iter().flat_map(BTreeMap::keys).collect();
    let row = |key: &&String| {
        let values: Vec<Option<&String>> = scenes.iter().map(|s| s.get(*key)).collect();
        let same = values.iter().all(|v| *v == values[0]);
        let value = |v: &Option<&String>| v.map_or("-".to_owned(), String::clone);
        (!same).then(|| [(*key).clone()].into_iter().chain(values.iter().map(value)).collect())
    };
    all.iter().filter_map(row).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn differing_keys_are_named_as_for_set() {
        let flat = |value: Value| {
            let mut found = BTreeMap::new();
            collect("", &value, &mut found);
            found
        };
        let a = json!({"fabric": {"e": 1.0, "nu": 0.3, "none": null}, "stage": [{"name": "descent", "w": 1}], "wind": [0.0, 1.0]});
        let b = json!({"fabric": {"e": 2.0, "nu": 0.3}, "stage": [{"name": "descent", "w": 2}], "wind": [0.0, 1.0], "more": "x"});
        let rows = differing(&[flat(a.clone()), flat(b)]);
        let expected = [["fabric.e", "1.0", "2.0"], ["more", "-", "x"], ["stage.descent.w", "1", "2"]];
        assert_eq!(rows, expected.map(|row| row.map(str::to_owned).to_vec()));
        assert!(differing(&[flat(a.clone()), flat(a)]).is_empty());
    }
}
