# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report sections with the checks of a dam, and with the safety of sliding blocks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.postprocessing.criteria import checks as criteria
from dolfinx_joints.postprocessing.criteria.sliding import recorded_blocks
from dolfinx_joints.postprocessing.envelopes import DYNAMIC_TENSILE
from dolfinx_joints.report.page import Html, Section, paragraph, table
from dolfinx_joints.report.panels import Curve, panels
from dolfinx_joints.report.runs import Content, Run, nothing
from dolfinx_joints.results.quantities import TABLE

_NOTE = (
    "Default limits are the linear criteria of USACE EM 1110-2-6053 (2007) and of Y. Ghanaat and "
    "A. Chudgar; check them against the edition that applies. Stresses are those of the "
    "cell groups with joints, at vertices with a strength; other tables of stresses cover all "
    "recorded vertices. The dynamic tensile strength is dynamic_factor, 1 by default, times the "
    "tensile strength. The least sliding safety is 1 if a joint slides at any instant, even if "
    "the slip is negligible: judge slip by its own limits."
)
_SLIDING = (
    "The factor of safety F is the shear strength of the planes under the forces on a rigid block, "
    "divided by the force along the direction of sliding. Newmark's block is rigid; it starts to "
    "slide if F < 1, until its velocity is zero. A fall of thrusts due to the slip is included."
)
_SAFE = 5.0  # largest factor of safety that is drawn


def checks(content: Content) -> Section:
    """Return the section with a table for each run with strengths or arguments of `checks`.

    The limits are those of a gravity dam unless the metadata of the run has another kind.
    """
    pieces = []
    for run in content.runs:
        kind, outcome = judged(run)
        if isinstance(outcome, str):
            pieces.append(paragraph(f"{run.label} cannot be checked: {outcome}"))
        elif outcome is not None:
            title = f"Checks, limits of {kind} dams ({run.label})"
            pieces.append(table(title, criteria.Check._fields, outcome))
    if not pieces:
        return nothing("checks", "Checks", "strengths and no limits")
    return Section("checks", "Checks", [*pieces, paragraph(_NOTE, "note")])


def judged(run: Run) -> tuple[str, criteria.Checks | str | None]:
    """Return kind of the dam, and checks, the text of an error, or None without limits."""
    given = run.results.metadata.get("checks")
    arguments: dict[str, Any] = {"kind": "gravity"}
    arguments |= given if isinstance(given, Mapping) else {}
    if given is None and DYNAMIC_TENSILE not in run.results.statics:
        return arguments["kind"], None
    try:
        return arguments["kind"], criteria.checks(run.results, **arguments)
    except (TypeError, ValueError, JointsError) as error:
        return str(arguments["kind"]), str(error)


def unmet(run: Run) -> str | None:
    """Return the criteria that a run does not meet, in words; None without checks."""
    if not isinstance(outcome := judged(run)[1], tuple):
        return outcome and "the run cannot be checked"
    limited = [row for row in outcome if row.met not in ("no limit", "not recorded")]
    failed = dict.fromkeys(row.criterion for row in limited if row.met == "no")
    return "; ".join(failed) or f"none of {len(limited)} with limits"


def sliding(content: Content) -> Section | None:
    """Return the section with the blocks of the runs' metadata ``sliding``, None without blocks."""
    pieces: list[Html] = []
    curves: list[list[Curve]] = [[], []]
    columns = TABLE["sliding_measures"]
    for run in content.runs:
        try:
            blocks = recorded_blocks(run.results)
        except (TypeError, ValueError, JointsError) as error:
            pieces.append(paragraph(f"Blocks of {run.label} cannot be evaluated: {error}"))
            continue
        rows = []
        for name, block in blocks.items():
            values = block.measures()
            rows.append([name, *(row.factor * values[row.name] for row in columns)])
            label, safety = f"{name}, {run.label}", np.minimum(block.safety, _SAFE)
            curves[0].append((label, block.time, safety))
            curves[1].append((label, block.slip_time, 1e3 * block.slip))
            curves[1].append((f"{label}: Newmark's block", block.time, 1e3 * block.newmark_slip))
        if rows:
            head = ["block", *(row.heading for row in columns)]
            pieces.append(table(f"Sliding blocks ({run.label})", head, rows))
    if curves[0]:
        spec = panels(curves, ["factor of safety", "slip [mm]"], "time [s]", shown=6)
        caption = f"Factor of safety, drawn up to {_SAFE:g}, and slip against time."
        pieces += [content.drawings.plot("sliding", spec, caption), paragraph(_SLIDING, "note")]
    return Section("sliding", "Sliding blocks", pieces) if pieces else None
