# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of a plane wave on viscous boundaries, as patterns at levels of equal phase.

The rock along the boundary of a model is given as horizontal layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from dolfinx_joints.body.viscous_boundary import impedance
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.loads.load import LoadedBody, TimeFactor
from dolfinx_joints.mesh.cells import Floats, Ints, facet_slots
from dolfinx_joints.mesh.orientation import facet_normals

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


# Levels per period of the highest frequency; the error of cubic interpolation is then 2e-4.
LEVELS = 20.0

# Patterns smaller than this, relative to the largest one, are rounding error.
ROUNDING = 1e-13

# Ratio of the horizontal to the vertical part of a normal, above which a facet counts as a side.
STEEP = 0.5

Patterns = list[tuple[PETSc.Vec, TimeFactor]]


def forces_of_levels(
    model: LoadedBody,
    groups: Sequence[str],
    motion: Floats,
    slowness: Floats,
    spacing: float,
    *,
    start: float = 0.0,
    layer: Layer | None = None,
) -> list[tuple[float, PETSc.Vec]]:
    """Return the delay of each level [s] and the forces per velocity, (12j) (collective).

    Velocities are interpolated by cubics between levels at a distance of ``spacing`` [s], and by
    the shape functions on facets. The wave has the motion d and the slowness s [s/m]. The delay is
    zero where the phase s.x equals ``start`` [s]. If a layer is given, only its facets are loaded.
    """
    degree = model.V.element.basix_element.degree
    scalar = fem.functionspace(model.jointed.mesh, ("Lagrange", degree))
    w, v = ufl.TrialFunction(scalar), ufl.TestFunction(model.V)
    traction = _traction(model, motion, slowness)
    if layer is not None:
        traction = _within(model, groups, layer) * traction
    form = sum(ufl.inner(traction * w, v) * model.jointed.ds(group) for group in groups)
    matrix = fem_petsc.assemble_matrix(fem.form(form))
    matrix.assemble()
    share, result = matrix.createVecRight(), matrix.createVecLeft()
    x = scalar.tabulate_dof_coordinates()[: share.getLocalSize(), : model.gdim]
    place = (x @ slowness - start) / spacing
    first, last = ((end - start) / spacing for end in extent_along(model, groups, slowness, layer))
    forces = []
    for level in range(int(np.floor(first)) - 1, int(np.floor(last)) + 3):
        share.setArray(cubic(place - level))
        matrix.mult(share, result)
        force = model.mass.createVecRight()
        force.setArray(result.getArray(readonly=True).copy())
        forces.append((level * spacing, force))
    for petsc in (matrix, share, result):
        petsc.destroy()
    return forces


def without_rounding(patterns: Patterns) -> Patterns:
    """Drop patterns that are zero apart from rounding error (collective)."""
    largest = max((force.norm() for force, _ in patterns), default=0.0)
    return [(f, factor) for f, factor in patterns if f.norm() > ROUNDING * largest]


def extent_along(
    model: LoadedBody, groups: Sequence[str], axis: Floats, layer: Layer | None = None
) -> tuple[float, float]:
    """Return the range of x.axis at the nodes of groups, or only in one layer (collective)."""
    x = model.V.tabulate_dof_coordinates()[:, : model.gdim]
    nodes = np.concatenate([model.nodes(group) for group in groups])
    if layer is not None:
        nodes = nodes[layer.contains(x[nodes, -1])]
    along = x[nodes] @ axis
    ends = model.jointed.mesh.comm.allgather(
        (float(along.min(initial=np.inf)), float(along.max(initial=-np.inf)))
    )
    return min(low for low, _ in ends), max(high for _, high in ends)


def warn_of_sides(model: LoadedBody) -> list[str]:
    """Warn of dashpots at the sides of the rock under a uniform ground motion (collective).

    Returns:
        The warnings, on rank 0 only.
    """
    steep = []
    for group in model.absorbing:
        normals = np.abs(facet_normals(model.jointed.corners(group)[:, :3]))
        sides = np.linalg.norm(normals[:, :-1], axis=1) > STEEP * normals[:, -1]
        if any(model.jointed.mesh.comm.allgather(bool(sides.any()))):
            steep.append(group)
    if not steep or model.jointed.mesh.comm.rank > 0:
        return []
    text = (
        "The ground motion is uniform, so the dashpots at the sides of the rock "
        f"({', '.join(steep)}) disturb the rising wave. Pass the wave to dynamics() as a "
        "FreeField, or use a ViscousBoundary at the bottom only and constrain the components "
        "perpendicular to the motion at the sides."
    )
    warn(text, PlausibilityWarning)
    return [text]


def check_groups(name: str, groups: Sequence[str]) -> None:
    """Check that groups are names without duplicates."""
    if len(set(groups)) < len(groups) or not all(isinstance(group, str) for group in groups):
        raise ValueError(
            f"{name}: groups is {shown(groups)}; it must name facet groups, without duplicates."
        )


def checked_base(
    name: str, model: LoadedBody, groups: Sequence[str], surface: float, base: float | None
) -> float:
    """Check the heights and return the base, by default the lowest node (collective)."""
    missing = [group for group in groups if group not in model.absorbing]
    if missing:
        raise ValueError(
            f"{name}: the group {missing[0]!r} has no viscous boundary; add "
            f"ViscousBoundary(group={missing[0]!r}) to the supports."
        )
    lowest, highest = extent_along(model, groups, np.eye(model.gdim)[-1])
    base = lowest if base is None else base
    if highest - surface > 1e-9 * (highest - base) or surface <= base:
        lowest, highest, base = (round(z, 6) + 0.0 for z in (lowest, highest, base))
        raise ValueError(
            f"{name}: surface is {surface:g} m; the groups {', '.join(groups)} extend from "
            f"{lowest:g} to {highest:g} m. It must be at or above their top and above the base, "
            f"{base:g} m."
        )
    return base


def cubic(offset: Floats) -> Floats:
    """Return the weight of a sample at ``offset`` spacings in four-point Lagrange interpolation."""
    x = np.abs(offset)
    inner = (1.0 - x) * (1.0 + x) * (2.0 - x) / 2.0
    outer = (1.0 - x) * (2.0 - x) * (3.0 - x) / 6.0
    return np.where(x < 1.0, inner, np.where(x < 2.0, outer, 0.0))


def _traction(model: LoadedBody, motion: Floats, slowness: Floats) -> Any:
    """Return Z d + sigma n of a wave of unit velocity along d, equation (12aa), [Pa s/m]."""
    body, n = model.body, ufl.FacetNormal(model.jointed.mesh)
    d, s = (fem.Constant(model.jointed.mesh, np.asarray(vector)) for vector in (motion, slowness))
    pressure = body.first_lame * ufl.inner(d, s) * n
    shear = body.shear_modulus * (ufl.inner(s, n) * d + ufl.inner(d, n) * s)
    return impedance(model.jointed, body, d) - pressure - shear


def _within(model: LoadedBody, groups: Sequence[str], layer: Layer) -> fem.Function:
    """Return 1 in the cells behind the groups that lie in a layer, 0 elsewhere."""
    inside = fem.Function(fem.functionspace(model.jointed.mesh, ("DG", 0)))
    cells, low, high = cells_behind(model, groups)
    cells = cells[layer.contains(low) & layer.contains(high)]
    inside.x.array[inside.function_space.dofmap.list[cells, 0]] = 1.0
    return inside
