//! The parameters of studies: their effect on a scene, and the scenes that have them.

use case::set_value;
use case::{Canopy, Integration, Role, Scene, Solve, Stage, StageKind};
use coupling::error::RunError;
use effects::table::TABLE;
use toml::{Table, Value};

use crate::stability::family::SchemeChoice;

/// Value of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// An option.
    Choice(String),
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(x) if *x != 0.0 && (x.abs() < 1e-2 || x.abs() >= 1e5) => write!(f, "{x:e}"),
            // Four decimals, as factors such as 2/3 need no more.
            Self::Number(x) => write!(f, "{}", (x * 1e4).round() / 1e4),
            Self::Choice(word) => write!(f, "{word}"),
        }
    }
}

/// Meaning of the values of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Refinement factor relative to the scene; errors decrease with its inverse.
    Fineness,
    /// A tolerance or another number with which errors decrease.
    Size,
    /// Options without order.
    Choice,
}

/// A parameter by name.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Meaning of its values.
    pub kind: Kind,
    /// Formal order of the method.
    pub promised: f64,
}

type Change = fn(&mut Scene, usize, f64);
/// Name, meaning of the numbers, formal order, test whether a scene has it (with the reason if not), change.
type Entry = (&'static str, Kind, f64, fn(&Scene, usize) -> Result<(), &'static str>, Change);

fn has_role(scene: &Scene, role: Role) -> bool {
    scene.stages.iter().any(|s| scene.roles(s).contains(&role))
}

fn structure_grid(scene: &Scene, _: usize) -> Result<(), &'static str> {
    match scene.canopy {
        Canopy::Gmsh(_) => Err("its canopy mesh is read from a file; repeat the study with a finer file"),
        Canopy::None => Err("it has no canopy"),
        _ => Ok(()),
    }
}

fn flow_grid(scene: &Scene, _: usize) -> Result<(), &'static str> {
    match &scene.flow {
        None => Err("it has no [flow]"),
        Some(_) if !has_role(scene, Role::Flow) => Err("no stage runs the flow"),
        Some(f) if f.grid_file.is_some() => {
            Err("its flow grid is read from a file; repeat the study with a finer file")
        }
        Some(_) => Ok(()),
    }
}

fn in_time(scene: &Scene, stage: usize) -> Result<(), &'static str> {
    let s = &scene.stages[stage];
    if s.steady.is_some() || s.solve == Solve::Static {
        return Err("its stage does not depend on time (static or steady)");
    }
    Ok(())
}

fn substeps(scene: &Scene, stage: usize) -> Result<(), &'static str> {
    in_time(scene, stage)?;
    if !scene.stages[stage].kind.roles().contains(&Role::Structure) {
        return Err("its stage does not run the structure");
    }
    Ok(())
}

fn implicit_coupling(scene: &Scene, _: usize) -> Result<(), &'static str> {
    if !scene.stages.iter().any(|s| s.kind == StageKind::Coupled) {
        return Err("no stage is coupled");
    }
    match scene.coupling.scheme {
        case::Scheme::Implicit => Ok(()),
        case::Scheme::Staggered => Err("a staggered scheme has no tolerance"),
    }
}

fn coupled(scene: &Scene, _: usize) -> Result<(), &'static str> {
    let any = scene.stages.iter().any(|s| s.kind == StageKind::Coupled);
    if any { Ok(()) } else { Err("no stage is coupled") }
}

fn flow(scene: &Scene, _: usize) -> Result<(), &'static str> {
    if has_role(scene, Role::Flow) { Ok(()) } else { Err("no stage runs the flow") }
}

/// A canopy in a stream of which both kinds of grid can be made.
fn method(scene: &Scene, stage: usize) -> Result<(), &'static str> {
    flow_grid(scene, stage)?;
    if !scene.has_canopy() {
        return Err("it has no canopy");
    }
    match &scene.flow {
        Some(f) if f.box_grid.is_some() => Err("its flow grid is a box with walls"),
        _ => Ok(()),
    }
}

