//! Surrogate of the flow's response to a motion of the canopy, used between two flow solves.
//!
//! The load of the flow is split into the pressure that accelerates the added mass of the air, and a defect that
//! depends weakly on the motion within a window:
//!
//! ```math
//! p(x) = q - \rho A^{-1} a_n(x),
//! ```
//!
//! $`a_n`$ is the normal acceleration of the faces by the same backward differences as in mesh-mover and flow-solver,
//! $`A`$ the influence matrix of the vortex lattice ([`super::vortex_lattice`]). The defect $`q`$ is extrapolated from
//! past windows before the flow solve, and measured after it. Secants correct the surrogate: differences of flow
//! responses within a window, less the surrogate's prediction.
//!
//! On a canopy of very many faces the lattice has one ring per group of neighbours ([`super::panel_groups`]): the
//! matrix acts on mean accelerations, and the motion of a face relative to its group gets the added mass of short
//! waves.
//!
//! The canopy changes its shape, and windows are halved after a rejection: the lattice is reassembled when the normals
//! have rotated against each other, and when the screening parameter of the air has changed. A rotation of the whole
//! canopy leaves the matrix as it is ([`super::orientation`]).

use std::collections::VecDeque;
use std::ops::Range;

use channel::LOAD_WIDTH;
use serde::{Deserialize, Serialize};

use super::closed_volume::{self, ClosedVolume, Finding};
use super::inverse::ShortMatrix;
use super::orientation::{Orientation, best_rotation};
use super::panel_groups::PanelGroups;
use super::vortex_lattice::{Air, VortexLattice};
use crate::error::RunError;
use crate::geometry::{Vec3, at, direction, distinct, quad_area_vector};
use crate::schemes::codec::{pack, unpack};
use crate::schemes::least_squares::{Columns, axpy, norm};
use crate::schemes::unknowns::Unknowns;

/// Largest number of secants.
const MAX_SECANTS: usize = 40;
/// A secant is filtered out when the part of its step that is orthogonal to newer ones is below this fraction. (Most
/// of the rest is noise: with 0.03 the descent below needs 6.2 iterations in each of its first ten windows, with 0.1
/// it needs 4.9.)
const FILTER: f64 = 0.1;
/// A secant is also filtered out when that part is below this fraction of the load: divided by so small a step, the
/// flow's tolerance would be mistaken for a response. ATPS descent with 10 cells across, tolerance 1e-4, 100 windows,
/// lattice without screening: 5.5 iterations per window without this filter; 4.9, 4.8, 5.1, 5.2 with 3e-5, 1e-4,
/// 2e-4, 1e-3.
const NOISE: f64 = 1e-4;
/// The step is known exactly; the change contains the noise of the flow's tolerance. Where the change is larger than
/// the step by this factor, the filter compares the change with the noise: air in a closed volume responds to a step
/// of 1e-5 of the load with 1e-3 of it. With the filter on the step such secants were dropped, and three of six runs
/// of `closed-box` stalled at 2 to 7 times the tolerance; now none of 22 does (`residual_drop` 1e-5; 10.4 iterations
/// per window in those six, 8.3 in the 22).
const STEEP_SLOPE: f64 = 4.0;

/// Rotation of the normals (root mean square, rad) after which they are updated.
const ROTATION_TOLERANCE: f64 = 0.02;
/// Rotation of the normals against that of the whole canopy (root mean square, rad) after which the lattice is
/// reassembled, which drops the secants. The coarse ATPS, swinging, 2500 windows of 10 ms: 193, 66, 26 lattices and 5109,
/// 5056, 5016 iterations with 0.02, 0.05, 0.1; with a new lattice after any rotation of 0.02, 247 and 5119.
const DEFORMATION_TOLERANCE: f64 = 0.1;
/// The same around an immersed canopy, whose columns age sooner. The square drop of `studies/square-drop-methods` with 10
/// and 14 cells across, 60 windows: 312 and 251 iterations with 0.02, 320 and 277 with 0.1.
const DEFORMATION_TOLERANCE_IMMERSED: f64 = 0.02;
/// Relative change of the window length after which the lattice is reassembled.
const LENGTH_TOLERANCE: f64 = 0.1;

/// The canopy at the end of a window: displacement and velocity relative to the ground, `[nodes][3]`.
#[derive(Serialize, Deserialize)]
struct InterfaceKinematics {
    displacement: Vec<f64>,
    velocity: Vec<f64>,
}

/// Change of the defect over a step of the surrogate's load.
#[derive(Serialize, Deserialize)]
struct Secant {
    step: Vec<f64>,
    change: Vec<f64>,
    /// Smallest fraction of the step orthogonal to newer secants.
    filter: f64,
}

