//! The velocity of the far field: the same everywhere, or another one in each plane along z.

use nalgebra::Vector3;

use crate::axis::Axis;

/// Layers of cells around the grid that boundary conditions fill.
const GHOSTS: usize = crate::grid::GHOSTS;

/// Velocity of the undisturbed air in the coordinates of a flow, m/s.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FarField {
    uniform: Vector3<f64>,
    /// That of each component in each plane, with the ghosts; empty where it is the same in all planes.
    layers: [Vec<f64>; 3],
}

impl From<Vector3<f64>> for FarField {
    fn from(uniform: Vector3<f64>) -> Self {
        Self { uniform, layers: Default::default() }
    }
}

impl FarField {
    /// Component `c` in plane `k`, which may be a ghost, m/s.
    #[inline(always)]
    pub fn at(&self, c: usize, k: isize) -> f64 {
        self.layers[c].get((k + GHOSTS as isize) as usize).copied().unwrap_or(self.uniform[c])
    }

    /// Sets the velocity of each plane of `axis` to that at its height, m.
    pub(crate) fn set(&mut self, axis: &Axis, velocity: impl Fn(f64) -> Vector3<f64>) {
        let planes = axis.len() + 2 * GHOSTS;
        for (c, layers) in self.layers.iter_mut().enumerate() {
            layers.clear();
            layers
                .extend((0..planes).map(|i| velocity(height(axis, i as isize - GHOSTS as isize, c == 2))[c]));
        }
    }
}

/// Coordinate of the centre of cell `k` or of its lower face (`face`), m; cells beyond an end are as wide as the last one.
fn height(axis: &Axis, k: isize, face: bool) -> f64 {
    let n = axis.len() as isize;
    let lower = |k: isize| match k {
        k if k < 0 => axis.faces[0] + k as f64 * axis.widths[0],
        k if k > n => axis.faces[n as usize] + (k - n) as f64 * axis.widths[n as usize - 1],
        k => axis.faces[k as usize],
    };
    if face { lower(k) } else { 0.5 * (lower(k) + lower(k + 1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_have_the_velocity_of_their_heights() {
        let axis = Axis::even(1.0, 3.0, 4);
        let mut far = FarField::from(Vector3::new(7.0, 8.0, 9.0));
        assert_eq!([far.at(0, -2), far.at(1, 5), far.at(2, 0)], [7.0, 8.0, 9.0]);
        far.set(&axis, |z| Vector3::new(z, 2.0 * z, -z));
        for k in -2..6 {
            let centre = 1.25 + 0.5 * k as f64;
            assert_eq!([far.at(0, k), far.at(1, k), far.at(2, k)], [centre, 2.0 * centre, 0.25 - centre]);
        }
    }
}
