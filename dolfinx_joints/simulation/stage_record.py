# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What monitors see of static stages, and what is kept of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.loads.load import Load
from dolfinx_joints.loads.water.pressures_in_joints import WaterPressures, water_in_joints
from dolfinx_joints.model.model import Model
from dolfinx_joints.results.layout import stage_bytes
from dolfinx_joints.simulation.outcome import StaticState


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRecord:
    """A static stage at its end.

    Attributes:
        name: Name of the stage.
        time: Time at which its loads and prescribed displacements are taken [s].
        state: Equilibrium, displacements counted from the unloaded body.
        loads: Which of the model's loads act, their places in ``Model.loads``.
        pressure: Of the water at the local joint points, shape (n,), [Pa]; None without any.
    """

    name: str
    time: float
    state: StaticState
    loads: tuple[int, ...]
    pressure: NDArray[np.float64] | None


def stage_record(
    model: Model, name: str, time: float, state: StaticState, acting: Sequence[Load]
) -> StageRecord:
    """A static stage under loads of the model, with its water in joints (collective)."""
    pressure, wet = None, water_in_joints(acting)
    if wet and state.joints is not None:
        water = WaterPressures(model, wet)
        pressure = water(time, water.by_opening(state.joints.state.gap))
    places = tuple(i for i, one in enumerate(model.loads) if any(one is load for load in acting))
    return StageRecord(name=name, time=time, state=state, loads=places, pressure=pressure)


def stage_name(given: str | None, kind: str, stages: Sequence[StageRecord]) -> str:
    """The name of a new stage: the one given if no stage has it, else its kind and a number."""
    names = [stage.name for stage in stages]
    if given is None:
        numbered = (f"{kind} {number}" for number in count(1))
        return next(n for n in numbered if not any(f"{s},".startswith(f"{n},") for s in names))
    stage_bytes(given)
    if given in names:
        raise JointsError(
            f"There is a static stage {given!r} already; the stages so far are: {', '.join(names)}."
        )
    return given
