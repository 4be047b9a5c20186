# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Terms of the energy ledger, with the energy of waves in and out as a separate term."""

from __future__ import annotations

import re

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.quantities import rows_below
from dolfinx_joints.results.reader import Results

WAVES = "waves"
_ROUNDING = 1e-12  # tolerance, relative to the larger of the energies of waves in and out


def energy_lines(results: Results) -> dict[str, Floats]:
    """Return the terms of the ledger of the whole model by name, shape (records,), [J].

    With viscous boundaries or waves in a reservoir, the term ``waves`` is the energy that entered
    through the boundaries minus the energy that left (`through_boundaries`). ``input`` and
    ``viscous`` then exclude these energies, which may be a thousand times larger than all others.
    """
    check_results(results)
    results.rows("energy")  # raises an error if only static stages are recorded
    terms = [row.name for row in rows_below("energy") if row.name in results.streams["energy"]]
    lines = {term: results.series("energy", term) for term in terms if term != "absorbed"}
    through = through_boundaries(results)
    if through is not None:
        inflow, outflow = through
        lines["input"] = lines["input"] - inflow
        lines["viscous"] = lines["viscous"] - outflow
        lines = {WAVES: inflow - outflow, **lines}
    return lines


def through_boundaries(results: Results) -> tuple[Floats, Floats] | None:
    """Return the energy supplied by free fields and the energy absorbed by viscous boundaries.

    Both have shape (records,), [J]. The absorbed energy includes the losses at the bottom and the
    far end of a reservoir. Return None if the run has no absorbing boundary.
    """
    names = results.streams["energy"]
    if "absorbed" not in names:
        return None
    outflow = results.series("energy", "absorbed")
    fields = r"loads/((Oblique)?FreeField(_\d+)?|FarField_reservoir)"
    waves = [name for name in names if re.fullmatch(fields, name)]
    inflow = sum((results.series("energy", name) for name in waves), np.zeros_like(outflow))
    return inflow, outflow


def waves_at_end(results: Results) -> tuple[float, float] | None:
    """Return both energies of `through_boundaries` at the end [J], rounding errors set to zero."""
    through = through_boundaries(results)
    if through is None or not results.rows("energy"):
        return None
    inflow, outflow = (float(energy[-1]) for energy in through)
    least = _ROUNDING * max(abs(inflow), abs(outflow))
    return (inflow if abs(inflow) > least else 0.0), (outflow if abs(outflow) > least else 0.0)


def joint_losses(results: Results) -> dict[str, tuple[float, float]]:
    """Return friction work and numerical loss of each joint at the end of a run, by joint, [J]."""
    check_results(results)
    terms = ("friction", "numerical")
    losses = {}
    for joint in results.joints:
        names = [f"joints/{joint}/{term}" for term in terms]
        if set(names) <= set(results.streams["energy"]) and results.rows("energy"):
            friction, lost = (float(results.series("energy", name, -1)) for name in names)
            losses[joint] = friction, lost
    return losses
