"""The bridge to preCICE, with a stand-in for preCICE."""

import re
import sys
import threading
import types
import unittest
from pathlib import Path

import numpy as np
import precice_stand_in
from common import file, scratch
from ripstop.contract import Window
from ripstop.precice import config, worker
from ripstop.precice.bridge import FlowBridge
from ripstop.precice.errors import ConfigError, CouplingError, PreciceError, PreciceMissing, SolverEnded
from ripstop.precice.exchange import Exchange, Field
from ripstop.precice.solver import Solver, packed, unpack
from ripstop.precice.surface import Surface

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]])
STAGE = {"name": "descent", "kind": "coupled", "duration_s": 0.4, "window_s": 0.1}


def scene(interpolation):
    """What the bridge reads of a scene with defaults."""
    return {"coupling": {"load_interpolation": interpolation}, "stage": [STAGE]}


def written(name, interpolation="linear", change=lambda text: text, **words):
    """Path of a configuration with forces."""
    text = config.text(scene("mean"), STAGE, "structure", "force", **words)
    if interpolation == "linear":
        text = text.replace('waveform-degree="0"', 'waveform-degree="1"')
    return file(f"precice/{name}.xml", change(text))


def example(name):
    """Text of a file below `python/examples`."""
    return (Path(__file__).resolve().parents[1] / "examples" / name).read_text(encoding="utf-8")


class Oscillators:
    """A solver behind preCICE: four masses on springs, with `steps` steps in a window. Its checkpoint is complete
    unless `forgetful`. `solves` counts time windows that it computed."""

    def __init__(self, path, steps=3, forgetful=False):
        self.path, self.steps, self.forgetful = path, steps, forgetful
        self.u, self.v, self.solves, self.error = np.zeros((4, 3)), np.zeros((4, 3)), 0, None
        self.thread = threading.Thread(target=self.run, daemon=True)

    def step(self, h, force):
        """One step of `h` seconds."""
        self.v = self.v + h * (force - 40.0 * self.u)
        self.u = self.u + h * self.v

    def run(self):
        """Couples until the end."""
        try:
            participant = precice_stand_in.Participant("Solid", self.path, 0, 1)
            ids = participant.set_mesh_vertices("Solid-Nodes", POINTS[::-1])
            participant.initialize()
            taken = 0
            while participant.is_coupling_ongoing():
                if participant.requires_writing_checkpoint():
                    self.kept = self.u, self.v
                left = participant.get_max_time_step_size()
                h = left / (self.steps - taken)
                self.step(h, participant.read_data("Solid-Nodes", "Force", ids, 0.5 * h))
                taken = (taken + 1) % self.steps
                participant.write_data("Solid-Nodes", "Displacement", ids, self.u)
                participant.advance(h)
                self.solves += taken == 0
                if participant.requires_reading_checkpoint() and not self.forgetful:
                    self.u, self.v = self.kept
        except precice_stand_in.Error as error:
            self.error = error


def start(path, **words):
    """An exchange and the solver behind it."""
    precice_stand_in.reset()
    solver = Oscillators(path, **words)
    solver.thread.start()
    participant = precice_stand_in.Participant("Ripstop", path, 0, 1)
    nodes = config.NODES
    linear = 'waveform-degree="1"' in path.read_text()
    fields = [Field("Force", nodes)], [Field("Displacement", nodes)]
    return Exchange(participant, {nodes: POINTS}, *fields, linear=linear), solver


def force(window, iteration):
    """Some load of an iteration."""
    return np.sin(1.0 + window + 0.3 * iteration + np.arange(12.0).reshape(4, 3))


# Iterations of each window: how often Ripstop repeats it before it accepts it.
ITERATIONS, LENGTHS = (1, 4, 2, 3), (0.1, 0.1, 0.1, 0.1)


def couple(exchange, iterations=ITERATIONS, lengths=LENGTHS, constant=False, save=lambda window: None):
    """Responses to all iterations of some windows; each window is accepted, then `save` is called."""
    out, before, time = [], np.zeros((4, 3)), 0.0
    for n, (count, dt) in enumerate(zip(iterations, lengths)):
        for k in range(count):
            window, end = Window(index=n, iteration=k, time=time, dt=dt), force(n, k)
            begin = end if constant else before
            out.append(exchange.solve(window, {"Force": begin}, {"Force": end})["Displacement"])
        exchange.accept(window)
        save(window)
        before, time = end, time + dt
    return out


def direct(iterations=ITERATIONS, lengths=LENGTHS, constant=False, steps=3):
    """The same without preCICE."""
    solver, out, before = Oscillators(None), [], np.zeros((4, 3))
    for n, (count, dt) in enumerate(zip(iterations, lengths)):
        kept = solver.u, solver.v
        for k in range(count):
            solver.u, solver.v = kept
            for i in range(steps):
                s = 1.0 if constant else (i + 0.5) / steps
                solver.step(dt / steps, (1 - s) * before + s * force(n, k))
            out.append(solver.u)
        before = force(n, count - 1)
    return out


