# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces from the ground outside the model: rising waves, and static reactions in dynamics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.supports import components_of
from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.loads.column import Column
from dolfinx_joints.loads.ground_motion import IncidentWave, in_axes
from dolfinx_joints.loads.load import LoadedBody, TimeFactor, always
from dolfinx_joints.loads.wave_levels import (
    LEVELS,
    Layer,
    check_groups,
    checked_base,
    forces_of_levels,
    layers_along,
    without_rounding,
)
from dolfinx_joints.motions.motion import Motion

# Samples per period of the highest frequency, for waves reflected at layer interfaces.
SAMPLES = 80.0

# Largest final velocity of an outcrop without a warning, relative to its largest velocity.
DRIFT = 0.1


def incident_wave(outcrop: Motion) -> IncidentWave:
    """Return the rising wave of a record on rock outcrop: half of the outcrop's velocity.

    At a free surface, the rising and the reflected wave add up to twice the rising wave.

    Args:
        outcrop: Acceleration recorded on a rock outcrop [m/s^2].

    Returns:
        Function of the time [s] that returns the velocity of the rising wave, (3,), [m/s]. The
        velocity is zero before the record and keeps its last value afterwards: the record must be
        baseline-corrected to end with zero velocity (a warning above DRIFT). As for any ground
        motion, `dynamics` removes the frequencies that its steps do not resolve.
    """
    check_kind_of("outcrop", outcrop, isinstance(outcrop, Motion), "a Motion")
    velocity, _ = outcrop.integrated()
    last, peak = np.abs(velocity[-1]).max(), np.abs(velocity).max()
    if last > DRIFT * peak:
        text = f"ends with a velocity of {last:.3g} m/s ({100.0 * last / peak:.3g} % of its peak)"
        advice = "so the model moves away. Correct its baseline"
        warn(f"The motion {shown(outcrop.name)} {text}, {advice}.", PlausibilityWarning)
    return IncidentWave(outcrop)


@dataclass(frozen=True, kw_only=True)
@checked
class FreeField:
    """Plane wave that rises vertically through rock and is reflected at the horizontal surface.

    The free field is the motion of the rock without the structure. On viscous boundaries its stress
    is applied, and the dashpots resist only the velocity relative to the free field. On a
    horizontal bottom the traction is rho c (2 v_i - v), with the velocity v_i of the rising wave
    and v of the boundary. The rock along the facet groups is one material, or several horizontal
    layers that reflect waves at their interfaces. Horizontal components are S waves; the vertical
    component is a P wave. Displacements are absolute, so a ground motion is not allowed.

    Attributes:
        groups: Names of facet groups with a viscous boundary: the bottom and the sides.
        incident: Function of the time [s] that returns the velocity of the rising wave at the base,
            one number per axis [m/s]; see `incident_wave`. In 2-D, x and z of three numbers count.
        surface: Height of the ground surface, a coordinate along z (y in 2-D) [m].
        base: Height at which ``incident`` is given [m]; the lowest node of the groups by default.
        components: Letters of the axes along which the rock moves; all axes by default.
        highest_frequency: Highest frequency [Hz] at which travel times along the boundary are
            resolved.
    """

    groups: Annotated[Sequence[str], at.MinLen(1)]
    incident: Callable[[float], Any]
    surface: Annotated[float, at.Unit("m")]
    base: Annotated[float, at.Unit("m")] | None = None
    components: str | None = None
    highest_frequency: Annotated[float, at.Gt(0), at.Unit("Hz")] = 25.0

    def __post_init__(self) -> None:
        check_groups("FreeField", self.groups)
        good = not isinstance(self.incident, Motion)  # an acceleration
        check_kind_of("incident", self.incident, good, "a velocity; use incident_wave(motion)")
        if self.components is not None:
            components_of(self.components, 3)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return force vectors with their factors of time (collective).

        The boundary is divided into levels of equal travel time. Each level has one vector per axis
        and direction of the wave, and the delayed wave as its factor.
        """
        layers, columns = self._columns(model)
        spacing, up = 1.0 / (LEVELS * self.highest_frequency), np.eye(model.gdim)[-1]
        patterns: list[tuple[PETSc.Vec, TimeFactor]] = []
        for axis, column in columns.items():
            for number, layer in enumerate(layers):
                upward = up / _speed(layer, axis, model.gdim)
                waves = (
                    (upward, layer.bottom, column.rising),
                    (-upward, layer.top, column.falling),
                )
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
                    patterns += [(force, _delayed(wave, number, delay)) for delay, force in forces]
        return without_rounding(patterns)

    def surface_velocity(self, model: LoadedBody) -> Callable[[float], Floats]:
        """Return the free-field velocity of the surface, (3,) at a time [s], [m/s] (collective).

        At the free surface, the velocity is twice that of the rising wave.
        """
        layers, columns = self._columns(model)

        def surface(time: float) -> Floats:
            result = np.zeros(3)
            for axis, column in columns.items():
                result[axis] = 2.0 * column.falling(len(layers) - 1, time)
            return result

        return surface

    def _columns(self, model: LoadedBody) -> tuple[list[Layer], dict[int, Column]]:
        """Return the rock layers, and the waves in them for each axis (collective)."""
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
    """Static reactions of supports that dashpots replace in dynamics, applied as forces."""

    def __init__(self, model: LoadedBody) -> None:
        """Start with zero forces (collective)."""
        force = model.mass.createVecRight()
        force.set(0.0)
        self._force = model.joined(force)

    def set_reactions(self, reaction: PETSc.Vec, constrained: Ints) -> None:
        """Store the reactions of a static state [N], except at dofs that are still constrained."""
        reactions = reaction.getArray(readonly=True)
        self._force.getArray()[: len(reactions)] = reactions
        self._force.getArray()[constrained] = 0.0

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the force vector; `set_reactions` changes its values later."""
        return [(self._force, always)]


def _speed(layer: Layer, axis: int, gdim: int) -> float:
    """Return the speed [m/s] of the vertical wave in a layer that moves the rock along an axis."""
    return layer.pressure_speed if axis == gdim - 1 else layer.shear_speed


def _along(velocity: Callable[[float], Any], axis: int) -> Callable[[float], float]:
    return lambda time: float(velocity(time)[axis])


def _delayed(wave: Callable[[int, float], float], layer: int, delay: float) -> TimeFactor:
    return lambda time: wave(layer, time - delay)
