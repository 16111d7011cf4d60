//! The estimate of each effect: its change, its promise and its figures, worked out by hand.
//!
//! `effect_estimates.txt` is the table.

use coupling::interface::CanopyInterface;
use effects::estimate::Scope;
use effects::numbers::Numbers;
use effects::rank::Ranking;
use effects::table::TABLE;

mod changes;

const ROWS: &str = include_str!("effect_estimates.txt");

/// A row of the table.
struct Row {
    key: &'static str,
    changes: Vec<&'static str>,
    /// Changes of speed, drag and tension that are known by hand.
    change: Vec<(usize, f64)>,
    /// `5 either` or `3 signed`; empty where nothing is estimated.
    promise: &'static str,
    /// Part of the reason.
    why: &'static str,
}

fn rows() -> Vec<Row> {
    let lines = ROWS.lines().filter(|l| !l.is_empty() && !l.starts_with('#'));
    lines
        .map(|line| {
            let parts: Vec<&str> = line.split(" | ").collect();
            let [key, changes, change, promise, why] = parts[..] else { panic!("five columns: {line}") };
            let absent = |text: &'static str| if text == "-" { "" } else { text };
            let number = |word: &str| {
                let (name, value) = word.split_once(' ').expect("a quantity and its change");
                let at = ["speed", "drag", "tension"].iter().position(|q| *q == name).expect("a quantity");
                (at, value.parse().expect("a number"))
            };
            Row {
                key,
                changes: changes.split("; ").collect(),
                change: absent(change).split(", ").filter(|w| !w.is_empty()).map(number).collect(),
                promise: absent(promise),
                why: absent(why),
            }
        })
        .collect()
}

/// `tunnel`: `square-drop` held in a wind of 4 m/s, where a change of the drag area is that of the drag. `fall`: it
/// falls for 1000 s, so that its speed is steady. `reinforced`: the ATPS in a tunnel.
fn settings(row: &Row) -> (&'static str, Vec<(&'static str, &'static str)>) {
    let mut case = "square-drop";
    let mut settings = Vec::new();
    for change in &row.changes {
        match *change {
            "tunnel" => settings.extend([("descent", ""), ("flow.wind_m_s", "[0,0,4]")]),
            "fall" => settings.push(("stage.descent.duration_s", "1000")),
            "reinforced" => {
                case = "atps-descent";
                settings.extend([("descent", ""), ("flow.wind_m_s", "[0,0,4.8768]")]);
            }
            "cases/square-drop" => {}
            pair => settings.push(pair.split_once('=').expect("KEY=VALUE")),
        }
    }
    (case, settings)
}

/// What the estimate is, if it is not that of the row.
fn missed(row: &Row) -> Option<String> {
    let (case, settings) = settings(row);
    let scene = match changes::changed(case, &settings) {
        Ok(scene) => scene,
        Err(why) => return Some(format!("{} of {:?}: {why}", row.key, row.changes)),
    };
    let interface = CanopyInterface::new(&scene).expect("a canopy");
    let mesh = mesh::structure_mesh(&scene).expect("a mesh");
    let n = Numbers::new(&scene, &interface, &mesh);
    let ranking = Ranking::new(&Scope::new(&n, scene.stages.len() - 1, None));
    if let Some(u) = ranking.unknown.iter().find(|u| u.entry.key == row.key) {
        let right = row.promise.is_empty() && row.change.is_empty() && u.why.contains(row.why);
        return (!right).then(|| format!("{} of {:?}: not estimated, {}", row.key, row.changes, u.why));
    }
    let Some(ranked) = ranking.find(row.key) else { return Some(format!("{} is not judged", row.key)) };
    let e = &ranked.estimate;
    let promise = format!("{} {}", e.factor, if e.signed { "signed" } else { "either" });
    // Figures by hand have four digits.
    let close = |(at, value): &(usize, f64)| {
        e.changes[*at].is_some_and(|a| (a.value - value).abs() <= 2e-4 * value.abs() + 1e-9)
    };
    let right = promise == row.promise && row.change.iter().all(close) && e.why.contains(row.why);
    let found = e.changes.map(|c| c.map(|a| a.value));
    (!right).then(|| format!("{} of {:?}: {found:?}, {promise}, {}", row.key, row.changes, e.why))
}

#[test]
fn estimates_are_those_worked_out_by_hand() {
    let wrong: Vec<String> = rows().iter().filter_map(missed).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// No effect that can be estimated without a row.
#[test]
fn every_effect_is_in_the_table() {
    for e in TABLE {
        assert!(rows().iter().any(|r| r.key == e.key), "{} has no row", e.key);
    }
}

/// A promise within a factor of 3, either way, of -16.57093 %; the added mass changes nothing in a steady wind.
#[test]
fn a_promise_spans_its_factor_on_both_sides() {
    let row = rows().into_iter().find(|r| r.key == "reefing").expect("a row");
    let (case, settings) = settings(&row);
    let scene = changes::changed(case, &settings).expect("a scene");
    let interface = CanopyInterface::new(&scene).expect("a canopy");
    let mesh = mesh::structure_mesh(&scene).expect("a mesh");
    let n = Numbers::new(&scene, &interface, &mesh);
    let ranking = Ranking::new(&Scope::new(&n, scene.stages.len() - 1, None));
    let drag = ranking.find("reefing").expect("judged").estimate.changes[1].expect("a drag");
    let opposite = drag.opposite.expect("either way");
    for (found, by_hand) in [(drag.range, [-0.4971279, -0.0552364]), (opposite, [0.0552364, 0.4971279])] {
        assert!(found.iter().zip(by_hand).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} of {by_hand:?}");
    }
}
