#!/usr/bin/env python3
"""Height of the middle of an incompressible neo-Hookean disk with a fixed rim under a uniform pressure (Adkins and Rivlin 1952).

    python3 uniform_pressure.py P...    P: pressure times radius over (Young's modulus times thickness), below 0.35

The stretches along the meridian, l1, and around it, l2 = rho / R, follow from the stretch of the middle outwards over the radius R of the flat disk: T1 = p rho / (2 sin of the
slope), d(T1) / d(rho) = (T2 - T1) / rho. The stretch of the middle is the one with which the rim stays in place.
"""

import math
import sys


def tension(a, b):
    """Force for each deformed width along stretch a, over Young's modulus times thickness; b: the other stretch."""
    return (a * a - 1 / (a * b) ** 2) / (3 * a * b)


def stretch(force, b, guess):
    """Stretch along which the force acts, by Newton's method."""
    a = guess
    for _ in range(50):
        slope = (tension(a + 1e-7, b) - tension(a, b)) / 1e-7
        step = (tension(a, b) - force) / slope
        a -= step
        if abs(step) < 1e-14:
            break
    return a


def profile(middle, p, points=1500):
    """Radius of the rim and height of the middle, over the radius of the flat disk; None where the slope passes the vertical."""
    h = 1 / points
    r, rho, force, height, l1 = h, middle * h, tension(middle, middle), 0.0, middle

    def rates(r, rho, force, guess):
        l2 = rho / r
        l1 = stretch(force, l2, guess)
        sine = p * rho / (2 * force)
        if sine > 1:
            return None
        out = l1 * math.sqrt(1 - sine * sine)
        return out, (tension(l2, l1) - force) / rho * out, l1 * sine, l1

    for _ in range(1, points):
        start = rates(r, rho, force, l1)
        half = start and rates(r + h / 2, rho + h / 2 * start[0], force + h / 2 * start[1], start[3])
        if not half:
            return None
        rho, force, height, l1, r = rho + h * half[0], force + h * half[1], height + h * half[2], half[3], r + h
    return rho, height


for p in map(float, sys.argv[1:]):
    low, high = 1 + 1e-9, 3.0
    for _ in range(60):
        middle = (low + high) / 2
        found = profile(middle, p)
        low, high = (middle, high) if found is None or found[0] < 1 else (low, middle)
    found = profile(high, p)
    if found is None or abs(found[0] - 1) > 1e-6:
        sys.exit(f"no equilibrium was found at {p}: give less than 0.35")
    print(f"{p:.4f}: height {found[1]:.4f} of the radius, stretch of the middle {high:.4f}")
