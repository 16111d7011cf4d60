"""Constants, header and texts of docs/contract.md, version 1."""

import ctypes
import struct
from enum import IntEnum

import numpy as np

VERSION = 1
MAGIC = int.from_bytes(b"RIPSTOP\0", "little")
COUPLER = 0
ROLES = {"structure": 1, "flow": 2, "mesh": 3}
STATS = 16


class Kind(IntEnum):
    """What a message is."""

    ANNOUNCE = 1
    WELCOME = 2
    REFUSE = 3
    SEND_LAYOUT = 4
    LAYOUT = 5
    DONE = 6
    ADVANCE = 7
    OUTPUT = 8
    GRID = 9
    ACCEPT = 10
    SAVE = 11
    SNAPSHOT = 12
    STOP = 13
    FAULT = 14
    ABORT = 15


class Unit(IntEnum):
    """What the numbers of a payload are."""

    NONE = 0
    TEXT = 1
    ROWS = 2
    DISPLACEMENT = 3
    LOAD = 4
    LOAD_PAIR = 5
    GRID = 6


WIDTH = {Unit.NONE: 0, Unit.TEXT: 1, Unit.ROWS: 1, Unit.DISPLACEMENT: 3, Unit.LOAD: 4, Unit.LOAD_PAIR: 8, Unit.GRID: 6}
INPUT = {"structure": Unit.LOAD_PAIR, "mesh": Unit.DISPLACEMENT, "flow": Unit.NONE}
OUTPUT = {"structure": Unit.DISPLACEMENT, "mesh": Unit.GRID, "flow": Unit.LOAD}

# Names of the statistics that a participant may report, with their index.
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
        "factorisation_s": 12,
        "solve_s": 13,
        "riser_force": 14,
        "volume": 15,
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
    },
    "mesh": {
        "min_quality": 0,
        "iterations": 1,
        "increments": 2,
        "residual": 3,
        "min_volume_ratio": 4,
        "worst_cell": 5,
    },
}


class Window(ctypes.Structure):
    """One window of the run, from `time` to `time + dt` (s). `frame_velocity` (m/s) is
    that of the falling frame at the end, `frame_acceleration` (m/s2) its mean."""

    _fields_ = [
        ("index", ctypes.c_uint64),
        ("iteration", ctypes.c_uint64),
        ("substeps", ctypes.c_uint64),
        ("time", ctypes.c_double),
        ("dt", ctypes.c_double),
        ("frame_velocity", ctypes.c_double * 3),
        ("frame_acceleration", ctypes.c_double * 3),
    ]


class Header(ctypes.Structure):
    """Header of every message."""

    _fields_ = [
        ("magic", ctypes.c_uint64),
        ("contract", ctypes.c_uint32),
        ("kind", ctypes.c_uint32),
        ("session", ctypes.c_uint64),
        ("role", ctypes.c_uint32),
        ("rank", ctypes.c_uint32),
        ("sequence", ctypes.c_uint64),
        ("unit", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("length", ctypes.c_uint64),
        ("bytes", ctypes.c_uint64),
        ("window", Window),
        ("busy_s", ctypes.c_double),
        ("values", ctypes.c_double * STATS),
    ]

    @staticmethod
    def type_name():
        """The name under which iceoryx2 compares the header in any language."""
        return f"ripstop.Header.v{VERSION}"

    def problem(self, session, role, rank, length):
        """What is wrong with the parts that every message shares; None if nothing is."""
        for what, found, expected in [
            ("magic number", self.magic, MAGIC),
            ("contract version", self.contract, VERSION),
            ("session", f"{self.session:x}", f"{session:x}"),
            ("sender", f"{self.role}.{self.rank}", f"{role}.{rank}"),
            ("length", self.length, length),
        ]:
            if found != expected:
                return f"{what} of the message is {found}, expected {expected}"
        return None


assert ctypes.sizeof(Header) == 288


class Fault(Exception):
    """An error that ends the run: value, place and remedy in one message."""


def during(kind, window):
    """Where in a run a message belongs, for people."""
    if kind in (Kind.ADVANCE, Kind.OUTPUT, Kind.GRID):
        return f"window {window.index} iteration {window.iteration} (t = {window.time} s)"
    return {
        Kind.ACCEPT: f"the acceptance of window {window.index}",
        Kind.SAVE: "saving",
        Kind.SNAPSHOT: "writing pictures",
        Kind.STOP: "the end of the run",
        Kind.ABORT: "the end of the run",
    }.get(kind, "the handshake")


def fnv(data):
    """64-bit FNV-1a of bytes."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return value


def surface_hash(faces):
    """Hash of the interface faces, `[faces][4]` node numbers."""
    return fnv(np.ascontiguousarray(faces, dtype="<u4").tobytes())


def pack_text(text, words):
    """Bytes of `text`, cut between characters to what `words` numbers hold, and that as numbers."""
    data = text.encode()[: 8 * words].decode(errors="ignore").encode()
    return len(data), np.frombuffer(data + bytes(-len(data) % 8), dtype="<f8")


def unpack_text(payload, size):
    """Text of `size` bytes; empty where the payload is shorter or not UTF-8."""
    data = payload.tobytes()[:size]
    try:
        return data.decode() if len(data) == size else ""
    except UnicodeDecodeError:
        return ""


def shape_bytes(positions):
    """What `canopy.bin` holds for canopy positions `[nodes][3]`, m."""

    def varint(value):
        if value < 251:
            return struct.pack("<B", value)
        for mark, size, form in ((251, 2, "<BH"), (252, 4, "<BI"), (253, 8, "<BQ")):
            if value < 1 << (8 * size):
                return struct.pack(form, mark, value)
        raise ValueError(value)

    positions = np.ascontiguousarray(positions, dtype="<f8").reshape(-1, 3)
    count, data = varint(len(positions)), positions.tobytes()
    return b"ripshape" + varint(1) + count + varint(fnv(data)) + count + data
