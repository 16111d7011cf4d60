//! Weighted least-squares gradients, exact for linear fields on any grid.
//!
//! On an even grid of hexahedra they are central differences, of second order. Where the flux may be central, a second pass makes
//! them of fourth order ([`LeastSquares::compact_correction`]).

use mesh::lanes::{LANES, Lanes, Real, lane_by_lane, lanes, rows};
use nalgebra::{Matrix3, SimdBool, Vector3};

use crate::geometry::Metrics;
use crate::geometry::vec3::{Mat3, Vec3};
use crate::physics::velocity;
use crate::topology::{Adjacency, Side, Topology};

/// Gradient of `N` variables: `g[direction][variable]`.
pub type Gradient<const N: usize> = [[f64; N]; 3];

/// Change of the variable `v` with the gradient `g` along `d`.
#[inline(always)]
pub fn along<T: Real, const N: usize>(g: &[[T; N]; 3], v: usize, d: &Vector3<T>) -> T {
    g[0][v] * d.x + g[1][v] * d.y + g[2][v] * d.z
}

/// Velocity gradient (1/s, row: direction, column: component) within that of all unknowns.
#[inline(always)]
pub fn of_velocity<T: Real, const N: usize>(g: &[[T; N]; 3]) -> Matrix3<T> {
    let [x, y, z] = g;
    Matrix3::new(x[1], x[2], x[3], y[1], y[2], y[3], z[1], z[2], z[3])
}

/// Curl of the velocity, 1/s, from the gradient of all unknowns.
#[inline(always)]
pub fn vorticity<const N: usize>(g: &Gradient<N>) -> Vec3 {
    let [x, y, z] = g;
    Vec3::new(y[3] - z[2], z[1] - x[3], x[2] - y[1])
}

/// The state `q` of a cell, of gradient `g`, continued by `d` from its centre.
#[inline(always)]
pub fn extrapolated<const N: usize>(q: &[f64; N], g: &Gradient<N>, d: &Vec3) -> [f64; N] {
    std::array::from_fn(|v| q[v] + g[0][v] * d.x + g[1][v] * d.y + g[2][v] * d.z)
}

/// Unknowns of local cells and their gradients.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a, const N: usize> {
    /// Unknowns.
    pub q: &'a [[f64; N]],
    /// Their gradients.
    pub gradient: &'a [Gradient<N>],
}

/// Weights of each neighbour in the gradient of a cell: the rows of the
/// pseudo-inverse of the distances, weighted by inverse distance squared. Single
/// precision: a uniform field has exactly no gradient, a linear one has its own to 1e-7.
#[derive(Clone, Debug, Default)]
pub struct LeastSquares {
    weight: Vec<[f32; 3]>,
    /// Mirror images of cells at planes of symmetry, sorted by cell.
    images: Vec<Image>,
    /// Scratch: how far each cell's reconstruction reaches.
    reach: Vec<f32>,
    /// Cells whose reconstruction is shortened, and by how much.
    shortened: Vec<(u32, f64)>,
}

/// Mirror image of a cell in a plane of symmetry. All unknowns but the velocity along the normal are those of the cell.
#[derive(Clone, Copy, Debug)]
struct Image {
    cell: u32,
    face: u32,
    /// Unit normal out of the domain.
    normal: Vec3,
    /// From the centre of the cell to that of the image, m.
    way: Vec3,
    /// As those of neighbours, 1/m.
    weight: Vec3,
}

impl Image {
    fn new(side: &Side, metrics: &Metrics) -> Self {
        let area = metrics.faces[side.face as usize].area * side.sign;
        let normal = area / area.norm();
        let way = normal * (2.0 * metrics.height(side));
        Self { cell: side.cell, face: side.face, normal, way, weight: Vec3::zeros() }
    }

    /// Adds the part of the image to the compact correction of its cell, whose gradient is `g`, with the weight `third`.
    fn add_correction<const N: usize>(&self, g: &Gradient<N>, third: f64, change: &mut Gradient<N>) {
        let n = &self.normal;
        // Along the normal the image has the opposite slope in all unknowns but the velocity along the normal.
        let length = 2.0 * third * self.way.norm();
        let slope: [f64; N] = std::array::from_fn(|v| along(g, v, n));
        let normal_slope = slope[1] * n.x + slope[2] * n.y + slope[3] * n.z;
        for (v, s) in slope.iter().enumerate() {
            let kept = if (1..4).contains(&v) { normal_slope * n[v - 1] } else { 0.0 };
            (0..3).for_each(|e| change[e][v] += self.weight[e] * length * (s - kept));
        }
    }
}

