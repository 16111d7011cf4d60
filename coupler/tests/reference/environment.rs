//! Environment variables of the project: one table, compared with the sources.

use std::collections::BTreeSet;
use std::path::Path;

use super::markdown::{root, table};

/// Variables that users and writers of programs may meet: name, who reads it, meaning.
const USERS: &[(&str, &str, &str)] = &[
    (
        "RIPSTOP_DEADLINE_S",
        "solver programs",
        "Time limit for one request of the coupler, in seconds, where `--deadline-s` is absent. `ripstop` sets it.",
    ),
    (
        "RIPSTOP_TIMINGS",
        "solver programs",
        "File to which the first rank writes the times of the named parts of its work, JSON. `ripstop` sets it and \
         collects the file in `summary.json`.",
    ),
    (
        "RIPSTOP_LOG",
        "solver programs",
        "Level of their logs: `warn`, `info` (where it is unset) or `debug`, or `module=level` for parts of a program, separated by commas. \
         `--log-level` sets it.",
    ),
    (
        "RIPSTOP",
        "programs that replace a solver",
        "Path of the program `ripstop`, instead of the one on `PATH`.",
    ),
    ("RIPSTOP_SCENE", "solvers behind preCICE", "Scene of the run. The bridge sets it."),
    ("RIPSTOP_STAGE", "solvers behind preCICE", "Number of the stage, from 0. The bridge sets it."),
    ("RIPSTOP_OUT", "solvers behind preCICE", "Folder of the results. The bridge sets it."),
    (
        "RIPSTOP_PRECICE_CONFIG",
        "solvers behind preCICE",
        "Configuration of preCICE for this stage. The bridge sets it.",
    ),
    (
        "RIPSTOP_STATE",
        "solvers behind preCICE",
        "Folder with the files that the solver saved earlier; empty where it starts from rest. The bridge sets it.",
    ),
    (
        "RIPSTOP_SAVE",
        "solvers behind preCICE",
        "Folder into which the solver writes the files that it needs to continue. The bridge sets it.",
    ),
    (
        "GLIBC_TUNABLES",
        "solver programs",
        "Settings of the C library. Where it is unset, `ripstop` sets it to `glibc.malloc.hugetlb=1` for the programs that it starts: large arrays then lie in large \
         pages (Linux, glibc 2.35 and later). Set it to anything else, as `glibc.malloc.hugetlb=0`, to keep small pages.",
    ),
    ("NO_COLOR", "ripstop", "If set, output on the terminal has no colours."),
];

/// Variables of tests and scripts.
const TESTS: &[(&str, &str, &str)] = &[
    (
        "RIPSTOP_WRITE_DOCS",
        "tests of generated pages",
        "If set, the tests write the pages instead of comparing them.",
    ),
    (
        "RIPSTOP_WRITE",
        "tests of generated files",
        "If set, the tests write `cases/scene.schema.json` and the results of the adviser instead of comparing them.",
    ),
    ("RIPSTOP_KEEP", "tests of figures and reports", "Folder to which the tests copy what they draw."),
    (
        "RIPSTOP_SKIPPED",
        "tests",
        "File to which a test writes that it was skipped, and why; `./test` sets it.",
    ),
    (
        "RIPSTOP_BROWSER",
        "tests of the report",
        "Browser that opens the report, instead of the first one on `PATH`.",
    ),
    (
        "RIPSTOP_WHOLE_TUTORIALS",
        "test of the tutorials",
        "If set, the runs of the tutorials are not ended early.",
    ),
    (
        "RIPSTOP_SWEEP_LIST",
        "test of the structure's energy",
        "If set, prints every combination of the sweep.",
    ),
    ("RIPSTOP_TEST_CHILD", "tests that start themselves", "Set for a child process of the test."),
    ("RIPSTOP_COMM_TEST_RANKS", "tests that start themselves", "Ranks of a child process of the test."),
    ("RIPSTOP_LINALG_RANKS", "tests that start themselves", "Ranks of a child process of the test."),
    ("RIPSTOP_MOVER_RANKS", "tests that start themselves", "Folder of a child process of the test."),
];

/// The section of the page.
pub fn section() -> String {
    let rows = |all: &[(&str, &str, &str)]| {
        let row = |(name, reader, text): &(&str, &str, &str)| {
            vec![format!("`{name}`"), (*reader).into(), (*text).into()]
        };
        table(&["variable", "read by", "meaning"], &all.iter().map(row).collect::<Vec<_>>())
    };
    format!("\n## Environment variables\n\n{}\nVariables of tests:\n\n{}", rows(USERS), rows(TESTS))
}

/// Names with the prefix of the project in the files below `folder`.
fn collect(folder: &Path, found: &mut BTreeSet<String>) {
    for path in std::fs::read_dir(folder).expect("a folder").flatten().map(|e| e.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if !name.starts_with('.')
                && !name.starts_with("target")
                // The constants of `ripstop.h` have the same prefix.
                && !["docs", "runs", "reference", "participant-c"].contains(&name.as_str())
            {
                collect(&path, found);
            }
            continue;
        }
        let is_source = path.extension().is_none_or(|e| e == "rs" || e == "py" || e == "sh");
        let text = if is_source { std::fs::read_to_string(&path).unwrap_or_default() } else { String::new() };
        for (at, _) in text.match_indices("RIPSTOP_") {
            let end =
                text[at..].find(|c: char| !c.is_ascii_uppercase() && c != '_').unwrap_or(text.len() - at);
            // The prefix alone is part of code that makes names.
            if end > "RIPSTOP_".len() {
                found.insert(text[at..at + end].to_owned());
            }
        }
    }
}

#[test]
fn table_has_every_variable_in_the_sources_and_none_else() {
    let mut found = BTreeSet::new();
    collect(&root(), &mut found);
    let listed = USERS.iter().chain(TESTS).map(|(name, ..)| (*name).to_owned());
    assert_eq!(found, listed.filter(|name| name.starts_with("RIPSTOP_")).collect());
}
