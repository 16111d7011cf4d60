//! Mass matrices: consistent, or lumped on request.

/// Distribution of an element's mass over its nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum MassMatrix {
    /// From the shape functions (paper, section 1.1).
    #[default]
    Consistent,
    /// Row sums on the diagonal.
    Lumped,
}

/// Shares $`m_{NM}/m`$ of a linear simplex with `N` nodes (2: cable, 3: membrane).
///
/// Consistent: $`(1+\delta_{NM}) / (N (N+1))`$, that is 2/6 and 1/6 for a cable,
/// 2/12 and 1/12 for a triangle.
pub fn shares<const N: usize>(kind: MassMatrix) -> [[f64; N]; N] {
    let n = N as f64;
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match (kind, i == j) {
            (MassMatrix::Consistent, true) => 2.0 / (n * (n + 1.0)),
            (MassMatrix::Consistent, false) => 1.0 / (n * (n + 1.0)),
            (MassMatrix::Lumped, true) => 1.0 / n,
            (MassMatrix::Lumped, false) => 0.0,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kinetic energy of the linear field v = x on [0, 1]: integral of x^2 / 2 = 1/6.
    #[test]
    fn consistent_mass_integrates_a_linear_field_exactly() {
        let m = shares::<2>(MassMatrix::Consistent);
        assert!((0.5 * m[1][1] - 1.0 / 6.0).abs() < 1e-15);
        // v = x on the unit right triangle: integral x^2 / area = 1/6.
        let m = shares::<3>(MassMatrix::Consistent);
        assert!((m[1][1] - 1.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn both_kinds_keep_the_total() {
        for kind in [MassMatrix::Consistent, MassMatrix::Lumped] {
            assert!((shares::<2>(kind).iter().flatten().sum::<f64>() - 1.0).abs() < 1e-15);
            assert!((shares::<3>(kind).iter().flatten().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }
}
