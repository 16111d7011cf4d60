//! Recording of every exchange.

use std::time::Instant;

use channel::Window;
use coupling::error::RunError;
use coupling::partners::Partners;

use super::observed::{Observed, Observer};
use super::{Event, RecordingError, Writer};

/// Partners whose exchanges are recorded.
pub type Recorder<P> = Observed<P, Recording>;

/// Observer that records each exchange.
pub struct Recording {
    writer: Writer,
    with_grid: bool,
    began: Instant,
}

impl<P: Partners> Recorder<P> {
    /// Wraps `partners`; `with_grid`: also record the moving grid.
    pub fn new(partners: P, writer: Writer, with_grid: bool) -> Self {
        Self::around(partners, Recording { writer, with_grid, began: Instant::now() })
    }

    /// Completes the recording. Returns the partners, and a text on size and time of the recording.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn into_partners(mut self) -> Result<(P, String), RunError> {
        let Recording { writer, began, .. } = &mut self.observer;
        writer.flush()?;
        let (spent, all) = (self.spent.as_secs_f64(), began.elapsed().as_secs_f64());
        let cost = format!(
            "recorded {:.1} MB; recording took {spent:.2} s, {:.1} % of the wall time of {all:.1} s",
            writer.bytes as f64 / 1e6,
            100.0 * spent / all
        );
        Ok((self.partners, cost))
    }
}

impl From<RecordingError> for RunError {
    fn from(error: RecordingError) -> Self {
        match error {
            RecordingError::File { action, path, source } => Self::File { action, path, source },
            other => Self::Input(other.to_string()),
        }
    }
}

impl Observer for Recording {
    fn observe(&mut self, _: &Window, event: Event<&[f64]>) -> Result<(), RunError> {
        let event = match event {
            Event::Mesh { at, displacement, stats, .. } if !self.with_grid => {
                Event::Mesh { at, displacement, grid: None, stats }
            }
            event => event,
        };
        let is_end = matches!(event, Event::Accept { .. });
        self.writer.push(event)?;
        // Complete windows remain readable if the run is killed.
        if is_end { Ok(self.writer.flush()?) } else { Ok(()) }
    }
}
