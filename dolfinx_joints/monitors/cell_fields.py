# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses and temperatures of the cells from displacements, for files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix
import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from dolfinx_joints.body.plastic_cells import PlasticResponse
from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellOrder
from dolfinx_joints.postprocessing.envelopes import principal_extremes

_FROM_PLASTIC = [0, 1, 2, 5, 3, 4]  # VTK's order from that of strains


class CellFields:
    """Stress, change of temperature and plastic strain of each cell."""

    def __init__(self, model: Model, cells: CellOrder) -> None:
        """Compile the expressions (collective)."""
        self._model, self._cells = model, cells
        self._all = np.arange(cells.owned, dtype=np.int32)
        loads = [(i, one) for i, one in enumerate(model.loads) if isinstance(one, Temperature)]
        self._change = [(i, one.factor, self._of_cells(one, "change")) for i, one in loads]
        self._u = fem.Function(model.V)
        self._stress = self._compiled(model.body.stress_vector(self._u))
        self._blocked = [self._of_cells(one, "blocked_stress") for _, one in loads]

    def _compiled(self, expression: Any) -> fem.Expression:
        mesh = self._model.jointed.mesh
        corners = basix.geometry(self._model.jointed.shape.type)
        return fem.Expression(expression, corners.mean(axis=0)[None], comm=mesh.comm)

    def _of_cells(self, load: Temperature, what: str) -> Floats:
        """Values of a temperature in its cells, zero in others, shape (owned,)."""
        jointed = self._model.jointed
        cells = self._all if load.cells is None else jointed.cells(load.cells)
        cells = cells[cells < self._cells.owned].astype(np.int32)
        values = np.zeros(self._cells.owned)
        compiled = self._compiled(getattr(load, what)(self._model))
        values[cells] = np.asarray(compiled.eval(jointed.mesh, cells)).reshape(len(cells))
        return values

    def __call__(
        self,
        u: PETSc.Vec,
        joints: Response | None,
        time: float,
        loads: Sequence[int] | None = None,
        absent: Sequence[str] = (),
    ) -> dict[str, Floats]:
        """Values by name with unit of the cells dealt to this rank (collective).

        Args:
            u: Displacement [m].
            joints: Response of the joints, and of the plastic cells with it.
            time: Time of the temperatures [s].
            loads: Places in ``Model.loads`` of those that act; all unless given.
            absent: Cell groups of blocks that are not there, which temperatures do not reach.
        """
        there = np.ones(self._cells.owned)
        for group in absent:
            gone = self._model.jointed.cells(group)
            there[gone[gone < len(there)]] = 0.0
        acts = [loads is None or i in loads for i, _, _ in self._change]
        factors = [f(time) * on for (_, f, _), on in zip(self._change, acts, strict=True)]
        stresses = self._stresses(u, joints, factors)
        found: dict[str, Floats] = {"stress [Pa]": self._cells.dealt(there[:, None] * stresses)}
        if self._change:
            changes = [f * each for f, (_, _, each) in zip(factors, self._change, strict=True)]
            found["temperature change [K]"] = self._cells.dealt(there * np.sum(changes, axis=0))
        if isinstance(joints, PlasticResponse) and self._model.bulk is not None:
            strains = np.zeros(self._cells.owned)
            cells, means = self._model.bulk.cell_means(joints.state.bulk.accumulated[:, None])
            strains[cells] = means[:, 0]
            found["accumulated plastic strain [-]"] = self._cells.dealt(strains)
        largest, smallest = principal_extremes(found["stress [Pa]"])
        found["largest principal stress [Pa]"] = largest
        found["smallest principal stress [Pa]"] = smallest
        return found

    def _stresses(self, u: PETSc.Vec, joints: Response | None, factors: Sequence[float]) -> Floats:
        """(xx, yy, zz, xy, yz, xz) in the owned cells: in the middle, the mean in plastic ones."""
        self._u.x.array[: u.getLocalSize()] = u.getArray(readonly=True)
        self._u.x.scatter_forward()
        values = self._stress.eval(self._model.jointed.mesh, self._all)
        stress = np.asarray(values).reshape(len(self._all), 6).copy()
        for factor, blocked in zip(factors, self._blocked, strict=True):
            stress[:, : self._model.body.strained_axes] -= factor * blocked[:, None]
        if isinstance(joints, PlasticResponse) and self._model.bulk is not None:
            bulk = self._model.bulk
            cells, means = bulk.cell_means(bulk.stress(joints.state))
            stress[cells] = means[:, _FROM_PLASTIC]
        return stress
