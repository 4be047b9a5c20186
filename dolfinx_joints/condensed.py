# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A system condensed onto its joints for one set of coefficients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.compliance import Compliance
from dolfinx_joints.contact import Contact
from dolfinx_joints.corrections import Corrections
from dolfinx_joints.errors import JointsError
from dolfinx_joints.joint_springs import JointSprings
from dolfinx_joints.linear import Effective, EffectiveMatrix, free_dofs
from dolfinx_joints.solver import NewtonOptions
from dolfinx_joints.system import MatrixSystem

Floats = NDArray[np.float64]


class Condensed:
    """The bulk factored for one set of coefficients, with its compliance at the joints.

    Attributes:
        matrix: The bulk, with springs across the joints in statics of loose blocks.
        static: Whether there is no inertia.
        springs: These springs, or None.
        compliance: G, scaled.
        used: Whether a step has been solved with it.
        corrections: Solver of Newton's corrections.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: Effective,
        operator: PETSc.Mat,
        weight: float,
        options: NewtonOptions,
    ) -> None:
        """Factor, and find the compliance; ``weight`` is that of 1/k in the law (collective)."""
        assert system.contact is not None
        linear = options.linear
        self.static, self.used = not effective.mass, False
        self.springs: JointSprings | None = None
        self.matrix = EffectiveMatrix(system, effective, linear=linear)
        if self.static and not is_held(self.matrix, free_dofs(system)):
            self.matrix.destroy()
            self.springs = JointSprings(system)
            self.matrix = EffectiveMatrix(
                system, effective, linear=linear, added=self.springs.matrix
            )
        largest = None if self.springs is None else self.springs.largest_compliance
        self.compliance = Compliance(
            self.matrix,
            operator,
            system.contact.operator,
            kind=options.compliance,
            largest=largest,
        )
        stuck = None
        if self.springs is None and system.symmetric:
            stuck = self._stuck(system.contact, weight)
        self.corrections = Corrections(
            self.compliance.split, self.compliance.rough, stuck, operator.comm.tompi4py()
        )

    def _stuck(self, contact: Contact, weight: float) -> Floats:
        """T0 of sticking points of all ranks, shape (points, 3): c / (c + weight / k)."""
        own = np.repeat(self.compliance.own, (1, 2), axis=1)
        stiffness = np.repeat(contact.closed_stiffness(), (1, 2), axis=1)
        with np.errstate(divide="ignore"):
            total = own + weight / stiffness
        ratio = np.divide(own, total, out=np.zeros_like(own), where=total > 0.0)
        every = np.concatenate(contact.operator.comm.allgather(ratio))
        return np.where(self.compliance.dead, 0.0, every)

    def destroy(self) -> None:
        """Free matrices and factor."""
        self.compliance.destroy()


def is_held(matrix: EffectiveMatrix, free: PETSc.Vec) -> bool:
    """Whether a matrix of statics is regular: no block that nothing but joints supports."""
    load, moved = free.duplicate(), free.duplicate()
    load.setRandom()
    load.pointwiseMult(load, free)
    try:
        matrix.solver.solve(load, moved)
    except JointsError:
        return False
    rest = load.duplicate()
    matrix.held.mult(moved, rest)
    rest.axpy(-1.0, load)
    return bool(rest.norm() <= 1e-6 * load.norm())
