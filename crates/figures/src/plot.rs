//! `descent.svg`: descent speed and drag over time.

use std::path::Path;

use case::{Canopy, Scene};
use coupling::descent::DescentModel;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use results::history;
use results::recording::compare::{Comparison, FIELDS, Field};
use results::settled::SettledMean;
use results::wake::Wake;

use crate::chart::{Axis, Division, Figure, Panel, Panels, Reference, Series, WIDTH, short};
use crate::colour::series;

/// Published steady descent speeds of the ATPS, m/s: the paper of this method, and its reference (Sathe et al. 2007).
const PUBLISHED: [(f64, &str); 2] = [(4.69392, "paper"), (4.78536, "Sathe et al.")];

/// Payload of the published speeds, kg (section 5.1 of the paper), and the largest difference from it with which they are shown: the speed grows
/// with the square root of the mass, so that 2 % are 1 % in the speed.
const PUBLISHED_PAYLOAD_KG: (f64, f64) = (100.6975, 0.02);

/// Published steady descent speeds, m/s, of the parachute of the scene with its payload.
pub fn published(scene: &Scene) -> &'static [(f64, &'static str)] {
    let (mass, most) = PUBLISHED_PAYLOAD_KG;
    let loaded = scene.descent.as_ref().is_some_and(|d| (d.payload_mass_kg / mass - 1.0).abs() <= most);
    if loaded && matches!(scene.canopy, Canopy::Atps(_)) { &PUBLISHED } else { &[] }
}

/// Draws the plot of a coupled stage from its history.
///
/// # Errors
/// The history cannot be read, or the picture cannot be written.
pub fn descent(
    history_file: &Path,
    picture: &Path,
    scene: &Scene,
    interface: &CanopyInterface,
) -> Result<(), RunError> {
    let columns = history::read(history_file)?;
    let column = |name: &str| {
        columns
            .iter()
            .find(|(n, _)| n == name)
            .map(|(_, v)| v.clone())
            .ok_or_else(|| RunError::Input(format!("{} has no column {name}", history_file.display())))
    };
    let (time, speed, drag) = (column("time_s")?, column("descent_speed_m_s")?, column("drag_n")?);
    if time.len() < 2 {
        return Ok(());
    }
    let weight = DescentModel::of(scene, interface).map(|m| m.mass_kg * m.gravity_m_s2);
    // A mean that has not settled, covers too few periods, or is that of a symmetric wake, is not compared with a steady value.
    let settled =
        SettledMean::of("descent_speed_m_s", &columns).is_some_and(|mean| mean.stationary == Some(true));
    let steady = settled && Wake::of_history(&columns).is_some_and(|wake| wake.verdict().is_none());
    let published = if steady { published(scene) } else { &[] };
    let figure = descent_figure(scene, [&time, &speed, &drag], weight, published);
    figure.svg().save(picture)
}

/// Descent speed (upper panel) and drag (lower panel) over time.
fn descent_figure(
    scene: &Scene,
    [time, speed, drag]: [&[f64]; 3],
    weight: Option<f64>,
    published: &[(f64, &str)],
) -> Figure {
    let title = scene.heading();
    let panel = |title: &str, label: &str, values: &[f64], colour, references: Vec<Reference>| {
        let points: Vec<[f64; 2]> = time.iter().zip(values).map(|(t, v)| [*t, *v]).collect();
        let all = values.iter().copied().chain(references.iter().map(|r| r.value));
        Panel {
            title: title.into(),
            x: Axis::spanning("time, s", [0.0].into_iter().chain(time.iter().copied())),
            y: Axis::around(label, false, all),
            series: vec![Series::curve("", colour, points)],
            band: None,
            references,
        }
    };
    let speeds = published.iter().map(|(v, name)| Reference::dashed(*v, format!("{name} {v:.2}"))).collect();
    let weights = weight.into_iter().map(|w| Reference::dashed(w, format!("weight {w:.0}"))).collect();
    let mut upper = panel(title, "descent speed, m/s", speed, series(0), speeds);
    if let Some(last) = speed.last().filter(|v| v.is_finite()) {
        upper.references.push(Reference::reached(*last, format!("{last:.3}"), series(0)));
    }
    let lower = panel("", "drag, N", drag, series(1), weights);
    Figure::Panels(Panels { panels: vec![upper, lower], columns: 1, size: [WIDTH, 310.0] })
}