/// Weight of the difference of two gradients along the line of centres in [`LeastSquares::compact_correction`].
const COMPACT: f64 = 1.0 / 3.0;

/// Largest sum of the weights (their absolute values) with which neighbours may
/// enter a value on a face of a cell. Even hexahedra have 0.5, regular
/// tetrahedra 0.75; needles and slivers beyond make the second-order scheme
/// unstable, because a face value then extrapolates instead of averaging (seen on
/// the prisms in the vents of the ATPS grid: unstable at 1.0, stable at 0.75).
const REACH: f64 = 0.75;
/// The same for gradients over neighbours' neighbours: so many of them average, that
/// values which extrapolate a little stay stable.
const WIDE_REACH: f64 = 1.1;
/// A cell has at most so many neighbours over its faces.
const FACES: u32 = 6;

impl LeastSquares {
    /// Weights for the cells of `topology` with the centres of `metrics`.
    pub fn new(topology: &Topology, metrics: &Metrics) -> Self {
        let mut this = Self {
            weight: vec![[0.0; 3]; topology.stencil().cell.len()],
            images: Vec::with_capacity(topology.symmetry.len()),
            reach: vec![0.0; topology.n_owned],
            shortened: Vec::new(),
        };
        this.update(topology, metrics);
        this
    }

    /// Recomputes the weights after the grid has moved.
    pub fn update(&mut self, topology: &Topology, metrics: &Metrics) {
        let a = topology.stencil();
        self.images.clear();
        self.images.extend(topology.symmetry.iter().map(|side| Image::new(side, metrics)));
        let (weight, mut images) = (&mut self.weight, self.images.as_mut_slice());
        let mut i = 0;
        while i < topology.n_owned {
            let next = images.first().map_or(topology.n_owned, |image| image.cell as usize);
            if i + LANES <= next && have_equal_rows(a, i) {
                weigh_cells(a, metrics, i, weight);
                i += LANES;
            } else {
                let here = images.iter().take_while(|image| image.cell as usize == i).count();
                let (mine, others) = images.split_at_mut(here);
                weigh_cell(a, metrics, i, mine, weight);
                (images, i) = (others, i + 1);
            }
        }
        self.find_needles(topology, metrics);
    }

    /// Adds the mirror images to the gradients of the owned cells at planes of symmetry: the velocity along their normal changes its sign
    /// relative to the plane.
    pub fn add_images<const N: usize>(
        &self,
        metrics: &Metrics,
        q: &[[f64; N]],
        gradient: &mut [Gradient<N>],
    ) {
        for image in &self.images {
            let cell = image.cell as usize;
            let face = &metrics.faces[image.face as usize];
            let plane = face.grid_flux / face.magnitude() * face.area.dot(&image.normal).signum();
            let change = 2.0 * (plane - velocity(&q[cell]).dot(&image.normal));
            for d in 0..3 {
                for e in 0..3 {
                    gradient[cell][d][1 + e] += image.weight[d] * change * image.normal[e];
                }
            }
        }
    }

    fn find_needles(&mut self, topology: &Topology, metrics: &Metrics) {
        let a = topology.stencil();
        let (reach, weight) = (&mut self.reach, &self.weight);
        reach.fill(0.0);
        topology.for_each_side(|f, i, _| {
            if i < topology.n_owned {
                let d = metrics.face_centre(topology, f) - metrics.centre(i);
                let row = a.start[i] as usize..a.start[i + 1] as usize;
                let sum: f64 = weight[row].iter().map(|w| Vec3::from(w.map(f64::from)).dot(&d).abs()).sum();
                reach[i] = reach[i].max(sum as f32);
            }
        });

        let bound = |i: usize| if a.start[i + 1] - a.start[i] > FACES { WIDE_REACH } else { REACH };
        let shares = reach.iter().enumerate().map(|(i, &r)| (i as u32, bound(i) / f64::from(r)));
        self.shortened.clear();
        self.shortened.extend(shares.filter(|(_, share)| *share < 1.0));
    }

    /// Shortens the gradients of needle-like owned cells to what a stable
    /// reconstruction tolerates.
    pub fn shorten<const N: usize>(&self, gradient: &mut [Gradient<N>]) {
        for &(i, s) in &self.shortened {
            gradient[i as usize].as_flattened_mut().iter_mut().for_each(|g| *g *= s);
        }
    }

