//! Former names of command-line options: accepted with a warning.

use std::ffi::OsString;

/// Former and current names.
const OPTIONS: &[[&str; 2]] = &[
    ["--again", "--rerun"],
    ["--count-slack", "--iteration-tolerance"],
    ["--dials", "--parameters"],
    ["--keep-going", "--accept-unconverged"],
    ["--stop-at-departure", "--stop-at-deviation"],
    ["--want", "--target-error"],
];

/// The arguments with current names of options, and a warning for each former one.
pub fn current(arguments: impl IntoIterator<Item = OsString>) -> (Vec<OsString>, Vec<String>) {
    let mut warnings = Vec::new();
    let mut options = true;
    let translate = |argument: OsString| {
        options &= argument != "--";
        let Some(text) = argument.to_str().filter(|_| options) else { return argument };
        let (name, value) = match text.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (text, None),
        };
        let Some([old, new]) = OPTIONS.iter().find(|[old, _]| *old == name) else { return argument };
        warnings.push(format!("option {old} is now {new}; the former name is still accepted"));
        value.map_or_else(|| (*new).into(), |value| format!("{new}={value}").into())
    };
    (arguments.into_iter().map(translate).collect(), warnings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn former_options_are_replaced_with_a_warning() {
        for [old, new] in OPTIONS {
            let (arguments, warnings) = current(["ripstop", "run", old, "1"].map(OsString::from));
            assert_eq!(arguments, ["ripstop", "run", new, "1"]);
            assert_eq!(warnings, [format!("option {old} is now {new}; the former name is still accepted")]);
            let (arguments, warnings) = current([OsString::from(format!("{old}=a=b"))]);
            assert_eq!(arguments, [format!("{new}=a=b").as_str()]);
            assert_eq!(warnings.len(), 1);
        }
    }

    #[test]
    fn current_options_and_operands_are_unchanged() {
        let words = ["ripstop", "run", "--iteration-tolerance", "0", "--", "--again"].map(OsString::from);
        assert_eq!(current(words.clone()), (words.to_vec(), vec![]));
    }
}
