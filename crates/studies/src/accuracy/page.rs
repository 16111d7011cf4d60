//! The report: one page that opens without a network.

use std::fmt::Write as _;

use super::advice::Advice;
use super::answer::Estimate;
use super::chart::short;
use super::coverage::NotAssessed;
use super::figures::Drawn;
use super::fly::Record;
use super::judge::{Judged, Outcome, within};
use super::study::Study;
use super::verify::Verified;
use super::words::{cheaper, finest};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#20262e}\
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse;font-size:13px;margin:.6em 0}\
th,td{padding:3px 9px;border-bottom:1px solid #dde;text-align:right}th:first-child,td:first-child{text-align:left}\
td.w{text-align:left}tr.front td{background:#fdf1ef}tr.gap td{color:#a33}p.s{color:#556}svg{max-width:100%;height:auto}\
.scroll{overflow-x:auto}code{background:#f2f4f6;padding:1px 4px}";

/// Text that stands for itself in HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A share as percent.
pub fn percent(share: f64) -> String {
    if share.is_finite() { format!("{} %", short(100.0 * share)) } else { "-".into() }
}

/// What stands in the report beside the study.
pub struct About<'a> {
    /// What the errors do not contain.
    pub not_assessed: &'a [NotAssessed],
    /// Advice.
    pub advice: &'a [Advice],
    /// Comparison with the reference.
    pub verified: Option<&'a Result<Vec<Verified>, String>>,
    /// Makes the report again.
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
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{name}: accuracy and cost</title>\n\
         <style>{STYLE}</style></head><body>\n<h1>Accuracy and cost: {title}</h1>\n<p class=\"s\">{build}</p>\n",
        name = escape(&study.name),
        title = escape(&study.title),
        build = escape(about.build)
    );
    answers(&mut html, study, outcome);
    for advice in about.advice {
        let lines: Vec<String> = advice.lines().iter().map(|l| escape(l.trim())).collect();
        let _ = writeln!(html, "<p>Advice, {}</p>", lines.join("<br>\n"));
    }
    unassessed(&mut html, about.not_assessed);
    verification(&mut html, about.verified);
    for d in drawn {
        let _ = writeln!(html, "<h2>{}</h2>\n<p class=\"s\">{}</p>", heading(d.name), escape(d.words));
        // Without its declaration an SVG is an element.
        html.push_str(&d.svg);
    }
    fronts(&mut html, study, outcome);
    parameters(&mut html, study, outcome);
    samples(&mut html, study, outcome, records);
    let repeats = records.iter().map(|r| r.runs.len()).max().unwrap_or(0);
    let _ = write!(
        html,
        "<h2>Method</h2>\n<p><code>{}</code></p>\n<p class=\"s\">{} samples, each run up to {repeats} times. \
         Errors are relative to the answers at the top: the sum of the errors of the parameters, each alone, or the distance \
         from the answer where that is more. Orders and uncertainties follow E&ccedil;a and Hoekstra \
         (2014), which extends the grid convergence index of Roache. Work is a sum of counts (cell updates, element \
         evaluations, rows of matrix products), each times a fixed time of one core, and independent of the load of the machine. \
         Ripstop {}, {}.</p>\n</body></html>\n",
        escape(about.command),
        study.members.len(),
        env!("CARGO_PKG_VERSION"),
        escape(about.build)
    );
    html
}

fn heading(name: &str) -> &'static str {
    match name {
        "cost" => "Error against cost",
        "fronts" => "Error against cost, each quantity",
        "values" => "Values against cost",
        "parameters" => "Each parameter: error against cost",
        "orders" => "Each parameter: convergence",
        _ => "Where the time goes",
    }
}

/// An error with its band as a cell.
fn error(e: Option<Estimate>) -> String {
    e.map_or_else(|| "not assessed".into(), |e| format!("{} ± {}", percent(e.error), percent(e.band)))
}

