# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of the natural modes, and how far dashpots couple the modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.model.modes import Modes
from dolfinx_joints.model.system import MatrixSystem, check_system

Floats = NDArray[np.float64]

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
    """Damping of the modes by all of C: Rayleigh, viscous boundaries, forms (collective).

    Args:
        system: The system.
        modes: Its modes, from `modes`.
    """
    check_system(system)
    count = len(modes.shapes)
    matrix = np.empty((count, count))
    force = system.mass.createVecRight()
    for j, shape in enumerate(modes.shapes):
        system.damping_force(shape, force)
        for i, other in enumerate(modes.shapes):
            matrix[i, j] = force.dot(other)
    return ModalDamping(frequencies=modes.frequencies, matrix=matrix)
