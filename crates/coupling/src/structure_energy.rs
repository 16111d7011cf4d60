//! The energy balance that the structure reports: an error where time integration creates too much energy.
//!
//! The structure computes its works and its balance (`structure-solver`, module `energy`); the coupler checks it for
//! any program that reports one, so that no stage completes with a motion that is a numerical artefact.

use channel::{STATS, structure_stats as stat};

/// Energy created by time integration relative to the throughput, above which a warning is given.
const WARNED: f64 = 0.05;

/// Energy created by time integration of the structure beyond its limit in a window.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "time integration of the structure creates energy: kinetic {kinetic_j:.3e} J and strain {strain_j:.3e} J at \
     t = {time_s:.6} s, while initial energy and work account for {accounted_j:.3e} J; created {window_j:.3e} J in this \
     window and {stage_j:.3e} J in the stage, {excess:.1} times the limit, so the motion is a numerical artefact. \
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
    /// Energy created in the window, J.
    pub window_j: f64,
    /// Energy created in the stage, J.
    pub stage_j: f64,
    /// Energy created relative to the limit.
    pub excess: f64,
}

impl EnergyCreated {
    /// An error where the statistics of a structure exceed the limit, at the end of a window at `time_s` (s).
    pub fn check(values: &[f64; STATS], time_s: f64) -> Option<Self> {
        let excess = values[stat::ENERGY_EXCESS];
        // NaN exceeds the limit.
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

/// Energy created in the stage relative to its throughput; `None` where it is not reported.
pub fn share(values: &[f64; STATS]) -> Option<f64> {
    let throughput = values[stat::ENERGY_THROUGHPUT];
    (throughput > 0.0).then(|| values[stat::ENERGY_CREATED_SUM] / throughput)
}

/// Note for the summary; empty below the limit of the warning.
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

/// A warning when the energy created exceeds 5 % of the throughput of energy for the first time: `before` is the
/// [`share`] up to the window before, `values` are the structure's statistics of this one.
pub fn warning(before: Option<f64>, values: &[f64; STATS]) -> Option<String> {
    let now = share(values).filter(|s| *s > WARNED)?;
    let known = before.is_some_and(|s| s > WARNED);
    (!known).then(|| {
        format!(
            "time integration of the structure has created {:.2e} J, {:.1} % of its energy throughput (limit {:.0} %; an \
             error above five times that). Remedies: structure.integration = \"generalized-alpha\", which creates none; \
             with explicit steps a smaller structure.explicit_safety",
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
    fn energy_beyond_the_limit_is_an_error_with_values() {
        assert_eq!(EnergyCreated::check(&values(1.0, 0.4), 0.5), None);
        let error = EnergyCreated::check(&values(4.0, 1.6), 0.5).expect("an error");
        assert_eq!(error.accounted_j, 3.0);
        let text = error.to_string();
        for part in ["kinetic 5.000e0 J", "t = 0.500000 s", "created", "1.6 times", "generalized-alpha"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(EnergyCreated::check(&values(f64::NAN, f64::NAN), 0.5).is_some());
        // A program without an energy balance is not judged.
        assert_eq!(EnergyCreated::check(&[0.0; STATS], 0.5), None);
        assert_eq!(share(&[0.0; STATS]), None);
    }

    #[test]
    fn first_window_above_five_per_cent_warns() {
        assert_eq!(warning(None, &values(0.4, 0.2)), None);
        let (known, now) = (share(&values(0.4, 0.2)), values(0.6, 0.2));
        assert!(warning(known, &now).expect("a warning").contains("6.0 %"));
        assert_eq!(warning(share(&now), &now), None);
        assert!(note(share(&now)).contains("6.0 %"));
        assert_eq!(note(known), "");
    }
}
