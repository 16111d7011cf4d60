//! Physical sense of a scene: magnitudes, and sections that need each other.

use crate::{Canopy, Flow, Integration, MoverKind, OuterBoundary, Scene, Solve, Stage, StageKind};

/// A refused value by its dotted path.
pub(crate) struct Refusal {
    pub path: String,
    pub what: String,
    pub help: String,
}

pub(crate) struct Check(Vec<Refusal>);

impl Check {
    pub(crate) fn refuse(&mut self, path: &str, what: impl Into<String>, help: impl Into<String>) {
        self.0.push(Refusal { path: path.into(), what: what.into(), help: help.into() });
    }

    /// `low < value <= high`, or `low <= value` where `low` itself is allowed.
    pub(crate) fn range(&mut self, path: &str, value: f64, low: f64, high: f64, with_low: bool, why: &str) {
        let above = if with_low { value >= low } else { value > low };
        if !(above && value <= high) {
            let from = if with_low { "from" } else { "above" };
            self.refuse(
                path,
                format!("`{path}` is {value}"),
                format!("allowed: {from} {low} to {high}; {why}"),
            );
        }
    }

    pub(crate) fn positive(&mut self, path: &str, value: f64, high: f64, why: &str) {
        // Products of smaller ones are zero.
        if value > 0.0 && value < SMALLEST {
            self.refuse(
                path,
                format!("`{path}` is {value:e}"),
                format!("allowed: {SMALLEST:e} and more; {why}"),
            );
            return;
        }
        self.range(path, value, 0.0, high, false, why);
    }

    pub(crate) fn count(&mut self, path: &str, value: u32, low: u32, high: u32, why: &str) {
        if !(low..=high).contains(&value) {
            self.refuse(path, format!("`{path}` is {value}"), format!("allowed: {low} to {high}; {why}"));
        }
    }
}

/// The smallest of the numbers that must be positive.
const SMALLEST: f64 = 1e-60;

/// Everything about the scene that no solver could work with.
pub(crate) fn problems(scene: &Scene) -> Vec<Refusal> {
    let mut c = Check(Vec::new());
    names(scene, &mut c);
    canopy(scene, &mut c);
    materials(scene, &mut c);
    point_masses(scene, &mut c);
    solvers(scene, &mut c);
    crate::validate_flow::flow_effects(scene, &mut c);
    crate::validate_wind::winds(scene, &mut c);
    crate::validate_effects::effects(scene, &mut c);
    crate::panel_box::flow_box(scene, &mut c);
    stages(scene, &mut c);
    c.0
}

fn plain_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 64
        && !name.starts_with('.')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
}

fn names(scene: &Scene, c: &mut Check) {
    let help = "use letters, digits, `-`, `_` and `.`: it becomes the name of a folder";
    if !plain_name(&scene.name) {
        c.refuse("name", format!("`name` is \"{}\"", scene.name), help);
    }
    for (i, stage) in scene.stages.iter().enumerate() {
        let path = format!("stage[{i}].name");
        if !plain_name(&stage.name) {
            c.refuse(&path, format!("`{path}` is \"{}\"", stage.name), help);
        }
        if scene.stages[..i].iter().any(|s| s.name == stage.name) {
            c.refuse(
                &path,
                format!("two stages are named \"{}\"", stage.name),
                "give each stage its own name",
            );
        }
    }
}

fn even(c: &mut Check, path: &str, value: u32) {
    c.count(path, value, 2, 2000, "cells across a panel");
    if value % 2 == 1 {
        c.refuse(
            path,
            format!("`{path}` is {value}, which is odd"),
            "an even number keeps the canopy's symmetry",
        );
    }
}

