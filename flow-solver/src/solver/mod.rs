//! One time step of the flow: grid motion, BDF2, iterations to a residual drop.

use comm::{Comm, Halo};

use crate::boundary_values::{BoundaryArrays, BoundaryState, BoundaryValues};
use crate::error::{FlowError, agree};
use crate::geometry::Metrics;
use crate::geometry::vec3::Vec3;
use crate::gradient::{Field, Gradient, LeastSquares};
use crate::implicit::{Correction, LuSgs, NonlinearGmres, PressureCorrection};
use crate::physics::{Air, FaceFlux, FluxParameters, Gas};
use crate::residual::{Domain, Slopes, Spatial};
use crate::shear::WindShear;
use crate::state::TimeLevel;
use crate::time::Backward;
use crate::topology::Topology;
use crate::turbulence::{SpalartAllmaras, TransportInput};

/// Method that computes the correction in each iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Pressure corrections, combined by nonlinear GMRES over this many (0: none).
    PressureCorrection {
        /// Corrections that are combined.
        depth: usize,
    },
    /// The paper's LU-SGS steps in pseudo time.
    LuSgs {
        /// Pseudo-time Courant number.
        courant: f64,
    },
}

/// How a step is solved.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Undisturbed air.
    pub air: Air,
    /// Its velocity relative to the ground, m/s.
    pub wind: Vec3,
    /// The residual must fall by this factor.
    pub residual_drop: f64,
    /// What coupling iterations, which solve a step several times, need; `None` where a step is solved once.
    pub coupling: Option<CouplingIterations>,
    /// Maximum number of iterations.
    pub max_iterations: usize,
    /// Correction method.
    pub method: Method,
    /// Speed that floors the reference speeds, m/s: a tenth of the stream's.
    pub reference_speed: f64,
    /// Weight of velocity diffusion in the interface pressure.
    pub velocity_diffusion: f64,
    /// Pressure on the side of the canopy that has no cells, Pa above that of the undisturbed air
    /// ([`Topology::one_sided`]); without effect where both sides have cells.
    pub ambient_pressure: f64,
    /// Whether the grid moves. On a fixed grid, arrays for grid motion are not allocated.
    pub moving: bool,
}

/// Residuals at which the solves of a step end that coupling iterations repeat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CouplingIterations {
    /// The residual of a repeated solve must fall by this factor.
    pub drop: f64,
    /// Residual, in units of that at the start of the step, below which the load is more precise than the coupling iterations need.
    pub sufficient: f64,
}

/// One step to be taken.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Length, s.
    pub dt: f64,
    /// Velocity of the grid's frame relative to the ground, m/s.
    pub frame: Vec3,
    /// Whether the same step was computed before (and is now repeated with
    /// slightly other data): starts from that result.
    pub repeat: bool,
    /// Whether [`Solver::nodes`] were changed.
    pub moved: bool,
}

/// Residuals and iteration counts of a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Residual of the last accepted state in the new step, N.
    pub start: f64,
    /// Residual at the end, N.
    pub end: f64,
    /// Residual at which the step counts as converged, N.
    pub target: f64,
    /// Whether the iterations reached their own target, which is smaller than `target` in repetitions of a
    /// step that bring little.
    pub met: bool,
    /// Largest error of a cell where the residual was small enough; zeros where it was not computed.
    pub cell: CellError,
    /// Corrections.
    pub iterations: usize,
    /// Iterations of the pressure equation.
    pub linear_iterations: usize,
    /// Sum of the continuity residual over all cells, kg/s.
    pub mass_defect: f64,
    /// Residual level of round-off, N, where the tolerances ask for less in a step that begins far above it: the step ends there.
    pub round_off: Option<f64>,
}

