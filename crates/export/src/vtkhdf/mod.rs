//! `ripstop export vtkhdf`: the snapshots of a stage as one compressed file with all times.

mod derived;
mod growing;
mod part;
#[cfg(test)]
mod tests;
mod writer;

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use coupling::error::RunError;
use figures::snapshots::{Interval, Kind, RunSnapshots};
use mesh::vtk::read::{Piece, Snapshot};
use terminal::{Console, counted};

use self::part::{Cuboid, Part};
use self::writer::{WriteError, Writer};

/// Bytes at the start of an HDF5 file.
const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";
/// Time between lines of progress.
const PROGRESS: Duration = Duration::from_secs(5);

/// What is exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum What {
    /// Fabric: shape, stresses, loads, and the normals and areas of its faces
    Canopy,
    /// Lines, risers and tapes
    Lines,
    /// Cells of the flow
    Flow,
}

/// Arguments of `ripstop export vtkhdf`.
#[derive(Args)]
pub struct VtkhdfArgs {
    /// Results folder of a run; it may be running or interrupted
    run: PathBuf,
    /// What to export
    #[arg(long, value_enum, default_value_t = What::Canopy)]
    what: What,
    /// Stage to export [default: the last one with such snapshots]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    #[command(flatten)]
    interval: Interval,
    /// Export these fields only, such as `--fields pressure_pa,velocity_frame_m_s` [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    fields: Vec<String>,
    /// Export only cells whose centre lies in this box at the time, between two corners in metres
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true, value_parser = Cuboid::parse)]
    cuboid: Option<Cuboid>,
    /// The file [default: RUN/export/STAGE-WHAT.vtkhdf]. An HDF5 file is replaced, another file is not
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl VtkhdfArgs {
    fn kind(&self) -> Kind {
        match self.what {
            What::Canopy => Kind::Canopy,
            What::Lines => Kind::Lines,
            What::Flow => Kind::Flow,
        }
    }

    /// The file of a stage.
    fn file(&self, stage: &str) -> PathBuf {
        let what = match self.what {
            What::Canopy => "canopy",
            What::Lines => "lines",
            What::Flow => "flow",
        };
        self.out.clone().unwrap_or_else(|| self.run.join("export").join(format!("{stage}-{what}.vtkhdf")))
    }
}

/// Writes the file. It appears under its name once it is complete.
///
/// # Errors
/// The run has no such snapshots or fields; snapshots that cannot be read; a file that cannot be written.
pub fn export(args: &VtkhdfArgs, console: &Console) -> Result<(), RunError> {
    let run = RunSnapshots::open(&args.run)?;
    let (stage, times) = run.series(args.stage.as_deref(), args.kind())?;
    let snapshots = args.interval.choose(&times)?;
    let name = &run.scene.stages[stage].name;
    let path = args.file(name);
    may_be_replaced(&path)?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    }
    let (n, kind) = (snapshots.len(), args.kind().name());
    console.line(&format!("stage `{name}`: {} of {kind}", counted(n as u64, "snapshot")));

    let mut unfinished = path.clone().into_os_string();
    unfinished.push(".part");
    let unfinished = PathBuf::from(unfinished);
    let source = format!("ripstop export vtkhdf: {kind} in stage {name} of {}", run.scene.name);
    let written = write(args, &run, &snapshots, (&unfinished, &source), console);
    let text = written.inspect_err(|_| drop(std::fs::remove_file(&unfinished)))?;
    std::fs::rename(&unfinished, &path).map_err(RunError::file("write", &path))?;
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    let before: u64 = snapshots.iter().flat_map(|s| &s.files).map(size).sum();
    let [kilobytes, before] = [bytes, before].map(|b| b.div_ceil(1000));
    console.line(&format!("{}: {text}, {kilobytes} kB (VTU files: {before} kB)", path.display()));
    Ok(())
}

fn size(path: &PathBuf) -> u64 {
    std::fs::metadata(path).map_or(0, |m| m.len())
}

/// Refuses to replace a file that is no HDF5 file.
fn may_be_replaced(path: &Path) -> Result<(), RunError> {
    let mut begin = [0; SIGNATURE.len()];
    let exists = path.exists();
    let ours = std::fs::File::open(path).and_then(|mut f| f.read_exact(&mut begin)).is_ok();
    if exists && !(ours && begin == SIGNATURE) {
        return Err(RunError::Input(format!(
            "{} exists and is no HDF5 file: it is not replaced. Name another file with --out, or remove it",
            path.display()
        )));
    }
    Ok(())
}