fn canopy(scene: &Scene, c: &mut Check) {
    const LENGTH: &str = "a length in metres";
    match &scene.canopy {
        Canopy::Atps(a) => {
            for (path, value) in [
                ("canopy.top_width_m", a.top_width_m),
                ("canopy.bottom_edge_width_m", a.bottom_edge_width_m),
                ("canopy.arm_length_m", a.arm_length_m),
                ("canopy.stitching_height_m", a.stitching_height_m),
                ("canopy.suspension_line_length_m", a.suspension_line_length_m),
                ("canopy.riser_length_m", a.riser_length_m),
            ] {
                c.positive(path, value, 200.0, LENGTH);
            }
            if a.stitching_height_m >= a.arm_length_m {
                c.refuse(
                    "canopy.stitching_height_m",
                    format!(
                        "the stitching ({} m) is as long as the arm ({} m)",
                        a.stitching_height_m, a.arm_length_m
                    ),
                    "leave a vent: stitch less than the length of the arm",
                );
            }
            if (a.top_width_m - a.bottom_edge_width_m).abs() / 2.0 >= a.arm_length_m {
                c.refuse(
                    "canopy.arm_length_m",
                    format!("the arm ({} m) cannot reach from the top edge to the hem", a.arm_length_m),
                    "make it longer than half the difference of the two widths",
                );
            }
            if a.suspension_line_length_m <= a.bottom_edge_width_m / 2.0 {
                c.refuse(
                    "canopy.suspension_line_length_m",
                    format!("lines of {} m cannot reach from the hem to a point", a.suspension_line_length_m),
                    "make them longer than half the bottom edge",
                );
            }
            even(c, "canopy.cells_across", a.cells_across);
            c.count("canopy.cells_along_vent", a.cells_along_vent, 2, 2000, "cells along the vent");
            c.count(
                "canopy.cells_along_stitching",
                a.cells_along_stitching,
                1,
                2000,
                "cells along the stitching",
            );
            c.count("canopy.lines_per_arm", a.lines_per_arm, 2, 1000, "suspension lines for each arm");
            c.count("canopy.segments_per_line", a.segments_per_line, 1, 1000, "cable elements for each line");
            if a.lines_per_arm > a.cells_across + 1 {
                c.refuse(
                    "canopy.lines_per_arm",
                    format!("{} lines do not fit on {} hem nodes", a.lines_per_arm, a.cells_across + 1),
                    "use fewer lines or more cells across",
                );
            }
        }
        Canopy::Square(f) | Canopy::Circular(f) => {
            c.positive("canopy.width_m", f.width_m, 200.0, LENGTH);
            even(c, "canopy.cells_across", f.cells_across);
            c.count("canopy.segments_per_line", f.segments_per_line, 1, 1000, "cable elements for each line");
            if f.line_count > 0 && f.line_length_m <= f.width_m / 2.0 {
                c.refuse(
                    "canopy.line_length_m",
                    format!(
                        "lines of {} m cannot reach from the rim to a point below the middle",
                        f.line_length_m
                    ),
                    format!("make them longer than half the width ({} m)", f.width_m / 2.0),
                );
            }
        }
        Canopy::AirBag(a) => {
            c.positive("canopy.edge_m", a.edge_m, 200.0, LENGTH);
            c.count("canopy.cells_across", a.cells_across, 2, 2000, "cells along the quarter sheet");
        }
        Canopy::Panel(p) => crate::panel_box::panel(p, c),
        Canopy::Gmsh(g) => {
            if !g.file.is_file() {
                c.refuse(
                    "canopy.file",
                    format!("the mesh file {} does not exist", g.file.display()),
                    "name a Gmsh file (4.1, ASCII) by its path from the scene's folder",
                );
            }
        }
    }
}

fn materials(scene: &Scene, c: &mut Check) {
    let f = &scene.fabric;
    c.positive("fabric.youngs_modulus_pa", f.youngs_modulus_pa, 1e13, "a modulus in Pa");
    c.range(
        "fabric.poisson_ratio",
        f.poisson_ratio,
        -1.0,
        0.5,
        false,
        "an isotropic solid has at most 0.5, where plane stress is still regular (it needs |nu| < 1)",
    );
    c.positive(
        "fabric.thickness_m",
        f.thickness_m,
        0.1,
        "a fabric is thinner than 0.1 m: is the value in metres?",
    );
    c.positive("fabric.density_kg_m3", f.density_kg_m3, 30_000.0, "a density in kg/m3");
    let softest =
        f.orthotropic.as_ref().map_or(f64::INFINITY, |o| o.youngs_modulus_2_pa).min(f.youngs_modulus_pa);
    c.range("fabric.prestress_pa", f.prestress_pa, 0.0, 0.5 * softest, true, "at most half the modulus");
    if let Some(o) = &f.orthotropic {
        c.positive("fabric.orthotropic.youngs_modulus_2_pa", o.youngs_modulus_2_pa, 1e13, "a modulus in Pa");
        c.positive("fabric.orthotropic.shear_modulus_pa", o.shear_modulus_pa, 1e13, "a modulus in Pa");
        let bound = 0.99 * (f.youngs_modulus_pa / o.youngs_modulus_2_pa).sqrt();
        if f.poisson_ratio.abs() > bound {
            c.refuse(
                "fabric.poisson_ratio",
                format!("`fabric.poisson_ratio` is {}", f.poisson_ratio),
                format!("between these moduli a pull would give energy: at most {bound:.3} either way"),
            );
        }
        if o.direction.is_some_and(|d| d.iter().any(|x| !x.is_finite()) || d == [0.0; 3]) {
            c.refuse(
                "fabric.orthotropic.direction",
                "the direction has no length",
                "name a vector, as [1, 0, 0]",
            );
        }
    }
    if let Some(l) = &scene.lines {
        c.positive("lines.youngs_modulus_pa", l.youngs_modulus_pa, 1e13, "a modulus in Pa");
        c.positive("lines.area_m2", l.area_m2, 0.1, "a cross-section in m2: is the value in square metres?");
        c.positive("lines.density_kg_m3", l.density_kg_m3, 30_000.0, "a density in kg/m3");
        let most = 0.5 * l.youngs_modulus_pa;
        c.range("lines.prestress_pa", l.prestress_pa, -most, most, true, "at most half the modulus");
    } else if scene.has_cables() {
        c.refuse(
            "canopy",
            "the canopy has lines but the scene has no [lines]",
            "add [lines] with their material",
        );
    }
}

