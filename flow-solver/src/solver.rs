//! One time step of the flow: grid motion, BDF2, iterations to a residual drop.

use comm::{Comm, Halo};

use crate::error::{FlowError, agree};
use crate::geometry::Metrics;
use crate::geometry::vec3::{Vec3, norm, sub};
use crate::gradient::{Gradient, LeastSquares};
use crate::implicit::{Acceleration, Correction, LuSgs, PressureCorrection};
use crate::physics::{Air, FaceFlow, Gas, Scheme, Viscosity};
use crate::residual::{Domain, Spatial};
use crate::shear::Sheared;
use crate::state::{self, Extras};
use crate::time::Backward;
use crate::topology::Topology;
use crate::turbulence::{SpalartAllmaras, Transported};

/// What corrects the state in each iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Pressure corrections, combined by nonlinear GMRES over this many (0: none).
    PressureCorrection {
        /// Corrections that are combined.
        depth: usize,
    },
    /// The paper's LU-SGS steps in pseudo time.
    LuSgs {
        /// Pseudo-time Courant number.
        courant: f64,
    },
}

/// How a step is solved.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Undisturbed air.
    pub air: Air,
    /// Its velocity relative to the ground, m/s.
    pub wind: Vec3,
    /// The residual must fall by this factor.
    pub residual_drop: f64,
    /// Iterations at most.
    pub max_iterations: usize,
    /// What corrects the state.
    pub method: Method,
    /// Speed that floors the reference speeds, m/s: a tenth of the stream's.
    pub reference_speed: f64,
    /// Weight of velocity diffusion in the interface pressure.
    pub velocity_diffusion: f64,
}

/// One step to be taken.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Length, s.
    pub dt: f64,
    /// Velocity of the grid's frame relative to the ground, m/s.
    pub frame: Vec3,
    /// Whether the same step was computed before (and is now repeated with
    /// slightly other data): starts from that result.
    pub again: bool,
    /// Whether [`Solver::nodes`] were changed.
    pub moved: bool,
}

/// What a step took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Residual of the last accepted state in the new step, N.
    pub start: f64,
    /// Residual at the end, N.
    pub end: f64,
    /// Corrections.
    pub iterations: usize,
    /// Iterations of the pressure equation.
    pub linear_iterations: usize,
    /// Sum of the continuity residual over all cells, kg/s.
    pub mass_defect: f64,
}

/// State at an accepted instant.
#[derive(Clone, Debug)]
pub struct Instant<const N: usize> {
    /// Unknowns of local cells.
    pub q: Vec<[f64; N]>,
    /// Volumes of local cells, m3.
    pub volume: Vec<f64>,
    /// Node positions, m.
    pub nodes: Vec<Vec3>,
}

/// The flow on one rank's part of the grid.
pub struct Solver<G, V, const N: usize> {
    /// Cells and faces.
    pub topology: Topology,
    /// Exchange of cell values.
    pub halo: Halo,
    /// Gas, viscosity, reconstruction.
    pub spatial: Spatial<G, V>,
    /// Tolerances.
    pub settings: Settings,
    /// Node positions at the end of the step, m.
    pub nodes: Vec<Vec3>,
    /// Node velocities in the falling frame at the end of the step, m/s.
    pub node_velocity: Vec<Vec3>,
    /// Unknowns at the end of the step.
    pub q: Vec<[f64; N]>,
    /// Their gradients.
    pub gradient: Vec<Gradient<N>>,
    /// Geometry at the end of the step.
    pub metrics: Metrics,
    /// Last accepted instant and the one before it.
    pub past: [Instant<N>; 2],
    /// First-order steps still to take before BDF2.
    pub first_order_steps: u32,
    /// Length of the last accepted step, s (0: none).
    pub last_dt: f64,
    /// Constants of the last step's flux.
    pub scheme: Scheme,
    /// What moves the undisturbed air, m/s2: its momentum is supplied everywhere, so
    /// that a wind which changes needs no pressure from the boundary.
    pub wind_change: Vec3,
    /// What the undisturbed velocity gains in this step and has gained in the last, m/s.
    wind_gain: [Vec3; 2],
    /// What each owned cell gains of the conserved quantities in unit time and
    /// volume (kg/(m3 s), N/m3[, W/m3]) at the end of the step. Empty: nothing.
    pub source: Vec<[f64; N]>,
    /// Wind by height. `None`: the same everywhere.
    shear: Option<Sheared>,
    sheared: Vec<Vec3>,
    turbulence: Option<Box<SpalartAllmaras>>,
    turbulence_lost: bool,
    eddy: Vec<f64>,
    least_squares: LeastSquares,
    wall_velocity: Vec<Vec3>,
    /// What each face sweeps in this step and swept in the last, m3. Empty until the
    /// grid moves for the first time.
    swept: Vec<f64>,
    swept_before: Vec<f64>,
    residual: Vec<[f64; N]>,
    history: Vec<[f64; N]>,
    through: Vec<FaceFlow>,
    /// Whether the faces know the last accepted instant only.
    ties_are_new: bool,
    start: f64,
    /// State with the smallest residual of the step.
    best: Vec<[f64; N]>,
    correction: Box<dyn Correction<G, V, N>>,
    acceleration: Acceleration,
}

