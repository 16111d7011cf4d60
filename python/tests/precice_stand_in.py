"""A stand-in for the module `precice`: two participants of one process, each in its thread.

It follows the documented API of preCICE 3 for what `python/ripstop/precice` uses: one serial-implicit or serial-explicit
scheme whose first participant sets the length of windows, nearest-neighbor mappings at the first participant, one absolute
convergence measure, checkpoints, and interpolation within a window. Misuse that preCICE reports is an `Error` here too."""

import queue

import numpy as np

# Longest wait for the other participant, s.
WAIT_S = 20.0

# Configuration by participant: the two queues between them.
_lines = {}


class Error(RuntimeError):
    """An error of preCICE."""


def reset():
    """Removes all participants."""
    _lines.clear()


def nearest(there, here):
    """Index of the nearest of `there` for each of `here`."""
    return np.array([np.argmin(np.sum((there - x) ** 2, axis=1)) for x in here])


class Participant:
    """One of the two participants of a configuration file."""

    def __init__(self, name, config, rank, size):
        from ripstop.precice.config import parse

        root = parse(config)
        self.name, self.scheme = name, next(e for e in root if e.tag.startswith("coupling-scheme."))
        roles = self.scheme.find("participants")
        self.first = roles.get("first") == name
        if not self.first and roles.get("second") != name:
            raise Error(f"participant {name} is not in the configuration")
        self.implicit = self.scheme.tag.endswith("implicit")
        self.max_time = float(self.scheme.find("max-time").get("value"))
        self.degree = {e.get("name"): int(e.get("waveform-degree", "1")) for e in root if e.tag.startswith("data.")}
        self.width = {e.get("name"): () if e.tag == "data.scalar" else (3,) for e in root if e.tag.startswith("data.")}
        me = next(e for e in root.findall("participant") if e.get("name") == name)
        self.provided = [e.get("name") for e in me.findall("provide-mesh")]
        self.written = {(e.get("mesh"), e.get("name")) for e in me.findall("write-data")}
        self.readable = {(e.get("mesh"), e.get("name")) for e in me.findall("read-data")}
        self.exchanges = [dict(e.attrib) for e in self.scheme.findall("exchange")]
        self.mappings = [dict(e.attrib) for e in me if e.tag.startswith("mapping.")]
        lines = _lines.setdefault(str(config), (queue.Queue(), queue.Queue()))
        self.out, self.incoming = lines if self.first else lines[::-1]
        self.meshes, self.values, self.samples, self.previous = {}, {}, {}, {}
        self.time, self.progress, self.window = 0.0, 0.0, None
        self.initialized = self.complete = False
        self.actions = {"initial": self.first, "write": False, "read": False}

    # Meshes.

    def set_mesh_vertices(self, mesh, positions):
        if mesh not in self.provided:
            raise Error(f"participant {self.name} does not provide mesh {mesh}")
        self.meshes[mesh] = np.array(positions)
        return np.arange(len(positions))

    def set_mesh_triangles(self, mesh, vertices):
        if np.max(vertices) >= len(self.meshes[mesh]):
            raise Error(f"mesh {mesh} has no such vertex")

    # Actions and state.

    def requires_initial_data(self):
        return self._fulfil("initial")

    def requires_writing_checkpoint(self):
        return self._fulfil("write")

    def requires_reading_checkpoint(self):
        return self._fulfil("read")

    def _fulfil(self, action):
        required, self.actions[action] = self.actions[action], False
        return required

    def is_coupling_ongoing(self):
        return self.time < self.max_time - 1e-14

    def is_time_window_complete(self):
        return self.complete

    def get_max_time_step_size(self):
        if not self.is_coupling_ongoing():
            return 0.0
        return self.max_time - self.time if self.first else self.window - self.progress

    # Data.

    def write_data(self, mesh, name, ids, values):
        if (mesh, name) not in self.written:
            raise Error(f"participant {self.name} does not write {name} on {mesh}")
        if not np.isfinite(values).all():
            raise Error(f"data {name} is not finite")
        self.values[mesh, name] = np.array(values)

    def read_data(self, mesh, name, ids, relative_time):
        if (mesh, name) not in self.readable:
            raise Error(f"participant {self.name} does not read {name} on {mesh}")
        start, end = self.samples[mesh, name]
        if self.window is None:
            return np.array(end)
        s = (self.progress + relative_time) / self.window
        if not -1e-12 < s < 1 + 1e-12:
            raise Error(f"data {name} is read {relative_time} s from now, outside of the window")
        if self.degree[name] == 0:
            return np.array(start if s < 1e-12 else end)
        return (1 - s) * start + s * end

    def _mapped(self, data, direction):
        """Data of one participant on the meshes of the other; the first one maps."""
        out = {}
        for mapping in (m for m in self.mappings if m["direction"] == direction):
            there, here = self.meshes[mapping["from"]], self.meshes[mapping["to"]]
            for (mesh, name), values in data.items():
                if mesh != mapping["from"]:
                    continue
                if mapping["constraint"] == "consistent":
                    out[mapping["to"], name] = values[nearest(there, here)]
                else:
                    out[mapping["to"], name] = np.zeros((len(here), *values.shape[1:]))
                    np.add.at(out[mapping["to"], name], nearest(here, there), values)
        return out

    # Coupling.

    def _get(self):
        try:
            return self.incoming.get(timeout=WAIT_S)
        except queue.Empty:
            raise Error(f"the other participant of {self.name} sent nothing for {WAIT_S} s") from None

    def initialize(self):
        if self.actions["initial"]:
            raise Error("data was not initialized")
        self.initialized, self.actions["write"] = True, self.implicit
        if self.first:
            self.meshes |= self._get()
            self.out.put(self._mapped(self.values, "write"))
            self.samples = {key: 2 * (np.zeros((len(self.meshes[key[0]]), *self.width[key[1]])),) for key in self.readable}
        else:
            self.out.put(self.meshes)
            self.samples = {key: (value, value) for key, value in self._get().items()}
            self.previous = {key: sample[1] for key, sample in self.samples.items()}
            self._next_step(True)

    def _next_step(self, new):
        """The second participant receives data for an iteration."""
        dt, data = self._get()
        if not new and dt != self.window:
            raise Error("may only use a larger time window size in the first iteration of the window")
        self.window, self.progress = dt, 0.0
        for key, value in data.items():
            self.samples[key] = (self.samples[key][1] if new else self.samples[key][0], value)

    def advance(self, dt):
        if any(self.actions.values()):
            raise Error(f"an action was not fulfilled: {self.actions}")
        if dt > self.get_max_time_step_size() * (1 + 1e-12):
            raise Error(f"the time step {dt} exceeds the maximum {self.get_max_time_step_size()}")
        self.complete = False
        if self.first:
            self.out.put((dt, self._mapped(self.values, "write")))
            self.complete, data = self._get()
            start = {key: sample[0] for key, sample in self.samples.items()}
            for key, value in self._mapped(data, "read").items():
                self.samples[key] = (value if self.complete else start[key], value)
            self.time += dt if self.complete else 0.0
            self.window = None if self.complete else dt
            self._require()
            return
        self.progress += dt
        if self.progress < self.window * (1 - 1e-12):
            return
        self.complete = self._converged()
        self.previous = {key: sample[1] for key, sample in self.samples.items()}
        self.time += self.window if self.complete else 0.0
        self._require()
        self.out.put((self.complete, dict(self.values)))
        if self.is_coupling_ongoing():
            self._next_step(self.complete)

    def _require(self):
        """Actions after the end of an iteration."""
        self.actions["read"] = self.implicit and not self.complete
        self.actions["write"] = self.implicit and self.complete and self.is_coupling_ongoing()

    def _converged(self):
        """The decision of the second participant."""
        measure = self.scheme.find("absolute-convergence-measure")
        if measure is None:
            return True
        key = measure.get("mesh"), measure.get("data")
        return np.linalg.norm(self.samples[key][1] - self.previous[key]) <= float(measure.get("limit"))

    def finalize(self):
        if not self.initialized:
            raise Error("finalize before initialize")
