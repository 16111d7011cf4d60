//! The window and the statistics in every message.

/// Version of the contract. Bumped by every change to a header, a payload, a
/// service name or the order of messages; see `docs/reference/contract.md`.
pub const CONTRACT_VERSION: u32 = 5;

/// One window of the run: from `time` to `time + dt`.
///
/// A window may be requested several times: each time the participant starts from the state of the last accepted
/// window and must give the same response to the same input (to its own tolerance, where it uses a warm start).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[repr(C)]
pub struct Window {
    /// Number of the window, from 0.
    pub index: u64,
    /// Coupling iteration within the window, from 0.
    pub iteration: u64,
    /// Substeps of the structure in this window.
    pub substeps: u64,
    /// Time at the start of the window, s: `index * dt`, never accumulated.
    pub time: f64,
    /// Length of the window, s.
    pub dt: f64,
    /// Velocity of the falling frame at the end of the window, m/s. Canopy and
    /// grid coordinates are given in this frame; z points up.
    pub frame_velocity: [f64; 3],
    /// Mean acceleration of the falling frame over the window, m/s2.
    pub frame_acceleration: [f64; 3],
}

/// Number of [`Stats::values`].
pub const STATS: usize = 48;

/// Statistics that a participant reports with each response, in addition to the payload.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Stats {
    /// Wall seconds that the rank computed the response.
    pub busy_s: f64,
    /// Meaning by role: [`structure_stats`], [`flow_stats`], [`mesh_stats`].
    /// Global values, the same on each rank, but for `WAITED_S`.
    pub values: [f64; STATS],
}

impl Default for Stats {
    fn default() -> Self {
        Self { busy_s: 0.0, values: [0.0; STATS] }
    }
}

