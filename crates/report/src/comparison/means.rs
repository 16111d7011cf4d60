//! Means of the compared stages and their differences.

use results::long_term::METHOD;
use results::settled::{QUANTITIES, SettledMean, decimals};

use super::Compared;
use crate::chart::digits;
use crate::document::{Block, Table};

const TEXT: &str = "With an interval the mean is the settled one, and the interval is that of 95 % confidence. In brackets: the mean of the last half of \
    the windows, of unknown confidence, where a settled mean has no interval. The interval of a difference is the root of the sum of both squares, as for \
    independent runs; runs of the same program on the same scene are not.";

/// Windows of a settled mean.
const MIN_WINDOWS: usize = 40;

/// The mean of a quantity in a run.
struct Mean {
    mean: f64,
    /// Half width of its 95 % interval; `None` without one.
    half_width: Option<f64>,
    /// Over what, or why there is no interval.
    note: String,
}

impl Mean {
    fn of(compared: &Compared, column: &str) -> Option<Self> {
        let columns = &compared.stage().columns;
        let settled = columns.settled(column);
        if let Some((s, half_width)) = settled.as_ref().and_then(|s| Some((s, s.interval_95?))) {
            let note = format!("{} to {} s, {} batches", digits(s.from_s), digits(s.to_s), s.batches);
            return Some(Self { mean: s.mean, half_width: Some(half_width), note });
        }
        let (mean, deviation) = columns.late(column)?;
        let why = match settled.and_then(|s: SettledMean| s.no_interval) {
            Some(why) => why,
            None if columns.rows() < MIN_WINDOWS => format!("fewer than {MIN_WINDOWS} windows"),
            None => "constant".into(),
        };
        Some(Self {
            mean,
            half_width: None,
            note: format!("standard deviation {}; {why}", digits(deviation)),
        })
    }

    fn text(&self) -> String {
        match self.half_width {
            Some(half_width) => {
                let places = decimals(half_width);
                format!("{:.places$} ± {half_width:.places$} ({})", self.mean, self.note)
            }
            None => format!("({}; {})", digits(self.mean), self.note),
        }
    }

    /// Difference to `first`, and whether the intervals overlap.
    fn difference(&self, first: &Self) -> String {
        let change = self.mean - first.mean;
        let share = 100.0 * change / first.mean.abs();
        let share = if share.is_finite() { format!(" ({share:+.2} %)") } else { String::new() };
        let Some((a, b)) = first.half_width.zip(self.half_width) else {
            return format!("({}{share}; no interval)", signed(change));
        };
        let half_width = a.hypot(b);
        let places = decimals(half_width);
        let overlap =
            if change.abs() <= a + b { "the intervals overlap" } else { "the intervals do not overlap" };
        format!("{change:+.places$} ± {half_width:.places$}{share}; {overlap}")
    }
}

fn signed(value: f64) -> String {
    let text = digits(value);
    if value > 0.0 { format!("+{text}") } else { text }
}

/// The table of means of all quantities that any of the runs has.
pub(super) fn blocks(runs: &[Compared]) -> Vec<Block> {
    let row = |(column, label, unit): (&str, &str, &str)| {
        let means: Vec<Option<Mean>> = runs.iter().map(|r| Mean::of(r, column)).collect();
        let any = means.iter().flatten().any(|m| m.mean != 0.0);
        let of = |m: &Option<Mean>| m.as_ref().map_or("-".to_owned(), Mean::text);
        let mut row = vec![format!("{label}, {unit}")];
        row.extend(means.iter().map(of));
        let (first, others) = means.split_first()?;
        let difference = |m: &Option<Mean>| {
            m.as_ref().zip(first.as_ref()).map_or("-".to_owned(), |(m, first)| m.difference(first))
        };
        row.extend(others.iter().map(difference));
        any.then_some(row)
    };
    let rows: Vec<Vec<String>> = QUANTITIES.into_iter().filter_map(row).collect();
    if rows.is_empty() {
        return Vec::new();
    }
    let mut head = super::head(runs, "");
    head.extend(runs[1..].iter().map(|r| format!("{} - {}", r.label, runs[0].label)));
    let caption = "Means of the compared stages and their differences; units in the first column.".into();
    vec![
        Block::Text(format!("{TEXT} Method of the settled means: {METHOD}.")),
        Block::Table(Table { caption, head, rows }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(mean: f64, half_width: Option<f64>) -> Mean {
        Mean { mean, half_width, note: "10 to 60 s, 8 batches".into() }
    }

    /// By hand: 3 and 4 give 5; 1.0 apart with half widths of 0.3 and 0.4 do not overlap, with 0.6 and 0.4 they touch.
    #[test]
    fn difference_states_its_interval_and_whether_they_overlap() {
        let apart = mean(11.0, Some(0.4)).difference(&mean(10.0, Some(0.3)));
        assert_eq!(apart, "+1.00 ± 0.50 (+10.00 %); the intervals do not overlap");
        let near = mean(9.25, Some(0.4)).difference(&mean(10.0, Some(0.6)));
        assert_eq!(near, "-0.75 ± 0.72 (-7.50 %); the intervals overlap");
        let unknown = mean(11.0, None).difference(&mean(10.0, Some(0.3)));
        assert_eq!(unknown, "(+1.000 (+10.00 %); no interval)");
        assert_eq!(mean(4.518_73, Some(0.071_49)).text(), "4.519 ± 0.071 (10 to 60 s, 8 batches)");
        assert!(mean(2.0, None).text().starts_with("(2.000; "));
    }
}
