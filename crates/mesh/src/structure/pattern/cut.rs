//! Panels of a pattern with their edges divided and their flat meshes.

use case::pattern::{Pattern, PatternPanel};

use super::error::PatternError;
use super::outline::{Flat, Outline, distance};
use super::triangulate::FlatMesh;
use super::union::Union;

/// Largest ratio of the lengths of two edges of a seam: cloth gathered to half of its length is far beyond the fullness of sails (0.05 to 0.5), so
/// a larger ratio is a wrong edge or unit.
const MOST_GATHERED: f64 = 2.0;

/// Least quality of a triangle: below it the stiffness of the triangle is over a hundred times that of an equilateral one.
const LEAST_QUALITY: f64 = 0.02;

/// Most parts of an edge.
const MOST_PARTS: usize = 20_000;

/// Most triangles of all copies: 15 times the elements of the paper's canopy.
const MOST_TRIANGLES: f64 = 2e6;

/// A panel, an edge of it as their places.
pub(super) type EdgeAt = [usize; 2];

/// A panel, cut.
pub(super) struct Panel<'a> {
    pub file: &'a PatternPanel,
    pub outline: Outline,
    /// Equal parts of each edge.
    pub cells: Vec<usize>,
    /// Node at which each edge begins.
    first: Vec<usize>,
    pub flat: FlatMesh,
}

impl Panel<'_> {
    /// Node `i` of an edge, from its first corner as seen from outside.
    pub fn node(&self, edge: usize, i: usize) -> usize {
        (self.first[edge] + i) % self.cells.iter().sum::<usize>()
    }

    /// Length of part `i` of an edge in the flat mesh, m.
    pub fn part(&self, edge: usize, i: usize) -> f64 {
        let [a, b] = [i, i + 1].map(|i| self.flat.points[self.node(edge, i)]);
        distance(a, b)
    }

    /// Nodes of an edge, or the node at the share `at` of its length in the drawing.
    pub fn nodes(&self, edge: usize, at: Option<f64>) -> Vec<usize> {
        let cells = self.cells[edge];
        match at {
            Some(at) => {
                let i = (self.outline.share(at) * cells as f64).round() as usize;
                vec![self.node(edge, i.min(cells))]
            }
            None => (0..=cells).map(|i| self.node(edge, i)).collect(),
        }
    }
}

/// Place of the edge `panel.edge`; `key` is where the file names it.
pub(super) fn find(outlines: &[Outline], key: &str, name: &str) -> Result<EdgeAt, PatternError> {
    let found = name.split_once('.').and_then(|(panel, edge)| {
        let p = outlines.iter().position(|o| o.panel == panel)?;
        Some([p, outlines[p].edge(edge)?])
    });
    found.ok_or_else(|| PatternError::UnknownEdge {
        key: key.into(),
        name: name.into(),
        edges: outlines
            .iter()
            .flat_map(|o| o.edges.iter().map(|e| format!("{}.{}", o.panel, e.name)))
            .collect(),
    })
}

/// Cuts the panels of a pattern, whose triangles have edges of `size` (m).
pub(super) fn panels(file: &Pattern, size: f64) -> Result<Vec<Panel<'_>>, PatternError> {
    let outlines = file.panels.iter().map(Outline::new).collect::<Result<Vec<_>, _>>()?;
    for (k, o) in outlines.iter().enumerate() {
        if outlines[..k].iter().any(|other| other.panel == o.panel) {
            let reason = "two panels have this name".into();
            return Err(PatternError::Panel { panel: o.panel.clone(), reason });
        }
    }
    let mut cells = parts(file, &outlines, size)?.into_iter();
    count(file, &outlines, size)?;
    let mut all = Vec::new();
    for (file, outline) in file.panels.iter().zip(outlines) {
        let cells: Vec<usize> = cells.by_ref().take(outline.edges.len()).collect();
        all.push(panel(file, outline, cells, size)?);
    }
    Ok(all)
}

/// Refuses an element size that makes too many triangles, by the area of the panels.
fn count(file: &Pattern, outlines: &[Outline], size: f64) -> Result<(), PatternError> {
    let areas = file.panels.iter().zip(outlines).map(|(p, o)| f64::from(p.copies) * o.area);
    let triangles = areas.sum::<f64>() / (0.1875_f64.sqrt() * size * size);
    if triangles <= MOST_TRIANGLES {
        return Ok(());
    }
    let reason = format!(
        "edges of {size} m make about {triangles:.1e} triangles, and {MOST_TRIANGLES:.0e} are allowed; increase it, or check that the points of the \
         pattern are in metres"
    );
    Err(PatternError::Entry { key: "canopy.element_size_m".into(), reason })
}

