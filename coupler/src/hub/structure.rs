//! Questions to the structure, whose surface may be another than the canopy.

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
    /// The surface of a structure that has its own.
    pub(super) fn own_surface(
        &self,
        folder: &Path,
        interface: &CanopyInterface,
        console: &Console,
    ) -> Result<Option<OwnSurface>, RunError> {
        let said = self.hub.announcement(Role::Structure);
        let Some(said) = said.filter(|a| a.effects.iter().any(|e| e == OWN_SURFACE)) else { return Ok(None) };
        let refuse = |message| RunError::Channel { place: self.place.clone(), message };
        let file = surface_file(folder);
        let text = std::fs::read_to_string(&file).map_err(|e| e.to_string());
        let own = text.and_then(|text| OwnSurface::parse(&text, interface));
        let bad = |why| refuse(format!("the structure's own surface, {}: {why}", file.display()));
        let own = own.map_err(bad)?;
        let [nodes, faces] = own.sizes();
        if (nodes as u64, faces as u64) != (said.canopy_nodes, said.canopy_faces) {
            return Err(refuse(format!(
                "{} announces a surface of {} nodes and {} faces, its file has {nodes} and {faces}",
                said.program, said.canopy_nodes, said.canopy_faces
            )));
        }
        console.line(&format!(
            "{} has a surface of its own: {nodes} nodes and {faces} faces beside the canopy's {} and {}",
            said.program,
            interface.nodes(),
            interface.faces.len()
        ));
        Ok(Some(own))
    }

    /// Asks the structure, on its own surface where it has one.
    pub(super) fn structure_on(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
        own: Option<&mut OwnSurface>,
    ) -> Result<SolverResponse, RunError> {
        let Some(own) = own else { return self.ask_structure(w, [load.start, load.end], displacement) };
        own.load(load);
        let (loads, answer) = own.exchange();
        let answer = self.ask_structure(w, loads, answer)?;
        own.motion(displacement);
        Ok(answer)
    }

    fn ask_structure(
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
