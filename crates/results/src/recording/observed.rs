//! Partners with an observer of every exchange: a recorder, or a comparison with a recording.

use std::path::Path;
use std::time::{Duration, Instant};

use case::Role;
use channel::Window;
use coupling::error::RunError;
use coupling::partners::{AcceptCost, LoadOverWindow, Partners, SolverResponse, Usage};

use super::Event;

/// Observer of the exchanges with the programs.
pub trait Observer {
    /// Observes an exchange of window `w`.
    ///
    /// # Errors
    /// An error ends the run.
    fn observe(&mut self, w: &Window, event: Event<&[f64]>) -> Result<(), RunError>;
}

/// Forwards requests to `partners` and passes each exchange to `observer`.
pub struct Observed<P, O> {
    pub(super) partners: P,
    pub(super) observer: O,
    /// Input of the structure in the layout of the channel.
    load: Vec<f64>,
    /// Time spent in the observer.
    pub(super) spent: Duration,
}

impl<P, O> Observed<P, O> {
    pub(super) fn around(partners: P, observer: O) -> Self {
        Self { partners, observer, load: Vec::new(), spent: Duration::ZERO }
    }
}

/// Input of the structure in the layout of the channel: per face, the load at the start and at the end of the window.
fn load_rows(load: LoadOverWindow<'_>, rows: &mut Vec<f64>) {
    const W: usize = channel::LOAD_WIDTH;
    rows.clear();
    for (start, end) in load.start.chunks_exact(W).zip(load.end.chunks_exact(W)) {
        rows.extend_from_slice(start);
        rows.extend_from_slice(end);
    }
}

impl<P: Partners, O: Observer> Partners for Observed<P, O> {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError> {
        let answer = self.partners.structure(w, load, displacement)?;
        let start = Instant::now();
        load_rows(load, &mut self.load);
        let (at, load, stats) = (w.into(), &self.load[..], answer.stats.values);
        self.observer.observe(w, Event::Structure { at, load, displacement, stats })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError> {
        let answer = self.partners.mesh(w, displacement)?;
        let start = Instant::now();
        let (at, grid, stats) = (w.into(), self.partners.grid(), answer.stats.values);
        self.observer.observe(w, Event::Mesh { at, displacement, grid, stats })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError> {
        let answer = self.partners.flow(w, load)?;
        let start = Instant::now();
        self.observer.observe(w, Event::Flow { at: w.into(), load, stats: answer.stats.values })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn accept(&mut self, w: &Window) -> Result<AcceptCost, RunError> {
        let cost = self.partners.accept(w)?;
        let start = Instant::now();
        self.observer.observe(w, Event::Accept { at: w.into() })?;
        self.spent += start.elapsed();
        Ok(cost)
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