class Windows(unittest.TestCase):
    def equal(self, found, expected):
        self.assertEqual(len(found), len(expected))
        for a, b in zip(found, expected):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)

    def test_repeated_windows_give_the_responses_of_the_solver_alone(self):
        exchange, solver = start(written("repeats"))
        self.equal(couple(exchange), direct())
        solver.thread.join(5.0)
        self.assertIsNone(solver.error)
        self.assertFalse(exchange.ongoing())
        # Each accepted iteration is computed twice.
        self.assertEqual(solver.solves, sum(ITERATIONS) + len(ITERATIONS))
        # The solver keeps the state of the accepted iterations.
        np.testing.assert_allclose(solver.u[::-1], direct()[-1], rtol=0, atol=1e-14)

    def test_windows_may_have_unequal_lengths(self):
        lengths = (0.05, 0.2, 0.1, 0.05)
        exchange, _ = start(written("lengths"))
        self.equal(couple(exchange, lengths=lengths), direct(lengths=lengths))

    def test_the_solver_completes_a_window_before_it_is_saved(self):
        exchange, solver = start(written("saved"))
        states = []

        def save(window):
            exchange.complete(window)
            exchange.complete(window)  # begins the next window once
            states.append(solver.kept[0][::-1])

        self.equal(couple(exchange, save=save), direct())
        # The checkpoint after each window but the last, in which the solver ends.
        ends = np.cumsum(ITERATIONS) - 1
        self.equal(states[:3], [direct()[k] for k in ends[:3]])
        solver.thread.join(5.0)
        self.assertEqual(solver.solves, sum(ITERATIONS) + len(ITERATIONS) + 3)

    def test_loads_that_are_constant_in_a_window_stay_so(self):
        exchange, _ = start(written("constant", "constant"))
        self.equal(couple(exchange, constant=True), direct(constant=True))

    def test_explicit_schemes_compute_nothing_twice(self):
        once = (1, 1, 1, 1)
        exchange, solver = start(written("explicit", explicit=True))
        self.equal(couple(exchange, once), direct(once))
        solver.thread.join(5.0)
        self.assertEqual(solver.solves, 4)

    def fails(self, text, exchange, *windows, jumps=False):
        """Windows given as (index, iteration, dt), None accepts the last one."""
        with self.assertRaisesRegex(CouplingError, text):
            for entry in windows:
                if entry is None:
                    exchange.accept(window)
                elif entry == "save":
                    exchange.complete(window)
                else:
                    window = Window(index=entry[0], iteration=entry[1], dt=entry[2])
                    end = force(*entry[:2])
                    exchange.solve(window, {"Force": 0 * POINTS if jumps else end}, {"Force": end})

    def test_windows_out_of_order_are_refused(self):
        exchange, _ = start(written("explicit-repeat", "mean", explicit=True))
        self.fails("window 0 is repeated .* scheme .* is explicit", exchange, (0, 0, 0.1), (0, 1, 0.1))
        exchange, _ = start(written("not-accepted", "mean"))
        self.fails("window 1 begins, but window 0 was not accepted", exchange, (0, 0, 0.1), (1, 0, 0.1))
        exchange, _ = start(written("shorter", "mean"))
        self.fails("window 0 is repeated with a length of 0.05 s after 0.1 s", exchange, (0, 0, 0.1), (0, 1, 0.05))
        exchange, _ = start(written("saved-shorter", "mean"))
        self.fails("window 1 is repeated with a length of 0.05 s", exchange, (0, 0, 0.1), None, "save", (1, 0, 0.05))
        exchange, _ = start(written("accepted-twice", "mean"))
        self.fails("window 0 is accepted, but the last one computed is None", exchange, (0, 0, 0.1), None, None)
        exchange, _ = start(written("long", "mean"))
        self.fails("window 0 is 0.5 s long, but preCICE ends after 0.4 s", exchange, (0, 0, 0.5))
        exchange, _ = start(written("end", "mean"))
        self.fails("after the max-time", exchange, (0, 0, 0.4), None, (1, 0, 0.1))

    def test_loads_between_which_precice_would_interpolate_wrongly_are_refused(self):
        windows = (0, 0, 0.1), None, (1, 0, 0.1)
        exchange, _ = start(written("jump"))
        self.fails("`Force` at the start of window 1 .* differs by .* from the end of the last", exchange, *windows, jumps=True)
        exchange, _ = start(written("slope", "mean"))
        self.fails("`Force` at the start of window 0 .* from its end, but preCICE keeps it", exchange, *windows, jumps=True)

    def test_decisions_of_precice_are_refused(self):
        exchange, _ = start(written("early", "mean", change=lambda text: text.replace('limit="0.5"', 'limit="100"')))
        self.fails("preCICE completed window 0 in iteration 0, before Ripstop accepted it", exchange, (0, 0, 0.1))
        exchange, _ = start(written("never", "mean", change=lambda text: text.replace('limit="0.5"', 'limit="-1"')))
        self.fails("preCICE did not complete window 0, which Ripstop accepted", exchange, (0, 0, 0.1), None)

    def test_solvers_without_a_complete_checkpoint_are_refused(self):
        exchange, _ = start(written("forgetful", "mean"), forgetful=True)
        self.fails("answered twice to the same data in window 0, and its `Displacement` differs", exchange, (0, 0, 0.1), None)


