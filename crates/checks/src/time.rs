//! Checks of times: windows against stages, windows and substeps against the first natural modes, durations
//! against the flow's own times, the order of stages.

use std::f64::consts::{PI, TAU};

use case::{Canopy, Role, Solve, Stage, StageKind};

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::table::{Check, When};

/// Steps in a period from which on a mode is resolved.
const RESOLVED: f64 = 20.0;
/// A canopy is at rest once its kinetic energy is below this share of its strain energy, or its swing has lost all but
/// this share of its energy.
pub const AT_REST: f64 = 0.01;
/// Strouhal number of shedding behind a hemisphere.
const STROUHAL: f64 = 0.15;

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "stage.windows",
        what: "windows divide their stage",
        estimate: "duration_s / window_s",
        range: "warning where it differs from a whole number by more than a thousandth of a window: the number of windows is rounded",
        source: "a stage runs whole windows",
        severity: Warning,
        remedy: "choose duration_s as a multiple of window_s",
        when: When::Before(windows),
    },
    Check {
        id: "stage.canopy-mode",
        what: "windows and substeps resolve the first mode of the canopy",
        estimate: "period 2 L ((m + m_a) / T)^1/2 of a membrane of width L under the tension T = p L / 2 (plus the \
                   prestress) with the fabric's mass m and, in coupled stages, the added mass m_a = 2 rho L / pi per area",
        range: "warning below 20 windows (coupled) or 20 substeps (structure alone) in a period",
        source: "standing wave of a stretched membrane with half a wave across, air on both sides; with 20 steps in a \
                 period the trapezoidal rule misses the period by (omega dt)^2 / 12 = 0.8 %, BDF2 by four times that",
        severity: Warning,
        remedy: "shorten window_s, or raise substeps in a stage of the structure alone",
        when: When::Before(canopy_mode),
    },
    Check {
        id: "stage.settling",
        what: "the canopy comes to rest in the pre-inflation that a flow grid is built around",
        estimate: "share exp(-(c + tau omega^2) t) of the first mode's energy (stage.canopy-mode) that damping leaves after \
                   the stage, from mass_damping_per_s c and tau, the sum of stiffness_damping_s and fabric.retardation_time_s",
        range: "warning above 1 % before a stage with the flow, for parachutes; overdamped motion is not judged",
        source: "linear oscillator; the default time integration keeps the energy of a swing, as fabric in a vacuum does",
        severity: Warning,
        remedy: "set mass_damping_per_s, lengthen duration_s, or set solve = \"static\"",
        when: When::Before(settling),
    },
    Check {
        id: "stage.line-mode",
        what: "substeps resolve the canopy's motion on its lines",
        estimate: "period 2 pi (M / k)^1/2 of the fabric's share M of a line with half the line's mass, on the \
                   stiffness k = E A / l of the line",
        range: "warning below 20 substeps in a period; explicit integration divides substeps by itself",
        source: "as stage.canopy-mode",
        severity: Warning,
        remedy: "raise substeps of the stage, or set structure.integration = \"explicit\"",
        when: When::Before(line_mode),
    },
    Check {
        id: "stage.development",
        what: "a flow-only stage develops the flow",
        estimate: "U duration_s / width, the widths that the stream travels",
        range: "a figure: below 1 the starting vortex still lies at the canopy, after about 10 the wake is developed",
        source: "impulsively started disks",
        severity: Note,
        remedy: "",
        when: When::Before(development),
    },
    Check {
        id: "stage.shedding",
        what: "how many shedding periods a coupled stage covers",
        estimate: "duration_s St U / width with St = 0.15",
        range: "a figure: means over fewer than some 5 periods depend on where they begin",
        source: "impervious rigid hemisphere, St about 0.15",
        severity: Note,
        remedy: "",
        when: When::Before(shedding),
    },
    Check {
        id: "stage.order",
        what: "each stage starts from a state that fits it",
        estimate: "order of the stages",
        range: "error for a flow around closed vents before any pre-inflation; warning for a pre-inflation after a \
                stage of the flow that later stages of the flow start from",
        source: "flow grids are built around the shape of the latest pre-inflation before a stage; a flow state of \
                 another shape is a disturbance",
        severity: Error,
        remedy: "order stages as pre-inflation, flow-only, coupled",
        when: When::Before(order),
    },
    Check {
        id: "stage.damping",
        what: "mass damping does not hold the canopy in a coupled stage",
        estimate: "mass_damping_per_s",
        range: "warning above 0 in a coupled stage of a parachute",
        source: "it acts on the velocity in the falling frame in addition to the forces of the air: 20 1/s moves the ATPS's speed \
                 by 3.6 % (docs/records/benchmarks.md)",
        severity: Warning,
        remedy: "remove mass_damping_per_s from the coupled stage",
        when: When::Before(damping),
    },
];

