//! Grids of hexahedra around shapes of zero thickness in a stream along z: square plate, disk, hemispherical cup.
//! Side and diameter are 1 m; the box is [-5, 5]^2 x [-5, 10] m with an inflow at low z, an outlet at high z and slip sides.
#![allow(dead_code)]

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_4;

use mesh::{FlowGrid, Patch, block_grid, box_grid};

use super::common::growing;
use super::plate;

/// A shape of zero thickness with a published drag coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Disk normal to the stream.
    Disk,
    /// Square plate normal to the stream.
    Plate,
    /// Hemisphere, its opening upstream.
    CupOpen,
    /// Hemisphere, its opening downstream.
    CupAway,
}

impl Shape {
    /// By its name on the command line.
    pub fn named(name: &str) -> Option<Self> {
        let of = [
            ("disk", Self::Disk),
            ("plate", Self::Plate),
            ("cup-open", Self::CupOpen),
            ("cup-away", Self::CupAway),
        ];
        of.into_iter().find(|(n, _)| *n == name).map(|(_, shape)| shape)
    }

    /// Whether the shape lies in a plane normal to the stream.
    pub fn is_flat(self) -> bool {
        matches!(self, Self::Disk | Self::Plate)
    }

    /// Reference area, m2.
    pub fn area(self) -> f64 {
        if self == Self::Plate { 1.0 } else { FRAC_PI_4 }
    }

    /// The grid with `across` cells of the wake per diameter or side; a multiple of 4.
    pub fn grid(self, across: usize) -> FlowGrid {
        self.grid_in(across, 5.0)
    }

    /// The same in a box of another half width, m; around cups only.
    pub fn grid_in(self, across: usize, half: f64) -> FlowGrid {
        assert!(!self.is_flat() || half == 5.0, "the grid of a flat shape is 10 m wide");
        match self {
            Self::Plate => sheet(false, across),
            Self::Disk => sheet(true, across),
            Self::CupOpen => cup(across, true, half),
            Self::CupAway => cup(across, false, half),
        }
    }
}

/// A square sheet of side 1 m, or a disk of this diameter, with `across` cells along it.
pub fn sheet(disk: bool, across: usize) -> FlowGrid {
    let mut grid = plate::lines(2 * across, 2);
    if disk {
        // Squares around the axis become circles, fully at the rim and less away from it.
        for x in &mut grid.coords {
            let s = x[0].abs().max(x[1].abs());
            let r = x[0].hypot(x[1]);
            if s > 0.0 {
                let w = if s <= 0.5 { 2.0 * s } else { (5.0 - s) / 4.5 };
                let k = 1.0 + w * (s / r - 1.0);
                (x[0], x[1]) = (k * x[0], k * x[1]);
            }
        }
    }
    grid
}

/// Half the edge of the cube around the sphere that the rectilinear cells leave free, m.
const CUBE: f64 = 0.75;

/// A hemisphere of diameter 1 m about the origin, its opening towards low z (`open`) or high z, in a box of half width
/// `half`, m. Rectilinear cells of edge
/// 1/`across` m around a cube; layers from the cube to the sphere, and from the sphere to a rounded cube of cells within it.
pub fn cup(across: usize, open: bool, half: f64) -> FlowGrid {
    let n = 3 * across / 2;
    let mut grid = box_around_cube(across, n, half);
    // The faces of the cube, their normals inwards; its nodes, numbered in order of appearance, and their places along x, y, z.
    let mut faces: Vec<[u32; 4]> = Vec::new();
    grid.boundary.retain(|(patch, nodes)| {
        let wall = *patch == Patch::Wall;
        faces.extend(wall.then_some(nodes));
        !wall
    });
    (grid.patch_names, grid.boundary_patch) = (Vec::new(), Vec::new());
    let mut number: HashMap<u32, u32> = HashMap::new();
    let mut nodes: Vec<u32> = Vec::new();
    for v in faces.iter_mut().flatten() {
        let next = nodes.len() as u32;
        let k = *number.entry(*v).or_insert(next);
        if k == next {
            nodes.push(*v);
        }
        *v = k;
    }
    let place = |x: f64| (0.5 * n as f64 * (x / CUBE + 1.0)).round() as usize;
    let places: Vec<[usize; 3]> = nodes.iter().map(|&v| grid.coords[v as usize].map(place)).collect();

    let (outside, inside) = (across / 2, across * 3 / 8);
    for layer in 1..=outside + inside {
        let first = grid.coords.len() as u32;
        for at in &places {
            let p = at.map(|i| 2.0 * i as f64 / n as f64 - 1.0);
            grid.coords.push(between(p, layer, outside, inside));
        }
        for f in &faces {
            let (a, b) = (f.map(|v| nodes[v as usize]), f.map(|v| first + v));
            grid.cells.push([a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]);
        }
        nodes = (first..grid.coords.len() as u32).collect();
        if layer == outside {
            add_wall(&mut grid, &faces, first, open);
        }
    }
    fill_core(&mut grid, n, &places, &nodes);
    grid
}

