//! Energy balance of the structure: what was put into it, and what time integration created.
//!
//! Over a window the kinetic and strain energy $`E`$ changes by the work $`W`$ of everything outside
//! of the structure, less what damping takes, and by $`C = \Delta E - W`$, which no physics
//! accounts for. Stresses of averaged strains with midpoint inertia give $`C \le 0`$ in every step
//! of any length (Simo and Tarnow 1992; [`crate::materials::step`]), up to the work of the residual
//! forces of Newton's method. Newmark's method and central differences give
//! no such bound, so each window is checked.
//!
//! **The bound.** $`C`$ summed over the stage may not exceed [`STAGE_SHARE`] of the throughput
//! $`E_0 + \sum |W_k|`$ (initial energy, and the sizes of all works $`W_k`$ by kind and window), nor
//! $`C`$ of one window [`WINDOW_SHARE`] of the energy at its start and the sizes of its works: beyond
//! that, most of the motion is an artefact. Both have a floor, the energy of the whole structure at
//! a uniform strain of [`FLOOR_STRAIN`]: less moves nothing that is of interest.

use std::path::Path;

use channel::{Fault, structure_stats as stat};
use serde::{Deserialize, Serialize};

use crate::dynamics::{Dynamics, Interval, LoadPath, blend};
use crate::loops::{Configuration, FaceLoad};
use crate::measures::Measures;
use crate::system::System;

/// Share of the throughput of a stage that time integration may create.
pub const STAGE_SHARE: f64 = 0.25;
/// Share of the energy at the start of a window and of its works that may be created in it.
pub const WINDOW_SHARE: f64 = 1.0;
/// Strain at which the energy of the whole structure is the floor of both bounds.
pub const FLOOR_STRAIN: f64 = 1e-4;

/// Works on the structure, J, above zero where they raise its energy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Works(pub [f64; Works::KINDS]);

impl Works {
    /// Number of kinds.
    pub const KINDS: usize = 8;
    /// Pressures and tractions on the fabric.
    pub const LOAD: usize = 0;
    /// Constant forces on nodes.
    pub const FORCE: usize = 1;
    /// Gravity and the frame's acceleration on fabric, lines and point masses.
    pub const GRAVITY: usize = 2;
    /// Prescribed motions.
    pub const MOTION: usize = 3;
    /// Gravity and drag on the own mass of a rigid payload.
    pub const PAYLOAD: usize = 4;
    /// Reefing lines that are drawn in or cut.
    pub const SCHEDULE: usize = 5;
    /// Damping and the drag of lines.
    pub const DAMPING: usize = 6;
    /// Residual forces of Newton's method; not external work.
    pub const RESIDUAL: usize = 7;

    /// Sum of the works from outside.
    pub fn total(&self) -> f64 {
        self.0[..Self::RESIDUAL].iter().sum()
    }

    /// Work of prescribed motions, of constant forces and of reefing lines that change.
    pub fn prescribed(&self) -> f64 {
        [Self::FORCE, Self::MOTION, Self::SCHEDULE].iter().map(|kind| self.0[*kind]).sum()
    }

    /// Sum of their sizes.
    pub fn sizes(&self) -> f64 {
        self.0[..Self::RESIDUAL].iter().map(|w| w.abs()).sum()
    }
}

/// Energy put into the structure and created in it, J.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergySums {
    /// Work from outside.
    pub work: f64,
    /// Created by time integration; below zero: taken by it.
    pub created: f64,
    /// Initial energy and the sizes of all works.
    pub throughput: f64,
}

/// The energy balance of a stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyBalance {
    /// Kinetic and strain energy at the last accepted window; `None` before the first.
    energy: Option<f64>,
    /// Sums over accepted windows.
    sums: EnergySums,
    /// Energy that the change of velocities at the last acceptance added.
    averaged: f64,
    /// Energy below which nothing is judged.
    floor: f64,
}

/// The balance of one window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindowEnergy {
    /// Kinetic and strain energy at its end.
    pub energy: f64,
    /// Of the window alone; its throughput is the energy at its start and the sizes of its works.
    pub window: EnergySums,
    /// Of the stage so far, this window included.
    pub stage: EnergySums,
    /// What was created over what may be; above 1 the motion is an artefact.
    pub excess: f64,
}

