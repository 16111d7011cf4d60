//! `history.csv`: one row per window.
//!
//! A stage has the columns of the programs that run in it. All columns except the wall times at the end of a row are
//! bitwise reproducible.

use std::path::Path;

use case::{Role, StageKind};
use channel::{flow_stats, mesh_stats, structure_stats};
use coupling::balance::SystemBalance;
use coupling::energy::InterfaceEnergyBalance;
use coupling::error::RunError;
use coupling::schemes::WindowReport;

use crate::row_file::RowFile;
use crate::wake::Sample;

/// First of the columns of wall times, which are not reproducible.
pub const FIRST_WALL_COLUMN: &str = "structure_wall_s";

/// Motion over ground of a frame that moves in all directions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Position relative to that at the start of the first coupled stage, m.
    pub position_m: [f64; 3],
    /// Velocity, m/s.
    pub velocity_m_s: [f64; 3],
    /// Velocity of the undisturbed air relative to the frame, m/s; `None` where it depends on the height.
    pub air_m_s: Option<[f64; 3]>,
}

impl Trajectory {
    /// Horizontal over vertical speed of the frame relative to the air; infinite where it does not fall.
    pub fn glide_ratio(&self) -> Option<f64> {
        self.air_m_s.map(|[x, y, z]| x.hypot(y) / z.abs())
    }
}

/// Data of a window for the history and the progress line.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Index of the window.
    pub window: u64,
    /// Time at its end, s.
    pub time_s: f64,
    /// Length of the window, s.
    pub window_s: f64,
    /// Number of rejected attempts.
    pub rejected: u32,
    /// Completed planned windows.
    pub done: u64,
    /// Report of the coupling scheme.
    pub report: WindowReport,
    /// Descent speed (downward), m/s.
    pub descent_speed_m_s: f64,
    /// Acceleration of the frame (upward), m/s2.
    pub acceleration_m_s2: f64,
    /// Motion over ground; `None` where the frame moves vertically.
    pub trajectory: Option<Trajectory>,
    /// Drag, N: of the force that the stage watches, along its direction.
    pub drag_n: f64,
    /// Drag coefficient; `None` without a reference area or at zero speed.
    pub drag_coefficient: Option<f64>,
    /// Wake of a canopy; `None` where it is not assessed.
    pub wake: Option<Sample>,
    /// Work of the air on the canopy in this window, J.
    pub interface_work_j: f64,
    /// Energy added by the coupling in this window, J.
    pub energy_error_j: f64,
    /// Both accumulated over the stage.
    pub interface_energy: InterfaceEnergyBalance,
    /// Momentum and energy of the falling system; `None` without descent.
    pub balance: Option<SystemBalance>,
    /// Wall time of the window, s.
    pub wall_s: f64,
    /// Wall time of the coupler, s.
    pub coupler_s: f64,
}

impl Row {
    /// Wall time in which the coupler waited and no program computed, s: communication, wake-up, and other load on the
    /// cores.
    pub fn waiting_s(&self) -> f64 {
        (self.wall_s - self.coupler_s - self.report.busy_s.iter().sum::<f64>()).max(0.0)
    }
}

enum Cell {
    Count(u64),
    Number(f64),
    Flag(bool),
    Nothing,
    /// Wall time, s, with four decimals.
    Wall(f64),
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Count(n) => write!(f, "{n}"),
            // Nine digits: further digits are below the tolerances of the solvers.
            Self::Number(x) if x.is_finite() => write!(f, "{x:.8e}"),
            Self::Flag(b) => write!(f, "{}", u8::from(*b)),
            // An infinite ratio is no value.
            Self::Number(_) | Self::Nothing => Ok(()),
            Self::Wall(s) => write!(f, "{s:.4}"),
        }
    }
}

/// A statistic of a program as a column.
struct Column {
    name: &'static str,
    /// Index among the statistics of the program.
    at: usize,
    is_count: bool,
}

