//! Summary of a run: a table for the terminal and `summary.json`.

use std::path::Path;

use case::{Role, Scene, Stage, StageKind};
use channel::{flow_stats, mesh_stats, structure_stats};
use coupling::convergence::Convergence;
use coupling::energy::InterfaceEnergyBalance;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use coupling::partners::Usage;
use serde::{Deserialize, Serialize};
use terminal::{clock, counted};

use crate::alternation::Alternation;
use crate::finding::Finding;
use crate::forced_oscillation::ForcedOscillation;
use crate::history::Row;
use crate::opening::{Opening, OpeningReference};
use crate::rank_advice::{self, RankAdvice};
use crate::settled::SettledMean;
use crate::strength::SafetyFactor;
use crate::timings::StageTimings;
use crate::wake::{Sample, Wake};

/// Parts of the wall time of a stage: keys of [`StageSummary`] and their names.
pub const STAGE_PARTS: [(&str, &str); 5] = [
    ("structure_busy_s", "structure"),
    ("flow_busy_s", "flow"),
    ("mesh_busy_s", "mesh"),
    ("coupler_s", "coupler"),
    ("waiting_s", "waiting"),
];

/// `ended` of a run or stage that is complete.
pub const COMPLETE: &str = "complete";
/// `ended` of a run that runs, or was killed.
pub const RUNNING: &str = "running";

/// Summary of a stage.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StageSummary {
    /// Name of the stage.
    pub name: String,
    /// Kind of the stage.
    pub kind: StageKind,
    /// Whether a message deviates from the baseline of the run.
    #[serde(skip)]
    pub deviates: bool,
    /// Completed windows.
    pub windows: u64,
    /// Simulated time, s.
    pub time_s: f64,
    /// `complete`, or the reason of an early end.
    pub ended: String,
    /// Wall time of windows, saves and snapshots, without launch, s.
    pub wall_s: f64,
    /// Computing time of the structure, s.
    pub structure_busy_s: f64,
    /// Computing time of the flow, s.
    pub flow_busy_s: f64,
    /// Computing time of the mesh, s.
    pub mesh_busy_s: f64,
    /// Wall time of the coupler, s.
    pub coupler_s: f64,
    /// Wall time of waiting for messages and cores, s.
    pub waiting_s: f64,
    /// Of structure, flow and mesh, within their computing time: mean over the ranks of the time in which they waited for each
    /// other and for their messages, s. 0: one rank, or not reported.
    #[serde(default)]
    pub rank_waiting_s: [f64; 3],
    /// Numbers of ranks on which the stage is expected to be faster; `None` where none gains 5 % or it was not assessed: below
    /// 10 s, after a restart within the stage, on several hosts.
    #[serde(default)]
    pub rank_advice: Option<RankAdvice>,
    /// Coupling iterations over all windows.
    pub iterations: u64,
    /// Structure solves over all windows.
    #[serde(alias = "structure_calls")]
    pub structure_solves: u64,
    /// Flow solves over all windows.
    #[serde(alias = "flow_calls")]
    pub flow_solves: u64,
    /// Nonlinear iterations over all flow solves.
    pub flow_iterations: u64,
    /// Newton iterations or explicit steps over all structure solves.
    #[serde(default)]
    pub structure_steps: u64,
    /// GMRES iterations over all structure solves.
    #[serde(default)]
    pub structure_linear_iterations: u64,
    /// Linear iterations over all flow solves.
    #[serde(default)]
    pub flow_linear_iterations: u64,
    /// Linear iterations over all mesh solves.
    #[serde(default)]
    pub mesh_iterations: u64,
    /// Processor time of structure, flow and mesh, s: all ranks on this host, including start-up and the busy waiting of
    /// MPI.
    #[serde(default)]
    pub cpu_s: [f64; 3],
    /// Peak memory of structure, flow and mesh, summed over their ranks, bytes.
    #[serde(default)]
    pub peak_memory_bytes: [u64; 3],
    /// Maximum number of coupling iterations of a window.
    pub most_iterations: u32,
    /// Windows that did not converge.
    pub not_converged: u64,
    /// Solves accepted above their target, by program part.
    #[serde(default)]
    pub convergence: Convergence,
    /// Rejected windows, which were retried with half their length.
    pub rejected: u64,
    /// Changes of the longest window allowed, because the coupling created energy or did so no longer.
    #[serde(default)]
    pub length_changes: u64,
    /// Shortest window, s.
    pub shortest_window_s: f64,
    /// Descent speed at the end, m/s.
    pub descent_speed_m_s: f64,
    /// Mean of the descent speed over the last half of the stage, m/s.
    pub mean_descent_speed_m_s: f64,
    /// Surfaces whose drag it is: `canopy`, or as `flow.forces.watch` names them.
    #[serde(default = "canopy")]
    pub drag_of: String,
    /// Drag at the end, N.
    pub drag_n: f64,
    /// Mean of the drag over the last half of the stage, N.
    pub mean_drag_n: f64,
    /// Energy added by the coupling, J.
    pub interface_energy_error_j: f64,
    /// Work of the air on the canopy: sum of the magnitudes over the windows, J.
    pub interface_work_j: f64,
    /// Energy added by the coupling relative to that work.
    pub interface_energy_error_share: f64,
    /// Energy added by the time integration of the structure, J; negative values are dissipation.
    #[serde(default)]
    pub structure_energy_created_j: f64,
    /// The same relative to the initial energy and the magnitudes of all works; `None` if the structure reports no energy
    /// balance (as in a static stage).
    #[serde(default)]
    pub structure_energy_created_share: Option<f64>,
    /// Largest local Mach number of the flow; 0 without a flow.
    #[serde(default)]
    pub largest_local_mach: f64,
    /// Of an immersed canopy: largest mean speed of air through airtight cloth, over the speed of stream and canopy.
    #[serde(default)]
    pub largest_leakage_share: Option<f64>,
    /// Wake of the canopy over the last half of the windows; `None` where it is not assessed.
    #[serde(default)]
    pub wake: Option<Wake>,
    /// Settled means of the quantities of `history.csv`; empty in a stage without a flow and in one with fewer than 40 windows.
    #[serde(default)]
    pub settled: Vec<SettledMean>,
    /// Line stretch, filling and largest force of a canopy that opens in the stage; `None` in any other stage.
    #[serde(default)]
    pub opening: Option<Opening>,
    /// Stability derivatives of a body whose rotation oscillates as prescribed; `None` in any other stage.
    #[serde(default)]
    pub forced_oscillation: Option<ForcedOscillation>,
    /// Alternation of the drag from window to window; coupled stages of 40 windows or more.
    #[serde(default)]
    pub alternating_load: Option<Alternation>,
    /// Safety factors of fabric, lines and risers, where the scene has their strength.
    #[serde(default)]
    pub safety_factors: Vec<SafetyFactor>,
    /// Projected area at the end, m2.
    pub projected_area_m2: f64,
    /// Vertical load on the structure at the end, N.
    pub vertical_load_n: f64,
    /// Largest tension of a line at the end, N.
    #[serde(default)]
    pub max_line_tension_n: f64,
    #[serde(skip)]
    /// Descent speed (m/s) and vertical force of the air (N) at the end of each window so far.
    pub speeds: Vec<(f64, f64)>,
    #[serde(skip)]
    /// Wake at the end of each window so far.
    pub wake_samples: Vec<Sample>,
}

