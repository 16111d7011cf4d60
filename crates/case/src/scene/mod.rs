//! What a user writes: one TOML file, typed.
//!
//! Every key carries its unit in its name. Unknown keys are refused. Sections
//! that are absent are effects that are off: they cost nothing.
//!
//! One file for each section holds its types, their defaults and the rules about its keys.

mod accuracy;
mod body_motion;
mod boundary_values;
mod cable_groups;
mod canopy;
mod canopy_risers;
mod coupling;
mod cross;
mod descent;
mod dryden;
mod fabric;
mod fabric_groups;
mod flow;
mod flow_grid;
mod gored;
mod gust;
mod immersed;
mod layout;
mod lines;
mod mesh;
mod monitors;
mod motions;
mod nodes;
mod output;
mod pattern;
mod perturbation;
mod programs;
mod random;
mod reefing;
mod resolved;
mod schema;
mod shear;
mod stages;
mod steady;
mod structure;
mod tapes;
mod times;
mod trajectory;
mod wind;

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::de::DeTable;

pub use accuracy::{Accuracy, Measured, Parameter, Quantity, Statistic};
pub use body_motion::{BodyMotion, BodyRotation, Pose, RigidMotion};
pub use boundary_values::{
    InletProfile, InletValues, MovingWall, OutletValues, ProfileTable, TimeFactor, TimeFunction, WallRotation,
};
pub use cable_groups::{CableGroup, CablePart};
pub use canopy::{AirBag, Atps, Canopy, FlatCanopy, GmshCanopy, PanelCanopy, PanelEdges, StitchedEnd};
pub use canopy_risers::CanopyRisers;
pub use coupling::{
    Acceleration, AdaptiveWindow, Coupling, CouplingOrder, LoadShape, MOST_PREDICTOR, Scheme, Staggered,
    StaggeredSequence,
};
pub use cross::CrossCanopy;
pub(crate) use descent::STANDARD_GRAVITY;
pub use descent::{Descent, DescentEquation, FrameMotion, PayloadBody, PayloadDrag};
pub(crate) use dryden::DrydenTurbulence;
pub use fabric::{Cloth, Contact, Fabric, FabricGravity, Law, Orthotropic, Permeability};
pub use fabric_groups::FabricGroup;
pub use flow::{
    Convection, Energy, Flow, FlowMethod, FlowSolver, GAS_CONSTANT, HEAT_RATIO, Limiter, Turbulence,
    Viscosity, WallTreatment,
};
pub use flow_grid::{BoxSides, Condition, FlowBox, Grid, GridFile, OneSided};
pub use gored::{GoreProfile, GoreSection, GoredCanopy};
pub use gust::{Gust, GustAxis, GustShape};
pub use immersed::{FlowDevice, Immersed};
pub use layout::*;
pub use lines::{LineDrag, Lines, MOST_HYSTERESIS};
pub use mesh::{MeshMotion, MoverKind, OuterBoundary, Regrid};
pub use monitors::{
    CANOPY, ForceCoefficients, Forces, Probe, Slice, Statistics, SurfacePressure, WatchedForce,
};
pub use motions::{Motion, NodeMotion, NodeRotation, interpolate};
pub use nodes::{Force, PointMass};
pub use output::{CanopyPoint, Output, Reaction};
pub use pattern::PatternCanopy;
pub use perturbation::Perturbation;
use programs::Programs;
pub use programs::{Ranks, Role};
pub use reefing::Reefing;
pub use resolved::{CanopyAir, Resolved, UndisturbedAir};
pub use schema::schema;
pub use shear::{FrozenTurbulence, LayeredTurbulence, Shear, ShearProfile, WindProfile};
pub use stages::{Discretisation, Solve, Stage, StageKind};
pub use steady::Steady;
pub use structure::{Integration, Mass, Membrane, Structure};
pub use tapes::{Risers, Tape, TapeGrid, TapePlace, Tapes};
pub use times::{StageTimes, save_time};
pub use trajectory::Trajectory;
pub use wind::{Clock, StageWind};

