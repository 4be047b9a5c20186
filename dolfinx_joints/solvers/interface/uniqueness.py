# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bound of the friction coefficient below which a step or an equilibrium is unique."""

from __future__ import annotations

from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.rigid import RigidJoint
from dolfinx_joints.model.model import Model
from dolfinx_joints.solvers.effective_matrix import STATIC, MatrixCoefficients, unconstrained_dofs
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.step_solver import SolverOptions


@checked
def critical_friction(
    model: Model, *, dt: Annotated[float, at.Gt(0), at.Unit("s")] | None = None
) -> float:
    """Return a friction coefficient below which the joint forces are unique, (40) (collective).

    The bound is sufficient, not necessary. It is zero in statics if only joints support a block,
    and if rigid joints share nodes; infinite without shear stiffness. The compliance must be dense.

    Args:
        model: A model with joints.
        dt: Length of a midpoint step [s] with laws evaluated at its end (`ImplicitContact`), an
            estimate for the default scheme; by default the bound is that of a static increment.

    Raises:
        JointsError: The model has no joints, too many for a dense compliance, or other joint laws
            than `FrictionNoTension` and `RigidJoint`.
    """
    system, step = model.system(static=dt is None), STATIC
    if (contact := system.contact) is None:
        raise JointsError("The model has no joints, so it has no critical friction coefficient.")
    for joint, law in contact.laws.items():
        if type(law) not in (FrictionNoTension, RigidJoint):
            given = f"The law of {joint!r} is {type(law).__name__}"
            raise JointsError(f"{given}; it must be FrictionNoTension or RigidJoint.")
    if dt is not None:
        step = MatrixCoefficients(mass=2.0 / dt**2, damping=1.0 / dt, stiffness=0.5)
    operator = contact.operator.constrained(unconstrained_dofs(system))
    condensed = Condensed(system, step, operator, 1.0, SolverOptions())
    if condensed.unsupported:
        return 0.0
    compliance, comm = condensed.compliance, contact.operator.comm
    if (coupling := compliance.split.whole()) is None:
        raise JointsError(
            "The joints have too many points: their compliance must fit into one matrix. Use a "
            "coarser mesh of the joints."
        )
    own = compliance.own
    with np.errstate(divide="ignore", invalid="ignore"):
        of_law = np.repeat(1.0 / (own * contact.closed_stiffness()), (1, 2), axis=1)
        moving = ~compliance.dead & np.isfinite(of_law)  # no shear without shear stiffness
        ratios = (own[:, 1] / own[:, 0])[moving[:, 0] & moving[:, 1]]
    diagonal = 1.0 + np.concatenate(comm.allgather(of_law[moving]))
    chosen = np.concatenate(comm.allgather(moving.ravel()))
    smallest, *_, largest = np.linalg.eigvalsh(coupling[np.ix_(chosen, chosen)] + np.diag(diagonal))
    condensed.destroy()
    ratio = max(comm.allgather(float(ratios.max(initial=0.0))))
    bound = max(0.0, 2.0 * smallest / (largest + smallest))
    return float(bound / np.sqrt(ratio)) if ratio else float("inf")
