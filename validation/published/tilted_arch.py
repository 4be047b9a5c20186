# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Horizontal acceleration that turns an arch into a mechanism.

A circular arch of seven voussoirs has a centre line of 10 m radius over 157.5 degrees and is 1.5 m
thick. It is loaded by its weight and a constant ground acceleration. Oppenheim's analysis of the
four-link mechanism gives 0.37 g. The static theorem of limit analysis gives the exact limit, by a
linear program for rigid blocks without tension and with friction coefficient 1. We find the limit
by bisection between static stages that converge and static stages that do not. A voussoir has 4 x 2
cells, k_n = 1e10 Pa/m and joint points at the nodes. Hinges form where the line of thrust touches
an edge.

Also compared is Milankovitch's least thickness of a semicircular arch under self weight, t/R =
0.1075, with 27 voussoirs. A hinge is at most half a joint spacing from its optimal place, which
changes the result by at most 0.6/n^2.

Displacements are small in this program, so the limit is the onset of rocking. Whether the arch
collapses under a pulse depends on large rotations, which this program does not model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

import dolfinx_joints as dj
from dolfinx_joints.geometry.voussoir_arch import voussoir_arch
from validation.atlas import Outcome, Row, new_figure

SOURCE = (
    "Oppenheim, Earthquake Eng. Struct. Dyn. 21, 1992; De Lorenzis, DeJong, Ochsendorf 2007; "
    "Milankovitch 1907; linear program"
)

Floats = NDArray[np.float64]
RADIUS, THICKNESS, HALF_ANGLE, VOUSSOIRS = 10.0, 1.5, 78.75, 7
GRAVITY, FRICTION = 9.80665, 1.0


def simulation(acceleration: float, thickness: float, half_angle: float, n: int) -> dj.Simulation:
    """Return the arch under its weight and a horizontal acceleration relative to g."""
    with TemporaryDirectory() as folder:
        path = voussoir_arch(
            Path(folder) / "arch.msh",
            radius=RADIUS,
            thickness=thickness,
            half_angle=half_angle,
            voussoirs=n,
            divisions=(4, 2, 1) if n < 10 else (1, 2, 1),
        )
        jointed = dj.read_msh(path, MPI.COMM_SELF)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=2e14, poisson=0.2, density=2400.0),
        joints=dj.Joints(
            dj.FrictionNoTension(
                normal_stiffness=1e10,
                shear_stiffness=1e10,
                friction_angle_deg=math.degrees(math.atan(FRICTION)),
            ),
            quadrature="nodal",
        ),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(acceleration * GRAVITY, -GRAVITY))],
    )
    return dj.Simulation(model, options=dj.SolverOptions(max_iterations=60))


def bisect(of: Callable[[float], dj.Simulation], stands: float, falls: float, steps: int) -> float:
    """Bisect between a parameter for which the arch stands and one for which it falls."""
    for _ in range(steps):
        middle = (stands + falls) / 2.0
        try:
            of(middle).statics()
            stands = middle
        except dj.ConvergenceError:
            falls = middle
    return (stands + falls) / 2.0


