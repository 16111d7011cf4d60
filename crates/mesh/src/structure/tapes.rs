//! Tapes on the fabric: along hem, seams and vents, and in a grid.

use std::collections::BTreeMap;

use case::{Canopy, PanelCanopy, TapePlace, Tapes};

use super::{AtpsLayout, flat_layout, refuse};
use crate::geometry::{Point, at, triangle_area_vector};
use crate::{Cable, CableKind, MeshError, StructureMesh};

/// A part of the fabric with nodes in rows and columns.
struct Lattice<'a> {
    /// Cells in both directions.
    cells: [usize; 2],
    /// Node in column i and row j.
    node: &'a dyn Fn(usize, usize) -> u32,
}

impl StructureMesh {
    /// Adds the elements of `tapes`, after all others.
    pub(super) fn add_tapes(&mut self, canopy: &Canopy, tapes: &Tapes) -> Result<(), MeshError> {
        if let Some((place, _)) = tapes.places().find(|(p, _)| !canopy.tape_places().contains(p)) {
            return Err(refuse("tapes", place.name(), "this kind of canopy has no such place for tapes"));
        }
        match canopy {
            Canopy::Atps(a) => self.tape_atps(&AtpsLayout::new(a)?, tapes),
            Canopy::Square(f) => {
                let layout = flat_layout(f, false)?;
                self.tape_sheet(&layout.rim(), tapes);
                let node = |i, j| layout.top(i, j);
                self.tape_grid(tapes, &[Lattice { cells: [layout.n; 2], node: &node }]);
            }
            Canopy::Circular(f) => self.tape_sheet(&flat_layout(f, true)?.rim(), tapes),
            Canopy::Gored(g) => self.tape_gores(g, tapes),
            Canopy::Cross(x) => self.tape_cross(x, tapes)?,
            Canopy::Panel(p) => self.tape_panel(p, tapes),
            // Those of a pattern are made with it: they have the lengths of its edges.
            Canopy::AirBag(_) | Canopy::Gmsh(_) | Canopy::Pattern(_) | Canopy::None => {}
        }
        Ok(())
    }

    fn tape_atps(&mut self, layout: &AtpsLayout, tapes: &Tapes) {
        let (n, m) = (layout.n, layout.m);
        for k in 0..4 {
            if tapes.hem.is_some() {
                self.tape(TapePlace::Hem, (0..=n).map(|a| layout.arm(k, a, m)));
            }
            if tapes.seams.is_some() {
                self.tape(TapePlace::Seams, (0..=n).map(|a| layout.arm(k, a, 0)));
            }
            // Levels at which this arm and the next one are apart, with those at which the slit ends.
            let apart: Vec<usize> = (1..=m).filter(|&b| !layout.is_shared(b)).collect();
            let slit = match (apart.first(), apart.last()) {
                (Some(&first), Some(&last)) => [first - 1, (last + 1).min(m)],
                _ => [0, 0],
            };
            if tapes.seams.is_some() {
                for [from, to] in [[0, slit[0]], [slit[1], m]] {
                    self.tape(TapePlace::Seams, (from..=to).map(|b| layout.arm(k, n, b)));
                }
            }
            if tapes.vents.is_some() {
                self.tape(TapePlace::Vents, (slit[0]..=slit[1]).map(|b| layout.arm(k, n, b)));
                self.tape(TapePlace::Vents, (slit[0]..=slit[1]).map(|b| layout.arm((k + 1) % 4, 0, b)));
            }
        }
        self.tape_panels(layout, tapes);
    }

    /// The grid of `tapes` on the top and the four arms of a canopy.
    pub(super) fn tape_panels(&mut self, layout: &AtpsLayout, tapes: &Tapes) {
        let (n, m) = (layout.n, layout.m);
        let top = |i, j| layout.top(i, j);
        let arms: [_; 4] = std::array::from_fn(|k| move |a, b| layout.arm(k, a, b));
        let mut panels = vec![Lattice { cells: [n, n], node: &top }];
        panels.extend(arms.iter().map(|arm| Lattice { cells: [n, m], node: arm }));
        self.tape_grid(tapes, &panels);
    }

    /// The hem of a sheet: once around its rim.
    pub(super) fn tape_sheet(&mut self, rim: &[u32], tapes: &Tapes) {
        if tapes.hem.is_some() {
            self.tape(TapePlace::Hem, rim.iter().chain(rim.first()).copied());
        }
    }

    fn tape_panel(&mut self, p: &PanelCanopy, tapes: &Tapes) {
        let [nx, ny] = p.cells.map(|n| n as usize);
        let node = |i: usize, j: usize| (i + (nx + 1) * j) as u32;
        if tapes.hem.is_some() {
            let sides = (0..nx).map(|i| node(i, 0)).chain((0..ny).map(|j| node(nx, j)));
            let back = (0..nx).rev().map(|i| node(i + 1, ny)).chain((0..ny).rev().map(|j| node(0, j + 1)));
            let rim: Vec<u32> = sides.chain(back).collect();
            self.tape_sheet(&rim, tapes);
        }
        self.tape_grid(tapes, &[Lattice { cells: [nx, ny], node: &node }]);
    }

