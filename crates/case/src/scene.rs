//! What a user writes: one TOML file, typed.
//!
//! Every key carries its unit in its name. Unknown keys are refused. Sections
//! that are absent are effects that are off: they cost nothing.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::coupling::{CouplingOrder, Staggered};
use crate::flow_effects::{Permeability, Shear, Steady};
use crate::integration::{EXPLICIT_SAFETY, Integration, SPECTRAL_RADIUS};
use crate::{FlowBox, Forces, GridFile, Gust, PanelCanopy, Probe, Slice, Statistics, SurfacePressure};

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
    /// Material of the fabric.
    pub fabric: Fabric,
    /// Material of suspension lines and risers; needed when the canopy has lines.
    pub lines: Option<Lines>,
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
    pub reefing: Vec<crate::Reefing>,
    /// Masses on nodes, beside those of fabric, lines and payload.
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
    pub accuracy: Option<crate::Accuracy>,
}

/// The keys of `programs`, for the schema: an open map would let a misspelt role pass.
#[derive(Default, Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code)]
struct Programs {
    /// In the place of `structure-solver`.
    structure: Option<String>,
    /// In the place of `flow-solver`.
    flow: Option<String>,
    /// In the place of `mesh-mover`.
    mesh: Option<String>,
}

/// One of the three solver programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// `structure-solver`
    Structure,
    /// `flow-solver`
    Flow,
    /// `mesh-mover`
    Mesh,
}

impl Role {
    /// All roles, in launch order.
    pub const ALL: [Role; 3] = [Role::Structure, Role::Flow, Role::Mesh];

    /// Name on channels and command lines.
    pub fn name(self) -> &'static str {
        match self {
            Role::Structure => "structure",
            Role::Flow => "flow",
            Role::Mesh => "mesh",
        }
    }

    /// Name of the project's own program for this role.
    pub fn program(self) -> &'static str {
        match self {
            Role::Structure => "structure-solver",
            Role::Flow => "flow-solver",
            Role::Mesh => "mesh-mover",
        }
    }
}

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
    /// The square air bag of the paper, section 1.4: one octant by symmetry.
    AirBag(AirBag),
    /// A surface mesh from a file; a flow needs `[flow.grid_file]`.
    Gmsh(GmshCanopy),
    /// A flat rectangular panel; a flow needs `[flow.box]`.
    Panel(PanelCanopy),
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
    /// Line elements along the panel edges (hem, seams, vents), sharing canopy
    /// nodes, with the section and stiffness of the suspension lines.
    pub reinforcements: bool,
    /// With `reinforcements`: quadrilaterals between further line elements that run
    /// along and across all panels, a grid of tapes. 0: none.
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
/// are fabric; beside a volume grid, those of the physical group `canopy`. Physical groups named `lines`, `risers` and
/// `reinforcements` are cables at their rest length; `fixed`, `fixed-x`, `fixed-y`
/// and `fixed-z` hold nodes; `payload` is the payload's point.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GmshCanopy {
    /// The file, from the scene's folder.
    pub file: PathBuf,
}

fn one() -> u32 {
    1
}

/// Material of the fabric: St. Venant-Kirchhoff in plane stress.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fabric {
    /// Young's modulus ("membrane stiffness"), Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Thickness, m.
    pub thickness_m: f64,
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Tension field (taut, wrinkled, slack) after Lu, Accorsi and Leonard
    /// (2001). Off: the fabric carries compression.
    #[serde(default)]
    pub wrinkling: bool,
    /// Stress of the fabric in its cut shape, Pa, the same along all directions.
    #[serde(default)]
    pub prestress_pa: f64,
    /// Different stiffness along warp and weft. Absent: isotropic.
    pub orthotropic: Option<Orthotropic>,
    /// Air that passes through. Absent: airtight.
    pub permeability: Option<Permeability>,
    /// Contact with itself. Absent: fabric passes through fabric.
    pub contact: Option<crate::Contact>,
}

