//! Contact of fabric with itself: nodes against faces and edges against edges, by a penalty.
//!
//! A node $`P`$ within the thickness $`h`$ of a triangle that it is no corner of is pushed away
//! along the normal $`n`$, on the side on which it came near ($`s = \pm 1`$):
//! $`f = k\,(h - s\,n\cdot(P - Q))\,s\,n`$ with $`Q`$ the foot of $`P`$ on the triangle, which takes
//! $`-f`$ by its barycentric coordinates. Both forces lie on one line, so momentum and moment of
//! momentum stay; they are the gradient of $`\tfrac12 k (h - s d)^2`$ (Wriggers, Computational
//! Contact Mechanics, 2006, chapter 5).
//!
//! Edges that cross repel in the same way along the line between their closest points ([`edges`]). With a coefficient of
//! friction pairs resist sliding ([`friction`]). On several ranks each finds all pairs ([`ranks`]).
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

#[cfg(test)]
mod edge_tests;
mod edges;
mod friction;
#[cfg(test)]
mod friction_tests;
mod hash;
mod ranks;
#[cfg(test)]
mod tests;
mod touch;

use self::edges::{EdgePair, EdgePairs};
use self::friction::Stick;
use self::hash::Map;
use self::ranks::Ranks;
use self::touch::Touch;
use super::{Configuration, ELSEWHERE, ElementLoop, FaceLoad};
use crate::flat::{Block, add_at, at};
use crate::model::Model;
use mesh::StructureMesh;
use mesh::geometry::Vec3;

/// A node near a triangle.
#[derive(Clone, Copy, Debug)]
struct Pair {
    node: u32,
    triangle: u32,
    /// On which side of it the node is.
    side: f64,
    /// Distance that is kept, m.
    thickness: f64,
    /// Where it sticks, with friction.
    stick: Option<Stick>,
}

/// Share of a triangle's height by which a projection may lie beyond an edge.
const BEYOND: f64 = 0.02;
/// Motion of a node relative to the mean of all after which pairs are sought again, in thicknesses: of a reach of two, one is left where two nodes
/// have come towards each other.
const MARGIN: f64 = 0.35;

/// Extent of a triangle in edges of the unstressed mesh beyond which it is in contact with nothing: torn in a solve that fails.
const TORN: f64 = 30.0;

/// Numbers of a saved pair.
const NUMBERS: usize = 4 + friction::NUMBERS;

/// Law of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// Distance that is kept, m.
    pub thickness: f64,
    /// Stiffness of a node in contact, N/m.
    pub stiffness: f64,
    /// Coefficient of friction; `None`: no friction.
    pub friction: Option<f64>,
}

/// Contact of all membrane elements. Nodes are those of the mesh.
pub struct Contact {
    triangles: Vec<[u32; 3]>,
    /// Nodes of the fabric.
    nodes: Vec<u32>,
    /// Slots of the own blocks of the nodes whose rows are here.
    slots: Vec<u32>,
    thickness: f64,
    stiffness: f64,
    friction: Option<f64>,
    /// Energy that slip took since it was asked for, J.
    slipped: f64,
    /// `None` on a single rank.
    ranks: Option<Ranks>,
    pairs: Vec<Pair>,
    edges: EdgePairs,
    /// Pairs of each node, now and at the search before.
    known: Map<u32, Vec<Pair>>,
    before: Map<u32, Vec<Pair>>,
    /// Positions at the last search, m; empty before the first.
    searched: Vec<f64>,
    /// Pairs and positions of the last search at the accepted state.
    accepted: (Vec<Pair>, Vec<EdgePair>, Vec<f64>),
    cells: Map<[i32; 3], Vec<u32>>,
    edge: f64,
}

/// A number that was kept as an index below `end`.
fn index(x: f64, end: usize) -> Option<usize> {
    (x >= 0.0 && x < end as f64 && x.fract() == 0.0).then_some(x as usize)
}

/// Distance of a node from the plane of a triangle, its normal, and the barycentric coordinates of the projection.
#[inline(always)]
fn foot(p: Vec3, t: &[Vec3; 3]) -> Option<(f64, Vec3, [f64; 3])> {
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
    Some((r.dot(&n), n, [1.0 - b - c, b, c]))
}

