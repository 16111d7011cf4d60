//! The page of a sweep, and its table for the terminal.

use figures::chart::{Axis, Figure, Mark, Panel, Panels, Series, short};
use figures::colour;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::collect::{Quantity, Row, Value, is_known};
use super::plan::{Point, Variation};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#20262e}\
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse;font-size:13px}\
th,td{padding:3px 9px;border-bottom:1px solid #dde;text-align:right;white-space:nowrap}th:first-child,td:first-child{text-align:left}\
tr.failed td{color:#a33}p.s{color:#556}svg{max-width:100%;height:auto}.scroll{overflow-x:auto}code{background:#f2f4f6;padding:1px 4px}";

/// What a sweep is and gave.
pub struct Results<'a> {
    /// Title of the scene.
    pub title: &'a str,
    /// The command line.
    pub command: &'a str,
    /// Varied keys.
    pub variations: &'a [Variation],
    /// What the table has of each run.
    pub quantities: &'a [Quantity],
    /// Runs.
    pub points: &'a [Point],
    /// Their results.
    pub rows: &'a [Row],
}

/// A mean with its interval in the digits of the interval; in brackets where it is not settled.
pub fn shown(value: Option<Value>) -> String {
    match value {
        None => "-".into(),
        Some(Value { mean, interval: Some(half_width) }) if half_width > 0.0 => {
            let places = (1.0 - half_width.log10().floor()).clamp(0.0, 9.0) as usize;
            format!("{mean:.places$} ± {half_width:.places$}")
        }
        Some(Value { mean, .. }) => format!("({})", short(mean)),
    }
}

impl Results<'_> {
    /// Positions of the quantities that any run has.
    fn known(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.quantities.len()).filter(|q| is_known(self.rows, *q))
    }

    /// The table for the terminal: the first quantities, three of them coefficients of forces where there are some.
    pub fn table(&self) -> String {
        let (forces, others): (Vec<usize>, Vec<usize>) =
            self.known().partition(|q| self.quantities[*q].of_forces);
        let quantities: Vec<usize> = forces.into_iter().take(3).chain(others).take(4).collect();
        let mut lines = vec![vec![String::from("run")]];
        lines[0].extend(quantities.iter().map(|q| self.quantities[*q].title(", ", "")));
        lines[0].extend(["wake".into(), "ended".into()]);
        for (point, row) in self.points.iter().zip(self.rows) {
            let mut cells = vec![point.name.clone()];
            cells.extend(quantities.iter().map(|q| shown(row.values[*q])));
            cells.push(if row.wake.is_empty() { "-".into() } else { row.wake.clone() });
            cells.push(row.ended.clone());
            lines.push(cells);
        }
        let count = |text: &String| text.chars().count();
        let widths: Vec<usize> =
            (0..lines[0].len()).map(|k| lines.iter().map(|l| count(&l[k])).max().unwrap_or(0)).collect();
        let padded = |line: &Vec<String>| {
            let cells =
                line.iter().zip(&widths).map(|(text, w)| format!("{text}{}", " ".repeat(w - count(text))));
            format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
        };
        lines.iter().map(padded).collect()
    }

    /// The page, self-contained HTML.
    pub fn page(&self) -> String {
        let complete = self.rows.iter().filter(|r| r.complete).count();
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    title { "Sweep: " (self.title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    h1 { "Sweep: " (self.title) }
                    p.s { (complete) " of " (self.points.len()) " runs are complete." }
                    p.s {
                        "Means of the last coupled stage, or of the last stage, with 95 % intervals. In brackets: the mean of the last half of the windows of a run \
                         that has no settled mean. The column wake names the check that the means of a run do not pass: the interval may then be \
                         too narrow, or the wake symmetric."
                    }
                    div.scroll { (self.html_table()) }
                    @for figure in self.figures() { (PreEscaped(figure.svg().element(&[], ""))) }
                    p.s { code { (self.command) } }
                }
            }
        };
        page.into_string()
    }

    fn html_table(&self) -> Markup {
        let known: Vec<usize> = self.known().collect();
        html! {
            table {
                thead {
                    tr {
                        @for v in self.variations { th { (v.key) } }
                        @for q in &known { th { (self.quantities[*q].title(", ", "")) } }
                        th { "time, s" }
                        th { "wall, s" }
                        th { "warnings" }
                        th { "wake" }
                        th { "ended" }
                    }
                }
                tbody {
                    @for (point, row) in self.points.iter().zip(self.rows) {
                        tr class=(if row.complete { "" } else { "failed" }) {
                            @for value in &point.values { td { (value) } }
                            @for q in &known { td { (shown(row.values[*q])) } }
                            td { (short(row.time_s)) }
                            td { (short(row.wall_s)) }
                            td { (row.warnings) }
                            td { (row.wake) }
                            td { a href={ (point.name) "/summary.json" } { (row.ended) } }
                        }
                    }
                }
            }
        }
    }

    /// Value of the varied key `k` in a chart: a number, or the angle in degrees between a vector and the first value of the key.
    fn abscissa(&self, k: usize, point: &Point) -> Option<f64> {
        let value = &point.values[k];
        let first = vector(&self.variations[k].values[0]);
        value.parse::<f64>().ok().or_else(|| angle_deg(first?, vector(value)?))
    }

    fn axis_title(&self, k: usize) -> String {
        let v = &self.variations[k];
        match vector(&v.values[0]) {
            Some(_) => format!("angle between {} and its first value (deg)", v.key),
            None => v.key.clone(),
        }
    }

    /// A chart for each quantity over the first key with numbers, a series for each combination of the others.
    pub fn figures(&self) -> Vec<Figure> {
        let number = |k: usize, p: &Point| self.abscissa(k, p);
        let numeric = |k: &usize| {
            self.variations[*k].values.len() > 1 && self.points.iter().all(|p| number(*k, p).is_some())
        };
        let Some(axis) = (0..self.variations.len()).find(numeric) else { return Vec::new() };
        let others = |p: &Point| {
            let parts = self.variations.iter().zip(&p.values).enumerate().filter(|(k, _)| *k != axis);
            parts.map(|(_, (v, value))| format!("{} = {value}", v.key)).collect::<Vec<_>>().join(", ")
        };
        let mut names: Vec<String> = Vec::new();
        for name in self.points.iter().map(others) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        self.known()
            .filter_map(|q| {
                let series: Vec<Series> = names
                    .iter()
                    .enumerate()
                    .filter_map(|(at, name)| {
                        let of_series = self.points.iter().zip(self.rows).filter(|(p, _)| others(p) == *name);
                        let mut values: Vec<([f64; 2], f64)> = of_series
                            .filter_map(|(p, r)| {
                                let value = r.values[q]?;
                                Some(([number(axis, p)?, value.mean], value.interval.unwrap_or(0.0)))
                            })
                            .collect();
                        values.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
                        let points = values.iter().map(|v| v.0).collect();
                        let bands = values.iter().map(|v| v.1).collect();
                        let curve = Series::curve(name, colour::series(at), points);
                        (!values.is_empty()).then_some(Series { mark: Mark::Dot, bands, ..curve })
                    })
                    .collect();
                let x = series.iter().flat_map(|s| s.points.iter().map(|p| p[0]));
                let ends = |s: &Series| {
                    let ends = s.points.iter().zip(&s.bands).flat_map(|(p, b)| [p[1] - b, p[1] + b]);
                    ends.collect::<Vec<f64>>()
                };
                if x.clone().count() < 2 {
                    return None;
                }
                let panel = Panel {
                    title: String::new(),
                    x: Axis::around(&self.axis_title(axis), false, x),
                    y: Axis::around(
                        &self.quantities[q].title(" (", ")"),
                        false,
                        series.iter().flat_map(ends),
                    ),
                    series: series.clone(),
                    band: None,
                    references: Vec::new(),
                };
                Some(Figure::Panels(Panels::single(panel, [720.0, 320.0])))
            })
            .collect()
    }
}

