"""The table of docs/records/fault-matrix.md from the cells that `scripts/fault-matrix` found as documented."""

import sys

FAULTS = ["kill", "stop", "term", "exit0", "exit1", "panic", "stall", "nan", "late", "twice"]
MOMENTS = ["start", "handshake", "window", "iteration", "save", "end"]


def possible(who, fault, moment):
    """Whether the cell is part of the matrix."""
    if who == "coupler":
        return fault in ("kill", "stop", "term")
    if fault == "nan":
        return moment in ("window", "iteration", "save")
    return fault != "twice" or moment == "handshake"


def main(cells, document):
    found = {}
    for line in open(cells):
        who, fault, moment, seconds = line.rstrip("\n").split("\t")
        found[who, fault, moment] = seconds
    ranks = [f"{role}, rank {rank}" for role in ("structure", "mesh", "flow") for rank in (0, 1)]
    table = f"| who | fault | {' | '.join(MOMENTS)} |\n|---|---|{'---:|' * len(MOMENTS)}\n"
    tried = wanted = 0
    for who in ["coupler", *ranks]:
        for fault in FAULTS:
            all_of_row = [m for m in MOMENTS if possible(who, fault, m)]
            wanted += len(all_of_row)
            tried += sum((who, fault, m) in found for m in all_of_row)
            if not all_of_row:
                continue
            row = [found.get((who, fault, m), "?") if m in all_of_row else "" for m in MOMENTS]
            table += f"| {who} | {fault} | {' | '.join(row)} |\n"
    table += f"\n{tried} of {wanted} cells as documented; empty: does not exist"
    table += ".\n" if tried == wanted else "; `?`: not tried, or not so.\n"
    text = open(document).read()
    head, rest = text.split("<!-- matrix -->\n")
    _, tail = rest.split("<!-- end of matrix -->\n")
    open(document, "w").write(head + "<!-- matrix -->\n" + table + "<!-- end of matrix -->\n" + tail)


main(*sys.argv[1:])
