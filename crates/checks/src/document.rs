//! The table as a page: `docs/reference/checks.md`.

use std::fmt::Write as _;

use super::finding::Severity;
use super::table::{Check, When, all};

/// The table as Markdown: an overview, then a section for each check.
pub fn markdown() -> String {
    let before: Vec<&Check> = all().filter(|c| matches!(c.when, When::Before(_))).collect();
    let during: Vec<&Check> = all().filter(|c| matches!(c.when, When::During(_))).collect();
    let mut text = String::from("## Before the run\n\n");
    overview(&mut text, &before);
    text.push_str("\n## During the run\n\n");
    overview(&mut text, &during);
    text.push_str("\n## Each check in full\n");
    for c in before.iter().chain(&during) {
        section(&mut text, c);
    }
    text
}

fn overview(text: &mut String, checks: &[&Check]) {
    text.push_str("| check | what is checked | at worst |\n|---|---|---|\n");
    for c in checks {
        let _ = writeln!(text, "| `{}` | {} | {} |", c.id, c.what, c.severity.name());
    }
}

fn section(text: &mut String, c: &Check) {
    let when = match c.when {
        When::Before(_) => "before the run, `ripstop check` and `ripstop run`".to_owned(),
        When::During(programs) => format!("during the run, {}", programs.join(", ")),
    };
    let _ = write!(
        text,
        "\n### `{}`\n\n{}.\n\n- Estimate: {}\n- Range: {}\n- Source: {}\n- At worst: {}\n- When: {when}\n",
        c.id,
        capital(c.what),
        c.estimate,
        c.range,
        c.source,
        c.severity.name()
    );
    if c.severity > Severity::Note {
        let _ = writeln!(text, "- Remedy: {}", c.remedy);
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