/// Force of the air over dynamic pressure and nominal area below which a canopy carries no load.
const UNLOADED: f64 = 1e-4;
/// Check of the table that this is.
const UNLOADED_CHECK: &str = "flow.unloaded-canopy";

/// Solves of the structure for each flow solve above which those against the surrogate are most of them.
const MANY_SOLVES: f64 = 4.0;

fn canopy() -> String {
    case::WatchedForce::Canopy.name().into()
}

/// The drag in words: of the canopy with `decimals`; of other surfaces, which may be small, with their name and four
/// decimals.
pub(crate) fn drag(of: &str, drag_n: f64, decimals: usize) -> String {
    if of == case::WatchedForce::Canopy.name() {
        format!("drag {drag_n:.decimals$} N")
    } else {
        format!("drag of {of} {drag_n:.4} N")
    }
}

impl StageSummary {
    /// Summary before the first window.
    pub fn new(stage: &Stage) -> Self {
        Self {
            name: stage.name.clone(),
            kind: stage.kind,
            deviates: false,
            windows: 0,
            time_s: 0.0,
            ended: COMPLETE.into(),
            wall_s: 0.0,
            structure_busy_s: 0.0,
            flow_busy_s: 0.0,
            mesh_busy_s: 0.0,
            coupler_s: 0.0,
            waiting_s: 0.0,
            rank_waiting_s: [0.0; 3],
            rank_advice: None,
            iterations: 0,
            structure_solves: 0,
            flow_solves: 0,
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
            length_changes: 0,
            shortest_window_s: stage.window_s,
            descent_speed_m_s: 0.0,
            mean_descent_speed_m_s: 0.0,
            drag_of: canopy(),
            drag_n: 0.0,
            mean_drag_n: 0.0,
            interface_energy_error_j: 0.0,
            interface_work_j: 0.0,
            interface_energy_error_share: 0.0,
            structure_energy_created_j: 0.0,
            structure_energy_created_share: None,
            largest_local_mach: 0.0,
            largest_leakage_share: None,
            alternating_load: None,
            wake: None,
            settled: Vec::new(),
            opening: None,
            forced_oscillation: None,
            safety_factors: Vec::new(),
            projected_area_m2: 0.0,
            vertical_load_n: 0.0,
            max_line_tension_n: 0.0,
            speeds: Vec::new(),
            wake_samples: Vec::new(),
        }
    }

