//! The state of a step, and the file that keeps it: independent of the number of ranks.

use std::path::Path;

use archive::codec::compact;
use archive::hash::fnv1a;
use channel::Fault;
use comm::Comm;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::geometry::vec3::Vec3;
use crate::topology::Topology;

const KIND: [u8; 8] = *b"RIPFLOW\0";
const VERSION: u32 = 3;

/// State at an accepted time level.
#[derive(Clone, Debug)]
pub struct TimeLevel<const N: usize> {
    /// Unknowns of local cells.
    pub q: Vec<[f64; N]>,
    /// Volumes of local cells, m3. Empty on a grid at rest.
    pub volume: Vec<f64>,
    /// Node positions, m. Empty on a grid at rest.
    pub nodes: Vec<Vec3>,
}

/// State of optional effects (wind shear, transported turbulence).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Extras {
    /// Height of the falling frame's origin above ground, m, where wind changes with height.
    pub height: Option<f64>,
    /// Working variable of transported turbulence `[cells]`, m2/s, newest time level first.
    pub turbulence: Option<[Vec<f64>; 2]>,
}

/// Saved state: two time levels, in global order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved {
    equations: u32,
    cells: u64,
    nodes: u64,
    last_dt: f64,
    first_order_steps: u32,
    /// Unknowns `[cells][equations]`, newest time level first.
    q: [Vec<f64>; 2],
    /// Node positions `[nodes][3]`, m.
    x: [Vec<f64>; 2],
    /// Rhie-Chow flux of each face at two time levels `[faces][2]`, kg/(m2 s).
    rhie_chow_fluxes: Vec<f64>,
    extras: Extras,
}

impl Saved {
    /// Velocities of the cells relative to the ground at the newest time level, m/s.
    pub fn velocities(&self) -> Vec<Vec3> {
        let rows = self.q[0].chunks_exact(self.equations as usize);
        rows.map(|q| Vec3::new(q[1], q[2], q[3])).collect()
    }

    /// Positions of the nodes in the falling frame at the newest time level, m.
    pub fn positions(&self) -> Vec<Vec3> {
        self.x[0].chunks_exact(3).map(Vec3::from_column_slice).collect()
    }

    /// Whether it is of a grid with `totals` cells and nodes, and of numbers only.
    fn check(&self, totals: (usize, usize)) -> Result<(), String> {
        if (self.cells, self.nodes) != (totals.0 as u64, totals.1 as u64) {
            let found = format!("{} cells and {} nodes", self.cells, self.nodes);
            return Err(format!("has {found}, this stage's grid {} and {}", totals.0, totals.1));
        }
        let equations = self.equations as usize;
        if !(4..=5).contains(&equations) || self.q.iter().any(|q| q.len() != equations * totals.0) {
            return Err(format!("has {equations} equations and {} unknowns", self.q[0].len()));
        }
        let eddies = self.extras.turbulence.iter().flatten();
        if self.x.iter().any(|x| x.len() != 3 * totals.1) || eddies.clone().any(|t| t.len() != totals.0) {
            return Err("has vectors of a wrong length".into());
        }
        let single = [self.last_dt, self.extras.height.unwrap_or_default()];
        let vectors = self.q.iter().chain(&self.x).chain([&self.rhie_chow_fluxes]).chain(eddies).flatten();
        if !vectors.chain(&single).all(|x| x.is_finite()) {
            return Err("holds values that are not finite numbers".into());
        }
        if self.rhie_chow_fluxes.iter().any(|x| x.abs() > f64::from(f32::MAX)) {
            return Err("holds Rhie-Chow fluxes beyond single precision".into());
        }
        // A step of second order needs one before it.
        if self.last_dt < 0.0 || (self.last_dt == 0.0 && self.first_order_steps == 0) {
            return Err(format!("has a last time step of {} s; it must be positive", self.last_dt));
        }
        Ok(())
    }
}

