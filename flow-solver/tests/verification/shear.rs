//! Wind by height in an empty box.

use crate::common::{isothermal, settings};
use flow_solver::Step;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::Inviscid;
use flow_solver::shear::{Profile, WindShear};
use mesh::{Patch, box_grid};

/// Largest error of the velocity (m/s) after 1.2 s in a box of 20 m that falls at 5 m/s from
/// a height of 40 m, with `n` cells a side.
fn error(profile: &Profile, n: usize, fall: f64) -> f64 {
    let grid = box_grid([n, 4, n], [-10.0; 3], [10.0; 3], [Patch::FarField; 6]);
    let sheared = WindShear::new(profile.clone(), 40.0);
    let mut s = isothermal(&grid, Inviscid, settings(sheared.base(), 1e-9));
    s.set_shear(sheared);
    let (dt, steps) = (0.05, 24);
    for _ in 0..steps {
        s.advance(&Step { dt, frame: Vec3::new(0.0, 0.0, -fall), repeat: false, moved: false }).unwrap();
        s.accept(dt, false);
    }
    let height = 40.0 - fall * dt * f64::from(steps);
    assert!((s.extras().height.unwrap() - height).abs() < 1e-12);
    let off = |(q, x): (&[f64; 4], &[f64; 3])| {
        let u = profile.at(height + x[2]);
        (0..3).map(|d| (q[1 + d] - u[d]).abs()).fold(0.0, f64::max)
    };
    s.q.iter().zip(&s.metrics.centre).map(off).fold(0.0, f64::max)
}

/// A linear profile is kept to the tolerance of the solver, also where the frame sinks through it.
#[test]
fn linear_wind_profile_is_preserved() {
    let profile = Profile::Linear { wind: [6.0, 2.0, 0.0], reference: 10.0, slope: 0.02 };
    for fall in [0.0, 5.0] {
        let e = error(&profile, 8, fall);
        println!("linear shear, falling at {fall} m/s: off by {e:.2e} m/s");
        assert!(e < 1e-6, "{e}");
    }
}

/// Curved profiles to second order in the size of the cells.
#[test]
fn wind_profiles_are_preserved_to_second_order() {
    let wind = [6.0, 0.0, 0.0];
    let power = Profile::Power { wind, reference: 10.0, exponent: 1.0 / 7.0 };
    let log = Profile::Log { wind, reference: 10.0, roughness: 0.03 };
    for profile in [power, log] {
        let (coarse, fine) = (error(&profile, 8, 5.0), error(&profile, 16, 5.0));
        println!("{profile:?}: off by {coarse:.2e}, refined {fine:.2e} m/s");
        assert!(fine < 2e-3 && fine < 0.4 * coarse, "{coarse} {fine}");
    }
    // A table is linear between its heights: here none lies in the box.
    let table = Profile::Table { heights: vec![0.0, 100.0], winds: vec![[0.0, 1.0, 0.0], [10.0, 1.0, 0.0]] };
    let e = error(&table, 8, 5.0);
    assert!(e < 1e-6, "{e}");
}
