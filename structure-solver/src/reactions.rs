//! Reactions: the forces and moments that hold groups of nodes or move them as prescribed.
//!
//! In a step the balance of a component that is held or moves as prescribed, with internal forces $`\mathbf R`$, external forces
//! $`\mathbf F`$ and inertia with damping and weight $`\mathbf M \mathbf w`$, has the reaction
//!
//! ```math
//! \mathbf r = \mathbf R - \mathbf F + \mathbf M \mathbf w
//! ```
//!
//! on the other side. Internal forces have neither resultant nor moment, so that over all nodes $`\sum \mathbf r`$ is the rate of the momentum less
//! the external forces, up to the residual forces of Newton's method on the other components. Reactions are means over a window: of
//! implicit steps where they balance forces, of explicit ones by the trapezoidal rule, with arms $`\mathbf x - \mathbf c`$ at the same points.

use std::io::Write;
use std::path::Path;

use case::Scene;
use mesh::geometry::{Point, Vec3};
use mesh::{MeshError, StructureMesh};

use crate::dynamics::Dynamics;
use crate::flat::at;
use crate::loops::FaceLoad;

/// Force (N) and moment (N m) on the nodes of a group.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// Sum of the forces, N.
    pub force: Vec3,
    /// Sum of their moments about the point of the group, N m.
    pub moment: Vec3,
}

/// Nodes whose reactions are summed.
#[derive(Clone, Debug)]
struct Group {
    /// Owned nodes of this rank with a component that is held or prescribed.
    nodes: Vec<u32>,
    /// Point about which the moment is taken, m.
    about: Vec3,
}

/// Reactions of groups of nodes over a window.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reactions {
    groups: Vec<Group>,
    /// Impulses on this rank in the window so far, N s and N m s; at its end means of all ranks, N and N m.
    sums: Vec<Reaction>,
}

impl Reactions {
    /// Adds forces (N) at `place` (m) on the components that are `fixed` for `dt` seconds.
    pub(crate) fn add(&mut self, force: &[f64], place: &[f64], fixed: &[bool], dt: f64) {
        for (group, sum) in self.groups.iter().zip(&mut self.sums) {
            for n in group.nodes.iter().map(|n| *n as usize) {
                let f = Vec3::from_fn(|c, _| if fixed[3 * n + c] { dt * force[3 * n + c] } else { 0.0 });
                sum.force += f;
                sum.moment += (at(place, n) - group.about).cross(&f);
            }
        }
    }

    fn clear(&mut self) {
        self.sums.fill(Reaction::default());
    }

    /// Makes the sums of all ranks over `dt` seconds means. Collective.
    fn finish(&mut self, comm: &comm::Comm, dt: f64) {
        let cells = self.sums.iter().flat_map(|r| [r.force, r.moment]).flat_map(<[f64; 3]>::from);
        let mut all: Vec<f64> = cells.map(|x| x / dt).collect();
        comm.sum_slice(&mut all);
        for (sum, row) in self.sums.iter_mut().zip(all.as_chunks::<6>().0) {
            let [fx, fy, fz, mx, my, mz] = *row;
            *sum = Reaction { force: Vec3::new(fx, fy, fz), moment: Vec3::new(mx, my, mz) };
        }
    }
}

impl Dynamics {
    /// Sums the reactions of `nodes` of the mesh in each window from now on, with moments about the point `about` (m). Nodes that are free have none.
    pub fn watch_reactions(&mut self, nodes: &[u32], about: Point) {
        let model = &self.system.model;
        let local = nodes.iter().filter_map(|n| model.numbering.local(u64::from(*n)));
        let held = |n: &usize| *n < model.n_owned() && (0..3).any(|c| model.fixed[3 * n + c]);
        let nodes = local.filter(held).map(|n| n as u32).collect();
        let r = self.reactions.get_or_insert_default();
        r.groups.push(Group { nodes, about: about.into() });
        r.sums.push(Reaction::default());
    }

    /// Mean reactions over the window that was computed last, in the order of [`Dynamics::watch_reactions`]; at rest those that hold it there.
    pub fn mean_reactions(&self) -> &[Reaction] {
        self.reactions.as_ref().map_or(&[], |r| &r.sums)
    }

