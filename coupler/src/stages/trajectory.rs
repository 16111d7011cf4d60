//! Trajectory stage: the frame as a falling mass under a quasi-steady force of the air. No program runs; canopy and load stay as they are.

use case::{AirMotion, StageKind};
use channel::Window;
use coupling::descent::DescentModel;
use coupling::error::RunError;
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};
use coupling::trajectory::{Air, FallState, FallingMass, ForceAreas, MOST_STEPS};
use mesh::geometry::Vec3;
use results::mean_descent::{MeanDescent, air_over_ground};
use results::settled::decimals;

use super::{StageContext, Stepper};

/// A stage whose frame falls by itself.
pub(super) struct TrajectoryStage<'c> {
    context: &'c StageContext<'c>,
    mass: FallingMass,
    undisturbed: AirMotion,
    state: InterfaceState,
    /// Velocity of the frame at the end of the coupled stage less that of its mean motion, m/s: the swing, which a stage that follows continues.
    fluctuation: Vec3,
    /// What the next stage starts from, once the stage is complete.
    end: Option<InterfaceState>,
}

impl<'c> TrajectoryStage<'c> {
    /// A stage that continues from `state`.
    pub fn new(context: &'c StageContext<'c>, state: InterfaceState) -> Result<Self, RunError> {
        let scene = context.scene;
        let Some(model) = context.descent() else {
            return Err(RunError::Input("a trajectory needs [descent]".into()));
        };
        let undisturbed = scene.air_motion(context.stage, &context.times());
        let mut this = Self {
            context,
            mass: falling_mass(&model, given_areas(context)),
            undisturbed,
            state,
            fluctuation: Vec3::zeros(),
            end: None,
        };
        if context.description().trajectory.as_ref().is_none_or(|t| t.drag_area_m2.is_none()) {
            this.continue_mean_motion(&model)?;
        }
        this.announce();
        Ok(this)
    }

    /// Takes the areas from the mean motion of the coupled stage before, and continues that motion in the air of this height.
    fn continue_mean_motion(&mut self, model: &DescentModel) -> Result<(), RunError> {
        let context = self.context;
        let Some(before) = context.scene.coupled_before(context.stage) else {
            return Err(RunError::Input("no coupled stage gives the drag area of this one".into()));
        };
        let mean = MeanDescent::of_stage(context.scene, context.out, before)?;
        let name = &context.scene.stages[before].name;
        let weight = model.mass_kg * model.gravity_m_s2;
        let air = Vec3::from(mean.air_m_s);
        let areas = ForceAreas::in_equilibrium(weight, model.air_density_kg_m3, air, model.axes);
        let Some(areas) = areas else {
            return Err(RunError::Input(format!(
                "stage `{}` cannot continue the mean motion of stage `{name}`: the air does not rise past the payload there, but moves with \
                 [{:.3}, {:.3}, {:.3}] m/s. Give its areas: [stage.trajectory] with drag_area_m2",
                context.description().name,
                mean.air_m_s[0],
                mean.air_m_s[1],
                mean.air_m_s[2]
            )));
        };
        self.mass = falling_mass(model, areas);
        self.report(&mean, name);
        // The stage before has one density; a trajectory before has that of the height.
        let here = self.air(0.0, Vec3::from(self.state.position));
        let slower = (model.air_density_kg_m3 / here.density_kg_m3).sqrt();
        let trajectory = context
            .stage
            .checked_sub(1)
            .is_some_and(|k| context.scene.stages[k].kind == StageKind::Trajectory);
        let steady = |factor: f64| self.moving(here.wind_m_s - air * factor);
        let (before, now) = (steady(if trajectory { slower } else { 1.0 }), steady(slower));
        self.fluctuation = Vec3::from(self.state.velocity) - before;
        self.state.velocity = now.into();
        Ok(())
    }

    /// The velocity `v` (m/s) in the axes in which the frame moves, that of the frame in others.
    fn moving(&self, v: Vec3) -> Vec3 {
        let moves = self.mass.axes.range();
        Vec3::from_fn(|i, _| if moves.contains(&i) { v[i] } else { self.state.velocity[i] })
    }

    /// Prints the areas with their uncertainty; warns where the mean motion is not settled.
    fn report(&self, mean: &MeanDescent, from: &str) {
        let (context, areas) = (self.context, &self.mass.areas);
        let stage = &context.description().name;
        let span = format!("the mean velocity of stage `{from}`, {:.2} to {:.2} s", mean.from_s, mean.to_s);
        // The area is that of the square of the speed.
        let share = mean.interval_95.map(|half_width| 2.0 * half_width / Vec3::from(mean.air_m_s).norm());
        let area = match share.map(|share| share * areas.drag_m2) {
            Some(half) => {
                let places = decimals(half);
                format!("{:.places$} ± {half:.places$} m2 (95 %)", areas.drag_m2)
            }
            None => format!("{:.3} m2", areas.drag_m2),
        };
        let line =
            format!("stage `{stage}`: drag area {area}, lift area {:.3} m2, from {span}", areas.lift_m2);
        match &mean.doubt {
            None => context.console.line(&line),
            Some(why) => context.console.warning(&format!(
                "{line}, which is not that of a settled descent: {why}. The speed of this stage is as uncertain as that mean. Remedies: a \
                 longer stage `{from}`, or drag_area_m2 in [stage.trajectory]"
            )),
        }
    }

