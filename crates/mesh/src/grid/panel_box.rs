//! Hexahedra in a box around a panel: columns of cells below and above it.

use case::{BoxSides, FlowBox, PanelCanopy};

use crate::boxes::add_box_cells;
use crate::structure::{positive, refuse};
use crate::{FlowGrid, MeshError, Point, StructureMesh};

/// The grid around the panel at `positions`, m. The displacement of the panel decreases linearly
/// towards the walls.
pub(super) fn panel_box(
    b: &FlowBox,
    p: &PanelCanopy,
    canopy: &StructureMesh,
    positions: &[Point],
) -> Result<FlowGrid, MeshError> {
    let [along, ny] = p.cells.map(|n| n as usize);
    let (ahead, behind) = (b.cells_ahead as usize, b.cells_behind as usize);
    let nx = ahead + along + behind;
    let below = heights("flow.box.below_m", b.below_m, b.layers_below, b.first_layer_m)?;
    let above = heights("flow.box.above_m", b.above_m, b.layers_above, b.first_layer_m)?;
    let (level, nz) = (below.len() - 1, below.len() + above.len() - 2);
    if (nx as u64 + 1) * (ny as u64 + 1) * (nz as u64 + 1) > u64::from(u32::MAX) / 7 {
        return Err(refuse(
            "flow.box",
            nx * ny * nz,
            "gives more cells than 32-bit numbering allows; use fewer",
        ));
    }
    let mut grid = FlowGrid {
        coords: positions.to_vec(),
        canopy_nodes: (0..canopy.n_canopy as u32).collect(),
        canopy_faces: canopy.faces.clone(),
        ..FlowGrid::default()
    };
    let on_panel = |i: usize, j: usize| (i - ahead) + (along + 1) * j;
    let mut number = Vec::with_capacity((nx + 1) * (ny + 1) * (nz + 1));
    for k in 0..=nz {
        // How far from the panel, as a share of the way to the wall, and in metres.
        let (share, z) = if k <= level {
            (below[level - k] / b.below_m, -below[level - k])
        } else {
            (above[k - level] / b.above_m, above[k - level])
        };
        for j in 0..=ny {
            for i in 0..=nx {
                if k == level && (ahead..=ahead + along).contains(&i) {
                    number.push(on_panel(i, j) as u32);
                    continue;
                }
                let edge = i.clamp(ahead, ahead + along);
                let own = canopy.coords[on_panel(edge, j)];
                let moved = positions[on_panel(edge, j)];
                let beyond = if i < ahead {
                    -b.ahead_m * (ahead - i) as f64 / ahead as f64
                } else if i > ahead + along {
                    b.behind_m * (i - ahead - along) as f64 / behind as f64
                } else {
                    0.0
                };
                let length = if beyond < 0.0 { b.ahead_m } else { b.behind_m };
                let fade = (1.0 - share) * if beyond == 0.0 { 1.0 } else { 1.0 - beyond.abs() / length };
                let straight = [own[0] + beyond, own[1], own[2] + z];
                number.push(grid.coords.len() as u32);
                grid.coords.push(std::array::from_fn(|c| straight[c] + fade * (moved[c] - own[c])));
            }
        }
    }
    let node = |i: usize, j: usize, k: usize| number[i + (nx + 1) * (j + (ny + 1) * k)];
    grid.patch_names = BoxSides::NAMES.map(String::from).to_vec();
    grid.boundary_patch = add_box_cells(&mut grid, [nx, ny, nz], b.sides.in_order(), node);
    Ok(grid)
}

/// Distances of the levels from the panel, m: equal, or growing by a factor from `first`.
fn heights(key: &'static str, height: f64, layers: u32, first: Option<f64>) -> Result<Vec<f64>, MeshError> {
    let height = positive(key, height)?;
    let n = layers.max(1) as i32;
    let Some(first) = first else {
        return Ok((0..=n).map(|k| height * f64::from(k) / f64::from(n)).collect());
    };
    let first = positive("flow.box.first_layer_m", first)?;
    let sum = |growth: f64| (0..n).map(|k| first * growth.powi(k)).sum::<f64>();
    if sum(1.0) > height * (1.0 + 1e-12) {
        return Err(refuse("flow.box.first_layer_m", first, "is above the height of equal layers"));
    }
    let (mut low, mut high) = (1.0, 2.0);
    while sum(high) < height {
        high *= 2.0;
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        *(if sum(middle) < height { &mut low } else { &mut high }) = middle;
    }
    let mut levels = vec![0.0];
    (0..n).for_each(|k| levels.push(levels[k as usize] + first * high.powi(k)));
    levels[n as usize] = height;
    Ok(levels)
}

