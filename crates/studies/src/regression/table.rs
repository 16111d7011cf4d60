//! The table of a suite: text for the terminal, Markdown for a pull request, JSON for programs.

use std::fmt::Write as _;
use std::path::Path;

use coupling::error::RunError;
use serde::Serialize;
use terminal::counted;

use super::compare::StageResult;
use super::{Origin, Outcome, Suite, Verdict};

const HEADINGS: [&str; 7] = [
    "case",
    "verdict",
    "largest difference",
    "speed of the frame, m/s",
    "force of the air, N",
    "coupling iterations",
    "processor s",
];

/// The outcomes of a suite.
pub(super) struct Table<'a> {
    pub(super) outcomes: &'a [Outcome<'a>],
    /// Cases that were not run because they have a reference.
    pub(super) kept: usize,
}

/// A row of `regression.json`.
#[derive(Serialize)]
struct Row<'a> {
    case: &'a str,
    verdict: String,
    /// First deviation, or the error of the run.
    detail: Option<&'a str>,
    tolerance: f64,
    iteration_tolerance: Option<f64>,
    largest_difference: Option<f64>,
    largest_difference_of: Option<&'a str>,
    processor_s: f64,
    command: &'a str,
}

impl Table<'_> {
    /// Writes `regression.md` and `regression.json`, and returns the result of the suite.
    pub(super) fn write(&self, out: &Path) -> Result<Suite, RunError> {
        let rows: Vec<Row> = self.outcomes.iter().map(Outcome::row).collect();
        let (page, json) = (out.join("regression.md"), out.join("regression.json"));
        std::fs::write(&page, self.markdown()).map_err(RunError::file("write", &page))?;
        let text = serde_json::to_string_pretty(&rows).unwrap_or_default() + "\n";
        std::fs::write(&json, text).map_err(RunError::file("write", &json))?;
        let text = format!("{}results: {}, {}", self.text(), page.display(), json.display());
        let same =
            self.outcomes.iter().all(|o| !matches!(o.verdict, Verdict::Deviates(_) | Verdict::NoReference));
        let failed: Vec<&str> = self.failed().collect();
        let failed = (!failed.is_empty()).then(|| {
            RunError::Study(format!("{} failed: {}", counted(failed.len() as u64, "run"), failed.join(", ")))
        });
        Ok(Suite { text, same, failed })
    }

    fn failed(&self) -> impl Iterator<Item = &str> {
        let failed = self.outcomes.iter().filter(|o| matches!(o.verdict, Verdict::Failed(_)));
        failed.map(|o| o.case.name.as_str())
    }

    /// The table for the terminal, with what deviates below it.
    fn text(&self) -> String {
        let rows: Vec<[String; 7]> = std::iter::once(HEADINGS.map(str::to_owned))
            .chain(self.outcomes.iter().map(Outcome::cells))
            .collect();
        let width = |column: usize| rows.iter().map(|r| r[column].chars().count()).max().unwrap_or(0);
        let mut text = String::new();
        for row in &rows {
            let cells = row.iter().enumerate().map(|(i, cell)| format!("{cell:<w$}", w = width(i)));
            let _ = writeln!(text, "{}", cells.collect::<Vec<_>>().join("  ").trim_end());
        }
        for outcome in self.outcomes {
            if let Some(detail) = outcome.detail() {
                let _ = writeln!(text, "\n{}: {detail}\n  {}", outcome.case.name, outcome.command);
            }
        }
        let _ = writeln!(text, "\n{}", self.counts());
        text
    }

    fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let mut text = line(&HEADINGS.map(str::to_owned)) + &line(&HEADINGS.map(|_| "---".to_owned()));
        self.outcomes.iter().for_each(|o| text.push_str(&line(&o.cells())));
        for outcome in self.outcomes {
            if let Some(detail) = outcome.detail() {
                let _ = write!(
                    text,
                    "\n**{}:** {detail}\n\n```sh\n{}\n```\n",
                    outcome.case.name, outcome.command
                );
            }
        }
        let _ = writeln!(text, "\n{}", self.counts());
        text
    }

    /// How many cases ended in which way.
    fn counts(&self) -> String {
        let kinds = [
            ("as recorded", "as recorded"),
            ("deviates", "deviating"),
            ("failed", "failed"),
            ("no reference", "without a reference"),
            ("recorded", "recorded"),
            ("updated", "updated"),
        ];
        let count = |verdict: &str| self.outcomes.iter().filter(|o| o.verdict.to_string() == verdict).count();
        let counts = kinds.iter().map(|(verdict, words)| (count(verdict), words)).filter(|(n, _)| *n > 0);
        let mut words: Vec<String> = counts.map(|(n, words)| format!("{n} {words}")).collect();
        words.extend((self.kept > 0).then(|| format!("{} with a reference not run", self.kept)));
        format!("{}: {}", counted((self.outcomes.len() + self.kept) as u64, "case"), words.join(", "))
    }
}

