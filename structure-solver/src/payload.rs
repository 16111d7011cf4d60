//! The payload as a rigid body on its lines, in the falling frame.
//!
//! The nodes where lines are attached move with the body. Body and structure are integrated
//! side by side (Hughes and Liu, J. Appl. Mech. 45, 1978): the body by velocity Verlet, with the
//! forces of the lines at the ends of steps; the structure by its own scheme, with the attachments
//! moved as the body does. That is second order, and stable as long as the body's own frequency
//! on its lines is below 2 over the step, which for a payload on soft lines it is by far.

use std::f64::consts::PI;
use std::io::Write;
use std::path::Path;

use case::{PayloadBody, Scene};
use mesh::StructureMesh;

use crate::dynamics::Dynamics;
use crate::flat::at;
use crate::loops::{Configuration, FaceLoad};
use crate::newton::State;
use crate::rigid::{BodyState, RigidBody};
use crate::state_file::{StateError, agree};
use crate::stream::Stream;
use mesh::geometry::{Point, Vec3};

/// Straight steps of the way of an attachment to the attitude of the release.
const TURN_STEPS: u32 = 64;

/// Largest distance of a held attachment from its place on the body, as a share of the size of body and displacement.
const RIGID: f64 = 1e-6;

/// A rigid body that carries nodes.
pub struct Payload {
    /// Mass and inertia, those of the attachments' nodes included.
    pub body: RigidBody,
    /// Mass without its nodes, kg: they have their weight themselves.
    pub(crate) own_mass: f64,
    /// Principal moments of inertia without its nodes, kg m2.
    own_inertia: Vec3,
    /// Attachments from the centre of mass in the body's axes, m, with their local node.
    arms: Vec<(Vec3, Option<u32>)>,
    /// Centre of mass at the start, m.
    middle: Vec3,
    /// `1/2 rho C A`, kg/m: drag of the air; zero without.
    drag: f64,
    /// The air in the frame.
    pub(crate) air: Stream,
    /// Scratch: forces and accelerations.
    f: Vec<f64>,
    w: Vec<f64>,
}

impl Payload {
    /// The payload of `scene` on the nodes `payload` of `mesh`, for the system of `dynamics`,
    /// with its state where it is first free. `None` where the scene has no body. Collective.
    pub fn new(scene: &Scene, mesh: &StructureMesh, dynamics: &Dynamics) -> Option<(Self, BodyState)> {
        let descent = scene.descent.as_ref()?;
        let b = descent.body.as_ref()?;
        let density = scene.resolved().air.density_kg_m3;
        let drag = descent.payload_drag.as_ref().map_or(0.0, |d| 0.5 * density * d.drag_area_m2);
        let payload =
            Self::on(dynamics, mesh, descent.payload_mass_kg, b.inertia_kg_m2.into(), &b.attachments_m, drag);
        let start =
            BodyState::start(&payload.body, b.initial_velocity_m_s.into(), b.initial_spin_rad_s.into())
                .turned_by(b.initial_rotation_rad().into());
        Some((payload, start))
    }

    /// A body of `mass` (kg) and principal `inertia` (kg m2) whose `arms` (m) are the nodes of
    /// the set `payload`. Collective.
    pub fn on(
        dynamics: &Dynamics,
        mesh: &StructureMesh,
        mass: f64,
        inertia: Vec3,
        arms: &[Point],
        drag: f64,
    ) -> Self {
        let system = &dynamics.system;
        let model = &system.model;
        let nodes = mesh.node_sets.get("payload").map_or(&[][..], Vec::as_slice);
        debug_assert_eq!(nodes.len(), arms.len());
        let first = nodes.first().zip(arms.first());
        let middle =
            first.map_or(Vec3::zeros(), |(n, a)| mesh::geometry::at(&mesh.coords, *n) - Vec3::from(*a));
        let local = |n: &u32| model.numbering.local(u64::from(*n)).map(|i| i as u32);
        let arms: Vec<_> = arms.iter().zip(nodes).map(|(a, n)| (Vec3::from(*a), local(n))).collect();
        // Mass of the attachments' own nodes: on the diagonal, whatever the mass matrix.
        let mut added = [0.0; 4];
        for (a, node) in &arms {
            if let Some(n) = node.filter(|n| (*n as usize) < model.n_owned()) {
                let m = system.diagonal_mass(n as usize);
                added[0] += m;
                (0..3).for_each(|i| added[i + 1] += m * (a.norm().powi(2) - a[i] * a[i]));
            }
        }
        model.comm.sum_slice(&mut added);
        let [m, x, y, z] = added;
        let body = RigidBody { mass: mass + m, inertia: inertia + Vec3::new(x, y, z) };
        let n = 3 * model.n_local();
        let zero = || vec![0.0; n];
        Self {
            body,
            own_mass: mass,
            own_inertia: inertia,
            arms,
            middle,
            drag,
            air: Stream::default(),
            f: zero(),
            w: zero(),
        }
    }

