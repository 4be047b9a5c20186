# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies after static stages, and jumps in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from dolfinx_joints.laws.law import Floats


@dataclass(frozen=True, kw_only=True)
class StaticEnergy:
    """Energies after static stages, all in [J]; works and losses count from the unloaded body.

    Attributes:
        strain: Strain energy u.K u / 2 of bulk and springs, in nonlinear cells that of their law.
        joint_elastic: Elastic energy of each joint, shape (number of joints,).
        input_by_load: Work of each load by name. ``grout`` is grout under pressure, and
            ``construction`` are residual forces of earlier stages in inactive joints and absent
            blocks.
        supports: Work of supports and prescribed displacements.
        joint_friction: Work done against friction in each joint, shape (number of joints,).
        joint_numerical: Integration error of the work of each joint on straight increments, from
            formulas of the law, positive for a loss, shape (number of joints,).
        joint_bonds: Energy lost in each joint at points whose bonds broke, including the motion
            after the break, shape (number of joints,).
        plastic: Plastic work and other losses of nonlinear cells.
        bulk_numerical: Integration error of the work of reversible nonlinear cells.
        joint_released: Energy released in each joint by jumps (31b), shape (number of joints,); a
            part of friction and numerical loss.
        water_released: Energy released in increments in which joint points become wet or dry.
        error: Stored energy plus losses minus work; zero up to rounding and the solver tolerance.
        scale: Largest stored energy, |input| or losses so far.
    """

    strain: float = 0.0
    joint_elastic: Floats
    input_by_load: Mapping[str, float] = field(default_factory=dict)
    supports: float = 0.0
    joint_friction: Floats
    joint_numerical: Floats
    joint_bonds: Floats
    plastic: float = 0.0
    bulk_numerical: float = 0.0
    joint_released: Floats
    water_released: float = 0.0
    error: float = 0.0
    scale: float = 0.0

    @cached_property
    def stored(self) -> float:
        """Strain energy plus elastic energy of the joints [J]."""
        return self.strain + float(self.joint_elastic.sum())

    @cached_property
    def input(self) -> float:
        """Work of loads, supports and prescribed displacements [J]."""
        return sum(self.input_by_load.values()) + self.supports

    @cached_property
    def released(self) -> float:
        """Released energy of all joints [J]."""
        return float(self.joint_released.sum())

    @property
    def relative_error(self) -> float:
        """Absolute error of the energy balance, divided by ``scale``."""
        return abs(self.error) / self.scale if self.scale else 0.0


@dataclass(frozen=True, kw_only=True)
class Jump:
    """Increment in which the structure jumps from its equilibrium path to another equilibrium.

    Attributes:
        step: Number of the load step in its stage.
        time: Time at the end of the load step [s], None for a ramp.
        start: Load factor at the start of the increment.
        end: Load factor at the end of the increment.
        energy: Energy released [J].
        joints: Names of the joints that released the energy, in descending order of energy.
    """

    step: int
    time: float | None
    start: float
    end: float
    energy: float
    joints: tuple[str, ...]
