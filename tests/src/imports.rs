//! Import graph between the files of a crate, and its cycles.
//!
//! A `pub use` re-exports an item: an import counts as an import from the file that defines the item. Tests are excluded.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A cycle: files of a crate that depend on each other.
pub type Circle = BTreeSet<String>;

/// A file of a crate as a module.
#[derive(Default)]
struct Module {
    /// Path below the sources.
    file: PathBuf,
    /// Child modules in separate files.
    children: BTreeSet<String>,
    /// Names of the items it defines.
    items: BTreeSet<String>,
    /// Imports: name (or `*`) and path.
    imports: Vec<(String, Vec<String>)>,
    /// Re-exported imports.
    exports: Vec<(String, Vec<String>)>,
    /// Paths used in the code.
    paths: Vec<Vec<String>>,
}

/// Modules of a crate by their paths.
type Modules = BTreeMap<Vec<String>, Module>;

/// Import cycles between files of different folders, in the sources `src` of a crate.
///
/// # Panics
/// A source cannot be read.
pub fn circles_between_folders(src: &Path) -> Vec<Circle> {
    circles(src).into_iter().filter(|(_, folders)| folders.len() > 1).map(|(circle, _)| circle).collect()
}

/// All import cycles between files, with their folders. The file of a module belongs to the folder of its children.
///
/// # Panics
/// A source cannot be read.
pub fn circles(src: &Path) -> Vec<(Circle, BTreeSet<PathBuf>)> {
    let modules = modules(src);
    let needs: BTreeMap<&Vec<String>, BTreeSet<Vec<String>>> =
        modules.iter().map(|(path, module)| (path, needs(&modules, path, module))).collect();
    let reach: BTreeMap<&Vec<String>, BTreeSet<Vec<String>>> =
        needs.keys().map(|from| (*from, reachable(&needs, from))).collect();
    let mut found: Vec<(Circle, BTreeSet<PathBuf>)> = Vec::new();
    for (path, reached) in &reach {
        if !reached.contains(*path) {
            continue;
        }
        let circle: Vec<_> = reached.iter().filter(|other| reach[other].contains(*path)).collect();
        let files = circle.iter().map(|p| modules[*p].file.display().to_string()).collect();
        let folders = circle.iter().map(|p| folder(p, &modules[*p])).collect();
        if circle.len() > 1 && !found.iter().any(|(known, _)| *known == files) {
            found.push((files, folders));
        }
    }
    found
}

fn folder(path: &[String], module: &Module) -> PathBuf {
    let parent = if module.children.is_empty() { &path[..path.len().saturating_sub(1)] } else { path };
    parent.iter().collect()
}

fn reachable(
    needs: &BTreeMap<&Vec<String>, BTreeSet<Vec<String>>>,
    from: &[String],
) -> BTreeSet<Vec<String>> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from.to_vec()]);
    while let Some(path) = open.pop() {
        for next in &needs[&path] {
            if reached.insert(next.clone()) {
                open.push(next.clone());
            }
        }
    }
    reached
}

/// Modules whose items the code of `module` names.
fn needs(modules: &Modules, path: &[String], module: &Module) -> BTreeSet<Vec<String>> {
    let mut found = BTreeSet::new();
    let exported: BTreeSet<_> = module.exports.iter().collect();
    let mut scope: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for import in module.imports.iter().filter(|i| !exported.contains(i)) {
        match locate(modules, path, &import.1, 0) {
            // Items of an imported module are found where they are used.
            Some(Found::Module(of)) if import.0 != "*" => drop(scope.insert(&import.0, of)),
            Some(Found::Module(of) | Found::Item(of)) => drop(found.insert(of)),
            None => {}
        }
    }
    for named in &module.paths {
        let located = match scope.get(named[0].as_str()) {
            Some(of) => walk(modules, of.clone(), &named[1..], 0),
            None => locate(modules, path, named, 0),
        };
        if let Some(Found::Module(of) | Found::Item(of)) = located {
            found.insert(of);
        }
    }
    found.remove(path);
    found
}

enum Found {
    Module(Vec<String>),
    /// In this module.
    Item(Vec<String>),
}

