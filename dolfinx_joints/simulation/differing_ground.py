# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports on ground with a different motion at each place, and the static part of the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.places import nodes_of_facets
from dolfinx_joints.body.supports import Spring
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.loads.ground_motion import MOVING
from dolfinx_joints.loads.load import VaryingLoad
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import closed_stiffness
from dolfinx_joints.model.system import MatrixSystem, as_aij
from dolfinx_joints.motions.differing import DifferingMotion
from dolfinx_joints.solvers.direct import DirectSolver

# Number of cached displacement fields: a step evaluates the motion repeatedly at the same times.
KEPT = 4


class DifferingGround:
    """Displacements of the supports under a `DifferingMotion`, relative to its reference motion."""

    def __init__(self, model: Model, motion: DifferingMotion) -> None:
        """Determine the motion of each support (collective).

        Raises:
            ValueError: The model has springs or dashpots to the ground.
            MeshError: A group of the motion does not exist, or a support belongs to no group.
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
        axes = np.array(MOVING[block])[dofs % block]

        def at_dofs(rate: bool) -> Callable[[float], Floats]:
            at_nodes = motion.relative_to_reference(x, members, first, rate=rate)

            def relative(time: float) -> Floats:
                return at_nodes(time)[self._node, axes]

            return lru_cache(maxsize=KEPT)(relative)

        self._relative, self._rate = at_dofs(rate=False), at_dofs(rate=True)
        self._solver: DirectSolver | None = None

    def moving(self, system: MatrixSystem) -> MatrixSystem:
        """Return the system with supports that follow the ground (collective).

        Prescribed displacements are added to the displacement of the ground at the support. Damping
        acts on velocities relative to the static part.
        """
        base, self._symmetric = system.values, system.symmetric

        def values(time: float) -> Floats:
            return self._relative(time) if base is None else base(time) + self._relative(time)

        damping = ground_damping(self._model, lambda time: self._static(self._rate(time)))
        return replace(system, values=values, varying_loads=[*system.varying_loads, *damping])

    def static_part(self, time: float) -> PETSc.Vec:
        """Return the displacement [m] at a time [s] without inertia, joints tied (collective).

        K u_s = 0 at unconstrained dofs (12z). At the supports u_s is the ground displacement
        relative to the reference motion.
        """
        return self._static(self._relative(time))

    def _static(self, at_supports: Floats) -> PETSc.Vec:
        """Solve (12z) for given values at the constrained dofs (collective)."""
        constrained = self._model.constraints.dofs
        if self._solver is None:
            self._stiffness = _tied_stiffness(self._model)
            matrix = self._stiffness.copy()
            rows = constrained + matrix.getOwnershipRange()[0]
            matrix.zeroRowsColumns(rows.astype(PETSc.IntType), diag=1.0)
            self._solver = DirectSolver(
                matrix, symmetric=self._symmetric, often=True, name="ground"
            )
        static, force = self._stiffness.createVecs()
        static.set(0.0)
        static.getArray()[constrained] = at_supports
        self._stiffness.mult(static, force)
        force.scale(-1.0)
        force.getArray()[constrained] = at_supports
        self._solver.solve(force, static)
        return static


def ground_damping(model: Model, velocity: Callable[[float], PETSc.Vec]) -> list[VaryingLoad]:
    """Return the load C_r du_s/dt of (12y) in a list, which is empty if C_r = 0 (collective).

    C_r is C without its stiffness-proportional part. The scheme damps the velocity v relative to
    the reference motion. With this load the damping force is C_r (v - du_s/dt), whatever the
    reference. ``velocity`` is the function du_s/dt of time [s], [m/s] (collective).
    """
    factor, dashpots, modes = model.rayleigh.mass_factor, model.dashpots, model.damped_modes
    if not factor and dashpots is None and modes is None:
        return []
    damping = MatrixSystem(
        mass=model.mass,
        stiffness=model.stiffness,
        rayleigh=Rayleigh(mass_factor=factor),
        dashpots=dashpots,
        damped_modes=modes,
    )

    def force(time: float) -> Floats:
        values: Floats = damping.damping_force(velocity(time), damping.vector()).getArray().copy()
        return values

    rows = slice(model.stiffness.getLocalSize()[0])
    return [VaryingLoad("DifferingMotion_damping", rows, force)]


def _tied_stiffness(model: Model) -> PETSc.Mat:
    """Return K with all joints tied, as a new matrix (collective).

    Joints have the stiffness of their laws. If any law is rigid or has no shear stiffness, each
    joint has the stiffness of its law in series with the adjacent elements.
    """
    body, contact = model.stiffness, model.contact
    if contact is None:
        return closed_stiffness(body, None)
    closed = contact.closed_stiffness()
    untied = np.array([np.count_nonzero(~np.isfinite(closed) | (closed == 0.0))])
    if not summed(model.jointed.mesh.comm, untied)[0]:
        return closed_stiffness(body, contact)
    from dolfinx_joints.solvers.interface.springs import JointSprings

    springs = JointSprings(MatrixSystem(mass=model.mass, stiffness=body, contact=contact)).matrix
    tied = as_aij(body)
    tied.axpy(1.0, springs, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return tied


def _check_supports(model: Model) -> None:
    """Check that all supports can follow the ground."""
    if model.absorbing or any(isinstance(support, Spring) for support in model.supports):
        raise ValueError(
            "A DifferingMotion moves Fixed and Prescribed supports only; the model also has ground "
            "springs or viscous boundaries."
        )


def _check_members(model: Model, x: Floats, motion: DifferingMotion) -> None:
    """Raise an error if there are support nodes ``x`` outside the motion's groups (collective)."""
    outside = np.concatenate(model.jointed.mesh.comm.allgather(x))
    if len(outside):
        place = ", ".join(f"{value:g}" for value in outside[0, : model.gdim])
        raise MeshError(
            f"Motions are given for the groups {', '.join(motion.groups)}; {len(outside)} nodes "
            f"with supports are in no group, such as the node at ({place})."
        )
