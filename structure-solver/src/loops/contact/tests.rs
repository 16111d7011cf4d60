//! Contact against closed forms, and its rules for pairs.

use super::*;

/// A triangle and a node at a distance from it, none of whose directions is an axis.
pub(super) fn positions(distance: f64) -> Vec<f64> {
    let corners = [[0.2, -0.1, 0.3], [1.1, 0.2, 0.0], [0.4, 0.9, 0.5]].map(Vec3::from);
    let area = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    let n = area * (1.0 / area.norm());
    let foot: Vec3 = Vec3::from_fn(|i, _| 0.5 * corners[0][i] + 0.3 * corners[1][i] + 0.2 * corners[2][i]);
    let node: Vec3 = Vec3::from_fn(|i, _| foot[i] + distance * n[i]);
    [corners[0], corners[1], corners[2], node].map(<[f64; 3]>::from).concat()
}

pub(super) const LAW: ContactLaw = ContactLaw { thickness: 0.05, stiffness: 700.0, friction: None };

pub(super) fn contact(triangles: Vec<[u32; 3]>, nodes: u32) -> Contact {
    let mut contact = Contact::of(triangles, nodes as usize, LAW, 1.0);
    contact.nodes = (0..nodes).collect();
    contact.slots = (0..nodes).collect();
    contact
}

/// The node came to this distance from out of contact.
fn pressed(distance: f64) -> (Contact, Vec<f64>) {
    let mut contact = contact(vec![[0, 1, 2]], 4);
    contact.advance_history(&positions(0.09 * distance.signum()));
    let x = positions(distance);
    contact.advance_history(&x);
    (contact, x)
}

/// A node that is near when it is seen first is pressed only once it comes nearer, also where it lies on the triangle.
#[test]
fn pair_begins_without_force() {
    for distance in [0.02, -0.03, 1e-6] {
        let mut contact = contact(vec![[0, 1, 2]], 4);
        let x = positions(distance);
        contact.advance_history(&x);
        assert_eq!((contact.pairs.len(), contact.energy(&x)), (1, 0.0), "{distance}");
        let nearer = positions(distance - 0.015 * distance.signum());
        assert!((contact.pressed(&nearer) - 700.0 * 0.015).abs() < 1e-9, "{distance}");
    }
}

/// A node that slides from one triangle of a sheet to the next keeps the force on it.
#[test]
fn sliding_node_keeps_side_and_distance() {
    let sheet = |node: [f64; 3]| -> Vec<f64> {
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], node].concat()
    };
    let mut contact = contact(vec![[0, 1, 2], [1, 3, 2]], 5);
    contact.advance_history(&sheet([0.3, 0.3, 0.09]));
    contact.advance_history(&sheet([0.3, 0.3, -0.01]));
    let there = sheet([0.7, 0.7, -0.01]);
    contact.advance_history(&there);
    let pairs: Vec<_> = contact.pairs.iter().map(|p| (p.triangle, p.side, p.thickness)).collect();
    assert_eq!(pairs, [(1, 1.0, 0.05)]);
    assert!((contact.pressed(&there) - 700.0 * 0.06).abs() < 1e-10);
}

/// Solves of a window depend on their input alone: what one has found is forgotten by the next, and a saved state is that of the accepted window.
#[test]
fn rejected_solve_leaves_no_trace() {
    let mut contact = contact(vec![[0, 1, 2]], 4);
    contact.advance_history(&positions(0.09));
    contact.advance_history(&positions(0.04));
    contact.keep();
    let saved = contact.save_state();
    let pressed = |contact: &mut Contact| {
        contact.rewind();
        contact.advance_history(&positions(0.01));
        contact.pressed(&positions(0.01))
    };
    let first = pressed(&mut contact);
    for wild in [0.3, -0.04, -0.3, 1e6, f64::NAN] {
        contact.advance_history(&positions(wild));
    }
    assert_eq!(contact.save_state(), saved);
    assert_eq!(pressed(&mut contact), first);
    let mut resumed = self::contact(vec![[0, 1, 2]], 4);
    resumed.restore_state(&saved).expect("its own state");
    assert_eq!(pressed(&mut resumed), first);
    assert!((first - 700.0 * 0.04).abs() < 1e-9, "{first}");
}

/// The distance that a pair keeps grows with the distance of its node, up to the thickness.
#[test]
fn distance_of_a_pair_recovers() {
    let mut contact = contact(vec![[0, 1, 2]], 4);
    for (distance, kept) in [(0.01, 0.01), (0.035, 0.035), (0.02, 0.035), (0.08, 0.05), (0.02, 0.05)] {
        contact.advance_history(&positions(distance));
        assert!((contact.pairs[0].thickness - kept).abs() < 1e-12, "{distance}");
    }
}

/// A pressed node that comes near the other leaf of a fold gets no force from it: only what it loses on the first leaf goes over to the second.
#[test]
fn second_leaf_of_a_fold_begins_without_force() {
    // Leaves in the planes z = 0 and x = 0.03 with one common node.
    let fold = |node: [f64; 3]| -> Vec<f64> {
        [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.03, 0.0, 2.0], [0.03, 2.0, 0.0], node].concat()
    };
    let mut contact = contact(vec![[0, 1, 2], [0, 4, 3]], 6);
    contact.advance_history(&fold([0.7, 0.6, 0.09]));
    contact.advance_history(&fold([0.7, 0.6, 0.01]));
    let there = fold([0.05, 0.6, 0.02]);
    let alone = {
        contact.advance_history(&fold([0.4, 0.6, 0.02]));
        contact.energy(&fold([0.4, 0.6, 0.02]))
    };
    contact.advance_history(&there);
    assert_eq!(contact.pairs.iter().filter(|p| p.node == 5).count(), 2);
    assert!((contact.energy(&there) - alone).abs() < 1e-10, "{} {alone}", contact.energy(&there));
}

