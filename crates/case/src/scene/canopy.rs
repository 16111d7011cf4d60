//! `[canopy]`: geometry of fabric, lines and payload.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cable_groups::{self, CableGroup};
use super::cross::{self, CrossCanopy};
use super::fabric_groups::{self, FabricGroup};
use super::gored::{self, GoredCanopy};
use super::pattern::{self, PatternCanopy};
use crate::check::Check;
use crate::{Scene, Stage, StageKind};

/// Geometry of fabric, lines and payload. Lengths are of the unstressed state.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Canopy {
    /// The cross parachute of the paper (Table 2): a square top with four arms.
    Atps(Atps),
    /// A flat square canopy with lines from its rim to one confluence point.
    Square(FlatCanopy),
    /// A flat circular canopy with lines from its rim to one confluence point.
    Circular(FlatCanopy),
    /// A canopy of gores around a crown vent: flat circular, conical, hemispherical, or of sections along the gores (extended skirt, annular, ringslot,
    /// disk-gap-band), with a line from each seam to one confluence point, or to those of `[canopy.risers]`. A flow needs `[flow.immersed]`.
    Gored(GoredCanopy),
    /// A flat cross of two equal panels, arms not stitched, with lines from the ends of the arms to one confluence point, or to those of `[canopy.risers]`. A flow needs `[flow.immersed]`.
    Cross(CrossCanopy),
    /// The square air bag of the paper, section 1.4: one octant by symmetry.
    AirBag(AirBag),
    /// A surface mesh from a Gmsh file (format 4.1, metres); a flow needs `[flow.grid_file]`.
    ///
    /// Triangles and quadrilaterals of the file are fabric; where the file has a volume grid too, those of the physical
    /// group `canopy`. Physical groups named `lines`, `risers` and `reinforcements` are cables at their rest length;
    /// `fixed`, `fixed-x`, `fixed-y` and `fixed-z` hold nodes; `payload` is the point of the payload. `[[canopy.cable]]` gives groups of curves
    /// sections, unstretched lengths and pretensions of their own, `[[canopy.fabric]]` groups of surfaces a cloth of their own.
    Gmsh(GmshCanopy),
    /// A canopy sewn from flat panels, whose outlines, seams and attachments a pattern file gives (TOML, metres). Fabric is without stress where each panel is
    /// flat; the mesh starts from an assembled shape without tension. A flow needs `[flow.immersed]`.
    Pattern(PatternCanopy),
    /// A flat rectangular panel in the plane z = 0, its middle at the origin; a flow needs `[flow.box]`.
    ///
    /// It has no stiffness across its plane except that of `fabric.prestress_pa` and `fabric.bending_stiffness_n_m`.
    Panel(PanelCanopy),
    /// No canopy: the flow around rigid bodies alone, which are wall patches of `[flow.grid_file]`. All stages are of kind
    /// `flow-only`; `[fabric]` and `[lines]` are left out.
    None,
}

/// The ATPS cross parachute. Defaults are Table 2 of the paper.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Atps {
    /// Width of the square top, m.
    pub top_width_m: f64,
    /// Width of an arm at the hem, m.
    pub bottom_edge_width_m: f64,
    /// Length of an arm along its middle line, m.
    pub arm_length_m: f64,
    /// Length over which adjacent arms are stitched, m.
    pub stitching_height_m: f64,
    /// The end of the arms that is stitched.
    pub stitched_end: StitchedEnd,
    /// Unstretched length of a suspension line, m.
    pub suspension_line_length_m: f64,
    /// Unstretched length of a riser, m.
    pub riser_length_m: f64,
    /// Suspension lines for each arm.
    pub lines_per_arm: u32,
    /// Cable elements for each suspension line.
    pub segments_per_line: u32,
    /// Quadrilaterals across the top and across each arm (even).
    pub cells_across: u32,
    /// Quadrilaterals along an arm above the stitching (the vent).
    pub cells_along_vent: u32,
    /// Quadrilaterals along the stitched part of an arm.
    pub cells_along_stitching: u32,
    /// Former form of `[tapes]`: line elements along the panel edges (hem, seams, vents), sharing canopy
    /// nodes, with the section and stiffness of the suspension lines.
    pub reinforcements: bool,
    /// Former form of `[tapes.grid]`. With `reinforcements`: quadrilaterals between further line elements that run
    /// along and across all panels, a grid of tapes that depends on the mesh. 0: none.
    pub reinforcement_spacing_cells: u32,
}