    /// Centre of mass, m.
    pub fn position(&self, s: &BodyState) -> Vec3 {
        self.middle + s.x
    }

    /// Local nodes that it carries, with their places, m.
    pub(crate) fn places<'a>(&'a self, s: &'a BodyState) -> impl Iterator<Item = (usize, Vec3)> + 'a {
        let middle = self.position(s);
        self.arms.iter().filter_map(move |(a, n)| Some((n.as_ref().copied()? as usize, middle + s.turn(*a))))
    }

    /// Drag of the air on it, N.
    pub fn drag(&self, s: &BodyState) -> Vec3 {
        let w = self.air.at(self.position(s).z) - s.v;
        w * (self.drag * w.norm())
    }

    /// Kinetic energy without that of its nodes, J.
    pub fn own_kinetic(&self, s: &BodyState) -> f64 {
        let own = RigidBody { mass: self.own_mass, inertia: self.own_inertia };
        let rate = self.body.rate(s);
        let spin = self.own_inertia.component_mul(&rate);
        own.kinetic(&BodyState { spin, ..*s })
    }

    /// Work of gravity (m/s2) and of the air's drag on its own mass from one state to the next, J.
    pub(crate) fn work(&self, from: &BodyState, to: &BodyState, gravity: Vec3) -> f64 {
        let drag = (self.drag(from) + self.drag(to)) * 0.5;
        (gravity * self.own_mass + drag).dot(&(to.x - from.x))
    }

    /// First half of a step of `h` seconds: velocities, then places. `gravity` is the
    /// acceleration of free fall in the frame, m/s2.
    pub(crate) fn advance(&self, s: &mut BodyState, gravity: Vec3, h: f64) {
        let own = gravity * (self.own_mass / self.body.mass);
        self.body.kick(s, own, 0.5 * h);
        self.body.drift(s, h);
    }

    /// Second half: takes the forces at the new place, which each rank knows of its own nodes:
    /// `pulls` holds local node and force on the body (N). Collective.
    pub(crate) fn finish(
        &self,
        s: &mut BodyState,
        comm: &comm::Comm,
        owned: usize,
        pull: impl Fn(usize) -> Vec3,
        gravity: Vec3,
        h: f64,
    ) {
        let mut sums = [0.0; 6];
        for (a, node) in &self.arms {
            if let Some(n) = node.map(|n| n as usize).filter(|n| *n < owned) {
                let f = pull(n);
                let t = s.turn(*a).cross(&f);
                (0..3).for_each(|i| {
                    sums[i] += f[i];
                    sums[3 + i] += t[i];
                });
            }
        }
        comm.sum_slice(&mut sums);
        s.force = Vec3::new(sums[0], sums[1], sums[2]);
        s.torque = Vec3::new(sums[3], sums[4], sums[5]);
        if self.drag > 0.0 {
            s.force += self.drag(s);
        }
        s.known = true;
        let own = gravity * (self.own_mass / self.body.mass);
        self.body.kick(s, own, 0.5 * h);
    }
}

impl Dynamics {
    /// Puts a rigid payload onto its nodes, from `state` on.
    pub fn carry(&mut self, payload: Payload, state: BodyState) {
        self.accepted.body = Some(state);
        self.payload = Some(payload);
    }

