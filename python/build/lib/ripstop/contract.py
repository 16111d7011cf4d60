"""Header and texts of docs/reference/contract.md. Its numbers and names come from `table`, which is
written from the code."""

import ctypes
import struct
from enum import IntEnum

import numpy as np

from . import table
from .table import COUPLER, MAGIC, ROLES, STATISTICS, STATS, VERSION

__all__ = ["COUPLER", "INPUT", "MAGIC", "OUTPUT", "ROLES", "STATISTICS", "STATS", "VERSION", "WIDTH"]

# What a message is.
Kind = IntEnum("Kind", table.KINDS)
# What the numbers of a payload are.
Unit = IntEnum("Unit", table.UNITS)
# Numbers in a row.
WIDTH = {Unit[name]: width for name, width in table.WIDTHS.items()}
# What a role is given and what it answers.
INPUT = {role: Unit[name] for role, name in table.INPUTS.items()}
OUTPUT = {role: Unit[name] for role, name in table.OUTPUTS.items()}

NUMBERS = {"u32": ctypes.c_uint32, "u64": ctypes.c_uint64, "f64": ctypes.c_double}


def fields(rows):
    """Fields of a ctypes structure from rows of the table."""
    return [(name, NUMBERS[kind] * count if count > 1 else NUMBERS[kind]) for _, name, kind, count in rows]


def service(which, role="", rank=0):
    """Name of a service."""
    return table.SERVICES[which].format(role=role, rank=rank)


class Window(ctypes.Structure):
    """One window of the run, from `time` to `time + dt` (s). `frame_velocity` (m/s) is
    that of the falling frame at the end, `frame_acceleration` (m/s2) its mean."""

    _fields_ = fields(table.WINDOW)


class Header(ctypes.Structure):
    """Header of every message."""

    _fields_ = [*fields(table.HEADER), ("window", Window), *fields(table.ANSWER)]

    @staticmethod
    def type_name():
        """The name under which iceoryx2 compares the header in any language."""
        return table.HEADER_TYPE

    def problem(self, session, role, rank, length):
        """What is wrong with the parts that every message shares; None if nothing is."""
        for what, found, expected in [
            ("magic number", f"{self.magic:#x}", f"{MAGIC:#x}"),
            ("contract version", self.contract, VERSION),
            ("session", f"{self.session:#x}", f"{session:#x}"),
            ("sender", f"{self.role}.{self.rank}", f"{role}.{rank}"),
            ("length", self.length, length),
        ]:
            if found != expected:
                return f"{what} of the message is {found}, expected {expected}"
        return None


assert ctypes.sizeof(Header) == table.HEADER_BYTES
assert all(getattr(Header, name).offset == at for at, name, _, _ in table.HEADER + table.ANSWER)
assert all(Header.window.offset + getattr(Window, name).offset == at for at, name, _, _ in table.WINDOW)


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
