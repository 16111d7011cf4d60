//! Checks of the flow: grid, resolution along and across the canopy, outer boundary, Mach number.

use case::{Canopy, Role, Stage, StageKind, Turbulence, WallTreatment};

use super::facts::{Facts, digits, percent};
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::table::{Check, When};

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "flow.grid",
        what: "a flow grid can be built",
        estimate: "number of cells and nodes, from the topology",
        range: "error if no grid can be built, for example with a first layer thicker than a quarter of the canopy width",
        source: "the grid generator, or the grid file",
        severity: Error,
        remedy: "correct the key in the message; lengths are in metres",
        when: When::Before(grid),
    },
    Check {
        id: "flow.cells-across",
        what: "the flow grid has enough cells across the canopy",
        estimate: "cells along the width of the canopy",
        range: "warning below 10, in an immersed grid below 16",
        source: "docs/records/accuracy.md: 6 cells across a square canopy give an error of 20 % in drag and 3.4 % in speed, 12 cells \
                 about 7 % in drag; 18 cells across the ATPS give 1 to 3 %",
        severity: Warning,
        remedy: "raise canopy.cells_across: 12 for exploration, 18 and more for results; `ripstop accuracy` measures \
                 the error",
        when: When::Before(cells_across),
    },
    Check {
        id: "flow.method",
        what: "the grid can follow the shapes that the scene asks for",
        estimate: "fitted grid or immersed canopy; [fabric.contact] and [[reefing]] announce folds and layers that touch. Not assessed: whether \
                   fabric folds during the run, and the accuracy of either method in this scene",
        range: "warning for a fitted grid around a canopy with contact or reefing that does not open in an immersed stage before",
        source: "docs/how-to/choose-the-flow-method.md: a fitted grid ends where fabric folds, vents close or layers touch; the immersed flow has \
                 an eddy viscosity away from the fabric, and no law of the wall",
        severity: Warning,
        remedy: "replace [flow.grid] by [flow.immersed] with spacing_m, or open the canopy in a stage with flow_method = \"immersed\" before the fitted one",
        when: When::Before(method),
    },
    Check {
        id: "flow.first-layer",
        what: "the aspect ratio of cells at the canopy is at most 1",
        estimate: "thickness of the first layer over the cell edge along the canopy, and over the width of the canopy",
        range: "warning above 1 cell edge, and above 0.1 widths",
        source: "cells thicker than wide resolve the pressure jump at rim and vents worse than the canopy mesh",
        severity: Warning,
        remedy: "set flow.grid.first_layer_m (or flow.box.first_layer_m) to a third of a cell edge",
        when: When::Before(first_layer),
    },
    Check {
        id: "flow.boundary-layer",
        what: "a viscous flow resolves the boundary layer on the fabric",
        estimate: "boundary-layer thickness delta half a width downstream along the canopy: 5 x / Re_x^1/2 laminar, 0.37 x / Re_x^1/5 turbulent (Re_x above \
                   5e5); with a turbulence model y+ = u_tau y / nu of the first cell centre, \
                   u_tau = U (0.029 Re_x^-1/5)^1/2",
        range: "warning for a first layer, or cubes of an immersed grid, thicker than delta / 5, or, with a turbulence model, y+ above 300; with \
                flow.viscosity.wall_treatment = \"resolved\" above 5",
        source: "Schlichting, Boundary Layer Theory; docs/records/verification.md: skin friction of the flat plate at y+ 1 to 300 \
                 with the law of the wall",
        severity: Warning,
        remedy: "reduce flow.grid.first_layer_m and add layers, or reduce flow.immersed.spacing_m; where only y+ is too large on a fitted grid, set \
                 flow.viscosity.wall_treatment = \"automatic\"; or omit [flow.viscosity]: with separation at the rim the \
                 drag of a canopy is mainly pressure drag",
        when: When::Before(boundary_layer),
    },
    Check {
        id: "flow.eddies",
        what: "the cells of the wake hold its eddies, and what is smaller has a model",
        estimate: "largest extent h of the cells one width downstream, from the growth of the layers; eddies of 4 h keep their energy with the hybrid \
                   flux, of 8 h with the upwind flux (flow.convection.upwind_share of 0.5 and above); smallest eddies \
                   width / Re^3/4. Not assessed: grid files, inviscid flow, spalart-allmaras, and what the eddies do to the drag",
        range: "warning for smallest resolved eddies above half the width, and for laminar flow above a Reynolds number of 1000 with cells of \
                more than 10 of the smallest eddies",
        source: "docs/records/verification.md: measured in decaying isotropic turbulence; without a model a third of its energy has nowhere to go",
        severity: Warning,
        remedy: "raise flow.grid.layers_outside and canopy.cells_across; without a model set flow.viscosity.turbulence = \"wale\", or \"ddes\" where \
                 boundary layers matter",
        when: When::Before(eddies),
    },
    Check {
        id: "flow.outer-boundary",
        what: "the far field is far enough from the canopy",
        estimate: "flow.grid.far_field_widths and wake_widths; blockage: area of a disk of the canopy width over that \
                   of the far-field circle",
        range: "warning for a far field below 4 widths (a blockage of 1.6 %) or a wake below 6 widths",
        source: "wind-tunnel practice keeps the blockage of bluff bodies below 5 %; the wake of a disk closes after 3 to \
                 4 widths",
        severity: Warning,
        remedy: "raise flow.grid.far_field_widths (default 6) and wake_widths (default 10)",
        when: When::Before(outer_boundary),
    },
    Check {
        id: "flow.courant",
        what: "windows resolve convection along the canopy",
        estimate: "U window_s / (cell edge along the canopy), with U the largest speed of the stage, gusts included",
        range: "warning above 3",
        source: "the implicit scheme is unconditionally stable, but above 3 a wave of ten cells has fewer than 3.3 windows \
                 in a period",
        severity: Warning,
        remedy: "shorten window_s of the stage",
        when: When::Before(courant),
    },
    Check {
        id: "flow.mach",
        what: "the isothermal equations are valid at the Mach number",
        estimate: "U over the speed of sound, with U the largest speed of all stages, gusts included",
        range: "warning above 0.3 without [flow.energy]",
        source: "the density changes by M^2 / 2, 4.5 % at 0.3; isothermal flow neglects the change of temperature",
        severity: Warning,
        remedy: "add [flow.energy], or check flow.wind_m_s and descent.initial_speed_m_s",
        when: When::Before(mach),
    },
    Check {
        id: "flow.reynolds",
        what: "Reynolds number of the canopy",
        estimate: "rho U width / mu, with the viscosity of air if the flow is inviscid",
        range: "for information",
        source: "definition",
        severity: Note,
        remedy: "",
        when: When::Before(reynolds),
    },
];

