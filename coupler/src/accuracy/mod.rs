//! `ripstop accuracy`: what accuracy costs in time.
//!
//! A study turns dials of a scene one at a time from a base point, and some together; each member is a
//! `ripstop run` of its own, found again by its scene. Answers are extrapolated, errors set beside
//! cost, and the cheapest settings for an accuracy or a time written down as a scene.

mod advice;
mod chart;
pub mod convergence;
pub mod cost;
mod dials;
mod estimate;
mod figures;
mod fly;
mod judge;
mod page;
mod quantities;
mod reference;
mod study;
mod table;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;

use self::advice::Wish;
use self::fly::{Flight, Record};
use self::judge::{Measure, Outcome, judge};
use self::study::{Choice, Study};
use crate::error::RunError;
use crate::launch::Console;
use crate::progress::clock;

/// What to study, and how.
#[derive(Args)]
pub struct AccuracyArgs {
    /// Scene; its section [accuracy] names quantities and dials [default: what fits the scene]
    scene: PathBuf,
    /// Folder of the members and the results; a study that was interrupted goes on there
    /// [default: runs/accuracy-<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these dials of the study (and `sweep`)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    dials: Vec<String>,
    /// Print the cheapest settings within this error, such as `1%`, and write them as want.toml
    #[arg(long, value_name = "SHARE", value_parser = advice::share)]
    want: Option<f64>,
    /// Print the most accurate settings within this time, such as `10min`, and write them as budget.toml
    #[arg(long, value_name = "TIME", value_parser = advice::time)]
    budget: Option<f64>,
    /// What cost is on pictures and in advice
    #[arg(long, value_enum, default_value_t)]
    cost: Measure,
    /// Fly each member N times, in turn with all others, for the spread of timings
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeat: u32,
    /// Members flown at the same time [default: as many as the cores hold]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    jobs: Option<u32>,
    /// A member that takes longer than this becomes a gap, such as `10min`
    #[arg(long, value_name = "TIME", value_parser = advice::time)]
    limit: Option<f64>,
    /// Leave out the runs that are finer than all others and test the stated uncertainty
    #[arg(long)]
    without_check: bool,
    /// Print members with their estimated cost, and fly none
    #[arg(long)]
    dry_run: bool,
    /// Take results that other builds of the programs left in the folder
    #[arg(long)]
    any_build: bool,
    /// Compare with errors and counts kept in FILE: exit code 3 if errors or counts have grown
    #[arg(long, value_name = "FILE", conflicts_with = "keep_reference")]
    reference: Option<PathBuf>,
    /// Keep errors and counts in FILE
    #[arg(long, value_name = "FILE")]
    keep_reference: Option<PathBuf>,
}

/// Studies a scene; whether it is as good as its reference, and the text for people.
///
/// # Errors
/// Whatever is wrong with the scene, its study or the wishes; an interruption; trouble with files.
pub fn accuracy(
    args: &AccuracyArgs,
    stop: &AtomicBool,
    console: &Console,
) -> Result<(bool, String), RunError> {
    let reference = args.reference.as_deref().map(reference::load).transpose()?;
    let choice = Choice { dials: args.dials.clone(), check: !args.without_check };
    let study = Study::new(&args.scene, &choice)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("accuracy-{}", study.name)));
    let out = std::path::absolute(&out).map_err(RunError::file("resolve", &out))?;
    let scene = &study.members[0].scene;
    let ranks =
        scene.stages.iter().flat_map(|s| s.kind.roles()).map(|r| scene.ranks.of(*r)).max().unwrap_or(1);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or((cores / ranks as usize).max(1), |n| n as usize);
    let flight = Flight {
        out: out.clone(),
        jobs,
        repeat: args.repeat as usize,
        any_build: args.any_build,
        limit_s: args.limit,
    };
    if args.dry_run {
        return Ok((true, plan(&study, &flight)?));
    }
    std::fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let _lock = crate::run::lock(&out)?;
    console.line(&format!(
        "{} members, {} at a time, in {}",
        study.members.len(),
        flight.jobs,
        out.display()
    ));
    let records = fly::fly(&study, &flight, stop, console)?;
    let values: Vec<Vec<judge::Value>> = study
        .members
        .iter()
        .zip(&records)
        .map(|(m, record)| {
            let of = |q: &case::Quantity| match &record.failure {
                Some(why) => Err(why.clone()),
                None => quantities::value(q, &m.scene, study.stage, &fly::run_folder(&out, m)),
            };
            study.quantities.iter().map(of).collect()
        })
        .collect();
    let outcome = judge(&study, &values, &records, args.cost);
    report(args, &study, &outcome, &records, &out, reference.as_ref())
}

