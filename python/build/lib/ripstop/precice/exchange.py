"""Windows of Ripstop as time windows of preCICE.

Ripstop repeats a window until it accepts it; it decides after it has the response. preCICE (serial-implicit) lets its
second participant decide when that one answers. So the bridge is the first participant, and the only convergence
measure is the change of the scalar `Iteration`:

| Ripstop | data written | `Iteration` | preCICE |
|---|---|---|---|
| `advance(n, k)` | those of iteration k | one more than before | not converged: the solver returns to its checkpoint |
| `accept(n)` | those of the accepted iteration, again | unchanged | converged: the solver keeps this state |

The solver computes the accepted iteration twice; both responses are compared. It returns from its last `advance` of a
window when the next one begins, so before a state is saved the bridge begins that window (`Exchange.complete`). With a
serial-explicit scheme there is one iteration in each window, and nothing is computed twice.
"""

import numpy as np

from ..contract import Window
from .errors import CouplingError

# The counter whose change is the convergence measure of preCICE.
COUNTER = "Iteration"

# Relative difference up to which two lengths of time are the same.
SAME_TIME = 1e-9

# Relative difference up to which data are the same.
SAME_DATA = 1e-9

# Difference, s, up to which preCICE takes two times as the same (1e-14, `math/differences.hpp`), with a margin.
PRECICE_TIME = 5e-15

# Largest difference of the two responses to an accepted iteration, relative to the change over the window.
REPEAT_TOLERANCE = 1e-3


class Field:
    """Data `name` on the mesh `mesh` of the bridge."""

    def __init__(self, name, mesh):
        self.name, self.mesh = name, mesh


