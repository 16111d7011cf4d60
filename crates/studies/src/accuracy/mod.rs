//! `ripstop accuracy`: discretisation and iteration errors against cost.
//!
//! A study varies the parameters of a scene one at a time from a base, and some together (the sweep). Each sample is a
//! separate `ripstop run`, identified by the hash of its scene. Values are extrapolated, errors are compared with the
//! cost, and the cheapest settings for a target error or a budget are written as a scene.

mod advice;
mod answer;
pub mod convergence;
pub mod cost;
mod coverage;
mod estimate;
mod figures;
mod front;
mod judge;
mod page;
mod parameter;
mod plan;
pub mod quantities;
mod reference;
mod running;
mod runs;
mod study;
mod table;
mod varied;
mod verify;
mod words;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;
use coupling::error::RunError;
use results::provenance;
use terminal::Console;

use self::advice::{Advice, Context, Target};
use self::judge::{Measure, Outcome, judge};
use self::runs::{Execution, Record};
use self::study::{Choice, Study};

/// Arguments of `ripstop accuracy`.
#[derive(Args)]
pub struct AccuracyArgs {
    /// Scene file; its section [accuracy] names quantities and parameters [default: those that fit the scene]
    scene: PathBuf,
    /// Folder of the samples and the results; an interrupted study resumes there
    /// [default: runs/accuracy-NAME with the name of the scene]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Restrict the study to these parameters (and `sweep`)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    parameters: Vec<String>,
    /// Print the cheapest settings whose error bound is at most this, such as `1%`, and write them to
    /// target-error.toml
    #[arg(long, value_name = "SHARE", value_parser = advice::share)]
    target_error: Option<f64>,
    /// Print the most accurate settings whose cost is at most this, such as `10min`, and write them to budget.toml
    #[arg(long, value_name = "TIME", value_parser = advice::time)]
    budget: Option<f64>,
    /// Measure of cost in the report and in the recommendation
    #[arg(long, value_enum, default_value_t)]
    cost: Measure,
    /// Run each sample N times, interleaved with all others, to measure the spread of timings
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeat: u32,
    /// Number of samples that run at the same time [default: cores / largest rank count of a program]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    jobs: Option<u32>,
    /// Stop a sample after this wall time, such as `10min`, and count it as failed
    #[arg(long, value_name = "TIME", value_parser = advice::time)]
    limit: Option<f64>,
    /// Omit the check samples, which are finer than all others and test the stated uncertainty
    #[arg(long)]
    without_check: bool,
    /// Also run a reference that is finer than all samples in all parameters of the study, and compare the true errors
    /// of the recommended settings (else of the base) with their bounds: exit code 3 if a bound is exceeded
    #[arg(long)]
    verify: bool,
    /// Print the samples with their estimated cost, without running them
    #[arg(long)]
    dry_run: bool,
    /// Start without confirmation; a non-interactive standard input never needs confirmation
    #[arg(long, short)]
    yes: bool,
    /// Reuse results of other builds of the programs
    #[arg(long)]
    any_build: bool,
    /// Compare with the errors and counts in FILE: exit code 3 if errors or counts are larger
    #[arg(long, value_name = "FILE", conflicts_with = "keep_reference")]
    reference: Option<PathBuf>,
    /// Write errors and counts to FILE
    #[arg(long, value_name = "FILE")]
    keep_reference: Option<PathBuf>,
}

impl AccuracyArgs {
    /// The targets, with the names of the recommendation files.
    fn targets(&self) -> Vec<(Target, &'static str)> {
        let error = self.target_error.map(|e| (Target::Error(e), "target-error"));
        let budget = self.budget.map(|s| (Target::Budget(s), "budget"));
        [error, budget].into_iter().flatten().collect()
    }

    fn execution(&self, study: &Study) -> Result<Execution, RunError> {
        let default = || Path::new("runs").join(format!("accuracy-{}", study.name));
        let out = self.out.clone().unwrap_or_else(default);
        let out = std::path::absolute(&out).map_err(RunError::file("resolve", &out))?;
        let scene = &study.samples[0].scene;
        let ranks =
            scene.stages.iter().flat_map(|s| s.kind.roles()).map(|r| scene.ranks.of(*r)).max().unwrap_or(1);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Execution {
            out,
            jobs: self.jobs.map_or((cores / ranks as usize).max(1), |n| n as usize),
            repeat: self.repeat as usize,
            any_build: self.any_build,
            limit_s: self.limit,
        })
    }
}

