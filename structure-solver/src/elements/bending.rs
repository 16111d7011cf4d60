//! Bending of flat cloth without rotations: curvature of a triangle from its three neighbours.
//!
//! Over side $`i`$ of a triangle, of length $`l_i`$ and outward normal $`n_i`$ in its plane, the slope of the
//! surface jumps by the vector $`v_i`$, the sum of the normal derivatives of the position in both triangles
//! (its size is $`2 \sin(\theta_i/2)`$ for the angle $`\theta_i`$ between them, where they keep their shape). The curvature is
//! the mean of the second derivatives that these jumps make (Oñate and Zárate 2000, element BST; Grinspun et al. 2006),
//!
//! ```math
//! K_{\alpha\beta} = \frac{1}{2 A} \sum_{i} l_i\, n_{i\alpha} n_{i\beta}\, v_i, \qquad
//! W = \tfrac12 D A\, K_{\alpha\beta} \cdot K_{\alpha\beta}
//! ```
//!
//! All lengths are those of the unstressed triangles, each in its own plane: the cloth is flat as cut, and an angle of the
//! reference shape is bent. $`K`$ is linear in the positions, so the energy is quadratic (as the isometric bending of Bergou et
//! al. 2006): forces of positions averaged over a step do the work of the energy's change exactly, the stiffness is
//! constant, and triangles that collapse in slack fabric cause no singular force. A turn of the whole turns each $`K_{\alpha\beta}`$.
//! On a seam the side has the length that it has in each triangle: the slopes are those of their own flat shapes.
//! Sides without a neighbour, or with more than one, have no jump: they are hinges without a moment.
//!
//! Poisson's ratio of the bending is zero: $`D`$ is the moment for each width over the curvature.

use super::{Kernel, Load, Step};
use mesh::geometry::{Mat3, Vec3};

/// Curvature of a triangle by the positions of the nodes of its patch.
///
/// Nodes: the corners, then for each corner the node across the side opposite to it.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Coefficients of K11, K22 and K12, 1/m2.
    curvature: [[f64; 6]; 3],
    /// Area of the triangle, m2.
    area: f64,
}

/// Derivative across the side from `p` to `q`, away from it, of the linear function on a triangle with the third corner `c`:
/// coefficients of the values at `p`, `q`, `c` (1/m), and the direction. `None` without an area.
fn slope([p, q, c]: [Vec3; 3]) -> Option<([f64; 3], Vec3)> {
    let (side, arm) = (q - p, c - p);
    let share = arm.dot(&side) / side.dot(&side);
    let height = arm - side * share;
    let size = height.norm();
    let proper = size > 1e-10 * side.norm().max(arm.norm());
    proper.then(|| ([(share - 1.0) / size, -share / size, 1.0 / size], height * (1.0 / size)))
}

impl Reference {
    /// Of the unstressed patch `x` (m). `inner`: whether a node lies across each side; the place of others does not count.
    /// `None` where a triangle has no area.
    pub fn new(x: [Vec3; 6], inner: [bool; 3]) -> Option<Self> {
        let across = |i: usize| inner[i].then(|| [x[(i + 1) % 3], x[(i + 2) % 3], x[3 + i]]);
        Self::sewn([x[0], x[1], x[2]], [0, 1, 2].map(across))
    }

    /// Of an unstressed triangle `x` (m) and the unstressed triangles across its sides, each in axes of its own: of side i, opposite to corner i, the nodes
    /// i + 1 and i + 2, and the third corner. `None` where a triangle has no area.
    pub fn sewn(x: [Vec3; 3], across: [Option<[Vec3; 3]>; 3]) -> Option<Self> {
        let area = 0.5 * (x[1] - x[0]).cross(&(x[2] - x[0])).norm();
        let first = (x[1] - x[0]) * (1.0 / (x[1] - x[0]).norm());
        let (_, second) = slope([x[0], x[1], x[2]])?;
        let mut curvature = [[0.0; 6]; 3];
        for own in 0..3 {
            let Some(other) = across[own] else { continue };
            let nodes = [(own + 1) % 3, (own + 2) % 3];
            let [p, q] = nodes.map(|n| x[n]);
            let (inside, height) = slope([p, q, x[own]])?;
            let (outside, _) = slope(other)?;
            let n = [height.dot(&first), height.dot(&second)];
            let share = 0.5 * (q - p).norm() / area;
            for (row, by) in curvature.iter_mut().zip([n[0] * n[0], n[1] * n[1], n[0] * n[1]]) {
                for (k, node) in nodes.into_iter().enumerate() {
                    row[node] += share * by * (inside[k] + outside[k]);
                }
                row[own] += share * by * inside[2];
                row[3 + own] += share * by * outside[2];
            }
        }
        Some(Self { curvature, area })
    }
}

/// Bending of triangles.
pub struct Bending {
    /// Moment for each width over curvature, N m.
    stiffness: f64,
}

/// A patch: coefficients of vectors whose squares are twice the energy, N^(1/2) m^(-1/2).
pub struct Patch([[f64; 6]; 3]);

impl Patch {
    /// The vectors of the patch now at `x` (m).
    #[inline(always)]
    fn vectors(&self, x: &[Vec3; 6]) -> [Vec3; 3] {
        // From one corner, so that no place of the patch is lost to rounding.
        let arms = x.map(|x1| x1 - x[0]);
        self.0.map(|row| row.iter().zip(&arms).fold(Vec3::zeros(), |sum, (c, arm)| sum + *arm * *c))
    }
}

