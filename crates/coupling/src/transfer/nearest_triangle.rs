//! The triangle nearest to a point, by a tree of bounding boxes.

use crate::geometry::Vec3;

/// Triangles in a leaf of the tree.
const LEAF: usize = 8;

/// Search tree over triangles.
pub(super) struct NearestTriangle {
    triangles: Vec<[Vec3; 3]>,
    /// Triangles in the order of the tree: a box contains a range of them, its children the halves.
    order: Vec<u32>,
    /// Lower and upper corners in the order of [`NearestTriangle::search`]: a box, its first child with all
    /// descendants, its second.
    boxes: Vec<[Vec3; 2]>,
}

impl NearestTriangle {
    pub fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut boxes = Vec::new();
        if !triangles.is_empty() {
            divide(&triangles, &mut order, &mut boxes);
        }
        Self { triangles, order, boxes }
    }

    /// Triangle nearest to `p` (the first one of equally near ones) and its distance; `None` where there is none or
    /// `p` is NaN.
    pub fn to(&self, p: Vec3) -> Option<(usize, f64)> {
        let mut best = (f64::INFINITY, u32::MAX);
        if !self.order.is_empty() {
            self.search(p, 0, 0..self.order.len(), &mut best);
        }
        (best.1 != u32::MAX).then_some((best.1 as usize, best.0))
    }

    fn search(&self, p: Vec3, at: usize, range: std::ops::Range<usize>, best: &mut (f64, u32)) {
        if range.len() <= LEAF {
            for &t in &self.order[range] {
                let far = nearest(p, &self.triangles[t as usize]);
                if far < best.0 || (far == best.0 && t < best.1) {
                    *best = (far, t);
                }
            }
            return;
        }
        let middle = range.start + range.len() / 2;
        let (first, second) = (at + 1, at + 1 + count(middle - range.start));
        let [near, far] = [first, second].map(|b| distance(p, &self.boxes[b]));
        let mut halves = [(near, first, range.start..middle), (far, second, middle..range.end)];
        if far < near {
            halves.swap(0, 1);
        }
        for (away, at, range) in halves {
            // A box is at most as far away as its content, up to round-off.
            if away <= best.0 * (1.0 + 1e-9) {
                self.search(p, at, range, best);
            }
        }
    }
}

/// Number of boxes of a tree of `n` triangles.
fn count(n: usize) -> usize {
    if n <= LEAF { 1 } else { 1 + count(n / 2) + count(n - n / 2) }
}

fn divide(triangles: &[[Vec3; 3]], order: &mut [u32], boxes: &mut Vec<[Vec3; 2]>) {
    let mut around = [f64::INFINITY, f64::NEG_INFINITY].map(Vec3::repeat);
    for corner in order.iter().flat_map(|&t| triangles[t as usize]) {
        for i in 0..3 {
            around[0][i] = around[0][i].min(corner[i]);
            around[1][i] = around[1][i].max(corner[i]);
        }
    }
    boxes.push(around);
    if order.len() <= LEAF {
        return;
    }
    let width = |i: usize| around[1][i] - around[0][i];
    let long = (1..3).fold(0, |long, i| if width(i) > width(long) { i } else { long });
    let middle = |t: u32| triangles[t as usize].iter().map(|x| x[long]).sum::<f64>();
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| middle(a).total_cmp(&middle(b)).then(a.cmp(&b)));
    let (first, second) = order.split_at_mut(half);
    divide(triangles, first, boxes);
    divide(triangles, second, boxes);
}

/// Distance of `p` from a box.
fn distance(p: Vec3, [low, high]: &[Vec3; 2]) -> f64 {
    (0..3).map(|i| (low[i] - p[i]).max(p[i] - high[i]).max(0.0).powi(2)).sum::<f64>().sqrt()
}

/// Distance of `p` from a triangle (Ericson 2005, section 5.1.5).
pub(super) fn nearest(p: Vec3, corners: &[Vec3; 3]) -> f64 {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    let (bp, cp) = (p - b, p - c);
    let (d3, d4, d5, d6) = (ab.dot(&bp), ac.dot(&bp), ab.dot(&cp), ac.dot(&cp));
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
    (p - blend(weights, corners)).norm()
}

/// Normal of a triangle, with the length of twice its area.
pub(super) fn normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a))
}

/// The point of a triangle at barycentric coordinates `w`.
pub(super) fn blend(w: [f64; 3], [a, b, c]: &[Vec3; 3]) -> Vec3 {
    w[0] * a + w[1] * b + w[2] * c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn search_agrees_with_exhaustive_search() {
        // Random triangles of all sizes, some of them equal, and points inside and far outside.
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        let mut point = |size: f64| -> Vec3 { Vec3::from_fn(|_, _| size * (random() - 0.5)) };
        let mut triangles: Vec<[Vec3; 3]> = (0..500)
            .map(|k| {
                let at = point(4.0);
                let size = if k % 50 == 0 { 3.0 } else { 0.2 };
                [(); 3].map(|()| at + point(size))
            })
            .collect();
        triangles.extend_from_within(..100);
        let near = NearestTriangle::new(triangles.clone());
        assert_eq!(near.boxes.len(), count(triangles.len()));
        for k in 0..500 {
            let p = point(if k % 5 == 0 { 40.0 } else { 5.0 });
            let all = triangles.iter().map(|t| nearest(p, t)).enumerate();
            let first = all.min_by(|a, b| a.1.total_cmp(&b.1)).expect("triangles");
            assert_eq!(near.to(p), Some(first));
        }
        assert_eq!(near.to(Vec3::repeat(f64::NAN)), None);
        assert_eq!(NearestTriangle::new(Vec::new()).to(Vec3::zeros()), None);
    }
}
