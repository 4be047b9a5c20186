# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports on ground that moves differently from place to place, and the static part of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.places import nodes_of_facets
from dolfinx_joints.body.supports import Spring
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import closed_stiffness
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.motions.differing import DifferingMotion
from dolfinx_joints.solvers.direct import DirectSolver

# Times whose displacements are kept: a step asks for some more than once.
KEPT = 4


class DifferingGround:
    """Displacements of a model's supports by a motion that differs, relative to its reference.

    Args:
        model: The model.
        motion: The motion.
    """

    def __init__(self, model: Model, motion: DifferingMotion) -> None:
        """Find which motion each support has (collective).

        Raises:
            ValueError: The model rests on springs or dashpots, which have no such motion.
            MeshError: A group of the motion does not exist, or a support is in none.
        """
        _check_supports(model)
        self._model, comm = model, model.jointed.mesh.comm
        dofs, block = model.constraints.dofs, model.gdim
        nodes, self._node = np.unique(dofs // block, return_inverse=True)
        x = model.V.tabulate_dof_coordinates()[nodes]
        members = {
            group: np.isin(nodes, nodes_of_facets(model.jointed, model.V, group))
            for group in motion.groups
        }
        if motion.groups:
            _check_members(model, x[~np.any(list(members.values()), axis=0)], motion)
        first = 0.0
        if motion.passage is not None:
            delays = motion.passage.delays(x)
            first = min(comm.allgather(float(delays.min(initial=np.inf))))
        moved = motion.relative_to_reference(x, members, first)
        axes = np.array([0, 1, 2] if block == 3 else [0, 2])[dofs % block]

        def relative(time: float) -> Floats:
            return moved(time)[self._node, axes]

        self._relative: Callable[[float], Floats] = lru_cache(maxsize=KEPT)(relative)
        self._solver: DirectSolver | None = None

    def moving(self, system: MatrixSystem) -> MatrixSystem:
        """The same system on this ground; prescribed displacements are relative to theirs."""
        own, self._symmetric = system.values, system.symmetric

        def values(time: float) -> Floats:
            return self._relative(time) if own is None else own(time) + self._relative(time)

        return replace(system, values=values)

    def static_part(self, time: float) -> PETSc.Vec:
        """Displacement of the body without inertia, all joints closed and sticking (collective).

        K u_s = 0 at unconstrained dofs, u_s = that of the ground at the supports, equation (12z).

        Args:
            time: Time [s].

        Returns:
            Relative to the reference, [m].
        """
        constrained = self._model.constraints.dofs
        if self._solver is None:
            self._stiffness = closed_stiffness(self._model.stiffness, self._model.contact)
            within = self._stiffness.copy()
            rows = constrained + within.getOwnershipRange()[0]
            within.zeroRowsColumns(rows.astype(PETSc.IntType), diag=1.0)
            self._solver = DirectSolver(within, symmetric=self._symmetric, often=True)
        found, force = self._stiffness.createVecs()
        found.set(0.0)
        found.getArray()[constrained] = self._relative(time)
        self._stiffness.mult(found, force)
        force.scale(-1.0)
        force.getArray()[constrained] = self._relative(time)
        self._solver.solve(force, found)
        return found


def differing_ground(model: Model, motion: Any) -> DifferingGround | None:
    """The ground of a motion, None where it is the same everywhere (collective)."""
    return DifferingGround(model, motion) if isinstance(motion, DifferingMotion) else None


def on_ground(ground: DifferingGround | None, system: MatrixSystem) -> MatrixSystem:
    """The system on its ground, as it is on none."""
    return system if ground is None else ground.moving(system)


def _check_supports(model: Model) -> None:
    """Check that all supports can be moved."""
    if model.absorbing or any(isinstance(support, Spring) for support in model.supports):
        raise ValueError(
            "A DifferingMotion moves Fixed and Prescribed supports; the model also rests on "
            "springs or viscous boundaries."
        )


def _check_members(model: Model, x: Floats, motion: DifferingMotion) -> None:
    """Check that no support is in none of the groups with motions, at ``x`` (collective)."""
    without = np.concatenate(model.jointed.mesh.comm.allgather(x))
    if len(without):
        place = ", ".join(f"{value:g}" for value in without[0, : model.gdim])
        raise MeshError(
            f"motions are given for the groups {', '.join(motion.groups)}; {len(without)} nodes "
            f"with supports are in none of them, such as that at ({place})."
        )