fn point_masses(scene: &Scene, c: &mut Check) {
    for (k, p) in scene.point_masses.iter().enumerate() {
        chosen(&format!("point_mass[{k}]"), &p.nodes, &p.at_m, c);
        c.positive(&format!("point_mass[{k}].mass_kg"), p.mass_kg, 1e6, "a mass in kg");
    }
}

impl Scene {
    /// Whether the canopy has suspension lines or reinforcements.
    pub fn has_cables(&self) -> bool {
        match &self.canopy {
            Canopy::Atps(_) => true,
            Canopy::Square(f) | Canopy::Circular(f) => f.line_count > 0,
            // A file may have none; what it has needs [lines], which the structure checks.
            Canopy::AirBag(_) | Canopy::Gmsh(_) | Canopy::Panel(_) => false,
        }
    }
}

/// What explicit time integration does not go with.
fn explicit(scene: &Scene, c: &mut Check) {
    for (k, _) in scene.stages.iter().enumerate().filter(|(_, s)| s.stiffness_damping_s > 0.0) {
        c.refuse(
            &format!("stage[{k}].stiffness_damping_s"),
            "stiffness-proportional damping would shrink the stable step of explicit integration",
            "leave it out, or set structure.integration = \"generalized-alpha\"",
        );
    }
}