/// A fabric that is stiffer one way: the modulus and the ratio of `[fabric]` are then
/// those of a pull along the first direction (the warp).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Orthotropic {
    /// Young's modulus across the first direction (along the weft), Pa.
    pub youngs_modulus_2_pa: f64,
    /// Shear modulus in the plane of the fabric, Pa.
    pub shear_modulus_pa: f64,
    /// First direction, laid onto the unstressed fabric. Absent: along the first
    /// edge of each face, that is along the panels of a generated canopy.
    pub direction: Option<[f64; 3]>,
}

/// Material of lines and risers.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lines {
    /// Young's modulus ("cable stiffness"), Pa.
    pub youngs_modulus_pa: f64,
    /// Cross-sectional area, m2.
    pub area_m2: f64,
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// A line that is shorter than its rest length carries nothing.
    #[serde(default = "yes")]
    pub tension_only: bool,
    /// Stress at rest length, Pa: a pulled line has a positive one.
    #[serde(default)]
    pub prestress_pa: f64,
    /// Drag of the air. Absent: none.
    pub drag: Option<crate::LineDrag>,
}

fn yes() -> bool {
    true
}

/// Gravity on fabric and lines.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FabricGravity {}

/// Time integration and solvers of the structure.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Structure {
    /// Spectral radius at infinite frequency of the generalized-alpha method,
    /// 0 to 1: the share that a step leaves of the highest frequencies. Absent: 1, no damping.
    pub spectral_radius: Option<f64>,
    /// Newton stops when the residual falls below this share of the applied load.
    pub newton_tolerance: f64,
    /// Newton steps before a time step is cut.
    pub newton_max_steps: u32,
    /// Relative tolerance of GMRES within a Newton step.
    pub gmres_tolerance: f64,
    /// How often a time step may be halved before the run ends.
    pub max_step_cuts: u32,
    /// A static stage ends when the forces out of balance are below this share of
    /// the load.
    pub static_tolerance: f64,
    /// Distribution of the mass of elements over their nodes.
    pub mass: Mass,
    /// Elements of the fabric.
    pub membrane: Membrane,
    /// Time integration; explicit steps always lump the mass.
    pub integration: Integration,
    /// Share of the largest stable step that explicit integration takes.
    pub explicit_safety: f64,
}

/// Elements of the fabric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Membrane {
    /// Two triangles of constant strain for each quadrilateral, as in the paper.
    #[default]
    Triangle,
    /// One bilinear element for each quadrilateral.
    Quadrilateral,
}

/// A mass on nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointMass {
    /// Name of a node set: `held`, `rim`, `canopy`, or a physical group of the mesh
    /// file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Mass on each of the nodes, kg.
    pub mass_kg: f64,
}

/// A force on nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Force {
    /// Name of a node set: `held`, `rim`, `canopy`, or a physical group of the mesh
    /// file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Constant force on each of the nodes, N.
    pub force_n: [f64; 3],
}

/// A prescribed motion of nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Name of a node set: `held`, `rim`, `canopy`, or a physical group of the mesh
    /// file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Components that move as prescribed.
    #[serde(default = "all_components")]
    pub components: String,
    /// Ascending times, s on the clock. A static stage ends at the last one.
    pub time_s: Vec<f64>,
    /// Displacement at each time from where the nodes are at the start of the stage,
    /// m; linear in between, constant before and after. On another clock than that of the stage only what the
    /// table changes from the start of the stage on counts, so that one table continues over several stages.
    pub displacement_m: Vec<[f64; 3]>,
    /// What `time_s` counts from. Absent: the start of the stage.
    pub clock: Option<crate::Clock>,
}

fn all_components() -> String {
    "xyz".into()
}

/// Distribution of the mass of elements over their nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mass {
    /// From the shape functions, as in the paper.
    #[default]
    Consistent,
    /// Shared out to the nodes.
    Lumped,
}

impl Structure {
    /// Spectral radius at infinite frequency of the generalized-alpha method: the scene's choice,
    /// or the default.
    pub fn spectral_radius(&self) -> f64 {
        self.spectral_radius.unwrap_or(SPECTRAL_RADIUS)
    }
}

