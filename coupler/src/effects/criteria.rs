//! When an effect matters: one dimensionless number of the scene for each.
//!
//! Estimates of a share of the answer (drag, shape, speed), right to a factor of a few:
//! they tell a hundredth from a ten-thousandth, not one per cent from two.

use case::{Cloth, Permeability, Scene, ShearProfile, StageKind};

use super::numbers::Numbers;

/// Share of the answer from which an effect matters.
pub const WORTH: f64 = 0.01;

/// Whether an effect matters in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Leaving it out would change the answer.
    Matters,
    /// Leaving it out would hardly change the answer.
    Hardly,
    /// The scene's numbers do not tell: a matter of what is to be simulated.
    Open,
}

/// A verdict with its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Whether the effect matters.
    pub verdict: Verdict,
    /// The numbers that say so.
    pub why: String,
}

fn by_share(share: f64, why: String) -> Judgement {
    Judgement { verdict: if share >= WORTH { Verdict::Matters } else { Verdict::Hardly }, why }
}

fn open(why: impl Into<String>) -> Judgement {
    Judgement { verdict: Verdict::Open, why: why.into() }
}

/// A share for people.
pub(super) fn percent(share: f64) -> String {
    let p = 100.0 * share;
    if p == 0.0 {
        "0 %".into()
    } else if p.abs() < 0.01 {
        format!("{p:.0e} %")
    } else if p.abs() < 10.0 {
        format!("{p:.2} %")
    } else {
        format!("{p:.0} %")
    }
}

/// Pressure that thin fabric can take in compression before it folds, beside its tension:
/// plate buckling over a cell, `pi^2 E t^3 / (12 (1 - nu^2) l^2)` beside `p R`.
pub(super) fn wrinkling(n: &Numbers<'_>) -> Judgement {
    let f = &n.scene.fabric;
    let buckling = std::f64::consts::PI.powi(2) * f.youngs_modulus_pa * f.thickness_m.powi(3)
        / (12.0 * (1.0 - f.poisson_ratio.powi(2)) * n.cell * n.cell);
    let ratio = buckling / (n.pressure * 0.5 * n.width);
    by_share(
        1.0 - ratio.min(1.0),
        format!("a cell of {:.2} m folds at {} of the tension p R", n.cell, percent(ratio)),
    )
}

pub(super) fn orthotropic(n: &Numbers<'_>) -> Judgement {
    match &n.scene.fabric.orthotropic {
        Some(o) => {
            let change = (1.0 - o.youngs_modulus_2_pa / n.scene.fabric.youngs_modulus_pa).abs();
            by_share(
                change * n.strain,
                format!("moduli differ by {}, strain {}: ", percent(change), percent(n.strain))
                    + &format!("{} of the length", percent(change * n.strain)),
            )
        }
        None => open(format!("strain is about {}; the weft's modulus is not known", percent(n.strain))),
    }
}

pub(super) fn prestress(n: &Numbers<'_>) -> Judgement {
    let f = &n.scene.fabric;
    if f.prestress_pa <= 0.0 {
        return open("a canopy is cut without tension, a stretched panel is not");
    }
    let share = f.prestress_pa * f.thickness_m / (n.pressure * 0.5 * n.width);
    by_share(share, format!("{} of the tension p R", percent(share)))
}

pub(super) fn lines(n: &Numbers<'_>) -> Judgement {
    open(if n.line_length > 0.0 {
        format!("{:.0} m of lines of {:.3} kg", n.line_length, n.line_mass)
    } else {
        "the canopy has none".into()
    })
}

pub(super) fn reinforcements(n: &Numbers<'_>) -> Judgement {
    let f = &n.scene.fabric;
    match &n.scene.lines {
        Some(l) => {
            let ratio = l.youngs_modulus_pa * l.area_m2 / (f.youngs_modulus_pa * f.thickness_m * n.cell);
            open(format!(
                "a tape of the lines' stiffness is {ratio:.1} times that of a cell's width of fabric"
            ))
        }
        None => open("the scene has no [lines] to give their stiffness"),
    }
}

pub(super) fn fabric_gravity(n: &Numbers<'_>) -> Judgement {
    let share = n.fabric_kg_m2 * n.gravity / n.pressure;
    by_share(share, format!("the fabric weighs {} of the pressure of {:.1} Pa", percent(share), n.pressure))
}

