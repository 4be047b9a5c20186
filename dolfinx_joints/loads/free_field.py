# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Actions of the ground beyond the model: waves that rise in it, forces of former supports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.supports import components_of
from dolfinx_joints.body.viscous_boundary import impedance
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.loads.ground_motion import in_axes
from dolfinx_joints.loads.load import TimeFactor, always
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.motions.motion import Motion

# Levels per wavelength of the highest frequency; cubic interpolation between them errs by 2e-4.
LEVELS = 20.0

# Of the largest pattern, below which one is nothing but rounding.
ROUNDING = 1e-13


def incident_wave(outcrop: Motion) -> Callable[[float], Floats]:
    """The rising wave of a motion recorded on an outcrop, half of its velocity.

    At a free surface the wave that arrives and the one that leaves add up to twice the first.

    Args:
        outcrop: Acceleration on rock at the surface [m/s^2].

    Returns:
        Velocity of the rising wave at a time [s], shape (3,), [m/s]; zero before the record, and
        after it what the record ends with, so correct its baseline.
    """
    acceleration, dt = outcrop.acceleration, outcrop.dt
    velocity, _ = outcrop.integrated()

    def rising(time: float) -> Floats:
        if time <= 0.0:
            return np.zeros(3)
        i = min(int(time / dt), len(velocity) - 1)
        if i == len(velocity) - 1:
            return 0.5 * velocity[-1]
        past = time - i * dt
        slope = (acceleration[i + 1] - acceleration[i]) / dt
        return 0.5 * (velocity[i] + past * (acceleration[i] + 0.5 * past * slope))

    return rising