class Exchange:
    """Couples windows through `participant`, a `precice.Participant`.

    `meshes` has the positions `[vertices][3]` (m) by the name of the mesh, `triangles` their vertices `[..][3]`;
    `writes` and `reads` are lists of `Field`. The counter is written on the mesh of the first field. `linear`: preCICE
    interpolates what is written from one window to the next; otherwise it is constant in a window."""

    def __init__(self, participant, meshes, writes, reads, triangles=None, linear=False, repeat_tolerance=REPEAT_TOLERANCE):
        self.participant, self.writes, self.reads, self.linear = participant, writes, reads, linear
        self.tolerance = repeat_tolerance
        self.ids = {name: participant.set_mesh_vertices(name, at) for name, at in meshes.items()}
        for name, corners in (triangles or {}).items():
            if len(corners):
                participant.set_mesh_triangles(name, self.ids[name][corners])
        self.implicit = None  # known after the start
        self.open = None  # index of the window that is not accepted
        self.length = None  # of the last window, s
        self.ahead = False  # the next window was begun before Ripstop asked for it
        self.counter = 0
        self.data = self.response = self.held = None  # `held`: data at the start of the window
        self.accepted = None  # response to the last accepted window

    def solve(self, window, start, end):
        """The response (by names of `reads`) to data `end` at the end of a window; `start` are those at its start.
        Both are by names of `writes`."""
        if self.implicit is None:
            self.begin(start)
        if self.open not in (None, window.index):
            raise CouplingError(f"window {window.index} begins, but window {self.open} was not accepted")
        if self.open is not None and not self.implicit:
            raise CouplingError(
                f"window {window.index} is repeated (iteration {window.iteration}), but the scheme in the configuration of "
                "preCICE is explicit: write it for an implicit scheme, or set `coupling.scheme = \"staggered\"` in the scene"
            )
        if (self.open is not None or self.ahead) and self.length != window.dt:
            raise CouplingError(
                f"window {window.index} is repeated with a length of {window.dt} s after {self.length} s: preCICE keeps the "
                "length of a window that it repeats; disable `coupling.adaptive`"
            )
        self.continues(window, start, end)
        self.open, self.length, self.ahead = window.index, window.dt, False
        self.counter += 1
        self.data = {name: np.array(values) for name, values in end.items()}
        complete = self.advance(window)
        if complete and self.implicit:
            raise CouplingError(
                f"preCICE completed window {window.index} in iteration {window.iteration}, before Ripstop accepted it: the "
                f"convergence measure of its configuration must be that of the data `{COUNTER}` alone, without "
                "max-iterations, as --write-config writes it"
            )
        if not complete and not self.implicit:
            raise self.unfinished(window)
        self.response = self.read(0.0 if complete else window.dt)
        return self.response

    def accept(self, window):
        """The last response is final."""
        if self.open is None or self.open != window.index:
            raise CouplingError(f"window {window.index} is accepted, but the last one computed is {self.open}")
        if self.implicit:
            if not self.advance(window):
                raise CouplingError(
                    f"preCICE did not complete window {window.index}, which Ripstop accepted: the convergence measure of "
                    f"its configuration must be that of the data `{COUNTER}` alone, as --write-config writes it"
                )
            self.compare(window, self.read(0.0))
        self.open, self.accepted, self.held = None, self.response, self.data

    def complete(self, window):
        """Begins the window after `window`, the last accepted one, with the same data: the solver then completes that one,
        and writes its checkpoint. Nothing in an explicit scheme, in which a window cannot be repeated."""
        if self.implicit and self.open is None and not self.ahead and self.ongoing():
            dt = window.dt
            if self.participant.get_max_time_step_size() < dt * (1 - SAME_TIME):
                return
            self.counter += 1
            self.advance(Window(index=window.index + 1, time=window.time + dt, dt=dt))
            self.ahead = True

    def ongoing(self):
        """Whether preCICE expects more windows."""
        return self.implicit is None or self.participant.is_coupling_ongoing()

    def begin(self, start):
        """Connects to the solver."""
        self.held = start
        if self.participant.requires_initial_data():
            self.write(start)
        self.participant.initialize()
        self.implicit = self.participant.requires_writing_checkpoint()

    def continues(self, window, start, end):
        """Refuses data between which preCICE interpolates in another way than Ripstop."""
        for name, values in start.items():
            before = self.held[name] if self.linear else end[name]
            scale, jump = (np.abs(x).max(initial=0.0) for x in (values, values - before))
            if jump > SAME_DATA * scale:
                there = "the end of the last one" if self.linear else "its end, but preCICE keeps it constant in a window"
                raise CouplingError(
                    f"`{name}` at the start of window {window.index} (iteration {window.iteration}) differs by {jump:.3e} from "
                    f"{there} (largest value {scale:.3e}): set `coupling.load_interpolation` of the scene to "
                    '"mean" or "constant", and write the configuration again'
                )

    def write(self, data):
        """Writes data and the counter."""
        for field in self.writes:
            self.participant.write_data(field.mesh, field.name, self.ids[field.mesh], data[field.name])
        ids = self.ids[self.writes[0].mesh]
        self.participant.write_data(self.writes[0].mesh, COUNTER, ids, np.full(len(ids), float(self.counter)))

    def read(self, after):
        """Values by names of `reads`, `after` seconds from now."""
        read = self.participant.read_data
        return {f.name: np.array(read(f.mesh, f.name, self.ids[f.mesh], after)) for f in self.reads}

    def advance(self, window):
        """One iteration of preCICE with the present data; whether it completed the window."""
        participant = self.participant
        if not participant.is_coupling_ongoing():
            raise CouplingError(
                f"window {window.index} begins at {window.time} s, after the max-time of the configuration of preCICE: write "
                "it again for this scene with --write-config"
            )
        participant.requires_writing_checkpoint()  # the bridge has no state: nothing to write
        left = participant.get_max_time_step_size()
        if window.dt > left * (1 + SAME_TIME):
            raise CouplingError(
                f"window {window.index} is {window.dt} s long, but preCICE ends after {left} s: its configuration needs "
                '<time-window-size method="first-participant"/> and the max-time of the stage; write it with --write-config'
            )
        self.write(self.data)
        # The last window ends at max-time, whatever the sum of all lengths is.
        rounding = PRECICE_TIME < abs(left - window.dt) < SAME_TIME * window.dt
        participant.advance(left if rounding else window.dt)
        repeat, complete = participant.requires_reading_checkpoint(), participant.is_time_window_complete()
        if not repeat and not complete:
            raise self.unfinished(window)
        return complete

    @staticmethod
    def unfinished(window):
        """The error for a window of preCICE that is longer than that of Ripstop."""
        return CouplingError(
            f"preCICE did not complete its time window after the {window.dt} s of window {window.index}: its configuration "
            'needs <time-window-size method="first-participant"/>'
        )

    def compare(self, window, again):
        """Refuses a solver whose second response to an accepted iteration is another one."""
        for name, values in again.items():
            before = 0.0 if self.accepted is None else self.accepted[name]
            scale = np.abs(values - before).max(initial=0.0)
            found = np.abs(values - self.response[name]).max(initial=0.0)
            if found > self.tolerance * scale:
                raise CouplingError(
                    f"the solver behind preCICE answered twice to the same data in window {window.index}, and its `{name}` "
                    f"differs by {found:.3e} (change over the window: {scale:.3e}): its checkpoint does not hold all of its "
                    "state, or it solves to a loose tolerance (--repeat-tolerance)"
                )
