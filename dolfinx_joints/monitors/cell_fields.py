# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cell stresses and temperatures from displacements, for files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix
import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from dolfinx_joints.body.nonlinear_cells import BodyResponse
from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.temperature.thermal_strain import Temperature
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.body_cells import CellOrder
from dolfinx_joints.postprocessing.envelopes import principal_extremes

_FROM_LAWS = [0, 1, 2, 5, 3, 4]  # Indices that sort the components of laws as in VTK.


class CellFields:
    """Stress, temperature change and internal variables of each cell."""

    def __init__(self, model: Model, cells: CellOrder) -> None:
        """Compile the expressions (collective)."""
        self._model, self._cells = model, cells
        self._all = np.arange(cells.owned, dtype=np.int32)
        loads = [(i, load) for i, load in enumerate(model.loads) if isinstance(load, Temperature)]
        self._change = [(i, load.factor, self._evaluate(load, "change")) for i, load in loads]
        self._u = fem.Function(model.V)
        self._stress = self._compiled(model.body.stress_vector(self._u))
        self._thermal = [self._evaluate(load, "blocked_stress") for _, load in loads]

    def _compiled(self, expression: Any) -> fem.Expression:
        mesh = self._model.jointed.mesh
        corners = basix.geometry(self._model.jointed.shape.type)
        return fem.Expression(expression, corners.mean(axis=0)[None], comm=mesh.comm)

    def _evaluate(self, load: Temperature, quantity: str) -> Floats:
        """Return a quantity of a temperature load, zero in unheated cells, shape (owned,)."""
        jointed = self._model.jointed
        cells = self._all if load.cells is None else jointed.cells(load.cells)
        cells = cells[cells < self._cells.owned].astype(np.int32)
        values = np.zeros(self._cells.owned)
        compiled = self._compiled(getattr(load, quantity)(self._model))
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
        """Return values of this rank's cells, by name with unit (collective).

        Args:
            u: Displacement [m].
            joints: Response of the joints and of nonlinear cells.
            time: Time at which temperatures are evaluated [s].
            loads: Indices in ``Model.loads`` of the acting loads; all by default.
            absent: Cell groups of absent blocks, in which stresses and temperatures are zero.
        """
        present = np.ones(self._cells.owned)
        for group in absent:
            removed = self._model.jointed.cells(group)
            present[removed[removed < len(present)]] = 0.0
        acts = [loads is None or i in loads for i, _, _ in self._change]
        factors = [f(time) * on for (_, f, _), on in zip(self._change, acts, strict=True)]
        stresses = self._stresses(u, joints, factors)
        values: dict[str, Floats] = {"stress [Pa]": self._cells.dealt(present[:, None] * stresses)}
        if self._change:
            changes = [f * part for f, (_, _, part) in zip(factors, self._change, strict=True)]
            values["temperature change [K]"] = self._cells.dealt(present * np.sum(changes, axis=0))
        largest, smallest = principal_extremes(values["stress [Pa]"])
        values["largest principal stress [Pa]"] = largest
        values["smallest principal stress [Pa]"] = smallest
        if isinstance(joints, BodyResponse) and self._model.bulk is not None:
            for name in self._model.bulk.variables:
                if name in values:
                    raise ValueError(
                        f"The internal variable {name!r} has the name of another field; rename it."
                    )
                means = self._model.bulk.variable(name, joints.state).x.array
                values[name] = self._cells.dealt(means[: self._cells.owned])
        return values

    def _stresses(self, u: PETSc.Vec, joints: Response | None, factors: Sequence[float]) -> Floats:
        """Return stresses (xx, yy, zz, xy, yz, xz) at cell centres; means in nonlinear cells."""
        self._u.x.array[: u.getLocalSize()] = u.getArray(readonly=True)
        self._u.x.scatter_forward()
        values = self._stress.eval(self._model.jointed.mesh, self._all)
        stress = np.asarray(values).reshape(len(self._all), 6).copy()
        for factor, thermal in zip(factors, self._thermal, strict=True):
            stress[:, : self._model.body.strained_axes] -= factor * thermal[:, None]
        if isinstance(joints, BodyResponse) and self._model.bulk is not None:
            cells, means = self._model.bulk.cell_means(joints.state.bulk.stress)
            stress[cells] = means[:, _FROM_LAWS]
        return stress
