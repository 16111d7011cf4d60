//! Closed-form solution of the model problem: free vibration of a prestressed panel in air.
//!
//! A panel under the tension $`T`$ (N/m), fixed along its edges, is released from its static shape
//! under a pressure $`p`$. With open sides (gauge pressure zero there) its modes
//! $`\sin(a x)\sin(b y)`$, $`k^2=a^2+b^2`$, are also those of the potential of incompressible air
//! in the box, $`\phi\sim\sin(ax)\sin(by)\,g(z)`$ with $`g''=k^2g`$. A layer of height $`H`$ adds the
//! mass per area
//!
//! ```math
//! m_a = \frac{\rho}{k}\coth kH \ \text{(closed)}, \qquad m_a = \frac{\rho}{k}\tanh kH\ \text{(open)},
//! ```
//!
//! from $`g=\cosh k(H-z)`$, $`\phi_z(H)=0`$, and $`g=\sinh k(H-z)`$, $`\phi(H)=0`$. The modes are
//! uncoupled: $`w_k(t)=w_k(0)\cos\omega_k t`$, $`\omega_k^2=Tk^2/(m+m_a)`$. Guided sides (a strip)
//! have modes along x alone.

use std::f64::consts::PI;

use case::{BoxSides, Canopy, Condition, PanelEdges, Scene};

/// Number of odd modes along each direction; the truncated ones carry 1e-5 of the volume.
const MODES: usize = 8;

/// One mode of the panel.
#[derive(Clone, Copy, Debug)]
struct Mode {
    /// Angular frequency, 1/s.
    omega: f64,
    /// Initial volume under the panel, m3.
    volume: f64,
    /// Amplitude squared times area over its mean square, m4: doubles as mass per (kg/m2).
    weight: f64,
    /// $`Tk^2`$, N/m3.
    stiffness: f64,
}

/// The exact vibration of a scene's panel.
#[derive(Clone, Debug)]
pub struct Exact {
    modes: Vec<Mode>,
    /// Mass of the fabric per area, kg/m2.
    fabric: f64,
    /// Added mass of the first mode per area, kg/m2.
    pub added: f64,
}

/// Whether a side of the box is closed to the air. Conditions without a closed-form solution are an error.
fn closed(side: Condition) -> Result<bool, String> {
    match side {
        Condition::Slip | Condition::Symmetry => Ok(true),
        Condition::Outlet => Ok(false),
        _ => Err("sides must be \"slip\", \"symmetry\" or \"outlet\" for a closed-form solution".into()),
    }
}

/// Panel and air have the same modes only if fixed edges lie on open sides and guided edges on closed sides.
fn check_sides(sides: &BoxSides, held: PanelEdges) -> Result<(), String> {
    let open = |side| closed(side).map(|closed| !closed);
    let strip = match held {
        PanelEdges::All => false,
        PanelEdges::Ends => true,
        PanelEdges::Root => return Err("a panel with a free end has no closed-form solution".into()),
    };
    let ends = open(sides.left)? && open(sides.right)?;
    let flanks = [sides.front, sides.back];
    let flanks_fit =
        if strip { closed(flanks[0])? && closed(flanks[1])? } else { open(flanks[0])? && open(flanks[1])? };
    if ends && flanks_fit {
        return Ok(());
    }
    Err("the closed-form solution requires that the held edges of the panel lie on sides with \"outlet\" and its guided \
         edges on sides with \"slip\""
        .into())
}

/// A prestressed panel under pressure.
struct Stretched {
    size_m: [f64; 2],
    /// Fixed at two ends; modes depend on x only.
    strip: bool,
    /// N/m.
    tension: f64,
    /// Pa.
    pressure: f64,
}

impl Stretched {
    /// Modes in increasing order; `mass`: mass of fabric and air per area (kg/m2) at a wave number (1/m).
    fn modes(&self, mass: impl Fn(f64) -> f64) -> Vec<Mode> {
        let [lx, ly] = self.size_m;
        let odd = || (0..MODES).map(|i| (2 * i + 1) as f64);
        let mut modes = Vec::new();
        for m in odd() {
            for n in odd().take(if self.strip { 1 } else { MODES }) {
                let a = m * PI / lx;
                let (k2, shape, mean, mean_square) = if self.strip {
                    (a * a, 4.0 / (PI * m), 2.0 / (PI * m), 0.5)
                } else {
                    let b = n * PI / ly;
                    (a * a + b * b, 16.0 / (PI * PI * m * n), 4.0 / (PI * PI * m * n), 0.25)
                };
                let amplitude = shape * self.pressure / (self.tension * k2);
                modes.push(Mode {
                    omega: (self.tension * k2 / mass(k2.sqrt())).sqrt(),
                    volume: amplitude * mean * lx * ly,
                    weight: amplitude * amplitude * mean_square * lx * ly,
                    stiffness: self.tension * k2,
                });
            }
        }
        modes
    }
}