/// Indices into [`Stats::values`] of the structure.
pub mod structure_stats {
    /// Kinetic energy at the end of the window, J.
    pub const KINETIC_ENERGY: usize = 0;
    /// Strain energy at the end of the window, J.
    pub const STRAIN_ENERGY: usize = 1;
    /// Work of the pressure over the window, J.
    pub const LOAD_WORK: usize = 2;
    /// Newton steps in the window.
    pub const NEWTON_STEPS: usize = 3;
    /// GMRES iterations in the window.
    pub const GMRES_ITERATIONS: usize = 4;
    /// Matrix factorisations in the window.
    pub const FACTORISATIONS: usize = 5;
    /// Vertical load of the pressure on the canopy, N, upwards.
    pub const VERTICAL_LOAD: usize = 6;
    /// Projected area of the canopy on a horizontal plane, m2.
    pub const PROJECTED_AREA: usize = 7;
    /// Largest line tension, N.
    pub const MAX_LINE_TENSION: usize = 8;
    /// Residual of the last Newton step relative to the load. Below 0: the solve failed, the structure keeps its last
    /// accepted state, and the coupler rejects the window or ends the run.
    pub const RESIDUAL: usize = 9;
    /// Time steps that were cut.
    pub const STEP_CUTS: usize = 10;
    /// Time of assembly, s.
    pub const ASSEMBLY_S: usize = 11;
    /// Time of factorisations and Krylov solves, s.
    pub const LINEAR_S: usize = 12;
    /// Vertical force in the risers at the payload, N, upwards on the payload.
    pub const RISER_FORCE: usize = 14;
    /// Volume under the canopy closed by its hem plane, m3 (0 if open shape).
    pub const VOLUME: usize = 15;
    /// Value of `RESIDUAL` at which the response counts as converged. 0: not stated, so not judged.
    pub const RESIDUAL_TARGET: usize = 16;
    /// Time steps of this response that ended above their own target.
    pub const UNCONVERGED: usize = 17;
    /// Work over the window of everything outside of the structure (loads, gravity, prescribed motions), less the
    /// dissipation by damping, J.
    pub const WORK: usize = 18;
    /// Energy that time integration created in the window, J: the change of kinetic and strain energy less `WORK`;
    /// negative: dissipated.
    pub const ENERGY_CREATED: usize = 19;
    /// `WORK` since the start of the stage, J.
    pub const WORK_SUM: usize = 20;
    /// `ENERGY_CREATED` since the start of the stage, J.
    pub const ENERGY_CREATED_SUM: usize = 21;
    /// Energy at the start of the stage plus the absolute values of all works since, J. 0: the energy balance is not
    /// reported.
    pub const ENERGY_THROUGHPUT: usize = 22;
    /// Energy created relative to its limit. Above 1 the motion is an artefact of time integration, and the coupler
    /// rejects the window or ends the run.
    pub const ENERGY_EXCESS: usize = 23;
    /// Largest membrane force of the fabric at the end of the window, N for each metre of unstressed width: the larger principal value of the first
    /// Piola-Kirchhoff stress times the thickness, the force that a strip test measures. 0: no tension, or not reported.
    pub const MAX_MEMBRANE_FORCE: usize = 26;
    /// Membrane force that 99 % of the unstressed area of the fabric does not exceed, N/m. 0: no tension, or not reported.
    pub const MEMBRANE_FORCE_99: usize = 27;
    /// Largest tension of a tape of the hem at the end of the window, N. 0: no tension, or not reported.
    pub const MAX_HEM_TAPE_TENSION: usize = 28;
    /// Largest tension of a tape of the seams, N, as `MAX_HEM_TAPE_TENSION`.
    pub const MAX_SEAM_TAPE_TENSION: usize = 29;
    /// Largest tension of a tape of the vents, N, as `MAX_HEM_TAPE_TENSION`.
    pub const MAX_VENT_TAPE_TENSION: usize = 30;
    /// Largest tension of one tape of the grid, N, as `MAX_HEM_TAPE_TENSION`: that of an element over the tapes that it stands for.
    pub const MAX_GRID_TAPE_TENSION: usize = 31;
    /// Mean over the window of the force of the structure on the payload, or on its support, N: x, y, z at 32, 33, 34. The
    /// payload's own weight is excluded: in balance with the impulse of the air and the change of `MOMENTUM`.
    /// With `descent.body` the force on the body, its drag included. The descent equation reads its vertical part from
    /// programs with the effect `descent.equation`, all of it from those with the effect `descent.motion`.
    pub const SUPPORT_FORCE: usize = 32;
    /// Momentum of all free components of nodes, relative to the frame, at the end of the window, N s: 35, 36, 37; read
    /// as `SUPPORT_FORCE`.
    pub const MOMENTUM: usize = 35;
    /// Force of the air on lines and a payload that moves in the frame, N: 38, 39, 40; read where the scene has
    /// `lines.drag` or `descent.body`.
    pub const AIR_FORCE: usize = 38;
    /// Largest membrane force over the strength of its cloth at the end of the window, where cloths of a mesh file have strengths of their own. 0: no
    /// tension, no strength, or not reported.
    pub const MEMBRANE_FORCE_OVER_STRENGTH: usize = 41;
    /// Membrane force over strength that 99 % of the unstressed area with a strength does not exceed, as `MEMBRANE_FORCE_OVER_STRENGTH`.
    pub const MEMBRANE_FORCE_OVER_STRENGTH_99: usize = 42;
    /// Part of `WORK` that comes from neither load nor gravity, J: of prescribed motions, of constant forces on nodes, of reefing lines that are drawn in or cut; all
    /// relative to the frame. 0: none, or not reported.
    pub const PRESCRIBED_WORK: usize = 43;
    /// Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each
    /// rank, unlike the other statistics. 0: one rank, or not reported.
    pub const WAITED_S: usize = 44;
}

