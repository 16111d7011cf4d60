//! The flow grid around a canopy.

mod file_error;
mod from_file;
#[cfg(test)]
mod from_file_tests;
#[cfg(test)]
mod inflate;
mod node_placement;
mod panel_box;
mod sizes;
mod smooth;
#[cfg(test)]
mod tests;
mod topology;

use crate::geometry::{Point, at};
use crate::quality;
use crate::structure::{AtpsLayout, flat_layout, positive, refuse};
use crate::{FlowGrid, MeshError, StructureMesh};
pub use file_error::GridFileError;
pub use sizes::{GridSizes, grid_sizes, wake_cell};
use topology::Blocks;

use case::{Canopy, Grid, Scene};

/// Vents narrower than this share of the canopy's width are closed.
const LEAST_VENT: f64 = 0.01;

/// Body-conforming hexahedra around the canopy at `positions` (m, one for each
/// of its nodes), a box around a panel, or the scene's own grid from a file. Canopy nodes come first, in the canopy's order. Depends on the
/// arguments alone, to the last bit.
///
/// # Errors
/// A canopy without flow grid, parameters or positions that make none, closed
/// vents, and a shape around which no valid grid was found.
pub fn flow_grid(scene: &Scene, canopy: &StructureMesh, positions: &[Point]) -> Result<FlowGrid, MeshError> {
    let grid = draft_grid(scene, canopy, positions)?;
    if scene.grid_file().is_some() {
        // Its volumes are positive; what its corners are like is the user's choice.
        return Ok(grid);
    }
    let worst = quality::summary(&grid);
    if worst.min_volume <= 0.0 || worst.min_scaled_jacobian <= 0.0 {
        return Err(MeshError::Tangled {
            cell: worst.worst_cell,
            at: worst.worst_at,
            quality: worst.min_scaled_jacobian,
        });
    }
    Ok(grid)
}

/// What [`flow_grid`] makes, valid or not: for pictures of what went wrong.
///
/// # Errors
/// As [`flow_grid`], without a look at the cells.
pub fn draft_grid(scene: &Scene, canopy: &StructureMesh, positions: &[Point]) -> Result<FlowGrid, MeshError> {
    let Some(flow) = &scene.flow else {
        return Err(refuse("flow", "absent", "a flow grid needs the section [flow]"));
    };
    if positions.len() != canopy.n_canopy {
        let (found, expected) = (positions.len(), canopy.n_canopy);
        return Err(MeshError::Count { what: "positions of canopy nodes", found, expected });
    }
    if let Some(node) = positions.iter().position(|x| x.iter().any(|v| !v.is_finite())) {
        return Err(refuse(
            "positions",
            format!("{:?}", positions[node]),
            format!("canopy node {node} is nowhere"),
        ));
    }
    if let Some(file) = &flow.grid_file {
        return from_file::from_file(file, canopy, positions);
    }
    if let (Some(b), Canopy::Panel(p)) = (&flow.box_grid, &scene.canopy) {
        return panel_box::panel_box(b, p, canopy, positions);
    }
    let (blocks, width) = blocks(scene, &flow.grid, canopy)?;
    check_vents(&blocks, positions, LEAST_VENT * width)?;
    let coords = node_placement::place(&blocks, positions, &flow.grid, width);
    let mut grid = blocks.grid(coords, canopy);
    let (canopy_nodes, far) = (canopy.n_canopy, blocks.far_field());
    smooth::smooth(&mut grid, |n| n < canopy_nodes || n >= far);
    Ok(grid)
}

/// Checks the counts and lengths of `[flow.grid]` that need no canopy, except the first layer.
fn check_extents(grid: &Grid) -> Result<(), MeshError> {
    for (key, value) in [
        ("flow.grid.layers_inside", grid.layers_inside),
        ("flow.grid.layers_outside", grid.layers_outside),
        ("flow.grid.cells_across_vent", grid.cells_across_vent),
    ] {
        if !(1..=10_000).contains(&value) {
            return Err(refuse(key, value, "must be from 1 to 10000"));
        }
    }
    for (key, value) in
        [("flow.grid.far_field_widths", grid.far_field_widths), ("flow.grid.wake_widths", grid.wake_widths)]
    {
        if !(1.5..=1e4).contains(&value) {
            return Err(refuse(key, value, "must be from 1.5 to 10000 canopy widths"));
        }
    }
    Ok(())
}

