//! Partners whose every exchange is kept.

use std::path::Path;
use std::time::{Duration, Instant};

use case::Role;
use channel::Window;
use coupling::error::RunError;
use coupling::partners::{Answer, LoadOverWindow, Partners, Usage};

use super::{Event, Moment, RecordingError, Writer};

/// Asks `partners`, and writes down what was asked and answered.
pub struct Recorder<P> {
    partners: P,
    writer: Writer,
    load: Vec<f64>,
    with_grid: bool,
    began: Instant,
    /// Time spent on packing and writing.
    spent: Duration,
}

impl<P: Partners> Recorder<P> {
    /// Around `partners`; `with_grid` keeps the moving grid too.
    pub fn new(partners: P, writer: Writer, with_grid: bool) -> Self {
        Self { partners, writer, load: Vec::new(), with_grid, began: Instant::now(), spent: Duration::ZERO }
    }

    /// The partners, when all is written, and what the recording took, in words.
    ///
    /// # Errors
    /// A full disk.
    pub fn into_partners(mut self) -> Result<(P, String), RunError> {
        self.writer.flush()?;
        let (spent, all) = (self.spent.as_secs_f64(), self.began.elapsed().as_secs_f64());
        let cost = format!(
            "recorded {:.1} MB in {spent:.2} s, {:.1} % of {all:.1} s",
            self.writer.bytes as f64 / 1e6,
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

/// The structure's input as it goes over the channel: rows of the start and the end.
pub(crate) fn load_rows(load: LoadOverWindow<'_>, rows: &mut Vec<f64>) {
    const W: usize = channel::LOAD_WIDTH;
    rows.clear();
    for (start, end) in load.start.chunks_exact(W).zip(load.end.chunks_exact(W)) {
        rows.extend_from_slice(start);
        rows.extend_from_slice(end);
    }
}

impl<P: Partners> Partners for Recorder<P> {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<Answer, RunError> {
        let answer = self.partners.structure(w, load, displacement)?;
        let start = Instant::now();
        load_rows(load, &mut self.load);
        let (at, stats) = (Moment::from(w), answer.stats.values);
        self.writer.push(Event::Structure { at, load: &self.load, displacement, stats })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<Answer, RunError> {
        let answer = self.partners.mesh(w, displacement)?;
        let start = Instant::now();
        let (at, stats) = (Moment::from(w), answer.stats.values);
        self.writer.push(Event::Mesh {
            at,
            displacement,
            grid: self.partners.grid().filter(|_| self.with_grid),
            stats,
        })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<Answer, RunError> {
        let answer = self.partners.flow(w, load)?;
        let start = Instant::now();
        self.writer.push(Event::Flow { at: w.into(), load, stats: answer.stats.values })?;
        self.spent += start.elapsed();
        Ok(answer)
    }

    fn accept(&mut self, w: &Window) -> Result<(), RunError> {
        self.partners.accept(w)?;
        let start = Instant::now();
        self.writer.push(Event::Accept { at: w.into() })?;
        // A run that is killed later leaves whole windows.
        self.writer.flush()?;
        self.spent += start.elapsed();
        Ok(())
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
