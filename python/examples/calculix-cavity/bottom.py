#!/usr/bin/env python3
"""Writes the input of CalculiX for the bottom of the cavity: python3 bottom.py [CELLS] > bottom.inp

One row of CELLS solid elements, 0.1 m wide and as thick as the membrane. The nodes of their upper side are those of the
canopy of the scene.
"""
import sys

CELLS = int(sys.argv[1]) if len(sys.argv) > 1 else 32
THICKNESS, MODULUS, DENSITY = 2e-3, 250.0, 500.0  # m, Pa, kg/m3
WINDOW = 0.1  # s, of the scene
PERIOD = 140.0  # s, longer than the stage: preCICE ends the run
STEPS_PER_WINDOW = 1  # the checkpoint of the adapter is complete for one only


def node(i, j, k):
    """Number of a node: `i` along the bottom, `j` across, `k` = 1 on the upper side."""
    return 1 + i + (CELLS + 1) * (j + 2 * k)


def group(name, members):
    """Lines of a set of nodes."""
    return [f"*NSET, NSET={name}", *(f"{n}," for n in members)]


columns = range(CELLS + 1)
lines = ["*NODE, NSET=NALL"]
for k in (0, 1):
    for j in (0, 1):
        lines += [f"{node(i, j, k)}, {i / CELLS - 0.5!r}, {0.1 * j - 0.05!r}, {THICKNESS * (k - 1)!r}" for i in columns]
lines += ["*ELEMENT, TYPE=C3D8I, ELSET=EALL"]
for i in range(CELLS):
    corners = [node(i + a, b, k) for k in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    lines += [f"{i + 1}, {', '.join(map(str, corners))}"]
lines += group("NSURFACEN", [node(i, j, 1) for j in (0, 1) for i in columns])  # the adapter's name of the patch `surface`
lines += group("NENDS", [node(i, j, k) for i in (0, CELLS) for j in (0, 1) for k in (0, 1)])
lines += ["*MATERIAL, NAME=FABRIC", "*ELASTIC", f"{MODULUS!r}, 0.0", "*DENSITY", f"{DENSITY!r}"]
lines += ["*SOLID SECTION, ELSET=EALL, MATERIAL=FABRIC"]
lines += ["*BOUNDARY", "NALL, 2, 2", "NENDS, 1, 3"]  # a slice: nothing moves across; held ends
lines += ["*STEP, NLGEOM, INC=1000000"]
lines += ["*DYNAMIC, ALPHA=0.0, DIRECT", f"{WINDOW / STEPS_PER_WINDOW!r}, {PERIOD!r}"]
lines += ["*CLOAD", *(f"NSURFACEN, {axis}, 0.0" for axis in (1, 2, 3))]  # the adapter sets them
lines += ["*NODE FILE, FREQUENCY=500", "U", "*END STEP"]
print("\n".join(lines))
