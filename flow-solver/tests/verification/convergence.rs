//! Whether a step is converged is known and said.

use crate::common::{at_rest, isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::Laminar;
use flow_solver::steady::March;
use flow_solver::{CouplingIterations, FlowError, Loads, Method};

const LU_SGS: Method = Method::LuSgs { courant: 1e3 };

/// The plate in a stream (Reynolds number 200), by LU-SGS with this many iterations a step.
fn plate(max_iterations: usize, drop: f64) -> flow_solver::Solver<flow_solver::physics::Isothermal, 4> {
    let mut settings = settings([0.0, 0.0, 4.88], drop);
    settings.method = LU_SGS;
    settings.max_iterations = max_iterations;
    isothermal(&crate::plate::plate(4), Laminar { viscosity: 4.88 / 200.0 * 1.225 }, settings)
}

/// What the scene's default drop of 1e-2 takes by LU-SGS, and what 60 iterations leave. The steps are those of
/// the comparison with other methods in `verification.rs`.
#[test]
fn lu_sgs_needs_more_iterations_than_pressure_corrections() {
    let mut s = plate(2000, 1e-2);
    let mut most = 0;
    for _ in 0..4 {
        let report = s.advance(&at_rest(0.02)).expect("solved");
        assert!(report.met && report.end <= report.target, "{report:?}");
        // At rest the target is the drop of the residual that the step began with.
        assert!((report.target / report.start - 1e-2).abs() < 1e-12, "{report:?}");
        most = most.max(report.iterations);
        s.accept(0.02, false);
    }
    println!("LU-SGS: {most} iterations at most to a drop of 1e-2");
    assert!((60..2000).contains(&most), "{most}: the default of flow.solver.max_iterations is 2000");
    // The first step again with too few.
    let mut s = plate(60, 1e-2);
    match s.advance(&at_rest(0.02)) {
        Ok(report) => {
            assert!(!report.met && report.iterations == 60, "{report:?}");
            assert!(report.end > report.target && report.end <= 0.5 * report.start, "{report:?}");
        }
        Err(error) => {
            assert!(matches!(error, FlowError::Unsolved { iterations: 60, .. }), "{error}");
            let text = error.to_string();
            assert!(text.contains("flow.solver.max_iterations") && text.contains("gmres"), "{text}");
        }
    }
}

/// Repeated solves of a step with small changes have their own target; the tolerance of the window is that of
/// the scene.
#[test]
fn repeated_step_uses_the_tolerance_of_its_window() {
    let mut settings = settings([0.0, 0.0, 4.88], 1e-2);
    settings.coupling = Some(CouplingIterations { drop: 1e-4, sufficient: 1e-6 });
    let mut s = isothermal(&crate::plate::plate(4), Laminar { viscosity: 4.88 / 200.0 * 1.225 }, settings);
    let mut last = at_rest(0.02);
    last.moved = true;
    for _ in 0..3 {
        s.advance(&last).expect("solved");
        s.accept(0.02, true);
    }
    let first = s.advance(&last).expect("solved");
    last.repeat = true;
    last.frame = Vec3::new(0.0, 0.0, -1e-3);
    let repeat = s.advance(&last).expect("solved");
    assert!(first.met && repeat.met, "{first:?} {repeat:?}");
    // A tenth of the start of the window, for the grid moves.
    assert!((repeat.target / repeat.start - 1e-3).abs() < 1e-9, "{repeat:?}");
    assert!(repeat.end < 0.3 * repeat.target, "its own target is smaller: {repeat:?}");
}

/// The first solve of a step is less fine after a step of one or two solves than after one of three, and a solver that continues with the
/// warm-start data of another knows which it was.
#[test]
fn solves_are_less_fine_after_a_step_of_few_solves() {
    let after = |solves: usize| {
        let mut settings = settings([0.0, 0.0, 4.88], 1e-2);
        settings.coupling = Some(CouplingIterations { drop: 1e-2, sufficient: 2.5e-4 });
        let viscosity = Laminar { viscosity: 4.88 / 200.0 * 1.225 };
        let mut s = isothermal(&crate::plate::plate(4), viscosity, settings);
        let mut step = at_rest(0.02);
        step.moved = true;
        for _ in 0..3 {
            s.advance(&step).expect("solved");
            s.accept(0.02, true);
        }
        for k in 0..solves {
            step.repeat = k > 0;
            step.frame = Vec3::new(0.0, 0.0, -1e-3 * k as f64);
            s.advance(&step).expect("solved");
        }
        s.accept(0.02, true);
        let warm = s.warm_start();
        assert_eq!(warm.few_solves_before, solves <= 2, "{solves} solves");
        let mut other = isothermal(&crate::plate::plate(4), viscosity, settings);
        other.restore_warm_start(warm).expect("of the same grid");
        assert_eq!(other.warm_start().few_solves_before, solves <= 2, "{solves} solves");
        step.repeat = false;
        s.advance(&step).expect("solved")
    };
    let [two, three] = [after(2), after(3)];
    assert!(two.met && three.met, "{two:?} {three:?}");
    assert!(three.end / three.start < 0.5 * two.end / two.start, "{two:?} {three:?}");
}

/// The residual of all cells drops by half where large cells converge. A small cell whose air was given 30 m/s holds the step until its own velocity
/// is known to a tenth of the speed of the stream; otherwise it is off by several m/s.
#[test]
fn step_goes_on_until_each_cell_is_converged() {
    const STREAM: f64 = 4.88;
    let step = |drop: f64, jet: f64| {
        let viscosity = Laminar { viscosity: STREAM / 200.0 * 1.225 };
        let mut s = isothermal(&crate::plate::plate(4), viscosity, settings([0.0, 0.0, STREAM], drop));
        let small = (0..s.topology.n_owned)
            .min_by(|&a, &b| s.metrics.volume[a].total_cmp(&s.metrics.volume[b]))
            .expect("cells");
        s.previous.iter_mut().for_each(|level| level.q[small][1] += jet);
        s.q[small][1] += jet;
        let report = s.advance(&at_rest(0.02)).expect("solved");
        (report, s.q.clone())
    };
    let (exact, q) = step(1e-8, 30.0);
    let (loose, found) = step(0.5, 30.0);
    let off = |q: &[[f64; 4]], p: &[[f64; 4]]| {
        let of = |(a, b): (&[f64; 4], &[f64; 4])| (1..4).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt();
        q.iter().zip(p).map(of).fold(0.0, f64::max)
    };
    let largest = off(&q, &found);
    println!("{} iterations, off by {largest:.3} m/s at most: {:?}", loose.iterations, loose.cell);
    assert!(largest < 0.1 * STREAM, "{largest}");
    assert!(loose.met && loose.cell.share <= 0.1 && loose.cell.allowed == 0.1, "{loose:?}");
    assert!(exact.met && exact.cell.share < 1e-6, "{exact:?}");
}

/// A march whose steps run out of iterations moves so little that it looks steady: it must not end.
#[test]
fn steady_march_does_not_end_on_an_unconverged_step() {
    let march = March { residual_drop: 1e-2, force_change: 0.0, max_steps: 25, max_courant: 1e3 };
    let run = |iterations: usize| {
        let mut s = plate(iterations, 1e-2);
        s.settings.moving = false;
        let mut loads = Loads::new(&s);
        let marched = march.run(&mut s, Vec3::zeros(), |s| loads.compute(s).force);
        (marched, loads.compute(&s).force[2])
    };
    match run(8).0 {
        Err(FlowError::Unsteady { unsolved, .. }) => assert!(unsolved > 0),
        // A step that cannot even be shortened to one that is solved.
        Err(FlowError::Unsolved { iterations: 8, .. }) => {}
        other => panic!("{other:?}"),
    }
}
