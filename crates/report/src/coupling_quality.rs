//! Convergence of the coupling, and the interface energy balance.

use coupling::energy::CREATED;

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
    let to_and_fro = c.get("interface_work_j").map(|v| v.iter().map(|w| w.abs()).sum());
    row("work of the air on the canopy, to and fro", to_and_fro, "J");
    row("work of the air on the canopy, net", c.get("interface_work_j").map(|v| v.iter().sum()), "J");
    row("added by the coupling itself", added, "J");
    row("which is, of the work to and fro,", share.map(|s| 100.0 * s), "%");
    row("elastic energy at the end", c.last("structure_strain_energy_j"), "J");
    row("kinetic energy at the end", c.last("structure_kinetic_energy_j"), "J");
    let verdict = match share {
        Some(share) if share > CREATED => format!(
            "The coupling creates energy ({:.1} % of the work; it should stay below {:.0} %): a shorter window_s or a \
             smaller coupling.tolerance helps.",
            100.0 * share,
            100.0 * CREATED
        ),
        Some(_) => "The coupling creates no energy to speak of.".to_owned(),
        None => String::new(),
    };
    let mut blocks = vec![Block::Charts(found)];
    if !rows.is_empty() {
        blocks.push(Block::Table(Table { head: Vec::new(), rows }));
        blocks.push(Block::Text(verdict));
    }
    Some(Section {
        id: "coupling".into(),
        title: "Coupling and energy".into(),
        lead: "In each window the solvers are asked until they agree; what they still disagree about would show as energy \
               from nowhere."
            .into(),
        blocks,
    })
}
