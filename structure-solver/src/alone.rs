//! A pre-inflation stage without the coupler, for developers: the participant is
//! driven as the coupler would, and its numbers are printed.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use case::{Role, Scene, StageKind};
use channel::{Fault, Grid, Input, Participant, Window, structure_stats as stat};
use comm::Comm;

use crate::dynamics::WindowInfo;
use crate::participant::StructureSolver;

/// What to do beside running.
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
pub fn run(comm: &Comm, scene: &Scene, stage: usize, out: &Path, options: Options) -> Result<(), Fault> {
    let mut solver = StructureSolver::new(comm, scene, stage, out)?;
    let s = &scene.stages[stage];
    let pressure = match (s.kind, s.pressure_pa) {
        (StageKind::PreInflation, Some(p)) => p,
        _ => {
            return Err(Fault::new(format!(
                "stage {stage} ({}) cannot run alone: it must be of kind pre-inflation with a pressure_pa",
                s.name
            )));
        }
    };
    let canopy: Vec<f64> =
        solver.mesh().faces.iter().flat_map(|_| [pressure, 0.0, 0.0, 0.0, pressure, 0.0, 0.0, 0.0]).collect();
    let input = Input { canopy: &canopy, grid: Grid::default() };
    let mut output = vec![0.0; 3 * solver.output_rows().len()];
    let folder = case::stage_folder(out, scene, stage);
    // A static stage has no duration, and one window.
    let windows = s.windows();
    if comm.is_root() {
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
    let state = case::state_folder(out, scene, stage);
    let mut history = comm.is_root().then(|| History::create(&folder)).transpose()?;
    let start = Instant::now();
    let every = (windows / LINES).max(1);
    let mut work = 0.0;
    let mut sums = [0.0; 4];
    let mut newton = 0.0;
    let mut unconverged = 0;
    for index in 0..windows {
        let w = Window {
            index,
            substeps: u64::from(s.substeps),
            time: index as f64 * s.window_s,
            dt: s.window_s,
            ..Window::default()
        };
        let answer = solver.advance(&w, &input, &mut output);
        let answer = answer.and_then(|stats| solver.stuck().cloned().map_or(Ok(stats), Err));
        let v = match answer {
            Ok(stats) => stats.values,
            Err(fault) => {
                // What was reached stays, as a state to look at or to go on from.
                save(&mut solver, comm, &state)?;
                return Err(fault);
            }
        };
        let excess = channel::excess(Role::Structure, &v).unwrap_or(0.0);
        unconverged += u64::from(excess > 1.0);
        if excess > channel::UNCONVERGED_LIMIT {
            save(&mut solver, comm, &state)?;
            return Err(Fault::new(format!(
                "window {index} (t = {:.6} s) is not converged: residual {:.2e} of the load, {excess:.1} times its target; \
                 more substeps, or a larger structure.newton_tolerance (structure.static_tolerance) where rounding \
                 allows no less",
                w.time,
                v[stat::RESIDUAL]
            )));
        }
        solver.accept(&w)?;
        if let Some(created) = solver.energy_created(w.time + w.dt) {
            // Named as the coupler does, with what was reached to look at.
            save(&mut solver, comm, &state)?;
            return Err(Fault::new(format!("stage `{}`, window {index}: {created}", s.name)));
        }
        if let Some(history) = &mut history {
            history.push(index, (index + 1) as f64 * s.window_s, &v, &solver.info())?;
        }
        let time = (index + 1) as f64 * s.window_s;
        if options.snapshot_every > 0 && (index + 1).is_multiple_of(options.snapshot_every) {
            solver.snapshot(time, &folder)?;
        }
        work += v[stat::LOAD_WORK];
        newton += v[stat::NEWTON_STEPS];
        let counts = [stat::NEWTON_STEPS, stat::STEP_CUTS, stat::GMRES_ITERATIONS, stat::FACTORISATIONS];
        (0..4).for_each(|i| sums[i] += v[counts[i]]);
        let settled = s
            .settled_energy_ratio
            .is_some_and(|r| index > 0 && v[stat::KINETIC_ENERGY] < r * v[stat::STRAIN_ENERGY]);
        if comm.is_root() && (settled || (index + 1).is_multiple_of(every) || index + 1 == windows) {
            println!(
                "{time:8.4} {:11.4e} {:11.4e} {work:10.3e} {:8.2} {:8.2} {:8.4} {:9.4e} {:6.2} {:6} {:4} {:5} {:6} {:6.2}",
                v[stat::KINETIC_ENERGY],
                v[stat::STRAIN_ENERGY],
                v[stat::VERTICAL_LOAD],
                v[stat::RISER_FORCE],
                v[stat::PROJECTED_AREA],
                v[stat::VOLUME],
                v[stat::MAX_LINE_TENSION],
                sums[0],
                sums[1],
                sums[2],
                sums[3],
                start.elapsed().as_secs_f64()
            );
            sums = [0.0; 4];
        }
        if settled {
            break;
        }
    }
    if unconverged > 0 && comm.is_root() {
        eprintln!("warning: {unconverged} windows ended with a residual above their target");
    }
    let total = start.elapsed().as_secs_f64();
    save(&mut solver, comm, &state)?;
    if options.profile && comm.is_root() {
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
    Ok(())
}

fn save(solver: &mut StructureSolver, comm: &Comm, folder: &Path) -> Result<(), Fault> {
    if comm.is_root() {
        std::fs::create_dir_all(folder).map_err(|e| Fault::new(format!("{}: {e}", folder.display())))?;
    }
    comm.barrier();
    solver.save(folder)
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
const COLUMNS: [(&str, usize); 13] = [
    ("structure_kinetic_energy_j", stat::KINETIC_ENERGY),
    ("structure_strain_energy_j", stat::STRAIN_ENERGY),
    ("structure_load_work_j", stat::LOAD_WORK),
    ("vertical_load_n", stat::VERTICAL_LOAD),
    ("riser_force_n", stat::RISER_FORCE),
    ("max_line_tension_n", stat::MAX_LINE_TENSION),
    ("projected_area_m2", stat::PROJECTED_AREA),
    ("volume_m3", stat::VOLUME),
    ("structure_newton_steps", stat::NEWTON_STEPS),
    ("structure_gmres_iterations", stat::GMRES_ITERATIONS),
    ("structure_factorisations", stat::FACTORISATIONS),
    ("structure_step_cuts", stat::STEP_CUTS),
    ("structure_residual", stat::RESIDUAL),
];