/// The scene with the flow method of a word of [`METHOD`].
fn with_method(scene: &Scene, word: &str) -> Result<Scene, RunError> {
    let immersed = match word.split_once(':') {
        None if word == "fitted" => None,
        Some(("immersed", spacing)) => Some(spacing.parse::<f64>().map_err(|_| {
            refuse(METHOD, &format!("`{spacing}` is not a spacing in metres, as in \"immersed:0.1\""))
        })?),
        _ => {
            return Err(refuse(
                METHOD,
                &format!("`{word}` is neither \"fitted\" nor \"immersed:SPACING\" in metres"),
            ));
        }
    };
    let mut text = table(scene)?;
    if let Some(flow) = text.get_mut("flow").and_then(Value::as_table_mut) {
        flow.remove("immersed");
    }
    if let Some(spacing) = immersed {
        set_value(&mut text, &["flow", "immersed"], "spacing_m", Value::Float(spacing))?;
        set_value(&mut text, &["ranks"], "flow", Value::Integer(1))?;
    }
    read(text)
}

fn newton(scene: &Scene, _: usize) -> Result<(), &'static str> {
    if !has_role(scene, Role::Structure) {
        return Err("no stage runs the structure");
    }
    match scene.structure.integration {
        Integration::Explicit => Err("explicit time integration of the structure solves no equations"),
        _ => Ok(()),
    }
}

fn static_stage(scene: &Scene, _: usize) -> Result<(), &'static str> {
    let any = scene.stages.iter().any(|s| s.solve == Solve::Static);
    if any { Ok(()) } else { Err("no stage is static") }
}

fn mover(scene: &Scene, _: usize) -> Result<(), &'static str> {
    if has_role(scene, Role::Mesh) { Ok(()) } else { Err("no stage moves the grid") }
}

fn times(count: u32, factor: f64) -> u32 {
    (f64::from(count) * factor).round().max(1.0) as u32
}

/// Scales the number of cells across a canopy, which must be even.
fn even(count: u32, factor: f64) -> u32 {
    2 * (0.5 * f64::from(count) * factor).round().max(1.0) as u32
}

fn refine_structure(scene: &mut Scene, _: usize, f: f64) {
    match &mut scene.canopy {
        Canopy::Atps(a) => {
            a.cells_across = even(a.cells_across, f);
            a.cells_along_vent = times(a.cells_along_vent, f);
            a.cells_along_stitching = times(a.cells_along_stitching, f);
            // Reinforcements keep their position.
            if a.reinforcement_spacing_cells > 0 {
                a.reinforcement_spacing_cells = times(a.reinforcement_spacing_cells, f);
            }
        }
        Canopy::Square(c) | Canopy::Circular(c) => c.cells_across = even(c.cells_across, f),
        Canopy::Gored(g) => {
            g.cells_along = times(g.cells_along, f);
            g.cells_per_gore = even(g.cells_per_gore, f);
        }
        Canopy::Cross(x) => {
            x.cells_across = even(x.cells_across, f);
            x.cells_along_arm = times(x.cells_along_arm, f);
        }
        Canopy::AirBag(b) => b.cells_across = times(b.cells_across, f),
        Canopy::Panel(p) => p.cells = p.cells.map(|c| if c == 1 { 1 } else { times(c, f) }),
        Canopy::Pattern(p) => p.element_size_m /= f,
        Canopy::Gmsh(_) | Canopy::None => {}
    }
}

