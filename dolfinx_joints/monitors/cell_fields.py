# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses and temperatures of the cells from displacements, for files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellGather

Floats = NDArray[np.floating[Any]]

_COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # VTK's order


class CellFields:
    """Stress and change of temperature in the middle of each cell.

    Args:
        model: The model.
        gather: Gathers values of its cells.
    """

    def __init__(self, model: Model, gather: CellGather) -> None:
        """Compile the expressions (collective)."""
        self._model, self._gather = model, gather
        self._all = np.arange(gather.owned, dtype=np.int32)
        loads = [(i, one) for i, one in enumerate(model.loads) if isinstance(one, Temperature)]
        self._change = [(i, one.factor, self._of_cells(one, "change")) for i, one in loads]
        self._stress = None
        if model.gdim == 3 and model.bulk is None:
            self._u = fem.Function(model.V)
            stress = model.body.stress(self._u)
            self._stress = self._compiled(ufl.as_vector([stress[i, j] for i, j in _COMPONENTS]))
            self._blocked = [self._of_cells(one, "blocked_stress") for _, one in loads]

    def _compiled(self, expression: Any) -> fem.Expression:
        mesh = self._model.jointed.mesh
        corners = basix.geometry(self._model.jointed.shape.type)
        return fem.Expression(expression, corners.mean(axis=0)[None], comm=mesh.comm)

    def _of_cells(self, load: Temperature, what: str) -> Floats:
        """Values of a temperature in its cells, zero in others, shape (owned,)."""
        jointed = self._model.jointed
        cells = self._all if load.cells is None else jointed.cells(load.cells)
        cells = cells[cells < self._gather.owned].astype(np.int32)
        values = np.zeros(self._gather.owned)
        compiled = self._compiled(getattr(load, what)(self._model))
        values[cells] = np.asarray(compiled.eval(jointed.mesh, cells)).reshape(len(cells))
        return values

    def __call__(self, u: PETSc.Vec, time: float, loads: Sequence[int] | None) -> dict[str, Any]:
        """Values by name with unit on rank 0, nothing elsewhere (collective).

        Args:
            u: Displacement [m].
            time: Time of the temperatures [s].
            loads: Places in ``Model.loads`` of those that act; all unless None.
        """
        found: dict[str, Any] = {}
        acts = [loads is None or i in loads for i, _, _ in self._change]
        factors = [f(time) * on for (_, f, _), on in zip(self._change, acts, strict=True)]
        if self._stress is not None:
            self._u.x.array[: u.getLocalSize()] = u.getArray(readonly=True)
            self._u.x.scatter_forward()
            values = self._stress.eval(self._model.jointed.mesh, self._all)
            stress = np.asarray(values).reshape(len(self._all), 6).copy()
            for factor, blocked in zip(factors, self._blocked, strict=True):
                stress[:, :3] -= factor * blocked[:, None]
            found["stress [Pa]"] = self._gather(stress)
        if self._change:
            changes = (f * each for f, (_, _, each) in zip(factors, self._change, strict=True))
            found["temperature change [K]"] = self._gather(np.sum(list(changes), axis=0))
        found = {name: values for name, values in found.items() if values is not None}
        return found | (principal(found["stress [Pa]"]) if "stress [Pa]" in found else {})


def principal(stress: Floats) -> dict[str, Floats]:
    """Largest and smallest principal stress of (xx, yy, zz, xy, yz, xz), shape (n, 6)."""
    tensor = stress[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)
    values = np.linalg.eigvalsh(tensor)
    return {
        "largest principal stress [Pa]": values[:, 2],
        "smallest principal stress [Pa]": values[:, 0],
    }