    /// Adds the processor time and memory of the programs since their start. After a restart, the summary already
    /// contains those of the earlier part.
    pub fn used(&mut self, used: &[(Role, Usage)]) {
        for (role, usage) in used {
            self.cpu_s[*role as usize] += usage.cpu_s;
            let peak = &mut self.peak_memory_bytes[*role as usize];
            *peak = usage.peak_bytes.max(*peak);
        }
    }

    /// Evaluates the wake, the settled means, the opening and the safety factors over the windows so far, all but the wake from the history file of the stage. A
    /// history that cannot be read leaves them out: it is not needed for the run.
    pub fn assess(&mut self, history: &Path, scene: &Scene, interface: &CanopyInterface) {
        self.wake = Wake::of(&self.wake_samples);
        self.alternating_load =
            Alternation::of(&self.wake_samples).filter(|_| self.kind == StageKind::Coupled);
        let Ok((columns, _)) = crate::history::read_complete_rows(history) else { return };
        self.safety_factors = SafetyFactor::of(scene, interface.sizes.risers, &columns);
        if !self.kind.roles().contains(&Role::Flow) {
            return;
        }
        self.settled = SettledMean::all(&columns);
        let stage = scene.stages.iter().position(|s| s.name == self.name);
        self.forced_oscillation = stage
            .zip(history.parent())
            .and_then(|(stage, folder)| ForcedOscillation::of(scene, stage, folder));
        if self.kind == StageKind::Coupled {
            let reference = OpeningReference::of(scene, interface);
            self.opening = reference.and_then(|r| Opening::of_history(&columns, &r));
        }
    }

    /// The warning of an immersed canopy on which the air of the last window exerts no force: what a stage that follows starts from.
    pub fn unloaded_canopy(&self, scene: &Scene, interface: &CanopyInterface) -> Option<String> {
        scene.flow.as_ref().filter(|f| f.is_immersed())?;
        let reference = OpeningReference::of(scene, interface)?;
        let last = self.wake_samples.last()?;
        let force = last.drag_n.hypot(last.side_n[0]).hypot(last.side_n[1]);
        let scale = 0.5 * reference.density_kg_m3 * last.speed_m_s.powi(2) * reference.nominal_area_m2;
        (force < UNLOADED * scale).then(|| {
            format!(
                "end of stage `{}`: the air of {:.3} m/s exerts {force:.3e} N on the canopy, below 1e-4 of dynamic pressure and nominal area \
                 ({scale:.3e} N) [{UNLOADED_CHECK}]. Likely cause: a gathered or folded canopy that is narrower than a cell is a tube that the \
                 stream passes. Remedies: a smaller flow.immersed.spacing_m, or a wider start (a longer reefing line, a higher pressure)",
                self.name, last.speed_m_s
            )
        })
    }

    /// What to change where the solves of the structure against the surrogate of the flow take most of the time, in words.
    fn structure_cost(&self) -> Option<String> {
        let (structure, flow) = (self.structure_solves as f64, self.flow_solves as f64);
        let share = self.structure_busy_s / self.wall_s;
        let inner = self.kind == StageKind::Coupled && structure > MANY_SOLVES * flow;
        (inner && self.structure_busy_s > self.flow_busy_s && share > 0.5).then(|| {
            format!(
                "  {}: the structure took {:.0} % of the wall time in {:.1} solves for each flow solve; coupling.acceleration = \"iqn-ils\" has one (for short windows)",
                self.name,
                100.0 * share,
                structure / flow
            )
        })
    }

