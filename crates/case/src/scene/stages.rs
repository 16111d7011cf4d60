//! `[[stage]]`: what runs, for how long, under which loads.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{body_motion, perturbation, steady, trajectory, wind};
use crate::check::{Check, NAME_OF_FOLDER, plain_name};
use crate::{
    ALTITUDES, BodyMotion, Canopy, Clock, Force, Gust, Motion, Perturbation, Role, Scene, StageWind, Steady,
    Trajectory,
};

/// One stage of a run.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Name of the stage and of its result folder.
    pub name: String,
    /// What runs.
    pub kind: StageKind,
    /// How the flow meets the canopy in this stage, where `[flow.immersed]` gives the choice: with `fitted` the scene has both methods, and the flow of the
    /// stage before is interpolated to the grid of this one, conserving momentum. Absent: `immersed` with `[flow.immersed]`, else `fitted`.
    pub flow_method: Option<Discretisation>,
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
    /// Uniform pressure jump on the canopy, Pa (pre-inflation; none in a scene without `[fabric]`).
    pub pressure_pa: Option<f64>,
    /// Mass-proportional damping of the structure in this stage, 1/s.
    #[serde(default)]
    pub mass_damping_per_s: f64,
    /// Stiffness-proportional damping of the structure in this stage, s: the stress
    /// that it adds is this time times the rate of the elastic stress. Retardation times of materials add to it.
    #[serde(default)]
    pub stiffness_damping_s: f64,
    /// Ends the stage early once the kinetic energy of the structure is below
    /// this share of its strain energy.
    pub settled_energy_ratio: Option<f64>,
    /// Steady wind of this stage. Absent: `flow.wind_m_s`.
    pub wind: Option<StageWind>,
    /// A gust in this stage. Absent: `[flow.gust]`.
    pub gust: Option<Gust>,
    /// A short pulse of wind across the stream, in addition to wind and gust, that takes the wake out of its symmetric state.
    pub perturbation: Option<Perturbation>,
    /// Altitude, m, whose standard air the stage has instead of that of `flow.altitude_m`: density, temperature and viscosity change in the
    /// ratio in which they change between both. For a stage that follows a long fall. Absent: `flow.altitude_m`.
    pub altitude_m: Option<f64>,
    /// Forces on the frame in a stage of kind `trajectory`.
    pub trajectory: Option<Trajectory>,
    /// Prescribed motions of nodes.
    #[serde(default, rename = "motion")]
    pub motions: Vec<Motion>,
    /// Prescribed motions of rigid bodies.
    #[serde(default, rename = "body_motion")]
    pub body_motions: Vec<BodyMotion>,
    /// Forces on nodes.
    #[serde(default, rename = "force")]
    pub forces: Vec<Force>,
}

fn ten() -> u32 {
    10
}

/// How the grid of the flow meets the canopy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Discretisation {
    /// A grid that is fitted to the canopy and moves with it, `[flow.grid]`.
    Fitted,
    /// A Cartesian grid through which the canopy moves, `[flow.immersed]`.
    Immersed,
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
    /// Mesh and flow around a canopy that moves by `[[stage.motion]]` and bodies that move by `[[stage.body_motion]]`, at
    /// the initial descent speed.
    Prescribed,
    /// No program: the frame moves as a point mass under weight and a quasi-steady force of the air (`[stage.trajectory]`).
    Trajectory,
}

impl StageKind {
    /// The programs that a stage of this kind needs around a fitted grid ([`Scene::roles`](crate::Scene::roles)).
    pub fn roles(self) -> &'static [Role] {
        match self {
            StageKind::PreInflation => &[Role::Structure],
            StageKind::FlowOnly => &[Role::Flow],
            StageKind::Coupled => &[Role::Structure, Role::Flow, Role::Mesh],
            StageKind::Prescribed => &[Role::Flow, Role::Mesh],
            StageKind::Trajectory => &[],
        }
    }
}

impl Scene {
    /// How the flow meets the canopy in `stage`.
    pub fn discretisation(&self, stage: &Stage) -> Discretisation {
        let immersed = self.flow.as_ref().is_some_and(crate::Flow::is_immersed);
        let all = if immersed { Discretisation::Immersed } else { Discretisation::Fitted };
        stage.flow_method.unwrap_or(all)
    }