fn report(
    args: &AccuracyArgs,
    study: &Study,
    outcome: &Outcome,
    records: &[Record],
    out: &Path,
    reference: Option<&reference::Reference>,
) -> Result<(bool, String), RunError> {
    table::write(out, study, outcome, records)?;
    let drawn = figures::draw(out, study, outcome, records)?;
    let output = case::load(&args.scene).map_err(|e| RunError::Input(e.to_string()))?.output;
    let wishes = [args.want.map(Wish::Want), args.budget.map(Wish::Budget)];
    let mut advised = Vec::new();
    let mut refused = None;
    for wish in wishes.into_iter().flatten() {
        match advice::advise(study, outcome, wish, &output, out) {
            Ok((words, _)) => advised.push(words),
            // The page is written all the same.
            Err(error) => refused = Some(error),
        }
    }
    let shown: Vec<String> =
        advised.iter().map(|a| a.split("; the scene").next().unwrap_or_default().to_owned()).collect();
    let page = page::page(study, outcome, records, &drawn, &shown, &command(args));
    let path = out.join("accuracy.html");
    std::fs::write(&path, page).map_err(RunError::file("write", &path))?;
    let mut text = words(study, outcome);
    advised.into_iter().for_each(|a| text += &format!("{a}\n"));
    text += &format!("page: {}", path.display());
    if let Some(error) = refused {
        return Err(RunError::Input(format!("{error}\n{text}")));
    }
    if let Some(file) = &args.keep_reference {
        reference::save(file, &reference::keep(study, outcome, records)?)?;
    }
    let found = reference.map(|r| reference::compare(study, outcome, records, r)).unwrap_or_default();
    found.iter().for_each(|f| text += &format!("\n{f}"));
    if reference.is_some() && found.is_empty() {
        text += "\nas accurate and as cheap as its reference";
    }
    Ok((found.is_empty(), text))
}

/// The command that makes the page again, without the folders of this machine.
fn command(args: &AccuracyArgs) -> String {
    let mut line = format!("ripstop accuracy {}", args.scene.display());
    if !args.dials.is_empty() {
        line += &format!(" --dials {}", args.dials.join(","));
    }
    if args.cost != Measure::Wall {
        line += &format!(" --cost {:?}", args.cost).to_lowercase();
    }
    if args.repeat > 1 {
        line += &format!(" --repeat {}", args.repeat);
    }
    line
}

/// What came out, for a terminal.
fn words(study: &Study, outcome: &Outcome) -> String {
    let mut text = String::new();
    for (q, a) in study.quantities.iter().zip(&outcome.answers) {
        text += &match a {
            Some(a) if a.exact => format!("{}: {:.6} (exact)\n", q.name, a.value),
            Some(a) => format!(
                "{}: {:.6} +- {:.2e} ({})\n",
                q.name,
                a.value,
                a.uncertainty,
                page::percent(a.uncertainty / a.scale)
            ),
            None => format!("{}: no answer\n", q.name),
        };
    }
    text += "Pareto front:\n";
    for &m in &outcome.front {
        let s = &outcome.members[m];
        let (e, u) = s.worst.unwrap_or((f64::NAN, f64::NAN));
        text += &format!(
            "  {:<28} {:>10}  error {} +- {}\n",
            study.members[m].label,
            clock(s.cost.0),
            page::percent(e),
            page::percent(u)
        );
    }
    if let Some((m, share)) = outcome.beaten_by() {
        text += &format!(
            "the scene as it is lies behind it: `{}` is as accurate at {} of its cost\n",
            study.members[m].label,
            page::percent(share)
        );
    }
    for (m, s) in outcome.members.iter().enumerate() {
        if let Some(why) = &s.gap {
            text +=
                &format!("gap: `{}`: {}\n", study.members[m].label, why.lines().next().unwrap_or_default());
        }
    }
    let (held, all) = outcome.held();
    if all > 0 {
        text += &format!("finer runs: {held} of {all} values within the stated bands\n");
    }
    text
}

/// The members with what they would cost: measured where one was flown, else from those that were.
fn plan(study: &Study, flight: &Flight) -> Result<String, RunError> {
    let build = fly::build()?;
    let flown: Vec<Option<f64>> = study
        .members
        .iter()
        .map(|m| fly::kept(flight, m, &build).and_then(|r| r.runs.first().map(|c| c.wall_s)))
        .collect();
    let known: Vec<(f64, f64)> =
        flown.iter().zip(&study.members).filter_map(|(t, m)| Some(((*t)?, m.ratio))).collect();
    let sum = |of: fn(&(f64, f64)) -> f64| known.iter().map(of).sum::<f64>();
    let (base, source) = if known.is_empty() {
        (
            estimate::seconds(&study.members[0].scene),
            "guessed from the sizes of the scene, within a factor of about 3",
        )
    } else {
        (sum(|k| k.0) / sum(|k| k.1), "from the members that were flown")
    };
    let mut text = format!("{} members of {}; quantities:\n", study.members.len(), study.title);
    for q in &study.quantities {
        text += &format!("  {}\n", q.name);
    }
    text += "members, cost against the base:\n";
    let mut rest = 0.0;
    for (m, t) in study.members.iter().zip(&flown) {
        let estimate = match t {
            Some(t) => format!("{} (flown)", clock(*t)),
            None => format!("about {}", clock(base * m.ratio)),
        };
        rest += if t.is_none() { m.ratio } else { 0.0 };
        let check = if m.check { "  (tests the bands)" } else { "" };
        text += &format!("  {:<28} x {:>7.2}  {estimate}{check}\n", m.label, m.ratio);
    }
    let rest = rest * flight.repeat as f64 / flight.jobs as f64;
    text += &format!("to fly: about {}, {} at a time ({source})", clock(base * rest), flight.jobs);
    Ok(text)
}
