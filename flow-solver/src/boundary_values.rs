//! Data of single boundary patches: inlets with a velocity or a flow rate, outlets with a pressure, walls that slide or
//! rotate.
//!
//! The conditions themselves know nothing of it. Each face of the outer boundary has a velocity of the air outside, a
//! pressure outside and a velocity of its wall; [`BoundaryValues`] fills them once a step.

use case::{FormulaError, InletProfile, InletValues, MovingWall, OutletValues, TimeFactor, TimeFunction};
use comm::Comm;
use mesh::{FaceTable, FlowGrid, Patch};

use crate::error::agree;
use crate::geometry::Metrics;
use crate::geometry::vec3::Vec3;
use crate::topology::{Side, Topology};

/// Largest normal share of the velocity of a sliding wall: a grid file has few digits.
const PLANE: f64 = 1e-3;
/// The same of a rotating wall: plane facets approximate a surface of revolution, and the centre of a triangle is not in
/// the middle of its chord.
const FACETTED: f64 = 0.2;
/// A profile whose integral is below this share of that of its magnitude cannot be scaled to a flow rate.
const CANCELLED: f64 = 1e-6;

/// Data that a patch cannot have. Every rank returns the same error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BoundaryValueError {
    /// A text that is not a formula.
    #[error("patch \"{patch}\": {source}")]
    Formula {
        /// The patch.
        patch: String,
        /// What is wrong.
        source: FormulaError,
    },
    /// A profile without a value.
    #[error(
        "inlet \"{patch}\": the profile at ({:.4}, {:.4}, {:.4}) m is {value}, not a finite number; change `profile`",
        at[0], at[1], at[2]
    )]
    Profile {
        /// The patch.
        patch: String,
        /// Centre of the face, m.
        at: Vec3,
        /// Value there.
        value: f64,
    },
    /// A profile that no factor scales to a flow rate.
    #[error(
        "inlet \"{patch}\": the integral of the profile over the faces is {integral:.3e} m2, that of its magnitude {magnitude:.3e} m2; \
         a flow rate needs a profile whose integral is not zero: change `profile`, or give `velocity_m_s`"
    )]
    Integral {
        /// The patch.
        patch: String,
        /// Integral of the profile, m2.
        integral: f64,
        /// Integral of its magnitude, m2.
        magnitude: f64,
    },
    /// A wall that would move out of its own surface.
    #[error(
        "moving wall \"{patch}\": at ({:.4}, {:.4}, {:.4}) m the normal component of the velocity is {share:.3} of the speed, but no air \
         passes a wall; a sliding wall must be plane, a rotating one a surface of revolution about the axis",
        at[0], at[1], at[2]
    )]
    NotTangential {
        /// The patch.
        patch: String,
        /// Centre of the face, m.
        at: Vec3,
        /// Normal component over speed.
        share: f64,
    },
    /// A factor of time without a value.
    #[error("patch \"{patch}\": the factor at {time} s is {value}, not a finite number; change `factor`")]
    Factor {
        /// The patch.
        patch: String,
        /// Time since the start of the stage, s.
        time: f64,
        /// Value then.
        value: f64,
    },
    /// An inlet as fast as sound.
    #[error(
        "inlet \"{patch}\": {speed:.1} m/s at {time} s is not below the speed of sound ({sound:.1} m/s); flow-solver \
         supports subsonic flow only; lower the velocity or the flow rate"
    )]
    Supersonic {
        /// The patch.
        patch: String,
        /// Time since the start of the stage, s.
        time: f64,
        /// Largest speed, m/s.
        speed: f64,
        /// Speed of sound, m/s.
        sound: f64,
    },
}

