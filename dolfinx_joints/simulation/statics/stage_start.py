# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Start of a static stage: what the joints carry there, and the loads in balance with it."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.laws.law import BACKWARD_EULER, Response, Status
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.simulation.outcome import StaticState

# Forces that earlier stages left in joints and blocks that did not act, as a load of the ledger.
CONSTRUCTION = "construction"


def start_of_stage(system: MatrixSystem, before: StaticState | None) -> Response | None:
    """Return the response of joints and plastic cells at the start of a stage (collective).

    It is that of the last stage, or of the unloaded body; None without joints and plastic cells.
    """
    internal_forces = system.internal_forces
    if internal_forces is None:
        return None
    if before is not None and before.joints is not None:
        return before.joints
    still = system.stiffness.createVecRight()
    if before is None:
        still.set(0.0)
    else:
        before.displacement.copy(still)
    rest = internal_forces.at_rest(still)
    still.set(0.0)
    if system.bulk is not None or system.contact is None or not system.contact.rigid:
        response: Response = internal_forces.respond(still, rest, BACKWARD_EULER)
        return response
    count = len(rest.gap)
    return Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=rest,
        dissipation=np.zeros(count),
        status=np.full(count, Status.OPEN, dtype=np.int8),
    )


def carried_loads(
    system: MatrixSystem, before: StaticState | None, start: Response | None
) -> dict[str, PETSc.Vec]:
    """Return the loads by name that are in balance at the start of a stage [N] (collective).

    Args:
        system: The system with all joints and blocks.
        before: Last static state, None for the unloaded body.
        start: Response of joints and plastic cells at the start.
    """
    rest = system.stiffness.createVecRight()
    if before is None:
        loads = {}
        rest.set(0.0)
    else:
        loads = {name: load for name, load in before.loads.items() if name != CONSTRUCTION}
        system.stiffness.mult(before.displacement, rest)
        rest.axpy(-1.0, before.reaction)
    if system.internal_forces is not None and start is not None:
        rest.axpy(1.0, system.internal_forces.force(start, rest.duplicate()))
    if before is None:
        rest.getArray()[system.constrained] = 0.0
    for load in loads.values():
        rest.axpy(-1.0, load)
    if rest.norm() > 0.0:
        loads[CONSTRUCTION] = rest
    return loads
