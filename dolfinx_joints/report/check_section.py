# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section with the checks of a dam: criterion, value, limit, and whether it is met."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.postprocessing.criteria import checks as criteria
from dolfinx_joints.postprocessing.envelopes import DYNAMIC_TENSILE
from dolfinx_joints.report.page import Section, paragraph, table
from dolfinx_joints.report.runs import Content, nothing

_NOTE = (
    "Default limits are the linear criteria of USACE EM 1110-2-6053 (2007) and of Y. Ghanaat and "
    "A. Chudgar; check them against the edition that applies. Stresses are those of the "
    "cell groups with joints, at vertices with a strength; other tables of stresses cover all "
    "recorded vertices."
)


def checks(content: Content) -> Section:
    """Return the section with a table for each run with strengths or arguments of `checks`.

    The limits are those of a gravity dam unless the metadata of the run has another kind.
    """
    pieces = []
    for run in content.runs:
        given = run.results.metadata.get("checks")
        if given is not None or DYNAMIC_TENSILE in run.results.statics:
            arguments: dict[str, Any] = {"kind": "gravity"}
            arguments |= given if isinstance(given, Mapping) else {}
            try:
                rows = criteria.checks(run.results, **arguments)
            except (TypeError, ValueError, JointsError) as error:
                pieces.append(paragraph(f"{run.label} cannot be checked: {error}"))
                continue
            title = f"Checks, limits of {arguments['kind']} dams ({run.label})"
            pieces.append(table(title, criteria.Check._fields, rows))
    if not pieces:
        return nothing("checks", "Checks", "strengths and no limits")
    return Section("checks", "Checks", [*pieces, paragraph(_NOTE, "note")])
