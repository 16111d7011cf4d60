//! The figure of `cases/validation/flexible-cavity`: motion of the middle of the bottom, and the peaks and troughs that four codes published.
//!
//! `cargo run --release -p figures --example flexible_cavity -- OUT.svg NAME=POINTS.csv...`

use std::error::Error;
use std::path::Path;

use figures::chart::{Axis, Figure, Panel, Panels, Series, WIDTH};
use figures::colour::series;
use results::history;

/// Peaks and troughs over 20 to 70 s, m: Valdes, Kratos, Kassiotis, solids4foam.
const PEAKS: [f64; 4] = [0.2695, 0.2619, 0.2433, 0.2861];
const TROUGHS: [f64; 4] = [0.1967, 0.2033, 0.2066, 0.2044];

/// Displacement of the middle over time in a `points.csv`.
fn curve(file: &Path) -> Result<Vec<[f64; 2]>, Box<dyn Error>> {
    let columns = history::read(file)?;
    let column = |name: &str| {
        let found = columns.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
        found.ok_or_else(|| format!("{} has no column {name}", file.display()))
    };
    Ok(column("time_s")?.into_iter().zip(column("middle_z_m")?).map(|(t, z)| [t, z]).collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((out, runs)) = arguments.split_first() else {
        return Err("usage: flexible_cavity OUT.svg NAME=POINTS.csv...".into());
    };
    let mut all = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        let (name, file) = run.split_once('=').ok_or_else(|| format!("{run} is not NAME=POINTS.csv"))?;
        all.push(Series::curve(name, series(k), curve(Path::new(file))?));
    }
    let published = |values: [f64; 4]| values.iter().map(|v| [71.5, *v]).collect();
    all.push(Series::dots("published peaks", series(runs.len()), published(PEAKS)));
    all.push(Series::dots("published troughs", series(runs.len() + 1), published(TROUGHS)));
    let values: Vec<f64> = all.iter().flat_map(|s| s.points.iter().map(|p| p[1])).collect();
    let panel = Panel {
        title: "Cavity with a flexible bottom: displacement of its middle".into(),
        x: Axis::spanning("time, s", [0.0, 73.0].into_iter()),
        y: Axis::around("displacement, m", false, values.into_iter()),
        series: all,
        band: None,
        references: Vec::new(),
    };
    Figure::Panels(Panels::single(panel, [WIDTH, 420.0])).svg().save(Path::new(out))?;
    Ok(())
}
