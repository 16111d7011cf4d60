//! What each column of the CSV files of a run means: the tables of `docs/reference/results.md`.
//!
//! A name ends in its unit (`_n`, `_m_s`); a name without one is a count, a share or a coefficient.

/// A column: its name and what it holds. Braces in a name stand for what a scene names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name in the first line of the file.
    pub name: &'static str,
    /// Meaning, with sign and reference frame where they matter.
    pub meaning: &'static str,
}

const fn column(name: &'static str, meaning: &'static str) -> Column {
    Column { name, meaning }
}

/// Columns of `history.csv`, a row for each accepted window. A stage has those of the programs that run in it.
pub const HISTORY: &[Column] = &[
    column("window", "Number of the window, from 0."),
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column("descent_speed_m_s", "Descent speed of the frame at the end of the window, positive downwards."),
    column("acceleration_m_s2", "Acceleration of the frame, positive upwards."),
    column(
        "drag_n",
        "Vertical force of the air on the canopy, positive upwards. In a stage of kind `flow-only` or without a canopy, with \
         `flow.forces.watch`, the force on the surfaces chosen there along their drag direction.",
    ),
    column(
        "cd",
        "Drag over the dynamic pressure at the initial speed and `descent.reference_area_m2`; with `flow.forces.watch`, \
         over those of the chosen entry. Empty without a reference area and at zero speed.",
    ),
    column("force_x_n", "Force of the air on the canopy along x; with `flow.forces.watch`, as the drag."),
    column("force_y_n", "The same along y."),
    column(
        "pendulum_angle_deg",
        "Angle between the vertical and the line from the payload to the centroid of the canopy. Empty without a payload at rest \
         in the frame.",
    ),
    column(
        "pendulum_x_deg",
        "Component of that angle along x: a vector as long as the angle, along the horizontal part of the line. Empty as the angle.",
    ),
    column("pendulum_y_deg", "The same along y."),
    column(
        "stream_diameters",
        "Diameters of stream that have passed the canopy since the start of the stage: integral of U/D, with the speed U of the \
         undisturbed air relative to the frame and the diameter D of a circle of the projected area. Empty where the wake is not \
         assessed: without a canopy in a stream, in a box or a grid of one's own without a descent, and in a steady stage.",
    ),
    column(
        "stream_speed_m_s",
        "Speed U of the undisturbed air relative to the frame. Empty where the wake is not assessed.",
    ),
    column(
        "frame_x_m",
        "Position of the frame over ground, relative to that at the start of the first coupled stage, along x. Empty, as the next six \
         columns, where the frame moves vertically (`descent.motion`).",
    ),
    column("frame_y_m", "The same along y."),
    column("frame_z_m", "The same along z, negative after a fall."),
    column("frame_vx_m_s", "Velocity of the frame over ground at the end of the window, along x."),
    column("frame_vy_m_s", "The same along y."),
    column("horizontal_speed_m_s", "Horizontal speed of the frame over ground."),
    column(
        "glide_ratio",
        "Horizontal over vertical speed of the frame relative to the undisturbed air. Empty where the wind depends on the height.",
    ),
    column("coupling_iterations", "Coupling iterations of the window."),
    column(
        "coupling_residual",
        "Change of interface displacement and descent speed in the last coupling iteration, relative to their change \
         over the window. Converged below `coupling.tolerance`. Empty where the scheme does not iterate.",
    ),
    column("coupling_converged", "1: converged; 0: accepted above the tolerance."),
    column("window_s", "Length of the window."),
    column("rejected_attempts", "Rejected attempts before the window was accepted."),
    column("interface_work_j", "Work of the air on the canopy in the window."),
    column(
        "interface_energy_error_j",
        "Energy that the coupling adds at the interface in the window: work done on the structure less work done by \
         the flow.",
    ),
    column("interface_energy_error_sum_j", "The same, summed over the stage."),
    column(
        "interface_energy_error_share",
        "The sum over the sum of the absolute values of the interface work.",
    ),
    column(
        "system_missing_impulse_n_s",
        "Impulse of the air on the system that the structure does not report, summed over the stage. Empty where \
         nothing descends.",
    ),
    column(
        "system_energy_j",
        "Energy of payload, fabric and lines relative to the ground, from the end of the first window.",
    ),
    column("system_air_work_j", "Work of the air on the system, summed over the stage."),
    column(
        "system_energy_created_j",
        "Energy of the system less the work of the air and of prescribed motions on it: what time integration, damping and \
         coupling add (below 0: remove).",
    ),
    column("structure_kinetic_energy_j", "Kinetic energy of the structure at the end of the window."),
    column("structure_strain_energy_j", "Strain energy of the structure at the end of the window."),
    column("structure_load_work_j", "Work of the pressure on the structure in the window."),
    column(
        "structure_work_j",
        "Work of loads, gravity and prescribed motions on the structure in the window, less what damping dissipates.",
    ),
    column("structure_work_sum_j", "The same, summed over the stage."),
    column(
        "structure_prescribed_work_j",
        "Part of `structure_work_j` by prescribed motions, constant forces on nodes, and reefing lines that are drawn in or cut.",
    ),
    column(
        "structure_energy_created_j",
        "Energy that time integration creates in the window (below 0: dissipates).",
    ),
    column("structure_energy_created_sum_j", "The same, summed over the stage."),
    column(
        "structure_energy_throughput_j",
        "Energy at the start of the stage plus the absolute values of all work since. 0: the structure reports no \
         energy balance.",
    ),
    column("vertical_load_n", "Vertical load of the pressure on the canopy, positive upwards."),
    column("riser_force_n", "Vertical force of the risers on the payload, positive upwards."),
    column(
        "support_force_n",
        "Mean over the window of the vertical force of the structure on the payload or on its support, positive upwards.",
    ),
    column("max_line_tension_n", "Largest tension of a line."),
    column(
        "max_membrane_force_n_m",
        "Largest membrane force of the fabric, for each metre of unstressed width: the peak of one element. 0: no tension, or not reported.",
    ),
    column("membrane_force_99_n_m", "Membrane force that 99 % of the area of the fabric does not exceed."),
    column(
        "membrane_force_over_strength",
        "Largest membrane force over the strength of its cloth, where cloths of a mesh file have strengths of their own; else 0.",
    ),
    column(
        "membrane_force_over_strength_99",
        "The same that 99 % of the area of these cloths does not exceed.",
    ),
    column("max_hem_tape_tension_n", "Largest tension of a tape of the hem. 0: no tension, or not reported."),
    column("max_seam_tape_tension_n", "The same of the seams."),
    column("max_vent_tape_tension_n", "The same of the vents."),
    column("max_grid_tape_tension_n", "The same of one tape of the grid."),
    column("projected_area_m2", "Area of the canopy projected on a horizontal plane."),
    column("volume_m3", "Volume under the canopy, closed by the plane of its hem."),
    column("structure_newton_steps", "Newton steps of the structure, or explicit steps, in the last solve."),
    column("structure_gmres_iterations", "GMRES iterations of the structure in the last solve."),
    column("structure_factorisations", "Matrix factorisations of the structure in the last solve."),
    column("structure_step_cuts", "Time steps of the structure that were halved in the last solve."),
    column("structure_residual", "Residual of the last Newton step, relative to the load."),
    column("structure_residual_target", "Residual at which the structure is converged. 0: not stated."),
    column("flow_iterations", "Nonlinear (pseudo-time) iterations of the flow in the last solve."),
    column("flow_linear_iterations", "Linear iterations of the flow in the last solve."),
    column("flow_residual_start", "Unsteady residual of the flow before the first iteration."),
    column("flow_residual_end", "Unsteady residual of the flow after the last iteration, on the same scale."),
    column("flow_residual_target", "Residual at which the flow is converged. 0: not stated."),
    column("flow_max_mach", "Largest Mach number."),
    column("flow_max_courant", "Largest convective Courant number."),
    column("flow_max_pressure_pa", "Largest gauge pressure."),
    column("flow_min_pressure_pa", "Smallest gauge pressure."),
    column(
        "flow_mass_defect_kg_s",
        "Sum over all cells of the residual of continuity; of an immersed canopy the air that passes airtight cloth.",
    ),
    column("mesh_iterations", "Linear iterations of the grid motion in the last solve."),
    column("mesh_increments", "Increments into which the grid motion of the window was divided."),
    column("mesh_residual", "Residual of the grid motion."),
    column("mesh_residual_target", "Residual at which the grid motion is converged. 0: not stated."),
    column("mesh_min_quality", "Smallest scaled Jacobian of a cell."),
    column("mesh_min_volume_ratio", "Smallest volume of a cell over its volume at the start."),
    column(
        "structure_unconverged_solves",
        "Time steps of the structure above their target in all solves of the window.",
    ),
    column("flow_unconverged_solves", "Flow solves above their target in the window."),
    column("structure_wall_s", "Wall time in which the structure computed."),
    column("flow_wall_s", "Wall time in which the flow computed."),
    column("mesh_wall_s", "Wall time in which the grid motion was computed."),
    column("coupler_wall_s", "Wall time of the coupler."),
    column("waiting_wall_s", "Wall time of the window in which neither a program nor the coupler computed."),
    column("window_wall_s", "Wall time of the window."),
];

