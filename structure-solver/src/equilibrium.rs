//! Equilibrium under a constant load, from any start: pseudo-transient continuation.
//!
//! The structure creeps down its energy, $`\delta M (u_{k+1}-u_k) + R(u_{k+1}) =
//! F(u_{k+1})`$: implicit Euler of an overdamped motion. Where fabric is slack and a
//! static tangent is singular, the mass term keeps the step well posed; a flat sheet
//! without stiffness across it simply starts to move. $`\delta`$ falls as the steps
//! succeed (Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998, 508-523), so that the
//! last steps are Newton's for the static equations; a step that fails is taken back
//! and repeated with a larger $`\delta`$. Nothing depends on the mass in the end.

use crate::dynamics::{Dynamics, place};
use crate::failure_site::{self, FailureSite};
use crate::loops::{Configuration, FaceLoad};
use crate::newton::{NewtonError, NewtonInfo, StepEquation, Stop};
use crate::scheme::StepForm;

/// When a search for an equilibrium ends.
#[derive(Clone, Copy, Debug)]
pub struct EquilibriumParams {
    /// Largest residual as a share of the load (Euclidean norms over all nodes).
    pub tolerance: f64,
    /// Pseudo-time steps at most.
    pub max_steps: u32,
}

impl Default for EquilibriumParams {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_steps: 1000 }
    }
}

/// One step of the continuation.
#[derive(Clone, Copy, Debug)]
pub struct PseudoStep {
    /// Number of the step, from 1.
    pub number: u32,
    /// Static residual after it, relative to the load.
    pub residual: f64,
    /// Weight of the mass in it, 1/s2.
    pub mass_factor: f64,
    /// Newton steps, those of attempts that failed included.
    pub newton_steps: u32,
    /// Attempts that failed.
    pub repeats: u32,
    /// Largest displacement of a node's component in it, m.
    pub moved: f64,
    /// The forces balance: by residual, or to rounding.
    pub balanced: Option<Stop>,
}

/// How an equilibrium was found.
#[derive(Clone, Copy, Debug)]
pub struct EquilibriumInfo {
    /// Pseudo-time steps.
    pub steps: u32,
    /// Newton steps.
    pub newton_steps: u64,
    /// Residual relative to the load.
    pub residual: f64,
    /// [`Stop::Residual`], or [`Stop::Correction`] where the forces balance as well as
    /// the digits of the positions allow.
    pub stop: Stop,
}

/// Why no equilibrium was found.
#[derive(Clone, Debug, thiserror::Error)]
pub enum EquilibriumError {
    /// Steps of any size fail.
    #[error(
        "no equilibrium found: pseudo-time step {number} failed at every step size ({cause}{}); \
         check that the structure is supported and can carry the load",
        place(element)
    )]
    Stuck {
        /// Number of the step.
        number: u32,
        /// Why the last attempt failed.
        cause: NewtonError,
        /// The most strained element at the node that the cause names.
        element: Option<FailureSite>,
    },
    /// A part moves away without limit.
    #[error(
        "node {node} has moved {distance:.2e} m, {SIZES} times the size of the structure: \
         it has no support against the load; fix it, or remove the load"
    )]
    Runaway {
        /// Node (global) that moved furthest.
        node: u64,
        /// Its displacement, m.
        distance: f64,
    },
    /// The steps ran out.
    #[error(
        "no equilibrium in {steps} pseudo-time steps: residual {residual:.2e} relative to the load, largest at node {node}{}, \
         largest displacement {moved:.2e} m in the last step; a part without support has no equilibrium",
        place(element)
    )]
    NotConverged {
        /// Steps taken.
        steps: u32,
        /// Residual relative to the load.
        residual: f64,
        /// Node (global) with the largest residual.
        node: u64,
        /// Largest motion in the last step, m.
        moved: f64,
        /// The most strained element at the node.
        element: Option<FailureSite>,
    },
}

/// The state of a continuation between its steps.
#[derive(Clone, Debug, Default)]
pub struct Continuation {
    /// Weight of the mass, 1/s2; set by the first step.
    mass_factor: Option<f64>,
    /// Largest load so far, N: residuals are measured against it.
    scale: f64,
    /// Size of the structure, m.
    size: f64,
    residual: f64,
    number: u32,
    /// Steps in a row that rounding ended.
    rounded: u32,
}

