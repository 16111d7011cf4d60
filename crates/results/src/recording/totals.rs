//! What the exchanges of a stage amount to: for tables of two recordings.

use std::path::Path;

use channel::flow_stats;

use super::compare::{COUNTS, Count};
use super::{Event, Reader, RecordingError};

/// Sums and last values of the exchanges of a stage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Totals {
    /// Coupling iterations of each accepted window.
    pub iterations: Vec<u64>,
    /// Velocity of the frame at the end of the last accepted window, m/s.
    pub frame_velocity_m_s: [f64; 3],
    /// Force of the air at the end of the last flow solve, N: on the canopy, or on the watched surfaces.
    pub force_n: Option<[f64; 3]>,
    /// Largest displacement of a canopy node in the last structure solve, m.
    pub displacement_m: Option<f64>,
    /// Sum of each count of [`COUNTS`] over all solves, also those of rejected windows.
    pub counts: [f64; COUNTS.len()],
}

impl Totals {
    /// Reads the recording of a stage.
    ///
    /// # Errors
    /// [`RecordingError`].
    pub fn of(file: &Path) -> Result<Self, RecordingError> {
        let mut reader = Reader::open(file)?;
        let mut totals = Self::default();
        while let Some(event) = reader.next_event()? {
            totals.add(&event);
        }
        Ok(totals)
    }

    fn add(&mut self, event: &Event<Vec<f64>>) {
        match event {
            Event::Structure { displacement, stats, .. } => {
                let length = |u: &[f64]| u.iter().map(|c| c * c).sum::<f64>().sqrt();
                self.displacement_m = displacement.chunks_exact(3).map(length).reduce(f64::max);
                self.count(event, stats);
            }
            Event::Mesh { stats, .. } => self.count(event, stats),
            Event::Flow { stats, .. } => {
                self.force_n = Some([0, 1, 2].map(|axis| stats[flow_stats::FORCE + axis]));
                self.count(event, stats);
            }
            Event::Accept { at } => {
                self.iterations.push(at.iteration + 1);
                self.frame_velocity_m_s = at.frame_velocity;
            }
        }
    }

    fn count(&mut self, event: &Event<Vec<f64>>, stats: &[f64; channel::STATS]) {
        let own = |count: &Count| Some(count.role) == event.role();
        for (sum, count) in self.counts.iter_mut().zip(&COUNTS).filter(|(_, count)| own(count)) {
            *sum += count.of(stats);
        }
    }
}

#[cfg(test)]
mod tests {
    use channel::{STATS, Window, structure_stats};

    use super::*;
    use crate::recording::Moment;

    #[test]
    fn totals_of_two_windows() {
        let at = |index, iteration, speed| Moment {
            frame_velocity: [0.0, 0.0, speed],
            ..(&Window { index, iteration, ..Window::default() }).into()
        };
        let structure = |newton| {
            let mut stats = [0.0; STATS];
            stats[structure_stats::NEWTON_STEPS] = newton;
            // Not a count of the structure.
            stats[flow_stats::LINEAR_ITERATIONS] = 100.0;
            let displacement = vec![0.1, 0.0, 0.0, 0.0, 3.0, 4.0];
            Event::Structure { at: at(0, 0, -4.0), load: vec![0.0; 8], displacement, stats }
        };
        let mut stats = [0.0; STATS];
        stats[flow_stats::FORCE + 2] = 51.0;
        stats[flow_stats::LINEAR_ITERATIONS] = 7.0;
        let mut totals = Totals::default();
        for event in [
            structure(3.0),
            Event::Flow { at: at(0, 0, -4.0), load: vec![0.0; 4], stats },
            Event::Accept { at: at(0, 2, -4.0) },
            structure(2.0),
            Event::Accept { at: at(1, 0, -4.5) },
        ] {
            totals.add(&event);
        }
        assert_eq!(totals.iterations, [3, 1]);
        assert_eq!((totals.frame_velocity_m_s[2], totals.force_n), (-4.5, Some([0.0, 0.0, 51.0])));
        assert_eq!(totals.displacement_m, Some(5.0));
        let counted =
            |name: &str| totals.counts[COUNTS.iter().position(|c| c.name == name).expect("a count")];
        assert_eq!((counted("Newton iterations"), counted("linear iterations")), (5.0, 7.0));
    }
}
