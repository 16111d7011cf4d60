//! The energy balance that the structure reports: refused where time integration creates too much.
//!
//! The structure knows its works and judges its own balance (`structure-solver`, module `energy`);
//! the coupler acts on it for any program that reports one, so that no stage ends as complete with
//! a motion that is an artefact.

use channel::{STATS, structure_stats as stat};

/// Share of the throughput that time integration may create before a warning.
const WARNED: f64 = 0.05;

/// A window in which time integration of the structure created more energy than may be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "time integration of the structure creates energy: kinetic {kinetic_j:.3e} J and strain {strain_j:.3e} J at \
     t = {time_s:.6} s, of which the work done accounts for {accounted_j:.3e} J; created {window_j:.3e} J in this \
     window and {stage_j:.3e} J in the stage, {excess:.1} times what is allowed. The motion is an artefact. \
     Remedies: structure.integration = \"generalized-alpha\" (the default), whose steps create no energy; with \
     \"explicit\" a smaller structure.explicit_safety; with \"newmark\" more stage.substeps;"
)]
pub struct EnergyCreated {
    /// Time at the end of the window, s.
    pub time_s: f64,
    /// Kinetic energy, J.
    pub kinetic_j: f64,
    /// Strain energy, J.
    pub strain_j: f64,
    /// Initial energy and work from outside less damping, J.
    pub accounted_j: f64,
    /// Created in the window, J.
    pub window_j: f64,
    /// Created in the stage, J.
    pub stage_j: f64,
    /// Created over what is allowed.
    pub excess: f64,
}

impl EnergyCreated {
    /// Where the statistics of a structure break its bound, at the end of a window at `time_s` (s).
    pub fn check(values: &[f64; STATS], time_s: f64) -> Option<Self> {
        let excess = values[stat::ENERGY_EXCESS];
        // NaN is no energy either.
        if excess <= 1.0 {
            return None;
        }
        let (kinetic_j, strain_j) = (values[stat::KINETIC_ENERGY], values[stat::STRAIN_ENERGY]);
        let stage_j = values[stat::ENERGY_CREATED_SUM];
        Some(Self {
            time_s,
            kinetic_j,
            strain_j,
            accounted_j: kinetic_j + strain_j - stage_j,
            window_j: values[stat::ENERGY_CREATED],
            stage_j,
            excess,
        })
    }
}

/// Energy created in the stage over its throughput; `None` where it is not reported.
pub fn share(values: &[f64; STATS]) -> Option<f64> {
    let throughput = values[stat::ENERGY_THROUGHPUT];
    (throughput > 0.0).then(|| values[stat::ENERGY_CREATED_SUM] / throughput)
}

/// What a summary says of it, where there is something to say.
pub fn note(share: Option<f64>) -> String {
    match share {
        Some(share) if share > WARNED => {
            format!(
                "; time integration of the structure created {:.1} % of its energy throughput",
                100.0 * share
            )
        }
        _ => String::new(),
    }
}

/// Energy was created beyond [`WARNED`] for the first time: `before` is the [`share`] up to the window before, `values` are the
/// structure's statistics of this one.
pub fn warning(before: Option<f64>, values: &[f64; STATS]) -> Option<String> {
    let now = share(values).filter(|s| *s > WARNED)?;
    let known = before.is_some_and(|s| s > WARNED);
    (!known).then(|| {
        format!(
            "time integration of the structure has created {:.2e} J, {:.1} % of its energy throughput (warned above \
             {:.0} %, an error above five times that): structure.integration = \"generalized-alpha\" creates none, \
             explicit steps less with a smaller structure.explicit_safety",
            values[stat::ENERGY_CREATED_SUM],
            100.0 * now,
            100.0 * WARNED
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(created: f64, excess: f64) -> [f64; STATS] {
        let mut v = [0.0; STATS];
        (v[stat::KINETIC_ENERGY], v[stat::STRAIN_ENERGY]) = (5.0, 2.0);
        (v[stat::ENERGY_CREATED_SUM], v[stat::ENERGY_THROUGHPUT], v[stat::ENERGY_EXCESS]) =
            (created, 10.0, excess);
        v
    }

    #[test]
    fn a_balance_beyond_its_bound_is_an_error_with_figures() {
        assert_eq!(EnergyCreated::check(&values(1.0, 0.4), 0.5), None);
        let error = EnergyCreated::check(&values(4.0, 1.6), 0.5).expect("an error");
        assert_eq!(error.accounted_j, 3.0);
        let text = error.to_string();
        for part in ["kinetic 5.000e0 J", "t = 0.500000 s", "created", "1.6 times", "generalized-alpha"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(EnergyCreated::check(&values(f64::NAN, f64::NAN), 0.5).is_some());
        // A program that reports no balance is not judged.
        assert_eq!(EnergyCreated::check(&[0.0; STATS], 0.5), None);
        assert_eq!(share(&[0.0; STATS]), None);
    }

    #[test]
    fn the_first_window_above_five_per_cent_warns() {
        assert_eq!(warning(None, &values(0.4, 0.2)), None);
        let (known, now) = (share(&values(0.4, 0.2)), values(0.6, 0.2));
        assert!(warning(known, &now).expect("a warning").contains("6.0 %"));
        assert_eq!(warning(share(&now), &now), None);
        assert!(note(share(&now)).contains("6.0 %"));
        assert_eq!(note(known), "");
    }
}
