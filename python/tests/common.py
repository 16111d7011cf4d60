"""What the tests share: the package of this checkout, files by hand, and one short run."""

import atexit
import functools
import os
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
ROOT = PACKAGE.parent
SQUARE = ROOT / "cases/square-drop/scene.toml"
sys.path.insert(0, str(PACKAGE))
os.environ["PYTHONPATH"] = str(PACKAGE)


@functools.cache
def scratch():
    """A folder that is removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="ripstop-tests-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def needs_program():
    """Skips the test without the program `ripstop`."""
    from ripstop import RipstopError, program

    try:
        program.find()
    except RipstopError as error:
        raise unittest.SkipTest(str(error)) from None


@functools.cache
def square_scene():
    """The scene of the short run: square-drop with tables and snapshots of all kinds."""
    from ripstop import Scene

    scene = Scene.read(SQUARE)
    scene["descent.payload_mass_kg"] = 5.5
    scene["output.surface_every_windows"] = 5
    scene["output.volume_every_windows"] = 10
    scene["output.point"] = [{"name": "apex", "at_m": [0.0, 0.0, 0.0]}]
    scene["flow.forces"] = {}
    scene["flow.probe"] = [{"name": "wake", "position_m": [0.0, 0.0, 2.0]}]
    return scene


@functools.cache
def square_run():
    """The short run, made once, about 10 s: never change its folder."""
    needs_program()
    return square_scene().run(scratch() / "square", quiet=True)


def copy_of_run(name):
    """A copy of the short run that a test may change."""
    from ripstop.results import Run

    folder = scratch() / name
    shutil.rmtree(folder, ignore_errors=True)
    return Run(shutil.copytree(square_run().folder, folder))


def file(name, content):
    """A file by hand below the scratch folder."""
    path = scratch() / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content, encoding="utf-8")
    return path
