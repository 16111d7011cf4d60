//! A static stage with the coupler, followed by a transient stage.

use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

/// The static shape under a pressure, on 1 and 2 ranks, then 20 ms of transient under the same pressure: the risers carry
/// the load and nothing moves.
#[test]
fn static_stage_gives_an_equilibrium_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let times = "duration_s = 4.0\nwindow_s = 5e-3\nsubsteps = 5\nmass_damping_per_s = 5.0\nsettled_energy_ratio = 1e-6\n";
    let stages = "solve = \"static\"\n\n[[stage]]\nname = \"after\"\nkind = \"pre-inflation\"\npressure_pa = 20.4\n\
                  duration_s = 0.02\nwindow_s = 5e-3\nsubsteps = 5\n";
    let scene = changed_scene(
        "atps-uniform-pressure",
        folder.path(),
        &[(times, stages), ("across = 18", "across = 12"), ("vent = 10", "vent = 6"), ("ing = 3", "ing = 2")],
    );
    let mut loads = Vec::new();
    for ranks in ["structure=1", "structure=2"] {
        let out = folder.path().join(ranks);
        succeed(ripstop_run(&scene, &out, &["--ranks", ranks]));
        let still = History::read(&out, "pressure");
        assert_eq!(still.len(), 1);
        assert!(still.column("structure_residual")[0] <= 1e-8);
        let (load, riser) = (still.column("vertical_load_n")[0], still.column("riser_force_n")[0]);
        assert!((load / riser - 1.0).abs() < 1e-6, "{load} {riser}");
        // The Newton tolerance of the transient stage is 1e-5 of the load.
        let after = History::read(&out, "after");
        for (kinetic, strain) in
            after.column("structure_kinetic_energy_j").iter().zip(after.column("structure_strain_energy_j"))
        {
            assert!(*kinetic < 1e-8 * strain, "{kinetic} {strain}");
        }
        loads.push(load);
    }
    assert!((loads[0] / loads[1] - 1.0).abs() < 1e-7, "{loads:?}");
}
