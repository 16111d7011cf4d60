//! Bounds of decisions, and what a window leaves for later ones.

use case::Regrid;

use super::*;
use crate::elastic::{Elastic, Solid};
use crate::sample::plate_in_box;
use crate::torture::Trial;

fn limits(min_quality: f64) -> Limits {
    Limits { min_quality, max_increments: 4, repair: true }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-14
}

#[test]
fn repairs_aim_well_above_the_least_quality_where_cells_can_be_that_good() {
    // Four times the least one; a quarter; a tenth above it.
    for (least, aim) in [(0.01, 0.04), (0.0625, 0.25), (0.1, 0.25), (0.22, 0.25), (0.24, 0.264), (0.5, 0.55)]
    {
        assert!(close(limits(least).aim(), aim), "{least}: {}", limits(least).aim());
    }
    // Twice the least one, or half way to the aim.
    for (least, soon) in [(0.01, 0.02), (0.1, 0.175), (0.24, 0.252)] {
        assert!(close(limits(least).soon(), soon), "{least}: {}", limits(least).soon());
    }
}

#[test]
fn references_change_on_the_stated_sides_of_their_bounds() {
    // Below one half, and below 0.7 of the reference.
    assert!(has_fallen(0.499, 0.9) && !has_fallen(0.501, 0.9));
    assert!(has_fallen(0.279, 0.4) && !has_fallen(0.281, 0.4));
    assert!(is_back(0.49, 1.0) && !is_back(0.51, 1.0));
}

#[test]
fn the_loss_of_quality_in_a_window_fades() {
    let mut trial = trial();
    let shape = |quality| Shape { quality, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
    let at = trial.at.clone();
    trial.motion.quality = 0.9;
    for (quality, fall) in [(0.8, 0.1), (0.85, 0.07), (0.845, 0.049), (0.745, 0.1), (0.745, 0.07)] {
        trial.motion.settle(&at, &shape(quality));
        assert!(close(trial.motion.fall, fall), "{quality}: {}", trial.motion.fall);
    }
}

fn trial() -> Trial {
    let mover = Box::new(Elastic::new(Solid::from(&case::MeshMotion::default())));
    Trial::new(&plate_in_box(6, 0.0, 0.9, false), mover, limits(1e-3)).unwrap()
}

#[test]
fn distances_are_those_of_nodes() {
    let b = [0.0, 0.0, 0.0, 1.0, -2.0, 5.0];
    assert_eq!(distance(&[0.1, 0.0, 0.0, 3.0, 1.0, -1.0], &b), 7.0);
    assert_eq!((distance(&b, &b), distance(&[], &[])), (0.0, 0.0));
}

#[test]
fn the_worse_of_two_sets_of_cells_has_the_lower_quality_and_then_the_lower_cell() {
    let shape = |quality, cell, volume_ratio| Shape { quality, cell, at: [f64::from(cell); 3], volume_ratio };
    let (a, b) = (shape(0.2, 5, 0.9), shape(0.3, 1, 0.7));
    assert_eq!((a.worse(&b), b.worse(&a)), (shape(0.2, 5, 0.7), shape(0.2, 5, 0.7)));
    let c = shape(0.2, 4, 1.0);
    assert_eq!((a.worse(&c), c.worse(&a)), (shape(0.2, 4, 0.9), shape(0.2, 4, 0.9)));
}

/// Volumes count against those at the start: a box of which one half of the height is lost.
#[test]
fn ratios_of_volumes_are_those_of_the_start_grid() {
    let trial = trial();
    let mut x = trial.start.grid.clone();
    x.iter_mut().skip(2).step_by(3).for_each(|z| *z *= 0.5);
    let shape = trial.motion.shape(&x);
    assert!((shape.volume_ratio - 0.5).abs() < 1e-12 && shape.quality > 0.99, "{shape:?}");
}

/// The place of the grid: reference, displacements of free nodes, and what is left of the way to a new grid.
#[test]
fn positions_are_the_sum_of_reference_displacement_and_way() {
    let mut trial = trial();
    let n = trial.motion.u.len();
    trial.motion.u.iter_mut().enumerate().for_each(|(i, u)| *u = 1e-3 * (i as f64).sin());
    let offset: Vec<f64> = (0..trial.start.grid.len()).map(|i| 1e-2 * (i as f64).cos()).collect();
    trial.motion.glide = Some(Glide { offset: offset.clone(), step: 1, steps: 4 });
    let mut to = trial.at.clone();
    to.canopy.iter_mut().for_each(|x| *x += 0.125);
    trial.motion.place(&mut to);
    let grid = &trial.motion.grid;
    // Half of the way: half of the offset.
    let mut wanted: Vec<f64> = trial.start.grid.iter().zip(&offset).map(|(x, d)| x + 0.5 * d).collect();
    assert_eq!(n, 3 * grid.free_node.len());
    for (k, &a) in grid.free_node.iter().enumerate() {
        (0..3).for_each(|i| wanted[3 * a as usize + i] += 1e-3 * ((3 * k + i) as f64).sin());
    }
    for &(a, k) in &grid.canopy {
        (0..3).for_each(|i| wanted[3 * a as usize + i] = to.canopy[3 * k as usize + i]);
    }
    let apart = to.grid.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-15, "{apart}");
}

