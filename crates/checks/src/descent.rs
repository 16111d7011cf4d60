//! Checks of the descent: weight and drag, initial and steady speed, payload.

use case::{Role, Stage, StageKind};

use super::facts::{Facts, digits};
use super::finding::Judged;
use super::finding::Severity::{Error, Note, Warning};
use super::table::{Check, When};

/// Drag coefficient on the constructed area that estimates a steady descent, and Knacke's for flat canopies.
const USUAL_DRAG: f64 = 0.75;

/// The rows.
pub const CHECKS: &[Check] = &[
    Check {
        id: "descent.missing",
        what: "a released parachute has a payload and a relative air speed",
        estimate: "a coupled stage with suspension lines, [descent], wind and gust",
        range: "warning without [descent] and without wind or gust; note without [descent] in a wind (wind tunnel)",
        source: "without [descent] the confluence point is fixed and there is no descent",
        severity: Warning,
        remedy: "add [descent] with payload_mass_kg, initial_speed_m_s and reference_area_m2",
        when: When::Before(missing),
    },
    Check {
        id: "descent.initial-speed",
        what: "the initial air speed relative to the canopy is nonzero and near the steady speed",
        estimate: "free-stream speed relative to the canopy at the start of the first coupled stage: \
                   descent.initial_speed_m_s with the wind and gust of that stage",
        range: "warning at 0 m/s; error at 0 m/s in a scene with a flow-only stage and neither gust, shear nor data of \
                inlets, outlets or walls; \
                warning above three times the steady speed of descent.steady-speed, a note where the canopy opens from a \
                gathered skirt",
        source: "a flow-only stage at 0 m/s develops no flow; drag coefficients refer to the initial speed; at three \
                 times the steady speed the drag is nine times the weight",
        severity: Error,
        remedy: "set descent.initial_speed_m_s near the steady speed that this inspection estimates",
        when: When::Before(initial_speed),
    },
    Check {
        id: "descent.drag-coefficient",
        what: "weight and drag balance at the initial speed with a realistic drag coefficient",
        estimate: "C = m g / (1/2 rho V^2 S) with the initial speed V, on the nominal area S_0 (fabric; of gores with vent and gaps) \
                   and on descent.reference_area_m2",
        range: "0.3 to 1.1 on the nominal area: warning outside, a note where the canopy opens from a gathered skirt",
        source: "Knacke, Parachute Recovery Systems Design Manual (1992), tables 5-1 to 5-5, secondary source: cross \
                 0.60 to 0.85, flat circular 0.75 to 0.80, hemispherical 0.62 to 0.77, slotted canopies from 0.3; the \
                 ATPS needs 0.51 to 0.55",
        severity: Warning,
        remedy: "weight and drag do not balance at the start: set descent.initial_speed_m_s to the steady speed, or check \
                 payload_mass_kg (kg) and the width of the canopy (m)",
        when: When::Before(drag_coefficient),
    },
    Check {
        id: "descent.steady-speed",
        what: "the steady speed is that of a parachute",
        estimate: "V = (2 m g / (rho 0.75 S_0))^1/2, the steady speed at a drag coefficient of 0.75",
        range: "2 to 20 m/s: warning outside",
        source: "personnel parachutes descend at 5 to 7 m/s, cargo up to 9 m/s, small and light ones from 2 m/s; \
                 drogues are faster",
        severity: Warning,
        remedy: "check descent.payload_mass_kg (kg), the canopy's width (m) and descent.gravity_m_s2",
        when: When::Before(steady_speed),
    },
    Check {
        id: "descent.reference-area",
        what: "the reference area is of the order of the canopy area",
        estimate: "descent.reference_area_m2 / S_0",
        range: "0.1 to 1.5: warning outside",
        source: "nominal area 1, projected area about 0.5, the ATPS's square top 0.30",
        severity: Warning,
        remedy: "set descent.reference_area_m2 in m2; it affects drag coefficients only, not the motion",
        when: When::Before(reference_area),
    },
    Check {
        id: "descent.pressure",
        what: "the pressure of a pre-inflation is of the order of the dynamic pressure of the descent",
        estimate: "pressure_pa / q with the dynamic pressure q = 1/2 rho V^2 of the initial speed",
        range: "0.2 to 3: warning outside, and at 0 Pa, a note where the canopy opens from a gathered skirt; error below 0 Pa on \
                a canopy with suspension lines",
        source: "the pressure jump is between 1 q (stagnation) and 1.7 q (with suction outside); the jump is inside \
                 minus outside, so a negative value pushes the canopy towards the payload",
        severity: Error,
        remedy: "set pressure_pa to about q; a positive jump inflates",
        when: When::Before(pressure),
    },
    Check {
        id: "descent.payload-body",
        what: "spin, size and inertia of the payload are realistic",
        estimate: "spin (rad/s), distance of attachments from the centre of mass over half the width of the canopy, radius of \
                   gyration (I / m)^1/2",
        range: "warning for a spin above 10 rad/s, attachments farther than half the canopy's width, a radius of \
                gyration outside 0.01 to 5 m",
        source: "10 rad/s is 1.6 revolutions per second; a cube of 0.5 m has a radius of gyration of 0.2 m",
        severity: Warning,
        remedy: "give initial_spin_rad_s in rad/s (1 degree is 0.01745 rad), attachments_m in m, inertia_kg_m2 in kg m2",
        when: When::Before(payload_body),
    },
];

