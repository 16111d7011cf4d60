//! `ripstop new`: a commented scene of a canopy type, or a package of a solver program.

mod participant;

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write as _};
use std::path::PathBuf;

use canopies::{CanopyType, Experiment, SceneSizes};
use coupling::error::RunError;

/// What `ripstop new` writes instead of a scene.
#[derive(clap::Subcommand, Clone, Debug)]
enum Package {
    /// Write a package of a solver program that replaces one of Ripstop's, in Rust or Python; it passes `ripstop conform`
    Participant(participant::ParticipantArgs),
}

/// Arguments of `ripstop new`.
#[derive(clap::Args, Clone, Debug)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct NewArgs {
    #[command(subcommand)]
    package: Option<Package>,
    /// Type of the canopy
    #[arg(value_parser = canopy_type(), value_name = "TYPE", required = true)]
    canopy: Option<CanopyType>,
    /// Nominal diameter, m: that of a circle with the area of all fabric and openings
    #[arg(long, value_name = "M", default_value_t = 8.53, value_parser = from(0.05, 200.0))]
    diameter: f64,
    /// Mass of the payload, kg [default: one that descends at about 6 m/s]
    #[arg(long, value_name = "KG", value_parser = from(1e-6, 1e6))]
    payload: Option<f64>,
    /// Speed of the air, m/s: at which the canopy begins to open, or of the wind tunnel [default: 20; wind tunnel 6]
    #[arg(long, value_name = "M/S", value_parser = from(0.1, 100.0))]
    speed: Option<f64>,
    /// Hold the payload in a steady wind, for the settled drag, instead of an opening with a payload
    #[arg(long, conflicts_with = "payload")]
    wind_tunnel: bool,
    /// The scene file [default: TYPE.toml in the current folder]; `-` prints it
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Names of the types, with their descriptions in `--help`.
fn canopy_type() -> impl clap::builder::TypedValueParser<Value = CanopyType> {
    use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser as _};
    let value = |t: CanopyType| PossibleValue::new(t.name()).help(t.description());
    let named = |name: String| CanopyType::ALL.into_iter().find(|t| t.name() == name);
    PossibleValuesParser::new(CanopyType::ALL.map(value)).try_map(move |name| named(name).ok_or("not a type"))
}

/// A finite number from `low` to `high`.
fn from(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| match text.parse::<f64>() {
        Ok(x) if (low..=high).contains(&x) => Ok(x),
        Ok(_) => Err(format!("must be from {low} to {high}")),
        Err(e) => Err(e.to_string()),
    }
}

/// Writes the scene or the package; returns what to print.
///
/// # Errors
/// [`RunError::Input`]: the file exists already or cannot be written.
pub fn new(args: &NewArgs) -> Result<String, RunError> {
    match (&args.package, args.canopy) {
        (Some(Package::Participant(args)), _) => participant::new_participant(args),
        (None, Some(canopy)) => new_scene(args, canopy),
        (None, None) => {
            Err(RunError::Input("name a type of canopy, or `participant`; see `ripstop new --help`".into()))
        }
    }
}

fn new_scene(args: &NewArgs, canopy: CanopyType) -> Result<String, RunError> {
    let (experiment, usual_speed) =
        if args.wind_tunnel { (Experiment::WindTunnel, 6.0) } else { (Experiment::Opening, 20.0) };
    let sizes = SceneSizes {
        nominal_diameter_m: args.diameter,
        payload_mass_kg: args.payload,
        speed_m_s: args.speed.unwrap_or(usual_speed),
        experiment,
    };
    let text = canopies::scene(canopy, &sizes);
    let file = args.out.clone().unwrap_or_else(|| format!("{}.toml", canopy.name()).into());
    if file.as_os_str() == "-" {
        return Ok(text.trim_end().to_owned());
    }
    let mut options = OpenOptions::new();
    let mut open = options.write(true).create_new(true).open(&file).map_err(|e| {
        let remedy = match e.kind() {
            ErrorKind::AlreadyExists => "; name another file with --out, or move it away",
            _ => "; name a file that can be written with --out",
        };
        RunError::Input(format!("cannot write the scene {}: {e}{remedy}", file.display()))
    })?;
    open.write_all(text.as_bytes())
        .map_err(|e| RunError::Input(format!("cannot write the scene {}: {e}", file.display())))?;
    let name = file.display();
    Ok(format!("{name}: {}\nnext: ripstop check {name}; ripstop run {name}", canopy.description()))
}
