//! The 3-node membrane: total Lagrangian, constant strain (paper, equations 2 and 3).
//!
//! The reference triangle is laid into a plane frame of its own. There the
//! shape functions have constant gradients $`H_{N,\alpha}`$, the columns of the
//! deformation gradient are $`f_\alpha = \sum_N x_N H_{N,\alpha}`$, and the Green
//! strain is $`E_{\alpha\beta} = \tfrac12 (f_\alpha\cdot f_\beta - \delta_{\alpha\beta})`$.
//! Strains and stresses are in Voigt order: 11, 22, 12 with $`\gamma = 2E_{12}`$.

use super::{Kernel, Load, Sheet, Step, load};
use crate::materials::StepLaw;
use mesh::geometry::{Mat3, Vec3};
use mesh::lanes::{LANES, Lanes, Real, lanes};
use nalgebra::Vector3;

/// What a membrane element keeps of its reference state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Gradients of the shape functions of nodes 1 and 2, 1/m, as
    /// `[H1,1, H1,2, H2,1, H2,2]`; node 0 has minus their sum.
    pub gradient: [f64; 4],
    /// Area, m2.
    pub area: f64,
}

impl Reference {
    /// Of an unstressed triangle (m). `None` if its area vanishes relative to the square of its
    /// longest edge, so that no gradient exists.
    pub fn new(x: [Vec3; 3]) -> Option<Self> {
        let (a, b) = (x[1] - x[0], x[2] - x[0]);
        let normal = a.cross(&b);
        let twice_area = normal.norm();
        let longest = a.dot(&a).max(b.dot(&b)).max((b - a).dot(&(b - a)));
        // Rounding of the coordinates alone spoils flatter triangles.
        if twice_area.is_nan() || twice_area <= 1e-10 * longest {
            return None;
        }
        let length = a.norm();
        let e1 = a * (1.0 / length);
        let e2 = (normal * (1.0 / twice_area)).cross(&e1);
        // Plane coordinates: node 1 (length, 0), node 2 (p, q).
        let (p, q) = (b.dot(&e1), b.dot(&e2));
        let gradient = [1.0 / length, -p / (length * q), 0.0, 1.0 / q];
        Some(Self { gradient, area: 0.5 * twice_area })
    }
}

impl Reference {
    /// As [`Reference::new`], with the first axis of the strains along `direction` laid
    /// onto the triangle. `None` also where `direction` stands on it.
    pub fn along(x: [Vec3; 3], direction: Vec3) -> Option<Self> {
        let Self { area, .. } = Self::new(x)?;
        let (a, b) = (x[1] - x[0], x[2] - x[0]);
        let normal = a.cross(&b) * (0.5 / area);
        let along = direction - normal * direction.dot(&normal);
        let length = along.norm();
        if length.is_nan() || length <= 1e-6 * direction.norm() {
            return None;
        }
        let e1 = along * (1.0 / length);
        let e2 = normal.cross(&e1);
        let (a, b) = ([a.dot(&e1), a.dot(&e2)], [b.dot(&e1), b.dot(&e2)]);
        let inverse = 0.5 / area;
        let gradient = [inverse * b[1], -inverse * b[0], -inverse * a[1], inverse * a[0]];
        Some(Self { gradient, area })
    }
}

/// Deformed tangent vectors and the Green strain.
#[derive(Clone, Copy, Debug)]
pub struct Deformation<T = f64> {
    /// Columns of the 3x2 deformation gradient.
    pub f: [Vector3<T>; 2],
    /// Green strain E11, E22, 2 E12.
    pub strain: [T; 3],
}

/// Deformation of the triangle with nodes now at `x` (m).
#[inline(always)]
pub fn deformation<T: Real>(h: &[T; 4], x: &[Vector3<T>; 3]) -> Deformation<T> {
    let (a, b) = (x[1] - x[0], x[2] - x[0]);
    let f1 = a * h[0] + b * h[2];
    let f2 = a * h[1] + b * h[3];
    let [half, one] = [0.5, 1.0].map(T::splat);
    Deformation { f: [f1, f2], strain: [half * (f1.dot(&f1) - one), half * (f2.dot(&f2) - one), f1.dot(&f2)] }
}

/// Internal nodal forces (N) for second Piola-Kirchhoff stress `s` (Pa) and
/// `volume`, the reference area times the thickness (m3).
#[inline(always)]
pub fn force<T: Real>(h: &[T; 4], d: &Deformation<T>, s: &[T; 3], volume: T) -> [Vector3<T>; 3] {
    let one = |h1: T, h2: T| {
        let c1 = volume * (s[0] * h1 + s[2] * h2);
        let c2 = volume * (s[2] * h1 + s[1] * h2);
        d.f[0] * c1 + d.f[1] * c2
    };
    let (r1, r2) = (one(h[0], h[1]), one(h[2], h[3]));
    [-(r1 + r2), r1, r2]
}

