//! Edges against edges: closed forms, identities, and the rules for pairs.

use super::tests::{contact, forces};
use super::*;

/// A rotation none of whose axes is an axis of the coordinates, and a shift.
fn placed(points: &[[f64; 3]]) -> Vec<f64> {
    let turn = rotation();
    points.iter().flat_map(|p| <[f64; 3]>::from(turn * Vec3::from(*p) + Vec3::new(0.4, -1.3, 2.2))).collect()
}

fn rotation() -> mesh::geometry::Mat3 {
    // The columns of a rotation by Euler's angles 0.7, -0.4, 1.1.
    let (sa, ca) = 0.7f64.sin_cos();
    let (sb, cb) = (-0.4f64).sin_cos();
    let (sc, cc) = 1.1f64.sin_cos();
    mesh::geometry::Mat3::new(
        ca * cb,
        ca * sb * sc - sa * cc,
        ca * sb * cc + sa * sc,
        sa * cb,
        sa * sb * sc + ca * cc,
        sa * sb * cc - ca * sc,
        -sb,
        cb * sc,
        cb * cc,
    )
}

/// Two triangles whose free edges 0-1 and 3-4 cross at an angle (rad), the first at a distance above the other;
/// both triangles recede from the crossing.
pub(super) fn crossed(distance: f64, angle: f64) -> Vec<f64> {
    let (s, c) = angle.sin_cos();
    placed(&[
        [-0.6, 0.0, distance],
        [0.4, 0.0, distance],
        [0.0, 0.3, distance + 0.7],
        [-0.45 * c, -0.45 * s, 0.0],
        [0.55 * c, 0.55 * s, 0.0],
        [-0.3 * s, 0.3 * c, -0.7],
    ])
}

pub(super) fn pair_of_triangles() -> Contact {
    contact(vec![[0, 1, 2], [3, 4, 5]], 6)
}

/// The first edge came to this distance from out of contact.
fn pressed(distance: f64, angle: f64) -> (Contact, Vec<f64>) {
    let mut contact = pair_of_triangles();
    search(&mut contact, &crossed(0.09, angle));
    let x = crossed(distance, angle);
    search(&mut contact, &x);
    // Of nearly parallel edges the other sides of the triangles are near too.
    contact.edges.pairs.retain(|p| p.row()[..2] == [0.0, 3.0]);
    assert_eq!((contact.pairs.len(), contact.edges.pairs.len()), (0, 1), "{distance} {angle}");
    (contact, x)
}

/// Searches also where little has moved.
pub(super) fn search(contact: &mut Contact, x: &[f64]) {
    contact.searched.clear();
    contact.advance_history(x);
}

/// Force on the first edge along the direction in which it was approached.
fn held(contact: &Contact, x: &[f64]) -> f64 {
    let up = at(&placed(&[[0.0, 0.0, 1.0]]), 0) - at(&placed(&[[0.0; 3]]), 0);
    let f = forces(contact, x);
    -(at(&f, 0) + at(&f, 1)).dot(&up)
}

/// `k (h - d)` along the normal, without force where the pair begins, and towards the same side where the edges were pushed through each other.
#[test]
fn crossing_edges_keep_their_side() {
    for distance in [0.02, 1e-6] {
        let mut contact = pair_of_triangles();
        let x = crossed(distance, 1.2);
        search(&mut contact, &x);
        assert_eq!((contact.edges.pairs.len(), contact.energy(&x)), (1, 0.0), "{distance}");
    }
    let (mut contact, x) = pressed(0.02, 1.2);
    assert!((held(&contact, &x) - 700.0 * 0.03).abs() < 1e-9);
    for distance in [-0.02, -0.06] {
        let through = crossed(distance, 1.2);
        assert!((held(&contact, &through) - 700.0 * (0.05 - distance)).abs() < 1e-9, "{distance}");
        search(&mut contact, &through);
        assert!((held(&contact, &through) - 700.0 * (0.05 - distance)).abs() < 1e-9, "{distance}");
    }
    search(&mut contact, &crossed(0.101, 1.2));
    assert!(contact.edges.pairs.is_empty());
}

/// The distance that a pair keeps grows with the distance of its edges, up to the thickness.
#[test]
fn distance_of_edges_recovers() {
    let mut contact = pair_of_triangles();
    for (distance, kept) in [(0.01, 0.01), (0.035, 0.035), (0.015, 0.035), (0.08, 0.05), (0.02, 0.05)] {
        let x = crossed(distance, 1.2);
        search(&mut contact, &x);
        assert!((contact.pressed(&x) - 700.0 * (kept - distance).max(0.0)).abs() < 1e-9, "{distance}");
    }
}

