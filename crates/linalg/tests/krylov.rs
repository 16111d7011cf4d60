//! Krylov solvers on small systems with known answers.

use std::rc::Rc;

use comm::{Comm, Halo};
use linalg::{BlockCsr, BlockJacobi, Cg, Gmres, Identity, KrylovError, KrylovParams, Operator};

/// Convection-diffusion with two coupled unknowns on a line: nonsymmetric for `wind != 0`.
fn line(n: usize, wind: f64) -> BlockCsr<2> {
    let lists: Vec<Vec<u32>> = (0..n)
        .map(|i| [i.wrapping_sub(1), i + 1].into_iter().filter(|&j| j < n).map(|j| j as u32).collect())
        .collect();
    let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
    for i in 0..n {
        for s in a.row(i) {
            let j = a.cols()[s] as usize;
            a.values[s] = if i == j {
                [[2.1, 0.3], [0.3, 3.2]]
            } else if j < i {
                [[-1.0 - wind, 0.0], [0.1 * wind, -1.0]]
            } else {
                [[-1.0 + wind, 0.0], [0.0, -1.0]]
            };
        }
    }
    a
}

fn problem(a: &BlockCsr<2>) -> (Vec<f64>, Vec<f64>) {
    let mut x: Vec<f64> = (0..a.n_local()).map(|i| (0.3 * i as f64).sin()).collect();
    let mut b = vec![0.0; a.n_owned()];
    a.apply(&mut x, &mut b);
    (x, b)
}

