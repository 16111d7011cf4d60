//! Curves over time as SVG, for the page (with values under the pointer) and as files.

use std::fmt::Write;

/// Most points of a curve that are drawn: more than one for each pixel of its width.
const MOST: usize = 700;
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 250.0;
/// Left, right, top, bottom of the plot inside the picture.
const BOX: [f64; 4] = [66.0, 14.0, 12.0, 34.0];

/// A curve.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) label: String,
    /// Time and value; what is not finite breaks the curve.
    pub(super) points: Vec<(f64, f64)>,
}

/// Curves on common axes.
#[derive(Clone, Debug, Default)]
pub(super) struct Chart {
    /// For anchors and files.
    pub(super) id: String,
    pub(super) title: String,
    pub(super) unit: &'static str,
    /// What it shows, in a sentence.
    pub(super) note: String,
    pub(super) series: Vec<Series>,
    /// Values to compare with, as dashed lines.
    pub(super) references: Vec<(f64, String)>,
    /// Decades instead of even steps.
    pub(super) logarithmic: bool,
}

/// Text for XML and HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Four digits, without a power of ten where it can be read without.
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

/// The points that a picture can show: of each part of the time the lowest and the highest.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= MOST {
        return points.to_vec();
    }
    let mut kept = Vec::with_capacity(MOST);
    for part in points.chunks(points.len().div_ceil(MOST / 2)) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        if let (Some(low), Some(high)) = (part.iter().min_by(by), part.iter().max_by(by)) {
            kept.extend(if low.0 <= high.0 { [*low, *high] } else { [*high, *low] });
        }
    }
    kept
}

/// Round values between two, some `most`.
fn ticks(low: f64, high: f64, most: f64) -> (Vec<f64>, usize) {
    let rough = (high - low) / most;
    let unit = 10f64.powf(rough.log10().floor());
    let step =
        [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * unit).find(|s| *s >= rough * 0.999).unwrap_or(rough);
    let places = (-(step * 1.001).log10().floor()).max(0.0) as usize;
    let first = (low / step - 1e-9).ceil();
    let all = (0..30).map(|i| (first + f64::from(i)) * step).take_while(|t| *t <= high + 1e-9 * step);
    (all.map(|t| t + 0.0).collect(), places)
}

impl Chart {
    /// Whether there is anything to draw: two points of one curve.
    pub(super) fn is_empty(&self) -> bool {
        !self.series.iter().any(|s| s.points.iter().filter(|p| p.1.is_finite()).count() >= 2)
    }