fn refine_flow(scene: &mut Scene, _: usize, f: f64) {
    let Some(flow) = &mut scene.flow else { return };
    if let Some(g) = &mut flow.immersed {
        g.spacing_m /= f;
        return;
    }
    if let Some(b) = &mut flow.box_grid {
        b.layers_below = times(b.layers_below, f);
        b.layers_above = times(b.layers_above, f);
        b.cells_ahead = if b.cells_ahead > 0 { times(b.cells_ahead, f) } else { 0 };
        b.cells_behind = if b.cells_behind > 0 { times(b.cells_behind, f) } else { 0 };
        b.first_layer_m = b.first_layer_m.map(|h| h / f);
        return;
    }
    let g = &mut flow.grid;
    g.layers_inside = times(g.layers_inside, f).max(2);
    g.layers_outside = times(g.layers_outside, f).max(4);
    g.cells_across_vent = times(g.cells_across_vent, f);
    g.first_layer_m /= f;
}

/// Changes the window at a constant time step of the structure, which is another parameter.
fn shorten_windows(scene: &mut Scene, stage: usize, f: f64) {
    let s: &mut Stage = &mut scene.stages[stage];
    let count = (s.windows() as f64 * f).round().max(1.0);
    s.window_s = s.duration_s / count;
    s.substeps = (f64::from(s.substeps) / f).round().max(1.0) as u32;
}

const NUMBERS: &[Entry] = &[
    ("structure-grid", Kind::Fineness, 2.0, structure_grid, refine_structure),
    ("flow-grid", Kind::Fineness, 2.0, flow_grid, refine_flow),
    (
        "grid",
        Kind::Fineness,
        2.0,
        |s, i| flow_grid(s, i).and(structure_grid(s, i)),
        |s, i, f| {
            refine_structure(s, i, f);
            refine_flow(s, i, f);
        },
    ),
    ("window", Kind::Fineness, 2.0, in_time, shorten_windows),
    ("substeps", Kind::Fineness, 2.0, substeps, |s, i, f| {
        s.stages[i].substeps = times(s.stages[i].substeps, f)
    }),
    ("coupling-tolerance", Kind::Size, 1.0, implicit_coupling, |s, _, x| s.coupling.tolerance = x),
    ("flow-drop", Kind::Size, 1.0, flow, |s, _, x| {
        if let Some(f) = &mut s.flow {
            f.solver.residual_drop = x;
        }
    }),
    ("newton-tolerance", Kind::Size, 1.0, newton, |s, _, x| s.structure.newton_tolerance = x),
    ("gmres-tolerance", Kind::Size, 1.0, newton, |s, _, x| s.structure.gmres_tolerance = x),
    ("static-tolerance", Kind::Size, 1.0, static_stage, |s, _, x| s.structure.static_tolerance = x),
    ("mover-tolerance", Kind::Size, 1.0, mover, |s, _, x| s.mesh.tolerance = x),
];

/// The parameter of coupling schemes. Like effects and keys of the scene, it is not in [`NUMBERS`].
const SCHEME: &str = "scheme";
/// The parameter of flow methods: `fitted`, or `immersed:SPACING` with the spacing of the Cartesian grid in metres.
const METHOD: &str = "method";

/// Names of all parameters except effects and keys.
pub fn names() -> Vec<&'static str> {
    NUMBERS.iter().map(|e| e.0).chain([SCHEME, METHOD]).collect()
}

fn refuse(name: &str, why: &str) -> RunError {
    RunError::Input(format!("parameter `{name}` is not available in this scene: {why}"))
}

