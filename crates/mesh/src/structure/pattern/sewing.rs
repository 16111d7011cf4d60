//! Nodes and triangles of the sewn canopy: nodes of sewn edges are one node.
//!
//! All outlines run counter-clockwise as seen from outside, and a seam joins the start of one edge to the end of the other: on both sides of a seam
//! the normal points out of the canopy, whatever the seams are. A sewing without two sides (Moebius) cannot be written.

use std::collections::{BTreeMap, HashMap};

use case::pattern::{Pattern, Seam};

use super::cut::{EdgeAt, Panel, find};
use super::error::PatternError;
use super::outline::Outline;
use super::union::Union;

/// Two edges of two copies that are one seam.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    /// Number of the seam in the file.
    pub seam: usize,
    pub edges: [EdgeAt; 2],
    pub copies: [usize; 2],
}

/// The sewn canopy.
pub(super) struct Sewing {
    /// Panel and number of each copy.
    pub copies: Vec<(usize, usize)>,
    /// Nodes of the canopy of each copy, by the nodes of its panel.
    pub nodes: Vec<Vec<u32>>,
    /// Nodes of the canopy.
    pub n_nodes: usize,
    pub joints: Vec<Joint>,
}

impl Sewing {
    pub fn new(file: &Pattern, panels: &[Panel<'_>]) -> Result<Self, PatternError> {
        let joints = joints(file, panels)?;
        let copies: Vec<(usize, usize)> = panels
            .iter()
            .enumerate()
            .flat_map(|(p, panel)| (0..panel.file.copies as usize).map(move |k| (p, k)))
            .collect();
        let starts: Vec<usize> = copies
            .iter()
            .scan(0, |sum, (p, _)| Some(std::mem::replace(sum, *sum + panels[*p].flat.points.len())))
            .collect();
        let total = copies.iter().map(|(p, _)| panels[*p].flat.points.len()).sum();
        let place: HashMap<(usize, usize), usize> =
            copies.iter().copied().zip(starts.iter().copied()).collect();
        let mut all = Union::new(total);
        for j in &joints {
            let [[pa, ea], [pb, eb]] = j.edges;
            let [a, b] = [place[&(pa, j.copies[0])], place[&(pb, j.copies[1])]];
            let cells = panels[pa].cells[ea];
            for i in 0..=cells {
                all.join(a + panels[pa].node(ea, i), b + panels[pb].node(eb, cells - i));
            }
        }
        let mut number = HashMap::new();
        let nodes: Vec<Vec<u32>> = copies
            .iter()
            .zip(&starts)
            .map(|((p, _), start)| {
                let n = panels[*p].flat.points.len();
                let mut of = |i: usize| {
                    let next = number.len() as u32;
                    *number.entry(all.root(start + i)).or_insert(next)
                };
                (0..n).map(&mut of).collect()
            })
            .collect();
        let sewing = Self { copies, nodes, n_nodes: number.len(), joints };
        sewing.check(panels)?;
        Ok(sewing)
    }

    /// Triangles of the canopy with their copy, and the triangle of its panel.
    pub fn triangles<'a>(
        &'a self,
        panels: &'a [Panel<'a>],
    ) -> impl Iterator<Item = ([u32; 3], usize, [u32; 3])> + 'a {
        self.copies.iter().zip(&self.nodes).enumerate().flat_map(move |(copy, ((p, _), nodes))| {
            panels[*p].flat.triangles.iter().map(move |t| (t.map(|n| nodes[n as usize]), copy, *t))
        })
    }

    /// Nodes of an edge of a panel in all copies, or of one point of it.
    pub fn nodes_of(&self, panels: &[Panel<'_>], [panel, edge]: EdgeAt, at: Option<f64>) -> Vec<u32> {
        let local = panels[panel].nodes(edge, at);
        let copies = self.copies.iter().zip(&self.nodes).filter(|((p, _), _)| *p == panel);
        let mut all: Vec<u32> = copies.flat_map(|(_, nodes)| local.iter().map(|&i| nodes[i])).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Nodes of an edge of one copy, along it.
    pub fn along(&self, panels: &[Panel<'_>], [panel, edge]: EdgeAt, copy: usize) -> Vec<u32> {
        let place = self.copies.iter().position(|c| *c == (panel, copy)).unwrap_or(0);
        panels[panel].nodes(edge, None).into_iter().map(|i| self.nodes[place][i]).collect()
    }

    /// Refuses triangles whose own nodes are joined, edges of more than two triangles, and copies that no seam joins.
    fn check(&self, panels: &[Panel<'_>]) -> Result<(), PatternError> {
        let mut sides: HashMap<[u32; 2], u32> = HashMap::new();
        let mut joined = Union::new(self.copies.len());
        let mut owner: Vec<Option<usize>> = vec![None; self.n_nodes];
        let folded = |copy: usize, local: [u32; 3], reason| {
            let (p, k) = self.copies[copy];
            let at = panels[p].flat.points[local[0] as usize];
            Err(PatternError::Folded { panel: panels[p].outline.panel.clone(), copy: k, at, reason })
        };
        for (t, copy, local) in self.triangles(panels) {
            for i in 0..3 {
                let side = [t[i], t[(i + 1) % 3]];
                if side[0] == side[1] {
                    return folded(copy, local, "a triangle has the same node twice");
                }
                let count = sides.entry(side).or_default();
                *count += 1;
                if *count > 1 {
                    return folded(copy, local, "two triangles lie on the same side of an edge");
                }
                match owner[t[i] as usize] {
                    Some(other) => joined.join(other, copy),
                    None => owner[t[i] as usize] = Some(copy),
                }
            }
        }
        match (0..self.copies.len()).find(|c| joined.root(*c) != 0) {
            Some(c) => {
                let (p, copy) = self.copies[c];
                Err(PatternError::Apart { panel: panels[p].outline.panel.clone(), copy })
            }
            None => Ok(()),
        }
    }
}

/// Pairs of edges of the seams, copy by copy.
fn joints(file: &Pattern, panels: &[Panel<'_>]) -> Result<Vec<Joint>, PatternError> {
    let outlines: Vec<Outline> = panels.iter().map(|p| p.outline.clone()).collect();
    let mut all = Vec::new();
    let mut sewn: BTreeMap<(EdgeAt, usize), usize> = BTreeMap::new();
    for (k, s) in file.seams.iter().enumerate() {
        let key = format!("seam[{k}]");
        let edges = [find(&outlines, &key, &s.edges[0])?, find(&outlines, &key, &s.edges[1])?];
        let counts = edges.map(|[p, _]| panels[p].file.copies as usize);
        let pairs = pairs(s, counts).map_err(|reason| PatternError::Seam {
            seam: k,
            edges: s.edges.clone(),
            reason,
        })?;
        for copies in pairs {
            if (edges[0], copies[0]) == (edges[1], copies[1]) {
                let reason = "an edge cannot be sewn to itself; split it, or set next_copy = true".into();
                return Err(PatternError::Seam { seam: k, edges: s.edges.clone(), reason });
            }
            for i in 0..2 {
                if let Some(other) = sewn.insert((edges[i], copies[i]), k) {
                    let edge = s.edges[i].clone();
                    return Err(PatternError::SewnTwice { edge, copy: copies[i], seams: [other, k] });
                }
            }
            all.push(Joint { seam: k, edges, copies });
        }
    }
    Ok(all)
}

/// Copies that a seam joins.
fn pairs(s: &Seam, counts: [usize; 2]) -> Result<Vec<[usize; 2]>, String> {
    if let Some(copies) = s.copies {
        let copies = copies.map(|c| c as usize);
        return match (0..2).find(|i| copies[*i] >= counts[*i]) {
            Some(i) => Err(format!(
                "copies = {copies:?}, and the panel of \"{}\" has the copies 0 to {}",
                s.edges[i],
                counts[i] - 1
            )),
            None if s.next_copy => Err("it has both `copies` and `next_copy`; remove one".into()),
            None => Ok(vec![copies]),
        };
    }
    if counts[0] != counts[1] {
        return Err(format!(
            "the panels have {} and {} copies; give both as many, or join single copies by `copies = [k, l]`",
            counts[0], counts[1]
        ));
    }
    let n = counts[0];
    Ok((0..n).map(|k| [k, if s.next_copy { (k + 1) % n } else { k }]).collect())
}