impl Default for Atps {
    fn default() -> Self {
        Self {
            top_width_m: 6.43128,
            bottom_edge_width_m: 6.09600,
            arm_length_m: 3.93192,
            stitching_height_m: 0.73152,
            stitched_end: StitchedEnd::Hem,
            suspension_line_length_m: 6.40080,
            riser_length_m: 1.21920,
            lines_per_arm: 7,
            segments_per_line: 1,
            cells_across: 18,
            cells_along_vent: 9,
            cells_along_stitching: 2,
            reinforcements: false,
            reinforcement_spacing_cells: 0,
        }
    }
}

/// The end of the arms at which adjacent arms are stitched together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StitchedEnd {
    /// At the hem: the vents are slits between the stitching and the top.
    Hem,
    /// At the top: the slits run down to the hem.
    Top,
}

/// A flat canopy cut from one sheet.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlatCanopy {
    /// Side of the square, or diameter of the circle, m.
    pub width_m: f64,
    /// Quadrilaterals across (even).
    pub cells_across: u32,
    /// Lines from the rim to the confluence point. 0: the rim is fixed instead.
    #[serde(default)]
    pub line_count: u32,
    /// Unstretched length of a line, m.
    #[serde(default)]
    pub line_length_m: f64,
    /// Cable elements for each line.
    #[serde(default = "one")]
    pub segments_per_line: u32,
}

pub(super) fn one() -> u32 {
    1
}

/// One octant of the square air bag of the paper: a quarter of the upper sheet.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AirBag {
    /// Edge of the whole square bag, m.
    pub edge_m: f64,
    /// Quadrilaterals along each side of the quarter sheet.
    pub cells_across: u32,
}

impl Default for AirBag {
    fn default() -> Self {
        Self { edge_m: 0.3048, cells_across: 50 }
    }
}

/// A canopy from a Gmsh file (format 4.1, metres). Its triangles and quadrilaterals
/// are fabric; together with a volume grid, only those of the physical group `canopy`. Physical groups named `lines`, `risers` and
/// `reinforcements` are cables at their rest length; `fixed`, `fixed-x`, `fixed-y`
/// and `fixed-z` hold nodes; `payload` is the payload's point.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GmshCanopy {
    /// The file, from the scene's folder.
    pub file: PathBuf,
    /// Kinds of cables, by physical groups of curves.
    #[serde(default, rename = "cable")]
    pub cables: Vec<CableGroup>,
    /// Kinds of cloth, by physical groups of surfaces.
    #[serde(default, rename = "fabric")]
    pub fabrics: Vec<FabricGroup>,
}

/// A flat rectangular panel in the plane z = 0, its middle at the origin. It has no
/// stiffness across its plane but for `fabric.prestress_pa` and `fabric.bending_stiffness_n_m`.
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

impl Scene {
    /// Whether the canopy has suspension lines or reinforcements.
    pub fn has_cables(&self) -> bool {
        match &self.canopy {
            Canopy::Atps(_) => true,
            Canopy::Square(f) | Canopy::Circular(f) => f.line_count > 0,
            Canopy::Gored(_) | Canopy::Cross(_) => true,
            Canopy::Pattern(p) => p.line_length_m.is_some(),
            // A file may have none; what it has needs [lines], which the structure checks.
            Canopy::AirBag(_) | Canopy::Gmsh(_) | Canopy::Panel(_) | Canopy::None => false,
        }
    }

    /// Kinds of cables that the scene names for groups of a mesh file.
    pub fn cable_groups(&self) -> &[CableGroup] {
        match &self.canopy {
            Canopy::Gmsh(g) => &g.cables,
            _ => &[],
        }
    }

    /// Whether there is a canopy.
    pub fn has_canopy(&self) -> bool {
        !matches!(self.canopy, Canopy::None)
    }