impl Parameter {
    /// Finds `name`; `words`: its values are options.
    ///
    /// # Errors
    /// The parameter does not exist, or `scene` does not have it (with the reason).
    pub fn find(name: &str, scene: &Scene, stage: usize, words: bool) -> Result<Self, RunError> {
        let parameter = |kind, promised| Self { name: name.into(), kind, promised };
        if let Some((_, kind, promised, fits, _)) = NUMBERS.iter().find(|e| e.0 == name) {
            fits(scene, stage).map_err(|why| refuse(name, why))?;
            if words {
                return Err(refuse(name, "its values are numbers: give `values` instead of `choices`"));
            }
            return Ok(parameter(*kind, *promised));
        }
        if name == SCHEME {
            coupled(scene, stage).map_err(|why| refuse(name, why))?;
            return if words {
                Ok(parameter(Kind::Choice, 0.0))
            } else {
                Err(refuse(name, "its values are schemes: give `choices`"))
            };
        }
        if name == METHOD {
            method(scene, stage).map_err(|why| refuse(name, why))?;
            return if words {
                Ok(parameter(Kind::Choice, 0.0))
            } else {
                Err(refuse(name, "its values are methods: give choices = [\"fitted\", \"immersed:SPACING\"]"))
            };
        }
        if name.contains("precision") {
            return Err(refuse(
                name,
                "the precision of preconditioners is fixed: those of the flow-solver and the mesh-mover always use single \
                 precision",
            ));
        }
        if let Some(entry) = TABLE.iter().find(|e| e.key == name) {
            if entry.without.is_none() && entry.with.is_none() {
                return Err(refuse(name, "this effect cannot be removed from a scene"));
            }
            return if words {
                Ok(parameter(Kind::Choice, 0.0))
            } else {
                Err(refuse(name, "give choices = [\"on\", \"off\"]"))
            };
        }
        if name.contains('.') {
            return Ok(parameter(if words { Kind::Choice } else { Kind::Size }, 1.0));
        }
        Err(RunError::Input(format!(
            "there is no parameter `{name}`. Valid are {}, the effects listed by `ripstop effects`, and dotted keys of the \
             scene such as `flow.solver.residual_drop`",
            names().join(", ")
        )))
    }

    /// Whether the scene has the parameter of this name with numbers.
    pub fn fits(name: &str, scene: &Scene, stage: usize) -> bool {
        NUMBERS.iter().any(|e| e.0 == name && (e.3)(scene, stage).is_ok())
    }

    /// Value in the scene.
    pub fn own(&self, scene: &Scene) -> Option<Setting> {
        let number = match self.name.as_str() {
            _ if self.kind == Kind::Fineness => 1.0,
            "coupling-tolerance" => scene.coupling.tolerance,
            "flow-drop" => scene.flow.as_ref()?.solver.residual_drop,
            "newton-tolerance" => scene.structure.newton_tolerance,
            "gmres-tolerance" => scene.structure.gmres_tolerance,
            "static-tolerance" => scene.structure.static_tolerance,
            "mover-tolerance" => scene.mesh.tolerance,
            SCHEME => return Some(Setting::Choice("default".into())),
            METHOD => {
                let immersed = scene.flow.as_ref()?.immersed.as_ref();
                let word = immersed.map_or("fitted".into(), |g| format!("immersed:{}", g.spacing_m));
                return Some(Setting::Choice(word));
            }
            key => {
                if let Some(entry) = TABLE.iter().find(|e| e.key == key) {
                    return Some(Setting::Choice(if (entry.on)(scene) { "on" } else { "off" }.into()));
                }
                let table = table(scene).ok()?;
                let mut at = Some(&Value::Table(table)).cloned();
                for part in key.split('.') {
                    at = at?.as_table()?.get(part).cloned();
                }
                return match at? {
                    Value::Float(x) => Some(Setting::Number(x)),
                    Value::Integer(n) => Some(Setting::Number(n as f64)),
                    Value::Boolean(b) => Some(Setting::Choice(b.to_string())),
                    Value::String(s) => Some(Setting::Choice(s)),
                    _ => None,
                };
            }
        };
        Some(Setting::Number(number))
    }

