"""`python -m ripstop.precice`: command line of the bridge."""

import argparse
import sys
from pathlib import Path

import numpy as np

from ..contract import Fault
from ..participant import Run
from . import config
from .bridge import ROLES
from .exchange import REPEAT_TOLERANCE


def arguments(words):
    """Options of the bridge, and the words that are left for `Run`."""
    parser = argparse.ArgumentParser(
        prog="python -m ripstop.precice",
        description="A solver program of Ripstop whose work a participant of preCICE does. `ripstop run` adds its own "
        "arguments; with --write-config it writes the configuration of preCICE for a scene instead.",
        allow_abbrev=False,
    )
    parser.add_argument("role", choices=sorted(ROLES), help="what the participant behind preCICE computes")
    parser.add_argument(
        "--load",
        choices=("pressure", "force"),
        default="pressure",
        help="pressure jump and traction at face centres (Pa), or forces (N): at nodes for a structure, at face centres from "
        "a flow (default: pressure)",
    )
    add = parser.add_argument
    name = "precice-config.xml"
    text = f"configuration of preCICE (default: {name}); {{stage}} stands for the name of the stage"
    add("--config", default=name, metavar="FILE", help=text)
    add("--solver", metavar="COMMAND", help="starts this program for each stage (default: it is started by hand)")
    add("--effects", default="", metavar="KEYS", help="keys of the scene that the solver has, separated by commas")
    text = f"largest difference of two responses to the same data, relative to the change over the window ({REPEAT_TOLERANCE})"
    add("--repeat-tolerance", type=float, default=REPEAT_TOLERANCE, metavar="X", help=text)
    text = "a flow that does not read the velocity of the falling frame; a run whose frame moves ends with an error"
    add("--fixed-frame", action="store_true", help=text)
    add = parser.add_argument_group("to write a configuration").add_argument
    add("--write-config", type=Path, metavar="SCENE", help="scene for which FILE of --config is written")
    text = "value that replaces one of the scene (repeatable), as of `ripstop run`"
    add("--set", action="append", default=[], metavar="KEY=VALUE", help=text)
    add("--only-stage", metavar="NAME", help="one stage instead of all with this role")
    add("--mapping", choices=config.MAPPINGS, default=config.MAPPINGS[0], help=f"default: {config.MAPPINGS[0]}")
    add("--explicit", action="store_true", help="one iteration in each window, for staggered schemes")
    add("--exchange-directory", default=".", metavar="DIR", help="where the participants find each other (default: .)")
    own, left = parser.parse_known_args(words)
    if own.fixed_frame and own.role != "flow":
        parser.error("--fixed-frame is an option of the flow: no structure reads the velocity of the frame")
    if own.set and own.write_config is None:
        parser.error("--set belongs to --write-config: a run passes its own scene to the programs")
    own.effects = [key for key in own.effects.split(",") if key]
    return own, left


def write(options):
    """Writes a configuration for each stage of the role."""
    words = ["--scene", str(options.write_config), "--stage", "0", "--session", "-", "--out", ".", "--ranks", "1"]
    case = Run(words).case(settings=options.set)
    scene = case["scene"]
    stages = [s for s in scene["stage"] if s["kind"] in config.STAGES[options.role]]
    if options.only_stage is not None:
        stages = [s for s in stages if s["name"] == options.only_stage]
    if not stages:
        which = f"stage `{options.only_stage}`" if options.only_stage else "stage"
        raise Fault(f"{options.write_config} has no {which} with a {options.role}")
    if len(stages) > 1 and "{stage}" not in options.config:
        names = ", ".join(s["name"] for s in stages)
        raise Fault(
            f"stages {names} have a {options.role}: put {{stage}} into the name of --config, or choose one with --only-stage"
        )
    coords = np.array(case["structure"]["coords"])
    edges = np.linalg.norm(np.diff(coords[np.array(case["structure"]["faces"])[:, :3]], axis=1), axis=2)
    for stage in stages:
        file = Path(config.path_of(options.config, stage["name"]))
        words = (options.mapping, options.explicit, options.exchange_directory, round(4 * float(edges.max()), 6), options.fixed_frame)
        file.write_text(config.text(scene, stage, options.role, options.load, *words), encoding="utf-8")
        print(f"written: {file}")


def main(words=None):
    """Runs the command line."""
    options, left = arguments(words)
    if options.write_config is not None:
        if left:
            sys.exit(f"ripstop.precice: unknown options {' '.join(left)}")
        try:
            return write(options)
        except Fault as error:
            sys.exit(f"ripstop.precice: {error}")
    from ..server import main as serve  # needs iceoryx2

    made = []

    def make(run):
        made.append(ROLES[options.role](run, options))
        return made[0]

    make.role, make.program = options.role, "precice-bridge"
    sys.argv[1:] = left
    try:
        serve(make)
        for bridge in made:
            bridge.finish()
    finally:
        for bridge in made:
            bridge.close()


if __name__ == "__main__":
    main()
