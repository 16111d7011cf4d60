//! `[flow]`: air, equations and solver of the flow.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{boundary_values, flow_grid, gust, immersed, monitors, shear};
use crate::check::Check;
use crate::{
    ALTITUDES, Condition, FlowBox, Forces, Grid, GridFile, Gust, Immersed, InletValues, MovingWall,
    OutletValues, Probe, Scene, Shear, Slice, StandardAir, Statistics, SurfacePressure, UndisturbedAir,
};

/// Specific gas constant of dry air, J/(kg K).
pub const GAS_CONSTANT: f64 = 287.05;
/// Ratio of its specific heats.
pub const HEAT_RATIO: f64 = 1.4;

/// Air, flow grid and flow solver.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Flow {
    /// Geopotential altitude, m, whose International Standard Atmosphere (ISO 2533) gives density, temperature and viscosity where
    /// the scene does not. They are constant during a run. Absent: sea level.
    pub altitude_m: Option<f64>,
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
    /// Force on the air per volume, N/m3. It drives a periodic channel as the pressure gradient of the opposite sign would, Pa/m. Absent: none.
    pub body_force_n_m3: Option<[f64; 3]>,
    /// Viscosity. Absent: inviscid.
    pub viscosity: Option<Viscosity>,
    /// Solves the energy equation. Absent: isothermal, four equations.
    pub energy: Option<Energy>,
    /// Convective flux.
    #[serde(default)]
    pub convection: Convection,
    /// Limits gradients (Venkatakrishnan). Absent: unlimited, second order.
    pub limiter: Option<Limiter>,
    /// The volume grid around the canopy.
    #[serde(default)]
    pub grid: Grid,
    /// A volume grid from a file instead of `[flow.grid]`.
    pub grid_file: Option<GridFile>,
    /// A box of cells around a panel instead of `[flow.grid]`.
    #[serde(rename = "box")]
    pub box_grid: Option<FlowBox>,
    /// A Cartesian grid through which the canopy moves, instead of `[flow.grid]`. Absent: a grid fitted to the canopy.
    pub immersed: Option<Immersed>,
    /// Velocity or flow rate of single inlets.
    #[serde(default, rename = "inlet")]
    pub inlets: Vec<InletValues>,
    /// Pressure of single outlets.
    #[serde(default, rename = "outlet")]
    pub outlets: Vec<OutletValues>,
    /// Sliding and rotating walls.
    #[serde(default, rename = "moving_wall")]
    pub moving_walls: Vec<MovingWall>,
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
    UndisturbedAir::SEA_LEVEL.density_kg_m3
}
fn sea_level_temperature() -> f64 {
    UndisturbedAir::SEA_LEVEL.temperature_k
}

impl Flow {
    /// Whether boundary patches have data of their own.
    pub fn has_boundary_values(&self) -> bool {
        !(self.inlets.is_empty() && self.outlets.is_empty() && self.moving_walls.is_empty())
    }

    /// Smallest share of upwind differences in the convective flux: the scene's, or that of its equations. In inviscid flow the
    /// upwind flux is nearer to the limit on coarse grids; a Reynolds average has no eddies to keep.
    pub fn upwind_share(&self) -> f64 {
        let of_equations = match &self.viscosity {
            Some(v) if v.turbulence != Some(Turbulence::SpalartAllmaras) => 0.0,
            _ => 1.0,
        };
        self.convection.upwind_share.unwrap_or(of_equations)
    }

    /// Whether data of boundary patches or a force can move the air.
    pub fn is_driven(&self) -> bool {
        self.has_boundary_values() || self.body_force() > 0.0
    }

    /// Magnitude of the force on the air, N/m3.
    pub fn body_force(&self) -> f64 {
        self.body_force_n_m3.map_or(0.0, |[x, y, z]| (x * x + y * y + z * z).sqrt())
    }

    /// Whether the canopy moves through a Cartesian grid.
    pub fn is_immersed(&self) -> bool {
        self.immersed.is_some()
    }

    /// Whether boundary patches are periodic.
    pub fn is_periodic(&self) -> bool {
        self.patches().iter().any(|p| p.1 == Condition::Periodic)
    }

