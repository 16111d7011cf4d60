//! Wind by height, data of boundary patches and transported turbulence.

use super::*;
use crate::physics::WallTreatment;
use crate::residual::NearWall;
use crate::topology::Side;

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Lets the wind change with height, in the far field from now on and in all of the air
    /// as it is. The settings' wind is that of [`WindShear::base`].
    pub fn set_shear(&mut self, shear: WindShear) {
        self.sheared = vec![Vec3::zeros(); self.topology.face_nodes.len() - self.topology.cells.len()];
        let [a, b] = &mut self.previous;
        for q in [&mut self.q, &mut a.q, &mut b.q] {
            for (q, x) in q.iter_mut().zip(&self.metrics.centre) {
                let more = shear.excess(x[2]);
                for d in 0..3 {
                    q[1 + d] += more[d];
                }
            }
        }
        self.shear = Some(shear);
    }

    /// Gives boundary patches data of their own. Call it after [`Solver::set_shear`]. The floor of the reference speeds
    /// is at least a tenth of the largest speed among them. Collective.
    ///
    /// # Errors
    /// Data that a patch cannot have.
    pub fn set_boundary_values(&mut self, mut values: BoundaryValues) -> Result<(), FlowError> {
        values.place(self.comm(), &self.metrics)?;
        let faces = self.topology.face_nodes.len() - self.topology.cells.len();
        self.sheared.resize(faces, Vec3::zeros());
        self.boundary.pressure = vec![0.0; faces];
        self.boundary.spin = vec![Vec3::zeros(); faces];
        let speed = values.largest_speed(self.comm(), &self.metrics, self.settings.air.density);
        self.set_speed_scale(speed);
        self.boundary.values = Some(Box::new(values));
        Ok(())
    }

    /// Declares walls of the outer boundary to be at rest in the falling frame, by their named patch: nodes of the grid slide along them.
    pub fn set_walls_at_rest(&mut self, at_rest: impl Fn(Option<u16>) -> bool) {
        let first = self.topology.cells.len();
        self.boundary.at_rest = vec![false; self.topology.face_nodes.len() - first];
        for side in self.topology.no_slip.iter().filter(|s| s.canopy == u32::MAX) {
            self.boundary.at_rest[side.face as usize - first] = at_rest(self.topology.patch_of(side));
        }
    }

    /// Raises the speed scale to `speed`, m/s, whose tenth floors the reference speeds. Where nothing at all moves the air it is a thousandth of
    /// the speed of sound.
    pub fn set_speed_scale(&mut self, speed: f64) {
        let gas = &self.spatial.gas;
        let sound = gas.sound_speed_squared(&gas.undisturbed(self.settings.wind)).sqrt();
        let reference = match self.settings.reference_speed.max(0.1 * speed) {
            0.0 => 1e-4 * sound,
            reference => reference,
        };
        self.settings.reference_speed = reference;
        self.scheme.floor_squared = reference * reference;
    }

    /// Sets the time at the end of the next step, s since the start of the stage, for the data of boundary patches.
    pub fn set_boundary_time(&mut self, time: f64) {
        if let Some(values) = &mut self.boundary.values {
            values.time = time;
        }
    }

    /// Sets the data of boundary patches at the end of the step. Collective.
    pub(super) fn fill_boundary_values(&mut self, moved: bool, dt: f64) -> Result<(), FlowError> {
        let Some(mut values) = self.boundary.values.take() else { return Ok(()) };
        let outcome = self.fill_from(&mut values, moved, dt);
        self.boundary.values = Some(values);
        outcome
    }

    fn fill_from(&mut self, values: &mut BoundaryValues, moved: bool, dt: f64) -> Result<(), FlowError> {
        if moved {
            values.place(self.halo.comm(), &self.metrics)?;
        }
        let first = self.topology.cells.len();
        for side in values.wall_sides() {
            let (velocity, spin) = match moved {
                true => self.rigid_wall(side, dt),
                false => (self.mean_node_velocity(side.face), Vec3::zeros()),
            };
            self.wall_velocity[side.face as usize - first] = velocity;
            self.boundary.spin[side.face as usize - first] = spin;
        }
        let (wind, gas) = (self.scheme.wind, &self.spatial.gas);
        let sound = gas.sound_speed_squared(&gas.undisturbed(wind)).sqrt();
        let mut arrays = BoundaryArrays {
            excess: &mut self.sheared,
            pressure: &mut self.boundary.pressure,
            wall_velocity: &mut self.wall_velocity,
            wall_spin: &mut self.boundary.spin,
        };
        Ok(values.fill(self.halo.comm(), &self.metrics, (wind, sound), &mut arrays)?)
    }

    /// Adds the eddy viscosity of `turbulence`; the stress must be [`crate::physics::EddyViscosity::TransportInput`].
    pub fn set_turbulence(&mut self, turbulence: SpalartAllmaras) {
        assert!(
            self.spatial.viscosity.transported(),
            "this viscosity model has no transported eddy viscosity"
        );
        turbulence.eddy(&self.densities(), &mut self.eddy, &mut self.working);
        self.turbulence = Some(Box::new(turbulence));
    }

    /// The transported turbulence, if any.
    pub fn turbulence(&self) -> Option<&SpalartAllmaras> {
        self.turbulence.as_deref()
    }

    /// Transported dynamic eddy viscosity of local cells, Pa s; empty where there is none.
    pub fn eddy(&self) -> &[f64] {
        &self.eddy
    }

    pub(super) fn densities(&self) -> Vec<f64> {
        self.q.iter().map(|q| self.spatial.gas.density(q)).collect()
    }

    /// Velocity gradient in the cell of each no-slip side, 1/s, where friction follows from the law of the wall; otherwise
    /// empty.
    fn wall_gradient(&self) -> Vec<f64> {
        match self.spatial.viscosity.wall_treatment() {
            WallTreatment::Resolved => Vec::new(),
            WallTreatment::Automatic => self.near_walls().map(|wall| wall.gradient()).collect(),
        }
    }

    /// The air next to each no-slip side of this rank.
    fn near_walls(&self) -> impl Iterator<Item = NearWall> {
        let on = domain!(self);
        self.topology.no_slip.iter().map(move |side| self.spatial.near_wall(&on, &self.scheme, &self.q, side))
    }

    /// Median and largest distance of cell centres from their no-slip wall in wall units, $`y^+`$; `None` where there is no
    /// such wall. Collective.
    pub fn wall_units(&self) -> Option<[f64; 2]> {
        let units = |(side, wall): (&Side, NearWall)| {
            wall.units(self.spatial.gas.density(&self.q[side.cell as usize]))
        };
        let own: Vec<f64> = self.topology.no_slip.iter().zip(self.near_walls()).map(units).collect();
        let mut all = self.comm().all_gather_var(&own);
        let middle = all.len() / 2;
        let largest = all.iter().copied().fold(0.0, f64::max);
        (!all.is_empty()).then(|| [*all.select_nth_unstable_by(middle, f64::total_cmp).1, largest])
    }

    /// Transports the turbulence over the step of length `dt` that was computed last. Collective.
    pub(super) fn advance_turbulence(&mut self, dt: f64) {
        let _part = timing::part("turbulence");
        let Some(mut turbulence) = self.turbulence.take() else { return };
        let (c, gas) = (self.order(dt).c, &self.spatial.gas);
        let mass = |k: usize, i: usize| {
            c[k + 1] / dt * self.previous_volume(k)[i] * gas.density(&self.previous[k].q[i])
        };
        let before: Vec<[f64; 2]> = (0..self.topology.n_owned)
            .map(|i| [mass(0, i), if c[2] == 0.0 { 0.0 } else { mass(1, i) }])
            .collect();
        let density = self.densities();
        let wall_gradient = self.wall_gradient();
        let flow = TransportInput {
            density: &density,
            gradient: &self.gradient,
            face_flux: &self.face_flux,
            before: &before,
            wall_gradient: &wall_gradient,
            nodes: &self.nodes,
            drop: self.settings.residual_drop,
        };
        let taken = turbulence.advance(&domain!(self), &flow);
        if taken.end.is_finite() {
            self.turbulence_excess = taken.end / taken.target.max(f64::MIN_POSITIVE);
            turbulence.accept();
        } else {
            turbulence.value.copy_from_slice(&turbulence.previous[0]);
            self.turbulence_lost = true;
        }
        turbulence.eddy(&density, &mut self.eddy, &mut self.working);
        self.turbulence = Some(turbulence);
    }
}