def limit() -> float:
    """Return the largest acceleration relative to g with an equilibrium of rigid blocks.

    Unknowns are N, V, M of each joint and the acceleration, with |M| <= N t/2, |V| <= mu N.
    """
    joints = VOUSSOIRS + 1
    angle = np.radians(np.linspace(-HALF_ANGLE, HALF_ANGLE, joints))
    along = np.column_stack([np.cos(angle), -np.sin(angle)])
    radial = np.column_stack([np.sin(angle), np.cos(angle)])
    outer, inner, half = (
        RADIUS + THICKNESS / 2,
        RADIUS - THICKNESS / 2,
        np.ptp(angle) / 2 / VOUSSOIRS,
    )
    weight = (outer**2 - inner**2) * half
    distance = 2 * (outer**3 - inner**3) * math.sin(half) / 3 / weight
    middle = (angle[1:] + angle[:-1]) / 2
    centre = distance * np.column_stack([np.sin(middle), np.cos(middle)])
    rows = np.zeros((VOUSSOIRS, 3, 3 * joints + 1))
    for block in range(VOUSSOIRS):
        for joint, sign in ((block, 1.0), (block + 1, -1.0)):
            arm = RADIUS * radial[joint] - centre[block]
            for column, force in enumerate((along[joint], radial[joint])):
                moment = arm[0] * force[1] - arm[1] * force[0]
                rows[block, :, 3 * joint + column] = sign * np.array([*force, moment])
            rows[block, 2, 3 * joint + 2] = sign
    rows[:, 0, -1] = weight
    cone = np.array(
        [[-THICKNESS / 2, 0, 1], [-THICKNESS / 2, 0, -1], [-FRICTION, 1, 0], [-FRICTION, -1, 0]]
    )
    bounds = np.kron(np.eye(joints), cone)
    optimum = linprog(
        np.append(np.zeros(3 * joints), -1.0),
        A_ub=np.column_stack([bounds, np.zeros(len(bounds))]),
        b_ub=np.zeros(len(bounds)),
        A_eq=rows.reshape(3 * VOUSSOIRS, -1),
        b_eq=np.tile([0.0, weight, 0.0], VOUSSOIRS),
        bounds=(None, None),
    )
    return float(-optimum.fun)


def thrust(model: dj.Model, state: Any) -> Floats:
    """Return radii of the line of thrust at the joints, from left to right [m]."""
    operator = model.operator
    assert operator is not None
    pressure = -state.traction[:, 0] * operator.areas
    radius = np.linalg.norm(operator.points[:, :2], axis=1)
    weighed = [np.bincount(operator.joint, values) for values in (pressure * radius, pressure)]
    return np.asarray(weighed[0] / weighed[1])


def run(quick: bool) -> Outcome:
    """Bisect; ``quick`` has 6 steps and omits Milankovitch's arch."""
    of = lambda a: simulation(a, THICKNESS, HALF_ANGLE, VOUSSOIRS)  # noqa: E731
    acceleration, exact = bisect(of, 0.3, 0.44, 6 if quick else 12), limit()
    rows = [
        Row(
            quantity="acceleration of the mechanism / g, Oppenheim",
            ours=acceleration,
            theirs=0.37,
            tolerance=0.014,
            reason="printed with two digits",
        ),
        Row(
            quantity="acceleration of the mechanism / g, linear program",
            ours=acceleration,
            theirs=exact,
            tolerance=0.01,
            reason="straight edges of cells between nodes on the arcs",
        ),
    ]
    if not quick:
        thin = bisect(lambda t: simulation(0.0, t * RADIUS, 90.0, 27), 0.15, 0.09, 11)
        rows.append(
            Row(
                quantity="least t/R of a semicircular arch, Milankovitch",
                ours=thin,
                theirs=0.1075,
                tolerance=0.008,
                reason="27 voussoirs: 0.6/n^2",
            )
        )
    figure, ax = new_figure(height=3.4)
    angle = np.radians(np.linspace(-HALF_ANGLE, HALF_ANGLE, VOUSSOIRS + 1))
    edges = RADIUS - THICKNESS / 2, RADIUS + THICKNESS / 2
    fine = np.linspace(angle[0], angle[-1], 100)
    for r in edges:
        ax.plot(r * np.sin(fine), r * np.cos(fine), "k-", lw=1)
    for a in angle:
        ax.plot(np.array(edges) * np.sin(a), np.array(edges) * np.cos(a), "k-", lw=0.6)
    for a in (0.0, 0.2, 0.99 * acceleration):
        arch = of(a)
        r = thrust(arch.model, arch.statics().joints)
        ax.plot(r * np.sin(angle), r * np.cos(angle), ".-", label=f"thrust, {a:.3g} g")
    ax.set_aspect("equal")
    ax.grid(visible=False)
    ax.set_xlabel("x [m]; body forces act to the right")
    ax.set_ylabel("height [m]")
    ax.legend(loc="lower center")
    return Outcome(rows=rows, figure=figure)
