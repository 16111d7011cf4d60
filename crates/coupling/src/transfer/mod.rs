//! Motion and loads between the canopy of the scene and the surface of a structure that has its own.
//!
//! A point $c$ of the canopy lies over the nearest triangle of the structure's surface, at the
//! barycentric coordinates $w_i$ and the height $h$ along its unit normal $n$, both measured on the unstressed
//! shapes. It moves with it,
//!
//! $$ c = \sum_i w_i x_i + h\,n(x), $$
//!
//! which is linear interpolation on the surface and exact for rigid motion, on it or off it. Loads go the other way
//! by place: a face of the structure takes the mean of what the canopy bears beside it, and the least change linear in
//! space gives it the sums of forces and moments of the canopy. (The transpose of the motion would keep the work as well,
//! but spreads nodal forces as unevenly as nodes fall: 6 % of the pressure between surfaces of 3 to 2 cells.)

mod near;
mod own_surface;

use channel::LOAD_WIDTH;
use mesh::Vec3;
use serde::{Deserialize, Serialize};

pub use own_surface::{OwnSurface, surface_file};

use near::Near;

/// A surface: unstressed positions of its nodes, m, and its faces, a triangle repeating its last node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// Unstressed positions, m.
    pub nodes: Vec<Vec3>,
    /// Nodes of the faces.
    pub faces: Vec<[u32; 4]>,
    /// Displacement of the nodes when the stage begins, `[nodes][3]`, m; empty: none.
    #[serde(default)]
    pub displacement: Vec<f64>,
}

/// Why two surfaces do not fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// No face with an area.
    #[error("the surface of the structure has no face with an area")]
    Empty,
    /// A face names a node that is not there.
    #[error("face {face} of the structure's surface names node {node} of {nodes}")]
    Node {
        /// Face.
        face: usize,
        /// Node that it names.
        node: u32,
        /// Nodes that there are.
        nodes: usize,
    },
    /// A canopy node that no face is near.
    #[error(
        "canopy node {node} is {distance:.3} m from the structure's surface, whose longest edge is {edge:.3} m: \
         it is another canopy"
    )]
    Far {
        /// Canopy node.
        node: usize,
        /// Distance, m.
        distance: f64,
        /// Longest edge, m.
        edge: f64,
    },
}

/// Where a canopy node hangs.
#[derive(Clone, Copy, Debug)]
struct Foot {
    corners: [u32; 3],
    weights: Vec3,
    height: f64,
}

/// The way between a canopy and another surface of the same shape.
#[derive(Clone, Debug)]
pub struct Transfer {
    canopy: Surface,
    own: Surface,
    feet: Vec<Foot>,
    /// Canopy faces beside the sampling points of each own face.
    samples: Vec<[u32; SAMPLES]>,
}

/// Sampling points of a face.
const SAMPLES: usize = 9;

impl Transfer {
    /// Between the scene's canopy and the structure's own surface.
    ///
    /// # Errors
    /// A surface that is none, or lies elsewhere.
    pub fn new(canopy: Surface, own: Surface) -> Result<Self, TransferError> {
        let nodes = own.nodes.len();
        for (face, corners) in own.faces.iter().enumerate() {
            if let Some(&node) = corners.iter().find(|&&n| n as usize >= nodes) {
                return Err(TransferError::Node { face, node, nodes });
            }
        }
        let triangles: Vec<[u32; 3]> = own.faces.iter().flat_map(triangles_of).collect();
        let solid = |t: &&[u32; 3]| norm(normal(t.map(|n| own.nodes[n as usize]))) > 0.0;
        let triangles: Vec<[u32; 3]> = triangles.iter().filter(solid).copied().collect();
        if triangles.is_empty() {
            return Err(TransferError::Empty);
        }
        let sides = triangles.iter().flat_map(|t| (0..3).map(move |i| (t[i], t[(i + 1) % 3])));
        let edge = sides
            .map(|(a, b)| norm(sub(own.nodes[a as usize], own.nodes[b as usize])))
            .fold(0.0f64, f64::max);
        let mut feet = Vec::with_capacity(canopy.nodes.len());
        let corners_of = |s: &Surface, t: [u32; 3]| t.map(|n| s.nodes[n as usize]);
        let near = Near::new(triangles.iter().map(|&t| corners_of(&own, t)).collect());
        for (node, &c) in canopy.nodes.iter().enumerate() {
            let (triangle, distance) = near.to(c).unwrap_or((0, f64::INFINITY));
            let corners = triangles[triangle];
            if distance > edge {
                return Err(TransferError::Far { node, distance, edge });
            }
            // In the plane of the triangle, also where that is a little beyond its edge: nothing is left then.
            let x = corners.map(|n| own.nodes[n as usize]);
            let (unit, d) = (normal(x), sub(c, x[0]));
            let square = dot(unit, unit);
            let second = dot(cross(d, sub(x[2], x[0])), unit) / square;
            let third = dot(cross(sub(x[1], x[0]), d), unit) / square;
            let (weights, height) = ([1.0 - second - third, second, third], dot(d, unit) / square.sqrt());
            feet.push(Foot { corners, weights, height });
        }
        let faces = canopy.faces.iter().enumerate();
        let cut = faces.flat_map(|(f, face)| triangles_of(face).map(move |t| (f as u32, t)));
        let (faces, cut): (Vec<u32>, Vec<[Vec3; 3]>) = cut.map(|(f, t)| (f, corners_of(&canopy, t))).unzip();
        let near = Near::new(cut);
        let beside = |p: Vec3| near.to(p).map_or(0, |(triangle, _)| faces[triangle]);
        let samples = own.faces.iter().map(|f| points(f, &own.nodes).map(beside)).collect();
        Ok(Self { canopy, own, feet, samples })
    }

