/* Solver programs in C for Ripstop: one program replaces the structure-solver, the flow-solver or the mesh-mover of a run.
 *
 * A program fills a `ripstop_program` with its functions and gives it to `ripstop_participant_main`, which talks to the coupler.
 * `ripstop new participant --role flow --lang c++` writes a complete one; docs/how-to/replace-a-solver.md has the steps. C++ has
 * classes for this header in `ripstop.hpp`, Fortran has the module of `ripstop.f90`.
 *
 * Order of the calls: `start`, `restore` where the run starts from a saved state, then for each window `advance` once or more, always
 * from the state of the last accepted window, and `accept`. `save` and `snapshot` come between windows.
 *
 * Errors: a function of the program returns 0, or the value of `ripstop_fault("...")`: then the run ends with that message. Functions of
 * this header return 0, or RIPSTOP_FAULT after an error whose message is kept; a function of the program that returns RIPSTOP_FAULT next ends the
 * run with it. Neither C++ exceptions nor longjmp may leave a function of the program; panics of the library become errors.
 *
 * Units are SI. z points up; the frame falls with the payload, so that air at rest comes with minus `frame_velocity`. Indices of
 * nodes, faces and cells start at 0. Arrays are stored row by row: `[faces][4]` has the four numbers of the first face first.
 *
 * roles: from the code
 * structure: input [faces][8]: pressure jump and shear traction x, y, z at the start of the window, then at its end, Pa; linear in
 * between. Output [canopy nodes][3]: displacement from the unstressed shape, m. Sign: a positive jump (inside minus outside) pushes
 * along the area vector of the face. Empty: never: in a stage without a flow the load is that of the scene.
 * flow: input empty; with the effect canopy.motion [canopy nodes][3], as the mesh. Output [faces][4]: pressure jump (inside minus
 * outside) and shear traction x, y, z summed over both sides, at the end of the window, Pa. Sign: the force on the canopy is jump
 * times area vector plus traction times area. Empty: the moved grid is empty where no mesh-mover runs: the canopy is held still, or
 * the effect canopy.motion moves it through the flow's own grid.
 * mesh: input [canopy nodes][3]: displacement from the unstressed shape at the end of the window, m. Output [grid nodes][6]:
 * position, m, and velocity, m/s, in the falling frame at the end of the window. Sign: the velocity is the second-order backward
 * difference of the positions, first order in the first window. Empty: never: a mesh-mover runs only where the canopy moves.
 * The area vector of a face with the corners a, b, c, d is half of (c - a) x (d - b); triangles repeat their third corner. z points
 * up, and the frame falls with the payload: air at rest comes with minus the velocity of the frame. Rows are numbered over the
 * whole canopy or grid, from 0; each rank has some of the output's rows and the whole input. No number may be NaN or infinite.
 * end of roles
 *
 * docs/reference/participants.md has the same for all languages.
 */
#ifndef RIPSTOP_H
#define RIPSTOP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* constants: from the code */
enum {
    RIPSTOP_CONTRACT = 5, /* version of the contract */
    RIPSTOP_STATS = 48 /* numbers in `statistics` */
};

/* Roles. */
enum {
    RIPSTOP_ROLE_STRUCTURE = 1,
    RIPSTOP_ROLE_FLOW = 2,
    RIPSTOP_ROLE_MESH = 3
};

