//! The flux through a plane of symmetry: that between a cell and its mirror image.
//!
//! No mass passes, and what the image adds to the stress along the plane cancels. What remains acts along the normal:
//! the pressure of the reconstructed states, the velocity diffusion of their jump in the upwind share of the flux, and the
//! correction to the split form in the central one. A domain cut by such a plane then has the digits of the whole.

use crate::geometry::vec3::Vec3;
use crate::gradient::{self, Field};
use crate::physics::{
    Blending, FluxParameters, Gas, VELOCITY_DIFFUSION, relative_speed, split_form_correction, velocity,
};
use crate::residual::{Domain, Spatial};
use crate::topology::Side;

/// A cell at a plane of symmetry, continued to the plane.
#[derive(Clone, Copy, Debug)]
pub struct Mirrored {
    /// Gauge pressure, Pa.
    pressure: f64,
    /// Density, kg/m3.
    density: f64,
    /// Velocity of the air in the plane, m/s.
    velocity: Vec3,
    /// Velocity of the reconstructed state towards the plane, m/s.
    towards: f64,
    /// Half the difference of the farther and the near neighbour along the normal, see [`split_form_correction`], m/s.
    beta: f64,
    missing_slope: f64,
    /// Upwind share by the sensor.
    pub upwind: f64,
}

impl Mirrored {
    /// The cell of `side`, reconstructed with the weight `chi` of the plain difference.
    pub fn new<G: Gas<N>, const N: usize>(
        gas: &G,
        chi: f64,
        on: &Domain<'_>,
        field: Field<'_, N>,
        side: &Side,
    ) -> Self {
        let (face, cell) = (&on.metrics.faces[side.face as usize], side.cell as usize);
        let normal = face.area * (side.sign / face.magnitude());
        let plane = side.sign * face.grid_flux / face.magnitude();
        let (q, g) = (&field.q[cell], &field.gradient[cell]);
        let to_face = on.metrics.border(side.face) - on.metrics.centre(cell);
        let to_image = normal * (2.0 * on.metrics.height(side));
        let predicted = |d: &Vec3| Vec3::from_fn(|e, _| gradient::along(g, 1 + e, d));
        // The image differs by the velocity along the normal, so all else has a plain difference of zero.
        let half = plane - velocity(q).dot(&normal);
        let along = predicted(&to_image);
        let mut u = velocity(q) + predicted(&to_face) - along * (0.5 * chi);
        let towards = u.dot(&normal) + chi * half - plane;
        u += normal * (plane - u.dot(&normal));
        let pressure = q[0] + gradient::along(g, 0, &to_face) - 0.5 * chi * gradient::along(g, 0, &to_image);
        let beta = half - along.dot(&normal);
        let missing_slope = (half + beta) / to_image.norm();
        // The mean gradient of the cell and its image has no part along the normal but that of the normal velocity.
        let (mut step, mut mean) = ([0.0; N], [0.0; N]);
        (step[1], mean[1]) = (2.0 * half, along.dot(&normal));
        let upwind = Blending::sensed(&step, &mean, 0.0, 0.0).upwind;
        Self { pressure, density: gas.density(q), velocity: u, towards, beta, missing_slope, upwind }
    }

    /// What the gradient of the cell lacks of the slope of the normal velocity between the cell and its image, 1/s.
    pub fn missing_slope(&self) -> f64 {
        self.missing_slope
    }

    /// Normal momentum that passes per area, Pa: the pressure of the reconstruction with what convection adds, at the upwind share
    /// `upwind`.
    pub fn pressure(&self, scheme: &FluxParameters, upwind: f64) -> f64 {
        let speed = relative_speed(scheme, self.velocity);
        let diffusion = upwind * VELOCITY_DIFFUSION * self.density * speed * self.towards;
        let (beta, normal) = (Vec3::x() * self.beta, Vec3::x());
        self.pressure
            + diffusion
            + (1.0 - upwind) * self.density * split_form_correction(beta, -beta, normal).x
    }
}

impl<G, V> Spatial<G, V> {
    /// The cell of `side`, a plane of symmetry, continued to it.
    pub fn mirrored<const N: usize>(&self, on: &Domain<'_>, field: Field<'_, N>, side: &Side) -> Mirrored
    where
        G: Gas<N>,
    {
        Mirrored::new(&self.gas, self.chi, on, field, side)
    }
}
