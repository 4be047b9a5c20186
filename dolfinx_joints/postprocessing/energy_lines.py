# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of the energy ledger, with what waves bring and take apart from what stays."""

from __future__ import annotations

import re

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.quantities import rows_below
from dolfinx_joints.results.reader import Results

WAVES = "waves"
_ROUNDING = 1e-12  # of the larger of what waves bring and take


def energy_lines(results: Results) -> dict[str, Floats]:
    """Lines of the ledger at every step, by name, each of shape (records,), [J].

    Those of the whole model that the run has. With viscous boundaries or waves in a reservoir
    there is ``waves`` as well, what has come in through them less what has gone out
    (`through_boundaries`), and ``input`` and ``viscous`` are those of all else: the two parts of
    ``waves`` may be a thousand times larger than anything that deforms the body.
    """
    check_results(results)
    known = [row.name for row in rows_below("energy") if row.name in results.streams["energy"]]
    lines = {term: results.series("energy", term) for term in known if term != "absorbed"}
    through = through_boundaries(results)
    if through is not None:
        brought, taken = through
        lines["input"] = lines["input"] - brought
        lines["viscous"] = lines["viscous"] - taken
        lines = {WAVES: brought - taken, **lines}
    return lines


def through_boundaries(results: Results) -> tuple[Floats, Floats] | None:
    """Energy that free fields have put in and that the dashpots of viscous boundaries have taken.

    Both of shape (records,), [J], with what bottom and far end of a reservoir have taken; None for
    a run without either.
    """
    names = results.streams["energy"]
    if "absorbed" not in names:
        return None
    taken = results.series("energy", "absorbed")
    fields = r"loads/((Oblique)?FreeField(_\d+)?|FarField_reservoir)"
    waves = [name for name in names if re.fullmatch(fields, name)]
    brought = sum((results.series("energy", name) for name in waves), np.zeros_like(taken))
    return brought, taken


def waves_at_end(results: Results) -> tuple[float, float] | None:
    """What waves have brought and taken by the end of a run, zero where it is rounding, [J]."""
    through = through_boundaries(results)
    if through is None or not results.rows("energy"):
        return None
    brought, taken = (float(each[-1]) for each in through)
    least = _ROUNDING * max(abs(brought), abs(taken))
    return (brought if abs(brought) > least else 0.0), (taken if abs(taken) > least else 0.0)


def joint_losses(results: Results) -> dict[str, tuple[float, float]]:
    """Friction work and numerical loss of each joint at the end of a run, by joint, [J]."""
    check_results(results)
    terms = ("friction", "numerical")
    found = {}
    for joint in results.joints:
        names = [f"joints/{joint}/{term}" for term in terms]
        if set(names) <= set(results.streams["energy"]) and results.rows("energy"):
            friction, lost = (float(results.series("energy", name, -1)) for name in names)
            found[joint] = friction, lost
    return found
