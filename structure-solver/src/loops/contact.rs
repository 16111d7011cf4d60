//! Contact of fabric with itself: nodes against faces, by a penalty.
//!
//! A node $`P`$ within the thickness $`h`$ of a triangle that it is no corner of is pushed away
//! along the normal $`n`$, on the side on which it came near ($`s = \pm 1`$):
//! $`f = k\,(h - s\,n\cdot(P - Q))\,s\,n`$ with $`Q`$ the foot of $`P`$ on the triangle, which takes
//! $`-f`$ by its barycentric coordinates. Both forces lie on one line, so momentum and moment of
//! momentum stay; they are the gradient of $`\tfrac12 k (h - s d)^2`$ (Wriggers, Computational
//! Contact Mechanics, 2006, chapter 5).
//!
//! Pairs are found with a hash of boxes of the size of an edge, once for each step, with a
//! margin that nodes cannot cross within it. A pair keeps its side until it is out of reach.
//!
//! A pair begins without force: where the node is nearer than $`h`$ when the pair is found, as edges that lie on each
//! other in the cut, its own $`h`$ is that distance, so that no energy appears; it grows again as the node moves away.
//! A pressed node that leaves a triangle for the next one of the sheet keeps its side and its force.
//!
//! The tangent holds the blocks of nodes with themselves; those between the two sheets lie
//! outside of the matrix's pattern, and Newton's method takes more steps for it.

use std::collections::HashMap;

use super::{Configuration, ELSEWHERE, ElementLoop, FaceLoad};
use crate::flat::{Block, add_at, add_block, at};
use crate::model::Model;
use mesh::geometry::{Mat3, Vec3};

/// A node near a triangle.
#[derive(Clone, Copy, Debug)]
struct Pair {
    node: u32,
    triangle: u32,
    /// On which side of it the node is.
    side: f64,
    /// Distance that is kept, m.
    thickness: f64,
}

/// Share of a triangle's height by which a projection may lie beyond an edge.
const BEYOND: f64 = 0.02;
/// Motion of a node relative to the mean of all after which pairs are sought again, in thicknesses: of a reach of two, one is left where two nodes
/// have come towards each other.
const MARGIN: f64 = 0.35;

/// Extent of a triangle in edges of the unstressed mesh beyond which it is in contact with nothing: torn in a solve that fails.
const TORN: f64 = 30.0;

/// Numbers of a saved pair.
const NUMBERS: usize = 4;

/// Contact of all membrane elements of a program of one rank.
pub struct Contact {
    triangles: Vec<[u32; 3]>,
    /// Nodes of the fabric.
    nodes: Vec<u32>,
    /// Slots of the nodes' own blocks.
    slots: Vec<u32>,
    thickness: f64,
    stiffness: f64,
    pairs: Vec<Pair>,
    /// Pairs of each node, now and at the search before.
    known: HashMap<u32, Vec<Pair>>,
    before: HashMap<u32, Vec<Pair>>,
    /// Positions at the last search, m; empty before the first.
    searched: Vec<f64>,
    /// Pairs and positions of the last search at the accepted state.
    accepted: (Vec<Pair>, Vec<f64>),
    cells: HashMap<[i32; 3], Vec<u32>>,
    edge: f64,
}

/// A number that was kept as an index below `end`.
fn index(x: f64, end: usize) -> Option<usize> {
    (x >= 0.0 && x < end as f64 && x.fract() == 0.0).then_some(x as usize)
}

/// Distance of a node from a triangle, and the barycentric coordinates of its projection; `None` where that is outside.
#[inline(always)]
fn project(p: Vec3, t: &[Vec3; 3]) -> Option<(f64, Vec3, [f64; 3])> {
    let (e1, e2) = (t[1] - t[0], t[2] - t[0]);
    let area = e1.cross(&e2);
    let size = area.norm();
    if size == 0.0 {
        return None;
    }
    let n = area * (1.0 / size);
    let r = p - t[0];
    let b = r.cross(&e2).dot(&n) / size;
    let c = e1.cross(&r).dot(&n) / size;
    let a = 1.0 - b - c;
    // A little beyond the edges, so that no node slips between two triangles.
    let within = |x: f64| x > -BEYOND;
    (within(a) && within(b) && within(c)).then(|| (r.dot(&n), n, [a, b, c]))
}

