//! `history.csv`: one row for each window.
//!
//! The columns of a stage are those of the programs that run in it. Everything
//! up to the wall times at the end of a row is the same, byte for byte, when the
//! same run is repeated.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use case::{Role, StageKind};
use channel::{flow_stats, mesh_stats, structure_stats};
use coupling::balance::SystemBalance;
use coupling::energy::EnergyBooks;
use coupling::error::RunError;
use coupling::schemes::WindowReport;

/// First column that differs from run to run; all after it do too.
pub const FIRST_WALL_COLUMN: &str = "structure_wall_s";

/// A window as the history and the progress line see it.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Number of the window.
    pub window: u64,
    /// Time at its end, s.
    pub time_s: f64,
    /// Its length, s.
    pub window_s: f64,
    /// Attempts at it that were given back.
    pub rejected: u32,
    /// Planned windows that are over.
    pub done: u64,
    /// What the scheme reported.
    pub report: WindowReport,
    /// Downwards, m/s.
    pub descent_speed_m_s: f64,
    /// Upwards, m/s2.
    pub acceleration_m_s2: f64,
    /// Drag coefficient; `None` without descent.
    pub drag_coefficient: Option<f64>,
    /// Work of the air on the canopy in this window, J.
    pub interface_work_j: f64,
    /// What the coupling itself adds to the energy of the canopy in this window, J.
    pub energy_error_j: f64,
    /// Both summed over the stage.
    pub books: EnergyBooks,
    /// Momentum and energy of the falling system; `None` where nothing falls.
    pub balance: Option<SystemBalance>,
    /// Wall seconds of the window.
    pub wall_s: f64,
    /// Wall seconds of the coupler itself.
    pub coupler_s: f64,
}

impl Row {
    /// Wall seconds in which no program computed and the coupler waited: channel,
    /// wake-up, and other programs on the cores.
    pub fn waiting_s(&self) -> f64 {
        (self.wall_s - self.coupler_s - self.report.busy_s.iter().sum::<f64>()).max(0.0)
    }
}

enum Cell {
    Count(u64),
    Number(f64),
    Flag(bool),
    Nothing,
    /// Wall seconds: few digits are enough.
    Wall(f64),
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Count(n) => write!(f, "{n}"),
            // Nine digits: more are noise of the solvers' tolerances.
            Self::Number(x) => write!(f, "{x:.8e}"),
            Self::Flag(b) => write!(f, "{}", u8::from(*b)),
            Self::Nothing => Ok(()),
            Self::Wall(s) => write!(f, "{s:.4}"),
        }
    }
}

