//! Provenance of results: commit of the sources and build of the programs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use coupling::error::RunError;

use crate::program::program_folder;

/// The programs that results depend on, with the folders of their sources.
const PROGRAMS: [(&str, &str); 4] = [
    ("ripstop", "coupler/src/"),
    ("structure-solver", "structure-solver/src/"),
    ("flow-solver", "flow-solver/src/"),
    ("mesh-mover", "mesh-mover/src/"),
];

/// Version and checksums of the programs. It identifies the build of a result.
///
/// # Errors
/// The folder of the programs cannot be found.
pub fn build() -> Result<String, RunError> {
    let folder = program_folder()?;
    // A missing program is reported by the run that needs it.
    let sum = |name: &str| crc32fast::hash(&std::fs::read(folder.join(name)).unwrap_or_default());
    let sums: Vec<String> = PROGRAMS.iter().map(|(name, _)| format!("{:08x}", sum(name))).collect();
    Ok(format!("{} {}", env!("CARGO_PKG_VERSION"), sums.join(" ")))
}

/// The commit of the sources of the programs, with a note if sources were changed or are newer than the programs;
/// `unknown` outside the repository.
pub fn commit() -> String {
    program_folder().ok().and_then(|folder| commit_of(&folder)).unwrap_or_else(|| "unknown".into())
}

fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Files that identify this repository.
const MARKS: [&str; 2] = ["structure-solver/Cargo.toml", "coupler/src/run/mod.rs"];

fn commit_of(folder: &Path) -> Option<String> {
    let root = PathBuf::from(git(folder, &["rev-parse", "--show-toplevel"])?);
    // The programs may be in the repository of another project.
    if !MARKS.iter().all(|mark| root.join(mark).exists()) {
        return None;
    }
    let head = git(&root, &["rev-parse", "--short=10", "HEAD"])?;
    let sources = ["*/src/*.rs", "*Cargo.toml", "Cargo.lock"];
    let list = |first: &[&str]| git(&root, &[first, &["--"], &sources].concat());
    let changed = list(&["status", "--porcelain", "--untracked-files=no"])?;
    let files = list(&["ls-files"])?;
    let mut files = files.lines().filter(|f| f.ends_with(".rs") && !f.starts_with("tests/"));
    let newer = files.find(|f| is_newer(&root, f, folder));
    Some(match (changed.is_empty(), newer) {
        (true, None) => head,
        (false, None) => format!("{head} with changed sources"),
        (_, Some(file)) => format!("{head}, but {file} is newer than the programs"),
    })
}

/// Whether a source file is newer than its program. The sources of shared crates are compared with the newest program.
fn is_newer(root: &Path, file: &str, programs: &Path) -> bool {
    let built = |name: &str| modified(&programs.join(name));
    let own = PROGRAMS.iter().find(|(_, sources)| file.starts_with(sources));
    let built = match own {
        Some((name, _)) => built(name),
        None => PROGRAMS.iter().filter_map(|(name, _)| built(name)).max(),
    };
    matches!((modified(&root.join(file)), built), (Some(source), Some(built)) if source > built)
}

fn modified(file: &Path) -> Option<SystemTime> {
    file.metadata().ok()?.modified().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_repository_is_recognised() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        MARKS.iter().for_each(|mark| assert!(root.join(mark).is_file(), "{mark}"));
    }

    #[test]
    fn commit_with_changed_or_newer_sources_is_marked() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        assert_eq!(commit_of(root), None);
        let write = |name: &str, text: &str| {
            let file = root.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        };
        let git = |arguments: &[&str]| {
            let all = [&["-c", "user.name=a", "-c", "user.email=a@b"], arguments].concat();
            git(root, &all).unwrap()
        };
        write("structure-solver/Cargo.toml", "");
        write("coupler/src/run/mod.rs", "// one");
        write(".gitignore", "target/\n");
        git(&["init", "--quiet"]);
        git(&["add", "."]);
        git(&["commit", "--quiet", "--message", "one"]);
        let head = git(&["rev-parse", "--short=10", "HEAD"]);
        PROGRAMS.iter().for_each(|(p, _)| write(&format!("target/release/{p}"), "program"));
        let built = || commit_of(&root.join("target/release")).unwrap();
        assert_eq!(built(), head);
        let past = SystemTime::now() - std::time::Duration::from_secs(60);
        write("coupler/src/run/mod.rs", "// two");
        let file = std::fs::File::options().write(true).open(root.join("coupler/src/run/mod.rs")).unwrap();
        file.set_modified(past).unwrap();
        assert_eq!(built(), format!("{head} with changed sources"));
        file.set_modified(SystemTime::now() + std::time::Duration::from_secs(60)).unwrap();
        assert!(built().contains("run/mod.rs is newer than the programs"));
    }
}
