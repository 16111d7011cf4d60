//! Every kind of canopy under a sudden pressure, without any damping, with every integration: no
//! run ends well with energy that time integration created, and the default creates none at all.

use std::path::Path;

use case::Scene;
use channel::{Grid, Input, Participant, Window, structure_stats as stat};
use comm::Comm;
use structure_solver::energy::Works;
use structure_solver::participant::StructureSolver;

/// A canopy that lines or a held rim keep in place.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Canopy {
    Square,
    SquareHeld,
    Circular,
    CircularHeld,
    Atps,
    AirBag,
}

impl Canopy {
    const ALL: [Self; 6] =
        [Self::Square, Self::SquareHeld, Self::Circular, Self::CircularHeld, Self::Atps, Self::AirBag];

    fn section(self) -> &'static str {
        match self {
            Self::Square => {
                "kind = \"square\"\nwidth_m = 2.0\ncells_across = 6\nline_count = 12\nline_length_m = 2.4"
            }
            Self::SquareHeld => "kind = \"square\"\nwidth_m = 2.0\ncells_across = 6\nline_count = 0",
            Self::Circular => {
                "kind = \"circular\"\nwidth_m = 2.0\ncells_across = 8\nline_count = 16\nline_length_m = 2.4"
            }
            Self::CircularHeld => "kind = \"circular\"\nwidth_m = 2.0\ncells_across = 8\nline_count = 0",
            Self::Atps => {
                "kind = \"atps\"\ncells_across = 6\ncells_along_vent = 2\ncells_along_stitching = 1"
            }
            Self::AirBag => "kind = \"air-bag\"\ncells_across = 6",
        }
    }

    fn held(self) -> bool {
        matches!(self, Self::SquareHeld | Self::CircularHeld)
    }
}

/// A run of the sweep.
#[derive(Clone, Copy, Debug)]
struct Case {
    canopy: Canopy,
    /// What the section `[structure]` says.
    integration: &'static str,
    substeps: u64,
    youngs_modulus_pa: f64,
}

const WINDOW: f64 = 5e-3;

