//! How large a flow grid is, from its topology alone.

use case::{Canopy, FlowBox, PanelCanopy, Scene};

use super::{blocks, from_file};
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
/// computed, so a grid of millions of cells costs as much as its canopy. A grid from a file is read.
///
/// # Errors
/// Parameters that make no grid, and a file that cannot be read.
pub fn grid_sizes(scene: &Scene, canopy: &StructureMesh) -> Result<GridSizes, MeshError> {
    let Some(flow) = &scene.flow else {
        return Err(refuse("flow", "absent", "a flow grid needs the section [flow]"));
    };
    if let Some(file) = &flow.grid_file {
        let grid = from_file::from_file(file, canopy, &canopy.coords[..canopy.n_canopy])?;
        return Ok(GridSizes { cells: grid.cells.len() as u64, nodes: grid.coords.len() as u64 });
    }
    if let (Some(b), Canopy::Panel(p)) = (&flow.box_grid, &scene.canopy) {
        return Ok(of_box(b, p));
    }
    let (blocks, _) = blocks(scene, &flow.grid, canopy)?;
    Ok(GridSizes { cells: blocks.cells() as u64, nodes: blocks.nodes as u64 })
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
