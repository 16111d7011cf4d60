//! Extraction of user-visible text from sources and documents, and search for refused words.

use regex::{Regex, RegexBuilder};

/// A refused word or phrase.
pub struct Refused {
    pattern: Regex,
    /// Standard term.
    pub replacement: String,
    /// Reason of the refusal.
    pub reason: String,
}

/// A finding: a refused word in a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Line, from 1.
    pub line: usize,
    /// Word as written.
    pub word: String,
    /// Standard term.
    pub replacement: String,
    /// Reason of the refusal.
    pub reason: String,
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: \"{}\": write: {} ({})", self.line, self.word, self.replacement, self.reason)
    }
}

/// Parses a list with the lines `pattern | replacement | reason`. Empty lines and lines that start with `#` are ignored.
///
/// # Panics
/// A line does not have three parts, or its pattern is not a regular expression.
pub fn refused(text: &str) -> Vec<Refused> {
    let rows = text.lines().filter(|l| !l.is_empty() && !l.starts_with('#'));
    rows.map(|row| {
        let parts: Vec<&str> = row.split(" | ").collect();
        let [pattern, replacement, reason] = parts[..] else {
            panic!("`{row}` is not of the form `pattern | replacement | reason`")
        };
        let pattern = format!(r"\b(?:{})\b", pattern.replace(' ', r"\s+"));
        let pattern = RegexBuilder::new(&pattern).case_insensitive(true).build();
        Refused {
            pattern: pattern.unwrap_or_else(|e| panic!("{row}: {e}")),
            replacement: replacement.into(),
            reason: reason.into(),
        }
    })
    .collect()
}

/// The refused words in `text`, whose first line has number `line`.
pub fn search(text: &str, line: usize, refused: &[Refused]) -> Vec<Found> {
    let found = refused.iter().flat_map(|r| {
        r.pattern.find_iter(text).map(|m| Found {
            line: line + text[..m.start()].matches('\n').count(),
            word: m.as_str().split_whitespace().collect::<Vec<_>>().join(" "),
            replacement: r.replacement.clone(),
            reason: r.reason.clone(),
        })
    });
    let mut found: Vec<Found> = found.collect();
    found.sort_by_key(|f| f.line);
    found
}

/// Comments and string literals of a Rust source, each with its first line (from 1). Consecutive line comments are one
/// text. The source after `#[cfg(test)]` is ignored.
pub fn texts_of_rust(source: &str) -> Vec<(usize, String)> {
    let source = source.split("\n#[cfg(test)]").next().unwrap_or(source);
    let mut texts: Vec<(usize, String)> = Vec::new();
    let mut comment_ends = 0;
    let (mut line, mut rest) = (1, source);
    while let Some(c) = rest.chars().next() {
        let taken = if rest.starts_with("//") {
            let end = rest.find('\n').unwrap_or(rest.len());
            let text = rest[..end].trim_start_matches(['/', '!']);
            match texts.last_mut() {
                Some((_, last)) if comment_ends + 1 == line => *last += &format!("\n{text}"),
                _ => texts.push((line, text.into())),
            }
            comment_ends = line;
            end
        } else if let Some(hashes) = raw_string(rest) {
            let close = format!("\"{}", "#".repeat(hashes));
            let start = hashes + 2;
            let end = rest[start..].find(&close).map_or(rest.len(), |e| start + e);
            texts.push((line, rest[start..end].into()));
            (end + close.len()).min(rest.len())
        } else if c == '"' {
            let end = string_end(rest);
            texts.push((line, rest[1..end].replace("\\n", "  ")));
            (end + 1).min(rest.len())
        } else if c == '\'' {
            character_end(rest)
        } else if c.is_alphanumeric() || c == '_' {
            rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len())
        } else {
            c.len_utf8()
        };
        line += rest[..taken].matches('\n').count();
        rest = &rest[taken..];
    }
    texts
}

/// Number of `#` of the raw string at the start of `rest`.
fn raw_string(rest: &str) -> Option<usize> {
    let after = rest.strip_prefix('r')?;
    let hashes = after.len() - after.trim_start_matches('#').len();
    after[hashes..].starts_with('"').then_some(hashes)
}

/// Offset of the closing quote of the string at the start of `rest`.
fn string_end(rest: &str) -> usize {
    let mut escaped = false;
    let end = rest.char_indices().skip(1).find(|&(_, c)| {
        let ends = c == '"' && !escaped;
        escaped = c == '\\' && !escaped;
        ends
    });
    end.map_or(rest.len(), |(at, _)| at)
}

