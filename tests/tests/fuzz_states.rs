//! Fuzzing of saved states and warm-start data with corrected checksums: no panic, no excessive memory, no value that is
//! not finite, and an error that names the file.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use case::{Role, Scene};
use channel::Participant;
use comm::Comm;
use ripstop_tests::spoil::{
    FLOOR, Measured, Random, SHARE, fuzz, inputs, kept, measured, slot, spoilt_anywhere,
};
use ripstop_tests::tiny::SMALLER;
use ripstop_tests::{changed_scene, ripstop_run, succeed};

#[global_allocator]
static ALLOCATOR: Measured = Measured;

#[test]
fn states_of_the_coupler() {
    let folder = tempfile::tempdir_in("/dev/shm").expect("a folder");
    let state = coupling::schemes::InterfaceState {
        displacement: (0..18).map(f64::from).collect(),
        load: Some(vec![2.0; 16]),
        load_before: Some(vec![1.5; 16]),
        velocity: [0.5, 0.0, -4.0],
        acceleration: [0.0, 0.1, 0.2],
        position: [1.0, 2.0, -30.0],
    };
    results::state::save(folder.path(), &state).expect("saved");
    let file = results::state::coupler_file(folder.path());
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let state = results::state::load(folder.path(), 6, 4).map_err(|e| e.to_string())?;
        let loads = [&state.load, &state.load_before].into_iter().flatten();
        assert!(loads.clone().all(|l| l.len() == 16), "loads of another canopy");
        let all = state.displacement.iter().chain(loads.flatten());
        assert!(
            all.chain([state.velocity, state.acceleration, state.position].as_flattened())
                .all(|x| x.is_finite()),
            "NaN enters"
        );
        Ok(())
    };
    fuzz("coupler state", &[good], sealed, &mut read, "coupler.bin");
}

#[test]
fn states_of_the_mesh() {
    let (_folder, file) = slot();
    let numbers: Vec<f64> = (0..30).map(f64::from).collect();
    let state = mesh_mover::state::State {
        now: numbers.clone(),
        before: numbers.clone(),
        reference: numbers,
        dt: 0.1,
        ..mesh_mover::state::State::default()
    };
    state.save(&file).expect("saved");
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        mesh_mover::state::State::load(&file, 10).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("mesh state", &[good], sealed, &mut read, "spoilt");
}

/// Corrects length and checksum of an archive.
#[allow(clippy::ptr_arg)] // common signature of mutations, which may change the length
fn sealed(bytes: &mut Vec<u8>) {
    if bytes.len() < archive::HEAD {
        return;
    }
    let (head, body) = bytes.split_at_mut(archive::HEAD);
    head[12..20].copy_from_slice(&(body.len() as u64).to_le_bytes());
    head[20..28].copy_from_slice(&archive::hash::checksum(body).to_le_bytes());
}

/// A completed descent with one rank per program and all options that have warm-start data.
struct CompletedRun {
    folder: tempfile::TempDir,
    scene: Scene,
}

impl CompletedRun {
    fn once() -> &'static Self {
        static COMPLETED: OnceLock<CompletedRun> = OnceLock::new();
        COMPLETED.get_or_init(|| {
            let folder = tempfile::tempdir_in("/dev/shm").expect("a folder");
            let more = "wrinkling = true\n[fabric.contact]\ndistance_m = 0.003\n[flow.viscosity]\n\
                        dynamic_viscosity_pa_s = 1.8e-5\nturbulence = \"spalart-allmaras\"\n\
                        [[flow.probe]]\nname = \"near\"\nposition_m = [0.3, 0.2, 0.1]\n[flow.statistics]\n";
            let own = [
                ("wrinkling = true\n", more),
                ("substeps = 10", "substeps = 1"),
                ("youngs_modulus_pa = 2e8", "youngs_modulus_pa = 2e10"),
            ];
            let changes = [&own[..], &SMALLER[..]].concat();
            let file = changed_scene("square-drop", folder.path(), &changes);
            let ranks = ["--quiet", "--ranks", "structure=1,mesh=1,flow=1"];
            succeed(ripstop_run(&file, &folder.path().join("out"), &ranks));
            let scene = case::load(&file).expect("a good scene");
            CompletedRun { folder, scene }
        })
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// A copy of the state after the descent, for mutation.
    fn state(&self) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir_in("/dev/shm").expect("a folder");
        let state = folder.path().join("state");
        std::fs::create_dir(&state).expect("a folder");
        for file in std::fs::read_dir(self.out().join("descent/state")).expect("a state").flatten() {
            std::fs::copy(file.path(), state.join(file.file_name())).expect("a copy");
        }
        (folder, state)
    }

    /// The program of `role` on one rank, restarted from the state in `folder`.
    fn resumed(&self, role: Role, folder: &Path) -> Result<Box<dyn Participant>, String> {
        let (out, comm) = (self.out(), Comm::solo());
        let result = match role {
            Role::Structure => {
                use structure_solver::participant::StructureSolver;
                StructureSolver::resumed(&comm, &self.scene, 2, &out, folder).map(|p| Box::new(p) as Box<_>)
            }
            Role::Mesh => {
                use mesh_mover::participant::MeshMover;
                MeshMover::resumed(&self.scene, 2, &out, folder, &comm).map(|p| Box::new(p) as Box<_>)
            }
            Role::Flow => flow_solver::setup::Setup::new(self.scene.clone(), 2, &out)
                .and_then(|setup| flow_solver::participant(&setup.resume(folder), &comm)),
        };
        result.map_err(|e| e.message)
    }
}

