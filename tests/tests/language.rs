//! User-visible text contains none of the words of `tests/refused-words.txt`.
//!
//! User-visible text: comments, string literals and public names of sources, help texts, documents, scenes and the scene
//! schema. A finding names file, line, word, replacement and reason.

use std::path::Path;
use std::process::Command;

use ripstop_tests::prose::{Found, json_keys, public_names, refused, search, texts_of_rust};
use ripstop_tests::{program, root};

/// Files of the repository with this ending, except tests, records and the changelog.
fn files(ending: &str) -> Vec<String> {
    let output =
        Command::new("git").arg("-C").arg(root()).args(["ls-files", &format!("*.{ending}")]).output();
    let output = output.expect("git lists the files");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all = String::from_utf8(output.stdout).expect("UTF-8");
    let is_test = |f: &str| {
        let name = Path::new(f).file_stem().and_then(|n| n.to_str()).unwrap_or_default();
        f.starts_with("tests/") || f.contains("/tests/") || name.ends_with("tests") || f.contains("/benches/")
    };
    // Records and the status page quote older messages; some files name what was renamed.
    const NAMES: [&str; 4] = [
        "CHANGELOG.md",
        "coupler/src/former_options.rs",
        "crates/case/src/renamed.rs",
        "crates/case/src/scene/accuracy.rs",
    ];
    let is_record = |f: &str| {
        f.starts_with("docs/records/")
            || f.starts_with("studies/")
            || f == "docs/status.md"
            || NAMES.contains(&f)
    };
    all.lines().filter(|f| !is_test(f) && !is_record(f)).map(str::to_owned).collect()
}

fn read(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

/// Fails with all findings, if any.
fn assert_none(findings: Vec<(String, Found)>) {
    let lines: Vec<String> = findings.iter().map(|(file, f)| format!("{file}:{f}")).collect();
    assert!(lines.is_empty(), "{} refused words:\n{}", lines.len(), lines.join("\n"));
}

#[test]
fn sources_use_standard_words() {
    let words = refused(include_str!("../refused-words.txt"));
    let files = files("rs");
    assert!(files.len() > 300, "{} sources", files.len());
    let mut findings = Vec::new();
    for file in files {
        let source = read(&file);
        for (line, text) in texts_of_rust(&source).into_iter().chain(public_names(&source)) {
            findings.extend(search(&text, line, &words).into_iter().map(|f| (file.clone(), f)));
        }
    }
    assert_none(findings);
}

#[test]
fn documents_scenes_and_scripts_use_standard_words() {
    let words = refused(include_str!("../refused-words.txt"));
    let mut findings = Vec::new();
    for ending in ["md", "toml", "json", "py"] {
        for file in files(ending) {
            findings.extend(search(&read(&file), 1, &words).into_iter().map(|f| (file.clone(), f)));
        }
    }
    assert_none(findings);
}

#[test]
fn keys_of_the_scene_schema_use_standard_words() {
    let words = refused(include_str!("../refused-words.txt"));
    let file = "cases/scene.schema.json";
    let keys = json_keys(&read(file));
    assert!(keys.len() > 300, "{} keys", keys.len());
    let found = keys.into_iter().flat_map(|(line, key)| search(&key, line, &words));
    assert_none(found.map(|f| (file.to_owned(), f)).collect());
}

#[test]
fn help_texts_use_standard_words() {
    let words = refused(include_str!("../refused-words.txt"));
    let help = |name: &str, command: &str| {
        let mut run = Command::new(program(name));
        if !command.is_empty() {
            run.arg(command);
        }
        let output = run.arg("--help").output().expect("it starts");
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let main = help("ripstop", "");
    let listed = main.split("Commands:").nth(1).and_then(|t| t.split("Options:").next()).expect("commands");
    let indented = |l: &&str| l.starts_with("  ") && !l.starts_with("   ");
    let commands: Vec<&str> =
        listed.lines().filter(indented).filter_map(|l| l.split_whitespace().next()).collect();
    assert!(commands.len() > 10, "{commands:?}");
    let mut findings = Vec::new();
    let programs = ["structure-solver", "flow-solver", "mesh-mover"].map(|p| (p, ""));
    for (name, command) in commands.into_iter().map(|c| ("ripstop", c)).chain(programs) {
        let text = help(name, command);
        findings
            .extend(search(&text, 1, &words).into_iter().map(|f| (format!("{name} {command} --help"), f)));
    }
    assert_none(findings);
}