fn grid(f: &Facts<'_>) -> Vec<Judged> {
    match &f.grid {
        None => Vec::new(),
        Some(Ok(g)) => vec![Judged::new(
            Note,
            "flow",
            format!("the flow grid has {} cells and {} nodes", g.cells, g.nodes),
        )],
        Some(Err(error)) => {
            let key = match error {
                mesh::MeshError::Parameter { key, .. } => (*key).to_owned(),
                _ => "flow".into(),
            };
            vec![Judged::new(Error, key, format!("no flow grid: {error}"))]
        }
    }
}

fn cells_across(f: &Facts<'_>) -> Vec<Judged> {
    if !f.is_parachute() || f.grid.is_none() {
        return Vec::new();
    }
    let n = &f.numbers;
    let across = n.width / n.cell;
    let severity = if across < 9.5 { Warning } else { Note };
    let key = match f.scene.canopy {
        Canopy::Gmsh(_) => "canopy.file",
        Canopy::Gored(_) => "canopy.cells_along",
        Canopy::Pattern(_) => "canopy.element_size_m",
        _ => "canopy.cells_across",
    };
    let figure = format!("about {across:.0} cells across the canopy, with edges of {} m", digits(n.cell));
    let mut found = vec![Judged::new(severity, key, figure)];
    if let Some(g) = f.scene.flow.as_ref().and_then(|flow| flow.immersed.as_ref()) {
        let across = n.width / g.spacing_m;
        let severity = if across < LEAST_IMMERSED { Warning } else { Note };
        let figure = format!("{across:.0} cells of the immersed grid across the canopy");
        let remedy = "reduce flow.immersed.spacing_m: 16 cells across for exploration, 24 and more for results; `ripstop accuracy` \
                      measures the error";
        found.push(Judged::new(severity, "flow.immersed.spacing_m", figure).remedy(remedy));
    }
    found
}

