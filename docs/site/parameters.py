# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of parameters for the reference, generated from their declarations."""

from __future__ import annotations

from itertools import groupby

import dolfinx_joints
from dolfinx_joints.common.declared import CHECKED, REQUIRED, Declaration, declarations


def table() -> str:
    """Return a Markdown table per wing: name, unit, range and default of each parameter."""
    for name in dolfinx_joints.__all__:
        getattr(dolfinx_joints, name)
    owners = sorted(
        {(cls.__module__.split(".")[1], cls.__qualname__): cls for cls in CHECKED}.items()
    )
    text = ""
    for wing, members in groupby(owners, key=lambda item: item[0][0]):
        text += f"## {wing}\n\n| parameter | unit | allowed | default |\n|---|---|---|---|\n"
        for (_, name), cls in members:
            text += "".join(_row(name, declared) for declared in declarations(cls))
        text += "\n"
    return text


def _row(owner: str, declared: Declaration) -> str:
    default = "required" if declared.default is REQUIRED else f"`{declared.default!r}`"
    allowed = declared.allowed.replace("|", "\\|")
    return f"| `{owner}.{declared.name}` | {declared.unit} | {allowed} | {default} |\n"
