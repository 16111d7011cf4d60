//! Friction of one pair: the gradient of its energy, Coulomb's limit, balance of forces and moments.

use super::edge_tests::{across, crossed, pair_of_triangles, search};
use super::tests::{contact, forces, positions};
use super::*;

const FRICTION: f64 = 0.3;

/// A node on a triangle and an edge on an edge, pressed and at rest: with the nodes that slide, a normal and the force on them.
fn pressed() -> [(Contact, Vec<f64>, std::ops::Range<usize>); 2] {
    let mut node = contact(vec![[0, 1, 2]], 4);
    let mut edges = pair_of_triangles();
    (node.friction, edges.friction) = (Some(FRICTION), Some(FRICTION));
    search(&mut node, &positions(0.09));
    search(&mut edges, &crossed(0.09, 1.2));
    let at_rest = [positions(0.02), crossed(0.02, 1.2)];
    for (contact, x) in [&mut node, &mut edges].into_iter().zip(&at_rest) {
        search(contact, x);
        contact.advance_history(x);
        assert!(contact.energy(x) > 0.0);
    }
    let [a, b] = at_rest;
    [(node, a, 3..4), (edges, b, 0..3)]
}

/// Positions after all nodes have moved in different ways, of this size (m).
fn moved(x: &[f64], size: f64) -> Vec<f64> {
    x.iter().enumerate().map(|(i, x)| x + size * (1.7 * i as f64 + 0.3).sin()).collect()
}

fn balanced(found: &[f64], x: &[f64]) {
    let nodes = 0..x.len() / 3;
    let size = found.iter().fold(0.0f64, |m, f| m.max(f.abs()));
    let sum: Vec3 = nodes.clone().map(|n| at(found, n)).sum();
    let moment: Vec3 = nodes.map(|n| at(x, n).cross(&at(found, n))).sum();
    assert!(sum.norm() < 1e-13 * size && moment.norm() < 1e-12 * size, "{sum} {moment} {size}");
}

/// A pair that sticks: forces are the gradient of its energy, in balance.
#[test]
fn sticking_forces_are_the_gradient_of_the_energy() {
    for (contact, x, _) in pressed() {
        let x = moved(&x, 2e-3);
        let found = forces(&contact, &x);
        let mut without = contact;
        let (energy, h) = (without.energy(&x), 1e-7);
        for (i, f) in found.iter().enumerate() {
            let at = |d: f64| {
                without.energy(
                    &x.iter().enumerate().map(|(k, v)| if k == i { v + d } else { *v }).collect::<Vec<_>>(),
                )
            };
            let wanted = (at(h) - at(-h)) / (2.0 * h);
            assert!((f - wanted).abs() < 1e-5, "{i}: {f} {wanted}");
        }
        balanced(&found, &x);
        without.friction = None;
        // The spring of friction holds a part of it.
        assert!(energy > 1.0005 * without.energy(&x), "{energy} {}", without.energy(&x));
    }
}

/// A pair that has slipped: its tangential force is the coefficient of friction times the normal force, against the motion and in balance; the end of
/// the step takes force times slip, and leaves the force as it is.
#[test]
fn slipping_force_is_the_limit_of_coulomb() {
    for (mut contact, x, slides) in pressed() {
        let normal = {
            let f = forces(&contact, &x);
            slides.clone().map(|n| -at(&f, n)).sum::<Vec3>()
        };
        let along = normal.cross(&Vec3::new(0.3, 1.0, -0.2)).normalize();
        let mut there = x.clone();
        for n in slides.clone() {
            (0..3).for_each(|i| there[3 * n + i] += 0.05 * along[i]);
        }
        let force = |contact: &Contact| {
            let f = forces(contact, &there);
            balanced(&f, &there);
            slides.clone().map(|n| -at(&f, n)).sum::<Vec3>()
        };
        let before = force(&contact);
        let friction = before - normal;
        assert!((friction + along * (FRICTION * normal.norm())).norm() < 1e-9, "{friction} {normal}");
        contact.advance_history(&there);
        let limit = FRICTION * normal.norm() / 700.0;
        // From no force to the limit in one step, over the slip.
        let wanted = 0.5 * FRICTION * normal.norm() * (0.05 - limit);
        let taken = contact.dissipated();
        assert!((taken - wanted).abs() < 1e-9, "{taken} {wanted}");
        assert!((force(&contact) - before).norm() < 1e-9);
        contact.keep();
        let saved = contact.save_state();
        let mut resumed = Contact {
            friction: Some(FRICTION),
            ..Contact::of(contact.triangles.clone(), x.len() / 3, super::tests::LAW, 1.0)
        };
        resumed.restore_state(&saved).expect("its own state");
        assert_eq!((resumed.save_state(), forces(&resumed, &there)), (saved, forces(&contact, &there)));
        // Apart, it has forgotten where it stuck.
        contact.advance_history(
            &moved(&x, 0.0)
                .iter()
                .enumerate()
                .map(
                    |(i, x)| {
                        if slides.contains(&(i / 3)) { x + 0.1 * normal[i % 3] / normal.norm() } else { *x }
                    },
                )
                .collect::<Vec<_>>(),
        );
        assert!(
            contact.pairs.iter().all(|p| p.stick.is_none())
                && contact.edges.pairs.iter().all(|p| p.row()[6] == 0.0)
        );
    }
}

/// A pair that sticks keeps the energy of its spring on the next triangle, and on the next edge.
#[test]
fn sticking_pair_keeps_its_spring_on_the_next_face() {
    let sheet = |x: f64, z: f64| -> Vec<f64> {
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [x, x, z]].concat()
    };
    let mut node = contact(vec![[0, 1, 2], [1, 3, 2]], 5);
    let mut edges = contact(vec![[0, 1, 3], [1, 2, 4], [5, 6, 7]], 8);
    let (over, over_edges) = ([sheet(0.47, 0.09), sheet(0.47, 0.02), sheet(0.53, 0.02)], {
        [across(-0.1, 0.09), across(-0.1, 0.02), across(0.1, 0.02)]
    });
    for (contact, places, way) in [(&mut node, over, 0.06 * 2f64.sqrt()), (&mut edges, over_edges, 0.2)] {
        // No slip.
        contact.friction = Some(1e3);
        places[..2].iter().for_each(|x| search(contact, x));
        contact.advance_history(&places[1]);
        contact.advance_history(&places[2]);
        let wanted = 350.0 * (0.03f64.powi(2) + way * way);
        let found = contact.energy(&places[2]);
        assert!((found - wanted).abs() < 1e-9 && contact.dissipated() == 0.0, "{found} {wanted}");
    }
}
