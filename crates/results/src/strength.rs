//! Safety factors of fabric, lines, risers and tapes in a stage: strength over largest load, from its `history.csv`.

use case::{Scene, TapePlace};
use serde::{Deserialize, Serialize};

/// Check of the table that this is.
const CHECK: &str = "strength.safety-factor";

/// Strength of a part of the parachute over its largest load in a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SafetyFactor {
    /// Section of the scene: `fabric`, `lines`, `risers`, `tapes.hem`, `tapes.seams`, `tapes.vents` or `tapes.grid`.
    pub part: String,
    /// Largest tension or membrane force at the end of a window, in `unit`. Of a riser: the vertical force of all risers over their number,
    /// which the largest tension of a riser exceeds. Of the fabric: that of one element, which grows at corners and lines as elements shrink.
    pub load: f64,
    /// Strength by the scene, in `unit`; 1 where `load` is a share of it.
    pub strength: f64,
    /// `N`, or `N/m` of the fabric; `1` where groups of a mesh file have strengths of their own: the load is the largest share of the strength of its cloth.
    pub unit: String,
    /// Time of the largest load from the start of the stage, s.
    pub time_s: f64,
    /// Strength over load; of risers an upper bound.
    pub factor: f64,
    /// Of the fabric: strength over the largest membrane force in the history that 99 % of the area does not exceed.
    pub factor_99: Option<f64>,
    /// `safety_factor` of the scene; `None` where it has none.
    pub required: Option<f64>,
}

/// Column of the largest tension of the tapes at a place.
fn tape_tension(place: TapePlace) -> &'static str {
    match place {
        TapePlace::Hem => "max_hem_tape_tension_n",
        TapePlace::Seams => "max_seam_tape_tension_n",
        TapePlace::Vents => "max_vent_tape_tension_n",
        TapePlace::Grid => "max_grid_tape_tension_n",
    }
}

/// Time and value of the largest positive value of `column`.
fn largest(columns: &[(String, Vec<f64>)], column: &str) -> Option<(f64, f64)> {
    let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| values.iter());
    let rows = get("time_s")?.zip(get(column)?).map(|(time, value)| (*time, *value));
    let loaded = rows.filter(|(_, value)| value.is_finite() && *value > 0.0);
    loaded.fold(None, |most: Option<(f64, f64)>, row| Some(most.filter(|m| m.1 >= row.1).unwrap_or(row)))
}

impl SafetyFactor {
    /// Of fabric, lines, risers and tapes whose strength the scene has, from the columns of a history. `risers` is their number. A part that is slack
    /// throughout has none, nor has a fabric whose program reports no membrane force.
    pub fn of(scene: &Scene, risers: usize, columns: &[(String, Vec<f64>)]) -> Vec<Self> {
        let factor = |part: &str, strength: Option<f64>, required, column, share: f64| {
            let (strength, (time_s, force)) = (strength?, largest(columns, column)?);
            let load = force / share;
            let factor = strength / load;
            let (part, unit) = (part.into(), "N".into());
            Some(Self { part, load, strength, unit, time_s, factor, factor_99: None, required })
        };
        let fabric = &scene.fabric;
        let (strength, unit, [peak, most]) = if scene.has_strengths_by_group() {
            (Some(1.0), "1", ["membrane_force_over_strength", "membrane_force_over_strength_99"])
        } else {
            (fabric.strength_n_m, "N/m", ["max_membrane_force_n_m", "membrane_force_99_n_m"])
        };
        let fabric = factor("fabric", strength, fabric.safety_factor, peak, 1.0).map(|f| {
            let factor_99 = largest(columns, most).map(|(_, load)| f.strength / load);
            Self { unit: unit.into(), factor_99, ..f }
        });
        let lines = scene.lines.as_ref();
        let lines =
            lines.and_then(|l| factor("lines", l.strength_n, l.safety_factor, "max_line_tension_n", 1.0));
        let own = scene.risers.as_ref().filter(|_| risers > 0);
        let own =
            own.and_then(|r| factor("risers", r.strength_n, r.safety_factor, "riser_force_n", risers as f64));
        let tapes = scene.tapes.iter().flat_map(|t| t.places()).filter_map(|(place, t)| {
            let part = format!("tapes.{}", place.name());
            factor(&part, t.strength_n, t.safety_factor, tape_tension(place), 1.0)
        });
        fabric.into_iter().chain(lines).chain(own).chain(tapes).collect()
    }

