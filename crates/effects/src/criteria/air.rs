//! Effects of the air.

use case::{Cloth, Permeability};

use super::{signed, unsigned};
use crate::estimate::{Assessment, Scope, percent};
use crate::fall::Influence;
use crate::numbers::length;
use crate::wind::{Sheared, Wind, remove_gusts};

/// Square of the tangential speed at the canopy over that of the stream, as a mean over both sides.
const TANGENTIAL: f64 = 0.3;
/// Part of the friction that acts along the stream: the mean slant of an inflated canopy (a flat one has less).
const ALONG: f64 = 0.5;
/// Change of the drag of a bluff body with a sharp edge by a model of its turbulent wake.
const WAKE: f64 = 0.01;

/// Air that passes at $`v`$ under the pressure jump $`p`$ (Forchheimer's law, $`p = a v + b v^2`$) fills the wake: the
/// drag falls by about twice the share $`v / U`$ (bluff plates with bleed: Castro, J. Fluid Mech. 46, 1971; parachutes:
/// Knacke 1992, section 5.2). A scene that names no cloth is judged with MIL-C-7020 type III. Within a factor of 3.
pub fn permeability(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let share = |p: &Permeability| {
        let (a, b) = p.coefficients(s.n.density);
        s.n.leakage(a, b) / s.n.speed
    };
    if s.scene().has_permeable_groups() {
        return Assessment::not(
            "groups of the mesh file have cloths of their own, whose shares of the area are not weighed",
        );
    }
    let named = |c: Cloth| Permeability { cloth: Some(c), ..Permeability::default() };
    let (leak, why) = match &s.scene().fabric.permeability {
        Some(p) => (share(p), "through the cloth".to_owned()),
        None => (
            share(&named(Cloth::MilC7020Type3)),
            format!(
                "through mil-c7020-type3 ({} through mil-c44378)",
                percent(share(&named(Cloth::MilC44378)))
            ),
        ),
    };
    s.of(
        &Influence::of_canopy(-2.0 * leak.min(0.45)),
        &signed(3.0),
        format!("air passes at {} of the speed {why} under {:.1} Pa", percent(leak), s.n.pressure),
    )
}

/// What passes groups of a mesh file has no criterion: the cloths are part of what is built.
pub fn permeable_groups(_: &Scope<'_>) -> Assessment {
    Assessment::not("part of what is built: the cloths of a mesh file are the designer's")
}

/// Friction on both sides of the canopy, $`2 c_f q A`$ times the square 0.3 of the tangential over the free speed and
/// the part 0.5 of it along the stream, over the drag; $`c_f`$ of a plate, $`1.328 Re^{-1/2}`$ below
/// $`Re = 5 \cdot 10^5`$ and $`0.074 Re^{-1/5}`$ above (Schlichting, Boundary-Layer Theory, 1979, chapters 7 and 21).
/// Its direction is open: friction also moves the separation. Where cells at the canopy are thicker than the boundary
/// layer $`h > \delta`$, the grid has only the share $`\delta / h`$ of it. Within a factor of 5.
pub fn viscosity(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let n = s.n;
    let plate = if n.reynolds < 5e5 { 1.328 / n.reynolds.sqrt() } else { 0.074 / n.reynolds.powf(0.2) };
    let share = 2.0 * plate * TANGENTIAL * ALONG * n.dynamic_pressure * n.fabric_area
        / (n.dynamic_pressure * s.fall.drag_area);
    let layer =
        if n.reynolds < 5e5 { 5.0 * 0.5 * n.width / (0.5 * n.reynolds).sqrt() } else { n.boundary_layer() };
    let seen = if n.first_layer > 0.0 { (layer / n.first_layer).min(1.0) } else { 1.0 };
    s.of(
        &Influence::of_canopy(share * seen),
        &unsigned(5.0),
        format!(
            "Reynolds number {:.1e}: friction is {} of the drag; the first cell of {:.3} m holds {:.1} boundary \
             layers of {:.3} m{}",
            n.reynolds,
            percent(share),
            n.first_layer,
            n.first_layer / layer,
            layer,
            if seen < 1.0 { format!(": this grid has {} of it", percent(share * seen)) } else { String::new() }
        ),
    )
}

