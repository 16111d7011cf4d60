//! Dependencies between crates are layered, and four libraries are each used in one crate.

use std::collections::BTreeMap;
use std::process::Command;

use ripstop_tests::imports::circles_between_folders;
use ripstop_tests::root;

fn dependencies() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let packages = text["packages"].as_array().expect("packages");
    packages
        .iter()
        .map(|p| {
            let normal = p["dependencies"].as_array().expect("dependencies").iter();
            let names = normal
                .filter(|d| d["kind"].is_null())
                .map(|d| d["name"].as_str().expect("a name").to_owned())
                .collect();
            (p["name"].as_str().expect("a name").to_owned(), names)
        })
        .collect()
}

const PROGRAMS: [&str; 4] = ["structure-solver", "flow-solver", "mesh-mover", "coupler"];
const SHARED: [&str; 21] = [
    "canopies",
    "archive",
    "case",
    "comm",
    "mesh",
    "linalg",
    "channel",
    "coupling",
    "terminal",
    "results",
    "export",
    "figures",
    "effects",
    "report",
    "studies",
    "checks",
    "timing",
    "immersed",
    "gpu",
    "ripstop-participant",
    "ripstop-participant-c",
];

#[test]
fn programs_are_independent_and_shared_crates_use_no_program() {
    let all = dependencies();
    for name in PROGRAMS.iter().chain(&SHARED) {
        let named = all.get(*name).unwrap_or_else(|| panic!("package {name} is missing"));
        let programs: Vec<_> = named.iter().filter(|d| PROGRAMS.contains(&d.as_str())).collect();
        assert!(programs.is_empty(), "{name} depends on {programs:?}");
    }
    assert!(!all["coupler"].iter().any(|d| d == "comm" || d == "mpi"), "the coupler is no MPI program");
}

/// Allowed dependencies of the crates around the coupler, as in the table of ARCHITECTURE.md.
const LAYERS: [(&str, &[&str]); 17] = [
    ("canopies", &[]),
    ("archive", &[]),
    ("immersed", &[]),
    ("gpu", &["immersed"]),
    ("timing", &[]),
    ("channel", &["archive", "case", "timing"]),
    ("ripstop-participant", &["archive", "case", "channel"]),
    ("ripstop-participant-c", &["ripstop-participant"]),
    ("checks", &["case", "channel", "coupling", "effects", "immersed", "mesh", "results", "terminal"]),
    ("coupling", &["archive", "case", "channel", "mesh", "timing"]),
    ("terminal", &["case"]),
    ("results", &["archive", "case", "channel", "coupling", "terminal", "timing"]),
    ("effects", &["case", "coupling", "mesh"]),
    ("figures", &["case", "coupling", "mesh", "results", "terminal"]),
    ("export", &["case", "coupling", "figures", "mesh", "terminal"]),
    ("report", &["case", "coupling", "effects", "figures", "mesh", "results", "terminal"]),
    ("studies", &["case", "coupling", "effects", "figures", "mesh", "results", "terminal"]),
];

#[test]
fn crates_depend_on_lower_layers_only() {
    let all = dependencies();
    for (name, allowed) in LAYERS {
        let own = all[name].iter().filter(|d| SHARED.contains(&d.as_str()));
        let wrong: Vec<_> = own.filter(|d| !allowed.contains(&d.as_str())).collect();
        assert!(wrong.is_empty(), "{name} uses {wrong:?}");
    }
}

