//! Numbers of a scene that decide which effects matter in it.

use case::{Canopy, GAS_CONSTANT, HEAT_RATIO, Role, Scene, StageKind, StageTimes};
use coupling::interface::CanopyInterface;
use mesh::{CableKind, StructureMesh};

/// Sizes, speeds, loads and masses of a scene before anything is run.
#[derive(Clone, Debug)]
pub struct Numbers<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Speed of the air far away past the canopy without gusts, the largest of the stages with the flow, m/s; 0
    /// where nothing is known.
    pub speed: f64,
    /// The same at the start of the first coupled stage, m/s.
    pub release_speed: f64,
    /// Largest speed in each stage, without gusts and with them, m/s; 0 in stages without the flow.
    pub stage_speeds: Vec<[f64; 2]>,
    /// Density of the air, kg/m3.
    pub density: f64,
    /// Mach number of the largest speed, with gusts.
    pub mach: f64,
    /// Width of the canopy as built, m; without a canopy the largest reference length of a body, 0 where none is given.
    pub width: f64,
    /// Reynolds number of `speed` and `width`.
    pub reynolds: f64,
    /// Edge of the cells along the canopy, m.
    pub cell: f64,
    /// Thickness of the cells at the canopy, m.
    pub first_layer: f64,
    /// Dynamic pressure, Pa.
    pub dynamic_pressure: f64,
    /// Pressure jump of the fabric, Pa: that of a pre-inflation, or else the dynamic pressure.
    pub pressure: f64,
    /// Acceleration of gravity, m/s2.
    pub gravity: f64,
    /// Fabric, kg/m2.
    pub fabric_kg_m2: f64,
    /// Fabric area, m2.
    pub fabric_area: f64,
    /// Mass of fabric, kg.
    pub fabric_mass: f64,
    /// Mass of lines and risers, kg.
    pub line_mass: f64,
    /// Mass of tapes, kg.
    pub tape_mass: f64,
    /// Axial stiffness of the tapes times their length, N m.
    pub tape_stiffness: f64,
    /// Mass that falls, kg; 0 without descent.
    pub falling_mass: f64,
    /// Unstretched length of lines and risers that stand free in the air, m.
    pub line_length: f64,
    /// Diameter of a round line of the scene's cross-section, m.
    pub line_diameter: f64,
    /// Distance of the payload below the skirt, m.
    pub suspension: f64,
    /// Membrane strain under `pressure` in a canopy of radius half its width.
    pub strain: f64,
    /// Drag on the whole, N: the weight that falls, or else dynamic pressure on the fabric.
    pub drag: f64,
    /// Longest stage with structure or flow, s.
    pub duration: f64,
    /// Least time in which a wave passes a cable element, s; infinite without cables.
    pub cable_passage: f64,
}

