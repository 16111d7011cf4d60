//! `[[flow.inlet]]`, `[[flow.outlet]]` and `[[flow.moving_wall]]`: data of single boundary patches.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::gust::THREE_SPEEDS;
use crate::check::Check;
use crate::{BoxSides, Condition, Flow, Formula, FormulaError, Scene};

/// Velocity or flow rate of one inlet: profile in space times factor of time. An inlet without such a table holds the
/// velocity of the undisturbed air.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InletValues {
    /// A side of `[flow.box]` or a group of `[flow.grid_file]` with the condition `"inlet"`.
    pub patch: String,
    /// Velocity where profile and factor are 1, m/s in the frame of the ground. Either this or `flow_rate_m3_s`.
    pub velocity_m_s: Option<[f64; 3]>,
    /// Volume that enters the domain through all faces of the patch in unit time, m3/s. The velocity is along the inward normal of each
    /// face; its magnitude is the profile, scaled to this integral.
    pub flow_rate_m3_s: Option<f64>,
    /// Formula of `x`, `y` and `z` (m, on the grid) with `+ - * / ^ ( )`, `pi`, `sin`, `cos`, `tan`, `exp`, `log`, `sqrt`,
    /// `abs`, `tanh`, `min`, `max`. Absent, and without `profile_table`: uniform.
    pub profile: Option<String>,
    /// Values over one or two coordinates, instead of `profile`.
    pub profile_table: Option<ProfileTable>,
    /// Factor of time. Absent: 1.
    pub factor: Option<TimeFactor>,
}

/// Values over one or two coordinates, linear between them (bilinear with two) and constant beyond.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProfileTable {
    /// Strictly increasing coordinates, m.
    pub x_m: Vec<f64>,
    /// Strictly increasing coordinates, m.
    pub y_m: Vec<f64>,
    /// Strictly increasing coordinates, m.
    pub z_m: Vec<f64>,
    /// A row for each value of the first coordinate that is given, in it a number for each value of the second. With one
    /// coordinate each row has one number.
    pub value: Vec<Vec<f64>>,
}

/// Factor of time, as a formula or a table. Its time is that since the start of the stage; it is evaluated at the end of
/// each step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TimeFactor {
    /// Formula of `t` (s). Either this or `time_s` and `value`.
    pub formula: Option<String>,
    /// Strictly increasing times, s.
    pub time_s: Vec<f64>,
    /// Factor at each time; linear in between, constant beyond.
    pub value: Vec<f64>,
}

/// Pressure of one outlet. An outlet without such a table holds a gauge pressure of zero.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutletValues {
    /// A side of `[flow.box]` or a group of `[flow.grid_file]` with the condition `"outlet"`.
    pub patch: String,
    /// Gauge pressure on the faces, Pa. Air that flows back has the velocity and temperature of the undisturbed air.
    pub pressure_pa: f64,
    /// Factor of time. Absent: 1.
    pub factor: Option<TimeFactor>,
}

/// Tangential velocity of one no-slip wall, on top of the motion of the grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MovingWall {
    /// A side of `[flow.box]` or a group of `[flow.grid_file]` with the condition `"wall"`.
    pub patch: String,
    /// Velocity of the wall in the frame of the canopy, m/s, without a component normal to the wall. Either this or `rotation`.
    pub velocity_m_s: Option<[f64; 3]>,
    /// Rotation about an axis.
    pub rotation: Option<WallRotation>,
    /// Factor of time. Absent: 1.
    pub factor: Option<TimeFactor>,
}

/// Rotation of a wall that is a surface of revolution about the axis: the grid stays where it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallRotation {
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// A point of the axis, m.
    pub point_m: [f64; 3],
    /// Angular velocity, rad/s, right-handed about the axis.
    pub angular_velocity_rad_s: f64,
}

/// Profile of an inlet in space.
#[derive(Clone, Debug)]
pub enum InletProfile {
    /// 1 everywhere.
    Uniform,
    /// A formula of x, y, z.
    Formula(Formula),
    /// A table over one or two coordinates.
    Table(ProfileTable),
}

/// Factor of time.
#[derive(Clone, Debug)]
pub enum TimeFunction {
    /// 1 at all times.
    Constant,
    /// A formula of t.
    Formula(Formula),
    /// Times, s, and factors.
    Table(Vec<f64>, Vec<f64>),
}

impl InletValues {
    /// The profile.
    ///
    /// # Errors
    /// The text is not a formula.
    pub fn compiled_profile(&self) -> Result<InletProfile, FormulaError> {
        Ok(match (&self.profile, &self.profile_table) {
            (Some(text), _) => InletProfile::Formula(Formula::parse(text, &["x", "y", "z"])?),
            (None, Some(table)) => InletProfile::Table(table.clone()),
            (None, None) => InletProfile::Uniform,
        })
    }
}