/// Writes all steps; what was written, in words.
fn write(
    args: &VtkhdfArgs,
    run: &RunSnapshots,
    snapshots: &[Snapshot],
    (path, source): (&Path, &str),
    console: &Console,
) -> Result<String, RunError> {
    let failed = |error: rust_hdf5::Hdf5Error| {
        RunError::Input(format!(
            "{} cannot be written: {error}. Check the free space of its disk",
            path.display()
        ))
    };
    let mut writer: Option<(Writer, String)> = None;
    let mut shown = Instant::now();
    for (k, snapshot) in snapshots.iter().enumerate() {
        let parts = parts(args, run, snapshot, k == 0)?;
        let (writer, _) = match &mut writer {
            Some(writer) => writer,
            none => {
                let made = Writer::create(path, source, &parts).map_err(failed)?;
                none.insert((made, sizes(&parts)))
            }
        };
        writer.add(snapshot.time, parts).map_err(|error| match error {
            WriteError::Hdf5(error) => failed(error),
            WriteError::Missing(field) => RunError::Input(format!(
                "the snapshot at t = {} s has no field `{field}` as the first one has it. Choose fields that all have \
                 with --fields, or an interval with --from and --to",
                snapshot.time
            )),
        })?;
        if shown.elapsed() > PROGRESS {
            console.line(&format!("{} of {} snapshots, t = {} s", k + 1, snapshots.len(), snapshot.time));
            shown = Instant::now();
        }
    }
    let Some((writer, sizes)) = writer else { return Ok(String::new()) };
    writer.finish().map_err(failed)?;
    Ok(format!("{}, {sizes}", counted(snapshots.len() as u64, "time")))
}

/// Sizes of the first step.
fn sizes(parts: &[Part]) -> String {
    let sum = |of: fn(&Part) -> usize| parts.iter().map(of).sum::<usize>() as u64;
    let fields = parts.first().map_or(0, |p| p.point_fields.len() + p.cell_fields.len());
    format!(
        "{}, {}, {}",
        counted(sum(|p| p.points.len()), "point"),
        counted(sum(|p| p.topology.types.len()), "cell"),
        counted(fields as u64, "field")
    )
}

/// The parts of a step: one for each file of the snapshot.
fn parts(
    args: &VtkhdfArgs,
    run: &RunSnapshots,
    snapshot: &Snapshot,
    first: bool,
) -> Result<Vec<Part>, RunError> {
    let mut pieces = snapshot.files.iter().map(|f| run.piece(f)).collect::<Result<Vec<_>, _>>()?;
    if args.what == What::Canopy {
        for piece in &mut pieces {
            let derived = derived::normals_and_areas(piece);
            piece.cell_fields.extend(derived);
        }
    }
    if first {
        known(args, &pieces)?;
    }
    let wanted = |name: &str| args.fields.is_empty() || args.fields.iter().any(|f| f == name);
    let parts: Vec<_> = pieces.iter().map(|p| Part::of(p, args.cuboid.as_ref(), wanted)).collect();
    if args.cuboid.is_some() && parts.iter().all(|p| p.topology.types.is_empty()) {
        return Err(RunError::Input(format!(
            "no cell has its centre in the box of --box at t = {} s. {}",
            snapshot.time,
            extent(&pieces)
        )));
    }
    Ok(parts)
}

/// Where the cells are.
fn extent(pieces: &[Piece]) -> String {
    let range = |c: usize| {
        let all = pieces.iter().flat_map(|p| &p.points).map(|x| x[c]);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let [[x0, x1], [y0, y1], [z0, z1]] = [0, 1, 2].map(range);
    format!("The points lie in {x0:.3},{y0:.3},{z0:.3},{x1:.3},{y1:.3},{z1:.3}")
}

/// Refuses fields that the first snapshot does not have.
fn known(args: &VtkhdfArgs, pieces: &[Piece]) -> Result<(), RunError> {
    let columns = pieces.iter().flat_map(|p| p.point_fields.iter().chain(&p.cell_fields));
    let mut names: Vec<&str> = columns.map(|c| c.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    match args.fields.iter().find(|f| !names.contains(&f.as_str())) {
        None => Ok(()),
        Some(unknown) => Err(RunError::Input(format!(
            "--fields: the snapshots of {} have no field `{unknown}`. They have {}",
            args.kind().name(),
            names.join(", ")
        ))),
    }
}
