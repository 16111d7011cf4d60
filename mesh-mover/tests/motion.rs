//! Large motions: range of the grid motion, and its errors beyond that range.

use case::{MeshMotion, MoverKind};
use mesh::FlowGrid;
use mesh_mover::benchmark_motions::{MOTIONS, MotionTrial, plate};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::plate_in_box;
use mesh_mover::motion::{Limits, MotionError, MotionResult};
use mesh_mover::mover::Mover;
use mesh_mover::movers::mover;

const LIMITS: Limits = Limits { min_quality: 1e-3, max_increments: 8, repair: true };

fn elastic() -> Box<dyn Mover> {
    Box::new(Elastic::new(Solid::from(&case::MeshMotion::default())))
}

/// As [`elastic`], almost without an error of its solution.
fn exact() -> Box<dyn Mover> {
    Box::new(Elastic::new(Solid { tolerance: 1e-7, ..Solid::from(&MeshMotion::default()) }))
}

/// A trial that checks every window.
struct Run(MotionTrial);

impl Run {
    fn new(grid: &FlowGrid, mover: Box<dyn Mover>, limits: Limits) -> Self {
        Self(MotionTrial::new(grid, mover, limits).unwrap())
    }

    fn window(&mut self, shape: impl Fn([f64; 3]) -> [f64; 3]) -> Result<MotionResult, MotionError> {
        let moved = self.0.window(shape)?;
        let (grid, at) = (&self.0.motion.grid, &self.0.at);
        for &(a, k) in &grid.canopy {
            assert_eq!(at.grid[3 * a as usize..][..3], at.canopy[3 * k as usize..][..3], "canopy exact");
        }
        Ok(moved)
    }
}

type Path = fn([f64; 3], f64) -> [f64; 3];

fn rotate(p: [f64; 3], s: f64) -> [f64; 3] {
    let (sin, cos) = (s * std::f64::consts::FRAC_PI_3).sin_cos();
    [cos * p[0] - sin * p[2], p[1], sin * p[0] + cos * p[2]]
}

/// The plate is 1 wide in a box of 2; layers at the plate are 0.06 thick.
const MOTIONS_OF_PLATE: [(&str, Path, f64); 5] = [
    ("translated normally by half its width", |p, s| [p[0], p[1], p[2] + 0.5 * s], 0.3),
    ("translated in its plane by a quarter", |p, s| [p[0] + 0.25 * s, p[1], p[2]], 0.5),
    ("rotated by 60 degrees", rotate, 0.15),
    ("compressed to half", |p, s| [p[0] * (1.0 - 0.5 * s), p[1] * (1.0 - 0.5 * s), p[2]], 0.25),
    ("a flap bent to 90 degrees", flap, 0.14),
];

/// The half at x > 0 rolls up on a circle until its end is vertical.
fn flap(p: [f64; 3], s: f64) -> [f64; 3] {
    let k = s * std::f64::consts::PI;
    if p[0] <= 0.0 || k == 0.0 { p } else { [(k * p[0]).sin() / k, p[1], (1.0 - (k * p[0]).cos()) / k] }
}

#[test]
fn large_motions_stay_free_of_inversions() {
    let grid = plate_in_box(12, 0.1, 0.8, false);
    for (name, path, least) in MOTIONS_OF_PLATE {
        let mut run = Run::new(&grid, elastic(), LIMITS);
        let (mut worst, mut iterations, mut increments) = (1.0f64, 0, 0);
        for step in 1..=20 {
            let moved = run.window(|p| path(p, step as f64 / 20.0));
            let moved = moved.unwrap_or_else(|e| panic!("{name}, step {step}: {e}"));
            worst = worst.min(moved.shape.quality);
            iterations += moved.effort.iterations;
            increments = increments.max(moved.increments);
        }
        println!(
            "{name}: worst {worst:.3}, {iterations} iterations, {increments} increments at most, {} new references",
            run.0.motion.rebased()
        );
        assert!(worst > least, "{name}: {worst}");
    }
}

#[test]
fn oscillation_on_the_start_reference_does_not_drift() {
    let grid = plate_in_box(8, 0.1, 0.8, true);
    let mut run = Run::new(&grid, elastic(), LIMITS);
    let swing = |s: f64| move |p: [f64; 3]| [p[0] + 0.05 * s, p[1], p[2] + 0.1 * s * (1.0 - p[0] * p[0])];
    let phase = |step: usize| (step as f64 * std::f64::consts::TAU / 20.0).sin();
    for step in 1..20 {
        run.window(swing(phase(step))).unwrap();
    }
    let quarter = {
        run.window(swing(1.0)).unwrap();
        run.0.at.clone()
    };
    let mut iterations = 0;
    for step in 0..1000 {
        iterations += run.window(swing(phase(step))).unwrap().effort.iterations;
    }
    assert_eq!(run.0.motion.rebased(), 0);
    println!("{iterations} iterations in 1000 windows");
    assert!(iterations < 1000, "past solutions give the initial guess: {iterations}");
    run.window(|p| p).unwrap();
    assert_eq!(run.0.at.grid, run.0.start.grid, "bitwise the start grid");
    run.window(swing(1.0)).unwrap();
    let max_difference =
        run.0.at.grid.iter().zip(&quarter.grid).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    // Two solutions within the tolerance, 3e-3 of the smallest edge, 0.1.
    assert!(max_difference < 6e-4, "{max_difference}");
}