#[cfg(test)]
mod tests {
    use case::{Canopy, Condition, PanelEdges, Scene};

    use super::*;
    use crate::grid::tests::flow_scene;
    use crate::{FaceTable, flow_grid, quality, structure_mesh};

    fn scene(held: PanelEdges, change: impl FnOnce(&mut FlowBox)) -> Scene {
        let panel = PanelCanopy { size_m: [2.0, 0.5], cells: [8, 2], held };
        let mut scene = flow_scene(Canopy::Panel(panel));
        let mut b = FlowBox {
            below_m: 1.0,
            above_m: 0.5,
            layers_below: 6,
            layers_above: 4,
            first_layer_m: None,
            ahead_m: 0.0,
            cells_ahead: 0,
            behind_m: 0.0,
            cells_behind: 0,
            sides: Default::default(),
        };
        change(&mut b);
        scene.flow.as_mut().unwrap().box_grid = Some(b);
        scene
    }

    fn volume(grid: &FlowGrid) -> f64 {
        (0..grid.cells.len()).map(|c| quality::cell_volume(grid, c)).sum()
    }

    #[test]
    fn a_panel_that_spans_its_box() {
        let scene = scene(PanelEdges::All, |b| b.first_layer_m = Some(2e-3));
        let canopy = structure_mesh(&scene).unwrap();
        assert_eq!((canopy.n_canopy, canopy.faces.len(), canopy.fixed.len()), (27, 16, 20));
        // A bulge up: the walls stay where they are, and so does the whole volume.
        let mut x = canopy.coords.clone();
        x.iter_mut().for_each(|x| x[2] = 0.2 * (1.0 - x[0] * x[0]) * (1.0 - 16.0 * x[1] * x[1]));
        let grid = flow_grid(&scene, &canopy, &x).unwrap();
        assert_eq!((grid.cells.len(), grid.coords.len()), (8 * 2 * 10, 9 * 3 * 11));
        assert_eq!(&grid.coords[..27], &x[..]);
        assert!((volume(&grid) - 2.0 * 0.5 * 1.5).abs() < 1e-12);
        let table = FaceTable::new(&grid).unwrap();
        assert_eq!((table.canopy.len(), grid.boundary.len()), (16, 2 * 16 + 2 * 80 + 2 * 20));
        // The first cells at the edge of the panel are as thick as asked for.
        let column = |k: usize| grid.cells[k * 16].map(|n| grid.coords[n as usize][2]);
        assert!((column(6)[4] - 2e-3).abs() < 1e-14 && (column(5)[0] + 2e-3).abs() < 1e-14);
    }

    #[test]
    fn a_leaflet_inside_its_box() {
        let scene = scene(PanelEdges::Root, |b| {
            (b.ahead_m, b.cells_ahead, b.behind_m, b.cells_behind) = (1.0, 3, 2.0, 4);
            b.sides.left = Condition::FarField;
        });
        let canopy = structure_mesh(&scene).unwrap();
        // Held at one end, guided along the sides.
        assert_eq!(canopy.fixed.iter().filter(|f| f.1 == [true; 3]).count(), 3);
        assert_eq!(canopy.fixed.iter().filter(|f| f.1 == [false, true, false]).count(), 16);
        let mut x = canopy.coords.clone();
        x.iter_mut().for_each(|x| x[2] += 0.1 * (x[0] + 1.0));
        let grid = flow_grid(&scene, &canopy, &x).unwrap();
        assert_eq!(grid.cells.len(), 15 * 2 * 10);
        assert!((volume(&grid) - 5.0 * 0.5 * 1.5).abs() < 1e-12);
        let far = grid.boundary.iter().filter(|b| b.0 == Condition::FarField);
        assert!(
            far.clone().count() == 20 && far.flat_map(|b| b.1).all(|n| grid.coords[n as usize][0] == -2.0)
        );
        FaceTable::new(&grid).unwrap();
    }
}
