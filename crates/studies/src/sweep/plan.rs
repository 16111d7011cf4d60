//! The runs of a sweep: the values of each key, and their combinations.

use std::collections::BTreeSet;
use std::str::FromStr;

use coupling::error::RunError;

use crate::key::key_of;

/// Longest name of a folder.
const LONGEST: usize = 80;

/// Values of a key: `KEY=V1,V2,...`, or `KEY=FROM..TO:N` for N values in equal steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Variation {
    /// Dotted key, as that of `--set`.
    pub key: String,
    /// Values as text.
    pub values: Vec<String>,
}

impl FromStr for Variation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = "write KEY=V1,V2,... or KEY=FROM..TO:N, such as fabric.poisson_ratio=0.15,0.3 or \
                    descent.payload_mass_kg=90..200:5";
        let (key, values) = text.split_once('=').ok_or(help)?;
        let (key, values) = (key.trim(), values.trim());
        if key.is_empty() || values.is_empty() {
            return Err(help.into());
        }
        let values = match range(values) {
            Some(values) => values?,
            None => split(values),
        };
        if values.iter().any(String::is_empty) {
            return Err(format!("a value of `{key}` is empty; {help}"));
        }
        Ok(Self { key: key.into(), values })
    }
}

/// Values of `FROM..TO:N`; `None`: another text.
fn range(text: &str) -> Option<Result<Vec<String>, String>> {
    let (ends, count) = text.rsplit_once(':')?;
    let (from, to) = ends.split_once("..")?;
    let (from, to): (f64, f64) = (from.trim().parse().ok()?, to.trim().parse().ok()?);
    let Some(count) = count.trim().parse::<u32>().ok().filter(|n| (2..=1000).contains(n)) else {
        return Some(Err(format!("`{text}` has no number of values between 2 and 1000 after the colon")));
    };
    let last = f64::from(count - 1);
    let at = |i: u32| (from * (last - f64::from(i)) + to * f64::from(i)) / last;
    // Twelve digits: the value that was meant, without the round-off of the division.
    let shown = |v: f64| format!("{:.11e}", v).parse().map_or_else(|_| v.to_string(), |v: f64| v.to_string());
    Some(Ok((0..count).map(|i| shown(at(i))).collect()))
}

/// Parts of `text` between the commas that are in no bracket and no quotes.
fn split(text: &str) -> Vec<String> {
    let (mut depth, mut quoted) = (0i32, false);
    let mut parts = vec![String::new()];
    for c in text.chars() {
        match c {
            '"' => quoted = !quoted,
            '[' | '{' if !quoted => depth += 1,
            ']' | '}' if !quoted => depth -= 1,
            _ => {}
        }
        if c == ',' && depth == 0 && !quoted {
            parts.push(String::new());
        } else {
            parts.last_mut().expect("one at least").push(c);
        }
    }
    parts.into_iter().map(|p| p.trim().to_owned()).collect()
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Name of its folder.
    pub name: String,
    /// Value of each varied key, in the order of the variations.
    pub values: Vec<String>,
}

impl Point {
    /// The settings of the run, `KEY=VALUE`.
    pub fn settings<'a>(&'a self, variations: &'a [Variation]) -> impl Iterator<Item = String> + 'a {
        variations.iter().zip(&self.values).map(|(v, value)| format!("{}={value}", v.key))
    }
}

/// The runs of all combinations of values; `together`: one run for each position in the lists.
///
/// # Errors
/// [`RunError::Input`]: a key twice, lists of unequal length, the same values twice.
pub fn points(variations: &[Variation], together: bool) -> Result<Vec<Point>, RunError> {
    let wrong = |text: String| Err(RunError::Input(format!("--vary: {text}")));
    let keys: BTreeSet<&str> = variations.iter().map(|v| v.key.as_str()).collect();
    if keys.len() < variations.len() {
        return wrong("a key is given twice; list all of its values in one --vary".into());
    }
    let lengths: Vec<usize> = variations.iter().map(|v| v.values.len()).collect();
    let rows: Vec<Vec<String>> = if together {
        if lengths.iter().any(|n| *n != lengths[0]) {
            return wrong(format!("--together needs as many values of each key; there are {lengths:?}"));
        }
        (0..lengths.first().copied().unwrap_or(0))
            .map(|i| variations.iter().map(|v| v.values[i].clone()).collect())
            .collect()
    } else {
        variations.iter().fold(vec![Vec::new()], |rows: Vec<Vec<String>>, v| {
            let with = |row: &Vec<String>, value: &String| [row.clone(), vec![value.clone()]].concat();
            rows.iter().flat_map(|row| v.values.iter().map(move |value| with(row, value))).collect()
        })
    };
    let points: Vec<Point> =
        rows.into_iter().map(|values| Point { name: name(variations, &values), values }).collect();
    let names: BTreeSet<&str> = points.iter().map(|p| p.name.as_str()).collect();
    if names.len() < points.len() {
        return wrong("two runs have the same values".into());
    }
    Ok(points)
}