macro_rules! domain {
    ($s:ident) => {
        Domain {
            topology: &$s.topology,
            metrics: &$s.metrics,
            gradients: &$s.least_squares,
            halo: &$s.halo,
            wall_velocity: &$s.wall_velocity,
            sheared: &$s.sheared,
            eddy: &$s.eddy,
        }
    };
}

impl<G: Gas<N>, V: Viscosity, const N: usize> Solver<G, V, N> {
    /// Undisturbed air everywhere, on a grid with node positions `nodes` (local). Collective.
    pub fn new(
        comm: &Comm,
        topology: Topology,
        nodes: Vec<Vec3>,
        spatial: Spatial<G, V>,
        settings: Settings,
    ) -> Result<Self, FlowError> {
        let halo = Halo::new(comm, &topology.numbering);
        let metrics = Metrics::new(&topology, &halo, &nodes);
        let least_squares = LeastSquares::new(&topology, &metrics);
        let (n, faces) = (topology.n_local(), topology.face_nodes.len());
        let q = vec![spatial.gas.undisturbed(settings.wind); n];
        let (correction, depth): (Box<dyn Correction<G, V, N>>, usize) = match settings.method {
            Method::PressureCorrection { depth } => (Box::new(PressureCorrection::new(&topology)), depth),
            Method::LuSgs { courant } => (Box::new(LuSgs::new(&topology, courant)), 0),
        };
        let instant = Instant { q: q.clone(), volume: metrics.volume.clone(), nodes: nodes.clone() };
        let solver = Self {
            node_velocity: vec![[0.0; 3]; nodes.len()],
            gradient: vec![[[0.0; N]; 3]; n],
            past: [instant.clone(), instant],
            first_order_steps: 2,
            last_dt: 0.0,
            scheme: Scheme {
                rate: 0.0,
                tie: [0.0; 3],
                frame: [0.0; 3],
                wind: settings.wind,
                floor_squared: settings.reference_speed * settings.reference_speed,
                velocity_diffusion: settings.velocity_diffusion,
                pressure_diffusion: 2.0 / (1.0 - spatial.chi),
            },
            wind_change: [0.0; 3],
            wind_gain: [[0.0; 3]; 2],
            source: Vec::new(),
            shear: None,
            sheared: Vec::new(),
            turbulence: None,
            turbulence_lost: false,
            eddy: vec![0.0; if V::TRANSPORTED { n } else { 0 }],
            least_squares,
            wall_velocity: vec![[0.0; 3]; faces - topology.cells.len()],
            swept: Vec::new(),
            swept_before: Vec::new(),
            residual: vec![[0.0; N]; n],
            history: vec![[0.0; N]; topology.n_owned],
            through: vec![FaceFlow::default(); faces],
            ties_are_new: true,
            start: 0.0,
            best: q.clone(),
            correction,
            acceleration: Acceleration::new(depth, topology.n_owned * N),
            nodes,
            q,
            metrics,
            halo,
            spatial,
            settings,
            topology,
        };
        solver.check_volumes()?;
        Ok(solver)
    }

