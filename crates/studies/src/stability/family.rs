//! The samples of a stability study: a base scene with other mass ratios, windows, substeps and schemes.

use std::path::{Path, PathBuf};

use case::{Scene, set_value};
use coupling::error::RunError;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::exact::Exact;

/// Maximum number of windows of a sample. A sample runs for one period of its first mode within
/// [`MIN_WINDOWS`] and this limit; instability shows within some tens of windows.
pub const MAX_WINDOWS: u64 = 160;
/// Minimum number of windows of a sample.
pub const MIN_WINDOWS: u64 = 12;

/// Values along each axis of the map.
#[derive(Clone, Debug)]
pub struct Axes {
    /// Added mass of the first mode over the mass of the fabric.
    pub mass_ratios: Vec<f64>,
    /// Windows per period of the first mode.
    pub windows: Vec<f64>,
    /// Structure substeps per window.
    pub substeps: Vec<u32>,
    /// Schemes, see [`SchemeChoice`].
    pub schemes: Vec<SchemeChoice>,
}

/// A coupling scheme as on the command line: `default` (that of the scene), or
/// `SCHEME[:ACCELERATION[:LOAD]][+KEY=VALUE...]` with the keys and values of `[coupling]`, as in
/// `staggered+staggered.sequence=improved-serial+staggered.predictor=1`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SchemeChoice(pub String);

impl SchemeChoice {
    /// Sets the scheme in the table of a scene.
    ///
    /// # Errors
    /// A part is not of the form `KEY=VALUE`.
    pub(crate) fn apply(&self, scene: &mut Table) -> Result<(), RunError> {
        if self.0 == "default" {
            return Ok(());
        }
        let mut parts = self.0.split('+');
        let first = parts.next().unwrap_or_default();
        if first != "default" {
            for (key, value) in ["scheme", "acceleration", "load"].into_iter().zip(first.split(':')) {
                set_value(scene, &["coupling"], key, Value::String(value.into()))?;
            }
        }
        for part in parts {
            let (path, value) = part.split_once('=').ok_or_else(|| {
                RunError::Input(format!("`{part}` is not KEY=VALUE with a key of [coupling]"))
            })?;
            // A TOML value, else a string.
            let value = format!("v = {value}").parse::<Table>().ok().and_then(|mut t| t.remove("v"));
            let value = value.unwrap_or_else(|| Value::String(part[path.len() + 1..].into()));
            let (table, key) = path.rsplit_once('.').map_or((None, path), |(t, k)| (Some(t), k));
            let place: Vec<&str> = ["coupling"].into_iter().chain(table).collect();
            set_value(scene, &place, key, value)?;
        }
        Ok(())
    }
}

/// A point of the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Added mass of the first mode over the mass of the fabric.
    pub mass_ratio: f64,
    /// Windows per period of the first mode.
    pub windows_per_period: f64,
    /// Structure substeps per window.
    pub substeps: u32,
    /// Scheme.
    pub scheme: SchemeChoice,
}

/// A sample of the study.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Point of the map.
    pub point: Point,
    /// Scene.
    pub scene: Scene,
    /// Scene as TOML.
    pub text: String,
    /// Results folder, named by the hash of `text`.
    pub folder: PathBuf,
    /// Closed-form solution.
    pub exact: Exact,
}

/// All samples, in the order of the axes, with folders below `out`.
///
/// # Errors
/// The base scene has no closed-form solution, or a sample is not a valid scene.
pub fn samples(base: &Path, axes: &Axes, out: &Path) -> Result<Vec<Sample>, RunError> {
    let text = std::fs::read_to_string(base).map_err(RunError::file("read", base))?;
    // Reports errors of the base scene before it is modified.
    let scene = case::load(base).map_err(|e| RunError::Input(e.to_string()))?;
    let table: Table = text.parse().map_err(|e| RunError::Input(format!("{}: {e}", base.display())))?;
    let exact = Exact::new(&scene).map_err(|e| RunError::Input(format!("{}: {e}", base.display())))?;
    let mut all = Vec::new();
    for scheme in &axes.schemes {
        for &substeps in &axes.substeps {
            for &windows_per_period in &axes.windows {
                for &mass_ratio in &axes.mass_ratios {
                    let point = Point { mass_ratio, windows_per_period, substeps, scheme: scheme.clone() };
                    all.push(sample(&table, &scene, &exact, point, out)?);
                }
            }
        }
    }
    Ok(all)
}