/// Runs the study of a scene. Returns whether it passes the comparison with its reference, and the text for the terminal.
///
/// # Errors
/// Invalid scene, study or target; failure of the base sample; interruption; file errors.
pub fn accuracy(
    args: &AccuracyArgs,
    stop: &AtomicBool,
    console: &Console,
) -> Result<(bool, String), RunError> {
    let reference = args.reference.as_deref().map(reference::load).transpose()?;
    let choice =
        Choice { parameters: args.parameters.clone(), check: !args.without_check, verify: args.verify };
    let study = Study::new(&args.scene, &choice)?;
    study.warnings.iter().for_each(|w| console.line(&format!("warning: {w}")));
    let execution = args.execution(&study)?;
    let queue = runs::queue(&study, &execution)?;
    if args.dry_run {
        return Ok((true, plan::plan(&study, &execution, &queue)));
    }
    let estimate = plan::Estimate::new(&study, &execution, &queue);
    console.line(&format!(
        "{} samples in {}; {}",
        study.samples.len(),
        execution.out.display(),
        estimate.words(&execution)
    ));
    plan::confirm(&estimate, args.yes)?;
    let out = &execution.out;
    std::fs::create_dir_all(out).map_err(RunError::file("create", out))?;
    let _lock = results::lock::lock(out)?;
    clear_results(out)?;
    let base = |record: &Record| values(&study, 0, record, out).into_iter().find_map(Result::err);
    let records = runs::run_samples(&study, &execution, queue, &base, stop, console)?;
    let values: Vec<Vec<judge::Value>> =
        records.iter().enumerate().map(|(m, record)| values(&study, m, record, out)).collect();
    let outcome = judge(&study, &values, &records, args.cost);
    report(args, &study, &outcome, &records, out, reference.as_ref())
}

/// Values of the quantities of a sample, or the reason why a value is missing.
fn values(study: &Study, sample: usize, record: &Record, out: &Path) -> Vec<judge::Value> {
    let sample = &study.samples[sample];
    let of = |q: &case::Quantity| match &record.failure {
        Some(why) => Err(why.clone()),
        None => quantities::value(q, &sample.scene, study.stage, &runs::run_folder(out, sample)),
    };
    study.quantities.iter().map(of).collect()
}

/// Removes the report and the recommendations of an earlier study: this one may fail or recommend nothing.
fn clear_results(out: &Path) -> Result<(), RunError> {
    let advice = ["target-error", "want", "budget"];
    let advice = advice.iter().flat_map(|name| ["toml", "json"].map(|end| format!("{name}.{end}")));
    for name in advice.chain(["accuracy.html".into()]) {
        let path = out.join(name);
        if path.exists() {
            std::fs::remove_file(&path).map_err(RunError::file("remove", &path))?;
        }
    }
    Ok(())
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
    let notes: Vec<Option<String>> = records.iter().map(|r| r.note.clone()).collect();
    let not_assessed = coverage::not_assessed(study, outcome);
    let build = format!("commit {}, build {}", provenance::commit(), provenance::build()?);
    let context = Context { output: &output, out, not_assessed: &not_assessed, notes: &notes, build: &build };
    let (mut advised, mut refused) = (Vec::new(), None);
    for target in args.targets() {
        match advice::advise(study, outcome, target, &context) {
            Ok(advice) => advised.push(advice),
            // The report is still written.
            Err(error) => refused = Some(error),
        }
    }
    let verified = verified(study, outcome, &advised);
    let about = page::About {
        not_assessed: &not_assessed,
        advice: &advised,
        verified: verified.as_ref(),
        command: &command(args),
        build: &build,
    };
    let path = out.join("accuracy.html");
    std::fs::write(&path, page::page(study, outcome, records, &drawn, &about))
        .map_err(RunError::file("write", &path))?;
    let mut text = words::words(study, outcome, &not_assessed);
    for a in &advised {
        text += &format!("{}\n  scene: {}\n", a.lines().join("\n"), a.scene.display());
    }
    text += &format!("report: {}", path.display());
    if let Some(error) = refused {
        return Err(with_text(error, &text));
    }
    if outcome.answers.iter().all(Option::is_none) {
        let why = "no parameter has two samples with values, so no error can be estimated".to_owned();
        return Err(with_text(RunError::Study(why), &text));
    }
    let verified = match verified {
        Some(Err(why)) => return Err(with_text(RunError::Study(format!("--verify: {why}")), &text)),
        Some(Ok(all)) => all,
        None => Vec::new(),
    };
    if let Some(file) = &args.keep_reference {
        reference::save(file, &reference::keep(study, outcome, records)?)?;
    }
    let found = reference.map(|r| reference::compare(study, outcome, records, r)).unwrap_or_default();
    found.iter().for_each(|f| text += &format!("\n{f}"));
    if reference.is_some() && found.is_empty() {
        text += "\nerrors and counts are within those of the reference";
    }
    text += &words::verified(&verified);
    Ok((found.is_empty() && verified.iter().all(|v| v.held), text))
}

/// Comparison of the recommended sample (else the base) with the reference.
fn verified(
    study: &Study,
    outcome: &Outcome,
    advised: &[Advice],
) -> Option<Result<Vec<verify::Verified>, String>> {
    match advised.first() {
        Some(a) => a.verified.clone().map(Ok),
        None => verify::verify(study, outcome, 0),
    }
}

/// An error followed by the text of the study.
fn with_text(error: RunError, text: &str) -> RunError {
    match error {
        RunError::Input(why) => RunError::Input(format!("{why}\n{text}")),
        other => RunError::Study(format!("{other}\n{text}")),
    }
}

/// The command that reproduces the report, without machine-dependent folders.
fn command(args: &AccuracyArgs) -> String {
    let mut line = format!("ripstop accuracy {}", args.scene.display());
    if !args.parameters.is_empty() {
        line += &format!(" --parameters {}", args.parameters.join(","));
    }
    if args.cost != Measure::Wall {
        line += &format!(" --cost {:?}", args.cost).to_lowercase();
    }
    if args.repeat > 1 {
        line += &format!(" --repeat {}", args.repeat);
    }
    if args.verify {
        line += " --verify";
    }
    line
}
