//! `[flow.grid]`, `[flow.grid_file]` and `[flow.box]`: the cells around the canopy.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{Canopy, Flow, Role, Scene};

/// The volume grid: hexahedra in shells around the canopy.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Grid {
    /// Cells between the canopy and the core block inside it.
    pub layers_inside: u32,
    /// Cells between the canopy and the far field.
    pub layers_outside: u32,
    /// Thickness of the cells at the canopy, m.
    pub first_layer_m: f64,
    /// Distance of the far field from the canopy's middle, in canopy widths.
    pub far_field_widths: f64,
    /// The same, downstream (above the canopy).
    pub wake_widths: f64,
    /// Cells across each vent.
    pub cells_across_vent: u32,
}

impl Default for Grid {
    fn default() -> Self {
        Self {
            layers_inside: 8,
            layers_outside: 22,
            first_layer_m: 0.12,
            far_field_widths: 6.0,
            wake_widths: 10.0,
            cells_across_vent: 2,
        }
    }
}

/// A volume grid from a Gmsh file (format 4.1, ASCII or binary, first-order elements,
/// metres, falling frame) instead of the generated one. It must fit around the
/// canopy as the flow's stages start with it, node by node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridFile {
    /// The file, from the scene's folder.
    pub path: PathBuf,
    /// Physical group of the faces that are the canopy: inside the volume, between two
    /// cells that share their nodes; with `one_sided` on the boundary of the volume.
    #[serde(default = "canopy")]
    pub membrane: String,
    /// Fluid is on one side of every canopy face only. Absent: on both sides.
    pub one_sided: Option<OneSided>,
    /// Condition on each physical group of outer faces.
    pub patches: BTreeMap<String, Condition>,
    /// Pairs of patches with the condition `periodic`: the second is the first, translated.
    #[serde(default)]
    pub periodic: Vec<[String; 2]>,
}

fn canopy() -> String {
    "canopy".into()
}

/// A canopy with fluid on one side only. On the other side is a uniform pressure, without fluid and inertia.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OneSided {
    /// Pressure on the side without cells, Pa above the pressure of the undisturbed air.
    pub ambient_pressure_pa: f64,
}

/// Condition on an outer boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// Undisturbed air far away.
    FarField,
    /// Gauge pressure of zero or of `[[flow.outlet]]`, the rest from inside.
    Outlet,
    /// No slip, moving with the grid; with `[[flow.moving_wall]]` also along it.
    Wall,
    /// No flow through, no friction.
    Slip,
    /// Mirror plane.
    Symmetry,
    /// Velocity of the undisturbed air or of `[[flow.inlet]]`, pressure from inside: the fan of a wind tunnel.
    Inlet,
    /// One of two patches that are the same but for a translation: what leaves through one enters through the other. In a box, opposite
    /// sides; in a grid file, a pair of `flow.grid_file.periodic`. Its nodes are at rest; the canopy does not touch it.
    Periodic,
}

impl Condition {
    /// As a scene writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::FarField => "far-field",
            Self::Outlet => "outlet",
            Self::Wall => "wall",
            Self::Slip => "slip",
            Self::Symmetry => "symmetry",
            Self::Inlet => "inlet",
            Self::Periodic => "periodic",
        }
    }
}

/// Hexahedra in a box around a panel, instead of `[flow.grid]`: the canopy's own cells
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
    /// Names of the sides, in the order of [`BoxSides::in_order`].
    pub const NAMES: [&str; 6] = ["left", "right", "front", "back", "bottom", "top"];

    /// Low and high x, low and high y, low and high z.
    pub fn in_order(&self) -> [Condition; 6] {
        [self.left, self.right, self.front, self.back, self.bottom, self.top]
    }
}

/// Refuses sizes of the generated grid.
pub(super) fn generated(g: &Grid, c: &mut Check) {
    c.count("flow.grid.layers_inside", g.layers_inside, 2..=500, "cells");
    c.count("flow.grid.layers_outside", g.layers_outside, 4..=1000, "cells");
    c.count("flow.grid.cells_across_vent", g.cells_across_vent, 1..=100, "cells");
    c.positive("flow.grid.first_layer_m", g.first_layer_m, 10.0, "a length in metres");
    c.range("flow.grid.far_field_widths", g.far_field_widths, 1.5..=1000.0, "in canopy widths");
    c.range("flow.grid.wake_widths", g.wake_widths, 1.5..=1000.0, "in canopy widths");
}