/// Components of `[x, y, z]`.
fn vector(text: &str) -> Option<[f64; 3]> {
    let inner = text.trim().strip_prefix('[')?.strip_suffix(']')?;
    let numbers: Vec<f64> = inner.split(',').map(|x| x.trim().parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}

/// Angle between two vectors, degrees; `None` where one of them is zero.
fn angle_deg(a: [f64; 3], b: [f64; 3]) -> Option<f64> {
    let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>();
    let product = (dot(a, a) * dot(b, b)).sqrt();
    (product > 0.0).then(|| (dot(a, b) / product).clamp(-1.0, 1.0).acos().to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::collect::quantities;
    use crate::sweep::plan::points;

    fn row(speed: Option<(f64, Option<f64>)>) -> Row {
        let mut values = vec![None; quantities(&[]).len()];
        values[0] = speed.map(|(mean, interval)| Value { mean, interval });
        Row {
            ended: "complete".into(),
            complete: true,
            time_s: 1.0,
            wall_s: 2.0,
            warnings: 0,
            wake: String::new(),
            values,
        }
    }

    #[test]
    fn values_are_shown_in_the_digits_of_their_interval() {
        assert_eq!(shown(Some(Value { mean: 4.48921, interval: Some(0.0831) })), "4.489 ± 0.083");
        assert_eq!(shown(Some(Value { mean: 1045.9, interval: Some(12.0) })), "1046 ± 12");
        assert_eq!(shown(Some(Value { mean: 4.5, interval: None })), "(4.5)");
        assert_eq!(shown(None), "-");
    }

    #[test]
    fn page_has_a_row_for_each_run_and_a_chart_for_each_quantity() {
        let variations: Vec<Variation> =
            ["m=90,120,150", "kind=a,b"].iter().map(|t| t.parse().unwrap()).collect();
        let points = points(&variations, false).unwrap();
        let rows: Vec<Row> =
            (0..6).map(|i| row((i < 5).then_some((4.0 + f64::from(i), Some(0.1))))).collect();
        let results = Results {
            title: "drop",
            command: "ripstop sweep",
            variations: &variations,
            quantities: &quantities(&[]),
            points: &points,
            rows: &rows,
        };
        let page = results.page();
        assert_eq!(page.matches("<tr class").count(), 6);
        assert_eq!(results.figures().len(), 1);
        assert!(page.contains("kind = b") && page.contains("descent speed (m/s)"), "{page}");
        let table = results.table();
        assert_eq!(table.lines().count(), 7);
        assert_eq!(results.axis_title(0), "m");
        assert!(table.contains("4.00 ± 0.10") && table.lines().last().unwrap().contains(" -  "), "{table}");
    }

    /// The coefficients of an entry are columns of their own, and stand first on the terminal; a vector is drawn over its angle to the first value.
    #[test]
    fn stability_curve_has_coefficients_over_the_angle_of_the_wind() {
        let variations: Vec<Variation> = vec!["flow.wind_m_s=[0,0,10],[-5,0,8.660254]".parse().unwrap()];
        let points = points(&variations, false).unwrap();
        let text = include_str!("../../../../cases/validation/rigid-cup/scene.toml");
        let scene = case::parse(std::path::Path::new("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"));
        let quantities = quantities(&[scene.clone(), scene]);
        let names: Vec<&str> = quantities.iter().filter(|q| q.of_forces).map(|q| q.column.as_str()).collect();
        assert_eq!(names, ["cup_cd", "cup_cl", "cup_cm_pitch", "cup_cs", "cup_cm_roll", "cup_cm_yaw"]);
        let rows: Vec<Row> = [0.1, 0.4]
            .map(|c| {
                let mut row = row(None);
                row.values = quantities
                    .iter()
                    .map(|q| (q.column == "cup_cl").then_some(Value { mean: c, interval: Some(0.01) }))
                    .collect();
                row
            })
            .to_vec();
        let (quantities, points) = (&quantities[..], &points[..]);
        let results =
            Results { title: "cup", command: "", variations: &variations, quantities, points, rows: &rows };
        assert!(results.table().contains("lift coefficient of cup"), "{}", results.table());
        assert!(results.page().contains("angle between flow.wind_m_s and its first value (deg)"));
        let angle = results.abscissa(0, &points[1]).expect("an angle");
        assert!((angle - 30.0).abs() < 1e-5, "{angle}");
        assert_eq!(vector("[1,2]"), None);
    }
}
