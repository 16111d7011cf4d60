//! A-priori estimate of the cost of a scene.

use case::{Integration, Role, Scene, Solve, StageKind};
use coupling::interface::CanopyInterface;

use super::cost::Counts;

/// Coupling iterations per window.
const ITERATIONS: f64 = 3.5;
/// Nonlinear iterations per flow solve.
const FLOW_ITERATIONS: f64 = 4.5;
/// Newton iterations, or explicit steps, per substep of the structure.
const STEPS: [f64; 2] = [3.0, 2.0];
/// Structure solves per coupling iteration of the default scheme.
const STRUCTURE_SOLVES: f64 = 10.0;
/// Work of a static stage or a steady flow, in windows.
const STEADY_WINDOWS: f64 = 30.0;
/// Time to start the programs of a stage, s.
const START: f64 = 0.8;

/// Wall time of a run on idle cores, s, accurate to a factor of about three.
pub fn seconds(scene: &Scene) -> f64 {
    let Ok(canopy) = CanopyInterface::new(scene) else { return f64::NAN };
    let elements = (canopy.sizes.triangles + canopy.sizes.cables) as f64;
    let cells = mesh::structure_mesh(scene)
        .and_then(|m| mesh::draft_grid(scene, &m, &canopy.coords))
        .map_or(50.0 * canopy.faces.len() as f64, |g| g.cells.len() as f64);
    let mut sum = 0.0;
    for stage in &scene.stages {
        let rest = stage.solve == Solve::Static || stage.steady.is_some();
        let count = if rest { STEADY_WINDOWS } else { stage.windows() as f64 };
        let coupled = if stage.kind == StageKind::Coupled { ITERATIONS } else { 1.0 };
        let has = |role: Role| stage.kind.roles().contains(&role);
        let mut work = Counts::default();
        if has(Role::Flow) {
            work.cell_updates = count * coupled * FLOW_ITERATIONS * cells;
        }
        if has(Role::Structure) {
            let explicit = scene.structure.integration == Integration::Explicit;
            let solves = if coupled > 1.0 { coupled * STRUCTURE_SOLVES } else { 1.0 };
            let substeps = if rest { 1.0 } else { f64::from(stage.substeps) };
            work.element_evaluations = count * solves * substeps * STEPS[usize::from(explicit)] * elements;
        }
        let ranks = if has(Role::Flow) { scene.ranks.flow } else { scene.ranks.structure };
        sum += START + work.work() / f64::from(ranks.max(1));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_have_the_right_order_of_magnitude() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases");
        let guess = |name: &str| seconds(&case::load(&file.join(name).join("scene.toml")).unwrap());
        // Measured on idle cores: 7 s and 80 s.
        let (square, atps) = (guess("square-drop"), guess("atps-descent"));
        assert!((2.0..25.0).contains(&square), "{square}");
        assert!((25.0..250.0).contains(&atps), "{atps}");
    }
}
