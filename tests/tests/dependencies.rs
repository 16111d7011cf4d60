//! Dependencies comply with `deny.toml`: licences, sources and versions.
//!
//! `cargo deny` reads the same file; the nightly command runs it for known vulnerabilities and for platforms other than this one.

use std::path::{Path, PathBuf};
use std::process::Command;

use ripstop_tests::root;

/// Packages of the build on this platform.
fn packages() -> Vec<serde_json::Value> {
    let version = Command::new("rustc").arg("-vV").output().expect("rustc runs");
    let version = String::from_utf8(version.stdout).expect("text");
    let host = version.lines().find_map(|l| l.strip_prefix("host: ")).expect("a host");
    let options = ["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", host];
    let output = Command::new(env!("CARGO")).args(options).current_dir(root()).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    serde_json::from_value(text["packages"].take()).expect("packages")
}

fn deny() -> toml::Table {
    let text = std::fs::read_to_string(root().join("deny.toml")).expect("deny.toml");
    text.parse().expect("TOML")
}

/// Evaluates SPDX licence expressions for a list of allowed licences.
struct Expression<'a> {
    words: Vec<String>,
    at: usize,
    allowed: &'a [String],
}

impl<'a> Expression<'a> {
    /// # Errors
    /// The text is not an SPDX expression.
    fn allows(text: &str, allowed: &'a [String]) -> Result<bool, String> {
        // The deprecated form uses a slash for OR.
        let text = text.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
        let words = text.split_whitespace().map(String::from).collect();
        let mut this = Self { words, at: 0, allowed };
        let value = this.either()?;
        if this.at == this.words.len() {
            Ok(value)
        } else {
            Err(format!("left over: {:?}", &this.words[this.at..]))
        }
    }

    fn next_is(&mut self, word: &str) -> bool {
        let is = self.words.get(self.at).is_some_and(|w| w == word);
        self.at += usize::from(is);
        is
    }

    /// AND binds more tightly than OR.
    fn either(&mut self) -> Result<bool, String> {
        let mut value = self.both()?;
        while self.next_is("OR") {
            value |= self.both()?;
        }
        Ok(value)
    }

    fn both(&mut self) -> Result<bool, String> {
        let mut value = self.single()?;
        while self.next_is("AND") {
            value &= self.single()?;
        }
        Ok(value)
    }

    fn single(&mut self) -> Result<bool, String> {
        if self.next_is("(") {
            let value = self.either()?;
            return if self.next_is(")") { Ok(value) } else { Err("a parenthesis is not closed".into()) };
        }
        let mut licence = self.words.get(self.at).ok_or("a licence is missing")?.clone();
        self.at += 1;
        if self.next_is("WITH") {
            licence += &format!(" WITH {}", self.words.get(self.at).ok_or("an exception is missing")?);
            self.at += 1;
        }
        Ok(self.allowed.contains(&licence))
    }
}

#[test]
fn license_expressions_are_parsed() {
    let allowed = ["MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "Zlib"].map(String::from);
    for (text, value) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("GPL-3.0 OR MIT", true),
        ("GPL-3.0/MIT", true),
        ("GPL-3.0 AND MIT", false),
        ("MIT OR GPL-3.0 AND GPL-2.0", true),
        ("(MIT OR GPL-3.0) AND GPL-2.0", false),
        ("(MIT OR GPL-3.0) AND Zlib", true),
        ("Apache-2.0 WITH LLVM-exception", true),
        ("MIT WITH LLVM-exception", false),
    ] {
        assert_eq!(Expression::allows(text, &allowed), Ok(value), "{text}");
    }
    for text in ["", "MIT OR", "(MIT", "MIT Zlib", "MIT WITH"] {
        assert!(Expression::allows(text, &allowed).is_err(), "{text}");
    }
}

#[test]
fn licences_are_allowed() {
    let deny = deny();
    let allowed = deny["licenses"]["allow"].as_array().expect("a list");
    let allowed: Vec<String> = allowed.iter().map(|l| l.as_str().expect("text").to_owned()).collect();
    let packages = packages();
    assert!(packages.len() > 100, "{} packages", packages.len());
    for package in packages {
        let licence = package["license"].as_str().unwrap_or_default();
        let fits = Expression::allows(licence, &allowed);
        assert_eq!(fits, Ok(true), "{} {}: licence {licence:?}", package["name"], package["version"]);
    }
}

#[test]
fn packages_come_from_crates_io_or_the_workspace() {
    let sources = &deny()["sources"];
    assert_eq!([sources["unknown-registry"].as_str(), sources["unknown-git"].as_str()], [Some("deny"); 2]);
    // The lock file covers all platforms.
    let text = std::fs::read_to_string(root().join("Cargo.lock")).expect("Cargo.lock");
    let lock: toml::Table = text.parse().expect("TOML");
    let packages = lock["package"].as_array().expect("packages");
    let here: Vec<&str> = packages
        .iter()
        .filter_map(|p| match p.get("source").map(|s| s.as_str().expect("text")) {
            None => Some(p["name"].as_str().expect("a name")),
            Some(source) => {
                assert_eq!(source, "registry+https://github.com/rust-lang/crates.io-index", "{}", p["name"]);
                assert!(p.get("checksum").is_some(), "{} has no checksum", p["name"]);
                None
            }
        })
        .collect();
    // Packages without a source are members of the workspace.
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).expect("Cargo.toml");
    let manifest: toml::Table = manifest.parse().expect("TOML");
    let members = manifest["workspace"]["members"].as_array().expect("members");
    assert_eq!(here.len(), members.len(), "{here:?} and {members:?}");
}