impl Default for Structure {
    fn default() -> Self {
        Self {
            spectral_radius: None,
            newton_tolerance: 1e-5,
            newton_max_steps: 25,
            gmres_tolerance: 1e-3,
            max_step_cuts: 10,
            static_tolerance: 1e-8,
            mass: Mass::Consistent,
            membrane: Membrane::Triangle,
            integration: Integration::default(),
            explicit_safety: EXPLICIT_SAFETY,
        }
    }
}

/// Air, flow grid and flow solver.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Flow {
    /// Density of the undisturbed air, kg/m3.
    #[serde(default = "sea_level_density")]
    pub density_kg_m3: f64,
    /// Temperature of the undisturbed air, K.
    #[serde(default = "sea_level_temperature")]
    pub temperature_k: f64,
    /// Wind in the frame of the ground, m/s, in all stages that have no `[stage.wind]`.
    #[serde(default)]
    pub wind_m_s: [f64; 3],
    /// A gust on top of the wind, in all stages that have no `[stage.gust]`. Its times count from the release,
    /// through all later stages. Absent: steady wind.
    pub gust: Option<Gust>,
    /// Wind that changes with height. Absent: the same everywhere.
    pub shear: Option<Shear>,
    /// Viscosity. Absent: inviscid.
    pub viscosity: Option<Viscosity>,
    /// Solves the energy equation. Absent: isothermal, four equations.
    pub energy: Option<Energy>,
    /// Limits gradients (Venkatakrishnan). Absent: unlimited, second order.
    pub limiter: Option<Limiter>,
    /// The volume grid around the canopy.
    #[serde(default)]
    pub grid: Grid,
    /// A volume grid from a file in the place of `[flow.grid]`.
    pub grid_file: Option<GridFile>,
    /// A box of cells around a panel in the place of `[flow.grid]`.
    #[serde(rename = "box")]
    pub box_grid: Option<FlowBox>,
    /// Pseudo-time iterations.
    #[serde(default)]
    pub solver: FlowSolver,
    /// Points whose values are written after every window.
    #[serde(default, rename = "probe")]
    pub probes: Vec<Probe>,
    /// Time statistics. Absent: none.
    pub statistics: Option<Statistics>,
    /// Forces and moments after every window. Absent: those of the history alone.
    pub forces: Option<Forces>,
    /// Plane cuts.
    #[serde(default, rename = "slice")]
    pub slices: Vec<Slice>,
    /// Pressure on both sides of the canopy. Absent: none is written.
    pub surface_pressure: Option<SurfacePressure>,
}

fn sea_level_density() -> f64 {
    1.225
}
fn sea_level_temperature() -> f64 {
    288.15
}

/// Laminar viscosity.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Viscosity {
    /// Dynamic viscosity, Pa s.
    #[serde(default = "air_viscosity")]
    pub dynamic_viscosity_pa_s: f64,
    /// Model of the unresolved turbulence. Absent: laminar.
    pub turbulence: Option<Turbulence>,
}

fn air_viscosity() -> f64 {
    1.789e-5
}

/// Models of unresolved turbulence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Turbulence {
    /// Smagorinsky with a constant of 0.17.
    Smagorinsky,
    /// WALE (Nicoud and Ducros 1999) with a constant of 0.325: none in pure shear, so
    /// that it fades towards walls.
    Wale,
    /// Spalart-Allmaras in its negative form (Allmaras, Johnson and Spalart 2012): one
    /// equation for the eddy viscosity, all turbulence is modelled.
    SpalartAllmaras,
    /// Detached eddies (Spalart et al. 1997): Spalart-Allmaras at walls, a sub-grid model
    /// away from them.
    Des97,
    /// Delayed detached eddies (Spalart et al. 2006): as `des97`, but boundary layers stay
    /// modelled on any grid.
    Ddes,
}

/// The energy equation.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Energy {}

/// Gradient limiting.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Limiter {
    /// Venkatakrishnan's K: larger limits less.
    pub k: f64,
}

