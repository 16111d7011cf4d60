//! Values on the interface between canopy and flow.

use case::Scene;

use crate::interface::CanopyInterface;
use crate::schemes::unknowns::Unknowns;

/// Values on the interface at the end of the last accepted window.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct InterfaceState {
    /// Displacement of the canopy from the unstressed shape, `[nodes][3]`, m.
    pub displacement: Vec<f64>,
    /// Load of the flow, `[faces][LOAD_WIDTH]`, Pa; `None` before the first flow step.
    pub load: Option<Vec<f64>>,
    /// The same one window earlier.
    #[serde(default)]
    pub load_before: Option<Vec<f64>>,
    /// Velocity of the frame relative to the ground, m/s.
    pub velocity: [f64; 3],
    /// Mean acceleration of the frame over the window, m/s2.
    pub acceleration: [f64; 3],
    /// Position of the frame relative to that at the start of the first coupled stage, m.
    pub position: [f64; 3],
}

impl InterfaceState {
    /// Before the first stage: unstressed canopy, initial speed, no load known.
    pub fn at_start(scene: &Scene, interface: &CanopyInterface) -> Self {
        Self {
            displacement: vec![0.0; 3 * interface.nodes()],
            velocity: scene.resolved().initial_velocity_m_s,
            ..Self::default()
        }
    }

    /// The unknowns of the state; an unknown load counts as zero.
    pub fn unknowns(&self, layout: &Unknowns) -> Vec<f64> {
        let mut x = vec![0.0; layout.len()];
        layout.pack(&self.displacement, self.velocity, &mut x);
        if let Some(load) = &self.load {
            layout.pack_load(load, &mut x);
        }
        x
    }
}

/// Values on the interface at the end of a window, from the last responses of the programs.
#[derive(Clone, Debug, Default)]
pub struct InterfaceValues {
    /// Displacement from the unstressed shape, `[nodes][3]`, m.
    pub displacement: Vec<f64>,
    /// Load of the flow, `[faces][LOAD_WIDTH]`, Pa.
    pub load: Vec<f64>,
    /// Velocity of the frame, m/s.
    pub velocity: [f64; 3],
}
