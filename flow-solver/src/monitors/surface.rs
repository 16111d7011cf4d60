//! Pressure on both sides of the canopy.

use std::collections::HashMap;
use std::path::Path;

use channel::Fault;
use comm::Halo;
use mesh::vtk::{Values, write_surface};

use super::pieces::Pieces;
use crate::loads::Loads;
use crate::physics::Gas;
use crate::solver::Solver;

/// The series `canopy_air.pvd`.
pub struct Surface {
    every: u64,
    halo: Halo,
    /// Pressure inside and outside of each local canopy face, Pa.
    sides: Vec<[f64; 2]>,
    pieces: Pieces,
}

impl Surface {
    /// A picture every so many windows. Collective.
    pub fn new<G: Gas<N>, const N: usize>(every: u32, solver: &Solver<G, N>) -> Self {
        let canopy = &solver.topology.canopy;
        Self {
            every: u64::from(every),
            halo: Halo::new(solver.comm(), canopy),
            sides: vec![[0.0; 2]; canopy.n_local()],
            pieces: Pieces::new("canopy_air"),
        }
    }

    /// Gauge pressure inside and outside of each owned canopy face, Pa. Collective.
    pub fn sides<G: Gas<N>, const N: usize>(&mut self, solver: &Solver<G, N>) -> &[[f64; 2]] {
        let (on, t) = (solver.domain(), &solver.topology);
        self.sides.fill([0.0; 2]);
        for side in t.sides().filter(|s| s.canopy != u32::MAX) {
            let p = solver.spatial.wall_pressure(&on, &solver.q, &solver.gradient, side);
            // The face's area points from inside to outside.
            self.sides[side.canopy as usize][usize::from(side.sign < 0.0)] += p;
        }
        if t.one_sided {
            for side in t.sides().filter(|s| s.canopy != u32::MAX) {
                self.sides[side.canopy as usize][usize::from(side.sign > 0.0)] =
                    solver.settings.ambient_pressure;
            }
        }
        self.halo.accumulate(self.sides.as_flattened_mut(), 2);
        &self.sides[..t.canopy.n_owned]
    }

    /// Adds a picture where one is due. Collective.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn record<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        loads: &Loads,
        done: u64,
        time: f64,
        folder: &Path,
    ) -> Result<(), Fault> {
        if !done.is_multiple_of(self.every) {
            return Ok(());
        }
        self.sides(solver);
        let t = &solver.topology;
        let n = t.canopy.n_owned;
        let (mut points, mut place) = (Vec::new(), HashMap::new());
        let faces: Vec<[u32; 4]> = t.canopy_face[..n]
            .iter()
            .map(|&f| {
                t.face_nodes[f as usize].map(|node| {
                    *place.entry(node).or_insert_with(|| {
                        points.push(solver.nodes[node as usize].into());
                        points.len() as u32 - 1
                    })
                })
            })
            .collect();
        let inside: Vec<f64> = self.sides[..n].iter().map(|s| s[0]).collect();
        let outside: Vec<f64> = self.sides[..n].iter().map(|s| s[1]).collect();
        let jump: Vec<f64> = loads.faces[..n].iter().map(|l| l[0]).collect();
        let shear: Vec<mesh::Point> = loads.faces[..n].iter().map(|l| [l[1], l[2], l[3]]).collect();
        self.pieces.push(solver.comm(), folder, done, time, n > 0, |file| {
            let fields = [
                ("pressure_inside_pa", Values::F64(&inside)),
                ("pressure_outside_pa", Values::F64(&outside)),
                ("pressure_jump_pa", Values::F64(&jump)),
                ("shear_traction_pa", Values::Vector(&shear)),
            ];
            write_surface(file, &points, &faces, &[], &fields)
        })
    }
}