/// What holds on a patch where profile and factor of time are 1.
#[derive(Clone, Copy, Debug)]
enum Value {
    /// Velocity of the air in the frame of the ground, m/s.
    Velocity(Vec3),
    /// Volume that enters in unit time, m3/s.
    FlowRate(f64),
    /// Gauge pressure, Pa.
    Pressure(f64),
    /// Velocity of the wall in the falling frame, m/s.
    Sliding(Vec3),
    /// Angular velocity, rad/s, and a point of the axis, m.
    Rotation(Vec3, Vec3),
}

/// Data of one patch on this rank.
#[derive(Clone, Debug)]
struct PatchValues {
    patch: String,
    value: Value,
    profile: InletProfile,
    factor: TimeFunction,
    /// Faces of the patch on this rank.
    sides: Vec<Side>,
    /// Profile on each of them.
    shape: Vec<f64>,
    /// Integral of the profile over all faces of the patch, m2, where a flow rate needs it.
    integral: f64,
}

/// Data of all patches that have some.
#[derive(Clone, Debug)]
pub struct BoundaryValues {
    patches: Vec<PatchValues>,
    /// Time at the end of the step, s since the start of the stage.
    pub time: f64,
}

/// What [`BoundaryValues::fill`] sets on each face that is not between two cells.
pub(crate) struct BoundaryArrays<'a> {
    /// Velocity of the air outside less the undisturbed one, m/s.
    pub excess: &'a mut [Vec3],
    /// Gauge pressure outside, Pa.
    pub pressure: &'a mut [f64],
    /// Velocity of walls in the falling frame, m/s: that of the grid before.
    pub wall_velocity: &'a mut [Vec3],
    /// Rotation of walls from the face to the centre of its cell, m/s: that of the grid before.
    pub wall_spin: &'a mut [Vec3],
}

/// Data of patches and what they set on each face that is not between two cells. Empty where no patch has data.
#[derive(Default)]
pub(crate) struct BoundaryState {
    pub values: Option<Box<BoundaryValues>>,
    /// Gauge pressure outside, Pa.
    pub pressure: Vec<f64>,
    /// Rotation of walls from the face to the centre of its cell, m/s.
    pub spin: Vec<Vec3>,
    /// Whether the wall at a face is at rest, whatever the nodes of the grid do on it.
    pub at_rest: Vec<bool>,
}

/// Faces of a named patch with a condition.
fn sides_of(
    patch: &str,
    condition: Patch,
    grid: &FlowGrid,
    faces: &FaceTable,
    topology: &Topology,
) -> Vec<Side> {
    let outer = topology.sides().filter(|side| side.canopy == u32::MAX);
    let of_patch = outer.filter(|side| {
        let face = topology.face_global[side.face as usize] as usize - faces.interior.len();
        grid.patch_name(face) == Some(patch) && grid.boundary[face].0 == condition
    });
    of_patch.copied().collect()
}

impl BoundaryValues {
    /// Data of the patches of `grid`, of which `topology` is a part. `None` where there are none.
    ///
    /// # Errors
    /// A text is not a formula.
    pub fn new(
        inlets: &[InletValues],
        outlets: &[OutletValues],
        walls: &[MovingWall],
        grid: &FlowGrid,
        faces: &FaceTable,
        topology: &Topology,
    ) -> Result<Option<Self>, BoundaryValueError> {
        let add = |patch: &String, condition, value, profile, factor: &Option<TimeFactor>| {
            let no_formula = |source| BoundaryValueError::Formula { patch: patch.clone(), source };
            let factor = TimeFactor::compiled(factor.as_ref()).map_err(no_formula)?;
            let sides = sides_of(patch, condition, grid, faces, topology);
            let shape = vec![1.0; sides.len()];
            Ok(PatchValues { patch: patch.clone(), value, profile, factor, sides, shape, integral: 0.0 })
        };
        let mut patches = Vec::new();
        for i in inlets {
            let value = match (i.velocity_m_s, i.flow_rate_m3_s) {
                (Some(v), _) => Value::Velocity(v.into()),
                (None, rate) => Value::FlowRate(rate.unwrap_or(0.0)),
            };
            let no_formula = |source| BoundaryValueError::Formula { patch: i.patch.clone(), source };
            let profile = i.compiled_profile().map_err(no_formula)?;
            patches.push(add(&i.patch, Patch::Inlet, value, profile, &i.factor)?);
        }
        for o in outlets {
            let value = Value::Pressure(o.pressure_pa);
            patches.push(add(&o.patch, Patch::Outlet, value, InletProfile::Uniform, &o.factor)?);
        }
        for w in walls {
            let value = match &w.rotation {
                Some(r) => {
                    let axis = Vec3::from(r.axis);
                    Value::Rotation(axis * (r.angular_velocity_rad_s / axis.norm()), r.point_m.into())
                }
                None => Value::Sliding(w.velocity_m_s.unwrap_or_default().into()),
            };
            patches.push(add(&w.patch, Patch::Wall, value, InletProfile::Uniform, &w.factor)?);
        }
        Ok((!patches.is_empty()).then_some(Self { patches, time: 0.0 }))
    }

