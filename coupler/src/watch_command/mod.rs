//! `ripstop watch`: follows a run from the files in its folder.

mod page;
#[cfg(test)]
mod tests;
mod view;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use coupling::error::RunError;
use terminal::screen::Screen;

use self::page::page;
use self::view::Watched;

/// Interval of the check whether to stop.
const TICK: Duration = Duration::from_millis(100);

/// Exit codes, as the end of the help text.
pub const HELP: &str = "Exit codes:\n  0: the run is complete, or was running when --once or Ctrl-C ended this command; Ctrl-C does not reach the run\n  \
    2: no run, or an unknown column\n  otherwise: the exit code of the run (130: it was interrupted); 1 if it was killed";

/// Arguments of `ripstop watch`.
#[derive(Args)]
pub struct WatchArgs {
    /// Results folder of a running, complete, interrupted or failed run
    run: PathBuf,
    /// Print the state once and end
    #[arg(long)]
    once: bool,
    /// Columns of history.csv to plot, such as `--columns drag_n,projected_area_m2` [default: descent speed and drag, or
    /// what the stage has of them, else the projected area]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    columns: Vec<String>,
    /// Seconds between two updates
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = crate::arguments::seconds)]
    interval: f64,
}

/// Shows the run in `args.run` on standard output until it ends, `--once` is given, or `stop` becomes true.
///
/// # Errors
/// No run, an unknown column, or how the run ended that is not complete.
pub fn watch(args: &WatchArgs, stop: &AtomicBool) -> Result<(), RunError> {
    let mut screen = Screen::default();
    let mut watched = Watched::open(&args.run)?;
    let mut shown = String::new();
    loop {
        watched.update()?;
        let (columns, lines) = screen.size();
        let text = page(&watched.view(), &args.columns, columns, lines)?;
        let ended = watched.status.ended();
        // Without a terminal only what changed is printed.
        if text != shown && screen.show(&text).is_err() {
            // The reader has closed the pipe.
            return Ok(());
        }
        shown = text;
        if args.once || ended {
            return watched.status.verdict();
        }
        let start = Instant::now();
        while start.elapsed().as_secs_f64() < args.interval {
            if stop.load(Ordering::Relaxed) {
                return Ok(());
            }
            std::thread::sleep(TICK.min(Duration::from_secs_f64(args.interval)));
        }
    }
}
