# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rock along the boundary of a model: its materials, in level layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats, Ints, facet_slots

# Of the height of the layers: what heights at the same level may differ by.
LEVEL = 1e-9


@dataclass(frozen=True, kw_only=True)
class Layer:
    """A level layer of rock: its ends [m], lambda and mu [Pa], and density [kg/m^3]."""

    bottom: float
    top: float
    first_lame: float
    shear_modulus: float
    density: float

    @property
    def pressure_speed(self) -> float:
        """c_p [m/s]."""
        return float(np.sqrt((self.first_lame + 2.0 * self.shear_modulus) / self.density))

    @property
    def shear_speed(self) -> float:
        """c_s [m/s]."""
        return float(np.sqrt(self.shear_modulus / self.density))

    def holds(self, height: Floats) -> Any:
        """Whether heights [m] are in the layer, its bounds included."""
        slack = LEVEL * max(abs(self.bottom), abs(self.top), self.top - self.bottom)
        return (height >= self.bottom - slack) & (height <= self.top + slack)


def behind(model: LoadedBody, groups: Sequence[str]) -> tuple[Ints, Floats, Floats]:
    """Cells behind the facets of groups, local numbers, and their lowest and highest node [m]."""
    facets = np.concatenate([model.jointed.facets(group) for group in groups])
    cells, _ = facet_slots(model.jointed.mesh, facets)
    heights = model.V.tabulate_dof_coordinates()[:, model.gdim - 1][model.V.dofmap.list[cells]]
    return cells, heights.min(axis=1, initial=np.inf), heights.max(axis=1, initial=-np.inf)


def layers_along(
    name: str, model: LoadedBody, groups: Sequence[str], base: float, surface: float
) -> list[Layer]:
    """Layers of the rock behind groups from the base up to the level surface (collective).

    Raises:
        ValueError: The rock has no mass, or its materials are not level layers.
    """
    cells, low, high = behind(model, groups)
    fields = (model.body.first_lame, model.body.shear_modulus, model.body.density)
    mine = np.column_stack([low, high, *(_values(field, cells) for field in fields)])
    every = model.jointed.mesh.comm.allgather(np.unique(mine, axis=0))
    rows = np.unique(np.concatenate(every), axis=0)
    if not rows[:, 4].all():
        raise ValueError(f"{name}: the rock along {', '.join(groups)} must have mass everywhere.")
    slack = LEVEL * max(np.abs(rows[:, :2]).max(), np.ptp(rows[:, :2]))
    layers: list[Layer] = []
    for bottom, top, lame, shear, density in rows.tolist():
        rock = Layer(bottom=bottom, top=top, first_lame=lame, shear_modulus=shear, density=density)
        last = layers[-1] if layers else None
        if last is not None and replace(rock, bottom=last.bottom, top=last.top) == last:
            layers[-1] = replace(last, top=max(last.top, top))
        elif last is not None and abs(bottom - last.top) > slack:
            ends = [f"{round(height, 6) + 0.0:g}" for height in (last.bottom, last.top, bottom)]
            raise ValueError(
                f"{name}: the rock along {', '.join(groups)} has materials of densities "
                f"{last.density:g} and {density:g} kg/m^3, the one from {ends[0]} to {ends[1]} m, "
                f"the other from {ends[2]} m on; they must be level layers, one on the other."
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