    /// The smallest factor of each part among all stages, with the name of its stage; the smallest of all first.
    pub fn smallest(all: impl Iterator<Item = (String, Self)>) -> Vec<(String, Self)> {
        let mut all: Vec<_> = all.collect();
        all.sort_by(|a, b| a.1.factor.total_cmp(&b.1.factor));
        let mut seen = Vec::new();
        all.retain(|(_, f)| {
            let new = !seen.contains(&f.part);
            seen.push(f.part.clone());
            new
        });
        all
    }

    /// Factor and loads in words.
    pub fn line(&self) -> String {
        let (each, bound) = if self.part == "risers" { ("at least ", "at most ") } else { ("", "") };
        let of = if self.part == "fabric" { "membrane force" } else { "tension" };
        let required = self.required.filter(|required| self.factor < *required);
        let below = required.map_or(String::new(), |required| format!(", below the required {required}"));
        let most =
            self.factor_99.map_or(String::new(), |f| format!("; 99 % of its area has at least {f:.2}"));
        if self.unit == "1" {
            return format!(
                "safety factor of {} {:.2}{below}: largest {of} {:.1} % of the strength of its cloth at {:.4} s{most}",
                self.part,
                self.factor,
                100.0 * self.load,
                self.time_s
            );
        }
        format!(
            "safety factor of {} {bound}{:.2}{below}: largest {of} {each}{:.1} {unit} at {:.4} s, strength {:.1} {unit}{most}",
            self.part,
            self.factor,
            self.load,
            self.time_s,
            self.strength,
            unit = self.unit
        )
    }

