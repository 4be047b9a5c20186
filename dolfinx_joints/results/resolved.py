# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Highest frequencies that the time step, the mesh and the joints of a run resolve."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dolfinx_joints.results.reader import Results

STEPS_PER_PERIOD = 10.0
"""Ten steps per period: the trapezoidal rule lengthens the period by 3 % (Clough and Penzien)."""

_ROUNDING = 1e-6  # tolerance relative to a band, for rounding errors of steps

_REMEDIES = {"step": "a shorter step", "mesh": "a finer mesh", "joints": "stiffer joints"}


class Resolved(NamedTuple):
    """Highest resolved frequencies [Hz], infinite if there is no limit.

    Attributes:
        step: 1 / (10 dt), with the longest step.
        mesh: Frequency with ten nodes per shortest wavelength (`resolution.of_mesh`).
        joints: Frequency at which closed joints transmit half the energy (`resolution.of_joints`).
    """

    step: float = math.inf
    mesh: float = math.inf
    joints: float = math.inf

    @property
    def lowest(self) -> tuple[float, str]:
        """Lowest of the three frequencies [Hz], and the name of its limit."""
        return min(zip(self, self._fields, strict=True))

    def as_json(self) -> dict[str, float | None]:
        """Return the frequencies by name, None instead of infinite."""
        return {name: f if math.isfinite(f) else None for name, f in self._asdict().items()}


def resolved_frequencies(*runs: Results) -> Resolved:
    """Return the highest frequencies that all runs resolve.

    The longest recorded step is used. A limit that a file does not contain is infinite.
    """
    per_run = [_of_run(results) for results in runs]
    return Resolved(*(min(limits, default=math.inf) for limits in zip(*per_run, strict=True)))


def of_step(dt: float) -> float:
    """Return the highest frequency [Hz] that a time step [s] resolves."""
    return 1.0 / (STEPS_PER_PERIOD * dt)


def beyond(band: float | None, resolved: Resolved) -> str:
    """Return a warning if ``band`` [Hz] exceeds a resolved frequency; otherwise an empty text."""
    if band is None:
        return ""
    by_frequency = sorted(zip(resolved, resolved._fields, strict=True))
    limits = {name: f for f, name in by_frequency if f < (1.0 - _ROUNDING) * band}
    if not limits:
        return ""
    causes = " and ".join(f"the {name} up to {f:.3g} Hz" for name, f in limits.items())
    remedies = " and ".join(_REMEDIES[name] for name in limits)
    return (
        f"accelerations are shown up to {band:.3g} Hz, but motions are resolved by {causes}; use "
        f"{remedies}, or a lower band."
    )


def _of_run(results: Results) -> Resolved:
    manifest = results.metadata.get("manifest")
    stored = manifest.get("resolved_hz", {}) if isinstance(manifest, dict) else {}
    limits = {name: float(f) for name, f in stored.items() if f is not None}
    if "histories" in results.streams:
        longest = float(np.diff(results.time("histories")).max(initial=0.0))
        if longest > 0.0:
            limits["step"] = of_step(longest)
    return Resolved(**limits)
