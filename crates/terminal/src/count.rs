//! Counts with singular and plural.

/// `1 window`, `2 windows`: a count with the regular plural of `what`.
pub fn counted(n: u64, what: &str) -> String {
    let plural = if n == 1 { "" } else { "s" };
    format!("{n} {what}{plural}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plural_follows_the_count() {
        assert_eq!([0, 1, 2].map(|n| counted(n, "window")), ["0 windows", "1 window", "2 windows"]);
    }
}
