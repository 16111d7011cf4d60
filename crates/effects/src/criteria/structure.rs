//! Effects of the structure.

use std::f64::consts::PI;

use case::{Role, StageKind};

use super::unsigned;
use crate::estimate::{Assessment, Scope, percent};
use crate::fall::Influence;

/// Slack of the hoop of a flat disc that is drawn into a half sphere: $`1 - 2/\pi`$.
const HOOP_SLACK: f64 = 1.0 - 2.0 / PI;

/// Fabric folds where it is pushed together. Without the tension field each cell carries compression up to
/// plate buckling, $`\pi^2 E t^3 / (12 (1 - \nu^2) l^2)`$ (Timoshenko and Gere, Theory of Elastic Stability, 1961,
/// section 9.2), far more than the pressure can give ($`p R`$); the slack of the hoop then lies in folds of the size
/// of a cell, which take the share $`s\, l / R`$ from the canopy's area with the slack $`s = 1 - 2/\pi`$ of a flat
/// disc that becomes a half sphere. Within a factor of 5.
pub fn wrinkling(s: &Scope<'_>) -> Assessment {
    let (n, f) = (s.n, &s.scene().fabric);
    if n.pressure <= 0.0 {
        return Assessment::not("no pressure is given that would fold the fabric");
    }
    let buckling = PI.powi(2) * f.youngs_modulus_pa * f.thickness_m.powi(3)
        / (12.0 * (1.0 - f.poisson_ratio.powi(2)) * n.cell * n.cell);
    let ratio = buckling / (n.pressure * 0.5 * n.width);
    let folds = HOOP_SLACK * n.cell / (0.5 * n.width) * (1.0 - ratio.min(1.0));
    s.of(
        &Influence::of_canopy(folds),
        &unsigned(5.0),
        format!(
            "a cell of {:.2} m buckles at {} of the tension p R; folds of that size take {} of the area",
            n.cell,
            percent(ratio),
            percent(folds)
        ),
    )
}

/// A weft that is weaker than the warp stretches more: the area changes by the difference of the strains
/// $`\varepsilon\, |E_1/E_2 - 1|`$ in one direction, and by $`\tfrac12 \varepsilon\, |G_0/G - 1|`$ in shear, with the
/// membrane strain $`\varepsilon = p R / (2 E t)`$ of a sphere and $`G_0 = E / (2 (1 + \nu))`$ (Reddy, Mechanics of
/// Laminated Composite Plates and Shells, 2004, section 2.4). Within a factor of 5.
pub fn orthotropic(s: &Scope<'_>) -> Assessment {
    let (n, f) = (s.n, &s.scene().fabric);
    let Some(o) = &f.orthotropic else {
        return Assessment::not(format!(
            "the modulus along the weft is not known; the strain is about {}",
            percent(n.strain)
        ));
    };
    let weft = (f.youngs_modulus_pa / o.youngs_modulus_2_pa - 1.0).abs();
    let shear = (f.youngs_modulus_pa / (2.0 * (1.0 + f.poisson_ratio)) / o.shear_modulus_pa - 1.0).abs();
    let area = n.strain * (weft + 0.5 * shear);
    s.of(
        &Influence::of_canopy(area),
        &unsigned(5.0),
        format!(
            "compliances differ by {} (weft) and {} (shear) at a strain of {}",
            percent(weft),
            percent(shear),
            percent(n.strain)
        ),
    )
}

/// Pulled by the strain $`e`$, a neo-Hookean film carries
/// $`S = \mu (1 - (1 + 2 e)^{-3/2}) \approx E e (1 - \tfrac52 e)`$: for the same stress it stretches by
/// $`\tfrac52 e^2`$ more than a linear one, and its area by twice that. Within a factor of 5.
pub fn law(s: &Scope<'_>) -> Assessment {
    if s.scene().fabric.law == case::Law::StVenantKirchhoff {
        return Assessment::not(
            "woven fabric is linear at its strains; a film of rubber is for the scene to say",
        );
    }
    let strain = s.n.strain;
    s.of(
        &Influence::of_canopy(5.0 * strain * strain),
        &unsigned(5.0),
        format!("the modulus falls by {} at a strain of {}", percent(2.5 * strain), percent(strain)),
    )
}