/// The flow on one rank's part of the grid.
pub struct Solver<G, const N: usize> {
    /// Cells and faces.
    pub topology: Topology,
    /// Exchange of cell values.
    pub halo: Halo,
    /// Gas, viscosity, reconstruction.
    pub spatial: Spatial<G>,
    /// Tolerances.
    pub settings: Settings,
    /// Node positions at the end of the step, m.
    pub nodes: Vec<Vec3>,
    /// Node velocities in the falling frame at the end of the step, m/s. Empty on a grid at
    /// rest.
    pub node_velocity: Vec<Vec3>,
    /// Unknowns at the end of the step.
    pub q: Vec<[f64; N]>,
    /// Their gradients.
    pub gradient: Vec<Gradient<N>>,
    /// Scratch of their second pass where the flux may be central, else empty.
    gradient_correction: Vec<Gradient<N>>,
    /// Geometry at the end of the step.
    pub metrics: Metrics,
    /// The last two accepted time levels, newest first.
    pub previous: [TimeLevel<N>; 2],
    /// First-order steps still to take before BDF2.
    pub first_order_steps: u32,
    /// Length of the last accepted step, s (0: none).
    pub last_dt: f64,
    /// Constants of the last step's flux.
    pub scheme: FluxParameters,
    /// Acceleration of the undisturbed air, m/s2, as a source term in all cells: a gust then
    /// creates no pressure wave at the boundary. Per volume of a cell at the end of the step, at its start and one step
    /// earlier: on a moving grid the momentum of a uniform stream changes by $`\sum_k c_k V_k w_k / \Delta t`$, of which
    /// the grid fluxes carry $`w_0 \sum_k c_k V_k / \Delta t`$, so that the source is the sum of $`c_k V_k (w_k - w_0) / \Delta t`$.
    pub wind_change: [Vec3; 3],
    /// Change of the undisturbed velocity in this step and in the last one, m/s.
    wind_gain: [Vec3; 2],
    /// Source terms of the conserved quantities in owned cells per unit time and
    /// volume (kg/(m3 s), N/m3[, W/m3]) at the end of the step. Empty: nothing.
    pub source: Vec<[f64; N]>,
    /// Wind by height. `None`: the same everywhere.
    shear: Option<WindShear>,
    sheared: Vec<Vec3>,
    /// Data of boundary patches. Empty: the undisturbed air and walls that move with the grid.
    boundary: BoundaryState,
    turbulence: Option<Box<SpalartAllmaras>>,
    turbulence_lost: bool,
    /// Residual of the turbulence equation over its target in the last accepted step; 0: not solved.
    turbulence_excess: f64,
    eddy: Vec<f64>,
    /// Working variable of the turbulence model times density, Pa s.
    working: Vec<f64>,
    least_squares: LeastSquares,
    wall_velocity: Vec<Vec3>,
    /// Volume swept by each face in this step and in the last one, m3. Empty until the
    /// grid moves for the first time.
    swept: Vec<f64>,
    swept_before: Vec<f64>,
    residual: Vec<[f64; N]>,
    history: Vec<[f64; N]>,
    /// Scratch of [`CellError`]: diagonal of the momentum equation of owned cells, kg/s.
    diagonal: Vec<f64>,
    face_flux: Vec<FaceFlux>,
    /// Whether the Rhie-Chow fluxes have no history (first-order time difference).
    rhie_chow_is_reset: bool,
    start: f64,
    /// Solves of the present step before this one.
    repetition: usize,
    /// Whether the last accepted step needed few solves.
    few_solves_before: bool,
    /// State of owned cells with the smallest residual of the step, where a correction made
    /// it worse; empty until that happens for the first time.
    best: Vec<f64>,
    correction: Box<dyn Correction<G, N>>,
    nonlinear_gmres: NonlinearGmres,
}

macro_rules! domain {
    ($s:ident) => {
        Domain {
            topology: &$s.topology,
            metrics: &$s.metrics,
            gradients: &$s.least_squares,
            halo: &$s.halo,
            wall_velocity: &$s.wall_velocity,
            sheared: &$s.sheared,
            outer_pressure: &$s.boundary.pressure,
            wall_spin: &$s.boundary.spin,
            eddy: &$s.eddy,
            working: &$s.working,
        }
    };
}

mod cell_error;
mod effects;
mod iterate;
mod motion;
mod restart;
mod step;

pub use cell_error::CellError;
pub use restart::WarmStart;

