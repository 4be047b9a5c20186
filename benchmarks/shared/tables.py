# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables in Markdown.

A form has two lines: the headings, and the formats of the cells with values of a row by name.
``{ratio:.2f}`` prints ``row["ratio"]``, ``{setup_s[mesh]:.1f}`` prints ``row["setup_s"]["mesh"]``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def head(form: str) -> str:
    """Return the two header lines of a table."""
    headings = form.splitlines()[0]
    return f"{headings}\n{'|---' * (headings.count('|') - 1)}|"


def line(form: str, row: Mapping[str, Any]) -> str:
    """Return a row."""
    return form.splitlines()[1].format_map(row)


def table(form: str, rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a whole table."""
    return "\n".join([head(form), *(line(form, row) for row in rows)])
