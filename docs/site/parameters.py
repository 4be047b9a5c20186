# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The table of declared parameters for the reference, from the declarations themselves."""

from __future__ import annotations

from itertools import groupby

import dolfinx_joints
from dolfinx_joints.common.declared import CHECKED, REQUIRED, Declaration, declarations


def table() -> str:
    """Markdown: for each wing the name, unit, range and default of every declared parameter."""
    for name in dolfinx_joints.__all__:
        getattr(dolfinx_joints, name)
    known = sorted({(of.__module__.split(".")[1], of.__qualname__): of for of in CHECKED}.items())
    text = ""
    for wing, members in groupby(known, key=lambda item: item[0][0]):
        text += f"## {wing}\n\n| parameter | unit | may be | default |\n|---|---|---|---|\n"
        for (_, name), of in members:
            text += "".join(_row(name, each) for each in declarations(of))
        text += "\n"
    return text


def _row(owner: str, each: Declaration) -> str:
    default = "required" if each.default is REQUIRED else f"`{each.default!r}`"
    allowed = each.allowed.replace("|", "\\|")
    return f"| `{owner}.{each.name}` | {each.unit} | {allowed} | {default} |\n"
