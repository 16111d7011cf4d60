//! How large a flow grid is, from its topology alone.

use case::{Canopy, FlowBox, PanelCanopy, Scene};

use super::{blocks, from_file, node_placement};
use crate::structure::refuse;
use crate::{MeshError, StructureMesh};

/// Counts of a flow grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GridSizes {
    /// Cells.
    pub cells: u64,
    /// Nodes.
    pub nodes: u64,
}

/// Sizes of the grid that [`super::flow_grid`] makes around `canopy` at any position: no coordinates are
/// computed, so a grid of millions of cells costs as much as its canopy. A grid from a file is read, and fitted to `canopy` unless
/// an earlier stage gives it another shape.
///
/// # Errors
/// Parameters that make no grid, and a file that cannot be read.
pub fn grid_sizes(scene: &Scene, canopy: &StructureMesh) -> Result<GridSizes, MeshError> {
    let Some(flow) = &scene.flow else {
        return Err(refuse("flow", "absent", "a flow grid needs the section [flow]"));
    };
    if let Some(file) = &flow.grid_file {
        if scene.grid_awaits_shape() {
            return from_file::sizes(file);
        }
        let grid = from_file::from_file(file, canopy, &canopy.coords[..canopy.n_canopy])?;
        return Ok(GridSizes { cells: grid.cells.len() as u64, nodes: grid.coords.len() as u64 });
    }
    if let (Some(b), Canopy::Panel(p)) = (&flow.box_grid, &scene.canopy) {
        return Ok(of_box(b, p));
    }
    let (blocks, _) = blocks(scene, &flow.grid, canopy)?;
    Ok(GridSizes { cells: blocks.cells() as u64, nodes: blocks.nodes as u64 })
}

/// Largest extent of the cells one width downstream of a canopy of this `width` (m) with cells of size `edge` (m), m, in a generated grid or a box: from
/// the growth of the layers and the spread of the lines. `None` where a file gives the grid.
pub fn wake_cell(scene: &Scene, width: f64, edge: f64) -> Option<f64> {
    let flow = scene.flow.as_ref()?;
    if flow.grid_file.is_some() || !(width > 0.0 && edge > 0.0) {
        return None;
    }
    if let Some(g) = &flow.immersed {
        return Some(g.spacing_m + (g.growth - 1.0) * (1.0 - g.wake).max(0.0) * width);
    }
    if let Some(b) = &flow.box_grid {
        let mean = |length: f64, cells: u32| if cells > 0 { length / f64::from(cells) } else { 0.0 };
        let high = mean(b.above_m, b.layers_above).max(mean(b.below_m, b.layers_below));
        return Some(edge.max(high).max(mean(b.behind_m, b.cells_behind)));
    }
    let g = &flow.grid;
    let ratio = node_placement::growth(g.first_layer_m / (g.wake_widths * width), g.layers_outside as usize);
    // Of the cell whose middle is there.
    let along = match ratio - 1.0 {
        0.0 => g.wake_widths * width / f64::from(g.layers_outside),
        more => (g.first_layer_m + more * width) / (1.0 + 0.5 * more),
    };
    // Lines from the canopy end on a quarter of the far field.
    let spread = 1.0 + (std::f64::consts::SQRT_2 * g.far_field_widths - 1.0) / g.wake_widths;
    Some(along.max(edge * spread))
}

/// Nodes of the panel's plane beyond the panel are single, as all others: the panel's faces are walls
/// between cells that share nodes.
fn of_box(b: &FlowBox, p: &PanelCanopy) -> GridSizes {
    let along =
        [u64::from(b.cells_ahead) + u64::from(p.cells[0]) + u64::from(b.cells_behind), p.cells[1].into()];
    let high = u64::from(b.layers_below) + u64::from(b.layers_above);
    GridSizes { cells: along[0] * along[1] * high, nodes: (along[0] + 1) * (along[1] + 1) * (high + 1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{draft_grid, structure_mesh};

    /// Every kind of grid has the sizes that were said beforehand.
    #[test]
    fn predicted_sizes_match_the_grid() {
        let cases = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases");
        for name in ["square-drop", "plate-gmsh", "hard/leaflet", "hard/membrane-box", "hard/cavity"] {
            let scene = case::load(&cases.join(name).join("scene.toml")).unwrap();
            let canopy = structure_mesh(&scene).unwrap();
            let grid = draft_grid(&scene, &canopy, &canopy.coords[..canopy.n_canopy]).unwrap();
            let sizes = grid_sizes(&scene, &canopy).unwrap();
            assert_eq!(sizes.cells, grid.cells.len() as u64, "{name}");
            assert_eq!(sizes.nodes, grid.coords.len() as u64, "{name}");
        }
    }

    /// The estimate of the cells in the wake against the grid itself: the median largest extent of cells about one width above the canopy.
    #[test]
    fn cells_of_the_wake_are_as_large_as_estimated() {
        let cases = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases");
        let scene = case::load(&cases.join("square-drop/scene.toml")).unwrap();
        for layers in [12, 24] {
            for far in [4.0, 8.0] {
                let mut scene = scene.clone();
                let grid = &mut scene.flow.as_mut().unwrap().grid;
                (grid.layers_outside, grid.far_field_widths) = (layers, far);
                let Canopy::Square(square) = &scene.canopy else { panic!("a square") };
                let (width, edge) = (square.width_m, square.width_m / f64::from(square.cells_across));
                let canopy = structure_mesh(&scene).unwrap();
                let made = draft_grid(&scene, &canopy, &canopy.coords[..canopy.n_canopy]).unwrap();
                let top = canopy.coords[..canopy.n_canopy].iter().map(|x| x[2]).fold(f64::MIN, f64::max);
                let mut sizes: Vec<f64> = Vec::new();
                for cell in &made.cells {
                    let at = cell.map(|n| made.coords[n as usize]);
                    let middle = [0, 1, 2].map(|d| at.iter().map(|x| x[d]).sum::<f64>() / 8.0);
                    let above = (middle[2] - top) / width;
                    if (0.7..1.3).contains(&above) && middle[0].hypot(middle[1]) < 0.5 * width {
                        let extent = |d: usize| {
                            let along = at.iter().map(|x| x[d]);
                            along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
                        };
                        sizes.push(extent(0).max(extent(1)).max(extent(2)));
                    }
                }
                sizes.sort_by(f64::total_cmp);
                let (found, estimate) = (sizes[sizes.len() / 2], wake_cell(&scene, width, edge).unwrap());
                println!("{layers} layers, {far} widths: {found:.3} m, estimated {estimate:.3} m");
                assert!((estimate / found).ln().abs() < 0.3, "{found} m, estimated {estimate} m");
            }
        }
    }

    /// The ATPS needs no inflated shape to be counted: 46 500 cells, as `ripstop run` says of its grid.
    #[test]
    fn closed_vents_are_counted_in_the_sizes() {
        let cases = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases");
        let scene = case::load(&cases.join("atps-descent/scene.toml")).unwrap();
        let canopy = structure_mesh(&scene).unwrap();
        let sizes = grid_sizes(&scene, &canopy).unwrap();
        assert!(draft_grid(&scene, &canopy, &canopy.coords[..canopy.n_canopy]).is_err());
        assert!(sizes.cells > 40_000 && sizes.cells < 55_000, "{sizes:?}");
    }
}
