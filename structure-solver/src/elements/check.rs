//! What every kernel must show: one suite for all of them.

use super::mass::MassMatrix;
use super::{Kernel, Load, Step};
use mesh::geometry::{Mat3, Vec3};

/// Rigid motion: a turn by 1.1 about (1, 2, 2)/3, by Rodrigues' formula.
fn turn(x: Vec3) -> Vec3 {
    let k = Vec3::new(1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0);
    let (c, s) = (1.1f64.cos(), 1.1f64.sin());
    x * c + (k.cross(&x) * s + k * ((1.0 - c) * k.dot(&x)))
}

fn moved<const N: usize>(x: [Vec3; N]) -> [Vec3; N] {
    x.map(|x| turn(x) + Vec3::new(3.0, -7.0, 2.0))
}

/// Holds the elastic `kernel` to what mechanics asks of any element, unstressed at `rest`, where its nodes are at
/// `x`: a rigid motion makes no force and no energy and turns forces along; forces have no sum and
/// no moment, are the gradient of the energy, and have the stiffness as their derivative. Then to
/// [`conforms_in_a_step`], and a step makes no energy. Lengths are of the order of a metre.
pub(crate) fn conforms<K: Kernel<N>, const N: usize>(
    kernel: &K,
    element: impl Fn() -> K::Element,
    rest: [Vec3; N],
    x: [Vec3; N],
) {
    let e = &element();
    let (_, k) = kernel.tangent::<false, false>(e, &Step::only(x), &Load::ZERO, 1.0);
    let size = largest(&k);
    let small = |f: Vec3, share: f64, what: &str| assert!(f.norm() <= share * size, "{what}: {f:?}");
    let forces = |x: &[Vec3; N]| kernel.force::<false, false>(e, &Step::only(*x), &Load::ZERO);

    let tangent = tangent_error(x, forces, &k);
    assert!(tangent < 1e-7, "stiffness differs from finite differences by {tangent}");
    forces(&moved(rest)).into_iter().for_each(|f| small(f, 1e-13, "force of a rigid motion"));
    assert!(kernel.energy(e, &moved(rest)).abs() <= 1e-13 * size, "energy of a rigid motion");
    let force = forces(&x);
    for (f, turned) in force.iter().zip(forces(&moved(x))) {
        small(turned - turn(*f), 1e-12, "force that turns along");
    }
    small(force.into_iter().sum(), 1e-13, "sum of the forces");
    let moment = x.iter().zip(force).fold(Vec3::zeros(), |m, (x, f)| m + (*x).cross(&f));
    small(moment, 1e-13, "moment of the forces");
    let h = 5e-6;
    for n in 0..N {
        let slope: Vec3 = Vec3::from_fn(|i, _| {
            let at = |by: f64| {
                let mut x = x;
                x[n][i] += by;
                kernel.energy(e, &x)
            };
            (at(h) - at(-h)) / (2.0 * h)
        });
        small(slope - force[n], 1e-8, "gradient of the energy less the force");
    }
    conforms_in_a_step(kernel, &element, rest, x);
    for (x0, x1) in [(rest, x), (x, rest), (shaken(x, 0.2), x)] {
        let work = work(kernel, element(), x0, x1);
        let gain = kernel.energy(e, &x1) - kernel.energy(e, &x0);
        assert!(work - gain >= -1e-13 * size, "energy made in a step: {work} {gain}");
    }
}