fn solvers(scene: &Scene, c: &mut Check) {
    let s = &scene.structure;
    if let Some(r) = s.spectral_radius {
        c.range(
            "structure.spectral_radius",
            r,
            0.0,
            1.0,
            true,
            "1 keeps all frequencies, 0 damps the highest at once",
        );
    }
    let undamped = match s.integration {
        Integration::Explicit => Some("explicit time integration"),
        Integration::Newmark => Some("Newmark's method with gamma 1/2 and beta 1/4"),
        Integration::GeneralizedAlpha | Integration::Implicit => None,
    };
    if let Some(name) = undamped.filter(|_| s.spectral_radius.is_some()) {
        c.refuse(
            "structure.spectral_radius",
            format!("{name} has no numerical damping to set"),
            "leave this key out, or set structure.integration = \"generalized-alpha\"",
        );
    }
    c.positive("structure.static_tolerance", s.static_tolerance, 0.1, "a share of the load");
    c.positive("structure.newton_tolerance", s.newton_tolerance, 0.1, "a share of the load");
    c.positive("structure.gmres_tolerance", s.gmres_tolerance, 0.5, "a relative residual");
    c.count("structure.newton_max_steps", s.newton_max_steps, 1, 1000, "Newton steps");
    c.count("structure.max_step_cuts", s.max_step_cuts, 0, 30, "halvings of a time step");
    c.positive("structure.explicit_safety", s.explicit_safety, 1.0, "a share of the largest stable step");
    if s.integration == Integration::Explicit {
        explicit(scene, c);
    }
    let m = &scene.mesh;
    c.range("mesh.stiffening_exponent", m.stiffening_exponent, 0.0, 4.0, true, "0 is none, 1 to 2 is usual");
    c.range("mesh.poisson_ratio", m.poisson_ratio, -0.9, 0.45, true, "of the pseudo-solid");
    c.positive("mesh.tolerance", m.tolerance, 0.5, "shares of the shortest edge around a node");
    c.range("mesh.min_quality", m.min_quality, 0.0, 0.9, true, "a scaled Jacobian");
    c.count("mesh.max_increments", m.max_increments, 1, 10_000, "sub-increments");
    if let Some(r) = &m.regrid {
        c.range(
            "mesh.regrid.below",
            r.below,
            m.min_quality,
            0.9,
            false,
            "a scaled Jacobian above mesh.min_quality",
        );
        c.positive("mesh.regrid.step", r.step, 1.0, "a share of the shortest edge around a node");
    }
    if m.outer == OuterBoundary::Sliding && !matches!(m.mover, MoverKind::Elastic | MoverKind::PlainElastic) {
        c.refuse(
            "mesh.outer",
            "`mesh.outer` is sliding with a mover that knows no planes",
            "allowed: with the movers elastic and plain-elastic; others need outer = \"fixed\"",
        );
    }
    let k = &scene.coupling;
    c.positive("coupling.tolerance", k.tolerance, 0.5, "a relative change");
    c.count("coupling.max_iterations", k.max_iterations, 1, 10_000, "coupling iterations");
    c.positive("coupling.relaxation", k.relaxation, 1.0, "a relaxation factor");
    c.count("coupling.model_faces", k.model_faces, 1, 20_000, "faces of a dense matrix");
    c.count("coupling.staggered.predictor", k.staggered.predictor, 0, crate::MOST_PREDICTOR, "an order");
    c.count("coupling.adaptive.halvings", k.adaptive.halvings, 0, 20, "halvings of window_s");
    c.count("coupling.adaptive.grow_after", k.adaptive.grow_after, 1, 10_000, "windows that go well");
    if let Some(share) = k.velocity_average {
        c.range("coupling.velocity_average", share, 0.0, 1.0, true, "0 is none");
    }
    if let Some(f) = &scene.flow {
        c.positive("flow.density_kg_m3", f.density_kg_m3, 1000.0, "a density in kg/m3");
        c.range("flow.temperature_k", f.temperature_k, 10.0, 5000.0, true, "a temperature in kelvin");
        let g = &f.grid;
        c.count("flow.grid.layers_inside", g.layers_inside, 2, 500, "cells");
        c.count("flow.grid.layers_outside", g.layers_outside, 4, 1000, "cells");
        c.count("flow.grid.cells_across_vent", g.cells_across_vent, 1, 100, "cells");
        c.positive("flow.grid.first_layer_m", g.first_layer_m, 10.0, "a length in metres");
        c.range("flow.grid.far_field_widths", g.far_field_widths, 1.5, 1000.0, true, "in canopy widths");
        c.range("flow.grid.wake_widths", g.wake_widths, 1.5, 1000.0, true, "in canopy widths");
        c.positive("flow.solver.residual_drop", f.solver.residual_drop, 0.9, "a factor");
        c.count("flow.solver.max_iterations", f.solver.iterations(), 1, 100_000, "iterations");
        if let Some(v) = &f.viscosity {
            c.positive("flow.viscosity.dynamic_viscosity_pa_s", v.dynamic_viscosity_pa_s, 1e4, "in Pa s");
        }
        monitors(f, c);
    }
    if let Some(d) = &scene.descent {
        c.positive("descent.payload_mass_kg", d.payload_mass_kg, 1e6, "a mass in kg");
        c.range(
            "descent.initial_speed_m_s",
            d.initial_speed_m_s,
            0.0,
            1000.0,
            true,
            "positive downwards, m/s",
        );
        c.range("descent.gravity_m_s2", d.gravity_m_s2, 0.0, 1000.0, true, "in m/s2");
        c.positive("descent.reference_area_m2", d.reference_area_m2, 1e6, "an area in m2");
    }
    for (path, n) in [
        ("ranks.structure", scene.ranks.structure),
        ("ranks.flow", scene.ranks.flow),
        ("ranks.mesh", scene.ranks.mesh),
    ] {
        c.count(path, n, 1, 100_000, "ranks of one program");
    }
}

