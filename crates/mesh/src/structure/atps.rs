//! The ATPS cross parachute: a truncated pyramid of five flat panels.

use case::{Atps, StitchedEnd};

use super::{even, positive, refuse};
use crate::geometry::{Point, at};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// Numbers the canopy nodes of the ATPS by panel position.
///
/// Panel 0 is the top, node (i, j) along x and y. Arm k (panel k + 1) is arm 0
/// (at +x) rotated by k quarter turns about z; its node (a, b) counts a across,
/// counter-clockwise seen from above, and b down from the top.
pub(crate) struct AtpsLayout {
    /// Cells across.
    pub n: usize,
    /// Cells along an arm.
    pub m: usize,
    /// Adjacent arms share their edge nodes at this level.
    shared: Vec<bool>,
    /// First node of each level of the arms.
    start: Vec<u32>,
}

impl AtpsLayout {
    pub fn new(a: &Atps) -> Result<Self, MeshError> {
        let n = even("canopy.cells_across", a.cells_across)?;
        let (vent, stitch) = (a.cells_along_vent as usize, a.cells_along_stitching as usize);
        for (key, value, least) in
            [("canopy.cells_along_vent", vent, 2), ("canopy.cells_along_stitching", stitch, 1)]
        {
            if !(least..=10_000).contains(&value) {
                return Err(refuse(key, value, format!("must be from {least} to 10000")));
            }
        }
        let m = vent + stitch;
        let shared: Vec<bool> = (0..=m)
            .map(|b| match a.stitched_end {
                StitchedEnd::Hem => b == 0 || b >= vent,
                StitchedEnd::Top => b <= stitch,
            })
            .collect();
        let mut start = vec![0; m + 2];
        start[1] = ((n + 1) * (n + 1)) as u32;
        for b in 1..=m {
            start[b + 1] = start[b] + 4 * (if shared[b] { n } else { n + 1 }) as u32;
        }
        Ok(Self { n, m, shared, start })
    }

    /// A sheet without cuts: n x n cells and `rings` rings of cells around them.
    pub fn sheet(n: usize, rings: usize) -> Self {
        let start = (0..=rings + 1)
            .map(|b| if b == 0 { 0 } else { ((n + 1) * (n + 1) + 4 * n * (b - 1)) as u32 })
            .collect();
        Self { n, m: rings, shared: vec![true; rings + 1], start }
    }

    /// A sheet of n x n cells and four arms of m rows of cells, whose sides are free.
    pub fn cross(n: usize, m: usize) -> Self {
        let start = (0..=m + 1)
            .map(|b| if b == 0 { 0 } else { ((n + 1) * (n + 1) + 4 * (n + 1) * (b - 1)) as u32 })
            .collect();
        Self { n, m, shared: (0..=m).map(|b| b == 0).collect(), start }
    }

    /// Column of line `l` of the `lines` at the end of an arm: the nearest node, mirrored about the arm's middle.
    pub fn column_of_line(&self, l: usize, lines: usize) -> usize {
        let near = |l: usize| (l * self.n + (lines - 1) / 2) / (lines - 1);
        if 2 * l < lines { near(l) } else { self.n - near(lines - 1 - l) }
    }

    /// Number of canopy nodes.
    pub fn nodes(&self) -> usize {
        self.start[self.m + 1] as usize
    }

    /// Whether adjacent arms share their edge nodes at level `b`.
    pub fn is_shared(&self, b: usize) -> bool {
        self.shared[b]
    }

    /// Adds all faces, the top first, in panel 0; `panel` names those of the arms.
    /// The triangles' diagonals alternate, so that the mesh has all symmetries of
    /// the canopy, and no corner is cut off by a triangle of its own.
    pub fn push_faces(&self, mesh: &mut StructureMesh, panel: impl Fn(usize) -> u32) {
        let (n, m) = (self.n, self.m);
        for j in 0..n {
            for i in 0..n {
                let quad = [self.top(i, j), self.top(i + 1, j), self.top(i + 1, j + 1), self.top(i, j + 1)];
                mesh.push_quad(quad, 0, (i + j) % 2 == 0);
            }
        }
        for k in 0..4 {
            for b in 0..m {
                for a in 0..n {
                    let quad = [
                        self.arm(k, a, b),
                        self.arm(k, a, b + 1),
                        self.arm(k, a + 1, b + 1),
                        self.arm(k, a + 1, b),
                    ];
                    mesh.push_quad(quad, panel(k), (a + b) % 2 == 0);
                }
            }
        }
    }

    /// Nodes of the lower edge, once around counter-clockwise (where it is shared).
    pub fn rim(&self) -> Vec<u32> {
        (0..4 * self.n).map(|i| self.arm(i / self.n, i % self.n, self.m)).collect()
    }

    /// Node (i, j) of the top panel.
    pub fn top(&self, i: usize, j: usize) -> u32 {
        (i + (self.n + 1) * j) as u32
    }