fn sample(base: &Table, scene: &Scene, exact: &Exact, point: Point, out: &Path) -> Result<Sample, RunError> {
    let mut table = base.clone();
    let density = exact.added / (point.mass_ratio * scene.fabric.thickness_m);
    set_value(&mut table, &["fabric"], "density_kg_m3", Value::Float(density))?;
    // The window is an axis of the map.
    set_value(&mut table, &["coupling", "adaptive"], "energy_limit", Value::Float(0.0))?;
    point.scheme.apply(&mut table)?;
    let mut changed = scene.clone();
    changed.fabric.density_kg_m3 = density;
    let period = Exact::new(&changed).map_err(RunError::Input)?.period();
    let window = period / point.windows_per_period;
    let count = (point.windows_per_period.ceil() as u64).clamp(MIN_WINDOWS, MAX_WINDOWS);
    let stages = table.get_mut("stage").and_then(Value::as_array_mut);
    let last = stages.and_then(|s| s.last_mut()).and_then(Value::as_table_mut);
    let last = last.ok_or_else(|| RunError::Input("the scene has no [[stage]]".into()))?;
    last.insert("window_s".into(), Value::Float(window));
    last.insert("duration_s".into(), Value::Float(window * count as f64));
    last.insert("substeps".into(), Value::Integer(point.substeps.into()));
    let text = toml::to_string(&table).map_err(|e| RunError::Input(e.to_string()))?;
    let folder = out.join(format!("{:08x}", crc32fast::hash(text.as_bytes())));
    let scene = case::parse(&folder.join("scene.toml"), &text).map_err(|e| RunError::Input(e.to_string()))?;
    let exact = Exact::new(&scene).map_err(RunError::Input)?;
    Ok(Sample { point, scene, text, folder, exact })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn base() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/hard/membrane-box/scene.toml")
    }

    #[test]
    fn samples_are_distinct_valid_scenes() {
        let axes = Axes {
            mass_ratios: vec![0.1, 1000.0],
            windows: vec![4.0, 4000.0],
            substeps: vec![1, 10],
            schemes: ["default", "staggered", "implicit:aitken:linear"]
                .map(|s| SchemeChoice(s.into()))
                .into(),
        };
        let all = samples(&base(), &axes, Path::new("/tmp/x")).unwrap();
        assert_eq!(all.len(), 24);
        let folders: std::collections::BTreeSet<_> = all.iter().map(|m| m.folder.clone()).collect();
        assert_eq!(folders.len(), 24, "duplicate folders");
        for m in &all {
            let fabric = m.scene.fabric.density_kg_m3 * m.scene.fabric.thickness_m;
            assert!((m.exact.added / fabric / m.point.mass_ratio - 1.0).abs() < 1e-12);
            let stage = m.scene.stages.last().unwrap();
            assert!((m.exact.period() / stage.window_s / m.point.windows_per_period - 1.0).abs() < 1e-12);
            assert_eq!(stage.substeps, m.point.substeps);
            let windows = stage.windows();
            assert!((MIN_WINDOWS..=MAX_WINDOWS).contains(&windows), "{windows}");
        }
        let more = SchemeChoice("staggered+staggered.sequence=improved-serial+staggered.predictor=1".into());
        let axes =
            Axes { mass_ratios: vec![1.0], windows: vec![8.0], substeps: vec![10], schemes: vec![more] };
        let one = &samples(&base(), &axes, Path::new("/tmp/x")).unwrap()[0].scene.coupling.staggered;
        assert_eq!((one.sequence, one.predictor), (case::StaggeredSequence::ImprovedSerial, 1));
        let last = &all[23].scene.coupling;
        assert_eq!(
            (last.scheme, last.acceleration, last.load_interpolation),
            (case::Scheme::Implicit, case::Acceleration::Aitken, Some(case::LoadShape::Linear))
        );
        let wrong = Axes { schemes: vec![SchemeChoice("magic".into())], ..axes };
        assert!(samples(&base(), &wrong, Path::new("/tmp/x")).unwrap_err().to_string().contains("magic"));
    }
}
