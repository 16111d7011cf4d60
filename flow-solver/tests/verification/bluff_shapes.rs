//! Grids around shapes of zero thickness: cells, wall, and a uniform stream through them. Their forces: `bluff.rs`.

use std::f64::consts::PI;

use crate::common::{Noise, at_rest, isothermal, settings};
use crate::shapes::Shape;
use flow_solver::Step;
use flow_solver::physics::{Inviscid, Laminar};
use mesh::{FlowGrid, Patch, quality};

const SHAPES: [Shape; 4] = [Shape::Disk, Shape::Plate, Shape::CupOpen, Shape::CupAway];

/// Area of the wall and its projection on planes normal to the stream, m2.
fn wall(grid: &FlowGrid) -> [f64; 2] {
    let mut found = [0.0; 2];
    for face in &grid.canopy_faces {
        let [a, b, c, d] = face.map(|v| grid.coords[v as usize]);
        let (p, q): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|k| c[k] - a[k]), std::array::from_fn(|k| d[k] - b[k]));
        let area: [f64; 3] = std::array::from_fn(|k| {
            0.5 * (p[(k + 1) % 3] * q[(k + 2) % 3] - p[(k + 2) % 3] * q[(k + 1) % 3])
        });
        found[0] += area.iter().map(|x| x * x).sum::<f64>().sqrt();
        found[1] += area[2].abs();
    }
    found
}

/// The cells fill the box of 1500 m3; none is badly distorted; the wall has the area of the shape, to second order.
#[test]
fn cells_fill_the_box_and_the_wall_has_its_area() {
    for shape in SHAPES {
        let (whole, frontal) = match shape {
            Shape::Plate => (1.0, 1.0),
            Shape::Disk => (0.25 * PI, 0.25 * PI),
            Shape::CupOpen | Shape::CupAway => (0.5 * PI, 0.25 * PI),
        };
        let mut coarse = None;
        for across in [8, 16] {
            let grid = shape.grid(across);
            let quality = quality::summary(&grid);
            let [area, front] = wall(&grid);
            println!("{shape:?} {across}: wall {area:.4} m2, frontal {front:.4} m2, {quality:?}");
            assert!((quality.total_volume / 1500.0 - 1.0).abs() < 1e-12, "{shape:?}: {quality:?}");
            assert!(quality.min_volume > 0.0);
            let errors = [1.0 - area / whole, 1.0 - front / frontal];
            assert!(errors.iter().all(|e| (-1e-12..0.02).contains(e)), "{shape:?} {across}: {errors:?}");
            if let Some(coarse) = coarse.replace(errors) {
                for (c, f) in coarse.iter().zip(errors) {
                    assert!(f < 0.3 * c + 1e-12, "{shape:?}: {coarse:?} to {errors:?}");
                }
            }
        }
    }
}

/// Cells around cups keep a scaled Jacobian of 0.3.
#[test]
fn cells_around_a_cup_are_valid() {
    for across in [8, 12, 16] {
        let open = quality::summary(&Shape::CupOpen.grid(across));
        assert!(open.min_scaled_jacobian > 0.3, "{across}: {open:?}");
        assert!(open.max_aspect < 20.0, "{across}: {open:?}");
        let away = quality::summary(&Shape::CupAway.grid(across));
        assert_eq!(open, away, "the wall is no part of the cells");
    }
}

/// Without its wall each grid carries a uniform stream while its nodes move, and each cell is closed.
#[test]
fn uniform_stream_stays_uniform() {
    for shape in SHAPES {
        let mut grid = shape.grid(8);
        grid.canopy_faces.clear();
        grid.canopy_nodes.clear();
        grid.boundary.iter_mut().for_each(|b| b.0 = Patch::FarField);
        let wind = [3.0, -2.0, 4.0];
        for upwind in [0.0, 1.0] {
            let mut s = isothermal(&grid, Laminar { viscosity: 1e-3 }, settings(wind, 1e-11));
            s.spatial.upwind_share = upwind;
            let mut open = vec![[0.0; 3]; s.topology.n_owned];
            s.topology.for_each_side(|f, c, sign| {
                for (sum, area) in open[c].iter_mut().zip(&s.metrics.faces[f].area) {
                    *sum += sign * area;
                }
            });
            let open = open.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
            assert!(open < 1e-14, "{shape:?}: a cell is open by {open:e} m2");
            // Nodes move at random by up to 2 mm, so that steps have something to solve.
            let (mut noise, start, mut worst) = (Noise(11), s.nodes.clone(), 0.0f64);
            for _ in 0..3 {
                for (x, x0) in s.nodes.iter_mut().flatten().zip(start.iter().flatten()) {
                    *x = x0 + 2e-3 * noise.next();
                }
                s.advance(&Step { moved: true, ..at_rest(0.02) }).unwrap();
                s.accept(0.02, true);
                // Pressure in units of the dynamic pressure, velocity in units of the stream.
                let of_cell = |q: &[f64; 4]| {
                    (0..3).map(|d| (q[1 + d] - wind[d]).abs() / 5.4).fold(q[0].abs() / 18.0, f64::max)
                };
                worst = s.q.iter().map(of_cell).fold(worst, f64::max);
            }
            println!("{shape:?}, upwind share {upwind}: off the stream by {worst:.1e}");
            assert!(worst < 1e-12, "{shape:?}, upwind share {upwind}: {worst:e}");
        }
    }
}

/// The wall blocks the stream: the pressure in front of a cup is higher than behind it, in whichever way it is turned.
#[test]
fn cups_have_drag() {
    for shape in [Shape::CupOpen, Shape::CupAway] {
        let mut set = settings([0.0, 0.0, 5.0], 1e-2);
        set.moving = false;
        let mut s = isothermal(&shape.grid(8), Inviscid, set);
        let mut loads = flow_solver::Loads::new(&s);
        let mut drag = 0.0;
        for _ in 0..10 {
            s.advance(&at_rest(0.02)).unwrap();
            drag = loads.compute(&s).force[2] / (0.5 * 1.225 * 25.0 * shape.area());
            s.accept(0.02, false);
        }
        println!("{shape:?}: drag coefficient after 1 U/D {drag:.3}");
        assert!((0.2..4.0).contains(&drag), "{shape:?}: {drag}");
    }
}

/// Drag with a slow oscillation, side force on a turning circle: mean, amplitude and frequency are found; the interval of
/// uncorrelated noise is that of its standard error.
#[test]
fn statistics_of_a_known_signal() {
    let mut noise = Noise(3);
    let rows: Vec<[f64; 4]> = (1..=4000)
        .map(|k| {
            let t = 0.05 * f64::from(k);
            let (sin, cos) = (2.0 * PI * 0.137 * t).sin_cos();
            [t, 1.2 + 0.3 * noise.next(), 0.1 + 0.2 * sin, 0.2 * cos]
        })
        .collect();
    let s = crate::wake::statistics(&rows);
    println!("{s:?}");
    assert_eq!(s.batches, 10);
    assert!((s.drag - 1.2).abs() < 2.0 * s.interval, "{s:?}");
    // Noise of variance 0.03 in 2000 values: standard error 0.0039, times 2.26.
    assert!((0.5..2.0).contains(&(s.interval / 0.0088)), "{s:?}");
    assert!((s.side - 0.2).abs() < 2e-3, "{s:?}");
    assert!((s.strouhal - 0.137).abs() < 2e-3, "{s:?}");
}