    /// Adds elements along `nodes`, as one line.
    pub(super) fn tape(&mut self, place: TapePlace, nodes: impl Iterator<Item = u32>) {
        let line = self.next_line();
        let nodes: Vec<u32> = nodes.collect();
        for pair in nodes.windows(2) {
            self.push_tape(place, [pair[0], pair[1]], 1.0, line);
        }
    }

    fn push_tape(&mut self, place: TapePlace, nodes: [u32; 2], share: f64, line: u32) {
        let [a, b] = nodes.map(|n| at(&self.coords, n));
        let rest_length = (a - b).norm();
        self.cables.push(Cable {
            nodes,
            rest_length,
            kind: CableKind::Tape(place),
            line,
            share,
            group: None,
        });
    }

    /// A number that no line has yet.
    fn next_line(&self) -> u32 {
        self.cables.iter().map(|c| c.line + 1).max().unwrap_or(0)
    }

    /// Adds the grid of `tapes`, if they have one, on `panels`. Elements of two panels on one edge are one element.
    fn tape_grid(&mut self, tapes: &Tapes, panels: &[Lattice<'_>]) {
        let Some(grid) = &tapes.grid else { return };
        let mut shares = BTreeMap::new();
        for panel in panels {
            let [columns, rows] = panel.cells;
            let (node, turned) = (panel.node, |j, i| (panel.node)(i, j));
            along(&self.coords, &Lattice { cells: [columns, rows], node }, grid.spacing_m, &mut shares);
            let turned = Lattice { cells: [rows, columns], node: &turned };
            along(&self.coords, &turned, grid.spacing_m, &mut shares);
        }
        let line = self.next_line();
        for (nodes, share) in shares {
            self.push_tape(TapePlace::Grid, nodes, share, line);
        }
    }
}

fn distance(coords: &[Point], a: u32, b: u32) -> f64 {
    (at(coords, a) - at(coords, b)).norm()
}

/// Adds to `shares` the tapes of `panel` that run along its columns at `spacing` (m): for each pair of nodes the number of tapes.
/// Their length in all is the area of the panel over the spacing.
fn along(coords: &[Point], panel: &Lattice<'_>, spacing: f64, shares: &mut BTreeMap<[u32; 2], f64>) {
    let ([columns, rows], node) = (panel.cells, panel.node);
    let mut place = vec![0.0; columns + 1];
    for i in 0..columns {
        place[i + 1] = place[i] + distance(coords, node(i, rows / 2), node(i + 1, rows / 2));
    }
    let tapes = tapes_on_columns(&place, spacing);
    let column = |i: usize| (0..rows).map(move |j| [node(i, j), node(i, j + 1)]);
    let length = |i: usize| -> f64 { column(i).map(|[a, b]| distance(coords, a, b)).sum() };
    let placed: f64 = tapes.iter().enumerate().filter(|(_, t)| **t > 0.0).map(|(i, t)| t * length(i)).sum();
    let scale = area(coords, panel) / spacing / placed;
    for (i, t) in tapes.into_iter().enumerate().filter(|(_, t)| *t > 0.0) {
        for [a, b] in column(i) {
            *shares.entry([a.min(b), a.max(b)]).or_insert(0.0) += scale * t;
        }
    }
}

/// Area of the fabric of a panel, m2.
fn area(coords: &[Point], panel: &Lattice<'_>) -> f64 {
    let ([columns, rows], node) = (panel.cells, panel.node);
    let cell = |i: usize, j: usize| {
        let [a, b, c, d] =
            [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| at(coords, node(i, j)));
        triangle_area_vector([a, b, c]).norm() + triangle_area_vector([a, c, d]).norm()
    };
    (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))).map(|(i, j)| cell(i, j)).sum()
}

/// How many tapes each column of nodes at `place` (m, ascending) stands for, before the length is scaled to the area. N tapes, the
/// width over the spacing rounded, lie at the middles of N equal parts of the width. Where the parts are as wide as the widest cell,
/// each tape is on the nearest column, one half on each of two that are as near; elsewhere each column has those of its share of
/// the width.
fn tapes_on_columns(place: &[f64], spacing: f64) -> Vec<f64> {
    let last = place.len() - 1;
    let width = place[last] - place[0];
    let count = (width / spacing).round().max(1.0);
    let pitch = width / count;
    let widest = place.windows(2).map(|p| p[1] - p[0]).fold(0.0, f64::max);
    if pitch < widest * (1.0 - 1e-9) {
        return (0..=last)
            .map(|i| 0.5 * (place[(i + 1).min(last)] - place[i.saturating_sub(1)]) / pitch)
            .collect();
    }
    let mut tapes = vec![0.0; place.len()];
    for k in 0..count as usize {
        let wanted = place[0] + (k as f64 + 0.5) * pitch;
        let right = place.partition_point(|p| *p < wanted).clamp(1, last);
        let [before, behind] = [wanted - place[right - 1], place[right] - wanted];
        // Midway to round-off, so that the grid has the symmetries of the panel.
        if (before - behind).abs() < 1e-6 * widest {
            tapes[right - 1] += 0.5;
            tapes[right] += 0.5;
        } else {
            tapes[if before < behind { right - 1 } else { right }] += 1.0;
        }
    }
    tapes
}
