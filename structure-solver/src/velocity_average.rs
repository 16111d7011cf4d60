//! Agreement of the structure's velocity with the one that the flow sees.

use case::{Scene, Scheme, StageKind};
use mesh::StructureMesh;

use crate::loops::FaceLoad;
use crate::newton::State;
use crate::system::System;

/// Draws the velocity of the fabric along its normal, at the end of a coupled window,
/// towards the mean velocity over the window.
///
/// The flow knows the canopy at the ends of windows only. Several substeps end a
/// window with a velocity $`v`$ of their own, and where the fabric is much lighter than
/// the air it moves, nothing holds it to the motion that the flow sees: $`v`$ alternates
/// from window to window, undamped. With
/// $`v \leftarrow v + \chi\, n\, n \cdot ((x^{n+1} - x^n) / \Delta t - v)`$ this dies out.
///
/// Only the part along the normal $`n`$ may be drawn. Linear analysis (one mode, the
/// coupler's mean load, added mass $`\mu`$ times the fabric's, frequency $`\omega`$ of the dry
/// fabric) gives the largest amplification of any mode in a window for $`\chi`$ = 1/2:
///
/// | $`\mu`$ | 0.001 | 0.01 | 0.1 to 2 | 10 | 50 |
/// |---|---|---|---|---|---|
/// | largest | 1.053 | 1.047 | 1.000 | 1.0004 | 1.0005 |
/// | at $`\omega \Delta t`$ | 3.32 | 3.32 | | 0.70 | 1.44 |
///
/// So modes that the air does not hold (in the plane of the fabric, lines) and that turn
/// a little over half a period in a window would be pumped, alternating, by 5 % in each.
/// Where a mode has the share $`\varphi^2`$ of its energy along the normal, it meets
/// $`\varphi^2 \mu`$ and $`\varphi^2 \chi`$: no such mode grows by more than 1.0005.
///
/// The price is a first-order error in the inertia of the *fabric* (up to a third of
/// its mass), which is small relative to that of the air where this is needed. Without a choice of
/// the scene $`\chi`$ falls with the air's share (`fitting`). In an immersed flow, which takes
/// the mean velocity itself, no mode grows without the average (decision 80), but none dies out soon either: a
/// tenth of that share is enough, by which the fabric seems a fortieth heavier (decision 85).
#[derive(Clone, Debug)]
pub struct VelocityAverage {
    weight: f64,
    /// One pascal on each face, `[faces]`: its nodal forces are area vectors.
    unit: Vec<f64>,
    /// Positions, m, and area vectors, m2, `[n_local][3]`.
    x: Vec<f64>,
    areas: Vec<f64>,
}

impl VelocityAverage {
    /// As the scene couples: only implicit windows have a converged velocity.
    pub fn of(scene: &Scene, stage: usize, mesh: &StructureMesh) -> Option<Self> {
        let coupled = scene.stages[stage].kind == StageKind::Coupled;
        let immersed = scene.flow.as_ref().is_some_and(case::Flow::is_immersed);
        let weight = scene.coupling.velocity_average.unwrap_or_else(|| {
            let sides = if scene.is_one_sided() { 0.5 } else { 1.0 };
            let air = sides * scene.resolved().canopy_air.density_kg_m3;
            let fabric = mesh.mean_areal_mass(scene);
            let share = fitting(mass_ratio(air, fabric, mesh.fabric_area(|_| true)));
            if immersed { IMMERSED * share } else { share }
        });
        let called_for = coupled && scene.coupling.scheme == Scheme::Implicit && weight > LEAST;
        called_for.then(|| Self::new(weight, mesh.faces.len()))
    }

    pub(crate) fn new(weight: f64, faces: usize) -> Self {
        Self { weight, unit: vec![1.0; faces], x: Vec::new(), areas: Vec::new() }
    }

