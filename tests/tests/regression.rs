//! `ripstop regression` on a folder of cases: record, compare, name what deviates, update.

use std::path::Path;
use std::process::Command;

use ripstop_tests::{program, root};

/// The exit code and both outputs of `ripstop regression` with `options`.
fn regression(folder: &Path, options: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(program("ripstop"));
    command.arg("regression").arg(folder.join("cases")).arg("--out").arg(folder.join("out")).args(options);
    let output = command.output().expect("ripstop starts");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code(), text)
}

/// Two cases of three windows of inflation each, without the other programs.
#[test]
fn cases_are_recorded_compared_and_updated() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = std::fs::read_to_string(root().join("cases/square-drop/scene.toml")).expect("a scene");
    let flow = text.find("[[stage]]\nname = \"developed-flow\"").expect("a second stage");
    let settings = |case: &str, text: &str| {
        std::fs::create_dir_all(at.join("cases").join(case)).expect("a folder");
        std::fs::write(at.join("cases").join(case).join("regression.toml"), text).expect("written");
    };
    let base = "scene = \"../../scene.toml\"\nstop_after_windows = 3\n";
    std::fs::write(at.join("scene.toml"), &text[..flow]).expect("written");
    settings("a", base);
    settings("b", &format!("{base}set = [\"fabric.poisson_ratio=0.2\"]\ntolerance = 1e-6\n"));

    let (code, text) = regression(at, &[]);
    assert!(code == Some(3) && text.contains("2 cases: 2 without a reference"), "{text}");
    let (code, text) = regression(at, &["--record", "--only", "b"]);
    assert!(code == Some(0) && text.contains("1 case: 1 recorded"), "{text}");
    let (code, text) = regression(at, &["--record"]);
    assert!(code == Some(0) && text.contains("2 cases: 1 recorded, 1 with a reference not run"), "{text}");
    let (code, text) = regression(at, &["--tolerance", "0", "--iteration-tolerance", "0"]);
    assert!(code == Some(0) && text.contains("2 cases: 2 as recorded"), "{text}");

    // A case whose scene changed, and a program that fails in the other.
    settings("b", &format!("{base}set = [\"fabric.poisson_ratio=0.21\"]\ntolerance = 1e-6\n"));
    let (code, text) = regression(at, &[]);
    assert!(code == Some(3) && text.contains("2 cases: 1 as recorded, 1 deviating"), "{text}");
    let named =
        "b: stage `pre-inflation`: window 0, iteration 0, displacement from the structure, canopy node";
    assert!(text.contains(named), "{text}");
    // The printed command repeats the run and ends at that window.
    let printed = text.lines().find(|line| line.trim_start().starts_with("ripstop run")).expect("a command");
    let repeated = printed.trim_start().strip_prefix("ripstop").expect("the program");
    let line = format!(
        "'{}' {repeated} --quiet --out '{}'",
        program("ripstop").display(),
        at.join("again").display()
    );
    let again = Command::new("sh").args(["-c", &line]).output().expect("sh");
    assert_eq!(again.status.code(), Some(3), "{}", String::from_utf8_lossy(&again.stderr));
    assert!(at.join("out/b/pre-inflation-difference.svg").is_file());
    let json = std::fs::read_to_string(at.join("out/regression.json")).expect("JSON");
    let rows: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert!(
        rows[1]["verdict"] == "deviates" && rows[1]["largest_difference"].as_f64() > Some(1e-6),
        "{json}"
    );

    let (code, text) = regression(at, &["--only", "a", "--structure", "false"]);
    assert!(
        code == Some(1) && text.contains("1 run failed: a") && text.contains("structure (`false`)"),
        "{text}"
    );
    // What an earlier run of the case left is not compared.
    let row = text.lines().find(|line| line.starts_with("a  ")).expect("a row");
    assert!(!row.contains("tolerance"), "{row}");
    let (code, text) = regression(at, &["--update"]);
    assert!(code == Some(0) && text.contains("2 cases: 1 as recorded, 1 updated"), "{text}");
    let (code, text) = regression(at, &[]);
    assert!(code == Some(0) && text.contains("2 cases: 2 as recorded"), "{text}");

    // Refused before anything runs: a tolerance that all results pass, and a wrong scene.
    let (code, text) = regression(at, &["--tolerance", "1"]);
    assert!(code == Some(2) && text.contains("less than 1"), "{text}");
    settings("b", &format!("{base}set = [\"fabric.poisson_ratio=0.7\"]\n"));
    let (code, text) = regression(at, &[]);
    assert!(code == Some(2) && text.contains("poisson_ratio") && !text.contains("1/2"), "{text}");
}