    /// Computing time of a program, s.
    pub fn busy_s(&self, role: Role) -> f64 {
        [self.structure_busy_s, self.flow_busy_s, self.mesh_busy_s][role as usize]
    }

    /// Solves of a program; those of the mesh are counted as those of the flow, before each of which it moves the grid.
    pub fn solves(&self, role: Role) -> u64 {
        [self.structure_solves, self.flow_solves, self.flow_solves][role as usize]
    }

    /// Stability derivatives in words.
    fn oscillation_lines(&self) -> impl Iterator<Item = String> + '_ {
        let lines = self.forced_oscillation.iter().flat_map(ForcedOscillation::lines);
        lines.map(|line| format!("  {}: {line}", self.name))
    }

    /// Settled means in words: of descent speed and drag, or of the drag where the stage prescribes the speed.
    fn settled_lines(&self) -> impl Iterator<Item = String> + '_ {
        let shown: &[&str] = match self.kind {
            StageKind::Coupled => &["descent_speed_m_s", "drag_n"],
            _ => &["drag_n"],
        };
        let means = self.settled.iter().filter(|m| shown.contains(&m.quantity.as_str()));
        means.map(|m| format!("  {}: {} of {}", self.name, m.kind(), m.line()))
    }

    /// Adds a window.
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
        self.structure_solves += report.solves[Role::Structure as usize];
        self.flow_solves += report.solves[Role::Flow as usize];
        self.flow_iterations += report.flow_iterations as u64;
        let sum = |role: Role, at: usize| report.sums[role as usize].values[at] as u64;
        for (waiting, sums) in self.rank_waiting_s.iter_mut().zip(&report.sums) {
            // At the same index for all roles.
            *waiting += sums.values[flow_stats::WAITED_S];
        }
        self.structure_steps += sum(Role::Structure, structure_stats::NEWTON_STEPS);
        self.structure_linear_iterations += sum(Role::Structure, structure_stats::GMRES_ITERATIONS);
        self.flow_linear_iterations += sum(Role::Flow, flow_stats::LINEAR_ITERATIONS);
        self.mesh_iterations += sum(Role::Mesh, mesh_stats::ITERATIONS);
        self.most_iterations = self.most_iterations.max(report.iterations);
        self.not_converged += u64::from(!report.converged);
        self.shortest_window_s = self.shortest_window_s.min(row.window_s);
        self.descent_speed_m_s = row.descent_speed_m_s;
        self.drag_n = row.drag_n;
        self.interface_energy_error_j = row.interface_energy.added_j;
        self.interface_work_j = row.interface_energy.work_j;
        self.interface_energy_error_share = row.interface_energy.share();
        let structure = &report.stats[Role::Structure as usize].values;
        self.structure_energy_created_j = structure[structure_stats::ENERGY_CREATED_SUM];
        self.structure_energy_created_share = coupling::structure_energy::share(structure);
        let mach = report.stats[Role::Flow as usize].values[flow_stats::MAX_MACH];
        self.largest_local_mach = self.largest_local_mach.max(mach);
        self.projected_area_m2 = structure[structure_stats::PROJECTED_AREA];
        self.vertical_load_n = structure[structure_stats::VERTICAL_LOAD];
        self.max_line_tension_n = structure[structure_stats::MAX_LINE_TENSION];
        self.wake_samples.extend(row.wake);
        self.speeds.push((row.descent_speed_m_s, row.drag_n));
        let late = &self.speeds[self.speeds.len() / 2..];
        let mean = |of: fn(&(f64, f64)) -> f64| late.iter().map(of).sum::<f64>() / late.len() as f64;
        self.mean_descent_speed_m_s = mean(|s| s.0);
        self.mean_drag_n = mean(|s| s.1);
    }
}

impl StageSummary {
    /// Row of the table: wall time and shares of the programs.
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

    /// Windows that were rejected or shortened, in words.
    fn adapted(&self) -> String {
        let mut text = String::new();
        if self.rejected > 0 {
            text += &format!("; {} rejected", counted(self.rejected, "window"));
        }
        if self.length_changes > 0 {
            let changes = counted(self.length_changes, "change");
            text += &format!("; {changes} of the window length by the energy that the coupling creates");
        }
        if !text.is_empty() {
            text += &format!(", shortest {:.2e} s", self.shortest_window_s);
        }
        text
    }

