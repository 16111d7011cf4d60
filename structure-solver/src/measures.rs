//! Numbers that describe a state: energies, loads, areas, tensions, volume.

use case::{Scene, TapePlace};
use comm::Comm;
use mesh::geometry::Vec3;
use mesh::{CableKind, StructureMesh};

use crate::elements::load::area_vector;
use crate::flat::at;
use crate::loops::FaceLoad;
use crate::newton::State;
use crate::system::System;

/// Global values of a state, the same on each rank.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// Kinetic energy, J.
    pub kinetic: f64,
    /// Strain energy, J.
    pub strain: f64,
    /// Vertical load of the pressure, N, upwards.
    pub vertical_load: f64,
    /// Projected area on a horizontal plane, m2: the area of the upward part of
    /// the surface, `sum max(0, n_z) A`. It equals the union of all projections
    /// while no two upward parts lie above each other, which holds for a canopy
    /// without folds over its top.
    pub projected_area: f64,
    /// Largest tension of a suspension line, N.
    pub max_line_tension: f64,
    /// Vertical force of the lines on the node that they hang from (the payload),
    /// N, upwards.
    pub riser_force: f64,
    /// Volume between the canopy and the horizontal plane through its hem, m3.
    pub volume: f64,
    /// Mean force over the window on what holds the structure, N: see `support.rs`.
    pub support_force: Vec3,
    /// Largest membrane force, N for each metre of unstressed width.
    pub max_membrane_force: f64,
    /// Membrane force that 99 % of the unstressed area does not exceed, N/m.
    pub membrane_force_99: f64,
    /// Largest membrane force over the strength of its cloth, where cloths of a mesh file have strengths of their own; else 0.
    pub max_force_over_strength: f64,
    /// The same that 99 % of the unstressed area of these cloths does not exceed.
    pub force_over_strength_99: f64,
    /// Largest tension of a tape at each place, N, in the order of [`TapePlace::ALL`].
    pub max_tape_tensions: [f64; TapePlace::ALL.len()],
    /// Momentum of the free components of all nodes in the frame, N s.
    pub momentum: Vec3,
}

/// Input of the measures, except the state.
pub struct Diagnostics {
    /// Local nodes of the hem that this rank owns.
    hem: Vec<u32>,
    /// Cables counted here that end on a fixed node, with the end (0 or 1) there.
    held: Vec<(u32, usize)>,
    /// Cables counted here that are suspension lines.
    lines: Vec<u32>,
    /// Cables counted here that are tapes: cable, place, and the number of tapes that it stands for.
    tapes: Vec<(u32, TapePlace, f64)>,
    /// Thickness of the triangles counted here, m.
    thickness: Vec<f64>,
    /// Strength of their cloths, N/m, infinite without one; where a group of a mesh file has its own.
    strength: Option<Vec<f64>>,
    x: Vec<f64>,
    w: Vec<f64>,
}

impl Diagnostics {
    /// The hem is where suspension lines start; without lines it is the rim. Thickness and strength are those of the cloths of `scene`.
    pub fn new(system: &System, mesh: &StructureMesh, scene: &Scene) -> Self {
        let model = &system.model;
        let mut is_hem = vec![false; mesh.coords.len()];
        for c in mesh.cables.iter().filter(|c| c.kind == CableKind::SuspensionLine) {
            c.nodes
                .iter()
                .filter(|n| (**n as usize) < mesh.n_canopy)
                .for_each(|&n| is_hem[n as usize] = true);
        }
        if !is_hem.contains(&true) {
            let rim = rim_nodes(mesh);
            // Rim on symmetry planes is no hem where the rest is held at its height.
            let level = |n: &&u32| mesh.fixed.iter().any(|(m, c)| m == *n && c[2]);
            let held: Vec<u32> = rim.iter().filter(level).copied().collect();
            let hem = if held.is_empty() { rim } else { held };
            hem.into_iter().for_each(|n| is_hem[n as usize] = true);
        }
        let hem = (0..model.n_owned()).filter(|&i| is_hem[model.numbering.global[i] as usize]);
        let fixed = |n: u32| (0..3).all(|c| model.fixed[3 * n as usize + c]);
        let mut held = Vec::new();
        let (mut lines, mut tapes) = (Vec::new(), Vec::new());
        for (k, c) in model.cables[..model.n_own_cables].iter().enumerate() {
            match c.kind {
                CableKind::SuspensionLine => lines.push(k as u32),
                CableKind::Tape(place) => tapes.push((k as u32, place, c.share)),
                _ => {}
            }
            held.extend((0..2).filter(|&end| fixed(c.nodes[end])).map(|end| (k as u32, end)));
        }
        let zero = || vec![0.0; 3 * model.n_local()];
        let own = || model.triangles[..model.n_own_triangles].iter().map(|t| scene.fabric_of(t.fabric));
        Self {
            hem: hem.map(|i| i as u32).collect(),
            held,
            lines,
            tapes,
            thickness: own().map(|cloth| cloth.thickness_m).collect(),
            strength: scene
                .has_strengths_by_group()
                .then(|| own().map(|cloth| cloth.strength_n_m.unwrap_or(f64::INFINITY)).collect()),
            x: zero(),
            w: zero(),
        }
    }

    /// Kinetic energy of `state` on owned nodes, J.
    fn own_kinetic(&mut self, system: &System, state: &State) -> f64 {
        self.w.fill(0.0);
        system.add_mass_product(&state.v, &mut self.w);
        let n = 3 * system.model.n_owned();
        0.5 * self.w[..n].iter().zip(&state.v).map(|(m, v)| m * v).sum::<f64>()
    }

    /// Kinetic energy of `state`, J. Collective.
    pub fn kinetic(&mut self, system: &System, state: &State) -> f64 {
        system.comm().sum(self.own_kinetic(system, state))
    }

