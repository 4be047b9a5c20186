# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Block with a slipping crack under a cycle of compression.

A block 1 m wide, 2 m high and 1 m deep, E = 88.9 GPa, nu = 0.26, is cut at 45 degrees by a plane
with k_n = k_s = 220 GPa/m. Of its length L = 1.414 m the middle l = 0.54 m slides with 16 degrees
of friction; the remainder is elastic. Its top is pressed down and released. The curve of force and
displacement has three straight parts: loading with slip, the start of unloading with a sticking
crack, and further unloading with reverse slip. The model of Olsson and Brady has block and joint in
series, each under a uniform stress,

    1/k = H/(W B E) + cos^2(a)/(k_n L B) + sin^2(a)/(k_s L B),
    loading    k / (1 + k sin(a) sin(a - phi) / (k_s B (L - l) cos(phi))),
    unloading  k, then with sin(a + phi) instead of sin(a - phi),

In our model the stress in the block is not uniform while the middle slides. It has quadratic cells
of 1/24 m in plane stress. Halving the cells changes the stiffnesses by 0.03 %, so the differences
of 0.7 and 0.8 % are errors of the closed form. We did not isolate which of its assumptions causes
them.
"""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, Row, estimate, new_figure
from validation.grids import line, quads

SOURCE = (
    "Olsson, J. Geophys. Res. 87, 1982; Brady et al. 1985, with the numbers of 3DEC's "
    "verification problem 'Block with a Slipping Crack under Cyclic Loading'"
)

YOUNG, POISSON, STIFFNESS = 88.9e9, 0.26, 220e9  # [Pa], -, [Pa/m]
WIDTH, HEIGHT, SLIPS, ANGLE, FRICTION = 1.0, 2.0, 0.54, 45.0, 16.0  # [m], [degrees]
PRESSED = 1e-3  # displacement of the top [m]

# Relative error of stiffnesses: the change from cells of 1/12 m to 1/24 m.
CELLS = 0.001
# Larger deviations, which are errors of the closed form.
DIFFERS = {"loading": -0.0068, "unloading, slipping": -0.0077}


def mesh(cells: int) -> dj.JointedMesh:
    """Return the block in quadrilaterals along the plane, with ``cells`` over half the height."""
    half = SLIPS * math.cos(math.radians(ANGLE)) / 2.0
    inner = max(1, round(2.0 * half * cells / WIDTH))
    outer = max(1, round((WIDTH / 2.0 - half) * cells / WIDTH))
    x = np.concatenate(
        [
            np.linspace(-WIDTH / 2, -half, outer + 1)[:-1],
            np.linspace(-half, half, inner + 1),
            np.linspace(half, WIDTH / 2, outer + 1)[1:],
        ]
    )
    plane = x * math.tan(math.radians(ANGLE))
    t = np.linspace(0.0, 1.0, cells + 1)[:, None]
    below = -HEIGHT / 2 + t * (plane + HEIGHT / 2)
    y = np.vstack([below, (plane + t * (HEIGHT / 2 - plane))[1:]])
    grid = np.arange(y.size).reshape(y.shape)
    on_plane, base = line(grid[cells]), line(grid[0])
    return dj.mesh_from_arrays(
        MPI.COMM_SELF,
        cell="quadrilateral",
        x=np.column_stack([np.broadcast_to(x, y.shape).ravel(), y.ravel()]),
        cells=quads(grid),
        facet_groups={
            "base": base,
            "top": line(grid[-1]),
            "pin": base[[len(x) // 2]],
            "joint_bonded": np.vstack([on_plane[:outer], on_plane[-outer:]]),
            "joint_slips": on_plane[outer:-outer],
        },
    )


def slopes() -> tuple[float, float, float]:
    """Return the stiffness of loading, of unloading, and of unloading with slip [N/m], B = 1 m."""
    a, phi = math.radians(ANGLE), math.radians(FRICTION)
    length = WIDTH / math.cos(a)
    series = HEIGHT / (WIDTH * YOUNG) + (math.cos(a) ** 2 + math.sin(a) ** 2) / (STIFFNESS * length)
    k = 1.0 / series
    bonded = STIFFNESS * (length - SLIPS) * math.cos(phi)
    with_slip = [k / (1.0 + k * math.sin(a) * math.sin(a + s * phi) / bonded) for s in (-1, 1)]
    return with_slip[0], k, with_slip[1]


def run(quick: bool, *, fine: bool = False) -> Outcome:
    """Press and release the block; ``quick`` has half the cells, ``fine`` twice as many."""
    bond = dj.FrictionNoTension(
        normal_stiffness=STIFFNESS, shear_stiffness=STIFFNESS, friction_angle_deg=89.0
    )
    slides = dj.FrictionNoTension(
        normal_stiffness=STIFFNESS, shear_stiffness=STIFFNESS, friction_angle_deg=FRICTION
    )
    model = dj.Model(
        mesh(12 if quick else 48 if fine else 24),
        material=dj.Elastic(young=YOUNG, poisson=POISSON, density=2600.0),
        joints={"joint_bonded": bond, "joint_slips": slides},
        supports=[
            dj.Fixed(group="base", components="y"),
            dj.Fixed(group="pin", components="x"),
            dj.Prescribed(group="top", component="y", value=lambda t: -PRESSED * min(t, 2 - t)),
        ],
        body=dj.Body(plane="stress", degree=2),
    )
    simulation = dj.Simulation(model)
    times = np.linspace(0.0, 2.0, 41)
    reactions = [0.0]
    for t in times[1:]:
        state = simulation.quasi_statics([t])
        reactions.append(-float(model.resultant(state.reaction, "top")[1]))
    pressed, force = PRESSED * np.minimum(times, 2.0 - times), np.array(reactions)
    parts = {
        "loading": slice(5, 21),
        "unloading, stuck": slice(20, 22),
        "unloading, slipping": slice(35, 40),
    }
    rows = []
    for (name, part), theirs in zip(parts.items(), slopes(), strict=True):
        ours = float(np.polyfit(pressed[part], force[part], 1)[0])
        rows.append(
            Row(
                quantity=f"stiffness, {name} [N/m]",
                ours=ours,
                theirs=theirs,
                **estimate(cells=CELLS),
                differs=DIFFERS.get(name),
                cause="the closed form is not exact; ours is converged to 0.03 %",
            )
        )
    figure, ax = new_figure()
    loading, stuck, slipping = slopes()
    top = loading * PRESSED
    at = (top - stuck * PRESSED) / (slipping - stuck)  # where slip back begins
    u, f = np.array([0.0, PRESSED, at, 0.0]), np.array([0.0, top, slipping * at, 0.0])
    ax.plot(1e3 * pressed, 1e-6 * (force - stuck * pressed), label="ours")
    ax.plot(1e3 * u, 1e-6 * (f - stuck * u), "k:", label="model of Brady et al.")
    ax.set_xlabel("displacement of the top [mm]")
    ax.set_ylabel("force minus that of the sticking block [MN]")
    ax.legend()
    return Outcome(rows=rows, figure=figure)