fn error(x: &[f64], exact: &[f64]) -> f64 {
    x.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

const TIGHT: KrylovParams =
    KrylovParams { rel_tol: 1e-12, abs_tol: 0.0, max_iterations: 400, restart: 25, patience: usize::MAX };

#[test]
fn gmres_solves_a_nonsymmetric_system_with_restarts() {
    let a = line(60, 0.7);
    let (exact, b) = problem(&a);
    let pre = BlockJacobi::<2>::new(&a).unwrap();
    let mut gmres = Gmres::new(&Comm::solo());
    for restart in [5, 25, 200] {
        let mut x = vec![0.0; a.n_local()];
        let info = gmres.solve(&a, &pre, &b, &mut x, KrylovParams { restart, ..TIGHT }).unwrap();
        assert!(error(&x, &exact) < 1e-10, "restart {restart}: {info:?}");
        assert!(info.final_residual <= 1e-12 * info.rhs_norm);
        // Minimal residual: the history never rises within rounding.
        assert!(gmres.history().windows(2).all(|w| w[1] <= w[0] * (1.0 + 1e-9)));
    }
}

/// Without restart GMRES needs at most as many iterations as there are unknowns.
#[test]
fn gmres_ends_with_the_krylov_space() {
    let a = line(6, 0.4);
    let (exact, b) = problem(&a);
    let mut x = vec![0.0; a.n_local()];
    let mut gmres = Gmres::new(&Comm::solo());
    let info = gmres.solve(&a, &Identity, &b, &mut x, KrylovParams { restart: 50, ..TIGHT }).unwrap();
    assert!(info.iterations <= 12, "{info:?}");
    assert!(error(&x, &exact) < 1e-10);
}

#[test]
fn cg_solves_a_symmetric_system_and_reuses_a_guess() {
    let a = line(60, 0.0);
    let (exact, b) = problem(&a);
    let pre = BlockJacobi::<2>::new(&a).unwrap();
    let mut x = vec![0.0; a.n_local()];
    let mut cg = Cg::new(&Comm::solo());
    cg.solve(&a, &pre, &b, &mut x, TIGHT).unwrap();
    assert!(error(&x, &exact) < 1e-10);
    let again = cg.solve(&a, &pre, &b, &mut x, KrylovParams { rel_tol: 1e-10, ..TIGHT }).unwrap();
    assert_eq!(again.iterations, 0, "a converged guess is kept");
}

#[test]
fn the_same_solve_gives_the_same_bits() {
    let a = line(60, 0.2);
    let (_, b) = problem(&a);
    let mut gmres = Gmres::new(&Comm::solo());
    let mut run = || {
        let mut x = vec![0.0; a.n_local()];
        gmres.solve(&a, &Identity, &b, &mut x, TIGHT).unwrap();
        x
    };
    assert_eq!(run(), run());
}

#[test]
fn failures_are_typed_and_carry_the_history() {
    let a = line(60, 0.0);
    let (_, b) = problem(&a);
    let mut x = vec![0.0; a.n_local()];
    let few = KrylovParams { max_iterations: 3, ..TIGHT };
    match Cg::new(&Comm::solo()).solve(&a, &Identity, &b, &mut x, few) {
        Err(KrylovError::NotConverged { iterations: 3, history, .. }) => assert_eq!(history.len(), 4),
        _ => panic!("three iterations must not be enough"),
    }
    let mut bad = b.clone();
    bad[7] = f64::NAN;
    let result = Gmres::new(&Comm::solo()).solve(&a, &Identity, &bad, &mut x, TIGHT);
    assert!(matches!(result, Err(KrylovError::NotFinite { iteration: 0, .. })));

    let mut poisoned = line(60, 0.0);
    poisoned.values[10][0][1] = f64::NAN;
    let mut x = vec![0.0; a.n_local()];
    let result = Gmres::new(&Comm::solo()).solve(&poisoned, &Identity, &b, &mut x, TIGHT);
    assert!(matches!(result, Err(KrylovError::NotFinite { iteration: 1, .. })));

    let mut indefinite = line(60, 0.0);
    indefinite.values.iter_mut().for_each(|v| v[0][0] = -v[0][0]);
    let mut x = vec![0.0; a.n_local()];
    let result = Cg::new(&Comm::solo()).solve(&indefinite, &Identity, &b, &mut x, TIGHT);
    assert!(matches!(result, Err(KrylovError::NotPositiveDefinite { .. })));

    // A tolerance below rounding is reported, not iterated on without end.
    let mut x = vec![0.0; a.n_local()];
    let impossible = KrylovParams { rel_tol: 1e-30, max_iterations: 100_000, ..TIGHT };
    let result = Gmres::new(&Comm::solo()).solve(&a, &Identity, &b, &mut x, impossible);
    assert!(matches!(result, Err(KrylovError::Stalled { .. })));
}

/// Conjugate gradients end with the Krylov space, and their errors fall in the norm of the matrix.
#[test]
fn cg_ends_with_the_krylov_space() {
    let a = line(6, 0.0);
    let (exact, b) = problem(&a);
    let mut cg = Cg::new(&Comm::solo());
    let energy = |x: &[f64]| {
        let mut e: Vec<f64> = x.iter().zip(&exact).map(|(x, y)| x - y).collect();
        let mut image = vec![0.0; e.len()];
        a.apply(&mut e, &mut image);
        e.iter().zip(&image).map(|(e, i)| e * i).sum::<f64>().sqrt()
    };
    let mut before = f64::INFINITY;
    for most in 0..=12 {
        let mut x = vec![0.0; a.n_local()];
        // Given up after so many iterations: what they have reached is kept.
        let end = cg.solve(&a, &Identity, &b, &mut x, KrylovParams { max_iterations: most, ..TIGHT });
        let now = energy(&x);
        assert!(now < before || end.is_ok(), "{now} after {before}");
        assert_eq!(cg.history().len(), end.map_or(most, |info| info.iterations) + 1);
        before = now;
    }
    assert!(before < 1e-10, "{before}");
}

/// A tolerance just below a residual of the history asks for one more iteration, one just above does not; relative ones
/// count from the right-hand side, whatever the guess, and the larger of two counts.
#[test]
fn iterations_end_where_the_tolerance_says() {
    let a = line(20, 0.0);
    let (exact, b) = problem(&a);
    let size = b.iter().map(|b| b * b).sum::<f64>().sqrt();
    let guess: Vec<f64> = exact.iter().map(|x| 0.3 * x + 0.1).collect();
    for start in [vec![0.0; a.n_local()], guess] {
        let solve = |method: usize, params: KrylovParams| {
            let mut x = start.clone();
            let (comm, params) = (Comm::solo(), KrylovParams { restart: 100, ..params });
            if method == 0 {
                let mut cg = Cg::new(&comm);
                let info = cg.solve(&a, &Identity, &b, &mut x, params).unwrap();
                (info, cg.history().to_vec())
            } else {
                let mut gmres = Gmres::new(&comm);
                let info = gmres.solve(&a, &Identity, &b, &mut x, params).unwrap();
                (info, gmres.history().to_vec())
            }
        };
        for method in [0, 1] {
            let (_, history) = solve(method, TIGHT);
            for k in [3, 7, 12] {
                // The first residual of the history that is so small.
                let first = |target: f64| history.iter().position(|r| *r <= target).unwrap();
                for factor in [0.96, 1.04] {
                    let target = factor * history[k];
                    let relative = KrylovParams { rel_tol: target / size, abs_tol: 0.5 * target, ..TIGHT };
                    let absolute = KrylovParams { rel_tol: 0.5 * target / size, abs_tol: target, ..TIGHT };
                    for params in [relative, absolute] {
                        let (info, _) = solve(method, params);
                        assert_eq!(info.iterations, first(target), "method {method}: {k} {factor}");
                        assert!(info.final_residual <= target);
                        assert!((info.rhs_norm - size).abs() < 1e-12 * size);
                        assert!((info.initial_residual - history[0]).abs() < 1e-12 * size);
                    }
                }
            }
        }
    }
}

/// One, times its argument, less a constant where that is large.
struct Bent(f64);

impl Operator for Bent {
    fn n_owned(&self) -> usize {
        1
    }
    fn n_local(&self) -> usize {
        1
    }
    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        y[0] = if x[0] > 1.5 { x[0] - self.0 } else { x[0] };
    }
}

