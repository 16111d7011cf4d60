//! Partners whose every exchange is recorded.

use std::time::Instant;

use channel::Window;
use coupling::error::RunError;
use coupling::partners::Partners;

use super::observed::{Observed, Observer};
use super::{Event, RecordingError, Writer};

/// Asks partners, and writes down what was asked and answered.
pub type Recorder<P> = Observed<P, Recording>;

/// Writes down each exchange.
pub struct Recording {
    writer: Writer,
    with_grid: bool,
    began: Instant,
}

impl<P: Partners> Recorder<P> {
    /// Around `partners`; `with_grid` keeps the moving grid too.
    pub fn new(partners: P, writer: Writer, with_grid: bool) -> Self {
        Self::around(partners, Recording { writer, with_grid, began: Instant::now() })
    }

    /// The partners, when all is written, and what the recording took, in words.
    ///
    /// # Errors
    /// A full disk.
    pub fn into_partners(mut self) -> Result<(P, String), RunError> {
        let Recording { writer, began, .. } = &mut self.observer;
        writer.flush()?;
        let (spent, all) = (self.spent.as_secs_f64(), began.elapsed().as_secs_f64());
        let cost = format!(
            "recorded {:.1} MB in {spent:.2} s, {:.1} % of {all:.1} s",
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
    fn see(&mut self, _: &Window, event: Event<&[f64]>) -> Result<(), RunError> {
        let event = match event {
            Event::Mesh { at, displacement, stats, .. } if !self.with_grid => {
                Event::Mesh { at, displacement, grid: None, stats }
            }
            event => event,
        };
        let is_end = matches!(event, Event::Accept { .. });
        self.writer.push(event)?;
        // A run that is killed later leaves whole windows.
        if is_end { Ok(self.writer.flush()?) } else { Ok(()) }
    }
}
