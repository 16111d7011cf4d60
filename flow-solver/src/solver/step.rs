//! One time step: from an accepted time level to the next.

use super::iterate::LOOSE_SOLVES;
use super::*;

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Computes the step from the last accepted time level. Collective.
    pub fn advance(&mut self, step: &Step) -> Result<Report, FlowError> {
        if self.turbulence_lost {
            return Err(FlowError::Turbulence);
        }
        let order = self.order(step.dt);
        if step.moved {
            self.move_grid(step.dt)?;
        }
        self.prepare(step, order);
        self.fill_boundary_values(step.moved, step.dt)?;
        let report = self.iterate(step, order)?;
        Ok(report)
    }

    /// Sets the far-field velocity: at the end of the next step of length `dt`, at its start, and
    /// [`Solver::step_before`] earlier, m/s. The air is accelerated as the time
    /// differences see it: a stream without obstacle follows to round-off.
    pub fn set_far_field_velocity(&mut self, wind: [Vec3; 3], dt: f64) {
        let c = self.order(dt).c;
        self.settings.wind = wind[0];
        self.wind_gain = [wind[0] - wind[1], wind[1] - wind[2]];
        self.wind_change = if self.settings.moving {
            [Vec3::zeros(), (wind[1] - wind[0]) * (c[1] / dt), (wind[2] - wind[0]) * (c[2] / dt)]
        } else {
            [(wind[0] * c[0] + wind[1] * c[1] + wind[2] * c[2]) / dt, Vec3::zeros(), Vec3::zeros()]
        };
    }

    /// Length of the step before one of length `dt`, as its time difference sees it, s.
    pub fn step_before(&self, dt: f64) -> f64 {
        if self.order(dt) == Backward::FIRST { dt } else { self.last_dt }
    }

    /// Backward difference for a step of length `dt`.
    pub(super) fn order(&self, dt: f64) -> Backward {
        if self.first_order_steps > 0 { Backward::FIRST } else { Backward::second(dt / self.last_dt) }
    }

    /// Constants of the step: grid fluxes, history of the time derivative, weights.
    pub(super) fn prepare(&mut self, step: &Step, order: Backward) {
        let _part = timing::part("time derivative");
        let dt = step.dt;
        let swept = self.swept.iter().zip(&self.swept_before).map(|(now, before)| (*now, *before));
        let swept = swept.chain(std::iter::repeat((0.0, 0.0)));
        for (f, (now, before)) in self.metrics.faces.iter_mut().zip(swept) {
            f.grid_flux = order.grid_flux(now, before, dt);
            f.grid_flux += f.area.dot(&step.frame);
        }
        self.scheme.rate = order.c[0] / dt;
        self.scheme.rhie_chow =
            if self.rhie_chow_is_reset { Backward::FIRST } else { order }.c.map(|c| c / dt);
        self.scheme.frame = step.frame;
        self.scheme.wind = self.settings.wind;
        if let Some(shear) = &mut self.shear {
            shear.advance(step.frame[2] * dt, &self.topology, &self.metrics, &mut self.sheared);
        }
        let gas = &self.spatial.gas;
        let moving = self.settings.moving;
        let volumes = [0, 1].map(|k| if moving { &self.previous[k].volume } else { &self.metrics.volume });
        let old = |k: usize, c: f64, i: usize| {
            let (q, volume) = (&self.previous[k].q[i], volumes[k]);
            let m = c / dt * volume[i] * gas.density(q);
            gas.stored(q).map(|s| m * s)
        };
        for (i, h) in self.history.iter_mut().enumerate() {
            *h = old(0, order.c[1], i);
            if order.c[2] != 0.0 {
                let older = old(1, order.c[2], i);
                for (h, o) in h.iter_mut().zip(older) {
                    *h += o;
                }
            }
        }
        self.add_sources();
    }

    /// Adds the sources to what is constant in the step.
    pub(super) fn add_sources(&mut self) {
        for ((h, s), v) in self.history.iter_mut().zip(&self.source).zip(&self.metrics.volume) {
            for (h, s) in h.iter_mut().zip(s) {
                *h -= v * s;
            }
        }
    }

    /// The step becomes the state that later steps start from.
    pub fn accept(&mut self, dt: f64, moved: bool) {
        self.advance_turbulence(dt);
        self.few_solves_before = self.repetition < LOOSE_SOLVES;
        self.last_dt = dt;
        self.first_order_steps = self.first_order_steps.saturating_sub(1);
        self.previous.swap(0, 1);
        let [now, _] = &mut self.previous;
        now.q.copy_from_slice(&self.q);
        if self.settings.moving {
            now.volume.copy_from_slice(&self.metrics.volume);
            now.nodes.copy_from_slice(&self.nodes);
        }
        for t in &mut self.face_flux {
            t.previous = [t.rhie_chow, t.previous[0]];
        }
        self.rhie_chow_is_reset = false;
        std::mem::swap(&mut self.swept, &mut self.swept_before);
        if !moved {
            self.swept_before.fill(0.0);
        }
        self.swept.fill(0.0);
        if let Some(shear) = &mut self.shear {
            shear.accept();
        }
    }
}