fn windows(f: &Facts<'_>) -> Vec<Judged> {
    let mut found = Vec::new();
    for (i, s) in f.stages().filter(|(_, s)| s.window_s > 0.0) {
        let count = s.duration_s / s.window_s;
        let whole = s.windows() as f64;
        if (count - whole).abs() > 1e-3 {
            let figure = format!(
                "stage `{}` asks for {} windows: it runs {whole} and ends at {} s, not at {} s",
                s.name,
                digits(count),
                digits(whole * s.window_s),
                digits(s.duration_s)
            );
            let best = s.duration_s / whole;
            found.push(
                Judged::new(Warning, format!("stage[{i}].duration_s"), figure)
                    .remedy(format!("set duration_s = {}, or window_s = {best}", whole * s.window_s)),
            );
        }
    }
    found
}

/// Period of a membrane with half a wave over its width `l` (m): tension `t` (N/m), mass `m` (kg/m2).
fn period(l: f64, t: f64, m: f64) -> f64 {
    2.0 * l * (m / t).sqrt()
}

/// Shorter side of a canopy, m: that of the first mode's half wave.
fn span(f: &Facts<'_>) -> f64 {
    match &f.scene.canopy {
        // Panels held at their ends are slices: only x counts.
        Canopy::Panel(p) if p.held != case::PanelEdges::All => p.size_m[0],
        Canopy::Panel(p) => p.size_m[0].min(p.size_m[1]),
        _ => f.numbers.width,
    }
}

/// Steps of a stage that take the structure's time.
fn dynamic(s: &Stage) -> bool {
    s.solve == Solve::Dynamic && s.steady.is_none() && s.kind.roles().contains(&Role::Structure)
}

/// Period of the canopy's first mode in a stage, s; `None` for a canopy without tension.
fn first_period(f: &Facts<'_>, s: &Stage) -> Option<f64> {
    let (n, l) = (&f.numbers, span(f));
    let pressure = s.pressure_pa.map_or(f.load_pressure().0, f64::abs);
    let tension = 0.5 * pressure * l + f.scene.fabric.prestress_pa * f.scene.fabric.thickness_m;
    let added = if s.kind == StageKind::Coupled { 2.0 * n.density * l / PI } else { 0.0 };
    (tension > 0.0).then(|| period(l, tension, n.fabric_kg_m2 + added))
}

fn settling(f: &Facts<'_>) -> Vec<Judged> {
    let flows = |s: &Stage| s.kind.roles().contains(&Role::Flow);
    let before_flow = |i: usize| f.scene.stages[i + 1..].iter().any(flows);
    let inflations = f.stages_of(StageKind::PreInflation).filter(|(i, s)| dynamic(s) && before_flow(*i));
    let mut found = Vec::new();
    for (i, s) in inflations.filter(|_| f.is_parachute()) {
        let Some(period) = first_period(f, s) else { continue };
        let omega = TAU / period;
        let tau = s.stiffness_damping_s + f.scene.fabric.retardation_time_s;
        let rate = s.mass_damping_per_s + tau * omega * omega;
        if rate >= 2.0 * omega {
            continue;
        }
        let left = (-rate * s.duration_s).exp();
        let figure = format!(
            "stage `{}` leaves about {} of the energy of the canopy's swing of {} s: damped by {} 1/s for {} s",
            s.name,
            super::facts::percent(left),
            digits(period),
            digits(rate),
            digits(s.duration_s)
        );
        let severity = if left > AT_REST { Warning } else { Note };
        // At most half of critical: what is overdamped creeps, and is no nearer to rest.
        let enough = (-AT_REST.ln() / s.duration_s).clamp(0.5 * omega, omega);
        let long = s.duration_s.max(-AT_REST.ln() / enough);
        let judged = Judged::new(severity, format!("stage[{i}].mass_damping_per_s"), figure);
        found.push(judged.remedy(format!(
            "the next stage starts from a shape in motion: set mass_damping_per_s = {} with a duration_s of at least {}, or set \
             solve = \"static\"",
            digits(enough),
            digits(long)
        )));
    }
    found
}

fn canopy_mode(f: &Facts<'_>) -> Vec<Judged> {
    let mut found = Vec::new();
    for (i, s) in f.stages().filter(|(_, s)| dynamic(s)) {
        let coupled = s.kind == StageKind::Coupled;
        let Some(period) = first_period(f, s) else { continue };
        let (step, name) =
            if coupled { (s.window_s, "windows") } else { (s.window_s / f64::from(s.substeps), "substeps") };
        let severity = if period / step < RESOLVED { Warning } else { Note };
        let air = if coupled { " with the air that moves along" } else { "" };
        let figure = format!(
            "stage `{}` has {} {name} in a period of the canopy's first mode, {} s{air}",
            s.name,
            digits(period / step),
            digits(period)
        );
        let best = period / RESOLVED * (s.window_s / step);
        let remedy =
            format!("window_s of at most {} s, or more substeps in a stage without air", digits(best));
        found.push(Judged::new(severity, format!("stage[{i}].window_s"), figure).remedy(remedy));
    }
    found
}

