//! Replacement of a bad grid by a new one.

use std::cell::Cell;
use std::rc::Rc;

use case::{MeshMotion, Regrid, Role};
use channel::{Input, Participant, Window, mesh_stats};
use comm::Comm;
use mesh::{FlowGrid, Point};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::{plate_in_box, plate_structure};
use mesh_mover::motion::{Limits, Regridder};
use mesh_mover::participant::{MeshMover, Setup, regridder};
use mesh_mover::quality::volume;
use mesh_mover::state::State;

const CELLS: usize = 12;

fn plate() -> FlowGrid {
    plate_in_box(CELLS, 0.0, 0.8, false)
}

/// A good grid around the plate at height `h`: layers above and below it are compressed evenly.
fn around(h: f64) -> Vec<Point> {
    let lift = |p: &Point| [p[0], p[1], if p[2] > 0.0 { h + p[2] * (1.0 - h) } else { h + p[2] * (1.0 + h) }];
    plate().coords.iter().map(lift).collect()
}

struct MoverFixture {
    grid: FlowGrid,
    mover: MeshMover,
    output: Vec<f64>,
    built: Rc<Cell<u32>>,
}

impl MoverFixture {
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
            // Plain elasticity degrades the cells early.
            mover: Box::new(Elastic::new(Solid {
                chi: 0.0,
                shape_exponent: 0.0,
                distance_exponent: 0.0,
                ..Solid::from(&settings)
            })),
            limits: Limits { repair: false, min_quality, ..Limits::from(&settings) },
            state,
            outer: settings.outer_boundary,
            regridder: (below > 0.0)
                .then(|| Regridder::new(Regrid { quality_threshold: Some(below), step }, build)),
            bodies: Default::default(),
        };
        let mover = MeshMover::on_grid(setup, &Comm::solo()).unwrap();
        let output = vec![f64::NAN; 6 * grid.coords.len()];
        Self { grid, mover, output, built }
    }

    /// The plate at height `h`; returns the smallest scaled Jacobian, 0 where the grid motion failed.
    fn window(&mut self, index: u64, h: f64) -> f64 {
        let w = Window { index, dt: 0.1, substeps: 1, ..Window::default() };
        let displacement: Vec<f64> = self.grid.canopy_nodes.iter().flat_map(|_| [0.0, 0.0, h]).collect();
        let input = Input { canopy: &displacement, grid: Default::default() };
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

fn max_difference(a: &[Point], b: &[Point]) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn bad_grid_is_replaced_by_a_gradual_transition() {
    let mut fixture = MoverFixture::new(0.6, None);
    let mut without = MoverFixture::new(0.0, None);
    let height = |index: u64| 0.3 * (index as f64 / 30.0).min(1.0);
    let (mut worst, mut worst_without, mut seen, mut jolt) = (1.0f64, 1.0f64, 0, 0.0f64);
    let mut history: Vec<Vec<Point>> = Vec::new();
    for index in 0..80 {
        worst = worst.min(fixture.window(index, height(index)));
        if worst_without > 0.0 {
            worst_without = worst_without.min(without.window(index, height(index)));
        }
        assert!((fixture.volume() - 8.0).abs() < 1e-12, "the box keeps its volume");
        if fixture.mover.motion().transition().is_some() {
            seen += 1;
        }
        history.push(fixture.nodes());
        if let [.., a, b, c] = &history[..] {
            // Second differences: no jump of velocity at the start and end of the transition.
            let kink = a
                .iter()
                .zip(b)
                .zip(c)
                .map(|((a, b), c)| (0..3).map(|i| (a[i] - 2.0 * b[i] + c[i]).abs()).fold(0.0, f64::max));
            jolt = jolt.max(kink.fold(0.0, f64::max));
        }
    }
    assert!(fixture.built.get() >= 1 && seen > 3, "{} {seen}", fixture.built.get());
    assert_eq!(without.built.get(), 0);
    assert!(fixture.mover.motion().transition().is_none(), "arrived");
    // The canopy still moved after the grid was built: close to it by the accuracy of the mover.
    let end = fixture.mover.motion().shape(&fixture.mover.positions().grid).quality;
    println!("worst {worst:.3} ({worst_without:.3} without), end {end:.3}, jolt {jolt:.1e}");
    assert!(worst > 0.15 && worst > 2.0 * worst_without && end > 0.3, "{worst} {worst_without} {end}");
    // The canopy itself stops at once, from 0.01 a window.
    assert!(jolt < 0.02, "{jolt}");
}

#[test]
fn transition_ends_on_the_new_grid_and_continues_from_a_saved_state() {
    let mut fixture = MoverFixture::new(0.95, None);
    let from = fixture.nodes_at_rest();
    let mut index = 0;
    while fixture.mover.motion().transition().is_none() {
        fixture.window(index, 0.03 * (index + 1) as f64);
        index += 1;
        assert!(index < 20, "a new grid is due");
    }
    let h = 0.03 * index as f64;
    fixture.window(index, h);
    fixture.window(index + 1, h);
    let folder = tempfile::tempdir().unwrap();
    fixture.mover.save(folder.path()).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), fixture.grid.coords.len()).unwrap();
    assert!(!state.offset.is_empty() && state.transition[0] >= 2);
    let mut again = MoverFixture::new(0.95, Some(state));
    assert_eq!(max_difference(&again.nodes_at_rest(), &fixture.nodes()), 0.0);
    index += 2;
    while fixture.mover.motion().transition().is_some() {
        fixture.window(index, h);
        again.window(index, h);
        assert!(max_difference(&fixture.nodes(), &again.nodes()) < 1e-12, "the same way");
        index += 1;
    }
    assert!(again.mover.motion().transition().is_none());
    fixture.window(index, h);
    assert!(max_difference(&fixture.nodes(), &around(h)) < 1e-12, "on the new grid");
    assert!(max_difference(&fixture.nodes(), &from) > 0.01);
}

