//! Requests to the structure, which may use its own surface mesh instead of the canopy mesh.

use std::path::Path;

use case::Role;
use channel::{LOAD_WIDTH, OWN_SURFACE, Window};
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use coupling::partners::{LoadOverWindow, SolverResponse};
use coupling::transfer::{OwnSurface, surface_file};
use terminal::Console;

use super::HubPartners;
use super::partners::scatter;

impl HubPartners<'_> {
    /// The transfer to the surface of a structure that announces its own.
    ///
    /// # Errors
    /// The surface file cannot be read, or does not match the announced sizes.
    pub(super) fn own_surface(
        &self,
        folder: &Path,
        interface: &CanopyInterface,
        console: &Console,
    ) -> Result<Option<OwnSurface>, RunError> {
        let announced = self.hub.announcement(Role::Structure);
        let Some(announced) = announced.filter(|a| a.effects.iter().any(|e| e == OWN_SURFACE)) else {
            return Ok(None);
        };
        let refuse = |message| RunError::Channel { place: self.place.clone(), message };
        let file = surface_file(folder);
        let text = std::fs::read_to_string(&file).map_err(|e| e.to_string());
        let own = text.and_then(|text| OwnSurface::parse(&text, interface));
        let bad = |why| refuse(format!("surface file of the structure, {}: {why}", file.display()));
        let own = own.map_err(bad)?;
        let [nodes, faces] = own.sizes();
        if (nodes as u64, faces as u64) != (announced.canopy_nodes, announced.canopy_faces) {
            return Err(refuse(format!(
                "{} announces a surface of {} nodes and {} faces, but its surface file has {nodes} and {faces}",
                announced.program, announced.canopy_nodes, announced.canopy_faces
            )));
        }
        console.line(&format!(
            "{} uses its own surface: {nodes} nodes and {faces} faces; the canopy has {} and {}",
            announced.program,
            interface.nodes(),
            interface.faces.len()
        ));
        Ok(Some(own))
    }

    /// Solves the structure, on its own surface where it has one.
    pub(super) fn structure_on_surface(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
        own: Option<&mut OwnSurface>,
    ) -> Result<SolverResponse, RunError> {
        let Some(own) = own else { return self.request_structure(w, [load.start, load.end], displacement) };
        own.load(load);
        let (loads, response) = own.exchange();
        let response = self.request_structure(w, loads, response)?;
        own.motion(displacement);
        Ok(response)
    }

    fn request_structure(
        &mut self,
        w: &Window,
        [start, end]: [&[f64]; 2],
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError> {
        let mut fill = |input: &mut [f64]| {
            let faces = start.chunks_exact(LOAD_WIDTH).zip(end.chunks_exact(LOAD_WIDTH));
            for (row, (start, end)) in input.chunks_exact_mut(2 * LOAD_WIDTH).zip(faces) {
                row[..LOAD_WIDTH].copy_from_slice(start);
                row[LOAD_WIDTH..].copy_from_slice(end);
            }
        };
        let mut keep = |rows: &[u64], data: &[f64]| scatter(rows, data, 3, displacement);
        self.advance(Role::Structure, w, &mut fill, &mut keep)
    }
}
