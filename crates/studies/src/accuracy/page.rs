//! The report of a study: one self-contained HTML page.

use figures::chart::short;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::advice::Advice;
use super::answer::Estimate;
use super::coverage::NotAssessed;
use super::figures::Drawn;
use super::judge::{Judged, Outcome, within};
use super::runs::Record;
use super::study::Study;
use super::verify::Verified;
use super::words::{cheaper, finest};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#20262e}\
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse;font-size:13px;margin:.6em 0}\
th,td{padding:3px 9px;border-bottom:1px solid #dde;text-align:right}th:first-child,td:first-child{text-align:left}\
td.w{text-align:left}caption{text-align:left;color:#556}tr.front td{background:#fdf1ef}tr.failed td{color:#a33}p.s{color:#556}svg{max-width:100%;height:auto}\
.scroll{overflow-x:auto}code{background:#f2f4f6;padding:1px 4px}";

/// A ratio as percentage.
pub fn percent(share: f64) -> String {
    if share.is_finite() { format!("{} %", short(100.0 * share)) } else { "-".into() }
}

/// Content of the report besides the study and its outcome.
pub struct About<'a> {
    /// Sources of error without an estimate.
    pub not_assessed: &'a [NotAssessed],
    /// Recommendations.
    pub advice: &'a [Advice],
    /// Comparison with the reference.
    pub verified: Option<&'a Result<Vec<Verified>, String>>,
    /// Command that reproduces the report.
    pub command: &'a str,
    /// Commit and build of the programs.
    pub build: &'a str,
}

/// The report.
pub fn page(
    study: &Study,
    outcome: &Outcome,
    records: &[Record],
    drawn: &[Drawn],
    about: &About<'_>,
) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { (study.name) ": accuracy and cost" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Accuracy and cost: " (study.title) }
                p.s { (about.build) }
                (answers(study, outcome))
                @for advice in about.advice { (self::advice(advice)) }
                (unassessed(about.not_assessed))
                @if let Some(verified) = about.verified { (verification(verified)) }
                @for d in drawn {
                    h2 { (heading(d.name)) }
                    p.s { (d.words) }
                    (PreEscaped(d.svg.element(&[], "")))
                }
                (fronts(study, outcome))
                (parameters(study, outcome))
                (samples(study, outcome, records))
                (method(study, records, about))
            }
        }
    };
    page.into_string() + "\n"
}

fn heading(name: &str) -> &'static str {
    match name {
        "cost" => "Error against cost",
        "fronts" => "Error against cost, each quantity",
        "values" => "Values against cost",
        "parameters" => "Error against cost, each parameter",
        "orders" => "Convergence, each parameter",
        _ => "Wall time by stage and program",
    }
}

/// An error with its uncertainty, %, as text of a cell.
fn error(e: Option<Estimate>) -> String {
    e.map_or_else(|| "not assessed".into(), |e| format!("{} ± {}", percent(e.error), percent(e.band)))
}

/// A table with a caption and column names.
fn table(caption: &str, head: &[&str], rows: &Markup) -> Markup {
    html! {
        div.scroll { table { caption { (caption) } tr { @for name in head { th { (name) } } } (rows) } }
    }
}

fn advice(advice: &Advice) -> Markup {
    html! {
        p {
            "Recommendation, "
            @for (i, line) in advice.lines().iter().enumerate() {
                @if i > 0 { br; }
                (line.trim())
            }
        }
    }
}

fn answers(study: &Study, outcome: &Outcome) -> Markup {
    let base = &outcome.samples[0];
    let rows = html! {
        @for (q, quantity) in study.quantities.iter().enumerate() {
            @let (value, band) = match outcome.answers[q] {
                Some(a) if a.exact => (digits(a.value), "exact".into()),
                Some(a) => {
                    (digits(a.value), format!("± {} ({})", short(a.uncertainty), percent(a.uncertainty / a.scale)))
                }
                None => ("-".into(), "not assessed".into()),
            };
            tr {
                td { (quantity.name) }
                td { (value) }
                td { (band) }
                td { (base.values[q].map_or_else(|| "-".into(), digits)) }
                td { (error(base.estimates[q])) }
            }
        }
    };
    let (held, all) = outcome.held();
    html! {
        (table(
            "Extrapolated values and values of the base, in the unit of the quantity; uncertainty relative to the \
             extrapolated value, error relative to the same, %.",
            &["quantity", "extrapolated value", "uncertainty", "value of the base", "error of the base"],
            &rows
        ))
        @if let Some(l) = base.largest {
            p {
                "Largest error of the base: " (error(Some(l.estimate)))
                " (" (study.quantities[l.quantity].name) ")."
            }
        }
        @for (_, sentence) in cheaper(study, outcome) { p { (sentence) "." } }
        @if all > 0 {
            p {
                "Check samples, which are finer than all samples of the estimates: " (held) " of " (all)
                " values lie within their stated uncertainty."
            }
        }
    }
}

