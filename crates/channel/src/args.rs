//! The command line of every solver program.

use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Duration;

use case::Role;
use clap::Parser;

use crate::watchdog::Watchdog;
use crate::{CONTRACT_VERSION, ServeOptions};

/// Environment variable with the deadline of the run in seconds.
pub const DEADLINE: &str = "RIPSTOP_DEADLINE_S";

/// Name of this program's file.
static NAME: LazyLock<String> = LazyLock::new(|| {
    let path = std::env::args_os().next().map(PathBuf::from).unwrap_or_default();
    path.file_name().map_or_else(|| "solver".into(), |name| name.to_string_lossy().into_owned())
});

/// Version of Ripstop, and of the contract that the program speaks.
static VERSION: LazyLock<String> =
    LazyLock::new(|| format!("(Ripstop {}, contract {CONTRACT_VERSION})", env!("CARGO_PKG_VERSION")));

/// Arguments that the coupler passes to a solver program: the same for every program, including one that replaces a
/// solver.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(
    name = NAME.as_str(),
    version = VERSION.as_str(),
    about = "A solver program of Ripstop. Started by `ripstop run`, or by hand together with `ripstop attach`."
)]
pub struct ProgramArgs {
    /// Scene file.
    #[arg(long, value_name = "PATH")]
    pub scene: PathBuf,
    /// Stage of the scene to run, from 0.
    #[arg(long, value_name = "N")]
    pub stage: usize,
    /// Session of the coupler to join.
    #[arg(long, value_name = "NAME")]
    pub session: String,
    /// Folder of the run's results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Ranks of this program, as passed to `mpirun -n`.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub ranks: u32,
    /// Folder of a saved state within the stage, to resume from: the files that this program wrote there on `Save`.
    /// Only programs that announce the effect `resume` get this argument.
    #[arg(long, value_name = "DIR")]
    pub resume: Option<PathBuf>,
    /// Longest time without a message of the coupler before this program ends, s. Absent: no limit (the death of the
    /// coupler is noticed in any case).
    #[arg(long, value_name = "S", value_parser = positive_seconds)]
    pub deadline_s: Option<f64>,
}

impl ProgramArgs {
    /// The arguments of this process, or a message with a remedy (or the help text).
    pub fn from_command_line() -> Result<Self, String> {
        let args = Self::from_words(std::env::args_os())?;
        args.watch_coupler();
        Ok(args)
    }

    /// The same from given words, the program's name first.
    pub fn from_words<I, T>(words: I) -> Result<Self, String>
    where
        I: IntoIterator<Item = T>,
        T: Into<std::ffi::OsString> + Clone,
    {
        Self::try_parse_from(words).map_err(|e| {
            if e.use_stderr() {
                format!(
                    "{}\nThe coupler passes these arguments; to start this program by hand, \
                     copy the line that `ripstop attach` prints.",
                    e.to_string().trim_end()
                )
            } else {
                e.to_string()
            }
        })
    }

    /// The same, ending the process with code 2 and a message where they are invalid (code 0 for `--help`). Must be
    /// called before MPI is initialised.
    pub fn parse_or_exit() -> Self {
        match Self::try_parse() {
            Ok(args) => {
                args.watch_coupler();
                args
            }
            Err(e) => e.exit(),
        }
    }

    /// If the coupler already serves its session (it launched this program), ends this process (code 70) 2 s after
    /// the coupler's death, whatever it is doing then, until the coupler has stopped the run. The same applies where
    /// the coupler is stopped (SIGSTOP) for longer than the deadline that it passes on.
    pub fn watch_coupler(&self) {
        let passed = std::env::var(DEADLINE).ok().and_then(|text| positive_seconds(&text).ok());
        // A session that cannot be watched cannot be joined either, which is reported later.
        if let Ok(Some(watchdog)) = Watchdog::over(&self.session, passed.map(Duration::from_secs_f64)) {
            watchdog.stay();
        }
    }

    /// Options of [`crate::serve`] for one rank of this program.
    pub fn serve_options(&self, role: Role, rank: usize) -> ServeOptions {
        ServeOptions {
            session: self.session.clone(),
            role,
            rank,
            ranks: self.ranks as usize,
            stage: self.stage,
            deadline: self.deadline_s.map(Duration::from_secs_f64),
            exit_when_orphaned: true,
        }
    }
}

fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s < 1e9 => Ok(s),
        _ => Err("a number of seconds above 0 and below 1e9".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = "flow --scene a/scene.toml --stage 1 --session s-1 --out runs/a --ranks 2";

    fn parse(line: &str) -> Result<ProgramArgs, String> {
        ProgramArgs::from_words(line.split_whitespace())
    }

    #[test]
    fn command_line_of_the_coupler_is_parsed() {
        let args = parse(LINE).expect("fine");
        assert_eq!((args.stage, args.ranks, args.deadline_s), (1, 2, None));
        assert_eq!(args.resume, None);
        let resumed = parse(&format!("{LINE} --resume a/state")).expect("fine");
        assert_eq!(resumed.resume, Some(PathBuf::from("a/state")));
        let at = args.serve_options(Role::Flow, 1);
        assert_eq!((at.session.as_str(), at.rank, at.ranks, at.deadline), ("s-1", 1, 2, None));
        let args = parse(&format!("{LINE} --deadline-s 2.5")).expect("fine");
        assert_eq!(args.serve_options(Role::Flow, 0).deadline, Some(Duration::from_millis(2500)));
    }

    #[test]
    fn invalid_command_lines_are_explained() {
        for (line, word) in [
            ("flow --scene a", "--stage"),
            (&format!("{LINE} --ranks 0"), "--ranks"),
            (&LINE.replace("--ranks 2", "--ranks 0"), "0 is not in 1.."),
            (&format!("{LINE} --deadline-s nan"), "seconds above 0"),
            (&format!("{LINE} --deadline-s 0"), "seconds above 0"),
            (&format!("{LINE} --speed 3"), "--speed"),
        ] {
            let message = parse(line).expect_err(line);
            assert!(message.contains(word) && message.contains("ripstop attach"), "{message}");
        }
        let version = parse("flow --version").expect_err("a version");
        assert!(version.contains(&format!("contract {CONTRACT_VERSION})")), "{version}");
        assert!(!parse("flow --help").expect_err("help").contains("to start this program by hand"));
    }
}
