//! A mesh-mover that says again what one said before: the flow under test reads its
//! grid from it.

use std::path::{Path, PathBuf};

use case::Role;
use channel::{Announcement, Fault, Input, Participant, Stats, Window};

use super::{Event, Reader};

/// Distance of the canopy it is asked to follow from the recorded one, m: the replay
/// passes on what was recorded, to the bit.
const SAME: f64 = 0.0;

/// One rank that has the whole grid.
pub struct StandIn {
    path: PathBuf,
    reader: Reader,
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
        Ok(Self { path: path.into(), reader })
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

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        loop {
            let event = self.reader.next_event().map_err(Fault::new)?;
            let Some(event) = event else {
                return Err(Fault::new(format!(
                    "{} has no grid for window {}, iteration {}",
                    self.path.display(),
                    w.index,
                    w.iteration
                )));
            };
            let Event::Mesh { at, displacement, grid: Some(grid), stats } = event else { continue };
            let moved = displacement.iter().zip(input.canopy).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            if (at.index, at.iteration) != (w.index, w.iteration) || moved > SAME {
                return Err(Fault::new(format!(
                    "asked for window {}, iteration {}, the recording goes on with window {}, iteration {} \
                     (canopies {moved:.1e} m apart)",
                    w.index, w.iteration, at.index, at.iteration
                )));
            }
            output.copy_from_slice(&grid);
            return Ok(Stats { busy_s: 0.0, values: stats });
        }
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
