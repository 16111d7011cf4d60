//! Blocks of the flow grid: a surface around the canopy and what lies on its
//! two sides.
//!
//! The *surface* is a closed box of six panels, topologically: the top, four
//! sides, and a cap. The canopy covers the top and (ATPS) the upper levels of the
//! sides; below the hem the sides continue as open fluid (the *skirt*) and close in
//! the cap. Each vent is filled with a *zipper*: a column of
//! [`Blocks::across`] quadrilaterals between the edges of two arms, which
//! shrinks to a single node at the vent's ends. Where the vents run down to the
//! hem, that end is the first level of the skirt.
//!
//! Inside, layers lead from the surface to a core block of n x n x levels
//! hexahedra, where the zippers shrink to the core's upright edges; outside,
//! layers lead to the far field.

use crate::structure::AtpsLayout;
use crate::{FlowGrid, Patch, Point, StructureMesh};

/// Where a surface node lies on the cube [-1, 1]^3, evenly spaced.
pub(super) type CubePoint = [f64; 3];

/// Numbers of nodes and cells of all blocks.
pub(super) struct Blocks {
    layout: AtpsLayout,
    /// Cells across a panel.
    pub n: usize,
    /// Levels of the sides: canopy and skirt.
    pub levels: usize,
    /// Cells across a vent.
    pub across: usize,
    /// Layers inside and outside.
    pub layers: [usize; 2],
    /// First skirt node; before it the canopy.
    skirt: usize,
    /// First inner node of the cap.
    cap: usize,
    /// First node between the edges of a vent, and the level where that is.
    zip: usize,
    first_open: usize,
    /// Number of surface nodes.
    pub surface: usize,
    /// First node of the core, of the layers inside, of the layers outside, end.
    pub core: usize,
    inside: usize,
    outside: usize,
    pub nodes: usize,
    /// Quadrilaterals of the surface, outwards: first the canopy's faces.
    pub quads: Vec<[u32; 4]>,
    /// Core node under each surface node.
    pub under: Vec<u32>,
    /// Cube position of each surface node.
    pub cube: Vec<CubePoint>,
}

impl Blocks {
    pub fn new(
        layout: AtpsLayout,
        canopy: &StructureMesh,
        skirt_levels: usize,
        across: usize,
        layers: [usize; 2],
    ) -> Self {
        let (n, m) = (layout.n, layout.m);
        let levels = m + skirt_levels;
        let skirt = layout.nodes();
        let cap = skirt + 4 * n * skirt_levels;
        let zip = cap + (n - 1) * (n - 1);
        let open_levels = (0..=m).filter(|&b| !layout.is_shared(b)).count();
        let first_open = (0..=m).find(|&b| !layout.is_shared(b)).unwrap_or(0);
        let surface = zip + 4 * (across - 1) * open_levels;
        let core = surface;
        let inside = core + (n + 1) * (n + 1) * (levels + 1);
        let outside = inside + surface * (layers[0] - 1);
        let nodes = outside + surface * layers[1];
        let mut blocks = Blocks {
            layout,
            n,
            levels,
            across,
            layers,
            skirt,
            cap,
            zip,
            first_open,
            surface,
            core,
            inside,
            outside,
            nodes,
            quads: canopy.faces.clone(),
            under: vec![0; surface],
            cube: vec![[0.0; 3]; surface],
        };
        blocks.add_quads();
        blocks.place();
        blocks
    }

    /// Surface node (a, b) of side `k`, b from 0 (top) to `levels` (cap).
    pub fn side(&self, k: usize, a: usize, b: usize) -> u32 {
        if b <= self.layout.m {
            return self.layout.arm(k, a, b);
        }
        let n = self.n;
        (self.skirt + 4 * n * (b - self.layout.m - 1) + (k * n + a) % (4 * n)) as u32
    }