/// Tangent of [`force`], blocks `[row node][column node]` (N/m), with the
/// material tangent `c` (Pa, Voigt). Symmetric for symmetric `c`.
///
/// Paper, equation 3: $`K_{NM} = V\,(H_N\cdot S H_M\, I + \sum_{ab} D_{ab}\, f_a f_b^T)`$
/// with $`D_{ab} = \sum_{\alpha\beta} H_{N\alpha} C_{a\alpha b\beta} H_{M\beta}`$. The
/// rows and columns of node 0 follow from rigid translation.
#[inline(always)]
pub fn stiffness(
    h: &[f64; 4],
    d: &Deformation,
    s: &[f64; 3],
    c: &[[f64; 3]; 3],
    volume: f64,
) -> [[Mat3; 3]; 3] {
    blocks::<false>(h, &d.f, &d.f, s, c, volume)
}

/// As [`stiffness`] where the stress comes from strains of another configuration
/// than the one that turns it into forces (columns there, rows here), as in
/// energy-conserving time integration. Not symmetric.
#[inline(always)]
pub fn stiffness_between(
    h: &[f64; 4],
    forces: &Deformation,
    strains: &Deformation,
    s: &[f64; 3],
    c: &[[f64; 3]; 3],
    volume: f64,
) -> [[Mat3; 3]; 3] {
    blocks::<true>(h, &forces.f, &strains.f, s, c, volume)
}

/// Block of two nodes with gradients `n` and `m`.
#[inline(always)]
pub(crate) fn block(
    n: [f64; 2],
    m: [f64; 2],
    [f1, f2]: &[Vec3; 2],
    [g1, g2]: &[Vec3; 2],
    s: &[f64; 3],
    c: &[[f64; 3]; 3],
    volume: f64,
) -> Mat3 {
    let g = volume * (n[0] * (s[0] * m[0] + s[2] * m[1]) + n[1] * (s[2] * m[0] + s[1] * m[1]));
    // Voigt rows of (a, alpha): (1,1) -> 0, (2,2) -> 1, mixed -> 2.
    let mut r = [[0.0; 3]; 2];
    for k in 0..3 {
        r[0][k] = volume * (n[0] * c[0][k] + n[1] * c[2][k]);
        r[1][k] = volume * (n[0] * c[2][k] + n[1] * c[1][k]);
    }
    let d11 = r[0][0] * m[0] + r[0][2] * m[1];
    let d12 = r[0][2] * m[0] + r[0][1] * m[1];
    let d21 = r[1][0] * m[0] + r[1][2] * m[1];
    let d22 = r[1][2] * m[0] + r[1][1] * m[1];
    // f1 (d11 g1 + d12 g2)^T + f2 (d21 g1 + d22 g2)^T
    let u = *g1 * d11 + *g2 * d12;
    let v = *g1 * d21 + *g2 * d22;
    let mut k = *f1 * u.transpose() + *f2 * v.transpose();
    (0..3).for_each(|i| k[(i, i)] += g);
    k
}

#[inline(always)]
fn blocks<const BETWEEN: bool>(
    h: &[f64; 4],
    rows: &[Vec3; 2],
    cols: &[Vec3; 2],
    s: &[f64; 3],
    c: &[[f64; 3]; 3],
    volume: f64,
) -> [[Mat3; 3]; 3] {
    let (h1, h2) = ([h[0], h[1]], [h[2], h[3]]);
    let (k11, k12, k22) = (
        block(h1, h1, rows, cols, s, c, volume),
        block(h1, h2, rows, cols, s, c, volume),
        block(h2, h2, rows, cols, s, c, volume),
    );
    let k21 = if BETWEEN { block(h2, h1, rows, cols, s, c, volume) } else { k12.transpose() };
    [[k11 + k12 + k21 + k22, -(k11 + k21), -(k12 + k22)], [-(k11 + k12), k11, k12], [-(k21 + k22), k21, k22]]
}

/// Triangles of one law.
pub struct Triangle<L> {
    law: L,
    /// kg/m3.
    density: f64,
}

/// A triangle.
pub struct Element<T> {
    gradient: [f64; 4],
    /// Reference area times thickness, m3.
    volume: f64,
    start: T,
}

/// Triangles of a batch.
pub struct Batch {
    gradient: [Lanes; 4],
    /// m3.
    volume: Lanes,
}

impl<L: StepLaw> Triangle<L> {
    /// Density in kg/m3.
    pub fn new(law: L, density: f64) -> Self {
        Self { law, density }
    }

    /// An element of `thickness` (m); a step starts without strain.
    pub fn element(&self, reference: &Reference, thickness: f64) -> Element<L::Start> {
        Element {
            gradient: reference.gradient,
            volume: reference.area * thickness,
            start: self.law.start([0.0; 3]),
        }
    }
}