    /// Node (a, b) of arm `k`.
    pub fn arm(&self, k: usize, a: usize, b: usize) -> u32 {
        let n = self.n;
        if b == 0 {
            return match k % 4 {
                0 => self.top(n, a),
                1 => self.top(n - a, n),
                2 => self.top(0, n - a),
                _ => self.top(a, 0),
            };
        }
        // Shared levels run around the box as one ring; the others arm by arm.
        let place = if self.shared[b] { (k * n + a) % (4 * n) } else { k * (n + 1) + a };
        self.start[b] + place as u32
    }
}

/// Rotates by k quarter turns about z, exactly.
pub(super) fn turn(k: usize, [x, y, z]: Point) -> Point {
    match k % 4 {
        0 => [x, y, z],
        1 => [-y, x, z],
        2 => [-x, -y, z],
        _ => [y, -x, z],
    }
}

/// Lengths of the canopy, checked, m.
struct Cut {
    top_width: f64,
    hem_width: f64,
    /// Of an arm, along the fabric.
    length: f64,
    stitch: f64,
    line_length: f64,
    riser_length: f64,
}

impl Cut {
    fn new(p: &Atps) -> Result<Self, MeshError> {
        let cut = Self {
            top_width: positive("canopy.top_width_m", p.top_width_m)?,
            hem_width: positive("canopy.bottom_edge_width_m", p.bottom_edge_width_m)?,
            length: positive("canopy.arm_length_m", p.arm_length_m)?,
            stitch: positive("canopy.stitching_height_m", p.stitching_height_m)?,
            line_length: positive("canopy.suspension_line_length_m", p.suspension_line_length_m)?,
            riser_length: positive("canopy.riser_length_m", p.riser_length_m)?,
        };
        let (inset, length, half_hem) = (cut.inset(), cut.length, cut.half_hem());
        if inset.abs() >= length {
            return Err(refuse(
                "canopy.arm_length_m",
                length,
                format!("must exceed half the difference of top and bottom width, {:.4} m", inset.abs()),
            ));
        }
        if cut.stitch >= length {
            return Err(refuse(
                "canopy.stitching_height_m",
                cut.stitch,
                format!("must be below arm_length_m, {length} m"),
            ));
        }
        if cut.line_length <= half_hem {
            return Err(refuse(
                "canopy.suspension_line_length_m",
                cut.line_length,
                format!("must exceed half of bottom_edge_width_m, {half_hem} m, to meet below the arm"),
            ));
        }
        Ok(cut)
    }

    /// How far the hem lies inside the top's edge, m.
    fn inset(&self) -> f64 {
        0.5 * (self.top_width - self.hem_width)
    }

    fn half_hem(&self) -> f64 {
        0.5 * self.hem_width
    }

    /// From the hem up to the top, m.
    fn height(&self) -> f64 {
        (self.length * self.length - self.inset() * self.inset()).sqrt()
    }
}

/// Builds the mesh; `payload_mass` in kg if the payload falls.
pub(super) fn atps(p: &Atps, payload_mass: Option<f64>) -> Result<StructureMesh, MeshError> {
    let layout = AtpsLayout::new(p)?;
    let cut = Cut::new(p)?;
    let mut mesh = StructureMesh { coords: vec![[0.0; 3]; layout.nodes()], ..Default::default() };
    place_fabric(p, &cut, &layout, &mut mesh.coords);
    mesh.n_canopy = mesh.coords.len();
    layout.push_faces(&mut mesh, |k| k as u32 + 1);
    let payload = add_lines(p, &cut, &layout, &mut mesh)?;
    if p.reinforcements {
        let line = 4 * p.lines_per_arm + 4;
        reinforce(&mut mesh, &layout, line, p.reinforcement_spacing_cells as usize);
    }
    mesh.fixed.push((payload, [true; 3]));
    mesh.point_masses.extend(payload_mass.map(|mass| (payload, mass)));
    Ok(mesh)
}

/// Places the nodes of top and arms, unstressed.
fn place_fabric(p: &Atps, cut: &Cut, layout: &AtpsLayout, coords: &mut [Point]) {
    let (n, m) = (layout.n, layout.m);
    let (inset, length, height) = (cut.inset(), cut.length, cut.height());
    // From -1 to 1, exactly antisymmetric.
    let across = |a: usize| (2.0 * a as f64 - n as f64) / n as f64;
    for j in 0..=n {
        for i in 0..=n {
            let half = 0.5 * cut.top_width;
            coords[layout.top(i, j) as usize] = [across(i) * half, across(j) * half, 0.0];
        }
    }
    let (vent_cells, stitch_cells) = (p.cells_along_vent as usize, p.cells_along_stitching as usize);
    let (above, below, end) = match p.stitched_end {
        StitchedEnd::Hem => (vent_cells, stitch_cells, length - cut.stitch),
        StitchedEnd::Top => (stitch_cells, vent_cells, cut.stitch),
    };
    for b in 1..=m {
        let s = if b <= above {
            end * b as f64 / above as f64
        } else {
            end + (length - end) * (b - above) as f64 / below as f64
        };
        let w = 0.5 * cut.top_width - inset * s / length;
        for k in 0..4 {
            for a in 0..=n {
                coords[layout.arm(k, a, b) as usize] = turn(k, [w, across(a) * w, -height * s / length]);
            }
        }
    }
}

