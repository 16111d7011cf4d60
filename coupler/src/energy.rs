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

/// Sums over a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EnergyBooks {
    windows: u64,
    /// What the coupling added so far, J; below zero what it took.
    pub added_j: f64,
    /// Work of the air on the canopy, to and fro: the sum of its sizes, J.
    pub work_j: f64,
    told: bool,
}

impl EnergyBooks {
    /// Enters a window: what the structure felt and what the flow gave, J.
    pub fn enter(&mut self, felt: f64, given: f64) {
        self.windows += 1;
        self.added_j += felt - given;
        self.work_j += given.abs();
    }

    /// What was added over the work done; 0 where no work was done.
    pub fn share(&self) -> f64 {
        if self.work_j > 0.0 { self.added_j / self.work_j } else { 0.0 }
    }

    /// The coupling has created energy beyond [`CREATED`]: said once, in the first window in
    /// which it is so.
    pub fn warning(&mut self) -> Option<String> {
        if self.told || self.windows < LEAST || self.share() <= CREATED {
            return None;
        }
        self.told = true;
        Some(format!(
            "the coupling itself has created {:.2e} J so far, {:.0} % of the work that the air did on the canopy \
             (told above {:.0} %): windows are too long for this motion, or end too far from convergence. Remedies: \
             a shorter window_s, a smaller coupling.tolerance",
            self.added_j,
            100.0 * self.share(),
            100.0 * CREATED
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An oscillator under a force that is `late` windows late, as a staggered scheme's.
    fn books(late: f64) -> EnergyBooks {
        let mut books = EnergyBooks::default();
        let place = |i: f64| (0.2 * i).sin();
        for i in 0..200 {
            let i = f64::from(i);
            let moved = place(i + 1.0) - place(i);
            // Stiffness and a force in phase with the motion that does net work.
            let force = |i: f64| -place(i) + 0.3 * (0.2 * i).cos();
            books.enter(force(i + 0.5 - late) * moved, force(i + 0.5) * moved);
        }
        books
    }

    #[test]
    fn a_late_force_creates_energy_and_is_told_once() {
        let mut good = books(0.0);
        assert_eq!((good.added_j, good.warning()), (0.0, None));
        let mut late = books(1.0);
        assert!(late.share() > 2.0 * CREATED, "{}", late.share());
        let text = late.warning().unwrap();
        assert!(text.contains("created") && text.contains("window_s"), "{text}");
        assert_eq!(late.warning(), None);
        // Taking energy is damping, not danger.
        assert!(books(-1.0).share() < -2.0 * CREATED);
        assert_eq!(books(-1.0).warning(), None);
        assert_eq!(EnergyBooks::default().share(), 0.0);
    }

    #[test]
    fn the_first_windows_say_nothing() {
        let mut books = EnergyBooks::default();
        for window in 1..=30 {
            books.enter(2.0, 1.0);
            assert_eq!(books.warning().is_some(), window == LEAST);
        }
    }
}
