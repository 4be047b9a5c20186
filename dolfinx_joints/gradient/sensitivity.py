# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensitivity of a quantity: its change per one per cent of each parameter, as table and map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.declared import declarations
from dolfinx_joints.common.mpi import raised_together, summed
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.common.summary import Rows, Summarised
from dolfinx_joints.gradient.law_slopes import parameters_of
from dolfinx_joints.gradient.reverse_sweep import Gradient

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("parameter", "joint", "value", "unit", "derivative", "per_cent")


@dataclass(frozen=True, kw_only=True, repr=False)
class Sensitivity(Summarised):
    """Changes of a quantity per one per cent of its parameters.

    Attributes:
        gradient: Gradient of the quantity.
        unit: Unit of the quantity.
        table: Rows, the largest change first: ``parameter``, ``joint`` (empty for loads and for
            parameters of a model), ``value`` (a mean for gaps, 1 for loads), its ``unit``,
            ``derivative``, and ``per_cent``, which is derivative times value / 100. A value of zero
            has no per cent: None.
    """

    gradient: Gradient
    unit: str
    table: Sequence[Mapping[str, Any]]

    def _summary(self) -> Rows:
        yield "quantity", f"{self.gradient.value:.6g} {self.unit}"
        for name, joint, value, unit, slope, change in (row.values() for row in self.table):
            given = f"is zero and has no per cent; the derivative is {slope:.4g}"
            if change is not None:
                given = f"{change:+.4g} {self.unit} per 1 % of {value:.5g} {unit}".rstrip()
            yield f"{name} {joint}".rstrip(), given

    def map(self, parameter: str) -> Figure | None:
        """Draw the changes per one per cent at the points of the joints, on rank 0 (collective).

        Changes are divided by the areas of the points, so that they do not depend on the mesh.
        Points are in the plane of their joint: s1 to the right, s2 up.
        """
        rows = [row for row in self.table if row["joint"] and row["per_cent"] is not None]
        values = {row["joint"]: row["value"] for row in rows if row["parameter"] == parameter}
        if not values:
            names_given = ", ".join(sorted({row["parameter"] for row in rows}))
            wrong = f"{shown(parameter)} is not a joint parameter with a value other than zero"
            raise ValueError(f"{wrong}; these parameters are {names_given}.")
        contact = self.gradient.tape.contact
        operator: Any = contact.operator
        of_points = np.array([values.get(joint, 0.0) for joint in operator.names])[operator.joint]
        if parameter == "initial_gap":
            of_points = contact.initial_gap[:, 0]
        changes = 0.01 * of_points * self.gradient.by_point[parameter] / operator.areas
        columns = (operator.joint, operator.areas, changes, operator.points, operator.frames)
        number, *gathered = map(operator.gather, columns)
        figure, title = None, f"change per 1 % of {parameter} and per area"
        with raised_together(operator.comm):
            if operator.comm.rank == 0:
                from dolfinx_joints.postprocessing.joints.figures import signed_point_maps

                chosen = {n: number == i for i, n in enumerate(operator.names) if n in values}
                parts = {n: [array[of] for array in gathered] for n, of in chosen.items()}
                figure = signed_point_maps(parts, title, f"{self.unit or '1'}/m\u00b2")
        return figure


def sensitivity(gradient: Gradient, *, unit: str = "") -> Sensitivity:
    """Return the changes of a quantity per one per cent of each parameter (collective).

    Args:
        gradient: Gradient of the quantity, by the parameters of whole joints, their initial gaps,
            factors of loads, and the parameters of a model.
        unit: Unit of the quantity.
    """
    check_kind_of("gradient", gradient, isinstance(gradient, Gradient), "a Gradient")
    check_kind_of("unit", unit, isinstance(unit, str), "a text")
    tape, parametric, rows = gradient.tape, gradient.parametric, []
    for joint, law in tape.contact.laws.items():
        units = {row.name: row.unit for row in declarations(type(law))}
        slopes = {name: gradient.by_joint[name][joint] for name in parameters_of(law)}
        rows += [(n, joint, getattr(law, n), units[n], slope) for n, slope in slopes.items()]
    rows += [(name, "", 1.0, "", slope) for name, slope in gradient.by_load.items()]
    if parametric is not None and tape.model is not None:
        units = {name: parameter.unit for name, parameter in parametric.parameters.items()}
        given, by_name = parametric.values_of(tape.model), gradient.by_parameter
        rows += [(name, "", value, units[name], by_name[name]) for name, value in given.items()]
    table = [(*row, 0.01 * row[2] * row[4] if row[2] else None) for row in rows]
    operator, gap = tape.contact.operator, tape.contact.initial_gap[:, 0]
    terms = (operator.areas, operator.areas * gap, abs(gap), gap * gradient.by_point["initial_gap"])
    sums = [np.bincount(operator.joint, term, len(operator.names)) for term in terms]
    by_joint: Any = summed(operator.comm, np.array(sums)).T.tolist()
    for joint, (area, moment, size, change) in zip(operator.names, by_joint, strict=True):
        slope, of_gap = gradient.by_joint["initial_gap"][joint], 0.01 * change if size else None
        table.append(("initial_gap", joint, moment / area, "m", slope, of_gap))
    table.sort(key=lambda row: -1.0 if row[-1] is None else abs(row[-1]), reverse=True)
    dicts = [dict(zip(COLUMNS, row, strict=True)) for row in table]
    return Sensitivity(gradient=gradient, unit=unit, table=dicts)