/// The value in a file of the layout before archives: its kind and `version`, the value in compact form, a checksum.
pub(crate) fn load_legacy<T: DeserializeOwned>(bytes: &[u8], kind: [u8; 8], version: u32) -> Option<T> {
    let (body, sum) = bytes.split_last_chunk::<8>()?;
    if fnv1a(body.iter().copied()) != u64::from_le_bytes(*sum) {
        return None;
    }
    let (head, value): ((u64, u32), T) = compact::decode(body).ok()?;
    (head == (u64::from_le_bytes(kind), version)).then_some(value)
}

/// Rows of all ranks in global order, on every rank.
pub(crate) fn gather<const W: usize>(
    comm: &Comm,
    global: &[u64],
    rows: &[[f64; W]],
    total: usize,
) -> Vec<f64> {
    let index = comm.all_gather_var(global);
    let values = comm.all_gather_var(rows.as_flattened());
    let mut all = vec![0.0; total * W];
    for (&g, row) in index.iter().zip(values.chunks_exact(W)) {
        all[g as usize * W..(g as usize + 1) * W].copy_from_slice(row);
    }
    all
}

/// Part of the state on one rank, for [`save`].
#[derive(Clone, Copy, Debug)]
pub struct RankState<'a, const N: usize> {
    /// Cells, faces and nodes of the rank.
    pub topology: &'a Topology,
    /// Unknowns of local cells at the last two accepted time levels, newest first.
    pub q: [&'a [[f64; N]]; 2],
    /// Positions of local nodes at the same time levels, m.
    pub nodes: [&'a [Vec3]; 2],
    /// Length of the last step, s (0: none).
    pub last_dt: f64,
    /// First-order steps still to take.
    pub first_order_steps: u32,
    /// Rhie-Chow flux of each local face at two time levels, newest first, kg/(m2 s).
    pub rhie_chow_fluxes: &'a [[f64; 2]],
    /// State of optional effects on all ranks.
    pub extras: &'a Extras,
}

/// Writes the shares of all ranks. `totals`: cells and nodes of the whole grid. Collective.
///
/// # Errors
/// The file cannot be written; the same error on every rank.
pub fn save<const N: usize>(
    file: &Path,
    comm: &Comm,
    share: &RankState<'_, N>,
    totals: (usize, usize),
) -> Result<(), Fault> {
    let (cells, nodes) = totals;
    let topology = share.topology;
    let n = topology.n_owned;
    let q = share.q.map(|q| gather(comm, topology.numbering.owned(), &q[..n], cells));
    let x = share.nodes.map(|x| {
        let x: Vec<[f64; 3]> = x.iter().map(|x| (*x).into()).collect();
        gather(comm, &topology.node_global, &x, nodes)
    });
    let faces: Vec<u64> = topology.face_global.iter().map(|&f| u64::from(f)).collect();
    let count = comm.max(faces.iter().fold(0.0, |m, &f| (f as f64 + 1.0).max(m))) as usize;
    let rhie_chow_fluxes = gather(comm, &faces, share.rhie_chow_fluxes, count);
    let mut outcome = Ok(());
    if comm.is_root() {
        let saved = Saved {
            equations: N as u32,
            cells: cells as u64,
            nodes: nodes as u64,
            last_dt: share.last_dt,
            first_order_steps: share.first_order_steps,
            q,
            x,
            rhie_chow_fluxes,
            extras: share.extras.clone(),
        };
        outcome = write(file, &saved);
    }
    if comm.all(outcome.is_ok()) {
        return Ok(());
    }
    Err(outcome.err().unwrap_or_else(|| Fault::new(format!("rank 0 could not write {}", file.display()))))
}

fn write(file: &Path, saved: &Saved) -> Result<(), Fault> {
    archive::save(file, KIND, VERSION, saved).map(|_| ()).map_err(|e| Fault::new(format!("flow state: {e}")))
}

/// The part of a saved state on one rank.
pub struct Restored<const N: usize> {
    /// Newest first; ghosts are included, volumes are not set.
    pub previous: [TimeLevel<N>; 2],
    /// Length of the last step, s.
    pub last_dt: f64,
    /// First-order steps still to take.
    pub first_order_steps: u32,
    /// Rhie-Chow flux of each local face at two time levels, newest first, kg/(m2 s).
    pub rhie_chow_fluxes: Vec<[f32; 2]>,
    /// State of optional effects.
    pub extras: Extras,
}

/// A cell's unknowns from those of a stage with or without energy equation: air that was
/// isothermal has the undisturbed temperature, hence the same density; a stage without the
/// equation drops the difference.
fn unknowns<const N: usize>(saved: &[f64]) -> [f64; N] {
    std::array::from_fn(|v| saved.get(v).copied().unwrap_or(0.0))
}

/// Reads a whole saved state of a grid with `totals` cells and nodes, of a stage with or without
/// energy equation.
///
/// # Errors
/// A file that is missing, damaged, of another version or of another grid, or that holds values that are not finite.
pub fn read(file: &Path, totals: (usize, usize)) -> Result<Saved, Fault> {
    let fail = |e: archive::Error| Fault::new(format!("flow state: {e}"));
    let version_2 = |bytes: &[u8]| load_legacy(bytes, KIND, 2);
    let saved: Saved = archive::load_or_earlier(file, KIND, VERSION, version_2).map_err(fail)?;
    saved.check(totals).map_err(|what| fail(archive::Error::content(file, format!("it {what}"))))?;
    Ok(saved)
}

/// Reads this rank's part of a saved state, of a stage with or without energy equation.
///
/// # Errors
/// As for [`read`], and a file with fewer faces than the grid.
pub fn load<const N: usize>(
    file: &Path,
    topology: &Topology,
    totals: (usize, usize),
) -> Result<Restored<N>, Fault> {
    let saved = read(file, totals)?;
    let equations = saved.equations as usize;
    let faces = topology.face_global.iter().map(|&f| 2 * f as usize);
    if faces.clone().max().is_some_and(|f| f + 1 >= saved.rhie_chow_fluxes.len()) {
        let unfit = archive::Error::content(file, "it has fewer faces than this stage's grid");
        return Err(Fault::new(format!("flow state: {unfit}")));
    }
    let rhie_chow_fluxes =
        faces.map(|f| [saved.rhie_chow_fluxes[f] as f32, saved.rhie_chow_fluxes[f + 1] as f32]).collect();
    let row = |g: u64, k: usize| unknowns(&saved.q[k][g as usize * equations..][..equations]);
    let node = |g: u64, k: usize| Vec3::from_column_slice(&saved.x[k][g as usize * 3..][..3]);
    let past = [0, 1].map(|k| TimeLevel {
        q: topology.numbering.global.iter().map(|&g| row(g, k)).collect(),
        volume: vec![0.0; topology.n_local()],
        nodes: topology.node_global.iter().map(|&g| node(g, k)).collect(),
    });
    Ok(Restored {
        previous: past,
        last_dt: saved.last_dt,
        first_order_steps: saved.first_order_steps,
        rhie_chow_fluxes,
        extras: saved.extras,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legacy_files_are_read() {
        let extras = Extras { height: Some(12.5), turbulence: Some([vec![1.0], vec![-0.0]]) };
        let mut bytes = compact::encode(&((u64::from_le_bytes(KIND), 2u32), &extras));
        let sum = fnv1a(bytes.iter().copied());
        bytes.extend(sum.to_le_bytes());
        assert_eq!(load_legacy(&bytes, KIND, 2), Some(extras));
        assert_eq!(load_legacy::<Extras>(&bytes, KIND, 3), None);
        bytes[20] ^= 1;
        assert_eq!(load_legacy::<Extras>(&bytes, KIND, 2), None);
    }
}
