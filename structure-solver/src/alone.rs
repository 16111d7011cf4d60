//! A pre-inflation stage without the coupler, for developers: the participant is
//! driven as the coupler would, and its numbers are printed.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use case::{Role, Scene, Stage, StageKind};
use channel::{Fault, Grid, Input, Participant, STATS, Window, structure_stats as stat};
use comm::Comm;

use crate::dynamics::WindowInfo;
use crate::participant::StructureSolver;

/// Tasks other than running.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Prints where the time went.
    pub profile: bool,
    /// Windows between snapshots. 0: none.
    pub snapshot_every: u64,
}

/// Lines of the table.
const LINES: u64 = 40;

/// Runs stage `stage` of `scene`, prints a table on rank 0 and saves the state
/// below `out`.
///
/// # Errors
/// A stage that cannot run alone, a window that fails or does not converge, energy that time
/// integration creates, a file that cannot be written.
pub fn run(comm: &Comm, scene: &Scene, stage: usize, out: &Path, options: Options) -> Result<(), Fault> {
    let mut run = StageRun::open(comm, scene, stage, out, options)?;
    for index in 0..run.windows {
        let values = run.step(index)?;
        run.record(index, &values)?;
        let settled = run.settled(index, &values);
        run.table.add(run.comm, run.end_of(index), &values, settled || run.prints(index));
        if settled {
            break;
        }
    }
    run.close()
}

/// A stage on its way.
struct StageRun<'a> {
    comm: &'a Comm,
    stage: &'a Stage,
    options: Options,
    solver: StructureSolver,
    /// Load of each face, constant.
    canopy: Vec<f64>,
    output: Vec<f64>,
    windows: u64,
    /// Where pictures go.
    folder: PathBuf,
    /// Where the state goes.
    state: PathBuf,
    /// On rank 0.
    history: Option<History>,
    table: Table,
    /// Windows that ended with a residual above their target.
    unconverged: u64,
}

impl<'a> StageRun<'a> {
    fn open(
        comm: &'a Comm,
        scene: &'a Scene,
        stage: usize,
        out: &Path,
        options: Options,
    ) -> Result<Self, Fault> {
        let solver = StructureSolver::new(comm, scene, stage, out)?;
        let s = &scene.stages[stage];
        let (StageKind::PreInflation, Some(pressure)) = (s.kind, s.pressure_pa) else {
            return Err(Fault::new(format!(
                "stage {stage} ({}) cannot run alone: it must be of kind pre-inflation with a pressure_pa",
                s.name
            )));
        };
        let face = [pressure, 0.0, 0.0, 0.0, pressure, 0.0, 0.0, 0.0];
        if comm.is_root() {
            print_structure(&solver);
        }
        let folder = case::stage_folder(out, scene, stage);
        Ok(Self {
            comm,
            stage: s,
            options,
            canopy: face.repeat(solver.mesh().faces.len()),
            output: vec![0.0; 3 * solver.output_rows().len()],
            solver,
            // A static stage has no duration, and one window.
            windows: s.windows(),
            history: comm.is_root().then(|| History::create(&folder)).transpose()?,
            folder,
            state: case::state_folder(out, scene, stage),
            table: Table::new(),
            unconverged: 0,
        })
    }

    /// Time at the end of window `index`, s.
    fn end_of(&self, index: u64) -> f64 {
        (index + 1) as f64 * self.stage.window_s
    }

    /// Computes window `index` and accepts it; its statistics.
    fn step(&mut self, index: u64) -> Result<[f64; STATS], Fault> {
        let w = Window {
            index,
            substeps: u64::from(self.stage.substeps),
            time: index as f64 * self.stage.window_s,
            dt: self.stage.window_s,
            ..Window::default()
        };
        let values = match self.converged(&w) {
            Ok(values) => values,
            Err(fault) => return self.fail(fault),
        };
        self.solver.accept(&w)?;
        if let Some(created) = self.solver.energy_created(w.time + w.dt) {
            // Named as the coupler does.
            let name = &self.stage.name;
            return self.fail(Fault::new(format!("stage `{name}`, window {index}: {created}")));
        }
        Ok(values)
    }

