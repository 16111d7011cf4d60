//! The 4-node membrane: bilinear, 2x2 points of quadrature, total Lagrangian.
//!
//! At each point the reference element has a tangent plane of its own, with
//! gradients $`H_{N,\alpha}`$ of the four shape functions; there everything is as in
//! the triangle ([`super::membrane`]). The element passes the patch test in any
//! shape, and two nodes in one place make it the triangle of the other three.

use super::load::skew;
use super::mass::MassMatrix;
use super::membrane::{Deformation, block};
use super::{Kernel, Load, Sheet, Step};
use crate::materials::{StepLaw, Strain};
use mesh::geometry::{Mat3, Vec3};

/// Points of quadrature.
pub const POINTS: usize = 4;
/// Gradients of the four shape functions at a point, 1/m.
pub type Gradient = [[f64; 2]; 4];

/// Corners in the order of the nodes; the points lie at these over sqrt 3.
const CORNERS: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];

/// Coordinates of point `k`.
#[inline(always)]
fn point(k: usize) -> [f64; 2] {
    const AT: f64 = 0.577_350_269_189_625_8;
    [AT * CORNERS[k][0], AT * CORNERS[k][1]]
}

/// Shape functions at point `k`.
#[inline(always)]
fn shapes(k: usize) -> [f64; 4] {
    let [a, b] = point(k);
    CORNERS.map(|[c, d]| 0.25 * (1.0 + a * c) * (1.0 + b * d))
}

/// Their derivatives by the two coordinates at point `k`.
#[inline(always)]
fn slopes(k: usize) -> [[f64; 2]; 4] {
    let [a, b] = point(k);
    CORNERS.map(|[c, d]| [0.25 * c * (1.0 + b * d), 0.25 * d * (1.0 + a * c)])
}

/// Tangent vectors of the surface at point `k`.
#[inline(always)]
fn tangents(x: &[Vec3; 4], k: usize) -> [Vec3; 2] {
    let mut t = [Vec3::zeros(); 2];
    for (s, x) in slopes(k).iter().zip(x) {
        t[0] += x * s[0];
        t[1] += x * s[1];
    }
    t
}

/// What a 4-node membrane keeps of its reference state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Gradients at the points.
    pub gradient: [Gradient; POINTS],
    /// Area of each point, m2.
    pub area: [f64; POINTS],
}

impl Reference {
    /// Of an unstressed quadrilateral (m), its nodes in turn. The first axis of the
    /// strains is `direction` laid onto the surface, or the first coordinate line.
    /// `None` where a point has no tangent plane (collapsed, or folded over itself),
    /// or where `direction` stands on the surface.
    pub fn new(x: [Vec3; 4], direction: Option<Vec3>) -> Option<Self> {
        let diagonals = [x[2] - x[0], x[3] - x[1]];
        let middle = diagonals[0].cross(&diagonals[1]);
        let size = (0..4).map(|i| x[(i + 1) % 4] - x[i]).map(|e| e.dot(&e)).fold(0.0, f64::max);
        let mut reference = Self { gradient: [[[0.0; 2]; 4]; POINTS], area: [0.0; POINTS] };
        for k in 0..POINTS {
            let [g1, g2] = tangents(&x, k);
            let normal = g1.cross(&g2);
            let area = normal.norm();
            // Rounding of the coordinates alone spoils flatter elements; a point
            // whose normal looks back lies in a fold.
            if area.is_nan() || area <= 1e-10 * size || normal.dot(&middle) <= 0.0 {
                return None;
            }
            let normal = normal * (1.0 / area);
            let along = direction.unwrap_or(g1);
            let along = along - normal * along.dot(&normal);
            let length = along.norm();
            if direction.is_some_and(|d| length <= 1e-6 * d.norm()) {
                return None;
            }
            let e1 = along * (1.0 / length);
            let e2 = normal.cross(&e1);
            // Inverse of the 2x2 Jacobian [[g1.e1, g1.e2], [g2.e1, g2.e2]].
            let (a, b, c, d) = (g1.dot(&e1), g1.dot(&e2), g2.dot(&e1), g2.dot(&e2));
            let inverse = 1.0 / (a * d - b * c);
            reference.gradient[k] =
                slopes(k).map(|[s, t]| [inverse * (d * s - b * t), inverse * (a * t - c * s)]);
            reference.area[k] = area;
        }
        Some(reference)
    }

