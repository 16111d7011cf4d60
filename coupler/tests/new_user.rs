//! Scenes as a new user writes them, each with one mistake: `ripstop check` answers each with the right
//! sentence, and with no finding that does not belong to the mistake.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

const SCENES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenes/new-user");

/// What `expected.toml` beside a scene says.
struct Expected {
    /// Exit code of `ripstop check`.
    exit: i32,
    /// All errors and warnings, as `error fabric.thickness`; of those that depend on the machine none.
    findings: BTreeSet<String>,
    /// Parts of what is said.
    sentences: Vec<String>,
}

fn expected(folder: &Path) -> Expected {
    let file = folder.join("expected.toml");
    let text = std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let table: toml::Table = text.parse().unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let list = |key: &str| {
        let values = table[key].as_array().expect("an array").iter();
        values.map(|v| v.as_str().expect("a string").to_owned()).collect::<Vec<_>>()
    };
    Expected {
        exit: table["exit"].as_integer().expect("a number") as i32,
        findings: list("findings").into_iter().collect(),
        sentences: list("sentences"),
    }
}

fn folders() -> Vec<PathBuf> {
    let all = std::fs::read_dir(SCENES).expect("the scenes").flatten().map(|e| e.path());
    let mut all: Vec<_> = all.filter(|p| p.is_dir()).collect();
    all.sort();
    all
}

/// Exit code and all that `ripstop check` prints; one rank of each program, so that no finding depends on
/// the machine.
fn check(scene: &Path) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_ripstop"))
        .arg("check")
        .arg(scene)
        .args(["--ranks", "structure=1,flow=1,mesh=1"])
        .output()
        .expect("the program starts");
    let text = [out.stdout, out.stderr].map(|s| String::from_utf8_lossy(&s).into_owned()).join("\n");
    (out.status.code().unwrap_or(-1), text)
}

/// `error fabric.thickness` for each error and warning of the inspection.
fn findings(text: &str) -> BTreeSet<String> {
    let line = |l: &str| {
        let (severity, rest) = l.trim().split_once(": ")?;
        let id = rest.rsplit_once('[')?.1.strip_suffix(']')?;
        // Refusals of the schema name tables in brackets; identifiers have a dot.
        (["error", "warning"].contains(&severity) && id.contains('.')).then(|| format!("{severity} {id}"))
    };
    text.lines().filter_map(line).collect()
}

#[test]
fn each_mistake_is_answered_by_its_sentence_and_by_nothing_else() {
    let mut wrong = Vec::new();
    let folders = folders();
    assert!(folders.len() > 12, "{folders:?}");
    for folder in &folders {
        let name = folder.file_name().expect("a name").to_string_lossy().into_owned();
        let wanted = expected(folder);
        let (exit, text) = check(&folder.join("scene.toml"));
        let found = findings(&text);
        if exit != wanted.exit || found != wanted.findings {
            wrong.push(format!(
                "{name}: exit {exit}, {found:?}, wanted {} {:?}",
                wanted.exit, wanted.findings
            ));
        }
        for sentence in wanted.sentences.iter().filter(|s| !text.contains(s.as_str())) {
            wrong.push(format!("{name}: no {sentence:?} in\n{text}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `ripstop run` of a scene of this folder with a program that does not exist: exit code and all that it says.
fn run(name: &str, out: &Path) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_ripstop"))
        .arg("run")
        .arg(Path::new(SCENES).join(name).join("scene.toml"))
        .arg("--out")
        .arg(out)
        .args(["--ranks", "structure=1,flow=1,mesh=1", "--structure", "/no/such-solver"])
        .output()
        .expect("the program starts");
    (output.status.code().unwrap_or(-1), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Errors end a run before anything is written or started; warnings are said before a program is looked for.
#[test]
fn a_run_is_inspected_before_it_starts() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let (exit, text) = run("thickness-in-mm", &out);
    assert_eq!(exit, 2, "{text}");
    assert!(text.contains("the fabric is 50.0 mm thick") && !text.contains("such-solver"), "{text}");
    assert!(!out.exists(), "{text}");
    let (exit, text) = run("too-few-cells", &out);
    assert_ne!(exit, 0, "{text}");
    let warned = text.find("about 6 cells across the canopy").expect("a warning");
    assert!(warned < text.find("such-solver").expect("an error"), "{text}");
}

/// The remedy for lines that cross: one attachment for each line, in the order of the rim.
#[test]
fn lines_no_longer_cross_once_the_remedy_is_followed() {
    let folder = Path::new(SCENES).join("crossing-lines");
    let text = std::fs::read_to_string(folder.join("scene.toml")).expect("the scene");
    let (head, rest) = text.split_once("attachments_m = ").expect("attachments");
    let tail = rest.split_once('\n').expect("more lines").1;
    let ends = rim_order(&folder.join("scene.toml"));
    let listed: Vec<String> = ends.iter().map(|[x, y]| nearest(*x, *y)).collect();
    let mended = format!("{head}attachments_m = [{}]\n{tail}", listed.join(", "));
    let out = tempfile::tempdir().expect("a folder");
    let file = out.path().join("scene.toml");
    std::fs::write(&file, mended).expect("written");
    let (_, text) = check(&file);
    assert!(!text.contains("cross each other"), "{text}");
}

/// Horizontal places of the lines' ends at the rim, in the order in which lines take attachments.
fn rim_order(scene: &Path) -> Vec<[f64; 2]> {
    let mut scene = case::load(scene).expect("a scene");
    scene.descent.as_mut().expect("a descent").body = None;
    let mesh = mesh::structure_mesh(&scene).expect("a mesh");
    mesh.cables.iter().map(|c| mesh.coords[c.nodes[0] as usize]).map(|[x, y, _]| [x, y]).collect()
}

/// The one of four attachments on the axes that is on the side of a point.
fn nearest(x: f64, y: f64) -> String {
    let (px, py) = if x.abs() >= y.abs() { (0.2 * x.signum(), 0.0) } else { (0.0, 0.2 * y.signum()) };
    format!("[{px:.1}, {py:.1}, 0.2]")
}
