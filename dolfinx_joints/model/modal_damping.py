# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of the natural modes: given, as a part of C, and found, with their coupling."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.damping import ModalRatios
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.model.modes import Modes, whole_groups
from dolfinx_joints.model.system import MatrixSystem, check_system

# Of a mode's own damping, above which the report calls modes coupled.
COUPLED = 0.1


@dataclass(frozen=True, kw_only=True)
class ModalDamping:
    """C in the modes: phi_i . C phi_j with phi . M phi = 1.

    Attributes:
        frequencies: Of the undamped modes [Hz], shape (n,).
        matrix: phi_i . C phi_j, shape (n, n), [1/s].
    """

    frequencies: Floats
    matrix: Floats

    @property
    def ratios(self) -> Floats:
        """Damping ratios phi . C phi / (2 omega), shape (n,); infinite where omega is zero."""
        omega = 2.0 * np.pi * self.frequencies
        own = np.diag(self.matrix)
        ratios: Floats = np.divide(own, 2.0 * omega, out=np.full_like(own, np.inf), where=omega > 0)
        return ratios

    @property
    def coupling(self) -> Floats:
        """|C_ij| / sqrt(C_ii C_jj), shape (n, n), zero on the diagonal.

        Zero for Rayleigh damping without joints, at most 1 for any C that only takes energy.
        """
        own = np.sqrt(np.abs(np.diag(self.matrix)))
        scale = np.outer(own, own)
        coupling = np.divide(
            np.abs(self.matrix), scale, out=np.zeros_like(scale), where=scale > 0.0
        )
        np.fill_diagonal(coupling, 0.0)
        return coupling

    def report(self) -> str:
        """A line for each mode, and the largest coupling of two."""
        lines = ["mode  frequency Hz  damping ratio %"]
        for i, (f, ratio) in enumerate(zip(self.frequencies, self.ratios, strict=True), start=1):
            lines.append(f"{i:4d}  {f:12.4g}  {100.0 * ratio:15.4g}")
        coupling = self.coupling
        largest = float(coupling.max())
        # The first of equal ones: which of them rounding makes the largest depends on the ranks.
        first = int(np.argmax(coupling >= (1.0 - 1e-6) * largest))
        i, j = sorted(divmod(first, len(coupling)))
        if largest > 0.0:
            where = f"between modes {i + 1} and {j + 1}"
            lines.append(f"largest coupling by damping: {largest:.2g}, {where}")
        if largest > COUPLED:
            lines.append("the damping is not classical: ratios of single modes are approximate")
        return "\n".join(lines)


def modal_damping(system: MatrixSystem, modes: Modes) -> ModalDamping:
    """Damping of the `modes` of a system by all of C: Rayleigh, boundaries, forms (collective)."""
    check_system(system)
    count = len(modes.shapes)
    matrix = np.empty((count, count))
    force = system.mass.createVecRight()
    for j, shape in enumerate(modes.shapes):
        system.damping_force(shape, force)
        for i, other in enumerate(modes.shapes):
            matrix[i, j] = force.dot(other)
    return ModalDamping(frequencies=modes.frequencies, matrix=matrix)


class DampedModes:
    """The part Psi diag(c) Psi^T of C that gives modes their ratios, found when first asked for.

    Psi = M Phi without rows of constrained dofs, and zero at unknowns of water.
    """

    def __init__(self, asked: ModalRatios) -> None:
        """Keep the ratios."""
        self.asked = asked
        self._body: MatrixSystem | None = None

    def given_to(self, body: MatrixSystem) -> MatrixSystem:
        """The system of a body with this damping; further ones have the modes of the first."""
        if self._body is None:
            none: dict[str, Any] = {"patterns": (), "load_names": (), "in_joints": ()}
            self._body = replace(body, values=None, water=None, shared=None, **none)
        return replace(body, damped_modes=self)

    @cached_property
    def _found(self) -> tuple[Floats, Floats]:
        """Psi, shape (local dofs of the body, modes), and c, shape (modes,), [1/s] (collective)."""
        assert self._body is not None
        system, count = self._body, self.asked.modes
        modes = whole_groups(system, count)
        if len(modes.shapes) < count:
            raise ValueError(
                f"ModalRatios: modes is {count}, which ends within modes of one frequency or past "
                f"the last mode; {len(modes.shapes)} are the most up to there."
            )
        work, by_rest = system.mass.createVecRight(), np.zeros(count)
        for i, shape in enumerate(modes.shapes):
            by_rest[i] = system.damping_force(shape, work).dot(shape)
            if system.absorption is not None:
                system.absorption.mult(shape, work)
                by_rest[i] -= work.dot(shape)
        doubled = 4.0 * np.pi * modes.frequencies
        rates = doubled * np.asarray(self.asked.ratio) - by_rest
        wrong = np.flatnonzero(rates < -1e-12 * by_rest)
        if len(wrong):
            i = wrong[0]
            asked = np.broadcast_to(self.asked.ratio, count)[i]
            raise ValueError(
                f"ModalRatios: ratio of mode {i + 1} is {asked:.4g}; the rest of the damping gives "
                f"it {by_rest[i] / doubled[i]:.4g} already."
            )
        columns = np.column_stack([(system.mass * shape).array_r for shape in modes.shapes])
        columns[system.constrained] = 0.0
        return columns, np.maximum(rates, 0.0)

    @property
    def rates(self) -> Floats:
        """Diagonal c, shape (modes,), [1/s] (collective)."""
        return self._found[1]

    def columns(self, like: PETSc.Vec) -> Floats:
        """Owned rows of Psi among all unknowns of a vector, shape (local, modes) (collective)."""
        columns, _ = self._found
        return np.pad(columns, ((0, like.getLocalSize() - len(columns)), (0, 0)))

    def add_force(self, velocity: PETSc.Vec, out: PETSc.Vec) -> None:
        """Add Psi diag(c) Psi^T v [N] (collective)."""
        columns, rates = self._found
        mine = columns.T @ velocity.array_r[: len(columns)]
        amounts = np.sum(velocity.comm.tompi4py().allgather(mine), axis=0)
        out.getArray()[: len(columns)] += columns @ (rates * amounts)