    /// Nodes and faces of the structure's surface.
    pub fn own_sizes(&self) -> [usize; 2] {
        [self.own.nodes.len(), self.own.faces.len()]
    }

    /// Displacement of the canopy `[nodes][3]` under that of the structure's surface, m.
    pub fn motion(&self, own: &[f64], canopy: &mut [f64]) {
        let x = moved(&self.own, own);
        for ((foot, c), d) in self.feet.iter().zip(&self.canopy.nodes).zip(canopy.chunks_exact_mut(3)) {
            let corners = foot.corners.map(|n| x[n as usize]);
            let unit = normal(corners);
            let (at, size) = (blend(foot.weights, corners), norm(unit).max(f64::MIN_POSITIVE));
            (0..3).for_each(|i| d[i] = at[i] + foot.height * unit[i] / size - c[i]);
        }
    }

    /// Load on the structure's faces `[faces][LOAD_WIDTH]` (Pa) in the place of that on the canopy's, both at these
    /// displacements: pressures push along area vectors, tractions act on areas. Sums of forces and moments
    /// are the same to round-off.
    pub fn load(&self, own: &[f64], canopy: &[f64], from: &[f64], to: &mut [f64]) {
        let (x, c) = (moved(&self.own, own), moved(&self.canopy, canopy));
        let force = |face: &[u32; 4], x: &[Vec3], load: &[f64]| -> Vec3 {
            let area = area_vector(face, x);
            let size = norm(area);
            std::array::from_fn(|i| load[0] * area[i] + load[1 + i] * size)
        };
        let loads = from.chunks_exact(LOAD_WIDTH);
        let forces: Vec<Vec3> = self.canopy.faces.iter().zip(loads).map(|(f, l)| force(f, &c, l)).collect();
        let places: Vec<Vec3> = self.canopy.faces.iter().map(|f| middle(f, &c)).collect();
        let sizes: Vec<f64> = self.own.faces.iter().map(|f| norm(area_vector(f, &x))).collect();
        let middles: Vec<Vec3> = self.own.faces.iter().map(|f| middle(f, &x)).collect();
        let mean = |samples: &[u32; SAMPLES]| -> [f64; LOAD_WIDTH] {
            let sum = |k: usize| samples.iter().map(|&f| from[f as usize * LOAD_WIDTH + k]).sum::<f64>();
            std::array::from_fn(|k| sum(k) / SAMPLES as f64)
        };
        let faces = self.own.faces.iter().zip(&self.samples);
        let mut on_faces: Vec<Vec3> = faces.map(|(f, s)| force(f, &x, &mean(s))).collect();
        // Twice: the second time takes away the round-off of the first.
        for _ in 0..2 {
            restore(&places, &forces, &sizes, &middles, &mut on_faces);
        }
        for ((face, force), load) in self.own.faces.iter().zip(&on_faces).zip(to.chunks_exact_mut(LOAD_WIDTH))
        {
            let area = area_vector(face, &x);
            let size = norm(area);
            if size == 0.0 {
                load.fill(0.0);
                continue;
            }
            let pressure = dot(*force, area) / (size * size);
            load[0] = pressure;
            (0..3).for_each(|i| load[1 + i] = (force[i] - pressure * area[i]) / size);
        }
    }
}