/// Resolves the path `named` in the module `at`; `None` for another crate.
fn locate(modules: &Modules, at: &[String], named: &[String], depth: usize) -> Option<Found> {
    let (mut start, mut rest) = match named[0].as_str() {
        "crate" => (Vec::new(), &named[1..]),
        "self" => (at.to_vec(), &named[1..]),
        "super" => (at[..at.len().checked_sub(1)?].to_vec(), &named[1..]),
        child if modules[at].children.contains(child) => (at.to_vec(), named),
        _ => return None,
    };
    while rest.first().is_some_and(|r| r == "super") {
        start.pop();
        rest = &rest[1..];
    }
    walk(modules, start, rest, depth)
}

/// Resolves `rest` from the module `at`, through re-exports.
fn walk(modules: &Modules, mut at: Vec<String>, rest: &[String], depth: usize) -> Option<Found> {
    for (k, name) in rest.iter().enumerate() {
        let module = modules.get(&at)?;
        if module.children.contains(name) {
            at.push(name.clone());
            continue;
        }
        if name == "*" || module.items.contains(name) || depth > 8 {
            return Some(Found::Item(at));
        }
        let follow = |path: &[String]| locate(modules, &at, &[path, &rest[k + 1..]].concat(), depth + 1);
        if let Some((_, path)) = module.imports.iter().find(|(n, _)| n == name) {
            return follow(path);
        }
        let globs = module.imports.iter().filter(|(n, _)| n == "*").map(|(_, path)| path);
        for path in globs {
            let path = [&path[..path.len() - 1], &rest[k..k + 1]].concat();
            if let Some(Found::Item(of)) = locate(modules, &at, &path, depth + 1)
                && modules[&of].items.contains(name)
            {
                return Some(Found::Item(of));
            }
        }
        return Some(Found::Item(at));
    }
    Some(Found::Module(at))
}

fn modules(src: &Path) -> Modules {
    let mut all = Modules::new();
    let mut folders = vec![src.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for file in std::fs::read_dir(&folder).expect("sources").flatten().map(|e| e.path()) {
            let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
            let test = name == "tests" || name.ends_with("_tests") || name == "bin";
            if test || name == "main" {
                continue;
            }
            if file.is_dir() {
                folders.push(file);
            } else if file.extension().is_some_and(|e| e == "rs") {
                let inside = file.strip_prefix(src).expect("below the sources").with_extension("");
                let mut path: Vec<String> =
                    inside.iter().map(|part| part.to_string_lossy().into_owned()).collect();
                path.pop_if(|last| last == "mod" || last == "lib");
                let text = std::fs::read_to_string(&file).expect("text");
                let file = file.strip_prefix(src).expect("below the sources").to_path_buf();
                all.insert(path, Module { file, ..read(&tokens(&text)) });
            }
        }
    }
    let paths: Vec<Vec<String>> = all.keys().filter(|p| !p.is_empty()).cloned().collect();
    for mut path in paths {
        let name = path.pop().expect("a name");
        if let Some(parent) = all.get_mut(&path) {
            parent.children.insert(name);
        }
    }
    all
}

/// Imports, items and paths of a file.
fn read(tokens: &[String]) -> Module {
    let mut module = Module::default();
    let at = |i: usize| tokens.get(i).map_or("", String::as_str);
    let mut i = 0;
    while i < tokens.len() {
        match at(i) {
            "#" if tokens[i..].iter().take(7).any(|t| t == "test") && at(i + 2) == "cfg" => {
                i = end_of_item(tokens, i);
                continue;
            }
            "use" if at(i + 1) != "<" => {
                let public = i > 0 && matches!(at(i - 1), "pub" | ")");
                let mut found = Vec::new();
                i = tree(tokens, i + 1, &[], &mut found);
                if public {
                    module.exports.extend(found.iter().cloned());
                }
                module.imports.extend(found);
                continue;
            }
            "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union" | "mod" => {
                module.items.insert(at(i + 1).to_owned());
            }
            word if is_word(word) && at(i + 1) == "::" && (i == 0 || at(i - 1) != "::") => {
                let mut path = vec![word.to_owned()];
                while at(i + 1) == "::" && is_word(at(i + 2)) {
                    path.push(at(i + 2).to_owned());
                    i += 2;
                }
                module.paths.push(path);
            }
            _ => {}
        }
        i += 1;
    }
    module
}

/// Index after the item with the attribute at `i`.
fn end_of_item(tokens: &[String], i: usize) -> usize {
    let mut depth = 0;
    for (k, token) in tokens.iter().enumerate().skip(i) {
        match token.as_str() {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth -= 1,
            _ => {}
        }
        if depth == 0 && matches!(token.as_str(), "}" | ";") {
            return k + 1;
        }
    }
    tokens.len()
}

