//! First positions of all grid nodes, before smoothing.

use case::Grid;

use super::topology::{Blocks, CubePoint};
use crate::geometry::{Point, Vec3};

/// The core's size over the surface's, and how round the core is (0: a box).
const CORE_SIZE: f64 = 0.5;
const CORE_ROUND: f64 = 0.4;
/// The open bottom bulges below the hem by the hem's radius, less this share of
/// the canopy's height, but by this share of the radius at least.
const BULGE_LESS: f64 = 0.55;
const BULGE_LEAST: f64 = 0.45;
/// Lines leave the surface along its normal over this share of its half-width.
const NORMAL_REACH: f64 = 0.3;
/// Direction at the surface: all normal (1) or all chord (0).
const NORMAL_SHARE: f64 = 0.7;

/// Positions of all grid nodes, m, from those of the canopy.
pub(super) fn place(blocks: &Blocks, canopy: &[Point], grid: &Grid, width: f64) -> Vec<Point> {
    let mut x = vec![Vec3::zeros(); blocks.nodes];
    x.iter_mut().zip(canopy).for_each(|(x, &at)| *x = at.into());
    fill_vents(blocks, &mut x);
    let links = surface_links(blocks);
    fill_mouth(blocks, &links, &mut x);

    let surface = &x[..blocks.surface];
    let (lo, hi) = bounds(surface);
    let (centre, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
    let normals = normals(blocks, surface, &links);

    let core: Vec<Vec3> = blocks
        .core_cube()
        .map(|c| {
            let ball = ball(c);
            // A box of the same size as the ball has 0.8 of its half-width.
            let shape = (Vec3::from(c) * (0.8 * (1.0 - CORE_ROUND)) + ball * CORE_ROUND) * CORE_SIZE;
            centre + half.component_mul(&shape)
        })
        .collect();
    x[blocks.core..blocks.core + core.len()].copy_from_slice(&core);

    let (side, wake) = (grid.far_field_widths * width, grid.wake_widths * width);
    let first = grid.first_layer_m;
    let reach = NORMAL_REACH * half[0].max(half[1]);
    for s in 0..blocks.surface {
        let wall = x[s];
        let sphere = sphere(blocks.cube[s]);
        let size = Vec3::new(side, side, if sphere.z > 0.0 { wake } else { side });
        let far = centre + size.component_mul(&sphere);
        let line: Vec<u32> = blocks.line(s).collect();
        let [inside, outside] = blocks.layers;
        let inner = Curve::new(wall, -normals[s], x[line[0] as usize], reach);
        let steps = stretch(first / inner.chord, inside);
        for l in 1..inside {
            x[line[inside - l] as usize] = inner.at(steps[l]);
        }
        let outer = Curve::new(wall, normals[s], far, reach);
        let steps = stretch(first / outer.chord, outside);
        for l in 1..=outside {
            x[line[inside + l] as usize] = outer.at(steps[l]);
        }
    }
    x.into_iter().map(Point::from).collect()
}

/// A grid line that starts from a wall along a direction and ends in a point.
struct Curve {
    from: Vec3,
    to: Vec3,
    /// From the chord's direction to the wall's normal.
    turn: Vec3,
    reach: f64,
    chord: f64,
}

impl Curve {
    fn new(from: Vec3, along: Vec3, to: Vec3, reach: f64) -> Self {
        let chord = (to - from).norm().max(f64::MIN_POSITIVE);
        let turn = along - (to - from) * (along.norm() / chord);
        Curve { from, to, turn, reach: reach.min(0.4 * chord), chord }
    }

    /// The point at the share `t` of the chord.
    fn at(&self, t: f64) -> Vec3 {
        let straight = self.from * (1.0 - t) + self.to * t;
        let aside = self.reach * (1.0 - (-t * self.chord / self.reach).exp());
        straight + self.turn * (NORMAL_SHARE * aside * (1.0 - t) * (1.0 - t))
    }
}

/// `layers + 1` values from 0 to 1 whose first step is `first`, growing by a
/// constant ratio; evenly spaced where `first` is larger than that.
fn stretch(first: f64, layers: usize) -> Vec<f64> {
    let ratio = growth(first, layers);
    let total = (0..layers).fold(0.0, |s, _| s * ratio + 1.0);
    let mut values = vec![0.0];
    let mut step = 1.0 / total;
    for l in 0..layers {
        values.push(values[l] + step);
        step *= ratio;
    }
    values[layers] = 1.0;
    values
}

/// Ratio of a step to the one before of `layers` steps to 1, the first of size `first`; 1 where that is too large.
pub(super) fn growth(first: f64, layers: usize) -> f64 {
    let sum = |ratio: f64| (0..layers).fold(0.0, |s, _| s * ratio + 1.0);
    let (mut low, mut high) = (1.0, 1.0);
    if sum(1.0) * first < 1.0 && layers > 1 {
        while sum(high) * first < 1.0 {
            high *= 1.5;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if sum(middle) * first < 1.0 { low = middle } else { high = middle }
        }
    }
    0.5 * (low + high)
}

/// Smooth map of the cube to the ball of radius 1.
fn ball([x, y, z]: CubePoint) -> Vec3 {
    let f = |x: f64, y: f64, z: f64| x * (1.0 - 0.5 * (y * y + z * z) + y * y * z * z / 3.0).max(0.0).sqrt();
    Vec3::new(f(x, y, z), f(y, z, x), f(z, x, y))
}

/// The unit sphere's point for a point of the cube's surface, at equal angles.
fn sphere(cube: CubePoint) -> Vec3 {
    let t = Vec3::from(cube).map(|c| (std::f64::consts::FRAC_PI_4 * c).tan());
    t * (1.0 / t.norm())
}

fn bounds(x: &[Vec3]) -> (Vec3, Vec3) {
    let lo = x.iter().fold(Vec3::repeat(f64::MAX), |m, p| m.inf(p));
    let hi = x.iter().fold(Vec3::repeat(f64::MIN), |m, p| m.sup(p));
    (lo, hi)
}

fn fill_vents(blocks: &Blocks, x: &mut [Vec3]) {
    for b in blocks.open_levels() {
        for k in 0..4 {
            let [p, q] = [0, blocks.across].map(|z| x[blocks.zipper(k, z, b) as usize]);
            for z in 1..blocks.across {
                let t = z as f64 / blocks.across as f64;
                x[blocks.zipper(k, z, b) as usize] = p * (1.0 - t) + q * t;
            }
        }
    }
}

/// Neighbours along the surface's edges.
fn surface_links(blocks: &Blocks) -> crate::Graph {
    let edges = blocks.quads.iter().flat_map(|q| (0..4).map(move |i| [q[i], q[(i + 1) % 4]]));
    crate::Graph::from_pairs(blocks.surface, edges)
}

/// Skirt and cap: a harmonic map of the mouth in plan, bulging downwards.
fn fill_mouth(blocks: &Blocks, links: &crate::Graph, x: &mut [Vec3]) {
    let n = blocks.n;
    let hem: Vec<u32> = (0..4 * n).map(|i| blocks.side(i / n, i % n, blocks.hem())).collect();
    let mean = hem.iter().fold(Vec3::zeros(), |m, &s| m + x[s as usize] * (0.25 / n as f64));
    let radius =
        hem.iter().map(|&s| (x[s as usize][0] - mean[0]).hypot(x[s as usize][1] - mean[1])).sum::<f64>()
            / (4 * n) as f64;
    let rings = (blocks.levels - blocks.hem()) as f64 + 0.5 * n as f64;
    // Free nodes with a fourth coordinate: 1 - r^2 of a disc of radius 1, from 0 at the hem.
    let mut free = Vec::new();
    let mut bulge = vec![0.0; blocks.surface];
    for b in blocks.hem() + 1..=blocks.levels {
        for (i, &rim) in hem.iter().enumerate() {
            let s = blocks.side(i / n, i % n, b);
            let t = (b - blocks.hem()) as f64 / rings;
            // Between two arms that are apart at the hem: half-way.
            let other = if i % n == 0 { blocks.side((i / n + 3) % 4, n, blocks.hem()) } else { rim };
            let rim = (x[rim as usize] + x[other as usize]) * 0.5;
            x[s as usize] = rim * (1.0 - t) + mean * t;
            bulge[s as usize] = 1.0 - (1.0 - t) * (1.0 - t);
            free.push(s);
        }
    }
    let edge = 0.5 * n as f64 / rings;
    for j in 1..n {
        for i in 1..n {
            // From the cap's own edge towards the middle, by the larger coordinate.
            let [u, v] = [i, j].map(|a| 2.0 * a as f64 / n as f64 - 1.0);
            let size = u.abs().max(v.abs()).max(1e-9);
            let place = |w: f64| ((w / size).clamp(-1.0, 1.0) + 1.0) * 0.5 * n as f64;
            let (p, q) = (place(u), place(v));
            let at = |p: f64, q: f64| x[blocks.cap(p as usize, q as usize) as usize];
            let share = (p - p.floor()) + (q - q.floor());
            let rim = at(p.floor(), q.floor()) * (1.0 - share) + at(p.ceil(), q.ceil()) * share;
            let s = blocks.cap(i, j);
            x[s as usize] = rim * size + mean * (1.0 - size);
            bulge[s as usize] = 1.0 - (edge * size) * (edge * size);
            free.push(s);
        }
    }
    // Jacobi sweeps, which keep the canopy's symmetry; the start is close already.
    let mut next = vec![(Vec3::zeros(), 0.0); free.len()];
    for _ in 0..2 * n {
        for (next, &s) in next.iter_mut().zip(&free) {
            let around = links.of(s as usize);
            let share = 1.0 / around.len() as f64;
            let sum = around.iter().fold(Vec3::zeros(), |m, &t| m + x[t as usize]);
            let mean_bulge = around.iter().map(|&t| bulge[t as usize]).sum::<f64>() * share;
            *next = (sum * share, mean_bulge + 1.0 / (rings * rings));
        }
        for (next, &s) in next.iter().zip(&free) {
            (x[s as usize], bulge[s as usize]) = *next;
        }
    }
    let highest = x[..blocks.surface].iter().map(|p| p[2]).fold(f64::MIN, f64::max);
    let depth = (radius - BULGE_LESS * (highest - mean[2])).max(BULGE_LEAST * radius);
    let most = bulge.iter().fold(f64::MIN_POSITIVE, |m, &b| m.max(b));
    for &s in &free {
        x[s as usize][2] -= depth * (bulge[s as usize] / most).sqrt();
    }
}

/// Normals of the surface's nodes, out of the canopy, smoothed: of length 1 where
/// the surface is nearly flat, down to 0 where it bends sharply.
fn normals(blocks: &Blocks, x: &[Vec3], links: &crate::Graph) -> Vec<Vec3> {
    let mut sum = vec![Vec3::zeros(); x.len()];
    for q in &blocks.quads {
        let [a, b, c, d] = q.map(|s| x[s as usize]);
        let area = (c - a).cross(&(d - b));
        for (i, &s) in q.iter().enumerate() {
            if !q[..i].contains(&s) {
                sum[s as usize] += area;
            }
        }
    }
    let unit = |v: Vec3| if v.norm() > 0.0 { v * (1.0 / v.norm()) } else { v };
    let mut own: Vec<Vec3> = sum.into_iter().map(unit).collect();
    // Over the same distance at any resolution: sweeps grow with its square.
    let sweeps = (blocks.n * blocks.n / 160).clamp(2, 400);
    for _ in 0..sweeps {
        own = (0..x.len())
            .map(|s| {
                let near = links.of(s).iter().fold(Vec3::zeros(), |m, &t| m + own[t as usize]);
                (own[s] + near * (1.0 / links.of(s).len() as f64)) * 0.5
            })
            .collect();
    }
    let straightness = |m: f64| ((m - 0.85) / 0.1).clamp(0.0, 1.0);
    own.into_iter().map(|v| unit(v) * straightness(v.norm())).collect()
}