impl Contact {
    /// Of the triangles of `model`, whose rank is the only one: distance that is kept (m) and
    /// stiffness of a node in contact (N/m).
    pub fn new(model: &Model, thickness: f64, stiffness: f64) -> Self {
        let triangles: Vec<[u32; 3]> = model.triangles.iter().map(|t| t.nodes).collect();
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let edge = triangles
            .iter()
            .flat_map(|t| (0..3).map(move |i| [t[i], t[(i + 1) % 3]]))
            .map(|[a, b]| (at(&model.reference, a as usize) - at(&model.reference, b as usize)).norm())
            .fold(0.0, f64::max);
        Self {
            triangles,
            nodes,
            slots: vec![ELSEWHERE; model.n_local()],
            thickness,
            stiffness,
            pairs: Vec::new(),
            known: HashMap::new(),
            before: HashMap::new(),
            searched: Vec::new(),
            accepted: Default::default(),
            cells: HashMap::new(),
            edge,
        }
    }

    fn corners(&self, t: usize, x: &[f64]) -> [Vec3; 3] {
        self.triangles[t].map(|n| at(x, n as usize))
    }

    fn cell(&self, x: Vec3) -> [i32; 3] {
        x.map(|v| (v / self.edge).floor() as i32).into()
    }

    /// Pairs in contact, each with its force on the node, normal, weights and penetration.
    fn active<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = (Pair, Vec3, [f64; 3], f64)> + 'a {
        self.pairs.iter().filter_map(move |p| {
            let (d, n, w) = project(at(x, p.node as usize), &self.corners(p.triangle as usize, x))?;
            let gap = p.thickness - p.side * d;
            (gap > 0.0).then(|| (*p, n * p.side, w, gap))
        })
    }

    /// The pair of a node with a triangle at a distance of `d`; `None` out of reach. One that was there keeps its side, also where it was pressed through,
    /// and its distance grows with that of the node up to the thickness.
    fn pair(&self, node: u32, t: usize, d: f64, x: &[f64]) -> Option<Pair> {
        let triangle = t as u32;
        let before = self.before.get(&node).map_or(&[][..], Vec::as_slice);
        let same = before.iter().find(|p| p.triangle == triangle);
        if d.abs() > 2.0 * self.thickness && same.is_none_or(|p| p.side * d > 0.0) {
            return None;
        }
        if let Some(p) = same {
            return Some(Pair { thickness: p.thickness.max((p.side * d).min(self.thickness)), ..*p });
        }
        let begins = Pair { node, triangle, side: d.signum(), thickness: self.thickness.min(d.abs()) };
        Some(before.iter().find_map(|p| self.continued(p, triangle, d, x)).unwrap_or(begins))
    }

    /// The pair of a pressed node that has left the triangle of `p` and lies over the next one, `triangle`, at a distance of `d`: with the same
    /// side and the same force, so that no energy appears.
    fn continued(&self, p: &Pair, triangle: u32, d: f64, x: &[f64]) -> Option<Pair> {
        let left = self.triangles[p.triangle as usize];
        let next = self.triangles[triangle as usize].iter().any(|n| left.contains(n));
        let (at, corners) = (at(x, p.node as usize), self.corners(p.triangle as usize, x));
        if !next || project(at, &corners).is_some() {
            return None;
        }
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).try_normalize(0.0)?;
        let gap = p.thickness - p.side * (at - corners[0]).dot(&normal);
        let thickness = p.side * d + gap;
        (gap > 0.0 && thickness >= 0.0).then(|| Pair {
            triangle,
            thickness: thickness.min(self.thickness),
            ..*p
        })
    }

    /// Whether a node has moved by more than the margin since the last search; motions of the whole fabric do not count.
    fn stale(&self, x: &[f64]) -> bool {
        if self.searched.len() != x.len() || self.nodes.is_empty() {
            return true;
        }
        let moved = |n: u32| at(x, n as usize) - at(&self.searched, n as usize);
        let mean = self.nodes.iter().map(|&n| moved(n)).sum::<Vec3>() / self.nodes.len() as f64;
        let most = (MARGIN * self.thickness).powi(2);
        // Not a number: stale.
        !self.nodes.iter().all(|&n| (moved(n) - mean).norm_squared() <= most)
    }

    /// Sum of the forces on nodes (N), one for each contact: their size.
    pub fn pressed(&self, x: &[f64]) -> f64 {
        self.active(x).map(|(_, _, _, gap)| self.stiffness * gap).sum()
    }
}

