//! Local repair: nodes around bad cells move until the corners of their cells
//! come near right angles, at the edge lengths that the layers prescribe.
//!
//! Each corner with edge vectors e_i and wanted lengths l_i has the shape measure
//! q = |T|^2 / (3 h(det T)^(2/3)), T = [e_i / l_i]: 1 for a right-angled corner of
//! the wanted proportions. h(d) = (d + sqrt(d^2 + 4 delta^2)) / 2 keeps it finite
//! and pushing the right way for inverted corners (Escobar et al., CMAME 192,
//! 2003). Newton steps node by node on the sum of q^2 of the corners at a node.

use crate::FlowGrid;
use crate::geometry::{Mat3, Point, Vec3, at};
use crate::quality::{CORNER_EDGES, scaled_jacobian};

/// Cells below this scaled Jacobian are repaired, with this many rings of
/// neighbours, in at most this many sweeps.
const WANTED: f64 = 0.25;
const RINGS: usize = 2;
const SWEEPS: usize = 60;

/// A corner of a cell whose three edges are all there.
struct Corner {
    /// The corner's node, then the ends of its edges, right-handed.
    nodes: [u32; 4],
    /// Wanted lengths of the edges, inverted, 1/m.
    inverse: [f64; 3],
}

/// The sum of $`q^2`$ of the corners at a node as a function of its position, to second order.
#[derive(Default)]
struct Shape {
    value: f64,
    slope: Vec3,
    second: Mat3,
}

impl Corner {
    /// $`q^2`$ where `delta` regularises determinants.
    fn value(&self, x: &[Point], delta: f64) -> f64 {
        let t = self.edges(x);
        let square = t[0].dot(&t[0]) + t[1].dot(&t[1]) + t[2].dot(&t[2]);
        let q = square * Regularised::new(t[0].dot(&t[1].cross(&t[2])), delta).shrink();
        q * q
    }

    /// Adds $`q^2`$ with its derivatives by the position of node `own` (0: the corner's, then the ends of its edges).
    ///
    /// With respect to one node $`S = |T|^2`$ is quadratic and $`\det T`$ affine, so that with $`g = h^{-2/3} / 3`$, $`g' = -\tfrac23 g / r`$,
    /// $`r = \sqrt{d^2 + 4 \delta^2}`$,
    /// ```math
    /// \nabla q = g \nabla S + S g' c, \qquad
    /// \nabla^2 q = 2 k g I + g' (\nabla S\, c^T + c\, \nabla S^T) + S g'' c\, c^T, \qquad c = \nabla \det T .
    /// ```
    fn add_to(&self, shape: &mut Shape, own: usize, x: &[Point], delta: f64) {
        let t = self.edges(x);
        let square = t[0].dot(&t[0]) + t[1].dot(&t[1]) + t[2].dot(&t[2]);
        let cofactor = [t[1].cross(&t[2]), t[2].cross(&t[0]), t[0].cross(&t[1])];
        let by_edge =
            |i: usize| (t[i] * self.inverse[i], cofactor[i] * self.inverse[i], self.inverse[i].powi(2));
        let (half, c, k) = match own {
            0 => (0..3).map(by_edge).fold((Vec3::zeros(), Vec3::zeros(), 0.0), |sum, edge| {
                (sum.0 - edge.0, sum.1 - edge.1, sum.2 + edge.2)
            }),
            edge => by_edge(edge - 1),
        };
        let det = Regularised::new(t[0].dot(&cofactor[0]), delta);
        let g = det.shrink();
        let first = -2.0 / 3.0 * g / det.root;
        let second = -2.0 / 3.0 * (first - g * det.value / (det.root * det.root)) / det.root;
        let (q, slope) = (square * g, half * (2.0 * g) + c * (square * first));
        let cross = half * (2.0 * first);
        let curvature = Mat3::from_diagonal_element(2.0 * k * g)
            + cross * c.transpose()
            + c * (cross + c * (square * second)).transpose();
        shape.value += q * q;
        shape.slope += slope * (2.0 * q);
        shape.second += (slope * slope.transpose() + curvature * q) * 2.0;
    }

    /// The three edges over their wanted lengths.
    fn edges(&self, x: &[Point]) -> [Vec3; 3] {
        let o = at(x, self.nodes[0]);
        std::array::from_fn(|i| (at(x, self.nodes[i + 1]) - o) * self.inverse[i])
    }

    fn determinant(&self, x: &[Point]) -> f64 {
        let t = self.edges(x);
        t[0].dot(&t[1].cross(&t[2]))
    }
}

/// A determinant $`d`$ with what keeps it positive: $`r = \sqrt{d^2 + 4 \delta^2}`$ and $`h = (d + r) / 2`$.
struct Regularised {
    value: f64,
    root: f64,
    h: f64,
}