    /// Adds what holds the components in explicit steps from `current` to `next` in `dt` seconds in addition to the forces: inertia, damping and weight.
    pub(crate) fn add_explicit_inertia(&mut self, dt: f64, body: [f64; 3]) {
        let Some(r) = &mut self.reactions else { return };
        let (from, to) = (&self.current, &self.next);
        let force = &mut self.force[1];
        for i in 0..3 * self.system.model.n_owned() {
            let rate = (to.v[i] - from.v[i] + self.damping * (to.u[i] - from.u[i])) / dt - body[i % 3];
            force[i] = self.system.lumped_mass(i / 3) * rate;
            self.x[i] = self.system.model.reference[i] + 0.5 * (from.u[i] + to.u[i]);
        }
        r.add(force, &self.x, &self.system.model.fixed, dt);
    }

    pub(crate) fn clear_reactions(&mut self) {
        self.reactions.iter_mut().for_each(Reactions::clear);
    }

    /// Ends a window of `dt` seconds. Collective.
    pub(crate) fn finish_reactions(&mut self, dt: f64) {
        let comm = self.system.comm().clone();
        self.reactions.iter_mut().for_each(|r| r.finish(&comm, dt));
    }

    /// Takes the reactions of the accepted state, which is at rest under a load and the acceleration `body` (m/s2). Collective.
    pub fn reactions_at_rest(&mut self, load: FaceLoad<'_>, body: [f64; 3]) {
        if self.reactions.is_none() {
            return;
        }
        let force = self.reactions(load, body);
        self.clear_reactions();
        let (x, model) = (&self.x, &self.system.model);
        self.reactions.iter_mut().for_each(|r| r.add(&force, x, &model.fixed, 1.0));
        self.finish_reactions(1.0);
    }
}

/// Watches the groups of `[[output.reaction]]` of a scene.
///
/// # Errors
/// A group that the mesh does not have.
pub(crate) fn watch(dynamics: &mut Dynamics, scene: &Scene, mesh: &StructureMesh) -> Result<(), MeshError> {
    for (k, r) in scene.output.reactions.iter().enumerate() {
        let nodes = mesh.nodes_of(&format!("output.reaction[{k}]"), r.nodes.as_deref(), r.at_m)?;
        let sum: Vec3 = nodes.iter().map(|n| mesh::geometry::at(&mesh.coords, *n)).sum();
        let centroid = sum / nodes.len().max(1) as f64;
        dynamics.watch_reactions(&nodes, r.moment_point_m.unwrap_or(centroid.into()));
    }
    Ok(())
}

/// `reactions.csv` of a stage: a row for each accepted window.
pub(crate) struct Log(std::fs::File);

impl Log {
    /// Of the groups of `scene` in `folder`; `resumed`: continues a file that was cut back to what is known.
    pub(crate) fn open(folder: &Path, scene: &Scene, resumed: bool) -> std::io::Result<Self> {
        let path = folder.join("reactions.csv");
        if resumed && let Ok(file) = std::fs::File::options().append(true).open(&path) {
            return Ok(Self(file));
        }
        std::fs::create_dir_all(folder)?;
        let mut file = std::fs::File::create(path)?;
        let columns = ["force_x_n", "force_y_n", "force_z_n", "moment_x_n_m", "moment_y_n_m", "moment_z_n_m"];
        let names = scene.output.reactions.iter().flat_map(|r| columns.map(|c| format!(",{}_{c}", r.name)));
        writeln!(file, "time_s{}", names.collect::<String>())?;
        Ok(Self(file))
    }

    /// Adds the end of a window at `time` (s).
    pub(crate) fn push(&mut self, time: f64, reactions: &[Reaction]) -> std::io::Result<()> {
        let cells = reactions.iter().flat_map(|r| [r.force, r.moment]).flat_map(<[f64; 3]>::from);
        let text: String = cells.map(|x| format!(",{x:.9e}")).collect();
        writeln!(self.0, "{time:.9e}{text}")
    }
}
