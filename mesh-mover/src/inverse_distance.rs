//! Inverse-distance weighting: an explicit mover, for comparison.

use crate::local::{Kind, LocalGrid};
use crate::mover::{Effort, Mover, MoverError};

/// Each free node moves by the mean of the boundary's displacements with weights $`(L/r)^3 + (L/r)^5`$, where r is the
/// distance to a boundary node and L a fifth of the largest distance between boundary and canopy (after Luke, Collins
/// and Blades, J. Comput. Phys. 231, 2012, with equal areas). Explicit and smooth; the cost is proportional to the
/// product of free and canopy nodes.
#[derive(Default)]
pub struct InverseDistance {
    /// Positions of owned free nodes and of all canopy nodes.
    free: Vec<[f64; 3]>,
    canopy: Vec<[f64; 3]>,
    /// Inverse of the sum of weights of each owned free node, canopy and outer boundary.
    scale: Vec<f64>,
    length2: f64,
}

impl InverseDistance {
    fn weight(&self, p: &[f64; 3], q: &[f64; 3]) -> f64 {
        let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        let s = self.length2 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        let cube = s * s.sqrt();
        cube + cube * s
    }
}

/// Positions of all canopy nodes, in their order, and of all fixed nodes, on every rank. Collective.
pub(crate) fn boundary(grid: &LocalGrid, x: &[f64]) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    // Owned nodes of each rank, with their interface index.
    let mut rows = Vec::new();
    for (kind, x) in grid.kind[..grid.nodes.n_owned].iter().zip(x.as_chunks::<3>().0) {
        let k = match kind {
            Kind::Free(_) => continue,
            Kind::Canopy(k) => f64::from(*k),
            Kind::Fixed => -1.0,
        };
        rows.extend([k, x[0], x[1], x[2]]);
    }
    let rows = grid.comm().all_gather_var(&rows);
    let mut canopy = vec![[0.0; 3]; grid.n_canopy];
    let mut outer = Vec::new();
    for r in rows.as_chunks::<4>().0 {
        match r[0] {
            -1.0 => outer.push([r[1], r[2], r[3]]),
            k => canopy[k as usize] = [r[1], r[2], r[3]],
        }
    }
    (canopy, outer)
}

impl Mover for InverseDistance {
    fn rebase(&mut self, grid: &LocalGrid, x: &[f64]) -> Result<(), MoverError> {
        let at = |a: usize| [x[3 * a], x[3 * a + 1], x[3 * a + 2]];
        let (canopy, outer) = boundary(grid, x);
        self.canopy = canopy;
        self.free = grid.free_node[..grid.n_free].iter().map(|&a| at(a as usize)).collect();
        let Some(&origin) = self.canopy.first() else {
            self.scale = vec![0.0; grid.n_free];
            return Ok(());
        };
        let far = outer.iter().map(|q| (0..3).map(|i| (q[i] - origin[i]).powi(2)).sum::<f64>());
        self.length2 = far.fold(0.0, f64::max) / 25.0;
        let sum = |p| outer.iter().chain(&self.canopy).map(|q| self.weight(p, q)).sum::<f64>();
        let scale: Vec<f64> = self.free.iter().map(|p| 1.0 / sum(p)).collect();
        self.scale = scale;
        Ok(())
    }

    fn bytes(&self) -> usize {
        24 * (self.free.len() + self.canopy.len()) + 8 * self.scale.len()
    }

    fn displace(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) -> Result<Effort, MoverError> {
        for ((p, scale), u) in self.free.iter().zip(&self.scale).zip(u.as_chunks_mut::<3>().0) {
            let mut sum = [0.0; 3];
            for (q, d) in self.canopy.iter().zip(canopy.as_chunks::<3>().0) {
                let w = self.weight(p, q);
                (0..3).for_each(|i| sum[i] += w * d[i]);
            }
            *u = sum.map(|s| s * scale);
        }
        grid.free_halo.exchange(u, 3);
        Ok(Effort::default())
    }

    fn extend(&mut self, grid: &LocalGrid, canopy: &[f64], u: &mut [f64]) {
        // Linear, and without an iteration: it never fails.
        let _ = self.displace(grid, canopy, u);
    }
}
