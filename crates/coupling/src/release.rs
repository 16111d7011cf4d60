//! Comparison of the pre-inflation pressure with the pressure of the developed flow at the release.

use case::{Role, Scene, StageKind};

use crate::interface::CanopyInterface;
use crate::schemes::InterfaceState;

/// Largest difference of both pressures, relative to the larger one, without a warning: a canopy carries about 0.7 to
/// 1.8 times the dynamic pressure, so an estimate of it is accurate to about a half.
const PRESSURE_SHARE: f64 = 0.5;

/// Compares the pressure that inflated the canopy with that of the developed flow, at the start of the first coupled
/// stage. Returns the message and whether they differ by more than half of the larger one; `None` in other stages,
/// where no flow was developed, and for a canopy that opens from a gathered skirt, which no pressure inflated.
pub fn pressure_at_release(
    scene: &Scene,
    stage: usize,
    interface: &CanopyInterface,
    state: &InterfaceState,
) -> Option<(String, bool)> {
    let source = &scene.stages[scene.source_stage(stage, Role::Structure)?];
    let inflates = source.kind == StageKind::PreInflation && !scene.opens_gathered();
    let released = scene.stages[stage].kind == StageKind::Coupled && inflates;
    let (inflated, load) = (source.pressure_pa?, state.load.as_ref().filter(|_| released)?);
    let flow = interface.mean_pressure(load, &state.displacement)?;
    let larger = inflated.abs().max(flow.abs());
    let far = (inflated - flow).abs() > PRESSURE_SHARE * larger;
    let text = format!(
        "stage `{}`: at the release the mean pressure jump changes from {inflated:.2} Pa of stage `{}` to \
         {flow:.2} Pa of the flow{}",
        scene.stages[stage].name,
        source.name,
        if far {
            format!("; set pressure_pa to about {flow:.3}, so that the canopy starts near equilibrium")
        } else {
            String::new()
        }
    );
    Some((text, far))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn scene(change: impl Fn(&mut Scene)) -> Scene {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
        let mut scene = case::load(&file).expect("a scene of the repository");
        change(&mut scene);
        scene
    }

    #[test]
    fn release_pressures_are_compared_where_a_flow_was_developed() {
        let scene = scene(|s| s.stages[0].pressure_pa = Some(10.0));
        let interface = CanopyInterface::new(&scene).expect("a canopy");
        let state = |pressure: f64| InterfaceState {
            displacement: vec![0.0; 3 * interface.nodes()],
            load: Some([pressure, 3.0, 0.0, 0.0].repeat(interface.faces.len())),
            ..InterfaceState::default()
        };
        let compared = |stage: usize, pressure: f64| {
            pressure_at_release(&scene, stage, &interface, &state(pressure)).map(|(text, far)| (far, text))
        };
        let (far, text) = compared(2, 8.0).expect("a release");
        assert!(!far && text.contains("from 10.00 Pa of stage `pre-inflation` to 8.00 Pa"), "{text}");
        assert!(!compared(2, 19.9).expect("a release").0 && compared(2, 20.1).expect("a release").0);
        let (far, text) = compared(2, -2.0).expect("a release");
        assert!(far && text.contains("set pressure_pa to about -2.000"), "{text}");
        assert!(compared(1, 8.0).is_none(), "the flow alone");
        let unknown = InterfaceState { load: None, ..state(0.0) };
        assert!(pressure_at_release(&scene, 2, &interface, &unknown).is_none());
    }
}