    /// Computes a window, which must come close to its target.
    fn converged(&mut self, w: &Window) -> Result<[f64; STATS], Fault> {
        let input = Input { canopy: &self.canopy, grid: Grid::default() };
        let v = self.solver.advance(w, &input, &mut self.output)?.values;
        if let Some(stuck) = self.solver.stuck() {
            return Err(stuck.clone());
        }
        let excess = channel::excess(Role::Structure, &v).unwrap_or(0.0);
        self.unconverged += u64::from(excess > 1.0);
        if excess > channel::UNCONVERGED_LIMIT {
            return Err(Fault::new(format!(
                "window {} (t = {:.6} s) is not converged: residual {:.2e} relative to the load, {excess:.1} times its target; \
                 more substeps, or a larger structure.newton_tolerance (structure.static_tolerance) where rounding \
                 allows no less",
                w.index,
                w.time,
                v[stat::RESIDUAL]
            )));
        }
        Ok(v)
    }

    /// Ends with `fault`; what was reached stays, as a state to look at or to continue from.
    fn fail<T>(&mut self, fault: Fault) -> Result<T, Fault> {
        self.save()?;
        Err(fault)
    }

    /// Writes the row of the history and the picture of window `index`.
    fn record(&mut self, index: u64, values: &[f64]) -> Result<(), Fault> {
        let time = self.end_of(index);
        if let Some(history) = &mut self.history {
            history.push(index, time, values, &self.solver.info())?;
        }
        let every = self.options.snapshot_every;
        if every > 0 && (index + 1).is_multiple_of(every) {
            self.solver.snapshot(time, &self.folder)?;
        }
        Ok(())
    }

    /// Whether the motion has died down so far that the stage may end.
    fn settled(&self, index: u64, v: &[f64]) -> bool {
        let ratio = self.stage.settled_energy_ratio;
        ratio.is_some_and(|r| index > 0 && v[stat::KINETIC_ENERGY] < r * v[stat::STRAIN_ENERGY])
    }

    /// Whether window `index` has a row in the table.
    fn prints(&self, index: u64) -> bool {
        let every = (self.windows / LINES).max(1);
        (index + 1).is_multiple_of(every) || index + 1 == self.windows
    }

    fn close(mut self) -> Result<(), Fault> {
        if self.unconverged > 0 && self.comm.is_root() {
            eprintln!("warning: {} windows ended with a residual above their target", self.unconverged);
        }
        let total = self.table.start.elapsed().as_secs_f64();
        self.save()?;
        if self.options.profile && self.comm.is_root() {
            print_profile(&self.solver, self.comm, total, self.table.newton);
        }
        Ok(())
    }

    fn save(&mut self) -> Result<(), Fault> {
        if self.comm.is_root() {
            let folder = &self.state;
            std::fs::create_dir_all(folder).map_err(|e| Fault::new(format!("{}: {e}", folder.display())))?;
        }
        self.comm.barrier();
        self.solver.save(&self.state)
    }
}

/// Prints the size of the structure and the titles of the table.
fn print_structure(solver: &StructureSolver) {
    let m = solver.mesh();
    println!("# {} nodes, {} triangles, {} cables", m.coords.len(), m.triangles.len(), m.cables.len());
    if let Some(e) = solver.explicit() {
        println!(
            "# explicit: highest frequency {:.3e} rad/s, steps of at most {:.2e} s (column newton counts them)",
            e.frequency,
            e.safety * e.stable_step()
        );
    }
    println!(
        "#    t s   kinetic J    strain J     work J   load N  riser N  area m2 volume m3 line N newton cuts gmres factor wall s"
    );
}

/// Prints where the `total` seconds of `newton` steps went.
fn print_profile(solver: &StructureSolver, comm: &Comm, total: f64, newton: f64) {
    let c = solver.linear_cost();
    let (rounds, elimination) = solver.eliminations();
    let assembly = solver.assembly_s();
    let rest = total - assembly - c.factorisation_s - c.solve_s - elimination;
    let share = |s: f64| 100.0 * s / total;
    println!(
        "# {total:.3} s on rank 0, {newton} {} of {:.3} ms",
        if solver.explicit().is_some() { "explicit steps" } else { "Newton steps" },
        1e3 * total / newton.max(1.0)
    );
    println!(
        "# assembly {:.1} %, factorisation {:.1} % ({} times), GMRES {:.1} % ({} iterations), \
         elimination of nodes {:.1} % ({rounds} rounds), rest {:.1} %; \
         in all of these {:.1} % communication and waiting for other ranks",
        share(assembly),
        share(c.factorisation_s),
        c.factorisations,
        share(c.solve_s),
        c.iterations,
        share(elimination),
        share(rest),
        share(comm.waited_s())
    );
}