/// Light fabric accelerates more air than itself.
pub(super) fn descent(n: &Numbers<'_>) -> Judgement {
    if n.falling_mass == 0.0 {
        return open("nothing falls in this scene");
    }
    let fall = n.falling_mass * n.gravity;
    let hold = n.dynamic_pressure * n.fabric_area;
    by_share(
        (n.gravity * n.duration / n.speed.max(1e-9)).min(1.0),
        format!(
            "weight {fall:.0} N beside {hold:.0} N of dynamic pressure on the fabric; gravity would change the speed by {:.1} m/s in the longest stage",
            n.gravity * n.duration
        ),
    )
}

pub(super) fn permeability(n: &Numbers<'_>) -> Judgement {
    if n.speed == 0.0 {
        return open("no stream that could be compared");
    }
    let share = |p: &Permeability| {
        let (a, b) = p.coefficients();
        n.leakage(a, b) / n.speed
    };
    match &n.scene.fabric.permeability {
        Some(p) => {
            let s = share(p);
            by_share(
                s,
                format!("air passes at {} of the descent speed under {:.1} Pa", percent(s), n.pressure),
            )
        }
        None => {
            let all: Vec<String> = Cloth::ALL
                .iter()
                .map(|c| {
                    let p = Permeability { cloth: Some(*c), ..Permeability::default() };
                    format!("{} of the speed through {}", percent(share(&p)), c.name())
                })
                .collect();
            open(format!("depends on the cloth: under {:.1} Pa {}", n.pressure, all.join(", ")))
        }
    }
}

/// Friction of a turbulent plate on both sides, `2 * 0.074 Re^-0.2`, beside the drag.
pub(super) fn viscosity(n: &Numbers<'_>) -> Judgement {
    if n.reynolds == 0.0 {
        return open("no stream that could be compared");
    }
    // Laminar below a plate's transition.
    let friction = if n.reynolds < 5e5 { 1.328 / n.reynolds.sqrt() } else { 0.074 / n.reynolds.powf(0.2) };
    let share = 2.0 * friction * n.dynamic_pressure * n.fabric_area / n.drag;
    by_share(
        share,
        format!(
            "Reynolds number {:.1e}: friction is {} of the drag; the first cell of {:.3} m holds {:.1} boundary layers of {:.3} m",
            n.reynolds,
            percent(share),
            n.first_layer,
            n.first_layer / n.boundary_layer(),
            n.boundary_layer()
        ),
    )
}

/// A wake is turbulent from a Reynolds number of about 300 (bluff bodies) on; a model has
/// something to add where the grid carries part of the eddies' cascade only.
pub(super) fn turbulence(n: &Numbers<'_>) -> Judgement {
    if n.reynolds == 0.0 {
        return open("no stream that could be compared");
    }
    // Kolmogorov's length over the cell.
    let smallest = n.width / n.reynolds.powf(0.75);
    let turbulent = n.reynolds > 300.0 && smallest < n.cell;
    Judgement {
        verdict: match turbulent {
            false => Verdict::Hardly,
            true if n.scene.flow.as_ref().is_some_and(|f| f.viscosity.is_some()) => Verdict::Matters,
            true => Verdict::Open,
        },
        why: format!(
            "Reynolds number {:.1e}, smallest eddies of {smallest:.0e} m beside cells of {:.2} m{}",
            n.reynolds,
            n.cell,
            if turbulent {
                "; wake and separation at a smooth edge need it, an edge that separates by itself hardly"
            } else {
                ""
            }
        ),
    }
}

/// Air that is stopped warms by `(gamma - 1)/2 M^2` of its temperature.
pub(super) fn energy(n: &Numbers<'_>) -> Judgement {
    let share = 0.2 * n.mach * n.mach;
    by_share(share, format!("Mach {:.3}: stopped air warms by {} of its temperature", n.mach, percent(share)))
}

/// Density changes by half the square of the Mach number: shocks need much more.
pub(super) fn limiter(n: &Numbers<'_>) -> Judgement {
    let share = 0.5 * n.mach * n.mach;
    by_share(share, format!("Mach {:.3}: density changes by {}, no shock to limit", n.mach, percent(share)))
}

