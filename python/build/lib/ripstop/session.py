"""Paths of a session on this machine, and locks that show which of its processes run."""

import fcntl
import json
import os
import re
import struct
import threading
import time
from pathlib import Path

from .contract import VERSION, Fault, fnv
from .table import GUARDIAN_INTERVAL_S, GUARDIAN_LOOKS, KEY_DIGITS, LOCK, MEMORY, ORPHAN

# From <fcntl.h>: locks that belong to the open file, not to the process.
F_OFD_GETLK, F_OFD_SETLK = 36, 37
# struct flock on 64-bit Linux: type, whence, start, length, pid.
FLOCK = "hh4xqqi4x"
WHOLE_FILE = struct.pack(FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)


class Place:
    """Paths of a session."""

    def __init__(self, session):
        if not re.fullmatch(r"[A-Za-z0-9._-]{1,64}", session):
            raise Fault(f"`{session}` cannot name a session: 1 to 64 letters, digits, `-`, `_` and `.` are allowed")
        key = f"{fnv(session.encode()):016x}"[:KEY_DIGITS]
        self.session = session
        self.prefix = f"rs{key}_"
        self.folder = Path(f"{MEMORY}/ripstop-{os.geteuid()}") / key

    def lock_file(self, holder):
        """The lock of `coupler` or of a rank such as `mesh.0`."""
        return self.folder / f"{LOCK}{holder}"

    def notice(self):
        """What the coupler wrote for its participants; None until it has."""
        try:
            notice = json.loads((self.folder / "session.json").read_text())
        except (OSError, ValueError):
            return None
        return notice if notice.get("session") == self.session else None


class Lock:
    """A lock that the kernel frees when this process ends, however it ends."""

    def __init__(self, path):
        self.file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.fcntl(self.file, F_OFD_SETLK, WHOLE_FILE)
        except OSError:
            os.close(self.file)
            raise


class Watch:
    """Observes the lock of another process."""

    def __init__(self, path):
        self.file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def is_held(self):
        """Whether the process that took the lock lives."""
        answer = fcntl.fcntl(self.file, F_OFD_GETLK, WHOLE_FILE)
        return struct.unpack(FLOCK, answer)[0] != fcntl.F_UNLCK


def find_coupler(place, timeout_s=None):
    """Notice and watch of a live coupler; waits for `timeout_s` seconds (None: for ever)."""
    start = time.monotonic()
    while True:
        notice = place.notice()
        try:
            watch = Watch(place.lock_file("coupler")) if notice else None
        except FileNotFoundError:
            watch = None
        if watch and watch.is_held():
            break
        if watch:
            os.close(watch.file)
        if timeout_s is not None and time.monotonic() - start >= timeout_s:
            raise Fault(
                f"no coupler opened session `{place.session}` within {timeout_s:.1f} s: "
                "start `ripstop run` or `ripstop attach` first"
            )
        time.sleep(0.02)
    if notice["contract"] != VERSION:
        raise Fault(
            f"the coupler of session `{place.session}` uses contract version {notice['contract']}, "
            f"this participant uses {VERSION}: build both from the same version"
        )
    return notice, watch


class Guardian:
    """A thread that ends this process 2 s after the coupler's death, also in the
    middle of a computation, until it is dismissed."""

    def __init__(self, notice, watch):
        self.dismissed = threading.Event()
        self.notice, self.watch = notice, watch
        threading.Thread(target=self._look, daemon=True, name="guardian").start()

    def _look(self):
        alone = 0
        while not self.dismissed.wait(GUARDIAN_INTERVAL_S):
            alone = 0 if self.watch.is_held() else alone + 1
            if alone == GUARDIAN_LOOKS:
                text = (
                    f"the coupler of session `{self.notice['session']}` (process {self.notice['pid']}) died; "
                    f"this process ({os.getpid()}) ends in the middle of its computation\n"
                )
                try:
                    os.write(2, text.encode())
                finally:
                    os._exit(ORPHAN)
