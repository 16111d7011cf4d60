//! The map: mass ratio across, windows in a period upwards, one field for each scheme and
//! number of substeps.

use std::path::Path;

use coupling::error::RunError;
use figures::picture::canvas::{Canvas, Pixels, Svg, shade};

use super::family::{Axes, SchemeChoice};
use super::fly::Flown;
use super::verdict::Class;

const CELL: [f32; 2] = [76.0, 44.0];
const LEFT: f32 = 92.0;
const TOP: f32 = 74.0;
const TITLE: f32 = 30.0;
const FOOT: f32 = 46.0;
const GAP: f32 = 52.0;
/// Iterations at the light end of the scale.
const MOST: f64 = 30.0;
/// Letters of a failure in the table; all of it is in the member's folder.
const FAILURE: usize = 110;
const INK: [f32; 3] = [0.13, 0.15, 0.18];
const WHITE: [f32; 3] = [1.0; 3];
const RED: [f32; 3] = [0.80, 0.11, 0.11];
const EMPTY: [f32; 3] = [0.90, 0.90, 0.90];

/// Writes `map.csv`, `map.svg` and `map.png` into `out`.
///
/// # Errors
/// Trouble with the files.
pub fn write(out: &Path, axes: &Axes, flown: &[Flown], title: &str) -> Result<(), RunError> {
    let path = out.join("map.csv");
    std::fs::write(&path, table(flown)).map_err(RunError::file("write", &path))?;
    let size = size(axes);
    let mut svg = Svg::new(size);
    draw(&mut svg, axes, flown, title);
    svg.save(&out.join("map.svg"))?;
    let mut pixels = Pixels::new(size);
    draw(&mut pixels, axes, flown, title);
    pixels.save(&out.join("map.png"))
}