/// What the flow writes, and a grid from a file.
fn monitors(f: &Flow, c: &mut Check) {
    if let Some(g) = f.grid_file.as_ref().filter(|g| !g.path.is_file()) {
        c.refuse(
            "flow.grid_file.path",
            format!("the grid file {} does not exist", g.path.display()),
            "name a Gmsh file (4.1) by its path from the scene's folder",
        );
    }
    let help = "use letters, digits, `-`, `_` and `.`, and each name once";
    let finite = |v: &[f64; 3]| v.iter().all(|x| x.is_finite());
    let name = |path: String, name: &str, taken: bool, c: &mut Check| {
        if taken || !plain_name(name) {
            c.refuse(&path, format!("`{path}` is \"{name}\""), help);
        }
    };
    for (k, p) in f.probes.iter().enumerate() {
        let taken = f.probes[..k].iter().any(|q| q.name == p.name);
        name(format!("flow.probe[{k}].name"), &p.name, taken, c);
        if !finite(&p.position_m) {
            c.refuse(&format!("flow.probe[{k}].position_m"), "the position is not a number", "three in m");
        }
    }
    const WRITTEN: [&str; 6] = ["flow", "canopy", "lines", "canopy_air", "history", "state"];
    let direction = |path: String, v: &[f64; 3], c: &mut Check| {
        if !finite(v) || *v == [0.0; 3] {
            c.refuse(&path, format!("`{path}` has no direction"), "name a vector, as [0, 0, 1]");
        }
    };
    for (k, s) in f.slices.iter().enumerate() {
        let taken = f.slices[..k].iter().map(|s| s.name.as_str()).chain(WRITTEN).any(|n| n == s.name);
        name(format!("flow.slice[{k}].name"), &s.name, taken, c);
        direction(format!("flow.slice[{k}].normal"), &s.normal, c);
        if !finite(&s.point_m) {
            c.refuse(&format!("flow.slice[{k}].point_m"), "the point is not a number", "three in m");
        }
        c.count(&format!("flow.slice[{k}].every_windows"), s.every_windows, 1, u32::MAX, "windows");
    }
    if let Some(s) = &f.surface_pressure {
        c.count("flow.surface_pressure.every_windows", s.every_windows, 1, u32::MAX, "windows");
    }
    if let Some(s) = &f.statistics {
        c.range("flow.statistics.start_s", s.start_s, 0.0, 1e6, true, "in s");
    }
    if let Some(s) = &f.forces {
        direction("flow.forces.drag_direction".into(), &s.drag_direction, c);
        if !finite(&s.moment_point_m) {
            c.refuse("flow.forces.moment_point_m", "the point is not a number", "three in m");
        }
    }
}

fn stages(scene: &Scene, c: &mut Check) {
    if scene.stages.is_empty() {
        c.refuse("stage", "the scene has no stage", "add at least one [[stage]]");
    }
    for (i, s) in scene.stages.iter().enumerate() {
        let at = |key: &str| format!("stage[{i}].{key}");
        times(s, &at, c);
        c.count(&at("substeps"), s.substeps, 1, 100_000, "structural steps in a window");
        c.range(&at("mass_damping_per_s"), s.mass_damping_per_s, 0.0, 1e6, true, "in 1/s");
        c.range(&at("stiffness_damping_s"), s.stiffness_damping_s, 0.0, 1e3, true, "in seconds");
        if let Some(r) = s.settled_energy_ratio {
            c.positive(&at("settled_energy_ratio"), r, 1.0, "kinetic over strain energy");
        }
        nodal(s, &at, c);
        match (s.kind, s.pressure_pa) {
            (StageKind::PreInflation, None) => c.refuse(
                &at("name"),
                format!("stage \"{}\" inflates, but with no pressure", s.name),
                "add `pressure_pa = ...` (the paper: 14.5672)",
            ),
            (StageKind::PreInflation, Some(p)) => {
                c.range(&at("pressure_pa"), p, -1e7, 1e7, true, "a pressure in Pa")
            }
            (_, Some(_)) => c.refuse(
                &at("pressure_pa"),
                "`pressure_pa` belongs to a pre-inflation stage",
                "remove it: here the flow makes the pressure",
            ),
            _ => {}
        }
        if s.kind != StageKind::PreInflation {
            if scene.flow.is_none() {
                c.refuse(&at("kind"), format!("stage \"{}\" needs the flow", s.name), "add a [flow] section");
            }
            let given = scene.flow.as_ref().is_some_and(|f| f.grid_file.is_some());
            if matches!(scene.canopy, Canopy::AirBag(_) | Canopy::Gmsh(_)) && !given {
                c.refuse(
                    &at("kind"),
                    "an air-bag octant or a canopy from a file has no flow grid around it",
                    "use kind = \"pre-inflation\", or give a grid by [flow.grid_file]",
                );
            }
        }
        if matches!(s.kind, StageKind::Coupled | StageKind::Prescribed) && scene.has_vents() {
            let inflated = scene.stages[..i].iter().any(|s| s.kind == StageKind::PreInflation);
            if !inflated {
                c.refuse(
                    &at("kind"),
                    "the vents of the unstressed canopy are closed slits: no flow grid fits them",
                    "put a stage of kind \"pre-inflation\" before this one",
                );
            }
        }
    }
}