impl InletProfile {
    /// Value at `x`, m.
    pub fn at(&self, x: [f64; 3]) -> f64 {
        match self {
            Self::Uniform => 1.0,
            Self::Formula(f) => f.at(&x),
            Self::Table(t) => t.at(x),
        }
    }
}

impl TimeFactor {
    /// The function of an optional factor.
    ///
    /// # Errors
    /// The text is not a formula.
    pub fn compiled(this: Option<&Self>) -> Result<TimeFunction, FormulaError> {
        Ok(match this {
            None => TimeFunction::Constant,
            Some(Self { formula: Some(text), .. }) => TimeFunction::Formula(Formula::parse(text, &["t"])?),
            Some(table) => TimeFunction::Table(table.time_s.clone(), table.value.clone()),
        })
    }
}

impl TimeFunction {
    /// Factor at the time `t`, s.
    pub fn at(&self, t: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Formula(f) => f.at(&[t]),
            Self::Table(times, values) => {
                let (k, share) = place(times, t);
                values[k] + share * (values[(k + 1).min(values.len() - 1)] - values[k])
            }
        }
    }
}

/// Interval of increasing `points` in which `x` lies, and where in it; the ends beyond them.
fn place(points: &[f64], x: f64) -> (usize, f64) {
    match points.partition_point(|p| *p <= x) {
        0 => (0, 0.0),
        k if k == points.len() => (k - 1, 0.0),
        k => (k - 1, (x - points[k - 1]) / (points[k] - points[k - 1])),
    }
}

impl ProfileTable {
    /// Coordinates that are given: axis and values.
    fn axes(&self) -> impl Iterator<Item = (usize, &[f64])> {
        [&self.x_m, &self.y_m, &self.z_m]
            .into_iter()
            .map(Vec::as_slice)
            .enumerate()
            .filter(|(_, a)| !a.is_empty())
    }

    /// Value at `x`, m.
    pub fn at(&self, x: [f64; 3]) -> f64 {
        let mut axes = self.axes().map(|(d, points)| place(points, x[d]));
        let (Some((i, a)), second) = (axes.next(), axes.next()) else { return f64::NAN };
        let row = |i: usize| {
            let row = &self.value[i.min(self.value.len() - 1)];
            let (j, b) = second.unwrap_or((0, 0.0));
            row[j] + b * (row[(j + 1).min(row.len() - 1)] - row[j])
        };
        row(i) + a * (row(i + 1) - row(i))
    }
}

/// A patch by its name: its condition, and the direction of its normal where it is a plane that the scene knows.
struct Named {
    condition: Condition,
    normal: Option<usize>,
}

/// The patches that a scene names, or a message where it has none of this name.
fn named(f: &Flow, patch: &str) -> Result<Named, [String; 2]> {
    let (section, names) = match (&f.box_grid, &f.grid_file) {
        (Some(b), _) => {
            let side = BoxSides::NAMES.iter().position(|n| *n == patch);
            if let Some(k) = side {
                return Ok(Named { condition: b.sides.in_order()[k], normal: Some(k / 2) });
            }
            ("[flow.box]", BoxSides::NAMES.join(", "))
        }
        (None, Some(g)) => {
            if let Some(&condition) = g.patches.get(patch) {
                return Ok(Named { condition, normal: None });
            }
            let names: Vec<&str> = g.patches.keys().map(String::as_str).collect();
            ("[flow.grid_file.patches]", names.join(", "))
        }
        (None, None) => {
            let help = "use [flow.box] around a panel or [flow.grid_file], which name their patches";
            return Err(["the generated grid has a far field only, no named patches".into(), help.into()]);
        }
    };
    Err([format!("{section} has no patch \"{patch}\""), format!("name one of: {names}")])
}

/// Refuses a patch that is not there, has another condition or occurs twice.
fn patch(
    f: &Flow,
    at: &str,
    patch: &str,
    wanted: Condition,
    others: &[&str],
    c: &mut Check,
) -> Option<Named> {
    let at = format!("{at}.patch");
    let found = match named(f, patch) {
        Ok(found) => found,
        Err([what, help]) => {
            c.refuse(&at, what, help);
            return None;
        }
    };
    if found.condition != wanted {
        let (is, wanted) = (found.condition.name(), wanted.name());
        c.refuse(
            &at,
            format!("the patch \"{patch}\" has the condition \"{is}\", but this table is for \"{wanted}\""),
            format!("give the patch the condition \"{wanted}\", or remove this table"),
        );
    }
    if others.contains(&patch) {
        c.refuse(&at, format!("the patch \"{patch}\" has two of these tables"), "keep one of them");
    }
    Some(found)
}