/// Indices into [`Stats::values`] of the flow.
pub mod flow_stats {
    /// Force on the canopy at the end of the window, N: x, y, z at 0, 1, 2. In a scene without a canopy, and in a stage of kind `flow-only`, whose flow no
    /// other program reads, that on the surfaces of `flow.forces.watch`.
    pub const FORCE: usize = 0;
    /// Unsteady residual before the first iteration, scaled.
    pub const RESIDUAL_START: usize = 3;
    /// Unsteady residual after the last iteration, same scale.
    pub const RESIDUAL_END: usize = 4;
    /// Nonlinear (pseudo-time) iterations.
    pub const ITERATIONS: usize = 5;
    /// Linear (Krylov) iterations or sweeps.
    pub const LINEAR_ITERATIONS: usize = 6;
    /// Largest Mach number.
    pub const MAX_MACH: usize = 7;
    /// Largest convective Courant number.
    pub const MAX_COURANT: usize = 8;
    /// Largest gauge pressure, Pa.
    pub const MAX_PRESSURE: usize = 9;
    /// Smallest gauge pressure, Pa.
    pub const MIN_PRESSURE: usize = 10;
    /// Moment on the canopy about the origin of the frame, N m: 11, 12, 13.
    pub const MOMENT: usize = 11;
    /// Mass defect: sum over cells of the residual of continuity, kg/s.
    pub const MASS_DEFECT: usize = 14;
    /// Not 0: the solve failed (1: the iterations diverged, 2: an unphysical state, 3: a cell of the moved grid
    /// without volume, 4: the iteration limit was reached before the residual was halved). The flow keeps its last
    /// accepted state, and the coupler rejects the window or ends the run.
    pub const NO_ANSWER: usize = 15;
    /// Value of `RESIDUAL_END` at which the response counts as converged: the residual drop of a step in the scene.
    /// 0: not stated, so not judged.
    pub const RESIDUAL_TARGET: usize = 16;
    /// Flow solves of this response that ended above their own target; repeated solves within a window may have a
    /// smaller one than `RESIDUAL_TARGET`.
    pub const UNCONVERGED: usize = 17;
    /// Residual of the turbulence equation in the last accepted step, relative to its target; 0: not solved.
    pub const TURBULENCE_RESIDUAL: usize = 18;
    /// Centre of the cell with the largest Mach number, m: 19, 20, 21. All 0: not reported.
    pub const MAX_MACH_AT: usize = 19;
    /// Centre of the cell with the largest gauge pressure by absolute value, m: 22, 23, 24. All 0: not reported.
    pub const EXTREME_PRESSURE_AT: usize = 22;
    /// Largest change of velocity that the residual of one cell would still cause, over the typical speed of the flow.
    pub const CELL_ERROR: usize = 25;
    /// Value of `CELL_ERROR` up to which a solve counts as converged. 0: not stated, so not judged.
    pub const CELL_ERROR_TARGET: usize = 26;
    /// Centre of the cell of `CELL_ERROR`, m: 27, 28, 29.
    pub const CELL_ERROR_AT: usize = 27;
    /// Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each
    /// rank, unlike the other statistics. 0: one rank, or not reported.
    pub const WAITED_S: usize = 44;
}

/// Indices into [`Stats::values`] of the mesh mover.
pub mod mesh_stats {
    /// Smallest scaled Jacobian of the moved grid.
    pub const MIN_QUALITY: usize = 0;
    /// Krylov iterations.
    pub const ITERATIONS: usize = 1;
    /// Sub-increments.
    pub const INCREMENTS: usize = 2;
    /// Relative residual reached.
    pub const RESIDUAL: usize = 3;
    /// Smallest ratio of a cell's volume to its volume at the start.
    pub const MIN_VOLUME_RATIO: usize = 4;
    /// Cell (global) of the smallest scaled Jacobian.
    pub const WORST_CELL: usize = 5;
    /// Not 0: the grid motion failed. The grid keeps its last accepted state, and `MIN_QUALITY` and `WORST_CELL` (-1:
    /// none) describe the best attempt. The coupler then rejects the window, or saves and ends the run.
    pub const STUCK: usize = 6;
    /// New grids built so far to replace bad ones.
    pub const NEW_GRIDS: usize = 7;
    /// Where the grid motion failed: the canopy node nearest to the worst cell; -1: none.
    pub const NEAREST_NODE: usize = 8;
    /// Value of `RESIDUAL` at which the response counts as converged. 0: not stated, so not judged.
    pub const RESIDUAL_TARGET: usize = 9;
    /// Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each
    /// rank, unlike the other statistics. 0: one rank, or not reported.
    pub const WAITED_S: usize = 44;
}