fn method(f: &Facts<'_>) -> Vec<Judged> {
    let Some(flow) = f.scene.flow.as_ref().filter(|_| f.is_parachute()) else { return Vec::new() };
    let contact = f.scene.fabric.contact.is_some().then_some("fabric.contact");
    let folds: Vec<&str> =
        contact.into_iter().chain((!f.scene.reefing.is_empty()).then_some("reefing")).collect();
    if flow.is_immersed() {
        let layers = if contact.is_some() {
            "layers that touch"
        } else {
            "layers that pass through each other without [fabric.contact]"
        };
        let friction = if flow.viscosity.is_some() {
            "friction without a law of the wall where cells resolve the boundary layer (drag of a sphere at Re 100: 3 to 1 % off on 8 to 16 cells across)"
        } else {
            "no friction on the fabric without [flow.viscosity]"
        };
        let model = match flow.viscosity.as_ref().and_then(|v| v.turbulence) {
            None => "no turbulence model",
            Some(_) => "an eddy viscosity away from the fabric",
        };
        let follows =
            format!("an immersed canopy: folds, closed vents and {layers} are followed; {friction}, {model}");
        return vec![Judged::new(Note, "flow.immersed", follows)];
    }
    if folds.is_empty() || !f.scene.stages.iter().any(|s| s.kind == StageKind::Coupled) {
        return Vec::new();
    }
    let figure = format!(
        "a fitted grid around a canopy with {}: it ends where fabric folds or layers touch",
        folds.join(" and ")
    );
    // After the folds have opened in an immersed flow a fitted grid is what such a scene is for.
    let coupled = |s: &&Stage| s.kind == StageKind::Coupled;
    let first = f.scene.stages.iter().find(coupled);
    let opened = first.is_some_and(|s| f.scene.is_immersed(s));
    vec![Judged::new(if opened { Note } else { Warning }, folds[0], figure)]
}

/// Cells of an immersed grid across a canopy below which its rim, known to half a cell, changes the area by a tenth.
const LEAST_IMMERSED: f64 = 16.0;

/// Thickness of the cells at the canopy, m, and its key; `None` where a file gives the grid.
fn layer(f: &Facts<'_>) -> Option<(f64, &'static str)> {
    let flow = f.scene.flow.as_ref().filter(|f| !f.is_immersed())?;
    match (&flow.grid_file, &flow.box_grid) {
        (Some(_), _) => None,
        (None, Some(b)) => match b.first_layer_m {
            Some(first) => Some((first, "flow.box.first_layer_m")),
            None => {
                let even = |length: f64, cells: u32| length / f64::from(cells.max(1));
                Some((even(b.below_m, b.layers_below).min(even(b.above_m, b.layers_above)), "flow.box"))
            }
        },
        (None, None) => Some((flow.grid.first_layer_m, "flow.grid.first_layer_m")),
    }
}

