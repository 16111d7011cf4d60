//! The canopy as a vortex lattice (doublet panels): normal velocities induced by unit jumps of the potential over its
//! faces.
//!
//! In compressible air only a part of the canopy interacts within a window. Linear acoustics, discretised in time by
//! second-order backward differences, gives at the end of a window of length $`\Delta t`$
//!
//! ```math
//! \nabla^2 p - \kappa^2 p = \text{history}, \qquad \kappa = \frac{3}{2 c \Delta t},
//! ```
//!
//! so a jump over the surface acts with the kernel $`e^{-\kappa r}/(4 \pi r)`$ instead of $`1/(4 \pi r)`$, and a wave
//! of number $`k`$ has the added mass $`2\rho/\sqrt{k^2 + \kappa^2}`$. With $`\Delta t`$ = 5 ms the range $`1/\kappa`$
//! is 1 m: a canopy of 8 m then has a quarter of its incompressible added mass.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::inverse::ShortMatrix;
use super::panel_groups::PanelGroups;
use super::vortex_rings::VortexRings;
use crate::geometry::{Vec3, centre, direction, distinct, quad_area_vector};

/// A surface in potential flow.
pub struct VortexLattice {
    /// Positions of the nodes, m.
    pub positions: Vec<Vec3>,
    /// Screening parameter $`\kappa`$, 1/m; see [`Air::screening`].
    pub screening: f64,
    /// Area vectors of the faces, m2.
    pub areas: Vec<Vec3>,
    /// Their directions.
    pub normals: Vec<Vec3>,
    /// Groups of faces that share one vortex ring.
    pub(crate) groups: PanelGroups,
    /// Normal velocity at group i per strength of the ring around group j, 1/m: for a jump of the potential $`\Gamma`$,
    /// $`A\Gamma`$ is the velocity of the surface.
    pub influence: DMatrix<f64>,
    /// Its inverse.
    pub(crate) inverse: ShortMatrix,
    /// A gain and the relaxation with it, where one was asked for.
    pub(crate) relaxation: Option<(f64, ShortMatrix)>,
}

/// Properties of the air.
#[derive(Clone, Copy, Debug)]
pub struct Air {
    /// Density, kg/m3.
    pub density: f64,
    /// Speed of sound, m/s; infinite for incompressible air.
    pub sound: f64,
}

impl Air {
    /// Incompressible air.
    pub fn incompressible(density: f64) -> Self {
        Self { density, sound: f64::INFINITY }
    }

    /// The screening parameter $`\kappa`$, 1/m, for windows of length `dt`, s.
    pub fn screening(&self, dt: f64) -> f64 {
        1.5 / (self.sound * dt)
    }
}

impl VortexLattice {
    /// With at most `most` rings, in air with the `screening` $`\kappa`$ (1/m); `None` where the faces cannot be merged
    /// into so few groups, or where the matrix is singular.
    ///
    /// The ring of a group runs along its outline, and its velocity is the area-weighted mean over its faces.
    /// (Collocation at the centroid alone was less accurate for all motions, and much less for irregular groups.)
    pub fn new(positions: &[mesh::Point], faces: &[[u32; 4]], most: usize, screening: f64) -> Option<Self> {
        Self::with_relaxation(positions, faces, most, screening, None)
    }

    /// As [`VortexLattice::new`], with the matrix of [`crate::schemes::AddedMassRelaxation`] for a `gain` (1/m): both inverses are computed at the same time.
    pub fn with_relaxation(
        positions: &[mesh::Point],
        faces: &[[u32; 4]],
        most: usize,
        screening: f64,
        gain: Option<f64>,
    ) -> Option<Self> {
        let positions: Vec<Vec3> = positions.iter().map(|x| Vec3::from(*x)).collect();
        let corners: Vec<[Vec3; 4]> = faces.iter().map(|f| f.map(|node| positions[node as usize])).collect();
        let areas: Vec<Vec3> = corners.iter().map(|c| quad_area_vector(*c)).collect();
        let normals: Vec<Vec3> = areas.iter().map(direction).collect();
        let groups = PanelGroups::new(&positions, faces, &areas, &normals, most)?;
        let n = groups.len();
        let inner = inset_rim(&positions, faces, &corners, &groups);
        let rings = VortexRings::new(&inner, &groups.outlines);
        let sources = Doublet::of(&groups, &corners, &areas);
        // By rows, which are the columns of this matrix.
        let mut transposed = DMatrix::zeros(n, n);
        let mut velocities = DVector::zeros(n);
        for (f, &g) in groups.of.iter().enumerate() {
            let (g, at) = (g as usize, centre(&corners[f]));
            rings.normal_velocities(at, normals[f], velocities.as_mut_slice());
            if screening > 0.0 {
                for (j, (velocity, source)) in velocities.iter_mut().zip(&sources).enumerate() {
                    *velocity += source.screened(screening, at, normals[f], g == j);
                }
            }
            transposed.column_mut(g).axpy(groups.share[f], &velocities, 1.0);
        }
        let influence = transposed.transpose();
        let influence = super::definite::definite(influence, &groups.areas(&areas));
        let (inverse, relaxation) = std::thread::scope(|scope| {
            let inverse = gain.map(|_| scope.spawn(|| ShortMatrix::inverse(&influence)));
            let relaxation = gain.and_then(|gain| Some((gain, ShortMatrix::relaxation(&influence, gain)?)));
            let inverse = match inverse {
                Some(thread) => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
                None => ShortMatrix::inverse(&influence),
            };
            (inverse, relaxation)
        });
        Some(Self { positions, screening, areas, normals, groups, influence, inverse: inverse?, relaxation })
    }
}

