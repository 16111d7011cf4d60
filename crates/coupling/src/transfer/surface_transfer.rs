//! Transfer between a canopy and another surface of the same shape.

use channel::LOAD_WIDTH;
use nalgebra::Matrix3;

use super::nearest_triangle::{NearestTriangle, blend, normal};
use super::surface::{Surface, TransferError, face_area, middle, triangles_of};
use crate::geometry::{Vec3, face_force};

/// Projection of a canopy node on a triangle of the structure's surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    corners: [u32; 3],
    weights: [f64; 3],
    pub(super) height: f64,
}

/// Transfer between a canopy and another surface of the same shape.
#[derive(Clone, Debug)]
pub struct Transfer {
    canopy: Surface,
    own: Surface,
    pub(super) projections: Vec<Projection>,
    /// Canopy faces nearest to the sampling points of each own face.
    samples: Vec<[u32; SAMPLES]>,
}

/// Sampling points of a face.
const SAMPLES: usize = 9;

impl Transfer {
    /// Transfer between the scene's canopy and the structure's own surface.
    ///
    /// # Errors
    /// A surface without area, or far from the canopy.
    pub fn new(canopy: Surface, own: Surface) -> Result<Self, TransferError> {
        let nodes = own.nodes.len();
        for (face, corners) in own.faces.iter().enumerate() {
            if let Some(&node) = corners.iter().find(|&&n| n as usize >= nodes) {
                return Err(TransferError::Node { face, node, nodes });
            }
        }
        let triangles: Vec<[u32; 3]> = own.faces.iter().flat_map(triangles_of).collect();
        let solid = |t: &&[u32; 3]| normal(&t.map(|n| own.node(n))).norm() > 0.0;
        let triangles: Vec<[u32; 3]> = triangles.iter().filter(solid).copied().collect();
        if triangles.is_empty() {
            return Err(TransferError::Empty);
        }
        let sides = triangles.iter().flat_map(|t| (0..3).map(move |i| (t[i], t[(i + 1) % 3])));
        let edge = sides.map(|(a, b)| (own.node(a) - own.node(b)).norm()).fold(0.0f64, f64::max);
        let mut projections = Vec::with_capacity(canopy.nodes.len());
        let corners_of = |s: &Surface, t: [u32; 3]| t.map(|n| s.node(n));
        let near = NearestTriangle::new(triangles.iter().map(|&t| corners_of(&own, t)).collect());
        for (node, c) in canopy.nodes.iter().enumerate() {
            let c = Vec3::from(*c);
            let (triangle, distance) = near.to(c).unwrap_or((0, f64::INFINITY));
            let corners = triangles[triangle];
            if distance > edge {
                return Err(TransferError::Far { node, distance, edge });
            }
            // Extrapolated in the plane of the triangle slightly beyond its edge, so that no tangential part remains.
            let x = corners.map(|n| own.node(n));
            let (unit, d) = (normal(&x), c - x[0]);
            let square = unit.dot(&unit);
            let second = d.cross(&(x[2] - x[0])).dot(&unit) / square;
            let third = (x[1] - x[0]).cross(&d).dot(&unit) / square;
            let (weights, height) = ([1.0 - second - third, second, third], d.dot(&unit) / square.sqrt());
            projections.push(Projection { corners, weights, height });
        }
        let faces = canopy.faces.iter().enumerate();
        let cut = faces.flat_map(|(f, face)| triangles_of(face).map(move |t| (f as u32, t)));
        let (faces, cut): (Vec<u32>, Vec<[Vec3; 3]>) = cut.map(|(f, t)| (f, corners_of(&canopy, t))).unzip();
        let near = NearestTriangle::new(cut);
        let nearest_face = |p: Vec3| near.to(p).map_or(0, |(triangle, _)| faces[triangle]);
        let samples = own.faces.iter().map(|f| points(&f.map(|n| own.node(n))).map(nearest_face)).collect();
        Ok(Self { canopy, own, projections, samples })
    }

    /// Nodes and faces of the structure's surface.
    pub fn own_sizes(&self) -> [usize; 2] {
        [self.own.nodes.len(), self.own.faces.len()]
    }

    /// Displacement of the canopy `[nodes][3]` under that of the structure's surface, m.
    pub fn motion(&self, own: &[f64], canopy: &mut [f64]) {
        let x = self.own.moved(own);
        for ((foot, c), d) in self.projections.iter().zip(&self.canopy.nodes).zip(canopy.chunks_exact_mut(3))
        {
            let corners = foot.corners.map(|n| x[n as usize]);
            let unit = normal(&corners);
            let (at, size) = (blend(foot.weights, &corners), unit.norm().max(f64::MIN_POSITIVE));
            d.copy_from_slice((at + foot.height * unit / size - Vec3::from(*c)).as_slice());
        }
    }

