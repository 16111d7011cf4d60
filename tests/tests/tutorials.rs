//! The tutorials in `docs/tutorials` do what they say: their text is the test.
//!
//! The blocks of a page are executed in their order, in a folder that looks like the repository: links to its files, the
//! programs of this build in `target/release`, and a `scripts/setup` that has nothing to do. What a block writes stays in
//! that folder. The word after the fence, and the words behind it, say what a block is:
//!
//! | block | meaning |
//! |---|---|
//! | `sh` | commands for bash; each must succeed. Variables that are exported and the folder hold for later blocks |
//! | `sh exit=3` | the last command ends with this code |
//! | `sh add=OPTION` | the test adds `OPTION` to the last line, unless the variable `RIPSTOP_WHOLE_TUTORIALS` is set |
//! | `toml file=NAME` (any language) | a file to write |
//! | `text` | what the last commands print, on either stream |
//! | `text tolerance=1%` | numbers agree to that share |
//! | `... no-test` | not executed |
//!
//! In expected output `...` stands for any characters, alone in a line for any lines. Other blocks are not executed.

use std::fmt::Write as _;
use std::fs;
use std::os::unix::fs::symlink;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use ripstop_tests::load::Limit;
use ripstop_tests::skip::skipped;
use ripstop_tests::{program, root};

/// Limit of a page's time: all five together take two minutes on two free cores.
const LIMIT: Duration = Duration::from_secs(400);

/// A fenced block of a page.
#[derive(Debug, PartialEq)]
struct Block {
    /// Line of the fence, from 1.
    line: usize,
    /// Words after the fence.
    info: Vec<String>,
    text: String,
}

impl Block {
    /// The value of `key=value` among the words.
    fn value(&self, key: &str) -> Option<&str> {
        self.info.iter().find_map(|word| word.strip_prefix(key)?.strip_prefix('='))
    }

    fn is(&self, word: &str) -> bool {
        self.info.iter().any(|w| w == word)
    }
}

/// The fenced blocks of a page.
fn blocks(page: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut open = false;
    for (i, line) in page.lines().enumerate() {
        if let Some(info) = line.strip_prefix("```") {
            open = !open;
            if open {
                let info = info.split_whitespace().map(str::to_owned).collect();
                found.push(Block { line: i + 1, info, text: String::new() });
            }
        } else if open {
            let _ = writeln!(found.last_mut().expect("an open block").text, "{line}");
        }
    }
    assert!(!open, "the block at line {} has no end", found.last().map_or(0, |b| b.line));
    found
}

/// A line as numbers and the text between them.
fn parts(line: &str) -> Vec<(String, Option<f64>)> {
    let mut parts: Vec<(String, Option<f64>)> = Vec::new();
    let mut rest = line;
    while !rest.is_empty() {
        let digit = |c: char| c.is_ascii_digit();
        let start = rest.find(digit).unwrap_or(rest.len());
        if start > 0 {
            parts.push((rest[..start].to_owned(), None));
        }
        rest = &rest[start..];
        // The longest number that begins here: digits, fraction, exponent.
        let longest = (1..=rest.len()).rev().filter(|&n| rest.is_char_boundary(n)).find(|&n| {
            let text = &rest[..n];
            text.ends_with(digit)
                && text.chars().all(|c| digit(c) || ".eE+-".contains(c))
                && text.parse::<f64>().is_ok()
        });
        if let Some(n) = longest {
            parts.push((rest[..n].to_owned(), rest[..n].parse().ok()));
            rest = &rest[n..];
        }
    }
    parts
}

/// Whether two texts are one but for numbers that differ by the share `tolerance`.
fn same(expected: &str, found: &str, tolerance: f64) -> bool {
    let (a, b) = (parts(expected), parts(found));
    let agree = |(x, p): &(String, Option<f64>), (y, q): &(String, Option<f64>)| match (p, q) {
        (Some(p), Some(q)) => x == y || (p - q).abs() <= tolerance * p.abs(),
        _ => x == y,
    };
    expected == found || tolerance > 0.0 && a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| agree(a, b))
}

