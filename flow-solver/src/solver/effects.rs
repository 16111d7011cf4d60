//! Wind by height and transported turbulence.

use super::*;

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

    /// Adds the eddy viscosity of `turbulence`; the stress must be [`crate::physics::EddyViscosity::TransportInput`].
    pub fn set_turbulence(&mut self, turbulence: SpalartAllmaras) {
        assert!(
            self.spatial.viscosity.transported(),
            "this viscosity model has no transported eddy viscosity"
        );
        turbulence.eddy(&self.densities(), &mut self.eddy);
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
        let flow = TransportInput {
            density: &density,
            gradient: &self.gradient,
            face_flux: &self.face_flux,
            before: &before,
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
        turbulence.eddy(&density, &mut self.eddy);
        self.turbulence = Some(turbulence);
    }
}