/// Fabric stretched by $`\sigma_0`$ in its cut shape is shorter by the strain $`\sigma_0 (1 - \nu) / E`$ both ways once
/// it is free: the area falls by twice that (plane stress, equal in all directions). Within a factor of 5.
pub fn prestress(s: &Scope<'_>) -> Assessment {
    let f = &s.scene().fabric;
    if f.prestress_pa <= 0.0 {
        return Assessment::not(
            "a canopy is cut without tension; how far a panel is stretched is for the scene to say",
        );
    }
    let strain = f.prestress_pa * (1.0 - f.poisson_ratio) / f.youngs_modulus_pa;
    s.of(
        &Influence::of_canopy(-2.0 * strain),
        &unsigned(5.0),
        format!("strain of {} both ways in the cut shape", percent(strain)),
    )
}

/// Bending stiffness of light nylon cloth, N m (Kawabata's test: 0.01 to 0.1 gf cm2/cm).
const LIGHT_CLOTH: f64 = 1e-5;

/// Fabric under the tension $`T = p R`$ with the bending stiffness D folds with the wavelength
/// $`l = 2 \sqrt{\pi}\,(D/T)^{1/4} R^{1/2}`$ over a length R (Cerda and Mahadevan, Phys. Rev. Lett. 90, 2003), not as finely as a tension
/// field does; as in `wrinkling` folds of that size take the share $`(1 - 2/\pi)\, l / R`$ of the area. Within a factor of 5.
pub fn bending(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    if n.pressure <= 0.0 {
        return Assessment::not("no pressure is given that would fold the fabric");
    }
    let radius = 0.5 * n.width;
    let folds = |stiffness: f64| 2.0 * (PI * radius).sqrt() * (stiffness / (n.pressure * radius)).powf(0.25);
    let Some(stiffness) = s.scene().fabric.bending_stiffness_n_m else {
        let width = folds(LIGHT_CLOTH);
        return Assessment::not(format!(
            "the bending stiffness is not given; light cloth ({LIGHT_CLOTH:.0e} N m) folds with a wavelength of {width:.3} m"
        ));
    };
    let width = folds(stiffness);
    let resolved = if width < 2.0 * n.cell { "too fine for" } else { "resolved by" };
    s.of(
        &Influence::of_canopy(HOOP_SLACK * width / radius),
        &unsigned(5.0),
        format!("folds have a wavelength of {width:.3} m, {resolved} cells of {:.3} m", n.cell),
    )
}

/// Contact acts where the fabric folds upon itself, which the scene alone does not say.
pub fn contact(s: &Scope<'_>) -> Assessment {
    let skirt = PI * s.n.width;
    Assessment::not(match s.scene().reefing.iter().map(|r| r.length_m).reduce(f64::min) {
        Some(length) if length < skirt => format!(
            "where folds touch is not known before the run; {} of the skirt is slack while it is reefed",
            percent(1.0 - length / skirt)
        ),
        _ => "where folds touch is not known before the run; an open, inflated canopy does not touch itself"
            .into(),
    })
}

/// Friction acts where layers slide on each other, which the scene alone does not say.
pub fn contact_friction(_: &Scope<'_>) -> Assessment {
    Assessment::not("where layers touch and slide on each other is not known before the run")
}

/// Lines are part of what is built.
pub fn lines(s: &Scope<'_>) -> Assessment {
    Assessment::not(if s.n.line_length > 0.0 {
        format!("part of what is built: {:.0} m of lines of {:.3} kg", s.n.line_length, s.n.line_mass)
    } else {
        "part of what is built: this canopy has none".into()
    })
}

/// A line through the skirt of length $`L_r`$ holds the mouth to the diameter $`L_r / \pi`$. The drag area of a reefed
/// canopy falls about with the reefing ratio $`L_r / (\pi D_0)`$ over $`2/\pi`$ of the free skirt, to the power 1.5
/// (curves of Knacke 1992, section 5.6). Within a factor of 3.
pub fn reefing(s: &Scope<'_>) -> Assessment {
    let scene = s.scene();
    let holds = |r: &&case::Reefing| match &r.release_stage {
        None => true,
        Some(name) => match scene.stages.iter().position(|g| &g.name == name) {
            Some(at) if at == s.stage => r.release_s >= s.fall.time,
            at => at.is_some_and(|at| at > s.stage),
        },
    };
    if scene.reefing.is_empty() {
        return Assessment::not("the canopy opens at once, as the scene says");
    }
    let Some(length) = scene.reefing.iter().filter(holds).map(|r| r.length_m).reduce(f64::min) else {
        return Assessment::not(
            "the reefing line is cut before the answer is taken: it changes the way to it",
        );
    };
    let nominal = (4.0 * s.n.fabric_area / PI).sqrt();
    let ratio = length / (PI * nominal) / (2.0 / PI);
    let area = ratio.min(1.0).powf(1.5);
    s.of(
        &Influence::of_canopy(area - 1.0),
        &unsigned(3.0),
        format!("{length:.2} m in the skirt: drag area of {} of the free canopy", percent(area)),
    )
}

