# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction work and displacement of rigid joints, compared with their limit, by time step.

There are two scenes. Two masses on a spring are thrown obliquely; their motion is known (`Thrown`).
A block of hexahedra is thrown on another one; its limit is for steps to zero, and for joints
without mass also for stiffness to infinity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.shared.problems import Problem, blocks, march
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.laws.law import CondensedLaw

Floats = NDArray[np.float64]

FRICTION = math.tan(math.radians(20.0))
STEPS = (2e-5, 1e-5, 5e-6, 2.5e-6, 1.25e-6, 6.25e-7)


class End(NamedTuple):
    """End of a run: displacement [m], friction work [J], loss in impacts [J], imbalance."""

    displacement: Floats
    friction: float
    lost: float
    ledger: float


@dataclass(frozen=True, kw_only=True)
class Thrown:
    r"""Two masses connected by a vertical spring, thrown obliquely on the ground; no gravity.

    Both fall at V and move horizontally at U. The lower one, m1, strikes and stops. The upper one
    reverses on the spring, y = -(V/w) sin(w t) with w^2 = k / m2, presses by k V/w sin(w t), and
    lifts the lower one at w t = pi. In flight the mean velocity is m2 V / M with M = m1 + m2, and
    the spring oscillates with W^2 = k M / (m1 m2). The friction impulse is mu times the normal one:

        U -> U - mu m1 V / M at once, - mu m2 V / M (1 - cos(w t)) in contact.

    Attributes:
        lower: m1 [kg].
        upper: m2 [kg].
        spring: k [N/m].
        friction: mu.
        height: Initial height of the lower mass [m].
        fall: V [m/s].
        along: U [m/s], more than mu V (m1 + 2 m2) / M.
    """

    lower: float = 1.0
    upper: float = 3.0
    spring: float = 3e4
    friction: float = 0.3
    height: float = 0.0123
    fall: float = 1.0
    along: float = 2.0

    def at_end(self, flight: float) -> End:
        """Return heights (without the spring's length) and horizontal path after a flight [s]."""
        m1, m2, k, v = self.lower, self.upper, self.spring, self.fall
        mass, w = m1 + m2, math.sqrt(k / m2)
        turn = math.sqrt(k * mass / (m1 * m2))
        rise, swing = m2 * v / mass * flight, math.sin(turn * flight) / turn * v / mass
        after, slower = self.along - self.friction * m1 * v / mass, self.friction * m2 * v / mass
        final_speed = after - 2.0 * slower
        path = self.along * self.height / v + (after - slower) * math.pi / w + final_speed * flight
        return End(
            displacement=np.array([rise - m2 * swing, rise + m1 * swing, path]),
            friction=0.5 * mass * (self.along**2 - final_speed**2),
            lost=0.5 * m1 * v**2,
            ledger=0.0,
        )

    def problem(self, law: CondensedLaw, flight: float) -> Problem:
        """Return the masses on a joint with an area of 1 m^2."""
        m1, m2, k = self.lower, self.upper, self.spring
        stiffness = np.zeros((4, 4))
        stiffness[:2, :2] = [[k, -k], [-k, k]]
        contact = math.pi / math.sqrt(k / m2)
        return Problem(
            system=dj.MatrixSystem.from_arrays(
                mass=np.diag([m1, m2, m1 + m2, m1 + m2]),
                stiffness=stiffness,
                gap=[[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
                initial_gap=self.height,
                law=law,
            ),
            period=contact,
            end=self.height / self.fall + contact + flight,
            displacement=np.zeros(4),
            velocity=np.array([-self.fall, -self.fall, self.along, 0.0]),
        )


def thrown_error(steps: int, flight: float = 0.01) -> tuple[float, float, float, float]:
    """Return relative errors of the masses' displacement, friction work and loss; imbalance."""
    scene = Thrown()
    law = dj.RigidJoint(friction_coefficient=scene.friction, restitution=0)
    problem, exact = scene.problem(law, flight), scene.at_end(flight)
    end = run(problem, problem.end / steps)
    displacement = end.displacement[:3] + np.array([scene.height, scene.height, 0.0])
    off = np.linalg.norm(displacement - exact.displacement) / np.linalg.norm(exact.displacement)
    friction, lost = end.friction / exact.friction - 1.0, end.lost / exact.lost - 1.0
    return float(off), abs(friction), abs(lost), end.ledger


def run(problem: Problem, dt: float) -> End:
    """Integrate a problem by the energy-consistent scheme in steps of dt [s]."""
    end = march(problem, dj.EnergyConsistent(), dt)
    assert end.ledger is not None
    return End(end.displacement[-1], end.row.friction, end.row.impact, end.ledger)


def rigid(restitution: int) -> dj.RigidJoint:
    """Return the rigid joint of the blocks."""
    return dj.RigidJoint(friction_coefficient=FRICTION, restitution=restitution)


def stiff(stiffness: float) -> dj.FrictionNoTension:
    """Return a joint with k_n = k_s [Pa/m]."""
    return dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=stiffness, friction_coefficient=FRICTION
    )


def _show(label: str, ends: list[End], limit: End) -> None:
    """Print errors of runs relative to a limit, in per cent."""
    size = np.linalg.norm(limit.displacement)
    u = [100 * np.linalg.norm(e.displacement - limit.displacement) / size for e in ends]
    f = [100 * abs(e.friction / limit.friction - 1.0) for e in ends]
    print(f"{label:28s} u [%] {' '.join(f'{x:8.4f}' for x in u)}")
    print(f"{'':21s} friction [%] {' '.join(f'{x:8.4f}' for x in f)}   to {limit.friction:.4f} J")


def main() -> None:
    """Print tables."""
    Parser(description=__doc__.splitlines()[0]).parse_args()
    print("two masses, restitution 0: steps, errors of displacement, friction, loss [%], ledger")
    for steps in (100, 200, 400, 800, 1600, 3200):
        *errors, ledger = thrown_error(steps)
        print(f"{steps:6d} {' '.join(f'{100 * e:9.4f}' for e in errors)}   {ledger:.0e}")
    print(f"blocks: steps of {', '.join(f'{dt:g}' for dt in STEPS)} s")
    for label, restitution, massless in (
        ("restitution 0", 0, False),
        ("restitution 1", 1, False),
        ("without mass at the joint", 1, True),
    ):
        problem = blocks(end=2e-3, law=rigid(restitution), massless=massless)
        ends = [run(problem, dt) for dt in STEPS]
        limit = ends[-1] if label == "restitution 1" else _limit(*ends[-2:], order=1 + massless)
        _show(label, ends, limit)
        if massless:
            stiffer = [blocks(end=2e-3, law=stiff(k), massless=True) for k in (1e12, 1e13, 1e14)]
            _show("k = 1e12, 1e13, 1e14 Pa/m", [run(case, STEPS[-2]) for case in stiffer], limit)


def _limit(longer: End, shorter: End, *, order: int) -> End:
    """Return Richardson's limit of runs with steps in the ratio 2 to 1."""
    weight = 1.0 / (2.0**order - 1.0)
    pairs = zip(longer, shorter, strict=True)
    return End(*((1.0 + weight) * np.asarray(y) - weight * np.asarray(x) for x, y in pairs))


if __name__ == "__main__":
    main()
