# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frequencies up to which a run resolves motions: by its step, its mesh and its joints."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dolfinx_joints.results.reader import Results

STEPS_PER_PERIOD = 10.0
"""With so many steps a period comes out 3 % long by the trapezoidal rule (Clough and Penzien)."""

_ROUNDING = 1e-6  # part of a band: steps are differences of times

_REMEDIES = {"step": "a shorter step", "mesh": "a finer mesh", "joints": "stiffer joints"}


class Resolved(NamedTuple):
    """Frequencies up to which motions are resolved [Hz], infinite where nothing limits them.

    Attributes:
        step: 1 / (10 dt), with the longest step.
        mesh: Ten nodes to the shortest wave (`resolution.of_mesh`).
        joints: Where closed joints let half of a wave's energy pass (`resolution.of_joints`).
    """

    step: float = math.inf
    mesh: float = math.inf
    joints: float = math.inf

    @property
    def lowest(self) -> tuple[float, str]:
        """The lowest of the three [Hz], and which it is."""
        return min(zip(self, self._fields, strict=True))

    def as_json(self) -> dict[str, float | None]:
        """By name, None for what is not limited."""
        return {name: f if math.isfinite(f) else None for name, f in self._asdict().items()}


def resolved_frequencies(*runs: Results) -> Resolved:
    """Frequencies up to which every one of some runs resolves motions.

    That of the step is of the longest recorded; what a file does not say limits nothing.
    """
    every = [_of(results) for results in runs]
    return Resolved(*(min(each, default=math.inf) for each in zip(*every, strict=True)))


def of_step(dt: float) -> float:
    """Frequency that a time step [s] resolves [Hz]."""
    return 1.0 / (STEPS_PER_PERIOD * dt)


def beyond(band: float | None, resolved: Resolved) -> str:
    """Sentence on a band that ends above what is resolved, empty where it does not, or is raw."""
    if band is None:
        return ""
    by_frequency = sorted(zip(resolved, resolved._fields, strict=True))
    limits = {name: f for f, name in by_frequency if f < (1.0 - _ROUNDING) * band}
    if not limits:
        return ""
    each = " and ".join(f"the {name} up to {f:.3g} Hz" for name, f in limits.items())
    remedies = " and ".join(_REMEDIES[name] for name in limits)
    return (
        f"accelerations are given up to {band:.3g} Hz, but motions are resolved by {each}; take "
        f"{remedies}, or a lower band."
    )


def _of(results: Results) -> Resolved:
    made_by = results.metadata.get("manifest")
    known = made_by.get("resolved_hz", {}) if isinstance(made_by, dict) else {}
    limits = {name: float(f) for name, f in known.items() if f is not None}
    if "histories" in results.streams:
        longest = float(np.diff(results.time("histories")).max(initial=0.0))
        if longest > 0.0:
            limits["step"] = of_step(longest)
    return Resolved(**limits)
