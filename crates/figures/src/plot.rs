//! `descent.svg`: descent speed and drag over time.

use std::ops::Range;
use std::path::Path;

use case::{Canopy, Scene};
use coupling::descent::DescentModel;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use plotters::prelude::*;
use results::history;
use results::recording::compare::{Comparison, FIELDS};

/// Published steady descent speeds of the ATPS, m/s: this method's paper, and
/// the reference it compares with (Sathe et al. 2007).
const PUBLISHED: [(f64, &str); 2] = [(4.69392, "paper"), (4.78536, "Sathe et al.")];

/// Published steady descent speeds of the scene's parachute, m/s.
pub fn published(scene: &Scene) -> &'static [(f64, &'static str)] {
    if matches!(scene.canopy, Canopy::Atps(_)) { &PUBLISHED } else { &[] }
}

const SPEED: RGBColor = RGBColor(31, 91, 152);
const DRAG: RGBColor = RGBColor(190, 82, 22);
const GREY: RGBColor = RGBColor(110, 110, 110);

/// Draws the plot of a coupled stage from its history.
///
/// # Errors
/// A history that cannot be read, or a picture that cannot be written.
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
    draw(picture, scene, [&time, &speed, &drag], weight, published(scene)).map_err(|e| RunError::File {
        action: "draw",
        path: picture.into(),
        source: std::io::Error::other(e.to_string()),
    })
}

fn draw(
    picture: &Path,
    scene: &Scene,
    [time, speed, drag]: [&[f64]; 3],
    weight: Option<f64>,
    published: &[(f64, &str)],
) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::new(picture, (960, 640)).into_drawing_area();
    root.fill(&WHITE)?;
    let title = scene.heading();
    let root = root.titled(title, ("sans-serif", 20).into_font().color(&BLACK))?;
    let (upper, lower) = root.split_vertically(290);
    let end = time.last().copied().unwrap_or(1.0);
    let references: Vec<f64> = published.iter().map(|p| p.0).collect();
    let mut chart = ChartBuilder::on(&upper)
        .margin_right(120)
        .margin_top(6)
        .x_label_area_size(12)
        .y_label_area_size(74)
        .build_cartesian_2d(0.0..end, span(speed, &references))?;
    mesh(&mut chart, "descent speed, m/s", "", 3)?;
    for &(value, name) in published {
        chart.draw_series(DashedLineSeries::new([(0.0, value), (end, value)], 6, 4, GREY.stroke_width(1)))?;
        note(&mut chart, end, value, &format!("{name} {value:.2}"), GREY)?;
    }
    chart.draw_series(LineSeries::new(zip(time, speed), SPEED.stroke_width(2)))?;
    if let Some(&last) = speed.last()
        && references.iter().all(|r| (r - last).abs() > 0.02)
    {
        note(&mut chart, end, last, &format!("{last:.3}"), SPEED)?;
    }
    let references: Vec<f64> = weight.into_iter().collect();
    let mut chart = ChartBuilder::on(&lower)
        .margin_right(120)
        .margin_bottom(6)
        .x_label_area_size(44)
        .y_label_area_size(74)
        .build_cartesian_2d(0.0..end, span(drag, &references))?;
    mesh(&mut chart, "drag, N", "time, s", 0)?;
    if let Some(weight) = weight {
        chart.draw_series(DashedLineSeries::new(
            [(0.0, weight), (end, weight)],
            6,
            4,
            GREY.stroke_width(1),
        ))?;
        note(&mut chart, end, weight, &format!("weight {weight:.0}"), GREY)?;
    }
    chart.draw_series(LineSeries::new(zip(time, drag), DRAG.stroke_width(2)))?;
    root.present()?;
    Ok(())
}

/// Colours of the fields of a comparison.
const FIELD_COLOURS: [RGBColor; 8] = [
    RGBColor(31, 91, 152),
    RGBColor(120, 160, 205),
    RGBColor(190, 82, 22),
    RGBColor(225, 160, 110),
    RGBColor(46, 125, 50),
    RGBColor(140, 190, 120),
    RGBColor(123, 31, 162),
    RGBColor(190, 140, 205),
];

/// Draws how the difference of two series of exchanges grows over the windows.
///
/// # Errors
/// A picture that cannot be written.
pub fn difference(picture: &Path, stage: &str, comparison: &Comparison) -> Result<(), RunError> {
    draw_difference(picture, stage, comparison).map_err(|e| RunError::File {
        action: "draw",
        path: picture.into(),
        source: std::io::Error::other(e.to_string()),
    })
}

