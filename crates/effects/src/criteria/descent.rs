//! Effects of the descent: lines and payload in the air, the payload as a body.

use std::f64::consts::PI;

use super::{signed, unsigned};
use crate::estimate::{Assessment, Scope, percent};
use crate::fall::{Influence, Motion};
use crate::wind::Wind;

/// Density of a payload of unknown size, kg/m3: that of cargo, a third to three times of it occurs.
const PAYLOAD_DENSITY: f64 = 500.0;
/// Drag coefficient of a cube with a face to the stream (Hoerner 1965, section 3-8).
const CUBE: f64 = 1.05;

/// Drag of lines across the stream at the sine of their slant: $`C d L q \sin^3\theta`$ (Hoerner 1965, section 3-3),
/// half of it on the canopy, and along them $`\pi c_f d L q \cos^3\theta`$. Lines that bend inwards draw the skirt in:
/// the radial pull rises by $`\cos\theta / (2 \sin^2\theta)`$, some 3 times the share, and the drag area falls by about
/// twice the share. The direction of the change is open. Within a factor of 5.
pub fn line_drag(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    if n.line_length == 0.0 || !s.fall.tension {
        return Assessment::not("no lines stand in the stream of the last stage");
    }
    let own = s.scene().line_drag().cloned();
    let drag = own.unwrap_or_default();
    let width = s.scene().resolved().line_diameter_m;
    let slant = (0.5 * n.width).atan2(n.suspension);
    let area = width
        * n.line_length
        * (drag.coefficient * slant.sin().powi(3) + PI * drag.friction_coefficient * slant.cos().powi(3));
    let share = area / s.fall.drag_area;
    s.of(
        &Influence { canopy: -2.0 * share, below_canopy: share, through_lines: 0.5, ..Influence::default() },
        &unsigned(5.0),
        format!(
            "{:.1} N on {:.0} m of {:.1} mm lines, {} of the drag",
            area * n.dynamic_pressure,
            n.line_length,
            1e3 * width,
            percent(share)
        ),
    )
}

/// Drag area of a payload whose own is not known, m2: a cube of its mass (kg) at the density of cargo,
/// $`C (m / \rho)^{2/3}`$.
pub fn typical_drag_area(mass_kg: f64) -> f64 {
    CUBE * (mass_kg / PAYLOAD_DENSITY).powf(2.0 / 3.0)
}

/// The payload's drag area relative to the canopy's, $`C A / (C_D S)`$: the payload carries that share of the weight
/// itself (Hoerner 1965, section 3-8). A scene that gives no drag area is judged with a cube of the payload's
/// mass at 500 kg/m3. Within a factor of 3.
pub fn payload_drag(s: &Scope<'_>) -> Assessment {
    let Some(d) = s.scene().descent.as_ref() else { return Assessment::not("nothing falls in this scene") };
    if s.fall.motion != Motion::Falls {
        return Assessment::not("nothing falls in the last stage");
    }
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let (area, what) = match &d.payload_drag {
        Some(p) => (p.drag_area_m2, "given"),
        None => (typical_drag_area(d.payload_mass_kg), "of a cube of its mass at 500 kg/m3"),
    };
    let share = area / s.fall.drag_area;
    s.of(
        &Influence { below_canopy: share, ..Influence::default() },
        &signed(3.0),
        format!("drag area of {area:.3} m2 ({what}): {} of the canopy's", percent(share)),
    )
}

/// A payload that swings out by the angle $`\varphi = w / U\, (1 - \cos 2\pi t / T)`$ under a cross wind $`w`$, or by
/// $`v_0 / \sqrt{g L}`$ from its own first velocity, on a pendulum of period $`T = 2\pi \sqrt{L/g}`$: the lines'
/// vertical force and the drag change with $`\varphi^2 / 2`$ (Knacke 1992, section 4.5). Within a factor of 10.
pub fn body(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    if s.fall.motion != Motion::Falls || n.suspension == 0.0 {
        return Assessment::not("no payload hangs on lines in the last stage");
    }
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let period = 2.0 * PI * (n.suspension / n.gravity).sqrt();
    let time = s.fall.before + s.fall.time;
    let first =
        s.scene().payload_body().map_or(0.0, |b| b.initial_velocity_m_s[0].hypot(b.initial_velocity_m_s[1]));
    let cross = across(&s.fall.wind, time);
    if cross == 0.0 && first == 0.0 {
        return Assessment::not(format!(
            "nothing pushes the payload sideways (no cross wind, no first velocity); its pendulum has {period:.1} s"
        ));
    }
    let part = (1.0 - (2.0 * PI * (time / period).min(0.5)).cos()).min(2.0);
    let swing = (2.0 * PI * (time / period).min(0.25)).sin();
    let angle = cross / n.speed * part + first / (n.gravity * n.suspension).sqrt() * swing;
    let share = 0.5 * angle.min(1.0).powi(2);
    s.of(
        &Influence { canopy: -share, lines: share, ..Influence::default() },
        &unsigned(10.0),
        format!(
            "pendulum of {period:.1} s, {time:.1} s of descent, swung out to {:.0} degrees",
            angle.min(1.0).to_degrees()
        ),
    )
}

/// Largest wind across the fall, m/s.
fn across(wind: &Wind, time: f64) -> f64 {
    let at = |k: u32| {
        let w = wind.at(time * f64::from(k) / 64.0, 0.0);
        w[0].hypot(w[1])
    };
    (0..=64).map(at).fold(0.0, f64::max)
}

/// Whether the payload is held sideways is a condition that a scene states. A free ATPS descended 12 to 14 % slower over 100 s
/// (docs/records/atps-descent.md).
pub fn frame_motion(s: &Scope<'_>) -> Assessment {
    if s.n.falling_mass == 0.0 {
        return Assessment::not("nothing falls in this scene");
    }
    Assessment::not("a condition on the payload: held sideways, or free to glide with its canopy")
}

/// Whether a frame falls is part of the question.
pub fn descent(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    if n.falling_mass == 0.0 {
        return Assessment::not("nothing falls in this scene");
    }
    if !s.scene().has_fabric() {
        return Assessment::not("no air acts on cables alone");
    }
    Assessment::not(format!(
        "part of what is simulated: a weight of {:.0} N on {:.0} N of dynamic pressure; speeds respond within {:.2} s",
        n.falling_mass * n.gravity,
        n.dynamic_pressure * n.fabric_area,
        s.fall.response_time()
    ))
}
