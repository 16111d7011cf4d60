//! Forces and moments of the air on chosen surfaces: the canopy and patches of the outer boundary.

use case::ForceCoefficients;
use channel::Fault;

use crate::geometry::vec3::Vec3;
use crate::gradient::Field;
use crate::loads::{Loads, Total};
use crate::physics::Gas;
use crate::solver::Solver;
use crate::topology::Side;

/// Force by pressure, N, by viscous stress, N, moment of both about a point, N m.
pub type ForceSum = [Vec3; 3];

/// Adds a force that acts at `arm` from the point of the moment.
fn add(sum: &mut ForceSum, pressure: Vec3, viscous: Vec3, arm: Vec3) {
    sum[0] += pressure;
    sum[1] += viscous;
    sum[2] += arm.cross(&(pressure + viscous));
}

/// Force on the canopy faces of this rank; `loads` are those of the last step.
pub fn canopy<G: Gas<N>, const N: usize>(solver: &Solver<G, N>, loads: &Loads, point: Vec3) -> ForceSum {
    let (t, mut sum) = (&solver.topology, ForceSum::default());
    for (load, &face) in loads.faces[..t.canopy.n_owned].iter().zip(&t.canopy_face) {
        let f = &solver.metrics.faces[face as usize];
        let shear = Vec3::new(load[1], load[2], load[3]) * f.magnitude();
        add(&mut sum, f.area * load[0], shear, solver.metrics.border(face) - point);
    }
    sum
}

/// Force on those sides of the outer boundary that air does not pass, of this rank, for which `chosen` holds.
fn walls<G: Gas<N>, const N: usize>(
    solver: &Solver<G, N>,
    point: Vec3,
    chosen: impl Fn(&Side) -> bool,
) -> ForceSum {
    let (t, mut sum) = (&solver.topology, ForceSum::default());
    for (sides, wall) in
        [(&t.no_slip, Wall::NoSlip), (&t.slip, Wall::Slip), (&t.symmetry, Wall::PlaneOfSymmetry)]
    {
        for side in sides.iter().filter(|s| s.canopy == u32::MAX && chosen(s)) {
            add_wall(&mut sum, solver, side, wall, point);
        }
    }
    sum
}

/// Sides of the outer boundary that air does not pass.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wall {
    NoSlip,
    Slip,
    PlaneOfSymmetry,
}

/// Adds the force on a side of the outer boundary.
fn add_wall<G: Gas<N>, const N: usize>(
    sum: &mut ForceSum,
    solver: &Solver<G, N>,
    side: &Side,
    wall: Wall,
    point: Vec3,
) {
    let on = solver.domain();
    let f = &solver.metrics.faces[side.face as usize];
    let field = Field { q: &solver.q, gradient: &solver.gradient };
    let (p, missing) = if wall == Wall::PlaneOfSymmetry {
        let upwind = f64::from(solver.face_flux()[side.face as usize].blending.upwind);
        let mirror = solver.spatial.mirrored(&on, field, side);
        (mirror.pressure(&solver.scheme, upwind), mirror.missing_slope())
    } else {
        (solver.spatial.wall_pressure(&on, &solver.q, &solver.gradient, side), 0.0)
    };
    let viscous = match (solver.spatial.viscosity.is_active(), wall) {
        (false, _) => Vec3::zeros(),
        (true, Wall::NoSlip) => {
            solver.spatial.wall_traction(&on, &solver.scheme, &solver.q, side) * f.magnitude()
        }
        (true, _) => solver.spatial.slip_wall_force(&on, field, side, missing),
    };
    add(sum, f.area * (side.sign * p), viscous, solver.metrics.border(side.face) - point);
}

/// Force on the no-slip walls of the outer boundary, of this rank.
pub fn no_slip_walls<G: Gas<N>, const N: usize>(solver: &Solver<G, N>, point: Vec3) -> ForceSum {
    let mut sum = ForceSum::default();
    let sides = solver.topology.no_slip.iter().filter(|s| s.canopy == u32::MAX);
    sides.for_each(|side| add_wall(&mut sum, solver, side, Wall::NoSlip, point));
    sum
}

/// Sums the parts of all ranks. Collective.
pub fn summed<G: Gas<N>, const N: usize>(solver: &Solver<G, N>, sums: &mut [ForceSum]) {
    let mut numbers: Vec<f64> = sums.as_flattened().iter().flatten().copied().collect();
    solver.comm().sum_slice(&mut numbers);
    let all = numbers.chunks_exact(3).map(Vec3::from_column_slice);
    sums.as_flattened_mut().iter_mut().zip(all).for_each(|(part, sum)| *part = sum);
}

/// Surfaces whose forces are summed.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    canopy: bool,
    /// Whether each named patch of the grid is one of them.
    patches: Vec<bool>,
}

impl Surfaces {
    /// The surfaces of `entry` on a grid whose patches have the names `patches`.
    pub fn new(entry: &ForceCoefficients, flow: &case::Flow, patches: &[String]) -> Self {
        let patches = patches.iter().map(|p| entry.patches.contains(p)).collect();
        Self { canopy: entry.has_canopy(flow), patches }
    }

    /// Force and moment about `point` of this rank's part; `loads` are those of the last step.
    pub fn force<G: Gas<N>, const N: usize>(
        &self,
        solver: &Solver<G, N>,
        loads: &Loads,
        point: Vec3,
    ) -> ForceSum {
        let chosen = |s: &Side| {
            let patch = solver.topology.patch_of(s).and_then(|p| self.patches.get(usize::from(p)));
            patch.is_some_and(|p| *p)
        };
        let mut sum = walls(solver, point, chosen);
        if self.canopy {
            sum.iter_mut().zip(canopy(solver, loads, point)).for_each(|(s, c)| *s += c);
        }
        sum
    }
}