    /// Results in words: loads, areas, speeds, and the reason of the end.
    fn outcome(&self) -> String {
        let s = self;
        let created = coupling::structure_energy::note(s.structure_energy_created_share);
        let rejected = self.adapted();
        match s.kind {
            // Cables alone.
            StageKind::PreInflation if s.projected_area_m2 == 0.0 => {
                let tension = s.max_line_tension_n;
                format!("  {}: largest line tension {tension:.1} N{created}; {}", s.name, s.ended)
            }
            StageKind::PreInflation => format!(
                "  {}: load {:.1} N, projected area {:.2} m2{created}; {}",
                s.name, s.vertical_load_n, s.projected_area_m2, s.ended
            ),
            StageKind::FlowOnly | StageKind::Prescribed => {
                let drag = drag(&s.drag_of, s.drag_n, 1);
                // A frame at rest has no sign.
                let speed = s.descent_speed_m_s + 0.0;
                format!("  {}: {drag} at {speed:.4} m/s{rejected}; {}", s.name, s.ended)
            }
            StageKind::Trajectory => {
                format!("  {}: descent speed {:.4} m/s at the end; {}", s.name, s.descent_speed_m_s, s.ended)
            }
            StageKind::Coupled => format!(
                "  {}: {}drag {:.1} N (mean of the last half {:.1}), projected area {:.2} m2{created}; interface energy error {:.2e} J ({:+.1} % of the work){}{}{rejected}; {}",
                s.name,
                // A frame at rest has no speed.
                match [s.descent_speed_m_s, s.mean_descent_speed_m_s] {
                    [0.0, 0.0] => String::new(),
                    [end, mean] => format!("descent speed {end:.4} m/s (mean of the last half {mean:.4}), "),
                },
                s.drag_n,
                s.mean_drag_n,
                s.projected_area_m2,
                s.interface_energy_error_j,
                100.0 * s.interface_energy_error_share,
                InterfaceEnergyBalance::exceeded(s.interface_energy_error_share)
                    .map_or_else(String::new, |(done, _)| format!("; the coupling has {done} energy")),
                if s.not_converged > 0 {
                    format!("; {} not converged", counted(s.not_converged, "window"))
                } else {
                    String::new()
                },
                s.ended
            ),
        }
    }
}

/// Summary of a run.
#[derive(Clone, Debug, Serialize)]
pub struct RunSummary {
    /// Name of the scene.
    pub scene: String,
    /// `complete`, `running` (also of a run that was killed), or the reason of an early end.
    pub ended: String,
    /// Exit code of the run; `None` while it is running and after it was killed.
    pub exit_code: Option<u8>,
    /// Version of `ripstop`.
    pub version: &'static str,
    /// Commit of the sources of the programs, with a note if sources were changed since; `unknown` outside the repository.
    pub commit: String,
    /// Start time, UTC.
    pub started_utc: String,
    /// The command line.
    pub command: Vec<String>,
    /// Machine of the coupler.
    pub machine: crate::machine::Machine,
    /// Version of the contract between the programs.
    pub contract: u32,
    /// Warnings of the inspection before the run.
    pub inspection: Vec<Finding>,
    /// Warnings of the coupler, the first thousand.
    pub warnings: Vec<String>,
    /// Wall time of the run, including launches, s.
    pub wall_s: f64,
    /// Ranks of structure, flow, mesh.
    pub ranks: [u32; 3],
    /// Stages that ran; the last one may be incomplete.
    pub stages: Vec<StageSummary>,
    /// Timings of the parts of all programs, for the stages that this command ran.
    pub timings: Vec<StageTimings>,
}