impl Outcome<'_> {
    fn row(&self) -> Row<'_> {
        let (settings, largest) = (&self.case.settings, self.largest());
        Row {
            case: &self.case.name,
            verdict: self.verdict.to_string(),
            detail: self.detail(),
            tolerance: settings.tolerance,
            iteration_tolerance: settings.iteration_tolerance,
            // JSON has no infinity: a value that is not finite.
            largest_difference: largest.map(|l| l.0.min(f64::MAX)),
            largest_difference_of: largest.map(|l| l.1),
            processor_s: self.origins[0].as_ref().map_or(0.0, Origin::processor_s),
            command: &self.command,
        }
    }

    fn detail(&self) -> Option<&str> {
        match &self.verdict {
            Verdict::Deviates(text) | Verdict::Failed(text) | Verdict::Updated(text) => Some(text),
            Verdict::NoReference => Some("it has no reference; --record makes one"),
            Verdict::AsRecorded | Verdict::Recorded => None,
        }
    }

    fn largest(&self) -> Option<(f64, &'static str)> {
        let all = self.stages.iter().filter_map(StageResult::largest);
        all.fold(None, |most: Option<(f64, &str)>, next| match most {
            Some(m) if m.0 >= next.0 => Some(m),
            _ => Some(next),
        })
    }

    fn cells(&self) -> [String; 7] {
        let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        let last = self.stages.iter().rev().find(|s| s.totals.iter().all(Option::is_some));
        let of = |value: &dyn Fn(&results::recording::totals::Totals) -> Option<f64>| {
            let [a, b] = &last?.totals;
            Some([value(a.as_ref()?)?, value(b.as_ref()?)?])
        };
        let sum = |stage: usize| {
            let totals = self.stages.iter().filter_map(|s| s.totals[stage].as_ref());
            totals.flat_map(|t| &t.iterations).sum::<u64>() as f64
        };
        let counts = (!self.stages.is_empty()).then(|| [sum(0), sum(1)]);
        let cost = self.origins[0].as_ref().map(|run| {
            let ratio = self.origins[1].as_ref().and_then(|reference| run.ratio(reference));
            format!("{:.1}{}", run.processor_s(), ratio.map_or_else(String::new, |r| format!(" (x {r:.2})")))
        });
        [
            self.case.name.clone(),
            self.verdict.to_string(),
            self.largest().map_or_else(String::new, |l| {
                let difference = if l.0 == 0.0 { "0".into() } else { format!("{:.0e}", l.0) };
                format!("{difference} (tolerance {:.0e})", self.case.settings.tolerance)
            }),
            pair(of(&|t| Some(length(t.frame_velocity_m_s)))),
            pair(of(&|t| t.force_n.map(length))),
            pair(counts),
            cost.unwrap_or_default(),
        ]
    }
}

/// The value of the reference, and that of the run where it differs.
fn pair(values: Option<[f64; 2]>) -> String {
    let Some([a, b]) = values else { return String::new() };
    let digits = |v: f64| if v.fract() == 0.0 { format!("{v:.0}") } else { format!("{v:.5}") };
    match (a, b) {
        _ if digits(a) == digits(b) => digits(a),
        _ if a == 0.0 => format!("{} -> {}", digits(a), digits(b)),
        _ => format!("{} -> {} ({:+.2} %)", digits(a), digits(b), 100.0 * (b / a - 1.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::cases::cases;

    #[test]
    fn pairs_show_what_changed() {
        assert_eq!(pair(None), "");
        assert_eq!(pair(Some([4.0, 4.0])), "4");
        assert_eq!(pair(Some([4.123456, 4.1234561])), "4.12346");
        assert_eq!(pair(Some([46.0, 50.0])), "46 -> 50 (+8.70 %)");
        assert_eq!(pair(Some([0.0, 1.5])), "0 -> 1.50000");
    }

    #[test]
    fn verdicts_decide_over_the_suite() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("drop")).unwrap();
        std::fs::write(folder.path().join("drop/scene.toml"), "").unwrap();
        let case = &cases(folder.path(), &[]).unwrap()[0];
        let outcome = |verdict: &Verdict| Outcome {
            case,
            verdict: verdict.clone(),
            stages: Vec::new(),
            origins: [None, None],
            command: "ripstop run drop/scene.toml".into(),
        };
        let suite = |verdicts: &[Verdict]| {
            let outcomes: Vec<Outcome> = verdicts.iter().map(outcome).collect();
            Table { outcomes: &outcomes, kept: 1 }.write(folder.path()).unwrap()
        };
        let good = suite(&[Verdict::AsRecorded, Verdict::Recorded, Verdict::Updated("window 3".into())]);
        assert!(good.same && good.failed.is_none());
        assert!(
            good.text.contains("4 cases: 1 as recorded, 1 recorded, 1 updated, 1 with a reference not run")
        );
        let other = suite(&[Verdict::AsRecorded, Verdict::Deviates("window 7, pressure".into())]);
        assert!(!other.same && other.failed.is_none());
        assert!(
            other.text.contains("drop: window 7, pressure\n  ripstop run drop/scene.toml"),
            "{}",
            other.text
        );
        let page = std::fs::read_to_string(folder.path().join("regression.md")).unwrap();
        assert!(
            page.contains("| drop | deviates |") && page.contains("**drop:** window 7, pressure"),
            "{page}"
        );
        let json = std::fs::read_to_string(folder.path().join("regression.json")).unwrap();
        assert!(json.contains("\"detail\": \"window 7, pressure\""), "{json}");
        assert!(!suite(&[Verdict::NoReference]).same);
        let failed = suite(&[Verdict::Failed("diverged".into())]).failed.expect("an error");
        assert_eq!((failed.to_string().as_str(), failed.exit_code()), ("1 run failed: drop", 1));
    }
}