impl Regularised {
    fn new(value: f64, delta: f64) -> Self {
        let root = (value * value + 4.0 * delta * delta).sqrt().max(1e-12);
        // The plain sum cancels for very negative determinants.
        let h = if value > 0.0 { 0.5 * (value + root) } else { 2.0 * delta * delta / (root - value) };
        Self { value, root, h: h.max(1e-12) }
    }

    /// $`h^{-2/3} / 3`$.
    fn shrink(&self) -> f64 {
        self.h.powf(-2.0 / 3.0) / 3.0
    }
}

/// Repairs `grid` around cells of low quality; nodes for which `fixed` holds stay.
pub(super) fn smooth(grid: &mut FlowGrid, fixed: impl Fn(usize) -> bool) {
    let Some(near) = near_bad_cells(grid) else { return };
    let nodes = grid.coords.len();
    let active: Vec<u32> = (0..nodes).filter(|&n| near[n] && !fixed(n)).map(|n| n as u32).collect();
    let mut place = vec![u32::MAX; nodes];
    active.iter().enumerate().for_each(|(i, &n)| place[n as usize] = i as u32);
    let (corners, repaired) = corners_of(grid, &place);
    let around = Around::new(&corners, &place, active.len());

    let x = &mut grid.coords;
    let mut still = vec![0u32; active.len()];
    let mut worst = f64::NEG_INFINITY;
    for sweep in 0..SWEEPS {
        if sweep % 4 == 0 {
            let quality = |c: &[u32; 8]| scaled_jacobian(x, c);
            let now =
                repaired.iter().map(|&c| quality(&grid.cells[c as usize])).fold(f64::INFINITY, f64::min);
            // Good enough, or as good as it gets.
            if now > WANTED || (now > 0.0 && now < worst + 0.05 * WANTED) {
                break;
            }
            worst = now;
        }
        let least = corners.iter().map(|c| c.determinant(x)).fold(f64::INFINITY, f64::min);
        // From Escobar's choice for a tangled grid down to a light touch.
        let delta = if least < 0.05 { (0.05 * (0.05 - least)).sqrt().max(0.05) } else { 1e-3 };
        for (i, &n) in active.iter().enumerate() {
            // Nodes that rest are looked at now and then only.
            if still[i] > 2 && sweep % 4 != 0 {
                continue;
            }
            let step = improve(x, n as usize, &corners, around.of(i), delta);
            still[i] = if step < 1e-3 { still[i] + 1 } else { 0 };
        }
    }
}

/// Whether each node is within [`RINGS`] of a bad cell; `None` where no cell is bad.
fn near_bad_cells(grid: &FlowGrid) -> Option<Vec<bool>> {
    let mut near = vec![false; grid.coords.len()];
    let mut any = false;
    for cell in &grid.cells {
        if scaled_jacobian(&grid.coords, cell) < WANTED {
            cell.iter().for_each(|&n| near[n as usize] = true);
            any = true;
        }
    }
    if !any {
        return None;
    }
    for _ in 0..RINGS {
        let old = near.clone();
        for cell in &grid.cells {
            if cell.iter().any(|&n| old[n as usize]) {
                cell.iter().for_each(|&n| near[n as usize] = true);
            }
        }
    }
    Some(near)
}

/// The corners with a node that moves (with a `place`), and their cells.
fn corners_of(grid: &FlowGrid, place: &[u32]) -> (Vec<Corner>, Vec<u32>) {
    let rests = |nodes: &[u32]| nodes.iter().all(|&n| place[n as usize] == u32::MAX);
    let (mut corners, mut cells) = (Vec::new(), Vec::new());
    for (c, cell) in grid.cells.iter().enumerate() {
        if rests(cell) {
            continue;
        }
        cells.push(c as u32);
        for (corner, edges) in CORNER_EDGES.iter().enumerate() {
            let nodes = [cell[corner], cell[edges[0]], cell[edges[1]], cell[edges[2]]];
            if (0..4).any(|i| nodes[..i].contains(&nodes[i])) || rests(&nodes) {
                continue;
            }
            let x = nodes.map(|n| at(&grid.coords, n));
            let inverse = std::array::from_fn(|i| 1.0 / (x[i + 1] - x[0]).norm().max(f64::MIN_POSITIVE));
            corners.push(Corner { nodes, inverse });
        }
    }
    (corners, cells)
}

/// A corner at a node.
#[derive(Clone, Copy, Default)]
struct AtNode {
    corner: u32,
    /// Place of the node among those of the corner.
    own: u32,
}

/// Corners at each node that moves, in one list.
struct Around {
    start: Vec<usize>,
    list: Vec<AtNode>,
}

