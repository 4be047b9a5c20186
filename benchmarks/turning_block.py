# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip of a block on a shaken base compared with the exact slip, by steps per cycle.

A block of 1 kg is pressed by 10 N with mu = 0.2 on a level base that is shaken by A cos(2 pi t) +
B. It reverses, or stops and restarts, six times in three cycles. `exact_slip` joins the integrals
of the load at these times.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import dolfinx_joints as dj
from benchmarks.shared.problems import Problem, march, on_ground
from dolfinx_joints.common.command_line import Parser

Floats = NDArray[np.float64]

FRICTION, CYCLES, OMEGA = 2.0, 3.0, 2.0 * math.pi  # [N], cycles of 1 s, [1/s]

# A and B [m/s^2]: immediate reversals, two- or one-sided; with rest in between.
MOTIONS = {"4, 0.5": (4.0, 0.5), "8, 0": (8.0, 0.0), "2.5, 0.3": (2.5, 0.3), "3, 0.7": (3.0, 0.7)}


def exact_slip(amplitude: float, bias: float, times: Floats) -> Floats:
    """Return the exact slip of the block at times (t,) [s], from rest at 0, shape (t,), [m].

    Rigid Coulomb friction: x'' = p - F sign(x') while it slides, at rest while |p| <= F. Between
    two events velocity and slip are the integrals of p - sign F; the events are found to 1e-14 s.

    Args:
        amplitude: A [m/s^2].
        bias: B [m/s^2].
        times: Increasing times [s].
    """

    def load(t: float) -> float:
        return amplitude * math.cos(OMEGA * t) + bias

    slip, now, x = np.zeros(len(times)), 0.0, 0.0
    while now < times[-1]:
        if abs(load(now)) <= FRICTION * (1 + 1e-12):
            end = _first(lambda t: FRICTION - abs(load(t)), now, times[-1])
            slip[times >= now] = x
        if abs(load(now)) > FRICTION * (1 + 1e-12):
            direction = math.copysign(1.0, load(now))
        else:
            direction, now = math.copysign(1.0, load(end + 1e-9)), end

        def velocity(t: float, t0: float = now, sense: float = direction) -> float:
            swung = amplitude / OMEGA * (math.sin(OMEGA * t) - math.sin(OMEGA * t0))
            return swung + (bias - sense * FRICTION) * (t - t0)

        def moved(t: float, t0: float = now, sense: float = direction) -> float:
            swung = math.cos(OMEGA * t0) - math.cos(OMEGA * t)
            swung -= OMEGA * (t - t0) * math.sin(OMEGA * t0)
            return amplitude / OMEGA**2 * swung + 0.5 * (bias - sense * FRICTION) * (t - t0) ** 2

        if now >= times[-1]:
            break
        end = _first(lambda t, s=direction, v=velocity: s * v(t), now, times[-1])
        later = times >= now
        slip[later] = [x + moved(min(t, end)) for t in times[later]]
        x, now = x + moved(end), end
    return slip


def _first(value: Callable[[float], float], start: float, end: float) -> float:
    """Return the first zero of a value that is positive after the start, or a time past the end."""
    places = np.linspace(start, end + 1e-3, 4000)[1:]
    below = np.flatnonzero([value(t) <= 0.0 for t in places])
    if not len(below):
        return end + 1e-3
    last = places[below[0] - 1] if below[0] else start + 1e-9
    return float(brentq(value, last, places[below[0]], xtol=1e-15))


def block(amplitude: float, bias: float, stiffness: float) -> Problem:
    """Return the block on a joint of stiffness k_n = k_s [N/m], rigid if infinite."""
    system, depth = on_ground(
        stiffness=0.0,
        shear_stiffness=stiffness,
        friction=FRICTION,
        push=lambda t: amplitude * math.cos(OMEGA * t) + bias,
    )
    return Problem(
        system=system,
        period=1.0,
        end=CYCLES,
        displacement=np.array([0.0, -depth, 0.0]),
        velocity=np.zeros(3),
        component=1,
        compared=slice(0, 1),
    )


def error(motion: tuple[float, float], stiffness: float, steps: int) -> tuple[float, int, float]:
    """Return the largest slip error over its range, solved steps per cycle, and imbalance."""
    run = march(block(*motion, stiffness), dj.EnergyConsistent(), 1.0 / steps)
    exact = exact_slip(*motion, run.time)
    off = float(np.abs(run.displacement[:, 0] - exact).max() / np.ptp(exact))
    return off, round(run.solves / CYCLES), run.ledger or 0.0


def main() -> None:
    """Print a table."""
    Parser(description=__doc__.splitlines()[0]).parse_args()
    print("A, B [m/s^2]   k [N/m]   slip error [%] at 100, 200, 400, 800 steps per cycle   ledger")
    for stiffness in (1e10, math.inf):
        for name, motion in MOTIONS.items():
            results = [error(motion, stiffness, steps) for steps in (100, 200, 400, 800)]
            errors = " ".join(f"{100 * off:8.4f}" for off, _, _ in results)
            print(f"{name:12s} {stiffness:8.0e}   {errors}   {max(f[2] for f in results):.0e}")


if __name__ == "__main__":
    main()