#[test]
fn every_dependency_has_a_version() {
    assert_eq!(deny()["bans"]["wildcards"].as_str(), Some("deny"));
    for package in packages().iter().filter(|p| p["source"].is_null()) {
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let open = dependency["req"] == "*" && dependency["path"].is_null();
            assert!(!open, "{} takes any version of {}", package["name"], dependency["name"]);
        }
    }
}

/// Dependencies that no source uses (package, dependency, reason), such as those that only enable a feature.
const UNNAMED: &[(&str, &str, &str)] = &[];

/// Rust files below `folder`.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    entries.flat_map(|p| if p.is_dir() { files(&p) } else { vec![p] }).collect()
}

/// Whether a file below `src` contains unit tests only.
fn is_of_tests(file: &Path) -> bool {
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    name.ends_with("tests") || name == "test_support"
}

/// Code and unit tests of a file below `src`; the test module is the last item.
fn parts(text: &str) -> (String, String) {
    let lines = text.lines().map(|l| l.split("//").next().unwrap_or(""));
    let text = lines.collect::<Vec<_>>().join("\n");
    let start = text.match_indices("#[cfg(test)]\nmod ").find(|(at, _)| {
        let rest = &text[at + "#[cfg(test)]\n".len()..];
        rest.lines().next().is_some_and(|line| line.ends_with('{'))
    });
    match start {
        Some((at, _)) => (text[..at].to_owned(), text[at..].to_owned()),
        None => (text, String::new()),
    }
}

/// Sources of the package in `folder`: code, tests (with benches and examples) and build script.
fn sources(folder: &Path) -> [String; 3] {
    let [mut code, mut tests] = [String::new(), String::new()];
    for file in files(&folder.join("src")) {
        let (own, unit) = parts(&std::fs::read_to_string(&file).expect("text"));
        let kind = if is_of_tests(&file) { &mut tests } else { &mut code };
        *kind += &own;
        tests += &unit;
    }
    for file in ["tests", "benches", "examples"].iter().flat_map(|f| files(&folder.join(f))) {
        if file.extension().is_some_and(|e| e == "rs") {
            tests += &parts(&std::fs::read_to_string(&file).expect("text")).0;
        }
    }
    [code, tests, std::fs::read_to_string(folder.join("build.rs")).unwrap_or_default()]
}

/// Whether `text` uses the crate `name`: `name::...`, `use name;` or `use name as ...`.
fn uses(text: &str, name: &str) -> bool {
    let path = format!("{name}::");
    let begins =
        |at: usize| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':' || c == '.');
    text.match_indices(&path).any(|(at, _)| begins(at))
        || [";", " as "].iter().any(|end| text.contains(&format!("use {name}{end}")))
}

#[test]
fn every_dependency_is_used() {
    let mut unnamed = Vec::new();
    for package in packages().iter().filter(|p| p["source"].is_null()) {
        let manifest = Path::new(package["manifest_path"].as_str().expect("a path"));
        let sources = sources(manifest.parent().expect("a folder"));
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let kind = dependency["kind"].as_str().unwrap_or("normal");
            let source = ["normal", "dev", "build"].iter().position(|k| *k == kind).expect("a kind");
            let name = dependency["rename"].as_str().or(dependency["name"].as_str()).expect("a name");
            if !uses(&sources[source], &name.replace('-', "_")) {
                let package = package["name"].as_str().expect("a name");
                unnamed.push((package.to_owned(), name.to_owned(), kind.to_owned()));
            }
        }
    }
    let known = |(package, name, _): &(String, String, String)| {
        UNNAMED.iter().any(|(p, n, _)| (p, n) == (&package.as_str(), &name.as_str()))
    };
    let (allowed, wrong): (Vec<_>, Vec<_>) = unnamed.into_iter().partition(known);
    assert!(wrong.is_empty(), "no source of its kind names (package, dependency, kind): {wrong:?}");
    assert_eq!(allowed.len(), UNNAMED.len(), "of {UNNAMED:?} only {allowed:?} are still unnamed");
}

#[test]
fn crate_use_is_recognised() {
    for text in ["use rustix::fs;", "rustix::fs::open()", "use rustix;", "use rustix as r;", "(rustix::x)"] {
        assert!(uses(text, "rustix"), "{text}");
    }
    for text in ["use my_rustix::fs;", "crate::rustix::fs()", "rustix.fs", "let rustix = 1;", ""] {
        assert!(!uses(text, "rustix"), "{text}");
    }
    let (code, tests) = parts(
        "use a::b; // use c::d\n#[cfg(test)]\nmod far;\nfn f() {}\n#[cfg(test)]\nmod tests {\nuse e::f;\n}",
    );
    assert!(uses(&code, "a") && !uses(&code, "c") && !uses(&code, "e") && uses(&tests, "e"));
}