    /// Measures `state` under `load`. Collective.
    pub fn measure(&mut self, system: &System, state: &State, load: FaceLoad<'_>) -> Measures {
        let model = &system.model;
        let comm = &model.comm;
        for i in 0..self.x.len() {
            self.x[i] = model.reference[i] + state.u[i];
        }
        let x = &self.x;
        let mut hem = [self.hem.iter().map(|&n| x[3 * n as usize + 2]).sum(), self.hem.len() as f64];
        comm.sum_slice(&mut hem);
        let hem_z = if hem[1] > 0.0 { hem[0] / hem[1] } else { 0.0 };

        let strain = system.energy(x);
        let kinetic = self.own_kinetic(system, state);
        let x = &self.x;
        let (mut lift, mut area, mut volume) = (0.0, 0.0, 0.0);
        for t in &model.triangles[..model.n_own_triangles] {
            let p = t.nodes.map(|n| at(x, n as usize));
            let a = area_vector(&p);
            let face = t.face as usize;
            lift += load.pressure[face] * a[2];
            area += a[2].max(0.0);
            // Divergence theorem with the field (0, 0, z - hem): the closing plane
            // and vertical gaps add nothing.
            volume += ((p[0][2] + p[1][2] + p[2][2]) / 3.0 - hem_z) * a[2];
            if !load.traction.is_empty() {
                lift += load.traction[3 * face + 2] * a.norm();
            }
        }
        let tensions = system.tensions(x);
        let pull = |&(k, end): &(u32, usize)| {
            let c = &model.cables[k as usize];
            let [from, to] = [c.nodes[end], c.nodes[1 - end]].map(|n| at(x, n as usize));
            let d = to - from;
            tensions[k as usize] * d[2] / d.norm()
        };
        let riser: f64 = self.held.iter().map(pull).sum();
        let mut sums = [kinetic, strain, lift, area, volume, riser];
        comm.sum_slice(&mut sums);
        let tension = self.lines.iter().map(|&k| tensions[k as usize]).fold(0.0, f64::max);
        let mut tapes = [0.0f64; TapePlace::ALL.len()];
        for &(k, place, share) in &self.tapes {
            let most = &mut tapes[place as usize];
            *most = most.max(tensions[k as usize] / share);
        }
        let [forces, over_strength] = self.membrane_forces(system);
        Measures {
            kinetic: sums[0],
            strain: sums[1],
            vertical_load: sums[2],
            projected_area: sums[3],
            volume: sums[4],
            riser_force: sums[5],
            max_line_tension: comm.max(tension),
            max_membrane_force: forces[0],
            membrane_force_99: forces[1],
            max_force_over_strength: over_strength[0],
            force_over_strength_99: over_strength[1],
            max_tape_tensions: tapes.map(|t| comm.max(t)),
            ..Measures::default()
        }
    }

    /// Largest membrane force and that of [`AREA_SHARE`] at the positions measured last, N/m, and the same over the strength. Collective.
    fn membrane_forces(&self, system: &System) -> [[f64; 2]; 2] {
        let model = &system.model;
        let own = &model.triangles[..model.n_own_triangles];
        let stresses = system.by_triangle(0.0, |l| l.nominal_stresses(&self.x));
        let cloth = self.thickness.iter().zip(own);
        let mut forces: Vec<(f64, f64)> =
            stresses.iter().zip(cloth).map(|(s, (t, triangle))| (t * s, triangle.reference.area)).collect();
        let all = largest_and_quantile(&model.comm, &forces);
        let Some(strengths) = &self.strength else { return [all, [0.0; 2]] };
        for ((force, area), strength) in forces.iter_mut().zip(strengths) {
            // Cloth without a strength is no part of the area.
            *area = if strength.is_finite() { *area } else { 0.0 };
            *force /= strength;
        }
        [all, largest_and_quantile(&model.comm, &forces)]
    }
}

/// Largest of the `values`, each of an area (m2), and the one that [`AREA_SHARE`] of the area does not exceed. Collective.
fn largest_and_quantile(comm: &Comm, values: &[(f64, f64)]) -> [f64; 2] {
    let most = comm.max(values.iter().map(|v| v.0).fold(0.0, f64::max));
    if most <= 0.0 {
        return [0.0; 2];
    }
    let mut areas = [0.0; BINS];
    for (value, area) in values {
        areas[((value / most * BINS as f64) as usize).min(BINS - 1)] += area;
    }
    comm.sum_slice(&mut areas);
    [most, most * quantile(&areas, AREA_SHARE)]
}

/// Share of the area whose membrane force is reported next to the largest one: the largest belongs to one element at a corner or a line, and grows
/// as elements shrink.
const AREA_SHARE: f64 = 0.99;

/// Intervals of the distribution of membrane forces over the area: its quantiles are exact to a thousandth of the largest force.
const BINS: usize = 1000;

/// Value that `share` of a distribution over equal intervals of 0 to 1 does not exceed, linear within an interval.
fn quantile(weights: &[f64], share: f64) -> f64 {
    let mut missing = share * weights.iter().sum::<f64>();
    for (k, &weight) in weights.iter().enumerate() {
        if weight >= missing && weight > 0.0 {
            return (k as f64 + missing / weight) / weights.len() as f64;
        }
        missing -= weight;
    }
    1.0
}

/// Canopy nodes on edges of one triangle only.
fn rim_nodes(mesh: &StructureMesh) -> Vec<u32> {
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|t| (0..3).map(|i| [t[i], t[(i + 1) % 3]]))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| a == b).filter(|c| c.len() == 1).map(|c| c[0]);
    let mut nodes: Vec<u32> = single.flatten().collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}