/* Indices into `statistics` of the structure. The numbers of a vector follow each other: x, y, z. */
enum {
    RIPSTOP_STRUCTURE_KINETIC_ENERGY = 0, /* Kinetic energy at the end of the window, J. */
    RIPSTOP_STRUCTURE_STRAIN_ENERGY = 1, /* Strain energy at the end of the window, J. */
    RIPSTOP_STRUCTURE_LOAD_WORK = 2, /* Work of the pressure over the window, J. */
    RIPSTOP_STRUCTURE_NEWTON_STEPS = 3, /* Newton steps in the window. */
    RIPSTOP_STRUCTURE_GMRES_ITERATIONS = 4, /* GMRES iterations in the window. */
    RIPSTOP_STRUCTURE_FACTORISATIONS = 5, /* Matrix factorisations in the window. */
    RIPSTOP_STRUCTURE_VERTICAL_LOAD = 6, /* Vertical load of the pressure on the canopy, N, upwards. */
    RIPSTOP_STRUCTURE_PROJECTED_AREA = 7, /* Projected area of the canopy on a horizontal plane, m2. */
    RIPSTOP_STRUCTURE_MAX_LINE_TENSION = 8, /* Largest line tension, N. */
    RIPSTOP_STRUCTURE_RESIDUAL = 9, /* Residual of the last Newton step relative to the load. Below 0: the solve failed, the structure keeps its last accepted state, and the coupler rejects the window or ends the run. */
    RIPSTOP_STRUCTURE_STEP_CUTS = 10, /* Time steps that were cut. */
    RIPSTOP_STRUCTURE_ASSEMBLY_S = 11, /* Time of assembly, s. */
    RIPSTOP_STRUCTURE_LINEAR_S = 12, /* Time of factorisations and Krylov solves, s. */
    RIPSTOP_STRUCTURE_RISER_FORCE = 14, /* Vertical force in the risers at the payload, N, upwards on the payload. */
    RIPSTOP_STRUCTURE_VOLUME = 15, /* Volume under the canopy closed by its hem plane, m3 (0 if open shape). */
    RIPSTOP_STRUCTURE_RESIDUAL_TARGET = 16, /* Value of RESIDUAL at which the response counts as converged. 0: not stated, so not judged. */
    RIPSTOP_STRUCTURE_UNCONVERGED = 17, /* Time steps of this response that ended above their own target. */
    RIPSTOP_STRUCTURE_WORK = 18, /* Work over the window of everything outside of the structure (loads, gravity, prescribed motions), less the dissipation by damping, J. */
    RIPSTOP_STRUCTURE_ENERGY_CREATED = 19, /* Energy that time integration created in the window, J: the change of kinetic and strain energy less WORK; negative: dissipated. */
    RIPSTOP_STRUCTURE_WORK_SUM = 20, /* WORK since the start of the stage, J. */
    RIPSTOP_STRUCTURE_ENERGY_CREATED_SUM = 21, /* ENERGY_CREATED since the start of the stage, J. */
    RIPSTOP_STRUCTURE_ENERGY_THROUGHPUT = 22, /* Energy at the start of the stage plus the absolute values of all works since, J. 0: the energy balance is not reported. */
    RIPSTOP_STRUCTURE_ENERGY_EXCESS = 23, /* Energy created relative to its limit. Above 1 the motion is an artefact of time integration, and the coupler rejects the window or ends the run. */
    RIPSTOP_STRUCTURE_MAX_MEMBRANE_FORCE = 26, /* Largest membrane force of the fabric at the end of the window, N for each metre of unstressed width: the larger principal value of the first Piola-Kirchhoff stress times the thickness, the force that a strip test measures. 0: no tension, or not reported. */
    RIPSTOP_STRUCTURE_MEMBRANE_FORCE_99 = 27, /* Membrane force that 99 % of the unstressed area of the fabric does not exceed, N/m. 0: no tension, or not reported. */
    RIPSTOP_STRUCTURE_MAX_HEM_TAPE_TENSION = 28, /* Largest tension of a tape of the hem at the end of the window, N. 0: no tension, or not reported. */
    RIPSTOP_STRUCTURE_MAX_SEAM_TAPE_TENSION = 29, /* Largest tension of a tape of the seams, N, as MAX_HEM_TAPE_TENSION. */
    RIPSTOP_STRUCTURE_MAX_VENT_TAPE_TENSION = 30, /* Largest tension of a tape of the vents, N, as MAX_HEM_TAPE_TENSION. */
    RIPSTOP_STRUCTURE_MAX_GRID_TAPE_TENSION = 31, /* Largest tension of one tape of the grid, N, as MAX_HEM_TAPE_TENSION: that of an element over the tapes that it stands for. */
    RIPSTOP_STRUCTURE_SUPPORT_FORCE = 32, /* Mean over the window of the force of the structure on the payload, or on its support, N: x, y, z at 32, 33, 34. The payload's own weight is excluded: in balance with the impulse of the air and the change of MOMENTUM. With descent.body the force on the body, its drag included. The descent equation reads its vertical part from programs with the effect descent.equation, all of it from those with the effect descent.motion. */
    RIPSTOP_STRUCTURE_MOMENTUM = 35, /* Momentum of all free components of nodes, relative to the frame, at the end of the window, N s: 35, 36, 37; read as SUPPORT_FORCE. */
    RIPSTOP_STRUCTURE_AIR_FORCE = 38, /* Force of the air on lines and a payload that moves in the frame, N: 38, 39, 40; read where the scene has lines.drag or descent.body. */
    RIPSTOP_STRUCTURE_MEMBRANE_FORCE_OVER_STRENGTH = 41, /* Largest membrane force over the strength of its cloth at the end of the window, where cloths of a mesh file have strengths of their own. 0: no tension, no strength, or not reported. */
    RIPSTOP_STRUCTURE_MEMBRANE_FORCE_OVER_STRENGTH_99 = 42, /* Membrane force over strength that 99 % of the unstressed area with a strength does not exceed, as MEMBRANE_FORCE_OVER_STRENGTH. */
    RIPSTOP_STRUCTURE_PRESCRIBED_WORK = 43, /* Part of WORK that comes from neither load nor gravity, J: of prescribed motions, of constant forces on nodes, of reefing lines that are drawn in or cut; all relative to the frame. 0: none, or not reported. */
    RIPSTOP_STRUCTURE_WAITED_S = 44 /* Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each rank, unlike the other statistics. 0: one rank, or not reported. */
};

