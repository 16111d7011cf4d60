//! Files of this crate import each other without cycles.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Modules of the crate with their files: `a::b` for `src/a/b.rs` and `src/a/b/mod.rs`.
fn modules() -> BTreeMap<String, PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut stack, mut all) = (vec![source.clone()], BTreeMap::new());
    while let Some(folder) = stack.pop() {
        for entry in std::fs::read_dir(folder).expect("sources").flatten() {
            let path = entry.path();
            if path.is_dir() {
                stack.push(path);
                continue;
            }
            let inside = path.strip_prefix(&source).expect("below the sources").with_extension("");
            let mut names: Vec<_> = inside.iter().map(|n| n.to_string_lossy().into_owned()).collect();
            if names.last().is_some_and(|n| n == "mod" || n == "lib") {
                names.pop();
            }
            all.insert(names.join("::"), path);
        }
    }
    all
}

/// Code without comments and without the tests at its end.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]").next().unwrap_or("");
    text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// The paths of a `use` tree: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn paths(tree: &str) -> Vec<String> {
    let Some(open) = tree.find('{') else { return vec![tree.trim().to_owned()] };
    let (head, inner) =
        (tree[..open].trim(), tree[open + 1..tree.rfind('}').expect("a closed brace")].trim());
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for c in inner.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(String::new());
                continue;
            }
            _ => {}
        }
        parts.last_mut().expect("a part").push(c);
    }
    let parts = parts.iter().filter(|p| !p.trim().is_empty());
    parts.flat_map(|p| paths(p)).map(|p| format!("{head}{p}")).collect()
}

/// All paths in the code of a file: imports, and paths from `crate` or `super` in its body.
fn named(code: &str) -> Vec<String> {
    let mut all = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find("use ") {
        let before = rest[..at].chars().next_back();
        let tail = &rest[at + 4..];
        if before.is_none_or(|c| c == '\n' || c == ' ')
            && let Some(end) = tail.find(';')
        {
            all.extend(paths(&tail[..end]));
        }
        rest = tail;
    }
    // Paths from an imported module.
    let modules: Vec<String> = all.iter().filter(|path| path.contains("::")).cloned().collect();
    for import in modules {
        let name = import.rsplit("::").next().unwrap_or_default();
        for at in code.match_indices(&format!("{name}::")).map(|(at, _)| at) {
            let before = code[..at].chars().next_back();
            if before.is_none_or(|c| !c.is_alphanumeric() && c != '_' && c != ':') {
                let end = code[at..].find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':');
                let path = &code[at + name.len()..at + end.unwrap_or(code.len() - at)];
                all.push(format!("{import}{}", path.trim_end_matches(':')));
            }
        }
    }
    for start in ["crate::", "super::"] {
        let mut rest = code;
        while let Some(at) = rest.find(start) {
            let end = rest[at..].find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':');
            let path = &rest[at..at + end.unwrap_or(rest.len() - at)];
            all.push(path.trim_end_matches(':').to_owned());
            rest = &rest[at + path.len()..];
        }
    }
    all
}

/// The module file of the longest prefix of `path`, as written in the module `from`.
fn resolve(path: &str, from: &str, modules: &BTreeMap<String, PathBuf>) -> Option<String> {
    let mut at: Vec<&str> = from.split("::").filter(|n| !n.is_empty()).collect();
    let mut names: Vec<&str> = path.split("::").map(str::trim).collect();
    match names.first() {
        Some(&"crate") => at.clear(),
        Some(&"super" | &"self") => {}
        // A child module where one exists; another crate otherwise.
        Some(first) => {
            let child = at.iter().chain([first]).copied().collect::<Vec<_>>().join("::");
            modules.get(&child)?;
        }
        None => return None,
    }
    while let Some(first) = names.first() {
        match *first {
            "super" => {
                at.pop();
            }
            "crate" | "self" => {}
            name => {
                let child = at.iter().copied().chain([name]).collect::<Vec<_>>().join("::");
                if !modules.contains_key(&child) {
                    break;
                }
                at.push(name);
            }
        }
        names.remove(0);
    }
    Some(at.join("::"))
}

/// Imports of each file; re-exports of a `mod.rs` are imports of it.
fn graph() -> BTreeMap<String, BTreeSet<String>> {
    let modules = modules();
    let tests = |name: &str| name.ends_with("tests") || name.ends_with("test_support");
    let mut graph = BTreeMap::new();
    for (name, path) in modules.iter().filter(|(name, _)| !tests(name)) {
        let text = code(&std::fs::read_to_string(path).expect("text"));
        let used = named(&text).into_iter().filter_map(|path| resolve(&path, name, &modules));
        graph.insert(name.clone(), used.filter(|other| other != name && !tests(other)).collect());
    }
    graph
}

/// Removes files without remaining imports repeatedly; the rest is a cycle or depends on one.
fn circles(mut graph: BTreeMap<String, BTreeSet<String>>) -> BTreeMap<String, BTreeSet<String>> {
    loop {
        let free: Vec<String> =
            graph.iter().filter(|(_, used)| used.is_empty()).map(|(name, _)| name.clone()).collect();
        if free.is_empty() {
            return graph;
        }
        for name in &free {
            graph.remove(name);
        }
        graph.values_mut().for_each(|used| used.retain(|other| !free.contains(other)));
    }
}

#[test]
fn imports_have_no_cycles() {
    let graph = graph();
    assert!(graph.len() > 50, "{} files", graph.len());
    let uses = |name: &str, other: &str| graph[name].contains(other);
    assert!(uses("schemes::window::window_loop", "schemes::window::scheme"));
    assert!(uses("schemes", "schemes::build") && uses("schemes::build", "schemes::sequences::jacobi"));
    let circles = circles(graph);
    assert!(circles.is_empty(), "circles of imports: {circles:#?}");
}

#[test]
fn cycle_is_detected() {
    let set = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
    let graph = [("a", set(&["b"])), ("b", set(&["a"])), ("c", set(&[])), ("d", set(&["c"]))];
    let found = circles(graph.map(|(name, used)| (name.to_owned(), used)).into());
    assert_eq!(found.into_keys().collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(paths("a::{b, c::{d, e}}"), ["a::b", "a::c::d", "a::c::e"]);
}
