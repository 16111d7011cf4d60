//! Cost of a sample: time, memory, and counts that do not depend on the load of the machine.

use std::path::Path;

use results::summary::STAGE_PARTS;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Work in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Windows.
    pub windows: f64,
    /// Coupling iterations, or windows of uncoupled stages.
    pub iterations: f64,
    /// Nonlinear iterations of the flow times its cells; steps of an immersed flow times its cells, weighted.
    pub cell_updates: f64,
    /// Newton or explicit steps of the structure times its elements.
    pub element_evaluations: f64,
    /// Rows of matrix products: Krylov iterations of the structure times its nodes, of the flow
    /// times its cells, of the mesh times its nodes.
    pub matrix_rows: f64,
}

/// Names of the counts, for tables.
pub const COUNTS: [&str; 5] = ["windows", "iterations", "cell_updates", "element_evaluations", "matrix_rows"];

/// Time of one core for a cell update, an element evaluation and a row of a matrix product, s: the weights of the
/// counts in the work. From least squares over the samples of
/// `studies/square-drop` and `studies/air-bag` (processor seconds of a busy 2-core machine: cell updates 1.5e-6;
/// explicit steps of elements 4e-8, Newton's 2.6e-7; rows 6e-8). The weights are fixed, so that work can be
/// compared between versions.
const SECONDS: [f64; 3] = [1.4e-6, 1e-7, 6e-8];

/// A step of the immersed flow and an iteration of its constraints, for each cell, in cell updates and rows of the fitted flow. Step: 0.17 to 0.20
/// updates by processor seconds in one study of both flows, 0.15 to 0.17 us of 0.85 us (docs/records/flow-methods.md, "Coupled windows"). Iteration:
/// 1.4 ns of 60 ns (docs/records/verification.md, "Immersed surfaces").
const IMMERSED: [f64; 2] = [0.18, 0.023];

impl Counts {
    /// The counts in the order of [`COUNTS`].
    pub fn array(&self) -> [f64; 5] {
        [self.windows, self.iterations, self.cell_updates, self.element_evaluations, self.matrix_rows]
    }

    /// Weighted sum of the counts, s of one core.
    pub fn work(&self) -> f64 {
        SECONDS[0] * self.cell_updates + SECONDS[1] * self.element_evaluations + SECONDS[2] * self.matrix_rows
    }

    fn add(&mut self, other: &Self) {
        self.windows += other.windows;
        self.iterations += other.iterations;
        self.cell_updates += other.cell_updates;
        self.element_evaluations += other.element_evaluations;
        self.matrix_rows += other.matrix_rows;
    }
}

/// Cost of a stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageCost {
    /// Name.
    pub name: String,
    /// Wall seconds by [`STAGE_PARTS`].
    pub parts_s: [f64; 5],
    /// Processor seconds of structure, flow, mesh.
    pub cpu_s: [f64; 3],
    /// Counts.
    pub counts: Counts,
}

/// Cost of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Wall seconds from start to end.
    pub wall_s: f64,
    /// Processor seconds of all programs.
    pub cpu_s: f64,
    /// Peak memory of all programs of a stage, bytes.
    pub peak_bytes: f64,
    /// Stages.
    pub stages: Vec<StageCost>,
}

impl Cost {
    /// Counts of all stages.
    pub fn counts(&self) -> Counts {
        let mut all = Counts::default();
        self.stages.iter().for_each(|s| all.add(&s.counts));
        all
    }
}

/// Sizes of a stage's meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sizes {
    /// Elements of the structure.
    pub elements: f64,
    /// Its nodes.
    pub nodes: f64,
    /// Cells of the flow grid.
    pub cells: f64,
    /// Its nodes.
    pub grid_nodes: f64,
    /// Weights of an update of a cell and of a row of it, relative to those of a fitted grid.
    pub weights: [f64; 2],
}

impl Sizes {
    /// Adds cells and nodes from `grid.txt` in the folder of a stage, if present.
    pub fn with_grid(mut self, folder: &Path) -> Self {
        let text = std::fs::read_to_string(folder.join("grid.txt")).unwrap_or_default();
        let line = text.lines().next().unwrap_or_default();
        let before = |word: &str| -> Option<f64> {
            line.split(word).next()?.split([' ', ',']).next_back()?.parse().ok()
        };
        if line.contains(" cells") {
            self.cells = before(" cells").unwrap_or(0.0);
            self.grid_nodes = before(" nodes").unwrap_or(0.0);
            self.weights = if line.contains("immersed") { IMMERSED } else { [1.0; 2] };
        }
        self
    }
}