/// Reads a `use` tree at `i`, below `prefix`; returns the index after it.
fn tree(tokens: &[String], mut i: usize, prefix: &[String], found: &mut Vec<(String, Vec<String>)>) -> usize {
    let mut path = prefix.to_vec();
    while i < tokens.len() {
        match tokens[i].as_str() {
            "::" => {}
            "{" => {
                i += 1;
                while tokens[i] != "}" {
                    i = tree(tokens, i, &path, found);
                    if tokens[i] == "," {
                        i += 1;
                    }
                }
                return i + 1;
            }
            "as" => {
                found.push((tokens[i + 1].clone(), path));
                return i + 2;
            }
            "," | "}" | ";" => break,
            "self" if !path.is_empty() => {}
            word => path.push(word.to_owned()),
        }
        i += 1;
    }
    if let Some(name) = path.last() {
        found.push((name.clone(), path.clone()));
    }
    i
}

fn is_word(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Tokens of a source, without comments and string and character literals.
fn tokens(text: &str) -> Vec<String> {
    let letters: Vec<char> = text.chars().collect();
    let at = |i: usize| letters.get(i).copied().unwrap_or('\0');
    let (mut all, mut i) = (Vec::new(), 0);
    while i < letters.len() {
        let start = i;
        match letters[i] {
            '/' if at(i + 1) == '/' => i += letters[i..].iter().take_while(|c| **c != '\n').count(),
            '/' if at(i + 1) == '*' => {
                while i < letters.len() && !(at(i) == '*' && at(i + 1) == '/') {
                    i += 1;
                }
                i += 2;
            }
            'r' if at(i + 1) == '"' || (at(i + 1) == '#' && matches!(at(i + 2), '"' | '#')) => {
                let marks = letters[i + 1..].iter().take_while(|c| **c == '#').count();
                i += marks + 2;
                while i < letters.len()
                    && !(at(i) == '"'
                        && letters[i + 1..].iter().take(marks).filter(|c| **c == '#').count() == marks)
                {
                    i += 1;
                }
                i += marks + 1;
            }
            '"' => {
                i += 1;
                while i < letters.len() && at(i) != '"' {
                    i += if at(i) == '\\' { 2 } else { 1 };
                }
                i += 1;
            }
            // A character literal, not a lifetime.
            '\'' if at(i + 1) == '\\' || at(i + 2) == '\'' => {
                i += if at(i + 1) == '\\' { 3 } else { 2 };
                while i < letters.len() && at(i) != '\'' {
                    i += 1;
                }
                i += 1;
            }
            c if c.is_alphanumeric() || c == '_' => {
                i += letters[i..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
                all.push(letters[start..i].iter().collect());
            }
            ':' if at(i + 1) == ':' => {
                i += 2;
                all.push("::".into());
            }
            c => {
                i += 1;
                if !c.is_whitespace() {
                    all.push(c.to_string());
                }
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycles of a crate with these files.
    fn found(files: &[(&str, &str)]) -> Vec<Circle> {
        let src = tempfile::tempdir().expect("a folder");
        for (file, text) in files {
            let path = src.path().join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, text).expect("a file");
        }
        circles_between_folders(src.path())
    }

    #[test]
    fn import_cycle_is_found_through_reexports() {
        let [lib, a] = [("lib.rs", "mod a; mod b;"), ("a/mod.rs", "mod one; pub use one::One;")];
        let one = ("a/one.rs", "use crate::b::Two; pub struct One(Two);");
        let circle = found(&[lib, a, one, ("b.rs", "use crate::a::One; pub struct Two(Box<One>);")]);
        assert_eq!(circle, [Circle::from(["a/one.rs".into(), "b.rs".into()])]);
        let paths = found(&[lib, a, one, ("b.rs", "pub struct Two(Option<&'static crate::a::One>);")]);
        assert_eq!(paths, circle);
    }

    #[test]
    fn reexports_texts_and_tests_are_no_import_cycles() {
        let files = [
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "mod one; pub use one::One; pub struct Three;"),
            ("a/one.rs", "use super::Three; use crate::b::{self, Two}; pub struct One(Two, b::Two, Three);"),
            (
                "b.rs",
                "pub struct Two; /* crate::a */ const T: &str = \"crate::a::One\"; \
                      #[cfg(test)] mod tests { use crate::a::One; }",
            ),
        ];
        assert_eq!(found(&files), Vec::<Circle>::new());
    }
}