fn cells(kind: StageKind, row: &Row) -> Vec<(&'static str, Cell)> {
    use Cell::{Count, Flag, Nothing, Number, Wall};
    let report = &row.report;
    let has = |role: Role| kind.roles().contains(&role);
    let mut cells = vec![("window", Count(row.window)), ("time_s", Number(row.time_s))];
    if has(Role::Flow) {
        cells.extend([
            ("descent_speed_m_s", Number(row.descent_speed_m_s)),
            ("acceleration_m_s2", Number(row.acceleration_m_s2)),
            ("drag_n", Number(report.force[2])),
            ("cd", row.drag_coefficient.map_or(Nothing, Number)),
            ("force_x_n", Number(report.force[0])),
            ("force_y_n", Number(report.force[1])),
        ]);
    }
    if kind == StageKind::Coupled {
        cells.extend([
            ("coupling_iterations", Count(u64::from(report.iterations))),
            ("coupling_residual", report.residual.map_or(Nothing, Number)),
            ("coupling_converged", Flag(report.converged)),
            ("window_s", Number(row.window_s)),
            ("rejected_attempts", Count(u64::from(row.rejected))),
            ("interface_work_j", Number(row.interface_work_j)),
            ("interface_energy_error_j", Number(row.energy_error_j)),
            ("interface_energy_error_sum_j", Number(row.books.added_j)),
            ("interface_energy_error_share", Number(row.books.share())),
        ]);
        let of_system =
            |value: fn(&SystemBalance) -> f64| row.balance.as_ref().map_or(Nothing, |b| Number(value(b)));
        cells.extend([
            ("system_missing_impulse_n_s", of_system(|b| b.missing_impulse)),
            ("system_energy_j", of_system(|b| b.energy_j)),
            ("system_air_work_j", of_system(|b| b.air_work_j)),
            ("system_energy_created_j", of_system(SystemBalance::created_j)),
        ]);
    }
    let mut add = |role: Role, columns: &[(&'static str, usize, bool)]| {
        if has(role) {
            let values = &report.stats[role as usize].values;
            cells.extend(columns.iter().map(|&(name, at, count)| {
                (name, if count { Count(values[at] as u64) } else { Number(values[at]) })
            }));
        }
    };
    use structure_stats as s;
    add(
        Role::Structure,
        &[
            ("structure_kinetic_energy_j", s::KINETIC_ENERGY, false),
            ("structure_strain_energy_j", s::STRAIN_ENERGY, false),
            ("structure_load_work_j", s::LOAD_WORK, false),
            ("structure_work_j", s::WORK, false),
            ("structure_work_sum_j", s::WORK_SUM, false),
            ("structure_energy_created_j", s::ENERGY_CREATED, false),
            ("structure_energy_created_sum_j", s::ENERGY_CREATED_SUM, false),
            ("structure_energy_throughput_j", s::ENERGY_THROUGHPUT, false),
            ("vertical_load_n", s::VERTICAL_LOAD, false),
            ("riser_force_n", s::RISER_FORCE, false),
            ("support_force_n", s::SUPPORT_FORCE, false),
            ("max_line_tension_n", s::MAX_LINE_TENSION, false),
            ("projected_area_m2", s::PROJECTED_AREA, false),
            ("volume_m3", s::VOLUME, false),
            ("structure_newton_steps", s::NEWTON_STEPS, true),
            ("structure_gmres_iterations", s::GMRES_ITERATIONS, true),
            ("structure_factorisations", s::FACTORISATIONS, true),
            ("structure_step_cuts", s::STEP_CUTS, true),
            ("structure_residual", s::RESIDUAL, false),
            ("structure_residual_target", s::RESIDUAL_TARGET, false),
        ],
    );
    use flow_stats as f;
    add(
        Role::Flow,
        &[
            ("flow_iterations", f::ITERATIONS, true),
            ("flow_linear_iterations", f::LINEAR_ITERATIONS, true),
            ("flow_residual_start", f::RESIDUAL_START, false),
            ("flow_residual_end", f::RESIDUAL_END, false),
            ("flow_residual_target", f::RESIDUAL_TARGET, false),
            ("flow_max_mach", f::MAX_MACH, false),
            ("flow_max_courant", f::MAX_COURANT, false),
            ("flow_max_pressure_pa", f::MAX_PRESSURE, false),
            ("flow_min_pressure_pa", f::MIN_PRESSURE, false),
            ("flow_mass_defect_kg_s", f::MASS_DEFECT, false),
        ],
    );
    use mesh_stats as m;
    add(
        Role::Mesh,
        &[
            ("mesh_iterations", m::ITERATIONS, true),
            ("mesh_increments", m::INCREMENTS, true),
            ("mesh_residual", m::RESIDUAL, false),
            ("mesh_residual_target", m::RESIDUAL_TARGET, false),
            ("mesh_min_quality", m::MIN_QUALITY, false),
            ("mesh_min_volume_ratio", m::MIN_VOLUME_RATIO, false),
        ],
    );
    for (role, name, at) in [
        (Role::Structure, "structure_unconverged_solves", s::UNCONVERGED),
        (Role::Flow, "flow_unconverged_solves", f::UNCONVERGED),
    ] {
        if has(role) {
            cells.push((name, Count(report.sums[role as usize][at] as u64)));
        }
    }
    // Only wall times from here on.
    cells.extend([
        (FIRST_WALL_COLUMN, Wall(report.busy_s[Role::Structure as usize])),
        ("flow_wall_s", Wall(report.busy_s[Role::Flow as usize])),
        ("mesh_wall_s", Wall(report.busy_s[Role::Mesh as usize])),
        ("coupler_wall_s", Wall(row.coupler_s)),
        ("waiting_wall_s", Wall(row.waiting_s())),
        ("window_wall_s", Wall(row.wall_s)),
    ]);
    cells
}

/// The file of a stage, flushed with every row.
pub struct History {
    kind: StageKind,
    path: PathBuf,
    file: BufWriter<File>,
}

impl History {
    /// Creates the file with its header line.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn create(path: &Path, kind: StageKind) -> Result<Self, RunError> {
        let file = File::create(path).map_err(RunError::file("create", path))?;
        let mut history = Self { kind, path: path.into(), file: BufWriter::new(file) };
        let names: Vec<&str> = cells(kind, &Row::default()).iter().map(|(name, _)| *name).collect();
        history.line(&names.join(","))?;
        Ok(history)
    }

    /// Goes on with a file that was cut back to the windows before.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn resume(path: &Path, kind: StageKind) -> Result<Self, RunError> {
        if !path.exists() {
            return Self::create(path, kind);
        }
        Ok(Self { kind, path: path.into(), file: BufWriter::new(append(path)?) })
    }

    /// Brings all rows to the disk: a state that is saved next counts on them.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn sync(&self) -> Result<(), RunError> {
        self.file.get_ref().sync_data().map_err(RunError::file("write", &self.path))
    }

    /// Adds a window.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn push(&mut self, row: &Row) -> Result<(), RunError> {
        let texts: Vec<String> = cells(self.kind, row).iter().map(|(_, cell)| cell.to_string()).collect();
        self.line(&texts.join(","))
    }

    fn line(&mut self, text: &str) -> Result<(), RunError> {
        writeln!(self.file, "{text}")
            .and_then(|()| self.file.flush())
            .map_err(RunError::file("write", &self.path))
    }
}