fn line_mode(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let (Some(material), true) = (&f.scene.lines, f.is_parachute()) else { return Vec::new() };
    let suspension: Vec<_> =
        f.mesh.cables.iter().filter(|c| c.kind == mesh::CableKind::SuspensionLine).collect();
    let count = suspension.iter().map(|c| c.line).collect::<std::collections::BTreeSet<_>>().len();
    if count == 0 || f.scene.structure.integration == case::Integration::Explicit {
        return Vec::new();
    }
    let length = suspension.iter().map(|c| c.rest_length).sum::<f64>() / count as f64;
    let stiffness = material.youngs_modulus_pa * material.area_m2 / length;
    let mass = n.fabric_mass / count as f64 + 0.5 * material.area_m2 * material.density_kg_m3 * length;
    let period = TAU * (mass / stiffness).sqrt();
    let mut found = Vec::new();
    for (i, s) in f.stages().filter(|(_, s)| dynamic(s)) {
        let steps = period * f64::from(s.substeps) / s.window_s;
        let severity = if steps < RESOLVED { Warning } else { Note };
        let figure = format!(
            "stage `{}` has {} substeps in a period of the fabric on its lines, {} s",
            s.name,
            digits(steps),
            digits(period)
        );
        let least = (RESOLVED * s.window_s / period).ceil();
        let judged = Judged::new(severity, format!("stage[{i}].substeps"), figure);
        found.push(judged.remedy(format!(
            "set substeps = {least}, shorten window_s, or set structure.integration = \"explicit\""
        )));
    }
    found
}

fn development(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let mut found = Vec::new();
    let speed = |i: usize| n.stage_speeds[i][0];
    for (i, s) in f.stages_of(StageKind::FlowOnly).filter(|(i, s)| s.duration_s > 0.0 && speed(*i) > 0.0) {
        let figure = format!(
            "in stage `{}` the stream travels {} widths of the canopy",
            s.name,
            digits(speed(i) * s.duration_s / n.width)
        );
        found.push(Judged::new(Note, format!("stage[{i}].duration_s"), figure));
    }
    found
}

fn shedding(f: &Facts<'_>) -> Vec<Judged> {
    let n = &f.numbers;
    let mut found = Vec::new();
    let speed = |i: usize| n.stage_speeds[i][0];
    for (i, s) in f.stages_of(StageKind::Coupled).filter(|(i, _)| speed(*i) > 0.0 && f.is_parachute()) {
        let period = n.width / (STROUHAL * speed(i));
        let figure = format!(
            "stage `{}` covers {} shedding periods of about {} s",
            s.name,
            digits(s.duration_s / period),
            digits(period)
        );
        found.push(Judged::new(Note, format!("stage[{i}].duration_s"), figure));
    }
    found
}

fn order(f: &Facts<'_>) -> Vec<Judged> {
    let stages = &f.scene.stages;
    let inflates = |s: &Stage| s.kind == StageKind::PreInflation;
    let flows = |s: &Stage| s.kind.roles().contains(&Role::Flow);
    let mut found = Vec::new();
    for (i, s) in f.stages() {
        let key = format!("stage[{i}].kind");
        let closed = matches!(f.scene.canopy, Canopy::Atps(_))
            && f.scene.flow.as_ref().is_some_and(|w| w.grid_file.is_none() && !w.is_immersed());
        let opens = |s: &Stage| inflates(s) || (s.kind == StageKind::Coupled && f.scene.is_immersed(s));
        if closed && flows(s) && !stages[..i].iter().any(opens) {
            let figure = format!(
                "stage `{}` needs a flow grid, but the vents of the canopy as cut are closed slits",
                s.name
            );
            found.push(Judged::new(Error, key, figure));
        } else if inflates(s) && stages[..i].iter().any(flows) && stages[i + 1..].iter().any(flows) {
            let figure = format!(
                "stage `{}` changes the shape after a stage of the flow: later stages start from a flow around the \
                 earlier shape",
                s.name
            );
            found.push(Judged::new(Warning, key, figure));
        }
    }
    found
}

fn damping(f: &Facts<'_>) -> Vec<Judged> {
    f.stages_of(StageKind::Coupled)
        .filter(|(_, s)| s.mass_damping_per_s > 0.0 && f.is_parachute())
        .map(|(i, s)| {
            let figure =
                format!("stage `{}` damps the canopy by {} 1/s", s.name, digits(s.mass_damping_per_s));
            Judged::new(Warning, format!("stage[{i}].mass_damping_per_s"), figure)
        })
        .collect()
}
