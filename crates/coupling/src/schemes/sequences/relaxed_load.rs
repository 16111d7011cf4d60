//! The staggered scheme with a relaxed load.

use case::Coupling;

use super::extrapolate::TimeHistory;
use crate::error::RunError;
use crate::partners::LoadOverWindow;
use crate::schemes::codec::{pack, unpack};
use crate::schemes::window::scheme::{CouplingScheme, FromScene, SchemeSettings};
use crate::schemes::window::solvers::Solvers;
use crate::schemes::window::state::{Configuration, WindowState};

/// The staggered scheme of Dettmer and Peric (2013). The structure moves under a load $`f`$ that is predicted by
/// extrapolation of order $`k`$, the flow responds with $`\tilde f_{n+1}`$, and the fraction $`\beta`$ of its response
/// (`coupling.relaxation`) corrects the prediction:
///
/// ```math
/// f^P_{n+1} = 2 f_n - f_{n-1} \;(k = 1), \qquad
/// f_{n+1} = \beta\,\tilde f_{n+1} + (1 - \beta)\,f^P_{n+1}.
/// ```
///
/// Over the substeps the load is the mean of $`f_n`$ and $`f^P_{n+1}`$. The order in time is $`k + 1`$; the error grows
/// as $`1/\beta`$. One flow solve per window.
///
/// Where the load responds to a load as $`\tilde f = c - G f`$, a window multiplies deviations from the equilibrium by
/// the roots of $`z^2 - (2(1-\beta) - \tfrac32\beta G)\,z + (1-\beta) - \tfrac12\beta G`$ ($`k = 1`$), both within the
/// unit circle for $`\beta < 4 / (3 + 2 G)`$, however large $`G`$ is. A light canopy in a flow is more difficult: in
/// `cases/square-drop` its loads oscillate, while `structure-first` fails in the fifth window.
pub struct RelaxedLoad {
    order: usize,
    share: f64,
    loads: TimeHistory,
    velocities: TimeHistory,
    /// Relaxed load at the start of the window, predicted load at its end and their mean, `[faces][LOAD_WIDTH]`, Pa.
    start: Vec<f64>,
    predicted: Vec<f64>,
    mean: Vec<f64>,
}

impl FromScene for RelaxedLoad {
    fn from_scene(settings: SchemeSettings<'_>) -> Self {
        Self {
            order: settings.predictor(),
            share: settings.coupling.relaxation,
            // A load of an earlier stage belongs to windows of another length.
            loads: TimeHistory::default(),
            velocities: TimeHistory::from_start(&settings.interface.velocity),
            start: Vec::new(),
            predicted: Vec::new(),
            mean: Vec::new(),
        }
    }

    fn describe(coupling: &Coupling) -> String {
        let (order, share) = (coupling.staggered.predictor, coupling.relaxation);
        format!(
            "structure first, under loads extrapolated with order {order} and corrected by {share} of the flow's"
        )
    }
}

impl CouplingScheme for RelaxedLoad {
    fn iterates(&self) -> bool {
        false
    }

    fn predict(&mut self, _state: &mut WindowState, _solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        Ok(())
    }

    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError> {
        let dt = state.window.dt;
        let mut velocity = state.interface.velocity;
        self.velocities.extrapolate(self.order, dt, &mut velocity);
        state.set_frame_velocity(velocity);
        self.start = match self.loads.last() {
            Some(load) => load.to_vec(),
            None => solvers.start_load(state)?,
        };
        self.predicted.clone_from(&self.start);
        self.loads.extrapolate(self.order, dt, &mut self.predicted);
        self.mean = self.start.iter().zip(&self.predicted).map(|(f, p)| 0.5 * (f + p)).collect();
        solvers.structure_under(state, LoadOverWindow { start: &self.mean, end: &self.mean })?;
        solvers.flow_around(state, Configuration::End)?;
        solvers.descend(state);
        state.pack_response(solvers.unknowns);
        Ok(())
    }