/// Patches of a grid at most: they are numbered in 16 bits, the largest number means none.
const MAX_PATCHES: usize = u16::MAX as usize;

/// Refuses inlets where no other boundary lets the pressure adjust.
fn has_an_exit(key: &str, conditions: impl IntoIterator<Item = Condition>, c: &mut Check) {
    let (mut inlet, mut exit) = (false, false);
    for condition in conditions {
        inlet |= condition == Condition::Inlet;
        exit |= matches!(condition, Condition::Outlet | Condition::FarField);
    }
    if inlet && !exit {
        c.refuse(
            key,
            "an \"inlet\" prescribes the mass that enters, but no boundary lets it leave",
            "set at least one of them to \"outlet\" or \"far-field\"",
        );
    }
}

/// Refuses a file that is not there, and conditions that do not fit together.
pub(super) fn from_file(f: &Flow, c: &mut Check) {
    if let Some(g) = &f.grid_file {
        has_an_exit("flow.grid_file.patches", g.patches.values().copied(), c);
        periodic_pairs(g, c);
        one_sided(g, c);
        if g.patches.len() > MAX_PATCHES {
            c.refuse(
                "flow.grid_file.patches",
                format!("the grid file has {} patches", g.patches.len()),
                format!("use at most {MAX_PATCHES}"),
            );
        }
    }
    if let Some(g) = f.grid_file.as_ref().filter(|g| !g.path.is_file()) {
        c.refuse(
            "flow.grid_file.path",
            format!("the grid file {} does not exist", g.path.display()),
            "name a Gmsh file (4.1) by its path from the scene's folder",
        );
    }
}

/// Refuses an ambient pressure out of range.
fn one_sided(g: &GridFile, c: &mut Check) {
    if let Some(o) = g.one_sided {
        c.range(
            "flow.grid_file.one_sided.ambient_pressure_pa",
            o.ambient_pressure_pa,
            -1e7..=1e7,
            "a pressure in Pa",
        );
    }
}

/// Refuses a canopy with fluid on one side only, where the other side is needed.
pub(super) fn around_one_sided(scene: &Scene, c: &mut Check) {
    if !scene.is_one_sided() {
        return;
    }
    const KEY: &str = "flow.grid_file.one_sided";
    if scene.has_permeable_fabric() {
        c.refuse(
            KEY,
            "air that passes permeable fabric would enter a side without fluid",
            "remove fabric.permeability, or give the grid cells on both sides and remove `one_sided`",
        );
    }
    if scene.flow.as_ref().is_some_and(Flow::is_immersed) {
        c.refuse(
            KEY,
            "an immersed canopy has fluid on both sides",
            "remove [flow.immersed], or remove `one_sided`",
        );
    }
    if !scene.has_canopy() {
        c.refuse(KEY, "the scene has no canopy", "remove `one_sided`");
    }
}

impl Scene {
    /// Pressure on the side of the canopy without fluid, Pa above that of the undisturbed air; 0 with fluid on both sides.
    pub fn ambient_pressure(&self) -> f64 {
        self.grid_file().and_then(|g| g.one_sided).map_or(0.0, |o| o.ambient_pressure_pa)
    }

    /// Whether fluid is on one side of the canopy only ([`GridFile::one_sided`]).
    pub fn is_one_sided(&self) -> bool {
        self.grid_file().is_some_and(|g| g.one_sided.is_some())
    }
}

