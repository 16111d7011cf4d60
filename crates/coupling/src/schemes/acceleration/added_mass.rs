//! Relaxation by the added mass of potential flow.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::relaxation::Relaxation;
use crate::geometry::{Vec3, at, direction, distinct};
use crate::schemes::surrogate::inverse::ShortMatrix;
use crate::schemes::surrogate::orientation::Orientation;
use crate::schemes::surrogate::panel_groups::PanelGroups;
use crate::schemes::surrogate::vortex_lattice::{Air, VortexLattice};
use crate::schemes::unknowns::Unknowns;

/// Determinant of the frame's equation below which it is not solved: that of a frame without air is 1.
const LEAST_DETERMINANT: f64 = 0.1;

/// Masses and response that determine the added-mass effect, for [`AddedMassRelaxation::new`].
#[derive(Clone, Copy, Debug)]
pub struct MassProperties {
    /// Mass of the fabric per area, kg/m2.
    pub fabric_kg_m2: f64,
    /// The air.
    pub air: Air,
    /// Displacement at the end of a window, in $`\Delta t^2/m`$, per pressure at its end: half the weight of that
    /// pressure in the load over the substeps.
    pub response: f64,
    /// Leading coefficient $`a`$ of the flow's difference over a window: 3/2 for BDF2, 1 for first order.
    pub difference: f64,
    /// Falling mass, kg; 0 without descent.
    pub falling_kg: f64,
}

impl MassProperties {
    /// The gain $`g`$ of [`AddedMassRelaxation`], 1/m.
    pub fn gain(&self) -> f64 {
        self.difference.powi(2) * self.response * self.air.density / self.fabric_kg_m2
    }
}

/// Relaxation by the added mass of potential flow.
///
/// The flow responds to a normal displacement of the canopy with the pressure of the accelerated air. In potential
/// flow the jump of the potential over a thin
/// surface is the strength $`\Gamma`$ of a sheet of vortex rings; with the normal
/// velocities $`A\Gamma`$ that rings of unit strength induce at the faces, the
/// added mass per area is $`\rho A^{-1}`$ for any wave length and any outline with
/// its vents. A window turns a change $`\delta x`$ of the iterate into
/// $`-G\,\delta x`$, $`G = g A^{-1}`$, with
///
/// ```math
/// g = a^2\, s\, \rho / m''
/// ```
///
/// ($`a^2`$: differences of velocities that are differences, $`a = \tfrac32`$ with BDF2 and 1 with first order; $`s`$: `response`; $`m''`$: fabric per
/// area; stiffness is neglected, which only adds damping). So the residual $`r`$ requires
/// the step $`e = (I+G)^{-1} r = (A+gI)^{-1}A\,r`$ along the normals. Tangential
/// motion moves no air: there the full residual is the step.
///
/// The motion $`V`$ of the frame in its axes (velocity times $`\Delta t`$) accelerates the same air, and the air's force
/// accelerates the frame: with the normals $`N`$ and area vectors $`a`$ of the faces in these axes and
/// $`B = \rho A^{-T} a / M`$, both are solved together,
///
/// ```math
/// \delta x + G\,\delta x + \tfrac1a G N\,\delta V = r, \qquad
/// \delta V + B^T(a^2\,\delta x + a N\,\delta V) = r_V.
/// ```
///
/// (Solved separately, the two would converge with a factor of 0.9 only.)
#[derive(Clone)]
pub struct AddedMassRelaxation {
    unknowns: Unknowns,
    masses: MassProperties,
    faces: Vec<[u32; 4]>,
    face_normals: Vec<Vec3>,
    node_normals: Vec<Vec3>,
    /// Faces at each node.
    node_faces: Vec<f64>,
    groups: PanelGroups,
    /// g and $`(I + G)^{-1}`$.
    gain: f64,
    relaxation: ShortMatrix,
    /// Step per residual for waves shorter than the faces resolve.
    short_wave_factor: f64,
    /// Normals of the groups n, $`\rho A^{-T} a`$ of their area vectors a, and $`(I+G)^{-1} G n`$: `[groups][3]` in the
    /// axes of the lattice.
    group_normals: DMatrix<f64>,
    group_forces: DMatrix<f64>,
    relaxed_normals: DMatrix<f64>,
    /// B and Q = (I+G)^-1 G N, `[groups][axes]`, and the inverse of the matrix of V once x is eliminated.
    force: DMatrix<f64>,
    relaxed: DMatrix<f64>,
    frame_inverse: DMatrix<f64>,
    /// Added mass of the whole canopy in vertical motion, kg.
    pub vertical_added_mass: f64,
    /// Swept volume over the displacement of each node, m2.
    volume_gradient: Vec<Vec3>,
    /// Step for the displacement that one pressure makes, and that displacement over the swept volume of which the pressure is; `None`: no volume is closed.
    closed: Option<(Vec<f64>, f64)>,
}

