//! Convergence of the coupling, and the interface energy balance.

use coupling::energy::{CREATED, InterfaceEnergyBalance, REMOVED};

use super::chart::digits;
use super::data::{Run, StageData};
use super::document::{Block, Section, Table, coupled};
use super::panels::{COUPLING, charts};
use super::stage::anchor;

/// The section of a coupled stage.
pub(super) fn section(run: &Run, stage: &StageData) -> Option<Section> {
    let described = run.stage(stage);
    if !coupled(described.kind) {
        return None;
    }
    let c = &stage.columns;
    let tolerance = run.scene().coupling.tolerance;
    let mut found = charts(COUPLING, c, &format!("coupling-{}", anchor(&described.name)));
    for chart in found.iter_mut().filter(|chart| chart.logarithmic) {
        chart.references.push((tolerance, format!("tolerance {tolerance:e}")));
    }
    let added = c.last("interface_energy_error_sum_j");
    let share = c.last("interface_energy_error_share");
    let mut rows = Vec::new();
    let mut row = |name: &str, value: Option<f64>, unit: &str| {
        if let Some(value) = value {
            rows.push(vec![name.to_owned(), format!("{} {unit}", digits(value))]);
        }
    };
    let magnitudes = c.get("interface_work_j").map(|v| v.iter().map(|w| w.abs()).sum());
    row("work of the air on the canopy, sum of magnitudes", magnitudes, "J");
    row("work of the air on the canopy, net", c.get("interface_work_j").map(|v| v.iter().sum()), "J");
    row("energy added by the coupling", added, "J");
    row("energy added, relative to the sum of magnitudes", share.map(|s| 100.0 * s), "%");
    row("elastic energy at the end", c.last("structure_strain_energy_j"), "J");
    row("kinetic energy at the end", c.last("structure_kinetic_energy_j"), "J");
    let verdict = match share.map(|share| (share, InterfaceEnergyBalance::exceeded(share))) {
        Some((share, Some((done, limit)))) => format!(
            "The coupling has {done} energy: {:.1} % of the interface work; the limit is {:.0} %. Reduce window_s or \
             coupling.tolerance.",
            100.0 * share.abs(),
            100.0 * limit
        ),
        Some((_, None)) => format!(
            "The energy added or removed by the coupling is below the limits of {:.0} and {:.0} % of the interface work.",
            100.0 * CREATED,
            100.0 * REMOVED
        ),
        None => String::new(),
    };
    let mut blocks = vec![Block::Charts(found)];
    if !rows.is_empty() {
        blocks.push(Block::Table(Table {
            caption: "Interface energy balance of the stage.".into(),
            head: Vec::new(),
            rows,
        }));
        blocks.push(Block::Text(verdict));
    }
    Some(Section {
        id: "coupling".into(),
        title: "Coupling and energy".into(),
        lead: "Each window is iterated until the coupling residual meets the tolerance. The interface energy balance \
               shows what the remaining residual adds or removes."
            .into(),
        blocks,
    })
}