    /// Whether the canopy has fabric. A Gmsh canopy of a scene without `[fabric]` has cables alone.
    pub fn has_fabric(&self) -> bool {
        self.has_canopy() && !self.fabric.is_absent()
    }

    /// Whether lines or reinforcements are known or may come with a file.
    pub(crate) fn may_have_cables(&self) -> bool {
        self.has_cables() || matches!(self.canopy, Canopy::Gmsh(_))
    }

    /// Whether the unstressed canopy has slits that open when it inflates.
    pub(crate) fn has_vents(&self) -> bool {
        matches!(self.canopy, Canopy::Atps(_))
    }
}

impl Canopy {
    /// The file that it is read from, if any.
    pub fn file(&self) -> Option<&PathBuf> {
        match self {
            Canopy::Gmsh(g) => Some(&g.file),
            Canopy::Pattern(p) => Some(&p.file),
            _ => None,
        }
    }

    /// As [`Canopy::file`], to change its path.
    pub fn file_mut(&mut self) -> Option<&mut PathBuf> {
        match self {
            Canopy::Gmsh(g) => Some(&mut g.file),
            Canopy::Pattern(p) => Some(&mut p.file),
            _ => None,
        }
    }
}

/// What a length of `[canopy]` is.
pub(super) const LENGTH: &str = "a length in metres";

/// Refuses geometries that cannot be cut, sewn or meshed, and lines without material.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    match &scene.canopy {
        Canopy::Atps(a) => {
            atps_lengths(a, c);
            atps_cells(a, c);
        }
        Canopy::Square(f) | Canopy::Circular(f) => flat(f, c),
        Canopy::Gored(g) => gored::check(g, scene.tapes.as_ref().is_some_and(|t| t.seams.is_some()), c),
        Canopy::Cross(x) => cross::check(x, c),
        Canopy::Pattern(p) => pattern::check(p, scene, c),
        Canopy::AirBag(a) => {
            c.positive("canopy.edge_m", a.edge_m, 200.0, LENGTH);
            c.count("canopy.cells_across", a.cells_across, 2..=2000, "cells along the quarter sheet");
        }
        Canopy::Panel(p) => panel(p, c),
        Canopy::None => none(scene, c),
        Canopy::Gmsh(g) => {
            if !g.file.is_file() {
                c.refuse(
                    "canopy.file",
                    format!("the mesh file {} does not exist", g.file.display()),
                    "name a Gmsh file (4.1, ASCII) by its path from the scene's folder",
                );
            }
            cable_groups::check(&g.cables, c);
            fabric_groups::check(&g.fabrics, scene, c);
        }
    }
    if scene.lines.is_none() && scene.has_cables() {
        c.refuse(
            "canopy",
            "the canopy has lines but the scene has no [lines]",
            "add [lines] with their material",
        );
    }
}

/// Refuses what a scene without a canopy cannot have.
fn none(scene: &Scene, c: &mut Check) {
    if scene.grid_file().is_none() {
        c.refuse(
            "canopy.kind",
            "no grid can be generated without a canopy",
            "add [flow.grid_file] with the body as a patch \"wall\", or name a kind of canopy",
        );
    }
    let surface = scene.flow.as_ref().is_some_and(|f| f.surface_pressure.is_some());
    for (key, given) in [
        ("fabric", !scene.fabric.is_absent()),
        ("lines", scene.lines.is_some()),
        ("risers", scene.risers.is_some()),
        ("tapes", scene.tapes.is_some()),
        ("fabric_gravity", scene.fabric_gravity.is_some()),
        ("reefing", !scene.reefing.is_empty()),
        ("point_mass", !scene.point_masses.is_empty()),
        ("flow.surface_pressure", surface),
    ] {
        if given {
            c.refuse(key, format!("`{key}` belongs to a canopy, and canopy.kind is \"none\""), "remove it");
        }
    }
    let without_canopy = |s: &Stage| match s.kind {
        StageKind::FlowOnly | StageKind::Trajectory => true,
        StageKind::Prescribed => s.motions.is_empty(),
        StageKind::Coupled | StageKind::PreInflation => false,
    };
    for (k, s) in scene.stages.iter().enumerate().filter(|(_, s)| !without_canopy(s)) {
        c.refuse(
            &format!("stage[{k}].kind"),
            format!("stage \"{}\" moves a canopy, and canopy.kind is \"none\"", s.name),
            "use kind = \"flow-only\", or \"prescribed\" with [[stage.body_motion]] instead of [[stage.motion]], or name a kind of canopy",
        );
    }
}