/// A wake is turbulent from a Reynolds number of about 300 on, and a model has something to add where eddies of
/// Kolmogorov's size $`L Re^{-3/4}`$ are smaller than a cell. The edge fixes the separation: the drag of
/// discs and cups is the same to some per cent from $`Re = 10^3`$ to $`10^6`$ (Hoerner, Fluid-Dynamic Drag, 1965,
/// sections 3-7 and 3-9); 1 % within a factor of 5.
pub fn turbulence(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let n = s.n;
    let smallest = n.width / n.reynolds.powf(0.75);
    let why = format!(
        "Reynolds number {:.1e}, smallest eddies of {smallest:.0e} m compared with cells of {:.2} m",
        n.reynolds, n.cell
    );
    if n.reynolds > 300.0 && smallest < n.cell {
        s.of(&Influence::of_canopy(WAKE), &unsigned(5.0), why + "; a sharp edge fixes the separation")
    } else {
        s.of(&Influence::default(), &unsigned(5.0), why + ": nothing is left to a model")
    }
}

/// Air that is stopped warms by $`(\gamma - 1)/2\, M^2`$ of its temperature; its density and with it the pressure
/// change by that share (Shapiro, The Dynamics and Thermodynamics of Compressible Fluid Flow, 1953, chapter 4).
/// Without the equation the air is isothermal. Within a factor of 10.
pub fn energy(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let share = 0.5 * (case::HEAT_RATIO - 1.0) * s.n.mach * s.n.mach;
    s.of(
        &Influence::of_canopy(share),
        &unsigned(10.0),
        format!("Mach {:.4}: stopped air warms by {} of its temperature", s.n.mach, percent(share)),
    )
}

/// A limiter replaces second by first order where the flow is not smooth: what it changes is error of the grid.
pub fn limiter(s: &Scope<'_>) -> Assessment {
    Assessment::not(format!(
        "a numerical method, not physics: it adds error of the grid, and at Mach {:.3} there is no shock to limit",
        s.n.mach
    ))
}

/// A gust accelerates all air equally: the air past the canopy changes by its velocity, the drag with the square
/// of the speed and with the added mass times its rate ([`crate::fall`]; CS-25.341 for the shape of a pulse).
/// Within a factor of 3.
pub fn gust(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let Some((g, _)) = s.scene().gust(s.stage) else {
        return Assessment::not("no gust meets the last stage, as the scene says");
    };
    let mut calm = s.scene().clone();
    remove_gusts(&mut calm);
    let without = Wind::of(&calm, s.stage);
    let share = percent(g.largest_speed() / s.n.speed);
    let why = match (g.shape, g.duration_s, g.shortest_period()) {
        (case::GustShape::Dryden, ..) => {
            format!("turbulence of up to {share} of the stream (four times its root mean square)")
        }
        (_, _, Some(period)) => format!("{share} of the stream with a period of {period} s"),
        (_, Some(time), None) => format!("{share} of the stream over {time} s"),
        (_, None, None) => format!("{share} of the stream by a table of {} times", g.time_s.len()),
    };
    s.of_wind(&without, &signed(3.0), why)
}

/// A perturbation chooses between states of the wake: how far they differ is known after a run only.
pub fn perturbation(_: &Scope<'_>) -> Assessment {
    Assessment::not(
        "it takes a wake out of its symmetric state: how far the states differ is known after a run only (bluff bodies: a \
         third of the drag)",
    )
}

/// The frame falls through wind of another speed at each height: the drag goes with the speed of the air past the
/// canopy, $`|w| w_z`$ ([`crate::fall`]). Without the effect the wind is that of the reference height
/// everywhere. Within a factor of 5.
pub fn shear(s: &Scope<'_>) -> Assessment {
    if let Err(why) = s.bluff() {
        return Assessment::not(why);
    }
    let Some(Sheared { start_height_m: height, .. }) = &s.fall.wind.shear else {
        return Assessment::not(if length(&s.fall.wind.air.steady()) == 0.0 {
            "no wind blows, as the scene says"
        } else {
            "the wind is the same at all heights, as the scene says"
        });
    };
    let span = s.n.width + s.n.suspension + s.n.speed * s.fall.time;
    let change = s.fall.wind.change_over(span);
    let without = Wind { shear: None, ..s.fall.wind.clone() };
    s.of_wind(
        &without,
        &unsigned(5.0),
        format!(
            "the wind changes by {change:.2} m/s over {span:.0} m below {height} m: {} of the stream",
            percent(change / s.n.speed)
        ),
    )
}

/// A march to a steady state is another question than a motion in time.
pub fn steady(_: &Scope<'_>) -> Assessment {
    Assessment::not("a numerical method, not physics: a shape held still in a steady stream without shedding")
}