fn table(flown: &[Flown]) -> String {
    let mut text = String::from(
        "mass_ratio,windows_per_period,substeps,scheme,class,windows,iterations_per_window,frequency_error,\
         amplitude_error,energy_created,failure\n",
    );
    let number = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.5}"));
    for f in flown {
        let v = &f.verdict;
        // One line, and no comma.
        let failure = v.failure.as_deref().unwrap_or_default().lines().next().unwrap_or_default();
        let failure = failure.chars().take(FAILURE).collect::<String>().replace(',', ";");
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

fn field(axes: &Axes) -> [f32; 2] {
    [CELL[0] * axes.mass_ratios.len() as f32, CELL[1] * axes.windows.len() as f32]
}

fn size(axes: &Axes) -> [u32; 2] {
    let [w, h] = field(axes);
    let (columns, rows) = (axes.substeps.len() as f32, axes.schemes.len() as f32);
    let width = LEFT + columns * (w + GAP) + 10.0;
    [width.max(700.0) as u32, (TOP + rows * (h + TITLE + FOOT)) as u32]
}

fn draw(on: &mut dyn Canvas, axes: &Axes, flown: &[Flown], title: &str) {
    on.label(title, [12.0, 22.0], 11.0, 0.0, INK);
    legend(on, [12.0, 46.0]);
    let [w, h] = field(axes);
    for (row, scheme) in axes.schemes.iter().enumerate() {
        for (column, &substeps) in axes.substeps.iter().enumerate() {
            let corner = [LEFT + column as f32 * (w + GAP), TOP + TITLE + row as f32 * (h + TITLE + FOOT)];
            let name = format!("{}, {substeps} substeps", scheme.0);
            on.label(&name, [corner[0], corner[1] - 8.0], 9.0, 0.0, INK);
            panel(on, axes, flown, (scheme, substeps), corner);
        }
    }
}

fn legend(on: &mut dyn Canvas, [x, y]: [f32; 2]) {
    let mut at = x;
    for (class, name) in
        [(Class::Stable, "stable"), (Class::Inaccurate, "inaccurate"), (Class::Unstable, "unstable")]
    {
        on.rect([at, y - 12.0], [18.0, 16.0], [0.35, 0.45, 0.55]);
        mark(on, class, [at + 9.0, y - 4.0]);
        on.label(name, [at + 23.0, y], 8.0, 0.0, INK);
        at += 40.0 + 7.5 * name.len() as f32;
    }
    let bar = 96;
    for i in 0..bar {
        let t = f64::from(i) / f64::from(bar - 1);
        on.rect([at + i as f32, y - 12.0], [1.5, 16.0], shade(t));
    }
    let end = at + bar as f32;
    on.label(&format!("1 to {MOST:.0} iterations a window"), [end + 8.0, y], 8.0, 0.0, INK);
}

fn panel(
    on: &mut dyn Canvas,
    axes: &Axes,
    flown: &[Flown],
    (scheme, substeps): (&SchemeChoice, u32),
    [x, y]: [f32; 2],
) {
    let rows = axes.windows.len();
    for (i, &mass_ratio) in axes.mass_ratios.iter().enumerate() {
        for (j, &windows) in axes.windows.iter().enumerate() {
            let corner = [x + i as f32 * CELL[0], y + (rows - 1 - j) as f32 * CELL[1]];
            let inner = [CELL[0] - 2.0, CELL[1] - 2.0];
            let found = flown.iter().find(|f| {
                let p = &f.point;
                p.mass_ratio == mass_ratio
                    && p.windows_per_period == windows
                    && p.substeps == substeps
                    && p.scheme == *scheme
            });
            let Some(f) = found else {
                on.rect(corner, inner, EMPTY);
                continue;
            };
            let v = &f.verdict;
            on.rect(corner, inner, shade((v.iterations.max(1.0).ln() / MOST.ln()).min(1.0)));
            mark(on, v.class, [corner[0] + 0.30 * CELL[0], corner[1] + 0.5 * inner[1]]);
            let ink = if v.iterations > 8.0 { INK } else { WHITE };
            let text = if v.windows == 0 { "-".into() } else { format!("{:.1}", v.iterations) };
            on.label(&text, [corner[0] + 0.52 * CELL[0], corner[1] + 0.5 * inner[1] + 4.0], 8.0, 0.0, ink);
        }
    }
    let bottom = y + rows as f32 * CELL[1];
    for (i, m) in axes.mass_ratios.iter().enumerate() {
        on.label(&m.to_string(), [x + (i as f32 + 0.5) * CELL[0], bottom + 14.0], 8.0, 0.5, INK);
    }
    let middle = x + 0.5 * CELL[0] * axes.mass_ratios.len() as f32;
    on.label("mass of air : mass of fabric", [middle, bottom + 31.0], 8.0, 0.5, INK);
    for (j, w) in axes.windows.iter().enumerate() {
        let at = y + (rows as f32 - 0.5 - j as f32) * CELL[1] + 3.0;
        on.label(&w.to_string(), [x - 8.0, at], 8.0, 1.0, INK);
    }
    if x <= LEFT {
        on.label("windows", [10.0, y - 20.0], 8.0, 0.0, INK);
        on.label("/ period", [10.0, y - 8.0], 8.0, 0.0, INK);
    }
}

/// Filled: stable. A ring: inaccurate. A red cross: unstable.
fn mark(on: &mut dyn Canvas, class: Class, [x, y]: [f32; 2]) {
    match class {
        Class::Stable => on.circle([x, y], 6.0, None, WHITE),
        Class::Inaccurate => on.circle([x, y], 5.0, Some(2.2), WHITE),
        Class::Unstable => {
            for (from, to) in [([-6.0, -6.0], [6.0, 6.0]), ([-6.0, 6.0], [6.0, -6.0])] {
                let at = |d: [f32; 2]| [x + d[0], y + d[1]];
                on.line(at(from), at(to), 5.0, WHITE);
            }
            for (from, to) in [([-5.5, -5.5], [5.5, 5.5]), ([-5.5, 5.5], [5.5, -5.5])] {
                let at = |d: [f32; 2]| [x + d[0], y + d[1]];
                on.line(at(from), at(to), 2.8, RED);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::family::Point;
    use super::super::verdict::Verdict;
    use super::*;

    #[test]
    fn a_map_has_all_members_in_table_and_pictures() {
        let axes = Axes {
            mass_ratios: vec![0.1, 1.0, 10.0, 100.0, 1000.0],
            windows: vec![8.0, 32.0, 128.0],
            substeps: vec![1, 10],
            schemes: vec![SchemeChoice("staggered".into()), SchemeChoice("default".into())],
        };
        let mut flown = Vec::new();
        for scheme in &axes.schemes {
            for &substeps in &axes.substeps {
                for (j, &windows_per_period) in axes.windows.iter().enumerate() {
                    for (i, &mass_ratio) in axes.mass_ratios.iter().enumerate() {
                        let class = [Class::Stable, Class::Inaccurate, Class::Unstable][(i + j) % 3];
                        let unstable = class == Class::Unstable;
                        flown.push(Flown {
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
        write(folder.path(), &axes, &flown, "a panel").unwrap();
        let csv = std::fs::read_to_string(folder.path().join("map.csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + 60);
        assert!(csv.lines().all(|l| l.split(',').count() == 11), "{csv}");
        let svg = std::fs::read_to_string(folder.path().join("map.svg")).unwrap();
        assert_eq!(svg.matches("mass of air").count(), 4);
        // Each unstable member is a cross of four lines, and there is one in the legend.
        let crosses = flown.iter().filter(|f| f.verdict.class == Class::Unstable).count() + 1;
        assert_eq!(svg.matches("<line").count(), 4 * crosses);
        let png = std::fs::read(folder.path().join("map.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG") && png.len() > 5000);
        if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
            std::fs::copy(folder.path().join("map.png"), keep).unwrap();
        }
    }
}