/// Schemes, descent and balances are pure computations; the coupler handles programs and files.
#[test]
fn coupling_crate_uses_no_process_and_no_file() {
    let mut stack = vec![root().join("crates/coupling/src")];
    while let Some(dir) = stack.pop() {
        for entry in std::fs::read_dir(dir).expect("sources").flatten() {
            let path = entry.path();
            if path.is_dir() {
                stack.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("text");
            for word in ["std::fs", "std::process", "std::env", "std::net", "println!"] {
                let code = text.split("#[cfg(test)]").next().unwrap_or("");
                let tests = path.to_string_lossy().ends_with("tests.rs");
                assert!(tests || !code.contains(word), "{}: {word}", path.display());
            }
        }
    }
}

#[test]
fn mpi_iceoryx2_bincode_and_hdf5_are_used_in_one_crate_each() {
    for (package, dependencies) in dependencies() {
        let names = |what: &str| dependencies.iter().any(|d| d.starts_with(what));
        assert!(!names("mpi") || package == "comm", "{package} depends on mpi");
        assert!(!names("iceoryx2") || package == "channel", "{package} depends on iceoryx2");
        assert!(!names("bincode") || package == "archive", "{package} depends on bincode");
        assert!(!names("rust-hdf5") || package == "export", "{package} depends on rust-hdf5");
    }
}

#[test]
fn only_the_transport_module_uses_iceoryx2() {
    let folder = root().join("crates/channel/src");
    let mut stack = vec![folder.clone()];
    let mut seen = 0;
    while let Some(dir) = stack.pop() {
        for entry in std::fs::read_dir(dir).expect("sources").flatten() {
            let path = entry.path();
            if path.is_dir() {
                stack.push(path);
                continue;
            }
            let inside = path.strip_prefix(&folder).expect("below the sources");
            let text = std::fs::read_to_string(&path).expect("text");
            let uses = text.lines().any(|l| !l.trim_start().starts_with("//") && l.contains("iceoryx2::"));
            seen += usize::from(uses);
            assert!(
                !uses || inside.starts_with("transport") || inside.starts_with("transport.rs"),
                "{inside:?}"
            );
        }
    }
    assert!(seen > 0, "the transport module was not found");
}

#[test]
fn no_import_cycle_between_folders() {
    let crates = std::fs::read_dir(root().join("crates")).expect("crates").flatten();
    let crates = crates.map(|e| format!("crates/{}", e.file_name().to_string_lossy()));
    let mut found = Vec::new();
    for name in PROGRAMS.map(str::to_owned).into_iter().chain(crates) {
        let circles = circles_between_folders(&root().join(&name).join("src"));
        found.extend(circles.into_iter().map(|files| (name.clone(), files)));
    }
    assert!(found.is_empty(), "files that need each other: {found:?}");
}

/// Files with `unsafe` code: system calls, MPI buffers, shared memory, pointers of C, and the counting allocator of tests.
const UNSAFE: [&str; 19] = [
    "coupler/src/allocator.rs",
    "coupler/src/launch/process.rs",
    "crates/channel/src/stalled_rank.rs",
    "crates/channel/src/watchdog.rs",
    "crates/channel/src/resume.rs",
    "crates/channel/src/session.rs",
    "crates/channel/src/transport.rs",
    "crates/channel/tests/failures.rs",
    "crates/comm/src/halo.rs",
    "crates/comm/src/time_slice.rs",
    "crates/gpu/src/lib.rs",
    "crates/immersed/tests/device.rs",
    "crates/linalg/benches/surface.rs",
    "crates/linalg/src/prefetch.rs",
    "crates/participant-c/src/pointers.rs",
    "flow-solver/src/allocator.rs",
    "mesh-mover/src/allocator.rs",
    "tests/src/counted.rs",
    "tests/src/spoil.rs",
];

#[test]
fn unsafe_code_is_in_listed_files_and_justified() {
    let mut stack = vec![root()];
    let mut found = Vec::new();
    while let Some(dir) = stack.pop() {
        for entry in std::fs::read_dir(dir).expect("sources").flatten() {
            let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
            if path.is_dir() {
                if !name.starts_with('.') && name != "target" && name != "runs" {
                    stack.push(path);
                }
                continue;
            }
            if path.extension().is_none_or(|e| e != "rs") {
                continue;
            }
            let inside = path.strip_prefix(root()).expect("below the root").display().to_string();
            let text = std::fs::read_to_string(&path).expect("text");
            let lines: Vec<&str> = text.lines().collect();
            // The keyword, concatenated so that this line does not contain it.
            let word = ["un", "safe "].concat();
            for (i, line) in lines.iter().enumerate() {
                let code = line.split("//").next().unwrap_or("");
                if !code.contains(&word) || code.contains('"') {
                    continue;
                }
                found.push(inside.clone());
                // A justification may cover a function; declarations need none.
                let near = lines[i.saturating_sub(6)..i].iter().any(|l| l.contains("SAFETY:"));
                let declares = ["fn ", "extern "].iter().any(|d| code.contains(&format!("{word}{d}")));
                assert!(near || declares, "{inside}:{}: no SAFETY comment: {line}", i + 1);
            }
        }
    }
    found.sort();
    found.dedup();
    let new: Vec<_> = found.iter().filter(|f| !UNSAFE.contains(&f.as_str())).collect();
    assert!(new.is_empty(), "{new:?} are not among the named files");
    let gone: Vec<_> = UNSAFE.iter().filter(|f| !found.iter().any(|g| g == *f)).collect();
    assert!(gone.is_empty(), "{gone:?} need no longer be named");
}
