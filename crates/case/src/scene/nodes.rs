//! Masses and forces on nodes, and how a scene names nodes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// A mass on nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointMass {
    /// Name of a node set: `held`, `rim`, `canopy`, an edge of a panel (`left` and `right` at low and high x, `front` and `back` at low and high y), or a
    /// physical group of the mesh file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Mass on each of the nodes, kg.
    pub mass_kg: f64,
}

/// A force on nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Force {
    /// Name of a node set: `held`, `rim`, `canopy`, an edge of a panel (`left` and `right` at low and high x, `front` and `back` at low and high y), or a
    /// physical group of the mesh file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Constant force on each of the nodes, N.
    pub force_n: [f64; 3],
}

/// Refuses invalid masses, and masses without nodes.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    for (k, p) in scene.point_masses.iter().enumerate() {
        selection(&format!("point_mass[{k}]"), &p.nodes, &p.at_m, c);
        c.positive(&format!("point_mass[{k}].mass_kg"), p.mass_kg, 1e6, "a mass in kg");
    }
}

impl Force {
    /// Refuses forces without nodes, and invalid forces.
    pub(crate) fn check(&self, path: &str, c: &mut Check) {
        selection(path, &self.nodes, &self.at_m, c);
        c.finite(&format!("{path}.force_n"), &self.force_n, "a force", "three numbers in N");
    }
}

/// Either a name or a point.
pub(super) fn selection(path: &str, nodes: &Option<String>, at_m: &Option<[f64; 3]>, c: &mut Check) {
    if nodes.is_some() == at_m.is_some() {
        c.refuse(
            path,
            format!("`{path}` names {} nodes", if nodes.is_some() { "two kinds of" } else { "no" }),
            "give either `nodes = \"NAME\"` or `at_m = [X, Y, Z]`",
        );
    }
}
