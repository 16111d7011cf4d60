//! Bounds of decisions, and history of the motion over windows.

use case::Regrid;

use super::*;
use crate::benchmark_motions::MotionTrial;
use crate::elastic::{Elastic, Solid};
use crate::example_grid::plate_in_box;

fn limits(min_quality: f64) -> Limits {
    Limits { min_quality, max_increments: 4, repair: true }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-14
}

#[test]
fn repairs_aim_above_the_minimal_quality() {
    // Four times the minimum; a quarter; 10 % above it.
    for (least, target) in
        [(0.01, 0.04), (0.0625, 0.25), (0.1, 0.25), (0.22, 0.25), (0.24, 0.264), (0.5, 0.55)]
    {
        assert!(close(limits(least).target(), target), "{least}: {}", limits(least).target());
    }
    // Twice the minimum, or half way to the target.
    for (least, early_threshold) in [(0.01, 0.02), (0.1, 0.175), (0.24, 0.252)] {
        assert!(
            close(limits(least).early_threshold(), early_threshold),
            "{least}: {}",
            limits(least).early_threshold()
        );
    }
}

#[test]
fn references_change_on_the_stated_sides_of_their_bounds() {
    // Below one half, and below 0.7 of the reference.
    assert!(needs_rebase(0.499, 0.9) && !needs_rebase(0.501, 0.9));
    assert!(needs_rebase(0.279, 0.4) && !needs_rebase(0.281, 0.4));
    assert!(is_returning(0.49, 1.0) && !is_returning(0.51, 1.0));
}