fn answers(html: &mut String, study: &Study, outcome: &Outcome) {
    html.push_str("<table><tr><th>quantity</th><th>answer</th><th>uncertainty</th><th>base sample</th><th>its error</th></tr>\n");
    for (q, quantity) in study.quantities.iter().enumerate() {
        let base = &outcome.members[0];
        let (value, band) = match outcome.answers[q] {
            Some(a) if a.exact => (six(a.value), "exact".into()),
            Some(a) => {
                (six(a.value), format!("± {} ({})", short(a.uncertainty), percent(a.uncertainty / a.scale)))
            }
            None => ("-".into(), "not assessed".into()),
        };
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{value}</td><td>{band}</td><td>{}</td><td>{}</td></tr>",
            escape(&quantity.name),
            base.values[q].map_or_else(|| "-".into(), six),
            error(base.estimates[q])
        );
    }
    html.push_str("</table>\n");
    if let Some(l) = outcome.members[0].largest {
        let _ = writeln!(
            html,
            "<p>The largest error of the base sample is {} ({}).</p>",
            error(Some(l.estimate)),
            escape(&study.quantities[l.quantity].name)
        );
    }
    for (_, sentence) in cheaper(study, outcome) {
        let _ = writeln!(html, "<p>{}.</p>", escape(&sentence));
    }
    let (held, all) = outcome.held();
    if all > 0 {
        let _ = writeln!(
            html,
            "<p>Runs finer than all that the estimates use: {held} of {all} values lie within the band stated for them.</p>"
        );
    }
}

fn unassessed(html: &mut String, all: &[NotAssessed]) {
    if all.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Not assessed</h2>\n<p class=\"s\">The errors above do not contain these.</p>\n<table>\n",
    );
    for n in all {
        let why = n.why.lines().next().unwrap_or_default();
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td class=\"w\">not assessed: {}</td></tr>",
            escape(&n.name),
            escape(why)
        );
    }
    html.push_str("</table>\n");
}

fn verification(html: &mut String, verified: Option<&Result<Vec<Verified>, String>>) {
    let all = match verified {
        None => return,
        Some(Err(why)) => {
            let _ = writeln!(html, "<h2>Verification</h2>\n<p>{}</p>", escape(why));
            return;
        }
        Some(Ok(all)) => all,
    };
    html.push_str(
        "<h2>Verification</h2>\n<p class=\"s\">The advised sample (the base without advice) against a reference that is finer than \
         all samples in all parameters of the study.</p>\n<table><tr><th>quantity</th><th>value</th><th>reference</th>\
         <th>true error</th><th>promised</th><th></th></tr>\n",
    );
    for v in all {
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{} ± {}</td><td class=\"w\">{}</td></tr>",
            escape(&v.quantity),
            six(v.value),
            six(v.reference),
            percent(v.true_error),
            percent(v.error),
            percent(v.band),
            if v.held { "held" } else { "not held" }
        );
    }
    html.push_str("</table>\n");
}

/// The Pareto fronts: of the largest error, and of each quantity.
fn fronts(html: &mut String, study: &Study, outcome: &Outcome) {
    html.push_str(
        "<h2>Pareto fronts</h2>\n<p class=\"s\">A sample joins a front only if its error is below those of all cheaper ones by more \
         than the uncertainty.</p>\n<table><tr><th>quantity</th><th>sample</th><th>cost, s</th><th>error</th></tr>\n",
    );
    let mut row = |name: &str, m: usize, e: Option<Estimate>| {
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td class=\"w\">{}</td><td>{}</td><td>{}</td></tr>",
            escape(name),
            escape(&study.members[m].label),
            short(outcome.members[m].cost.0),
            error(e)
        );
    };
    for &m in &outcome.front {
        let largest = outcome.members[m].largest;
        let name = largest.map_or("", |l| &study.quantities[l.quantity].name);
        row(&format!("largest: {name}"), m, largest.map(|l| l.estimate));
    }
    for (q, front) in outcome.fronts.iter().enumerate() {
        for &m in front {
            row(&study.quantities[q].name, m, outcome.members[m].estimates[q]);
        }
    }
    html.push_str("</table>\n");
}

