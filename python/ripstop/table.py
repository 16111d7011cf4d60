"""Numbers and names of the contract. Written from the code of crates/channel:
RIPSTOP_WRITE_DOCS=1 cargo test -p channel contract_doc. Not to be edited."""

VERSION = 5
MAGIC = 0x00504F5453504952
HEADER_TYPE = "ripstop.Header.v5"
HEADER_BYTES = 544
STATS = 48
COUPLER = 0
TEXT_WORDS = 1024
BUFFER = 2
ALIGNMENT = 64
LOOK_S = 0.2
GUARDIAN_INTERVAL_S = 0.5
GUARDIAN_LOOKS = 4
ORPHAN = 70
MEMORY = "/dev/shm"
LOCK = "lock."
KEY_DIGITS = 12
ROLES = {
    "structure": 1,
    "flow": 2,
    "mesh": 3,
}
KINDS = {
    "ANNOUNCE": 1,
    "WELCOME": 2,
    "REFUSE": 3,
    "SEND_LAYOUT": 4,
    "LAYOUT": 5,
    "DONE": 6,
    "ADVANCE": 7,
    "OUTPUT": 8,
    "GRID": 9,
    "ACCEPT": 10,
    "SAVE": 11,
    "SNAPSHOT": 12,
    "STOP": 13,
    "FAULT": 14,
    "ABORT": 15,
}
UNITS = {
    "NONE": 0,
    "TEXT": 1,
    "ROWS": 2,
    "DISPLACEMENT": 3,
    "LOAD": 4,
    "LOAD_PAIR": 5,
    "GRID": 6,
}
WIDTHS = {
    "NONE": 0,
    "TEXT": 1,
    "ROWS": 1,
    "DISPLACEMENT": 3,
    "LOAD": 4,
    "LOAD_PAIR": 8,
    "GRID": 6,
}
INPUTS = {
    "structure": "LOAD_PAIR",
    "flow": "DISPLACEMENT",
    "mesh": "DISPLACEMENT",
}
OUTPUTS = {
    "structure": "DISPLACEMENT",
    "flow": "LOAD",
    "mesh": "GRID",
}
SERVICES = {
    "command": "command/{role}",
    "answer": "answer/{role}.{rank}",
    "layout": "layout/{role}.{rank}",
    "grid": "grid/{rank}",
    "bell": "bell/{role}",
    "coupler_bell": "bell/coupler",
}
# Offset in the header, name, type of a number, how many of them.
HEADER = [
    (0, "magic", "u64", 1),
    (8, "contract", "u32", 1),
    (12, "kind", "u32", 1),
    (16, "session", "u64", 1),
    (24, "role", "u32", 1),
    (28, "rank", "u32", 1),
    (32, "sequence", "u64", 1),
    (40, "unit", "u32", 1),
    (44, "reserved", "u32", 1),
    (48, "length", "u64", 1),
    (56, "bytes", "u64", 1),
]
WINDOW = [
    (64, "index", "u64", 1),
    (72, "iteration", "u64", 1),
    (80, "substeps", "u64", 1),
    (88, "time", "f64", 1),
    (96, "dt", "f64", 1),
    (104, "frame_velocity", "f64", 3),
    (128, "frame_acceleration", "f64", 3),
]
ANSWER = [
    (152, "busy_s", "f64", 1),
    (160, "values", "f64", 48),
]
STATISTICS = {
    "structure": {
        "kinetic_energy": 0,
        "strain_energy": 1,
        "load_work": 2,
        "newton_steps": 3,
        "gmres_iterations": 4,
        "factorisations": 5,
        "vertical_load": 6,
        "projected_area": 7,
        "max_line_tension": 8,
        "residual": 9,
        "step_cuts": 10,
        "assembly_s": 11,
        "linear_s": 12,
        "riser_force": 14,
        "volume": 15,
        "residual_target": 16,
        "unconverged": 17,
        "work": 18,
        "energy_created": 19,
        "work_sum": 20,
        "energy_created_sum": 21,
        "energy_throughput": 22,
        "energy_excess": 23,
        "max_membrane_force": 26,
        "membrane_force_99": 27,
        "max_hem_tape_tension": 28,
        "max_seam_tape_tension": 29,
        "max_vent_tape_tension": 30,
        "max_grid_tape_tension": 31,
        "support_force_x": 32,
        "support_force_y": 33,
        "support_force_z": 34,
        "momentum_x": 35,
        "momentum_y": 36,
        "momentum_z": 37,
        "air_force_x": 38,
        "air_force_y": 39,
        "air_force_z": 40,
        "membrane_force_over_strength": 41,
        "membrane_force_over_strength_99": 42,
        "prescribed_work": 43,
        "waited_s": 44,
    },
    "flow": {
        "force_x": 0,
        "force_y": 1,
        "force_z": 2,
        "residual_start": 3,
        "residual_end": 4,
        "iterations": 5,
        "linear_iterations": 6,
        "max_mach": 7,
        "max_courant": 8,
        "max_pressure": 9,
        "min_pressure": 10,
        "moment_x": 11,
        "moment_y": 12,
        "moment_z": 13,
        "mass_defect": 14,
        "no_answer": 15,
        "residual_target": 16,
        "unconverged": 17,
        "turbulence_residual": 18,
        "max_mach_at": 19,
        "extreme_pressure_at": 22,
        "cell_error": 25,
        "cell_error_target": 26,
        "cell_error_at": 27,
        "waited_s": 44,
    },
    "mesh": {
        "min_quality": 0,
        "iterations": 1,
        "increments": 2,
        "residual": 3,
        "min_volume_ratio": 4,
        "worst_cell": 5,
        "stuck": 6,
        "new_grids": 7,
        "nearest_node": 8,
        "residual_target": 9,
        "waited_s": 44,
    },
}
