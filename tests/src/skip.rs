//! Tests that cannot run on this machine.

use std::io::Write;

/// Reports that the calling test is skipped, with the reason. The test library counts it as passed; `./test` reads the
/// skipped tests from the file `RIPSTOP_SKIPPED`.
pub fn skipped(why: &str) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    eprintln!("{test}: skipped: {why}");
    let Some(file) = std::env::var_os("RIPSTOP_SKIPPED") else { return };
    let line = format!("{test}: {}\n", why.replace('\n', " "));
    let file = std::fs::File::options().append(true).create(true).open(file);
    // A single write, because tests run in parallel.
    file.and_then(|mut f| f.write_all(line.as_bytes())).expect("the list of skipped tests can be written");
}
