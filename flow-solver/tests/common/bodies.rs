//! Grids around a cylinder and a sphere.
#![allow(dead_code, clippy::needless_range_loop)]

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, PI};

use mesh::{FlowGrid, HEX_FACES, Patch, box_grid};

/// `nr` x `na` cells around a cylinder of diameter 1 m along z, to radius `far`, one
/// cell of 0.1 m deep. Angles run from the rear.
pub fn ring(nr: usize, na: usize, far: f64) -> FlowGrid {
    let side = Patch::Slip;
    let patches = [Patch::Wall, Patch::FarField, side, side, Patch::Symmetry, Patch::Symmetry];
    let mut grid = box_grid([nr, na, 1], [0.0; 3], [nr as f64, na as f64, 0.1], patches);
    // Sew the two ends of the angle together.
    let row = nr + 1;
    let sew = |n: u32| {
        let (n, layer) = (n as usize, (nr + 1) * (na + 1));
        let (k, rest) = (n / layer, n % layer);
        let j = (rest / row) % na;
        (k * layer + j * row + rest % row) as u32
    };
    grid.cells.iter_mut().flatten().for_each(|n| *n = sew(*n));
    grid.boundary.retain(|b| b.0 != side);
    grid.boundary.iter_mut().flat_map(|b| &mut b.1).for_each(|n| *n = sew(*n));
    for x in &mut grid.coords {
        let r = 0.5 * (2.0 * far).powf(x[0] / nr as f64);
        let a = 2.0 * PI * x[1] / na as f64;
        *x = [r * a.cos(), r * a.sin(), x[2]];
    }
    without_loose_nodes(grid)
}

/// A quarter (y > 0, z > 0) of shells around a sphere of diameter 1 m: a cube's surface
/// of `n` cells a side (even), bent round, with `nr` layers to radius `far`.
pub fn quarter_shell(n: usize, nr: usize, far: f64) -> FlowGrid {
    shell(n, nr, far, false)
}

/// A half (y > 0) of the same.
pub fn half_shell(n: usize, nr: usize, far: f64) -> FlowGrid {
    shell(n, nr, far, true)
}

fn shell(n: usize, nr: usize, far: f64, half: bool) -> FlowGrid {
    let whole = Patch::Wall;
    let (cells, from) = if half { ([n, n / 2, n], -1.0) } else { ([n, n / 2, n / 2], 0.0) };
    let cube = box_grid(cells, [-1.0, 0.0, from], [1.0; 3], [whole; 6]);
    let mut grid = FlowGrid::default();
    let mut place: HashMap<u32, u32> = HashMap::new();
    let mut surface: Vec<[u32; 4]> = Vec::new();
    let mut start: Vec<[f64; 3]> = Vec::new();
    for (_, f) in &cube.boundary {
        let flat = |d: usize| f.iter().all(|&v| cube.coords[v as usize][d] == 0.0);
        if flat(1) || (!half && flat(2)) {
            continue;
        }
        surface.push(f.map(|v| {
            *place.entry(v).or_insert_with(|| {
                let t = cube.coords[v as usize].map(|x| (FRAC_PI_4 * x).tan());
                let r = t.iter().map(|x| x * x).sum::<f64>().sqrt();
                start.push(t.map(|x| x / r));
                start.len() as u32 - 1
            })
        }));
    }
    let layer = start.len() as u32;
    for k in 0..=nr {
        let r = 0.5 * (2.0 * far).powf(k as f64 / nr as f64);
        grid.coords.extend(start.iter().map(|x| x.map(|v| r * v)));
    }
    for k in 0..nr as u32 {
        for f in &surface {
            let [a, b, c, d] = f.map(|v| v + k * layer);
            let cell = [a, b, c, d, a + layer, b + layer, c + layer, d + layer];
            for (side, face) in HEX_FACES.iter().enumerate() {
                let nodes = face.map(|i| cell[i]);
                let flat = |d: usize| nodes.iter().all(|&v| grid.coords[v as usize][d].abs() < 1e-12);
                match side {
                    0 if k == 0 => grid.boundary.push((Patch::Wall, nodes)),
                    1 if k + 1 == nr as u32 => grid.boundary.push((Patch::FarField, nodes)),
                    2.. if flat(1) || (!half && flat(2)) => grid.boundary.push((Patch::Symmetry, nodes)),
                    _ => {}
                }
            }
            grid.cells.push(cell);
        }
    }
    grid
}

