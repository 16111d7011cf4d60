//! The tables of a study as CSV.

use std::path::Path;

use coupling::error::RunError;

use super::cost::COUNTS;
use super::judge::{Outcome, within};
use super::runs::Record;
use super::study::Study;

fn number(x: Option<f64>) -> String {
    x.filter(|x| x.is_finite()).map_or_else(String::new, |x| format!("{x:.6e}"))
}

/// A cell without commas or line ends.
fn cell(text: &str) -> String {
    text.lines().next().unwrap_or_default().replace(',', ";")
}

/// Writes `samples.csv` and `parameters.csv` into `out`.
///
/// # Errors
/// A file cannot be written.
pub fn write(out: &Path, study: &Study, outcome: &Outcome, records: &[Record]) -> Result<(), RunError> {
    for (name, text) in
        [("samples.csv", samples(study, outcome, records)), ("parameters.csv", parameters(study, outcome))]
    {
        let path = out.join(name);
        std::fs::write(&path, text).map_err(RunError::file("write", &path))?;
    }
    Ok(())
}

/// A row for each sample.
fn samples(study: &Study, outcome: &Outcome, records: &[Record]) -> String {
    let mut names = vec!["sample".to_owned()];
    names.extend(study.parameters.iter().map(|d| cell(&d.parameter.name)));
    for q in &study.quantities {
        names.push(cell(&q.name));
        names.push(format!("error of {}", cell(&q.name)));
        names.push(format!("uncertainty of {}", cell(&q.name)));
    }
    names.extend(
        ["largest error", "uncertainty of largest error", "quantity of largest error", "front", "check"]
            .map(str::to_owned),
    );
    names.extend(
        [
            "runs",
            "wall_s",
            "wall_spread_s",
            "cpu_s",
            "cpu_spread_s",
            "peak_mb",
            "cost_over_base",
            "cost_over_base_spread",
            "work_s",
        ]
        .map(str::to_owned),
    );
    names.extend(COUNTS.map(str::to_owned));
    names.push("note".into());
    let mut text = names.join(",") + "\n";
    for (m, (sample, s)) in study.samples.iter().zip(&outcome.samples).enumerate() {
        let mut row = vec![cell(&sample.label)];
        row.extend(sample.settings.iter().map(|v| cell(&v.to_string())));
        for (v, e) in s.values.iter().zip(&s.estimates) {
            row.extend([number(*v), number(e.map(|e| e.error)), number(e.map(|e| e.band))]);
        }
        let largest = s.largest.map(|l| l.estimate);
        row.extend([number(largest.map(|e| e.error)), number(largest.map(|e| e.band))]);
        row.push(s.largest.map_or_else(String::new, |l| cell(&study.quantities[l.quantity].name)));
        row.push(u8::from(outcome.front.contains(&m)).to_string());
        row.push(u8::from(sample.check).to_string());
        let runs = &records[m].runs;
        let wall = super::cost::spread(runs.iter().map(|c| c.wall_s));
        let cpu = super::cost::spread(runs.iter().map(|c| c.cpu_s));
        let memory = runs.iter().map(|c| c.peak_bytes).fold(0.0, f64::max) / 1e6;
        row.push(runs.len().to_string());
        for x in [wall.0, wall.1, cpu.0, cpu.1] {
            row.push(if x.is_finite() { format!("{x:.3}") } else { String::new() });
        }
        let counts = runs.first().map(super::cost::Cost::counts).unwrap_or_default();
        row.push(format!("{memory:.1}"));
        for x in [s.ratio.0, s.ratio.1] {
            row.push(if x.is_finite() { format!("{x:.4}") } else { String::new() });
        }
        row.push(format!("{:.4}", counts.work()));
        row.extend(counts.array().iter().map(|c| format!("{c:.0}")));
        row.push(cell(s.gap.as_deref().or(records[m].note.as_deref()).unwrap_or_default()));
        text += &(row.join(",") + "\n");
    }
    text
}

/// A row for each parameter and quantity.
fn parameters(study: &Study, outcome: &Outcome) -> String {
    let mut text = String::from(
        "parameter,quantity,behaviour,order used,order observed,formal order,limit,uncertainty of limit,error of finest \
         sample,uncertainty of finest sample,safety factor,error of check sample,stated uncertainty,within \
         uncertainty\n",
    );
    for (line, judged) in study.lines.iter().zip(&outcome.lines) {
        for (q, j) in study.quantities.iter().zip(judged) {
            if let Some(why) = &j.unassessed {
                let lead = [cell(&line.name), cell(&q.name), cell(&format!("not assessed: {why}"))];
                text += &(lead.join(",") + &",".repeat(11) + "\n");
                continue;
            }
            let Some(c) = &j.convergence else { continue };
            let finest = j.errors.iter().flatten().last();
            let held = j.check.map_or("", |(far, band)| if within(far, band) { "1" } else { "0" });
            let row = [
                cell(&line.name),
                cell(&q.name),
                cell(c.behaviour.words()),
                number(c.order),
                number(c.observed),
                line.promised.to_string(),
                number(Some(c.limit)),
                number(Some(c.limit_uncertainty)),
                number(finest.map(|e| e.0)),
                number(finest.map(|e| e.1)),
                c.factor.to_string(),
                number(j.check.map(|h| h.0)),
                number(j.check.map(|h| h.1)),
                held.into(),
            ];
            text += &(row.join(",") + "\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn tables_are_rectangular_and_complete() {
        let (study, values, mut records) = made();
        records[2].note = Some("a, b\nc".into());
        let mut outcome = judge(&study, &values, &records, Measure::Work);
        outcome.lines[1][0].unassessed = Some("1 of 3 samples".into());
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &study, &outcome, &records).unwrap();
        for (name, rows) in [("samples.csv", study.samples.len()), ("parameters.csv", 3)] {
            let text = std::fs::read_to_string(folder.path().join(name)).unwrap();
            let widths: Vec<usize> = text.lines().map(|l| l.split(',').count()).collect();
            assert_eq!(widths.len(), rows + 1, "{text}");
            assert!(widths.iter().all(|w| *w == widths[0]), "{text}");
        }
    }
}