impl Column {
    const fn count(name: &'static str, at: usize) -> Self {
        Self { name, at, is_count: true }
    }

    const fn number(name: &'static str, at: usize) -> Self {
        Self { name, at, is_count: false }
    }
}

/// Statistics of the structure.
const STRUCTURE_COLUMNS: [Column; 29] = {
    use structure_stats as s;
    [
        Column::number("structure_kinetic_energy_j", s::KINETIC_ENERGY),
        Column::number("structure_strain_energy_j", s::STRAIN_ENERGY),
        Column::number("structure_load_work_j", s::LOAD_WORK),
        Column::number("structure_work_j", s::WORK),
        Column::number("structure_work_sum_j", s::WORK_SUM),
        Column::number("structure_prescribed_work_j", s::PRESCRIBED_WORK),
        Column::number("structure_energy_created_j", s::ENERGY_CREATED),
        Column::number("structure_energy_created_sum_j", s::ENERGY_CREATED_SUM),
        Column::number("structure_energy_throughput_j", s::ENERGY_THROUGHPUT),
        Column::number("vertical_load_n", s::VERTICAL_LOAD),
        Column::number("riser_force_n", s::RISER_FORCE),
        Column::number("support_force_n", s::SUPPORT_FORCE + 2),
        Column::number("max_line_tension_n", s::MAX_LINE_TENSION),
        Column::number("max_membrane_force_n_m", s::MAX_MEMBRANE_FORCE),
        Column::number("membrane_force_99_n_m", s::MEMBRANE_FORCE_99),
        Column::number("membrane_force_over_strength", s::MEMBRANE_FORCE_OVER_STRENGTH),
        Column::number("membrane_force_over_strength_99", s::MEMBRANE_FORCE_OVER_STRENGTH_99),
        Column::number("max_hem_tape_tension_n", s::MAX_HEM_TAPE_TENSION),
        Column::number("max_seam_tape_tension_n", s::MAX_SEAM_TAPE_TENSION),
        Column::number("max_vent_tape_tension_n", s::MAX_VENT_TAPE_TENSION),
        Column::number("max_grid_tape_tension_n", s::MAX_GRID_TAPE_TENSION),
        Column::number("projected_area_m2", s::PROJECTED_AREA),
        Column::number("volume_m3", s::VOLUME),
        Column::count("structure_newton_steps", s::NEWTON_STEPS),
        Column::count("structure_gmres_iterations", s::GMRES_ITERATIONS),
        Column::count("structure_factorisations", s::FACTORISATIONS),
        Column::count("structure_step_cuts", s::STEP_CUTS),
        Column::number("structure_residual", s::RESIDUAL),
        Column::number("structure_residual_target", s::RESIDUAL_TARGET),
    ]
};

/// Statistics of the flow.
const FLOW_COLUMNS: [Column; 10] = {
    use flow_stats as s;
    [
        Column::count("flow_iterations", s::ITERATIONS),
        Column::count("flow_linear_iterations", s::LINEAR_ITERATIONS),
        Column::number("flow_residual_start", s::RESIDUAL_START),
        Column::number("flow_residual_end", s::RESIDUAL_END),
        Column::number("flow_residual_target", s::RESIDUAL_TARGET),
        Column::number("flow_max_mach", s::MAX_MACH),
        Column::number("flow_max_courant", s::MAX_COURANT),
        Column::number("flow_max_pressure_pa", s::MAX_PRESSURE),
        Column::number("flow_min_pressure_pa", s::MIN_PRESSURE),
        Column::number("flow_mass_defect_kg_s", s::MASS_DEFECT),
    ]
};

/// Statistics of the mesh.
const MESH_COLUMNS: [Column; 6] = {
    use mesh_stats as s;
    [
        Column::count("mesh_iterations", s::ITERATIONS),
        Column::count("mesh_increments", s::INCREMENTS),
        Column::number("mesh_residual", s::RESIDUAL),
        Column::number("mesh_residual_target", s::RESIDUAL_TARGET),
        Column::number("mesh_min_quality", s::MIN_QUALITY),
        Column::number("mesh_min_volume_ratio", s::MIN_VOLUME_RATIO),
    ]
};