    /// Evaluates the profiles on the faces where they are now, and their integrals over all ranks. Collective.
    ///
    /// # Errors
    /// A profile without a value, one that cannot be scaled, a wall that would leave its surface.
    pub(crate) fn place(&mut self, comm: &Comm, metrics: &Metrics) -> Result<(), BoundaryValueError> {
        for p in &mut self.patches {
            for (shape, side) in p.shape.iter_mut().zip(&p.sides) {
                *shape = p.profile.at(metrics.border(side.face).into());
            }
            p.check_profile(comm, metrics)?;
            p.check_tangential(comm, metrics)?;
            if matches!(p.value, Value::FlowRate(_)) {
                p.integrate(comm, metrics)?;
            }
        }
        Ok(())
    }

    /// Largest speed at a factor of 1 in air of the density `rho` (kg/m3), m/s: that of a pressure is $`\sqrt{2|p|/\rho}`$. Collective.
    pub(crate) fn largest_speed(&self, comm: &Comm, metrics: &Metrics, rho: f64) -> f64 {
        let own = self.patches.iter().flat_map(|p| {
            (0..p.sides.len()).map(|k| match p.value {
                Value::Pressure(pressure) => (2.0 * pressure.abs() / rho).sqrt(),
                _ => p.velocity(k, metrics, 1.0).norm(),
            })
        });
        comm.max(own.fold(0.0, f64::max))
    }

    /// Sets the values at the end of the step: `wind` is the undisturbed velocity, `sound` the speed of sound in it, m/s.
    /// Collective.
    ///
    /// # Errors
    /// A factor without a value, a velocity that is not below the speed of sound.
    pub(crate) fn fill(
        &self,
        comm: &Comm,
        metrics: &Metrics,
        (wind, sound): (Vec3, f64),
        arrays: &mut BoundaryArrays<'_>,
    ) -> Result<(), BoundaryValueError> {
        let first = metrics.faces.len() - arrays.excess.len();
        let time = self.time;
        for p in &self.patches {
            let factor = p.factor.at(time);
            if !factor.is_finite() {
                return Err(BoundaryValueError::Factor { patch: p.patch.clone(), time, value: factor });
            }
            let mut speed = 0.0f64;
            for (k, side) in p.sides.iter().enumerate() {
                let face = side.face as usize - first;
                match p.value {
                    Value::Pressure(pressure) => arrays.pressure[face] = factor * pressure,
                    Value::Velocity(_) | Value::FlowRate(_) => {
                        let velocity = p.velocity(k, metrics, factor);
                        speed = speed.max(velocity.norm());
                        arrays.excess[face] = velocity - wind;
                    }
                    Value::Sliding(_) | Value::Rotation(..) => {
                        arrays.wall_velocity[face] += p.velocity(k, metrics, factor);
                        arrays.wall_spin[face] += p.spin(side, metrics) * factor;
                    }
                }
            }
            if matches!(p.value, Value::Velocity(_) | Value::FlowRate(_)) {
                let speed = comm.max(speed);
                if speed >= sound {
                    return Err(BoundaryValueError::Supersonic {
                        patch: p.patch.clone(),
                        time,
                        speed,
                        sound,
                    });
                }
            }
        }
        Ok(())
    }

