//! The same flow on several ranks, which are threads here: slabs, exchanges and sums give the flow of one rank.

use std::rc::Rc;
use std::sync::{Arc, Barrier, Mutex};

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::face_transfer::FaceTransfer;
use immersed::grid::{End, Ends, Grid};
use immersed::poisson::Poisson;
use immersed::shapes;
use immersed::slabs::{Alone, Ranks, Slabs};
use nalgebra::Vector3;

use scenarios::{cases, compare_all, run, windows};

mod scenarios;

/// What the threads of a flow share.
struct Shared {
    barrier: Barrier,
    posts: Mutex<Vec<Vec<f64>>>,
}

/// A thread as a rank.
#[derive(Clone)]
struct Thread {
    rank: usize,
    size: usize,
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Thread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.rank, self.size)
    }
}

impl Thread {
    /// What every thread has posted.
    fn all(&self, own: &[f64]) -> Vec<Vec<f64>> {
        self.shared.posts.lock().expect("no panic")[self.rank] = own.to_vec();
        self.shared.barrier.wait();
        let all = self.shared.posts.lock().expect("no panic").clone();
        self.shared.barrier.wait();
        all
    }
}

impl Ranks for Thread {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn sum(&self, values: &mut [f64]) {
        let all = self.all(values);
        values.iter_mut().enumerate().for_each(|(i, v)| *v = all.iter().map(|of| of[i]).sum());
    }

    fn largest(&self, values: &mut [f64]) {
        let all = self.all(values);
        values
            .iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v = all.iter().map(|of| of[i]).fold(f64::MIN, f64::max));
    }

    fn all_to_all(&self, send: &[f64], sent: &[usize], receive: &mut [f64], received: &[usize]) {
        let (data, counts) = (self.all(send), self.all(&sent.iter().map(|n| *n as f64).collect::<Vec<_>>()));
        let mut got = Vec::new();
        for (from, (data, counts)) in data.iter().zip(&counts).enumerate() {
            let start: f64 = counts[..self.rank].iter().sum();
            assert_eq!(counts[self.rank] as usize, received[from], "{self:?}");
            got.extend_from_slice(&data[start as usize..][..received[from]]);
        }
        receive.copy_from_slice(&got);
    }

    fn shift(&self, up: bool, send: &[f64], receive: &mut [f64]) {
        let all = self.all(send);
        let from = if up { self.rank.checked_sub(1) } else { Some(self.rank + 1).filter(|r| *r < self.size) };
        if let Some(from) = from {
            receive[..all[from].len()].copy_from_slice(&all[from]);
        }
    }

    fn gather(&self, values: &mut [f64], ends: &[usize]) {
        let all = self.all(values);
        for (rank, of) in all.iter().enumerate() {
            let start = if rank == 0 { 0 } else { ends[rank - 1] };
            values[start..ends[rank]].copy_from_slice(&of[start..ends[rank]]);
        }
    }
}

/// The result of `run` on each of `size` ranks.
fn on_threads<T: Send>(size: usize, run: impl Fn(Rc<dyn Ranks>) -> T + Sync) -> Vec<T> {
    let shared = Arc::new(Shared { barrier: Barrier::new(size), posts: Mutex::new(vec![Vec::new(); size]) });
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..size)
            .map(|rank| {
                let (shared, run) = (shared.clone(), &run);
                scope.spawn(move || run(Rc::new(Thread { rank, size, shared })))
            })
            .collect();
        threads.into_iter().map(|t| t.join().expect("a rank")).collect()
    })
}

/// Conjugate gradients end at 1e-12 of the load, so that results agree to some 1e-11.
#[test]
fn any_number_of_ranks_computes_the_same_flow() {
    for (name, (nodes, faces), low, model) in cases() {
        let (nodes, faces) = (&nodes, &faces);
        let one = run(Rc::new(Alone), None, nodes, faces, low, model);
        assert_eq!(*one.figures.last().expect("figures") > 0.01, model.is_some());
        for size in [1, 2, 3, 5, 8] {
            for end in on_threads(size, |ranks| run(ranks, None, nodes, faces, low, model)) {
                println!("{name}, {low:?}, {model:?}, {size} ranks:");
                compare_all(&one, &end);
            }
        }
    }
}

