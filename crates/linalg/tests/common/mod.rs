//! A distributed elasticity problem: trilinear hexahedra on a box, one face held.
#![allow(clippy::needless_range_loop, dead_code)]

use std::collections::BTreeMap;
use std::rc::Rc;

use comm::{Comm, Halo, Numbering};
use linalg::BlockCsr;

pub struct Problem {
    pub a: BlockCsr<3>,
    /// Global index of each local node.
    pub global: Vec<u64>,
    /// Coordinates of the local nodes.
    pub coords: Vec<[f64; 3]>,
    /// A body force in the eliminated system.
    pub b: Vec<f64>,
}

/// A box of `cells` hexahedra, edge lengths `size`. `stiffness` gives Young's modulus at
/// an element's centre; Poisson's ratio is 0.3. The face x = 0 is held. Nodes are dealt to
/// ranks in slanted slabs, so that partitions meet in jagged surfaces.
pub fn box_problem(
    comm: &Comm,
    cells: [usize; 3],
    size: [f64; 3],
    stiffness: impl Fn([f64; 3]) -> f64,
) -> Problem {
    let nodes = cells.map(|n| n + 1);
    let id = |i: [usize; 3]| ((i[0] * nodes[1] + i[1]) * nodes[2] + i[2]) as u64;
    let index = |g: u64| {
        let g = g as usize;
        [g / (nodes[1] * nodes[2]), g / nodes[2] % nodes[1], g % nodes[2]]
    };
    let owner = |g: u64| {
        let [i, j, k] = index(g);
        (i + j / 2 + k / 3) * comm.size() / (nodes[0] + nodes[1] / 2 + nodes[2] / 3)
    };
    let position = |g: u64| {
        let i = index(g);
        [0, 1, 2].map(|c| size[c] * i[c] as f64 / cells[c] as f64)
    };
    let total = (nodes[0] * nodes[1] * nodes[2]) as u64;
    let owned: Vec<u64> = (0..total).filter(|&g| owner(g) == comm.rank()).collect();
    let mut elements = Vec::new();
    let mut ghosts = BTreeMap::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                let corners: [u64; 8] =
                    std::array::from_fn(|c| id([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)]));
                if corners.iter().any(|&g| owner(g) == comm.rank()) {
                    elements.push(corners);
                    for g in corners.into_iter().filter(|&g| owner(g) != comm.rank()) {
                        ghosts.insert(g, owner(g) as u32);
                    }
                }
            }
        }
    }
    let numbering = Numbering::new(owned, ghosts.into_iter().collect());
    let halo = Rc::new(Halo::new(comm, &numbering));
    let local: Vec<[u32; 8]> =
        elements.iter().map(|e| e.map(|g| numbering.local(g).unwrap() as u32)).collect();
    let mut a = BlockCsr::<3>::from_elements(halo.clone(), local.iter().map(|e| &e[..]));
    let unit = element([0, 1, 2].map(|c| size[c] / cells[c] as f64));
    for (e, corners) in local.iter().zip(&elements) {
        let (lo, hi) = (position(corners[0]), position(corners[7]));
        add_element(&mut a, e, &unit, stiffness([0, 1, 2].map(|c| 0.5 * (lo[c] + hi[c]))));
    }
    let coords: Vec<[f64; 3]> = numbering.global.iter().map(|&g| position(g)).collect();
    let mut b: Vec<f64> = numbering
        .owned()
        .iter()
        .flat_map(|&g| [0.1, (g as f64 * 0.37).sin(), -1.0 + 0.2 * (g as f64).cos()])
        .collect();
    hold(&mut a, &mut b, &coords);
    Problem { a, global: numbering.global.clone(), coords, b }
}

/// Adds an element with corners `e` and stiffness `young * unit` to the owned rows.
fn add_element(a: &mut BlockCsr<3>, e: &[u32; 8], unit: &[[f64; 24]; 24], young: f64) {
    let n = a.n_rows();
    for p in (0..8).filter(|&p| (e[p] as usize) < n) {
        for q in 0..8 {
            let slot = a.slot(e[p] as usize, e[q] as usize).unwrap();
            for r in 0..3 {
                for c in 0..3 {
                    a.values[slot][r][c] += young * unit[3 * p + r][3 * q + c];
                }
            }
        }
    }
}

/// Takes the nodes at x = 0 out of the system, which stays symmetric: their rows keep only their diagonal.
fn hold(a: &mut BlockCsr<3>, b: &mut [f64], coords: &[[f64; 3]]) {
    let held = |i: usize| coords[i][0] == 0.0;
    for i in 0..a.n_rows() {
        for s in a.row(i) {
            let j = a.cols()[s] as usize;
            if held(i) || held(j) {
                let d = a.values[s];
                a.values[s] = [[0.0; 3]; 3];
                if i == j {
                    (0..3).for_each(|r| a.values[s][r][r] = d[r][r]);
                }
            }
        }
        if held(i) {
            b[3 * i..3 * i + 3].fill(0.0);
        }
    }
}

/// Stiffness of a trilinear brick of edges `h`, Young's modulus 1, Poisson's ratio 0.3,
/// 2 x 2 x 2 Gauss points.
fn element(h: [f64; 3]) -> [[f64; 24]; 24] {
    let (lambda, mu) = (0.3 / (1.3 * 0.4), 1.0 / 2.6);
    let mut k = [[0.0; 24]; 24];
    let g = 1.0 / 3f64.sqrt();
    for point in 0..8 {
        let xi = [0, 1, 2].map(|c| if point >> c & 1 == 1 { g } else { -g });
        let grad: [[f64; 3]; 8] = std::array::from_fn(|a| {
            let s = [0, 1, 2].map(|c| if a >> c & 1 == 1 { 1.0 } else { -1.0 });
            [0, 1, 2].map(|c| {
                let (p, q) = ((c + 1) % 3, (c + 2) % 3);
                0.125 * s[c] * (1.0 + s[p] * xi[p]) * (1.0 + s[q] * xi[q]) * 2.0 / h[c]
            })
        });
        let weight = h[0] * h[1] * h[2] / 8.0;
        for a in 0..8 {
            for b in 0..8 {
                let dot: f64 = (0..3).map(|c| grad[a][c] * grad[b][c]).sum();
                for r in 0..3 {
                    for c in 0..3 {
                        let d = if r == c { dot } else { 0.0 };
                        k[3 * a + r][3 * b + c] +=
                            weight * (lambda * grad[a][r] * grad[b][c] + mu * (grad[a][c] * grad[b][r] + d));
                    }
                }
            }
        }
    }
    k
}
