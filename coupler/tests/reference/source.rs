//! What Rust sources say about structs and errors: fields, variants and their doc comments, as `rustfmt` lays them out.

use std::path::{Path, PathBuf};

use super::markdown::root;

/// A field of a struct, or a variant of an enum.
#[derive(Debug)]
pub struct Member {
    pub name: String,
    /// Type of a field.
    pub of: String,
    pub text: String,
    /// Attributes in front of it.
    pub attributes: String,
}

/// Text of a source file of the repository.
pub fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Rust files below the folders that hold the programs' sources.
pub fn rust_files() -> Vec<PathBuf> {
    fn below(folder: &Path, found: &mut Vec<PathBuf>) {
        for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
            if path.is_dir() {
                below(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    let crates = std::fs::read_dir(root().join("crates")).expect("crates").flatten().map(|e| e.path());
    let programs = ["structure-solver", "flow-solver", "mesh-mover", "coupler"].map(|p| root().join(p));
    crates.chain(programs).for_each(|folder| below(&folder.join("src"), &mut found));
    found.sort();
    found
}

/// Lines between the braces of `item`, such as `pub struct Machine`.
fn body<'a>(source: &'a str, item: &str) -> Vec<&'a str> {
    let mut lines = source.lines().skip_while(|l| !l.starts_with(&format!("{item} {{")));
    assert!(lines.next().is_some(), "no `{item}`");
    lines.take_while(|l| *l != "}").collect()
}

/// Fields or variants of `item`: those at one level of indentation.
pub fn members(source: &str, item: &str) -> Vec<Member> {
    let (mut found, mut text, mut attributes) = (Vec::new(), String::new(), String::new());
    let mut in_attribute = false;
    for line in body(source, item) {
        let inner = line.trim();
        if in_attribute || line.starts_with("    #[") {
            attributes += inner.trim_end_matches('\\');
            attributes.push(' ');
            in_attribute = !(inner.ends_with(")]") || inner == "]" && line.starts_with("    ]"));
        } else if let Some(doc) = line.strip_prefix("    ///") {
            text += doc;
        } else if line.starts_with("    ") && !line.starts_with("     ") && !inner.starts_with('}') {
            let declared = inner.trim_start_matches("pub ").trim_end_matches(',');
            let name = declared.split([':', '(', ' ', '{']).next().unwrap_or_default();
            let of = declared.split_once(": ").map_or("", |(_, of)| of);
            found.push(Member {
                name: name.to_owned(),
                of: of.to_owned(),
                text: std::mem::take(&mut text).trim().to_owned(),
                attributes: std::mem::take(&mut attributes),
            });
        }
    }
    found
}

#[test]
fn members_are_read_with_their_comments() {
    let source = "pub enum E {\n    /// One\n    /// thing.\n    #[error(\n        \"a {b}\"\n    )]\n    One {\n        /// b\n        \
                  b: u8,\n    },\n    /// Two.\n    #[error(\"c\")]\n    Two(String),\n}\npub struct S {\n    /// A.\n    \
                  pub a: Vec<f64>,\n}\n";
    let all = members(source, "pub enum E");
    assert_eq!(
        all.iter().map(|m| (m.name.as_str(), m.text.as_str())).collect::<Vec<_>>(),
        [("One", "One thing."), ("Two", "Two.")]
    );
    assert!(all[0].attributes.contains("a {b}") && all[1].attributes.contains("#[error(\"c\")]"), "{all:?}");
    let fields = members(source, "pub struct S");
    assert_eq!((fields[0].name.as_str(), fields[0].of.as_str()), ("a", "Vec<f64>"));
}