/// A saved surrogate: kinematics, length of the last window, secants, configuration of the lattice, displacement at the
/// last update after a rotation, closed volume.
type SavedState =
    (VecDeque<InterfaceKinematics>, f64, VecDeque<Secant>, (Vec<f64>, f64), Option<Vec<f64>>, ClosedVolume);

/// How a surrogate followed the canopy.
pub enum SurrogateUpdate {
    /// It has a new matrix.
    Reassembled(Box<VortexLattice>),
    /// It has the matrix of the canopy before its rotation.
    Turned(Orientation),
}

/// The added-mass surrogate. Its response: loads `[faces][LOAD_WIDTH]` (Pa), then the force on the canopy (N) in the axes of the
/// frame, the vertical one at least.
pub struct AddedMassSurrogate {
    unknowns: Unknowns,
    faces: Vec<[u32; 4]>,
    air: Air,
    /// Largest number of groups.
    most: usize,
    /// The flow takes first-order differences of positions and velocities.
    first_order: bool,
    /// Unstressed positions, m.
    reference: Vec<Vec3>,
    /// Configuration of the lattice: displacement, `[nodes][3]`, m, and length of windows, s.
    assembled_for: (Vec<f64>, f64),
    /// Normals in that configuration.
    assembled_normals: Vec<Vec3>,
    /// Displacement of the canopy at the last update of `normals` and `areas`, where later than the assembly.
    turned_for: Option<Vec<f64>>,
    normals: Vec<Vec3>,
    /// Area vectors of the faces, m2.
    areas: Vec<Vec3>,
    groups: PanelGroups,
    /// Inverse of the influence matrix.
    inverse: ShortMatrix,
    /// Gain of the relaxation that lattices are asked for.
    gain: Option<f64>,
    /// Newest first.
    kinematics: VecDeque<InterfaceKinematics>,
    /// Length of the last window, s; 0 before it.
    dt: f64,
    secants: VecDeque<Secant>,
    columns: Columns,
    closed: ClosedVolume,
}

impl AddedMassSurrogate {
    /// For a canopy with these faces in the configuration of the `lattice`, at rest in a frame that moves with
    /// `velocity` (m/s), displaced by `displacement` from its unstressed shape, in `air`. Later lattices have at most
    /// `most` groups. `None` where the matrix is singular.
    pub fn new(
        unknowns: Unknowns,
        lattice: &VortexLattice,
        displacement: &[f64],
        velocity: [f64; 3],
        faces: &[[u32; 4]],
        air: Air,
        most: usize,
    ) -> Option<Self> {
        if faces.is_empty() {
            return None;
        }
        let moved = displacement.chunks_exact(3);
        let reference = lattice.positions.iter().zip(moved).map(|(x, d)| x - Vec3::from_column_slice(d));
        let at_rest = velocity.repeat(lattice.positions.len());
        let kinematics =
            VecDeque::from([InterfaceKinematics { displacement: displacement.to_vec(), velocity: at_rest }]);
        Some(Self {
            unknowns,
            faces: faces.to_vec(),
            air,
            most,
            first_order: false,
            reference: reference.collect(),
            assembled_for: (displacement.to_vec(), unknowns.window_s()),
            assembled_normals: lattice.normals.clone(),
            turned_for: None,
            normals: lattice.normals.clone(),
            areas: lattice.areas.clone(),
            groups: lattice.groups.clone(),
            inverse: lattice.inverse.clone(),
            gain: lattice.relaxation.as_ref().map(|(gain, _)| *gain),
            kinematics,
            dt: 0.0,
            secants: VecDeque::new(),
            columns: Columns::default(),
            closed: ClosedVolume::default(),
        })
    }

    /// Updates the surrogate for the present canopy before a window of length `dt`: reassembles the lattice and drops all
    /// secants where the shape or the length of the windows has changed, or updates normals and areas after a rotation.
    /// `None` where nothing has changed by more than the tolerance, also where no better lattice can be assembled.
    pub fn update(&mut self, dt: f64) -> Option<SurrogateUpdate> {
        let areas = self.areas_at(&self.kinematics[0].displacement);
        let normals: Vec<Vec3> = areas.iter().map(direction).collect();
        let longer =
            (dt / self.assembled_for.1 - 1.0).abs() > LENGTH_TOLERANCE && self.air.screening(dt) > 0.0;
        if !longer && self.rotation(&self.normals, &normals) <= ROTATION_TOLERANCE {
            return None;
        }
        let shape = self.kinematics[0].displacement.clone();
        let orientation = self.orientation(areas, normals);
        let unturned: Vec<Vec3> = self.assembled_normals.iter().map(|n| orientation.rotation * n).collect();
        let most = if self.first_order { DEFORMATION_TOLERANCE_IMMERSED } else { DEFORMATION_TOLERANCE };
        if longer || self.rotation(&unturned, &orientation.normals) > most {
            return self.reassemble(shape, dt).map(Box::new).map(SurrogateUpdate::Reassembled);
        }
        Some(SurrogateUpdate::Turned(self.turn(shape, orientation)))
    }

