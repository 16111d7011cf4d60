//! Equations of doc comments and of the documentation can be typeset. Warnings of rustdoc are errors of `.ci/run`.

use std::process::Command;

use ripstop_tests::equations::{doc_comments, equations, mathml};
use ripstop_tests::root;

/// Files with this ending that git tracks or would track, relative to the root.
fn files(ending: &str) -> Vec<String> {
    let output = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", ending])
        .current_dir(root())
        .output()
        .expect("git runs");
    let names = String::from_utf8(output.stdout).expect("paths are UTF-8");
    names.lines().filter(|name| root().join(name).exists()).map(str::to_owned).collect()
}

fn text(file: &str) -> String {
    std::fs::read_to_string(root().join(file)).expect("text")
}

/// Faults of the equations of a Markdown text whose first line has number `line`, and how many equations it has.
fn faults(file: &str, line: usize, markdown: &str, as_code: bool) -> (Vec<String>, usize) {
    let found = equations(markdown);
    let mut faults = Vec::new();
    for equation in &found {
        let line = line + markdown[..equation.range.start].matches('\n').count();
        if let Err(e) = mathml(&equation.tex, equation.displayed) {
            faults.push(format!("{file}:{line}: {e}"));
        } else if as_code && !equation.code {
            let remedy = "write $`...`$ in a line, or a code block of the language `math`";
            faults.push(format!("{file}:{line}: Markdown changes ${}$: {remedy}", equation.tex));
        }
    }
    (faults, found.len())
}

#[test]
fn equations_of_doc_comments_can_be_typeset() {
    let mut wrong = Vec::new();
    let mut count = 0;
    for file in files("*.rs") {
        for (line, comment) in doc_comments(&text(&file)) {
            let (faults, found) = faults(&file, line, &comment, true);
            wrong.extend(faults);
            count += found;
        }
    }
    assert!(count > 300, "only {count} equations were found");
    assert!(wrong.is_empty(), "equations that cannot be typeset:\n{}", wrong.join("\n"));
}

#[test]
fn equations_of_pages_can_be_typeset() {
    let mut wrong = Vec::new();
    let mut count = 0;
    for file in files("*.md") {
        let (faults, found) = faults(&file, 1, &text(&file), false);
        wrong.extend(faults);
        count += found;
    }
    assert!(count > 80, "only {count} equations were found");
    assert!(wrong.is_empty(), "equations that cannot be typeset:\n{}", wrong.join("\n"));
}

#[test]
fn faulty_equations_are_found_with_their_lines() {
    let comment = "Text.\n\n```math\n\\frac{1}{2\n```\n\nAnd $`\\nocommand x`$, $`y`$, $z_1$.\n";
    let (found, count) = faults("a.rs", 10, comment, true);
    assert_eq!(count, 4);
    let places: Vec<_> = found.iter().map(|f| f.split(": ").next().unwrap_or_default()).collect();
    assert_eq!(places, ["a.rs:12", "a.rs:16", "a.rs:16"], "{found:?}");
    assert!(faults("a.md", 1, "$z_1$", false).0.is_empty());
}

/// Commands of CI and of the book deny all warnings of rustdoc.
#[test]
fn warnings_of_rustdoc_are_errors_of_ci() {
    assert!(text(".ci/run").contains("scripts/rustdoc --check"));
    assert!(text("scripts/rustdoc").contains("-D rustdoc::all"));
}