impl Continuation {
    /// Sets the weight of the mass in the step after `step`, which took `newton_steps` when it
    /// succeeded.
    fn proceed(&mut self, step: &PseudoStep, newton_steps: u32) {
        let ease = match newton_steps {
            0..=6 => 4.0,
            7..=12 => 2.0,
            13..=20 => 1.3,
            _ => 1.0,
        };
        // Near the end the mass falls with the residual: the last steps are Newton's.
        let ratio = (self.residual / step.residual).clamp(1.0, 100.0);
        let fall = if step.repeats > 0 { 1.0 } else { f64::max(ease, ratio) };
        self.mass_factor = Some(step.mass_factor / fall);
        self.residual = step.residual;
        self.number = step.number;
    }
}

/// What an equilibrium is searched for.
#[derive(Clone, Copy)]
struct RestProblem<'a> {
    load: FaceLoad<'a>,
    /// Acceleration on every mass, m/s2.
    body: [f64; 3],
    params: EquilibriumParams,
}

/// Share of the structure's size that the first step may move it.
const FIRST_MOVE: f64 = 0.02;
/// A displacement of so many times its size is no equilibrium.
const SIZES: f64 = 100.0;
/// Strains below this are rounding of the positions.
const ROUNDING: f64 = 1e-14;
/// Factor on the mass after an attempt that failed.
const HARDER: f64 = 4.0;
/// Attempts at one step.
const ATTEMPTS: u32 = 15;
/// Each step solves its own equations to this share of the static residual.
const INNER: f64 = 0.3;

impl Dynamics {
    /// Moves the accepted state to where it rests under a constant load and the
    /// acceleration `body` (m/s2). Velocities and accelerations become zero. `report`
    /// is called for each step. Prescribed motions are taken at their last time. Collective.
    ///
    /// # Errors
    /// [`EquilibriumError`]; the accepted state is then the last one that was reached.
    pub fn equilibrium(
        &mut self,
        load: FaceLoad<'_>,
        body: [f64; 3],
        params: EquilibriumParams,
        tell: &mut dyn FnMut(&PseudoStep),
    ) -> Result<EquilibriumInfo, EquilibriumError> {
        let mut continuation = Continuation::default();
        let problem = RestProblem { load, body, params };
        self.system.prescribed.clear();
        self.system.set_time(f64::INFINITY);
        for (i, u) in self.motions.iter().flat_map(|m| m.values(f64::INFINITY)) {
            self.accepted.u[i as usize] = u;
        }
        let mut newton_steps = 0;
        loop {
            let step = self.pseudo_transient_step(&mut continuation, problem)?;
            self.accept();
            newton_steps += u64::from(step.newton_steps);
            tell(&step);
            if let Some(stop) = step.balanced {
                let residual = step.residual;
                return Ok(EquilibriumInfo { steps: step.number, newton_steps, residual, stop });
            }
        }
    }

    /// One step of the continuation, from the accepted state into `current`.
    ///
    /// # Errors
    /// [`EquilibriumError`]: no attempt succeeded, or this would be one step too many.
    fn pseudo_transient_step(
        &mut self,
        c: &mut Continuation,
        problem: RestProblem<'_>,
    ) -> Result<PseudoStep, EquilibriumError> {
        let mut step = self.start_pseudo_step(c, problem);
        if step.balanced.is_some() {
            return Ok(step);
        }
        let solved = self.solve_pseudo_step(c, problem, &mut step)?;
        self.take_pseudo_step(c, problem, solved.stop, &mut step);
        self.check_progress(c, problem, &step)?;
        c.proceed(&step, solved.steps);
        Ok(step)
    }

    /// Brings `current` to rest at the accepted positions and measures its residual; the first
    /// step finds its weight of the mass.
    fn start_pseudo_step(&mut self, c: &mut Continuation, problem: RestProblem<'_>) -> PseudoStep {
        let RestProblem { load, body, params } = problem;
        self.current.copy_from(&self.accepted);
        self.current.v.fill(0.0);
        self.current.a.fill(0.0);
        self.system.set_step(f64::INFINITY);
        c.scale = c.scale.max({
            let form = StepForm::overdamped(0.0);
            let balance = StepEquation { from: &self.current, form, load, body };
            self.newton.load_scale(&self.system, &balance)
        });
        let (mass_factor, rounding) = match c.mass_factor {
            Some(factor) => (factor, false),
            None => {
                c.residual = self.residual_norm(load, body) / c.scale;
                self.first_factor(c, load)
            }
        };
        PseudoStep {
            number: c.number + 1,
            residual: c.residual,
            mass_factor,
            newton_steps: 0,
            repeats: 0,
            moved: 0.0,
            balanced: if c.residual <= params.tolerance {
                Some(Stop::Residual)
            } else {
                rounding.then_some(Stop::Correction)
            },
        }
    }

