# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressures of the water in joints at the times of a run, for what records them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.loads.water.joint_pressures import Codes, WaterInJoint, label
from dolfinx_joints.loads.water.joint_water import Uplift
from dolfinx_joints.model.model import Model

Floats = NDArray[np.float64]


class WaterPressures:
    """All water in the joints of a stage.

    Args:
        model: The model.
        loads: The `Uplift` and `JointWater` loads that act.
    """

    def __init__(self, model: Model, loads: Sequence[Any]) -> None:
        """Find the pressures of each point (collective)."""
        given = [load for load in loads if isinstance(load, Uplift)]
        self._given = [(load.at_points(model), load.factor) for load in given]
        others = [load for load in loads if not isinstance(load, Uplift)]
        self._parts = [WaterInJoint(label(load), load, model) for load in others]
        assert model.operator is not None
        self._size = len(model.operator.areas)

    def __call__(self, time: float, codes: Codes | None) -> Floats:
        """Pressure at the local joint points, shape (n,), [Pa].

        Args:
            time: Time [s].
            codes: What the water does there, ``DynamicState.water``; None where no load depends
                on the joints.
        """
        total = np.zeros(self._size)
        for pressure, factor in self._given:
            total += float(factor(time)) * pressure
        for part in self._parts:
            assert codes is not None
            total += part.factor(time) * part.pressure(codes)
        return total