impl WindowEnergy {
    /// Enters it into the statistics of a window.
    pub fn report(&self, values: &mut [f64]) {
        values[stat::WORK] = self.window.work;
        values[stat::ENERGY_CREATED] = self.window.created;
        values[stat::WORK_SUM] = self.stage.work;
        values[stat::ENERGY_CREATED_SUM] = self.stage.created;
        values[stat::ENERGY_THROUGHPUT] = self.stage.throughput;
        values[stat::ENERGY_EXCESS] = self.excess;
    }
}

impl EnergyBalance {
    /// Whether the energy at the start of the stage is known.
    pub fn started(&self) -> bool {
        self.energy.is_some()
    }

    /// Starts with the energy of the accepted state and the floor of the structure, J.
    pub fn start(&mut self, energy: f64, floor: f64) {
        *self = Self { energy: Some(energy), floor, ..Self::default() };
        self.sums.throughput = energy;
    }

    /// The balance of a window from the accepted state to a state of `energy` (J).
    pub fn window(&self, energy: f64, works: &Works) -> WindowEnergy {
        let before = self.energy.unwrap_or(energy);
        let work = works.total() + self.averaged;
        let sizes = works.sizes() + self.averaged.abs();
        // The accepted energy holds what the velocities' average added.
        let created = energy - before - works.total();
        let window = EnergySums { work, created, throughput: before + sizes };
        let stage = EnergySums {
            work: self.sums.work + work,
            created: self.sums.created + created,
            throughput: self.sums.throughput + sizes,
        };
        let excess = |s: &EnergySums, share: f64| s.created / (share * s.throughput + self.floor);
        let excess = match self.floor > 0.0 {
            true => excess(&window, WINDOW_SHARE).max(excess(&stage, STAGE_SHARE)),
            false => 0.0,
        };
        WindowEnergy { energy, window, stage, excess }
    }

    /// The window is final; `averaged`: energy (J) that a change of velocities at its end added.
    pub fn accept(&mut self, w: &WindowEnergy, averaged: f64) {
        self.energy = Some(w.energy + averaged);
        (self.sums, self.averaged) = (w.stage, averaged);
    }

    /// Writes it next to the state of the nodes; the same on each rank, so one of them does it.
    pub(crate) fn save(&self, folder: &Path) -> Result<(), Fault> {
        archive::save(&folder.join(FILE), MAGIC, VERSION, self).map(|_| ()).map_err(Fault::new)
    }

    /// Reads what [`EnergyBalance::save`] wrote in the same stage; `None` where nothing is there.
    pub(crate) fn load(folder: &Path) -> Result<Option<Self>, Fault> {
        archive::if_present(archive::load(&folder.join(FILE), MAGIC, VERSION)).map_err(Fault::new)
    }
}

const FILE: &str = "energy.bin";
const MAGIC: [u8; 8] = *b"ripenerg";
const VERSION: u32 = 1;

/// Energy of the whole structure at a uniform strain of [`FLOOR_STRAIN`], above that of the
/// unstressed shape, J. Collective.
///
/// Fabric that starts slack ([`crate::model::Model::tautening`]) has none there. It is stretched from positions at which it is taut, where the second
/// difference of the energy is twice that of a uniform strain.
pub fn floor(system: &System) -> f64 {
    let scaled = |by: f64| -> Vec<f64> { system.model.reference.iter().map(|x| x * by).collect() };
    let taut = system.model.tautening;
    let energy = if taut > 1.0 {
        let [less, at, more] =
            [1.0 - FLOOR_STRAIN, 1.0, 1.0 + FLOOR_STRAIN].map(|s| system.energy(&scaled(taut * s)));
        0.5 * (more - 2.0 * at + less)
    } else {
        system.energy(&scaled(1.0 + FLOOR_STRAIN)) - system.energy(&system.model.reference)
    };
    system.comm().sum(energy.abs())
}

/// A structure whose time integration creates energy.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "time integration of the structure creates energy: kinetic {kinetic:.3e} J and strain {strain:.3e} J at \
     t = {time:.6} s, of which the work done accounts for {accounted:.3e} J; created {window:.3e} J in this \
     window and {stage:.3e} J in the stage. The motion is an artefact. Remedies: {remedy}"
)]
pub struct EnergyCreated {
    /// Time at the end of the window, s.
    pub time: f64,
    /// Kinetic energy, J.
    pub kinetic: f64,
    /// Strain energy, J.
    pub strain: f64,
    /// Initial energy and work from outside, less damping, J.
    pub accounted: f64,
    /// Created in this window, J.
    pub window: f64,
    /// Created in the stage, J.
    pub stage: f64,
    /// What helps.
    pub remedy: &'static str,
}