    /// Rotation of normals (root mean square over the groups, rad). Flutter of faces within a group averages out.
    fn rotation(&self, from: &[Vec3], to: &[Vec3]) -> f64 {
        let part =
            |i: usize| self.groups.means(&from.iter().zip(to).map(|(m, n)| n[i] - m[i]).collect::<Vec<_>>());
        let sum: f64 = (0..3).flat_map(part).map(|m| m * m).sum();
        (sum / self.groups.len() as f64).sqrt()
    }

    fn areas_at(&self, displacement: &[f64]) -> Vec<Vec3> {
        let at = self.positions(displacement);
        self.faces.iter().map(|face| quad_area_vector(face.map(|n| at[n as usize]))).collect()
    }

    /// Orientation of a canopy with these faces against the lattice.
    fn orientation(&self, areas: Vec<Vec3>, normals: Vec<Vec3>) -> Orientation {
        let weights: Vec<f64> = areas.iter().map(Vec3::norm).collect();
        Orientation { rotation: best_rotation(&self.assembled_normals, &normals, &weights), areas, normals }
    }

    /// Takes over the normals and areas of a canopy displaced by `shape`.
    fn turn(&mut self, shape: Vec<f64>, orientation: Orientation) -> Orientation {
        self.normals.clone_from(&orientation.normals);
        self.areas.clone_from(&orientation.areas);
        self.turned_for = Some(shape);
        orientation
    }

    /// Assembles the lattice for a displacement of the canopy and a length of windows.
    fn reassemble(&mut self, displacement: Vec<f64>, dt: f64) -> Option<VortexLattice> {
        let _part = timing::part("added mass assembly");
        let at: Vec<mesh::Point> = self.positions(&displacement).into_iter().map(Into::into).collect();
        let screening = self.air.screening(dt);
        let lattice = VortexLattice::with_relaxation(&at, &self.faces, self.most, screening, self.gain)?;
        self.inverse.clone_from(&lattice.inverse);
        self.normals.clone_from(&lattice.normals);
        self.assembled_normals.clone_from(&lattice.normals);
        self.areas.clone_from(&lattice.areas);
        self.groups = lattice.groups.clone();
        self.assembled_for = (displacement, dt);
        self.turned_for = None;
        self.reset();
        Some(lattice)
    }

    fn positions(&self, displacement: &[f64]) -> Vec<Vec3> {
        let moved = self.reference.iter().zip(displacement.chunks_exact(3));
        moved.map(|(x, d)| x + Vec3::from_column_slice(d)).collect()
    }

    /// The same for a flow whose load is the mean over a window, from first-order differences.
    pub fn with_first_order_steps(self) -> Self {
        Self { first_order: true, ..self }
    }

    /// Whether the flow takes first-order differences.
    pub fn is_first_order(&self) -> bool {
        self.first_order
    }

    /// The same with another density: a larger one stabilises schemes that rely on the surrogate alone.
    pub fn with_density(self, density: f64) -> Self {
        Self { air: Air { density, ..self.air }, ..self }
    }

    /// Length of a response.
    pub fn response_len(&self) -> usize {
        self.loads_len() + self.force_axes().len()
    }

    /// Number of loads in a response.
    pub fn loads_len(&self) -> usize {
        self.faces.len() * LOAD_WIDTH
    }

    /// Components of the force on the canopy in a response.
    pub fn force_axes(&self) -> Range<usize> {
        self.unknowns.axes().of_forces()
    }

    /// Coefficients of the backward difference in a window of length `dt`, as in the flow; `None`: first order.
    fn difference(&self, dt: f64) -> Option<[f64; 3]> {
        if self.first_order || self.kinematics.len() < 2 { None } else { channel::bdf2(dt / self.dt) }
    }

    /// Velocity of the nodes relative to the ground at the end of a window, at the unknowns `x`.
    fn velocities(&self, x: &[f64], dt: f64) -> Vec<f64> {
        let frame = self.unknowns.velocity(x, [0.0; 3]);
        let at = self.unknowns.displacement(x);
        let past = |k: usize| &self.kinematics[k].displacement;
        let mut v: Vec<f64> = match self.difference(dt) {
            Some([a, b, c]) => {
                let differences = at.iter().zip(past(0)).zip(past(1));
                differences.map(|((x, x1), x2)| (a * x + b * x1 + c * x2) / dt).collect()
            }
            None => at.iter().zip(past(0)).map(|(x, x1)| (x - x1) / dt).collect(),
        };
        for axis in self.unknowns.axes().range() {
            v[axis..].iter_mut().step_by(3).for_each(|v| *v += frame[axis]);
        }
        v
    }