    /// Changes the velocity of `to`, at the end of a window of length `dt` (s) that
    /// began at `from`. Collective.
    pub fn apply(&mut self, dt: f64, system: &System, from: &State, to: &mut State) {
        let reference = &system.model.reference;
        self.x.clear();
        self.x.extend(reference.iter().zip(&to.u).map(|(x, u)| x + u));
        self.areas.resize(self.x.len(), 0.0);
        system.pressed(&self.x, FaceLoad { pressure: &self.unit, traction: &[] }, &mut self.areas);
        let owned = 3 * system.model.n_owned();
        let (v, _) = to.v.as_chunks_mut::<3>();
        let areas = self.areas[..owned].as_chunks::<3>().0;
        let (before, after) = (from.u.as_chunks::<3>().0, to.u.as_chunks::<3>().0);
        for (((v, area), u0), u1) in v.iter_mut().zip(areas).zip(before).zip(after) {
            draw(self.weight, dt, u0, u1, area, v);
        }
        system.model.halo.exchange(&mut to.v, 3);
    }
}

/// Part of the share that an immersed flow needs.
const IMMERSED: f64 = 0.1;

/// Share below which an average is none: it would count as less than 0.1 % of the fabric.
const LEAST: f64 = 1e-3;

/// Added mass over fabric mass of the first mode of a square panel of this area (m2), from
/// `air` (kg/m3; half of it with air on one side only) on both sides and `fabric` (kg/m2): $`2 \rho / (k m)`$, $`k = \sqrt 2 \pi / a`$.
fn mass_ratio(air: f64, fabric: f64, area: f64) -> f64 {
    2.0 * air * area.sqrt() / (std::f64::consts::SQRT_2 * std::f64::consts::PI * fabric)
}

/// $`\chi`$ for air that weighs `mu` times the fabric: one half where the velocity alternates,
/// nothing where the fabric's inertia counts. From about 10 on it saves iterations,
/// and only far above windows fail without it (docs/records/stability.md).
fn fitting(mu: f64) -> f64 {
    0.5 * mu * mu / (mu * mu + 100.0)
}

