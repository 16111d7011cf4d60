//! Energy books of the interface: what the coupling itself adds.
//!
//! In a window the structure feels the work $\sum_j \tfrac12(f_j+f_{j-1})\cdot\Delta d_j$ of its
//! substeps, the flow gives $f\cdot\Delta d$ on the motion of its walls. What one says more than
//! the other comes from the coupling: its order in time, a load that is late, a window that is
//! not converged.

/// Share of the work done so far that the coupling may create before it is told.
pub const CREATED: f64 = 0.05;
/// Windows before the books say anything: the first ones start from rest.
const LEAST: u64 = 20;

/// Share of windows above the coupling tolerance from which on these are the likely cause.
const UNCONVERGED: f64 = 0.1;
/// Shares of the time in which the air passes the canopy before the books say anything: until then the work is that of
/// the first adjustment, to and fro. (With an eighth of the window of `square-drop` the share is -4.7 % after 20
/// windows and within 1.2 % from 30 on, at tolerances of 5e-3 and 5e-4 alike.)
const SETTLED: f64 = 0.2;
/// Windows shorter than this share of the time in which the air passes the canopy are short.
const SHORT: f64 = 5e-3;

/// What the remedy of a warning depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Circumstances {
    /// The scheme is staggered.
    pub staggered: bool,
    /// Coupling tolerance.
    pub tolerance: f64,
    /// Length of the window, s.
    pub window_s: f64,
    /// Time in which the air passes the canopy, s; infinite without wind and descent.
    pub passage_s: f64,
}

/// Sums over a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EnergyBooks {
    windows: u64,
    unconverged: u64,
    time_s: f64,
    /// What the coupling added so far, J; below zero what it took.
    pub added_j: f64,
    /// Work of the air on the canopy, to and fro: the sum of its sizes, J.
    pub work_j: f64,
    told: bool,
}

impl EnergyBooks {
    /// Enters a window of `dt` seconds: what the structure felt and what the flow gave, J, and whether it converged.
    pub fn enter(&mut self, dt: f64, felt: f64, given: f64, converged: bool) {
        self.windows += 1;
        self.time_s += dt;
        self.unconverged += u64::from(!converged);
        self.added_j += felt - given;
        self.work_j += given.abs();
    }

    /// What was added over the work done; 0 where no work was done.
    pub fn share(&self) -> f64 {
        if self.work_j > 0.0 { self.added_j / self.work_j } else { 0.0 }
    }

    /// The coupling has created energy beyond [`CREATED`]: said once, in the first window in
    /// which it is so.
    pub fn warning(&mut self, about: &Circumstances) -> Option<String> {
        let passing = about.passage_s.is_finite() && self.time_s < SETTLED * about.passage_s;
        let early = self.windows < LEAST || passing;
        if self.told || early || self.share() <= CREATED {
            return None;
        }
        self.told = true;
        Some(format!(
            "the coupling itself has created {:.2e} J so far, {:.0} % of the work that the air did on the canopy \
             (reported above {:.0} %): {}",
            self.added_j,
            100.0 * self.share(),
            100.0 * CREATED,
            self.cause(about)
        ))
    }