    /// Gradients of the owned cells.
    pub fn apply<const N: usize>(&self, topology: &Topology, q: &[[f64; N]], gradient: &mut [Gradient<N>]) {
        self.inside(topology, q, gradient);
        self.border(topology, q, gradient);
    }

    /// Gradients of the owned cells whose neighbours are all owned: needs no ghosts.
    pub fn inside<const N: usize>(&self, topology: &Topology, q: &[[f64; N]], gradient: &mut [Gradient<N>]) {
        self.of_cells(topology, q, gradient, |ghosts| ghosts == 0);
    }

    /// Gradients of the other owned cells.
    pub fn border<const N: usize>(&self, topology: &Topology, q: &[[f64; N]], gradient: &mut [Gradient<N>]) {
        if topology.n_owned < topology.n_local() {
            self.of_cells(topology, q, gradient, |ghosts| ghosts > 0);
        }
    }

    #[inline(always)]
    fn of_cells<const N: usize>(
        &self,
        topology: &Topology,
        q: &[[f64; N]],
        gradient: &mut [Gradient<N>],
        wanted: impl Fn(u32) -> bool,
    ) {
        let a = topology.stencil();
        for (i, g) in gradient[..topology.n_owned].iter_mut().enumerate() {
            if !wanted(a.start[i + 1] - a.ghost[i]) {
                continue;
            }
            let row = a.start[i] as usize..a.start[i + 1] as usize;
            let qi = q[i];
            let mut sum = [[0.0; N]; 3];
            for (&j, w) in a.cell[row.clone()].iter().zip(&self.weight[row]) {
                let (qj, w) = (&q[j as usize], w.map(f64::from));
                for v in 0..N {
                    let d = qj[v] - qi[v];
                    sum[0][v] += w[0] * d;
                    sum[1][v] += w[1] * d;
                    sum[2][v] += w[2] * d;
                }
            }
            *g = sum;
        }
    }

    /// What the gradients of owned cells lack of fourth order on an even grid, from `gradient` of their own and of their neighbours:
    /// ```math
    /// \delta g_i = -\tfrac{1}{3} \sum_j w_{ij} (g_j - g_i) \cdot d_{ij},
    /// ```
    /// with the weights $`w_{ij}`$ of the gradient itself. A central difference is $`u' + \frac{h^2}{6}u'''`$ and the correction
    /// $`-\frac{1}{6}`$ of the second difference of the gradient, as one iteration of the compact scheme
    /// $`g_{i-1} + 4 g_i + g_{i+1} = 3(u_{i+1} - u_{i-1})/h`$ gives it (Lele 1992). Zero for linear fields on any grid, and in cells
    /// whose flux stays upwind, cells of four or five faces, and needles, whose gradients are not central differences.
    ///
    /// `gradient`: with ghosts where `border`, and after [`LeastSquares::add_images`]; `share`: share of the correction in a cell;
    /// `border`: whether the cells are those with ghosts among their neighbours, or all others.
    pub fn compact_correction<const N: usize>(
        &self,
        on: (&Topology, &Metrics),
        gradient: &[Gradient<N>],
        change: &mut [Gradient<N>],
        share: impl Fn(usize) -> f64,
        border: bool,
    ) {
        let ((topology, metrics), a) = (on, on.0.stencil());
        let row = |i: usize| a.start[i] as usize..a.start[i + 1] as usize;
        let corrected = |i: usize| {
            (a.start[i + 1] > a.ghost[i]) == border && !topology.upwind[i] && row(i).len() <= FACES as usize
        };
        for i in (0..change.len()).filter(|&i| corrected(i)) {
            let (x, gi, third) = (metrics.centre(i), &gradient[i], COMPACT * share(i));
            let change = &mut change[i];
            *change = [[0.0; N]; 3];
            for (&j, w) in a.cell[row(i)].iter().zip(&self.weight[row(i)]) {
                let (d, gj) = (metrics.centre(j as usize) - x, &gradient[j as usize]);
                for v in 0..N {
                    let second = third * (along(gj, v, &d) - along(gi, v, &d));
                    (0..3).for_each(|e| change[e][v] -= f64::from(w[e]) * second);
                }
            }
        }
        for image in self.images.iter().filter(|image| corrected(image.cell as usize)) {
            let i = image.cell as usize;
            image.add_correction(&gradient[i], COMPACT * share(i), &mut change[i]);
        }
        for &(i, _) in &self.shortened {
            change[i as usize] = [[0.0; N]; 3];
        }
    }