    /// Whether the canopy moves through a Cartesian grid in `stage`.
    pub fn is_immersed(&self, stage: &Stage) -> bool {
        self.discretisation(stage) == Discretisation::Immersed
    }

    /// The scene as the programs of stage `k` see it: with the air of its altitude, without `[flow.immersed]` where the stage has a fitted grid. Every stage names its method.
    pub fn for_stage(&self, k: usize) -> Self {
        let mut view = self.clone();
        for (own, stage) in view.stages.iter_mut().zip(&self.stages) {
            own.flow_method = Some(self.discretisation(stage));
        }
        let altitude = self.stages.get(k).and_then(|s| s.altitude_m);
        if let (Some(flow), Some(altitude)) = (view.flow.as_mut(), altitude) {
            flow.move_to(altitude);
        }
        let fitted = self.stages.get(k).is_some_and(|s| !self.is_immersed(s));
        if let Some(flow) = view.flow.as_mut().filter(|_| fitted) {
            flow.immersed = None;
        }
        view
    }

    /// [`Self::for_stage`] of one stage of each method among the stages with flow from `first` on: one view, but two where a run changes the method.
    pub fn views(&self, first: usize) -> Vec<Self> {
        let flows = |k: &usize| self.stages[*k].kind.roles().contains(&Role::Flow);
        let stages = || (first..self.stages.len()).filter(flows);
        let Some(one) = stages().next() else { return vec![self.clone()] };
        let method = |k: usize| self.discretisation(&self.stages[k]);
        let other = stages().find(|k| method(*k) != method(one));
        [Some(one), other].into_iter().flatten().map(|k| self.for_stage(k)).collect()
    }

    /// Whether `stage` runs the flow by the method of this view ([`Self::for_stage`]), or no flow.
    pub fn is_of_view(&self, stage: &Stage) -> bool {
        let immersed = self.flow.as_ref().is_some_and(crate::Flow::is_immersed);
        !stage.kind.roles().contains(&Role::Flow) || self.is_immersed(stage) == immersed
    }

    /// The programs that `stage` needs: the mesh-mover only where a grid is fitted to the canopy.
    pub fn roles(&self, stage: &Stage) -> &'static [Role] {
        let immersed = self.is_immersed(stage);
        match stage.kind {
            StageKind::Coupled if immersed => &[Role::Structure, Role::Flow],
            StageKind::Prescribed if immersed => &[Role::Flow],
            kind => kind.roles(),
        }
    }
}

impl Stage {
    /// Whether the stage runs in time.
    pub fn in_time(&self) -> bool {
        self.solve != Solve::Static && self.steady.is_none()
    }

    /// Windows of the stage: its duration in window lengths, rounded, at least one.
    pub fn windows(&self) -> u64 {
        (self.duration_s / self.window_s).round().max(1.0) as u64
    }

    /// Time that the stage takes as planned, s: whole windows.
    pub fn planned_s(&self) -> f64 {
        if self.in_time() { self.windows() as f64 * self.window_s } else { 0.0 }
    }
}

/// Refuses stages that contradict themselves, each other or the rest of the scene.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    if scene.stages.is_empty() {
        c.refuse("stage", "the scene has no stage", "add at least one [[stage]]");
    }
    for (k, stage) in scene.stages.iter().enumerate() {
        let at = |key: &str| format!("stage[{k}].{key}");
        name(scene, k, &at, c);
        steady::check(scene, stage, &at, c);
        wind::of_stage(scene, stage, &at, c);
        perturbation::check(scene, k, &at, c);
        prescribed(scene, k, &at, c);
        body_motion::check(scene, k, &at, c);
        trajectory::check(scene, k, &at, c);
        altitude(scene, k, &at, c);
        times(stage, &at, c);
        steps_and_damping(stage, &at, c);
        nodes(stage, &at, c);
        pressure(stage, scene.has_fabric(), &at, c);
        flow(scene, stage, &at, c);
        flow_method(scene, k, &at, c);
        open_vents(scene, k, &at, c);
    }
}

fn name(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let (path, name) = (at("name"), &scene.stages[k].name);
    if !plain_name(name) {
        c.refuse(&path, format!("`{path}` is \"{name}\""), NAME_OF_FOLDER);
    }
    if scene.stages[..k].iter().any(|s| &s.name == name) {
        c.refuse(&path, format!("two stages are named \"{name}\""), "give each stage its own name");
    }
}