/// A row of a stage of `kind`: names and values of its columns, in the order of the file.
fn cells(kind: StageKind, row: &Row) -> Vec<(&'static str, Cell)> {
    let has = |role: Role| kind.roles().contains(&role);
    let mut cells = vec![("window", Cell::Count(row.window)), ("time_s", Cell::Number(row.time_s))];
    if has(Role::Flow) || kind == StageKind::Trajectory {
        cells.extend(descent_cells(row));
    }
    if kind == StageKind::Coupled {
        cells.extend(coupling_cells(row));
        cells.extend(system_cells(row));
    }
    let columns: [(Role, &[Column]); 3] =
        [(Role::Structure, &STRUCTURE_COLUMNS), (Role::Flow, &FLOW_COLUMNS), (Role::Mesh, &MESH_COLUMNS)];
    for (role, columns) in columns.into_iter().filter(|(role, _)| has(*role)) {
        cells.extend(statistics_cells(&row.report.stats[role as usize].values, columns));
    }
    for (role, name, at) in [
        (Role::Structure, "structure_unconverged_solves", structure_stats::UNCONVERGED),
        (Role::Flow, "flow_unconverged_solves", flow_stats::UNCONVERGED),
    ] {
        if has(role) {
            cells.push((name, Cell::Count(row.report.sums[role as usize].values[at] as u64)));
        }
    }
    cells.extend(wall_cells(row));
    cells
}

/// Names of the columns of a stage of `kind`, in the order of the file. [`crate::columns::HISTORY`] describes them.
pub fn names(kind: StageKind) -> Vec<&'static str> {
    cells(kind, &Row::default()).into_iter().map(|(name, _)| name).collect()
}