/// Changes forces at `middles` by the least $A_f (a + b \times (c_f - c_0))$ that gives them the sum and the moment of
/// `forces` at `x`.
fn restore(x: &[Vec3], forces: &[Vec3], sizes: &[f64], middles: &[Vec3], on_faces: &mut [Vec3]) {
    let total: f64 = sizes.iter().sum();
    if total == 0.0 {
        return;
    }
    let centre: Vec3 =
        std::array::from_fn(|i| sizes.iter().zip(middles).map(|(s, c)| s * c[i]).sum::<f64>() / total);
    let (mut sum, mut moment) = ([0.0; 3], [0.0; 3]);
    let mut tally = |at: &Vec3, force: &Vec3, sign: f64| {
        let turn = cross(sub(*at, centre), *force);
        for i in 0..3 {
            sum[i] += sign * force[i];
            moment[i] += sign * turn[i];
        }
    };
    x.iter().zip(forces).for_each(|(x, f)| tally(x, f, 1.0));
    middles.iter().zip(&*on_faces).for_each(|(c, f)| tally(c, f, -1.0));
    // About their centre sums and moments part: a = sum / area, inertia b = moment.
    let mut inertia = [[0.0; 3]; 3];
    for (size, c) in sizes.iter().zip(middles) {
        let r = sub(*c, centre);
        let square = dot(r, r);
        for i in 0..3 {
            for j in 0..3 {
                inertia[i][j] += size * (if i == j { square } else { 0.0 } - r[i] * r[j]);
            }
        }
    }
    let turn = solve(inertia, moment).unwrap_or([0.0; 3]);
    for ((force, size), c) in on_faces.iter_mut().zip(sizes).zip(middles) {
        let more = cross(turn, sub(*c, centre));
        (0..3).for_each(|i| force[i] += size * (sum[i] / total + more[i]));
    }
}

/// Cramer's rule; `None` for a singular matrix (all middles on a line).
fn solve(m: [Vec3; 3], r: Vec3) -> Option<Vec3> {
    let column = |k: usize| [m[0][k], m[1][k], m[2][k]];
    let (a, b, c) = (column(0), column(1), column(2));
    let whole = dot(a, cross(b, c));
    let scale = norm(a) * norm(b) * norm(c);
    (whole.abs() > 1e-14 * scale)
        .then(|| [dot(r, cross(b, c)) / whole, dot(a, cross(r, c)) / whole, dot(a, cross(b, r)) / whole])
}

/// Points spread evenly over a face.
fn points(face: &[u32; 4], x: &[Vec3]) -> [Vec3; SAMPLES] {
    let [a, b, c, d] = face.map(|n| x[n as usize]);
    // Bilinear; a triangle's last side has no length, and its points crowd there a little.
    std::array::from_fn(|k| {
        let [u, v] = [k % 3, k / 3].map(|i| (i as f64 + 0.5) / 3.0);
        let w = [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v];
        std::array::from_fn(|i| w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i])
    })
}

/// Distance of `p` from a triangle (Ericson 2005, section 5.1.5).
fn nearest(p: Vec3, [a, b, c]: [Vec3; 3]) -> f64 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    let (bp, cp) = (sub(p, b), sub(p, c));
    let (d3, d4, d5, d6) = (dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let weights = if d1 <= 0.0 && d2 <= 0.0 {
        [1.0, 0.0, 0.0]
    } else if d3 >= 0.0 && d4 <= d3 {
        [0.0, 1.0, 0.0]
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        [1.0 - t, t, 0.0]
    } else if d6 >= 0.0 && d5 <= d6 {
        [0.0, 0.0, 1.0]
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        [1.0 - t, 0.0, t]
    } else if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        [0.0, 1.0 - t, t]
    } else {
        let all = va + vb + vc;
        [va / all, vb / all, vc / all]
    };
    norm(sub(p, blend(weights, [a, b, c])))
}

fn triangles_of(face: &[u32; 4]) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [a, b, c, d] = *face;
    [Some([a, b, c]), (c != d).then_some([a, c, d])].into_iter().flatten()
}

fn distinct(face: &[u32; 4]) -> &[u32] {
    if face[2] == face[3] { &face[..3] } else { face }
}

fn moved(surface: &Surface, displacement: &[f64]) -> Vec<Vec3> {
    let rows = surface.nodes.iter().zip(displacement.chunks_exact(3));
    rows.map(|(x, d)| std::array::from_fn(|i| x[i] + d[i])).collect()
}

/// Half the cross product of the diagonals, m2.
fn area_vector(face: &[u32; 4], x: &[Vec3]) -> Vec3 {
    let [a, b, c, d] = face.map(|n| x[n as usize]);
    cross(sub(c, a), sub(d, b)).map(|n| 0.5 * n)
}

fn middle(face: &[u32; 4], x: &[Vec3]) -> Vec3 {
    let corners = distinct(face);
    let sum = |i: usize| corners.iter().map(|&n| x[n as usize][i]).sum::<f64>();
    std::array::from_fn(|i| sum(i) / corners.len() as f64)
}

fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    cross(sub(b, a), sub(c, a))
}

fn blend(w: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    std::array::from_fn(|i| w[0] * a[i] + w[1] * b[i] + w[2] * c[i])
}

fn sub(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests;