    /// Starts a payload that is released now where its attachments were held: displaced by the mean of their displacements. Collective.
    ///
    /// # Errors
    /// They were not moved as a rigid body: the largest distance, m, of one from its place on the body.
    pub fn start_payload_where_held(&mut self) -> Result<(), f64> {
        let (Some(p), Some(s)) = (&self.payload, &mut self.accepted.body) else { return Ok(()) };
        let (model, u) = (&self.system.model, &self.accepted.u);
        let owned = |n: &usize| *n < model.n_owned();
        let moved: Vec<Vec3> = (p.arms.iter())
            .filter_map(|(a, n)| {
                let n = n.map(|n| n as usize).filter(owned)?;
                Some(at(u, n) - (s.turn(*a) - a))
            })
            .collect();
        let sum: Vec3 = moved.iter().sum();
        let mut sums = [sum[0], sum[1], sum[2], moved.len() as f64];
        model.comm.sum_slice(&mut sums);
        let mean = Vec3::new(sums[0], sums[1], sums[2]) / sums[3].max(1.0);
        let off = moved.iter().map(|d| (d - mean).norm()).fold(0.0, f64::max);
        let off = model.comm.max(off);
        let size = p.arms.iter().map(|(a, _)| a.norm()).fold(mean.norm(), f64::max);
        if off > RIGID * size {
            return Err(off);
        }
        s.x = mean;
        Ok(())
    }

    /// Puts the attachments of a payload that is released now where its attitude has them.
    pub fn place_payload(&mut self) {
        let (Some(p), Some(s)) = (&self.payload, &self.accepted.body) else { return };
        for (n, x) in p.places(s) {
            let reference = &self.system.model.reference[3 * n..3 * n + 3];
            (0..3).for_each(|c| self.accepted.u[3 * n + c] = x[c] - reference[c]);
        }
    }

    /// Turns the attachments of a payload that is not free yet to the attitude of its release, along half a cosine within
    /// `span` seconds. Collective.
    pub fn turn_payload(&mut self, body: &PayloadBody, nodes: &[u32], span: f64) {
        let whole = Vec3::from(body.initial_rotation_rad());
        let upright = BodyState::start(
            &RigidBody { mass: 1.0, inertia: Vec3::repeat(1.0) },
            Vec3::zeros(),
            Vec3::zeros(),
        );
        let time: Vec<f64> = (0..=TURN_STEPS).map(|k| span * f64::from(k) / f64::from(TURN_STEPS)).collect();
        for (node, arm) in nodes.iter().zip(&body.attachments_m) {
            let arm = Vec3::from(*arm);
            let at = |k: u32| {
                let share = 0.5 * (1.0 - (PI * f64::from(k) / f64::from(TURN_STEPS)).cos());
                (upright.turned_by(whole * share).turn(arm) - arm).into()
            };
            let displacement: Vec<[f64; 3]> = (0..=TURN_STEPS).map(at).collect();
            self.prescribe(&[*node], [true; 3], &time, &displacement);
        }
    }

    /// The rigid payload, if there is one.
    pub fn payload(&self) -> Option<&Payload> {
        self.payload.as_ref()
    }

    /// Forces of the lines on the body at the start of a motion. Collective.
    pub(crate) fn balance_payload(&mut self, load: FaceLoad<'_>, gravity: Vec3) {
        let Some(mut p) = self.payload.take() else { return };
        if let Some(mut s) = self.current.body.filter(|s| !s.known) {
            self.system.set_step(f64::INFINITY);
            self.pulls(&mut p, false, load, gravity);
            let (owned, comm) = (self.system.model.n_owned(), self.system.comm().clone());
            p.finish(&mut s, &comm, owned, |n| -at(&p.f, n), gravity, 0.0);
            self.current.body = Some(s);
        }
        self.payload = Some(p);
    }

    /// Ends an implicit step of the body: the structure stands at `next`. Collective.
    pub(crate) fn finish_payload(&mut self, mut s: BodyState, load: FaceLoad<'_>, gravity: Vec3, h: f64) {
        let mut p = self.payload.take().expect("the caller advanced it");
        self.pulls(&mut p, true, load, gravity);
        let (owned, comm) = (self.system.model.n_owned(), self.system.comm().clone());
        p.finish(&mut s, &comm, owned, |n| -at(&p.f, n), gravity, h);
        self.next.body = Some(s);
        self.payload = Some(p);
    }