    /// Lets the wind change with height, in the far field from now on and in all of the air
    /// as it is. The settings' wind is that of [`Sheared::base`].
    pub fn set_shear(&mut self, shear: Sheared) {
        self.sheared = vec![[0.0; 3]; self.topology.face_nodes.len() - self.topology.cells.len()];
        let [a, b] = &mut self.past;
        for q in [&mut self.q, &mut a.q, &mut b.q] {
            for (q, x) in q.iter_mut().zip(&self.metrics.centre) {
                let more = shear.excess(x[2]);
                for d in 0..3 {
                    q[1 + d] += more[d];
                }
            }
        }
        self.shear = Some(shear);
    }

    /// Adds the eddy viscosity of `turbulence`; the stress must be [`crate::physics::Modelled`].
    pub fn set_turbulence(&mut self, turbulence: SpalartAllmaras) {
        assert!(V::TRANSPORTED, "this stress knows no transported eddy viscosity");
        turbulence.eddy(&self.densities(), &mut self.eddy);
        self.turbulence = Some(Box::new(turbulence));
    }

    /// The transported turbulence, if any.
    pub fn turbulence(&self) -> Option<&SpalartAllmaras> {
        self.turbulence.as_deref()
    }

    /// Transported dynamic eddy viscosity of local cells, Pa s; empty where there is none.
    pub fn eddy(&self) -> &[f64] {
        &self.eddy
    }

    fn densities(&self) -> Vec<f64> {
        self.q.iter().map(|q| self.spatial.gas.density(q)).collect()
    }

    /// Transports the turbulence over the step of length `dt` that was computed last. Collective.
    fn advance_turbulence(&mut self, dt: f64) {
        let Some(mut turbulence) = self.turbulence.take() else { return };
        let (c, gas) = (self.order(dt).c, &self.spatial.gas);
        let mass =
            |k: usize, i: usize| c[k + 1] / dt * self.past[k].volume[i] * gas.density(&self.past[k].q[i]);
        let before: Vec<[f64; 2]> = (0..self.topology.n_owned)
            .map(|i| [mass(0, i), if c[2] == 0.0 { 0.0 } else { mass(1, i) }])
            .collect();
        let density = self.densities();
        let flow = Transported {
            density: &density,
            gradient: &self.gradient,
            through: &self.through,
            before: &before,
            nodes: &self.nodes,
            drop: self.settings.residual_drop,
        };
        let taken = turbulence.advance(&domain!(self), &flow);
        if taken.end.is_finite() {
            turbulence.accept();
        } else {
            turbulence.value.copy_from_slice(&turbulence.past[0]);
            self.turbulence_lost = true;
        }
        turbulence.eddy(&density, &mut self.eddy);
        self.turbulence = Some(turbulence);
    }

    /// The ranks that share the grid.
    pub fn comm(&self) -> &Comm {
        self.halo.comm()
    }

    /// Computes the step from the last accepted instant. Collective.
    pub fn advance(&mut self, step: &Step) -> Result<Report, FlowError> {
        if self.turbulence_lost {
            return Err(FlowError::Turbulence);
        }
        let order = self.order(step.dt);
        if step.moved {
            self.move_grid()?;
        }
        self.prepare(step, order);
        let report = self.iterate(step, order)?;
        Ok(report)
    }

    /// The undisturbed velocity at the end of the next step of length `dt`, at its
    /// start, and one such step before, m/s. The air is accelerated as the time
    /// differences see it: a stream without obstacle follows to round-off.
    pub fn blow(&mut self, wind: [Vec3; 3], dt: f64) {
        let c = self.order(dt).c;
        self.settings.wind = wind[0];
        self.wind_gain = [sub(wind[0], wind[1]), sub(wind[1], wind[2])];
        self.wind_change = std::array::from_fn(|d| (0..3).map(|k| c[k] * wind[k][d]).sum::<f64>() / dt);
    }

    /// Backward difference for a step of length `dt`.
    fn order(&self, dt: f64) -> Backward {
        let same = (dt - self.last_dt).abs() <= 1e-9 * dt;
        if self.first_order_steps > 0 || !same { Backward::FIRST } else { Backward::SECOND }
    }

