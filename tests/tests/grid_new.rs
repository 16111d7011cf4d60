//! Regridding during a coupled inflation from a nearly closed canopy.

use ripstop_tests::{History, changed_scene, ripstop_run, succeed};

#[test]
fn inflating_canopy_is_regridded_and_the_coupling_continues() {
    let folder = tempfile::tempdir().expect("a folder");
    // From slightly more open vents, so that regridding is due soon.
    let scene = changed_scene(
        "atps-inflation",
        folder.path(),
        &[
            ("quality_threshold = 0.3 ", "quality_threshold = 0.3\nstep = 0.5 "),
            ("duration_s = 0.2\n", "duration_s = 0.4\n"),
            ("duration_s = 0.75\n", "duration_s = 0.25\n"),
            ("[coupling]\n", "[ranks]\nflow = 1\nmesh = 1\n\n[coupling]\n"),
        ],
    );
    let out = folder.path().join("out");
    succeed(ripstop_run(&scene, &out, &[]));
    let log = std::fs::read_to_string(out.join("descent/logs/mesh.log")).expect("the mesh-mover has a log");
    println!("{log}");
    assert!(log.contains("new grid around the canopy"), "{log}");
    let history = History::read(&out, "descent");
    let quality = history.column("mesh_min_quality");
    println!("{quality:?}");
    assert_eq!(history.len(), 50);
    // The quality decreases until regridding and ends above the threshold.
    let at = quality.iter().position(|q| *q < 0.3).expect("a new grid was due");
    assert!(at < 46 && quality[at..].iter().all(|q| *q > 0.25), "{quality:?}");
    assert!(quality[49] > quality[at] + 0.05, "{quality:?}");
    // Coupling and flow continue without disturbance.
    assert!(history.column("coupling_converged").iter().all(|c| *c == 1.0));
    let area = history.column("projected_area_m2");
    assert!(area.windows(2).all(|w| (w[1] - w[0]).abs() < 0.5) && area[49] > area[0], "{area:?}");
    // Regridding conserves the mass of about 100 kg of air in the box.
    let defect = history.column("flow_mass_defect_kg_s");
    assert!(defect.iter().all(|d| d.abs() < 1e-3), "{defect:?}");
}
