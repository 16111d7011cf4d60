//! `ripstop report`: the report of a run as one HTML page or as Markdown.
//!
//! `data` and `frames` read the results of the run; `document` arranges them as sections of texts, tables, charts
//! and pictures; `html` and `markdown` write them. The report of an incomplete run is shorter: it lists the
//! missing data and the keys of the scene that write them.

// An error ends the program once, so its size does not matter.
#![allow(clippy::result_large_err)]

mod bars;
mod chart;
mod comparison;
mod coupling_quality;
mod data;
mod document;
mod facts;
mod frames;
mod html;
mod live;
mod markdown;
mod opening_loads;
mod openings;
mod origin;
mod pack;
mod panels;
mod payload;
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
use self::document::Document;
pub use self::live::follow;

/// Arguments of `ripstop report`.
#[derive(Args)]
pub struct ReportArgs {
    /// Results folder of a complete, running or incomplete run; two or more are compared
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Write Markdown and a folder of pictures instead of an HTML page
    #[arg(long)]
    markdown: bool,
    /// Write the page again while the run continues; the open page follows it
    #[arg(long, conflicts_with = "markdown")]
    pub watch: bool,
    /// File to write [default: report.html or report.md in RUN; comparison.html or comparison.md in the first RUN]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Size limit of the canopy shapes and fields in the page before compression, in MB; above it, snapshots
    /// are omitted at even intervals
    #[arg(long, value_name = "MB", default_value_t = 8.0, value_parser = megabytes)]
    canopy_mb: f64,
}

impl ReportArgs {
    /// The file to write.
    fn file(&self) -> PathBuf {
        let name = if self.runs.len() > 1 { "comparison" } else { "report" };
        let ending = if self.markdown { "md" } else { "html" };
        self.out.clone().unwrap_or_else(|| self.runs[0].join(name).with_extension(ending))
    }

    /// The report of the run, or the comparison of the runs.
    fn document(&self) -> Result<Document, RunError> {
        match &self.runs[..] {
            [run] => document::document(&Run::open(run)?, (self.canopy_mb * 1e6) as usize),
            runs => comparison::document(runs),
        }
    }
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
    let document = args.document()?;
    let out = args.file();
    let bytes = if args.markdown {
        markdown::write(&document, &out)?
    } else {
        live::write(&html::page(&document, None), &out)?
    };
    for text in &document.missing {
        console.line(&format!("missing from the report: {text}"));
    }
    console.result(&format!("{}: {:.1} MB", out.display(), bytes as f64 / 1e6));
    Ok(())
}
