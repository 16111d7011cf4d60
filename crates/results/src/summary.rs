//! What a run came to: a table for people, `summary.json` for programs.

use std::path::Path;

use case::{Role, Stage, StageKind};
use channel::{flow_stats, mesh_stats, structure_stats};
use coupling::convergence::Convergence;
use coupling::energy::CREATED;
use coupling::error::RunError;
use coupling::partners::Usage;
use serde::{Deserialize, Serialize};
use terminal::{clock, counted};

use crate::finding::Finding;
use crate::history::Row;
use crate::timings::StageTimings;

/// Where the wall seconds of a stage went: the keys of [`StageSummary`] and their names.
pub const STAGE_PARTS: [(&str, &str); 5] = [
    ("structure_busy_s", "structure"),
    ("flow_busy_s", "flow"),
    ("mesh_busy_s", "mesh"),
    ("coupler_s", "coupler"),
    ("waiting_s", "waiting"),
];

/// What a stage came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StageSummary {
    /// Name of the stage.
    pub name: String,
    /// What ran.
    pub kind: StageKind,
    /// Windows done.
    pub windows: u64,
    /// Simulated time, s.
    pub time_s: f64,
    /// Why it ended.
    pub ended: String,
    /// Wall seconds of the windows, saves and snapshots (without launch).
    pub wall_s: f64,
    /// Wall seconds in which the structure computed.
    pub structure_busy_s: f64,
    /// Wall seconds in which the flow computed.
    pub flow_busy_s: f64,
    /// Wall seconds in which the grid motion was computed.
    pub mesh_busy_s: f64,
    /// Wall seconds of the coupler.
    pub coupler_s: f64,
    /// Wall seconds of waiting for channels and cores.
    pub waiting_s: f64,
    /// Coupling iterations over all windows.
    pub iterations: u64,
    /// Structure solves over all windows.
    pub structure_calls: u64,
    /// Flow solves over all windows.
    pub flow_calls: u64,
    /// Pseudo-time iterations of the flow over all its calls.
    pub flow_iterations: u64,
    /// Newton or explicit steps of the structure over all its calls.
    #[serde(default)]
    pub structure_steps: u64,
    /// GMRES iterations of the structure over all its calls.
    #[serde(default)]
    pub structure_linear_iterations: u64,
    /// Linear iterations of the flow over all its calls.
    #[serde(default)]
    pub flow_linear_iterations: u64,
    /// Linear iterations of the mesh over all its calls.
    #[serde(default)]
    pub mesh_iterations: u64,
    /// Processor seconds of structure, flow and mesh with all their ranks on this host, starting
    /// included. MPI waits by spinning.
    #[serde(default)]
    pub cpu_s: [f64; 3],
    /// The most memory that structure, flow and mesh held: sums over their ranks, bytes.
    #[serde(default)]
    pub peak_memory_bytes: [u64; 3],
    /// Most coupling iterations in a window.
    pub most_iterations: u32,
    /// Windows above the tolerance.
    pub not_converged: u64,
    /// What was accepted above its target, by part.
    #[serde(default)]
    pub convergence: Convergence,
    /// Rejected windows, which were retried with half their length.
    pub rejected: u64,
    /// Shortest window, s.
    pub shortest_window_s: f64,
    /// Descent speed at the end, m/s.
    pub descent_speed_m_s: f64,
    /// Mean of the descent speed over the last half of the stage, m/s.
    pub mean_descent_speed_m_s: f64,
    /// Drag at the end, N.
    pub drag_n: f64,
    /// Mean of the drag over the last half of the stage, N.
    pub mean_drag_n: f64,
    /// Energy that the coupling added, J.
    pub interface_energy_error_j: f64,
    /// Work of the air on the canopy, to and fro (the sum of its sizes over the windows), J.
    pub interface_work_j: f64,
    /// `interface_energy_error_j` over `interface_work_j`.
    pub interface_energy_error_share: f64,
    /// Energy that time integration of the structure created, J; below zero: it took energy.
    #[serde(default)]
    pub structure_energy_created_j: f64,
    /// The same over the initial energy and the sizes of all works; `None`: the structure does not report its
    /// energy balance (a static stage has none).
    #[serde(default)]
    pub structure_energy_created_share: Option<f64>,
    /// Projected area at the end, m2.
    pub projected_area_m2: f64,
    /// Vertical load on the structure at the end, N.
    pub vertical_load_n: f64,
    #[serde(skip)]
    /// Descent speed (m/s) and vertical force of the air (N) at the end of each window so far.
    pub speeds: Vec<(f64, f64)>,
}

