//! The charts of a history, with their captions.

use super::chart::{Chart, Series};
use super::data::Columns;

/// A chart of columns of `history.csv`.
pub(super) struct Panel {
    pub(super) title: &'static str,
    pub(super) unit: &'static str,
    pub(super) note: &'static str,
    /// Column and label of each curve.
    pub(super) columns: &'static [(&'static str, &'static str)],
    pub(super) logarithmic: bool,
}

const fn panel(
    title: &'static str,
    unit: &'static str,
    note: &'static str,
    columns: &'static [(&'static str, &'static str)],
) -> Panel {
    Panel { title, unit, note, columns, logarithmic: false }
}

/// Motion and loads of the parachute.
pub(super) const MOTION: &[Panel] = &[
    panel(
        "Descent speed",
        "m/s",
        "Downward speed of the payload.",
        &[("descent_speed_m_s", "descent speed")],
    ),
    panel(
        "Drift",
        "m",
        "Horizontal position of the payload over ground since its release, where it is free to move sideways.",
        &[("frame_x_m", "along x"), ("frame_y_m", "along y")],
    ),
    panel("Height", "m", "Height of the payload relative to its release.", &[("frame_z_m", "height")]),
    panel(
        "Horizontal velocity",
        "m/s",
        "Velocity of the payload over ground, where it is free to move sideways.",
        &[("frame_vx_m_s", "along x"), ("frame_vy_m_s", "along y")],
    ),
    panel("Drag", "N", "Vertical force of the air on the canopy.", &[("drag_n", "drag")]),
    panel(
        "Side force",
        "N",
        "Horizontal force of the air on the canopy.",
        &[("force_x_n", "along x"), ("force_y_n", "along y")],
    ),
    panel(
        "Pendulum angle",
        "deg",
        "Angle between the vertical and the line from the payload to the centroid of the canopy.",
        &[
            ("pendulum_angle_deg", "pendulum angle"),
            ("pendulum_x_deg", "along x"),
            ("pendulum_y_deg", "along y"),
        ],
    ),
    panel(
        "Projected area",
        "m2",
        "Area of the canopy projected onto the horizontal plane.",
        &[("projected_area_m2", "projected area")],
    ),
    panel(
        "Riser force",
        "N",
        "Force of the lines on the payload, or on their fixed lower end.",
        &[("riser_force_n", "risers"), ("vertical_load_n", "vertical load on the structure")],
    ),
    panel(
        "Maximum line tension",
        "N",
        "Maximum tension over all lines.",
        &[("max_line_tension_n", "maximum line tension")],
    ),
    panel(
        "Membrane force of the fabric",
        "N/m",
        "Force for each metre of unstressed width: the peak of one element, and what 99 % of the area does not exceed.",
        &[("max_membrane_force_n_m", "largest"), ("membrane_force_99_n_m", "99 % of the area")],
    ),
    panel(
        "Tension of the tapes",
        "N",
        "Largest tension of a tape at each place.",
        &[
            ("max_hem_tape_tension_n", "hem"),
            ("max_seam_tape_tension_n", "seams"),
            ("max_vent_tape_tension_n", "vents"),
            ("max_grid_tape_tension_n", "grid"),
        ],
    ),
    panel(
        "Energy of fabric and lines",
        "J",
        "Elastic and kinetic energy of the structure.",
        &[("structure_strain_energy_j", "elastic"), ("structure_kinetic_energy_j", "kinetic")],
    ),
];

/// Convergence and energy of the coupling.
pub(super) const COUPLING: &[Panel] = &[
    panel(
        "Coupling iterations",
        "",
        "Coupling iterations per window; each contains one flow solve.",
        &[("coupling_iterations", "iterations")],
    ),
    Panel {
        title: "Coupling residual",
        unit: "",
        note: "Coupling residual of each accepted window.",
        columns: &[("coupling_residual", "residual")],
        logarithmic: true,
    },
    panel(
        "Interface energy error",
        "J",
        "Work received by the structure minus work done by the flow, accumulated. Zero is exact; a negative sum is \
         dissipation.",
        &[("interface_energy_error_sum_j", "accumulated error")],
    ),
    panel(
        "Work of the air on the canopy",
        "J",
        "Work per window.",
        &[("interface_work_j", "work per window")],
    ),
];

/// Iterations and quality measures of the solvers.
pub(super) const SOLVERS: &[Panel] = &[
    panel(
        "Flow iterations",
        "",
        "Nonlinear iterations of the flow-solver per window, summed over its solves.",
        &[("flow_iterations", "iterations")],
    ),
    panel(
        "Maximum Mach number",
        "",
        "Maximum over all cells. The low-speed preconditioning of the flow assumes values far below 1.",
        &[("flow_max_mach", "maximum Mach number")],
    ),
    panel(
        "Extreme pressures",
        "Pa",
        "Maximum and minimum pressure in the flow, relative to still air.",
        &[("flow_max_pressure_pa", "maximum"), ("flow_min_pressure_pa", "minimum")],
    ),
    panel(
        "Minimum cell quality",
        "",
        "Quality of the worst cell of the moving grid: 1 is a cube, 0 is a degenerate cell.",
        &[("mesh_min_quality", "minimum quality")],
    ),
    panel(
        "Newton iterations of the structure",
        "",
        "Newton iterations (or explicit time steps) per window, summed over the structure solves.",
        &[("structure_newton_steps", "iterations")],
    ),
];

/// The charts of `panels` whose columns are in the history. Columns of zeros are omitted.
pub(super) fn charts(panels: &[Panel], columns: &Columns, prefix: &str) -> Vec<Chart> {
    let mut out = Vec::new();
    for panel in panels {
        let series: Vec<Series> = panel
            .columns
            .iter()
            .map(|(column, label)| Series { label: (*label).into(), points: columns.series(column) })
            .filter(|s| s.points.iter().any(|p| p.1.is_finite() && p.1 != 0.0))
            .collect();
        let chart = Chart {
            id: format!("{prefix}-{}", panel.title.to_lowercase().replace(' ', "-")),
            title: panel.title.into(),
            unit: panel.unit,
            note: panel.note.into(),
            series,
            logarithmic: panel.logarithmic,
            ..Chart::default()
        };
        if !chart.is_empty() {
            out.push(chart);
        }
    }
    out
}