impl MoverFixture {
    fn nodes_at_rest(&self) -> Vec<Point> {
        self.mover.positions().grid.as_chunks::<3>().0.to_vec()
    }
}

#[test]
fn fast_canopy_completes_the_transition_within_a_window() {
    // A transition so slow that only the canopy ends it.
    let mut fixture = MoverFixture::with(0.9, 0.01, 0.3, None);
    let mut h = 0.0;
    for index in 0..20 {
        h += 0.01;
        fixture.window(index, h);
        if let Some(transition) = fixture.mover.motion().transition() {
            println!("way of {} windows from h = {h}", transition.steps);
            break;
        }
    }
    let remaining = fixture.mover.motion().transition().map(|g| g.steps - g.step);
    assert!(remaining.is_some_and(|remaining| remaining > 5), "{remaining:?}");
    // The quality decreases as the canopy moves on; the blend of old and new would become too bad.
    let mut index = 20;
    while fixture.mover.motion().transition().is_some() {
        h += 0.04;
        let quality = fixture.window(index, h);
        assert!(quality >= 0.3, "h = {h}: {quality}");
        assert!((fixture.volume() - 8.0).abs() < 1e-12, "the box keeps its volume");
        index += 1;
        assert!(index < 40, "the way is ended");
    }
    println!("ended at h = {h}, window {index}");
    assert!(index < 20 + remaining.unwrap() as u64 && fixture.mover.motion().is_start_reference());
    assert_eq!(fixture.mover.motion().new_grids(), 1);
}

#[test]
fn grid_that_degrades_within_a_window_is_replaced_in_it() {
    let mut fixture = MoverFixture::with(0.9, 1.0, 0.3, None);
    // Half way to the wall: plain elasticity leaves cells below the bound.
    let quality = fixture.window(0, 0.5);
    assert!(quality > 0.99 && fixture.mover.motion().new_grids() == 1, "{quality}");
    assert!(max_difference(&fixture.nodes(), &around(0.5)) < 1e-12, "the new grid");
    assert!(fixture.mover.motion().transition().is_none() && fixture.mover.motion().is_start_reference());
    // Velocities are those of the motion from the old grid to the new one.
    let (from, to) = (around(0.0), around(0.5));
    for (row, (a, b)) in fixture.output.as_chunks::<6>().0.iter().zip(from.iter().zip(&to)) {
        (0..3).for_each(|i| assert!((row[3 + i] - (b[i] - a[i]) / 0.1).abs() < 1e-9));
    }
    fixture.window(1, 0.5);
    assert!(max_difference(&fixture.nodes(), &around(0.5)) < 1e-12, "it stays");
    // A state saved now continues around the new grid.
    let folder = tempfile::tempdir().unwrap();
    fixture.mover.save(folder.path()).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), fixture.grid.coords.len()).unwrap();
    let mut again = MoverFixture::with(0.9, 1.0, 0.3, Some(state));
    assert_eq!(fixture.window(2, 0.52), again.window(2, 0.52));
    assert!(max_difference(&fixture.nodes(), &again.nodes()) < 1e-12);
}

/// New grids are the default; scenes with a grid file or moving bodies, around which none can be built, have to ask for them.
#[test]
fn new_grids_are_the_default_where_they_can_be_built() {
    let grid = plate();
    let structure = plate_structure(&grid);
    let builds = |case: &str, more: &str| {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases").join(case).join("scene.toml");
        let text = std::fs::read_to_string(&file).unwrap() + more;
        let scene = case::parse(&file, &text).unwrap_or_else(|e| panic!("{case}: {e}"));
        regridder(&scene, &structure, &grid).is_some()
    };
    let threshold = |t: f64| format!("\n[mesh.regrid]\nquality_threshold = {t:?}\n");
    assert!(builds("square-drop", "") && builds("square-drop", &threshold(0.2)));
    assert!(!builds("square-drop", &threshold(0.0)));
    assert!(!builds("validation/ring-in-fluid", "") && builds("validation/ring-in-fluid", &threshold(0.2)));
}
