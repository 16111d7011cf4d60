//! The data of a stage at its start, as `ripstop mesh` prints them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;
use serde_json::Value;

use crate::Fault;

/// The data of a stage at its start.
#[derive(Clone, Debug, Deserialize)]
pub struct StageData {
    /// The scene with all defaults, by the keys of a scene file.
    pub scene: Value,
    /// The stage, from 0.
    pub stage: usize,
    /// Canopy, lines and payload.
    pub structure: StructureMesh,
    /// File of the state that each role saved in the last stage that had it, by the name of the role.
    pub states: BTreeMap<String, PathBuf>,
    /// Time of the clocks `stage`, `release` and `run` at the start, s.
    pub clocks: BTreeMap<String, f64>,
    /// The flow grid, where it was asked for.
    pub grid: Option<FlowGrid>,
}

/// Nodes and elements of the structure. The first [`StructureMesh::n_canopy`] nodes are the interface.
#[derive(Clone, Debug, Deserialize)]
pub struct StructureMesh {
    /// Unstressed positions of all nodes, m.
    pub coords: Vec<[f64; 3]>,
    /// Nodes of the canopy.
    pub n_canopy: usize,
    /// Corners of the canopy's faces; a triangle repeats its third corner.
    pub faces: Vec<[u32; 4]>,
    /// Lines, risers and tapes.
    pub cables: Vec<Cable>,
    /// Node and mass, kg.
    pub point_masses: Vec<(usize, f64)>,
    /// Node and whether it is held along x, y, z.
    pub fixed: Vec<(usize, [bool; 3])>,
}

/// A cable between two nodes.
#[derive(Clone, Debug, Deserialize)]
pub struct Cable {
    /// Its ends.
    pub nodes: [u32; 2],
    /// Unstressed length, m.
    pub rest_length: f64,
    /// `SuspensionLine`, or another kind.
    pub kind: Value,
}

/// The flow grid at the start of the stage.
#[derive(Clone, Debug, Deserialize)]
pub struct FlowGrid {
    /// Positions of the nodes, m.
    pub coords: Vec<[f64; 3]>,
    /// Corners of the cells; prisms, pyramids and tetrahedra repeat corners.
    pub cells: Vec<[u32; 8]>,
    /// Grid node of each canopy node.
    pub canopy_nodes: Vec<u64>,
    /// Patch and corners of the faces of the boundary.
    pub boundary: Vec<(Value, [u32; 4])>,
}

impl StageData {
    /// The value at a dotted key of the scene, such as `fabric.thickness_m`; entries of lists by their number, from 0, as
    /// `flow.wind_m_s.2`.
    pub fn value(&self, key: &str) -> Option<&Value> {
        key.split('.').try_fold(&self.scene, |value, part| match value {
            Value::Array(list) => list.get(part.parse::<usize>().ok()?),
            table => table.get(part),
        })
    }

    /// The number at a dotted key of the scene ([`StageData::value`]).
    ///
    /// # Errors
    /// The scene has no number there.
    pub fn number(&self, key: &str) -> Result<f64, Fault> {
        self.value(key).and_then(Value::as_f64).ok_or_else(|| {
            Fault::new(format!(
                "the scene has no number `{key}`, which this program needs: set it in the scene"
            ))
        })
    }

    /// The number at a dotted key of this stage, such as `window_s`.
    ///
    /// # Errors
    /// The stage has no number there.
    pub fn stage_number(&self, key: &str) -> Result<f64, Fault> {
        let value = self.scene["stage"][self.stage].get(key).and_then(Value::as_f64);
        value.ok_or_else(|| Fault::new(format!("stage {} of the scene has no number `{key}`", self.stage)))
    }

    /// Whether the stage couples the programs, so that the canopy moves.
    pub fn is_coupled(&self) -> bool {
        self.scene["stage"][self.stage]["kind"] == "coupled"
    }

    /// The flow grid.
    ///
    /// # Errors
    /// It was not asked for.
    pub fn flow_grid(&self) -> Result<&FlowGrid, Fault> {
        self.grid
            .as_ref()
            .ok_or_else(|| Fault::new("this program asked for no flow grid: call `run.data(true)`"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data() -> StageData {
        let text = r#"{"scene": {"fabric": {"thickness_m": 4e-5, "wrinkling": true}, "stage": [{"kind": "flow-only"}, {"kind": "coupled", "window_s": 5e-3}]},
            "stage": 1, "structure": {"coords": [[0,0,0]], "n_canopy": 1, "faces": [], "cables": [{"nodes": [0, 0], "rest_length": 2.4,
            "kind": "SuspensionLine", "line": 0, "share": 1.0}], "point_masses": [[0, 5.0]], "fixed": [[0, [true, false, true]]]},
            "states": {"structure": "/a/structure.bin"}, "clocks": {"stage": 0.0}}"#;
        serde_json::from_str(text).expect("data of a stage")
    }

    #[test]
    fn data_of_a_stage_are_read() {
        let data = data();
        assert_eq!(data.number("fabric.thickness_m"), Ok(4e-5));
        assert_eq!(data.stage_number("window_s"), Ok(5e-3));
        assert_eq!(data.number("stage.1.window_s"), Ok(5e-3));
        assert!(data.is_coupled() && data.structure.fixed[0].1 == [true, false, true]);
        assert_eq!(data.structure.cables[0].rest_length, 2.4);
    }

    #[test]
    fn what_is_missing_is_named() {
        for key in
            ["fabric.density_kg_m3", "fabric.wrinkling", "lines.area_m2", "stage.2.window_s", "stage.x"]
        {
            let message = data().number(key).expect_err(key).message;
            assert!(message.contains(key), "{message}");
        }
        assert!(data().stage_number("substeps").expect_err("none").message.contains("stage 1"));
        assert!(data().flow_grid().expect_err("none").message.contains("run.data(true)"));
    }
}
