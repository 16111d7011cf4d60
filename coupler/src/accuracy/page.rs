//! One page that opens without a network.

use std::fmt::Write as _;

use super::chart::short;
use super::figures::Drawn;
use super::fly::Record;
use super::judge::Outcome;
use super::study::Study;

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

/// The page; `advice` is what was advised, `command` makes the page again.
pub fn page(
    study: &Study,
    outcome: &Outcome,
    records: &[Record],
    drawn: &[Drawn],
    advice: &[String],
    command: &str,
) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{name}: accuracy and cost</title>\n\
         <style>{STYLE}</style></head><body>\n<h1>What accuracy costs: {title}</h1>\n",
        name = escape(&study.name),
        title = escape(&study.title)
    );
    answers(&mut html, study, outcome);
    for line in advice {
        let _ = writeln!(html, "<p>{}</p>", escape(line));
    }
    for d in drawn {
        let _ = writeln!(html, "<h2>{}</h2>\n<p class=\"s\">{}</p>", heading(d.name), escape(d.words));
        // Without its declaration an SVG is an element.
        html.push_str(&d.svg);
    }
    dials(&mut html, study, outcome);
    members(&mut html, study, outcome, records);
    let repeats = records.iter().map(|r| r.runs.len()).max().unwrap_or(0);
    let _ = write!(
        html,
        "<h2>How this was made</h2>\n<p><code>{}</code></p>\n<p class=\"s\">{} members, each flown up to {repeats} times. \
         Errors are against the answers at the top. Orders and uncertainties are after E&ccedil;a and Hoekstra \
         (2014), which extends the grid convergence index of Roache. Work is a sum of counts (cell updates, element \
         evaluations, rows of matrix products), each times a fixed time of one core: a busy machine does not change it. \
         Ripstop {}.</p>\n</body></html>\n",
        escape(command),
        study.members.len(),
        env!("CARGO_PKG_VERSION")
    );
    html
}

fn heading(name: &str) -> &'static str {
    match name {
        "cost" => "Error against cost",
        "values" => "Answers against cost",
        "dials" => "Dial by dial: what accuracy costs",
        "orders" => "Dial by dial: how errors fall",
        _ => "Where the time goes",
    }
}

fn answers(html: &mut String, study: &Study, outcome: &Outcome) {
    html.push_str("<table><tr><th>quantity</th><th>answer</th><th>uncertainty</th><th>the scene as it is</th><th>its error</th></tr>\n");
    for (q, quantity) in study.quantities.iter().enumerate() {
        let base = &outcome.members[0];
        let (value, band) = match outcome.answers[q] {
            Some(a) if a.exact => (six(a.value), "exact".into()),
            Some(a) => {
                (six(a.value), format!("± {} ({})", short(a.uncertainty), percent(a.uncertainty / a.scale)))
            }
            None => ("-".into(), "no member has a value".into()),
        };
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{value}</td><td>{band}</td><td>{}</td><td>{}</td></tr>",
            escape(&quantity.name),
            base.values[q].map_or_else(|| "-".into(), six),
            base.errors[q].map_or_else(|| "-".into(), percent)
        );
    }
    html.push_str("</table>\n");
    let words = match outcome.beaten_by() {
        None if outcome.bound(0).is_some() => {
            "The scene as it is lies on or next to the Pareto front.".to_owned()
        }
        None => "The scene as it is has no place among the members: see its row below.".to_owned(),
        Some((m, share)) => format!(
            "The scene as it is lies behind the Pareto front: `{}` is as accurate (error and uncertainty within a twentieth) at {} of its cost.",
            study.members[m].label,
            percent(share)
        ),
    };
    let _ = writeln!(html, "<p>{}</p>", escape(&words));
    let (held, all) = outcome.held();
    if all > 0 {
        let _ = writeln!(
            html,
            "<p>Runs finer than all that the estimates know: {held} of {all} values lie within the band stated for them.</p>"
        );
    }
}