    /// Solves the step's equations into `next`, with more mass after each attempt that fails.
    fn solve_pseudo_step(
        &mut self,
        c: &Continuation,
        problem: RestProblem<'_>,
        step: &mut PseudoStep,
    ) -> Result<NewtonInfo, EquilibriumError> {
        let RestProblem { load, body, params } = problem;
        self.newton.set_static_tolerance((INNER * c.residual).clamp(0.3 * params.tolerance, INNER));
        loop {
            let form = StepForm::overdamped(step.mass_factor);
            let balance = StepEquation { from: &self.current, form, load, body };
            let solved =
                self.newton.step(&mut self.system, &mut self.linear, &balance, &[], c.scale, &mut self.next);
            match solved {
                Ok(info) => {
                    step.newton_steps += info.steps;
                    return Ok(info);
                }
                Err(cause) => {
                    step.newton_steps += cause.steps();
                    step.repeats += 1;
                    if step.repeats == ATTEMPTS {
                        let element = self.failure_site(&cause);
                        return Err(EquilibriumError::Stuck { number: step.number, cause, element });
                    }
                    step.mass_factor *= HARDER;
                    self.linear.renew();
                }
            }
        }
    }

    /// Makes `next` the current state, at rest, and measures how far it moved and what is left.
    fn take_pseudo_step(
        &mut self,
        c: &mut Continuation,
        problem: RestProblem<'_>,
        stop: Stop,
        step: &mut PseudoStep,
    ) {
        let RestProblem { load, body, params } = problem;
        let n = 3 * self.system.model.n_owned();
        let moved = (0..n).fold(0.0f64, |m, i| m.max((self.next.u[i] - self.current.u[i]).abs()));
        step.moved = self.system.comm().max(moved);
        std::mem::swap(&mut self.current, &mut self.next);
        self.current.v.fill(0.0);
        self.current.a.fill(0.0);
        step.residual = self.residual_norm(load, body) / c.scale;
        c.rounded = if stop == Stop::Correction { c.rounded + 1 } else { 0 };
        step.balanced = if step.residual <= params.tolerance {
            Some(Stop::Residual)
        } else {
            (c.rounded == 3).then_some(Stop::Correction)
        };
    }

    /// Refuses a structure that leaves its place, and one step too many.
    fn check_progress(
        &self,
        c: &Continuation,
        problem: RestProblem<'_>,
        step: &PseudoStep,
    ) -> Result<(), EquilibriumError> {
        let (node, distance) = self.worst_node(&self.current.u);
        if distance > SIZES * c.size {
            return Err(EquilibriumError::Runaway { node, distance });
        }
        if step.balanced.is_none() && step.number >= problem.params.max_steps {
            let (node, _) = self.worst_node(&self.force[0]);
            let (steps, residual, moved) = (step.number, step.residual, step.moved);
            let element = failure_site::at_node(&self.system.model, node, &self.x);
            return Err(EquilibriumError::NotConverged { steps, residual, node, moved, element });
        }
        Ok(())
    }

    /// Norm of the residual force at `current`, N; writes the residual to `force[0]`.
    fn residual_norm(&mut self, load: FaceLoad<'_>, body: [f64; 3]) -> f64 {
        let n = 3 * self.system.model.n_owned();
        for i in 0..self.x.len() {
            self.x[i] = self.system.model.reference[i] + self.current.u[i];
            self.next.a[i] = -body[i % 3];
        }
        let [g, _] = &mut self.force;
        self.system.forces(Configuration::only(&self.x), load, g);
        self.system.add_mass_product(&self.next.a, g);
        self.system.constrain(g);
        self.system.comm().sum(g[..n].iter().map(|g| g * g).sum()).sqrt()
    }