    /// Faces of moving walls.
    pub(crate) fn wall_sides(&self) -> impl Iterator<Item = &Side> {
        let moves = |p: &&PatchValues| matches!(p.value, Value::Sliding(_) | Value::Rotation(..));
        self.patches.iter().filter(moves).flat_map(|p| &p.sides)
    }
}

impl PatchValues {
    /// Velocity of the air or the wall on the face of side `k`, m/s; zero at an outlet.
    fn velocity(&self, k: usize, metrics: &Metrics, factor: f64) -> Vec3 {
        let side = &self.sides[k];
        match self.value {
            Value::Velocity(v) => v * (factor * self.shape[k]),
            Value::FlowRate(rate) => {
                let face = &metrics.faces[side.face as usize];
                let inward = face.area * (-side.sign / face.magnitude());
                inward * (factor * self.shape[k] * rate / self.integral)
            }
            Value::Pressure(_) => Vec3::zeros(),
            Value::Sliding(v) => v * factor,
            Value::Rotation(rate, point) => rate.cross(&(metrics.border(side.face) - point)) * factor,
        }
    }

    /// Velocity of the wall, continued as a rigid body to the centre of the cell, less that at the face, m/s.
    fn spin(&self, side: &Side, metrics: &Metrics) -> Vec3 {
        match self.value {
            Value::Rotation(rate, _) => {
                rate.cross(&(metrics.centre(side.cell as usize) - metrics.border(side.face)))
            }
            _ => Vec3::zeros(),
        }
    }

    fn check_profile(&self, comm: &Comm, metrics: &Metrics) -> Result<(), BoundaryValueError> {
        let bad = self.shape.iter().position(|s| !s.is_finite());
        let finding = bad.map(|k| (0, metrics.border(self.sides[k].face), self.shape[k]));
        match agree(comm, finding) {
            None => Ok(()),
            Some((_, (_, at, value))) => {
                Err(BoundaryValueError::Profile { patch: self.patch.clone(), at, value })
            }
        }
    }

    fn check_tangential(&self, comm: &Comm, metrics: &Metrics) -> Result<(), BoundaryValueError> {
        let allowed = match self.value {
            Value::Sliding(_) => PLANE,
            Value::Rotation(..) => FACETTED,
            _ => return Ok(()),
        };
        let share = |k: usize| {
            let (v, face) = (self.velocity(k, metrics, 1.0), &metrics.faces[self.sides[k].face as usize]);
            v.dot(&face.area).abs() / (v.norm() * face.magnitude())
        };
        let bad = (0..self.sides.len()).find(|k| share(*k) > allowed);
        let finding = bad.map(|k| (0, metrics.border(self.sides[k].face), share(k)));
        match agree(comm, finding) {
            None => Ok(()),
            Some((_, (_, at, share))) => {
                Err(BoundaryValueError::NotTangential { patch: self.patch.clone(), at, share })
            }
        }
    }

    fn integrate(&mut self, comm: &Comm, metrics: &Metrics) -> Result<(), BoundaryValueError> {
        let mut sums = [0.0; 2];
        for (shape, side) in self.shape.iter().zip(&self.sides) {
            let area = metrics.faces[side.face as usize].magnitude();
            sums[0] += shape * area;
            sums[1] += shape.abs() * area;
        }
        comm.sum_slice(&mut sums);
        let [integral, magnitude] = sums;
        if integral.abs() <= CANCELLED * magnitude {
            return Err(BoundaryValueError::Integral { patch: self.patch.clone(), integral, magnitude });
        }
        self.integral = integral;
        Ok(())
    }
}