class Configuration(unittest.TestCase):
    def test_written_configurations_pass_the_check(self):
        for role in ("structure", "flow"):
            for load in ("pressure", "force"):
                for interpolation in (None, "linear"):
                    for explicit in (False, True):
                        of = scene(interpolation)
                        if (role, interpolation) == ("structure", "linear") and (load, explicit) != ("pressure", True):
                            with self.assertRaisesRegex(ConfigError, "passes through preCICE only with --load pressure"):
                                config.text(of, STAGE, role, load, explicit=explicit)
                            continue
                        text = config.text(of, STAGE, role, load, explicit=explicit)
                        config.check(file("precice/written.xml", text), role, load, of)

    def test_configurations_that_would_give_another_run_are_refused(self):
        for change, error in [
            (("serial-implicit", "multi"), "must be one serial-implicit or serial-explicit, found coupling-scheme:multi"),
            (('first="Ripstop" second="Solid"', 'first="Solid" second="Ripstop"'), "`first` of <participants> must be"),
            (('limit="0.5" data="Iteration"', 'limit="0.5" data="Force"'), "only convergence measure"),
            (('<participants', '<max-iterations value="5"/><participants'), "remove <max-iterations>"),
            (('<participants', '<acceleration:aitken/><participants'), "remove <acceleration:aitken>"),
            (('"Force" waveform-degree="0"', '"Force" waveform-degree="1"'), "waveform-degree of `Force` is 1, .* asks for 0"),
            (('vector name="Force"', 'vector name="Push"'), "has no data `Force`, which the bridge writes with --load force"),
            (("</precice-configuration>", ""), "is no XML"),
        ]:
            path = written("refused", "mean", change=lambda text: text.replace(*change))
            with self.assertRaisesRegex(ConfigError, error, msg=error):
                config.check(path, "structure", "force", scene("mean"))
        with self.assertRaisesRegex(ConfigError, "cannot be read .*: write it with --write-config"):
            config.check(scratch() / "none.xml", "structure", "force", scene("mean"))

    def test_a_flow_in_a_fixed_frame_reads_no_velocity_of_it(self):
        of = scene("mean")
        text = {fixed: config.text(of, STAGE, "flow", "force", fixed_frame=fixed) for fixed in (False, True)}
        self.assertEqual([config.FRAME_VELOCITY in text[fixed] for fixed in (False, True)], [True, False])
        for fixed in (False, True):
            config.check(file("precice/frame.xml", text[fixed]), "flow", "force", of, fixed)
        with self.assertRaisesRegex(ConfigError, "has the data `FrameVelocity`, which is not written with --fixed-frame"):
            config.check(file("precice/frame.xml", text[False]), "flow", "force", of, True)
        with self.assertRaisesRegex(ConfigError, "has no data `FrameVelocity`, .*: write it again, or run with --fixed-frame"):
            config.check(file("precice/frame.xml", text[True]), "flow", "force", of)

    def test_examples_with_adapters_name_what_the_bridge_writes(self):
        """Meshes and data in the files of the adapters are those of the configuration that their pages tell to write."""
        solid = config.text(scene("mean"), STAGE, "structure", "force")
        text = example("calculix-cavity/config.yml")
        (mesh,) = re.findall(r"nodes-mesh: (\S+)", text)
        for tag in ("read-data", "write-data"):
            (name,) = re.findall(rf"{tag}: \[(\S+)\]", text)
            self.assertIn(f'<{tag} name="{name}" mesh="{mesh}"/>', solid)
        named = config.text(scene("mean"), STAGE, "flow", "force", fixed_frame=True)
        adapter = example("openfoam-cavity/system/preciceDict")
        self.assertIn("Fluid", re.findall(r"participant\s+(\S+);", adapter))
        meshes = re.findall(r"mesh\s+(\S+);.*?readData\s*\((.*?)\);\s*writeData\s*\((.*?)\);", adapter, re.DOTALL)
        self.assertEqual(len(meshes), 2)
        for mesh, read, write in meshes:
            for tag, names in (("read-data", read), ("write-data", write)):
                for name in names.split():
                    self.assertIn(f'<{tag} name="{name}" mesh="{mesh}"/>', named)

    def test_a_frame_that_moves_is_refused_where_its_velocity_is_not_read(self):
        flow = object.__new__(FlowBridge)
        window = Window(index=7, frame_velocity=(0.0, 0.0, -3.0))
        flow.fixed_frame = False
        self.assertEqual(flow.frame_velocity(window).tolist(), [0.0, 0.0, -3.0])
        flow.fixed_frame = True
        with self.assertRaisesRegex(CouplingError, "moves with 3 m/s in window 7, but with --fixed-frame"):
            flow.frame_velocity(window)
        self.assertEqual(flow.frame_velocity(Window(index=8)).tolist(), [0.0, 0.0, 0.0])

    def test_max_time_is_that_of_whole_windows(self):
        self.assertEqual(config.duration({"duration_s": 0.104, "window_s": 0.01}), 0.1)
        self.assertIn('<max-time value="0.4"/>', written("time").read_text())