    /// The added-mass part of the response to the unknowns `x` at the end of a window of length `dt`.
    pub fn added_mass_load(&self, x: &[f64], dt: f64, response: &mut [f64]) {
        self.added_mass_load_of(&self.acceleration(x, dt), response);
    }

    /// Acceleration of the nodes at the unknowns `x` at the end of a window of length `dt`, `[nodes][3]`, m/s2.
    pub fn acceleration(&self, x: &[f64], dt: f64) -> Vec<f64> {
        let v = self.velocities(x, dt);
        let past = |k: usize| &self.kinematics[k].velocity;
        let difference = self.difference(dt);
        let rate = |i: usize| match difference {
            Some([a, b, c]) => (a * v[i] + b * past(0)[i] + c * past(1)[i]) / dt,
            None => (v[i] - past(0)[i]) / dt,
        };
        (0..v.len()).map(rate).collect()
    }

    /// The added-mass part of the response to a [`AddedMassSurrogate::acceleration`].
    pub fn added_mass_load_of(&self, rate: &[f64], response: &mut [f64]) {
        let accelerations = self.faces.iter().zip(&self.normals).map(|(face, normal)| {
            let nodes = distinct(face);
            let sum: f64 = nodes.iter().map(|&n| at(rate, n).dot(normal)).sum();
            sum / nodes.len() as f64
        });
        let accelerations: Vec<f64> = accelerations.collect();
        let means = self.groups.means(&accelerations);
        let jump = self.inverse.apply(&means);
        response.fill(0.0);
        let mut force = Vec3::zeros();
        let faces = accelerations.iter().zip(&self.groups.of).zip(&self.areas);
        for (row, ((acceleration, &g), area)) in response.chunks_exact_mut(LOAD_WIDTH).zip(faces) {
            let g = g as usize;
            row[0] =
                -self.air.density * (jump[g] + self.groups.short_wave_length[g] * (acceleration - means[g]));
            force += area * row[0];
        }
        response[self.loads_len()..].copy_from_slice(&force.as_slice()[self.force_axes()]);
    }

    /// Adds a secant: where [`AddedMassSurrogate::added_mass_load`] changed by `step` within a window, the defect of
    /// the flow's response, whose norm is `load`, changed by `change`. As a function of the surrogate's own load it
    /// does not contain motions that accelerate no air. A step below the fraction `least` of the load adds no secant,
    /// unless the response to it is steep. The pressure of a closed volume, which grew by `volume` (m3), is no part of secants.
    ///
    /// Returns whether the response shows a closed volume that was not known.
    pub fn add_column(
        &mut self,
        step: Vec<f64>,
        volume: f64,
        mut change: Vec<f64>,
        least: f64,
        load: f64,
    ) -> bool {
        let length = norm(&step);
        let is_steep = |change: &[f64]| norm(change) > STEEP_SLOPE * length;
        let finding = if is_steep(&change) {
            self.closed.identify(volume, &change[..self.loads_len()], load)
        } else {
            Finding::Nothing
        };
        if finding != Finding::Nothing {
            self.reset();
        }
        self.add_volume_pressure(-volume, &mut change);
        let (changed, steep) = (norm(&change), is_steep(&change));
        if length == 0.0 || !(steep || length > least * load) {
            return finding == Finding::Closed;
        }
        let signal = if steep { changed } else { length };
        let filter = FILTER.max(NOISE * load / signal);
        self.secants.push_front(Secant { step, change, filter });
        self.secants.truncate(MAX_SECANTS);
        self.refactor();
        finding == Finding::Closed
    }

    /// Fall of the pressure of a closed volume under the canopy over its growth, Pa/m3; 0: none is known.
    pub fn volume_stiffness(&self) -> f64 {
        self.closed.stiffness()
    }

    /// Volume that the canopy sweeps from its unstressed shape to the unknowns `x`, m3. Only differences between two values of one update of the surrogate have a
    /// meaning.
    pub fn swept_volume(&self, x: &[f64]) -> f64 {
        closed_volume::swept(&self.faces, &self.areas, self.unknowns.displacement(x))
    }

    /// The same at the end of the last window.
    pub fn swept_volume_at_start(&self) -> f64 {
        closed_volume::swept(&self.faces, &self.areas, &self.kinematics[0].displacement)
    }