/// As [`foot`]; `None` where the projection lies outside of the triangle.
#[inline(always)]
fn project(p: Vec3, t: &[Vec3; 3]) -> Option<(f64, Vec3, [f64; 3])> {
    // A little beyond the edges, so that no node slips between two triangles.
    foot(p, t).filter(|(_, _, w)| w.iter().all(|w| *w > -BEYOND))
}

impl Contact {
    /// Of the triangles of `mesh`, of which `model` is the part of this rank.
    pub fn new(model: &Model, mesh: &StructureMesh, law: ContactLaw) -> Self {
        let edge = (0..mesh.triangles.len())
            .map(|t| mesh.reference_triangle(t))
            .flat_map(|x| (0..3).map(move |i| (x[i] - x[(i + 1) % 3]).norm()))
            .fold(0.0, f64::max);
        let n = mesh.coords.len();
        Self { ranks: Ranks::of(model, n), ..Self::of(mesh.triangles.clone(), n, law, edge) }
    }

    /// Of triangles between `n` nodes, whose longest edge is `edge` (m), on one rank.
    fn of(triangles: Vec<[u32; 3]>, n: usize, law: ContactLaw, edge: f64) -> Self {
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        Self {
            edges: EdgePairs::new(&triangles, n),
            triangles,
            nodes,
            slots: vec![ELSEWHERE; n],
            thickness: law.thickness,
            stiffness: law.stiffness,
            friction: law.friction,
            slipped: 0.0,
            ranks: None,
            pairs: Vec::new(),
            known: Map::default(),
            before: Map::default(),
            searched: Vec::new(),
            accepted: Default::default(),
            cells: Map::default(),
            edge,
        }
    }

    /// Calls `f` with the positions of the nodes of the mesh (m), from those of this rank. Collective.
    fn everywhere<R>(&self, x: &[f64], f: impl FnOnce(&[f64]) -> R) -> R {
        match &self.ranks {
            None => f(x),
            Some(ranks) => f(&ranks.gather(x)),
        }
    }

    /// Row of a node here.
    #[inline(always)]
    fn row(&self, node: u32) -> Option<usize> {
        self.ranks.as_ref().map_or(Some(node as usize), |r| r.row(node))
    }

    /// Whether sums over all pairs are counted here.
    fn counts(&self) -> bool {
        self.ranks.as_ref().is_none_or(Ranks::counts)
    }

    fn corners(&self, t: usize, x: &[f64]) -> [Vec3; 3] {
        self.triangles[t].map(|n| at(x, n as usize))
    }

    fn cell(&self, x: Vec3) -> [i32; 3] {
        x.map(|v| (v / self.edge).floor() as i32).into()
    }