fn unassessed(all: &[NotAssessed]) -> Markup {
    html! {
        @if !all.is_empty() {
            h2 { "Not assessed" }
            p.s { "Sources of error that the errors above do not include." }
            table {
                caption { "Sources of error without an estimate, with the reason." }
                @for n in all {
                    tr {
                        td { (n.name) }
                        td.w { "not assessed: " (n.why.lines().next().unwrap_or_default()) }
                    }
                }
            }
        }
    }
}

fn verification(verified: &Result<Vec<Verified>, String>) -> Markup {
    let all = match verified {
        Err(why) => return html! { h2 { "Verification" } p { (why) } },
        Ok(all) => all,
    };
    let rows = html! {
        @for v in all {
            tr {
                td { (v.quantity) }
                td { (digits(v.value)) }
                td { (digits(v.reference)) }
                td { (percent(v.true_error)) }
                td { (percent(v.error)) " ± " (percent(v.band)) }
                td.w { @if v.held { "within bound" } @else { "above bound" } }
            }
        }
    };
    html! {
        h2 { "Verification" }
        p.s {
            "The recommended sample (else the base) compared with a reference that is finer than all samples in all \
             parameters of the study."
        }
        (table(
            "True and estimated errors relative to the extrapolated value, %; values in the unit of the quantity.",
            &["quantity", "value", "reference", "true error", "estimated error", "result"],
            &rows
        ))
    }
}

/// The Pareto fronts: of the largest error, and of each quantity.
fn fronts(study: &Study, outcome: &Outcome) -> Markup {
    let row = |name: &str, m: usize, e: Option<Estimate>| {
        html! {
            tr {
                td { (name) }
                td.w { (study.samples[m].label) }
                td { (short(outcome.samples[m].cost.0)) }
                td { (error(e)) }
            }
        }
    };
    let rows = html! {
        @for &m in &outcome.front {
            @let largest = outcome.samples[m].largest;
            @let name = largest.map_or("", |l| &study.quantities[l.quantity].name);
            (row(&format!("largest: {name}"), m, largest.map(|l| l.estimate)))
        }
        @for (q, front) in outcome.fronts.iter().enumerate() {
            @for &m in front { (row(&study.quantities[q].name, m, outcome.samples[m].estimates[q])) }
        }
    };
    html! {
        h2 { "Pareto fronts" }
        p.s {
            "A sample is on a front if its error is smaller than that of every cheaper sample on it by more than the \
             uncertainty."
        }
        (table(
            "Samples on the Pareto fronts of the largest error and of each quantity; error relative to the \
             extrapolated value, %.",
            &["quantity", "sample", "cost, s", "error"],
            &rows
        ))
    }
}

