//! Partners whose answers are compared with a recording as they come.

use std::path::Path;

use case::Role;
use channel::Window;
use coupling::error::{Place, RunError};
use coupling::partners::{Answer, LoadOverWindow, Partners, Usage};
use terminal::Console;

use super::compare::Comparison;
use super::recorder::load_rows;
use super::{Event, Reader};

/// Asks `partners`, and compares with what the recording says.
pub struct Baseline<'a, P> {
    partners: P,
    reader: Reader,
    /// The rest of the recorded window.
    window: Vec<Event<Vec<f64>>>,
    /// What was found so far.
    pub comparison: &'a mut Comparison,
    stage: String,
    stop: bool,
    console: &'a Console,
    load: Vec<f64>,
    told: bool,
}

impl<'a, P: Partners> Baseline<'a, P> {
    /// Around `partners`. `stop`: the first departure ends the run.
    pub fn new(
        partners: P,
        reader: Reader,
        comparison: &'a mut Comparison,
        stop: bool,
        console: &'a Console,
    ) -> Self {
        let stage = reader.header().stage.0.clone();
        Self {
            partners,
            reader,
            window: Vec::new(),
            comparison,
            stage,
            stop,
            console,
            load: Vec::new(),
            told: false,
        }
    }

    /// The partners.
    pub fn into_partners(self) -> P {
        self.partners
    }

    fn compare(&mut self, w: &Window, event: Event<&[f64]>) -> Result<(), RunError> {
        if self.window.first().is_none_or(|e| e.at().index != w.index) {
            self.window.clear();
            // A window that the recording does not have cannot be compared.
            while let Some(event) = self.reader.next_event()? {
                let ends = matches!(event, Event::Accept { .. });
                self.window.push(event);
                if ends {
                    break;
                }
            }
        }
        let key = (event.kind(), w.index, w.iteration);
        if let Some(known) = self.window.iter().find(|e| (e.kind(), e.at().index, e.at().iteration) == key) {
            self.comparison.add(known, &event);
        } else if let Some(recorded) = self.window.first().filter(|e| e.at().index == w.index) {
            let most = self.window.iter().map(|e| e.at().iteration + 1).max().unwrap_or(0);
            let index = recorded.at().index;
            self.comparison.other_iterations.get_or_insert((index, [most, w.iteration + 1]));
        }
        match &self.comparison.departure() {
            Some(departure) if self.stop => Err(RunError::Coupling {
                place: Place { stage: self.stage.clone(), window: Some((w.index, w.iteration)) },
                message: format!("the run leaves its baseline: {departure}"),
            }),
            Some(departure) if !self.told => {
                self.told = true;
                self.console.warning(&format!("stage `{}` leaves its baseline: {departure}", self.stage));
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl<P: Partners> Partners for Baseline<'_, P> {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<Answer, RunError> {
        let answer = self.partners.structure(w, load, displacement)?;
        let mut rows = std::mem::take(&mut self.load);
        load_rows(load, &mut rows);
        let stats = answer.stats.values;
        let compared = self.compare(w, Event::Structure { at: w.into(), load: &rows, displacement, stats });
        self.load = rows;
        compared.map(|()| answer)
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<Answer, RunError> {
        let answer = self.partners.mesh(w, displacement)?;
        let stats = answer.stats.values;
        let grid = self.partners.grid().map(<[f64]>::to_vec);
        self.compare(w, Event::Mesh { at: w.into(), displacement, grid: grid.as_deref(), stats })?;
        Ok(answer)
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<Answer, RunError> {
        let answer = self.partners.flow(w, load)?;
        self.compare(w, Event::Flow { at: w.into(), load, stats: answer.stats.values })?;
        Ok(answer)
    }

    fn accept(&mut self, w: &Window) -> Result<(), RunError> {
        self.partners.accept(w)
    }

    fn save(&mut self, folder: &Path) -> Result<(), RunError> {
        self.partners.save(folder)
    }

    fn snapshot(&mut self, role: Role, time: f64, folder: &Path) -> Result<(), RunError> {
        self.partners.snapshot(role, time, folder)
    }

    fn cannot_resume(&self) -> Vec<String> {
        self.partners.cannot_resume()
    }

    fn used(&self) -> Vec<(Role, Usage)> {
        self.partners.used()
    }

    fn grid(&self) -> Option<&[f64]> {
        self.partners.grid()
    }

    fn fixed_windows(&self) -> Vec<String> {
        self.partners.fixed_windows()
    }

    fn without_support_force(&self) -> Option<String> {
        self.partners.without_support_force()
    }
}