/// Length in bytes of the character literal, or of the quote of a lifetime, at the start of `rest`.
fn character_end(rest: &str) -> usize {
    let mut letters = rest.char_indices().skip(1);
    match (letters.next(), letters.next()) {
        (Some((_, '\\')), _) => {
            rest[2..].char_indices().skip(1).find(|c| c.1 == '\'').map_or(1, |(at, _)| at + 3)
        }
        (Some(_), Some((at, '\''))) => at + 1,
        _ => 1,
    }
}

/// Names of public items of a Rust source as words, each with its line (from 1): `FlowSolve` gives `Flow Solve`.
pub fn public_names(source: &str) -> Vec<(usize, String)> {
    let item = Regex::new(
        r"^\s*pub (?:const |unsafe |async )*(?:fn|struct|enum|trait|const|static|mod|type) (\w+)|^\s*pub (\w+): ",
    )
    .expect("a pattern");
    let camel = Regex::new("([a-z])([A-Z])").expect("a pattern");
    let source = source.split("\n#[cfg(test)]").next().unwrap_or(source);
    let named = source.lines().zip(1..).filter_map(|(text, line)| {
        let found = item.captures(text)?;
        let name = found.get(1).or_else(|| found.get(2))?.as_str();
        Some((line, camel.replace_all(name, "$1 $2").replace('_', " ")))
    });
    named.collect()
}

/// Keys of a JSON document as words, each with its line (from 1): `"box_grid":` gives `box grid`.
pub fn json_keys(text: &str) -> Vec<(usize, String)> {
    let key = Regex::new(r#""([A-Za-z0-9_]+)"\s*:"#).expect("a pattern");
    let lines = text.lines().zip(1..);
    lines
        .flat_map(|(text, line)| {
            key.captures_iter(text).map(|c| (line, c[1].replace('_', " "))).collect::<Vec<_>>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "# a comment\n\nanew | again | archaism\nno (more|less) than | at most | litotes\n";

    #[test]
    fn refused_words_are_found_with_line_and_replacement() {
        let found = search("first\nIt is solved Anew, in no\nmore than two steps.", 5, &refused(LIST));
        let found: Vec<_> = found.iter().map(|f| (f.line, f.word.as_str(), f.replacement.as_str())).collect();
        assert_eq!(found, [(6, "Anew", "again"), (6, "no more than", "at most")]);
        assert_eq!(search("renewal, canews", 1, &refused(LIST)), []);
    }

    #[test]
    fn texts_of_sources_are_comments_and_strings() {
        let source = "/// Solves\n/// it.\nfn f<'a>(c: char) {\n    g(\"a \\\"b\\\" c\", 'x', '\\'', '\"', r#\"raw \"\n\"#); // why\n}\n\n#[cfg(test)]\nmod tests { \"out\" }";
        let texts = texts_of_rust(source);
        let texts: Vec<_> = texts.iter().map(|(line, text)| (*line, text.as_str())).collect();
        assert_eq!(texts, [(1, " Solves\n it."), (4, "a \\\"b\\\" c"), (4, "raw \"\n"), (5, " why")]);
    }

    #[test]
    fn keys_of_json_are_words() {
        let schema = "{\n  \"flown_at\": { \"description\": \"text\" }\n}";
        assert_eq!(json_keys(schema), [(2, "flown at".into()), (2, "description".into())]);
    }

    #[test]
    fn shipped_list_refuses_a_made_up_sentence() {
        let list = refused(include_str!("../refused-words.txt"));
        let sentence = "The scene is flown anew, beside its books; no more than two windows are given back.";
        let found = search(sentence, 1, &list);
        let words: Vec<_> = found.iter().map(|f| f.word.as_str()).collect();
        for word in ["flown", "anew", "beside", "books", "no more than", "given back"] {
            assert!(words.contains(&word), "{word}: {words:?}");
        }
        assert!(found[0].to_string().contains(": write: "), "{}", found[0]);
        let standard =
            "The scene is run again; at most two windows are rejected and retried with half the length.";
        assert_eq!(search(standard, 1, &list), []);
    }

    #[test]
    fn public_names_are_words() {
        let source = "pub struct FlowSolve {\n    pub inner_steps: u32,\n    hidden: u32,\n}\npub const fn go_on() {}\n";
        let names = public_names(source);
        assert_eq!(names, [(1, "Flow Solve".into()), (2, "inner steps".into()), (5, "go on".into())]);
    }
}