/// Refuses data that its patch cannot have.
pub(super) fn check(scene: &Scene, f: &Flow, c: &mut Check) {
    let names = |k: usize| f.inlets[..k].iter().map(|i| i.patch.as_str()).collect::<Vec<_>>();
    for (k, inlet) in f.inlets.iter().enumerate() {
        let at = format!("flow.inlet[{k}]");
        patch(f, &at, &inlet.patch, Condition::Inlet, &names(k), c);
        inlet_values(inlet, &at, c);
        factor(inlet.factor.as_ref(), scene, &at, c);
    }
    let names = |k: usize| f.outlets[..k].iter().map(|o| o.patch.as_str()).collect::<Vec<_>>();
    for (k, outlet) in f.outlets.iter().enumerate() {
        let at = format!("flow.outlet[{k}]");
        patch(f, &at, &outlet.patch, Condition::Outlet, &names(k), c);
        c.range(&format!("{at}.pressure_pa"), outlet.pressure_pa, -5e4..=1e6, "gauge pressure in Pa");
        factor(outlet.factor.as_ref(), scene, &at, c);
    }
    let names = |k: usize| f.moving_walls[..k].iter().map(|w| w.patch.as_str()).collect::<Vec<_>>();
    for (k, wall) in f.moving_walls.iter().enumerate() {
        let at = format!("flow.moving_wall[{k}]");
        let found = patch(f, &at, &wall.patch, Condition::Wall, &names(k), c);
        wall_motion(wall, found.and_then(|p| p.normal), f, &at, c);
        factor(wall.factor.as_ref(), scene, &at, c);
    }
    changing_wind(scene, f, c);
}

/// A gust accelerates all of the air, also between an inlet and an outlet whose data do not follow it.
fn changing_wind(scene: &Scene, f: &Flow, c: &mut Check) {
    let ramp = scene.stages.iter().any(|s| s.wind.as_ref().is_some_and(|w| w.ramp_s > 0.0));
    if !f.inlets.is_empty() && (scene.has_gust() || ramp) {
        c.refuse(
            "flow.inlet[0]",
            "the wind changes in time and accelerates all of the air, but this inlet has a velocity of its own",
            "remove the gust or ramp of the wind and give the inlet a `factor` of time, or remove [[flow.inlet]]",
        );
    }
}

fn inlet_values(inlet: &InletValues, at: &str, c: &mut Check) {
    match (&inlet.velocity_m_s, inlet.flow_rate_m3_s) {
        (Some(v), None) => c.finite(&format!("{at}.velocity_m_s"), v, "a velocity", THREE_SPEEDS),
        (None, Some(q)) => c.range(&format!("{at}.flow_rate_m3_s"), q, -1e9..=1e9, "m3/s into the domain"),
        (Some(_), Some(_)) => c.refuse(
            &format!("{at}.flow_rate_m3_s"),
            "the inlet has a velocity and a flow rate",
            "keep `velocity_m_s` or `flow_rate_m3_s`",
        ),
        (None, None) => c.refuse(
            at,
            "the inlet has neither a velocity nor a flow rate",
            "add `velocity_m_s` or `flow_rate_m3_s`; without this table the inlet holds the velocity of the wind",
        ),
    }
    if inlet.profile.is_some() && inlet.profile_table.is_some() {
        c.refuse(&format!("{at}.profile"), "the inlet has two profiles", "keep `profile` or `profile_table`");
    }
    if let Err(error) = inlet.compiled_profile() {
        c.refuse(&format!("{at}.profile"), error.to_string(), "write a formula, as \"1.5*(1 - y^2)\"");
    }
    if let Some(table) = &inlet.profile_table {
        profile_table(table, &format!("{at}.profile_table"), c);
    }
}

fn ascending(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite()) && values.windows(2).all(|w| w[0] < w[1])
}