/// A tape with the stiffness of the lines, parallel to one cell width of fabric: the strain falls from $`\varepsilon`$
/// to $`\varepsilon / (1 + r)`$ with $`r = A Y / (E t l)`$ along the tape, the area by twice the difference. Within a
/// factor of 5.
pub fn reinforcements(s: &Scope<'_>) -> Assessment {
    let (n, f) = (s.n, &s.scene().fabric);
    let case::Canopy::Atps(_) = &s.scene().canopy else {
        return Assessment::not("only the canopy of kind `atps` has seams that are modelled");
    };
    let Some(l) = &s.scene().lines else {
        return Assessment::not("the scene has no [lines] to give the stiffness of the tapes");
    };
    let ratio = l.youngs_modulus_pa * l.area_m2 / (f.youngs_modulus_pa * f.thickness_m * n.cell);
    let area = 2.0 * n.strain * ratio / (1.0 + ratio);
    s.of(
        &Influence::of_canopy(-area),
        &unsigned(5.0),
        format!(
            "a tape is {ratio:.1} times as stiff as a cell's width of fabric, whose strain is {}",
            percent(n.strain)
        ),
    )
}

/// Tapes of axial stiffness $`Y A`$ and length $`L`$, smeared over both directions of the fabric area $`S`$: the strain falls from
/// $`\varepsilon`$ to $`\varepsilon / (1 + r)`$ with $`r = \sum Y A L / (2 E t S)`$, the area by twice the difference. Within a
/// factor of 5.
pub fn tapes(s: &Scope<'_>) -> Assessment {
    let (n, f) = (s.n, &s.scene().fabric);
    if n.tape_stiffness == 0.0 {
        return Assessment::not("the scene has no [tapes]: their places and sections are the designer's");
    }
    let ratio = n.tape_stiffness / (2.0 * f.youngs_modulus_pa * f.thickness_m * n.fabric_area);
    let area = 2.0 * n.strain * ratio / (1.0 + ratio);
    s.of(
        &Influence::of_canopy(-area),
        &unsigned(5.0),
        format!(
            "smeared tapes are {ratio:.1} times as stiff as the fabric, whose strain is {}",
            percent(n.strain)
        ),
    )
}

/// Risers are part of what is built.
pub fn risers(_: &Scope<'_>) -> Assessment {
    Assessment::not("part of what is built: their length counts, their stretch is below that of the lines")
}

/// Cables of a mesh file are part of what is built.
pub fn cable_groups(_: &Scope<'_>) -> Assessment {
    Assessment::not(
        "part of what is built: sections and lengths of the cables of a mesh file are the designer's",
    )
}

/// Cloths of a mesh file are part of what is built.
pub fn fabric_groups(_: &Scope<'_>) -> Assessment {
    Assessment::not("part of what is built: the cloths of a mesh file are the designer's")
}

/// Fabric that weighs $`\rho t g`$ per area relieves the pressure jump $`p`$ by that share: the crown sinks, and the
/// drag area changes by about half of it; the lines no longer carry the weight of the fabric and of half of
/// themselves (the paper, equation 1). Without the effect all weight acts at the payload. Within a factor of 5.
pub fn fabric_gravity(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    if n.pressure <= 0.0 {
        return Assessment::not("no pressure is given to compare the weight of the fabric with");
    }
    let share = n.fabric_kg_m2 * n.gravity / n.pressure;
    let mass = n.fabric_mass + n.tape_mass + 0.5 * n.line_mass;
    let influence = Influence {
        canopy: -0.5 * share,
        on_canopy: if n.falling_mass > 0.0 { mass / n.falling_mass } else { 0.0 },
        ..Influence::default()
    };
    s.of(
        &influence,
        &unsigned(5.0),
        format!("the fabric weighs {} of the pressure of {:.1} Pa", percent(share), n.pressure),
    )
}

/// What the scene prescribes is part of the question.
pub fn prescribed(_: &Scope<'_>) -> Assessment {
    Assessment::not("part of what the scene prescribes")
}