    /// Geometry of the moved grid.
    fn move_grid(&mut self) -> Result<(), FlowError> {
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        let bad = self.nodes.iter().zip(&self.node_velocity).position(|(x, v)| !finite(x) || !finite(v));
        let finding = bad.map(|n| (self.topology.node_global[n], [0.0; 3], 0.0));
        if let Some((rank, (node, ..))) = agree(self.halo.comm(), finding) {
            return Err(FlowError::BadNode { node, rank });
        }
        self.metrics.update(&self.topology, &self.halo, &self.nodes);
        self.check_volumes()?;
        self.least_squares.update(&self.topology, &self.metrics);
        self.swept.resize(self.topology.face_nodes.len(), 0.0);
        self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
        Metrics::swept(&self.topology, &self.past[0].nodes, &self.nodes, &mut self.swept);
        if V::ACTIVE {
            for side in &self.topology.no_slip {
                let nodes = self.topology.face_nodes[side.face as usize];
                let count = if nodes[2] == nodes[3] { 3 } else { 4 };
                let sum = nodes[..count].iter().fold([0.0; 3], |s: Vec3, &n| {
                    let v = self.node_velocity[n as usize];
                    [s[0] + v[0], s[1] + v[1], s[2] + v[2]]
                });
                self.wall_velocity[side.face as usize - self.topology.cells.len()] =
                    sum.map(|s| s / count as f64);
            }
        }
        Ok(())
    }

    fn check_volumes(&self) -> Result<(), FlowError> {
        let n = self.topology.n_owned;
        let bad = self.metrics.volume[..n].iter().position(|v| v.is_nan() || *v <= 0.0);
        let finding =
            bad.map(|c| (self.topology.numbering.global[c], self.metrics.centre[c], self.metrics.volume[c]));
        match agree(self.halo.comm(), finding) {
            None => Ok(()),
            Some((rank, (cell, at, volume))) => Err(FlowError::InvertedCell { cell, at, rank, volume }),
        }
    }

    /// Constants of the step: grid fluxes, history of the time derivative, weights.
    fn prepare(&mut self, step: &Step, order: Backward) {
        let dt = step.dt;
        let swept = self.swept.iter().zip(&self.swept_before).map(|(now, before)| (*now, *before));
        let swept = swept.chain(std::iter::repeat((0.0, 0.0)));
        for (f, (now, before)) in self.metrics.faces.iter_mut().zip(swept) {
            f.grid_flux = order.grid_flux(now, before, dt);
            f.grid_flux += f.area[0] * step.frame[0] + f.area[1] * step.frame[1] + f.area[2] * step.frame[2];
        }
        self.scheme.rate = order.c[0] / dt;
        self.scheme.tie = if self.ties_are_new { Backward::FIRST } else { order }.c.map(|c| c / dt);
        self.scheme.frame = step.frame;
        self.scheme.wind = self.settings.wind;
        if let Some(shear) = &mut self.shear {
            shear.advance(step.frame[2] * dt, &self.topology, &self.metrics, &mut self.sheared);
        }
        let gas = &self.spatial.gas;
        let old = |past: &Instant<N>, c: f64, i: usize| {
            let q = &past.q[i];
            let m = c / dt * past.volume[i] * gas.density(q);
            gas.stored(q).map(|s| m * s)
        };
        for (i, h) in self.history.iter_mut().enumerate() {
            *h = old(&self.past[0], order.c[1], i);
            if order.c[2] != 0.0 {
                let older = old(&self.past[1], order.c[2], i);
                for (h, o) in h.iter_mut().zip(older) {
                    *h += o;
                }
            }
        }
        self.add_sources();
    }

    /// Adds the sources to what is constant in the step.
    fn add_sources(&mut self) {
        for ((h, s), v) in self.history.iter_mut().zip(&self.source).zip(&self.metrics.volume) {
            for (h, s) in h.iter_mut().zip(s) {
                *h -= v * s;
            }
        }
    }