    /// Load on the structure's faces `[faces][LOAD_WIDTH]` (Pa) from that on the canopy's, both at these
    /// displacements: pressures act along area vectors, tractions on areas. Sums of forces and moments agree to
    /// round-off.
    pub fn load(&self, own: &[f64], canopy: &[f64], from: &[f64], to: &mut [f64]) {
        let (x, c) = (self.own.moved(own), self.canopy.moved(canopy));
        let force = |face: &[u32; 4], x: &[Vec3], load: &[f64]| face_force(&face_area(face, x), load);
        let loads = from.chunks_exact(LOAD_WIDTH);
        let forces: Vec<Vec3> = self.canopy.faces.iter().zip(loads).map(|(f, l)| force(f, &c, l)).collect();
        let places: Vec<Vec3> = self.canopy.faces.iter().map(|f| middle(f, &c)).collect();
        let sizes: Vec<f64> = self.own.faces.iter().map(|f| face_area(f, &x).norm()).collect();
        let middles: Vec<Vec3> = self.own.faces.iter().map(|f| middle(f, &x)).collect();
        let mean = |samples: &[u32; SAMPLES]| -> [f64; LOAD_WIDTH] {
            let sum = |k: usize| samples.iter().map(|&f| from[f as usize * LOAD_WIDTH + k]).sum::<f64>();
            std::array::from_fn(|k| sum(k) / SAMPLES as f64)
        };
        let faces = self.own.faces.iter().zip(&self.samples);
        let mut on_faces: Vec<Vec3> = faces.map(|(f, s)| force(f, &x, &mean(s))).collect();
        // Applied twice: the second pass removes the round-off of the first.
        for _ in 0..2 {
            restore(&places, &forces, &sizes, &middles, &mut on_faces);
        }
        for ((face, force), load) in self.own.faces.iter().zip(&on_faces).zip(to.chunks_exact_mut(LOAD_WIDTH))
        {
            let area = face_area(face, &x);
            let size = area.norm();
            if size == 0.0 {
                load.fill(0.0);
                continue;
            }
            let pressure = force.dot(&area) / (size * size);
            load[0] = pressure;
            load[1..].copy_from_slice(((force - pressure * area) / size).as_slice());
        }
    }
}

/// Corrects the forces at `middles` by the smallest $`A_f (a + b \times (c_f - c_0))`$ that gives them the sum and the
/// moment of `forces` at `x`.
fn restore(x: &[Vec3], forces: &[Vec3], sizes: &[f64], middles: &[Vec3], on_faces: &mut [Vec3]) {
    let total: f64 = sizes.iter().sum();
    if total == 0.0 {
        return;
    }
    let centre = sizes.iter().zip(middles).fold(Vec3::repeat(-0.0), |sum, (s, c)| sum + *s * c) / total;
    let (mut sum, mut moment) = (Vec3::zeros(), Vec3::zeros());
    let mut count = |at: &Vec3, force: &Vec3, sign: f64| {
        sum += sign * force;
        moment += sign * (at - centre).cross(force);
    };
    x.iter().zip(forces).for_each(|(x, f)| count(x, f, 1.0));
    middles.iter().zip(&*on_faces).for_each(|(c, f)| count(c, f, -1.0));
    // About the centroid sum and moment decouple: a = sum / area, inertia b = moment.
    let mut inertia = Matrix3::zeros();
    for (size, c) in sizes.iter().zip(middles) {
        let r = c - centre;
        let square = r.dot(&r);
        inertia += *size * Matrix3::from_fn(|i, j| if i == j { square } else { 0.0 } - r[i] * r[j]);
    }
    let turn = solve(&inertia, moment).unwrap_or_default();
    for ((force, size), c) in on_faces.iter_mut().zip(sizes).zip(middles) {
        let more = turn.cross(&(c - centre));
        *force += *size * (sum / total + more);
    }
}

/// Cramer's rule; `None` for a singular matrix (all middles on a line).
fn solve(m: &Matrix3<f64>, r: Vec3) -> Option<Vec3> {
    let [a, b, c] = [0, 1, 2].map(|k| Vec3::from(m.column(k)));
    let whole = a.dot(&b.cross(&c));
    let scale = a.norm() * b.norm() * c.norm();
    (whole.abs() > 1e-14 * scale)
        .then(|| Vec3::new(r.dot(&b.cross(&c)), a.dot(&r.cross(&c)), a.dot(&b.cross(&r))) / whole)
}

/// Sampling points distributed evenly over a face with these corners.
pub(super) fn points([a, b, c, d]: &[Vec3; 4]) -> [Vec3; SAMPLES] {
    // Bilinear; the last side of a triangle has no length, so its points cluster there slightly.
    std::array::from_fn(|k| {
        let [u, v] = [k % 3, k / 3].map(|i| (i as f64 + 0.5) / 3.0);
        let w = [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v];
        w[0] * a + w[1] * b + w[2] * c + w[3] * d
    })
}
