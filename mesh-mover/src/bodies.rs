//! Rigid bodies of a stage: the nodes of their patches follow a prescribed motion.
//!
//! For the motion of the grid they are further interface nodes, after those of the canopy.

use std::ops::Range;

use case::{BodyMotion, RigidMotion};
use channel::Fault;
use mesh::{FlowGrid, Point};

/// The bodies that a stage moves.
#[derive(Debug, Default)]
pub struct Bodies {
    /// Grid nodes, body by body.
    nodes: Vec<u32>,
    faces: Vec<[u32; 4]>,
    bodies: Vec<Body>,
    /// Positions of the nodes at the start of the stage, m.
    start: Vec<Point>,
}

#[derive(Debug)]
struct Body {
    motion: RigidMotion,
    /// Its nodes.
    nodes: Range<usize>,
    /// First patch, for messages.
    patch: String,
}

impl Bodies {
    /// The bodies of the patches of `grid` that `motions` name.
    ///
    /// # Errors
    /// An invalid formula, a patch without faces, a node of two bodies.
    pub fn new(motions: &[BodyMotion], grid: &FlowGrid) -> Result<Self, Fault> {
        let mut this = Self::default();
        let mut body_of: Vec<Option<usize>> = vec![None; grid.coords.len()];
        for (k, motion) in motions.iter().enumerate() {
            let name = || motion.patches.join("\", \"");
            let faces: Vec<_> = grid.faces_of(&motion.patches).map(|f| grid.boundary[f].1).collect();
            if faces.is_empty() && motion.patches.iter().any(|p| p == case::CANOPY) {
                // The coupler moves the canopy.
                continue;
            }
            if faces.is_empty() {
                return Err(Fault::new(format!(
                    "the flow grid has no face of the patches \"{}\" that a [[stage.body_motion]] moves",
                    name()
                )));
            }
            let first = this.nodes.len();
            for &node in faces.iter().flatten() {
                match body_of[node as usize].replace(k) {
                    None => this.nodes.push(node),
                    Some(same) if same == k => {}
                    Some(other) => {
                        return Err(Fault::new(format!(
                            "the patches \"{}\" and \"{}\" share grid node {node}, but move by two [[stage.body_motion]]: name \
                             them in one, or leave a gap between them",
                            this.bodies[other].patch,
                            name()
                        )));
                    }
                }
            }
            if let Some(node) = grid.canopy_nodes.iter().find(|a| body_of[**a as usize] == Some(k)) {
                return Err(Fault::new(format!(
                    "the patches \"{}\" that a [[stage.body_motion]] moves share grid node {node} with the canopy: leave a gap \
                     between body and canopy",
                    name()
                )));
            }
            this.faces.extend(faces);
            let motion = motion.compiled().map_err(Fault::new)?;
            this.bodies.push(Body { motion, nodes: first..this.nodes.len(), patch: name() });
        }
        Ok(this)
    }

    /// As [`Bodies::new`], in a stage that starts with the nodes of `grid` where they are.
    ///
    /// # Errors
    /// As [`Bodies::new`].
    pub fn at_rest(motions: &[BodyMotion], grid: &FlowGrid) -> Result<Self, Fault> {
        let mut this = Self::new(motions, grid)?;
        this.start = this.nodes.iter().map(|&n| grid.coords[n as usize]).collect();
        Ok(this)
    }

    /// Number of nodes of all bodies.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The grid whose interface nodes and faces are those of the canopy, then those of the bodies.
    pub fn add_to(&self, mut grid: FlowGrid) -> FlowGrid {
        grid.canopy_nodes.extend(&self.nodes);
        grid.canopy_faces.extend(&self.faces);
        grid
    }

    /// Sets where the nodes are at the start of the stage, from positions of all interface nodes, m.
    pub(crate) fn set_start(&mut self, interface: &[f64]) {
        let first = interface.len() - 3 * self.nodes.len();
        self.start = interface[first..].as_chunks::<3>().0.to_vec();
    }

    /// Positions at `t` (s since the start of the stage), m, into the last entries of `interface`.
    ///
    /// # Errors
    /// A motion that is not finite then.
    pub(crate) fn positions(&self, t: f64, interface: &mut [f64]) -> Result<(), Fault> {
        let first = interface.len() - 3 * self.nodes.len();
        let nodes = interface[first..].as_chunks_mut::<3>().0;
        for body in &self.bodies {
            let pose = body.motion.at(t);
            if !pose.is_finite() {
                return Err(Fault::new(format!(
                    "the motion of the body \"{}\" at t = {t} s is not a finite number (displacement {:?} m, angle {} rad): \
                     change its formulas in [[stage.body_motion]]",
                    body.patch, pose.displacement, pose.angle
                )));
            }
            for (x, start) in nodes[body.nodes.clone()].iter_mut().zip(&self.start[body.nodes.clone()]) {
                *x = pose.apply(*start);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::{Patch, block_grid};

    fn motion(patches: &[&str]) -> BodyMotion {
        let patches = patches.iter().map(|p| (*p).to_owned()).collect();
        BodyMotion { patches, displacement_m: Some(["t", "0", "0"].map(String::from)), rotation: None }
    }

    #[test]
    fn bodies_have_the_nodes_of_their_patches_once_and_share_none() {
        let grid = block_grid([5; 3], [0.0; 3], [5.0; 3], [Patch::FarField; 6], [2..3, 2..3, 2..3]);
        let mut body = Bodies::new(&[motion(&["body"])], &grid).expect("a body");
        let moved = body.add_to(grid.clone());
        assert_eq!((body.nodes.len(), moved.canopy_faces.len(), body.is_empty()), (8, 6, false));
        let start: Vec<f64> = moved.canopy_nodes.iter().flat_map(|&a| grid.coords[a as usize]).collect();
        body.set_start(&start);
        let mut x = start.clone();
        body.positions(0.5, &mut x).expect("finite");
        assert!(x.iter().zip(&start).enumerate().all(|(i, (x, s))| x - s == [0.5, 0.0, 0.0][i % 3]));
        let two = Bodies::new(&[motion(&["left"]), motion(&["front"])], &grid).unwrap_err();
        assert!(two.message.contains("share grid node"), "{}", two.message);
        let none = Bodies::new(&[motion(&["ship"])], &grid).unwrap_err();
        assert!(none.message.contains("no face of the patches \"ship\""), "{}", none.message);
        assert!(Bodies::new(&[], &grid).expect("none").is_empty());
    }
}
