//! What `ripstop accuracy` studies of a scene: quantities, and parameters with their values. Runs
//! do not read this section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A study of accuracy against cost. What is absent is chosen to fit the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Accuracy {
    /// Stage whose windows and substeps are varied, and whose history the quantities are of.
    /// Absent: the last one.
    pub stage: Option<String>,
    /// Quantities whose errors are estimated.
    #[serde(rename = "quantity")]
    pub quantities: Vec<Quantity>,
    /// Numerical parameters that trade accuracy for time.
    #[serde(rename = "parameter", alias = "dial")]
    pub parameters: Vec<Parameter>,
    /// Names of parameters with equally many values that are also varied together, first values
    /// with first values: coarse, medium, fine.
    pub sweep: Vec<String>,
    /// Values beyond the finest of the sweep: one number for each of its parameters. The sample is
    /// used for no estimate: it tests the stated uncertainty.
    pub sweep_check: Vec<f64>,
}

/// A number computed from the results of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Quantity {
    /// Name in the report.
    pub name: String,
    /// What is measured.
    pub of: Measured,
    /// Statistic of the history over time. Absent: the mean for speeds and forces of the air, the maximum for line
    /// tension, else the last value.
    #[serde(alias = "take")]
    pub statistic: Option<Statistic>,
    /// Stage. Absent: that of the study.
    pub stage: Option<String>,
    /// From this time of the stage on, s. Absent: from the middle of the stage.
    pub from_s: Option<f64>,
    /// Up to this time, s. Absent: to the end.
    pub to_s: Option<f64>,
    /// For `probe`: its name and column, such as `centre_p_pa`; for `history`: the column.
    pub column: Option<String>,
    /// For `displacement`: the canopy node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// For `displacement`: its component along this direction, of any length. Absent: its size.
    pub direction: Option<[f64; 3]>,
    /// The exact answer. Absent: it is extrapolated.
    pub exact: Option<f64>,
    /// What errors are shares of. Absent: the answer itself.
    pub scale: Option<f64>,
}

/// What can be measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Measured {
    /// Downwards, m/s.
    DescentSpeed,
    /// Force of the air on the canopy, upwards, N.
    Drag,
    /// Drag over dynamic pressure and reference area.
    DragCoefficient,
    /// Largest tension of a line, N.
    LineTension,
    /// Vertical force of the risers on the payload, N.
    RiserForce,
    /// Vertical load of the pressure on the structure, N.
    VerticalLoad,
    /// Area of the canopy seen from above, m2.
    ProjectedArea,
    /// Volume under the canopy, m3.
    Volume,
    /// Area of the openings in the canopy, m2; at the end of the stage.
    VentArea,
    /// Displacement of a canopy node, m; at the end of the stage.
    Displacement,
    /// Strain energy of the structure, J.
    StrainEnergy,
    /// Kinetic energy of the structure, J.
    KineticEnergy,
    /// Energy that the coupling added, J.
    CouplingEnergy,
    /// Smallest scaled Jacobian of the grid.
    GridQuality,
    /// Smallest volume of a cell over its volume at the start.
    GridVolumeRatio,
    /// Largest gauge pressure in the air, Pa.
    MaxPressure,
    /// Smallest gauge pressure in the air, Pa.
    MinPressure,
    /// A column of `probes.csv`.
    Probe,
    /// A column of `history.csv`.
    History,
}

/// Statistic of a history over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// Mean over time.
    Mean,
    /// Largest.
    Max,
    /// Smallest.
    Min,
    /// Last.
    End,
    /// Root of the mean of squares.
    Rms,
}

/// A parameter with its values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Parameter {
    /// `structure-grid`, `flow-grid`, `grid` (both), `window`, `substeps`, `coupling-tolerance`,
    /// `flow-drop`, `newton-tolerance`, `gmres-tolerance`, `static-tolerance`, `mover-tolerance`,
    /// `scheme`, `method`, an effect of `ripstop effects`, or a dotted key of the scene.
    pub name: String,
    /// Numbers. Grids, `window` and `substeps`: refinement factors relative to the scene (2: cells
    /// half as long, windows half as long, twice as many substeps). All others: the value itself.
    pub values: Vec<f64>,
    /// Words: schemes as in `ripstop stability --scheme`, flow methods (`fitted`, `immersed:SPACING` in metres), `on` and `off` for effects.
    pub choices: Vec<String>,
    /// Its value while other parameters are varied. Absent: the scene's own.
    pub base: Option<f64>,
    /// The same for words.
    pub base_choice: Option<String>,
    /// Formal order of the method. Absent: 2 for grids and times, 1 for tolerances.
    pub order: Option<f64>,
    /// Finer than all values: used for no estimate, it tests the stated uncertainty.
    pub check: Option<f64>,
}
