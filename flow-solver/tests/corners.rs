//! Corner cases.

mod common;

use common::{isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{Isothermal, Laminar};
use flow_solver::{Solver, Step};
use mesh::{BoxShape, Patch, box_grid_of};

/// A cavity of 1 m whose lid moves at 1 m/s.
fn cavity(shape: BoxShape, n: usize, thin: f64, nu: f64, drop: f64) -> Solver<Isothermal, 4> {
    let grid = box_grid_of(shape, [n; 3], [0.0; 3], [1.0, 1.0, thin], [Patch::Wall; 6]);
    let mut settings = settings([0.0; 3], drop);
    settings.reference_speed = 0.1;
    let mu = nu * settings.air.density;
    let mut s = isothermal(&grid, Laminar { viscosity: mu }, settings);
    for (v, x) in s.node_velocity.iter_mut().zip(&s.nodes) {
        if x[2] > thin * (1.0 - 1e-9) {
            *v = Vec3::new(1.0, 0.0, 0.0);
        }
    }
    s
}

fn mass(s: &Solver<Isothermal, 4>) -> f64 {
    use flow_solver::physics::Gas;
    s.q[..s.topology.n_owned].iter().zip(&s.metrics.volume).map(|(q, v)| v * s.spatial.gas.density(q)).sum()
}

#[test]
fn explore_mass() {
    for drop in [1e-1, 1e-2, 1e-4] {
        let mut s = cavity(BoxShape::Hexahedra, 12, 1.0, 0.01, drop);
        let start = mass(&s);
        let mut dt = 0.05;
        for k in 0..60 {
            s.first_order_steps = 2;
            let step = Step { dt, frame: Vec3::zeros(), repeat: false, moved: k == 0 };
            match s.advance(&step) {
                Ok(r) => {
                    s.accept(dt, k == 0);
                    if k % 6 == 0 {
                        let mean: f64 = s.q.iter().map(|q| q[0]).sum::<f64>() / s.q.len() as f64;
                        println!(
                            "drop {drop} step {k} dt {dt:.2}: {} it, residual {:.2e} of {:.2e}, mass off {:.2e}, mean p {mean:.3e}, range {:.2e}",
                            r.iterations,
                            r.end,
                            r.start,
                            mass(&s) / start - 1.0,
                            s.q.iter().map(|q| q[0]).fold(0.0, f64::max)
                                - s.q.iter().map(|q| q[0]).fold(0.0, f64::min)
                        );
                    }
                    dt *= 1.2;
                }
                Err(e) => {
                    println!("drop {drop} step {k} dt {dt:.2}: {e:?}");
                    dt *= 0.25;
                }
            }
        }
    }
}

#[test]
fn explore_viscous() {
    for (shape, n) in [(BoxShape::Hexahedra, 16), (BoxShape::Tetrahedra, 8)] {
        for number in [0.1, 1.0, 10.0, 50.0, 200.0, 1e3, 1e4] {
            let h = 1.0 / n as f64;
            let dt = 0.25 * h;
            let nu = number * h * h / dt;
            let mut s = cavity(shape, n, 1.0, nu, 1e-3);
            let mut line = String::new();
            for k in 0..5 {
                let step = Step { dt, frame: Vec3::zeros(), repeat: false, moved: k == 0 };
                match s.advance(&step) {
                    Ok(r) => {
                        s.accept(dt, k == 0);
                        line += &format!(
                            " {}/{} {:.0e}{}",
                            r.iterations,
                            r.linear_iterations,
                            r.end / r.start,
                            if r.met { "" } else { "!" }
                        );
                    }
                    Err(e) => {
                        line += &format!(" {e:?}");
                        break;
                    }
                }
            }
            println!("{shape:?} nu dt/h2 = {number}: {line}");
        }
    }
}

#[test]
fn explore_flat() {
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        for thin in [0.2, 0.1, 0.05, 0.02, 0.01] {
            let n = 10;
            let mut s = cavity(shape, n, thin, 1e-3, 1e-3);
            let dt = 0.5 / n as f64;
            let mut line = String::new();
            for k in 0..5 {
                let step = Step { dt, frame: Vec3::zeros(), repeat: false, moved: k == 0 };
                match s.advance(&step) {
                    Ok(r) => {
                        s.accept(dt, k == 0);
                        line += &format!(
                            " {}/{} {:.0e}{}",
                            r.iterations,
                            r.linear_iterations,
                            r.end / r.start,
                            if r.met { "" } else { "!" }
                        );
                    }
                    Err(e) => {
                        line += &format!(" {e:?}");
                        break;
                    }
                }
            }
            println!("{shape:?} flat {thin}: {line}");
        }
    }
}