/// Thickness of the cells at the canopy and its key: of the first layer, or of the cubes of an immersed grid.
fn cells_at_wall(f: &Facts<'_>) -> Option<(f64, &'static str)> {
    let immersed = f.scene.flow.as_ref().and_then(|f| f.immersed.as_ref());
    immersed.map(|g| (g.spacing_m, "flow.immersed.spacing_m")).or_else(|| layer(f))
}

fn first_layer(f: &Facts<'_>) -> Vec<Judged> {
    // Without a grid the check `flow.grid` reports the reason.
    let (Some((first, key)), Some(Ok(_))) = (layer(f), &f.grid) else { return Vec::new() };
    let n = &f.numbers;
    let thick = f.is_parachute() && (first > n.cell || first > 0.1 * n.width);
    let figure = format!(
        "the cells at the canopy are {} m thick, {} of their edge and {} of the width of the canopy",
        digits(first),
        percent(first / n.cell),
        percent(first / n.width)
    );
    vec![Judged::new(if thick { Warning } else { Note }, key, figure)]
}

/// Boundary-layer thickness at the distance `run` (m) from the leading edge with the local Reynolds number `re`, m.
fn thickness(run: f64, re: f64) -> f64 {
    if re < 5e5 { 5.0 * run / re.sqrt() } else { 0.37 * run / re.powf(0.2) }
}

/// $`y^+`$ at height `y` above a turbulent plate: $`c_f / 2 = 0.029\, Re_x^{-1/5}`$.
fn wall_units(y: f64, speed: f64, viscosity: f64, re: f64) -> f64 {
    speed * (0.029 * re.powf(-0.2)).sqrt() * y / viscosity
}

fn boundary_layer(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let viscous = f.scene.viscosity();
    let (Some(v), Some((first, key)), true) =
        (viscous, cells_at_wall(f), n.reynolds > 0.0 && f.grid.is_some())
    else {
        return Vec::new();
    };
    let (run, re) = (0.5 * n.width, 0.5 * n.reynolds);
    let delta = thickness(run, re);
    let plus = wall_units(0.5 * first, n.speed, v.dynamic_viscosity_pa_s / n.density, re);
    let largest = match v.wall_treatment() {
        None => f64::INFINITY,
        Some(WallTreatment::Automatic) => 300.0,
        Some(WallTreatment::Resolved) => 5.0,
    };
    let severity = if first > 0.2 * delta || plus > largest { Warning } else { Note };
    let wall = if v.turbulence.is_some() { format!(", y+ about {}", digits(plus)) } else { String::new() };
    let figure = format!(
        "at a Reynolds number of {} the boundary layer is about {} m thick; the first cells are {} m{wall}",
        digits(n.reynolds),
        digits(delta),
        digits(first)
    );
    vec![Judged::new(severity, key, figure)]
}

/// Wave lengths, in cells, of the smallest eddies that keep their energy with the hybrid and with the upwind flux.
const CELLS_OF_EDDY: [f64; 2] = [4.0, 8.0];

fn eddies(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let (Some(flow), Some(v), true) = (&f.scene.flow, f.scene.viscosity(), f.is_parachute()) else {
        return Vec::new();
    };
    let averaged = v.turbulence == Some(Turbulence::SpalartAllmaras);
    let (Some(cell), Some(Ok(_)), false) = (mesh::wake_cell(f.scene, n.width, n.cell), &f.grid, averaged)
    else {
        return Vec::new();
    };
    let cells = CELLS_OF_EDDY[usize::from(flow.upwind_share() >= 0.5)];
    let share = cells * cell / n.width;
    let smallest = n.width * n.reynolds.max(1.0).powf(-0.75);
    let turbulent = n.reynolds > 1000.0;
    let mut found = Vec::new();
    if turbulent {
        let figure = format!(
            "the cells one width downstream are about {} m: eddies above {} of the width keep their energy",
            digits(cell),
            percent(share)
        );
        found.push(Judged::new(if share > 0.5 { Warning } else { Note }, "flow.grid.layers_outside", figure));
    }
    if turbulent && v.turbulence.is_none() && cell > 10.0 * smallest {
        let figure = format!(
            "the flow is laminar at a Reynolds number of {}, but its cells are {} times its smallest eddies of {} m",
            digits(n.reynolds),
            digits(cell / smallest),
            digits(smallest)
        );
        found.push(Judged::new(Warning, "flow.viscosity.turbulence", figure));
    }
    found
}

