//! Test harness for suites that run under MPI and cannot use the Rust test library.
//!
//! It has the arguments and output format of that library, so that `./test` counts all suites in the same way. All tests
//! run, also after a failure. The file has no dependencies, because suites of other packages include it by path.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::Instant;

/// Selection of tests by the arguments.
struct Choice {
    names: Vec<String>,
    skipped: Vec<String>,
    exact: bool,
    list: bool,
    /// Whether no test is selected, as these suites have no ignored tests.
    none: bool,
}

impl Choice {
    fn new(words: impl Iterator<Item = String>) -> Self {
        let mut choice =
            Self { names: Vec::new(), skipped: Vec::new(), exact: false, list: false, none: false };
        let mut words = words.peekable();
        while let Some(word) = words.next() {
            match word.as_str() {
                "--exact" => choice.exact = true,
                "--list" => choice.list = true,
                "--ignored" => choice.none = true,
                "--skip" => choice.skipped.extend(words.next()),
                "--test-threads" | "--format" | "--color" | "--logfile" => drop(words.next()),
                option if option.starts_with('-') => {}
                _ => choice.names.push(word),
            }
        }
        choice
    }

    fn holds(&self, name: &str) -> bool {
        let fits = |wanted: &String| if self.exact { name == wanted } else { name.contains(wanted.as_str()) };
        !self.none && (self.names.is_empty() || self.names.iter().any(fits)) && !self.skipped.iter().any(fits)
    }
}

/// Runs the selected tests in order; a panic is a failure.
pub fn run(tests: &[(&str, &dyn Fn())]) -> ExitCode {
    let choice = Choice::new(std::env::args().skip(1));
    let chosen: Vec<_> = tests.iter().filter(|(name, _)| choice.holds(name)).collect();
    if choice.list {
        chosen.iter().for_each(|(name, _)| println!("{name}: test"));
        return ExitCode::SUCCESS;
    }
    println!("\nrunning {} tests", chosen.len());
    let (begin, mut failed) = (Instant::now(), 0);
    for (name, test) in &chosen {
        let good = catch_unwind(AssertUnwindSafe(test)).is_ok();
        println!("test {name} ... {}", if good { "ok" } else { "FAILED" });
        failed += usize::from(!good);
    }
    println!(
        "\ntest result: {}. {} passed; {failed} failed; 0 ignored; 0 measured; {} filtered out; finished in {:.2}s\n",
        if failed == 0 { "ok" } else { "FAILED" },
        chosen.len() - failed,
        tests.len() - chosen.len(),
        begin.elapsed().as_secs_f64()
    );
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
