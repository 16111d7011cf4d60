//! Which curves a history gives, with a sentence on each.

use super::chart::{Chart, Series};
use super::data::Columns;

/// A chart of columns of `history.csv`.
pub(super) struct Panel {
    pub(super) title: &'static str,
    pub(super) unit: &'static str,
    pub(super) note: &'static str,
    /// Column and name.
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
        "Downwards speed of the payload.",
        &[("descent_speed_m_s", "descent speed")],
    ),
    panel("Drag", "N", "Vertical force of the air on the canopy.", &[("drag_n", "drag")]),
    panel(
        "Side force",
        "N",
        "Horizontal force of the air: what pushes the canopy aside.",
        &[("force_x_n", "along x"), ("force_y_n", "along y")],
    ),
    panel(
        "Projected area",
        "m2",
        "Area of the canopy seen from above: it breathes.",
        &[("projected_area_m2", "projected area")],
    ),
    panel(
        "Force in the risers",
        "N",
        "Force on the payload, or on what holds the lines' lower end.",
        &[("riser_force_n", "risers"), ("vertical_load_n", "vertical load on the structure")],
    ),
    panel(
        "Largest line tension",
        "N",
        "Largest tension of a line, for which it must be made.",
        &[("max_line_tension_n", "largest line tension")],
    ),
    panel(
        "Energy of fabric and lines",
        "J",
        "Elastic energy, and kinetic energy, which measures the remaining motion.",
        &[("structure_strain_energy_j", "elastic"), ("structure_kinetic_energy_j", "kinetic")],
    ),
];

/// How the coupling went.
pub(super) const COUPLING: &[Panel] = &[
    panel(
        "Coupling iterations",
        "",
        "Calls of the solvers in each window until they agreed.",
        &[("coupling_iterations", "iterations")],
    ),
    Panel {
        title: "Coupling residual",
        unit: "",
        note: "How far the solvers still disagreed when a window was accepted.",
        columns: &[("coupling_residual", "residual")],
        logarithmic: true,
    },
    panel(
        "Energy that the coupling added",
        "J",
        "Work received by the structure less work given by the flow, summed: ideally zero; a negative sum damps.",
        &[("interface_energy_error_sum_j", "added so far")],
    ),
    panel(
        "Work of the air on the canopy",
        "J",
        "In each window: to and fro as the canopy breathes.",
        &[("interface_work_j", "work in a window")],
    ),
];

/// How the solvers went.
pub(super) const SOLVERS: &[Panel] = &[
    panel(
        "Flow iterations",
        "",
        "Nonlinear iterations of the flow in each window, all its calls together.",
        &[("flow_iterations", "iterations")],
    ),
    panel(
        "Largest Mach number",
        "",
        "Far below 1, as the low-speed preconditioning of the flow supposes.",
        &[("flow_max_mach", "largest Mach number")],
    ),
    panel(
        "Pressure in the flow",
        "Pa",
        "Highest and lowest pressure anywhere, relative to still air.",
        &[("flow_max_pressure_pa", "highest"), ("flow_min_pressure_pa", "lowest")],
    ),
    panel(
        "Worst cell of the moving grid",
        "",
        "Quality of the worst cell: 1 is a cube, 0 is no cell any more.",
        &[("mesh_min_quality", "least quality")],
    ),
    panel(
        "Newton steps of the structure",
        "",
        "Nonlinear (or explicit) steps in each window, all its calls together.",
        &[("structure_newton_steps", "steps")],
    ),
];

/// The charts of those panels whose columns a history has; columns of zeros are left out.
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
            references: Vec::new(),
            logarithmic: panel.logarithmic,
        };
        if !chart.is_empty() {
            out.push(chart);
        }
    }
    out
}