/// Holds `kernel` to what is asked of any element in a step, which starts near the nodes' positions `x`: the
/// tangent is the derivative of the forces, load and all, whatever the weight; it is made with the same forces,
/// and is in proportion to the factor. What the load adds is [`Kernel::external`]. Where forces depend on
/// the rate of strains, a step takes energy by its work, and a rigid motion none. The mass is shared whole.
pub(crate) fn conforms_in_a_step<K: Kernel<N>, const N: usize>(
    kernel: &K,
    element: impl Fn() -> K::Element,
    rest: [Vec3; N],
    x: [Vec3; N],
) {
    let load = Load { pressure: 0.3, traction: Vec3::new(0.1, -0.2, 0.4) };
    let mut e = element();
    let x0 = shaken(x, 0.03);
    kernel.anchor(&mut e, &x0);
    for weight in [0.5, 0.6, 1.0] {
        let step = |end: &[Vec3; N]| {
            let at = std::array::from_fn(|n| x0[n] * (1.0 - weight) + (end[n] * weight));
            Step { at, end: *end, weight }
        };
        let force = |x: &[Vec3; N]| kernel.force::<true, true>(&e, &step(x), &load);
        let (f, k) = kernel.tangent::<true, true>(&e, &step(&x), &load, weight);
        assert_eq!(f, force(&x), "forces with the tangent and alone");
        let tangent = tangent_error(x, force, &k);
        assert!(tangent < 1e-7, "tangent in a step of weight {weight} differs by {tangent}");
        let (_, half) = kernel.tangent::<true, true>(&e, &step(&x), &load, 0.5 * weight);
        let same = |(a, b): (&Mat3, &Mat3)| (a * 2.0 - b).norm() < 1e-14 * largest(&k);
        assert!(
            half.iter().flatten().zip(k.iter().flatten()).all(same),
            "tangent in proportion to its factor"
        );
        let unloaded = kernel.force::<false, true>(&e, &step(&x), &Load::ZERO);
        let external = kernel
            .external::<true>(&e, &step(&x).at, &load)
            .map(|f| if K::LOADED { f } else { Vec3::zeros() });
        for (n, f) in external.into_iter().enumerate() {
            let more = unloaded[n] - force(&x)[n];
            assert!((more - f).norm() < 1e-14 * (1.0 + unloaded[n].norm()), "load {n}: {more:?} {f:?}");
        }
    }
    if K::RATE {
        let stored = kernel.energy(&e, &x) - kernel.energy(&e, &x0);
        let (taken, work) = (kernel.dissipation(&e, &x0, &x), work(kernel, element(), x0, x));
        assert!(
            taken > 0.0 && (work - stored - taken).abs() < 1e-13 * (1.0 + taken),
            "{work} {stored} {taken}"
        );
        kernel.anchor(&mut e, &x);
        assert!(kernel.dissipation(&e, &x, &moved(x)).abs() < 1e-13, "dissipation of a rigid motion");
    }
    if let Some(mass) = kernel.mass(&e) {
        let shares = |kind| kernel.mass_shares(&e, kind).iter().flatten().sum::<f64>();
        let [a, b] = [MassMatrix::Consistent, MassMatrix::Lumped].map(shares);
        assert!(mass >= 0.0 && (a / b - 1.0).abs() < 1e-14, "{mass} {a} {b}");
    }
    assert!(kernel.dissipation(&element(), &rest, &rest) == 0.0);
}

/// Work (J) of the forces in a step of weight 1/2 from `x0` to `x1`.
fn work<K: Kernel<N>, const N: usize>(kernel: &K, mut e: K::Element, x0: [Vec3; N], x1: [Vec3; N]) -> f64 {
    kernel.anchor(&mut e, &x0);
    let at = std::array::from_fn(|n| (x0[n] + x1[n]) * 0.5);
    let f = kernel.force::<false, true>(&e, &Step { at, end: x1, weight: 0.5 }, &Load::ZERO);
    (0..N).map(|n| f[n].dot(&(x1[n] - x0[n]))).sum()
}

/// `x`, each component moved by up to `size`.
fn shaken<const N: usize>(x: [Vec3; N], size: f64) -> [Vec3; N] {
    std::array::from_fn(|n| Vec3::from_fn(|i, _| x[n][i] + size * ((3 * n + i) as f64 * 2.1 + 0.4).sin()))
}

fn largest<const N: usize>(stiffness: &[[Mat3; N]; N]) -> f64 {
    stiffness.iter().flatten().flatten().fold(0.0f64, |m, v| m.max(v.abs()))
}

/// Largest difference between `stiffness` and central differences of `force`,
/// relative to the largest entry of `stiffness`.
pub(crate) fn tangent_error<const N: usize>(
    x: [Vec3; N],
    force: impl Fn(&[Vec3; N]) -> [Vec3; N],
    stiffness: &[[Mat3; N]; N],
) -> f64 {
    // Truncation falls with h^2, cancellation grows with eps/h: h near eps^(1/3).
    let h = 5e-6;
    let mut worst = 0.0f64;
    for m in 0..N {
        for j in 0..3 {
            let (mut up, mut down) = (x, x);
            up[m][j] += h;
            down[m][j] -= h;
            let (fu, fd) = (force(&up), force(&down));
            for n in 0..N {
                for i in 0..3 {
                    let difference = (fu[n][i] - fd[n][i]) / (2.0 * h);
                    worst = worst.max((difference - stiffness[n][m][(i, j)]).abs());
                }
            }
        }
    }
    worst / largest(stiffness)
}
