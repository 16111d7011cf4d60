//! Comparison of the recording of a case with its reference.

use std::path::Path;

use coupling::error::RunError;
use results::recording::compare::{Comparison, FIELDS};
use results::recording::stage_file;
use results::recording::totals::Totals;
use terminal::counted;

use super::cases::Settings;

/// A stage in the reference and in the run.
pub(super) struct StageResult {
    /// Name of the stage.
    pub(super) name: String,
    /// Totals of the reference and of the run; `None` without a readable recording.
    pub(super) totals: [Option<Totals>; 2],
    /// The comparison, where both have the stage on the same mesh.
    pub(super) comparison: Option<Comparison>,
    /// The first deviation.
    pub(super) deviation: Option<String>,
}

/// Compares stage by stage. Stages without an exchange in both (trajectories) are left out.
///
/// # Errors
/// A recording of the reference cannot be read.
pub(super) fn compare(
    [reference, run]: [&Path; 2],
    stages: &[String],
    settings: &Settings,
) -> Result<Vec<StageResult>, RunError> {
    let mut results = Vec::new();
    for name in stages {
        let files = [reference, run].map(|folder| stage_file(folder, name));
        let [old, new] = [0, 1].map(|i| files[i].is_file());
        if old || new {
            results.push(stage(name, [&files[0], &files[1]], [old, new], settings)?);
        }
    }
    results.extend(removed(reference, stages)?);
    Ok(results)
}

/// Stages of the reference that the scene does not have any more.
fn removed(reference: &Path, stages: &[String]) -> Result<Vec<StageResult>, RunError> {
    let entries = std::fs::read_dir(reference).map_err(RunError::file("read", reference))?;
    let names = entries.filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()));
    let gone = names.filter(|name| stage_file(reference, name).is_file() && !stages.contains(name));
    let result = |name| StageResult {
        name,
        totals: [None, None],
        comparison: None,
        deviation: Some("it is in the reference, and not in the scene".into()),
    };
    Ok(gone.map(result).collect())
}

fn stage(
    name: &str,
    [a, b]: [&Path; 2],
    [old, new]: [bool; 2],
    settings: &Settings,
) -> Result<StageResult, RunError> {
    let reference = old.then(|| Totals::of(a)).transpose()?;
    // The recording of a run that was killed may end within an exchange.
    let run = if new { Totals::of(b).ok() } else { None };
    let mut result =
        StageResult { name: name.into(), totals: [reference, run], comparison: None, deviation: None };
    result.deviation = match &result.totals {
        [None, _] => Some("the reference does not have this stage".into()),
        [_, None] => Some("the run has no complete recording of this stage".into()),
        [Some(reference), Some(run)] => {
            match results::diff::recordings(a, b, settings.tolerance, settings.iteration_tolerance) {
                Ok(comparison) => {
                    let found = comparison.deviation();
                    result.comparison = Some(comparison);
                    found.or_else(|| windows(reference, run)).or_else(|| iterations(reference, run, settings))
                }
                Err(error) => Some(error.to_string()),
            }
        }
    };
    Ok(result)
}

/// Different numbers of windows.
fn windows(reference: &Totals, run: &Totals) -> Option<String> {
    let [a, b] = [reference, run].map(|t| t.iterations.len() as u64);
    (a != b).then(|| format!("{} in the reference, {b} now", counted(a, "window")))
}

/// The first window with a number of coupling iterations beyond the tolerance.
fn iterations(reference: &Totals, run: &Totals, settings: &Settings) -> Option<String> {
    let slack = settings.iteration_tolerance?;
    let pairs = reference.iterations.iter().zip(&run.iterations).enumerate();
    let beyond = |(_, (a, b)): &(usize, (&u64, &u64))| a.abs_diff(**b) > (slack * **a as f64).ceil() as u64;
    let (window, (a, b)) = pairs.into_iter().find(beyond)?;
    Some(format!("window {window}: {} in the reference, {b} now", counted(*a, "coupling iteration")))
}

impl StageResult {
    /// The largest relative difference, and the name of its field.
    pub(super) fn largest(&self) -> Option<(f64, &'static str)> {
        let windows = &self.comparison.as_ref()?.windows;
        let all = windows.iter().flat_map(|w| w.fields.iter().zip(&FIELDS));
        let all = all.filter_map(|(difference, field)| Some(((*difference)?, field.name)));
        all.fold(None, |most: Option<(f64, &str)>, next| match most {
            Some(m) if m.0 >= next.0 => Some(m),
            _ => Some(next),
        })
    }
}