#[test]
fn after_a_new_grid_that_did_not_help_the_next_is_tried_at_four_fifths_of_the_quality() {
    let tried = std::rc::Rc::new(std::cell::Cell::new(0));
    let count = tried.clone();
    let build: Builder = Box::new(move |_| {
        count.set(count.get() + 1);
        Err("none".into())
    });
    let Trial { at, motion, .. } = trial();
    let mut motion =
        motion.with_regrid(Some(Regridder::new(Regrid { quality_threshold: 0.6, step: 1.0 }, build)), None);
    let settled = [0.601, 0.5, 0.401, 0.399, 0.32, 0.319].map(|quality| {
        let said = motion.settle(&at, &Shape { quality, cell: 0, at: [0.0; 3], volume_ratio: 1.0 });
        (said, tried.get())
    });
    let none = || Some(Err("none".into()));
    assert_eq!(settled, [(None, 0), (none(), 1), (None, 1), (none(), 2), (None, 2), (none(), 3)]);
}

/// A new grid that is moved by little in the box: the old one is left behind by one window's share after another.
#[test]
fn a_new_grid_is_the_reference_and_the_old_one_the_start_of_the_way() {
    let Trial { at, motion, .. } = trial();
    let nodes: Vec<Point> =
        at.grid.as_chunks::<3>().0.iter().map(|x| [x[0], x[1], x[2] + 0.01 * (1.0 - x[2] * x[2])]).collect();
    let built = nodes.clone();
    let build: Builder = Box::new(move |_| Ok(built.clone()));
    let mut motion =
        motion.with_regrid(Some(Regridder::new(Regrid { quality_threshold: 0.6, step: 0.1 }, build)), None);
    let bad = Shape { quality: 0.5, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
    motion.quality = 0.5;
    let said = motion.settle(&at, &bad).expect("one is due").expect("one is made");
    assert!(said.from == 0.5 && said.to > 0.9 && motion.new_grids() == 1 && motion.is_total(), "{said:?}");
    let glide = motion.glide().expect("a way").clone();
    assert_eq!((glide.step, glide.steps), (0, said.windows));
    // The canopy stays; all other nodes of the old grid are the offset away from those of the new one.
    let canopy: Vec<u32> = motion.grid.canopy.iter().map(|c| c.0).collect();
    for a in 0..motion.grid.n_local() {
        for i in 0..3 {
            let (old, new) = (at.grid[3 * a + i], nodes[a][i]);
            let wanted = if canopy.contains(&(a as u32)) { 0.0 } else { old - new };
            assert!((glide.offset[3 * a + i] - wanted).abs() < 1e-15, "node {a}");
        }
    }
    let far = (0..motion.grid.free_node.len()).map(|k| {
        let a = motion.grid.free_node[k] as usize;
        let h = motion.grid.free_sizes(&at.grid)[k].min(motion.grid.free_sizes(&motion.start().grid)[k]);
        glide.offset[3 * a + 2].abs() / h
    });
    assert_eq!(said.windows, (1.5 * far.fold(0.0, f64::max) / 0.1).ceil() as u32);
    // Windows go by, and the way with them.
    for done in 1..said.windows {
        motion.settle(&at, &bad);
        assert_eq!(motion.glide().map(|g| g.step), Some(done));
    }
    motion.settle(&at, &bad);
    assert_eq!(motion.glide(), None);
}
