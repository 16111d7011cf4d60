"""The configuration of preCICE, `precice-config.xml`: written for a scene, and checked before it is used."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from .errors import ConfigError
from .exchange import COUNTER

# The bridge as participant of preCICE, and its meshes.
NAME = "Ripstop"
NODES, FACES = "Ripstop-Nodes", "Ripstop-Faces"

# The participant behind preCICE by role: its meshes are NAME-Nodes and NAME-Faces.
SOLVERS = {"structure": "Solid", "flow": "Fluid"}

# Kinds of stages in which a role runs.
STAGES = {
    "structure": ("pre-inflation", "coupled"),
    "flow": ("flow-only", "coupled", "prescribed"),
}

# The velocity of the frame that falls with the payload.
FRAME_VELOCITY = "FrameVelocity"

MAPPINGS = ("nearest-neighbor", "nearest-projection", "rbf")

SCALARS = ("Pressure", COUNTER)


def fields(role, load, fixed_frame=False):
    """Names and meshes of what the bridge writes, and of what it reads. `fixed_frame`: a flow that does not read the velocity
    of the frame."""
    motion = [("Displacement", NODES)]
    on_faces = [("Pressure", FACES), ("Traction", FACES)]
    if role == "flow":
        frame = [] if fixed_frame else [(FRAME_VELOCITY, NODES)]
        return motion + frame, [("Force", FACES)] if load == "force" else on_faces
    return [("Force", NODES)] if load == "force" else on_faces, motion


def path_of(pattern, stage):
    """File name for a stage: `{stage}` stands for its name."""
    return str(pattern).replace("{stage}", stage)


def degree(scene, role):
    """How preCICE interpolates in a window: 0 the value at its end throughout, 1 linear from its start."""
    return 1 if role == "flow" or scene["coupling"]["load_interpolation"] == "linear" else 0


def refuse_linear(scene, role, load, explicit):
    """Refuses loads that are linear in a window where preCICE cannot interpolate as Ripstop does: in the first window of a
    coupled stage the load at its start follows from the iteration, and forces from the shape."""
    if role == "structure" and degree(scene, role) == 1 and not (explicit and load == "pressure"):
        raise ConfigError(
            'the scene has `coupling.load_interpolation = "linear"`, which passes through preCICE only with --load pressure and '
            '--explicit: set it to "mean" or "constant"'
        )


def duration(stage):
    """Planned time of a stage, s: whole windows."""
    return max(1, round(stage["duration_s"] / stage["window_s"])) * stage["window_s"]


def attributes(**values):
    """Attributes of an XML element."""
    return "".join(f' {name.replace("_", "-")}="{value}"' for name, value in values.items())


def element(tag, _inside=(), **values):
    """Lines of an XML element."""
    if not _inside:
        return [f"<{tag}{attributes(**values)}/>"]
    return [f"<{tag}{attributes(**values)}>", *("  " + line for line in _inside), f"</{tag}>"]


def text(scene, stage, role, load, mapping="nearest-neighbor", explicit=False, exchange_directory=".", radius=0.0, fixed_frame=False):
    """The configuration for one stage of a scene with its defaults (`ripstop mesh`). `radius` is the support of the
    functions of the mapping `rbf`, m; `fixed_frame` as in `fields`."""
    refuse_linear(scene, role, load, explicit)
    solver = SOLVERS[role]
    writes, reads = fields(role, load, fixed_frame)
    writes = writes + [(COUNTER, writes[0][1])]
    there = {mesh: mesh.replace(NAME, solver) for _, mesh in writes + reads}
    constraint = {"write": "conservative" if role == "structure" and load == "force" else "consistent"}
    constraint["read"] = "conservative" if role == "flow" and load == "force" else "consistent"

    lines = element("log", element("sink", filter="%Severity% > debug"))
    for name, _ in writes + reads:
        kind = "scalar" if name in SCALARS else "vector"
        exact = {} if (name, _) in reads else {"waveform_degree": degree(scene, role)}
        lines += element(f"data:{kind}", name=name, **exact)
    for own, theirs in there.items():
        for mesh in (own, theirs):
            uses = [line for name, at in writes + reads if at == own for line in element("use-data", name=name)]
            lines += element("mesh", uses, name=mesh, dimensions=3)
    lines += element("participant", _bridge(writes, reads, there, solver, mapping, constraint, radius), name=NAME)
    lines += element("participant", _solver(writes, reads, there), name=solver)
    lines += element("m2n:sockets", acceptor=NAME, connector=solver, exchange_directory=exchange_directory)
    lines += _scheme(writes, reads, there, solver, duration(stage), explicit)
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *element("precice-configuration", lines), ""])


def _bridge(writes, reads, there, solver, mapping, constraint, radius):
    """The participant that the bridge is: it maps in both directions."""
    lines = []
    for own, theirs in there.items():
        lines += element("provide-mesh", name=own) + element("receive-mesh", **{"name": theirs, "from": solver})
    for tag, some in (("write-data", writes), ("read-data", reads)):
        for name, mesh in some:
            lines += element(tag, name=name, mesh=mesh)
    for direction, some in (("write", writes), ("read", reads)):
        for own in dict.fromkeys(mesh for _, mesh in some):
            ends = (own, there[own]) if direction == "write" else (there[own], own)
            of = {"direction": direction, "from": ends[0], "to": ends[1], "constraint": constraint[direction]}
            basis = element("basis-function:compact-polynomial-c6", support_radius=repr(radius)) if mapping == "rbf" else []
            lines += element(f"mapping:{mapping}", basis, **of)
    return lines


def _solver(writes, reads, there):
    """The participant behind preCICE. It need not read the counter, but preCICE warns of data that nobody may read."""
    lines = [line for mesh in there.values() for line in element("provide-mesh", name=mesh)]
    for name, mesh in writes:
        lines += element("read-data", name=name, mesh=there[mesh])
    for name, mesh in reads:
        lines += element("write-data", name=name, mesh=there[mesh])
    return lines


def _scheme(writes, reads, there, solver, max_time, explicit):
    """The coupling scheme: the bridge sets the length of windows, and decides when one is complete."""
    lines = element("participants", first=NAME, second=solver)
    lines += element("time-window-size", method="first-participant")
    lines += element("max-time", value=repr(max_time))
    for some, ends in ((writes, (NAME, solver)), (reads, (solver, NAME))):
        for name, mesh in some:
            initial = "true" if some is writes else "false"
            of = {"data": name, "mesh": there[mesh], "from": ends[0], "to": ends[1], "initialize": initial}
            lines += element("exchange", **of, substeps="false")
    if explicit:
        return element("coupling-scheme:serial-explicit", lines)
    counter = there[writes[0][1]]
    lines += element("absolute-convergence-measure", limit=0.5, data=COUNTER, mesh=counter)
    return element("coupling-scheme:serial-implicit", lines)


def parse(file):
    """The configuration as elements, `data:scalar` as `data.scalar`: preCICE does not declare its prefixes."""
    try:
        content = Path(file).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{file} cannot be read ({error.strerror}): write it with --write-config") from error
    try:
        return ElementTree.fromstring(re.sub(r"(</?[\w-]+):", r"\1.", content))
    except ElementTree.ParseError as error:
        raise ConfigError(f"{file} is no XML: {error}") from error


def check(file, role, load, scene, fixed_frame=False):
    """Refuses a configuration that preCICE accepts, but that gives other windows or other loads than Ripstop's."""
    root = parse(file)
    schemes = [e for e in root.iter() if e.tag.startswith("coupling-scheme.")]
    if len(schemes) != 1 or schemes[0].tag.partition(".")[2] not in ("serial-implicit", "serial-explicit"):
        found = ", ".join(e.tag.replace(".", ":") for e in schemes) or "none"
        raise ConfigError(f"{file}: the coupling scheme must be one serial-implicit or serial-explicit, found {found}")
    scheme = schemes[0]
    first = scheme.find("participants")
    if first is None or first.get("first") != NAME:
        raise ConfigError(f'{file}: `first` of <participants> must be "{NAME}", which decides when a window is complete')
    if scheme.tag.endswith("implicit"):
        measures = [e for e in scheme if "convergence-measure" in e.tag]
        if [(e.tag, e.get("data")) for e in measures] != [("absolute-convergence-measure", COUNTER)]:
            raise ConfigError(
                f"{file}: the only convergence measure must be "
                f'<absolute-convergence-measure limit="0.5" data="{COUNTER}" .../>: Ripstop decides on convergence'
            )
        for e in scheme:
            if e.tag in ("max-iterations", "min-iterations") or e.tag.startswith("acceleration"):
                raise ConfigError(f"{file}: remove <{e.tag.replace('.', ':')}>: Ripstop iterates and accelerates")
    refuse_linear(scene, role, load, scheme.tag.endswith("explicit"))
    degrees = {e.get("name"): int(e.get("waveform-degree", "1")) for e in root if e.tag.startswith("data.")}
    if fixed_frame and FRAME_VELOCITY in degrees:
        raise ConfigError(f"{file} has the data `{FRAME_VELOCITY}`, which is not written with --fixed-frame: write it again")
    for name, _ in fields(role, load, fixed_frame)[0]:
        if name not in degrees:
            other = ", or run with --fixed-frame as when it was written" if name == FRAME_VELOCITY else ""
            options = "--load " + load + (" --fixed-frame" if fixed_frame else "")
            raise ConfigError(f"{file} has no data `{name}`, which the bridge writes with {options}: write it again{other}")
        if role == "structure" and degrees[name] != degree(scene, role):
            raise ConfigError(
                f"{file}: waveform-degree of `{name}` is {degrees[name]}, but `coupling.load_interpolation` of the scene "
                f"asks for {degree(scene, role)}: write it again with --write-config"
            )


def connection_folders(file):
    """Folders in which preCICE exchanges addresses for this configuration."""
    for sockets in parse(file).iter("m2n.sockets"):
        ends = sockets.get("acceptor"), sockets.get("connector")
        for one, other in (ends, ends[::-1]):
            yield Path(sockets.get("exchange-directory", "."), "precice-run", f"{one}-{other}")
