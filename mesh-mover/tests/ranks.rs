//! One, two and three ranks move the grid in the same way. This program starts itself under `mpirun`; each run writes
//! its state to a file, in the order of the grid.

mod common;
#[path = "../../tests/src/harness.rs"]
mod harness;

use std::path::Path;
use std::process::{Command, ExitCode};

use case::{MeshMotion, Role};
use channel::Participant;
use comm::Comm;
use common::{MoverFixture, window};
use mesh_mover::state::State;

const MARK: &str = "RIPSTOP_MOVER_RANKS";
/// Tighter than in production: the arithmetic is compared, not the tolerance.
const TOLERANCE: f64 = 1e-7;
const WINDOWS: u64 = 3;

fn settings() -> MeshMotion {
    MeshMotion { tolerance: TOLERANCE, outer_boundary: case::OuterBoundary::Sliding, ..MeshMotion::default() }
}

fn main() -> ExitCode {
    match std::env::var(MARK) {
        Ok(folder) => child(Path::new(&folder)),
        Err(_) => harness::run(&[("grids_do_not_depend_on_the_rank_count", &|| compare().unwrap())]),
    }
}

/// Three windows, saved; then the state of another rank count is loaded.
fn child(folder: &Path) -> ExitCode {
    let comm = Comm::init(None).expect("MPI starts");
    let mut fixture = MoverFixture::new(&comm, &settings(), None);
    let rows = comm.all_gather_var(&fixture.mover.output_rows());
    let mut sorted = rows.clone();
    sorted.sort_unstable();
    assert!(sorted.iter().copied().eq(0..fixture.grid.coords.len() as u64), "each node has one owner");
    for index in 0..WINDOWS {
        let d = fixture.displacement(0.7 * (index + 1) as f64);
        let stats = fixture.advance(&window(index, 0), &d).unwrap();
        fixture.mover.accept(&window(index, 0)).unwrap();
        assert!(fixture.output.iter().all(|v| v.is_finite()));
        let same = comm.all_gather_var(&stats.values);
        assert!(same.chunks(stats.values.len()).all(|v| v == stats.values), "statistics are global");
    }
    // As in a run, the folder exists before any rank saves.
    let states = folder.join(comm.size().to_string());
    std::fs::create_dir_all(&states).unwrap();
    comm.barrier();
    fixture.mover.save(&states).unwrap();
    // A failed motion is an error on every rank, not a deadlock.
    let far: Vec<f64> = fixture.displacement(1.0).iter().map(|d| d + 3.0).collect();
    fixture.advance(&window(WINDOWS, 0), &far).unwrap();
    let fault = fixture.mover.failure().expect("such a motion fails");
    assert!(fault.message.contains("nearest canopy node"), "{fault}");
    comm.barrier();
    if comm.size() > 1 {
        let nodes = fixture.grid.coords.len();
        let one = State::load(&case::state_file(&folder.join("1"), Role::Mesh), nodes).unwrap();
        let here = MoverFixture::new(&comm, &settings(), Some(one));
        assert!(here.mover.positions().canopy == fixture.mover.positions().canopy);
    }
    ExitCode::SUCCESS
}

fn compare() -> Result<(), String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let nodes = mesh_mover::example_grid::plate_in_box(8, 0.1, 0.8, true).coords.len();
    let mut states = Vec::new();
    for ranks in 1..=3 {
        let me = std::env::current_exe().map_err(|e| e.to_string())?;
        let output = Command::new("mpirun")
            .args(["-n", &ranks.to_string()])
            .arg(me)
            .env(MARK, folder.path())
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
            .env("OMPI_MCA_hwloc_base_binding_policy", "none")
            .env("OMPI_MCA_mpi_yield_when_idle", "1")
            .output()
            .map_err(|e| format!("mpirun does not start: {e}"))?;
        if !output.status.success() {
            return Err(format!("{ranks} ranks failed: {}", String::from_utf8_lossy(&output.stderr)));
        }
        let path = case::state_file(&folder.path().join(ranks.to_string()), Role::Mesh);
        states.push(State::load(&path, nodes).map_err(|e| e.to_string())?);
    }
    for (ranks, state) in (2..).zip(&states[1..]) {
        let max_difference =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (now, before) =
            (max_difference(&states[0].now, &state.now), max_difference(&states[0].before, &state.before));
        println!("{ranks} ranks: positions differ by {now:.1e} and {before:.1e} m");
        // The solver's tolerance relative to an edge (0.07 m at most), estimated by block Jacobi, which
        // underestimates smooth errors; matrices in single precision.
        if now.max(before) > 2e-6 {
            return Err(format!("{ranks} ranks disagree with one: {now:e}, {before:e}"));
        }
    }
    Ok(())
}
