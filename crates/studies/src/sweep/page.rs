//! The page of a sweep, and its table for the terminal.

use figures::chart::{Axis, Figure, Mark, Panel, Panels, Series, short};
use figures::colour;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use results::settled::QUANTITIES;

use super::collect::{Row, Value, is_known};
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
    /// Positions in [`QUANTITIES`] of what any run has.
    fn known(&self) -> impl Iterator<Item = usize> + '_ {
        (0..QUANTITIES.len()).filter(|q| is_known(self.rows, *q))
    }

    /// The table for the terminal: the first quantities.
    pub fn table(&self) -> String {
        let quantities: Vec<usize> = self.known().take(4).collect();
        let mut lines = vec![vec![String::from("run")]];
        lines[0].extend(quantities.iter().map(|q| format!("{}, {}", QUANTITIES[*q].1, QUANTITIES[*q].2)));
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
                        "Means of the last coupled stage with 95 % intervals. In brackets: the mean of the last half of the windows of a run \
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
                        @for q in &known { th { (QUANTITIES[*q].1) ", " (QUANTITIES[*q].2) } }
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

    /// A chart for each quantity over the first key with numbers, a series for each combination of the others.
    pub fn figures(&self) -> Vec<Figure> {
        let number = |k: usize, p: &Point| p.values[k].parse::<f64>().ok();
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
                    x: Axis::around(&self.variations[axis].key, false, x),
                    y: Axis::around(
                        &format!("{} ({})", QUANTITIES[q].1, QUANTITIES[q].2),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::plan::points;

    fn row(speed: Option<(f64, Option<f64>)>) -> Row {
        let mut values = vec![None; QUANTITIES.len()];
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
            points: &points,
            rows: &rows,
        };
        let page = results.page();
        assert_eq!(page.matches("<tr class").count(), 6);
        assert_eq!(results.figures().len(), 1);
        assert!(page.contains("kind = b") && page.contains("descent speed (m/s)"), "{page}");
        let table = results.table();
        assert_eq!(table.lines().count(), 7);
        assert!(table.contains("4.00 ± 0.10") && table.lines().last().unwrap().contains(" -  "), "{table}");
    }
}
