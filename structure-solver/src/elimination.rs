//! Nonlinear elimination: where a few nodes carry most of the imbalance, they are
//! brought to balance among themselves before the whole is solved.
//!
//! Stiff light fabric moves in folds: along a narrow front elements turn by several
//! degrees in a step while the rest hardly deforms. Newton's method for the whole then
//! spends most of its steps on the front (an unbalanced nonlinearity). With the
//! displacements of all other nodes held, the front alone is a small problem of the
//! same kind, cheap to solve by the same method; the steps for the whole that follow
//! start where their quadratic convergence holds (Lanzkron, Rose and Wilkes, SIAM J.
//! Sci. Comput. 17, 1996, 538-559; Cai and Li, SIAM J. Sci. Comput. 33, 2011,
//! 746-762). It changes where Newton starts, never what it converges to. The nodes are
//! chosen and balanced across ranks: a fold that crosses a border is one front.

use linalg::{KrylovError, KrylovParams, Subsystem, SubsystemError};

use crate::system::System;

/// A node is eliminated where its imbalance exceeds this share of the mean load on a
/// node ...
const OF_LOAD: f64 = 0.01;
/// ... and this multiple of the mean imbalance: where the residual is uniform, the system to solve is
/// the whole one.
const OF_MEAN: f64 = 2.0;
/// Rings of neighbours that move along, so that the imbalance can spread.
const RINGS: usize = 2;
/// Share of the nodes beyond which the whole is the better system to solve.
const MOST: f64 = 0.4;
/// Rounds between two steps for the whole at most.
const ROUNDS: usize = 12;

/// Nodes to eliminate, and the solver for them.
pub(crate) struct Elimination {
    /// Whether a node is part of it, shape `[n_local]`, with current ghosts.
    pub(crate) active: Vec<bool>,
    /// The owned nodes that do.
    rows: Vec<u32>,
    /// Owned nodes that share an element with a ghost.
    border: Vec<u32>,
    /// Carries `active` from rank to rank.
    flags: Vec<f32>,
    /// Nodes of all ranks.
    n_all: f64,
    /// Owned nodes whose balance a correction reaches, shape `[n_local]`.
    reached: Vec<bool>,
    subsystem: Subsystem<3>,
    /// Rounds between two steps for the whole at most.
    pub(crate) most_rounds: usize,
    /// Rounds so far.
    pub(crate) rounds: u64,
}

impl Elimination {
    /// Collective.
    pub(crate) fn new(system: &System) -> Self {
        let (n, n_local) = (system.model.n_owned(), system.model.n_local());
        let by_ghost =
            |i: &u32| system.matrix.cols()[system.matrix.row(*i as usize)].last() >= Some(&(n as u32));
        Self {
            active: vec![false; n_local],
            reached: vec![false; n_local],
            rows: Vec::new(),
            border: (0..n as u32).filter(by_ghost).collect(),
            flags: vec![0.0; n_local],
            n_all: system.comm().sum(n as f64),
            subsystem: Subsystem::new(&system.model.halo),
            most_rounds: ROUNDS,
            rounds: 0,
        }
    }

    /// Chooses nodes by their imbalance `g` (N), with the norms of imbalance and load
    /// over all ranks. `false` if there are none, or too many. Collective.
    pub(crate) fn choose(&mut self, system: &System, g: &[f64], norm: f64, load: f64) -> bool {
        let n = system.model.n_owned();
        let level = (OF_LOAD * load).max(OF_MEAN * norm) / self.n_all.sqrt();
        self.rows.clear();
        self.active.fill(false);
        for (i, g) in g.as_chunks::<3>().0[..n].iter().enumerate() {
            if g[0] * g[0] + g[1] * g[1] + g[2] * g[2] > level * level {
                self.active[i] = true;
                self.rows.push(i as u32);
            }
        }
        let mut ring = 0..self.rows.len();
        for _ in 0..RINGS {
            self.exchange(system);
            for &i in &self.border {
                let columns = &system.matrix.cols()[system.matrix.row(i as usize)];
                let ghosts = columns.iter().rev().take_while(|&&j| j as usize >= n);
                if !self.active[i as usize] && ghosts.into_iter().any(|&j| self.active[j as usize]) {
                    self.rows.push(i);
                }
            }
            for k in ring.clone() {
                for s in system.matrix.row(self.rows[k] as usize) {
                    let j = system.matrix.cols()[s];
                    if (j as usize) < n && !self.active[j as usize] {
                        self.active[j as usize] = true;
                        self.rows.push(j);
                    }
                }
            }
            // Those that a ghost brought in; some of them a neighbour here did too.
            self.rows[ring.end..].iter().for_each(|&i| self.active[i as usize] = true);
            ring = ring.end..self.rows.len();
        }
        self.exchange(system);
        let chosen = self.active[..n].iter().filter(|active| **active).count();
        let chosen = system.comm().sum(chosen as f64);
        chosen > 0.0 && chosen < MOST * self.n_all
    }

    /// Brings the ghosts of `active` up to date.
    fn exchange(&mut self, system: &System) {
        if system.comm().size() == 1 {
            return;
        }
        for (flag, active) in self.flags.iter_mut().zip(&self.active) {
            *flag = f32::from(u8::from(*active));
        }
        system.model.halo.exchange(&mut self.flags, 1);
        for (active, flag) in self.active.iter_mut().zip(&self.flags) {
            *active = *flag > 0.0;
        }
    }

    /// Newton correction `du` (m) of the chosen nodes for the imbalance `g`, zero
    /// elsewhere. The matrix holds their rows. `false` where the solve broke down.
    /// Collective.
    pub(crate) fn correct(&mut self, system: &System, rhs: &[f64], du: &mut [f64]) -> bool {
        du.fill(0.0);
        let params = KrylovParams { rel_tol: 1e-2, max_iterations: 50, restart: 50, ..Default::default() };
        match self.subsystem.solve(&system.matrix, &self.active, rhs, du, params) {
            // The next round corrects what is left.
            Ok(_) | Err(SubsystemError::Krylov(KrylovError::NotConverged { .. })) => true,
            Err(_) => false,
        }
    }

    /// The owned nodes that moved by `du`, shape `[n_local][3]` with current ghosts, or
    /// share an element with one that did.
    pub(crate) fn reach(&mut self, system: &System, du: &[f64]) -> &[bool] {
        let du = du.as_chunks::<3>().0;
        for i in 0..system.model.n_owned() {
            let columns = &system.matrix.cols()[system.matrix.row(i)];
            self.reached[i] = columns.iter().any(|&j| du[j as usize] != [0.0; 3]);
        }
        &self.reached
    }
}

#[cfg(test)]
mod tests;