/// The force that the participant reports and that a march to a steady state watches.
#[derive(Clone, Debug, PartialEq)]
pub enum Watched {
    /// That on the canopy.
    Canopy,
    /// That on all no-slip walls of the outer boundary.
    Walls,
    /// That on chosen surfaces.
    Surfaces(Surfaces),
}

impl Watched {
    /// Of a stage of `kind` of `scene`, on a grid whose patches have the names `patches`.
    pub fn of(scene: &case::Scene, kind: case::StageKind, patches: &[String]) -> Self {
        match (scene.watched_force(kind), &scene.flow) {
            (case::WatchedForce::Entry(entry), Some(flow)) => {
                Self::Surfaces(Surfaces::new(entry, flow, patches))
            }
            (case::WatchedForce::Walls, _) => Self::Walls,
            _ => Self::Canopy,
        }
    }

    /// Computes `loads` of the solver's last step: force and moment about the origin. Collective.
    pub fn compute<G: Gas<N>, const N: usize>(&self, solver: &Solver<G, N>, loads: &mut Loads) -> Total {
        let canopy = loads.compute(solver);
        let own = match self {
            Self::Canopy => return canopy,
            Self::Walls => no_slip_walls(solver, Vec3::zeros()),
            Self::Surfaces(surfaces) => surfaces.force(solver, loads, Vec3::zeros()),
        };
        let mut sums = [own];
        summed(solver, &mut sums);
        let [pressure, viscous, moment] = sums[0];
        Total { force: pressure + viscous, moment }
    }
}

/// Axes and scales of the coefficients of an entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Unit vectors along drag, side force and lift.
    pub axes: [Vec3; 3],
    /// Point about which moments are taken, m.
    pub point: Vec3,
    /// Reference length of the moments, m.
    pub length: f64,
}

/// Axes and scales of `entry`, which is one of `forces`.
///
/// # Errors
/// Its drag and lift are parallel.
pub(crate) fn entry_coefficients(
    entry: &ForceCoefficients,
    forces: &case::Forces,
) -> Result<Coefficients, Fault> {
    Coefficients::new(entry, forces).ok_or_else(|| {
        Fault::new(format!(
            "drag and lift of \"{}\" in [[flow.forces.coefficients]] are parallel",
            entry.name
        ))
    })
}

impl Coefficients {
    /// Of an entry of `forces`; `None` where its drag and lift are parallel.
    pub fn new(entry: &ForceCoefficients, forces: &case::Forces) -> Option<Self> {
        let axes = entry.axes(forces)?.map(Vec3::from);
        Some(Self { axes, point: entry.moment_point(forces).into(), length: entry.reference_length_m })
    }

    /// Drag, side force, lift, N, their coefficients, and those of the moments about the same axes (roll, pitch, yaw), where
    /// a force of `scale`, N, makes a coefficient of 1. Without a scale the coefficients are NaN: no value.
    pub fn row(&self, sum: &ForceSum, scale: Option<f64>) -> [f64; 9] {
        let (force, one) = (sum[0] + sum[1], scale.unwrap_or(f64::NAN));
        let along = |v: Vec3| self.axes.map(|a| a.dot(&v));
        let (forces, moments) = (along(force), along(sum[2]));
        let [d, s, l] = forces;
        let [cd, cs, cl] = forces.map(|f| f / one);
        let [roll, pitch, yaw] = moments.map(|m| m / (one * self.length));
        [d, s, l, cd, cs, cl, roll, pitch, yaw]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(drag: [f64; 3], lift: [f64; 3]) -> Coefficients {
        let entry = ForceCoefficients {
            name: "body".into(),
            patches: Vec::new(),
            drag_direction: Some(drag),
            lift_direction: Some(lift),
            moment_point_m: None,
            reference_area_m2: 2.0,
            reference_length_m: 0.5,
            reference_speed_m_s: None,
        };
        Coefficients::new(&entry, &case::Forces::default()).expect("two directions")
    }

    #[test]
    fn coefficients_are_those_by_hand() {
        // Drag along x, lift along z: the side force is along z x x = y. The lift direction may lean.
        let sum = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(1.0, 0.0, 0.5), Vec3::new(6.0, -4.0, 2.0)];
        let row = entry([5.0, 0.0, 0.0], [0.3, 0.0, 0.1]).row(&sum, Some(8.0));
        let exact = [4.0, 1.0, -1.5, 0.5, 0.125, -0.1875, 1.5, -1.0, 0.5];
        assert!(row.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-14), "{row:?}");
        // Without a scale the forces stay and the coefficients have no value.
        let still = entry([5.0, 0.0, 0.0], [0.0, 0.0, 1.0]).row(&sum, None);
        assert!(still[..3] == exact[..3] && still[3..].iter().all(|c| c.is_nan()), "{still:?}");
    }

    #[test]
    fn axes_turn_with_the_forces() {
        // By 90 degrees about z: x to y, y to -x.
        let turn = |v: Vec3| Vec3::new(-v[1], v[0], v[2]);
        let sum = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(1.0, 0.2, 0.5), Vec3::new(6.0, -4.0, 2.0)];
        let row = entry([1.0, 0.2, 0.0], [0.0, 0.1, 1.0]).row(&sum, Some(8.0));
        let turned = entry([-0.2, 1.0, 0.0], [-0.1, 0.0, 1.0]).row(&sum.map(turn), Some(8.0));
        assert!(row.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 1e-14), "{row:?} {turned:?}");
    }
}