impl<'a> Numbers<'a> {
    /// Of `scene` with its canopy.
    pub fn new(scene: &'a Scene, interface: &CanopyInterface, mesh: &StructureMesh) -> Self {
        let case::Resolved { air, gravity_m_s2: gravity, .. } = scene.resolved();
        let Speeds { steady: speed, release: release_speed, stages: stage_speeds } = Speeds::of(scene);
        let fastest = stage_speeds.iter().fold(speed, |most, [_, gusty]| most.max(*gusty));
        let density = air.density_kg_m3;
        let width = if scene.has_canopy() { width(mesh) } else { body_length(scene) };
        let dynamic_pressure = 0.5 * density * speed * speed;
        let pressure = inflation_pressure(scene).unwrap_or(dynamic_pressure);
        let f = &scene.fabric;
        let (fabric_mass, tape_mass) = (interface.masses.fabric, interface.masses.all_tapes());
        let line_mass = interface.masses.cables - tape_mass;
        let falling_mass =
            scene.descent.as_ref().map_or(0.0, |d| d.payload_mass_kg + fabric_mass + line_mass + tape_mass);
        let free = [CableKind::SuspensionLine, CableKind::Riser];
        let lowest = |nodes: &[[f64; 3]]| nodes.iter().map(|x| x[2]).fold(f64::INFINITY, f64::min);
        let fabric_area = interface.sizes.fabric_area;
        Self {
            scene,
            speed,
            release_speed,
            density,
            mach: fastest / (HEAT_RATIO * GAS_CONSTANT * air.temperature_k).sqrt(),
            stage_speeds,
            width,
            reynolds: density * speed * width / air.dynamic_viscosity_pa_s,
            cell: width / cells_across(scene, mesh).max(1.0),
            first_layer: scene.flow.as_ref().map_or(0.0, |f| f.grid.first_layer_m),
            dynamic_pressure,
            pressure,
            gravity,
            fabric_kg_m2: f.thickness_m * f.density_kg_m3,
            fabric_area,
            fabric_mass,
            line_mass,
            tape_mass,
            tape_stiffness: mesh.tape_stiffness(scene),
            falling_mass,
            line_length: free.into_iter().map(|k| mesh.cable_length(k)).sum(),
            line_diameter: scene.lines.as_ref().map_or(0.0, case::Lines::round_diameter_m),
            suspension: (lowest(&mesh.coords[..mesh.n_canopy]) - lowest(&mesh.coords)).max(0.0),
            strain: if f.is_absent() {
                0.0
            } else {
                pressure * 0.25 * width / (f.youngs_modulus_pa * f.thickness_m)
            },
            drag: if falling_mass > 0.0 { falling_mass * gravity } else { dynamic_pressure * fabric_area },
            duration: scene.stages.iter().map(|s| s.duration_s).fold(0.0, f64::max),
            cable_passage: mesh
                .cables
                .iter()
                .filter_map(|c| Some(c.rest_length / c.section(scene)?.wave_speed()))
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Dynamic pressure of the largest speed, with gusts, Pa.
    pub fn peak_pressure(&self) -> f64 {
        let fastest = self.stage_speeds.iter().fold(self.speed, |most, [_, gusty]| most.max(*gusty));
        0.5 * self.density * fastest * fastest
    }

    /// The scene runs the flow.
    pub fn flows(&self) -> bool {
        self.scene.flow.is_some() && self.scene.stages.iter().any(|s| s.kind.roles().contains(&Role::Flow))
    }

    /// Thickness of a turbulent boundary layer half a width down the canopy, m.
    pub fn boundary_layer(&self) -> f64 {
        let run = 0.5 * self.width;
        0.37 * run / (0.5 * self.reynolds).max(1.0).powf(0.2)
    }

    /// Speed at which air passes a cloth of coefficients `a` (Pa s/m) and `b` (Pa s2/m2)
    /// under the pressure jump of the scene, m/s.
    pub fn leakage(&self, a: f64, b: f64) -> f64 {
        let p = self.pressure;
        // The root of b v^2 + a v = p that is right for b = 0 too.
        2.0 * p / (a + (a * a + 4.0 * b * p).sqrt())
    }
}

/// Speeds of the air past the canopy, m/s.
struct Speeds {
    steady: f64,
    release: f64,
    stages: Vec<[f64; 2]>,
}

impl Speeds {
    /// Of `scene`, whose frame moves with its initial velocity, as its winds by stage and its gusts give them.
    fn of(scene: &Scene) -> Self {
        let frame = scene.resolved().initial_velocity_m_s;
        let past = |w: [f64; 3]| length(&std::array::from_fn(|i| w[i] - frame[i]));
        let common = past(scene.resolved().wind_m_s);
        let times = StageTimes::planned(scene);
        let flows = |k: &usize| scene.flow.is_some() && scene.stages[*k].kind.roles().contains(&Role::Flow);
        let speeds = |k| if flows(&k) { scene.wind(k, &times).fastest(times.of(k), frame) } else { [0.0; 2] };
        let stages: Vec<_> = (0..scene.stages.len()).map(speeds).collect();
        let steady = (0..stages.len()).filter(flows).map(|k| stages[k][0]).reduce(f64::max);
        let first = scene.stages.iter().position(|s| s.kind == StageKind::Coupled);
        let release = first.map_or(common, |k| past(scene.wind(k, &times).released()));
        Self { steady: steady.unwrap_or(common), release, stages }
    }
}

/// Length of a vector.
pub fn length(v: &[f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest reference length of `[[flow.forces.coefficients]]`, m: the size of a rigid body; 0 where none is given.
fn body_length(scene: &Scene) -> f64 {
    let forces = scene.flow.as_ref().and_then(|f| f.forces.as_ref());
    let entries = forces.map_or(&[][..], |f| &f.coefficients);
    entries.iter().map(|e| e.reference_length_m).fold(0.0, f64::max)
}

/// Width of the canopy along the wider of the axes x and y, m.
fn width(mesh: &StructureMesh) -> f64 {
    let extent = |axis: usize| {
        let (low, high) = mesh.coords[..mesh.n_canopy]
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x[axis]), h.max(x[axis])));
        high - low
    };
    extent(0).max(extent(1))
}

/// Cells of the flow across the canopy.
fn cells_across(scene: &Scene, mesh: &StructureMesh) -> f64 {
    match &scene.canopy {
        Canopy::Atps(a) => f64::from(a.cells_across),
        Canopy::Square(f) | Canopy::Circular(f) => f64::from(f.cells_across),
        Canopy::Gored(g) => 2.0 * f64::from(g.cells_along),
        Canopy::Cross(x) => f64::from(x.cells_across + 2 * x.cells_along_arm),
        Canopy::AirBag(a) => f64::from(a.cells_across),
        Canopy::Panel(p) => f64::from(p.cells[0]),
        Canopy::Gmsh(_) | Canopy::Pattern(_) | Canopy::None => (mesh.faces.len() as f64).sqrt(),
    }
}

/// Size of the pressure that the first pre-inflation with one gives, Pa; `None` without one, or at zero.
fn inflation_pressure(scene: &Scene) -> Option<f64> {
    let mut inflations = scene.stages.iter().filter(|s| s.kind == StageKind::PreInflation);
    inflations.find_map(|s| s.pressure_pa.map(f64::abs)).filter(|p| *p > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_case<T>(name: &str, see: impl Fn(&Numbers<'_>) -> T) -> T {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases").join(name);
        let scene = case::load(&file.join("scene.toml")).unwrap();
        let interface = CanopyInterface::new(&scene).unwrap();
        let mesh = mesh::structure_mesh(&scene).unwrap();
        see(&Numbers::new(&scene, &interface, &mesh))
    }

    /// Figures of the paper's parachute, worked out by hand: sound at 288.15 K is 340.3 m/s;
    /// 0.03729 kg/m2 of fabric weigh 0.3657 Pa, 2.5 % of 14.567 Pa; 28 lines of 6.4008 m and
    /// 4 risers of 1.2192 m; a round line of 3.11e-6 m2 is 1.990 mm thick.
    #[test]
    fn numbers_of_the_paper() {
        of_case("atps-descent", |n| {
            assert!((n.mach - 4.8768 / 340.29).abs() < 1e-6, "{}", n.mach);
            assert!((n.fabric_kg_m2 * n.gravity / n.pressure - 0.02511).abs() < 1e-4);
            assert!((n.line_length - (28.0 * 6.4008 + 4.0 * 1.2192)).abs() < 1e-9, "{}", n.line_length);
            assert!((n.line_diameter - 1.9899e-3).abs() < 1e-6);
            assert!((n.drag - 106.614 * 9.80665).abs() < 0.02, "{}", n.drag);
            assert!((n.cell - n.width / 18.0).abs() < 1e-12);
        });
    }

    #[test]
    fn leakage_solves_its_law() {
        of_case("atps-descent", |n| {
            for (a, b) in [(254.0, 37.6), (8170.0, 0.0), (0.0, 10.0)] {
                let v = n.leakage(a, b);
                assert!((a * v + b * v * v - n.pressure).abs() < 1e-12 * n.pressure, "{a} {b}: {v}");
            }
        });
    }

    /// A canopy that drifts with the wind meets the air that one in still air meets.
    #[test]
    fn drift_with_the_wind_leaves_the_speeds() {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/atps-descent/scene.toml");
        let mut scene = case::load(&file).expect("a scene");
        let still = Speeds::of(&scene);
        let descent = scene.descent.as_mut().expect("a descent");
        (descent.motion, descent.initial_drift_m_s) =
            (Some(case::FrameMotion::ThreeDimensional), [3.0, -1.0]);
        let moving = Speeds::of(&scene);
        assert!(moving.release > 1.1 * still.release && moving.steady > 1.1 * still.steady);
        scene.flow.as_mut().expect("a flow").wind_m_s = [3.0, -1.0, 0.0];
        let carried = Speeds::of(&scene);
        assert_eq!(
            (carried.steady, carried.release, carried.stages),
            (still.steady, still.release, still.stages)
        );
    }
}
