//! `docs/reference/messages.md`: classes of errors with cause and remedy, checks during a run, templates of messages.

use std::collections::BTreeMap;

use checks::{When, all};

use super::markdown::{anchor, compare_or_write, head, inline, root, table};
use super::source::{members, read, rust_files};

const INTRODUCTION: &str = "\
A message says what is wrong, where, and what to do. Problems of a scene cite file, line and column. This page lists the \
classes of errors of `ripstop`, the checks during a run, and the templates of the messages of all programs. Checks of a \
scene before a run are in [Checks](checks.md); exit codes are in [Command line](command-line.md#exit-codes-of-ripstop).";

/// Why a run ends early: variant of `RunError`, likely cause, remedy.
const CLASSES: &[(&str, &str, &str)] = &[
    (
        "Input",
        "A key, a value or an option that is wrong, or a file that is missing or does not fit.",
        "Correct what the message names; `ripstop check SCENE` validates a scene without running it.",
    ),
    ("Interrupted", "Ctrl-C, or a signal of a batch system.", "`ripstop run --resume` continues the run."),
    (
        "Resumable",
        "Any of the other classes; a checkpoint exists.",
        "Remove the cause, then run the command in the message.",
    ),
    (
        "Fault",
        "A program cannot start or cannot continue: its message gives the reason.",
        "Follow the message; the log in `{stage}/logs` has the output of the program.",
    ),
    (
        "Died",
        "A crash, too little memory, or a signal from outside.",
        "Read the last lines in `{stage}/logs`; reduce ranks or cells where memory is short; resume.",
    ),
    (
        "Stalled",
        "A program hangs, is stopped, or needs longer than the deadline for one request.",
        "Raise `--deadline`, or examine the process that the message names.",
    ),
    (
        "GridMotionFailed",
        "The canopy moves or folds so far that cells of the moved grid collapse.",
        "Shorten `window_s`, raise `mesh.regrid.quality_threshold`, or refine the grid near the canopy.",
    ),
    (
        "SolveFailed",
        "The iterations of a program diverge, or end in a state that is not physical.",
        "Shorten `window_s`, raise the iteration limits, start from a smoother state.",
    ),
    (
        "Unconverged",
        "A solver or the coupling ends far above its target.",
        "Raise the iteration limit that the message names, shorten `window_s`, or relax the target.",
    ),
    (
        "Energy",
        "Time integration of the structure creates energy: large steps, or fabric that snaps between slack and taut.",
        "More `substeps`, `structure.spectral_radius` below 1, or `integration = \"generalized-alpha\"`.",
    ),
    (
        "ImpossibleFlow",
        "The flow or the coupling is unstable.",
        "`coupling.scheme = \"implicit\"`, a shorter `window_s`, a finer grid.",
    ),
    (
        "Supersonic",
        "The local Mach number reaches 1: the stream is too fast, or a cell at a sharp edge.",
        "Lower `descent.initial_speed_m_s` or `flow.wind_m_s`, shorten `window_s`, enlarge `first_layer_m`.",
    ),
    (
        "Coupling",
        "The coupling iterations diverge or stagnate.",
        "Shorten `window_s`, more `substeps`, another `coupling.acceleration`.",
    ),
    (
        "Unphysical",
        "The frame accelerates in a way that the measured forces do not explain.",
        "Examine a replaced program: sign and unit of its load and its support force; shorten `window_s`.",
    ),
    (
        "Channel",
        "Programs do not fit each other, or shared memory is short.",
        "Follow the message: same scene and version for all programs, more room in `/dev/shm`.",
    ),
    (
        "Deviates",
        "With `--stop-at-deviation`, a message of a program or of the coupler differs from the baseline by more than the tolerance.",
        "Read which channel deviates first: its inputs agree up to there. Another tolerance is `--tolerance`.",
    ),
    (
        "Differs",
        "A comparison found a difference, or a program breaks the contract.",
        "Read the report above the message.",
    ),
    (
        "Study",
        "The base sample of a study fails, or no quantity can be assessed.",
        "Run the scene alone first; follow the message.",
    ),
    (
        "Followed",
        "The run that `ripstop watch` follows was interrupted, failed, was killed, or deviates from its baseline.",
        "That of the error that it quotes.",
    ),
    (
        "File",
        "A folder without write permission, a full disk, a file that was removed.",
        "Correct the path, its permissions, or make room; resume.",
    ),
];

const RUN_ERROR: &str = "crates/coupling/src/error.rs";

/// Exit codes by variant, from the arms of `RunError::exit_code`.
fn exit_codes() -> BTreeMap<String, String> {
    let source = read(RUN_ERROR);
    let function = source.split("pub fn exit_code").nth(1).expect("the exit codes");
    let arms = function.lines().take_while(|l| *l != "    }").filter_map(|l| l.trim().split_once(" => "));
    arms.map(|(pattern, code)| {
        let name = pattern.trim_start_matches("Self::").split([' ', '(', '{']).next().unwrap_or_default();
        let code = code.trim_end_matches(',');
        (
            name.to_owned(),
            if code.parse::<u8>().is_ok() { code.to_owned() } else { "that of its cause".to_owned() },
        )
    })
    .collect()
}