/// Columns of `iterations.csv` of a coupled stage, a row for each coupling iteration.
pub const ITERATIONS: &[Column] = &[
    column("window", "Number of the window, from 0."),
    column("iteration", "Coupling iteration in the window, from 0."),
    column("coupling_residual", "As in `history.csv`, after this iteration."),
];

/// Columns of `forces.csv`, a row for each accepted window, where the scene has `[flow.forces]`. `{on}` is `canopy`
/// where there is one; a set has `wall` where the outer boundary has no-slip walls; one set for each entry of
/// `[[flow.forces.coefficients]]` has its name.
pub const FORCES: &[Column] = &[
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column("{on}_pressure_force_x_n", "Force by pressure along x."),
    column("{on}_pressure_force_y_n", "Force by pressure along y."),
    column("{on}_pressure_force_z_n", "Force by pressure along z."),
    column("{on}_shear_force_x_n", "Force by shear along x; on slip walls by the viscous normal stress."),
    column("{on}_shear_force_y_n", "Force by shear along y."),
    column("{on}_shear_force_z_n", "Force by shear along z."),
    column("{on}_moment_x_n_m", "Moment of both about `moment_point_m`, x."),
    column("{on}_moment_y_n_m", "Moment of both about `moment_point_m`, y."),
    column("{on}_moment_z_n_m", "Moment of both about `moment_point_m`, z."),
    column("{on}_drag_n", "Sum of both forces along `drag_direction`."),
];

