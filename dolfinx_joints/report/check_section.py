# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section with the checks of a dam: criterion, value, limit, and whether it is met."""

from __future__ import annotations

from dolfinx_joints.postprocessing.criteria import checks as criteria
from dolfinx_joints.postprocessing.envelopes import DYNAMIC_TENSILE
from dolfinx_joints.report.page import Html, Section, paragraph, table
from dolfinx_joints.report.runs import Content, Run, nothing

_NOTE = (
    "Default limits: linear criteria of USACE EM 1110-2-6053 (2007) and of Y. Ghanaat and "
    "A. Chudgar. Check them against the edition that applies. Rows without a recorded value or a "
    "limit are not judged. The stresses are those of a linear body."
)


def checks(content: Content) -> Section:
    """Return the section with a table for each run with strengths or arguments of `checks`."""
    files = ((run, run.results) for run in content.runs)
    runs = [run for run, r in files if DYNAMIC_TENSILE in r.statics or "checks" in r.metadata]
    if not runs:
        return nothing("checks", "Checks", "strengths and no limits")
    return Section("checks", "Checks", [*map(_table, runs), paragraph(_NOTE, "note")])


def _table(run: Run) -> Html:
    """Return the table of a run; the limits are those of a gravity dam unless the file says so."""
    given = {"kind": "gravity", "groups": run.groups, **run.results.metadata.get("checks", {})}
    rows = [
        [row.criterion, row.where, row.value, row.limit, row.unit, row.met]
        for row in criteria.checks(run.results, **given)
    ]
    return table(f"Checks, limits of {given['kind']} dams ({run.label})", criteria.HEAD, rows)