    /// Adds the pressure of a closed volume that grew by `volume` (m3) to `response`.
    pub fn add_volume_pressure(&self, volume: f64, response: &mut [f64]) {
        if self.closed.stiffness() == 0.0 {
            return;
        }
        let pressure = self.closed.pressure(volume);
        let (loads, forces) = response.split_at_mut(self.loads_len());
        loads.iter_mut().step_by(LOAD_WIDTH).for_each(|p| *p += pressure);
        let area: Vec3 = self.areas.iter().sum();
        forces.iter_mut().zip(&area.as_slice()[self.force_axes()]).for_each(|(f, a)| *f += a * pressure);
    }

    /// Whether the pressure of a closed volume follows that volume from window to window.
    pub fn stores_volume(&self) -> bool {
        self.closed.stores()
    }

    /// Compares the loads at both ends of a window that ends with the unknowns `x`, each `[faces][LOAD_WIDTH]` (Pa), with the volume that the canopy swept. Call it
    /// before [`AddedMassSurrogate::accept`].
    pub fn compare_volume(&mut self, x: &[f64], start: &[f64], end: &[f64]) {
        let faces = (end.len() / LOAD_WIDTH) as f64;
        let mean = |load: &[f64]| load.iter().step_by(LOAD_WIDTH).sum::<f64>() / faces;
        let volume = self.swept_volume(x) - self.swept_volume_at_start();
        self.closed.compare(volume, mean(end) - mean(start), norm(end) / faces.sqrt());
    }

    /// Resets what is known of a closed volume.
    pub fn open_volume(&mut self) {
        self.closed = ClosedVolume::default();
    }

    /// Adds to `response` the change of the defect that the secants predict for a `step` of the added-mass load.
    pub fn apply_correction(&self, step: &[f64], response: &mut [f64]) {
        let mut rest = self.without_friction(step);
        for (c, secant) in self.columns.remove(&mut rest).iter().zip(&self.secants) {
            axpy(-c, &secant.change, response);
        }
    }

    /// Drops all secants.
    pub fn reset(&mut self) {
        self.secants.clear();
        self.columns = Columns::default();
    }

    /// Number of secants.
    pub fn secants(&self) -> usize {
        self.secants.len()
    }

    /// A window of length `dt` ended with the grid at the unknowns `x`.
    pub fn accept(&mut self, x: &[f64], dt: f64) {
        let velocity = self.velocities(x, dt);
        let displacement = self.unknowns.displacement(x).to_vec();
        self.kinematics.push_front(InterfaceKinematics { displacement, velocity });
        self.kinematics.truncate(2);
        self.dt = dt;
    }

    /// State that later windows depend on.
    pub fn save_state(&self) -> Vec<u8> {
        pack(&(&self.kinematics, self.dt, &self.secants, &self.assembled_for, &self.turned_for, self.closed))
    }

    /// Restores a [`AddedMassSurrogate::save_state`] of the same canopy. Returns how the surrogate changed, in order.
    ///
    /// # Errors
    /// The state of another canopy or scheme.
    pub fn restore_state(&mut self, saved: &[u8]) -> Result<Vec<SurrogateUpdate>, RunError> {
        let (kinematics, dt, secants, assembled_for, turned_for, closed): SavedState = unpack(saved)?;
        self.closed = closed;
        let (shape, length) = assembled_for;
        let mut updates = Vec::new();
        if (&shape, length) != (&self.assembled_for.0, self.assembled_for.1) || self.turned_for.is_some() {
            updates.extend(self.reassemble(shape, length).map(Box::new).map(SurrogateUpdate::Reassembled));
        }
        if let Some(shape) = turned_for {
            let areas = self.areas_at(&shape);
            let normals = areas.iter().map(direction).collect();
            let orientation = self.orientation(areas, normals);
            updates.push(SurrogateUpdate::Turned(self.turn(shape, orientation)));
        }
        (self.kinematics, self.dt, self.secants) = (kinematics, dt, secants);
        // The saved secants pass the filter again and give the same factors.
        self.refactor();
        Ok(updates)
    }

    fn refactor(&mut self) {
        let (mut columns, mut secants) = (Columns::default(), std::mem::take(&mut self.secants));
        secants.retain(|secant| columns.push(&self.without_friction(&secant.step), secant.filter));
        (self.columns, self.secants) = (columns, secants);
    }

