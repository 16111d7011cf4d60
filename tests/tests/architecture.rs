//! Dependencies point one way, and two libraries are named in one place each.

use std::collections::BTreeMap;
use std::process::Command;

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
const SHARED: [&str; 5] = ["case", "comm", "mesh", "linalg", "channel"];

#[test]
fn no_program_depends_on_another_and_no_shared_crate_on_a_program() {
    let all = dependencies();
    for name in PROGRAMS.iter().chain(&SHARED) {
        let named = all.get(*name).unwrap_or_else(|| panic!("package {name} is missing"));
        let programs: Vec<_> = named.iter().filter(|d| PROGRAMS.contains(&d.as_str())).collect();
        assert!(programs.is_empty(), "{name} depends on {programs:?}");
    }
    assert!(!all["coupler"].iter().any(|d| d == "comm" || d == "mpi"), "the coupler is no MPI program");
}

#[test]
fn mpi_and_iceoryx2_are_named_in_one_crate_each() {
    for (package, dependencies) in dependencies() {
        let names = |what: &str| dependencies.iter().any(|d| d.starts_with(what));
        assert!(!names("mpi") || package == "comm", "{package} depends on mpi");
        assert!(!names("iceoryx2") || package == "channel", "{package} depends on iceoryx2");
    }
}

#[test]
fn only_the_transport_module_names_iceoryx2() {
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