/// Forces are the gradient of the energy, their sum and their moment vanish; also between nearly parallel edges, whose energy fades.
#[test]
fn forces_of_edges_are_the_gradient_of_the_energy() {
    for (distance, angle) in [(0.02, 1.2), (-0.03, 0.5), (0.01, 0.06), (0.02, 0.03)] {
        let (contact, x) = pressed(distance, angle);
        let gap = 0.05 - distance;
        let c = f64::sin(angle).powi(2) / 0.01;
        let fade = if c < 1.0 { c * (2.0 - c) } else { 1.0 };
        assert!((contact.energy(&x) - 350.0 * gap * gap * fade).abs() < 1e-10, "{distance} {angle}");
        let found = forces(&contact, &x);
        let size = found.iter().fold(0.0f64, |m, f| m.max(f.abs()));
        assert!(size > 1.0);
        for (i, f) in found.iter().enumerate() {
            let h = 1e-6;
            let energy = |d: f64| {
                contact.energy(
                    &x.iter().enumerate().map(|(k, v)| if k == i { v + d } else { *v }).collect::<Vec<_>>(),
                )
            };
            let wanted = (energy(h) - energy(-h)) / (2.0 * h);
            assert!((f - wanted).abs() < 1e-6 * size, "{distance} {angle}, {i}: {f} {wanted}");
        }
        let sum: Vec3 = (0..6).map(|n| at(&found, n)).sum();
        let moment: Vec3 = (0..6).map(|n| at(&x, n).cross(&at(&found, n))).sum();
        // Some rounding of forces of `size` at arms of 3 m; the crossing point of nearly parallel lines amplifies it.
        assert!(sum.norm() < 1e-13 * size && moment.norm() < 1e-12 * size / angle, "{sum} {moment} {size}");
    }
}

/// The blocks of the tangent are `k n n` times the squares of the weights.
#[test]
fn tangent_of_edges_has_the_squares_of_the_weights() {
    let (contact, x) = pressed(0.02, 1.2);
    let (mut blocks, mut out) = (vec![[[0.0; 3]; 3]; 6], vec![0.0; 18]);
    let load = FaceLoad { pressure: &[], traction: &[] };
    contact.tangent(Configuration { at: &x, end: &x, weight: 1.0 }, load, 0.6, &mut out, &mut blocks);
    assert_eq!(out, forces(&contact, &x));
    for (node, w) in [0.4, 0.6, 0.0, 0.55, 0.45, 0.0].iter().enumerate() {
        let trace: f64 = (0..3).map(|i| blocks[node][i][i]).sum();
        assert!((trace - 0.6 * 700.0 * w * w).abs() < 1e-9, "{node} {trace}");
    }
}

/// Edges that turn through the parallel under pressure: the energy is continuous, and they keep their side beyond it.
#[test]
fn edges_that_turn_through_the_parallel_keep_their_side() {
    let (mut contact, _) = pressed(0.03, 0.2);
    let steps: Vec<f64> = (0..=80).map(|k| 0.2 - 0.005 * f64::from(k)).collect();
    let mut last = None::<f64>;
    for angle in steps {
        let x = crossed(0.03, angle);
        search(&mut contact, &x);
        let energy = contact.energy(&x);
        assert!(energy <= 350.0 * 0.02 * 0.02 + 1e-12, "{angle} {energy}");
        // The fade has a slope of at most 1.54 / sqrt(0.01) by the angle.
        assert!(last.is_none_or(|e| (energy - e).abs() < 350.0 * 0.02 * 0.02 * 15.4 * 0.0051), "{angle}");
        last = Some(energy);
    }
    assert!((held(&contact, &crossed(0.03, -0.2)) - 700.0 * 0.02).abs() < 1e-9);
}

/// Edges 0-1 and 1-2 in one line along x at a height `z` (m), with apexes 3 and 4 above; edge 5-6 across at `x` (m), with apex 7 below.
pub(super) fn across(x: f64, z: f64) -> Vec<f64> {
    placed(&[
        [-1.0, 0.0, z],
        [0.0, 0.0, z],
        [1.0, 0.0, z],
        [-0.5, 0.2, z + 0.9],
        [0.5, 0.2, z + 0.9],
        [x, -0.5, 0.0],
        [x + 0.1, 0.5, 0.0],
        [x, 0.0, -0.9],
    ])
}

/// An edge that slides under pressure from one free edge of a sheet to the next keeps the energy of its pair.
#[test]
fn sliding_edge_keeps_its_energy() {
    let mut contact = contact(vec![[0, 1, 3], [1, 2, 4], [5, 6, 7]], 8);
    search(&mut contact, &across(-0.3, 0.09));
    search(&mut contact, &across(-0.3, -0.01));
    let first = contact.edges.pairs.clone();
    let there = across(0.2, -0.01);
    search(&mut contact, &there);
    assert_eq!((first.len(), contact.edges.pairs.len()), (1, 1));
    assert_ne!(first, contact.edges.pairs);
    assert!((contact.energy(&there) - 350.0 * 0.06 * 0.06).abs() < 1e-10, "{}", contact.energy(&there));
    // Off the end of the last edge the force ends.
    search(&mut contact, &across(1.2, -0.01));
    assert!(contact.edges.pairs.is_empty());
}