fn outer_boundary(f: &Facts<'_>) -> Vec<Judged> {
    let Some(flow) = f.scene.flow.as_ref().filter(|w| w.grid_file.is_none() && w.box_grid.is_none()) else {
        return Vec::new();
    };
    if f.grid.is_none() {
        return Vec::new();
    }
    let [far, wake] = match &flow.immersed {
        Some(g) => [("flow.immersed.far_field", g.far_field), ("flow.immersed.far_wake", g.far_wake)],
        None => {
            let g = &flow.grid;
            [("flow.grid.far_field_widths", g.far_field_widths), ("flow.grid.wake_widths", g.wake_widths)]
        }
    };
    let mut found = Vec::new();
    for ((key, value), least) in [(far, 4.0), (wake, 6.0)] {
        if value < least {
            let figure = format!(
                "the outer boundary is {} widths from the centre of the canopy, a blockage of {}",
                digits(value),
                percent(0.25 / (value * value))
            );
            found.push(Judged::new(Warning, key, figure));
        }
    }
    if found.is_empty() {
        let figure =
            format!("the outer boundary is {} widths away, {} downstream", digits(far.1), digits(wake.1));
        found.push(Judged::new(Note, far.0, figure));
    }
    found
}

fn courant(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let mut found = Vec::new();
    for (i, s) in f.stages().filter(|(_, s)| s.kind.roles().contains(&Role::Flow) && s.window_s > 0.0) {
        let number = n.stage_speeds[i][1] * s.window_s / n.cell;
        if number > 0.0 {
            let figure =
                format!("stage `{}` has a Courant number of {} along the canopy", s.name, digits(number));
            let severity = if number > 3.0 { Warning } else { Note };
            found.push(Judged::new(severity, format!("stage[{i}].window_s"), figure));
        }
    }
    found
}

fn mach(f: &Facts<'_>) -> Vec<Judged> {
    let Some(flow) = f.scene.flow.as_ref().filter(|_| f.grid.is_some() && f.numbers.mach > 0.0) else {
        return Vec::new();
    };
    let severity = if f.numbers.mach > 0.3 && flow.energy.is_none() { Warning } else { Note };
    let speed = f.numbers.stage_speeds.iter().fold(f.numbers.speed, |most, [_, gusty]| most.max(*gusty));
    let figure = format!("the Mach number is {} at {} m/s", digits(f.numbers.mach), digits(speed));
    vec![Judged::new(severity, "descent.initial_speed_m_s", figure)]
}

fn reynolds(f: &Facts<'_>) -> Vec<Judged> {
    if f.grid.is_none() || f.numbers.reynolds == 0.0 {
        return Vec::new();
    }
    vec![Judged::new(Note, "flow", format!("the Reynolds number is {}", digits(f.numbers.reynolds)))]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate of 1 m in air at 10 m/s worked out by hand: Re 6.85e5, nu 1.46e-5 m2/s.
    #[test]
    fn boundary_layer_of_a_plate_matches_hand_calculation() {
        let nu = 1.789e-5 / 1.225;
        let re = 10.0 / nu;
        assert!((thickness(1.0, re) - 0.0252).abs() < 1e-4, "{}", thickness(1.0, re));
        assert!((thickness(0.1, 0.1 * re) - 0.00191).abs() < 1e-5);
        // u_tau = 10 (0.029 * 0.0680)^0.5 = 0.444 m/s; 1 mm is 30 wall units.
        assert!((wall_units(1e-3, 10.0, nu, re) - 30.4).abs() < 0.2);
    }
}
