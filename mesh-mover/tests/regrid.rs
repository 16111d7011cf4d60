//! A new grid in the place of one that has become bad.

use std::cell::Cell;
use std::rc::Rc;

use case::{MeshMotion, Regrid, Role};
use channel::{Input, Participant, Window, mesh_stats};
use comm::Comm;
use mesh::{FlowGrid, Point};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::motion::{Limits, Regridder};
use mesh_mover::participant::{MeshMover, Setup};
use mesh_mover::quality::volume;
use mesh_mover::sample::{plate_in_box, plate_structure};
use mesh_mover::state::State;

const CELLS: usize = 12;

fn plate() -> FlowGrid {
    plate_in_box(CELLS, 0.0, 0.8, false)
}

/// A good grid around the plate at height `h`: layers above and below it are pressed together evenly.
fn around(h: f64) -> Vec<Point> {
    let lift = |p: &Point| [p[0], p[1], if p[2] > 0.0 { h + p[2] * (1.0 - h) } else { h + p[2] * (1.0 + h) }];
    plate().coords.iter().map(lift).collect()
}

struct Rig {
    grid: FlowGrid,
    mover: MeshMover,
    output: Vec<f64>,
    built: Rc<Cell<u32>>,
}

impl Rig {
    fn new(below: f64, state: Option<State>) -> Self {
        Self::with(below, 1.0, MeshMotion::default().min_quality, state)
    }

    fn with(below: f64, step: f64, min_quality: f64, state: Option<State>) -> Self {
        let grid = plate();
        let structure = plate_structure(&grid);
        let settings = MeshMotion::default();
        let built = Rc::new(Cell::new(0));
        let count = built.clone();
        let build = Box::new(move |canopy: &[Point]| {
            count.set(count.get() + 1);
            Ok(around(canopy[0][2]))
        });
        let setup = Setup {
            grid: &grid,
            structure: &structure,
            owner: &vec![0; grid.coords.len()],
            // Plain elasticity goes bad soon.
            mover: Box::new(Elastic::new(Solid {
                chi: 0.0,
                shape_exponent: 0.0,
                depth_exponent: 0.0,
                ..Solid::from(&settings)
            })),
            limits: Limits { repair: false, min_quality, ..Limits::from(&settings) },
            state,
            outer: settings.outer_boundary,
            regridder: (below > 0.0)
                .then(|| Regridder::new(Regrid { quality_threshold: below, step }, build)),
        };
        let mover = MeshMover::on_grid(setup, &Comm::solo()).unwrap();
        let output = vec![f64::NAN; 6 * grid.coords.len()];
        Self { grid, mover, output, built }
    }

    /// The plate at height `h`; returns the smallest scaled Jacobian, 0 where the grid cannot follow.
    fn window(&mut self, index: u64, h: f64) -> f64 {
        let w = Window { index, dt: 0.1, substeps: 1, ..Window::default() };
        let push: Vec<f64> = self.grid.canopy_nodes.iter().flat_map(|_| [0.0, 0.0, h]).collect();
        let input = Input { canopy: &push, grid: Default::default() };
        let stats = self.mover.advance(&w, &input, &mut self.output).unwrap();
        if stats.values[mesh_stats::STUCK] != 0.0 {
            return 0.0;
        }
        for &a in &self.grid.canopy_nodes {
            let x = self.output[6 * a as usize..][..3].to_vec();
            let start = self.grid.coords[a as usize];
            assert_eq!(x, [start[0], start[1], start[2] + h], "canopy exact");
        }
        self.mover.accept(&w).unwrap();
        stats.values[mesh_stats::MIN_QUALITY]
    }

    fn nodes(&self) -> Vec<Point> {
        self.output.as_chunks::<6>().0.iter().map(|r| [r[0], r[1], r[2]]).collect()
    }

    fn volume(&self) -> f64 {
        let (local, x) = (&self.mover.motion().grid, &self.mover.positions().grid);
        (0..local.cells.len()).map(|c| volume(&local.corners(c, x))).sum()
    }
}

fn apart(a: &[Point], b: &[Point]) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_bad_grid_glides_into_a_new_one() {
    let mut rig = Rig::new(0.6, None);
    let mut without = Rig::new(0.0, None);
    let height = |index: u64| 0.3 * (index as f64 / 30.0).min(1.0);
    let (mut worst, mut worst_without, mut seen, mut jolt) = (1.0f64, 1.0f64, 0, 0.0f64);
    let mut history: Vec<Vec<Point>> = Vec::new();
    for index in 0..80 {
        worst = worst.min(rig.window(index, height(index)));
        if worst_without > 0.0 {
            worst_without = worst_without.min(without.window(index, height(index)));
        }
        assert!((rig.volume() - 8.0).abs() < 1e-12, "the box keeps its volume");
        if rig.mover.motion().glide().is_some() {
            seen += 1;
        }
        history.push(rig.nodes());
        if let [.., a, b, c] = &history[..] {
            // Second differences: no jump of velocity when the way begins and ends.
            let kink = a
                .iter()
                .zip(b)
                .zip(c)
                .map(|((a, b), c)| (0..3).map(|i| (a[i] - 2.0 * b[i] + c[i]).abs()).fold(0.0, f64::max));
            jolt = jolt.max(kink.fold(0.0, f64::max));
        }
    }
    assert!(rig.built.get() >= 1 && seen > 3, "{} {seen}", rig.built.get());
    assert_eq!(without.built.get(), 0);
    assert!(rig.mover.motion().glide().is_none(), "arrived");
    // Where it was made the canopy was not yet at its end: near it by the mover's own accuracy.
    let end = rig.mover.motion().shape(&rig.mover.positions().grid).quality;
    println!("worst {worst:.3} ({worst_without:.3} without), end {end:.3}, jolt {jolt:.1e}");
    assert!(worst > 0.15 && worst > 2.0 * worst_without && end > 0.3, "{worst} {worst_without} {end}");
    // The canopy itself stops at once, from 0.01 a window.
    assert!(jolt < 0.02, "{jolt}");
}