/// Draws the relative differences of two series of exchanges over the windows.
///
/// # Errors
/// The picture cannot be written.
pub fn difference(picture: &Path, stage: &str, comparison: &Comparison) -> Result<(), RunError> {
    difference_figure(stage, comparison).svg().save(picture)
}

/// Writes the differences over time in the folder `out`: `<stage>-difference.csv` and `.svg`.
///
/// # Errors
/// A file cannot be written.
pub fn differences(out: &Path, stage: &str, comparison: &Comparison) -> Result<(), RunError> {
    std::fs::create_dir_all(out).map_err(RunError::file("create", out))?;
    let path = out.join(format!("{stage}-difference.csv"));
    std::fs::write(&path, comparison.csv()).map_err(RunError::file("write", &path))?;
    difference(&out.join(format!("{stage}-difference.svg")), stage, comparison)
}

fn difference_figure(stage: &str, comparison: &Comparison) -> Figure {
    // Bitwise identical values are drawn at the lower edge, infinite differences at the upper edge.
    let (low, high) = (1e-17f64, 1e2f64);
    let end = comparison.windows.last().map_or(1, |w| w.window).max(1) as f64;
    let curve = |(number, field): (usize, &Field)| {
        let points = comparison
            .windows
            .iter()
            .filter_map(|w| Some([w.window as f64, w.fields[number]?.clamp(low, high)]))
            .collect();
        Series::curve(field.name, series(number), points)
    };
    let tolerance = comparison.tolerance.max(low);
    let panel = Panel {
        title: format!("stage {stage}: relative difference between the runs"),
        x: Axis::spanning("window", [0.0, end].into_iter()),
        y: Axis {
            label: "difference / largest value of the field, -".into(),
            division: Division::Logarithmic,
            range: [low, high],
        },
        series: FIELDS.iter().enumerate().map(curve).filter(|s| !s.points.is_empty()).collect(),
        band: None,
        references: vec![Reference::dashed(tolerance, format!("tolerance {}", short(tolerance)))],
    };
    Figure::Panels(Panels::single(panel, [WIDTH, 420.0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_and_references_are_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let scene = case::load(&file).unwrap();
        let interface = CanopyInterface::new(&scene).unwrap();
        let history = folder.path().join("history.csv");
        let picture = folder.path().join("descent.svg");
        // 200 diameters of stream with a side force of Strouhal number 0.16, and the first of them.
        let draw_scene = |scene: &Scene, side: f64, drift: f64, rows: u32| {
            let mut text =
                String::from("time_s,descent_speed_m_s,drag_n,force_x_n,force_y_n,stream_diameters\n");
            for i in 1..=rows {
                let t = f64::from(i) * 0.5;
                let drag = 1045.0 + 40.0 * (6.0 * t).sin();
                let speed = 4.8 + 0.1 * (0.7 * t).sin() + drift * t;
                text += &format!("{t},{speed},{drag},{},0,{}\n", side * (0.5 * t).sin(), 0.5 * t);
            }
            std::fs::write(&history, text).unwrap();
            descent(&history, &picture, scene, &interface).unwrap();
            std::fs::read_to_string(&picture).unwrap()
        };
        let draw = |side: f64, rows: u32| draw_scene(&scene, side, 0.0, rows);
        let svg = draw(300.0, 800);
        for expected in ["descent speed, m/s", "drag, N", "time, s", "paper 4.69", "Sathe", "weight 10"] {
            assert!(svg.contains(expected), "{expected} is missing");
        }
        let mut heavy = scene.clone();
        heavy.descent.as_mut().unwrap().payload_mass_kg = 168.6835;
        // Neither a part of a swing, nor a symmetric wake, a drifting mean, or another payload is set next to a published value.
        let others = [
            draw(300.0, 20),
            draw(9.0, 800),
            draw_scene(&scene, 300.0, 1e-3, 800),
            draw_scene(&heavy, 300.0, 0.0, 800),
        ];
        for svg in others {
            assert!(!svg.contains("paper 4.69") && svg.contains("weight 1"));
        }
        draw(300.0, 800);
        if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
            std::fs::copy(&picture, Path::new(&keep).join("descent.svg")).unwrap();
        }
    }
}
