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

const TIGHT: KrylovParams = KrylovParams { rel_tol: 1e-12, abs_tol: 0.0, max_iterations: 400, restart: 25 };

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