    /// Pressures and forces of a response: an added-mass load has nothing else.
    fn without_friction(&self, response: &[f64]) -> Vec<f64> {
        let (loads, forces) = response.split_at(self.loads_len());
        loads.iter().step_by(LOAD_WIDTH).chain(forces).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame_axes::FrameAxes;
    use crate::schemes::test_support::plate;

    const CELLS: usize = 24;

    /// Loads and force on a plate of side 1 that is accelerated from rest to the velocity `motion` (m/s, upwards) of
    /// each point.
    fn impulsive_load(most: usize, motion: impl Fn(&mesh::Point) -> f64) -> Vec<f64> {
        let (positions, faces) = plate(CELLS);
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::None);
        let rest = vec![0.0; 3 * positions.len()];
        let lattice = VortexLattice::new(&positions, &faces, most, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let model =
            AddedMassSurrogate::new(unknowns, &lattice, &rest, [0.0; 3], &faces, air, most).expect("a plate");
        let x: Vec<f64> = positions.iter().flat_map(|p| [0.0, 0.0, motion(p)]).collect();
        let mut response = vec![0.0; model.response_len()];
        model.added_mass_load(&x, 1.0, &mut response);
        response
    }

    /// Difference of two responses' pressures, relative to the second.
    fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
        let of = |x: &[f64]| -> Vec<f64> { x.chunks_exact(LOAD_WIDTH).map(|row| row[0]).collect() };
        let (a, b) = (of(a), of(b));
        let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
        norm(&difference) / norm(&b)
    }

    #[test]
    fn one_face_per_group_changes_nothing() {
        let motion = |p: &mesh::Point| (9.0 * p[0]).sin() * p[1];
        assert_eq!(impulsive_load(CELLS * CELLS, motion), impulsive_load(usize::MAX, motion));
    }

    #[test]
    fn groups_reproduce_the_added_mass_of_rigid_motions() {
        let last = CELLS * CELLS * LOAD_WIDTH;
        for (name, motion) in [
            ("plunge", (|_: &mesh::Point| 1.0) as fn(&mesh::Point) -> f64),
            ("tilt", |p: &mesh::Point| p[0] - 0.5),
        ] {
            let exact = impulsive_load(usize::MAX, motion);
            for most in [CELLS * CELLS / 2, CELLS * CELLS / 4, CELLS * CELLS / 8] {
                let grouped = impulsive_load(most, motion);
                let (force, relative_difference) =
                    (grouped[last] / exact[last] - 1.0, relative_difference(&grouped, &exact));
                println!("{name}, {most} groups: force {force:+.3}, pressures {relative_difference:.3}");
                // Pressures have square-root behaviour at the edges, within a part of a group.
                assert!(relative_difference < 0.2, "{name}, {most} groups: {relative_difference}");
                assert!(name == "tilt" || force.abs() < 0.12, "{most} groups: {force}");
            }
        }
    }

    #[test]
    fn motion_within_groups_has_the_added_mass_of_short_waves() {
        // Alternating neighbours: the mean over groups of four vanishes, and their faces get the added mass of a wave
        // of twice their own length, 2 rho / k = H / pi; the exact wave is sqrt(2) shorter.
        let checks = |p: &mesh::Point| ((p[0] + p[1]) * CELLS as f64 * std::f64::consts::FRAC_PI_2).sin();
        let (exact, grouped) =
            (impulsive_load(usize::MAX, checks), impulsive_load(CELLS * CELLS / 4, checks));
        let relative_difference = relative_difference(&grouped, &exact);
        println!("short waves: {relative_difference:.3}");
        assert!(relative_difference < 0.6, "{relative_difference}");
    }

