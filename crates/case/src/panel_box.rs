//! A panel of fabric in a box of air: the model problem of fluid-structure coupling,
//! small enough for families of runs, with closed-form answers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::validate::Check;
use crate::{Canopy, Condition, Scene, StageKind};

/// A flat rectangular panel in the plane z = 0, its middle at the origin. It has no
/// stiffness across its plane but for `fabric.prestress_pa`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PanelCanopy {
    /// Lengths along x and y, m.
    pub size_m: [f64; 2],
    /// Quadrilaterals along x and y.
    pub cells: [u32; 2],
    /// The edges that are held.
    #[serde(default)]
    pub held: PanelEdges,
}

/// Edges of a panel that are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PanelEdges {
    /// All four.
    #[default]
    All,
    /// Both ends along x; the sides slide in their planes y = const.
    Ends,
    /// The end at low x; the other end is free, the sides slide in their planes.
    Root,
}

/// Hexahedra in a box around a panel, in the place of `[flow.grid]`: the canopy's own cells
/// continued to the walls below and above, and beyond its ends where asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlowBox {
    /// From the panel down to the bottom of the box, m.
    pub below_m: f64,
    /// From the panel up to the top of the box, m.
    pub above_m: f64,
    /// Cells below the panel.
    pub layers_below: u32,
    /// Cells above the panel.
    pub layers_above: u32,
    /// Thickness of the cells at the panel, m; they grow by a constant factor from there.
    /// Absent: all cells of a side are equal.
    pub first_layer_m: Option<f64>,
    /// Length of the box before the panel (towards low x), m.
    #[serde(default)]
    pub ahead_m: f64,
    /// Cells along it.
    #[serde(default)]
    pub cells_ahead: u32,
    /// Length of the box behind the panel (towards high x), m.
    #[serde(default)]
    pub behind_m: f64,
    /// Cells along it.
    #[serde(default)]
    pub cells_behind: u32,
    /// Conditions on the sides of the box.
    #[serde(default)]
    pub sides: BoxSides,
}

/// Conditions on the sides of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BoxSides {
    /// Low x.
    pub left: Condition,
    /// High x.
    pub right: Condition,
    /// Low y.
    pub front: Condition,
    /// High y.
    pub back: Condition,
    /// Low z.
    pub bottom: Condition,
    /// High z.
    pub top: Condition,
}

impl Default for BoxSides {
    fn default() -> Self {
        let slip = Condition::Slip;
        Self { left: slip, right: slip, front: slip, back: slip, bottom: slip, top: slip }
    }
}

impl BoxSides {
    /// Low and high x, low and high y, low and high z.
    pub fn in_order(&self) -> [Condition; 6] {
        [self.left, self.right, self.front, self.back, self.bottom, self.top]
    }
}

pub(crate) fn panel(p: &PanelCanopy, c: &mut Check) {
    for (i, (length, cells)) in p.size_m.into_iter().zip(p.cells).enumerate() {
        c.positive(&format!("canopy.size_m[{i}]"), length, 200.0, "a length in metres");
        c.count(&format!("canopy.cells[{i}]"), cells, 1, 2000, "cells along the panel");
    }
}

/// What a box and a panel need of each other.
pub(crate) fn flow_box(scene: &Scene, c: &mut Check) {
    let Some(flow) = &scene.flow else { return };
    let is_panel = matches!(scene.canopy, Canopy::Panel(_));
    let Some(b) = &flow.box_grid else {
        if is_panel
            && flow.grid_file.is_none()
            && scene.stages.iter().any(|s| s.kind != StageKind::PreInflation)
        {
            c.refuse(
                "flow",
                "a panel has no generated grid around it",
                "add [flow.box], or [flow.grid_file]",
            );
        }
        return;
    };
    if !is_panel {
        c.refuse(
            "flow.box",
            "a box fits around a panel only",
            "remove [flow.box], or set canopy.kind = \"panel\"",
        );
    }
    if flow.grid_file.is_some() {
        c.refuse("flow.box", "the scene has two grids", "remove [flow.box] or [flow.grid_file]");
    }
    const LENGTH: &str = "a length in metres";
    c.positive("flow.box.below_m", b.below_m, 1e4, LENGTH);
    c.positive("flow.box.above_m", b.above_m, 1e4, LENGTH);
    c.count("flow.box.layers_below", b.layers_below, 2, 1000, "cells");
    c.count("flow.box.layers_above", b.layers_above, 2, 1000, "cells");
    if let Some(first) = b.first_layer_m {
        let equal = (b.below_m / f64::from(b.layers_below)).min(b.above_m / f64::from(b.layers_above));
        c.positive("flow.box.first_layer_m", first, equal, "at most the height of equal layers");
    }
    for (key, length, cells) in [("ahead", b.ahead_m, b.cells_ahead), ("behind", b.behind_m, b.cells_behind)]
    {
        c.range(&format!("flow.box.{key}_m"), length, 0.0, 1e4, true, LENGTH);
        c.count(&format!("flow.box.cells_{key}"), cells, 0, 2000, "cells");
        if (length > 0.0) != (cells > 0) {
            c.refuse(
                &format!("flow.box.cells_{key}"),
                format!("{length} m of the box have {cells} cells"),
                format!("give both `{key}_m` and `cells_{key}`, or none"),
            );
        }
    }
}