    fn accept(&mut self, state: &WindowState) {
        let dt = state.window.dt;
        if self.loads.is_empty() {
            self.loads.push(&self.start, dt);
        }
        let responses = state.end.load.iter().zip(&self.predicted);
        let relaxed: Vec<f64> = responses.map(|(f, p)| self.share * f + (1.0 - self.share) * p).collect();
        self.loads.push(&relaxed, dt);
        self.velocities.push(&state.end.velocity, dt);
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(&self.loads, &self.velocities))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        (self.loads, self.velocities) = unpack(saved)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use case::{Scheme, Staggered, StaggeredSequence};
    use channel::{Stats, Window};

    use super::*;
    use crate::schemes::test_support::{ClosedForm, one_mode};

    /// A structure without inertia, $`x = f`$ at the end of a window, and a flow $`\tilde f = c - G x`$.
    struct Affine {
        gain: f64,
        push: f64,
        x: f64,
        grid: f64,
    }

    impl ClosedForm for Affine {
        fn solve_structure(
            &mut self,
            _w: &Window,
            load: LoadOverWindow<'_>,
            displacement: &mut [f64],
        ) -> Stats {
            self.x = load.end[0];
            displacement.copy_from_slice(&[0.0, 0.0, self.x]);
            Stats::default()
        }

        fn move_mesh(&mut self, displacement: &[f64]) {
            self.grid = displacement[2];
        }

        fn solve_flow(&mut self, _w: &Window, load: &mut [f64]) -> Result<Stats, RunError> {
            load.copy_from_slice(&[self.push - self.gain * self.grid, 0.0, 0.0, 0.0]);
            Ok(Stats::default())
        }

        fn accept_window(&mut self, _w: &Window) {}
    }

    /// Displacements at the ends of `windows` windows, from no load.
    fn displacements(gain: f64, share: f64, windows: u64) -> Vec<f64> {
        let coupling = Coupling {
            scheme: Scheme::Staggered,
            staggered: Staggered { sequence: StaggeredSequence::RelaxedLoad, predictor: 1 },
            relaxation: share,
            ..Coupling::default()
        };
        let mut solvers = Affine { gain, push: 7.0, x: 0.0, grid: 0.0 };
        let mut scheme = one_mode(&coupling, 1.0);
        let ends = (0..windows).map(|index| {
            let w = Window { index, substeps: 1, time: index as f64, dt: 1.0, ..Window::default() };
            scheme.run(&mut solvers, w, false).expect("a closed form");
            solvers.x
        });
        ends.collect()
    }

    #[test]
    fn loads_follow_the_closed_form_recurrence() {
        // Real roots z of the recurrence: f_n = f + a z_0^n + b z_1^n, from f_0 = 0 and f_1 = share c.
        let (gain, share): (f64, f64) = (5.0, 0.3);
        let [p, q] = [2.0 * (1.0 - share) - 1.5 * share * gain, (1.0 - share) - 0.5 * share * gain];
        let root = (p * p - 4.0 * q).sqrt();
        let z = [0.5 * (p + root), 0.5 * (p - root)];
        let rest = 7.0 / (1.0 + gain);
        let b = (share * 7.0 - rest + rest * z[0]) / (z[1] - z[0]);
        let load = |n: i32| rest + (-rest - b) * z[0].powi(n) + b * z[1].powi(n);
        for (n, x) in (0..).zip(displacements(gain, share, 40)) {
            let mean = if n == 0 { 0.0 } else { 1.5 * load(n) - 0.5 * load(n - 1) };
            assert!((x - mean).abs() < 1e-12 * rest, "window {n}: {x} instead of {mean}");
        }
    }

    #[test]
    fn loads_converge_up_to_the_theoretical_relaxation() {
        for gain in [0.0, 1.0, 30.0, 1000.0] {
            let limit = 4.0 / (3.0 + 2.0 * gain);
            let deviation = |share: f64| {
                let end = displacements(gain, share, 400);
                (end[399] * (1.0 + gain) / 7.0 - 1.0).abs()
            };
            assert!(deviation(0.98 * limit) < 1e-2, "gain {gain}: {}", deviation(0.98 * limit));
            assert!(deviation(1.02 * limit) > 1e2, "gain {gain}: {}", deviation(1.02 * limit));
        }
    }
}