/// Durations: every stage has them but a static one.
fn times(s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if !s.in_time() {
        if s.solve == Solve::Static && s.kind != StageKind::PreInflation {
            c.refuse(
                &at("solve"),
                format!("stage \"{}\" runs the flow, which has no static solution here", s.name),
                "use solve = \"static\" in a stage of kind \"pre-inflation\", [stage.steady] in one of kind \"flow-only\"",
            );
        }
        for (key, value) in [("duration_s", s.duration_s), ("window_s", s.window_s)] {
            if value != 0.0 {
                c.refuse(
                    &at(key),
                    format!("`{key}` of a static or steady stage is {value}, but such a stage takes no time"),
                    "remove it",
                );
            }
        }
        return;
    }
    for (key, value, what) in
        [("duration_s", s.duration_s, "simulated time, s"), ("window_s", s.window_s, "length of a window, s")]
    {
        if value == 0.0 {
            c.refuse(
                &at(key),
                format!("stage \"{}\" has no `{key}`", s.name),
                format!("add `{key} = ...`: {what}"),
            );
        }
    }
    if s.duration_s != 0.0 && s.window_s != 0.0 {
        c.positive(&at("duration_s"), s.duration_s, 1e6, "in seconds");
        c.positive(
            &at("window_s"),
            s.window_s,
            s.duration_s.max(1e-9),
            "a window is not longer than its stage",
        );
    }
}

fn steps_and_damping(s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    c.count(&at("substeps"), s.substeps, 1..=100_000, "structural steps in a window");
    c.range(&at("mass_damping_per_s"), s.mass_damping_per_s, 0.0..=1e6, "in 1/s");
    c.range(&at("stiffness_damping_s"), s.stiffness_damping_s, 0.0..=1e3, "in seconds");
    if let Some(r) = s.settled_energy_ratio {
        c.positive(&at("settled_energy_ratio"), r, 1.0, "kinetic over strain energy");
    }
}

/// Motions and forces of nodes.
fn nodes(s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if s.kind == StageKind::FlowOnly && !(s.motions.is_empty() && s.forces.is_empty()) {
        c.refuse(
            &at("kind"),
            format!("stage \"{}\" has no structure that could be moved or loaded", s.name),
            "remove its [[stage.motion]] and [[stage.force]]",
        );
    }
    for (k, force) in s.forces.iter().enumerate() {
        force.check(&at(&format!("force[{k}]")), c);
    }
    for (k, motion) in s.motions.iter().enumerate() {
        motion.check(&at(&format!("motion[{k}]")), s.solve == Solve::Static, s.duration_s, c);
        if s.solve == Solve::Static && motion.clock.is_some_and(|clock| clock != Clock::Stage) {
            c.refuse(
                &at(&format!("motion[{k}].clock")),
                format!("stage \"{}\" is static: no clock runs in it", s.name),
                "remove `clock`: the stage ends at the last displacement",
            );
        }
    }
}

/// An altitude belongs to a stage with the air of the standard atmosphere.
fn altitude(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let s = &scene.stages[k];
    let Some(altitude) = s.altitude_m else { return };
    let path = at("altitude_m");
    c.range(&path, altitude, ALTITUDES, "geopotential altitude of the standard atmosphere, m");
    if !s.kind.roles().contains(&Role::Flow) {
        c.refuse(&path, format!("stage \"{}\" runs no flow whose air could be another", s.name), "remove it");
    } else if scene.flow.as_ref().is_some_and(|f| f.altitude_m.is_none()) {
        c.refuse(
            &path,
            "the air of the scene is not that of an altitude, so that it has no ratio to that of this one",
            "set flow.altitude_m, the altitude of the release, or remove it",
        );
    }
}