impl Around {
    fn new(corners: &[Corner], place: &[u32], nodes: usize) -> Self {
        let places = |c: &Corner| {
            let all = c.nodes.map(|n| place[n as usize]).into_iter().enumerate();
            all.filter(|&(_, p)| p != u32::MAX)
        };
        let mut start = vec![0usize; nodes + 1];
        for c in corners {
            places(c).for_each(|(_, p)| start[p as usize + 1] += 1);
        }
        for i in 0..nodes {
            start[i + 1] += start[i];
        }
        let mut fill = start.clone();
        let mut list = vec![AtNode::default(); start[nodes]];
        for (i, c) in corners.iter().enumerate() {
            for (own, p) in places(c) {
                list[fill[p as usize]] = AtNode { corner: i as u32, own: own as u32 };
                fill[p as usize] += 1;
            }
        }
        Self { start, list }
    }

    fn of(&self, i: usize) -> &[AtNode] {
        &self.list[self.start[i]..self.start[i + 1]]
    }
}

/// One damped Newton step of a node; how far it went, over its shortest wanted edge.
fn improve(x: &mut [Point], n: usize, corners: &[Corner], around: &[AtNode], delta: f64) -> f64 {
    let value =
        |x: &[Point]| around.iter().map(|at| corners[at.corner as usize].value(x, delta)).sum::<f64>();
    let inverse = around.iter().flat_map(|at| corners[at.corner as usize].inverse).fold(0.0, f64::max);
    let size = 1.0 / inverse;
    let start = x[n];
    let mut shape = Shape::default();
    for at in around {
        corners[at.corner as usize].add_to(&mut shape, at.own as usize, x, delta);
    }
    let Shape { value: before, slope, second } = shape;
    // Positions of extreme size overflow; the search for eigenvalues would not end.
    let finite = before.is_finite() && slope.norm().is_finite() && second.norm().is_finite();
    if !finite || slope.norm() * size < 1e-9 * before {
        return 0.0;
    }
    let eigen = second.symmetric_eigen();
    let largest = eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
    let mut direction = Vec3::zeros();
    for a in 0..3 {
        let v = eigen.eigenvectors.column(a);
        direction -= v * (v.dot(&slope) / eigen.eigenvalues[a].abs().max(1e-3 * largest));
    }
    let (start, length) = (Vec3::from(start), direction.norm());
    let mut step = (size / length).min(1.0);
    for _ in 0..8 {
        x[n] = (start + direction * step).into();
        if value(x) < before {
            return step * length * inverse;
        }
        step *= 0.4;
    }
    x[n] = start.into();
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions whose squares overflow stay, and the smoothing ends.
    #[test]
    fn extreme_positions_stay() {
        for far in [1e60, 1e120, 1e200, f64::NAN] {
            let mut x = vec![[0.0; 3], [far, 0.0, 0.0], [0.0, far, 0.0], [0.0, 0.0, far]];
            let before = format!("{:?}", x[0]);
            let corners = [Corner { nodes: [0, 1, 2, 3], inverse: [1.0; 3] }];
            let moved = improve(&mut x, 0, &corners, &[AtNode { corner: 0, own: 0 }], 1e-3);
            assert!(moved.is_finite(), "{far}: {moved}");
            assert!(far < 1e100 || format!("{:?}", x[0]) == before, "{far}: {x:?}");
        }
    }

    /// Slope and second derivatives against central differences, at each node of a corner, upright and inverted.
    #[test]
    fn derivatives_of_the_shape_measure_are_exact() {
        let upright = vec![[0.1, -0.2, 0.05], [1.2, 0.1, 0.2], [-0.1, 0.8, 0.3], [0.2, 0.1, 1.4]];
        let mut inverted = upright.clone();
        inverted[3][2] = -0.3;
        let corner = Corner { nodes: [0, 1, 2, 3], inverse: [1.0, 1.3, 0.7] };
        for (mut x, delta) in [(upright, 1e-3), (inverted, 0.2)] {
            for own in 0..4 {
                let mut shape = Shape::default();
                corner.add_to(&mut shape, own, &x, delta);
                assert!((shape.value - corner.value(&x, delta)).abs() < 1e-14 * shape.value);
                let h = 1e-5;
                let scale = shape.second.norm();
                for a in 0..3 {
                    let [ahead, behind] = [h, -h].map(|by| {
                        let kept = x[own];
                        x[own][a] += by;
                        let mut at = Shape::default();
                        corner.add_to(&mut at, own, &x, delta);
                        x[own] = kept;
                        at
                    });
                    let slope = (ahead.value - behind.value) / (2.0 * h);
                    assert!((slope - shape.slope[a]).abs() < 1e-8 * scale, "{own}, {a}: {slope}");
                    let second = (ahead.slope - behind.slope) / (2.0 * h);
                    assert!((second - shape.second.column(a)).norm() < 1e-7 * scale, "{own}, {a}: {second}");
                }
            }
        }
    }
}