fn atps_lengths(a: &Atps, c: &mut Check) {
    for (path, value) in [
        ("canopy.top_width_m", a.top_width_m),
        ("canopy.bottom_edge_width_m", a.bottom_edge_width_m),
        ("canopy.arm_length_m", a.arm_length_m),
        ("canopy.stitching_height_m", a.stitching_height_m),
        ("canopy.suspension_line_length_m", a.suspension_line_length_m),
        ("canopy.riser_length_m", a.riser_length_m),
    ] {
        c.positive(path, value, 200.0, LENGTH);
    }
    if a.stitching_height_m >= a.arm_length_m {
        c.refuse(
            "canopy.stitching_height_m",
            format!(
                "the stitching ({} m) is as long as the arm ({} m)",
                a.stitching_height_m, a.arm_length_m
            ),
            "leave a vent: stitch less than the length of the arm",
        );
    }
    if (a.top_width_m - a.bottom_edge_width_m).abs() / 2.0 >= a.arm_length_m {
        c.refuse(
            "canopy.arm_length_m",
            format!("the arm ({} m) cannot reach from the top edge to the hem", a.arm_length_m),
            "make it longer than half the difference of the two widths",
        );
    }
    if a.suspension_line_length_m <= a.bottom_edge_width_m / 2.0 {
        c.refuse(
            "canopy.suspension_line_length_m",
            format!("lines of {} m cannot reach from the hem to a point", a.suspension_line_length_m),
            "make them longer than half the bottom edge",
        );
    }
}

fn atps_cells(a: &Atps, c: &mut Check) {
    even_cells(a.cells_across, c);
    c.count("canopy.cells_along_vent", a.cells_along_vent, 2..=2000, "cells along the vent");
    c.count("canopy.cells_along_stitching", a.cells_along_stitching, 1..=2000, "cells along the stitching");
    c.count("canopy.lines_per_arm", a.lines_per_arm, 2..=1000, "suspension lines for each arm");
    line_segments(a.segments_per_line, c);
    if a.lines_per_arm > a.cells_across + 1 {
        c.refuse(
            "canopy.lines_per_arm",
            format!("{} lines do not fit on {} hem nodes", a.lines_per_arm, a.cells_across + 1),
            "use fewer lines or more cells across",
        );
    }
}

fn flat(f: &FlatCanopy, c: &mut Check) {
    c.positive("canopy.width_m", f.width_m, 200.0, LENGTH);
    even_cells(f.cells_across, c);
    line_segments(f.segments_per_line, c);
    if f.line_count > 0 && f.line_length_m <= f.width_m / 2.0 {
        c.refuse(
            "canopy.line_length_m",
            format!("lines of {} m cannot reach from the rim to a point below the middle", f.line_length_m),
            format!("make them longer than half the width ({} m)", f.width_m / 2.0),
        );
    }
}

pub(super) fn even_cells(cells: u32, c: &mut Check) {
    even("canopy.cells_across", cells, 2..=2000, "cells across a panel", c);
}

pub(super) fn even(path: &str, count: u32, range: std::ops::RangeInclusive<u32>, what: &str, c: &mut Check) {
    c.count(path, count, range, what);
    if count % 2 == 1 {
        c.refuse(
            path,
            format!("`{path}` is {count}, which is odd"),
            "an even number keeps the canopy's symmetry",
        );
    }
}

pub(super) fn line_segments(segments: u32, c: &mut Check) {
    c.count("canopy.segments_per_line", segments, 1..=1000, "cable elements for each line");
}

fn panel(p: &PanelCanopy, c: &mut Check) {
    for (i, (length, cells)) in p.size_m.into_iter().zip(p.cells).enumerate() {
        c.positive(&format!("canopy.size_m[{i}]"), length, 200.0, LENGTH);
        c.count(&format!("canopy.cells[{i}]"), cells, 1..=2000, "cells along the panel");
    }
}
