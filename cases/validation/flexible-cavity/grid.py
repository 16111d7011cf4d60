#!/usr/bin/env python3
"""Writes the grid of the cavity with a flexible bottom: python3 grid.py CELLS FILE.msh [below] (Gmsh 4.1, ASCII)

One slice of cells of 0.1 m: the unit cavity of CELLS x CELLS above the panel at z = 0; with the word `below` also open air
of 0.25 m below it.
"""
import sys

CELLS, FILE = int(sys.argv[1]), sys.argv[2]
BELOW = CELLS // 4 if "below" in sys.argv[3:] else 0
X = [-0.5 + i / CELLS for i in range(CELLS + 1)]
Y = [-0.05, 0.05]
Z = [(k - BELOW) / CELLS for k in range(BELOW + CELLS + 1)]
GROUPS = ["canopy", "lid", "inlet", "outlet", "walls", *(["below"] if BELOW else []), "front", "back"]
OPENING = 0.875  # inlet and outlet are the upper eighth of the sides


def node(i, j, k):
    return 1 + i + (CELLS + 1) * (j + 2 * k)


faces = {group: [] for group in GROUPS}
for i in range(CELLS):
    for k, group in [(BELOW, "canopy"), (BELOW + CELLS, "lid"), *([(0, "below")] if BELOW else [])]:
        faces[group].append([node(i, 0, k), node(i + 1, 0, k), node(i + 1, 1, k), node(i, 1, k)])
for k in range(BELOW + CELLS):
    for i, opening in [(0, "inlet"), (CELLS, "outlet")]:
        group = "below" if k < BELOW else opening if Z[k] > OPENING - 1e-9 else "walls"
        faces[group].append([node(i, 0, k), node(i, 1, k), node(i, 1, k + 1), node(i, 0, k + 1)])
    for i in range(CELLS):
        for j, group in [(0, "front"), (1, "back")]:
            faces[group].append([node(i, j, k), node(i + 1, j, k), node(i + 1, j, k + 1), node(i, j, k + 1)])
cells = [
    [node(i, 0, k), node(i + 1, 0, k), node(i + 1, 1, k), node(i, 1, k),
     node(i, 0, k + 1), node(i + 1, 0, k + 1), node(i + 1, 1, k + 1), node(i, 1, k + 1)]
    for k in range(BELOW + CELLS) for i in range(CELLS)
]
nodes = [(node(i, j, k), X[i], Y[j], Z[k]) for k in range(len(Z)) for j in range(2) for i in range(len(X))]
box = f"{X[0]} {Y[0]} {Z[0]} {X[-1]} {Y[-1]} {Z[-1]}"
elements = sum(map(len, faces.values())) + len(cells)
with open(FILE, "w", encoding="ascii") as out:
    print("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames", file=out)
    print(len(GROUPS) + 1, *(f'2 {n} "{g}"' for n, g in enumerate(GROUPS, 1)), '3 9 "air"', sep="\n", file=out)
    print(f"$EndPhysicalNames\n$Entities\n0 0 {len(GROUPS)} 1", file=out)
    for n in range(1, len(GROUPS) + 1):
        print(f"{n} {box} 1 {n} 0", file=out)
    print(f"1 {box} 1 9 0\n$EndEntities\n$Nodes\n1 {len(nodes)} 1 {len(nodes)}\n3 1 0 {len(nodes)}", file=out)
    print(*(n for n, *_ in nodes), sep="\n", file=out)
    print(*(f"{x!r} {y!r} {z!r}" for _, x, y, z in nodes), sep="\n", file=out)
    print(f"$EndNodes\n$Elements\n{len(GROUPS) + 1} {elements} 1 {elements}", file=out)
    tag = 0
    for dim, entity, kind, members in [(2, n, 3, faces[g]) for n, g in enumerate(GROUPS, 1)] + [(3, 1, 5, cells)]:
        print(f"{dim} {entity} {kind} {len(members)}", file=out)
        for member in members:
            tag += 1
            print(tag, *member, file=out)
    print("$EndElements", file=out)
