//! What the benches share.

use std::path::Path;
use std::rc::Rc;

use comm::Comm;
use structure_solver::assemble;
use structure_solver::dynamics::Dynamics;

/// Seconds that this thread has run, from the kernel's accounts: what a busy machine
/// disturbs least.
pub fn seconds_run() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux keeps accounts");
    let nanoseconds = text.split(' ').next().and_then(|w| w.parse::<f64>().ok());
    1e-9 * nanoseconds.expect("three numbers")
}

/// The octant of the paper's air bag (section 1.4) with 2 n^2 triangles. `settings`:
/// lines of the scene's table `[structure]`.
pub fn air_bag(n: usize, wrinkling: bool, settings: &str) -> Dynamics {
    let text = format!(
        r#"
        name = "air-bag"
        [canopy]
        kind = "air-bag"
        cells_across = {n}
        [fabric]
        youngs_modulus_pa = 206.8e6
        poisson_ratio = 0.3
        thickness_m = 3.048e-5
        density_kg_m3 = 1223.5093
        wrinkling = {wrinkling}
        [structure]
        {settings}
        [[stage]]
        name = "inflation"
        kind = "pre-inflation"
        pressure_pa = 23.94
        duration_s = 0.05
        window_s = 1e-3
        substeps = 10
        "#
    );
    let scene = case::parse(Path::new("air-bag.toml"), &text).expect("a good scene");
    let mesh = Rc::new(mesh::structure_mesh(&scene).expect("a good mesh"));
    assemble::dynamics(&Comm::solo(), &scene, 0, &mesh).expect("a good structure")
}