    /// Nodes in contact with triangles, and edges with edges.
    fn touches<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = Touch> + 'a {
        let nodes = self.pairs.iter().filter_map(move |p| self.near(p, x).filter(|t| t.gap > 0.0));
        nodes.chain(self.edges.touches(x))
    }

    /// A pair whose node lies over its triangle.
    #[inline(always)]
    fn near(&self, p: &Pair, x: &[f64]) -> Option<Touch> {
        let triangle = p.triangle as usize;
        let (d, n, [a, b, c]) = project(at(x, p.node as usize), &self.corners(triangle, x))?;
        let [i, j, k] = self.triangles[triangle];
        Some(Touch {
            nodes: [p.node, i, j, k],
            weights: [1.0, -a, -b, -c],
            normal: n * p.side,
            distance: p.side * d,
            gap: p.thickness - p.side * d,
            fade: 1.0,
            turn: [Vec3::zeros(); 2],
            stick: p.stick,
        })
    }

    /// Ends a step at `x` (m): pairs slip. Whether one has left its triangle or edge under pressure.
    fn slip(&mut self, x: &[f64]) -> bool {
        let Some(friction) = self.friction else { return false };
        let mut left = false;
        for k in 0..self.pairs.len() {
            let pair = self.pairs[k];
            let Some(touch) = self.near(&pair, x) else {
                left |= pair.stick.is_some();
                continue;
            };
            let (stick, taken) = touch.after_step(friction, self.stiffness, x);
            self.slipped += taken;
            self.pairs[k].stick = stick;
            let known = self.known.get_mut(&pair.node).into_iter().flatten();
            known.filter(|p| p.triangle == pair.triangle).for_each(|p| p.stick = stick);
        }
        let (taken, edge_left) = self.edges.slip(friction, self.stiffness, x);
        self.slipped += taken;
        left || edge_left
    }

    /// Where a pair that has left a triangle sticks on the next one, `triangle`: at the same tangential distance, as far as friction
    /// holds it.
    fn stick_on(&self, p: &Pair, triangle: u32, gap: f64, x: &[f64]) -> Option<Stick> {
        let (place, stick) = (at(x, p.node as usize), p.stick?);
        let corners = self.corners(p.triangle as usize, x);
        let (_, _, left) = foot(place, &corners)?;
        let elastic: Vec3 = (0..3).map(|i| corners[i] * (stick.weights[i + 1] + left[i])).sum();
        let next = self.corners(triangle as usize, x);
        let (_, n, now) = foot(place, &next)?;
        let elastic = friction::limited(elastic - n * n.dot(&elastic), self.friction? * gap);
        let (_, _, moved) = foot(place + elastic, &next)?;
        let weights = [0, 1, 2].map(|i| moved[i] - 2.0 * now[i]);
        Some(Stick { weights: [1.0, weights[0], weights[1], weights[2]], elastic: elastic.norm() })
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
        let pressed = same.is_some_and(|p| p.thickness > p.side * d);
        let continued = || before.iter().find_map(|p| self.continued(p, triangle, d, x));
        let begins =
            Pair { node, triangle, side: d.signum(), thickness: self.thickness.min(d.abs()), stick: None };
        let kept = |p: &Pair| Pair { thickness: p.thickness.max((p.side * d).min(self.thickness)), ..*p };
        let otherwise = same.map_or(begins, kept);
        Some(if pressed { otherwise } else { continued().unwrap_or(otherwise) })
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
            stick: self.stick_on(p, triangle, gap, x),
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
        self.touches(x).map(|t| t.force(self.stiffness)).sum()
    }
}

impl Contact {
    /// Ends the step before at positions `x` (m) of the nodes of the mesh, and finds pairs again where the fabric has moved.
    fn find_pairs_at(&mut self, x: &[f64]) {
        let left = self.slip(x);
        if !(left || self.stale(x)) {
            return;
        }
        self.searched.clear();
        self.searched.extend_from_slice(x);
        self.edges.search(x, self.thickness, self.edge, self.friction);
        self.search_nodes(x);
    }

    /// Finds nodes within two thicknesses of a triangle's plane, above or below it.
    fn search_nodes(&mut self, x: &[f64]) {
        let reach = 2.0 * self.thickness;
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
}

impl ElementLoop for Contact {
    fn has_history(&self) -> bool {
        true
    }

    fn advance_history(&mut self, x: &[f64]) {
        let Some(ranks) = self.ranks.take() else { return self.find_pairs_at(x) };
        self.find_pairs_at(&ranks.gather(x));
        self.ranks = Some(ranks);
    }

    fn has_dissipation(&self) -> bool {
        self.friction.is_some()
    }

    fn dissipated(&mut self) -> f64 {
        let slipped = std::mem::take(&mut self.slipped);
        if self.counts() { slipped } else { 0.0 }
    }

    fn keep(&mut self) {
        self.accepted.0.clone_from(&self.pairs);
        self.accepted.1.clone_from(&self.edges.pairs);
        self.accepted.2.clone_from(&self.searched);
    }

    fn rewind(&mut self) {
        self.slipped = 0.0;
        self.pairs.clone_from(&self.accepted.0);
        self.edges.pairs.clone_from(&self.accepted.1);
        self.searched.clone_from(&self.accepted.2);
        self.known.values_mut().for_each(Vec::clear);
        for p in &self.pairs {
            self.known.entry(p.node).or_default().push(*p);
        }
    }