    /// Speed of sound in the undisturbed air as the scene's equations have it, m/s: isothermal without the
    /// energy equation.
    pub fn sound_speed(&self) -> f64 {
        let ratio = if self.energy.is_some() { HEAT_RATIO } else { 1.0 };
        (ratio * GAS_CONSTANT * self.temperature_k).sqrt()
    }
}

impl Flow {
    /// Gives the air of `altitude_m` to what the scene does not give; `given`: whether it has a key below `[flow]`.
    pub(crate) fn fill_air(&mut self, given: impl Fn(&[&str]) -> bool) {
        let Some(altitude) = self.altitude_m.filter(|h| ALTITUDES.contains(h)) else { return };
        let air = StandardAir::at(altitude);
        if !given(&["density_kg_m3"]) {
            self.density_kg_m3 = air.density_kg_m3;
        }
        if !given(&["temperature_k"]) {
            self.temperature_k = air.temperature_k;
        }
        if let Some(viscosity) = &mut self.viscosity
            && !given(&["viscosity", "dynamic_viscosity_pa_s"])
        {
            viscosity.dynamic_viscosity_pa_s = air.dynamic_viscosity_pa_s;
        }
    }
}

impl Flow {
    /// The air of another `altitude` (m), where it is that of one.
    pub(crate) fn move_to(&mut self, altitude: f64) {
        let Some(here) = self.altitude_m.filter(|h| ALTITUDES.contains(h)) else { return };
        let (from, to) = (StandardAir::at(here), StandardAir::at(altitude));
        self.density_kg_m3 *= to.density_kg_m3 / from.density_kg_m3;
        self.temperature_k *= to.temperature_k / from.temperature_k;
        if let Some(viscosity) = &mut self.viscosity {
            viscosity.dynamic_viscosity_pa_s *= to.dynamic_viscosity_pa_s / from.dynamic_viscosity_pa_s;
        }
        self.altitude_m = Some(altitude);
    }
}

/// Laminar viscosity.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Viscosity {
    /// Dynamic viscosity, Pa s.
    #[serde(default = "air_viscosity")]
    pub dynamic_viscosity_pa_s: f64,
    /// Model of the unresolved turbulence. Absent: laminar. With `[flow.immersed]` `smagorinsky` or `wale`.
    pub turbulence: Option<Turbulence>,
    /// Friction of a turbulent flow on the canopy and on walls. Absent: `automatic` with `spalart-allmaras`, `des97` and `ddes`,
    /// `resolved` with `smagorinsky` and `wale`.
    pub wall_treatment: Option<WallTreatment>,
}

impl Viscosity {
    /// Friction on walls: the scene's, or that of its turbulence model. `None`: laminar.
    pub fn wall_treatment(&self) -> Option<WallTreatment> {
        let of_model = match self.turbulence? {
            Turbulence::Smagorinsky | Turbulence::Wale => WallTreatment::Resolved,
            Turbulence::SpalartAllmaras | Turbulence::Des97 | Turbulence::Ddes => WallTreatment::Automatic,
        };
        Some(self.wall_treatment.unwrap_or(of_model))
    }
}

fn air_viscosity() -> f64 {
    UndisturbedAir::SEA_LEVEL.dynamic_viscosity_pa_s
}

/// Models of unresolved turbulence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Turbulence {
    /// Smagorinsky with a constant of 0.17.
    Smagorinsky,
    /// WALE (Nicoud and Ducros 1999) with a constant of 0.55: none in pure shear, so
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

/// Friction of a turbulent flow on walls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WallTreatment {
    /// By the law of the wall of Spalart-Allmaras, from the viscous sublayer to the logarithmic layer: first cells at
    /// any y+ up to about 300.
    Automatic,
    /// By the velocity difference over the first cell: the grid resolves the viscous sublayer, y+ about 1.
    Resolved,
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

/// Pseudo-time iterations of the flow.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FlowSolver {
    /// How the implicit system of a pseudo-time step is solved. Without meaning with `[flow.immersed]`.
    pub method: FlowMethod,
    /// A time step is converged when the unsteady residual has dropped by this factor (on a moving grid by a tenth of it). Coupling iterations
    /// that are to agree more closely than a tenth of it tighten it to 10 times `coupling.tolerance`, and those that need few solves end
    /// at a twentieth of that tolerance. No step ends while the velocity of a cell has an error above a tenth of the typical speed. With `[flow.immersed]` the residual of the
    /// constraints of the canopy drops to a hundredth of it, and to a twentieth of `coupling.tolerance`.
    pub residual_drop: f64,
    /// Pseudo-time iterations at most for each time step. Absent: 60 with `gmres`, 2000 with `lu-sgs`. Without meaning with `[flow.immersed]`.
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