/// Refuses pairs of patches that are no pairs, and periodic patches without one.
fn periodic_pairs(g: &GridFile, c: &mut Check) {
    const KEY: &str = "flow.grid_file.periodic";
    let periodic = |name: &String| g.patches.get(name) == Some(&Condition::Periodic);
    let listed = || g.periodic.iter().flatten();
    for (k, name) in listed().enumerate() {
        let at = format!("{KEY}[{}]", k / 2);
        if !periodic(name) {
            let what = match g.patches.get(name) {
                Some(other) => format!("the patch \"{name}\" has the condition \"{}\"", other.name()),
                None => format!("the grid file has no patch \"{name}\""),
            };
            c.refuse(
                &at,
                what,
                format!("set {name} = \"periodic\" in [flow.grid_file.patches], or remove the pair"),
            );
        } else if listed().take(k).any(|earlier| earlier == name) {
            c.refuse(
                &at,
                format!("the patch \"{name}\" occurs twice"),
                "name each periodic patch in one pair",
            );
        }
    }
    for name in g.patches.keys().filter(|name| periodic(name) && !listed().any(|n| n == *name)) {
        c.refuse(
            &format!("flow.grid_file.patches.{name}"),
            format!("the periodic patch \"{name}\" has no partner"),
            format!("add `periodic = [[\"{name}\", \"...\"]]` to [flow.grid_file]"),
        );
    }
}

/// Refuses sides of a box whose opposite side is not periodic too, and those that the panel touches.
fn periodic_sides(b: &FlowBox, c: &mut Check) {
    let sides = b.sides.in_order();
    let names = BoxSides::NAMES;
    let beyond = |side: usize| match side {
        0 => b.cells_ahead > 0,
        1 => b.cells_behind > 0,
        2 | 3 => false,
        _ => true,
    };
    for (k, name) in names.iter().enumerate().filter(|(k, _)| sides[*k] == Condition::Periodic) {
        let opposite = k ^ 1;
        let at = format!("flow.box.sides.{name}");
        if sides[opposite] != Condition::Periodic {
            let what = format!("the opposite side is \"{}\"", sides[opposite].name());
            c.refuse(&at, what, format!("set {} = \"periodic\" too", names[opposite]));
        } else if !beyond(k) {
            let remedy = if k < 2 {
                "add cells between them: `ahead_m`, `cells_ahead`, `behind_m` and `cells_behind`"
            } else {
                "use \"slip\" or \"symmetry\", or a grid file with cells between them"
            };
            c.refuse(&at, "the panel touches this side", remedy);
        }
    }
}

/// What a box and a panel need of each other.
pub(super) fn around_panel(scene: &Scene, flow: &Flow, c: &mut Check) {
    let is_panel = matches!(scene.canopy, Canopy::Panel(_));
    let Some(b) = &flow.box_grid else {
        let flows = scene.stages.iter().any(|s| s.kind.roles().contains(&Role::Flow));
        if is_panel && flow.grid_file.is_none() && flows {
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
    has_an_exit("flow.box.sides", b.sides.in_order(), c);
    periodic_sides(b, c);
    box_sizes(b, c);
}

fn box_sizes(b: &FlowBox, c: &mut Check) {
    const LENGTH: &str = "a length in metres";
    c.positive("flow.box.below_m", b.below_m, 1e4, LENGTH);
    c.positive("flow.box.above_m", b.above_m, 1e4, LENGTH);
    c.count("flow.box.layers_below", b.layers_below, 2..=1000, "cells");
    c.count("flow.box.layers_above", b.layers_above, 2..=1000, "cells");
    if let Some(first) = b.first_layer_m {
        let equal = (b.below_m / f64::from(b.layers_below)).min(b.above_m / f64::from(b.layers_above));
        c.positive("flow.box.first_layer_m", first, equal, "at most the height of equal layers");
    }
    for (key, length, cells) in [("ahead", b.ahead_m, b.cells_ahead), ("behind", b.behind_m, b.cells_behind)]
    {
        c.range(&format!("flow.box.{key}_m"), length, 0.0..=1e4, LENGTH);
        c.count(&format!("flow.box.cells_{key}"), cells, 0..=2000, "cells");
        if (length > 0.0) != (cells > 0) {
            c.refuse(
                &format!("flow.box.cells_{key}"),
                format!("{length} m of the box have {cells} cells"),
                format!("give both `{key}_m` and `cells_{key}`, or none"),
            );
        }
    }
}