/// Adds suspension lines, confluence points, risers and the payload's node, which it returns. Risers and the
/// middles of the outer lines lie in one straight line, all of them taut.
fn add_lines(p: &Atps, cut: &Cut, layout: &AtpsLayout, mesh: &mut StructureMesh) -> Result<u32, MeshError> {
    let (n, m) = (layout.n, layout.m);
    let (half_hem, height) = (cut.half_hem(), cut.height());
    let lines = p.lines_per_arm as usize;
    if lines < 2 || lines > n + 1 {
        return Err(refuse(
            "canopy.lines_per_arm",
            lines,
            format!("must be from 2 to cells_across + 1 = {}", n + 1),
        ));
    }
    let segments = p.segments_per_line as usize;
    if !(1..=10_000).contains(&segments) {
        return Err(refuse("canopy.segments_per_line", segments, "must be from 1 to 10000"));
    }
    let line_in_plane = (cut.line_length * cut.line_length - half_hem * half_hem).sqrt();
    let down_in_plane = line_in_plane + cut.riser_length;
    if down_in_plane <= half_hem {
        let reason = "lines and risers are too short to meet";
        return Err(refuse("canopy.riser_length_m", cut.riser_length, reason));
    }
    let drop = (down_in_plane * down_in_plane - half_hem * half_hem).sqrt();
    let share = line_in_plane / down_in_plane;
    let confluence = [half_hem * (1.0 - share), 0.0, -height - drop * share];
    let payload = mesh.push_node([0.0, 0.0, -height - drop]);
    let confluences: [u32; 4] = std::array::from_fn(|k| mesh.push_node(turn(k, confluence)));
    for (k, &confluence) in confluences.iter().enumerate() {
        for l in 0..lines {
            let ends = [layout.arm(k, layout.column_of_line(l, lines), m), confluence];
            let line = (k * lines + l) as u32;
            mesh.push_line(ends, cut.line_length, segments, CableKind::SuspensionLine, line);
        }
    }
    for (line, c) in (4 * p.lines_per_arm..).zip(confluences) {
        mesh.push_line([c, payload], cut.riser_length, 1, CableKind::Riser, line);
    }
    Ok(payload)
}

/// Cables along all panel edges, one line number for each edge; with a `spacing`
/// (cells) also along and across the panels, mirrored about their middles.
fn reinforce(mesh: &mut StructureMesh, layout: &AtpsLayout, first_line: u32, spacing: usize) {
    let (n, m) = (layout.n, layout.m);
    let mut line = first_line;
    let mut edge = |nodes: &mut dyn Iterator<Item = u32>| {
        let nodes: Vec<u32> = nodes.collect();
        for pair in nodes.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let rest_length = (at(&mesh.coords, a) - at(&mesh.coords, b)).norm();
            mesh.cables.push(Cable {
                nodes: [a, b],
                rest_length,
                kind: CableKind::Reinforcement,
                line,
                share: 1.0,
                group: None,
            });
        }
        line += 1;
    };
    for k in 0..4 {
        edge(&mut (0..=n).map(|a| layout.arm(k, a, 0)));
        edge(&mut (0..=n).map(|a| layout.arm(k, a, m)));
        // The edge to the next arm, and that arm's own edge where it is apart.
        edge(&mut (0..=m).map(|b| layout.arm(k, n, b)));
        let apart: Vec<usize> = (1..=m).filter(|&b| !layout.is_shared(b)).collect();
        if let (Some(&from), Some(&to)) = (apart.first(), apart.last()) {
            edge(&mut (from - 1..=(to + 1).min(m)).map(|b| layout.arm((k + 1) % 4, 0, b)));
        }
    }
    if spacing == 0 {
        return;
    }
    for a in (1..n).filter(|&a| a.abs_diff(n / 2).is_multiple_of(spacing)) {
        edge(&mut (0..=n).map(|i| layout.top(i, a)));
        edge(&mut (0..=n).map(|j| layout.top(a, j)));
        (0..4).for_each(|k| edge(&mut (0..=m).map(|b| layout.arm(k, a, b))));
    }
    for b in (1..m).filter(|b| b.is_multiple_of(spacing)) {
        (0..4).for_each(|k| edge(&mut (0..=n).map(|a| layout.arm(k, a, b))));
    }
}
