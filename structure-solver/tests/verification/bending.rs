//! Bending of cloth: strips and sheets with closed forms.

use std::f64::consts::PI;

use comm::Comm;
use mesh::StructureMesh;
use structure_solver::dynamics::{Dynamics, LoadPath};
use structure_solver::elements::mass::MassMatrix;
use structure_solver::loops::{ElementLoop, Elements, FaceLoad};
use structure_solver::materials::{Elastic, StVenantKirchhoff};
use structure_solver::model::{Model, Surface};
use structure_solver::scheme::Scheme;
use structure_solver::system::System;

use crate::common::*;
use crate::energy::momenta;
use crate::shapes::*;
use crate::vibrations::half_periods;

/// Bending stiffness, N m, and width of the strips, m; their length is 1 m.
const D: f64 = 0.01;
const WIDTH: f64 = 0.25;
/// A force D/L^2 for each width stretches this fabric by 1e-6.
const YOUNGS_MODULUS: f64 = 1e7;

fn bent(mesh: &StructureMesh, element: Element, stiffness: f64, mass: MassMatrix) -> System {
    let surface = Surface { quadrilaterals: element == Element::Quad, bending: true, ..Surface::default() };
    let owner = vec![0; mesh.coords.len()];
    let model = Model::with(&Comm::solo(), mesh, &owner, surface).expect("a good mesh");
    let law = Elastic(StVenantKirchhoff::isotropic(YOUNGS_MODULUS, 0.0));
    let fabric: Box<dyn ElementLoop> = match element {
        Element::Triangle => Box::new(Elements::triangles(&model, law, SHEET[0], SHEET[1])),
        Element::Quad => Box::new(Elements::quads(&model, law, SHEET[0], SHEET[1])),
    };
    let bending = Box::new(Elements::bending(&model, stiffness));
    System::new(model, vec![fabric, bending], mass)
}

/// Moves inner nodes by up to `share` of a cell of `n` along each axis.
fn shift(m: &mut StructureMesh, n: [usize; 2], cell: [f64; 2], share: f64) {
    for j in 1..n[1] {
        for i in 2..n[0] {
            let k = i + (n[0] + 1) * j;
            for c in 0..2 {
                // Fractional parts of multiples of irrational numbers.
                let random = ((k + 1) as f64 * [0.754877666, 0.569840296][c]).fract() - 0.5;
                m.coords[k][c] += 2.0 * share * cell[c] * random;
            }
        }
    }
}

/// A strip along x whose tip is at 1 m, clamped at 0: in the middle of its first cells, whose nodes are fixed.
fn cantilever(n: [usize; 2], alternating: bool, share: f64) -> StructureMesh {
    let h = 1.0 / (n[0] as f64 - 0.5);
    let mut m = grid(n, alternating, |s, t| [(s * n[0] as f64 - 0.5) * h, WIDTH * t, 0.0]);
    fix(&mut m, |x| [x[0] < 0.6 * h; 3]);
    shift(&mut m, n, [h, WIDTH / n[1] as f64], share);
    m
}

/// A force (N for each width) along z at the tip, and the mean deflection there at rest.
fn tip_load(d: &mut Dynamics, m: &StructureMesh, n: [usize; 2], force: f64) -> [f64; 2] {
    let tip = |j: usize| n[0] + (n[0] + 1) * j;
    let share = |j: usize| if j == 0 || j == n[1] { 0.5 } else { 1.0 } / n[1] as f64;
    for j in 0..=n[1] {
        d.system.add_force(tip(j) as u32, [0.0, 0.0, force * WIDTH * share(j)]);
    }
    let none = vec![0.0; m.faces.len()];
    rest(d, FaceLoad { pressure: &none, traction: &[] }, [0.0; 3], 1e-9);
    [2, 0].map(|c| (0..=n[1]).map(|j| share(j) * d.accepted.u[3 * tip(j) + c]).sum())
}

fn deflection(n: [usize; 2], element: Element, alternating: bool, share: f64, force: f64) -> [f64; 2] {
    let m = cantilever(n, alternating, share);
    let system = bent(&m, element, D, MassMatrix::Consistent);
    let mut d = Dynamics::new(system, sharp(Scheme::newmark()));
    tip_load(&mut d, &m, n, force)
}