/// The printed table: a row for some windows, with the costs since the row before.
struct Table {
    start: Instant,
    /// Work of the load so far, J.
    work: f64,
    /// Newton steps so far.
    newton: f64,
    /// Newton steps, cuts, GMRES iterations and factorisations since the last row.
    costs: [f64; 4],
}

impl Table {
    fn new() -> Self {
        Self { start: Instant::now(), work: 0.0, newton: 0.0, costs: [0.0; 4] }
    }

    /// Adds a window with the statistics `v` that ends at `time` (s), and prints a row on rank 0.
    fn add(&mut self, comm: &Comm, time: f64, v: &[f64], print: bool) {
        self.work += v[stat::LOAD_WORK];
        self.newton += v[stat::NEWTON_STEPS];
        let counts = [stat::NEWTON_STEPS, stat::STEP_CUTS, stat::GMRES_ITERATIONS, stat::FACTORISATIONS];
        self.costs.iter_mut().zip(counts).for_each(|(sum, count)| *sum += v[count]);
        if !(print && comm.is_root()) {
            return;
        }
        let [newton, cuts, gmres, factorisations] = std::mem::take(&mut self.costs);
        println!(
            "{time:8.4} {:11.4e} {:11.4e} {:10.3e} {:8.2} {:8.2} {:8.4} {:9.4e} {:6.2} {newton:6} {cuts:4} {gmres:5} {factorisations:6} {:6.2}",
            v[stat::KINETIC_ENERGY],
            v[stat::STRAIN_ENERGY],
            self.work,
            v[stat::VERTICAL_LOAD],
            v[stat::RISER_FORCE],
            v[stat::PROJECTED_AREA],
            v[stat::VOLUME],
            v[stat::MAX_LINE_TENSION],
            self.start.elapsed().as_secs_f64()
        );
    }
}

/// `history.csv` of a stage: a row for each window, flushed as it comes.
struct History {
    path: PathBuf,
    file: File,
}

impl History {
    fn create(folder: &Path) -> Result<Self, Fault> {
        let path = folder.join("history.csv");
        let bad = |e: std::io::Error| Fault::new(format!("{}: {e}", path.display()));
        std::fs::create_dir_all(folder).map_err(bad)?;
        let mut file = File::create(&path).map_err(bad)?;
        let names: Vec<&str> = COLUMNS.iter().map(|(name, _)| *name).collect();
        writeln!(file, "window,time_s,{},damping_work_j", names.join(",")).map_err(bad)?;
        Ok(Self { path, file })
    }

    fn push(&mut self, window: u64, time: f64, values: &[f64], info: &WindowInfo) -> Result<(), Fault> {
        let cells: Vec<String> = COLUMNS.iter().map(|&(_, at)| format!("{:.8e}", values[at])).collect();
        writeln!(self.file, "{window},{time:.8e},{},{:.8e}", cells.join(","), info.damping_work)
            .map_err(|e| Fault::new(format!("{}: {e}", self.path.display())))
    }
}

/// Columns of the history that are statistics of the participant. Works are those of
/// the window.
const COLUMNS: [(&str, usize); 19] = [
    ("structure_kinetic_energy_j", stat::KINETIC_ENERGY),
    ("structure_strain_energy_j", stat::STRAIN_ENERGY),
    ("structure_load_work_j", stat::LOAD_WORK),
    ("vertical_load_n", stat::VERTICAL_LOAD),
    ("riser_force_n", stat::RISER_FORCE),
    ("max_line_tension_n", stat::MAX_LINE_TENSION),
    ("max_membrane_force_n_m", stat::MAX_MEMBRANE_FORCE),
    ("membrane_force_99_n_m", stat::MEMBRANE_FORCE_99),
    ("max_hem_tape_tension_n", stat::MAX_HEM_TAPE_TENSION),
    ("max_seam_tape_tension_n", stat::MAX_SEAM_TAPE_TENSION),
    ("max_vent_tape_tension_n", stat::MAX_VENT_TAPE_TENSION),
    ("max_grid_tape_tension_n", stat::MAX_GRID_TAPE_TENSION),
    ("projected_area_m2", stat::PROJECTED_AREA),
    ("volume_m3", stat::VOLUME),
    ("structure_newton_steps", stat::NEWTON_STEPS),
    ("structure_gmres_iterations", stat::GMRES_ITERATIONS),
    ("structure_factorisations", stat::FACTORISATIONS),
    ("structure_step_cuts", stat::STEP_CUTS),
    ("structure_residual", stat::RESIDUAL),
];
