//! Distance of points to the walls: exact, to the triangles that walls are made of.

use comm::Comm;

use crate::geometry::face;
use crate::geometry::vec3::Vec3;
use crate::topology::Topology;

/// Triangles a leaf holds at most.
const LEAF: usize = 4;

/// A tree of boxes around triangles.
pub struct Walls {
    triangles: Vec<[Vec3; 3]>,
    nodes: Vec<Node>,
}

struct Node {
    low: Vec3,
    high: Vec3,
    /// Leaf: its triangles. Otherwise empty, and the children are the next node and `right`.
    range: std::ops::Range<usize>,
    right: usize,
}

impl Walls {
    /// All walls of the grid at node positions `x` (of this rank), in a periodic domain with their images next to it. Quadrilaterals are
    /// four triangles about the mean of their corners. Collective.
    pub fn gather(comm: &Comm, topology: &Topology, x: &[Vec3]) -> Self {
        let mut corners: Vec<f64> = Vec::new();
        for side in topology.no_slip.iter().filter(|s| s.sign > 0.0) {
            for n in topology.face_nodes[side.face as usize] {
                corners.extend(&x[n as usize]);
            }
        }
        let all = comm.all_gather_var(&corners);
        let mut triangles = Vec::new();
        for c in all.chunks_exact(12) {
            let p: [Vec3; 4] = std::array::from_fn(|k| Vec3::from_column_slice(&c[3 * k..][..3]));
            if p[2] == p[3] {
                triangles.push([p[0], p[1], p[2]]);
            } else {
                let m = face::mean(&p);
                triangles.extend((0..4).map(|k| [p[k], p[(k + 1) % 4], m]));
            }
        }
        for period in &topology.periods {
            let moved = |s: f64| triangles.iter().map(move |t: &[Vec3; 3]| t.map(|x| x + period * s));
            triangles = triangles.iter().copied().chain(moved(1.0)).chain(moved(-1.0)).collect();
        }
        Self::new(triangles)
    }

    /// A tree over `triangles`.
    pub fn new(mut triangles: Vec<[Vec3; 3]>) -> Self {
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            let all = 0..triangles.len();
            grow(&mut triangles, all, &mut nodes);
        }
        Self { triangles, nodes }
    }

    /// Distance of `x` to the nearest wall, m; infinity where there is none. A wall farther than
    /// `bound` may be overlooked.
    pub fn distance(&self, x: Vec3, bound: f64) -> f64 {
        let mut best = if bound.is_finite() { bound * bound } else { f64::INFINITY };
        let mut stack = [0usize; 64];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let at = stack[top];
            let node = &self.nodes[at];
            if node.outside(x) >= best {
                continue;
            }
            for t in &self.triangles[node.range.clone()] {
                best = best.min(squared(x, t));
            }
            if node.range.is_empty() {
                let (a, b) = (at + 1, node.right);
                let near = self.nodes[a].outside(x) < self.nodes[b].outside(x);
                stack[top] = if near { b } else { a };
                stack[top + 1] = if near { a } else { b };
                top += 2;
            }
        }
        best.sqrt()
    }
}

impl Node {
    /// Squared distance of `x` to the box.
    fn outside(&self, x: Vec3) -> f64 {
        (0..3).map(|d| (self.low[d] - x[d]).max(x[d] - self.high[d]).max(0.0).powi(2)).sum()
    }
}

/// Adds the nodes of a range of triangles, halved by the middle one along the longest side; a tree
/// of 2^60 leaves would still fit the stack of a search.
fn grow(all: &mut [[Vec3; 3]], range: std::ops::Range<usize>, nodes: &mut Vec<Node>) -> usize {
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for p in all[range.clone()].as_flattened() {
        for d in 0..3 {
            low[d] = low[d].min(p[d]);
            high[d] = high[d].max(p[d]);
        }
    }
    let at = nodes.len();
    let leaf = range.len() <= LEAF;
    nodes.push(Node { low, high, range: if leaf { range.clone() } else { 0..0 }, right: 0 });
    if !leaf {
        let side = (0..3).max_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b]))).unwrap_or(0);
        let half = range.len() / 2;
        let key = |t: &[Vec3; 3]| t[0][side] + t[1][side] + t[2][side];
        all[range.clone()].select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)));
        let middle = range.start + half;
        grow(all, range.start..middle, nodes);
        nodes[at].right = grow(all, middle..range.end, nodes);
    }
    at
}

/// Squared distance of a point to a triangle (Ericson, Real-Time Collision Detection, 5.1.5: by the
/// region of the plane that the point lies over).
fn squared(x: Vec3, &[a, b, c]: &[Vec3; 3]) -> f64 {
    let (ab, ac) = (b - a, c - a);
    let n = ab.cross(&ac);
    let area2 = n.norm_squared();
    let to = |p: Vec3, q: Vec3| {
        // To the segment from p to q.
        let (e, d) = (q - p, x - p);
        let length = e.norm_squared();
        let s = if length > 0.0 { (d.dot(&e) / length).clamp(0.0, 1.0) } else { 0.0 };
        (d - e * s).norm_squared()
    };
    if area2 > 0.0 {
        let d = x - a;
        let v = d.cross(&ac).dot(&n);
        let w = ab.cross(&d).dot(&n);
        if v >= 0.0 && w >= 0.0 && v + w <= area2 {
            let height = d.dot(&n);
            return height * height / area2;
        }
    }
    to(a, b).min(to(b, c)).min(to(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_point_of_a_triangle_in_every_region() {
        let t = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]].map(Vec3::from);
        for (x, d2) in [
            ([0.5, 0.5, 3.0], 9.0),
            ([-1.0, -2.0, 2.0], 9.0),
            ([1.0, -4.0, 0.0], 16.0),
            ([2.0, 2.0, 1.0], 3.0),
            ([5.0, 0.0, 0.0], 9.0),
        ] {
            assert!((squared(x.into(), &t) - d2).abs() < 1e-14, "{x:?}");
        }
    }

    #[test]
    fn tree_search_matches_brute_force() {
        let mut seed = 3u64;
        let mut next = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut point = || Vec3::new(10.0 * next(), next(), 3.0 * next());
        let triangles: Vec<[Vec3; 3]> = (0..500)
            .map(|_| {
                let (a, b, c) = (point(), point(), point());
                [a, a + b * 0.05, a + c * 0.05]
            })
            .collect();
        let walls = Walls::new(triangles.clone());
        for _ in 0..200 {
            let x = point();
            let all = triangles.iter().map(|t| squared(x, t)).fold(f64::INFINITY, f64::min);
            assert_eq!(walls.distance(x, f64::INFINITY), all.sqrt());
        }
        assert_eq!(Walls::new(Vec::new()).distance(Vec3::zeros(), f64::INFINITY), f64::INFINITY);
    }
}