impl AddedMassRelaxation {
    /// For a canopy with these faces in the configuration of the `lattice`. `None` where its matrix is not usable.
    pub fn new(
        unknowns: Unknowns,
        faces: &[[u32; 4]],
        masses: &MassProperties,
        lattice: &VortexLattice,
    ) -> Option<Self> {
        if faces.is_empty() || masses.fabric_kg_m2 <= 0.0 {
            return None;
        }
        let VortexLattice { positions, areas, normals, groups, influence, inverse, relaxation, .. } = lattice;
        let n = groups.len();
        let sizes: Vec<f64> = areas.iter().map(Vec3::norm).collect();
        let gain = masses.gain();
        let relaxation = match relaxation {
            Some((of, relaxation)) if *of == gain => relaxation.clone(),
            _ => ShortMatrix::relaxation(influence, gain)?,
        };
        let mut node_faces = vec![0.0; positions.len()];
        faces.iter().flat_map(distinct).for_each(|&node| node_faces[node as usize] += 1.0);
        // Force of the air per acceleration of the faces along their normals, in each axis.
        let mut outwards = DMatrix::zeros(n, 3);
        for (area, &g) in areas.iter().zip(&groups.of) {
            (0..3).for_each(|i| outwards[(g as usize, i)] += masses.air.density * area[i]);
        }
        let forces = |i: usize| DVector::from_vec(inverse.apply_transposed(outwards.column(i).as_slice()));
        let means = |i: usize| groups.means(&normals.iter().map(|normal| normal[i]).collect::<Vec<_>>());
        let group_normals = DMatrix::from_columns(&[0, 1, 2].map(|i| DVector::from_vec(means(i))));
        let relaxed = |i: usize| {
            let normals = group_normals.column(i).into_owned();
            &normals - DVector::from_vec(relaxation.apply(normals.as_slice()))
        };
        // A zigzag between nodes has twice the face as wave length: A is pi/2 over its edge.
        let edge = (sizes.iter().sum::<f64>() / faces.len() as f64).sqrt();
        let zigzag = 0.5 * std::f64::consts::PI / edge;
        let short_wave_factor = zigzag / (zigzag + gain);
        let mut model = Self {
            unknowns,
            masses: *masses,
            faces: faces.to_vec(),
            face_normals: Vec::new(),
            node_normals: vec![Vec3::zeros(); positions.len()],
            node_faces,
            groups: groups.clone(),
            gain,
            short_wave_factor,
            relaxed_normals: DMatrix::from_columns(&[0, 1, 2].map(relaxed)),
            group_normals,
            group_forces: DMatrix::from_columns(&[0, 1, 2].map(forces)),
            relaxation,
            force: DMatrix::zeros(n, 0),
            relaxed: DMatrix::zeros(n, 0),
            frame_inverse: DMatrix::zeros(0, 0),
            vertical_added_mass: 0.0,
            volume_gradient: vec![Vec3::zeros(); positions.len()],
            closed: None,
        };
        let usable = model.orient(&Matrix3::identity(), areas, normals);
        usable.then_some(model)
    }