    /// The mass factor with which no node moves further in the first step than
    /// [`FIRST_MOVE`] of the structure's size, and whether the forces are rounding
    /// only: such as strains of [`ROUNDING`] make.
    fn first_factor(&mut self, c: &mut Continuation, load: FaceLoad<'_>) -> (f64, bool) {
        let (mut force, mut stiffness, mut fastest) = (0.0f64, 0.0f64, 0.0f64);
        self.system.tangent(Configuration::only(&self.x), load, 1.0, 0.0, &mut self.next.a);
        let n = self.system.model.n_owned();
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for i in 0..3 * n {
            low[i % 3] = low[i % 3].min(self.x[i]);
            high[i % 3] = high[i % 3].max(self.x[i]);
            let diagonal = self.system.matrix.values[self.system.matrix.diagonal_slot(i / 3)];
            // NaN counts as infinite: `max` would leave it out, and a structure without a force would be at rest.
            let own = self.force[0][i].abs();
            force = force.max(if own.is_nan() { f64::INFINITY } else { own });
            if !self.system.model.fixed[i] {
                stiffness = stiffness.max(diagonal[i % 3][i % 3].abs());
            }
            let mass = self.system.lumped_mass(i / 3);
            if mass > 0.0 {
                fastest = fastest.max(self.force[0][i].abs() / mass);
            }
        }
        let comm = self.system.comm();
        let size = (0..3).map(|c| comm.max(high[c]) + comm.max(-low[c])).fold(0.0, f64::max);
        let [force, stiffness, fastest] = [force, stiffness, fastest].map(|v| comm.max(v));
        c.size = size;
        let factor = if size > 0.0 && fastest > 0.0 { fastest / (FIRST_MOVE * size) } else { 1.0 };
        (factor, force <= ROUNDING * stiffness * size)
    }