fn panel(
    file: &PatternPanel,
    outline: Outline,
    cells: Vec<usize>,
    size: f64,
) -> Result<Panel<'_>, PatternError> {
    let points: Vec<Flat> = outline.edges.iter().zip(&cells).flat_map(|(e, n)| e.divided(*n)).collect();
    let panel = || outline.panel.clone();
    if points.len() < 3 {
        let reason =
            format!("its outline is divided into {} parts; reduce canopy.element_size_m", points.len());
        return Err(PatternError::Panel { panel: panel(), reason });
    }
    outline.crossing(&points, &cells)?;
    let flat = FlatMesh::new(&points, size).ok_or_else(|| PatternError::Panel {
        panel: panel(),
        reason: "its divided outline has no triangulation; change canopy.element_size_m".into(),
    })?;
    let (quality, at) = flat.worst();
    if quality < LEAST_QUALITY || flat.triangles.is_empty() {
        return Err(PatternError::Thin { panel: panel(), at, quality, least: LEAST_QUALITY });
    }
    let first = cells.iter().scan(0, |sum, n| Some(std::mem::replace(sum, *sum + n))).collect();
    Ok(Panel { file, outline, cells, first, flat })
}

/// Numbers of equal parts of all edges, panel by panel: parts of at most `size` (m), as many on both edges of a seam, with a node at each attachment.
fn parts(file: &Pattern, outlines: &[Outline], size: f64) -> Result<Vec<usize>, PatternError> {
    let lengths: Vec<f64> = outlines.iter().flat_map(|o| o.edges.iter().map(|e| e.length)).collect();
    let number =
        |[panel, edge]: EdgeAt| outlines[..panel].iter().map(|o| o.edges.len()).sum::<usize>() + edge;
    let mut sewn = Union::new(lengths.len());
    for (k, s) in file.seams.iter().enumerate() {
        let edges = [0, 1].map(|i| find(outlines, &format!("seam[{k}]"), &s.edges[i]));
        let [a, b] = edges;
        let [a, b] = [number(a?), number(b?)];
        let ratio = lengths[a] / lengths[b];
        if !(1.0 / MOST_GATHERED..=MOST_GATHERED).contains(&ratio) {
            let reason = format!(
                "the edges are {:.4} and {:.4} m long, and the longer one can be gathered to half of its length at most; correct an edge",
                lengths[a], lengths[b]
            );
            return Err(PatternError::Seam { seam: k, edges: s.edges.clone(), reason });
        }
        sewn.join(a, b);
    }
    let mut least = vec![1; lengths.len()];
    for (e, length) in lengths.iter().enumerate() {
        let wanted = (length / size - 1e-9).ceil().max(1.0);
        if wanted > MOST_PARTS as f64 {
            let reason = format!(
                "{length:.4} m are {wanted:.0} parts of {size} m, and {MOST_PARTS} are allowed; increase it"
            );
            return Err(PatternError::Entry { key: "canopy.element_size_m".into(), reason });
        }
        let root = sewn.root(e);
        least[root] = least[root].max(wanted as usize);
    }
    let mut shares = vec![Vec::new(); lengths.len()];
    for (key, edge, at) in points(file) {
        if !(0.0..=1.0).contains(&at) {
            let reason =
                format!("at = {at} is no share of the length of \"{edge}\"; give a number from 0 to 1");
            return Err(PatternError::Entry { key, reason });
        }
        let e = number(find(outlines, &key, edge)?);
        shares[sewn.root(e)].push((key, at));
    }
    for (n, shares) in least.iter_mut().zip(&shares) {
        *n = divisible(*n, shares)?;
    }
    Ok((0..lengths.len()).map(|e| least[sewn.root(e)]).collect())
}

/// Points of edges that need a node: where the file names them, their edge, and the share of its length.
fn points(file: &Pattern) -> impl Iterator<Item = (String, &str, f64)> {
    let attachments =
        file.attachments.iter().enumerate().map(|(k, a)| (format!("attachment[{k}]"), a.edge.as_str(), a.at));
    let holds = file.holds.iter().enumerate();
    attachments.chain(holds.filter_map(|(k, h)| Some((format!("hold[{k}]"), h.edge.as_str(), h.at?))))
}

/// The least number of parts from `least` on with a node at all `shares` of an edge.
fn divisible(least: usize, shares: &[(String, f64)]) -> Result<usize, PatternError> {
    let fits = |n: usize| shares.iter().all(|(_, at)| (at * n as f64 - (at * n as f64).round()).abs() < 1e-6);
    (least..=4 * least + 100).find(|n| fits(*n)).ok_or_else(|| {
        let (key, at) = shares.last().cloned().unwrap_or_default();
        let reason = format!(
            "at = {at} with the other points of this edge needs over {} parts; use simple fractions such as 0.25, or split the edge there",
            4 * least + 100
        );
        PatternError::Entry { key, reason }
    })
}
