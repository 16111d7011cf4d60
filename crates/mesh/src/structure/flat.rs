//! Canopies cut from one flat sheet, and the octant of the air bag.

use case::{AirBag, FlatCanopy};

use super::{even, positive, refuse};
use crate::{CableKind, MeshError, StructureMesh, Vec3};

/// Shape of the rim.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Outline {
    Square,
    Circle,
}

impl Outline {
    /// Maps the square [-1, 1]^2 to the sheet of half-width 1. The disc is the
    /// elliptical map: lines of constant x or y become ellipses.
    fn map(self, x: f64, y: f64) -> [f64; 2] {
        match self {
            Outline::Square => [x, y],
            Outline::Circle => [x * (1.0 - 0.5 * y * y).sqrt(), y * (1.0 - 0.5 * x * x).sqrt()],
        }
    }
}

/// Rim nodes of an (n + 1)^2 sheet, counter-clockwise from its first corner.
pub(crate) fn rim(n: usize) -> Vec<u32> {
    let node = |i: usize, j: usize| (i + (n + 1) * j) as u32;
    let sides: [&dyn Fn(usize) -> u32; 4] =
        [&|s| node(s, 0), &|s| node(n, s), &|s| node(n - s, n), &|s| node(0, n - s)];
    sides.iter().flat_map(|side| (0..n).map(side)).collect()
}

fn sheet(n: usize, at: impl Fn(usize, usize) -> Vec3) -> StructureMesh {
    let node = |i: usize, j: usize| (i + (n + 1) * j) as u32;
    let mut mesh = StructureMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            mesh.coords.push(at(i, j));
        }
    }
    mesh.n_canopy = mesh.coords.len();
    for j in 0..n {
        for i in 0..n {
            mesh.push_quad(
                [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)],
                0,
                (i + j) % 2 == 0,
            );
        }
    }
    mesh
}

pub(super) fn flat(
    p: &FlatCanopy,
    outline: Outline,
    payload_mass: Option<f64>,
) -> Result<StructureMesh, MeshError> {
    let n = even("canopy.cells_across", p.cells_across)?;
    let half = 0.5 * positive("canopy.width_m", p.width_m)?;
    let across = |a: usize| (2.0 * a as f64 - n as f64) / n as f64;
    let mut mesh = sheet(n, |i, j| {
        let [x, y] = outline.map(across(i), across(j));
        [half * x, half * y, 0.0]
    });
    let rim = rim(n);
    let count = p.line_count as usize;
    if count == 0 {
        mesh.fixed.extend(rim.iter().map(|&node| (node, [true; 3])));
        return Ok(mesh);
    }
    if count > rim.len() {
        return Err(refuse(
            "canopy.line_count",
            count,
            format!("must be 0 to {}, the number of nodes along the rim", rim.len()),
        ));
    }
    let length = positive("canopy.line_length_m", p.line_length_m)?;
    let segments = p.segments_per_line as usize;
    if !(1..=10_000).contains(&segments) {
        return Err(refuse("canopy.segments_per_line", segments, "must be from 1 to 10000"));
    }
    let ends: Vec<u32> = (0..count).map(|l| rim[(l * rim.len() + count / 2) / count % rim.len()]).collect();
    let reach = ends.iter().map(|&e| mesh.coords[e as usize]).map(|x| x[0].hypot(x[1])).fold(0.0, f64::max);
    if length <= reach {
        return Err(refuse(
            "canopy.line_length_m",
            length,
            format!("must exceed {reach:.4} m, the distance of its rim node from the axis"),
        ));
    }
    // The longest lines are just taut.
    let payload = mesh.push_node([0.0, 0.0, -(length * length - reach * reach).sqrt()]);
    for (line, &end) in ends.iter().enumerate() {
        mesh.push_line([end, payload], length, segments, CableKind::SuspensionLine, line as u32);
    }
    mesh.fixed.push((payload, [true; 3]));
    mesh.point_masses.extend(payload_mass.map(|mass| (payload, mass)));
    Ok(mesh)
}

/// A quarter of the upper sheet: symmetry planes x = 0 and y = 0, and the seam
/// on the mirror plane z = 0.
pub(super) fn air_bag(p: &AirBag) -> Result<StructureMesh, MeshError> {
    let n = p.cells_across as usize;
    if !(1..=10_000).contains(&n) {
        return Err(refuse("canopy.cells_across", n, "must be from 1 to 10000"));
    }
    let half = 0.5 * positive("canopy.edge_m", p.edge_m)?;
    let mut mesh = sheet(n, |i, j| [half * i as f64 / n as f64, half * j as f64 / n as f64, 0.0]);
    for j in 0..=n {
        for i in 0..=n {
            let fixed = [i == 0, j == 0, i == n || j == n];
            if fixed.contains(&true) {
                mesh.fixed.push(((i + (n + 1) * j) as u32, fixed));
            }
        }
    }
    Ok(mesh)
}