/// A sheet of two triangles whose common edge 0-1 crosses the free edge 4-5 below; its outer nodes are higher by `rise` (m).
fn ridge(rise: f64) -> (Contact, Vec<f64>) {
    let x = placed(&[
        [-0.6, 0.0, 0.03],
        [0.4, 0.0, 0.03],
        [0.0, 0.9, 0.03 + rise],
        [0.0, -0.9, 0.03 + rise],
        [0.0, -0.45, 0.0],
        [0.1, 0.55, 0.0],
        [0.8, 0.0, -0.6],
    ]);
    let mut contact = contact(vec![[0, 1, 2], [1, 0, 3], [4, 5, 6]], 7);
    search(&mut contact, &x);
    (contact, x)
}

/// Interior edges act where they are a ridge: the triangles recede by more than the thickness, not where the sheet is flat or a valley.
#[test]
fn interior_edges_act_where_they_are_a_ridge() {
    for (rise, pairs) in [(0.0, 0), (0.049, 0), (0.051, 1), (0.4, 1), (-0.2, 0)] {
        let (contact, _) = ridge(rise);
        let middle = contact.edges.pairs.len();
        assert_eq!(middle, pairs, "{rise}");
    }
}

/// What a rejected solve has found leaves no trace, and a saved state is that of the accepted window, to the bit.
#[test]
fn rejected_solve_leaves_no_trace_in_edges() {
    let (mut contact, _) = pressed(0.04, 1.2);
    contact.keep();
    let saved = contact.save_state();
    let solve = |contact: &mut Contact| {
        contact.rewind();
        let x = crossed(0.01, 1.1);
        search(contact, &x);
        (forces(contact, &x), contact.energy(&x))
    };
    let first = solve(&mut contact);
    assert!((first.1 - 350.0 * 0.04 * 0.04).abs() < 1e-9, "{first:?}");
    for wild in [0.3, -0.04, -0.3, 1e6, f64::NAN] {
        search(&mut contact, &crossed(wild, 1.0));
    }
    assert_eq!(contact.save_state(), saved);
    assert_eq!(solve(&mut contact), first);
    let mut resumed = pair_of_triangles();
    resumed.restore_state(&saved).expect("its own state");
    assert_eq!((resumed.save_state(), solve(&mut resumed)), (saved.clone(), first));
    // Numbers that are none of a pair are refused.
    for (place, wrong) in [(0, 1.0), (1, 2.0), (2, 7.0), (3, 0.0), (4, 3.0), (7, 0.06), (7, -1e-3)] {
        let mut bad = saved.clone();
        bad[place] = wrong;
        assert!(pair_of_triangles().restore_state(&bad).is_err(), "{place} {wrong}");
    }
}

/// `layers` square sheets of `n` by `n` cells of 1 m on each other, each pleated and turned a little: a third of their edges are ridges.
fn layers(n: u32, layers: u32) -> (Contact, Vec<f64>) {
    let (mut triangles, mut x) = (Vec::new(), Vec::new());
    for layer in 0..layers {
        let (s, c) = (0.01 * f64::from(layer)).sin_cos();
        let base = layer * (n + 1) * (n + 1);
        for j in 0..=n {
            for i in 0..=n {
                let (a, b) = (f64::from(i), f64::from(j));
                x.extend([c * a - s * b, s * a + c * b, 0.04 * f64::from(layer) + 0.3 * f64::from(i % 2)]);
                let p = base + j * (n + 1) + i;
                if i < n && j < n {
                    triangles.extend([[p, p + 1, p + n + 2], [p, p + n + 2, p + n + 1]]);
                }
            }
        }
    }
    let nodes = x.len() as u32 / 3;
    (contact(triangles, nodes), x)
}

/// The boxes that a search compares grow with the number of edges, not with its square.
#[test]
fn cost_of_a_search_is_linear() {
    let per_edge = |n: u32| {
        let (mut contact, x) = layers(n, 3);
        search(&mut contact, &x);
        let edges = 3 * (3 * n * n + 2 * n);
        contact.edges.compared as f64 / f64::from(edges)
    };
    let (small, large) = (per_edge(10), per_edge(40));
    println!(
        "boxes compared for each edge: {small:.1} of 10 x 10 cells, {large:.1} of 40 x 40 cells, three layers"
    );
    // The rim, all of whose edges are free, is a larger share of the small sheet.
    assert!(large < 1.2 * small && large > 3.0, "{small} {large}");
}