/// Whether there is a wind, gust or shear in the stages to run that `which` selects.
fn air_moves(f: &Facts<'_>, which: impl Fn(&Stage) -> bool) -> bool {
    let shear = f.scene.shear().is_some();
    shear || f.stages().any(|(i, s)| which(s) && f.numbers.stage_speeds[i][1] > 0.0)
}

/// Dynamic pressure at the start of the first coupled stage, Pa.
fn release_pressure(f: &Facts<'_>) -> f64 {
    0.5 * f.numbers.density * f.numbers.release_speed * f.numbers.release_speed
}

fn missing(f: &Facts<'_>) -> Vec<Judged> {
    if f.scene.descent.is_some() || !f.is_parachute() || !f.has(StageKind::Coupled) {
        return Vec::new();
    }
    vec![if air_moves(f, |s| s.kind == StageKind::Coupled) {
        Judged::new(
            Note,
            "",
            "the scene has no [descent]: the confluence point is fixed in the wind, as in a wind tunnel",
        )
    } else {
        Judged::new(
            Warning,
            "",
            "the scene has no [descent] and no wind: there is neither a descent nor an air flow",
        )
    }]
}

/// Speed at which weight and drag balance with [`USUAL_DRAG`] on the nominal area, m/s; 0 without weight.
pub(super) fn balance_speed(f: &Facts<'_>) -> f64 {
    let n = &f.numbers;
    (2.0 * f.weight() / (n.density * USUAL_DRAG * f.nominal_area())).sqrt()
}

fn initial_speed(f: &Facts<'_>) -> Vec<Judged> {
    let Some(d) = &f.scene.descent else { return still_air(f) };
    let key = "descent.initial_speed_m_s";
    let flow = f.stages().any(|(_, s)| s.kind.roles().contains(&case::Role::Flow));
    if !flow {
        return Vec::new();
    }
    let steady = balance_speed(f);
    let speed = f.numbers.release_speed;
    let still = still_air(f);
    if !still.is_empty() {
        return still;
    }
    if d.initial_speed_m_s == 0.0 {
        let figure = format!(
            "the initial speed is 0 m/s: there is no initial drag, and drag coefficients have no reference speed; \
             the steady speed is about {} m/s",
            digits(steady)
        );
        return vec![Judged::new(Warning, key, figure)];
    }
    if f.is_parachute() && steady > 0.0 && speed > 3.0 * steady {
        let figure = format!(
            "the initial speed is {} m/s, {} times the steady speed of about {} m/s: the drag is about {} times the weight",
            digits(speed),
            digits(speed / steady),
            digits(steady),
            digits((speed / steady).powi(2))
        );
        return vec![Judged::new(f.off_balance(), key, figure)];
    }
    Vec::new()
}

/// The error of a flow-only stage in still air.
fn still_air(f: &Facts<'_>) -> Vec<Judged> {
    let driven = f.scene.flow.as_ref().is_some_and(case::Flow::is_driven);
    if driven || air_moves(f, |_| true) {
        return Vec::new();
    }
    let Some((_, stage)) = f.stages_of(StageKind::FlowOnly).next() else { return Vec::new() };
    let key = if f.scene.descent.is_some() { "descent.initial_speed_m_s" } else { "flow.wind_m_s" };
    let remedy = match balance_speed(f) {
        speed if speed > 0.0 => {
            format!("set descent.initial_speed_m_s near the steady speed of about {} m/s", digits(speed))
        }
        _ => {
            "set flow.wind_m_s or the velocity of an [[flow.inlet]], or add [descent] with initial_speed_m_s"
                .into()
        }
    };
    let figure = format!(
        "stage `{}` develops the flow around a canopy at rest, but the air is at rest too",
        stage.name
    );
    vec![Judged::new(Error, key, figure).remedy(remedy)]
}