    /// Residual of the step at `q`: primitive, weighted to N. Returns its norm.
    fn evaluate(&mut self) -> f64 {
        self.spatial.evaluate(
            &domain!(self),
            &self.scheme,
            &mut self.q,
            &mut self.gradient,
            &mut self.residual,
            &mut self.through,
        );
        let gas = &self.spatial.gas;
        let push = self.wind_change.map(|a| self.settings.air.density * a);
        let mut sum = 0.0;
        for i in 0..self.topology.n_owned {
            let (q, r, h) = (&self.q[i], &mut self.residual[i], &self.history[i]);
            let m = self.scheme.rate * self.metrics.volume[i] * gas.density(q);
            let stored = gas.stored(q);
            for v in 0..N {
                r[v] += m * stored[v] + h[v];
            }
            *r = gas.primitive_residual(q, r);
            for d in 0..3 {
                r[1 + d] -= self.metrics.volume[i] * push[d];
            }
            r[0] *= mass_weight(self.metrics.size[i], &self.scheme);
            if N > 4 {
                r[N - 1] *= TEMPERATURE_WEIGHT;
            }
            sum += r.iter().map(|x| x * x).sum::<f64>();
        }
        self.halo.comm().sum(sum).sqrt()
    }

    fn iterate(&mut self, step: &Step, order: Backward) -> Result<Report, FlowError> {
        let n = self.topology.n_owned;
        let mut norm: f64;
        if step.again {
            norm = self.evaluate();
        } else {
            let inertia = self.inertia();
            norm = f64::INFINITY;
            if order == Backward::SECOND {
                // A smooth flow goes on as it went.
                for ((q, a), b) in self.q.iter_mut().zip(&self.past[0].q).zip(&self.past[1].q) {
                    for v in 0..N {
                        q[v] = 2.0 * a[v] - b[v];
                    }
                    for d in 0..3 {
                        q[1 + d] += self.wind_gain[0][d] - self.wind_gain[1][d];
                    }
                }
                norm = self.evaluate();
                self.start = inertia;
            }
            // Not a smooth flow: from where it was.
            if norm.is_nan() || norm > inertia {
                self.q.copy_from_slice(&self.past[0].q);
                for q in &mut self.q {
                    for d in 0..3 {
                        q[1 + d] += self.wind_gain[0][d];
                    }
                }
                self.start = self.evaluate();
                norm = self.start;
            }
        }
        let first = norm;
        // Below this the residual is round-off of the fluxes themselves.
        let drop = self.settings.residual_drop;
        // A coupled step answers changes of its input: what is left over must be small
        // against the change that this call brought, or the coupling iterates on noise.
        let scale =
            if step.moved { (0.1 * first).clamp(1e-3 * self.start, 0.1 * self.start) } else { self.start };
        let target = (drop * scale).max(self.round_off());
        let mut report = Report { start: self.start, ..Report::default() };
        if step.again {
            // The Jacobian is nearly the same: what the last solve has learnt still holds.
            self.acceleration.pause();
        } else {
            self.acceleration.clear();
        }
        // Share of each correction that is taken.
        let mut share = 1.0;
        let mut best = norm;
        self.best.copy_from_slice(&self.q);
        let mut assembled = false;
        while report.iterations < self.settings.max_iterations && (norm.is_nan() || norm > target) {
            if !assembled {
                self.correction.assemble(
                    &self.spatial,
                    &domain!(self),
                    &self.scheme,
                    &self.q,
                    &self.gradient,
                    &self.through,
                    1.0,
                );
            }
            self.acceleration.combine(
                self.halo.comm(),
                self.q[..n].as_flattened_mut(),
                self.residual[..n].as_flattened_mut(),
            );
            for (r, h) in self.residual[..n].iter_mut().zip(&self.metrics.size) {
                r[0] /= mass_weight(*h, &self.scheme);
                if N > 4 {
                    r[N - 1] /= TEMPERATURE_WEIGHT;
                }
            }
            let linear = self.correction.apply(
                &self.spatial.gas,
                &domain!(self),
                &self.scheme,
                &self.residual,
                share,
                &mut self.q,
            );
            report.linear_iterations += linear.iterations;
            report.iterations += 1;
            let bad = self.bad_cell();
            let before = norm;
            if bad.is_none() {
                norm = self.evaluate();
            }
            if bad.is_some() || !norm.is_finite() || norm > 10.0 * best {
                // Back to the best state so far, and on by smaller steps.
                self.acceleration.clear();
                self.q.copy_from_slice(&self.best);
                share *= 0.5;
                assembled = false;
                if share < 1e-3 {
                    if let Some((rank, (cell, at, density))) = bad {
                        return Err(FlowError::BadState { cell, at, rank, density });
                    }
                    return Err(FlowError::Diverged {
                        start: first,
                        end: norm,
                        iterations: report.iterations,
                    });
                }
                norm = self.evaluate();
                continue;
            }
            if norm < best {
                best = norm;
                self.best.copy_from_slice(&self.q);
                share = (2.0 * share).min(1.0);
            }
            // What served well serves again.
            assembled = norm < 0.5 * before;
        }
        if norm > best {
            self.q.copy_from_slice(&self.best);
            norm = self.evaluate();
        }
        if report.iterations >= self.settings.max_iterations
            && norm > 0.5 * self.start
            && norm > 1e3 * self.round_off()
        {
            return Err(FlowError::Diverged { start: first, end: norm, iterations: report.iterations });
        }
        report.end = norm;
        let cells = self.residual[..n].iter().zip(&self.metrics.size);
        let defect: f64 = cells.map(|(r, h)| r[0] / mass_weight(*h, &self.scheme)).sum();
        report.mass_defect = self.halo.comm().sum(defect);
        Ok(report)
    }