    /// Node (global) with the largest vector in `rows`, and its length.
    fn worst_node(&self, rows: &[f64]) -> (u64, f64) {
        let model = &self.system.model;
        let size = |i: usize| crate::flat::at(rows, i).norm();
        let worst = (0..model.n_owned()).max_by(|&i, &j| size(i).total_cmp(&size(j)));
        let value = worst.map_or(-1.0, size);
        let largest = model.comm.max(value);
        let here = if value == largest { worst.map_or(0, |i| model.numbering.global[i] + 1) } else { 0 };
        (model.comm.max_u64(here).saturating_sub(1), largest)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::rc::Rc;

    use comm::Comm;
    use mesh::{Cable, CableKind, StructureMesh};

    use super::*;
    use crate::assemble;
    use crate::elements::load::area_vector;
    use crate::flat::at;
    use mesh::geometry::Vec3;

    const FABRIC: &str = r#"
        [fabric]
        youngs_modulus_pa = 206.8e6
        poisson_ratio = 0.3
        thickness_m = 3.048e-5
        density_kg_m3 = 1223.5093
        wrinkling = true
        [lines]
        youngs_modulus_pa = 1e9
        area_m2 = 1e-6
        density_kg_m3 = 1000.0
        [[stage]]
        name = "inflation"
        kind = "pre-inflation"
        pressure_pa = 23.94
        duration_s = 0.05
        window_s = 1e-3
    "#;

    fn structure(canopy: &str, mesh: Option<StructureMesh>) -> Dynamics {
        let text = format!("name = \"test\"\n[canopy]\n{canopy}\n{FABRIC}");
        let scene = case::parse(Path::new("scene.toml"), &text).expect("a good scene");
        let mesh = mesh.unwrap_or_else(|| mesh::structure_mesh(&scene).expect("a good mesh"));
        assemble::dynamics(&Comm::solo(), &scene, 0, &Rc::new(mesh)).expect("a structure")
    }

    fn rest(d: &mut Dynamics, pressure: f64, body: [f64; 3]) -> Result<EquilibriumInfo, EquilibriumError> {
        let p = vec![pressure; d.system.model.n_faces];
        let load = FaceLoad { pressure: &p, traction: &[] };
        d.equilibrium(load, body, EquilibriumParams::default(), &mut |_| ())
    }

    /// Displacement of the node that was at `x`.
    fn moved(d: &Dynamics, x: Vec3) -> Vec3 {
        let near = |p: &[f64]| (0..3).all(|c| (p[c] - x[c]).abs() < 1e-9);
        let node = d.system.model.reference.chunks(3).position(near).expect("a node there");
        at(&d.accepted.u, node)
    }

    /// The air bag of the paper from its flat sheet, beside an independent minimisation of the energy of the
    /// same 800 triangles under the pressure times the volume of the flow's wall, four triangles around the mean of
    /// each face's corners: rise of the centre 0.07689 m, edges in by 0.04602 m, corners by 0.01836 m along the diagonal,
    /// volume 7.1630e-4 m3. (With the volume under the elements themselves: 0.07689, 0.04594, 0.01823, 7.1670e-4.)
    #[test]
    fn the_air_bag_rests_where_its_energy_is_least() {
        let mut d = structure("kind = \"air-bag\"\ncells_across = 20", None);
        let info = rest(&mut d, 23.94, [0.0; 3]).expect("an equilibrium");
        assert!(info.residual <= 1e-8 && info.stop == Stop::Residual, "{info:?}");
        let (centre, edge) = (moved(&d, Vec3::zeros()), moved(&d, Vec3::new(0.1524, 0.0, 0.0)));
        let corner = moved(&d, Vec3::new(0.1524, 0.1524, 0.0));
        assert!((centre[2] - 0.07689).abs() < 1e-5, "{centre:?}");
        assert!((edge[0] + 0.04602).abs() < 1e-5, "{edge:?}");
        assert!((corner[0].hypot(corner[1]) - 0.01836).abs() < 1e-5, "{corner:?}");
        let x: Vec<f64> = d.system.model.reference.iter().zip(&d.accepted.u).map(|(x, u)| x + u).collect();
        let under = |p: [Vec3; 3]| area_vector(&p)[2] * (p[0][2] + p[1][2] + p[2][2]) / 3.0;
        let under_wall = |p: [Vec3; 4]| {
            let mean: Vec3 = Vec3::from_fn(|i, _| 0.25 * p.iter().map(|x| x[i]).sum::<f64>());
            (0..4).map(|k| under([p[k], p[(k + 1) % 4], mean])).sum::<f64>()
        };
        let faces = &d.system.model.split_faces;
        assert_eq!(2 * faces.len(), d.system.model.triangles.len(), "all faces are two triangles");
        let volume: f64 = faces.iter().map(|f| under_wall(f.nodes.map(|n| at(&x, n as usize)))).sum();
        assert!((volume - 7.1630e-4).abs() < 5e-9, "{volume}");
        assert!(d.accepted.v.iter().chain(&d.accepted.a).all(|v| *v == 0.0), "at rest");
    }

    /// From a straight slack line to a catenary under its weight:
    /// 2 c sinh(span / 2c) = length. The chords of 32 links sag less than the curve
    /// by a share of (1/32)^2 times a number of order one.
    #[test]
    fn a_slack_line_finds_its_catenary() {
        let (n, span, length) = (32, 1.0, 1.3);
        let cable = |i: u32| Cable {
            nodes: [i, i + 1],
            rest_length: length / f64::from(n),
            kind: CableKind::SuspensionLine,
            line: 0,
            share: 1.0,
            group: None,
        };
        let mesh = StructureMesh {
            coords: (0..=n).map(|i| [span * f64::from(i) / f64::from(n), 0.0, 0.0]).collect(),
            cables: (0..n).map(cable).collect(),
            fixed: vec![(0, [true; 3]), (n, [true; 3])],
            ..Default::default()
        };
        let mut d = structure("kind = \"air-bag\"", Some(mesh));
        let info = rest(&mut d, 0.0, [0.0, 0.0, -9.81]).expect("an equilibrium");
        assert!(info.residual <= 1e-8, "{info:?}");
        let mut c = 0.3;
        for _ in 0..60 {
            let g = 2.0 * c * (0.5f64 * span / c).sinh() - length;
            let slope = 2.0 * (0.5 * span / c).sinh() - span / c * (0.5f64 * span / c).cosh();
            c -= g / slope;
        }
        let sag = c * ((0.5 * span / c).cosh() - 1.0);
        let found = -moved(&d, Vec3::new(0.5, 0.0, 0.0))[2];
        assert!((found / sag - 1.0).abs() < 2e-3, "{found} beside {sag}");
    }

    /// Without a load the flat sheet rests where it is; a sheet that nothing holds
    /// never rests under pressure, and the message says so.
    #[test]
    fn no_load_moves_nothing_and_a_free_sheet_has_no_equilibrium() {
        let mut d = structure("kind = \"air-bag\"\ncells_across = 4", None);
        let info = rest(&mut d, 0.0, [0.0; 3]).expect("at rest already");
        assert_eq!((info.steps, info.newton_steps), (1, 0));
        assert!(d.accepted.u.iter().all(|u| *u == 0.0));
        let free = StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            n_canopy: 3,
            faces: vec![[0, 1, 2, 2]],
            face_panel: vec![0],
            triangles: vec![[0, 1, 2]],
            triangle_face: vec![0],
            ..Default::default()
        };
        let mut d = structure("kind = \"air-bag\"", Some(free));
        let error = rest(&mut d, 10.0, [0.0; 3]).expect_err("a free fall").to_string();
        assert!(error.contains("support"), "{error}");
    }
}