/// Nodes of the canopy in rows and columns, and its width, m.
fn canopy_layout(scene: &Scene) -> Result<(AtpsLayout, f64), MeshError> {
    let none = |kind, reason: &str| Err(refuse("canopy.kind", kind, reason));
    match &scene.canopy {
        Canopy::Atps(a) => Ok((AtpsLayout::new(a)?, a.top_width_m)),
        Canopy::Square(f) => Ok((flat_layout(f, false)?, f.width_m)),
        Canopy::Circular(f) => Ok((flat_layout(f, true)?, f.width_m)),
        Canopy::Gored(_) => {
            none("gored", "no fitted grid is made around gores: add [flow.immersed] with spacing_m")
        }
        Canopy::Cross(_) => {
            none("cross", "no fitted grid is made around a cross: add [flow.immersed] with spacing_m")
        }
        Canopy::Pattern(_) => none(
            "pattern",
            "no fitted grid is made around a sewn canopy: add [flow.immersed] with spacing_m, or a [flow.grid_file] around it",
        ),
        Canopy::AirBag(_) => none("air-bag", "the air bag has no flow grid; run the structure alone"),
        Canopy::Panel(_) => none("panel", "the grid around a panel is a box: add [flow.box]"),
        Canopy::None => none("none", "no grid is generated without a canopy: add [flow.grid_file]"),
        Canopy::Gmsh(_) => none(
            "gmsh",
            "flow grids are generated for parametric canopies only; add [flow.grid_file], or run the structure alone",
        ),
    }
}

/// Blocks and the width of the canopy, m.
fn blocks(scene: &Scene, grid: &Grid, canopy: &StructureMesh) -> Result<(Blocks, f64), MeshError> {
    check_extents(grid)?;
    let (layout, width) = canopy_layout(scene)?;
    let first = positive("flow.grid.first_layer_m", grid.first_layer_m)?;
    if first > 0.25 * width {
        return Err(refuse(
            "flow.grid.first_layer_m",
            first,
            format!("must be below a quarter of the canopy's width, {:.4} m", 0.25 * width),
        ));
    }
    // Levels of open fluid between the hem and the cap: as long as cells are high.
    let skirt = match scene.canopy {
        Canopy::Atps(_) => layout.m.div_ceil(4),
        _ => layout.n.div_ceil(3),
    };
    let layers = [grid.layers_inside as usize, grid.layers_outside as usize];
    let (n, m) = (layout.n as u64, layout.m as u64);
    let surface = 2 * n * n + 4 * (n + u64::from(grid.cells_across_vent)) * (m + skirt as u64);
    let nodes = surface * (layers[0] + layers[1]) as u64 + (n + 1) * (n + 1) * (m + skirt as u64 + 1);
    // Faces are numbered in 32 bits, six for each cell.
    if nodes > u64::from(u32::MAX) / 7 {
        return Err(refuse(
            "flow.grid",
            nodes,
            "gives more nodes than 32-bit numbering allows; use fewer cells",
        ));
    }
    let blocks = Blocks::new(layout, canopy, skirt.max(2), grid.cells_across_vent as usize, layers);
    Ok((blocks, width))
}

fn check_vents(blocks: &Blocks, positions: &[Point], least_m: f64) -> Result<(), MeshError> {
    if blocks.open_levels().next().is_none() {
        return Ok(());
    }
    let opening = |k: usize, b: usize| {
        let [p, q] = [0, blocks.across].map(|z| at(positions, blocks.zipper(k, z, b)));
        (p - q).norm()
    };
    let widest = |k: usize| blocks.open_levels().map(|b| opening(k, b)).fold(0.0, f64::max);
    let width_m = (0..4).map(widest).fold(f64::INFINITY, f64::min);
    if width_m < least_m {
        return Err(MeshError::VentsClosed { width_m, least_m });
    }
    Ok(())
}