impl Default for Limiter {
    fn default() -> Self {
        Self { k: 5.0 }
    }
}

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

/// Pseudo-time iterations of the flow.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FlowSolver {
    /// How the implicit system of a pseudo-time step is solved.
    pub method: FlowMethod,
    /// A time step is converged when the unsteady residual has dropped by this factor. Coupling iterations
    /// that are to agree more closely than a tenth of it tighten it to 10 times `coupling.tolerance`.
    pub residual_drop: f64,
    /// Pseudo-time iterations at most for each time step. Absent: 60 with `gmres`, 2000 with `lu-sgs`.
    pub max_iterations: Option<u32>,
}

impl Default for FlowSolver {
    fn default() -> Self {
        Self { method: FlowMethod::Gmres, residual_drop: 1e-2, max_iterations: None }
    }
}

impl FlowSolver {
    /// Pseudo-time iterations at most for each time step: the scene's, or what the method needs.
    pub fn iterations(&self) -> u32 {
        self.max_iterations.unwrap_or(match self.method {
            FlowMethod::Gmres => 60,
            FlowMethod::LuSgs => 2000,
        })
    }
}

/// How the implicit system of a pseudo-time step is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FlowMethod {
    /// One LU-SGS sweep pair each pseudo-time step, as in the paper.
    LuSgs,
    /// Implicit pressure corrections, combined by nonlinear GMRES.
    Gmres,
}

/// Grid motion.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MeshMotion {
    /// What carries the canopy's motion into the grid.
    pub mover: MoverKind,
    /// Exponent of the stiffening by the Jacobian (Stein, Tezduyar, Benney 2003).
    pub stiffening_exponent: f64,
    /// Poisson's ratio of the pseudo-solid.
    pub poisson_ratio: f64,
    /// Accepted error of interior nodes: of the position of one in shares of the longest cell edge around
    /// it, of two of them in shares of the edge between. Only smoothness is at stake.
    pub tolerance: f64,
    /// Smallest scaled Jacobian that is accepted, above 0.
    pub min_quality: f64,
    /// Most sub-increments for one window.
    pub max_increments: u32,
    /// What the nodes of the outer boundary do.
    pub outer: crate::OuterBoundary,
    /// A new grid where the moved one has become bad. Absent: never.
    pub regrid: Option<crate::Regrid>,
}

impl Default for MeshMotion {
    fn default() -> Self {
        Self {
            mover: MoverKind::Elastic,
            stiffening_exponent: 1.0,
            poisson_ratio: 0.3,
            tolerance: 3e-3,
            min_quality: 1e-3,
            max_increments: 8,
            outer: crate::OuterBoundary::Fixed,
            regrid: None,
        }
    }
}

/// What carries the canopy's motion into the grid. All but the first are there to compare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MoverKind {
    /// Linear elasticity, stiffer where cells are small or badly shaped.
    #[default]
    Elastic,
    /// Linear elasticity of uniform stiffness.
    PlainElastic,
    /// Laplace's equation for each component, with the stiffening exponent.
    Laplacian,
    /// Radial basis functions of Wendland on selected boundary nodes.
    RadialBasis,
    /// Weights by the distance to each boundary node.
    InverseDistance,
}

/// Coupling of the fields.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Coupling {
    /// The sequence of the programs in a window.
    pub scheme: Scheme,
    /// The order of the programs in a staggered window, and what they know in advance.
    pub staggered: Staggered,
    /// The order of structure and flow in the iterations of an implicit window.
    pub order: CouplingOrder,
    /// Load over the substeps of a window.
    pub load: LoadShape,
    /// An implicit window is converged when interface displacement and descent
    /// speed change by less than this, relative to their change over the window.
    pub tolerance: f64,
    /// Coupling iterations at most in a window.
    pub max_iterations: u32,
    /// Relaxation of the first iteration, and of all with `constant`.
    pub relaxation: f64,
    /// Acceleration of the iterations.
    pub acceleration: Acceleration,
    /// Past windows whose secants quasi-Newton reuses.
    pub reused_windows: u32,
    /// Most faces that the dense model of the air's inertia holds one by one. A canopy of more acts in that many
    /// groups of neighbours.
    pub model_faces: u32,
    /// Share of the mean velocity over an implicit window in the structure's velocity
    /// at its end, along the fabric's normal, 0 to 1: holds light fabric to the motion that
    /// the flow sees. Absent: 0.5 where the air weighs far more than the fabric, none
    /// where it weighs less.
    pub velocity_average: Option<f64>,
    /// What happens to a window that has no answer.
    pub adaptive: crate::AdaptiveWindow,
}

