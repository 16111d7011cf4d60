//! The surface of a structure that has its own, during a stage.

use std::path::{Path, PathBuf};

use channel::LOAD_WIDTH;

use super::surface::Surface;
use super::surface_transfer::Transfer;
use crate::geometry::Vec3;
use crate::interface::CanopyInterface;
use crate::partners::LoadOverWindow;

/// File to which a structure that announces [`channel::OWN_SURFACE`] writes its surface before the announcement.
pub fn surface_file(stage_folder: &Path) -> PathBuf {
    stage_folder.join("structure-surface.json")
}

/// Transfer between the canopy and a structure's own surface. Loads are transferred in the configuration at the end
/// of the last accepted window, so that a response depends on its request alone.
pub struct OwnSurface {
    transfer: Transfer,
    /// Displacements at the end of the last accepted window and of the last response, m.
    accepted: [Vec<f64>; 2],
    response: Vec<f64>,
    loads: [Vec<f64>; 2],
}

impl OwnSurface {
    /// Parses the `text` of the file to which the structure of a stage wrote its surface ([`surface_file`]).
    ///
    /// # Errors
    /// A text that is not a surface of this canopy, as a message.
    pub fn parse(text: &str, canopy: &CanopyInterface) -> Result<Self, String> {
        let own: Surface = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let mut response = vec![0.0; 3 * own.nodes.len()];
        if !own.displacement.is_empty() {
            if own.displacement.len() != response.len() || own.displacement.iter().any(|d| !d.is_finite()) {
                return Err(format!("its displacement must be {} finite numbers", response.len()));
            }
            response.copy_from_slice(&own.displacement);
        }
        let nodes = canopy.coords.iter().map(|x| Vec3::from(*x).into()).collect();
        let scene = Surface { nodes, faces: canopy.faces.clone(), ..Surface::default() };
        let faces = LOAD_WIDTH * own.faces.len();
        let mut moved = vec![0.0; 3 * scene.nodes.len()];
        let transfer = Transfer::new(scene, own).map_err(|e| e.to_string())?;
        transfer.motion(&response, &mut moved);
        Ok(Self {
            transfer,
            accepted: [response.clone(), moved],
            response,
            loads: [vec![0.0; faces], vec![0.0; faces]],
        })
    }

    /// Numbers of nodes and faces.
    pub fn sizes(&self) -> [usize; 2] {
        self.transfer.own_sizes()
    }

    /// Transfers the canopy's load to the structure's surface.
    pub fn load(&mut self, load: LoadOverWindow<'_>) {
        let [own, canopy] = &self.accepted;
        for (from, to) in [load.start, load.end].into_iter().zip(&mut self.loads) {
            self.transfer.load(own, canopy, from, to);
        }
    }

    /// The loads from [`OwnSurface::load`] at the start and the end of the window, and the buffer for the response.
    pub fn exchange(&mut self) -> ([&[f64]; 2], &mut [f64]) {
        let [start, end] = &self.loads;
        ([start, end], &mut self.response)
    }

    /// The canopy's displacement under the structure's last response.
    pub fn motion(&self, canopy: &mut [f64]) {
        self.transfer.motion(&self.response, canopy);
    }

    /// The last response is accepted.
    pub fn accept(&mut self) {
        let [own, canopy] = &mut self.accepted;
        own.copy_from_slice(&self.response);
        self.transfer.motion(own, canopy);
    }
}