/// Columns of `forces.csv` that follow those of [`FORCES`] for each entry of `[[flow.forces.coefficients]]`, which `{name}`
/// is the name of.
pub const FORCE_COEFFICIENTS: &[Column] = &[
    column("{name}_side_n", "Sum of both forces along lift x drag."),
    column(
        "{name}_lift_n",
        "Sum of both forces along the lift: the component of `lift_direction` normal to the drag.",
    ),
    column(
        "{name}_cd",
        "Drag over dynamic pressure and `reference_area_m2`. Empty at zero speed, as all coefficients.",
    ),
    column("{name}_cs", "Side force over the same."),
    column("{name}_cl", "Lift over the same."),
    column("{name}_cm_roll", "Moment about the axis of the drag over the same and `reference_length_m`."),
    column("{name}_cm_pitch", "Moment about the axis of the side force over the same."),
    column("{name}_cm_yaw", "Moment about the axis of the lift over the same."),
];

/// Columns of `probes.csv`, a row for each accepted window, where the scene has `[[flow.probe]]`; one set for each probe.
pub const PROBES: &[Column] = &[
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column("{probe}_p_pa", "Gauge pressure."),
    column("{probe}_u_m_s", "Velocity relative to the falling frame, x."),
    column("{probe}_v_m_s", "Velocity relative to the falling frame, y."),
    column("{probe}_w_m_s", "Velocity relative to the falling frame, z."),
    column("{probe}_t_k", "Temperature."),
];

/// Columns of `points.csv`, a row for each accepted window, where the scene has `[[output.point]]`; one set for each point.
pub const POINTS: &[Column] = &[
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column("{point}_x_m", "Displacement of the node from its place in the unstressed shape, along x."),
    column("{point}_y_m", "The same, y."),
    column("{point}_z_m", "The same, z."),
];