    /// Gradient of the scalar `x` (with ghosts) in owned cell `i`.
    #[inline]
    pub fn scalar(&self, topology: &Topology, i: usize, x: &[f32]) -> Vec3 {
        let a = topology.stencil();
        let row = a.start[i] as usize..a.start[i + 1] as usize;
        let mut sum = Vec3::zeros();
        for (&j, w) in a.cell[row.clone()].iter().zip(&self.weight[row]) {
            let d = f64::from(x[j as usize] - x[i]);
            for (s, &w) in sum.iter_mut().zip(w) {
                *s += f64::from(w) * d;
            }
        }
        sum
    }
}

/// Whether the rows of the cells from `i` on, [`LANES`] of them, are of one length.
fn have_equal_rows(a: &Adjacency, i: usize) -> bool {
    let ends = &a.start[i..=i + LANES];
    ends.windows(2).all(|row| row[1] - row[0] == ends[1] - ends[0])
}

/// Weights of the neighbours of cell `i` and of its mirror images.
fn weigh_cell(a: &Adjacency, metrics: &Metrics, i: usize, images: &mut [Image], weights: &mut [[f32; 3]]) {
    let row = a.start[i] as usize..a.start[i + 1] as usize;
    let x = metrics.centre(i);
    let mut m = [0.0; 6];
    for &j in &a.cell[row.clone()] {
        add_distance(&mut m, metrics.centre(j as usize) - x);
    }
    images.iter().for_each(|image| add_distance(&mut m, image.way));
    let inverse = inverse(m);
    for (w, &j) in weights[row.clone()].iter_mut().zip(&a.cell[row]) {
        *w = weight(&inverse, metrics.centre(j as usize) - x).map(|w| w as f32);
    }
    for image in images {
        image.weight = weight(&inverse, image.way).into();
    }
}

/// [`weigh_cell`] for the cells from `i` on, [`LANES`] of them, whose rows are of one length.
fn weigh_cells(a: &Adjacency, metrics: &Metrics, i: usize, weights: &mut [[f32; 3]]) {
    let starts = [0, 1, 2, 3].map(|l| a.start[i + l] as usize);
    let neighbours = (a.start[i + 1] - a.start[i]) as usize;
    let centre = |at: &[usize; LANES]| -> Vector3<Lanes> { rows(&metrics.centre, at).into() };
    let x = centre(&[i, i + 1, i + 2, i + 3]);
    let distance = |k: usize| centre(&starts.map(|start| a.cell[start + k] as usize)) - x;
    let mut m = [lanes(|_| 0.0); 6];
    (0..neighbours).for_each(|k| add_distance(&mut m, distance(k)));
    let inverse = inverses(m);
    for k in 0..neighbours {
        let [x, y, z] = weight(&inverse, distance(k)).map(Lanes::into_arr);
        for (l, start) in starts.iter().enumerate() {
            weights[start + k] = [x[l] as f32, y[l] as f32, z[l] as f32];
        }
    }
}

/// Adds the distance `d` of a neighbour to the matrix (xx, yy, zz, xy, xz, yz) of a cell.
#[inline(always)]
fn add_distance<T: Real>(m: &mut [T; 6], d: Vector3<T>) {
    let w = T::splat(1.0) / d.dot(&d);
    for (m, (p, q)) in m.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
        *m += w * d[p] * d[q];
    }
}

/// Weight of a neighbour at the distance `d`, with the inverse of the matrix of the cell.
#[inline(always)]
fn weight<T: Real>(inverse: &[T; 6], d: Vector3<T>) -> [T; 3] {
    let w = d * (T::splat(1.0) / d.dot(&d));
    [
        inverse[0] * w[0] + inverse[3] * w[1] + inverse[4] * w[2],
        inverse[3] * w[0] + inverse[1] * w[1] + inverse[5] * w[2],
        inverse[4] * w[0] + inverse[5] * w[1] + inverse[2] * w[2],
    ]
}