    /// What would remain in the momentum equations of a step on a grid at rest if
    /// the flow kept its state relative to the undisturbed air, N. Collective.
    fn inertia(&self) -> f64 {
        let (gas, still) = (&self.spatial.gas, self.wind_gain[1]);
        let past = self.past[0].q.iter().zip(&self.past[1].q).zip(&self.metrics.volume);
        let sum: f64 = past
            .take(self.topology.n_owned)
            .map(|((a, b), v)| {
                let m = self.scheme.rate * v * gas.density(a);
                (0..3).map(|d| (m * (a[1 + d] - b[1 + d] - still[d])).powi(2)).sum::<f64>()
            })
            .sum();
        self.halo.comm().sum(sum).sqrt()
    }

    /// Norm of what round-off alone may leave in the residual, N.
    fn round_off(&self) -> f64 {
        let speed = 10.0 * self.settings.reference_speed + norm(self.scheme.frame);
        let n = self.topology.n_owned;
        let cells = self.metrics.volume[..n].iter().zip(&self.metrics.size);
        let sum: f64 = cells
            .map(|(v, h)| {
                let w = mass_weight(*h, &self.scheme);
                // Momentum stored and passed, and mass in the weight of its row.
                let e = (self.scheme.rate * v + speed * h * h) * (speed + w);
                e * e
            })
            .sum();
        4.0 * f64::EPSILON * self.settings.air.density * self.halo.comm().sum(sum).sqrt()
    }

    /// The first cell whose state is not physical, agreed on by all ranks.
    fn bad_cell(&self) -> Option<(usize, (u64, Vec3, f64))> {
        let floor = 0.1 * self.settings.air.density;
        let ceiling = 10.0 * self.settings.air.density;
        let fine = |q: &[f64; N]| {
            let rho = self.spatial.gas.density(q);
            q.iter().all(|x| x.is_finite()) && rho > floor && rho < ceiling
        };
        let bad = self.q[..self.topology.n_owned].iter().position(|q| !fine(q));
        let finding = bad.map(|c| {
            let rho = self.spatial.gas.density(&self.q[c]);
            (self.topology.numbering.global[c], self.metrics.centre[c], rho)
        });
        agree(self.halo.comm(), finding)
    }

