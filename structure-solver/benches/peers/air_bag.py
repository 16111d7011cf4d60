#!/usr/bin/env python3
"""The paper's air bag by Ripstop and by a peer, in one sitting.

    air_bag.py --peer DIR/airbag.py [--ours target/release/structure-solver]
               [--n 50] [--steps 50] [--ranks 1] [--repeat 1] [--rho-inf R] [--peer-python python3]
               [-- further options of the peer]

The peer is a script with the options --n --steps --dt --rho --tol --scheme --rinf that ends with
a line `RESULT ... s/step=... it/step=... nonconv=... RSS_sum_MiB=...`; both solve 2 n^2 triangles,
wrinkling on, Newmark (or generalized-alpha with --rho-inf), each Newton iteration to a
residual of 1e-6 of the load. The runs alternate; each figure is the least of its repetitions.
Leave the machine otherwise idle, and read the ratios, not the seconds.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time

DENSITY = 1223.5093
TOLERANCE = 1e-6
DT = 1e-4
SCENE = """
name = "air-bag"
[canopy]
kind = "air-bag"
cells_across = {n}
[fabric]
youngs_modulus_pa = 206.8e6
poisson_ratio = 0.3
thickness_m = 3.048e-5
density_kg_m3 = {density}
wrinkling = true
[structure]
newton_tolerance = {tolerance}
newton_max_steps = 30
{scheme}
[[stage]]
name = "inflation"
kind = "pre-inflation"
pressure_pa = 23.94
duration_s = {duration}
window_s = {dt}
substeps = 1
"""


def run(command, ranks):
    """Standard output, processor seconds and the memory of all ranks, MiB, of a command."""
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), "--oversubscribe"] + command
    with tempfile.TemporaryFile("w+") as out:
        child = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read()
    if child.returncode != 0:
        sys.exit(f"{' '.join(command)} ended with {child.returncode}:\n{text}")
    # The kernel tells the largest process; ranks are alike.
    return text, usage.ru_utime + usage.ru_stime, ranks * usage.ru_maxrss / 1024


def number(pattern, text):
    found = re.search(pattern, text)
    if not found:
        sys.exit(f"no '{pattern}' in:\n{text}")
    return float(found.group(1))


def ours(a, folder):
    scheme = "" if a.rho_inf is None else f"spectral_radius = {a.rho_inf}"
    scene = os.path.join(folder, "scene.toml")
    with open(scene, "w") as f:
        f.write(SCENE.format(n=a.n, density=DENSITY, tolerance=TOLERANCE, scheme=scheme, duration=a.steps * DT, dt=DT))
    command = [a.ours, "alone", "--scene", scene, "--out", os.path.join(folder, "out"), "--profile"]
    text, processor, memory = run(command, a.ranks)
    seconds = number(r"# ([0-9.]+) s on rank 0", text)
    newton = number(r"([0-9.]+) Newton steps", text)
    # A step that does not converge ends the run with an error.
    return [seconds / a.steps, newton / a.steps, memory, processor, 0]


def peer(a):
    scheme = ["--scheme", "newmark"] if a.rho_inf is None else ["--scheme", "ga", "--rinf", str(a.rho_inf)]
    command = [a.peer_python, a.peer, "--n", str(a.n), "--steps", str(a.steps), "--dt", str(DT)]
    command += ["--rho", str(DENSITY), "--tol", str(TOLERANCE)] + scheme + a.options
    text, processor, memory = run(command, a.ranks)
    return [
        number(r"s/step=([0-9.]+)", text),
        number(r"it/step=([0-9.]+)", text),
        memory,
        processor,
        number(r"nonconv=([0-9]+)", text),
    ]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--peer", required=True)
    p.add_argument("--peer-python", default="python3")
    p.add_argument("--ours", default="target/release/structure-solver")
    p.add_argument("--n", type=int, default=50)
    p.add_argument("--steps", type=int, default=50)
    p.add_argument("--ranks", type=int, default=1)
    p.add_argument("--repeat", type=int, default=1)
    p.add_argument("--rho-inf", type=float)
    p.add_argument("options", nargs="*", default=[], help="of the peer, after --")
    a = p.parse_args()
    best = [None, None]
    for _ in range(a.repeat):
        with tempfile.TemporaryDirectory() as folder:
            for k, found in enumerate([ours(a, folder), peer(a)]):
                best[k] = found if best[k] is None else [min(x, y) for x, y in zip(best[k], found)]
    print(f"# {2 * a.n**2} triangles, {a.steps} steps of {DT} s, {a.ranks} rank(s), {time.strftime('%F')}")
    print(f"{'':24} {'ours':>10} {'peer':>10} {'ratio':>8}")
    names = ["seconds per step", "Newton steps per step", "memory, MiB", "processor s, start too", "steps not converged"]
    for name, x, y in zip(names, *best):
        ratio = f"{x / y:8.3f}" if y else f"{'':8}"
        print(f"{name:24} {x:10.4f} {y:10.4f} {ratio}")


main()