    fn height(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-300).log10() } else { value }
    }

    fn spans(&self) -> ([f64; 2], [f64; 2]) {
        let finite = || self.series.iter().flat_map(|s| &s.points).filter(|p| p.1.is_finite());
        let fit = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::MAX, f64::MIN], |[l, h], v| [l.min(v), h.max(v)])
        };
        let mut x = fit(&mut finite().map(|p| p.0));
        if x[1] - x[0] <= 0.0 {
            x = [x[0] - 0.5, x[0] + 0.5];
        }
        let zero = |v: f64| !self.logarithmic || v > 0.0;
        let own = finite().map(|p| p.1).filter(|v| zero(*v));
        let all = own.chain(self.references.iter().map(|r| r.0)).map(|v| self.height(v));
        let mut y = fit(&mut all.collect::<Vec<_>>().into_iter());
        let margin = (0.06 * (y[1] - y[0])).max(1e-3 * y[1].abs().max(y[0].abs())).max(1e-9);
        // What is never below zero is shown from it where that costs little room.
        let floor = if !self.logarithmic && y[0] >= 0.0 && y[0] < 0.3 * y[1] { 0.0 } else { y[0] - margin };
        y = [floor, y[1] + margin];
        (x, y)
    }

    /// The picture; `alone` as a file of its own, with its colours, or else for the page.
    pub(super) fn svg(&self, alone: bool) -> String {
        let ([x0, x1], [y0, y1]) = self.spans();
        let [left, right, top, bottom] = BOX;
        let (w, h) = (WIDTH - left - right, HEIGHT - top - bottom);
        let px = |x: f64| left + w * (x - x0) / (x1 - x0);
        let py = |y: f64| top + h * (1.0 - (y - y0) / (y1 - y0));
        let mut out = String::new();
        // Writing to a string does not fail.
        let _ = write!(
            out,
            "<svg class=\"chart\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
             aria-label=\"{}\" data-box=\"{left},{top},{w},{h}\" data-span=\"{x0},{x1},{y0},{y1}\" \
             data-unit=\"{}\"{}{}>",
            escape(&self.words()),
            self.unit,
            if self.logarithmic { " data-log=\"1\"" } else { "" },
            if alone { "" } else { " tabindex=\"0\"" }
        );
        if alone {
            let _ =
                write!(out, "<style>{}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>", STYLE);
        }
        let (marks, places) = if self.logarithmic {
            let decades = (y0.ceil() as i32..=y1.floor() as i32).map(f64::from).collect();
            (decades, 0)
        } else {
            ticks(y0, y1, 5.0)
        };
        for mark in marks {
            let label = if self.logarithmic { format!("1e{mark:.0}") } else { format!("{mark:.places$}") };
            let y = py(mark);
            let _ = write!(
                out,
                "<path class=\"grid\" d=\"M{left} {y:.1}h{w}\"/><text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{label}</text>",
                left - 6.0,
                y + 4.0
            );
        }
        let (marks, places) = ticks(x0, x1, 7.0);
        for mark in marks {
            let _ = write!(
                out,
                "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{mark:.places$}</text>",
                px(mark),
                top + h + 16.0
            );
        }
        let _ = write!(
            out,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">time, s</text>",
            left + w,
            HEIGHT - 4.0
        );
        let _ = write!(out, "<path class=\"axis\" d=\"M{left} {:.1}h{w}\"/>", top + h);
        // Labels of values that lie close together stand below each other.
        let mut references: Vec<&(f64, String)> = self.references.iter().collect();
        references.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut free = f64::MIN;
        for (value, label) in references {
            let y = py(self.height(*value));
            let below = y - 4.0 < free;
            let at = if below { free.max(y + 14.0) } else { y - 4.0 };
            free = at + 14.0;
            let _ = write!(
                out,
                "<path class=\"reference\" d=\"M{left} {y:.1}h{w}\"/><text class=\"tick label\" x=\"{:.1}\" y=\"{at:.1}\" \
                 text-anchor=\"end\">{}</text>",
                left + w - 4.0,
                escape(label)
            );
        }
        for (i, series) in self.series.iter().enumerate() {
            let points = thin(&series.points);
            let mut path = String::new();
            let mut pen = false;
            for &(x, y) in &points {
                let drawn = y.is_finite() && (!self.logarithmic || y > 0.0);
                if drawn {
                    let _ =
                        write!(path, "{}{:.1} {:.1}", if pen { 'L' } else { 'M' }, px(x), py(self.height(y)));
                }
                pen = drawn;
            }
            let data: Vec<String> = points
                .iter()
                .filter(|p| p.1.is_finite())
                .map(|(x, y)| format!("{},{}", digits(*x), digits(*y)))
                .collect();
            let data = if alone { String::new() } else { format!(" data-points=\"{}\"", data.join(";")) };
            let _ = write!(
                out,
                "<path class=\"curve c{}\" d=\"{path}\" data-label=\"{}\"{data}/>",
                i % COLOURS,
                escape(&series.label)
            );
        }
        if alone && self.series.len() > 1 {
            let mut x = left + 8.0;
            for (i, series) in self.series.iter().enumerate() {
                let _ = write!(
                    out,
                    "<path class=\"curve c{0}\" d=\"M{x:.1} {1:.1}h14\"/><text class=\"tick\" x=\"{2:.1}\" y=\"{3:.1}\">{4}</text>",
                    i % COLOURS,
                    top + 8.0,
                    x + 18.0,
                    top + 12.0,
                    escape(&series.label)
                );
                x += 30.0 + 6.6 * series.label.len() as f64;
            }
        }
        out.push_str("</svg>");
        out
    }

    /// What a reader who does not see the picture needs of it.
    pub(super) fn words(&self) -> String {
        let mut text = format!("{} over time.", self.title);
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

/// Number of colours of curves.
pub(super) const COLOURS: usize = 6;

/// Colours of pictures that are files of their own; the page has the same.
pub(super) const STYLE: &str = include_str!("page/chart.css");