    /// Internal minus external forces with inertia, N, on `next` or `current`, into `p.f`: on
    /// an attachment its own inertia is left to the body.
    fn pulls(&mut self, p: &mut Payload, next: bool, load: FaceLoad<'_>, gravity: Vec3) {
        let State { u, v, a, .. } = if next { &self.next } else { &self.current };
        for i in 0..self.x.len() {
            self.x[i] = self.system.model.reference[i] + u[i];
            p.w[i] = a[i] + self.damping * v[i] - gravity[i % 3];
        }
        for (_, n) in &p.arms {
            if let Some(n) = n.map(|n| n as usize) {
                (0..3).for_each(|c| p.w[3 * n + c] = -gravity[c]);
            }
        }
        self.system.forces(Configuration::only(&self.x), load, &mut p.f);
        self.system.add_mass_product(&p.w, &mut p.f);
    }
}

const FILE: &str = "payload.bin";
const KIND: [u8; 8] = *b"ripbody\0";
const VERSION: u32 = 1;

/// Writes the state of the body next to that of the nodes. Collective.
pub(crate) fn save(comm: &comm::Comm, state: &BodyState, folder: &Path) -> Result<(), StateError> {
    let save = || archive::save(&folder.join(FILE), KIND, VERSION, state).map(|_| ());
    let result = if comm.is_root() { save() } else { Ok(()) };
    agree(comm, result.map_err(StateError::from))
}

/// Reads what an earlier stage wrote; `None` where the body was not free in it.
pub(crate) fn load(folder: &Path) -> Result<Option<BodyState>, StateError> {
    let path = folder.join(FILE);
    // Before it was an archive, the file was the state in compact form.
    let earlier = |bytes: &[u8]| archive::codec::compact::decode(bytes).ok();
    let state = archive::if_present(archive::load_or_earlier(&path, KIND, VERSION, earlier))?;
    match state {
        Some(state) if !sound(&state) => {
            Err(archive::Error::content(&path, "it holds numbers that are no motion of a body").into())
        }
        state => Ok(state),
    }
}

/// Whether all numbers are such, and the turn is one.
fn sound(s: &BodyState) -> bool {
    let vectors = [s.x, s.v, s.spin, s.force, s.torque];
    let length: f64 = s.q.iter().map(|q| q * q).sum();
    vectors.iter().flatten().all(|x| x.is_finite()) && (length - 1.0).abs() < 1e-6
}

/// `payload.csv` of a stage: a row for each accepted window.
pub(crate) struct Log(std::fs::File);

