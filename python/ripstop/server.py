"""Serves one rank of a participant."""

import json
import os
import sys
import time
import traceback
from pathlib import Path

import numpy as np

from . import contract
from .contract import COUPLER, INPUT, OUTPUT, ROLES, STATISTICS, WIDTH, Fault, Header, Kind, Unit, Window
from .contract import during, service
from .participant import Run
from .session import Guardian, Lock, Place, find_coupler
from .table import LOOK_S, TEXT_WORDS
from .transport import Link


class Ended(Exception):
    """The run ended, other than by `stop`; the coupler knows, or is dead."""


def main(make):
    """Runs a participant as a program: `make(run)` builds it from the `Run`. Ends the
    process with code 0 after a good end."""
    run = Run()
    role = make.role
    try:
        place = Place(run.session)
        if place.notice():
            guardian = Guardian(*find_coupler(place, 0.2))
        else:
            guardian = None
        try:
            participant = make(run)
        except BaseException as error:
            message = describe(error)
            report(run, role, message)
            raise Ended(message) from None
        serve(participant, run, guardian)
    except (Fault, Ended) as error:
        sys.exit(f"{make.program or make.__name__}: {error}")


# Programs by role, as the messages of the coupler name them.
PROGRAMS = {"structure": "structure-solver", "mesh": "mesh-mover", "flow": "flow-solver"}


def spelled(kind):
    """Name of a message kind as the contract spells it, such as `SendLayout`; None is an unknown code."""
    return kind.name.title().replace("_", "") if kind is not None else "an unknown kind"


def describe(error):
    """One message for an exception: its place in the participant, where it is no `Fault`."""
    if isinstance(error, Fault):
        return str(error)
    traceback.print_exception(error)
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if Path(f.filename).parent != Path(__file__).parent] or frames
    text = f"{type(error).__name__}: {error}".rstrip(": ")
    # The participant's own last line is more helpful than one inside a library.
    own = [f for f in ours if "site-packages" not in f.filename] or ours
    return f"{text} ({Path(own[-1].filename).name}, line {own[-1].lineno}, in {own[-1].name})" if own else text


def report(run, role, message):
    """Reports to the coupler that this rank cannot start."""
    try:
        member = Membership(run, role, 0.2)
        member.send_fault(member.answer_sender(TEXT_WORDS), 0, Window(), message)
        # The coupler connects to a new sender when it next looks: stay until then.
        time.sleep(0.3)
    except Exception as error:  # the end of the process shows it too
        print(f"the failure could not be reported to the coupler: {error}", file=sys.stderr)


def serve(participant, run, guardian=None):
    """Serves one rank from the handshake to the coupler's `stop`; returns the number of
    accepted windows. A fault of the participant is reported to the coupler first."""
    member = Membership(run, participant.role, run.deadline_s)
    guardian = guardian or Guardian(member.notice, member.coupler)
    try:
        server = RankServer(participant, member)
        server.handshake()
        return server.run(guardian)
    finally:
        member.close()


class Membership:
    """A rank's membership of a session."""

    def __init__(self, run, role, timeout_s):
        self.at, self.role = run, role
        place = Place(run.session)
        self.notice, self.coupler = find_coupler(place, timeout_s)
        self.id = int(self.notice["id"], 16)
        self.ranks = dict(self.notice["roles"])
        expected = self.ranks.get(role, 0)
        if run.rank >= expected:
            raise Fault(
                f"session `{run.session}` has {expected} ranks of {PROGRAMS[role]}, this is rank {run.rank} of {run.ranks}: "
                "start it with the number of ranks that the coupler expects"
            )
        me = f"{role}.{run.rank}"
        try:
            self.lock = Lock(place.lock_file(me))
        except BlockingIOError as error:
            raise Fault(
                f"session `{run.session}` already has a {PROGRAMS[role]} (rank {run.rank}): it was started twice"
            ) from error
        self.link = Link(place, me)
        self.ports = []
        flows = self.ranks.get("flow", 0)
        self.coupler_bell = self.keep(self.link.ringer(service("coupler_bell"), 1, sum(self.ranks.values())))
        self.sleeper = self.keep(self.link.sleeper(*self.bell(role)))
        self.readers = self.keep(self.link.ringer(*self.bell("flow"))) if role == "mesh" and flows else None

    def bell(self, role):
        """Name of the bell of a program, how many sleep on it, how many ring it."""
        return service("bell", role), self.ranks[role], 1 + (self.ranks.get("mesh", 0) if role == "flow" else 0)

    def keep(self, port):
        """A port that is freed before the lock."""
        self.ports.append(port)
        return port

    def close(self):
        """Frees what the session holds of this process."""
        while self.ports:
            self.ports.pop().close()

    def answer_sender(self, words):
        """This rank's end of its answer channel."""
        return self.keep(self.link.sender(service("answer", self.role, self.at.rank), words))

    def header(self, kind, sequence, window=None, unit=Unit.NONE, length=0):
        """A header of this rank."""
        return Header(
            magic=contract.MAGIC,
            contract=contract.VERSION,
            kind=kind,
            session=self.id,
            role=ROLES[self.role],
            rank=self.at.rank,
            sequence=sequence,
            unit=unit,
            length=length,
            window=window or Window(),
        )

    def send_fault(self, answers, sequence, window, message):
        """Reports a fault to the coupler."""
        answers.send_text(self.header(Kind.FAULT, sequence, window), message)
        self.coupler_bell.ring()

    def coupler_name(self):
        """The coupler, as messages name it."""
        return f"the coupler of session `{self.at.session}` (process {self.notice['pid']})"

    def wait(self, step, poll):
        """Polls, and sleeps between polls until a notification."""
        start = time.monotonic()
        while True:
            # Checked before the poll: messages sent before the coupler died are still valid.
            alive = self.coupler.is_held()
            found = poll()
            if found is not None:
                return found
            where = self.coupler_name()
            if not alive:
                raise Ended(f"{where} died in {during(*step)}")
            limit = LOOK_S
            if self.at.deadline_s:
                left = self.at.deadline_s - (time.monotonic() - start)
                if left <= 0:
                    raise Ended(
                        f"{where} sent nothing in {during(*step)} for {self.at.deadline_s:.1f} s "
                        "(the deadline of this program)"
                    )
                limit = min(limit, left)
            self.sleeper.sleep(limit)


