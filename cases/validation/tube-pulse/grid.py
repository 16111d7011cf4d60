#!/usr/bin/env python3
"""Writes a quarter of a tube along x: python3 grid.py AROUND ALONG TUBE.msh (Gmsh 4.1, ASCII)

AROUND (even) faces around the quarter of the wall, ALONG cells along the tube; a square core of half as many cells a side and as
many layers between it and the wall. Planes of symmetry at y = 0 and z = 0.
"""
import math
import sys

AROUND, ALONG, FILE = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
RADIUS, LENGTH = 0.005, 0.05
SIDE = AROUND // 2  # cells along a side of the core
CORE = 0.5 * RADIUS
LAYERS = SIDE
GROUPS = ["canopy", "inlet", "outlet", "plane-y", "plane-z"]


def section():
    """Places (y, z) of the nodes of a section, its quadrilaterals, and the nodes of wall and planes in their order."""
    number, places = {}, []

    def node(y, z):
        key = round(y / RADIUS, 9), round(z / RADIUS, 9)
        if key not in number:
            number[key] = len(places)
            places.append((y, z))
        return number[key]

    core = [[node(CORE * j / SIDE, CORE * k / SIDE) for k in range(SIDE + 1)] for j in range(SIDE + 1)]
    quads = [(core[j][k], core[j + 1][k], core[j + 1][k + 1], core[j][k + 1]) for j in range(SIDE) for k in range(SIDE)]
    rim = [core[SIDE][k] for k in range(SIDE + 1)] + [core[j][SIDE] for j in range(SIDE - 1, -1, -1)]
    rings = [rim]
    for layer in range(1, LAYERS + 1):
        share, ring = layer / LAYERS, []
        for k, start in enumerate(rim):
            angle = 0.5 * math.pi * k / AROUND
            y0, z0 = places[start]
            y = y0 + share * (RADIUS * math.cos(angle) - y0)
            z = z0 + share * (RADIUS * math.sin(angle) - z0)
            ring.append(node(0.0 if k == AROUND else y, 0.0 if k == 0 else z))
        rings.append(ring)
    for inner, outer in zip(rings, rings[1:]):
        quads += [(inner[k], outer[k], outer[k + 1], inner[k + 1]) for k in range(AROUND)]
    plane_z = [core[j][0] for j in range(SIDE)] + [ring[0] for ring in rings]
    plane_y = [core[0][k] for k in range(SIDE)] + [ring[-1] for ring in rings]
    return places, quads, rings[-1], plane_y, plane_z


PLACES, QUADS, WALL, PLANE_Y, PLANE_Z = section()
nodes = [(LENGTH * i / ALONG, y, z) for i in range(ALONG + 1) for y, z in PLACES]
at = lambda i, n: 1 + i * len(PLACES) + n
strip = lambda line: [[at(i, a), at(i + 1, a), at(i + 1, b), at(i, b)] for i in range(ALONG) for a, b in zip(line, line[1:])]
faces = {
    "canopy": [[a, d, c, b] for a, b, c, d in strip(WALL)],  # normal outwards: e_angle x e_x
    "inlet": [[at(0, n) for n in quad] for quad in QUADS],
    "outlet": [[at(ALONG, n) for n in quad] for quad in QUADS],
    "plane-y": strip(PLANE_Y),
    "plane-z": strip(PLANE_Z),
}
cells = [[at(i, n) for n in quad] + [at(i + 1, n) for n in quad] for i in range(ALONG) for quad in QUADS]
held = {
    "fixed": [at(i, n) for i in (0, ALONG) for n in WALL],
    "fixed-y": [at(i, WALL[-1]) for i in range(ALONG + 1)],
    "fixed-z": [at(i, WALL[0]) for i in range(ALONG + 1)],
}
blocks = [(0, n, 15, [[v] for v in held[g]]) for n, g in enumerate(held, 1)]
blocks += [(2, n, 3, faces[g]) for n, g in enumerate(GROUPS, 1)] + [(3, 1, 5, cells)]
names = [f'0 {n} "{g}"' for n, g in enumerate(held, 1)] + [f'2 {n} "{g}"' for n, g in enumerate(GROUPS, 1)]
box = f"0.0 0.0 0.0 {LENGTH} {RADIUS} {RADIUS}"
elements = sum(len(members) for *_, members in blocks)
with open(FILE, "w", encoding="ascii") as out:
    print("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames", file=out)
    print(len(names) + 1, *names, '3 1 "fluid"', sep="\n", file=out)
    print(f"$EndPhysicalNames\n$Entities\n{len(held)} 0 {len(GROUPS)} 1", file=out)
    for dim, n, _, _ in blocks:
        print(f"{n} 0 0 0 1 {n}" if dim == 0 else f"{n} {box} 1 {n} 0", file=out)
    print(f"$EndEntities\n$Nodes\n1 {len(nodes)} 1 {len(nodes)}\n3 1 0 {len(nodes)}", file=out)
    print(*range(1, len(nodes) + 1), sep="\n", file=out)
    print(*(f"{x!r} {y!r} {z!r}" for x, y, z in nodes), sep="\n", file=out)
    print(f"$EndNodes\n$Elements\n{len(blocks)} {elements} 1 {elements}", file=out)
    number = 0
    for dim, entity, shape, members in blocks:
        print(f"{dim} {entity} {shape} {len(members)}", file=out)
        for member in members:
            number += 1
            print(number, *member, file=out)
    print("$EndElements", file=out)
