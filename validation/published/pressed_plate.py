# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plate pressed onto a rigid plane and pushed along it.

Half of a plate of 80 x 40 mm, E = 1.3e11 Pa, nu = 0.2, is in plane strain with its plane of
symmetry at x = 40 mm. It is on a rigid plane with friction coefficient 1. Its top is pressed with
50 MPa and its side at x = 0 with 150 MPa, both growing together in five steps. The plate lifts off
over 3 mm at that side, slides up to 30 mm and sticks beyond. Displacements along the plane are
compared at five points near the side. Cells are 1.25 mm, of degree 2, k = 1e16 Pa/m.

It is a benchmark of a group of French laboratories (GRECO); the reference is the common result of
their programs. Our displacements are converged to 0.03 % in the cells and to 0.02 % in the
stiffness k. The cause of larger differences is not known: 2.7 % at 11.25 mm from GRECO, whose other
numbers agree, and 0.2 to 1.3 % from code_aster. A softer joint alone does not explain them: k_s =
1e14 Pa/m reduces three of code_aster's five to 0.1 %, but 0.3 and 0.8 % remain at 7.5 and 11.25 mm.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from validation.atlas import Outcome, Row, estimate, new_figure
from validation.grids import line, quads

SOURCE = "code_aster's test SSNV128 A (V6.04.128): results of the GRECO group and of code_aster"

SIDE, CELL = 0.04, 0.00125
# Displacement along the plane [um] by x [mm].
GRECO = {0.0: 28.6, 1.25: 27.2, 5.0: 22.8, 7.5: 19.8, 11.25: 15.0}
CODE_ASTER = {0.0: 28.6488, 1.25: 27.2687, 5.0: 22.9236, 7.5: 19.9289, 11.25: 15.6085}

# Relative errors. By cells of 1.25 mm: the change from 2.5 mm to 1.25 mm; twice as much with cells
# of 2.5 mm. By the stiffness of the joint: a tenth of the change with a joint ten times softer.
CELLS, SOFTNESS = 0.001, 0.0002
# Deviations beyond the estimated errors on the finer cells, by source and x [mm].
DIFFERS = {
    "GRECO": {11.25: 0.0273},
    "code_aster": {0.0: -0.0018, 1.25: -0.0018, 5.0: -0.0027, 7.5: -0.0063, 11.25: -0.0127},
}


def plate(cells: int) -> tuple[dj.Model, dj.Simulation]:
    """Return the plate and a row of fixed cells below it, with the joint at y = 0."""
    grid = np.arange((cells + 1) * (cells + 2)).reshape(cells + 2, cells + 1)
    y, x = np.indices(grid.shape)
    jointed = dj.mesh_from_arrays(
        MPI.COMM_SELF,
        cell="quadrilateral",
        x=SIDE / cells * np.column_stack([x.ravel(), y.ravel() - 1.0]),
        cells=quads(grid),
        facet_groups={
            "ground": line(grid[0]),
            "joint_1": line(grid[1]),
            "top": line(grid[-1]),
            "side": line(grid[1:, 0]),
            "symmetry": line(grid[1:, -1]),
        },
    )
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=1.3e11, poisson=0.2, density=7800.0),
        joints=dj.Joints(
            dj.FrictionNoTension(
                normal_stiffness=1e16, shear_stiffness=1e16, friction_angle_deg=45.0
            ),
            quadrature="nodal",
        ),
        supports=[
            dj.Fixed(group="ground"),
            dj.Fixed(group="joint_1-"),
            dj.Fixed(group="symmetry", components="x"),
        ],
        loads=[dj.Pressure(group="top", value=5e7), dj.Pressure(group="side", value=15e7)],
        body=dj.Body(degree=2),
    )
    return model, dj.Simulation(model)


def run(quick: bool, *, fine: bool = False) -> Outcome:
    """Press and push the plate; ``quick`` doubles, ``fine`` halves the cells."""
    cell = CELL * (2.0 if quick else 0.5 if fine else 1.0)
    model, simulation = plate(round(SIDE / cell))
    state = simulation.statics(steps=5)
    nodes = model.nodes("joint_1+")
    x = 1e3 * model.V.tabulate_dof_coordinates()[nodes, 0]
    u = 1e6 * state.displacement.getArray(readonly=True).reshape(-1, 2)[nodes, 0]
    order = np.argsort(x)
    x, u = x[order], u[order]
    rows = []
    for who, numbers, digits in (("GRECO", GRECO, 3), ("code_aster", CODE_ASTER, 6)):
        for at, theirs in numbers.items():
            rows.append(
                Row(
                    quantity=f"displacement at x = {at:g} mm [um], {who}",
                    ours=float(np.interp(at, x, u)),
                    theirs=theirs,
                    **estimate(
                        theirs,
                        cells=CELLS * max(1.0, cell / CELL),
                        softness=SOFTNESS,
                        digits=digits,
                    ),
                    differs=DIFFERS[who].get(at),
                )
            )
    figure, ax = new_figure()
    ax.plot(x, u, label="ours")
    for who, numbers, mark in (("GRECO", GRECO, "o"), ("code_aster", CODE_ASTER, "x")):
        ax.plot(list(numbers), list(numbers.values()), mark, label=who)
    ax.set_xlabel("distance from the pushed side [mm]")
    ax.set_ylabel("displacement along the plane [µm]")
    ax.legend()
    return Outcome(rows=rows, figure=figure)