class RankServer:
    """Serves the commands of one rank: its channels and the state of its windows."""

    def __init__(self, participant, member):
        self.participant, self.member = participant, member
        self.role, self.rank = member.role, member.at.rank
        self.sequence, self.step = 0, (Kind.ANNOUNCE, Window())
        self.unit = OUTPUT[self.role]
        self.layout_out = self.grid_out = None
        self.pieces, self.index = [], np.arange(0)
        self.open = self.last = None
        self.commands = member.keep(member.link.receiver(service("command", self.role), member.ranks[self.role]))
        self.readable = 1 + member.ranks.get("flow", 0)
        self.answers = None
        hello = self.guarded(self.hello)
        words = len(self.output_rows) * WIDTH[self.unit]
        if self.role == "mesh":
            name = service("grid", rank=self.rank)
            self.grid_out = member.keep(member.link.sender(name, words, self.readable, newest_wins=True))
            words = 0
        self.answers = member.answer_sender(max(words, TEXT_WORDS, len(hello)))
        self.answers.send_text(member.header(Kind.ANNOUNCE, 0), hello)
        member.coupler_bell.ring()

    def hello(self):
        """The announcement, as text."""
        p, at = self.participant, self.member.at
        self.output_rows = np.asarray(p.output_rows(), dtype=np.uint64)
        self.grid_rows = np.asarray(p.grid_rows(), dtype=np.uint64)
        announcement = {
            "role": p.role,
            "program": p.program or type(p).__name__,
            "version": p.version,
            "canopy_nodes": int(p.canopy_nodes),
            "canopy_faces": len(p.faces),
            "surface_hash": contract.surface_hash(p.faces),
            "grid_nodes": int(p.grid_nodes),
            "output_width": WIDTH[self.unit],
            "effects": list(p.effects),
        }
        hello = {"contract": contract.VERSION, "stage": at.stage, "rank": at.rank, "ranks": at.ranks}
        hello |= {"pid": os.getpid(), "output_rows": len(self.output_rows), "grid_rows": len(self.grid_rows)}
        return json.dumps(hello | {"announcement": announcement})

    def handshake(self):
        """Up to the first window."""
        member, link = self.member, self.member.link
        self.welcome = json.loads(self.text(self.expect(Kind.WELCOME)))
        layouts = []
        if self.role == "flow":
            for rank in range(len(self.welcome["mesh_rows"])):
                name = service("grid", rank=rank)
                self.pieces.append(member.keep(link.receiver(name, self.readable, newest_wins=True)))
                layouts.append(member.keep(link.receiver(service("layout", "mesh", rank), self.readable)))
        self.done()
        self.expect(Kind.SEND_LAYOUT).drop()
        rows = np.concatenate([self.output_rows, self.grid_rows]).astype(float)
        mesh = self.role == "mesh"
        receivers = self.readable if mesh else 1
        self.layout_out = member.keep(link.sender(service("layout", self.role, self.rank), len(rows), receivers))
        loan = self.layout_out.loan(len(rows))
        loan.payload[:] = rows
        got = loan.send(member.header(Kind.LAYOUT, self.sequence, None, Unit.ROWS, len(rows)))
        self.delivered(Kind.LAYOUT, got, 1 + (self.welcome["grid_readers"] if mesh else 0))
        if member.readers:
            member.readers.ring()
        if layouts:
            self.index_grid(layouts)
        self.done()

    def index_grid(self, layouts):
        """Where in the mesh's pieces, laid end to end, each row of this reader is."""
        place, start = {}, 0
        for rank, layout in enumerate(layouts):
            message = self.wait(layout.receive)
            count = self.welcome["mesh_rows"][rank]
            self.check(message, "mesh", rank, Kind.LAYOUT, Unit.ROWS)
            place |= {int(row): start + i for i, row in enumerate(message.payload[:count])}
            start += count
            message.drop()
        missing = [int(row) for row in self.grid_rows if int(row) not in place]
        if missing:
            self.broken(f"grid node {missing[0]}, which this rank reads, is on no rank of the mesh-mover")
        self.index = np.array([place[int(row)] for row in self.grid_rows], dtype=int)

    def run(self, guardian):
        """Serves windows until the coupler stops the run."""
        accepted = 0
        while True:
            command = self.next()
            kind, w = self.step
            if kind == Kind.ADVANCE:
                self.advance(command, w)
            elif kind == Kind.ACCEPT:
                if self.open is None or self.open[0] != w.index:
                    self.broken(f"window {w.index} is to be accepted, computed was {self.open}")
                self.open, self.last = None, w.index
                accepted += 1
                command.drop()
                start = time.monotonic()
                self.guarded(lambda: self.participant.accept(w))
                self.done(time.monotonic() - start)
            elif kind in (Kind.SAVE, Kind.SNAPSHOT):
                folder = Path(self.text(command))
                if kind == Kind.SAVE:
                    self.guarded(lambda: self.participant.save(folder))
                else:
                    self.guarded(lambda: self.participant.snapshot(w.time, folder))
                self.done()
            elif kind == Kind.STOP:
                command.drop()
                guardian.dismissed.set()
                self.done()
                return accepted
            else:
                self.broken(f"unexpected command `{spelled(kind)}` between windows")

    def turn(self, w):
        """The problem with computing window `w` now, or None."""
        if self.open and (w.index != self.open[0] or w.iteration <= self.open[1]):
            return (
                f"window {w.index} iteration {w.iteration} after window {self.open[0]} "
                f"iteration {self.open[1]}, which was not accepted"
            )
        if not self.open and self.last is not None and w.index != self.last + 1:
            return f"window {w.index} after window {self.last} was accepted"
        if not (0 < w.dt < np.inf and np.isfinite(w.time)):
            return f"an invalid window: start {w.time} s, length {w.dt} s"
        self.open = (w.index, w.iteration)
        return None

    def advance(self, command, w):
        """One window: input read in place, output written in place."""
        if self.layout_out:
            self.member.ports.remove(self.layout_out)
            self.layout_out.close()
            self.layout_out = None
        problem = self.turn(w)
        expected, unit = self.welcome["input_length"], INPUT[self.role]
        if not problem and (len(command.payload), command.header.unit) != (expected, unit):
            problem = f"input of {len(command.payload)} numbers in unit {command.header.unit}, expected {expected} in {unit}"
        if problem:
            self.broken(problem)
        shape = {"structure": (-1, 2, 4), "mesh": (-1, 3), "flow": (-1, 3)}[self.role]
        grid = self.moved_grid(w)
        loan = (self.grid_out or self.answers).loan(len(self.output_rows) * WIDTH[self.unit])
        start = time.monotonic()
        header = self.member.header(Kind.OUTPUT, self.sequence, w)

        def compute():
            output = loan.payload.reshape(-1, WIDTH[self.unit])
            stats = self.participant.advance(w, command.payload.reshape(shape), grid, output) or {}
            self.finite(output)
            for name, value in self.numbers(stats):
                if not np.isfinite(value):
                    raise Fault(f"statistic `{name}` is {value}: the solution has diverged")
                header.values[STATISTICS[self.role][name]] = value

        self.guarded(compute, loan)
        header.busy_s = time.monotonic() - start
        command.drop()
        words = len(loan.payload)
        if self.grid_out:
            got = loan.send(self.member.header(Kind.GRID, self.sequence, w, self.unit, words))
            readers = self.welcome["grid_readers"] + self.welcome["coupler_reads_grid"]
            self.delivered(Kind.GRID, got, readers)
            if self.member.readers:
                self.member.readers.ring()
            self.answer(self.answers.send(header))
        else:
            header.unit, header.length = self.unit, words
            self.answer(loan.send(header))

    def numbers(self, stats):
        """Names and values of single statistics; a vector `name` has three, `name_x` to `name_z`."""
        known = STATISTICS[self.role]
        for name, value in stats.items():
            if name in known:
                yield name, value
            elif f"{name}_x" in known and np.shape(value) == (3,):
                yield from zip((f"{name}_{axis}" for axis in "xyz"), value)
            else:
                what = "is a vector: give three numbers" if f"{name}_x" in known else "is unknown"
                raise Fault(f"statistic `{name}` {what}; the {self.role} has {', '.join(known)}")

    def moved_grid(self, w):
        """The grid of window `w` for this reader's rows, `[rows][6]`, once the mesh has made it."""
        pieces = []
        for rank, receiver in enumerate(self.pieces):

            def poll():
                while message := receiver.receive():
                    found = (message.header.window.index, message.header.window.iteration)
                    if found == (w.index, w.iteration):
                        return message
                    message.drop()
                    if found > (w.index, w.iteration):
                        self.broken(f"the mesh-mover (rank {rank}) is ahead, in window {found[0]} iteration {found[1]}")
                command = self.commands.receive()
                if command:
                    self.end_early(command)
                return None

            message = self.wait(poll)
            self.check(message, "mesh", rank, Kind.GRID, Unit.GRID)
            pieces.append(message.payload.reshape(-1, 6).copy())
            message.drop()
        return np.concatenate(pieces)[self.index] if pieces else np.empty((0, 6))

    def finite(self, output):
        """An output that may leave the program."""
        bad = np.argwhere(~np.isfinite(output))
        if len(bad):
            row, component = bad[0]
            raise Fault(
                f"component {component} of output row {self.output_rows[row]} is {output[row, component]} (NaN "
                "also where it was not written): the solution has diverged or the row was not written"
            )

    def guarded(self, call, loan=None):
        """Runs a function of the participant; reports any exception to the coupler."""
        try:
            return call()
        except BaseException as error:
            message = describe(error)
            if loan:
                loan.drop()  # only one message can be in the making
            self.answers = self.answers or self.member.answer_sender(TEXT_WORDS)
            self.member.send_fault(self.answers, self.sequence, self.step[1], message)
            raise Ended(f"{during(*self.step)}: {message}") from None

    def broken(self, problem):
        """Ends this rank because another process violated the contract; reports it to the coupler."""
        self.member.send_fault(self.answers, self.sequence, self.step[1], problem)
        raise Ended(f"message out of order in {during(*self.step)}: {problem}")

    def check(self, message, role, rank, kind, unit):
        """Ends this rank if a message of another rank is not the expected one."""
        problem = message.header.problem(self.member.id, ROLES[role], rank, len(message.payload))
        if not problem and (message.header.kind, message.header.unit) != (kind, unit):
            problem = f"kind {message.header.kind} where {spelled(kind)} was expected"
        if problem:
            self.broken(f"{role} (rank {rank}): {problem}")

    def wait(self, poll):
        """Polls asleep."""
        return self.member.wait(self.step, poll)

    def next(self):
        """The next command."""
        command = self.wait(self.commands.receive)
        header = command.header
        problem = header.problem(self.member.id, COUPLER, 0, len(command.payload))
        if not problem and header.sequence != self.sequence + 1:
            problem = f"command {header.sequence} after command {self.sequence}"
        if not problem and command.kind is None:
            problem = f"a command of unknown kind {header.kind}"
        if problem:
            self.broken(problem)
        if command.kind in (Kind.ABORT, Kind.REFUSE):
            self.end_early(command)
        self.step = (command.kind, header.window)
        self.sequence += 1
        return command

    def expect(self, kind):
        """The next command, which must be of this kind."""
        command = self.next()
        if command.kind != kind:
            self.broken(f"{spelled(command.kind)} where {spelled(kind)} was expected")
        return command

    def end_early(self, command):
        """Ends this rank for a command that comes while another is carried out."""
        kind, message = command.kind, self.text(command)
        if kind == Kind.REFUSE:
            raise Ended(message)
        if kind == Kind.ABORT:
            raise Ended(f"the run was ended in {during(*self.step)}: {message}")
        self.broken(f"command {spelled(kind)} before the last one was answered")

    def text(self, message):
        """Text of a message."""
        text = contract.unpack_text(message.payload, message.header.bytes)
        message.drop()
        return text

    def done(self, busy_s=0.0):
        """Answers the last command, on which this rank worked for `busy_s` seconds."""
        header = self.member.header(Kind.DONE, self.sequence, self.step[1])
        header.busy_s = busy_s
        self.answer(self.answers.send(header))

    def answer(self, got):
        """An answer was sent."""
        self.delivered(Kind.OUTPUT, got, 1)
        self.member.coupler_bell.ring()

    def delivered(self, kind, got, expected):
        """Ends this rank if a message did not reach every reader."""
        if got != expected:
            if not self.member.coupler.is_held():
                raise Ended(f"{self.member.coupler_name()} died in {during(*self.step)}")
            self.broken(f"`{spelled(kind)}` reached {got} of {expected} readers")
