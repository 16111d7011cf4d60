//! Replay of a recorded mesh-mover, as source of the grid for a flow under test.

use std::path::{Path, PathBuf};

use case::Role;
use channel::{Announcement, Fault, Input, Participant, Stats, Window};

use super::{Event, Reader};

/// A mesh-mover of one rank that publishes the recorded grid.
pub struct StandIn {
    path: PathBuf,
    reader: Reader,
    /// Recorded solves of the current window.
    window: Vec<Event<Vec<f64>>>,
}

impl StandIn {
    /// Opens the recorded exchanges of a stage.
    ///
    /// # Errors
    /// The file is not a recording, or contains no grid.
    pub fn new(path: &Path) -> Result<Self, Fault> {
        let reader = Reader::open(path).map_err(Fault::new)?;
        if reader.header().grid_nodes == 0 {
            return Err(Fault::new(format!(
                "{} contains no moving grid; record it again with the grid",
                path.display()
            )));
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
            effects: vec!["coupling.adaptive".into()],
        }
    }

    fn output_rows(&self) -> Vec<u64> {
        (0..self.reader.header().grid_nodes).collect()
    }

    /// The recorded grid of this window for a bitwise identical canopy. Calls may be repeated. In a window of another length the same way has
    /// another velocity.
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
            if let Event::Mesh { at, displacement, grid: Some(grid), stats } = event
                && displacement == input.canopy
            {
                output.copy_from_slice(grid);
                if at.dt != w.dt {
                    let faster = at.dt / w.dt;
                    output
                        .as_chunks_mut::<6>()
                        .0
                        .iter_mut()
                        .flat_map(|row| &mut row[3..])
                        .for_each(|v| *v *= faster);
                }
                return Ok(Stats { busy_s: 0.0, values: *stats });
            }
        }
        Err(Fault::new(format!(
            "{} has no grid for this canopy in window {} (coupling iteration {}): the canopy motion differs from the recording",
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
