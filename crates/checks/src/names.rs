//! Check of the names in a scene.

use super::facts::{Facts, FormerName};
use super::finding::Judged;
use super::finding::Severity::Warning;
use super::table::{Check, When};

/// The row.
pub const CHECKS: &[Check] = &[Check {
    id: "scene.former-names",
    what: "keys and values have their current names",
    estimate: "names in the file of the scene and in `--set`, compared with the table of former names",
    range: "warning for each former name",
    source: "a former name is accepted, and means the current one",
    severity: Warning,
    remedy: "write the current name",
    when: When::Before(former_names),
}];

fn former_names(facts: &Facts<'_>) -> Vec<Judged> {
    facts.former_names.iter().map(|n| Judged::new(Warning, n.key.clone(), n.text.clone())).collect()
}

/// The former names in the text of a scene and in values of `--set`, as the user wrote them (`KEY=VALUE`).
pub fn former(text: &str, settings: &[String]) -> Vec<FormerName> {
    let mut all: Vec<FormerName> =
        case::renamed(text).iter().map(|r| FormerName { key: r.key.clone(), text: r.sentence() }).collect();
    for (key, value) in settings.iter().filter_map(|s| s.split_once('=')) {
        let (key, value) = (key.trim(), value.trim().trim_matches('"'));
        let current = case::current_path(key);
        if current != key {
            all.push(FormerName { text: format!("key `{key}` is now `{current}`"), key: current });
        } else if let Some(new) = case::replacement(key) {
            all.push(FormerName { text: format!("key `{key}` is replaced by [{new}]"), key: current });
        } else if let Some(new) = case::current_value(key, value) {
            let text = format!("value `{key} = \"{value}\"` is now `\"{new}\"`");
            all.push(FormerName { key: current, text });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn former_names_are_found_in_file_and_options() {
        let settings = [
            "coupling.model_faces=40",
            "coupling.staggered.sequence=half-step",
            "coupling.staggered.sequence=added-mass",
            "mesh.min_quality=0.1",
        ]
        .map(String::from);
        let found = former("[coupling]\nload = \"mean\"\ntolerance = 1e-3\n", &settings);
        let texts: Vec<&str> = found.iter().map(|f| f.text.as_str()).collect();
        assert_eq!(
            texts,
            [
                "key `coupling.load` is now `coupling.load_interpolation`",
                "key `coupling.model_faces` is now `coupling.added_mass_max_panels`",
                "value `coupling.staggered.sequence = \"half-step\"` is now `\"improved-serial\"`",
            ]
        );
        assert_eq!(found[0].key, "coupling.load_interpolation");
    }
}