impl EnergyCreated {
    /// Where a window breaks the bound.
    pub fn check(w: &WindowEnergy, m: &Measures, time: f64, integration: case::Integration) -> Option<Self> {
        // NaN is no energy either.
        (w.excess > 1.0 || w.excess.is_nan()).then_some(Self {
            time,
            kinetic: m.kinetic,
            strain: m.strain,
            accounted: w.energy - w.stage.created,
            window: w.window.created,
            stage: w.stage.created,
            remedy: remedy(integration),
        })
    }
}

/// What helps a structure that creates energy.
fn remedy(integration: case::Integration) -> &'static str {
    match integration {
        case::Integration::Newmark => {
            "structure.integration = \"generalized-alpha\" (the default), whose steps create no energy; with \
             Newmark's method more stage.substeps"
        }
        case::Integration::Explicit => {
            "a smaller structure.explicit_safety, or structure.integration = \"generalized-alpha\""
        }
        _ => "a smaller structure.newton_tolerance, more stage.substeps, structure.spectral_radius = 1",
    }
}

impl Dynamics {
    /// Adds the works of the step from `current` to `next`, which covers `part` of the
    /// window, on owned nodes. `known`: trapezoidal work of the load, energy taken by damping.
    pub(crate) fn add_works(&mut self, part: Interval<'_>, known: [f64; 2], works: &mut Works) {
        let body = part.body;
        let averaged = self.explicit.is_none() && self.scheme.alpha_f > 0.0;
        let w = &mut works.0;
        w[Works::LOAD] += if averaged { self.averaged_load_work(part) } else { known[0] };
        w[Works::DAMPING] -= known[1];
        let n = 3 * self.system.model.n_owned();
        let mut du = std::mem::take(&mut self.du);
        du.clear();
        du.extend(self.next.u.iter().zip(&self.current.u).map(|(b, a)| b - a));
        w[Works::FORCE] += self.system.nodal_work(&du);
        if body != [0.0; 3] {
            let f = &mut self.force[1];
            f.fill(0.0);
            self.system.add_mass_product(&du, f);
            w[Works::GRAVITY] += (0..n).map(|i| body[i % 3] * f[i]).sum::<f64>();
        }
        if self.explicit.is_none() {
            w[Works::RESIDUAL] += self.newton.unbalanced_work(&du[..n]);
        }
        if self.system.depends_on_time() {
            w[Works::SCHEDULE] += self.schedule_work(part);
        }
        if !self.motions.is_empty() {
            w[Works::MOTION] += self.motion_work(part, averaged, &du);
        }
        if let (Some(p), Some(from), Some(to)) = (&self.payload, &self.current.body, &self.next.body)
            && self.system.comm().is_root()
        {
            w[Works::PAYLOAD] += p.work(from, to, body.into());
        }
        self.du = du;
    }

    /// Positions at the share `weight` of the step from `current` to `next` into `self.x`.
    fn place_between(&mut self, weight: f64) {
        let (from, to) = (&self.current.u, &self.next.u);
        for (i, x) in self.x.iter_mut().enumerate() {
            *x = self.system.model.reference[i] + from[i] + weight * (to[i] - from[i]);
        }
    }

    /// Work of the load where the scheme applies it, J.
    fn averaged_load_work(&mut self, part: Interval<'_>) -> f64 {
        let Interval { span, load, .. } = part;
        let weight = 1.0 - self.scheme.alpha_f;
        blend(load, span[0] + weight * (span[1] - span[0]), &mut self.pressure, &mut self.traction);
        self.place_between(weight);
        let face_load = FaceLoad { pressure: &self.pressure, traction: &self.traction };
        self.system.pressed(&self.x, face_load, &mut self.force[1]);
        let n = 3 * self.system.model.n_owned();
        (0..n).map(|i| self.force[1][i] * (self.next.u[i] - self.current.u[i])).sum()
    }

    /// Change of the energy at the old positions when the clock goes to the end of the step, J.
    fn schedule_work(&mut self, part: Interval<'_>) -> f64 {
        let Interval { span, window, .. } = part;
        self.place_between(0.0);
        let at = |share: f64| self.time + share * window;
        let after = self.system.energy(&self.x);
        self.system.set_time(at(span[0]));
        let before = self.system.energy(&self.x);
        self.system.set_time(at(span[1]));
        after - before
    }