/// Mass-proportional damping acts on motion, and vanishes where the fabric is at rest in the frame.
pub fn mass_damping(s: &Scope<'_>) -> Assessment {
    let n = s.n;
    let most = |coupled: bool| {
        let stages = s.scene().stages.iter().filter(|g| (g.kind == StageKind::Coupled) == coupled);
        stages.map(|g| g.mass_damping_per_s).fold(0.0, f64::max)
    };
    let coupled = most(true);
    Assessment::not(if coupled == 0.0 {
        format!(
            "acts on the way to the shape at rest, not on that shape ({}/s in stages without air)",
            most(false)
        )
    } else {
        let share = coupled * n.fabric_kg_m2 * 0.1 * n.speed / n.pressure;
        format!(
            "depends on the motion of the fabric: {coupled}/s at a tenth of the stream is {} of the pressure; it \
             stands for no physics in air",
            percent(share)
        )
    })
}

/// Hysteresis changes oscillations and the recoil after a peak; a tension that grows to its mean has the modulus of the line.
pub fn hysteresis(s: &Scope<'_>) -> Assessment {
    let of =
        [s.scene().lines.as_ref().and_then(|l| l.hysteresis), s.scene().risers.and_then(|r| r.hysteresis)];
    let share = of.into_iter().flatten().fold(0.0, f64::max);
    Assessment::not(if share > 0.0 {
        format!(
            "damps oscillations of the tension: a cycle from zero takes {} of the work of stretching",
            percent(share)
        )
    } else {
        "damps oscillations of the tension; the loss of the lines is not known".into()
    })
}

/// Hysteresis changes oscillations and the recoil after a peak; a membrane force that grows to its mean has the moduli of the fabric.
pub fn fabric_hysteresis(s: &Scope<'_>) -> Assessment {
    Assessment::not(match s.scene().fabric.hysteresis {
        Some(share) if share > 0.0 => format!(
            "damps oscillations of the fabric: a cycle from zero takes {} of the work of stretching",
            percent(share)
        ),
        _ => "damps oscillations of the fabric; its loss is not known".into(),
    })
}

/// Rates of strains damp oscillations, not the mean; the loss factor grows with the frequency.
pub fn retardation(s: &Scope<'_>) -> Assessment {
    let time = s.scene().retardation_time_s();
    if time == 0.0 {
        return Assessment::not(
            "damps oscillations, not the mean; the retardation times of the materials are not known",
        );
    }
    Assessment::not(format!(
        "damps oscillations, not the mean: loss factor {} at 10 Hz by the longest retardation time",
        percent(20.0 * PI * time)
    ))
}

/// Kelvin-Voigt damping changes oscillations and peaks, not a state at rest.
pub fn stiffness_damping(s: &Scope<'_>) -> Assessment {
    let f = &s.scene().fabric;
    let time = s.scene().stages.iter().map(|g| g.stiffness_damping_s).fold(0.0, f64::max);
    if time == 0.0 {
        return Assessment::not(
            "damps oscillations, not the mean; the relaxation time of the fabric is not known",
        );
    }
    let wave = (f.youngs_modulus_pa / f.density_kg_m3).sqrt() / s.n.width;
    let ratio = 0.5 * time * 2.0 * PI * wave;
    Assessment::not(format!(
        "damps oscillations, not the mean: {} of critical for the first wave in the fabric",
        percent(ratio)
    ))
}

/// How far the canopy moves in its frame is known after the run only.
pub fn moving_grid(s: &Scope<'_>) -> Assessment {
    let moves = s.scene().stages.iter().any(|g| s.scene().roles(g).contains(&Role::Mesh));
    Assessment::not(if moves {
        format!(
            "how far the canopy moves is not known before the run; cells at it are {:.3} m thick",
            s.n.first_layer
        )
    } else {
        "no stage moves the canopy in the flow".into()
    })
}

/// How the canopy and the grid meet is a matter of error and cost, not of physics.
pub fn immersed(s: &Scope<'_>) -> Assessment {
    let spacing = s.scene().flow.as_ref().and_then(|f| f.immersed.as_ref()).map(|g| g.spacing_m);
    Assessment::not(spacing.map_or("the grid is fitted to the canopy".into(), |spacing| {
        format!("a numerical method, not physics; {:.0} cells across the canopy", s.n.width / spacing)
    }))
}

/// The time integration is a matter of error and cost, not of physics.
pub fn integration(s: &Scope<'_>) -> Assessment {
    let f = &s.scene().fabric;
    let stable = match s.scene().has_fabric() {
        true => s.n.cell / (f.youngs_modulus_pa / f.density_kg_m3).sqrt(),
        false => s.n.cable_passage,
    };
    let steps =
        s.scene().stages.iter().filter(|g| g.window_s > 0.0).map(|g| g.window_s / f64::from(g.substeps));
    Assessment::not(format!(
        "a numerical method, not physics; about {:.1} stable steps in the longest substep (explicit steps pay below \
         some tens)",
        steps.fold(0.0, f64::max) / stable
    ))
}