    /// The step becomes the state that later steps start from.
    pub fn accept(&mut self, dt: f64, moved: bool) {
        self.advance_turbulence(dt);
        if self.last_dt != 0.0 && (dt - self.last_dt).abs() > 1e-9 * dt {
            self.first_order_steps = self.first_order_steps.max(1);
        }
        self.last_dt = dt;
        self.first_order_steps = self.first_order_steps.saturating_sub(1);
        self.past.swap(0, 1);
        let [now, _] = &mut self.past;
        now.q.copy_from_slice(&self.q);
        now.volume.copy_from_slice(&self.metrics.volume);
        now.nodes.copy_from_slice(&self.nodes);
        for t in &mut self.through {
            t.past = [t.tie, t.past[0]];
        }
        self.ties_are_new = false;
        std::mem::swap(&mut self.swept, &mut self.swept_before);
        if !moved {
            self.swept_before.fill(0.0);
        }
        self.swept.fill(0.0);
        if let Some(shear) = &mut self.shear {
            shear.accept();
        }
    }

    /// What else the state holds. Collective.
    pub fn extras(&self) -> Extras {
        let gather = |t: &SpalartAllmaras| {
            let cells = self.comm().sum(self.topology.n_owned as f64) as usize;
            [0, 1].map(|k| {
                state::gather(
                    self.comm(),
                    self.topology.numbering.owned(),
                    &t.past[k][..self.topology.n_owned],
                    cells,
                )
            })
        };
        Extras { height: self.shear.as_ref().map(|s| s.height), turbulence: self.turbulence().map(gather) }
    }

    /// Continues with what else a saved state held.
    pub fn restore_extras(&mut self, extras: &Extras) {
        if let (Some(shear), Some(height)) = (&mut self.shear, extras.height) {
            shear.restore(height);
        }
        if let (Some(turbulence), Some(saved)) = (&mut self.turbulence, &extras.turbulence) {
            for (past, saved) in turbulence.past.iter_mut().zip(saved) {
                for (x, &g) in past.iter_mut().zip(&self.topology.numbering.global) {
                    *x = [saved[g as usize]];
                }
            }
            turbulence.value.copy_from_slice(&turbulence.past[0]);
        }
    }

    /// Continues from two saved instants. Collective.
    pub fn restore(
        &mut self,
        past: [Instant<N>; 2],
        last_dt: f64,
        first_order_steps: u32,
    ) -> Result<(), FlowError> {
        self.past = past;
        self.last_dt = last_dt;
        self.first_order_steps = first_order_steps;
        for k in [1, 0] {
            self.nodes.copy_from_slice(&self.past[k].nodes);
            self.metrics.update(&self.topology, &self.halo, &self.nodes);
            self.past[k].volume.copy_from_slice(&self.metrics.volume);
        }
        self.check_volumes()?;
        self.least_squares.update(&self.topology, &self.metrics);
        self.swept.resize(self.topology.face_nodes.len(), 0.0);
        self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
        Metrics::swept(&self.topology, &self.past[1].nodes, &self.past[0].nodes, &mut self.swept_before);
        self.swept.fill(0.0);
        self.q.copy_from_slice(&self.past[0].q);
        self.through.fill(FaceFlow::default());
        self.ties_are_new = true;
        if let Some(turbulence) = &self.turbulence {
            turbulence.eddy(&self.densities(), &mut self.eddy);
        }
        Ok(())
    }

    /// What passed the faces.
    pub fn through(&self) -> &[FaceFlow] {
        &self.through
    }

    /// Continues with what pressure added to the mean momentum through the faces at the
    /// last two instants. Without this it starts from nothing.
    pub fn restore_ties(&mut self, ties: &[[f32; 2]]) {
        for (t, past) in self.through.iter_mut().zip(ties) {
            t.past = *past;
        }
        self.ties_are_new = false;
    }

    /// What the kernels work on.
    pub fn domain(&self) -> Domain<'_> {
        domain!(self)
    }
}

/// A defect of mass acts like the force that would have to undo it: m/s, for a cell of
/// size `h`.
#[inline(always)]
fn mass_weight(h: f64, scheme: &Scheme) -> f64 {
    h * scheme.rate + scheme.floor_squared.sqrt()
}

/// Turns the temperature residual (kg K/s) into a force: c_p / c, m/(s K).
const TEMPERATURE_WEIGHT: f64 = 3.0;