    /// Numbers of pairs of nodes with triangles and of edges; the pairs in their order; the positions at the search.
    fn save_state(&self) -> Vec<f64> {
        let (pairs, edges, searched) = &self.accepted;
        let counts = [pairs.len() as f64, edges.len() as f64];
        let row = |p: &Pair| {
            let [e, f, g, h, i, j] = friction::row(p.stick);
            [f64::from(p.node), f64::from(p.triangle), p.side, p.thickness, e, f, g, h, i, j]
        };
        let rows = pairs.iter().flat_map(row);
        let rows = rows.chain(edges.iter().flat_map(EdgePair::row));
        counts.into_iter().chain(rows).chain(searched.iter().copied()).collect()
    }

    fn restore_state(&mut self, memory: &[f64]) -> Result<(), String> {
        let Some(([nodes, edges], rest)) = memory.split_first_chunk() else {
            return Err("contact has kept nothing".into());
        };
        let missing = "its pairs in contact are not there";
        let nodes = index(*nodes, rest.len() / NUMBERS + 1).ok_or(missing)?;
        let (nodes, rest) = rest.split_at(NUMBERS * nodes);
        let edges = index(*edges, rest.len() / edges::NUMBERS + 1).ok_or(missing)?;
        let (edges, searched) = rest.split_at(edges::NUMBERS * edges);
        if !(searched.is_empty() || searched.len() == 3 * self.slots.len()) {
            return Err(format!("{} positions of {} nodes", searched.len(), self.slots.len()));
        }
        let pair = |r: &[f64; NUMBERS]| {
            let (node, triangle) = (index(r[0], self.slots.len())?, index(r[1], self.triangles.len())?);
            let sound = r[2].abs() == 1.0 && (0.0..=self.thickness).contains(&r[3]);
            let stick = friction::of_row([r[4], r[5], r[6], r[7], r[8], r[9]])?;
            let (node, triangle) = (node as u32, triangle as u32);
            sound.then_some(Pair { node, triangle, side: r[2], thickness: r[3], stick })
        };
        let pairs: Option<Vec<Pair>> = nodes.as_chunks::<NUMBERS>().0.iter().map(pair).collect();
        let crossing = |r: &[f64; edges::NUMBERS]| self.edges.pair(r, self.thickness);
        let edges: Option<Vec<EdgePair>> =
            edges.as_chunks::<{ edges::NUMBERS }>().0.iter().map(crossing).collect();
        let (Some(pairs), Some(edges)) = (pairs, edges) else {
            return Err("a pair in contact is none of this canopy".into());
        };
        self.accepted = (pairs, edges, searched.to_vec());
        self.rewind();
        Ok(())
    }

    fn anchor(&mut self, _x: &[f64]) {}

    fn forces(&self, configuration: Configuration<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        self.everywhere(configuration.at, |x| {
            let mut add = |node: u32, f: Vec3| {
                if let Some(row) = self.row(node) {
                    add_at(out, row, f);
                }
            };
            for touch in self.touches(x) {
                touch.add_forces(self.stiffness, &mut add);
                if let Some(friction) = self.friction {
                    touch.add_friction(friction, self.stiffness, x, &mut add);
                }
            }
        });
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
        let k = factor * self.stiffness;
        let block = |node: u32| self.row(node).map(|_| self.slots[node as usize] as usize);
        self.everywhere(configuration.at, |x| {
            for touch in self.touches(x) {
                touch.add_blocks(k, block, blocks);
                if let Some(friction) = self.friction {
                    touch.add_friction_blocks(friction, k, x, block, blocks);
                }
            }
        });
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let friction = |t: &Touch, x: &[f64]| {
            self.friction.map_or(0.0, |friction| t.friction_energy(friction, self.stiffness, x))
        };
        let sum = |x: &[f64]| self.touches(x).map(|t| t.energy(self.stiffness) + friction(&t, x)).sum();
        let energy = self.everywhere(x, sum);
        if self.counts() { energy } else { 0.0 }
    }

    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        for &n in &self.nodes {
            if let Some(row) = self.row(n) {
                self.slots[n as usize] = slot(row as u32, row as u32);
            }
        }
    }
}