/// Cofactors and determinant of a symmetric matrix (xx, yy, zz, xy, xz, yz), and whether it is regular: eigenvalues below about 1e-3 of the largest count as
/// absent.
#[inline(always)]
fn cofactors<T: Real>(m: [T; 6]) -> ([T; 6], T, T::SimdBool) {
    let [a, b, c, d, e, f] = m;
    let cof = [b * c - f * f, a * c - e * e, a * b - d * d, e * f - c * d, d * f - b * e, d * e - a * f];
    let det = a * cof[0] + d * cof[3] + e * cof[4];
    let trace = a + b + c;
    (cof, det, det.simd_gt(T::splat(1e-6) * trace * trace * trace))
}

/// [`inverse`] of each lane.
#[inline(always)]
fn inverses(m: [Lanes; 6]) -> [Lanes; 6] {
    let (cof, det, regular) = cofactors(m);
    if regular.all() { cof.map(|x| x / det) } else { lane_by_lane(m, inverse) }
}

/// Inverse of a symmetric matrix (xx, yy, zz, xy, xz, yz); where neighbours do
/// not span a direction, the pseudo-inverse: no gradient along it.
fn inverse(m: [f64; 6]) -> [f64; 6] {
    let (cof, det, regular) = cofactors(m);
    if regular {
        return cof.map(|x| x / det);
    }
    let [a, b, c, d, e, f] = m;
    let trace = a + b + c;
    let eigen = Mat3::new(a, d, e, d, b, f, e, f, c).symmetric_eigen();
    let mut out = [0.0; 6];
    for k in 0..3 {
        let l = eigen.eigenvalues[k];
        if l > 1e-6 * trace {
            let v: Vec3 = eigen.eigenvectors.column(k).into();
            for (o, (p, q)) in out.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
                *o += v[p] * v[q] / l;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full(m: [f64; 6]) -> Mat3 {
        let [a, b, c, d, e, f] = m;
        Mat3::new(a, d, e, d, b, f, e, f, c)
    }

    /// Cells in lanes have the weights of single ones, also where the neighbours of one of them lie in a plane.
    #[test]
    fn lanes_have_the_weights_of_single_cells() {
        let (cells, others) = (LANES as u32, 12);
        for flat in [None, Some(2)] {
            let mut metrics = Metrics::default();
            metrics.centre = (0..cells + others)
                .map(|i| [1.7, 2.9, 4.3].map(|k| (k * (f64::from(i) + 1.0) * f64::from(i)).sin()))
                .collect();
            // The neighbours of a cell are those of others with the same remainder.
            let cell = (0..cells).flat_map(|i| (0..6).map(move |k| cells + (i + 2 * k) % others)).collect();
            let a = Adjacency { start: (0..=cells).map(|i| 6 * i).collect(), cell, ..Adjacency::default() };
            if let Some(flat) = flat {
                let row = a.start[flat] as usize..a.start[flat + 1] as usize;
                let height = metrics.centre[flat][2];
                a.cell[row].iter().for_each(|&j| metrics.centre[j as usize][2] = height);
            }
            let mut single = vec![[0.0; 3]; a.cell.len()];
            let mut in_lanes = single.clone();
            assert!(have_equal_rows(&a, 0));
            (0..LANES).for_each(|i| weigh_cell(&a, &metrics, i, &mut [], &mut single));
            weigh_cells(&a, &metrics, 0, &mut in_lanes);
            assert_eq!(single, in_lanes);
            assert!(single.iter().flatten().all(|w| w.is_finite()));
        }
    }

    /// Any regular matrix, and pseudo-inverses of matrices of lower rank: `A X A = A`, `X A X = X`, both products
    /// symmetric (Moore and Penrose).
    #[test]
    fn inverse_and_pseudo_inverse_are_exact() {
        let regular = [2.0, 3.0, 1.5, 0.7, -0.4, 0.9];
        assert!((full(regular) * full(inverse(regular)) - Mat3::identity()).norm() < 1e-14);
        // Differences in a plane, and along a line.
        let of = |vectors: &[[f64; 3]]| {
            let mut m = [0.0; 6];
            for v in vectors {
                for (m, (p, q)) in m.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
                    *m += v[p] * v[q];
                }
            }
            m
        };
        let (u, v) = ([1.0, 0.5, -0.3], [0.2, -0.8, 0.6]);
        for m in [of(&[u, v]), of(&[u])] {
            let (a, x) = (full(m), full(inverse(m)));
            assert!((a * x * a - a).norm() < 1e-12 && (x * a * x - x).norm() < 1e-12);
            assert!((a * x - (a * x).transpose()).norm() < 1e-12);
        }
    }
}