#[cfg(test)]
mod tests {
    use channel::{STATS, Window};
    use results::recording::{Event, Header, Writer};

    use super::*;

    /// A recording of flow solves: pressure jumps and coupling iterations of each window.
    fn recording(folder: &Path, faces: u64, windows: &[(f64, u64)]) {
        let header = Header {
            contract: channel::CONTRACT_VERSION,
            version: "1".into(),
            scene: "s".into(),
            stage: ("descent".into(), 0),
            canopy: (4, faces),
            surface_hash: 0,
            grid_nodes: 0,
            ranks: [1; 3],
        };
        let mut writer = Writer::create(&stage_file(folder, "descent"), &header).unwrap();
        for (index, (pressure, iterations)) in windows.iter().enumerate() {
            let at = |iteration| (&Window { index: index as u64, iteration, ..Window::default() }).into();
            let mut load = vec![0.0; 4 * faces as usize];
            load[0] = *pressure;
            for iteration in 0..*iterations {
                writer.push(Event::Flow { at: at(iteration), load: &load, stats: [0.0; STATS] }).unwrap();
            }
            writer.push(Event::Accept { at: at(iterations - 1) }).unwrap();
        }
        writer.flush().unwrap();
    }

    fn deviation(windows: [&[(f64, u64)]; 2], faces: [u64; 2], slack: Option<f64>) -> (Option<String>, f64) {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        for i in 0..2 {
            if !windows[i].is_empty() {
                recording(folders[i].path(), faces[i], windows[i]);
            }
        }
        let settings = Settings { tolerance: 1e-6, iteration_tolerance: slack, ..Settings::default() };
        let stages = ["descent".to_owned(), "trajectory".to_owned()];
        let found = compare([folders[0].path(), folders[1].path()], &stages, &settings).unwrap();
        assert_eq!(found.len(), 1);
        (found[0].deviation.clone(), found[0].largest().map_or(f64::NAN, |l| l.0))
    }

    #[test]
    fn what_deviates_is_named() {
        let reference: &[(f64, u64)] = &[(12.0, 2), (13.0, 3)];
        let says = |run: &[(f64, u64)], slack| deviation([reference, run], [1, 1], slack);
        assert_eq!(says(reference, Some(0.0)), (None, 0.0));
        let (text, largest) = says(&[(12.0, 2), (13.0013, 3)], None);
        let text = text.expect("a deviation");
        assert!(text.contains("window 1") && text.contains("pressure jump from the flow"), "{text}");
        assert!((largest - 1e-4).abs() < 1e-12);
        assert_eq!(says(&[(12.0, 2)], None).0.as_deref(), Some("2 windows in the reference, 1 now"));
        // Coupling iterations are judged with a tolerance only; 25 % of 3, rounded up, is 1.
        let more: &[(f64, u64)] = &[(12.0, 2), (13.0, 5)];
        assert_eq!(says(more, None).0, None);
        let expected = "window 1: 3 coupling iterations in the reference, 5 now";
        assert_eq!(says(more, Some(0.25)).0.as_deref(), Some(expected));
        assert_eq!(says(&[(12.0, 2), (13.0, 4)], Some(0.25)).0, None);
    }

    #[test]
    fn other_meshes_and_missing_stages_deviate() {
        let windows: &[(f64, u64)] = &[(12.0, 1)];
        let meshes = deviation([windows, windows], [1, 2], None).0.expect("a deviation");
        assert!(meshes.contains("the meshes differ"), "{meshes}");
        let (text, _) = deviation([&[], windows], [1, 1], None);
        assert_eq!(text.as_deref(), Some("the reference does not have this stage"));
        let (text, _) = deviation([windows, &[]], [1, 1], None);
        assert_eq!(text.as_deref(), Some("the run has no complete recording of this stage"));
    }

    #[test]
    fn a_stage_that_the_scene_lost_deviates() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        recording(folders[0].path(), 1, &[(12.0, 1)]);
        let both = [folders[0].path(), folders[1].path()];
        let found = compare(both, &["inflation".to_owned()], &Settings::default()).unwrap();
        assert_eq!((found.len(), found[0].name.as_str()), (1, "descent"));
        assert_eq!(found[0].deviation.as_deref(), Some("it is in the reference, and not in the scene"));
    }
}
