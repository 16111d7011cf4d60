//! Validation of the recommendations of `ripstop accuracy`: error bounds of the recommended settings compared with runs
//! that are much finer in all parameters of the study. `scripts/adviser` runs it and writes the table of docs/records/accuracy.md.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::{program, root};
use serde_json::Value;

/// Minimum number of valid bounds, of this number.
const HELD: (usize, usize) = (19, 20);

/// Targets as multiples of the smallest bound of the study: one that only the most accurate samples meet, and one for
/// which coarser samples are recommended.
const TARGETS: [f64; 2] = [1.1, 2.5];

/// Markers around the table in docs/records/accuracy.md.
const MARKS: [&str; 2] = ["<!-- adviser: begin -->\n", "<!-- adviser: end -->\n"];

struct Row {
    scene: String,
    sample: String,
    quantity: String,
    error: f64,
    band: f64,
    true_error: f64,
    held: bool,
}

fn scenes() -> Vec<PathBuf> {
    let folder = root().join("studies/adviser");
    let files = std::fs::read_dir(folder).expect("studies/adviser").flatten().map(|f| f.path());
    let mut all: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
    all.sort();
    all
}

/// Runs the study of a scene with its reference. Samples with results in the folder are not run again.
fn study(scene: &Path, out: &Path, options: &[&str]) {
    let output = Command::new(program("ripstop"))
        .arg("accuracy")
        .arg(scene)
        .arg("--out")
        .arg(out)
        .args(["--cost", "work", "--without-check", "--verify", "--yes"])
        .args(options)
        .output()
        .expect("it starts");
    // Exit code 3: a bound is exceeded; counted here.
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}: {}\n{}",
        scene.display(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Smallest bound for all quantities over the samples of the study.
fn smallest_bound(out: &Path) -> f64 {
    let text = std::fs::read_to_string(out.join("samples.csv")).expect("samples.csv");
    let mut lines = text.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("a header");
    let errors: Vec<usize> = (0..names.len()).filter(|&i| names[i].starts_with("error of ")).collect();
    let bound = |row: Vec<&str>| {
        let all = errors.iter().map(|&i| Some(row[i].parse::<f64>().ok()? + row[i + 1].parse::<f64>().ok()?));
        (row[0] != "reference").then(|| all.collect::<Option<Vec<f64>>>()).flatten()
    };
    let bounds = lines.filter_map(bound).map(|b| b.into_iter().fold(0.0, f64::max));
    bounds.fold(f64::INFINITY, f64::min)
}

/// Rows of a scene, with commit and build.
fn rows(scene: &Path, out: &Path) -> (Vec<Row>, String) {
    study(scene, out, &[]);
    let least = smallest_bound(out);
    assert!(least.is_finite(), "{}: no sample has an error for all quantities", scene.display());
    let (mut all, mut build) = (Vec::<Row>::new(), String::new());
    for times in TARGETS {
        let target = format!("{}%", (100.0 * times * least).min(990.0));
        study(scene, out, &["--target-error", &target]);
        let text = std::fs::read_to_string(out.join("target-error.json")).expect("advice");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        build = json["build"].as_str().expect("a build").into();
        let sample = json["sample"].as_str().expect("a sample");
        // The same sample for both targets counts once.
        if all.iter().any(|r| r.sample == sample) {
            continue;
        }
        let number = |v: &Value, key: &str| v[key].as_f64().expect("a number");
        all.extend(json["verified"].as_array().expect("verified").iter().map(|v| Row {
            scene: scene.file_stem().expect("a name").to_string_lossy().into_owned(),
            sample: sample.into(),
            quantity: v["quantity"].as_str().expect("a name").into(),
            error: number(v, "error"),
            band: number(v, "band"),
            true_error: number(v, "true_error"),
            held: v["held"].as_bool().expect("a flag"),
        }));
    }
    (all, build)
}

/// A ratio as percentage with three digits.
fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value >= 0.01 { format!("{value:.2}") } else { format!("{value:.1e}") }
}

/// Ratio of bounds to true errors: a bound that is too large always holds, but is of no use.
fn width(rows: &[Row]) -> String {
    let mut times: Vec<f64> = rows.iter().map(|r| (r.error + r.band) / r.true_error.max(1e-9)).collect();
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    format!(
        "The bound (error plus uncertainty) is {:.1} times the true error in the median; interquartile range {:.1} to {:.1}.",
        at(0.5),
        at(0.25),
        at(0.75)
    )
}

fn table(rows: &[Row], build: &str) -> String {
    let held = rows.iter().filter(|r| r.held).count();
    let mut text = format!(
        "`scripts/adviser`, {}: {held} of {} true errors are within their bounds. {}\n\n\
         | scene | recommended sample | quantity | estimated error, % | true error, % | within bound |\n|---|---|---|---:|---:|---|\n",
        build,
        rows.len(),
        width(rows)
    );
    for r in rows {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} ± {} | {} | {} |",
            r.scene,
            r.sample,
            r.quantity,
            percent(r.error),
            percent(r.band),
            percent(r.true_error),
            if r.held { "yes" } else { "no" }
        );
    }
    text
}

/// Writes the table to docs/records/accuracy.md.
fn write(table: &str) {
    let file = root().join("docs/records/accuracy.md");
    let text = std::fs::read_to_string(&file).expect("docs/records/accuracy.md");
    let (head, rest) = text.split_once(MARKS[0]).expect("the first mark");
    let (_, tail) = rest.split_once(MARKS[1]).expect("the second mark");
    let text = format!("{head}{}{table}{}{tail}", MARKS[0], MARKS[1]);
    std::fs::write(file, text).expect("written");
}

#[test]
#[ignore = "nightly: 6 minutes"]
fn true_errors_are_within_their_bounds() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder =
        std::env::var_os("ADVISER_OUT").map_or_else(|| temporary.path().to_path_buf(), PathBuf::from);
    let scenes = scenes();
    assert!(scenes.len() >= 6);
    let (mut all, mut build) = (Vec::new(), String::new());
    for scene in &scenes {
        let (found, by) = rows(scene, &folder.join(scene.file_stem().expect("a name")));
        all.extend(found);
        build = by;
    }
    let table = table(&all, &build);
    println!("{table}");
    if std::env::var_os("RIPSTOP_WRITE").is_some() {
        write(&table);
    }
    let held = all.iter().filter(|r| r.held).count();
    assert!(all.len() >= HELD.1, "{} quantities are too few", all.len());
    assert!(held * HELD.1 >= all.len() * HELD.0, "only {held} of {} bounds hold:\n{table}", all.len());
}
