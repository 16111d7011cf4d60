//! Differences between the scene of a run and the scene that it is resumed with.

use case::Scene;
use serde_json::Value;

use super::find::Point;

/// Keys of two scenes whose values differ, such as `fabric.poisson_ratio` or `stage[1].window_s`.
pub(super) fn changes(old: &Value, new: &Value) -> Vec<String> {
    let mut keys = Vec::new();
    collect("", Some(old), Some(new), &mut keys);
    keys
}

fn collect(at: &str, old: Option<&Value>, new: Option<&Value>, keys: &mut Vec<String>) {
    // A missing key equals a key without value.
    let [old, new] = [old, new].map(|v| v.filter(|v| !v.is_null()));
    match (old, new) {
        (Some(Value::Object(a)), Some(Value::Object(b))) => {
            let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
            names.sort();
            names.dedup();
            for name in names {
                let key = if at.is_empty() { name.clone() } else { format!("{at}.{name}") };
                collect(&key, a.get(name), b.get(name), keys);
            }
        }
        (Some(Value::Array(a)), Some(Value::Array(b))) if list_of_tables(a) || list_of_tables(b) => {
            for i in 0..a.len().max(b.len()) {
                collect(&format!("{at}[{i}]"), a.get(i), b.get(i), keys);
            }
        }
        (a, b) if a != b => keys.push(at.to_owned()),
        _ => {}
    }
}

fn list_of_tables(list: &[Value]) -> bool {
    list.first().is_some_and(Value::is_object)
}

/// Whether a run that started with stage `first` and was saved at `point` can be resumed with another value of `key`.
pub(super) fn may_change(key: &str, first: usize, point: Option<&Point>, scene: &Scene) -> bool {
    let section = key.split(['.', '[']).next().unwrap_or(key);
    if ["name", "title", "output", "ranks"].contains(&section) {
        return true;
    }
    // The remedy where a grid wears out during a stage.
    if key == "mesh.regrid" || key.starts_with("mesh.regrid.") {
        return true;
    }
    let Some(rest) = key.strip_prefix("stage[") else { return false };
    let Some((number, rest)) = rest.split_once(']') else { return false };
    let Ok(stage) = number.parse::<usize>() else { return false };
    // The current stage; later stages have not started.
    let now = point.map_or(first, |p| p.stage);
    let begun = point.is_some();
    if stage != now {
        return stage > now;
    }
    let longer = || {
        let at = point.map_or(0.0, |p| p.seal.time_s);
        scene.stages.get(stage).is_some_and(|s| s.duration_s >= at * (1.0 - 1e-9))
    };
    !begun || (rest == ".duration_s" && longer())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn changed_keys_are_named_by_their_path() {
        let old = json!({"name": "a", "fabric": {"e": 1.0, "gone": null}, "stage": [{"w": 1}, {"w": 2}]});
        let new = json!({"name": "a", "fabric": {"e": 2.0}, "stage": [{"w": 1}, {"w": 3}, {"w": 4}], "more": [1, 2]});
        assert_eq!(changes(&old, &new), ["fabric.e", "more", "stage[1].w", "stage[2]"]);
        assert!(changes(&old, &old).is_empty());
    }

    #[test]
    fn regridding_may_change_and_other_keys_of_the_mesh_may_not() {
        let text = include_str!("../../../../cases/square-drop/scene.toml");
        let scene = case::parse(std::path::Path::new("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"));
        for (key, expected) in [
            ("mesh.regrid", true),
            ("mesh.regrid.step", true),
            ("mesh.min_quality", false),
            ("mesh.regridded", false),
        ] {
            assert_eq!(may_change(key, 0, None, &scene), expected, "{key}");
        }
    }
}