    /// Work of the forces that move nodes as prescribed, J: the residual forces along their path,
    /// and the change of momentum at their mean velocity.
    fn motion_work(&mut self, part: Interval<'_>, averaged: bool, du: &[f64]) -> f64 {
        let Interval { span, load, body, .. } = part;
        self.system.set_step(part.dt());
        let weight = 1.0 - self.scheme.alpha_f;
        let mut f = vec![0.0; du.len()];
        if averaged {
            self.imbalance(span, load, weight, weight, &mut f);
        } else {
            let mut before = vec![0.0; du.len()];
            self.imbalance(span, load, 0.0, 1.0, &mut before);
            self.imbalance(span, load, 1.0, 1.0, &mut f);
            f.iter_mut().zip(&before).for_each(|(f, b)| *f = 0.5 * (*f + b));
        }
        let (from, to) = (&self.current.v, &self.next.v);
        let mean = |i: usize| 0.5 * (from[i] + to[i]);
        let given: Vec<f64> = (0..du.len()).map(|i| self.damping * mean(i) - body[i % 3]).collect();
        self.system.add_mass_product(&given, &mut f);
        let mut momentum = vec![0.0; du.len()];
        let dv: Vec<f64> = to.iter().zip(from).map(|(b, a)| b - a).collect();
        self.system.add_mass_product(&dv, &mut momentum);
        let owned = 3 * self.system.model.n_owned();
        let dofs = self.motions.iter().flat_map(|m| &m.dofs).map(|i| *i as usize).filter(|i| *i < owned);
        dofs.map(|i| f[i] * du[i] + momentum[i] * mean(i)).sum()
    }

    /// Internal minus external forces (N) without inertia at the share `at` of the step, with
    /// stresses of strains averaged by `weight`.
    fn imbalance(&mut self, span: [f64; 2], load: LoadPath<'_>, at: f64, weight: f64, out: &mut [f64]) {
        blend(load, span[0] + at * (span[1] - span[0]), &mut self.pressure, &mut self.traction);
        let end = if weight < 1.0 {
            self.place_between(1.0);
            Some(self.x.clone())
        } else {
            None
        };
        self.place_between(at);
        let end = end.as_deref().unwrap_or(&self.x);
        let face_load = FaceLoad { pressure: &self.pressure, traction: &self.traction };
        self.system.forces(Configuration { at: &self.x, end, weight }, face_load, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn works(load: f64, damping: f64) -> Works {
        let mut w = Works::default();
        (w.0[Works::LOAD], w.0[Works::DAMPING], w.0[Works::RESIDUAL]) = (load, -damping, 7.0);
        w
    }

    fn started() -> EnergyBalance {
        let mut b = EnergyBalance::default();
        b.start(2.0, 1e-3);
        b
    }

    #[test]
    fn a_balanced_window_creates_nothing_and_the_residual_is_no_work() {
        let mut b = started();
        let w = b.window(2.0 + 3.0 - 1.0, &works(3.0, 1.0));
        assert_eq!((w.window.created, w.window.work, w.window.throughput), (0.0, 2.0, 6.0));
        assert_eq!((w.stage.throughput, w.excess), (6.0, 0.0));
        // A change of velocities at the end is work of the next window.
        b.accept(&w, -0.5);
        let w = b.window(3.5, &works(0.0, 0.0));
        assert_eq!((w.window.created, w.window.work, w.stage.work), (0.0, -0.5, 1.5));
    }

    #[test]
    fn creation_is_bounded_in_a_window_and_over_the_stage() {
        let mut b = started();
        let none = works(0.0, 0.0);
        let sudden = b.window(2.0 + 2.0 * WINDOW_SHARE + 0.01, &none);
        assert!(sudden.excess > 1.0, "{sudden:?}");
        // A tenth in each window: the sum breaks the bound of the stage, no window its own.
        let mut energy = 2.0;
        let broken = (0..).find(|_| {
            energy *= 1.1;
            let w = b.window(energy, &none);
            b.accept(&w, 0.0);
            w.excess > 1.0
        });
        // 2 (1.1^n - 1) > 0.25 * 2: n = 3.
        assert_eq!(broken, Some(2));
        // Dissipation is none of it.
        assert!(started().window(0.1, &none).excess < 0.0);
    }

    #[test]
    fn what_is_below_the_floor_is_not_judged() {
        let mut b = EnergyBalance::default();
        b.start(0.0, 1e-3);
        assert!(b.window(0.9e-3, &works(0.0, 0.0)).excess < 1.0);
        assert!(b.window(1.1e-3, &works(0.0, 0.0)).excess > 1.0);
        assert!(b.window(f64::NAN, &works(0.0, 0.0)).excess.is_nan());
    }
}