    /// The scene with the parameter set to `to`.
    ///
    /// # Errors
    /// A setting that is invalid in this scene.
    pub fn set_in(&self, scene: &Scene, stage: usize, to: &Setting) -> Result<Scene, RunError> {
        if self.own(scene).as_ref() == Some(to) {
            return Ok(scene.clone());
        }
        let mut scene = scene.clone();
        match to {
            Setting::Number(x) => {
                if let Some((.., change)) = NUMBERS.iter().find(|e| e.0 == self.name) {
                    change(&mut scene, stage, *x);
                    return Ok(scene);
                }
                let whole = x.fract() == 0.0 && matches!(self.value(&scene), Some(Value::Integer(_)));
                let value = if whole { Value::Integer(*x as i64) } else { Value::Float(*x) };
                self.set(&scene, value)
            }
            Setting::Choice(word) if self.name == SCHEME => {
                let mut text = table(&scene)?;
                SchemeChoice(word.clone()).apply(&mut text)?;
                read(text)
            }
            Setting::Choice(word) if self.name == METHOD => with_method(&scene, word),
            Setting::Choice(word) => {
                let Some(entry) = TABLE.iter().find(|e| e.key == self.name) else {
                    let value = word.parse().map_or_else(|_| Value::String(word.clone()), Value::Boolean);
                    return self.set(&scene, value);
                };
                let change = match word.as_str() {
                    "on" => entry.with,
                    "off" => entry.without,
                    _ => return Err(refuse(&self.name, "an effect is \"on\" or \"off\"")),
                };
                let change = change.ok_or_else(|| {
                    refuse(&self.name, &format!("the effect has no default settings for \"{word}\""))
                })?;
                change(&mut scene);
                Ok(scene)
            }
        }
    }

    fn value(&self, scene: &Scene) -> Option<Value> {
        let mut at = Value::Table(table(scene).ok()?);
        for part in self.name.split('.') {
            at = at.as_table()?.get(part)?.clone();
        }
        Some(at)
    }

    fn set(&self, scene: &Scene, value: Value) -> Result<Scene, RunError> {
        let mut text = table(scene)?;
        let parts: Vec<&str> = self.name.split('.').collect();
        let (key, path) = parts.split_last().unwrap_or((&"", &[]));
        set_value(&mut text, path, key, value)?;
        read(text)
    }

    /// Size that errors decrease with: inverse of the refinement factor, or the tolerance.
    pub fn size(&self, at: &Setting) -> Option<f64> {
        match (self.kind, at) {
            (Kind::Fineness, Setting::Number(f)) => Some(1.0 / f),
            (Kind::Size, Setting::Number(x)) => Some(*x),
            _ => None,
        }
    }
}

/// A scene as a TOML table.
pub fn table(scene: &Scene) -> Result<Table, RunError> {
    let text = toml::to_string(scene)
        .map_err(|e| RunError::Input(format!("the scene cannot be written as TOML: {e}")))?;
    text.parse().map_err(|e| RunError::Input(format!("the written scene cannot be read: {e}")))
}