/// Name of the folder of a run: the last parts of its keys with their values, whole keys where those are equal.
fn name(variations: &[Variation], values: &[String]) -> String {
    let short = |v: &Variation| v.key.rsplit('.').next().unwrap_or_default().to_owned();
    let shared = |v: &Variation| variations.iter().filter(|w| short(w) == short(v)).count() > 1;
    let parts = variations.iter().zip(values).map(|(v, value)| {
        let key = if shared(v) { v.key.clone() } else { short(v) };
        format!("{key}={value}")
    });
    let whole = parts.collect::<Vec<_>>().join(",");
    let kept = |c: char| if c.is_ascii_alphanumeric() || "._=,+-".contains(c) { c } else { '_' };
    let safe: String = whole.chars().map(kept).collect();
    if safe == whole && safe.len() <= LONGEST {
        return safe;
    }
    let start: String = safe.chars().take(LONGEST - 9).collect();
    format!("{start}-{}", &key_of(&whole)[..8])
}

/// A share of the runs of a sweep: the `number`-th of `count`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    number: usize,
    count: usize,
}

impl Part {
    /// All runs.
    pub const ALL: Self = Self { number: 1, count: 1 };

    /// Whether the run at this position is one of the part.
    pub fn contains(self, at: usize) -> bool {
        at % self.count == self.number - 1
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let help = "write K/N with 1 <= K <= N, such as 3/10";
        let (number, count) = text.split_once('/').ok_or(help)?;
        let (number, count): (usize, usize) =
            (number.trim().parse().map_err(|_| help)?, count.trim().parse().map_err(|_| help)?);
        if number == 0 || number > count {
            return Err(help.into());
        }
        Ok(Self { number, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variations(texts: &[&str]) -> Vec<Variation> {
        texts.iter().map(|t| t.parse().expect("a variation")).collect()
    }

    #[test]
    fn values_are_lists_or_ranges() {
        let values = |text: &str| text.parse::<Variation>().map(|v| v.values);
        assert_eq!(values("a.b=1, 2.5,x").unwrap(), ["1", "2.5", "x"]);
        assert_eq!(values("a=[1,2],[3,4]").unwrap(), ["[1,2]", "[3,4]"]);
        assert_eq!(values("a={x=1,y=2}, \"u,v\"").unwrap(), ["{x=1,y=2}", "\"u,v\""]);
        assert_eq!(values("m=90..200:5").unwrap(), ["90", "117.5", "145", "172.5", "200"]);
        assert_eq!(values("m=0.1..0.3:3").unwrap(), ["0.1", "0.2", "0.3"]);
        assert_eq!(values("m=-1..1:3").unwrap(), ["-1", "0", "1"]);
        for wrong in ["a", "=1", "a=", "a=1,,2", "a=0..1:1", "a=0..1:x"] {
            assert!(wrong.parse::<Variation>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn runs_are_all_combinations_or_positions() {
        let two = variations(&["fabric.poisson_ratio=0.15,0.3", "stage.descent.window_s=5e-3,1e-2"]);
        let all = points(&two, false).unwrap();
        let names: Vec<&str> = all.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names[0], "poisson_ratio=0.15,window_s=5e-3");
        assert_eq!(names[1], "poisson_ratio=0.15,window_s=1e-2");
        assert_eq!(names.len(), 4);
        let settings: Vec<String> = all[3].settings(&two).collect();
        assert_eq!(settings, ["fabric.poisson_ratio=0.3", "stage.descent.window_s=1e-2"]);
        assert_eq!(points(&two, true).unwrap().len(), 2);
        let unequal = variations(&["a=1,2", "b=1"]);
        assert!(points(&unequal, true).is_err() && points(&unequal, false).is_ok());
        assert!(points(&variations(&["a=1", "a=2"]), false).is_err());
        assert!(points(&variations(&["a=1,1"]), false).is_err());
    }

    #[test]
    fn names_of_folders_are_unique_and_short() {
        let equal = variations(&["stage.a.window_s=1", "stage.b.window_s=2"]);
        assert_eq!(points(&equal, false).unwrap()[0].name, "stage.a.window_s=1,stage.b.window_s=2");
        let odd = points(&variations(&["flow.wind_m_s=[1,0,0],[1,0,1]"]), false).unwrap();
        assert!(odd[0].name.starts_with("wind_m_s=_1,0,0_-") && odd[0].name != odd[1].name, "{odd:?}");
        let long = points(&variations(&[&format!("a={},b", "x".repeat(300))]), false).unwrap();
        assert!(long[0].name.len() <= LONGEST);
    }

    #[test]
    fn parts_share_all_runs() {
        let parts: Vec<Part> = ["1/3", "2/3", "3/3"].map(|t| t.parse().unwrap()).to_vec();
        assert!((0..20).all(|at| parts.iter().filter(|p| p.contains(at)).count() == 1));
        assert!((0..5).all(|at| Part::ALL.contains(at)));
        for wrong in ["0/3", "4/3", "3", "a/b"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }
}