/// Small load at the tip: w = F L^3 / (3 D). Equal cells make a chain of hinges, which converges with the square of the
/// cell, whatever the diagonals; shifted nodes make a strip that is too stiff by a share that does not fall.
#[test]
fn a_cantilever_bends_as_its_closed_form() {
    let force = 3e-6;
    let exact = force / (3.0 * D);
    let error = |k: usize, element, alternating, share| {
        deflection([8 * k, 2 * k], element, alternating, share, force)[0] / exact - 1.0
    };
    for (name, element, alternating) in [
        ("one diagonal", Element::Triangle, false),
        ("alternating", Element::Triangle, true),
        ("quadrilaterals", Element::Quad, true),
    ] {
        let errors = [1, 2, 4].map(|k| error(k, element, alternating, 0.0));
        let order = orders(&errors);
        println!("cantilever, {name}: {}, orders {order:.2?}", sci(&errors));
        assert!(errors[2].abs() < 5e-4 && order.iter().all(|o| (1.9..2.1).contains(o)), "{errors:?}");
    }
    let errors = [1, 2, 4].map(|k| error(k, Element::Triangle, true, 0.25));
    println!("cantilever, nodes shifted by up to a quarter of a cell: {}", sci(&errors));
    assert!(errors.iter().all(|e| (-0.2..0.02).contains(e)), "{errors:?}");
}