fn six(x: f64) -> String {
    if x.abs() >= 1e-3 && x.abs() < 1e6 {
        let digits = (4.0 - x.abs().log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{x:.digits$}")
    } else {
        format!("{x:.4e}")
    }
}

fn dials(html: &mut String, study: &Study, outcome: &Outcome) {
    html.push_str(
        "<h2>The dials</h2>\n<div class=\"scroll\"><table><tr><th>dial</th><th>quantity</th><th>order seen</th>\
         <th>promised</th><th>error of the coarsest</th><th>error of the finest</th><th>uncertainty</th><th>finer run</th><th>what it does</th></tr>\n",
    );
    for (line, judged) in study.lines.iter().zip(&outcome.lines) {
        for (q, j) in study.quantities.iter().zip(judged) {
            let first = j.errors.iter().flatten().next();
            let last = j.errors.iter().flatten().last();
            let (seen, promised, words) = match &j.convergence {
                Some(c) => (
                    c.observed.map_or_else(|| "-".into(), short),
                    line.promised.to_string(),
                    c.behaviour.words(),
                ),
                None => ("-".into(), "-".into(), "words: the largest change against the base point is meant"),
            };
            let (first, last) = match &j.convergence {
                Some(_) => (first.map(|e| e.0), last.copied()),
                None => {
                    let most = j.errors.iter().flatten().map(|e| e.0).fold(0.0, f64::max);
                    (Some(most), None)
                }
            };
            let check = j.check.map_or_else(String::new, |(far, band)| {
                format!("{} off, {}", percent(far), if far <= band + 1e-9 { "held" } else { "not held" })
            });
            let _ = writeln!(
                html,
                "<tr><td>{}</td><td class=\"w\">{}</td><td>{seen}</td><td>{promised}</td><td>{}</td><td>{}</td><td>{}</td><td>{check}</td><td class=\"w\">{words}</td></tr>",
                escape(&line.name),
                escape(&q.name),
                first.map_or_else(|| "-".into(), percent),
                last.map_or_else(|| "-".into(), |e| percent(e.0)),
                last.map_or_else(|| "-".into(), |e| percent(e.1)),
            );
        }
    }
    html.push_str("</table></div>\n");
}

fn members(html: &mut String, study: &Study, outcome: &Outcome, records: &[Record]) {
    html.push_str("<h2>The members</h2>\n<p class=\"s\">Shaded: on the Pareto front. Red: a gap, with its reason.</p>\n<div class=\"scroll\"><table><tr><th>member</th>");
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
        for (v, e) in s.values.iter().zip(&s.errors) {
            let _ = write!(
                html,
                "<td>{}</td><td>{}</td>",
                v.map_or_else(|| "-".into(), six),
                e.map_or_else(|| "-".into(), percent)
            );
        }
        let runs = &records[m].runs;
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
        let note = s.gap.as_deref().or(records[m].note.as_deref()).unwrap_or(if study.members[m].check {
            "tests the bands"
        } else {
            ""
        });
        let _ = writeln!(
            html,
            "<td>{}</td><td>{}</td><td>{memory:.0}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"w\">{}</td></tr>",
            timing(|c| c.wall_s),
            timing(|c| c.cpu_s),
            short(counts.work()),
            short(counts.cell_updates),
            short(counts.element_evaluations),
            short(counts.matrix_rows),
            counts.iterations,
            escape(note.lines().next().unwrap_or_default())
        );
    }
    html.push_str("</table></div>\n");
}

#[cfg(test)]
mod tests {
    use super::super::judge::{Measure, judge, tests::made};
    use super::*;

    #[test]
    fn the_page_is_whole_and_needs_no_network() {
        let (study, mut values, mut records) = made();
        values[1][0] = Err("x".into());
        records[1].failure = Some("the coupling <failed>".into());
        let outcome = judge(&study, &values, &records, Measure::Work);
        let folder = tempfile::tempdir().unwrap();
        let drawn = super::super::figures::draw(folder.path(), &study, &outcome, &records).unwrap();
        let html = page(
            &study,
            &outcome,
            &records,
            &drawn,
            &["for 1 %: base".into()],
            "ripstop accuracy scene.toml",
        );
        assert_eq!(html.matches("<svg").count(), 5);
        assert!(html.contains("the coupling &lt;failed&gt;") && html.contains("for 1 %"));
        // Names of namespaces are the only addresses.
        for (at, _) in html.match_indices("http") {
            assert!(html[at..].starts_with("http://www.w3.org/2000/svg"), "{}", &html[at..at + 60]);
        }
        assert!(!html.contains("<script") && !html.contains("<link") && !html.contains("NaN"));
        assert_eq!(html.matches("<table").count(), html.matches("</table>").count());
    }
}