impl Default for Coupling {
    fn default() -> Self {
        Self {
            scheme: Scheme::Implicit,
            staggered: Staggered::default(),
            order: CouplingOrder::GaussSeidel,
            load: LoadShape::Mean,
            tolerance: 1e-3,
            max_iterations: 30,
            relaxation: 0.1,
            acceleration: Acceleration::IbqnLs,
            reused_windows: 8,
            model_faces: 4000,
            velocity_average: None,
            adaptive: crate::AdaptiveWindow::default(),
        }
    }
}

/// The sequence of the programs in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Each program once: the paper's sequence, with pressures of the last flow step, or
    /// what `coupling.staggered` makes of it.
    Staggered,
    /// Each window is iterated until structure, flow and descent agree.
    Implicit,
}

/// Load on the structure over the substeps of one window.
///
/// Substeps between two looks at the flow decide the stability of even a fully
/// converged window: see `coupling::schemes`, module `load_shape`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LoadShape {
    /// A second-order mean of the last three pressures throughout, which also
    /// damps a pressure that alternates from window to window: the stable one for
    /// light fabric.
    Mean,
    /// The window's last pressure throughout.
    Constant,
    /// From the pressure at the start to the one at the end: for heavy canopies
    /// or one substep.
    Linear,
}

/// Acceleration of implicit coupling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Acceleration {
    /// Fixed relaxation.
    Constant,
    /// Aitken's dynamic relaxation.
    Aitken,
    /// Interface quasi-Newton, inverse least squares. For structures that cost more than the flow.
    IqnIls,
    /// Interface quasi-Newton, multi-vector: each window's secants correct what the windows
    /// before have learnt.
    IqnImvj,
    /// Interface block quasi-Newton: between two calls of the flow the structure is solved
    /// against the flow's added mass and secants, so that few windows ask the flow more than
    /// four times. Above 4000 canopy faces, and in Jacobi order, as iqn-ils.
    IbqnLs,
}

/// The falling mass: one degree of freedom (paper, equation 9).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Descent {
    /// Mass of the payload, kg. Fabric and lines are added.
    pub payload_mass_kg: f64,
    /// Descent speed at the start, m/s, positive downwards.
    pub initial_speed_m_s: f64,
    /// Acceleration of gravity, m/s2.
    #[serde(default = "standard_gravity")]
    pub gravity_m_s2: f64,
    /// Area that turns drag into a coefficient, m2.
    pub reference_area_m2: f64,
    /// Equation of the falling frame.
    #[serde(default)]
    pub equation: crate::DescentEquation,
    /// Drag of the air on the payload. Absent: none.
    pub payload_drag: Option<crate::PayloadDrag>,
    /// The payload as a rigid body on its lines. Absent: a point that falls with the frame.
    pub body: Option<crate::PayloadBody>,
}

fn standard_gravity() -> f64 {
    9.80665
}