    /// Sets normals and the terms of the frame: its `rotation` against the lattice, areas and normals of the faces. Whether
    /// the frame's equation can be solved.
    fn orient(&mut self, rotation: &Matrix3<f64>, areas: &[Vec3], normals: &[Vec3]) -> bool {
        self.face_normals = normals.to_vec();
        self.node_normals.fill(Vec3::zeros());
        self.volume_gradient.fill(Vec3::zeros());
        for (face, area) in self.faces.iter().zip(areas) {
            let nodes = distinct(face);
            for &node in nodes {
                self.node_normals[node as usize] += area;
                self.volume_gradient[node as usize] += area / nodes.len() as f64;
            }
        }
        self.node_normals.iter_mut().for_each(|normal| *normal = direction(normal));
        let up = rotation.row(2).transpose();
        self.vertical_added_mass = (&self.group_forces * up).dot(&(&self.group_normals * up));
        let axes: Vec<_> = self.unknowns.axes().range().map(|axis| rotation.row(axis).transpose()).collect();
        let along = |vectors: &DMatrix<f64>| {
            DMatrix::from_fn(vectors.nrows(), axes.len(), |g, k| vectors.row(g).dot(&axes[k].transpose()))
        };
        let falling_kg = self.masses.falling_kg;
        let inverse_mass = if falling_kg > 0.0 { 1.0 / falling_kg } else { 0.0 };
        self.force = along(&self.group_forces) * inverse_mass;
        self.relaxed = along(&self.relaxed_normals);
        let matrix = DMatrix::identity(axes.len(), axes.len())
            + self.force.transpose() * (along(&self.group_normals) - &self.relaxed) * self.masses.difference;
        let solvable = self.vertical_added_mass.is_finite() && matrix.determinant() > LEAST_DETERMINANT;
        self.frame_inverse = matrix
            .try_inverse()
            .filter(|_| solvable)
            .unwrap_or_else(|| DMatrix::identity(axes.len(), axes.len()));
        solvable
    }
}

impl AddedMassRelaxation {
    /// Normal steps of the groups and step of the frame for their residuals $`r`$ and $`r_V`$, by elimination of
    /// $`\delta x`$.
    fn solve(&self, r: &DVector<f64>, r_v: DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let mut normal_steps = DVector::from_vec(self.relaxation.apply(r.as_slice()));
        let a = self.masses.difference;
        let frame = &self.frame_inverse * (r_v - self.force.tr_mul(&normal_steps) * a.powi(2));
        normal_steps.gemv(-1.0 / a, &self.relaxed, &frame, 1.0);
        (normal_steps, frame)
    }

    pub(crate) fn faces(&self) -> &[[u32; 4]] {
        &self.faces
    }

    pub(crate) fn face_normals(&self) -> &[Vec3] {
        &self.face_normals
    }

    /// Faces at a node, at least one.
    pub(crate) fn faces_at(&self, node: u32) -> f64 {
        self.node_faces[node as usize].max(1.0)
    }
}

impl Relaxation for AddedMassRelaxation {
    fn reshape(&mut self, lattice: &VortexLattice) {
        // Keeps the old operator where the new shape gives no usable matrix.
        if let Some(new) = Self::new(self.unknowns, &self.faces, &self.masses, lattice) {
            *self = new;
        }
    }

    fn turn(&mut self, orientation: &Orientation) {
        self.orient(&orientation.rotation, &orientation.areas, &orientation.normals);
    }

    fn stiffen(&mut self, volume_stiffness: f64, dt: f64) {
        self.closed = None;
        if volume_stiffness > 0.0 {
            let mut unit: Vec<f64> = self.node_normals.iter().flat_map(|n| [n.x, n.y, n.z]).collect();
            unit.resize(self.unknowns.len(), 0.0);
            let mut relaxed = vec![0.0; unit.len()];
            self.apply(&unit, &mut relaxed);
            let by_pressure = self.masses.response * dt * dt / self.masses.fabric_kg_m2;
            self.closed = Some((relaxed, by_pressure * volume_stiffness));
        }
    }

    fn apply(&self, residual: &[f64], step: &mut [f64]) {
        // Normal residual at the faces, and the corresponding step.
        let on_faces: Vec<f64> = self
            .faces
            .iter()
            .zip(&self.face_normals)
            .map(|(face, normal)| {
                let nodes = distinct(face);
                nodes.iter().map(|&n| at(residual, n).dot(normal)).sum::<f64>() / nodes.len() as f64
            })
            .collect();
        let means = DVector::from_vec(self.groups.means(&on_faces));
        // The frame's motion in the unit of displacements.
        let scale = (self.unknowns.displacements() as f64 / 3.0).sqrt();
        let places = self.unknowns.velocities();
        let frame = DVector::from_column_slice(&residual[places.clone()]) / scale;
        let (normal_steps, frame) = self.solve(&means, frame);
        step[places].copy_from_slice((frame * scale).as_slice());
        // Back to the nodes, as means over their faces: [residual, step].
        let mut nodes = vec![[0.0; 2]; self.node_normals.len()];
        for ((face, &g), normal_residual) in self.faces.iter().zip(&self.groups.of).zip(&on_faces) {
            let g = g as usize;
            // Deviations of a face from its group get the step of a short wave.
            let step = normal_steps[g]
                + (normal_residual - means[g]) / (1.0 + self.gain * self.groups.short_wave_length[g]);
            for &node in distinct(face) {
                nodes[node as usize][0] += normal_residual;
                nodes[node as usize][1] += step;
            }
        }
        for (node, [normal_residual, normal_steps]) in nodes.iter().enumerate() {
            let (normal, count) = (self.node_normals[node], self.node_faces[node].max(1.0));
            let whole = at(residual, node as u32);
            let along = whole.dot(&normal);
            let normal_step =
                normal_steps / count + self.short_wave_factor * (along - normal_residual / count);
            step[3 * node..3 * node + 3].copy_from_slice((whole + normal * (normal_step - along)).as_slice());
        }
        self.limit_volume(residual, step);
    }
}