fn length(v: &[f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(super) fn gust(n: &Numbers<'_>) -> Judgement {
    match n.scene.flow.as_ref().and_then(|f| f.gust.as_ref()) {
        Some(g) => {
            let share = length(&g.velocity_m_s) / n.speed.max(1e-9);
            let crossed = g.duration_s * n.speed / n.width;
            by_share(share, format!("{} of the stream, over {crossed:.1} widths of travel", percent(share)))
        }
        None => open("the air is steady, as the scene says"),
    }
}

pub(super) fn shear(n: &Numbers<'_>) -> Judgement {
    let Some(flow) = n.scene.flow.as_ref() else { return open("no flow") };
    let Some(s) = &flow.shear else {
        return open(if length(&flow.wind_m_s) == 0.0 {
            "no wind"
        } else {
            "the wind is the same at all heights"
        });
    };
    // Over the parachute and the way that it falls.
    let span = n.width + n.suspension + n.speed * n.duration;
    let wind = length(&flow.wind_m_s);
    let change = match s.profile {
        ShearProfile::Linear => wind * s.slope_per_m.abs() * span,
        ShearProfile::Power => {
            let at = |z: f64| (z.max(1e-3) / s.reference_height_m).powf(s.exponent);
            wind * (at(s.start_height_m) - at(s.start_height_m - span)).abs()
        }
        ShearProfile::Log => {
            let at = |z: f64| {
                (z.max(2.0 * s.roughness_m) / s.roughness_m).ln()
                    / (s.reference_height_m / s.roughness_m).ln()
            };
            wind * (at(s.start_height_m) - at(s.start_height_m - span)).abs()
        }
        ShearProfile::Table => {
            s.table_m_s.windows(2).map(|w| length(&std::array::from_fn(|i| w[1][i] - w[0][i]))).sum()
        }
    };
    let share = change / n.speed.max(1e-9);
    by_share(
        share,
        format!("the wind changes by {change:.2} m/s over {span:.0} m: {} of the stream", percent(share)),
    )
}

/// How far the canopy moves in its frame beside a cell.
pub(super) fn moving_grid(n: &Numbers<'_>) -> Judgement {
    let moves = n.scene.stages.iter().any(|s| s.kind.roles().contains(&case::Role::Mesh));
    open(if moves {
        format!("the canopy moves in cells of {:.2} m", n.first_layer)
    } else {
        "no stage moves the canopy in the flow".into()
    })
}

/// Damping beside the slowest motion: the canopy's passage through its own width.
pub(super) fn mass_damping(n: &Numbers<'_>) -> Judgement {
    let most = |kinds: &dyn Fn(StageKind) -> bool| {
        n.scene.stages.iter().filter(|s| kinds(s.kind)).map(|s| s.mass_damping_per_s).fold(0.0, f64::max)
    };
    let coupled = most(&|k| k == StageKind::Coupled);
    if coupled == 0.0 {
        return open(format!("{}/s in stages without air", most(&|_| true)));
    }
    // The force on fabric that moves at a tenth of the stream.
    let share = coupled * n.fabric_kg_m2 * 0.1 * n.speed / n.pressure;
    by_share(
        share,
        format!("{coupled}/s on fabric at a tenth of the stream is {} of the pressure", percent(share)),
    )
}

pub(super) fn stiffness_damping(n: &Numbers<'_>) -> Judgement {
    let time = n.scene.stages.iter().map(|s| s.stiffness_damping_s).fold(0.0, f64::max);
    if time == 0.0 {
        return open("real lines and tapes lose a few per cent of a cycle's energy");
    }
    // Ratio to critical of a wave through the canopy in its fabric.
    let f = &n.scene.fabric;
    let wave = (f.youngs_modulus_pa / f.density_kg_m3).sqrt() / n.width;
    let ratio = 0.5 * time * 2.0 * std::f64::consts::PI * wave;
    by_share(ratio, format!("{} of critical for the first wave in the fabric", percent(ratio)))
}

/// Drag of lines across the stream beside that of the whole, at the sine of their slant.
pub(super) fn line_drag(n: &Numbers<'_>) -> Judgement {
    if n.speed == 0.0 || n.line_length == 0.0 {
        return open("no lines in a stream");
    }
    let drag = n.scene.lines.as_ref().and_then(|l| l.drag.as_ref());
    let (c, width) =
        drag.map_or((1.1, n.line_diameter), |d| (d.coefficient, d.diameter_m.unwrap_or(n.line_diameter)));
    // Lines spread from the payload to the rim: their mean slant to the stream.
    let slant = (0.5 * n.width).atan2(n.suspension).sin();
    let force = c * width * n.line_length * n.dynamic_pressure * slant * slant * slant;
    let share = force / n.drag;
    by_share(
        share,
        format!(
            "{:.1} N on {:.0} m of {:.1} mm lines, {} of the drag",
            force,
            n.line_length,
            1e3 * width,
            percent(share)
        ),
    )
}

pub(super) fn payload_drag(n: &Numbers<'_>) -> Judgement {
    let Some(d) = n.scene.descent.as_ref() else { return open("nothing falls in this scene") };
    match &d.payload_drag {
        Some(p) => {
            let share = p.drag_area_m2 * n.dynamic_pressure / n.drag;
            by_share(share, format!("{} of the drag", percent(share)))
        }
        None => {
            let area = WORTH * n.drag / n.dynamic_pressure.max(1e-9);
            open(format!("a drag area above {area:.2} m2 would carry {} of the weight", percent(WORTH)))
        }
    }
}

/// A pendulum of the lines' length beside the time that is simulated.
pub(super) fn body(n: &Numbers<'_>) -> Judgement {
    if n.falling_mass == 0.0 || n.suspension == 0.0 {
        return open("no payload hangs on lines");
    }
    let period = 2.0 * std::f64::consts::PI * (n.suspension / n.gravity).sqrt();
    let fall = n.scene.stages.iter().filter(|s| s.kind == StageKind::Coupled);
    let time = fall.map(|s| s.duration_s).sum::<f64>();
    // Displacement of a pendulum let go, as a share of its amplitude.
    let share = (1.0 - (2.0 * std::f64::consts::PI * time / period).cos()).min(2.0);
    let flow = n.scene.flow.as_ref();
    let pushed = flow.is_some_and(|f| {
        f.gust.is_some() || f.shear.is_some() || f.wind_m_s[0] != 0.0 || f.wind_m_s[1] != 0.0
    });
    let why = format!(
        "pendulum of {period:.1} s, {time:.1} s of descent: {} of its amplitude{}",
        percent(share),
        if pushed { "" } else { "; nothing pushes it sideways" }
    );
    if pushed { by_share(share, why) } else { open(why) }
}

pub(super) fn contact(n: &Numbers<'_>) -> Judgement {
    let skirt = std::f64::consts::PI * n.width;
    match n.scene.reefing.iter().map(|r| r.length_m).reduce(f64::min) {
        Some(length) if length < skirt => open(format!(
            "a skirt of {skirt:.1} m reefed to {length:.1} m lies in folds: {} of it is slack",
            percent(1.0 - length / skirt)
        )),
        _ => open("an open, inflated canopy does not touch itself; a collapsing or folded one does"),
    }
}

pub(super) fn reefing(n: &Numbers<'_>) -> Judgement {
    let skirt = std::f64::consts::PI * n.width;
    match n.scene.reefing.iter().map(|r| r.length_m).reduce(f64::min) {
        Some(length) => {
            let share = (1.0 - length / skirt).max(0.0);
            by_share(
                share,
                format!("{length:.2} m in a skirt of about {skirt:.2} m: {} shorter", percent(share)),
            )
        }
        None => open("a canopy that opens at once"),
    }
}

pub(super) fn prescribed(_: &Numbers<'_>) -> Judgement {
    open("what the scene prescribes")
}

pub(super) fn integration(n: &Numbers<'_>) -> Judgement {
    let f = &n.scene.fabric;
    // A wave in the fabric crosses a cell in about this time.
    let stable = n.cell / (f.youngs_modulus_pa / f.density_kg_m3).sqrt();
    let step = n.scene.stages.iter().filter(|s| s.window_s > 0.0).map(|s| s.window_s / f64::from(s.substeps));
    let step = step.fold(0.0, f64::max);
    open(format!(
        "about {:.1} stable steps in the longest substep: explicit pays below some tens",
        step / stable
    ))
}

pub(super) fn steady(_: &Numbers<'_>) -> Judgement {
    open("a shape held still in a steady stream; no vortices that shed")
}

/// Whether any stage has a value above zero.
pub(super) fn any_stage(scene: &Scene, value: impl Fn(&case::Stage) -> f64) -> bool {
    scene.stages.iter().any(|s| value(s) > 0.0)
}
