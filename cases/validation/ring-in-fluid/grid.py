#!/usr/bin/env python3
"""Writes the ring and the grid around it: python3 grid.py FACES RING.msh GRID.msh (Gmsh 4.1, ASCII)

FACES quadrilaterals around the ring, a quarter as many cells between the ring and the outer wall, one cell of 0.1 m along y. The
ring of RING.msh is larger by DOUBLE_STRAIN / 2: bending pulls the cloth, which is flat as cut, to the radius of GRID.msh.
"""
import math
import sys

FACES, RING, GRID = int(sys.argv[1]), sys.argv[2], sys.argv[3]
LAYERS = FACES // 4
RADIUS, WALL, WIDTH = 1.05, 1.5, 0.1
STIFFNESS, BENDING = 1.1538461538461538e5, 106.0096154  # of the scene, N/m and N m
CUT = RADIUS / (1.0 - BENDING / (STIFFNESS * RADIUS**2))  # unstressed radius
POINTS = {"east": 0, "north": FACES // 4, "west": FACES // 2, "south": 3 * FACES // 4}


def circle(radius, j):
    for i in range(FACES):
        angle = 2.0 * math.pi * i / FACES
        yield radius * math.cos(angle), WIDTH * (j - 0.5), radius * math.sin(angle)


def write(path, nodes, groups, blocks):
    """Nodes from 1; `groups`: names by dimension and number; `blocks`: dimension, groups, Gmsh shape, elements."""
    entities = [[b for b in blocks if b[0] == dim] for dim in range(4)]
    radius = max(x for x, _, _ in nodes)
    box = f"{-radius} {-WIDTH} {-radius} {radius} {WIDTH} {radius}"
    with open(path, "w", encoding="ascii") as out:
        print("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames", file=out)
        print(len(groups), *(f'{dim} {n} "{g}"' for (dim, n), g in groups.items()), sep="\n", file=out)
        print("$EndPhysicalNames\n$Entities", file=out)
        print(*map(len, entities), file=out)
        for dim, of_dim in enumerate(entities):
            for tag, (_, numbers, _, _) in enumerate(of_dim, 1):
                place = "0 0 0" if dim == 0 else box
                bounded = "" if dim == 0 else " 0"
                print(f"{tag} {place} {len(numbers)} {' '.join(map(str, numbers))}{bounded}", file=out)
        last = max(dim for dim, *_ in blocks)
        print(f"$EndEntities\n$Nodes\n1 {len(nodes)} 1 {len(nodes)}\n{last} 1 0 {len(nodes)}", file=out)
        print(*range(1, len(nodes) + 1), sep="\n", file=out)
        print(*(f"{x!r} {y!r} {z!r}" for x, y, z in nodes), sep="\n", file=out)
        elements = sum(len(members) for *_, members in blocks)
        print(f"$EndNodes\n$Elements\n{len(blocks)} {elements} 1 {elements}", file=out)
        number = 0
        for dim, of_dim in enumerate(entities):
            for tag, (_, _, shape, members) in enumerate(of_dim, 1):
                print(f"{dim} {tag} {shape} {len(members)}", file=out)
                for member in members:
                    number += 1
                    print(number, *member, file=out)
        print("$EndElements", file=out)


def ring():
    """Strip of quadrilaterals with the normal outwards, two nodes at each of the named points."""
    node = lambda i, j: 1 + i % FACES + FACES * j
    nodes = [x for j in range(2) for x in circle(CUT, j)]
    faces = [[node(i, 0), node(i, 1), node(i + 1, 1), node(i + 1, 0)] for i in range(FACES)]
    groups = {(2, 1): "canopy", (2, 2): "fixed-y", (0, 1): "fixed-z", (0, 2): "fixed-x"}
    groups |= {(0, n): name for n, name in enumerate(POINTS, 3)}
    blocks = [(2, [1, 2], 3, faces)]
    for n, (name, i) in enumerate(POINTS.items(), 3):
        held = 1 if name in ("east", "west") else 2  # the tangential component
        blocks.append((0, [held, n], 15, [[node(i, 0)], [node(i, 1)]]))
    write(RING, nodes, groups, blocks)


def grid():
    node = lambda i, j, k: 1 + i % FACES + FACES * (j + 2 * k)
    radii = [RADIUS + (WALL - RADIUS) * k / LAYERS for k in range(LAYERS + 1)]
    nodes = [x for r in radii for j in range(2) for x in circle(r, j)]
    quad = lambda i, k: [node(i, 0, k), node(i, 1, k), node(i + 1, 1, k), node(i + 1, 0, k)]
    side = lambda i, k, j: [node(i, j, k), node(i + 1, j, k), node(i + 1, j, k + 1), node(i, j, k + 1)]
    every = [(i, k) for k in range(LAYERS) for i in range(FACES)]
    blocks = [
        (2, [1], 3, [quad(i, 0) for i in range(FACES)]),
        (2, [2], 3, [quad(i, LAYERS) for i in range(FACES)]),
        (2, [3], 3, [side(i, k, 0) for i, k in every]),
        (2, [4], 3, [side(i, k, 1) for i, k in every]),
        (3, [1], 5, [side(i, k, 0) + side(i, k, 1) for i, k in every]),
    ]
    groups = {(2, n): g for n, g in enumerate(["canopy", "wall", "front", "back"], 1)} | {(3, 1): "fluid"}
    write(GRID, nodes, groups, blocks)


ring()
grid()