/// Either a name or a point.
fn chosen(path: &str, nodes: &Option<String>, at_m: &Option<[f64; 3]>, c: &mut Check) {
    if nodes.is_some() == at_m.is_some() {
        c.refuse(
            path,
            format!("`{path}` names {} nodes", if nodes.is_some() { "two kinds of" } else { "no" }),
            "give either `nodes = \"NAME\"` or `at_m = [X, Y, Z]`",
        );
    }
}

/// Motions and forces of nodes.
fn nodal(s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if s.kind == StageKind::FlowOnly && !(s.motions.is_empty() && s.forces.is_empty()) {
        c.refuse(
            &at("kind"),
            format!("stage \"{}\" has no structure that could be moved or loaded", s.name),
            "remove its [[stage.motion]] and [[stage.force]]",
        );
    }
    for (k, f) in s.forces.iter().enumerate() {
        chosen(&at(&format!("force[{k}]")), &f.nodes, &f.at_m, c);
        if !f.force_n.iter().all(|f| f.is_finite()) {
            c.refuse(&at(&format!("force[{k}].force_n")), "a force is not a number", "three numbers in N");
        }
    }
    for (k, m) in s.motions.iter().enumerate() {
        let path = at(&format!("motion[{k}]"));
        chosen(&path, &m.nodes, &m.at_m, c);
        if m.components.is_empty() || !m.components.chars().all(|c| "xyz".contains(c)) {
            c.refuse(
                &format!("{path}.components"),
                format!("`components` is \"{}\"", m.components),
                "name some of x, y and z, as \"xyz\" or \"z\"",
            );
        }
        if m.time_s.is_empty() || m.time_s.len() != m.displacement_m.len() {
            c.refuse(
                &format!("{path}.displacement_m"),
                format!("{} times, but {} displacements", m.time_s.len(), m.displacement_m.len()),
                "give one displacement for each time, at least one",
            );
        }
        let ascending = m.time_s.windows(2).all(|w| w[0] < w[1]);
        if !ascending || !m.time_s.iter().chain(m.displacement_m.iter().flatten()).all(|v| v.is_finite()) {
            c.refuse(
                &format!("{path}.time_s"),
                "the times do not ascend, or a value is not a number",
                "list times in ascending order",
            );
        }
    }
}

/// Durations: every stage has them but a static one.
fn times(s: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if s.solve == Solve::Static || s.steady.is_some() {
        if s.solve == Solve::Static && s.kind != StageKind::PreInflation {
            c.refuse(
                &at("solve"),
                format!("stage \"{}\" runs the flow, which has no static solution here", s.name),
                "use solve = \"static\" in a stage of kind \"pre-inflation\", [stage.steady] in one of kind \"flow-only\"",
            );
        }
        for (key, value) in [("duration_s", s.duration_s), ("window_s", s.window_s)] {
            if value != 0.0 {
                c.refuse(
                    &at(key),
                    format!("`{key}` of a static or steady stage is {value}, but such a stage takes no time"),
                    "remove it",
                );
            }
        }
        return;
    }
    for (key, value, what) in
        [("duration_s", s.duration_s, "simulated time, s"), ("window_s", s.window_s, "length of a window, s")]
    {
        if value == 0.0 {
            c.refuse(
                &at(key),
                format!("stage \"{}\" has no `{key}`", s.name),
                format!("add `{key} = ...`: {what}"),
            );
        }
    }
    if s.duration_s != 0.0 && s.window_s != 0.0 {
        c.positive(&at("duration_s"), s.duration_s, 1e6, "in seconds");
        c.positive(
            &at("window_s"),
            s.window_s,
            s.duration_s.max(1e-9),
            "a window is not longer than its stage",
        );
    }
}

impl Scene {
    fn has_vents(&self) -> bool {
        matches!(self.canopy, Canopy::Atps(_))
    }
}