    /// Mass matrix over density times thickness (m2).
    pub fn shares(&self, kind: MassMatrix) -> [[f64; 4]; 4] {
        let mut m = [[0.0; 4]; 4];
        for k in 0..POINTS {
            let n = shapes(k);
            for i in 0..4 {
                for j in 0..4 {
                    match kind {
                        MassMatrix::Consistent => m[i][j] += self.area[k] * n[i] * n[j],
                        MassMatrix::Lumped if i == j => m[i][i] += self.area[k] * n[i],
                        MassMatrix::Lumped => {}
                    }
                }
            }
        }
        m
    }
}

/// Deformation at a point with gradients `h` of the element with nodes now at `x` (m).
#[inline(always)]
pub fn deformation(h: &Gradient, x: &[Vec3; 4]) -> Deformation {
    let mut f = [Vec3::zeros(); 2];
    for (h, x) in h.iter().zip(x) {
        f[0] += x * h[0];
        f[1] += x * h[1];
    }
    let [f1, f2] = f;
    Deformation { f, strain: [0.5 * (f1.dot(&f1) - 1.0), 0.5 * (f2.dot(&f2) - 1.0), f1.dot(&f2)] }
}

/// Adds the internal nodal forces (N) of one point to `r`, for second
/// Piola-Kirchhoff stress `s` (Pa) and the point's `volume` (m3).
#[inline(always)]
pub fn add_force(h: &Gradient, d: &Deformation, s: &[f64; 3], volume: f64, r: &mut [Vec3; 4]) {
    for (h, r) in h.iter().zip(r) {
        let c1 = volume * (s[0] * h[0] + s[2] * h[1]);
        let c2 = volume * (s[2] * h[0] + s[1] * h[1]);
        *r += d.f[0] * c1 + d.f[1] * c2;
    }
}

/// Adds the tangent of [`add_force`] (N/m) to `k`, blocks `[row node][column node]`,
/// for the material tangent `c` (Pa). `forces` turns stresses into forces, `strains`
/// makes them; both are the same but in energy-conserving steps.
#[inline(always)]
pub fn add_stiffness(
    h: &Gradient,
    forces: &Deformation,
    strains: &Deformation,
    s: &[f64; 3],
    c: &[[f64; 3]; 3],
    volume: f64,
    k: &mut [[Mat3; 4]; 4],
) {
    for n in 0..4 {
        for m in 0..4 {
            k[n][m] += block(h[n], h[m], &forces.f, &strains.f, s, c, volume);
        }
    }
}

/// Nodal forces (N) of a pressure jump `p` (Pa) along the normal: exact, as the
/// integrand is of degree two in each coordinate.
#[inline(always)]
pub fn pressure_force(p: f64, x: &[Vec3; 4]) -> [Vec3; 4] {
    let mut f = [Vec3::zeros(); 4];
    for k in 0..POINTS {
        let [g1, g2] = tangents(x, k);
        let a = g1.cross(&g2) * p;
        for (f, n) in f.iter_mut().zip(shapes(k)) {
            *f += a * n;
        }
    }
    f
}

/// Derivative of [`pressure_force`], blocks `[row node][column node]`.
#[inline(always)]
pub fn pressure_tangent(p: f64, x: &[Vec3; 4]) -> [[Mat3; 4]; 4] {
    let mut all = [[Mat3::zeros(); 4]; 4];
    for k in 0..POINTS {
        let [g1, g2] = tangents(x, k);
        let (n, s) = (shapes(k), slopes(k));
        for m in 0..4 {
            // d (g1 x g2) = s1 (d x g2) + s2 (g1 x d) = (s2 g1 - s1 g2) x d
            let v = g1 * s[m][1] - g2 * s[m][0];
            let turn = skew(v);
            for i in 0..4 {
                all[i][m] += turn * (p * n[i]);
            }
        }
    }
    all
}