/* Indices into `statistics` of the flow. The numbers of a vector follow each other: x, y, z. */
enum {
    RIPSTOP_FLOW_FORCE = 0, /* Force on the canopy at the end of the window, N: x, y, z at 0, 1, 2. In a scene without a canopy, and in a stage of kind flow-only, whose flow no other program reads, that on the surfaces of flow.forces.watch. */
    RIPSTOP_FLOW_RESIDUAL_START = 3, /* Unsteady residual before the first iteration, scaled. */
    RIPSTOP_FLOW_RESIDUAL_END = 4, /* Unsteady residual after the last iteration, same scale. */
    RIPSTOP_FLOW_ITERATIONS = 5, /* Nonlinear (pseudo-time) iterations. */
    RIPSTOP_FLOW_LINEAR_ITERATIONS = 6, /* Linear (Krylov) iterations or sweeps. */
    RIPSTOP_FLOW_MAX_MACH = 7, /* Largest Mach number. */
    RIPSTOP_FLOW_MAX_COURANT = 8, /* Largest convective Courant number. */
    RIPSTOP_FLOW_MAX_PRESSURE = 9, /* Largest gauge pressure, Pa. */
    RIPSTOP_FLOW_MIN_PRESSURE = 10, /* Smallest gauge pressure, Pa. */
    RIPSTOP_FLOW_MOMENT = 11, /* Moment on the canopy about the origin of the frame, N m: 11, 12, 13. */
    RIPSTOP_FLOW_MASS_DEFECT = 14, /* Mass defect: sum over cells of the residual of continuity, kg/s. */
    RIPSTOP_FLOW_NO_ANSWER = 15, /* Not 0: the solve failed (1: the iterations diverged, 2: an unphysical state, 3: a cell of the moved grid without volume, 4: the iteration limit was reached before the residual was halved). The flow keeps its last accepted state, and the coupler rejects the window or ends the run. */
    RIPSTOP_FLOW_RESIDUAL_TARGET = 16, /* Value of RESIDUAL_END at which the response counts as converged: the residual drop of a step in the scene. 0: not stated, so not judged. */
    RIPSTOP_FLOW_UNCONVERGED = 17, /* Flow solves of this response that ended above their own target; repeated solves within a window may have a smaller one than RESIDUAL_TARGET. */
    RIPSTOP_FLOW_TURBULENCE_RESIDUAL = 18, /* Residual of the turbulence equation in the last accepted step, relative to its target; 0: not solved. */
    RIPSTOP_FLOW_MAX_MACH_AT = 19, /* Centre of the cell with the largest Mach number, m: 19, 20, 21. All 0: not reported. */
    RIPSTOP_FLOW_EXTREME_PRESSURE_AT = 22, /* Centre of the cell with the largest gauge pressure by absolute value, m: 22, 23, 24. All 0: not reported. */
    RIPSTOP_FLOW_CELL_ERROR = 25, /* Largest change of velocity that the residual of one cell would still cause, over the typical speed of the flow. */
    RIPSTOP_FLOW_CELL_ERROR_TARGET = 26, /* Value of CELL_ERROR up to which a solve counts as converged. 0: not stated, so not judged. */
    RIPSTOP_FLOW_CELL_ERROR_AT = 27, /* Centre of the cell of CELL_ERROR, m: 27, 28, 29. */
    RIPSTOP_FLOW_WAITED_S = 44 /* Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each rank, unlike the other statistics. 0: one rank, or not reported. */
};

