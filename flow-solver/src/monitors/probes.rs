//! Values at points.

use std::path::Path;

use channel::Fault;

use super::table::Table;
use crate::geometry::vec3::Vec3;
use crate::gradient;
use crate::physics::{Gas, velocity};
use crate::solver::Solver;

/// Numbers of one probe: gauge pressure, Pa, velocity relative to the falling frame,
/// m/s, temperature, K.
const WIDTH: usize = 5;

/// Cell around a probe, on the rank that owns it, and its faces with the sign that turns their areas
/// out of it.
pub type ProbeLocation = (Option<u32>, Vec<(u32, f64)>);

/// Points and the cells around them.
pub struct Probes {
    list: Vec<case::Probe>,
    /// Owned cell around each point, where that is this rank's.
    home: Vec<Option<u32>>,
    /// Faces of that cell and the sign that turns their areas out of it.
    walls: Vec<Vec<(u32, f64)>>,
    values: Vec<f64>,
    table: Table,
}

/// A point may lie this share of a cell's size outside of all cells: between cells
/// whose common face is not plane.
const GAP: f64 = 0.05;
/// Differences below this share of a cell's size are round-off.
const TIE: f64 = 1e-9;

impl Probes {
    /// Finds the cells. Collective.
    ///
    /// # Errors
    /// A point outside of the grid.
    pub fn new<G: Gas<N>, const N: usize>(
        list: &[case::Probe],
        solver: &Solver<G, N>,
    ) -> Result<Self, Fault> {
        let columns: Vec<String> = list
            .iter()
            .flat_map(|p| ["p_pa", "u_m_s", "v_m_s", "w_m_s", "t_k"].map(|c| format!("{}_{c}", p.name)))
            .collect();
        let n = list.len();
        let mut probes = Self {
            list: list.to_vec(),
            home: vec![None; n],
            walls: vec![Vec::new(); n],
            values: vec![0.0; n * WIDTH],
            table: Table::new("probes.csv", &columns),
        };
        for k in 0..n {
            let off = probes.find(k, solver);
            if off > GAP {
                let p = &probes.list[k];
                return Err(Fault::new(format!(
                    "the probe \"{}\" at {:?} m is outside the flow grid; move it inside (positions are in the falling frame)",
                    p.name, p.position_m
                )));
            }
        }
        Ok(probes)
    }

    /// Finds the cell around point `k`: returns how far outside of it the point lies,
    /// in shares of its size. Collective.
    fn find<G: Gas<N>, const N: usize>(&mut self, k: usize, s: &Solver<G, N>) -> f64 {
        let (x, n) = (Vec3::from(self.list[k].position_m), s.topology.n_owned);
        let mut outside = vec![f64::NEG_INFINITY; n];
        s.topology.for_each_side(|f, c, sign| {
            if c < n {
                outside[c] = outside[c].max(excess(s, f, sign, x) / s.metrics.size[c]);
            }
        });
        let comm = s.comm();
        let least = comm.min(outside.iter().copied().fold(f64::INFINITY, f64::min));
        // Of the cells that share an edge with the point the lowest, on any number of ranks.
        let global = |c: usize| s.topology.numbering.global[c];
        let around = (0..n).filter(|&c| outside[c] <= least + TIE).min_by_key(|&c| global(c));
        let all = comm.all_gather_u64(around.map_or(u64::MAX, global));
        let best = around.filter(|&c| all.iter().all(|g| *g >= global(c)));
        self.home[k] = best.map(|c| c as u32);
        self.walls[k].clear();
        if let Some(best) = best {
            let walls = &mut self.walls[k];
            s.topology.for_each_side(|f, c, sign| {
                if c == best {
                    walls.push((f as u32, sign));
                }
            });
        }
        least
    }

    /// Cell around each probe and its faces: they stay as long as they serve.
    pub fn save_state(&self) -> Vec<ProbeLocation> {
        self.home.iter().copied().zip(self.walls.iter().cloned()).collect()
    }

    /// Takes up a [`Probes::save_state`] of the same part of the grid.
    pub fn restore_state(&mut self, memory: Vec<ProbeLocation>) {
        if memory.len() == self.list.len() {
            (self.home, self.walls) = memory.into_iter().unzip();
        }
    }

    /// Values after a window, a row of `probes.csv`. Collective.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn record<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        time: f64,
        moved: bool,
        folder: &Path,
    ) -> Result<(), Fault> {
        if moved {
            let lost = |k: usize| {
                let Some(c) = self.home[k] else { return 0 };
                let reach = GAP * solver.metrics.size[c as usize];
                let x = Vec3::from(self.list[k].position_m);
                u64::from(self.walls[k].iter().any(|&(f, sign)| excess(solver, f as usize, sign, x) > reach))
            };
            let mut lost: Vec<u64> = (0..self.list.len()).map(lost).collect();
            solver.comm().sum_u64(&mut lost);
            for k in (0..lost.len()).filter(|&k| lost[k] > 0) {
                // A wall may have passed over it: then the nearest cell speaks.
                self.find(k, solver);
            }
        }
        self.sample(solver);
        self.table.row(solver.comm(), folder, time, &self.values)
    }

    /// The values of all probes, on every rank: `[probes][5]`. Collective.
    pub fn sample<G: Gas<N>, const N: usize>(&mut self, solver: &Solver<G, N>) -> &[f64] {
        self.values.fill(0.0);
        let air = &solver.settings.air;
        for (k, home) in self.home.iter().enumerate() {
            let Some(c) = home.map(|c| c as usize) else { continue };
            let d = Vec3::from(self.list[k].position_m) - solver.metrics.centre(c);
            let q = gradient::extrapolated(&solver.q[c], &solver.gradient[c], &d);
            let u = velocity(&q) - solver.scheme.frame;
            let t = (air.pressure() + q[0]) / (air.gas_constant * solver.spatial.gas.density(&q));
            self.values[k * WIDTH..][..WIDTH].copy_from_slice(&[q[0], u[0], u[1], u[2], t]);
        }
        solver.comm().sum_slice(&mut self.values);
        &self.values
    }
}

/// How far `x` lies beyond face `f`, m, where `sign` turns its area out of the cell.
fn excess<G: Gas<N>, const N: usize>(s: &Solver<G, N>, f: usize, sign: f64, x: Vec3) -> f64 {
    let face = &s.metrics.faces[f];
    sign * face.area.dot(&(x - s.metrics.face_centre(&s.topology, f))) / face.magnitude()
}
