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
from petsc4py import PETSc

from dolfinx_joints.body.supports import components_of
from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.declared import checked
from dolfinx_joints.loads.column import Column
from dolfinx_joints.loads.ground_motion import IncidentWave, in_axes
from dolfinx_joints.loads.load import TimeFactor, always
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.rock import Layer, layers_along
from dolfinx_joints.loads.wave_levels import (
    LEVELS,
    check_groups,
    checked_base,
    forces_of_levels,
    that_act,
)
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.motions.motion import Motion

# Samples per period of the highest frequency of the waves that interfaces send back.
SAMPLES = 80.0


def incident_wave(outcrop: Motion) -> IncidentWave:
    """Return the rising wave of a motion recorded on an outcrop, half of its velocity.

    At a free surface the wave that arrives and the one that leaves add up to twice the first.

    Args:
        outcrop: Acceleration on rock at the surface [m/s^2].

    Returns:
        Velocity of the rising wave at a time [s], shape (3,), [m/s]; zero before the record, and
        after it what the record ends with, so correct its baseline. `dynamics` removes the
        frequencies that its steps do not resolve, as from a motion of the ground.
    """
    return IncidentWave(outcrop)


@dataclass(frozen=True, kw_only=True)
@checked
class FreeField:
    """A plane wave that rises vertically through rock and comes back from its level surface.

    On viscous boundaries it is what the ground beyond them does: the dashpots act on the
    difference to the velocity of the free field, whose stress is added. At a level bottom this is
    twice the dashpots' traction at the incident velocity. The rock along the groups is one
    material, or several in level layers, which send back a part each; S waves move horizontally, P
    waves vertically. Displacements are absolute, so it excludes a motion of the ground.

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
        check_groups("FreeField", self.groups)
        if self.components is not None:
            components_of(self.components, 3)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Tractions by level, those of the rising and of the falling wave (collective)."""
        layers, columns = self._columns(model)
        spacing, up = 1.0 / (LEVELS * self.highest_frequency), np.eye(model.gdim)[-1]
        found: list[tuple[PETSc.Vec, TimeFactor]] = []
        for axis, column in columns.items():
            for number, layer in enumerate(layers):
                slow = up / _speed(layer, axis, model.gdim)
                waves = ((slow, layer.bottom, column.rising), (-slow, layer.top, column.falling))
                for slowness, height, wave in waves:
                    forces = forces_of_levels(
                        model,
                        self.groups,
                        np.eye(model.gdim)[axis],
                        slowness,
                        spacing,
                        start=height * slowness[-1],
                        layer=layer if len(layers) > 1 else None,
                    )
                    found += [(force, _delayed(wave, number, late)) for late, force in forces]
        return that_act(found)

    def surface_velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Velocity of the level surface that nothing stands on, (3,) at a time [s] (collective).

        Twice the wave's that arrives there [m/s].
        """
        layers, columns = self._columns(model)

        def surface(time: float) -> Floats:
            found = np.zeros(3)
            for axis, column in columns.items():
                found[axis] = 2.0 * column.falling(len(layers) - 1, time)
            return found

        return surface

    def _columns(self, model: LoadedBody) -> tuple[list[Layer], dict[int, Column]]:
        """Layers of the rock, and the waves in them by axis (collective)."""
        base = checked_base("FreeField", model, self.groups, self.surface, self.base)
        velocity = lru_cache(maxsize=512)(in_axes(self.incident, model.gdim, "FreeField: incident"))
        velocity(0.0)
        layers = layers_along("FreeField", model, self.groups, base, self.surface)
        letters = "xyz"[: model.gdim] if self.components is None else self.components
        columns = {}
        for axis in map(int, components_of(letters, model.gdim)):
            speeds = [_speed(layer, axis, model.gdim) for layer in layers]
            columns[axis] = Column(
                _along(velocity, axis),
                [layer.density * speed for layer, speed in zip(layers, speeds, strict=True)],
                [(la.top - la.bottom) / speed for la, speed in zip(layers, speeds, strict=True)],
                1.0 / (SAMPLES * self.highest_frequency),
            )
        return layers, columns


class SupportForces:
    """Forces of supports that held the body in statics and are no more in a dynamic stage.

    Rock that is held in statics and stands on dashpots in an earthquake needs them.
    """

    def __init__(self, model: LoadedBody) -> None:
        """No forces yet (collective)."""
        force = model.mass.createVecRight()
        force.set(0.0)
        self._force = model.joined(force)

    def take(self, reaction: PETSc.Vec, constrained: Ints) -> None:
        """Take the reaction of a static state [N], but at the dofs that are constrained now."""
        held = reaction.getArray(readonly=True)
        self._force.getArray()[: len(held)] = held
        self._force.getArray()[constrained] = 0.0

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """The forces, with all that is taken later."""
        return [(self._force, always)]


def _speed(layer: Layer, axis: int, gdim: int) -> float:
    """Speed in a layer of the vertical wave that moves along an axis [m/s]."""
    return layer.pressure_speed if axis == gdim - 1 else layer.shear_speed


def _along(velocity: Callable[[float], Any], axis: int) -> Callable[[float], float]:
    return lambda time: float(velocity(time)[axis])


def _delayed(wave: Callable[[int, float], float], layer: int, delay: float) -> TimeFactor:
    return lambda time: wave(layer, time - delay)
