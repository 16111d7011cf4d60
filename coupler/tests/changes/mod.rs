//! Cases of the repository with changes, for tables of tests.

use std::path::Path;

use case::Scene;
use toml::{Table, Value};

/// The case `name` with `KEY`, `VALUE` pairs: `stage.NAME.KEY` is a key of a stage, `stage.NAME` all of it, an empty value removes, `stages` keeps
/// the stages that it names, in its order.
///
/// # Errors
/// What is wrong with the changed scene.
pub fn changed(name: &str, settings: &[(&str, &str)]) -> Result<Scene, String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(name).join("scene.toml");
    let mut table: Table = std::fs::read_to_string(&file).expect("the scene").parse().expect("TOML");
    settings.iter().for_each(|(key, value)| apply(&mut table, key, value));
    case::parse(&file, &toml::to_string(&table).expect("text")).map_err(|e| e.to_string())
}

/// Applies `KEY=VALUE` to a scene.
fn apply(scene: &mut Table, key: &str, value: &str) {
    let stages = |scene: &mut Table| std::mem::take(scene["stage"].as_array_mut().expect("stages"));
    let named = |s: &Value, name: &str| s["name"].as_str() == Some(name);
    if key == "stages" {
        let old = stages(scene);
        let find = |name| old.iter().find(|s| named(s, name)).unwrap_or_else(|| panic!("no stage {name}"));
        scene["stage"] = Value::Array(value.split(' ').map(|name| find(name).clone()).collect());
        return;
    }
    let mut path: Vec<&str> = key.split('.').collect();
    let mut table = scene;
    if path[0] == "stage" {
        let stages = table["stage"].as_array_mut().expect("stages");
        let stage = stages.iter_mut().find(|s| named(s, path[1])).unwrap_or_else(|| panic!("no {key}"));
        if path.len() == 2 {
            *stage = read(value);
            return;
        }
        table = stage.as_table_mut().expect("a table");
        path.drain(..2);
    }
    let last = path.pop().expect("a key");
    for part in path {
        let next = table.entry(part).or_insert_with(|| Value::Table(Table::new()));
        table = next.as_table_mut().expect("a table");
    }
    if value.is_empty() {
        table.remove(last).unwrap_or_else(|| panic!("no {key}"));
        return;
    }
    table.insert(last.into(), read(value));
}

/// A value as TOML has it, or a word.
fn read(value: &str) -> Value {
    let read = format!("value = {value}").parse::<Table>().ok().and_then(|mut t| t.remove("value"));
    read.unwrap_or_else(|| Value::String(value.into()))
}
