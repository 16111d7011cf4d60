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

impl Corner {
    /// The measure q and its derivatives by the four nodes, where `delta`
    /// regularises determinants.
    fn measure(&self, x: &[Point], delta: f64) -> (f64, [Vec3; 4]) {
        let t = self.edges(x);
        let square = t[0].dot(&t[0]) + t[1].dot(&t[1]) + t[2].dot(&t[2]);
        let cofactor = [t[1].cross(&t[2]), t[2].cross(&t[0]), t[0].cross(&t[1])];
        let det = t[0].dot(&cofactor[0]);
        let root = (det * det + 4.0 * delta * delta).sqrt();
        // The plain sum cancels for very negative determinants.
        let h = if det > 0.0 { 0.5 * (det + root) } else { 2.0 * delta * delta / (root - det) };
        let h = h.max(1e-12);
        let shrink = 1.0 / (3.0 * h.cbrt() * h.cbrt());
        let q = square * shrink;
        let mut d = [Vec3::zeros(); 4];
        for i in 0..3 {
            let by_t = t[i] * (2.0 * shrink) - cofactor[i] * (2.0 / 3.0 * q / root.max(1e-12));
            d[i + 1] = by_t * self.inverse[i];
            let own = d[i + 1];
            d[0] -= own;
        }
        (q, d)
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

/// Corners at each node that moves, in one list.
struct Around {
    start: Vec<usize>,
    list: Vec<u32>,
}

impl Around {
    fn new(corners: &[Corner], place: &[u32], nodes: usize) -> Self {
        let places = |c: &Corner| c.nodes.map(|n| place[n as usize]).into_iter().filter(|&p| p != u32::MAX);
        let mut start = vec![0usize; nodes + 1];
        for c in corners {
            places(c).for_each(|p| start[p as usize + 1] += 1);
        }
        for i in 0..nodes {
            start[i + 1] += start[i];
        }
        let mut fill = start.clone();
        let mut list = vec![0u32; start[nodes]];
        for (i, c) in corners.iter().enumerate() {
            for p in places(c) {
                list[fill[p as usize]] = i as u32;
                fill[p as usize] += 1;
            }
        }
        Self { start, list }
    }

    fn of(&self, i: usize) -> &[u32] {
        &self.list[self.start[i]..self.start[i + 1]]
    }
}

/// One damped Newton step of a node; how far it went, over its shortest wanted edge.
fn improve(x: &mut [Point], n: usize, corners: &[Corner], around: &[u32], delta: f64) -> f64 {
    let node = n as u32;
    let local = |x: &[Point]| {
        let (mut sum, mut slope) = (0.0, Vec3::zeros());
        for &c in around {
            let c = &corners[c as usize];
            let (q, d) = c.measure(x, delta);
            let own = c.nodes.iter().position(|&m| m == node).expect("listed at its nodes");
            sum += q * q;
            slope += d[own] * (2.0 * q);
        }
        (sum, slope)
    };
    let inverse = around.iter().flat_map(|&c| corners[c as usize].inverse).fold(0.0, f64::max);
    let size = 1.0 / inverse;
    let start = x[n];
    let (value, slope) = local(x);
    let steep = slope.norm();
    if steep * size < 1e-9 * value {
        return 0.0;
    }
    // Second derivatives by differences of the slope.
    let mut second = Mat3::zeros();
    let h = 1e-4 * size;
    for a in 0..3 {
        x[n][a] = start[a] + h;
        let (_, s) = local(x);
        x[n] = start;
        for b in 0..3 {
            second[(a, b)] = (s[b] - slope[b]) / h;
        }
    }
    let second = 0.5 * (second + second.transpose());
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
        if local(x).0 < value {
            return step * length * inverse;
        }
        step *= 0.4;
    }
    x[n] = start.into();
    0.0
}
