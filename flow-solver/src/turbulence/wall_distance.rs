//! Distance of points to the walls: exact, to the triangles that walls are made of.

use comm::Comm;
use mesh::lanes::{LANES, Lanes, Real, lanes};
use nalgebra::{SimdPartialOrd, Vector3};

use crate::geometry::face;
use crate::geometry::vec3::Vec3;
use crate::topology::Topology;

/// Boxes and triangles that wait in a search; a tree of 4^20 leaves would still fit.
const WAITING: usize = 64;

/// A tree of boxes around triangles, four boxes or triangles at a time.
pub struct Walls {
    triangles: Vec<[Vec3; 3]>,
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    root: Option<Child>,
}

/// Four triangles, the last one repeated where there are fewer.
struct Leaf {
    corners: [Vector3<Lanes>; 3],
    /// Their places in the list that the tree was made of.
    places: [u32; LANES],
}

/// Boxes of four children.
struct Node {
    low: Vector3<Lanes>,
    high: Vector3<Lanes>,
    children: [Child; LANES],
}

#[derive(Clone, Copy)]
enum Child {
    Node(u32),
    Leaf(u32),
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
    pub fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let mut places: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut walls = Self { triangles, nodes: Vec::new(), leaves: Vec::new(), root: None };
        walls.root = (!places.is_empty()).then(|| walls.grow(&mut places));
        walls
    }

    /// Adds the triangles at `places`, halved twice by the middle one along the longest side.
    fn grow(&mut self, places: &mut [u32]) -> Child {
        if places.len() <= LANES {
            let places = std::array::from_fn(|l| places[l.min(places.len() - 1)]);
            let of = |k: usize, d: usize| lanes(|l| self.triangles[places[l] as usize][k][d]);
            let corners = [0, 1, 2].map(|k| Vector3::new(of(k, 0), of(k, 1), of(k, 2)));
            self.leaves.push(Leaf { corners, places });
            return Child::Leaf(self.leaves.len() as u32 - 1);
        }
        let (left, right) = self.halves(places);
        let [(a, b), (c, d)] = [self.halves(left), self.halves(right)];
        // Each of at least one: there are five triangles or more.
        let parts = [a, b, c, d];
        let boxes = parts.each_ref().map(|part| self.bounds(part));
        let of = |end: usize, d: usize| lanes(|l| boxes[l][end][d]);
        let [low, high] = [0, 1].map(|end| Vector3::new(of(end, 0), of(end, 1), of(end, 2)));
        let at = self.nodes.len();
        self.nodes.push(Node { low, high, children: [Child::Leaf(0); LANES] });
        self.nodes[at].children = parts.map(|part| self.grow(part));
        Child::Node(at as u32)
    }

    /// Low and high corner of the box around the triangles at `places`.
    fn bounds(&self, places: &[u32]) -> [Vec3; 2] {
        let none = [Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)];
        let points = places.iter().flat_map(|&t| &self.triangles[t as usize]);
        points.fold(none, |[low, high], p| [low.inf(p), high.sup(p)])
    }

    /// Both halves of `places`, parted by the middle triangle along the longest side.
    fn halves<'p>(&self, places: &'p mut [u32]) -> (&'p mut [u32], &'p mut [u32]) {
        let half = places.len() / 2;
        let [low, high] = self.bounds(places);
        let side = (high - low).imax();
        let key = |t: &u32| self.triangles[*t as usize].iter().map(|p| p[side]).sum::<f64>();
        places.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)));
        places.split_at_mut(half)
    }

    /// Distance of `x` to the nearest wall, m, and the place of its triangle; infinity where there is none. The search is
    /// shorter where the triangle at `guess` is near.
    pub fn nearest(&self, x: Vec3, guess: u32) -> (f64, u32) {
        let first = self.triangles.get(guess as usize);
        let mut best = first.map_or(f64::INFINITY, |t| squared(x, t));
        let mut place = guess;
        let Some(root) = self.root else { return (f64::INFINITY, guess) };
        let x = x.map(|x| lanes(|_| x));
        let mut waiting = [(0.0, root); WAITING];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (outside, child) = waiting[count];
            if outside >= best {
                continue;
            }
            match child {
                Child::Leaf(leaf) => {
                    let leaf = &self.leaves[leaf as usize];
                    for (found, at) in squared(x, &leaf.corners).into_arr().into_iter().zip(leaf.places) {
                        if found < best {
                            (best, place) = (found, at);
                        }
                    }
                }
                Child::Node(node) => {
                    let node = &self.nodes[node as usize];
                    let start = count;
                    for (outside, child) in node.outside(x).into_arr().into_iter().zip(node.children) {
                        if outside < best {
                            // The nearest last, to be taken first.
                            let mut k = count;
                            while k > start && waiting[k - 1].0 < outside {
                                waiting[k] = waiting[k - 1];
                                k -= 1;
                            }
                            waiting[k] = (outside, child);
                            count += 1;
                        }
                    }
                }
            }
        }
        (best.sqrt(), place)
    }
}

impl Node {
    /// Squared distances of a point to the boxes.
    #[inline(always)]
    fn outside(&self, x: Vector3<Lanes>) -> Lanes {
        let side = |d: usize| (self.low[d] - x[d]).simd_max(x[d] - self.high[d]).simd_max(Lanes::ZERO);
        let [a, b, c] = [side(0), side(1), side(2)];
        a * a + b * b + c * c
    }
}

/// Squared distance of a point to a triangle (Ericson, Real-Time Collision Detection, 5.1.5: by the
/// region of the plane that the point lies over).
#[inline(always)]
fn squared<T: Real>(x: Vector3<T>, &[a, b, c]: &[Vector3<T>; 3]) -> T {
    let [zero, one] = [0.0, 1.0].map(T::splat);
    let (ab, ac) = (b - a, c - a);
    let n = ab.cross(&ac);
    let area2 = n.dot(&n);
    let to = |p: Vector3<T>, q: Vector3<T>| {
        // To the segment from p to q.
        let (e, d) = (q - p, x - p);
        let length = e.dot(&e);
        let s = (d.dot(&e) / length).simd_clamp(zero, one).select(length.simd_gt(zero), zero);
        let rest = d - e * s;
        rest.dot(&rest)
    };
    let d = x - a;
    let v = d.cross(&ac).dot(&n);
    let w = ab.cross(&d).dot(&n);
    let height = d.dot(&n);
    let edges = to(a, b).simd_min(to(b, c)).simd_min(to(c, a));
    let over = area2.simd_gt(zero) & v.simd_ge(zero) & w.simd_ge(zero) & (v + w).simd_le(area2);
    (height * height / area2).select(over, edges)
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
            assert!((squared(Vec3::from(x), &t) - d2).abs() < 1e-14, "{x:?}");
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
            // Whatever the guess.
            for guess in [0, 77, u32::MAX] {
                let (distance, place) = walls.nearest(x, guess);
                assert_eq!((distance, squared(x, &triangles[place as usize])), (all.sqrt(), all));
            }
        }
        assert_eq!(Walls::new(Vec::new()).nearest(Vec3::zeros(), 0).0, f64::INFINITY);
    }
}