impl ElementLoop for Contact {
    fn finds_pairs(&self) -> bool {
        true
    }

    /// Nodes within two thicknesses of a triangle's plane, above or below it.
    fn find_pairs(&mut self, x: &[f64]) {
        let reach = 2.0 * self.thickness;
        if !self.stale(x) {
            return;
        }
        self.searched.clear();
        self.searched.extend_from_slice(x);
        // Boxes that the fabric has left, in a descent or a solve that fails, are dropped.
        if self.cells.len() > 4 * self.nodes.len() {
            self.cells.clear();
        }
        for list in self.cells.values_mut() {
            list.clear();
        }
        for &n in &self.nodes {
            let cell = self.cell(at(x, n as usize));
            self.cells.entry(cell).or_default().push(n);
        }
        std::mem::swap(&mut self.known, &mut self.before);
        self.known.clear();
        self.pairs.clear();
        for t in 0..self.triangles.len() {
            let corners = self.corners(t, x);
            let low =
                Vec3::from_fn(|i, _| corners.iter().map(|c| c[i]).fold(f64::INFINITY, f64::min) - reach);
            let high =
                Vec3::from_fn(|i, _| corners.iter().map(|c| c[i]).fold(f64::NEG_INFINITY, f64::max) + reach);
            let extent = (high - low).amax();
            if extent.is_nan() || extent > TORN * self.edge {
                continue;
            }
            // Of a node beyond the edges that `project` accepts, or pressed through.
            let slack = reach + BEYOND * self.edge;
            let near = |p: Vec3| (0..3).all(|i| p[i] >= low[i] - slack && p[i] <= high[i] + slack);
            let (low, high) = (self.cell(low), self.cell(high));
            for i in low[0]..=high[0] {
                for j in low[1]..=high[1] {
                    for k in low[2]..=high[2] {
                        let Some(list) = self.cells.get(&[i, j, k]) else { continue };
                        for &node in list {
                            let place = at(x, node as usize);
                            if !near(place) || self.triangles[t].contains(&node) {
                                continue;
                            }
                            let Some((d, _, _)) = project(place, &corners) else { continue };
                            let Some(pair) = self.pair(node, t, d, x) else { continue };
                            self.known.entry(node).or_default().push(pair);
                            self.pairs.push(pair);
                        }
                    }
                }
            }
        }
    }

    fn keep(&mut self) {
        self.accepted.0.clone_from(&self.pairs);
        self.accepted.1.clone_from(&self.searched);
    }

    fn rewind(&mut self) {
        self.pairs.clone_from(&self.accepted.0);
        self.searched.clone_from(&self.accepted.1);
        self.known.values_mut().for_each(Vec::clear);
        for p in &self.pairs {
            self.known.entry(p.node).or_default().push(*p);
        }
    }

    /// Pairs in their order, each with node, triangle, side and distance, then the positions at the search.
    fn save_state(&self) -> Vec<f64> {
        let (pairs, searched) = &self.accepted;
        let rows = pairs.iter().flat_map(|p| [f64::from(p.node), f64::from(p.triangle), p.side, p.thickness]);
        std::iter::once(pairs.len() as f64).chain(rows).chain(searched.iter().copied()).collect()
    }

    fn restore_state(&mut self, memory: &[f64]) -> Result<(), String> {
        let Some((count, rest)) = memory.split_first() else {
            return Err("contact has kept nothing".into());
        };
        let pairs = index(*count, rest.len() / NUMBERS + 1).ok_or("its pairs in contact are not there")?;
        let (rows, searched) = rest.split_at(NUMBERS * pairs);
        if !(searched.is_empty() || searched.len() == 3 * self.slots.len()) {
            return Err(format!("{} positions of {} nodes", searched.len(), self.slots.len()));
        }
        let pair = |r: &[f64; NUMBERS]| {
            let (node, triangle) = (index(r[0], self.slots.len())?, index(r[1], self.triangles.len())?);
            let sound = r[2].abs() == 1.0 && (0.0..=self.thickness).contains(&r[3]);
            let pair = Pair { node: node as u32, triangle: triangle as u32, side: r[2], thickness: r[3] };
            sound.then_some(pair)
        };
        let pairs: Option<Vec<Pair>> = rows.as_chunks::<NUMBERS>().0.iter().map(pair).collect();
        self.accepted = (pairs.ok_or("a pair in contact is none of this canopy")?, searched.to_vec());
        self.rewind();
        Ok(())
    }