/* Indices into `statistics` of the mesh. The numbers of a vector follow each other: x, y, z. */
enum {
    RIPSTOP_MESH_MIN_QUALITY = 0, /* Smallest scaled Jacobian of the moved grid. */
    RIPSTOP_MESH_ITERATIONS = 1, /* Krylov iterations. */
    RIPSTOP_MESH_INCREMENTS = 2, /* Sub-increments. */
    RIPSTOP_MESH_RESIDUAL = 3, /* Relative residual reached. */
    RIPSTOP_MESH_MIN_VOLUME_RATIO = 4, /* Smallest ratio of a cell's volume to its volume at the start. */
    RIPSTOP_MESH_WORST_CELL = 5, /* Cell (global) of the smallest scaled Jacobian. */
    RIPSTOP_MESH_STUCK = 6, /* Not 0: the grid motion failed. The grid keeps its last accepted state, and MIN_QUALITY and WORST_CELL (-1: none) describe the best attempt. The coupler then rejects the window, or saves and ends the run. */
    RIPSTOP_MESH_NEW_GRIDS = 7, /* New grids built so far to replace bad ones. */
    RIPSTOP_MESH_NEAREST_NODE = 8, /* Where the grid motion failed: the canopy node nearest to the worst cell; -1: none. */
    RIPSTOP_MESH_RESIDUAL_TARGET = 9, /* Value of RESIDUAL at which the response counts as converged. 0: not stated, so not judged. */
    RIPSTOP_MESH_WAITED_S = 44 /* Time in this response for which the rank waited for other ranks of its program and for their messages, s. Of each rank, unlike the other statistics. 0: one rank, or not reported. */
};
/* end of constants */

/* Value that a function returns after an error. */
enum { RIPSTOP_FAULT = 1 };

/* Data of the stage. Belongs to the library and is valid until `ripstop_participant_main` returns. */
typedef struct ripstop_data ripstop_data;

/* A window of the run, from `time` to `time + dt`. */
typedef struct ripstop_window {
    uint64_t index;     /* number of the window, from 0 */
    uint64_t iteration; /* coupling iteration within the window, from 0 */
    uint64_t substeps;  /* of the structure */
    double time;        /* start of the window, s since the start of the stage */
    double dt;          /* length of the window, s */
    double frame_velocity[3];     /* of the falling frame at the end of the window, m/s */
    double frame_acceleration[3]; /* mean over the window, m/s2 */
} ripstop_window;

/* Input of `advance`, valid during the call. */
typedef struct ripstop_input {
    const double *canopy; /* by role, see above; NULL where it is empty */
    size_t canopy_length; /* numbers */
    const double *grid;   /* flow: [grid_rows][6], position (m) and velocity (m/s) of the nodes of `grid_rows`; NULL on a grid at rest */
    size_t grid_rows;
} ripstop_input;

/* Nodes and elements of the structure. The first `canopy_nodes` nodes are the interface. */
typedef struct ripstop_structure {
    size_t nodes;
    const double *coords;        /* [nodes][3], unstressed positions, m */
    const uint8_t *fixed;        /* [nodes][3], 1 where a node is held along x, y, z, else 0 */
    const double *point_mass;    /* [nodes], kg, 0 where there is none */
    size_t canopy_nodes;
    size_t faces;
    const uint32_t *corners;     /* [faces][4] of the canopy; a triangle repeats its third corner */
    size_t cables;               /* lines, risers and tapes */
    const uint32_t *cable_ends;  /* [cables][2], nodes */
    const double *cable_length;  /* [cables], unstressed, m */
    const char *const *cable_kind; /* [cables], "SuspensionLine", "Riser", "Reinforcement" or "Tape" */
} ripstop_structure;

/* The flow grid at the start of the stage. */
typedef struct ripstop_grid {
    size_t nodes;
    const double *coords;           /* [nodes][3], m */
    size_t cells;
    const uint32_t *corners;        /* [cells][8]; prisms, pyramids and tetrahedra repeat corners */
    const uint64_t *canopy_nodes;   /* [canopy_nodes of the structure], grid node of each canopy node */
    size_t boundary_faces;
    const uint32_t *boundary;       /* [boundary_faces][4], corners */
    const char *const *patch;       /* [boundary_faces], name of the patch, such as "far-field" */
} ripstop_grid;

