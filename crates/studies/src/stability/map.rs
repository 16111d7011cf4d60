//! The stability map: mass ratio on the horizontal axis, windows per period on the vertical axis, one panel for each
//! scheme and number of substeps.

use std::path::Path;

use coupling::error::RunError;
use figures::chart::{Axis, Field, FieldMark, Figure, HeatMap, HeatMaps};

use super::family::{Axes, SchemeChoice};
use super::runs::Completed;
use super::verdict::Class;

/// Coupling iterations at the upper end of the colour scale.
const MAX_ITERATIONS: f64 = 30.0;
/// Maximum number of characters of a failure in the table; the folder of the sample contains all of it.
const MAX_FAILURE_CHARS: usize = 110;

/// Writes `map.csv`, `map.svg` and `map.png` into `out`.
///
/// # Errors
/// A file cannot be written.
pub fn write(out: &Path, axes: &Axes, completed: &[Completed], title: &str) -> Result<(), RunError> {
    let path = out.join("map.csv");
    std::fs::write(&path, table(completed)).map_err(RunError::file("write", &path))?;
    figure(axes, completed, title).save(out, "map").map(|_| ())
}

fn table(completed: &[Completed]) -> String {
    let mut text = String::from(
        "mass_ratio,windows_per_period,substeps,scheme,class,windows,iterations_per_window,frequency_error,\
         amplitude_error,energy_created,failure\n",
    );
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.5}"));
    for f in completed {
        let v = &f.verdict;
        // First line, without commas.
        let failure = v.failure.as_deref().unwrap_or_default().lines().next().unwrap_or_default();
        let failure = failure.chars().take(MAX_FAILURE_CHARS).collect::<String>().replace(',', ";");
        text += &format!(
            "{},{},{},{},{},{},{:.2},{},{},{:.5},{failure}\n",
            f.point.mass_ratio,
            f.point.windows_per_period,
            f.point.substeps,
            f.point.scheme.0,
            v.class.name(),
            v.windows,
            v.iterations,
            number(v.frequency_error),
            number(v.amplitude_error),
            v.energy_created
        );
    }
    text
}

/// Position of a number of iterations on the colour scale, 0 to 1.
fn share(iterations: f64) -> f64 {
    (iterations.max(1.0).ln() / MAX_ITERATIONS.ln()).min(1.0)
}

fn figure(axes: &Axes, completed: &[Completed], title: &str) -> Figure {
    let one = |scheme| axes.substeps.iter().map(move |substeps| map(axes, completed, scheme, *substeps));
    let marks = [Class::Stable, Class::Inaccurate, Class::Unstable];
    Figure::HeatMaps(HeatMaps {
        title: title.into(),
        maps: axes.schemes.iter().flat_map(one).collect(),
        columns: axes.substeps.len(),
        marks: marks.into_iter().map(|class| (mark(class), class.name().into())).collect(),
        scale: "coupling iterations per window".into(),
        scale_marks: [1.0, 3.0, 10.0, MAX_ITERATIONS]
            .into_iter()
            .map(|n| (share(n), format!("{n}")))
            .collect(),
    })
}

/// The panel of one scheme and number of substeps.
fn map(axes: &Axes, completed: &[Completed], scheme: &SchemeChoice, substeps: u32) -> HeatMap {
    let field = |f: &Completed| {
        let p = &f.point;
        let column = axes.mass_ratios.iter().position(|m| *m == p.mass_ratio)?;
        let row = axes.windows.iter().position(|w| *w == p.windows_per_period)?;
        let v = &f.verdict;
        Some(Field {
            at: [column, row],
            share: share(v.iterations),
            mark: mark(v.class),
            text: if v.windows == 0 { "-".into() } else { format!("{:.1}", v.iterations) },
        })
    };
    let own = completed.iter().filter(|f| f.point.substeps == substeps && f.point.scheme == *scheme);
    let names = |values: &[f64]| values.iter().map(f64::to_string).collect();
    HeatMap {
        title: format!("{}, {substeps} substeps", scheme.0),
        x: Axis::categories("added mass / fabric mass", names(&axes.mass_ratios)),
        y: Axis::categories("windows per period", names(&axes.windows)),
        fields: own.filter_map(field).collect(),
    }
}

fn mark(class: Class) -> FieldMark {
    match class {
        Class::Stable => FieldMark::Dot,
        Class::Inaccurate => FieldMark::Ring,
        Class::Unstable => FieldMark::Cross,
    }
}

#[cfg(test)]
mod tests {
    use super::super::family::Point;
    use super::super::verdict::Verdict;
    use super::*;

    #[test]
    fn table_and_figures_contain_all_samples() {
        let axes = Axes {
            mass_ratios: vec![0.1, 1.0, 10.0, 100.0, 1000.0],
            windows: vec![8.0, 32.0, 128.0],
            substeps: vec![1, 10],
            schemes: vec![SchemeChoice("staggered".into()), SchemeChoice("default".into())],
        };
        let mut completed = Vec::new();
        for scheme in &axes.schemes {
            for &substeps in &axes.substeps {
                for (j, &windows_per_period) in axes.windows.iter().enumerate() {
                    for (i, &mass_ratio) in axes.mass_ratios.iter().enumerate() {
                        let class = [Class::Stable, Class::Inaccurate, Class::Unstable][(i + j) % 3];
                        let unstable = class == Class::Unstable;
                        completed.push(Completed {
                            point: Point { mass_ratio, windows_per_period, substeps, scheme: scheme.clone() },
                            verdict: Verdict {
                                class,
                                windows: 20,
                                iterations: 1.0 + (i * j) as f64,
                                frequency_error: Some(0.01),
                                amplitude_error: None,
                                energy_created: 0.0,
                                failure: unstable.then(|| "it grew, and\nmore".to_owned()),
                            },
                        });
                    }
                }
            }
        }
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &axes, &completed, "a panel").unwrap();
        let csv = std::fs::read_to_string(folder.path().join("map.csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + 60);
        assert!(csv.lines().all(|l| l.split(',').count() == 11), "{csv}");
        let svg = std::fs::read_to_string(folder.path().join("map.svg")).unwrap();
        assert_eq!(svg.matches("added mass").count(), 4);
        // Stable samples are dots, inaccurate ones rings; there is one of each in the legend.
        let circles = completed.iter().filter(|f| f.verdict.class != Class::Unstable).count() + 2;
        assert_eq!(svg.matches("<circle").count(), circles);
        assert_eq!(svg.matches("fabric mass").count(), 4);
        let png = std::fs::read(folder.path().join("map.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG") && png.len() > 5000);
        if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
            std::fs::copy(folder.path().join("map.png"), Path::new(&keep).join("map.png")).unwrap();
        }
    }
}