impl RunSummary {
    /// Writes `summary.json`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), RunError> {
        let path = out.join("summary.json");
        let text = serde_json::to_string_pretty(self).unwrap_or_default() + "\n";
        archive::write_whole(&path, &[text.as_bytes()]).map_err(RunError::file("write", path))
    }

    /// The smallest safety factor of each part in words; none where the scene has no strength.
    fn smallest_safety_factors(&self) -> impl Iterator<Item = String> {
        let of_stage = |s: &'_ StageSummary| {
            let name = s.name.clone();
            s.safety_factors.clone().into_iter().map(move |f| (name.clone(), f))
        };
        let all = self.stages.iter().flat_map(of_stage);
        SafetyFactor::smallest(all)
            .into_iter()
            .map(|(stage, least)| format!("  {stage}: smallest {}", least.line()))
    }

    /// The table for the terminal.
    pub fn table(&self, out: &Path) -> String {
        let mut lines = vec![format!("{}: {} in {}", self.scene, self.ended, clock(self.wall_s))];
        lines.push(format!(
            "  {:<16} {:>8} {:>9} {:>10} | {:>9} {:>6} {:>6} {:>8} {:>8} | {:>11}",
            "stage",
            "windows",
            "time, s",
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
        lines.extend(self.stages.iter().flat_map(StageSummary::settled_lines));
        let wakes = self.stages.iter().filter_map(|s| Some(format!("  {}: {}", s.name, s.wake?.line())));
        lines.extend(wakes);
        let openings =
            self.stages.iter().filter_map(|s| Some(format!("  {}: {}", s.name, s.opening?.line())));
        lines.extend(openings);
        lines.extend(self.stages.iter().flat_map(StageSummary::oscillation_lines));
        lines.extend(self.smallest_safety_factors());
        lines.extend(self.stages.iter().filter_map(StageSummary::structure_cost));
        let ranks = self.stages.iter().filter_map(|s| rank_advice::line(s, self.ranks));
        lines.extend(ranks.map(|line| format!("  {line}")));
        lines.extend(self.inspection.iter().map(|f| format!("  before the run: {}", f.line())));
        lines.extend(self.warnings.iter().map(|text| format!("  warning: {text}")));
        for s in &self.stages {
            lines.extend(s.convergence.line().map(|text| format!("  {}: {text}", s.name)));
        }
        lines.push(format!("  results: {}", out.display()));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A force of 1 N on 0.5 x 1.225 kg/m3 x (20 m/s)^2 x 57.1 m2 = 14 kN is none; 2 N are one, as is 1 N at 10 m/s; fitted grids are not judged.
    #[test]
    fn canopy_without_a_load_is_warned_of() {
        let text = include_str!("../../../cases/flat-circular-opening/scene.toml");
        let parse = |text: &str| case::parse(Path::new("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"));
        let scene = parse(&text.replace("density_kg_m3 = 1.0 ", "density_kg_m3 = 1.225 "));
        let canopy = CanopyInterface::new(&scene).expect("a canopy");
        let of = |drag_n: f64, side: f64, speed_m_s: f64| {
            let sample = Sample { drag_n, side_n: [side, 0.0], speed_m_s, ..Sample::default() };
            StageSummary {
                wake_samples: vec![Sample::default(), sample],
                ..StageSummary::new(&scene.stages[1])
            }
        };
        let text = of(1.0, 0.0, 20.0).unloaded_canopy(&scene, &canopy).expect("a warning");
        assert!(text.starts_with("end of stage `stream`: the air of 20.000 m/s exerts 1.000e0 N"), "{text}");
        for loaded in [of(2.0, 0.0, 20.0), of(0.0, 2.0, 20.0), of(1.0, 0.0, 10.0), of(0.0, 0.0, 0.0)] {
            assert_eq!(loaded.unloaded_canopy(&scene, &canopy), None);
        }
        let fitted = parse(include_str!("../../../cases/atps-descent/scene.toml"));
        assert_eq!(of(0.0, 0.0, 20.0).unloaded_canopy(&fitted, &canopy), None);
    }

    /// 76 % of 100 s in 14 solves for each flow solve; fewer solves, a costlier flow or another kind of stage say nothing.
    #[test]
    fn costly_solves_of_the_structure_are_named_with_the_remedy() {
        let scene = include_str!("../../../cases/atps-descent/scene.toml");
        let scene = case::parse(Path::new("scene.toml"), scene).unwrap_or_else(|e| panic!("{e}"));
        let stage = scene.stages.iter().find(|s| s.kind == StageKind::Coupled).expect("a coupled stage");
        let costly = StageSummary {
            wall_s: 100.0,
            structure_busy_s: 76.0,
            flow_busy_s: 10.0,
            structure_solves: 1400,
            flow_solves: 100,
            ..StageSummary::new(stage)
        };
        let text = costly.structure_cost().expect("advice");
        assert!(
            text.contains("76 % of the wall time in 14.0 solves") && text.contains("\"iqn-ils\""),
            "{text}"
        );
        let others = [
            StageSummary { structure_solves: 400, ..costly.clone() },
            StageSummary { flow_busy_s: 77.0, ..costly.clone() },
            StageSummary { structure_busy_s: 49.0, ..costly.clone() },
            StageSummary { kind: StageKind::FlowOnly, ..costly },
        ];
        assert!(others.iter().all(|s| s.structure_cost().is_none()));
    }
}