impl Case {
    fn scene(&self) -> Scene {
        let rim = "[[stage.motion]]\nnodes = \"rim\"\ntime_s = [0.0]\ndisplacement_m = [[0.0, 0.0, 0.0]]";
        let text = format!(
            "name = \"sweep\"\n[canopy]\n{}\n[fabric]\nyoungs_modulus_pa = {}\npoisson_ratio = 0.3\n\
             thickness_m = 3.048e-5\ndensity_kg_m3 = 1223.5\nwrinkling = true\n\
             [lines]\nyoungs_modulus_pa = {}\narea_m2 = 3.11e-6\ndensity_kg_m3 = 1223.5\n\
             [structure]\n{}\n\
             [[stage]]\nname = \"blow\"\nkind = \"pre-inflation\"\npressure_pa = 20.0\nduration_s = 1.0\n\
             window_s = {WINDOW}\nsubsteps = {}\n{}\n",
            self.canopy.section(),
            self.youngs_modulus_pa,
            2.5 * self.youngs_modulus_pa,
            self.integration,
            self.substeps,
            if self.canopy.held() { rim } else { "" },
        );
        case::parse(Path::new("sweep.toml"), &text).unwrap_or_else(|e| panic!("{self:?}: {e}"))
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    /// All windows done: created over throughput, and the most that one window created beyond the
    /// work of the forces left out of balance, over the throughput then.
    Complete { share: f64, unexplained: f64 },
    /// The energy error, after so many windows.
    Energy(u64),
    /// Another error in words.
    Failed,
}

/// Runs `windows` windows as the program does.
fn run(case: &Case, windows: u64) -> End {
    let scene = case.scene();
    let out = tempfile::tempdir().expect("a folder");
    let mut solver = StructureSolver::new(&Comm::solo(), &scene, 0, out.path())
        .unwrap_or_else(|e| panic!("{case:?}: {e}"));
    let load = [20.0, 0.0, 0.0, 0.0].repeat(2 * solver.mesh().faces.len());
    let mut output = vec![0.0; 3 * solver.output_rows().len()];
    let (mut share, mut unexplained) = (0.0, f64::NEG_INFINITY);
    for index in 0..windows {
        let time = index as f64 * WINDOW;
        let w = Window { index, substeps: case.substeps, time, dt: WINDOW, ..Window::default() };
        let input = Input { canopy: &load, grid: Grid::default() };
        let Ok(stats) = solver.advance(&w, &input, &mut output) else { return End::Failed };
        if solver.stuck().is_some() {
            return End::Failed;
        }
        if solver.energy_created(time + WINDOW).is_some() {
            return End::Energy(index);
        }
        solver.accept(&w).expect("accepted");
        let v = stats.values;
        let throughput = v[stat::ENERGY_THROUGHPUT];
        let residual = solver.info().works.0[Works::RESIDUAL];
        share = v[stat::ENERGY_CREATED_SUM] / throughput;
        unexplained = unexplained.max((v[stat::ENERGY_CREATED] - residual) / throughput);
    }
    End::Complete { share, unexplained }
}

const DEFAULT: &str = "";
/// Some numerical damping: measured to create nothing, but not proven.
const DAMPED: &str = "spectral_radius = 0.9";
const NEWMARK: &str = "integration = \"newmark\"";
const EXPLICIT: &str = "integration = \"explicit\"";

/// Runs all combinations, prints a line of counts for each integration, and asserts what must hold.
fn sweep(integrations: &[&'static str], substeps: &[u64], moduli: &[f64], windows: u64) {
    for &integration in integrations {
        let (mut complete, mut energy, mut failed) = (0, 0, 0);
        let (mut most, mut unexplained) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for canopy in Canopy::ALL {
            for &youngs_modulus_pa in moduli {
                for &substeps in substeps {
                    let case = Case { canopy, integration, substeps, youngs_modulus_pa };
                    let end = run(&case, windows);
                    if std::env::var_os("RIPSTOP_SWEEP_LIST").is_some() {
                        println!("{case:?}: {end:?}");
                    }
                    match end {
                        End::Complete { share, unexplained: u } => {
                            complete += 1;
                            most = most.max(share);
                            unexplained = unexplained.max(u);
                            assert!(share <= structure_solver::energy::STAGE_SHARE, "{case:?}: {share}");
                        }
                        End::Energy(_) => energy += 1,
                        End::Failed => failed += 1,
                    }
                }
            }
        }
        println!(
            "[{integration}] {complete} complete, {energy} with the energy error, {failed} failed otherwise; created at \
             most {most:+.2e} of the throughput, {unexplained:+.1e} in a window beyond what Newton's method left"
        );
        if integration == DEFAULT {
            assert_eq!((energy, failed), (0, 0), "the default integration");
            // Rounding of energies that are sums over thousands of elements.
            assert!(unexplained < 1e-11, "{unexplained}");
            assert!(most < 1e-4, "{most}");
        }
    }
}

#[test]
fn no_run_ends_well_with_energy_from_nowhere() {
    sweep(&[DEFAULT, NEWMARK, EXPLICIT], &[1, 5], &[2e7, 2e9], 20);
}

/// All combinations.
#[test]
#[ignore = "nightly: 6 minutes, 384 runs"]
fn no_run_ends_well_with_energy_from_nowhere_full() {
    sweep(&[DEFAULT, DAMPED, NEWMARK, EXPLICIT], &[1, 5, 20, 50], &[2e6, 2e7, 2e8, 2e9], 40);
}

/// A run as the program does it: the scene of the issue, whose energy grew from a few joules to
/// 359 kJ with Newmark's method and ended as complete. Now it ends with an error that names stage,
/// window, time, figures and remedy, and the default ends well.
#[test]
fn newmark_ends_with_an_error_in_words_and_the_default_does_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = |integration: &str| {
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/../cases/square-drop/scene.toml");
        let scene = std::fs::read_to_string(source).expect("a scene");
        let kept = "[structure]\nspectral_radius = 0.9\n";
        assert!(scene.contains(kept));
        scene.replace(kept, integration).replace("duration_s = 1.0", "duration_s = 0.25")
    };
    for (name, integration) in [("newmark", "[structure]\nintegration = \"newmark\"\n"), ("default", "")] {
        let file = folder.path().join(format!("{name}.toml"));
        std::fs::write(&file, text(integration)).expect("written");
        let run = std::process::Command::new(env!("CARGO_BIN_EXE_structure-solver"))
            .args(["alone", "--scene"])
            .arg(&file)
            .arg("--out")
            .arg(folder.path().join(name))
            .output()
            .expect("the program starts");
        let words = String::from_utf8_lossy(&run.stderr);
        if name == "default" {
            assert!(run.status.success(), "{words}");
            continue;
        }
        assert_eq!(run.status.code(), Some(1), "{words}");
        println!("{}", words.trim());
        for part in
            ["stage `pre-inflation`, window", "creates energy", "kinetic", "t = ", "generalized-alpha"]
        {
            assert!(words.contains(part), "{part}: {words}");
        }
    }
}

/// Sums of works go on to the bit where a stage is resumed in its middle.
#[test]
fn a_resumed_stage_has_the_same_energy_balance() {
    let case = Case { canopy: Canopy::Square, integration: DEFAULT, substeps: 5, youngs_modulus_pa: 2e8 };
    let (scene, out) = (case.scene(), tempfile::tempdir().expect("a folder"));
    let state = out.path().join("kept");
    std::fs::create_dir_all(&state).expect("a folder");
    let mut solver = StructureSolver::new(&Comm::solo(), &scene, 0, out.path()).expect("a structure");
    let load = [20.0, 0.0, 0.0, 0.0].repeat(2 * solver.mesh().faces.len());
    let mut output = vec![0.0; 3 * solver.output_rows().len()];
    let mut go = |solver: &mut StructureSolver, index: u64| {
        let time = index as f64 * WINDOW;
        let w = Window { index, substeps: 5, time, dt: WINDOW, ..Window::default() };
        let stats = solver.advance(&w, &Input { canopy: &load, grid: Grid::default() }, &mut output);
        solver.accept(&w).expect("accepted");
        let v = stats.expect("an answer").values;
        [stat::WORK, stat::ENERGY_CREATED, stat::WORK_SUM, stat::ENERGY_CREATED_SUM, stat::ENERGY_THROUGHPUT]
            .map(|at| v[at].to_bits())
    };
    for index in 0..3 {
        go(&mut solver, index);
    }
    solver.save(&state).expect("saved");
    let straight: Vec<_> = (3..6).map(|index| go(&mut solver, index)).collect();
    let mut resumed =
        StructureSolver::resumed(&Comm::solo(), &scene, 0, out.path(), &state).expect("a state");
    let again: Vec<_> = (3..6).map(|index| go(&mut resumed, index)).collect();
    assert_eq!(straight, again);
}