/// Nodal forces (N) of the traction `t` (Pa) on the deformed area.
#[inline(always)]
pub fn traction_force(t: Vec3, x: &[Vec3; 4]) -> [Vec3; 4] {
    let mut share = [0.0; 4];
    for k in 0..POINTS {
        let [g1, g2] = tangents(x, k);
        let area = g1.cross(&g2).norm();
        for (f, n) in share.iter_mut().zip(shapes(k)) {
            *f += n * area;
        }
    }
    share.map(|s| t * s)
}

/// Derivative of [`traction_force`], blocks `[row node][column node]`.
#[inline(always)]
pub fn traction_tangent(t: Vec3, x: &[Vec3; 4]) -> [[Mat3; 4]; 4] {
    let mut all = [[Mat3::zeros(); 4]; 4];
    for k in 0..POINTS {
        let [g1, g2] = tangents(x, k);
        let a = g1.cross(&g2);
        let size = a.norm();
        let normal = if size > 0.0 { a * (1.0 / size) } else { Vec3::zeros() };
        let (n, s) = (shapes(k), slopes(k));
        for m in 0..4 {
            // n . ((s2 g1 - s1 g2) x d) = d . (n x (s2 g1 - s1 g2))
            let v = g1 * s[m][1] - g2 * s[m][0];
            let g = normal.cross(&v);
            for i in 0..4 {
                all[i][m] += t * n[i] * g.transpose();
            }
        }
    }
    all
}

/// Bilinear elements of one law.
pub struct Quad<L> {
    law: L,
    /// m.
    thickness: f64,
    /// kg/m3.
    density: f64,
}

/// A bilinear element.
pub struct Element<T> {
    reference: Reference,
    start: [T; POINTS],
}

impl<T> Element<T> {
    #[inline(always)]
    fn strains(&self, x: &[Vec3; 4]) -> [Strain; POINTS] {
        self.reference.gradient.map(|h| deformation(&h, x).strain)
    }
}

impl<L: StepLaw> Quad<L> {
    /// Thickness in m, density in kg/m3.
    pub fn new(law: L, thickness: f64, density: f64) -> Self {
        Self { law, thickness, density }
    }

    /// An element; a step starts without strain.
    pub fn element(&self, reference: Reference) -> Element<L::Start> {
        Element { reference, start: [self.law.start([0.0; 3]); POINTS] }
    }

    /// Reference area times thickness of point `k`, m3.
    #[inline(always)]
    fn volume(&self, e: &Element<L::Start>, k: usize) -> f64 {
        e.reference.area[k] * self.thickness
    }

    /// Sum over the points of a value by point and volume.
    fn sum(&self, e: &Element<L::Start>, one: impl Fn(usize, f64) -> f64) -> f64 {
        (0..POINTS).map(|k| one(k, self.volume(e, k))).sum()
    }
}

impl<L: StepLaw> Kernel<4> for Quad<L> {
    type Element = Element<L::Start>;
    type Batch = ();
    const RATE: bool = L::RATE;
    const VARIABLES: usize = POINTS * L::VARIABLES;
    const LOADED: bool = !L::ADDS;

