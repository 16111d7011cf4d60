//! What every material must show: one suite for all of them.

use super::{Material, Strain};

/// Strain with principal values `e1`, `e2`, the first turned by `angle`.
pub(crate) fn turned(e1: f64, e2: f64, angle: f64) -> Strain {
    let (c, s) = (angle.cos(), angle.sin());
    [e1 * c * c + e2 * s * s, e1 * s * s + e2 * c * c, 2.0 * (e1 - e2) * c * s]
}

/// Holds `material` to what is asked of any law at strain `e`, away from the borders of its regimes:
/// the stress is the gradient of the energy, the moduli are symmetric and its derivative, the stress returned with the
/// moduli equals the stress alone; without strain there is neither stress nor energy. Moduli are of the order of one.
pub(crate) fn conforms(material: &impl Material, e: Strain) {
    let energy = |e: Strain| material.energy(&material.stress(e), &e);
    let (s, c) = material.tangent(e);
    assert_eq!(s, material.stress(e), "stress returned with the moduli, at {e:?}");
    assert!(energy([0.0; 3]).abs() < 1e-15 && material.stress([0.0; 3]).iter().all(|s| s.abs() < 1e-15));
    assert!(energy(e) >= 0.0, "energy at {e:?}");
    let h = 1e-6;
    let moved = |j: usize, by: f64| {
        let mut e = e;
        e[j] += by;
        e
    };
    for j in 0..3 {
        let slope = (energy(moved(j, h)) - energy(moved(j, -h))) / (2.0 * h);
        assert!((slope - s[j]).abs() < 1e-7, "gradient of the energy at {e:?}, {j}: {slope} {s:?}");
        let (up, down) = (material.stress(moved(j, h)), material.stress(moved(j, -h)));
        for i in 0..3 {
            let slope = (up[i] - down[i]) / (2.0 * h);
            assert!((slope - c[i][j]).abs() < 1e-7, "moduli at {e:?}, {i} {j}: {slope} {}", c[i][j]);
            assert!((c[i][j] - c[j][i]).abs() < 1e-13, "symmetry at {e:?}");
        }
    }
}