fn six(x: f64) -> String {
    if x.abs() >= 1e-3 && x.abs() < 1e6 {
        let digits = (4.0 - x.abs().log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{x:.digits$}")
    } else {
        format!("{x:.4e}")
    }
}

fn parameters(html: &mut String, study: &Study, outcome: &Outcome) {
    html.push_str(
        "<h2>The parameters</h2>\n<div class=\"scroll\"><table><tr><th>parameter</th><th>quantity</th><th>observed order</th>\
         <th>formal order</th><th>error of the coarsest</th><th>error of the finest</th><th>finer run</th><th>behaviour</th></tr>\n",
    );
    for (line, judged) in study.lines.iter().zip(&outcome.lines) {
        for (q, j) in study.quantities.iter().zip(judged) {
            let (seen, formal, words) = match (&j.convergence, &j.unassessed) {
                (_, Some(why)) => ("-".into(), "-".into(), format!("not assessed: {why}")),
                (Some(c), _) => (
                    c.observed.map_or_else(|| "-".into(), short),
                    line.promised.to_string(),
                    c.behaviour.words().into(),
                ),
                _ => ("-".into(), "-".into(), "words: the largest change from the base is shown".into()),
            };
            let check = j.check.map_or_else(String::new, |(far, band)| {
                format!("error {}, {}", percent(far), if within(far, band) { "held" } else { "not held" })
            });
            let _ = writeln!(
                html,
                "<tr><td>{}</td><td class=\"w\">{}</td><td>{seen}</td><td>{formal}</td><td>{}</td><td>{}</td><td>{check}</td><td class=\"w\">{}</td></tr>",
                escape(&line.name),
                escape(&q.name),
                coarsest(j),
                finest(j),
                escape(&words)
            );
        }
    }
    html.push_str("</table></div>\n");
}

/// Error of the first sample of a line; for words the largest change.
fn coarsest(judged: &Judged) -> String {
    let errors = || judged.errors.iter().flatten().map(|e| e.0);
    match (&judged.convergence, &judged.unassessed) {
        (_, Some(_)) => "not assessed".into(),
        (Some(_), _) => errors().next().map_or_else(|| "-".into(), percent),
        _ => percent(errors().fold(0.0, f64::max)),
    }
}

fn samples(html: &mut String, study: &Study, outcome: &Outcome, records: &[Record]) {
    html.push_str("<h2>The samples</h2>\n<p class=\"s\">Shaded: on the Pareto front of the largest error. Red: a gap, with its reason.</p>\n<div class=\"scroll\"><table><tr><th>sample</th>");
    for q in &study.quantities {
        let _ = write!(html, "<th>{}</th><th>error</th>", escape(&q.name));
    }
    html.push_str("<th>wall s</th><th>cpu s</th><th>memory MB</th><th>work s</th><th>cell updates</th><th>element ev.</th><th>matrix rows</th><th>iterations</th><th></th></tr>\n");
    let mut order: Vec<usize> = (0..study.members.len()).collect();
    order.sort_by(|&a, &b| outcome.members[a].cost.0.total_cmp(&outcome.members[b].cost.0));
    for m in order {
        let s = &outcome.members[m];
        let class = if s.gap.is_some() {
            " class=\"gap\""
        } else if outcome.front.contains(&m) {
            " class=\"front\""
        } else {
            ""
        };
        let _ = write!(html, "<tr{class}><td>{}</td>", escape(&study.members[m].label));
        for (v, e) in s.values.iter().zip(&s.estimates) {
            let _ = write!(
                html,
                "<td>{}</td><td>{}</td>",
                v.map_or_else(|| "-".into(), six),
                if v.is_some() && study.reference != Some(m) { error(*e) } else { "-".into() }
            );
        }
        costs(html, &records[m]);
        let note = s.gap.as_deref().or(records[m].note.as_deref()).unwrap_or(if study.members[m].check {
            "tests the bands"
        } else {
            ""
        });
        let _ =
            writeln!(html, "<td class=\"w\">{}</td></tr>", escape(note.lines().next().unwrap_or_default()));
    }
    html.push_str("</table></div>\n");
}

/// Cells of times, memory and counts.
fn costs(html: &mut String, record: &Record) {
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
    let _ = write!(
        html,
        "<td>{}</td><td>{}</td><td>{memory:.0}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>",
        timing(|c| c.wall_s),
        timing(|c| c.cpu_s),
        short(counts.work()),
        short(counts.cell_updates),
        short(counts.element_evaluations),
        short(counts.matrix_rows),
        counts.iterations
    );
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn the_report_is_whole_and_needs_no_network() {
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
        assert_eq!(html.matches("<svg").count(), 6);
        assert!(html.contains("the coupling &lt;failed&gt;") && html.contains("commit 0123abc"));
        assert!(html.contains("<td>substeps</td><td class=\"w\">not assessed: not varied"), "{html}");
        // Names of namespaces are the only addresses.
        for (at, _) in html.match_indices("http") {
            assert!(html[at..].starts_with("http://www.w3.org/2000/svg"), "{}", &html[at..at + 60]);
        }
        assert!(!html.contains("<script") && !html.contains("<link") && !html.contains("NaN"));
        assert_eq!(html.matches("<table").count(), html.matches("</table>").count());
    }
}