    /// Air in a closed volume responds steeply to a small step: that secant is added where it exceeds the flow's
    /// noise. Small steps with a weak response add none.
    /// A plate over a closed volume: the first response of one pressure gives the stiffness, whatever motion follows has the pressure of its volume, secants have
    /// none of it, and the saved state knows it.
    #[test]
    fn a_closed_volume_is_identified_by_its_first_response() {
        let (positions, faces) = plate(CELLS);
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::Vertical);
        let rest = vec![0.0; 3 * positions.len()];
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let new = || {
            AddedMassSurrogate::new(unknowns, &lattice, &rest, [0.0; 3], &faces, air, usize::MAX)
                .expect("a plate")
        };
        let mut model = new();
        let x: Vec<f64> =
            positions.iter().flat_map(|p| [0.0, 0.0, 1e-4 + 2e-4 * p[0]]).chain([0.0]).collect();
        let volume = model.swept_volume(&x);
        assert!((volume - 2e-4).abs() < 1e-12, "{volume}");
        assert_eq!(model.swept_volume_at_start(), 0.0);
        let (stiffness, mut response) = (2e5, vec![0.0; model.response_len()]);
        model.add_volume_pressure(volume, &mut response);
        assert!(response.iter().all(|p| *p == 0.0), "open air has none");
        let mut change = vec![0.0; response.len()];
        change[..model.loads_len()].iter_mut().step_by(LOAD_WIDTH).for_each(|p| *p = -stiffness * volume);
        change[model.loads_len()] = -stiffness * volume;
        let mut step = vec![0.0; response.len()];
        step[0] = 1e-3;
        assert!(model.add_column(step.clone(), volume, change.clone(), 1e-3, 1.0), "not known before");
        assert!((model.volume_stiffness() / stiffness - 1.0).abs() < 1e-12);
        assert!(!model.add_column(step.clone(), volume, change, 1e-3, 1.0), "known");
        let mut corrected = vec![0.0; response.len()];
        model.apply_correction(&step, &mut corrected);
        assert!(norm(&corrected) < 1e-9, "a secant has the pressure of the volume: {}", norm(&corrected));
        model.add_volume_pressure(3e-5, &mut response);
        assert!((response[4] + 6.0).abs() < 1e-9 && (response[model.loads_len()] + 6.0).abs() < 1e-9);
        // A window that ends at `x` with the pressure of its volume, and one that ends without it.
        let (start, mut end) = (vec![0.0; model.loads_len()], vec![0.0; model.loads_len()]);
        model.compare_volume(&x, &start, &end);
        assert!(!model.stores_volume());
        end.iter_mut().step_by(LOAD_WIDTH).for_each(|p| *p = -0.7 * stiffness * volume);
        model.compare_volume(&x, &start, &end);
        assert!(model.stores_volume());
        model.compare_volume(&x, &end, &start);
        assert!(!model.stores_volume(), "the pressure rises");
        model.accept(&x, 1.0);
        assert!((model.swept_volume_at_start() - volume).abs() < 1e-15);
        let mut again = new();
        again.restore_state(&model.save_state()).expect("its state");
        assert_eq!(again.volume_stiffness(), model.volume_stiffness());
        model.open_volume();
        assert_eq!(model.volume_stiffness(), 0.0);
    }

    #[test]
    fn small_steps_add_secants_only_for_steep_responses() {
        let (positions, faces) = plate(4);
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::None);
        let rest = vec![0.0; 3 * positions.len()];
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let (least, load, step) = (1e-3, 10.0, 1e-4);
        for (slope, added) in [(0.5, 0), (0.9 * STEEP_SLOPE, 0), (1.1 * STEEP_SLOPE, 0), (50.0, 1)] {
            let mut model =
                AddedMassSurrogate::new(unknowns, &lattice, &rest, [0.0; 3], &faces, air, usize::MAX)
                    .expect("a plate");
            let along = |length: f64| {
                let mut vector = vec![0.0; model.response_len()];
                vector[0] = length;
                vector
            };
            let (once, twice, changed) = (along(step), along(2.0 * step), along(slope * step));
            model.add_column(once, 0.0, changed, least, load);
            assert_eq!(model.secants(), added, "slope {slope}");
            let mut response = vec![0.0; model.response_len()];
            model.apply_correction(&twice, &mut response);
            let expected = if added == 1 { 2.0 * slope * step } else { 0.0 };
            assert!((response[0] - expected).abs() < 1e-12, "slope {slope}: {}", response[0]);
        }
    }

    /// The first window has the first-order difference; later ones are exact for parabolas over unequal windows.
    #[test]
    fn velocities_are_exact_for_parabolas_and_positions_for_any_start() {
        let (positions, faces) = plate(4);
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::None);
        let start: Vec<f64> = (0..3 * positions.len()).map(|i| 0.1 * (i as f64).sin()).collect();
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let mut model =
            AddedMassSurrogate::new(unknowns, &lattice, &start, [0.0; 3], &faces, air, usize::MAX)
                .expect("a plate");
        let at = |t: f64| -> Vec<f64> {
            start.iter().enumerate().map(|(i, s)| s + (1.0 + i as f64) * t - 2.0 * t * t).collect()
        };
        let compare = |found: Vec<f64>, expected: &dyn Fn(usize) -> f64| {
            for (i, f) in found.iter().enumerate() {
                assert!((f - expected(i)).abs() < 1e-11, "{i}: {f} {}", expected(i));
            }
        };
        compare(model.velocities(&at(0.5), 0.5), &|i| 1.0 + i as f64 - 2.0 * 0.5);
        model.accept(&at(0.5), 0.5);
        compare(model.velocities(&at(0.9), 0.4), &|i| 1.0 + i as f64 - 4.0 * 0.9);
        compare(model.velocities(&at(1.4), 0.9), &|i| 1.0 + i as f64 - 4.0 * 1.4);
        let moved = model.positions(&at(0.5));
        compare(moved.iter().flatten().copied().collect(), &|i| {
            positions[i / 3][i % 3] + 0.5 * (1.0 + i as f64) - 0.5
        });
    }

    type Faces = Vec<[u32; 4]>;

    /// A bent canopy, and the displacement that rotates it about the x-axis by `angle` and then bends it by `more`.
    fn bent() -> (Vec<mesh::Point>, Faces, impl Fn(f64, f64) -> Vec<f64>) {
        let (mut positions, faces) = plate(8);
        positions
            .iter_mut()
            .for_each(|x| x[2] = 0.4 * (1.0 - (x[0] - 0.5).powi(2) - 0.7 * (x[1] - 0.3).powi(2)));
        let start = positions.clone();
        let moved = move |angle: f64, more: f64| -> Vec<f64> {
            let (s, c) = angle.sin_cos();
            let to = |x: &mesh::Point| {
                [0.0, (c - 1.0) * x[1] - s * x[2], s * x[1] + (c - 1.0) * x[2] + more * x[0] * x[0]]
            };
            start.iter().flat_map(to).collect()
        };
        (positions, faces, moved)
    }

    fn surrogate(positions: &[mesh::Point], faces: &[[u32; 4]]) -> AddedMassSurrogate {
        let unknowns = Unknowns::new(positions.len(), 1.0, FrameAxes::None);
        let lattice = VortexLattice::new(positions, faces, usize::MAX, 0.0).expect("a plate");
        let rest = vec![0.0; 3 * positions.len()];
        let air = Air::incompressible(1.2);
        AddedMassSurrogate::new(unknowns, &lattice, &rest, [0.0; 3], faces, air, usize::MAX).expect("a plate")
    }

    /// A rotation is followed without a new matrix and without losing secants: the loads are those of a surrogate that was assembled for the rotated canopy. Another
    /// shape needs a new matrix. What was saved after either is restored.
    #[test]
    fn rotation_of_the_whole_canopy_needs_no_new_lattice() {
        let (positions, faces, moved) = bent();
        let mut model = surrogate(&positions, &faces);
        let step = vec![1.0; model.response_len()];
        model.add_column(step.clone(), 0.0, step, 1e-3, 1.0);
        model.accept(&moved(0.6 * ROTATION_TOLERANCE, 0.0), 0.1);
        assert!(model.update(0.1).is_none());
        for angle in [0.3, 1.1, 2.9] {
            model.accept(&moved(angle, 0.0), 0.1);
            assert!(matches!(model.update(0.1), Some(SurrogateUpdate::Turned(_))), "{angle}");
            assert!(model.update(0.1).is_none());
            let turned: Vec<mesh::Point> = positions
                .iter()
                .zip(moved(angle, 0.0).chunks_exact(3))
                .map(|(x, d)| [x[0] + d[0], x[1] + d[1], x[2] + d[2]])
                .collect();
            let fresh = surrogate(&turned, &faces);
            let rate: Vec<f64> = (0..3 * positions.len()).map(|i| (0.7 * i as f64).sin() + 0.3).collect();
            let mut loads = [vec![0.0; model.response_len()], vec![0.0; model.response_len()]];
            model.added_mass_load_of(&rate, &mut loads[0]);
            fresh.added_mass_load_of(&rate, &mut loads[1]);
            let error: Vec<f64> = loads[0].iter().zip(&loads[1]).map(|(a, b)| a - b).collect();
            // Both inverses are in single precision.
            assert!(
                norm(&error) < 1e-5 * norm(&loads[1]),
                "{angle}: {} of {}",
                norm(&error),
                norm(&loads[1])
            );
        }
        assert_eq!(model.secants(), 1);
        let saved = model.save_state();
        let mut other = surrogate(&positions, &faces);
        let updates = other.restore_state(&saved).expect("its state");
        assert!(matches!(updates[..], [SurrogateUpdate::Turned(_)]));
        assert_eq!((&other.normals, &other.areas), (&model.normals, &model.areas));
        assert_eq!(other.save_state(), saved);

        // Normals deviate by 0.3 times the bend.
        model.accept(&moved(2.9, 2.0 * DEFORMATION_TOLERANCE), 0.1);
        assert!(matches!(model.update(0.1), Some(SurrogateUpdate::Turned(_))));
        model.accept(&moved(2.9, 5.0 * DEFORMATION_TOLERANCE), 0.1);
        assert!(matches!(model.update(0.1), Some(SurrogateUpdate::Reassembled(_))));
        assert_eq!(model.secants(), 0);
        let updates = other.restore_state(&model.save_state()).expect("its state");
        assert!(matches!(updates[..], [SurrogateUpdate::Reassembled(_)]));
        assert_eq!((&other.normals, &other.areas), (&model.normals, &model.areas));
    }
}
