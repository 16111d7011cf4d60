//! Comparison of the exchanges with a recording during the run.

use channel::Window;
use coupling::error::{Location, RunError};
use coupling::partners::Partners;
use terminal::Console;

use super::compare::Comparison;
use super::observed::{Observed, Observer};
use super::{Event, Reader};

/// Partners whose exchanges are compared with a recording.
pub type Baseline<'a, P> = Observed<P, Reference<'a>>;

/// Compares each exchange with that of a recording.
pub struct Reference<'a> {
    reader: Reader,
    /// Events of the current recorded window.
    window: Vec<Event<Vec<f64>>>,
    /// Comparison so far.
    comparison: &'a mut Comparison,
    stage: String,
    stop: bool,
    console: &'a Console,
    reported: bool,
}

impl<'a, P: Partners> Baseline<'a, P> {
    /// Wraps `partners`. `stop`: the first deviation ends the run.
    pub fn new(
        partners: P,
        reader: Reader,
        comparison: &'a mut Comparison,
        stop: bool,
        console: &'a Console,
    ) -> Self {
        let (stage, window) = (reader.header().stage.0.clone(), Vec::new());
        Self::around(
            partners,
            Reference { reader, window, comparison, stage, stop, console, reported: false },
        )
    }

    /// The partners.
    pub fn into_partners(self) -> P {
        self.partners
    }
}

impl Reference<'_> {
    /// Reads the recorded window `index`, if it exists.
    fn read_window(&mut self, index: u64) -> Result<(), RunError> {
        if self.window.first().is_none_or(|e| e.at().index != index) {
            self.window.clear();
            // A window missing in the recording is not compared.
            while let Some(event) = self.reader.next_event()? {
                let ends = matches!(event, Event::Accept { .. });
                self.window.push(event);
                if ends {
                    break;
                }
            }
        }
        Ok(())
    }
}

impl Observer for Reference<'_> {
    fn observe(&mut self, w: &Window, event: Event<&[f64]>) -> Result<(), RunError> {
        if matches!(event, Event::Accept { .. }) {
            return Ok(());
        }
        self.read_window(w.index)?;
        let key = (event.kind(), w.index, w.iteration);
        if let Some(known) = self.window.iter().find(|e| (e.kind(), e.at().index, e.at().iteration) == key) {
            self.comparison.add(known, &event);
        } else if let Some(recorded) = self.window.first().filter(|e| e.at().index == w.index) {
            let most = self.window.iter().map(|e| e.at().iteration + 1).max().unwrap_or(0);
            let index = recorded.at().index;
            self.comparison.other_iterations.get_or_insert((index, [most, w.iteration + 1]));
        }
        match &self.comparison.deviation() {
            Some(deviation) if self.stop => Err(RunError::Deviates {
                place: Location { stage: self.stage.clone(), window: Some((w.index, w.iteration)) },
                message: deviation.to_string(),
            }),
            Some(deviation) if !self.reported => {
                self.reported = true;
                self.console
                    .warning(&format!("stage `{}` deviates from its baseline: {deviation}", self.stage));
                Ok(())
            }
            _ => Ok(()),
        }
    }
}