fn classes() -> String {
    let codes = exit_codes();
    let variants = members(&read(RUN_ERROR), "pub enum RunError");
    let rows: Vec<Vec<String>> = variants
        .iter()
        .map(|v| {
            let (_, cause, remedy) =
                CLASSES.iter().find(|(name, ..)| *name == v.name).expect("a class for each variant");
            let code = codes.get(&v.name).unwrap_or(&codes["_"]);
            vec![format!("`{}`", v.name), code.clone(), inline(&v.text), (*cause).into(), (*remedy).into()]
        })
        .collect();
    table(&["class", "exit code", "meaning", "likely cause", "remedy"], &rows)
}

fn checks_during_a_run() -> String {
    let rows: Vec<Vec<String>> = all()
        .filter_map(|c| match c.when {
            When::During(programs) => Some(vec![
                format!("[`{}`](checks.md#{})", c.id, anchor(c.id)),
                c.severity.name().into(),
                programs.join(", "),
                c.what.into(),
                c.remedy.into(),
            ]),
            When::Before(_) => None,
        })
        .collect();
    table(&["check", "at worst", "done by", "what", "remedy"], &rows)
}

/// The text of `#[error("...")]`: parts of the string joined, as rustc does.
fn template(attributes: &str) -> Option<String> {
    let inner = attributes.split("#[error(").nth(1)?.trim();
    if inner.starts_with("transparent") {
        return Some("(the message of its cause)".into());
    }
    let text = inner.strip_prefix('"')?;
    let mut end = text.len();
    for (at, _) in text.match_indices('"') {
        if !text[..at].ends_with('\\') {
            end = at;
            break;
        }
    }
    Some(text[..end].replace("\\\"", "\"").replace("\\n", " "))
}

/// Error types of all crates with their variants: type, file, rows of variant, meaning and template.
fn error_types() -> Vec<(String, String, Vec<Vec<String>>)> {
    let mut types = Vec::new();
    for path in rust_files() {
        let source = std::fs::read_to_string(&path).expect("text");
        let inside = path.strip_prefix(root()).expect("below the root").display().to_string();
        for (at, _) in source.match_indices("thiserror::Error)]\npub enum ") {
            let name = source[at..].lines().nth(1).and_then(|l| l.strip_prefix("pub enum ")).expect("a name");
            let name = name.trim_end_matches(" {");
            let rows: Vec<Vec<String>> = members(&source, &format!("pub enum {name}"))
                .iter()
                .map(|m| {
                    let text =
                        template(&m.attributes).unwrap_or_else(|| panic!("{inside}: {name}::{}", m.name));
                    vec![format!("`{}`", m.name), inline(&m.text), inline(&text)]
                })
                .collect();
            types.push((name.to_owned(), inside.clone(), rows));
        }
    }
    types
}

/// Errors of one kind only: type and message.
fn single_errors() -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    for path in rust_files() {
        let source = std::fs::read_to_string(&path).expect("text");
        for (at, _) in source.match_indices("thiserror::Error)]\n#[error(") {
            let (attributes, rest) = source[at..].split_once("\npub struct ").expect("a struct");
            let name = rest.split([' ', '(', ';']).next().expect("a name");
            let attributes: Vec<&str> = attributes.lines().map(|l| l.trim_end_matches('\\').trim()).collect();
            let text = template(&attributes.join(" ")).unwrap_or_else(|| panic!("{name}"));
            rows.push(vec![format!("`{name}`"), inline(&text)]);
        }
    }
    rows
}

fn page() -> String {
    let mut text = head("Messages", INTRODUCTION);
    text += &format!(
        "\n## Classes of errors of `ripstop`\n\nThe type is `RunError` in `{RUN_ERROR}`. An error that a shorter window may \
         avoid is retried first where `coupling.adaptive.enabled` is true.\n\n{}",
        classes()
    );
    text += &format!("\n## Checks during a run\n\n{}", checks_during_a_run());
    text += "\n## Templates of messages\n\nText in braces is a value. A program reports an error of these types to \
             `ripstop`, which adds stage and window.\n";
    for (name, file, rows) in error_types() {
        text += &format!("\n### `{name}`\n\n`{file}`\n\n{}", table(&["error", "meaning", "message"], &rows));
    }
    text + "\n### Errors of one kind\n\n" + &table(&["type", "message"], &single_errors())
}

#[test]
fn page_of_messages_is_generated_from_the_code() {
    compare_or_write("messages.md", &page());
}

#[test]
fn every_class_of_errors_has_cause_and_remedy() {
    let variants = members(&read(RUN_ERROR), "pub enum RunError");
    let names: Vec<&str> = variants.iter().map(|v| v.name.as_str()).collect();
    let mut listed: Vec<&str> = CLASSES.iter().map(|(name, ..)| *name).collect();
    listed.sort_unstable();
    let mut sorted = names.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, listed);
    let codes = exit_codes();
    assert_eq!(codes["_"], "1");
    assert!(codes.keys().filter(|k| *k != "_").all(|k| names.contains(&k.as_str())), "{codes:?}");
    for code in codes.values().filter_map(|c| c.parse::<u8>().ok()) {
        assert!(coupler::exit_codes::TABLE.iter().any(|(c, _)| *c == code), "{code}");
    }
}

#[test]
fn every_error_type_is_on_the_page() {
    let types = error_types();
    assert!(types.len() > 15, "{} types", types.len());
    assert!(types.iter().all(|(_, _, rows)| !rows.is_empty()));
    let derived = rust_files().into_iter().map(|p| std::fs::read_to_string(p).expect("text"));
    let derived: usize = derived.map(|text| text.matches("thiserror::Error)]\n").count()).sum();
    assert_eq!(types.len() + single_errors().len(), derived, "types that derive `thiserror::Error`");
}
