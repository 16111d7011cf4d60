//! What a window of a stage gives to its history: drag, wake, motion over ground, energies.

use case::{Canopy, Role, StageKind, WatchedForce};
use channel::Window;
use coupling::flow_bounds;
use coupling::schemes::WindowReport;
use results::history::{Row, Trajectory};
use results::mean_descent::air_over_ground;
use results::wake::{self, Sample};

use super::stage_run::StageRun;

impl<'c> StageRun<'c, '_> {
    /// The force that the stage reports as its drag.
    fn watched(&self) -> WatchedForce<'c> {
        self.context.scene.watched_force(self.context.description().kind)
    }

    /// Coefficient of the drag `drag_n`, N, at the end of the window.
    fn drag_coefficient(&self, drag_n: f64) -> Option<f64> {
        let (context, scene) = (self.context, self.context.scene);
        match self.watched() {
            WatchedForce::Canopy => self.descent.and_then(|d| d.drag_coefficient(drag_n)),
            WatchedForce::Walls => None,
            WatchedForce::Entry(entry) => {
                let flow = scene.flow.as_ref()?;
                if entry.reference_speed_m_s.is_none() && flow.shear.is_some() {
                    // The speed depends on the height: `forces.csv` has the coefficient.
                    return None;
                }
                let wind = scene.wind(context.stage, &context.times());
                let velocity = self.stepper.state().velocity;
                let air = flow_bounds::undisturbed_air(&wind, self.clock.time(), velocity);
                let speed = air.iter().map(|v| v * v).sum::<f64>().sqrt();
                entry.force_scale(flow.density_kg_m3, speed).map(|scale| drag_n / scale)
            }
        }
    }

    /// The wake at the end of a window of length `dt` (s); `None` where it is not assessed.
    fn wake(&self, dt: f64, report: &WindowReport) -> Option<Sample> {
        let (context, stage) = (self.context, self.context.description());
        let scene = context.scene;
        let flows = stage.kind.roles().contains(&Role::Flow) && stage.in_time();
        // A grid of one's own may have walls next to the canopy.
        let open = scene.descent.is_some() || scene.grid_file().is_none();
        let enclosed = matches!(scene.canopy, Canopy::Panel(_) | Canopy::AirBag(_) | Canopy::None);
        if !flows || !open || enclosed || self.watched() != WatchedForce::Canopy {
            return None;
        }
        let state = self.stepper.state();
        let wind = scene.wind(context.stage, &context.times());
        let air = flow_bounds::undisturbed_air(&wind, self.clock.time(), state.velocity);
        let speed = air.iter().map(|v| v * v).sum::<f64>().sqrt();
        let across = wake::diameter(context.interface.projected_area(&state.displacement));
        let passed = if across > 0.0 { dt * speed / across } else { 0.0 };
        let before = self.summary.wake_samples.last().map_or(0.0, |s| s.diameters);
        Some(Sample {
            time_s: self.clock.time(),
            drag_n: report.force[2],
            side_n: [report.force[0], report.force[1]],
            pendulum_deg: context.interface.pendulum_angle(&state.displacement).map(f64::to_degrees),
            pendulum_xy_deg: context
                .interface
                .pendulum_components(&state.displacement)
                .map(|xy| xy.map(f64::to_degrees)),
            diameters: before + passed,
            speed_m_s: speed,
        })
    }

    /// Motion over ground at the end of a window; `None` where programs run and the frame moves vertically.
    fn trajectory(&self) -> Option<Trajectory> {
        let (context, scene) = (self.context, self.context.scene);
        let state = self.stepper.state();
        if let Some(air) = self.stepper.air(self.clock.time()) {
            let air_m_s = Some(air);
            return Some(Trajectory { position_m: state.position, velocity_m_s: state.velocity, air_m_s });
        }
        scene.frame_drifts().then(|| {
            let undisturbed = scene.air_motion(context.stage, &context.times());
            let air = air_over_ground(scene, &undisturbed, self.clock.time(), state.position[2]);
            // Positions count from the release.
            let known = scene.shear().is_none() || context.description().kind == StageKind::Coupled;
            Trajectory {
                position_m: state.position,
                velocity_m_s: state.velocity,
                air_m_s: known.then(|| std::array::from_fn(|i| air[i] - state.velocity[i])),
            }
        })
    }

    /// The history row of a window; adds the window to the interface energy balance.
    pub(super) fn row(&mut self, window: &Window, report: WindowReport) -> Row {
        let wall_s = self.started.elapsed().as_secs_f64();
        let (on_structure, by_flow) = self.stepper.interface_work().unwrap_or_default();
        self.interface_energy.add_window(window.dt, on_structure, by_flow, report.converged);
        let state = self.stepper.state();
        let direction = self.context.scene.watched_direction(self.context.description().kind);
        let drag_n = match self.watched() {
            WatchedForce::Canopy => report.force[2],
            _ => direction.iter().zip(&report.force).map(|(d, f)| d * f).sum(),
        };
        Row {
            window: self.index,
            time_s: self.clock.time(),
            window_s: window.dt,
            rejected: self.rejected,
            done: self.clock.planned(),
            // A frame at rest has no sign.
            descent_speed_m_s: 0.0 - state.velocity[2],
            acceleration_m_s2: state.acceleration[2],
            trajectory: self.trajectory(),
            drag_n,
            drag_coefficient: self.drag_coefficient(drag_n),
            wake: self.wake(window.dt, &report),
            interface_work_j: by_flow,
            energy_error_j: on_structure - by_flow,
            interface_energy: self.interface_energy,
            balance: self.stepper.system_balance().copied(),
            coupler_s: (wall_s - report.accept_wall_s - report.wall_s.iter().sum::<f64>()).max(0.0),
            wall_s,
            report,
        }
    }
}