impl Log {
    pub(crate) fn create(folder: &Path) -> std::io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let mut file = std::fs::File::create(folder.join("payload.csv"))?;
        writeln!(
            file,
            "time_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,qw,qx,qy,qz,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s,tilt_rad,force_x_n,force_y_n,force_z_n"
        )?;
        Ok(Self(file))
    }

    /// Appends to a file that was cut back to what is known.
    pub(crate) fn resume(folder: &Path) -> std::io::Result<Self> {
        match std::fs::File::options().append(true).open(folder.join("payload.csv")) {
            Ok(file) => Ok(Self(file)),
            Err(_) => Self::create(folder),
        }
    }

    pub(crate) fn push(&mut self, time: f64, p: &Payload, s: &BodyState) -> std::io::Result<()> {
        let (position, rate) = (p.position(s), p.body.rate(s));
        let parts: [&[f64]; 6] =
            [position.as_slice(), s.v.as_slice(), &s.q, rate.as_slice(), &[s.tilt()], s.force.as_slice()];
        let cells: Vec<String> = parts.iter().flat_map(|p| p.iter()).map(|v| format!("{v:.8e}")).collect();
        writeln!(self.0, "{time:.8e},{}", cells.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_tests::{BAG, STAGE, chain, of_mesh, scene as scene_of};

    const ARMS: [Vec3; 2] = [Vec3::new(0.3, -0.2, 0.5), Vec3::new(-0.1, 0.4, 0.2)];
    const MASS: f64 = 2.0;
    const INERTIA: Vec3 = Vec3::new(0.5, 0.8, 1.1);
    const NODES: [f64; 2] = [0.2, 0.3];
    const DRAG: f64 = 0.6;

    /// A body on two masses between which there is hardly a line; its centre of mass is at (1, 2, 3).
    fn body() -> (Payload, BodyState) {
        let mut mesh = chain(ARMS.map(|a| (Vec3::new(1.0, 2.0, 3.0) + a).into()).to_vec(), vec![0, 1]);
        mesh.point_masses = vec![(0, NODES[0]), (1, NODES[1])];
        mesh.node_sets.insert("payload".into(), vec![0, 1]);
        let d = of_mesh(&scene_of(BAG, "density_kg_m3 = 1e-12", STAGE), mesh.clone());
        let mut payload = Payload::on(&d, &mesh, MASS, INERTIA, &ARMS.map(Into::into), DRAG);
        payload.air = Stream::uniform(Vec3::new(0.5, 0.1, -0.3));
        let mut state = BodyState::start(&payload.body, Vec3::new(0.4, -0.7, 1.1), Vec3::new(0.6, -0.9, 0.4));
        // A turn by 1 rad about (2, 1, 2)/3.
        let (s, c) = 0.5f64.sin_cos();
        state.q = [c, s * 2.0 / 3.0, s / 3.0, s * 2.0 / 3.0];
        state.x = Vec3::new(0.1, 0.2, -0.1);
        (payload, state)
    }

    /// Mass and moments of inertia hold those of the attachments: `m (a.a - a_i a_i)` each.
    #[test]
    fn attachments_count_with_their_masses() {
        let (p, s) = body();
        assert!((p.body.mass - 2.5).abs() < 1e-9);
        for i in 0..3 {
            let more: f64 = ARMS.iter().zip(NODES).map(|(a, m)| m * ((*a).dot(a) - a[i] * a[i])).sum();
            assert!((p.body.inertia[i] - INERTIA[i] - more).abs() < 1e-9, "{i}");
        }
        // Rodrigues' formula gives their places.
        let axis = Vec3::new(2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0);
        let (sin, cos) = 1f64.sin_cos();
        let turned = |a: Vec3| {
            let across = a * cos + axis.cross(&a) * sin;
            across + axis * ((1.0 - cos) * axis.dot(&a))
        };
        for (arm, (_, place)) in ARMS.iter().zip(p.places(&s)) {
            let exact = Vec3::new(1.1, 2.2, 2.9) + turned(*arm);
            assert!((place - exact).norm() < 1e-14, "{place:?} {exact:?}");
            assert!((s.turn_back(turned(*arm)) - *arm).norm() < 1e-14);
        }
        assert!((s.tilt() - turned(Vec3::new(0.0, 0.0, 1.0))[2].acos()).abs() < 1e-14);
    }

    /// The body's kinetic energy is its own and that of its attachments, which move as points of it. Their
    /// products of inertia are left out, so the body turns about one of its axes.
    #[test]
    fn kinetic_energies_add_up() {
        let (p, mut s) = body();
        for axis in 0..3 {
            s.spin = Vec3::zeros();
            s.spin[axis] = p.body.inertia[axis] * 0.7;
            let own = 0.5 * MASS * s.v.dot(&s.v) + 0.5 * INERTIA[axis] * 0.49;
            assert!((p.own_kinetic(&s) - own).abs() < 1e-14, "{axis}");
            // At rest but for the turn: the attachments' share of the translation has a mixed term.
            let still = BodyState { v: Vec3::zeros(), ..s };
            let points: f64 = ARMS
                .iter()
                .zip(NODES)
                .map(|(a, m)| 0.5 * m * p.body.velocity_of(&still, *a).norm().powi(2))
                .sum();
            let whole = p.body.kinetic(&still);
            assert!((p.own_kinetic(&still) + points - whole).abs() < 1e-9, "{axis}: {whole}");
        }
    }

    /// Drag `k |w| w` of the air past it; its mean and the own weight do work on the way.
    #[test]
    fn drag_and_weight_do_their_work() {
        let (p, from) = body();
        let w = Vec3::new(0.1, 0.8, -1.4);
        let exact = w.map(|c| DRAG * (0.01f64 + 0.64 + 1.96).sqrt() * c);
        assert!((p.drag(&from) - exact).norm() < 1e-14, "{:?}", p.drag(&from));
        let to = BodyState { x: Vec3::new(0.4, 0.1, 0.2), v: Vec3::new(0.5, 0.1, -2.3), ..from };
        // There the air passes with (0, 0, 2): 2.4 N.
        let mean = [0.5 * exact[0], 0.5 * exact[1], 0.5 * (exact[2] + 2.4)];
        let moved = [0.3, -0.1, 0.3];
        let gravity = Vec3::new(0.2, 0.0, -9.81);
        let work: f64 = (0..3).map(|i| (MASS * gravity[i] + mean[i]) * moved[i]).sum();
        assert!((p.work(&from, &to, gravity) - work).abs() < 1e-13);
    }

    /// The attachments of a held payload end where those of the released one start.
    #[test]
    fn turned_attachments_meet_the_released_body() {
        let mut mesh = chain(ARMS.map(|a| (Vec3::new(1.0, 2.0, 3.0) + a).into()).to_vec(), vec![0, 1]);
        mesh.node_sets.insert("payload".into(), vec![0, 1]);
        let mut d = of_mesh(&scene_of(BAG, "density_kg_m3 = 1e-12", STAGE), mesh.clone());
        let arms = ARMS.map(Into::into);
        let turned = PayloadBody {
            inertia_kg_m2: INERTIA.into(),
            attachments_m: arms.to_vec(),
            initial_velocity_m_s: [0.0; 3],
            initial_spin_rad_s: [0.0; 3],
            initial_rotation_deg: [20.0, -35.0, 10.0],
        };
        d.turn_payload(&turned, &[0, 1], 0.4);
        let payload = Payload::on(&d, &mesh, MASS, INERTIA, &arms, 0.0);
        let state = BodyState::start(&payload.body, Vec3::zeros(), Vec3::zeros())
            .turned_by(turned.initial_rotation_rad().into());
        d.carry(payload, state);
        d.place_payload();
        for t in [0.4, f64::INFINITY] {
            for (i, u) in d.motions.iter().flat_map(|m| m.values(t)) {
                assert!((u - d.accepted.u[i as usize]).abs() < 1e-14, "{t} {i}");
            }
        }
        assert!(d.accepted.u.iter().any(|u| u.abs() > 0.1));
        // Half a cosine: at half the time half the angle, at the start no velocity.
        let half: Vec3 = Vec3::from(turned.initial_rotation_rad()) * 0.5;
        let exact = state.turned_by(half).turn(ARMS[0]) - ARMS[0];
        let found: Vec<f64> = d.motions[0].values(0.2).map(|(_, u)| u).collect();
        assert!((Vec3::from_column_slice(&found) - exact).norm() < 1e-14);
        let first: f64 = d.motions[0].values(1e-3).map(|(_, u)| u * u).sum::<f64>().sqrt();
        assert!(first < 1e-3 * exact.norm(), "{first}");
    }

    /// A held payload that a motion displaced is released there; attachments that were not moved together are refused.
    #[test]
    fn released_body_starts_where_it_was_held() {
        let mut mesh = chain(ARMS.map(|a| (Vec3::new(1.0, 2.0, 3.0) + a).into()).to_vec(), vec![0, 1]);
        mesh.node_sets.insert("payload".into(), vec![0, 1]);
        let mut d = of_mesh(&scene_of(BAG, "density_kg_m3 = 1e-12", STAGE), mesh.clone());
        let payload = Payload::on(&d, &mesh, MASS, INERTIA, &ARMS.map(Into::into), 0.0);
        let turn = Vec3::new(0.1, -0.4, 0.2);
        let state = BodyState::start(&payload.body, Vec3::zeros(), Vec3::zeros()).turned_by(turn);
        d.carry(payload, state);
        let way = Vec3::new(0.3, 0.0, -0.2);
        for (n, arm) in ARMS.into_iter().enumerate() {
            let u = way + state.turn(arm) - arm;
            d.accepted.u[3 * n..][..3].copy_from_slice(u.as_slice());
        }
        let held = d.accepted.u.clone();
        d.start_payload_where_held().expect("a rigid motion");
        assert!((d.accepted.body.expect("a body").x - way).norm() < 1e-14);
        d.place_payload();
        assert!(d.accepted.u.iter().zip(&held).all(|(a, b)| (a - b).abs() < 1e-14));
        d.accepted.u[0] += 0.01;
        let off = d.start_payload_where_held().expect_err("no rigid motion");
        assert!((off - 0.005).abs() < 1e-9, "{off}");
    }

    /// In a wind by height it meets the air at its centre of mass: at 3 - 0.1 m in a frame that is 40 m above ground.
    #[test]
    fn drag_is_that_of_the_height() {
        let (mut p, s) = body();
        let profile = case::WindProfile::Linear { wind: [10.0, 0.0, 0.0], reference: 42.9, slope: 0.5 };
        let frame = Vec3::new(0.0, 0.0, -4.0);
        p.air = Stream::new(case::AirByHeight::default().with_profile(profile), 40.0, frame);
        let w = Vec3::new(10.0, 0.0, 4.0) - s.v;
        assert!((p.drag(&s) - w * (DRAG * w.norm())).norm() < 1e-12, "{:?}", p.drag(&s));
    }

    /// Both halves of a step under forces on both attachments, whose own weight is theirs: force, torque about
    /// the centre of mass, and the velocities that they leave.
    #[test]
    fn a_step_has_the_impulses_of_its_forces() {
        let (p, start) = body();
        let (h, gravity) = (0.1, Vec3::new(0.2, 0.0, -9.81));
        let own = gravity * (MASS / p.body.mass);
        let mut s = BodyState { spin: Vec3::zeros(), ..start };
        p.advance(&mut s, gravity, h);
        let v = start.v + (own * (0.5 * h));
        assert!((s.v - v).norm() < 1e-14);
        assert!((s.x - (start.x + (v * h))).norm() < 1e-14);
        let pulls = [Vec3::new(1.0, -2.0, 3.0), Vec3::new(0.5, 0.7, -1.1)];
        let still = BodyState { v: p.air.at(0.0), ..s };
        for mut s in [s, still] {
            let (before, air) = (s, p.drag(&s));
            p.finish(&mut s, &comm::Comm::solo(), 2, |n| pulls[n], gravity, h);
            let force = air + (pulls[0] + pulls[1]);
            assert!((s.force - force).norm() < 1e-13, "{:?} {force:?}", s.force);
            let torque = s.turn(ARMS[0]).cross(&pulls[0]) + s.turn(ARMS[1]).cross(&pulls[1]);
            assert!((s.torque - torque).norm() < 1e-13, "{:?} {torque:?}", s.torque);
            let v = before.v + ((own + (force * (1.0 / p.body.mass))) * (0.5 * h));
            assert!((s.v - v).norm() < 1e-13);
            assert!((s.turn(s.spin) - (torque * (0.5 * h))).norm() < 1e-13);
        }
    }

    /// A state that was kept is one only with finite numbers and a turn of length one.
    #[test]
    fn damaged_states_are_seen() {
        let (_, good) = body();
        assert!(sound(&good));
        let of_length = |square: f64| BodyState { q: good.q.map(|q| q * square.sqrt()), ..good };
        for (by, right) in [(0.9e-6, true), (-0.9e-6, true), (1.1e-6, false), (-1.1e-6, false)] {
            assert_eq!(sound(&of_length(1.0 + by)), right, "{by}");
        }
        assert!(!sound(&BodyState { torque: Vec3::new(0.0, f64::NAN, 0.0), ..good }));
        assert!(!sound(&BodyState { x: Vec3::new(f64::INFINITY, 0.0, 0.0), ..good }));
    }
}