/// Mutates each file of the state of a program, with corrected checksums: the program restarts from it or reports the
/// file and the error, and accepts finite values only.
fn states_of(role: Role, more: &[&str]) {
    let flown = CompletedRun::once();
    let (_folder, state) = flown.state();
    let memory = channel::warm_start_file(&state, role, 0, 1);
    let mut files = vec![case::state_file(&state, role), memory];
    files.extend(more.iter().map(|name| state.join(name)));
    flown.resumed(role, &state).unwrap_or_else(|e| panic!("a good state is refused: {e}"));
    // Each input starts a program, so few inputs take as long as all inputs of another format.
    let few = (inputs() / 200).max(20);
    let mut r = Random(0x57a7e ^ role as u64);
    for file in files {
        let name = file.file_name().expect("a name").to_string_lossy().into_owned();
        let good = std::fs::read(&file).expect("a file of the state");
        // Memory of a start from valid files.
        let (_, usual) = measured(|| flown.resumed(role, &state).map(drop));
        let mut refused = 0;
        for i in 0..few {
            let mut bytes = spoilt_anywhere(&good, &mut r);
            if r.below(8) > 0 {
                sealed(&mut bytes);
            }
            std::fs::write(&file, &bytes).expect("written");
            let (result, largest) = measured(|| flown.resumed(role, &state).map(drop));
            let told = || kept(&name, i, &bytes);
            match result {
                None => panic!("{name}: input {i} panics: {}", told()),
                Some(Err(message)) => {
                    refused += 1;
                    // Plausible but wrong values are reported as errors of the resulting grid or fabric.
                    let placed =
                        message.contains(&name) || message.contains("cell") || message.contains("grid");
                    assert!(placed, "{name}: input {i} ({}): no place in: {message}", told());
                }
                Some(Ok(())) => {}
            }
            let most = usual.max(FLOOR) + SHARE * bytes.len();
            assert!(largest <= most, "{name}: input {i} takes a block of {largest}: {}", told());
        }
        std::fs::write(&file, &good).expect("written");
        println!("{name}: {few} inputs, {refused} refused, none panicked");
        assert!(refused * 20 > few, "{name}: only {refused} refused: are inputs spoilt at all?");
    }
}

#[test]
fn damaged_structure_states_are_read_or_refused() {
    states_of(Role::Structure, &[]);
}

#[test]
fn damaged_mesh_states_are_read_or_refused() {
    states_of(Role::Mesh, &[]);
}

#[test]
fn damaged_flow_states_are_read_or_refused() {
    states_of(Role::Flow, &["flow-statistics.bin"]);
}

/// The files alone, with as many inputs as for other formats.
#[test]
fn damaged_state_files_are_read_or_refused() {
    let flown = CompletedRun::once();
    let (_state, good) = flown.state();
    let (_folder, file) = slot();
    let whole = |name: &str| std::fs::read(good.join(name)).expect("a file of the state");
    let structure = mesh::structure_mesh(&flown.scene).expect("a canopy");
    let setup = flow_solver::setup::Setup::new(flown.scene.clone(), 2, &flown.out()).expect("a grid");
    let totals = (setup.grid.cells.len(), setup.grid.coords.len());
    let comm = Comm::solo();
    let topology = setup.topology(&comm, true).expect("a part of the grid");

    let mut flow = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let state = flow_solver::state::load::<4>(&file, &topology, totals).map_err(|e| e.message)?;
        let q = state.previous.iter().flat_map(|p| p.q.as_flattened().iter().chain(p.nodes.iter().flatten()));
        assert!(q.chain([&state.last_dt]).all(|x| x.is_finite()), "NaN enters");
        Ok(())
    };
    fuzz("flow state", &[whole("flow.bin")], sealed, &mut flow, "spoilt");

    let nodes = structure.coords.len();
    let memory = structure_solver::warm_start::WarmStart::read;
    let mut shape = structure_solver::warm_start::Dimensions { numbers: 3 * nodes, loops: 0, blocks: 0 };
    let good_memory: structure_solver::warm_start::WarmStart =
        archive::load(&good.join("structure-memory-0-of-1.bin"), *b"ripstmem", 1).expect("a memory");
    shape.loops = good_memory.loops.len();
    shape.blocks = good_memory.linear.direct.as_ref().map_or(0, |d| d.matrix.len());
    assert!(shape.blocks > 0, "no factors were kept: what is tried here?");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        memory(&file, shape).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("structure memory", &[whole("structure-memory-0-of-1.bin")], sealed, &mut read, "spoilt");

    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        mesh_mover::warm_start::read(&file).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("mesh memory", &[whole("mesh-memory-0-of-1.bin")], sealed, &mut read, "spoilt");

    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        flow_solver::warm_start::RankWarmStart::read(&file, &topology).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("flow memory", &[whole("flow-memory-0-of-1.bin")], sealed, &mut read, "spoilt");
}