/// One stage of a run.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Name of the stage and of its result folder.
    pub name: String,
    /// What runs.
    pub kind: StageKind,
    /// How the structure of a pre-inflation is solved.
    #[serde(default)]
    pub solve: Solve,
    /// Simulated time, s. Every stage has one but a static one.
    #[serde(default)]
    pub duration_s: f64,
    /// Length of a window (the flow's time step), s. Every stage has one but a
    /// static one.
    #[serde(default)]
    pub window_s: f64,
    /// Structural steps in a window.
    #[serde(default = "ten")]
    pub substeps: u32,
    /// Marches a flow-only stage to a steady state, in one window without duration.
    pub steady: Option<Steady>,
    /// Uniform pressure jump on the canopy, Pa (pre-inflation).
    pub pressure_pa: Option<f64>,
    /// Mass-proportional damping of the structure in this stage, 1/s.
    #[serde(default)]
    pub mass_damping_per_s: f64,
    /// Stiffness-proportional damping of the structure in this stage, s: the stress
    /// that it adds is this time times the rate of the elastic stress.
    #[serde(default)]
    pub stiffness_damping_s: f64,
    /// Ends the stage early once the kinetic energy of the structure is below
    /// this share of its strain energy.
    pub settled_energy_ratio: Option<f64>,
    /// Steady wind of this stage. Absent: `flow.wind_m_s`.
    pub wind: Option<crate::StageWind>,
    /// A gust in this stage. Absent: `[flow.gust]`.
    pub gust: Option<Gust>,
    /// Prescribed motions of nodes.
    #[serde(default, rename = "motion")]
    pub motions: Vec<Motion>,
    /// Forces on nodes.
    #[serde(default, rename = "force")]
    pub forces: Vec<Force>,
}

fn ten() -> u32 {
    10
}

/// How the structure of a pre-inflation is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Solve {
    /// In time.
    #[default]
    Dynamic,
    /// For the shape at rest, from any start; in one window without duration.
    Static,
}

/// What runs in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StageKind {
    /// Structure alone under constant pressure (paper, section 5.1).
    PreInflation,
    /// Flow alone around the canopy held still, at the initial descent speed.
    FlowOnly,
    /// Structure, mesh and flow, coupled, with the descent (paper, section 5.2).
    Coupled,
    /// Mesh and flow around a canopy that moves by `[[stage.motion]]`, at the initial descent
    /// speed.
    Prescribed,
}

impl StageKind {
    /// The programs that this stage needs.
    pub fn roles(self) -> &'static [Role] {
        match self {
            StageKind::PreInflation => &[Role::Structure],
            StageKind::FlowOnly => &[Role::Flow],
            StageKind::Coupled => &[Role::Structure, Role::Flow, Role::Mesh],
            StageKind::Prescribed => &[Role::Flow, Role::Mesh],
        }
    }
}

/// Snapshots and checkpoints.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Windows between ParaView snapshots of the canopy. 0: none.
    pub surface_every_windows: u32,
    /// Windows between ParaView snapshots of the flow. 0: none.
    pub volume_every_windows: u32,
    /// Windows between saved states within a stage, which `ripstop run --resume` goes on from. 0: none
    /// but at the end of a stage and at Ctrl-C. Default: as often as costs 1 % of the time, at
    /// most twice a minute.
    pub checkpoint_every_windows: Option<u32>,
    /// Result folder. Default: `runs/<name>`.
    pub folder: Option<PathBuf>,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            surface_every_windows: 4,
            volume_every_windows: 20,
            checkpoint_every_windows: None,
            folder: None,
        }
    }
}

/// Ranks per program.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Ranks {
    /// Ranks of the structure-solver.
    pub structure: u32,
    /// Ranks of the flow-solver.
    pub flow: u32,
    /// Ranks of the mesh-mover.
    pub mesh: u32,
}

impl Default for Ranks {
    fn default() -> Self {
        Self { structure: 1, flow: 2, mesh: 2 }
    }
}

impl Ranks {
    /// Ranks of one program.
    pub fn of(&self, role: Role) -> u32 {
        match role {
            Role::Structure => self.structure,
            Role::Flow => self.flow,
            Role::Mesh => self.mesh,
        }
    }

    /// Ranks of one program, to be changed.
    pub fn of_mut(&mut self, role: Role) -> &mut u32 {
        match role {
            Role::Structure => &mut self.structure,
            Role::Flow => &mut self.flow,
            Role::Mesh => &mut self.mesh,
        }
    }
}
