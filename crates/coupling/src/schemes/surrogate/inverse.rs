//! Inverse of a dense matrix for models that need few digits.

use faer::Mat;

/// Rows and columns of a tile: single precision numbers in a vector register.
const SIDE: usize = 8;
/// Numbers in a tile.
const TILE: usize = SIDE * SIDE;

/// Inverse of $`A = D^{-1/2} S D^{1/2}`$ with a symmetric $`S`$, in single precision. Of $`S^{-1}`$ it has the tiles up to the diagonal, in the order
/// in which a product reads them, once: half the bytes of the matrix, and a quarter of those of two triangular solves in double precision.
#[derive(Clone)]
pub struct Inverse {
    /// Rows of tiles from top to bottom, each from the first column to the diagonal; zero beyond the matrix.
    tiles: Vec<[f32; TILE]>,
    /// $`D^{1/2}`$, m.
    roots: Vec<f64>,
}

impl Inverse {
    /// `None` for a matrix that is not finite. `symmetric`: $`S^{-1}`$.
    pub(super) fn new(symmetric: &Mat<f32>, roots: &[f64]) -> Option<Self> {
        let n = symmetric.nrows();
        let side = n.div_ceil(SIDE);
        let mut tiles = Vec::with_capacity(side * (side + 1) / 2);
        for i in 0..side {
            for j in 0..=i {
                let mut tile = [0.0; TILE];
                // Row i is column i.
                for (row, of) in tile.as_chunks_mut::<SIDE>().0.iter_mut().zip(i * SIDE..n) {
                    let columns = j * SIDE..n.min((j + 1) * SIDE);
                    row.iter_mut().zip(columns).for_each(|(v, column)| *v = symmetric[(column, of)]);
                }
                tiles.push(tile);
            }
        }
        let finite = tiles.iter().flatten().all(|v| v.is_finite());
        finite.then(|| Self { tiles, roots: roots.to_vec() })
    }

    /// Largest sum of sizes in a row of $`S^{-1}`$, m: no eigenvalue of it is larger.
    pub(super) fn largest_row_sum(&self) -> f64 {
        let sizes: Vec<[f32; TILE]> = self.tiles.iter().map(|tile| tile.map(f32::abs)).collect();
        let ones = vec![[1.0; SIDE]; self.roots.len().div_ceil(SIDE)];
        packed_product(&sizes, &ones).as_flattened().iter().fold(0.0f64, |most, v| most.max(f64::from(*v)))
    }

    /// $`A^{-1} x`$, to about six digits of its largest number.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let scaled: Vec<f64> = x.iter().zip(&self.roots).map(|(x, root)| x * root).collect();
        let mut product = self.apply_symmetric(&scaled);
        product.iter_mut().zip(&self.roots).for_each(|(y, root)| *y /= root);
        product
    }

    /// $`S^{-1} x`$.
    pub(super) fn apply_symmetric(&self, x: &[f64]) -> Vec<f64> {
        let side = x.len().div_ceil(SIDE);
        let mut lanes = vec![[0.0_f32; SIDE]; side];
        x.iter().enumerate().for_each(|(i, x)| lanes[i / SIDE][i % SIDE] = *x as f32);
        let product = packed_product(&self.tiles, &lanes);
        product.as_flattened().iter().take(x.len()).map(|y| f64::from(*y)).collect()
    }
}

/// Product of a symmetric matrix, of which `tiles` are those up to the diagonal, with `x`.
fn packed_product(tiles: &[[f32; TILE]], x: &[[f32; SIDE]]) -> Vec<[f32; SIDE]> {
    let mut y = vec![[0.0_f32; SIDE]; x.len()];
    let mut rest = tiles;
    for i in 0..x.len() {
        let (below, after) = rest.split_at(i);
        let Some((diagonal, after)) = after.split_first() else { break };
        rest = after;
        let mut sums = [[0.0_f32; SIDE]; SIDE];
        let xi = x[i];
        for ((tile, xj), yj) in below.iter().zip(x).zip(&mut y) {
            add_tile(tile, &xi, xj, &mut sums, yj);
        }
        for (row, sums) in diagonal.as_chunks::<SIDE>().0.iter().zip(&mut sums) {
            (0..SIDE).for_each(|k| sums[k] += row[k] * x[i][k]);
        }
        y[i] = std::array::from_fn(|r| y[i][r] + sums[r].iter().sum::<f32>());
    }
    y
}

/// A tile below the diagonal, in its place and in the transposed one.
#[inline(always)]
fn add_tile(
    tile: &[f32; TILE],
    xi: &[f32; SIDE],
    xj: &[f32; SIDE],
    sums: &mut [[f32; SIDE]; SIDE],
    yj: &mut [f32; SIDE],
) {
    let mut across = *yj;
    for (r, row) in tile.as_chunks::<SIDE>().0.iter().enumerate() {
        for k in 0..SIDE {
            sums[r][k] += row[k] * xj[k];
            across[k] += row[k] * xi[r];
        }
    }
    *yj = across;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn product_of_tiles_is_that_of_the_matrix() {
        for n in [1, 7, 8, 9, 37] {
            let matrix = Mat::from_fn(n, n, |i, j| ((i + j) as f32).sin() + (i * j) as f32 * 0.01);
            let roots: Vec<f64> = (0..n).map(|i| 1.0 + 0.1 * i as f64).collect();
            let x: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
            let inverse = Inverse::new(&matrix, &roots).expect("finite");
            let (found, scaled) = (inverse.apply_symmetric(&x), inverse.apply(&x));
            for i in 0..n {
                let exact: f64 = (0..n).map(|j| f64::from(matrix[(i, j)]) * x[j]).sum();
                assert!((found[i] - exact).abs() < 1e-6 * (n * n) as f64, "{n} {i}: {} {exact}", found[i]);
                let exact: f64 = (0..n).map(|j| f64::from(matrix[(i, j)]) * x[j] * roots[j] / roots[i]).sum();
                assert!((scaled[i] - exact).abs() < 1e-6 * (n * n) as f64, "{n} {i}: {} {exact}", scaled[i]);
            }
        }
    }

    #[test]
    fn matrices_that_are_not_finite_have_none() {
        assert!(Inverse::new(&Mat::from_fn(3, 3, |_, _| f32::NAN), &[1.0; 3]).is_none());
    }
}