impl Bending {
    /// Of a bending stiffness (moment for each width over curvature), N m.
    pub fn new(stiffness: f64) -> Self {
        Self { stiffness }
    }

    /// The element of a patch.
    pub fn element(&self, reference: &Reference) -> Patch {
        // K12 and K21.
        let of = |weight: f64| (weight * self.stiffness * reference.area).sqrt();
        let scale = [of(1.0), of(1.0), of(2.0)];
        Patch(std::array::from_fn(|a| reference.curvature[a].map(|c| scale[a] * c)))
    }
}

impl Kernel<6> for Bending {
    type Element = Patch;
    type Batch = ();

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Patch,
        step: &Step<6>,
        _load: &Load,
    ) -> [Vec3; 6] {
        let m = e.vectors(&step.at);
        std::array::from_fn(|n| m[0] * e.0[0][n] + m[1] * e.0[1][n] + m[2] * e.0[2][n])
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Patch,
        step: &Step<6>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; 6], [[Mat3; 6]; 6]) {
        let block = |n: usize, m: usize| {
            let k: f64 = e.0.iter().map(|row| row[n] * row[m]).sum();
            Mat3::from_diagonal_element(factor * k)
        };
        let k = std::array::from_fn(|n| std::array::from_fn(|m| block(n, m)));
        (self.force::<TRACTION, BLEND>(e, step, load), k)
    }

    fn energy(&self, e: &Patch, x: &[Vec3; 6]) -> f64 {
        0.5 * e.vectors(x).iter().map(|m| m.dot(m)).sum::<f64>()
    }

    /// None, but with blocks in the matrix.
    fn mass(&self, _e: &Patch) -> Option<f64> {
        Some(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::conforms;

    /// An irregular patch of flat cloth.
    const FLAT: [Vec3; 6] = [
        Vec3::new(0.1, -0.2, 0.0),
        Vec3::new(1.2, 0.1, 0.0),
        Vec3::new(0.3, 0.9, 0.0),
        Vec3::new(1.1, 1.2, 0.0),
        Vec3::new(-0.7, 0.5, 0.0),
        Vec3::new(0.6, -1.0, 0.0),
    ];

    fn patch(x: [Vec3; 6], inner: [bool; 3]) -> Patch {
        Bending::new(0.7).element(&Reference::new(x, inner).expect("proper triangles"))
    }

    #[test]
    fn the_patch_conforms() {
        let bent = FLAT.map(|x| Vec3::new(x[0] + 0.1 * x[1], x[1], 0.4 * x[0] * x[0] - 0.3 * x[0] * x[1]));
        for inner in [[true; 3], [true, false, true], [false, true, false]] {
            conforms(&Bending::new(0.7), || patch(FLAT, inner), FLAT, bent);
        }
    }

    /// A fold by the angle a along one side: the jump is 2 sin(a/2), the energy D l^2 4 sin^2(a/2) / (8 A).
    #[test]
    fn a_fold_has_its_closed_form() {
        let e = patch(FLAT, [true, false, false]);
        let [p, q, c] = [FLAT[1], FLAT[2], FLAT[3]];
        let axis = (q - p) * (1.0 / (q - p).norm());
        let area = 0.5 * (FLAT[1] - FLAT[0]).cross(&(FLAT[2] - FLAT[0])).norm();
        for angle in [0.1f64, 1.0, 2.5] {
            let arm = c - p;
            let along = axis * arm.dot(&axis);
            let across = arm - along;
            let mut x = FLAT;
            x[3] = p + along + across * angle.cos() + axis.cross(&across) * angle.sin();
            let jump = 2.0 * (0.5 * angle).sin();
            let expected = 0.7 * (q - p).dot(&(q - p)) * jump * jump / (8.0 * area);
            let energy = Bending::new(0.7).energy(&e, &x);
            assert!((energy / expected - 1.0).abs() < 1e-13, "{angle}: {energy} {expected}");
        }
    }

    /// The patch of equilateral triangles has the energy of any constant curvature: D (K11^2 + K22^2 + 2 K12^2) / 2.
    #[test]
    fn equilateral_triangles_have_constant_curvature() {
        let h = 0.75f64.sqrt();
        let at = |x: f64, y: f64| Vec3::new(x, y, 0.0);
        let x = [at(0.0, 0.0), at(1.0, 0.0), at(0.5, h), at(1.5, h), at(-0.5, h), at(0.5, -h)];
        let e = patch(x, [true; 3]);
        for [k11, k22, k12] in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, -0.8, 0.4]] {
            let z = |x: &Vec3| 0.5 * (k11 * x[0] * x[0] + k22 * x[1] * x[1]) + k12 * x[0] * x[1];
            let bent = x.map(|x| Vec3::new(x[0], x[1], z(&x)));
            let expected = 0.5 * 0.7 * (0.5 * h) * (k11 * k11 + k22 * k22 + 2.0 * k12 * k12);
            let energy = Bending::new(0.7).energy(&e, &bent);
            assert!((energy / expected - 1.0).abs() < 1e-13, "{energy} {expected}");
        }
    }

    #[test]
    fn a_triangle_without_area_is_refused() {
        let mut x = FLAT;
        x[3] = x[1] * 0.5 + x[2] * 0.5;
        assert!(Reference::new(x, [true; 3]).is_none());
        assert!(Reference::new(x, [false, true, true]).is_some());
    }
}
