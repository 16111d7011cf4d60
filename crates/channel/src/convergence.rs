//! Convergence of a response: its residual against the target that the program states.

use case::Role;

use crate::{STATS, flow_stats, mesh_stats, structure_stats};

/// An accepted response may exceed its target by less than this factor; beyond it the window is not accepted. One
/// decade: the defaults keep the solvers' errors two decades below those that the tolerances were chosen for, so one
/// decade remains.
pub const UNCONVERGED_LIMIT: f64 = 10.0;

/// Residual and target in the statistics of a program; `None` where it states no target.
pub fn residual_and_target(role: Role, values: &[f64; STATS]) -> Option<(f64, f64)> {
    let (residual, target) = match role {
        Role::Structure => (structure_stats::RESIDUAL, structure_stats::RESIDUAL_TARGET),
        Role::Flow => (flow_stats::RESIDUAL_END, flow_stats::RESIDUAL_TARGET),
        Role::Mesh => (mesh_stats::RESIDUAL, mesh_stats::RESIDUAL_TARGET),
    };
    (values[target] > 0.0).then(|| (values[residual], values[target]))
}

/// Residual relative to its target: converged up to 1. `None` where the program states no target.
pub fn excess(role: Role, values: &[f64; STATS]) -> Option<f64> {
    residual_and_target(role, values).map(|(residual, target)| residual / target)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_without_a_target_is_not_judged() {
        let mut values = [0.0; STATS];
        values[flow_stats::RESIDUAL_END] = 3.0;
        assert_eq!(excess(Role::Flow, &values), None);
        values[flow_stats::RESIDUAL_TARGET] = 0.5;
        assert_eq!(excess(Role::Flow, &values), Some(6.0));
        // Indices belong to a role: the same index has another meaning for another program.
        assert_eq!(excess(Role::Structure, &[0.0; STATS]), None);
    }
}
