//! Equations of doc comments and documentation pages: found in Markdown, converted from TeX to MathML.
//!
//! A doc comment writes equations as code that Markdown leaves alone: `` $`E = m c^2`$ `` within a line, and a code
//! block of the language `math` for a displayed equation. Pages may also write `$...$` and `$$...$$`. Code-hosting sites
//! typeset all of these; the program `equations` does so for the book and for the pages of `cargo doc`.

use std::ops::Range;

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};
use pulldown_latex::{RenderConfig, Storage, config::DisplayMode, push_mathml};
use regex::{Captures, Regex};

/// An equation in a Markdown text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Equation {
    /// Bytes of the text that the equation takes, with its delimiters.
    pub range: Range<usize>,
    /// The equation in TeX.
    pub tex: String,
    /// On a line of its own.
    pub displayed: bool,
    /// Written as code, which Markdown processors without equations leave alone.
    pub code: bool,
}

/// The equations of a Markdown text in their order.
pub fn equations(markdown: &str) -> Vec<Equation> {
    let options = Options::ENABLE_MATH
        | Options::ENABLE_TABLES
        | Options::ENABLE_STRIKETHROUGH
        | Options::ENABLE_FOOTNOTES
        | Options::ENABLE_TASKLISTS;
    let mut found = Vec::new();
    let mut block: Option<Equation> = None;
    for (event, range) in Parser::new_ext(markdown, options).into_offset_iter() {
        match event {
            Event::InlineMath(tex) => {
                let inner = tex.strip_prefix('`').and_then(|t| t.strip_suffix('`'));
                let (tex, code) = (inner.unwrap_or(&tex).to_owned(), inner.is_some());
                found.push(Equation { range, tex, displayed: false, code });
            }
            Event::DisplayMath(tex) => {
                found.push(Equation { range, tex: tex.into_string(), displayed: true, code: false });
            }
            Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(language))) if &*language == "math" => {
                block = Some(Equation { range, tex: String::new(), displayed: true, code: true });
            }
            Event::Text(text) => {
                if let Some(equation) = &mut block {
                    equation.tex += &text;
                }
            }
            Event::End(TagEnd::CodeBlock) => found.extend(block.take()),
            _ => {}
        }
    }
    found
}

/// MathML of an equation in TeX.
///
/// # Errors
/// The equation is not TeX, or has a command that the converter does not know.
pub fn mathml(tex: &str, displayed: bool) -> Result<String, String> {
    let error = |text: String| {
        let first = text.lines().next().unwrap_or_default();
        format!("`{}`: {first}", tex.trim())
    };
    let storage = Storage::new();
    if let Some(e) = pulldown_latex::Parser::new(tex, &storage).find_map(Result::err) {
        return Err(error(e.to_string()));
    }
    let display_mode = if displayed { DisplayMode::Block } else { DisplayMode::Inline };
    let mut out = String::new();
    let config = RenderConfig { display_mode, ..RenderConfig::default() };
    push_mathml(&mut out, pulldown_latex::Parser::new(tex, &storage), config)
        .map_err(|e| error(e.to_string()))?;
    // `\operatorname*` and commands that the converter does not know pass as text.
    if out.contains('\\') || out.contains("*{") {
        return Err(error("a command is unknown".into()));
    }
    // The converter leaves two characters as they are, and a space out.
    let corrections = [("><</", ">&lt;</"), (">&</", ">&amp;</"), ("\"minsize", "\" minsize")];
    Ok(corrections.iter().fold(out, |text, (from, to)| text.replace(from, to)))
}

/// MathML that a Markdown processor passes on unchanged: its text has no character with a meaning in Markdown.
fn inert(mathml: &str) -> String {
    let mut out = String::with_capacity(mathml.len());
    let mut in_tag = false;
    for c in mathml.chars() {
        in_tag = (in_tag || c == '<') && c != '>';
        if !in_tag && "*_|`[]~$'\"-.!()#{}:^=".contains(c) {
            out += &format!("&#{};", u32::from(c));
        } else {
            out.push(if c == '\n' { ' ' } else { c });
        }
    }
    out
}

/// A Markdown text with its equations as MathML.
///
/// # Errors
/// An equation cannot be converted.
pub fn typeset_markdown(markdown: &str) -> Result<String, String> {
    let mut out = String::with_capacity(markdown.len());
    let mut end = 0;
    for equation in equations(markdown) {
        out += &markdown[end..equation.range.start];
        out += &inert(&mathml(&equation.tex, equation.displayed)?);
        end = equation.range.end;
    }
    Ok(out + &markdown[end..])
}