/// A pre-inflation of fabric has a pressure, and nothing else has.
fn pressure(s: &Stage, fabric: bool, at: &dyn Fn(&str) -> String, c: &mut Check) {
    match (s.kind, s.pressure_pa) {
        (StageKind::PreInflation, None) if !fabric => {}
        (StageKind::PreInflation, Some(p)) if !fabric && p != 0.0 => c.refuse(
            &at("pressure_pa"),
            format!("{p} Pa act on fabric, and the scene has no [fabric]"),
            "remove `pressure_pa`, or add [fabric], if the mesh file has surfaces of fabric",
        ),
        (StageKind::PreInflation, None) => c.refuse(
            &at("name"),
            format!("stage \"{}\" inflates, but with no pressure", s.name),
            "add `pressure_pa = ...` (the paper: 14.5672)",
        ),
        (StageKind::PreInflation, Some(p)) => {
            c.range(&at("pressure_pa"), p, -1e7..=1e7, "a pressure in Pa");
        }
        (_, Some(_)) => c.refuse(
            &at("pressure_pa"),
            "`pressure_pa` belongs to a pre-inflation stage",
            "remove it: here the flow makes the pressure",
        ),
        _ => {}
    }
}

/// A stage with the flow has air and a grid.
fn flow(scene: &Scene, s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if matches!(s.kind, StageKind::PreInflation | StageKind::Trajectory) {
        return;
    }
    if scene.flow.is_none() {
        c.refuse(&at("kind"), format!("stage \"{}\" needs the flow", s.name), "add a [flow] section");
    }
    let gridless = matches!(
        scene.canopy,
        Canopy::AirBag(_) | Canopy::Gmsh(_) | Canopy::Gored(_) | Canopy::Cross(_) | Canopy::Pattern(_)
    );
    let fitted = gridless && !scene.is_immersed(s);
    if fitted && scene.grid_file().is_none() {
        c.refuse(
            &at("kind"),
            "an air-bag octant, a canopy of gores, a cross or a canopy from a file has no flow grid around it",
            "use kind = \"pre-inflation\", give a grid by [flow.grid_file], or use [flow.immersed] without flow_method = \"fitted\"",
        );
    }
}

/// A method is that of a section, and does not change after the canopy was moved without a structure.
fn flow_method(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let s = &scene.stages[k];
    let immersed = scene.flow.as_ref().is_some_and(crate::Flow::is_immersed);
    if s.flow_method == Some(Discretisation::Immersed) && !immersed {
        c.refuse(
            &at("flow_method"),
            format!("stage \"{}\" has an immersed canopy, but the scene no grid for it", s.name),
            "add [flow.immersed] with spacing_m, or remove `flow_method`",
        );
    }
    let before = (0..k).rev().map(|b| &scene.stages[b]).find(|b| b.kind == StageKind::Prescribed);
    let flows = s.kind.roles().contains(&Role::Flow);
    if before.is_some_and(|b| flows && scene.is_immersed(b) != scene.is_immersed(s)) {
        c.refuse(
            &at("flow_method"),
            "the flow method changes after a stage of kind \"prescribed\", whose canopy moves without the structure that the new grid starts from",
            "use the same `flow_method` as in the stage before",
        );
    }
}

/// A grid that moves through vents starts around an inflated canopy.
fn open_vents(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let moves = matches!(scene.stages[k].kind, StageKind::Coupled | StageKind::Prescribed);
    let opens = |s: &Stage| {
        s.kind == StageKind::PreInflation || (s.kind == StageKind::Coupled && scene.is_immersed(s))
    };
    let inflated = scene.stages[..k].iter().any(opens);
    let fitted = !scene.is_immersed(&scene.stages[k]);
    if moves && fitted && scene.has_vents() && !inflated {
        c.refuse(
            &at("kind"),
            "the vents of the unstressed canopy are closed slits: no flow grid fits them",
            "put a stage of kind \"pre-inflation\", or a coupled one with an immersed canopy, before this one",
        );
    }
}

/// A stage whose canopy moves as prescribed.
fn prescribed(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let s = &scene.stages[k];
    if s.kind != StageKind::Prescribed {
        return;
    }
    if s.motions.is_empty() && s.body_motions.is_empty() {
        c.refuse(
            &at("kind"),
            format!("stage \"{}\" moves canopy and bodies as prescribed, but prescribes nothing", s.name),
            "add a [[stage.motion]] of the canopy or a [[stage.body_motion]], or use kind = \"flow-only\"",
        );
    }
    if !s.forces.is_empty() {
        c.refuse(&at("force"), "forces need a structure, and a prescribed motion has none", "remove them");
    }
    if scene.stages[k..].iter().any(|s| s.kind.roles().contains(&Role::Structure)) {
        c.refuse(
            &at("kind"),
            "a later stage would start from a structure that has not moved along",
            "put stages of kind \"prescribed\" last",
        );
    }
}
