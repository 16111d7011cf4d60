//! The table for people: `ripstop effects`, `docs/effects.md`.

use std::fmt::Write as _;

use super::criteria::Verdict;
use super::numbers::Numbers;
use super::table::{Entry, TABLE};
use crate::error::RunError;
use crate::run::{Prepared, RunOptions, prepare};

/// The table as Markdown, a section for each effect.
pub fn markdown() -> String {
    let mut text = String::from("| effect | what | programs | matters by |\n|---|---|---|---|\n");
    for e in TABLE {
        let _ = writeln!(text, "| `{}` | {} | {} | {} |", e.key, e.what, e.programs.join(", "), e.criterion);
    }
    for e in TABLE {
        let _ = write!(
            text,
            "\n### `{}`\n\n{}.\n\n- Model: {}\n- Equation: `{}`\n- Reference: {}\n- Programs: {}{}\n",
            e.key,
            capital(e.what),
            e.model,
            e.equation,
            e.reference,
            e.programs.join(", "),
            e.announced_by.map_or(String::new(), |r| format!("; announced by the {}", r.name()))
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
            "{}: {}\n  model      {}\n  equation   {}\n  reference  {}\n  programs   {}\n  matters by {}",
            e.key,
            e.what,
            e.model,
            e.equation,
            e.reference,
            e.programs.join(", "),
            e.criterion
        );
    }
    text.push_str("`ripstop effects SCENE` judges them for a scene; with --measure it says what each costs.");
    text
}

/// What the numbers of a scene say about an effect, in one word.
pub fn advice(on: bool, verdict: Verdict) -> &'static str {
    match (on, verdict) {
        (true, Verdict::Matters) => "needed",
        (true, Verdict::Hardly) => "hardly matters: could be off",
        (false, Verdict::Matters) => "would matter: consider it",
        (false, Verdict::Hardly) => "not needed",
        (_, Verdict::Open) => "",
    }
}

/// Which effects a scene has on and what their criteria say.
///
/// # Errors
/// Whatever `ripstop run` would refuse before it starts a program.
pub fn scene_report(options: &RunOptions) -> Result<String, RunError> {
    let prepared = prepare(options)?;
    let Prepared { scene, interface, .. } = &prepared;
    let mesh = mesh::structure_mesh(scene).map_err(|e| RunError::Input(e.to_string()))?;
    let n = Numbers::new(scene, interface, &mesh);
    let mut lines = vec![format!("{}: {}", scene.name, scene.title)];
    lines.push(format!(
        "stream {:.3} m/s (Mach {:.4}), Reynolds number {:.2e}, dynamic pressure {:.2} Pa, pressure jump {:.2} Pa, drag {:.1} N",
        n.speed, n.mach, n.reynolds, n.dynamic_pressure, n.pressure, n.drag
    ));
    for on in [true, false] {
        lines.push(if on { "on:" } else { "off:" }.into());
        for e in TABLE.iter().filter(|e| (e.on)(scene) == on) {
            lines.push(line(e, &n, on));
        }
    }
    Ok(lines.join("\n"))
}

fn line(e: &Entry, n: &Numbers<'_>, on: bool) -> String {
    let judgement = (e.judge)(n);
    let advice = advice(on, judgement.verdict);
    let advice = if advice.is_empty() { String::new() } else { format!("{advice}; ") };
    format!("  {:<42} {advice}{} ({})", e.key, judgement.why, e.programs.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/effects.md");
    const BEGIN: &str = "<!-- made from coupler/src/effects/table.rs: begin -->\n";
    const END: &str = "<!-- made from coupler/src/effects/table.rs: end -->\n";

    /// After a change: `RIPSTOP_WRITE_DOCS=1 cargo test --release -p coupler the_document`.
    #[test]
    fn the_document_is_the_table() {
        let text = std::fs::read_to_string(DOCUMENT).expect("docs/effects.md");
        let (head, rest) = text.split_once(BEGIN).expect("the begin of the table");
        let (old, tail) = rest.split_once(END).expect("the end of the table");
        let new = format!("\n{}\n", markdown());
        if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
            std::fs::write(DOCUMENT, format!("{head}{BEGIN}{new}{END}{tail}")).expect("written");
        } else {
            assert!(old == new, "docs/effects.md differs from the table: see the comment of this test");
        }
    }

    #[test]
    fn every_effect_is_told_in_full_and_once() {
        for (i, e) in TABLE.iter().enumerate() {
            assert!(TABLE[..i].iter().all(|o| o.key != e.key), "{} twice", e.key);
            for part in [e.what, e.model, e.equation, e.reference, e.criterion] {
                assert!(!part.is_empty(), "{}", e.key);
            }
            assert!(!e.programs.is_empty(), "{}", e.key);
            if let Some(role) = e.announced_by {
                assert!(e.programs.contains(&role.program()), "{}", e.key);
            }
        }
    }

    /// The judgements that a person would make of the paper's parachute.
    #[test]
    fn the_paper_parachute_is_judged() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases/atps-descent/scene.toml");
        let text = scene_report(&RunOptions { scene: file, ..RunOptions::default() }).expect("a valid scene");
        let line = |key: &str| {
            let found = text.lines().find(|l| l.trim_start().starts_with(&format!("{key} ")));
            found.unwrap_or_else(|| panic!("{key} in\n{text}")).to_owned()
        };
        assert!(line("flow.energy").contains("not needed") && line("flow.energy").contains("Mach 0.014"));
        assert!(line("flow.limiter").contains("not needed"));
        assert!(line("fabric.wrinkling").contains("needed;"));
        assert!(line("fabric_gravity").contains("would matter") && text.contains("2.51 %"), "{text}");
        assert!(line("fabric.permeability").contains("mil-c44378"), "{text}");
    }
}