fn drag_coefficient(f: &Facts<'_>) -> Vec<Judged> {
    let (Some(d), true) = (&f.scene.descent, f.is_parachute()) else { return Vec::new() };
    let q = release_pressure(f);
    if q == 0.0 || f.weight() == 0.0 || !f.has(StageKind::Coupled) {
        return Vec::new();
    }
    let constructed = f.weight() / (q * f.nominal_area());
    let severity = if (0.3..=1.1).contains(&constructed) { Note } else { f.off_balance() };
    let figure = format!(
        "the weight of {} N balances the drag at {} m/s with a coefficient of {} on the nominal area of {} m2 \
         ({} on the reference area); a coefficient of {USUAL_DRAG} gives a steady speed of {} m/s",
        digits(f.weight()),
        digits(f.numbers.release_speed),
        digits(constructed),
        digits(f.nominal_area()),
        digits(f.weight() / (q * d.reference_area_m2)),
        digits(balance_speed(f))
    );
    vec![Judged::new(severity, "descent.initial_speed_m_s", figure)]
}

fn steady_speed(f: &Facts<'_>) -> Vec<Judged> {
    if !f.is_parachute() || f.weight() == 0.0 {
        return Vec::new();
    }
    let speed = balance_speed(f);
    let severity = if (2.0..=20.0).contains(&speed) { Note } else { Warning };
    let figure = format!(
        "{} kg under {} m2 descend at about {} m/s",
        digits(f.numbers.falling_mass),
        digits(f.nominal_area()),
        digits(speed)
    );
    vec![Judged::new(severity, "descent.payload_mass_kg", figure)]
}

fn reference_area(f: &Facts<'_>) -> Vec<Judged> {
    let Some(d) = f.scene.descent.as_ref().filter(|_| f.is_parachute()) else { return Vec::new() };
    let share = d.reference_area_m2 / f.nominal_area();
    if (0.1..=1.5).contains(&share) {
        return Vec::new();
    }
    let figure = format!(
        "the reference area of drag coefficients is {} m2, the nominal area {} m2",
        digits(d.reference_area_m2),
        digits(f.nominal_area())
    );
    vec![Judged::new(Warning, "descent.reference_area_m2", figure)]
}

fn pressure(f: &Facts<'_>) -> Vec<Judged> {
    let q = release_pressure(f);
    let followed = f.scene.stages.iter().any(|s| s.kind.roles().contains(&Role::Flow));
    let mut found = Vec::new();
    for (i, stage) in f.stages_of(StageKind::PreInflation) {
        let Some(p) = stage.pressure_pa.filter(|_| f.is_parachute()) else { continue };
        let key = format!("stage[{i}].pressure_pa");
        if p < 0.0 {
            let figure = format!(
                "stage `{}` pushes the canopy towards its payload with {} Pa: the pressure jump is inside minus outside",
                stage.name,
                digits(p)
            );
            found.push(Judged::new(Error, key, figure));
        } else if followed && q > 0.0 {
            let ratio = p / q;
            let severity = if (0.2..=3.0).contains(&ratio) { Note } else { f.off_balance() };
            let figure = format!(
                "stage `{}` loads the canopy with {} Pa, {} times the dynamic pressure of {} Pa at the initial speed",
                stage.name,
                digits(p),
                digits(ratio),
                digits(q)
            );
            found.push(Judged::new(severity, key, figure));
        }
    }
    found
}

fn payload_body(f: &Facts<'_>) -> Vec<Judged> {
    let Some((d, b)) = f.scene.descent.as_ref().and_then(|d| Some((d, d.body.as_ref()?))) else {
        return Vec::new();
    };
    let length = |v: &[f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut found = Vec::new();
    let spin = length(&b.initial_spin_rad_s);
    if spin > 10.0 {
        let figure = format!(
            "the initial spin of the payload is {} rad/s, {} revolutions per second",
            digits(spin),
            digits(spin / std::f64::consts::TAU)
        );
        found.push(Judged::new(Warning, "descent.body.initial_spin_rad_s", figure));
    }
    let far = b.attachments_m.iter().map(length).fold(0.0, f64::max);
    if far > 0.5 * f.numbers.width {
        let figure = format!(
            "an attachment is {} m from the centre of mass of the payload; half the width of the canopy is {} m",
            digits(far),
            digits(0.5 * f.numbers.width)
        );
        found.push(Judged::new(Warning, "descent.body.attachments_m", figure));
    }
    let radius = |i: f64| (i / d.payload_mass_kg).sqrt();
    if let Some(r) = b.inertia_kg_m2.map(radius).into_iter().find(|r| !(0.01..=5.0).contains(r)) {
        let figure = format!("the payload has a radius of gyration of {} m", digits(r));
        found.push(Judged::new(Warning, "descent.body.inertia_kg_m2", figure));
    }
    found
}