/// The box of rectilinear cells without the cube, which has `n` cells along each edge and lies where the patch is a wall.
fn box_around_cube(across: usize, n: usize, half: f64) -> FlowGrid {
    let h = 1.0 / across as f64;
    let share = |n: usize| (n * across + 8) / 16;
    let even = |from: f64, cells: usize| (1..=cells).map(move |k| from + k as f64 * h);
    let beside = share(18) + (share(6) as f64 * (half / 5.0).log2()).round() as usize;
    let outward = growing(beside, half - CUBE, h);
    let ahead = growing(share(18), 5.0 - CUBE, h);
    let low = |steps: &[f64]| steps.iter().rev().map(|s| -CUBE - s).collect::<Vec<f64>>();
    let mut y = low(&outward);
    y.extend((1..=n).map(|k| CUBE * (2.0 * k as f64 / n as f64 - 1.0)));
    y.extend(outward[1..].iter().map(|s| CUBE + s));
    let (mut z, behind) = (low(&ahead), n + share(20));
    z.extend(even(-CUBE, behind));
    let end = -CUBE + behind as f64 * h;
    z.extend(growing(share(28), 10.0 - end, h)[1..].iter().map(|s| end + s));
    let cells = [y.len() - 1, y.len() - 1, z.len() - 1];
    let side = Patch::Slip;
    let patches = [side, side, side, side, Patch::FarField, Patch::Outlet];
    let (side, front) = (beside..beside + n, share(18)..share(18) + n);
    let mut grid = block_grid(cells, [0.0; 3], cells.map(|n| n as f64), patches, [side.clone(), side, front]);
    for x in &mut grid.coords {
        *x = [y[x[0].round() as usize], y[x[1].round() as usize], z[x[2].round() as usize]];
    }
    grid
}

/// Node of a layer on the line through the point `p` of the surface of the cube [-1, 1]^3: `outside` layers from the cube of
/// half edge [`CUBE`] to the sphere, then `inside` layers to the core.
fn between(p: [f64; 3], layer: usize, outside: usize, inside: usize) -> [f64; 3] {
    let t = p.map(|x| (FRAC_PI_4 * x).tan());
    let r = t.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sphere = t.map(|x| 0.5 * x / r);
    let (other, w) = if layer <= outside {
        (p.map(|x| CUBE * x), layer as f64 / outside as f64)
    } else {
        (core(p), (outside + inside - layer) as f64 / inside as f64)
    };
    std::array::from_fn(|d| w * sphere[d] + (1.0 - w) * other[d])
}

/// Point of the core for a point `p` of the cube [-1, 1]^3: half way from cubes to spheres at the surface, less within.
fn core(p: [f64; 3]) -> [f64; 3] {
    let s = p.iter().fold(0.0f64, |s, x| s.max(x.abs()));
    let r = p.iter().map(|x| x * x).sum::<f64>().sqrt();
    let w = 0.5 * s;
    let round = if r > 0.0 { s / r } else { 1.0 };
    p.map(|x| 0.27 * x * (1.0 - w + w * round))
}

/// Makes half of the sphere's `faces` (nodes from `first` on) the wall, its normal outwards.
fn add_wall(grid: &mut FlowGrid, faces: &[[u32; 4]], first: u32, open: bool) {
    for f in faces {
        let nodes = f.map(|v| first + v);
        let z: f64 = nodes.iter().map(|&v| grid.coords[v as usize][2]).sum();
        if (z > 0.0) == open {
            grid.canopy_faces.push([nodes[0], nodes[3], nodes[2], nodes[1]]);
        }
    }
    grid.canopy_nodes = grid.canopy_faces.concat();
    grid.canopy_nodes.sort_unstable();
    grid.canopy_nodes.dedup();
}

/// Fills the core with `n` cells along each edge; its surface has these `nodes` at these `places`.
fn fill_core(grid: &mut FlowGrid, n: usize, places: &[[usize; 3]], nodes: &[u32]) {
    let cube = box_grid([n; 3], [-1.0; 3], [1.0; 3], [Patch::Wall; 6]);
    let mut number = vec![u32::MAX; cube.coords.len()];
    for (at, &v) in places.iter().zip(nodes) {
        number[at[0] + (n + 1) * (at[1] + (n + 1) * at[2])] = v;
    }
    for (x, number) in cube.coords.iter().zip(&mut number).filter(|(_, v)| **v == u32::MAX) {
        *number = grid.coords.len() as u32;
        grid.coords.push(core(*x));
    }
    grid.cells.extend(cube.cells.iter().map(|cell| cell.map(|v| number[v as usize])));
}
