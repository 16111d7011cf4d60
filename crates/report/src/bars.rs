//! Bars as SVG: shares of a whole for each stage, and columns of a value for each line.

use std::fmt::Write;

use super::chart::{STYLE, digits, escape};

const WIDTH: f64 = 960.0;

/// Stacked bars, one for each row.
pub(super) struct Bars {
    pub(super) id: String,
    pub(super) title: String,
    pub(super) unit: &'static str,
    pub(super) note: String,
    /// Names of the parts, in the order of their colours.
    pub(super) parts: Vec<&'static str>,
    /// Name and a value for each part.
    pub(super) rows: Vec<(String, Vec<f64>)>,
    /// Columns that stand beside each other on one scale, instead of bars that fill the width.
    pub(super) upright: bool,
}

impl Bars {
    fn open(&self, height: f64, alone: bool) -> String {
        let paper = if alone {
            format!("<style>{STYLE}</style><rect class=\"paper\" width=\"100%\" height=\"100%\"/>")
        } else {
            String::new()
        };
        format!(
            "<svg class=\"bars\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
             aria-label=\"{}\">{paper}",
            escape(&self.title)
        )
    }

    /// Columns with their values above and their names below.
    fn columns(&self, alone: bool) -> String {
        let (height, foot) = (210.0, 180.0);
        let mut out = self.open(height, alone);
        let most = self.rows.iter().map(|(_, v)| v.iter().sum::<f64>()).fold(f64::MIN_POSITIVE, f64::max);
        let step = (WIDTH / self.rows.len().max(1) as f64).min(60.0);
        // Values are written where there is room for them, and stand in the title in any case.
        let room = step >= 28.0;
        for (i, (name, values)) in self.rows.iter().enumerate() {
            let total: f64 = values.iter().sum();
            let (x, tall) = (step * i as f64, 150.0 * (total / most).max(0.0));
            let middle = x + 0.5 * step;
            let _ = write!(
                out,
                "<rect class=\"f0\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{tall:.1}\" rx=\"2\"><title>{} {name}: {} \
                 {}</title></rect><text class=\"name\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                x + 0.15 * step,
                foot - tall,
                0.7 * step,
                self.parts[0],
                digits(total),
                self.unit,
                foot + 18.0,
                escape(name)
            );
            if room {
                let _ = write!(
                    out,
                    "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{total:.0}</text>",
                    foot - tall - 5.0
                );
            }
        }
        out.push_str("</svg>");
        out
    }

    /// The picture; `alone` as a file of its own.
    pub(super) fn svg(&self, alone: bool) -> String {
        if self.upright {
            return self.columns(alone);
        }
        let (left, step) = (150.0, 34.0);
        let legend = if self.parts.len() > 1 { 30.0 } else { 4.0 };
        let height = legend + step * self.rows.len() as f64 + 6.0;
        let room = WIDTH - left - 80.0;
        let mut out = self.open(height, alone);
        if self.parts.len() > 1 {
            let mut x = left;
            for (i, part) in self.parts.iter().enumerate() {
                let _ = write!(
                    out,
                    "<rect class=\"f{i}\" x=\"{x:.0}\" y=\"6\" width=\"12\" height=\"12\" rx=\"2\"/>\
                     <text class=\"name\" x=\"{:.0}\" y=\"16\">{part}</text>",
                    x + 17.0
                );
                x += 34.0 + 6.8 * part.len() as f64;
            }
        }
        for (r, (name, values)) in self.rows.iter().enumerate() {
            let y = legend + step * r as f64;
            let total = values.iter().sum::<f64>();
            let scale = room / total.max(f64::MIN_POSITIVE);
            let _ = write!(
                out,
                "<text class=\"name\" x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 10.0,
                y + 0.5 * step + 2.0,
                escape(name)
            );
            let mut x = left;
            for (i, value) in values.iter().enumerate() {
                let width = scale * value;
                if width > 0.05 {
                    let _ = write!(
                        out,
                        "<rect class=\"f{i}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{:.1}\">\
                         <title>{}: {} {} ({:.1} %)</title></rect>",
                        y + 3.0,
                        step - 8.0,
                        self.parts[i],
                        digits(*value),
                        self.unit,
                        100.0 * value / total.max(f64::MIN_POSITIVE)
                    );
                }
                x += width;
            }
            let _ = write!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\">{} {}</text>",
                x + 8.0,
                y + 0.5 * step + 2.0,
                digits(total),
                self.unit
            );
        }
        out.push_str("</svg>");
        out
    }
}