/// Inset of the rings' rim corners towards the centres of their faces. A piecewise constant jump vanishes slightly
/// outside the edge where a smooth one does: without the inset the added mass of a square plate is 30, 15, 7 % too
/// large with 5, 10, 20 faces per side; with it, 5, 1, 0 %. Groups need no inset: the mean over their faces has the
/// same effect.
const RIM_INSET: f64 = 0.3;

/// The positions, those on the rim moved inwards by [`RIM_INSET`] where each of their faces is a group of its own.
fn inset_rim(
    positions: &[Vec3],
    faces: &[[u32; 4]],
    corners: &[[Vec3; 4]],
    groups: &PanelGroups,
) -> Vec<Vec3> {
    let mut edges: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for face in faces {
        let nodes = distinct(face);
        for (i, &a) in nodes.iter().enumerate() {
            let b = nodes[(i + 1) % nodes.len()];
            *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let mut rim = vec![false; positions.len()];
    for (edge, _) in edges.iter().filter(|(_, n)| **n == 1) {
        edge.iter().for_each(|&n| rim[n as usize] = true);
    }
    for (face, _) in faces.iter().zip(&groups.share).filter(|(_, share)| **share < 1.0) {
        face.iter().for_each(|&n| rim[n as usize] = false);
    }
    let mut towards = vec![(Vec3::zeros(), 0.0); positions.len()];
    for (face, corners) in faces.iter().zip(corners) {
        let c = centre(corners);
        for &n in distinct(face) {
            let (sum, count) = &mut towards[n as usize];
            *sum += c;
            *count += 1.0;
        }
    }
    positions
        .iter()
        .zip(rim)
        .zip(towards)
        .map(|((x, rim), (sum, count))| if rim { x + (sum / count - x) * RIM_INSET } else { *x })
        .collect()
}

/// The jump of the potential over a group as one doublet.
struct Doublet {
    centre: Vec3,
    /// Area vector, m2.
    area: Vec3,
}

impl Doublet {
    fn of(groups: &PanelGroups, corners: &[[Vec3; 4]], areas: &[Vec3]) -> Vec<Self> {
        let nothing = || Self { centre: Vec3::zeros(), area: Vec3::zeros() };
        let mut all: Vec<Self> = std::iter::repeat_with(nothing).take(groups.len()).collect();
        for (f, &g) in groups.of.iter().enumerate() {
            let (source, at) = (&mut all[g as usize], centre(&corners[f]));
            source.centre += at * groups.share[f];
            source.area += areas[f];
        }
        all
    }

    /// Contribution of compressibility to the normal velocity at `at`: $`n \cdot \nabla\nabla D \cdot a`$ with
    /// $`D = (e^{-\kappa r} - 1)/(4 \pi r)`$. Across the plane of the doublet it is $`\kappa^2/(8\pi r)`$; on its `own`
    /// face, approximated by a square, $`1/r`$ is replaced by its mean.
    fn screened(&self, k: f64, at: Vec3, normal: Vec3, own: bool) -> f64 {
        use std::f64::consts::PI;
        let size = self.area.norm();
        let r = at - self.centre;
        // Mean of 1/r from the middle of a square: 4 ln(1 + sqrt 2) over its side.
        let least = size.sqrt() / (4.0 * (1.0 + 2f64.sqrt()).ln());
        let length = if own { least } else { r.norm().max(least) };
        let decay = (-k * length).exp();
        // D'/r and D''.
        let kr = k * length;
        let (first, second) = if kr < 1e-3 {
            ((0.5 / kr - 1.0 / 3.0) * k.powi(3), -k.powi(3) / 3.0)
        } else {
            let cube = length.powi(3);
            ((1.0 - decay * (1.0 + kr)) / cube, (decay * (kr * kr + 2.0 * kr + 2.0) - 2.0) / cube)
        };
        let across = normal.dot(&self.area) * first;
        let along = normal.dot(&r) * self.area.dot(&r) / (length * length) * (second - first);
        (across + if own { 0.0 } else { along }) / (4.0 * PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schemes::test_support::plate;

    #[test]
    fn compressibility_reduces_the_added_mass_of_long_waves() {
        // A wave of number k on a wide plate: A = sqrt(k^2 + kappa^2) / 2, so 2 rho / sqrt(k^2 + kappa^2) for both sides.
        let n = 40;
        let (mut positions, faces) = plate(n);
        let width = 20.0;
        positions.iter_mut().flatten().for_each(|x| *x *= width);
        for (k, kappa) in [(0.0, 1.0), (1.0, 0.0), (1.0, 0.5), (1.0, 2.0), (2.0, 1.0), (2.0, 4.0)] {
            let lattice = VortexLattice::new(&positions, &faces, usize::MAX, kappa).expect("a plate");
            let wave: Vec<f64> = faces
                .iter()
                .map(|f| {
                    (k * (f.iter().map(|&n| positions[n as usize][0]).sum::<f64>() / 4.0 - 0.5 * width)).cos()
                })
                .collect();
            // At the centre, far from the rim.
            let middle = n / 2 * n + n / 2;
            let found: f64 =
                (0..n * n).map(|j| lattice.influence[(middle, j)] * wave[j]).sum::<f64>() / wave[middle];
            let exact = 0.5 * f64::hypot(k, kappa);
            let error = found / exact - 1.0;
            println!("k {k}, kappa {kappa}: {found:.4} for {exact:.4} ({error:+.3})");
            // Faces of half a metre; 6 % at a wave length of 3 m and a range of a quarter of a metre.
            assert!(error.abs() < 0.015 * (1.0 + k.max(kappa)), "k {k}, kappa {kappa}: {found} for {exact}");
        }
    }

    /// Second differences of `D = (exp(-kappa r) - 1) / (4 pi r)` along normal and area.
    #[test]
    fn screening_is_the_second_derivative_of_its_potential() {
        let potential = |k: f64, r: Vec3| {
            let length = r.norm();
            (-k * length).exp_m1() / (4.0 * std::f64::consts::PI * length)
        };
        let source = Doublet { centre: Vec3::new(0.1, -0.2, 0.3), area: Vec3::new(0.01, 0.03, -0.02) };
        let normal = Vec3::new(0.36, 0.48, 0.8);
        for (k, at) in [
            (0.5, [1.0, 0.4, 0.9]),
            (2.0, [-0.3, 0.8, 0.1]),
            (6.0, [0.5, -0.9, 0.7]),
            (5e-4, [0.9, 0.5, 0.2]),
        ] {
            let at = Vec3::from(at);
            let h = if k < 1e-3 { 1e-2 } else { 1e-3 };
            let r = at - source.centre;
            let (a, size) = (source.area, source.area.norm());
            let step = |s: f64, t: f64| potential(k, r + h * (s * normal + t * a / size));
            let expected = size * (step(1.0, 1.0) - step(1.0, -1.0) - step(-1.0, 1.0) + step(-1.0, -1.0))
                / (4.0 * h * h);
            let found = source.screened(k, at, normal, false);
            // The differences are exact to (h / r)^2.
            assert!((found / expected - 1.0).abs() < 10.0 * h * h, "kappa {k}: {found} {expected}");
        }
    }

    /// On its own face: `kappa^2 / 8 pi` times the mean of `1 / r`, here by the midpoint rule.
    #[test]
    fn own_face_uses_the_mean_of_one_over_r() {
        let (n, side, k) = (400, 0.5, 1e-4);
        let middle = |i: usize| side * ((i as f64 + 0.5) / n as f64 - 0.5);
        let mean = (0..n * n).map(|c| 1.0 / middle(c / n).hypot(middle(c % n))).sum::<f64>() / (n * n) as f64;
        let source = Doublet { centre: Vec3::zeros(), area: Vec3::new(0.0, 0.0, side * side) };
        let found = source.screened(k, Vec3::zeros(), Vec3::z(), true);
        let expected = side * side * k * k * mean / (8.0 * std::f64::consts::PI);
        // The midpoint rule misses about 1 / n at the pole; the series in kappa r has an error of 1e-4.
        assert!((found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
    }
}
