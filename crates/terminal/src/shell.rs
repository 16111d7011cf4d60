//! Words of a command line, read and written as a shell does.

/// Splits a command line into words as a shell does for plain words, single and
/// double quotes and backslashes. `None` for an unclosed quote.
pub fn split_words(line: &str) -> Option<Vec<String>> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    let mut letters = line.chars();
    while let Some(letter) = letters.next() {
        match (quote, letter) {
            (Some(q), l) if l == q => quote = None,
            (Some('\''), l) => word.get_or_insert_default().push(l),
            (_, '\\') => word.get_or_insert_default().push(letters.next()?),
            (Some(_), l) => word.get_or_insert_default().push(l),
            (None, '\'' | '"') => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (None, l) if l.is_whitespace() => words.extend(word.take()),
            (None, l) => word.get_or_insert_default().push(l),
        }
    }
    words.extend(word);
    quote.is_none().then_some(words)
}

/// A word as a shell reads it back.
pub fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@%+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_split_as_in_a_shell() {
        let split = |s| split_words(s).unwrap();
        assert_eq!(split("python3 my_solver.py"), ["python3", "my_solver.py"]);
        assert_eq!(split(r#" a 'b c'  "d \" e" f\ g '' "#), ["a", "b c", "d \" e", "f g", ""]);
        assert_eq!(split_words("a 'b"), None);
    }

    #[test]
    fn quoted_words_are_split_to_the_original() {
        for word in ["plain", "with space", "it's", "", "a\"b"] {
            assert_eq!(split_words(&quote(word)).unwrap(), [word]);
        }
    }
}
