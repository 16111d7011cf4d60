//! Canopies cut from one flat sheet, and the octant of the air bag.

use case::{AirBag, FlatCanopy};

use super::atps::{AtpsLayout, turn};
use super::{even, positive, refuse};
use crate::{CableKind, MeshError, Point, StructureMesh};

/// Shape of the rim.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Outline {
    Square,
    Circle,
}

/// Node numbers of a flat canopy: a square is one n x n panel; a disc has rings
/// around a smaller panel, because the four corners of a single panel would lie
/// straight on the rim, as cells with a corner of 180 degrees.
pub(crate) fn layout(p: &FlatCanopy, round: bool) -> Result<AtpsLayout, MeshError> {
    let n = even("canopy.cells_across", p.cells_across)?;
    if !round {
        return Ok(AtpsLayout::sheet(n, 0));
    }
    if n < 4 {
        return Err(refuse("canopy.cells_across", n, "must be at least 4 for a circular canopy"));
    }
    let rings = (n / 6).max(1);
    Ok(AtpsLayout::sheet(n - 2 * rings, rings))
}

/// Places the nodes of a disc of radius 1.
fn place_disc(layout: &AtpsLayout, coords: &mut [Point]) {
    let (n, rings) = (layout.n, layout.m);
    let across = |a: usize| (2.0 * a as f64 - n as f64) / n as f64;
    // Half-way between a square and the disc, whose lines x, y = const become
    // ellipses; as wide as its share of the cells.
    let size = n as f64 / (n + 2 * rings) as f64 / (0.5 * 0.85 + 0.5);
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (across(i), across(j));
            let round = [x * (1.0 - 0.5 * y * y).sqrt(), y * (1.0 - 0.5 * x * x).sqrt()];
            let mix = |flat: f64, round: f64| size * (0.5 * 0.85 * flat + 0.5 * round);
            coords[layout.top(i, j) as usize] = [mix(x, round[0]), mix(y, round[1]), 0.0];
        }
    }
    for a in 0..=n {
        // Side 0 rotated, so that all sides are equal to the last bit.
        let edge = coords[layout.arm(0, a, 0) as usize];
        let angle = std::f64::consts::FRAC_PI_4 * across(a);
        let rim = [angle.cos(), angle.sin(), 0.0];
        for b in 1..=rings {
            let t = b as f64 / rings as f64;
            let x = std::array::from_fn(|i| edge[i] + t * (rim[i] - edge[i]));
            for k in 0..4 {
                coords[layout.arm(k, a, b) as usize] = turn(k, x);
            }
        }
    }
}

pub(super) fn flat(
    p: &FlatCanopy,
    outline: Outline,
    payload_mass: Option<f64>,
) -> Result<StructureMesh, MeshError> {
    let half = 0.5 * positive("canopy.width_m", p.width_m)?;
    let layout = layout(p, outline == Outline::Circle)?;
    let mut mesh = StructureMesh { coords: vec![[0.0; 3]; layout.nodes()], ..Default::default() };
    mesh.n_canopy = layout.nodes();
    match outline {
        Outline::Circle => place_disc(&layout, &mut mesh.coords),
        Outline::Square => {
            let across = |a: usize| (2.0 * a as f64 - layout.n as f64) / layout.n as f64;
            for j in 0..=layout.n {
                for i in 0..=layout.n {
                    mesh.coords[layout.top(i, j) as usize] = [across(i), across(j), 0.0];
                }
            }
        }
    }
    mesh.coords.iter_mut().flatten().for_each(|x| *x *= half);
    layout.push_faces(&mut mesh, |_| 0);
    let rim = layout.rim();
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
    let layout = AtpsLayout::sheet(n, 0);
    let mut mesh = StructureMesh { coords: vec![[0.0; 3]; layout.nodes()], ..Default::default() };
    mesh.n_canopy = layout.nodes();
    for j in 0..=n {
        for i in 0..=n {
            mesh.coords[layout.top(i, j) as usize] =
                [half * i as f64 / n as f64, half * j as f64 / n as f64, 0.0];
        }
    }
    layout.push_faces(&mut mesh, |_| 0);
    for j in 0..=n {
        for i in 0..=n {
            let fixed = [i == 0, j == 0, i == n || j == n];
            if fixed.contains(&true) {
                mesh.fixed.push((layout.top(i, j), fixed));
            }
        }
    }
    Ok(mesh)
}
