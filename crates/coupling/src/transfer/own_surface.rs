//! The surface of a structure that has its own, as the coupler keeps it during a stage.

use std::path::{Path, PathBuf};

use channel::LOAD_WIDTH;

use super::surface::Surface;
use super::surface_transfer::Transfer;
use crate::geometry::Vec3;
use crate::interface::CanopyInterface;
use crate::partners::LoadOverWindow;

/// Where a structure that announces [`channel::OWN_SURFACE`] has put its surface by then.
pub fn surface_file(stage_folder: &Path) -> PathBuf {
    stage_folder.join("structure-surface.json")
}

/// Between the canopy and a structure's own surface. Loads go by the shapes at the end of the last accepted
/// window, so that a window's answer depends on its question alone.
pub struct OwnSurface {
    transfer: Transfer,
    /// Displacements at the end of the last accepted window, and of the last answer, m.
    accepted: [Vec<f64>; 2],
    answer: Vec<f64>,
    loads: [Vec<f64>; 2],
}

impl OwnSurface {
    /// From the `text` of the file in which the structure of a stage left its surface ([`surface_file`]).
    ///
    /// # Errors
    /// A text that holds no surface of this canopy, in words.
    pub fn parse(text: &str, canopy: &CanopyInterface) -> Result<Self, String> {
        let own: Surface = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let mut answer = vec![0.0; 3 * own.nodes.len()];
        if !own.displacement.is_empty() {
            if own.displacement.len() != answer.len() || own.displacement.iter().any(|d| !d.is_finite()) {
                return Err(format!("its displacement must be {} finite numbers", answer.len()));
            }
            answer.copy_from_slice(&own.displacement);
        }
        let nodes = canopy.coords.iter().map(|x| Vec3::from(*x).into()).collect();
        let scene = Surface { nodes, faces: canopy.faces.clone(), ..Surface::default() };
        let faces = LOAD_WIDTH * own.faces.len();
        let mut moved = vec![0.0; 3 * scene.nodes.len()];
        let transfer = Transfer::new(scene, own).map_err(|e| e.to_string())?;
        transfer.motion(&answer, &mut moved);
        Ok(Self {
            transfer,
            accepted: [answer.clone(), moved],
            answer,
            loads: [vec![0.0; faces], vec![0.0; faces]],
        })
    }

    /// Nodes and faces.
    pub fn sizes(&self) -> [usize; 2] {
        self.transfer.own_sizes()
    }

    /// The load that the structure feels in the place of the canopy's.
    pub fn load(&mut self, load: LoadOverWindow<'_>) {
        let [own, canopy] = &self.accepted;
        for (from, to) in [load.start, load.end].into_iter().zip(&mut self.loads) {
            self.transfer.load(own, canopy, from, to);
        }
    }

    /// What [`OwnSurface::load`] made, at the start and the end of the window, and room for the answer.
    pub fn exchange(&mut self) -> ([&[f64]; 2], &mut [f64]) {
        let [start, end] = &self.loads;
        ([start, end], &mut self.answer)
    }

    /// The canopy's displacement under the structure's last answer.
    pub fn motion(&self, canopy: &mut [f64]) {
        self.transfer.motion(&self.answer, canopy);
    }

    /// The last answer is accepted.
    pub fn accept(&mut self) {
        let [own, canopy] = &mut self.accepted;
        own.copy_from_slice(&self.answer);
        self.transfer.motion(own, canopy);
    }
}