    /// Prints what a gust is to this stage.
    fn announce(&self) {
        let stage = self.context.description();
        if self.undisturbed.wind().gusts(stage.planned_s()) {
            self.context.console.warning(&format!(
                "stage `{}`: the answer to a gust is quasi-steady: without the inertia of the air around the canopy and without swing",
                stage.name
            ));
        }
    }

    /// The error of a window that the fall cannot be resolved in.
    fn too_long(&self, w: &Window) -> RunError {
        RunError::Input(format!(
            "stage `{}`, window {} (t = {} s): a window of {} s takes more than {MOST_STEPS:.0e} steps of the fall, or its end is not finite. \
             Likely cause: a drag area of {:.3} m2 that is too large for {:.3} kg, or a long window. Remedy: a shorter window_s, another drag_area_m2",
            self.context.description().name,
            w.index,
            w.time,
            w.dt,
            self.mass.areas.drag_m2,
            self.mass.mass_kg
        ))
    }

    /// The air at `t` (s since the start of the stage) and a position of the frame (m).
    fn air(&self, t: f64, position: Vec3) -> Air {
        let (scene, z) = (self.context.scene, position[2]);
        Air {
            density_kg_m3: scene.density_at(z).unwrap_or_default(),
            wind_m_s: air_over_ground(scene, &self.undisturbed, t, z).into(),
        }
    }
}

/// The areas that the stage gives.
fn given_areas(context: &StageContext<'_>) -> ForceAreas {
    let given = context.description().trajectory.clone().unwrap_or_default();
    let [x, y] = given.lift_direction.unwrap_or([1.0, 0.0]);
    ForceAreas {
        drag_m2: given.drag_area_m2.unwrap_or(0.0),
        lift_m2: given.lift_area_m2.unwrap_or(0.0),
        direction: [x / x.hypot(y), y / x.hypot(y)],
    }
}

fn falling_mass(model: &DescentModel, areas: ForceAreas) -> FallingMass {
    FallingMass { mass_kg: model.mass_kg, gravity_m_s2: model.gravity_m_s2, areas, axes: model.axes }
}

impl Stepper for TrajectoryStage<'_> {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        let start = FallState {
            position: Vec3::from(self.state.position),
            velocity: Vec3::from(self.state.velocity),
        };
        let end = self.mass.advance(start, w.time, w.dt, |t, x| self.air(t, x));
        let end = end.ok_or_else(|| self.too_long(&w))?;
        let here = self.air(w.time + w.dt, end.position);
        let force = self.mass.areas.force(here.density_kg_m3, here.wind_m_s - end.velocity);
        self.state.acceleration = ((end.velocity - start.velocity) / w.dt).into();
        (self.state.position, self.state.velocity) = (end.position.into(), end.velocity.into());
        let mut report =
            WindowReport { iterations: 1, converged: true, force: force.into(), ..WindowReport::default() };
        report.add_acceptance(partners.accept(&w)?);
        Ok(report)
    }

    fn state(&self) -> &InterfaceState {
        self.end.as_ref().unwrap_or(&self.state)
    }

    fn settled(&self, _report: &WindowReport) -> Option<String> {
        let scene = self.context.scene;
        let end = self.context.description().trajectory.as_ref()?.end_height_m?;
        let height = scene.release_height()? + self.state.position[2];
        (height <= end).then(|| format!("at {height:.2} m above ground"))
    }

    fn air(&self, t: f64) -> Option<[f64; 3]> {
        let air = self.air(t, Vec3::from(self.state.position));
        Some((air.wind_m_s - Vec3::from(self.state.velocity)).into())
    }

    fn close(&mut self) {
        self.end = Some(InterfaceState {
            velocity: (Vec3::from(self.state.velocity) + self.fluctuation).into(),
            ..self.state.clone()
        });
    }

    fn save_state(&self) -> Vec<u8> {
        let areas = &self.mass.areas;
        let direction = (areas.drag_m2, areas.lift_m2, areas.direction);
        let fluctuation: [f64; 3] = self.fluctuation.into();
        pack(&(&self.state, direction, fluctuation))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let (state, (drag_m2, lift_m2, direction), fluctuation): (_, _, [f64; 3]) = unpack(saved)?;
        self.mass.areas = ForceAreas { drag_m2, lift_m2, direction };
        (self.state, self.fluctuation) = (state, Vec3::from(fluctuation));
        Ok(())
    }
}