    /// The likely cause with its remedy.
    fn cause(&self, about: &Circumstances) -> String {
        let Circumstances { staggered, tolerance, window_s, passage_s } = *about;
        if staggered {
            return "a staggered scheme gives the structure a load that is not that of its own motion. Remedy: \
                    coupling.scheme = \"implicit\""
                .into();
        }
        if self.unconverged as f64 > UNCONVERGED * self.windows as f64 {
            return format!(
                "{} of {} windows ended above the tolerance of {tolerance:.1e}. Remedies: a larger \
                 coupling.max_iterations, a smaller flow.solver.residual_drop",
                self.unconverged, self.windows
            );
        }
        let share = window_s / passage_s;
        if share < SHORT {
            return format!(
                "the window of {window_s:.2e} s is short already (1/{:.0} of the {passage_s:.2} s in which the air passes \
                 the canopy), so the load changes from window to window by what the solvers' tolerances leave or \
                 with the fastest modes of the fabric. Remedies: a smaller coupling.tolerance (now {tolerance:.1e}) and \
                 flow.solver.residual_drop, a structure.spectral_radius below 1",
                1.0 / share
            );
        }
        format!(
            "the load changes much over a window of {window_s:.2e} s (the air passes the canopy in {passage_s:.2} s). \
             Remedy: a shorter window_s; then a smaller coupling.tolerance (now {tolerance:.1e})"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Circumstances =
        Circumstances { staggered: false, tolerance: 1e-3, window_s: 5e-3, passage_s: 0.5 };

    /// An oscillator under a force that is `late` windows late, as a staggered scheme's.
    fn books(late: f64) -> EnergyBooks {
        let mut books = EnergyBooks::default();
        let place = |i: f64| (0.2 * i).sin();
        for i in 0..200 {
            let i = f64::from(i);
            let moved = place(i + 1.0) - place(i);
            // Stiffness and a force in phase with the motion that does net work.
            let force = |i: f64| -place(i) + 0.3 * (0.2 * i).cos();
            books.enter(5e-3, force(i + 0.5 - late) * moved, force(i + 0.5) * moved, true);
        }
        books
    }

    #[test]
    fn a_late_force_creates_energy_and_is_told_once() {
        let mut good = books(0.0);
        assert_eq!((good.added_j, good.warning(&LONG)), (0.0, None));
        let mut late = books(1.0);
        assert!(late.share() > 2.0 * CREATED, "{}", late.share());
        let text = late.warning(&LONG).unwrap();
        assert!(text.contains("created") && text.contains("window_s"), "{text}");
        assert_eq!(late.warning(&LONG), None);
        // Taking energy is damping, not danger.
        assert!(books(-1.0).share() < -2.0 * CREATED);
        assert_eq!(books(-1.0).warning(&LONG), None);
        assert_eq!(EnergyBooks::default().share(), 0.0);
    }

    #[test]
    fn the_first_windows_say_nothing() {
        let mut books = EnergyBooks::default();
        for window in 1..=30 {
            books.enter(5e-3, 2.0, 1.0, true);
            assert_eq!(books.warning(&LONG).is_some(), window == LEAST);
        }
    }

    /// What a warning says after 30 windows of which `unconverged` did not converge.
    fn remedy(about: Circumstances, unconverged: u32) -> String {
        let mut books = EnergyBooks::default();
        (0..30).for_each(|i| books.enter(5e-3, 2.0, 1.0, i >= unconverged));
        let text = books.warning(&about).expect("half of the work is created");
        text.split("%): ").nth(1).expect("a cause").to_owned()
    }

    #[test]
    fn the_remedy_is_that_of_the_cause() {
        let staggered = remedy(Circumstances { staggered: true, ..LONG }, 0);
        assert!(staggered.contains("coupling.scheme = \"implicit\"") && !staggered.contains("window_s"));
        let unconverged = remedy(LONG, 10);
        assert!(
            unconverged.contains("10 of 30 windows") && !unconverged.contains("window_s"),
            "{unconverged}"
        );
        assert!(remedy(LONG, 0).contains("a shorter window_s"));
        // An eighth of the default window of 2 m at 4 m/s.
        let eighth = Circumstances { window_s: 6.25e-4, ..LONG };
        let short = remedy(eighth, 0);
        assert!(short.contains("1/800") && short.contains("coupling.tolerance"), "{short}");
        assert!(!short.contains("window_s"), "{short}");
    }

    #[test]
    fn short_windows_are_judged_after_as_much_time_as_long_ones() {
        let mut books = EnergyBooks::default();
        let window_s = 6.25e-4;
        let about = Circumstances { window_s, ..LONG };
        let first = (1..=400).find(|_| {
            books.enter(window_s, 2.0, 1.0, true);
            books.warning(&about).is_some()
        });
        assert_eq!(first, Some((SETTLED * LONG.passage_s / window_s).ceil() as u64));
    }
}
