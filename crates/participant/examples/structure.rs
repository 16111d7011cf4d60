//! A mass-spring canopy in place of the structure-solver.
//!
//! The fabric is a net: a spring along each edge of a face and along both its diagonals, which pull and never push. With edges of
//! stiffness 3/4 E t and diagonals of 3/8 E t a square net stretches like an isotropic sheet of Poisson's ratio 1/3. Lines are springs
//! too, masses lie in the nodes, and time advances in explicit (symplectic Euler) steps, as many in a window as are stable.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use ripstop_participant::{
    Announcement, Fault, Input, Participant, Role, Run, StageData, Stats, Window, load_state,
    main as participant_main, save_state, structure_stats as at, write_shape,
};

type Vec3 = [f64; 3];

/// Share of the largest stable time step.
const SAFETY: f64 = 0.7;

struct Spring {
    ends: [usize; 2],
    /// Unstressed length, m.
    rest: f64,
    /// N/m.
    stiffness: f64,
}

/// Displacements (m) and velocities (m/s) of all nodes.
type State = (Vec<Vec3>, Vec<Vec3>);

struct MassSpring {
    announcement: Announcement,
    n_canopy: usize,
    /// Unstressed positions, m.
    coords: Vec<Vec3>,
    faces: Vec<[u32; 4]>,
    /// Springs of the fabric, then the lines.
    springs: Vec<Spring>,
    n_fabric: usize,
    /// kg.
    mass: Vec<f64>,
    /// Whether a node moves along x, y, z.
    free: Vec<[bool; 3]>,
    /// 1/s.
    damping: f64,
    /// Largest stable time step, s.
    stable: f64,
    accepted: State,
    trial: State,
}

impl MassSpring {
    fn new(run: &Run) -> Result<Self, Fault> {
        if run.ranks() != 1 {
            return Err(Fault::new(format!(
                "mass-spring is one process, {} were asked for: use --ranks structure=1",
                run.ranks()
            )));
        }
        let data = run.data(false)?;
        let mesh = &data.structure;
        let n = mesh.coords.len();
        let (springs, n_fabric, mut mass) = springs(&data)?;
        let mut free = vec![[true; 3]; n];
        for (node, held) in &mesh.fixed {
            free[*node] = held.map(|held| !held);
        }
        for (node, kilograms) in &mesh.point_masses {
            mass[*node] += kilograms;
        }
        // Gershgorin: the square of the highest frequency is at most twice the stiffness around a node by its mass.
        let mut around = vec![0.0; n];
        springs.iter().for_each(|s| s.ends.iter().for_each(|node| around[*node] += s.stiffness));
        let highest = (0..n).filter(|i| free[*i] != [false; 3]).map(|i| 2.0 * around[i] / mass[i]);
        let highest = highest.fold(0.0, f64::max);
        let accepted = match run.state(&data) {
            Some(file) => load_state(&file)?,
            None => (vec![[0.0; 3]; n], vec![[0.0; 3]; n]),
        };
        let effects = ["fabric.wrinkling", "lines", "resume", "coupling.adaptive"];
        Ok(Self {
            announcement: run.announcement(&data, "mass-spring", 0, &effects),
            n_canopy: mesh.n_canopy,
            coords: mesh.coords.clone(),
            faces: mesh.faces.clone(),
            springs,
            n_fabric,
            mass,
            free,
            damping: data.stage_number("mass_damping_per_s").unwrap_or(0.0),
            stable: SAFETY * 2.0 / highest.sqrt(),
            trial: accepted.clone(),
            accepted,
        })
    }

    fn positions(&self, u: &[Vec3]) -> Vec<Vec3> {
        self.coords.iter().zip(u).map(|(x, u)| plus(*x, *u)).collect()
    }

    /// Adds the forces of the springs (N); returns strain energy (J) and largest tension of a line (N).
    fn pull(&self, x: &[Vec3], force: &mut [Vec3]) -> (f64, f64) {
        let (mut energy, mut largest) = (0.0, 0.0f64);
        for (number, spring) in self.springs.iter().enumerate() {
            let [i, j] = spring.ends;
            let along = minus(x[j], x[i]);
            let length = dot(along, along).sqrt();
            let tension = spring.stiffness * (length - spring.rest).max(0.0);
            let pull = along.map(|c| c * tension / length);
            force[i] = plus(force[i], pull);
            force[j] = minus(force[j], pull);
            energy += 0.5 * tension * tension / spring.stiffness;
            if number >= self.n_fabric {
                largest = largest.max(tension);
            }
        }
        (energy, largest)
    }

    /// Adds the forces of the load between the start (0) and the end (1) of the window; returns vertical load (N) and projected area (m2).
    fn push(&self, x: &[Vec3], load: &[f64], time: f64, force: &mut [Vec3]) -> (f64, f64) {
        let (mut vertical, mut projected) = (0.0, 0.0);
        for (face, load) in self.faces.iter().zip(load.chunks_exact(8)) {
            let [a, b, c, d] = face.map(|node| node as usize);
            let area = cross(minus(x[c], x[a]), minus(x[d], x[b])).map(|y| 0.5 * y);
            let size = dot(area, area).sqrt();
            let now = |i: usize| (1.0 - time) * load[i] + time * load[4 + i];
            let whole = [0, 1, 2].map(|i| now(0) * area[i] + now(1 + i) * size);
            let corners = if c == d { 3 } else { 4 };
            for node in &[a, b, c, d][..corners] {
                force[*node] = plus(force[*node], whole.map(|f| f / corners as f64));
            }
            vertical += whole[2];
            projected += area[2];
        }
        (vertical, projected.abs())
    }
}