fn profile_table(t: &ProfileTable, at: &str, c: &mut Check) {
    for (key, values) in [("x_m", &t.x_m), ("y_m", &t.y_m), ("z_m", &t.z_m)] {
        if !ascending(values) {
            c.refuse(
                &format!("{at}.{key}"),
                "the coordinates do not increase, or one is not a number",
                "list them in increasing order",
            );
        }
    }
    let axes: Vec<usize> = t.axes().map(|(_, points)| points.len()).collect();
    let (rows, columns) = match axes[..] {
        [rows] => (rows, 1),
        [rows, columns] => (rows, columns),
        _ => {
            let what = format!("the table has {} coordinates", axes.len());
            return c.refuse(at, what, "give one or two of `x_m`, `y_m` and `z_m`");
        }
    };
    let value = format!("{at}.value");
    if t.value.len() != rows || t.value.iter().any(|row| row.len() != columns) {
        c.refuse(
            &value,
            format!("the values are not {rows} rows of {columns}"),
            "give a row for each value of the first coordinate, in it a number for each value of the second",
        );
    }
    c.finite(&value, &t.value.concat(), "a value", "numbers");
}

fn factor(f: Option<&TimeFactor>, scene: &Scene, at: &str, c: &mut Check) {
    let Some(f) = f else { return };
    let at = format!("{at}.factor");
    let table = !f.time_s.is_empty() || !f.value.is_empty();
    if f.formula.is_some() == table {
        let what = if table { "the factor has a formula and a table" } else { "the factor is empty" };
        c.refuse(&at, what, "give `formula`, or `time_s` and `value`");
    }
    if let Err(error) = TimeFactor::compiled(Some(f)) {
        c.refuse(&format!("{at}.formula"), error.to_string(), "write a formula, as \"1 + 0.1*sin(2*pi*t)\"");
    }
    if table {
        if f.time_s.len() != f.value.len() {
            let what = format!("{} times, but {} values", f.time_s.len(), f.value.len());
            c.refuse(&format!("{at}.value"), what, "give one value for each time");
        }
        if !ascending(&f.time_s) {
            c.refuse(
                &format!("{at}.time_s"),
                "the times do not increase, or one is not a number",
                "list them in increasing order",
            );
        }
        c.finite(&format!("{at}.value"), &f.value, "a value", "numbers");
    }
    if let Some(stage) = scene.stages.iter().find(|s| s.steady.is_some()) {
        c.refuse(
            &at,
            format!("the factor changes in time, but stage \"{}\" marches to a steady state", stage.name),
            "remove the factor, or give the stage a duration instead of [stage.steady]",
        );
    }
}

/// Share of a speed below which a normal component counts as round-off.
const ROUND_OFF: f64 = 1e-9;

fn wall_motion(wall: &MovingWall, normal: Option<usize>, f: &Flow, at: &str, c: &mut Check) {
    if f.viscosity.is_none() {
        c.refuse(
            at,
            "a wall moves the air by friction only, but the flow is inviscid",
            "add [flow.viscosity], or remove this table",
        );
    }
    match (&wall.velocity_m_s, &wall.rotation) {
        (Some(v), None) => sliding(v, normal, at, c),
        (None, Some(r)) => rotation(r, normal, &format!("{at}.rotation"), c),
        (Some(_), Some(_)) => c.refuse(
            &format!("{at}.rotation"),
            "the wall slides and rotates",
            "keep `velocity_m_s` or `rotation`",
        ),
        (None, None) => {
            c.refuse(at, "the wall has neither a velocity nor a rotation", "add `velocity_m_s` or `rotation`")
        }
    }
}

fn sliding(v: &[f64; 3], normal: Option<usize>, at: &str, c: &mut Check) {
    let at = format!("{at}.velocity_m_s");
    c.finite(&at, v, "a velocity", THREE_SPEEDS);
    let speed = v.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if let Some(d) = normal.filter(|d| v[*d].abs() > ROUND_OFF * speed) {
        c.refuse(
            &at,
            format!("the velocity has the component {} m/s normal to the wall; no air passes a wall", v[d]),
            format!("set component {d} (of 0, 1, 2) to 0; for a wall that lets air pass use an \"inlet\""),
        );
    }
}

fn rotation(r: &WallRotation, normal: Option<usize>, at: &str, c: &mut Check) {
    let axis = format!("{at}.axis");
    c.range(&format!("{at}.angular_velocity_rad_s"), r.angular_velocity_rad_s, -1e6..=1e6, "rad/s");
    c.finite(&format!("{at}.point_m"), &r.point_m, "the point", "three numbers in m");
    let length = r.axis.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if !r.axis.iter().all(|x| x.is_finite()) || length == 0.0 {
        c.refuse(&axis, "the axis has no direction", "name a vector, as [0, 0, 1]");
    } else if let Some(d) = normal
        && (0..3).any(|k| k != d && r.axis[k].abs() > ROUND_OFF * length)
    {
        c.refuse(
            &axis,
            "the axis is not normal to this plane wall, so that the wall would move out of its plane",
            format!("set the components of the axis other than {d} (of 0, 1, 2) to 0"),
        );
    }
}
