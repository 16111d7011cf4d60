//! The one table of effects, as data.

use case::{Cloth, Integration, Permeability, Role, Scene, StageKind, Turbulence};

use super::criteria::{self as c, any_stage};
use super::estimate::{Assessment, Scope};
use super::wind::remove_gusts;

/// An effect: what a scene may ask for.
pub struct Entry {
    /// Dotted key in the scene; the name at the handshake.
    pub key: &'static str,
    /// One line for people.
    pub what: &'static str,
    /// How it is modelled, and where it is off what stands in its place.
    pub model: &'static str,
    /// Its equation.
    pub equation: &'static str,
    /// Where the model comes from.
    pub reference: &'static str,
    /// Programs whose work it changes.
    pub programs: &'static [&'static str],
    /// The program that must announce it; `None`: the coupler's own, or no physics that a
    /// replaced program could lack.
    pub announced_by: Option<Role>,
    /// How its change of the answer is estimated, with the factor that is promised.
    pub criterion: &'static str,
    /// Whether a scene asks for it.
    pub on: fn(&Scene) -> bool,
    /// What it changes in the answer of a scene.
    pub assess: fn(&Scope<'_>) -> Assessment,
    /// What it costs: counts and shares of time as measured on `square-drop` (docs/reference/effects.md), or
    /// by what the programs do more.
    pub cost: &'static str,
    /// Key of the effect without which it cannot be: both are judged together.
    pub needs: Option<&'static str>,
    /// The scene without it, where that is still a scene.
    pub without: Option<fn(&mut Scene)>,
    /// The scene with it and its defaults, where it has some that make sense anywhere.
    pub with: Option<fn(&mut Scene)>,
}

const STRUCTURE: &[&str] = &["structure-solver"];
const FLOW: &[&str] = &["flow-solver"];

fn viscosity(s: &Scene) -> Option<&case::Viscosity> {
    s.viscosity()
}

fn turbulence(s: &Scene) -> Option<Turbulence> {
    viscosity(s).and_then(|v| v.turbulence)
}

fn clear_retardation(s: &mut Scene) {
    s.fabric.retardation_time_s = 0.0;
    s.lines.iter_mut().for_each(|l| l.retardation_time_s = 0.0);
    s.risers.iter_mut().for_each(|r| r.retardation_time_s = 0.0);
    let Some(t) = &mut s.tapes else { return };
    [&mut t.hem, &mut t.seams, &mut t.vents].into_iter().flatten().for_each(|t| t.retardation_time_s = 0.0);
    t.grid.iter_mut().for_each(|g| g.retardation_time_s = 0.0);
}

fn laminar(s: &mut Scene) {
    if let Some(v) = s.flow.as_mut().and_then(|f| f.viscosity.as_mut()) {
        (v.turbulence, v.wall_treatment) = (None, None);
    }
}