fn descent_cells(row: &Row) -> [(&'static str, Cell); 18] {
    use Cell::{Nothing, Number};
    let force = row.report.force;
    let swing = |i: usize| row.wake.and_then(|w| w.pendulum_xy_deg).map_or(Nothing, |xy| Number(xy[i]));
    let track = |value: fn(&Trajectory) -> f64| row.trajectory.as_ref().map_or(Nothing, |t| Number(value(t)));
    [
        ("descent_speed_m_s", Number(row.descent_speed_m_s)),
        ("acceleration_m_s2", Number(row.acceleration_m_s2)),
        ("drag_n", Number(row.drag_n)),
        ("cd", row.drag_coefficient.map_or(Nothing, Number)),
        ("force_x_n", Number(force[0])),
        ("force_y_n", Number(force[1])),
        ("pendulum_angle_deg", row.wake.and_then(|w| w.pendulum_deg).map_or(Nothing, Number)),
        ("pendulum_x_deg", swing(0)),
        ("pendulum_y_deg", swing(1)),
        ("stream_diameters", row.wake.map_or(Nothing, |w| Number(w.diameters))),
        ("stream_speed_m_s", row.wake.map_or(Nothing, |w| Number(w.speed_m_s))),
        ("frame_x_m", track(|t| t.position_m[0])),
        ("frame_y_m", track(|t| t.position_m[1])),
        ("frame_z_m", track(|t| t.position_m[2])),
        ("frame_vx_m_s", track(|t| t.velocity_m_s[0])),
        ("frame_vy_m_s", track(|t| t.velocity_m_s[1])),
        ("horizontal_speed_m_s", track(|t| t.velocity_m_s[0].hypot(t.velocity_m_s[1]))),
        ("glide_ratio", track(|t| t.glide_ratio().unwrap_or(f64::NAN))),
    ]
}

fn coupling_cells(row: &Row) -> [(&'static str, Cell); 9] {
    use Cell::{Count, Flag, Nothing, Number};
    let report = &row.report;
    [
        ("coupling_iterations", Count(u64::from(report.iterations))),
        ("coupling_residual", report.residual.map_or(Nothing, Number)),
        ("coupling_converged", Flag(report.converged)),
        ("window_s", Number(row.window_s)),
        ("rejected_attempts", Count(u64::from(row.rejected))),
        ("interface_work_j", Number(row.interface_work_j)),
        ("interface_energy_error_j", Number(row.energy_error_j)),
        ("interface_energy_error_sum_j", Number(row.interface_energy.added_j)),
        ("interface_energy_error_share", Number(row.interface_energy.share())),
    ]
}

/// Momentum and energy of the falling system.
fn system_cells(row: &Row) -> [(&'static str, Cell); 4] {
    let of = |value: fn(&SystemBalance) -> f64| {
        row.balance.as_ref().map_or(Cell::Nothing, |b| Cell::Number(value(b)))
    };
    [
        ("system_missing_impulse_n_s", of(SystemBalance::missing_impulse)),
        ("system_energy_j", of(|b| b.energy_j)),
        ("system_air_work_j", of(|b| b.air_work_j)),
        ("system_energy_created_j", of(SystemBalance::created_j)),
    ]
}

fn statistics_cells(values: &[f64], columns: &[Column]) -> Vec<(&'static str, Cell)> {
    columns
        .iter()
        .map(|c| {
            let value = values[c.at];
            (c.name, if c.is_count { Cell::Count(value as u64) } else { Cell::Number(value) })
        })
        .collect()
}

/// Wall times, which differ from run to run.
fn wall_cells(row: &Row) -> [(&'static str, Cell); 6] {
    use Cell::Wall;
    let busy_s = row.report.busy_s;
    [
        (FIRST_WALL_COLUMN, Wall(busy_s[Role::Structure as usize])),
        ("flow_wall_s", Wall(busy_s[Role::Flow as usize])),
        ("mesh_wall_s", Wall(busy_s[Role::Mesh as usize])),
        ("coupler_wall_s", Wall(row.coupler_s)),
        ("waiting_wall_s", Wall(row.waiting_s())),
        ("window_wall_s", Wall(row.wall_s)),
    ]
}

/// Writer of `history.csv`, flushed after every row.
///
/// # Examples
///
/// ```
/// use case::StageKind;
/// use results::history::{History, Row, read};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("history.csv");
/// let mut history = History::create(&path, StageKind::Coupled)?;
/// for window in 0..3 {
///     history.push(&Row { window, time_s: 5e-3 * (window + 1) as f64, ..Row::default() })?;
/// }
/// let columns = read(&path)?;
/// let (_, times) = columns.iter().find(|(name, _)| name == "time_s").expect("a column");
/// assert_eq!(times, &[0.005, 0.01, 0.015]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct History {
    kind: StageKind,
    rows: RowFile,
}

impl History {
    /// Creates the file with its header line.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path, kind: StageKind) -> Result<Self, RunError> {
        Self::open(path, kind, false)
    }

    /// Creates the file, or, where the stage is `resumed`, appends to one that was truncated to the restart window.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn open(path: &Path, kind: StageKind, resumed: bool) -> Result<Self, RunError> {
        Ok(Self { kind, rows: RowFile::open(path, &names(kind).join(","), resumed)? })
    }

    /// Writes all rows to the disk, as required before a state is saved.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn sync(&self) -> Result<(), RunError> {
        self.rows.sync()
    }

    /// Adds a window.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, row: &Row) -> Result<(), RunError> {
        let texts: Vec<String> = cells(self.kind, row).iter().map(|(_, cell)| cell.to_string()).collect();
        self.rows.push(&[texts.join(",")])
    }
}

/// Writer of `iterations.csv` of a coupled stage: the residual of every coupling iteration.
pub struct Iterations(RowFile);

