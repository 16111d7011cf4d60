//! A mesh-mover that says again what one said before: the flow under test reads its
//! grid from it.

use std::path::{Path, PathBuf};

use case::Role;
use channel::{Announcement, Fault, Input, Participant, Stats, Window};

use super::{Event, Reader};

/// One rank that has the whole grid.
pub struct StandIn {
    path: PathBuf,
    reader: Reader,
    /// Answers of the window that was asked for last.
    window: Vec<Event<Vec<f64>>>,
}

impl StandIn {
    /// From the exchanges of a stage.
    ///
    /// # Errors
    /// A file that is no recording, or one without a grid.
    pub fn new(path: &Path) -> Result<Self, Fault> {
        let reader = Reader::open(path).map_err(Fault::new)?;
        if reader.header().grid_nodes == 0 {
            return Err(Fault::new(format!("{} holds no moving grid", path.display())));
        }
        Ok(Self { path: path.into(), reader, window: Vec::new() })
    }
}

impl Participant for StandIn {
    fn announce(&self) -> Announcement {
        let h = self.reader.header();
        Announcement {
            role: Role::Mesh.name().into(),
            program: "recorded mesh-mover".into(),
            version: h.version.clone(),
            canopy_nodes: h.canopy.0,
            canopy_faces: h.canopy.1,
            surface_hash: h.surface_hash,
            grid_nodes: h.grid_nodes,
            output_width: 6,
            effects: Vec::new(),
        }
    }

    fn output_rows(&self) -> Vec<u64> {
        (0..self.reader.header().grid_nodes).collect()
    }

    /// The recorded grid of this window for this canopy, to the bit; questions may be
    /// repeated.
    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let here = |e: &Event<Vec<f64>>| e.at().index == w.index;
        if !self.window.iter().any(here) {
            self.window.clear();
            while let Some(event) = self.reader.next_event().map_err(Fault::new)? {
                let ends = here(&event) && matches!(event, Event::Accept { .. });
                if here(&event) && matches!(event, Event::Mesh { .. }) {
                    self.window.push(event);
                }
                if ends {
                    break;
                }
            }
        }
        for event in &self.window {
            if let Event::Mesh { displacement, grid: Some(grid), stats, .. } = event
                && displacement == input.canopy
            {
                output.copy_from_slice(grid);
                return Ok(Stats { busy_s: 0.0, values: *stats });
            }
        }
        Err(Fault::new(format!(
            "{} has no grid around this canopy in window {} (coupling iteration {})",
            self.path.display(),
            w.index,
            w.iteration
        )))
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        Ok(())
    }

    fn save(&mut self, _: &Path) -> Result<(), Fault> {
        Ok(())
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}