/// `iterations.csv` of a coupled stage: the measure of every coupling iteration.
pub struct Iterations {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Iterations {
    /// Creates the file with its header line.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn create(path: &Path) -> Result<Self, RunError> {
        let file = File::create(path).map_err(RunError::file("create", path))?;
        let mut all = Self { path: path.into(), file: BufWriter::new(file) };
        all.write(&["window,iteration,coupling_residual".to_owned()])?;
        Ok(all)
    }

    /// Goes on with a file that was cut back to the windows before.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn resume(path: &Path) -> Result<Self, RunError> {
        if !path.exists() {
            return Self::create(path);
        }
        Ok(Self { path: path.into(), file: BufWriter::new(append(path)?) })
    }

    /// Adds the iterations of a window.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn push(&mut self, row: &Row) -> Result<(), RunError> {
        let residuals = row.report.residuals.iter().enumerate();
        let lines: Vec<String> = residuals.map(|(i, r)| format!("{},{i},{r:.3e}", row.window)).collect();
        self.write(&lines)
    }

    fn write(&mut self, lines: &[String]) -> Result<(), RunError> {
        lines
            .iter()
            .try_for_each(|line| writeln!(self.file, "{line}"))
            .and_then(|()| self.file.flush())
            .map_err(RunError::file("write", &self.path))
    }
}

fn append(path: &Path) -> Result<File, RunError> {
    File::options().append(true).open(path).map_err(RunError::file("write", path))
}

/// Columns of a history file by name; empty cells are NaN.
///
/// # Errors
/// Trouble with the file, or a file that is no table of numbers.
pub fn read(path: &Path) -> Result<Vec<(String, Vec<f64>)>, RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::file("read", path))?;
    parse(&text, path)
}

/// Columns of the text of a history file, as [`read`].
///
/// # Errors
/// A text that is no history; `path` is for messages.
pub fn parse(text: &str, path: &Path) -> Result<Vec<(String, Vec<f64>)>, RunError> {
    let mut lines = text.lines();
    let mut columns: Vec<(String, Vec<f64>)> =
        lines.next().unwrap_or_default().split(',').map(|name| (name.to_owned(), Vec::new())).collect();
    for (at, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        if cells.len() != columns.len() {
            return Err(RunError::Input(format!(
                "{}, line {}: {} cells under {} names",
                path.display(),
                at + 2,
                cells.len(),
                columns.len()
            )));
        }
        for (cell, (_, values)) in cells.iter().zip(&mut columns) {
            values.push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    Ok(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(window: u64, wall: f64) -> Row {
        let mut row = Row { window, time_s: window as f64 * 5e-3, wall_s: wall, ..Row::default() };
        row.report.iterations = 4;
        row.report.residual = Some(1.0 / 3.0);
        row.report.busy_s = [wall / 4.0; 3];
        row.report.stats[Role::Mesh as usize].values[mesh_stats::MIN_QUALITY] = 0.25;
        row
    }

    #[test]
    fn equal_runs_give_equal_bytes_but_for_the_last_columns() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, wall: f64| {
            let path = folder.path().join(name);
            let mut history = History::create(&path, StageKind::Coupled).unwrap();
            (0..3).for_each(|w| history.push(&row(w, wall)).unwrap());
            let text = std::fs::read_to_string(path).unwrap();
            let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
            let keep = names.iter().position(|n| *n == FIRST_WALL_COLUMN).unwrap();
            assert!(names[keep..].iter().all(|n| n.ends_with("_wall_s")), "{names:?}");
            text.lines().map(|l| l.split(',').take(keep).collect::<Vec<_>>().join(",")).collect::<Vec<_>>()
        };
        let (a, b) = (write("a.csv", 0.5), write("b.csv", 0.7));
        assert_eq!(a, b);
        assert_eq!(a.len(), 4);
    }

    #[test]
    fn a_stage_has_the_columns_of_its_programs() {
        let names = |kind| cells(kind, &Row::default()).iter().map(|(n, _)| *n).collect::<Vec<_>>();
        let alone = names(StageKind::PreInflation);
        assert!(alone.contains(&"projected_area_m2") && !alone.contains(&"drag_n"));
        let flow = names(StageKind::FlowOnly);
        assert!(flow.contains(&"drag_n") && !flow.contains(&"mesh_min_quality"));
        let all = names(StageKind::Coupled);
        assert_eq!(all.iter().collect::<std::collections::BTreeSet<_>>().len(), all.len(), "a name twice");
    }

    #[test]
    fn reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("h.csv");
        let mut history = History::create(&path, StageKind::Coupled).unwrap();
        history.push(&row(7, 1.0)).unwrap();
        let columns = read(&path).unwrap();
        let get = |name: &str| columns.iter().find(|(n, _)| n == name).unwrap().1[0];
        assert_eq!(get("window"), 7.0);
        assert!((get("coupling_residual") - 1.0 / 3.0).abs() < 1e-9);
        assert!(get("cd").is_nan());
    }
}