/// Whether a line is as expected, with `...` for any characters.
fn line_matches(expected: &str, found: &str, tolerance: f64) -> bool {
    let Some((before, after)) = expected.split_once("...") else { return same(expected, found, tolerance) };
    let boundaries = (0..=found.len()).filter(|&i| found.is_char_boundary(i));
    boundaries.filter(|&i| same(before, &found[..i], tolerance)).any(|i| {
        let rest = &found[i..];
        (0..=rest.len())
            .filter(|&j| rest.is_char_boundary(j))
            .any(|j| line_matches(after, &rest[j..], tolerance))
    })
}

/// The first expected line that the output lacks; `None` where all are there in their order.
fn missing<'a>(expected: &[&'a str], found: &[&str], tolerance: f64) -> Option<&'a str> {
    let (mut next, mut any) = (0, false);
    for line in expected {
        if *line == "..." {
            any = true;
            continue;
        }
        let last = if any { found.len() } else { (next + 1).min(found.len()) };
        match (next..last).find(|&i| line_matches(line, found[i], tolerance)) {
            Some(i) => next = i + 1,
            None => return Some(line),
        }
        any = false;
    }
    (next < found.len() && !any).then_some("(the end of the output)")
}

/// Demands that `output` is what the block says.
fn compare(block: &Block, output: &str) -> Result<(), String> {
    let tolerance = match block.value("tolerance") {
        Some(text) => {
            let percent = text.strip_suffix('%').and_then(|p| p.parse::<f64>().ok());
            percent.ok_or_else(|| format!("tolerance={text} is no percentage"))? / 100.0
        }
        None => 0.0,
    };
    let trimmed = |text: &str| text.lines().map(|l| l.trim_end().to_owned()).collect::<Vec<_>>();
    let (expected, found) = (trimmed(&block.text), trimmed(output));
    let (expected, found): (Vec<&str>, Vec<&str>) =
        (expected.iter().map(String::as_str).collect(), found.iter().map(String::as_str).collect());
    match missing(&expected, &found, tolerance) {
        Some(line) => Err(format!(
            "the output lacks this line, or has it at another place:\n{line}\n--- output\n{output}"
        )),
        None => Ok(()),
    }
}

/// A folder that looks like the repository to the commands of a page.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for name in ["cases", "docs", "python", "README.md"] {
        symlink(root().join(name), at(name)).expect("a link");
    }
    fs::copy(root().join("run"), at("run")).expect("the script `run`");
    fs::create_dir_all(at("scripts")).expect("a folder");
    fs::create_dir_all(at("target")).expect("a folder");
    let built = program("ripstop");
    symlink(built.parent().expect("a folder"), at("target/release")).expect("a link");
    // All is set up: a page's commands take the programs of this build as they are.
    fs::write(at("scripts/setup"), "#!/bin/sh\n").expect("written");
    let executable = fs::metadata(at("run")).expect("copied").permissions();
    fs::set_permissions(at("scripts/setup"), executable).expect("permissions");
    if let Some(python) = python() {
        let bin = at("target/python/bin");
        fs::create_dir_all(&bin).expect("a folder");
        let text = format!("#!/bin/sh\nexec '{}' \"$@\"\n", python.display());
        fs::write(bin.join("python3"), text).expect("written");
        fs::set_permissions(bin.join("python3"), fs::metadata(at("run")).expect("copied").permissions())
            .expect("set");
    }
    folder
}

/// A Python with what `python/` needs.
fn python() -> Option<PathBuf> {
    [root().join("target/python/bin/python3"), "python3".into()].into_iter().find(|python| {
        let tried = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        tried.is_ok_and(|output| output.status.success())
    })
}

/// What commands left behind.
struct Ran {
    code: i32,
    output: String,
    /// Line of the block with the command that failed, from 1.
    line: Option<usize>,
}

