//! Nodes out of balance: which are chosen, how well they are balanced, and what it brings.

use std::path::Path;
use std::rc::Rc;

use comm::Comm;

use super::*;
use crate::assemble;
use crate::dynamics::{Dynamics, LoadPath};
use crate::loops::{Configuration, FaceLoad};

/// The octant of the paper's air bag with 2 n^2 triangles.
fn bag(n: usize, tolerance: f64) -> Dynamics {
    let text = format!(
        r#"
        name = "bag"
        [canopy]
        kind = "air-bag"
        cells_across = {n}
        [fabric]
        youngs_modulus_pa = 206.8e6
        poisson_ratio = 0.3
        thickness_m = 3.048e-5
        density_kg_m3 = 1223.5093
        wrinkling = true
        [structure]
        spectral_radius = 0.0
        newton_tolerance = {tolerance:e}
        [[stage]]
        name = "one"
        kind = "pre-inflation"
        pressure_pa = 23.94
        duration_s = 0.05
        window_s = 1e-4
        "#
    );
    let scene = case::parse(Path::new("bag.toml"), &text).expect("a good scene");
    let mesh = Rc::new(mesh::structure_mesh(&scene).expect("a good mesh"));
    assemble::dynamics(&Comm::solo(), &scene, 0, &mesh).expect("a good structure")
}

/// Newton steps of `steps` time steps of 1e-4 s.
fn inflate(d: &mut Dynamics, steps: usize) -> u64 {
    let p = vec![23.94; d.system.model.n_faces];
    let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
    let mut newton = 0;
    for _ in 0..steps {
        let info = d.window(1e-4, 1, load, [0.0; 3], false).expect("a solvable step");
        assert_eq!(info.cuts, 0);
        newton += info.newton_steps;
        d.accept();
    }
    newton
}

/// Nodes within `rings` rings of elements around a node, by the triangles.
fn around(system: &System, node: usize, rings: usize) -> Vec<bool> {
    let mut inside = vec![false; system.model.n_local()];
    inside[node] = true;
    for _ in 0..rings {
        let before = inside.clone();
        for t in system.model.triangles.iter().filter(|t| t.nodes.iter().any(|&n| before[n as usize])) {
            t.nodes.iter().for_each(|&n| inside[n as usize] = true);
        }
    }
    inside
}

fn norm(g: &[f64]) -> f64 {
    g.iter().map(|g| g * g).sum::<f64>().sqrt()
}

#[test]
fn it_takes_the_nodes_out_of_balance_and_two_rings() {
    let d = bag(12, 1e-5);
    let system = &d.system;
    let mut e = Elimination::new(system);
    let mut g = vec![0.0; 3 * system.model.n_owned()];
    let mut choose = |g: &[f64], load: f64| {
        let chosen = e.choose(system, g, norm(g), load);
        (chosen, e.active.clone())
    };
    assert!(!choose(&g, 1.0).0, "nothing is out of balance");
    g.fill(1.0);
    assert!(!choose(&g, 1.0).0, "where all nodes are alike, none is chosen");
    g.fill(1e-9);
    let node = system.model.n_owned() / 2;
    g[3 * node + 1] = 1.0;
    let (chosen, active) = choose(&g, 1.0);
    assert!(chosen);
    assert_eq!(active, around(system, node, 2));
    assert!(!choose(&g, 1e6).0, "an imbalance far below the load is left to the whole");
    // Every third node: with their rings, all of them.
    (0..system.model.n_owned()).step_by(3).for_each(|i| g[3 * i] = 1.0);
    (0..system.model.n_owned()).step_by(9).for_each(|i| g[3 * i] = 100.0);
    assert!(!choose(&g, 1.0).0, "too many");
}

#[test]
fn a_correction_balances_the_chosen_nodes_alone() {
    let mut d = bag(12, 1e-5);
    inflate(&mut d, 8);
    let n = 3 * d.system.model.n_owned();
    let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
    let p = vec![23.94; d.system.model.n_faces];
    let load = FaceLoad { pressure: &p, traction: &[] };
    let mut e = Elimination::new(&d.system);
    let mut g = vec![0.0; n];
    let node = d.system.model.n_owned() / 2;
    g[3 * node..3 * node + 3].copy_from_slice(&[0.1, -0.2, 0.3]);
    assert!(e.choose(&d.system, &g, norm(&g), 1.0));
    let mut out = vec![0.0; n];
    d.system.tangent_near(&e.active, Configuration::only(&x), load, 1.0, 2e8, &mut out);
    let mut du = vec![f64::NAN; n];
    assert!(e.correct(&d.system, &g, &mut du));
    let mut product = vec![0.0; n];
    linalg::Operator::apply(&d.system.matrix, &mut du, &mut product);
    let mut left = 0.0;
    for i in 0..n {
        if e.active[i / 3] {
            left += (g[i] - product[i]).powi(2);
        } else {
            assert_eq!(du[i], 0.0, "a node that was not chosen moved");
        }
    }
    assert!(left.sqrt() <= 1.01e-2 * norm(&g), "{left}");
    let reached = e.reach(&d.system, &du).to_vec();
    assert_eq!(reached, around(&d.system, node, 3));
}

/// It changes where Newton starts, not what a step converges to.
#[test]
fn a_step_has_the_same_answer_without_it() {
    let [mut with, mut without] = [0; 2].map(|_| bag(12, 1e-10));
    without.newton.set_most_rounds(0);
    inflate(&mut with, 30);
    inflate(&mut without, 30);
    assert!(with.newton.eliminations() > 0 && without.newton.eliminations() == 0);
    let off = with.accepted.u.iter().zip(&without.accepted.u).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    let moved = with.accepted.u.iter().fold(0.0f64, |m, u| m.max(u.abs()));
    assert!(off < 1e-8 * moved, "{off} of {moved} m");
}

/// Fails if it stops helping. The finer the mesh the more it spares: 34, 40, 49, 56 % of the steps at 20, 24, 30, 36 cells.
#[test]
fn it_spares_newton_steps_where_a_bag_folds() {
    let [mut with, mut without] = [0; 2].map(|_| bag(30, 1e-5));
    without.newton.set_most_rounds(0);
    let steps = [&mut with, &mut without].map(|d| inflate(d, 120));
    println!("Newton steps with and without elimination: {steps:?}");
    assert!(3 * steps[0] < 2 * steps[1], "{steps:?}");
}