#[test]
fn loss_of_quality_per_window_decays() {
    let mut trial = trial();
    let shape = |quality| MeshQuality { quality, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
    let at = trial.at.clone();
    trial.motion.quality = 0.9;
    for (quality, quality_loss) in [(0.8, 0.1), (0.85, 0.07), (0.845, 0.049), (0.745, 0.1), (0.745, 0.07)] {
        trial.motion.accept(&at, &shape(quality));
        assert!(close(trial.motion.quality_loss, quality_loss), "{quality}: {}", trial.motion.quality_loss);
    }
}

fn trial() -> MotionTrial {
    let mover = Box::new(Elastic::new(Solid::from(&case::MeshMotion::default())));
    MotionTrial::new(&plate_in_box(6, 0.0, 0.9, false), mover, limits(1e-3)).unwrap()
}

#[test]
fn distance_is_the_largest_node_distance() {
    let b = [0.0, 0.0, 0.0, 1.0, -2.0, 5.0];
    assert_eq!(distance(&[0.1, 0.0, 0.0, 3.0, 1.0, -1.0], &b), 7.0);
    assert_eq!((distance(&b, &b), distance(&[], &[])), (0.0, 0.0));
}

#[test]
fn worse_of_two_cell_sets_is_the_lower_quality_then_the_lower_index() {
    let shape =
        |quality, cell, volume_ratio| MeshQuality { quality, cell, at: [f64::from(cell); 3], volume_ratio };
    let (a, b) = (shape(0.2, 5, 0.9), shape(0.3, 1, 0.7));
    assert_eq!((a.worse(&b), b.worse(&a)), (shape(0.2, 5, 0.7), shape(0.2, 5, 0.7)));
    let c = shape(0.2, 4, 1.0);
    assert_eq!((a.worse(&c), c.worse(&a)), (shape(0.2, 4, 0.9), shape(0.2, 4, 0.9)));
}

/// Volumes are relative to the start: a box compressed to half its height.
#[test]
fn volume_ratios_are_relative_to_the_start_grid() {
    let trial = trial();
    let mut x = trial.start.grid.clone();
    x.iter_mut().skip(2).step_by(3).for_each(|z| *z *= 0.5);
    let shape = trial.motion.shape(&x);
    assert!((shape.volume_ratio - 0.5).abs() < 1e-12 && shape.quality > 0.99, "{shape:?}");
}

/// Positions are the sum of reference, displacements of free nodes, and remaining offset of a transition.
#[test]
fn positions_are_the_sum_of_reference_displacement_and_offset() {
    let mut trial = trial();
    let n = trial.motion.u.len();
    trial.motion.u.iter_mut().enumerate().for_each(|(i, u)| *u = 1e-3 * (i as f64).sin());
    let offset: Vec<f64> = (0..trial.start.grid.len()).map(|i| 1e-2 * (i as f64).cos()).collect();
    trial.motion.transition = Some(GridTransition { offset: offset.clone(), step: 1, steps: 4 });
    let mut to = trial.at.clone();
    to.canopy.iter_mut().for_each(|x| *x += 0.125);
    trial.motion.set_positions(&mut to);
    let grid = &trial.motion.grid;
    // Half of the transition: half of the offset.
    let mut expected: Vec<f64> = trial.start.grid.iter().zip(&offset).map(|(x, d)| x + 0.5 * d).collect();
    assert_eq!(n, 3 * grid.free_node.len());
    for (k, &a) in grid.free_node.iter().enumerate() {
        (0..3).for_each(|i| expected[3 * a as usize + i] += 1e-3 * ((3 * k + i) as f64).sin());
    }
    for &(a, k) in &grid.canopy {
        (0..3).for_each(|i| expected[3 * a as usize + i] = to.canopy[3 * k as usize + i]);
    }
    let max_difference = to.grid.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(max_difference < 1e-15, "{max_difference}");
}

/// A builder that finds no grid, and the number of its calls.
fn useless_builder() -> (Builder, std::rc::Rc<std::cell::Cell<u32>>) {
    let tried = std::rc::Rc::new(std::cell::Cell::new(0));
    let count = tried.clone();
    let build: Builder = Box::new(move |_| {
        count.set(count.get() + 1);
        Err("none".into())
    });
    (build, tried)
}

#[test]
fn retry_after_a_useless_new_grid_is_at_four_fifths_of_the_quality() {
    let (build, tried) = useless_builder();
    let MotionTrial { at, motion, .. } = trial();
    let mut motion = motion
        .with_regrid(Some(Regridder::new(Regrid { quality_threshold: Some(0.6), step: 1.0 }, build)), None);
    let reports = [0.601, 0.5, 0.401, 0.399, 0.32, 0.319].map(|quality| {
        let report = motion.accept(&at, &MeshQuality { quality, cell: 0, at: [0.0; 3], volume_ratio: 1.0 });
        (report, tried.get())
    });
    let none = || Some(Err("none".into()));
    assert_eq!(reports, [(None, 0), (none(), 1), (None, 1), (none(), 2), (None, 2), (none(), 3)]);
}

/// Without a threshold in the scene: below half of the quality at the start of the grid, here 1.
#[test]
fn automatic_threshold_is_half_of_the_quality_at_the_start() {
    let (build, tried) = useless_builder();
    let MotionTrial { at, motion, .. } = trial();
    let start = motion.start_quality;
    let mut motion = motion.with_regrid(Some(Regridder::new(Regrid::default(), build)), None);
    for (share, expected) in [(0.501, 0), (0.499, 1), (0.401, 1), (0.399, 2)] {
        let shape = MeshQuality { quality: share * start, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
        motion.accept(&at, &shape);
        assert_eq!(tried.get(), expected, "{share}");
    }
    // Within the window where it has fallen to a fourth.
    let urgent = |share: f64| {
        let shape = MeshQuality { quality: share * start, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
        motion.needs_new_grid_now(&shape, WindowProgress::NotStarted)
    };
    assert!(urgent(0.249) && !urgent(0.251));
}

/// A new grid that differs slightly from the old one: the offset decreases by one window's share at a time.
#[test]
fn new_grid_is_the_reference_and_the_old_one_the_start_of_the_transition() {
    let MotionTrial { at, motion, .. } = trial();
    let nodes: Vec<Point> =
        at.grid.as_chunks::<3>().0.iter().map(|x| [x[0], x[1], x[2] + 0.01 * (1.0 - x[2] * x[2])]).collect();
    let built = nodes.clone();
    let build: Builder = Box::new(move |_| Ok(built.clone()));
    let mut motion = motion
        .with_regrid(Some(Regridder::new(Regrid { quality_threshold: Some(0.6), step: 0.1 }, build)), None);
    let bad = MeshQuality { quality: 0.5, cell: 0, at: [0.0; 3], volume_ratio: 1.0 };
    motion.quality = 0.5;
    let report = motion.accept(&at, &bad).expect("one is due").expect("one is built");
    assert!(
        report.from == 0.5 && report.to > 0.9 && motion.new_grids() == 1 && motion.is_start_reference(),
        "{report:?}"
    );
    let transition = motion.transition().expect("a way").clone();
    assert_eq!((transition.step, transition.steps), (0, report.windows));
    // The canopy has no offset; all other nodes have the difference between old and new grid.
    let canopy: Vec<u32> = motion.grid.canopy.iter().map(|c| c.0).collect();
    for a in 0..motion.grid.n_local() {
        for i in 0..3 {
            let (old, new) = (at.grid[3 * a + i], nodes[a][i]);
            let expected = if canopy.contains(&(a as u32)) { 0.0 } else { old - new };
            assert!((transition.offset[3 * a + i] - expected).abs() < 1e-15, "node {a}");
        }
    }
    let far = (0..motion.grid.free_node.len()).map(|k| {
        let a = motion.grid.free_node[k] as usize;
        let h = motion.grid.free_sizes(&at.grid)[k].min(motion.grid.free_sizes(&motion.start().grid)[k]);
        transition.offset[3 * a + 2].abs() / h
    });
    assert_eq!(report.windows, (1.5 * far.fold(0.0, f64::max) / 0.1).ceil() as u32);
    // Windows advance the transition.
    for done in 1..report.windows {
        motion.accept(&at, &bad);
        assert_eq!(motion.transition().map(|g| g.step), Some(done));
    }
    motion.accept(&at, &bad);
    assert_eq!(motion.transition(), None);
}