impl Participant for MassSpring {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn output_rows(&self) -> Vec<u64> {
        (0..self.n_canopy as u64).collect()
    }

    fn advance(&mut self, window: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let steps = (window.dt / self.stable).ceil().max(window.substeps as f64);
        let dt = window.dt / steps;
        let keep = 1.0 / (1.0 + dt * self.damping);
        let (mut u, mut v) = self.accepted.clone();
        let mut work = 0.0;
        for step in 0..steps as usize {
            let x = self.positions(&u);
            let mut outside = vec![[0.0; 3]; u.len()];
            self.push(&x, input.canopy, (step as f64 + 0.5) / steps, &mut outside);
            let mut force = outside.clone();
            self.pull(&x, &mut force);
            for i in 0..u.len() {
                for axis in (0..3).filter(|axis| self.free[i][*axis]) {
                    v[i][axis] = keep * (v[i][axis] + dt * force[i][axis] / self.mass[i]);
                    u[i][axis] += dt * v[i][axis];
                }
                work += dt * dot(outside[i], v[i]);
            }
        }
        if u.as_flattened().iter().any(|c| !c.is_finite()) {
            return Err(Fault::new(format!(
                "the net diverged in window {} (t = {} s)",
                window.index, window.time
            )));
        }
        output.copy_from_slice(u[..self.n_canopy].as_flattened());
        let x = self.positions(&u);
        let mut unused = vec![[0.0; 3]; u.len()];
        let (vertical, projected) = self.push(&x, input.canopy, 1.0, &mut unused);
        let (strain, tension) = self.pull(&x, &mut unused);
        let mut stats = Stats::default();
        stats.values[at::KINETIC_ENERGY] = self.mass.iter().zip(&v).map(|(m, v)| 0.5 * m * dot(*v, *v)).sum();
        stats.values[at::STRAIN_ENERGY] = strain;
        stats.values[at::LOAD_WORK] = work;
        stats.values[at::VERTICAL_LOAD] = vertical;
        stats.values[at::PROJECTED_AREA] = projected;
        stats.values[at::MAX_LINE_TENSION] = tension;
        self.trial = (u, v);
        Ok(stats)
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        self.accepted = self.trial.clone();
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        write_shape(folder, &self.positions(&self.accepted.0)[..self.n_canopy])?;
        save_state(folder, Role::Structure, &self.accepted)
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

/// Springs of fabric and lines, the number of those of the fabric, and the masses of the nodes (kg).
fn springs(data: &StageData) -> Result<(Vec<Spring>, usize, Vec<f64>), Fault> {
    let mesh = &data.structure;
    let x = &mesh.coords;
    let thickness = data.number("fabric.thickness_m")?;
    let sheet = data.number("fabric.youngs_modulus_pa")? * thickness;
    let areal_mass = data.number("fabric.density_kg_m3")? * thickness;
    let (modulus, section) = (data.number("lines.youngs_modulus_pa")?, data.number("lines.area_m2")?);
    let line_density = data.number("lines.density_kg_m3")?;
    let mut mass = vec![0.0; x.len()];
    // An edge is shared by two faces and has half its stiffness from each.
    let mut stiffness: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for face in &mesh.faces {
        let nodes = face.map(|node| node as usize);
        let [a, b, c, d] = nodes;
        let area = cross(minus(x[c], x[a]), minus(x[d], x[b]));
        let area = 0.5 * dot(area, area).sqrt();
        let corners = if c == d { 3 } else { 4 };
        nodes[..corners].iter().for_each(|node| mass[*node] += area * areal_mass / corners as f64);
        let edges = [(a, b, 0.375), (b, c, 0.375), (c, d, 0.375), (d, a, 0.375)];
        let diagonals = [(a, c, 0.75), (b, d, 0.75)];
        for (i, j, share) in edges.into_iter().chain(diagonals.into_iter().filter(|_| corners == 4)) {
            if i != j {
                let along = minus(x[j], x[i]);
                *stiffness.entry([i.min(j), i.max(j)]).or_default() +=
                    share * sheet * area / dot(along, along);
            }
        }
    }
    let length = |[i, j]: [usize; 2]| dot(minus(x[j], x[i]), minus(x[j], x[i])).sqrt();
    let fabric =
        stiffness.into_iter().map(|(ends, stiffness)| Spring { ends, rest: length(ends), stiffness });
    let mut springs: Vec<Spring> = fabric.collect();
    let n_fabric = springs.len();
    for cable in &mesh.cables {
        let (ends, rest) = (cable.nodes.map(|node| node as usize), cable.rest_length);
        springs.push(Spring { ends, rest, stiffness: modulus * section / rest });
        ends.iter().for_each(|node| mass[*node] += 0.5 * line_density * section * rest);
    }
    Ok((springs, n_fabric, mass))
}

fn plus(a: Vec3, b: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| a[i] + b[i])
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn main() -> ExitCode {
    participant_main(Role::Structure, MassSpring::new)
}