@dataclass(frozen=True, kw_only=True)
@checked
class FreeField:
    """A plane wave that rises vertically through rock and comes back from its level surface.

    On viscous boundaries it is what the ground beyond them does: the dashpots act on the
    difference to the velocity of the free field, whose stress is added. At a level bottom this is
    twice the dashpots' traction at the incident velocity. The rock along the groups is one
    material; S waves move horizontally, P waves vertically. Displacements are absolute, so it
    excludes a motion of the ground.

    Attributes:
        groups: Names of facet groups with a viscous boundary: the bottom, and the sides.
        incident: Velocity of the rising wave at the base at a time [s], one number per axis [m/s];
            see `incident_wave`. In 2-D x and z of three numbers are taken.
        surface: Height of the level ground, a coordinate along z (y in 2-D) [m].
        base: Height at which ``incident`` is given; the lowest node of the groups unless given [m].
        components: Letters of the axes that the wave moves; all of them unless given.
        highest_frequency: Up to which delays between levels are resolved [Hz].
    """

    groups: Annotated[Sequence[str], at.MinLen(1)]
    incident: Callable[[float], Any]
    surface: Annotated[float, at.Unit("m")]
    base: Annotated[float, at.Unit("m")] | None = None
    components: str | None = None
    highest_frequency: Annotated[float, at.Gt(0), at.Unit("Hz")] = 25.0

    def __post_init__(self) -> None:
        """Check groups and letters."""
        if len(set(self.groups)) < len(self.groups) or not all(
            isinstance(group, str) for group in self.groups
        ):
            raise ValueError(
                f"FreeField: groups is {shown(self.groups)}; it must name facet groups, each once."
            )
        if self.components is not None:
            components_of(self.components, 3)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Tractions by level, those of the rising and of the falling wave (collective)."""
        base, velocity = self._base(model), self._velocity(model)
        found: list[tuple[PETSc.Vec, TimeFactor]] = []
        for axis, speed in self._speeds(model).items():
            spacing = speed / (LEVELS * self.highest_frequency)
            for way in (1, -1):
                start = 0.0 if way > 0 else 2.0 * (self.surface - base) / speed
                for level, force in _levels(model, self.groups, axis, way, base, spacing):
                    delay = start + way * level * spacing / speed
                    found.append((force, _delayed(velocity, axis, delay)))
        largest = max((force.norm() for force, _ in found), default=0.0)
        return [(f, factor) for f, factor in found if f.norm() > ROUNDING * largest]

    def surface_velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Velocity of the level surface that nothing stands on, (3,) at a time [s] (collective).

        Twice the rising wave's a travel time before [m/s].
        """
        height, velocity = self.surface - self._base(model), self._velocity(model)
        speeds = self._speeds(model)

        def surface(time: float) -> Floats:
            found = np.zeros(3)
            for axis, speed in speeds.items():
                found[axis] = 2.0 * velocity(time - height / speed)[axis]
            return found

        return surface

    def _velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Velocity of the rising wave in the axes of the model."""
        velocity = lru_cache(maxsize=512)(in_axes(self.incident, model.gdim, "FreeField: incident"))
        velocity(0.0)
        return velocity

    def _speeds(self, model: LoadedBody) -> dict[int, float]:
        """Speed of the wave that moves along each axis, by its number [m/s] (collective)."""
        lame, shear, density = _rock(model, self.groups)
        up = model.gdim - 1
        letters = "xyz"[: model.gdim] if self.components is None else self.components
        return {
            int(axis): float(np.sqrt((lame + 2.0 * shear if axis == up else shear) / density))
            for axis in components_of(letters, model.gdim)
        }

    def _base(self, model: LoadedBody) -> float:
        """Height of the base, once groups and heights are checked (collective)."""
        missing = [group for group in self.groups if group not in model.absorbing]
        if missing:
            raise ValueError(
                f"FreeField: the group {missing[0]!r} has no viscous boundary; add "
                f"ViscousBoundary(group={missing[0]!r}) to the supports."
            )
        lowest, highest = _heights(model, self.groups)
        base = lowest if self.base is None else self.base
        if highest - self.surface > 1e-9 * (highest - base) or self.surface <= base:
            lowest, highest, base = (round(z, 6) + 0.0 for z in (lowest, highest, base))
            raise ValueError(
                f"FreeField: surface is {self.surface:g} m; the groups {', '.join(self.groups)} "
                f"reach from {lowest:g} to {highest:g} m; it must reach up to their top and "
                f"above the base, {base:g} m."
            )
        return base


class SupportForces:
    """Forces of supports that held the body in statics and are no more in a dynamic stage.

    Rock that is held in statics and stands on dashpots in an earthquake needs them.

    Args:
        model: The model of the dynamic stage.
    """

    def __init__(self, model: LoadedBody) -> None:
        """No forces yet (collective)."""
        force = model.mass.createVecRight()
        force.set(0.0)
        self._force = model.joined(force)

    def take(self, reaction: PETSc.Vec, constrained: NDArray[np.int64]) -> None:
        """Take the reaction of a static state [N], but at the dofs that are constrained now."""
        held = reaction.getArray(readonly=True)
        self._force.getArray()[: len(held)] = held
        self._force.getArray()[constrained] = 0.0

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """The forces, with all that is taken later."""
        return [(self._force, always)]


def _rock(model: LoadedBody, groups: Sequence[str]) -> Floats:
    """Lambda [Pa], mu [Pa] and rho [kg/m^3] of the cells along the groups (collective)."""
    fields = (model.body.first_lame, model.body.shear_modulus, model.body.density)
    mesh = model.jointed.mesh
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    cell_of = mesh.topology.connectivity(tdim - 1, tdim)
    facets = np.concatenate([model.jointed.facets(group) for group in groups])
    cells = np.array([cell_of.links(facet)[0] for facet in facets], dtype=np.int32)
    values = np.empty((len(cells), 3))
    for i, field in enumerate(fields):
        spread = hasattr(field, "function_space")
        values[:, i] = (
            field.x.array[field.function_space.dofmap.list[cells, 0]] if spread else field.value
        )
    every = np.unique(np.concatenate(mesh.comm.allgather(np.unique(values, axis=0))), axis=0)
    if len(every) != 1 or every[0, 2] == 0.0:
        densities = ", ".join(f"{rho:g}" for rho in every[:, 2])
        raise ValueError(
            f"FreeField: the rock along {', '.join(groups)} has {len(every)} materials (densities "
            f"{densities} kg/m^3); it must be one material with mass."
        )
    return every[0]


def _levels(
    model: LoadedBody, groups: Sequence[str], axis: int, way: int, base: float, spacing: float
) -> list[tuple[int, PETSc.Vec]]:
    """Forces of a unit velocity on each level, with its number from the base (collective).

    Between levels velocities are cubic, on facets as the shape functions of the mesh.
    """
    degree = model.V.element.basix_element.degree
    scalar = fem.functionspace(model.jointed.mesh, ("Lagrange", degree))
    w, v = ufl.TrialFunction(scalar), ufl.TestFunction(model.V)
    form = sum(
        ufl.inner(_traction(model, axis, way) * w, v) * model.jointed.ds(group) for group in groups
    )
    matrix = fem_petsc.assemble_matrix(fem.form(form))
    matrix.assemble()
    share, result = matrix.createVecRight(), matrix.createVecLeft()
    owned = share.getLocalSize()
    heights = scalar.tabulate_dof_coordinates()[:owned, model.gdim - 1]
    place = (heights - base) / spacing
    first, last = ((end - base) / spacing for end in _heights(model, groups))
    forces = []
    for level in range(int(np.floor(first)) - 1, int(np.floor(last)) + 3):
        share.setArray(_cubic(place - level))
        matrix.mult(share, result)
        force = model.mass.createVecRight()
        force.setArray(result.getArray(readonly=True).copy())
        forces.append((level, force))
    for petsc in (matrix, share, result):
        petsc.destroy()
    return forces


def _heights(model: LoadedBody, groups: Sequence[str]) -> tuple[float, float]:
    """Heights of the lowest and the highest node of the groups [m] (collective)."""
    z = model.V.tabulate_dof_coordinates()[:, model.gdim - 1]
    acting = np.concatenate([z[model.nodes(group)] for group in groups])
    ends = model.jointed.mesh.comm.allgather(
        (float(acting.min(initial=np.inf)), float(acting.max(initial=-np.inf)))
    )
    return min(low for low, _ in ends), max(high for _, high in ends)


def _cubic(offset: Floats) -> Floats:
    """Weight of a level at nodes ``offset`` spacings above it, Lagrange's on four levels."""
    x = np.abs(offset)
    near = (1.0 - x) * (1.0 + x) * (2.0 - x) / 2.0
    far = (1.0 - x) * (2.0 - x) * (3.0 - x) / 6.0
    return np.where(x < 1.0, near, np.where(x < 2.0, far, 0.0))


def _traction(model: LoadedBody, axis: int, way: int) -> Any:
    """Dashpots and stress of a wave of unit velocity, rising (way 1) or falling (-1), [Pa s/m]."""
    body, up = model.body, model.gdim - 1
    n = ufl.FacetNormal(model.jointed.mesh)
    along = ufl.as_vector([float(i == axis) for i in range(model.gdim)])
    vertical = ufl.as_vector([float(i == up) for i in range(model.gdim)])
    if axis == up:
        modulus = body.first_lame + 2.0 * body.shear_modulus
        stress = 2.0 * body.shear_modulus / modulus * n[up] * vertical
        stress = ufl.sqrt(body.density * modulus) * (stress + body.first_lame / modulus * n)
    else:
        stress = ufl.sqrt(body.density * body.shear_modulus) * (n[up] * along + n[axis] * vertical)
    return impedance(model.jointed, body, along) - way * stress


def _delayed(velocity: Callable[[float], Any], axis: int, delay: float) -> TimeFactor:
    return lambda time: float(velocity(time - delay)[axis])