impl Iterations {
    /// As [`History::open`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn open(path: &Path, resumed: bool) -> Result<Self, RunError> {
        RowFile::open(path, "window,iteration,coupling_residual", resumed).map(Self)
    }

    /// Adds the iterations of a window.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, row: &Row) -> Result<(), RunError> {
        let residuals = row.report.residuals.iter().enumerate();
        let rows: Vec<String> = residuals.map(|(i, r)| format!("{},{i},{r:.3e}", row.window)).collect();
        self.0.push(&rows)
    }
}

/// Writer of `points.csv`: displacement of chosen nodes of the canopy.
pub struct Points {
    rows: RowFile,
    /// Nodes of the canopy.
    nodes: Vec<usize>,
}

impl Points {
    /// As [`History::open`]. `points`: names and nodes; `None` without a point.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn open(path: &Path, points: &[(String, usize)], resumed: bool) -> Result<Option<Self>, RunError> {
        if points.is_empty() {
            return Ok(None);
        }
        let nodes = points.iter().map(|(_, node)| *node).collect();
        let columns = points.iter().flat_map(|(name, _)| ["x", "y", "z"].map(|x| format!(",{name}_{x}_m")));
        let header = format!("time_s{}", columns.collect::<String>());
        Ok(Some(Self { rows: RowFile::open(path, &header, resumed)?, nodes }))
    }

    /// Adds the end of a window: its time (s) and the displacement of the canopy, `[nodes][3]`, m.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn push(&mut self, time: f64, displacement: &[f64]) -> Result<(), RunError> {
        let cells = self.nodes.iter().flat_map(|n| &displacement[3 * n..3 * n + 3]);
        let text: String = cells.map(|x| format!(",{x:.9e}")).collect();
        self.rows.push(&[format!("{time:.9}{text}")])
    }
}

/// Columns of a history by name; empty cells are NaN.
pub type Columns = Vec<(String, Vec<f64>)>;

/// Columns of a history file.
///
/// # Errors
/// The file cannot be read, or is not a table of numbers.
pub fn read(path: &Path) -> Result<Vec<(String, Vec<f64>)>, RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::file("read", path))?;
    parse(&text, path)
}

/// Columns of the complete rows of a history file, and whether an incomplete last line was left out: that of a stage that runs or was
/// killed. No columns for an empty file.
///
/// # Errors
/// The file cannot be read, or is not a table of numbers.
pub fn read_complete_rows(path: &Path) -> Result<(Columns, bool), RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::file("read", path))?;
    let complete = text.rfind('\n').map_or(0, |end| end + 1);
    let columns = if complete == 0 { Vec::new() } else { parse(&text[..complete], path)? };
    Ok((columns, complete < text.len()))
}

/// Columns of the text of a history file, as [`read`].
///
/// # Errors
/// The text is not a history; `path` is named in messages.
pub fn parse(text: &str, path: &Path) -> Result<Vec<(String, Vec<f64>)>, RunError> {
    let mut lines = text.lines();
    let mut columns: Vec<(String, Vec<f64>)> =
        lines.next().unwrap_or_default().split(',').map(|name| (name.to_owned(), Vec::new())).collect();
    for (at, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        if cells.len() != columns.len() {
            return Err(RunError::Input(format!(
                "{}, line {}: {} cells for {} columns; the file is damaged",
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
    fn all_columns_except_wall_times_are_bitwise_reproducible() {
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
    fn stage_has_the_columns_of_its_programs() {
        let names = |kind| cells(kind, &Row::default()).iter().map(|(n, _)| *n).collect::<Vec<_>>();
        let alone = names(StageKind::PreInflation);
        assert!(alone.contains(&"projected_area_m2") && !alone.contains(&"drag_n"));
        let flow = names(StageKind::FlowOnly);
        assert!(flow.contains(&"drag_n") && !flow.contains(&"mesh_min_quality"));
        let all = names(StageKind::Coupled);
        assert_eq!(all.iter().collect::<std::collections::BTreeSet<_>>().len(), all.len(), "duplicate names");
    }

    #[test]
    fn written_history_is_read_back() {
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