/// Runs commands in bash, with what earlier ones exported.
fn execute(text: &str, folder: &Path, limit: &Limit) -> Ran {
    let hidden = folder.join(".tutorial");
    fs::create_dir_all(&hidden).expect("a folder");
    fs::write(hidden.join("block.sh"), text).expect("written");
    let _ = fs::remove_file(hidden.join("line"));
    let shell = "set -eEu -o pipefail
        hidden=$1
        [ ! -f \"$hidden/state.sh\" ] || . \"$hidden/state.sh\"
        trap 'echo \"$LINENO\" >\"$hidden/line\"' ERR
        trap '{ declare -px; printf \"cd %q\\n\" \"$PWD\"; } >\"$hidden/state.sh\"' EXIT
        . \"$hidden/block.sh\"";
    let log = fs::File::create(hidden.join("output")).expect("a file");
    let mut child = Command::new("bash")
        .args(["-c", shell, "tutorial"])
        .arg(&hidden)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(log.try_clone().expect("a second handle"))
        .stderr(log)
        .process_group(0)
        .spawn()
        .expect("bash starts");
    let mut status = None;
    let waited = limit.until(Duration::from_millis(20), || {
        status = child.try_wait().expect("a child");
        status.is_some()
    });
    if waited.is_err() {
        let group = rustix::process::Pid::from_child(&child);
        let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        let _ = child.wait();
    }
    let read = |name: &str| fs::read(hidden.join(name)).map(|b| String::from_utf8_lossy(&b).into_owned());
    let mut output = read("output").unwrap_or_default();
    if let Err(why) = waited {
        let _ = writeln!(output, "--- ended by the test: {why}");
    }
    let code = status.and_then(|s| s.code()).unwrap_or(-1);
    Ran { code, output, line: read("line").ok().and_then(|l| l.trim().parse().ok()) }
}

/// The commands of a block, the last one with the option that the block names: a shorter run.
fn shortened(block: &Block) -> String {
    match block.value("add") {
        Some(option) if std::env::var_os("RIPSTOP_WHOLE_TUTORIALS").is_none() => {
            format!("{} {option}\n", block.text.trim_end())
        }
        _ => block.text.clone(),
    }
}

/// Does what a page says, and demands what it shows.
fn follow(name: &str, page: &str) -> Result<(), String> {
    let folder = workplace();
    let limit = Limit::new(LIMIT);
    let mut last = String::new();
    for block in blocks(page).iter().filter(|b| !b.is("no-test")) {
        let place = format!("docs/tutorials/{name}, line {}", block.line);
        if let Some(file) = block.value("file") {
            fs::write(folder.path().join(file), &block.text).map_err(|e| format!("{place}: {file}: {e}"))?;
        } else if block.is("sh") {
            let ran = execute(&shortened(block), folder.path(), &limit);
            let expected = block.value("exit").map_or(0, |code| code.parse().expect("an exit code"));
            if ran.code != expected {
                let line = ran.line.unwrap_or(1);
                let command = block.text.lines().nth(line - 1).unwrap_or_default();
                return Err(format!(
                    "docs/tutorials/{name}, line {}: ended with code {}, expected {expected}:\n{command}\n--- output\n{}",
                    block.line + line,
                    ran.code,
                    ran.output
                ));
            }
            last = ran.output;
        } else if block.is("text") {
            compare(block, &last).map_err(|why| format!("{place}: {why}"))?;
        }
    }
    Ok(())
}

/// Follows a page of `docs/tutorials`.
fn tutorial(name: &str) {
    let page = fs::read_to_string(root().join("docs/tutorials").join(name)).expect("the page can be read");
    if let Err(why) = follow(name, &page) {
        panic!("{why}");
    }
}

#[test]
fn first_run() {
    tutorial("first-run.md");
}

#[test]
fn round_canopy() {
    tutorial("round-canopy.md");
}

#[test]
fn flow_solver_in_python() {
    if python().is_none() {
        skipped(
            "no Python can import iceoryx2 and numpy; `scripts/setup --python` installs them where there is a network",
        );
        return;
    }
    tutorial("flow-solver-in-python.md");
}

#[test]
fn find_a_regression() {
    tutorial("find-a-regression.md");
}

#[test]
fn read_results() {
    tutorial("read-results.md");
}

/// Each page of the folder is one of the tests above.
#[test]
fn all_tutorials_are_tested() {
    let mut pages: Vec<String> = fs::read_dir(root().join("docs/tutorials"))
        .expect("the folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
        .filter(|name| name.ends_with(".md") && name != "README.md")
        .collect();
    pages.sort();
    let tested = ["find-a-regression", "first-run", "flow-solver-in-python", "read-results", "round-canopy"];
    assert_eq!(pages, tested.map(|name| format!("{name}.md")));
}

#[test]
fn wrong_output_and_failing_commands_are_found() {
    let page = |text: &str| text.replace('|', "\n").replace("~~~", "```");
    let good = page(
        "# Page|~~~toml file=a.toml|speed = 4.25|~~~|~~~sh|export A=7|cat a.toml; echo last >&2|~~~|~~~text tolerance=1%|\
         speed = 4.26|...|~~~|~~~sh exit=3|cd scripts; test $A = 7; exit 3|~~~|~~~sh|basename $PWD|~~~|~~~text|scripts|~~~|\
         ~~~sh no-test|false|~~~|",
    );
    assert_eq!(follow("good.md", &good), Ok(()));
    for (from, to, says) in [
        ("4.26", "4.36", "line 9: the output lacks this line, or has it at another place:\nspeed = 4.36"),
        ("...\n```\n```sh exit", "```\n```sh exit", "line 9: the output lacks"),
        ("exit=3", "exit=4", "line 14: ended with code 3, expected 4:\ncd scripts; test $A = 7; exit 3"),
        ("cat a.toml", "cat b.toml", "line 7: ended with code 1, expected 0:\ncat b.toml"),
        ("\nscripts\n", "\nscript\n", "line 19: the output lacks"),
        (" no-test", "", "line 23: ended with code 1, expected 0:\nfalse"),
    ] {
        assert!(good.contains(from), "{from}");
        let why = follow("bad.md", &good.replacen(from, to, 1)).expect_err(to);
        assert!(why.contains(says), "{to}: {why}");
    }
}

#[test]
fn expected_lines_match_with_wildcards_and_tolerances() {
    for (expected, found, tolerance, matches) in [
        ("a 1.00 b", "a 1.00 b", 0.0, true),
        ("a 1.00 b", "a 1.01 b", 0.0, false),
        ("a 1.00 b", "a 1.01 b", 0.02, true),
        ("a -1.00e-3 b", "a -1.01e-3 b", 0.02, true),
        ("a -1.00e-3 b", "a 1.00e-3 b", 0.02, false),
        ("drag 83.1 N | ... iterations", "drag 83.4 N | 3 iterations", 0.01, true),
        ("drag 83.1 N | ... iterations", "drag 93.4 N | 3 iterations", 0.01, false),
        ("in ... s", "in 7.2 s", 0.0, true),
        ("in ... s", "in 7.2 m", 0.0, false),
        ("10 windows", "100 windows", 0.01, false),
    ] {
        assert_eq!(line_matches(expected, found, tolerance), matches, "{expected} | {found}");
    }
    assert_eq!(missing(&["a", "...", "c"], &["a", "b", "b", "c"], 0.0), None);
    assert_eq!(missing(&["a", "c"], &["a", "b", "c"], 0.0), Some("c"));
    assert_eq!(missing(&["...", "c", "a"], &["a", "b", "c"], 0.0), Some("a"));
    assert_eq!(missing(&["a"], &["a", "b"], 0.0), Some("(the end of the output)"));
}
