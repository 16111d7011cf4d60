//! What inlets, outlets and walls with data of their own, and rigid bodies that move, can cause in a flow.

use case::{Flow, Scene, TimeFactor, TimeFunction};
use mesh::FlowGrid;

use crate::geometry::{Vec3, at, centre, quad_area_vector};

/// Times in a stage at which a formula is evaluated for its largest value.
const SAMPLES: u32 = 256;

/// Largest speed and pressure that the data of boundary patches prescribe, and the size of the grid that they drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryDrive {
    /// Largest speed of an inlet, a wall or a body, m/s.
    pub speed: f64,
    /// Largest pressure: of an outlet, and of friction over the grid at that speed, Pa.
    pub pressure: f64,
    /// Largest extent of the grid, m.
    pub size: f64,
}

impl BoundaryDrive {
    /// Of a scene that has such data; its grid is built to know the area of the patches. Where no grid can be built, the
    /// flow itself reports why; until then the speed of sound stands for the speed.
    pub fn new(scene: &Scene) -> Option<Self> {
        let bodies = scene.stages.iter().flat_map(|s| &s.body_motions).any(|m| scene.moves_patches(m));
        let flow = scene.flow.as_ref().filter(|f| bodies || f.is_driven())?;
        let grid = mesh::structure_mesh(scene)
            .and_then(|s| mesh::flow_grid(scene, &s, &s.coords[..s.n_canopy]))
            .unwrap_or_default();
        let largest = |factor: Option<&TimeFactor>| largest_factor(scene, factor);
        let outlets = flow.outlets.iter().map(|o| o.pressure_pa.abs() * largest(o.factor.as_ref()));
        let mut drive = Self { speed: flow.sound_speed(), pressure: outlets.fold(0.0, f64::max), size: 0.0 };
        if grid.coords.is_empty() {
            return Some(drive);
        }
        let inlets = flow.inlets.iter().map(|i| inlet_speed(i, &grid) * largest(i.factor.as_ref()));
        let walls = flow.moving_walls.iter().map(|w| wall_speed(w, &grid) * largest(w.factor.as_ref()));
        let bodies = scene.stages.iter().map(|s| mesh::body_speed(s, &grid));
        let extents = extents(&grid);
        drive.size = extents.iter().copied().fold(0.0, f64::max);
        let forced = forced_speed(scene, flow, drive.size);
        drive.speed = inlets.chain(walls).chain(bodies).fold(forced, f64::max);
        drive.pressure += friction(flow, drive.speed, extents) + flow.body_force() * drive.size;
        Some(drive)
    }
}

/// Largest speed that the force on the air can cause over a grid of this `size` (m), m/s: without walls it accelerates the air all the time; a
/// march to a steady state has no time, and ends at most at plane Poiseuille flow over the whole grid, $`f L^2 / (8 \mu)`$, or, without
/// friction, where the equations do.
fn forced_speed(scene: &Scene, flow: &Flow, size: f64) -> f64 {
    let force = flow.body_force();
    if force == 0.0 {
        return 0.0;
    }
    let duration: f64 = scene.stages.iter().map(|s| s.duration_s).sum();
    let steady = match &flow.viscosity {
        _ if scene.stages.iter().all(|s| s.steady.is_none()) => 0.0,
        Some(v) => force * size * size / (8.0 * v.dynamic_viscosity_pa_s),
        None => f64::INFINITY,
    };
    (force / flow.density_kg_m3 * duration).max(steady.min(flow.sound_speed()))
}

/// Pressure drop of a plane channel as long as the grid and as high as its smallest extent, $`12 \mu U L / h^2`$, Pa.
fn friction(flow: &Flow, speed: f64, extents: [f64; 3]) -> f64 {
    let [length, height] = [f64::max, f64::min].map(|f| extents.into_iter().reduce(f).unwrap_or(0.0));
    let viscosity = flow.viscosity.as_ref().map_or(0.0, |v| v.dynamic_viscosity_pa_s);
    if height > 0.0 { 12.0 * viscosity * speed * length / (height * height) } else { 0.0 }
}

