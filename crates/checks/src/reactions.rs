//! Check of the groups of nodes whose reactions are written.

use super::facts::Facts;
use super::finding::Judged;
use super::finding::Severity::Warning;
use super::table::{Check, When};

/// The row.
pub const CHECKS: &[Check] = &[Check {
    id: "output.reaction",
    what: "nodes whose reactions are written are held or moved as prescribed",
    estimate: "nodes of each [[output.reaction]] among those that the canopy holds or a [[stage.motion]] moves, in the stages to run",
    range: "warning for a group without any",
    source: "a free node has no reaction: the columns of the group are zero",
    severity: Warning,
    remedy: "name a set that the canopy holds, such as `held`, or move the nodes by [[stage.motion]]",
    when: When::Before(reactions),
}];

fn reactions(f: &Facts<'_>) -> Vec<Judged> {
    let nodes = |name: Option<&str>, at| f.mesh.nodes_of("", name, at).unwrap_or_default();
    let moved = f.stages().flat_map(|(_, s)| &s.motions);
    let mut held: Vec<u32> = moved.flat_map(|m| nodes(m.nodes.as_deref(), m.at_m)).collect();
    held.extend(f.mesh.fixed.iter().filter(|(_, c)| c.contains(&true)).map(|(n, _)| *n));
    let mut found = Vec::new();
    for (k, r) in f.scene.output.reactions.iter().enumerate() {
        let group = nodes(r.nodes.as_deref(), r.at_m);
        if !group.is_empty() && !group.iter().any(|n| held.contains(n)) {
            let figure =
                format!("nothing holds or moves the {} nodes of \"{}\" in any stage", group.len(), r.name);
            found.push(Judged::new(Warning, format!("output.reaction[{k}]"), figure));
        }
    }
    found
}
