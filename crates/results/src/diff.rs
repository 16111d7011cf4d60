//! Comparison of two runs or recordings: the first deviation.

use std::path::Path;

use coupling::error::RunError;
use terminal::counted;

use crate::history;
use crate::recording::compare::Comparison;
use crate::recording::{Event, Reader};

/// Iterator over the windows of a recording: events of each window, in order.
struct Windows {
    reader: Reader,
}

impl Windows {
    fn next(&mut self) -> Result<Option<Vec<Event<Vec<f64>>>>, RunError> {
        let mut window = Vec::new();
        while let Some(event) = self.reader.next_event()? {
            let ends = matches!(event, Event::Accept { .. });
            window.push(event);
            if ends {
                return Ok(Some(window));
            }
        }
        Ok((!window.is_empty()).then_some(window))
    }
}

/// Compares the exchanges of a stage window by window: each iteration that both have, and the last iterations if their
/// numbers differ.
///
/// # Errors
/// A recording cannot be read, or the recordings are of different canopies.
pub fn recordings(
    a: &Path,
    b: &Path,
    tolerance: f64,
    iteration_tolerance: Option<f64>,
) -> Result<Comparison, RunError> {
    let mut both = [Windows { reader: Reader::open(a)? }, Windows { reader: Reader::open(b)? }];
    let canopies = [0, 1].map(|i| both[i].reader.header().canopy);
    if canopies[0] != canopies[1] {
        return Err(RunError::Input(format!(
            "{} has {} canopy nodes and {} faces, {} has {} and {}: the meshes differ, so the recordings cannot be \
             compared",
            a.display(),
            canopies[0].0,
            canopies[0].1,
            b.display(),
            canopies[1].0,
            canopies[1].1
        )));
    }
    let mut comparison = Comparison::new(tolerance).judging_counts(iteration_tolerance);
    loop {
        let [a, b] = &mut both;
        let (Some(x), Some(y)) = (a.next()?, b.next()?) else { return Ok(comparison) };
        let key = |e: &Event<Vec<f64>>| (e.kind(), e.at().iteration);
        for event in &x {
            if let Some(other) = y.iter().find(|o| key(o) == key(event)) {
                comparison.add(event, other);
            }
        }
        let count = |w: &[Event<Vec<f64>>]| w.iter().map(|e| e.at().iteration + 1).max().unwrap_or(0);
        if count(&x) != count(&y) {
            let index = x.first().map_or(0, |e| e.at().index);
            comparison.other_iterations.get_or_insert((index, [count(&x), count(&y)]));
            for kind in 0..3 {
                let last = |w: &[Event<Vec<f64>>]| w.iter().rposition(|e| e.kind() == kind);
                if let (Some(i), Some(j)) = (last(&x), last(&y)) {
                    comparison.add(&x[i], &y[j]);
                }
            }
        }
    }
}

/// Columns of a history that are measured times instead of results.
fn is_time_spent(name: &str) -> bool {
    name == "coupler_s"
        || ["wall", "busy", "wait", "assembly", "factorisation", "solve", "megabytes"]
            .iter()
            .any(|w| name.contains(w))
}

/// Compares the history files `a` and `b`, column by column without the measured times. Returns whether they agree, and
/// the report. A difference is relative to the largest magnitude of its column in `a`.
///
/// # Errors
/// A file is not a history.
pub fn histories(a: &Path, b: &Path, tolerance: f64) -> Result<(bool, String), RunError> {
    let (a, b) = (history::read(a)?, history::read(b)?);
    let mut first: Option<(usize, &str, f64, f64, f64)> = None;
    let mut rows = 0;
    for (name, x) in a.iter().filter(|(n, _)| !is_time_spent(n)) {
        let Some((_, y)) = b.iter().find(|(n, _)| n == name) else { continue };
        let scale = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        rows = x.len().min(y.len());
        let beyond = |i: &usize| {
            let d = (x[*i] - y[*i]).abs();
            let same = d <= tolerance * scale || d == 0.0 || (x[*i].is_nan() && y[*i].is_nan());
            !same
        };
        if let Some(i) = (0..rows).find(beyond)
            && first.is_none_or(|f| i < f.0)
        {
            first = Some((i, name, x[i], y[i], (x[i] - y[i]).abs() / scale));
        }
    }
    Ok(match first {
        None => (
            true,
            format!("the histories agree within {tolerance:.0e} in {}", counted(rows as u64, "window")),
        ),
        Some((i, name, x, y, d)) => (
            false,
            format!(
                "first deviation of the histories: window {i}, column {name}: {x:.9e} and {y:.9e}, {d:.1e} relative to the \
                 column maximum (tolerance {tolerance:.0e}). Recordings (`ripstop run --record`) show the channel and the \
                 node"
            ),
        ),
    })
}
