# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of natural modes: as input, a part of C, and as output, with mode coupling."""

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

# Coupling above which the report states that the damping is not classical.
COUPLED = 0.1


@dataclass(frozen=True, kw_only=True)
class ModalDamping:
    """Modal damping matrix phi_i . C phi_j with phi . M phi = 1.

    Attributes:
        frequencies: Frequencies of the undamped modes [Hz], shape (n,).
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
        """Coupling |C_ij| / sqrt(C_ii C_jj), shape (n, n), zero on the diagonal.

        It is zero for Rayleigh damping without joints, and at most 1 if C is positive semidefinite.
        """
        own = np.sqrt(np.abs(np.diag(self.matrix)))
        scale = np.outer(own, own)
        coupling = np.divide(
            np.abs(self.matrix), scale, out=np.zeros_like(scale), where=scale > 0.0
        )
        np.fill_diagonal(coupling, 0.0)
        return coupling

    def report(self) -> str:
        """Return one line per mode and the largest coupling of two modes."""
        lines = ["mode  frequency Hz  damping ratio %"]
        for i, (f, ratio) in enumerate(zip(self.frequencies, self.ratios, strict=True), start=1):
            lines.append(f"{i:4d}  {f:12.4g}  {100.0 * ratio:15.4g}")
        coupling = self.coupling
        largest = float(coupling.max())
        # Report the first of equal couplings: the largest by rounding depends on the ranks.
        first = int(np.argmax(coupling >= (1.0 - 1e-6) * largest))
        i, j = sorted(divmod(first, len(coupling)))
        if largest > 0.0:
            pair = f"between modes {i + 1} and {j + 1}"
            lines.append(f"largest coupling by damping: {largest:.2g}, {pair}")
        if largest > COUPLED:
            lines.append("the damping is not classical: the modal damping ratios are approximate")
        return "\n".join(lines)


def modal_damping(system: MatrixSystem, modes: Modes) -> ModalDamping:
    """Return the modal damping due to all of C: Rayleigh, boundaries, forms (collective)."""
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
    """Part Psi diag(c) Psi^T of C that gives the modes their ratios, computed on first use.

    Psi = M Phi, zero in the rows of constrained dofs and of water unknowns.
    """

    def __init__(self, ratios: ModalRatios) -> None:
        self.ratios = ratios
        self._body: MatrixSystem | None = None

    def with_damping(self, body: MatrixSystem) -> MatrixSystem:
        """Return a body's system with this damping; modes are computed for the first system."""
        if self._body is None:
            none: dict[str, Any] = {"patterns": (), "load_names": (), "in_joints": ()}
            self._body = replace(body, values=None, water=None, shared=None, **none)
        return replace(body, damped_modes=self)

    @cached_property
    def _modes_and_rates(self) -> tuple[Floats, Floats]:
        """Psi, shape (local dofs of the body, modes), and c, shape (modes,), [1/s] (collective)."""
        assert self._body is not None
        system, count = self._body, self.ratios.modes
        modes = whole_groups(system, count)
        if len(modes.shapes) < count:
            raise ValueError(
                f"ModalRatios: modes is {count}, which splits modes of equal frequency or exceeds "
                f"their number; the next smaller groups end at {len(modes.shapes)} modes."
            )
        work, by_other_damping = system.mass.createVecRight(), np.zeros(count)
        for i, shape in enumerate(modes.shapes):
            by_other_damping[i] = system.damping_force(shape, work).dot(shape)
            if system.absorption is not None:
                system.absorption.mult(shape, work)
                by_other_damping[i] -= work.dot(shape)
        doubled = 4.0 * np.pi * modes.frequencies
        rates = doubled * np.asarray(self.ratios.ratio) - by_other_damping
        wrong = np.flatnonzero(rates < -1e-12 * by_other_damping)
        if len(wrong):
            i = wrong[0]
            ratio = np.broadcast_to(self.ratios.ratio, count)[i]
            raise ValueError(
                f"ModalRatios: ratio of mode {i + 1} is {ratio:.4g}, but the other damping already "
                f"gives {by_other_damping[i] / doubled[i]:.4g}; use at least this ratio."
            )
        columns = np.column_stack([(system.mass * shape).array_r for shape in modes.shapes])
        columns[system.constrained] = 0.0
        return columns, np.maximum(rates, 0.0)

    @property
    def rates(self) -> Floats:
        """Diagonal c, shape (modes,), [1/s] (collective)."""
        return self._modes_and_rates[1]

    def columns(self, like: PETSc.Vec) -> Floats:
        """Return the owned rows of Psi, padded to the size of ``like``, (n, modes) (collective)."""
        columns, _ = self._modes_and_rates
        return np.pad(columns, ((0, like.getLocalSize() - len(columns)), (0, 0)))

    def add_force(self, velocity: PETSc.Vec, out: PETSc.Vec) -> None:
        """Add Psi diag(c) Psi^T v [N] (collective)."""
        columns, rates = self._modes_and_rates
        local_amounts = columns.T @ velocity.array_r[: len(columns)]
        amounts = np.sum(velocity.comm.tompi4py().allgather(local_amounts), axis=0)
        out.getArray()[: len(columns)] += columns @ (rates * amounts)