/// Constants of the flux before the first step.
fn before_first_step<G>(spatial: &Spatial<G>, settings: &Settings) -> FluxParameters {
    FluxParameters {
        rate: 0.0,
        rhie_chow: [0.0; 3],
        frame: Vec3::zeros(),
        wind: settings.wind,
        floor_squared: settings.reference_speed * settings.reference_speed,
        velocity_diffusion: settings.velocity_diffusion,
        kinematic_viscosity: spatial.viscosity.molecular() / settings.air.density,
        pressure_diffusion: 2.0 / (1.0 - spatial.chi),
        renews_blending: false,
    }
}

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Undisturbed air everywhere, on a grid with node positions `nodes` (local). Collective.
    pub fn new(
        comm: &Comm,
        topology: Topology,
        nodes: Vec<Vec3>,
        spatial: Spatial<G>,
        settings: Settings,
    ) -> Result<Self, FlowError> {
        let halo = Halo::new(comm, &topology.numbering);
        let metrics = Metrics::new(&topology, &halo, &nodes);
        let least_squares = LeastSquares::new(&topology, &metrics);
        let (n, faces) = (topology.n_local(), topology.face_nodes.len());
        let q = vec![spatial.gas.undisturbed(settings.wind); n];
        let (correction, depth): (Box<dyn Correction<G, N>>, usize) = match settings.method {
            Method::PressureCorrection { depth } => (Box::new(PressureCorrection::new(&topology)), depth),
            Method::LuSgs { courant } => (Box::new(LuSgs::new(&topology, courant)), 0),
        };
        let (volume, kept) =
            if settings.moving { (metrics.volume.clone(), nodes.clone()) } else { (Vec::new(), Vec::new()) };
        let instant = TimeLevel { q: q.clone(), volume, nodes: kept };
        let solver = Self {
            node_velocity: vec![Vec3::zeros(); instant.nodes.len()],
            gradient: vec![[[0.0; N]; 3]; n],
            gradient_correction: Vec::new(),
            previous: [instant.clone(), instant],
            first_order_steps: 2,
            last_dt: 0.0,
            scheme: before_first_step(&spatial, &settings),
            wind_change: [Vec3::zeros(); 3],
            wind_gain: [Vec3::zeros(); 2],
            source: Vec::new(),
            shear: None,
            sheared: Vec::new(),
            boundary: BoundaryState::default(),
            turbulence: None,
            turbulence_lost: false,
            turbulence_excess: 0.0,
            eddy: vec![0.0; if spatial.viscosity.transported() { n } else { 0 }],
            working: vec![0.0; if spatial.viscosity.transported() { n } else { 0 }],
            least_squares,
            wall_velocity: vec![Vec3::zeros(); faces - topology.cells.len()],
            swept: Vec::new(),
            swept_before: Vec::new(),
            residual: vec![[0.0; N]; n],
            history: vec![[0.0; N]; topology.n_owned],
            diagonal: vec![0.0; topology.n_owned],
            face_flux: vec![FaceFlux::default(); faces],
            rhie_chow_is_reset: true,
            start: 0.0,
            repetition: 0,
            few_solves_before: false,
            best: Vec::new(),
            correction,
            nonlinear_gmres: NonlinearGmres::new(depth, topology.n_owned * N),
            nodes,
            q,
            metrics,
            halo,
            spatial,
            settings,
            topology,
        };
        solver.check_volumes()?;
        Ok(solver)
    }

    /// The ranks that share the grid.
    pub fn comm(&self) -> &Comm {
        self.halo.comm()
    }

    /// Volumes of local cells at the accepted time level `k` (0: the newest), m3.
    pub(crate) fn previous_volume(&self, k: usize) -> &[f64] {
        if self.settings.moving { &self.previous[k].volume } else { &self.metrics.volume }
    }

    /// Node positions at the accepted time level `k` (0: the newest), m.
    pub fn previous_nodes(&self, k: usize) -> &[Vec3] {
        if self.settings.moving { &self.previous[k].nodes } else { &self.nodes }
    }

    /// Residual of the turbulence equation over its target in the step that was accepted last; 0: not solved.
    pub fn turbulence_excess(&self) -> f64 {
        self.turbulence_excess
    }

    /// Mass and Rhie-Chow fluxes of the local faces.
    pub fn face_flux(&self) -> &[FaceFlux] {
        &self.face_flux
    }

    /// Input of the residual kernels.
    pub fn domain(&self) -> Domain<'_> {
        domain!(self)
    }
}