/// Columns of `reactions.csv`, a row for each accepted window, where the scene has `[[output.reaction]]`; one set for each group.
pub const REACTIONS: &[Column] = &[
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column(
        "{group}_force_x_n",
        "Mean force over the window that holds the nodes or moves them as prescribed, along x; of a static stage that at rest. Where the scene has \
         `[fabric_gravity]` it also carries their weight and inertia in the frame.",
    ),
    column("{group}_force_y_n", "The same, y."),
    column("{group}_force_z_n", "The same, z."),
    column(
        "{group}_moment_x_n_m",
        "Mean moment of these forces about `moment_point_m`, or about the centroid of the nodes in the unstressed shape, along x.",
    ),
    column("{group}_moment_y_n_m", "The same, y."),
    column("{group}_moment_z_n_m", "The same, z."),
];

/// Columns of `payload.csv`, a row for each accepted window, where the scene has `[descent.body]`.
pub const PAYLOAD: &[Column] = &[
    column("time_s", "Time at the end of the window, from the start of the stage."),
    column("x_m", "Position of the centre of mass in the falling frame, x."),
    column("y_m", "The same, y."),
    column("z_m", "The same, z."),
    column("vx_m_s", "Velocity of the centre of mass in the falling frame, x."),
    column("vy_m_s", "The same, y."),
    column("vz_m_s", "The same, z."),
    column("qw", "Orientation as a unit quaternion, scalar part."),
    column("qx", "The same, x."),
    column("qy", "The same, y."),
    column("qz", "The same, z."),
    column("rate_x_rad_s", "Angular velocity, x."),
    column("rate_y_rad_s", "Angular velocity, y."),
    column("rate_z_rad_s", "Angular velocity, z."),
    column("tilt_rad", "Angle between the vertical axis of the payload and the vertical."),
    column("force_x_n", "Force on the payload, x."),
    column("force_y_n", "Force on the payload, y."),
    column("force_z_n", "Force on the payload, z."),
];

/// Whether the columns `names` of a file are those of `table`, with a set of columns for each of the names in braces.
/// Returns the first that is in one and not in the other.
pub fn first_difference(table: &[Column], names: &[&str]) -> Option<String> {
    let fits = |pattern: &str, name: &str| match pattern.split_once('}') {
        Some((_, end)) => name.len() > end.len() && name.ends_with(end),
        None => pattern == name,
    };
    let unknown = names.iter().find(|n| !table.iter().any(|c| fits(c.name, n)));
    let missing = table.iter().find(|c| !names.iter().any(|n| fits(c.name, n)));
    unknown.map(|n| (*n).to_owned()).or(missing.map(|c| c.name.to_owned()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use case::StageKind;

    use super::*;
    use crate::history;

    #[test]
    fn every_column_of_a_history_is_described_and_none_else() {
        use StageKind::{Coupled, FlowOnly, PreInflation, Prescribed, Trajectory};
        let kinds = [PreInflation, FlowOnly, Coupled, Prescribed, Trajectory];
        let written: BTreeSet<&str> = kinds.into_iter().flat_map(history::names).collect();
        assert_eq!(written, HISTORY.iter().map(|c| c.name).collect());
        // A coupled stage has all of them, in this order.
        assert_eq!(history::names(StageKind::Coupled), HISTORY.iter().map(|c| c.name).collect::<Vec<_>>());
    }

    #[test]
    fn columns_of_iterations_are_described() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("iterations.csv");
        history::Iterations::open(&path, false).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text.trim(), ITERATIONS.iter().map(|c| c.name).collect::<Vec<_>>().join(","));
    }

    #[test]
    fn names_with_braces_fit_any_name() {
        let header = |text: &'static str| text.split(',').collect::<Vec<_>>();
        let probes = "time_s,a_p_pa,a_u_m_s,a_v_m_s,a_w_m_s,a_t_k";
        assert_eq!(first_difference(PROBES, &header(probes)), None);
        assert_eq!(first_difference(PROBES, &header("time_s,a_p_pa")).as_deref(), Some("{probe}_u_m_s"));
        assert_eq!(first_difference(PAYLOAD, &header("time_s,new_n")).as_deref(), Some("new_n"));
    }
}