    /// Surface node (i, j) of the cap, numbered as the top above it.
    pub fn cap(&self, i: usize, j: usize) -> u32 {
        let (n, b) = (self.n, self.levels);
        match (i, j) {
            (i, j) if i == n => self.side(0, j, b),
            (i, j) if j == n => self.side(1, n - i, b),
            (0, j) => self.side(2, n - j, b),
            (i, 0) => self.side(3, i, b),
            _ => (self.cap + (i - 1) + (n - 1) * (j - 1)) as u32,
        }
    }

    /// Whether the arms are apart at level `b`.
    fn is_open(&self, b: usize) -> bool {
        b <= self.layout.m && !self.layout.is_shared(b)
    }

    /// Node `z` (0 to `across`) of the zipper between side `k` and the next, level `b`.
    pub fn zipper(&self, k: usize, z: usize, b: usize) -> u32 {
        if z == 0 || !self.is_open(b) {
            return self.side(k, self.n, b);
        }
        if z == self.across {
            return self.side((k + 1) % 4, 0, b);
        }
        (self.zip + (4 * (b - self.first_open) + k) * (self.across - 1) + z - 1) as u32
    }

    /// Levels at which the zippers are open.
    pub fn open_levels(&self) -> impl Iterator<Item = usize> + '_ {
        (0..=self.layout.m).filter(|&b| self.is_open(b))
    }

    /// Number of cells of [`Self::grid`].
    pub fn cells(&self) -> usize {
        self.n * self.n * self.levels + self.quads.len() * (self.layers[0] + self.layers[1])
    }

    /// First node of the far field; all nodes from here on lie there.
    pub fn far_field(&self) -> usize {
        self.nodes - self.surface
    }

    /// The level of the hem (or rim).
    pub fn hem(&self) -> usize {
        self.layout.m
    }

    fn core_node(&self, i: usize, j: usize, b: usize) -> u32 {
        (self.core + i + (self.n + 1) * (j + (self.n + 1) * b)) as u32
    }

    /// Grid node of surface node `s` on layer `l`: 0 is the core or the surface,
    /// up to `layers` (the surface or the far field).
    fn inner(&self, s: u32, l: usize) -> u32 {
        if l == 0 {
            self.under[s as usize]
        } else if l == self.layers[0] {
            s
        } else {
            (self.inside + (l - 1) * self.surface) as u32 + s
        }
    }

    fn outer(&self, s: u32, l: usize) -> u32 {
        if l == 0 { s } else { (self.outside + (l - 1) * self.surface) as u32 + s }
    }

    /// Grid nodes along the line through surface node `s`, from core to far field.
    pub fn line(&self, s: usize) -> impl Iterator<Item = u32> + '_ {
        let inner = (0..self.layers[0]).map(move |l| self.inner(s as u32, l));
        inner.chain((0..=self.layers[1]).map(move |l| self.outer(s as u32, l)))
    }

    fn add_quads(&mut self) {
        let (n, m) = (self.n, self.layout.m);
        for k in 0..4 {
            for b in m..self.levels {
                for a in 0..n {
                    self.quads.push([
                        self.side(k, a, b),
                        self.side(k, a, b + 1),
                        self.side(k, a + 1, b + 1),
                        self.side(k, a + 1, b),
                    ]);
                }
            }
            for b in 0..=m {
                if !self.is_open(b) && !self.is_open(b + 1) {
                    continue;
                }
                for z in 0..self.across {
                    self.quads.push([
                        self.zipper(k, z, b),
                        self.zipper(k, z, b + 1),
                        self.zipper(k, z + 1, b + 1),
                        self.zipper(k, z + 1, b),
                    ]);
                }
            }
        }
        for j in 0..n {
            for i in 0..n {
                // Seen from below.
                self.quads.push([
                    self.cap(i, j),
                    self.cap(i, j + 1),
                    self.cap(i + 1, j + 1),
                    self.cap(i + 1, j),
                ]);
            }
        }
    }

    /// Cube positions and core nodes of all surface nodes.
    fn place(&mut self) {
        let n = self.n;
        let across = |a: usize| (2.0 * a as f64 - n as f64) / n as f64;
        for j in 0..=n {
            for i in 0..=n {
                let (top, cap) = (self.layout.top(i, j) as usize, self.cap(i, j) as usize);
                self.cube[top] = [across(i), across(j), 1.0];
                self.cube[cap] = [across(i), across(j), -1.0];
                self.under[top] = self.core_node(i, j, 0);
                self.under[cap] = self.core_node(i, j, self.levels);
            }
        }
        let turn = |k: usize, t: f64, z: f64| match k {
            0 => [1.0, t, z],
            1 => [-t, 1.0, z],
            2 => [-1.0, -t, z],
            _ => [t, -1.0, z],
        };
        for b in 0..=self.levels {
            let z = 1.0 - 2.0 * b as f64 / self.levels as f64;
            // Far out an open zipper is half as wide as its cells' neighbours.
            let width = if self.is_open(b) { 0.5 * self.across as f64 / n as f64 } else { 0.0 };
            for k in 0..4 {
                for a in 0..=n {
                    let node = self.side(k, a, b) as usize;
                    self.cube[node] = turn(k, across(a) * (1.0 - width), z);
                    self.under[node] = match k {
                        0 => self.core_node(n, a, b),
                        1 => self.core_node(n - a, n, b),
                        2 => self.core_node(0, n - a, b),
                        _ => self.core_node(a, 0, b),
                    };
                }
            }
            if self.is_open(b) {
                for k in 0..4 {
                    for zip in 1..self.across {
                        let node = self.zipper(k, zip, b) as usize;
                        self.under[node] = self.under[self.side(k, n, b) as usize];
                        let along = 2.0 * zip as f64 / self.across as f64 - 1.0;
                        self.cube[node] = if along <= 0.0 {
                            turn(k, 1.0 + along * width, z)
                        } else {
                            turn((k + 1) % 4, -1.0 + along * width, z)
                        };
                    }
                }
            }
        }
    }

    /// Cube position of core node (i, j, b), evenly spaced.
    pub fn core_cube(&self) -> impl Iterator<Item = CubePoint> + '_ {
        let at = |a: usize, n: usize| 2.0 * a as f64 / n as f64 - 1.0;
        let n = self.n;
        (0..=self.levels).flat_map(move |b| {
            (0..=n).flat_map(move |j| (0..=n).map(move |i| [at(i, n), at(j, n), -at(b, self.levels)]))
        })
    }

    /// The grid of these blocks with nodes at `coords`.
    pub fn grid(&self, coords: Vec<Point>, canopy: &StructureMesh) -> FlowGrid {
        let mut grid = FlowGrid {
            coords,
            canopy_nodes: (0..canopy.n_canopy as u32).collect(),
            canopy_faces: canopy.faces.clone(),
            ..Default::default()
        };
        let cell = |low: [u32; 4], high: [u32; 4]| {
            [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
        };
        grid.cells.reserve_exact(self.cells());
        for b in 0..self.levels {
            for j in 0..self.n {
                for i in 0..self.n {
                    let level = |b| {
                        [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| self.core_node(i, j, b))
                    };
                    grid.cells.push(cell(level(b + 1), level(b)));
                }
            }
        }
        for quad in &self.quads {
            for l in 0..self.layers[0] {
                grid.cells.push(cell(quad.map(|s| self.inner(s, l)), quad.map(|s| self.inner(s, l + 1))));
            }
            for l in 0..self.layers[1] {
                grid.cells.push(cell(quad.map(|s| self.outer(s, l)), quad.map(|s| self.outer(s, l + 1))));
            }
            grid.boundary.push((Patch::FarField, quad.map(|s| self.outer(s, self.layers[1]))));
        }
        grid
    }
}