/// Velocity `v` of a node that went from `u0` to `u1` in `dt`; nodes of lines have no
/// `area` and keep theirs.
fn draw(weight: f64, dt: f64, u0: &[f64; 3], u1: &[f64; 3], area: &[f64; 3], v: &mut [f64; 3]) {
    let square: f64 = area.iter().map(|a| a * a).sum();
    if square == 0.0 {
        return;
    }
    let miss: f64 = (0..3).map(|i| area[i] * ((u1[i] - u0[i]) / dt - v[i])).sum();
    (0..3).for_each(|i| v[i] += weight * miss / square * area[i]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(v: [f64; 3], u1: [f64; 3], area: [f64; 3]) -> [f64; 3] {
        let mut v = v;
        draw(0.5, 0.1, &[0.0; 3], &u1, &area, &mut v);
        v
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-14)
    }

    #[test]
    fn steady_motion_is_kept_and_an_alternation_along_the_normal_is_halved() {
        let normal = [0.0, 0.6, 0.8].map(|n| 0.3 * n);
        assert!(near(drawn([2.0, 3.0, 1.0], [0.2, 0.3, 0.1], normal), [2.0, 3.0, 1.0]));
        assert!(near(drawn([0.0, 0.6, 0.8], [0.0; 3], normal), [0.0, 0.3, 0.4]));
    }

    /// Without a choice of the scene a fitted canopy has the average, an immersed one a tenth of it.
    #[test]
    fn immersed_canopies_have_a_tenth_of_the_average() {
        let load = |file: &str| {
            let cases = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../cases");
            case::load(&cases.join(file)).expect("a scene of the repository")
        };
        let weight = |scene: &Scene| {
            let stage =
                scene.stages.iter().position(|s| s.kind == StageKind::Coupled).expect("a coupled stage");
            let mesh = mesh::structure_mesh(scene).expect("a mesh");
            VelocityAverage::of(scene, stage, &mesh).map_or(0.0, |a| a.weight)
        };
        assert!(weight(&load("square-drop/scene.toml")) > 0.4);
        let mut immersed = load("atps-opening/scene.toml");
        assert!((weight(&immersed) - 0.05).abs() < 1e-3, "{}", weight(&immersed));
        immersed.coupling.velocity_average = Some(0.3);
        assert_eq!(weight(&immersed), 0.3);
    }

    /// One mode of fabric and air in a coupled window of unit length, fabric of unit mass: exact between the ends under a constant load.
    #[derive(Clone, Copy)]
    struct Mode {
        /// Added mass over the fabric's.
        mu: f64,
        /// Angular frequency without air times the window.
        angle: f64,
        /// Share of the average.
        share: f64,
        /// The average draws to a velocity of second order instead of the mean of the window.
        second_order: bool,
        /// The air takes the mean velocity, and its load at the end acts throughout; else BDF2 and the mean load.
        immersed: bool,
    }

    impl Mode {
        /// Largest growth in a window, from a start that has all modes of the recursion.
        fn growth(self) -> f64 {
            let (c, s) = (self.angle.cos(), self.angle.sin());
            let ([mut x, mut v, mut before], mut p, mut u) = ([0.3, 0.7, -0.2], [0.4, -0.1], [0.5, 0.2]);
            let ([a, b, e], mut logarithm) =
                (if self.immersed { [1.0, 0.0, 0.0] } else { [9.0 / 16.0, 3.0 / 8.0, 1.0 / 16.0] }, 0.0);
            for window in 0..6000 {
                let mean = |x1: f64| x1 - x;
                let bdf2 = |x1: f64| 1.5 * x1 - 2.0 * x + 0.5 * before;
                let seen = |x1: f64| if self.immersed { mean(x1) } else { bdf2(x1) };
                let load = |x1: f64| {
                    let rate = if self.immersed {
                        seen(x1) - u[0]
                    } else {
                        1.5 * seen(x1) - 2.0 * u[0] + 0.5 * u[1]
                    };
                    -self.mu * rate
                };
                let applied = |x1: f64| a * load(x1) + b * p[0] + e * p[1];
                let (free, by_load) = (c * x + s / self.angle * v, (1.0 - c) / (self.angle * self.angle));
                // The load is linear in the displacement at the end.
                let slope = applied(1.0) - applied(0.0);
                let x1 = (free + by_load * applied(0.0)) / (1.0 - by_load * slope);
                let own = c * v - self.angle * s * x + s / self.angle * applied(x1);
                let drawn = if self.second_order { bdf2(x1) } else { mean(x1) };
                let next = [x1, own + self.share * (drawn - own), x];
                (p, u) = ([load(x1), p[0]], [seen(x1), u[0]]);
                [x, v, before] = next;
                let size = [x, v, before, p[0], p[1], u[0], u[1]].iter().map(|y| y * y).sum::<f64>().sqrt();
                logarithm += if window < 3000 { 0.0 } else { size.ln() };
                for y in [&mut x, &mut v, &mut before].into_iter().chain(&mut p).chain(&mut u) {
                    *y /= size;
                }
            }
            (logarithm / 3000.0).exp()
        }
    }

    /// Largest growth over the frequencies without air.
    fn largest(mode: Mode) -> f64 {
        (1..240).map(|k| Mode { angle: 0.05 * f64::from(k), ..mode }.growth()).fold(0.0, f64::max)
    }

    /// The linear analysis of decision 80: without the average no mode grows in either flow. Drawn to the mean, modes without added mass grow by 1.053 and the others less; drawn to a
    /// velocity of second order, both grow more.
    #[test]
    fn no_mode_of_an_immersed_canopy_grows_without_the_average() {
        let mode = Mode { mu: 0.0, angle: 0.0, share: 0.0, second_order: false, immersed: true };
        for mu in [0.001, 0.1, 2.0, 50.0] {
            for immersed in [true, false] {
                let growth = largest(Mode { mu, immersed, ..mode });
                assert!(growth < 1.0005, "{mu} {immersed}: {growth}");
            }
        }
        let drawn =
            |mu, second_order, immersed| largest(Mode { mu, share: 0.5, second_order, immersed, ..mode });
        for immersed in [true, false] {
            assert!((drawn(0.001, false, immersed) - 1.053).abs() < 1e-3);
            assert!((drawn(0.001, true, immersed) - 1.154).abs() < 1e-3);
            assert!(drawn(10.0, false, immersed) < 1.001);
        }
        assert!((drawn(0.5, true, false) - 1.0143).abs() < 5e-4);
        // A tenth of it: modes without added mass grow by 0.3 %, those of the fabric along its normal not at all.
        let tenth = |mu| largest(Mode { mu, share: 0.05, ..mode });
        assert!((tenth(0.001) - 1.0029).abs() < 5e-4 && tenth(2.0) < 1.0005 && tenth(50.0) < 1.0005);
    }

    #[test]
    fn heavy_fabric_keeps_its_inertia() {
        // The ATPS: 140 m2 of 0.0373 kg/m2 in air; a panel of steel.
        let canopy = fitting(mass_ratio(1.225, 0.0373, 139.9));
        let steel = fitting(mass_ratio(1.225, 7.8, 1.0));
        assert!((canopy - 0.5).abs() < 2e-3 && steel < LEAST, "{canopy} {steel}");
    }

    #[test]
    fn motion_in_the_plane_and_lines_are_left_alone() {
        assert!(near(drawn([2.0, -1.0, 0.0], [0.0; 3], [0.0, 0.0, 0.5]), [2.0, -1.0, 0.0]));
        assert!(near(drawn([2.0, -1.0, 4.0], [0.0; 3], [0.0; 3]), [2.0, -1.0, 4.0]));
    }

    /// A plane sheet that goes from one place to another: each node's velocity along the sheet's normal comes half
    /// way to the mean over the window, and that in its plane stays. The line's far end keeps its own.
    #[test]
    fn a_sheet_is_drawn_along_its_normal() {
        use crate::elements::{cable, mass::MassMatrix};
        use crate::loops::{ElementLoop, Elements};
        use crate::materials::{Elastic, StVenantKirchhoff};
        let normal = [0.0, -0.6, 0.8];
        let mesh = StructureMesh {
            coords: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.8, 0.6], [0.0, 0.8, 0.6], [0.0, 0.0, 1.0]],
            n_canopy: 4,
            faces: vec![[0, 1, 2, 3]],
            face_panel: vec![0],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_face: vec![0, 0],
            cables: vec![mesh::Cable {
                nodes: [0, 4],
                rest_length: 1.0,
                kind: mesh::CableKind::SuspensionLine,
                line: 0,
                share: 1.0,
                group: None,
            }],
            ..Default::default()
        };
        let model = crate::model::Model::new(&comm::Comm::solo(), &mesh, &[0; 5]).expect("a good mesh");
        let fabric = Elements::triangles(&model, Elastic(StVenantKirchhoff::isotropic(1.0, 0.3)), 0.1, 1.0);
        let law = cable::TwoWay { youngs_modulus: 1.0 };
        let line = Elements::cables(&model, cable::Elastic { law, offset: 0.0 }, 0.1, 1.0);
        let loops: Vec<Box<dyn ElementLoop>> = vec![Box::new(fabric), Box::new(line)];
        let system = System::new(model, loops, MassMatrix::Consistent);
        let (mut from, mut to) = (State::rest(5), State::rest(5));
        let (v, moved) = ([0.3, -0.2, 0.5], [0.02, 0.03, 0.07]);
        for i in 0..15 {
            from.u[i] = 0.01 * (i % 3) as f64;
            to.u[i] = from.u[i] + moved[i % 3];
            to.v[i] = v[i % 3];
        }
        VelocityAverage::new(0.5, 1).apply(0.1, &system, &from, &mut to);
        let miss: f64 = (0..3).map(|c| normal[c] * (moved[c] / 0.1 - v[c])).sum();
        for i in 0..15 {
            let exact = v[i % 3] + if i < 12 { 0.5 * miss * normal[i % 3] } else { 0.0 };
            assert!((to.v[i] - exact).abs() < 1e-13, "{i}: {} {exact}", to.v[i]);
        }
        assert!(miss.abs() > 0.1);
    }

    /// Added mass of the first mode of a square panel, `2 rho / (k m)`, and the share that goes with it.
    #[test]
    fn the_share_has_its_closed_form() {
        let exact = 2.0 * 1.225 / (0.5 * 2f64.sqrt() * std::f64::consts::PI * 0.04);
        assert!((mass_ratio(1.225, 0.04, 4.0) / exact - 1.0).abs() < 1e-14);
        assert!((fitting(10.0) - 0.25).abs() < 1e-15 && (fitting(5.0) - 0.1).abs() < 1e-15);
    }
}