impl Exact {
    /// The solution for a scene with a panel in a box.
    ///
    /// # Errors
    /// The scene has no closed-form solution, with the reason.
    pub fn new(scene: &Scene) -> Result<Self, String> {
        let (Canopy::Panel(p), Some(flow)) = (&scene.canopy, &scene.flow) else {
            return Err("the stability study needs canopy.kind = \"panel\" and a [flow.box]".into());
        };
        let Some(b) = &flow.box_grid else { return Err("the stability study needs a [flow.box]".into()) };
        if b.ahead_m > 0.0 || b.behind_m > 0.0 {
            return Err("the panel must span its box: remove flow.box.ahead_m and behind_m".into());
        }
        check_sides(&b.sides, p.held)?;
        let strip = p.held == PanelEdges::Ends;
        let pressure = scene.stages.iter().find_map(|s| s.pressure_pa);
        let Some(pressure) = pressure.filter(|p| *p != 0.0) else {
            return Err("the first stage must load the panel: set its pressure_pa".into());
        };
        let tension = scene.fabric.prestress_pa * scene.fabric.thickness_m;
        if tension <= 0.0 {
            return Err("a panel without tension does not vibrate: set fabric.prestress_pa".into());
        }
        let fabric = scene.fabric.density_kg_m3 * scene.fabric.thickness_m;
        let one_side = |k: f64, height: f64, closed: bool| {
            let t = (k * height).tanh();
            flow.density_kg_m3 / k * if closed { 1.0 / t } else { t }
        };
        let (below, above) = (closed(b.sides.bottom)?, closed(b.sides.top)?);
        let added = |k: f64| one_side(k, b.below_m, below) + one_side(k, b.above_m, above);
        let panel = Stretched { size_m: p.size_m, strip, tension, pressure };
        let modes = panel.modes(|k| fabric + added(k));
        let k1 = (modes[0].stiffness / tension).sqrt();
        Ok(Self { modes, fabric, added: added(k1) })
    }

    /// Period of the first mode, s.
    pub fn period(&self) -> f64 {
        2.0 * PI / self.modes[0].omega
    }

    /// Volume under the panel at time `t`, m3, with all frequencies multiplied by `stretch`.
    pub fn volume(&self, t: f64, stretch: f64) -> f64 {
        self.modes.iter().map(|m| m.volume * (stretch * m.omega * t).cos()).sum()
    }

    /// The same vibration scaled to the initial volume `start`, m3, of the static shape on the mesh, so that only the time
    /// evolution is compared.
    pub fn from_volume(mut self, start: f64) -> Self {
        let factor = start / self.volume(0.0, 1.0);
        for mode in &mut self.modes {
            mode.volume *= factor;
            mode.weight *= factor * factor;
        }
        self
    }

    /// Kinetic energy of the fabric alone, J.
    pub fn fabric_energy(&self, t: f64) -> f64 {
        let one = |m: &Mode| 0.5 * self.fabric * m.weight * (m.omega * (m.omega * t).sin()).powi(2);
        self.modes.iter().map(one).sum()
    }

    /// Energy of the vibration, J.
    pub fn energy(&self) -> f64 {
        self.modes.iter().map(|m| 0.5 * m.stiffness * m.weight).sum()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn scene() -> Scene {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/hard/membrane-box/scene.toml");
        case::load(&file).unwrap()
    }

    #[test]
    fn added_mass_has_the_limits_of_deep_and_shallow_boxes() {
        let mut scene = scene();
        let k = PI * 2f64.sqrt() / 1.0;
        let rho = scene.flow.as_ref().unwrap().density_kg_m3;
        let added = |below: f64, above: f64, scene: &mut Scene| {
            let b = scene.flow.as_mut().unwrap().box_grid.as_mut().unwrap();
            (b.below_m, b.above_m) = (below, above);
            Exact::new(scene).unwrap().added
        };
        // Deep boxes: an infinite half-space on each side, rho / k.
        assert!((added(50.0, 50.0, &mut scene) / (2.0 * rho / k) - 1.0).abs() < 1e-12);
        // Shallow and open: the column of air itself. Shallow and closed: squeezed out sideways.
        let shallow = added(1e-3, 50.0, &mut scene) - rho / k;
        let (bottom, expected) = (scene.flow.as_ref().unwrap().box_grid.as_ref().unwrap().sides.bottom, 1e-3);
        let expected = if bottom == Condition::Outlet { rho * expected } else { rho / (k * k * expected) };
        assert!((shallow / expected - 1.0).abs() < 1e-4, "{shallow} {expected}");
    }

    #[test]
    fn initial_volume_and_energy_match_the_static_shape() {
        let scene = scene();
        let exact = Exact::new(&scene).unwrap();
        let p = scene.stages[0].pressure_pa.unwrap();
        let tension = scene.fabric.prestress_pa * scene.fabric.thickness_m;
        // Square membrane of side 1 under pressure: volume 0.0351 p / T (torsion constant
        // 0.1406 of a square over 4), and the work of the pressure is half of p V.
        let volume = exact.volume(0.0, 1.0);
        assert!((volume * tension / p - 0.140577 / 4.0).abs() < 2e-5, "{}", volume * tension / p);
        assert!((exact.energy() - 0.5 * p * volume).abs() < 1e-4 * exact.energy());
        let half = exact.clone().from_volume(0.5 * volume);
        assert!((half.volume(0.3, 1.0) - 0.5 * exact.volume(0.3, 1.0)).abs() < 1e-12 * volume);
        assert!((half.energy() - 0.25 * exact.energy()).abs() < 1e-12 * exact.energy());
        // After a quarter period of the first mode all of its energy is kinetic.
        let first = Exact { modes: exact.modes[..1].to_vec(), ..exact.clone() };
        let quarter = 0.25 * first.period();
        let share = scene.fabric.density_kg_m3 * scene.fabric.thickness_m;
        let kinetic = first.fabric_energy(quarter) * (1.0 + exact.added / share);
        assert!((kinetic / first.energy() - 1.0).abs() < 1e-12, "{}", kinetic / first.energy());
    }

    #[test]
    fn scenes_without_closed_form_are_refused() {
        let mut free = scene();
        let Canopy::Panel(p) = &mut free.canopy else { panic!() };
        p.held = PanelEdges::Root;
        assert!(Exact::new(&free).unwrap_err().contains("free end"));
        let mut shut = scene();
        shut.flow.as_mut().unwrap().box_grid.as_mut().unwrap().sides.left = Condition::Slip;
        assert!(Exact::new(&shut).unwrap_err().contains("held edges"));
    }
}
