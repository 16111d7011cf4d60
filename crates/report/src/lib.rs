//! `ripstop report`: the report of a run as one HTML page or as Markdown.
//!
//! `data` and `frames` read the results of the run; `document` arranges them as sections of texts, tables, charts
//! and pictures; `html` and `markdown` write them. The report of an incomplete run is shorter: it lists the
//! missing data and the keys of the scene that write them.

// An error ends the program once, so its size does not matter.
#![allow(clippy::result_large_err)]

mod bars;
mod chart;
mod coupling_quality;
mod data;
mod document;
mod facts;
mod frames;
mod html;
mod markdown;
mod opening_loads;
mod openings;
mod origin;
mod pack;
mod panels;
mod shape;
mod stage;
#[cfg(test)]
mod tests;
mod times;

use std::path::PathBuf;

use clap::Args;
use coupling::error::RunError;
use terminal::Console;

use self::data::Run;

/// Arguments of `ripstop report`.
#[derive(Args)]
pub struct ReportArgs {
    /// Results folder of a complete or incomplete run
    run: PathBuf,
    /// Write Markdown and a folder of pictures instead of an HTML page
    #[arg(long)]
    markdown: bool,
    /// File to write [default: RUN/report.html or RUN/report.md]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Size limit of the canopy shapes and fields in the page before compression, in MB; above it, snapshots
    /// are omitted at even intervals
    #[arg(long, value_name = "MB", default_value_t = 8.0, value_parser = megabytes)]
    canopy_mb: f64,
}

fn megabytes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(mb) if mb > 0.0 && mb <= 1000.0 => Ok(mb),
        _ => Err("expected a size in MB, above 0 and at most 1000".into()),
    }
}

/// Writes the report of a run.
///
/// # Errors
/// The folder contains no run, a result cannot be read, or a file cannot be written.
///
/// # Examples
///
/// As a command of another program:
///
/// ```
/// use clap::Parser;
/// use report::{ReportArgs, report};
/// use terminal::Console;
///
/// #[derive(Parser)]
/// struct Command {
///     #[command(flatten)]
///     report: ReportArgs,
/// }
///
/// let command = Command::parse_from(["report", "runs/no-such-run", "--markdown"]);
/// let error = report(&command.report, &Console::new(true)).unwrap_err();
/// assert!(error.to_string().contains("runs/no-such-run"), "{error}");
/// ```
pub fn report(args: &ReportArgs, console: &Console) -> Result<(), RunError> {
    let run = Run::open(&args.run)?;
    let document = document::document(&run, (args.canopy_mb * 1e6) as usize)?;
    let name = if args.markdown { "report.md" } else { "report.html" };
    let out = args.out.clone().unwrap_or_else(|| args.run.join(name));
    let bytes = if args.markdown {
        markdown::write(&document, &out)?
    } else {
        let page = html::page(&document);
        std::fs::write(&out, &page).map_err(RunError::file("write", &out))?;
        page.len()
    };
    for text in &document.missing {
        console.line(&format!("missing from the report: {text}"));
    }
    console.line(&format!("{}: {:.1} MB", out.display(), bytes as f64 / 1e6));
    Ok(())
}