/// Convective flux of the flow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Convection {
    /// Smallest share of upwind differences. 1: upwind everywhere. 0: central where grid and time step resolve the flow, which
    /// keeps eddies of few cells; upwind elsewhere, within three cells of the canopy and of walls, and in cells at the outer
    /// boundary. Absent: 0 in laminar flow and with `smagorinsky`, `wale`, `des97` and `ddes`; 1 in inviscid flow and with
    /// `spalart-allmaras`, which resolve no small eddies. Absent in laminar flow with `[flow.immersed]`: 0 up to a largest cell Reynolds
    /// number (speed times `spacing_m` over kinematic viscosity) of 100, 1 from 1000 on.
    pub upwind_share: Option<f64>,
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

impl Scene {
    /// Viscosity of the flow, where the scene has a viscous one.
    pub fn viscosity(&self) -> Option<&Viscosity> {
        self.flow.as_ref()?.viscosity.as_ref()
    }

    /// Wind by height, where the scene has one.
    pub fn shear(&self) -> Option<&Shear> {
        self.flow.as_ref()?.shear.as_ref()
    }

    /// File of the flow grid, where the scene names one.
    pub fn grid_file(&self) -> Option<&GridFile> {
        self.flow.as_ref()?.grid_file.as_ref()
    }
}

/// Refuses a force that the equations or the boundaries do not hold.
fn body_force(f: &Flow, c: &mut Check) {
    const KEY: &str = "flow.body_force_n_m3";
    let Some(force) = f.body_force_n_m3 else { return };
    c.finite(KEY, &force, "the force", "three numbers in N/m3");
    if f.energy.is_some() {
        c.refuse(KEY, "the energy equation has no work of a force", "remove the key or [flow.energy]");
    }
    let patches = f.patches();
    let undisturbed = patches.is_empty() || patches.iter().any(|p| p.1 == Condition::FarField);
    if undisturbed && f.body_force() > 0.0 {
        c.refuse(
            KEY,
            "a force would accelerate the undisturbed air of the far field too",
            "remove the key, or set no patch to \"far-field\": use \"periodic\", \"inlet\" and \"outlet\", or walls",
        );
    }
}

/// Refuses invalid properties of the air and invalid equations, grids, monitors and winds.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let Some(f) = &scene.flow else { return };
    if let Some(altitude) = f.altitude_m {
        c.range(
            "flow.altitude_m",
            altitude,
            ALTITUDES,
            "geopotential altitude of the standard atmosphere, m",
        );
    }
    c.positive("flow.density_kg_m3", f.density_kg_m3, 1000.0, "a density in kg/m3");
    c.range("flow.temperature_k", f.temperature_k, 10.0..=5000.0, "a temperature in kelvin");
    if let Some(share) = f.convection.upwind_share {
        c.range("flow.convection.upwind_share", share, 0.0..=1.0, "a share");
    }
    body_force(f, c);
    flow_grid::generated(&f.grid, c);
    c.positive("flow.solver.residual_drop", f.solver.residual_drop, 0.9, "a factor");
    c.count("flow.solver.max_iterations", f.solver.iterations(), 1..=100_000, "iterations");
    if let Some(v) = &f.viscosity {
        c.positive("flow.viscosity.dynamic_viscosity_pa_s", v.dynamic_viscosity_pa_s, 1e4, "in Pa s");
        if v.wall_treatment.is_some() && v.turbulence.is_none() {
            c.refuse(
                "flow.viscosity.wall_treatment",
                "a laminar flow has no law of the wall: its friction is always resolved",
                "remove the key, or set flow.viscosity.turbulence",
            );
        }
    }
    flow_grid::from_file(f, c);
    monitors::check(f, scene.has_canopy(), c);
    if let Some(s) = &f.shear {
        shear::check(s, f, c);
    }
    if let Some(g) = &f.gust {
        gust::check(g, "flow.gust", c);
    }
    flow_grid::around_panel(scene, f, c);
    flow_grid::around_one_sided(scene, c);
    boundary_values::check(scene, f, c);
    immersed::check(scene, c);
}