/// All effects.
pub const TABLE: &[Entry] = &[
    Entry {
        key: "fabric.wrinkling",
        what: "fabric carries no compression",
        model: "tension field: taut, wrinkled or slack by a mixed criterion; off: fabric carries compression",
        equation: "S = C (E + E_w), E_w >= 0 along the direction in which S would be negative",
        reference: "Lu, Accorsi and Leonard, Int. J. Numer. Meth. Eng. 50 (2001)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "folds of a cell's size l take (1 - 2/pi) l / R of the area; within a factor of 5",
        on: |s| s.fabric.wrinkling,
        assess: c::wrinkling,
        cost: "Newton steps of the structure 0.8 times (without it folds remain that the grid hardly follows)",
        needs: None,
        without: Some(|s| s.fabric.wrinkling = false),
        with: Some(|s| s.fabric.wrinkling = true),
    },
    Entry {
        key: "fabric.orthotropic",
        what: "different stiffness along warp and weft",
        model: "orthotropic St. Venant-Kirchhoff in plane stress, with its own tension field",
        equation: "S = C(E_1, E_2, nu_12, G) E in the axes of the warp",
        reference: "Reddy, Mechanics of Laminated Composite Plates and Shells (2004), section 2.4",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "strain times (|E_1/E_2 - 1| + |G_0/G - 1| / 2) of the area; within a factor of 5",
        on: |s| s.fabric.orthotropic.is_some(),
        assess: c::orthotropic,
        cost: "none that is measurable: another law in the same loop",
        needs: None,
        without: Some(|s| s.fabric.orthotropic = None),
        with: None,
    },
    Entry {
        key: "fabric.law",
        what: "a film that is no longer linear at large strain",
        model: "incompressible neo-Hookean film in plane stress, with its own tension field; off: St. Venant-Kirchhoff",
        equation: "S = mu (I - C^-1 / det C), C = I + 2 E, mu = E_0 / 3",
        reference: "Holzapfel, Nonlinear Solid Mechanics (2000), section 6.5; Steigmann, Proc. R. Soc. A 429 (1990)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "5 times the squared strain of the area; within a factor of 5",
        on: |s| s.fabric.law != case::Law::StVenantKirchhoff,
        assess: c::law,
        cost: "none that is measurable: another law in the same loop",
        needs: None,
        without: Some(|s| s.fabric.law = case::Law::StVenantKirchhoff),
        with: None,
    },
    Entry {
        key: "fabric.prestress_pa",
        what: "fabric stretched in its cut shape",
        model: "the law of the fabric about the strain that the prestress needs; off: unstressed cut shape",
        equation: "S = C (E + E_0), C E_0 = sigma_0 I",
        reference: "superposed strain, as of a prestressed line (lines.prestress_pa)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "-2 sigma_0 (1 - nu) / E of the area; within a factor of 5",
        on: |s| s.fabric.prestress_pa > 0.0,
        assess: c::prestress,
        cost: "none that is measurable",
        needs: None,
        without: Some(|s| s.fabric.prestress_pa = 0.0),
        with: None,
    },
    Entry {
        key: "fabric.bending_stiffness_n_m",
        what: "fabric resists bending",
        model: "curvature of each triangle from the jumps of slope at its three sides, without rotations; flat as cut; off: fabric bends freely",
        equation: "W = D K:K / 2 for each area, K = sum_i l_i n_i n_i v_i / (2 A), v_i: jump of the slope across side i",
        reference: "Onate and Zarate, Int. J. Numer. Meth. Eng. 47 (2000); Bergou, Wardetzky, Harmon, Zorin and Grinspun, Symposium on \
                    Geometry Processing (2006)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "folds of width l = 2 sqrt(pi) (D / T)^(1/4) R^(1/2) take (1 - 2/pi) l / R of the area; within a factor of 5",
        on: |s| s.fabric.bending_stiffness_n_m.is_some(),
        assess: c::bending,
        cost: "processor time of the structure 2.1 times, implicit and explicit (ATPS, 24 cells across)",
        needs: None,
        without: Some(|s| s.fabric.bending_stiffness_n_m = None),
        with: None,
    },
    Entry {
        key: "fabric.contact",
        what: "fabric does not pass through itself",
        model: "penalty of nodes against faces and of free edges and ridges against each other, pairs by hashes of boxes; off: fabric passes \
                through fabric",
        equation: "f = k (h - s n.(P - Q)) s n on the one side, -f on the other",
        reference: "Wriggers, Computational Contact Mechanics (2006), chapter 5; nearly parallel edges: Li et al., ACM Transactions on \
                    Graphics 39 (2020), section 5",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: where folds touch is known after a run only",
        on: |s| s.fabric.contact.is_some(),
        assess: c::contact,
        cost: "a search of pairs in each structure step; on several ranks all positions on each of them",
        needs: None,
        without: Some(|s| s.fabric.contact = None),
        with: None,
    },
    Entry {
        key: "fabric.contact.friction",
        what: "layers of fabric in contact resist sliding",
        model: "a tangential spring of the stiffness of the contact that slips at the limit; off: layers slide freely",
        equation: "t = -k e, |t| <= mu N",
        reference: "Wriggers, Computational Contact Mechanics (2006), sections 5.2 and 10.5",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: how far layers slide on each other is known after a run only",
        on: |s| s.fabric.contact.as_ref().is_some_and(|c| c.friction.is_some()),
        assess: c::contact_friction,
        cost: "a pass over the pairs in contact in each structure step",
        needs: Some("fabric.contact"),
        without: Some(|s| {
            if let Some(c) = &mut s.fabric.contact {
                c.friction = None;
            }
        }),
        with: None,
    },
    Entry {
        key: "lines",
        what: "suspension lines and risers",
        model: "2-node cables of Green strain, tension only unless `tension_only = false`",
        equation: "N = A Y E l/L for E > 0, E = (l^2 - L^2) / (2 L^2)",
        reference: "the paper, equation 4",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what is built",
        on: |s| s.has_cables(),
        assess: c::lines,
        cost: "their elements in the structure",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "lines.hysteresis",
        what: "lines and risers return less work than it took to stretch them",
        model: "a slider in parallel with the elastic line, whose limit grows with the tension; no rate; off: no loop",
        equation: "S = Y_e E + S_f, dS_f = 2 Y_e dE while |S_f| <= mu Y_e E, Y_e = Y / (1 + mu)",
        reference: "Iwan, Journal of Applied Mechanics 33 (1966) 893-900; derivation in structure-solver/src/elements/hysteresis.rs",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: damps oscillations and the recoil after the largest load, not a steady tension",
        on: Scene::has_hysteresis,
        assess: c::hysteresis,
        cost: "a second loop over lines and risers",
        needs: Some("lines"),
        without: Some(|s| {
            if let Some(l) = &mut s.lines {
                l.hysteresis = None;
            }
            if let Some(r) = &mut s.risers {
                r.hysteresis = None;
            }
        }),
        with: Some(|s| {
            if let Some(l) = &mut s.lines {
                l.hysteresis = Some(0.3);
            }
        }),
    },
    Entry {
        key: "fabric.hysteresis",
        what: "the fabric returns less work than it took to stretch it",
        model: "a slider in parallel with the elastic law, by the root of the elastic energy, whose limit grows with it; no rate; any law; off: no state in an element",
        equation: "S = (1 + s / q) S_e, q = (2 W)^1/2, ds = 2 dq while |s| <= mu q, S_e of the moduli over 1 + mu",
        reference: "Ogden and Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861-2877; derivation in structure-solver/src/materials/hysteretic.rs",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: damps oscillations and the recoil after the largest load, not a steady force",
        on: Scene::has_fabric_hysteresis,
        assess: c::fabric_hysteresis,
        cost: "the structure takes 1.3 times as long with implicit steps and twice as long with explicit ones, which are 0.64 times as long at a loss of 30 %",
        needs: None,
        without: Some(|s| s.fabric.hysteresis = None),
        with: Some(|s| s.fabric.hysteresis = Some(0.3)),
    },
    Entry {
        key: "fabric.retardation_time_s",
        what: "stresses by the rate of strains in a material: fabric, lines, risers, tapes",
        model: "Kelvin-Voigt with one retardation time for each material, with any time integration; off: no loop",
        equation: "S_v = tau (S(E_1) - S(E_0)) / dt",
        reference: "Ferry, Viscoelastic Properties of Polymers (1980), chapter 3; derivation in structure-solver/src/materials/viscous.rs",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: damps oscillations, not the mean",
        on: |s| s.retardation_time_s() > 0.0,
        assess: c::retardation,
        cost: "a second loop over the elements of the material; explicit steps shrink to sqrt(tau^2 + h^2) - tau",
        needs: None,
        without: Some(clear_retardation),
        with: Some(|s| s.fabric.retardation_time_s = 1e-5),
    },
    Entry {
        key: "lines.drag",
        what: "drag of the air on lines",
        model: "each segment a cylinder in cross flow, in the air of the far field; off: no loop, no array",
        equation: "F/L = 1/2 rho d (C |w_n| w_n + pi C_f |w_t| w_t)",
        reference: "Hoerner, Fluid-Dynamic Drag (1965), chapter 3",
        programs: &["structure-solver", "coupler"],
        announced_by: Some(Role::Structure),
        criterion: "C d L sin^3(slant) relative to the drag area, half of it through the lines, twice of it from the canopy's; within a factor of 5",
        on: |s| s.line_drag().is_some(),
        assess: c::line_drag,
        cost: "none that is measurable",
        needs: None,
        without: Some(|s| {
            if let Some(l) = &mut s.lines {
                l.drag = None;
            }
        }),
        with: Some(|s| {
            if let Some(l) = &mut s.lines {
                l.drag = Some(case::LineDrag::default());
            }
        }),
    },
    Entry {
        key: "reefing",
        what: "reefing line with timed release",
        model: "closed tension-only line where suspension lines are attached, drawn in, cut at a time; off or cut: no loop",
        equation: "N = A Y E l/L(t) for E > 0, times 1 - (t - t_cut) / ramp after the cut",
        reference: "Knacke, Parachute Recovery Systems Design Manual (1992), section 5.6",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "drag area times (reefing ratio / (2/pi))^1.5; within a factor of 3",
        on: |s| !s.reefing.is_empty(),
        assess: c::reefing,
        cost: "none that is measurable; stiff closed line: some more Newton steps",
        needs: None,
        without: Some(|s| s.reefing.clear()),
        with: None,
    },
    Entry {
        key: "risers",
        what: "risers with a section of their own",
        model: "cables of their axial stiffness and mass; off: the section of [lines]",
        equation: "as lines",
        reference: "the paper, equation 4",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what is built",
        on: |s| s.risers.is_some(),
        assess: c::risers,
        cost: "none that is measurable: another section in the same loop",
        needs: None,
        without: Some(|s| s.risers = None),
        with: None,
    },
    Entry {
        key: "canopy.cable",
        what: "cables of a mesh file by groups: sections, unstretched lengths, pretensions",
        model: "cables of their own axial stiffness, mass and length; off: curves in `lines`, `risers` and `reinforcements` alone",
        equation: "as lines, S = EA (E + N_0 / EA) with the pretension N_0",
        reference: "the paper, equation 4",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what is built",
        on: |s| !s.cable_groups().is_empty(),
        assess: c::cable_groups,
        cost: "none that is measurable: another section in the same loop",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "canopy.fabric",
        what: "cloths of a mesh file by groups: thickness, density, moduli, strength",
        model: "membranes of their own thickness, density, moduli and strength; off: all fabric is [fabric]",
        equation: "as the fabric",
        reference: "the paper, equation 3",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what is built",
        on: |s| !s.fabric_groups().is_empty(),
        assess: c::fabric_groups,
        cost: "none that is measurable: another cloth in the same loop",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "tapes",
        what: "tapes on the fabric by place: hem, seams, vents, grid",
        model: "cables of their own axial stiffness and mass that share canopy nodes; off: fabric alone",
        equation: "as lines, EA and mass times the number of tapes for which an element stands",
        reference: "the paper, section 5.1 (its count of elements)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "-2 strain r / (1 + r) of the area, r = sum of EA times length of tape over 2 E t times the fabric area; within a factor of 5",
        on: |s| s.tapes.is_some(),
        assess: c::tapes,
        cost: "more elements and a stiffer structure: time of explicit steps 2 to 3 times (1170 m on the ATPS)",
        needs: None,
        without: Some(|s| s.tapes = None),
        with: None,
    },
    Entry {
        key: "canopy.reinforcements",
        what: "former form of tapes: line elements along seams and edges",
        model: "cables of [lines] that share canopy nodes",
        equation: "as lines",
        reference: "the paper, section 5.1 (its count of elements)",
        programs: STRUCTURE,
        announced_by: None,
        criterion: "-2 strain r / (1 + r) of the area, r = A Y of the tape over E t times a cell; within a factor of 5",
        on: |s| matches!(&s.canopy, case::Canopy::Atps(a) if a.reinforcements),
        assess: c::reinforcements,
        cost: "more elements and a stiffer structure",
        needs: None,
        without: Some(|s| {
            if let case::Canopy::Atps(a) = &mut s.canopy {
                a.reinforcements = false;
                a.reinforcement_spacing_cells = 0;
            }
        }),
        with: None,
    },
    Entry {
        key: "fabric_gravity",
        what: "weight and inertia of fabric and lines in the falling frame",
        model: "body force on the mass matrix; off: fabric and lines weigh in the descent alone",
        equation: "f = -M (g e_z + a_frame)",
        reference: "the paper, equation 1",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "half the areal weight over the pressure from the drag area, its mass from the lines; within a factor of 5",
        on: |s| s.fabric_gravity.is_some(),
        assess: c::fabric_gravity,
        cost: "none that is measurable",
        needs: None,
        without: Some(|s| s.fabric_gravity = None),
        with: Some(|s| s.fabric_gravity = Some(case::FabricGravity {})),
    },
    Entry {
        key: "point_mass",
        what: "masses on nodes",
        model: "on the diagonal of the mass matrix",
        equation: "M_ii += m",
        reference: "-",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what the scene prescribes",
        on: |s| !s.point_masses.is_empty(),
        assess: c::prescribed,
        cost: "none",
        needs: None,
        without: Some(|s| s.point_masses.clear()),
        with: None,
    },
    Entry {
        key: "stage.mass_damping_per_s",
        what: "forces by the velocity in the falling frame",
        model: "mass-proportional damping: a numerical aid of stages without air",
        equation: "f = -c M v",
        reference: "Rayleigh damping; Belytschko, Liu and Moran, Nonlinear Finite Elements (2000)",
        programs: STRUCTURE,
        announced_by: None,
        criterion: "not assessed: acts on motion, not on the shape at rest",
        on: |s| any_stage(s, |g| g.mass_damping_per_s),
        assess: c::mass_damping,
        cost: "none",
        needs: None,
        without: Some(|s| s.stages.iter_mut().for_each(|g| g.mass_damping_per_s = 0.0)),
        with: None,
    },
    Entry {
        key: "stage.stiffness_damping_s",
        what: "stresses by the rate of strains, in fabric and lines",
        model: "Kelvin-Voigt with one retardation time for the whole structure, added to those of the materials",
        equation: "S_v = beta (S(E_1) - S(E_0)) / dt",
        reference: "Rayleigh damping; derivation in structure-solver/src/materials/viscous.rs",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: damps oscillations, not the mean",
        on: |s| any_stage(s, |g| g.stiffness_damping_s),
        assess: c::stiffness_damping,
        cost: "a second loop over the elements of the structure",
        needs: None,
        without: Some(|s| s.stages.iter_mut().for_each(|g| g.stiffness_damping_s = 0.0)),
        with: None,
    },
    Entry {
        key: "structure.integration",
        what: "explicit time integration of the structure",
        model: "central differences on a lumped mass, step by power iteration; off: implicit steps",
        equation: "v_1/2 = v_0 + h/2 a_0, u_1 = u_0 + h v_1/2, h < 2 / omega",
        reference: "Belytschko, Liu and Moran, Nonlinear Finite Elements (2000), section 6.2",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: a numerical method",
        on: |s| s.structure.integration == Integration::Explicit,
        assess: c::integration,
        cost: "many cheap steps for few Newton steps",
        needs: None,
        without: Some(|s| {
            s.structure.integration = Integration::default();
        }),
        with: None,
    },
    Entry {
        key: "stage.motion",
        what: "prescribed motions of nodes",
        model: "constrained components on a table in time",
        equation: "u(t) = u_0 + d(t)",
        reference: "-",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what the scene prescribes",
        on: |s| s.stages.iter().any(|g| !g.motions.is_empty() && g.kind.roles().contains(&Role::Structure)),
        assess: c::prescribed,
        cost: "none",
        needs: None,
        without: Some(|s| s.stages.iter_mut().for_each(|g| g.motions.clear())),
        with: None,
    },
    Entry {
        key: "stage.motion.rotation",
        what: "prescribed rotations of nodes",
        model: "constrained components on circles about an axis, before the displacement of the motion",
        equation: "x(t) = c + Q(angle(t)) (x_0 - c) + d(t)",
        reference: "Rodrigues' formula",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what the scene prescribes",
        on: |s| {
            let turns = |g: &case::Stage| g.motions.iter().any(|m| m.rotation.is_some());
            s.stages.iter().any(|g| turns(g) && g.kind.roles().contains(&Role::Structure))
        },
        assess: c::prescribed,
        cost: "none",
        needs: Some("stage.motion"),
        without: None,
        with: None,
    },
    Entry {
        key: "stage.force",
        what: "forces on nodes",
        model: "constant nodal forces",
        equation: "F_i += f",
        reference: "-",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "not assessed: part of what the scene prescribes",
        on: |s| s.stages.iter().any(|g| !g.forces.is_empty()),
        assess: c::prescribed,
        cost: "none",
        needs: None,
        without: Some(|s| s.stages.iter_mut().for_each(|g| g.forces.clear())),
        with: None,
    },
    Entry {
        key: "flow.viscosity",
        what: "viscosity, no slip on the canopy",
        model: "laminar stresses of a Newtonian gas; off: inviscid, slip on the canopy, no shear loads",
        equation: "tau = mu (grad v + grad v^T - 2/3 div v I)",
        reference: "the paper, section 2",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "friction 2 c_f 0.15 q A over the drag, times the share of the boundary layer that the grid has; within a factor of 5; judged with turbulence, which needs it",
        on: |s| viscosity(s).is_some(),
        assess: c::viscosity,
        cost: "time of the flow 1.1 times; a grid that resolves the boundary layer costs far more",
        needs: None,
        without: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.viscosity = None;
            }
        }),
        with: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.viscosity = Some(case::Viscosity::default());
            }
        }),
    },
    Entry {
        key: "flow.viscosity.turbulence",
        what: "model of the unresolved turbulence",
        model: "an eddy viscosity: smagorinsky or wale (sub-grid), or one of the models below; off: laminar",
        equation: "mu_t = rho (C Delta)^2 |S|, or WALE's invariant in its place",
        reference: "Smagorinsky, Mon. Weather Rev. 91 (1963); Nicoud and Ducros, Flow Turbul. Combust. 62 (1999)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "1 % of the drag area where Re > 300 and the smallest eddies L Re^-3/4 are below a cell; within a factor of 5",
        on: |s| turbulence(s).is_some(),
        assess: c::turbulence,
        cost: "none that is measurable beyond flow.viscosity",
        needs: Some("flow.viscosity"),
        without: Some(laminar),
        with: Some(|s| {
            if let Some(f) = &mut s.flow {
                let air = case::Viscosity::default();
                f.viscosity.get_or_insert(air).turbulence = Some(Turbulence::Smagorinsky);
            }
        }),
    },
    Entry {
        key: "flow.viscosity.turbulence.spalart-allmaras",
        what: "all turbulence by one transported eddy viscosity",
        model: "SA-neg, solved when a step is accepted",
        equation: "D nu~/Dt = P - D + (div((nu + nu~) grad nu~) + c_b2 |grad nu~|^2) / sigma",
        reference: "Spalart and Allmaras (1992); Allmaras, Johnson and Spalart, ICCFD7-1902 (2012)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "as flow.viscosity.turbulence",
        on: |s| turbulence(s) == Some(Turbulence::SpalartAllmaras),
        assess: c::turbulence,
        cost: "one more equation, solved once a window",
        needs: Some("flow.viscosity"),
        without: Some(laminar),
        with: None,
    },
    Entry {
        key: "flow.viscosity.turbulence.des",
        what: "turbulence modelled at walls, resolved away from them",
        model: "SA-neg with the length of DES97 or DDES",
        equation: "d~ = d - f_d max(0, d - C_DES Delta)",
        reference: "Spalart et al. (1997); Spalart et al., Theor. Comput. Fluid Dyn. 20 (2006)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "as flow.viscosity.turbulence",
        on: |s| matches!(turbulence(s), Some(Turbulence::Des97 | Turbulence::Ddes)),
        assess: c::turbulence,
        cost: "one more equation, solved once a window; a grid that resolves eddies",
        needs: Some("flow.viscosity"),
        without: Some(laminar),
        with: None,
    },
    Entry {
        key: "fabric.permeability",
        what: "air passes the fabric",
        model: "cloth in series with the air of the adjacent cells; off: airtight",
        equation: "dp = a v + b |v| v",
        reference: "Forchheimer's law; Payne, Aeronaut. Q. (1978); cloths with their sources in the schema",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "-2 v / U of the drag area, a v + b v^2 = pressure jump; within a factor of 3",
        on: case::Scene::has_permeable_fabric,
        assess: c::permeability,
        cost: "iterations of the flow 1.3 times, its time 1.2 times",
        needs: None,
        without: Some(case::Scene::make_airtight),
        with: Some(|s| {
            s.fabric.permeability =
                Some(Permeability { cloth: Some(Cloth::MilC7020Type3), ..Permeability::default() });
        }),
    },
    Entry {
        key: "canopy.fabric.permeability",
        what: "cloths of a mesh file by groups: what air passes each",
        model: "the coefficients of each face are those of its cloth; off: all fabric has [fabric.permeability]",
        equation: "as fabric.permeability",
        reference: "as fabric.permeability",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "not assessed: part of what is built",
        on: case::Scene::has_permeable_groups,
        assess: c::permeable_groups,
        cost: "none that is measurable beyond fabric.permeability",
        needs: Some("fabric.permeability"),
        without: None,
        with: None,
    },
    Entry {
        key: "flow.energy",
        what: "energy equation",
        model: "fifth equation for temperature; off: isothermal, four equations",
        equation: "d(rho H)/dt - dp/dt + div(rho v H) = div(k grad T + tau v)",
        reference: "Weiss and Smith, AIAA J. 33 (1995); the paper, section 2",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "(gamma - 1)/2 M^2 of the drag area; within a factor of 10",
        on: |s| s.flow.as_ref().is_some_and(|f| f.energy.is_some()),
        assess: c::energy,
        cost: "a fifth equation: time of the flow 1.0 to 1.2 times",
        needs: None,
        without: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.energy = None;
            }
        }),
        with: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.energy = Some(case::Energy {});
            }
        }),
    },
    Entry {
        key: "flow.limiter",
        what: "gradient limiter",
        model: "Venkatakrishnan's; off: unlimited, second order",
        equation: "q_f = q + psi grad q . r",
        reference: "Venkatakrishnan, J. Comput. Phys. 118 (1995)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "not assessed: a numerical method",
        on: |s| s.flow.as_ref().is_some_and(|f| f.limiter.is_some()),
        assess: c::limiter,
        cost: "time of the flow 2.2 times",
        needs: None,
        without: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.limiter = None;
            }
        }),
        with: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.limiter = Some(case::Limiter::default());
            }
        }),
    },
    Entry {
        key: "flow.gust",
        what: "gust",
        model: "all air accelerates equally: a pulse, pulses that repeat, a ramp, a sine, a table over time, or Dryden turbulence",
        equation: "w(t) = w_0 + G f(t); f = (1 - cos(2 pi t / T)) / 2 of a pulse, (1 - cos(pi t / T)) / 2 of a ramp, sin(2 pi t / T); of turbulence the sum of cosines a_k cos(omega_k t + phi_k)",
        reference: "one-minus-cosine gust: CS-25.341; turbulence: MIL-F-8785C, section 3.7",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "the fall in air with and without the gust; within a factor of 3",
        on: case::Scene::has_gust,
        assess: c::gust,
        cost: "none",
        needs: None,
        without: Some(remove_gusts),
        with: None,
    },
    Entry {
        key: "stage.perturbation",
        what: "pulse of wind across the stream that takes the wake out of its symmetric state",
        model: "all air accelerates equally, in a direction that a seed chooses; off: a symmetric wake stays symmetric until \
                round-off has grown, over 30 to 60 diameters of the stream",
        equation: "w(t) = w_0 + s U d (1 - cos(2 pi t / T)) / 2, d across the stream, T = D / U",
        reference: "shape: CS-25.341; hash of the seed: Steele, Lea and Flood, OOPSLA (2014)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "not assessed: chooses between states of the wake; a symmetric one has a drag up to a third lower",
        on: case::Scene::has_perturbation,
        assess: c::perturbation,
        cost: "none",
        needs: None,
        without: Some(|s| s.stages.iter_mut().for_each(|g| g.perturbation = None)),
        with: None,
    },
    Entry {
        key: "flow.shear",
        what: "wind by height",
        model: "far field face by face: power, logarithmic or linear law, or a table",
        equation: "w(z) = w_ref (z / z_ref)^n, or ln(z / z_0) / ln(z_ref / z_0)",
        reference: "Stull, An Introduction to Boundary Layer Meteorology (1988), chapter 9",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "the fall through the profile and through the wind of the reference height; within a factor of 5",
        on: |s| s.shear().is_some(),
        assess: c::shear,
        cost: "none that is measurable",
        needs: None,
        without: Some(|s| {
            if let Some(f) = &mut s.flow {
                f.shear = None;
            }
        }),
        with: None,
    },
    Entry {
        key: "stage.steady",
        what: "march to a steady flow",
        model: "implicit Euler steps that grow; off: in time",
        equation: "V (q_1 - q_0) / dt + R(q_1) = 0, dt doubled",
        reference: "Mulder and van Leer, J. Comput. Phys. 59 (1985)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "not assessed: a numerical method",
        on: |s| s.stages.iter().any(|g| g.steady.is_some()),
        assess: c::steady,
        cost: "steps of the march instead of windows",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "flow.immersed",
        what: "canopy that moves through a Cartesian grid",
        model: "no flow through the fabric as a constraint on the faces that it cuts; off: a grid fitted to the canopy",
        equation: "D u = 0, C u = b + r phi, u = u* - dt/rho (G p + C^T phi)",
        reference: "Taira and Colonius, J. Comput. Phys. 225 (2007)",
        programs: FLOW,
        announced_by: Some(Role::Flow),
        criterion: "not assessed: a numerical method",
        on: |s| s.flow.as_ref().is_some_and(case::Flow::is_immersed),
        assess: c::immersed,
        cost: "about 0.1 us a cell and step instead of 2 us a cell and solve; no mesh-mover",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "mesh",
        what: "grid that moves with the canopy",
        model: "pseudo-elastic grid; off: no mesh-mover is started, the grid rests",
        equation: "div sigma(u) = 0, stiffness by J^-chi",
        reference: "Stein, Tezduyar and Benney, J. Appl. Mech. 70 (2003); the paper, section 3",
        programs: &["mesh-mover", "flow-solver"],
        announced_by: None,
        criterion: "not assessed: how far the canopy moves is known after a run only",
        on: |s| s.stages.iter().any(|g| s.roles(g).contains(&Role::Mesh)),
        assess: c::moving_grid,
        cost: "the mesh-mover: some per cent to a half of the time",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "descent.payload_drag",
        what: "drag of the air on the payload",
        model: "a drag area in the descent equation, or on the body where the payload is one",
        equation: "F = 1/2 rho (C A) |w| w",
        reference: "Hoerner, Fluid-Dynamic Drag (1965)",
        programs: &["coupler"],
        announced_by: None,
        criterion: "drag area of the payload (a cube of its mass at 500 kg/m3 where none is given) relative to the canopy's; within a factor of 3",
        on: |s| s.payload_drag().is_some(),
        assess: c::payload_drag,
        cost: "none",
        needs: None,
        without: Some(|s| {
            if let Some(d) = &mut s.descent {
                d.payload_drag = None;
            }
        }),
        with: Some(|s| {
            if let Some(d) = &mut s.descent {
                let drag_area_m2 = c::typical_drag_area(d.payload_mass_kg);
                d.payload_drag = Some(case::PayloadDrag { drag_area_m2 });
            }
        }),
    },
    Entry {
        key: "descent.body",
        what: "payload of six degrees of freedom on its lines, in the falling frame",
        model: "rigid body by velocity Verlet with exact turns, attachments move with it; off: a point that falls with the frame",
        equation: "m dv/dt = sum f + m (g - a_frame), dL/dt = sum r x f",
        reference: "Dullweber, Leimkuhler and McLachlan, J. Chem. Phys. 107 (1997); Hughes and Liu, J. Appl. Mech. 45 (1978)",
        programs: STRUCTURE,
        announced_by: Some(Role::Structure),
        criterion: "phi^2 / 2 of drag and line force, phi the angle to which wind or a first velocity swings the payload; within a factor of 10",
        on: |s| s.payload_body().is_some(),
        assess: c::body,
        cost: "none that is measurable; coupling iterations may rise",
        needs: Some("fabric_gravity"),
        without: Some(|s| {
            if let Some(d) = &mut s.descent {
                d.body = None;
            }
        }),
        with: None,
    },
    Entry {
        key: "descent.motion",
        what: "frame that follows the payload in all directions",
        model: "momentum of the system in three axes, solved with the coupling; off: the frame falls along one axis",
        equation: "m dv/dt = R + D + m g",
        reference: "-",
        programs: &["coupler", "structure-solver"],
        announced_by: Some(Role::Structure),
        criterion: "not assessed: a condition on the payload",
        on: Scene::frame_drifts,
        assess: c::frame_motion,
        cost: "two unknowns more in the coupling",
        needs: None,
        without: Some(|s| {
            if let Some(d) = &mut s.descent {
                d.motion = Some(case::FrameMotion::Vertical);
                d.initial_drift_m_s = [0.0; 2];
            }
        }),
        with: Some(|s| {
            if let Some(d) = &mut s.descent {
                d.motion = Some(case::FrameMotion::ThreeDimensional);
            }
        }),
    },
    Entry {
        key: "stage.prescribed",
        what: "canopy that moves as prescribed in the flow",
        model: "a stage of kind `prescribed`: mesh-mover and flow-solver alone, no structure is started",
        equation: "x(t) = x_0 + d(t), d from [[stage.motion]]; x(t) = R(t) x_0 + d(t) of [[stage.body_motion]]",
        reference: "-",
        programs: &["mesh-mover", "flow-solver", "coupler"],
        announced_by: None,
        criterion: "not assessed: part of what the scene prescribes",
        on: |s| s.stages.iter().any(|g| g.kind == StageKind::Prescribed),
        assess: c::prescribed,
        cost: "no structure",
        needs: None,
        without: None,
        with: None,
    },
    Entry {
        key: "descent",
        what: "the frame falls by one degree of freedom",
        model: "momentum of payload, fabric and lines over a window; off: no frame falls; `quasi-steady`: the paper's equation",
        equation: "m dv/dt = R - m g, R the mean force of the lines on the payload; quasi-steady: that of the air, F_z",
        reference: "the paper, equation 9 (quasi-steady)",
        programs: &["coupler", "structure-solver"],
        announced_by: None,
        criterion: "not assessed: part of what is simulated",
        on: |s| s.descent.is_some() && s.stages.iter().any(|g| g.kind == StageKind::Coupled),
        assess: c::descent,
        cost: "one unknown more in the coupling",
        needs: None,
        without: None,
        with: None,
    },
];

/// The entry of a key.
pub fn entry(key: &str) -> Option<&'static Entry> {
    TABLE.iter().find(|e| e.key == key)
}