#[test]
fn the_way_ends_on_the_new_grid_and_a_saved_state_goes_on_with_it() {
    let mut rig = Rig::new(0.95, None);
    let from = rig.nodes_at_rest();
    let mut index = 0;
    while rig.mover.motion().glide().is_none() {
        rig.window(index, 0.03 * (index + 1) as f64);
        index += 1;
        assert!(index < 20, "a new grid is due");
    }
    let h = 0.03 * index as f64;
    rig.window(index, h);
    rig.window(index + 1, h);
    let folder = tempfile::tempdir().unwrap();
    rig.mover.save(folder.path()).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), rig.grid.coords.len()).unwrap();
    assert!(!state.offset.is_empty() && state.way[0] >= 2);
    let mut again = Rig::new(0.95, Some(state));
    assert_eq!(apart(&again.nodes_at_rest(), &rig.nodes()), 0.0);
    index += 2;
    while rig.mover.motion().glide().is_some() {
        rig.window(index, h);
        again.window(index, h);
        assert!(apart(&rig.nodes(), &again.nodes()) < 1e-12, "the same way");
        index += 1;
    }
    assert!(again.mover.motion().glide().is_none());
    rig.window(index, h);
    assert!(apart(&rig.nodes(), &around(h)) < 1e-12, "on the new grid");
    assert!(apart(&rig.nodes(), &from) > 0.01);
}

impl Rig {
    fn nodes_at_rest(&self) -> Vec<Point> {
        self.mover.positions().grid.as_chunks::<3>().0.to_vec()
    }
}

#[test]
fn a_canopy_that_outruns_the_way_ends_it_within_a_window() {
    // A way so slow that nothing but the canopy ends it.
    let mut rig = Rig::with(0.9, 0.01, 0.3, None);
    let mut h = 0.0;
    for index in 0..20 {
        h += 0.01;
        rig.window(index, h);
        if let Some(glide) = rig.mover.motion().glide() {
            println!("way of {} windows from h = {h}", glide.steps);
            break;
        }
    }
    let left = rig.mover.motion().glide().map(|g| g.steps - g.step);
    assert!(left.is_some_and(|left| left > 5), "{left:?}");
    // Quality sinks as the canopy goes on; the mixture of old and new would become too bad.
    let mut index = 20;
    while rig.mover.motion().glide().is_some() {
        h += 0.04;
        let quality = rig.window(index, h);
        assert!(quality >= 0.3, "h = {h}: {quality}");
        assert!((rig.volume() - 8.0).abs() < 1e-12, "the box keeps its volume");
        index += 1;
        assert!(index < 40, "the way is ended");
    }
    println!("ended at h = {h}, window {index}");
    assert!(index < 20 + left.unwrap() as u64 && rig.mover.motion().is_total());
    assert_eq!(rig.mover.motion().new_grids(), 1);
}

#[test]
fn a_grid_that_goes_bad_within_a_window_is_replaced_in_it() {
    let mut rig = Rig::with(0.9, 1.0, 0.3, None);
    // Half of the way to the wall: plain elasticity leaves cells below the bound.
    let quality = rig.window(0, 0.5);
    assert!(quality > 0.99 && rig.mover.motion().new_grids() == 1, "{quality}");
    assert!(apart(&rig.nodes(), &around(0.5)) < 1e-12, "the new grid");
    assert!(rig.mover.motion().glide().is_none() && rig.mover.motion().is_total());
    // Velocities are those of the motion from the old grid to the new one.
    let (from, to) = (around(0.0), around(0.5));
    for (row, (a, b)) in rig.output.as_chunks::<6>().0.iter().zip(from.iter().zip(&to)) {
        (0..3).for_each(|i| assert!((row[3 + i] - (b[i] - a[i]) / 0.1).abs() < 1e-9));
    }
    rig.window(1, 0.5);
    assert!(apart(&rig.nodes(), &around(0.5)) < 1e-12, "it stays");
    // A state that is saved now goes on around the new grid.
    let folder = tempfile::tempdir().unwrap();
    rig.mover.save(folder.path()).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), rig.grid.coords.len()).unwrap();
    let mut again = Rig::with(0.9, 1.0, 0.3, Some(state));
    assert_eq!(rig.window(2, 0.52), again.window(2, 0.52));
    assert!(apart(&rig.nodes(), &again.nodes()) < 1e-12);
}
