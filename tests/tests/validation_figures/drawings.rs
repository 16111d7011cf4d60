//! Drawings of the cases: side and top view of the structure as cut, with the edges of a grid of the scene's own.

use std::collections::HashMap;
use std::path::Path;

use ::figures::chart::{Axis, Figure, Panel, Panels, Series, WIDTH};
use ::figures::colour::{GREY, series};
use mesh::{FlowGrid, Point, StructureMesh};

/// Drawing of the scene in a folder.
pub fn of_case(folder: &Path) -> Figure {
    let scene =
        case::load(&folder.join("scene.toml")).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let structure = mesh::structure_mesh(&scene).expect("a structure");
    let held: Vec<Point> = structure.fixed.iter().map(|(node, _)| structure.coords[*node as usize]).collect();
    let cables: Vec<[u32; 2]> = structure.cables.iter().map(|cable| cable.nodes).collect();
    let mut parts = vec![
        ("fabric", series(0), lines(&structure.coords, &outlines(&structure))),
        ("lines and tapes", series(1), lines(&structure.coords, &cables)),
    ];
    if scene.grid_file().is_some() {
        let positions: Vec<Point> = structure.coords.iter().map(|x| as_fitted(&scene.name, *x)).collect();
        let grid = mesh::flow_grid(&scene, &structure, &positions[..structure.n_canopy]).expect("a grid");
        parts.push(("edges of the flow", GREY, edges_of_patches(&grid)));
    }
    parts.retain(|part| !part.2.is_empty());
    let view = |title: &str, axes: [usize; 2], named: bool| {
        let project = |points: &[Point]| points.iter().map(|x| axes.map(|d| x[d])).collect();
        let name = |name: &'static str| if named { name } else { "" };
        let mut drawn: Vec<Series> = parts
            .iter()
            .map(|(n, colour, points)| Series::curve(name(n), *colour, project(points)))
            .collect();
        drawn.push(Series::dots(name("nodes with a support"), series(2), project(&held)));
        let range = |c: usize| {
            let values = drawn.iter().flat_map(|s| s.points.iter().map(move |p| p[c]));
            Axis::spanning(&format!("{}, m", ["x", "y", "z"][axes[c]]), values)
        };
        let [x, y] = [range(0), range(1)];
        Panel { title: title.into(), x, y, series: drawn, band: None, references: Vec::new() }
    };
    let panels = vec![view("Side", [0, 2], true), view("Top", [0, 1], false)];
    Figure::Panels(equal_scales(Panels { panels, columns: 2, size: [WIDTH / 2.0, 420.0] }))
}

/// Edges of the fabric that belong to one face, or to faces of two panels.
fn outlines(structure: &StructureMesh) -> Vec<[u32; 2]> {
    let faces = structure.faces.iter().zip(structure.face_panel.iter().copied());
    patch_edges(faces, |of| of.len() == 1 || of.iter().any(|panel| *panel != of[0]))
}

/// Line segments with gaps between them.
fn lines(coords: &[Point], edges: &[[u32; 2]]) -> Vec<Point> {
    let ends = edges.iter().map(|edge| edge.map(|node| coords[node as usize]));
    ends.flat_map(|[a, b]| [a, b, [f64::NAN; 3]]).collect()
}

/// Place of a node of the structure as cut in the shape around which the grid file of the scene is fitted: bending compresses the ring (its README).
fn as_fitted(scene: &str, [x, y, z]: Point) -> Point {
    let factor = if scene == "ring-in-fluid" { 1.0 - 1.0 / 1200.0 } else { 1.0 };
    [factor * x, y, factor * z]
}

/// Edges between two patches of the boundary.
fn edges_of_patches(grid: &FlowGrid) -> Vec<Point> {
    let faces = grid.boundary.iter().map(|(_, face)| face).zip(&grid.boundary_patch);
    let edges = patch_edges(faces.map(|(face, patch)| (face, u32::from(*patch))), |of| {
        of.len() == 2 && of[0] != of[1]
    });
    lines(&grid.coords, &edges)
}

/// Edges of faces whose patches `shown` chooses.
fn patch_edges<'a>(
    faces: impl Iterator<Item = (&'a [u32; 4], u32)>,
    shown: fn(&[u32]) -> bool,
) -> Vec<[u32; 2]> {
    let mut patches: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    for (face, patch) in faces {
        for k in 0..4 {
            let [a, b] = [face[k], face[(k + 1) % 4]];
            if a != b {
                patches.entry([a.min(b), a.max(b)]).or_default().push(patch);
            }
        }
    }
    let mut edges: Vec<_> = patches.into_iter().filter(|(_, of)| shown(of)).map(|(edge, _)| edge).collect();
    edges.sort_unstable();
    edges
}

/// Widens the axes so that a metre is as long across as upwards.
fn equal_scales(mut figure: Panels) -> Panels {
    for k in 0..figure.panels.len() {
        // The room for the labels changes with the range.
        for _ in 0..3 {
            let [_, _, width, height] = figure.data_box(k).expect("a panel").place;
            let panel = &mut figure.panels[k];
            let length = |axis: &Axis| (axis.range[1] - axis.range[0]).max(1e-9);
            let scale = f64::max(length(&panel.x) / width, length(&panel.y) / height);
            for (axis, pixels) in [(&mut panel.x, width), (&mut panel.y, height)] {
                let middle = 0.5 * (axis.range[0] + axis.range[1]);
                axis.range = [-0.5, 0.5].map(|s| middle + s * scale * pixels);
            }
        }
    }
    figure
}
