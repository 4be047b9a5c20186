# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Order of the sections of a report: statics, earthquake, joints, stresses, then computation."""

from __future__ import annotations

from collections.abc import Callable

from dolfinx_joints.common.progress import Progress
from dolfinx_joints.report import (
    assumption_section,
    body_sections,
    check_section,
    joint_sections,
    parameter_sections,
    response_sections,
    run_sections,
    static_section,
)
from dolfinx_joints.report.page import Section
from dolfinx_joints.report.runs import Addition, Content

SECTIONS: tuple[Callable[[Content], Section | None], ...] = (
    static_section.statics,
    response_sections.ground,
    response_sections.displacements,
    response_sections.response_spectra,
    body_sections.space,
    joint_sections.joints,
    body_sections.stresses,
    check_section.checks,
    check_section.sliding,
    parameter_sections.parameters,
    body_sections.mesh,
    run_sections.energies,
    run_sections.cost,
    run_sections.convergence,
    run_sections.versions,
)
SECTIONS_OF_BODY = (body_sections.space, body_sections.stresses, body_sections.mesh)


def ordered(content: Content, added: Addition, *, of_body: bool) -> list[Section]:
    """Return all sections of a report, with the caller's sections first and last."""
    chosen = [make for make in SECTIONS if of_body or make not in SECTIONS_OF_BODY]
    progress, made = Progress("report", len(chosen), "sections"), []
    for make in chosen:
        if (section := make(content)) is not None:
            made.append(section)
        progress.advance()
    progress.finish()
    first = assumption_section.assumptions(content, made)
    return [*added.first, first, *(section for section in made if section.pieces), *added.last]
