# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What runs of one model have in common: factors, compliances at the joints, modes."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any

from dolfinx_joints.solvers.rounds import Rounds

if TYPE_CHECKING:
    from dolfinx_joints.body.halves import Halves
    from dolfinx_joints.solvers.compliance.compliance import Compliance
    from dolfinx_joints.solvers.effective_matrix import EffectiveMatrix


class SharedBulk:
    """Keeps what the first of several runs has made for the others.

    A `MatrixSystem` that has one as ``shared`` takes its factors from there, and solves with them
    in blocks of all runs that wait for a solution. All runs must be of one model.

    Attributes:
        rounds: Runs them side by side.
        lowest_modes: Modes by number, see `MatrixSystem.lowest_modes`.
    """

    def __init__(self) -> None:
        """Nothing is there yet."""
        self.rounds = Rounds()
        self.lowest_modes: dict[int, Any] = {}
        self._matrices: dict[Hashable, EffectiveMatrix] = {}
        self._compliances: dict[Hashable, Compliance] = {}
        self._halves: list[Halves | None] = []

    def matrix(self, key: Hashable, make: Callable[[], EffectiveMatrix]) -> EffectiveMatrix:
        """The matrix of a key, made if need be (collective)."""
        if key not in self._matrices:
            self._matrices[key] = make()
        return self._matrices[key]

    def compliance(self, key: Hashable, make: Callable[[], Compliance]) -> Compliance:
        """The compliance of a key, made if need be (collective)."""
        if key not in self._compliances:
            self._compliances[key] = make()
        return self._compliances[key]

    def halves(self, make: Callable[[], Halves | None]) -> Halves | None:
        """The halves of M and K, made if need be (collective)."""
        if not self._halves:
            self._halves.append(make())
        return self._halves[0]

    def destroy(self) -> None:
        """Free all of it."""
        for compliance in self._compliances.values():
            compliance.destroy()
        for matrix in self._matrices.values():
            matrix.rounds = None
            matrix.destroy()
        self._matrices.clear()
        self._compliances.clear()