/// The true residual decides, not the one that the basis promises: here the first cycle promises none, and five per cent
/// more than the tolerance is left, which takes a second one.
#[test]
fn gmres_believes_the_true_residual() {
    let (target, mut x) = (0.02, [0.0]);
    let params = KrylovParams { rel_tol: 0.0, abs_tol: target, ..TIGHT };
    let mut gmres = Gmres::new(&Comm::solo());
    let info = gmres.solve(&Bent(1.05 * target), &Identity, &[2.0], &mut x, params).unwrap();
    assert_eq!(info.iterations, 2);
    assert!((x[0] - (2.0 + 1.05 * target)).abs() < 1e-14, "{x:?}");
    // One that is left within the tolerance ends the solve.
    let mut x = [0.0];
    let info = gmres.solve(&Bent(0.95 * target), &Identity, &[2.0], &mut x, params).unwrap();
    assert!(info.iterations == 1 && (info.final_residual - 0.95 * target).abs() < 1e-15, "{info:?}");
}

/// Whatever the basis size, a solve that would take too long ends where that shows, with the
/// best iterate; one that is in time is not touched.
#[test]
fn gmres_gives_up_where_its_pace_is_too_slow() {
    let a = line(60, 0.0);
    let (_, b) = problem(&a);
    let rhs = b.iter().map(|b| b * b).sum::<f64>().sqrt();
    let mut gmres = Gmres::new(&Comm::solo());
    for restart in [2, 25] {
        let mut x = vec![0.0; a.n_local()];
        let slow = KrylovParams { max_iterations: 10, patience: 3, restart, ..TIGHT };
        match gmres.solve(&a, &Identity, &b, &mut x, slow) {
            Err(KrylovError::NotConverged { iterations, residual, .. }) => {
                assert_eq!(iterations, 3);
                assert!(residual < rhs && x.iter().any(|x| *x != 0.0));
            }
            other => panic!("{other:?}"),
        }
    }
    let mut all = vec![0.0; a.n_local()];
    let expected = gmres.solve(&a, &Identity, &b, &mut all, KrylovParams { restart: 200, ..TIGHT }).unwrap();
    let mut x = vec![0.0; a.n_local()];
    let patient = KrylovParams { patience: 3, restart: 200, ..TIGHT };
    assert_eq!(gmres.solve(&a, &Identity, &b, &mut x, patient).unwrap(), expected);
    assert_eq!(x, all);
}