/* A solver program. Start from `ripstop_program program = {0};` (C++: `{}`) and set `size` first. `user` is passed to each function. */
typedef struct ripstop_program {
    size_t size;         /* sizeof(ripstop_program): a library of another version refuses the program */
    int32_t role;        /* RIPSTOP_ROLE_STRUCTURE, RIPSTOP_ROLE_FLOW or RIPSTOP_ROLE_MESH */
    int32_t needs_grid;  /* 1: `ripstop_get_grid` is called, or the program has the role mesh or `grid_rows`; 0: no flow grid */
    const char *name;    /* of the program, for messages */
    const char *effects; /* effects of the scene that it has (docs/reference/contract.md), separated by spaces; NULL: none */
    void *user;
    /* Reads the stage. Required. `data` may be kept. */
    int (*start)(void *user, const ripstop_data *data);
    /* Rows of this rank's output, of which `*count` becomes the number: canopy nodes (structure), faces (flow) or grid nodes (mesh). They are
     * copied. NULL: the share of this rank, as `ripstop_share` has it. */
    const uint64_t *(*output_rows)(void *user, size_t *count);
    /* Grid nodes that a flow reads in the stages in which the grid moves; copied. NULL: none. */
    const uint64_t *(*grid_rows)(void *user, size_t *count);
    /* Computes the window from the last accepted state. Fills `output` (`length` numbers, [output rows][numbers by role]) completely, and
     * of `statistics` (RIPSTOP_STATS numbers, zero before) those that it knows: the same values on each rank. Required. */
    int (*advance)(void *user, const ripstop_window *window, const ripstop_input *input, double *output, size_t length, double *statistics);
    /* The next three are those of a program with a state: all of them or none. The last `advance` becomes the accepted state. */
    int (*accept)(void *user, const ripstop_window *window);
    /* Writes the accepted state to `<role>.bin` below `folder`, which exists and is shared by all ranks: `ripstop_save_numbers` on the first
     * rank, or a file of your own form. A structure also calls `ripstop_write_shape`. */
    int (*save)(void *user, const char *folder);
    /* Reads what `save` wrote; `file` is that `<role>.bin`. */
    int (*restore)(void *user, const char *file);
    /* Writes pictures of the accepted state below `folder`. NULL: none. */
    int (*snapshot)(void *user, double time, const char *folder);
} ripstop_program;

/* Serves the program to the coupler, which passes the arguments. Returns the exit code of the process. */
int ripstop_participant_main(int argc, char **argv, const ripstop_program *program);

/* Keeps the message of an error (value, place, cause, remedy) and returns RIPSTOP_FAULT. From any thread. */
int ripstop_fault(const char *message);
/* The message of the last error, of at most `size` bytes with the zero at the end, into `text`. Returns the bytes of the whole message. */
size_t ripstop_message(char *text, size_t size);

/* This process among those of the program, from 0, and their number. 0 where `data` is NULL. */
size_t ripstop_rank(const ripstop_data *data);
size_t ripstop_ranks(const ripstop_data *data);
/* The rows `*begin` to `*end` - 1 of `rows` that this rank computes: all ranks have nearly equal shares, in order. */
int ripstop_share(const ripstop_data *data, size_t rows, size_t *begin, size_t *end);
/* 1 where the stage couples the programs, so that the canopy moves, else 0. */
int ripstop_is_coupled(const ripstop_data *data);

/* The arrays stay valid as long as `data`. */
int ripstop_get_structure(const ripstop_data *data, ripstop_structure *structure);
int ripstop_get_grid(const ripstop_data *data, ripstop_grid *grid);

/* Values of the scene by dotted key, with defaults: "fabric.thickness_m", "flow.wind_m_s.2", "stage.0.window_s". `*value` is unchanged where
 * the scene has no such value, which is an error that the caller may ignore. */
int ripstop_number(const ripstop_data *data, const char *key, double *value);
int ripstop_flag(const ripstop_data *data, const char *key, int *value);
int ripstop_text(const ripstop_data *data, const char *key, const char **value);
/* A number of the present stage: "window_s". */
int ripstop_stage_number(const ripstop_data *data, const char *key, double *value);
/* Time of the clock "stage", "release" or "run" at the start of the stage, s. */
int ripstop_clock(const ripstop_data *data, const char *name, double *value);
/* File of the state that the program of `role` saved last, or NULL. For the own role it is the one that `restore` gets. */
const char *ripstop_state_file(const ripstop_data *data, int32_t role);

/* A state of `count` numbers as `<role>.bin` below `folder`, complete or not at all, with a checksum. */
int ripstop_save_numbers(const ripstop_data *data, const char *folder, const double *values, size_t count);
/* Reads it. A damaged file, one of another program and another count are errors. */
int ripstop_load_numbers(const char *file, double *values, size_t count);
/* Positions of the canopy, [nodes][3], m: a structure writes them in `save`, and the flow grid of later stages is built around them. */
int ripstop_write_shape(const char *folder, const double *positions, size_t nodes);

/* Coefficients of the second-order backward difference for a step of `ratio` times the length of the step before:
 * rate = (c[0] x_new + c[1] x_now + c[2] x_before) / dt. First order (1, -1, 0) where the ratio is no positive number, or above 2.4. Velocities of
 * a moved grid are these. */
int ripstop_bdf2(double ratio, double c[3]);

#ifdef __cplusplus
}
#endif

#endif
