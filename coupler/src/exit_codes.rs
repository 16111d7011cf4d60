//! Exit codes of `ripstop`: the table for the help texts and the reference.

macro_rules! exit_codes {
    ($($code:literal, $meaning:literal;)*) => {
        /// Exit codes with their meaning.
        pub const TABLE: &[(u8, &str)] = &[$(($code, $meaning)),*];

        /// The table as the end of a help text.
        pub const HELP: &str = concat!("Exit codes:", $("\n  ", $code, ": ", $meaning),*);
    };
}

exit_codes! {
    0, "success";
    1, "the run or the study failed; results up to the failure are kept";
    2, "the scene or the command line is invalid; no program was started";
    3, "a comparison found a difference (diff, replay, regression, run --baseline, accuracy), or a conformance test failed (conform)";
    130, "interrupted by Ctrl-C or a termination signal: the current window was completed and saved, and \
          `ripstop run --resume` continues the run; a second signal ends the run immediately without saving";
}

#[cfg(test)]
mod tests {
    use coupling::error::RunError;

    use super::*;

    #[test]
    fn every_exit_code_of_an_error_is_in_the_table() {
        let errors = [
            RunError::Input(String::new()),
            RunError::Interrupted(Default::default()),
            RunError::Differs,
            RunError::Deviates { place: Default::default(), message: String::new() },
            RunError::Study(String::new()),
            RunError::Channel { place: Default::default(), message: String::new() },
        ];
        let mut codes: Vec<u8> = errors.iter().map(RunError::exit_code).chain([0]).collect();
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes, TABLE.iter().map(|(code, _)| *code).collect::<Vec<_>>());
        assert!(TABLE.iter().all(|(code, meaning)| HELP.contains(&format!("{code}: {meaning}"))));
    }
}