fn extents(grid: &FlowGrid) -> [f64; 3] {
    std::array::from_fn(|c| {
        let along = grid.coords.iter().map(|x| x[c]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    })
}

/// Largest magnitude of a factor over the stages.
fn largest_factor(scene: &Scene, factor: Option<&TimeFactor>) -> f64 {
    match TimeFactor::compiled(factor) {
        Ok(TimeFunction::Constant) | Err(_) => 1.0,
        Ok(TimeFunction::Table(_, values)) => values.iter().fold(0.0, |m: f64, v| m.max(v.abs())),
        Ok(function) => {
            let longest = scene.stages.iter().map(|s| s.duration_s).fold(0.0, f64::max);
            let samples =
                (0..=SAMPLES).map(|k| function.at(longest * f64::from(k) / f64::from(SAMPLES)).abs());
            samples.filter(|f| f.is_finite()).fold(0.0, f64::max)
        }
    }
}

/// Middle and area vector (m2) of each face of the patch `name`.
fn faces<'a>(grid: &'a FlowGrid, name: &'a str) -> impl Iterator<Item = (Vec3, Vec3)> + 'a {
    let of_patch = (0..grid.boundary.len()).filter(move |&f| grid.patch_name(f) == Some(name));
    of_patch.map(|f| {
        let corners = grid.boundary[f].1.map(|n| at(grid.coords.as_flattened(), n));
        (centre(&corners), quad_area_vector(corners))
    })
}

/// Largest speed of an inlet at a factor of 1, m/s.
fn inlet_speed(inlet: &case::InletValues, grid: &FlowGrid) -> f64 {
    let Ok(profile) = inlet.compiled_profile() else { return 0.0 };
    let (mut integral, mut largest) = (0.0, 0.0f64);
    for (x, area) in faces(grid, &inlet.patch) {
        let value = profile.at(x.into());
        integral += value * area.norm();
        largest = largest.max(value.abs());
    }
    let scale = match (inlet.velocity_m_s, inlet.flow_rate_m3_s) {
        (Some(v), _) => Vec3::from(v).norm(),
        (None, rate) => (rate.unwrap_or(0.0) / integral).abs(),
    };
    let speed = scale * largest;
    if speed.is_finite() { speed } else { 0.0 }
}

/// Largest speed of a wall at a factor of 1, m/s.
fn wall_speed(wall: &case::MovingWall, grid: &FlowGrid) -> f64 {
    let sliding = wall.velocity_m_s.map_or(0.0, |v| Vec3::from(v).norm());
    let Some(r) = &wall.rotation else { return sliding };
    let axis = Vec3::from(r.axis).normalize();
    let arms = faces(grid, &wall.patch).map(|(x, _)| axis.cross(&(x - Vec3::from(r.point_m))).norm());
    arms.fold(0.0, f64::max) * r.angular_velocity_rad_s.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The box of `cases/hard/channel`: 4 m by 0.5 m by 1 m in 48 x 6 x 8 cells.
    fn drive(more: &str) -> BoundaryDrive {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../cases/hard/channel/scene.toml");
        let text = std::fs::read_to_string(path).expect("the scene");
        let text = text.replacen("left = \"outlet\"", "left = \"inlet\"", 1);
        let text = text.replacen("top = \"slip\"", "top = \"wall\"", 1);
        let text = text.replacen("[flow.solver]", &format!("{more}\n[flow.solver]"), 1);
        let scene = case::parse(std::path::Path::new(path), &text).unwrap_or_else(|e| panic!("{e}"));
        BoundaryDrive::new(&scene).expect("there are data")
    }

    #[test]
    fn largest_speed_is_that_of_flow_rate_profile_and_factor() {
        // 3 m3/s through 0.5 m2; the profile is 1 +- 0.875 at the middles of the outer cells; times two.
        let rate = "[[flow.inlet]]\npatch = \"left\"\nflow_rate_m3_s = 3\nprofile = \"1 + 2*z\"\n\
                    factor = { time_s = [0, 1], value = [0, -2] }";
        let found = drive(rate);
        assert!((found.speed - 22.5).abs() < 1e-9 && found.pressure == 0.0, "{found:?}");
        assert!((found.size - 4.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn walls_and_outlets_count() {
        // The farthest middle of a cell is at 47/24 m and 5/24 m from the axis; friction: 12 mu U L / h2.
        let data = "[flow.viscosity]\ndynamic_viscosity_pa_s = 0.1\n\
                    [[flow.moving_wall]]\npatch = \"top\"\nrotation = { axis = [0, 0, 3], point_m = [0, 0, 0], angular_velocity_rad_s = -2 }\n\
                    [[flow.outlet]]\npatch = \"right\"\npressure_pa = -7\nfactor = { formula = \"1 + sin(t)/2\" }";
        let found = drive(data);
        let speed = 2.0 * (47.0f64 / 24.0).hypot(5.0 / 24.0);
        assert!((found.speed - speed).abs() < 1e-9, "{found:?} {speed}");
        let pressure = 7.0 * (1.0 + 0.5 * 1.0) + 12.0 * 0.1 * speed * 4.0 / 0.25;
        assert!((found.pressure / pressure - 1.0).abs() < 1e-3, "{found:?} {pressure}");
    }
}