pub(super) fn forces(contact: &Contact, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    let load = FaceLoad { pressure: &[], traction: &[] };
    contact.forces(Configuration { at: x, end: x, weight: 1.0 }, load, &mut out);
    out
}

/// Energy `k (h - d)^2 / 2` on either side; the forces are its gradient, and the blocks of the tangent
/// `k n n` at the node and the squares of the weights of it at the corners.
#[test]
fn forces_are_the_gradient_of_the_energy() {
    for distance in [0.02, -0.03, 0.049, -0.001] {
        let (contact, x) = pressed(distance);
        let gap = 0.05 - f64::abs(distance);
        assert!((contact.energy(&x) - 350.0 * gap * gap).abs() < 1e-12);
        assert!((contact.pressed(&x) - 700.0 * gap).abs() < 1e-10);
        let found = forces(&contact, &x);
        let differences = |f: &dyn Fn(&[f64]) -> f64, i: usize| {
            let h = 1e-6;
            let at = |d: f64| {
                f(&x.iter().enumerate().map(|(k, v)| if k == i { v + d } else { *v }).collect::<Vec<_>>())
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for (i, f) in found.iter().enumerate() {
            let wanted = differences(&|x| contact.energy(x), i);
            assert!((f - wanted).abs() < 1e-6, "{distance}, {i}: {f} {wanted}");
        }
        let (mut blocks, mut out) = (vec![[[0.0; 3]; 3]; 4], vec![0.0; 12]);
        let load = FaceLoad { pressure: &[], traction: &[] };
        contact.tangent(Configuration { at: &x, end: &x, weight: 1.0 }, load, 0.6, &mut out, &mut blocks);
        assert_eq!(out, found);
        for i in 0..3 {
            for j in 0..3 {
                let wanted = 0.6 * differences(&|x| forces(&contact, x)[9 + i], 9 + j);
                assert!((blocks[3][i][j] - wanted).abs() < 1e-5, "{} {wanted}", blocks[3][i][j]);
                for (corner, w) in [0.5, 0.3, 0.2].iter().enumerate() {
                    assert!((blocks[corner][i][j] - w * w * blocks[3][i][j]).abs() < 1e-9);
                }
            }
        }
    }
    let (contact, x) = pressed(0.051);
    assert_eq!((contact.energy(&x), forces(&contact, &x)), (0.0, vec![0.0; 12]));
}

/// A pair is found up to two thicknesses on either side, wherever the boxes of the search lie.
#[test]
fn pairs_are_found_within_reach_in_any_box() {
    for step in 0..40 {
        let shift = 0.173 * f64::from(step) - 3.0;
        for (distance, near) in [(0.09, true), (-0.09, true), (0.104, false), (-0.104, false)] {
            let mut contact = contact(vec![[0, 1, 2]], 4);
            contact.edge = 0.3;
            let x: Vec<f64> = positions(distance).iter().map(|x| x + shift).collect();
            contact.advance_history(&x);
            assert_eq!(contact.pairs.len(), usize::from(near), "{shift} {distance}");
            assert!(contact.pairs.iter().all(|p| p.side == distance.signum() && p.node == 3));
        }
    }
}

/// Pairs are sought again where a node has moved by more than [`MARGIN`] relative to the others since, not where all have, and a node
/// keeps its side when it is pressed through.
#[test]
fn a_search_is_repeated_after_a_motion() {
    let (mut contact, x) = pressed(0.02);
    // One of four nodes: three quarters of its motion are relative to the mean.
    let moved = |by: f64| x.iter().enumerate().map(|(i, x)| x + if i == 4 { by } else { 0.0 }).collect();
    let least = MARGIN * 0.05 / 0.75;
    let (little, more): (Vec<f64>, Vec<f64>) = (moved(-0.98 * least), moved(-1.02 * least));
    contact.advance_history(&x.iter().map(|x| x + 7.0).collect::<Vec<_>>());
    assert_eq!(contact.searched, x);
    contact.advance_history(&little);
    assert_eq!(contact.searched, x);
    contact.advance_history(&more);
    assert_eq!(contact.searched, more);
    let through = positions(-0.03);
    contact.advance_history(&through);
    assert_eq!(contact.searched, through);
    assert!(contact.pairs.len() == 1 && contact.pairs[0].side == 1.0, "{:?}", contact.pairs);
    assert!((contact.pressed(&through) - 700.0 * 0.08).abs() < 1e-10);
    // Far behind it is still the same pair; far in front it is none.
    let deep = positions(-0.3);
    contact.advance_history(&deep);
    assert_eq!(contact.pairs.len(), 1);
    let away = positions(0.3);
    contact.advance_history(&away);
    assert!(contact.pairs.is_empty());
}

/// The foot of a node lies on the triangle up to two per cent beyond its edges.
#[test]
fn feet_have_their_weights_and_a_margin() {
    let t = [[0.2, -0.1, 0.3], [1.1, 0.2, 0.0], [0.4, 0.9, 0.5]].map(Vec3::from);
    let at = |w: [f64; 3]| -> Vec3 { Vec3::from_fn(|i, _| (0..3).map(|k| w[k] * t[k][i]).sum()) };
    for k in 0..3 {
        for (beyond, found) in [(-0.019, true), (-0.021, false)] {
            let mut w = [0.5 * (1.0 - beyond); 3];
            w[k] = beyond;
            let foot = project(at(w), &t);
            assert_eq!(foot.is_some(), found, "{w:?}");
            if let Some((d, _, b)) = foot {
                assert!(d.abs() < 1e-15 && (0..3).all(|i| (b[i] - w[i]).abs() < 1e-14), "{b:?}");
            }
        }
    }
}