impl StageSummary {
    /// Nothing yet.
    pub fn new(stage: &Stage) -> Self {
        Self {
            name: stage.name.clone(),
            kind: stage.kind,
            windows: 0,
            time_s: 0.0,
            ended: "complete".into(),
            wall_s: 0.0,
            structure_busy_s: 0.0,
            flow_busy_s: 0.0,
            mesh_busy_s: 0.0,
            coupler_s: 0.0,
            waiting_s: 0.0,
            iterations: 0,
            structure_calls: 0,
            flow_calls: 0,
            flow_iterations: 0,
            structure_steps: 0,
            structure_linear_iterations: 0,
            flow_linear_iterations: 0,
            mesh_iterations: 0,
            cpu_s: [0.0; 3],
            peak_memory_bytes: [0; 3],
            most_iterations: 0,
            not_converged: 0,
            convergence: Convergence::default(),
            rejected: 0,
            shortest_window_s: stage.window_s,
            descent_speed_m_s: 0.0,
            mean_descent_speed_m_s: 0.0,
            drag_n: 0.0,
            mean_drag_n: 0.0,
            interface_energy_error_j: 0.0,
            interface_work_j: 0.0,
            interface_energy_error_share: 0.0,
            structure_energy_created_j: 0.0,
            structure_energy_created_share: None,
            projected_area_m2: 0.0,
            vertical_load_n: 0.0,
            speeds: Vec::new(),
        }
    }

    /// Takes what the programs have used since they were started into account, beside what was used
    /// before a resumed stage was broken off.
    pub fn used(&mut self, used: &[(Role, Usage)]) {
        for (role, usage) in used {
            self.cpu_s[*role as usize] += usage.cpu_s;
            let peak = &mut self.peak_memory_bytes[*role as usize];
            *peak = usage.peak_bytes.max(*peak);
        }
    }

    /// Takes a window into account.
    pub fn add(&mut self, row: &Row) {
        let report = &row.report;
        self.windows += 1;
        self.time_s = row.time_s;
        self.structure_busy_s += report.busy_s[Role::Structure as usize];
        self.flow_busy_s += report.busy_s[Role::Flow as usize];
        self.mesh_busy_s += report.busy_s[Role::Mesh as usize];
        self.coupler_s += row.coupler_s;
        self.waiting_s += row.waiting_s();
        self.iterations += u64::from(report.iterations);
        self.structure_calls += report.solves[Role::Structure as usize];
        self.flow_calls += report.solves[Role::Flow as usize];
        self.flow_iterations += report.flow_iterations as u64;
        let sum = |role: Role, at: usize| report.sums[role as usize][at] as u64;
        self.structure_steps += sum(Role::Structure, structure_stats::NEWTON_STEPS);
        self.structure_linear_iterations += sum(Role::Structure, structure_stats::GMRES_ITERATIONS);
        self.flow_linear_iterations += sum(Role::Flow, flow_stats::LINEAR_ITERATIONS);
        self.mesh_iterations += sum(Role::Mesh, mesh_stats::ITERATIONS);
        self.most_iterations = self.most_iterations.max(report.iterations);
        self.not_converged += u64::from(!report.converged);
        self.shortest_window_s = self.shortest_window_s.min(row.window_s);
        self.descent_speed_m_s = row.descent_speed_m_s;
        self.drag_n = report.force[2];
        self.interface_energy_error_j = row.interface_energy.added_j;
        self.interface_work_j = row.interface_energy.work_j;
        self.interface_energy_error_share = row.interface_energy.share();
        let structure = &report.stats[Role::Structure as usize].values;
        self.structure_energy_created_j = structure[structure_stats::ENERGY_CREATED_SUM];
        self.structure_energy_created_share = coupling::structure_energy::share(structure);
        self.projected_area_m2 = structure[structure_stats::PROJECTED_AREA];
        self.vertical_load_n = structure[structure_stats::VERTICAL_LOAD];
        self.speeds.push((row.descent_speed_m_s, report.force[2]));
        let late = &self.speeds[self.speeds.len() / 2..];
        let mean = |of: fn(&(f64, f64)) -> f64| late.iter().map(of).sum::<f64>() / late.len() as f64;
        self.mean_descent_speed_m_s = mean(|s| s.0);
        self.mean_drag_n = mean(|s| s.1);
    }
}

impl StageSummary {
    /// Its row of the table: how long it took, and who spent the time.
    fn row(&self) -> String {
        let sum =
            self.structure_busy_s + self.flow_busy_s + self.mesh_busy_s + self.coupler_s + self.waiting_s;
        let share = |part: f64| format!("{:.0} %", 100.0 * part / sum.max(f64::MIN_POSITIVE));
        let iterations = if self.kind == StageKind::Coupled && self.windows > 0 {
            format!("{:.1} (<= {})", self.iterations as f64 / self.windows as f64, self.most_iterations)
        } else {
            "-".into()
        };
        format!(
            "  {:<16} {:>8} {:>9.3} {:>10} | {:>9} {:>6} {:>6} {:>8} {:>8} | {:>11}",
            self.name,
            self.windows,
            self.time_s,
            clock(self.wall_s),
            share(self.structure_busy_s),
            share(self.flow_busy_s),
            share(self.mesh_busy_s),
            share(self.coupler_s),
            share(self.waiting_s),
            iterations
        )
    }