use crate::check::{Allowed, Check, NAME_OF_FOLDER, Refusal, plain_name};
use crate::error::{Problem, SceneError};
use crate::place::span_of;

/// A scene: what is simulated, with which effects, in which stages.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Short name; names the result folder.
    pub name: String,
    /// One line for people.
    #[serde(default)]
    pub title: String,
    /// Geometry of fabric, lines and payload.
    pub canopy: Canopy,
    /// Material of the fabric; needed where there is a canopy. A Gmsh canopy without it has cables alone.
    #[serde(default = "Fabric::absent")]
    pub fabric: Fabric,
    /// Material of suspension lines and risers; needed when the canopy has lines.
    pub lines: Option<Lines>,
    /// Section of the risers, where it is not that of the lines.
    pub risers: Option<Risers>,
    /// Tapes sewn on the fabric. Absent: none.
    pub tapes: Option<Tapes>,
    /// Time integration and solvers of the structure.
    #[serde(default)]
    pub structure: Structure,
    /// Air, flow grid and flow solver; needed when a stage runs the flow.
    pub flow: Option<Flow>,
    /// The grid motion solver.
    #[serde(default)]
    pub mesh: MeshMotion,
    /// Staggered or implicit coupling of the fields.
    #[serde(default)]
    pub coupling: Coupling,
    /// The falling mass. Absent: the canopy does not descend.
    pub descent: Option<Descent>,
    /// Gravity on fabric and lines, with the acceleration of the falling frame.
    pub fabric_gravity: Option<FabricGravity>,
    /// Reefing lines through the skirt.
    #[serde(default)]
    pub reefing: Vec<Reefing>,
    /// Masses on nodes, in addition to those of fabric, lines and payload.
    #[serde(default, rename = "point_mass")]
    pub point_masses: Vec<PointMass>,
    /// What runs, in this order. Each stage starts from the one before.
    #[serde(rename = "stage")]
    pub stages: Vec<Stage>,
    /// Snapshots and checkpoints.
    #[serde(default)]
    pub output: Output,
    /// Ranks per program.
    #[serde(default)]
    pub ranks: Ranks,
    /// Replaces the program of a role: `structure = "python3 my_solver.py"`.
    /// The run's arguments are appended.
    #[serde(default)]
    #[schemars(with = "Programs")]
    pub programs: BTreeMap<Role, String>,
    /// What `ripstop accuracy` studies. Absent: what fits the scene.
    pub accuracy: Option<Accuracy>,
}

impl Scene {
    /// The title; the name where there is none.
    pub fn heading(&self) -> &str {
        if self.title.is_empty() { &self.name } else { &self.title }
    }

    /// Name and title in one line.
    pub fn caption(&self) -> String {
        if self.title.is_empty() { self.name.clone() } else { format!("{}: {}", self.name, self.title) }
    }
}

/// Reads and validates a scene file.
///
/// # Examples
///
/// ```
/// # use std::path::Path;
/// let scene = case::load(Path::new("../../cases/square-drop/scene.toml"))?;
/// assert_eq!(scene.name, "square-drop");
/// let descent = &scene.stages[2];
/// assert_eq!((descent.kind, descent.windows()), (case::StageKind::Coupled, 20));
/// // A key that the file leaves out has its default.
/// assert_eq!(scene.coupling.max_iterations, 30);
/// # Ok::<(), case::SceneError>(())
/// ```
pub fn load(file: &Path) -> Result<Scene, SceneError> {
    let text = std::fs::read_to_string(file).map_err(|e| {
        SceneError::plain(
            file,
            format!("the scene cannot be read: {e}"),
            "name a scene file, such as cases/atps-descent/scene.toml",
        )
    })?;
    parse(file, &text)
}