fn read(table: Table) -> Result<Scene, RunError> {
    let text = toml::to_string(&table).map_err(|e| RunError::Input(e.to_string()))?;
    case::parse(std::path::Path::new("scene.toml"), &text).map_err(|e| RunError::Input(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(name: &str) -> Scene {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../cases")
            .join(name)
            .join("scene.toml");
        case::load(&file).unwrap()
    }

    fn modified(scene: &Scene, name: &str, to: Setting) -> Scene {
        let stage = scene.stages.len() - 1;
        let words = matches!(to, Setting::Choice(_));
        Parameter::find(name, scene, stage, words).unwrap().set_in(scene, stage, &to).unwrap()
    }

    #[test]
    fn each_parameter_changes_its_setting_only() {
        let base = scene("square-drop");
        let n = Setting::Number;
        let s = modified(&base, "grid", n(0.5));
        let (Canopy::Square(c), Some(f)) = (&s.canopy, &s.flow) else { panic!() };
        assert_eq!((c.cells_across, f.grid.layers_inside, f.grid.layers_outside), (6, 3, 5));
        assert!((f.grid.first_layer_m - 0.2).abs() < 1e-12);
        let s = modified(&base, "window", n(2.0));
        assert_eq!((s.stages[2].window_s, s.stages[2].substeps), (2.5e-3, 5));
        assert_eq!(s.stages[2].windows(), 2 * base.stages[2].windows());
        let immersed = scene("atps-opening");
        let finer = modified(&immersed, "flow-grid", n(2.0));
        let spacing = |s: &Scene| s.flow.as_ref().and_then(|f| f.immersed.as_ref()).map(|g| g.spacing_m);
        assert_eq!(spacing(&finer), spacing(&immersed).map(|h| 0.5 * h));
        assert_eq!(modified(&base, "substeps", n(0.5)).stages[2].substeps, 5);
        assert_eq!(modified(&base, "coupling-tolerance", n(1e-4)).coupling.tolerance, 1e-4);
        assert_eq!(modified(&base, "mover-tolerance", n(1e-4)).mesh.tolerance, 1e-4);
        assert_eq!(modified(&base, "coupling.reused_windows", n(3.0)).coupling.reused_windows, 3);
        let c = |w: &str| Setting::Choice(w.into());
        assert_eq!(modified(&base, "scheme", c("staggered")).coupling.scheme, case::Scheme::Staggered);
        let moved = modified(&base, "method", c("immersed:0.1"));
        assert_eq!((spacing(&moved), moved.ranks.flow), (Some(0.1), 1));
        assert!(!moved.roles(&moved.stages[2]).contains(&Role::Mesh));
        assert_eq!(spacing(&modified(&moved, "method", c("fitted"))), None);
        // Closed vents have no fitted grid.
        assert!(with_method(&immersed, "fitted").is_err());
        assert!(!modified(&base, "fabric.wrinkling", c("off")).fabric.wrinkling);
        assert_eq!(modified(&base, "mesh.mover", c("laplacian")).mesh.mover, case::MoverKind::Laplacian);
    }

    #[test]
    fn value_of_the_scene_leaves_it_unchanged() {
        let base = scene("atps-descent");
        for name in names().into_iter().filter(|n| Parameter::fits(n, &base, 2)) {
            let parameter = Parameter::find(name, &base, 2, false).unwrap();
            let same = parameter.set_in(&base, 2, &parameter.own(&base).unwrap()).unwrap();
            assert_eq!(toml::to_string(&same).unwrap(), toml::to_string(&base).unwrap(), "{name}");
        }
    }

    #[test]
    fn unavailable_parameters_are_refused_with_the_reason() {
        let refused = |case: &str, name: &str, words: bool| {
            let s = scene(case);
            Parameter::find(name, &s, s.stages.len() - 1, words).unwrap_err().to_string()
        };
        assert!(refused("air-bag", "coupling-tolerance", false).contains("no stage is coupled"));
        assert!(refused("air-bag", "newton-tolerance", false).contains("explicit"));
        assert!(refused("plate-gmsh", "flow-grid", false).contains("file"));
        assert!(refused("plate-gmsh", "method", true).contains("file"));
        assert!(refused("hard/cavity", "method", true).contains("box"));
        assert!(refused("square-drop", "method", false).contains("immersed:SPACING"));
        let base = scene("square-drop");
        for word in ["immersed", "immersed:x", "cut-cells"] {
            assert!(with_method(&base, word).is_err(), "{word}");
        }
        assert!(refused("plate-gmsh", "substeps", false).contains("structure"));
        assert!(refused("square-drop", "magic", false).contains("coupling-tolerance"));
        assert!(refused("square-drop", "preconditioner-precision", true).contains("single"));
        assert!(refused("square-drop", "scheme", false).contains("choices"));
        let s = scene("square-drop");
        let typo = Parameter::find("coupling.tolerence", &s, 2, false).unwrap();
        assert!(typo.set_in(&s, 2, &Setting::Number(1.0)).unwrap_err().to_string().contains("did you mean"));
    }
}
