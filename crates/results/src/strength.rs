//! Safety factors of lines and risers in a stage: strength over largest tension, from its `history.csv`.

use case::Scene;
use serde::{Deserialize, Serialize};

/// Check of the table that this is.
const CHECK: &str = "strength.safety-factor";

/// Strength of a part of the parachute over its largest tension in a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SafetyFactor {
    /// `lines` or `risers`.
    pub part: String,
    /// Largest tension at the end of a window, N. Of a riser: the vertical force of all risers over their number, which the largest tension
    /// of a riser exceeds.
    pub tension_n: f64,
    /// Time of it from the start of the stage, s.
    pub time_s: f64,
    /// Strength by the scene, N.
    pub strength_n: f64,
    /// Strength over tension; of risers an upper bound.
    pub factor: f64,
    /// `safety_factor` of the scene; `None` where it has none.
    pub required: Option<f64>,
}

impl SafetyFactor {
    /// Of lines and risers whose strength the scene has, from the columns of a history. `risers` is their number. A part that is slack
    /// throughout has none.
    pub fn of(scene: &Scene, risers: usize, columns: &[(String, Vec<f64>)]) -> Vec<Self> {
        let largest = |column: &str| {
            let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| values.iter());
            let rows = get("time_s")?.zip(get(column)?).map(|(time, value)| (*time, *value));
            let pulled = rows.filter(|(_, value)| value.is_finite() && *value > 0.0);
            pulled.fold(None, |most: Option<(f64, f64)>, row| {
                Some(most.filter(|m| m.1 >= row.1).unwrap_or(row))
            })
        };
        let factor = |part: &str, strength: Option<f64>, required, column, share: f64| {
            let (strength_n, (time_s, force)) = (strength?, largest(column)?);
            let tension_n = force / share;
            let factor = strength_n / tension_n;
            Some(Self { part: part.into(), tension_n, time_s, strength_n, factor, required })
        };
        let lines = scene.lines.as_ref();
        let lines =
            lines.and_then(|l| factor("lines", l.strength_n, l.safety_factor, "max_line_tension_n", 1.0));
        let own = scene.risers.as_ref().filter(|_| risers > 0);
        let own =
            own.and_then(|r| factor("risers", r.strength_n, r.safety_factor, "riser_force_n", risers as f64));
        lines.into_iter().chain(own).collect()
    }

    /// Factor and loads in words.
    pub fn line(&self) -> String {
        let (each, bound) = if self.part == "risers" { ("at least ", "at most ") } else { ("", "") };
        let required = self.required.filter(|required| self.factor < *required);
        let below = required.map_or(String::new(), |required| format!(", below the required {required}"));
        format!(
            "safety factor of {} {bound}{:.2}{below}: largest tension {each}{:.1} N at {:.4} s, strength {:.1} N",
            self.part, self.factor, self.tension_n, self.time_s, self.strength_n
        )
    }

    /// The warning of a part that carries more than its strength in a stage.
    pub fn warning(&self, stage: &str) -> Option<String> {
        (self.factor < 1.0).then(|| {
            format!(
                "stage `{stage}`: {} [{CHECK}]. Nothing breaks in the run. Remedy: choose a stronger material for [{}], more lines, or a \
                 slower opening",
                self.line(),
                self.part
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn scene(lines: &str, risers: &str) -> Scene {
        let text = include_str!("../../../cases/atps-descent/scene.toml");
        let text = text.replacen("[structure]", &format!("{lines}\n[risers]\n{risers}\n[structure]"), 1);
        case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
    }

    fn columns(tension: [f64; 3], force: [f64; 3]) -> Vec<(String, Vec<f64>)> {
        let column = |name: &str, values: [f64; 3]| (name.to_owned(), values.to_vec());
        vec![
            column("time_s", [0.1, 0.2, 0.3]),
            column("max_line_tension_n", tension),
            column("riser_force_n", force),
        ]
    }

    const RISERS: &str = "axial_stiffness_n = 1e4\nmass_kg_m = 0.01\n";

    /// 250 N of 500 N at 0.2 s: factor 2. 4 risers share 1200 N at 0.3 s, of 900 N each: at most 3.
    #[test]
    fn factors_are_strength_over_largest_tension() {
        let strong = scene("strength_n = 500.0\nsafety_factor = 2.5", &format!("{RISERS}strength_n = 900.0"));
        let found = SafetyFactor::of(&strong, 4, &columns([100.0, 250.0, 90.0], [f64::NAN, -50.0, 1200.0]));
        let [lines, risers] = &found[..] else { panic!("{found:?}") };
        assert_eq!((lines.factor, lines.time_s, lines.required), (2.0, 0.2, Some(2.5)));
        assert_eq!((risers.tension_n, risers.factor, risers.time_s), (300.0, 3.0, 0.3));
        assert_eq!(
            lines.line(),
            "safety factor of lines 2.00, below the required 2.5: largest tension 250.0 N at 0.2000 s, strength 500.0 N"
        );
        assert_eq!(
            risers.line(),
            "safety factor of risers at most 3.00: largest tension at least 300.0 N at 0.3000 s, strength 900.0 N"
        );
        assert_eq!((lines.warning("descent"), risers.warning("descent")), (None, None));
    }

    #[test]
    fn load_above_the_strength_is_reported() {
        let weak = scene("strength_n = 249.0", RISERS);
        let found = SafetyFactor::of(&weak, 4, &columns([100.0, 250.0, 90.0], [0.0; 3]));
        let [lines] = &found[..] else { panic!("{found:?}") };
        let text = lines.warning("descent").expect("a warning");
        assert!(
            text.starts_with("stage `descent`: safety factor of lines 1.00: largest tension 250.0 N"),
            "{text}"
        );
        assert!(text.contains("[strength.safety-factor]") && text.contains("material for [lines]"), "{text}");
        // The strength itself is carried.
        let equal = scene("strength_n = 250.0", RISERS);
        let found = SafetyFactor::of(&equal, 4, &columns([100.0, 250.0, 90.0], [0.0; 3]));
        assert_eq!((found[0].factor, found[0].warning("descent")), (1.0, None));
    }

    #[test]
    fn parts_without_strength_or_load_have_none() {
        let columns = columns([0.0; 3], [0.0; 3]);
        assert_eq!(SafetyFactor::of(&scene("strength_n = 249.0", RISERS), 4, &columns), []);
        assert_eq!(SafetyFactor::of(&scene("", RISERS), 4, &self::columns([9.0; 3], [9.0; 3])), []);
        // A stage without structure has no such columns.
        assert_eq!(SafetyFactor::of(&scene("strength_n = 249.0", RISERS), 4, &columns[..1]), []);
    }
}
