//! The pressure that inflated the canopy beside that of the flow.

use case::{Role, Scene, StageKind};

use crate::interface::CanopyInterface;
use crate::schemes::InterfaceState;

/// Most of the larger pressure that may be missing in the smaller one at the release without a warning: a
/// canopy carries about 0.7 to 1.8 times the dynamic pressure, so that an estimate of it lies within a half.
const PRESSURE_SHARE: f64 = 0.5;

/// The pressure that inflated the canopy beside that of the developed flow, at the start of the first coupled
/// stage, and whether they are far apart. `None` in other stages, and where no flow was developed.
pub fn pressure_at_release(
    scene: &Scene,
    stage: usize,
    interface: &CanopyInterface,
    state: &InterfaceState,
) -> Option<(String, bool)> {
    let source = &scene.stages[scene.source_stage(stage, Role::Structure)?];
    let released = scene.stages[stage].kind == StageKind::Coupled && source.kind == StageKind::PreInflation;
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
            format!(": set pressure_pa near {flow:.3}, so that the canopy is not released out of balance")
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
    fn the_pressure_at_the_release_is_compared_where_a_flow_was_developed() {
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
        assert!(far && text.contains("set pressure_pa near -2.000"), "{text}");
        assert!(compared(1, 8.0).is_none(), "the flow alone");
        let unknown = InterfaceState { load: None, ..state(0.0) };
        assert!(pressure_at_release(&scene, 2, &interface, &unknown).is_none());
    }
}