/// Parses and validates the text of a scene; `file` is for messages.
///
/// # Examples
///
/// An error names the place, the key and the remedy:
///
/// ```
/// # use std::path::Path;
/// let text = std::fs::read_to_string("../../cases/square-drop/scene.toml")?;
/// let error = case::parse(Path::new("scene.toml"), &text.replace("thickness_m", "thikness_m")).unwrap_err();
/// assert!(error.to_string().contains("thikness_m"), "{error}");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn parse(file: &Path, text: &str) -> Result<Scene, SceneError> {
    let error = |problems| SceneError::new(file, text, problems);
    let mut document = DeTable::parse(text).map_err(|e| {
        error(vec![Problem::new(
            e.span(),
            format!("not TOML: {}", e.message().trim_end()),
            "see https://toml.io for the syntax",
        )])
    })?;
    let problems = schema::check(&document);
    if !problems.is_empty() {
        return Err(error(problems));
    }
    crate::materials::fill(document.get_mut());
    let mut scene = Scene::deserialize(toml::de::Deserializer::from(document.clone())).map_err(|e| {
        error(vec![Problem::new(
            e.span(),
            e.message().trim_end(),
            "`ripstop schema` prints what a scene may contain",
        )])
    })?;
    if let Some(flow) = &mut scene.flow {
        flow.fill_air(|keys| has_keys(document.get_ref(), "flow", keys));
    }
    if let (Some(path), Some(folder)) = (scene.canopy.file_mut(), file.parent()) {
        *path = folder.join(&*path);
    }
    if let (Some(g), Some(folder)) = (scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()), file.parent()) {
        g.path = folder.join(&g.path);
    }
    if scene.flow.as_ref().is_some_and(Flow::is_immersed) && !has_key(document.get_ref(), "ranks", "flow") {
        scene.ranks.flow = 1;
    }
    let problems = refusals(&scene)
        .into_iter()
        .map(|p| Problem::new(span_of(&document, &p.path), p.what, p.help))
        .collect::<Vec<_>>();
    if problems.is_empty() { Ok(scene) } else { Err(error(problems)) }
}

/// Whether a document has the key `key` in the section `section`.
fn has_key(document: &DeTable<'_>, section: &str, key: &str) -> bool {
    has_keys(document, section, &[key])
}

/// Whether the table `section` has the key at the end of the path `keys`.
fn has_keys(document: &DeTable<'_>, section: &str, keys: &[&str]) -> bool {
    let mut value = document.get(section);
    for key in keys {
        value = value.and_then(|v| v.get_ref().as_table()).and_then(|table| table.get(*key));
    }
    value.is_some()
}

/// The ranges that the values of `scene` are compared with, in the order of the checks. A key that a scene does not have
/// is compared with none.
pub fn allowed_ranges(scene: &Scene) -> Vec<Allowed> {
    checked(scene).allowed
}

/// Everything about the scene that no solver could work with: magnitudes, and sections that need each other.
fn refusals(scene: &Scene) -> Vec<Refusal> {
    checked(scene).refusals
}

fn checked(scene: &Scene) -> Check {
    let mut c = Check::default();
    name(scene, &mut c);
    canopy::check(scene, &mut c);
    canopy_risers::check_section(scene, &mut c);
    fabric::check(scene, &mut c);
    lines::check(scene, &mut c);
    tapes::check(scene, &mut c);
    nodes::check(scene, &mut c);
    structure::check(scene, &mut c);
    mesh::check(scene, &mut c);
    coupling::check(scene, &mut c);
    flow::check(scene, &mut c);
    descent::check(scene, &mut c);
    programs::check(scene, &mut c);
    reefing::check(scene, &mut c);
    output::check(scene, &mut c);
    stages::check(scene, &mut c);
    c
}

fn name(scene: &Scene, c: &mut Check) {
    if !plain_name(&scene.name) {
        c.refuse("name", format!("`name` is \"{}\"", scene.name), NAME_OF_FOLDER);
    }
}