#[test]
fn large_motions_and_back_end_bitwise_on_the_start_grid() {
    let grid = plate_in_box(12, 0.1, 0.8, false);
    let mut run = Run::new(&grid, elastic(), LIMITS);
    for step in (0..=20).chain((0..20).rev()) {
        run.window(|p| rotate(p, step as f64 / 20.0)).unwrap();
    }
    // New references on the way out, the start grid from half way back.
    assert!(run.0.motion.rebased() > 2 && run.0.motion.is_start_reference(), "{}", run.0.motion.rebased());
    assert_eq!(run.0.at.grid, run.0.start.grid);
}

#[test]
fn jump_over_several_layers_is_divided_into_increments() {
    let grid = plate_in_box(12, 0.1, 0.8, false);
    let mut run = Run::new(&grid, elastic(), LIMITS);
    let moved = run.window(|p| rotate(p, 0.8)).unwrap();
    println!("{moved:?}");
    assert!(moved.increments > 1 && moved.shape.quality > 1e-3);
}

#[test]
fn failed_motion_names_the_cell_and_keeps_the_state() {
    let grid = plate_in_box(8, 0.0, 0.9, false);
    let mut run = Run::new(&grid, elastic(), Limits { min_quality: 1e-3, max_increments: 2, repair: true });
    let before = run.0.at.clone();
    // Through the wall of the box.
    let error = run.window(|p| [p[0], p[1], p[2] + 1.5]).unwrap_err();
    println!("{error}");
    let MotionError::Tangled { shape, increments, .. } = &error else { panic!("{error}") };
    assert!(shape.quality < 1e-3 && *increments == 2);
    assert!(error.to_string().contains(&format!("cell {}", shape.cell)));
    assert_eq!(run.0.at, before);
    // The same object continues from the accepted state.
    run.window(|p| [p[0], p[1], p[2] + 0.05]).unwrap();
}

/// Solves of one window whose canopies are on both sides of the limit of quality.
#[test]
fn repair_persists_for_all_solves_of_a_window() {
    let grid = plate_in_box(12, 0.1, 0.8, false);
    let plain = || -> Box<dyn Mover> {
        let solid = Solid::from(&MeshMotion::default());
        Box::new(Elastic::new(Solid { chi: 0.0, shape_exponent: 0.0, distance_exponent: 0.0, ..solid }))
    };
    let quality = |s: f64| {
        let mut run = Run::new(&grid, plain(), Limits { min_quality: 0.0, max_increments: 1, repair: false });
        run.window(|p| rotate(p, s)).map_or(-1.0, |m| m.shape.quality)
    };
    let beyond = (0..40).map(|k| 0.2 + 0.01 * f64::from(k)).find(|s| quality(*s) < 0.1).unwrap();
    let near = beyond - 0.01;
    let (q, worse) = (quality(near), quality(beyond));
    println!("quality {q:.4} at {near}, {worse:.4} at {beyond}");
    assert!(q > 1.05 * worse && worse > 0.0, "{q} {worse}");
    let limits = Limits { min_quality: 0.5 * (q + worse), max_increments: 8, repair: true };
    let mut trial = MotionTrial::new(&grid, plain(), limits).unwrap();
    let mut calls = Vec::new();
    for s in [near, beyond, near, 0.5 * (near + beyond), beyond, 1.02 * beyond, near] {
        let mut to = trial.at.clone();
        for (c, p) in to.canopy.as_chunks_mut::<3>().0.iter_mut().zip(trial.start.canopy.as_chunks::<3>().0) {
            *c = rotate(*p, s);
        }
        let moved = trial.motion.follow(&trial.at, &mut to).unwrap();
        assert!(moved.shape.quality >= limits.min_quality && moved.increments == 1, "{moved:?}");
        calls.push(to);
    }
    let max_difference =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    for (k, pair) in calls.windows(2).enumerate() {
        let (grid, canopy) =
            (max_difference(&pair[0].grid, &pair[1].grid), max_difference(&pair[0].canopy, &pair[1].canopy));
        println!("solves {k} and {}: grid {grid:.2e}, canopy {canopy:.2e}", k + 1);
        // No node moves by more than the canopy, except where neighbours displace it.
        assert!(grid <= 1.5 * canopy, "solves {k} and {}: {grid} {canopy}", k + 1);
    }
    assert_eq!(trial.motion.rebased(), 1, "one repair");
}

