//! Checks during a run: what the programs watch while they compute.
//!
//! Rows only: each check stands in the program that `when` names, and its message names the check's
//! identifier or says the same in words.

use super::finding::Severity::{Error, Warning};
use super::table::{Check, When};

/// The rows, in the order of a window: structure, flow, mesh, coupling, whole run.
pub const CHECKS: &[Check] = &[
    Check {
        id: "structure.newton",
        what: "Newton's method converges in each structural step",
        estimate: "norm of the residual force over that of the applied load",
        range: "below structure.newton_tolerance after structure.newton_max_steps steps; the step is halved up to \
                structure.max_step_cuts times, then the window has no answer: an error once windows cannot be shorter",
        source: "the tolerance of the scene",
        severity: Error,
        remedy: "shorten window_s or raise substeps; the message names the element whose forces are the largest",
        when: When::During(&["structure-solver"]),
    },
    Check {
        id: "structure.convergence",
        what: "the accepted solve of the structure is converged",
        estimate: "largest residual of its steps relative to the load (RESIDUAL), over RESIDUAL_TARGET",
        range: "at most 1; up to 10 the window is accepted, counted and reported once a stage; above, it is rejected and \
                retried with half its length, then an error unless --accept-unconverged is given",
        source: "structure.newton_tolerance, static stages structure.static_tolerance; a step ends above it where its last \
                 correction is rounding of the positions",
        severity: Error,
        remedy: "raise substeps; where rounding allows no smaller residual, raise the tolerance",
        when: When::During(&["structure-solver", "coupler"]),
    },
    Check {
        id: "flow.convergence",
        what: "the accepted time step of the flow is converged",
        estimate: "residual of the unsteady equations at the end of the last solve of the window (RESIDUAL_END), over \
                   RESIDUAL_TARGET; all variables in one norm",
        range: "at most 1; up to 10 the window is accepted, counted and reported once a stage; above, it is rejected and \
                retried with half its length, then an error unless --accept-unconverged is given; a solve whose residual \
                has not halved is no answer",
        source: "flow.solver.residual_drop times the residual at the start of the step (a tenth of it on a moving grid), not \
                 below rounding; earlier solves of the coupling iterations may be loose and are only counted",
        severity: Error,
        remedy: "raise flow.solver.max_iterations, use flow.solver.method = \"gmres\", or shorten window_s",
        when: When::During(&["flow-solver", "coupler"]),
    },
    Check {
        id: "flow.turbulence-convergence",
        what: "the transport equation of the turbulence is converged in each accepted step",
        estimate: "residual of the equation in the step before (TURBULENCE_RESIDUAL), in units of its target",
        range: "at most 1; up to 10 it is counted and reported once a stage; above, an error unless --accept-unconverged is \
                given",
        source: "flow.solver.residual_drop times the residual at the start of the step, not below rounding",
        severity: Error,
        remedy: "shorten window_s, or raise flow.solver.residual_drop",
        when: When::During(&["flow-solver", "coupler"]),
    },
    Check {
        id: "flow.cells",
        what: "the flow of each single cell is converged in each accepted step, which the residual of all cells does not show",
        estimate: "largest change of the velocity of a cell that its residual would cause (CELL_ERROR): residual over the diagonal of its momentum \
                   equation, over the speed that most of the kinetic energy has",
        range: "at most 10 %; a solve continues until then; where its iterations end \
                above, up to 10 times are counted and reported once a stage; beyond, an error unless --accept-unconverged is given",
        source: "decision 90: around the ATPS on 4.75 million cells, single cells left unconverged ran away to 166 m/s while the residual of all \
                 cells was below its target",
        severity: Error,
        remedy: "a grid without thin or skewed cells there (grid.txt, flow.grid.cells_across_vent = 1), a shorter window_s, or a larger \
                 flow.solver.max_iterations",
        when: When::During(&["flow-solver", "coupler"]),
    },
    Check {
        id: "flow.steady",
        what: "a march to a steady flow ends steady",
        estimate: "residual of the steady equations over its largest, and change of the force over ten steps, in a step that \
                   is itself solved",
        range: "below stage.steady.residual_drop or stage.steady.force_change within stage.steady.max_steps steps, else an \
                error that counts the steps that ran out of iterations",
        source: "the criteria of the scene; a step that is not solved hardly moves, and would look steady",
        severity: Error,
        remedy: "raise stage.steady.max_steps or flow.solver.max_iterations, or give the stage a duration",
        when: When::During(&["flow-solver"]),
    },
    Check {
        id: "mesh.convergence",
        what: "the linear solve for the grid's motion is converged",
        estimate: "largest uncertainty of a node's position, as a share of the edges around it",
        range: "at most mesh.tolerance; above it the motion is divided into increments, then the window is rejected and \
                retried with half its length, then an error",
        source: "the tolerance of the scene",
        severity: Error,
        remedy: "raise mesh.tolerance, or lower mesh.stiffening_exponent",
        when: When::During(&["mesh-mover"]),
    },
    Check {
        id: "structure.energy",
        what: "time integration of the structure creates no energy",
        estimate: "change of kinetic and strain energy less the work of loads, gravity and prescribed motions and plus \
                   what damping takes, summed over the stage, over the initial energy and the sizes of all works",
        range: "warning above 5 %; above 25 %, or where one window creates as much as it began with, it is retried with \
                half its length, then an error",
        source: "steps with averaged strains create none (Simo and Tarnow 1992); explicit steps created 0.9 % at most and \
                 Newmark's method passed the bound in 27 of 96 runs without damping",
        severity: Error,
        remedy: "set structure.integration = \"generalized-alpha\" (the default), or lower structure.explicit_safety",
        when: When::During(&["structure-solver", "coupler"]),
    },
    Check {
        id: "mesh.quality",
        what: "no cell of the moved grid is inverted or nearly so",
        estimate: "smallest scaled Jacobian of the cells",
        range: "above mesh.min_quality; below it the window is rejected and retried with half its length, then an \
                error that names the cell and its place",
        source: "a scaled Jacobian at or below zero is a cell without a positive volume at a corner",
        severity: Error,
        remedy: "shorten window_s, or raise mesh.regrid.quality_threshold",
        when: When::During(&["mesh-mover"]),
    },
    Check {
        id: "flow.impossible",
        what: "speeds and pressures of the flow are such that the motion can cause them",
        estimate: "largest speed over W + sqrt(2 P / rho), and gauge pressure over rho W^2 / 2 + rho W min(c, L / dt) + P, \
                   with W the speeds of stream and canopy, P the applied pressure and the weight over the area",
        range: "an error above ten times; Mach numbers below 1e-3 are not judged",
        source: "stagnation, inertia of air that walls accelerate, pressure of a piston; of the hard cases full-pressure and snapping-lines were compared and stay below the estimate",
        severity: Error,
        remedy: "set coupling.scheme = \"implicit\", shorten window_s, or raise first_layer_m",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "flow.local-mach",
        what: "the equations of the flow are valid at its local Mach numbers",
        estimate: "largest Mach number of a cell (MAX_MACH), largest_local_mach in summary.json",
        range: "warning above 0.3 for isothermal air, above 0.7 with [flow.energy]; an error from 1",
        source: "density of isothermal air is wrong by (gamma - 1) M^2 / 2, 1.8 % at 0.3; shocks are not captured, and boundaries and \
                 preconditioner are made for subsonic flow",
        severity: Error,
        remedy: "add [flow.energy], or lower descent.initial_speed_m_s or flow.wind_m_s",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "flow.leakage",
        what: "airtight cloth is airtight in an immersed flow",
        estimate: "air that passes it (MASS_DEFECT over density) over fabric area and the speed of stream and canopy, largest_leakage_share \
                   in summary.json",
        range: "warning above 1 %",
        source: "pockets of at most 64 cells between folds leak, resolved cloth lets 1e-5 of a steady stream pass; dynamic pressure goes with the \
                 square of the speed, so that 2 % of the drag are at stake (an estimate; not measured)",
        severity: Warning,
        remedy: "reduce flow.immersed.spacing_m, or put a flow-only stage before this one",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "wake.symmetric",
        what: "the means of the main stage are those of a wake that is not symmetric",
        estimate: "root mean square of the side force over the mean drag, both over the last half of the windows \
                   (wake.side_force_share in summary.json)",
        range: "warning below 3 %, where the mean covers four periods of a disk; a shorter stage has wake.periods, with the side force",
        source: "a bluff body in a symmetric scene keeps a symmetric wake for 30 to 60 U/D, whose drag is up to a third too low; the \
                 ATPS has 0.9 % (9 N of 1 050 N) in it and 10 to 50 % after it, and 3 % is the geometric mean of 0.9 and 10 %",
        severity: Warning,
        remedy: "add [stage.perturbation] to a stage with flow, or lengthen the stage",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "wake.periods",
        what: "the means of the main stage cover the periods that a confidence interval needs",
        estimate: "time of the last half of the windows over the main period of the side force along its principal axis; without one, with a \
                   Strouhal number above 0.3, or with a side force below 3 % of the drag, 0.135 times the diameters of stream in that time \
                   (wake.periods in summary.json)",
        range: "warning below 4",
        source: "the interval of a mean comes from the means of at least four batches of whole periods; 0.135 is the Strouhal number of a \
                 disk across the stream (Berger, Scholz and Schumm, J. Fluids Struct. 4, 1990)",
        severity: Warning,
        remedy: "lengthen the stage, and do not compare its mean with a steady value",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "flow.unloaded-canopy",
        what: "the air exerts a force on an immersed canopy",
        estimate: "force in the last window of the stage over dynamic pressure and nominal area",
        range: "warning below 1e-4",
        source: "a gathered canopy of two cells across carries 3e-3 (the flat circular canopy of ripstop new); one that is narrower than a cell lets the \
                 stream pass through a column of cells and carries nothing",
        severity: Warning,
        remedy: "a smaller flow.immersed.spacing_m, or a wider start (a longer reefing line, a higher pressure)",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "strength.safety-factor",
        what: "fabric, lines, risers and tapes carry less than their strength",
        estimate: "strength over the largest load at the ends of windows (safety_factors in summary.json): of lines lines.strength_n over \
                   max_line_tension_n, of risers risers.strength_n over riser_force_n for each riser, an upper bound; of tapes \
                   strength_n over the largest tension at their place (max_seam_tape_tension_n); of the fabric \
                   fabric.strength_n_m over max_membrane_force_n_m, the peak of one element, which grows at corners and lines as elements shrink, \
                   and next to it over membrane_force_99_n_m; where groups of a mesh file have strengths of their own 1 over membrane_force_over_strength. Loads within a window are not seen, nor the strength of seams",
        range: "warning below 1 at the end of the stage; below safety_factor of the section the figure says so",
        source: "the strength of the scene or of its material",
        severity: Warning,
        remedy: "choose a stronger material, more lines, or a slower opening; the run continues, as nothing breaks in it",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "stages.at-rest",
        what: "the canopy is at rest at the end of a pre-inflation that a stage with the flow starts from",
        estimate: "kinetic energy over strain energy in the last window",
        range: "warning above 1 %",
        source: "the flow grid is built around this shape, and the release adds its motion to the descent",
        severity: Warning,
        remedy: "set mass_damping_per_s of the stage, lengthen duration_s, or set solve = \"static\"",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "stages.release-pressure",
        what: "the pressure that inflated the canopy is near that of the developed flow",
        estimate: "mean pressure jump of the flow over the canopy, weighted by area, against pressure_pa, at the release",
        range: "a line with both; warning where one is less than half of the other",
        source: "a canopy carries about 0.7 to 1.8 times the dynamic pressure, so that an estimate of it lies within a half",
        severity: Warning,
        remedy: "set pressure_pa near the pressure of the flow, which the warning gives",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "coupling.convergence",
        what: "structure, flow and descent agree at the end of each window",
        estimate: "change of interface displacement and descent speed over an iteration, relative to their change over \
                   the window",
        range: "below coupling.tolerance; a window that stagnates below 10 times the tolerance (and below 0.1) is accepted, \
                counted and reported once a stage; one above it is rejected and retried with half its length, then an error \
                unless --accept-unconverged is given",
        source: "the tolerance of the scene; the change over a window is never taken for smaller than what a share of the \
                 load's scale moves the fabric by, so the measure is defined where nothing moves",
        severity: Error,
        remedy: "raise coupling.max_iterations, shorten window_s, or use acceleration = \"ibqn-ls\"",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "coupling.interface-energy",
        what: "the coupling neither creates nor removes energy",
        estimate: "sum over windows of 1/2 (f_j + f_j-1) . dd_j - f_flow . dx_flow, over the work of the air on the canopy",
        range: "warning where the coupling has added more than 5 % of the work, or removed more than 10 %, after 20 windows and a fifth of \
                the time in which the air passes the canopy; before that windows that create energy become shorter, see \
                coupling.adaptive.energy_limit",
        source: "an exact coupling adds none; a staggered scheme adds some of first or second order in the window. Settled descents lose 0.4 to 2.2 %, \
                 a canopy in a grid of 21 000 tetrahedra lost 13 %",
        severity: Warning,
        remedy: "set coupling.scheme = \"implicit\"; where windows do not converge raise coupling.max_iterations; shorten \
                 window_s where it is longer than 1/200 of that time; tighten coupling.tolerance",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "coupling.alternating-load",
        what: "the load of the air does not alternate from window to window",
        estimate: "root mean square of a quarter of the second difference of the drag over its mean magnitude, and the correlation of successive changes, over the last \
                   half of the windows (alternating_load in summary.json)",
        range: "warning above 2 % with a correlation below -0.5; nothing is said of fewer than 40 windows",
        source: "where the air weighs mu times as much as the fabric, the velocity of the fabric at the ends of windows alternates by a factor of -mu/(2 + mu) (decision 83); the \
                 immersed ATPS has 5 % without and 0.7 % with damping, and 2 % is the geometric mean. An oscillation of two or three windows looks the same",
        severity: Warning,
        remedy: "set stage.stiffness_damping_s or coupling.velocity_average, or average over several windows",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "opening.vibrating-force",
        what: "the largest riser force of an opening is no vibration of lines and risers",
        estimate: "largest riser force at the end of a window over the largest mean of that force over a tenth of the nominal diameter by the speed at line stretch, and how often the force \
                   crosses its mean within that time of the largest one (largest_force_n, largest_mean_force_n and force_crossings in summary.json)",
        range: "warning above 1.1 with at least 8 crossings, four periods; nothing is said where a window is longer than that time, nor of a single short peak",
        source: "nine openings have ratios of 1.01 to 1.17, those above 1.1 with 3 and 4 crossings (pulses of the load); a canopy of 1.5 m on risers of a large one has 1.57 and 35",
        severity: Warning,
        remedy: "state the mean with its averaging time, give light canopies lines and risers of their size",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "descent.downward",
        what: "the frame falls no faster than gravity and the measured forces pull it",
        estimate: "acceleration of the frame compared with gravity and the downward forces of lines and drag on the payload, per mass",
        range: "at most 0.1 g beyond them; a window above it is rejected and retried with half its length, then an error",
        source: "Newton's second law for the payload",
        severity: Error,
        remedy: "set descent.equation = \"momentum\", or start nearer to balance",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "descent.upward",
        what: "the frame rises no faster than its lines pull it",
        estimate: "acceleration of the frame compared with the mean force of the lines on the payload, per mass, less gravity",
        range: "warning beyond half of gravity and of the lines' force per mass above it",
        source: "Newton's second law for the payload; the margin is that of forces at the end of a window",
        severity: Warning,
        remedy: "set descent.equation = \"momentum\"",
        when: When::During(&["coupler"]),
    },
    Check {
        id: "descent.impulse",
        what: "the structure's force on the payload agrees with the load of the air",
        estimate: "sum over windows of the air's impulse less that on the payload and the change of the structure's momentum, \
                   over the air's impulse",
        range: "warning beyond 5 %, and beyond 1 % of the impulse of the weight, after 20 windows",
        source: "momentum of the structure; the two are means of one load over a window on slightly different shapes",
        severity: Warning,
        remedy: "check SUPPORT_FORCE and MOMENTUM of a replaced structure, or shorten window_s",
        when: When::During(&["coupler"]),
    },
];