    fn anchor(&self, e: &mut Self::Element, x: &[Vec3; 4]) {
        let strains = e.strains(x);
        e.start.iter_mut().zip(strains).for_each(|(start, strain)| self.law.anchor(start, strain));
    }

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<4>,
        load: &Load,
    ) -> [Vec3; 4] {
        let mut r = [Vec3::zeros(); 4];
        for k in 0..POINTS {
            let h = &e.reference.gradient[k];
            let d = deformation(h, &step.at);
            let end = if BLEND { deformation(h, &step.end) } else { d };
            let s = self.law.stress::<BLEND>(&e.start[k], end.strain, step.weight);
            add_force(h, &d, &s, self.volume(e, k), &mut r);
        }
        let f = self.external::<TRACTION>(e, &step.at, load);
        std::array::from_fn(|n| r[n] - f[n])
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<4>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; 4], [[Mat3; 4]; 4]) {
        let mut r = [Vec3::zeros(); 4];
        let mut all = pressure_tangent(-factor * load.pressure, &step.at);
        if TRACTION {
            let t = traction_tangent(load.traction * (-factor), &step.at);
            for (row, t) in all.iter_mut().flatten().zip(t.iter().flatten()) {
                *row += t;
            }
        }
        for k in 0..POINTS {
            let h = &e.reference.gradient[k];
            let d = deformation(h, &step.at);
            let end = if BLEND { deformation(h, &step.end) } else { d };
            let (s, c) = self.law.tangent::<BLEND>(&e.start[k], end.strain, step.weight);
            add_force(h, &d, &s, self.volume(e, k), &mut r);
            add_stiffness(h, &d, &end, &s, &c, self.volume(e, k) * factor, &mut all);
        }
        let f = self.external::<TRACTION>(e, &step.at, load);
        (std::array::from_fn(|n| r[n] - f[n]), all)
    }

    #[inline(always)]
    fn external<const TRACTION: bool>(&self, _e: &Self::Element, x: &[Vec3; 4], load: &Load) -> [Vec3; 4] {
        let mut f = pressure_force(load.pressure, x);
        if TRACTION {
            let t = traction_force(load.traction, x);
            (0..4).for_each(|n| f[n] += t[n]);
        }
        f
    }

    fn energy(&self, e: &Self::Element, x: &[Vec3; 4]) -> f64 {
        let strains = e.strains(x);
        self.sum(e, |k, volume| volume * self.law.energy(&e.start[k], strains[k]))
    }

    fn dissipation(&self, e: &Self::Element, before: &[Vec3; 4], after: &[Vec3; 4]) -> f64 {
        let [from, to] = [before, after].map(|x| e.strains(x));
        self.sum(e, |k, volume| self.law.dissipation(&e.start[k], from[k], to[k], volume))
    }

    fn advance_history(&self, e: &mut Self::Element, x: &[Vec3; 4]) -> f64 {
        let strains = e.strains(x);
        let one = |k: usize| self.volume(e, k);
        let volumes: [f64; POINTS] = std::array::from_fn(one);
        let points = e.start.iter_mut().zip(strains).zip(volumes);
        points.map(|((start, strain), volume)| volume * self.law.advance_history(start, strain)).sum()
    }

    fn history(&self, e: &Self::Element, variables: &mut [f64]) {
        let rows = variables.chunks_exact_mut(L::VARIABLES.max(1));
        e.start.iter().zip(rows).for_each(|(start, row)| self.law.history(start, row));
    }

    fn set_history(&self, e: &mut Self::Element, variables: &[f64]) {
        let rows = variables.chunks_exact(L::VARIABLES.max(1));
        e.start.iter_mut().zip(rows).for_each(|(start, row)| self.law.set_history(start, row));
    }

    /// Per area (kg/m2): the shares are areas.
    fn mass(&self, _e: &Self::Element) -> Option<f64> {
        (!L::ADDS).then_some(self.density * self.thickness)
    }

    /// Areas, m2.
    fn mass_shares(&self, e: &Self::Element, kind: MassMatrix) -> [[f64; 4]; 4] {
        e.reference.shares(kind)
    }

    /// Of the mean strain of the points, with the mean of their internal variables.
    fn sheet(&self, e: &Self::Element, x: &[Vec3; 4]) -> Option<Sheet> {
        let strains = e.strains(x);
        let mean = std::array::from_fn(|i| 0.25 * strains.iter().map(|e| e[i]).sum::<f64>());
        self.law.sheet(&self.law.mean(&e.start), mean)
    }

    /// The mean of the points.
    fn tangents(&self, e: &Self::Element, x: &[Vec3; 4]) -> Option<[Vec3; 2]> {
        let all = e.reference.gradient.map(|h| deformation(&h, x).f);
        Some(std::array::from_fn(|i| all.iter().map(|f| f[i]).sum::<Vec3>() * 0.25))
    }

    fn set_step(&mut self, dt: f64) {
        self.law.set_step(dt);
    }

    fn retardation_time(&self) -> f64 {
        self.law.retardation_time()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::{conforms, conforms_in_a_step, tangent_error};
    use crate::elements::mass::shares;
    use crate::elements::{load, membrane};
    use crate::materials::{Elastic, KelvinVoigt, Material, StVenantKirchhoff, TensionField};

    /// Distorted and warped.
    const X: [Vec3; 4] = [
        Vec3::new(0.0, 0.1, 0.0),
        Vec3::new(1.2, -0.1, 0.1),
        Vec3::new(1.0, 0.9, 0.3),
        Vec3::new(-0.2, 1.3, 0.1),
    ];
    const NOW: [Vec3; 4] = [
        Vec3::new(0.1, 0.0, 0.2),
        Vec3::new(1.4, 0.1, -0.1),
        Vec3::new(1.1, 1.1, 0.5),
        Vec3::new(-0.3, 1.2, 0.3),
    ];

    fn force(r: &Reference, law: &impl Material, x: &[Vec3; 4]) -> [Vec3; 4] {
        let mut f = [Vec3::zeros(); 4];
        for k in 0..POINTS {
            let d = deformation(&r.gradient[k], x);
            add_force(&r.gradient[k], &d, &law.stress(d.strain), r.area[k], &mut f);
        }
        f
    }

    fn check<M: Material + Copy>(material: M, x: [Vec3; 4]) {
        let r = Reference::new(X, None).expect("a good element");
        let kernel = Quad::new(Elastic(material), 1.0, 2.0);
        conforms(&kernel, || kernel.element(r), X, x);
        let mut damped = Quad::new(KelvinVoigt::new(material, 0.4), 1.0, 2.0);
        damped.set_step(0.2);
        conforms_in_a_step(&damped, || damped.element(r), X, x);
    }

    #[test]
    fn sheets_conform() {
        check(StVenantKirchhoff::isotropic(3.0, 0.3), NOW);
        let law = TensionField::new(3.0, 0.3);
        let r = Reference::new(X, None).expect("a good element");
        let wrinkled = NOW.map(|x| Vec3::new(1.1 * x[0], 0.6 * x[1], x[2]));
        let regimes: Vec<_> =
            r.gradient.iter().map(|h| law.regime(deformation(h, &wrinkled).strain)).collect();
        assert!(regimes.contains(&crate::materials::Regime::Wrinkled), "{regimes:?}");
        check(law, wrinkled);
    }

    #[test]
    fn tangents_of_loads_are_the_derivatives_of_their_forces() {
        assert!(tangent_error(NOW, |x| pressure_force(2.0, x), &pressure_tangent(2.0, &NOW)) < 1e-8);
        let t = Vec3::new(0.4, -0.7, 1.1);
        assert!(tangent_error(NOW, |x| traction_force(t, x), &traction_tangent(t, &NOW)) < 1e-8);
    }

    /// Any affine map of a plane element is a constant strain, whatever its shape:
    /// the forces are those of the stress on its edges.
    #[test]
    fn a_distorted_element_passes_the_patch_test() {
        let flat = X.map(|x| Vec3::new(x[0], x[1], 0.0));
        let r = Reference::new(flat, Some(Vec3::new(1.0, 0.0, 0.0))).expect("a good element");
        let map =
            |x: Vec3| Vec3::new(1.2 * x[0] + 0.1 * x[1], 1.1 * x[1] - 0.05 * x[0], 0.3 * x[0] - 0.2 * x[1]);
        let now = flat.map(map);
        let law = StVenantKirchhoff::orthotropic(3.0, 1.0, 0.2, 0.7);
        let strain = deformation(&r.gradient[0], &now).strain;
        for h in &r.gradient {
            let e = deformation(h, &now).strain;
            (0..3).for_each(|i| assert!((e[i] - strain[i]).abs() < 1e-14));
        }
        let s = law.stress(strain);
        let columns = [[1.2, -0.05, 0.3], [0.1, 1.1, -0.2]];
        let f = force(&r, &law, &now);
        for n in 0..4 {
            // Half of the outward normals of both edges at the node, in the plane.
            let (a, b) = (flat[(n + 3) % 4], flat[(n + 1) % 4]);
            let normal = [0.5 * (b[1] - a[1]), -0.5 * (b[0] - a[0])];
            let t = [s[0] * normal[0] + s[2] * normal[1], s[2] * normal[0] + s[1] * normal[1]];
            for i in 0..3 {
                let exact = columns[0][i] * t[0] + columns[1][i] * t[1];
                assert!((f[n][i] - exact).abs() < 1e-13, "{n} {i}: {} {exact}", f[n][i]);
            }
        }
    }

    #[test]
    fn collapsed_nodes_make_a_triangle() {
        let (x, now) = ([X[0], X[1], X[2]], [NOW[0], NOW[1], NOW[2]]);
        let r = Reference::new([x[0], x[1], x[2], x[2]], None).expect("a triangle");
        let t = membrane::Reference::new(x).expect("a triangle");
        let law = StVenantKirchhoff::isotropic(3.0, 0.3);
        let q = force(&r, &law, &[now[0], now[1], now[2], now[2]]);
        let d = membrane::deformation(&t.gradient, &now);
        let f = membrane::force(&t.gradient, &d, &law.stress(d.strain), t.area);
        for i in 0..3 {
            assert!((q[0][i] - f[0][i]).abs() < 1e-14 && (q[1][i] - f[1][i]).abs() < 1e-14);
            assert!((q[2][i] + q[3][i] - f[2][i]).abs() < 1e-14);
        }
        let p = pressure_force(2.0, &[now[0], now[1], now[2], now[2]]);
        let exact = load::pressure_force(2.0, &now);
        (0..3).for_each(|i| assert!((p[0][i] - exact[i]).abs() < 1e-14));
        let m = r.shares(MassMatrix::Consistent);
        let exact = shares::<3>(MassMatrix::Consistent);
        assert!((m[0][1] - t.area * exact[0][1]).abs() < 1e-15);
        assert!((m[2][2] + m[3][3] + 2.0 * m[2][3] - t.area * exact[2][2]).abs() < 1e-15);
    }

    #[test]
    fn masses_keep_the_total_and_bad_shapes_are_refused() {
        let r = Reference::new(X, None).expect("a good element");
        let total: f64 = r.area.iter().sum();
        for kind in [MassMatrix::Consistent, MassMatrix::Lumped] {
            assert!((r.shares(kind).iter().flatten().sum::<f64>() - total).abs() < 1e-14);
        }
        // The total pressure force is that on half the cross product of the diagonals.
        let sum: Vec3 = pressure_force(2.0, &NOW).into_iter().sum();
        let exact = (NOW[2] - NOW[0]).cross(&(NOW[3] - NOW[1]));
        (0..3).for_each(|i| assert!((sum[i] - exact[i]).abs() < 1e-14));
        assert!(Reference::new([X[0], X[2], X[1], X[3]], None).is_none(), "folded");
        assert!(Reference::new([X[0], X[1], X[0], X[1]], None).is_none(), "no area");
        let flat = X.map(|x| Vec3::new(x[0], x[1], 0.0));
        assert!(Reference::new(flat, Some(Vec3::new(0.0, 0.0, 1.0))).is_none(), "no direction");
    }
}
