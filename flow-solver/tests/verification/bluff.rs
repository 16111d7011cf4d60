//! Bluff bodies with published forces whose wakes take minutes: sphere at Re 300, square plate
//! and disk normal to the stream at high Reynolds numbers with detached eddies.
//!
//! `cargo test --release -p flow-solver --test verification bluff:: -- --ignored --nocapture`
//!
//! The bounds are **records**: the distance from the middle of the published range that was measured on the grid that each
//! test names, plus half of that range, rounded up. Sphere, drag: 0.044, 0.015 and 0.007 on the three grids (of second
//! order), half range 0.008; lift 0.028, 0.015, 0.009 and 0.002; Strouhal number 0.007, 0.002 and 0.0015. They show
//! a change of the solver on these grids and say nothing of finer ones. A wake that wrongly stays symmetric would change
//! the drag of plate and disk by a third, ten times their bounds.

#![allow(clippy::needless_range_loop)]

use crate::common::{at_rest, isothermal, settings};
use crate::shapes::{Shape, sheet};
use crate::wake::{Case, Model};
use flow_solver::Loads;
use flow_solver::physics::{EddyViscosity, Laminar, Turbulent, Viscosity, WallTreatment};
use flow_solver::turbulence::{SpalartAllmaras, ddes};
use mesh::FlowGrid;

const RHO: f64 = 1.225;

fn sphere_300(n: usize, nr: usize, end: f64, upwind: f64) -> [f64; 3] {
    crate::sphere::wake(300.0, [n, nr], end, upwind)
}

/// Published: drag coefficient 0.655 to 0.671, lift coefficient 0.065 to 0.069, Strouhal number
/// 0.134 to 0.137. Half a sphere with 30 720 cells, 0.044 diameters thick at the wall, has 0.707
/// and 0.095 and sheds too slowly to count: bounds 0.06 and 0.04 record that (0.044 and 0.028 off).
#[test]
#[ignore = "nightly: 2 minutes"]
fn sphere_at_reynolds_300() {
    let [cd, cl, _] = sphere_300(16, 40, 120.0, 1.0);
    assert!((cd - 0.663).abs() < 0.06, "{cd}");
    assert!((cl - 0.067).abs() < 0.04, "{cl}");
}

/// 103 680 cells.
#[test]
#[ignore = "nightly: 10 minutes"]
fn sphere_at_reynolds_300_refined() {
    let [cd, cl, st] = sphere_300(24, 60, 120.0, 1.0);
    assert!((cd - 0.663).abs() < 0.03, "{cd}");
    assert!((cl - 0.067).abs() < 0.02, "{cl}");
    assert!((st - 0.1355).abs() < 0.01, "{st}");
}

/// 245 760 cells.
#[test]
#[ignore = "nightly: 30 minutes"]
fn sphere_at_reynolds_300_refined_again() {
    let [cd, cl, st] = sphere_300(32, 80, 140.0, 1.0);
    assert!((cd - 0.663).abs() < 0.02, "{cd}");
    assert!((cl - 0.067).abs() < 0.015, "{cl}");
    assert!((st - 0.1355).abs() < 0.006, "{st}");
}

/// The hybrid flux on the coarsest grid: 0.030 and 0.013 off. Its lift is irregular, see docs/records/verification.md.
#[test]
#[ignore = "nightly: 2 minutes"]
fn sphere_at_reynolds_300_hybrid() {
    let [cd, cl, _] = sphere_300(16, 40, 120.0, 0.0);
    assert!((cd - 0.663).abs() < 0.045, "{cd}");
    assert!((cl - 0.067).abs() < 0.02, "{cl}");
}

const SPEED: f64 = 4.88;

