//! Wind that changes with height, around a grid that falls through it.

use std::rc::Rc;

use case::{Flow as Air, WindProfile};
use immersed::flow::Flow;
use nalgebra::Vector3;

/// A profile, and where the falling frame is in it.
#[derive(Clone, Debug)]
pub struct WindByHeight {
    profile: Rc<WindProfile>,
    /// Wind at the frame's origin at the start of the first stage with flow, m/s: velocities of the flow are relative to it and to gusts.
    base: Vector3<f64>,
    /// Height of the frame's origin above ground at the last accepted time, m.
    pub height: f64,
}

impl WindByHeight {
    /// That of a scene, at the start of its first stage with flow. `None` where the wind is the same at all heights.
    pub fn of_scene(air: &Air) -> Option<Self> {
        let shear = air.shear.as_ref()?;
        let (profile, height) = (shear.profile_of(air.wind_m_s), shear.start_height_m);
        Some(Self { base: profile.at(height).into(), profile: Rc::new(profile), height })
    }

    /// Wind at the start at the frame's origin, m/s.
    pub fn base(&self) -> Vector3<f64> {
        self.base
    }

    /// Difference of the wind at `z` (m, in the frame, at the last accepted time) from the base, m/s.
    pub fn excess(&self, z: f64) -> Vector3<f64> {
        Vector3::from(self.profile.at(self.height + z)) - self.base
    }
}

/// The way of the grid through the wind of a window.
#[derive(Clone, Debug)]
pub struct Climb {
    /// The wind, with the height at the start of the window.
    pub wind: WindByHeight,
    /// Position of the grid's origin in the frame then, m, and its vertical velocity relative to the ground, m/s.
    pub origin: f64,
    pub velocity: f64,
}

impl Climb {
    /// Gives `flow` the far field of a step between the times `from` and `to`, s since the start of the window.
    pub fn set_far_field(&self, flow: &mut Flow, [from, to]: [f64; 2]) {
        let at = |time: f64| {
            let origin = self.origin + self.velocity * time;
            move |z: f64| self.wind.excess(origin + z)
        };
        flow.set_far_by_height(at(from), at(to));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid whose origin is 2 m above a frame at 30 m, and that falls at 4 m/s: after half a second its origin is at 30 m.
    #[test]
    fn far_field_is_that_of_the_height_of_the_grid() {
        let profile = WindProfile::Linear { wind: [10.0, 0.0, 0.0], reference: 50.0, slope: 0.02 };
        let wind = WindByHeight { base: [2.0, 0.0, 0.0].into(), profile: Rc::new(profile), height: 30.0 };
        assert!((wind.excess(5.0).x - (10.0 * (1.0 - 0.3) - 2.0)).abs() < 1e-12);
        let axis = || immersed::axis::Axis::even(0.0, 4.0, 4);
        let ends = immersed::grid::Ends::Open([immersed::grid::End::Slip; 2]);
        let grid = immersed::grid::Grid::new([axis(), axis(), axis()], [ends; 3]);
        let momentum = immersed::momentum::Momentum { upwind_share: 0.0, viscosity: 0.0 };
        let settings =
            immersed::flow::Settings { density: 1.2, far: Vector3::zeros(), momentum, tolerance: 1e-3 };
        let mut flow = Flow::new(grid, settings);
        Climb { wind, origin: 2.0, velocity: -4.0 }.set_far_field(&mut flow, [0.25, 0.5]);
        flow.start_undisturbed();
        // Centres of the cells at 0.5 to 3.5 m in the grid: at 30.5 to 33.5 m.
        for (k, height) in [30.5, 31.5, 32.5, 33.5].into_iter().enumerate() {
            let exact = 10.0 * (1.0 + 0.02 * (height - 50.0)) - 2.0;
            assert!((flow.cell_velocity([1, 1, k]).x - exact).abs() < 1e-12, "{height}");
        }
    }
}
