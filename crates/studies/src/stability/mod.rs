//! `ripstop stability`: stability maps of coupling schemes.

mod exact;
pub(crate) mod family;
mod map;
mod runs;
mod verdict;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;
use coupling::error::RunError;
use terminal::Console;

pub use self::exact::Exact;
use self::family::{Axes, SchemeChoice, samples};
use self::verdict::Class;

/// Arguments of `ripstop stability`.
#[derive(Args)]
pub struct StabilityArgs {
    /// Scene of a panel in a box
    #[arg(default_value = "cases/hard/membrane-box/scene.toml")]
    scene: PathBuf,
    /// Folder of the samples and of map.csv, map.svg, map.png
    #[arg(long, value_name = "DIR", default_value = "runs/stability")]
    out: PathBuf,
    /// Ratios of added mass to fabric mass [default: 0.1,10,1000; --full: all decades]
    #[arg(long, value_name = "RATIO,...", value_delimiter = ',', value_parser = above_zero)]
    mass_ratio: Vec<f64>,
    /// Windows per period of the exact vibration [default: 8,64; --full: 4,16,64,400,4000]
    #[arg(long, value_name = "COUNT,...", value_delimiter = ',', value_parser = above_zero)]
    window: Vec<f64>,
    /// Structure substeps per window [default: 10; --full: 1,10]
    #[arg(long, value_name = "COUNT,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..))]
    substeps: Vec<u32>,
    /// Coupling schemes: `default` as in the scene, or SCHEME[:ACCELERATION[:LOAD]][+KEY=VALUE] [default: staggered,default]
    #[arg(long, value_name = "SCHEME,...", value_delimiter = ',')]
    scheme: Vec<String>,
    /// Run the full map: five decades of mass ratio, three of the window
    #[arg(long)]
    full: bool,
    /// Number of samples that run at the same time [default: number of cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    jobs: Option<u32>,
    /// Run all samples, including those with results
    #[arg(long)]
    rerun: bool,
}

fn above_zero(text: &str) -> Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|x| *x > 0.0 && x.is_finite())
        .ok_or_else(|| "expected a number above 0".into())
}

impl StabilityArgs {
    fn axes(&self) -> Axes {
        fn or<T: Clone>(given: &[T], quick: &[T], all: &[T], full: bool) -> Vec<T> {
            if !given.is_empty() {
                given.to_vec()
            } else if full {
                all.to_vec()
            } else {
                quick.to_vec()
            }
        }
        let schemes = or(
            &self.scheme,
            &["staggered".into(), "default".into()],
            &["staggered".into(), "default".into()],
            self.full,
        );
        Axes {
            mass_ratios: or(
                &self.mass_ratio,
                &[0.1, 10.0, 1000.0],
                &[0.1, 1.0, 10.0, 100.0, 1000.0],
                self.full,
            ),
            windows: or(&self.window, &[8.0, 64.0], &[4.0, 16.0, 64.0, 400.0, 4000.0], self.full),
            substeps: or(&self.substeps, &[10], &[1, 10], self.full),
            schemes: schemes.into_iter().map(SchemeChoice).collect(),
        }
    }
}

/// Runs the samples and writes the map. Returns the text for the terminal.
///
/// # Errors
/// A scene without closed-form solution, an interruption, or file errors.
pub fn stability(args: &StabilityArgs, stop: &AtomicBool, console: &Console) -> Result<String, RunError> {
    let axes = args.axes();
    std::fs::create_dir_all(&args.out).map_err(RunError::file("create", &args.out))?;
    let out = std::path::absolute(&args.out).map_err(RunError::file("resolve", &args.out))?;
    let _lock = results::lock::lock(&out)?;
    let samples = samples(&args.scene, &axes, &out)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, |n| n as usize);
    console.line(&format!("{} samples, {jobs} at a time", samples.len()));
    let completed = runs::run_samples(&samples, jobs, args.rerun, stop, console)?;
    let title = &samples[0].scene.title;
    map::write(&out, &axes, &completed, if title.is_empty() { &samples[0].scene.name } else { title })?;
    let count = |class: Class| completed.iter().filter(|f| f.verdict.class == class).count();
    Ok(format!(
        "{} stable, {} stable but inaccurate, {} unstable: {}",
        count(Class::Stable),
        count(Class::Inaccurate),
        count(Class::Unstable),
        out.join("map.svg").display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_come_from_options_quick_or_full_defaults() {
        use clap::Parser;
        #[derive(Parser)]
        struct Line {
            #[command(flatten)]
            args: StabilityArgs,
        }
        let axes = |line: &[&str]| Line::try_parse_from([&["x"], line].concat()).map(|l| l.args.axes());
        assert_eq!(axes(&[]).unwrap().mass_ratios.len(), 3);
        let full = axes(&["--full", "--substeps", "5"]).unwrap();
        assert_eq!((full.mass_ratios.len(), full.windows.len(), full.substeps), (5, 5, vec![5]));
        assert!(axes(&["--mass-ratio", "0"]).is_err());
    }
}