fn digits(x: f64) -> String {
    if x.abs() >= 1e-3 && x.abs() < 1e6 {
        let digits = (4.0 - x.abs().log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{x:.digits$}")
    } else {
        format!("{x:.4e}")
    }
}

fn parameters(study: &Study, outcome: &Outcome) -> Markup {
    let row = |line: &super::study::Line, quantity: &case::Quantity, j: &Judged| {
        let (seen, formal, words) = match (&j.convergence, &j.unassessed) {
            (_, Some(why)) => ("-".into(), "-".into(), format!("not assessed: {why}")),
            (Some(c), _) => (
                c.observed.map_or_else(|| "-".into(), short),
                line.promised.to_string(),
                c.behaviour.words().into(),
            ),
            _ => ("-".into(), "-".into(), "choices: largest change from the base".into()),
        };
        let check = j.check.map_or_else(String::new, |(far, band)| {
            format!("error {}, {}", percent(far), if within(far, band) { "within" } else { "outside" })
        });
        html! {
            tr {
                td { (line.name) }
                td.w { (quantity.name) }
                td { (seen) }
                td { (formal) }
                td { (coarsest(j)) }
                td { (finest(j)) }
                td { (check) }
                td.w { (words) }
            }
        }
    };
    let rows = html! {
        @for (line, judged) in study.lines.iter().zip(&outcome.lines) {
            @for (quantity, j) in study.quantities.iter().zip(judged) { (row(line, quantity, j)) }
        }
    };
    let head = [
        "parameter",
        "quantity",
        "observed order",
        "formal order",
        "error of the coarsest sample",
        "error of the finest sample",
        "check sample",
        "behaviour",
    ];
    html! {
        h2 { "Parameters" }
        (table(
            "Convergence with each parameter: orders of accuracy, and errors relative to the extrapolated value, %. The \
             check sample is within or outside the stated uncertainty.",
            &head,
            &rows
        ))
    }
}

/// Error of the coarsest sample of a line; for choices the largest change from the base.
fn coarsest(judged: &Judged) -> String {
    let errors = || judged.errors.iter().flatten().map(|e| e.0);
    match (&judged.convergence, &judged.unassessed) {
        (_, Some(_)) => "not assessed".into(),
        (Some(_), _) => errors().next().map_or_else(|| "-".into(), percent),
        _ => percent(errors().fold(0.0, f64::max)),
    }
}

fn samples(study: &Study, outcome: &Outcome, records: &[Record]) -> Markup {
    let mut order: Vec<usize> = (0..study.samples.len()).collect();
    order.sort_by(|&a, &b| outcome.samples[a].cost.0.total_cmp(&outcome.samples[b].cost.0));
    let mut head = vec!["sample"];
    for q in &study.quantities {
        head.extend([q.name.as_str(), "error"]);
    }
    head.extend(["wall, s", "cpu, s", "memory, MB", "work, s", "cell updates", "element ev.", "matrix rows"]);
    head.extend(["iterations", "note"]);
    let rows = html! { @for m in order { (sample(study, outcome, &records[m], m)) } };
    html! {
        h2 { "Samples" }
        p.s { "Shaded: on the Pareto front of the largest error. Red: failed, with the reason." }
        (table(
            "Values in the unit of the quantity, errors relative to the extrapolated value, %, and cost of each sample.",
            &head,
            &rows
        ))
    }
}

fn sample(study: &Study, outcome: &Outcome, record: &Record, m: usize) -> Markup {
    let s = &outcome.samples[m];
    let class = match &s.gap {
        Some(_) => Some("failed"),
        None => outcome.front.contains(&m).then_some("front"),
    };
    let checks = if study.samples[m].check { "check sample" } else { "" };
    let note = s.gap.as_deref().or(record.note.as_deref()).unwrap_or(checks);
    let assessed = study.reference != Some(m);
    html! {
        tr class=[class] {
            td { (study.samples[m].label) }
            @for (v, e) in s.values.iter().zip(&s.estimates) {
                td { (v.map_or_else(|| "-".into(), digits)) }
                td { @if v.is_some() && assessed { (error(*e)) } @else { "-" } }
            }
            (costs(record))
            td.w { (note.lines().next().unwrap_or_default()) }
        }
    }
}

/// Table cells of times, memory and counts.
fn costs(record: &Record) -> Markup {
    let runs = &record.runs;
    let timing = |of: fn(&super::cost::Cost) -> f64| {
        let (middle, half) = super::cost::spread(runs.iter().map(of));
        match runs.len() {
            0 => "-".into(),
            1 => short(middle),
            _ => format!("{} ± {}", short(middle), short(half)),
        }
    };
    let counts = runs.first().map(super::cost::Cost::counts).unwrap_or_default();
    let memory = runs.iter().map(|c| c.peak_bytes).fold(0.0, f64::max) / 1e6;
    html! {
        td { (timing(|c| c.wall_s)) }
        td { (timing(|c| c.cpu_s)) }
        td { (format!("{memory:.0}")) }
        td { (short(counts.work())) }
        td { (short(counts.cell_updates)) }
        td { (short(counts.element_evaluations)) }
        td { (short(counts.matrix_rows)) }
        td { (counts.iterations) }
    }
}

fn method(study: &Study, records: &[Record], about: &About<'_>) -> Markup {
    let repeats = records.iter().map(|r| r.runs.len()).max().unwrap_or(0);
    html! {
        h2 { "Method" }
        p { code { (about.command) } }
        p.s {
            (study.samples.len()) " samples, each run up to " (repeats) " times. The error of a sample is the sum of the \
             error magnitudes of its parameters, or its distance from the extrapolated value if that is larger, relative \
             to the extrapolated value. Orders and uncertainties follow Eça and Hoekstra (2014), an extension of the grid \
             convergence index of Roache. Work is a weighted sum of counts (cell updates, element evaluations, rows of \
             matrix products) with fixed weights in seconds of one core; it does not depend on the load of the machine. \
             Ripstop "
            (env!("CARGO_PKG_VERSION")) ", " (about.build) "."
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn report_is_complete_and_self_contained() {
        let (study, mut values, mut records) = made();
        values[1][0] = Err("x".into());
        records[1].failure = Some("the coupling <failed>".into());
        let outcome = judge(&study, &values, &records, Measure::Work);
        let folder = tempfile::tempdir().unwrap();
        let drawn = super::super::figures::draw(folder.path(), &study, &outcome, &records).unwrap();
        let not_assessed = super::super::coverage::not_assessed(&study, &outcome);
        let about = About {
            not_assessed: &not_assessed,
            advice: &[],
            verified: None,
            command: "ripstop accuracy scene.toml",
            build: "commit 0123abc",
        };
        let html = page(&study, &outcome, &records, &drawn, &about);
        assert!(html.matches("<svg").count() == 6 && html.ends_with("</html>\n"));
        assert!(html.contains("the coupling &lt;failed&gt;") && html.contains("commit 0123abc"));
        assert!(html.contains("<td>substeps</td><td class=\"w\">not assessed: not varied"), "{html}");
        // The only addresses are XML namespaces.
        for (at, _) in html.match_indices("http") {
            assert!(html[at..].starts_with("http://www.w3.org/2000/svg"), "{}", &html[at..at + 60]);
        }
        assert!(!html.contains("<script") && !html.contains("<link") && !html.contains("NaN"));
        assert_eq!(html.matches("<table").count(), html.matches("</table>").count());
        assert_eq!(html.matches("<table").count(), html.matches("</caption>").count());
    }
}
