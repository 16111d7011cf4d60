//! `ripstop report --watch`: the page is written again while the run continues.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use coupling::error::RunError;
use results::run_state::RunStatus;
use terminal::Console;

use super::data::Run;
use super::{ReportArgs, html};

/// Largest share of a core for writing the page.
const SHARE: f64 = 0.04;
/// Shortest and longest interval of two pages.
const INTERVAL: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(600)];
/// Number of pages in a row that may fail.
const FAILURES: u32 = 5;
/// Interval of the check whether the run has ended.
const TICK: Duration = Duration::from_millis(250);

/// Writes `page` to `out` by replacing the file, so that a reader never sees a part of it. Returns its size, bytes.
pub(super) fn write(page: &str, out: &Path) -> Result<usize, RunError> {
    let aside = out.with_extension("part");
    std::fs::write(&aside, page).map_err(RunError::file("write", &aside))?;
    std::fs::rename(&aside, out).map_err(RunError::file("write", out))?;
    Ok(page.len())
}

/// The interval of pages that take `cost` to write.
fn interval(cost: Duration) -> Duration {
    cost.div_f64(SHARE).clamp(INTERVAL[0], INTERVAL[1])
}

/// Writes the report of a run again and again until the run ends or `stop` becomes true, at an interval of twenty-five times the
/// cost of writing it. The last page of an ended run does not reload itself.
///
/// # Errors
/// Several runs, no run, or a file that cannot be read or written.
pub fn follow(args: &ReportArgs, stop: &AtomicBool, console: &Console) -> Result<(), RunError> {
    let [folder] = &args.runs[..] else {
        return Err(RunError::Input(
            "report --watch follows one run. Name one, or omit --watch to compare runs".into(),
        ));
    };
    let out = args.file();
    let (mut every, mut written, mut failures) = (INTERVAL[0], 0, 0);
    loop {
        // Read before the page: what a run writes until its end is then in the last page.
        if RunStatus::read(folder)?.ended() || stop.load(Ordering::Relaxed) {
            return super::report(args, console);
        }
        let start = Instant::now();
        // A run has nothing to show before its first window.
        if Run::has_windows(folder)? {
            match args.document() {
                Ok(document) => {
                    write(&html::page(&document, Some(every.as_secs())), &out)?;
                    every = interval(start.elapsed());
                    (written, failures) = (written + 1, 0);
                }
                // A file may be in the middle of being written.
                Err(_) if failures < FAILURES => failures += 1,
                Err(error) => return Err(error),
            }
            if written == 1 {
                console.line(&format!("{}: follows the run; open it in a browser", out.display()));
                written += 1;
            }
        }
        while start.elapsed() < every && !stop.load(Ordering::Relaxed) && !RunStatus::read(folder)?.ended() {
            std::thread::sleep(TICK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_take_at_most_four_percent_of_a_core() {
        let seconds = |cost| interval(Duration::from_secs_f64(cost)).as_secs_f64();
        assert!((seconds(2.0) - 50.0).abs() < 1e-6);
        assert_eq!((seconds(0.01), seconds(100.0)), (5.0, 600.0));
    }
}