/// The channel of DFG 2D-1 with `n` cells along each quarter of the cylinder's box:
/// height 0.41 m along z, cylinder of diameter 0.1 m at x = z = 0.2, 2.2 m long. Far field
/// (the inflow) on the left, outlet on the right, walls above and below.
#[expect(clippy::too_many_lines, reason = "a grid drawn from line to line")]
pub fn channel(n: usize) -> FlowGrid {
    let h = 0.2 / n as f64;
    let even = |from: f64, to: f64, m: usize| {
        (0..=m).map(|k| from + (to - from) * k as f64 / m as f64).collect::<Vec<_>>()
    };
    // Steps from h on that grow by a constant ratio to fill a length.
    let growing = |length: f64, ratio: f64| {
        let m = (1.0 + length * (ratio - 1.0) / h).ln() / ratio.ln();
        let m = m.ceil() as i32;
        let total: f64 = (0..m).map(|k| ratio.powi(k)).sum();
        let mut at = 0.0;
        (0..m)
            .map(|k| {
                at += length * ratio.powi(k) / total;
                at
            })
            .collect::<Vec<f64>>()
    };
    let ratio = 1.0 + 1.0 / n as f64;
    let mut x: Vec<f64> = even(0.0, 0.1, (n / 2).max(2));
    let left = x.len() - 1;
    x.extend(&even(0.1, 0.3, n)[1..]);
    x.extend(growing(1.9, ratio).iter().map(|s| 0.3 + s));
    let (low, high) = ((n / 2).max(2), (11 * n).div_ceil(20));
    let mut y = even(0.0, 0.1, low);
    y.extend(&even(0.1, 0.3, n)[1..]);
    y.extend(&even(0.3, 0.41, high)[1..]);
    let (nx, ny) = (x.len() - 1, y.len() - 1);
    let side = Patch::Symmetry;
    let patches = [Patch::FarField, Patch::Outlet, Patch::Wall, Patch::Wall, side, side];
    let mut grid = box_grid([nx, ny, 1], [0.0; 3], [nx as f64, ny as f64, 0.02], patches);
    let node = |i: usize, j: usize, k: usize| (i + (nx + 1) * (j + (ny + 1) * k)) as u32;
    let inside = |c: usize| {
        let (i, j) = (c % nx, c / nx);
        (left..left + n).contains(&i) && (low..low + n).contains(&j)
    };
    let mut c = 0;
    grid.cells.retain(|_| {
        c += 1;
        !inside(c - 1)
    });
    let gone = |f: &[u32; 4]| {
        f.iter().all(|&v| {
            let v = v as usize % ((nx + 1) * (ny + 1));
            let (i, j) = (v % (nx + 1), v / (nx + 1));
            (left..=left + n).contains(&i) && (low..=low + n).contains(&j)
        })
    };
    grid.boundary.retain(|b| b.0 != side || !gone(&b.1));
    for p in &mut grid.coords {
        *p = [x[p[0].round() as usize], y[p[1].round() as usize], p[2]];
    }
    // The box's rim, around from its lower left corner.
    let mut rim = Vec::new();
    rim.extend((0..n).map(|k| (left + k, low)));
    rim.extend((0..n).map(|k| (left + n, low + k)));
    rim.extend((0..n).map(|k| (left + n - k, low + n)));
    rim.extend((0..n).map(|k| (left, low + n - k)));
    let nr = n;
    let around = rim.len();
    // Nodes between cylinder (layer 0) and rim (layer nr), for both depths.
    let mut ring = vec![[0u32; 2]; (nr + 1) * around];
    for (a, &(i, j)) in rim.iter().enumerate() {
        for k in 0..2 {
            let outer = grid.coords[node(i, j, k) as usize];
            let angle = PI * (1.25 + 2.0 * a as f64 / around as f64);
            let inner = [0.2 + 0.05 * angle.cos(), 0.2 + 0.05 * angle.sin(), outer[2]];
            for r in 0..=nr {
                ring[r * around + a][k] = if r == nr {
                    node(i, j, k)
                } else {
                    // Finer at the cylinder.
                    let s = r as f64 / nr as f64;
                    let s = s * (0.55 + 0.45 * s);
                    grid.coords.push(std::array::from_fn(|d| inner[d] + s * (outer[d] - inner[d])));
                    grid.coords.len() as u32 - 1
                };
            }
        }
    }
    for r in 0..nr {
        for a in 0..around {
            let at = |r: usize, a: usize, k: usize| ring[r * around + a % around][k];
            let quad = |k: usize| [at(r, a, k), at(r, a + 1, k), at(r + 1, a + 1, k), at(r + 1, a, k)];
            // Around counter-clockwise and outwards: turned the other way about z.
            let (p, q) = (quad(0), quad(1));
            let cell = [p[0], p[3], p[2], p[1], q[0], q[3], q[2], q[1]];
            grid.cells.push(cell);
            grid.boundary.push((side, HEX_FACES[0].map(|i| cell[i])));
            grid.boundary.push((side, HEX_FACES[1].map(|i| cell[i])));
            if r == 0 {
                grid.boundary.push((Patch::Wall, [p[0], p[1], q[1], q[0]]));
            }
        }
    }
    // A quarter turn about x.
    for p in &mut grid.coords {
        *p = [p[0], -p[2], p[1]];
    }
    without_loose_nodes(grid)
}

/// Drops nodes that no cell has.
fn without_loose_nodes(mut grid: FlowGrid) -> FlowGrid {
    let mut number = vec![u32::MAX; grid.coords.len()];
    grid.cells.iter().flatten().for_each(|&n| number[n as usize] = 0);
    let mut coords = Vec::new();
    for (n, x) in number.iter_mut().zip(&grid.coords).filter(|(n, _)| **n == 0) {
        *n = coords.len() as u32;
        coords.push(*x);
    }
    grid.coords = coords;
    grid.cells.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
    grid.boundary.iter_mut().flat_map(|b| &mut b.1).for_each(|n| *n = number[*n as usize]);
    grid
}