/// Mean drag coefficient of the sheet over the times `from` to `end` (in U/D), by steps of `dt` s;
/// `eddies`: delayed detached eddies, in a wake that is pushed to one side at the start: by round-off alone
/// it takes 30 to 45 U/D to leave the symmetric state, whose drag is a third too low. `upwind`: smallest upwind share.
fn drag<V: Viscosity>(
    grid: &FlowGrid,
    viscosity: V,
    eddies: Option<f64>,
    [dt, from, end]: [f64; 3],
    upwind: f64,
) -> f64 {
    let mut set = settings([0.0, 0.0, SPEED], 1e-2);
    set.moving = false;
    let mut s = isothermal(grid, viscosity, set);
    s.spatial.upwind_share = upwind;
    if let Some(viscosity) = eddies {
        s.set_turbulence(SpalartAllmaras::new(&s.topology, viscosity, RHO, ddes));
        for previous in &mut s.previous {
            for (q, x) in previous.q.iter_mut().zip(&s.metrics.centre) {
                let r2 = x[0] * x[0] + x[1] * x[1] + (x[2] - 1.0) * (x[2] - 1.0);
                q[1] += 0.3 * SPEED * (-r2).exp();
                q[2] += 0.2 * SPEED * (-r2).exp();
            }
        }
    }
    let mut loads = Loads::new(&s);
    let area: f64 = s.topology.canopy_face.iter().map(|&f| s.metrics.faces[f as usize].magnitude()).sum();
    let (mut t, mut k, mut late) = (0.0, 0, Vec::new());
    while t < end {
        s.advance(&at_rest(dt)).unwrap();
        let drag = loads.compute(&s).force[2] / (0.5 * RHO * SPEED * SPEED * area);
        s.accept(dt, false);
        t += dt * SPEED;
        k += 1;
        if t > from {
            late.push(drag);
        }
        if k % 50 == 0 {
            println!("t U/D {t:.1}: cd {drag:.4}");
        }
    }
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let parts: Vec<f64> = late.chunks(late.len().div_ceil(4)).map(mean).collect();
    println!(
        "area {area:.4} m2, {} cells: mean cd {:.4}, in quarters {parts:.3?}",
        grid.cells.len(),
        mean(&late)
    );
    mean(&late)
}

/// At a Reynolds number of 1e5, over 50 to 150 U/D.
fn high(disk: bool, across: usize, upwind: f64) -> f64 {
    let viscosity = RHO * SPEED / 1e5;
    drag(
        &sheet(disk, across),
        Turbulent { viscosity, eddies: EddyViscosity::TransportInput, wall: WallTreatment::Automatic },
        Some(viscosity),
        [0.16 / across as f64, 50.0, 150.0],
        upwind,
    )
}

/// Published: 1.17 both, in an unbounded stream.
#[test]
#[ignore = "nightly: 2 minutes"]
fn square_plate_normal_to_the_stream() {
    let cd = high(false, 8, 1.0);
    assert!((cd - 1.17).abs() < 0.03, "{cd}");
}

#[test]
#[ignore = "nightly: 2 minutes"]
fn disk_normal_to_the_stream() {
    let cd = high(true, 8, 1.0);
    assert!((cd - 1.17).abs() < 0.03, "{cd}");
}

#[test]
#[ignore = "nightly: 8 minutes"]
fn square_plate_normal_to_the_stream_refined() {
    let cd = high(false, 12, 1.0);
    assert!((cd - 1.17).abs() < 0.02, "{cd}");
}

#[test]
#[ignore = "nightly: 8 minutes"]
fn disk_normal_to_the_stream_refined() {
    let cd = high(true, 12, 1.0);
    assert!((cd - 1.17).abs() < 0.02, "{cd}");
}

/// The same with the hybrid flux, as scenes with `ddes` have it: 1.178 and 1.248 are records, the latter 7 % above what is published.
#[test]
#[ignore = "nightly: 12 minutes"]
fn square_plate_normal_to_the_stream_hybrid() {
    for (across, recorded) in [(8, 1.178), (12, 1.248)] {
        let cd = high(false, across, 0.0);
        println!("{across} across, hybrid: {cd:.4}");
        assert!((cd - recorded).abs() < 0.03, "{across} across: {cd}, recorded {recorded}");
    }
}

/// Hemispherical cup, inviscid, 46 548 cells, over 50 to 100 U/D: the recorded mean within twice its 95 % interval,
/// as two runs that differ by round-off may. Published: 1.42 with the opening upstream.
#[test]
#[ignore = "nightly: 3 minutes"]
fn cup_open_to_the_stream() {
    let model = Model::Inviscid;
    let upwind = model.upwind_share();
    let case = Case {
        shape: Shape::CupOpen,
        model,
        across: 8,
        end: 100.0,
        seed: 1,
        upwind,
        courant: 0.8,
        half: 5.0,
    };
    let found = crate::wake::statistics(&case.run(|_| ()).rows);
    println!("{case:?}: {found:?}");
    assert!((found.drag - 1.469).abs() < 2.0 * 0.013, "{found:?}");
}

/// The wake is steady at a Reynolds number of 100. Published: a drag coefficient of about 1.28.
#[test]
#[ignore = "nightly: 5 minutes"]
fn disk_at_reynolds_100() {
    let viscosity = RHO * SPEED / 1e2;
    for across in [8, 12, 16] {
        let steps = [0.16 / across as f64, 18.0, 20.0];
        let cd = drag(&sheet(true, across), Laminar { viscosity }, None, steps, 1.0);
        println!("{across} across: {cd:.4}");
        assert!((cd - 1.28).abs() < 0.01, "{cd}");
    }
}