    /// What came of it, in words: loads and areas, speeds, and how it ended.
    fn outcome(&self) -> String {
        let s = self;
        let created = coupling::structure_energy::note(s.structure_energy_created_share);
        let given_back = if s.rejected > 0 {
            format!("; {} rejected, shortest {:.2e} s", counted(s.rejected, "window"), s.shortest_window_s)
        } else {
            String::new()
        };
        match s.kind {
            StageKind::PreInflation => format!(
                "  {}: load {:.1} N, projected area {:.2} m2{created}; {}",
                s.name, s.vertical_load_n, s.projected_area_m2, s.ended
            ),
            StageKind::FlowOnly | StageKind::Prescribed => {
                format!(
                    "  {}: drag {:.1} N at {:.4} m/s{given_back}; {}",
                    s.name, s.drag_n, s.descent_speed_m_s, s.ended
                )
            }
            StageKind::Coupled => format!(
                "  {}: descent speed {:.4} m/s (mean of the last half {:.4}), drag {:.1} N (mean {:.1}), \
                 projected area {:.2} m2{created}; coupling added {:.2e} J ({:+.1} % of the work){}{}{given_back}; {}",
                s.name,
                s.descent_speed_m_s,
                s.mean_descent_speed_m_s,
                s.drag_n,
                s.mean_drag_n,
                s.projected_area_m2,
                s.interface_energy_error_j,
                100.0 * s.interface_energy_error_share,
                if s.interface_energy_error_share > CREATED { "; the coupling creates energy" } else { "" },
                if s.not_converged > 0 {
                    format!("; {} above the tolerance", counted(s.not_converged, "window"))
                } else {
                    String::new()
                },
                s.ended
            ),
        }
    }
}

/// What a run came to.
#[derive(Clone, Debug, Serialize)]
pub struct RunSummary {
    /// Name of the scene.
    pub scene: String,
    /// `complete`, or why it ended early.
    pub ended: String,
    /// Version of `ripstop`.
    pub version: &'static str,
    /// When it began, UTC.
    pub started_utc: String,
    /// The command line.
    pub command: Vec<String>,
    /// Where it ran.
    pub machine: crate::machine::Machine,
    /// Version of the contract between the programs.
    pub contract: u32,
    /// Warnings of the inspection before the run.
    pub inspection: Vec<Finding>,
    /// Warnings of the coupler, the first thousand.
    pub warnings: Vec<String>,
    /// Wall seconds of everything, launches included.
    pub wall_s: f64,
    /// Ranks of structure, flow, mesh.
    pub ranks: [u32; 3],
    /// Stages that ran (the last one perhaps in part).
    pub stages: Vec<StageSummary>,
    /// What the named parts of all programs took in the stages that this command ran.
    pub timings: Vec<StageTimings>,
}

impl RunSummary {
    /// Writes `summary.json`.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn write(&self, out: &Path) -> Result<(), RunError> {
        let path = out.join("summary.json");
        let text = serde_json::to_string_pretty(self).unwrap_or_default();
        std::fs::write(&path, text + "\n").map_err(RunError::file("write", path))
    }

    /// The table for people.
    pub fn table(&self, out: &Path) -> String {
        let mut lines = vec![format!("{}: {} in {}", self.scene, self.ended, clock(self.wall_s))];
        lines.push(format!(
            "  {:<16} {:>8} {:>9} {:>10} | {:>9} {:>6} {:>6} {:>8} {:>8} | {:>11}",
            "stage",
            "windows",
            "time s",
            "wall",
            "structure",
            "flow",
            "mesh",
            "coupler",
            "waiting",
            "iterations"
        ));
        lines.extend(self.stages.iter().map(StageSummary::row));
        lines.extend(self.stages.iter().filter(|s| s.windows > 0).map(StageSummary::outcome));
        lines.extend(self.inspection.iter().map(|f| format!("  before the run: {}", f.line())));
        lines.extend(self.warnings.iter().map(|text| format!("  warning: {text}")));
        for s in &self.stages {
            lines.extend(s.convergence.line().map(|text| format!("  {}: {text}", s.name)));
        }
        lines.push(format!("  results: {}", out.display()));
        lines.join("\n")
    }
}