/// Tip of an inextensible strip under a force of alpha D / L^2 for each width: deflection and shortening over L,
/// from theta'' = -alpha cos(theta), theta(0) = 0, theta'(1) = 0, by shooting.
fn elastica(alpha: f64) -> [f64; 2] {
    let steps = 4000;
    let h = 1.0 / f64::from(steps);
    let slope = |y: [f64; 4]| [y[1], -alpha * y[0].cos(), y[0].sin(), 1.0 - y[0].cos()];
    let run = |curvature: f64| {
        let mut y = [0.0, curvature, 0.0, 0.0];
        for _ in 0..steps {
            let add = |k: [f64; 4], by: f64| std::array::from_fn(|i| y[i] + by * k[i]);
            let k1 = slope(y);
            let k2 = slope(add(k1, 0.5 * h));
            let k3 = slope(add(k2, 0.5 * h));
            let k4 = slope(add(k3, h));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        y
    };
    let mut range = [0.0, alpha];
    for _ in 0..60 {
        let middle = 0.5 * (range[0] + range[1]);
        range[usize::from(run(middle)[1] > 0.0)] = middle;
    }
    let y = run(range[0]);
    [y[2], y[3]]
}

/// Large rotation. Deflection and shortening at alpha = 1 and 10: 0.30172, 0.05643; 0.81061, 0.55500 (Mattiasson 1981).
#[test]
fn a_heavily_loaded_cantilever_is_an_elastica() {
    for (alpha, table) in [(1.0, [0.30172, 0.05643]), (10.0, [0.81061, 0.55500])] {
        let exact = elastica(alpha);
        assert!((0..2).all(|i| (exact[i] - table[i]).abs() < 1e-5), "{exact:?} {table:?}");
        let mut errors = Vec::new();
        for n in [16, 32] {
            let [w, u] = deflection([n, 2], Element::Triangle, true, 0.0, alpha * D);
            println!(
                "elastica, alpha {alpha}, {n} cells: {w:.5} ({:.5}), {:.5} ({:.5})",
                exact[0], -u, exact[1]
            );
            errors.push((w - exact[0]).hypot(-u - exact[1]));
        }
        assert!(errors[0] < 5e-3 && (3.4..4.6).contains(&(errors[0] / errors[1])), "{errors:?}");
    }
}

/// First frequency of a cantilever: (1.8751 / L)^2 sqrt(D / mu) / (2 pi).
#[test]
fn a_cantilever_has_its_frequency() {
    let beta = 1.875104068711961;
    let frequency = beta * beta * (D / (SHEET[0] * SHEET[1])).sqrt() / (2.0 * PI);
    let ratio = (beta.cosh() + beta.cos()) / (beta.sinh() + beta.sin());
    let mode = |x: f64| (x.cosh() - x.cos()) - ratio * (x.sinh() - x.sin());
    let errors = [8, 16, 32].map(|n| {
        let m = cantilever([n, 2], true, 0.0);
        let system = bent(&m, Element::Triangle, D, MassMatrix::Consistent);
        let mut d = Dynamics::new(system, params(Scheme::newmark(), 0.0));
        for (i, x) in m.coords.iter().enumerate() {
            d.accepted.u[3 * i + 2] = 1e-4 * mode(beta * x[0].max(0.0));
        }
        for (i, _) in &m.fixed {
            d.accepted.u[3 * *i as usize + 2] = 0.0;
        }
        balance(&mut d, 0.0, [0.0; 3]);
        2.0 / half_periods(&mut d, 3 * n + 2, 1.0 / (300.0 * frequency), 4, [0.0; 3]) / frequency - 1.0
    });
    println!("cantilever, first frequency: {}", sci(&errors));
    assert!(errors[2].abs() < 3e-3 && errors[2].abs() < 0.5 * errors[0].abs(), "{errors:?}");
}

/// A strip on two supports under a compression P and a load q sin(pi x) bends by (q / pi^4 D) / (1 - P / P_cr), with
/// Euler's P_cr = pi^2 D / L^2 for each width.
#[test]
fn a_strip_buckles_at_eulers_load() {
    let q = 1e-3;
    let errors = [8, 16, 32].map(|n| {
        let middle = |share: f64| {
            let mut m = grid([n, 2], true, |s, t| [s, WIDTH * t, 0.0]);
            fix(&mut m, |x| [x[0] == 0.0, true, x[0] == 0.0 || x[0] == 1.0]);
            let mut d = Dynamics::new(
                bent(&m, Element::Triangle, D, MassMatrix::Consistent),
                sharp(Scheme::newmark()),
            );
            for (i, x) in m.coords.iter().enumerate() {
                let across = WIDTH * if x[1] == 0.0 || x[1] == WIDTH { 0.25 } else { 0.5 };
                let push = if x[0] == 1.0 { -share * PI * PI * D * across } else { 0.0 };
                d.system.add_force(i as u32, [push, 0.0, q * (PI * x[0]).sin() * across / n as f64]);
            }
            let none = vec![0.0; m.faces.len()];
            rest(&mut d, FaceLoad { pressure: &none, traction: &[] }, [0.0; 3], 1e-9);
            d.accepted.u[3 * (n / 2) + 2]
        };
        // w(P) / w(0) = 1 / (1 - P / P_cr)
        0.5 / (1.0 - middle(0.0) / middle(0.5)) - 1.0
    });
    let order = orders(&errors);
    println!("Euler's load: {}, orders {order:.2?}", sci(&errors));
    assert!(errors[2].abs() < 2e-3 && order.iter().all(|o| (1.8..2.2).contains(o)), "{errors:?}");
}

/// Energy of a sheet whose nodes lie on a cylinder, over D kappa^2 / 2 for each area between the hinges. Equal cells: 1 - (h / R)^2 / 6, as chords are shorter than arcs;
/// shifted nodes: a share that stays the same on finer meshes.
#[test]
fn a_rolled_sheet_has_the_energy_of_its_curvature() {
    let ratio = |n: usize, alternating: bool, share: f64, turned: bool| {
        let h = 1.0 / n as f64;
        let mut m = grid([n, n], alternating, |s, t| [s, t, 0.0]);
        shift(&mut m, [n, n], [h; 2], share);
        let system = bent(&m, Element::Triangle, D, MassMatrix::Consistent);
        let radius: f64 = 0.8;
        let (c, s) = if turned { (0.5f64.sqrt(), 0.5f64.sqrt()) } else { (1.0, 0.0) };
        let rolled: Vec<f64> = m
            .coords
            .iter()
            .flat_map(|x| {
                let (along, across) = (c * x[0] + s * x[1], c * x[1] - s * x[0]);
                [radius * (along / radius).sin(), across, radius * (1.0 - (along / radius).cos())]
            })
            .collect();
        let energy = system.loops()[1].energy(&rolled);
        energy / (0.5 * D / radius.powi(2) * if turned { 1.0 } else { 1.0 - h })
    };
    for n in [8, 16, 32] {
        let found = [(false, 0.0, false), (true, 0.0, true), (false, 0.25, false), (true, 0.25, true)]
            .map(|(alternating, share, turned)| ratio(n, alternating, share, turned));
        println!(
            "rolled sheet, {n} cells: equal {:.4}; alternating diagonals, rolled at 45 degrees {:.3}; shifted {:.3}, \
             shifted and rolled at 45 degrees {:.3}",
            found[0], found[1], found[2], found[3]
        );
        assert!((found[0] - 1.0).abs() < 0.3 / (n * n) as f64, "{found:?}");
        assert!((0.9..1.7).contains(&found[1]) && (0.9..1.4).contains(&found[2]), "{found:?}");
    }
}

/// A free strip.
fn free(stiffness: f64, mass: MassMatrix) -> (StructureMesh, System) {
    let m = grid([8, 4], true, |s, t| [s, 0.5 * t, 0.0]);
    let system = bent(&m, Element::Triangle, stiffness, mass);
    (m, system)
}

/// A strip that nothing holds, thrown so that it spins and bends through large angles: with averaged positions energy, momentum and
/// spin stay.
#[test]
fn a_free_strip_keeps_energy_momentum_and_spin() {
    let (m, system) = free(0.5, MassMatrix::Consistent);
    let mut d = Dynamics::new(system, sharp(Scheme::generalized_alpha(1.0)));
    for (i, x) in m.coords.iter().enumerate() {
        let v = [0.3 - 2.0 * x[1], 2.0 * x[0], 6.0 * (2.0 * PI * x[0]).cos() + 2.0 * x[1]];
        (0..3).for_each(|c| d.accepted.v[3 * i + c] = v[c]);
    }
    balance(&mut d, 0.0, [0.0; 3]);
    let total = |d: &Dynamics| energies(d).iter().sum::<f64>();
    let (start, before) = (total(&d), momenta(&d));
    let (mut drift, mut lost, mut most) = (0.0f64, 0.0f64, 0.0f64);
    for _ in 0..100 {
        window(&mut d, 1e-2, 5, 0.0, [0.0; 3]);
        drift = drift.max((total(&d) / start - 1.0).abs());
        most = most.max(d.system.loops()[1].energy(&positions(&d)) / start);
        let now = momenta(&d);
        lost = (0..2).fold(lost, |m, k| (0..3).fold(m, |m, c| m.max((now[k][c] - before[k][c]).abs())));
    }
    println!(
        "free strip: energy {drift:.1e}, momentum and spin {lost:.1e}, bending at most {most:.2} of the energy"
    );
    assert!(drift < 1e-8 && lost < 1e-8 && most > 0.2, "{drift} {lost} {most}");
}

/// Energy after 2000 explicit steps at a share of the stable step, over its start. Bending, not stretch, sets the step.
fn growth(share: f64) -> [f64; 2] {
    let stiffness = 100.0;
    let (m, system) = free(stiffness, MassMatrix::Lumped);
    let mut d = Dynamics::new(system, params(Scheme::newmark(), 0.0));
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.v[3 * i + 2] = 1e-3 * ((2.0 * PI * x[0]).cos() + (i as f64 * 2.1).sin());
    }
    balance(&mut d, 0.0, [0.0; 3]);
    let start = energies(&d).iter().sum::<f64>();
    let stable = d.integrate_explicitly(1.0).expect("a sheet with mass").stable_step();
    d.integrate_explicitly(1e3).expect("a sheet with mass");
    let none = vec![0.0; m.faces.len()];
    let load = LoadPath { pressure: [&none; 2], traction: [&[]; 2] };
    for _ in 0..200 {
        if d.window(10.0 * share * stable, 10, load, [0.0; 3], false).is_err() {
            return [f64::INFINITY, stable];
        }
        d.accept();
    }
    [energies(&d).iter().sum::<f64>() / start, stable]
}

#[test]
fn the_stable_step_contains_bending() {
    let ([below, stable], [above, _]) = (growth(0.95), growth(1.05));
    let plain = {
        let (m, _) = free(1.0, MassMatrix::Lumped);
        let law = Elastic(StVenantKirchhoff::isotropic(YOUNGS_MODULUS, 0.0));
        let model = model(&m);
        let fabric = Box::new(Elements::triangles(&model, law, SHEET[0], SHEET[1]));
        let system = System::new(model, vec![fabric], MassMatrix::Lumped);
        let mut d = Dynamics::new(system, params(Scheme::newmark(), 0.0));
        d.integrate_explicitly(1.0).expect("a sheet with mass").stable_step()
    };
    println!(
        "stable step {stable:.2e} s, without bending {plain:.2e} s; energy at 0.95, 1.05 of it: {below:.3}, {above:.1e}"
    );
    assert!(
        stable < 0.5 * plain && (0.5..2.0).contains(&below) && above > 1e3,
        "{below} {above} {stable} {plain}"
    );
}
