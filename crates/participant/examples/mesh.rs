//! Inverse-distance interpolation in place of the mesh-mover.
//!
//! Each node of the grid between canopy and outer boundary moves by the mean of their displacements, weighted by (L/r)^3 + (L/r)^5 with
//! its distance r to their nodes; the outer boundary stands still. The weights are those of the grid at the start and are kept, one for
//! each pair of a free node and a canopy node: for small grids. Every process moves its own share of the nodes.

use std::ops::Range;
use std::path::Path;
use std::process::ExitCode;

use ripstop_participant::{
    Announcement, Fault, Input, Participant, Role, Run, Stats, Window, bdf2, load_state,
    main as participant_main, mesh_stats as at, save_state,
};

type Vec3 = [f64; 3];

/// Faces of a hexahedron, seen from outside.
const SIDES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// Positions at the end of the last two windows (m), and the length of the last one (s; 0: there was none).
type State = (Vec<Vec3>, Vec<Vec3>, f64);

struct InverseDistance {
    announcement: Announcement,
    /// Unstressed positions of the canopy nodes, m.
    unstressed: Vec<Vec3>,
    /// Grid node of each canopy node.
    on_canopy: Vec<usize>,
    /// Positions at the start of the stage, m.
    start: Vec<Vec3>,
    cells: Vec<[u32; 8]>,
    /// Volumes at the start, m3.
    volumes: Vec<f64>,
    /// Weight of each canopy node at each grid node, `[grid nodes][canopy nodes]`; empty for nodes that stand still.
    weights: Vec<Vec<f64>>,
    /// Grid nodes of this rank.
    rows: Range<usize>,
    accepted: State,
    trial: Vec<Vec3>,
    dt: f64,
}

impl InverseDistance {
    fn new(run: &Run) -> Result<Self, Fault> {
        let data = run.data(true)?;
        let grid = data.flow_grid()?;
        let n_canopy = data.structure.n_canopy;
        let start = grid.coords.clone();
        let on_canopy: Vec<usize> = grid.canopy_nodes.iter().map(|node| *node as usize).collect();
        let mut canopy_node = vec![None; start.len()];
        on_canopy.iter().enumerate().for_each(|(i, node)| canopy_node[*node] = Some(i));
        let mut outer = vec![false; start.len()];
        grid.boundary.iter().flat_map(|(_, face)| face).for_each(|node| outer[*node as usize] = true);
        let still: Vec<Vec3> =
            (0..start.len()).filter(|i| outer[*i] && canopy_node[*i].is_none()).map(|i| start[i]).collect();
        let far = still.iter().map(|x| distance2(*x, start[on_canopy[0]])).fold(0.0, f64::max).sqrt();
        let weight = |a: Vec3, b: Vec3| {
            let length2 = (far / 5.0).powi(2);
            let s = length2 / distance2(a, b).max(1e-12 * length2);
            s.powf(1.5) + s.powf(2.5)
        };
        let weights = (0..start.len()).map(|i| match canopy_node[i] {
            Some(own) => (0..n_canopy).map(|j| f64::from(u8::from(j == own))).collect(),
            None if outer[i] => Vec::new(),
            None => {
                let near: Vec<f64> = on_canopy.iter().map(|node| weight(start[i], start[*node])).collect();
                let sum = near.iter().sum::<f64>() + still.iter().map(|x| weight(start[i], *x)).sum::<f64>();
                near.iter().map(|w| w / sum).collect()
            }
        });
        let accepted = match run.state(&data) {
            Some(file) => load_state(&file)?,
            None => (start.clone(), start.clone(), 0.0),
        };
        Ok(Self {
            announcement: run.announcement(
                &data,
                "inverse-distance",
                start.len(),
                &["resume", "coupling.adaptive"],
            ),
            unstressed: data.structure.coords[..n_canopy].to_vec(),
            volumes: grid.cells.iter().map(|cell| volume(cell, &start)).collect(),
            cells: grid.cells.clone(),
            weights: weights.collect(),
            rows: run.share(start.len()),
            trial: accepted.0.clone(),
            dt: 0.0,
            on_canopy,
            start,
            accepted,
        })
    }
}

impl Participant for InverseDistance {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn output_rows(&self) -> Vec<u64> {
        self.rows.clone().map(|row| row as u64).collect()
    }

    fn advance(&mut self, window: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let displacement = input.canopy.as_chunks::<3>().0;
        let moved = |(i, node): (usize, &usize)| {
            let now = [0, 1, 2].map(|axis| self.unstressed[i][axis] + displacement[i][axis]);
            minus(now, self.start[*node])
        };
        let moved: Vec<Vec3> = self.on_canopy.iter().enumerate().map(moved).collect();
        let sum = |weights: &Vec<f64>, axis: usize| {
            weights.iter().zip(&moved).map(|(w, u)| w * u[axis]).sum::<f64>()
        };
        let nodes = self.start.iter().zip(&self.weights);
        let x: Vec<Vec3> =
            nodes.map(|(x, weights)| [0, 1, 2].map(|axis| x[axis] + sum(weights, axis))).collect();
        let ratio = |(cell, before): (&[u32; 8], &f64)| volume(cell, &x) / before;
        let ratios = self.cells.iter().zip(&self.volumes).map(ratio).enumerate();
        let (worst, smallest) =
            ratios.fold((0, f64::INFINITY), |least, r| if r.1 < least.1 { r } else { least });
        if smallest <= 0.0 {
            return Err(Fault::new(format!(
                "cell {worst} is turned inside out in window {} (its volume is {smallest:.3} of that at the start): shorter \
                 windows or the project's own mesh-mover may help",
                window.index
            )));
        }
        // The rate that the flow's time differences have too, so that a uniform stream stays uniform.
        let (now, before, last) = &self.accepted;
        let [c0, c1, c2] = bdf2(window.dt / last).unwrap_or([1.0, -1.0, 0.0]);
        for (row, out) in self.rows.clone().zip(output.as_chunks_mut::<6>().0) {
            let rate =
                |axis: usize| (c0 * x[row][axis] + c1 * now[row][axis] + c2 * before[row][axis]) / window.dt;
            *out = [x[row][0], x[row][1], x[row][2], rate(0), rate(1), rate(2)];
        }
        let mut stats = Stats::default();
        stats.values[at::MIN_VOLUME_RATIO] = smallest;
        stats.values[at::WORST_CELL] = worst as f64;
        (self.trial, self.dt) = (x, window.dt);
        Ok(stats)
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        let before = std::mem::replace(&mut self.accepted.0, self.trial.clone());
        (self.accepted.1, self.accepted.2) = (before, self.dt);
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        if self.rows.start == 0 { save_state(folder, Role::Mesh, &self.accepted) } else { Ok(()) }
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

/// Volume of a hexahedron, also of one that repeats nodes, m3.
fn volume(cell: &[u32; 8], x: &[Vec3]) -> f64 {
    let side = |side: &[usize; 4]| {
        let [a, b, c, d] = side.map(|k| x[cell[k] as usize]);
        let middle = [0, 1, 2].map(|i| 0.25 * (a[i] + b[i] + c[i] + d[i]));
        let (p, q) = (minus(c, a), minus(d, b));
        let area = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        (0..3).map(|i| middle[i] * area[i]).sum::<f64>() / 6.0
    };
    SIDES.iter().map(side).sum()
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn distance2(a: Vec3, b: Vec3) -> f64 {
    minus(a, b).iter().map(|c| c * c).sum()
}

fn main() -> ExitCode {
    participant_main(Role::Mesh, InverseDistance::new)
}
