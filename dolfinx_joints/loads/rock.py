# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rock along the boundary of a model, as horizontal layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats, Ints, facet_slots

# Tolerance for equal heights, relative to the height of the layers.
LEVEL = 1e-9


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Horizontal layer of rock: bottom and top [m], lambda and mu [Pa], density [kg/m^3]."""

    bottom: float
    top: float
    first_lame: float
    shear_modulus: float
    density: float

    @property
    def pressure_speed(self) -> float:
        """Speed of P waves c_p [m/s]."""
        return float(np.sqrt((self.first_lame + 2.0 * self.shear_modulus) / self.density))

    @property
    def shear_speed(self) -> float:
        """Speed of S waves c_s [m/s]."""
        return float(np.sqrt(self.shear_modulus / self.density))

    def contains(self, height: Floats) -> Any:
        """Return True for heights [m] within the layer, including its bottom and top."""
        slack = LEVEL * max(abs(self.bottom), abs(self.top), self.top - self.bottom)
        return (height >= self.bottom - slack) & (height <= self.top + slack)


def cells_behind(model: LoadedBody, groups: Sequence[str]) -> tuple[Ints, Floats, Floats]:
    """Return the local cells behind the facets of groups, and their bottoms and tops [m]."""
    facets = np.concatenate([model.jointed.facets(group) for group in groups])
    cells, _ = facet_slots(model.jointed.mesh, facets)
    heights = model.V.tabulate_dof_coordinates()[:, model.gdim - 1][model.V.dofmap.list[cells]]
    return cells, heights.min(axis=1, initial=np.inf), heights.max(axis=1, initial=-np.inf)


def layers_along(
    name: str, model: LoadedBody, groups: Sequence[str], base: float, surface: float
) -> list[Layer]:
    """Return the rock layers behind groups, from the base up to the surface (collective).

    Raises:
        ValueError: The rock has no mass, or its materials do not form horizontal layers.
    """
    cells, low, high = cells_behind(model, groups)
    fields = (model.body.first_lame, model.body.shear_modulus, model.body.density)
    local_rows = np.column_stack([low, high, *(_values(field, cells) for field in fields)])
    all_rows = model.jointed.mesh.comm.allgather(np.unique(local_rows, axis=0))
    rows = np.unique(np.concatenate(all_rows), axis=0)
    if not rows[:, 4].all():
        raise ValueError(f"{name}: the rock along {', '.join(groups)} must have mass everywhere.")
    slack = LEVEL * max(np.abs(rows[:, :2]).max(), np.ptp(rows[:, :2]))
    layers: list[Layer] = []
    for bottom, top, lame, shear, density in rows.tolist():
        rock = Layer(bottom=bottom, top=top, first_lame=lame, shear_modulus=shear, density=density)
        below = layers[-1] if layers else None
        if below is not None and replace(rock, bottom=below.bottom, top=below.top) == below:
            layers[-1] = replace(below, top=max(below.top, top))
        elif below is not None and abs(bottom - below.top) > slack:
            ends = [f"{round(height, 6) + 0.0:g}" for height in (below.bottom, below.top, bottom)]
            raise ValueError(
                f"{name}: the rock along {', '.join(groups)} has materials of densities "
                f"{below.density:g} and {density:g} kg/m^3, the first from {ends[0]} to {ends[1]} "
                f"m, the second from {ends[2]} m up. They must form horizontal, adjacent layers."
            )
        else:
            layers.append(rock)
    layers[0] = replace(layers[0], bottom=base)
    layers[-1] = replace(layers[-1], top=surface)
    if layers[0].top <= base:
        raise ValueError(f"{name}: base is {base:g} m, above the lowest layer of the rock.")
    return layers


def _values(field: Any, cells: Ints) -> Floats:
    if not hasattr(field, "function_space"):
        return np.full(len(cells), float(field.value))
    return np.asarray(field.x.array[field.function_space.dofmap.list[cells, 0]])