/// Reads a run's cost from its `summary.json` and folders.
///
/// # Errors
/// The summary is missing or of another version.
pub fn read(out: &Path, structure: Sizes) -> Result<Cost, String> {
    let path = out.join("summary.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let summary: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let missing = || format!("{} was written by another version; run the sample again", path.display());
    let mut cost = Cost { wall_s: summary["wall_s"].as_f64().ok_or_else(missing)?, ..Cost::default() };
    for stage in summary["stages"].as_array().ok_or_else(missing)? {
        let get = |name: &str| stage[name].as_f64().ok_or_else(missing);
        let three = |name: &str| -> Result<[f64; 3], String> {
            let list = stage[name].as_array().ok_or_else(missing)?;
            Ok(std::array::from_fn(|i| list.get(i).and_then(Value::as_f64).unwrap_or(0.0)))
        };
        let name = stage["name"].as_str().ok_or_else(missing)?.to_owned();
        let size = structure.with_grid(&out.join(&name));
        let (cpu_s, memory) = (three("cpu_s")?, three("peak_memory_bytes")?);
        let mut parts_s = [0.0; 5];
        for (part, (key, _)) in parts_s.iter_mut().zip(STAGE_PARTS) {
            *part = get(key)?;
        }
        let counts = Counts {
            windows: get("windows")?,
            iterations: get("iterations")?,
            cell_updates: get("flow_iterations")? * size.cells * size.weights[0],
            element_evaluations: get("structure_steps")? * size.elements,
            matrix_rows: get("structure_linear_iterations")? * size.nodes
                + get("flow_linear_iterations")? * size.cells * size.weights[1]
                + get("mesh_iterations")? * size.grid_nodes,
        };
        cost.cpu_s += cpu_s.iter().sum::<f64>();
        cost.peak_bytes = cost.peak_bytes.max(memory.iter().sum());
        cost.stages.push(StageCost { name, parts_s, cpu_s, counts });
    }
    // After a restart, `wall_s` of the run covers the last part only; that of the stages covers all parts.
    let stages = summary["stages"].as_array().into_iter().flatten();
    cost.wall_s = cost.wall_s.max(stages.filter_map(|s| s["wall_s"].as_f64()).sum());
    Ok(cost)
}

/// Median and half range, for repeated timings.
pub fn spread(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    match all.as_slice() {
        [] => (f64::NAN, f64::NAN),
        some => {
            let n = some.len();
            (0.5 * (some[(n - 1) / 2] + some[n / 2]), 0.5 * (some[n - 1] - some[0]))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_median_and_half_range() {
        assert_eq!(spread([3.0, 1.0, 2.0].into_iter()), (2.0, 1.0));
        assert_eq!(spread([1.0, 4.0].into_iter()), (2.5, 1.5));
        assert!(spread(std::iter::empty()).0.is_nan());
    }

    #[test]
    fn counts_are_read_from_summary_and_grid() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        std::fs::create_dir(out.join("a")).unwrap();
        std::fs::write(out.join("a/grid.txt"), "7776 cells (7776 hexahedra), 8075 nodes, 9.4e3 m3\n")
            .unwrap();
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/square-drop/scene.toml");
        let mut stage = results::summary::StageSummary::new(&case::load(&scene).unwrap().stages[2]);
        stage.name = "a".into();
        (stage.flow_iterations, stage.structure_steps, stage.mesh_iterations) = (10, 7, 3);
        stage.cpu_s = [1.0, 2.0, 0.5];
        let text = serde_json::json!({ "wall_s": 2.5, "stages": [serde_json::to_value(&stage).unwrap()] });
        std::fs::write(out.join("summary.json"), text.to_string()).unwrap();
        let cost = read(out, Sizes { elements: 100.0, nodes: 60.0, ..Sizes::default() }).unwrap();
        let c = cost.counts();
        assert_eq!((c.cell_updates, c.element_evaluations, c.matrix_rows), (77760.0, 700.0, 3.0 * 8075.0));
        assert_eq!((cost.cpu_s, cost.wall_s), (3.5, 2.5));
        assert!(c.work() > 0.0);
        let immersed = "1000 cells (Cartesian, 10 x 10 x 10; even ones of 0.1 m around the immersed canopy), 1331 nodes\n";
        std::fs::write(out.join("a/grid.txt"), immersed).unwrap();
        let c = read(out, Sizes::default()).unwrap().counts();
        assert!((c.cell_updates - 1800.0).abs() < 1e-9, "{}", c.cell_updates);
        std::fs::write(out.join("summary.json"), "{}").unwrap();
        assert!(read(out, Sizes::default()).unwrap_err().contains("another version"));
    }
}
