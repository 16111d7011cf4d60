//! The table for people: `ripstop effects`, `docs/reference/effects.md`.

use std::fmt::Write as _;

use super::estimate::{Amount, RESOLUTION, Scope, percent};
use super::fall::{Motion, QUANTITIES};
use super::rank::{Ranked, Ranking, Verdict};
use super::table::TABLE;

/// The table as Markdown, a section for each effect.
pub fn markdown() -> String {
    let mut text = String::from("| effect | what | programs | estimated by |\n|---|---|---|---|\n");
    for e in TABLE {
        let _ = writeln!(text, "| `{}` | {} | {} | {} |", e.key, e.what, e.programs.join(", "), e.criterion);
    }
    for e in TABLE {
        let _ = write!(
            text,
            "\n### `{}`\n\n{}.\n\n- Model: {}\n- Equation: `{}`\n- Reference: {}\n- Programs: {}{}\n- Cost: {}\n",
            e.key,
            capital(e.what),
            e.model,
            e.equation,
            e.reference,
            e.programs.join(", "),
            e.announced_by.map_or(String::new(), |r| format!("; announced by the {}", r.name())),
            e.cost
        );
    }
    text
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// The table for a terminal.
pub fn table() -> String {
    let mut text = String::new();
    for e in TABLE {
        let _ = writeln!(
            text,
            "{}: {}\n  model      {}\n  equation   {}\n  reference  {}\n  programs   {}\n  estimate   {}\n  cost       {}",
            e.key,
            e.what,
            e.model,
            e.equation,
            e.reference,
            e.programs.join(", "),
            e.criterion,
            e.cost
        );
    }
    text.push_str("`ripstop effects SCENE` ranks them for a scene; with --measure it measures what each changes and costs.");
    text
}

/// The effects of a scene in the order of what they change in its answer, line by line.
pub fn ranking(scope: &Scope<'_>) -> Vec<String> {
    let (scene, n) = (scope.scene(), scope.n);
    let mut lines = vec![scene.caption()];
    lines.push(format!(
        "stream {:.3} m/s (Mach {:.4}), Reynolds number {:.2e}, dynamic pressure {:.2} Pa, pressure jump {:.2} Pa",
        n.speed, n.mach, n.reynolds, n.dynamic_pressure, n.pressure
    ));
    lines.push(answer(scope));
    let ranking = Ranking::new(scope);
    for (verdict, title) in [
        (Verdict::Matters, "effects that matter (1 % of the answer or more), the largest first:"),
        (Verdict::MayMatter, "effects that may matter (the estimate does not exclude 1 %):"),
        (Verdict::Negligible, "effects that do not matter:"),
    ] {
        let of = ranking.ranked.iter().filter(|r| r.verdict == verdict);
        let texts: Vec<String> = of.map(block).collect();
        if !texts.is_empty() {
            lines.push(title.into());
            lines.extend(texts);
        }
    }
    lines.push("not assessed:".into());
    lines.extend(ranking.unknown.iter().map(|u| format!("  {:<42} {}: {}", u.entry.key, state(u.on), u.why)));
    lines
}

fn answer(scope: &Scope<'_>) -> String {
    let (fall, stage) = (&scope.fall, &scope.scene().stages[scope.stage]);
    let half = if fall.time > 0.0 {
        format!("means over {} to {} s of stage `{}`", 0.5 * fall.time, fall.time, stage.name)
    } else {
        format!("stage `{}` at its end", stage.name)
    };
    let how = match fall.motion {
        Motion::Falls => {
            format!(
                "the descent responds within {:.2} s: the speed has changed by {} of what it will in a steady descent",
                fall.response_time(),
                percent(fall.speed_response())
            )
        }
        Motion::Given => "the speed of the air is given: changes are at a fixed speed".into(),
        Motion::NoAir => "no air: drag is the vertical load of the given pressure".into(),
    };
    format!(
        "answer: {half}; {how}; changes are those with the effect over without it (least to largest), to {}",
        percent(RESOLUTION)
    )
}

fn state(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

fn block(r: &Ranked) -> String {
    let e = r.entry;
    let changes: Vec<String> = QUANTITIES
        .iter()
        .zip(&r.estimate.changes)
        .filter_map(|(name, a)| Some(format!("{name} {}", change(&(*a)?, r.estimate.signed))))
        .collect();
    let mut text = format!("  {:<42} {}, {}: {}", e.key, state(r.on), r.advice(), changes.join(", "));
    if let Some(by) = r.by {
        let _ = write!(text, "\n      judged with {by}, which needs it");
    }
    if let (false, Some(needs)) = (r.on, e.needs) {
        let _ = write!(text, "\n      needs {needs}");
    }
    if let Some(why) = &r.obstacle {
        let _ = write!(text, "\n      cannot be switched {} here: {why}", if r.on { "off" } else { "on" });
    }
    let _ = write!(text, "\n      within a factor of {}: {}", r.estimate.factor, r.estimate.why);
    if r.verdict != Verdict::Negligible {
        let _ =
            write!(text, "\n      model: {}\n      cost: {} ({})", e.model, e.cost, e.programs.join(", "));
    }
    text
}

/// An estimated change for people, with its range.
pub fn change(a: &Amount, signed: bool) -> String {
    let [low, high] = a.range;
    if signed {
        return format!("{:+.2} % ({:+.2} to {:+.2})", 100.0 * a.value, 100.0 * low, 100.0 * high);
    }
    format!("{:.2} % ({:.2} to {:.2})", 100.0 * a.value.abs(), 100.0 * a.least(), 100.0 * a.most())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::Numbers;

    const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/effects.md");
    const BEGIN: &str = "<!-- made from crates/effects/src/table.rs: begin -->\n";
    const END: &str = "<!-- made from crates/effects/src/table.rs: end -->\n";

    /// After a change: `RIPSTOP_WRITE_DOCS=1 cargo test --release -p effects the_document`.
    #[test]
    fn the_document_is_the_table() {
        let text = std::fs::read_to_string(DOCUMENT).expect("docs/reference/effects.md");
        let (head, rest) = text.split_once(BEGIN).expect("the begin of the table");
        let (old, tail) = rest.split_once(END).expect("the end of the table");
        let new = format!("\n{}\n", markdown());
        if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
            std::fs::write(DOCUMENT, format!("{head}{BEGIN}{new}{END}{tail}")).expect("written");
        } else {
            assert!(
                old == new,
                "docs/reference/effects.md differs from the table: see the comment of this test"
            );
        }
    }

    #[test]
    fn every_effect_is_described_in_full_and_once() {
        for (i, e) in TABLE.iter().enumerate() {
            assert!(TABLE[..i].iter().all(|o| o.key != e.key), "{} twice", e.key);
            for part in [e.what, e.model, e.equation, e.reference, e.criterion, e.cost] {
                assert!(!part.is_empty(), "{}", e.key);
            }
            assert!(!e.programs.is_empty(), "{}", e.key);
            if let Some(role) = e.announced_by {
                assert!(e.programs.contains(&role.program()), "{}", e.key);
            }
        }
    }

    /// The judgements that a person would make of the paper's parachute: its areal weight is 2.51 % of the
    /// pressure by hand, and the weight that the lines no longer carry is that of 5.24 kg of fabric and of half the
    /// lines among 106.6 kg.
    #[test]
    fn the_paper_parachute_is_judged() {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let scene = case::load(&file).expect("a valid scene");
        let interface = coupling::interface::CanopyInterface::new(&scene).expect("a canopy");
        let mesh = mesh::structure_mesh(&scene).expect("a mesh");
        let n = Numbers::new(&scene, &interface, &mesh);
        let text = ranking(&Scope::new(&n, scene.stages.len() - 1, None)).join("\n");
        let line = |key: &str| {
            let found = text.lines().position(|l| l.trim_start().starts_with(&format!("{key} ")));
            let at = found.unwrap_or_else(|| panic!("{key} in\n{text}"));
            text.lines().skip(at).take(4).collect::<Vec<_>>().join("\n")
        };
        assert!(line("flow.energy").contains("not needed") && line("flow.energy").contains("Mach 0.014"));
        let unknown = text.split("not assessed:").nth(1).expect("effects that are not assessed");
        assert!(unknown.contains("flow.limiter") && unknown.contains("fabric.contact"), "{unknown}");
        assert!(line("fabric_gravity").contains("missing") && text.contains("2.51 %"), "{text}");
        assert!(line("fabric.permeability").contains("mil-c44378"), "{text}");
        let order =
            ["effects that matter", "effects that may matter", "effects that do not matter", "not assessed"];
        let places: Vec<usize> = order.iter().filter_map(|o| text.find(&format!("\n{o}"))).collect();
        assert!(places.len() == 4 && places.is_sorted(), "{text}");
    }
}
