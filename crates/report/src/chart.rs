//! Line charts over time, as elements of the page (interactive) and as SVG files.

use std::fmt::Write;

use figures::chart::{Axis, Figure, Panel, Panels, Reference, Series as Curve};
use figures::colour;
use maud::html;

/// Maximum number of points drawn per curve, above one per pixel.
const MAX_POINTS: usize = 700;
/// Width and height, pixels.
const SIZE: [f64; 2] = [550.0, 250.0];

/// A curve.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) label: String,
    /// Time, s, and value; a value that is not finite interrupts the curve.
    pub(super) points: Vec<(f64, f64)>,
}

/// Curves on common axes.
#[derive(Clone, Debug, Default)]
pub(super) struct Chart {
    /// Name of the anchor and of the file.
    pub(super) id: String,
    pub(super) title: String,
    pub(super) unit: &'static str,
    /// Caption.
    pub(super) note: String,
    pub(super) series: Vec<Series>,
    /// Reference values, as dashed lines.
    pub(super) references: Vec<(f64, String)>,
    /// Logarithmic axis of values.
    pub(super) logarithmic: bool,
    /// Horizontal axis of a path, which need not go from left to right. Empty: time.
    pub(super) along: &'static str,
}

/// A number with four significant digits; with an exponent only below 1e-3 or from 1e5.
pub(super) fn digits(value: f64) -> String {
    if !value.is_finite() {
        return "-".into();
    }
    let size = value.abs();
    if size == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&size) {
        let places = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
        format!("{value:.places$}")
    } else {
        format!("{value:.2e}")
    }
}

/// Thins a curve: the minimum and the maximum of each interval.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= MAX_POINTS {
        return points.to_vec();
    }
    let mut kept = Vec::with_capacity(MAX_POINTS);
    for part in points.chunks(points.len().div_ceil(MAX_POINTS / 2)) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        if let (Some(low), Some(high)) = (part.iter().min_by(by), part.iter().max_by(by)) {
            kept.extend(if low.0 <= high.0 { [*low, *high] } else { [*high, *low] });
        }
    }
    kept
}

/// Thins a path: every n-th point and the last.
fn thin_path(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    let last = points.len().saturating_sub(1);
    points.iter().enumerate().filter(|(i, _)| i % step == 0 || *i == last).map(|(_, p)| *p).collect()
}

/// Replaces `m2` and `m3` by superscripts.
pub(super) fn units(text: &str) -> String {
    text.replace(" m2", " m\u{b2}").replace(" m3", " m\u{b3}")
}

impl Chart {
    /// Whether no curve has two finite points.
    pub(super) fn is_empty(&self) -> bool {
        !self.series.iter().any(|s| s.points.iter().filter(|p| p.1.is_finite()).count() >= 2)
    }

    /// Title and unit.
    pub(super) fn heading(&self) -> String {
        if self.unit.is_empty() {
            self.title.clone()
        } else {
            units(&format!("{}, {}", self.title, self.unit))
        }
    }

    /// The thinned curves with their axes.
    fn panels(&self) -> Panels {
        let finite = || self.series.iter().flat_map(|s| &s.points).filter(|p| p.1.is_finite());
        let values = finite().map(|p| p.1).chain(self.references.iter().map(|r| r.0));
        let time = self.along.is_empty();
        let along = if time { "time, s" } else { self.along };
        let curve = |(i, s): (usize, &Series)| {
            let kept = if time { thin(&s.points) } else { thin_path(&s.points) };
            let points = kept.into_iter().map(|(x, y)| [x, y]).collect();
            Curve::curve(&s.label, colour::series(i), points)
        };
        let panel = Panel {
            title: String::new(),
            x: Axis::spanning(along, finite().map(|p| p.0)),
            y: Axis::around(&self.heading(), self.logarithmic, values),
            series: self.series.iter().enumerate().map(curve).collect(),
            band: None,
            references: self
                .references
                .iter()
                .map(|(v, label)| Reference::dashed(*v, label.clone()))
                .collect(),
        };
        Panels::single(panel, SIZE)
    }

    /// The chart as an SVG file.
    pub(super) fn file(&self) -> String {
        Figure::Panels(self.panels()).svg().file()
    }

    /// The chart as an SVG element of the page, with the data for its script.
    pub(super) fn element(&self) -> String {
        let panels = self.panels();
        let words = self.words();
        if !self.along.is_empty() {
            let attributes = [("class", "path"), ("role", "img"), ("aria-label", words.as_str())];
            return Figure::Panels(panels).svg().element(&attributes, "");
        }
        let data = panels.data_box(0).expect("a chart has one panel");
        let list = |numbers: [f64; 4]| numbers.map(|n| n.to_string()).join(",");
        let [x0, x1, y0, y1] = data.span;
        let height = |v: f64| if self.logarithmic { v.log10() } else { v };
        let (place, span) = (list(data.place), list([x0, x1, height(y0), height(y1)]));
        let pixel = data.pixel.to_string();
        let mut attributes = vec![
            ("class", "chart"),
            ("role", "img"),
            ("aria-label", words.as_str()),
            ("tabindex", "0"),
            ("data-box", place.as_str()),
            ("data-span", span.as_str()),
            ("data-pixel", pixel.as_str()),
            ("data-unit", self.unit),
        ];
        if self.logarithmic {
            attributes.push(("data-log", "1"));
        }
        let points = |series: &Series| {
            let shown = thin(&series.points).into_iter().filter(|p| p.1.is_finite());
            shown.map(|(x, y)| format!("{},{}", digits(x), digits(y))).collect::<Vec<_>>().join(";")
        };
        let curves = html! {
            @for (i, series) in self.series.iter().enumerate() {
                g class=(format!("curve c{}", i % colour::SERIES.len())) data-label=(series.label)
                    data-points=(points(series)) {}
            }
        };
        Figure::Panels(panels).svg().element(&attributes, &curves.into_string())
    }

    /// Text alternative: range of each curve.
    pub(super) fn words(&self) -> String {
        let over = if self.along.is_empty() { "time" } else { self.along };
        let mut text = format!("{} over {over}.", self.title);
        for series in &self.series {
            let finite: Vec<(f64, f64)> = series.points.iter().copied().filter(|p| p.1.is_finite()).collect();
            let (Some(first), Some(last)) = (finite.first(), finite.last()) else { continue };
            let low = finite.iter().map(|p| p.1).fold(f64::MAX, f64::min);
            let high = finite.iter().map(|p| p.1).fold(f64::MIN, f64::max);
            let _ = write!(
                text,
                " {}: from {} to {} {unit}, between {} and {} {unit}.",
                series.label,
                digits(first.1),
                digits(last.1),
                digits(low),
                digits(high),
                unit = self.unit
            );
        }
        text
    }
}

/// Style sheet of the charts.
pub(super) const STYLE: &str = include_str!("page/chart.css");
