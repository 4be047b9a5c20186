# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slider on an inclined plane, just below and just above the friction limit.

A block of 40 x 20 mm, E = 2.1e11 Pa, nu = 0, is suspended 2 mm above a rigid plane inclined by 30
degrees. It has two springs of 5 N/m across the plane and two of 2000 N/m along it, per mm of depth.
A pressure of 300 MPa presses it onto the plane. Then a pressure on its side pushes it along the
plane with 0.99 or 1.01 times the friction limit, mu = 0.3. With 0.99 it sticks, with some slip near
the pushed side. With 1.01 it slides until the springs carry the excess, 36 N / 4000 N/m = 9 mm.
The cells are 5 mm, k = 1e15 Pa/m. In our model the springs act on whole faces and the pressures act
in sequence; in the source the springs act at corners and both pressures grow together.

The slip exceeds the cell size, and joint points keep their partners. This is no error on a plane.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, Row, estimate, new_figure
from validation.grids import line, quads

SOURCE = "code_aster's test SSNV503 (V6.04.503), displacements and forces printed there"

LENGTH, HEIGHT, CELL, DISTANCE, FRICTION = 0.04, 0.02, 0.005, 2e-3, 0.3
PRESSURE, STIFFNESS = 300e6, 1e15  # [Pa], of the joint [Pa/m]
# Relative errors: by cells, where halving them changes 0.06 %, and by the joint's elastic overlap,
# pressure / stiffness = 0.0003 mm compared with displacements of 1 mm and more.
CELLS, SOFTNESS = 0.001, PRESSURE / STIFFNESS / 1e-3
ALONG, ACROSS = 2 * 2e6, 2 * 5e3  # springs per depth [N/m per m]
# Displacements (x, y) of the pushed corner and of the other corner [mm].
PRESSED = ((1.0, -1.732051), (1.0, -1.732051))
STUCK = ((1.021344, -1.719728), (1.0, -1.732051))
SLID = ((8.809533, 2.776785), (8.786944, 2.763743))
NORMAL, SHEAR_STUCK, SHEAR_SLID = 12000.0, 3564.0, 3600.0  # [N per mm of depth]
TURN = np.array(
    [
        [np.cos(np.radians(30.0)), -np.sin(np.radians(30.0))],
        [np.sin(np.radians(30.0)), np.cos(np.radians(30.0))],
    ]
)


def slider(share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements of the lower corners [m], and normal and shear joint force [N/m].

    Args:
        share: Push on the side relative to the friction limit.
    """
    across, high = round(LENGTH / CELL), round(HEIGHT / CELL)
    grid = np.arange((across + 1) * (high + 2)).reshape(high + 2, across + 1)
    y, x = np.indices(grid.shape)
    jointed = dj.mesh_from_arrays(
        MPI.COMM_SELF,
        cell="quadrilateral",
        x=CELL * np.column_stack([x.ravel(), y.ravel() - 1.0]) @ TURN.T,
        cells=quads(grid),
        facet_groups={
            "ground": line(grid[0]),
            "joint_1": line(grid[1]),
            "top": line(grid[-1]),
            "left": line(grid[1:, 0]),
            "right": line(grid[1:, -1]),
        },
    )
    press = dj.Pressure(group="top", value=PRESSURE)
    push = dj.Pressure(group="left", value=share * FRICTION * PRESSURE * LENGTH / HEIGHT)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=2.1e11, poisson=0.0, density=7800.0),
        joints=dj.Joints(
            dj.FrictionNoTension(
                normal_stiffness=STIFFNESS,
                shear_stiffness=STIFFNESS,
                friction_angle_deg=float(np.degrees(np.arctan(FRICTION))),
            ),
            initial_gaps={"joint_1": DISTANCE},
        ),
        supports=[
            dj.Fixed(group="ground"),
            dj.Fixed(group="joint_1-"),
            dj.Spring(group="right", normal_stiffness=ALONG / HEIGHT),
            dj.Spring(group="top", normal_stiffness=ACROSS / LENGTH),
        ],
        loads=[press, push] if share else [press],
    )
    run = dj.Simulation(model)
    state = run.statics(loads=[press])
    if share:
        state = run.statics()
    places = model.V.tabulate_dof_coordinates()[model.nodes("joint_1+")]
    corners = model.nodes("joint_1+")[np.argsort(places[:, 0])[[0, -1]]]
    moved = state.displacement.getArray(readonly=True).reshape(-1, 2)[corners]
    areas = model.operator.areas
    return moved, np.abs(areas @ state.joints.traction[:, :2])


def run(quick: bool) -> Outcome:
    """Press the block, and push it with 0.99 and 1.01 times the friction limit."""
    rows = []
    figure, ax = new_figure()
    cases = ((0.0, PRESSED, 0.0), (0.99, STUCK, SHEAR_STUCK), (1.01, SLID, SHEAR_SLID))
    for share, moved, shear in cases:
        corners, force = slider(share)
        for corner, ours, theirs in zip(("pushed", "other"), 1e3 * corners, moved, strict=True):
            for axis in range(2):
                rows.append(
                    Row(
                        quantity=f"{corner} corner, {'xy'[axis]} [mm], push {share:g}",
                        ours=float(ours[axis]),
                        theirs=theirs[axis],
                        **estimate(softness=SOFTNESS, cells=CELLS),
                    )
                )
        for direction, ours, theirs in (("normal", force[0], NORMAL), ("shear", force[1], shear)):
            rows.append(
                Row(
                    quantity=f"{direction} force [N/mm], push {share:g}",
                    ours=1e-3 * float(ours),
                    theirs=theirs,
                    **estimate(equilibrium=0.001),
                    scale=None if theirs else NORMAL,
                )
            )
        ax.plot(share, 1e3 * (TURN.T @ corners[0])[0], "o", color="C0")
    pushes = np.linspace(0.0, 1.02, 103)
    slip = np.maximum(pushes - 1.0, 0.0) * FRICTION * PRESSURE * LENGTH / ALONG
    ax.plot(pushes, 1e3 * slip, "k:", label="exact")
    ax.set_xlabel("push / friction")
    ax.set_ylabel("displacement along the plane [mm]; dots: ours")
    ax.legend()
    return Outcome(rows=rows, figure=figure)