/// A later solve of a window whose canopy differs by less than a quarter of an edge needs no linear solve: a motion of the first solution is that solution once more; of any
/// other one a node `r` layers off the plate follows by `1 - r / 5`. A larger difference is solved for.
#[test]
fn small_motions_within_a_window_follow_known_solutions_or_the_layers() {
    let n = 12;
    let grid = plate_in_box(n, 0.0, 0.9, false);
    // Thickness of the layer at the plate, the shortest edge of all.
    let thinnest = 0.9f64.powi(6) / (1..=6).map(|l| 0.9f64.powi(l)).sum::<f64>();
    let middle = |layers: usize| (n / 2) + (n + 1) * ((n / 2) + (n + 1) * (n / 2 + layers));
    for axis in 0..3 {
        for (share_of_limit, solved) in [(0.99, false), (1.01, true)] {
            let mut trial = MotionTrial::new(&grid, exact(), LIMITS).unwrap();
            let mut first = trial.at.clone();
            first.canopy.iter_mut().skip(2).step_by(3).for_each(|z| *z += 0.01);
            trial.motion.follow(&trial.at, &mut first).unwrap();
            let displacement = share_of_limit * 0.25 * thinnest;
            let mut second = first.clone();
            second.canopy.iter_mut().skip(axis).step_by(3).for_each(|x| *x += displacement);
            let moved = trial.motion.follow(&trial.at, &mut second).unwrap();
            assert_eq!(moved.effort.iterations > 0, solved, "axis {axis}: {moved:?}");
            for layers in (0..6).filter(|_| !solved) {
                let at = 3 * middle(layers) + axis;
                let known = (first.grid[at] - trial.start.grid[at]) / 0.01;
                let by_layer = (1.0 - layers as f64 / 5.0).max(0.0);
                let expected = displacement * if axis == 2 { known } else { by_layer };
                let found = second.grid[at] - first.grid[at];
                // Shares and solutions are stored in single precision.
                let bound = if axis == 2 { 1e-6 } else { 1e-7 };
                assert!(
                    (found - expected).abs() < bound * displacement,
                    "axis {axis}, layer {layers}: {found} {expected}"
                );
            }
        }
    }
}

/// The grid of a window is that of its canopy, whatever canopies were tried before within the window. With near nodes that follow alone it was off by 0.76 of the
/// difference of the canopies, and a cavity with a flexible bottom by 0.4 % of its motion.
#[test]
fn grid_of_a_window_depends_on_its_canopy_alone() {
    let grid = plate(16);
    let bent = |p: [f64; 3], lift: f64, bend: f64| [p[0], p[1], p[2] + lift + bend * p[0] * p[0]];
    let last = |tried: &[[f64; 2]]| {
        let mut trial = MotionTrial::new(&grid, exact(), LIMITS).unwrap();
        for [lift, bend] in [[0.01, 0.0], [0.02, 0.02], [0.04, 0.03]] {
            trial.window(|p| bent(p, lift, bend)).unwrap();
        }
        let mut to = trial.at.clone();
        for (k, &[lift, bend]) in tried.iter().enumerate() {
            for (c, s) in
                to.canopy.as_chunks_mut::<3>().0.iter_mut().zip(trial.start.canopy.as_chunks::<3>().0)
            {
                *c = bent(*s, lift, bend);
            }
            let moved = trial.motion.follow(&trial.at, &mut to).unwrap();
            assert!(k == 0 || moved.effort.iterations == 0, "{moved:?}");
        }
        to
    };
    let [first, second] = [[0.055, 0.025], [0.05, 0.03]];
    let [direct, detour] = [last(&[second]), last(&[first, second])];
    assert_eq!(direct.canopy, detour.canopy);
    let off = direct.grid.iter().zip(&detour.grid).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("off by {:.1e} of the difference of the canopies", off / 5e-3);
    assert!(off < 5e-6 * 5e-3, "{off}");
}

#[test]
fn elastic_mover_has_the_best_cells_of_all_movers() {
    let grid = plate(16);
    let mut elastic = 0.0;
    for kind in [
        MoverKind::Elastic,
        MoverKind::PlainElastic,
        MoverKind::Laplacian,
        MoverKind::RadialBasis,
        MoverKind::InverseDistance,
    ] {
        let settings = MeshMotion { mover: kind, ..MeshMotion::default() };
        // The movers without increments and repair.
        let limits = Limits { max_increments: 1, repair: false, ..LIMITS };
        let mut survived = 0;
        let mut worst = 1.0f64;
        // Rotation by 60 degrees, and the flap.
        for (_, path) in [MOTIONS[2], MOTIONS[4]] {
            let mut run = Run::new(&grid, mover(&settings), limits);
            for step in 1..=10 {
                let Ok(moved) = run.window(|p| path(p, step as f64 / 10.0)) else { break };
                worst = worst.min(moved.shape.quality);
                survived += 1;
            }
        }
        println!("{kind:?}: {survived} of 20 windows, worst {worst:.3}");
        assert!(survived >= 4, "{kind:?}: {survived}");
        match kind {
            MoverKind::Elastic => {
                assert!(survived == 20 && worst > 0.1, "{survived} {worst}");
                elastic = worst;
            }
            _ => assert!(survived < 20 || worst < elastic, "{kind:?}: {survived} {worst}"),
        }
    }
}