    fn anchor(&mut self, _x: &[f64]) {}

    fn forces(&self, configuration: Configuration<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        for (p, n, w, gap) in self.active(configuration.at) {
            let f = n * (-self.stiffness * gap);
            add_at(out, p.node as usize, f);
            for (corner, w) in self.triangles[p.triangle as usize].iter().zip(w) {
                add_at(out, *corner as usize, f * (-w));
            }
        }
    }

    fn tangent(
        &self,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        self.forces(configuration, load, out);
        for (p, n, w, _) in self.active(configuration.at) {
            let k: Mat3 = n * (factor * self.stiffness) * n.transpose();
            add_block(&mut blocks[self.slots[p.node as usize] as usize], &k);
            for (corner, w) in self.triangles[p.triangle as usize].iter().zip(w) {
                add_block(&mut blocks[self.slots[*corner as usize] as usize], &(k * (w * w)));
            }
        }
    }

    fn energy(&self, x: &[f64]) -> f64 {
        self.active(x).map(|(_, _, _, gap)| 0.5 * self.stiffness * gap * gap).sum()
    }

    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        for &n in &self.nodes {
            self.slots[n as usize] = slot(n, n);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle and a node at a distance from it, none of whose directions is an axis.
    fn positions(distance: f64) -> Vec<f64> {
        let corners = [[0.2, -0.1, 0.3], [1.1, 0.2, 0.0], [0.4, 0.9, 0.5]].map(Vec3::from);
        let area = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let n = area * (1.0 / area.norm());
        let foot: Vec3 =
            Vec3::from_fn(|i, _| 0.5 * corners[0][i] + 0.3 * corners[1][i] + 0.2 * corners[2][i]);
        let node: Vec3 = Vec3::from_fn(|i, _| foot[i] + distance * n[i]);
        [corners[0], corners[1], corners[2], node].map(<[f64; 3]>::from).concat()
    }

    fn contact(triangles: Vec<[u32; 3]>, nodes: u32) -> Contact {
        Contact {
            triangles,
            nodes: (0..nodes).collect(),
            slots: (0..nodes).collect(),
            thickness: 0.05,
            stiffness: 700.0,
            pairs: Vec::new(),
            known: HashMap::new(),
            before: HashMap::new(),
            searched: Vec::new(),
            accepted: Default::default(),
            cells: HashMap::new(),
            edge: 1.0,
        }
    }

    /// The node came to this distance from out of contact.
    fn pressed(distance: f64) -> (Contact, Vec<f64>) {
        let mut contact = contact(vec![[0, 1, 2]], 4);
        contact.find_pairs(&positions(0.09 * distance.signum()));
        let x = positions(distance);
        contact.find_pairs(&x);
        (contact, x)
    }

    /// A node that is near when it is seen first is pressed only once it comes nearer, also where it lies on the triangle.
    #[test]
    fn pair_begins_without_force() {
        for distance in [0.02, -0.03, 1e-6] {
            let mut contact = contact(vec![[0, 1, 2]], 4);
            let x = positions(distance);
            contact.find_pairs(&x);
            assert_eq!((contact.pairs.len(), contact.energy(&x)), (1, 0.0), "{distance}");
            let nearer = positions(distance - 0.015 * distance.signum());
            assert!((contact.pressed(&nearer) - 700.0 * 0.015).abs() < 1e-9, "{distance}");
        }
    }

    /// A node that slides from one triangle of a sheet to the next keeps the force on it.
    #[test]
    fn sliding_node_keeps_side_and_distance() {
        let sheet = |node: [f64; 3]| -> Vec<f64> {
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], node].concat()
        };
        let mut contact = contact(vec![[0, 1, 2], [1, 3, 2]], 5);
        contact.find_pairs(&sheet([0.3, 0.3, 0.09]));
        contact.find_pairs(&sheet([0.3, 0.3, -0.01]));
        let there = sheet([0.7, 0.7, -0.01]);
        contact.find_pairs(&there);
        let pairs: Vec<_> = contact.pairs.iter().map(|p| (p.triangle, p.side, p.thickness)).collect();
        assert_eq!(pairs, [(1, 1.0, 0.05)]);
        assert!((contact.pressed(&there) - 700.0 * 0.06).abs() < 1e-10);
    }

    /// Solves of a window depend on their input alone: what one has found is forgotten by the next, and a saved state is that of the accepted window.
    #[test]
    fn rejected_solve_leaves_no_trace() {
        let mut contact = contact(vec![[0, 1, 2]], 4);
        contact.find_pairs(&positions(0.09));
        contact.find_pairs(&positions(0.04));
        contact.keep();
        let saved = contact.save_state();
        let pressed = |contact: &mut Contact| {
            contact.rewind();
            contact.find_pairs(&positions(0.01));
            contact.pressed(&positions(0.01))
        };
        let first = pressed(&mut contact);
        for wild in [0.3, -0.04, -0.3, 1e6, f64::NAN] {
            contact.find_pairs(&positions(wild));
        }
        assert_eq!(contact.save_state(), saved);
        assert_eq!(pressed(&mut contact), first);
        let mut resumed = super::tests::contact(vec![[0, 1, 2]], 4);
        resumed.restore_state(&saved).expect("its own state");
        assert_eq!(pressed(&mut resumed), first);
        assert!((first - 700.0 * 0.04).abs() < 1e-9, "{first}");
    }

    /// The distance that a pair keeps grows with the distance of its node, up to the thickness.
    #[test]
    fn distance_of_a_pair_recovers() {
        let mut contact = contact(vec![[0, 1, 2]], 4);
        for (distance, kept) in [(0.01, 0.01), (0.035, 0.035), (0.02, 0.035), (0.08, 0.05), (0.02, 0.05)] {
            contact.find_pairs(&positions(distance));
            assert!((contact.pairs[0].thickness - kept).abs() < 1e-12, "{distance}");
        }
    }

    /// A pressed node that comes near the other leaf of a fold gets no force from it: only what it loses on the first leaf goes over to the second.
    #[test]
    fn second_leaf_of_a_fold_begins_without_force() {
        // Leaves in the planes z = 0 and x = 0.03 with one common node.
        let fold = |node: [f64; 3]| -> Vec<f64> {
            [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.03, 0.0, 2.0], [0.03, 2.0, 0.0], node].concat()
        };
        let mut contact = contact(vec![[0, 1, 2], [0, 4, 3]], 6);
        contact.find_pairs(&fold([0.7, 0.6, 0.09]));
        contact.find_pairs(&fold([0.7, 0.6, 0.01]));
        let there = fold([0.05, 0.6, 0.02]);
        let alone = {
            contact.find_pairs(&fold([0.4, 0.6, 0.02]));
            contact.energy(&fold([0.4, 0.6, 0.02]))
        };
        contact.find_pairs(&there);
        assert_eq!(contact.pairs.iter().filter(|p| p.node == 5).count(), 2);
        assert!((contact.energy(&there) - alone).abs() < 1e-10, "{} {alone}", contact.energy(&there));
    }

    fn forces(contact: &Contact, x: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; x.len()];
        let load = FaceLoad { pressure: &[], traction: &[] };
        contact.forces(Configuration { at: x, end: x, weight: 1.0 }, load, &mut out);
        out
    }

    /// Energy `k (h - d)^2 / 2` on either side; the forces are its gradient, and the blocks of the tangent
    /// `k n n` at the node and the squares of the weights of it at the corners.
    #[test]
    fn forces_are_the_gradient_of_the_energy() {
        for distance in [0.02, -0.03, 0.049, -0.001] {
            let (contact, x) = pressed(distance);
            let gap = 0.05 - f64::abs(distance);
            assert!((contact.energy(&x) - 350.0 * gap * gap).abs() < 1e-12);
            assert!((contact.pressed(&x) - 700.0 * gap).abs() < 1e-10);
            let found = forces(&contact, &x);
            let differences = |f: &dyn Fn(&[f64]) -> f64, i: usize| {
                let h = 1e-6;
                let at = |d: f64| {
                    f(&x.iter().enumerate().map(|(k, v)| if k == i { v + d } else { *v }).collect::<Vec<_>>())
                };
                (at(h) - at(-h)) / (2.0 * h)
            };
            for (i, f) in found.iter().enumerate() {
                let wanted = differences(&|x| contact.energy(x), i);
                assert!((f - wanted).abs() < 1e-6, "{distance}, {i}: {f} {wanted}");
            }
            let (mut blocks, mut out) = (vec![[[0.0; 3]; 3]; 4], vec![0.0; 12]);
            let load = FaceLoad { pressure: &[], traction: &[] };
            contact.tangent(Configuration { at: &x, end: &x, weight: 1.0 }, load, 0.6, &mut out, &mut blocks);
            assert_eq!(out, found);
            for i in 0..3 {
                for j in 0..3 {
                    let wanted = 0.6 * differences(&|x| forces(&contact, x)[9 + i], 9 + j);
                    assert!((blocks[3][i][j] - wanted).abs() < 1e-5, "{} {wanted}", blocks[3][i][j]);
                    for (corner, w) in [0.5, 0.3, 0.2].iter().enumerate() {
                        assert!((blocks[corner][i][j] - w * w * blocks[3][i][j]).abs() < 1e-9);
                    }
                }
            }
        }
        let (contact, x) = pressed(0.051);
        assert_eq!((contact.energy(&x), forces(&contact, &x)), (0.0, vec![0.0; 12]));
    }

    /// A pair is found up to two thicknesses on either side, wherever the boxes of the search lie.
    #[test]
    fn pairs_are_found_within_reach_in_any_box() {
        for step in 0..40 {
            let shift = 0.173 * f64::from(step) - 3.0;
            for (distance, near) in [(0.09, true), (-0.09, true), (0.104, false), (-0.104, false)] {
                let mut contact = contact(vec![[0, 1, 2]], 4);
                contact.edge = 0.3;
                let x: Vec<f64> = positions(distance).iter().map(|x| x + shift).collect();
                contact.find_pairs(&x);
                assert_eq!(contact.pairs.len(), usize::from(near), "{shift} {distance}");
                assert!(contact.pairs.iter().all(|p| p.side == distance.signum() && p.node == 3));
            }
        }
    }

    /// Pairs are sought again where a node has moved by more than [`MARGIN`] relative to the others since, not where all have, and a node
    /// keeps its side when it is pressed through.
    #[test]
    fn a_search_is_repeated_after_a_motion() {
        let (mut contact, x) = pressed(0.02);
        // One of four nodes: three quarters of its motion are relative to the mean.
        let moved = |by: f64| x.iter().enumerate().map(|(i, x)| x + if i == 4 { by } else { 0.0 }).collect();
        let least = MARGIN * 0.05 / 0.75;
        let (little, more): (Vec<f64>, Vec<f64>) = (moved(-0.98 * least), moved(-1.02 * least));
        contact.find_pairs(&x.iter().map(|x| x + 7.0).collect::<Vec<_>>());
        assert_eq!(contact.searched, x);
        contact.find_pairs(&little);
        assert_eq!(contact.searched, x);
        contact.find_pairs(&more);
        assert_eq!(contact.searched, more);
        let through = positions(-0.03);
        contact.find_pairs(&through);
        assert_eq!(contact.searched, through);
        assert!(contact.pairs.len() == 1 && contact.pairs[0].side == 1.0, "{:?}", contact.pairs);
        assert!((contact.pressed(&through) - 700.0 * 0.08).abs() < 1e-10);
        // Far behind it is still the same pair; far in front it is none.
        let deep = positions(-0.3);
        contact.find_pairs(&deep);
        assert_eq!(contact.pairs.len(), 1);
        let away = positions(0.3);
        contact.find_pairs(&away);
        assert!(contact.pairs.is_empty());
    }

    /// The foot of a node lies on the triangle up to two per cent beyond its edges.
    #[test]
    fn feet_have_their_weights_and_a_margin() {
        let t = [[0.2, -0.1, 0.3], [1.1, 0.2, 0.0], [0.4, 0.9, 0.5]].map(Vec3::from);
        let at = |w: [f64; 3]| -> Vec3 { Vec3::from_fn(|i, _| (0..3).map(|k| w[k] * t[k][i]).sum()) };
        for k in 0..3 {
            for (beyond, found) in [(-0.019, true), (-0.021, false)] {
                let mut w = [0.5 * (1.0 - beyond); 3];
                w[k] = beyond;
                let foot = project(at(w), &t);
                assert_eq!(foot.is_some(), found, "{w:?}");
                if let Some((d, _, b)) = foot {
                    assert!(d.abs() < 1e-15 && (0..3).all(|i| (b[i] - w[i]).abs() < 1e-14), "{b:?}");
                }
            }
        }
    }
}