/// A page of `cargo doc` with its equations as MathML, and their number.
///
/// # Errors
/// An equation cannot be converted.
pub fn typeset_rustdoc(html: &str) -> Result<(String, usize), String> {
    let inline = r"\$<code>([^<]*)</code>\$";
    let block = r#"<div class="example-wrap"><pre class="language-math"><code>([^<]*)</code></pre></div>"#;
    let pattern = Regex::new(&format!("{inline}|{block}")).expect("the pattern is an expression");
    let mut errors = Vec::new();
    let mut count = 0;
    let replace = |found: &Captures<'_>| {
        count += 1;
        let (text, displayed) = match (found.get(1), found.get(2)) {
            (Some(text), _) => (text.as_str(), false),
            (None, text) => (text.map_or("", |t| t.as_str()), true),
        };
        match mathml(&plain(text), displayed) {
            // Without the style rustdoc gives equations a scroll bar.
            Ok(equation) if displayed => format!("<p style=\"overflow: visible\">{equation}</p>"),
            Ok(equation) => equation,
            Err(e) => {
                errors.push(e);
                String::new()
            }
        }
    };
    let typeset = pattern.replace_all(html, replace).into_owned();
    if errors.is_empty() { Ok((typeset, count)) } else { Err(errors.join("\n")) }
}

/// Text of a piece of HTML without tags.
fn plain(html: &str) -> String {
    let characters = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")];
    characters.iter().fold(html.to_owned(), |text, (entity, character)| text.replace(entity, character))
}

/// The doc comments of a Rust source: line of the first line, from 1, and text in Markdown.
pub fn doc_comments(source: &str) -> Vec<(usize, String)> {
    let mut comments: Vec<(usize, String)> = Vec::new();
    let mut kind = "";
    for (at, line) in source.lines().enumerate() {
        let line = line.trim_start();
        let marker = ["///", "//!"].into_iter().find(|m| line.starts_with(m) && !line.starts_with("////"));
        if let Some(marker) = marker {
            if kind != marker {
                comments.push((at + 1, String::new()));
            }
            let text = &mut comments.last_mut().expect("a comment was begun").1;
            *text += line[3..].strip_prefix(' ').unwrap_or(&line[3..]);
            text.push('\n');
        }
        kind = marker.unwrap_or("");
    }
    comments
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equations_of_all_forms_are_found() {
        let text = "Inline $`a_1 * b_1`$ and $c$, `$D` and `$E`.\n\n- item:\n  ```math\n  x^2\n  + y\n  ```\n\n$$ z $$\n";
        let found = equations(text);
        let all: Vec<_> = found.iter().map(|e| (e.tex.trim(), e.displayed, e.code)).collect();
        let expected =
            [("a_1 * b_1", false, true), ("c", false, false), ("x^2\n+ y", true, true), ("z", true, false)];
        assert_eq!(all, expected);
        assert_eq!(&text[found[0].range.clone()], "$`a_1 * b_1`$");
        let typeset = typeset_markdown(text).expect("equations");
        assert_eq!(typeset.matches("<math").count(), 4);
        assert!(typeset.contains("`$D`") && !typeset.contains("```") && !typeset.contains("*"), "{typeset}");
    }

    #[test]
    fn equations_become_mathml() {
        let fraction = mathml(r"\frac{1}{2}", true).expect("TeX");
        assert!(
            fraction.contains("<mfrac><mrow><mn>1</mn></mrow><mrow><mn>2</mn></mrow></mfrac>"),
            "{fraction}"
        );
        assert!(fraction.contains("block"), "{fraction}");
        assert!(mathml("a < b", false).expect("TeX").contains("<mo>&lt;</mo>"));
        assert!(mathml(r"\Big( x \Big)", false).expect("TeX").contains("\" minsize=\""));
    }

    #[test]
    fn faulty_equations_are_refused() {
        for tex in [r"\frac{1}{2", r"\unknown x", r"\left( x", "x^", r"\operatorname*{argmin} x"] {
            assert!(mathml(tex, false).is_err(), "{tex}: {:?}", mathml(tex, false));
        }
    }

    #[test]
    fn pages_of_rustdoc_are_typeset() {
        let inline = "<p>With $<code>a &lt; b'</code>$ and <code>$c</code>.</p>";
        let block =
            "<div class=\"example-wrap\"><pre class=\"language-math\"><code>x &amp; y\n</code></pre></div>";
        let (page, count) = typeset_rustdoc(inline).expect("an equation");
        assert_eq!(count, 1);
        assert!(
            page.starts_with("<p>With <math") && page.ends_with("</math> and <code>$c</code>.</p>"),
            "{page}"
        );
        assert!(typeset_rustdoc(block).is_err(), "an alignment mark outside an alignment");
        let (page, count) = typeset_rustdoc(&block.replace("&amp;", "+")).expect("an equation");
        assert!(count == 1 && page.starts_with("<p style") && page.contains("<math"), "{page}");
    }

    #[test]
    fn doc_comments_are_read_by_item() {
        let source = "//! Module.\n\n/// First\n/// line.\nfn f() {} // no\n    /// Field.\n//// none\n";
        let expected = [(1, "Module.\n"), (3, "First\nline.\n"), (6, "Field.\n")];
        assert_eq!(doc_comments(source), expected.map(|(line, text)| (line, text.to_owned())));
    }
}