impl AddedMassRelaxation {
    /// Takes from a step the volume that the air of a closed volume does not give. With $`u`$ the displacement by one pressure, $`v`$ the gradient of the swept volume and
    /// $`\kappa`$ the displacement over that volume the step is $`(I + G + \kappa u v^T)^{-1} r`$, by Sherman and Morrison. Nodes without a residual are held.
    fn limit_volume(&self, residual: &[f64], step: &mut [f64]) {
        let Some((relaxed, gain)) = &self.closed else { return };
        let free = |n: &usize| at(residual, *n as u32) != Vec3::zeros();
        let nodes = 0..self.volume_gradient.len();
        let swept = |by: &[f64], n: usize| self.volume_gradient[n].dot(&at(by, n as u32));
        let volume: f64 = nodes.clone().map(|n| swept(step, n)).sum();
        let given: f64 = nodes.clone().filter(free).map(|n| swept(relaxed, n)).sum();
        let factor = gain * volume / (1.0 + gain * given);
        for n in nodes.filter(free) {
            (3 * n..3 * n + 3).for_each(|i| step[i] -= factor * relaxed[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::frame_axes::FrameAxes;
    use crate::schemes::test_support::plate;

    fn masses() -> MassProperties {
        MassProperties {
            fabric_kg_m2: 0.0373,
            air: Air::incompressible(1.0),
            response: 0.275,
            difference: 1.5,
            falling_kg: 1.0,
        }
    }

    fn model(n: usize) -> (AddedMassRelaxation, Vec<mesh::Point>) {
        grouped(n, usize::MAX)
    }

    fn grouped(n: usize, most: usize) -> (AddedMassRelaxation, Vec<mesh::Point>) {
        let (positions, faces) = plate(n);
        let unknowns = Unknowns::new(positions.len(), 5e-3, FrameAxes::Vertical);
        let lattice = VortexLattice::new(&positions, &faces, most, 0.0).unwrap();
        (AddedMassRelaxation::new(unknowns, &faces, &masses(), &lattice).unwrap(), positions)
    }

    #[test]
    fn added_mass_of_a_square_plate_matches_dnv_c205() {
        // DNV-RP-C205, table D-2: 0.579 rho pi/4 for a square of side 1 moving along its normal.
        for (n, most) in [(5, 0.06), (10, 0.02), (20, 0.01), (40, 0.01)] {
            let error = model(n).0.vertical_added_mass / (0.579 * std::f64::consts::FRAC_PI_4) - 1.0;
            println!("{n} faces a side: {error:+.4}");
            assert!(error.abs() < most, "{n} faces a side: {error}");
        }
    }

    #[test]
    fn grouped_faces_keep_the_added_mass() {
        // Groups of two by two faces.
        let (fine, groups) = (model(20).0, grouped(20, 100).0);
        let error = groups.vertical_added_mass / fine.vertical_added_mass - 1.0;
        println!("added mass of groups of four: {error:+.3}");
        assert!(error.abs() < 0.1, "{error}");
    }

    #[test]
    fn tangential_steps_are_full_and_normal_steps_are_reduced() {
        let (model, positions) = model(16);
        let mut residual = vec![0.0; 3 * positions.len() + 1];
        residual.chunks_exact_mut(3).for_each(|r| r.copy_from_slice(&[1.0, 0.0, 1.0]));
        let mut step = vec![0.0; residual.len()];
        model.apply(&residual, &mut step);
        let middle = 3 * (positions.len() / 2);
        assert!((step[middle] - 1.0).abs() < 1e-12);
        assert!(step[middle + 2] > 0.01 && step[middle + 2] < 0.2, "{}", step[middle + 2]);
    }

    /// Residuals of a motion of the faces with a change of the frame's velocity, from the equations of the model around a
    /// bent canopy: the solution is both.
    #[test]
    fn inverts_its_linear_model_of_flow_and_frame() {
        let (mut positions, faces) = plate(12);
        positions.iter_mut().for_each(|x| x[2] = 0.5 * (x[0] - 0.4).powi(2) + 0.6 * x[0] * x[1]);
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).unwrap();
        let influence = lattice.influence.clone().lu();
        let cases = [FrameAxes::None, FrameAxes::Vertical, FrameAxes::All].map(|axes| (axes, 1.5));
        for (axes, a) in cases.into_iter().chain([(FrameAxes::All, 1.0)]) {
            let unknowns = Unknowns::new(positions.len(), 5e-3, axes);
            let masses = MassProperties { difference: a, ..masses() };
            let model = AddedMassRelaxation::new(unknowns, &faces, &masses, &lattice).unwrap();
            let dx = DVector::from_fn(faces.len(), |i, _| 0.3 + 0.1 * (i as f64).sin());
            let dv = DVector::from_fn(axes.len(), |i, _| -0.2 + 0.15 * i as f64);
            let along =
                DMatrix::from_fn(faces.len(), axes.len(), |f, k| lattice.normals[f][axes.range().start + k]);
            let moved = &dx * (a * a) + &along * &dv * a;
            let r = &dx + influence.solve(&moved).unwrap() * (0.275 / 0.0373);
            // Force of the air per acceleration over the mass of 1 kg: area vectors times the pressure jumps.
            let jumps = influence.solve(&moved).unwrap();
            let force =
                |axis: usize| lattice.areas.iter().zip(jumps.iter()).map(|(a, p)| a[axis] * p).sum::<f64>();
            let r_v = &dv + DVector::from_iterator(axes.len(), axes.range().map(force));
            let (found, frame) = model.solve(&r, r_v);
            let errors = [(frame - &dv).norm(), (found - &dx).norm() / dx.norm()];
            println!("{axes:?}: {errors:?}");
            // Each of 144 numbers of a row is off by a unit of 16 bits at most (`ShortMatrix`), and the residual is 15 times the motion.
            assert!(errors.iter().all(|e| *e < 3e-4), "{axes:?}: {errors:?}");
        }
    }

    /// The relaxation that comes with a lattice is the one that is computed alone, and serves no other gain.
    #[test]
    fn relaxation_of_a_lattice_is_that_of_its_gain() {
        let (positions, faces) = plate(8);
        let unknowns = Unknowns::new(positions.len(), 5e-3, FrameAxes::Vertical);
        let heavy = MassProperties { fabric_kg_m2: 0.4, ..masses() };
        let r: Vec<f64> = (0..unknowns.len()).map(|i| (0.37 * i as f64).sin()).collect();
        let steps = [None, Some(masses().gain())].map(|gain| {
            let lattice = VortexLattice::with_relaxation(&positions, &faces, usize::MAX, 0.0, gain).unwrap();
            assert_eq!(lattice.relaxation.as_ref().map(|(gain, _)| *gain), gain);
            [masses(), heavy].map(|masses| {
                let model = AddedMassRelaxation::new(unknowns, &faces, &masses, &lattice).unwrap();
                let mut step = vec![0.0; r.len()];
                model.apply(&r, &mut step);
                step
            })
        });
        assert_eq!(steps[0], steps[1]);
        assert_ne!(steps[0][0], steps[0][1]);
    }

    /// A closed volume: the step is what is left of that in the open less what the pressure of its own swept volume gives, nodes of the rim stay, and a stiff volume is kept.
    #[test]
    fn a_closed_volume_gives_no_more_than_its_pressure_asks_for() {
        let (mut model, positions) = model(12);
        let held = |n: usize| {
            let [x, y, _] = positions[n];
            [x, y].iter().any(|c| *c < 1e-9 || *c > 1.0 - 1e-9)
        };
        assert!((0..positions.len()).any(held) && !(0..positions.len()).all(held));
        let mut residual = vec![0.0; 3 * positions.len() + 1];
        for n in (0..positions.len()).filter(|n| !held(*n)) {
            residual[3 * n..3 * n + 3].copy_from_slice(&[0.1, -0.2, 0.3 + (0.7 * n as f64).sin()]);
        }
        let mut open = vec![0.0; residual.len()];
        model.apply(&residual, &mut open);
        let (dt, share) = (0.02, 0.275 / 0.0373);
        let volume = |by: &[f64]| -> f64 {
            let faces = plate(12).1;
            let area = vec![Vec3::new(0.0, 0.0, 1.0 / 144.0); faces.len()];
            crate::schemes::surrogate::closed_volume::swept(&faces, &area, by)
        };
        let mut unit: Vec<f64> = positions.iter().flat_map(|_| [0.0, 0.0, 1.0]).collect();
        unit.push(0.0);
        let mut relaxed = vec![0.0; unit.len()];
        model.apply(&unit, &mut relaxed);
        let mut step = vec![0.0; residual.len()];
        for stiffness in [1.0, 1e3, 1e9] {
            model.stiffen(stiffness, dt);
            model.apply(&residual, &mut step);
            let pressure = stiffness * volume(&step);
            for n in 0..positions.len() {
                let by_pressure = if held(n) { 0.0 } else { share * dt * dt * pressure * relaxed[3 * n + 2] };
                let whole = step[3 * n + 2] + by_pressure;
                assert!(
                    (whole - open[3 * n + 2]).abs() < 1e-9 * volume(&open).abs().max(1.0),
                    "{stiffness} {n}"
                );
            }
            assert!(volume(&step).abs() < volume(&open).abs());
        }
        assert!(volume(&step).abs() < 1e-4 * volume(&open).abs(), "{}", volume(&step));
        model.stiffen(0.0, dt);
        model.apply(&residual, &mut step);
        assert_eq!(step, open);
    }

    /// After a rotation of the whole canopy the step is that of a model which was assembled for the rotated canopy.
    #[test]
    fn turned_model_equals_one_of_the_turned_canopy() {
        let (mut positions, faces) = plate(8);
        positions.iter_mut().for_each(|x| x[2] = 0.3 * (x[0] - 0.4).powi(2) + 0.5 * x[0] * x[1]);
        let rotation = Rotation3::from_euler_angles(0.4, -0.9, 0.2).into_inner();
        let turned: Vec<mesh::Point> = positions.iter().map(|x| (rotation * Vec3::from(*x)).into()).collect();
        let lattices = [&positions, &turned].map(|x| VortexLattice::new(x, &faces, 32, 0.0).unwrap());
        for axes in [FrameAxes::Vertical, FrameAxes::All] {
            let unknowns = Unknowns::new(positions.len(), 5e-3, axes);
            let [mut model, fresh] = lattices
                .each_ref()
                .map(|l| AddedMassRelaxation::new(unknowns, &faces, &masses(), l).unwrap());
            let VortexLattice { areas, normals, .. } = &lattices[1];
            model.turn(&Orientation { rotation, areas: areas.clone(), normals: normals.clone() });
            let residual: Vec<f64> = (0..unknowns.len()).map(|i| (0.3 * i as f64).cos() + 0.2).collect();
            let mut steps = [vec![0.0; residual.len()], vec![0.0; residual.len()]];
            model.apply(&residual, &mut steps[0]);
            fresh.apply(&residual, &mut steps[1]);
            let largest = |x: &[f64]| x.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            let difference: Vec<f64> = steps[0].iter().zip(&steps[1]).map(|(a, b)| a - b).collect();
            assert!(largest(&difference) < 1e-5 * largest(&steps[1]), "{}", largest(&difference));
            let masses = model.vertical_added_mass / fresh.vertical_added_mass - 1.0;
            assert!(masses.abs() < 1e-9, "{masses}");
            // The rotation matters here.
            let still =
                AddedMassRelaxation::new(unknowns, &faces, &super::tests::masses(), &lattices[0]).unwrap();
            still.apply(&residual, &mut steps[0]);
            let difference: Vec<f64> = steps[0].iter().zip(&steps[1]).map(|(a, b)| a - b).collect();
            assert!(largest(&difference) > 0.1 * largest(&steps[1]), "{}", largest(&difference));
        }
    }
}