/// Internal less external forces: each node has the same share of the load.
#[inline(always)]
fn net<T: Real, L: StepLaw, const TRACTION: bool>(
    r: [Vector3<T>; 3],
    load: &Load<T>,
    x: &[Vector3<T>; 3],
) -> [Vector3<T>; 3] {
    if L::ADDS {
        return r;
    }
    let f = share::<T, TRACTION>(load, x);
    r.map(|r| r - f)
}

/// Load on each node, N.
#[inline(always)]
fn share<T: Real, const TRACTION: bool>(load: &Load<T>, x: &[Vector3<T>; 3]) -> Vector3<T> {
    let f = load::pressure_force(load.pressure, x);
    if TRACTION { f + load::traction_force(load.traction, x) } else { f }
}

impl<L: StepLaw> Kernel<3> for Triangle<L> {
    type Element = Element<L::Start>;
    type Batch = Batch;
    const RATE: bool = L::RATE;
    const VARIABLES: usize = L::VARIABLES;
    const LOADED: bool = !L::ADDS;

    fn anchor(&self, e: &mut Self::Element, x: &[Vec3; 3]) {
        self.law.anchor(&mut e.start, deformation(&e.gradient, x).strain);
    }

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<3>,
        load: &Load,
    ) -> [Vec3; 3] {
        let d = deformation(&e.gradient, &step.at);
        let end = if BLEND { deformation(&e.gradient, &step.end) } else { d };
        let s = self.law.stress::<BLEND>(&e.start, end.strain, step.weight);
        net::<f64, L, TRACTION>(force(&e.gradient, &d, &s, e.volume), load, &step.at)
    }

    fn batch(&self, e: [&Self::Element; LANES]) -> Option<Batch> {
        L::OF_STRAIN.then(|| Batch {
            gradient: [0, 1, 2, 3].map(|i| lanes(|l| e[l].gradient[i])),
            volume: lanes(|l| e[l].volume),
        })
    }

    #[inline(always)]
    fn forces<const TRACTION: bool>(
        &self,
        e: &Batch,
        x: &[Vector3<Lanes>; 3],
        load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; 3]> {
        let d = deformation(&e.gradient, x);
        let s = self.law.stresses(d.strain);
        Some(net::<Lanes, L, TRACTION>(force(&e.gradient, &d, &s, e.volume), load, x))
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<3>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; 3], [[Mat3; 3]; 3]) {
        let d = deformation(&e.gradient, &step.at);
        let end = if BLEND { deformation(&e.gradient, &step.end) } else { d };
        let (s, c) = self.law.tangent::<BLEND>(&e.start, end.strain, step.weight);
        let f = net::<f64, L, TRACTION>(force(&e.gradient, &d, &s, e.volume), load, &step.at);
        let mut k = if BLEND {
            stiffness_between(&e.gradient, &d, &end, &s, &c, e.volume * factor)
        } else {
            stiffness(&e.gradient, &d, &s, &c, e.volume * factor)
        };
        if L::ADDS {
            return (f, k);
        }
        let by_pressure = load::pressure_tangent(-factor * load.pressure, &step.at);
        let by_traction = if TRACTION {
            load::traction_tangent(load.traction * (-factor), &step.at)
        } else {
            [Mat3::zeros(); 3]
        };
        for row in &mut k {
            for m in 0..3 {
                row[m] += by_pressure[m];
                if TRACTION {
                    row[m] += by_traction[m];
                }
            }
        }
        (f, k)
    }

    #[inline(always)]
    fn external<const TRACTION: bool>(&self, _e: &Self::Element, x: &[Vec3; 3], load: &Load) -> [Vec3; 3] {
        [share::<f64, TRACTION>(load, x); 3]
    }

    #[inline(always)]
    fn externals<const TRACTION: bool>(
        &self,
        _batch: &Batch,
        x: &[Vector3<Lanes>; 3],
        load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; 3]> {
        Some([share::<Lanes, TRACTION>(load, x); 3])
    }

    fn energy(&self, e: &Self::Element, x: &[Vec3; 3]) -> f64 {
        e.volume * self.law.energy(&e.start, deformation(&e.gradient, x).strain)
    }

    fn dissipation(&self, e: &Self::Element, before: &[Vec3; 3], after: &[Vec3; 3]) -> f64 {
        let [from, to] = [before, after].map(|x| deformation(&e.gradient, x).strain);
        self.law.dissipation(&e.start, from, to, e.volume)
    }

    fn advance_history(&self, e: &mut Self::Element, x: &[Vec3; 3]) -> f64 {
        e.volume * self.law.advance_history(&mut e.start, deformation(&e.gradient, x).strain)
    }

    fn history(&self, e: &Self::Element, variables: &mut [f64]) {
        self.law.history(&e.start, variables);
    }

    fn set_history(&self, e: &mut Self::Element, variables: &[f64]) {
        self.law.set_history(&mut e.start, variables);
    }

    fn mass(&self, e: &Self::Element) -> Option<f64> {
        (!L::ADDS).then_some(self.density * e.volume)
    }

    fn sheet(&self, e: &Self::Element, x: &[Vec3; 3]) -> Option<Sheet> {
        self.law.sheet(&e.start, deformation(&e.gradient, x).strain)
    }

    fn tangents(&self, e: &Self::Element, x: &[Vec3; 3]) -> Option<[Vec3; 2]> {
        Some(deformation(&e.gradient, x).f)
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
    use crate::elements::check::{conforms, conforms_in_a_step};
    use crate::materials::{Elastic, Material, StVenantKirchhoff, TensionField, Viscous};

    const SHEET: [Vec3; 3] = [Vec3::new(0.1, -0.2, 0.3), Vec3::new(1.2, 0.1, 0.2), Vec3::new(0.3, 0.9, 0.6)];
    const THICKNESS: f64 = 0.02;

    fn deformed(map: impl Fn(Vec3) -> Vec3) -> [Vec3; 3] {
        SHEET.map(map)
    }

    fn check<M: Material + Copy>(material: M, x: [Vec3; 3]) {
        let r = Reference::new(SHEET).expect("a proper triangle");
        let kernel = Triangle::new(Elastic(material), 2.0);
        conforms(&kernel, || kernel.element(&r, THICKNESS), SHEET, x);
        let mut damping = Triangle::new(Viscous::new(material, 0.4), 2.0);
        damping.set_step(0.2);
        conforms_in_a_step(&damping, || damping.element(&r, THICKNESS), SHEET, x);
    }

    #[test]
    fn sheets_conform() {
        for m in
            [StVenantKirchhoff::isotropic(10.0, 0.3), StVenantKirchhoff::orthotropic(10.0, 4.0, 0.2, 3.0)]
        {
            check(
                m,
                deformed(|x| {
                    Vec3::new(1.2 * x[0] + 0.1 * x[1], 1.1 * x[1] - 0.2 * x[2], x[2] + 0.3 * x[0] * x[1])
                }),
            );
            check(m, deformed(|x| Vec3::new(0.8 * x[0], 0.9 * x[1], 1.1 * x[2])));
        }
    }

    #[test]
    fn sheets_conform_in_each_state_of_the_tension_field() {
        use crate::materials::Regime::{Slack, Taut, Wrinkled};
        let m = TensionField::new(10.0, 0.3);
        let r = Reference::new(SHEET).expect("a proper triangle");
        // Stretch the edge direction of the element's own frame, so that the
        // state is known; then add a skew part to exercise the rotation.
        let e1 = (SHEET[1] - SHEET[0]) * (1.0 / (SHEET[1] - SHEET[0]).norm());
        let stretch = |s1: f64, s2: f64| {
            deformed(|x| {
                let y = x - SHEET[0];
                let along = y.dot(&e1);
                let across = y - (e1 * along);
                e1 * (s1 * along + 0.05 * across[0]) + (across * s2)
            })
        };
        for (x, regime) in
            [(stretch(1.2, 1.1), Taut), (stretch(1.2, 0.7), Wrinkled), (stretch(0.7, 0.8), Slack)]
        {
            let d = deformation(&r.gradient, &x);
            assert_eq!(m.regime(d.strain), regime);
            if regime != Slack {
                check(m, x);
            } else {
                assert_eq!(m.tangent(d.strain), ([0.0; 3], [[0.0; 3]; 3]));
            }
        }
    }

    #[test]
    fn homogeneous_stretch_gives_its_strain() {
        let r = Reference::new([Vec3::zeros(), Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.5, 1.5, 0.0)])
            .expect("a proper triangle");
        let x = [[0.0; 3], [2.4, 0.0, 0.0], [0.6, 1.35, 0.0]].map(Vec3::from);
        let d = deformation(&r.gradient, &x);
        let exact = [0.5 * (1.44 - 1.0), 0.5 * (0.81 - 1.0), 0.0];
        assert!(d.strain.iter().zip(exact).all(|(e, x)| (e - x).abs() < 1e-14));
        assert!((r.area - 1.5).abs() < 1e-15);
    }

    #[test]
    fn collinear_nodes_have_no_reference() {
        assert_eq!(Reference::new([Vec3::zeros(), Vec3::new(1.0, 1.0, 1.0), Vec3::new(2.0, 2.0, 2.0)]), None);
        assert_eq!(Reference::new([Vec3::repeat(1.0); 3]), None);
        assert_eq!(Reference::new([Vec3::repeat(f64::NAN); 3]), None);
    }
}