FAKE = """
import os
class Participant:
    def __init__(self, name, config, rank, size):
        self.config = config
    def advance(self, dt):
        if self.config == "fails":
            raise RuntimeError("the socket was closed")
        if self.config == "dies":
            os._exit(7)
        while self.config == "waits":
            pass
        return dt
"""


class Processes(unittest.TestCase):
    def remote(self, what, source=FAKE, observe=lambda: None):
        """preCICE in another process, by a module of ours."""
        folder = file(f"fake-{what}/precice.py", source).parent
        sys.path.insert(0, str(folder))
        try:
            return worker.Remote("Ripstop", what, observe)
        finally:
            sys.path.remove(str(folder))

    def test_calls_and_failures_of_precice(self):
        remote = self.remote("works")
        self.assertEqual(remote.advance(0.5), 0.5)
        remote.kill()
        with self.assertRaisesRegex(PreciceError, "preCICE failed in `advance`: the socket was closed"):
            self.remote("fails").advance(0.5)
        with self.assertRaisesRegex(PreciceError, "process of preCICE ended in `advance` with code 7"):
            self.remote("dies").advance(0.5)

    def test_the_end_of_the_solver_ends_a_wait(self):
        looks = []

        def observe():
            looks.append(1)
            if len(looks) > 3:
                raise SolverEnded("it ended")

        remote = self.remote("waits", observe=observe)
        with self.assertRaisesRegex(SolverEnded, "it ended"):
            remote.advance(0.5)
        remote.kill()

    def test_ends_of_a_solver(self):
        run = types.SimpleNamespace(scene="s", stage=0, out="o")

        def solver(command):
            return Solver(command, run, "c", None, scratch() / "save")

        failed = solver("sh -c 'test -d $RIPSTOP_SAVE && exit 3'")
        failed.child.wait()
        with self.assertRaisesRegex(SolverEnded, "ended with code 3 before the stage did: see"):
            failed.observe()
        # preCICE may return here only after the solver has ended well.
        good = solver("sh -c 'echo x >$RIPSTOP_SAVE/file'")
        good.wait()
        good.observe()
        good.ended -= 60.0
        with self.assertRaisesRegex(SolverEnded, "code 0 before the stage did .without its adapter .* was it loaded"):
            good.observe()
        unpack(packed(good.save_folder), scratch() / "again")
        self.assertEqual((scratch() / "again/file").read_text(), "x\n")
        with self.assertRaisesRegex(SolverEnded, "cannot be started"):
            solver("/nowhere/solver")

    def test_missing_bindings_name_what_to_install(self):
        with self.assertRaisesRegex(PreciceMissing, "no libprecice.*install the library preCICE 3 .*pip install pyprecice"):
            self.remote("missing", "raise ImportError('no libprecice')")


class Loads(unittest.TestCase):
    def test_forces_and_loads_of_faces_are_inverse(self):
        surface = Surface([[0, 1, 3, 2], [0, 1, 3, 3]], 4)
        load = force(0, 0)[:2, [0, 1, 2, 0]]
        # Traction along the normal is pressure.
        forces = surface.forces(POINTS, load)
        again = surface.load(POINTS, forces)
        np.testing.assert_allclose(surface.forces(POINTS, again), forces, rtol=0, atol=1e-14)
        np.testing.assert_allclose(np.sum(again[:, 1:] * surface.areas(POINTS), axis=1), 0.0, atol=1e-15)
        np.testing.assert_allclose(surface.nodal(forces).sum(axis=0), forces.sum(axis=0), rtol=0, atol=1e-15)
        np.testing.assert_allclose(surface.centres(POINTS)[1], POINTS[[0, 1, 3]].mean(axis=0))
        self.assertEqual(surface.triangles().tolist(), [[0, 1, 3], [0, 1, 3], [0, 3, 2]])


if __name__ == "__main__":
    unittest.main()
