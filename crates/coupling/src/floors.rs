//! Floors of the coupling criterion: below them a field is measured against a physical scale instead of its own
//! change.
//!
//! The criterion compares the structure's response with the iterate; their difference is determined by the error of
//! the load. Each floor is the change that a fraction of a physical scale of the scene would cause within a window.
//! None is zero:
//! - motion relative to the air: the distance that the undisturbed air moves past the canopy;
//! - load: the displacement of the fabric under the scale of the load, by its inertia alone (half the acceleration
//!   times the square of the window), or as large as the present deflection where that is less, because stiffness
//!   limits it. At a tolerance of 1e-3 the load is then accurate to 5e-5 of its scale;
//! - descent speed: the change by gravity, or by the scale of the load where there is no gravity.

use case::{Scene, StageKind};

use crate::interface::CanopyInterface;
use crate::schemes::{InterfaceState, LoadFloor};

/// Fraction of the distance that the air moves past the canopy in a window, and of the displacement by the load's
/// scale, below which the change of shape over the window is not used as the measure of convergence.
pub(crate) const SHAPE_FLOOR: f64 = 0.05;
/// The same for the descent speed: the fraction of the change by gravity in a window. At a tolerance of 1e-3 the drag
/// is then accurate to 1e-4 of the weight.
const SPEED_FLOOR: f64 = 0.1;

/// Scale of the load, Pa: the largest of
/// - the dynamic pressure of the air that moves past the canopy at `speed` (m/s), and of gusts;
/// - the pressure of earlier pre-inflation stages;
/// - the root mean square of the present load;
/// - the weight of the falling system, or of the fabric where gravity acts on it, and nodal forces, per area of the
///   fabric.
///
/// A scene with none of these has no driving force: its scale is the round-off of the static pressure of the air.
pub(crate) fn load_scale(
    scene: &Scene,
    stage: usize,
    interface: &CanopyInterface,
    state: &InterfaceState,
    speed: f64,
) -> f64 {
    let case::CanopyAir { density_kg_m3: density, sound_m_s: sound } = scene.resolved().canopy_air;
    let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>();
    let gust =
        scene.gust(stage).map_or(0.0, |(gust, _)| square(gust.velocity_m_s) * gust.largest_factor().powi(2));
    let blown = scene.stages[..stage].iter().filter(|s| s.kind == StageKind::PreInflation);
    let blown = blown.filter_map(|s| s.pressure_pa).fold(0.0, |most: f64, p| most.max(p.abs()));
    let carried = state.load.as_deref().unwrap_or(&[]).chunks_exact(channel::LOAD_WIDTH).map(|l| l[0] * l[0]);
    let faces = interface.faces.len().max(1) as f64;
    let carried = (carried.sum::<f64>() / faces).sqrt();
    let area = interface.sizes.fabric_area.max(f64::MIN_POSITIVE);
    let gravity = scene.resolved().gravity_m_s2;
    let fabric = if scene.fabric_gravity.is_some() { interface.masses.fabric * gravity } else { 0.0 };
    let falling = scene.resolved().payload_mass_kg * gravity;
    let forces: f64 = scene.stages[stage].forces.iter().map(|f| square(f.force_n).sqrt()).sum();
    let greatest = [
        0.5 * density * (speed * speed).max(gust),
        blown,
        carried,
        (fabric + falling + forces) / area,
        f64::EPSILON * density * sound * sound,
    ];
    greatest.into_iter().fold(f64::MIN_POSITIVE, f64::max)
}

/// Change of shape by the scale `pressure` (Pa) of the load in a window of `dt` (s): `response` is the displacement
/// at its end divided by `dt` squared times the acceleration.
pub(crate) fn load_floor(
    scene: &Scene,
    interface: &CanopyInterface,
    state: &InterfaceState,
    [pressure, dt, response]: [f64; 3],
) -> LoadFloor {
    let root = (interface.nodes() as f64).sqrt();
    let acceleration = pressure / heaviest_cloth(scene);
    let bulge = state.displacement.iter().map(|u| u * u).sum::<f64>().sqrt();
    LoadFloor {
        inertial: SHAPE_FLOOR * response * acceleration * dt * dt * root,
        most: if bulge > 0.0 { SHAPE_FLOOR * bulge } else { f64::INFINITY },
    }
}