    /// The warning of a part that carries more than its strength in a stage.
    pub fn warning(&self, stage: &str) -> Option<String> {
        let of = match self.unit.as_str() {
            "1" => "[fabric] or its group of [[canopy.fabric]]".into(),
            _ => format!("[{}]", self.part),
        };
        let more = match self.part.as_str() {
            "fabric" => "reinforcement by [tapes]",
            "lines" | "risers" => "more lines",
            _ => "more gores and lines",
        };
        (self.factor < 1.0).then(|| {
            format!(
                "stage `{stage}`: {} [{CHECK}]. Nothing breaks in the run. Remedy: choose a stronger material for {of}, {more}, or a slower \
                 opening",
                self.line()
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
        assert_eq!((risers.load, risers.factor, risers.time_s), (300.0, 3.0, 0.3));
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

    /// The seams carry 1 000 of 1 200 N at 0.3 s: 1.2. The hem has no strength, the vents no tension.
    #[test]
    fn tapes_have_a_factor_at_each_place() {
        let text = include_str!("../../../cases/atps-descent/scene.toml");
        let section = "axial_stiffness_n = 1e4\nmass_kg_m = 0.01\n";
        let tapes = format!(
            "[tapes.hem]\n{section}[tapes.seams]\n{section}strength_n = 1200.0\nsafety_factor = 2.0\n\
             [tapes.vents]\n{section}strength_n = 900.0\n[structure]"
        );
        let scene = case::parse(Path::new("scene.toml"), &text.replacen("[structure]", &tapes, 1))
            .unwrap_or_else(|e| panic!("{e}"));
        let column = |name: &str, values: [f64; 3]| (name.to_owned(), values.to_vec());
        let history = [
            column("time_s", [0.1, 0.2, 0.3]),
            column(tape_tension(TapePlace::Hem), [9e9; 3]),
            column(tape_tension(TapePlace::Seams), [10.0, 900.0, 1000.0]),
            column(tape_tension(TapePlace::Vents), [0.0; 3]),
        ];
        let found = SafetyFactor::of(&scene, 4, &history);
        let [seams] = &found[..] else { panic!("{found:?}") };
        let line = "safety factor of tapes.seams 1.20, below the required 2: largest tension 1000.0 N at 0.3000 s, strength 1200.0 N";
        assert_eq!((seams.line().as_str(), seams.warning("descent")), (line, None));
        let torn = SafetyFactor { factor: 0.9, ..seams.clone() }.warning("opening").expect("a warning");
        assert!(torn.contains("stronger material for [tapes.seams]"), "{torn}");
    }

    #[test]
    fn parts_without_strength_or_load_have_none() {
        let columns = columns([0.0; 3], [0.0; 3]);
        assert_eq!(SafetyFactor::of(&scene("strength_n = 249.0", RISERS), 4, &columns), []);
        assert_eq!(SafetyFactor::of(&scene("", RISERS), 4, &self::columns([9.0; 3], [9.0; 3])), []);
        // A stage without structure has no such columns.
        assert_eq!(SafetyFactor::of(&scene("strength_n = 249.0", RISERS), 4, &columns[..1]), []);
    }

    /// 4 000 of 7 000 N/m at 0.2 s: 1.75; 99 % of the area has at most 1 000 N/m: 7.
    #[test]
    fn fabric_has_a_factor_of_its_peak_and_of_its_area() {
        let text = include_str!("../../../cases/atps-descent/scene.toml");
        let text = text.replacen("[fabric]", "[fabric]\nstrength_n_m = 7000.0\nsafety_factor = 2.0", 1);
        let scene = case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
        let history = |peak: [f64; 3], most: [f64; 3]| {
            let named = |name: &str, values: [f64; 3]| (name.to_owned(), values.to_vec());
            vec![
                named("time_s", [0.1, 0.2, 0.3]),
                named("max_membrane_force_n_m", peak),
                named("membrane_force_99_n_m", most),
            ]
        };
        let found = SafetyFactor::of(&scene, 4, &history([10.0, 4000.0, 90.0], [5.0, 900.0, 1000.0]));
        let [fabric] = &found[..] else { panic!("{found:?}") };
        assert_eq!(
            fabric.line(),
            "safety factor of fabric 1.75, below the required 2: largest membrane force 4000.0 N/m at 0.2000 s, strength 7000.0 N/m; 99 % of \
             its area has at least 7.00"
        );
        assert_eq!(fabric.warning("descent"), None);
        let found = SafetyFactor::of(&scene, 4, &history([10.0, 7001.0, 90.0], [5.0, 900.0, 1000.0]));
        let text = found[0].warning("descent").expect("a warning");
        assert!(text.contains("stronger material for [fabric], reinforcement by [tapes]"), "{text}");
        // A program that reports none.
        assert_eq!(SafetyFactor::of(&scene, 4, &history([0.0; 3], [0.0; 3])), []);
    }

    /// The weakest cloth carries half of its strength at 0.2 s, 99 % of the area a quarter of its own.
    #[test]
    fn fabric_of_several_strengths_has_the_factor_of_the_weakest_cloth() {
        let text = include_str!("../../../cases/atps-descent/scene.toml");
        let text = text.replacen("[fabric]", "[fabric]\nstrength_n_m = 7000.0", 1);
        let mut scene = case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
        let crown = case::FabricGroup { strength_n_m: Some(9000.0), ..case::FabricGroup::default() };
        let file = "any.msh".into();
        scene.canopy =
            case::Canopy::Gmsh(case::GmshCanopy { file, cables: Vec::new(), fabrics: vec![crown] });
        let named = |name: &str, values: [f64; 3]| (name.to_owned(), values.to_vec());
        let history = [
            named("time_s", [0.1, 0.2, 0.3]),
            named("max_membrane_force_n_m", [4000.0; 3]),
            named("membrane_force_over_strength", [0.1, 0.5, 0.3]),
            named("membrane_force_over_strength_99", [0.1, 0.2, 0.25]),
        ];
        let found = SafetyFactor::of(&scene, 4, &history);
        let [fabric] = &found[..] else { panic!("{found:?}") };
        assert_eq!((fabric.factor, fabric.factor_99, fabric.time_s), (2.0, Some(4.0), 0.2));
        assert_eq!(
            fabric.line(),
            "safety factor of fabric 2.00: largest membrane force 50.0 % of the strength of its cloth at 0.2000 s; 99 % of its area has at \
             least 4.00"
        );
        let torn = SafetyFactor { factor: 0.9, ..fabric.clone() }.warning("opening").expect("a warning");
        assert!(
            torn.contains("stronger material for [fabric] or its group of [[canopy.fabric]], "),
            "{torn}"
        );
        // A structure that does not report it.
        assert_eq!(SafetyFactor::of(&scene, 4, &history[..2]), []);
    }
}