fn draw_difference(
    picture: &Path,
    stage: &str,
    comparison: &Comparison,
) -> Result<(), Box<dyn std::error::Error>> {
    // What is the same to the bit lies on the lower edge, what has no bound on the upper one.
    let (low, high) = (1e-17f64, 1e2f64);
    let root = SVGBackend::new(picture, (960, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let end = comparison.windows.last().map_or(1, |w| w.window).max(1) as f64;
    let mut chart = ChartBuilder::on(&root)
        .caption(format!("stage {stage}: difference over the largest of the field"), ("sans-serif", 18))
        .margin(8)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end, (low..high).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("window")
        .y_label_formatter(&|v| format!("{v:.0e}"))
        .x_label_formatter(&|v| format!("{v:.0}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(226, 226, 226))
        .draw()?;
    let tolerance = comparison.tolerance.max(low);
    chart.draw_series(DashedLineSeries::new(
        [(0.0, tolerance), (end, tolerance)],
        6,
        4,
        GREY.stroke_width(1),
    ))?;
    for (number, field) in FIELDS.iter().enumerate() {
        let points: Vec<(f64, f64)> = comparison
            .windows
            .iter()
            .filter_map(|w| Some((w.window as f64, w.fields[number]?.clamp(low, high))))
            .collect();
        if points.is_empty() {
            continue;
        }
        let colour = FIELD_COLOURS[number];
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
            .label(field.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(GREY).draw()?;
    root.present()?;
    Ok(())
}

type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn mesh(
    chart: &mut Chart<'_, '_>,
    y: &str,
    x: &str,
    digits: usize,
) -> Result<(), Box<dyn std::error::Error>> {
    chart
        .configure_mesh()
        .y_desc(y)
        .x_desc(x)
        .y_label_formatter(&|v| format!("{v:.digits$}"))
        .x_label_formatter(&|v| if x.is_empty() { String::new() } else { format!("{v:.2}") })
        .label_style(("sans-serif", 14))
        .axis_desc_style(("sans-serif", 15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(226, 226, 226))
        .draw()?;
    Ok(())
}

/// Text just right of the plotting area.
fn note(
    chart: &mut Chart<'_, '_>,
    x: f64,
    y: f64,
    text: &str,
    colour: RGBColor,
) -> Result<(), Box<dyn std::error::Error>> {
    let (px, py) = chart.backend_coord(&(x, y));
    chart.plotting_area().strip_coord_spec();
    let style = ("sans-serif", 13).into_font().color(&colour);
    chart.plotting_area().get_base_pixel();
    let (bx, by) = chart.plotting_area().get_base_pixel();
    chart.plotting_area().strip_coord_spec().draw_text(text, &style, (px - bx + 6, py - by - 7))?;
    Ok(())
}

fn zip<'a>(x: &'a [f64], y: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + 'a {
    x.iter().copied().zip(y.iter().copied()).filter(|(_, y)| y.is_finite())
}

/// Range of values and references with a margin; never empty.
fn span(values: &[f64], references: &[f64]) -> Range<f64> {
    let all = values.iter().chain(references).copied().filter(|v| v.is_finite());
    let (low, high) = all.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let margin = (0.06 * (high - low)).max(1e-3 * high.abs()).max(1e-9);
    low - margin..high + margin
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_never_empty() {
        for r in [span(&[1.0], &[]), span(&[0.0, 0.0], &[]), span(&[f64::NAN, 2.0], &[3.0])] {
            assert!(r.end > r.start);
        }
        assert!(span(&[1.0, 2.0], &[5.0]).contains(&5.0));
    }

    #[test]
    fn draws_curves_and_references() {
        let folder = tempfile::tempdir().unwrap();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let scene = case::load(&file).unwrap();
        let interface = CanopyInterface::new(&scene).unwrap();
        let history = folder.path().join("history.csv");
        let mut text = String::from("time_s,descent_speed_m_s,drag_n\n");
        for i in 1..=200 {
            let t = f64::from(i) * 5e-3;
            text += &format!("{t},{},{}\n", 4.8 - 0.1 * t, 1045.0 + 40.0 * (6.0 * t).sin());
        }
        std::fs::write(&history, text).unwrap();
        let picture = folder.path().join("descent.svg");
        descent(&history, &picture, &scene, &interface).unwrap();
        let svg = std::fs::read_to_string(&picture).unwrap();
        for expected in ["descent speed, m/s", "drag, N", "time, s", "paper 4.69", "Sathe", "weight 10"] {
            assert!(svg.contains(expected), "{expected} is missing");
        }
        if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
            std::fs::copy(&picture, keep).unwrap();
        }
    }
}
