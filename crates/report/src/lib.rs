//! `ripstop report`: a page about a run, or the same in Markdown.
//!
//! The results of a run are read (`data`, `frames`) and presented as sections of texts, tables, charts and
//! pictures (`document`); `html` and `markdown` write them. A run that ended early or wrote less
//! gives a shorter page, which says what is missing and which key of the scene would write it.

// An error ends the run: its size is no cost.
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
mod openings;
mod origin;
mod pack;
mod panels;
mod shape;
mod stage;
mod swings;
#[cfg(test)]
mod tests;
mod times;

use std::path::PathBuf;

use clap::Args;
use coupling::error::RunError;
use terminal::Console;

use self::data::Run;

/// What to report and how.
#[derive(Args)]
pub struct ReportArgs {
    /// Folder of the results of a run, complete or not
    run: PathBuf,
    /// Write Markdown, with its pictures in a folder beside it, instead of a page
    #[arg(long)]
    markdown: bool,
    /// File to write [default: RUN/report.html or RUN/report.md]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Most megabytes of canopy shapes and fields in the page, before they are compressed: pictures are
    /// left out evenly in time to keep it
    #[arg(long, value_name = "MB", default_value_t = 8.0, value_parser = megabytes)]
    canopy_mb: f64,
}

fn megabytes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(mb) if mb > 0.0 && mb <= 1000.0 => Ok(mb),
        _ => Err("megabytes above 0, at most 1000".into()),
    }
}

/// Writes the report of a run.
///
/// # Errors
/// A folder that holds no run, results that cannot be read, a file that cannot be written.
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
        console.line(&format!("not in the report: {text}"));
    }
    console.line(&format!("{}: {:.1} MB", out.display(), bytes as f64 / 1e6));
    Ok(())
}
