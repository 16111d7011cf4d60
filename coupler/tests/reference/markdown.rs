//! Markdown, and the comparison of a page with the committed one.

use std::path::{Path, PathBuf};

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// First lines of a generated page.
pub fn head(title: &str, text: &str) -> String {
    format!(
        "# {title}\n\n<!-- Generated. After a change of the code: \
         RIPSTOP_WRITE_DOCS=1 cargo test --release -p coupler --test reference -->\n\n{text}\n"
    )
}

/// Text of a doc comment in one line, without links to code, fit for a cell of a table.
pub fn inline(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let text = words.replace("[`", "`").replace("`]", "`").replace('|', "\\|");
    // A type that the page does not show.
    text.replace("Self::", "").replace("crate::", "")
}

/// A table.
pub fn table(names: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", names.join(" | "), "---|".repeat(names.len()));
    for row in rows {
        assert_eq!(row.len(), names.len(), "{row:?}");
        text += &format!("| {} |\n", row.join(" | "));
    }
    text
}

/// Compares `text` with `docs/reference/<name>`, or writes it where `RIPSTOP_WRITE_DOCS` is set.
pub fn compare_or_write(name: &str, text: &str) {
    let path = root().join("docs/reference").join(name);
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("created");
        std::fs::write(&path, text).expect("written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let line = committed.lines().zip(text.lines()).position(|(a, b)| a != b);
    assert!(
        committed == text,
        "docs/reference/{name} differs from the code (first at line {}): run RIPSTOP_WRITE_DOCS=1 cargo test --release \
         -p coupler --test reference",
        line.map_or("its end".into(), |n| (n + 1).to_string())
    );
}

/// Anchor of a heading in a page.
pub fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

/// A number with few digits.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        return format!("{x:e}");
    }
    let text = format!("{x}");
    if text.len() > 9 { format!("{x:.6}") } else { text }
}