/// What precedes the last solution of a window leaves no trace, on any number of ranks.
#[test]
fn repeated_and_rejected_windows_change_no_digit() {
    let (nodes, faces) = shapes::sphere(0.45, 2);
    for size in [1, 3] {
        let run = |repeated| on_threads(size, |ranks| windows(ranks, None, &nodes, &faces, repeated));
        for (rank, (once, repeated)) in run(false).iter().zip(&run(true)).enumerate() {
            let differ = once.iter().zip(repeated).position(|(a, b)| a.to_bits() != b.to_bits());
            assert!(
                once.len() == repeated.len() && differ.is_none(),
                "rank {rank} of {size}: value {differ:?}"
            );
        }
    }
}

/// Axes that are their own mirror image, whose even and odd modes the ranks share, also where there are more ranks than modes along y.
#[test]
fn any_number_of_ranks_solves_the_pressure_equation() {
    let slip = Ends::Open([End::Slip, End::Slip]);
    let outflow = Ends::Open([End::Inflow, End::Outflow]);
    let axis = |reach: f64| Axis::stretched([-reach, reach], 0.25, [0.9; 2], 1.3, 1);
    for y in [axis(1.1), Axis::even(0.0, 0.5, 2)] {
        let grid = Grid::new([axis(1.0), y, axis(1.5)], [slip, slip, outflow]);
        let n = grid.cells();
        let plane = n[0] * n[1];
        let source: Vec<f64> = (0..grid.count()).map(|i| (1.7 * i as f64).sin()).collect();
        // The whole grid, and the middle of it along z.
        let cells = [0..n[0], 0..n[1], 3..7];
        let solve = |ranks: Rc<dyn Ranks>| {
            let slabs = Slabs::new(ranks.clone(), &grid).expect("slabs");
            let mut poisson = Poisson::new(&grid, &slabs);
            let mut p = source.clone();
            let own = slabs.own();
            poisson.solve(&mut p[own.start * plane..own.end * plane], &slabs);
            slabs.gather_cells(&mut p, plane);
            let mut closure = Vec::new();
            poisson.closure(&cells[2], &mut closure);
            let mut in_box = source[3 * plane..7 * plane].to_vec();
            poisson.solve_in(&mut in_box, &cells, &closure);
            ranks.sum(&mut in_box);
            [p, in_box]
        };
        let one = solve(Rc::new(Alone));
        for size in [2, 3, 5] {
            for (rank, found) in on_threads(size, solve).iter().enumerate() {
                for (found, one) in found.iter().flatten().zip(one.iter().flatten()) {
                    assert!((found - one).abs() < 1e-13, "rank {rank} of {size}, {n:?}: {found} {one}");
                }
            }
        }
    }
}

#[test]
fn ranks_find_the_same_faces_of_each_row() {
    let axis = || Axis::even(-1.0, 1.0, 24);
    let slip = Ends::Open([End::Slip, End::Slip]);
    let grid = Grid::new([axis(), axis(), axis()], [slip, slip, slip]);
    let (nodes, faces) = shapes::sphere(0.6, 3);
    let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
    let own: Vec<u32> = (0..faces.len() as u32).collect();
    let forces = |ranks: Rc<dyn Ranks>| {
        let transfer = FaceTransfer::new(&grid, &nodes, &faces, &own, &cut, &*ranks).expect("inside");
        let jumps: Vec<f64> = (0..cut.rows.len()).map(|row| 1.0 + (row as f64).sin()).collect();
        let mut forces = vec![Vector3::zeros(); faces.len()];
        transfer.add_forces(&jumps, &mut forces);
        forces
    };
    let one = forces(Rc::new(Alone));
    assert!(one.iter().all(|force| force.norm() > 0.0));
    for size in [2, 3, 7] {
        assert!(on_threads(size, forces).iter().all(|found| *found == one), "{size} ranks");
    }
}

#[test]
fn more_ranks_than_slabs_are_refused() {
    let axis = || Axis::even(0.0, 1.0, 7);
    let slip = Ends::Open([End::Slip, End::Slip]);
    let grid = Grid::new([axis(), axis(), axis()], [slip, slip, slip]);
    let words = on_threads(4, |ranks| Slabs::new(ranks, &grid).expect_err("too many").to_string());
    assert!(
        words.iter().all(|w| w.contains("7 cells along z") && w.contains("ranks.flow to 3")),
        "{words:?}"
    );
}