/// Largest areal mass of the fabrics of a scene, kg/m2: no cloth moves less.
fn heaviest_cloth(scene: &Scene) -> f64 {
    let groups = (0..scene.fabric_groups().len()).map(|k| Some(k as u16));
    let masses = groups.chain([None]).map(|group| {
        let fabric = scene.fabric_of(group);
        fabric.thickness_m * fabric.density_kg_m3
    });
    masses.fold(0.0, f64::max)
}

/// Floor of the descent speed in a window of `dt` (s), m/s.
pub(crate) fn speed_floor(scene: &Scene, interface: &CanopyInterface, pressure: f64, dt: f64) -> f64 {
    let gravity = scene.descent.as_ref().map_or(0.0, |d| d.gravity_m_s2);
    let payload = scene.resolved().payload_mass_kg;
    let mass = payload + interface.masses.fabric + interface.masses.cables;
    let acceleration = if gravity > 0.0 { gravity } else { pressure * interface.sizes.fabric_area / mass };
    SPEED_FLOOR * acceleration * dt
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A panel in a box in still air.
    fn floors(pressure: &str, fabric: &str) -> (f64, LoadFloor) {
        let text = format!(
            r#"
            name = "still"
            [canopy]
            kind = "panel"
            size_m = [1.0, 1.0]
            cells = [4, 4]
            [fabric]
            youngs_modulus_pa = 1e4
            poisson_ratio = 0.3
            thickness_m = 1e-3
            density_kg_m3 = 5.5
            {fabric}
            [flow]
            [flow.box]
            below_m = 0.5
            above_m = 0.5
            layers_below = 4
            layers_above = 4
            [[stage]]
            name = "pushed"
            kind = "pre-inflation"
            solve = "static"
            pressure_pa = {pressure}
            [[stage]]
            name = "vibration"
            kind = "coupled"
            duration_s = 0.16
            window_s = 0.04
            "#
        );
        let scene = case::parse(Path::new("scene.toml"), &text).expect("a good scene");
        let interface = CanopyInterface::new(&scene).expect("a panel");
        let state = InterfaceState::at_start(&scene, &interface);
        let scale = load_scale(&scene, 1, &interface, &state, 0.0);
        (scale, load_floor(&scene, &interface, &state, [scale, 0.04, 0.5]))
    }

    /// Nothing moves and there is no wind: the scale is the pressure that deflected the panel, else the weight of the
    /// fabric, else the round-off of the static pressure.
    #[test]
    fn floors_are_positive_in_still_air() {
        let (scale, floor) = floors("0.1", "prestress_pa = 730.0");
        assert_eq!(scale, 0.1);
        // 0.1 Pa on 5.5e-3 kg/m2 for 40 ms: 14.5 mm.
        let way = floor.inertial / SHAPE_FLOOR / 5.0;
        assert!((way - 0.014_545).abs() < 1e-5, "{way} m");
        let (scale, floor) = floors("1e-300", "prestress_pa = 730.0");
        assert!((1e-12..1e-9).contains(&scale) && floor.at(1.0) > 0.0, "{scale} {floor:?}");
    }

    #[test]
    fn heaviest_cloth_limits_the_floor() {
        let areal_mass = |density: f64| {
            let text = format!(
                "name = \"two\"\n[canopy]\nkind = \"gmsh\"\nfile = \"plate.msh\"\n[[canopy.fabric]]\ngroup = \"crown\"\n\
                 density_kg_m3 = {density}\n[fabric]\nyoungs_modulus_pa = 1e8\npoisson_ratio = 0.3\nthickness_m = 1e-4\n\
                 density_kg_m3 = 500.0\n[[stage]]\nname = \"blown\"\nkind = \"pre-inflation\"\nsolve = \"static\"\npressure_pa = 1.0\n"
            );
            let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../cases/plate-gmsh/scene.toml");
            heaviest_cloth(&case::parse(Path::new(scene), &text).expect("a good scene"))
        };
        assert_eq!([100.0, 900.0].map(areal_mass), [1e-4 * 500.0, 1e-4 * 900.0]);
    }

    /// The displacement by the load scales with the square of the window, up to the deflection.
    #[test]
    fn load_floor_decreases_with_the_window() {
        let floor = LoadFloor { inertial: 4.0, most: 3.0 };
        assert_eq!([1.0, 0.5, 0.25].map(|factor| floor.at(factor)), [3.0, 1.0, 0.25]);
    }
}
