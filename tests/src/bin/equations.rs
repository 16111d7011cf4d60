//! Typesets equations as MathML, which browsers show without a script or a network.
//!
//! `equations html FOLDER` changes the pages of `cargo doc` in a folder. `equations mdbook` is a preprocessor of mdbook:
//! a book in JSON from the standard input to the standard output.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ripstop_tests::equations::{typeset_markdown, typeset_rustdoc};
use serde_json::Value;

/// Pages below `folder`. Pages of sources show doc comments as written.
fn pages(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            if path.file_name().is_some_and(|n| n != "src") {
                found.extend(pages(&path)?);
            }
        } else if path.extension().is_some_and(|e| e == "html") {
            found.push(path);
        }
    }
    Ok(found)
}

fn html(folder: &Path) -> Result<(), String> {
    let at = |path: &Path| {
        let path = path.display().to_string();
        move |e: std::io::Error| format!("{path}: {e}")
    };
    let mut total = 0;
    for page in pages(folder).map_err(at(folder))? {
        let text = std::fs::read_to_string(&page).map_err(at(&page))?;
        let (typeset, count) = typeset_rustdoc(&text).map_err(|e| format!("{}: {e}", page.display()))?;
        if count > 0 {
            std::fs::write(&page, typeset).map_err(at(&page))?;
        }
        total += count;
    }
    eprintln!("equations: {total} typeset in {}", folder.display());
    Ok(())
}

/// Typesets all chapters of a book, whose text is the value of a key `content`.
fn chapters(value: &mut Value) -> Result<(), String> {
    match value {
        Value::Object(fields) => {
            let path = fields.get("path").and_then(Value::as_str).unwrap_or("a chapter").to_owned();
            for (key, field) in fields.iter_mut() {
                match field {
                    Value::String(text) if key == "content" => {
                        *text = typeset_markdown(text).map_err(|e| format!("{path}: {e}"))?;
                    }
                    _ => chapters(field)?,
                }
            }
            Ok(())
        }
        Value::Array(items) => items.iter_mut().try_for_each(chapters),
        _ => Ok(()),
    }
}

fn mdbook() -> Result<(), String> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text).map_err(|e| e.to_string())?;
    let mut input: Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    // Context and book.
    let book = input.get_mut(1).ok_or("mdbook sent no book")?;
    chapters(book)?;
    println!("{book}");
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match arguments[..] {
        ["html", folder] => html(Path::new(folder)),
        ["mdbook"] => mdbook(),
        // The question of mdbook whether the preprocessor supports an output.
        ["mdbook", "supports", output] => return ExitCode::from(u8::from(output != "html")),
        _ => Err("usage: equations html FOLDER | equations mdbook".into()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("equations: {e}");
            ExitCode::FAILURE
        }
    }
}
