//! `[programs]` and `[ranks]`: what runs in each role, on how many ranks.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// The keys of `programs`, for the schema: an open map would let a misspelt role pass.
#[derive(Default, Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code)]
pub(super) struct Programs {
    /// Instead of `structure-solver`.
    structure: Option<String>,
    /// Instead of `flow-solver`.
    flow: Option<String>,
    /// Instead of `mesh-mover`.
    mesh: Option<String>,
}

/// One of the three solver programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// `structure-solver`
    Structure,
    /// `flow-solver`
    Flow,
    /// `mesh-mover`
    Mesh,
}

impl Role {
    /// All roles, in launch order.
    pub const ALL: [Role; 3] = [Role::Structure, Role::Flow, Role::Mesh];

    /// Name on channels and command lines.
    pub fn name(self) -> &'static str {
        match self {
            Role::Structure => "structure",
            Role::Flow => "flow",
            Role::Mesh => "mesh",
        }
    }

    /// Name of the project's own program for this role.
    pub fn program(self) -> &'static str {
        match self {
            Role::Structure => "structure-solver",
            Role::Flow => "flow-solver",
            Role::Mesh => "mesh-mover",
        }
    }
}

/// Ranks per program.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Ranks {
    /// Ranks of the structure-solver.
    pub structure: u32,
    /// Ranks of the flow-solver. Absent: 2; with `[flow.immersed]` 1.
    pub flow: u32,
    /// Ranks of the mesh-mover.
    pub mesh: u32,
}

impl Default for Ranks {
    fn default() -> Self {
        Self { structure: 1, flow: 2, mesh: 2 }
    }
}

impl Ranks {
    /// Ranks of one program.
    pub fn of(&self, role: Role) -> u32 {
        match role {
            Role::Structure => self.structure,
            Role::Flow => self.flow,
            Role::Mesh => self.mesh,
        }
    }

    /// Ranks of one program, to be changed.
    pub fn of_mut(&mut self, role: Role) -> &mut u32 {
        match role {
            Role::Structure => &mut self.structure,
            Role::Flow => &mut self.flow,
            Role::Mesh => &mut self.mesh,
        }
    }
}

/// Refuses programs without ranks.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    for role in Role::ALL {
        let path = format!("ranks.{}", role.name());
        c.count(&path, scene.ranks.of(role), 1..=100_000, "ranks of one program");
    }
}
